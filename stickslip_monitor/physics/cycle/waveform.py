# SPDX-License-Identifier: Apache-2.0
"""The motion over one exact cycle, from the polynomials it was integrated with."""

from __future__ import annotations

import math

import numpy as np
from numpy.polynomial import legendre

from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.physics.cycle.law import static_force
from stickslip_monitor.physics.cycle.orbit import follow
from stickslip_monitor.physics.cycle.setting import AROUND, Stretch, setting
from stickslip_monitor.physics.cycle.stable import slip_round_trip
from stickslip_monitor.physics.oscillator import Bearing


def _sampled(
    stretches: list[Stretch], time: FloatArray, start: float = 0.0
) -> tuple[FloatArray, FloatArray]:
    """Displacement and relative speed where a phase covers the time, ``nan`` elsewhere."""
    e, z = np.full(time.size, np.nan), np.full(time.size, np.nan)
    for stretch in stretches:
        begin, h = start + float(stretch.time[0]), float(stretch.h[0])
        x = 2.0 * (time - begin) / h - 1.0
        # A little beyond either end is rounding of the time.
        inside = (x >= -1.0 - 1e-9) & (x <= float(stretch.stop[0]) + 1e-9)
        e[inside] = legendre.legval(x[inside], stretch.e[0])
        z[inside] = legendre.legval(x[inside], stretch.z[0])
    return e, z


def through_belt(
    bearing: Bearing, speed: float, load: float, start: float, time: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Displacement [m] and velocity [m/s] of a cycle from where the lining falls behind.

    Args:
        bearing: The bearing.
        speed: ``V``, not 0 [m/s].
        load: ``N`` > 0 [N].
        start: Displacement beyond breakaway at the start [V/omega].
        time: Instants over one period, the last one closing it [s], shape (n,).
    """
    belt, omega = np.array([abs(speed)]), bearing.natural_frequency
    loads, tau = np.array([load]), time * omega
    behind, ahead = list[Stretch](), list[Stretch]()
    turn = slip_round_trip(bearing, belt, loads, np.array([start]), (behind, ahead))
    # Sticking is what no slip phase covers: it leads up to the next breakaway.
    e, w = np.minimum(tau - tau[-1], 0.0), np.zeros(time.size)
    change = float(turn.behind.time[0])
    slip = change + float(turn.ahead.time.sum())
    stroke = -2.0 * float(static_force(bearing.friction, load / (bearing.mass * omega * belt))[0])
    for stretches, begin, sign, mirror in ((ahead, change, -1.0, stroke), (behind, 0.0, 1.0, 0.0)):
        offset, relative = _sampled(stretches, tau, begin)
        covered = np.isfinite(offset) & (tau <= slip)
        e[covered], w[covered] = mirror + sign * offset[covered], sign * relative[covered]
    force = load / (bearing.mass * omega * belt)
    breakaway = static_force(bearing.friction, force) - 2.0 * bearing.damping_ratio
    side = math.copysign(1.0, speed)
    return side * (breakaway + e) * (belt / omega), side * belt * (1.0 - w)


def pure_slip(
    bearing: Bearing, speed: float, load: float, turning: float, time: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Displacement [m] and velocity [m/s] of a pure-slip cycle.

    Args:
        bearing: The bearing.
        speed: ``V``, not 0 [m/s].
        load: ``N`` > 0 [N].
        turning: Distance of the turning point below steady sliding [V/omega].
        time: Instants over one period, the last one closing it [s], shape (n,).
    """
    record: list[Stretch] = []
    belt, omega = np.array([abs(speed)]), bearing.natural_frequency
    local = setting(bearing, belt, np.array([load]), AROUND)
    follow(AROUND, local, np.array([-turning]), np.zeros(1), record)
    # An unstable cycle is followed back in time, from the end of the period.
    u, z = _sampled(record, (time - time[-1]) * omega)
    sign = math.copysign(1.0, speed)
    centre = bearing.equilibrium(belt, load)
    return sign * (centre + u * (belt / omega)), -sign * belt * z
