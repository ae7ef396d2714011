# SPDX-License-Identifier: Apache-2.0
"""Makes messages of the verdicts on a recording, as the node would have published them.

The numbers are columns of the pass over the recording. A state of the bearings, every second and at every
change, is that after all samples that had arrived by then: a second scan follows the first, and stops there.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from stickslip_logs.recordings.chunk_writer import Messages
from stickslip_logs.recordings.recording import Message, Recording, TimeSpans
from stickslip_logs.recordings.writer import (
    BagWriter,
    StatusFields,
    encode_diagnostics,
    encode_string,
    float64_rows,
)
from stickslip_logs.units import SECOND_NS
from stickslip_monitor.arrays import BoolArray, FloatArray, IndexArray, IntArray
from stickslip_monitor.errors import BagError
from stickslip_monitor.monitor import rule
from stickslip_monitor.monitor.assessment import REGIMES, Assessment, Assessments, assess
from stickslip_monitor.monitor.bearing_monitor import BearingMonitor
from stickslip_monitor.monitor.bearing_records import (
    POINT_NUMBERS,
    BearingState,
    diagnostic_record,
    event_json,
    output_topics,
    topic_number,
    topic_numbers,
    topic_words,
)
from stickslip_monitor.monitor.input_faults import SourceFault, SourceWatch, least_gap, mixed_sentence
from stickslip_monitor.monitor.parameters import BearingConfig, MonitorConfig
from stickslip_monitor.monitor.rule import si_value
from stickslip_monitor.monitor.rule_over_arrays import BearingScan, Scan, count_statuses
from stickslip_monitor.monitor.rule_state import NEVER, State
from stickslip_monitor.monitor.sample_types import INPUTS, QUANTITIES, Input, Status, Stream
from stickslip_monitor.monitor.severity import MEASURED, Condition
from stickslip_monitor.monitor.statements import Event, Verdict
from stickslip_monitor.offline.check import BearingSamples, Stretch, StretchSink, pays_to_compile

NODE = 'stickslip_monitor'
TICK_NS = SECOND_NS
"""Time between two diagnostics [ns]."""
SILENCE_NS = 3600 * SECOND_NS
"""Diagnostics of a longer silence end [ns]: a clock that was wrong for one message would else
make them for years."""
ALWAYS = TimeSpans([(0, int(np.iinfo(np.int64).max))])
"""All times that a recording can have."""


class MessageColumn(NamedTuple):
    """Messages of one topic: n log times [ns], and as many messages in CDR."""

    topic: str
    type: str
    time_ns: IntArray
    payload: Messages


def check_target(path: str | Path) -> Path:
    """Return the path for a new recording of verdicts, a single MCAP file.

    Raises:
        BagError: The name does not end in ``.mcap``, or the file exists.
    """
    path = Path(path)
    if path.suffix != '.mcap':
        raise BagError(f"recording of verdicts '{path}' must end in .mcap")
    if path.exists():
        raise BagError(f"bag '{path}' exists already and is not overwritten")
    return path


class VerdictWriter(StretchSink):
    """Writes the inputs of a recording and the verdicts on them as one MCAP file.

    It is a context manager: the file appears where the pass comes to its end.

    Args:
        path: Where to; a name ending in ``.mcap`` that is not there yet.

    Raises:
        BagError: It cannot be written.
    """

    def __init__(self, path: str | Path) -> None:
        self._writer = BagWriter(check_target(path))

    def __enter__(self) -> VerdictWriter:
        """Start writing to a draft beside the target."""
        self._writer.__enter__()
        return self

    def __exit__(self, *error: Any) -> None:
        """Move the draft to the target, or delete it after an error."""
        self._writer.__exit__(*error)

    def begin(self, bag: Recording, config: MonitorConfig, start_ns: int | None) -> None:
        """Define the topics in the file and start reading the inputs.

        ``start_ns`` is the recording's start on the clock of the samples [ns], ``None`` if it is empty.

        Raises:
            BagError: The definition of an input, or the first message, cannot be read; or the disk does not
                take the definitions.
        """
        for topic, kind, definition in topics(bag, config):
            self._writer.add_topic(topic, kind, definition)
        self._inputs = bag.messages(input_topics(bag, config))
        self._next = next(self._inputs, None)
        self._messages = VerdictMessages(config, start_ns, pays_to_compile(bag, config))

    def take(self, stretch: Stretch) -> None:
        """Write the messages of a stretch, inputs before verdicts.

        Raises:
            BagError: An input cannot be read, or the disk does not take the messages.
        """
        columns = [*columns_of(self._messages_until(stretch.end_ns)), *self._messages.encode_stretch(stretch)]
        self._writer.write_columns((column.topic, column.time_ns, column.payload) for column in columns)

    def _messages_until(self, end_ns: int) -> Iterator[Message]:
        """Yield the recorded inputs not yet yielded, up to and with a log time [ns].

        The next call continues.
        """
        while self._next is not None and self._next.log_time_ns <= end_ns:
            yield self._next
            self._next = next(self._inputs, None)


def topics(bag: Recording, config: MonitorConfig) -> Iterator[tuple[str, str, str | None]]:
    """Yield name, type and definition of every input, then verdict topic; None for a built-in definition.

    Raises:
        BagError: The definition of an input cannot be read.
    """
    for name in input_topics(bag, config):
        yield name, bag.topics[name].type, bag.definition(name)
    for name, kind in output_topics(config.bearings, f'/{NODE}').items():
        yield name, kind, None


def input_topics(bag: Recording, config: MonitorConfig) -> list[str]:
    """Return the topics that the bearings read and the recording has, each once, in their inputs' order."""
    wanted = dict.fromkeys(i.topic for b in config.bearings for i in b.inputs.values())
    return [name for name in wanted if name in bag.topics]


def columns_of(messages: Iterator[Message]) -> Iterator[MessageColumn]:
    """Read all messages of an iterator, then yield a column for each topic and type, as they first come."""
    columns: dict[tuple[str, str], list[tuple[int, bytes]]] = {}
    for message in messages:
        rows = columns.setdefault((message.topic, message.type), [])
        rows.append((message.log_time_ns, message.data))
    for (topic, kind), items in columns.items():
        yield _make_column(topic, kind, items)


def _make_column(topic: str, kind: str, messages: Sequence[tuple[int, bytes]]) -> MessageColumn:
    """Return a column of messages of a type, each with its log time [ns]; there is one at least."""
    times, payload = zip(*messages, strict=True)
    return MessageColumn(topic, kind, np.array(times), payload)


class VerdictMessages:
    """Makes the messages of one stretch of a recording after the other.

    A verdict has its own time, that of the later of its two measurements.

    Args:
        config: The configuration, as it holds for the recording.
        start_ns: Start of the recording on the clock of the samples, from which inputs are waited for [ns];
            None if it is empty.
        long: Whether the rule runs compiled.
    """

    def __init__(self, config: MonitorConfig, start_ns: int | None, long: bool) -> None:
        self._kinds = output_topics(config.bearings, f'/{NODE}')
        period_ns = round(config.publish_period * 1e9)
        self._bearings = {
            bearing.name: _Follower(bearing, start_ns, period_ns, long) for bearing in config.bearings
        }
        self._start_ns = start_ns or 0
        self._ticked_ns = self._received_ns = self._start_ns - 1
        self._due: list[Event] = []

    def encode_stretch(self, stretch: Stretch, spans: TimeSpans = ALWAYS) -> Iterator[MessageColumn]:
        """Yield the messages of a stretch, one column for each topic that has any.

        The bearings are followed as the columns are taken: take all before the next stretch.

        Args:
            stretch: The stretch, after all that came before it.
            spans: The times that are wanted: nothing else is encoded.
        """
        events = events_of(stretch)
        for name, samples in stretch.bearings.items():
            time_ns, columns = self._bearings[name].encode_topics(samples.scan, spans)
            for last, payload in columns:
                topic = f'/{NODE}/{name}/{last}'
                yield MessageColumn(topic, self._kinds[topic], time_ns, payload)
        published = [e for e in events if spans.overlap(e.time_ns, e.time_ns)]
        if published:
            texts = [(event.time_ns, encode_string(event_json(event))) for event in published]
            yield self._of_topic(f'/{NODE}/warnings', texts)
        yield from self._diagnostic_columns(stretch, events, spans)

    def _of_topic(self, topic: str, messages: Sequence[tuple[int, bytes]]) -> MessageColumn:
        """Return a column of messages of one of the outputs, each with its time [ns]."""
        return _make_column(topic, self._kinds[topic], messages)

    def _diagnostic_columns(
        self, stretch: Stretch, events: Sequence[Event], spans: TimeSpans
    ) -> Iterator[MessageColumn]:
        """Yield one column of /diagnostics: at every second, change and loss within the spans.

        Yields nothing if there are none. Stores the changes after the stretch, and the time up to which it
        went.
        """
        arrivals = [samples.stream.arrival_ns for samples in stretch.bearings.values()]
        is_last = not any(arrival.size for arrival in arrivals)
        # More may have arrived at the same time.
        until_ns = stretch.end_ns - (not is_last)
        self._due += events
        lost = {e.time_ns for e in self._due if e.after is Condition.INPUT_STALE}
        for name, samples in stretch.bearings.items():
            lost.update(self._bearings[name].loss_times(samples))
        seconds = self._seconds_until(np.sort(np.concatenate(arrivals)), until_ns)
        ticks = sorted(
            t
            for t in {*seconds, *lost, *(e.time_ns for e in self._due)}
            if self._ticked_ns < t <= until_ns and spans.overlap(t, t)
        )
        # A loss counts from the nanosecond after it fell due.
        seen = [t + (t in lost) for t in ticks]
        self._due = [event for event in self._due if event.time_ns > until_ns]
        self._ticked_ns = max(self._ticked_ns, until_ns)
        states = [
            self._bearings[name].states(samples, ticks, seen) for name, samples in stretch.bearings.items()
        ]
        messages = [(t, encode_diagnostics(t, fields)) for t, *fields in zip(ticks, *states, strict=True)]
        if messages:
            yield self._of_topic('/diagnostics', messages)

    def _seconds_until(self, arrival_ns: IntArray, until_ns: int) -> Iterator[int]:
        """Yield whole seconds since the start, up to and with a time [ns], but none after a silent hour.

        They follow the ticks of earlier stretches. The last of the arrivals [ns], which ascend, is stored.
        """
        times = np.concatenate([[self._received_ns], arrival_ns, [until_ns + 1]])
        self._received_ns = int(times[-2])
        silent = np.flatnonzero(np.diff(times) > SILENCE_NS)
        begins = [self._ticked_ns + 1, *times[silent + 1].tolist()]
        ends = [*(times[silent] + SILENCE_NS).tolist(), until_ns]
        for begin, end in zip(begins, ends, strict=True):
            passed = -(-(begin - self._start_ns) // TICK_NS)
            yield from range(self._start_ns + TICK_NS * passed, end + 1, TICK_NS)


def events_of(stretch: Stretch) -> list[Event]:
    """Return the changes of all bearings' alarms in a stretch, in order of time."""
    events = [event for samples in stretch.bearings.values() for event in samples.scan.events]
    return sorted(events, key=lambda event: event.time_ns)


class _Follower:
    """Makes the messages of one bearing: its verdicts, and its state at some times.

    Args:
        config: The bearing.
        start_ns: Start of the recording, from which inputs are waited for [ns]; None if it is empty.
        period_ns: Time between two verdicts to publish [ns]; 0 for all.
        long: Whether the rule runs compiled.
    """

    def __init__(self, config: BearingConfig, start_ns: int | None, period_ns: int, long: bool) -> None:
        self._config, self._period_ns = config, period_ns
        self._scan = BearingScan(config, start_ns, long=long)
        self._bearing = BearingMonitor(config)
        self._counts = np.zeros((len(Input), len(Status)), np.int64)
        self._sources = [SourceWatch(least_gap(config, place)) for place, _ in enumerate(QUANTITIES)]
        self._changed: set[int] = set()
        self._published_ns: int | None = None

    def encode_topics(self, scan: Scan, spans: TimeSpans) -> tuple[IntArray, Iterator[tuple[str, Messages]]]:
        """Encode the verdicts of the next part that are published and lie in spans.

        Stores the latest published one, also outside the spans.

        Returns:
            The times of the verdicts [ns], shape (n,); and an iterator of the last word of each topic with
            its n messages, encoded one topic after the other. Both are empty if no verdict is published.
        """
        rows = np.flatnonzero(self._choose_published(scan) & spans.holds(scan.time_ns))
        if not rows.size:
            return rows, iter(())
        points = scan.assessment
        if rows.size < scan.time_ns.size:
            # points.at would compute the numbers of all points, also of those that are not published.
            points = scan.assessed(rows)
        return scan.time_ns[rows], self._encode_points(points, scan.measured, rows)

    def _encode_points(
        self, points: Assessments, measured: Any, rows: IndexArray
    ) -> Iterator[tuple[str, Messages]]:
        """Yield the last word of each topic of the bearing and its encoded messages on some points.

        Args:
            points: The points that are encoded.
            measured: What a level measured at each point of the scan, as an index of :data:`.MEASURED`; None
                without a level.
            rows: The indices of the points in the scan, shape (n,).
        """
        for name in topic_numbers(self._config):
            yield name, float64_rows(topic_number(name, points))
        for name in topic_words(self._config):
            names, codes = (REGIMES, points.regime_code) if name == 'regime' else (MEASURED, measured[rows])
            encoded = [encode_string(str(word)) for word in names]
            yield name, [encoded[code] for code in codes.tolist()]

    def _choose_published(self, scan: Scan) -> BoolArray:
        """Return which verdicts are published: one in each period, and all with a change; shape (n,).

        Without a period all are. Stores the latest published one, and the samples that brought changes.
        """
        is_published = np.ones(scan.time_ns.size, np.bool_)
        if not self._period_ns:
            return is_published
        self._changed.update(scan.at)
        for k, (time, sample) in enumerate(zip(scan.time_ns.tolist(), scan.sample.tolist(), strict=True)):
            before = self._published_ns
            if sample in self._changed or before is None or not (0 <= time - before < self._period_ns):
                self._published_ns = time
            else:
                is_published[k] = False
        return is_published

    def loss_times(self, samples: BearingSamples) -> list[int]:
        """Return the time at which the first input times out [ns] as a list of one.

        The list is empty if the part has samples, if nothing was received before it, or if an input is lost
        already.
        """
        state = self._scan.state
        if samples.stream.time_ns.size or state.now == NEVER or state.lost:
            return []
        until = max(rule.standing_until(state, self._scan.settings.live), state.now)
        return [until - state.shift]

    def states(
        self, samples: BearingSamples, ticks: Sequence[int], seen: Sequence[int]
    ) -> list[StatusFields]:
        """Follow the bearing over a part, and return its diagnostic status at each of some times.

        Scan, counts and the watches of the sources go on to the end of the part.

        Args:
            samples: The part.
            ticks: Times, ascending [ns]: all samples that had arrived by then count.
            seen: At which time each state is judged [ns]: the tick, or just after it for a loss.
        """
        ends = np.searchsorted(samples.stream.arrival_ns, ticks, 'right')
        memories = list(self._scan.memories(samples.stream, ends.tolist()))
        points = self._assess_points([point for _, point in memories if point is not None])
        counts, mixed = self._count_samples(samples, ends), self._mixed_reasons(samples, ends, ticks)
        return [
            self._status_fields(state, None if point is None else next(points), count, why, time_ns)
            for (state, point), count, why, time_ns in zip(memories, counts, mixed, seen, strict=True)
        ]

    def _assess_points(self, points: Sequence[FloatArray]) -> Iterator[Assessment]:
        """Yield the assessment of each point. All numbers are computed at the first.

        Args:
            points: For each an array of speed [m/s], load [N], water [C], and chances if any.
        """
        if points:
            speed, load, water, *chances = np.array(points).T
            config, table = self._config, self._bearing.settings.boundaries
            temperature = None if config.water_temperature is None else water
            together = assess(config.bearing, speed, load, config.belief, table, chances, temperature)
            for name in POINT_NUMBERS:
                getattr(together, name)  # computed and stored, for all points at once
            yield from (together.at(k) for k in range(len(points)))

    def _count_samples(self, samples: BearingSamples, ends: IntArray) -> IntArray:
        """Count the samples by input and status up to each end in a part, shape (ends, inputs, statuses).

        An end is how many samples of the part had arrived, repeats with them. All before the part counts,
        repeats do not. Adds the whole part to the stored counts.
        """
        kinds = samples.stream.inputs.astype(np.int64) * len(Status) + samples.scan.status
        counted = ~samples.repeats
        counts = np.zeros((ends.size, self._counts.size), np.int64)
        for kind in np.unique(kinds[counted]).tolist():
            counts[:, kind] = np.searchsorted(np.flatnonzero(counted & (kinds == kind)), ends)
        totals = counts.reshape(-1, *self._counts.shape) + self._counts
        self._counts += count_statuses(samples.stream.inputs[counted], samples.scan.status[counted])
        return totals

    def _mixed_reasons(
        self, samples: BearingSamples, ends: IndexArray, ticks: Sequence[int]
    ) -> Iterator[str]:
        """Return an iterator, for each time, of the sentence that an input has two sources; '' if none has.

        ``ends`` counts the samples that had arrived at each of ``ticks`` [ns]. Advances the watches at once.
        """
        stream, valid = samples.stream, samples.scan.status == Status.ACCEPTED
        standing = [
            self._standing_faults(
                place, stream, np.flatnonzero(valid & (stream.inputs == place)), ends, ticks
            )
            for place, _ in enumerate(self._sources)
        ]
        return (mixed_sentence(self._config, faults) for faults in zip(*standing, strict=True))

    def _standing_faults(
        self, place: int, stream: Stream, rows: IndexArray, ends: IndexArray, ticks: Sequence[int]
    ) -> list[SourceFault | None]:
        """Return the fault of an input's source at each time, and advance its watch to the end of the part.

        Args:
            place: The number of the input.
            stream: The samples of the part.
            rows: Indices of the input's valid samples in it.
            ends: How many samples of the stream had arrived at each time.
            ticks: The times [ns], ascending.

        Returns:
            For each time the fault, None without one or for an assumed load.
        """
        if self._config.inputs[INPUTS[place]].is_assumed:
            return [None] * len(ticks)
        watch, arrival_ns = self._sources[place], stream.arrival_ns[rows]
        si = si_value(self._bearing.settings.live, place, stream.value[rows])
        if watch.take_steady(si):
            return [None] * len(ticks)
        faults, begin = [], 0
        for end, tick in zip(np.searchsorted(rows, ends).tolist(), ticks, strict=True):
            watch.take_column(arrival_ns[begin:end], si[begin:end])
            faults.append(watch.standing_fault(tick))
            begin = end
        watch.take_column(arrival_ns[begin:], si[begin:])
        return faults

    def _status_fields(
        self, state: State, point: Assessment | None, counts: IntArray, mixed: str, time_ns: int
    ) -> StatusFields:
        """Return the diagnostic status of the bearing in a saved state, as judged at a time [ns].

        ``point`` is its last assessment, None before the first; ``mixed`` the sentence on two sources.
        """
        bearing = copy.copy(self._bearing)
        bearing.state, bearing.counts = state, counts
        if point is not None:
            bearing.verdict = Verdict(self._config.name, state.now - state.shift, lambda: point)
        bearing.advance(time_ns)
        record = diagnostic_record(NODE, BearingState(bearing, mixed=mixed))
        return StatusFields(record.level, record.name, record.message, record.hardware_id, record.values)
