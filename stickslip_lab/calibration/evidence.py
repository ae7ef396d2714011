# SPDX-License-Identifier: Apache-2.0
"""Collects the evidence of a calibration: speed and load of recordings, and when the bearing vibrated.

A level shows that by itself, without a set threshold, a rule or a believed boundary. The amplitude of a
stick-slip cycle is in proportion to the surface speed, whatever the sensor and its gain. So a
level in dB less ``20 lg V`` has two narrow modes, quiet and vibration, and what parts them best
over all recordings together is the threshold between them (N. Otsu, IEEE Trans. Syst. Man Cybern.
9 (1979) 62). The edges of a vibration are where its level is 3 dB below its own plateau. The lag with which a
level falls, and so rises, follows from the straight line of its fall.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from itertools import pairwise
from pathlib import Path

import numpy as np

from stickslip_lab import MAX_TABLE_BYTES
from stickslip_lab.scenes.truth_topics import TruthRecord
from stickslip_logs.tables.small_table import read_table
from stickslip_logs.time_order import EPOCH
from stickslip_logs.units import SECOND_NS
from stickslip_monitor.arrays import FloatArray, IntArray
from stickslip_monitor.errors import CalibrationError
from stickslip_monitor.monitor.value_check import Parameter, refused

BIN_NS = SECOND_NS
"""Width of the bins in which speed and load are averaged [ns]."""
STATES = {'squeal': True, 'quiet': False}
# How far the times may be off, and the probability that a report is right: where a person states none.
_REPORT_NUMBERS = (
    Parameter('tolerance', 'float', 10.0, 'How far the times may be off.', 's', 0.0),
    Parameter('trust', 'float', 0.9, 'Probability that the report is right.', '', 0.0, 1.0),
)
_COLUMNS = ('bearing', 'start', 'end', 'state')
_FRACTION = re.compile(r'(:\d\d)\.(\d+)')


@dataclass(frozen=True, slots=True)
class VibrationReport:
    """A report that a bearing vibrated or was quiet."""

    bearing: str  # name of the bearing
    start_ns: int  # from when [ns]
    end_ns: int  # until when [ns]
    squeal: bool  # whether it vibrated
    tolerance: float  # how far the two times may be off [s]
    trust: float  # probability that the report is not worthless
    source: str  # file and line, or recording and number, for a sentence
    rings: bool = False  # whether it is of a level, which ends only when a cycle has died away

    @property
    def seconds(self) -> float:
        """Its length [s]."""
        return (self.end_ns - self.start_ns) / 1e9


def read_reports(path: str | Path, bearings: Sequence[str]) -> list[VibrationReport]:
    """Read an operator's reports on some bearings from a table, and return them by bearing and time.

    The table is read as a log is: lines above its headings are skipped, and the headings may be a comment.
    They are ``bearing, start, end, state`` and, optionally, ``tolerance [s]`` and ``trust``, 10 s and 0.9
    where they are empty. Times are ISO 8601 with a zone; the state is squeal or quiet, in any case.

    Args:
        path: The file.
        bearings: Names of the bearings that are configured.

    Raises:
        CalibrationError: The file cannot be read or has no report, a line breaks a rule, a bearing is not one
            of them, or two reports overlap; the text names file, line, value and rule.
    """
    rows, _ = read_table(
        path, MAX_TABLE_BYTES, CalibrationError, lambda cells: {*_plain_headings(cells)} >= {*_COLUMNS}
    )
    if len(rows) < 2:
        raise CalibrationError(f'{path} has no reports: give headings and a line for each report')
    headings, body = rows[0].cells, rows[1:]
    names = _plain_headings(headings)
    missing = [name for name in _COLUMNS if name not in names]
    if missing:
        raise CalibrationError(
            f'{path}, line {rows[0].line}: no column {", ".join(missing)} among the headings'
            f' {", ".join(headings)}: there must be {", ".join(_COLUMNS)}'
        )
    reports = []
    for line, cells in body:
        where = f'{path}, line {line}'
        if len(cells) != len(names):
            raise CalibrationError(f'{where}: it has {len(cells)} cells and there are {len(names)} headings')
        reports.append(_parse_report(where, dict(zip(names, cells, strict=True)), bearings))
    return sort_reports(reports)


def _plain_headings(headings: Sequence[str]) -> list[str]:
    """Return headings in lower case, without their units."""
    return [re.sub(r'\s*[\[(].*', '', text).strip().lower() for text in headings]


def _parse_report(where: str, row: dict[str, str], bearings: Sequence[str]) -> VibrationReport:
    """Return the report of a row, given as cells by heading.

    Raises:
        CalibrationError: A cell breaks its rule; the text begins with ``where``.
    """
    if row['bearing'] not in bearings:
        raise CalibrationError(
            f"{where}: bearing '{row['bearing']}' is not configured; there are: {', '.join(bearings)}"
        )
    if row['state'].lower() not in STATES:
        raise refused(f'{where}: state', row['state'], f'one of {", ".join(STATES)}', CalibrationError)
    start, end = (_parse_time(f'{where}: {name}', row[name]) for name in ('start', 'end'))
    if end <= start:
        raise refused(f'{where}: end', row['end'], f"after start '{row['start']}'", CalibrationError)
    tolerance, trust = (_parse_number(where, row, rule) for rule in _REPORT_NUMBERS)
    squeal = STATES[row['state'].lower()]
    return VibrationReport(row['bearing'], start, end, squeal, tolerance, trust, where)


def _parse_time(where: str, text: str) -> int:
    """Parse an ISO 8601 time with a zone; return nanoseconds since 1970, of up to nine decimals.

    Raises:
        CalibrationError: It is no such time, or has no zone; the text begins with ``where``.
    """
    fraction = _FRACTION.search(text)
    whole = _FRACTION.sub(r'\1', text)
    try:
        moment = datetime.fromisoformat(re.sub('[zZ]$', '+00:00', whole))
    except ValueError:
        raise refused(where, text, 'a time such as 2026-05-04T06:01:10Z', CalibrationError) from None
    if moment.tzinfo is None:
        raise refused(where, text, 'a time with a zone: end it in Z or +02:00, say', CalibrationError)
    passed = moment - EPOCH
    digits = fraction.group(2)[:9].ljust(9, '0') if fraction else '0'
    return (passed.days * 86400 + passed.seconds) * 10**9 + int(digits)


def _parse_number(where: str, row: dict[str, str], rule: Parameter) -> float:
    """Return an optional number of a report; the rule's default where its cell is empty or missing.

    Raises:
        CalibrationError: It breaks its rule; the text begins with ``where``.
    """
    text = row.get(rule.name, '')
    if not text:
        return float(rule.default)
    name = f'{where}: {rule.name}'
    try:
        return float(rule.checked(name, {name: float(text)}))
    except ValueError:
        raise CalibrationError(str(refused(name, text, rule.rule()))) from None


def sort_reports(reports: Iterable[VibrationReport]) -> list[VibrationReport]:
    """Return reports sorted by bearing and time.

    Raises:
        CalibrationError: Two of one bearing overlap; one may begin when another ends.
    """
    ordered = sorted(reports, key=lambda r: (r.bearing, r.start_ns, r.end_ns))
    for one, two in pairwise(ordered):
        if one.bearing == two.bearing and two.start_ns < one.end_ns:
            kind = 'contradicts' if one.squeal != two.squeal else 'overlaps'
            raise CalibrationError(
                f'{two.source} {kind} {one.source}: they are about the same time of {one.bearing};'
                ' give one report for each time'
            )
    return ordered


def true_reports(bearing: str, truth: TruthRecord, recording: str) -> tuple[VibrationReport, ...]:
    """Return reports by the truth of a simulated recording: squeal in its episodes, quiet between them.

    They are in order of time, right to 1 s with a probability of 0.999; those without length are left out.
    """
    edges = [truth.start_ns, *(time for episode in truth.episodes for time in episode), truth.end_ns]
    return tuple(
        VibrationReport(bearing, start, end, bool(k % 2), 1.0, 0.999, f'truth of {recording}, {k + 1}')
        for k, (start, end) in enumerate(pairwise(edges))
        if end > start
    )


@dataclass(frozen=True, slots=True, eq=False)
class TelemetryBins:
    """Speed and load of one bearing over one recording, in bins of a second."""

    name: str  # the recording, for a sentence
    time_ns: IntArray  # middle of each bin, strictly rising, shape (n,) [ns]
    speed: FloatArray  # magnitude of the surface speed, shape (n,) [m/s]; 0 at rest
    load: FloatArray  # shape (n,) [N]


def bin_telemetry(name: str, time_ns: IntArray, speed: FloatArray, load: FloatArray) -> TelemetryBins:
    """Return speed and load averaged over bins of a second; a bin with a sample at rest has speed 0.

    Args:
        name: Name of the recording.
        time_ns: Times that do not fall, shape (n,) [ns]; seconds without any have no bin.
        speed: Surface speed, of which the magnitude counts, shape (n,) [m/s].
        load: Load, shape (n,) [N].
    """
    bins, inverse = np.unique(time_ns // BIN_NS, return_inverse=True)
    count = np.bincount(inverse)
    size = np.abs(speed)
    mean_speed, mean_load = (np.bincount(inverse, weights=x) / count for x in (size, load))
    resting = np.bincount(inverse, weights=size == 0.0) > 0
    return TelemetryBins(name, bins * BIN_NS + BIN_NS // 2, np.where(resting, 0.0, mean_speed), mean_load)


BIN = 0.25
"""Width of the bins in which a level is averaged [s]."""
MIN_MODE_DISTANCE = 6.0
"""Least distance of the two modes [dB]."""
# Least pause between two vibrations [s]: a shorter one does not part them.
_MIN_PAUSE = 3.0
# Distances below the plateau at which a fall is timed [dB], and the slowest fall that is the
# level's own and not the lining's [s].
EDGE, FOOT, SLOWEST_FALL = 3.0, 9.0, 6.0


@dataclass(frozen=True, slots=True, eq=False)
class LevelBins:
    """A level of vibration over a recording, in bins while the shaft turned."""

    time: FloatArray  # strictly rising, shape (n,) [s]
    value: FloatArray  # 20 lg of the level over the surface speed, shape (n,) [dB]
    by_speed: FloatArray  # 20 lg of the surface speed, shape (n,) [dB]


def bin_level(time: FloatArray, decibels: FloatArray, speed_time: FloatArray, speed: FloatArray) -> LevelBins:
    """Return a level in bins of 0.25 s, less ``20 lg V``, while the shaft turned; empty without values.

    Args:
        time: Times of the level, shape (n,) [s].
        decibels: The level, shape (n,) [dB]; values that are not finite are skipped.
        speed_time: Times of the speed, rising, shape (m,) [s]; beyond them the shaft counts as at rest.
        speed: Surface speed, shape (m,) [m/s].
    """
    is_finite = np.isfinite(decibels)
    if not is_finite.any() or not speed_time.size:
        return LevelBins(np.empty(0), np.empty(0), np.empty(0))
    bins, inverse = np.unique(np.floor(time[is_finite] / BIN), return_inverse=True)
    value = np.bincount(inverse, decibels[is_finite]) / np.bincount(inverse)
    middle = (bins + 0.5) * BIN
    size = np.interp(middle, speed_time, np.abs(speed), left=0.0, right=0.0)
    turns = size > 0.0
    by_speed = 20.0 * np.log10(size[turns])
    return LevelBins(middle[turns], value[turns] - by_speed, by_speed)


class NoTwoModes(CalibrationError):
    """A level in which quiet and vibration cannot be told apart.

    Attributes:
        levels: The level in each recording.
    """

    def __init__(self, text: str, levels: tuple[LevelBins, ...]) -> None:
        super().__init__(text)
        self.levels = levels


def threshold_of(levels: Sequence[LevelBins]) -> float:
    """Return the threshold between quiet and vibration in all recordings, as level less ``20 lg V`` [dB].

    Raises:
        NoTwoModes: The level varies by less than 0.1 dB, or is missing; its values do not fall into two modes
            6 dB apart, with few of them between; or the modes differ by the speed alone.
    """
    value, by_speed = (
        np.concatenate([np.empty(0), *(getattr(level, name) for level in levels)])
        for name in ('value', 'by_speed')
    )
    order = np.argsort(value)
    x, raw = value[order], (value + by_speed)[order]
    if x.size < 2 or np.ptp(raw) < 0.1:  # it is stuck
        has = f'it stays at {raw[0]:.1f} dB' if x.size else 'no valid value came while the shaft turned'
        text = f'the level has no two modes: {has}; is its sensor connected, and its unit right?'
        raise NoTwoModes(text, tuple(levels))
    n = np.arange(1, x.size)
    below, total = np.cumsum(x)[:-1], float(x.sum())
    k = int(np.argmax((below * x.size - total * n) ** 2 / (n * (x.size - n)))) + 1
    low, high = float(np.median(x[:k])), float(np.median(x[k:]))
    quarter = 0.25 * (high - low)
    lost = int(np.count_nonzero((x > low + quarter) & (x < high - quarter)))
    # A level that does not depend on the speed has two modes by the speed alone.
    same = abs(float(np.median(raw[:k]) - np.median(raw[k:]))) < 3.0
    # ``lost`` are the values in the middle half between the modes.
    if high - low < MIN_MODE_DISTANCE or same or lost > 0.4 * min(k, x.size - k):
        raise NoTwoModes(
            f'the level has no two modes: {low:.1f} and {high:.1f} dB over the speed, and'
            f' {lost / x.size:.0%} of the values between them; give recordings in which the'
            " bearing vibrates and is quiet, or an operator's --reports (--picture shows the"
            ' values)',
            tuple(levels),
        )
    return 0.5 * (low + high)


def level_reports(
    bearing: str, level: LevelBins, threshold: float, source: str
) -> tuple[list[VibrationReport], list[VibrationReport]]:
    """Return reports of vibration and quiet in order of time, and of knocks: vibrations of less than 10 s.

    Parts of the level without a gap of 5 s are read one by one; those of fewer than three bins are skipped.
    The begin of a vibration is moved back by the median lag with which the level falls. All have a tolerance
    of 1 s and a trust of 0.95.

    Args:
        bearing: Name of the bearing.
        level: Its level.
        threshold: Between the two modes [dB].
        source: Name of the recording; each report but those of knocks adds its number to it.
    """
    reports: list[VibrationReport] = []
    knocks: list[VibrationReport] = []
    lags: list[float] = []

    def report(a: float, b: float, squeal: bool) -> VibrationReport:
        """Return a report from ``a`` to ``b`` [s], right to 1 s with a probability of 0.95."""
        times = round(a * 1e9), round(b * 1e9)
        return VibrationReport(bearing, *times, squeal, 1.0, 0.95, source, True)

    for part in np.split(np.arange(level.time.size), np.flatnonzero(np.diff(level.time) > 5.0) + 1):
        t, x = level.time[part], level.value[part]
        if t.size < 3:
            continue
        quiet, last = float(t[0]), 0
        for a, b in _find_spells(t, x >= threshold):
            if t[b - 1] - t[a] < 10.0:
                knocks.append(report(t[a], t[b - 1], True))
                continue
            on, off, late = _time_vibration(t, x, a, b)
            lags += late
            reports += [report(quiet, on, False)] if a and on > quiet else []
            reports.append(report(on, off if b < t.size else float(t[-1]), True))
            quiet, last = off, b
        if last < t.size and t[-1] - quiet > _MIN_PAUSE:
            reports.append(report(quiet, float(t[-1]), False))
    lag = round(1e9 * float(np.median(lags))) if lags else 0
    for i, (before, one) in enumerate(pairwise(reports)):  # the rise lags as the fall does
        start = one.start_ns - lag
        if one.squeal and not before.squeal and start > before.start_ns:
            reports[i : i + 2] = replace(reports[i], end_ns=start), replace(one, start_ns=start)
    return [replace(one, source=f'{source}, {k + 1}') for k, one in enumerate(reports)], knocks


def _time_vibration(t: FloatArray, x: FloatArray, a: int, b: int) -> tuple[float, float, list[float]]:
    """Return when a vibration begins and ends [s], and the lag of its level [s].

    Its plateaus are the medians of its first and last ten seconds.

    Args:
        t: Times of the bins, shape (n,) [s].
        x: Level less ``20 lg V`` in them, shape (n,) [dB].
        a: First bin of the vibration.
        b: The bin after its last one.

    Returns:
        Begin and end, from which the lag is subtracted; and the lag as a list of one, empty where the level
        does not fall along a line within 6 s.
    """
    # A level that lags by seconds is on its way for long: the plateau is where it has arrived.
    levels, high_times = x[a:b], t[a:b][x[a:b] >= np.median(x[a:b]) - EDGE]
    rise = float(np.median(levels[t[a:b] <= high_times[0] + 10.0]))
    fall = float(np.median(levels[(t[a:b] >= high_times[-1] - 10.0) & (t[a:b] <= high_times[-1])]))
    on = float(t[a + int(np.argmax(levels >= rise - EDGE))]) if a else float(t[0])
    edge = b - 1 - int(np.argmax(levels[::-1] >= fall - EDGE))
    off = float(t[edge])
    foot = np.flatnonzero((x[edge:] < fall - FOOT) & (t[edge:] <= off + SLOWEST_FALL))
    if not foot.size or b == t.size:
        return on, off, []
    # A level that lags falls along a straight line in dB, which began at the plateau.
    lag = float(t[edge + foot[0]] - off) * EDGE / (FOOT - EDGE)
    return on, max(off - lag, on), [lag]


def _find_spells(t: FloatArray, high: np.ndarray) -> list[list[int]]:
    """Return the first bin, and the bin after the last, of each part that is high, in order.

    Parts with less than 3 s between them are one. ``t`` has the times of the bins [s], ``high`` whether each
    is high, shape (n,).
    """
    edges = np.flatnonzero(np.diff(high.astype(int), prepend=0, append=0))
    spells: list[list[int]] = []
    for a, b in edges.reshape(-1, 2).tolist():
        if spells and t[a] - t[spells[-1][1] - 1] < _MIN_PAUSE:
            spells[-1][1] = b
        else:
            spells.append([a, b])
    return spells
