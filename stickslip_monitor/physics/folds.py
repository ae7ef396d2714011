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

from stickslip_monitor.arrays import BoolArray, FloatArray, IndexArray
from stickslip_monitor.physics import averaging, closed_form
from stickslip_monitor.physics.averaging_by_scan import peak_curve, slope_surface
from stickslip_monitor.physics.bearing import Bearing
from stickslip_monitor.physics.friction import Stribeck, computes_as
from stickslip_monitor.physics.hermite import hermite_cubics, monotone_slopes, spline_slopes
from stickslip_monitor.physics.orbits import (
    EXHAUSTED,
    LANDED,
    TURNED,
    Route,
    SlipField,
    follow,
    law_in_use,
    slip_field,
)
from stickslip_monitor.physics.roots import root_on_bracket
from stickslip_monitor.physics.scalar_law import ALMOST_REST

# Rounds of a search, those without a value after which it is given up, and its widest step.
_MOST_ROUNDS, _PATIENCE, _WIDEST = 25, 6, 0.7
# Orbits that turn take 640 steps at most, measured up to 0.9 of critical damping. What is found by
# contact alone is known to 1e-6.
_MOST_STEPS, _HALVINGS = 800, 23
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
# Octaves of a lining beyond critical damping: a mistake of units as a rule, and each takes a second.
_OVERDAMPED = 2
# Speeds of the scan for the onset; intervals of Chebyshev's speeds at first and at most; speeds
# that are read from their series; of a law in pieces speeds of the curve, and of which each
# so-many-th is solved.
_SCAN, _FEWEST, _MOST, _READ, _BROKEN, _EVERY = 161, 32, 128, 1200, 1024, 8
# Share of the onset's speed by averaging at which the exact one is looked for: it lies at 0.6 to 1.
_BELOW_ONSET = 0.5
# Loads beyond the curve's that are solved one by one.
_LARGER = 17
# Last coefficients of a series that is long enough, and errors in ln N.
_SHORT, _CLOSE, _CLOSE_IN_PIECES = 1e-9, 1e-9, 1e-6
# Loads in units of the least at any higher speed, up to which a speed can be the last.
_MATTERS = 1.5
# Error of a step where the margin is to be known to all digits that matter.
_FINE = 1e-11
# Exponent of the attraction after which nothing is left of where an orbit began.
_ENOUGH = 40.0
_LARGEST_EXPONENT = 700.0
# How fast ln N has to rise with ln V for a fold read from the curve to be improved by orbits.
_RISES = 0.02


class Grazing:
    """Where the slip phase of a bearing grazes the belt."""

    def __init__(self, bearing: Bearing) -> None:
        self.bearing, self.law = bearing, bearing.friction
        # What a turn of the free vibration takes of the logarithm of its amplitude.
        self.rate = 2.0 * math.pi * max(bearing.damping_ratio, 1e-12)
        top = float(self.law.coefficient(ALMOST_REST))
        self.lasting = self.lasting_speed(law_in_use(self.law).hold - top, 0.0)
        self.in_pieces = len(law_in_use(self.law).kinks) > 0
        # Of a step: the margin has to be known to a share of the change that it makes. A law in
        # pieces is known to no more than so many digits between them.
        self.error = min(max(1e-10 * self.rate, 1e-13), _FINE)
        self.rough = min(max(1e-7 * self.rate, 1e-10), 1e-8) if self.in_pieces else self.error

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
        place, z = self._grazes(both.take(slice(n, None)))
        nothing = np.zeros(n)
        e, z = np.concatenate([nothing, place]), np.concatenate([nothing, z])
        last, direction = np.repeat([2, 1], n), np.repeat([1.0, -1.0], n)
        with np.errstate(all='ignore'):
            orbits = follow(both, e, z, Route(last, error, direction, most=_MOST_STEPS))
            size = both.rest() - orbits.place
            result = np.log(size[:n] / size[n:])
        turned = orbits.end == TURNED
        result[~turned[n:]] = np.where(orbits.end[n:] == EXHAUSTED, np.inf, -np.inf)[~turned[n:]]
        result[~turned[:n] | np.isnan(result)] = -np.inf
        return result

    def _grazes(self, field: SlipField) -> tuple[FloatArray, FloatArray]:
        """Displacement and ``z`` from which orbits that graze are followed back in time.

        Where a law is steep they lie on a slow manifold, which attracts all neighbours by ``exp``
        of the integral of the growth rate: what comes after enough of that need not be followed.
        """
        v, fall, squares = self._falls
        growth = field.force * field.speed
        least = (1.0 + field.damping) / growth
        end = np.argmax(fall[None, :] < least[:, None], axis=1)
        strength = field.force * growth
        to = squares[end] - _ENOUGH / strength
        start = np.where(to * strength > 0.5 * _ENOUGH, np.interp(to, squares, v), 0.0)
        steep = growth * -np.asarray(self.law.slope(np.maximum(start, ALMOST_REST)))
        start = np.where(steep > 3.0 * (1.0 + field.damping), start, 0.0)
        z = start / field.speed
        drop = field.force * field.drop(field.origin, field.top, start)
        place = (z - 1.0) / (steep - field.damping) - field.offset + field.damping * z - drop
        return np.where(start > 0.0, place, -field.offset), z

    @cached_property
    def _falls(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Speeds, the fall of friction there, and the integral of its square up to there."""
        breaks = _scales(self.bearing)
        v = np.concatenate([[0.0], np.geomspace(1e-4 * breaks[0], 100.0 * breaks[-1], 600)])
        fall = -np.asarray(self.law.slope(np.maximum(v, ALMOST_REST)))
        fall[-1] = -np.inf
        squares = np.maximum(fall, 0.0) ** 2
        parts = 0.5 * (squares[1:] + squares[:-1]) * np.diff(v)
        return v, fall, np.concatenate([[0.0], np.cumsum(parts)])

    def by_averaging(self, speed: FloatArray) -> FloatArray:
        """The least load with a cycle that reaches the belt, by averaging; ``inf`` for none [N].

        Averaging sees no cycle of a law that falls at once, which a turn of the free vibration
        tells.
        """
        if computes_as(self.law, Stribeck):
            fall = closed_form.peak_slope(self.law, speed)
        else:
            fall = slope_surface(self.law, np.ones_like(speed), speed)
        with np.errstate(all='ignore'):
            per_load = np.maximum(fall, 0.0) / self.bearing.damping + self.lasting / speed
            return np.asarray(1.0 / per_load)

    def loads(self, speed: FloatArray, guess: FloatArray, close: float) -> FloatArray:
        """The loads that graze at speeds [N], from guesses, to an error in ``ln N``; ``nan``: not found."""

        def margin(x: FloatArray, rows: IndexArray) -> FloatArray:
            return self.margin(speed[rows], np.exp(x), self.rough)

        return np.exp(_solved(margin, np.log(guess), np.full(guess.size, self.rate), close))

    def speeds(
        self, load: FloatArray, guess: FloatArray, close: float, error: float | None = None
    ) -> FloatArray:
        """The speeds that graze at loads [m/s], from guesses, to an error in ``ln V``.

        ``nan`` where they are not found; ``error`` is that of a step, by default for all digits.
        """
        fine = error or self.error
        with np.errstate(all='ignore'):
            ratio = self.by_averaging(guess * 1.001) / self.by_averaging(guess)
            rise = np.log(ratio) / math.log(1.001)
        rate = -self.rate * np.where(rise > 1e-9, np.minimum(rise, 10.0), 1.0)

        def margin(x: FloatArray, rows: IndexArray) -> FloatArray:
            return self.margin(np.exp(x), load[rows], fine)

        return np.exp(_solved(margin, np.log(guess), rate, close))


def _scales(bearing: Bearing) -> list[float]:
    """The speeds at which a law changes; 1 m/s for one that is the same at all [m/s]."""
    return [v for v in bearing.friction.breakpoints if v > 0.0] or [1.0]


def _solved(
    margin: Callable[[FloatArray, IndexArray], FloatArray], guess: FloatArray, rate: FloatArray, close: float
) -> FloatArray:
    """Where margins vanish, from guesses: secants within brackets, all at once.

    Args:
        margin: Of places and their indices; may be infinite.
        guess: Shape (n,).
        rate: About the slope of the margins, all of one sign, shape (n,).
        close: How well a place is to be known.

    Returns:
        The places, ``nan`` where they were not found, shape (n,).
    """
    x, slope, n = guess.copy(), rate.copy(), guess.size
    sign = 1.0 if n == 0 or rate[0] > 0.0 else -1.0
    low, high, before, value_before = np.multiply.outer([-np.inf, np.inf, np.nan, np.nan], np.ones(n))
    live, misses = np.arange(n), np.zeros(n, int)
    for _ in range(_MOST_ROUNDS if n else 0):
        at = x[live]
        value = margin(at, live)
        known, above = np.isfinite(value), sign * value > 0.0
        high[live] = np.where(above, np.minimum(high[live], at), high[live])
        low[live] = np.where(above, low[live], np.maximum(low[live], at))
        with np.errstate(all='ignore'):
            secant = (value - value_before[live]) / (at - before[live])
            slope[live] = np.where(np.isfinite(secant) & (secant / rate[live] > 0.2), secant, slope[live])
            move = np.where(known, -value / slope[live], np.where(above, -0.4, 0.4))
            move = np.clip(move, -_WIDEST, _WIDEST)
            new, both = at + move, np.isfinite(low[live]) & np.isfinite(high[live])
            halved = both & ((new <= low[live]) | (new >= high[live]))
            new = np.where(halved, 0.5 * (low[live] + high[live]), new)
            width = high[live] - low[live]
        last = np.abs(at - before[live])
        before[live], value_before[live], x[live] = at, value, new
        # A secant leaves about the product of its step with the one before.
        left = np.abs(move) * np.where(last < 1.0, last, 1.0)
        done = known & ~halved & ((left < close) | (value == 0.0)) | (both & known & (width < close))
        misses[live] += ~known
        lost = ~done & (misses[live] > _PATIENCE)
        x[live[lost]] = np.nan
        live = live[~done & ~lost]
        if not live.size:
            break
    x[live] = np.nan
    return x


def exact_fold(bearing: Bearing, load: FloatArray) -> FloatArray:
    """The last speed at which the lining sticks [m/s].

    Args:
        bearing: The bearing.
        load: ``N`` > 0 and finite [N], shape (n,).

    Returns:
        ``nan`` where it sticks at no speed, or damping so strong that the motion does not turn left
        the last one unknown; ``inf`` where it sticks at every high speed; shape (n,).
    """
    law = bearing.friction
    loads, back = np.unique(load, return_inverse=True)
    out = np.full(loads.size, np.nan)
    # Without a gain at any speed the flow contracts everywhere (Bendixson's criterion).
    falls = loads * law_in_use(law).fall > bearing.damping
    if bearing.damping == 0.0:  # whatever gains energy gains it at every load
        out[falls & (np.asarray(averaging.fold_speed(bearing, loads)) == np.inf)] = np.inf
    rows = np.flatnonzero(falls & ~(out == np.inf))
    if rows.size:
        solve = _read if law_in_use(law).kinks else _solve
        out[rows] = solve(bearing, loads[rows])
    return out[back]


def _solve(bearing: Bearing, load: FloatArray) -> FloatArray:
    """The exact folds of a smooth law, which has cycles up to one speed."""
    grazing, law = Grazing(bearing), bearing.friction
    far = 4.0 * _scales(bearing)[-1]
    steady, rise = float(law.coefficient(far)), max(float(law.slope(far)), 0.0)
    drop = max(law_in_use(law).hold - (steady - rise * far), 0.0)
    with np.errstate(all='ignore'):
        averaged = np.asarray(averaging.fold_speed(bearing, load))
        coulomb = load * grazing.lasting_speed(drop, 0.5 * rise * load / bearing.momentum)
        guess = np.fmax(averaged, coulomb)
        slight = load * law_in_use(law).fall < _WEAKLY * bearing.damping
        slight |= drop * load / bearing.momentum < _SLIGHT * averaged
    out = np.where(slight, averaged, np.nan)
    rows = np.flatnonzero(~slight & (guess > 0.0) & (guess < np.inf))
    out[rows] = grazing.speeds(load[rows], guess[rows], 1e-10)
    lost = rows[np.isnan(out[rows])]
    out[lost] = _by_contact(bearing, load[lost], guess[lost])
    return out


def _by_contact(bearing: Bearing, load: FloatArray, guess: FloatArray) -> FloatArray:
    """The last speeds at which slip meets the belt, by bisection [m/s]; ``nan``: none about a guess.

    For where a motion is damped so much that it does not turn twice.
    """

    def meets(speed: FloatArray, rows: IndexArray) -> BoolArray:
        field, nothing = slip_field(bearing, speed, load[rows]), np.zeros(rows.size)
        with np.errstate(all='ignore'):
            end = follow(field, nothing, nothing, route).end
        known[rows] &= end != EXHAUSTED
        return np.asarray(end == LANDED)

    route, known = Route(3, _FINE, contact=True, most=_MOST_STEPS), np.ones(load.size, bool)
    low, high, every = guess * 0.01, guess * 2.0, np.arange(load.size)
    known &= meets(low, every) & ~meets(high, every)
    rows = np.flatnonzero(known)
    for _ in range(_HALVINGS if rows.size else 0):
        middle = np.sqrt(low[rows] * high[rows])
        inside = meets(middle, rows)
        low[rows], high[rows] = np.where(inside, middle, low[rows]), np.where(inside, high[rows], middle)
    return np.where(known, np.sqrt(low * high), np.nan)


def _read(bearing: Bearing, load: FloatArray) -> FloatArray:
    """The exact folds of any law: read from its curve, and improved where that is steep enough."""
    curve = fold_curve(bearing)
    if curve is None:
        return np.full(load.size, np.nan)
    grazing = Grazing(bearing)
    out = curve.exact_fold(load)
    i = np.clip(np.searchsorted(curve.speed, out) - 1, 0, curve.speed.size - 2)
    with np.errstate(all='ignore'):
        rise = np.log(curve.exact[i + 1] / curve.exact[i])
        steep = rise / np.log(curve.speed[i + 1] / curve.speed[i]) > _RISES
    rows = np.flatnonzero(steep & (out > 0.0))
    if rows.size:
        improved = grazing.speeds(load[rows], out[rows], _CLOSE)
        near = np.abs(np.log(improved / out[rows])) < _RISES
        out[rows[near]] = improved[near]
    return out


@dataclass(frozen=True, slots=True, eq=False)
class FoldCurve:
    """The least loads with a cycle over the speed.

    Attributes:
        speed: Ascending, shape (n,) [m/s].
        averaged_speed: The same for ``averaged``, shape (m,) [m/s].
        averaged: Under averaging, ``inf`` for none, shape (m,) [N].
        exact: Where slip grazes the belt, shape (n,) [N].
        onset: The least load with a cycle under averaging [N].
        top: The largest load that it is meant for [N].
        larger: ``ln N`` and exact fold of loads beyond the last, shape (2, m): what rises with the
            speed, or strong damping, makes the fold fall again with the load; ``nan`` for unknown.
        smooth: Whether a spline joins it, or monotone cubics.
    """

    speed: FloatArray
    averaged_speed: FloatArray
    averaged: FloatArray
    exact: FloatArray
    onset: float
    top: float
    larger: FloatArray
    smooth: bool

    def averaged_fold(self, load: FloatArray) -> FloatArray:
        """The last speeds with a cycle under averaging [m/s]; ``nan`` for none, shape (n,)."""
        return last_speeds(self.averaged_speed, self.averaged, load, self.smooth)

    def exact_fold(self, load: FloatArray) -> FloatArray:
        """The last speeds at which the lining sticks [m/s]; ``nan`` for none, shape (n,)."""
        speed = last_speeds(self.speed, self.exact, load, self.smooth)
        x, y = self.larger
        rows = np.flatnonzero(load > self.exact[-1]) if x.size else np.zeros(0, int)
        if rows.size:
            cubics = hermite_cubics(x, y, (spline_slopes if np.isfinite(y).all() else monotone_slopes)(x, y))
            level = np.log(load[rows])
            i = np.clip(np.searchsorted(x, level, side='right') - 1, 0, x.size - 2)
            # Beyond the last it stays where it is.
            speed[rows] = np.polyval(cubics[:, i], np.minimum(level, x[-1]) - x[i])
        return speed


class _Range(NamedTuple):
    """The speeds of a curve, over the place ``ln(1 + V/V0)``.

    Attributes:
        scale: ``V0`` [m/s].
        low: The slowest speed [m/s].
        high: The fastest one with an exact fold [m/s].
        onset: As of :class:`FoldCurve` [N].
        top: As of :class:`FoldCurve` [N].
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


@lru_cache(maxsize=64)
def fold_curve(bearing: Bearing) -> FoldCurve | None:
    """The curve of a bearing with damping; ``None`` where no load has a cycle."""
    grazing = Grazing(bearing)
    span = _range(grazing)
    if span is None:
        return None
    return _curve_in_pieces(grazing, span) if grazing.in_pieces else _smooth_curve(grazing, span)


def _averaged_curve(bearing: Bearing) -> tuple[FloatArray, FloatArray]:
    """Speeds, and the least loads with a cycle under averaging, ``inf`` for none [N]."""
    law, breaks = bearing.friction, _scales(bearing)
    speed = np.geomspace(1e-3 * breaks[0], 300.0 * breaks[-1], _SCAN)
    if computes_as(law, Stribeck):
        peak = closed_form.peak_slope(law, speed)
    elif law.breakpoints:
        speed, peak, *_ = peak_curve(law)
    else:
        peak = np.zeros(speed.size)
    with np.errstate(all='ignore'):
        return speed, np.asarray(bearing.damping / np.maximum(peak, 0.0))


def _range(grazing: Grazing) -> _Range | None:
    """The speeds at which the fold lies of loads from the onset to the largest of use."""
    bearing, law, breaks = grazing.bearing, grazing.law, _scales(grazing.bearing)
    scan, least = _averaged_curve(bearing)
    rows = (scan >= 1e-3 * breaks[0]) & (scan <= 300.0 * breaks[-1])
    scan, least = scan[rows], least[rows]
    near = grazing.by_averaging(scan)
    both = np.fmin(least, near)
    k = int(np.argmin(both))
    onset = float(both[k])
    if not onset < np.inf:
        return None
    octaves = _OCTAVES if bearing.damping_ratio < 1.0 else _OVERDAMPED
    if grazing.lasting == 0.0:
        if k == 0:  # the least at rest
            onset = bearing.damping / float(-law.slope(ALMOST_REST))
        most = min(_LARGE, _GIVES * bearing.stiffness / max(law.static, 1e-9))
        octaves = max(octaves, math.ceil(math.log2(max(most / onset, 1.0))))
    top, low = onset * 2.0**octaves, float(scan[k]) * (_BELOW_ONSET if k else 1.0)
    fall = law_in_use(law).hold - float(np.min(law.coefficient(scan)))
    limit = 1.0 / float(grazing.lasting_speed(max(fall, 1e-300), 0.0))
    below = np.flatnonzero(near <= top)
    high = float(scan[below[-1]]) if below.size else low
    falls_on = bool(np.isfinite(near[-1]))
    if falls_on:
        high = max(high, top / limit)
    if falls_on or not grazing.in_pieces:  # where a table rises again no load reaches further
        last = 1.01 * float(grazing.speeds(np.array([top]), np.array([high]), 1e-3, 1e-8)[0])
        last = last if last > 0.0 else high
    else:
        last = high
    scale = max(breaks[0], breaks[-1] / 50.0) if grazing.in_pieces else breaks[0]
    return _Range(scale, low, max(high, last) if grazing.in_pieces else last, onset, top, limit)


def _first_guess(grazing: Grazing, span: _Range, speed: FloatArray) -> FloatArray:
    """Loads that graze, to some tens of percent [N]."""
    least = grazing.by_averaging(speed)
    far = speed > 10.0 * _scales(grazing.bearing)[0]
    least = np.where(far, np.minimum(least, span.limit * speed), least)
    return np.asarray(np.minimum(least, 1.5 * span.top))


def _smooth_curve(grazing: Grazing, span: _Range) -> FoldCurve:
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
    speeds, averaged, ends = known.places(share), _averaged_curve(grazing.bearing), (span.onset, span.top)
    larger = np.zeros((2, 0))
    if exact[-1] < math.log(span.top):  # beyond critical damping they stay unknown
        x, overdamped = (
            np.linspace(exact[-1], math.log(span.top), _LARGER),
            grazing.bearing.damping_ratio >= 1.0,
        )
        larger = np.stack([x, x * np.nan if overdamped else _solve(grazing.bearing, np.exp(x))])
    return FoldCurve(speeds, *averaged, np.exp(exact), *ends, larger, smooth=True)


def _series(grazing: Grazing, span: _Range, cuts: int = _CUTS) -> tuple[FloatArray, _Range]:
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
            fresh = np.log(grazing.loads(speed[1::2], guess, _CLOSE))
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


def _curve_in_pieces(grazing: Grazing, span: _Range) -> FoldCurve:
    """Of a law in pieces: the ratio to averaging is solved at some speeds and joined."""
    place = np.arange(_BROKEN + 1) / _BROKEN
    speed = span.places(place)
    averaged = np.minimum(grazing.by_averaging(speed), 1e3 * span.top)
    # A speed matters where no higher one has a cycle at less load.
    above = np.minimum.accumulate(averaged[::-1])[::-1]
    matters = averaged <= _MATTERS * above
    rows = np.flatnonzero(matters & (np.arange(speed.size) % _EVERY == 0))
    guess = np.minimum(_first_guess(grazing, span, speed[rows]), averaged[rows])
    ratio = np.log(grazing.loads(speed[rows], guess, _CLOSE_IN_PIECES) / averaged[rows])
    found = np.isfinite(ratio)
    exact = np.full(speed.size, np.inf)
    if np.count_nonzero(found) > 1:
        lost = np.interp(place, place[rows], ~found) > 0.0
        rows, ratio = rows[found], ratio[found]
        cubics = hermite_cubics(place[rows], ratio, monotone_slopes(place[rows], ratio))
        inside = np.clip(place, place[rows[0]], place[rows[-1]])
        i = np.clip(np.searchsorted(place[rows], inside, side='right') - 1, 0, rows.size - 2)
        joined = np.polyval(cubics[:, i], inside - place[rows][i])
        exact = np.where(matters & ~lost, averaged * np.exp(joined), np.inf)
    larger = np.zeros((2, 0))
    return FoldCurve(
        speed, *_averaged_curve(grazing.bearing), exact, span.onset, span.top, larger, smooth=False
    )


def lower_ends(bearing: Bearing, load: FloatArray) -> FloatArray:
    """The lower end of stick-slip by averaging: below this speed no cycle exists.

    It lies where friction first rises with the speed: there slow sliding is stable, and what
    leaves a stick settles to it.

    Args:
        bearing: The bearing, with damping.
        load: ``N`` > 0, shape (n,) [N].

    Returns:
        0 where there are cycles down to rest, or none at any speed, shape (n,) [m/s].
    """
    out = np.zeros(load.size)
    if computes_as(bearing.friction, Stribeck):  # falls most at rest
        return out
    speed, least = _averaged_curve(bearing)
    slow = speed <= _scales(bearing)[-1]
    speed, least = speed[slow], np.minimum.accumulate(least[slow])
    with np.errstate(all='ignore'):
        x, y, level = np.log(speed), np.log(least), np.log(load)
        i = np.searchsorted(-y, -level, side='left')
        rows = np.flatnonzero((i > 0) & (i < speed.size))
        before, after = y[i[rows] - 1], y[i[rows]]
        share = np.where(np.isfinite(before), (before - level[rows]) / (before - after), 1.0)
    out[rows] = np.exp(x[i[rows] - 1] + share * (x[i[rows]] - x[i[rows] - 1]))
    return out


def _chebyshev_series(values: FloatArray) -> FloatArray:
    """The coefficients of values at Chebyshev's ascending points, shape (n + 1,)."""
    n = values.size - 1
    weights = np.ones(n + 1)
    weights[[0, -1]] = 0.5
    grid = np.outer(np.arange(n + 1), np.arange(n + 1)) * (np.pi / n)
    series: FloatArray = 2.0 / n * (np.cos(grid) @ (weights * values[::-1]))
    series[[0, -1]] *= 0.5
    return series


def last_speeds(speed: FloatArray, least: FloatArray, load: FloatArray, smooth: bool) -> FloatArray:
    """The last speeds at which a load is enough for a cycle.

    Args:
        speed: Ascending, shape (m,) [m/s].
        least: The load from which there is a cycle at each, or ``inf``, shape (m,) [N].
        load: Shape (n,) [N].
        smooth: Whether a spline joins the curve, or monotone cubics.

    Returns:
        ``nan`` where no speed has a cycle; beyond the curve in proportion to the load, shape (n,)
        [m/s].
    """
    with np.errstate(all='ignore'):
        x, y, level = np.log(speed), np.log(least), np.log(load)
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
