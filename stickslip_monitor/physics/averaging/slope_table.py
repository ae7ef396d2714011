# SPDX-License-Identifier: Apache-2.0
"""The averaged negative slope of friction over amplitude and speed, and tables of it.

    ``rho(a; V) = 2 S(a; V)/a``   with   ``rho(0; V) = -mu'(V)``

The amplitude coordinate ``x`` runs from 0 through the sliding limit at 1 (``a = V x``) to 2
(``a = V / cos((x-1) pi/2)``): along it ``rho`` is smooth on both sides of the limit. The load does
not enter, so a table serves a friction law for good.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.physics.averaging.quadrature import (
    friction_harmonic,
    friction_harmonic_and_slope,
)
from stickslip_monitor.physics.friction import FrictionLaw

_QUARTER = 0.5 * np.pi
_BELOW = np.linspace(0.0, 1.0, 49)
_ABOVE = 1.0 + np.concatenate([np.geomspace(1e-9, 1e-2, 15), np.linspace(0.02, 0.98, 25)])
GRID = np.concatenate([_BELOW, _ABOVE])
CUSP = _BELOW.size - 1
_EQUILIBRIUM_PER_PANEL = 24
_PEAK_SPEEDS = 200
# A table of more points is not asked at every one of them: it costs in proportion to their square.
_PANELS = 40
_FAR_SPEEDS = np.geomspace(1.0, 1e6, 97)
_BLOCK = 1024
# Friction has no scale outside this range; inside it no amplitude over- or underflows.
SLOWEST, FASTEST = 1e-200, 1e200
_ROUNDING = 4e-16
_DOUBT, _NOISE = 4.0, 1e-12
_SMALLEST = 1e-3
_GOLDEN = 0.5 * (np.sqrt(5.0) - 1.0)


def amplitude_at(x: FloatArray, speed: FloatArray) -> FloatArray:
    """Velocity amplitude of amplitude coordinates [m/s]."""
    beyond = np.maximum(x - 1.0, 0.0) * _QUARTER
    return np.where(x <= 1.0, speed * x, speed / np.cos(beyond))


def slope_surface(law: FrictionLaw, x: FloatArray, speed: FloatArray) -> FloatArray:
    """``rho`` at amplitude coordinates [s/m]; ``x`` and ``speed`` of shape (n,)."""
    still = x == 0.0
    if not still.any():
        a = amplitude_at(x, speed)
        return 2.0 * friction_harmonic(law, speed, a) / a
    a = amplitude_at(np.where(still, 1.0, x), speed)
    return np.where(still, -law.slope(speed), 2.0 * friction_harmonic(law, speed, a) / a)


def slope_and_derivative(
    law: FrictionLaw, x: FloatArray, speed: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """``rho`` and its derivative along the amplitude coordinate [s/m]."""
    a = amplitude_at(x, speed)
    average, per_a = friction_harmonic_and_slope(law, speed, a)
    rho = 2.0 * average / a
    stretch = np.where(x <= 1.0, speed, a * np.tan(np.maximum(x - 1.0, 0.0) * _QUARTER) * _QUARTER)
    return rho, (2.0 * per_a - rho) / a * stretch


def golden_maximum(
    height: Callable[[FloatArray], FloatArray], left: FloatArray, right: FloatArray
) -> tuple[FloatArray, FloatArray]:
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


def peaks(
    law: FrictionLaw, speed: FloatArray, left: FloatArray, right: FloatArray, sign: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Maximum of ``sign * rho`` on each ``[left, right]``: place and ``rho`` there."""
    place, height = golden_maximum(lambda x: sign * slope_surface(law, x, speed), left, right)
    return place, sign * height


def surface_rows(law: FrictionLaw, speed: FloatArray) -> FloatArray:
    """``rho`` on the amplitude grid for each speed, shape (n, len(GRID))."""
    rows = np.empty((speed.size, GRID.size))
    for start in range(0, speed.size, _BLOCK):
        part = speed[start : start + _BLOCK]
        grid, wide = np.broadcast_arrays(GRID, part[:, None])
        rows[start : start + _BLOCK] = slope_surface(law, grid.ravel(), wide.ravel()).reshape(
            grid.shape
        )
    return rows


def peak_and_place(
    law: FrictionLaw, speed: FloatArray, rows: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """``max_a rho(a; V)`` [s/m] and the amplitude coordinate where it stands.

    Args:
        law: Friction law.
        speed: Shape (n,) [m/s].
        rows: ``rho`` on the amplitude grid there, shape (n, len(GRID)).
    """
    best = np.argmax(rows, axis=1)
    peak, place = rows[np.arange(speed.size), best], GRID[best]
    # The surface has a cusp at the sliding limit: there, and only there, a grid point is exact.
    smooth = np.flatnonzero(place != 1.0)
    # Towards a = 0 the quotient S/a loses its digits; there the slope itself stands on the grid.
    left = np.maximum(GRID[np.maximum(best[smooth] - 1, 0)], _SMALLEST)
    right = GRID[np.minimum(best[smooth] + 1, GRID.size - 1)]
    x, refined = peaks(law, speed[smooth], left, right, np.ones(smooth.size))
    higher = refined > peak[smooth]
    peak[smooth] = np.where(higher, refined, peak[smooth])
    place[smooth] = np.where(higher, x, place[smooth])
    # A fall in the last digit of the coefficient is rounding, not friction.
    reach = np.abs(peak) * amplitude_at(place, speed)
    peak[(place > 0.0) & (reach < _ROUNDING * law.coefficient(speed))] = 0.0
    return peak, place


def _panel_speeds(law: FrictionLaw, per_panel: int, most: int | None = None) -> FloatArray:
    """Speeds between the breakpoints of a law, of which the ``most`` are taken."""
    breaks = np.array(law.breakpoints)
    if most is not None and breaks.size > most:
        breaks = breaks[np.unique(np.linspace(0, breaks.size - 1, most).astype(np.intp))]
    edges = np.append(0.0, breaks)
    near = np.geomspace(1e-9, 0.9, 40) * edges[1]
    steps = (np.arange(per_panel) + 1.0) / per_panel
    panels = edges[:-1, None] + np.diff(edges)[:, None] * steps
    return np.concatenate([near[near < panels[0, 0]], panels.ravel()])


@lru_cache(maxsize=32)
def equilibrium_table(law: FrictionLaw) -> tuple[FloatArray, FloatArray]:
    """Speeds up to the last breakpoint, the steepest falls among them, and ``rho(0)`` there."""
    speeds = _panel_speeds(law, _EQUILIBRIUM_PER_PANEL)
    heights = -law.slope(speeds)
    top = np.flatnonzero((heights[1:-1] > heights[:-2]) & (heights[1:-1] >= heights[2:]))
    steepest, _ = golden_maximum(lambda v: -law.slope(v), speeds[top], speeds[top + 2])
    speeds = np.unique(np.concatenate([speeds, steepest]))
    return speeds, -law.slope(speeds)


@dataclass(frozen=True, slots=True)
class SlopeTable:
    """``rho`` at some speeds over the amplitude grid.

    Attributes:
        speeds: Ascending, shape (m,) [m/s].
        rows: ``rho``, shape (m, len(GRID)) [s/m].
        doubt: How far the straight line from a speed to the next may be off, shape of ``rows``.
        peak: Highest ``rho`` of each speed, shape (m,) [s/m].
        place: The amplitude coordinate where it stands, shape (m,).
    """

    speeds: FloatArray
    rows: FloatArray
    doubt: FloatArray
    peak: FloatArray
    place: FloatArray


@lru_cache(maxsize=32)
def slope_table(law: FrictionLaw) -> SlopeTable:
    """The table of a law, from zero to far past its last breakpoint."""
    panels = min(len(law.breakpoints), _PANELS)
    per_panel = max(1, _PEAK_SPEEDS // panels) if panels < _PANELS else 1
    far = law.breakpoints[-1] * (_FAR_SPEEDS[1:] if panels < _PANELS else _FAR_SPEEDS[4::4])
    steady, heights = equilibrium_table(law)
    # No speed at which even steady sliding is unstable may fall between two of the table.
    steepest = steady[np.argmax(heights)]
    few = np.unique(np.concatenate([_panel_speeds(law, per_panel, _PANELS), [steepest], far]))
    speeds = np.insert(few, np.arange(1, few.size), 0.5 * (few[1:] + few[:-1]))
    rows = surface_rows(law, speeds)
    # What the straight line over two cells is off in their middle is far more than the line over
    # one of them is anywhere: a fourth where rho is smooth, twice as much at a kink.
    off = np.abs(rows[1::2] - 0.5 * (rows[:-1:2] + rows[2::2]))
    doubt = _DOUBT * np.repeat(off, 2, axis=0) + _NOISE * np.abs(rows).max(axis=1)[:-1, None]
    peak, place = peak_and_place(law, speeds, rows)
    return SlopeTable(speeds, rows, np.vstack([doubt, doubt[-1:]]), peak, place)
