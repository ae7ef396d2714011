# SPDX-License-Identifier: Apache-2.0
"""The motion over one exact cycle, by steps of the slip phase from instant to instant."""

from __future__ import annotations

import math

import numpy as np

from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.physics.cycle.slip import (
    AHEAD,
    BEHIND,
    LANDED,
    ONLY,
    about_steady_sliding,
    ahead_of_belt,
    follow_slip,
    next_length,
    slip_medium,
    steady_displacement,
)
from stickslip_monitor.physics.cycle.step import Medium, acceleration, slip_step
from stickslip_monitor.physics.law_numbers import HOLD, LawNumbers, law_numbers
from stickslip_monitor.physics.oscillator import Bearing

_TOLERANCE = 1e-12


def slipped(
    law: LawNumbers, medium: Medium, e: float, z: float, time: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Displacement and relative speed at rising instants after a start, each of shape (n,)."""
    places, speeds = np.empty(time.size), np.empty(time.size)
    now, r, h = 0.0, acceleration(law, medium, e, z), 1e-3
    for i, instant in enumerate(time.tolist()):
        while now < instant:
            s = min(h, instant - now)
            e1, z1, r1, error = slip_step(law, medium, e, z, r, s)
            allowed = _TOLERANCE * (abs(e) + abs(z) + s * (1.0 + abs(r)))
            h = next_length(s, error, allowed, blind=False)
            if error <= allowed:
                now, e, z, r = (instant if s == instant - now else now + s), e1, z1, r1
        places[i], speeds[i] = e, z
    return places, speeds


def _medium(bearing: Bearing, speed: float, load: float) -> tuple[LawNumbers, Medium]:
    law = law_numbers(bearing.friction)
    body = bearing.mass, bearing.damping, bearing.stiffness
    return law, slip_medium(law, body, abs(speed), load)


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
    law, medium = _medium(bearing, speed, load)
    tau = time * bearing.natural_frequency
    stroke = -2.0 * medium[1] * law[HOLD]
    _, change, place, _, _, _, _ = follow_slip(law, medium, start, 0.0, BEHIND, ONLY)
    ahead, end = ahead_of_belt(medium), change
    if place < stroke:
        found, more, _, _, _, _, _ = follow_slip(law, ahead, stroke - place, 0.0, AHEAD, ONLY)
        end += more if found == LANDED else 0.0
    # Sticking is what no slip phase covers: it leads up to the next breakaway.
    e, w = np.minimum(tau - tau[-1], 0.0), np.zeros(time.size)
    behind, over = tau <= change, (tau > change) & (tau <= end)
    e[behind], w[behind] = slipped(law, medium, start, 0.0, tau[behind])
    if over.any():
        offset, relative = slipped(law, ahead, stroke - place, 0.0, tau[over] - change)
        e[over], w[over] = stroke - offset, -relative
    breakaway = medium[1] * law[HOLD] - medium[2]
    side, unit = math.copysign(1.0, speed), abs(speed) / bearing.natural_frequency
    return side * (breakaway + e) * unit, side * abs(speed) * (1.0 - w)


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
    law, medium = _medium(bearing, speed, load)
    around, tau = about_steady_sliding(law, medium), time * bearing.natural_frequency
    u, z = slipped(law, around, -turning, 0.0, tau)
    side, unit = math.copysign(1.0, speed), abs(speed) / bearing.natural_frequency
    centre = medium[1] * law[HOLD] - medium[2] + steady_displacement(law, medium)
    return side * (centre + u) * unit, -side * abs(speed) * z
