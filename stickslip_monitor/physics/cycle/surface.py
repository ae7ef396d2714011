# SPDX-License-Identifier: Apache-2.0
"""The amplitude of the exact stick-slip cycle of one bearing, precomputed over speed and load.

A stick-slip cycle always begins at the same point, so its turning points do not notice where the
lining sticks again: in coordinates that move with the fold the amplitude stays smooth right up to
it, although the stick phase vanishes there like a square root. The coordinates are the logarithm
of the load and ``u = log2(1 - log2(V/V_F))``, which is 0 at the fold and in which both ways
towards a standstill, an amplitude in proportion to the speed and a constant one, are smooth.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from stickslip_monitor.arrays import BoolArray, FloatArray, IndexArray
from stickslip_monitor.physics import chebyshev
from stickslip_monitor.physics.averaging import boundaries
from stickslip_monitor.physics.chebyshev import NOWHERE, PiecewiseChebyshev1D, PiecewiseChebyshev2D
from stickslip_monitor.physics.cycle.cycles import exact_cycle, exact_fold_speed
from stickslip_monitor.physics.cycle.law import scaled, steepest_fall
from stickslip_monitor.physics.cycle.stable import slip_round_trip
from stickslip_monitor.physics.oscillator import Bearing

# Of what a sheet holds: one from another version is of no use.
VERSION = 1
# Unit squares along u: the speed goes down to 2**-15 of the fold speed.
_SQUARES = 4
# Octaves of load above the least load with a cycle that are built beforehand, as one sheet.
_CORE = 4
_ROWS_PER_OCTAVE = 2
# Of the last coefficients; both leave a wide distance to the 1e-6 that is promised.
_SIZE_TOLERANCE, _FOLD_TOLERANCE = 2e-6, 1e-8
# Cycles computed for a sheet: a second's work at most, twice what the reference bearing takes.
_BUDGET = 4096
# Points in one octave of load from which it is worth building.
_WORTH = 5000
# Points evaluated together: arrays that stay in the cache.
_BLOCK = 1024


@dataclass(frozen=True, slots=True)
class Sheet:
    """The surface over some octaves of load.

    Attributes:
        fold: Exact fold speed over the scale of speeds, along the load; 0 where no speed has a
            cycle, 1 where every speed has one.
        size: Logarithm of ``A omega/V`` over u and the load.
    """

    fold: PiecewiseChebyshev1D
    size: PiecewiseChebyshev2D


class CycleSurface:
    """Amplitudes of exact stick-slip cycles at array speed, to 1e-6.

    Args:
        bearing: The bearing.

    Attributes:
        sheets: The sheets built so far, by the octave of load they begin with.
    """

    def __init__(self, bearing: Bearing) -> None:
        self.bearing = bearing
        self.sheets: dict[int, Sheet] = {}
        drive = float(steepest_fall(bearing.friction))
        self._onset = bearing.damping / drive if drive > 0.0 else np.inf
        self._unit = self._onset if 0.0 < self._onset < np.inf else 1.0
        # A law in pieces makes a surface with creases, of which polynomials make nothing.
        self._smooth = scaled(bearing.friction, np.ones(1), np.ones(1), 0.0).pieces is None
        self._core = 0
        if self._smooth and self._unit == self._onset:
            # Cycles far from harmonic take many steps: few octaves for a heavily damped lining.
            self._core = int(np.clip(np.log2(2.0 / bearing.damping_ratio), 1, _CORE))

    @property
    def prepared(self) -> bool:
        """Whether all is there that :meth:`prepare` can build."""
        return 0 in self.sheets or not self._core

    def prepare(self) -> None:
        """Build the sheet of the loads that a bearing near its boundaries works at."""
        if not self.prepared:
            self.sheets[0] = self._build(0)

    def amplitude(self, speed: FloatArray, load: FloatArray, fold: FloatArray) -> FloatArray:
        """Amplitude of the stick-slip cycle [m]; ``nan`` where none exists.

        Where the surface does not reach, the exact cycle is computed.

        Args:
            speed: ``V`` >= 0 [m/s], shape (n,).
            load: ``N`` [N], shape (n,).
            fold: Fold speed of averaging at that load [m/s], shape (n,).
        """
        out, known = self.lookup(speed, load, fold)
        rest = np.flatnonzero(~known)
        if rest.size:
            out[rest] = exact_cycle(self.bearing, speed[rest], load[rest]).amplitude
        return out

    def lookup(
        self, speed: FloatArray, load: FloatArray, fold: FloatArray
    ) -> tuple[FloatArray, BoolArray]:
        """What the surface knows; arguments as of :meth:`amplitude`.

        It does not reach below 2**-15 of the fold speed, where cycles overtake the belt or jump
        with the speed, beyond the loads built so far, and laws in pieces (measured tables).

        Returns:
            Amplitudes [m], ``nan`` for none, and where the surface knows, each of shape (n,).
        """
        out, known = np.full(speed.shape, np.nan), np.ones(speed.shape, dtype=bool)
        usable = (speed > 0.0) & (load > self._onset) & np.isfinite(speed) & np.isfinite(load)
        where = np.flatnonzero(usable)
        if not where.size:
            return out, known
        known[where] = False
        height = np.log2(load[where] / self._unit)
        octave = np.floor(height).astype(np.intp)
        octave[(octave >= 0) & (octave < self._core)] = 0
        for number, inside in self._usable(octave):
            part = where[inside]
            for start in range(0, part.size, _BLOCK):
                block, rows = part[start : start + _BLOCK], inside[start : start + _BLOCK]
                out[block], known[block] = self._evaluate(
                    self.sheets[number],
                    height[rows] - number,
                    speed[block],
                    load[block],
                    fold[block],
                )
        return out, known

    def _usable(self, octave: IndexArray) -> Iterator[tuple[int, IndexArray]]:
        """Each sheet that the points are on, built where that is worth it, and those points."""
        for number in range(octave.min(), octave.max() + 1) if self._smooth else ():
            inside = np.flatnonzero(octave == number)
            if number not in self.sheets and inside.size >= _WORTH:
                self.sheets[number] = self._build(number)
            if number in self.sheets and inside.size:
                yield number, inside

    def _evaluate(
        self, sheet: Sheet, y: FloatArray, speed: FloatArray, load: FloatArray, fold: FloatArray
    ) -> tuple[FloatArray, BoolArray]:
        """Amplitudes [m], ``nan`` for none, and where the sheet knows."""
        row = sheet.fold.locate(y)
        ratio = sheet.fold.value(row, y)
        limit = self._scale(load, fold) * ratio
        with np.errstate(divide='ignore'):
            x = np.log2(speed / np.where(sheet.fold.good[row], limit, np.nan))
        u = np.log2(1.0 - np.minimum(x, 0.0))
        absent = sheet.fold.good[row] & (x > 0.0) & (ratio != 1.0)
        reached = sheet.fold.good[row] & (x <= 0.0) & (u < _SQUARES)
        panel = sheet.size.locate(np.where(reached, u, 0.0), y)
        inside = np.flatnonzero(reached & (panel != NOWHERE))
        size = sheet.size.value(panel[inside], u[inside], y[inside])
        out, known = np.full(speed.shape, np.nan), absent
        out[inside] = np.exp(size) * (speed[inside] / self.bearing.natural_frequency)
        known[inside] = True
        return out, known

    def _build(self, number: int) -> Sheet:
        octaves = self._core if number == 0 and self._core else 1

        def load_at(y: FloatArray) -> FloatArray:
            return self._unit * np.exp2(number + y)

        def fold_ratio(y: FloatArray) -> FloatArray:
            exact = exact_fold_speed(self.bearing, load_at(y))
            ratio = exact / self._averaged_scale(load_at(y))
            return np.where(np.isposinf(exact), 1.0, np.where(np.isnan(exact), 0.0, ratio))

        fold = chebyshev.build_rows(fold_ratio, octaves, _ROWS_PER_OCTAVE, _FOLD_TOLERANCE)

        def size(u: FloatArray, y: FloatArray) -> FloatArray:
            load, row = load_at(y), fold.locate(y)
            limit = self._averaged_scale(load) * np.where(
                fold.good[row], fold.value(row, y), np.nan
            )
            return self._log_size(limit * np.exp2(1.0 - np.exp2(u)), load)

        return Sheet(fold, chebyshev.build(size, (_SQUARES, octaves), _SIZE_TOLERANCE, _BUDGET))

    def _log_size(self, speed: FloatArray, load: FloatArray) -> FloatArray:
        """Logarithm of ``A omega/V`` of cycles that never pass the belt, else ``nan``."""
        out = np.full(speed.shape, np.nan)
        where = np.flatnonzero(speed > 0.0)
        turn = slip_round_trip(self.bearing, speed[where], load[where], np.zeros(where.size))
        size = 0.5 * (turn.behind.crest - turn.behind.trough)
        out[where] = np.log(np.where(turn.stuck & ~turn.over, size, np.nan))
        return out

    def _averaged_scale(self, load: FloatArray) -> FloatArray:
        return self._scale(load, np.asarray(boundaries.fold_speed(self.bearing, load)))

    def _scale(self, load: FloatArray, fold: FloatArray) -> FloatArray:
        """The scale of speeds at a load: the fold of averaging where it has one."""
        drop = self.bearing.friction.static / (self.bearing.mass * self.bearing.natural_frequency)
        return np.where(np.isfinite(fold), fold, drop * load)


@lru_cache(maxsize=32)
def surface_of(bearing: Bearing) -> CycleSurface:
    """The surface of a bearing, one for all who ask."""
    return CycleSurface(bearing)


def exact_amplitude(
    bearing: Bearing, speed: FloatArray, load: FloatArray, fold: FloatArray
) -> FloatArray:
    """Amplitude of the exact stick-slip cycle [m]; ``nan`` where there is none.

    From the bearing's surface where that has been prepared or is worth building, else from the
    exact cycle itself: the two differ by less than 1e-6 of the amplitude.

    Args:
        bearing: The bearing.
        speed: ``V`` [m/s], shape (n,).
        load: ``N`` [N], shape (n,).
        fold: Fold speed of averaging at that load [m/s], shape (n,).
    """
    return surface_of(bearing).amplitude(np.abs(speed), load, fold)
