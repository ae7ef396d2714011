# SPDX-License-Identifier: Apache-2.0
"""The monitor over a recorded bag: every bearing scanned, and what was wrong with the data."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stickslip_monitor.bags.reader import Bag, Request, Series, open_bag
from stickslip_monitor.monitor.assessment import REGIMES, Assessment, Regime
from stickslip_monitor.monitor.config import BearingConfig, InputConfig, MonitorConfig
from stickslip_monitor.monitor.monitor import Monitor
from stickslip_monitor.monitor.points import at_index
from stickslip_monitor.monitor.scan import Scan
from stickslip_monitor.monitor.signals import QUANTITIES, STATUS_SENTENCES, Status, Stream


@dataclass(frozen=True, slots=True)
class Extreme:
    """The worst value of a quantity in a recording, and the operating point it came from."""

    time_ns: int
    value: float
    point: Assessment


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
        complaints: What was wrong with the samples, one clause for each kind.
    """

    name: str
    scan: Scan
    seconds: dict[Regime, float]
    worst: dict[str, Extreme]
    complaints: list[str]

    @property
    def has_warnings(self) -> bool:
        """Whether any event raised a warning or an alarm."""
        return any(event.after.level for event in self.scan.events)


@dataclass(frozen=True, slots=True)
class CheckReport:
    """The result of checking one bag."""

    bag: Bag
    bearings: dict[str, BearingReport]

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
    requests = {b.name: (_request(b.speed), _request(b.load)) for b in config.bearings}
    series = bag.read({r for pair in requests.values() for r in pair}, progress)
    streams = {
        name: _stream(series[speed], series[load]) for name, (speed, load) in requests.items()
    }
    start, end = _span(bag, streams)
    scans = Monitor(config).scan(streams, start, end)
    reports = {}
    for bearing in config.bearings:
        own = [series[request] for request in requests[bearing.name]]
        reports[bearing.name] = _report(bearing, scans[bearing.name], own, start, end)
    return CheckReport(bag, reports)


def _request(source: InputConfig) -> Request:
    return Request(source.topic, source.field_text, source.type)


def _stream(speed: Series, load: Series) -> Stream:
    """Merge two series into the order in which the bag holds their messages."""
    sequence = np.concatenate([speed.sequence, load.sequence])
    order = np.argsort(sequence, kind='stable')
    is_load = np.arange(sequence.size) >= speed.sequence.size
    return Stream(
        np.concatenate([speed.stamp_ns, load.stamp_ns])[order],
        is_load[order],
        np.concatenate([speed.value, load.value])[order],
    )


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
    config: BearingConfig,
    scan: Scan,
    series: list[Series],
    start_ns: int | None,
    end_ns: int | None,
) -> BearingReport:
    span = (end_ns - start_ns) * 1e-9 if start_ns is not None and end_ns is not None else 0.0
    return BearingReport(
        config.name, scan, _seconds(scan, span), _worst(scan), _complaints(config, scan, series)
    )


def _seconds(scan: Scan, span: float) -> dict[Regime, float]:
    lasting = (scan.until_ns - scan.time_ns) * 1e-9
    totals = np.bincount(
        np.asarray(scan.assessment.regime_code), weights=lasting, minlength=len(REGIMES)
    )
    seconds = {regime: float(totals[i]) for i, regime in enumerate(REGIMES)}
    seconds[Regime.UNDETERMINED] += max(0.0, span - float(lasting.sum()))
    return seconds


def _worst(scan: Scan) -> dict[str, Extreme]:
    point = scan.assessment
    sticking_amplitude = np.where(scan.sticking, point.amplitude, np.nan)
    columns: dict[str, NDArray[np.float64]] = {
        'hopf_margin': np.where(np.isfinite(point.hopf_margin), point.hopf_margin, np.nan),
        'fold_margin': np.where(np.isfinite(point.fold_margin), point.fold_margin, np.nan),
        'amplitude': -sticking_amplitude,
    }
    worst = {}
    for name, column in columns.items():
        if not np.all(np.isnan(column)):
            i = int(np.nanargmin(column))
            value = float(abs(column[i]) if name == 'amplitude' else column[i])
            worst[name] = Extreme(int(scan.time_ns[i]), value, at_index(point, i))
    return worst


def _complaints(config: BearingConfig, scan: Scan, series: list[Series]) -> list[str]:
    complaints = []
    for row, (quantity, source) in enumerate(
        zip(QUANTITIES, (config.speed, config.load), strict=True)
    ):
        place = f'{quantity} on {source.topic}'
        complaints += [f'{place}: {fault.count} x {fault.text}' for fault in series[row].faults]
        complaints += [
            f'{place}: {int(scan.counts[row, status])} x {sentence}'
            for status, sentence in STATUS_SENTENCES.items()
            if scan.counts[row, status]
        ]
        if not scan.counts[row, : Status.CLOCK_JUMP + 1].any():
            complaints.append(f'{place}: no usable sample')
    return complaints
