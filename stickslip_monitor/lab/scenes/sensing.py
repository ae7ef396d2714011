# SPDX-License-Identifier: Apache-2.0
"""Sensors with memory: they follow the shaft between their samples, on a finer regular grid."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.lab.scenes.shaft import Shaft
from stickslip_monitor.lab.scenes.telemetry import Channel

# Time constants and windows that the grid can resolve and hold [s].
SHORTEST, LONGEST = 1e-3, 600.0
# The ripple of a propeller's blades reaches some 30 Hz.
_LEAST_RATE = 100.0
_STEPS_IN_SCALE = 20.0


class Memory(Protocol):
    """One transformation of a signal that depends on its past."""

    @property
    def length(self) -> float:
        """Time after which the past is negligible [s]."""

    @property
    def scale(self) -> float:
        """Time over which it resolves the past [s]."""

    def start(self, step: float, value: float) -> None:
        """Settle on a value that was constant until now; samples are ``step`` [s] apart."""

    def next(self, value: FloatArray) -> FloatArray:
        """Transform the next samples, shape (n,)."""


@dataclass(slots=True)
class Sensor:
    """A chain of memories between the shaft and the samples of one channel.

    Attributes:
        shaft: The shaft.
        channel: The channel.
        memories: The memories in order.
    """

    shaft: Shaft
    channel: Channel
    memories: list[Memory] = field(default_factory=list)
    _next: int | None = None

    def read(self, numbers: range) -> FloatArray:
        """Its readings at instants ``k / rate`` of the channel, which follow on the last ones."""
        if not numbers:
            return np.empty(0)
        finer = self._finer()
        if self._next is None:
            self._next = self._settle(numbers.start * finer, finer)
        first = numbers.start * finer - self._next
        grid = self._grid(self._next, numbers[-1] * finer + 1, finer)
        self._next = numbers[-1] * finer + 1
        return grid[first::finer]

    def _finer(self) -> int:
        """Steps of the grid in one of the channel."""
        shortest = min(memory.scale for memory in self.memories)
        return math.ceil(max(_LEAST_RATE, _STEPS_IN_SCALE / shortest) / self.channel.rate)

    def _settle(self, first: int, finer: int) -> int:
        """Start so long before the first sample that the initial state is negligible."""
        rate = self.channel.rate * finer
        begin = first - math.ceil(sum(memory.length for memory in self.memories) * rate)
        value = float(self.shaft.value(self.channel.topic, np.array([begin / rate]))[0])
        for memory in self.memories:
            memory.start(1.0 / rate, value)
        return begin + 1

    def _grid(self, start: int, stop: int, finer: int) -> FloatArray:
        time = np.arange(start, stop) / (self.channel.rate * finer)
        value = self.shaft.value(self.channel.topic, time)
        for memory in self.memories:
            value = memory.next(value)
        return value
