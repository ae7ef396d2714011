# SPDX-License-Identifier: Apache-2.0
"""How regularly the messages of an input came, and where they did not.

The monitor over a recorded bag: every bearing scanned, and what was wrong with the data.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stickslip_monitor.arrays import IntArray
from stickslip_monitor.bags.reader import Bag, Fault, Request, Series, open_bag
from stickslip_monitor.bags.schema import short_name
from stickslip_monitor.bags.topics import missing_topic
from stickslip_monitor.errors import BagError
from stickslip_monitor.monitor.assessment import REGIMES, Regime
from stickslip_monitor.monitor.config import BearingConfig, InputConfig, MonitorConfig
from stickslip_monitor.monitor.input_faults import InputFacts, Publisher, input_fault
from stickslip_monitor.monitor.measured import MEASURED
from stickslip_monitor.monitor.monitor import Monitor
from stickslip_monitor.monitor.scan import Scan
from stickslip_monitor.monitor.signals import (
    INPUTS,
    LEVEL,
    STATUS_SENTENCES,
    Levels,
    Status,
    Stream,
    to_si,
)
from stickslip_monitor.monitor.source_faults import (
    SourceFault,
    fault_text,
    find_source_faults,
    least_gap,
    questions,
)
from stickslip_monitor.offline.intervals import Extreme, worst
from stickslip_monitor.surface_store import prepare_surfaces

_MOST_NAMED = 5


@dataclass(frozen=True, slots=True)
class Gap:
    """A time without messages: the last stamp before it [ns] and how long it lasted [s]."""

    start_ns: int
    seconds: float


@dataclass(frozen=True, slots=True)
class Gaps:
    """The rhythm of a topic.

    Attributes:
        rate: Messages a second between the gaps [1/s]; ``nan`` for fewer than two.
        count: Gaps, that is, intervals longer than the limit.
        longest: The longest of them, longest first, at most five.
    """

    rate: float
    count: int
    longest: tuple[Gap, ...]


def find_gaps(stamp_ns: IntArray, limit_ns: int) -> Gaps:
    """Find the intervals between messages that are longer than a limit.

    Args:
        stamp_ns: Stamps in order of arrival, shape (n,) [ns]; steps back count as no time.
        limit_ns: The longest interval that is no gap [ns].

    Returns:
        The gaps and the rate apart from them.
    """
    interval = np.diff(stamp_ns)
    long = np.flatnonzero(interval > limit_ns)
    lasting = interval[long]
    regular = interval.size - long.size
    passed = float(np.maximum(interval, 0).sum() - lasting.sum()) * 1e-9
    order = np.argsort(-lasting, kind='stable')[:_MOST_NAMED]
    named = [Gap(int(stamp_ns[long[i]]), float(lasting[i]) / 1e9) for i in order]
    return Gaps(regular / passed if passed > 0.0 else np.nan, int(long.size), tuple(named))


@dataclass(frozen=True, slots=True)
class InputReport:
    """What came of one input of a bearing.

    Attributes:
        quantity: ``'speed'``, ``'load'`` or ``'level'``.
        topic: Where it was read.
        messages: Messages on the topic.
        used: Samples that were believed.
        faults: What was wrong with the others, and jumps of the clock.
        gaps: How regularly they came; a gap is longer than the input's timeout.
        span: The least and the greatest number believed, as in the messages; ``nan`` without any.
        si_span: The same in SI units, surface speed [m/s] or load [N]; a level in its own unit.
        sources: Faults of the source that the samples show; they are among the faults as well.
        questions: What to ask where the numbers look like another unit or topic.
        fault: Why the input brings nothing, in the words of the running monitor; or nothing.
    """

    quantity: str
    topic: str
    messages: int
    used: int
    faults: tuple[Fault, ...]
    gaps: Gaps
    span: tuple[float, float] = (math.nan, math.nan)
    si_span: tuple[float, float] = (math.nan, math.nan)
    sources: tuple[SourceFault, ...] = ()
    questions: tuple[str, ...] = ()
    fault: str = ''

    @property
    def complaints(self) -> list[str]:
        """What was wrong, one clause for each kind."""
        place = f'{self.quantity} on {self.topic}'
        found = [f'{place}: {fault.count} x {fault.text}' for fault in self.faults]
        return [*found, f'{place}: {self.fault}'] if self.fault else found


@dataclass(frozen=True, slots=True)
class BearingReport:
    """What the monitor says of one bearing over a recording.

    Attributes:
        name: Name of the bearing.
        scan: All verdicts and events.
        seconds: Time spent in each regime [s]; time without a usable operating point counts as
            undetermined.
        worst: The least Hopf and fold margin and the greatest predicted amplitude, by name;
            a quantity that never had a value is absent.
        inputs: What came of speed and load, and of a level.
        stream: The samples.
    """

    name: str
    scan: Scan
    seconds: dict[Regime, float]
    worst: dict[str, Extreme]
    inputs: tuple[InputReport, ...]
    stream: Stream

    @property
    def complaints(self) -> list[str]:
        """What was wrong with the samples, one clause for each kind."""
        return [text for item in self.inputs for text in item.complaints]

    @property
    def measured(self) -> dict[str, float] | None:
        """Time by what the measured vibration said [s]; ``None`` where none is configured."""
        codes = self.scan.course.measured
        if codes is None:
            return None
        lasting = (self.scan.until_ns - self.scan.time_ns) * 1e-9
        totals = np.bincount(codes, weights=lasting, minlength=len(MEASURED)).tolist()
        return {state.value: total for state, total in zip(MEASURED, totals, strict=True)}

    @property
    def has_warnings(self) -> bool:
        """Whether any event raised a warning or an alarm, or an input has a wrong source."""
        return any(event.after.level for event in self.scan.events) or any(
            item.sources for item in self.inputs
        )


@dataclass(frozen=True, slots=True)
class CheckReport:
    """The result of checking one bag.

    Attributes:
        bag: The bag.
        bearings: What the monitor says of each bearing, by name.
        start_ns: When the recording begins, on the clock of the samples [ns].
        end_ns: When it ends; both are ``None`` in a recording without messages.
    """

    bag: Bag
    bearings: dict[str, BearingReport]
    start_ns: int | None
    end_ns: int | None

    @property
    def has_warnings(self) -> bool:
        """Whether any bearing has warnings."""
        return any(bearing.has_warnings for bearing in self.bearings.values())


def check_bag(
    path: str | Path, config: MonitorConfig, progress: Callable[[int, int], None] | None = None
) -> CheckReport:
    """Run the monitor over a bag.

    Args:
        path: A rosbag2 folder or an .mcap file.
        config: The configuration; its topics must be in the bag.
        progress: Called with bytes read and bytes in all.

    Returns:
        The report.

    Raises:
        BagError: The bag cannot be read, lacks a topic, or a field leads to no number.
    """
    bag = open_bag(path)
    if bag.files and not any(file.stat().st_size for file in bag.files):
        raise BagError(f"bag '{path}' is empty: 0 bytes")
    _check_topics(bag, config)
    requests = {b.name: list(map(_request, b.inputs.values())) for b in config.bearings}
    series = bag.read({r for own in requests.values() for r in own}, progress)
    streams = {
        name: _stream(*(series[request] for request in own)) for name, own in requests.items()
    }
    start, end = _span(bag, streams)
    prepare_surfaces(item.bearing for item in config.bearings)
    monitor = Monitor(config)

    def report(bearing: BearingConfig) -> BearingReport:
        name = bearing.name
        scan = monitor.scan({name: streams[name]}, start, end)[name]
        own = [series[request] for request in requests[name]]
        return _report(bag, bearing, scan, own, streams[name], start, end)

    # Bearings know nothing of each other, and arithmetic on arrays needs no interpreter.
    with ThreadPoolExecutor(len(config.bearings)) as pool:
        reports = dict(zip(streams, pool.map(report, config.bearings), strict=True))
    return CheckReport(bag, reports, start, end)


def _check_topics(bag: Bag, config: MonitorConfig) -> None:
    """Refuse inputs that the recording does not have, or not with their type.

    Raises:
        BagError: In the words of the running monitor.
    """
    for source in (source for b in config.bearings for source in b.inputs.values()):
        fault = input_fault(_facts(bag, source))
        if source.topic not in bag.topics:
            raise BagError(f'{fault[:-1]}: {missing_topic(bag.topics, source.topic)}')
        if fault:
            raise BagError(fault[:-1])


def _facts(bag: Bag, source: InputConfig) -> InputFacts:
    """What is known of an input before its samples are."""
    topic = bag.topics.get(source.topic)
    publishers: tuple[Publisher, ...] = ()
    if topic is not None:
        fits = short_name(topic.type) == short_name(source.type)
        name = f"Bag '{bag.path.name}'"
        publishers = (Publisher(name, source.type if fits else topic.type),)
    return InputFacts(
        source.topic, source.type, source.timeout_ns * 1e-9, lost=True, publishers=publishers,
        heard=True,
    )  # fmt: skip


def _request(source: InputConfig) -> Request:
    return Request(source.topic, source.field_text, source.type)


def _stream(speed: Series, load: Series, level: Series | None = None) -> Stream:
    """Merge series into the order in which the bag holds their messages."""
    sequence = np.concatenate([speed.sequence, load.sequence])
    order = np.argsort(sequence, kind='stable')
    is_load = np.arange(sequence.size) >= speed.sequence.size
    return Stream(
        np.concatenate([speed.stamp_ns, load.stamp_ns])[order],
        is_load[order],
        np.concatenate([speed.value, load.value])[order],
        None if level is None else _levels(level, sequence[order]),
    )


def _levels(level: Series, sequence: IntArray) -> Levels:
    """The values of a level among those of speed and load, whose sequence is rising."""
    return Levels(level.stamp_ns, level.value, np.searchsorted(sequence, level.sequence, 'right'))


def _span(bag: Bag, streams: dict[str, Stream]) -> tuple[int | None, int | None]:
    """Start and end of the recording on the clock of the samples.

    Stamps in headers may be from another clock than the recorder's: then the samples' own span
    counts.
    """
    times = [stream.time_ns for stream in streams.values() if stream.time_ns.size]
    if bag.start_ns is None or bag.end_ns is None or not times:
        return bag.start_ns, bag.end_ns
    first, last = min(int(t[0]) for t in times), max(int(t.max()) for t in times)
    if first < bag.start_ns or last > bag.end_ns:
        return first, last
    return bag.start_ns, bag.end_ns


def _report(
    bag: Bag,
    config: BearingConfig,
    scan: Scan,
    series: list[Series],
    stream: Stream,
    start_ns: int | None,
    end_ns: int | None,
) -> BearingReport:
    span = (end_ns - start_ns) * 1e-9 if start_ns is not None and end_ns is not None else 0.0
    return BearingReport(
        config.name,
        scan,
        _seconds(scan, span),
        worst(scan),
        _inputs(bag, config, scan, series, stream),
        stream,
    )


def _seconds(scan: Scan, span: float) -> dict[Regime, float]:
    lasting = (scan.until_ns - scan.time_ns) * 1e-9
    totals = np.bincount(
        np.asarray(scan.assessment.regime_code), weights=lasting, minlength=len(REGIMES)
    )
    seconds = {regime: float(totals[i]) for i, regime in enumerate(REGIMES)}
    seconds[Regime.UNDETERMINED] += max(0.0, span - float(lasting.sum()))
    return seconds


def _inputs(
    bag: Bag, config: BearingConfig, scan: Scan, series: list[Series], stream: Stream
) -> tuple[InputReport, ...]:
    asked = questions(config, scan.assessment)
    if scan.level is not None and scan.level.unknown is not None:
        asked['level'] = [f'says nothing at the end: {scan.level.unknown.sentence}']
    sources = list(config.inputs.values())
    found = []
    for k, (quantity, source) in enumerate(config.inputs.items()):
        own = tuple(asked.get(quantity, ()))
        report = _input(config, k, scan, series[k], stream, own, _facts(bag, source))
        # Each is held against the load, and the load against the speed.
        other = int(k != 1)
        clock = _clock_fault(source, sources[other], series[k], series[other])
        found.append(replace(report, fault=report.fault or clock))
    return tuple(found)


def _fault(facts: InputFacts, counts: NDArray[np.int64]) -> str:
    """Why no sample of an input was believed; nothing where some were."""
    if counts[: Status.CLOCK_JUMP + 1].any():
        return ''
    if not counts.sum():
        return input_fault(replace(facts, publishers=()))
    worst = max(Status, key=lambda status: int(counts[status]))
    return input_fault(replace(facts, refused=worst))


def _clock_fault(source: InputConfig, other: InputConfig, own: Series, others: Series) -> str:
    """Whether stamps are behind those of the other input, by how they lie in the recording."""
    if source.topic == other.topic or not own.stamp_ns.size or not others.stamp_ns.size:
        return ''
    # Of the last messages; when they were recorded takes out that one came later.
    behind, ahead = (int(each.log_time_ns[-1] - each.stamp_ns[-1]) for each in (own, others))
    facts = InputFacts(source.topic, source.type, source.timeout_ns * 1e-9, lost=False)
    return input_fault(
        replace(facts, heard=True, behind=(behind - ahead) * 1e-9, other=other.topic)
    )


def _input(
    config: BearingConfig,
    is_load: int,
    scan: Scan,
    series: Series,
    stream: Stream,
    asked: tuple[str, ...],
    facts: InputFacts,
) -> InputReport:
    quantity = INPUTS[is_load]
    source = config.inputs[quantity]
    counts, own = _believed(scan, stream, is_load)
    si = to_si(source, series.value)
    sources = find_source_faults(
        series.log_time_ns,
        series.stamp_ns,
        # A level that jumps between two values is what is looked for, and no fault.
        np.full(si.shape, np.nan) if is_load == LEVEL else si,
        least_gap(config, is_load),
    )
    ends = np.array([own.min(), own.max()] if own.size else [np.nan, np.nan])
    low, high = np.sort(to_si(source, ends)).tolist()
    texts = (fault_text(fault, source) for fault in sources)
    return InputReport(
        quantity=quantity,
        topic=source.topic,
        messages=int(series.value.size),
        used=int(counts[: Status.CLOCK_JUMP + 1].sum()),
        faults=(
            *series.faults,
            *_faults(counts),
            *(Fault(count, text) for text, count in Counter(texts).items()),
        ),
        gaps=find_gaps(series.stamp_ns, source.timeout_ns),
        span=(float(ends[0]), float(ends[1])),
        si_span=(low, high),
        sources=tuple(sources),
        questions=asked,
        fault=_fault(facts, counts),
    )


def _believed(
    scan: Scan, stream: Stream, is_load: int
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Samples of an input by :class:`Status`, and the numbers of those that were believed."""
    if is_load == LEVEL:
        assert scan.level is not None
        assert stream.level is not None
        return scan.level.counts, stream.level.value[scan.level.status <= Status.CLOCK_JUMP]
    own = (stream.is_load == bool(is_load)) & (scan.status <= Status.CLOCK_JUMP)
    return scan.counts[is_load], stream.value[own]


def _faults(counts: NDArray[np.int64]) -> list[Fault]:
    return [
        Fault(int(counts[status]), sentence)
        for status, sentence in STATUS_SENTENCES.items()
        if counts[status]
    ]
