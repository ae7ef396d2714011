# SPDX-License-Identifier: Apache-2.0
"""What every method compared has in common."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import Protocol

import numpy as np

from stickslip_monitor.physics.friction import FrictionLaw, Stribeck
from stickslip_monitor.physics.oscillator import Bearing

_STEEPEST = 50.0  # a solver's wild trial step must not overflow


class MethodOutcome(Enum):
    """How a method ended, each with its sentence."""

    CYCLE = 'A limit cycle was found.'
    NO_CYCLE = 'The method finds no limit cycle at this speed and load.'
    NOT_CONVERGED = 'The method did not converge within its allowed number of steps.'
    REFUSED = 'The method does not apply here.'


@dataclass(frozen=True, slots=True)
class MethodResult:
    """What a method says of one operating point.

    Attributes:
        amplitude: Half the peak-to-peak displacement of the stable cycle [m]; ``nan`` without.
        outcome: How it ended.
        evaluations: How often the friction law was asked, an array of speeds counting once;
            ``None`` where it is not counted.
        reason: Why it was refused; empty otherwise.
    """

    amplitude: float
    outcome: MethodOutcome
    evaluations: int | None
    reason: str = ''

    @property
    def sentence(self) -> str:
        """The outcome for a person."""
        return self.reason or self.outcome.value


class Method(Protocol):
    """A way to compute the amplitude of the stable cycle."""

    @property
    def name(self) -> str:
        """Short and unique."""

    @property
    def family(self) -> str:
        """What it shares with its variants, which differ in accuracy only."""

    @property
    def practice(self) -> str:
        """What it is and how practitioners do it, in a sentence."""

    @property
    def source(self) -> str:
        """Where it comes from."""

    @property
    def points(self) -> int:
        """Operating points solved together in one call; its time is shared among them."""

    @property
    def slow(self) -> bool:
        """Whether a quick look leaves it out."""

    def refusal(self, bearing: Bearing, speed: float, load: float) -> str:
        """Why the method does not apply; empty where it does."""

    def amplitude(self, bearing: Bearing, speed: float, load: float) -> MethodResult:
        """Solve an operating point: surface speed ``V`` > 0 [m/s], load ``N`` > 0 [N]."""


def solve(method: Method, bearing: Bearing, speed: float, load: float) -> MethodResult:
    """Apply a method where it applies, and say why where it does not."""
    reason = method.refusal(bearing, speed, load) or _unusable(speed, load)
    if reason:
        return MethodResult(math.nan, MethodOutcome.REFUSED, None, reason)
    return method.amplitude(bearing, speed, load)


def _unusable(speed: float, load: float) -> str:
    if speed > 0.0 and load > 0.0 and math.isfinite(speed) and math.isfinite(load):
        return ''
    return f'speed = {speed:g} m/s and load = {load:g} N must be finite and above 0'


def found(amplitude: float, evaluations: int | None) -> MethodResult:
    """A result: a cycle where the amplitude is a number, none where it is ``nan``."""
    outcome = MethodOutcome.CYCLE if math.isfinite(amplitude) else MethodOutcome.NO_CYCLE
    return MethodResult(amplitude, outcome, evaluations)


def scalar_law(law: FrictionLaw) -> Callable[[float], float]:
    """The coefficient at one relative speed [m/s], without the cost of an array.

    Below zero the forward branch goes on smoothly, for trial steps that overshoot a contact.
    """
    if isinstance(law, Stribeck):
        kinetic, gap = law.kinetic, law.static - law.kinetic
        decay, viscous = law.decay, law.viscous
        return lambda v: kinetic + gap * math.exp(min(-decay * v, _STEEPEST)) + viscous * v
    return lambda v: float(law.coefficient(v))


def breakaway(bearing: Bearing, speed: float, load: float) -> float:
    """Displacement ``x_0 = (mu_s N - c V)/k`` at which sticking ends [m]."""
    return (bearing.friction.static * load - bearing.damping * speed) / bearing.stiffness


def typical_period(bearing: Bearing, speed: float, load: float) -> float:
    """A cycle's duration, to plan with: a free vibration and the stick of a weak damper [s]."""
    lead = breakaway(bearing, speed, load) - float(bearing.equilibrium(speed, load))
    return 2.0 * np.pi / bearing.natural_frequency + 2.0 * max(lead, 0.0) / speed
