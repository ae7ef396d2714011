# SPDX-License-Identifier: Apache-2.0
"""The published findings on the stick-slip of a water-lubricated rubber bearing, computed again.

The published study averages the mass-spring-belt model (KBM) and compares with numerical
integration. Here the numerical side is the exact non-smooth cycle, so each finding comes with the
error of averaging. This module has the friction curves and the growth of stick-slip from a small
disturbance; the amplitudes are in :mod:`.sweeps`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp

from stickslip_monitor.arrays import BoolArray, FloatArray
from stickslip_monitor.errors import PhysicsError
from stickslip_monitor.monitor.assessment import assess
from stickslip_monitor.physics.averaging.boundaries import amplitude_rate, fold_speed, hopf_speed
from stickslip_monitor.physics.cycle.cycles import exact_cycle
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

    speed: FloatArray
    stribeck: FloatArray
    coulomb: FloatArray
    static: float
    kinetic: float
    hopf_speed: float
    hopf_coefficient: float
    hopf_slope: float

    def columns(self) -> dict[str, FloatArray]:
        """The curves as the columns of a table, SI units."""
        return {
            'relative_speed [m/s]': self.speed,
            'stribeck_coefficient [-]': self.stribeck,
            'coulomb_coefficient [-]': self.coulomb,
        }


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


_DISTURBANCE, _ARRIVED = 0.05, 0.995
_MOST_PERIODS, _PERIODS_AFTER, _PER_PERIOD = 250, 8, 120
_CYCLE_POINTS = 721


@dataclass(frozen=True, slots=True, eq=False)
class History:
    """Stick-slip as it grows from a small disturbance of steady sliding, and its cycle.

    Attributes:
        speed: Surface speed [m/s].
        natural_frequency: Of the bearing [rad/s].
        equilibrium: Displacement of steady sliding [m].
        time: Shape (n,) [s].
        displacement: From the unloaded spring, shape (n,) [m].
        velocity: Shape (n,) [m/s].
        sticking: Whether the lining sticks, shape (n,).
        envelope: Amplitude under KBM averaging at the same times, shape (n,) [m].
        cycle_displacement: One period of the exact cycle, from breakaway, shape (p,) [m].
        cycle_velocity: Shape (p,) [m/s].
        averaged_amplitude: Stick-slip amplitude under KBM [m].
        exact_amplitude: Exact stick-slip amplitude [m].
        period: Period of the exact cycle [s].
        stick_fraction: Share of it in which the lining sticks [-].
    """

    speed: float
    natural_frequency: float
    equilibrium: float
    time: FloatArray
    displacement: FloatArray
    velocity: FloatArray
    sticking: BoolArray
    envelope: FloatArray
    cycle_displacement: FloatArray
    cycle_velocity: FloatArray
    averaged_amplitude: float
    exact_amplitude: float
    period: float
    stick_fraction: float

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
    """Time history and phase portrait of stick-slip from near the equilibrium to its cycle.

    Args:
        bearing: A bearing whose steady sliding is unstable at this point.
        speed: Surface speed [m/s].
        load: Load [N].
    """
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
