# SPDX-License-Identifier: Apache-2.0
"""Single samples that are far off, up or down.

``{speed: {size, unit, share, windows}, load: {..}, bearing}``
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stickslip_monitor.monitor.signals import QUANTITIES
from stickslip_monitor.scenes.block import Block
from stickslip_monitor.scenes.settings import Settings
from stickslip_monitor.scenes.windows import KEYS as OCCASIONS
from stickslip_monitor.scenes.windows import Occasions, read_occasions

from .effect import UNITS, Effect, Frame

KEYS = ('bearing', *QUANTITIES)


@dataclass(frozen=True, slots=True)
class _Source:
    """The spikes of one sensor: size in SI units, when, and the stream of their signs."""

    size: float
    occasions: Occasions
    signs: np.random.Generator


@dataclass(frozen=True, slots=True)
class Spikes:
    """Adds spikes to some signals; ``sources`` holds those of each topic."""

    sources: dict[str, _Source]

    def apply(self, block: Block) -> None:
        """Add the spikes of the next samples."""
        for topic, source in self.sources.items():
            signal = block.signals[topic]
            hit = source.occasions.hit(signal.time)
            signs = np.where(source.signs.random(signal.time.size) < 0.5, -1.0, 1.0)
            signal.value[hit] += source.size * signs[hit]


def build(settings: Settings, frame: Frame) -> Effect:
    """Build the effect."""
    sources = {}
    for channel, own in frame.sensors_of(settings, ['size', 'unit', *OCCASIONS], 'the spikes'):
        unit = own.choice('unit', UNITS[channel.quantity])
        size = own.number('size', unit) * channel.factor(unit)
        occasions = read_occasions(own, frame.duration, frame.random(settings, channel))
        sources[channel.topic] = _Source(size, occasions, frame.random(settings, channel, 'sign'))
    return Spikes(sources)
