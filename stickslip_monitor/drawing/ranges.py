# SPDX-License-Identifier: Apache-2.0
"""Which speeds and loads a picture shows where nobody says: those with the boundaries inside."""

from __future__ import annotations

import math

import numpy as np

from stickslip_monitor.physics.bifurcation import fold_load, fold_speed, hopf_speed
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
    both = (fold_speed(bearing, load), hopf_speed(bearing, load))
    return max((v for v in both if math.isfinite(v) and v > 0.0), default=law_speed(bearing))


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
