# SPDX-License-Identifier: Apache-2.0
"""The exact fold: the last speed at which the slip phase meets the belt.

At a given bearing it depends on the load alone. :class:`FoldCurve` builds it octave by octave of
the load, each once and always in the same way, and evaluates it as a polynomial: so it costs a
bulk assessment some additions and multiplications, and a value never depends on what was asked
before.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from stickslip_monitor.arrays import BoolArray, FloatArray, IndexArray
from stickslip_monitor.physics.averaging import boundaries
from stickslip_monitor.physics.chebyshev import FINE, NOWHERE, Pieces, no_pieces
from stickslip_monitor.physics.cycle.law import breakaway, steepest_fall
from stickslip_monitor.physics.cycle.orbit import follow
from stickslip_monitor.physics.cycle.setting import FORWARD, can_gain, setting
from stickslip_monitor.physics.cycle.slip_phase import grazing_margin
from stickslip_monitor.physics.friction import Coulomb, Stribeck, computes_as
from stickslip_monitor.physics.oscillator import Bearing
from stickslip_monitor.physics.roots import costly_root

# Speeds in units of a guess between which the last cycle is looked for: where averaging or
# Coulomb's law tells it, and where neither does.
_NEAR = np.array([0.3, 0.6, 0.9, 0.98, 0.998, 0.99998, 1.0001, 1.002, 1.02, 1.1, 1.4, 2.5])
_BELOW = (1e-3, 0.01, 0.03, 0.1, 0.2, 0.4, 0.6, 0.8, 0.9, 0.97, 0.99, 0.998)
_ABOVE = (1.0005, 1.005, 1.03, 1.1, 1.25, 1.7, 2.5, 5.0, 10.0, 30.0, 100.0, 1e3)
_FAR = np.array([*_BELOW, *_ABOVE])
# The coarse search: speeds, how far beyond the scales of the law, and how often divided by what.
_SPEEDS, _SPREAD, _PARTS = 64, 100.0, 16
_ROUNDS, _FINE, _ROUGH_ROUNDS, _ROUGH = 6, 1e-9, 4, 1e-6
# How far the coarse fold may be off, and the parts into which the rest is divided, how often.
_AROUND = np.array([0.0, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3])
_EVEN, _POLISHING, _CLOSE = np.linspace(0.0, 1.0, 17), 16, 1e-13
# More points than this make an orbit that ends its steps at each of them slow.
_FINE_TABLE = 64
# Exponent beyond which a motion dies out within a turn.
# Octaves of load that can be built: beyond them the fold is in proportion to the load, which is
# what Coulomb's law, the limit for large loads, gives at every load.
_OCTAVES = 20
# Of the last coefficients, by how the fold is found. A table is known to a few digits.
_EXACT, _COARSE, _MEASURED = 1e-9, 1e-6, 1e-3
# Growth rate of the slip at breakaway, N |mu'(0)| / (m omega), from which it is found coarsely.
_STEEP = 8.0
# Exponent beyond which a motion dies out within a turn.
_LARGEST = 700.0


def grazing(bearing: Bearing, speed: FloatArray, load: FloatArray) -> FloatArray:
    """Signed distance of the slip phase from grazing, > 0 where it meets the belt, shape (n,)."""
    local = setting(bearing, speed, load, FORWARD)
    return follow(FORWARD, local, np.zeros(speed.size), np.zeros(speed.size)).margin


def coulomb_fold(bearing: Bearing, load: FloatArray) -> FloatArray:
    """The fold [m/s] of a law that falls at once, from one turn of the free vibration.

    It starts ``N Delta/k`` from its middle at the belt's speed, and must have that speed again
    when it has lost ``exp(-2 pi zeta)`` of its amplitude: right to some percent.
    """
    law, momentum = bearing.friction, bearing.mass * bearing.natural_frequency
    viscous = law.viscous if computes_as(law, Stribeck) else 0.0
    steady = float(law.coefficient(_SPREAD * max(law.breakpoints, default=1.0)))
    kinetic = law.kinetic if computes_as(law, Stribeck) else steady
    damping = bearing.damping_ratio + 0.5 * viscous * load / momentum
    lost = np.expm1(np.minimum(4.0 * np.pi * damping, _LARGEST))
    with np.errstate(all='ignore'):
        fold: FloatArray = max(breakaway(law) - kinetic, 0.0) * load / momentum / np.sqrt(lost)
    return fold


def smooth_fold(bearing: Bearing, load: FloatArray, averaged: FloatArray) -> FloatArray:
    """The last speed [m/s] with a stick-slip cycle, where its slip phase grazes the belt.

    Args:
        bearing: The bearing.
        load: ``N`` > 0 [N], shape (n,).
        averaged: The fold of averaging [m/s], shape (n,).

    Returns:
        ``nan`` where no speed has a cycle, ``inf`` where none is the last, shape (n,).
    """
    out = np.full(load.size, np.nan)
    guess = guessed_fold(bearing, load, averaged)
    index = np.flatnonzero(can_gain(bearing, load) & (guess > 0.0))
    # Without damping a cycle gains energy at every speed, and averaging says so exactly.
    out[index] = np.inf
    index = index[np.isfinite(guess[index])]
    for ratios in (_NEAR, _FAR):
        if not index.size:
            break
        grid = guess[index, None] * ratios
        loads = np.repeat(load[index], ratios.size)
        hit = grazing(bearing, grid.ravel(), loads).reshape(grid.shape) > 0.0
        last = _last(hit)
        found = (last >= 0) & (last < ratios.size - 1)
        out[index[~found]] = np.where(last[~found] < 0, np.nan, np.inf)
        where, last = index[found], last[found]
        low, high = grid[found, last], grid[found, last + 1]
        out[where] = _grazed(bearing, load[where], low, high)
        index = index[~found]
    return out


def _grazed(bearing: Bearing, load: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
    """The speeds between two at which the slip phase just grazes the belt [m/s], shape (n,)."""
    return costly_root(lambda v, rows: grazing(bearing, v, load[rows]), low, high).value


def _last(hit: BoolArray) -> IndexArray:
    """The last column that is set in each row, -1 for none, shape (n,)."""
    last = hit.shape[1] - 1 - np.argmax(hit[:, ::-1], axis=1)
    return np.where(hit.any(axis=1), last, -1)


def is_steep(bearing: Bearing, load: FloatArray) -> BoolArray:
    """Whether slip grows so fast at breakaway that an orbit takes many steps, shape (n,)."""
    steep: BoolArray = load * steepest_fall(bearing.friction) > (
        _STEEP * bearing.mass * bearing.natural_frequency
    )
    return steep


def exact_fold(bearing: Bearing, load: FloatArray) -> FloatArray:
    """The last speed [m/s] with a stick-slip cycle, in the way that suits law and load.

    Args:
        bearing: The bearing.
        load: ``N`` > 0 [N], shape (n,).

    Returns:
        ``nan`` where no speed has a cycle, ``inf`` where none is the last, shape (n,).
    """
    law = bearing.friction
    if computes_as(law, Coulomb):
        return smooth_fold(bearing, load, np.full(load.shape, np.nan))
    if not computes_as(law, Stribeck):
        fine = len(law.breakpoints) > _FINE_TABLE
        return coarse_fold(bearing, load) if fine else polished_fold(bearing, load)
    averaged = np.asarray(boundaries.fold_speed(bearing, load))
    out, steep = np.empty(load.shape), is_steep(bearing, load)
    out[~steep] = smooth_fold(bearing, load[~steep], averaged[~steep])
    guess = guessed_fold(bearing, load, averaged)[steep]
    endless = guess == np.inf
    out[steep] = np.where(
        endless, np.inf, polished_fold(bearing, load[steep], np.where(endless, 1.0, guess))
    )
    return out


def guessed_fold(bearing: Bearing, load: FloatArray, averaged: FloatArray) -> FloatArray:
    """The fold that averaging or Coulomb's law gives, whichever is higher [m/s], shape (n,)."""
    return np.fmax(averaged, coulomb_fold(bearing, load))


def coarse_fold(
    bearing: Bearing, load: FloatArray, guess: FloatArray | None = None, *, rough: bool = False
) -> FloatArray:
    """:func:`smooth_fold` of any law by search, to some 1e-6.

    The cost hardly depends on the law.

    Args:
        bearing: The bearing.
        load: ``N`` > 0 [N], shape (n,).
        guess: Of :func:`guessed_fold`, where one is near enough, shape (n,).
        rough: To some 1e-4, as a measured law is worth.
    """
    rounds, tolerance = (_ROUGH_ROUNDS, _ROUGH) if rough else (_ROUNDS, _FINE)
    out = np.full(load.size, np.nan)
    index = np.flatnonzero(can_gain(bearing, load))
    if guess is None:
        speeds, parts = _scales(bearing, load[index]), _SPEEDS
        low, high = speeds.min(axis=1) / _SPREAD, _SPREAD * speeds.max(axis=1)
    else:
        low, high, parts = _NEAR[0] * guess[index], _NEAR[-1] * guess[index], _PARTS
    for _ in range(rounds if index.size else 0):
        grid = low[:, None] * (high / low)[:, None] ** (np.arange(parts + 1) / parts)
        loads = np.repeat(load[index], parts + 1)
        margin = grazing_margin(bearing, grid.ravel(), loads, tolerance)
        last = _last(margin.reshape(grid.shape) > 0.0)
        out[index[last == parts]] = np.inf
        found = np.flatnonzero((last >= 0) & (last < parts))
        index, last, parts = index[found], last[found], _PARTS
        low, high = grid[found, last], grid[found, last + 1]
    out[index] = np.sqrt(low * high) if rough else low
    return out


def _scales(bearing: Bearing, load: FloatArray) -> FloatArray:
    """Speeds about which a law can have its fold [m/s], shape (n, 1 to 3)."""
    breaks = bearing.friction.breakpoints
    ends = np.array([*breaks[:1], *breaks[-1:]])
    jump = coulomb_fold(bearing, load)
    usual = ends.max(initial=0.0) or 1.0
    jump = np.where((jump > 0.0) & np.isfinite(jump), jump, usual)
    return np.concatenate([np.broadcast_to(ends, (load.size, ends.size)), jump[:, None]], axis=1)


def polished_fold(
    bearing: Bearing, load: FloatArray, guess: FloatArray | None = None
) -> FloatArray:
    """The fold of :func:`coarse_fold`, arguments as there, as exactly as orbits are followed.

    Near grazing the orbits of a steep law part like a logarithm, which no interpolation follows.
    """
    out = coarse_fold(bearing, load, guess)
    rows = np.flatnonzero(np.isfinite(out))
    ratios = 1.0 + np.concatenate([-_AROUND[::-1], _AROUND])
    low, high = out[rows] * ratios[0], out[rows] * ratios[-1]
    for _ in range(_POLISHING if rows.size else 0):
        grid = low[:, None] + (high - low)[:, None] * _shares(ratios)
        hit = grazing(bearing, grid.ravel(), np.repeat(load[rows], grid.shape[1]))
        last = _last(hit.reshape(grid.shape) > 0.0)
        found = (last >= 0) & (last < grid.shape[1] - 1)
        rows, last = rows[found], last[found]
        low, high = grid[found, last], grid[found, last + 1]
        out[rows] = low
        ratios = _EVEN
        going = high - low > _CLOSE * low
        rows, low, high = rows[going], low[going], high[going]
        if not rows.size:
            break
    return out


def _shares(ratios: FloatArray) -> FloatArray:
    """Where numbers are between the first and the last of them."""
    shares: FloatArray = (ratios - ratios[0]) / (ratios[-1] - ratios[0])
    return shares


@lru_cache(maxsize=32)
def fold_curve(bearing: Bearing) -> FoldCurve:
    """The curve of a bearing, one for all who ask."""
    return FoldCurve(bearing)


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
        self._closed = computes_as(law, Stribeck)
        # Without damping a cycle gains energy at every speed, and averaging says so exactly.
        self._endless = self._closed and onset == 0.0
        self._octaves = 1 if computes_as(law, Coulomb) else _OCTAVES
        self._sizes = (FINE // 2, 1) if self._closed else (FINE // 4, FINE // 16)
        self._drop = law.static / (bearing.mass * bearing.natural_frequency)
        self.pieces: Pieces = no_pieces(self._octaves)

    def has(self, octaves: range) -> bool:
        """Whether some octaves are built."""
        return bool((self.pieces.cell[[FINE * octave for octave in octaves]] != NOWHERE).all())

    def prepare(self, octaves: range) -> None:
        """Build some octaves above the least load with a cycle."""
        self._built(np.array(octaves, dtype=float))

    def speed(self, load: FloatArray, averaged: FloatArray) -> FloatArray:
        """Exact fold speed [m/s], as ``exact_fold_speed``.

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

    def speed_of_number(self, load: float, averaged: float) -> float:
        """:meth:`speed` of one finite load > 0, of Stribeck's law."""
        height = load / self._unit
        if not self._endless and 1.0 <= height < 2.0**self._octaves:
            mantissa, exponent = math.frexp(height)
            ratio = self.pieces.value_of_number((exponent - 2.0) + 2.0 * mantissa)
            if ratio is not None:
                return ratio * averaged if ratio * averaged > 0.0 else math.nan
        return float(self.speed(np.array([load]), np.array([averaged]))[0])

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
        if self._closed or computes_as(self.bearing.friction, Coulomb):
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
        pieces, part = self._built(y)
        result = pieces.value(part, y) * (averaged if self._closed else self._drop * load)
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

    def _built(self, y: FloatArray) -> tuple[Pieces, IndexArray]:
        """The polynomials, and that of every point, built where it is not there yet.

        Another thread may build others at the same time: what it adds may be lost, and built
        again when it is asked for, but the two are never mixed.
        """
        pieces = self.pieces
        cell = np.minimum((y * FINE).astype(np.intp), pieces.cell.size - 1)
        part = pieces.cell.take(cell)
        if part.min(initial=0) == NOWHERE:
            for octave in np.unique(cell[part == NOWHERE] // FINE):
                pieces = pieces.with_unit(
                    int(octave), self._ratio, self._tolerance(int(octave)), self._sizes
                )
            self.pieces = pieces
            part = pieces.cell.take(cell)
        return pieces, part.astype(np.intp, copy=False)

    def _ratio(self, y: FloatArray) -> FloatArray:
        """The exact fold over the scale of speeds, 0 where there is none, shape of ``y``."""
        octave = np.floor(y)
        load = self._unit * np.exp2(octave) * (1.0 + (y - octave))
        bearing, law = self.bearing, self.bearing.friction
        averaged = np.full(load.shape, np.nan)
        if self._closed:
            averaged = np.asarray(boundaries.fold_speed(bearing, load))
        if computes_as(law, Coulomb) or (self._closed and not self._is_steep(octave[0])):
            fold = smooth_fold(bearing, load, averaged)
        else:
            guess = guessed_fold(bearing, load, averaged) if self._closed else None
            fold = coarse_fold(bearing, load, guess, rough=not self._closed)
        scale = averaged if self._closed else self._drop * load
        return np.where(np.isnan(fold), 0.0, fold / scale)

    def _tolerance(self, octave: int) -> float:
        if not self._closed:
            return _MEASURED
        return _COARSE if self._is_steep(octave) else _EXACT

    def _is_steep(self, octave: float) -> bool:
        """Whether the slip phase is so fast at some load of an octave that twelve digits cost."""
        return bool(is_steep(self.bearing, np.array([self._unit * 2.0 ** (octave + 1.0)]))[0])
