# SPDX-License-Identifier: Apache-2.0
"""What every method compared has in common."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

import numpy as np

from stickslip_monitor.physics.oscillator import Bearing


class MethodOutcome(Enum):
    """How a method ended; refused is a bearing whose law it is not made for."""

    CYCLE = 'cycle'
    NO_CYCLE = 'no_cycle'
    NOT_CONVERGED = 'not_converged'
    REFUSED = 'refused'


@dataclass(frozen=True, slots=True)
class MethodResult:
    """What a method says of one operating point."""

    amplitude: float  # half the peak-to-peak displacement of the stable cycle [m]; ``nan`` without
    outcome: MethodOutcome
    # How often the friction law was asked, an array of speeds counting once; ``None`` where it
    # is not counted.
    evaluations: int | None


def found(amplitude: float, evaluations: int | None = None) -> MethodResult:
    """A result: a cycle where the amplitude is a number, none where it is ``nan``."""
    outcome = MethodOutcome.CYCLE if math.isfinite(amplitude) else MethodOutcome.NO_CYCLE
    return MethodResult(amplitude, outcome, evaluations)


def not_converged(evaluations: int | None = None) -> MethodResult:
    """A result of a method that gave up within its allowed number of steps."""
    return MethodResult(math.nan, MethodOutcome.NOT_CONVERGED, evaluations)


@dataclass(frozen=True, slots=True)
class Method:
    """A way to compute the amplitude of the stable cycle."""

    name: str  # short and unique
    family: str  # what it shares with its variants, which differ in accuracy only
    # Solves an operating point: bearing, surface speed ``V`` > 0 [m/s], load ``N`` > 0 [N].
    amplitude: Callable[[Bearing, float, float], MethodResult]
    applies: Callable[[Bearing], bool] = lambda _: True  # whether it is made for a bearing's law
    points: int = 1  # operating points solved together in one call; its time is shared among them
    slow: bool = False  # whether a quick look leaves it out

    def solve(self, bearing: Bearing, speed: float, load: float) -> MethodResult:
        """Apply it where it applies."""
        if not self.applies(bearing):
            return MethodResult(math.nan, MethodOutcome.REFUSED, None)
        return self.amplitude(bearing, speed, load)


def breakaway(bearing: Bearing, speed: float, load: float) -> float:
    """Displacement ``x_0 = (mu_s N - c V)/k`` at which sticking ends [m]."""
    return (bearing.friction.static * load - bearing.damping * speed) / bearing.stiffness


def typical_period(bearing: Bearing, speed: float, load: float) -> float:
    """A cycle's duration, to plan with: a free vibration and the stick of a weak damper [s]."""
    lead = breakaway(bearing, speed, load) - float(bearing.equilibrium(speed, load))
    return 2.0 * np.pi / bearing.natural_frequency + 2.0 * max(lead, 0.0) / speed
