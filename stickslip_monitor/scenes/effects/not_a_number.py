# SPDX-License-Identifier: Apache-2.0
"""Sensors that send NaN: ``{speed: {share, windows}, load: {..}, bearing}``."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stickslip_monitor.monitor.signals import QUANTITIES
from stickslip_monitor.scenes.block import Block
from stickslip_monitor.scenes.settings import Settings
from stickslip_monitor.scenes.windows import KEYS as OCCASIONS
from stickslip_monitor.scenes.windows import Occasions, read_occasions

from .effect import Effect, Frame

KEYS = ('bearing', *QUANTITIES)


@dataclass(frozen=True, slots=True)
class NotANumber:
    """Puts NaN into some signals; ``occasions`` says when for each topic."""

    occasions: dict[str, Occasions]

    def apply(self, block: Block) -> None:
        """Put NaN in the place of the next samples that are hit."""
        for topic, occasions in self.occasions.items():
            signal = block.signals[topic]
            signal.value[occasions.hit(signal.time)] = np.nan


def build(settings: Settings, frame: Frame) -> Effect:
    """Build the effect."""
    return NotANumber(
        {
            channel.topic: read_occasions(own, frame.duration, frame.random(settings, channel))
            for channel, own in frame.sensors_of(settings, OCCASIONS, 'when it sends NaN')
        }
    )
