# SPDX-License-Identifier: Apache-2.0
"""Time integration by ``scipy.integrate.solve_ivp``: smoothed friction, and switching.

A known weakness of switching: events are detected at the ends of steps. Near grazing the lining
touches the belt's speed for a moment within a step, the contact is missed, and a cycle of twice
the period is returned without an error.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.lab.accuracy.method import (
    MethodOutcome,
    MethodResult,
    breakaway,
    found,
    scalar_law,
    typical_period,
)
from stickslip_monitor.physics.oscillator import Bearing

Flow = Callable[[float, FloatArray], tuple[float, float]]
Event = Callable[[float, FloatArray], float]

_solve_ivp: Any = solve_ivp


@dataclass(frozen=True, slots=True)
class SolverRun:
    """What is needed of a run.

    Attributes:
        good: Whether it came to its end or to a terminal event.
        evaluations: Of the flow.
        turn_times: When the velocity vanished, shape (n,) [s].
        turns: Displacement there, shape (n,) [m].
        time: At the end [s].
        x: Displacement at the end [m].
    """

    good: bool
    evaluations: int
    turn_times: FloatArray
    turns: FloatArray
    time: float
    x: float


def run(
    flow: Flow,
    span: tuple[float, float],
    start: tuple[float, float],
    more: Sequence[Event] = (),
    **options: Any,
) -> SolverRun:
    """Integrate from a displacement [m] and a velocity [m/s].

    Args:
        flow: ``(x', x'')`` of time and ``(x, x')``.
        span: Begin and end [s].
        start: ``x`` and ``x'`` at the begin.
        more: Events besides the turning points.
        options: Handed to ``solve_ivp``.
    """
    found = _solve_ivp(flow, span, list(start), events=[_velocity, *more], **options)
    turns = np.asarray(found.y_events[0], dtype=float).reshape(-1, 2)[:, 0]
    return SolverRun(
        good=bool(found.success),
        evaluations=int(found.nfev),
        turn_times=np.asarray(found.t_events[0], dtype=float),
        turns=turns,
        time=float(found.t[-1]),
        x=float(found.y[0, -1]),
    )


def _velocity(_: float, y: FloatArray) -> float:
    return float(y[1])


_CYCLES = 10.0
_WATCHED = 0.6
_QUIET, _DECAYS = 0.5, 0.8


def half_range(turns: FloatArray, speed: float, omega: float) -> float:
    """Half the range of the turning points [m]; ``nan`` for a motion that settles."""
    if turns.size < 2 or abs(turns[-1] - turns[-2]) < _DECAYS * abs(turns[1] - turns[0]):
        return math.nan
    amplitude = 0.5 * float(np.ptp(turns))
    return amplitude if amplitude * omega > _QUIET * speed else math.nan


@dataclass(frozen=True, slots=True)
class Regularised:
    """Regularised friction by ``scipy.integrate.solve_ivp``, LSODA.

    Args:
        width: Speed over which the sign turns, > 0 [m/s].
        tight: Whether tolerances are tightened from scipy's (1e-3 relative, 1e-6 absolute in
            metres and metres a second) to 1e-10 and 1e-14.
    """

    width: float
    tight: bool
    points: int = 1
    family: str = 'tanh friction, LSODA'
    practice: str = (
        'The sign of the relative speed becomes tanh(v/width); LSODA integrates in SI units from'
        ' breakaway for ten cycles, the last four of which are measured.'
    )
    source: str = (
        'common practice; Vigue, Vergez, Karkar and Cochelin, J. Sound Vib. 389 (2017) 350-363'
    )

    @property
    def name(self) -> str:
        """See :class:`~.method.Method`."""
        tolerance = 'tight' if self.tight else 'default'
        width = f'{self.width:.0e}'.replace('e-0', 'e-')
        return f'tanh {width} m/s, {tolerance}'

    @property
    def slow(self) -> bool:
        """See :class:`~.method.Method`."""
        return self.tight and self.width < 5e-5

    def refusal(self, bearing: Bearing, speed: float, load: float) -> str:
        """It applies everywhere, and says nothing about its error."""
        return ''

    def amplitude(self, bearing: Bearing, speed: float, load: float) -> MethodResult:
        """See :class:`~.method.Method`."""
        span = _CYCLES * typical_period(bearing, speed, load)
        start = (breakaway(bearing, speed, load), speed)
        rtol, atol = (1e-10, 1e-14) if self.tight else (1e-3, 1e-6)
        way = run(
            self._flow(bearing, speed, load), (0.0, span), start, method='LSODA', rtol=rtol,
            atol=atol,
        )  # fmt: skip
        if not way.good:
            return MethodResult(math.nan, MethodOutcome.NOT_CONVERGED, way.evaluations)
        late = way.turns[way.turn_times > _WATCHED * span]
        return found(half_range(late, speed, bearing.natural_frequency), way.evaluations)

    def _flow(self, bearing: Bearing, speed: float, load: float) -> Flow:
        mass, damping, stiffness = bearing.mass, bearing.damping, bearing.stiffness
        law, width = scalar_law(bearing.friction), self.width

        def flow(_: float, y: FloatArray) -> tuple[float, float]:
            x, v = float(y[0]), float(y[1])
            relative = speed - v
            friction = load * math.tanh(relative / width) * law(abs(relative))
            return v, (friction - damping * v - stiffness * x) / mass

        return flow


_MOST_PHASES = 200
_DEAF = 1e-6


@dataclass(slots=True)
class _Journey:
    """What has been seen on the way."""

    time: float
    x: float
    side: float
    evaluations: int
    turn_times: list[float]
    turns: list[float]
    failed: bool = False


@dataclass(frozen=True, slots=True)
class Switching:
    """Switching between stick and slip by ``scipy.integrate.solve_ivp``.

    Args:
        tight: DOP853 with tolerances 1e-12 and 1e-15, instead of RK45 with scipy's own.
        longest: Longest step in units of ``1/omega``, > 0; ``inf`` as users leave it.
    """

    tight: bool
    longest: float = math.inf
    points: int = 1
    slow: bool = False
    family: str = 'switching, solve_ivp'
    practice: str = (
        "A slip phase is integrated in SI units until the event x' = V, sticking is a straight"
        ' line; ten cycles from breakaway, the last four of which are measured.'
    )
    source: str = (
        'common practice; Leine, van Campen, de Kraker and van den Steen, Nonlinear Dyn. 16'
        ' (1998) 41-54; scipy.integrate.solve_ivp'
    )

    @property
    def name(self) -> str:
        """See :class:`~.method.Method`."""
        tolerance = 'tight' if self.tight else 'default'
        bound = '' if math.isinf(self.longest) else ', bounded step'
        return f'switching, {tolerance}{bound}'

    def refusal(self, bearing: Bearing, speed: float, load: float) -> str:
        """It applies everywhere."""
        return ''

    def amplitude(self, bearing: Bearing, speed: float, load: float) -> MethodResult:
        """See :class:`~.method.Method`."""
        span = _CYCLES * typical_period(bearing, speed, load)
        way = _Journey(0.0, breakaway(bearing, speed, load), 1.0, 0, [], [])
        for _ in range(_MOST_PHASES):
            self._slip(bearing, speed, load, way, span)
            if way.failed:
                return MethodResult(math.nan, MethodOutcome.NOT_CONVERGED, way.evaluations)
            if way.time >= span:
                break
            _stick_or_cross(bearing, speed, load, way)
        late = np.array(way.turn_times) > _WATCHED * span
        turns = np.array(way.turns)[late]
        return found(half_range(turns, speed, bearing.natural_frequency), way.evaluations)

    def _slip(
        self, bearing: Bearing, speed: float, load: float, way: _Journey, span: float
    ) -> None:
        """A slip phase behind (side 1) or ahead (-1) of the belt, to contact or to the end."""
        mass, damping, stiffness = bearing.mass, bearing.damping, bearing.stiffness
        law, side = scalar_law(bearing.friction), way.side

        def flow(_: float, y: FloatArray) -> tuple[float, float]:
            x, v = float(y[0]), float(y[1])
            friction = load * side * law(side * (speed - v))
            return v, (friction - damping * v - stiffness * x) / mass

        method, rtol, atol = ('DOP853', 1e-12, 1e-15) if self.tight else ('RK45', 1e-3, 1e-6)
        deaf = way.time + _DEAF / bearing.natural_frequency
        seen = run(
            flow, (way.time, span), (way.x, speed), [_contact(speed, side, deaf)], method=method,
            rtol=rtol, atol=atol, max_step=self.longest / bearing.natural_frequency,
        )  # fmt: skip
        way.evaluations += seen.evaluations
        way.failed = not seen.good
        way.turn_times.extend(seen.turn_times.tolist())
        way.turns.extend(seen.turns.tolist())
        way.time, way.x = seen.time, seen.x


def _contact(speed: float, side: float, earliest: float) -> Event:
    """Terminal where the lining reaches the belt's speed from its side.

    A phase begins at contact: a first step too small to change the speed would end it at once.
    """

    def contact(time: float, y: FloatArray) -> float:
        return side * (speed - float(y[1])) if time > earliest else speed

    # solve_ivp reads these attributes from the function, as in its own example.
    contact.terminal = True  # type: ignore[attr-defined]
    contact.direction = -1.0  # type: ignore[attr-defined]
    return contact


def _stick_or_cross(bearing: Bearing, speed: float, load: float, way: _Journey) -> None:
    """What the set-valued law says at contact: hold the lining until breakaway, or let it by."""
    needed = bearing.stiffness * way.x + bearing.damping * speed
    limit = bearing.friction.static * load
    if abs(needed) > limit * (1.0 + 1e-12):
        way.side = math.copysign(1.0, needed)
        return
    start = breakaway(bearing, speed, load)
    way.time += max(start - way.x, 0.0) / speed
    way.x, way.side = start, 1.0
