# SPDX-License-Identifier: Apache-2.0
"""The monitor over a recorded bag: what it says of every bearing, and what the data lacked.

Everything is added up while the bag is read, so memory does not grow with the recording.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stickslip_monitor.arrays import IntArray
from stickslip_monitor.bags.cdr import short_name
from stickslip_monitor.bags.reader import Bag, Fault, missing_topic, open_bag
from stickslip_monitor.bags.series import Progress
from stickslip_monitor.errors import BagError
from stickslip_monitor.monitor.assessment import REGIMES, Regime
from stickslip_monitor.monitor.bulk import Scan
from stickslip_monitor.monitor.config import BearingConfig, InputConfig, MonitorConfig
from stickslip_monitor.monitor.input_watch import InputFacts, Publisher, input_fault
from stickslip_monitor.monitor.ladder import MEASURED, Unknown
from stickslip_monitor.monitor.signals import INPUTS, LEVEL, STATUS_SENTENCES, Status, to_si
from stickslip_monitor.monitor.source_faults import (
    SourceFault,
    SourceWatch,
    fault_text,
    least_gap,
)
from stickslip_monitor.monitor.verdict import Event
from stickslip_monitor.offline.follow import BearingBlock, follow, requests_of
from stickslip_monitor.offline.outline import Extreme, Outline, Outliner, Worst
from stickslip_monitor.offline.plausibility import Plausibility

_MOST_NAMED = 5


@dataclass(frozen=True, slots=True)
class Gap:
    """A time without messages: the last stamp before it [ns] and how long it lasted [s]."""

    start_ns: int
    seconds: float


@dataclass(frozen=True, slots=True)
class Gaps:
    """The rhythm of a topic."""

    rate: float  # messages a second between the gaps [1/s]; nan for fewer than two
    count: int  # intervals longer than the limit
    longest: tuple[Gap, ...]  # of these, longest first, at most five


class GapCount:
    """Finds the intervals between the messages of a topic that are longer than a limit [ns]."""

    def __init__(self, limit_ns: int) -> None:
        self._limit_ns = limit_ns
        self._last = np.empty(0, np.int64)
        self._count = self._regular = self._passed_ns = 0
        self._longest: list[tuple[int, int]] = []

    def take(self, stamp_ns: IntArray) -> None:
        """Take some stamps in order of arrival, shape (n,) [ns]; steps back count as no time."""
        stamp_ns = np.append(self._last, stamp_ns)
        self._last = stamp_ns[-1:].copy()
        interval = np.diff(stamp_ns)
        long = np.flatnonzero(interval > self._limit_ns)
        start_ns, lasting_ns = stamp_ns[long], interval[long]
        self._count += long.size
        self._regular += interval.size - long.size
        self._passed_ns += int(np.maximum(interval, 0).sum() - lasting_ns.sum())
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
    """What came of one input of a bearing."""

    quantity: str  # 'speed', 'load' or 'level'
    topic: str
    messages: int  # on the topic
    used: int  # samples that were believed
    faults: tuple[Fault, ...]  # what was wrong with the others, and jumps of the clock
    gaps: Gaps  # intervals longer than the input's timeout
    span: tuple[float, float] = (math.nan, math.nan)  # of the numbers believed, as in messages
    si_span: tuple[float, float] = (math.nan, math.nan)  # the same in SI; a level in its own unit
    sources: tuple[SourceFault, ...] = ()  # of the source; they are among the faults as well
    questions: tuple[str, ...] = ()  # where the numbers look like another unit or topic
    fault: str = ''  # why it brings nothing, in the words of the running monitor

    @property
    def complaints(self) -> list[str]:
        """What was wrong, one clause for each kind."""
        place = f'{self.quantity} on {self.topic}'
        found = [f'{place}: {fault.count} x {fault.text}' for fault in self.faults]
        return [*found, f'{place}: {self.fault}'] if self.fault else found


@dataclass(frozen=True, slots=True)
class BearingReport:
    """What the monitor says of one bearing over a recording."""

    name: str
    events: list[Event]  # all changes of the alarm, in order
    evaluations: int  # operating points
    seconds: dict[Regime, float]  # in each regime; without a usable point: undetermined
    worst: dict[str, Extreme]  # least margins and greatest amplitude, where there is one
    inputs: tuple[InputReport, ...]
    measured: dict[str, float] | None = None  # time by what the level said [s], if there is one
    outline: Outline | None = None  # of its verdicts, where it was asked for

    @property
    def complaints(self) -> list[str]:
        """What was wrong with the samples, one clause for each kind."""
        return [text for item in self.inputs for text in item.complaints]


@dataclass(frozen=True, slots=True)
class CheckReport:
    """The result of checking one bag; without messages it has no start and no end."""

    bag: Bag
    bearings: dict[str, BearingReport]  # by name
    start_ns: int | None  # on the clock of the samples
    end_ns: int | None


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
        measured = zip(map(str, MEASURED), (self._measured_ns * 1e-9).tolist(), strict=True)
        # Each input is held against the load, and the load against the speed.
        others = [self._inputs[int(k != 1)] for k in range(len(self._inputs))]
        return BearingReport(
            self._config.name,
            self._events,
            self._evaluations,
            seconds,
            self._worst.found,
            tuple(
                each.report(own, tuple(asked.get(each.quantity, ())), other)
                for each, own, other in zip(self._inputs, faults, others, strict=True)
            ),
            None if self._config.level is None else dict(measured),
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
        self._span = math.inf, -math.inf
        self._messages = self._delay_ns = 0

    def take(self, block: BearingBlock) -> None:
        """Take the next part of the recording."""
        series, scan = block.series[self._place], block.scan
        self._messages += series.value.size
        if series.value.size:
            self._delay_ns = int(series.log_time_ns[-1] - series.stamp_ns[-1])
        self._gaps.take(series.stamp_ns)
        # A level that jumps between two values is what is looked for, and no fault.
        is_level = self._place == LEVEL
        si = np.full(series.value.size, np.nan) if is_level else to_si(self._source, series.value)
        self._sources += self._watch.see_many(series.log_time_ns, series.stamp_ns, si)
        self._counts += scan.counts[self._place]
        refused, value = scan.status > Status.CLOCK_JUMP, series.value
        if refused.any():
            value = block.stream.value[(block.stream.inputs == self._place) & ~refused]
        low, high = self._span
        self._span = float(value.min(initial=low)), float(value.max(initial=high))

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
        first, last = self._span if used else (math.nan, math.nan)
        # Below the deadband a negative number is -0.0.
        low, high = sorted(float(to_si(self._source, end)) + 0.0 for end in (first, last))
        counted = {text: int(self._counts[status]) for status, text in STATUS_SENTENCES.items()}
        counted |= Counter(fault_text(fault, self._source) for fault in self._sources)
        return InputReport(
            quantity=self.quantity,
            topic=self._source.topic,
            messages=self._messages,
            used=used,
            faults=(*faults, *(Fault(count, text) for text, count in counted.items() if count)),
            gaps=self._gaps.gaps(),
            span=(first, last),
            si_span=(low, high),
            sources=tuple(self._sources),
            questions=asked,
            fault=self._fault(other),
        )
