# SPDX-License-Identifier: Apache-2.0
"""The exact fold speed of a bearing over its load, as one piecewise smooth function.

At a given bearing the exact fold depends on the load alone. It is built octave by octave of the
load, each once and always in the same way, and evaluated as a polynomial: so it costs a bulk
assessment some additions and multiplications, and a value never depends on what was asked before.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from stickslip_monitor.arrays import BoolArray, FloatArray, IndexArray
from stickslip_monitor.physics.averaging import boundaries
from stickslip_monitor.physics.chebyshev import FINE, NOWHERE, Pieces, no_pieces
from stickslip_monitor.physics.cycle import stable
from stickslip_monitor.physics.cycle.law import steepest_fall
from stickslip_monitor.physics.friction import Coulomb, Stribeck
from stickslip_monitor.physics.oscillator import Bearing
from stickslip_monitor.physics.slip_phase import grazing_margin

# Octaves of load that can be built: beyond them the fold is in proportion to the load, which is
# what Coulomb's law, the limit for large loads, gives at every load.
_OCTAVES = 20
# Of the last coefficients, by how the fold is found. A table is known to a few digits.
_EXACT, _COARSE, _MEASURED = 1e-9, 1e-6, 1e-4
# Growth rate of the slip at breakaway, N |mu'(0)| / (m omega), from which it is found coarsely.
_STEEP = 8.0


class FoldCurve:
    """Exact fold speeds of a bearing, at array speed.

    Of Stribeck's law it is right to 1e-9, or 1e-6 at loads far above the first with a cycle, of
    others to some 1e-4.

    Args:
        bearing: The bearing.

    Attributes:
        pieces: The exact fold over a scale of speeds, built so far; over the octaves of load from
            the least with a cycle.
    """

    def __init__(self, bearing: Bearing) -> None:
        self.bearing = bearing
        law = bearing.friction
        drive = float(steepest_fall(law))
        onset = bearing.damping / drive if drive > 0.0 else np.inf
        self._known_onset = onset > 0.0
        # The least load with a cycle, or one below those that matter.
        self._unit = onset if self._known_onset else 2.0 ** (-_OCTAVES // 2)
        self._closed = type(law) is Stribeck
        # Without damping a cycle gains energy at every speed, and averaging says so exactly.
        self._endless = self._closed and onset == 0.0
        self._octaves = 1 if isinstance(law, Coulomb) else _OCTAVES
        self._drop = law.static / (bearing.mass * bearing.natural_frequency)
        self.pieces: Pieces = no_pieces(self._octaves)

    def has(self, octaves: range) -> bool:
        """Whether some octaves are built."""
        return bool((self.pieces.cell[[FINE * octave for octave in octaves]] != NOWHERE).all())

    def prepare(self, octaves: range) -> None:
        """Build some octaves above the least load with a cycle."""
        self._part(np.array(octaves, dtype=float))

    def speed(self, load: FloatArray, averaged: FloatArray) -> FloatArray:
        """Exact fold speed [m/s], as :func:`stickslip_monitor.physics.cycle.cycles.exact_fold_speed`.

        Args:
            load: ``N``; any number [N], shape (n,).
            averaged: Fold speed of averaging there [m/s], shape (n,).
        """
        if self._endless:
            return averaged.copy()
        height = load / self._unit
        if ((height >= 1.0) & (height < 2.0**self._octaves)).all():
            return self._inside(load, averaged, height)
        return self._anywhere(load, averaged, height)

    def has_cycle(
        self,
        speed: FloatArray,
        load: FloatArray,
        averaged: FloatArray,
        exact: FloatArray,
        known: BoolArray,
    ) -> BoolArray:
        """Where the averaged or the exact model has a stick-slip cycle, shape (n,).

        Args:
            speed: ``V`` >= 0 [m/s], shape (n,).
            load: ``N`` [N], shape (n,).
            averaged: Fold speed of averaging [m/s], shape (n,).
            exact: That of :meth:`speed`, shape (n,).
            known: Where the averaged model has one, shape (n,).
        """
        inside: BoolArray = (speed < exact) | known
        if self._closed or isinstance(self.bearing.friction, Coulomb):
            return inside
        # A law with several ranges of speed is quiet between them.
        gap = np.flatnonzero(inside & ~known & (speed < averaged) & (speed > 0.0))
        inside[gap] = grazing_margin(self.bearing, speed[gap], load[gap]) > 0.0
        return inside

    def _inside(self, load: FloatArray, averaged: FloatArray, height: FloatArray) -> FloatArray:
        """Within the octaves."""
        mantissa, exponent = np.frexp(height)
        # The octave and the linear share of it, in which the curve is as smooth as in ln N.
        y = (exponent - 2.0) + 2.0 * mantissa
        part = self._part(y)
        result = self.pieces.value(part, y)
        result = result * (averaged if self._closed else self._drop * load)
        return np.where(result > 0.0, result, np.nan)

    def _anywhere(self, load: FloatArray, averaged: FloatArray, height: FloatArray) -> FloatArray:
        """Below the octaves there is no cycle, or as above them a fold in proportion to load."""
        result = np.full(load.shape, np.nan)
        reached = (load > 0.0) & np.isfinite(load) & ((height >= 1.0) | ~self._known_onset)
        rows = np.flatnonzero(reached)
        if not rows.size:
            return result
        last = 2.0**self._octaves * (1.0 - 1e-12)
        inside = np.clip(height[rows], 1.0, last)
        outside = inside != height[rows]
        n, fold = np.where(outside, inside * self._unit, load[rows]), averaged[rows]
        if outside.any():
            fold[outside] = boundaries.fold_speed(self.bearing, n[outside])
        result[rows] = self._inside(n, fold, inside) * (height[rows] / inside)
        return result

    def _part(self, y: FloatArray) -> IndexArray:
        """The polynomial of every point, built where it is not there yet."""
        cell = np.minimum((y * FINE).astype(np.intp), self.pieces.cell.size - 1)
        part = self.pieces.cell.take(cell)
        if part.min(initial=0) == NOWHERE:
            for octave in np.unique(cell[part == NOWHERE] // FINE):
                self.pieces = self.pieces.with_unit(
                    int(octave), self._ratio, self._tolerance(int(octave))
                )
            part = self.pieces.cell.take(cell)
        return part.astype(np.intp, copy=False)

    def _ratio(self, y: FloatArray) -> FloatArray:
        """The exact fold over the scale of speeds, 0 where there is none, shape of ``y``."""
        octave = np.floor(y)
        load = self._unit * np.exp2(octave) * (1.0 + (y - octave))
        bearing, law = self.bearing, self.bearing.friction
        averaged = np.full(load.shape, np.nan)
        if self._closed:
            averaged = np.asarray(boundaries.fold_speed(bearing, load))
        if isinstance(law, Coulomb) or (self._closed and not self._is_steep(octave[0])):
            fold = stable.fold(bearing, load, averaged)
        else:
            guess = stable.guessed_fold(bearing, load, averaged) if self._closed else None
            fold = stable.coarse_fold(bearing, load, guess)
        scale = averaged if self._closed else self._drop * load
        return np.where(np.isnan(fold), 0.0, fold / scale)

    def _tolerance(self, octave: int) -> float:
        if not self._closed:
            return _MEASURED
        return _COARSE if self._is_steep(octave) else _EXACT

    def _is_steep(self, octave: float) -> bool:
        """Whether the slip phase is so fast at some load of an octave that twelve digits cost."""
        gain = self._unit * 2.0 ** (octave + 1.0) * steepest_fall(self.bearing.friction)
        return gain > _STEEP * self.bearing.mass * self.bearing.natural_frequency


@lru_cache(maxsize=32)
def fold_curve(bearing: Bearing) -> FoldCurve:
    """The curve of a bearing, one for all who ask."""
    return FoldCurve(bearing)
