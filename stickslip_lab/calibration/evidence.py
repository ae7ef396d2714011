# SPDX-License-Identifier: Apache-2.0
"""Collects the evidence of a calibration: speed and load of recordings, and reports of vibration."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import datetime
from itertools import pairwise
from pathlib import Path

import numpy as np

from stickslip_lab import MAX_TABLE_BYTES
from stickslip_lab.scenes.truth_topics import TruthRecord
from stickslip_logs.tables.dialect import parse_heading
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
    unit = parse_heading(dict(zip(names, headings, strict=True)).get('tolerance', '')).unit
    if unit not in (None, 's'):
        raise CalibrationError(f"{path}, line {rows[0].line}: the tolerance is in '{unit}': write it in s")
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
