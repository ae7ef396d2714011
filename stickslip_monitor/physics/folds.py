# SPDX-License-Identifier: Apache-2.0
"""The two folds of a bearing, from the least load with a cycle over the speed.

Over the load a fold begins with an infinite slope, and that of a measured table jumps from one
range of speeds with cycles to the next. Over the speed the least load is smooth and has one value.
It is solved there, at many speeds at once, and the last speed at a load is read from that curve.

The exact fold is where the slip phase only grazes the belt. The orbit from breakaway is followed
to its turning point against the belt, and the orbit that grazes is followed back in time to its
own. The logarithm of the ratio of the two amplitudes vanishes there and is almost straight in ``ln
N``, with the slope ``2 pi zeta``, however steep the law: neither orbit passes through the layer in
which neighbours part. So a few secant steps do.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import numpy as np

from stickslip_monitor.arrays import FloatArray, IndexArray
from stickslip_monitor.physics import averaging, closed_form
from stickslip_monitor.physics.averaging_by_scan import peak_curve
from stickslip_monitor.physics.bearing import Bearing
from stickslip_monitor.physics.friction import speed_scales
from stickslip_monitor.physics.numerics import hermite, monotone_slopes, root_on_bracket, spline_slopes
from stickslip_monitor.physics.orbits import (
    EXHAUSTED,
    LANDED,
    RESTED,
    TURNED,
    Route,
    SlipField,
    follow,
    law_in_use,
    slip_field,
)
from stickslip_monitor.physics.scalar_law import ALMOST_REST

# Rounds of a search, its widest step, that towards where margins are finite, and how far from its
# guess it goes without having passed what it looks for.
_MOST_ROUNDS, _WIDEST, _OUTWARD, _FARTHEST = 40, 0.7, 0.4, 3.0
# Error of long steps at most, how close they lead, and how well slopes are known then: folds of a
# table are wanted to no more.
_COARSE, _ROUGHLY, _KNOWN = 1e-7, 1e-5, 0.03
# Orbits that turn take 640 steps of 1e-11 at most, measured up to 0.9 of critical damping, by the eighth
# root of the error 1.8 times as many of 1e-13, and a fourth of those of 1e-7.
_MOST_STEPS, _MOST_LONG_STEPS = 1200, 300
# Times that the speeds of a curve are cut to where orbits turn.
_CUTS = 2
# Loads in units of the least with a cycle, and forces ``N Delta/(m omega V)``, up to which
# averaging has the fold to 1e-10, and orbits gain too little to improve it.
_WEAKLY, _SLIGHT = 1.003, 1e-6
# As far as the larger loads of ships [N], or until friction would move the lining by so much [m],
# and octaves of load from the onset: a steep law has its onset at some newtons, far from Coulomb's
# 8 octaves above it; a soft lining (50 kg, 3 Hz) has slip so stiff at 200 kN that it takes
# minutes.
_LARGE, _GIVES, _OCTAVES = 2e5, 0.1, 8
# Speeds of the scan for the onset; intervals of Chebyshev's speeds at first and at most; speeds
# that are read from their series; of a law in pieces speeds of the curve, and of which each
# so-many-th is solved.
_SCAN, _FEWEST, _MOST, _READ, _BROKEN, _EVERY = 161, 32, 128, 1200, 1024, 8
# Share of the onset's speed by averaging at which the exact one is looked for: it lies at 0.6 to 1.
_BELOW_ONSET = 0.5
# Loads beyond the curve's that are solved one by one.
_LARGER = 17
# Last coefficients of a series that is long enough, and errors in ln N.
_SHORT, _CLOSE = 1e-9, 1e-10
# Loads in units of the least at any higher speed, up to which a speed can be the last.
_MATTERS = 1.5
# Speeds at which contact is looked for at first, in units of the averaged fold from and up to, and
# parts of what is left, and steps.
_FROM, _UP_TO, _SPEEDS, _PARTS, _MOST_OF_CONTACT = 3e-3, 1.05, 160, 8, 4000
# Loads of such a curve, and the change of ln V from one to the next that is a jump.
_CONTACTS, _JUMPS = 49, 0.5
# Error of a step where the margin is to be known to all digits that matter.
_FINE, _FINEST = 1e-11, 1e-13
# Exponent of the attraction after which nothing is left of where an orbit began, damping in units of
# m omega from which slip is drawn so much, the rate that still draws, and z of steady sliding.
_ENOUGH, _HEAVY, _DRAWS, _NEAR_REST = 40.0, 6.0, 3.0, 1e-3
_LARGEST_EXPONENT = 700.0
# How fast ln N has to rise with ln V for a fold read from the curve to be improved by orbits.
_RISES = 0.02
# Share of the steepest fall from which a law falls most at rest: the bound is a rounding above it.
_AS_STEEP = 1.0 - 1e-9


_Margin = Callable[[FloatArray, IndexArray, float], FloatArray]


class Grazing:
    """Where the slip phase of a bearing grazes the belt."""

    def __init__(self, bearing: Bearing) -> None:
        self.bearing, self.law, self.use = bearing, bearing.friction, law_in_use(bearing.friction)
        # The speeds at which the law changes; 1 m/s for one that is the same at all [m/s].
        self.scales = list(speed_scales(self.law)) or [1.0]
        # What a turn of the free vibration takes of the logarithm of its amplitude.
        self.rate = 2.0 * math.pi * max(bearing.damping_ratio, 1e-12)
        self.lasting = self.lasting_speed(self.use.hold - self.use.top, 0.0)
        # Of a step: the margin has to be known to a share of the change that it makes.
        self.fine = min(max(1e-10 * self.rate, _FINEST), _FINE)

    def lasting_speed(self, drop: float, rise: Any) -> Any:
        """Speed over load [m/(s N)] at which a turn of the free vibration reaches the belt again.

        It starts ``N drop/k`` from its middle at the belt's speed, and must have that speed again
        when it has lost ``exp(-2 pi zeta)`` of its amplitude; ``rise`` adds to ``zeta``.
        """
        exponent = 2.0 * self.rate + 4.0 * math.pi * rise
        lost = np.expm1(np.minimum(exponent, _LARGEST_EXPONENT))
        return drop / (self.bearing.momentum * np.sqrt(lost))

    def margin(self, speed: FloatArray, load: FloatArray, error: float) -> FloatArray:
        """Logarithm of how far slip goes beyond what grazes.

        ``-inf`` where slip comes to rest without turning, ``inf`` where what grazes began at rest.

        Args:
            speed: ``V`` > 0, shape (n,) [m/s].
            load: ``N`` > 0, shape (n,) [N].
            error: Of a step.
        """
        n = speed.size
        both = slip_field(self.bearing, np.tile(speed, 2), np.tile(load, 2))
        slip, graze = both.take(slice(n)), both.take(slice(n, None))
        e, z = np.zeros((2, 2 * n))
        if np.max(slip.damping + slip.force * slip.speed * self._course[1][-1], initial=0.0) > _HEAVY:
            e[:n], z[:n] = self._drawn(slip, ahead=True)
        e[n:], z[n:] = self._drawn(graze, ahead=False)
        e[n:] = np.where(z[n:] > 0.0, e[n:], -graze.offset)
        last, direction = np.where(z[:n] > 1.0, 1, 2), np.repeat([1.0, -1.0], n)
        most = _MOST_STEPS if error <= _FINE else _MOST_LONG_STEPS
        most += 4 * len(self.use.kinks)  # a kink may take four
        route = Route(np.concatenate([last, np.ones(n, int)]), error, direction, most=most)
        with np.errstate(all='ignore'):
            orbits = follow(both, e, z, route)
            size = both.rest() - orbits.place
            result = np.log(size[:n] / size[n:])
        slips, grazes = orbits.end[:n], orbits.end[n:]
        unclear = (slips == EXHAUSTED) | (grazes == EXHAUSTED)
        unclear |= (slips == TURNED) & (grazes == TURNED) & np.isnan(result)
        result[grazes != TURNED] = np.where(grazes == RESTED, np.inf, -np.inf)[grazes != TURNED]
        result[(slips != TURNED) | np.isnan(result)] = -np.inf
        if error > self.fine and unclear.any():
            # Long steps do not see how an orbit comes to rest: that would pass for a jump.
            result[unclear] = self.margin(speed[unclear], load[unclear], self.fine)
        return result

    def _drawn(self, field: SlipField, ahead: bool) -> FloatArray:
        """Where to begin on the slow manifold that draws orbits.

        Damping draws what slips behind the belt, and back in time a steep fall of friction what
        grazes, by ``exp`` of the integral of the rate: what comes before enough of that need not be
        followed.

        Returns:
            Displacement and ``z``, 0 where it draws too little, shape (2, n).
        """
        v, slope, mu = (column if ahead else column[::-1] for column in self._course)  # outward
        every, towards = np.arange(field.speed.size), 1.0 if ahead else -1.0
        z = v / field.speed[:, None]
        away = towards * (z - 1.0)
        rate = field.damping + (field.force * field.speed)[:, None] * slope
        draws = (towards * rate > _DRAWS) & (away > _NEAR_REST)
        if not draws.any():
            return np.zeros((2, every.size))
        first = np.argmax(draws, axis=1)
        draws &= np.cumsum(~draws & (np.arange(v.size) > first[:, None]), axis=1) == 0
        drawn = np.where(draws, rate * rate / np.where(draws, away, 1.0), 0.0)
        parts = 0.5 * (drawn[:, 1:] + drawn[:, :-1]) * np.abs(np.diff(z, axis=1))
        start = 1 + np.argmax(np.cumsum(parts, axis=1) > _ENOUGH, axis=1)
        place = field.damping * z - field.force[:, None] * (self.use.hold - mu)
        # What comes from outside must come past it, and slide no faster into another such stretch.
        lowest = np.minimum.accumulate(place[:, ::-1], axis=1)[:, ::-1][every, start]
        found = (start > 1) & (place[every, start] <= np.minimum(lowest, 0.0))
        return np.where(found, [place[every, start], z[every, start]], 0.0)

    @cached_property
    def _course(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Speeds, and slope and coefficient of friction there."""
        v = np.geomspace(1e-4 * self.scales[0], 1e3 * self.scales[-1], 700)
        return v, np.asarray(self.law.slope(v)), np.asarray(self.law.coefficient(v))

    def by_averaging(self, speed: FloatArray) -> FloatArray:
        """The least load with a cycle that reaches the belt, by averaging; ``inf`` for none [N].

        Averaging sees no cycle of a law that falls at once, which a turn of the free vibration
        tells. Beyond critical damping nothing turns, and slip reaches the belt where steady sliding
        is unstable.
        """
        if self.bearing.damping_ratio >= 1.0:
            fall = -np.asarray(self.law.slope(speed))
        else:
            fall = averaging.averaged(self.law).cusp_slope(self.law, speed)
        with np.errstate(all='ignore'):
            per_load = np.maximum(fall, 0.0) / self.bearing.damping + self.lasting / speed
            return np.asarray(1.0 / per_load)

    def loads(self, speed: FloatArray, guess: FloatArray, close: float, near: bool = False) -> FloatArray:
        """The loads that graze at speeds [N], from guesses, to an error in ``ln N``; ``nan``: not found.

        With ``near`` guesses are right to 1e-3.
        """

        def margin(x: FloatArray, rows: IndexArray, error: float) -> FloatArray:
            return self.margin(speed[rows], np.exp(x), error)

        return self._found(margin, np.log(guess), np.full(guess.size, self.rate), close, near)

    def speeds(self, load: FloatArray, guess: FloatArray, close: float, near: bool = False) -> FloatArray:
        """The speeds that graze at loads [m/s], as :meth:`loads`."""
        with np.errstate(all='ignore'):
            ratio = self.by_averaging(guess * 1.001) / self.by_averaging(guess)
            rise = np.log(ratio) / math.log(1.001)
        rate = -self.rate * np.where(rise > 1e-9, np.minimum(rise, 10.0), 1.0)

        def margin(x: FloatArray, rows: IndexArray, error: float) -> FloatArray:
            # A fold by itself to 1e-12, where a curve is read to 1e-9.
            return self.margin(np.exp(x), load[rows], error if error > self.fine else _FINEST)

        return self._found(margin, np.log(guess), rate, close, near)

    def _found(
        self, margin: _Margin, x: FloatArray, rate: FloatArray, close: float, near: bool
    ) -> FloatArray:
        """Where margins vanish: by long steps first, then as close as is wanted."""
        coarse = min(max(1e-5 * float(np.min(np.abs(rate), initial=1.0)), 1e-10), _COARSE)
        if not near:
            x, rate = _solved(lambda x, rows: margin(x, rows, coarse), x, rate, _ROUGHLY, 1.0)
        if close < _ROUGHLY:
            x, rate = _solved(lambda x, rows: margin(x, rows, self.fine), x, rate, close, _KNOWN)
        return np.exp(x)


def _solved(
    margin: Callable[[FloatArray, IndexArray], FloatArray],
    guess: FloatArray,
    rate: FloatArray,
    close: float,
    known: float,
) -> tuple[FloatArray, FloatArray]:
    """Where margins vanish, from guesses: secants within brackets, all at once.

    Args:
        margin: Of places and their indices; may be infinite.
        guess: Shape (n,).
        rate: About the slope of the margins, all of one sign, shape (n,).
        close: How well a place is to be known.
        known: How well, as a share, the slopes are known.

    Returns:
        The places, ``nan`` where they were not found, and the slopes there, ``inf`` where margins jump,
        each of shape (n,).
    """
    x, slope, n = guess.copy(), rate.copy(), guess.size
    sign = 1.0 if n == 0 or rate[0] > 0.0 else -1.0
    low, high, before, value_before = np.multiply.outer([-np.inf, np.inf, np.nan, np.nan], np.ones(n))
    live, last = np.flatnonzero(np.isfinite(x) & np.isfinite(slope)), np.full(n, known)
    for _ in range(_MOST_ROUNDS):
        if not live.size:
            break
        at = x[live]
        value = margin(at, live)
        above, finite = sign * value > 0.0, np.isfinite(value)
        high[live] = np.where(above, np.minimum(high[live], at), high[live])
        low[live] = np.where(above, low[live], np.maximum(low[live], at))
        with np.errstate(all='ignore'):
            secant = (value - value_before[live]) / (at - before[live])
            slope[live] = np.where(np.isfinite(secant) & (secant / rate[live] > 0.2), secant, slope[live])
            move = np.where(finite, -value / slope[live], np.where(above, -_OUTWARD, _OUTWARD))
            move = np.clip(move, -_WIDEST, _WIDEST)
            new, width = at + move, high[live] - low[live]
            both = np.isfinite(width)
            halved = both & ((new <= low[live]) | (new >= high[live]))
            new = np.where(halved, 0.5 * (low[live] + high[live]), new)
        # A secant leaves about the product of its step with the one before.
        left = np.abs(move) * last[live]
        done = finite & ~halved & ((left < close) | (value == 0.0)) | (both & (width < close))
        # A table that scatters, of 100 points: nine loads take 1.8 s with this end, 2.7 s without.
        jumps = both & ~finite & (width < _ROUGHLY)
        slope[live[jumps]] = np.inf
        before[live], value_before[live], x[live] = at, value, new
        last[live] = np.minimum(np.abs(move), 1.0)
        far = ~both & (np.abs(new - guess[live]) > _FARTHEST)
        x[live[far]] = np.nan
        live = live[~done & ~far & ~jumps]
    x[live] = np.nan
    return x, slope


def exact_fold(bearing: Bearing, load: FloatArray) -> FloatArray:
    """The last speed at which the lining sticks [m/s].

    Args:
        bearing: The bearing.
        load: ``N`` > 0 and finite [N], shape (n,).

    Returns:
        ``nan`` where it sticks at no speed; ``inf`` where it sticks at every high speed; shape (n,).
    """
    use = law_in_use(bearing.friction)
    loads, back = np.unique(load, return_inverse=True)
    out = np.full(loads.size, np.nan)
    # Without a gain at any speed the flow contracts everywhere (Bendixson's criterion).
    falls = loads * use.fall > bearing.damping
    if bearing.damping == 0.0:  # whatever gains energy gains it at every load
        out[falls & (np.asarray(averaging.fold_speed(bearing, loads)) == np.inf)] = np.inf
    rows = np.flatnonzero(falls & ~(out == np.inf))
    if rows.size:
        read = _by_contact if bearing.damping_ratio >= 1.0 else _read
        out[rows] = (read if use.kinks else _solve)(bearing, loads[rows])
    return out[back]


def _solve(bearing: Bearing, load: FloatArray) -> FloatArray:
    """The exact folds of a smooth law, which has cycles up to one speed."""
    grazing, law = Grazing(bearing), bearing.friction
    far = 4.0 * grazing.scales[-1]
    steady, rise = float(law.coefficient(far)), max(float(law.slope(far)), 0.0)
    drop = max(grazing.use.hold - (steady - rise * far), 0.0)
    with np.errstate(all='ignore'):
        averaged = np.asarray(averaging.fold_speed(bearing, load))
        coulomb = load * grazing.lasting_speed(drop, 0.5 * rise * load / bearing.momentum)
        guess = np.fmax(averaged, coulomb)
        slight = load * grazing.use.fall < _WEAKLY * bearing.damping
        slight |= drop * load / bearing.momentum < _SLIGHT * averaged
        heavy = bearing.damping + rise * load >= 2.0 * bearing.momentum
        guess = np.where(heavy, np.fmax(np.asarray(averaging.hopf_speed(bearing, load)), coulomb), guess)
    out = np.where(slight, averaged, np.nan)
    rows = np.flatnonzero(~slight & (guess > 0.0) & (guess < np.inf))
    out[rows] = grazing.speeds(load[rows], guess[rows], 1e-10)
    return out


def _read(bearing: Bearing, load: FloatArray) -> FloatArray:
    """The exact folds of any law: read from its curve, and improved where that is steep enough."""
    curve = fold_curve(bearing)
    if curve is None:
        return np.full(load.size, np.nan)
    out = curve.exact_fold(load)
    with np.errstate(all='ignore'):
        speed, exact = np.log(curve.exact)
        i = np.clip(np.searchsorted(speed, np.log(out)) - 1, 0, speed.size - 2)
        steep = (exact[i + 1] - exact[i]) / (speed[i + 1] - speed[i]) > _RISES
    rows = np.flatnonzero(steep & (out > 0.0))
    if rows.size:
        improved = curve.grazing.speeds(load[rows], out[rows], _CLOSE, near=True)
        near = np.abs(np.log(improved / out[rows])) < _RISES
        out[rows[near]] = improved[near]
    return out


def _by_contact(bearing: Bearing, load: FloatArray) -> FloatArray:
    """The last speeds at which slip meets the belt, of many, each time between two of them.

    For much damping of a law in pieces: what is drawn to a slow manifold falls off it at some kink,
    whatever averaging sees.
    """
    averaged = np.asarray(averaging.fold_speed(bearing, load))
    rows = np.flatnonzero(averaged > 0.0)
    low, high = averaged[rows] * _FROM, averaged[rows] * _UP_TO
    out, number = np.full(load.size, np.nan), _SPEEDS
    route = Route(3, _COARSE, contact=True, most=_MOST_OF_CONTACT)
    while rows.size and np.max(high / low) > 1.0 + _ROUGHLY:
        speed = np.exp(np.linspace(np.log(low), np.log(high), number + 1, axis=1))
        v, begin = speed[:, :-1].ravel(), np.zeros(rows.size * number)
        with np.errstate(all='ignore'):
            end = follow(slip_field(bearing, v, np.repeat(load[rows], number)), begin, begin, route).end
        lands = end.reshape(-1, number) == LANDED
        some = lands.any(axis=1)
        last = number - 1 - np.argmax(lands[some, ::-1], axis=1)
        rows, speed, every = rows[some], speed[some], np.arange(last.size)
        low, high, number = speed[every, last], speed[every, last + 1], _PARTS
    out[rows] = low
    return out


class FoldRange(NamedTuple):
    """The loads that a curve is meant for, and its speeds, over the place ``ln(1 + V/V0)``.

    Attributes:
        scale: ``V0`` [m/s].
        low: The slowest speed [m/s].
        high: The fastest one with an exact fold [m/s].
        onset: The least load with a cycle under averaging [N].
        top: The largest load [N].
        limit: ``N/V`` up to which large loads have a cycle, as Coulomb's law has it [N s/m].
    """

    scale: float
    low: float
    high: float
    onset: float
    top: float
    limit: float

    def places(self, share: FloatArray) -> FloatArray:
        """Speeds at shares of the way from the slowest to the fastest [m/s]."""
        begin, end = math.log1p(self.low / self.scale), math.log1p(self.high / self.scale)
        return self.scale * np.expm1(begin + (end - begin) * share)


_NOTHING = np.zeros((2, 0))


@dataclass(frozen=True, slots=True, eq=False)
class FoldCurve:
    """The least loads with a cycle over the speed.

    Attributes:
        grazing: Where slip grazes the belt.
        span: The loads and speeds that it is meant for.
        averaged: Ascending speeds [m/s], and the loads under averaging [N], ``inf`` for none, shape (2, m).
        exact: The same of loads at which slip grazes the belt, shape (2, n).
        larger: ``ln N`` and exact fold of loads beyond the last, shape (2, k): what rises with the
            speed, or strong damping, makes the fold fall again with the load; ``nan`` for unknown.
    """

    grazing: Grazing
    span: FoldRange
    averaged: FloatArray
    exact: FloatArray
    larger: FloatArray

    @property
    def smooth(self) -> bool:
        """Whether a spline joins it, or monotone cubics."""
        return not self.grazing.use.kinks

    def averaged_fold(self, load: FloatArray) -> FloatArray:
        """The last speeds with a cycle under averaging [m/s]; ``nan`` for none, shape (n,)."""
        return last_speeds(self.averaged, load, self.smooth)

    def exact_fold(self, load: FloatArray) -> FloatArray:
        """The last speeds at which the lining sticks [m/s]; ``nan`` for none, shape (n,)."""
        speed = last_speeds(self.exact, load, self.smooth)
        x, y = self.larger
        rows = np.flatnonzero(load > math.exp(x[0])) if x.size else np.zeros(0, int)
        if rows.size:
            slopes = (spline_slopes if np.isfinite(y).all() else monotone_slopes)(x, y)
            speed[rows] = hermite(x, y, slopes, np.log(load[rows]))
        return speed

    def lower_end(self, load: FloatArray) -> FloatArray:
        """The lower end of stick-slip by averaging: below this speed no cycle exists.

        It lies where friction first rises with the speed: there slow sliding is stable, and what
        leaves a stick settles to it.

        Args:
            load: ``N`` > 0, shape (n,) [N].

        Returns:
            0 where there are cycles down to rest, or none at any speed, shape (n,) [m/s].
        """
        out, law = np.zeros(load.size), self.grazing.law
        if not -float(law.slope(ALMOST_REST)) < self.grazing.use.fall * _AS_STEEP:
            return out  # it falls most at rest
        speed, least = self.averaged
        with np.errstate(all='ignore'):
            x, y, level = np.log(speed), np.log(np.minimum.accumulate(least)), np.log(load)
            i = np.searchsorted(-y, -level, side='left')
            rows = np.flatnonzero((i > 0) & (i < speed.size))
            i = i[rows]
            share = np.where(np.isfinite(y[i - 1]), (y[i - 1] - level[rows]) / (y[i - 1] - y[i]), 1.0)
        out[rows] = np.exp(x[i - 1] + share * (x[i] - x[i - 1]))
        return out


@lru_cache(maxsize=64)
def fold_curve(bearing: Bearing) -> FoldCurve | None:
    """The curve of a bearing with damping; ``None`` where no load has a cycle."""
    grazing = Grazing(bearing)
    span = _range(grazing)
    if span is None:
        return None
    averaged = np.stack(_averaged_curve(grazing))
    if not grazing.use.kinks:
        return FoldCurve(grazing, span, averaged, *_smooth_curve(grazing, span))
    if bearing.damping_ratio < 1.0:
        return FoldCurve(grazing, span, averaged, _curve_in_pieces(grazing, span), _NOTHING)
    return FoldCurve(
        grazing, span, averaged, averaged * [[1.0], [np.inf]], _heavily_damped_curve(grazing, span)
    )


def _averaged_curve(grazing: Grazing) -> tuple[FloatArray, FloatArray]:
    """Speeds, and the least loads with a cycle under averaging, ``inf`` for none [N]."""
    law = grazing.law
    speed = np.geomspace(1e-3 * grazing.scales[0], 300.0 * grazing.scales[-1], _SCAN)
    if (solver := averaging.averaged(law)) is closed_form:
        peak = solver.peak_slope(law, speed)
    elif speed_scales(law):
        speed, peak, *_ = peak_curve(law)
    else:
        peak = np.zeros(speed.size)
    with np.errstate(all='ignore'):
        return speed, np.asarray(grazing.bearing.damping / np.maximum(peak, 0.0))


def _range(grazing: Grazing) -> FoldRange | None:
    """The speeds at which the fold lies of loads from the onset to the largest of use."""
    bearing, law, breaks = grazing.bearing, grazing.law, grazing.scales
    in_pieces = len(grazing.use.kinks) > 0
    scan, least = _averaged_curve(grazing)
    rows = (scan >= 1e-3 * breaks[0]) & (scan <= 300.0 * breaks[-1])
    scan, least = scan[rows], least[rows]
    near = grazing.by_averaging(scan)
    both = np.fmin(least, near)
    k = int(np.argmin(both))
    onset = float(both[k])
    if not onset < np.inf:
        return None
    octaves = _OCTAVES
    if grazing.lasting == 0.0:
        if k == 0:  # the least at rest
            onset = bearing.damping / float(-law.slope(ALMOST_REST))
        most = min(_LARGE, _GIVES * bearing.stiffness / max(law.static, 1e-9))
        octaves = max(octaves, math.ceil(math.log2(max(most / onset, 1.0))))
    top, low = onset * 2.0**octaves, float(scan[k]) * (_BELOW_ONSET if k else 1.0)
    fall = grazing.use.hold - float(np.min(law.coefficient(scan)))
    limit = 1.0 / float(grazing.lasting_speed(max(fall, 1e-300), 0.0))
    below = np.flatnonzero(near <= top)
    high = float(scan[below[-1]]) if below.size else low
    falls_on, rises = bool(np.isfinite(near[-1])), float(law.slope(scan[-1])) > 0.0
    if falls_on:
        high = max(high, top / limit)
    last = high
    if falls_on or not (in_pieces or rises):  # where friction rises again no load reaches further
        found = 1.01 * float(grazing.speeds(np.array([top]), np.array([high]), 1e-3)[0])
        last = found if found > 0.0 else high
    scale = max(breaks[0], breaks[-1] / 50.0) if in_pieces else breaks[0]
    return FoldRange(scale, low, max(high, last) if in_pieces else last, onset, top, limit)


def _first_guess(grazing: Grazing, span: FoldRange, speed: FloatArray) -> FloatArray:
    """Loads that graze, to some tens of percent [N]."""
    least = grazing.by_averaging(speed)
    far = speed > 10.0 * grazing.scales[0]
    least = np.where(far, np.minimum(least, span.limit * speed), least)
    return np.asarray(np.minimum(least, 1.5 * span.top))


def _smooth_curve(grazing: Grazing, span: FoldRange) -> tuple[FloatArray, FloatArray]:
    """Of a smooth law: a series of Chebyshev's polynomials in the place, as long as it takes."""
    series, known = _series(grazing, span)
    share = (np.arange(_READ + 1) / _READ) ** 1.5
    exact = np.polynomial.chebyshev.chebval(2.0 * share - 1.0, series)
    # About the least of all there is more to read, so that no load falls between two speeds.
    k = int(np.argmin(exact))
    if 0 < k < _READ:
        near = np.linspace(share[k - 1], share[k + 1], 129)[1:-1]
        share = np.unique(np.concatenate([share, near]))
        exact = np.polynomial.chebyshev.chebval(2.0 * share - 1.0, series)
    larger = _NOTHING
    if exact[-1] < math.log(span.top):
        x = np.linspace(exact[-1], math.log(span.top), _LARGER)
        larger = np.stack([x, _solve(grazing.bearing, np.exp(x))])
    return np.stack([known.places(share), np.exp(exact)]), larger


def _series(grazing: Grazing, span: FoldRange, cuts: int = _CUTS) -> tuple[FloatArray, FoldRange]:
    """Chebyshev's series of the logarithm of the loads that graze, and the speeds where it holds.

    These end where a motion is damped so much that it does not turn.
    """
    count, solved, series = _FEWEST, np.zeros(0), np.zeros(0)
    while True:
        share = 0.5 - 0.5 * np.cos(np.pi * np.arange(count + 1) / count)
        speed = span.places(share)
        if not solved.size:
            solved = np.log(grazing.loads(speed, _first_guess(grazing, span, speed), _CLOSE))
        else:
            guess = np.exp(np.polynomial.chebyshev.chebval(2.0 * share[1::2] - 1.0, series))
            fresh = np.log(grazing.loads(speed[1::2], guess, _CLOSE, near=True))
            solved = np.insert(solved, np.arange(1, solved.size), fresh)
        lost = np.flatnonzero(np.isnan(solved))
        if lost.size:
            if lost[0] < 2 or not cuts:
                return np.array([np.inf]), span
            return _series(grazing, span._replace(high=float(speed[lost[0] - 1])), cuts - 1)
        series = _chebyshev_series(solved)
        if np.abs(series[-3:]).max() < _SHORT or count >= _MOST:
            return series, span
        count *= 2


def _curve_in_pieces(grazing: Grazing, span: FoldRange) -> FloatArray:
    """Of a law in pieces: the ratio to averaging is solved at some speeds and joined."""
    place = np.arange(_BROKEN + 1) / _BROKEN
    speed = span.places(place)
    averaged = np.minimum(grazing.by_averaging(speed), 1e3 * span.top)
    # A speed matters where no higher one has a cycle at less load.
    above = np.minimum.accumulate(averaged[::-1])[::-1]
    matters = averaged <= _MATTERS * above
    rows = np.flatnonzero(matters & (np.arange(speed.size) % _EVERY == 0))
    guess = np.minimum(_first_guess(grazing, span, speed[rows]), averaged[rows])
    ratio = np.log(grazing.loads(speed[rows], guess, _ROUGHLY) / averaged[rows])
    found = np.isfinite(ratio)
    exact = np.full(speed.size, np.inf)
    if np.count_nonzero(found) > 1:
        lost = np.interp(place, place[rows], ~found) > 0.0
        rows, ratio = rows[found], ratio[found]
        joined = hermite(place[rows], ratio, monotone_slopes(place[rows], ratio), place)
        exact = np.where(matters & ~lost, averaged * np.exp(joined), np.inf)
    return np.stack([speed, exact])


def _heavily_damped_curve(grazing: Grazing, span: FoldRange) -> FloatArray:
    """Of a law in pieces beyond critical damping: over the load, unknown where it jumps."""
    x = np.linspace(math.log(span.onset), math.log(span.top), _CONTACTS)
    fold = _by_contact(grazing.bearing, np.exp(x))
    with np.errstate(all='ignore'):
        jumps = np.flatnonzero(np.abs(np.diff(np.log(fold))) > _JUMPS)
    fold[jumps] = np.nan
    return np.stack([x, fold])


def _chebyshev_series(values: FloatArray) -> FloatArray:
    """The coefficients of values at Chebyshev's ascending points, shape (n + 1,)."""
    n = values.size - 1
    weights = np.ones(n + 1)
    weights[[0, -1]] = 0.5
    # Not by a solver of linear equations: its threads take more than all else.
    grid = np.outer(np.arange(n + 1), np.arange(n + 1)) * (np.pi / n)
    series: FloatArray = 2.0 / n * (np.cos(grid) @ (weights * values[::-1]))
    series[[0, -1]] *= 0.5
    return series


def last_speeds(curve: FloatArray, load: FloatArray, smooth: bool) -> FloatArray:
    """The last speeds at which a load is enough for a cycle.

    Args:
        curve: Ascending speeds [m/s], and the load from which there is a cycle at each, or ``inf`` [N],
            shape (2, m).
        load: Shape (n,) [N].
        smooth: Whether a spline joins the curve, or monotone cubics.

    Returns:
        ``nan`` where no speed has a cycle; beyond the curve in proportion to the load, shape (n,)
        [m/s].
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
        slope = _slopes(x, y, smooth)
        h, rise, part = x[i + 1] - x[i], y[i + 1] - y[i], level[rows] - y[i]
        cubic = (part, rise, h * slope[i], h * slope[i + 1])
        share = root_on_bracket(_missing, np.zeros(i.size), np.ones(i.size), (part, part - rise), cubic)
    result[rows] = np.exp(x[i] + share * h)
    return result


def _slopes(x: FloatArray, y: FloatArray, smooth: bool) -> FloatArray:
    """The slopes of a curve at its points, of stretches that are finite."""
    slope = np.zeros(x.size)
    join = spline_slopes if smooth else monotone_slopes
    edges = [0, *(np.flatnonzero(np.diff(np.isfinite(y).astype(int))) + 1), x.size]
    for first, last in itertools.pairwise(edges):
        if last - first > 3 and np.isfinite(y[first]):
            part = slice(int(first), int(last))
            slope[part] = join(x[part], y[part])
    return slope


def _missing(
    t: FloatArray, part: FloatArray, rise: FloatArray, begin: FloatArray, end: FloatArray
) -> FloatArray:
    """What a cubic on [0, 1] with a rise and two slopes still is below a level."""
    square, cube = 3.0 * rise - 2.0 * begin - end, begin + end - 2.0 * rise
    return part - t * (begin + t * (square + t * cube))
