# SPDX-License-Identifier: Apache-2.0
"""White, normally distributed noise of the sensors.

``{speed: {standard_deviation, unit}, load: {standard_deviation, unit}, bearing}``
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stickslip_monitor.errors import SceneError
from stickslip_monitor.monitor.signals import QUANTITIES
from stickslip_monitor.monitor.table import LOAD_UNITS
from stickslip_monitor.physics.oscillator import SPEED_UNITS
from stickslip_monitor.scenes.settings import Settings
from stickslip_monitor.scenes.signals import Block

from .effect import Effect, Frame

KEYS = ('bearing', *QUANTITIES)
_UNITS = {'speed': SPEED_UNITS, 'load': LOAD_UNITS}


@dataclass(frozen=True, slots=True)
class _Source:
    """The noise of one sensor: its standard deviation in SI units, and its random stream."""

    standard_deviation: float
    random: np.random.Generator


@dataclass(frozen=True, slots=True)
class SensorNoise:
    """Adds noise to some signals; ``sources`` holds that of each topic."""

    sources: dict[str, _Source]

    def apply(self, block: Block) -> None:
        """Add the noise of the next samples."""
        for topic, source in self.sources.items():
            value = block.signals[topic].value
            value += source.standard_deviation * source.random.standard_normal(value.size)


def build(settings: Settings, frame: Frame) -> Effect:
    """Build the effect."""
    named = [quantity for quantity in QUANTITIES if quantity in settings]
    if not named:
        raise SceneError(f'{settings.name} must name speed, load or both')
    sources = {}
    for quantity in named:
        own = settings.section(quantity, ['standard_deviation', 'unit'], 'the noise')
        unit = own.choice('unit', _UNITS[quantity])
        deviation = own.number('standard_deviation', unit, least=0.0)
        for channel in frame.pick(settings, quantity):
            random = frame.random(settings, channel)
            sources[channel.topic] = _Source(deviation * channel.factor(unit), random)
    return SensorNoise(sources)
