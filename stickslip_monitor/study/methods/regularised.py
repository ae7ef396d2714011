# SPDX-License-Identifier: Apache-2.0
"""Friction smoothed by ``tanh(v/width)`` and integrated in time by a stiff solver."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from stickslip_monitor.physics.friction import Array
from stickslip_monitor.physics.oscillator import Bearing
from stickslip_monitor.study.methods.method import (
    MethodResult,
    Outcome,
    breakaway,
    found,
    scalar_law,
    typical_period,
)
from stickslip_monitor.study.methods.solver import Flow, run

_CYCLES = 10.0
_WATCHED = 0.6
_QUIET, _DECAYS = 0.5, 0.8


def half_range(turns: Array, speed: float, omega: float) -> float:
    """Half the range of the turning points [m]; ``nan`` for a motion that settles."""
    if turns.size < 2 or abs(turns[-1] - turns[-2]) < _DECAYS * abs(turns[1] - turns[0]):
        return math.nan
    amplitude = 0.5 * float(np.ptp(turns))
    return amplitude if amplitude * omega > _QUIET * speed else math.nan


@dataclass(frozen=True, slots=True)
class Regularised:
    """Regularised friction by ``scipy.integrate.solve_ivp``, LSODA.

    Args:
        width: Speed over which the sign turns, > 0 [m/s].
        tight: Whether tolerances are tightened from scipy's (1e-3 relative, 1e-6 absolute in
            metres and metres a second) to 1e-10 and 1e-14.
    """

    width: float
    tight: bool
    points: int = 1
    family: str = 'tanh friction, LSODA'
    practice: str = (
        'The sign of the relative speed becomes tanh(v/width); LSODA integrates in SI units from'
        ' breakaway for ten cycles, the last four of which are measured.'
    )
    source: str = (
        'common practice; Vigue, Vergez, Karkar and Cochelin, J. Sound Vib. 389 (2017) 350-363'
    )

    @property
    def name(self) -> str:
        """See :class:`~.method.Method`."""
        tolerance = 'tight' if self.tight else 'default'
        width = f'{self.width:.0e}'.replace('e-0', 'e-')
        return f'tanh {width} m/s, {tolerance}'

    @property
    def slow(self) -> bool:
        """See :class:`~.method.Method`."""
        return self.tight and self.width < 5e-5

    def refusal(self, bearing: Bearing, speed: float, load: float) -> str:
        """It applies everywhere, and says nothing about its error."""
        return ''

    def amplitude(self, bearing: Bearing, speed: float, load: float) -> MethodResult:
        """See :class:`~.method.Method`."""
        span = _CYCLES * typical_period(bearing, speed, load)
        start = (breakaway(bearing, speed, load), speed)
        rtol, atol = (1e-10, 1e-14) if self.tight else (1e-3, 1e-6)
        way = run(
            self._flow(bearing, speed, load), (0.0, span), start, method='LSODA', rtol=rtol,
            atol=atol,
        )  # fmt: skip
        if not way.good:
            return MethodResult(math.nan, Outcome.NOT_CONVERGED, way.evaluations)
        late = way.turns[way.turn_times > _WATCHED * span]
        return found(half_range(late, speed, bearing.natural_frequency), way.evaluations)

    def _flow(self, bearing: Bearing, speed: float, load: float) -> Flow:
        mass, damping, stiffness = bearing.mass, bearing.damping, bearing.stiffness
        law, width = scalar_law(bearing.friction), self.width

        def flow(_: float, y: Array) -> tuple[float, float]:
            x, v = float(y[0]), float(y[1])
            relative = speed - v
            friction = load * math.tanh(relative / width) * law(abs(relative))
            return v, (friction - damping * v - stiffness * x) / mass

        return flow
