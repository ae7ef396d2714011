# SPDX-License-Identifier: Apache-2.0
"""Sensors that send the mean of the last seconds: ``{speed: {window in s}, load: {..}, bearing}``.

The mean is of the shaft itself, followed between the samples: ripple is averaged, not aliased.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from stickslip_monitor.monitor.signals import QUANTITIES
from stickslip_monitor.scenes.sensing import LONGEST, SHORTEST
from stickslip_monitor.scenes.settings import Settings
from stickslip_monitor.scenes.signals import FloatArray

from .effect import Frame

KEYS = ('bearing', *QUANTITIES)


@dataclass(slots=True)
class MovingMean:
    """``y(t) = (1/window) * integral of x from t - window to t``, by trapezia of the grid."""

    window: float
    _steps: float = 0.0
    _sum: FloatArray = field(default_factory=lambda: np.empty(0))
    _last: float = 0.0

    @property
    def length(self) -> float:
        """Time after which the past does not count [s]."""
        return self.window

    @property
    def scale(self) -> float:
        """Time over which it resolves the past [s]."""
        return self.window

    def start(self, step: float, value: float) -> None:
        """Settle on a value that was constant until now."""
        self._steps = self.window / step
        # Of the running integral, in steps, as many as the window needs.
        self._sum = value * np.arange(-int(self._steps) - 1.0, 1.0)
        self._last = value

    def next(self, value: FloatArray) -> FloatArray:
        """Average at the next samples, shape (n,)."""
        pieces = 0.5 * (value + np.concatenate([[self._last], value[:-1]]))
        # One running sum through all blocks: their length does not change its rounding.
        total = np.concatenate(
            [self._sum, np.cumsum(np.concatenate([self._sum[-1:], pieces]))[1:]]
        )
        whole, rest = int(self._steps), self._steps - int(self._steps)
        now, then = total[whole + 2 :], total[2 : total.size - whole]
        before = total[1 : total.size - whole - 1]
        self._sum, self._last = total[-whole - 2 :], float(value[-1])
        return (now - then + rest * (then - before)) / self._steps


def build(settings: Settings, frame: Frame) -> None:
    """Let the sensors average."""
    for channel, own in frame.sensors_of(settings, ['window'], 'the averaging'):
        frame.sense(channel, MovingMean(own.number('window', 's', least=SHORTEST, most=LONGEST)))
