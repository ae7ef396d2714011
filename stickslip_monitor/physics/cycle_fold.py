# SPDX-License-Identifier: Apache-2.0
"""The exact fold: the last speed at which the slip phase meets the belt."""

from __future__ import annotations

import numpy as np

from stickslip_monitor.physics.cycle_orbit import follow
from stickslip_monitor.physics.cycle_roots import costly_root
from stickslip_monitor.physics.cycle_setting import can_gain, setting
from stickslip_monitor.physics.cycle_states import (
    FORWARD,
)
from stickslip_monitor.physics.friction import Array
from stickslip_monitor.physics.oscillator import Bearing

# Speeds in units of a guess between which the last cycle is looked for: averaging is off by some
# 1e-4 to 1e-2 at moderate load, by orders of magnitude where a cycle is far from harmonic.
_BELOW = (1e-3, 0.01, 0.03, 0.1, 0.2, 0.4, 0.6, 0.8, 0.9, 0.97, 0.99, 0.998)
_ABOVE = (1.0005, 1.005, 1.03, 1.1, 1.25, 1.7, 2.5, 5.0, 10.0, 30.0, 100.0, 1e3)
_RATIOS = np.array([*_BELOW, *_ABOVE])


def grazing(bearing: Bearing, speed: Array, load: Array) -> Array:
    """Signed distance of the slip phase from grazing, > 0 where it meets the belt, shape (n,)."""
    local = setting(bearing, speed, load, FORWARD)
    return follow(FORWARD, local, np.zeros(speed.size), np.zeros(speed.size)).margin


def fold(bearing: Bearing, load: Array, guess: Array) -> Array:
    """The last speed [m/s] with a stick-slip cycle, where its slip phase grazes the belt.

    Args:
        bearing: The bearing.
        load: ``N`` > 0 [N], shape (n,).
        guess: The fold of averaging [m/s], or another scale of the speed, finite, shape (n,).

    Returns:
        ``nan`` where no speed has a cycle, ``inf`` where none is the last, shape (n,).
    """
    out = np.full(load.size, np.nan)
    index = np.flatnonzero(can_gain(bearing, load))
    if not index.size:
        return out
    grid = guess[index, None] * _RATIOS
    loads = np.repeat(load[index], _RATIOS.size)
    hit = grazing(bearing, grid.ravel(), loads).reshape(grid.shape) > 0.0
    last = _RATIOS.size - 1 - np.argmax(hit[:, ::-1], axis=1)
    out[index[hit[:, -1]]] = np.inf
    rows = np.flatnonzero(hit.any(axis=1) & ~hit[:, -1])
    found, last = index[rows], last[rows]
    if found.size:
        out[found] = costly_root(
            lambda v, where: grazing(bearing, v, load[found[where]]),
            grid[rows, last],
            grid[rows, last + 1],
        )
    return out
