# SPDX-License-Identifier: Apache-2.0
"""Time integration: smoothed friction and switching by ``solve_ivp``, and the package's own.

A known weakness of switching: events are detected at the ends of steps. Near grazing the lining
touches the belt's speed for a moment within a step, the contact is missed, and a cycle of twice
the period is returned without an error.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.lab.accuracy.measurement import MethodResult, found, not_converged
from stickslip_monitor.physics.bearing import Bearing
from stickslip_monitor.physics.integrator import Drive, MotionOutcome, MotionState, Phase, integrate
from stickslip_monitor.physics.scalar_law import friction_drop, scalar_law

Flow = Callable[[float, FloatArray], tuple[float, float]]
Event = Callable[[float, FloatArray], float]


def breakaway(bearing: Bearing, speed: float, load: float) -> float:
    """Displacement ``x_0 = (mu_s N - c V)/k`` at which sticking ends [m]."""
    return (bearing.friction.static * load - bearing.damping * speed) / bearing.stiffness


def typical_period(bearing: Bearing, speed: float, load: float) -> float:
    """A cycle's duration, to plan with: a free vibration and the stick of a weak damper [s]."""
    lead = breakaway(bearing, speed, load) - float(bearing.equilibrium(speed, load))
    return 2.0 * np.pi / bearing.natural_frequency + 2.0 * max(lead, 0.0) / speed


_CYCLES = 10.0
_WATCHED = 0.6
_QUIET, _DECAYS = 0.5, 0.8


def _turning(_: float, y: FloatArray) -> float:
    return float(y[1])


def _late_range(runs: Sequence[Any], span: float, speed: float, omega: float) -> float:
    """Half the range of the turning points of the last cycles [m]; ``nan`` where it settles."""
    turns = [(t, y[0]) for way in runs for t, y in zip(way.t_events[0], way.y_events[0], strict=True)]
    late = np.array([x for t, x in turns if t > _WATCHED * span])
    if late.size < 2 or abs(late[-1] - late[-2]) < _DECAYS * abs(late[1] - late[0]):
        return math.nan
    amplitude = 0.5 * float(np.ptp(late))
    return amplitude if amplitude * omega > _QUIET * speed else math.nan


def smoothed(width: float, tight: bool, bearing: Bearing, speed: float, load: float) -> MethodResult:
    """Regularised friction: the sign of the relative speed becomes ``tanh(v/width)`` [m/s].

    LSODA integrates in SI units from breakaway for ten cycles, the last four of which are
    measured, with tolerances of scipy's (1e-3 relative, 1e-6 absolute in metres and metres a
    second) or tight (1e-10 and 1e-14). Common practice; Vigue, Vergez, Karkar and Cochelin,
    J. Sound Vib. 389 (2017) 350-363. It says nothing about its error.
    """
    span = _CYCLES * typical_period(bearing, speed, load)
    start = (breakaway(bearing, speed, load), speed)
    rtol, atol = (1e-10, 1e-14) if tight else (1e-3, 1e-6)
    law = scalar_law(bearing.friction).plain

    def friction(relative: float) -> float:
        mu = law.top - friction_drop(law.own, 0.0, abs(relative))
        return load * math.tanh(relative / width) * mu

    flow = _flow(bearing, speed, friction)
    way = solve_ivp(flow, (0.0, span), start, method='LSODA', events=_turning, rtol=rtol, atol=atol)
    if not way.success:
        return not_converged(way.nfev)
    return found(_late_range([way], span, speed, bearing.natural_frequency), way.nfev)


def _flow(bearing: Bearing, speed: float, friction: Callable[[float], float]) -> Flow:
    """``(x', x'')`` with a friction force [N] of the relative speed [m/s]."""
    mass, damping, stiffness = bearing.mass, bearing.damping, bearing.stiffness

    def flow(_: float, y: FloatArray) -> tuple[float, float]:
        x, v = float(y[0]), float(y[1])
        return v, (friction(speed - v) - damping * v - stiffness * x) / mass

    return flow


_MOST_PHASES = 200
# The dead time after a contact, in units of 1/omega.
_DEAF = 1e-6


def switching(tight: bool, longest: float, bearing: Bearing, speed: float, load: float) -> MethodResult:
    """Switching between stick and slip: a slip phase ends at the event ``x' = V``.

    Sticking is a straight line; ten cycles from breakaway in SI units, the last four of which are
    measured. Common practice; Leine, van Campen, de Kraker and van den Steen, Nonlinear Dyn. 16
    (1998) 41-54. Tight is DOP853 with tolerances 1e-12 and 1e-15, else it is RK45 with scipy's
    own; the longest step is in units of ``1/omega``, ``inf`` as users leave it.
    """
    omega = bearing.natural_frequency
    method: Any
    method, rtol, atol = ('DOP853', 1e-12, 1e-15) if tight else ('RK45', 1e-3, 1e-6)
    span = _CYCLES * typical_period(bearing, speed, load)
    time, x, side = 0.0, breakaway(bearing, speed, load), 1.0
    ways: list[Any] = []
    while time < span and len(ways) < _MOST_PHASES:
        way = solve_ivp(
            _slip_flow(side, bearing, speed, load),
            (time, span),
            (x, speed),
            method=method,
            events=[_turning, _contact(speed, side, time + _DEAF / omega)],
            rtol=rtol,
            atol=atol,
            max_step=longest / omega,
        )
        ways.append(way)
        if not way.success:
            break
        time, x = float(way.t[-1]), float(way.y[0, -1])
        if time < span:
            time, x, side = _after_contact(bearing, speed, load, time, x)
    evaluations = sum(way.nfev for way in ways)
    if not ways[-1].success:
        return not_converged(evaluations)
    return found(_late_range(ways, span, speed, omega), evaluations)


def _slip_flow(side: float, bearing: Bearing, speed: float, load: float) -> Flow:
    """``(x', x'')`` while it slips behind (side 1) or ahead (-1) of the belt."""
    law = scalar_law(bearing.friction).plain

    def friction(relative: float) -> float:
        return load * side * (law.top - friction_drop(law.own, 0.0, side * relative))

    return _flow(bearing, speed, friction)


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


def _after_contact(
    bearing: Bearing, speed: float, load: float, time: float, x: float
) -> tuple[float, float, float]:
    """Time, place and side of the next slip phase by the set-valued law.

    It holds the lining until breakaway, or lets it by.
    """
    needed = bearing.stiffness * x + bearing.damping * speed
    if abs(needed) > bearing.friction.static * load * (1.0 + 1e-12):
        return time, x, math.copysign(1.0, needed)
    start = breakaway(bearing, speed, load)
    return time + max(start - x, 0.0) / speed, start, 1.0


_PER_CYCLE = 512
_SETTLED = 1e-13
_MOST_STRETCHES = 400


def event_driven(bearing: Bearing, speed: float, load: float) -> MethodResult:
    """The package's integrator of the motion, from breakaway until the motion repeats.

    Stick and slip are phases, with transitions located to rounding. It ends where two stretches
    of motion have the same amplitude.
    """
    omega = bearing.natural_frequency
    duration = 1.5 * typical_period(bearing, speed, load)
    count = math.ceil(_PER_CYCLE * duration * omega / (2.0 * np.pi))
    times = np.linspace(0.0, duration, count + 1)
    drive = Drive.constant(speed, load, duration)
    state = MotionState(breakaway(bearing, speed, load), 0.0, Phase.STICK)
    before, evaluations = math.nan, 0
    for _ in range(_MOST_STRETCHES):
        motion = integrate(bearing, drive, state, times)
        evaluations, state = evaluations + motion.slip_steps, motion.final
        if motion.outcome is not MotionOutcome.COMPLETE:
            break
        x, v, a = motion.displacement, motion.velocity, motion.acceleration
        turns = turning_points(x, v, a, duration / count)
        now = 0.5 * float(np.ptp(turns)) if turns.size > 1 else 0.0
        if now * omega < 0.5 * speed:
            return found(math.nan, evaluations)
        # Stick forgets where the motion came from: one stretch that has it is enough.
        sticks = np.any(motion.transitions.after == Phase.STICK)
        if (sticks and not math.isnan(before)) or abs(now - before) <= _SETTLED * now:
            return found(now, evaluations)
        before = now
    return not_converged(evaluations)


def turning_points(x: FloatArray, v: FloatArray, a: FloatArray, step: float) -> FloatArray:
    """Displacements where the velocity vanishes, by quintic Hermite interpolation [m].

    Of an evenly sampled motion: displacement, velocity and acceleration, shape (n,), SI units,
    and the time between two samples [s].
    """
    at = np.flatnonzero((v[:-1] > 0.0) != (v[1:] > 0.0))
    # Displacement, velocity and acceleration as polynomials in s = t/step, from both ends' values.
    d, v0, v1 = x[at + 1] - x[at], step * v[at], step * v[at + 1]
    a0, a1 = 0.5 * step * step * a[at], 0.5 * step * step * a[at + 1]
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
