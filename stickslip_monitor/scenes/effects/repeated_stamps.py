# SPDX-License-Identifier: Apache-2.0
"""Messages that come twice, with one stamp: ``{speed: {share, windows}, load: {..}, bearing}``."""

from __future__ import annotations

from dataclasses import dataclass

from stickslip_monitor.monitor.signals import QUANTITIES
from stickslip_monitor.scenes.block import Block
from stickslip_monitor.scenes.settings import Settings
from stickslip_monitor.scenes.windows import KEYS as OCCASIONS
from stickslip_monitor.scenes.windows import Occasions, read_occasions

from .effect import Effect, Frame

KEYS = ('bearing', *QUANTITIES)


@dataclass(frozen=True, slots=True)
class RepeatedStamps:
    """Repeats messages of some signals; ``occasions`` says which for each topic."""

    occasions: dict[str, Occasions]

    def apply(self, block: Block) -> None:
        """Repeat those of the next messages that are hit."""
        for topic, occasions in self.occasions.items():
            signal = block.signals[topic]
            block.signals[topic] = signal.repeated(occasions.hit(signal.time))


def build(settings: Settings, frame: Frame) -> Effect:
    """Build the effect."""
    return RepeatedStamps(
        {
            channel.topic: read_occasions(own, frame.duration, frame.random(settings, channel))
            for channel, own in frame.sensors_of(settings, OCCASIONS, 'which messages come twice')
        }
    )
