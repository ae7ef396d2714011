# SPDX-License-Identifier: Apache-2.0
"""Boundaries and amplitudes for a friction law without closed forms, by scanning and polishing.

Everything follows from one surface that the load does not enter, the averaged negative slope

    ``rho(a; V) = 2 S(a; V)/a``   with   ``rho(0; V) = -mu'(V)``.

With ``q = c/N`` a cycle has ``rho = q`` and is stable where ``rho`` falls with ``a``; the
equilibrium is unstable where ``rho(0) > q``; the highest Hopf speed and the fold are the highest
speeds at which ``rho(0)`` and ``max_a rho`` still reach ``q``. No number of roots is assumed.

The functions of a law and their arguments are those of :mod:`.closed_form`.
"""

from __future__ import annotations

import numpy as np

from stickslip_monitor.arrays import BoolArray, FloatArray, IndexArray
from stickslip_monitor.physics.averaging.quadrature import (
    CUSP,
    FASTEST,
    GRID,
    SLOWEST,
    amplitude_at,
    equilibrium_table,
    peak_and_place,
    peaks,
    slope_and_derivative,
    slope_surface,
    slope_table,
    surface_rows,
)
from stickslip_monitor.physics.friction import FrictionLaw
from stickslip_monitor.physics.oscillator import damping_per_load
from stickslip_monitor.physics.roots import newton_on_bracket, root_on_bracket

_BLOCK = 1024
# How far from the places at two speeds the place of the peak between them is looked for.
_AROUND = 0.03
# The distance over which the slope of rho is differenced.
_ASIDE = 1e-6
_PEAK_STEPS, _PLACED = 8, 1e-6


def peak_slope(law: FrictionLaw, speed: FloatArray) -> FloatArray:
    """``max_a rho(a; V)`` [s/m] for each speed."""
    speed = np.clip(speed, SLOWEST, FASTEST)
    if not law.breakpoints:
        return peak_and_place(law, speed, surface_rows(law, speed))[0]
    rows, doubt = _lines(law, speed)
    # Only what may be the highest, and its neighbours, has to be known better.
    least = np.max(rows - doubt, axis=1)[:, None]
    high = ~(rows + doubt < least)
    high[:, 1:] |= high[:, :-1]
    high[:, :-1] |= high[:, 1:]
    point, column = np.nonzero(high)
    rows[point, column] = slope_surface(law, GRID[column], speed[point])
    return peak_and_place(law, speed, rows)[0]


def _last_above(heights: FloatArray, q: FloatArray) -> IndexArray:
    """Index of the last height that exceeds ``q``; -1 where none does."""
    from_right = np.maximum.accumulate(heights[::-1])[::-1]
    return np.searchsorted(-from_right, -q, side='left') - 1


def hopf_speed(law: FrictionLaw, q: FloatArray) -> FloatArray:
    """Highest speed at which the equilibrium loses its stability [m/s]; ``nan`` without one."""
    result = np.full_like(q, np.nan)
    if not law.breakpoints:
        return result
    speeds, heights = equilibrium_table(law)
    index = _last_above(heights, q)
    # A law that ends on a falling stretch is flat beyond it: its last speed is the boundary.
    result[index == speeds.size - 1] = speeds[-1]
    inside = np.flatnonzero((index >= 0) & (index < speeds.size - 1))
    if inside.size:
        index, level = index[inside], q[inside]
        result[inside] = root_on_bracket(
            lambda v, level: -law.slope(v) - level,
            speeds[index],
            speeds[index + 1],
            (heights[index] - level, heights[index + 1] - level),
            (level,),
        )
    return result


def fold_speed(law: FrictionLaw, q: FloatArray) -> FloatArray:
    """Highest speed with a stick-slip cycle [m/s]; ``nan`` where no speed has one."""
    if not law.breakpoints:
        return np.full_like(q, np.nan)
    table = slope_table(law)
    index = _last_above(table.peak, q)
    result = np.where(index >= 0, np.inf, np.nan)
    inside = np.flatnonzero((index >= 0) & (index < table.speeds.size - 1))
    if not inside.size:
        return result
    index, level = index[inside], q[inside]
    here, there = table.place[index], table.place[index + 1]
    # The highest peak is steady sliding, the cusp at the sliding limit, or one that moves little
    # from here to there; where its kind changes in between, all peaks are compared.
    ways = np.full(inside.shape, 3)
    ways[(np.abs(here - there) < _AROUND) & (np.minimum(here, there) > _AROUND)] = 2
    ways[(here - 1.0) * (there - 1.0) <= 0.0] = 3
    ways[(here == 1.0) & (there == 1.0)] = 1
    ways[(here == 0.0) & (there == 0.0)] = 0
    for way, height in enumerate((_steady, _cusp, _near, _anywhere)):
        rows = np.flatnonzero(ways == way)
        if not rows.size:
            continue
        i, own = index[rows], level[rows]
        low, high, place = table.speeds[i], table.speeds[i + 1], here[rows]
        drift = (there[rows] - place) / (high - low)
        result[inside[rows]] = root_on_bracket(
            lambda v, level, x, begin, drift, h=height: h(law, v, x + drift * (v - begin)) - level,
            low,
            high,
            (table.peak[i] - own, table.peak[i + 1] - own),
            (own, place, low, drift),
        )
    return result


def boundaries(law: FrictionLaw, q: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Hopf and fold speed [m/s]; ``nan`` where there is none, ``inf`` without an end."""
    return hopf_speed(law, q), fold_speed(law, q)


# Heights of the peak at some speeds [s/m], given the amplitude coordinate near which it stands.


def _steady(law: FrictionLaw, speed: FloatArray, near: FloatArray) -> FloatArray:
    return -law.slope(speed)


def _cusp(law: FrictionLaw, speed: FloatArray, near: FloatArray) -> FloatArray:
    return slope_surface(law, np.ones_like(speed), speed)


def _near(law: FrictionLaw, speed: FloatArray, near: FloatArray) -> FloatArray:
    x, place, v = near, near.copy(), speed
    running = np.arange(near.size)
    lost = np.zeros(near.size, dtype=bool)
    for _ in range(_PEAK_STEPS):
        slope = slope_and_derivative(law, x, v)[1]
        beside = slope_and_derivative(law, x + _ASIDE, v)[1]
        step = slope * _ASIDE / (slope - beside)
        place[running] = x + step
        # A peak that is none any more, or leaves its neighbourhood.
        wrong = ~(beside < slope) | ~(np.abs(x + step - near[running]) < _AROUND)
        wrong |= (x + step - 1.0) * (near[running] - 1.0) <= 0.0
        lost[running[wrong]] = True
        # Of what the place misses by, the height feels the square.
        keep = ~wrong & (np.abs(step) > _PLACED)
        running, x, v = running[keep], (x + step)[keep], v[keep]
        if not running.size:
            break
    lost[running] = True
    height = slope_surface(law, np.where(lost, 1.0, place), speed)
    if lost.any():
        height[lost] = peak_slope(law, speed[lost])
    return height


def _anywhere(law: FrictionLaw, speed: FloatArray, near: FloatArray) -> FloatArray:
    return peak_slope(law, speed)


def is_unstable(law: FrictionLaw, speed: FloatArray, q: FloatArray, hopf: FloatArray) -> BoolArray:
    """Where ``-mu'(V) > q``; there may be several such ranges of speed."""
    return -law.slope(speed) > q


def has_cycle(law: FrictionLaw, speed: FloatArray, q: FloatArray, fold: FloatArray) -> BoolArray:
    """Where a stable stick-slip cycle exists; there may be several such ranges of speed."""
    result = np.zeros(speed.shape, dtype=bool)
    inside = np.flatnonzero((speed > 0.0) & (speed < fold))
    for start in range(0, inside.size, _BLOCK):
        part = inside[start : start + _BLOCK]
        point, *_, rising = _brackets(law, np.clip(speed[part], SLOWEST, FASTEST), q[part])
        result[part[point[rising == 0.0]]] = True
    return result


def stable_amplitude(law: FrictionLaw, speed: FloatArray, q: FloatArray) -> FloatArray:
    """Velocity amplitude of the largest stable cycle [m/s], ``nan`` for none."""
    amplitude, stable = _cycles(law, speed, q)
    return np.fmax.reduce(np.where(stable > 0.0, amplitude, np.nan), axis=1, initial=np.nan)


def threshold_amplitude(law: FrictionLaw, speed: FloatArray, damping: float, load: FloatArray) -> FloatArray:
    """Velocity amplitude of the smallest unstable cycle [m/s] about a stable equilibrium.

    ``nan`` where steady sliding is not stable or no cycle surrounds it.
    """
    q = damping_per_load(damping, load)
    amplitude, stable = _cycles(law, speed, q)
    if not amplitude.shape[1]:
        return np.full(speed.shape, np.nan)
    surrounds = (stable[:, 0] == 0.0) & (-law.slope(speed) <= q)
    return np.where(surrounds, amplitude[:, 0], np.nan)


def cycles(
    law: FrictionLaw, speed: FloatArray, damping: float, load: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Every cycle's velocity amplitude, ascending and padded with ``nan``, and its stability.

    Returns:
        Amplitudes [m/s] and stability (1.0 stable, 0.0 unstable), both of shape (n, w) with the
        ``w`` of the point that has most.
    """
    return _cycles(law, speed, damping_per_load(damping, load))


def _cycles(law: FrictionLaw, speed: FloatArray, q: FloatArray) -> tuple[FloatArray, FloatArray]:
    given, speed = speed, np.clip(speed, SLOWEST, FASTEST)
    found = [
        (first, *_brackets(law, speed[first : first + _BLOCK], q[first : first + _BLOCK]))
        for first in range(0, max(speed.size, 1), _BLOCK)
    ]
    point = np.concatenate([first + block for first, block, *_ in found])
    left, right, start, rising = (np.concatenate([row[k] for row in found]) for k in (2, 3, 4, 5))

    def difference(
        x: FloatArray, v: FloatArray, level: FloatArray, up: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        rho, slope = slope_and_derivative(law, x, v)
        sign = np.where(up > 0.0, -1.0, 1.0)
        return sign * (rho - level), sign * slope

    roots = newton_on_bracket(difference, left, right, start, (speed[point], q[point], rising))
    with np.errstate(over='ignore'):
        a = amplitude_at(roots, given[point])
    return _pad(speed.size, point, a, 1.0 - rising)


def _brackets(
    law: FrictionLaw, speed: FloatArray, q: FloatArray
) -> tuple[IndexArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Stretches of the amplitude grid with one root.

    Returns:
        Of each its point, its ends, a first guess, and 1.0 where rho rises.
    """
    above, (p, c) = _excess(law, speed, q)
    point, column = np.nonzero((above[:, :-1] > 0.0) != (above[:, 1:] > 0.0))
    left, right = GRID[column], GRID[column + 1]
    before, after = above[point, column], above[point, column + 1]
    start = left + (right - left) * (before / (before - after))
    rising = (before <= 0.0).astype(float)
    if not p.size:
        return point, left, right, start, rising

    # A peak or dip between grid points can hide two roots.
    here = above[p, c]
    side = np.sign(here)
    turn, value = peaks(law, speed[p], GRID[c - 1], GRID[c + 1], -side)
    crossed = (value - q[p]) * side < 0.0
    p, c, turn, up = p[crossed], c[crossed], turn[crossed], (here <= 0.0).astype(float)[crossed]
    left, right = (np.concatenate([left, GRID[c - 1], turn]), np.concatenate([right, turn, GRID[c + 1]]))
    start = np.concatenate([start, 0.5 * (left + right)[start.size :]])
    return (np.concatenate([point, p, p]), left, right, start, np.concatenate([rising, up, 1.0 - up]))


def _excess(
    law: FrictionLaw, speed: FloatArray, q: FloatArray
) -> tuple[FloatArray, tuple[IndexArray, IndexArray]]:
    """``rho - q`` on the amplitude grid, and where a turn next to a grid point may reach ``q``.

    From the law's table where that leaves no doubt about the sign, else from the average itself.
    """
    if not law.breakpoints:
        above = surface_rows(law, speed) - q[:, None]
        return above, _turns(law, speed, above, *np.nonzero(_bent(above, 0.0)))
    above, doubt = _lines(law, speed)
    above -= q[:, None]
    point, column = np.nonzero(~(np.abs(above) > doubt))
    if point.size:
        above[point, column] = slope_surface(law, GRID[column], speed[point]) - q[point]
    point, column = np.nonzero(_bent(above, doubt))
    for k in (0, 1, 2) if point.size else ():
        above[point, column + k] = slope_surface(law, GRID[column + k], speed[point]) - q[point]
    return above, _turns(law, speed, above, point, column)


def _lines(law: FrictionLaw, speed: FloatArray) -> tuple[FloatArray, FloatArray]:
    """``rho`` on the amplitude grid by lines between the speeds of the table.

    Returns:
        It and how far it may be off, ``inf`` beyond the table; both of shape (n, len(GRID)).
    """
    table = slope_table(law)
    i = np.searchsorted(table.speeds, speed, side='right') - 1
    beyond = (i < 0) | (i >= table.speeds.size - 1)
    i = np.minimum(np.maximum(i, 0), table.speeds.size - 2)
    share = (speed - table.speeds[i]) / (table.speeds[i + 1] - table.speeds[i])
    low, doubt = table.rows[i], table.doubt[i]
    doubt[beyond] = np.inf
    return low + (table.rows[i + 1] - low) * share[:, None], doubt


def _bent(above: FloatArray, doubt: FloatArray | float) -> BoolArray:
    """Triples of grid points on one side of ``q`` whose parabola may reach it."""
    left, here, right = above[:, :-2], above[:, 1:-1], above[:, 2:]
    side = (left > 0.0) == (right > 0.0)
    side &= (left > 0.0) == (here > 0.0)
    slack = 4.0 * doubt[:, 1:-1] if isinstance(doubt, np.ndarray) else doubt
    # It goes beyond the middle point by an eighth of this at most.
    return side & (np.abs(here) <= np.abs(left - 2.0 * here + right) + slack)


def _turns(
    law: FrictionLaw, speed: FloatArray, above: FloatArray, p: IndexArray, c: IndexArray
) -> tuple[IndexArray, IndexArray]:
    """Those triples that turn towards ``q``, by point and middle column."""
    left, here, right = (above[p, c + k] for k in range(3))
    side = np.sign(here)
    towards = (side * left > side * here) & (side * right > side * here)
    towards &= (side * left > 0.0) & (side * right > 0.0)
    p, c = p[towards], c[towards] + 1
    # At the sliding limit a peak is the cusp itself, unless rho already falls towards it.
    at_cusp = np.flatnonzero(c == CUSP)
    if at_cusp.size:
        slope = slope_and_derivative(law, np.ones(at_cusp.size), speed[p[at_cusp]])[1]
        keep = np.ones(p.size, dtype=bool)
        keep[at_cusp] = slope < 0.0
        p, c = p[keep], c[keep]
    return p, c


def _pad(
    points: int, point: IndexArray, amplitude: FloatArray, stable: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Group roots by their point, ascending: shape (points, most roots of any point)."""
    order = np.lexsort([amplitude, point])
    point, amplitude, stable = point[order], amplitude[order], stable[order]
    counts = np.bincount(point, minlength=points)
    rank = np.arange(point.size) - np.repeat(np.cumsum(counts) - counts, counts)
    width = int(counts.max(initial=0))
    amplitudes, stabilities = np.full((points, width), np.nan), np.zeros((points, width))
    amplitudes[point, rank], stabilities[point, rank] = amplitude, stable
    return amplitudes, stabilities
