# SPDX-License-Identifier: Apache-2.0
"""A whole recording at once: the physics in bulk, then a walk over what changes.

The rule of the decision gives the rung after each point in bulk. What is left is a walk over the
samples at which the rung changes, the clock jumps, or an input has been silent for longer than
its timeout.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from stickslip_monitor.arrays import BoolArray, IntArray
from stickslip_monitor.monitor.assessment import Assessments, assess, at_index
from stickslip_monitor.monitor.config import BearingConfig
from stickslip_monitor.monitor.decision import ConditionClassifier, Decisions
from stickslip_monitor.monitor.freshness import Fresh, lasts
from stickslip_monitor.monitor.ladder import (
    LADDER,
    AlarmTrack,
    Condition,
    ConditionChange,
    LastSample,
)
from stickslip_monitor.monitor.lookahead import futures
from stickslip_monitor.monitor.measured import LevelCourse, follow_level
from stickslip_monitor.monitor.signals import (
    NO_LEVELS,
    SampleValidator,
    Status,
    Stream,
    to_si,
    value_faults,
)
from stickslip_monitor.monitor.trend import Trend, window_of
from stickslip_monitor.monitor.verdict import Event, event_of

_STATUSES = tuple(Status)


@dataclass(frozen=True, slots=True)
class Scan:
    """The verdicts on a recording of one bearing.

    Attributes:
        time_ns: Times of the evaluated operating points, shape (n,) [ns].
        until_ns: How long each counts: to the next one or to the loss of an input, (n,) [ns].
        assessment: Assessments, shape (n,).
        course: What the alarm rests on after each point.
        first: Index of the first point since the clock last jumped, shape (n,).
        events: Changes of the alarm, in order.
        counts: Samples by quantity (speed, load) and :class:`Status`, shape (2, 6).
        status: What became of each sample of the stream, a :class:`Status`, shape (m,).
        level: What the measured vibration said; ``None`` where none is configured.
    """

    time_ns: IntArray
    until_ns: IntArray
    assessment: Assessments
    course: Decisions
    first: IntArray
    events: list[Event]
    counts: IntArray
    status: NDArray[np.int8]
    level: LevelCourse | None = None

    @property
    def sticking(self) -> BoolArray:
        """Whether stick-slip is predicted, shape (n,)."""
        return self.course.sticking

    @property
    def rung(self) -> NDArray[np.int8]:
        """The alarm's rung after each point, index into ``LADDER``, shape (n,)."""
        return self.course.rung

    @property
    def condition(self) -> list[Condition]:
        """What the alarm says after each point."""
        return [LADDER[rung] for rung in self.rung]


@dataclass(frozen=True, slots=True)
class _Believed:
    """The believed samples in order of arrival.

    Attributes:
        value: SI values, shape (n,).
        is_load: Whether it is a load, shape (n,).
        stamp: Time of each measurement, shape (n,) [ns].
        until: Until when each counts by its input's timeout, shape (n,) [ns].
        now: The monitor's time at each, shape (n,) [ns].
        first: Index of the first sample since the clock last jumped, shape (n,).
        latest: Index of each input's last sample so far, this one included, shape (2, n);
            below ``first`` where there is none since the clock last jumped.
        jump: Whether the clock jumped, shape (n,).
    """

    value: NDArray[np.float64]
    is_load: BoolArray
    stamp: IntArray
    until: IntArray
    now: IntArray
    first: IntArray
    latest: IntArray
    jump: BoolArray

    def of_input(self, is_load: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """The samples of an input, and the number of its last sample so far, shape (n,)."""
        mine = self.is_load == bool(is_load)
        return np.flatnonzero(mine), np.cumsum(mine) - 1

    def heard(self, i: int) -> list[LastSample | None]:
        """The last sample of each input up to and including sample ``i`` (-1: none)."""
        if i < 0:
            return [None, None]
        return [
            LastSample(int(self.stamp[k]), int(self.until[k])) if k >= self.first[i] else None
            for k in self.latest[:, i].tolist()
        ]


def scan_bearing(
    config: BearingConfig, stream: Stream, start_ns: int | None, end_ns: int | None
) -> Scan:
    """Evaluate the recording of one bearing; see :meth:`Monitor.scan`."""
    gate = SampleValidator(config)
    si, status = _admit(config, gate, stream)
    samples = _believed(config, stream, si, status)
    evaluated = _paired(config, samples)
    rows = _as_slice(evaluated)
    speed, load = (samples.value[latest[rows]] for latest in samples.latest)
    points = assess(config.bearing, speed, load, config.belief)
    points.remember_runs(0.0)
    # The first point of each stretch between two jumps, for all points of that stretch.
    begin = np.searchsorted(evaluated, np.append(0, np.flatnonzero(samples.jump)))
    lengths = np.diff(np.append(begin, evaluated.size))
    first = np.repeat(begin, lengths)
    times = samples.now[rows]
    level, measured = _measured(config, stream, status, samples, rows)
    course = ConditionClassifier(config.bearing, config.alarm, config.level).follow(
        points,
        times,
        begin[lengths > 0],
        _futures(config, samples, rows),
        _fresh(samples, rows),
        measured,
    )
    walk = _Walk(config, samples, evaluated, course, start_ns)
    return Scan(
        time_ns=times,
        until_ns=_until(samples, rows, end_ns),
        assessment=points,
        course=course,
        first=first,
        events=walk.run(end_ns, points),
        counts=gate.counts,
        status=status,
        level=level,
    )


def _measured(
    config: BearingConfig,
    stream: Stream,
    status: NDArray[np.int8],
    samples: _Believed,
    rows: slice | NDArray[np.intp],
) -> tuple[LevelCourse | None, NDArray[np.int8] | None]:
    """What the level says, and what it says at each point, shape (n,)."""
    if config.level is None:
        return None, None
    place = np.flatnonzero(status <= Status.CLOCK_JUMP)
    level = follow_level(config.level, stream.level or NO_LEVELS, place[samples.jump])
    begun = samples.first[rows]
    first = np.where(samples.jump[begun], place[begun], -1) if place.size else begun
    return level, level.at(samples.now[rows], place[rows], first)


def _futures(
    config: BearingConfig, samples: _Believed, rows: slice | NDArray[np.intp]
) -> NDArray[np.float64]:
    """The speed that the trend leads to, at each point, shape (n,) [m/s]."""
    own, number = samples.of_input(0)
    starts = np.append(0, np.flatnonzero(np.diff(samples.first[own])) + 1)[: own.size]
    ahead_ns = config.alarm.look_ahead_ns
    return futures(samples.now[own], samples.value[own], starts, ahead_ns)[number[rows]]


def _fresh(samples: _Believed, rows: slice | NDArray[np.intp]) -> Fresh:
    """How long each point counts."""
    gaps, ends = [], []
    for k in range(2):
        own, number = samples.of_input(k)
        gap = np.diff(samples.stamp[own], prepend=samples.stamp[own[:1]])
        gap[np.flatnonzero(np.diff(samples.first[own])) + 1] = 0
        gap[1:] = np.maximum(gap[1:], np.where(gap[1:] > 0, gap[:-1], 0))
        gaps.append(gap[number[rows]])
        ends.append((samples.now[own] + lasts(gap))[number[rows]])
    now = samples.now[rows]
    # Nothing is counted across a jump of the clock.
    covered = np.minimum(np.append(now[1:], now[-1:]), np.minimum(*ends)) - now
    return Fresh(np.maximum(covered, 0), np.maximum(*gaps))


def _paired(config: BearingConfig, samples: _Believed) -> NDArray[np.intp]:
    """Where both inputs are young enough to make an operating point."""
    paired = np.ones(samples.now.size, dtype=bool)
    for latest, timeout in zip(samples.latest, _timeouts(config)[:, 0], strict=True):
        paired &= latest >= samples.first
        paired &= samples.now - samples.stamp[latest] <= timeout
    return np.flatnonzero(paired)


def _as_slice(places: NDArray[np.intp]) -> slice | NDArray[np.intp]:
    """The same places without a gap as a slice, which copies nothing."""
    if places.size and places[-1] - places[0] + 1 == places.size:
        return slice(int(places[0]), int(places[-1]) + 1)
    return places


def _timeouts(config: BearingConfig) -> IntArray:
    return np.array([[config.speed.timeout_ns], [config.load.timeout_ns]])


def _admit(
    config: BearingConfig, gate: SampleValidator, stream: Stream
) -> tuple[NDArray[np.float64], NDArray[np.int8]]:
    """SI value and status of every sample; counts go to the gate."""
    si = np.empty(stream.value.shape)
    status = np.empty(stream.value.shape, dtype=np.int8)
    in_order = True
    for is_load, settings in enumerate((config.speed, config.load)):
        own = stream.is_load == bool(is_load)
        si[own] = to_si(settings, stream.value[own])
        status[own] = value_faults(settings, si[own])
        stamps = stream.time_ns[own][status[own] == Status.ACCEPTED]
        in_order = in_order and bool(np.all(np.diff(stamps) > 0))
    if in_order:
        kinds = stream.is_load * np.int8(len(Status)) + status
        gate.counts += np.bincount(kinds, minlength=gate.counts.size).reshape(gate.counts.shape)
    else:
        rows = np.column_stack([stream.is_load, stream.time_ns, status]).tolist()
        status[:] = [
            gate.admit(is_load, time_ns, Status(fault)) for is_load, time_ns, fault in rows
        ]
    return si, status


def _believed(
    config: BearingConfig, stream: Stream, si: NDArray[np.float64], status: NDArray[np.int8]
) -> _Believed:
    believed = status <= Status.CLOCK_JUMP
    # As a rule all are, and a slice costs nothing where a selection copies.
    keep = slice(None) if believed.all() else np.flatnonzero(believed)
    stamp, is_load = stream.time_ns[keep], stream.is_load[keep]
    jump = status[keep] == Status.CLOCK_JUMP
    place = np.arange(stamp.size)
    speed_timeout, load_timeout = _timeouts(config)[:, 0]
    now = _running_time(stamp, np.flatnonzero(jump))
    return _Believed(
        value=si[keep],
        is_load=is_load,
        stamp=stamp,
        until=np.maximum(stamp + np.where(is_load, load_timeout, speed_timeout), now),
        now=now,
        first=(
            np.maximum.accumulate(np.where(jump, place, 0))
            if jump.any()
            else np.broadcast_to(place[:1], place.shape)
        ),
        latest=np.stack(
            [np.maximum.accumulate(np.where(own, place, -1)) for own in (~is_load, is_load)]
        ),
        jump=jump,
    )


def _running_time(time: IntArray, jumps: NDArray[np.intp]) -> IntArray:
    """Latest time so far, starting anew at each jump of the clock."""
    edges = [0, *jumps.tolist(), time.size]
    now = time.copy()
    for start, end in pairwise(edges):
        np.maximum.accumulate(time[start:end], out=now[start:end])
    return now


class _Walk:
    """Carries the condition over the samples at which it can change."""

    def __init__(
        self,
        config: BearingConfig,
        samples: _Believed,
        evaluated: NDArray[np.intp],
        course: Decisions,
        start_ns: int | None,
    ) -> None:
        self.config, self.samples, self.evaluated, self.course = config, samples, evaluated, course
        self.track = AlarmTrack(config)
        late_start = samples.now.size > 0 and start_ns is not None and samples.now[0] < start_ns
        self.track.start_ns = int(samples.now[0]) if late_start else start_ns
        self.times = samples.now[_as_slice(evaluated)]
        # With the point that each rests on, and the first one since the clock last jumped.
        self._changes: list[tuple[ConditionChange, int, int]] = []

    def run(self, end_ns: int | None, points: Assessments) -> list[Event]:
        """Walk to the end; return the events."""
        for i in self._stops().tolist():
            self._visit(i)
        if end_ns is not None:
            self._finish(end_ns)
        return [
            event_of(
                self.config,
                change,
                at_index(points, k) if k >= 0 else None,
                self.course.at(k),
                self._trend(points, k, low),
            )
            for change, k, low in self._changes
        ]

    def _trend(self, points: Assessments, k: int, low: int) -> Trend | None:
        if k < low or self.course.sticking[k]:
            return None
        return trend_at(self.config, self.times, points, low, k)

    def _stops(self) -> NDArray[np.intp]:
        samples = self.samples
        if not samples.now.size:
            return np.empty(0, dtype=np.intp)
        begin = samples.now[samples.first]
        if self.track.start_ns is not None:
            begin = np.where(samples.first == 0, self.track.start_ns, begin)
        late = np.zeros(samples.now.size, dtype=bool)
        for latest, timeout in zip(samples.latest, _timeouts(self.config)[:, 0], strict=True):
            # An input waits from the beginning, or for as long as its last sample counts.
            late[0] |= samples.now[0] > begin[0] + timeout
            heard = latest[:-1] >= samples.first[1:]
            until = np.where(heard, samples.until[latest[:-1]], begin[1:] + timeout)
            late[1:] |= samples.now[1:] > until
        stop = late | samples.jump
        # What fell due before the clock jumped must happen before the jump forgets it.
        stop[:-1] |= samples.jump[1:]
        stop[0] = True
        rung = self.course.rung
        stop[self.evaluated[np.flatnonzero(np.diff(rung, prepend=np.int8(0)))]] = True
        # A lost input has returned at the next point.
        returned = np.searchsorted(self.evaluated, np.flatnonzero(late))
        stop[self.evaluated[returned[returned < self.evaluated.size]]] = True
        return np.flatnonzero(stop)

    def _visit(self, i: int) -> None:
        samples = self.samples
        now = int(samples.now[i])
        k = int(np.searchsorted(self.evaluated, i))
        low = int(np.searchsorted(self.evaluated, samples.first[i]))
        if samples.jump[i]:
            self.track.restart(now)
        else:
            self._note(self.track.advance(now, samples.heard(i - 1)), k - 1, low)
        if k < self.evaluated.size and self.evaluated[k] == i:
            self._note(self.track.apply(int(self.course.rung[k]), now), k, low)

    def _finish(self, end_ns: int) -> None:
        samples, n = self.samples, self.samples.now.size
        low = int(np.searchsorted(self.evaluated, samples.first[-1])) if n else 0
        end_ns = max(end_ns, int(samples.now[-1])) if n else end_ns
        changes = self.track.advance(end_ns, samples.heard(n - 1))
        self._note(changes, self.evaluated.size - 1, low)

    def _note(self, changes: list[ConditionChange], k: int, low: int) -> None:
        self._changes += [(change, k, low) for change in changes]


def trend_at(
    config: BearingConfig, time_ns: IntArray, points: Assessments, low: int, k: int
) -> Trend | None:
    """The trend after a point of a recording.

    Args:
        config: The bearing.
        time_ns: Times of the operating points, shape (n,) [ns].
        points: Their assessment, shape (n,).
        low: Index of the first point since the clock last jumped.
        k: Index of the point.
    """
    rows = slice(low, k + 1)
    window = window_of(
        config.alarm.trend_window_ns, time_ns[rows], points.speed[rows], points.load[rows]
    )
    return window.trend(config)


def _until(samples: _Believed, rows: slice | NDArray[np.intp], end_ns: int | None) -> IntArray:
    now = samples.now[rows]
    if not now.size:
        return now
    lost = np.minimum(*(samples.until[latest[rows]] for latest in samples.latest))
    last = now[-1] if end_ns is None else max(end_ns, now[-1])
    following = np.append(now[1:], last)
    # Where the clock jumps back there is no telling how long the point counted.
    np.maximum(following, now, out=following)
    np.minimum(following, lost, out=following)
    return np.maximum(now, following, out=following)
