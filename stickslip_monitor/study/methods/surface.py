# SPDX-License-Identifier: Apache-2.0
"""The precomputed surface of exact cycles as a rung of the ladder."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stickslip_monitor.physics.bifurcation import fold_speed
from stickslip_monitor.physics.cycle_surface import surface_of
from stickslip_monitor.physics.friction import Array
from stickslip_monitor.physics.oscillator import Bearing
from stickslip_monitor.physics.panels import Flags
from stickslip_monitor.study.methods.method import MethodResult, found


@dataclass(frozen=True, slots=True)
class Surface:
    """Polynomials through exact cycles of the bearing, built before.

    Args:
        points: Operating points looked up in one call; their common cost is shared.
    """

    points: int = 1
    family: str = 'surface'
    slow: bool = False
    practice: str = (
        'Exact cycles over a range of speeds and loads, computed once for each bearing and'
        ' interpolated in coordinates that move with the fold.'
    )
    source: str = 'this project, physics/cycle_surface.py'

    @property
    def name(self) -> str:
        """See :class:`~.method.Method`."""
        return 'surface' if self.points == 1 else f'surface, {self.points} at once'

    def refusal(self, bearing: Bearing, speed: float, load: float) -> str:
        """Points that the surface does not reach."""
        surface_of(bearing).prepare()
        _, known = _lookup(bearing, np.array([speed]), np.array([load]))
        return '' if known[0] else 'the surface does not reach this speed, load and law'

    def amplitude(self, bearing: Bearing, speed: float, load: float) -> MethodResult:
        """See :class:`~.method.Method`."""
        amplitude, _ = _lookup(bearing, np.full(self.points, speed), np.full(self.points, load))
        return found(float(amplitude[0]), 0)


def _lookup(bearing: Bearing, speed: Array, load: Array) -> tuple[Array, Flags]:
    fold = np.asarray(fold_speed(bearing, load))
    return surface_of(bearing).lookup(speed, load, fold)
