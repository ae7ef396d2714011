# SPDX-License-Identifier: Apache-2.0
"""The exact fold over the load: the last speed at which the slip phase meets the belt.

It is in a smooth ratio to the averaged fold. Of many loads every so-many-th is solved, and those
between them only where a polynomial through their neighbours does not tell the ratio well enough.
What is known at neighbouring loads tells where to look.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from stickslip_monitor.arrays import FloatArray, IndexArray
from stickslip_monitor.physics.averaging import boundaries
from stickslip_monitor.physics.cycle.slip import (
    GRAZING,
    ROUGHLY,
    fold_from_above,
    fold_near,
    grazing_margin,
)
from stickslip_monitor.physics.friction import Stribeck, computes_as
from stickslip_monitor.physics.law_numbers import (
    EDGES,
    HOLD,
    KINETIC,
    PIECES,
    STEEPEST,
    VISCOUS,
    law_numbers,
)
from stickslip_monitor.physics.oscillator import Bearing

# Every so-many-th of many loads is solved at first, and polynomials go through so many of them.
_STRIDE, _NEIGHBOURS = 64, 8
# How far a polynomial may be off in the middle between solved loads, to be believed at their
# quarters: of a smooth law (where the error then falls by 256), a steep one, one in pieces.
_TOLD, _STEEP_TOLD, _ROUGHLY_TOLD = 5e-8, 3e-6, 2e-5
# Growth rate of the slip at breakaway, N |mu'(0)| / (m omega), of a steep law.
_STEEP = 4.0
# Loads in units of the least with a cycle, and forces ``N Delta/(m omega V)``, up to which
# averaging has the fold to 1e-10, and orbits gain too little to tell it better.
_WEAKLY, _SLIGHT = 1.003, 1e-6
# How far beyond the scales of a law its fold is looked for.
_SPREAD, _LARGEST_EXPONENT = 100.0, 700.0
# Steps of the secant method from a good guess, and how close it has to come.
_SECANTS, _CONVERGED = 6, 1e-11


def exact_fold(bearing: Bearing, load: FloatArray) -> FloatArray:
    """The last speed with a stick-slip cycle [m/s].

    Args:
        bearing: The bearing.
        load: ``N`` > 0 and finite [N], shape (n,).

    Returns:
        ``nan`` where no speed has a cycle, ``inf`` where none is the last, shape (n,).
    """
    search, is_closed = _Search(bearing), computes_as(bearing.friction, Stribeck)
    loads, back = np.unique(load, return_inverse=True)
    averaged = np.asarray(boundaries.fold_speed(bearing, loads))
    out, height = np.full(loads.size, np.nan), loads * search.law[STEEPEST] / bearing.damping
    if is_closed:
        drop = (search.law[HOLD] - search.law[KINETIC]) * loads / bearing.momentum
        near = (height > 1.0) & ((height < _WEAKLY) | (drop < _SLIGHT * averaged))
        out[near] = averaged[near]
        height[near] = 0.0
    rows = np.flatnonzero(height > 1.0)
    # Coulomb's law, the limit for large loads, has a fold in proportion to the load.
    scale = np.where((averaged > 0.0) & (averaged < np.inf), averaged, loads)
    steep = np.array([search.is_steep(n) for n in loads[rows]], dtype=bool)
    for part, close in ((rows[steep], _STEEP_TOLD), (rows[~steep], _TOLD)):

        def ratio(i: int, part: IndexArray = part) -> float:
            return search.at(loads[part[i]], averaged[part[i]]) / float(scale[part[i]])

        close = _ROUGHLY_TOLD if search.in_pieces else close
        out[part] = interpolated(np.log(loads[part]), ratio, close) * scale[part]
    return out[back]


def interpolated(place: FloatArray, solve: Callable[[int], float], close: float) -> FloatArray:
    """Positive values at ascending places, solved only where their neighbours do not tell them.

    Args:
        place: Shape (n,).
        solve: The value at an index; called from above.
        close: Relative error of a polynomial in the middle between solved places up to which it
            is believed where these are half as far apart.
    """
    count = place.size
    value = np.full(count, np.nan)
    stride = min(_STRIDE, 1 << max(count.bit_length() - 3, 0))
    for i in range(0, count, stride)[::-1]:
        value[i] = solve(i)
    told = np.zeros(count, dtype=bool)  # from an index to the next that is known
    while stride > 1:
        half = stride // 2
        miss = np.full(count, np.inf)
        for i in range(half, count, stride)[::-1]:
            first = (i - half) // stride - _NEIGHBOURS // 2 + 1
            last = (count - 1) // stride - _NEIGHBOURS + 1
            near = range(max(min(first, last), 0) * stride, count, stride)[:_NEIGHBOURS]
            guess = math.exp(_through(place[near], np.log(value[near]), place[i]))
            value[i] = guess if told[i - half] else solve(i)
            known = 0.0 < value[i] < math.inf and guess > 0.0
            miss[i - half] = abs(guess / value[i] - 1.0) if known else math.inf
        # The error falls to a sixteenth at least where the stretch is halved.
        beside = np.maximum(miss, np.maximum(np.roll(miss, stride), np.roll(miss, -stride)))
        sure = beside[::stride] < close
        told[::stride] = sure
        told[half::stride] = sure[: told[half::stride].size]
        stride = half
    return value


def _through(x: FloatArray, y: FloatArray, at: float) -> float:
    """The polynomial through some points; ``nan`` where one is missing."""
    apart = x[:, None] - x
    np.fill_diagonal(apart, 1.0)
    weights = np.prod(at - x) / (at - x) / np.prod(apart, axis=1)
    return float(weights @ y)


class _Search:
    """Solves the folds of one bearing, and remembers them."""

    def __init__(self, bearing: Bearing) -> None:
        self.bearing = bearing
        self.law = law_numbers(bearing.friction)
        self.body = bearing.mass, bearing.damping, bearing.stiffness
        self.in_pieces = self.law[PIECES] > 0.0
        self.orbit = ROUGHLY if self.in_pieces else GRAZING
        self.known: dict[float, float] = {}  # logarithms of fold over scale, by ln N
        self.rate = math.nan  # of the grazing margin over ln V at the last fold
        self.none = 0.0  # the largest load found to have no cycle

    def at(self, load: float, averaged: float) -> float:
        """The fold at a load, given the averaged one [m/s]."""
        fold, place = math.nan, math.log(load)
        scale = averaged if 0.0 < averaged < math.inf else load
        if load < self.none:
            return fold
        if len(self.known) > 1:
            guess, steep = scale * math.exp(self._guessed(place)), self.is_steep(load)
            if not steep:
                fold = self._polished(load, guess)
            if math.isnan(fold) and (steep or self.in_pieces):
                fold = fold_near(self.law, self.body, load, guess, ROUGHLY)
        if math.isnan(fold):
            fold = self._searched(load, averaged)
            self.none = load if math.isnan(fold) else self.none
        if 0.0 < fold < math.inf:
            self.known[place] = math.log(fold / scale)
        return fold

    def is_steep(self, load: float) -> bool:
        """Whether slip grows so fast at breakaway that near grazing orbits part at once."""
        # A law that falls at once has no such growth.
        return _STEEP * self.bearing.momentum < load * self.law[STEEPEST] < math.inf

    def _guessed(self, place: float) -> float:
        """The logarithm of the ratio by a polynomial through what is known nearest by."""
        near = sorted(self.known, key=lambda x: abs(x - place))[:_NEIGHBOURS]
        known = [self.known[x] for x in near]
        # Far from what is known a polynomial runs away.
        spread = 2.0 * abs(known[0] - known[1]) + 0.02
        found = _through(np.array(near), np.array(known), place)
        return min(max(found, min(known[:2]) - spread), max(known[:2]) + spread)

    def _polished(self, load: float, guess: float) -> float:
        """The fold by the secant method from a guess; ``nan`` where that leads to none."""
        law, body = self.law, self.body
        before, after = guess, guess * (1.0 + 1e-5)
        f_before = grazing_margin(law, body, before, load, self.orbit)
        if abs(f_before) < abs(0.01 * self.rate):
            after = guess * (1.0 - f_before / self.rate)
        for _ in range(_SECANTS):
            f_after = grazing_margin(law, body, after, load, self.orbit)
            if f_after == f_before:
                break
            last, step = after - before, -f_after * (after - before) / (f_after - f_before)
            if not abs(step) < 0.05 * guess or (f_after - f_before) * last > 0.0:
                break
            self.rate = (f_after - f_before) / last * after
            before, f_before, after = after, f_after, after + step
            # The error after a step is far less than its product with the one before.
            if abs(step * last) <= _CONVERGED * after * after:
                return after
        return math.nan

    def _searched(self, load: float, averaged: float) -> float:
        law, jump = self.bearing.friction, self._coulomb(load)
        if not self.in_pieces:
            guess = float(np.fmax(averaged, jump))
            if not 0.0 < guess < math.inf:
                return guess if guess == math.inf else math.nan
            return fold_near(self.law, self.body, load, guess, self.orbit)
        scales = [v for v in (*law.breakpoints[:1], *law.breakpoints[-1:]) if v > 0.0]
        if 0.0 < jump < math.inf:
            scales.append(jump)
        high, low = _SPREAD * max(scales), min(scales) / _SPREAD
        return fold_from_above(self.law, self.body, load, high, low, self.orbit)

    def _coulomb(self, load: float) -> float:
        """The fold [m/s] of a law that falls at once, from one turn of the free vibration.

        It starts ``N Delta/k`` from its middle at the belt's speed, and must have that speed again
        when it has lost ``exp(-2 pi zeta)`` of its amplitude: right to some percent.
        """
        momentum = self.bearing.momentum
        if self.in_pieces:
            kinetic, viscous = self.law[EDGES + int(self.law[PIECES]) * 5 - 4], 0.0
        else:
            kinetic, viscous = self.law[KINETIC], self.law[VISCOUS]
        damping = self.bearing.damping_ratio + 0.5 * viscous * load / momentum
        lost = math.expm1(min(4.0 * math.pi * damping, _LARGEST_EXPONENT))
        drop = max(self.law[HOLD] - kinetic, 0.0) * load / momentum
        if lost == 0.0:
            return math.inf if drop > 0.0 else 0.0
        return drop / math.sqrt(lost)
