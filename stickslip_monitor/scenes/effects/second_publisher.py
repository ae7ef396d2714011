# SPDX-License-Identifier: Apache-2.0
"""A second publisher on a topic, which sends a value of its own between the sensor's messages.

``{speed: {value, unit, rate}, load: {value, unit, rate}, bearing}``
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from stickslip_monitor.monitor.signals import QUANTITIES
from stickslip_monitor.scenes.effects.effect import UNITS, BuildContext, Effect
from stickslip_monitor.scenes.settings import Settings
from stickslip_monitor.scenes.shaft import TimeBlock
from stickslip_monitor.scenes.telemetry import Signal

KEYS = ('bearing', *QUANTITIES)


@dataclass(frozen=True, slots=True)
class _Source:
    """What one of them sends: a value [SI], at a rate [Hz]."""

    value: float
    rate: float

    def join(self, signal: Signal, block: TimeBlock, start_ns: int) -> Signal:
        """The messages of both in order of time; its own fall between the regular instants."""
        time = block.instants(2.0 * self.rate)
        time = time[np.rint(time * (2.0 * self.rate)).astype(np.int64) % 2 == 1]
        stamp = start_ns + np.rint(time * 1e9).astype(np.int64)
        order = np.argsort(np.concatenate([signal.time, time]), kind='stable')
        value = np.full(time.size, self.value)
        arrival, copies = signal.arrival_ns, signal.copies
        return replace(
            signal,
            time=np.concatenate([signal.time, time])[order],
            stamp_ns=np.concatenate([signal.stamp_ns, stamp])[order],
            value=np.concatenate([signal.value, value])[order],
            arrival_ns=None if arrival is None else np.concatenate([arrival, stamp])[order],
            copies=None if copies is None else np.append(copies, np.ones_like(stamp))[order],
        )


@dataclass(frozen=True, slots=True)
class SecondPublisher:
    """Adds the messages of others; ``sources`` has one for each topic."""

    sources: dict[str, _Source]
    start_ns: int

    def apply(self, block: TimeBlock) -> None:
        """Add those of a block."""
        for topic, source in self.sources.items():
            block.signals[topic] = source.join(block.signals[topic], block, self.start_ns)


def build(settings: Settings, context: BuildContext) -> Effect:
    """Build the effect."""
    sources = {}
    for channel, own in context.sensors_of(settings, ['value', 'unit', 'rate'], 'what it sends'):
        unit = own.choice('unit', UNITS[channel.quantity])
        value = own.number('value', unit) * channel.factor(unit)
        rate = own.number('rate', 'Hz', above=0.0, most=1000.0)
        sources[channel.topic] = _Source(value, rate)
    return SecondPublisher(sources, context.start_ns)
