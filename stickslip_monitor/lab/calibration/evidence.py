# SPDX-License-Identifier: Apache-2.0
"""What a calibration rests on: speed and load of recordings, and reports of vibration."""

from __future__ import annotations

import math
import re
import zlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import datetime, timezone
from itertools import pairwise
from pathlib import Path

import numpy as np

from stickslip_monitor.arrays import FloatArray, IntArray
from stickslip_monitor.errors import CalibrationError
from stickslip_monitor.files import read_table

BIN_NS = 10**9
TRUST, TRUTH_TRUST, OPERATOR_TRUST = 0.95, 0.999, 0.9
LEVEL_TOLERANCE, TRUTH_TOLERANCE, OPERATOR_TOLERANCE = 1.0, 1.0, 10.0
STATES = {'squeal': True, 'quiet': False}
_COLUMNS = ('bearing', 'start', 'end', 'state')
_EPOCH = datetime(1970, 1, 1, tzinfo=timezone.utc)
_FRACTION = re.compile(r'(:\d\d)\.(\d+)')
_LARGEST = 16 << 20


@dataclass(frozen=True, slots=True)
class VibrationReport:
    """A report that a bearing vibrated or was quiet."""

    bearing: str  # name of the bearing
    start_ns: int  # from when [ns]
    end_ns: int  # until when [ns]
    squeal: bool  # whether it vibrated
    tolerance: float  # how far the two times may be off [s]
    trust: float  # probability that the report is not worthless
    source: str  # where it stands, for a sentence
    rings: bool = False  # whether it is of a level, which ends when a cycle has died away

    @property
    def seconds(self) -> float:
        """Its length [s]."""
        return (self.end_ns - self.start_ns) / 1e9

    @property
    def is_flicker(self) -> bool:
        """Whether it is shorter than its two ends are uncertain, and so no evidence."""
        return self.seconds < 2.0 * self.tolerance


def read_reports(path: str | Path, bearings: Sequence[str]) -> list[VibrationReport]:
    """Read an operator's reports on some bearings.

    Cells are separated by comma, semicolon or tab; blank lines and lines that start with ``#``
    are skipped. The first other line has the headings ``bearing, start, end, state`` and, as one
    likes, ``tolerance [s]`` and ``trust``. Times are ISO 8601 with a zone.

    Raises:
        CalibrationError: A line breaks a rule; the text names file, line, value and rule.
    """
    rows, _ = read_table(path, _LARGEST, CalibrationError)
    if len(rows) < 2:
        raise CalibrationError(f'{path} has no reports: give headings and a line for each report')
    headings, body = rows[0].cells, rows[1:]
    names = [re.sub(r'\s*[\[(].*', '', text).strip().lower() for text in headings]
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
        reports.append(_report(where, dict(zip(names, cells, strict=True)), bearings))
    return in_order(reports)


def _report(where: str, row: dict[str, str], bearings: Sequence[str]) -> VibrationReport:
    if row['bearing'] not in bearings:
        raise CalibrationError(
            f"{where}: bearing '{row['bearing']}' is not configured; there are: {', '.join(bearings)}"
        )
    if row['state'].lower() not in STATES:
        raise CalibrationError(f"{where}: state '{row['state']}' must be squeal or quiet")
    start, end = (_time(f'{where}: {name}', row[name]) for name in ('start', 'end'))
    if end <= start:
        raise CalibrationError(f"{where}: end '{row['end']}' must be after start '{row['start']}'")
    tolerance = _number(where, row, 'tolerance', OPERATOR_TOLERANCE, math.inf)
    trust = _number(where, row, 'trust', OPERATOR_TRUST, 1.0)
    squeal = STATES[row['state'].lower()]
    return VibrationReport(row['bearing'], start, end, squeal, tolerance, trust, where)


def _time(where: str, text: str) -> int:
    """Nanoseconds of an ISO 8601 time with a zone."""
    fraction = _FRACTION.search(text)
    whole = _FRACTION.sub(r'\1', text)
    try:
        moment = datetime.fromisoformat(re.sub('[zZ]$', '+00:00', whole))
    except ValueError:
        raise CalibrationError(f"{where} '{text}' must be a time such as 2026-05-04T06:01:10Z") from None
    if moment.tzinfo is None:
        raise CalibrationError(f"{where} '{text}' has no zone: end it in Z or +02:00, say")
    passed = moment - _EPOCH
    digits = fraction.group(2)[:9].ljust(9, '0') if fraction else '0'
    return (passed.days * 86400 + passed.seconds) * 10**9 + int(digits)


def _number(where: str, row: dict[str, str], name: str, default: float, highest: float) -> float:
    text = row.get(name, '')
    if not text:
        return default
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not (0.0 <= value <= highest and math.isfinite(value)):
        limit = '' if highest == math.inf else f' to {highest:g}'
        raise CalibrationError(f"{where}: {name} '{text}' must be a number from 0{limit}")
    return value


def in_order(reports: Iterable[VibrationReport]) -> list[VibrationReport]:
    """Reports by bearing and time.

    Raises:
        CalibrationError: Two of them contradict each other.
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


def alternating(
    bearing: str,
    span: tuple[int, int],
    episodes: Sequence[tuple[int, int]],
    tolerance: float,
    trust: float,
    source: str,
) -> list[VibrationReport]:
    """Reports that leave no gap in a span [ns]: squeal in the episodes, quiet between them."""
    edges = [span[0], *(time for episode in episodes for time in episode), span[1]]
    return [
        VibrationReport(bearing, start, end, bool(k % 2), tolerance, trust, f'{source}, {k + 1}')
        for k, (start, end) in enumerate(pairwise(edges))
        if end > start
    ]


@dataclass(frozen=True, slots=True, eq=False)
class TelemetryBins:
    """Speed and load of one bearing over one recording, in bins of a second."""

    name: str  # the recording, for a sentence
    time_ns: IntArray  # middle of each bin, strictly rising, shape (n,) [ns]
    speed: FloatArray  # magnitude of the surface speed, shape (n,) [m/s]; 0 at rest
    load: FloatArray  # shape (n,) [N]

    @property
    def fingerprint(self) -> str:
        """Separates recordings of other contents, whatever their names."""
        columns = (self.time_ns, self.speed, self.load)
        return f'{zlib.crc32(b"".join(column.tobytes() for column in columns)):08x}'


def course_of(name: str, time_ns: IntArray, speed: FloatArray, load: FloatArray) -> TelemetryBins:
    """Averages over bins of a second; times do not fall [ns], shapes are (n,) [m/s, N]."""
    bins, inverse = np.unique(time_ns // BIN_NS, return_inverse=True)
    count = np.bincount(inverse)
    size = np.abs(speed)
    mean_speed, mean_load = (np.bincount(inverse, weights=x) / count for x in (size, load))
    resting = np.bincount(inverse, weights=size == 0.0) > 0
    return TelemetryBins(name, bins * BIN_NS + BIN_NS // 2, np.where(resting, 0.0, mean_speed), mean_load)
