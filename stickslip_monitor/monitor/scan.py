# SPDX-License-Identifier: Apache-2.0
"""A recording in blocks: the physics in bulk, then a walk over what changes.

The rule of the decision gives the rung after each point in bulk. What is left is a walk over the
samples at which the rung changes, the clock jumps, or an input has been silent for longer than
its timeout. What one block leaves to the next is what the live monitor keeps between samples, so
any cut into blocks gives the same verdicts, and memory does not grow with the recording.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stickslip_monitor.arrays import BoolArray, FloatArray, IntArray
from stickslip_monitor.monitor.assessment import (
    Assessment,
    Assessments,
    assess,
    at_index,
    at_indices,
)
from stickslip_monitor.monitor.config import BearingConfig, InputConfig
from stickslip_monitor.monitor.decision import ConditionClassifier, Decisions, Standing
from stickslip_monitor.monitor.freshness import Fresh, Rhythm
from stickslip_monitor.monitor.ladder import (
    LADDER,
    AlarmTrack,
    Condition,
    ConditionChange,
    LastSample,
)
from stickslip_monitor.monitor.lookahead import SpeedTrend
from stickslip_monitor.monitor.measured import LevelCourse, LevelScan
from stickslip_monitor.monitor.signals import (
    NO_LEVELS,
    SampleValidator,
    Status,
    Stream,
    to_si,
    value_faults,
)
from stickslip_monitor.monitor.trend import Trend, TrendWindow
from stickslip_monitor.monitor.verdict import Event, event_of

_NOWHERE = np.empty(0, np.intp)


class LatestPoint(NamedTuple):
    """The last operating point, whose end may not be known yet.

    Attributes:
        number: Its number, counted from the first point of the recording.
        first: That of the first point since the clock last jumped.
        time_ns: Its time [ns].
        assessment: Its assessment, of scalars.
        standing: What the alarm rests on after it.
    """

    number: int
    first: int
    time_ns: int
    assessment: Assessment
    standing: Standing


@dataclass(frozen=True, slots=True)
class Scan:
    """The verdicts on a recording of one bearing, or on a part of one.

    Attributes:
        time_ns: Times of the evaluated operating points, shape (n,) [ns].
        until_ns: How long each counts: to the next one or to the loss of an input, (n,) [ns].
        assessment: Assessments, shape (n,).
        course: What the alarm rests on after each point.
        first: Number of the first point since the clock last jumped, counted from the first point
            of the recording, shape (n,).
        events: Changes of the alarm, in order.
        counts: Samples by quantity (speed, load) and :class:`Status`, shape (2, 6).
        status: What became of each sample of the stream, a :class:`Status`, shape (m,).
        level: What the measured vibration said; ``None`` where none is configured.
        latest: The last point so far; of a part it is as a rule the first of the next one.
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
    latest: LatestPoint | None = None

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


def scan_bearing(
    config: BearingConfig, stream: Stream, start_ns: int | None, end_ns: int | None
) -> Scan:
    """Evaluate the recording of one bearing; see :meth:`Monitor.scan`."""
    return BearingScan(config, start_ns).finish(stream, end_ns)


@dataclass(frozen=True, slots=True)
class _Arrived:
    """The believed samples of a block in order of arrival, shape (n,) each.

    Attributes:
        value: SI values.
        is_load: Whether it is a load.
        stamp: Time of each measurement [ns].
        now: The monitor's time at each [ns].
        jumps: The samples at which the clock jumped, shape (m,).
    """

    value: FloatArray
    is_load: BoolArray
    stamp: IntArray
    now: IntArray
    jumps: NDArray[np.intp]


@dataclass(frozen=True, slots=True)
class _OfInput:
    """One input in a block: its last sample before, where it still counts, then its own.

    Attributes:
        value: SI values, shape (m,).
        stamp: Time of each measurement, shape (m,) [ns].
        until: Until when each counts by its timeout, shape (m,) [ns].
        gap: The rhythm at each, shape (m,) [ns].
        ends: Until when each counts by its rhythm, shape (m,) [ns].
        future: The speed that the trend leads to, shape (m,) [m/s]; nothing of a load.
        place: Number among these of the last one so far at each of the block's samples, (n,).
        own: Whether each of the block's samples is this input's, shape (n,).
        since: The first of these since the clock last jumped, at each of the block's samples:
            shape (n,), or one number for all.
        calm: Whether the input counts at, and until, each of the block's samples.
    """

    value: FloatArray
    stamp: IntArray
    until: IntArray
    gap: IntArray
    ends: IntArray
    future: FloatArray
    place: IntArray
    own: BoolArray
    since: IntArray | int
    calm: bool

    def before(self, i: int) -> LastSample | None:
        """The last one before a sample of the block."""
        return self._sample(int(self.place[i]) - int(self.own[i]), i)

    def latest(self) -> LastSample | None:
        """The last one at the end of the block."""
        return self._sample(int(self.place[-1]), -1)

    def _sample(self, k: int, i: int) -> LastSample | None:
        since = self.since if isinstance(self.since, int) else int(self.since[i])
        return None if k < since else LastSample(int(self.stamp[k]), int(self.until[k]))


class _InputScan:
    """What is carried of one input from block to block."""

    def __init__(self, config: InputConfig, ahead_ns: int | None) -> None:
        self._timeout_ns = config.timeout_ns
        self._ahead_ns = ahead_ns
        self._rhythm = Rhythm()
        self._speeds = SpeedTrend()
        self._last: tuple[NDArray[Any], ...] | None = None
        self.heard: LastSample | None = None

    def take(self, samples: _Arrived, own: BoolArray) -> _OfInput:
        """Take a block, at least one sample."""
        rows = np.flatnonzero(own)
        stamp, now, value = samples.stamp[rows], samples.now[rows], samples.value[rows]
        # At which of its own the clock had jumped, or the block begins.
        cuts = np.searchsorted(rows, samples.jumps)
        gap, ends, future = self._in_stretches(stamp, now, value, cuts)
        until = np.maximum(stamp + self._timeout_ns, now)
        columns: Any = (value, stamp, until, gap, ends, future)
        carried = int(self._last is not None)
        if self._last is not None:
            columns = tuple(map(np.concatenate, zip(self._last, columns, strict=True)))
        place = np.cumsum(own) + (carried - 1)
        since: IntArray | int = 0
        if samples.jumps.size:
            jumps = np.zeros(own.size, np.int64)
            jumps[samples.jumps] = cuts + carried
            since = np.maximum.accumulate(jumps)
        calm = bool(carried) and not samples.jumps.size and self._is_calm(columns[1], samples, now)
        value, stamp, until, gap, ends, future = columns
        found = _OfInput(value, stamp, until, gap, ends, future, place, own, since, calm)
        self.heard = found.latest()
        self._last = None if self.heard is None else tuple(c[-1:].copy() for c in columns)
        return found

    def _is_calm(self, stamp: IntArray, samples: _Arrived, now: IntArray) -> bool:
        """Whether each of the input's samples is followed by its next before it is too old."""
        oldest = np.append(now, samples.now[-1]) - stamp
        return int(oldest.max()) <= self._timeout_ns

    def _in_stretches(
        self, stamp: IntArray, now: IntArray, value: FloatArray, cuts: NDArray[np.intp]
    ) -> tuple[IntArray, IntArray, FloatArray]:
        """Rhythm, end of what it lets count and future, between the jumps of the clock."""
        parts = []
        for number, (begin, end) in enumerate(pairwise([0, *cuts.tolist(), stamp.size])):
            if number:
                self._rhythm.restart()
                self._speeds.restart()
            part = slice(begin, end)
            future = (
                value[part]
                if self._ahead_ns is None
                else self._speeds.add_many(now[part], value[part], self._ahead_ns)
            )
            parts.append((*self._rhythm.add_many(stamp[part], now[part]), future))
        if len(parts) == 1:
            return parts[0]
        gap, ends, future = (np.concatenate(column) for column in zip(*parts, strict=True))
        return gap, ends, future


class _Points(NamedTuple):
    """The operating points of a block: the last one before, if any, then its own, shape (n,) each.

    Attributes:
        place: The sample that made each; not of the one before.
        time_ns: Time of each [ns].
        speed: Surface speed [m/s].
        load: Load [N].
        future: The speed that the trend leads to [m/s].
        gap: Rhythm of the slower input [ns].
        ends: Until when each counts by the rhythm of its inputs [ns].
        until: Until when each counts by the timeouts of its inputs [ns].
        first: Number of the first point since the clock last jumped.
    """

    place: NDArray[np.intp]
    time_ns: IntArray
    speed: FloatArray
    load: FloatArray
    future: FloatArray
    gap: IntArray
    ends: IntArray
    until: IntArray
    first: IntArray

    def following(self, end_ns: int | None) -> IntArray:
        """When each is followed by the next, or by the end [ns]."""
        if not self.time_ns.size:
            return self.time_ns
        last = int(self.time_ns[-1])
        return np.append(self.time_ns[1:], last if end_ns is None else max(end_ns, last))

    def lasting(self, end_ns: int | None) -> IntArray:
        """Until when each counts [ns]."""
        found = self.following(end_ns)
        # Where the clock jumps back there is no telling how long the point counted.
        np.maximum(found, self.time_ns, out=found)
        np.minimum(found, self.until, out=found)
        return np.maximum(self.time_ns, found, out=found)

    def fresh(self) -> Fresh:
        """How long each point counts; nothing across a jump of the clock."""
        covered = np.minimum(self.following(None), self.ends) - self.time_ns
        return Fresh(np.maximum(covered, 0, out=covered), self.gap)


_COUNTS, _NUMBERS = np.empty(0, np.int64), np.empty(0)
_NO_POINTS = _Points(
    _NOWHERE, _COUNTS, _NUMBERS, _NUMBERS, _NUMBERS, _COUNTS, _COUNTS, _COUNTS, _COUNTS
)


class BearingScan:
    """One bearing over a recording that comes in blocks.

    Args:
        config: The bearing.
        start_ns: When the recording begins: inputs are waited for from then on [ns].

    The parts that come out follow each other without a gap. How long a point counts is known with
    the next one only, so each part ends a point before the samples that went in.
    """

    def __init__(self, config: BearingConfig, start_ns: int | None) -> None:
        self.config = config
        self._gate = SampleValidator(config)
        self._inputs = (
            _InputScan(config.speed, config.alarm.look_ahead_ns),
            _InputScan(config.load, None),
        )
        self._level = None if config.level is None else LevelScan(config.level)
        self._classifier = ConditionClassifier(config)
        self._track = AlarmTrack(config)
        self._track.start_ns = start_ns
        self._window = TrendWindow(config.alarm.trend_window_ns)
        self._now_ns: int | None = None
        self._last: _Points | None = None
        self._joined = False
        self._runs = 0.0
        self._count = self._first = 0

    def take(self, stream: Stream) -> Scan:
        """Take the next samples; what is known of the recording with them comes out."""
        return self._take(stream)

    def finish(self, stream: Stream, end_ns: int | None) -> Scan:
        """Take the last samples, perhaps none; the rest comes out.

        Args:
            stream: The samples.
            end_ns: When the recording ends: inputs may go stale until then [ns].
        """
        return self._take(stream, end_ns, final=True)

    def _take(self, stream: Stream, end_ns: int | None = None, final: bool = False) -> Scan:
        counted = self._gate.counts.copy()
        si, status = _admit(self.config, self._gate, stream)
        block = self._listen(self._arrived(stream, si, status))
        points = block.points
        known = assess(self.config.bearing, points.speed, points.load, self.config.belief)
        self._runs = known.remember_runs(self._runs)
        level, measured = self._measured(stream, status, block)
        course = self._classifier.follow(
            known,
            points.time_ns,
            block.restarts(),
            points.future,
            points.fresh(),
            block.carried,
            measured,
        )
        walk = _Walk(self.config, self._track, block, course)
        walk.run()
        if final and end_ns is not None:
            walk.finish(end_ns, self._now_ns, [each.heard for each in self._inputs])
        events = [self._event(block, known, course, *change) for change in walk.changes]
        self._keep(block)
        size = max(points.time_ns.size - (not final), 0)
        return Scan(
            time_ns=points.time_ns[:size],
            until_ns=points.lasting(end_ns)[:size],
            assessment=at_indices(known, slice(size)),
            course=course.until(size),
            first=points.first[:size],
            events=events,
            counts=self._gate.counts - counted,
            status=status,
            level=level,
            latest=self._latest(block, known, course),
        )

    def _measured(
        self, stream: Stream, status: NDArray[np.int8], block: _Block
    ) -> tuple[LevelCourse | None, NDArray[np.int8] | None]:
        """What the level says, and what it says at each point of a block."""
        if self._level is None:
            return None, None
        place, new = np.flatnonzero(status <= Status.CLOCK_JUMP), slice(block.carried, None)
        return self._level.take(
            stream.level or NO_LEVELS,
            place[block.samples.jumps],
            place[block.points.place[new]],
            block.points.time_ns[new],
            block.carried,
        )

    def _latest(self, block: _Block, known: Assessments, course: Decisions) -> LatestPoint | None:
        k = block.points.time_ns.size - 1
        if k < 0:
            return None
        time_ns = int(block.points.time_ns[k])
        return LatestPoint(self._count - 1, self._first, time_ns, at_index(known, k), course.at(k))

    def _arrived(self, stream: Stream, si: FloatArray, status: NDArray[np.int8]) -> _Arrived:
        """The samples that are believed, and the monitor's time at each."""
        believed = status <= Status.CLOCK_JUMP
        # As a rule all are, and a slice costs nothing where a selection copies.
        keep = slice(None) if believed.all() else np.flatnonzero(believed)
        stamp, kinds = stream.time_ns[keep], status[keep]
        jumps = np.flatnonzero(kinds == Status.CLOCK_JUMP) if kinds.any() else _NOWHERE
        now = self._running_time(stamp, jumps)
        return _Arrived(si[keep], stream.is_load[keep], stamp, now, jumps)

    def _running_time(self, stamp: IntArray, jumps: NDArray[np.intp]) -> IntArray:
        """Latest time so far, starting anew at each jump of the clock."""
        if not stamp.size:
            return stamp
        first, track = int(stamp[0]), self._track
        if self._now_ns is None:
            self._now_ns = first
            track.start_ns = first if track.start_ns is None else min(first, track.start_ns)
        now = stamp
        if jumps.size or first < self._now_ns or (stamp[1:] < stamp[:-1]).any():
            now = stamp.copy()
            if not (jumps.size and jumps[0] == 0):
                now[0] = max(first, self._now_ns)
            for begin, end in pairwise([0, *jumps.tolist(), stamp.size]):
                np.maximum.accumulate(now[begin:end], out=now[begin:end])
        self._now_ns = int(now[-1])
        return now

    def _listen(self, samples: _Arrived) -> _Block:
        """The operating points that the samples make, behind the last one before them."""
        inputs: list[_OfInput] = []
        if samples.now.size:
            own = (~samples.is_load, samples.is_load)
            inputs = [each.take(samples, o) for each, o in zip(self._inputs, own, strict=True)]
        place = _paired(self.config, samples, inputs)
        carried = int(self._last is not None)
        starts = np.searchsorted(place, samples.jumps) if samples.jumps.size else _NOWHERE
        points = _points(samples, inputs, place, self._numbers(place.size, starts))
        if self._last is not None:
            columns: Any = map(np.concatenate, zip(self._last, points, strict=True))
            points = _Points(*columns)
        return _Block(samples, inputs, points, carried, self._joined, starts + carried)

    def _numbers(self, size: int, starts: NDArray[np.intp]) -> IntArray:
        """Number of the first point since the clock last jumped, at each new point."""
        first = self._first if self._joined else self._count
        begins = np.append(first, self._count + starts)
        return np.repeat(begins, np.diff([0, *starts.tolist(), size]))

    def _event(
        self,
        block: _Block,
        known: Assessments,
        course: Decisions,
        change: ConditionChange,
        k: int,
        stretch: int,
    ) -> Event:
        point = at_index(known, k) if k >= 0 else None
        trend = None
        if k >= block.low(stretch) and not course.sticking[k]:
            window = self._window.copy()
            self._fill(window, block, k + 1, stretch)
            trend = window.trend(self.config)
        return event_of(self.config, change, point, course.at(k), trend)

    def _fill(self, window: TrendWindow, block: _Block, end: int, stretch: int) -> None:
        """Go on with the trend's window up to before a point, after so many jumps."""
        begin = block.carried
        if stretch:
            window.clear()
            begin = int(block.starts[stretch - 1])
        rows, points = slice(begin, end), block.points
        window.fill(points.time_ns[rows], points.speed[rows], points.load[rows])

    def _keep(self, block: _Block) -> None:
        """Keep what the next block needs."""
        size, jumps = block.points.time_ns.size, block.starts.size
        self._fill(self._window, block, size, jumps)
        self._count += size - block.carried
        if size:
            self._joined = block.low(jumps) < size
            self._first = int(block.points.first[-1])
            last: Any = (column[-1:].copy() for column in block.points)
            self._last = _Points(*last)


@dataclass(frozen=True, slots=True)
class _Block:
    """A block of samples and its operating points.

    Attributes:
        samples: The believed samples.
        inputs: The same by input; nothing where there are no samples.
        points: The last point before, if there is one, and the new ones.
        carried: Whether there is one before.
        joined: Whether the clock has not jumped since that one.
        starts: At each jump of the clock the first point after it, shape (m,).
    """

    samples: _Arrived
    inputs: Sequence[_OfInput]
    points: _Points
    carried: int
    joined: bool
    starts: NDArray[np.intp]

    def restarts(self) -> NDArray[np.intp]:
        """The new points before which the clock jumped, or nothing was."""
        found = self.starts if self.joined else np.append(self.carried, self.starts)
        return np.unique(found[found < self.points.time_ns.size])

    def stretch(self, i: int) -> int:
        """How many times the clock has jumped in the block up to a sample."""
        return int(np.searchsorted(self.samples.jumps, i, 'right'))

    def low(self, stretch: int) -> int:
        """The first point after so many jumps."""
        if stretch:
            return int(self.starts[stretch - 1])
        return 0 if self.joined else self.carried

    def point_at(self, i: int) -> int:
        """The first new point at a sample or after it."""
        return self.carried + int(np.searchsorted(self.points.place[self.carried :], i))


class _Walk:
    """Carries the condition over the samples of a block at which it can change.

    Attributes:
        changes: Each with the point that it rests on, and how often the clock jumped before.
    """

    def __init__(
        self, config: BearingConfig, track: AlarmTrack, block: _Block, course: Decisions
    ) -> None:
        self._config, self._track, self._block, self._course = config, track, block, course
        self.changes: list[tuple[ConditionChange, int, int]] = []

    def run(self) -> None:
        """Walk over the block."""
        for i in self._stops().tolist():
            self._visit(i)

    def finish(self, end_ns: int, now_ns: int | None, heard: Sequence[LastSample | None]) -> None:
        """Let time pass to the end of the recording."""
        end_ns = end_ns if now_ns is None else max(end_ns, now_ns)
        points, samples = self._block.points, self._block.samples
        self._note(self._track.advance(end_ns, heard), points.time_ns.size - 1, samples.now.size)

    def _stops(self) -> NDArray[np.intp]:
        block, late = self._block, self._late()
        rung, place = self._course.rung[block.carried :], block.points.place[block.carried :]
        changed = np.flatnonzero(np.diff(rung, prepend=np.int8(self._track.rung)))
        # A lost input has returned at the next point.
        returned = np.searchsorted(place, late)
        returned = returned[returned < place.size]
        lost = place[: int(self._track.stale)]
        return np.unique(
            np.concatenate([block.samples.jumps, place[changed], late, place[returned], lost])
        )

    def _late(self) -> NDArray[np.intp]:
        """The samples before which an input was lost."""
        samples, inputs = self._block.samples, self._block.inputs
        if all(each.calm for each in inputs):
            return _NOWHERE
        begins = np.append(np.int64(self._track.start_ns or 0), samples.now[samples.jumps])
        edges = np.diff([0, *samples.jumps.tolist(), samples.now.size])
        late = np.zeros(samples.now.size, dtype=bool)
        for each, settings in zip(inputs, (self._config.speed, self._config.load), strict=True):
            # An input waits from the beginning, or for as long as its last sample counts.
            until = np.repeat(begins, edges) + settings.timeout_ns
            if each.until.size:
                before = each.place - each.own
                until = np.where(before >= each.since, each.until[before], until)
            late |= samples.now > until
        return np.flatnonzero(late)

    def _visit(self, i: int) -> None:
        block = self._block
        now, k, stretch = int(block.samples.now[i]), block.point_at(i), block.stretch(i)
        if stretch and block.samples.jumps[stretch - 1] == i:
            self._track.restart(now)
        else:
            heard = [each.before(i) for each in block.inputs]
            self._note(self._track.advance(now, heard), k - 1, i)
        if k < block.points.time_ns.size and block.points.place[k] == i:
            self._note(self._track.apply(int(self._course.rung[k]), now), k, i)

    def _note(self, changes: list[ConditionChange], k: int, i: int) -> None:
        self.changes += [(change, k, self._block.stretch(i)) for change in changes]


def _paired(
    config: BearingConfig, samples: _Arrived, inputs: Sequence[_OfInput]
) -> NDArray[np.intp]:
    """The samples at which both inputs are young enough to make an operating point."""
    if all(each.calm for each in inputs):
        return np.arange(samples.now.size)
    paired = np.ones(samples.now.size, dtype=bool)
    for each, settings in zip(inputs, (config.speed, config.load), strict=True):
        if not each.stamp.size:
            return _NOWHERE
        paired &= each.place >= each.since
        paired &= samples.now - each.stamp[each.place] <= settings.timeout_ns
    return np.flatnonzero(paired)


def _points(
    samples: _Arrived, inputs: Sequence[_OfInput], place: NDArray[np.intp], first: IntArray
) -> _Points:
    """The operating points that some samples make."""
    if not place.size:
        return _NO_POINTS
    rows = slice(None) if place.size == samples.now.size else place
    speed, load = inputs
    at, under = speed.place[rows], load.place[rows]
    return _Points(
        place=place,
        time_ns=samples.now[rows],
        speed=speed.value[at],
        load=load.value[under],
        future=speed.future[at],
        gap=np.maximum(speed.gap[at], load.gap[under]),
        ends=np.minimum(speed.ends[at], load.ends[under]),
        until=np.minimum(speed.until[at], load.until[under]),
        first=first,
    )


def _admit(
    config: BearingConfig, gate: SampleValidator, stream: Stream
) -> tuple[FloatArray, NDArray[np.int8]]:
    """SI value and status of every sample; counts go to the gate."""
    si = np.empty(stream.value.shape)
    status = np.zeros(stream.value.shape, dtype=np.int8)
    in_order, latest = True, list(gate.last_ns)
    for is_load, settings in enumerate((config.speed, config.load)):
        own = np.flatnonzero(stream.is_load == bool(is_load))
        si[own] = values = to_si(settings, stream.value[own])
        stamps, before = stream.time_ns[own], latest[is_load]
        faults = value_faults(settings, values)
        if faults.any():
            status[own] = faults
            stamps = stamps[faults == Status.ACCEPTED]
        if stamps.size:
            late = (stamps[1:] <= stamps[:-1]).any()
            in_order = in_order and not late and (before is None or stamps[0] > before)
            latest[is_load] = int(stamps[-1])
    if in_order:
        gate.last_ns = latest
        kinds = stream.is_load * np.int8(len(Status)) + status
        gate.counts += np.bincount(kinds, minlength=gate.counts.size).reshape(gate.counts.shape)
    else:
        rows = np.column_stack([stream.is_load, stream.time_ns, status]).tolist()
        status[:] = [
            gate.admit(is_load, time_ns, Status(fault)) for is_load, time_ns, fault in rows
        ]
    return si, status


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
    window = TrendWindow(config.alarm.trend_window_ns)
    window.fill(time_ns[rows], points.speed[rows], points.load[rows])
    return window.trend(config)
