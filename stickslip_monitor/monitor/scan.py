# SPDX-License-Identifier: Apache-2.0
"""A whole recording at once: the physics in bulk, then a walk over what changes.

Between two changes of rung the alarm can only act by the passing of time, which the next step of
the walk catches up on. So the walk visits the samples at which the rung changes, the clock jumps,
or an input has been silent for longer than its timeout, and nothing else.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from stickslip_monitor.arrays import BoolArray, IntArray
from stickslip_monitor.monitor.assessment import Assessment, assess, at_index
from stickslip_monitor.monitor.config import BearingConfig
from stickslip_monitor.monitor.ladder import (
    LADDER,
    AlarmTrack,
    Condition,
    ConditionChange,
    ConditionClassifier,
    LastSample,
)
from stickslip_monitor.monitor.signals import SampleValidator, Status, Stream, to_si, value_faults
from stickslip_monitor.monitor.trend import Trend, window_of
from stickslip_monitor.monitor.verdict import Event, event_of

_STATUSES = tuple(Status)


@dataclass(frozen=True, slots=True)
class Scan:
    """The verdicts on a recording of one bearing.

    Attributes:
        time_ns: Times of the evaluated operating points, shape (n,) [ns].
        until_ns: How long each counts: to the next one or to the loss of an input, (n,) [ns].
        assessment: Assessment of arrays, shape (n,).
        sticking: Whether stick-slip is predicted, shape (n,).
        first: Index of the first point since the clock last jumped, shape (n,).
        rung: The alarm's rung after each point, index into ``LADDER``, shape (n,).
        events: Changes of the alarm, in order.
        counts: Samples by quantity (speed, load) and :class:`Status`, shape (2, 6).
        status: What became of each sample of the stream, a :class:`Status`, shape (m,).
    """

    time_ns: IntArray
    until_ns: IntArray
    assessment: Assessment
    sticking: BoolArray
    first: IntArray
    rung: NDArray[np.int8]
    events: list[Event]
    counts: IntArray
    status: NDArray[np.int8]

    @property
    def condition(self) -> list[Condition]:
        """What the alarm says after each point."""
        return [LADDER[rung] for rung in self.rung]


@dataclass(frozen=True, slots=True)
class _Believed:
    """The believed samples in order of arrival.

    Attributes:
        value: SI values, shape (n,).
        stamp: Time of each measurement, shape (n,) [ns].
        until: Until when each counts by its input's timeout, shape (n,) [ns].
        now: The monitor's time at each, shape (n,) [ns].
        first: Index of the first sample since the clock last jumped, shape (n,).
        latest: Index of each input's last sample so far, this one included, shape (2, n);
            below ``first`` where there is none since the clock last jumped.
        jump: Whether the clock jumped, shape (n,).
    """

    value: NDArray[np.float64]
    stamp: IntArray
    until: IntArray
    now: IntArray
    first: IntArray
    latest: IntArray
    jump: BoolArray

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
    points = assess(config.bearing, speed, load)
    rungs, sticking = _rungs(config, points)
    # The first point of each stretch between two jumps, for all points of that stretch.
    begin = np.searchsorted(evaluated, np.append(0, np.flatnonzero(samples.jump)))
    first = np.repeat(begin, np.diff(np.append(begin, evaluated.size)))
    walk = _Walk(config, samples, evaluated, rungs, start_ns)
    events = walk.run(end_ns, points, sticking)
    return Scan(
        time_ns=walk.times,
        until_ns=_until(samples, rows, end_ns),
        assessment=points,
        sticking=sticking,
        first=first,
        rung=walk.settled,
        events=events,
        counts=gate.counts,
        status=status,
    )


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


def _rungs(config: BearingConfig, points: Assessment) -> tuple[NDArray[np.int8], BoolArray]:
    if points.speed.size:
        return ConditionClassifier(config.alarm).rungs(points)
    return np.empty(0, dtype=np.int8), np.empty(0, dtype=bool)


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
    """Carries the alarm over the samples at which something can change."""

    def __init__(
        self,
        config: BearingConfig,
        samples: _Believed,
        evaluated: NDArray[np.intp],
        rungs: NDArray[np.int8],
        start_ns: int | None,
    ) -> None:
        self.config, self.samples, self.evaluated, self.rungs = config, samples, evaluated, rungs
        self.track = AlarmTrack(config)
        late_start = samples.now.size > 0 and start_ns is not None and samples.now[0] < start_ns
        self.track.start_ns = int(samples.now[0]) if late_start else start_ns
        self.times = samples.now[_as_slice(evaluated)]
        self.settled = np.zeros(evaluated.size, dtype=np.int8)
        # With the point that each rests on, and the first one since the clock last jumped.
        self._changes: list[tuple[ConditionChange, int, int]] = []

    def run(self, end_ns: int | None, points: Assessment, sticking: BoolArray) -> list[Event]:
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
                bool(k >= 0 and sticking[k]),
                self._trend(points, sticking, k, low),
            )
            for change, k, low in self._changes
        ]

    def _trend(self, points: Assessment, sticking: BoolArray, k: int, low: int) -> Trend | None:
        return None if k < low else trend_at(self.config, self.times, points, sticking, low, k)

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
        segment = samples.first[self.evaluated]
        change = np.flatnonzero((np.diff(self.rungs) != 0) | (np.diff(segment) != 0)) + 1
        stop[self.evaluated[:1]] = True
        stop[self.evaluated[change]] = True
        stop[self._at_instants(np.flatnonzero(stop), np.flatnonzero(late), segment)] = True
        return np.flatnonzero(stop)

    def _at_instants(
        self, stops: NDArray[np.intp], late: NDArray[np.intp], segment: NDArray[np.intp]
    ) -> NDArray[np.intp]:
        """The points at which something can end exactly, or at which a lost input has returned."""
        points = self.evaluated
        if not points.size:
            return points
        before = np.searchsorted(points, late) - 1
        here = np.searchsorted(points, stops, 'right') - 1
        last = np.concatenate([before, here, [points.size - 1]])
        new_instant = np.append(True, (np.diff(self.times) != 0) | (np.diff(segment) != 0))
        # A delay that ends at an instant ends at the first point of that instant.
        first = np.maximum.accumulate(np.where(new_instant, np.arange(points.size), 0))
        returned = np.searchsorted(points, late)
        chosen = np.concatenate([first[last[last >= 0]], returned[returned < points.size]])
        return np.asarray(points[chosen], dtype=np.intp)

    def _visit(self, i: int) -> None:
        samples = self.samples
        now = int(samples.now[i])
        k = int(np.searchsorted(self.evaluated, i))
        if samples.jump[i]:
            self.track.restart(now)
        else:
            low = int(np.searchsorted(self.evaluated, samples.first[i]))
            self._note(self.track.advance(now, samples.heard(i - 1)), low, k)
        if k < self.evaluated.size and self.evaluated[k] == i:
            low = int(np.searchsorted(self.evaluated, samples.first[i]))
            for change in self.track.apply(int(self.rungs[k]), now):
                self._record(change, k, k, low)

    def _finish(self, end_ns: int) -> None:
        samples, n = self.samples, self.samples.now.size
        low = int(np.searchsorted(self.evaluated, samples.first[-1])) if n else 0
        end_ns = max(end_ns, int(samples.now[-1])) if n else end_ns
        changes = self.track.advance(end_ns, samples.heard(n - 1))
        self._note(changes, low, self.evaluated.size)

    def _note(self, changes: list[ConditionChange], low: int, high: int) -> None:
        """Record changes that fell due by the passing of time, after the points that precede."""
        for change in changes:
            stale = change.after is Condition.INPUT_STALE
            # The loss of an input follows all points of its instant, a delay the first of them.
            bound = change.time_ns + 1 if stale else change.time_ns
            k = low + int(np.searchsorted(self.times[low:high], bound))
            at_point = not stale and k < high and self.times[k] == change.time_ns
            self._record(change, k if at_point else k - 1, k, low)

    def _record(self, change: ConditionChange, based_on: int, effective: int, low: int) -> None:
        self._changes.append((change, based_on, low))
        if change.after is not Condition.INPUT_STALE:
            self.settled[effective:] = LADDER.index(change.after)


def trend_at(
    config: BearingConfig,
    time_ns: IntArray,
    points: Assessment,
    sticking: BoolArray,
    low: int,
    k: int,
) -> Trend | None:
    """The trend after a point of a recording.

    Args:
        config: The bearing.
        time_ns: Times of the operating points, shape (n,) [ns].
        points: Their assessment, shape (n,).
        sticking: Whether each predicts stick-slip, shape (n,).
        low: Index of the first point since the clock last jumped.
        k: Index of the point.
    """
    rows = slice(low, k + 1)
    window = window_of(
        config.alarm.trend_window_ns, time_ns[rows], points.speed[rows], points.load[rows]
    )
    return window.trend(config, bool(sticking[k]))


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
