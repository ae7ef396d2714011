# SPDX-License-Identifier: Apache-2.0
"""Motion of the lining under speed and load that vary in time, from event to event.

``m x'' + c x' + k x = N(t) mu(V(t) - x')``, with friction set-valued at zero relative speed: the
lining sticks (``x' = V``) until the friction it needs, ``m V' + c V + k x``, exceeds ``mu_s N``;
it slips forward while the belt is faster (``v = V - x' > 0``) and backward while it is slower.
The law is never smoothed: every change of phase is located to rounding.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.errors import PhysicsError
from stickslip_monitor.physics.motion import kernel
from stickslip_monitor.physics.motion import step_series as layout
from stickslip_monitor.physics.motion.compiled import is_compiled, march_function, vector
from stickslip_monitor.physics.motion.kernel_law import KernelLaw, kernel_law
from stickslip_monitor.physics.motion.motion import (
    EXACT,
    FAST,
    Accuracy,
    Drive,
    Energy,
    Motion,
    MotionOutcome,
    MotionState,
    Phase,
    PhaseChange,
    Phases,
    Transitions,
    stored_energy,
)
from stickslip_monitor.physics.oscillator import Bearing

__all__ = [
    'EXACT',
    'FAST',
    'Accuracy',
    'Drive',
    'Energy',
    'Motion',
    'MotionOutcome',
    'MotionState',
    'Phase',
    'PhaseChange',
    'Transitions',
    'integrate',
    'integrate_blocks',
]

# Transitions that the inner loops log before they return to have the log emptied.
_LOG = 4096
_OUTCOMES = {
    layout.DONE: MotionOutcome.COMPLETE,
    layout.EXHAUSTED: MotionOutcome.EXHAUSTED,
    layout.NOT_FINITE: MotionOutcome.NOT_FINITE,
}


def integrate(
    bearing: Bearing,
    drive: Drive,
    state: MotionState,
    times: ArrayLike = (),
    *,
    accuracy: Accuracy = EXACT,
    energy: bool = False,
    compiled: bool | None = None,
) -> Motion:
    """Follow the lining's motion through a drive.

    Args:
        bearing: The bearing.
        drive: Speed and load; its span is that of the motion.
        state: The state at its begin.
        times: Times of the samples, which do not fall, within the drive, shape (n,) [s].
        accuracy: Of the steps.
        energy: Whether to keep the energy accounts, for a third (compiled) to twice (in Python)
            the computing time.
        compiled: Whether numba compiles the inner loops; by default, where it is installed. The
            results are the same.

    Raises:
        PhysicsError: Sample times break their rule, the law cannot be integrated, or numba was
            asked for and is missing.
    """
    at = np.atleast_1d(np.asarray(times, dtype=float))
    _check_times(at, drive)
    run = _Run(bearing, drive, state, at, accuracy, is_compiled(compiled))
    return run.motion(run.march(energy), energy)


def integrate_blocks(
    bearing: Bearing,
    blocks: Iterable[tuple[Drive, ArrayLike]],
    state: MotionState,
    *,
    accuracy: Accuracy = EXACT,
    energy: bool = False,
    compiled: bool | None = None,
) -> Iterator[Motion]:
    """Follow a long motion block by block, in memory bounded by the longest block.

    Cutting a drive between two of its pieces changes no bit of the motion; a cut within a piece
    changes it as the accuracy of the steps allows.

    Args:
        bearing: The bearing.
        blocks: Each a drive that begins where the one before ended, and its sample times [s].
        state: The state at the first begin.
        accuracy: See :func:`integrate`.
        energy: See :func:`integrate`.
        compiled: See :func:`integrate`.

    Yields:
        The motion of each block; the last is the first that is not ``COMPLETE``.

    Raises:
        PhysicsError: As :func:`integrate` does.
    """
    for drive, times in blocks:
        motion = integrate(
            bearing, drive, state, times, accuracy=accuracy, energy=energy, compiled=compiled
        )
        yield motion
        if motion.outcome is not MotionOutcome.COMPLETE:
            return
        state = motion.final


def _check_times(times: FloatArray, drive: Drive) -> None:
    if times.ndim != 1 or not np.isfinite(times).all() or np.any(np.diff(times) < 0.0):
        raise PhysicsError('times must be one row of finite numbers that do not fall')
    if times.size and (times[0] < drive.start or times[-1] > drive.end):
        raise PhysicsError(
            f'times from {times[0]:g} to {times[-1]:g} s must lie within the drive, from'
            f' {drive.start:g} to {drive.end:g} s'
        )


def _body(bearing: Bearing, law: KernelLaw, accuracy: Accuracy) -> list[float]:
    body = [0.0] * layout.BODY
    body[layout.MASS] = bearing.mass
    body[layout.DAMPING] = bearing.damping
    body[layout.STIFFNESS] = bearing.stiffness
    body[layout.OMEGA] = bearing.natural_frequency
    body[layout.HOLD] = law.hold
    body[layout.TOLERANCE] = accuracy.tolerance
    body[layout.LONGEST] = accuracy.longest
    return body


def _options(bearing: Bearing, drive: Drive, law: KernelLaw, accuracy: Accuracy) -> list[int]:
    options = [0] * layout.OPTIONS
    options[layout.ORDER] = accuracy.order
    options[layout.STEP_LIMIT] = _step_limit(bearing, drive, law, accuracy)
    options[layout.EVENT_LIMIT] = _LOG
    options[layout.CUBIC] = int(law.is_cubic)
    return options


def _step_limit(bearing: Bearing, drive: Drive, law: KernelLaw, accuracy: Accuracy) -> int:
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
    work: layout.Rows = [[0.0] * 4 for _ in range(layout.WORK)]
    work[layout.XS][0] = state.displacement
    work[layout.BELT_SPEED][:] = drive.speed[0].tolist()
    work[layout.LOAD][:] = drive.load[0].tolist()
    return Phase(kernel.phase_at_rest(0, body, work))


def _where(law: KernelLaw, start: MotionState) -> list[int]:
    where = [0] * layout.WHERE
    where[layout.PHASE] = int(start.phase or 0)
    piece = np.searchsorted(law.edges, abs(start.relative_speed), side='right') - 1
    where[layout.LAW_PIECE] = int(piece)
    return where


class _Run:
    """One motion, as the arrays that the inner loops work on."""

    def __init__(
        self,
        bearing: Bearing,
        drive: Drive,
        state: MotionState,
        times: FloatArray,
        accuracy: Accuracy,
        compiled: bool,
    ) -> None:
        law = kernel_law(bearing.friction)
        body = _body(bearing, law, accuracy)
        phase = _starting_phase(body, drive, state)
        self.bearing, self.drive, self.times = bearing, drive, times
        self.start = MotionState(state.displacement, state.relative_speed, phase)
        self.function = march_function(compiled)
        self.logs: list[FloatArray] = []
        self.afters: list[Phases] = []

        def numbers(values: Any, kind: type = float) -> Any:
            return vector(values, compiled, kind)

        self.inputs = (
            numbers(drive.time),
            numbers(drive.speed.ravel()),
            numbers(drive.load.ravel()),
            numbers(body),
            numbers(law.exponential),
            numbers(law.edges),
            numbers(law.cubics.ravel()),
        )
        self.options = numbers(_options(bearing, drive, law, accuracy), int)
        self.state = numbers([state.displacement, state.relative_speed, 0.0, 0.0])
        self.where = numbers(_where(law, self.start), int)
        self.sampled = numbers(times)
        self.out = numbers(np.zeros((4, times.size)))
        self.phases = numbers(np.zeros(times.size), np.int8)
        self.log = numbers(np.zeros(_LOG))
        self.kinds = numbers(np.zeros(_LOG), np.int8)
        self.sums = numbers(np.zeros(layout.SUMS))
        columns = max(accuracy.order, layout.STICK_DEGREE) + 2
        self.work = numbers(np.zeros((layout.WORK, columns)))

    def march(self, energy: bool) -> MotionOutcome:
        """Run the inner loops, emptying the log of transitions whenever it is full."""
        self.options[layout.WITH_ENERGY] = int(energy)
        status = layout.EVENTS_FULL
        while status == layout.EVENTS_FULL:
            status = self.function(
                *self.inputs,
                self.options,
                self.state,
                self.where,
                self.sampled,
                self.out,
                self.phases,
                self.log,
                self.kinds,
                self.sums,
                self.work,
            )
            count = int(self.where[layout.EVENTS])
            self.logs.append(np.array(self.log[:count], dtype=float))
            self.afters.append(np.array(self.kinds[:count], dtype=np.int8))
            self.where[layout.EVENTS] = 0
        return _OUTCOMES[status]

    def motion(self, outcome: MotionOutcome, energy: bool) -> Motion:
        """What was found."""
        count = int(self.where[layout.CURSOR])
        out = np.array(self.out, dtype=float).reshape(4, -1)[:, :count]
        phase = Phase(int(self.where[layout.PHASE]))
        final = MotionState(float(self.state[layout.X]), float(self.state[layout.V]), phase)
        return Motion(
            time=self.times[:count],
            displacement=out[0],
            velocity=out[1],
            acceleration=out[2],
            relative_speed=out[3],
            phase=np.array(self.phases[:count], dtype=np.int8),
            transitions=self._transitions(),
            energy=self._accounts(final) if energy else None,
            start=self.start,
            final=final,
            outcome=outcome,
            steps=int(self.where[layout.STEPS]),
            expansions=int(self.where[layout.EXPANSIONS]),
            span=(self.drive.start, self._end()),
        )

    def _end(self) -> float:
        piece = int(self.where[layout.PIECE])
        within = float(self.state[layout.TIME]) + float(self.state[layout.TIME_REST])
        return float(self.drive.time[piece]) + within

    def _transitions(self) -> Transitions:
        after = np.concatenate(self.afters)
        before = np.append(np.int8(self.start.phase or 0), after)[: after.size]
        return Transitions(np.concatenate(self.logs), before, after)

    def _accounts(self, final: MotionState) -> Energy:
        m, k = self.bearing.mass, self.bearing.stiffness
        belt, friction, loss = (
            float(self.sums[i]) + float(self.sums[i + 1])
            for i in (layout.BELT, layout.FRICTION, layout.LOSS)
        )
        first = self.drive.speed_at(self.drive.start) - self.start.relative_speed
        last = self.drive.speed_at(self._end()) - final.relative_speed
        before = stored_energy(m, k, self.start.displacement, first)
        after = stored_energy(m, k, final.displacement, last)
        return Energy(belt, friction, loss, before, after)
