# SPDX-License-Identifier: Apache-2.0
"""A session over a bag: its inputs and the verdicts on them as messages, as the node has them.

The bag is read once more, and what each stretch of it gives is handed on in order of time, so
memory does not grow with the recording.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from stickslip_monitor.arrays import IntArray
from stickslip_monitor.bags.encode import (
    MESSAGE_TYPES,
    StatusFields,
    encode_diagnostics,
    encode_float64s,
    encode_string,
)
from stickslip_monitor.bags.values import Request, Series, TimeSpans
from stickslip_monitor.bags.writer import BagWriter
from stickslip_monitor.errors import BagError
from stickslip_monitor.monitor.config import BearingConfig, MonitorConfig
from stickslip_monitor.monitor.messages import (
    BearingState,
    diagnostic_record,
    event_json,
    output_topics,
    topic_numbers,
    topic_words,
)
from stickslip_monitor.monitor.monitor import BearingMonitor
from stickslip_monitor.monitor.rule import standing_until
from stickslip_monitor.monitor.rule_state import NEVER
from stickslip_monitor.monitor.session import Moment, NoLog, Session, Sink
from stickslip_monitor.monitor.verdict import Event, Verdict, assessed
from stickslip_monitor.offline.check import CheckReport, merged, requests_of
from stickslip_monitor.physics.boundary_table import known_table

NODE = 'stickslip_monitor'
TICK_NS = 10**9
"""Time between two diagnostics [ns]."""
SILENCE_NS = 3600 * 10**9
"""Diagnostics of a longer silence end [ns]: a clock that was wrong for one message would else
make them for years."""
# Samples whose messages are laid out at a time.
_SLICE = 1 << 14
_ALWAYS = TimeSpans([(0, (1 << 63) - 1)])


class MessageColumn(NamedTuple):
    """Messages of one topic: n log times [ns], and as many messages in CDR."""

    topic: str
    type: str
    time_ns: IntArray
    payload: Sequence[bytes]


Write = Callable[[Sequence[MessageColumn]], None]


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
        progress: Given the messages written, now and then.

    Raises:
        BagError: It cannot be written, or the bag cannot be read again.
    """
    with BagWriter(check_target(path)) as writer:
        for topic, kind, definition in topics(checked, config):
            writer.add_topic(topic, kind, definition)

        def write(columns: Sequence[MessageColumn]) -> None:
            writer.write_columns((each.topic, each.time_ns, each.payload) for each in columns)
            if progress is not None:
                progress(sum(writer.message_counts.values()))

        tell_verdicts(checked, config, write)


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
    checked: CheckReport, config: MonitorConfig, write: Write, spans: TimeSpans = _ALWAYS
) -> None:
    """Inputs and verdicts, one stretch of the recording after the other.

    The inputs have the log times they were recorded with, a verdict has its own time: that of the
    later of its two measurements.

    Args:
        checked: What the check found.
        config: The configuration it was checked with.
        write: Given the messages of a stretch, inputs before verdicts. The stretches follow each
            other in time but for single messages at their edges.
        spans: The times that are wanted: nothing else is encoded.

    Raises:
        BagError: The bag cannot be read again.
    """
    raw, course = _Raw(checked, config, spans), _Course(checked, config, spans)
    asked = {request for *_, request in course.inputs}
    for part in checked.bag.reading(asked):
        for log_time_ns in course.take(part):
            write([*raw.until(log_time_ns), *course.columns()])
    course.finish()
    write([*raw.until(None), *course.columns()])


class _Raw:
    """The messages of the inputs as they were recorded."""

    def __init__(self, checked: CheckReport, config: MonitorConfig, spans: TimeSpans) -> None:
        self._messages = checked.bag.messages(_input_topics(config), spans)
        self._next = next(self._messages, None)

    def until(self, log_time_ns: int | None) -> Iterator[MessageColumn]:
        """Those up to a log time [ns]; the rest of all for ``None``."""
        found: dict[tuple[str, str], list[tuple[int, bytes]]] = {}
        while (message := self._next) and (
            log_time_ns is None or message.log_time_ns <= log_time_ns
        ):
            own = found.setdefault((message.topic, message.type), [])
            own.append((message.log_time_ns, message.data))
            self._next = next(self._messages, None)
        for (topic, kind), messages in found.items():
            yield _column(topic, kind, messages)


def _column(topic: str, kind: str, messages: Sequence[tuple[int, bytes]]) -> MessageColumn:
    times, payload = zip(*messages, strict=True)
    return MessageColumn(topic, kind, np.array(times), payload)


class _Course(Sink):
    """A session on its way through a recording, in the recording's own time.

    Attributes:
        inputs: Bearing, place and what is read of each input.
    """

    def __init__(self, checked: CheckReport, config: MonitorConfig, spans: TimeSpans) -> None:
        self._spans = spans
        self._kinds = output_topics(config.bearings, f'/{NODE}')
        self._verdicts: dict[str, list[Verdict]] = {b.name: [] for b in config.bearings}
        self._pending: dict[str, list[tuple[int, bytes]]] = {name: [] for name in self._kinds}
        self._session = Session(config, self, NoLog(), lambda: 0)
        self._session.begin()
        self._bearings = self._session.monitor.bearings
        self._start_ns, self._end_ns = checked.start_ns or 0, checked.end_ns or 0
        self._ticked_ns = self._heard_ns = self._start_ns - 1
        self._due: set[int] = set()
        self.inputs = [
            (bearing.name, place, request)
            for bearing in config.bearings
            for place, request in enumerate(requests_of(bearing))
        ]
        if checked.start_ns is not None:
            self._advance(self._start_ns)

    def take(self, part: Mapping[Request, Series]) -> Iterator[int]:
        """Take the next stretch; now and then the log time up to which it was taken [ns]."""
        inputs, *columns, log_time_ns = merged([part[request] for *_, request in self.inputs])
        for begin in range(0, inputs.size, _SLICE):
            rows = slice(begin, begin + _SLICE)
            samples = (column[rows].tolist() for column in (inputs, *columns))
            for number, time_ns, value in zip(*samples, strict=True):
                self._sample(number, time_ns, value)
            yield int(log_time_ns[rows].max())

    def finish(self) -> None:
        """Come to the end of the recording."""
        self._pass_time(self._end_ns + 1)
        self._advance(self._end_ns)
        self._pass_time(self._end_ns + 1)

    def columns(self) -> Iterator[MessageColumn]:
        """The messages since the last call."""
        for name, verdicts in self._verdicts.items():
            if verdicts:
                time_ns = np.array([verdict.time_ns for verdict in verdicts])
                for last, payload in _of_verdicts(self._bearings[name].config, verdicts):
                    topic = f'/{NODE}/{name}/{last}'
                    yield MessageColumn(topic, self._kinds[topic], time_ns, payload)
                verdicts.clear()
        for topic, messages in self._pending.items():
            if messages:
                yield _column(topic, self._kinds[topic], messages)
                messages.clear()

    def take_verdict(self, verdict: Verdict) -> None:
        """One operating point; its text is worked out with those that follow."""
        if self._wants(verdict.time_ns):
            self._verdicts[verdict.bearing].append(verdict)

    def take_event(self, event: Event) -> None:
        """One JSON warning."""
        if self._wants(event.time_ns):
            data = encode_string(event_json(event))
            self._pending[f'/{NODE}/warnings'].append((event.time_ns, data))

    def _wants(self, time_ns: int) -> bool:
        """Whether a time lies in the spans: nothing else is encoded."""
        return bool(self._spans.overlap(time_ns, time_ns))

    def _sample(self, number: int, time_ns: int, value: float) -> None:
        self._pass_time(time_ns)
        self._heard_ns = max(self._heard_ns, min(time_ns, self._end_ns))
        name, place, _ = self.inputs[number]
        update = self._session.take(name, place, time_ns, value, Moment(time_ns, time_ns))
        self._due.update(event.time_ns for event in update.events)

    def _advance(self, time_ns: int) -> None:
        for name in self._bearings:
            self._session.pass_time(name, time_ns, Moment(time_ns, time_ns))

    def _pass_time(self, until_ns: int) -> None:
        """Write the state of every second, and of each change, before a time [ns]."""
        if until_ns <= self._ticked_ns + 1:
            return
        until_ns = min(until_ns, self._end_ns + 1)
        losses = {time_ns for b in self._bearings.values() for time_ns in _loss(b, until_ns)}
        # Every second of the recording, but not of a long silence.
        passed = -(-(self._ticked_ns + 1 - self._start_ns) // TICK_NS)
        last = min(until_ns - 1, self._heard_ns + SILENCE_NS)
        seconds = range(self._start_ns + TICK_NS * passed, last + 1, TICK_NS)
        for time_ns in sorted({*seconds, *self._due, *losses}):
            if self._ticked_ns < time_ns < until_ns and self._wants(time_ns):
                # A loss counts from the nanosecond after it fell due.
                self._diagnose(time_ns, time_ns + (time_ns in losses))
        self._ticked_ns = until_ns - 1
        self._due = {t for t in self._due if t >= until_ns}

    def _diagnose(self, time_ns: int, seen_ns: int) -> None:
        """Write, at a time, the state of the bearings at another if nothing comes [ns]."""
        probes = [bearing.copy() for bearing in self._bearings.values()]
        for probe in probes:
            probe.advance(seen_ns)
        records = [diagnostic_record(NODE, BearingState(probe)) for probe in probes]
        fields = [
            StatusFields(r.level, r.name, r.message, r.hardware_id, r.values) for r in records
        ]
        self._pending['/diagnostics'].append((time_ns, encode_diagnostics(time_ns, fields)))


def _loss(bearing: BearingMonitor, until_ns: int) -> Iterator[int]:
    """When an input that counts is lost before a time [ns], if nothing comes."""
    state = bearing.state
    if state.now != NEVER and not state.lost:
        lost_ns = max(standing_until(state, bearing.settings.live), state.now)
        if lost_ns < until_ns - 1:
            yield lost_ns


def _of_verdicts(
    bearing: BearingConfig, verdicts: Sequence[Verdict]
) -> Iterator[tuple[str, Sequence[bytes]]]:
    """What the topics of a bearing say of n verdicts, n messages each, by their last part."""
    points = assessed(
        bearing,
        known_table(bearing.bearing),
        np.array([verdict.speed for verdict in verdicts]),
        np.array([verdict.load for verdict in verdicts]),
        np.array([verdict.chances for verdict in verdicts]).T,
    )
    for name in topic_numbers(bearing):
        values = getattr(points, name)
        if name.startswith('amplitude'):
            values = np.where(np.isnan(values), 0.0, values)  # there is no cycle
        yield name, encode_float64s(values)
    regimes, measured = points.regime.tolist(), [str(verdict.measured) for verdict in verdicts]
    words = {'regime': regimes, 'measured': measured}
    for name in topic_words(bearing):
        encoded = {word: encode_string(word) for word in set(words[name])}
        yield name, [encoded[word] for word in words[name]]
