# SPDX-License-Identifier: Apache-2.0
"""Reads a level as reports of when the bearing vibrated and was quiet.

A level shows that by itself, without a set threshold, a rule or a believed boundary. The amplitude of a
stick-slip cycle is in proportion to the surface speed, whatever the sensor and its gain. So a
level in dB less ``20 lg V`` has two narrow modes, quiet and vibration, and what parts them best
over all recordings together is the threshold between them (N. Otsu, IEEE Trans. Syst. Man Cybern.
9 (1979) 62). The edges of a vibration are where its level is 3 dB below its own plateau. The lag with which a
level falls, and so rises, follows from the straight line of its fall.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from stickslip_lab.calibration.evidence import VibrationReport
from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.errors import CalibrationError

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

    Knocks lie within the quiet around them, whose report goes on; a last quiet of up to 3 s is left out.
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
