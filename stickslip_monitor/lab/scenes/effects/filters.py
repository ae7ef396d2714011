# SPDX-License-Identifier: Apache-2.0
"""Sensors with memory: first-order filters, and means over the last seconds.

The filter ``dy/dt = (x - y) / time_constant`` is solved exactly for an input that is linear
between the instants of the sensor's grid. The mean is of the shaft itself, evaluated between the
samples, so ripple is averaged and not aliased.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from scipy.signal import lfilter

from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.lab.scenes.effects.effect import BuildContext, EffectKind
from stickslip_monitor.lab.scenes.sensing import LONGEST, SHORTEST
from stickslip_monitor.lab.scenes.settings import Settings
from stickslip_monitor.monitor.signals import QUANTITIES

# After that many time constants the initial state counts 2e-9.
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


def build_filtering(settings: Settings, context: BuildContext) -> None:
    """Give the sensors their filters."""
    for channel, own in context.sensors_of(settings, ['time_constant'], 'the filter'):
        context.sense(
            channel, LowPass(own.number('time_constant', 's', least=SHORTEST, most=LONGEST))
        )


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


def build_averaging(settings: Settings, context: BuildContext) -> None:
    """Let the sensors average."""
    for channel, own in context.sensors_of(settings, ['window'], 'the averaging'):
        context.sense(channel, MovingMean(own.number('window', 's', least=SHORTEST, most=LONGEST)))


# A level is made of its samples already.
_KEYS = ('bearing', *QUANTITIES)
EFFECTS = {
    'filtering': EffectKind(_KEYS, build_filtering),
    'averaging': EffectKind(_KEYS, build_averaging),
}
