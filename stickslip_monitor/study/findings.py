# SPDX-License-Identifier: Apache-2.0
"""What was published on the stick-slip of a water-lubricated rubber bearing, computed again.

The published study averages the mass-spring-belt model (KBM) and sets the result beside numerical
integration. Here the numerical side is the exact non-smooth cycle, so each finding comes with the
error of averaging. The unstable branch is found twice: by the return map of the exact cycle, and
as published by integration in reverse time, in which a pure-slip unstable cycle attracts.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.special import i1e

from stickslip_monitor.errors import PhysicsError
from stickslip_monitor.monitor.assessment import assess
from stickslip_monitor.physics.averaging import amplitude_rate
from stickslip_monitor.physics.bifurcation import fold_load, fold_speed, hopf_load, hopf_speed
from stickslip_monitor.physics.cycle import exact_cycle, exact_fold_speed, exact_unstable_cycle
from stickslip_monitor.physics.friction import Array, Coulomb, Stribeck
from stickslip_monitor.physics.oscillator import Bearing

Follow = Callable[[Bearing, float, float, float, Array], tuple[Array, Array, NDArray[np.bool_]]]
"""Integrates the model in time: bearing, surface speed [m/s], load [N], displacement [m] at rest
relative to the ground at time 0, rising times from 0 [s]; displacement [m], velocity [m/s] and
whether the lining sticks, at those times."""

REFERENCE = Bearing(
    mass=50.0,
    damping=400.0,
    stiffness=2.0e6,
    friction=Stribeck(static=0.30, kinetic=0.10, decay=10.0),
    journal_diameter=0.100,
)
"""The test-bench bearing of the docs, for which the findings hold."""
REFERENCE_RPM, REFERENCE_LOAD = 20.0, 1000.0

_NEAR_AN_END = np.geomspace(1e-9, 0.05, 8)
_WIDTHS, _HALVINGS = (1e-4, 1e-3, 1e-2, 0.1, 0.5), 40
_SPEED_ROOM, _LOAD_ROOM, _FALL_ROOM = 1.12, 6.0, 0.55
_START = 0.5
_TURNS, _LAST_TURN, _MOST_CHUNKS = 40.0, 1.25, 200
_TOLERANCE = 1e-10
_SAMPLES = 64
_DISTURBANCE, _ARRIVED = 0.05, 0.995
_MOST_PERIODS, _PERIODS_AFTER, _PER_PERIOD = 250, 8, 120
_CYCLE_POINTS = 721
_CURVE_POINTS, _CURVE_ROOM = 400, 1.3


@dataclass(frozen=True, slots=True, eq=False)
class Sweep:
    """Amplitudes of the limit cycles over one parameter, in the parameter's own unit.

    Attributes:
        value: The parameter, rising, close-set beside the bifurcations, shape (n,).
        exact: Displacement amplitude of the exact stick-slip cycle, shape (n,) [m].
        exact_unstable: The same of the exact unstable cycle.
        averaged: Stick-slip amplitude under first-order KBM averaging.
        averaged_unstable: Unstable amplitude under KBM. All four are ``nan`` without a cycle.
        hopf: Parameter at the Hopf bifurcation, the same for both methods.
        exact_fold: Parameter at the exact fold.
        averaged_fold: Parameter at the fold under KBM.
        fold_amplitude: Exact amplitude at the fold [m].
        reverse_value: Parameters at which the unstable cycle was sought in reverse time.
        reverse: Amplitude found there [m].
    """

    value: Array
    exact: Array
    exact_unstable: Array
    averaged: Array
    averaged_unstable: Array
    hopf: float
    exact_fold: float
    averaged_fold: float
    fold_amplitude: float
    reverse_value: Array = field(default_factory=lambda: np.empty(0))
    reverse: Array = field(default_factory=lambda: np.empty(0))

    @property
    def error(self) -> Array:
        """Relative error of the averaged stick-slip amplitude, shape (n,) [-]."""
        return self.averaged / self.exact - 1.0

    @property
    def unstable_error(self) -> Array:
        """Relative error of the averaged unstable amplitude, shape (n,) [-]."""
        return self.averaged_unstable / self.exact_unstable - 1.0

    def columns(self, heading: str) -> dict[str, Array]:
        """The curves as the columns of a table, SI units; the heading is the parameter's."""
        rows = np.argsort(np.concatenate([self.value, self.reverse_value]), kind='stable')

        def column(values: Array, reverse: Array | None = None) -> Array:
            none = np.full(self.reverse_value.size, np.nan)
            return np.concatenate([values, none if reverse is None else reverse])[rows]

        return {
            heading: column(self.value, self.reverse_value),
            'exact_stick_slip_amplitude [m]': column(self.exact),
            'exact_unstable_amplitude [m]': column(self.exact_unstable),
            'kbm_stick_slip_amplitude [m]': column(self.averaged),
            'kbm_unstable_amplitude [m]': column(self.averaged_unstable),
            'reverse_time_unstable_amplitude [m]': column(
                np.full(self.value.size, np.nan), self.reverse
            ),
        }


@dataclass(frozen=True, slots=True, eq=False)
class History:
    """Stick-slip as it grows from a small disturbance of steady sliding, and its cycle.

    Attributes:
        speed: Surface speed [m/s].
        load: Load [N].
        equilibrium: Displacement of steady sliding [m].
        time: Shape (n,) [s].
        displacement: From the unloaded spring, shape (n,) [m].
        velocity: Shape (n,) [m/s].
        sticking: Whether the lining sticks, shape (n,).
        envelope: Amplitude under KBM averaging at the same times, shape (n,) [m].
        cycle_time: One period of the exact cycle, from breakaway, shape (p,) [s].
        cycle_displacement: Shape (p,) [m].
        cycle_velocity: Shape (p,) [m/s].
        averaged_amplitude: Stick-slip amplitude under KBM [m].
        exact_amplitude: Exact stick-slip amplitude [m].
        period: Period of the exact cycle [s].
        stick_fraction: Share of it in which the lining sticks [-].
    """

    speed: float
    load: float
    equilibrium: float
    time: Array
    displacement: Array
    velocity: Array
    sticking: NDArray[np.bool_]
    envelope: Array
    cycle_time: Array
    cycle_displacement: Array
    cycle_velocity: Array
    averaged_amplitude: float
    exact_amplitude: float
    period: float
    stick_fraction: float

    def columns(self) -> dict[str, Array]:
        """The motion as the columns of a table, SI units."""
        return {
            'time [s]': self.time,
            'displacement [m]': self.displacement,
            'velocity [m/s]': self.velocity,
            'sticking': self.sticking.astype(np.int64),
            'kbm_envelope [m]': self.envelope,
        }


@dataclass(frozen=True, slots=True, eq=False)
class FrictionCurves:
    """Coulomb's law and the Stribeck law with the same static and kinetic coefficient.

    Attributes:
        speed: Relative speeds, rising, without 0, shape (n,) [m/s].
        stribeck: Coefficient, shape (n,) [-].
        coulomb: Coefficient, shape (n,) [-].
        static: Largest coefficient at rest [-].
        kinetic: Coefficient of Coulomb's law in motion [-].
        hopf_speed: Where damping just balances the fall of friction [m/s].
        hopf_coefficient: Coefficient there [-].
        hopf_slope: Slope of the Stribeck law there, ``-c/N`` [s/m].
    """

    speed: Array
    stribeck: Array
    coulomb: Array
    static: float
    kinetic: float
    hopf_speed: float
    hopf_coefficient: float
    hopf_slope: float

    def columns(self) -> dict[str, Array]:
        """The curves as the columns of a table, SI units."""
        return {
            'relative_speed [m/s]': self.speed,
            'stribeck_coefficient [-]': self.stribeck,
            'coulomb_coefficient [-]': self.coulomb,
        }


def stribeck_of(bearing: Bearing) -> Stribeck:
    """The Stribeck law of a bearing.

    Raises:
        PhysicsError: It has another law, for which the findings do not speak.
    """
    if not isinstance(bearing.friction, Stribeck):
        name = type(bearing.friction).__name__.lower()
        raise PhysicsError(f'friction law = {name} must be stribeck: the findings are about it')
    return bearing.friction


def check_point(bearing: Bearing, speed: float, load: float) -> None:
    """Check that stick-slip starts by itself at a point and ends at a higher speed.

    Args:
        bearing: The bearing.
        speed: Surface speed [m/s].
        load: Load [N].

    Raises:
        PhysicsError: The friction law or the point is none that the findings are about.
    """
    stribeck_of(bearing)
    fold, hopf = float(fold_speed(bearing, load)), float(hopf_speed(bearing, load))
    if not (math.isfinite(fold) and fold > 0.0):
        raise PhysicsError(
            f'load = {load:g} N has no fold: choose a bearing with damping and a load at which'
            ' friction falls faster than it damps'
        )
    if not 0.0 < speed < hopf:
        rpm = bearing.speed.factor('rpm')
        raise PhysicsError(
            f'speed = {speed / rpm:g} rpm must lie between 0 and the Hopf speed,'
            f' {hopf / rpm:.6g} rpm at {load:g} N: there stick-slip starts by itself'
        )


def over_speed(bearing: Bearing, load: float, points: int = 120, reverse: int = 9) -> Sweep:
    """Amplitude against belt speed, with both branches.

    Args:
        bearing: A bearing with a fold at this load.
        load: Load [N].
        points: Number of even steps in speed.
        reverse: Number of speeds between Hopf and fold at which the unstable cycle is sought in
            reverse time as well.

    Returns:
        The amplitudes over the surface speed [m/s].
    """
    hopf, averaged_fold = float(hopf_speed(bearing, load)), float(fold_speed(bearing, load))
    fold = float(exact_fold_speed(bearing, load))
    highest = _SPEED_ROOM * float(np.fmax(fold, averaged_fold))
    speed = _grid(highest / points, highest, (hopf, fold, averaged_fold), points)
    between = hopf + (fold - hopf) * np.linspace(0.2, 0.97, reverse)
    averaged = assess(bearing, speed, load)
    return _sweep(
        speed,
        np.asarray(exact_cycle(bearing, speed, load).amplitude),
        np.asarray(exact_unstable_cycle(bearing, speed, load).amplitude),
        (averaged.amplitude, averaged.threshold_amplitude),
        (hopf, fold, averaged_fold),
        (between, reverse_time_amplitudes(bearing, between, load)),
    )


def over_load(bearing: Bearing, speed: float, load: float, points: int = 100) -> Sweep:
    """Amplitude against normal force at a belt speed.

    Args:
        bearing: The bearing.
        speed: Surface speed [m/s].
        load: A load with a stick-slip cycle at this speed [N].
        points: Number of even steps in load.

    Returns:
        The amplitudes over the load [N].
    """
    hopf, averaged_fold = float(hopf_load(bearing, speed)), float(fold_load(bearing, speed))
    fold = _edge(lambda n: _has_cycle(bearing, speed, n), averaged_fold)
    highest = max(_LOAD_ROOM * averaged_fold, load)
    loads = _grid(highest / points, highest, (hopf, fold, averaged_fold), points)
    averaged = assess(bearing, speed, loads)
    return _sweep(
        loads,
        np.asarray(exact_cycle(bearing, speed, loads).amplitude),
        np.asarray(exact_unstable_cycle(bearing, speed, loads).amplitude),
        (averaged.amplitude, averaged.threshold_amplitude),
        (hopf, fold, averaged_fold),
    )


def over_kinetic(bearing: Bearing, speed: float, load: float, points: int = 40) -> Sweep:
    """Amplitude against the kinetic friction coefficient, at a belt speed and a load.

    The static coefficient stays, so friction falls by less the larger the kinetic one is. With
    ``kappa = (c + N nu)/(N Delta beta)`` the Hopf lies at ``kappa = exp(-v)`` and the fold under
    KBM at ``kappa = 2 I1e(v)/v``.

    Args:
        bearing: A bearing with a stick-slip cycle at this point.
        speed: Surface speed [m/s].
        load: Load [N].
        points: Number of even steps in the coefficient.

    Returns:
        The amplitudes over ``mu_k`` [-].
    """
    law = stribeck_of(bearing)
    v = law.decay * speed
    damping = (bearing.damping + load * law.viscous) / (load * law.decay)
    hopf, averaged_fold = damping * math.exp(v), damping * 0.5 * v / float(i1e(v))

    def with_fall(fall: float) -> Bearing:
        return replace(bearing, friction=replace(law, kinetic=max(law.static - fall, 0.0)))

    fold = _edge(lambda fall: _has_cycle(with_fall(fall), speed, load), averaged_fold)
    lowest = _FALL_ROOM * averaged_fold
    falls = _grid(lowest, law.static, (hopf, fold, averaged_fold), points)[::-1]
    rows = [_amplitudes(with_fall(fall), speed, load) for fall in falls.tolist()]
    exact, unstable, averaged, averaged_unstable = np.array(rows).T
    ends = (law.static - hopf, law.static - fold, law.static - averaged_fold)
    return _sweep(law.static - falls, exact, unstable, (averaged, averaged_unstable), ends)


def _sweep(
    value: Array,
    exact: Array,
    unstable: Array,
    averaged: tuple[Any, Any],
    ends: tuple[float, float, float],
    reverse: tuple[Array, Array] | None = None,
) -> Sweep:
    hopf, fold, averaged_fold = ends
    exists = np.flatnonzero(np.isfinite(exact))
    nearest = exists[np.argsort(np.abs(value[exists] - fold))[:1]]
    found, amplitude = reverse or (np.empty(0), np.empty(0))
    return Sweep(
        value, exact, unstable, np.asarray(averaged[0]), np.asarray(averaged[1]),
        hopf, fold, averaged_fold, float(np.max(exact[nearest], initial=0.0)), found, amplitude,
    )  # fmt: skip


def _grid(low: float, high: float, ends: tuple[float, ...], points: int) -> Array:
    """Even values, and more beside each bifurcation, where the branches bend."""
    near = np.outer(ends, np.concatenate([1.0 - _NEAR_AN_END, 1.0 + _NEAR_AN_END])).ravel()
    inside = near[(near > low) & (near < high)]
    return np.union1d(np.linspace(low, high, points), inside)


def _has_cycle(bearing: Bearing, speed: float, load: float) -> bool:
    return math.isfinite(exact_cycle(bearing, speed, load).amplitude)


def _edge(exists: Callable[[float], bool], about: float) -> float:
    """The least value with a cycle, sought in ever wider brackets about one close to it."""
    for width in _WIDTHS:
        outside, inside = about * (1.0 - width), about * (1.0 + width)
        if exists(inside) and not exists(outside):
            return _bisected(exists, outside, inside)
    return math.nan


def _bisected(exists: Callable[[float], bool], outside: float, inside: float) -> float:
    for _ in range(_HALVINGS):
        middle = 0.5 * (inside + outside)
        if not outside < middle < inside:
            break
        if exists(middle):
            inside = middle
        else:
            outside = middle
    return inside


def _amplitudes(bearing: Bearing, speed: float, load: float) -> tuple[float, float, float, float]:
    averaged = assess(bearing, speed, load)
    # Where steady sliding is unstable no cycle bounds its basin; looking for one takes a while.
    attracts = averaged.growth_rate <= 0.0
    return (
        exact_cycle(bearing, speed, load).amplitude,
        exact_unstable_cycle(bearing, speed, load).amplitude if attracts else math.nan,
        averaged.amplitude,
        averaged.threshold_amplitude,
    )


def reverse_time_amplitudes(
    bearing: Bearing, speed: ArrayLike, load: float, accuracy: float = 1e-8
) -> Array:
    """The unstable pure-slip amplitude by integration in reverse time, as published.

    Where steady sliding is stable, time reversed drives the motion away from it and onto the
    unstable cycle. Every motion begins inside that cycle, with half the amplitude KBM gives it,
    and is followed by Dormand and Prince's method of order 8 until its amplitude stays. With
    ``tau = -omega t``, ``u = omega (x - x_e)/V`` and ``w = x'/V``:

        ``du/dtau = -w``
        ``dw/dtau = u + 2 zeta w - N (mu(V (1 - w)) - mu(V)) / (m omega V)``

    Args:
        bearing: The bearing.
        speed: Surface speeds between Hopf and fold, shape (n,) [m/s].
        load: Load [N].
        accuracy: Relative change that is still to come when an amplitude is taken [-].

    Returns:
        Half the peak-to-peak displacement, shape (n,) [m]; ``nan`` where it did not settle.
    """
    v = np.atleast_1d(np.asarray(speed, dtype=float))
    threshold = np.asarray(assess(bearing, v, load).threshold_amplitude)
    bistable = np.isfinite(threshold)
    found = np.full(v.size, np.nan)
    if bistable.any():
        scale = v[bistable] / bearing.natural_frequency
        start = _START * threshold[bistable] / scale
        flow = _reversed_flow(bearing, v[bistable], load)
        found[bistable] = _settled(flow, start, accuracy) * scale
    return found


def _settled(flow: Callable[[float, Array], Array], start: Array, accuracy: float) -> Array:
    """The amplitudes at which motions from turning points at ``start`` settle [V/omega]."""
    state = np.concatenate([start, np.zeros(start.size)])
    amplitude, change = np.full((2, start.size), np.inf)
    found = np.full(start.size, np.nan)
    for _ in range(_MOST_CHUNKS):
        state = _followed(flow, 2.0 * np.pi * (_TURNS - _LAST_TURN), state).y[:, -1]
        turn = _followed(flow, 2.0 * np.pi * _LAST_TURN, state, dense_output=True)
        state, before, last = turn.y[:, -1], amplitude, change
        amplitude = np.array([_half_stroke(turn.sol, i, start.size) for i in range(start.size)])
        change = np.abs(amplitude - before)
        # The changes fall as a geometric series, whose rest is what is still to come.
        known = np.isfinite(last) & (change < last)
        rest = np.full(start.size, np.inf)
        rest[known] = change[known] ** 2 / (last[known] - change[known])
        done = np.isnan(found) & (rest <= accuracy * amplitude)
        found[done] = amplitude[done]
        if np.isfinite(found).all():
            break
    return found


def _reversed_flow(bearing: Bearing, v: Array, load: float) -> Callable[[float, Array], Array]:
    law, zeta = bearing.friction, bearing.damping_ratio
    force = load / (bearing.mass * bearing.natural_frequency * v)
    steady = law.coefficient(v)

    def flow(_: float, state: Array) -> Array:
        u, w = state[: v.size], state[v.size :]
        rise = force * (law.coefficient(v * (1.0 - w)) - steady)
        return np.concatenate([-w, u + 2.0 * zeta * w - rise])

    return flow


def _followed(
    flow: Callable[[float, Array], Array], span: float, state: Array, dense_output: bool = False
) -> Any:
    return solve_ivp(
        flow, (0.0, span), state, method='DOP853', rtol=_TOLERANCE, atol=_TOLERANCE * 1e-2,
        dense_output=dense_output,
    )  # fmt: skip


def _half_stroke(solution: Any, index: int, count: int) -> float:
    """Half the way between two successive turning points, ``nan`` if it has none [V/omega]."""
    tau = np.linspace(0.0, 2.0 * np.pi * _LAST_TURN, _SAMPLES)
    w = solution(tau)[count + index]
    turns = np.flatnonzero(w[:-1] * w[1:] <= 0.0)[:2]
    if turns.size < 2:
        return math.nan
    ends = [
        solution(brentq(lambda t: solution(t)[count + index], tau[i], tau[i + 1], xtol=1e-13))
        for i in turns
    ]
    return 0.5 * abs(float(ends[1][index] - ends[0][index]))


def stick_slip_history(bearing: Bearing, speed: float, load: float, follow: Follow) -> History:
    """Time history and phase portrait of stick-slip from near the equilibrium to its cycle.

    Args:
        bearing: A bearing whose steady sliding is unstable at this point.
        speed: Surface speed [m/s].
        load: Load [N].
        follow: Integrates the model in time.
    """
    cycle = exact_cycle(bearing, speed, load)
    averaged = float(assess(bearing, speed, load).amplitude)
    centre = float(bearing.equilibrium(speed, load))
    time, envelope = _averaged_growth(bearing, speed, load, averaged)
    first = centre + float(envelope[0])
    displacement, velocity, sticking = follow(bearing, speed, load, first, time)
    waveform = cycle.waveform(_CYCLE_POINTS)
    return History(
        speed=speed,
        load=load,
        equilibrium=centre,
        time=time,
        displacement=displacement,
        velocity=velocity,
        sticking=sticking,
        envelope=envelope,
        cycle_time=waveform[0],
        cycle_displacement=waveform[1],
        cycle_velocity=waveform[2],
        averaged_amplitude=averaged,
        exact_amplitude=float(cycle.amplitude),
        period=float(cycle.period),
        stick_fraction=float(cycle.stick_fraction),
    )


def _averaged_growth(
    bearing: Bearing, speed: float, load: float, final: float
) -> tuple[Array, Array]:
    """Times to well after stick-slip has set in, and the amplitude under KBM at each."""
    period = 2.0 * np.pi / bearing.natural_frequency

    def rate(_: float, amplitude: Array) -> Array:
        return amplitude_rate(bearing, speed, load, amplitude)

    def arrived(_: float, amplitude: Array) -> float:
        return float(amplitude[0] - _ARRIVED * final)

    grown = solve_ivp(
        rate, (0.0, _MOST_PERIODS * period), [_DISTURBANCE * final],
        method='LSODA', rtol=1e-9, atol=1e-12 * final, dense_output=True, events=arrived,
    )  # fmt: skip
    assert grown.t_events is not None
    assert grown.sol is not None
    times = grown.t_events[0]
    onset = float(times[0]) if times.size else _MOST_PERIODS * period
    periods = math.ceil(onset / period) + _PERIODS_AFTER
    time = np.linspace(0.0, periods * period, periods * _PER_PERIOD + 1)
    envelope = grown.sol(np.minimum(time, grown.t[-1]))[0]
    return time, np.asarray(envelope, dtype=float)


def friction_curves(bearing: Bearing, load: float) -> FrictionCurves:
    """The Coulomb and the Stribeck friction curve about zero relative speed.

    Args:
        bearing: The bearing; its Stribeck law gives both curves their coefficients.
        load: Load for the Hopf speed [N].
    """
    law = stribeck_of(bearing)
    hopf, fold = float(hopf_speed(bearing, load)), float(fold_speed(bearing, load))
    ahead = np.geomspace(1e-3, 1.0, _CURVE_POINTS // 2) * _CURVE_ROOM * fold
    speed = np.concatenate([-ahead[::-1], ahead])
    return FrictionCurves(
        speed=speed,
        stribeck=law.coefficient(speed),
        coulomb=Coulomb(law.static, law.kinetic).coefficient(speed),
        static=law.static,
        kinetic=law.kinetic,
        hopf_speed=hopf,
        hopf_coefficient=float(law.coefficient(hopf)),
        hopf_slope=float(law.slope(hopf)),
    )
