# SPDX-License-Identifier: Apache-2.0
"""Reports of vibration, whatever their source: an operator's file, a measured level, the truth."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from datetime import datetime, timezone
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy.special import expit

from stickslip_monitor.arrays import FloatArray, IntArray
from stickslip_monitor.errors import CalibrationError
from stickslip_monitor.files import read_table
from stickslip_monitor.lab.calibration.dips import VibrationReport

TRUST, OPERATOR_TRUST = 0.99, 0.9
TRUTH_TOLERANCE, LEVEL_TOLERANCE, OPERATOR_TOLERANCE = 2.0, 2.0, 10.0
STATES = {'squeal': True, 'quiet': False}
_COLUMNS = ('bearing', 'start', 'end', 'state')
_EPOCH = datetime(1970, 1, 1, tzinfo=timezone.utc)
_FRACTION = re.compile(r'(:\d\d)\.(\d+)')
_HYSTERESIS_DB = 3.0
_SHORTEST = 1.0
# Modes closer than this many standard deviations cannot be told apart.
_APART = 3.0
_ROUNDS = 200
_LARGEST = 16 << 20


def read_reports(path: str | Path, bearings: Sequence[str]) -> list[VibrationReport]:
    """Read an operator's reports.

    Cells are separated by comma, semicolon or tab; blank lines and lines that start with ``#``
    are skipped. The first other line has the headings ``bearing, start, end, state`` and, as one
    likes, ``tolerance [s]`` and ``trust``. Times are ISO 8601 with a zone.

    Args:
        path: The file.
        bearings: The bearings that there are.

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
    """Reports that leave no gap: squeal in the episodes, quiet between them.

    Args:
        bearing: Name of the bearing.
        span: First and last time that is known of [ns].
        episodes: In order of time [ns].
        tolerance: Of all times [s].
        trust: Of each report.
        source: Where they come from.
    """
    edges = [span[0], *(time for episode in episodes for time in episode), span[1]]
    return [
        VibrationReport(bearing, start, end, bool(k % 2), tolerance, trust, f'{source}, {k + 1}')
        for k, (start, end) in enumerate(pairwise(edges))
        if end > start
    ]


def level_episodes(
    time_ns: IntArray, level: FloatArray, threshold: float, gap_ns: int
) -> list[tuple[int, int]]:
    """When a level was above its threshold for a second or more [ns].

    Args:
        time_ns: Not falling, shape (n,) [ns].
        level: Above 0, shape (n,).
        threshold: From :func:`level_threshold`; an episode ends 3 dB lower.
        gap_ns: An episode ends where nothing is heard for that long [ns].
    """
    lower = threshold * 10.0 ** (-_HYSTERESIS_DB / 20.0)
    place = np.maximum.accumulate(
        np.where((level >= threshold) | (level < lower), np.arange(level.size), -1)
    )
    loud = np.where(place >= 0, level[place] >= threshold, False)
    split = np.diff(time_ns, prepend=time_ns[:1]) > gap_ns
    edge = np.flatnonzero((np.diff(loud, prepend=False) != 0) | split)
    bounds = np.append(edge, level.size)
    found = [
        (int(time_ns[a]), int(time_ns[min(b, level.size - 1)]))
        for a, b in pairwise(bounds)
        if loud[a]
    ]
    return [(a, b) for a, b in found if b - a >= _SHORTEST * 1e9]


def level_threshold(name: str, level: FloatArray) -> float:
    """The level that tells vibration from quiet: the minimum between its two modes.

    Args:
        name: The topic, for a sentence.
        level: Shape (n,); what is not above 0 does not count.

    Raises:
        CalibrationError: It has no two modes.
    """
    known = np.log(level[np.isfinite(level) & (level > 0.0)])
    if known.size < 2 or np.ptp(known) < 1e-9:
        raise CalibrationError(
            f'the level on {name} never changes: it must be one with a quiet and a loud mode'
        )
    mean, spread, share = _two_modes(known)
    if mean[1] - mean[0] < _APART * math.hypot(*spread) / math.sqrt(2.0):
        raise CalibrationError(
            f'the level on {name} has no two modes: those of {math.exp(mean[0]):.3g} and'
            f' {math.exp(mean[1]):.3g} are closer than {_APART:g} standard deviations, so it does'
            ' not tell vibration from quiet; give a recording with both, or --reports'
        )
    between = np.linspace(mean[0], mean[1], 1001)[:, None]
    density = np.sum(share / spread * np.exp(-0.5 * ((between - mean) / spread) ** 2), axis=1)
    return math.exp(float(between[np.argmin(density), 0]))


def _two_modes(x: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Means, standard deviations and shares of two Gaussians, by expectation maximisation."""
    loud = (x > 0.5 * (x.min() + x.max())).astype(float)
    least = 1e-3 * float(np.ptp(x))
    for _ in range(_ROUNDS):
        belongs = np.stack([1.0 - loud, loud])
        share = np.maximum(belongs.mean(axis=1), 1e-12)
        mean = belongs @ x / (share * x.size)
        off = (x - mean[:, None]) ** 2
        spread = np.sqrt(np.maximum((belongs * off).mean(axis=1) / share, least**2))
        density = np.log(share / spread)[:, None] - 0.5 * off / spread[:, None] ** 2
        before, loud = loud, expit(density[1] - density[0])
        if np.max(np.abs(loud - before)) < 1e-6:
            break
    return mean, spread, share
