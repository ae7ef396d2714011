# SPDX-License-Identifier: Apache-2.0
"""Boundaries and amplitudes for a friction law without closed forms, by scanning and polishing.

Everything follows from one surface that the load does not enter, the averaged negative slope

    ``rho(a; V) = 2 S(a; V)/a``   with   ``rho(0; V) = -mu'(V)``.

With ``q = c/N`` a cycle has ``rho = q`` and is stable where ``rho`` falls with ``a``; the
equilibrium is unstable where ``rho(0) > q``; the highest Hopf speed and the fold are the highest
speeds at which ``rho(0)`` and ``max_a rho`` still reach ``q``. No number of roots is assumed.

Its amplitude coordinate ``x`` runs from 0 through the sliding limit at 1 (``a = V x``) to 2
(``a = V / cos((x-1) pi/2)``): along it ``rho`` is smooth on both sides of the limit.

The functions of a law and their arguments are those of :mod:`.closed_form`.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from stickslip_monitor.arrays import BoolArray, FloatArray, IndexArray
from stickslip_monitor.physics.bearing import damping_per_load, load_for
from stickslip_monitor.physics.friction import FrictionLaw, speed_scales
from stickslip_monitor.physics.numerics import root_on_bracket
from stickslip_monitor.physics.quadrature import friction_harmonic

_QUARTER = 0.5 * np.pi
_BELOW = np.linspace(0.0, 1.0, 49)
_ABOVE = 1.0 + np.concatenate([np.geomspace(1e-9, 1e-2, 15), np.linspace(0.02, 0.98, 25)])
GRID = np.concatenate([_BELOW, _ABOVE])
CUSP = _BELOW.size - 1
_EQUILIBRIUM_PER_PANEL = 24
_PEAK_SPEEDS = 200
# Points of a table up to which all are speeds of the grid, which costs in proportion to their square.
_PANELS, _WHOLE = 40, 200
# Of a table with more points, speeds besides at which peaks may stand out, at most, and the windows,
# in shares of the speed, by which that is seen: a table of 300 that scatters by 0.001 has 32, and
# its fold at 1.235 m/s; by 40 speeds alone it was at 0.62.
_OUTSTANDING = 160
_WINDOWS = np.geomspace(1e-3, 1.0, 61)
_FAR_SPEEDS = np.geomspace(1.0, 1e6, 97)
_SPEEDS = 1024
# Friction has no scale outside this range; inside it no amplitude over- or underflows.
SLOWEST, FASTEST = 1e-200, 1e200
_ROUNDING = 4e-16
_DOUBT, _NOISE = 4.0, 1e-12
_SMALLEST = 1e-3
# How far below the sliding limit rho is asked whether it rises up to there.
_ASIDE = 1e-6
# Rounds that refine the peaks of a table of many points, the share by which a line is off, and how
# far below the highest of all higher speeds a peak may stand to matter; and more new speeds than a
# round is worth: those of a curve read in steps, of which each stands out by itself.
_FINER, _BENT, _MATTERS, _MOST_FRESH = 2, 5e-3, 0.67, 400
_GOLDEN = 0.5 * (np.sqrt(5.0) - 1.0)


def amplitude_at(x: FloatArray, speed: FloatArray) -> FloatArray:
    """Return the velocity amplitudes of amplitude coordinates ``x`` at speeds [m/s]."""
    beyond = np.maximum(x - 1.0, 0.0) * _QUARTER
    return np.where(x <= 1.0, speed * x, speed / np.cos(beyond))


def slope_surface(law: FrictionLaw, x: FloatArray, speed: FloatArray) -> FloatArray:
    """``rho`` at amplitude coordinates [s/m]; ``x`` and ``speed`` of shape (n,)."""
    still = x == 0.0
    a = amplitude_at(np.where(still, 1.0, x), speed)
    rho = 2.0 * friction_harmonic(law, speed, a) / a
    # The slope of a table would cost an eighth of the verdict on a point, and is hardly ever asked for.
    return np.where(still, -law.slope(speed), rho) if still.any() else rho


def golden_maximum(
    height: Callable[[FloatArray], FloatArray], left: FloatArray, right: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Find the maximum on each ``[left, right]`` by golden section.

    Args:
        height: Function of places, shape (n,).
        left: Begins, shape (n,).
        right: Ends, shape (n,).

    Returns:
        Places and heights, each of shape (n,).
    """
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
    law: FrictionLaw, speed: FloatArray, left: FloatArray, right: FloatArray, sign: FloatArray | float = 1.0
) -> tuple[FloatArray, FloatArray]:
    """Find the maximum of ``sign * rho`` on each ``[left, right]`` of the amplitude coordinate.

    Returns:
        The places and ``rho`` there, without the sign [s/m], each of shape (n,).
    """
    place, height = golden_maximum(lambda x: sign * slope_surface(law, x, speed), left, right)
    return place, sign * height


def surface_rows(law: FrictionLaw, speed: FloatArray) -> FloatArray:
    """Evaluate ``rho`` on the amplitude grid at speeds, shape (n, len(GRID)) [s/m]."""
    rows = np.empty((speed.size, GRID.size))
    for start in range(0, speed.size, _SPEEDS):
        part = speed[start : start + _SPEEDS]
        grid, wide = np.broadcast_arrays(GRID, part[:, None])
        rows[start : start + _SPEEDS] = slope_surface(law, grid.ravel(), wide.ravel()).reshape(grid.shape)
    return rows


def highest(law: FrictionLaw, speed: FloatArray) -> tuple[FloatArray, FloatArray]:
    """``max_a rho(a; V)`` [s/m] and the amplitude coordinate where it stands, each shape (n,).

    Beyond the sliding limit ``rho`` falls, so it stands at an amplitude ``a <= V``.
    """
    parts = [
        _highest_of_block(law, speed[first : first + _SPEEDS]) for first in range(0, speed.size, _SPEEDS)
    ]
    peak, place = (np.concatenate(column) for column in zip(*parts, strict=True)) if parts else (speed, speed)
    # A fall in the last digit of the coefficient is rounding, not friction.
    reach = np.abs(peak) * amplitude_at(place, speed)
    peak[(place > 0.0) & (reach < _ROUNDING * law.coefficient(speed))] = 0.0
    return peak, place


def _highest_of_block(law: FrictionLaw, speed: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return :func:`highest` of one block of speeds, before rounding is taken out."""
    n, m = speed.size, _BELOW.size
    rows = slope_surface(law, np.tile(_BELOW, n), np.repeat(speed, m)).reshape(n, m)
    best = np.argmax(rows, axis=1)
    peak, place = rows[np.arange(n), best], _BELOW[best]
    # Towards a = 0 the quotient S/a loses its digits; there the slope itself stands on the grid.
    left = np.maximum(_BELOW[np.maximum(best - 1, 0)], _SMALLEST)
    # At the limit the highest may stand just below it, which costs less to ask than to search.
    aside = np.flatnonzero((best < m - 1) | ~_rises_to_limit(law, speed, peak))
    right = _BELOW[np.minimum(best + 1, m - 1)]
    x, refined = peaks(law, speed[aside], left[aside], right[aside])
    higher = refined > peak[aside]
    peak[aside[higher]], place[aside[higher]] = refined[higher], x[higher]
    return peak, place


def _rises_to_limit(law: FrictionLaw, speed: FloatArray, at_limit: FloatArray) -> BoolArray:
    """Return where ``rho`` rises up to the sliding limit, its value there given."""
    return slope_surface(law, np.full(speed.size, 1.0 - _ASIDE), speed) < at_limit


def _panel_speeds(law: FrictionLaw, per_panel: int, max_breaks: int | None = None) -> FloatArray:
    """Return speeds that scan a law up to its last breakpoint, and more near 0.

    There are ``per_panel`` from each breakpoint to the next; of more than ``most`` breakpoints so many are
    used, evenly.
    """
    breaks = np.array(speed_scales(law))
    if max_breaks is not None and breaks.size > max_breaks:
        breaks = breaks[np.unique(np.linspace(0, breaks.size - 1, max_breaks).astype(np.intp))]
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


class PeakCurve(NamedTuple):
    """The highest ``rho`` of each speed.

    Attributes:
        speeds: Ascending, shape (m,) [m/s].
        peak: The highest ``rho``, shape (m,) [s/m].
        place: The amplitude coordinate where it stands, shape (m,).
        doubt: How far the straight line to the next speed may be off, shape (m,) [s/m].
    """

    speeds: FloatArray
    peak: FloatArray
    place: FloatArray
    doubt: FloatArray


@lru_cache(maxsize=32)
def peak_curve(law: FrictionLaw) -> PeakCurve:
    """Tabulate the highest ``rho`` of a law, from zero to far past its last breakpoint.

    With more speeds where a line between neighbours is off, and no higher speed has a much higher one.
    """
    speeds = _table_speeds(law, _PANELS)
    peak, place = highest(law, speeds)
    if len(speed_scales(law)) > _PANELS:
        also, peaks_there, places_there = _outstanding_peaks(law)
        speeds, first = np.unique(np.append(speeds, also), return_index=True)
        peak, place = np.append(peak, peaks_there)[first], np.append(place, places_there)[first]
    for _ in range(_FINER if len(speed_scales(law)) >= _PANELS else 0):
        above = np.maximum.accumulate(peak[::-1])[::-1]
        bent = (_off_line(speeds, peak) > _BENT * peak[1:-1]) & (peak[1:-1] > _MATTERS * above[1:-1])
        rows = np.flatnonzero(np.append(bent, False) | np.append(False, bent)) + 1
        if rows.size > _MOST_FRESH:
            break
        fresh = 0.5 * (speeds[rows] + speeds[rows - 1])
        order = np.argsort(np.append(speeds, fresh))
        more = highest(law, fresh)
        speeds = np.append(speeds, fresh)[order]
        peak, place = np.append(peak, more[0])[order], np.append(place, more[1])[order]
    off = np.pad(_off_line(speeds, peak), 1, mode='edge')
    doubt = _DOUBT * np.maximum(off, np.append(off[1:], off[-1:])) + _NOISE * np.abs(peak).max()
    return PeakCurve(speeds, peak, place, doubt)


@lru_cache(maxsize=32)
def cusp_curve(law: FrictionLaw) -> FloatArray:
    """Return ``rho`` at the sliding limit at the speeds of :func:`peak_curve` [s/m]."""
    curve = peak_curve(law)
    return np.where(curve.place == 1.0, curve.peak, cusp_slope(law, np.clip(curve.speeds, SLOWEST, FASTEST)))


def _off_line(speeds: FloatArray, peak: FloatArray) -> FloatArray:
    """Return how far each inner point of a curve lies from the line between its neighbours (n - 2,)."""
    share = (speeds[1:-1] - speeds[:-2]) / (speeds[2:] - speeds[:-2])
    off: FloatArray = np.abs(peak[1:-1] - peak[:-2] - share * (peak[2:] - peak[:-2]))
    return off


class SlopeTable(NamedTuple):
    """``rho`` at some speeds over the amplitude grid.

    Attributes:
        speeds: Ascending, shape (m,) [m/s].
        rows: ``rho``, shape (m, len(GRID)) [s/m].
        doubt: How far the straight line from a speed to the next may be off, shape of ``rows``.
    """

    speeds: FloatArray
    rows: FloatArray
    doubt: FloatArray


@lru_cache(maxsize=32)
def slope_table(law: FrictionLaw) -> SlopeTable:
    """Tabulate ``rho`` of a law, from zero to far past its last breakpoint."""
    speeds = _table_speeds(law, _WHOLE)
    rows = surface_rows(law, speeds)
    # What the straight line over two cells is off in their middle is far more than the line over
    # one of them is anywhere: a fourth where rho is smooth, twice as much at a kink.
    off = np.abs(rows[1::2] - 0.5 * (rows[:-1:2] + rows[2::2]))
    # Where rho bends to and fro that may be nothing by chance, but not at the amplitudes beside it.
    off[:, 1:-1] = np.maximum(off[:, 1:-1], np.maximum(off[:, :-2], off[:, 2:]))
    doubt = _DOUBT * np.repeat(off, 2, axis=0) + _NOISE * np.abs(rows).max(axis=1)[:-1, None]
    return SlopeTable(speeds, rows, np.vstack([doubt, doubt[-1:]]))


def _outstanding_peaks(law: FrictionLaw) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Speeds of a table at which the highest ``rho`` may exceed that of all higher speeds.

    Returns:
        These speeds, the highest ``rho``, and the amplitude coordinate where it stands.
    """
    breaks, (steady, heights) = np.array(speed_scales(law)), equilibrium_table(law)
    steepest = steady[1:-1][(heights[1:-1] >= heights[:-2]) & (heights[1:-1] >= heights[2:])]
    v = np.unique(np.concatenate([breaks, 0.5 * (breaks[1:] + breaks[:-1]), steepest]))
    peak, bound = -law.slope(v), _steepest_mean(law, v)
    record = (bound > 0.0) & (bound >= np.maximum.accumulate(bound[::-1])[::-1])
    v, peak, at_rest = v[record], peak[record], (peak >= bound)[record]
    doubtful = np.flatnonzero(~at_rest)
    # So many stand out only where the peaks fall from speed to speed, and between them.
    doubtful = doubtful[:: max(1, -(-doubtful.size // _OUTSTANDING))]
    place = np.zeros(v.size)
    peak[doubtful], place[doubtful] = highest(law, v[doubtful])
    solved = np.append(np.flatnonzero(at_rest), doubtful)
    return v[solved], peak[solved], place[solved]


def _steepest_mean(law: FrictionLaw, speed: FloatArray) -> FloatArray:
    """Return the steepest mean fall over a window about each speed, which no ``rho`` exceeds [s/m].

    ``rho`` is the mean of ``-mu'`` about ``V`` with the weight ``sqrt(a^2 - (v - V)^2)``, and so a
    mean of its means over windows ``V - h`` to ``V + h``.
    """
    bound = -law.slope(speed)
    for share in _WINDOWS:
        fall = law.coefficient(speed * (1.0 - share)) - law.coefficient(speed * (1.0 + share))
        bound = np.maximum(bound, fall / (2.0 * share * speed))
    return bound


def _table_speeds(law: FrictionLaw, whole: int) -> FloatArray:
    """Return speeds from zero to far past the last breakpoint, each second one midway between two others.

    Args:
        law: The law.
        whole: Up to so many breakpoints all are used, of more a part.
    """
    panels = min(len(speed_scales(law)), _PANELS)
    max_breaks = _PANELS if len(speed_scales(law)) > whole else None
    per_panel = max(1, _PEAK_SPEEDS // panels) if panels < _PANELS else 1
    far = speed_scales(law)[-1] * (_FAR_SPEEDS[1:] if panels < _PANELS else _FAR_SPEEDS[4::4])
    steady, heights = equilibrium_table(law)
    # No speed at which even steady sliding is unstable may fall between two of the table.
    steepest = steady[np.argmax(heights)]
    coarse = np.unique(np.concatenate([_panel_speeds(law, per_panel, max_breaks), [steepest], far]))
    return np.insert(coarse, np.arange(1, coarse.size), 0.5 * (coarse[1:] + coarse[:-1]))


_BLOCK = 1024
# How far from the places at two speeds the place of the peak between them is looked for.
_AROUND = 0.03
# Amplitudes at which rho is often high, in units of the sliding limit; and the share by which the
# windows of a bound may miss the steepest.
_LIKELY, _CAREFUL = (1.0, 0.0, 0.5, 0.2), 0.1
# What the highest rho between two speeds is: steady sliding, the cusp at the sliding limit, a peak
# that moves little from one to the other, or another one.
_STEADY, _CUSP, _NEAR, _ANYWHERE = range(4)


def peak_slope(law: FrictionLaw, speed: FloatArray) -> FloatArray:
    """``max_a rho(a; V)`` [s/m] for each speed."""
    return highest(law, np.clip(speed, SLOWEST, FASTEST))[0]


harmonic = friction_harmonic


def hopf_load(law: FrictionLaw, speed: FloatArray, damping: float) -> FloatArray:
    """``N_H = -c/mu'(V)`` [N]; ``nan`` where friction does not fall."""
    return load_for(-law.slope(speed), damping)


def cusp_slope(law: FrictionLaw, speed: FloatArray) -> FloatArray:
    """Return ``rho`` at the sliding limit ``a = V`` [s/m], shape of ``speed``."""
    return slope_surface(law, np.ones_like(speed), speed)


def _last_above(heights: FloatArray, q: FloatArray) -> IndexArray:
    """Return the index of the last height that exceeds each ``q``; -1 where none does."""
    from_right = np.maximum.accumulate(heights[::-1])[::-1]
    return np.searchsorted(-from_right, -q, side='left') - 1


def hopf_speed(law: FrictionLaw, q: FloatArray) -> FloatArray:
    """Highest speed at which the equilibrium loses its stability [m/s]; ``nan`` without one."""
    result = np.full_like(q, np.nan)
    if not speed_scales(law):
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
    """Return the highest speed with a stick-slip cycle, by averaging [m/s].

    Args:
        law: The friction law.
        q: Damping for each unit of load ``c/N``, shape (n,) [s/m].

    Returns:
        Shape (n,); ``nan`` where no speed has a cycle, ``inf`` where the fastest scanned one still has.
    """
    if not speed_scales(law):
        return np.full_like(q, np.nan)
    curve = peak_curve(law)
    index = _last_above(curve.peak, q)
    result = np.where(index >= 0, np.inf, np.nan)
    inside = np.flatnonzero((index >= 0) & (index < curve.speeds.size - 1))
    if not inside.size:
        return result
    i, level = index[inside], q[inside]
    low, high = curve.speeds[i], curve.speeds[i + 1]
    place_low, place_high = curve.place[i], curve.place[i + 1]
    kind = np.full(inside.shape, _ANYWHERE)
    kind[(np.abs(place_low - place_high) < _AROUND) & (np.minimum(place_low, place_high) > _AROUND)] = _NEAR
    kind[(place_low - 1.0) * (place_high - 1.0) <= 0.0] = _ANYWHERE
    kind[(place_low == 1.0) & (place_high == 1.0)] = _CUSP
    kind[(place_low == 0.0) & (place_high == 0.0)] = _STEADY

    def excess(v: FloatArray, level: FloatArray, near: FloatArray, kind: IndexArray) -> FloatArray:
        return _highest_between(law, v, near, kind) - level

    ends = (curve.peak[i] - level, curve.peak[i + 1] - level)
    result[inside] = root_on_bracket(excess, low, high, ends, (level, 0.5 * (place_low + place_high), kind))
    return result


def _highest_between(law: FrictionLaw, speed: FloatArray, near: FloatArray, kind: IndexArray) -> FloatArray:
    """Return the highest ``rho`` of speeds between two of the curve [s/m], shape (n,).

    Args:
        law: The law.
        speed: Shape (n,) [m/s].
        near: Amplitude coordinates about which a peak of kind ``_NEAR`` is looked for, shape (n,).
        kind: What the highest is, ``_STEADY`` to ``_ANYWHERE``, shape (n,).
    """
    height = np.empty(speed.size)
    steady, cusp, drifting, anywhere = (np.flatnonzero(kind == number) for number in range(4))
    height[steady] = -law.slope(speed[steady])
    height[cusp] = slope_surface(law, np.ones(cusp.size), speed[cusp])
    x = near[drifting]
    height[drifting] = peaks(law, speed[drifting], x - _AROUND, np.minimum(x + _AROUND, 1.0))[1]
    height[anywhere] = peak_slope(law, speed[anywhere])
    return height


def boundaries(law: FrictionLaw, q: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Hopf and fold speed [m/s]; ``nan`` where there is none, ``inf`` without an end."""
    return hopf_speed(law, q), fold_speed(law, q)


def is_unstable(law: FrictionLaw, speed: FloatArray, q: FloatArray, hopf: FloatArray) -> BoolArray:
    """Return where steady sliding is unstable, ``-mu'(V) > q``; there may be several such ranges of speed."""
    return -law.slope(speed) > q


def has_cycle(law: FrictionLaw, speed: FloatArray, q: FloatArray, fold: FloatArray) -> BoolArray:
    """Return where a stable stick-slip cycle exists; there may be several such ranges of speed.

    It does wherever the highest ``rho`` exceeds ``q``: with growing amplitude ``rho`` falls below every
    ``q``. Read from :func:`peak_curve` where that leaves no doubt, else evaluated.

    Args:
        law: The law.
        speed: Shape (n,) [m/s].
        q: ``c/N``, shape (n,) [s/m].
        fold: Averaged fold at each, shape (n,) [m/s].
    """
    result = (speed > 0.0) & (speed < fold)
    if not result.any():
        return result
    speeds, peak, _, doubt = peak_curve(law)
    last = speeds.size - 2
    i, end = (np.clip(np.searchsorted(speeds, v, side='right') - 1, 0, last) for v in (speed, fold))
    share = (speed - speeds[i]) / (speeds[i + 1] - speeds[i])
    excess = peak[i] + (peak[i + 1] - peak[i]) * share - q
    # From the last speed of the curve that has a cycle there is one up to the fold.
    open_ = result & ~((i == end) & (fold < speeds[-1]))
    result &= ~open_ | (excess > 0.0)
    doubtful = np.flatnonzero(open_ & ~((np.abs(excess) > doubt[i]) & (share >= 0.0) & (share <= 1.0)))
    # Most of these have a cycle by one of a few amplitudes, or none by any.
    result[doubtful] = True
    for at in _LIKELY:
        v = np.clip(speed[doubtful], SLOWEST, FASTEST)
        doubtful = doubtful[slope_surface(law, np.full(doubtful.size, at), v) <= q[doubtful]]
    result[doubtful] = _steepest_mean(law, speed[doubtful]) > (1.0 - _CAREFUL) * q[doubtful]
    doubtful = doubtful[result[doubtful]]
    result[doubtful] = peak_slope(law, speed[doubtful]) > q[doubtful]
    return result


def stable_amplitude(law: FrictionLaw, speed: FloatArray, q: FloatArray) -> FloatArray:
    """Return the velocity amplitude of the largest stable cycle [m/s], shape (n,); ``nan`` for none."""
    return _one_cycle(law, speed, q, smallest=False)


def threshold_amplitude(law: FrictionLaw, speed: FloatArray, damping: float, load: FloatArray) -> FloatArray:
    """Return the velocity amplitude of the smallest unstable cycle about stable sliding [m/s], shape (n,).

    ``nan`` where steady sliding is not stable or no cycle surrounds it.
    """
    q = damping_per_load(damping, load)
    surrounds = _one_cycle(law, speed, q, smallest=True)
    return np.where(-law.slope(speed) <= q, surrounds, np.nan)


def _one_cycle(law: FrictionLaw, speed: FloatArray, q: FloatArray, *, smallest: bool) -> FloatArray:
    """Return the velocity amplitude of the smallest unstable cycle, or of the largest stable one [m/s].

    Shape (n,); ``nan`` for none.
    """
    brackets = _root_brackets(law, np.clip(speed, SLOWEST, FASTEST), q)
    point, left, *_, sign = brackets
    order = np.lexsort([left if smallest else -left, point])
    wanted = order[(sign[order] < 0.0) == smallest]
    chosen = brackets[:, wanted[np.unique(point[wanted], return_index=True)[1]]]
    result = np.full(speed.shape, np.nan)
    result[chosen[0].astype(np.intp)] = _polish_roots(law, speed, q, chosen)
    return result


def cycles(
    law: FrictionLaw, speed: FloatArray, damping: float, load: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the velocity amplitudes of all cycles and their stability.

    Returns:
        Amplitudes, ascending and padded with ``nan`` [m/s], and 1.0 for a stable, 0.0 for an unstable cycle
        or padding; both of shape (n, w) with the ``w`` of the point that has most.
    """
    q = damping_per_load(damping, load)
    brackets = _root_brackets(law, np.clip(speed, SLOWEST, FASTEST), q)
    point, stable = brackets[0].astype(np.intp), (brackets[-1] > 0.0).astype(float)
    return _group_by_point(speed.size, point, _polish_roots(law, speed, q, brackets), stable)


def _polish_roots(law: FrictionLaw, speed: FloatArray, q: FloatArray, brackets: FloatArray) -> FloatArray:
    """Return the velocity amplitudes of the roots in brackets, shape (m,) [m/s].

    Args:
        law: The law.
        speed: Of the points, shape (n,) [m/s].
        q: ``c/N`` of the points, shape (n,) [s/m].
        brackets: As of :func:`_root_brackets`, shape (6, m).
    """

    def excess(x: FloatArray, v: FloatArray, level: FloatArray) -> FloatArray:
        return slope_surface(law, x, v) - level

    point, (left, right, *ends, _) = brackets[0].astype(np.intp), brackets[1:]
    v = np.clip(speed, SLOWEST, FASTEST)[point]
    x = root_on_bracket(excess, left, right, (ends[0], ends[1]), (v, q[point]))
    with np.errstate(over='ignore'):
        return amplitude_at(x, speed[point])


def _root_brackets(law: FrictionLaw, speed: FloatArray, q: FloatArray) -> FloatArray:
    """Stretches of the amplitude coordinate with one root of ``rho - q`` each.

    Returns:
        The point that it belongs to, where it begins and ends, about ``rho - q`` there and there,
        and 1 where ``rho`` falls, which is a stable cycle, else -1; shape (6, stretches).
    """
    blocks = [np.zeros((6, 0))]
    for first in range(0, speed.size, _BLOCK):
        part = slice(first, first + _BLOCK)
        for stretches in _grid_brackets(law, speed[part], q[part]):
            stretches[0] += first
            blocks.append(stretches)
    return np.concatenate(blocks, axis=1)


def _grid_brackets(law: FrictionLaw, speed: FloatArray, q: FloatArray) -> list[FloatArray]:
    """Return the stretches of the amplitude grid that hold a root, as of :func:`_root_brackets`.

    One that hides two roots between grid points is cut at the turn of ``rho`` into two.
    """
    above, (p, c) = _excess_on_grid(law, speed, q)
    point, column = np.nonzero((above[:, :-1] > 0.0) != (above[:, 1:] > 0.0))
    before, after = above[point, column], above[point, column + 1]
    sign = np.where(before > 0.0, 1.0, -1.0)
    # Friction that is level gives and takes nothing up to some amplitude: that is no cycle of none.
    before = np.where(before == 0.0, -after, before)
    crossings = [np.stack([point, GRID[column], GRID[column + 1], before, after, sign])]
    if not p.size:
        return crossings
    # A peak or dip between grid points can hide two roots.
    excess = above[p, c]
    side = np.sign(excess)
    turn, value = peaks(law, speed[p], GRID[c - 1], GRID[c + 1], -side)
    value = value - q[p]
    crossed = value * side < 0.0
    p, c, turn, value, side = p[crossed], c[crossed], turn[crossed], value[crossed], side[crossed]
    to = np.stack([p, GRID[c - 1], turn, above[p, c - 1], value, side])
    back = np.stack([p, turn, GRID[c + 1], value, above[p, c + 1], -side])
    return [*crossings, to, back]


def _excess_on_grid(
    law: FrictionLaw, speed: FloatArray, q: FloatArray
) -> tuple[FloatArray, tuple[IndexArray, IndexArray]]:
    """Return ``rho - q`` on the amplitude grid, and where a turn between grid points may reach ``q``.

    Read from the law's table where that leaves no doubt about the sign, else evaluated.

    Returns:
        Shape (n, len(GRID)); and the points and the middle columns of the turns, shape (m,) each.
    """
    above, doubt = _read_table(law, speed)
    above -= q[:, None]
    point, column = np.nonzero(~(np.abs(above) > doubt))
    if point.size:
        above[point, column] = slope_surface(law, GRID[column], speed[point]) - q[point]
    point, column = np.nonzero(_may_turn(above, doubt))
    for k in (0, 1, 2) if point.size else ():
        above[point, column + k] = slope_surface(law, GRID[column + k], speed[point]) - q[point]
    return above, _turning_triples(law, speed, above, point, column)


def _read_table(law: FrictionLaw, speed: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Interpolate ``rho`` on the amplitude grid between the speeds of the law's table.

    Returns:
        ``rho`` and how far it may be off, ``inf`` beyond the table or without one; shape (n, len(GRID)) each.
    """
    if not speed_scales(law):
        return np.zeros((speed.size, GRID.size)), np.full((speed.size, GRID.size), np.inf)
    table = slope_table(law)
    i = np.searchsorted(table.speeds, speed, side='right') - 1
    beyond = (i < 0) | (i >= table.speeds.size - 1)
    i = np.minimum(np.maximum(i, 0), table.speeds.size - 2)
    share = (speed - table.speeds[i]) / (table.speeds[i + 1] - table.speeds[i])
    low, doubt = table.rows[i], table.doubt[i]
    doubt[beyond] = np.inf
    return low + (table.rows[i + 1] - low) * share[:, None], doubt


def _may_turn(above: FloatArray, doubt: FloatArray) -> BoolArray:
    """Return where three neighbours lie on one side of ``q`` and a parabola through them may reach it.

    Args:
        above: ``rho - q`` on the amplitude grid, shape (n, len(GRID)) [s/m].
        doubt: Error of these values, same shape [s/m].

    Returns:
        Shape (n, len(GRID) - 2); an element belongs to the triple that begins at its column.
    """
    left, middle, right = above[:, :-2], above[:, 1:-1], above[:, 2:]
    side = (left > 0.0) == (right > 0.0)
    side &= (left > 0.0) == (middle > 0.0)
    # It goes beyond the middle point by an eighth of this at most.
    return side & (np.abs(middle) <= np.abs(left - 2.0 * middle + right) + 4.0 * doubt[:, 1:-1])


def _turning_triples(
    law: FrictionLaw, speed: FloatArray, above: FloatArray, p: IndexArray, c: IndexArray
) -> tuple[IndexArray, IndexArray]:
    """Keep the triples of grid points at which ``rho`` turns towards ``q``.

    Args:
        law: The law.
        speed: Of the points, shape (n,) [m/s].
        above: ``rho - q``, shape (n, len(GRID)).
        p: Point of each triple.
        c: First column of each.

    Returns:
        Points and middle columns. A cusp at the sliding limit is no turn: it is a grid point itself.
    """
    left, middle, right = (above[p, c + k] for k in range(3))
    side = np.sign(middle)
    towards = (side * left > side * middle) & (side * right > side * middle)
    towards &= (side * left > 0.0) & (side * right > 0.0)
    p, c = p[towards], c[towards] + 1
    # At the sliding limit a peak is the cusp itself, unless rho already falls towards it.
    at_cusp = np.flatnonzero(c == CUSP)
    if at_cusp.size:
        v = speed[p[at_cusp]]
        itself = at_cusp[_rises_to_limit(law, v, slope_surface(law, np.ones(v.size), v))]
        p, c = np.delete(p, itself), np.delete(c, itself)
    return p, c


def _group_by_point(
    points: int, point: IndexArray, amplitude: FloatArray, stable: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Group the roots of each point in a row, by ascending amplitude.

    Args:
        points: Number of points.
        point: Point of each root, shape (m,).
        amplitude: Amplitude of each root, shape (m,).
        stable: 1 where the root is a stable cycle, else 0, shape (m,).

    Returns:
        Amplitudes, padded with ``nan``, and stabilities, padded with 0, each of shape (points, k) with
        the largest number ``k`` of roots of a point.
    """
    order = np.lexsort([amplitude, point])
    point, amplitude, stable = point[order], amplitude[order], stable[order]
    counts = np.bincount(point, minlength=points)
    rank = np.arange(point.size) - np.repeat(np.cumsum(counts) - counts, counts)
    width = int(counts.max(initial=0))
    amplitudes, stabilities = np.full((points, width), np.nan), np.zeros((points, width))
    amplitudes[point, rank], stabilities[point, rank] = amplitude, stable
    return amplitudes, stabilities
