# SPDX-License-Identifier: Apache-2.0
"""Boundaries and amplitudes for a friction law without closed forms, by scanning and polishing.

Everything follows from one surface that the load does not enter, the averaged negative slope

    ``rho(a; V) = 2 S(a; V)/a``   with   ``rho(0; V) = -mu'(V)``.

With ``q = c/N`` a cycle has ``rho = q`` and is stable where ``rho`` falls with ``a``; the
equilibrium is unstable where ``rho(0) > q``; the highest Hopf speed and the fold are the highest
speeds at which ``rho(0)`` and ``max_a rho`` still reach ``q``. The amplitude coordinate ``x`` runs
from 0 through the sliding limit at 1 (``a = V x``) to 2 (``a = V / cos((x-1) pi/2)``): along it
``rho`` is smooth on both sides of the limit. No number of roots is assumed.

Arguments are as in :mod:`stickslip_monitor.physics.kbm_stribeck`.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from stickslip_monitor.physics.friction import Array, FrictionLaw
from stickslip_monitor.physics.quadrature import friction_harmonic, friction_harmonic_slope
from stickslip_monitor.physics.rootfinding import newton_on_bracket, secant_on_bracket

_QUARTER = 0.5 * np.pi
_BELOW = np.linspace(0.0, 1.0, 49)
_ABOVE = 1.0 + np.concatenate([np.geomspace(1e-9, 1e-2, 15), np.linspace(0.02, 0.98, 25)])
_GRID = np.concatenate([_BELOW, _ABOVE])
_EQUILIBRIUM_PER_PANEL = 24
_PEAK_SPEEDS = 200
_FAR_SPEEDS = np.geomspace(1.0, 1e6, 97)
_BLOCK = 1024
# Friction has no scale outside this range; inside it no amplitude over- or underflows.
_SLOWEST, _FASTEST = 1e-200, 1e200
_ROUNDING = 4e-16
_SMALLEST = 1e-3
_GOLDEN = 0.5 * (np.sqrt(5.0) - 1.0)


def _amplitude(x: Array, speed: Array) -> Array:
    beyond = np.maximum(x - 1.0, 0.0) * _QUARTER
    return np.where(x <= 1.0, speed * x, speed / np.cos(beyond))


def _slope_surface(law: FrictionLaw, x: Array, speed: Array) -> Array:
    """``rho`` at amplitude coordinates ``x`` [s/m]; ``x`` and ``speed`` of one shape."""
    a = _amplitude(np.where(x > 0.0, x, 1.0), speed)
    return np.where(x > 0.0, 2.0 * friction_harmonic(law, speed, a) / a, -law.slope(speed))


def _slope_surface_with_derivative(
    law: FrictionLaw, x: Array, speed: Array
) -> tuple[Array, Array]:
    a = _amplitude(x, speed)
    rho = 2.0 * friction_harmonic(law, speed, a) / a
    per_a = (2.0 * friction_harmonic_slope(law, speed, a) - rho) / a
    stretch = np.where(x <= 1.0, speed, a * np.tan(np.maximum(x - 1.0, 0.0) * _QUARTER) * _QUARTER)
    return rho, per_a * stretch


def _golden_maximum(
    height: Callable[[Array], Array], left: Array, right: Array
) -> tuple[Array, Array]:
    """Golden-section maximum on each ``[left, right]``: place and height."""
    low, high = left.copy(), right.copy()
    inner, outer = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
    f_inner, f_outer = height(inner), height(outer)
    # At a maximum the value is off by the square of this: 24 steps leave 1e-14.
    for _ in range(24):
        left_wins = f_inner > f_outer
        low, high = np.where(left_wins, low, inner), np.where(left_wins, outer, high)
        fresh = np.where(left_wins, high - _GOLDEN * (high - low), low + _GOLDEN * (high - low))
        f_fresh = height(fresh)
        inner, outer = np.where(left_wins, fresh, outer), np.where(left_wins, inner, fresh)
        f_inner, f_outer = (
            np.where(left_wins, f_fresh, f_outer),
            np.where(left_wins, f_inner, f_fresh),
        )
    return np.where(f_inner > f_outer, inner, outer), np.maximum(f_inner, f_outer)


def _peaks(
    law: FrictionLaw, speed: Array, left: Array, right: Array, sign: Array
) -> tuple[Array, Array]:
    """Maximum of ``sign * rho`` on each ``[left, right]``: place and ``rho`` there."""
    place, height = _golden_maximum(lambda x: sign * _slope_surface(law, x, speed), left, right)
    return place, sign * height


def _surface_rows(law: FrictionLaw, speed: Array) -> Array:
    """``rho`` on the amplitude grid for each speed, shape (n, len(_GRID))."""
    rows = np.empty((speed.size, _GRID.size))
    for start in range(0, speed.size, _BLOCK):
        part = speed[start : start + _BLOCK]
        grid, wide = np.broadcast_arrays(_GRID, part[:, None])
        rows[start : start + _BLOCK] = _slope_surface(law, grid.ravel(), wide.ravel()).reshape(
            grid.shape
        )
    return rows


def _peak_and_place(law: FrictionLaw, speed: Array) -> tuple[Array, Array]:
    """``max_a rho(a; V)`` [s/m] and the amplitude coordinate where it stands."""
    rows = _surface_rows(law, speed)
    best = np.argmax(rows, axis=1)
    peak, place = rows[np.arange(speed.size), best], _GRID[best]
    # The surface has a cusp at the sliding limit: there, and only there, a grid point is exact.
    smooth = np.flatnonzero(place != 1.0)
    # Towards a = 0 the quotient S/a loses its digits; there the slope itself stands on the grid.
    left = np.maximum(_GRID[np.maximum(best[smooth] - 1, 0)], _SMALLEST)
    right = _GRID[np.minimum(best[smooth] + 1, _GRID.size - 1)]
    x, refined = _peaks(law, speed[smooth], left, right, np.ones(smooth.size))
    higher = refined > peak[smooth]
    peak[smooth] = np.where(higher, refined, peak[smooth])
    place[smooth] = np.where(higher, x, place[smooth])
    # A fall in the last digit of the coefficient is rounding, not friction.
    reach = np.abs(peak) * _amplitude(place, speed)
    peak[(place > 0.0) & (reach < _ROUNDING * law.coefficient(speed))] = 0.0
    return peak, place


def peak_slope(law: FrictionLaw, speed: Array) -> Array:
    """``max_a rho(a; V)`` [s/m] for each speed."""
    return _peak_and_place(law, np.clip(speed, _SLOWEST, _FASTEST))[0]


def _panel_speeds(law: FrictionLaw, per_panel: int) -> Array:
    edges = np.array([0.0, *law.breakpoints])
    near = np.geomspace(1e-9, 0.9, 40) * edges[1]
    steps = (np.arange(per_panel) + 1.0) / per_panel
    panels = edges[:-1, None] + np.diff(edges)[:, None] * steps
    return np.concatenate([near[near < panels[0, 0]], panels.ravel()])


@lru_cache(maxsize=32)
def _equilibrium_table(law: FrictionLaw) -> tuple[Array, Array]:
    """Speeds up to the last breakpoint, the steepest falls among them, and ``rho(0)`` there."""
    speeds = _panel_speeds(law, _EQUILIBRIUM_PER_PANEL)
    heights = -law.slope(speeds)
    top = np.flatnonzero((heights[1:-1] > heights[:-2]) & (heights[1:-1] >= heights[2:]))
    steepest, _ = _golden_maximum(lambda v: -law.slope(v), speeds[top], speeds[top + 2])
    speeds = np.unique(np.concatenate([speeds, steepest]))
    return speeds, -law.slope(speeds)


@lru_cache(maxsize=32)
def _peak_table(law: FrictionLaw) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Speeds far past the last breakpoint, ``max rho`` there, and whether the cusp is the peak."""
    per_panel = max(1, _PEAK_SPEEDS // len(law.breakpoints))
    far = law.breakpoints[-1] * _FAR_SPEEDS[1:]
    steady, heights = _equilibrium_table(law)
    # No speed at which even steady sliding is unstable may fall between two of the table.
    steepest = steady[np.argmax(heights)]
    speeds = np.unique(np.concatenate([_panel_speeds(law, per_panel), [steepest], far]))
    peak, place = _peak_and_place(law, speeds)
    return speeds, peak, place == 1.0


def _last_above(heights: Array, q: Array) -> NDArray[np.intp]:
    """Index of the last height that exceeds ``q``; -1 where none does."""
    from_right = np.maximum.accumulate(heights[::-1])[::-1]
    return np.searchsorted(-from_right, -q, side='left') - 1


def hopf_speed(law: FrictionLaw, q: Array) -> Array:
    """Highest speed at which the equilibrium loses its stability [m/s]; ``nan`` without one."""
    result = np.full_like(q, np.nan)
    if not law.breakpoints:
        return result
    speeds, heights = _equilibrium_table(law)
    index = _last_above(heights, q)
    # A law that ends on a falling stretch is flat beyond it: its last speed is the boundary.
    result[index == speeds.size - 1] = speeds[-1]
    inside = (index >= 0) & (index < speeds.size - 1)
    result[inside] = secant_on_bracket(
        lambda v, level: -law.slope(v) - level,
        speeds[index[inside]],
        speeds[index[inside] + 1],
        (q[inside],),
    )
    return result


def fold_speed(law: FrictionLaw, q: Array) -> Array:
    """Highest speed with a stick-slip cycle [m/s]; ``nan`` where no speed has one."""
    if not law.breakpoints:
        return np.full_like(q, np.nan)
    speeds, heights, cusp = _peak_table(law)
    index = _last_above(heights, q)
    result = np.where(index >= 0, np.inf, np.nan)
    inside = np.flatnonzero((index >= 0) & (index < speeds.size - 1))
    index = index[inside]
    at_cusp = cusp[index] & cusp[index + 1]
    for chosen, height in ((at_cusp, _cusp_slope), (~at_cusp, peak_slope)):
        result[inside[chosen]] = secant_on_bracket(
            lambda v, level, h=height: h(law, v) - level,
            speeds[index[chosen]],
            speeds[index[chosen] + 1],
            (q[inside[chosen]],),
        )
    return result


def _cusp_slope(law: FrictionLaw, speed: Array) -> Array:
    return _slope_surface(law, np.ones_like(speed), speed)


def equilibrium_is_unstable(
    law: FrictionLaw, speed: Array, q: Array, hopf: Array
) -> NDArray[np.bool_]:
    """Where a small disturbance grows: ``-mu'(V) > q``; there may be several such ranges."""
    return -law.slope(speed) > q


def boundaries(law: FrictionLaw, q: Array) -> tuple[Array, Array]:
    """Hopf and fold speed [m/s]."""
    return hopf_speed(law, q), fold_speed(law, q)


def has_cycle(law: FrictionLaw, speed: Array, q: Array, fold: Array) -> NDArray[np.bool_]:
    """Where a stick-slip cycle exists; there may be several such ranges of speed."""
    result = np.zeros(speed.shape, dtype=bool)
    inside = np.flatnonzero((speed > 0.0) & (speed < fold))
    if inside.size:
        result[inside] = ~np.isnan(stable_amplitude(law, speed[inside], q[inside]))
    return result


def stable_amplitude(law: FrictionLaw, speed: Array, q: Array) -> Array:
    """Velocity amplitude of the largest stable cycle [m/s], ``nan`` for none."""
    amplitude, stable = cycles(law, speed, q)
    return np.fmax.reduce(np.where(stable > 0.0, amplitude, np.nan), axis=1, initial=np.nan)


def threshold_amplitude(law: FrictionLaw, speed: Array, q: Array) -> Array:
    """Velocity amplitude of the smallest unstable cycle [m/s] about a stable equilibrium.

    ``nan`` where steady sliding is not stable or no cycle surrounds it.
    """
    amplitude, stable = cycles(law, speed, q)
    if not amplitude.shape[1]:
        return np.full(speed.shape, np.nan)
    surrounds = (stable[:, 0] == 0.0) & ~equilibrium_is_unstable(law, speed, q, speed)
    return np.where(surrounds, amplitude[:, 0], np.nan)


def cycles(law: FrictionLaw, speed: Array, q: Array) -> tuple[Array, Array]:
    """Every cycle's velocity amplitude, ascending and padded with ``nan``, and its stability.

    Returns:
        Amplitudes [m/s] and stability (1.0 stable, 0.0 unstable), both of shape (n, w) with the
        ``w`` of the point that has most.
    """
    given, speed = speed, np.clip(speed, _SLOWEST, _FASTEST)
    point, left, right, rising = _brackets(law, speed, q)

    def difference(x: Array, v: Array, level: Array, up: Array) -> tuple[Array, Array]:
        rho, slope = _slope_surface_with_derivative(law, x, v)
        sign = np.where(up > 0.0, -1.0, 1.0)
        return sign * (rho - level), sign * slope

    x = newton_on_bracket(
        difference, left, right, 0.5 * (left + right), (speed[point], q[point], rising)
    )
    with np.errstate(over='ignore'):
        a = _amplitude(x, given[point])
    return _pad(speed.size, point, a, 1.0 - rising)


def _brackets(
    law: FrictionLaw, speed: Array, q: Array
) -> tuple[NDArray[np.intp], Array, Array, Array]:
    """Stretches of the amplitude grid with one root: point, ends, and 1.0 where rho rises."""
    above = _surface_rows(law, speed) - q[:, None]
    point, column = np.nonzero((above[:, :-1] > 0.0) != (above[:, 1:] > 0.0))
    left, right = _GRID[column], _GRID[column + 1]
    rising = (above[point, column] <= 0.0).astype(float)

    # A peak or dip between grid points can hide two roots: look where the grid turns towards q.
    here = above[:, 1:-1]
    side = np.sign(here)
    towards = (side * above[:, :-2] > side * here) & (side * above[:, 2:] > side * here)
    same = (side * above[:, :-2] > 0.0) & (side * above[:, 2:] > 0.0)
    p, c = np.nonzero(towards & same)
    turn, value = _peaks(law, speed[p], _GRID[c], _GRID[c + 2], -side[p, c])
    crossed = (value - q[p]) * side[p, c] < 0.0
    p, c, turn = p[crossed], c[crossed], turn[crossed]
    up = (above[p, c] <= 0.0).astype(float)
    return (
        np.concatenate([point, p, p]),
        np.concatenate([left, _GRID[c], turn]),
        np.concatenate([right, turn, _GRID[c + 2]]),
        np.concatenate([rising, up, 1.0 - up]),
    )


def _pad(
    points: int, point: NDArray[np.intp], amplitude: Array, stable: Array
) -> tuple[Array, Array]:
    """Group roots by their point, ascending: shape (points, most roots of any point)."""
    order = np.lexsort([amplitude, point])
    point, amplitude, stable = point[order], amplitude[order], stable[order]
    counts = np.bincount(point, minlength=points)
    rank = np.arange(point.size) - np.repeat(np.cumsum(counts) - counts, counts)
    width = int(counts.max(initial=0))
    amplitudes, stabilities = np.full((points, width), np.nan), np.zeros((points, width))
    amplitudes[point, rank], stabilities[point, rank] = amplitude, stable
    return amplitudes, stabilities
