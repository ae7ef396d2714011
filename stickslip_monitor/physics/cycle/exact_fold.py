# SPDX-License-Identifier: Apache-2.0
"""The exact fold over the load: the last speed at which the slip phase meets the belt.

Of many loads the question is turned round: from which load on does the slip phase meet the belt at
a speed? That load is in a smooth ratio to the one by averaging. The ratio is solved at some speeds
and interpolated by polynomials, and the folds are read from the curve.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.physics.averaging import boundaries, closed_form
from stickslip_monitor.physics.averaging.quadrature import slope_surface
from stickslip_monitor.physics.cycle.slip import (
    GRAZING,
    ROUGHLY,
    Orbit,
    Oscillator,
    grazing_margin,
)
from stickslip_monitor.physics.fold_curve import (
    curve_speeds,
    interpolated,
    last_speeds,
    slowest_speed,
    stretches,
)
from stickslip_monitor.physics.friction import Coulomb, Stribeck, computes_as
from stickslip_monitor.physics.oscillator import Bearing
from stickslip_monitor.physics.roots import (
    begun_bracket,
    best_of,
    is_found,
    narrowed,
    next_trial,
)
from stickslip_monitor.physics.scalar_law import scalar_law


class _Care(NamedTuple):
    """How well folds are to be known.

    Attributes:
        orbit: The orbits that are followed.
        close: Relative width of a bracket at which its root is found.
        sure: Step from a first guess, in ln N, that needs no second look.
        tolerance: How far a polynomial may be off in the middle between solved speeds, to be used
            at their quarters.
    """

    orbit: Orbit
    close: float
    sure: float
    tolerance: float


# Of a smooth law, where a polynomial's error falls by 256 as its stretch is halved, and of one in
# pieces; each first where slip grows slowly at breakaway, then where it grows so fast that near
# grazing orbits part at once.
_SMOOTH = _Care(GRAZING, 1e-13, 3e-10, 1e-8), _Care(ROUGHLY, 1e-7, 1e-7, 3e-7)
_IN_PIECES = _Care(ROUGHLY, 1e-6, 2e-6, 3e-5), _Care(ROUGHLY, 2e-6, 5e-6, 1e-4)
# Where one fold of a law in pieces is asked for.
_ROUGH_ROOT = 1e-7
# The growth rate of slip at breakaway that is steep, N |mu'(0)| / (m omega).
_STEEP_RATE = 4.0
# Loads in units of the least with a cycle, and forces ``N Delta/(m omega V)``, up to which
# averaging has the fold to 1e-10, and orbits gain too little to improve it.
_WEAKLY, _SLIGHT = 1.003, 1e-6
# Loads from which on a curve costs less than each by itself.
_FEW = 12
# How much averaging may be off, as a factor of the load: where it is steep much more.
_OFF, _STEEPLY_OFF = 2.0, 10.0
# Speeds that are tried for one load, and how far beyond the scales of a law they reach.
_TRIED, _BEYOND = 145, 100.0
# Grazing margins and, in ln N, distances from a root in which the margin is almost straight.
_STRAIGHT = 0.01
# Distance in ln N up to which the rate of the margin is about the same.
_NEARBY = 1.0
# Steps of the secant method, widenings in search of a bracket, trials within one.
_SECANTS, _WIDENINGS, _TRIALS = 6, 12, 100
_LARGEST_EXPONENT = 700.0


def exact_fold(bearing: Bearing, load: FloatArray) -> FloatArray:
    """The last speed with a stick-slip cycle [m/s].

    Args:
        bearing: The bearing.
        load: ``N`` > 0 and finite [N], shape (n,).

    Returns:
        ``nan`` where no speed has a cycle, ``inf`` where none is the last, shape (n,).
    """
    grazing = _Grazing(bearing)
    loads, back = np.unique(load, return_inverse=True)
    out = np.full(loads.size, np.nan)
    # Without a gain at any speed the flow contracts everywhere (Bendixson's criterion).
    falls = loads * grazing.law.fall > bearing.damping
    if bearing.damping == 0.0:  # whatever gains energy gains it at every load
        out[falls & (boundaries.fold_speed(bearing, loads) == np.inf)] = np.inf
    rows = np.flatnonzero(falls & ~(out == np.inf))
    folds = grazing.curve(loads[rows]) if rows.size > _FEW else None
    out[rows] = [grazing.fold(float(n)) for n in loads[rows]] if folds is None else folds
    return out[back]


class _Grazing:
    """Where the slip phase of a bearing grazes the belt."""

    def __init__(self, bearing: Bearing) -> None:
        self.bearing, self.friction = bearing, bearing.friction
        self.law = scalar_law(bearing.friction).plain
        self.body = Oscillator(bearing.mass, bearing.damping, bearing.stiffness)
        self.in_pieces = len(self.law.kinks) > 0
        # Such a law has cycles up to one speed.
        self.falls_on = computes_as(self.friction, Stribeck) or computes_as(self.friction, Coulomb)
        # Of the grazing margin over ln N, as last found, and the ln N there.
        self.rate = self.rate_at = math.nan

    def margin(self, speed: float, load: float, orbit: Orbit) -> float:
        """The distance of the slip phase from grazing, > 0 where it meets the belt."""
        return grazing_margin(self.law, self.body, speed, load, orbit)

    def curve(self, load: FloatArray) -> FloatArray | None:
        """The folds of ascending loads; ``None`` where the largest has none."""
        most = self.fold(float(load[-1]))
        least = self.fold(float(load[0])) if self.falls_on else slowest_speed(self.friction)
        if not least < most < math.inf:
            return None
        speed = curve_speeds(least, most)
        averaged = self.by_averaging(speed)
        # A speed matters where no higher one has a cycle at less load.
        above = np.minimum.accumulate(averaged[::-1])[::-1]
        steep = self.is_steep(averaged)
        label = np.where(averaged <= _OFF * above, 1 + steep, 0)
        found = np.full(speed.size, np.inf)
        for part in stretches(label)[::-1]:
            if label[part.start] > 0:
                found[part] = self._loads(speed[part], averaged[part], bool(steep[part.start]))
        if self.falls_on:
            found[0] = load[0]
        found[-1] = load[-1]
        return last_speeds(speed, found, load, not self.in_pieces)

    def _loads(self, speed: FloatArray, averaged: FloatArray, steep: bool) -> FloatArray:
        """The loads that graze at ascending speeds, near those by averaging [N]."""
        care = (_IN_PIECES if self.in_pieces else _SMOOTH)[int(steep)]
        last = 1.0

        def ratio(i: int, guess: float) -> float:
            nonlocal last
            v, n = float(speed[i]), float(averaged[i])
            if self._is_slight(n, v):
                return 1.0
            guess = n * (guess if guess > 0.0 else last)
            found = self._polished(v, guess, care)
            if math.isnan(found):
                found = _root(lambda load: self.margin(v, load, care.orbit), guess, care.close)
            last = found / n if 0.0 < found < math.inf else last
            return found / n

        return averaged * interpolated(np.log(speed), ratio, care.tolerance)

    def _polished(self, speed: float, guess: float, care: _Care) -> float:
        """The load that grazes, by the secant method; ``nan`` where that leads to none [N]."""
        before, f_before = math.log(guess), self.margin(speed, guess, care.orbit)
        after = before + 1e-5
        # The rate of another load would not tell how large a step is.
        is_known = abs(before - self.rate_at) < _NEARBY
        if is_known and abs(f_before) < _STRAIGHT * min(abs(self.rate), 1.0):
            after = before - f_before / self.rate
            if abs(after - before) < care.sure:
                return math.exp(after)
        for _ in range(_SECANTS):
            f_after = self.margin(speed, math.exp(after), care.orbit)
            last = after - before
            if not (f_after - f_before) * last > 0.0:
                break
            rate = (f_after - f_before) / last
            step = -f_after / rate
            if not abs(step) < 0.05:
                break
            before, f_before, after = after, f_after, after + step
            # The error after a step is far less than its product with the one before.
            if abs(step * last) <= 0.01 * care.sure and abs(f_after) < _STRAIGHT:
                self.rate, self.rate_at = rate, after
                return math.exp(after)
        return math.nan

    def fold(self, load: float) -> float:
        """The last speed with a stick-slip cycle at one load; ``nan`` and ``inf`` as above."""
        close = _ROUGH_ROOT if self.in_pieces else _SMOOTH[0].close
        orbit = ROUGHLY if self.in_pieces else GRAZING

        def beyond(speed: float) -> float:
            return -self.margin(speed, load, orbit)

        if self.falls_on:
            averaged = float(boundaries.fold_speed(self.bearing, load))
            if self._is_slight(load, averaged):
                return averaged
            guess = float(np.fmax(averaged, self._coulomb(load)))
            return _root(beyond, guess, close) if 0.0 < guess < math.inf else guess or math.nan
        above = math.nan
        for speed in self._tried(load):
            if beyond(speed) < 0.0:
                is_first = math.isnan(above)
                return (
                    _root(beyond, speed, close)
                    if is_first
                    else _between(beyond, speed, above, close)
                )
            above = speed
        return math.nan

    def _tried(self, load: float) -> list[float]:
        """Descending speeds, of which the first with a cycle is close to the fold."""
        scales = [v for v in self.friction.breakpoints if v > 0.0] or [load]
        grid = np.geomspace(min(scales) / _BEYOND, max(scales) * _BEYOND, _TRIED)
        least = self.by_averaging(grid)
        # A range of speeds with cycles may be narrower than the grid where it begins.
        inner = least[1:-1]
        lows = 1 + np.flatnonzero((inner < least[:-2]) & (inner <= least[2:]))
        near = np.geomspace(grid[lows - 1], grid[lows + 1], 21)
        lowest = near[np.argmin(self.by_averaging(near), axis=0), np.arange(lows.size)]
        off = _STEEPLY_OFF if self.is_steep(load) else _OFF
        tried = np.append(grid[least <= off * load], lowest)
        found: list[float] = np.sort(tried).tolist()
        return found[::-1]

    def by_averaging(self, speed: FloatArray) -> FloatArray:
        """The least load with a cycle that reaches the belt, by averaging; ``inf`` for none [N].

        Averaging sees no cycle of a law that falls at once, which a turn of the free vibration
        tells.
        """
        if computes_as(self.friction, Stribeck):
            fall = closed_form.peak_slope(self.friction, speed)
        else:
            fall = slope_surface(self.friction, np.ones_like(speed), speed)
        drop = self.law.hold - self.law.top
        with np.errstate(divide='ignore'):
            per_load = np.maximum(fall, 0.0) / self.bearing.damping
            if drop > 0.0:
                per_load += self._lasting(drop, self.bearing.damping_ratio) / speed
            return 1.0 / per_load

    def is_steep(self, load: FloatArray | float) -> Any:
        """Whether slip grows so fast at breakaway that near grazing orbits part at once."""
        # A law that falls at once has no such growth.
        growth = load * self.law.fall
        return (growth > _STEEP_RATE * self.bearing.momentum) & (growth < math.inf)

    def _is_slight(self, load: float, speed: float) -> bool:
        """Whether averaging gives the fold better than orbits, whose energy hardly changes."""
        if not computes_as(self.friction, Stribeck):
            return False
        drop = (self.law.hold - self.friction.kinetic) * load / self.bearing.momentum
        return load * self.law.fall < _WEAKLY * self.bearing.damping or drop < _SLIGHT * speed

    def _coulomb(self, load: float) -> float:
        """The fold [m/s] of a law that falls at once: right to some percent."""
        rise = 0.5 * getattr(self.friction, 'viscous', 0.0) * load / self.bearing.momentum
        drop = max(self.law.hold - getattr(self.friction, 'kinetic', math.inf), 0.0)
        return load * self._lasting(drop, self.bearing.damping_ratio + rise) if drop > 0.0 else 0.0

    def _lasting(self, drop: float, damping: float) -> float:
        """Speed over load [m/(s N)] at which a turn of the free vibration comes back to the belt.

        It starts ``N drop/k`` from its middle at the belt's speed, and must have that speed again
        when it has lost ``exp(-2 pi zeta)`` of its amplitude.
        """
        lost = math.expm1(min(4.0 * math.pi * damping, _LARGEST_EXPONENT))
        return drop / (self.bearing.momentum * math.sqrt(lost)) if lost > 0.0 else math.inf


def _root(function: Callable[[float], float], guess: float, close: float) -> float:
    """The root of a rising function near a guess > 0; ``inf`` above all, ``nan`` below all."""
    at, factor, positive = guess, 1.0001, function(guess) > 0.0
    for _ in range(_WIDENINGS):
        other = at / factor if positive else at * factor
        if (function(other) > 0.0) != positive:
            return _between(function, at, other, close)
        at, factor = other, min(factor**3, 10.0)
    return math.nan if positive else math.inf


def _between(function: Callable[[float], float], a: float, b: float, close: float) -> float:
    """The root of a function between two places where it has different signs."""
    bracket = begun_bracket(a, function(a), b, function(b))
    for _ in range(_TRIALS):
        if is_found(bracket, close):
            break
        at = next_trial(bracket, close)
        bracket = narrowed(bracket, at, function(at))
    return best_of(bracket)
