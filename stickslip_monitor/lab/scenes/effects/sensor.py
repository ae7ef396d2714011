# SPDX-License-Identifier: Apache-2.0
"""Errors of each sample: bias, noise, spikes, quantisation, a stuck sensor, and NaN."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stickslip_monitor.lab.scenes.effects.effect import (
    SENSOR_KEYS,
    UNITS,
    BuildContext,
    Effect,
    EffectKind,
)
from stickslip_monitor.lab.scenes.settings import Settings
from stickslip_monitor.lab.scenes.shaft import TimeBlock
from stickslip_monitor.lab.scenes.telemetry import Signal
from stickslip_monitor.lab.scenes.windows import WINDOW_KEYS as OCCASIONS
from stickslip_monitor.lab.scenes.windows import (
    SampleMask,
    Windows,
    read_sample_mask,
    read_windows,
)

_HOUR = 3600.0


@dataclass(frozen=True, slots=True)
class Bias:
    """Adds to some signals; ``errors`` holds for each topic bias [SI] and drift [SI/s]."""

    errors: dict[str, tuple[float, float]]

    def apply(self, block: TimeBlock) -> None:
        """Add the error of the next samples."""
        for topic, (bias, drift) in self.errors.items():
            signal = block.signals[topic]
            signal.value[:] += bias + drift * signal.time


def build_bias(settings: Settings, context: BuildContext) -> Effect:
    """Build the effect."""
    errors = {}
    for channel, own in context.sensors_of(settings, ['bias', 'drift', 'unit'], 'the error'):
        unit = own.choice('unit', UNITS[channel.quantity])
        drift = own.number('drift', f'{unit} per hour') / _HOUR if 'drift' in own else 0.0
        factor = channel.factor(unit)
        errors[channel.topic] = own.number('bias', unit) * factor, drift * factor
    return Bias(errors)


@dataclass(frozen=True, slots=True)
class _NoiseSource:
    """The noise of one sensor: its standard deviation in SI units, and its random stream."""

    standard_deviation: float
    random: np.random.Generator


@dataclass(frozen=True, slots=True)
class SensorNoise:
    """Adds noise to some signals; ``sources`` holds that of each topic."""

    sources: dict[str, _NoiseSource]

    def apply(self, block: TimeBlock) -> None:
        """Add the noise of the next samples."""
        for topic, source in self.sources.items():
            value = block.signals[topic].value
            value += source.standard_deviation * source.random.standard_normal(value.size)


def build_sensor_noise(settings: Settings, context: BuildContext) -> Effect:
    """Build the effect."""
    sources = {}
    for channel, own in context.sensors_of(settings, ['standard_deviation', 'unit'], 'the noise'):
        unit = own.choice('unit', UNITS[channel.quantity])
        deviation = own.number('standard_deviation', unit, least=0.0) * channel.factor(unit)
        sources[channel.topic] = _NoiseSource(deviation, context.random(settings, channel))
    return SensorNoise(sources)


@dataclass(frozen=True, slots=True)
class _SpikeSource:
    """The spikes of one sensor: size in SI units, when, and the stream of their signs."""

    size: float
    occasions: SampleMask
    signs: np.random.Generator


@dataclass(frozen=True, slots=True)
class Spikes:
    """Adds spikes to some signals; ``sources`` holds those of each topic."""

    sources: dict[str, _SpikeSource]

    def apply(self, block: TimeBlock) -> None:
        """Add the spikes of the next samples."""
        for topic, source in self.sources.items():
            signal = block.signals[topic]
            hit = source.occasions.hit(signal.time)
            signs = np.where(source.signs.random(signal.time.size) < 0.5, -1.0, 1.0)
            signal.value[hit] += source.size * signs[hit]


def build_spikes(settings: Settings, context: BuildContext) -> Effect:
    """Build the effect."""
    sources = {}
    for channel, own in context.sensors_of(settings, ['size', 'unit', *OCCASIONS], 'the spikes'):
        unit = own.choice('unit', UNITS[channel.quantity])
        size = own.number('size', unit) * channel.factor(unit)
        occasions = read_sample_mask(own, context.duration, context.random(settings, channel))
        sources[channel.topic] = _SpikeSource(
            size, occasions, context.random(settings, channel, 'sign')
        )
    return Spikes(sources)


@dataclass(frozen=True, slots=True)
class Quantisation:
    """Rounds some signals; ``steps`` holds for each topic the step [SI]."""

    steps: dict[str, float]

    def apply(self, block: TimeBlock) -> None:
        """Round the next samples to the nearest multiple."""
        for topic, step in self.steps.items():
            value = block.signals[topic].value
            value[:] = np.rint(value / step) * step


def build_quantisation(settings: Settings, context: BuildContext) -> Effect:
    """Build the effect."""
    steps = {}
    for channel, own in context.sensors_of(settings, ['step', 'unit'], 'the step'):
        unit = own.choice('unit', UNITS[channel.quantity])
        steps[channel.topic] = own.number('step', unit, least=1e-9) * channel.factor(unit)
    return Quantisation(steps)


@dataclass(slots=True)
class _StuckSensor:
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

    sensors: dict[str, _StuckSensor]

    def apply(self, block: TimeBlock) -> None:
        """Hold the next samples where the sensor is stuck."""
        for topic, sensor in self.sensors.items():
            sensor.apply(block.signals[topic])


def build_stuck(settings: Settings, context: BuildContext) -> Effect:
    """Build the effect."""
    return Stuck(
        {
            channel.topic: _StuckSensor(read_windows(own, context.duration))
            for channel, own in context.sensors_of(settings, ['windows'], 'when it is stuck')
        }
    )


@dataclass(frozen=True, slots=True)
class NotANumber:
    """Puts NaN into some signals; ``occasions`` says when for each topic."""

    occasions: dict[str, SampleMask]

    def apply(self, block: TimeBlock) -> None:
        """Put NaN in the place of the next samples that are hit."""
        for topic, occasions in self.occasions.items():
            signal = block.signals[topic]
            signal.value[occasions.hit(signal.time)] = np.nan


def build_not_a_number(settings: Settings, context: BuildContext) -> Effect:
    """Build the effect."""
    return NotANumber(
        {
            channel.topic: read_sample_mask(
                own, context.duration, context.random(settings, channel)
            )
            for channel, own in context.sensors_of(settings, OCCASIONS, 'when it sends NaN')
        }
    )


@dataclass(frozen=True, slots=True)
class _Background:
    """What a level shows without the lining.

    Attributes:
        topic: Its topic.
        bearing: The bearing whose shaft it hears.
        fold: The fold speed at the nominal load [m/s].
        floor: Of the sensor and of what is always there.
        engine: At the fold speed; it grows with the square of the speed.
        sea: Share by which both rise and fall.
        period: Period of that [s].
        scatter: Relative standard deviation of a value.
        random: The random stream of the scatter.
    """

    topic: str
    bearing: str
    fold: float
    floor: float
    engine: float
    sea: float
    period: float
    scatter: float
    random: np.random.Generator

    def apply(self, block: TimeBlock) -> None:
        """Add it to the next values."""
        signal = block.signals[self.topic]
        ratio = block.shaft.speed(self.bearing, signal.time) / self.fold
        swell = 1.0 + self.sea * np.sin(2.0 * np.pi / self.period * signal.time)
        total = np.hypot(signal.value, (self.floor + self.engine * ratio**2) * swell)
        total *= 1.0 + self.scatter * self.random.standard_normal(total.size)
        signal.value[:] = np.maximum(total, 0.0)


@dataclass(frozen=True, slots=True)
class VibrationBackground:
    """Adds to some levels what is not the lining."""

    sources: list[_Background]

    def apply(self, block: TimeBlock) -> None:
        """Add it to the next values."""
        for source in self.sources:
            source.apply(block)


def build_vibration_background(settings: Settings, context: BuildContext) -> Effect:
    """Build the effect."""
    sources = []
    for channel in context.pick(settings, 'level'):
        unit = channel.input.unit
        channel.factor(settings.choice('unit', UNITS['level']))
        bearing = channel.bearings[0]
        sea = settings.number('sea', '-', least=0.0, most=1.0) if 'sea' in settings else 0.0
        sources.append(
            _Background(
                channel.topic,
                bearing.name,
                context.shaft.channel(bearing.name, 'speed').factor('fold'),
                settings.number('floor', unit, above=0.0),
                settings.number('engine', unit, least=0.0),
                sea,
                settings.number('period', 's', above=0.0) if sea else 1.0,
                settings.number('scatter', '-', least=0.0, most=0.3),
                context.random(settings, channel),
            )
        )
    return VibrationBackground(sources)


_BACKGROUND_KEYS = ('bearing', 'unit', 'floor', 'engine', 'sea', 'period', 'scatter')
EFFECTS = {
    'vibration_background': EffectKind(_BACKGROUND_KEYS, build_vibration_background),
    'bias': EffectKind(SENSOR_KEYS, build_bias),
    'sensor_noise': EffectKind(SENSOR_KEYS, build_sensor_noise),
    'spikes': EffectKind(SENSOR_KEYS, build_spikes),
    'quantisation': EffectKind(SENSOR_KEYS, build_quantisation),
    'stuck': EffectKind(SENSOR_KEYS, build_stuck),
    'not_a_number': EffectKind(SENSOR_KEYS, build_not_a_number),
}
