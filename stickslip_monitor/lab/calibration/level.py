# SPDX-License-Identifier: Apache-2.0
"""When a bearing vibrated, from its level alone: no threshold, no rule, no believed boundary.

The amplitude of a stick-slip cycle is in proportion to the surface speed, whatever the sensor and
its gain. So a level in dB less ``20 lg V`` has two narrow modes, quiet and vibration, and what
parts them best over all recordings together is the threshold between them (N. Otsu, IEEE Trans.
Syst. Man Cybern. 9 (1979) 62). The edges of a vibration are where its level is 3 dB below its own
plateau; how late a level falls, and so rises, shows in the straight line of its fall.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.errors import CalibrationError
from stickslip_monitor.lab.calibration.evidence import LEVEL_TOLERANCE, TRUST, VibrationReport

BIN = 0.25
"""Width of the bins in which a level is averaged [s]."""
APART = 6.0
"""Least distance of the two modes [dB]."""
# A vibration shorter than this is a knock; a rest shorter than this does not end one; a level that
# is older says nothing [s].
_SHORTEST, _REST, _GAP = 10.0, 3.0, 5.0
# What varies less is stuck, and how far the modes must be apart without the speed, too [dB].
_STUCK, _LOUDER = 0.1, 3.0
# Values in the middle half between the modes, as a share of those in the smaller mode.
_BETWEEN = 0.4
# Distances below the plateau at which a fall is timed [dB], and the slowest fall that is the
# level's own and not the lining's [s].
EDGE, FOOT, SLOWEST_FALL = 3.0, 9.0, 6.0
# Seconds at either end of a vibration of which its plateau is the median.
_PLATEAU = 10.0


@dataclass(frozen=True, slots=True, eq=False)
class LevelBins:
    """A level of vibration over a recording, in bins while the shaft turned."""

    time: FloatArray  # strictly rising, shape (n,) [s]
    value: FloatArray  # 20 lg of the level over the surface speed, shape (n,) [dB]
    by_speed: FloatArray  # 20 lg of the surface speed, shape (n,) [dB]


def level_over_speed(
    time: FloatArray, decibels: FloatArray, speed_time: FloatArray, speed: FloatArray
) -> LevelBins:
    """A level in bins, less ``20 lg V``, while the shaft turned.

    Args:
        time: Times of the level, shape (n,) [s].
        decibels: The level, shape (n,) [dB].
        speed_time: Times of the speed, rising, shape (m,) [s].
        speed: Surface speed, shape (m,) [m/s].
    """
    known = np.isfinite(decibels)
    if not known.any() or not speed_time.size:
        return LevelBins(np.empty(0), np.empty(0), np.empty(0))
    bins, inverse = np.unique(np.floor(time[known] / BIN), return_inverse=True)
    value = np.bincount(inverse, decibels[known]) / np.bincount(inverse)
    middle = (bins + 0.5) * BIN
    size = np.interp(middle, speed_time, np.abs(speed), left=0.0, right=0.0)
    turns = size > 0.0
    by_speed = 20.0 * np.log10(size[turns])
    return LevelBins(middle[turns], value[turns] - by_speed, by_speed)


class NoTwoModes(CalibrationError):
    """A level in which quiet and vibration cannot be told apart.

    Attributes:
        levels: That level, of each recording.
    """

    def __init__(self, text: str, levels: tuple[LevelBins, ...]) -> None:
        super().__init__(text)
        self.levels = levels


@dataclass(frozen=True, slots=True)
class Modes:
    """The two modes of a level over all recordings."""

    low: float  # median of the quiet values [dB]
    high: float  # median of those in vibration [dB]
    threshold: float  # between them [dB]
    between: float  # share of the values in the middle half between them


def modes_of(levels: Sequence[LevelBins]) -> Modes:
    """The two modes of a level.

    Raises:
        NoTwoModes: The text says what it has.
    """
    value, by_speed = (
        np.concatenate([np.empty(0), *(getattr(level, name) for level in levels)])
        for name in ('value', 'by_speed')
    )
    order = np.argsort(value)
    x, raw = value[order], (value + by_speed)[order]
    if x.size < 2 or np.ptp(raw) < _STUCK:
        has = f'it stays at {raw[0]:.1f} dB' if x.size else 'none came while the shaft turned'
        text = f'the level has no two modes: {has}; is its sensor connected?'
        raise NoTwoModes(text, tuple(levels))
    n = np.arange(1, x.size)
    below, total = np.cumsum(x)[:-1], float(x.sum())
    k = int(np.argmax((below * x.size - total * n) ** 2 / (n * (x.size - n)))) + 1
    low, high = float(np.median(x[:k])), float(np.median(x[k:]))
    quarter = 0.25 * (high - low)
    lost = int(np.count_nonzero((x > low + quarter) & (x < high - quarter)))
    # What is as loud at every speed parts by the speed alone.
    same = abs(float(np.median(raw[:k]) - np.median(raw[k:]))) < _LOUDER
    if high - low < APART or same or lost > _BETWEEN * min(k, x.size - k):
        raise NoTwoModes(
            f'the level has no two modes: {low:.1f} and {high:.1f} dB over the speed, and'
            f' {lost / x.size:.0%} of the values between them; give recordings in which the'
            " bearing vibrates and is quiet, or an operator's --reports (--picture shows the"
            ' values)',
            tuple(levels),
        )
    return Modes(low, high, 0.5 * (low + high), lost / x.size)


def level_reports(
    bearing: str, level: LevelBins, threshold: float, source: str
) -> tuple[list[VibrationReport], list[VibrationReport]]:
    """Vibration and quiet in the order of time, and the knocks, which are neither.

    Args:
        bearing: Name of the bearing.
        level: Its level.
        threshold: Between the two modes [dB].
        source: Where the level stands, for a sentence.
    """
    found: list[VibrationReport] = []
    knocks: list[VibrationReport] = []
    lags: list[float] = []
    for part in np.split(np.arange(level.time.size), np.flatnonzero(np.diff(level.time) > _GAP) + 1):
        if part.size > 2:
            _read(bearing, level.time[part], level.value[part], threshold, found, knocks, lags)
    lag = round(1e9 * float(np.median(lags))) if lags else 0
    for i, one in enumerate(found):  # the rise lags as the fall does
        before = found[i - 1] if i else None
        if before and one.squeal and not before.squeal and one.start_ns - lag > before.start_ns:
            found[i - 1] = replace(before, end_ns=one.start_ns - lag)
            found[i] = replace(one, start_ns=one.start_ns - lag)
    numbered = [replace(one, source=f'{source}, {k + 1}') for k, one in enumerate(found)]
    return numbered, [replace(one, source=source) for one in knocks]


def _read(
    bearing: str,
    t: FloatArray,
    x: FloatArray,
    threshold: float,
    found: list[VibrationReport],
    knocks: list[VibrationReport],
    lags: list[float],
) -> None:
    """The reports of a stretch without a gap; what its falls lag is added to ``lags``."""
    quiet = float(t[0])

    def report(a: float, b: float, squeal: bool) -> VibrationReport:
        times = round(a * 1e9), round(b * 1e9)
        return VibrationReport(bearing, *times, squeal, LEVEL_TOLERANCE, TRUST, '', True)

    last = 0
    for a, b in _spells(t, x >= threshold):
        if t[b - 1] - t[a] < _SHORTEST:
            knocks.append(report(t[a], t[b - 1], True))
            continue
        rise = float(np.median(x[a:b][t[a:b] <= t[a] + _PLATEAU]))
        fall = float(np.median(x[a:b][t[a:b] >= t[b - 1] - _PLATEAU]))
        on = float(t[a + int(np.argmax(x[a:b] >= rise - EDGE))]) if a else float(t[0])
        edge = b - 1 - int(np.argmax(x[a:b][::-1] >= fall - EDGE))
        off = float(t[edge])
        foot = np.flatnonzero((x[edge:] < fall - FOOT) & (t[edge:] <= off + SLOWEST_FALL))
        if foot.size and b < t.size:
            # A level that lags falls along a straight line in dB, which began at the plateau.
            lags.append(float(t[edge + foot[0]] - off) * EDGE / (FOOT - EDGE))
            off = max(off - lags[-1], on)
        if a and on > quiet:
            found.append(report(quiet, on, False))
        found.append(report(on, off if b < t.size else float(t[-1]), True))
        quiet, last = off, b
    if last < t.size and t[-1] - quiet > _REST:
        found.append(report(quiet, float(t[-1]), False))


def _spells(t: FloatArray, high: np.ndarray) -> list[list[int]]:
    """Begin and end (the first row after) of each stretch that is high but for short rests."""
    edges = np.flatnonzero(np.diff(high.astype(int), prepend=0, append=0))
    spells: list[list[int]] = []
    for a, b in edges.reshape(-1, 2).tolist():
        if spells and t[a] - t[spells[-1][1] - 1] < _REST:
            spells[-1][1] = b
        else:
            spells.append([a, b])
    return spells
