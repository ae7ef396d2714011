# SPDX-License-Identifier: Apache-2.0
"""The published findings on the stick-slip of a water-lubricated rubber bearing, computed again.

The published study averages the mass-spring-belt model (KBM) and compares with numerical
integration. Here the numerical side is the exact non-smooth cycle, so each finding comes with the
error of averaging: amplitudes of both branches over speed, load and kinetic coefficient, and the
growth of stick-slip from a small disturbance.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.special import i1e

from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.errors import PhysicsError
from stickslip_monitor.monitor.assessment import assess
from stickslip_monitor.physics.averaging import amplitude_rate, fold_load, fold_speed, hopf_load, hopf_speed
from stickslip_monitor.physics.bearing import Bearing
from stickslip_monitor.physics.cycles import Cycle, exact_cycle, exact_fold_speed, exact_unstable_cycle
from stickslip_monitor.physics.friction import Stribeck, as_stribeck
from stickslip_monitor.physics.integrator import Drive, Motion, MotionState, integrate

REFERENCE = Bearing(
    mass=50.0,
    damping=400.0,
    stiffness=2.0e6,
    friction=Stribeck(static=0.30, kinetic=0.10, decay=10.0),
    journal_diameter=0.100,
)
"""The test-bench bearing of the docs, for which the findings hold."""
REFERENCE_RPM, REFERENCE_LOAD = 20.0, 1000.0


def check_point(bearing: Bearing, speed: float, load: float) -> None:
    """Check that stick-slip starts by itself at a point [m/s, N] and ends at a higher speed.

    Raises:
        PhysicsError: The friction law or the point is none that the findings are about.
    """
    as_stribeck(bearing.friction, 'a finding')
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


_DISTURBANCE, _ARRIVED = 0.05, 0.995
_MOST_PERIODS, _PERIODS_AFTER, _PER_PERIOD = 250, 8, 120


@dataclass(frozen=True, slots=True, eq=False)
class History:
    """Stick-slip as it grows from a small disturbance of steady sliding, and its cycle."""

    bearing: Bearing
    speed: float  # surface speed [m/s]
    equilibrium: float  # displacement of steady sliding [m]
    time: FloatArray  # shape (n,) [s]
    motion: Motion  # at these times
    envelope: FloatArray  # amplitude under KBM averaging at the same times, shape (n,) [m]
    averaged_amplitude: float  # of stick-slip under KBM [m]
    cycle: Cycle  # the exact one

    def columns(self) -> dict[str, FloatArray]:
        """The motion as the columns of a table, SI units."""
        return {
            'time [s]': self.time,
            'displacement [m]': self.motion.displacement,
            'velocity [m/s]': self.motion.velocity,
            'sticking': self.motion.sticking.astype(np.int64),
            'kbm_envelope [m]': self.envelope,
        }


def stick_slip_history(bearing: Bearing, speed: float, load: float) -> History:
    """Stick-slip from near an unstable equilibrium at a point [m/s, N] to its cycle."""
    averaged = float(assess(bearing, speed, load).amplitude)
    centre = float(bearing.equilibrium(speed, load))
    time, envelope = _averaged_growth(bearing, speed, load, averaged)
    drive = Drive.constant(speed, load, float(time[-1]))
    start = MotionState.moving(centre + float(envelope[0]), 0.0, drive)
    motion = integrate(bearing, drive, start, time, compiled=False)
    cycle = exact_cycle(bearing, speed, load)
    return History(bearing, speed, centre, time, motion, envelope, averaged, cycle)


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
        rate,
        (0.0, _MOST_PERIODS * period),
        [_DISTURBANCE * final],
        method='LSODA',
        rtol=1e-9,
        atol=1e-12 * final,
        dense_output=True,
        events=arrived,
    )
    assert grown.t_events is not None
    assert grown.sol is not None
    times = grown.t_events[0]
    onset = float(times[0]) if times.size else _MOST_PERIODS * period
    periods = math.ceil(onset / period) + _PERIODS_AFTER
    time = np.linspace(0.0, periods * period, periods * _PER_PERIOD + 1)
    envelope = grown.sol(np.minimum(time, grown.t[-1]))[0]
    return time, np.asarray(envelope, dtype=float)


_NEAR_AN_END = np.geomspace(1e-9, 0.05, 8)
_REACH = 0.5
_SPEED_ROOM, _LOAD_ROOM, _FALL_ROOM = 1.12, 6.0, 0.55


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
        return {
            heading: self.value,
            'exact_stick_slip_amplitude [m]': self.exact,
            'exact_unstable_amplitude [m]': self.exact_unstable,
            'kbm_stick_slip_amplitude [m]': self.averaged,
            'kbm_unstable_amplitude [m]': self.averaged_unstable,
        }


def over_speed(bearing: Bearing, load: float, points: int = 120) -> Sweep:
    """Amplitude against belt speed [m/s], in so many even steps, at a load with a fold [N]."""
    ends = [float(at(bearing, load)) for at in (hopf_speed, exact_fold_speed, fold_speed)]
    highest = _SPEED_ROOM * float(np.fmax(ends[1], ends[2]))
    speed = _grid(highest / points, highest, ends, points)
    return Sweep(speed, *_amplitudes(bearing, speed, load), *ends)


def over_load(bearing: Bearing, speed: float, load: float, points: int = 100) -> Sweep:
    """Amplitude against normal force [N], to one with a stick-slip cycle at this speed [m/s]."""
    hopf, averaged_fold = float(hopf_load(bearing, speed)), float(fold_load(bearing, speed))
    fold = _exact_fold(lambda n: exact_fold_speed(bearing, n), speed, averaged_fold)
    ends = hopf, fold, averaged_fold
    highest = max(_LOAD_ROOM * averaged_fold, load)
    loads = _grid(highest / points, highest, ends, points)
    return Sweep(loads, *_amplitudes(bearing, speed, loads), *ends)


def over_kinetic(bearing: Bearing, speed: float, load: float, points: int = 40) -> Sweep:
    """Amplitude against the kinetic friction coefficient [-], at a belt speed and a load.

    The static coefficient stays, so friction falls by less the larger the kinetic one is. With
    ``kappa = (c + N nu)/(N Delta beta)`` the Hopf lies at ``kappa = exp(-v)`` and the fold under
    KBM at ``kappa = 2 I1e(v)/v``.
    """
    law = as_stribeck(bearing.friction, 'a finding')
    v = law.decay * speed
    damping = (bearing.damping + load * law.viscous) / (load * law.decay)
    hopf, averaged_fold = damping * math.exp(v), damping * 0.5 * v / float(i1e(v))

    def with_fall(fall: float) -> Bearing:
        return replace(bearing, friction=replace(law, kinetic=max(law.static - fall, 0.0)))

    fold = _exact_fold(lambda x: exact_fold_speed(with_fall(x), load), speed, averaged_fold)
    lowest = _FALL_ROOM * averaged_fold
    ends = np.array([hopf, fold, averaged_fold])
    falls = _grid(lowest, law.static, ends, points)[::-1]
    rows = [_amplitudes(with_fall(fall), speed, load) for fall in falls.tolist()]
    return Sweep(law.static - falls, *np.array(rows).T, *(law.static - ends).tolist())


def _amplitudes(bearing: Bearing, speed: Any, load: Any) -> tuple[Any, Any, Any, Any]:
    """Exact and unstable amplitude, and the same under KBM [m]."""
    averaged = assess(bearing, speed, load)
    return (
        exact_cycle(bearing, speed, load).amplitude,
        exact_unstable_cycle(bearing, speed, load).amplitude,
        averaged.amplitude,
        averaged.threshold_amplitude,
    )


def _grid(low: float, high: float, ends: Sequence[float] | FloatArray, points: int) -> FloatArray:
    """Even values, and more beside each bifurcation, where the branches bend."""
    near = np.outer(ends, np.concatenate([1.0 - _NEAR_AN_END, 1.0 + _NEAR_AN_END])).ravel()
    inside = near[(near > low) & (near < high)]
    return np.union1d(np.linspace(low, high, points), inside)


def _exact_fold(speed_at: Callable[[float], Any], speed: float, averaged: float) -> float:
    """Where the exact fold is at a speed [m/s], near its place by averaging; ``nan`` if it is not.

    The fold speed rises with the parameter; where there is no fold it counts as 0.
    """

    def above(parameter: float) -> float:
        return float(np.nan_to_num(speed_at(parameter))) - speed

    low, high = (1.0 - _REACH) * averaged, (1.0 + _REACH) * averaged
    if not above(low) < 0.0 < above(high):
        return math.nan
    return float(brentq(above, low, high, xtol=1e-15 * averaged))
