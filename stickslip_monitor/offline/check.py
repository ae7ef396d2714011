# SPDX-License-Identifier: Apache-2.0
"""Checks a recording in one pass: runs the monitor over every bearing, and passes the verdicts on.

Each stretch of a recording goes once through the rule. Its verdicts are added up here and passed to sinks,
which write messages or clips or keep what they need; so memory does not grow with the recording unless a
sink's does. :func:`to_json` makes the record of the result, from which JSON, text and report are made.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from stickslip_logs.recordings.log_time_scale import LogTimes
from stickslip_logs.recordings.reader import open_bag
from stickslip_logs.recordings.recording import Fault, Progress, Recording, Request, Series
from stickslip_logs.tables.time_columns import WITHOUT_ZONE
from stickslip_monitor import jit
from stickslip_monitor.arrays import BoolArray, FloatArray
from stickslip_monitor.errors import BagError
from stickslip_monitor.monitor.assessment import REGIMES, Regime
from stickslip_monitor.monitor.bearing_records import event_record, finite_or_none
from stickslip_monitor.monitor.input_fitness import FitnessWatch
from stickslip_monitor.monitor.level_comparison import LevelComparison, add_rivals
from stickslip_monitor.monitor.parameters import BearingConfig, MonitorConfig
from stickslip_monitor.monitor.rule_over_arrays import LONG, BearingScan, Scan, count_statuses, join_scans
from stickslip_monitor.monitor.sample_types import INPUTS, LEVEL, Stream
from stickslip_monitor.monitor.severity import MEASURED
from stickslip_monitor.monitor.statements import Event, duration_text
from stickslip_monitor.offline.extremes import Extreme, Extremes, Outline, OutlineBuilder, sum_durations
from stickslip_monitor.offline.held_values import HeldValues
from stickslip_monitor.offline.input_binding import bind_at_least_one
from stickslip_monitor.offline.input_columns import Bound, quantity_hint
from stickslip_monitor.offline.input_report import COARSE, HOLDS, Gap, InputCheck, InputReport, Plausibility

SCHEMA = 'stickslip_monitor/check/3'
_NONE, _NO_NUMBERS = np.array([], np.int64), np.array([])
_NOTHING = Series(_NONE, _NONE, _NONE, _NO_NUMBERS, ())
_SILENCE = Stream(_NONE, np.array([], np.int8), _NO_NUMBERS)


@dataclass(frozen=True, slots=True)
class BearingReport:
    """Result of the monitor for one bearing over a recording."""

    name: str
    events: list[Event]  # all changes of the alarm, in order
    evaluations: int  # operating points
    seconds: dict[Regime, float]  # in each regime; without a usable point: undetermined
    worst: dict[str, Extreme]  # least margins and greatest amplitude, where there is one
    inputs: tuple[InputReport, ...]
    measured: dict[str, float] | None = None  # time [s] by what a level measured
    outline: Outline | None = None  # of its verdicts, where it was asked for

    @property
    def complaints(self) -> list[str]:
        """Faults of the samples, one clause for each kind; empty if there are none."""
        return [text for item in self.inputs for text in item.complaints]


@dataclass(frozen=True, slots=True)
class CheckReport:
    """The result of checking one bag; without messages it has no start and no end."""

    bag: Recording
    config: MonitorConfig  # as it holds for the recording
    bearings: dict[str, BearingReport]  # by name
    start_ns: int | None  # on the clock of the samples
    end_ns: int | None
    complete: bool  # whether all of it was read


@dataclass(frozen=True, slots=True)
class BearingSamples:
    """Samples and verdicts of a bearing in a part of a recording."""

    stream: Stream  # the samples in order of arrival, with repeats of values that stand
    repeats: BoolArray  # which of them are such repeats, shape (m,)
    scan: Scan  # the verdicts that are known with them


@dataclass(frozen=True, slots=True)
class Stretch:
    """A stretch of a recording; the last one has no samples, and the verdicts at the end."""

    end_ns: int  # the last log time in it [ns]
    bearings: Mapping[str, BearingSamples]  # by name


class StretchSink:
    """Base of what receives the stretches of a checked recording with their verdicts; ignores them.

    It takes arrays, and is no :class:`.session.Sink`, whose object for each verdict takes longer than the
    check.
    """

    def begin(self, bag: Recording, config: MonitorConfig, start_ns: int | None) -> None:
        """Begin a recording, before its first stretch.

        ``start_ns`` is its start on the clock of the samples [ns], None if it is empty.
        """

    def take(self, stretch: Stretch) -> None:
        """Take the next stretch."""

    def finish(self) -> None:
        """Finish, after all stretches were taken; not called where an error ended the check."""


def check_recording(
    path: str | Path,
    config: MonitorConfig,
    sinks: Sequence[StretchSink] = (),
    progress: Progress | None = None,
    *,
    outlined: bool = False,
    long: bool | None = None,
) -> CheckReport:
    """Run the monitor over a recording, once.

    Args:
        path: The recording.
        config: The configuration; its topics must be in the recording.
        sinks: Take the samples and the verdicts; each is begun and finished, unless an error ends the check.
        progress: Called with how much is read and how much there is, as of :data:`.Progress`.
        outlined: Whether the outlines of the verdicts are kept, to be drawn.
        long: Whether the rule runs compiled; ``None``: as :func:`pays_to_compile` has it.

    Returns:
        The report. Notes on guessed columns and sparse samples, and losses of inputs, are added to its bag.

    Raises:
        BagError: The recording cannot be read, is empty, or has no bearing with both speed and load.
        OSError: A file of it was removed after it was opened.
        Exception: Any error of a sink passes through, as a BagError for a file that cannot be written.
    """
    bag = open_bag(path)
    if bag.files and not any(file.stat().st_size for file in bag.files):
        raise BagError(f"bag '{path}' is empty: 0 bytes")
    bound = bind_at_least_one(bag, config)
    config, times = bound.config, LogTimes()
    long = pays_to_compile(bag, config) if long is None else long
    checks = {bearing.name: _BearingCheck(bearing, bound, outlined, long) for bearing in config.bearings}
    reading = bag.reading({r for item in checks.values() for r in item.requests if r}, progress)
    # When it begins and ends is known when the order of what is read has been judged.
    span = SampleSpan(bag)
    is_begun = False
    for stretch in _judge_stretches(times.correct_parts(reading), times, span, bag, checks, long):
        for sink in sinks:
            # The start is known when the order of what is read first has been judged.
            if not is_begun:
                sink.begin(bag, config, span.start_ns)
            sink.take(stretch)
        is_begun = True
    for sink in sinks:
        sink.finish()
    faults = reading.faults()
    reports = {name: item.report(span, faults, times.text) for name, item in checks.items()}
    inputs = [(name, item) for name, report in reports.items() for item in report.inputs[:2]]
    _note_pace(bag, inputs)
    for _, item in inputs:
        if item.loss:
            bag.lose(item.loss)
    complete = not (bag.losses or any(faults.values()))
    return CheckReport(bag, config, reports, span.start_ns, span.end_ns, complete)


def _judge_stretches(
    reading: Iterable[Mapping[Request, Series]],
    times: LogTimes,
    span: SampleSpan,
    bag: Recording,
    checks: Mapping[str, _BearingCheck],
    long: bool,
) -> Iterator[Stretch]:
    """Run the rule over all parts of a reading, and yield each with its verdicts.

    Extends the span, and adds the verdicts up in the checks. After the parts come values that stand to the
    end, if any, and always a last stretch without samples.

    Args:
        reading: The parts as they are to be judged.
        times: Has, once a part is read, whether its stamps replace the log times.
        span: Start and end of the recording.
        bag: The recording.
        checks: What judges each bearing, by name.
        long: Whether levels are compared by compiled code.
    """
    comparison = LevelComparison([item.config for item in checks.values()], long=long)

    def take_part(part: Mapping[Request, Series], end_ns: int | None) -> dict[str, BearingSamples]:
        """Run the rule over a part up to a log time [ns], after its levels were compared."""
        levels = {name: item.level_series(part) for name, item in checks.items()}
        rivals = comparison.take_columns(
            {name: (s.sequence, s.log_time_ns, s.value) for name, s in levels.items() if s is not None}
        )
        return {
            name: item.take(part, span.start_ns, end_ns, rivals.get(name)) for name, item in checks.items()
        }

    for part in reading:
        span.extend(part.values(), are_times_replaced=times.are_replaced)
        ends = (int(series.log_time_ns[-1]) for series in part.values() if series.value.size)
        end_ns = max(ends, default=bag.start_ns or 0)
        yield Stretch(end_ns, take_part(part, end_ns))
    last_ns = span.end_ns if times.are_replaced else bag.end_ns
    silence = {r: _NOTHING for item in checks.values() for r in item.requests if r}
    standing = take_part(silence, last_ns)
    if any(samples.repeats.any() for samples in standing.values()):
        yield Stretch(last_ns or 0, standing)
    yield Stretch(last_ns or 0, {name: item.finish(span.end_ns) for name, item in checks.items()})


def _note_pace(bag: Recording, inputs: Sequence[tuple[str, InputReport]]) -> None:
    """Note on the bag where samples are far apart, lack an hour of summer time, or are stored at changes.

    Lines that were sorted within the hour in which summer time ends are lost to the bag.

    ``inputs`` are the reports on speed and load of each bearing, with its name.
    """
    coarse = max((item.gaps.usual for _, item in inputs if item.gaps.usual >= COARSE), default=0.0)
    if coarse > 0.0:
        bag.note(f'samples are {coarse:.4g} s apart: stick-slip shorter than some minutes cannot be seen')
    gaps = [(gap, item.gaps.usual) for _, item in inputs for gap in item.gaps.longest]
    if WITHOUT_ZONE in bag.warnings and any(_is_summer_hour(gap, usual) for gap, usual in gaps):
        bag.note(
            'no lines for one hour, from one full hour to the next, as when summer time begins: write the'
            ' times in UTC'
        )
    usual = min((item.gaps.usual for _, item in inputs), default=math.nan)
    is_sorted = any(text.endswith(': sorted by time') for text in bag.warnings)
    if WITHOUT_ZONE in bag.warnings and is_sorted and _fills_clock_hour(bag, usual):
        bag.lose(
            'the sorted lines fill one hour of the clock, as where summer time ended and they were in order:'
            ' write the times in UTC'
        )
    for name, item in inputs:
        if item.changes_only:
            longest = item.gaps.longest[0].seconds
            hold = next((nice for nice in HOLDS if nice >= longest), HOLDS[-1])
            bag.note(
                f'{item.quantity} on {item.topic} seems to be stored only where it changes: no value is that'
                f' before it, and gaps of up to {duration_text(longest)} have {item.gaps.share():.0%} of the'
                f' time; let values stand by {name}.{item.quantity}.hold: {hold}'
            )


def _fills_clock_hour(bag: Recording, usual: float) -> bool:
    """Return whether lines, a usual interval [s] apart, fill one hour of the clock but for two of these."""
    first, last = ((time_ns or 0) * 1e-9 for time_ns in (bag.start_ns, bag.end_ns))
    return first // 3600.0 == last // 3600.0 and last - first >= 3600.0 - 2.0 * usual


def _is_summer_hour(gap: Gap, usual: float) -> bool:
    """Return whether a gap is that of an hour skipped by the clock.

    It begins at most one usual interval [s] before a full hour, and lasts an hour and up to two of these.
    """
    before = -gap.start_ns * 1e-9 % 3600.0
    return before <= usual and 0.0 < gap.seconds - 3600.0 <= 2.0 * usual


class _BearingCheck:
    """Runs the monitor over one bearing's samples and adds up its verdicts.

    Args:
        config: The bearing, as it holds for the recording.
        bound: Why inputs are absent, and the questions on them.
        outlined: Whether the outline of the verdicts is kept, to be drawn.
        long: Whether the rule runs compiled.
    """

    def __init__(self, config: BearingConfig, bound: Bound, outlined: bool, long: bool) -> None:
        self.config, self._long = config, long
        absent = [bound.absent.get((config.name, of), '') for of in config.inputs]
        self.requests = [
            None if text else request for request, text in zip(requests_of(config), absent, strict=True)
        ]
        """What is read for each input; ``None`` for one that is not in the recording."""
        self._questions = {of: text for (name, of), text in bound.questions.items() if name == config.name}
        self._scan: BearingScan | None = None
        self._held = HeldValues(config)
        self._outline_builder = OutlineBuilder(config) if outlined else None
        self._inputs = [InputCheck(config, k, text) for k, text in zip(config.places, absent, strict=True)]
        self._plausibility, self._fitness = Plausibility(config), FitnessWatch()
        self._extremes = Extremes()
        self._events: list[Event] = []
        self._evaluations = 0
        self._measured_ns = np.zeros(len(MEASURED), np.int64)

    def level_series(self, part: Mapping[Request, Series]) -> Series | None:
        """Return the samples of the level in a part; ``None`` where the recording has none."""
        requests = dict(zip(self.config.places, self.requests, strict=True))
        request = requests.get(LEVEL)
        return None if request is None else part[request]

    def take(
        self,
        part: Mapping[Request, Series],
        start_ns: int | None,
        end_ns: int | None,
        rivals: FloatArray | None = None,
    ) -> BearingSamples:
        """Run the rule over the next part, add up its verdicts and what its inputs are like, and return them.

        Args:
            part: The samples read since the last part.
            start_ns: Start of the recording on the clock of the samples [ns]; used with the first part.
            end_ns: Last log time of the part [ns], up to which held values are repeated; None: no repeats.
            rivals: Excess of the loudest other level at each level of the part [dB]; None: there is none.
        """
        series = [_NOTHING if request is None else part[request] for request in self.requests]
        stream, repeats = self._held.fill(merge_series(series, self.config.places), end_ns)
        stream = add_rivals(stream, rivals)
        if self._scan is None:
            self._scan = BearingScan(self.config, start_ns, long=self._long)
        scan = self._scan.take(stream)
        if repeats.any():
            repeated = count_statuses(stream.inputs[repeats], scan.status[repeats])
            scan = replace(scan, counts=scan.counts - repeated)
        self._add_scan(scan)
        for input_check, input_series in zip(self._inputs, series, strict=True):
            input_check.take(input_series, stream, scan, self._fitness)
        return BearingSamples(stream, repeats, scan)

    def finish(self, end_ns: int | None) -> BearingSamples:
        """Run the rule to the end of the recording [ns]; add up and return the verdicts, without samples.

        They are stored for :meth:`report`. There was one part at least.
        """
        assert self._scan is not None
        self._end = self._scan.finish(_SILENCE, end_ns)
        self._add_scan(self._end)
        return BearingSamples(_SILENCE, np.zeros(0, np.bool_), self._end)

    def _add_scan(self, scan: Scan) -> None:
        """Add the points and events of a scan to the totals of the bearing."""
        self._events += scan.events
        self._evaluations += scan.time_ns.size
        if not self.config.load.is_assumed:
            self._fitness.take_points(scan.time_ns, scan.speed, scan.load)
        self._plausibility.take(scan.speed, scan.load, scan.fold_speed)
        self._extremes.take(scan)
        if scan.measured is not None:
            self._measured_ns += sum_durations(scan.measured, scan.until_ns - scan.time_ns, len(MEASURED))
        if self._outline_builder is not None:
            self._outline_builder.add_scan(scan)

    def report(
        self, span: SampleSpan, faults: Mapping[Request, tuple[Fault, ...]], clock: str
    ) -> BearingReport:
        """Return the report on the whole recording, after :meth:`finish`.

        Args:
            span: Start and end; time without a verdict counts as undetermined.
            faults: The faults of messages, by what was read.
            clock: The fault of the recording's clock for every input; '' if it has none.
        """
        known_ns = self._extremes.lasting_ns
        seconds = dict(zip(REGIMES, (known_ns * 1e-9).tolist(), strict=True))
        silent_ns = max(0, span.length_ns - int(known_ns.sum()))
        seconds[Regime.UNDETERMINED] += silent_ns * 1e-9
        nearest = self._extremes.worst.get('fold_margin')
        questions = self._plausibility.questions(math.inf if nearest is None else 1.0 + nearest.value)
        for place in range(LEVEL + 1):
            questions.setdefault(INPUTS[place], []).extend(filter(None, [self._fitness.clause(place)]))
        pace = self._inputs[0].gaps.usual
        if pace >= COARSE and seconds[Regime.UNSTABLE] and not self._events:
            lasting = duration_text(seconds[Regime.UNSTABLE])
            questions['speed'].append(
                f'is where stick-slip starts by itself for {lasting}, by single values {pace:.4g} s apart,'
                ' which do not show it: is there a log with one each 10 s or less?'
            )
        if self._end.unknown is not None:
            questions['level'] += [f'says nothing at the end: {self._end.unknown.sentence}']
        if self._end.water_doubt:
            questions['water_temperature'] = [f'is in doubt at the end: {self._end.water_doubt}']
        for quantity, text in self._questions.items():
            questions.setdefault(quantity, []).append(text)
        measured = zip(map(str, MEASURED), (self._measured_ns * 1e-9).tolist(), strict=True)
        return BearingReport(
            self.config.name,
            self._events,
            self._evaluations,
            seconds,
            self._extremes.worst,
            tuple(
                input_check.report(
                    () if request is None else faults[request],
                    tuple(questions.get(input_check.quantity, ())),
                    clock,
                )
                for input_check, request in zip(self._inputs, self.requests, strict=True)
            ),
            None if self.config.level is None else dict(measured),
            None if self._outline_builder is None else self._outline_builder.build(),
        )


def pays_to_compile(bag: Recording, config: MonitorConfig) -> bool:
    """Return whether it pays to run the rule compiled: numba may be used, and the inputs are long.

    The inputs are long with :data:`LONG` messages or more of all bearings together.
    """
    topics = {request.topic for bearing in config.bearings for request in requests_of(bearing)}
    counts = (topic.count for name, topic in bag.topics.items() if name in topics)
    return jit.has_compiler() and sum(counts) >= LONG


def requests_of(config: BearingConfig) -> tuple[Request, ...]:
    """Return the requests to read a bearing's inputs: one for each, in the order of its ``inputs``."""
    return tuple(Request(i.topic, i.field_text, i.type) for i in config.inputs.values())


def merge_series(series: Sequence[Series], places: Sequence[int]) -> Stream:
    """Merge the samples of a bearing's inputs into one stream in the order of the recording.

    Args:
        series: The samples of each input, of at least one.
        places: The number of each input (:class:`.Input`), in the same order.

    Returns:
        The stream, ordered by :attr:`.Series.sequence`; its arrivals are the log times.
    """
    order = np.argsort(np.concatenate([item.sequence for item in series]), kind='stable')
    inputs = np.repeat(np.array(places, np.int8), [item.sequence.size for item in series])
    # Without stamps of their own, as a rule, all have the log times in their place.
    names = ['stamp_ns', 'value', 'log_time_ns']
    columns = [
        np.concatenate([getattr(item, name) for item in series]).take(order)
        for name in (names[:2] if all(item.log_time_ns is item.stamp_ns for item in series) else names)
    ]
    return Stream(
        columns[0], inputs.take(order), columns[1], arrival_ns=columns[-1 if len(columns) > 2 else 0]
    )


class SampleSpan:
    """Start and end of a recording, on the clock of the samples.

    Attributes:
        start_ns: The start [ns]; None without messages.
        end_ns: The end as far as it was read [ns]; None without messages.
    """

    def __init__(self, bag: Recording) -> None:
        self.start_ns, self.end_ns = bag.start_ns, bag.end_ns
        self._begun = False

    def extend(self, series: Iterable[Series], *, are_times_replaced: bool) -> None:
        """Move the end to the last log time of a stretch, if that is later.

        If its log times were replaced, those of the bag do not count: the first stretch with messages sets
        start and end anew. Does nothing without messages.
        """
        nonempty = [item for item in series if item.sequence.size]
        if self.start_ns is None or self.end_ns is None or not nonempty:
            return
        if are_times_replaced and not self._begun:
            self.start_ns = self.end_ns = min(int(item.log_time_ns[0]) for item in nonempty)
        self._begun = True
        self.end_ns = max(self.end_ns, *(int(item.log_time_ns[-1]) for item in nonempty))

    @property
    def length_ns(self) -> int:
        """Time from the start to the end; 0 without messages [ns]."""
        return 0 if self.start_ns is None or self.end_ns is None else self.end_ns - self.start_ns


class RecordingBuffer(StretchSink):
    """Keeps samples and verdicts of a whole recording in memory, for callers that need them at once.

    Attributes:
        bag: The recording.
        start_ns: Its start on the clock of the samples [ns]; None if it is empty.
        end_ns: The end of the recording [ns]; None if it is empty.
    """

    def __init__(self) -> None:
        self._parts: list[Stretch] = []

    def begin(self, bag: Recording, config: MonitorConfig, start_ns: int | None) -> None:
        """Store the recording, its start ``start_ns`` [ns] and its end."""
        self.bag, self.start_ns, self.end_ns = bag, start_ns, bag.end_ns

    def take(self, stretch: Stretch) -> None:
        """Keep the next stretch."""
        self._parts.append(stretch)

    def stream(self, name: str) -> Stream:
        """Return the samples of a bearing in the whole recording, with repeats of values that stand.

        Call it after the check, as :meth:`scan`.

        Raises:
            KeyError: No bearing has this name.
        """
        parts = [part.bearings[name].stream for part in self._parts]
        return Stream(
            **{
                column.name: np.concatenate([getattr(part, column.name) for part in parts])
                for column in fields(Stream)
            }
        )

    def scan(self, name: str) -> Scan:
        """Return the verdicts on a bearing in the whole recording as one scan.

        Raises:
            KeyError: No bearing has this name.
        """
        return join_scans([part.bearings[name].scan for part in self._parts])


def to_json(report: CheckReport) -> dict[str, Any]:
    """Return the report as a JSON object of schema :data:`SCHEMA`."""
    return {
        'schema': SCHEMA,
        **bag_record(report.bag),
        'complete': report.complete,
        'bearings': {name: _bearing_record(item) for name, item in report.bearings.items()},
    }


def bag_record(bag: Recording) -> dict[str, Any]:
    """Return the facts of a recording that need no check as a JSON object: times [ns], duration [s].

    The times and the duration are None without messages.
    """
    start, end = bag.start_ns, bag.end_ns
    return {
        'path': str(bag.path),
        'start': start,
        'end': end,
        'duration': None if start is None or end is None else (end - start) * 1e-9,
        'messages': bag.message_count,
        'topics': {
            name: {
                'type': f'{topic.type}{quantity_hint(topic.type)}',
                'messages': topic.count,
                'problem': topic.problem or None,
            }
            for name, topic in bag.topics.items()
        },
        'cuts': [
            {'file': str(cut.path), 'offset': cut.offset, 'size': cut.size, 'text': cut.text}
            for cut in bag.cuts
        ],
        'warnings': list(bag.warnings),
    }


def _bearing_record(item: BearingReport) -> dict[str, Any]:
    """Return the report on a bearing as a JSON object: SI units, times [ns], None for no number."""
    return {
        'events': [event_record(event) for event in item.events],
        'seconds': {regime.value: seconds for regime, seconds in item.seconds.items()},
        'worst': {
            name: {'time': extreme.time_ns, 'value': finite_or_none(extreme.value)}
            | {
                k: finite_or_none(getattr(extreme.point, k))
                for k in ('speed', 'load', 'amplitude_exact')
                if k != 'amplitude_exact' or name == 'amplitude'
            }
            for name, extreme in item.worst.items()
        },
        **({} if item.measured is None else {'measured': item.measured}),
        'evaluations': item.evaluations,
        'data': item.complaints,
        'inputs': {input_report.quantity: _input_record(input_report) for input_report in item.inputs},
    }


def _input_record(item: InputReport) -> dict[str, Any]:
    """Return the report on an input as a JSON object: times [ns], None for no number.

    ``span`` is in the unit of the messages, ``si_span`` the same in SI.
    """
    return {
        'topic': item.topic,
        **({'assumed': True} if item.is_assumed else {}),
        'messages': item.messages,
        'used': item.used,
        'without_value': item.without_value,
        'share': item.used / item.messages if item.messages else None,
        'span': [finite_or_none(value) for value in item.span],
        'si_span': [finite_or_none(value) for value in item.si_span],
        'values': item.values,
        'rate': finite_or_none(item.gaps.rate),
        'gaps': item.gaps.count,
        'longest_gaps': [{'time': gap.start_ns, 'seconds': gap.seconds} for gap in item.gaps.longest],
        'source_faults': [
            {'fault': fault.kind.value, 'since': fault.since_ns, 'raised': fault.raised_ns}
            for fault in item.sources
        ],
        'questions': list(item.questions),
        'fault': item.fault or None,
    }
