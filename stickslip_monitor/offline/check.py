# SPDX-License-Identifier: Apache-2.0
"""The monitor over a recorded bag: what it says of every bearing, and what the data lacked.

Everything is added up while the bag is read, so memory does not grow with the recording.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stickslip_monitor.arrays import FloatArray, IntArray
from stickslip_monitor.bags.cdr import short_name
from stickslip_monitor.bags.reader import Bag, Fault, missing_topic, open_bag
from stickslip_monitor.bags.series import Progress
from stickslip_monitor.errors import BagError
from stickslip_monitor.monitor.assessment import REGIMES, Regime
from stickslip_monitor.monitor.bulk import Scan
from stickslip_monitor.monitor.config import BearingConfig, InputConfig, MonitorConfig
from stickslip_monitor.monitor.input_faults import InputFacts, Publisher, input_fault
from stickslip_monitor.monitor.ladder import MEASURED, Unknown
from stickslip_monitor.monitor.signals import INPUTS, LEVEL, STATUS_SENTENCES, Status, to_si
from stickslip_monitor.monitor.source_faults import (
    Plausibility,
    SourceFault,
    SourceWatch,
    fault_text,
    least_gap,
)
from stickslip_monitor.monitor.verdict import Event
from stickslip_monitor.offline.follow import BearingBlock, follow, requests_of
from stickslip_monitor.offline.intervals import Extreme, Worst
from stickslip_monitor.offline.outline import Outline, Outliner

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


class GapCount:
    """Finds the intervals between the messages of a topic that are longer than a limit.

    Args:
        limit_ns: The longest interval that is no gap [ns].
    """

    def __init__(self, limit_ns: int) -> None:
        self._limit_ns = limit_ns
        self._last: IntArray | None = None
        self._count = self._regular = self._passed_ns = 0
        self._longest: list[tuple[int, int]] = []

    def take(self, stamp_ns: IntArray) -> None:
        """Take some stamps in order of arrival, shape (n,) [ns]; steps back count as no time."""
        if not stamp_ns.size:
            return
        if self._last is not None:
            stamp_ns = np.append(self._last, stamp_ns)
        self._last = stamp_ns[-1:].copy()
        interval = np.diff(stamp_ns)
        self._passed_ns += int(np.maximum(interval, 0).sum())
        self._regular += interval.size
        long = np.flatnonzero(interval > self._limit_ns)
        if long.size:
            self._take_gaps(stamp_ns[long], interval[long])

    def _take_gaps(self, start_ns: IntArray, lasting_ns: IntArray) -> None:
        self._count += start_ns.size
        self._regular -= start_ns.size
        self._passed_ns -= int(lasting_ns.sum())
        order = np.argsort(-lasting_ns, kind='stable')[:_MOST_NAMED]
        self._longest += zip(lasting_ns[order].tolist(), start_ns[order].tolist(), strict=True)
        self._longest.sort(key=lambda gap: -gap[0])
        del self._longest[_MOST_NAMED:]

    def gaps(self) -> Gaps:
        """The gaps, and the rate apart from them."""
        passed = float(self._passed_ns) * 1e-9
        longest = tuple(Gap(start, lasting / 1e9) for lasting, start in self._longest)
        rate = self._regular / passed if passed > 0.0 else math.nan
        return Gaps(rate, self._count, longest)


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
        events: All changes of the alarm, in order.
        evaluations: How many operating points were evaluated.
        seconds: Time spent in each regime [s]; time without a usable operating point counts as
            undetermined.
        worst: The least Hopf and fold margin and the greatest predicted amplitude, by name;
            a quantity that never had a value is absent.
        inputs: What came of speed and load, and of a level.
        measured: Time by what the measured vibration said [s]; ``None`` where none is configured.
        outline: The outline of its verdicts; ``None`` where none was asked for.
    """

    name: str
    events: list[Event]
    evaluations: int
    seconds: dict[Regime, float]
    worst: dict[str, Extreme]
    inputs: tuple[InputReport, ...]
    measured: dict[str, float] | None = None
    outline: Outline | None = None

    @property
    def complaints(self) -> list[str]:
        """What was wrong with the samples, one clause for each kind."""
        return [text for item in self.inputs for text in item.complaints]

    @property
    def has_warnings(self) -> bool:
        """Whether any event raised a warning or an alarm, or an input has a wrong source."""
        return any(event.after.level for event in self.events) or any(
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
    path: str | Path,
    config: MonitorConfig,
    progress: Progress | None = None,
    outlined: bool = False,
) -> CheckReport:
    """Run the monitor over a bag.

    Args:
        path: A rosbag2 folder or an .mcap file.
        config: The configuration; its topics must be in the bag.
        progress: Called with bytes read and bytes in all.
        outlined: Whether the outlines of the verdicts are kept, to be drawn.

    Returns:
        The report.

    Raises:
        BagError: The bag cannot be read, lacks a topic, or a field leads to no number.
    """
    bag = open_bag(path)
    if bag.files and not any(file.stat().st_size for file in bag.files):
        raise BagError(f"bag '{path}' is empty: 0 bytes")
    _check_topics(bag, config)
    found = follow(bag, config, partial(_BearingCheck, outlined=outlined), progress)
    start, end = found.start_ns, found.end_ns
    span_ns = end - start if start is not None and end is not None else 0
    reports = {
        bearing.name: found.followers[bearing.name].report(
            span_ns, [found.faults[request] for request in requests_of(bearing)]
        )
        for bearing in config.bearings
    }
    return CheckReport(bag, reports, start, end)


def _check_topics(bag: Bag, config: MonitorConfig) -> None:
    """Refuse inputs that the recording does not have, or not with their type.

    Raises:
        BagError: In the words of the running monitor.
    """
    for source in (source for b in config.bearings for source in b.inputs.values()):
        topic = bag.topics.get(source.topic)
        facts = _facts(source)
        if topic is None:
            reason = missing_topic(bag.topics, source.topic)
            raise BagError(f'{input_fault(facts)[:-1]}: {reason}')
        if short_name(topic.type) != short_name(source.type):
            bags = (Publisher(f"Bag '{bag.path.name}'", topic.type),)
            raise BagError(input_fault(replace(facts, publishers=bags))[:-1])


def _facts(source: InputConfig) -> InputFacts:
    """An input of which nothing has come."""
    return InputFacts(source.topic, source.type, source.timeout_ns * 1e-9, lost=True)


class _BearingCheck:
    """Adds up what the monitor says of one bearing."""

    def __init__(self, config: BearingConfig, outlined: bool) -> None:
        self._config = config
        self._outliner = Outliner(config) if outlined else None
        self._inputs = [_InputCheck(config, k) for k in range(len(config.inputs))]
        self._plausibility = Plausibility(config)
        self._worst = Worst()
        self._events: list[Event] = []
        self._evaluations = 0
        self._lasting_ns = np.zeros(len(REGIMES), np.int64)
        self._measured_ns = np.zeros(len(MEASURED), np.int64)
        self._unknown: Unknown | None = None

    def take(self, block: BearingBlock) -> None:
        """Take the next part of the recording."""
        scan = block.scan
        self._events += scan.events
        self._evaluations += scan.time_ns.size
        self._plausibility.take(scan.assessment)
        self._worst.take(scan)
        self._lasting_ns += _lasting_ns(scan, np.asarray(scan.assessment.regime_code), REGIMES)
        if scan.measured is not None:
            self._measured_ns += _lasting_ns(scan, scan.measured, MEASURED)
        self._unknown = scan.unknown
        if self._outliner is not None:
            self._outliner.take(block)
        for each in self._inputs:
            each.take(block)

    def report(self, span_ns: int, faults: Sequence[tuple[Fault, ...]]) -> BearingReport:
        """What was said over a recording of some length, with the faults of its messages."""
        seconds = dict(zip(REGIMES, (self._lasting_ns * 1e-9).tolist(), strict=True))
        silent_ns = max(0, span_ns - int(self._lasting_ns.sum()))
        seconds[Regime.UNDETERMINED] += silent_ns * 1e-9
        asked = self._plausibility.questions()
        if self._unknown is not None:
            asked['level'] = [f'says nothing at the end: {self._unknown.sentence}']
        measured = zip(MEASURED, (self._measured_ns * 1e-9).tolist(), strict=True)
        return BearingReport(
            self._config.name,
            self._events,
            self._evaluations,
            seconds,
            self._worst.found,
            tuple(
                # Each is held against the load, and the load against the speed.
                each.report(own, tuple(asked.get(each.quantity, ())), self._inputs[int(k != 1)])
                for k, (each, own) in enumerate(zip(self._inputs, faults, strict=True))
            ),
            None if self._config.level is None else {k.value: lasting for k, lasting in measured},
            None if self._outliner is None else self._outliner.outline(),
        )


def _lasting_ns(scan: Scan, codes: NDArray[np.int8], kinds: Sequence[Any]) -> IntArray:
    """The time of each kind [ns]."""
    # Whole numbers below 2^53, as a stretch of months is, are added up without an error.
    totals = np.bincount(codes, scan.until_ns - scan.time_ns, minlength=len(kinds))
    return totals.astype(np.int64)


class _InputCheck:
    """Adds up what came of one input of a bearing."""

    def __init__(self, config: BearingConfig, place: int) -> None:
        self.quantity = INPUTS[place]
        self._place = place
        self._source = config.inputs[self.quantity]
        self._counts = np.zeros(len(Status), np.int64)
        self._gaps = GapCount(self._source.timeout_ns)
        self._watch = SourceWatch(least_gap(config, place))
        self._sources: list[SourceFault] = []
        self._span = (math.inf, -math.inf)
        self._messages = 0
        self._delay_ns = 0

    def take(self, block: BearingBlock) -> None:
        """Take the next part of the recording."""
        series = block.series[self._place]
        self._messages += series.value.size
        if series.value.size:
            self._delay_ns = int(series.log_time_ns[-1] - series.stamp_ns[-1])
        self._gaps.take(series.stamp_ns)
        si = to_si(self._source, series.value)
        if self._place == LEVEL:
            # A level that jumps between two values is what is looked for, and no fault.
            si = np.full(si.shape, np.nan)
        self._sources += self._watch.see_many(series.log_time_ns, series.stamp_ns, si)
        counts, believed = self._believed(block)
        self._counts += counts
        self._widen(believed)

    def _believed(self, block: BearingBlock) -> tuple[IntArray, FloatArray]:
        """Samples by :class:`Status`, and the numbers of those that were believed."""
        scan, stream = block.scan, block.stream
        counts, refused = scan.counts[self._place], scan.status > Status.CLOCK_JUMP
        if not refused.any():
            return counts, block.series[self._place].value
        return counts, stream.value[(stream.inputs == self._place) & ~refused]

    def _widen(self, value: FloatArray) -> None:
        if value.size:
            low, high = self._span
            self._span = min(low, float(value.min())), max(high, float(value.max()))

    def _fault(self, other: _InputCheck) -> str:
        """Why the input brings nothing, or what its clock differs from the other's by."""
        facts = _facts(self._source)
        if not self._messages:
            return input_fault(facts)
        if not self._counts[: Status.CLOCK_JUMP + 1].any():
            worst = max(Status, key=lambda status: int(self._counts[status]))
            sender = (Publisher('', self._source.type),)
            return input_fault(replace(facts, publishers=sender, refused=worst))
        if not other._messages or self._source.topic == other._source.topic:
            return ''
        # By how the last stamps of both lie in the recording, whichever came later.
        behind = (self._delay_ns - other._delay_ns) * 1e-9
        known = replace(facts, lost=False, heard=True, other=other._source.topic)
        return input_fault(replace(known, behind=behind))

    def report(
        self, faults: tuple[Fault, ...], asked: tuple[str, ...], other: _InputCheck
    ) -> InputReport:
        """What came of the input, by its messages' faults, and questions."""
        used = int(self._counts[: Status.CLOCK_JUMP + 1].sum())
        ends = np.array(self._span if used else (math.nan, math.nan))
        low, high = np.sort(to_si(self._source, ends)).tolist()
        texts = Counter(fault_text(fault, self._source) for fault in self._sources)
        return InputReport(
            quantity=self.quantity,
            topic=self._source.topic,
            messages=self._messages,
            used=used,
            faults=(
                *faults,
                *_faults(self._counts),
                *(Fault(count, text) for text, count in texts.items()),
            ),
            gaps=self._gaps.gaps(),
            span=(float(ends[0]), float(ends[1])),
            si_span=(low, high),
            sources=tuple(self._sources),
            questions=asked,
            fault=self._fault(other),
        )


def _faults(counts: NDArray[np.int64]) -> Iterator[Fault]:
    for status, sentence in STATUS_SENTENCES.items():
        if counts[status]:
            yield Fault(int(counts[status]), sentence)
