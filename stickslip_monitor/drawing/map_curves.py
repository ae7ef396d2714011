# SPDX-License-Identifier: Apache-2.0
"""The curves of a stability map, and the ranges of speed and load that show its boundaries.

At a given speed the averaged model's dissipation ``c a/2`` does not depend on the load, and its
drive ``N S(a; V)`` is proportional to it. So at each speed the regimes follow each other with
rising load as stable, bistable, unstable; each boundary is one load for any friction law; and a
cycle of amplitude ``a`` exists at exactly one load, ``N = c a / (2 S(a; V))``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.physics.averaging.boundaries import (
    fold_load,
    fold_speed,
    hopf_load,
    hopf_speed,
)
from stickslip_monitor.physics.cycle.cycles import exact_fold_speed
from stickslip_monitor.physics.friction import Stribeck
from stickslip_monitor.physics.oscillator import Bearing

Range = tuple[float, float]

_ROOM = 1.25
_LOADS_ABOVE_ONSET = 10.0
_SPEEDS_TRIED = 200
_RPM_WITHOUT_SCALE = 60.0
_LOAD_WITHOUT_SCALE = 1000.0


def law_speed(bearing: Bearing) -> float:
    """A surface speed [m/s] by which friction has done most of its falling."""
    law = bearing.friction
    if isinstance(law, Stribeck):
        return 4.0 / law.decay
    if law.breakpoints:
        return law.breakpoints[-1]
    return float(bearing.speed.to_surface(_RPM_WITHOUT_SCALE, 'rpm'))


def _boundary_speed(bearing: Bearing, load: float) -> float:
    """The highest finite boundary at a load [m/s]; the law's own speed without one."""
    exact = float(exact_fold_speed(bearing, load))
    every = (fold_speed(bearing, load), hopf_speed(bearing, load), exact)
    return max((v for v in every if math.isfinite(v) and v > 0.0), default=law_speed(bearing))


def diagram_speeds(bearing: Bearing, load: float) -> Range:
    """Surface speeds [m/s] from rest to well past the fold at a load [N]."""
    return 0.0, _ROOM * _boundary_speed(bearing, load)


def onset_load(bearing: Bearing) -> float:
    """Least load [N] with stick-slip at some speed; ``nan`` where no load has it."""
    top = law_speed(bearing)
    edges = [v for v in bearing.friction.breakpoints if v <= top]
    speeds = np.concatenate([np.linspace(0.0, top, _SPEEDS_TRIED), edges])
    return float(np.fmin.reduce(fold_load(bearing, speeds)))


def map_loads(bearing: Bearing, highest: float = 0.0) -> Range:
    """Loads [N] from none to a good deal of stick-slip, and to the highest one measured."""
    onset = onset_load(bearing)
    if highest > 0.0:
        return 0.0, _ROOM * max(highest, onset if math.isfinite(onset) else 0.0)
    return 0.0, _LOADS_ABOVE_ONSET * onset if onset > 0.0 else _LOAD_WITHOUT_SCALE


def map_speeds(bearing: Bearing, top_load: float, highest: float = 0.0) -> Range:
    """Surface speeds [m/s] from rest past the fold at the top load, and the highest measured."""
    return 0.0, max(_ROOM * _boundary_speed(bearing, top_load), 1.05 * highest)


_BESIDE = (1.0 - 1e-9, 1.0, 1.0 + 1e-9)
_FAR = np.geomspace(1.0, 30.0, 60)[1:]


@dataclass(frozen=True, slots=True)
class Boundaries:
    """What divides the plane of speed and load, as loads over speed.

    Attributes:
        speed: Surface speeds, rising, shape (n,) [m/s].
        fold_load: Load above which a stick-slip cycle exists, ``nan`` for none, shape (n,) [N].
        hopf_load: Load above which the equilibrium is unstable, ``nan`` for none, shape (n,) [N].
        caution_load: Load above which the fold margin is below the caution margin, ``nan`` for
            none, shape (n,) [N].
    """

    speed: FloatArray
    fold_load: FloatArray
    hopf_load: FloatArray
    caution_load: FloatArray


def boundaries(
    bearing: Bearing, speeds: Range, caution_margin: float, points: int = 400
) -> Boundaries:
    """Compute the curves of a stability map.

    Args:
        bearing: The bearing.
        speeds: Lowest and highest surface speed, 0 <= low < high [m/s].
        caution_margin: Fold margin below which the alarm says caution [-].
        points: Number of evenly spaced speeds; the curves' own corners come on top.

    Returns:
        The curves.
    """
    corners = np.outer(bearing.friction.breakpoints, _BESIDE).ravel()
    inside = corners[(corners > speeds[0]) & (corners < speeds[1])]
    speed = np.union1d(np.linspace(*speeds, points), inside)
    return Boundaries(
        speed=speed,
        fold_load=np.asarray(fold_load(bearing, speed)),
        hopf_load=np.asarray(hopf_load(bearing, speed)),
        caution_load=caution_load(bearing, speed, caution_margin),
    )


def caution_load(bearing: Bearing, speed: FloatArray, margin: float) -> FloatArray:
    """Load above which ``V / V_F(N) - 1 < margin``, ``nan`` for none [N].

    The fold speed is the highest with a cycle, so a load is close to the fold as soon as a cycle
    exists at any speed from ``V/(1 + margin)`` upwards.

    Args:
        bearing: The bearing.
        speed: Surface speeds, rising, shape (n,) [m/s].
        margin: The caution margin [-].
    """
    nearest = speed / (1.0 + margin)
    higher = np.union1d(np.concatenate([nearest, speed]), speed[-1] * _FAR)
    load = np.asarray(fold_load(bearing, higher))
    load = np.where(np.isnan(load), np.inf, load)
    least = np.minimum.accumulate(load[::-1])[::-1][np.searchsorted(higher, nearest)]
    return np.where(np.isfinite(least), least, np.nan)


def map_columns(bearing: Bearing, curves: Boundaries) -> dict[str, Sequence[object]]:
    """The curves as the columns of a table, by heading, SI units but for the shaft speed."""
    return {
        'shaft_speed [rpm]': bearing.speed.from_surface(curves.speed, 'rpm').tolist(),
        'surface_speed [m/s]': curves.speed.tolist(),
        'fold_load [N]': curves.fold_load.tolist(),
        'hopf_load [N]': curves.hopf_load.tolist(),
        'caution_load [N]': curves.caution_load.tolist(),
    }
