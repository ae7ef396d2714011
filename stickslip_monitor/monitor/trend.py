# SPDX-License-Identifier: Apache-2.0
"""When stick-slip begins if speed and load go on changing as they do.

The rates are Theil-Sen slopes (the median of the slopes between all pairs) of the means of time
slots, with Sen's distribution-free confidence interval (P. K. Sen, J. Am. Stat. Assoc. 63, 1968,
1379-1389). The path is followed to where steady sliding turns unstable: with the slopes
themselves, with each corner of their intervals, and with the slopes of either half of the window,
which differ where the trend bends; each with the boundary where it is said to be, and a tenth
higher and lower. What comes out is told only if all of these agree well enough, and only below
the fold: a ship that slows down mostly stops at the speed that was ordered, and above the fold
that is most often where nothing happens.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from functools import lru_cache
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stickslip_monitor.arrays import FloatArray, IntArray
from stickslip_monitor.monitor.config import BearingConfig
from stickslip_monitor.physics.averaging.boundaries import fold_speed, growth_rate
from stickslip_monitor.physics.oscillator import Bearing

_QUANTILE = 1.959963984540054  # of the normal distribution, two-sided, for 95 %
_SLOTS = 30
_FEWEST = 8
_HORIZON = 1.0
"""How far ahead it is looked [windows]: further is not a forecast."""
_SPREAD = 3.0
"""How much later than the earliest the latest crossing may be."""
_ERRORS = (1.0, 0.9, 1.1)
"""Speeds relative to which the boundary may lie where it is said to be."""
_WIDER = 1.25
"""How much wider than the cases the interval is, either way: ships change their mind."""
_STEPS = 24


@dataclass(frozen=True, slots=True)
class Trend:
    """When steady sliding turns unstable, counted from the last operating point.

    Attributes:
        seconds: Time until then [s].
        earliest: The least of the interval that holds nine in ten such times [s].
        latest: The most [s].
        span: Time over which the rates were taken [s].
    """

    seconds: float
    earliest: float
    latest: float
    span: float


class TrendWindow:
    """The last operating points as means of time slots: bounded, whatever their rate.

    Args:
        window_ns: How long the window is [ns]; 0 keeps nothing.
    """

    def __init__(self, window_ns: int) -> None:
        self._slot_ns = window_ns // _SLOTS
        # Slot, number of points, sums of time in the slot [ns], of speed and of load.
        self._slots: deque[list[float]] = deque(maxlen=_SLOTS)
        self._last_ns = 0

    def clear(self) -> None:
        """Forget all points: the clock jumped."""
        self._slots.clear()

    def add(self, time_ns: int, speed: float, load: float) -> None:
        """Add an operating point that is no older than the ones before."""
        if not self._slot_ns:
            return
        self._last_ns = time_ns
        slot, rest = divmod(time_ns, self._slot_ns)
        if self._slots and self._slots[-1][0] == slot:
            last = self._slots[-1]
            last[1] += 1
            last[2] += rest
            last[3] += speed
            last[4] += load
            return
        self._slots.append([slot, 1, rest, speed, load])
        while self._slots[0][0] <= slot - _SLOTS:
            self._slots.popleft()

    def copy(self) -> TrendWindow:
        """Another window with the same points."""
        found = TrendWindow(0)
        found._slot_ns, found._last_ns = self._slot_ns, self._last_ns
        found._slots.extend(map(list, self._slots))
        return found

    def fill(self, time_ns: IntArray, speed: FloatArray, load: FloatArray) -> None:
        """:meth:`add` of several operating points.

        Args:
            time_ns: Their times, not falling, shape (n,) [ns].
            speed: Surface speeds, shape (n,) [m/s].
            load: Loads, shape (n,) [N].
        """
        if not (self._slot_ns and time_ns.size):
            return
        self._last_ns = int(time_ns[-1])
        oldest = self._last_ns // self._slot_ns - _SLOTS + 1
        k = int(np.searchsorted(time_ns, oldest * self._slot_ns))
        slot, rest = np.divmod(time_ns[k:], self._slot_ns)
        columns: tuple[NDArray[Any], ...] = (
            slot, np.ones_like(slot), rest, speed[k:], load[k:],
        )  # fmt: skip
        if self._slots and self._slots[-1][0] == slot[0]:
            # Goes on with the sums of the last slot.
            last = self._slots.pop()
            columns = tuple(np.append(*pair) for pair in zip(last, columns, strict=True))
        self._add_slots(*columns)
        while self._slots[0][0] < oldest:
            self._slots.popleft()

    def _add_slots(
        self, slot: IntArray, count: IntArray, rest: IntArray, speed: FloatArray, load: FloatArray
    ) -> None:
        first = np.append(0, np.flatnonzero(np.diff(slot)) + 1)
        group = np.repeat(np.arange(first.size), np.diff(np.append(first, slot.size)))
        columns = (
            slot[first],
            np.add.reduceat(count, first),
            np.add.reduceat(rest, first),
            # Term by term, as they are added one by one.
            np.bincount(group, speed),
            np.bincount(group, load),
        )
        self._slots.extend(map(list, zip(*(column.tolist() for column in columns), strict=True)))

    def trend(self, config: BearingConfig) -> Trend | None:
        """When steady sliding turns unstable; ``None`` where that cannot be said."""
        if len(self._slots) < _FEWEST:
            return None
        time, speed, load = np.array(
            [
                ((slot * self._slot_ns - self._last_ns + rest / n) * 1e-9, v / n, f / n)
                for slot, n, rest, v, f in self._slots
            ]
        ).T
        span = float(-time[0])
        if 2.0 * span < _SLOTS * self._slot_ns * 1e-9:
            return None
        lines = _line(time, speed), _line(time, load)
        halves = [
            tuple(_slope(time[part], value[part]) for value in (speed, load))
            for part in (slice(None, time.size // 2), slice(time.size // 2, None))
        ]
        return _reach(config.bearing, *lines, halves, span)


def may_cross(
    config: BearingConfig,
    time_ns: IntArray,
    speed: FloatArray,
    load: FloatArray,
    begin: NDArray[np.intp],
    last: NDArray[np.intp],
) -> NDArray[np.bool_]:
    """Where there may be a trend; elsewhere :meth:`TrendWindow.trend` surely gives none.

    More than half of the pairs of n slots are at least n/4 slots apart, so the median slope is at
    most the range of the values over that time, and what the line says of now is bounded.

    Args:
        config: The bearing.
        time_ns: Times of the operating points, shape (n,) [ns].
        speed: Surface speeds, shape (n,) [m/s].
        load: Loads, shape (n,) [N].
        begin: The points before which the clock jumped last, shape (m,).
        last: The points after which the trend is asked for, -1 for none, shape (m,).
    """
    slot_ns = config.alarm.trend_window_ns // _SLOTS
    if not slot_ns:
        return np.zeros(last.size, np.bool_)
    if (time_ns[1:] < time_ns[:-1]).any():
        return last >= 0
    known = np.maximum(last, 0)
    oldest = (time_ns[known] // slot_ns - _SLOTS + 1) * slot_ns
    low = np.maximum(np.searchsorted(time_ns, oldest), begin)
    number = np.cumsum(np.diff(time_ns // slot_ns, prepend=-1) != 0)
    count = number[known] - number[low] + 1
    shift = _SLOTS / np.maximum(count // 4 - 1, 1)
    slowest, speeds = _bounds(np.abs(speed), low, known)[0], _bounds(speed, low, known)
    loads = _bounds(load, low, known)
    slow = slowest - shift * (speeds[1] - speeds[0])
    heavy = loads[1] + shift * (loads[1] - loads[0])
    fold = np.asarray(fold_speed(config.bearing, heavy))
    found: NDArray[np.bool_] = (last >= 0) & (count >= _FEWEST) & (slow < fold * (1.0 + 1e-9))
    return found


def _bounds(
    value: FloatArray, low: NDArray[np.intp], last: NDArray[np.intp]
) -> tuple[FloatArray, FloatArray]:
    """The least and the greatest of values from some on to others."""
    edges = np.stack([low, last + 1], axis=1).ravel()
    ended = np.append(value, value[-1:])
    return np.minimum.reduceat(ended, edges)[::2], np.maximum.reduceat(ended, edges)[::2]


@dataclass(frozen=True, slots=True)
class Line:
    """A robust straight line: value now, slope, and the interval of the slope."""

    now: float
    slope: float
    low: float
    high: float


@lru_cache(maxsize=_SLOTS)
def _pairs(n: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """First and second index of each pair of n things."""
    return np.triu_indices(n, 1)


def _middle(ordered: FloatArray) -> float:
    """The median of sorted values; numpy's own takes four times as long for so few."""
    half = ordered.size // 2
    return float(ordered[half] if ordered.size % 2 else 0.5 * (ordered[half - 1] + ordered[half]))


def _slope(time: FloatArray, value: FloatArray) -> float:
    """The Theil-Sen slope through some points."""
    i, j = _pairs(time.size)
    return _middle(np.sort((value[j] - value[i]) / (time[j] - time[i])))


def _line(time: FloatArray, value: FloatArray) -> Line:
    """The Theil-Sen line through some points of rising times; now is the time 0."""
    i, j = _pairs(time.size)
    slopes = np.sort((value[j] - value[i]) / (time[j] - time[i]))
    slope = _middle(slopes)
    n, pairs = time.size, slopes.size
    # Kendall's S of independent values has this variance.
    half = _QUANTILE * math.sqrt(n * (n - 1) * (2 * n + 5) / 18.0)
    low = slopes[max(round((pairs - half) / 2.0) - 1, 0)]
    high = slopes[min(round((pairs + half) / 2.0), pairs - 1)]
    now = _middle(np.sort(value - slope * time))
    return Line(now, slope, float(low), float(high))


def _reach(
    bearing: Bearing,
    speed: Line,
    load: Line,
    halves: list[tuple[float, ...]],
    span: float,
) -> Trend | None:
    if not abs(speed.now) < fold_speed(bearing, load.now):
        return None
    rates = [
        (speed.slope, load.slope),
        *product((speed.low, speed.high), (load.low, load.high)),
        *halves,
    ]
    # Each with the boundary where it is said to be, and at both ends of its own error.
    cases = np.array([(*rate, error) for error in _ERRORS for rate in rates])[:, :, np.newaxis]

    def crossed(time: FloatArray) -> NDArray[np.bool_]:
        v, n = speed.now + cases[:, 0] * time, load.now + cases[:, 1] * time
        # What comes after a standstill is another story.
        turning = v * speed.now > 0.0
        return turning & (np.asarray(growth_rate(bearing, v * cases[:, 2], n)) > 0.0)

    steps = np.linspace(0.0, 1.0, _STEPS + 1)
    begin, width = np.zeros((cases.shape[0], 1)), _HORIZON * span
    for _ in range(2):
        time = begin + width * steps
        over = crossed(time)
        first = over.argmax(axis=1)
        if not over.any(axis=1).all() or (first == 0).any():
            return None
        begin = np.take_along_axis(time, first[:, np.newaxis] - 1, axis=1)
        width /= _STEPS
    times = begin[:, 0] + width / 2.0
    earliest, latest = float(times.min()), float(times.max())
    if latest > _SPREAD * earliest:
        return None
    return Trend(float(times[0]), earliest / _WIDER, latest * _WIDER, span)
