# SPDX-License-Identifier: Apache-2.0
"""The published findings on the stick-slip of a water-lubricated rubber bearing, computed again.

The published study averages the mass-spring-belt model (KBM) and compares with numerical
integration. Here the numerical side is the exact non-smooth cycle, so each finding comes with the
error of averaging: amplitudes of both branches over speed, load and kinetic coefficient, the
growth of stick-slip from a small disturbance, and the friction curves. The unstable branch is
found twice: by the return map of the exact cycle and, as published, by integration in reverse
time, in which a pure-slip unstable cycle attracts.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import bisect, fixed_point
from scipy.special import i1e

from stickslip_monitor.arrays import BoolArray, FloatArray
from stickslip_monitor.errors import PhysicsError
from stickslip_monitor.monitor.assessment import assess
from stickslip_monitor.physics.averaging.boundaries import (
    amplitude_rate,
    fold_load,
    fold_speed,
    hopf_load,
    hopf_speed,
)
from stickslip_monitor.physics.cycle.cycles import (
    exact_cycle,
    exact_fold_speed,
    exact_unstable_cycle,
)
from stickslip_monitor.physics.friction import Coulomb, Stribeck
from stickslip_monitor.physics.motion.integrator import Drive, MotionState, integrate
from stickslip_monitor.physics.oscillator import Bearing

REFERENCE = Bearing(
    mass=50.0,
    damping=400.0,
    stiffness=2.0e6,
    friction=Stribeck(static=0.30, kinetic=0.10, decay=10.0),
    journal_diameter=0.100,
)
"""The test-bench bearing of the docs, for which the findings hold."""
REFERENCE_RPM, REFERENCE_LOAD = 20.0, 1000.0

_CURVE_POINTS, _CURVE_ROOM = 400, 1.3


def stribeck_of(bearing: Bearing) -> Stribeck:
    """The Stribeck law of a bearing.

    Raises:
        PhysicsError: It has another law, which the findings do not cover.
    """
    if not isinstance(bearing.friction, Stribeck):
        name = type(bearing.friction).__name__.lower()
        raise PhysicsError(f'friction law = {name} must be stribeck: the findings are about it')
    return bearing.friction


def check_point(bearing: Bearing, speed: float, load: float) -> None:
    """Check that stick-slip starts by itself at a point [m/s, N] and ends at a higher speed.

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


@dataclass(frozen=True, slots=True, eq=False)
class FrictionCurves:
    """Coulomb's law and the Stribeck law with the same static and kinetic coefficient."""

    law: Stribeck
    speed: FloatArray  # relative speeds, rising, without 0, shape (n,) [m/s]
    stribeck: FloatArray  # coefficient, shape (n,) [-]
    coulomb: FloatArray  # coefficient, shape (n,) [-]
    hopf_speed: float  # where damping just balances the fall of friction [m/s]
    hopf_coefficient: float  # of the Stribeck law there [-]
    hopf_slope: float  # of the Stribeck law there, -c/N [s/m]

    def columns(self) -> dict[str, FloatArray]:
        """The curves as the columns of a table, SI units."""
        return {
            'relative_speed [m/s]': self.speed,
            'stribeck_coefficient [-]': self.stribeck,
            'coulomb_coefficient [-]': self.coulomb,
        }


def friction_curves(bearing: Bearing, load: float) -> FrictionCurves:
    """Both laws about zero relative speed, with the Hopf speed at a load [N]."""
    law = stribeck_of(bearing)
    hopf, fold = float(hopf_speed(bearing, load)), float(fold_speed(bearing, load))
    ahead = np.geomspace(1e-3, 1.0, _CURVE_POINTS // 2) * _CURVE_ROOM * fold
    speed = np.concatenate([-ahead[::-1], ahead])
    coulomb = Coulomb(law.static, law.kinetic).coefficient(speed)
    at_hopf = float(law.coefficient(hopf)), float(law.slope(hopf))
    return FrictionCurves(law, speed, law.coefficient(speed), coulomb, hopf, *at_hopf)


_DISTURBANCE, _ARRIVED = 0.05, 0.995
_MOST_PERIODS, _PERIODS_AFTER, _PER_PERIOD = 250, 8, 120
_CYCLE_POINTS = 721


@dataclass(frozen=True, slots=True, eq=False)
class History:
    """Stick-slip as it grows from a small disturbance of steady sliding, and its cycle."""

    speed: float  # surface speed [m/s]
    natural_frequency: float  # [rad/s]
    equilibrium: float  # displacement of steady sliding [m]
    time: FloatArray  # shape (n,) [s]
    displacement: FloatArray  # from the unloaded spring, shape (n,) [m]
    velocity: FloatArray  # shape (n,) [m/s]
    sticking: BoolArray  # shape (n,)
    envelope: FloatArray  # amplitude under KBM averaging at the same times, shape (n,) [m]
    cycle_displacement: FloatArray  # one period of the exact cycle from breakaway, shape (p,) [m]
    cycle_velocity: FloatArray  # shape (p,) [m/s]
    averaged_amplitude: float  # of stick-slip under KBM [m]
    exact_amplitude: float  # of stick-slip [m]
    period: float  # of the exact cycle [s]
    stick_fraction: float  # share of it in which the lining sticks [-]

    def columns(self) -> dict[str, FloatArray]:
        """The motion as the columns of a table, SI units."""
        return {
            'time [s]': self.time,
            'displacement [m]': self.displacement,
            'velocity [m/s]': self.velocity,
            'sticking': self.sticking.astype(np.int64),
            'kbm_envelope [m]': self.envelope,
        }


def stick_slip_history(bearing: Bearing, speed: float, load: float) -> History:
    """Stick-slip from near an unstable equilibrium at a point [m/s, N] to its cycle."""
    cycle = exact_cycle(bearing, speed, load)
    averaged = float(assess(bearing, speed, load).amplitude)
    centre = float(bearing.equilibrium(speed, load))
    time, envelope = _averaged_growth(bearing, speed, load, averaged)
    drive = Drive.constant(speed, load, float(time[-1]))
    start = MotionState.moving(centre + float(envelope[0]), 0.0, drive)
    motion = integrate(bearing, drive, start, time, compiled=False)
    waveform = cycle.waveform(_CYCLE_POINTS)
    return History(
        speed=speed,
        natural_frequency=bearing.natural_frequency,
        equilibrium=centre,
        time=time,
        displacement=motion.displacement,
        velocity=motion.velocity,
        sticking=motion.sticking,
        envelope=envelope,
        cycle_displacement=waveform[1],
        cycle_velocity=waveform[2],
        averaged_amplitude=averaged,
        exact_amplitude=float(cycle.amplitude),
        period=float(cycle.period),
        stick_fraction=float(cycle.stick_fraction),
    )


def _averaged_growth(
    bearing: Bearing, speed: float, load: float, final: float
) -> tuple[FloatArray, FloatArray]:
    """Times to well after stick-slip has set in, and the amplitude under KBM at each."""
    period = 2.0 * np.pi / bearing.natural_frequency

    def rate(_: float, amplitude: FloatArray) -> FloatArray:
        return amplitude_rate(bearing, speed, load, amplitude)

    def arrived(_: float, amplitude: FloatArray) -> float:
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


def reverse_time_amplitudes(bearing: Bearing, speed: FloatArray, load: float) -> FloatArray:
    """The unstable pure-slip amplitude by integration in reverse time, as published.

    Where steady sliding is stable, time reversed drives the motion away from it and onto the
    unstable cycle: every motion begins with the amplitude that KBM gives that cycle, and is
    followed by Dormand and Prince's method of order 8 from turn to turn, accelerated by Aitken's
    rule. With ``tau = -omega t``, ``u = omega (x - x_e)/V`` and ``w = x'/V``:

        ``du/dtau = -w``
        ``dw/dtau = u + 2 zeta w - N (mu(V (1 - w)) - mu(V)) / (m omega V)``

    Args:
        bearing: The bearing.
        speed: Surface speeds, shape (n,) [m/s].
        load: Load [N].

    Returns:
        Half the peak-to-peak displacement, shape (n,) [m]; ``nan`` where steady sliding is not
        stable or the motion does not settle.
    """
    threshold = np.asarray(assess(bearing, speed, load).threshold_amplitude)
    pairs = zip(speed.tolist(), threshold.tolist(), strict=True)
    return np.array([_reverse_time_amplitude(bearing, v, load, about) for v, about in pairs])


def _reverse_time_amplitude(bearing: Bearing, v: float, load: float, about: float) -> float:
    law, zeta, scale = bearing.friction, bearing.damping_ratio, v / bearing.natural_frequency
    force = load / (bearing.mass * bearing.natural_frequency * v)
    steady = float(law.coefficient(v))

    def flow(_: float, state: FloatArray) -> tuple[float, float]:
        u, w = state.tolist()
        rise = force * (float(law.coefficient(v * (1.0 - w))) - steady)
        return -w, u + 2.0 * zeta * w - rise

    def turn(u: Any) -> Any:
        """The last trough and crest of one turn that begins at a crest."""
        found: Any = solve_ivp(
            flow, (0.0, 2.5 * np.pi), [float(u), 0.0], method='DOP853', rtol=1e-11, atol=1e-13,
            events=lambda _, state: state[1],
        )  # fmt: skip
        return found.y_events[0][-2:, 0]

    if not math.isfinite(about):
        return math.nan
    try:
        crest = fixed_point(lambda u: turn(u)[1], about / scale, xtol=1e-10, maxiter=40)
    except (RuntimeError, IndexError):  # no convergence, or no turn
        return math.nan
    return 0.5 * float(np.ptp(turn(crest))) * scale


_NEAR_AN_END = np.geomspace(1e-9, 0.05, 8)
_WIDTHS = (1e-4, 1e-3, 1e-2, 0.1, 0.5)
_SPEED_ROOM, _LOAD_ROOM, _FALL_ROOM = 1.12, 6.0, 0.55
_none = partial(np.empty, 0)


@dataclass(frozen=True, slots=True, eq=False)
class Sweep:
    """Displacement amplitudes of the limit cycles over one parameter, in its own unit.

    Shapes are (n,), and ``nan`` is where there is no cycle.
    """

    value: FloatArray  # the parameter, rising, close-set beside the bifurcations
    exact: FloatArray  # of the exact stick-slip cycle [m]
    exact_unstable: FloatArray  # of the exact unstable cycle [m]
    averaged: FloatArray  # of stick-slip under first-order KBM averaging [m]
    averaged_unstable: FloatArray  # of the unstable cycle under KBM [m]
    hopf: float  # parameter at the Hopf bifurcation, the same for both methods
    exact_fold: float  # parameter at the exact fold
    averaged_fold: float  # parameter at the fold under KBM
    # Where the unstable cycle was sought in reverse time, and the amplitude found there [m].
    reverse_value: FloatArray = field(default_factory=_none)
    reverse: FloatArray = field(default_factory=_none)

    @property
    def fold_amplitude(self) -> float:
        """Exact amplitude beside the fold [m]."""
        exists = np.flatnonzero(np.isfinite(self.exact))
        nearest = exists[np.argsort(np.abs(self.value[exists] - self.exact_fold))[:1]]
        return float(np.max(self.exact[nearest], initial=0.0))

    @property
    def error(self) -> FloatArray:
        """Relative error of the averaged stick-slip amplitude, shape (n,) [-]."""
        return self.averaged / self.exact - 1.0

    @property
    def unstable_error(self) -> FloatArray:
        """Relative error of the averaged unstable amplitude, shape (n,) [-]."""
        return self.averaged_unstable / self.exact_unstable - 1.0

    def columns(self, heading: str) -> dict[str, FloatArray]:
        """The curves as the columns of a table, SI units; the heading is the parameter's."""
        value = np.concatenate([self.value, self.reverse_value])
        none, other = np.full(self.value.size, np.nan), np.full(self.reverse.size, np.nan)
        table = {
            heading: value,
            'exact_stick_slip_amplitude [m]': np.append(self.exact, other),
            'exact_unstable_amplitude [m]': np.append(self.exact_unstable, other),
            'kbm_stick_slip_amplitude [m]': np.append(self.averaged, other),
            'kbm_unstable_amplitude [m]': np.append(self.averaged_unstable, other),
            'reverse_time_unstable_amplitude [m]': np.append(none, self.reverse),
        }
        rows = np.argsort(value, kind='stable')
        return {name: column[rows] for name, column in table.items()}


def over_speed(bearing: Bearing, load: float, points: int = 120, reverse: int = 9) -> Sweep:
    """Amplitude against belt speed [m/s], with both branches.

    Args:
        bearing: A bearing with a fold at this load.
        load: Load [N].
        points: Number of even steps in speed.
        reverse: Number of speeds between Hopf and fold at which the unstable cycle is sought in
            reverse time as well.
    """
    hopf, averaged_fold = float(hopf_speed(bearing, load)), float(fold_speed(bearing, load))
    fold = float(exact_fold_speed(bearing, load))
    highest = _SPEED_ROOM * float(np.fmax(fold, averaged_fold))
    speed = _grid(highest / points, highest, (hopf, fold, averaged_fold), points)
    between = hopf + (fold - hopf) * np.linspace(0.2, 0.97, reverse)
    return Sweep(
        speed, *_amplitudes(bearing, speed, load), hopf, fold, averaged_fold,
        between, reverse_time_amplitudes(bearing, between, load),
    )  # fmt: skip


def over_load(bearing: Bearing, speed: float, load: float, points: int = 100) -> Sweep:
    """Amplitude against normal force [N] at a belt speed.

    Args:
        bearing: The bearing.
        speed: Surface speed [m/s].
        load: A load with a stick-slip cycle at this speed [N].
        points: Number of even steps in load.
    """
    hopf, averaged_fold = float(hopf_load(bearing, speed)), float(fold_load(bearing, speed))
    fold = _edge(lambda n: _has_cycle(bearing, speed, n), averaged_fold)
    highest = max(_LOAD_ROOM * averaged_fold, load)
    loads = _grid(highest / points, highest, (hopf, fold, averaged_fold), points)
    return Sweep(loads, *_amplitudes(bearing, speed, loads), hopf, fold, averaged_fold)


def over_kinetic(bearing: Bearing, speed: float, load: float, points: int = 40) -> Sweep:
    """Amplitude against the kinetic friction coefficient [-], at a belt speed and a load.

    The static coefficient stays, so friction falls by less the larger the kinetic one is. With
    ``kappa = (c + N nu)/(N Delta beta)`` the Hopf lies at ``kappa = exp(-v)`` and the fold under
    KBM at ``kappa = 2 I1e(v)/v``.

    Args:
        bearing: A bearing with a stick-slip cycle at this point.
        speed: Surface speed [m/s].
        load: Load [N].
        points: Number of even steps in the coefficient.
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
    return Sweep(
        law.static - falls, exact, unstable, averaged, averaged_unstable,
        law.static - hopf, law.static - fold, law.static - averaged_fold,
    )  # fmt: skip


def _amplitudes(bearing: Bearing, speed: Any, load: Any) -> tuple[Any, Any, Any, Any]:
    """Exact and unstable amplitude, and the same under KBM [m]."""
    averaged = assess(bearing, speed, load)
    return (
        exact_cycle(bearing, speed, load).amplitude,
        exact_unstable_cycle(bearing, speed, load).amplitude,
        averaged.amplitude,
        averaged.threshold_amplitude,
    )


def _grid(low: float, high: float, ends: tuple[float, ...], points: int) -> FloatArray:
    """Even values, and more beside each bifurcation, where the branches bend."""
    near = np.outer(ends, np.concatenate([1.0 - _NEAR_AN_END, 1.0 + _NEAR_AN_END])).ravel()
    inside = near[(near > low) & (near < high)]
    return np.union1d(np.linspace(low, high, points), inside)


def _has_cycle(bearing: Bearing, speed: float, load: float) -> bool:
    return math.isfinite(exact_cycle(bearing, speed, load).amplitude)


def _edge(exists: Callable[[float], bool], about: float) -> float:
    """Where a cycle begins to exist, sought in ever wider brackets about a value close to it."""
    for width in _WIDTHS:
        outside, inside = about * (1.0 - width), about * (1.0 + width)
        if exists(inside) and not exists(outside):
            return float(bisect(lambda x: exists(x) - 0.5, outside, inside, xtol=1e-14 * about))
    return math.nan
