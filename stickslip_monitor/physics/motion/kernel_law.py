# SPDX-License-Identifier: Apache-2.0
"""Friction laws as the numbers that the inner loops take."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.interpolate import PchipInterpolator

from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.physics.friction import (
    Coulomb,
    FrictionLaw,
    Stribeck,
    Tabulated,
    computes_as,
)
from stickslip_monitor.physics.law_numbers import sampled_cubics

# How far cubics may be off a law that has no series, in units of its largest coefficient.
_SAMPLED = 1e-9
# In units of 1/beta: a series sees from above that the exponential rises below such a speed, and
# above the last one it is less than the rounding of one.
_EXPONENTIAL_EDGES = (0.0, 12.0, 40.0, np.inf)


@dataclass(frozen=True, slots=True, eq=False)
class KernelLaw:
    """A friction law for the inner loops.

    Attributes:
        hold: Largest coefficient that sticking can carry [-]: by Filippov's convex hull never
            less than that of slow sliding.
        steepest: Upper bound of ``|d mu / d|v||`` [s/m].
        exponential: ``mu_k, mu_s - mu_k, beta, nu`` of Stribeck's law.
        edges: Lower ends of the smooth pieces and infinity, shape (pieces + 1,) [m/s].
        cubics: Coefficients on each piece in ``|v| - edge``, shape (pieces, 4); empty for an
            exponential.
    """

    hold: float
    steepest: float
    exponential: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    edges: FloatArray = field(default_factory=lambda: np.array([0.0, np.inf]))
    cubics: FloatArray = field(default_factory=lambda: np.zeros((0, 4)))

    @property
    def is_cubic(self) -> bool:
        """Whether the law is given by cubics."""
        return self.cubics.size > 0


def kernel_law(law: FrictionLaw) -> KernelLaw:
    """A friction law for the inner loops; one that has no series as cubics, right to 1e-9."""
    if computes_as(law, Stribeck):
        gap = law.static - law.kinetic
        numbers = (law.kinetic, gap, law.decay, law.viscous)
        edges = np.array(_EXPONENTIAL_EDGES) / law.decay
        return KernelLaw(law.static, abs(gap) * law.decay + law.viscous, numbers, edges)
    if computes_as(law, Coulomb):
        return KernelLaw(max(law.static, law.kinetic), 0.0, (law.kinetic, 0.0, 0.0, 0.0))
    if computes_as(law, Tabulated):
        return _table(law)
    begins, cubics = sampled_cubics(law, _SAMPLED)
    hold = max(law.static, float(cubics[0, 0]))
    steepest = float(np.max(np.abs(law.slope(begins[1:]))))
    return KernelLaw(hold, steepest, edges=np.append(begins, np.inf), cubics=cubics)


def _table(law: Tabulated) -> KernelLaw:
    edges = np.array([*law.speed, np.inf])
    cubics = np.zeros((len(law.speed), 4))
    cubics[:-1] = PchipInterpolator(law.speed, law.values).c[::-1].T
    cubics[-1, 0] = law.values[-1]
    if law.speed[0] > 0.0:
        edges = np.append(0.0, edges)
        cubics = np.vstack([[law.values[0], 0.0, 0.0, 0.0], cubics])
    # The monotone cubic is nowhere steeper than three times the chord (Fritsch and Carlson).
    steepest = 3.0 * float(np.max(np.abs(np.diff(law.values) / np.diff(law.speed))))
    return KernelLaw(law.static, steepest, edges=edges, cubics=cubics)
