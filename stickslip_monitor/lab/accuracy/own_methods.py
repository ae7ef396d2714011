# SPDX-License-Identifier: Apache-2.0
"""The project's own methods: averaging, the exact cycle, its surface, and the integrator."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from stickslip_monitor.arrays import BoolArray, FloatArray
from stickslip_monitor.lab.accuracy.method import (
    MethodOutcome,
    MethodResult,
    breakaway,
    found,
    typical_period,
)
from stickslip_monitor.physics.averaging.boundaries import fold_speed, stationary_amplitudes
from stickslip_monitor.physics.cycle.cycles import CycleKind, exact_cycle
from stickslip_monitor.physics.cycle.surface import surface_of
from stickslip_monitor.physics.friction import Coulomb, Stribeck, Tabulated
from stickslip_monitor.physics.oscillator import Bearing


@dataclass(frozen=True, slots=True)
class Averaging:
    """Averaging as the monitor does it.

    Args:
        points: Operating points solved in one call; their common cost is shared.
    """

    points: int = 1
    family: str = 'KBM'
    slow: bool = False
    practice: str = (
        'First-order averaging of a harmonic motion; the amplitude balance is solved from its'
        ' closed form for the Stribeck law, by quadrature for laws without one.'
    )
    source: str = 'Bogoliubov and Mitropolsky, Asymptotic Methods (1961), ch. 1; PHYSICS.md'

    @property
    def name(self) -> str:
        """See :class:`~.method.Method`."""
        return 'KBM' if self.points == 1 else f'KBM, {self.points} at once'

    def refusal(self, bearing: Bearing, speed: float, load: float) -> str:
        """It applies everywhere."""
        return ''

    def amplitude(self, bearing: Bearing, speed: float, load: float) -> MethodResult:
        """See :class:`~.method.Method`."""
        speeds = speed if self.points == 1 else np.full(self.points, speed)
        cycles = stationary_amplitudes(bearing, speeds, load)
        first = (0,) * (cycles.amplitude.ndim - 1)
        stable = cycles.amplitude[first][cycles.stable[first]]
        closed = isinstance(bearing.friction, Stribeck)
        largest = float(stable[-1]) if stable.size else math.nan
        return found(largest, 0 if closed else None)


@dataclass(frozen=True, slots=True)
class ExactCycle:
    """One slip phase from breakaway, the law set-valued, contact located to rounding.

    Args:
        points: Operating points solved in one call; their common cost is shared.
    """

    points: int = 1
    family: str = 'exact cycle'
    slow: bool = False
    practice: str = (
        'One slip phase from breakaway to the next contact with the belt; the stick phase is a'
        ' straight line. Nothing is averaged, smoothed or waited for.'
    )
    source: str = 'this project, physics/cycle/cycles.py; Filippov (1988) for the set-valued law'

    @property
    def name(self) -> str:
        """See :class:`~.method.Method`."""
        return 'exact cycle' if self.points == 1 else f'exact cycle, {self.points} at once'

    def refusal(self, bearing: Bearing, speed: float, load: float) -> str:
        """It applies everywhere."""
        return ''

    def amplitude(self, bearing: Bearing, speed: float, load: float) -> MethodResult:
        """See :class:`~.method.Method`."""
        speeds = speed if self.points == 1 else np.full(self.points, speed)
        cycle = exact_cycle(bearing, speeds, load)
        amplitude = float(np.ravel(cycle.amplitude)[0])
        if np.ravel(cycle.kind)[0] == CycleKind.UNRESOLVED:
            return MethodResult(amplitude, MethodOutcome.NOT_CONVERGED, None)
        return found(amplitude, None)


@dataclass(frozen=True, slots=True)
class Surface:
    """Polynomials through exact cycles of the bearing, built before.

    Args:
        points: Operating points looked up in one call; their common cost is shared.
    """

    points: int = 1
    family: str = 'surface'
    slow: bool = False
    practice: str = (
        'Exact cycles over a range of speeds and loads, computed once for each bearing and'
        ' interpolated in coordinates that move with the fold.'
    )
    source: str = 'this project, physics/cycle/surface.py'

    @property
    def name(self) -> str:
        """See :class:`~.method.Method`."""
        return 'surface' if self.points == 1 else f'surface, {self.points} at once'

    def refusal(self, bearing: Bearing, speed: float, load: float) -> str:
        """Points that the surface does not reach."""
        surface_of(bearing).prepare()
        _, known = _lookup(bearing, np.array([speed]), np.array([load]))
        return '' if known[0] else 'the surface does not reach this speed, load and law'

    def amplitude(self, bearing: Bearing, speed: float, load: float) -> MethodResult:
        """See :class:`~.method.Method`."""
        amplitude, _ = _lookup(bearing, np.full(self.points, speed), np.full(self.points, load))
        return found(float(amplitude[0]), 0)


def _lookup(bearing: Bearing, speed: FloatArray, load: FloatArray) -> tuple[FloatArray, BoolArray]:
    fold = np.asarray(fold_speed(bearing, load))
    return surface_of(bearing).lookup(speed, load, fold)


_PER_CYCLE = 512
_SETTLED = 1e-13
_MOST_STRETCHES = 400


@dataclass(frozen=True, slots=True)
class Samples:
    """A stretch of motion, evenly sampled.

    Attributes:
        step: Time between two samples [s].
        displacement: Shape (n,) [m].
        velocity: Shape (n,) [m/s].
        acceleration: Shape (n,) [m/s^2].
        sticks: Whether it stuck within the stretch.
        complete: Whether it was followed to its end.
        evaluations: Expansions of the friction law.
        state: To go on from.
    """

    step: float
    displacement: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    sticks: bool
    complete: bool
    evaluations: int
    state: object


Follow = Callable[[Bearing, float, float, object, float, int], Samples]
"""``(bearing, speed, load, state, duration, samples)``; a state is a displacement [m] at the
belt's speed, or the state at the end of another stretch."""


def turning_points(samples: Samples) -> FloatArray:
    """Displacements where the velocity vanishes, by quintic Hermite interpolation [m]."""
    x, v, a, h = samples.displacement, samples.velocity, samples.acceleration, samples.step
    at = np.flatnonzero((v[:-1] > 0.0) != (v[1:] > 0.0))
    if not at.size:
        return np.empty(0)
    # Velocity and acceleration as polynomials in s = t/h, from both ends' x, v, a.
    d, v0, v1 = x[at + 1] - x[at], h * v[at], h * v[at + 1]
    a0, a1 = 0.5 * h * h * a[at], 0.5 * h * h * a[at + 1]
    c3 = 10.0 * d - 6.0 * v0 - 4.0 * v1 - 3.0 * a0 + a1
    c4 = -15.0 * d + 8.0 * v0 + 7.0 * v1 + 3.0 * a0 - 2.0 * a1
    c5 = 6.0 * d - 3.0 * (v0 + v1) - a0 + a1
    s = v0 / (v0 - v1)
    for _ in range(6):
        rate = v0 + s * (2.0 * a0 + s * (3.0 * c3 + s * (4.0 * c4 + s * 5.0 * c5)))
        bend = 2.0 * a0 + s * (6.0 * c3 + s * (12.0 * c4 + s * 20.0 * c5))
        s = np.clip(s - rate / np.where(bend == 0.0, 1.0, bend), 0.0, 1.0)
    turns: FloatArray = x[at] + s * (v0 + s * (a0 + s * (c3 + s * (c4 + s * c5))))
    return turns


@dataclass(frozen=True, slots=True)
class EventDriven:
    """Event-driven integration until the motion repeats.

    Args:
        follow: Follows the motion; see :data:`Follow`.
    """

    follow: Follow
    name: str = 'event-driven integrator'
    family: str = 'event-driven integrator'
    points: int = 1
    slow: bool = False
    practice: str = (
        'Stick and slip as exact phases, Taylor series with transitions located to rounding,'
        ' from breakaway until two stretches of motion have the same amplitude.'
    )
    source: str = 'this project, physics/motion/integrator.py'

    def refusal(self, bearing: Bearing, speed: float, load: float) -> str:
        """It expands the law in Taylor series, so it must know the law."""
        if isinstance(bearing.friction, (Stribeck, Coulomb, Tabulated)):
            return ''
        return 'the integrator expands the Stribeck, Coulomb and tabulated laws, and no other'

    def amplitude(self, bearing: Bearing, speed: float, load: float) -> MethodResult:
        """See :class:`~.method.Method`."""
        duration = 1.5 * typical_period(bearing, speed, load)
        count = math.ceil(_PER_CYCLE * duration * bearing.natural_frequency / (2.0 * np.pi))
        state: object = breakaway(bearing, speed, load)
        before, evaluations = math.nan, 0
        for _ in range(_MOST_STRETCHES):
            part = self.follow(bearing, speed, load, state, duration, count)
            evaluations, state = evaluations + part.evaluations, part.state
            if not part.complete:
                break
            turns = turning_points(part)
            now = 0.5 * float(np.ptp(turns)) if turns.size > 1 else 0.0
            if now * bearing.natural_frequency < 0.5 * speed:
                return found(math.nan, evaluations)
            # Stick forgets where the motion came from: one stretch that has it is enough.
            if (part.sticks and not math.isnan(before)) or abs(now - before) <= _SETTLED * now:
                return found(now, evaluations)
            before = now
        return MethodResult(math.nan, MethodOutcome.NOT_CONVERGED, evaluations)
