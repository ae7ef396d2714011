# SPDX-License-Identifier: Apache-2.0
"""The two folds of a bearing, from the least load with a cycle over the speed.

At one load the speeds are scanned from the highest that friction can give downward, until the lining
sticks; a root in that bracket is the fold. For many loads a curve is solved once: over the load a fold
begins with an infinite slope, and that of a measured table jumps from one range of speeds with cycles
to the next, but over the speed the least load is smooth and has one value. It is solved at many speeds
at once, and the last speed at a load is read from that curve. Averaging is neither a guess nor a bound.

The exact fold is where the slip phase only grazes the belt. The orbit from breakaway is followed
to its turning point against the belt, and the orbit that grazes is followed back in time to its
own. The logarithm of the ratio of the two amplitudes, the *margin*, vanishes there and is almost straight in
``ln N``, with the slope ``2 pi zeta``, however steep the law: neither orbit passes through the layer in
which neighbours part. So a few secant steps do.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np

from stickslip_monitor.arrays import FloatArray, IndexArray
from stickslip_monitor.physics import averages_closed_form, averaging
from stickslip_monitor.physics.averages_by_quadrature import average_curve, cusp_slope
from stickslip_monitor.physics.bearing import Bearing
from stickslip_monitor.physics.friction import ALMOST_REST, speed_scales
from stickslip_monitor.physics.numerics import hermite, monotone_slopes, root_on_bracket, spline_slopes
from stickslip_monitor.physics.orbits import (
    EXHAUSTED,
    LANDED,
    RESTED,
    TURNED,
    Route,
    SlipField,
    follow,
    slip_field,
)
from stickslip_monitor.physics.scalar_law import law_bounds

# Error of the long steps that bracket a fold, and how close they lead.
_COARSE, _ROUGHLY = 1e-7, 1e-5
# The error for the curve of a law in pieces, whose kinks make steps short: of a scattered table of 100 points
# 97,000 steps in place of 170,000, with a median error of 8e-5 in place of 3e-5.
_COARSE_IN_PIECES = 1e-6
# Errors of a step where the margin is to be known to all digits that matter.
_FINE, _FINEST = 1e-11, 1e-13
# Error of a curve in ln N.
_CLOSE = 1e-10
# Ratio of neighbouring speeds of a scan of a smooth law.
_SMOOTH_RATIO = 1.06
# Slowest speed of a scan in units of the first scale of a law: below it friction is straight.
_SLOWEST = 1e-3
# How far from its guess a search without a bracket goes, in the logarithm.
_MAX_DISTANCE = 3.0
# Octaves of load of a curve from the onset at least: a steep law has its onset at some newtons, far
# from Coulomb's 8 octaves above it.
_MIN_OCTAVES = 8
# A curve may end at so many times the largest load of use.
_MAX_EXCESS = 8.0
# Share of the steepest fall from which a law falls most at rest: the bound is a rounding above it.
_AS_STEEP = 1.0 - 1e-9


_Margin = Callable[[FloatArray, IndexArray, float], FloatArray]


class Grazing:
    """Grazing of the belt by the slip phase of a bearing, without lubrication.

    Attributes:
        rate: What a turn of the free vibration takes of the logarithm of its amplitude.
        fine: Error of a step, relative to the speeds, for a margin to all digits that matter.
        coarse: Error of a step for a scan.
    """

    def __init__(self, bearing: Bearing) -> None:
        self.bearing, self.law, self.use = bearing, bearing.friction, law_bounds(bearing.friction)
        # The speeds at which the law changes; 1 m/s for one that is the same at all [m/s].
        self.scales = list(speed_scales(self.law)) or [1.0]
        # A damping ratio of 1e-12 stands for none: a vibration loses 1e-11 of its energy in a turn.
        self.rate = 2.0 * math.pi * max(bearing.damping_ratio, 1e-12)
        # A margin is the rate times the excess of the load: its error has to be a share of the rate. With
        # 1e-7 alone the fold at ``kappa`` 0.97 and a damping ratio of 1.5e-6 was 8 % low.
        self.fine = min(max(1e-10 * self.rate, _FINEST), _FINE)
        self.coarse = min(max(1e-4 * self.rate, self.fine), _COARSE)

    def margin(self, speed: FloatArray, load: FloatArray, error: float) -> FloatArray:
        """Return the logarithm of the slip amplitude over the amplitude that grazes the belt.

        Positive where the lining sticks again after its slip, negative where it does not, 0 at the fold.

        Args:
            speed: ``V`` > 0, shape (n,) [m/s].
            load: ``N`` > 0, shape (n,) [N].
            error: Error of a step, relative to the speeds [-].

        Returns:
            Shape (n,); ``-inf`` where slip comes to rest without turning, ``inf`` where the orbit that
            grazes began at rest, or where only contact is decided.
        """
        n = speed.size
        fields = slip_field(self.bearing, np.tile(speed, 2), np.tile(load, 2))
        slip, graze = fields.take(slice(n)), fields.take(slice(n, None))
        e, z = np.zeros((2, 2 * n))
        # Less damping, in units of m omega, does not draw slip to the manifold.
        if np.max(slip.damping + slip.force * slip.speed * self._course[1][-1], initial=0.0) > 6.0:
            e[:n], z[:n] = self._start_on_manifold(slip, ahead=True)
        e[n:], z[n:] = self._start_on_manifold(graze, ahead=False)
        e[n:] = np.where(z[n:] > 0.0, e[n:], -graze.offset)
        last, direction = np.where(z[:n] > 1.0, 1, 2), np.repeat([1.0, -1.0], n)
        # Orbits that turn take 640 steps of 1e-11 at most, measured up to 0.9 of critical damping, by the
        # eighth root of the error 1.8 times as many of 1e-13, and a fourth of those of 1e-7.
        max_steps = 1200 if error <= _FINE else 300
        max_steps += 4 * len(self.use.kinks)  # a kink may take four
        route = Route(np.concatenate([last, np.ones(n, int)]), error, direction, max_steps=max_steps)
        with np.errstate(all='ignore'):
            orbits = follow(fields, e, z, route)
            size = fields.rest() - orbits.place
            result = np.log(size[:n] / size[n:])
        slips, grazes = orbits.end[:n], orbits.end[n:]
        unclear = (slips == EXHAUSTED) | (grazes == EXHAUSTED)
        unclear |= (slips == TURNED) & (grazes == TURNED) & np.isnan(result)
        result[grazes != TURNED] = np.where(grazes == RESTED, np.inf, -np.inf)[grazes != TURNED]
        result[(slips != TURNED) | np.isnan(result)] = -np.inf
        if error != self.fine and unclear.any():
            # Long steps do not see how an orbit comes to rest, and the shortest are too many for some:
            # either would pass for a jump.
            result[unclear] = self.margin(speed[unclear], load[unclear], self.fine)
        elif unclear.any():
            result[unclear] = self._decide_contact(speed[unclear], load[unclear], error)
        return result

    def _start_on_manifold(self, field: SlipField, ahead: bool) -> FloatArray:
        """Return where orbits begin on the slow manifold that attracts them.

        Damping attracts what slips behind the belt; back in time a steep fall of friction attracts what
        grazes. An attraction of ``exp(40)`` leaves nothing of where an orbit began, so the part before it
        need not be followed.

        Args:
            field: What the linings slip in.
            ahead: Whether orbits go forward in time; else back.

        Returns:
            Displacements and relative speeds ``z``, both 0 where nothing attracts that much, shape (2, n).
        """
        v, slope, mu = (column if ahead else column[::-1] for column in self._course)  # outward
        towards, start_of_all = 1.0 if ahead else -1.0, np.zeros((2, field.speed.size))
        steepest = np.max(towards * slope) * field.force * field.speed + towards * field.damping
        min_rate = 3.0  # by which the manifold still draws, in units of omega
        rows = np.flatnonzero(steepest > min_rate)
        if not rows.size:
            return start_of_all
        field, every = field.take(rows), np.arange(rows.size)
        z = v / field.speed[:, None]
        away = towards * (z - 1.0)
        rate = field.damping + (field.force * field.speed)[:, None] * slope
        draws = (towards * rate > min_rate) & (away > 1e-3)
        first = np.argmax(draws, axis=1)
        draws &= np.cumsum(~draws & (np.arange(v.size) > first[:, None]), axis=1) == 0
        drawn = np.where(draws, rate * rate / np.where(draws, away, 1.0), 0.0)
        parts = 0.5 * (drawn[:, 1:] + drawn[:, :-1]) * np.abs(np.diff(z, axis=1))
        start = 1 + np.argmax(np.cumsum(parts, axis=1) > 40.0, axis=1)
        place = field.damping * z - field.force[:, None] * (self.use.hold - mu)
        # What comes from outside must come past it, and slide no faster into another such stretch.
        lowest = np.minimum.accumulate(place[:, ::-1], axis=1)[:, ::-1][every, start]
        is_drawn = (start > 1) & (place[every, start] <= np.minimum(lowest, 0.0))
        if not ahead:
            # Back in time what grazes sinks while it crosses to the stretch, and is caught only if it gets
            # there before it has sunk past it. Crossing at half the stretch's depth it may sink by that half.
            half_depth = 0.5 * (place[every, start] - place[every, first])
            crossing = np.maximum(place - (place[every, start] - half_depth)[:, None], 0.0)
            sinking = np.where(np.arange(v.size) >= start[:, None], np.maximum(away, 0.0), 0.0)
            with np.errstate(all='ignore'):
                sunk = np.sum(
                    (sinking / crossing)[:, 1:] * np.abs(np.diff(z, axis=1)),
                    axis=1,
                    where=sinking[:, 1:] > 0.0,
                )
            is_drawn &= sunk < half_depth
        start_of_all[:, rows] = np.where(is_drawn, [place[every, start], z[every, start]], 0.0)
        return start_of_all

    @cached_property
    def _course(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Rising speeds [m/s], and slope [s/m] and coefficient [-] of friction there, shape (700,) each."""
        v = np.geomspace(1e-4 * self.scales[0], 1e3 * self.scales[-1], 700)
        return v, np.asarray(self.law.slope(v)), np.asarray(self.law.coefficient(v))

    @cached_property
    def drop(self) -> float:
        """Largest fall of the coefficient of friction."""
        lowest = min(np.min(self._course[2]), np.min(self.law.coefficient(self.scales)))
        return self.use.hold - float(lowest)

    @cached_property
    def falls_most_at_rest(self) -> bool:
        """Whether a smooth law falls most at rest: there averaging has the fold near its onset."""
        return not self.use.kinks and not -float(self.law.slope(ALMOST_REST)) < self.use.fall * _AS_STEEP

    @cached_property
    def rises(self) -> bool:
        """Whether friction rises beyond the last speed of its scale: large loads stick less then."""
        return float(self.law.slope(4.0 * self.scales[-1])) > 0.0

    @cached_property
    def ends_low(self) -> bool:
        """Whether friction has fallen by more than nine tenths of its fall at the last speed of its scale."""
        return self.use.hold - float(self.law.coefficient(self.scales[-1])) > 0.9 * self.drop

    @cached_property
    def _friction_gains(self) -> tuple[FloatArray, FloatArray]:
        """Speeds ``V`` [m/s], and the largest friction below the next one less the least above each [-].

        The second is what friction can feed a vibration with between a speed and the next; shape (m,) each.
        """
        v, _, mu = self._course
        order = np.argsort(np.append(v, self.scales), kind='stable')
        v = np.append(v, self.scales)[order]
        mu = np.append(mu, self.law.coefficient(self.scales))[order]
        below = np.maximum.accumulate(np.maximum(mu, self.use.hold))
        above = np.minimum.accumulate(mu[::-1])[::-1]
        return v, np.append(below[1:], below[-1]) - above

    @cached_property
    def _max_swing(self) -> float:
        """Upper bound of a vibration's speed for each newton of load and unit of friction gain [m/(s N)].

        Friction feeds a vibration most if it is highest wherever the lining moves with the belt and
        lowest wherever it moves against it. The lining then swings by ``N gain/(2 k) coth(pi zeta'/2)``
        to both sides, ``exp(-pi zeta')`` being left of the free one after half a turn.
        """
        # Without damping rising friction ends vibrations before a damping ratio of 1e-4 would.
        zeta = self.bearing.damping_ratio or 1e-4
        half_turn = math.pi * zeta / math.sqrt(1.0 - zeta * zeta) if zeta < 1.0 else math.inf
        return 0.5 / (self.bearing.momentum * math.tanh(0.5 * half_turn))

    def highest_speeds(self, load: FloatArray) -> FloatArray:
        """Return upper bounds of the speeds at which the lining can stick, whatever the law [m/s].

        Args:
            load: ``N`` > 0, shape (n,) [N].

        Returns:
            Shape (n,); 0 where friction gains nothing.
        """
        v, gains = self._friction_gains
        swing = self._max_swing * load[:, None] * gains
        last = v.size - 1 - np.argmax((swing >= v)[:, ::-1], axis=1)
        top = swing[np.arange(load.size), last]
        return np.where(last < v.size - 1, np.minimum(top, v[np.minimum(last + 1, v.size - 1)]), top)

    def least_loads(self, speed: FloatArray) -> FloatArray:
        """Return lower bounds of the loads at which the lining can stick [N].

        Args:
            speed: ``V`` > 0, shape (n,) [m/s].

        Returns:
            Shape (n,); ``inf`` where friction falls nowhere about a speed.
        """
        v, gains = self._friction_gains
        gain = gains[np.clip(np.searchsorted(v, speed, side='right') - 1, 0, v.size - 1)]
        with np.errstate(divide='ignore'):
            return np.maximum(speed / (self._max_swing * gain), self.bearing.damping / self.use.fall)

    def sticking_margin(self, speed: FloatArray, load: FloatArray, error: float) -> FloatArray:
        """Return :meth:`margin`, or ``inf`` for sticking and ``-inf`` for none where no margin is defined.

        No margin is defined for a law in pieces beyond critical damping: an orbit may leave the manifold at a
        kink, so it is only followed up to its contact with the belt. Arguments are those of :meth:`margin`.
        """
        if self.bearing.damping_ratio < 1.0 or not self.use.kinks:
            return self.margin(speed, load, error)
        return self._decide_contact(speed, load, error)

    def _decide_contact(self, speed: FloatArray, load: FloatArray, error: float) -> FloatArray:
        """Return ``inf`` where slip from breakaway meets the belt again, else ``-inf``, shape (n,).

        Arguments are those of :meth:`margin`.
        """
        # Linings damped beyond 0.5 under 60 times the load of their onset, on scattered tables, leave 7 of 13
        # such orbits undecided after 4,000 steps, 1 after these.
        route, begin = Route(3, error, contact=True, max_steps=20_000), np.zeros(speed.size)
        with np.errstate(all='ignore'):
            end = follow(slip_field(self.bearing, speed, load), begin, begin, route).end
        return np.where(end == LANDED, np.inf, -np.inf)

    def bracket_last_speeds(
        self, load: FloatArray, ratio: float, error: float = _COARSE
    ) -> tuple[FloatArray, FloatArray]:
        """Bracket the last speed at which the lining sticks, by a scan from the highest possible one down.

        Args:
            load: ``N`` > 0, shape (n,) [N].
            ratio: Ratio of neighbouring speeds of the scan; larger where more than 1000 speeds would be
                needed.
            error: Error of a step of the orbits, relative to the speeds, at most [-].

        Returns:
            The highest speed of the scan at which the lining sticks and the next higher one, at which it does
            not [m/s]; both ``nan`` where it sticks at none; each of shape (n,).
        """
        error = min(error, self.coarse)
        low, high = np.full((2, load.size), np.nan)
        with np.errstate(over='ignore'):
            # The squares of larger speeds, and of their orbits, would be no numbers.
            live, top = np.arange(load.size), np.minimum(self.highest_speeds(load), 1e140)
        slowest = np.minimum(_SLOWEST * self.scales[0], _SLOWEST * top)
        live = live[top > 0.0]
        with np.errstate(divide='ignore', invalid='ignore'):
            ratios = np.fmax(ratio, np.exp((np.log(top) - np.log(slowest)) / 1000))
        steps = -np.arange(-1.0, 13.0)  # twelve speeds at a time
        while live.size:
            speed = top[live, None] * ratios[live, None] ** steps
            inner = speed[:, 1:]
            excess = self.sticking_margin(inner.ravel(), np.repeat(load[live], inner.shape[1]), error)
            excess = excess.reshape(inner.shape)
            sticks = excess > 0.0
            peak = self._find_narrow_ranges(load[live], inner, excess)
            for k in np.flatnonzero(sticks.any(axis=1) | np.isfinite(peak)):
                first = int(np.argmax(sticks[k])) if sticks[k].any() else inner.shape[1] - 1
                beside = inner[k, first] if sticks[k].any() else 0.0
                low[live[k]] = max(np.nan_to_num(peak[k]), beside)
                is_peak = low[live[k]] > beside
                next_one = low[live[k]] * ratios[live[k]] ** (2.0 / 16)  # of the speeds tried closer together
                high[live[k]] = next_one if is_peak else speed[k, first]
            top[live] = inner[:, -1]
            live = live[np.isnan(low[live]) & (top[live] > slowest[live])]
        return low, high

    def _find_narrow_ranges(self, load: FloatArray, speed: FloatArray, excess: FloatArray) -> FloatArray:
        """Return the highest sticking speed that lies between those of a scan [m/s].

        A range of speeds narrower than a step of the scan shows in margins that rise towards it on both
        sides by more than what is missing to 0. Speeds there are tried 8 times as close together.

        Args:
            load: Shape (n,) [N].
            speed: Speeds of the scan, falling, shape (n, m) [m/s].
            excess: :meth:`sticking_margin` there, shape (n, m).

        Returns:
            Shape (n,); ``nan`` where there is no such range.
        """
        left, middle, right = excess[:, :-2], excess[:, 1:-1], excess[:, 2:]
        with np.errstate(invalid='ignore'):
            near = (middle < 0.0) & (middle >= left) & (middle >= right)
            near &= -middle < np.maximum(middle - left, middle - right)
        out = np.full(load.size, np.nan)
        row, column = np.nonzero(near)
        if row.size:
            share = np.linspace(0.0, 1.0, 17)[1:-1]  # of two steps of the scan
            begin, end = speed[row, column + 2], speed[row, column]
            closer = begin[:, None] * (end / begin)[:, None] ** share
            sticks = self.sticking_margin(closer.ravel(), np.repeat(load[row], share.size), self.coarse) > 0.0
            places = np.where(sticks.reshape(closer.shape), closer, np.nan)
            for k, place in zip(row, np.fmax.reduce(places, axis=1), strict=True):
                out[k] = np.fmax(out[k], place)
        return out

    def loads(
        self,
        speed: FloatArray,
        close: float,
        max_load: float,
        guess: FloatArray | None = None,
        slope_error: float = 1.0,
    ) -> FloatArray:
        """Return the least loads at which slip grazes the belt at speeds [N].

        The search goes upward from the least load at which the lining can stick at all.

        Args:
            speed: ``V`` > 0, shape (n,) [m/s].
            close: Error allowed in ``ln N``.
            max_load: Where the search ends [N].
            guess: Loads to begin at, ``inf`` for unknown, shape (n,) [N].
            slope_error: How well, as a share, the slope of the margins is known.

        Returns:
            Shape (n,); ``nan`` where no load up to ``max_load`` grazes.
        """
        n = speed.size
        with np.errstate(divide='ignore'):
            log_least = np.log(self.least_loads(speed))
        log_least[log_least == np.inf] = np.nan  # friction falls nowhere about such a speed
        begin = log_least
        if guess is not None:
            near = np.log(guess)
            begin = np.where(np.isfinite(near) & np.isfinite(log_least), np.fmax(near, log_least), log_least)
        search = _Search(begin, np.full(n, self.rate), log_least, np.full(n, np.inf), math.log(max_load))
        coarse = _COARSE_IN_PIECES if self.use.kinks else _COARSE
        return self._find_zeros(
            search,
            lambda x, rows, error: self.margin(speed[rows], np.exp(x), error),
            close,
            coarse=coarse,
            slope_error=slope_error,
        )

    def loads_from(self, speed: FloatArray, guess: FloatArray, close: float) -> FloatArray:
        """Return the loads that graze at speeds [N], from guesses that are right to 1e-3.

        Args:
            speed: ``V`` > 0, shape (n,) [m/s].
            guess: Loads to begin at, shape (n,) [N].
            close: Error allowed in ``ln N``.

        Returns:
            Shape (n,); ``nan`` where the search does not end.
        """
        x, n = np.log(guess), speed.size
        endless, log_max = np.full(n, np.inf), float(np.max(x, initial=0.0)) + _MAX_DISTANCE
        search = _Search(x, np.full(n, self.rate), -endless, endless, log_max)
        return self._find_zeros(
            search, lambda x, rows, error: self.margin(speed[rows], np.exp(x), error), close, near=True
        )

    def speeds(self, load: FloatArray, close: float) -> FloatArray:
        """Return the last speeds at which the lining sticks at loads [m/s].

        Args:
            load: ``N`` > 0, shape (n,) [N].
            close: Error allowed in ``ln V``.

        Returns:
            Shape (n,); ``nan`` where it sticks at none.
        """
        # A law in pieces may stick over 2 % of its last speeds only.
        low, high = self.bracket_last_speeds(load, 1.02 if self.use.kinks else _SMOOTH_RATIO)
        rows = np.flatnonzero(low > 0.0)
        out = np.full(load.size, np.nan)
        x, y, n = np.log(low[rows]), np.log(high[rows]), load[rows]

        def margin(x: FloatArray, which: IndexArray, error: float) -> FloatArray:
            """Return the margins at ``ln V`` of the rows ``which``, by steps of an error or of the finest.

            The finest give a fold to 1e-12, where a curve is read to 1e-9.
            """
            return self.sticking_margin(np.exp(x), n[which], error if error > self.fine else _FINEST)

        every = np.arange(rows.size)
        above, below = (margin(place, every, self.coarse) for place in (x, y))
        with np.errstate(all='ignore'):
            secant = (below - above) / (y - x)
            is_bracketed = np.isfinite(secant) & (above > 0.0) & (below < 0.0)
            guess = np.where(is_bracketed, x - above / secant, 0.5 * (x + y))
        rate = np.where(is_bracketed, secant, -self.rate)
        out[rows] = self._find_zeros(_Search(guess, rate, x, y, math.inf), margin, close)
        return out

    def _find_zeros(
        self,
        search: _Search,
        margin: _Margin,
        close: float,
        near: bool = False,
        coarse: float = _COARSE,
        slope_error: float = 1.0,
    ) -> FloatArray:
        """Return ``exp`` of the places at which margins vanish, shape (n,); ``nan`` for none.

        Args:
            search: Guesses and bounds of the places.
            margin: Function of places (logarithms), their indices and the error of a step, to the margins.
            close: Error allowed in a place.
            near: Whether the guesses are right to 1e-3, so that the search with long steps is skipped.
            coarse: Error of a long step, at most.
            slope_error: How well, as a share, the rates of the search are known.
        """
        coarse = min(max(1e-5 * float(np.min(np.abs(search.rate), initial=1.0)), 1e-10), coarse)
        if not near:
            x, rate = _solve_brackets(lambda x, rows: margin(x, rows, coarse), search, _ROUGHLY, slope_error)
            search = search._replace(guess=x, rate=rate)
        if close < _ROUGHLY:
            # Long steps leave the slopes of margins right to 3 %.
            x, _ = _solve_brackets(lambda x, rows: margin(x, rows, self.fine), search, close, 0.03)
        return np.exp(x)


class _Search(NamedTuple):
    """Guesses and bounds of the places, logarithms of loads or speeds, at which margins vanish.

    Attributes:
        guess: Places to begin at, shape (n,); ``nan`` where there is none.
        rate: Approximate slopes of the margins, all of one sign, shape (n,).
        low: Lower bounds of the places, shape (n,); ``-inf`` without one.
        high: Upper bounds, shape (n,); ``inf`` without one.
        max_place: Largest place of interest.
    """

    guess: FloatArray
    rate: FloatArray
    low: FloatArray
    high: FloatArray
    max_place: float


def _solve_brackets(
    margin: Callable[[FloatArray, IndexArray], FloatArray], search: _Search, close: float, slope_error: float
) -> tuple[FloatArray, FloatArray]:
    """Return the places where margins vanish: secants within brackets, all at once.

    Args:
        margin: Function of places and their indices to the margins, which may be infinite.
        search: Guesses and bounds of the places.
        close: Error allowed in a place.
        slope_error: Relative error of the slopes in ``search``.

    Returns:
        The places, ``nan`` where they were not found, and the slopes there, ``inf`` where margins jump,
        each of shape (n,).
    """
    guess, rate = search.guess, search.rate
    x, slope, n = guess.copy(), rate.copy(), guess.size
    sign = 1.0 if n == 0 or rate[0] > 0.0 else -1.0
    low, high, before, value_before = search.low.copy(), search.high.copy(), *np.full((2, n), np.nan)
    live, last = np.flatnonzero(np.isfinite(x) & np.isfinite(slope)), np.full(n, slope_error)
    for _ in range(40):  # secants in brackets end within 12 rounds, halvings of a bracket within 25
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
            move = np.where(finite, -value / slope[live], np.where(above, -0.4, 0.4))
            move = np.clip(move, -0.7, 0.7)
            new, width = at + move, high[live] - low[live]
            is_bracketed = np.isfinite(width)
            halved = is_bracketed & ((new <= low[live]) | (new >= high[live]))
            new = np.where(halved, 0.5 * (low[live] + high[live]), new)
        # A secant leaves about the product of its step with the one before.
        left = np.abs(move) * last[live]
        done = finite & ~halved & ((left < close) | (value == 0.0)) | (is_bracketed & (width < close))
        # A table that scatters, of 100 points: nine loads take 1.8 s with this end, 2.7 s without.
        jumps = is_bracketed & ~finite & (width < _ROUGHLY)
        slope[live[jumps]] = np.inf
        before[live], value_before[live], x[live] = at, value, new
        last[live] = np.minimum(np.abs(move), 1.0)
        far = ~is_bracketed & ((new > search.max_place) | (new < guess[live] - _MAX_DISTANCE))
        x[live[far]] = np.nan
        live = live[~done & ~far & ~jumps]
    x[live] = np.nan
    return x, slope


def deciding_fold(bearing: Bearing, load: FloatArray, exact: FloatArray, averaged: FloatArray) -> FloatArray:
    """Return the fold that decides [m/s]: the last speeds at which the lining sticks, or vibrates without.

    Args:
        bearing: The bearing.
        load: ``N``, shape (n,) [N].
        exact: The last speeds at which it sticks there, ``nan`` for none, shape (n,) [m/s].
        averaged: The averaged folds there, ``nan`` for none, shape (n,) [m/s].

    Returns:
        Shape (n,); the averaged fold where the lining sticks at no speed.
    """
    return last_cycles(exact, averaged, np.asarray(averaging.sticking_end(bearing, load)))


def last_cycles(exact: FloatArray, averaged: FloatArray, sticking_end: FloatArray) -> FloatArray:
    """Return :func:`deciding_fold` from the ends of sticking and of cycles, each of shape (n,) [m/s].

    Where the averaged slope is highest below the sliding limit, a cycle lives on without sticking, up to the
    averaged fold. Close to the end of sticking it does by the same share as under averaging, whose errors
    in both ends are about the same. Ends 2 % apart are those of different cycles: there averaging has the end
    of the vibration (of 424 loads of random tables within 3 % at 407, above at 15).

    Args:
        exact: The last speeds at which the lining sticks, ``nan`` for none.
        averaged: The averaged folds, ``nan`` for none.
        sticking_end: The last speeds at which it sticks under averaging, ``nan`` for none.
    """
    with np.errstate(all='ignore'):
        factor = np.fmax(averaged / sticking_end, 1.0)
        factor = np.where(factor > 1.02, np.fmax(averaged / exact, 1.0), factor)
    return np.where(np.isnan(exact), averaged, exact * factor)


def exact_fold(bearing: Bearing, load: FloatArray) -> FloatArray:
    """Return the last speed at which the lining sticks [m/s].

    Args:
        bearing: The bearing.
        load: ``N`` > 0 and finite [N], shape (n,).

    Returns:
        ``nan`` where it sticks at no speed; ``inf`` where it sticks at every high speed; shape (n,).
    """
    use = law_bounds(bearing.friction)
    loads, back = np.unique(load, return_inverse=True)
    out = np.full(loads.size, np.nan)
    # Without a gain at any speed the flow contracts everywhere (Bendixson's criterion).
    falls = loads * use.fall > bearing.damping
    if bearing.damping == 0.0:  # whatever gains energy gains it at every load
        endless = np.asarray(averaging.fold_speed(bearing, loads)) == np.inf
        out[falls & (endless | (not speed_scales(bearing.friction)))] = np.inf
    rows = np.flatnonzero(falls & ~(out == np.inf))
    if rows.size:
        out[rows] = _last_speeds(bearing, loads[rows])
    return out[back]


def _last_speeds(bearing: Bearing, load: FloatArray) -> FloatArray:
    """Return the last speeds at which the lining sticks, of a bearing with damping > 0 [m/s].

    The averaged fold where it is exact to 1e-10 (loads barely above the onset, slight forces), else solved.

    Returns:
        Shape of ``load``; ``nan`` where it sticks at none.
    """
    grazing, out = Grazing(bearing), np.full(load.size, np.nan)
    slight = np.zeros(load.size, bool)
    if grazing.falls_most_at_rest:
        averaged = np.asarray(averaging.fold_speed(bearing, load))
        # Orbits gain too little there to improve it.
        slight = load * grazing.use.fall < 1.003 * bearing.damping
        gain = grazing.rate * (load * grazing.use.fall / bearing.damping - 1.0)
        with np.errstate(all='ignore'):
            # Orbits have ``ln V`` to the rounding of a margin over the gain of a turn. Averaging, right to
            # the square of the force, is better where that is less. Measured for ``kappa`` 0.001 to 0.99:
            # 3e-15 of rounding; errors of averaging of up to 0.06 of the square, 1.0 for 0.001.
            force = grazing.drop * load / (bearing.momentum * averaged)
            slight |= force * force * gain < 1e-14
        out[slight] = averaged[slight]
    out[~slight] = grazing.speeds(load[~slight], _CLOSE)
    return out


class FoldRange(NamedTuple):
    """The loads that a curve is made for, and its speeds, over the place ``ln(1 + V/V0)``.

    Attributes:
        scale: ``V0`` [m/s].
        low: The slowest speed [m/s].
        high: The fastest one with an exact fold [m/s].
        onset: The least load with a cycle under averaging [N].
        top: The largest load [N].
        rough: Speeds and the least loads that graze there, ``inf`` for none, shape (2, m).
    """

    scale: float
    low: float
    high: float
    onset: float
    top: float
    rough: FloatArray

    def places(self, share: FloatArray) -> FloatArray:
        """Return the speeds at shares of the way from the slowest to the fastest, of their shape [m/s]."""
        begin, end = math.log1p(self.low / self.scale), math.log1p(self.high / self.scale)
        return self.scale * np.expm1(begin + (end - begin) * share)


_NOTHING = np.zeros((2, 0))


@dataclass(frozen=True, slots=True, eq=False)
class FoldCurve:
    """The least loads with a cycle over the speed.

    Attributes:
        grazing: The bearing, with the grazing of its belt.
        span: The loads and speeds that the curve is made for.
        averaged: Ascending speeds [m/s], and under averaging the least loads with a cycle, and with one that
            sticks [N], ``inf`` for none, shape (3, m).
        exact: Ascending speeds [m/s], and the least loads at which slip grazes the belt [N], ``inf`` for
            none, shape (2, n).
        larger: ``ln N`` and the exact fold [m/s] of loads beyond the last, shape (2, k), where friction that
            rises with the speed, or strong damping, makes the fold fall again with the load; ``nan``:
            unknown.
    """

    grazing: Grazing
    span: FoldRange
    averaged: FloatArray
    exact: FloatArray
    larger: FloatArray

    @property
    def smooth(self) -> bool:
        """Whether a spline joins the points of the curve; else monotone cubics."""
        return not self.grazing.use.kinks

    def averaged_fold(self, load: FloatArray) -> FloatArray:
        """Return the last speeds with a cycle under averaging at loads [N], shape (n,) [m/s]; or ``nan``."""
        return last_speeds(self.averaged[:2], load, self.smooth)

    def averaged_sticking_end(self, load: FloatArray) -> FloatArray:
        """Return the last speeds with one that sticks under averaging, as :meth:`averaged_fold`."""
        return last_speeds(self.averaged[::2], load, self.smooth)

    def exact_fold(self, load: FloatArray) -> FloatArray:
        """Return the last speeds at which the lining sticks at loads [N], shape (n,) [m/s]; ``nan``: none."""
        speed = last_speeds(self.exact, load, self.smooth)
        x, y = self.larger
        rows = np.flatnonzero(load > math.exp(x[0])) if x.size else np.zeros(0, int)
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
        out, law = np.zeros(load.size), self.grazing.law
        if not -float(law.slope(ALMOST_REST)) < self.grazing.use.fall * _AS_STEEP:
            return out  # it falls most at rest
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

    ``None`` where no load has a cycle.
    """
    grazing = Grazing(bearing)
    span = _curve_range(grazing)
    if span is None:
        return None
    averaged = _averaged_curve(grazing)
    if not grazing.use.kinks:
        return FoldCurve(grazing, span, averaged, *_smooth_curve(grazing, span))
    if bearing.damping_ratio < 1.0:
        return FoldCurve(grazing, span, averaged, _curve_in_pieces(grazing, span), _NOTHING)
    return FoldCurve(
        grazing, span, averaged, averaged[:2] * [[1.0], [np.inf]], _heavily_damped_curve(grazing, span)
    )


def _averaged_curve(grazing: Grazing) -> FloatArray:
    """Return the averaged fold and end of sticking as curves: :attr:`FoldCurve.averaged`."""
    law = grazing.law
    speed = np.geomspace(_SLOWEST * grazing.scales[0], 300.0 * grazing.scales[-1], 161)
    if (solver := averaging.averaged(law)) is averages_closed_form:
        peak = cusp = solver.peak_slope(law, speed)
    elif speed_scales(law):
        speed, peak, cusp = average_curve(law)
    else:
        peak = cusp = np.zeros(speed.size)
    with np.errstate(all='ignore'):
        return np.stack([speed, *(grazing.bearing.damping / np.maximum([peak, cusp], 0.0))])


def _curve_range(grazing: Grazing) -> FoldRange | None:
    """Choose the loads and speeds of a curve by a rough scan of both; ``None`` if no load has a cycle."""
    bearing, law, breaks = grazing.bearing, grazing.law, grazing.scales
    least_load = _averaged_curve(grazing)[1]
    lowest = _SLOWEST * breaks[0]
    averaged = float(np.min(least_load, initial=np.inf))
    # 200 kN, or until friction would move the lining by 0.1 m: a soft lining (50 kg, 3 Hz) has slip so stiff
    # at 200 kN that it takes minutes.
    max_load = min(2e5, 0.1 * bearing.stiffness / max(law.static, 1e-9))
    bounds = (max_load, bearing.damping / grazing.use.fall, float(grazing.least_loads(np.array([lowest]))[0]))
    max_load = max(bounds[0], 2.0**_MIN_OCTAVES * bounds[1], 2.0**_MIN_OCTAVES * bounds[2])
    rough = np.geomspace(
        lowest, max(float(grazing.highest_speeds(np.array([max_load]))[0]), 4.0 * lowest), 32
    )
    exact = np.nan_to_num(grazing.loads(rough, _ROUGHLY, max_load), nan=np.inf)
    k = int(np.argmin(exact))
    onset, octaves = min(averaged, float(exact[k])), _MIN_OCTAVES
    if not onset < np.inf:
        return None
    if grazing.use.fall < math.inf:
        if grazing.falls_most_at_rest:
            onset = bearing.damping / float(-law.slope(ALMOST_REST))
        octaves = max(octaves, math.ceil(math.log2(max(bounds[0] / onset, 1.0))))
    top = onset * 2.0**octaves
    reached = rough[exact <= top]
    last = float(reached[-1]) if reached.size else lowest
    # Where friction rises with the speed, or damping is strong, larger loads may stick up to lower speeds.
    loads = np.geomspace(min(float(exact[rough == last][0]), 0.5 * top), top, 5)
    in_pieces = len(grazing.use.kinks) > 0
    if bearing.damping_ratio < 0.2 and grazing.ends_low:
        # The largest load has the highest fold. This saves a quarter of a scattered table of 100 points, and
        # of Stribeck's law a third of 14,412 steps.
        loads = loads[-1:]
    # A curve may end beyond its fold, but not where friction rises far out: it is vertical there.
    ratio = 1.12 if in_pieces or not grazing.rises else _SMOOTH_RATIO
    folds = grazing.bracket_last_speeds(loads, ratio, _COARSE_IN_PIECES if in_pieces else _COARSE)[1]
    highest = max(float(np.fmax.reduce(folds)), last)
    # At the highest fold of friction that rises far out the least and the largest load that stick meet.
    high = 0.9 * highest if grazing.rises else highest
    low = lowest
    if k and not in_pieces:
        low = float(rough[k - 1]) if exact[k - 1] < np.inf else 0.8 * float(rough[k])
    scale = max(breaks[0], breaks[-1] / 50.0) if in_pieces else breaks[0]
    return FoldRange(
        scale, low, highest if in_pieces else max(high, 2.0 * low), onset, top, np.stack([rough, exact])
    )


def _smooth_curve(grazing: Grazing, span: FoldRange) -> tuple[FloatArray, FloatArray]:
    """Solve the exact curve of a smooth law by a Chebyshev series as long as it takes.

    Returns:
        Speeds and loads, shape (2, m), and ``ln N`` and exact fold of larger loads, shape (2, k): the fields
        ``exact`` and ``larger`` of :class:`FoldCurve`.
    """
    series, curve_range = _fit_series(grazing, span)
    last = 1200
    share = (np.arange(last + 1) / last) ** 1.5
    exact = np.polynomial.chebyshev.chebval(2.0 * share - 1.0, series)
    # About the least of all there is more to read, so that no load falls between two speeds.
    k = int(np.argmin(exact))
    if 0 < k < last:
        near = np.linspace(share[k - 1], share[k + 1], 129)[1:-1]
        share = np.unique(np.concatenate([share, near]))
        exact = np.polynomial.chebyshev.chebval(2.0 * share - 1.0, series)
    larger = _NOTHING
    if exact[-1] < math.log(span.top):
        x = np.linspace(exact[-1], math.log(span.top), 33)
        larger = np.stack([x, _last_speeds(grazing.bearing, np.exp(x))])
    return np.stack([curve_range.places(share), np.exp(exact)]), larger


def _fit_series(grazing: Grazing, span: FoldRange, cuts: int = 2) -> tuple[FloatArray, FoldRange]:
    """Fit a Chebyshev series to the logarithm of the loads that graze, over shares of the range.

    Args:
        grazing: The bearing's grazing.
        span: The range of speeds to begin with.
        cuts: How often the range may be cut at the first speed whose orbit does not turn.

    Returns:
        The coefficients, ``[inf]`` where orbits turn nowhere, and the range of speeds for which they hold.
    """
    count, solved, series = 16, np.zeros(0), np.zeros(0)
    while True:
        share = 0.5 - 0.5 * np.cos(np.pi * np.arange(count + 1) / count)
        speed = span.places(share)
        if not solved.size:
            with np.errstate(all='ignore'):
                guess = np.exp(np.interp(np.log(speed), *np.log(span.rough)))
            solved = np.log(grazing.loads(speed, _CLOSE, _MAX_EXCESS * span.top, guess))
        else:
            guess = np.exp(np.polynomial.chebyshev.chebval(2.0 * share[1::2] - 1.0, series))
            fresh = np.log(grazing.loads_from(speed[1::2], guess, _CLOSE))
            solved = np.insert(solved, np.arange(1, solved.size), fresh)
        lost = np.flatnonzero(np.isnan(solved))
        if lost.size:
            if lost[0] < 2 or not cuts:
                return np.array([np.inf]), span
            return _fit_series(grazing, span._replace(high=float(speed[lost[0] - 1])), cuts - 1)
        series = _chebyshev_series(solved)
        if np.abs(series[-3:]).max() < 1e-9 or count >= 128:
            return series, span
        count *= 2


def _curve_in_pieces(grazing: Grazing, span: FoldRange) -> FloatArray:
    """Solve the exact curve of a law in pieces at every eighth speed, and interpolate its ratio to averaging.

    Returns:
        Speeds [m/s] and loads [N], ``inf`` for none, shape (2, m): the field ``exact`` of :class:`FoldCurve`.
    """
    place = np.arange(1025) / 1024
    speed = span.places(place)
    shape = _sticking_loads(grazing, speed)
    rows = np.arange(0, speed.size, 8)  # every 16th would leave 1 % of a scattered table in place of 0.7 %
    # The ratio of the rough scan leads to 3e-5 of half the loads of a table of 100 points, and the slopes of
    # margins are known to a tenth: to 5 % as a rule, to 40 % far out.
    rough, guess = span.rough[:, np.isfinite(span.rough[1])], None
    if rough.size:
        guess = np.log(rough[1] / _sticking_loads(grazing, rough[0]))
        guess = shape[rows] * np.exp(np.interp(np.log(speed[rows]), np.log(rough[0]), guess))
    loads = grazing.loads(speed[rows], _ROUGHLY, _MAX_EXCESS * span.top, guess, 0.1)
    ratio = np.log(loads / shape[rows])
    is_finite = np.isfinite(ratio)
    exact = np.full(speed.size, np.inf)
    if np.count_nonzero(is_finite) > 1:
        lost = np.interp(place, place[rows], ~is_finite) > 0.0
        rows, ratio = rows[is_finite], ratio[is_finite]
        joined = hermite(place[rows], ratio, monotone_slopes(place[rows], ratio), place)
        exact = np.where(lost, np.inf, shape * np.exp(joined))
    return np.stack([speed, exact])


def _sticking_loads(grazing: Grazing, speed: FloatArray) -> FloatArray:
    """Return the least loads with a cycle at the sliding limit under averaging, bounded, shape (n,) [N]."""
    slope = cusp_slope(grazing.law, speed)
    return grazing.bearing.damping / np.maximum(slope, 1e-3 * grazing.use.fall)


def _heavily_damped_curve(grazing: Grazing, span: FoldRange) -> FloatArray:
    """Solve the exact fold over the load of a law in pieces beyond critical damping.

    Returns:
        ``ln N`` and the fold [m/s], ``nan`` before a jump, shape (2, m): the field ``larger`` of
        :class:`FoldCurve`.
    """
    x = np.linspace(math.log(span.onset), math.log(span.top), 49)
    fold = _last_speeds(grazing.bearing, np.exp(x))
    with np.errstate(all='ignore'):
        jumps = np.flatnonzero(np.abs(np.diff(np.log(fold))) > 0.5)
    fold[jumps] = np.nan
    return np.stack([x, fold])


def _chebyshev_series(values: FloatArray) -> FloatArray:
    """Return Chebyshev's coefficients, by rising degree, of values at ascending points, shape (n + 1,)."""
    n = values.size - 1
    weights = np.ones(n + 1)
    weights[[0, -1]] = 0.5
    # Not by a solver of linear equations: its threads take more than all else.
    grid = np.outer(np.arange(n + 1), np.arange(n + 1)) * (np.pi / n)
    series: FloatArray = 2.0 / n * (np.cos(grid) @ (weights * values[::-1]))
    series[[0, -1]] *= 0.5
    return series


def last_speeds(curve: FloatArray, load: FloatArray, smooth: bool) -> FloatArray:
    """Return the last speeds at which a load is enough for a cycle [m/s].

    Args:
        curve: Ascending speeds [m/s], and the least load with a cycle at each, ``inf`` for none [N],
            shape (2, m).
        load: Shape (n,) [N].
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
    """Return the slopes of the interpolant at a curve's points, shape (n,).

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
