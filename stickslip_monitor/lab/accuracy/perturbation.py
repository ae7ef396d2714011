# SPDX-License-Identifier: Apache-2.0
"""Approximate closed forms: KBM with a polynomial, slip perturbation, Thomsen and Fidlin.

**KBM with a polynomial** is the published route, with the root by Newton-Raphson:
``exp(-beta |v|)`` is replaced by its Taylor polynomial of order ``n`` about zero speed, whose
powers of ``|V - a cos t|`` are integrated exactly on both sides of ``t_s = arccos(V/a)``.

**Slip perturbation** is of first order from breakaway, for any friction law: a lining that sticks
leaves the belt with the velocity ``V`` close to steady sliding, independent of its history. One
slip phase makes its velocity amplitude grow by ``pi (2 N S - c V)/(m omega)``,
the growth of a cycle at the sliding limit; crest and trough see half of that on the average:

    omega A = V + (pi/(m omega)) (N S(V; V) - c V/2),    S(V; V) = Delta I1e(beta V) for Stribeck

The idea is that of Thomsen and Fidlin for their cubic law (Int. J. Non-Linear Mech. 38 (2003)
389-403). The relative error is of second order
in ``eta`` and ``zeta`` where the lining sticks. The cycle ends where the growth does, at the fold
of averaging.

**Thomsen and Fidlin** give perturbation amplitudes for a cubic law,
``mu(v) = mu_s sgn(v) - k_1 v + k_3 v^3`` with ``k_1 = 3 (mu_s - mu_m)/(2 v_m)`` and
``k_3 = (mu_s - mu_m)/(2 v_m^3)``: friction falls from ``mu_s`` to ``mu_m`` at ``v_m`` and rises
beyond. Expanding in ``N (mu_s - mu_m)/(m omega v_m)`` and ``2 zeta``, both small:

- no cycle for ``V >= V_0 = v_m sqrt(1 - c/(N k_1))``;
- pure slip for ``V_1 = sqrt(4/5) V_0 <= V < V_0``: ``omega A = 2 sqrt(V_0^2 - V^2)``;
- stick-slip for ``V < V_1``: the slip phase leaves the belt with the velocity amplitude ``V``
  and gains half of a cycle's growth on the average of crest and trough,
  ``omega A = V (1 + (pi/2) (N (k_1 - 15/4 k_3 V^2) - c)/(m omega))``.

The two meet at ``V_1``. Derived here to first order from the same model and law; the dimensional
form replaces the paper's ``gamma^2, beta, v_b`` by ``N/(m omega v), zeta, V``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.lab.accuracy.method import MethodResult, found, not_converged
from stickslip_monitor.physics.averaging.boundaries import harmonic
from stickslip_monitor.physics.friction import Stribeck, require_not_negative, require_positive
from stickslip_monitor.physics.oscillator import Bearing

_STEPS = 60
_FIRST_GUESS = 1.0001
# Exact for the cosine polynomials of all orders in use.
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(48)


def taylor_coefficients(law: Stribeck, speed: float, order: int) -> FloatArray:
    """Coefficients of ``mu`` in powers of ``|v|/V``, shape (order + 1,)."""
    powers = np.arange(order + 1)
    factorial = np.array([float(math.factorial(k)) for k in powers])
    coefficients: FloatArray = (
        (law.static - law.kinetic) * (-law.decay * speed) ** powers / factorial
    )
    coefficients[0] += law.kinetic
    coefficients[1] += law.viscous * speed
    return coefficients


def averages(coefficients: FloatArray, alpha: float) -> tuple[float, float]:
    """``S(a; V)`` and its slope ``dS/d alpha`` at ``alpha = a/V`` > 1 for a polynomial law."""
    crossing = math.acos(1.0 / alpha)
    order = np.arange(coefficients.size)
    rates = order[1:] * coefficients[1:]
    total = fall = 0.0
    for low, high, side in ((0.0, crossing, -1.0), (crossing, math.pi, 1.0)):
        cosine = np.cos(0.5 * (low + high + (high - low) * _NODES))
        weight = 0.5 * (high - low) * _WEIGHTS * cosine
        relative = side * (1.0 - alpha * cosine)
        powers = relative[:, None] ** order
        total += side * float(weight @ (powers @ coefficients))
        fall -= float((weight * cosine) @ (powers[:, :-1] @ rates))
    kink = 2.0 * coefficients[0] / (alpha**3 * math.sin(crossing))
    return total / math.pi, (fall - kink) / math.pi


def polynomial_averaging(order: int, bearing: Bearing, speed: float, load: float) -> MethodResult:
    """KBM with the exponential expanded to a polynomial of some order >= 1."""
    law = bearing.friction
    assert isinstance(law, Stribeck)
    coefficients = taylor_coefficients(law, speed, order)
    level = 0.5 * bearing.damping * speed / load
    if averages(coefficients, 1.0 + 1e-12)[0] <= level:
        return found(math.nan, 1)
    alpha = _FIRST_GUESS
    for count in range(1, _STEPS + 1):
        value, slope = averages(coefficients, alpha)
        step = (level * alpha - value) / (slope - level)
        # The balance is defined beyond the sliding limit only: half-way to it at most.
        alpha = max(alpha + step, 0.5 * (1.0 + alpha))
        if abs(step) <= 4e-15 * alpha:
            return found(alpha * speed / bearing.natural_frequency, count + 1)
    return not_converged(_STEPS + 1)


def slip_perturbation(points: int, bearing: Bearing, speed: float, load: float) -> MethodResult:
    """One explicit formula, with the friction harmonic at the sliding limit."""
    speeds = np.full(points, speed)
    omega = bearing.natural_frequency
    drive = load * harmonic(bearing.friction, speeds, speeds)
    growth = np.pi * (drive - 0.5 * bearing.damping * speeds) / (bearing.mass * omega)
    amplitude = np.where(growth > 0.0, (speeds + growth) / omega, math.nan)
    return found(float(amplitude[0]))


@dataclass(frozen=True, slots=True)
class Cubic:
    """The cubic law; see the module.

    Raises:
        PhysicsError: A coefficient breaks its rule.
    """

    static: float  # ``mu_s`` >= 0 [-]
    minimum: float  # ``mu_m`` >= 0, the least coefficient [-]
    minimum_speed: float  # ``v_m`` > 0, where it is reached [m/s]

    def __post_init__(self) -> None:
        require_not_negative('static', self.static)
        require_not_negative('minimum', self.minimum)
        require_positive('minimum_speed', self.minimum_speed, 'm/s')

    @property
    def linear(self) -> float:
        """``k_1`` [s/m]."""
        return 1.5 * (self.static - self.minimum) / self.minimum_speed

    @property
    def cubic(self) -> float:
        """``k_3`` [s^3/m^3]."""
        return 0.5 * (self.static - self.minimum) / self.minimum_speed**3

    @property
    def breakpoints(self) -> tuple[float, ...]:
        """Multiples of ``v_m``: the law is smooth, and quadratures like panels of its scale."""
        return tuple(multiple * self.minimum_speed for multiple in (0.5, 1.0, 2.0, 4.0))

    def coefficient(self, speed: ArrayLike) -> FloatArray:
        """See :class:`~stickslip_monitor.physics.friction.FrictionLaw`."""
        v = np.asarray(speed, dtype=float)
        sign = np.where(v < 0.0, -1.0, 1.0)
        return sign * self.static - (self.linear - self.cubic * v * v) * v

    def slope(self, speed: ArrayLike) -> FloatArray:
        """See :class:`~stickslip_monitor.physics.friction.FrictionLaw`."""
        v = np.asarray(speed, dtype=float)
        return 3.0 * self.cubic * v * v - self.linear


def is_falling_cubic(bearing: Bearing) -> bool:
    """Whether Thomsen and Fidlin's formulas apply: to their law, where it falls at first."""
    law = bearing.friction
    return isinstance(law, Cubic) and law.minimum < law.static


def thomsen_fidlin(bearing: Bearing, speed: float, load: float) -> MethodResult:
    """Closed-form perturbation amplitudes of pure slip and stick-slip."""
    law = bearing.friction
    assert isinstance(law, Cubic)
    omega = bearing.natural_frequency
    share = 1.0 - bearing.damping / (load * law.linear)
    last = law.minimum_speed * math.sqrt(max(share, 0.0))
    if speed >= last:
        return found(math.nan, 0)
    if speed >= math.sqrt(0.8) * last:
        return found(2.0 * math.sqrt((last - speed) * (last + speed)) / omega, 0)
    drive = load * (law.linear - 3.75 * law.cubic * speed**2) - bearing.damping
    growth = 0.5 * math.pi * drive / (bearing.mass * omega)
    return found(speed * (1.0 + growth) / omega, 0)
