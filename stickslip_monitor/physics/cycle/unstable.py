# SPDX-License-Identifier: Apache-2.0
"""The unstable pure-slip cycles: fixed points of the return map on ``x' = 0``."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stickslip_monitor.arrays import BoolArray, FloatArray, IndexArray
from stickslip_monitor.physics.cycle.orbit import follow
from stickslip_monitor.physics.cycle.setting import (
    AROUND,
    BACKWARD,
    End,
    Orbits,
    Setting,
    runnable,
    setting,
)
from stickslip_monitor.physics.oscillator import Bearing
from stickslip_monitor.physics.roots import costly_root

# Panels in which a sign change of the energy gain is looked for.
_GRID = 24
# Relative gain of energy in a turn that is rounding.
_BALANCED = 1e-13
# Exponent beyond which a Floquet multiplier is as good as infinite.
_LARGEST = 700.0


@dataclass(slots=True)
class PureSlip:
    """Pure-slip cycles; every array has shape (n,), ``nan`` where there is none.

    Attributes:
        exists: Whether there is one.
        resolved: Whether that is known.
        trough: Displacement below steady sliding at the turning point, > 0.
        crest: Displacement above it.
        period: Its duration.
        multiplier: Floquet multiplier, > 1 for an unstable cycle.
        evaluations: Evaluations of the law, one for all nodes of a step together.
    """

    exists: BoolArray
    resolved: BoolArray
    trough: FloatArray
    crest: FloatArray
    period: FloatArray
    multiplier: FloatArray
    evaluations: IndexArray


def _turns(
    whole: Setting, index: IndexArray, amplitude: FloatArray, spent: IndexArray
) -> tuple[Orbits, FloatArray]:
    """One turn about steady sliding and its relative gain of energy, > 0 outward."""
    orbits = follow(AROUND, whole.take(index), -amplitude, np.zeros(index.size))
    np.add.at(spent, index, orbits.evaluations)
    gain = -2.0 * orbits.work / (amplitude * amplitude)
    # An orbit that came from far outside has lost energy on the way.
    return orbits, np.where(orbits.end == End.RETURNED, gain, -1.0)


def _outermost(bearing: Bearing, speed: FloatArray, load: FloatArray) -> FloatArray:
    """Turning point of the orbit that grazes the belt, by going back in time from there."""
    local = setting(bearing, speed, load, BACKWARD)
    orbits = follow(BACKWARD, local, local.hold, np.zeros(speed.size))
    turned = orbits.end == End.RETURNED
    return np.where(turned, local.rest - orbits.e, np.nan)


def pure_slip(
    bearing: Bearing, speed: FloatArray, load: FloatArray, *, stable: bool = False
) -> PureSlip:
    """A pure-slip cycle about steady sliding, if there is one.

    Args:
        bearing: The bearing.
        speed: ``V`` > 0 [m/s], shape (n,).
        load: ``N`` > 0 [N], shape (n,).
        stable: The largest stable one about an unstable steady sliding, in place of the smallest
            unstable one, which bounds the basin of a stable steady sliding.
    """
    n = speed.size
    blank, spent = np.full((4, n), np.nan), np.zeros(n, dtype=np.intp)
    exists, resolved = np.zeros(n, dtype=bool), np.ones(n, dtype=bool)
    out = PureSlip(exists, resolved, blank[0], blank[1], blank[2], blank[3], spent)
    usable = runnable(bearing, speed, load)
    if not usable.size:
        return out
    speed, load = speed[usable], load[usable]
    whole = setting(bearing, speed, load, AROUND)
    spent = np.zeros(usable.size, dtype=np.intp)
    largest, rows = np.full(usable.size, np.nan), np.flatnonzero(whole.stable != stable)
    largest[rows] = _outermost(bearing, speed[rows], load[rows])
    low, high = (_inner_bracket if stable else _bracket)(whole, largest, spent)
    out.evaluations[usable] = spent
    index = np.flatnonzero(np.isfinite(low))
    if not index.size:
        return out
    roots = costly_root(
        lambda a, rows: _turns(whole, index[rows], a, spent)[1], low[index], high[index]
    )
    amplitude = roots.value
    orbits, _ = _turns(whole, index, amplitude, spent)
    out.evaluations[usable] = spent
    # The grazing orbit itself is no root, but as close to one as numbers tell.
    grazes = high[index] - low[index] <= 2.0 * _BALANCED * high[index]
    closed = (orbits.end == End.RETURNED) & (roots.converged | grazes)
    out.resolved[usable[index[~closed]]] = False
    where = usable[index[closed]]
    out.exists[where] = True
    out.trough[where], out.crest[where] = amplitude[closed], orbits.crest[closed]
    out.period[where] = -orbits.time[closed]
    out.multiplier[where] = np.exp(np.minimum(-orbits.divergence[closed], _LARGEST))
    return out


def _gains(whole: Setting, usable: IndexArray, grid: FloatArray, spent: IndexArray) -> FloatArray:
    """Relative gains of energy on a grid of amplitudes, shape of ``grid``."""
    _, gain = _turns(whole, np.repeat(usable, grid.shape[1]), grid.ravel(), spent)
    return gain.reshape(grid.shape)


def _inner_bracket(
    whole: Setting, largest: FloatArray, spent: IndexArray
) -> tuple[FloatArray, FloatArray]:
    """Amplitudes around the largest orbit at which a gain of energy becomes a loss."""
    low, high = np.full(largest.size, np.nan), np.full(largest.size, np.nan)
    usable = np.flatnonzero(largest > 0.0)
    if not usable.size:
        return low, high
    grid = largest[usable, None] * np.append(1e-3, np.arange(1, _GRID + 1) / _GRID)
    outward = _gains(whole, usable, grid, spent) > 0.0
    turns = outward[:, :-1] & ~outward[:, 1:]
    found = np.flatnonzero(turns.any(axis=1))
    last = _GRID - 1 - np.argmax(turns[found, ::-1], axis=1)
    low[usable[found]], high[usable[found]] = grid[found, last], grid[found, last + 1]
    return low, high


def _bracket(
    whole: Setting, largest: FloatArray, spent: IndexArray
) -> tuple[FloatArray, FloatArray]:
    """Amplitudes around the smallest orbit at which a loss of energy becomes a gain."""
    n = largest.size
    low, high = np.full(n, np.nan), np.full(n, np.nan)
    usable = np.flatnonzero(largest > 0.0)
    if not usable.size:
        return low, high
    grid = largest[usable, None] * (np.arange(1, _GRID + 1) / _GRID)
    gain = _gains(whole, usable, grid, spent)
    outward = gain > 0.0
    # Close to the fold of a stiff law the cycle is the grazing orbit itself, but for rounding.
    grazes = ~outward.any(axis=1) & (np.abs(gain[:, -1]) < _BALANCED)
    outward[:, -1] |= grazes
    found = np.flatnonzero(outward.any(axis=1))
    first = np.argmax(outward[found], axis=1)
    where = usable[found]
    high[where] = grid[found, first]
    # Steady sliding itself is stable, so the first panel starts with a loss.
    low[where] = np.where(first > 0, grid[found, first - 1], 1e-3 * high[where])
    edge = usable[grazes]
    low[edge] = high[edge] * (1.0 - _BALANCED)
    return low, high
