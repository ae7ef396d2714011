# SPDX-License-Identifier: Apache-2.0
"""Reports of vibration, and recordings cut into dips below the speeds at which it can be."""

from __future__ import annotations

import bisect
import math
import re
import zlib
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from datetime import datetime, timezone
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stickslip_monitor.arrays import FloatArray, IntArray
from stickslip_monitor.errors import CalibrationError
from stickslip_monitor.files import read_table
from stickslip_monitor.lab.calibration.posterior import (
    BEGIN,
    LOAD_TERM,
    LOG_SPEED,
    QUIET,
    RIGHT,
    SPEED,
    STATE,
    STICKING,
    WRONG,
    H,
)

BIN_NS = 10**9
_LONGEST, _NEAR = 8, 15
_CHANGE = 0.02
_HALF = 0.5
TRUST, OPERATOR_TRUST = 0.99, 0.9
TRUTH_TOLERANCE, LEVEL_TOLERANCE, OPERATOR_TOLERANCE = 2.0, 2.0, 10.0
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

    @property
    def seconds(self) -> float:
        """Its length [s]."""
        return (self.end_ns - self.start_ns) / 1e9

    @property
    def is_flicker(self) -> bool:
        """Whether it is shorter than its two ends are uncertain, and so no evidence."""
        return self.seconds < 2.0 * self.tolerance

    @property
    def core(self) -> tuple[int, int]:
        """What is left after its tolerance at both ends, at least its middle [ns]."""
        off = round(self.tolerance * 1e9)
        start, end = self.start_ns + off, self.end_ns - off
        middle = (self.start_ns + self.end_ns) // 2
        return (start, end) if start < end else (middle, middle)


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
            raise CalibrationError(
                f'{where}: it has {len(cells)} cells and there are {len(names)} headings'
            )
        reports.append(_report(where, dict(zip(names, cells, strict=True)), bearings))
    return in_order(reports)


def _report(where: str, row: dict[str, str], bearings: Sequence[str]) -> VibrationReport:
    if row['bearing'] not in bearings:
        raise CalibrationError(
            f"{where}: bearing '{row['bearing']}' is not configured; there are:"
            f' {", ".join(bearings)}'
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
        raise CalibrationError(
            f"{where} '{text}' must be a time such as 2026-05-04T06:01:10Z"
        ) from None
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


@dataclass(frozen=True, slots=True, eq=False)
class Dip:
    """One passage below the speeds at which stick-slip can be."""

    recording: str  # name of the recording
    start_ns: int  # its begin [ns]
    end_ns: int  # its end [ns]
    reports: tuple[VibrationReport, ...]  # those about it, in order of time
    time_ns: IntArray  # middle of each bin, shape (bins,) [ns]
    path: FloatArray  # what the likelihood takes, shape (bins, 8)
    fingerprint: str = ''  # of the recording's contents
    flickers: tuple[VibrationReport, ...] = ()  # reports that are too short to be evidence

    def repeats(self, fingerprint: str, start_ns: int, end_ns: int) -> bool:
        """Whether it has telemetry in common with another dip of the same contents."""
        overlap = self.start_ns < end_ns and start_ns < self.end_ns
        return overlap and self.fingerprint == fingerprint

    @property
    def episode(self) -> bool:
        """Whether a report is of vibration."""
        return any(report.squeal for report in self.reports)

    @property
    def speed(self) -> FloatArray:
        """Surface speed, shape (bins,) [m/s]."""
        return self.path[:, SPEED]


def course_of(name: str, time_ns: IntArray, speed: FloatArray, load: FloatArray) -> TelemetryBins:
    """Averages over bins of a second; times do not fall [ns], shapes are (n,) [m/s, N]."""
    bins, inverse = np.unique(time_ns // BIN_NS, return_inverse=True)
    count = np.bincount(inverse)
    size = np.abs(speed)
    mean_speed, mean_load = (np.bincount(inverse, weights=x) / count for x in (size, load))
    resting = np.bincount(inverse, weights=size == 0.0) > 0
    return TelemetryBins(
        name, bins * BIN_NS + BIN_NS // 2, np.where(resting, 0.0, mean_speed), mean_load
    )


def cut_dips(
    course: TelemetryBins,
    reports: Sequence[VibrationReport],
    limit: Callable[[FloatArray], FloatArray],
    viscous: float = 0.0,
    gap_ns: int = 3 * BIN_NS,
) -> list[Dip]:
    """The dips of a recording of which something was reported.

    Args:
        course: Speed and load.
        reports: In order of time, of this bearing; none that contradicts another.
        limit: Speed below which a dip lasts [m/s], by load [N].
        viscous: ``nu/c`` [1/N].
        gap_ns: Time without a value after which a dip begins anew [ns].
    """
    inside = (course.speed > 0.0) & (course.load > 0.0)
    inside &= course.speed < limit(np.where(inside, course.load, 1.0))
    split = np.diff(course.time_ns, prepend=course.time_ns[:1]) > gap_ns
    number = np.cumsum(split | np.diff(inside, prepend=False))
    dips = []
    for one in np.unique(number[inside]):
        rows = np.flatnonzero((number == one) & inside)
        dip = _dip(course, rows, reports, viscous)
        if dip is not None:
            dips.append(dip)
    return dips


def _dip(
    course: TelemetryBins,
    rows: NDArray[np.intp],
    reports: Sequence[VibrationReport],
    viscous: float,
) -> Dip | None:
    time = course.time_ns[rows]
    start, end = int(time[0]) - BIN_NS // 2, int(time[-1]) + BIN_NS // 2
    about = [
        (r, replace(r, start_ns=max(r.start_ns, start), end_ns=min(r.end_ns, end)))
        for r in reports
        if r.end_ns > start and r.start_ns < end
    ]
    own = tuple(part for whole, part in about if not whole.is_flicker)
    if not own or rows.size < 2:
        return None
    marks = sorted(time_ns for r in own for time_ns in (*r.core, r.start_ns, r.end_ns))
    begins = _merged(time, course.speed[rows], marks)
    width = np.diff(np.append(begins, rows.size))

    def mean(values: NDArray[np.float64]) -> FloatArray:
        return np.add.reduceat(values, begins) / width

    offset = int(time[0])
    middle = np.round(mean((time - offset).astype(float))).astype(np.int64) + offset
    speed, load = mean(course.speed[rows]), mean(course.load[rows])
    path = path_of(middle, speed, load, own, (start, end), viscous)
    flickers = tuple(part for whole, part in about if whole.is_flicker)
    return Dip(course.name, start, end, own, middle, path, course.fingerprint, flickers)


def _merged(time: IntArray, speed: FloatArray, marks: Sequence[int]) -> NDArray[np.intp]:
    """First row of each bin: a second near a mark, else up to 8 s and 2 % of speed."""
    begins = [0]
    for row in range(1, time.size):
        place = bisect.bisect_left(marks, int(time[row]) - _NEAR * BIN_NS)
        near = place < len(marks) and marks[place] <= time[row] + _NEAR * BIN_NS
        first = begins[-1]
        long = time[row] - time[first] >= _LONGEST * BIN_NS
        if near or long or abs(speed[row] - speed[first]) > _CHANGE * speed[first]:
            begins.append(row)
    return np.array(begins, dtype=np.intp)


def path_of(
    time_ns: IntArray,
    speed: FloatArray,
    load: FloatArray,
    reports: Sequence[VibrationReport],
    span: tuple[int, int],
    viscous: float = 0.0,
) -> FloatArray:
    """A dip as the likelihood takes it, shape (bins, 8), up to the last report.

    Time, the middles of bins [ns], speed [m/s] and load [N] are of shape (bins,), above 0 and
    rising in time; the span is the dip's [ns], ``viscous`` is ``nu/c`` [1/N].
    """
    path = np.zeros((time_ns.size, 8))
    path[1:, H] = np.diff(time_ns) / 1e9
    path[0, H] = _HALF
    path[:, SPEED], path[:, LOG_SPEED] = speed, np.log(speed)
    path[:, LOAD_TERM] = np.log(load / (1.0 + viscous * load))
    last = -1
    for k, report in enumerate(reports):
        start, end = report.core
        first = max(last + 1, int(np.searchsorted(time_ns, start)))
        last = max(first, int(np.searchsorted(time_ns, end, 'right')) - 1)
        if last >= time_ns.size:
            last = time_ns.size - 1
            break
        path[first : last + 1, STATE] = STICKING if report.squeal else QUIET
        path[first, BEGIN] = 1.0
        path[last, RIGHT] = report.trust
        path[last, WRONG] = (1.0 - report.trust) * chance(reports, k, (span[1] - span[0]) / 1e9)
    ends = np.flatnonzero((path[:, RIGHT] > 0.0) | (path[:, WRONG] > 0.0))
    return path[: ends[-1] + 1] if ends.size else path[:0]


def load_of(path: FloatArray, viscous: float = 0.0) -> FloatArray:
    """The loads of a dip's path, shape (bins,) [N]."""
    term = np.exp(path[:, LOAD_TERM])
    return term / (1.0 - viscous * term)


def chance(reports: Sequence[VibrationReport], k: int, seconds: float) -> float:
    """The probability with which a worthless report ``k`` would have read just this.

    A wrong squeal could have begun, and ended, at any of the dip's seconds, so that it meets a
    report of quiet only by chance. An end at which no quiet is reported says nothing of that.
    """
    report = reports[k]
    if not report.squeal:
        return _HALF
    share = min(1.0, 2.0 * report.tolerance / seconds)
    return float(_HALF * share ** counter_reports(reports, k))


def counter_reports(reports: Sequence[VibrationReport], k: int) -> int:
    """At how many ends of a squeal a report of quiet meets it, within its tolerance."""
    report, off = reports[k], round(reports[k].tolerance * 1e9)
    gaps = [report.start_ns - r.end_ns for r in reports[max(k - 1, 0) : k] if not r.squeal]
    gaps += [r.start_ns - report.end_ns for r in reports[k + 1 : k + 2] if not r.squeal]
    return sum(gap <= off for gap in gaps)
