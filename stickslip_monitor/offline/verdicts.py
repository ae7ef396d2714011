# SPDX-License-Identifier: Apache-2.0
"""The verdicts on a checked bag as messages, the same as the node publishes, beside its inputs."""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Callable, Iterator
from pathlib import Path

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
from stickslip_monitor.bags.values import Message, TimeSpans
from stickslip_monitor.bags.writer import BagWriter
from stickslip_monitor.errors import BagError
from stickslip_monitor.monitor.assessment import REGIMES, at_index, at_indices
from stickslip_monitor.monitor.config import BearingConfig, MonitorConfig
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
from stickslip_monitor.monitor.scan import trend_at
from stickslip_monitor.monitor.signals import QUANTITIES, Status
from stickslip_monitor.monitor.trend import Trend
from stickslip_monitor.monitor.verdict import describe
from stickslip_monitor.offline.check import BearingReport, CheckReport

NODE = 'stickslip_monitor'
_BLOCK = 20_000
_TICK_NS = 10**9
_SILENCE_NS = 3600 * 10**9
_PROGRESS_EVERY = 10_000


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
        for number, message in enumerate(messages(checked, config)):
            writer.write(message.topic, message.log_time_ns, message.data)
            if progress is not None and number % _PROGRESS_EVERY == 0:
                progress(number)


def topics(checked: CheckReport, config: MonitorConfig) -> Iterator[tuple[str, str, str | None]]:
    """Name, type and, where it is not built in, definition of every topic of :func:`messages`."""
    for name in _inputs(config):
        kind = checked.bag.topics[name].type
        yield name, kind, None if kind in MESSAGE_TYPES else checked.bag.definition(name)
    for name, kind in output_topics(config.bearings, f'/{NODE}').items():
        yield name, kind, None


def messages(
    checked: CheckReport, config: MonitorConfig, spans: TimeSpans | None = None
) -> Iterator[Message]:
    """Inputs and verdicts, merged by time.

    The inputs have the log times they were recorded with, a verdict has its own time: that of the
    later of its two measurements. The recording's samples are in memory, the messages are not.

    Args:
        checked: What the check found.
        config: The configuration it was checked with.
        spans: The times that are wanted, all if None: nothing else is encoded.

    Yields:
        The messages in rising order of their times, inputs before verdicts.
    """
    sources = [checked.bag.messages(_inputs(config), spans)]
    spans = spans if spans is not None else TimeSpans([(0, (1 << 63) - 1)])
    courses = [_Course(b, checked.bearings[b.name], checked) for b in config.bearings]
    sources += [course.verdicts(config.publish_period, spans) for course in courses]
    sources += [course.warnings(spans) for course in courses]
    sources.append(_diagnostics(courses, checked, spans))
    return heapq.merge(*sources, key=lambda message: message.log_time_ns)


def _inputs(config: MonitorConfig) -> list[str]:
    """The topics the bearings read, each once."""
    return list(dict.fromkeys(i.topic for b in config.bearings for i in b.inputs.values()))


class _Course:
    """One bearing over a recording, in the order of its stamps."""

    def __init__(self, config: BearingConfig, report: BearingReport, checked: CheckReport) -> None:
        self.config = config
        self._scan = scan = report.scan
        self._start_ns = checked.start_ns or 0
        # In order already, but where the clock jumped back.
        self._rows = np.argsort(scan.time_ns, kind='stable')
        self._times = scan.time_ns[self._rows]
        self.events = sorted(scan.events, key=lambda event: event.time_ns)
        self._event_times = np.array([event.time_ns for event in self.events], np.int64)
        stream = report.stream
        self._seen = {
            (row, status): np.sort(
                stream.time_ns[(stream.is_load == bool(row)) & (scan.status == status)]
            )
            for row in range(len(QUANTITIES))
            for status in Status
        }
        self._level_seen, self._level_rows = [], np.empty(0, np.intp)
        if scan.level is not None and stream.level is not None:
            self._level_rows = np.argsort(scan.level.time_ns, kind='stable')
            self._level_times = scan.level.time_ns[self._level_rows]
            self._level_seen = [
                np.sort(stream.level.time_ns[scan.level.status == status]) for status in Status
            ]
        self._believed = [
            np.sort(np.concatenate([self._seen[row, s] for s in Status if s.believed]))
            for row in range(len(QUANTITIES))
        ]

    def verdicts(self, period: float, spans: TimeSpans) -> Iterator[Message]:
        """Numbers and regime of every evaluation, or at most one each period [s]."""
        names = list(output_topics([self.config], f'/{NODE}').items())[:-2]
        regimes = [encode_string(regime.value) for regime in REGIMES]
        measured = [encode_string(state.value) for state in MEASURED]
        rows = self._published(round(period * 1e9))
        rows = rows[spans.holds(self._scan.time_ns[rows])]
        for start in range(0, rows.size, _BLOCK):
            block = rows[start : start + _BLOCK]
            points = at_indices(self._scan.assessment, block)
            columns = [encode_float64s(column) for column in verdict_numbers(points).values()]
            columns.append([regimes[code] for code in np.asarray(points.regime_code).tolist()])
            if (codes := self._scan.course.measured) is not None:
                columns.append([measured[code] for code in codes[block].tolist()])
            for time_ns, *data in zip(self._scan.time_ns[block].tolist(), *columns, strict=True):
                for (topic, kind), item in zip(names, data, strict=True):
                    yield Message(topic, kind, time_ns, item)

    def _published(self, period_ns: int) -> NDArray[np.intp]:
        """The evaluations that are published: each, or those a period apart and at a change."""
        if period_ns <= 0:
            return self._rows
        changes = set(np.searchsorted(self._times, self._event_times).tolist())
        kept, last = [], None
        for i, time_ns in enumerate(self._times.tolist()):
            if last is None or time_ns - last >= period_ns or i in changes:
                kept.append(i)
                last = time_ns
        return np.asarray(self._rows[kept], np.intp)

    def warnings(self, spans: TimeSpans) -> Iterator[Message]:
        """One message for each change of the alarm."""
        wanted = spans.holds(self._event_times)
        for event in itertools.compress(self.events, wanted.tolist()):
            data = encode_string(event_json(event))
            yield Message(f'/{NODE}/warnings', 'std_msgs/msg/String', event.time_ns, data)

    def state(self, time_ns: int) -> BearingState:
        """The bearing as the node would tell of it at a time [ns]."""
        k = int(np.searchsorted(self._times, time_ns, 'right')) - 1
        i = int(self._rows[k]) if k >= 0 else -1
        point = at_index(self._scan.assessment, i) if i >= 0 else None
        standing = self._scan.course.at(i)
        e = int(np.searchsorted(self._event_times, time_ns, 'right')) - 1
        condition = self.events[e].after if e >= 0 else Condition.NORMAL
        lost = self._lost(time_ns)
        stale = condition is Condition.INPUT_STALE
        trend = self._trend(i) if i >= 0 and not stale else None
        text = describe(
            self.config, condition, point, standing, lost if stale else {}, trend=trend
        )
        counts = np.array(
            [
                [np.searchsorted(self._seen[row, status], time_ns, 'right') for status in Status]
                for row in range(len(QUANTITIES))
            ]
        )
        level = self._level(time_ns)
        return BearingState(
            self.config, condition, text, point, standing, trend, lost, counts, vibration=level
        )

    def _level(self, time_ns: int) -> LevelState | None:
        course, config = self._scan.level, self.config.level
        if course is None or config is None:
            return None
        k = int(np.searchsorted(self._level_times, time_ns, 'right')) - 1
        counts = np.array([np.searchsorted(t, time_ns, 'right') for t in self._level_seen])
        if k < 0:
            return LevelState(Measured.UNKNOWN, Unknown.NOTHING, counts)
        i = self._level_rows[k]
        known = int(course.time_ns[i]), int(course.changed_ns[i]), int(course.code[i])
        return LevelState(*said_at(config, *known, time_ns), counts)

    def _trend(self, i: int) -> Trend | None:
        scan = self._scan
        if scan.sticking[i]:
            return None
        return trend_at(self.config, scan.time_ns, scan.assessment, int(scan.first[i]), i)

    def _lost(self, time_ns: int) -> dict[str, float]:
        """The inputs whose timeout has passed, with their ages [s]."""
        lost = {}
        for name, stamps, source in zip(
            QUANTITIES, self._believed, (self.config.speed, self.config.load), strict=True
        ):
            k = int(np.searchsorted(stamps, time_ns, 'right')) - 1
            last = int(stamps[k]) if k >= 0 else None
            if time_ns >= (self._start_ns if last is None else last) + source.timeout_ns:
                lost[name] = np.inf if last is None else (time_ns - last) / 1e9
        return lost


def _diagnostics(
    courses: list[_Course], checked: CheckReport, spans: TimeSpans
) -> Iterator[Message]:
    """Every second, and at each change of an alarm."""
    if checked.start_ns is None or checked.end_ns is None:
        return
    changes = [event.time_ns for course in courses for event in course.events]
    seconds = _seconds(checked)
    times = np.union1d(seconds, np.array(changes, np.int64))
    for time_ns in times[spans.holds(times)].tolist():
        statuses = []
        for course in courses:
            record = diagnostic_record(NODE, course.state(time_ns))
            statuses.append(
                StatusFields(
                    record.level, record.name, record.message, record.hardware_id, record.values
                )
            )
        data = encode_diagnostics(time_ns, statuses)
        yield Message('/diagnostics', 'diagnostic_msgs/msg/DiagnosticArray', time_ns, data)


def _seconds(checked: CheckReport) -> IntArray:
    """Every second of the recording, but not those of a silence beyond its first hour.

    A clock that was wrong for one message would else make ticks for years.
    """
    assert checked.start_ns is not None
    assert checked.end_ns is not None
    stamps = [bearing.stream.time_ns for bearing in checked.bearings.values()]
    ends = np.array([checked.start_ns, checked.end_ns], np.int64)
    heard = np.unique(np.concatenate([ends, *stamps]).clip(*ends))
    silent = np.flatnonzero(np.diff(heard) > _SILENCE_NS)
    starts = np.append(heard[0], heard[silent + 1])
    stops = np.append(heard[silent] + _SILENCE_NS, heard[-1])
    # On the grid that begins with the recording, whatever is left out.
    first = -(-(starts - ends[0]) // _TICK_NS)
    last = (stops - ends[0]) // _TICK_NS
    pieces = [np.arange(a, b + 1) for a, b in zip(first, last, strict=True)]
    ticks: IntArray = ends[0] + _TICK_NS * np.concatenate(pieces)
    return ticks
