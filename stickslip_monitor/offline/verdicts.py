# SPDX-License-Identifier: Apache-2.0
"""The verdicts on a checked bag as messages, the same as the node publishes, beside its inputs.

The bag is followed once more, and what each stretch of it gives is handed on in order of time, so
memory does not grow with the recording.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from enum import Enum
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stickslip_monitor.arrays import IntArray
from stickslip_monitor.bags.encode import (
    MESSAGE_TYPES,
    StatusFields,
    encode_diagnostics,
    encode_float64s,
    encode_string,
)
from stickslip_monitor.bags.values import Payload, TimeSpans
from stickslip_monitor.bags.writer import BagWriter
from stickslip_monitor.errors import BagError
from stickslip_monitor.monitor.assessment import (
    COLUMNS,
    REGIMES,
    Assessment,
    at_index,
    at_indices,
)
from stickslip_monitor.monitor.config import BearingConfig, LevelConfig, MonitorConfig
from stickslip_monitor.monitor.decision import QUIET, Standing
from stickslip_monitor.monitor.ladder import Condition
from stickslip_monitor.monitor.measured import MEASURED, Measured, Unknown, said_at
from stickslip_monitor.monitor.messages import (
    BearingState,
    LevelState,
    diagnostic_record,
    event_json,
    output_topics,
    verdict_numbers,
)
from stickslip_monitor.monitor.scan import LatestPoint, Scan
from stickslip_monitor.monitor.signals import QUANTITIES, Status
from stickslip_monitor.monitor.trend import Trend, TrendWindow, may_cross
from stickslip_monitor.monitor.verdict import Event, describe
from stickslip_monitor.offline.check import CheckReport
from stickslip_monitor.offline.follow import BearingBlock, follow

NODE = 'stickslip_monitor'
_TICK_NS = 10**9
_SILENCE_NS = 3600 * 10**9
# Evaluations whose messages are laid out at a time.
_SLICE = 1 << 14
_NEVER = -(1 << 63)
_ALWAYS = TimeSpans([(0, (1 << 63) - 1)])


class MessageColumn(NamedTuple):
    """Messages of one topic: n log times [ns], and as many messages in CDR."""

    topic: str
    type: str
    time_ns: IntArray
    payload: Payload


def check_target(path: str | Path) -> Path:
    """The path of a recording of verdicts, which is one MCAP file that is not there yet.

    Raises:
        BagError: It ends in something else, or exists.
    """
    path = Path(path)
    if path.suffix != '.mcap':
        raise BagError(f"recording of verdicts '{path}' must end in .mcap")
    if path.exists():
        raise BagError(f"bag '{path}' exists already and is not overwritten")
    return path


def write_verdicts(
    checked: CheckReport,
    config: MonitorConfig,
    path: str | Path,
    progress: Callable[[int], None] | None = None,
) -> None:
    """Write the inputs of a checked bag and the verdicts on them as one MCAP file.

    Args:
        checked: What the check found.
        config: The configuration it was checked with.
        path: Where to; a name ending in ``.mcap`` that is not there yet.
        progress: Told the messages written, now and then.

    Raises:
        BagError: It cannot be written, or the bag cannot be read again.
    """
    with BagWriter(check_target(path)) as writer:
        for topic, kind, definition in topics(checked, config):
            writer.add_topic(topic, kind, definition)

        def write(columns: Sequence[MessageColumn]) -> None:
            for part in _slices(columns):
                writer.write_columns((each.topic, each.time_ns, each.payload) for each in part)
            if progress is not None:
                progress(sum(writer.message_counts.values()))

        tell_verdicts(checked, config, write)


def _slices(columns: Sequence[MessageColumn]) -> Iterator[list[MessageColumn]]:
    """Cut columns into stretches of time, so that little is laid out at once."""
    longest = max(columns, key=lambda each: each.time_ns.size, default=None)
    if longest is None:
        return
    edges = np.sort(longest.time_ns)[_SLICE::_SLICE]
    places = [np.searchsorted(edges, each.time_ns, 'right') for each in columns]
    for number in range(edges.size + 1):
        yield [
            _picked(each, np.flatnonzero(place == number))
            for each, place in zip(columns, places, strict=True)
        ]


def _picked(column: MessageColumn, rows: NDArray[np.intp]) -> MessageColumn:
    payload = column.payload
    if rows.size == column.time_ns.size:
        return column
    some = payload[rows] if isinstance(payload, np.ndarray) else [payload[k] for k in rows]
    return MessageColumn(column.topic, column.type, column.time_ns[rows], some)


def topics(checked: CheckReport, config: MonitorConfig) -> Iterator[tuple[str, str, str | None]]:
    """Name, type and, where it is not built in, definition of every topic of the verdicts."""
    for name in _inputs(config):
        kind = checked.bag.topics[name].type
        yield name, kind, None if kind in MESSAGE_TYPES else checked.bag.definition(name)
    for name, kind in output_topics(config.bearings, f'/{NODE}').items():
        yield name, kind, None


def _inputs(config: MonitorConfig) -> list[str]:
    """The topics the bearings read, each once."""
    return list(dict.fromkeys(i.topic for b in config.bearings for i in b.inputs.values()))


def tell_verdicts(
    checked: CheckReport,
    config: MonitorConfig,
    tell: Callable[[Sequence[MessageColumn]], None],
    spans: TimeSpans = _ALWAYS,
) -> None:
    """Inputs and verdicts, one stretch of the recording after the other.

    The inputs have the log times they were recorded with, a verdict has its own time: that of the
    later of its two measurements.

    Args:
        checked: What the check found.
        config: The configuration it was checked with.
        tell: Given the messages of a stretch, inputs before verdicts. The stretches follow each
            other in time but for single messages at their edges.
        spans: The times that are wanted: nothing else is encoded.

    Raises:
        BagError: The bag cannot be read again.
    """
    courses: list[_Course] = []
    told = _Told(checked, config, spans)

    def begin(bearing: BearingConfig) -> _Course:
        own = checked.bearings[bearing.name]
        courses.append(_Course(bearing, own.events, checked.start_ns or 0, spans, config))
        return courses[-1]

    follow(checked.bag, config, begin, after=lambda until_ns: tell(told.round(courses, until_ns)))
    tell(told.rest(courses))


class _Told:
    """What of a recording has been told."""

    def __init__(self, checked: CheckReport, config: MonitorConfig, spans: TimeSpans) -> None:
        self._checked, self._spans = checked, spans
        self._raw = checked.bag.payloads(_inputs(config), spans)
        self._next: tuple[int, dict[str, tuple[IntArray, Payload]]] | None = next(self._raw, None)
        self._now_ns = (checked.start_ns or 0) - 1
        events = [e.time_ns for b in checked.bearings.values() for e in b.events]
        self._changes = np.unique(np.array(events, np.int64))

    def round(self, courses: Sequence[_Course], read_ns: int) -> list[MessageColumn]:
        """What can be told once a bag was read to a log time [ns]."""
        heard = [course.heard_ns for course in courses if course.heard_ns.size]
        times = np.concatenate(heard) if heard else np.empty(0, np.int64)
        return [*self._inputs(read_ns), *self._verdicts(courses, times)]

    def rest(self, courses: Sequence[_Course]) -> list[MessageColumn]:
        """What is left at the end."""
        end = self._checked.end_ns
        times = np.empty(0, np.int64) if end is None else np.array([end], np.int64)
        return [*self._inputs(None), *self._verdicts(courses, times, last=True)]

    def _inputs(self, read_ns: int | None) -> Iterator[MessageColumn]:
        while self._next is not None and (read_ns is None or self._next[0] <= read_ns):
            for name, (time_ns, payload) in self._next[1].items():
                yield MessageColumn(name, self._checked.bag.topics[name].type, time_ns, payload)
            self._next = next(self._raw, None)

    def _verdicts(
        self, courses: Sequence[_Course], heard_ns: IntArray, last: bool = False
    ) -> Iterator[MessageColumn]:
        for course in courses:
            yield from course.handed()
        ticks = self._ticks(heard_ns, last)
        for course in courses:
            yield from course.warnings(self._now_ns, last)
        states = [course.states(ticks, self._now_ns) for course in courses]
        if ticks.size:
            messages = [
                encode_diagnostics(time_ns, each)
                for time_ns, *each in zip(ticks.tolist(), *states, strict=True)
            ]
            kind = 'diagnostic_msgs/msg/DiagnosticArray'
            yield MessageColumn('/diagnostics', kind, ticks, messages)

    def _ticks(self, heard_ns: IntArray, last: bool) -> IntArray:
        """Every second since the last time, and each change of an alarm.

        Not those of a silence beyond its first hour: a clock that was wrong for one message would
        else make ticks for years.
        """
        checked, before = self._checked, self._now_ns
        if checked.start_ns is None or checked.end_ns is None:
            return np.empty(0, np.int64)
        low = min(before + 1, checked.end_ns)
        heard = np.sort(np.append(low, heard_ns.clip(low, checked.end_ns)))
        self._now_ns = int(heard[-1])
        silent = np.flatnonzero(np.diff(heard) > _SILENCE_NS)
        starts = np.append(heard[0], heard[silent + 1])
        stops = np.append(heard[silent] + _SILENCE_NS, heard[-1])
        # On the grid that begins with the recording, whatever is left out.
        first = -(-(starts - checked.start_ns) // _TICK_NS)
        final = (stops - checked.start_ns) // _TICK_NS
        pieces = [np.arange(a, b + 1) for a, b in zip(first, final, strict=True)]
        ticks = checked.start_ns + _TICK_NS * np.concatenate(pieces)
        new = (self._changes > before) & (last | (self._changes <= self._now_ns))
        ticks = np.union1d(ticks[ticks > before], self._changes[new])
        return ticks[self._spans.holds(ticks)]


class _Course:
    """One bearing over a recording."""

    def __init__(
        self,
        config: BearingConfig,
        events: Sequence[Event],
        start_ns: int,
        spans: TimeSpans,
        whole: MonitorConfig,
    ) -> None:
        self._config, self._spans, self._start_ns = config, spans, start_ns
        self._period_ns = round(whole.publish_period * 1e9)
        self._names = list(output_topics([config], f'/{NODE}').items())[:-2]
        # In order already, but where the clock jumped back.
        self._events = sorted(events, key=lambda event: event.time_ns)
        self._event_times = np.array([event.time_ns for event in self._events], np.int64)
        self._told = 0
        self._columns: list[MessageColumn] = []
        self._published_ns: int | None = None
        self._evaluated_ns = _NEVER
        self._points = _PointLog(config)
        self._samples = _SampleLog()
        self._levels = None if config.level is None else _LevelLog(config.level)
        self.heard_ns: IntArray = np.empty(0, np.int64)

    def take(self, block: BearingBlock) -> None:
        """Take the next stretch."""
        self.heard_ns = block.stream.time_ns
        self._samples.take(block)
        if self._levels is not None:
            self._levels.take(block)
        self._points.take(block.scan)
        self._columns += self._verdicts(block.scan)

    def handed(self) -> list[MessageColumn]:
        """The verdicts since the last call."""
        found, self._columns = self._columns, []
        return found

    def _verdicts(self, scan: Scan) -> Iterator[MessageColumn]:
        """Numbers and regime of every evaluation, or at most one each period."""
        rows = self._published(scan.time_ns)
        rows = rows[self._spans.holds(scan.time_ns[rows])]
        if not rows.size:
            return
        points, time_ns = at_indices(scan.assessment, rows), scan.time_ns[rows]
        numbers = list(verdict_numbers(points).values())
        for (topic, kind), column in zip(self._names, numbers, strict=False):
            yield MessageColumn(topic, kind, time_ns, encode_float64s(column))
        words = self._names[len(numbers) :]
        yield from _words(words[0], time_ns, np.asarray(points.regime_code), REGIMES)
        if (measured := scan.course.measured) is not None:
            yield from _words(words[1], time_ns, measured[rows], MEASURED)

    def _published(self, time_ns: IntArray) -> NDArray[np.intp]:
        """The evaluations that are published: each, or those a period apart and at a change."""
        if self._period_ns <= 0 or not time_ns.size:
            return np.arange(time_ns.size)
        new = (self._event_times > self._evaluated_ns) & (self._event_times <= time_ns[-1])
        changes = set(np.searchsorted(time_ns, self._event_times[new]).tolist())
        self._evaluated_ns = int(time_ns[-1])
        kept, before = [], self._published_ns
        for i, time in enumerate(time_ns.tolist()):
            if before is None or time - before >= self._period_ns or i in changes:
                kept.append(i)
                before = time
        self._published_ns = before
        return np.array(kept, np.intp)

    def warnings(self, now_ns: int, last: bool) -> Iterator[MessageColumn]:
        """One message for each change of the alarm since the last call, up to a time [ns]."""
        begin, end = self._told, len(self._events)
        if not last:
            end = int(np.searchsorted(self._event_times, now_ns, 'right'))
        self._told = max(begin, end)
        rows = np.arange(begin, end)
        rows = rows[self._spans.holds(self._event_times[rows])]
        if rows.size:
            texts = [encode_string(event_json(self._events[k])) for k in rows.tolist()]
            kind = 'std_msgs/msg/String'
            yield MessageColumn(f'/{NODE}/warnings', kind, self._event_times[rows], texts)

    def states(self, ticks: IntArray, now_ns: int) -> list[StatusFields]:
        """The bearing as the node would tell of it at some times, up to a time read [ns]."""
        counts, believed = self._samples.at(ticks, now_ns)
        points = self._points.at(ticks)
        told = np.searchsorted(self._event_times, ticks, 'right').tolist()
        levels: Sequence[LevelState | None] = [None] * ticks.size
        if self._levels is not None:
            levels = self._levels.at(ticks, now_ns)
        times = zip(ticks.tolist(), told, points, counts, believed.tolist(), levels, strict=True)
        return [self._status(*each) for each in times]

    def _status(
        self,
        time_ns: int,
        told: int,
        at: _PointAt,
        counts: NDArray[np.int64],
        believed: list[int],
        level: LevelState | None,
    ) -> StatusFields:
        condition = self._events[told - 1].after if told else Condition.NORMAL
        lost = self._lost(time_ns, believed)
        stale = condition is Condition.INPUT_STALE
        trend = None if stale or at.trend is None else at.trend()
        text = describe(
            self._config, condition, at.point, at.standing, lost if stale else {}, trend=trend
        )
        state = BearingState(
            self._config, condition, text, at.point, at.standing, trend, lost, counts,
            vibration=level,
        )  # fmt: skip
        record = diagnostic_record(NODE, state)
        return StatusFields(
            record.level, record.name, record.message, record.hardware_id, record.values
        )

    def _lost(self, time_ns: int, believed: list[int]) -> dict[str, float]:
        """The inputs whose timeout has passed, with their ages [s]."""
        lost = {}
        sources = self._config.speed, self._config.load
        for name, stamp, source in zip(QUANTITIES, believed, sources, strict=True):
            since = self._start_ns if stamp == _NEVER else stamp
            if time_ns >= since + source.timeout_ns:
                lost[name] = np.inf if stamp == _NEVER else (time_ns - stamp) / 1e9
        return lost


def _words(
    topic: tuple[str, str], time_ns: IntArray, codes: NDArray[np.int8], words: Sequence[Enum]
) -> Iterator[MessageColumn]:
    """The messages of a topic that says one of a few words, by what they say."""
    for code, word in enumerate(words):
        own = np.flatnonzero(codes == code)
        if own.size:
            data = np.void(encode_string(word.value))
            yield MessageColumn(*topic, time_ns[own], np.full(own.size, data, data.dtype))


class _StatusCounts:
    """How many samples of one input came to each :class:`Status`, until their time has come."""

    def __init__(self) -> None:
        self._counts = np.zeros(len(Status), np.int64)
        self._coming: dict[Status, list[IntArray]] = {}

    def note(self, status: Status, stamp_ns: IntArray) -> None:
        """Take samples of a status, by their stamps [ns]."""
        if stamp_ns.size:
            self._coming.setdefault(status, []).append(stamp_ns)

    def at(self, ticks: IntArray, now_ns: int) -> NDArray[np.int64]:
        """Counts at some times, shape (n, 6).

        What is older than a time [ns] is only counted from then on.
        """
        counts = np.repeat(self._counts[np.newaxis], ticks.size, axis=0)
        for status, parts in self._coming.items():
            stamps = np.sort(np.concatenate(parts))
            counts[:, status] += np.searchsorted(stamps, ticks, 'right')
            done = int(np.searchsorted(stamps, now_ns, 'right'))
            self._counts[status] += done
            parts[:] = [stamps[done:]]
        return counts


class _SampleLog:
    """What became of the samples of speed and load."""

    def __init__(self) -> None:
        self._counts = [_StatusCounts() for _ in QUANTITIES]
        self._believed: list[IntArray] = [np.array([_NEVER])] * len(QUANTITIES)

    def take(self, block: BearingBlock) -> None:
        """Take a stretch of the recording."""
        status, stream = block.scan.status, block.stream
        plain = not status.any()
        for row, series in enumerate(block.series[: len(QUANTITIES)]):
            if plain:
                self._note(row, Status.ACCEPTED, series.stamp_ns)
                continue
            own = stream.is_load == bool(row)
            for each in Status:
                self._note(row, each, stream.time_ns[own & (status == each)])

    def _note(self, row: int, status: Status, stamp_ns: IntArray) -> None:
        self._counts[row].note(status, stamp_ns)
        if status.believed:
            self._believed[row] = np.append(self._believed[row], stamp_ns)

    def at(self, ticks: IntArray, now_ns: int) -> tuple[NDArray[np.int64], IntArray]:
        """Counts at some times, shape (n, 2, 6), and the last stamps believed, (n, 2) [ns]."""
        counts = np.stack([each.at(ticks, now_ns) for each in self._counts], axis=1)
        believed = np.empty((ticks.size, len(QUANTITIES)), np.int64)
        for row, stamps in enumerate(self._believed):
            ordered = np.sort(stamps)
            believed[:, row] = ordered[np.searchsorted(ordered, ticks, 'right') - 1]
            done = int(np.searchsorted(ordered, now_ns, 'right'))
            self._believed[row] = ordered[max(done - 1, 0) :]
        return counts, believed


class _LevelLog:
    """What the level said, and what became of its values."""

    def __init__(self, config: LevelConfig) -> None:
        self._config = config
        self._counts = _StatusCounts()
        self._said = np.empty((3, 0), np.int64)

    def take(self, block: BearingBlock) -> None:
        """Take a stretch of the recording."""
        course, levels = block.scan.level, block.stream.level
        assert course is not None
        assert levels is not None
        self._said = np.append(
            self._said, [course.time_ns, course.changed_ns, course.code.astype(np.int64)], axis=1
        )
        for status in Status:
            self._counts.note(status, levels.time_ns[course.status == status])

    def at(self, ticks: IntArray, now_ns: int) -> list[LevelState]:
        """What it said at some times, up to a time read [ns]."""
        counts = self._counts.at(ticks, now_ns)
        said = self._said[:, np.argsort(self._said[0], kind='stable')]
        places = (np.searchsorted(said[0], ticks, 'right') - 1).tolist()
        self._said = said[:, max(int(np.searchsorted(said[0], now_ns, 'right')) - 1, 0) :]
        times = zip(ticks.tolist(), places, counts, strict=True)
        return [self._state(time_ns, said[:, k] if k >= 0 else None, n) for time_ns, k, n in times]

    def _state(self, time_ns: int, said: IntArray | None, counts: NDArray[np.int64]) -> LevelState:
        if said is None:
            return LevelState(Measured.UNKNOWN, Unknown.NOTHING, counts)
        last, changed, code = said.tolist()
        return LevelState(*said_at(self._config, last, changed, code, time_ns), counts)


class _PointAt(NamedTuple):
    """The last operating point at a time, and how to work out the trend there, if it may be."""

    point: Assessment | None
    standing: Standing
    trend: Callable[[], Trend | None] | None


class _PointLog:
    """The latest operating points, as far back as the window of the trend reaches."""

    def __init__(self, config: BearingConfig) -> None:
        self._config = config
        self._scan: Scan | None = None
        self._latest: LatestPoint | None = None
        # Number of the first point kept, and of the first one of the scan.
        self._begin = self._own = 0
        self._columns: tuple[NDArray[Any], ...] = (
            np.empty(0, np.int64), np.empty(0), np.empty(0), np.empty(0, np.int64),
        )  # fmt: skip

    def take(self, scan: Scan) -> None:
        """Take the next verdicts; of those before only what the trend needs is kept."""
        self._forget()
        points, before = scan.assessment, self._columns
        self._own = self._begin + before[0].size
        self._scan, self._latest = scan, scan.latest
        new = (scan.time_ns, points.speed, points.load, scan.first)
        self._columns = tuple(map(np.concatenate, zip(before, new, strict=True)))

    def at(self, ticks: IntArray) -> list[_PointAt]:
        """The last point at each of some times, later than those before."""
        columns = self._with_latest()
        time_ns, speed, load, first = columns
        # After a jump of the clock what came last is what counts.
        places = np.searchsorted(np.maximum.accumulate(time_ns), ticks, 'right') - 1
        places = np.maximum(places, self._own - self._begin - 1)
        low = np.maximum(first[places] - self._begin, 0) if time_ns.size else places
        may = np.zeros(ticks.size, np.bool_)
        if time_ns.size:
            may = may_cross(self._config, time_ns, speed, load, low, places)
        found = self._points(places + self._begin - self._own)
        return [
            _PointAt(
                point,
                standing,
                partial(self._trend, columns, lo, k) if m and not standing.sticking else None,
            )
            for (point, standing), lo, k, m in zip(
                found, low.tolist(), places.tolist(), may.tolist(), strict=True
            )
        ]

    def _forget(self) -> None:
        """Drop what no window reaches any more."""
        time_ns = self._columns[0]
        if time_ns.size:
            oldest = int(time_ns[-1]) - self._config.alarm.trend_window_ns
            kept = int(np.searchsorted(np.maximum.accumulate(time_ns), oldest))
            self._begin += kept
            self._columns = tuple(column[kept:].copy() for column in self._columns)

    def _with_latest(self) -> tuple[NDArray[Any], ...]:
        """The points, and the one whose end is not known yet."""
        latest = self._latest
        if latest is None or latest.number < self._begin + self._columns[0].size:
            return self._columns
        point = latest.assessment
        last = (latest.time_ns, point.speed, point.load, latest.first)
        return tuple(np.append(*pair) for pair in zip(self._columns, last, strict=True))

    def _points(self, places: NDArray[np.intp]) -> list[tuple[Assessment | None, Standing]]:
        """Assessment and standing of points by their place in the scan, -1 for none."""
        scan, latest = self._scan, self._latest
        size = 0 if scan is None else scan.time_ns.size
        rows = np.unique(places[(places >= 0) & (places < size)])
        found: dict[int, tuple[Assessment | None, Standing]] = {}
        if scan is not None and rows.size:
            points = at_indices(scan.assessment, rows)
            for name in (*COLUMNS, 'amplitude_exact'):  # worked out together
                getattr(points, name)
            found = {
                k: (at_index(points, i), scan.course.at(k)) for i, k in enumerate(rows.tolist())
            }
        last = (None, QUIET) if latest is None else (latest.assessment, latest.standing)
        return [(None, QUIET) if k < 0 else found.get(k, last) for k in places.tolist()]

    def _trend(self, columns: tuple[NDArray[Any], ...], low: int, k: int) -> Trend | None:
        window = TrendWindow(self._config.alarm.trend_window_ns)
        window.fill(*(column[low : k + 1] for column in columns[:3]))
        return window.trend(self._config)
