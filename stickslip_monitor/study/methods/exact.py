# SPDX-License-Identifier: Apache-2.0
"""The exact cycle of ``physics.cycle`` as a rung of the ladder."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stickslip_monitor.physics.cycle import CycleKind, exact_cycle
from stickslip_monitor.physics.oscillator import Bearing
from stickslip_monitor.study.methods.method import MethodResult, Outcome, found


@dataclass(frozen=True, slots=True)
class ExactCycle:
    """One slip phase from breakaway, the law set-valued, contact located to rounding.

    Args:
        points: Operating points solved in one call; their common cost is shared.
    """

    points: int = 1
    family: str = 'exact cycle'
    slow: bool = False
    practice: str = (
        'One slip phase from breakaway to the next contact with the belt; the stick phase is a'
        ' straight line. Nothing is averaged, smoothed or waited for.'
    )
    source: str = 'this project, physics/cycle.py; Filippov (1988) for the set-valued law'

    @property
    def name(self) -> str:
        """See :class:`~.method.Method`."""
        return 'exact cycle' if self.points == 1 else f'exact cycle, {self.points} at once'

    def refusal(self, bearing: Bearing, speed: float, load: float) -> str:
        """It applies everywhere."""
        return ''

    def amplitude(self, bearing: Bearing, speed: float, load: float) -> MethodResult:
        """See :class:`~.method.Method`."""
        speeds = speed if self.points == 1 else np.full(self.points, speed)
        cycle = exact_cycle(bearing, speeds, load)
        kind, evaluations = np.ravel(cycle.kind)[0], int(np.ravel(cycle.evaluations)[0])
        amplitude = float(np.ravel(cycle.amplitude)[0])
        if kind == CycleKind.UNRESOLVED:
            return MethodResult(amplitude, Outcome.NOT_CONVERGED, evaluations)
        return found(amplitude, evaluations)
