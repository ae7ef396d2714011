# SPDX-License-Identifier: Apache-2.0
"""A friction law as somebody adds it: Stribeck's, written anew, so that its numbers are known."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.physics.friction import LAWS


class OwnNumbers(NamedTuple):
    """What the two functions below take."""

    gap: float
    decay: float


@dataclass(frozen=True)
class OwnLaw:
    """``mu(v) = sgn(v) (mu_k + (mu_s - mu_k) exp(-beta |v|))``."""

    static: float
    kinetic: float
    decay: float

    @property
    def breakpoints(self) -> tuple[float, ...]:
        return (1.0 / self.decay, 4.0 / self.decay, 12.0 / self.decay, 40.0 / self.decay)

    @property
    def numbers(self) -> OwnNumbers:
        return OwnNumbers(self.static - self.kinetic, self.decay)

    def coefficient(self, speed: ArrayLike) -> FloatArray:
        v = np.asarray(speed, float)
        size = self.kinetic + (self.static - self.kinetic) * np.exp(-self.decay * np.abs(v))
        return np.where(v < 0.0, -size, size)

    def slope(self, speed: ArrayLike) -> FloatArray:
        gone = np.exp(-self.decay * np.abs(np.asarray(speed, float)))
        return -(self.static - self.kinetic) * self.decay * gone


def friction_drop(law: OwnNumbers, origin: float, step: float) -> float:
    at = math.exp(-law.decay * origin)
    return law.gap * at * (1.0 - math.exp(-law.decay * step))


def friction_slope(law: OwnNumbers, speed: float) -> float:
    return -law.gap * law.decay * math.exp(-law.decay * abs(speed))


class WithoutFunctions(OwnLaw):
    """The same by its methods alone: none of the two functions are its own."""

    def coefficient(self, speed: ArrayLike) -> FloatArray:
        return super().coefficient(speed)


LAWS['own'] = (OwnLaw, ('static', 'kinetic', 'decay'))
