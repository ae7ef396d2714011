# SPDX-License-Identifier: Apache-2.0
"""Computes the amplitude of the stable cycle: time steps, harmonic balance, averaging, exact cycle.

Switching by ``solve_ivp`` has a known weakness: events are detected at the ends of steps. Near
grazing the lining touches the belt's speed for a moment within a step, the contact is missed, and
a cycle of twice the period is returned without an error.

Harmonic balance is by the alternating frequency/time method. In units of ``V/omega`` and
``1/omega`` the motion is ``x'' + 2 zeta x' + x = lambda`` with the friction force ``lambda``,
set-valued where the relative speed ``v = 1 - x'`` is zero. Dynamic Lagrangians make it
single-valued: with ``Z`` the linear impedance,

    y = Z x + e (1 - x')  and  lambda = y - e v*,  where  y is in  lambda(v*) + e v*

has one solution ``v*`` once ``e`` exceeds the steepest fall of friction: ``v* = 0`` (stick) for
``|y| <= mu_s N``, else a scalar root (slip). At a solution ``v* = v``. ``e`` weighs how hard a
truncated series is held to the belt; the limit of many harmonics does not depend on it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.physics.averaging import stationary_amplitudes
from stickslip_monitor.physics.bearing import Bearing
from stickslip_monitor.physics.cycles import CycleKind, exact_cycle
from stickslip_monitor.physics.friction import Coulomb, Stribeck
from stickslip_monitor.physics.integrator import Drive, MotionOutcome, MotionState, Phase, integrate
from stickslip_monitor.physics.scalar_law import law_bounds, scalar_law

CYCLE, NO_CYCLE, NOT_CONVERGED, REFUSED = 'cycle', 'no_cycle', 'not_converged', 'refused'
"""How a method can end; refused is a bearing whose law it is not made for."""


@dataclass(frozen=True, slots=True)
class MethodResult:
    """Result of a method at one operating point."""

    amplitude: float  # half the peak-to-peak displacement of the stable cycle [m]; ``nan`` without
    outcome: str  # ``CYCLE``, ``NO_CYCLE``, ``NOT_CONVERGED`` or ``REFUSED``
    # Evaluations of the friction law, an array of speeds counting once; ``None`` where they are not counted.
    evaluations: int | None


def cycle_result(amplitude: float, evaluations: int | None = None) -> MethodResult:
    """Return the result of a method that finished: a cycle, or none where the amplitude [m] is not finite.

    ``evaluations`` are as of :class:`MethodResult`.
    """
    return MethodResult(amplitude, CYCLE if math.isfinite(amplitude) else NO_CYCLE, evaluations)


def unconverged_result(evaluations: int | None = None) -> MethodResult:
    """Return the result of a method that gave up: amplitude ``nan``, with its ``evaluations``."""
    return MethodResult(math.nan, NOT_CONVERGED, evaluations)


Flow = Callable[[float, FloatArray], tuple[float, float]]
Event = Callable[[float, FloatArray], float]


def breakaway(bearing: Bearing, speed: float, load: float) -> float:
    """Return the displacement ``x_0 = (mu_s N - c V)/k`` at which sticking ends [m]; in SI units."""
    return (bearing.friction.static * load - bearing.damping * speed) / bearing.stiffness


def typical_period(bearing: Bearing, speed: float, load: float) -> float:
    """Estimate the duration of a cycle to plan with: a free vibration and the stick of a weak damper [s].

    ``speed`` is that of the surface, > 0 [m/s], ``load`` the load [N].
    """
    lead = breakaway(bearing, speed, load) - float(bearing.equilibrium(speed, load))
    return 2.0 * np.pi / bearing.natural_frequency + 2.0 * max(lead, 0.0) / speed


# Cycles that are integrated.
_CYCLES = 10.0
# Amplitudes below this share of the sliding limit V/omega are no cycle.
_MIN_AMPLITUDE = 0.5


def _velocity_event(_: float, y: FloatArray) -> float:
    """Return the velocity, the second number of the state: an event of ``solve_ivp`` at turning points."""
    return float(y[1])


def _late_amplitude(runs: Sequence[Any], span: float, speed: float, omega: float) -> float:
    """Return the amplitude [m] as half the range of the turning points after 60 % of the time ``span`` [s].

    Args:
        runs: Results of ``solve_ivp`` whose first event is a turning point.
        span: The time that was integrated [s].
        speed: Surface speed [m/s].
        omega: Natural frequency [rad/s].

    Returns:
        The amplitude; ``nan`` where the motion has fewer than two turning points then, decays, its last
        stroke then being below 0.8 times its first, or stays below half the sliding limit ``V/omega``.
    """
    turns = [(t, y[0]) for way in runs for t, y in zip(way.t_events[0], way.y_events[0], strict=True)]
    late = np.array([x for t, x in turns if t > 0.6 * span])
    if late.size < 2 or abs(late[-1] - late[-2]) < 0.8 * abs(late[1] - late[0]):
        return math.nan
    amplitude = 0.5 * float(np.ptp(late))
    return amplitude if amplitude * omega > _MIN_AMPLITUDE * speed else math.nan


def smoothed(width: float, tight: bool, bearing: Bearing, speed: float, load: float) -> MethodResult:
    """Compute the amplitude by regularised friction: the sign of ``v`` becomes ``tanh(v/width)``.

    LSODA integrates in SI units from breakaway for ten cycles, the last four of which are measured. Common
    practice; Vigue, Vergez, Karkar and Cochelin, J. Sound Vib. 389 (2017) 350-363. It has not converged where
    LSODA fails; a wrong amplitude goes unnoticed. There is no cycle where :func:`_late_amplitude` finds none.

    Args:
        width: The width [m/s].
        tight: Whether tolerances are 1e-10 relative and 1e-14 absolute [m, m/s]; else scipy's 1e-3 and 1e-6.
        bearing: The bearing.
        speed: Surface speed > 0 [m/s].
        load: Load > 0 [N].
    """
    span = _CYCLES * typical_period(bearing, speed, load)
    start = (breakaway(bearing, speed, load), speed)
    rtol, atol = (1e-10, 1e-14) if tight else (1e-3, 1e-6)
    top, drop = law_bounds(bearing.friction).top, scalar_law(bearing.friction).plain.drop

    def friction(relative: float) -> float:
        """Return the force [N] at a relative speed [m/s]."""
        mu = top - drop(0.0, abs(relative))
        return load * math.tanh(relative / width) * mu

    flow = _build_flow(bearing, speed, friction)
    way = solve_ivp(flow, (0.0, span), start, method='LSODA', events=_velocity_event, rtol=rtol, atol=atol)
    if not way.success:
        return unconverged_result(way.nfev)
    return cycle_result(_late_amplitude([way], span, speed, bearing.natural_frequency), way.nfev)


def _build_flow(bearing: Bearing, speed: float, friction: Callable[[float], float]) -> Flow:
    """Return the function ``(x', x'')`` of time and state ``(x, x')``, which ``solve_ivp`` integrates.

    ``friction`` gives the friction force [N] at a relative speed [m/s].
    """
    mass, damping, stiffness = bearing.mass, bearing.damping, bearing.stiffness

    def flow(_: float, y: FloatArray) -> tuple[float, float]:
        x, v = float(y[0]), float(y[1])
        return v, (friction(speed - v) - damping * v - stiffness * x) / mass

    return flow


def switching(tight: bool, longest: float, bearing: Bearing, speed: float, load: float) -> MethodResult:
    """Compute the amplitude by switching between stick and slip: slip ends at the event ``x' = V``.

    Sticking is a straight line; ten cycles from breakaway in SI units, the last four of which are
    measured. Common practice; Leine, van Campen, de Kraker and van den Steen, Nonlinear Dyn. 16
    (1998) 41-54. It has not converged where ``solve_ivp`` fails; there is no cycle where
    :func:`_late_amplitude` finds none. Chatter ends it after 200 phases.

    Args:
        tight: Whether to use DOP853 with tolerances 1e-12 and 1e-15; else RK45 with scipy's 1e-3 and 1e-6.
        longest: Longest step [1/omega]; ``inf`` as users leave it.
        bearing: The bearing.
        speed: Surface speed > 0 [m/s].
        load: Load > 0 [N].
    """
    omega = bearing.natural_frequency
    method: Any
    method, rtol, atol = ('DOP853', 1e-12, 1e-15) if tight else ('RK45', 1e-3, 1e-6)
    span = _CYCLES * typical_period(bearing, speed, load)
    time, x, side = 0.0, breakaway(bearing, speed, load), 1.0
    ways: list[Any] = []
    while time < span and len(ways) < 200:  # ten cycles have about twenty phases, chatter has no end
        way = solve_ivp(
            _slip_flow(side, bearing, speed, load),
            (time, span),
            (x, speed),
            method=method,
            events=[_velocity_event, _contact_event(speed, side, time + 1e-6 / omega)],
            rtol=rtol,
            atol=atol,
            max_step=longest / omega,
        )
        ways.append(way)
        if not way.success:
            break
        time, x = float(way.t[-1]), float(way.y[0, -1])
        if time < span:
            time, x, side = _find_slip_start(bearing, speed, load, time, x)
    evaluations = sum(way.nfev for way in ways)
    if not ways[-1].success:
        return unconverged_result(evaluations)
    return cycle_result(_late_amplitude(ways, span, speed, omega), evaluations)


def _slip_flow(side: float, bearing: Bearing, speed: float, load: float) -> Flow:
    """Return the flow, as :func:`_build_flow`, of a slip behind (``side`` 1) or ahead (-1) of the belt.

    ``speed`` is that of the surface [m/s], ``load`` the load [N].
    """
    top, drop = law_bounds(bearing.friction).top, scalar_law(bearing.friction).plain.drop

    def friction(relative: float) -> float:
        """Return the force [N] at a relative speed [m/s], of one sign."""
        return load * side * (top - drop(0.0, side * relative))

    return _build_flow(bearing, speed, friction)


def _contact_event(speed: float, side: float, earliest: float) -> Event:
    """Return an event of ``solve_ivp`` that ends a phase where the lining reaches the belt's speed.

    Args:
        speed: Surface speed [m/s].
        side: 1 where it slips behind the belt, -1 ahead of it.
        earliest: Time up to which none is seen [s]: a phase begins at contact, and a first step too small to
            change the speed would end it at once.
    """

    def contact(time: float, y: FloatArray) -> float:
        return side * (speed - float(y[1])) if time > earliest else speed

    # solve_ivp reads these attributes from the function, as in its own example.
    contact.terminal = True  # type: ignore[attr-defined]
    contact.direction = -1.0  # type: ignore[attr-defined]
    return contact


def _find_slip_start(
    bearing: Bearing, speed: float, load: float, time: float, x: float
) -> tuple[float, float, float]:
    """Return the start of the next slip phase after the lining reached the belt's speed.

    Friction up to the static limit holds the lining until breakaway; beyond it, slip goes on at once.

    Args:
        bearing: The bearing.
        speed: Surface speed [m/s].
        load: Load [N].
        time: Time of the contact [s].
        x: Displacement at the contact [m].

    Returns:
        Time [s], displacement [m] and side: 1 behind the belt, -1 ahead of it.
    """
    needed = bearing.stiffness * x + bearing.damping * speed
    if abs(needed) > bearing.friction.static * load * (1.0 + 1e-12):
        return time, x, math.copysign(1.0, needed)
    start = breakaway(bearing, speed, load)
    return time + max(start - x, 0.0) / speed, start, 1.0


def event_driven(bearing: Bearing, speed: float, load: float) -> MethodResult:
    """Compute the amplitude by the package's integrator, from breakaway until the motion repeats.

    Stick and slip are phases, with transitions located to rounding. It ends where two successive parts of one
    and a half cycles have the same amplitude to 1e-13, or one but the first has stuck. There is no cycle
    where the amplitude falls below half of ``V/omega``; after 400 parts, or where the integrator gives up, it
    has not converged. Evaluations are the steps while slipping. Speed [m/s] and load [N] are above 0.
    """
    omega = bearing.natural_frequency
    duration = 1.5 * typical_period(bearing, speed, load)
    # 512 samples of a free vibration, between which turning points are interpolated.
    count = math.ceil(512 * duration * omega / (2.0 * np.pi))
    times = np.linspace(0.0, duration, count + 1)
    drive = Drive.constant(speed, load, duration)
    state = MotionState(breakaway(bearing, speed, load), 0.0, Phase.STICK)
    before, evaluations = math.nan, 0
    for _ in range(400):
        motion = integrate(bearing, drive, state, times)
        evaluations, state = evaluations + motion.slip_steps, motion.final
        if motion.outcome is not MotionOutcome.COMPLETE:
            break
        x, v, a = motion.displacement, motion.velocity, motion.acceleration
        turns = turning_points(x, v, a, duration / count)
        now = 0.5 * float(np.ptp(turns)) if turns.size > 1 else 0.0
        if now * omega < _MIN_AMPLITUDE * speed:
            return cycle_result(math.nan, evaluations)
        # After sticking a motion does not depend on its past: one part that sticks is enough.
        sticks = np.any(motion.transitions.after == Phase.STICK)
        if (sticks and not math.isnan(before)) or abs(now - before) <= 1e-13 * now:
            return cycle_result(now, evaluations)
        before = now
    return unconverged_result(evaluations)


def turning_points(x: FloatArray, v: FloatArray, a: FloatArray, step: float) -> FloatArray:
    """Return the displacements where the velocity vanishes, by quintic Hermite interpolation [m].

    Args:
        x: Displacement, evenly sampled, shape (n,) [m].
        v: Velocity, shape (n,) [m/s].
        a: Acceleration, shape (n,) [m/s^2].
        step: Time between two samples [s].

    Returns:
        The k displacements in order of time, shape (k,); empty without a turning point.
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


class _Law:
    """The friction force in units of ``m omega V`` over relative speeds in units of ``V``.

    Attributes:
        force: The load in units of ``m omega V``.
        static: The largest force of sticking.
        penalty: The number ``e`` of the module's equations, above the steepest fall of the force.
        evaluations: Evaluations of the law so far, an array of speeds counting once.

    Args:
        bearing: The bearing.
        speed: Surface speed ``V`` > 0 [m/s].
        load: Load > 0 [N].
    """

    def __init__(self, bearing: Bearing, speed: float, load: float) -> None:
        self.law, self.speed = bearing.friction, speed
        self.force = load / (bearing.mass * bearing.natural_frequency * speed)
        self.static = self.force * self.law.static
        panels = speed * np.linspace(0.0, 4.0, 401)
        fall = -self.force * speed * float(np.min(self.law.slope(panels)))
        scale = max(fall, 0.0) + self.static
        self.penalty = 2.0 * scale + 4.0 * math.sqrt(scale)  # chosen for few steps
        self.evaluations = 0

    def resolvent(self, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Solve ``F(v*) + penalty v* = y`` with the friction force ``F``, which is set-valued at 0.

        Adds to :attr:`evaluations` one for each step of Newton's method, which all of ``y`` take together.

        Args:
            y: Shape (n,) [units of ``m omega V``].

        Returns:
            The relative speeds ``v*`` [units of ``V``] and ``d v*/d y``, shape (n,) each; both are 0 where
            it sticks.
        """
        speed, slope = np.zeros_like(y), np.zeros_like(y)
        slips = np.abs(y) > self.static
        target = np.abs(y[slips])
        v = (target - self.static) / self.penalty
        rate = np.full_like(v, self.penalty)
        for _ in range(40):
            self.evaluations += 1
            force = self.force * self.law.coefficient(self.speed * v)
            rate = self.penalty + self.force * self.speed * self.law.slope(self.speed * v)
            step = (target - force - self.penalty * v) / rate
            v = np.maximum(v + step, 0.0)
            if np.all(np.abs(step) <= 1e-14 * (1.0 + v)):
                break
        speed[slips] = np.sign(y[slips]) * v
        slope[slips] = 1.0 / rate
        return speed, slope


class _Series:
    """Fourier series with H harmonics: ``[a_0, a_1, b_1, a_2, b_2, ...]`` on a grid of n phases of a turn.

    Attributes:
        wave: Matrix from coefficients to values on the grid, shape (n, 2 H + 1).
        project: Matrix from values to coefficients, shape (2 H + 1, n).
        turn: Matrix of the derivative by the phase, on coefficients, shape (2 H + 1, 2 H + 1).
    """

    def __init__(self, harmonics: int) -> None:
        count = 2 ** math.ceil(math.log2(max(256, 32 * (harmonics + 1))))
        phase = 2.0 * np.pi * np.arange(count) / count
        angle = phase[:, None] * np.arange(1, harmonics + 1)
        self.wave = np.ones((count, 2 * harmonics + 1))
        self.wave[:, 1::2], self.wave[:, 2::2] = np.cos(angle), np.sin(angle)
        self.project = 2.0 / count * self.wave.T
        self.project[0] *= 0.5
        # d/d(phase) of the coefficients: a_n <- n b_n, b_n <- -n a_n.
        size = 2 * harmonics + 1
        self.turn = np.zeros((size, size))
        for n in range(1, harmonics + 1):
            self.turn[2 * n - 1, 2 * n], self.turn[2 * n, 2 * n - 1] = n, -n


@dataclass(slots=True)
class _Problem:
    """The balance of one operating point at one number of harmonics."""

    series: _Series
    law: _Law
    damping: float  # the damping ratio

    def residual(self, q: FloatArray, frequency: float) -> tuple[FloatArray, FloatArray]:
        """Return the residual, shape (2 H + 1,), and its Jacobian, shape (2 H + 1, 2 H + 2).

        The residual is a force in units of ``m omega V``. The Jacobian is by the coefficients and, in the
        last column, the frequency. Arguments are those of :meth:`solve`. Adds to the evaluations of
        :attr:`law`.
        """
        s, e = self.series, self.law.penalty
        turn, size = s.turn, q.size
        rate, bend = turn @ q, turn @ (turn @ q)
        belt = np.zeros(size)
        belt[0] = 1.0
        impedance = np.eye(size) + frequency * (2.0 * self.damping * turn)
        impedance += frequency**2 * turn @ turn
        lean = belt - frequency * rate
        v, slope = self.law.resolvent(s.wave @ (impedance @ q + e * lean))
        by_q = np.empty((size, size + 1))
        by_q[:, :size] = impedance - e * frequency * turn
        by_q[:, size] = 2.0 * self.damping * rate + 2.0 * frequency * bend - e * rate
        # lambda - Z x = e ((1 - x') - v*): the Jacobian follows from the same chain.
        jacobian = -e * (s.project * slope) @ (s.wave @ by_q)
        jacobian[:, :size] -= e * frequency * turn
        jacobian[:, size] -= e * rate
        return e * (lean - s.project @ v), jacobian

    def solve(self, q: FloatArray, frequency: float) -> tuple[FloatArray, float, bool]:
        """Solve the balance from a guess by damped semi-smooth Newton, with ``b_1`` held at the guess.

        Adds to the evaluations of :attr:`law`. scipy's least-squares solvers find the same roots in five to
        sixty times the time.

        Args:
            q: Coefficients ``[a_0, a_1, b_1, ...]`` of the guess, shape (2 H + 1,), in units of ``V/omega``.
            frequency: Its frequency, in units of ``omega``.

        Returns:
            Coefficients, frequency, and True; or those of the last of 80 steps, and False, if it has not
            converged.
        """
        free = np.delete(np.arange(q.size + 1), 2)
        z = np.append(q, frequency)
        value, jacobian = self.residual(q, frequency)
        for _ in range(80):
            size = float(np.linalg.norm(value))
            if size <= 1e-11 * self.law.penalty:
                return z[:-1], float(z[-1]), True
            step = np.zeros_like(z)
            step[free] = _solve_linear(jacobian[:, free], -value)
            for halvings in range(12):
                trial = z + 0.5**halvings * step
                value, jacobian = self.residual(trial[:-1], float(trial[-1]))
                if float(np.linalg.norm(value)) < size:
                    break
            z = trial
        return z[:-1], float(z[-1]), False


def _solve_linear(matrix: FloatArray, value: FloatArray) -> FloatArray:
    """Solve n linear equations, shapes (n, n) and (n,); by least squares where the matrix is singular."""
    try:
        return np.asarray(np.linalg.solve(matrix, value))
    except np.linalg.LinAlgError:
        return np.asarray(np.linalg.lstsq(matrix, value, rcond=None)[0])


def series_amplitude(q: FloatArray) -> float:
    """Return half the peak-to-peak of a Fourier series ``[a_0, a_1, b_1, ...]`` over a turn, in its unit.

    The series must not be constant.
    """
    n = np.arange(1, (q.size - 1) // 2 + 1)
    series = q[1::2] - 1j * q[2::2]
    count = max(1024, 16 * n.size)
    # One phase more than a turn, so that an extreme at its end is between two.
    phase = 2.0 * np.pi * np.arange(count + 2) / count
    waves = np.exp(1j * np.multiply.outer(phase, n))
    x, v, a = (np.real(waves @ ((1j * n) ** order * series)) for order in range(3))
    return 0.5 * float(np.ptp(turning_points(x, v, a, 2.0 * np.pi / count)))


def has_resolvent(bearing: Bearing) -> bool:
    """Return whether harmonic balance applies to a bearing's law.

    A jump of Coulomb's law at breakaway leaves the stick force undetermined.
    """
    law = bearing.friction
    return not isinstance(law, Coulomb) or law.static == law.kinetic


def harmonic_balance(harmonics: int, bearing: Bearing, speed: float, load: float) -> MethodResult:
    """Compute the amplitude of the largest stable cycle by harmonic balance, starting from that of averaging.

    Solves with 1, 3, 7, ... harmonics in turn, at last with ``harmonics`` of them. There is no cycle where
    averaging has no stable one, or where the solver falls to steady sliding; where the last solution fails,
    it has not converged. Surface speed [m/s] and load [N] are above 0.
    """
    omega, law = bearing.natural_frequency, _Law(bearing, speed, load)
    cycles = stationary_amplitudes(bearing, speed, load)
    stable = cycles.amplitude[cycles.stable]
    if not stable.size:
        return cycle_result(math.nan, 0)
    q = np.array([law.force * float(law.law.coefficient(speed)), 0.0, 0.0])
    q[1], frequency, good = float(stable[-1]) * omega / speed, 1.0, False
    # By way of 1, 3, 7, ... harmonics.
    for rung in [2**k - 1 for k in range(1, harmonics.bit_length())] + [harmonics]:
        q = np.concatenate([q, np.zeros(2 * rung + 1 - q.size)])
        problem = _Problem(_Series(rung), law, bearing.damping_ratio)
        q, frequency, good = problem.solve(q, frequency)
    if not good:
        return unconverged_result(law.evaluations)
    size = series_amplitude(q)
    # The solver may fall to steady sliding, which balances too.
    return cycle_result(size * speed / omega if size > _MIN_AMPLITUDE else math.nan, law.evaluations)


def averaging(points: int, bearing: Bearing, speed: float, load: float) -> MethodResult:
    """Compute the amplitude of the largest stable cycle by averaging of first order, as the monitor does.

    There is no cycle where it has no stable one. ``points`` copies of the operating point are solved in one
    call, and the first is returned. Of the Stribeck law, which has closed forms, 0 evaluations are stated,
    of any other ``None``. Speed [m/s] and load [N] are above 0.
    """
    speeds = speed if points == 1 else np.full(points, speed)
    cycles = stationary_amplitudes(bearing, speeds, load)
    first = (0,) * (cycles.amplitude.ndim - 1)
    stable = cycles.amplitude[first][cycles.stable[first]]
    closed = isinstance(bearing.friction, Stribeck)
    return cycle_result(float(stable[-1]) if stable.size else math.nan, 0 if closed else None)


def exact(points: int, bearing: Bearing, speed: float, load: float) -> MethodResult:
    """Compute the exact amplitude: one slip phase from breakaway, with a set-valued law (Filippov 1988).

    ``points`` copies of the operating point are solved in one call, and the first is returned. A cycle that
    :func:`.exact_cycle` leaves unresolved has not converged. Evaluations are not counted. Speed
    [m/s] and load [N] are above 0.
    """
    cycle = exact_cycle(bearing, speed if points == 1 else np.full(points, speed), load)
    if np.ravel(cycle.kind)[0] == CycleKind.UNRESOLVED:
        return unconverged_result(None)
    return cycle_result(float(np.ravel(cycle.amplitude)[0]), None)
