# SPDX-License-Identifier: Apache-2.0
"""The boundaries of a bearing over its load, tabulated once for a rule that must not solve.

Each boundary is a piecewise polynomial in ``ln N`` from the least load at which a stick-slip cycle
exists; above the last one a speed is in proportion to the load, as Coulomb's law has it, the limit
of every law for large loads. A smooth law is a cubic spline, right to 1e-7, near
the onset of one with an exponent to 2e-4; one in pieces (a measured table) is interpolated
linearly in many more points, right to 1e-4 where it is smooth and to 2e-3 where it is noisy, but
where its fold jumps or begins, between two loads a percent apart.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.physics.averaging import boundaries
from stickslip_monitor.physics.averaging.quadrature import slope_table
from stickslip_monitor.physics.cycle.cycles import exact_fold_speed
from stickslip_monitor.physics.fold_curve import curve_speeds, last_speeds, slowest_speed
from stickslip_monitor.physics.oscillator import Bearing, damping_per_load

# Octaves of load from the onset, and points in one: measured, twice as many gain nothing. A steep
# law, or a noisy table, has its onset at some newtons, far from Coulomb's 8 octaves above it.
_OCTAVES, _SMOOTH, _BROKEN = 8, 100, 128
# As far as the larger loads of ships [N], or until friction would move the lining by so much [m]:
# beyond, its slip is so stiff that a table takes 119 s in place of 2 (50 kg, 3 Hz, 200 kN).
_LARGE, _GIVES = 2e5, 0.1
# Loads among which the onset is looked for [N], and how often the interval is divided by 64.
_LEAST, _MOST, _ROUNDS = 1e-9, 1e15, 8
# Share of the averaged slope at a higher speed below which a speed has no say.
_MATTERS = 0.7


@dataclass(frozen=True, slots=True)
class BoundaryTable:
    """Boundaries of one bearing.

    Attributes:
        first: ``ln N`` of the first point; ``inf`` where no load has a boundary.
        step: Distance of two points in ``ln N``.
        pieces: Of the averaged and the exact fold the coefficients of the polynomials in the share
            of a step, lowest order first, shape (2, points - 1, 4) [m/s].
    """

    first: float
    step: float
    pieces: FloatArray

    def exact(self, load: FloatArray) -> FloatArray:
        """The exact fold at loads [N], shape (n,): ``nan`` where there is none [m/s]."""
        place = np.where(load > 0.0, (np.log(load) - self.first) / self.step, -1.0)
        pieces = self.pieces[1]
        most = float(len(pieces))
        inside = np.clip(np.nan_to_num(place, nan=0.0), 0.0, most)
        k = np.minimum(inside.astype(np.intp), len(pieces) - 1)
        share = inside - k
        c0, c1, c2, c3 = pieces[k].T
        speed = c0 + share * (c1 + share * (c2 + share * c3))
        speed = np.where(place > most, speed * np.exp((place - most) * self.step), speed)
        return np.where((place >= 0.0) & (speed > 0.0), speed, np.nan)


def boundary_at(pieces: Any, first: float, step: float, load: float) -> float:
    """One boundary at a load [m/s]: 0 where there is none, ``inf`` where it has no end.

    Args:
        pieces: Coefficients, (points - 1) rows of four.
        first: ``ln N`` of the first point.
        step: Distance of two points.
        load: ``N`` [N].
    """
    if not load > 0.0:
        return 0.0
    place = (math.log(load) - first) / step
    if place < 0.0:
        return 0.0
    most = len(pieces)
    if place >= most:
        beyond, place = (place - most) * step, float(most)
        k = most - 1
    else:
        beyond, k = 0.0, int(place)
    share = place - k
    row = pieces[k]
    speed: float = row[0] + share * (row[1] + share * (row[2] + share * row[3]))
    return speed * math.exp(beyond) if beyond > 0.0 else speed


def boundary_table(bearing: Bearing) -> BoundaryTable:
    """The averaged and the exact fold of a bearing over the load."""
    broken = bool(getattr(bearing.friction, 'kinks', ()))

    def averaged(load: FloatArray) -> FloatArray:
        found = _read_from_curve(bearing, load) if broken else None
        return np.asarray(boundaries.fold_speed(bearing, load)) if found is None else found

    def exact(load: FloatArray) -> FloatArray:
        return np.asarray(exact_fold_speed(bearing, load))

    onset = _onset(bearing)
    if onset == math.inf and not exact(np.array([_MOST]))[0] > 0.0:
        return BoundaryTable(math.inf, 1.0, np.zeros((2, 1, 4)))
    if onset == math.inf:
        # A law that falls at once, as Coulomb's, has a fold in proportion to every load.
        onset = _LEAST
    octaves = _OCTAVES
    if onset > _LEAST:
        most = _GIVES * bearing.stiffness / max(bearing.friction.static, _LEAST)
        octaves = max(octaves, math.ceil(math.log2(min(_LARGE, most) / onset)))
    points = octaves * (_BROKEN if broken else _SMOOTH) + 1
    grid = np.linspace(0.0, octaves * math.log(2.0), points)
    load = np.exp(math.log(onset) + grid)
    with np.errstate(all='ignore'):
        columns = [np.asarray(each(load), float) for each in (averaged, exact)]
    pieces = [_linear(column) if broken else _smooth(column) for column in columns]
    return BoundaryTable(math.log(onset), float(grid[1]), np.stack(pieces))


known_table = lru_cache(maxsize=64)(boundary_table)
"""The two folds of a bearing, tabulated once."""


def _onset(bearing: Bearing) -> float:
    """The least load [N] with a fold by averaging, to the last bits; ``inf`` for none."""
    law = bearing.friction
    low, high = math.log(_LEAST), math.log(_MOST)
    for _ in range(_ROUNDS):
        grid = np.linspace(low, high, 65)
        with np.errstate(all='ignore'):
            q = damping_per_load(bearing.damping, np.exp(grid))
            there = np.flatnonzero(boundaries.averaged(law).has_fold(law, q))
        if not there.size:
            return math.inf
        k = int(there[0])
        if k == 0:
            return math.exp(low)
        low, high = float(grid[k - 1]), float(grid[k])
    return math.exp(high)


def _read_from_curve(bearing: Bearing, load: FloatArray) -> FloatArray | None:
    """The averaged folds of ascending loads; ``None`` where the largest has none.

    Of a measured table each by itself would take seconds.
    """
    least, most = slowest_speed(bearing.friction), float(boundaries.fold_speed(bearing, load[-1]))
    if not least < most < math.inf:
        return None
    speed = curve_speeds(least, most)
    table = slope_table(bearing.friction)
    # What has no cycle until far more load than a higher speed is nowhere the last.
    height = np.interp(speed, table.speeds, table.peak)
    above = np.maximum.accumulate(height[::-1])[::-1]
    found, matters = np.full(speed.size, np.inf), height > _MATTERS * above
    found[matters] = boundaries.fold_load(bearing, speed[matters])
    found[-1] = load[-1]
    found[np.isnan(found)] = np.inf
    return last_speeds(speed, found, load, smooth=False)


def _linear(speed: FloatArray) -> FloatArray:
    speed = np.where(np.isnan(speed), 0.0, speed)
    pieces = np.zeros((speed.size - 1, 4))
    pieces[:, 0] = speed[:-1]
    with np.errstate(invalid='ignore'):  # from one endless fold to the next
        pieces[:, 1] = np.where(np.isfinite(speed[1:]), np.diff(speed), 0.0)
    return pieces


def _smooth(speed: FloatArray) -> FloatArray:
    """A spline through what is finite, from its beginning on; before there is no boundary."""
    there = np.flatnonzero(speed > 0.0)
    if there.size < 4 or not np.isfinite(speed[there[0] :]).all():
        return _linear(speed)
    first = int(there[0])
    pieces = np.zeros((speed.size - 1, 4))
    spline = CubicSpline(np.arange(speed.size - first, dtype=float), speed[first:])
    pieces[first:] = spline.c[::-1].T
    return pieces
