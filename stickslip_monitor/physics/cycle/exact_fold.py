# SPDX-License-Identifier: Apache-2.0
"""The exact fold over the load: the last speed at which the slip phase meets the belt.

A few loads are solved one by one. Many are read off Chebyshev polynomials in the logarithm of the
load, through folds solved at their nodes, on intervals halved until the last coefficients are
rounding. The fold of a measured curve has kinks and may jump: of its loads every so-many-th is
solved, and those between them only where a cubic through their neighbours does not tell them.
What is known at neighbouring loads tells where to look.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.polynomial import chebyshev

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

# Nodes of an interval of ln N, and the loads below which it is not worth them; how far the last
# coefficients may be from nothing.
_NODES, _CLOSE, _STEEP_CLOSE = 13, 3e-10, 3e-6
# Of a law in pieces every so-many-th load is solved, and how far a cubic may be off between them.
_STRIDE, _TOLD = 32, 2e-5
# Growth rate of the slip at breakaway, N |mu'(0)| / (m omega), of a steep law.
_STEEP = 4.0
# The narrowest interval that is halved: beyond it a fold jumps, and loads are solved one by one.
_NARROW = 0.02
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
    search = _Search(bearing)
    place, back = np.unique(load, return_inverse=True)
    out, height = np.full(place.size, np.nan), place * search.law[STEEPEST] / bearing.damping
    if search.is_closed:
        averaged = np.asarray(boundaries.fold_speed(bearing, place))
        drop = (search.law[HOLD] - search.law[KINETIC]) * place / bearing.momentum
        near = (height > 1.0) & ((height < _WEAKLY) | (drop < _SLIGHT * averaged))
        out[near] = averaged[near]
        height[near] = 0.0
    rows = np.flatnonzero(height > 1.0)
    steep = np.array([search.is_steep(math.log(n)) for n in place[rows]], dtype=bool)
    for part in (rows[steep], rows[~steep]):
        if part.size:
            search.fill(np.log(place[part]), out, part)
    return out[back]


class _Search:
    """Solves the folds of one bearing, and remembers them."""

    def __init__(self, bearing: Bearing) -> None:
        self.bearing = bearing
        self.law = law_numbers(bearing.friction)
        self.body = bearing.mass, bearing.damping, bearing.stiffness
        self.in_pieces = self.law[PIECES] > 0.0
        self.is_closed = computes_as(bearing.friction, Stribeck)
        self.orbit = ROUGHLY if self.in_pieces else GRAZING
        self.known: dict[float, float] = {}  # logarithms of fold over scale, by ln N

    def fill(self, place: FloatArray, out: FloatArray, rows: IndexArray) -> None:
        """Write the folds of an interval, at ascending places ``ln N``."""
        low, high = float(place[0]), float(place[-1])
        if self.in_pieces:
            out[rows] = self._refined(place)
            return
        if place.size <= _NODES or high - low < _NARROW:
            out[rows] = [self.at(x) for x in place[::-1].tolist()][::-1]
            return
        x = chebyshev.chebpts1(_NODES)
        nodes = 0.5 * (low + high) + 0.5 * (high - low) * x
        found = [self.at(node) for node in nodes[::-1].tolist()][::-1]
        ratio = np.log(np.array(found) / self.scale(nodes))
        if np.isfinite(ratio).all():
            series = chebyshev.chebfit(x, ratio, _NODES - 1)
            close = _STEEP_CLOSE if self.is_steep(high) else _CLOSE
            if np.max(np.abs(series[-2:])) < close:
                share = (2.0 * place - low - high) / (high - low)
                out[rows] = np.exp(chebyshev.chebval(share, series)) * self.scale(place)
                return
        elif not np.isfinite(found).any() and len({repr(fold) for fold in found}) == 1:
            out[rows] = found[0]
            return
        middle = int(np.searchsorted(place, 0.5 * (low + high)))
        self.fill(place[middle:], out, rows[middle:])
        self.fill(place[:middle], out, rows[:middle])

    def _refined(self, place: FloatArray) -> FloatArray:
        """Folds at ascending places ``ln N``, solved where their neighbours do not tell them."""
        count = place.size
        fold = np.full(count, np.nan)
        stride = min(_STRIDE, 1 << (count.bit_length() - 1))
        for i in range(0, count, stride)[::-1]:
            fold[i] = self.at(float(place[i]))
        told = np.zeros(count, dtype=bool)  # from an index to the next that is known
        while stride > 1:
            half = stride // 2
            miss = np.full(count, np.inf)
            for i in range(half, count, stride):
                near = range(max(i - half - stride, 0) // stride * stride, count, stride)[:4]
                guess = _through(place[near], fold[near], place[i])
                fold[i] = guess if told[i - half] else self.at(float(place[i]))
                miss[i - half] = 0.0 if told[i - half] else _off(guess, fold[i])
            # The error of a cubic falls by a sixteenth where its stretch is halved.
            beside = np.maximum(miss, np.maximum(np.roll(miss, stride), np.roll(miss, -stride)))
            sure = beside[::stride] < _TOLD
            told[::stride] = sure
            told[half::stride] = sure[: told[half::stride].size]
            stride = half
        return fold

    def scale(self, place: FloatArray) -> FloatArray:
        """Speeds to which the fold is in a smooth ratio, at places ``ln N`` [m/s]."""
        load = np.exp(place)
        if self.is_closed:
            averaged = np.asarray(boundaries.fold_speed(self.bearing, load))
            if np.isfinite(averaged).all():
                return averaged
        return load

    def at(self, place: float) -> float:
        """The fold at one place ``ln N`` [m/s]."""
        scale = float(self.scale(np.array([place]))[0])
        fold = math.nan
        if len(self.known) > 1:
            load, guess = math.exp(place), scale * math.exp(self._guessed(place))
            steep = self.is_steep(place)
            if not steep:
                fold = self._polished(load, guess)
            if math.isnan(fold) and (steep or self.in_pieces):
                fold = fold_near(self.law, self.body, load, guess, ROUGHLY)
        if math.isnan(fold):
            fold = self._searched(math.exp(place))
        if 0.0 < fold < math.inf:
            self.known[place] = math.log(fold / scale)
        return fold

    def is_steep(self, place: float) -> bool:
        """Whether slip grows so fast at breakaway that near grazing orbits part at once."""
        m, _, k = self.body
        # A law that falls at once has no such growth.
        return _STEEP * math.sqrt(k * m) < math.exp(place) * self.law[STEEPEST] < math.inf

    def _guessed(self, place: float) -> float:
        """The logarithm of the ratio by a polynomial through what is known nearest by."""
        near = sorted(self.known, key=lambda x: abs(x - place))[:6]
        total = 0.0
        for x in near:
            weight = self.known[x]
            for other in near:
                if other != x:
                    weight *= (place - other) / (x - other)
            total += weight
        ends = [self.known[x] for x in near[:2]]
        # Far from what is known a polynomial runs away.
        spread = 2.0 * abs(ends[0] - ends[1]) + 0.02
        return min(max(total, min(ends) - spread), max(ends) + spread)

    def _polished(self, load: float, guess: float) -> float:
        """The fold by the secant method from a guess; ``nan`` where that leads to none."""
        law, body = self.law, self.body
        before, after = guess, guess * (1.0 + 1e-5)
        f_before = grazing_margin(law, body, before, load, self.orbit)
        for _ in range(_SECANTS):
            f_after = grazing_margin(law, body, after, load, self.orbit)
            if f_after == f_before:
                break
            step = -f_after * (after - before) / (f_after - f_before)
            if not abs(step) < 0.05 * guess or (f_after - f_before) * (after - before) > 0.0:
                break
            before, f_before, after = after, f_after, after + step
            # The error after a step is far less than its square.
            if abs(step) <= math.sqrt(_CONVERGED) * after:
                return after
        return math.nan

    def _searched(self, load: float) -> float:
        law, jump = self.bearing.friction, self._coulomb(load)
        if not self.in_pieces:
            averaged = boundaries.fold_speed(self.bearing, load) if self.is_closed else 0.0
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


def _through(x: FloatArray, y: FloatArray, at: float) -> float:
    """The polynomial in ``ln y`` through some points, of which none may be missing."""
    with np.errstate(divide='ignore', invalid='ignore'):
        logs = np.log(y)
        weights = [
            np.prod((at - np.delete(x, i)) / (x[i] - np.delete(x, i))) for i in range(x.size)
        ]
        return float(np.exp(weights @ logs))


def _off(guess: float, fold: float) -> float:
    """How far a guess is off, ``inf`` where one of the two is no number."""
    return abs(guess / fold - 1.0) if 0.0 < fold < math.inf and guess > 0.0 else math.inf
