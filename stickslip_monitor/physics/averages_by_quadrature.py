# SPDX-License-Identifier: Apache-2.0
"""Averages of a friction law without closed forms: by quadrature, a scan, and a root on a bracket.

Everything follows from one surface that the load does not enter, the averaged negative slope

    ``rho(a; V) = 2 S(a; V)/a``   with   ``rho(0; V) = -mu'(V)``.

With ``q = c/N`` a cycle has ``rho = q`` and is stable where ``rho`` falls with ``a``; the
equilibrium is unstable where ``rho(0) > q``; the highest Hopf speed and the fold are the highest
speeds at which ``rho(0)`` and ``max_a rho`` still reach ``q``. No number of roots is assumed.

The amplitude coordinate ``x`` runs from 0 through the sliding limit at 1 (``a = V x``) to 2
(``a = V / cos((x-1) pi/2)``): along it ``rho`` is smooth on both sides of the limit, and beyond
the limit it falls.

The functions of a law and their arguments are those of :mod:`.averages_closed_form`.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from stickslip_monitor.arrays import BoolArray, FloatArray, IndexArray
from stickslip_monitor.physics.bearing import balancing_load, damping_per_load
from stickslip_monitor.physics.friction import FrictionLaw, speed_scales
from stickslip_monitor.physics.numerics import gauss_rule, last_above, root_on_bracket

# Stretches of half cycles that are summed at a time, which the processor's cache holds.
_STRETCHES = 16384
# The rule for narrow stretches of a table, which is cubic there, and that for wider ones and other laws. Of
# tables that scatter they leave 2e-15; 3 nodes, up to 0.02 rad, left 2e-8.
_NARROW_RULE, _WIDE_RULE = gauss_rule(6), gauss_rule(16)
# Amplitude coordinates of a scan, densest where mean falls differ most: about small amplitudes and, far
# beyond a law's scales, where the belt is almost met. The limit stands twice: friction reverses there. Of the
# heights of 33 laws the worst hundredth is 0.4 % low; by sums at 49 places 0.6 %, in four times the time.
_NEAR_LIMIT = np.geomspace(1e-7, 1e-2, 11)
_BELOW = np.sort(np.concatenate([np.linspace(0.0, 1.0, 101)[:-1] ** 1.5, 1.0 - _NEAR_LIMIT, [1.0]]))
_ABOVE = np.concatenate([[1.0], 1.0 + np.sqrt(_NEAR_LIMIT), np.linspace(1.12, 1.98, 25)])
GRID = np.concatenate([_BELOW, _ABOVE])
# Friction has no scale outside this range [m/s]; inside it no amplitude over- or underflows.
_SLOWEST, _FASTEST = 1e-200, 1e200


def crossing_angle(speed: FloatArray, amplitude: FloatArray, level: FloatArray | float) -> FloatArray:
    """Return the phase ``t`` in [0, pi] at which ``V - a cos t`` passes a level; clipped to the ends.

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
def _break_levels(law: FrictionLaw) -> FloatArray:
    """Return the relative speeds at which the friction of a cycle is not smooth, ascending [m/s]; cached."""
    breaks = speed_scales(law)
    return np.array([*(-b for b in reversed(breaks)), 0.0, *breaks])


def harmonic(law: FrictionLaw, speed: FloatArray, amplitude: FloatArray) -> FloatArray:
    """Return ``S(a; V) = (1/pi) integral_0^pi mu(V - a cos t) cos t dt``, split where the law is not smooth.

    Sums run term by term: the value of an element never depends on what else is in the array.

    Args:
        law: Any friction law.
        speed: ``V`` >= 0 [m/s].
        amplitude: Velocity amplitude ``a`` > 0 [m/s], shape of ``speed``.

    Returns:
        ``S`` [-], shape of ``speed``.
    """
    v, a = speed.ravel(), amplitude.ravel()
    level, varying = law.coefficient(v), np.empty(v.size)
    block = max(1, _STRETCHES // _break_levels(law).size)
    for first in range(0, v.size, block):
        part = slice(first, first + block)
        varying[part] = _varying_harmonic(law, v[part], a[part], level[part])
    # The average of the constant part has a closed form.
    reach = np.maximum(a, v)
    sine = np.sqrt(((reach - v) / reach) * (1.0 + v / reach))
    return np.asarray(varying - (2.0 / np.pi) * level * sine).reshape(speed.shape)


def _varying_harmonic(
    law: FrictionLaw, speed: FloatArray, amplitude: FloatArray, level: FloatArray
) -> FloatArray:
    """Return ``S`` of friction less that of steady sliding, which leaves no rounding noise.

    That noise would pass for cycles where friction is flat.

    Args:
        law: The law.
        speed: ``V`` >= 0, shape (n,) [m/s].
        amplitude: Velocity amplitude ``a`` > 0, shape (n,) [m/s].
        level: ``mu(V)``, shape (n,) [-].
    """
    begin, extent, element = _smooth_stretches(law, speed, amplitude)
    is_narrow = (extent <= 0.3) & (len(getattr(law, 'kinks', ())) > 0)
    total = np.zeros(element.size)
    for (nodes, weights), chosen in ((_NARROW_RULE, is_narrow), (_WIDE_RULE, ~is_narrow)):
        rows = np.flatnonzero(chosen)
        index = element[rows, None]
        sine = np.sin(0.5 * (begin[rows, None] + nodes * extent[rows, None]))
        drop = 2.0 * sine * sine
        # V - a cos t without its cancellation: at grazing the sign of v decides the sum.
        v = (speed - amplitude)[index] + amplitude[index] * drop
        friction = law.coefficient(v) - np.copysign(level[index], v + 0.0)
        total[rows] = np.add.reduce(friction * (1.0 - drop) * weights, axis=1)
    # Stretch by stretch in the order of t, so that no element sees another.
    return np.bincount(element, total * extent, speed.size) / np.pi


def _smooth_stretches(
    law: FrictionLaw, speed: FloatArray, amplitude: FloatArray
) -> tuple[FloatArray, FloatArray, IndexArray]:
    """Return the stretches of the half cycles within which the law is smooth.

    Args:
        law: The law.
        speed: ``V`` >= 0, shape (n,) [m/s].
        amplitude: Velocity amplitude ``a`` > 0, shape (n,) [m/s].

    Returns:
        Start and width of each [rad] and the element it belongs to, in the order of elements and of ``t``;
        only those with a width; shape (stretches,) each.
    """
    levels = _break_levels(law)
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


def _velocity_amplitude(x: FloatArray, speed: FloatArray) -> FloatArray:
    """Return the velocity amplitudes [m/s] of amplitude coordinates at speeds [m/s], of the broadcast shape.

    ``x`` is ``a/V`` up to the sliding limit at 1; from there to 2 it is ``1 + (2/pi) arccos(V/a)``.
    """
    beyond = np.maximum(x - 1.0, 0.0) * (0.5 * np.pi)
    return np.where(x <= 1.0, speed * x, speed / np.cos(beyond))


def slope_surface(law: FrictionLaw, x: FloatArray, speed: FloatArray) -> FloatArray:
    """Return ``rho`` [s/m] at amplitude coordinates and speeds, of the broadcast shape.

    Args:
        law: The law.
        x: Amplitude coordinates, 0 to 2, as of :func:`_velocity_amplitude`.
        speed: ``V`` >= 0 [m/s], clipped to 1e-200 to 1e200.
    """
    x, v = np.broadcast_arrays(x, np.clip(speed, _SLOWEST, _FASTEST))
    # S/a has lost more digits there than the slope of steady sliding is off.
    still = x < 1e-7
    a = _velocity_amplitude(np.where(still, 1.0, x), v)
    rho = 2.0 * harmonic(law, v, a) / a
    rho[still] = -law.slope(v[still])
    return rho


def _find_vertex(x: FloatArray, y: FloatArray) -> FloatArray:
    """Return the place where the parabola through three points turns, clipped to the first and the last.

    Args:
        x: Places, rising along the first axis, shape (3, n).
        y: Values there, shape (3, n).

    Returns:
        Shape (n,); the middle place where the points lie on a line.
    """
    left, right = (y[1] - y[0]) / (x[1] - x[0]), (y[2] - y[1]) / (x[2] - x[1])
    with np.errstate(all='ignore'):
        place = 0.5 * (x[0] + x[1]) + 0.5 * (x[2] - x[0]) * left / (left - right)
    return np.where(np.isfinite(place), np.clip(place, x[0], x[2]), x[1])


def _find_turns(
    law: FrictionLaw, speed: FloatArray, low: FloatArray, high: FloatArray, side: FloatArray | float = 1.0
) -> tuple[FloatArray, FloatArray]:
    """Find the highest, or the lowest, ``rho`` between two amplitude coordinates (0 to 2) at each speed.

    Where ``rho`` bends suddenly, as that of a table, it is right to 1e-6 of its height.

    Args:
        law: The law.
        speed: Shape (n,) [m/s].
        low: First amplitude coordinates, shape (n,).
        high: Last ones, shape (n,).
        side: 1 for the highest, -1 for the lowest; one number or one each.

    Returns:
        Amplitude coordinates, and ``rho`` there [s/m], shape (n,) each.
    """
    for _ in range(5):
        quarter = 0.25 * (high - low)
        x = low + quarter * np.array([[1.0], [2.0], [3.0]])
        y = slope_surface(law, x, speed)
        place = np.take_along_axis(x, np.argmax(side * y, axis=0)[None], 0)[0]
        low, high = place - quarter, place + quarter
    x = np.vstack([x, _find_vertex(x, y)])
    y = np.vstack([y, slope_surface(law, x[-1:], speed)])
    best = np.argmax(side * y, axis=0)[None]
    return np.take_along_axis(x, best, 0)[0], np.take_along_axis(y, best, 0)[0]


@lru_cache(maxsize=1)
def _scan_weights() -> tuple[FloatArray, FloatArray]:
    """Return the weights by which ``rho`` on the grid follows from mean falls of friction; cached.

    ``rho`` at an amplitude ``x V`` is ``4/pi`` times the integral of ``sin^2(u) m(x sin(u))`` over a quarter
    turn, with the mean fall ``m(s)`` from ``V (1 - s)`` to ``V (1 + s)``, here straight from place to place.

    Returns:
        Amplitudes of the grid in units of ``V``, shape (n,), and for each a row of weights of the mean falls
        at all of them, shape (n, n).
    """
    places = _velocity_amplitude(GRID, np.ones(1))
    n, x, width = places.size, places[1:, None], np.diff(places)
    u = np.arcsin(np.minimum(places / x, 1.0))
    area = np.diff(0.5 * (u - 0.5 * np.sin(2.0 * u)))
    moment = np.diff(x * (np.cos(u) ** 3 / 3.0 - np.cos(u)))
    share = np.where(width > 0.0, 1.0 / np.where(width > 0.0, width, 1.0), 0.0)
    weights = np.zeros((n, n))
    weights[0, 0] = 0.25 * np.pi
    weights[1:, :-1] = (places[1:] * area - moment) * share
    weights[1:, 1:] += (moment - places[:-1] * area) * share
    return places, 4.0 / np.pi * weights


def _scan_roughly(law: FrictionLaw, speed: FloatArray, count: int) -> tuple[FloatArray, FloatArray]:
    """Return ``rho`` at the first places of the grid, from mean falls of friction that are joined by lines.

    Args:
        law: The law.
        speed: Shape (n,) [m/s].
        count: Number of places.

    Returns:
        ``rho``, and the error that it may have, from the distance of each mean fall from the line between
        those beside it and from its rounding; shape (n, count) each [s/m]. The error of next to no speed is
        ``inf`` or ``nan``.
    """
    places, weights = (part[:count] for part in _scan_weights())
    v, x = speed[:, None], places[1:]
    ahead = np.where(np.arange(1, count) < _BELOW.size, 1.0, -1.0)
    falls = ahead * law.coefficient(v * np.abs(1.0 - x)) - law.coefficient(v * (1.0 + x))
    falls = np.hstack([-law.slope(v), falls / (2.0 * v * x)])
    with np.errstate(over='ignore', divide='ignore'):
        rounding = 4e-16 * law.coefficient(v) / (2.0 * v * x)
    share = np.diff(places)[:-1] / (places[2:] - places[:-2])
    bend = np.zeros_like(falls)
    bend[:, 1:-1] = np.abs(falls[:, :-2] + share * (falls[:, 2:] - falls[:, :-2]) - falls[:, 1:-1])
    bend[:, 1:] += rounding
    # Not by ``@``: its threads take more than they spare.
    with np.errstate(invalid='ignore'):
        rho, error = (np.einsum('ij,kj->ik', part, weights[:, :count]) for part in (falls, bend))
    return rho, error


def _find_peaks(law: FrictionLaw, speed: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return ``max_a rho(a; V)`` and ``rho`` at the sliding limit [s/m] at speeds > 0, shape (n,) each.

    Beyond the sliding limit ``rho`` falls, so the highest stands at an amplitude ``a <= V``: at rest, at the
    limit, or where it turns between, about the highest of a rough scan. A peak that is rounding is 0.
    """
    best = np.empty(speed.size, np.intp)
    for part in _scan_blocks(speed.size):
        best[part] = np.argmax(_scan_roughly(law, speed[part], _BELOW.size)[0], axis=1)
    turns = np.flatnonzero(best < _BELOW.size - 1)
    beside = np.maximum(best[turns] - 1, 0), best[turns] + 1
    x, height = _find_turns(law, speed[turns], _BELOW[beside[0]], _BELOW[beside[1]])
    cusp = cusp_slope(law, speed)
    candidates = np.stack([-law.slope(speed), np.full(speed.size, -np.inf), cusp])
    candidates[1, turns] = height
    which, peak = np.argmax(candidates, axis=0), np.max(candidates, axis=0)
    place = 0.5 * which
    place[turns] = np.where(which[turns] == 1, x, place[turns])
    # A fall in the last digit of the coefficient is rounding, not friction.
    rounding = np.abs(peak) * place * speed < 4e-16 * law.coefficient(speed)
    peak[rounding & (place > 0.0)] = 0.0
    return peak, cusp


class AverageCurve(NamedTuple):
    """Averaged slopes of a law over the speed.

    Attributes:
        speed: Ascending, shape (m,) [m/s].
        peak: The highest ``rho`` of any amplitude, shape (m,) [s/m].
        cusp: ``rho`` at the sliding limit, shape (m,) [s/m].
    """

    speed: FloatArray
    peak: FloatArray
    cusp: FloatArray

    def at(self, speed: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return peak and cusp at speeds, by lines between those of the curve, shape of ``speed`` [s/m].

        Beyond its ends they are those of its ends; of a law without breakpoints both are 0.
        """
        if not self.speed.size:
            return np.zeros(speed.shape), np.zeros(speed.shape)
        return np.interp(speed, self.speed, self.peak), np.interp(speed, self.speed, self.cusp)


@lru_cache(maxsize=32)
def average_curve(law: FrictionLaw) -> AverageCurve:
    """Scan the averaged slopes of a law from almost rest to far past its last breakpoint; cached.

    Of a law without breakpoints the curve has no speeds.
    """
    scales = np.array(speed_scales(law))
    if not scales.size:
        return AverageCurve(*np.zeros((3, 0)))
    max_points = 100
    edges = np.append(0.0, scales[:: -(-scales.size // max_points)])
    # 400 speeds at least: by 200 a fold read between them was 0.3 % off for a noisy table of 40 points.
    per_panel = -(-400 // scales.size)
    if scales.size > max_points:  # what stands out is added below
        per_panel = 2
    share = np.arange(1, per_panel + 1) / per_panel
    panels = (edges[:-1, None] + np.diff(edges)[:, None] * share).ravel()
    near = np.geomspace(1e-9, 0.9, 40) * panels[0]
    far = scales[-1] * (1.0 + np.geomspace(1e-3, 1e6, 65))  # densest where the law ends
    speed = np.unique(np.concatenate([near, panels, _outstanding_speeds(law), far]))
    # A spline through closer speeds would only have rounding.
    speed = speed[np.append(True, np.diff(speed) > 1e-6 * speed[1:])]
    return AverageCurve(speed, *_find_peaks(law, speed))


def _outstanding_speeds(law: FrictionLaw) -> FloatArray:
    """Return speeds at which the highest ``rho`` may exceed that of all higher speeds, for a scan to include.

    Of shape (n,), unordered [m/s]. They are sought at and between the breakpoints, of which the law has one
    at least, and where steady sliding falls most.

    ``rho`` is the mean of ``-mu'`` about ``V`` with the weight ``sqrt(a^2 - (v - V)^2)``, and so a mean of
    its means over windows ``V - h`` to ``V + h``: the steepest of these bounds it. A table of 300 points that
    scatters by 0.001 has its fold at 1.235 m/s; by 40 speeds of the curve alone it was at 0.62.
    """
    breaks, (steady, fall) = np.array(speed_scales(law)), steady_slope_table(law)
    steepest = steady[1:-1][(fall[1:-1] > fall[:-2]) & (fall[1:-1] >= fall[2:])]
    speed = np.unique(np.concatenate([breaks, 0.5 * (breaks[1:] + breaks[:-1]), steepest]))
    at_rest = -law.slope(speed)
    bound = at_rest.copy()
    for share in np.geomspace(1e-3, 1.0, 61):  # windows as shares of the speed
        fall = law.coefficient(speed * (1.0 - share)) - law.coefficient(speed * (1.0 + share))
        bound = np.maximum(bound, fall / (2.0 * share * speed))
    record = (bound > 0.0) & (bound >= np.maximum.accumulate(bound[::-1])[::-1])
    steady, moving = speed[record & (at_rest >= bound)], speed[record & (at_rest < bound)]
    # So many stand out only where the peaks fall from speed to speed, and between them.
    return np.append(steady, moving[:: max(1, -(-moving.size // 160))])


@lru_cache(maxsize=32)
def steady_slope_table(law: FrictionLaw) -> tuple[FloatArray, FloatArray]:
    """Return rising speeds up to the last breakpoint [m/s], and the fall ``-mu'`` of steady sliding [s/m].

    The speeds of the steepest falls are among them. Each of shape (n,); cached. The law needs a breakpoint,
    or a scale that :func:`.speed_scales` finds.
    """
    edges = np.append(0.0, speed_scales(law))
    share = np.arange(1, 25) / 24
    panels = (edges[:-1, None] + np.diff(edges)[:, None] * share).ravel()
    speeds = np.append(np.geomspace(1e-9, 0.9, 40) * panels[0], panels)
    x, y = (np.stack([part[:-2], part[1:-1], part[2:]]) for part in (speeds, -law.slope(speeds)))
    top = (y[1] > y[0]) & (y[1] >= y[2])
    steepest = _find_vertex(x[:, top], y[:, top])
    # A second parabola, much narrower, leaves 3e-13 of the height of a Gaussian law in place of 2e-8.
    x = np.clip(steepest + 0.02 * np.diff(x[::2, top], axis=0) * [[-1.0], [0.0], [1.0]], x[0, top], x[2, top])
    speeds = np.unique(np.concatenate([speeds, steepest, _find_vertex(x, -law.slope(x))]))
    return speeds, -law.slope(speeds)


def peak_slope(law: FrictionLaw, speed: FloatArray) -> FloatArray:
    """Return ``max_a rho(a; V)`` at speeds >= 0 [m/s], shape (n,) [s/m]; 0 for a peak that is rounding."""
    return _find_peaks(law, np.clip(speed, _SLOWEST, _FASTEST))[0]


def cusp_slope(law: FrictionLaw, speed: FloatArray) -> FloatArray:
    """Return ``rho`` at the sliding limit ``a = V`` at speeds >= 0 [m/s], of their shape [s/m]."""
    return slope_surface(law, np.ones(1), speed)


def hopf_load(law: FrictionLaw, speed: FloatArray, damping: float) -> FloatArray:
    """Return ``N_H = -c/mu'(V)`` [N] at speeds >= 0 [m/s], of their shape, for a damping ``c`` [N s/m].

    It is ``nan`` where friction does not fall.
    """
    return balancing_load(-law.slope(speed), damping)


def boundaries(law: FrictionLaw, q: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return Hopf and fold speed [m/s], of the shape of ``q = c/N`` [s/m].

    ``nan`` where there is none, ``inf`` for a fold without an end.
    """
    return hopf_speed(law, q), fold_speed(law, q)


def hopf_speed(law: FrictionLaw, q: FloatArray) -> FloatArray:
    """Return the highest speed at which steady sliding loses its stability [m/s]; ``nan`` without one.

    Of a law whose last stretch falls it is the end of that stretch. ``q`` is ``c/N`` >= 0, not
    ``nan``, shape (n,) [s/m].
    """
    if not speed_scales(law):
        return np.full_like(q, np.nan)
    speeds, heights = steady_slope_table(law)
    result = _last_root(lambda v: -law.slope(v), speeds, heights, q)
    # A law that ends on a falling stretch is flat beyond it: its last speed is the boundary.
    return np.where(result == np.inf, speeds[-1], result)


def fold_speed(law: FrictionLaw, q: FloatArray) -> FloatArray:
    """Return the highest speed with a stick-slip cycle, by averaging [m/s].

    Args:
        law: The friction law.
        q: Damping for each unit of load ``c/N``, shape (n,) [s/m].

    Returns:
        Shape (n,); ``nan`` where no speed has a cycle, ``inf`` where the fastest scanned one still has.
    """
    curve = average_curve(law)
    return _last_root(lambda v: peak_slope(law, v), curve.speed, curve.peak, q)


def sticking_end(law: FrictionLaw, q: FloatArray) -> FloatArray:
    """Return the highest speed at which ``rho`` reaches ``q`` at the sliding limit [m/s].

    ``nan`` where it does at no speed, ``inf`` where it does at the fastest scanned one; shape of ``q`` [s/m].
    """
    curve = average_curve(law)
    return _last_root(lambda v: cusp_slope(law, v), curve.speed, curve.cusp, q)


def _last_root(
    height: Callable[[FloatArray], FloatArray], speed: FloatArray, heights: FloatArray, q: FloatArray
) -> FloatArray:
    """Return the last speeds at which a height still reaches ``q`` [m/s].

    Args:
        height: Function of speeds [m/s], shape (k,), to heights [s/m].
        speed: Speeds of a scan, ascending, shape (m,) [m/s].
        heights: Heights there, shape (m,) [s/m].
        q: Heights to reach, shape (n,) [s/m].

    Returns:
        Shape (n,); ``nan`` where no speed of the scan reaches it, ``inf`` where the last one does.
    """
    index = last_above(heights, q)
    result = np.where(index >= 0, np.inf, np.nan)
    inside = np.flatnonzero((index >= 0) & (index < speed.size - 1))
    i, level = index[inside], q[inside]
    ends = heights[i] - level, heights[i + 1] - level
    result[inside] = root_on_bracket(
        lambda v, level: height(v) - level, speed[i], speed[i + 1], ends, (level,)
    )
    return result


def is_unstable(law: FrictionLaw, speed: FloatArray, q: FloatArray, hopf: FloatArray) -> BoolArray:
    """Return where steady sliding is unstable, ``-mu'(V) > q``; there may be several such ranges of speed.

    Shape (n,), from speeds [m/s] and ``q = c/N`` [s/m]; ``hopf`` is not used.
    """
    return -law.slope(speed) > q


def has_cycle(law: FrictionLaw, speed: FloatArray, q: FloatArray, fold: FloatArray) -> BoolArray:
    """Return where a stable stick-slip cycle exists; there may be several such ranges of speed.

    It does wherever the highest ``rho`` exceeds ``q``: with growing amplitude ``rho`` falls below every
    ``q``. That is read from :func:`average_curve`, and computed between two of its speeds of which only one
    has a cycle. False at rest.

    Args:
        law: The law.
        speed: Speed >= 0, shape (n,) [m/s].
        q: ``c/N``, shape (n,) [s/m].
        fold: Averaged fold at each, shape (n,) [m/s].
    """
    curve = average_curve(law)
    below = (speed > 0.0) & (speed < fold)
    if not below.any():
        return below
    # From the last speed of the curve that has a cycle there is one up to the fold.
    index = last_above(curve.peak, q)
    to_fold = (index < curve.speed.size - 1) & (speed >= curve.speed[np.maximum(index, 0)])
    k = np.searchsorted(curve.speed, speed, side='right')
    heights = np.append(curve.peak, 0.0)  # beyond its last speed nothing is read
    beside = heights[np.maximum(k - 1, 0)] > q, heights[k] > q
    result = below & ((beside[0] & beside[1]) | to_fold)
    between = np.flatnonzero(below & ~result & (beside[0] | beside[1]))
    result[between] = peak_slope(law, speed[between]) > q[between]
    return result


def stable_amplitude(law: FrictionLaw, speed: FloatArray, q: FloatArray) -> FloatArray:
    """Return the velocity amplitude of the largest stable cycle [m/s], shape (n,); ``nan`` for none.

    Args:
        law: The law.
        speed: Speed > 0, shape (n,) [m/s].
        q: ``c/N``, shape (n,) [s/m].
    """
    amplitude, stable = _all_cycles(law, speed, q)
    return np.fmax.reduce(np.where(stable > 0.0, amplitude, np.nan), axis=1, initial=np.nan)


def threshold_amplitude(law: FrictionLaw, speed: FloatArray, damping: float, load: FloatArray) -> FloatArray:
    """Return the velocity amplitude of the smallest unstable cycle about stable sliding [m/s], shape (n,).

    ``nan`` where steady sliding is not stable or no cycle surrounds it.

    Args:
        law: The law.
        speed: Speed > 0, shape (n,) [m/s].
        damping: ``c`` [N s/m].
        load: Load, shape (n,) [N].
    """
    q = damping_per_load(damping, load)
    amplitude, stable = _all_cycles(law, speed, q)
    smallest = np.fmin.reduce(np.where(stable > 0.0, np.nan, amplitude), axis=1, initial=np.nan)
    return np.where(-law.slope(speed) <= q, smallest, np.nan)


def cycles(
    law: FrictionLaw, speed: FloatArray, damping: float, load: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the velocity amplitudes of all cycles and their stability.

    Args:
        law: The law.
        speed: Surface speed > 0, shape (n,) [m/s].
        damping: Damping >= 0 [N s/m].
        load: Load, shape (n,) [N]; without one above 0 there is no cycle.

    Returns:
        Amplitudes, ascending and padded with ``nan`` [m/s], and 1.0 for a stable, 0.0 for an unstable cycle
        or padding; both of shape (n, w) with the ``w`` of the point that has most.
    """
    return _all_cycles(law, speed, damping_per_load(damping, load))


def count_cycles(law: FrictionLaw, speed: FloatArray, q: FloatArray) -> IndexArray:
    """Return the number of cycles at speeds > 0 [m/s] and ``q = c/N`` [s/m], shape (n,)."""
    return np.bincount(_cycle_brackets(law, speed, q)[0].astype(np.intp), minlength=speed.size)


def _all_cycles(law: FrictionLaw, speed: FloatArray, q: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the velocity amplitudes of all cycles and their stability, as :func:`cycles` does, of a block.

    Args:
        law: The law.
        speed: Surface speed > 0, shape (n,) [m/s].
        q: ``c/N``, shape (n,) [s/m].

    Returns:
        Amplitudes, ascending and padded with ``nan`` [m/s], and 1.0 for a stable, else 0.0; shape (n, w).
    """
    point, low, high, below, above = _cycle_brackets(law, speed, q)
    point = point.astype(np.intp)
    v, level = speed[point], q[point]
    x = root_on_bracket(
        lambda x, v, level: slope_surface(law, x, v) - level, low, high, (below, above), (v, level)
    )
    with np.errstate(over='ignore'):
        cycle_amplitude = _velocity_amplitude(x, v)
    # Of each point a row, by ascending amplitude.
    order = np.lexsort([cycle_amplitude, point])
    point, counts = point[order], np.bincount(point, minlength=speed.size)
    rank = np.arange(point.size) - np.repeat(np.cumsum(counts) - counts, counts)
    amplitude, stable = (np.full((speed.size, counts.max(initial=0)), pad) for pad in (np.nan, 0.0))
    amplitude[point, rank], stable[point, rank] = cycle_amplitude[order], (below > above)[order]
    return amplitude, stable


def _scan_blocks(size: int) -> list[slice]:
    """Return slices of ``size`` speeds that are scanned one after the other, as the cache holds them."""
    block = _STRETCHES // GRID.size
    return [slice(first, min(first + block, size)) for first in range(0, size, block)]


def _cycle_brackets(law: FrictionLaw, speed: FloatArray, q: FloatArray) -> FloatArray:
    """Return the brackets of the amplitude coordinate within which ``rho`` passes ``q`` once.

    Args:
        law: The law.
        speed: Shape (n,) [m/s].
        q: ``c/N``, shape (n,) [s/m].

    Returns:
        Shape (5, brackets), the rows index of the point in ``speed``, amplitude coordinates of begin and end,
        and ``rho - q`` at begin and end [s/m].
    """
    brackets = [np.zeros((5, 0))]
    for part in _scan_blocks(speed.size):
        of_part = _scan_brackets(law, speed[part], q[part])
        of_part[0] += part.start
        brackets.append(of_part)
    return np.concatenate(brackets, axis=1)


def _scan_brackets(law: FrictionLaw, speed: FloatArray, q: FloatArray) -> FloatArray:
    """Return :func:`_cycle_brackets` of few speeds, which are scanned at once; arguments as there."""
    rows, error = _scan_roughly(law, speed, GRID.size)
    rows -= q[:, None]
    steps = np.abs(np.diff(rows, axis=1, prepend=rows[:, :1], append=rows[:, -1:]))
    # Exact unless the way to the places beside surely does not lead through 0.
    point, k = np.nonzero(~(np.abs(rows) > np.maximum(steps[:, :-1], steps[:, 1:]) + error))
    is_near = np.zeros(rows.shape, bool)
    is_near[point, k] = True
    rows[point, k] = slope_surface(law, GRID[k], speed[point]) - q[point]
    point, k = np.nonzero((rows[:, :-1] > 0.0) != (rows[:, 1:] > 0.0))
    before, after = rows[point, k], rows[point, k + 1]
    # Friction that is level gives and takes nothing up to some amplitude: that is no cycle of none.
    before = np.where(before == 0.0, -after, before)
    crossings = np.stack([point, GRID[k], GRID[k + 1], before, after])
    # A turn towards 0 between places of the grid may hide two roots.
    side = np.sign(rows[:, 1:-1])
    middle, beside = side * rows[:, 1:-1], np.minimum(side * rows[:, :-2], side * rows[:, 2:])
    point, k = np.nonzero(is_near[:, 1:-1] & (middle > 0.0) & (middle <= beside))
    side = side[point, k]
    turn, value = _find_turns(law, speed[point], GRID[k], GRID[k + 2], -side)
    value = value - q[point]
    hides = value * side < 0.0
    point, k, turn, value = point[hides], k[hides], turn[hides], value[hides]
    to = np.stack([point, GRID[k], turn, rows[point, k], value])
    back = np.stack([point, turn, GRID[k + 2], value, rows[point, k + 2]])
    return np.concatenate([crossings, to, back], axis=1)
