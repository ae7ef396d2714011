# SPDX-License-Identifier: Apache-2.0
"""First-order perturbation of the slip phase from breakaway, for any friction law.

A lining that sticks leaves the belt with the velocity ``V`` close to steady sliding, whatever
came before. One slip phase makes its velocity amplitude grow by ``pi (2 N S - c V)/(m omega)``,
the growth of a cycle at the sliding limit; crest and trough see half of that on the average:

    omega A = V + (pi/(m omega)) (N S(V; V) - c V/2),    S(V; V) = Delta I1e(beta V) for Stribeck

The idea is that of Thomsen and Fidlin for their cubic law. The relative error is of second order
in ``eta`` and ``zeta`` where the lining sticks. The cycle ends where the growth does, at the fold
of averaging.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from stickslip_monitor.physics.averaging import harmonic
from stickslip_monitor.physics.oscillator import Bearing
from stickslip_monitor.study.methods.method import MethodResult, found


@dataclass(frozen=True, slots=True)
class SlipPerturbation:
    """One explicit formula.

    Args:
        points: Operating points solved in one call; their common cost is shared.
    """

    points: int = 1
    family: str = 'slip perturbation'
    slow: bool = False
    practice: str = (
        'The slip phase from breakaway is perturbed to first order; an explicit formula with the'
        ' friction harmonic at the sliding limit.'
    )
    source: str = (
        'Thomsen and Fidlin, Int. J. Non-Linear Mech. 38 (2003) 389-403, generalised here'
    )

    @property
    def name(self) -> str:
        """See :class:`~.method.Method`."""
        together = '' if self.points == 1 else f', {self.points} at once'
        return f'slip perturbation{together}'

    def refusal(self, bearing: Bearing, speed: float, load: float) -> str:
        """It applies everywhere, but counts on a stick phase."""
        return ''

    def amplitude(self, bearing: Bearing, speed: float, load: float) -> MethodResult:
        """See :class:`~.method.Method`."""
        speeds = np.full(self.points, speed)
        omega = bearing.natural_frequency
        drive = load * harmonic(bearing.friction, speeds, speeds)
        growth = np.pi * (drive - 0.5 * bearing.damping * speeds) / (bearing.mass * omega)
        amplitude = np.where(growth > 0.0, (speeds + growth) / omega, math.nan)
        return found(float(amplitude[0]), None)
