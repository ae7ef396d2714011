# SPDX-License-Identifier: Apache-2.0
"""First-order Krylov-Bogoliubov-Mitropolsky averaging, solved from its closed forms."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from stickslip_monitor.physics.bifurcation import stationary_amplitudes
from stickslip_monitor.physics.friction import Stribeck
from stickslip_monitor.physics.oscillator import Bearing
from stickslip_monitor.study.methods.method import MethodResult, found


@dataclass(frozen=True, slots=True)
class Averaging:
    """Averaging as the monitor does it.

    Args:
        points: Operating points solved in one call; their common cost is shared.
    """

    points: int = 1
    family: str = 'KBM'
    slow: bool = False
    practice: str = (
        'First-order averaging of a harmonic motion; the amplitude balance is solved from its'
        ' closed form for the Stribeck law, by quadrature for laws without one.'
    )
    source: str = 'Bogoliubov and Mitropolsky, Asymptotic Methods (1961), ch. 1; PHYSICS.md'

    @property
    def name(self) -> str:
        """See :class:`~.method.Method`."""
        return 'KBM' if self.points == 1 else f'KBM, {self.points} at once'

    def refusal(self, bearing: Bearing, speed: float, load: float) -> str:
        """It applies everywhere."""
        return ''

    def amplitude(self, bearing: Bearing, speed: float, load: float) -> MethodResult:
        """See :class:`~.method.Method`."""
        speeds = speed if self.points == 1 else np.full(self.points, speed)
        cycles = stationary_amplitudes(bearing, speeds, load)
        first = (0,) * (cycles.amplitude.ndim - 1)
        stable = cycles.amplitude[first][cycles.stable[first]]
        closed = isinstance(bearing.friction, Stribeck)
        largest = float(stable[-1]) if stable.size else math.nan
        return found(largest, 0 if closed else None)
