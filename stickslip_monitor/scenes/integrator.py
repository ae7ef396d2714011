# SPDX-License-Identifier: Apache-2.0
"""Motion of the lining under speed and load that vary in time, from event to event.

``m x'' + c x' + k x = N(t) mu(V(t) - x')``, with friction set-valued at zero relative speed: the
lining sticks (``x' = V``) until the friction it needs, ``m V' + c V + k x``, exceeds ``mu_s N``;
it slips forward while the belt is faster (``v = V - x' > 0``) and backward while it is slower.
The law is never smoothed: every change of phase is located to rounding.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, IntEnum
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stickslip_monitor.errors import PhysicsError
from stickslip_monitor.physics.friction import Array
from stickslip_monitor.physics.oscillator import Bearing
from stickslip_monitor.physics.rules import require_finite, require_positive

from . import integrator_kernel as kernel
from .energy import Energy, stored_energy
from .integrator_compile import is_compiled, march_function, vector
from .integrator_drive import Drive
from .integrator_law import KernelLaw, kernel_law

__all__ = [
    'EXACT',
    'FAST',
    'Accuracy',
    'Change',
    'Drive',
    'Energy',
    'Motion',
    'Outcome',
    'Phase',
    'State',
    'Transitions',
    'integrate',
]

Phases = NDArray[np.int8]
_EVENTS = 4096


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


_OUTCOMES = {
    kernel.DONE: Outcome.COMPLETE,
    kernel.EXHAUSTED: Outcome.EXHAUSTED,
    kernel.NOT_FINITE: Outcome.NOT_FINITE,
}


@dataclass(frozen=True, slots=True)
class Accuracy:
    """How accurate the steps of the slip phases are.

    Args:
        tolerance: Error of a step relative to displacement and speed, > 0 [-].
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


EXACT = Accuracy(1e-13, 18)
FAST = Accuracy(1e-9, 14)


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


def integrate(
    bearing: Bearing,
    drive: Drive,
    state: State,
    times: ArrayLike = (),
    *,
    accuracy: Accuracy = EXACT,
    energy: bool = False,
    compiled: bool | None = None,
) -> Motion:
    """Follow the lining's motion through a drive.

    A long motion is followed drive by drive, each from the ``final`` state before, in memory
    bounded by the longest; cutting a drive between two of its pieces changes no bit of it.

    Args:
        bearing: The bearing.
        drive: Speed and load; its span is that of the motion.
        state: The state at its begin.
        times: Rising times of the samples, within the drive, shape (n,) [s].
        accuracy: Of the steps.
        energy: Whether to keep the energy accounts (half as much again of computing time).
        compiled: Whether numba compiles the inner loops; by default, where it is installed. The
            results are the same.

    Raises:
        PhysicsError: Sample times break their rule, a law cannot be integrated, or numba was
            asked for and is missing.
    """
    at = np.atleast_1d(np.asarray(times, dtype=float))
    _check_times(at, drive)
    run = _Run(bearing, drive, state, at, accuracy, energy, is_compiled(compiled))
    return run.motion(run.march())


def _check_times(times: Array, drive: Drive) -> None:
    if times.ndim != 1 or not np.isfinite(times).all() or np.any(np.diff(times) < 0.0):
        raise PhysicsError('times must be one row of finite numbers that do not fall')
    if times.size and (times[0] < drive.start or times[-1] > drive.end):
        raise PhysicsError(
            f'times from {times[0]:g} to {times[-1]:g} s must lie within the drive, from'
            f' {drive.start:g} to {drive.end:g} s'
        )


def _body(bearing: Bearing, law: KernelLaw, accuracy: Accuracy) -> list[float]:
    body = [0.0] * kernel.BODY
    body[kernel.MASS] = bearing.mass
    body[kernel.DAMPING] = bearing.damping
    body[kernel.STIFFNESS] = bearing.stiffness
    body[kernel.OMEGA] = bearing.natural_frequency
    body[kernel.HOLD] = law.hold
    body[kernel.TOLERANCE] = accuracy.tolerance
    body[kernel.LONGEST] = accuracy.longest
    return body


def _step_limit(bearing: Bearing, drive: Drive, law: KernelLaw, accuracy: Accuracy) -> int:
    """Far more steps than the fastest time scale of the motion can need."""
    fastest = bearing.natural_frequency + bearing.damping / bearing.mass
    fastest += drive.largest_load * law.steepest / bearing.mass
    shortest = min(accuracy.tolerance ** (1.0 / accuracy.order), accuracy.longest, 1.0)
    periods = (drive.end - drive.start) * fastest / shortest
    limit = (1000.0 + 40.0 * (drive.time.size + periods)) * law.edges.size
    return int(min(limit, 2.0**62))


def _starting_phase(body: list[float], drive: Drive, state: State) -> Phase:
    if state.phase is not None:
        return state.phase
    if state.relative_speed != 0.0:
        return Phase.FORWARD if state.relative_speed > 0.0 else Phase.BACKWARD
    work = [[0.0] * 4 for _ in range(kernel.WORK)]
    work[kernel.XS][0] = state.displacement
    work[kernel.BELT_SPEED][:] = drive.speed[0].tolist()
    work[kernel.LOAD][:] = drive.load[0].tolist()
    return Phase(kernel.phase_at_rest(0, body, work))


class _Run:
    """The arrays that the inner loops work on."""

    def __init__(
        self,
        bearing: Bearing,
        drive: Drive,
        state: State,
        times: Array,
        accuracy: Accuracy,
        energy: bool,
        compiled: bool,
    ) -> None:
        law = kernel_law(bearing.friction)
        body = _body(bearing, law, accuracy)
        self.bearing, self.drive, self.times, self.energy = bearing, drive, times, energy
        phase = _starting_phase(body, drive, state)
        self.start = State(state.displacement, state.relative_speed, phase)
        options, where = [0] * kernel.OPTIONS, [0] * kernel.WHERE
        options[kernel.ORDER] = accuracy.order
        options[kernel.STEP_LIMIT] = _step_limit(bearing, drive, law, accuracy)
        options[kernel.EVENT_LIMIT] = _EVENTS
        options[kernel.WITH_ENERGY] = int(energy)
        options[kernel.CUBIC] = int(law.is_cubic)
        where[kernel.PHASE] = int(phase)
        piece = np.searchsorted(law.edges, abs(state.relative_speed), side='right') - 1
        where[kernel.LAW_PIECE] = int(piece)
        columns = max(accuracy.order, kernel.STICK_DEGREE) + 2

        def numbers(values: Any, kind: type = float) -> Any:
            return vector(values, compiled, kind)

        self.state = numbers([state.displacement, state.relative_speed, 0.0, 0.0])
        self.where = numbers(where, int)
        self.out = numbers(np.zeros((4, times.size)))
        self.phases = numbers(np.zeros(times.size), np.int8)
        self.log = numbers(np.zeros(_EVENTS + 1))
        self.kinds = numbers(np.zeros(_EVENTS + 1), np.int8)
        self.sums = numbers(np.zeros(kernel.SUMS))
        self.inputs = (
            numbers(drive.time),
            numbers(drive.speed.ravel()),
            numbers(drive.load.ravel()),
            numbers(body),
            numbers(law.exponential),
            numbers(law.edges),
            numbers(law.cubics.ravel()),
            numbers(options, int),
        )
        self.scratch = numbers(np.zeros((kernel.WORK, columns)))
        self.sampled = numbers(times)
        self.function = march_function(compiled)
        self.logs: list[Array] = []
        self.afters: list[Phases] = []

    def march(self) -> Outcome:
        """Run the inner loops, emptying the log of transitions whenever it is full."""
        status = kernel.EVENTS_FULL
        while status == kernel.EVENTS_FULL:
            status = self.function(
                *self.inputs,
                self.state,
                self.where,
                self.sampled,
                self.out,
                self.phases,
                self.log,
                self.kinds,
                self.sums,
                self.scratch,
            )
            count = int(self.where[kernel.EVENTS])
            self.logs.append(np.array(self.log[:count], dtype=float))
            self.afters.append(np.array(self.kinds[:count], dtype=np.int8))
            self.where[kernel.EVENTS] = 0
        return _OUTCOMES[status]

    def motion(self, outcome: Outcome) -> Motion:
        """What was found."""
        count = int(self.where[kernel.CURSOR])
        out = np.array(self.out, dtype=float).reshape(4, -1)[:, :count]
        phase = Phase(int(self.where[kernel.PHASE]))
        final = State(float(self.state[kernel.X]), float(self.state[kernel.V]), phase)
        return Motion(
            self.times[:count],
            *out,
            np.array(self.phases[:count], dtype=np.int8),
            self._transitions(),
            self._accounts(final) if self.energy else None,
            self.start,
            final,
            outcome,
            int(self.where[kernel.STEPS]),
            int(self.where[kernel.EXPANSIONS]),
            (self.drive.start, self._end()),
        )

    def _end(self) -> float:
        piece = int(self.where[kernel.PIECE])
        within = float(self.state[kernel.TIME]) + float(self.state[kernel.TIME_REST])
        return float(self.drive.time[piece]) + within

    def _transitions(self) -> Transitions:
        after = np.concatenate(self.afters)
        before = np.append(np.int8(int(self.start.phase or 0)), after)[: after.size]
        return Transitions(np.concatenate(self.logs), before.astype(np.int8), after)

    def _accounts(self, final: State) -> Energy:
        m, k = self.bearing.mass, self.bearing.stiffness
        sums = [float(self.sums[i]) + float(self.sums[i + 1]) for i in range(0, kernel.SUMS, 2)]
        end = self._end()
        piece = min(int(self.where[kernel.PIECE]), self.drive.speed.shape[0] - 1)
        speed = float(np.polyval(self.drive.speed[piece, ::-1], end - self.drive.time[piece]))
        first = float(self.drive.speed[0, 0]) - self.start.relative_speed
        before = stored_energy(m, k, self.start.displacement, first)
        after = stored_energy(m, k, final.displacement, speed - final.relative_speed)
        return Energy(sums[0], sums[1], sums[2], before, after)
