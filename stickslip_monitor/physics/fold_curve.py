# SPDX-License-Identifier: Apache-2.0
"""The fold over the load, read from the least load with a stick-slip cycle over the speed.

Over the load a fold begins with an infinite slope, and that of a measured table jumps from one
range of speeds with cycles to the next. Over the speed the least load is smooth and has one value,
so it is solved there, and the last speed at a load is read from that curve.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline, PchipInterpolator

from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.physics.friction import FrictionLaw
from stickslip_monitor.physics.roots import newton_on_bracket

# Distance of the speeds of a curve [ln V], and how far below the scales of a law it begins.
_SPACING, _BELOW = 0.01, 100.0
# Each so-many-th value is solved at first, and polynomials go through so many of them.
_STRIDE, _NEIGHBOURS = 64, 8


def curve_speeds(least: float, most: float) -> FloatArray:
    """Speeds [m/s] from a least to a most one, closely enough for :func:`last_speeds`."""
    strides = math.ceil(math.log(most / least) / (_SPACING * _STRIDE))
    return np.geomspace(least, most, _STRIDE * strides + 1)


def slowest_speed(law: FrictionLaw) -> float:
    """A speed far below the scales of a law, or below 1 m/s where it has none [m/s]."""
    return min((v for v in law.breakpoints if v > 0.0), default=1.0) / _BELOW


def stretches(label: NDArray[np.int_]) -> list[slice]:
    """The stretches of equal neighbours, of an array of shape (n,)."""
    edges = [0, *(np.flatnonzero(np.diff(label)) + 1), label.size]
    return [slice(int(first), int(last)) for first, last in itertools.pairwise(edges)]


def last_speeds(
    speed: FloatArray, least: FloatArray, load: FloatArray, smooth: bool
) -> FloatArray:
    """The last speeds at which a load is enough for a cycle.

    Args:
        speed: Ascending, shape (m,) [m/s].
        least: The load from which there is a cycle at each, or ``inf``, shape (m,) [N].
        load: Shape (n,) [N].
        smooth: Whether a spline joins the curve, or monotone cubics.

    Returns:
        ``nan`` where no speed has a cycle, shape (n,) [m/s].
    """
    x, y, level = np.log(speed), np.log(least), np.log(load)
    lowest = np.minimum.accumulate(y[::-1])[::-1]
    i = np.searchsorted(lowest, level, side='right') - 1
    result = np.where(i < 0, np.nan, speed[i])
    rows = np.flatnonzero((i >= 0) & (i < x.size - 1))
    rows = rows[np.isfinite(y[i[rows] + 1])]
    i = i[rows]
    slope = _slopes(x, y, smooth)
    h, rise, part = x[i + 1] - x[i], y[i + 1] - y[i], level[rows] - y[i]
    share = newton_on_bracket(
        _missing,
        np.zeros(i.size),
        np.ones(i.size),
        part / rise,
        (part, rise, h * slope[i], h * slope[i + 1]),
    )
    result[rows] = np.exp(x[i] + share * h)
    return result


def _slopes(x: FloatArray, y: FloatArray, smooth: bool) -> FloatArray:
    """The slopes of a curve at its points, of stretches that are finite."""
    slope = np.zeros(x.size)
    join = CubicSpline if smooth else PchipInterpolator
    for part in stretches(np.isfinite(y).astype(int)):
        if part.stop - part.start > 3 and np.isfinite(y[part.start]):
            slope[part] = join(x[part], y[part])(x[part], 1)
    return slope


def _missing(
    t: FloatArray, part: FloatArray, rise: FloatArray, begin: FloatArray, end: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """What a cubic on [0, 1] with a rise and two slopes still is below a level, and its slope."""
    square, cube = 3.0 * rise - 2.0 * begin - end, begin + end - 2.0 * rise
    value = t * (begin + t * (square + t * cube))
    return part - value, -(begin + t * (2.0 * square + t * 3.0 * cube))


def interpolated(
    place: FloatArray, solve: Callable[[int, float], float], close: float
) -> FloatArray:
    """Positive values at ascending places, solved only where interpolation does not give them.

    Args:
        place: Shape (n,).
        solve: The value at an index, given a guess or ``nan``; called from above.
        close: Relative error of a polynomial in the middle between solved places up to which it
            is used where these are half as far apart.
    """
    count = place.size
    value = np.full(count, np.nan)
    stride = min(_STRIDE, 1 << max(count.bit_length() - 3, 0))
    for i in range(0, count, stride)[::-1]:
        value[i] = solve(i, math.nan)
    sure_from = np.zeros(count, dtype=bool)  # from an index to the next that is known
    while stride > 1:
        half = stride // 2
        miss = np.full(count, np.inf)
        for i in range(half, count, stride)[::-1]:
            first = (i - half) // stride - _NEIGHBOURS // 2 + 1
            last = (count - 1) // stride - _NEIGHBOURS + 1
            near = range(max(min(first, last), 0) * stride, count, stride)[:_NEIGHBOURS]
            guess = math.exp(_through(place[near], np.log(value[near]), place[i]))
            value[i] = guess if sure_from[i - half] else solve(i, guess)
            known = 0.0 < value[i] < math.inf and guess > 0.0
            miss[i - half] = abs(guess / value[i] - 1.0) if known else math.inf
        # The error falls to a sixteenth at least where the stretch is halved.
        beside = np.maximum(miss, np.maximum(np.roll(miss, stride), np.roll(miss, -stride)))
        sure = beside[::stride] < close
        sure_from[::stride] = sure
        sure_from[half::stride] = sure[: sure_from[half::stride].size]
        stride = half
    return value


def _through(x: FloatArray, y: FloatArray, at: float) -> float:
    """The polynomial through some points; ``nan`` where one is missing."""
    apart = x[:, None] - x
    np.fill_diagonal(apart, 1.0)
    weights = np.prod(at - x) / (at - x) / np.prod(apart, axis=1)
    return float(weights @ y)
