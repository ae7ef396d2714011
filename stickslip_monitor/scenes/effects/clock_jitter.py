# SPDX-License-Identifier: Apache-2.0
"""Time stamps that scatter: ``{speed: {standard_deviation in s}, load: {..}, bearing}``."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stickslip_monitor.monitor.signals import QUANTITIES
from stickslip_monitor.scenes.block import Block
from stickslip_monitor.scenes.settings import Settings

from .effect import Effect, Frame

KEYS = ('bearing', *QUANTITIES)


@dataclass(frozen=True, slots=True)
class ClockJitter:
    """Shifts stamps; ``sources`` holds for each topic standard deviation [s] and stream."""

    sources: dict[str, tuple[float, np.random.Generator]]

    def apply(self, block: Block) -> None:
        """Shift the stamps of the next samples; none comes to lie before 1970."""
        for topic, (deviation, random) in self.sources.items():
            stamp_ns = block.signals[topic].stamp_ns
            shift = random.standard_normal(stamp_ns.size) * (deviation * 1e9)
            stamp_ns += np.rint(shift).astype(np.int64)
            np.maximum(stamp_ns, 0, out=stamp_ns)


def build(settings: Settings, frame: Frame) -> Effect:
    """Build the effect."""
    sources = {}
    for channel, own in frame.sensors_of(settings, ['standard_deviation'], 'the jitter'):
        # A clock that is a minute off is not jittering.
        deviation = own.number('standard_deviation', 's', least=0.0, most=10.0)
        sources[channel.topic] = deviation, frame.random(settings, channel)
    return ClockJitter(sources)
