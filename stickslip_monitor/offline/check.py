# SPDX-License-Identifier: Apache-2.0
"""The monitor over a recorded bag: what it says of every bearing, and what the data lacked.

Everything is added up while the bag is read, so memory does not grow with the recording.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stickslip_monitor import jit
from stickslip_monitor.arrays import FloatArray, IntArray
from stickslip_monitor.bags.reader import open_bag
from stickslip_monitor.bags.recording import Progress, Recording
from stickslip_monitor.bags.values import Fault, Request, Series
from stickslip_monitor.errors import BagError
from stickslip_monitor.monitor.assessment import REGIMES, Regime
from stickslip_monitor.monitor.bulk import BearingScan, Scan
from stickslip_monitor.monitor.config import BearingConfig, MonitorConfig
from stickslip_monitor.monitor.ladder import MEASURED
from stickslip_monitor.monitor.signals import Stream
from stickslip_monitor.monitor.verdict import Event
from stickslip_monitor.offline.input_check import (
    InputCheck,
    InputReport,
    Plausibility,
    check_topics,
)
from stickslip_monitor.offline.outline import Extreme, Outline, Outliner, Worst

_AHEAD_NS = 10**9
"""A stamp may be so much later than the recorder's time, by the errors of both clocks [ns]."""
_SILENCE = Stream(np.empty(0, np.int64), np.empty(0, np.int8), np.empty(0))


@dataclass(frozen=True, slots=True)
class BearingReport:
    """What the monitor says of one bearing over a recording."""

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
        """What was wrong with the samples, one clause for each kind."""
        return [text for item in self.inputs for text in item.complaints]


@dataclass(frozen=True, slots=True)
class CheckReport:
    """The result of checking one bag; without messages it has no start and no end."""

    bag: Recording
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
    config = check_topics(bag, config)
    reading = bag.reading({r for b in config.bearings for r in requests_of(b)}, progress)
    span = SampleSpan(bag)
    checks = [_BearingCheck(bearing, outlined) for bearing in config.bearings]
    running: list[Future[None]] = []
    # Bearings know nothing of each other, and arithmetic on arrays needs no interpreter.
    with ThreadPoolExecutor(min(len(checks), os.cpu_count() or 1)) as pool:
        for part in reading:
            # What was read before is scanned while the next is read.
            for future in running:
                future.result()
            span.extend(part.values())
            running = [pool.submit(check.take, part, span.start_ns) for check in checks]
        for future in running:
            future.result()
    faults = reading.faults()
    reports = {check.config.name: check.report(span, faults) for check in checks}
    return CheckReport(bag, reports, span.start_ns, span.end_ns)


class _BearingCheck:
    """Runs the monitor over one bearing's samples and adds up what it says."""

    def __init__(self, config: BearingConfig, outlined: bool) -> None:
        self.config = config
        self._requests = requests_of(config)
        self._scan: BearingScan | None = None
        self._outliner = Outliner(config) if outlined else None
        self._inputs = [InputCheck(config, k) for k in range(len(config.inputs))]
        self._plausibility = Plausibility(config)
        self._worst = Worst()
        self._events: list[Event] = []
        self._evaluations = 0
        self._lasting_ns = np.zeros(len(REGIMES), np.int64)
        self._measured_ns = np.zeros(len(MEASURED), np.int64)

    def take(self, part: Mapping[Request, Series], start_ns: int | None) -> None:
        """Take the next part of a recording that begins at a time [ns]."""
        series = [part[request] for request in self._requests]
        stream = streamed(series)
        if self._scan is None:
            self._scan = BearingScan(self.config, start_ns)
        scan = self._scan.take(stream)
        self._add(scan)
        for each, own in zip(self._inputs, series, strict=True):
            each.take(own, stream, scan)

    def _add(self, scan: Scan) -> None:
        """Add up the verdicts that are known with a part, a point behind."""
        self._events += scan.events
        self._evaluations += scan.time_ns.size
        self._plausibility.take(scan.assessment)
        self._worst.take(scan)
        self._lasting_ns += _lasting_ns(scan, np.asarray(scan.assessment.regime_code), REGIMES)
        if scan.measured is not None:
            self._measured_ns += _lasting_ns(scan, scan.measured, MEASURED)
        if self._outliner is not None:
            self._outliner.take(scan)

    def report(
        self, span: SampleSpan, faults: Mapping[Request, tuple[Fault, ...]]
    ) -> BearingReport:
        """The complaints about the whole recording, with the faults of its messages."""
        assert self._scan is not None
        end = self._scan.finish(_SILENCE, span.end_ns)
        self._add(end)
        seconds = dict(zip(REGIMES, (self._lasting_ns * 1e-9).tolist(), strict=True))
        silent_ns = max(0, span.length_ns - int(self._lasting_ns.sum()))
        seconds[Regime.UNDETERMINED] += silent_ns * 1e-9
        asked = self._plausibility.questions()
        if end.unknown is not None:
            asked['level'] = [f'says nothing at the end: {end.unknown.sentence}']
        measured = zip(map(str, MEASURED), (self._measured_ns * 1e-9).tolist(), strict=True)
        # Each input is held against the load, and the load against the speed.
        others = [self._inputs[int(k != 1)] for k in range(len(self._inputs))]
        return BearingReport(
            self.config.name,
            self._events,
            self._evaluations,
            seconds,
            self._worst.found,
            tuple(
                each.report(faults[request], tuple(asked.get(each.quantity, ())), other)
                for each, request, other in zip(self._inputs, self._requests, others, strict=True)
            ),
            None if self.config.level is None else dict(measured),
            None if self._outliner is None else self._outliner.outline(),
        )


def _lasting_ns(scan: Scan, codes: NDArray[np.int8], kinds: Sequence[Any]) -> IntArray:
    """The time of each kind [ns]."""
    # Whole numbers below 2^53, as a stretch of months is, are added up without an error.
    totals = np.bincount(codes, scan.until_ns - scan.time_ns, minlength=len(kinds))
    return totals.astype(np.int64)


def requests_of(config: BearingConfig) -> tuple[Request, ...]:
    """What to read for a bearing: one request for each of its inputs."""
    return tuple(Request(i.topic, i.field_text, i.type) for i in config.inputs.values())


def merged(series: Sequence[Series]) -> tuple[IntArray, IntArray, FloatArray, IntArray]:
    """Some series in the order of the recording.

    Returns:
        Which of them, stamp [ns], number and log time [ns] of each message, shape (n,).
    """
    order = np.argsort(np.concatenate([each.sequence for each in series]), kind='stable')
    return (
        np.repeat(np.arange(len(series)), [each.sequence.size for each in series])[order],
        np.concatenate([each.stamp_ns for each in series])[order],
        np.concatenate([each.value for each in series])[order],
        np.concatenate([each.log_time_ns for each in series])[order],
    )


def streamed(series: Sequence[Series]) -> Stream:
    """The samples of a bearing's inputs; they came when the recorder got them."""
    inputs, stamp_ns, value, log_time_ns = merged(series)
    return Stream(stamp_ns, inputs.astype(np.int8), value, arrival_ns=log_time_ns)


class SampleSpan:
    """Start and end of a recording on the clock of the samples.

    Stamps in headers may be from another clock than the recorder's: then the samples' own span
    counts. Which it is shows with the first message.

    Attributes:
        start_ns: The start [ns], known with the first message.
        end_ns: The end as far as it was read [ns].
    """

    def __init__(self, bag: Recording) -> None:
        self.start_ns, self.end_ns = bag.start_ns, bag.end_ns
        self._begun = False

    def extend(self, series: Iterable[Series]) -> None:
        """Take the messages of a stretch."""
        known = [each for each in series if each.sequence.size]
        if self.start_ns is None or self.end_ns is None or not known:
            return
        if not self._begun:
            self._begun = True
            first = min(known, key=lambda each: int(each.sequence[0]))
            stamp, log_time = int(first.stamp_ns[0]), int(first.log_time_ns[0])
            if not self.start_ns <= stamp <= log_time + _AHEAD_NS:
                self.start_ns = self.end_ns = stamp
        self.end_ns = max(self.end_ns, *(int(each.stamp_ns.max()) for each in known))

    @property
    def length_ns(self) -> int:
        """From the start to the end; 0 without messages [ns]."""
        return 0 if self.start_ns is None or self.end_ns is None else self.end_ns - self.start_ns


@dataclass(frozen=True)
class WholeBearing:
    """One bearing over a whole recording in memory."""

    config: BearingConfig
    stream: Stream  # its samples
    span: SampleSpan
    many: bool  # whether it is one of many, for which compiling pays however short it is

    @cached_property
    def scan(self) -> Scan:
        """The verdicts, worked out when they are first asked for."""
        long = jit.has_compiler() if self.many else None
        own = BearingScan(self.config, self.span.start_ns, long)
        return own.finish(self.stream, self.span.end_ns)


@dataclass(frozen=True, slots=True)
class WholeBag:
    """A bag with all its verdicts in memory, for what needs them at once."""

    bag: Recording
    bearings: dict[str, WholeBearing]  # by name
    start_ns: int | None  # on the clock of the samples


def scan_whole(path: str | Path, config: MonitorConfig, many: bool = False) -> WholeBag:
    """Run the monitor over a bag and keep everything, of one bag or of ``many``.

    Raises:
        BagError: The bag cannot be read, lacks a topic, or a field leads to no number.
    """
    bag = open_bag(path)
    asked = {b.name: requests_of(b) for b in config.bearings}
    series = bag.read({request for own in asked.values() for request in own})
    span = SampleSpan(bag)
    span.extend(series.values())
    found = {
        bearing.name: WholeBearing(
            bearing,
            streamed([series[request] for request in asked[bearing.name]]),
            span,
            many,
        )
        for bearing in config.bearings
    }
    return WholeBag(bag, found, span.start_ns)
