# SPDX-License-Identifier: Apache-2.0
"""How stick-slip grows out of a small disturbance of steady sliding, and its cycle."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from stickslip_monitor.monitor.assessment import assess
from stickslip_monitor.physics.averaging import amplitude_rate
from stickslip_monitor.physics.cycle import exact_cycle
from stickslip_monitor.physics.friction import Array
from stickslip_monitor.physics.oscillator import Bearing

Follow = Callable[[Bearing, float, float, float, Array], tuple[Array, Array, NDArray[np.bool_]]]
"""Integrates the model in time: bearing, surface speed [m/s], load [N], displacement [m] at rest
relative to the ground at time 0, rising times from 0 [s]; displacement [m], velocity [m/s] and
whether the lining sticks, at those times."""

_DISTURBANCE, _ARRIVED = 0.05, 0.995
_MOST_PERIODS, _PERIODS_AFTER, _PER_PERIOD = 250, 8, 120
_CYCLE_POINTS = 721


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
