# SPDX-License-Identifier: Apache-2.0
"""The folds of a bearing over many loads, from the least load with a cycle over the speed.

Over the load a fold begins with an infinite slope, and that of a measured table jumps from one range of
speeds with cycles to the next, but over the speed the least load has one value, and its ratio to that of a
cycle under averaging is smooth. It is solved at some speeds, and the last speed at a load is read from the
curve through them.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from stickslip_monitor.arrays import FloatArray, IndexArray
from stickslip_monitor.physics import averages_closed_form, averaging
from stickslip_monitor.physics.averages_by_quadrature import average_curve, cusp_slope
from stickslip_monitor.physics.bearing import Bearing
from stickslip_monitor.physics.contact import Contact
from stickslip_monitor.physics.folds import SLOWEST, Grazing, last_sticking_speeds, least_sticking_loads
from stickslip_monitor.physics.friction import ALMOST_REST, speed_scales
from stickslip_monitor.physics.numerics import (
    hermite,
    local_polynomials,
    monotone_slopes,
    root_on_bracket,
    spline_slopes,
)

# Octaves of load of a curve from the onset at least: a steep law has its onset at some newtons, far
# from Coulomb's 8 octaves above it.
_MIN_OCTAVES = 8
# Nodes of a curve, at which it is solved first; a smooth one is then solved between them until 1e-8 is left.
_NODES = 33


@dataclass(frozen=True, slots=True, eq=False)
class FoldCurve:
    """The least loads with a cycle over the speed.

    Attributes:
        contact: The bearing, with the contact of its belt.
        onset: The least load with a cycle [N].
        top: The largest load that the curve is made for [N].
        averaged: Ascending speeds [m/s], and under averaging the least loads with a cycle, and with one that
            sticks [N], ``inf`` for none, shape (3, m).
        exact: Ascending speeds [m/s], and the least loads at which slip grazes the belt [N], ``inf`` for
            none, shape (2, n).
        larger: ``ln N`` and the exact fold [m/s] of loads beyond the last, shape (2, k), where friction that
            rises with the speed, or strong damping, makes the fold fall again with the load.
    """

    contact: Contact
    onset: float
    top: float
    averaged: FloatArray
    exact: FloatArray
    larger: FloatArray

    @property
    def is_smooth(self) -> bool:
        """Whether a spline joins the points of the curve; else monotone cubics."""
        return self.contact.is_smooth

    def averaged_fold(self, load: FloatArray) -> FloatArray:
        """Return the last speeds with an averaged cycle at loads [N], shape (n,) [m/s]; ``nan``: none."""
        return last_speeds(self.averaged[:2], load, self.is_smooth)

    def averaged_sticking_end(self, load: FloatArray) -> FloatArray:
        """Return the last speeds that stick under averaging at loads [N], shape (n,) [m/s]; ``nan``: none."""
        return last_speeds(self.averaged[::2], load, self.is_smooth)

    def exact_fold(self, load: FloatArray) -> FloatArray:
        """Return the last speeds at which the lining sticks at loads [N], shape (n,) [m/s]; ``nan``: none."""
        speed = last_speeds(self.exact, load, self.is_smooth)
        x, y = self.larger
        rows = np.flatnonzero(np.log(load) > x[0]) if x.size else np.zeros(0, int)
        if rows.size:
            slopes = (spline_slopes if np.isfinite(y).all() else monotone_slopes)(x, y)
            speed[rows] = hermite(x, y, slopes, np.log(load[rows]))
        return speed

    def lower_end(self, load: FloatArray) -> FloatArray:
        """Return the lower end of stick-slip by averaging: below this speed no cycle exists.

        It lies where friction first rises with the speed: there slow sliding is stable, and what
        leaves a stick settles to it.

        Args:
            load: ``N`` > 0, shape (n,) [N].

        Returns:
            Shape (n,) [m/s]; 0 where there are cycles down to rest, or none at any speed.
        """
        out = np.zeros(load.size)
        if self.contact.falls_most_at_rest:
            return out
        speed, least_load, _ = self.averaged
        with np.errstate(all='ignore'):
            x, y, level = np.log(speed), np.log(np.minimum.accumulate(least_load)), np.log(load)
            i = np.searchsorted(-y, -level, side='left')
            rows = np.flatnonzero((i > 0) & (i < speed.size))
            i = i[rows]
            share = np.where(np.isfinite(y[i - 1]), (y[i - 1] - level[rows]) / (y[i - 1] - y[i]), 1.0)
        out[rows] = np.exp(x[i - 1] + share * (x[i] - x[i - 1]))
        return out


@lru_cache(maxsize=64)
def fold_curve(bearing: Bearing) -> FoldCurve | None:
    """Solve the least loads with a cycle of a bearing with damping > 0 and without lubrication; cached.

    Its friction must fall somewhere. ``None`` where no load has a cycle.
    """
    contact, law = Contact(bearing), bearing.friction
    averaged = _averaged_curve(contact)
    lowest, fall = SLOWEST * contact.scales[0], contact.bounds.fall
    # 200 kN, or until friction would move the lining by 0.1 m: a soft lining (50 kg, 3 Hz) has slip so stiff
    # at 200 kN that it takes minutes.
    of_use = min(2e5, 0.1 * bearing.stiffness / max(law.static, 1e-9))
    least_load = max(bearing.damping / fall, float(contact.least_loads(np.array([lowest]))[0]))
    max_load = 2.0 * max(of_use, 2.0**_MIN_OCTAVES * least_load)
    # In these places the curve is smooth. They are closest at its begin, where a fold rises faster than its
    # load; in those of a table nearly as far apart as its speeds.
    unit = contact.scales[0] if contact.is_smooth else max(contact.scales[0], contact.scales[-1] / 50.0)
    highest = max(contact.highest_speed(max_load), 4.0 * lowest)
    begin, end = math.log1p(lowest / unit), math.log1p(highest / unit)
    place = begin + (end - begin) * np.linspace(0.0, 1.0, _NODES) ** 1.5
    nodes = _solve_nodes(contact, place, unit, max_load)
    onset, octaves = float(np.nanmin([np.min(averaged[1]), *nodes.load])), _MIN_OCTAVES
    if not onset < np.inf:
        return None
    if fall < math.inf:
        if contact.is_smooth and contact.falls_most_at_rest:
            onset = bearing.damping / float(-law.slope(ALMOST_REST))
        octaves = max(octaves, math.ceil(math.log2(max(of_use / onset, 1.0))))
    top = onset * 2.0**octaves
    exact, larger = _exact_curve(contact, place, unit, nodes, top)
    return FoldCurve(contact, onset, top, averaged, exact, larger)


def _averaged_curve(contact: Contact) -> FloatArray:
    """Return :attr:`FoldCurve.averaged`, from far below the law's first scale to far beyond its last.

    All loads are ``inf`` for a law that is the same at all speeds.
    """
    law = contact.law
    speed = np.geomspace(SLOWEST * contact.scales[0], 300.0 * contact.scales[-1], 161)
    if (solver := averaging.averages_of(law)) is averages_closed_form:
        peak = cusp = solver.peak_slope(law, speed)
    elif speed_scales(law):
        speed, peak, cusp = average_curve(law)
    else:
        peak = cusp = np.zeros(speed.size)
    with np.errstate(all='ignore'):
        return np.stack([speed, *(contact.bearing.damping / np.maximum([peak, cusp], 0.0))])


def _solve_nodes(contact: Contact, place: FloatArray, unit: float, max_load: float) -> Grazing:
    """Solve the least loads that graze at the nodes of a curve to 1e-5, later ones from those beside them.

    Args:
        contact: The bearing's contact.
        place: Their places ``ln(1 + V/unit)``, shape (:data:`_NODES`,).
        unit: Unit of the speed in them [m/s].
        max_load: Where the search ends [N].
    """
    speed, rows, guess = unit * np.expm1(place), np.arange(0, _NODES, 8), None
    load, slope = np.full((2, _NODES), np.nan)
    for stride in (8, 4, 2, 1):
        load[rows], slope[rows] = least_sticking_loads(contact, speed[rows], max_load, guess)
        solved, rows = np.arange(0, _NODES, stride), np.arange(stride // 2, _NODES, stride)
        below = Grazing(np.fmin(load[solved], max_load), slope[solved])
        guess = _join_neighbours(place[solved], below, place[rows])
    return Grazing(load, slope)


def _join_neighbours(x: FloatArray, solved: Grazing, at: FloatArray) -> Grazing:
    """Return guesses between loads that were solved, and beyond them as at the ends, in the shape of ``at``.

    Args:
        x: Rising places, shape (n,).
        solved: Loads, or ratios of loads, > 0 and slopes there.
        at: Places.

    Returns:
        Loads by cubics and slopes by lines; ``nan`` where fewer than two places were solved.
    """
    if x.size < 2:
        return Grazing(*np.full((2, at.size), np.nan))
    log = np.log(solved.load)
    return Grazing(np.exp(hermite(x, log, monotone_slopes(x, log), at)), np.interp(at, x, solved.slope))


def _exact_curve(
    contact: Contact, node_place: FloatArray, unit: float, nodes: Grazing, top: float
) -> tuple[FloatArray, FloatArray]:
    """Solve the exact curve at some speeds, and interpolate its ratio to :func:`_base_loads`.

    Args:
        contact: The bearing's contact.
        node_place: Places of its nodes, as of :func:`_solve_nodes`.
        unit: Unit of the speed in them [m/s].
        nodes: The least loads that graze there, ``nan`` for none.
        top: The largest load [N].

    Returns:
        The fields ``exact`` and ``larger`` of :class:`FoldCurve`.
    """
    # No last speed lies below that of the least load of all, which a table may have between two nodes. Beyond
    # the first node above the largest load no fold rises faster than its load.
    least_node = int(np.argmin(np.nan_to_num(nodes.load, nan=np.inf)))
    first = min(max(least_node - 1, 0) if contact.is_smooth else 0, _NODES - 2)
    beyond = int(np.append(first, np.flatnonzero(nodes.load <= top))[-1]) + 1 + contact.rises_beyond_scale
    last = min(beyond, _NODES - 1)
    # Of seven scattered tables of 100 points 90 % of the folds are right to 1.2e-4, with 128 to 2e-4.
    every, total, error = (64, 16, 1e-9) if contact.is_smooth else (16, 176, 1e-5)
    parts = math.ceil(total / (last - first))  # from node to node
    index = np.linspace(first, last, (last - first) * parts * every + 1)
    place = np.exp(np.interp(index, np.arange(_NODES), np.log(node_place)))
    speed = unit * np.expm1(place)
    rows, base = np.arange(0, speed.size, every), _base_loads(contact, speed)
    loads, slopes = np.full((2, speed.size), np.nan)
    loads[:: parts * every], slopes[:: parts * every] = (column[first : last + 1] for column in nodes)
    # The ratio at nodes leads to 3e-5 of half the loads of a table of 100 points.
    node_rows = np.flatnonzero(np.isfinite(loads))
    ratio = _join_neighbours(
        place[node_rows], Grazing(loads[node_rows] / base[node_rows], slopes[node_rows]), place
    )
    guess = Grazing(base * ratio.load, ratio.slope)
    # Where friction first rises no lining sticks at slow speeds: larger loads only take longer to try.
    max_load = np.where(np.arange(speed.size) < np.append(node_rows, 0)[0] - parts * every, top, 8.0 * top)
    doubtful = rows if contact.is_smooth else rows[np.isnan(loads[rows])]
    while doubtful.size:
        beside = Grazing(*(column[doubtful] for column in guess))
        solved = least_sticking_loads(contact, speed[doubtful], max_load[doubtful], beside, error)
        loads[doubtful], slopes[doubtful] = solved
        rows = np.union1d(rows, doubtful)
        exact, doubtful = _join_loads(contact, place, base, rows, loads)
        guess = Grazing(exact, np.interp(place, place[rows], slopes[rows]))
    if np.isfinite(loads[-1]) and not contact.rises_beyond_scale:
        return np.stack([speed, exact]), np.zeros((2, 0))
    # The curve ends where it is vertical: there the least and the largest load that stick meet.
    highest = float(np.max(speed[np.isfinite(loads)], initial=speed[0]))
    end = max(int(np.searchsorted(speed, 0.8 * highest)) - 1, 0)
    x = np.linspace(math.log(min(float(exact[end]), top)), math.log(top), 33 if exact[end] < top else 0)
    larger = np.stack([x, last_sticking_speeds(contact.bearing, np.exp(x))])
    return np.stack([speed[: end + 1], exact[: end + 1]]), larger


def _join_loads(
    contact: Contact, place: FloatArray, base: FloatArray, rows: IndexArray, loads: FloatArray
) -> tuple[FloatArray, IndexArray]:
    """Join the loads that were solved at some speeds of a curve.

    Args:
        contact: The bearing's contact.
        place: The curve's places, shape (n,).
        base: Its :func:`_base_loads`, shape (n,) [N].
        rows: Rising rows of the speeds that were tried.
        loads: Loads that graze [N], ``nan`` for none and where none was tried, shape (n,).

    Returns:
        The loads of all speeds, shape (n,) [N], ``inf`` beside speeds without one, and everywhere where three
        or fewer were solved; and rows to solve, too. Of a smooth law these lie halfway between ``rows`` where
        polynomials of eight and of twelve points differ by over 1e-8; of one in pieces they are least loads
        that were not solved: folds that may not exist.
    """
    is_solved = np.isfinite(loads[rows])
    solved, none = rows[is_solved], np.zeros(0, np.intp)
    if solved.size <= 3:
        return np.full(place.size, np.inf), none
    solved_place, ratio = place[solved], np.log(loads[solved] / base[solved])
    if not contact.is_smooth:
        joined = hermite(solved_place, ratio, monotone_slopes(solved_place, ratio), place)
    else:  # a cubic spline leaves 1e-7 of a fold of Stribeck's law, these 1e-11
        joined = local_polynomials(solved_place, ratio, place, min(12, solved.size))
    has_gap = np.interp(place, place[rows], ~is_solved) > 0.0
    with np.errstate(over='ignore'):
        exact = np.where(has_gap, np.inf, base * np.exp(joined))
    if not contact.is_smooth:
        later = np.append(np.minimum.accumulate(exact[:0:-1])[::-1], np.inf)
        is_least = (exact < later) & (exact < np.append(np.inf, exact[:-1]))
        return exact, np.setdiff1d(np.flatnonzero(is_least), rows)
    if solved.size <= 8:
        return exact, none
    halfway = (rows[:-1] + rows[1:]) // 2
    halfway = halfway[(halfway > rows[:-1]) & ~has_gap[halfway]]
    off = local_polynomials(solved_place, ratio, place[halfway], 8) - joined[halfway]
    return exact, halfway[np.abs(off) > 1e-8]


def _base_loads(contact: Contact, speed: FloatArray) -> FloatArray:
    """Return positive loads [N], shape (n,), to which those that graze have a smooth ratio.

    Of a law in pieces they are averaging's least loads with a cycle at the sliding limit, bounded; of one
    that falls at once they are in proportion to the speed, as the loads are.
    """
    if contact.is_smooth:
        return speed if contact.bounds.fall == math.inf else np.ones(speed.size)
    slope = cusp_slope(contact.law, speed)
    return contact.bearing.damping / np.maximum(slope, 1e-3 * contact.bounds.fall)


def last_speeds(curve: FloatArray, load: FloatArray, smooth: bool) -> FloatArray:
    """Return the last speeds at which a load is enough for a cycle [m/s].

    Args:
        curve: Ascending speeds [m/s], and the least load with a cycle at each, ``inf`` for none [N],
            shape (2, m).
        load: Loads > 0, shape (n,) [N].
        smooth: Whether a cubic spline joins the points of the curve; else monotone cubics.

    Returns:
        Shape (n,); ``nan`` where no speed has a cycle. Beyond the last point in proportion to the load.
    """
    speed = curve[0]
    with np.errstate(all='ignore'):
        (x, y), level = np.log(curve), np.log(load)
        lowest = np.minimum.accumulate(y[::-1])[::-1]
        i = np.searchsorted(lowest, level, side='right') - 1
        beyond = np.where(level > y[-1], np.exp(level - y[-1]), 1.0)
        result = np.where(i < 0, np.nan, speed[i] * beyond)
        rows = np.flatnonzero((i >= 0) & (i < x.size - 1))
        rows = rows[np.isfinite(y[i[rows] + 1])]
        i = i[rows]
        slope = _curve_slopes(x, y, smooth)
        h, rise, part = x[i + 1] - x[i], y[i + 1] - y[i], level[rows] - y[i]
        cubic = (part, rise, h * slope[i], h * slope[i + 1])
        share = root_on_bracket(_missing_part, np.zeros(i.size), np.ones(i.size), (part, part - rise), cubic)
    result[rows] = np.exp(x[i] + share * h)
    return result


def _curve_slopes(x: FloatArray, y: FloatArray, smooth: bool) -> FloatArray:
    """Return the slopes of the interpolant at a curve's points: rising ``x`` and their ``y``, shape (n,).

    Each stretch of finite points is joined by itself: by a spline where ``smooth``, else by monotone cubics.
    0 at points that are not finite and in stretches of up to three.
    """
    slope = np.zeros(x.size)
    join = spline_slopes if smooth else monotone_slopes
    edges = [0, *(np.flatnonzero(np.diff(np.isfinite(y).astype(int))) + 1), x.size]
    for first, last in itertools.pairwise(edges):
        if last - first > 3 and np.isfinite(y[first]):
            part = slice(int(first), int(last))
            slope[part] = join(x[part], y[part])
    return slope


def _missing_part(
    t: FloatArray, part: FloatArray, rise: FloatArray, begin: FloatArray, end: FloatArray
) -> FloatArray:
    """Return the distance by which a Hermite cubic on [0, 1] lies below a level at ``t``.

    Args:
        t: Places, shape (n,).
        part: The level less the value at 0.
        rise: The value at 1 less that at 0.
        begin: Slope at 0.
        end: Slope at 1.
    """
    square, cube = 3.0 * rise - 2.0 * begin - end, begin + end - 2.0 * rise
    return part - t * (begin + t * (square + t * cube))
