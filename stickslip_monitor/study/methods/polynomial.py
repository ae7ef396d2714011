# SPDX-License-Identifier: Apache-2.0
"""Averaging by the published route: the exponential as a polynomial, the root by Newton-Raphson.

``exp(-beta |v|)`` is replaced by its Taylor polynomial of order ``n`` about zero speed. Every
power of ``|V - a cos t|`` then integrates in closed form on both sides of ``t_s = arccos(V/a)``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from stickslip_monitor.physics.friction import Array, Stribeck
from stickslip_monitor.physics.oscillator import Bearing
from stickslip_monitor.study.methods.method import MethodResult, Outcome, found

_STEPS = 60
_FIRST_GUESS = 1.0001


def taylor_coefficients(law: Stribeck, speed: float, order: int) -> Array:
    """Coefficients of ``mu`` in powers of ``|v|/V``, shape (order + 1,)."""
    powers = np.arange(order + 1)
    factorial = np.array([float(math.factorial(k)) for k in powers])
    coefficients: Array = (law.static - law.kinetic) * (-law.decay * speed) ** powers / factorial
    coefficients[0] += law.kinetic
    coefficients[1] += law.viscous * speed
    return coefficients


def cosine_integrals(angle: float, order: int) -> Array:
    """``integral_0^angle cos(t)^j dt`` for ``j`` from 0 to ``order``."""
    values = np.empty(order + 1)
    cosine, sine = math.cos(angle), math.sin(angle)
    values[0], values[1] = angle, sine
    for j in range(2, order + 1):
        values[j] = (cosine ** (j - 1) * sine + (j - 1) * values[j - 2]) / j
    return values


def averages(coefficients: Array, alpha: float) -> tuple[float, float]:
    """``S(a; V)`` and its slope ``dS/d alpha`` at ``alpha = a/V`` > 1 for a polynomial law."""
    order = coefficients.size - 1
    crossing = math.acos(1.0 / alpha)
    over = cosine_integrals(crossing, order + 2)
    behind = cosine_integrals(math.pi, order + 2) - over
    total = fall = 0.0
    for k, coefficient in enumerate(coefficients):
        # Beyond the belt's speed |v|^k sgn(v) has the sign (-1)^(k+1), its slope (-1)^(k-1).
        ahead = behind + (1.0 if k % 2 else -1.0) * over
        total += coefficient * _power(alpha, k, ahead[1:])
        if k:
            fall -= k * coefficient * _power(alpha, k - 1, ahead[2:])
    kink = 2.0 * coefficients[0] / (alpha**3 * math.sin(crossing))
    return total / math.pi, (fall - kink) / math.pi


def _power(alpha: float, k: int, integrals: Array) -> float:
    """``integral (1 - alpha cos t)^k w dt`` from those of ``cos(t)^j w``."""
    terms = [math.comb(k, j) * (-alpha) ** j * float(integrals[j]) for j in range(k + 1)]
    return math.fsum(terms)


@dataclass(frozen=True, slots=True)
class PolynomialAveraging:
    """KBM with the exponential expanded to a polynomial.

    Args:
        order: Of the Taylor polynomial, >= 1.
    """

    order: int
    points: int = 1
    family: str = 'KBM, polynomial'
    slow: bool = False
    practice: str = (
        'First-order averaging with the exponential expanded to a polynomial of order n about'
        ' zero speed, term-by-term integrals, Newton-Raphson from just above the belt speed.'
    )
    source: str = (
        'the published route for stern bearings; Nayfeh and Mook, Nonlinear Oscillations (1979)'
    )

    @property
    def name(self) -> str:
        """See :class:`~.method.Method`."""
        return f'KBM, polynomial of order {self.order}'

    def refusal(self, bearing: Bearing, speed: float, load: float) -> str:
        """It expands an exponential, so it needs one."""
        if isinstance(bearing.friction, Stribeck):
            return ''
        return 'the expansion is that of an exponential: it needs the Stribeck law'

    def amplitude(self, bearing: Bearing, speed: float, load: float) -> MethodResult:
        """See :class:`~.method.Method`."""
        law = bearing.friction
        assert isinstance(law, Stribeck)
        coefficients = taylor_coefficients(law, speed, self.order)
        level = 0.5 * bearing.damping * speed / load
        alpha, step = _FIRST_GUESS, math.inf
        for count in range(1, _STEPS + 1):
            value, slope = averages(coefficients, alpha)
            balance = value - level * alpha
            if count == 1 and averages(coefficients, 1.0 + 1e-12)[0] <= level:
                return found(math.nan, 2)
            step = -balance / (slope - level)
            # The balance is defined beyond the sliding limit only: half-way to it at most.
            alpha = max(alpha + step, 0.5 * (1.0 + alpha))
            if abs(step) <= 4e-15 * alpha:
                return found(alpha * speed / bearing.natural_frequency, count + 1)
        return MethodResult(math.nan, Outcome.NOT_CONVERGED, _STEPS + 1)
