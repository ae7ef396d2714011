# SPDX-License-Identifier: Apache-2.0
"""A sensor's error that is constant or drifts.

``{speed: {bias, drift per hour, unit}, load: {..}, bearing}``
"""

from __future__ import annotations

from dataclasses import dataclass

from stickslip_monitor.monitor.signals import QUANTITIES
from stickslip_monitor.scenes.block import Block
from stickslip_monitor.scenes.settings import Settings

from .effect import UNITS, Effect, Frame

KEYS = ('bearing', *QUANTITIES)
_HOUR = 3600.0


@dataclass(frozen=True, slots=True)
class Bias:
    """Adds to some signals; ``errors`` holds for each topic bias [SI] and drift [SI/s]."""

    errors: dict[str, tuple[float, float]]

    def apply(self, block: Block) -> None:
        """Add the error of the next samples."""
        for topic, (bias, drift) in self.errors.items():
            signal = block.signals[topic]
            signal.value[:] += bias + drift * signal.time


def build(settings: Settings, frame: Frame) -> Effect:
    """Build the effect."""
    errors = {}
    for channel, own in frame.sensors_of(settings, ['bias', 'drift', 'unit'], 'the error'):
        unit = own.choice('unit', UNITS[channel.quantity])
        drift = own.number('drift', f'{unit} per hour') / _HOUR if 'drift' in own else 0.0
        factor = channel.factor(unit)
        errors[channel.topic] = own.number('bias', unit) * factor, drift * factor
    return Bias(errors)
