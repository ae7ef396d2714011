# SPDX-License-Identifier: Apache-2.0
"""Reduces the verdicts on a recording: to few with the extremes of all, to worst moments, to intervals.

An interval is the time between two changes of the alarm.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stickslip_monitor.arrays import BoolArray, FloatArray, IndexArray, IntArray
from stickslip_monitor.monitor.assessment import COVER, REGIMES, Assessment, Assessments, Regime, assess
from stickslip_monitor.monitor.parameters import BearingConfig
from stickslip_monitor.monitor.rule_over_arrays import Scan
from stickslip_monitor.monitor.severity import LADDER, Condition
from stickslip_monitor.monitor.statements import Event
from stickslip_monitor.physics.boundary_table import boundary_table
from stickslip_monitor.physics.lubrication import as_measured

# Groups of rows at most; of each up to eleven rows stay in an outline.
_MAX_GROUPS = 600
_MARGINS = 'hopf_margin', 'fold_margin'
_STABLE, _BISTABLE, _UNSTABLE = map(REGIMES.index, (Regime.STABLE, Regime.BISTABLE, Regime.UNSTABLE))
_NO_CODES = np.array([], np.int8)
_SEVERITY = (Condition.NORMAL, Condition.INPUT_STALE, *LADDER[1:])


@dataclass(frozen=True, slots=True)
class Outline:
    """Some of the n verdicts on a recording, which says of each what :class:`Scan` does."""

    time_ns: IntArray
    until_ns: IntArray
    assessment: Assessments
    sticking: BoolArray
    events: Sequence[Event]


Verdicts = Scan | Outline
"""What is drawn and reported of a bearing: all its verdicts, or their outline."""


_ROW = np.dtype(
    [
        ('number', np.int64),  # which point of the recording it is
        ('time_ns', np.int64),
        ('until_ns', np.int64),  # how long it counts
        ('speed', np.float64),  # of the surface [m/s]
        ('load', np.float64),  # [N]
        ('water', np.float64),  # its temperature [C]
        ('sticking', np.bool_),
        ('opens', np.bool_),  # whether the line is interrupted before it
        ('scores', np.float64, 5),  # whose extremes stay; nan for none
    ]
)
"""A point that may stay."""


class OutlineBuilder:
    """Follows a bearing and keeps the outline of its verdicts.

    The points are taken in stretches of one length, which doubles when they become too many. Of
    each stay those with the least and the greatest speed, load, margins and predicted amplitude,
    and the first one before which the line is interrupted.
    """

    def __init__(self, config: BearingConfig) -> None:
        self._config = config
        self._count = 0
        self._length = 1
        self._rows = np.empty(0, _ROW)
        self._events: list[Event] = []
        self._last: tuple[int, int] | None = None

    def add_scan(self, scan: Scan) -> None:
        """Take the next verdicts: keep their events, and rows that may be extreme; lengthen the groups."""
        self._events += scan.events
        if not scan.time_ns.size:
            return
        rows = self._make_rows(scan)
        self._count += rows.size
        while self._count > _MAX_GROUPS * self._length:
            self._length *= 2
        rows = np.concatenate([self._rows, self._thin_rows(rows)])
        self._rows = self._thin_rows(rows) if rows.size > 24 * _MAX_GROUPS else rows

    def _make_rows(self, scan: Scan) -> NDArray[np.void]:
        """Return the verdicts of a scan, at least one, as rows; store time and end of its last one."""
        points, time = scan.assessment, scan.time_ns
        amplitude = np.full(time.size, np.nan)
        sticking = np.flatnonzero(scan.sticking)
        amplitude[sticking] = points.at(sticking).amplitude
        # The line is interrupted where an input was lost or the clock jumped back.
        before, ends = self._last or (int(time[0]), int(time[0]))
        self._last = int(time[-1]), int(scan.until_ns[-1])
        opens = np.append(ends, scan.until_ns[:-1]) < time
        opens |= time < np.append(before, time[:-1])
        margins = [
            np.where(np.isfinite(margin), margin, np.nan)
            for margin in (points.hopf_margin, points.fold_margin)
        ]
        rows = np.empty(time.size, _ROW)
        rows['number'] = self._count + np.arange(time.size)
        rows['time_ns'], rows['until_ns'] = time, scan.until_ns
        rows['speed'], rows['load'], rows['water'] = points.speed, points.load, scan.water
        rows['sticking'], rows['opens'] = scan.sticking, opens
        rows['scores'] = np.stack([np.abs(points.speed), points.load, *margins, amplitude], -1)
        return rows

    def _thin_rows(self, rows: NDArray[np.void]) -> NDArray[np.void]:
        """Return the extreme rows of each group and its first after an interruption, in order.

        The first and the last row of all stay. Groups of one row are returned as they are.
        """
        if self._length == 1 or not rows.size:
            return rows
        starts = self._group_starts(rows)
        rows_kept = [np.array([0, rows.size - 1]), _first_chosen(rows['opens'], starts)]
        for column in rows['scores'].T:
            for score in (column, -column):
                score = np.where(np.isnan(score), -np.inf, score)
                highest = np.repeat(np.maximum.reduceat(score, starts), np.diff([*starts, score.size]))
                rows_kept.append(_first_chosen((score == highest) & (score > -np.inf), starts))
        return rows[np.unique(np.concatenate(rows_kept))]

    def _group_starts(self, rows: NDArray[np.void]) -> IndexArray:
        """Return the index of the first row of each group, ascending; empty without rows."""
        return np.flatnonzero(np.diff(rows['number'] // self._length, prepend=-1))

    def build(self) -> Outline:
        """Return the outline of all verdicts taken so far; if they are few, all of them."""
        config = self._config
        rows = self._thin_rows(self._rows)
        water = None if config.water_temperature is None else rows['water']
        assessed = assess(config.bearing, rows['speed'], rows['load'], config.belief, temperature=water)
        return Outline(rows['time_ns'], self._valid_until(rows), assessed, rows['sticking'], self._events)

    def _valid_until(self, rows: NDArray[np.void]) -> IntArray:
        """Return until when each row counts, shape (n,) [ns].

        It counts up to the next row; the last row, and one before an interruption, only as long as its own
        verdict did.
        """
        time, until = rows['time_ns'], rows['until_ns'].copy()
        opens = _first_chosen(rows['opens'], self._group_starts(rows))
        before = opens[opens > 0] - 1
        interrupted = np.minimum(until[before], time[before + 1] - 1)
        until[:-1] = np.maximum(time[1:], time[:-1])
        until[before] = interrupted
        return until


def _first_chosen(chosen: BoolArray, starts: NDArray[np.intp]) -> IndexArray:
    """Return the index of the first chosen row of each group that has one, ascending.

    Args:
        chosen: Which rows are chosen, shape (n,).
        starts: Index of the first row of each group, ascending.
    """
    places = np.flatnonzero(chosen)
    owner = np.searchsorted(starts, places, 'right')
    return places[np.flatnonzero(np.diff(owner, prepend=0))]


@dataclass(frozen=True, slots=True)
class ConditionInterval:
    """A stretch of time in one condition [ns]."""

    start_ns: int
    end_ns: int
    condition: Condition

    @property
    def seconds(self) -> float:
        """Length [s]; 0 where the clock jumped back in it."""
        return max(0, self.end_ns - self.start_ns) * 1e-9


def condition_intervals(events: Iterable[Event], start_ns: int, end_ns: int) -> list[ConditionInterval]:
    """Return the intervals of a recording, from the changes of its alarm.

    Args:
        events: The changes of one bearing's alarm, in order.
        start_ns: When the recording begins [ns]; the condition is normal from then on.
        end_ns: When it ends [ns].

    Returns:
        The intervals in order; the first is of no length where the first change is at the start.
    """
    changes = [(start_ns, Condition.NORMAL), *((e.time_ns, e.after) for e in events)]
    ends = [*(time_ns for time_ns, _ in changes[1:]), end_ns]
    return [
        ConditionInterval(begin, end, condition)
        for (begin, condition), end in zip(changes, ends, strict=True)
    ]


def coarsen_intervals(parts: Sequence[ConditionInterval], max_count: int) -> list[ConditionInterval]:
    """Merge intervals into at most some number, each with the worst condition in its time.

    Args:
        parts: Intervals that follow each other; at least one.
        max_count: The number of equal intervals the time is divided into.

    Returns:
        The intervals as they are if there are no more than ``max_count`` or they have no length; else one
        for each interval, with equal neighbours joined. Then one of no length at the very end does not count.
    """
    start, end = parts[0].start_ns, max(interval.end_ns for interval in parts)
    if len(parts) <= max_count or end <= start:
        return list(parts)
    worst = [Condition.NORMAL] * max_count
    for interval in parts:
        first = (interval.start_ns - start) * max_count // (end - start)
        last = -((start - interval.end_ns) * max_count // (end - start))
        for k in range(max(0, first), min(max_count, max(last, first + 1))):
            worst[k] = max(worst[k], interval.condition, key=_SEVERITY.index)
    edges = [start + (end - start) * k // max_count for k in range(max_count + 1)]
    intervals: list[ConditionInterval] = []
    for k, condition in enumerate(worst):
        begin = intervals.pop().start_ns if intervals and intervals[-1].condition is condition else edges[k]
        intervals.append(ConditionInterval(begin, edges[k + 1], condition))
    return intervals


def join_intervals(
    parts: Iterable[ConditionInterval], conditions: Collection[Condition]
) -> list[ConditionInterval]:
    """Return the intervals in any of some conditions, in order; adjacent ones are joined.

    A joined interval has the condition of its last part.
    """
    intervals: list[ConditionInterval] = []
    for interval in parts:
        if interval.condition not in conditions:
            continue
        if intervals and intervals[-1].end_ns == interval.start_ns:
            interval = ConditionInterval(intervals.pop().start_ns, interval.end_ns, interval.condition)
        intervals.append(interval)
    return intervals


def _outermost_points(speed: FloatArray, load: FloatArray) -> IndexArray:
    """Return indices of the points that no other equals or exceeds in both speed and load, ascending.

    Both have shape (n,). Of equal points the first counts. There must be one point at least.
    """
    order = np.lexsort((np.arange(speed.size), -load, -speed))
    heaviest = np.maximum.accumulate(load[order])
    return np.sort(order[np.append(True, heaviest[1:] > heaviest[:-1])])


@dataclass(frozen=True, slots=True)
class Extreme:
    """The worst value of a quantity in a recording, and the operating point it came from."""

    time_ns: int
    value: float  # a margin [-] or an amplitude [m]
    point: Assessment


class Extremes:
    """The time in each regime, the least margins, and the greatest amplitude while stick-slip is predicted.

    Few points are computed: those that may lie below a boundary, or have a lower margin than is known.

    Attributes:
        lasting_ns: How long each of :data:`REGIMES` lasted [ns].
        worst: The worst moments by name; a quantity that never had a value is absent.
    """

    def __init__(self) -> None:
        self.lasting_ns = np.zeros(len(REGIMES), np.int64)
        self.worst: dict[str, Extreme] = {}
        self._top: Assessments | None = None

    def take(self, scan: Scan) -> None:
        """Update the times in each regime, the least margins and the greatest amplitude by more verdicts."""
        if not scan.time_ns.size:
            return
        size, top = np.abs(scan.speed), self._heaviest_point(scan)
        # Beyond the highest boundaries a point is stable; but a fold that is not known has no end.
        limit = COVER * np.fmax(top.hopf_speed, top.fold_speed)
        if scan.config.water_temperature is not None:
            limit = np.full(1, np.inf)  # in other water a lighter point may have higher boundaries
        rows = np.flatnonzero(size <= np.where(np.isnan(top.fold_speed), np.inf, limit))
        codes = scan.assessed(rows).regime_code if rows.size else _NO_CODES
        lasting = scan.until_ns - scan.time_ns
        durations = sum_durations(codes, lasting[rows], len(REGIMES))
        durations[_STABLE] += lasting.sum() - durations.sum()
        self.lasting_ns += durations
        self._take_margins(scan, size, top)
        # A vibration that dies out beyond the fold has no amplitude any more. That of the exact cycle rises
        # with the load at one speed and, as a rule, with the speed at one load.
        rows = rows[scan.sticking[rows] & ((codes == _BISTABLE) | (codes == _UNSTABLE))]
        if rows.size:
            self._take_rows(scan, rows[_outermost_points(size[rows], scan.load[rows])], 'amplitude')

    def _heaviest_point(self, scan: Scan) -> Assessments:
        """Return a point at least as heavy as all of a scan, which has some, shape (1,); store it for later.

        The stored one is returned where it is up to 10 % heavier. Its boundaries are upper limits of theirs.
        Boundaries rise with the load but for the fold, which may fall again: here it is the highest of any
        load up to this.
        """
        max_load = scan.load.max()
        if self._top is None or not max_load <= self._top.load[0] <= 1.1 * max_load:
            top = scan.assessed(np.array([scan.load.argmax()]))
            table = boundary_table(as_measured(top.bearing))
            highest: Any = top.scale * table.highest_fold(top.load / top.scale)
            self._top = replace(top, fold_speed=highest)
        return self._top

    def _take_margins(self, scan: Scan, size: FloatArray, top: Assessments) -> None:
        """Update the least margins by the points that turn; ``size`` is the speed without its sign [m/s].

        ``top`` is a point at least as heavy as all of them: points faster than its boundaries need no
        margin. Points at rest are skipped: their margin of -1 would be the worst of every voyage.
        """
        if scan.config.water_temperature is not None:
            if size.any():
                self._take_rows(scan, np.flatnonzero(size), *_MARGINS)
            return
        rows = np.flatnonzero((size <= self._slow_limit(top)) & (size > 0.0))
        if rows.size:
            # With the margins of the slowest few others can have a lower one.
            self._take_rows(scan, rows[[size[rows].argmin()]], *_MARGINS)
            rows = rows[size[rows] <= self._slow_limit(top)]
        if rows.size:
            # The slower and the heavier point of two is nearer to the Hopf speed, which rises with the load.
            worst = _outermost_points(-size[rows], scan.load[rows])
            nearest = np.nan_to_num(size[rows] / scan.fold_speed(rows), nan=math.inf).argmin()
            self._take_rows(scan, rows[np.union1d(worst, nearest)], *_MARGINS)

    def _slow_limit(self, top: Assessments) -> FloatArray:
        """Return the speed above which no margin can be below the least found so far, shape (1,) [m/s].

        ``inf`` before any margin is found, ``nan`` where the point has no boundary.
        """
        margins = (self.worst[name].value if name in self.worst else math.inf for name in _MARGINS)
        ends = zip(margins, (top.hopf_speed, top.fold_speed), strict=True)
        slow: FloatArray = np.fmax.reduce([COVER * (1.0 + value) * boundary for value, boundary in ends])
        return slow

    def _take_rows(self, scan: Scan, rows: IndexArray, *names: str) -> None:
        """Update ``worst`` by the named quantities in rows of a scan: least margin, greatest amplitude."""
        points = scan.assessed(rows)
        for name in names:
            sign = -1 if name == 'amplitude' else 1
            values = getattr(points, 'amplitude_exact' if name == 'amplitude' else name)
            badness = np.where(np.isfinite(values), sign * values, np.inf)
            lowest = sign * self.worst[name].value if name in self.worst else math.inf
            if badness.min(initial=math.inf) < lowest:
                i = int(badness.argmin())
                self.worst[name] = Extreme(int(scan.time_ns[rows[i]]), float(values[i]), points.at(i))


def sum_durations(codes: NDArray[np.int8], lasting: IntArray, kinds: int) -> IntArray:
    """Return the total time [ns] of each code below ``kinds``, shape (kinds,).

    ``codes`` has the code of each point, ``lasting`` how long it counts [ns].
    """
    # Whole numbers below 2^53, as a stretch of months is, are added up without an error.
    return np.bincount(codes, lasting, minlength=kinds).astype(np.int64)
