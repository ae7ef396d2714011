# SPDX-License-Identifier: Apache-2.0
"""A friction law as somebody adds it: Stribeck's, written anew, so that its numbers are known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.physics.friction import LAWS


@dataclass(frozen=True)
class OwnLaw:
    """``mu(v) = sgn(v) (mu_k + (mu_s - mu_k) exp(-beta |v|))``."""

    static: float
    kinetic: float
    decay: float

    @property
    def breakpoints(self) -> tuple[float, ...]:
        return (1.0 / self.decay, 4.0 / self.decay, 12.0 / self.decay, 40.0 / self.decay)

    def coefficient(self, speed: ArrayLike) -> FloatArray:
        v = np.asarray(speed, float)
        size = self.kinetic + (self.static - self.kinetic) * np.exp(-self.decay * np.abs(v))
        return np.where(v < 0.0, -size, size)

    def slope(self, speed: ArrayLike) -> FloatArray:
        decayed = np.exp(-self.decay * np.abs(np.asarray(speed, float)))
        return -(self.static - self.kinetic) * self.decay * decayed


LAWS['own'] = (OwnLaw, ('static', 'kinetic', 'decay'))
