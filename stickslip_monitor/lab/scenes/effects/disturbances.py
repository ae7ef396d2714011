# SPDX-License-Identifier: Apache-2.0
"""Ripple of speed and load with the turning shaft, and the load in waves.

The sea has the JONSWAP spectrum (Hasselmann et al. 1973; DNV-RP-C205, 3.5.5): with
``x = omega / omega_p``,

    S ~ x^-5 exp(-1.25 x^-4) gamma^exp(-(x - 1)^2 / (2 s^2)),   s = 0.07 for x <= 1, else 0.09

scaled to the variance ``Hs^2/16``. It is a sum of cosines of equal amplitude, each for an equal
part of that variance, at a random frequency within its part and with a random phase. So most of
them are where the sea has most energy, and the record does not repeat.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.lab.scenes.effects.effect import UNITS, BuildContext, EffectKind
from stickslip_monitor.lab.scenes.reproducible_math import cos_turns, exp
from stickslip_monitor.lab.scenes.settings import Settings
from stickslip_monitor.lab.scenes.shaft import Shaft
from stickslip_monitor.lab.scenes.telemetry import Channel

BLADE_RIPPLE_KEYS = ('bearing', 'blades', 'amplitude')


@dataclass(frozen=True, slots=True)
class BladeRipple:
    """The ripple of one channel; ``amplitude`` is a share of the speed."""

    shaft: Shaft
    channel: Channel
    blades: int
    amplitude: float

    def at(self, time: FloatArray) -> FloatArray:
        """Its values at some times, shape (n,) [m/s]."""
        turns = self.shaft.turns(self.channel.bearings[0].name, time)
        mean = self.shaft.mean(self.channel.topic, time)
        return mean * (self.amplitude * cos_turns(self.blades * turns))


def build_blade_ripple(settings: Settings, context: BuildContext) -> None:
    """Add the ripple to the speed."""
    blades = settings.value('blades', 'the number of blades')
    if isinstance(blades, bool) or not isinstance(blades, int) or not 1 <= blades <= 20:
        raise settings.broken('blades', 'must be a whole number from 1 to 20')
    amplitude = settings.number('amplitude', '-', least=0.0, most=1.0)
    for channel in context.pick(settings, 'speed'):
        ripple = BladeRipple(context.shaft, channel, blades, amplitude)
        context.add_ripple(channel, ripple)


MISALIGNMENT_KEYS = ('bearing', 'amplitude', 'unit')


@dataclass(frozen=True, slots=True)
class OncePerTurn:
    """The ripple of one bearing's load; ``amplitude`` in N."""

    shaft: Shaft
    bearing: str
    amplitude: float

    def at(self, time: FloatArray) -> FloatArray:
        """Its values at some times, shape (n,) [N]."""
        return self.amplitude * cos_turns(self.shaft.turns(self.bearing, time))


def build_misalignment(settings: Settings, context: BuildContext) -> None:
    """Add the ripple to the load."""
    unit = settings.choice('unit', UNITS['load'])
    amplitude = settings.number('amplitude', unit, least=0.0)
    for channel in context.pick(settings, 'load'):
        ripple = OncePerTurn(
            context.shaft, channel.bearings[0].name, amplitude * channel.factor(unit)
        )
        context.add_ripple(channel, ripple)


LOAD_IN_WAVES_KEYS = (
    'bearing',
    'unit',
    'significant_height',
    'peak_period',
    'gamma',
    'load_per_metre',
)
COMPONENTS = 200
# Cosines that are computed together: few enough for the processor's cache.
_AT_ONCE = 8192
# The sea ends at five times the peak frequency, beyond which lies 0.2 % of the variance.
# Period of the shortest waves at sea that are not ripples [s].
_SHORTEST = 0.1
_RANGE = np.linspace(0.25, 5.0, 20_000)


@dataclass(frozen=True, slots=True, eq=False)
class Sea:
    """A sum of cosines.

    Attributes:
        amplitude: Amplitude of each [m].
        frequency: Frequencies, shape (n,) [Hz].
        phase: Phases at the scene's start, shape (n,) [turns].
    """

    amplitude: float
    frequency: FloatArray
    phase: FloatArray

    @classmethod
    def of(cls, height: float, period: float, gamma: float, random: np.random.Generator) -> Sea:
        """A sea of a significant height [m], peak period [s] and peakedness [-]."""
        part = (np.arange(COMPONENTS) + random.random(COMPONENTS)) / COMPONENTS
        frequency = np.interp(part, _energy_below(gamma), _RANGE) / period
        phase = random.random(COMPONENTS)
        return cls(height / 4.0 * math.sqrt(2.0 / COMPONENTS), frequency, phase)

    def elevation(self, time: FloatArray) -> FloatArray:
        """Elevation at some times [s], shape (n,) [m]; added up one by one, in one order."""
        total = np.zeros_like(time)
        at_once = max(1, _AT_ONCE // max(1, time.size))
        for first in range(0, self.frequency.size, at_once):
            some = slice(first, first + at_once)
            turns = np.multiply.outer(self.frequency[some], time) + self.phase[some, None]
            for wave in cos_turns(turns):
                total += wave
        return total * self.amplitude


def _energy_below(gamma: float) -> FloatArray:
    """The share of the variance below each frequency of the range."""
    x = _RANGE
    width = np.where(x <= 1.0, 0.07, 0.09)
    peak = exp(math.log(gamma) * exp(-(((x - 1.0) / width) ** 2) / 2.0))
    square = x * x
    density = exp(-1.25 / (square * square)) * peak / (square * square * x)
    below = np.concatenate([[0.0], np.cumsum(density[1:] + density[:-1])])
    return below / below[-1]


@dataclass(frozen=True, slots=True, eq=False)
class WaveLoad:
    """The load of a sea; ``per_metre`` in N/m."""

    sea: Sea
    per_metre: float

    def at(self, time: FloatArray) -> FloatArray:
        """Loads at some times, shape (n,) [N]."""
        return self.sea.elevation(time) * self.per_metre


def build_load_in_waves(settings: Settings, context: BuildContext) -> None:
    """Add the waves to the load: for all bearings the same sea."""
    unit = settings.choice('unit', UNITS['load'])
    per_metre = settings.number('load_per_metre', f'{unit}/m')
    sea = Sea.of(
        settings.number('significant_height', 'm', least=0.0),
        settings.number('peak_period', 's', least=_SHORTEST),
        settings.number('gamma', '-', least=1.0, most=10.0),
        context.random(settings),
    )
    for channel in context.pick(settings, 'load'):
        context.add_load(channel, WaveLoad(sea, per_metre * channel.factor(unit)))


EFFECTS = {
    'load_in_waves': EffectKind(LOAD_IN_WAVES_KEYS, build_load_in_waves),
    'blade_ripple': EffectKind(BLADE_RIPPLE_KEYS, build_blade_ripple),
    'misalignment': EffectKind(MISALIGNMENT_KEYS, build_misalignment),
}
