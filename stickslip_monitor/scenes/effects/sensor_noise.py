# SPDX-License-Identifier: Apache-2.0
"""White, normally distributed noise of the sensors.

``{speed: {standard_deviation, unit}, load: {standard_deviation, unit}, bearing}``
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stickslip_monitor.monitor.signals import QUANTITIES
from stickslip_monitor.scenes.block import Block
from stickslip_monitor.scenes.settings import Settings

from .effect import UNITS, Effect, Frame

KEYS = ('bearing', *QUANTITIES)


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
    sources = {}
    for channel, own in frame.sensors_of(settings, ['standard_deviation', 'unit'], 'the noise'):
        unit = own.choice('unit', UNITS[channel.quantity])
        deviation = own.number('standard_deviation', unit, least=0.0) * channel.factor(unit)
        sources[channel.topic] = _Source(deviation, frame.random(settings, channel))
    return SensorNoise(sources)
