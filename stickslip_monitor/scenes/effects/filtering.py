# SPDX-License-Identifier: Apache-2.0
"""First-order filters of the sensors: ``{speed: {time_constant in s}, load: {..}, bearing}``.

``dy/dt = (x - y) / time_constant``, solved exactly for an input that is linear between the
instants of the sensor's grid.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from scipy.signal import lfilter

from stickslip_monitor.monitor.signals import QUANTITIES
from stickslip_monitor.scenes.sensing import LONGEST, SHORTEST
from stickslip_monitor.scenes.settings import Settings
from stickslip_monitor.scenes.signals import FloatArray

from .effect import Frame

KEYS = ('bearing', *QUANTITIES)
# The begin is forgotten to 2e-9.
_TIME_CONSTANTS = 20.0


@dataclass(slots=True)
class LowPass:
    """The filter of one sensor."""

    time_constant: float
    _forward: FloatArray = field(default_factory=lambda: np.empty(0))
    _back: FloatArray = field(default_factory=lambda: np.empty(0))
    _state: FloatArray = field(default_factory=lambda: np.empty(0))

    @property
    def length(self) -> float:
        """Time after which the past hardly counts [s]."""
        return _TIME_CONSTANTS * self.time_constant

    @property
    def scale(self) -> float:
        """Time over which it resolves the past [s]."""
        return self.time_constant

    def start(self, step: float, value: float) -> None:
        """Settle on a value that was constant until now."""
        left = math.exp(-step / self.time_constant)
        lag = -math.expm1(-step / self.time_constant) * self.time_constant / step
        self._forward = np.array([1.0 - lag, lag - left])
        self._back = np.array([1.0, -left])
        self._state = np.array([lag * value])

    def next(self, value: FloatArray) -> FloatArray:
        """Filter the next samples, shape (n,)."""
        filtered, self._state = lfilter(self._forward, self._back, value, zi=self._state)
        return np.asarray(filtered, float)


def build(settings: Settings, frame: Frame) -> None:
    """Give the sensors their filters."""
    for channel, own in frame.sensors_of(settings, ['time_constant'], 'the filter'):
        frame.sense(
            channel, LowPass(own.number('time_constant', 's', least=SHORTEST, most=LONGEST))
        )
