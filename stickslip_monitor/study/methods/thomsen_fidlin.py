# SPDX-License-Identifier: Apache-2.0
"""Perturbation amplitudes for the cubic friction law of Thomsen and Fidlin.

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

from stickslip_monitor.physics.friction import Array
from stickslip_monitor.physics.oscillator import Bearing
from stickslip_monitor.physics.rules import require_not_negative, require_positive
from stickslip_monitor.study.methods.method import MethodResult, found


@dataclass(frozen=True, slots=True)
class Cubic:
    """The cubic law; see the module.

    Args:
        static: ``mu_s`` >= 0 [-].
        minimum: ``mu_m`` >= 0, the least coefficient [-].
        minimum_speed: ``v_m`` > 0, where it is reached [m/s].

    Raises:
        PhysicsError: A coefficient breaks its rule.
    """

    static: float
    minimum: float
    minimum_speed: float

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

    def coefficient(self, speed: ArrayLike) -> Array:
        """See :class:`~stickslip_monitor.physics.friction.FrictionLaw`."""
        v = np.asarray(speed, dtype=float)
        sign = np.where(v < 0.0, -1.0, 1.0)
        return sign * self.static - (self.linear - self.cubic * v * v) * v

    def slope(self, speed: ArrayLike) -> Array:
        """See :class:`~stickslip_monitor.physics.friction.FrictionLaw`."""
        v = np.asarray(speed, dtype=float)
        return 3.0 * self.cubic * v * v - self.linear


@dataclass(frozen=True, slots=True)
class ThomsenFidlin:
    """Closed-form perturbation amplitudes of pure slip and stick-slip."""

    name: str = 'Thomsen and Fidlin'
    family: str = 'Thomsen and Fidlin'
    points: int = 1
    slow: bool = False
    practice: str = (
        'First-order perturbation of the slip phase from breakaway for a cubic friction law;'
        ' an explicit formula on each side of the last speed with stick.'
    )
    source: str = 'Thomsen and Fidlin, Int. J. Non-Linear Mech. 38 (2003) 389-403'

    def refusal(self, bearing: Bearing, speed: float, load: float) -> str:
        """It holds for the cubic law with friction that falls first."""
        law = bearing.friction
        if not isinstance(law, Cubic):
            return "the formulas are those of Thomsen and Fidlin's cubic law and of no other"
        if law.minimum >= law.static:
            return 'the minimum coefficient must lie below the static one'
        return ''

    def amplitude(self, bearing: Bearing, speed: float, load: float) -> MethodResult:
        """See :class:`~.method.Method`."""
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
