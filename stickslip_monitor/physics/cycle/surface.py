# SPDX-License-Identifier: Apache-2.0
"""The amplitude of the exact stick-slip cycle of one bearing, precomputed over speed and load.

A stick-slip cycle always begins at the same point, so its turning points do not notice where the
lining sticks again: in coordinates that move with the fold the amplitude stays smooth right up to
it, although the stick phase vanishes there like a square root. The coordinates are the load within
an octave and ``u = log2(1 - log2(V/V_F))``, which is 0 at the fold and in which both ways
towards a standstill, an amplitude in proportion to the speed and a constant one, are smooth.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import lru_cache

import numpy as np

from stickslip_monitor.arrays import BoolArray, FloatArray, IndexArray
from stickslip_monitor.physics import chebyshev
from stickslip_monitor.physics.averaging import boundaries
from stickslip_monitor.physics.chebyshev import NOWHERE, PiecewiseChebyshev2D
from stickslip_monitor.physics.cycle.cycles import exact_cycle
from stickslip_monitor.physics.cycle.fold import fold_curve
from stickslip_monitor.physics.cycle.law import steepest_fall
from stickslip_monitor.physics.cycle.stable import slip_round_trip
from stickslip_monitor.physics.friction import Coulomb, Stribeck, computes_as
from stickslip_monitor.physics.oscillator import Bearing

# Unit squares along u: the speed goes down to 2**-15 of the fold speed.
_SQUARES = 4
# Octaves of load above the least load with a cycle that are built beforehand, and at all.
_CORE, _OCTAVES = 4, 20
# Of the last coefficients: it leaves a wide distance to the 1e-6 that is promised.
_TOLERANCE = 2e-6
# Cycles computed for an octave, some three times what those of the reference bearing take.
_BUDGET = 3072
# Points evaluated together: arrays that stay in the cache.
_BLOCK = 1024


class CycleSurface:
    """Amplitudes of exact stick-slip cycles at array speed, to 1e-6.

    Every octave of load is built when it is first asked for, and always in the same way: what an
    amplitude is never depends on what was asked before.

    Args:
        bearing: The bearing.

    Attributes:
        sheets: Logarithm of ``A omega/V`` over u and the octaves of load built so far.
        folds: The exact fold.
    """

    def __init__(self, bearing: Bearing) -> None:
        self.bearing = bearing
        self.sheets: dict[int, PiecewiseChebyshev2D] = {}
        self.folds = fold_curve(bearing)
        drive = float(steepest_fall(bearing.friction))
        self._onset = bearing.damping / drive if drive > 0.0 else np.inf
        self._unit = self._onset if 0.0 < self._onset < np.inf else 1.0
        # A law in pieces makes a surface with creases, of which polynomials make nothing, and of
        # any law but these the fold is not known to enough digits.
        self._smooth = any(computes_as(bearing.friction, kind) for kind in (Stribeck, Coulomb))
        self._drop = bearing.friction.static / (bearing.mass * bearing.natural_frequency)
        self._core = range(0)
        if self._unit == self._onset:
            # Cycles far from harmonic take many steps: few octaves for a heavily damped lining.
            self._core = range(int(np.clip(np.log2(2.0 / bearing.damping_ratio), 1, _CORE)))
        # Under Coulomb's law the fold is in proportion to the load.
        one = computes_as(bearing.friction, Coulomb) and self._onset == 0.0
        self._folds_core = range(1) if one else self._core

    @property
    def prepared(self) -> bool:
        """Whether all is there that :meth:`prepare` can build."""
        sheets = self._core if self._smooth else ()
        return self.folds.has(self._folds_core) and all(octave in self.sheets for octave in sheets)

    def prepare(self) -> None:
        """Build the octaves that a bearing near its boundaries works at."""
        self._prepare(self._folds_core, self._core)

    def _prepare(self, folds: range, sheets: range) -> None:
        self.folds.prepare(folds)
        for octave in sheets if self._smooth else ():
            self._sheet(octave)

    def missing(self, load: float) -> range:
        """The octave of a load [N] and those beside it, if one that can be built is not there."""
        if not (self._unit == self._onset <= load < math.inf):
            return range(0)
        octave = math.frexp(load / self._unit)[1] - 1
        around = range(max(octave - 1, 0), min(octave + 2, _OCTAVES))
        known = not self._smooth or all(number in self.sheets for number in around)
        return range(0) if known and self.folds.has(around) else around

    def extend(self, octaves: range) -> None:
        """Build some octaves of :meth:`missing`."""
        self._prepare(octaves, octaves)

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

    def amplitude_of_number(self, speed: float, load: float, fold: float, exact: float) -> float:
        """:meth:`amplitude` of one point, to the last bit, and without arrays as a rule.

        Args:
            speed: ``V`` > 0 [m/s].
            load: ``N`` [N].
            fold: Fold speed of averaging at that load [m/s].
            exact: That of the exact model, as of :attr:`folds` [m/s].
        """
        found = self._look_up_number(speed, load, exact)
        if found is None:
            points = (np.array([value]) for value in (speed, load, fold))
            found = float(self.amplitude(*points)[0])
        return found

    def _look_up_number(self, speed: float, load: float, exact: float) -> float | None:
        """What the sheets that are there know of one point; ``None`` where they do not."""
        mantissa, exponent = math.frexp(load / self._unit)
        sheet = self.sheets.get(exponent - 1)
        if sheet is None or not (speed > 0.0 and load > self._onset):
            return None
        if exact != exact:
            return exact
        x = float(np.log2(speed / (self._drop * load if exact == math.inf else exact)))
        if x > 0.0:
            return math.nan if exact < math.inf else None
        u = float(np.log2(1.0 - x))
        size = sheet.value_of_number(u, 2.0 * mantissa - 1.0) if u < _SQUARES else None
        if size is None:
            return None
        return float(np.exp(size)) * (speed / self.bearing.natural_frequency)

    def lookup(
        self, speed: FloatArray, load: FloatArray, fold: FloatArray
    ) -> tuple[FloatArray, BoolArray]:
        """What the surface knows; arguments as of :meth:`amplitude`.

        It does not reach below 2**-15 of the fold speed, where cycles overtake the belt or jump
        with the speed, far beyond the least load with a cycle, and laws other than Stribeck's and
        Coulomb's.

        Returns:
            Amplitudes [m], ``nan`` for none, and where the surface knows, each of shape (n,).
        """
        out, known = np.full(speed.shape, np.nan), np.ones(speed.shape, dtype=bool)
        usable = (speed > 0.0) & (load > self._onset) & np.isfinite(speed) & np.isfinite(load)
        where = np.flatnonzero(usable)
        if not where.size:
            return out, known
        known[where] = False
        mantissa, exponent = np.frexp(load[where] / self._unit)
        for octave, inside in self._usable(exponent - 1):
            part, sheet = where[inside], self._sheet(octave)
            for start in range(0, part.size, _BLOCK):
                block = part[start : start + _BLOCK]
                y = 2.0 * mantissa[inside[start : start + _BLOCK]] - 1.0
                out[block], known[block] = self._evaluate(
                    sheet, y, speed[block], load[block], fold[block]
                )
        return out, known

    def _usable(self, octave: IndexArray) -> Iterator[tuple[int, IndexArray]]:
        """Each octave that can be built, and the points in it."""
        for number in np.unique(octave) if self._smooth else ():
            if abs(number) < _OCTAVES:
                yield int(number), np.flatnonzero(octave == number)

    def _sheet(self, octave: int) -> PiecewiseChebyshev2D:
        """The sheet of an octave, built if it is not there yet."""
        if octave not in self.sheets:
            self.sheets[octave] = self._build(octave)
        return self.sheets[octave]

    def _evaluate(
        self,
        sheet: PiecewiseChebyshev2D,
        y: FloatArray,
        speed: FloatArray,
        load: FloatArray,
        fold: FloatArray,
    ) -> tuple[FloatArray, BoolArray]:
        """Amplitudes [m], ``nan`` for none, and where the sheet knows."""
        exact = self.folds.speed(load, fold)
        with np.errstate(divide='ignore'):
            x = np.log2(speed / self._limit(load, exact))
        u = np.log2(1.0 - np.minimum(x, 0.0))
        absent = np.isnan(exact) | (np.isfinite(exact) & (x > 0.0))
        reached = (x <= 0.0) & (u < _SQUARES)
        panel = sheet.locate(np.where(reached, u, 0.0), y)
        inside = np.flatnonzero(reached & (panel != NOWHERE))
        size = sheet.value(panel[inside], u[inside], y[inside])
        out, known = np.full(speed.shape, np.nan), absent
        out[inside] = np.exp(size) * (speed[inside] / self.bearing.natural_frequency)
        known[inside] = True
        return out, known

    def _limit(self, load: FloatArray, exact: FloatArray) -> FloatArray:
        """The exact fold, or a scale of speeds where every speed has a cycle [m/s]."""
        return np.where(np.isposinf(exact), self._drop * load, exact)

    def _build(self, octave: int) -> PiecewiseChebyshev2D:
        def size(u: FloatArray, y: FloatArray) -> FloatArray:
            load = self._unit * np.exp2(octave) * (1.0 + y)
            averaged = np.asarray(boundaries.fold_speed(self.bearing, load))
            limit = self._limit(load, self.folds.speed(load, averaged))
            return self._log_size(limit * np.exp2(1.0 - np.exp2(u)), load)

        return chebyshev.build(size, (_SQUARES, 1), _TOLERANCE, _BUDGET)

    def _log_size(self, speed: FloatArray, load: FloatArray) -> FloatArray:
        """Logarithm of ``A omega/V`` of cycles that never pass the belt, else ``nan``."""
        out = np.full(speed.shape, np.nan)
        where = np.flatnonzero(speed > 0.0)
        turn = slip_round_trip(self.bearing, speed[where], load[where], np.zeros(where.size))
        size = 0.5 * (turn.behind.crest - turn.behind.trough)
        out[where] = np.log(np.where(turn.stuck & ~turn.over, size, np.nan))
        return out


@lru_cache(maxsize=32)
def surface_of(bearing: Bearing) -> CycleSurface:
    """The surface of a bearing, one for all who ask."""
    return CycleSurface(bearing)


def exact_amplitude_of_number(
    bearing: Bearing, speed: float, load: float, fold: float, exact: float
) -> float:
    """:func:`exact_amplitude` of one point, to the last bit; ``exact`` is its exact fold [m/s]."""
    return surface_of(bearing).amplitude_of_number(abs(speed), load, fold, exact)


def exact_amplitude(
    bearing: Bearing, speed: FloatArray, load: FloatArray, fold: FloatArray
) -> FloatArray:
    """Amplitude of the exact stick-slip cycle [m]; ``nan`` where there is none.

    From the bearing's surface where that reaches, else from the exact cycle itself: the two differ
    by less than 1e-6 of the amplitude.

    Args:
        bearing: The bearing.
        speed: ``V`` [m/s], shape (n,).
        load: ``N`` [N], shape (n,).
        fold: Fold speed of averaging at that load [m/s], shape (n,).
    """
    return surface_of(bearing).amplitude(np.abs(speed), load, fold)
