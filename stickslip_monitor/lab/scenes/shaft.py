# SPDX-License-Identifier: Apache-2.0
"""The true operating point: speed and load as functions of time, and sensors that follow it.

The shaft is not sampled. Telemetry, a sensor that averages between its samples, the lining's
integrator and the recorded truth each evaluate it at their own instants and get identical values
at the same instant, however time is divided into blocks.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.lab.scenes import telemetry
from stickslip_monitor.lab.scenes.telemetry import Channel, Signal
from stickslip_monitor.offline.truth import Column

Term = Callable[[FloatArray], FloatArray]
"""A contribution to a speed [m/s] or a load [N] at some times since the scene's start, shape (n,)
[s]. An element must not depend on its neighbours; times may lie before the start."""


class Shaft:
    """Speed and load of every bearing, the sum of the terms that effects have added.

    Speeds are those of a channel's first bearing.
    """

    def __init__(self, channels: Sequence[Channel]) -> None:
        self._channels = {channel.topic: channel for channel in channels}
        self._means: dict[str, list[Term]] = defaultdict(list)
        self._ways: dict[str, list[Term]] = defaultdict(list)
        self._ripples: dict[str, list[Term]] = defaultdict(list)

    def add(self, topic: str, term: Term, way: Term | None = None) -> None:
        """Add to the speed or load of a channel; ``way`` [m], a speed's integral, turns it."""
        self._means[topic].append(term)
        if way is not None:
            self._ways[topic].append(way)

    def add_ripple(self, topic: str, term: Term) -> None:
        """Add what follows from the turning of the shaft and does not turn it."""
        self._ripples[topic].append(term)

    def mean(self, topic: str, time: FloatArray) -> FloatArray:
        """Speed [m/s] or load [N] of a channel without ripple, shape (n,)."""
        return _sum(self._means[topic], time)

    def value(self, topic: str, time: FloatArray) -> FloatArray:
        """Speed [m/s] or load [N] of a channel at some times [s], both of shape (n,).

        A load is never negative: a journal that lifts off has no load.
        """
        total = _sum([*self._means[topic], *self._ripples[topic]], time)
        return total if self._channels[topic].quantity == 'speed' else np.maximum(total, 0.0)

    def turns(self, bearing: str, time: FloatArray) -> FloatArray:
        """Turns of a bearing's journal since the start, shape (n,)."""
        channel = self.channel(bearing, 'speed')
        way = _sum(self._ways[channel.topic], time)
        return way / (math.pi * channel.bearings[0].bearing.journal_diameter)

    def speed(self, bearing: str, time: FloatArray) -> FloatArray:
        """Surface speed of a bearing's journal, shape (n,) [m/s]."""
        channel = self.channel(bearing, 'speed')
        return self.value(channel.topic, time) * channel.ratio(bearing)

    def load(self, bearing: str, time: FloatArray) -> FloatArray:
        """Load of a bearing, shape (n,) [N]."""
        return self.value(self.channel(bearing, 'load').topic, time)

    def channel(self, bearing: str, quantity: str) -> Channel:
        """The channel of a quantity of a bearing.

        Raises:
            KeyError: The scene has none.
        """
        for channel in self._channels.values():
            if channel.quantity == quantity and channel.serves(bearing):
                return channel
        raise KeyError(f'{bearing}.{quantity}')


def _sum(terms: Iterable[Term], time: FloatArray) -> FloatArray:
    total = np.zeros_like(time)
    for term in terms:
        total += term(time)
    return total


@dataclass(frozen=True, slots=True, eq=False)
class TimeBlock:
    """A stretch of a scene; effects change its signals."""

    start: float  # its start, from the scene's start [s]
    end: float  # its end [s]
    duration: float  # duration of the scene [s]
    shaft: Shaft  # the true operating point, at any instant
    signals: dict[str, Signal]  # what the sensor of each topic sends
    # What no sensor measures; a channel is there even if it has no messages.
    truth: list[Column] = field(default_factory=list)

    def instants(self, rate: float) -> FloatArray:
        """The regular instants of this block at a rate [Hz], shape (n,) [s].

        Those of all blocks together are ``k / rate`` from 0 to the scene's end, each once.
        """
        return np.array(telemetry.numbers(rate, self.start, self.end, self.duration)) / rate


# The ripple of a propeller's blades reaches some 30 Hz.
_LEAST_RATE = 100.0
_STEPS_IN_SCALE = 20.0


@dataclass(frozen=True, slots=True)
class Memory:
    """One transformation of a sensor's signal that depends on its past."""

    length: float  # time after which the past is negligible [s]
    scale: float  # time over which it resolves the past [s]
    # Given the time between samples [s] and the value that was constant until now, returns
    # what transforms the next samples, shape (n,), again and again.
    start: Callable[[float, float], Term]


class Sensor:
    """A chain of memories between the shaft and the samples of one channel.

    It follows the shaft between its samples, on a finer regular grid.
    """

    def __init__(self, shaft: Shaft, channel: Channel) -> None:
        self._shaft, self._channel = shaft, channel
        self.memories: list[Memory] = []
        self._chain: list[Term] = []
        self._next = 0

    def read(self, numbers: range) -> FloatArray:
        """Its readings at instants ``k / rate`` of the channel, which follow on the last ones."""
        if not numbers:
            return np.empty(0)
        shortest = min(memory.scale for memory in self.memories)
        finer = math.ceil(max(_LEAST_RATE, _STEPS_IN_SCALE / shortest) / self._channel.rate)
        rate = self._channel.rate * finer
        if not self._chain:
            self._settle(numbers.start * finer, rate)
        start, self._next = self._next, numbers[-1] * finer + 1
        value = self._shaft.value(self._channel.topic, np.arange(start, self._next) / rate)
        for follow in self._chain:
            value = follow(value)
        return value[numbers.start * finer - start :: finer]

    def _settle(self, first: int, rate: float) -> None:
        """Start so long before the first sample that the initial state is negligible."""
        begin = first - math.ceil(sum(memory.length for memory in self.memories) * rate)
        value = float(self._shaft.value(self._channel.topic, np.array([begin / rate]))[0])
        self._chain = [memory.start(1.0 / rate, value) for memory in self.memories]
        self._next = begin + 1
