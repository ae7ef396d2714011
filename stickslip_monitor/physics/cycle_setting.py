# SPDX-License-Identifier: Apache-2.0
"""The setting of the orbits at a point of a bearing, in units of ``V`` and ``1/omega``."""

from __future__ import annotations

import numpy as np

from stickslip_monitor.physics.cycle_laws import Index, scaled, starting_piece, steepest_fall
from stickslip_monitor.physics.cycle_states import Flags, Frame, Setting
from stickslip_monitor.physics.friction import Array
from stickslip_monitor.physics.oscillator import Bearing
from stickslip_monitor.physics.slip import Motion

# Beyond this friction force, in units of m omega V, the numbers run out.
_GREATEST = 1e150


def setting(bearing: Bearing, speed: Array, load: Array, frame: Frame) -> Setting:
    """What the orbits of a frame move in.

    Args:
        bearing: The bearing.
        speed: ``V`` > 0 [m/s], shape (n,).
        load: ``N`` > 0 [N], shape (n,).
        frame: Of the orbits.
    """
    every = np.arange(speed.size)
    force = friction_force(bearing, speed, load)
    damping = np.full(speed.size, bearing.damping_ratio)
    breakaway = scaled(bearing.friction, force, speed, 0.0)
    steady = breakaway.take(every, starting_piece(breakaway, speed, 1.0))
    one = np.ones((speed.size, 1))
    pull, slope = steady.rise(one)[:, 0], steady.slope(one)[:, 0]
    rest, hold = 2.0 * damping - pull, -breakaway.jump
    around = frame.drift == 0.0
    law = scaled(bearing.friction, force, speed, 1.0) if around else breakaway
    return Setting(
        motion=Motion(law, damping, frame.drift),
        piece=starting_piece(breakaway, speed, frame.reference),
        edges=law.pieces,
        speed=speed,
        pull=np.zeros_like(pull) if around else pull,
        rest=np.zeros_like(rest) if around else rest,
        stable=slope < 2.0 * damping,
        hold=hold - rest if around else hold,
    )


def friction_force(bearing: Bearing, speed: Array, load: Array) -> Array:
    """``N / (m omega V)``; ``inf`` where that is beyond the numbers, shape (n,)."""
    with np.errstate(over='ignore'):
        return load / (bearing.mass * bearing.natural_frequency * speed)


def can_gain(bearing: Bearing, load: Array) -> Flags:
    """Whether friction falls faster than damping rises at any speed, shape (n,).

    Where it does not, the flow contracts everywhere and has no cycle (Bendixson's criterion).
    """
    drive = np.asarray(steepest_fall(bearing.friction))
    gains: Flags = np.where(load > 0.0, load * drive, 0.0) > bearing.damping
    return gains


def runnable(bearing: Bearing, speed: Array, load: Array) -> Index:
    """The points at which there can be a cycle, and numbers to compute it with."""
    small = friction_force(bearing, speed, load) < _GREATEST
    return np.flatnonzero(can_gain(bearing, load) & small)
