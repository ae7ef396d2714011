# SPDX-License-Identifier: Apache-2.0
"""The boundaries of a bearing over its load, tabulated once for a rule that must not solve.

Each boundary is a piecewise polynomial in ``ln N`` from the least load at which a stick-slip cycle
exists. Above the last load the end of sticking is in proportion to the load, as under Coulomb's law, the
limit of every law for large loads; an averaged boundary goes on with the power of the load that it has there.

- The boundaries of a smooth law are cubic splines, right to 1e-8; near the onset of a law with an exponent
  to 2e-4. Where the exact fold is not in proportion to the last loads (friction that rises, strong damping)
  they are straight lines, to 1e-4.
- Those of a law in pieces (a measured table) are straight lines between many more points, right to 1e-4 where
  it is smooth and to 2e-3 where it is noisy; not where its fold jumps or begins, between two loads a percent
  apart.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from stickslip_monitor.arrays import FloatArray, flatten, restore
from stickslip_monitor.physics import averages_closed_form, averaging
from stickslip_monitor.physics.bearing import Bearing
from stickslip_monitor.physics.fold_curve import fold_curve
from stickslip_monitor.physics.folds import deciding_fold
from stickslip_monitor.physics.lubrication import as_measured
from stickslip_monitor.physics.numerics import hermite_cubics, spline_slopes
from stickslip_monitor.physics.scalar_law import law_bounds

# Points in an octave of load, of a smooth law and of one in pieces: measured, twice as many gain nothing.
_SMOOTH_POINTS, _PIECEWISE_POINTS = 100, 128


@dataclass(frozen=True, slots=True)
class BoundaryTable:
    """Boundaries of one bearing.

    Attributes:
        first: ``ln N`` of the first point; ``inf`` where no load has a boundary.
        step: Distance of two points in ``ln N``.
        pieces: Coefficients of the polynomials in the share of a step, lowest power first, shape
            (3, points - 1, 4) [m/s]: of the fold that decides, the averaged (KBM) fold and the lower end of
            stick-slip.
        growth: Growth of the logarithm of each of the three by a step beyond the last point, shape (3,).
    """

    first: float
    step: float
    pieces: FloatArray
    growth: FloatArray

    def fold(self, load: FloatArray) -> FloatArray:
        """Return the fold that decides at loads [N], shape (n,) [m/s]; ``nan``: none, ``inf``: no end."""
        return self._read_curve(0, load)

    def fold_kbm(self, load: FloatArray) -> FloatArray:
        """Return the averaged fold at loads [N], shape (n,) [m/s]; ``nan``: none, ``inf``: no end."""
        return self._read_curve(1, load)

    def highest_fold(self, load: FloatArray) -> FloatArray:
        """Return the highest fold that decides at any tabulated load up to each of ``load`` [N].

        Returns:
            Speeds, shape (n,) [m/s]; ``nan`` at a load that has no fold itself.
        """
        with np.errstate(all='ignore'):
            loads = np.exp(self.first + self.step * np.arange(len(self.pieces[0]) + 1))
            highest = np.fmax.accumulate(np.append(0.0, self.fold(loads)))
            return np.maximum(self.fold(load), highest[np.searchsorted(loads, load)])

    def lower_end(self, load: ArrayLike) -> Any:
        """Return the lower end of stick-slip at loads [N], of their shape [m/s]; 0 without one or a load."""
        shape, (n,) = flatten(load)
        with np.errstate(all='ignore'):
            return restore(np.nan_to_num(self._read_curve(2, n)), shape)

    def _read_curve(self, which: int, load: FloatArray) -> FloatArray:
        """Return a boundary at loads [N], shape (n,); ``nan`` below its first point or where it is 0 [m/s].

        ``which`` is its row in :attr:`pieces`. Beyond its last point it goes on with its growth.
        """
        place = np.where(load > 0.0, (np.log(load) - self.first) / self.step, -1.0)
        pieces = self.pieces[which]
        last_piece = float(len(pieces))
        inside = np.clip(np.nan_to_num(place, nan=0.0), 0.0, last_piece)
        k = np.minimum(inside.astype(np.intp), len(pieces) - 1)
        share = inside - k
        c0, c1, c2, c3 = pieces[k].T
        speed = c0 + share * (c1 + share * (c2 + share * c3))
        speed = np.where(place > last_piece, speed * np.exp((place - last_piece) * self.growth[which]), speed)
        return np.where((place >= 0.0) & (speed > 0.0), speed, np.nan)


def place_at(first: float, step: float, load: float) -> float:
    """Return where a load [N] lies in a table, in steps from its first point; -1 without a load.

    It is negative below that point. ``first`` and ``step`` are those of :class:`BoundaryTable` [ln N].
    """
    return (math.log(load) - first) / step if load > 0.0 else -1.0


def boundary_at(pieces: Any, growth: float, place: float) -> float:
    """Return one boundary [m/s]: 0 where there is none, ``inf`` where it has no end.

    Args:
        pieces: Its rows of :attr:`BoundaryTable.pieces`, (points - 1) of four.
        growth: Growth of its logarithm by a step beyond the last point.
        place: Where the load lies, by :func:`place_at`.
    """
    if place < 0.0:
        return 0.0
    last_piece = len(pieces)
    k = min(int(place), last_piece - 1)
    share = min(place, float(last_piece)) - k
    row = pieces[k]
    speed: float = row[0] + share * (row[1] + share * (row[2] + share * row[3]))
    return speed if place <= last_piece else speed * math.exp((place - last_piece) * growth)


def _averaged_growth(last: FloatArray, step: float) -> float:
    """Return the growth of the logarithm of the averaged fold by a step beyond its last piece, 0 to ``step``.

    Two thirds of the logarithm of the load where friction falls at slow speeds only, nothing where it
    rises beyond. Up to 8 times the last load that has the fold to 0.5 %, and to 40 % where it rises.

    Args:
        last: Coefficients of the last piece, lowest power first, shape (4,) [m/s].
        step: Length of a step in ``ln N``.
    """
    speed = float(last.sum())
    if not 0.0 < speed < math.inf:
        return 0.0
    return min(max(float(last[1] + 2.0 * last[2] + 3.0 * last[3]) / speed, 0.0), step)


@lru_cache(maxsize=64)
def boundary_table(bearing: Bearing) -> BoundaryTable:
    """Tabulate the fold that decides, the averaged one and the lower end of stick-slip over the load; cached.

    They are those of friction as measured, at reference points (:mod:`.lubrication`). Where friction does not
    fall or no load has a cycle the table has no boundary, and :attr:`BoundaryTable.first` is ``inf``. Without
    damping both folds are ``inf`` at every load.
    """
    bearing = as_measured(bearing)
    law = bearing.friction
    if not law_bounds(law).fall > 0.0:
        return _NONE
    if bearing.damping == 0.0:  # whatever gains energy gains it at every load
        endless = np.zeros((3, 1, 4))
        endless[:2, :, 0] = np.inf
        return BoundaryTable(math.log(1e-9), 1.0, endless, np.zeros(3))  # from a load of nothing on
    curve = fold_curve(bearing)
    if curve is None:
        return _NONE
    onset = math.log(curve.onset)
    octaves = math.log2(curve.top / curve.onset)
    points = round(octaves * (_SMOOTH_POINTS if curve.is_smooth else _PIECEWISE_POINTS)) + 1
    grid = np.linspace(0.0, octaves * math.log(2.0), points)
    # The exact fold is not in proportion to the load beyond the last one then.
    ends = curve.larger.size > 0 or bearing.damping_ratio >= 1.0 or curve.contact.rises_beyond_scale
    if ends:  # in a step of its own: the line to what is unknown is no fold
        grid = np.append(grid, grid[-1] + grid[1])
    load = np.exp(onset + grid)
    exact = curve.exact_fold(load)
    exact[-1] = np.nan if ends else exact[-1]
    closed = averaging.averages_of(law) is averages_closed_form
    averaged = np.asarray(averaging.fold_speed(bearing, load)) if closed else curve.averaged_fold(load)
    sticking_end = averaged if closed else curve.averaged_sticking_end(load)
    # At its onset the fold of a law that falls most at rest is no speed yet.
    begins = averaged[:1] < curve.exact[0, 0]
    exact[:1] = np.where(begins, averaged[:1], exact[:1])
    fold = deciding_fold(exact, averaged, sticking_end)
    join = _spline_pieces if curve.is_smooth else _linear_pieces
    kbm, step = join(averaged), float(grid[1])
    pieces = np.stack(
        [_linear_pieces(fold) if ends else join(fold), kbm, _linear_pieces(curve.lower_end(load))]
    )
    growth = _averaged_growth(kbm[-1], step)
    return BoundaryTable(onset, step, pieces, np.array([step if exact[-1] > 0.0 else growth, growth, 0.0]))


_NONE = BoundaryTable(math.inf, 1.0, np.zeros((3, 1, 4)), np.zeros(3))


def _linear_pieces(speed: FloatArray) -> FloatArray:
    """Return straight lines between speeds at places 0, 1, ... of a table, shape (n - 1, 4).

    Each row has a piece's coefficients for the share of the step passed, lowest power first. ``nan`` counts
    as 0. A piece towards an infinite speed is level; one from there to a finite speed is ``nan``.
    """
    speed = np.where(np.isnan(speed), 0.0, speed)
    pieces = np.zeros((speed.size - 1, 4))
    pieces[:, 0] = speed[:-1]
    with np.errstate(invalid='ignore'):  # from one endless fold to the next
        pieces[:, 1] = np.where(np.isfinite(speed[1:]), np.diff(speed), 0.0)
    return pieces


def _spline_pieces(speed: FloatArray) -> FloatArray:
    """Return a spline through speeds at places 0, 1, ... of a table, from the first positive one on.

    Each row of the result, shape (n - 1, 4), has a piece's coefficients for the share of the step passed,
    lowest power first. Pieces before the first positive speed are 0. Of fewer than four speeds, or an
    infinite one, they are straight lines.
    """
    rows = np.flatnonzero(speed > 0.0)
    if rows.size < 4 or not np.isfinite(speed[rows[0] :]).all():
        return _linear_pieces(speed)
    first = int(rows[0])
    pieces = np.zeros((speed.size - 1, 4))
    place, column = np.arange(speed.size - first, dtype=float), speed[first:]
    pieces[first:] = hermite_cubics(place, column, spline_slopes(place, column))[::-1].T
    return pieces
