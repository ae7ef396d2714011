# SPDX-License-Identifier: Apache-2.0
"""Motion of the lining under speed and load that vary in time, from event to event.

``m x'' + c x' + k x = N(t) mu(V(t) - x')``, with friction set-valued at zero relative speed: the lining
sticks (``x' = V``) until the friction it needs, ``m V' + c V + k x``, exceeds ``mu_s N``; it slips forward
while the belt is faster (``v = V - x' > 0``) and backward while it is slower. The law is never smoothed:
every change of phase is located to rounding. A step is a power series of the time (:mod:`.slip_series`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum, IntEnum
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stickslip_monitor import jit
from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.errors import PhysicsError, require_finite, require_positive
from stickslip_monitor.physics import integrator_loops, series, slip_series
from stickslip_monitor.physics import scalar_law as scalars
from stickslip_monitor.physics.bearing import Bearing
from stickslip_monitor.physics.lubrication import as_measured
from stickslip_monitor.physics.scalar_law import law_bounds, scalar_law

Phases = NDArray[np.int8]


class Phase(IntEnum):
    """Sign of the relative speed ``v = V - x'``."""

    BACKWARD = -1
    STICK = 0
    FORWARD = 1


class MotionOutcome(Enum):
    """Outcomes of an integration, each with its sentence."""

    COMPLETE = 'the motion was followed to the end of the drive'
    EXHAUSTED = 'the motion needs more steps than its time scales allow for'
    NOT_FINITE = 'the motion grew beyond the range of floating-point numbers'


EXACT, FAST = 1e-13, 1e-10
"""Errors of a step of a slip phase relative to the speeds of belt and lining [-]."""


@dataclass(frozen=True, slots=True)
class MotionState:
    """The state of the lining.

    Args:
        displacement: ``x`` [m].
        relative_speed: ``v = V - x'`` [m/s].
        phase: Its phase; ``None`` for the one that follows from the numbers.
        trial: Unit of time of the step to try next [1/omega]; 0 for none yet.

    Raises:
        PhysicsError: A number is not finite, or the phase contradicts the relative speed.
    """

    displacement: float
    relative_speed: float
    phase: Phase | None = None
    trial: float = 0.0

    def __post_init__(self) -> None:
        require_finite('displacement', self.displacement, 'm')
        require_finite('relative_speed', self.relative_speed, 'm/s')
        if self.phase is Phase.STICK and self.relative_speed != 0.0:
            raise PhysicsError(
                f'relative_speed = {self.relative_speed:g} m/s must be 0 while the lining sticks'
            )

    @classmethod
    def moving(cls, displacement: float, velocity: float, drive: Drive) -> MotionState:
        """Make the state of a displacement [m] and the lining's velocity ``x'`` [m/s] as a drive begins.

        Its phase is ``None``: the one that follows from the numbers.

        Raises:
            PhysicsError: A number is not finite.
        """
        return cls(displacement, float(drive.speed[0]) - velocity)

    def scaled(self, scale: float) -> MotionState:
        """Return a copy with displacement and relative speed multiplied by ``scale`` > 0."""
        return MotionState(self.displacement * scale, self.relative_speed * scale, self.phase, self.trial)


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
        slip_steps: Those of slip phases.
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
    slip_steps: int
    span: tuple[float, float]

    @property
    def sticking(self) -> NDArray[np.bool_]:
        """Whether the lining sticks, shape (n,)."""
        return np.equal(self.phase, Phase.STICK)

    def scaled(self, scale: float) -> Motion:
        """Return a copy with displacements, speeds and accelerations multiplied by ``scale``; times stay.

        So are the states at start and end.
        """
        return replace(
            self,
            displacement=self.displacement * scale,
            velocity=self.velocity * scale,
            acceleration=self.acceleration * scale,
            relative_speed=self.relative_speed * scale,
            start=self.start.scaled(scale),
            final=self.final.scaled(scale),
        )


@dataclass(frozen=True, slots=True, eq=False)
class Drive:
    """Surface speed ``V`` and load ``N`` at rising times, joined by straight lines.

    Args:
        time: Rising times, shape (n,), at least two [s].
        speed: ``V`` at each, shape (n,) [m/s].
        load: ``N`` >= 0 at each, shape (n,) [N].

    Raises:
        PhysicsError: A sample breaks its rule.
    """

    time: FloatArray
    speed: FloatArray
    load: FloatArray

    def __post_init__(self) -> None:
        _check_grid(self.time, self.speed, self.load)

    @classmethod
    def constant(cls, speed: float, load: float, duration: float, start: float = 0.0) -> Drive:
        """Make a drive with one speed [m/s] and one load >= 0 [N] for a duration > 0 [s] from a start on [s].

        Raises:
            PhysicsError: A number breaks its rule.
        """
        return cls.sampled([start, start + duration], [speed] * 2, [load] * 2)

    @classmethod
    def sampled(cls, time: ArrayLike, speed: ArrayLike, load: ArrayLike) -> Drive:
        """Make a drive of sequences or arrays: times [s], speeds [m/s] and loads [N].

        Raises:
            PhysicsError: A sample breaks its rule.
        """
        return cls(*(np.asarray(column, dtype=float) for column in (time, speed, load)))

    @property
    def start(self) -> float:
        """Its first instant [s]."""
        return float(self.time[0])

    @property
    def end(self) -> float:
        """Its last instant [s]."""
        return float(self.time[-1])


def _check_grid(time: FloatArray, speed: FloatArray, load: FloatArray) -> None:
    """Raise ``PhysicsError`` where the arrays of a drive break the rules of :class:`Drive`."""
    if time.ndim != 1 or time.shape != speed.shape or time.shape != load.shape:
        raise PhysicsError(
            f'drive has times of shape {time.shape}, speeds of {speed.shape} and loads of'
            f' {load.shape}: give one speed and one load for each time'
        )
    if time.size < 2:
        raise PhysicsError(f'drive has {time.size} samples: give at least two')
    for name, values in (('time', time), ('speed', speed), ('load', load)):
        for index in np.flatnonzero(~np.isfinite(values)):
            raise PhysicsError(f'drive {name}[{index}] = {values[index]:g} must be a finite number')
    for index in np.flatnonzero(np.diff(time) <= 0.0):
        raise PhysicsError(
            f'drive time[{index + 1}] = {time[index + 1]:g} s does not exceed time[{index}] ='
            f' {time[index]:g} s: times must rise strictly'
        )
    for index in np.flatnonzero(load < 0.0):
        raise PhysicsError(f'drive load[{index}] = {load[index]:g} N must not be negative')


_OUTCOMES = {
    integrator_loops.DONE: MotionOutcome.COMPLETE,
    integrator_loops.EXHAUSTED: MotionOutcome.EXHAUSTED,
    integrator_loops.NOT_FINITE: MotionOutcome.NOT_FINITE,
}


def integrate(
    bearing: Bearing,
    drive: Drive,
    state: MotionState,
    times: ArrayLike = (),
    *,
    accuracy: float = EXACT,
    compiled: bool | None = None,
) -> Motion:
    """Follow the lining's motion through a drive.

    Friction that depends on the load is that of the load at the begin, for the whole drive.

    Args:
        bearing: The bearing.
        drive: Speed and load; its span is that of the motion.
        state: The state at its begin.
        times: Times of the samples, which do not fall, within the drive, shape (n,) [s]; none by default.
        accuracy: Error of a step of a slip phase relative to the speeds, > 0 [-].
        compiled: Whether numba compiles the inner loops; ``None`` for where it may be used. The results are
            the same.

    Returns:
        The motion. Where it could not be followed to the end, its ``outcome`` says why, and it has the
        samples up to there.

    Raises:
        PhysicsError: Sample times or accuracy break their rule, or numba was asked for and may not be used.
    """
    if bearing.lubrication is not None:
        scale = float(bearing.lubrication.scale(float(drive.load[0])))
        reference = Drive(drive.time, drive.speed / scale, drive.load / scale)
        state = state.scaled(1.0 / scale)
        motion = integrate(
            as_measured(bearing), reference, state, times, accuracy=accuracy, compiled=compiled
        )
        return motion.scaled(scale)
    at = np.atleast_1d(np.asarray(times, dtype=float))
    _check_times(at, drive)
    require_positive('accuracy', accuracy)
    law, use = scalar_law(bearing.friction), should_compile(compiled)
    body = _make_oscillator(bearing, drive, law.pieces, accuracy)

    def columns(kind: type, *values: Any) -> Any:
        """Return each sequence as the inner loops take it: an array of ``kind`` if compiled, else a list."""
        arrays: list[NDArray[Any]] = [
            np.ascontiguousarray(values_of_column, dtype=kind) for values_of_column in values
        ]
        return arrays if use else [array.tolist() for array in arrays]

    speed, load = (np.stack([x[:-1], np.diff(x) / np.diff(drive.time)]) for x in (drive.speed, drive.load))
    lines = integrator_loops.DriveLines(*columns(float, drive.time, *speed, *load))
    phase = _starting_phase(body, lines, state)
    out = columns(float, at, *np.zeros((4, at.size)))
    samples = integrator_loops.MotionSamples(*out, *columns(int, np.zeros(at.size)))
    room = np.zeros(4096)  # for transitions, before the loop returns to have the log emptied
    log = integrator_loops.TransitionLog(*columns(float, room), *columns(int, room))
    x, z = float(state.displacement), float(state.relative_speed)
    begun = (0, 0.0, 0.0, x, z, int(phase), float(state.trial), 0, 0, 0, 0, 0)
    now = integrator_loops.MarchState(integrator_loops.EVENTS_FULL, *begun)
    (work,) = columns(float, series.new_work())
    loop: Any = integrator_loops.march
    if use:
        modules = scalars, series, slip_series, integrator_loops
        loop = jit.compiled('march', *modules, law=law.module)
    law_numbers = law.compiled if use else law.plain
    instants: list[FloatArray] = []
    afters: list[Phases] = [np.array([phase], dtype=np.int8)]
    while now.status == integrator_loops.EVENTS_FULL:
        now = integrator_loops.MarchState(*loop(law_numbers, body, lines, now, samples, log, work))
        instants.append(np.array(log.time[: now.events], dtype=float))
        afters.append(np.array(log.phase[: now.events], dtype=np.int8))
        now = now._replace(events=0)
    after, count = np.concatenate(afters), now.cursor
    sampled = [np.array(column[:count], dtype=float) for column in samples[1:5]]
    return Motion(
        time=at[:count],
        displacement=sampled[0],
        velocity=sampled[1],
        acceleration=sampled[2],
        relative_speed=sampled[3],
        phase=np.array(samples.phase[:count], dtype=np.int8),
        transitions=Transitions(np.concatenate(instants), after[:-1], after[1:]),
        start=replace(state, phase=phase),
        final=MotionState(now.x, now.z, Phase(now.phase), now.trial),
        outcome=_OUTCOMES[now.status],
        steps=now.steps,
        slip_steps=now.slips,
        span=(drive.start, float(drive.time[now.piece]) + (now.time + now.rest)),
    )


def should_compile(compiled: bool | None) -> bool:
    """Return whether to compile: ``compiled``, or for ``None`` whether numba may be used.

    Raises:
        PhysicsError: ``compiled`` is true, and numba is not installed or the process is a live one.
    """
    if compiled and not jit.has_compiler():
        raise PhysicsError(
            'compiled = True needs numba, which is not installed: pip install numba, or leave compiled out'
        )
    return jit.has_compiler() if compiled is None else compiled


def _check_times(times: FloatArray, drive: Drive) -> None:
    """Check the sample times [s] of a simulation.

    Raises:
        PhysicsError: The times are not one-dimensional, not finite, decrease, or lie outside the drive.
    """
    if times.ndim != 1 or not np.isfinite(times).all() or np.any(np.diff(times) < 0.0):
        raise PhysicsError('times must be one row of finite numbers that do not fall')
    if times.size and (times[0] < drive.start or times[-1] > drive.end):
        raise PhysicsError(
            f'times from {times[0]:g} to {times[-1]:g} s must lie within the drive, from'
            f' {drive.start:g} to {drive.end:g} s'
        )


def _make_oscillator(
    bearing: Bearing, drive: Drive, pieces: int, accuracy: float
) -> integrator_loops.Oscillator:
    """Return the oscillator; its limit of steps is several times what its fastest time scale can need.

    Args:
        bearing: The bearing.
        drive: Speed and load, of which duration, size and largest load count.
        pieces: Number of pieces of the law, which make steps short; 0 for a law that is whole.
        accuracy: Error of a step, as of :func:`integrate`.
    """
    bounds = law_bounds(bearing.friction)
    fastest = bearing.natural_frequency + bearing.damping / bearing.mass
    fastest += float(np.max(drive.load)) * bounds.steepest / bearing.mass
    steps = (drive.end - drive.start) * fastest / min(accuracy**0.125, 1.0)
    limit = int(min((1000.0 + 4.0 * (drive.time.size + steps)) * (pieces + 1), 2.0**62))
    damping = 2.0 * bearing.damping_ratio
    held = bounds.hold, bounds.top
    return integrator_loops.Oscillator(
        bearing.natural_frequency, damping, bearing.momentum, *held, accuracy, limit
    )


def _starting_phase(
    body: integrator_loops.Oscillator, lines: integrator_loops.DriveLines, state: MotionState
) -> Phase:
    """Return the phase in which the motion begins: that of the state if it has one, else by its motion."""
    if state.phase is not None:
        return state.phase
    if state.relative_speed != 0.0:
        return Phase.FORWARD if state.relative_speed > 0.0 else Phase.BACKWARD
    medium = integrator_loops.medium_at(body, lines, 0, 0.0, 1.0)
    return Phase(integrator_loops.phase_after_contact(body, medium, body.omega * state.displacement, 0))
