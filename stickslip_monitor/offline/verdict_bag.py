# SPDX-License-Identifier: Apache-2.0
"""A session over a bag: its inputs and the verdicts on them as messages, as the node has them.

The bag is read once more, and what each stretch of it gives is handed on in order of time, so
memory does not grow with the recording.
"""

from __future__ import annotations

from array import array
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

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
from stickslip_monitor.bags.reader import Request, Series
from stickslip_monitor.bags.values import Payload, TimeSpans
from stickslip_monitor.bags.writer import BagWriter
from stickslip_monitor.errors import BagError
from stickslip_monitor.monitor.config import BearingConfig, MonitorConfig
from stickslip_monitor.monitor.ladder import Condition
from stickslip_monitor.monitor.messages import (
    BearingState,
    diagnostic_record,
    event_json,
    output_topics,
    topic_numbers,
    topic_words,
)
from stickslip_monitor.monitor.monitor import BearingMonitor
from stickslip_monitor.monitor.session import Moment, NoLog, Session, Sink
from stickslip_monitor.monitor.verdict import Event, Verdict, assessed
from stickslip_monitor.offline.check import CheckReport
from stickslip_monitor.offline.follow import requests_of
from stickslip_monitor.physics.boundary_table import known_table

NODE = 'stickslip_monitor'
TICK_NS = 10**9
"""Time between two diagnostics [ns]."""
SILENCE_NS = 3600 * 10**9
"""Diagnostics of a longer silence end [ns]: a clock that was wrong for one message would else
make them for years."""
# Messages that are laid out at a time.
_SLICE = 1 << 14
_ALWAYS = TimeSpans([(0, (1 << 63) - 1)])


class MessageColumn(NamedTuple):
    """Messages of one topic: n log times [ns], and as many messages in CDR."""

    topic: str
    type: str
    time_ns: IntArray
    payload: Payload


Tell = Callable[[Sequence[MessageColumn]], None]


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
    for name in _input_topics(config):
        kind = checked.bag.topics[name].type
        yield name, kind, None if kind in MESSAGE_TYPES else checked.bag.definition(name)
    for name, kind in output_topics(config.bearings, f'/{NODE}').items():
        yield name, kind, None


def _input_topics(config: MonitorConfig) -> list[str]:
    """The topics the bearings read, each once."""
    return list(dict.fromkeys(i.topic for b in config.bearings for i in b.inputs.values()))


def tell_verdicts(
    checked: CheckReport, config: MonitorConfig, tell: Tell, spans: TimeSpans = _ALWAYS
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
    asked = {request for bearing in config.bearings for request in requests_of(bearing)}

    raw, course = _Raw(checked, config, spans), _Course(checked, config, spans)
    for part in checked.bag.reading(asked):
        course.take(part)
        tell([*raw.until(_latest_ns(part)), *course.told()])
    course.finish()
    tell([*raw.until(None), *course.told()])


def _latest_ns(part: Mapping[Request, Series]) -> int:
    """The log time that a stretch goes up to [ns]."""
    known = [int(each.log_time_ns[-1]) for each in part.values() if each.log_time_ns.size]
    return max(known, default=0)


class _Raw:
    """The messages of the inputs as they were recorded."""

    def __init__(self, checked: CheckReport, config: MonitorConfig, spans: TimeSpans) -> None:
        self._messages = checked.bag.messages(_input_topics(config), spans)
        self._next = next(self._messages, None)

    def until(self, read_ns: int | None) -> Iterator[MessageColumn]:
        """Those up to a log time [ns]; the rest of all for ``None``."""
        found: dict[tuple[str, str], tuple[list[int], list[bytes]]] = {}
        while (message := self._next) and (read_ns is None or message.log_time_ns <= read_ns):
            times, payload = found.setdefault((message.topic, message.type), ([], []))
            times.append(message.log_time_ns)
            payload.append(message.data)
            self._next = next(self._messages, None)
        for (topic, kind), (times, payload) in found.items():
            yield MessageColumn(topic, kind, np.array(times), payload)


class _Verdicts:
    """Verdicts on one bearing, as columns, which take a quarter of the memory of rows."""

    def __init__(self) -> None:
        self.time_ns = array('q')
        self.points = array('d')  # speed, load and chance of stick-slip of each
        self.measured: list[str] = []  # what the level said at each


class _Messages(Sink):
    """What a session tells, encoded; what lies outside the spans is passed over."""

    def __init__(self, config: MonitorConfig, spans: TimeSpans) -> None:
        self._spans, self._bearings = spans, config.bearings
        self._verdicts = {b.name: _Verdicts() for b in config.bearings}
        self._kinds = output_topics(config.bearings, f'/{NODE}')
        self._told: dict[str, list[tuple[int, bytes]]] = {name: [] for name in self._kinds}

    def wants(self, time_ns: int) -> bool:
        """Whether a time lies in the spans."""
        return bool(self._spans.overlap(time_ns, time_ns))

    def columns(self) -> Iterator[MessageColumn]:
        """What was told since the last call."""
        for bearing in self._bearings:
            told = self._verdicts[bearing.name]
            if not told.measured:
                continue
            self._verdicts[bearing.name] = _Verdicts()
            time_ns = np.array(told.time_ns)
            for name, payload in _of_verdicts(bearing, told):
                topic = f'/{NODE}/{bearing.name}/{name}'
                yield MessageColumn(topic, self._kinds[topic], time_ns, payload)
        for topic, messages in self._told.items():
            if messages:
                times, payload = zip(*messages, strict=True)
                yield MessageColumn(topic, self._kinds[topic], np.array(times), list(payload))
                messages.clear()

    def take_verdict(self, verdict: Verdict) -> None:
        """One operating point; what is said of it is worked out with those that follow."""
        if self.wants(verdict.time_ns):
            told = self._verdicts[verdict.bearing]
            told.time_ns.append(verdict.time_ns)
            told.points.extend((verdict.speed, verdict.load, *verdict.chances))
            told.measured.append(str(verdict.measured))

    def take_event(self, event: Event) -> None:
        """One JSON warning."""
        if self.wants(event.time_ns):
            self._tell(f'/{NODE}/warnings', event.time_ns, encode_string(event_json(event)))

    def take_diagnostics(self, time_ns: int, states: Sequence[BearingState]) -> None:
        """The state of the bearings at a time [ns]."""
        records = [diagnostic_record(NODE, state) for state in states]
        fields = [
            StatusFields(r.level, r.name, r.message, r.hardware_id, r.values) for r in records
        ]
        self._tell('/diagnostics', time_ns, encode_diagnostics(time_ns, fields))

    def _tell(self, topic: str, time_ns: int, data: bytes) -> None:
        self._told[topic].append((time_ns, data))


def _of_verdicts(bearing: BearingConfig, told: _Verdicts) -> Iterator[tuple[str, Payload]]:
    """What the topics of a bearing say of n verdicts, n messages each, by their last part."""
    speed, load, *chances = np.array(told.points).reshape(-1, 5).T
    points = assessed(bearing, known_table(bearing.bearing), speed, load, chances)
    for name in topic_numbers(bearing):
        values = getattr(points, name)
        if name.startswith('amplitude'):
            values = np.where(np.isnan(values), 0.0, values)  # there is no cycle
        yield name, encode_float64s(values)
    words = {'regime': points.regime.tolist(), 'measured': told.measured}
    for name in topic_words(bearing):
        encoded = {word: encode_string(word) for word in set(words[name])}
        yield name, [encoded[word] for word in words[name]]


class _Course:
    """A session on its way through a recording, in the recording's own time."""

    def __init__(self, checked: CheckReport, config: MonitorConfig, spans: TimeSpans) -> None:
        self._sink = _Messages(config, spans)
        self._session = Session(config, self._sink, NoLog(), lambda: 0)
        self._session.begin()
        self._start_ns, self._end_ns = checked.start_ns or 0, checked.end_ns or 0
        self._ticked_ns = self._heard_ns = self._start_ns - 1
        self._due: set[int] = set()
        self._inputs = [
            (bearing.name, place, request)
            for bearing in config.bearings
            for place, request in enumerate(requests_of(bearing))
        ]
        if checked.start_ns is not None:
            self._advance(self._start_ns)

    def told(self) -> Iterator[MessageColumn]:
        """The messages since the last call."""
        return self._sink.columns()

    def take(self, part: Mapping[Request, Series]) -> None:
        """Take the next stretch."""
        sequence = np.concatenate([part[r].sequence for *_, r in self._inputs])
        stamps = np.concatenate([part[r].stamp_ns for *_, r in self._inputs]).tolist()
        values = np.concatenate([part[r].value for *_, r in self._inputs]).tolist()
        sizes = [part[r].sequence.size for *_, r in self._inputs]
        inputs = np.repeat(np.arange(len(sizes)), sizes).tolist()
        for k in np.argsort(sequence, kind='stable').tolist():
            name, place, _ = self._inputs[inputs[k]]
            self._sample(name, place, stamps[k], values[k])

    def finish(self) -> None:
        """Come to the end of the recording."""
        self._pass_time(self._end_ns + 1)
        self._advance(self._end_ns)
        self._pass_time(self._end_ns + 1)

    def _sample(self, name: str, place: int, time_ns: int, value: float) -> None:
        self._pass_time(time_ns)
        self._heard_ns = max(self._heard_ns, min(time_ns, self._end_ns))
        update = self._session.take(name, place, time_ns, value, Moment(time_ns, time_ns))
        self._due.update(event.time_ns for event in update.events)

    def _advance(self, time_ns: int) -> None:
        for name in self._session.monitor.bearings:
            self._session.pass_time(name, time_ns, Moment(time_ns, time_ns))

    def _pass_time(self, until_ns: int) -> None:
        """Tell the state of every second, and of each change, before a time [ns]."""
        if until_ns <= self._ticked_ns + 1:
            return
        until_ns = min(until_ns, self._end_ns + 1)
        losses: set[int] = set()
        if any(self._may_lose(b, until_ns) for b in self._session.monitor.bearings.values()):
            losses = {event.time_ns for own in self._probes(until_ns - 1)[1] for event in own}
        times = {*self._grid(until_ns), *self._due, *losses}
        for time_ns in sorted(t for t in times if self._ticked_ns < t < until_ns):
            if self._sink.wants(time_ns):
                # A loss counts from the nanosecond after it fell due.
                bearings, _ = self._probes(time_ns + 1 if time_ns in losses else time_ns)
                self._sink.take_diagnostics(time_ns, [BearingState(b) for b in bearings])
        self._ticked_ns = until_ns - 1
        self._due = {t for t in self._due if t >= until_ns}

    def _grid(self, until_ns: int) -> Iterator[int]:
        """Every second of the recording before a time, but not of a long silence."""
        last = min(until_ns - 1, self._heard_ns + SILENCE_NS)
        first = -(-(self._ticked_ns + 1 - self._start_ns) // TICK_NS)
        return (
            self._start_ns + TICK_NS * k
            for k in range(first, (last - self._start_ns) // TICK_NS + 1)
        )

    def _may_lose(self, bearing: BearingMonitor, until_ns: int) -> bool:
        """Whether an input that counts may have been lost before a time [ns]."""
        sources = bearing.config.speed, bearing.config.load
        condition = self._session.monitor.condition(bearing.config.name)
        return condition is not Condition.INPUT_STALE and any(
            until_ns - (bearing.last_ns(place) or self._start_ns) > source.timeout_ns
            for place, source in enumerate(sources)
        )

    def _probes(self, time_ns: int) -> tuple[list[BearingMonitor], list[list[Event]]]:
        """The bearings as they will be at a time if nothing comes, and what changes by then."""
        probes = [b.copy() for b in self._session.monitor.bearings.values()]
        return probes, [probe.advance(time_ns) for probe in probes]
