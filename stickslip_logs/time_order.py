# SPDX-License-Identifier: Apache-2.0
"""Judges in which order a recording happened, by one rule for all formats.

Times come source by source in the order of the file. Where a source steps back, the reason decides: a
clock that was set shifts what follows, a jump ahead is closed, what came late is sorted. Parts that fit
together, and what steps back too often, are sorted as a whole.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from datetime import datetime, timezone
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stickslip_logs.arrays import BoolArray, IntArray
from stickslip_logs.errors import plural
from stickslip_logs.units import SECOND_NS

MAX_TIME_NS = 1 << 62
"""Of the year 2116: two later times would have no sum of 64 bits [ns]."""
EPOCH = datetime(1970, 1, 1, tzinfo=timezone.utc)
"""Time from which nanoseconds count."""
DATES_FROM_NS = 10**17
"""Of 1973: times from here on are dates, not time since a trigger or since something was switched on [ns]."""
# Smaller steps back are disorder, whatever the rate: they are sorted and not reported [ns]. Segments begin
# with this resolution, too.
_MIN_STEP_NS = SECOND_NS
# More steps back of one source are disorder: a loop played 10 times has 9, disorder of 2 s thousands.
_MAX_STEPS = 32
MAX_LATE_NS = 60 * SECOND_NS
"""Rows that come back after longer were not late: the clock was set back, and a pause followed. Rows of one
source that wait longer for their turn are reported as unordered [ns]."""
# Sources of which one waits longer for another are reported as unordered [ns].
_MAX_WAIT_NS = 10 * SECOND_NS
# What is kept of a source, so that memory is bounded: the first intervals, whose median is the usual one, and
# segments (64 bytes each), whose resolution is halved where there are twice as many.
_MAX_KEPT = 4096

Columns = tuple[NDArray[Any], ...]
"""Rows: times [ns], and what else there is of each: shape (n,) or (k, n)."""


Row = tuple[int, int, bytes]
"""A row as written: its source, its time [ns], and its content."""
ReadRows = Callable[[int, int, tuple[int, int]], Iterator[Row]]
"""Yields the rows from one place up to another whose times are in a span, first and last included [ns]."""


def select_rows(columns: Columns, rows: slice | IntArray | BoolArray) -> Columns:
    """Return the columns of some rows; with a slice these are views."""
    return tuple(column[..., rows] for column in columns)


class _Run(NamedTuple):
    """Rows of a source without a jump: place and number of the first, and the step into it [ns].

    Between them the times of the first and the last row, and the least and the largest of all [ns];
    ``last_place`` is the place of the last row.
    """

    place: int
    row: int
    first_ns: int
    last_ns: int
    least_ns: int
    most_ns: int
    step_ns: int
    last_place: int


class _Shift(NamedTuple):
    """Time to add [ns] to the rows of a source, or of all, from one place to another."""

    begin: int
    end: int
    source: int | None
    add_ns: int


class _Step(NamedTuple):
    """A step back of one source: where, by how much [ns], and behind which interval [ns].

    ``before_place`` is the place of its last row before the step.
    """

    place: int
    source: int
    before_place: int
    back_ns: int
    interval_ns: int

    def spans(self, before_place: int, place: int) -> bool:
        """Return whether rows of another source at both places may be on either side of it."""
        return max(self.before_place, before_place) < min(self.place, place)


_END: int = np.iinfo(np.int64).max


@dataclass
class TimeCourse:
    """Course of a recording: what to add to its times, and how long rows wait for their turn.

    Attributes:
        shifts: What to add to the times as written, as :meth:`correct_times` does.
        wait_ns: The longest that a row comes behind a later one [ns]; None where all have to be sorted.
        is_unordered: Whether rows were written in another order than they happened.
        steps_ns: By how much the clock was set back, each time [ns].
        ahead_count: Times that jumped ahead and came back.
        late_count: Rows that are written later or earlier than they belong, and are sorted.
        undated_count: Rows with times since something was switched on, before the clock was set to a date.
        start_ns: The first resulting time [ns], None where there is none.
        end_ns: The last resulting time [ns], likewise.
        gap_ns: The longest time without rows [ns], where it is far longer than all the rest; else 0.
    """

    shifts: list[_Shift] = field(default_factory=list)
    wait_ns: int | None = 0
    is_unordered: bool = False
    steps_ns: list[int] = field(default_factory=list)
    ahead_count: int = 0
    late_count: int = 0
    undated_count: int = 0
    start_ns: int | None = None
    end_ns: int | None = None
    gap_ns: int = 0

    def correct_times(self, time_ns: IntArray, source: IntArray, place: IntArray) -> IntArray:
        """Return the corrected times of rows [ns], shape (n,); the array itself where nothing is shifted.

        The source of each row is its number, and its place where it is in the file: numbers that rise.
        """
        if not self.shifts or not time_ns.size:
            return time_ns
        result = time_ns.copy()
        for shift in self.shifts:
            begin, end = place.searchsorted([shift.begin, shift.end]).tolist()
            if begin < end:
                is_own = source[begin:end] == shift.source if shift.source is not None else True
                result[begin:end] += shift.add_ns * np.asarray(is_own, np.int64)
        return result

    def move(self, add_ns: int) -> None:
        """Add a time to all resulting times [ns]; start and end have to be set."""
        self.shifts.append(_Shift(0, _END, None, add_ns))
        self.start_ns, self.end_ns = (self.start_ns or 0) + add_ns, (self.end_ns or 0) + add_ns

    def notes(self, subject: str, owner: str) -> Iterator[str]:
        """Yield warnings on the order of time; nothing where there is none to report.

        The subject is what was unordered, as in 'the lines are'; the owner whose clock was set, as in 'of the
        lines'.
        """
        if self.is_unordered:
            yield f'{subject} in no order of time: sorted by time'
        if self.steps_ns:
            count = 'once' if len(self.steps_ns) == 1 else f'{len(self.steps_ns)} times'
            yield (
                f'the clock {owner} was set back {count}, by {max(self.steps_ns) * 1e-9:.6g} s at most:'
                ' what follows is taken to go on behind what was before'
            )
        if self.ahead_count:
            times_text = plural(self.ahead_count, 'time')
            yield f'the clock {owner} leapt ahead and back: {times_text} taken from those beside'
        if self.undated_count:
            yield (
                f'the clock {owner} began at zero and was set to a date:'
                f' {plural(self.undated_count, "time")} before it taken to lead up to it'
            )
        if self.gap_ns and self.start_ns is not None and self.end_ns is not None:
            rest_ns = self.end_ns - self.start_ns - self.gap_ns
            yield (
                f'the times {owner} have a gap of {self.gap_ns / 86_400e9:.4g} days, and last'
                f' {rest_ns * 1e-9:.4g} s without it: one may be wrong'
            )


class _Source:
    """Segments of one source, stretches of rows without a jump: all that is kept of its times.

    Args:
        is_in_blocks: As for :class:`TimeOrder`.
    """

    def __init__(self, *, is_in_blocks: bool) -> None:
        self._is_in_blocks = is_in_blocks
        self._intervals = np.empty(0, np.int64)
        self._parts, self._size = [np.empty((0, len(_Run._fields)), np.int64)], 0
        self._jump_ns = _MIN_STEP_NS
        self._resolution_ns = _MIN_STEP_NS
        self._last_ns: int | None = None
        self._count = self._steps = 0
        self.least_ns, self.most_ns = _END, -1

    def add(self, time_ns: IntArray, place: IntArray, offset: int) -> tuple[int, int]:
        """Add the next rows of the source, at least one; ``offset`` is added to their places.

        Returns:
            The least and the largest of the times [ns].
        """
        step = np.empty(time_ns.size, np.int64)
        np.subtract(time_ns[1:], time_ns[:-1], out=step[1:])
        step[0] = 0 if self._last_ns is None else time_ns[0] - self._last_ns
        if self._intervals.size < _MAX_KEPT:
            self._intervals = np.append(self._intervals, np.abs(step[step != 0]))[:_MAX_KEPT]
            self._jump_ns = max(self._jump_ns, self.jump_ns)
        if self._is_one_segment(time_ns, step):
            first, last = int(time_ns[0]), int(time_ns[-1])
            places = int(place[0]) + offset, int(place[-1]) + offset
            segments = np.array([[places[0], self._count, first, last, first, last, step[0], places[1]]])
        else:
            self._steps += int(np.count_nonzero(step < -_MIN_STEP_NS))
            begin = np.flatnonzero(self._begins_segment(step, time_ns))
            ends_ns = (extreme.reduceat(time_ns, begin) for extreme in (np.minimum, np.maximum))
            end = np.append(begin[1:], time_ns.size) - 1
            where = place[begin] + offset, begin + self._count, time_ns[begin], time_ns[end]
            parts = *where, *ends_ns, step[begin], place[end] + offset
            segments = np.stack(parts, axis=1)
        self._last_ns = int(time_ns[-1])
        self._count += time_ns.size
        span = int(segments[:, 4].min()), int(segments[:, 5].max())
        self.least_ns, self.most_ns = min(span[0], self.least_ns), max(span[1], self.most_ns)
        if self._steps <= _MAX_STEPS:
            self._parts.append(segments)
            self._size += len(segments)
            while self._size > 2 * _MAX_KEPT:
                self._halve_resolution()
        return span

    def _is_one_segment(self, time_ns: IntArray, step_ns: IntArray) -> bool:
        """Return whether rows make one segment: they neither step back nor jump, nor leave a cell of time.

        ``step_ns`` is the step into each of the n > 0 rows, the first one too. Of rows that come in blocks a
        segment may have more than one cell.
        """
        if step_ns.min() < 0 or step_ns.max() > self._jump_ns:
            return False
        cells = time_ns[[0, -1]] // self._resolution_ns
        return self._is_in_blocks or bool(cells[0] == cells[1])

    def _begins_segment(self, step_ns: IntArray, time_ns: IntArray) -> BoolArray:
        """Return which rows, or segments to be joined, begin a segment, shape (n,).

        The first does, and those behind a jump or in another cell of time than the one before. ``step_ns`` is
        the step into each of the n > 0 rows, ``time_ns`` its first time [ns].
        """
        cell = time_ns // self._resolution_ns
        begins: BoolArray = _is_jump(step_ns, self._jump_ns) | (np.diff(cell, prepend=cell[0]) != 0)
        begins[0] = True
        return begins

    def _halve_resolution(self) -> None:
        """Join segments to cells of twice the length, to halve the memory; shorter jumps are forgotten."""
        self._resolution_ns *= 2
        self._jump_ns = max(self._jump_ns, self._resolution_ns // 4)
        segments = self.segments
        begins = self._begins_segment(segments[:, 6], segments[:, 2])
        self._parts = [_join_segments(segments, np.flatnonzero(begins))]
        self._size = len(self._parts[0])

    @property
    def interval_ns(self) -> int:
        """The usual time between two rows that differ in it [ns]; 0 where none do."""
        return int(np.median(self._intervals)) if self._intervals.size else 0

    @property
    def jump_ns(self) -> int:
        """Limit of a step forward [ns]: longer ones are jumps, or pauses."""
        return max(_MIN_STEP_NS, 5 * self.interval_ns // 2)

    @property
    def has_many_steps(self) -> bool:
        """Whether it steps back more often than clocks are set: more than 32 times, or a quarter of few rows.

        Two steps back are never too many.
        """
        allowed = max(2, 0.25 * self._count)
        return self._steps > min(allowed, _MAX_STEPS)

    @property
    def segments(self) -> IntArray:
        """Its segments in the order of the file, a row of the fields of :class:`_Run` each, shape (k, 8)."""
        self._parts = [np.concatenate(self._parts)]
        return self._parts[0]

    def runs(self) -> list[_Run]:
        """Return the runs of rows between jumps, each with the step that led into it.

        They are in the order of the file, the step into the first is 0. Without rows the list is empty.
        """
        segments = self.segments
        is_first = _is_jump(segments[:, 6], self.jump_ns)
        is_first[:1] = True
        runs = _join_segments(segments, np.flatnonzero(is_first)) if len(segments) else segments
        return [_Run(*values) for values in runs.tolist()]


def _is_jump(step_ns: IntArray, jump_ns: int) -> BoolArray:
    """Return which steps go back by more than 1 s, or ahead by more than a limit [ns], shape (n,)."""
    result: BoolArray = (step_ns < -_MIN_STEP_NS) | (step_ns > jump_ns)
    return result


def _join_segments(segments: IntArray, begin: IntArray) -> IntArray:
    """Join segments, each from one of the rising indexes ``begin`` up to the next; return them in order.

    Steps and first rows are those of the first segment of each; the first index is 0.
    """
    result = segments[begin]
    last = np.append(begin[1:], len(segments)) - 1
    result[:, 3], result[:, 7] = segments[last, 3], segments[last, 7]
    result[:, 4] = np.minimum.reduceat(segments[:, 4], begin)
    result[:, 5] = np.maximum.reduceat(segments[:, 5], begin)
    return result


class TimeOrder:
    """Collects the times of a recording by source, and judges their order.

    Args:
        is_in_blocks: Whether rows come in blocks that their reader sorts, and need not wait for their turn:
            then those of one call of :meth:`add_to` are one segment, unless they step back or jump.
    """

    def __init__(self, *, is_in_blocks: bool = False) -> None:
        self._is_in_blocks = is_in_blocks
        self._sources: dict[int, _Source] = {}

    def add(self, time_ns: IntArray, source: IntArray, place: IntArray) -> None:
        """Add the next rows in the order of the file, at least one.

        Their places are where they are in the file: numbers that rise.
        """
        if (source == source[0]).all():
            self.add_to(int(source[0]), time_ns, place)
            return
        for key in np.unique(source).tolist():
            rows = source == key
            self.add_to(key, time_ns[rows], place[rows])

    def add_to(self, source: int, time_ns: IntArray, place: IntArray, offset: int = 0) -> tuple[int, int]:
        """Add the next rows of one source, at least one; return their least and largest time [ns].

        The offset is added to their places.
        """
        if source not in self._sources:
            self._sources[source] = _Source(is_in_blocks=self._is_in_blocks)
        return self._sources[source].add(time_ns, place, offset)

    def judge(self, read_rows: ReadRows | None = None) -> TimeCourse:
        """Judge the order of all sources; return the course, an empty one without rows.

        Args:
            read_rows: Reads rows again, as written; its errors go through. With it rows behind a step that
                are a copy of earlier ones make no clock that was set: all are to be sorted by the times as
                written. None to look for no copies.
        """
        sources, course = self._sources, TimeCourse()
        if not sources:
            return course
        if any(s.has_many_steps for s in sources.values()) or not _explain_steps(course, sources):
            course = TimeCourse(wait_ns=None, is_unordered=True)
            course.start_ns = min(segments.least_ns for segments in sources.values())
            course.end_ns = max(segments.most_ns for segments in sources.values())
            return course
        steps = [shift.begin for shift in course.shifts if shift.end == _END]
        are_copies = (
            bool(steps)
            and read_rows is not None
            and all(_begins_copy(read_rows, place, _span_before(place, sources.values())) for place in steps)
        )
        if are_copies:
            course = TimeCourse()
        _measure_wait(course, sources)
        course.is_unordered |= are_copies
        return course


def _span_before(place: int, sources: Iterable[_Source]) -> tuple[int, int]:
    """Return the first and the last time of the rows before a place, of which there are some [ns]."""
    segments = np.concatenate([source.segments for source in sources])
    segments = segments[segments[:, 0] < place]
    return int(segments[:, 4].min()), int(segments[:, 5].max())


def _begins_copy(read_rows: ReadRows, begin: int, span_ns: tuple[int, int]) -> bool:
    """Return whether rows from a place on are a copy of earlier ones, as of files that overlap.

    Of the first 100 rows with times in ``span_ns``, that of the earlier rows, each that meets earlier ones of
    its source and time must equal one, and three different ones must: a clock that was set back does not see
    the same again.
    """
    rows = list(itertools.islice(read_rows(begin, _END, span_ns), 100))
    times_ns = [time_ns for _, time_ns, _ in rows]
    earlier = set(read_rows(0, begin, (min(times_ns, default=0), max(times_ns, default=0))))
    earlier_times = {row[:2] for row in earlier}
    repeated = {row for row in rows if row[:2] in earlier_times}
    # A shaft at rest repeats its numbers.
    return repeated <= earlier and len({content for *_, content in repeated}) >= 3


def _explain_steps(course: TimeCourse, sources: dict[int, _Source]) -> bool:
    """Explain all steps back of sources by clocks that were set, jumps ahead and late rows.

    Fills in shifts, steps and counts of the course. Returns False, with the course half filled, where rows
    have to be sorted instead.
    """
    max_jump_ns = max(source.jump_ns for source in sources.values())
    runs = {key: _shift_undated_runs(course, key, source) for key, source in sources.items()}
    if any(run.last_ns < run.first_ns - _MIN_STEP_NS for source_runs in runs.values() for run in source_runs):
        return False
    if all(_fit_together(source_runs, max_jump_ns) for source_runs in runs.values()):
        return True
    # What is a step of one source is none of late rows in another.
    alone = _steps_back(sources, {k: _close_excursions(TimeCourse(), k, sources[k], runs[k]) for k in runs})
    open_runs = {k: _close_excursions(course, k, sources[k], runs[k], alone) for k in runs}
    steps = _steps_back(sources, open_runs)
    fits = all(_fit_together(source_runs, max_jump_ns) for source_runs in open_runs.values())
    back_ns = [[-run.step_ns for run in source_runs if run.step_ns < 0] for source_runs in open_runs.values()]
    if (steps and fits) or any(map(_are_disorder, back_ns)):
        return False
    _shift_behind_steps(course, sources, runs, steps)
    latest_ns = max(source.most_ns for source in sources.values())
    return latest_ns + sum(course.steps_ns) < MAX_TIME_NS or not course.steps_ns


def _steps_back(sources: dict[int, _Source], open_runs: dict[int, list[_Run]]) -> list[_Step]:
    """Return the steps back between the runs of each source, in the order of the file."""
    steps = list[_Step]()
    for key, source_runs in open_runs.items():
        for before, behind in itertools.pairwise(source_runs):
            interval_ns = sources[key].interval_ns
            back_ns = before.last_ns + interval_ns - behind.first_ns
            if behind.step_ns < 0:
                steps.append(_Step(behind.place, key, before.last_place, back_ns, interval_ns))
    return sorted(steps)


def _shift_undated_runs(course: TimeCourse, key: int, source: _Source) -> list[_Run]:
    """Return the runs of a source; if the last are dates, shift those before 1973 to end where dates begin.

    Their clock counted from zero until it was set. Shifts, of the source with the number ``key``, and their
    count are added to the course.
    """
    runs = source.runs()
    if not runs or runs[-1].first_ns < DATES_FROM_NS:
        return runs
    for k in reversed(range(len(runs) - 1)):
        run, behind = runs[k], runs[k + 1]
        if run.most_ns < DATES_FROM_NS:
            is_pause = 0 < behind.step_ns < DATES_FROM_NS // 2
            step_ns = behind.step_ns if is_pause else source.interval_ns
            add_ns = behind.first_ns - step_ns - run.last_ns
            times_ns = (time_ns + add_ns for time_ns in run[2:6])
            runs[k : k + 2] = [
                run._replace(**dict(zip(_Run._fields[2:6], times_ns, strict=True))),
                behind._replace(step_ns=step_ns),
            ]
            course.shifts.append(_Shift(run.place, behind.place, key, add_ns))
            course.undated_count += behind.row - run.row
    return runs


def _are_disorder(back_ns: Sequence[int]) -> bool:
    """Return whether steps back [ns] are more than four below 10 s each: no clock that was set."""
    return len(back_ns) > 4 and max(back_ns) < _MAX_WAIT_NS


def _fit_together(runs: Sequence[_Run], jump_ns: int) -> bool:
    """Return whether runs, put in order of time, leave no overlap above 1 s, no pause above ``jump_ns``."""
    spans = sorted((run.least_ns, run.most_ns) for run in runs)
    seams = (behind[0] - before[1] for before, behind in itertools.pairwise(spans))
    return all(-_MIN_STEP_NS <= seam <= jump_ns for seam in seams)


def _close_excursions(
    course: TimeCourse, key: int, source: _Source, runs: Sequence[_Run], steps: Sequence[_Step] = ()
) -> list[_Run]:
    """Join runs around those that were ahead for a while or late; add the shifts and counts to the course.

    A first row alone that is ahead of those behind it, as a damaged one is, leads up to them. The runs are
    those of a source with the number ``key``, in order. A step back between two of the returned runs is still
    to be explained. Rows behind one of ``steps``, by which the clock of another source was set, are not late.
    """
    result: list[_Run] = []
    other_steps = [step for step in steps if step.source != key]
    lone, run = runs[0], runs[min(1, len(runs) - 1)]
    is_set = any(step.spans(lone.last_place, run.place) for step in other_steps)
    if run.row == 1 and run.step_ns < 0 and run.first_ns < run.last_ns and not is_set:
        first_ns = run.first_ns - source.interval_ns
        course.shifts.append(_Shift(lone.place, run.place, key, first_ns - lone.first_ns))
        course.ahead_count += 1
        runs = [run._replace(place=lone.place, first_ns=first_ns, least_ns=first_ns, step_ns=0), *runs[2:]]
    for run in runs:
        while len(result) > 1:
            before, excursion = result[-2:]
            is_set = any(step.spans(before.last_place, excursion.place) for step in other_steps)
            is_late = _is_late(before, excursion, run, source) and not is_set
            if is_late or _is_early(before, excursion, run, source):
                course.late_count += run.row - excursion.row
                most_ns = max(before.most_ns, excursion.most_ns)
            elif _is_ahead(before, excursion, run, source):
                add_ns = (before.last_ns + run.first_ns - excursion.first_ns - excursion.last_ns) // 2
                course.shifts.append(_Shift(excursion.place, run.place, key, add_ns))
                course.ahead_count += run.row - excursion.row
                most_ns = before.most_ns
            else:
                break
            del result[-2:]
            run = before._replace(
                last_ns=max(before.last_ns, run.last_ns),
                last_place=run.last_place,
                least_ns=min(before.least_ns, run.least_ns),
                most_ns=max(most_ns, run.most_ns),
            )
        result.append(run)
    return result


def _is_ahead(before: _Run, excursion: _Run, run: _Run, source: _Source) -> bool:
    """Return whether the middle one of three adjacent runs jumped ahead, and the last continues the first."""
    passed_ns = excursion.last_ns - excursion.first_ns + 2 * source.interval_ns
    error_ns = run.first_ns - before.last_ns - passed_ns
    return run.step_ns < 0 < excursion.step_ns and abs(error_ns) <= source.jump_ns + source.interval_ns


def _is_late(before: _Run, excursion: _Run, run: _Run, source: _Source) -> bool:
    """Return whether the middle one of three adjacent runs is late rows, and the last continues the first."""
    gap_ns = run.first_ns - before.last_ns
    is_brief = excursion.last_ns - excursion.first_ns <= MAX_LATE_NS
    has_returned = -_MIN_STEP_NS <= gap_ns <= source.jump_ns + source.interval_ns
    return excursion.step_ns < 0 < run.step_ns and is_brief and has_returned


def _is_early(before: _Run, excursion: _Run, run: _Run, source: _Source) -> bool:
    """Return whether the middle one of three adjacent runs is early rows, and the last continues the first.

    They leave no gap from where they come too early.
    """
    is_soon = excursion.last_ns - run.first_ns <= MAX_LATE_NS
    gap_ns = run.first_ns - before.last_ns
    return run.step_ns < 0 < excursion.step_ns and is_soon and 2 * gap_ns <= 3 * source.interval_ns


def _shift_behind_steps(
    course: TimeCourse, sources: dict[int, _Source], runs: dict[int, list[_Run]], steps: list[_Step]
) -> None:
    """Add a shift for each step back: of all sources if all that can show it step, else of that one.

    Sources that are silent meanwhile, and slow ones, cannot show it. Shifts and steps are added to the
    course; the list of steps, in the order of the file, is emptied.
    """
    while steps:
        same = {
            step.source: step for step in reversed(steps) if steps[0].spans(step.before_place, step.place)
        }
        group = sorted(same.values())
        steps[:] = [step for step in steps if step not in group]
        place, fastest_ns = group[0].place, min(step.interval_ns for step in group)
        # Slow sources know the step to one of their intervals only; a lost row, or a pause, makes it smaller.
        back_ns = max(step.back_ns - step.interval_ns * (step.interval_ns > 2 * fastest_ns) for step in group)
        voices = {
            key
            for key, source_runs in runs.items()
            if sources[key].interval_ns <= back_ns // 2
            and any(run.place < place <= run.last_place for run in source_runs)
        }
        if voices <= same.keys():
            course.shifts.append(_Shift(place, _END, None, back_ns))
            course.steps_ns.append(back_ns)
        else:
            course.shifts += [_Shift(step.place, _END, step.source, step.back_ns) for step in group]
            course.steps_ns += [step.back_ns for step in group]


def _measure_wait(course: TimeCourse, sources: dict[int, _Source]) -> None:
    """Set start, end, longest gap, and how long rows wait for their turn, in the course.

    Also set whether its rows are unordered: they would wait too long (``wait_ns`` says how long), and none of
    them was late. Times are those that its shifts give, which must be complete, as the count of late rows.
    """
    parts, own_late_ns = [], 0
    for key, times_of_source in sources.items():
        segments = times_of_source.segments
        source = np.full(len(segments), key)
        first_ns, last_ns = (course.correct_times(segments[:, k], source, segments[:, 0]) for k in (4, 5))
        parts.append(np.stack([segments[:, 0], first_ns, last_ns], axis=1))
        own_late_ns = max(own_late_ns, _longest_delay(parts[-1][:-1, 2], parts[-1][1:, 1]))
    segments = np.concatenate(parts)
    segments = segments[segments[:, 0].argsort(kind='stable')]
    course.start_ns, course.end_ns = int(segments[:, 1].min()), int(segments[:, 2].max())
    by_time = segments[segments[:, 1].argsort()]
    gap_ns = int((by_time[1:, 1] - np.maximum.accumulate(by_time[:-1, 2])).max(initial=0))
    # One time read wrong at an end makes a year of lost inputs.
    if gap_ns > max(86_400 * SECOND_NS, 10 * (course.end_ns - course.start_ns - gap_ns)):
        course.gap_ns = gap_ns
    late_ns = _longest_delay(segments[:, 2], segments[:, 1])
    course.wait_ns = late_ns + _MIN_STEP_NS
    # Segments of two sources overlap in the file: what is late within them is not known.
    blur_ns = 2 * int((segments[:, 2] - segments[:, 1]).max()) + _MIN_STEP_NS
    is_waiting = own_late_ns > MAX_LATE_NS or late_ns - own_late_ns - blur_ns > _MAX_WAIT_NS
    course.is_unordered = is_waiting and not course.late_count


def _longest_delay(before_ns: IntArray, time_ns: IntArray) -> int:
    """Return by how much a time is behind the latest of ``before_ns`` up to it at most [ns]; 0 if none is."""
    return int((np.maximum.accumulate(before_ns) - time_ns).max(initial=0))


class Sorter:
    """Sorts rows by time while they come; each waits for its turn.

    Args:
        wait_ns: How far behind a later row one may come [ns]; None where all wait until the last has come.
    """

    def __init__(self, wait_ns: int | None) -> None:
        self._wait_ns = wait_ns
        self._waiting: list[Columns] = []

    def add(self, columns: Columns) -> Iterator[Columns]:
        """Add rows (columns, times [ns] first), and yield those that no later row can precede, sorted.

        Takes effect only as the iterator is read. Nothing is yielded where all rows wait for :meth:`rest`.
        """
        self._waiting.append(columns)
        if self._wait_ns is None:
            return
        columns = self._sort_waiting()
        count = int(columns[0].searchsorted(int(columns[0][-1]) - self._wait_ns)) if columns[0].size else 0
        self._waiting = [select_rows(columns, slice(count, None))]
        if count:
            yield select_rows(columns, slice(count))

    def rest(self) -> Iterator[Columns]:
        """Yield the rows that still wait, sorted, as one part, if any; call it once, when all were added."""
        if self._waiting and (columns := self._sort_waiting())[0].size:
            yield columns

    def _sort_waiting(self) -> Columns:
        """Return the waiting parts, at least one, joined and sorted by time; equal times stay in order.

        They still wait.
        """
        columns = tuple(np.concatenate(arrays, axis=-1) for arrays in zip(*self._waiting, strict=True))
        if (columns[0][1:] >= columns[0][:-1]).all():
            return columns
        return select_rows(columns, columns[0].argsort(kind='stable'))
