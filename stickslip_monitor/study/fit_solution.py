# SPDX-License-Identifier: Apache-2.0
"""What the parts of the fit hand to each other: the coefficients sought, and the best curve."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stickslip_monitor.study.curve_file import FrictionCurve

Array = NDArray[np.float64]

UNITS = {'static': '', 'kinetic': '', 'decay': 's/m', 'viscous': 's/m'}
TUKEY = 4.685
"""Residuals beyond this many scales count nothing; on clean data 95 % efficient."""
FLOOR = 1e-14
"""Exact data keep a scatter of this share of the largest coefficient."""


@dataclass(frozen=True, slots=True)
class Model:
    """Which coefficients are free besides the drop and the decay."""

    viscous: bool
    kinetic: bool = True

    @property
    def size(self) -> int:
        """Number of free coefficients, k."""
        return 2 + self.kinetic + self.viscous

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the free coefficients, in the order of ``UNITS``."""
        free = {'static': True, 'kinetic': self.kinetic, 'decay': True, 'viscous': self.viscous}
        return tuple(name for name in UNITS if free[name])


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """The best curve of a model; ``drop`` is that of the decaying part at the lowest speed."""

    curve: FrictionCurve
    model: Model
    drop: float
    kinetic: float
    decay: float
    viscous: float
    residual: Array
    weight: Array
    scale: float

    @property
    def row_weight(self) -> Array:
        """Weights of the squared residuals: Tukey's, by the variance of each point."""
        return self.weight / self.curve.std**2

    @property
    def freedom(self) -> float:
        """Degrees of freedom: the sum of the weights less k."""
        return float(self.weight.sum()) - self.model.size

    @property
    def squares(self) -> float:
        """Weighted sum of the squared residuals."""
        return float(np.sum(self.row_weight * self.residual**2))

    @property
    def variance(self) -> float:
        """``s^2`` with which ``s^2 (J'WJ)^-1`` is Huber's covariance; exact data keep a floor."""
        n, p = self.weight.size, self.model.size
        ratio = (self.residual / (self.scale * self.curve.std * TUKEY)) ** 2
        inside = ratio < 1.0
        slope = np.where(inside, (1.0 - ratio) * (1.0 - 5.0 * ratio), 0.0)
        mean = max(float(slope.mean()), 0.1)
        correction = 1.0 + p / n * float(slope.var()) / mean**2
        influence = float(np.sum((self.weight * self.residual / self.curve.std) ** 2)) / (n - p)
        spread = correction**2 * influence / mean**2 * float(self.weight.mean())
        return max(spread, scale_floor(self.curve) ** 2)


def scale_floor(curve: FrictionCurve) -> float:
    """The least scale: what rounding leaves of exact data."""
    return FLOOR * max(float(np.max(np.abs(curve.coefficient / curve.std))), FLOOR)
