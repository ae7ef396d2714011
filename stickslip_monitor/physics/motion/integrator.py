# SPDX-License-Identifier: Apache-2.0
"""Motion of the lining under speed and load that vary in time, from event to event.

``m x'' + c x' + k x = N(t) mu(V(t) - x')``, with friction set-valued at zero relative speed: the
lining sticks (``x' = V``) until the friction it needs, ``m V' + c V + k x``, exceeds ``mu_s N``;
it slips forward while the belt is faster (``v = V - x' > 0``) and backward while it is slower.
The law is never smoothed: every change of phase is located to rounding.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum, IntEnum
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stickslip_monitor import jit
from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.errors import PhysicsError
from stickslip_monitor.physics.friction import require_finite, require_positive
from stickslip_monitor.physics.law_numbers import SeriesLaw, series_law
from stickslip_monitor.physics.motion import kernel, polynomial
from stickslip_monitor.physics.oscillator import Bearing

Phases = NDArray[np.int8]


class Phase(IntEnum):
    """Sign of the relative speed ``v = V - x'``."""

    BACKWARD = -1
    STICK = 0
    FORWARD = 1


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


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """A motion of the lining: samples and transitions.

    Attributes:
        time: Times of the samples, shape (n,) [s].
        displacement: ``x``, shape (n,) [m].
        velocity: ``x'``, shape (n,) [m/s].
        acceleration: ``x''``, shape (n,) [m/s^2]; at a transition that before it.
        relative_speed: ``v = V - x'``, shape (n,) [m/s].
        phase: :class:`Phase`, shape (n,).
        transitions: The changes of phase.
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
    def sampled(cls, time: ArrayLike, speed: ArrayLike, load: ArrayLike) -> Drive:
        """Samples on a grid of times, joined by straight lines.

        Args:
            time: Rising times, shape (n,), at least two [s].
            speed: ``V`` at each, shape (n,) [m/s].
            load: ``N`` >= 0 at each, shape (n,) [N].

        Raises:
            PhysicsError: A sample breaks its rule.
        """
        t = np.asarray(time, dtype=float)
        v, n = np.asarray(speed, dtype=float), np.asarray(load, dtype=float)
        _check_grid(t, v, n)
        return cls(t, _lines(t, v), _lines(t, n))

    @property
    def start(self) -> float:
        """Its first instant [s]."""
        return float(self.time[0])

    @property
    def end(self) -> float:
        """Its last instant [s]."""
        return float(self.time[-1])

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


def _lines(time: FloatArray, values: FloatArray) -> FloatArray:
    pieces = np.zeros((time.size - 1, 4))
    pieces[:, 0] = values[:-1]
    pieces[:, 1] = np.diff(values) / np.diff(time)
    return pieces


# Transitions that the inner loops log before they return to have the log emptied.
_LOG = 4096
_OUTCOMES = {
    kernel.DONE: MotionOutcome.COMPLETE,
    kernel.EXHAUSTED: MotionOutcome.EXHAUSTED,
    kernel.NOT_FINITE: MotionOutcome.NOT_FINITE,
}


def integrate(
    bearing: Bearing,
    drive: Drive,
    state: MotionState,
    times: ArrayLike = (),
    *,
    accuracy: Accuracy = EXACT,
    compiled: bool | None = None,
) -> Motion:
    """Follow the lining's motion through a drive.

    Args:
        bearing: The bearing.
        drive: Speed and load; its span is that of the motion.
        state: The state at its begin.
        times: Times of the samples, which do not fall, within the drive, shape (n,) [s].
        accuracy: Of the steps.
        compiled: Whether numba compiles the inner loops; by default, where it is installed. The
            results are the same.

    Raises:
        PhysicsError: Sample times break their rule, the law cannot be integrated, or numba was
            asked for and is missing.
    """
    at = np.atleast_1d(np.asarray(times, dtype=float))
    _check_times(at, drive)
    use, law = is_compiled(compiled), series_law(bearing.friction)
    # In the order of the kernel's names.
    body = [bearing.mass, bearing.damping, bearing.stiffness, bearing.natural_frequency]
    body += [law.hold, accuracy.tolerance, accuracy.longest]
    limit = _step_limit(bearing, drive, law, accuracy)
    phase = _starting_phase(body, drive, state)
    start = MotionState(state.displacement, state.relative_speed, phase)
    piece = int(np.searchsorted(law.edges, abs(state.relative_speed), side='right')) - 1

    def numbers(values: Any, kind: type = float) -> Any:
        """What the inner loops take: an array if compiled, else lists, which are fast then."""
        array: NDArray[Any] = np.ascontiguousarray(values, dtype=kind)
        return array if use else array.tolist()

    inputs = [drive.time, drive.speed.ravel(), drive.load.ravel(), body]
    inputs += [law.exponential, law.edges, law.cubics.ravel()]
    options = numbers([accuracy.order, limit, _LOG, int(law.is_cubic)], int)
    now = numbers([state.displacement, state.relative_speed, 0.0, 0.0])
    where = numbers([0, int(phase), piece, 0, 0, 0, 0, 0], int)
    out, phases = numbers(np.zeros((4, at.size))), numbers(np.zeros(at.size), np.int8)
    log, kinds = numbers(np.zeros(_LOG)), numbers(np.zeros(_LOG), np.int8)
    columns = max(accuracy.order, kernel.STICK_DEGREE) + 2
    work = numbers(np.zeros((kernel.WORK, columns)))
    # So short functions cost a third of the time in calls: they are copied into one another.
    march: Callable[..., int] = kernel.march
    if use:
        march = jit.compiled('march', polynomial, kernel)
    arguments = (*map(numbers, inputs), options, now, where, numbers(at), out, phases)
    instants: list[FloatArray] = []
    afters: list[Phases] = [np.array([phase], dtype=np.int8)]
    status = kernel.EVENTS_FULL
    while status == kernel.EVENTS_FULL:
        status = march(*arguments, log, kinds, work)
        count = int(where[kernel.EVENTS])
        instants.append(np.array(log[:count], dtype=float))
        afters.append(np.array(kinds[:count], dtype=np.int8))
        where[kernel.EVENTS] = 0
    count, after = int(where[kernel.CURSOR]), np.concatenate(afters)
    sampled = np.array(out, dtype=float).reshape(4, -1)[:, :count]
    within = float(now[kernel.TIME]) + float(now[kernel.TIME_REST])
    last = Phase(int(where[kernel.PHASE]))
    return Motion(
        time=at[:count],
        displacement=sampled[0],
        velocity=sampled[1],
        acceleration=sampled[2],
        relative_speed=sampled[3],
        phase=np.array(phases[:count], dtype=np.int8),
        transitions=Transitions(np.concatenate(instants), after[:-1], after[1:]),
        start=start,
        final=MotionState(float(now[kernel.X]), float(now[kernel.V]), last),
        outcome=_OUTCOMES[status],
        steps=int(where[kernel.STEPS]),
        expansions=int(where[kernel.EXPANSIONS]),
        span=(drive.start, float(drive.time[int(where[kernel.PIECE])]) + within),
    )


def is_compiled(compiled: bool | None) -> bool:
    """Whether to compile: as asked for, or where numba is installed.

    Raises:
        PhysicsError: It was asked for and numba is not installed.
    """
    if compiled and not jit.has_compiler():
        raise PhysicsError(
            'compiled = True needs numba, which is not installed: pip install'
            " 'stickslip_monitor[sim]', or leave compiled out"
        )
    return jit.has_compiler() if compiled is None else compiled


def _check_times(times: FloatArray, drive: Drive) -> None:
    if times.ndim != 1 or not np.isfinite(times).all() or np.any(np.diff(times) < 0.0):
        raise PhysicsError('times must be one row of finite numbers that do not fall')
    if times.size and (times[0] < drive.start or times[-1] > drive.end):
        raise PhysicsError(
            f'times from {times[0]:g} to {times[-1]:g} s must lie within the drive, from'
            f' {drive.start:g} to {drive.end:g} s'
        )


def _step_limit(bearing: Bearing, drive: Drive, law: SeriesLaw, accuracy: Accuracy) -> int:
    """Several times the steps that the fastest time scale of the motion can need."""
    fastest = bearing.natural_frequency + bearing.damping / bearing.mass
    fastest += drive.largest_load * law.steepest / bearing.mass
    shortest = min(accuracy.tolerance ** (1.0 / accuracy.order), accuracy.longest, 1.0)
    steps = (drive.end - drive.start) * fastest / shortest
    limit = (1000.0 + 4.0 * (drive.time.size + steps)) * law.edges.size
    return int(min(limit, 2.0**62))


def _starting_phase(body: list[float], drive: Drive, state: MotionState) -> Phase:
    if state.phase is not None:
        return state.phase
    if state.relative_speed != 0.0:
        return Phase.FORWARD if state.relative_speed > 0.0 else Phase.BACKWARD
    work: kernel.Rows = [[0.0] * 4 for _ in range(kernel.WORK)]
    work[kernel.XS][0] = state.displacement
    work[kernel.BELT_SPEED][:] = drive.speed[0].tolist()
    work[kernel.LOAD][:] = drive.load[0].tolist()
    return Phase(kernel.phase_at_rest(0, body, work))
