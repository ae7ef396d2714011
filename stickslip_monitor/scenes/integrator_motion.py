# SPDX-License-Identifier: Apache-2.0
"""What goes into the integration of the lining's motion and what comes out of it."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, IntEnum

import numpy as np
from numpy.typing import NDArray

from stickslip_monitor.errors import PhysicsError
from stickslip_monitor.physics.friction import Array
from stickslip_monitor.physics.rules import require_finite, require_positive

from .energy import Energy
from .integrator_drive import Drive

Phases = NDArray[np.int8]


class Phase(IntEnum):
    """Sign of the relative speed ``v = V - x'``."""

    BACKWARD = -1
    STICK = 0
    FORWARD = 1


class Change(IntEnum):
    """What happens at a transition."""

    RELEASE = 0
    RESTICK = 1
    REVERSAL = 2


class Outcome(Enum):
    """How an integration ended, each with its sentence."""

    COMPLETE = 'the motion was followed to the end of the drive'
    EXHAUSTED = 'the motion needs more steps than its time scales allow for'
    NOT_FINITE = 'the motion grew beyond the range of floating-point numbers'


@dataclass(frozen=True, slots=True)
class Accuracy:
    """How accurate the steps of the slip phases are.

    Args:
        tolerance: Error of a step relative to the speeds of belt and lining, > 0 [-].
        order: Order of the Taylor series, 3 to 40.
        longest: Longest step in units of ``1/omega``, > 0.

    Raises:
        PhysicsError: A setting breaks its rule.
    """

    tolerance: float
    order: int
    longest: float = 2.0

    def __post_init__(self) -> None:
        require_positive('tolerance', self.tolerance)
        require_positive('longest', self.longest)
        if not 3 <= self.order <= 40:
            raise PhysicsError(f'order = {self.order} must be between 3 and 40')


EXACT = Accuracy(1e-13, 22)
FAST = Accuracy(1e-10, 16)


@dataclass(frozen=True, slots=True)
class State:
    """The state of the lining.

    Args:
        displacement: ``x`` [m].
        relative_speed: ``v = V - x'`` [m/s].
        phase: Its phase; by default the one that follows from the numbers.

    Raises:
        PhysicsError: A number is not finite, or the phase contradicts the relative speed.
    """

    displacement: float
    relative_speed: float
    phase: Phase | None = None

    def __post_init__(self) -> None:
        require_finite('displacement', self.displacement, 'm')
        require_finite('relative_speed', self.relative_speed, 'm/s')
        if self.phase is Phase.STICK and self.relative_speed != 0.0:
            raise PhysicsError(
                f'relative_speed = {self.relative_speed:g} m/s must be 0 while the lining sticks'
            )

    @classmethod
    def moving(cls, displacement: float, velocity: float, drive: Drive) -> State:
        """A displacement [m] and the lining's own velocity ``x'`` [m/s] as a drive begins."""
        return cls(displacement, float(drive.speed[0, 0]) - velocity)


@dataclass(frozen=True, slots=True, eq=False)
class Transitions:
    """The changes of phase of a motion, in order.

    Attributes:
        time: When, shape (n,) [s].
        before: :class:`Phase` before, shape (n,).
        after: :class:`Phase` after, shape (n,).
    """

    time: Array
    before: Phases
    after: Phases

    @property
    def change(self) -> Phases:
        """:class:`Change` of each, shape (n,)."""
        moving = np.where(self.before == Phase.STICK, Change.RELEASE, Change.REVERSAL)
        return np.where(self.after == Phase.STICK, Change.RESTICK, moving).astype(np.int8)


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """A motion of the lining: samples, transitions, energy.

    Attributes:
        time: Times of the samples, shape (n,) [s].
        displacement: ``x``, shape (n,) [m].
        velocity: ``x'``, shape (n,) [m/s].
        acceleration: ``x''``, shape (n,) [m/s^2]; at a transition that before it.
        relative_speed: ``v = V - x'``, shape (n,) [m/s].
        phase: :class:`Phase`, shape (n,).
        transitions: The changes of phase.
        energy: The energy accounts; ``None`` unless asked for.
        start: State at the drive's begin, with its phase.
        final: State at the drive's end, from which the next drive may go on.
        outcome: How it ended; unless ``COMPLETE``, arrays end where the motion does.
        steps: Steps taken in all phases.
        expansions: Taylor expansions of the friction law, one for each step of a slip phase.
        span: First and last instant [s].
    """

    time: Array
    displacement: Array
    velocity: Array
    acceleration: Array
    relative_speed: Array
    phase: Phases
    transitions: Transitions
    energy: Energy | None
    start: State
    final: State
    outcome: Outcome
    steps: int
    expansions: int
    span: tuple[float, float]

    @property
    def sticking(self) -> NDArray[np.bool_]:
        """Whether the lining sticks, shape (n,)."""
        return np.equal(self.phase, Phase.STICK)

    @property
    def stick_intervals(self) -> Array:
        """Begin and end of every stretch of sticking, cut at the span, shape (m, 2) [s]."""
        t = self.transitions
        begin = t.time[t.after == Phase.STICK]
        end = t.time[t.before == Phase.STICK]
        if self.start.phase is Phase.STICK:
            begin = np.append(self.span[0], begin)
        if self.final.phase is Phase.STICK:
            end = np.append(end, self.span[1])
        return np.column_stack([begin, end])
