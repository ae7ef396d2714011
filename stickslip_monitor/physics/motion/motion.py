# SPDX-License-Identifier: Apache-2.0
"""What goes into the integration of the lining's motion and what comes out of it.

What drives the lining: surface speed and load, piecewise cubic in time.

Where the energy of a motion came from and where it went.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum, IntEnum

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import PchipInterpolator

from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.errors import PhysicsError
from stickslip_monitor.physics.friction import require_finite, require_positive

Phases = NDArray[np.int8]


class Phase(IntEnum):
    """Sign of the relative speed ``v = V - x'``."""

    BACKWARD = -1
    STICK = 0
    FORWARD = 1


class PhaseChange(IntEnum):
    """What happens at a transition."""

    RELEASE = 0
    RESTICK = 1
    REVERSAL = 2


class MotionOutcome(Enum):
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
class MotionState:
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
    def moving(cls, displacement: float, velocity: float, drive: Drive) -> MotionState:
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

    time: FloatArray
    before: Phases
    after: Phases

    @property
    def change(self) -> Phases:
        """:class:`PhaseChange` of each, shape (n,)."""
        moving = np.where(self.before == Phase.STICK, PhaseChange.RELEASE, PhaseChange.REVERSAL)
        return np.where(self.after == Phase.STICK, PhaseChange.RESTICK, moving).astype(np.int8)


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

    time: FloatArray
    displacement: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    relative_speed: FloatArray
    phase: Phases
    transitions: Transitions
    energy: Energy | None
    start: MotionState
    final: MotionState
    outcome: MotionOutcome
    steps: int
    expansions: int
    span: tuple[float, float]

    @property
    def sticking(self) -> NDArray[np.bool_]:
        """Whether the lining sticks, shape (n,)."""
        return np.equal(self.phase, Phase.STICK)

    @property
    def stick_intervals(self) -> FloatArray:
        """Begin and end of every stretch of sticking, cut at the span, shape (m, 2) [s]."""
        t = self.transitions
        begin = t.time[t.after == Phase.STICK]
        end = t.time[t.before == Phase.STICK]
        if self.start.phase is Phase.STICK:
            begin = np.append(self.span[0], begin)
        if self.final.phase is Phase.STICK:
            end = np.append(end, self.span[1])
        return np.column_stack([begin, end])


RULES = ('linear', 'cubic', 'hold')


@dataclass(frozen=True, slots=True, eq=False)
class Drive:
    """Surface speed ``V`` and load ``N`` on the pieces between rising times.

    Use :meth:`constant` or :meth:`sampled`. On piece ``i``, with ``s`` the time since
    ``time[i]``, each is ``sum c[i, j] s^j``.

    Attributes:
        time: Ends of the pieces, shape (n + 1,) [s].
        speed: Coefficients of ``V``, which is continuous, shape (n, 4) [m/s, m/s^2, ...].
        load: Coefficients of ``N`` >= 0, which may jump between pieces, shape (n, 4)
            [N, N/s, ...].
    """

    time: FloatArray
    speed: FloatArray
    load: FloatArray

    @classmethod
    def constant(cls, speed: float, load: float, duration: float, start: float = 0.0) -> Drive:
        """A speed [m/s] and a load [N] for a while.

        Args:
            speed: ``V`` [m/s].
            load: ``N`` >= 0 [N].
            duration: > 0 [s].
            start: Time at its begin [s].

        Raises:
            PhysicsError: A quantity breaks its rule.
        """
        return cls.sampled([start, start + duration], [speed] * 2, [load] * 2)

    @classmethod
    def sampled(
        cls,
        time: ArrayLike,
        speed: ArrayLike,
        load: ArrayLike,
        rule: str = 'linear',
        load_rule: str | None = None,
    ) -> Drive:
        """Samples on a grid of times, joined by a rule.

        Args:
            time: Rising times, shape (n,), at least two [s].
            speed: ``V`` at each, shape (n,) [m/s].
            load: ``N`` >= 0 at each, shape (n,) [N].
            rule: ``'linear'``, or ``'cubic'``: the monotone cubic of Fritsch and Carlson, which
                stays between neighbouring samples.
            load_rule: The same for the load (default: ``rule``), or ``'hold'``: each sample until
                the next.

        Raises:
            PhysicsError: A sample or a rule breaks its rule.
        """
        t = np.asarray(time, dtype=float)
        v, n = np.asarray(speed, dtype=float), np.asarray(load, dtype=float)
        _check_grid(t, v, n)
        load_rule = rule if load_rule is None else load_rule
        if rule not in RULES[:2]:
            raise PhysicsError(f"rule = '{rule}' is not one of linear, cubic: a shaft cannot jump")
        if load_rule not in RULES:
            raise PhysicsError(f"load_rule = '{load_rule}' is not one of {', '.join(RULES)}")
        return cls(t, _pieces(t, v, rule), _pieces(t, n, load_rule))

    @property
    def start(self) -> float:
        """Its first instant [s]."""
        return float(self.time[0])

    @property
    def end(self) -> float:
        """Its last instant [s]."""
        return float(self.time[-1])

    def speed_at(self, time: float) -> float:
        """``V`` [m/s] at a time [s] within the drive."""
        piece = int(np.searchsorted(self.time[1:-1], time, side='left'))
        return float(np.polyval(self.speed[piece, ::-1], time - self.time[piece]))

    @property
    def largest_load(self) -> float:
        """An upper bound of ``N`` [N]."""
        width = np.diff(self.time)[:, None]
        return float(np.max(np.sum(np.abs(self.load) * width ** np.arange(4), axis=1)))


def _check_grid(time: FloatArray, speed: FloatArray, load: FloatArray) -> None:
    if time.ndim != 1 or time.shape != speed.shape or time.shape != load.shape:
        raise PhysicsError(
            f'drive has times of shape {time.shape}, speeds of {speed.shape} and loads of'
            f' {load.shape}: give one speed and one load for each time'
        )
    if time.size < 2:
        raise PhysicsError(f'drive has {time.size} samples: give at least two')
    for name, values in (('time', time), ('speed', speed), ('load', load)):
        bad = np.flatnonzero(~np.isfinite(values))
        if bad.size:
            raise PhysicsError(
                f'drive {name}[{bad[0]}] = {values[bad[0]]:g} must be a finite number'
            )
    back = np.flatnonzero(np.diff(time) <= 0.0)
    if back.size:
        index = int(back[0])
        raise PhysicsError(
            f'drive time[{index + 1}] = {time[index + 1]:g} s does not exceed time[{index}] ='
            f' {time[index]:g} s: times must rise strictly'
        )
    negative = np.flatnonzero(load < 0.0)
    if negative.size:
        index = int(negative[0])
        raise PhysicsError(f'drive load[{index}] = {load[index]:g} N must not be negative')


def _pieces(time: FloatArray, values: FloatArray, rule: str) -> FloatArray:
    pieces = np.zeros((time.size - 1, 4))
    pieces[:, 0] = values[:-1]
    if rule == 'linear':
        pieces[:, 1] = np.diff(values) / np.diff(time)
    elif rule == 'cubic':
        pieces[:, :] = PchipInterpolator(time, values).c[::-1].T
    return pieces


@dataclass(frozen=True, slots=True)
class Energy:
    """The energy accounts of a motion, each from its own integral over the motion.

    With the friction force ``F`` on the lining, ``d/dt (m x'^2 + k x^2)/2 = F x' - c x'^2``, and
    the belt's work ``F V`` is that on the lining and the heat ``F v``.

    Attributes:
        belt_work: ``integral F V dt``: work of the journal surface [J].
        friction_work: ``integral F x' dt``: work of friction on the lining [J].
        damping_loss: ``integral c x'^2 dt`` >= 0 [J].
        stored_before: Kinetic and spring energy at the begin [J].
        stored_after: The same at the end [J].
    """

    belt_work: float
    friction_work: float
    damping_loss: float
    stored_before: float
    stored_after: float

    @property
    def friction_heat(self) -> float:
        """``integral F v dt`` >= 0: heat in the contact [J]."""
        return self.belt_work - self.friction_work

    @property
    def stored_change(self) -> float:
        """Change of kinetic and spring energy [J]."""
        return self.stored_after - self.stored_before

    @property
    def closure(self) -> float:
        """What the balance misses, relative to what was exchanged and stored [-].

        It says nothing where that is rounding, as for a lining at rest without load.
        """
        missing = abs(self.friction_work - self.damping_loss - self.stored_change)
        turned = abs(self.friction_work) + self.damping_loss
        scale = turned + self.stored_before + self.stored_after
        if not scale < math.inf:
            return math.inf
        return missing / scale if scale > 0.0 else 0.0


def stored_energy(mass: float, stiffness: float, displacement: float, velocity: float) -> float:
    """``(m x'^2 + k x^2)/2`` [J] of displacement [m] and velocity [m/s]."""
    return 0.5 * (mass * velocity * velocity + stiffness * displacement * displacement)
