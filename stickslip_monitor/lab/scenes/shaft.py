# SPDX-License-Identifier: Apache-2.0
"""The true operating point: speed and load as functions of time.

Nothing is sampled here. Telemetry, a sensor that averages between its samples, the lining's
integrator and the recorded truth each evaluate it at their own instants and get identical values
at the same instant, however time is divided into blocks.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.lab.scenes import telemetry
from stickslip_monitor.lab.scenes.telemetry import Channel, Signal
from stickslip_monitor.offline.truth import Column


class Term(Protocol):
    """One contribution to a speed [m/s] or a load [N]."""

    def at(self, time: FloatArray) -> FloatArray:
        """Its values at some times since the scene's start, shape (n,) [s].

        An element must not depend on its neighbours; times may lie before the start.
        """


class SpeedTerm(Term, Protocol):
    """A contribution to a speed that turns the shaft."""

    def integral(self, time: FloatArray) -> FloatArray:
        """Its integral from the scene's start to some times, shape (n,) [m]."""


class Shaft:
    """Speed and load of every bearing, the sum of the terms that effects have added.

    Args:
        channels: The channels of the scene. Speeds are those of a channel's first bearing.
    """

    def __init__(self, channels: Sequence[Channel]) -> None:
        self._channels = {channel.topic: channel for channel in channels}
        self._means: dict[str, list[Term]] = {topic: [] for topic in self._channels}
        self._ripples: dict[str, list[Term]] = {topic: [] for topic in self._channels}
        self._speeds: dict[str, list[SpeedTerm]] = {topic: [] for topic in self._channels}

    def add_speed(self, topic: str, term: SpeedTerm) -> None:
        """Add to the speed of a channel."""
        self._means[topic].append(term)
        self._speeds[topic].append(term)

    def add_load(self, topic: str, term: Term) -> None:
        """Add to the load of a channel."""
        self._means[topic].append(term)

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
        way = np.zeros_like(time)
        for term in self._speeds[channel.topic]:
            way += term.integral(time)
        return way / (math.pi * channel.bearings[0].bearing.journal_diameter)

    def speed(self, bearing: str, time: FloatArray) -> FloatArray:
        """Surface speed of a bearing's journal, shape (n,) [m/s]."""
        channel = self.channel(bearing, 'speed')
        value = self.value(channel.topic, time)
        return value * channel.ratio(bearing)

    def load(self, bearing: str, time: FloatArray) -> FloatArray:
        """Load of a bearing, shape (n,) [N]."""
        return self.value(self.channel(bearing, 'load').topic, time)

    def channel(self, bearing: str, quantity: str) -> Channel:
        """The channel of a bearing's speed or load."""
        for channel in self._channels.values():
            if channel.quantity == quantity and bearing in [b.name for b in channel.bearings]:
                return channel
        raise KeyError(f'{bearing}.{quantity}')


def _sum(terms: Sequence[Term], time: FloatArray) -> FloatArray:
    total = np.zeros_like(time)
    for term in terms:
        total += term.at(time)
    return total


@dataclass(frozen=True, slots=True, eq=False)
class TimeBlock:
    """A stretch of a scene; effects change or replace its signals.

    Attributes:
        start: Its start, from the scene's start [s].
        end: Its end [s].
        duration: Duration of the scene [s].
        shaft: The true operating point, at any instant.
        signals: What the sensor of each topic sends.
        truth: What no sensor measures; a channel is there even if it has no messages.
    """

    start: float
    end: float
    duration: float
    shaft: Shaft
    signals: dict[str, Signal]
    truth: list[Column] = field(default_factory=list)

    def instants(self, rate: float) -> FloatArray:
        """The regular instants of this block at a rate [Hz], shape (n,) [s].

        Those of all blocks together are ``k / rate`` from 0 to the scene's end, each once.
        """
        return np.array(telemetry.numbers(rate, self.start, self.end, self.duration)) / rate
