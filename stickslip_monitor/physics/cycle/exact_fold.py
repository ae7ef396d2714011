# SPDX-License-Identifier: Apache-2.0
"""The exact fold over the load: the last speed at which the slip phase meets the belt.

A few loads are solved one by one. Many are read off Chebyshev polynomials in the logarithm of the
load, through folds solved at their nodes, on intervals halved until the last coefficients are
rounding; where the fold jumps, as that of a measured curve may, loads are solved one by one again.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.polynomial import chebyshev

from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.physics.averaging import boundaries
from stickslip_monitor.physics.cycle.slip import fold_from_above, fold_near
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
# coefficients may be from nothing, of a law in one piece and of a table.
_NODES, _CLOSE, _TABLE_CLOSE = 13, 3e-10, 1e-5
# How far beyond the scales of a law its fold is looked for.
_SPREAD, _LARGEST_EXPONENT = 100.0, 700.0


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
    out = np.full(place.size, np.nan)
    rows = np.flatnonzero(place * search.law[STEEPEST] > bearing.damping)
    if rows.size:
        search.fill(np.log(place[rows]), out, rows)
    return out[back]


class _Search:
    """Solves the folds of one bearing, from the highest load downward."""

    def __init__(self, bearing: Bearing) -> None:
        self.bearing = bearing
        self.law = law_numbers(bearing.friction)
        self.body = bearing.mass, bearing.damping, bearing.stiffness
        self.close = _TABLE_CLOSE if self.law[PIECES] else _CLOSE

    def fill(self, place: FloatArray, out: FloatArray, rows: FloatArray) -> None:
        """Write the folds of an interval, at ascending places ``ln N``."""
        low, high = float(place[0]), float(place[-1])
        if place.size <= _NODES or not high > low:
            out[rows] = [self.at(math.exp(x)) for x in place]
            return
        x = chebyshev.chebpts1(_NODES)
        nodes = np.exp(0.5 * (low + high) + 0.5 * (high - low) * x)
        ratio = np.array([self.at(float(n)) / float(n) for n in nodes])
        if np.isinf(ratio).all() or np.isnan(ratio).all():
            out[rows] = ratio[0]
            return
        if np.isfinite(ratio).all():
            series = chebyshev.chebfit(x, np.log(ratio), _NODES - 1)
            if np.max(np.abs(series[-2:])) < self.close:
                share = (2.0 * place - low - high) / (high - low)
                out[rows] = np.exp(chebyshev.chebval(share, series) + place)
                return
        middle = int(np.searchsorted(place, 0.5 * (low + high)))
        self.fill(place[:middle], out, rows[:middle])
        self.fill(place[middle:], out, rows[middle:])

    def at(self, load: float) -> float:
        """The fold at one load > 0."""
        law = self.bearing.friction
        jump = self._coulomb(load)
        if self.law[PIECES] == 0.0:
            averaged = (
                boundaries.fold_speed(self.bearing, load) if computes_as(law, Stribeck) else 0.0
            )
            guess = float(np.fmax(averaged, jump))
            if not 0.0 < guess < math.inf:
                return guess if guess == math.inf else math.nan
            return fold_near(self.law, self.body, load, guess)
        scales = [v for v in (*law.breakpoints[:1], *law.breakpoints[-1:]) if v > 0.0]
        if 0.0 < jump < math.inf:
            scales.append(jump)
        high, low = _SPREAD * max(scales), min(scales) / _SPREAD
        return fold_from_above(self.law, self.body, load, high, low)

    def _coulomb(self, load: float) -> float:
        """The fold [m/s] of a law that falls at once, from one turn of the free vibration.

        It starts ``N Delta/k`` from its middle at the belt's speed, and must have that speed again
        when it has lost ``exp(-2 pi zeta)`` of its amplitude: right to some percent.
        """
        momentum = self.bearing.mass * self.bearing.natural_frequency
        if self.law[PIECES] == 0.0:
            kinetic, viscous = self.law[KINETIC], self.law[VISCOUS]
        else:
            kinetic, viscous = self.law[EDGES + int(self.law[PIECES]) * 5 - 4], 0.0
        damping = self.bearing.damping_ratio + 0.5 * viscous * load / momentum
        lost = math.expm1(min(4.0 * math.pi * damping, _LARGEST_EXPONENT))
        drop = max(self.law[HOLD] - kinetic, 0.0) * load / momentum
        if lost == 0.0:
            return math.inf if drop > 0.0 else 0.0
        return drop / math.sqrt(lost)
