# SPDX-License-Identifier: Apache-2.0
"""Sensors that repeat their last value: ``{speed: {windows}, load: {..}, bearing}``."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stickslip_monitor.monitor.signals import QUANTITIES
from stickslip_monitor.scenes.block import Block
from stickslip_monitor.scenes.settings import Settings
from stickslip_monitor.scenes.signals import Signal
from stickslip_monitor.scenes.windows import Windows, read_windows

from .effect import Effect, Frame

KEYS = ('bearing', *QUANTITIES)


@dataclass(slots=True)
class _Sensor:
    """One sensor: when it is stuck, and its last value, None before its first sample."""

    windows: Windows
    last: float | None = None

    def apply(self, signal: Signal) -> None:
        """Let samples in a window repeat the last one before it, or else the first within."""
        value = signal.value
        if not value.size:
            return
        stuck = self.windows.hold(signal.time)
        place = np.where(stuck, -1, np.arange(value.size))
        source = np.maximum.accumulate(place)
        first = value[0] if self.last is None else self.last
        value[:] = np.where(source < 0, first, value[np.maximum(source, 0)])
        self.last = float(value[-1])


@dataclass(frozen=True, slots=True)
class Stuck:
    """Holds some signals; ``sensors`` has one for each topic."""

    sensors: dict[str, _Sensor]

    def apply(self, block: Block) -> None:
        """Hold the next samples where the sensor is stuck."""
        for topic, sensor in self.sensors.items():
            sensor.apply(block.signals[topic])


def build(settings: Settings, frame: Frame) -> Effect:
    """Build the effect."""
    return Stuck(
        {
            channel.topic: _Sensor(read_windows(own, frame.duration))
            for channel, own in frame.sensors_of(settings, ['windows'], 'when it is stuck')
        }
    )
