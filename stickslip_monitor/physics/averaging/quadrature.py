# SPDX-License-Identifier: Apache-2.0
"""Averages of a friction law over one harmonic cycle, for any law, split where it is not smooth.

The relative speed of the cycle is ``v(t) = V - a cos t``. Between two neighbouring breakpoints of
the law the integrand is analytic in ``t``, so a fixed Gauss-Legendre rule converges spectrally
there; across a breakpoint it would not. Sums run term by term, so the value of one element never
depends on what else is in the array.

The averaged negative slope of friction over amplitude and speed is tabulated once for a law:

    ``rho(a; V) = 2 S(a; V)/a``   with   ``rho(0; V) = -mu'(V)``

Its amplitude coordinate ``x`` runs from 0 through the sliding limit at 1 (``a = V x``) to 2
(``a = V / cos((x-1) pi/2)``): along it ``rho`` is smooth on both sides of the limit. The load does
not enter.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from stickslip_monitor.arrays import FloatArray, IndexArray
from stickslip_monitor.physics.friction import FrictionLaw, Tabulated, computes_as


def gauss_rule(order: int) -> tuple[FloatArray, FloatArray]:
    """Gauss-Legendre nodes and weights on [0, 1]."""
    nodes, weights = np.polynomial.legendre.leggauss(order)
    return 0.5 + 0.5 * nodes, 0.5 * weights


_BLOCK = 8192
# Between two points of a measured table a stretch of so few radians needs so few nodes.
_TABLE_RULES = ((0.02, gauss_rule(3)), (0.3, gauss_rule(6)), (np.inf, gauss_rule(16)))
# Stretches for which memory is taken at a time.
_STRETCHES = 400_000

# Averages of functions of the relative speed, of cos t and of the element, on one set of nodes.
Integrand = Callable[[FloatArray, FloatArray, NDArray[np.intp]], tuple[FloatArray, ...]]


def crossing_angle(speed: FloatArray, amplitude: FloatArray, level: FloatArray | float) -> FloatArray:
    """Phase ``t`` in [0, pi] at which ``V - a cos t`` passes a level; clipped to the ends.

    The half-angle form keeps full precision at grazing, where ``arccos`` loses half its digits.

    Args:
        speed: ``V`` >= 0 [m/s].
        amplitude: Velocity amplitude ``a`` > 0 [m/s], shape of ``speed``.
        level: Relative speeds to look for [m/s]; broadcasts with ``speed``.
    """
    rise = np.clip((((amplitude - speed) + level) / amplitude) * 0.5, 0.0, 1.0)
    angle: FloatArray = 2.0 * np.arcsin(np.sqrt(rise))
    return angle


@lru_cache(maxsize=64)
def _levels(law: FrictionLaw) -> FloatArray:
    """Relative speeds at which the friction of a cycle is not smooth, ascending."""
    breaks = law.breakpoints
    return np.array([*(-b for b in reversed(breaks)), 0.0, *breaks])


def _panels(
    law: FrictionLaw, speed: FloatArray, amplitude: FloatArray
) -> tuple[FloatArray, FloatArray, IndexArray]:
    """Smooth stretches of the half cycles that have any width: start, width and element.

    In the order of elements, and of t within one; each of shape (stretches,).
    """
    levels = _levels(law)
    first = np.searchsorted(levels, speed - amplitude, side='right')
    inside = np.maximum(np.searchsorted(levels, speed + amplitude, side='left') - first, 0)
    stretches = inside + 1
    end = np.cumsum(stretches)
    element = np.repeat(np.arange(speed.size), stretches)
    # The number of each stretch in its half cycle, which ends where the next level is passed.
    number = np.arange(element.size) - (end - stretches)[element]
    last = number == inside[element]
    edge = np.full(element.size, np.pi)
    passing = element[~last]
    level = levels[first[passing] + number[~last]]
    edge[~last] = crossing_angle(speed[passing], amplitude[passing], level)
    start = np.where(number == 0, 0.0, np.roll(edge, 1))
    width = edge - start
    used = np.flatnonzero(width)
    return start[used], width[used], element[used]


def _cycle_integrals(
    law: FrictionLaw, speed: FloatArray, amplitude: FloatArray, integrand: Integrand
) -> list[FloatArray]:
    """Averages over half a cycle of functions of relative speed, ``cos t`` and element."""
    most = max(1, _STRETCHES // _levels(law).size)
    parts = [
        _integrals(law, speed, amplitude, integrand, slice(first, first + most))
        for first in range(0, max(speed.size, 1), most)
    ]
    return [np.concatenate(sums) for sums in zip(*parts, strict=True)]


def _integrals(
    law: FrictionLaw, speed: FloatArray, amplitude: FloatArray, integrand: Integrand, part: slice
) -> list[FloatArray]:
    """:func:`_cycle_integrals` of some elements."""
    begin, extent, element = _panels(law, speed[part], amplitude[part])
    # Between its points a table is a cubic, where another law may fall by orders of magnitude.
    rules = _TABLE_RULES if computes_as(law, Tabulated) else _TABLE_RULES[-1:]
    which = np.searchsorted([widest for widest, _ in rules], extent, side='right')
    nothing = np.zeros((0, 1))
    count = len(integrand(nothing, nothing, np.zeros(0, dtype=np.intp)))
    sums = [np.zeros(element.size) for _ in range(count)]
    for rule, (_, (nodes, weights)) in enumerate(rules):
        where = np.flatnonzero(which == rule)
        for first in range(0, where.size, _BLOCK):
            block = where[first : first + _BLOCK]
            index = element[block] + (part.start or 0)
            sine = np.sin(0.5 * (begin[block, None] + nodes * extent[block, None]))
            drop = 2.0 * sine * sine
            # V - a cos t without its cancellation: at grazing the sign of v decides the sum.
            relative = (speed - amplitude)[index, None] + amplitude[index, None] * drop
            values = integrand(relative, 1.0 - drop, index)
            for total, value in zip(sums, values, strict=True):
                total[block] = np.add.reduce(value * weights, axis=1)
    # Stretch by stretch in the order of t, so that no element sees another.
    size = speed[part].size
    return [np.bincount(element, total * extent, size) / np.pi for total in sums]


def friction_harmonic(law: FrictionLaw, speed: FloatArray, amplitude: FloatArray) -> FloatArray:
    """``S(a; V) = (1/pi) integral_0^pi mu(V - a cos t) cos t dt`` by split quadrature.

    Args:
        law: Any friction law.
        speed: ``V`` >= 0 [m/s].
        amplitude: Velocity amplitude ``a`` > 0 [m/s], shape of ``speed``.

    Returns:
        ``S`` [-], shape of ``speed``.
    """
    shape, speed, amplitude = speed.shape, speed.ravel(), amplitude.ravel()
    level = law.coefficient(speed)

    def varying(v: FloatArray, cosine: FloatArray, element: NDArray[np.intp]) -> tuple[FloatArray]:
        return (_varying(law, v, level[element]) * cosine,)

    (integral,) = _cycle_integrals(law, speed, amplitude, varying)
    return (integral - _constant(level, speed, amplitude)).reshape(shape)


def _varying(law: FrictionLaw, v: FloatArray, level: FloatArray) -> FloatArray:
    """Friction less its constant part, that of steady sliding.

    Taken out, that leaves no rounding noise that would pass for cycles where friction is flat.
    """
    own = level[:, None]
    return law.coefficient(v) - np.where(v < 0.0, -own, own)


def _constant(level: FloatArray, speed: FloatArray, amplitude: FloatArray) -> FloatArray:
    """The average of the constant part, which has a closed form; negative."""
    reach = np.maximum(amplitude, speed)
    sine = np.sqrt(((reach - speed) / reach) * (1.0 + speed / reach))
    return (2.0 / np.pi) * level * sine


def friction_harmonic_and_slope(
    law: FrictionLaw, speed: FloatArray, amplitude: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """``S`` [-] and ``dS/da`` [s/m], the latter by differentiation under the integral.

    The reversal of friction at the sliding limit adds
    ``-(2 mu_s/pi) (V^2/a^3) / sqrt(1 - V^2/a^2)`` for ``a > V``: ``-inf`` at ``a = V+``. Arguments
    as of :func:`friction_harmonic`.
    """
    shape, speed, amplitude = speed.shape, speed.ravel(), amplitude.ravel()
    level = law.coefficient(speed)

    def both(v: FloatArray, cosine: FloatArray, element: NDArray[np.intp]) -> tuple[FloatArray, FloatArray]:
        varying = _varying(law, v, level[element])
        return varying * cosine, law.slope(v) * cosine * cosine

    integral, fall = _cycle_integrals(law, speed, amplitude, both)
    reversing = amplitude > speed
    ratio = np.where(reversing, speed / amplitude, 0.0)
    root = np.sqrt(np.where(reversing, (amplitude - speed) / amplitude, 1.0) * (1.0 + ratio))
    jump = (2.0 * law.static / np.pi) * ratio * ratio / (amplitude * root)
    average = integral - _constant(level, speed, amplitude)
    return average.reshape(shape), (-fall - np.where(reversing, jump, 0.0)).reshape(shape)


_QUARTER = 0.5 * np.pi
_BELOW = np.linspace(0.0, 1.0, 49)
_ABOVE = 1.0 + np.concatenate([np.geomspace(1e-9, 1e-2, 15), np.linspace(0.02, 0.98, 25)])
GRID = np.concatenate([_BELOW, _ABOVE])
CUSP = _BELOW.size - 1
_EQUILIBRIUM_PER_PANEL = 24
_PEAK_SPEEDS = 200
# A table of more points is not asked at every one of them: it costs in proportion to their square.
_PANELS = 40
# Points of a table up to which all count: one of 100 that scatters by 0.004 has its fold at 0.107
# m/s by 40 of them, at 0.185 by all.
WHOLE = 200
_FAR_SPEEDS = np.geomspace(1.0, 1e6, 97)
_SPEEDS = 1024
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


def slope_and_derivative(law: FrictionLaw, x: FloatArray, speed: FloatArray) -> tuple[FloatArray, FloatArray]:
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
        f_inner, f_outer = (np.where(left_wins, f_fresh, f_outer), np.where(left_wins, f_inner, f_fresh))
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
    for start in range(0, speed.size, _SPEEDS):
        part = speed[start : start + _SPEEDS]
        grid, wide = np.broadcast_arrays(GRID, part[:, None])
        rows[start : start + _SPEEDS] = slope_surface(law, grid.ravel(), wide.ravel()).reshape(grid.shape)
    return rows


def peak_and_place(law: FrictionLaw, speed: FloatArray, rows: FloatArray) -> tuple[FloatArray, FloatArray]:
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
    most = _PANELS if len(law.breakpoints) > WHOLE else None
    per_panel = max(1, _PEAK_SPEEDS // panels) if panels < _PANELS else 1
    far = law.breakpoints[-1] * (_FAR_SPEEDS[1:] if panels < _PANELS else _FAR_SPEEDS[4::4])
    steady, heights = equilibrium_table(law)
    # No speed at which even steady sliding is unstable may fall between two of the table.
    steepest = steady[np.argmax(heights)]
    few = np.unique(np.concatenate([_panel_speeds(law, per_panel, most), [steepest], far]))
    speeds = np.insert(few, np.arange(1, few.size), 0.5 * (few[1:] + few[:-1]))
    rows = surface_rows(law, speeds)
    # What the straight line over two cells is off in their middle is far more than the line over
    # one of them is anywhere: a fourth where rho is smooth, twice as much at a kink.
    off = np.abs(rows[1::2] - 0.5 * (rows[:-1:2] + rows[2::2]))
    doubt = _DOUBT * np.repeat(off, 2, axis=0) + _NOISE * np.abs(rows).max(axis=1)[:-1, None]
    peak, place = peak_and_place(law, speeds, rows)
    return SlopeTable(speeds, rows, np.vstack([doubt, doubt[-1:]]), peak, place)
