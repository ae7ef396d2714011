# SPDX-License-Identifier: Apache-2.0
"""Sensors that send multiples of a step: ``{speed: {step, unit}, load: {..}, bearing}``."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stickslip_monitor.monitor.signals import QUANTITIES
from stickslip_monitor.scenes.block import Block
from stickslip_monitor.scenes.settings import Settings

from .effect import UNITS, Effect, Frame

KEYS = ('bearing', *QUANTITIES)


@dataclass(frozen=True, slots=True)
class Quantisation:
    """Rounds some signals; ``steps`` holds for each topic the step [SI]."""

    steps: dict[str, float]

    def apply(self, block: Block) -> None:
        """Round the next samples to the nearest multiple."""
        for topic, step in self.steps.items():
            value = block.signals[topic].value
            value[:] = np.rint(value / step) * step


def build(settings: Settings, frame: Frame) -> Effect:
    """Build the effect."""
    steps = {}
    for channel, own in frame.sensors_of(settings, ['step', 'unit'], 'the step'):
        unit = own.choice('unit', UNITS[channel.quantity])
        steps[channel.topic] = own.number('step', unit, least=1e-9) * channel.factor(unit)
    return Quantisation(steps)
