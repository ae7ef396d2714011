# SPDX-License-Identifier: Apache-2.0
"""Sensors: filters and means between the samples, and the errors of each sample.

The filter ``dy/dt = (x - y) / time_constant`` is solved exactly for an input that is linear
between the instants of the sensor's grid. The mean is of the shaft itself, evaluated between the
samples, so ripple is averaged and not aliased.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

import numpy as np

from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.lab.scenes.effects.effect import (
    SceneRun,
    channel_effect,
    sensor_effect,
    unit_of,
)
from stickslip_monitor.lab.scenes.profile import read_sample_mask, read_windows
from stickslip_monitor.lab.scenes.settings import Settings
from stickslip_monitor.lab.scenes.shaft import Memory, Term, TimeBlock
from stickslip_monitor.lab.scenes.telemetry import Channel, Signal
from stickslip_monitor.monitor.signals import QUANTITIES

Change = Callable[[Signal], None]
"""Changes the signal of the next block."""
# Time constants and windows that a sensor's grid can resolve and hold [s].
_SHORTEST, _LONGEST = 1e-3, 600.0
# After that many time constants the initial state counts 2e-9.
_TIME_CONSTANTS = 20.0
_HOUR = 3600.0


# A level is made of its samples already, so memories are for the other quantities.
@sensor_effect('sensing', 'the filter', 'time_constant', quantities=QUANTITIES)
def filtering(settings: Settings, channel: Channel, run: SceneRun) -> None:
    """Gives a sensor a first-order lag."""
    lag = settings.number('time_constant', 's', least=_SHORTEST, most=_LONGEST)
    run.sense(channel, Memory(_TIME_CONSTANTS * lag, lag, partial(low_pass, lag)))


def low_pass(time_constant: float, step: float, value: float) -> Term:
    """A filter that has settled on a value; samples are ``step`` [s] apart."""
    from scipy.signal import lfilter

    left = math.exp(-step / time_constant)
    lag = -math.expm1(-step / time_constant) * time_constant / step
    forward, back = np.array([1.0 - lag, lag - left]), np.array([1.0, -left])
    state = np.array([lag * value])

    def following(values: FloatArray) -> FloatArray:
        nonlocal state
        filtered, state = lfilter(forward, back, values, zi=state)
        return np.asarray(filtered, float)

    return following


@sensor_effect('sensing', 'the averaging', 'window', quantities=QUANTITIES)
def averaging(settings: Settings, channel: Channel, run: SceneRun) -> None:
    """Lets a sensor average over the last seconds."""
    window = settings.number('window', 's', least=_SHORTEST, most=_LONGEST)
    run.sense(channel, Memory(window, window, partial(moving_mean, window)))


def moving_mean(window: float, step: float, value: float) -> Term:
    """``y(t) = (1/window) * integral of x from t - window to t``, by trapezia of the grid.

    It has settled on a value; samples are ``step`` [s] apart.
    """
    steps = window / step
    whole, rest = int(steps), steps - int(steps)
    # Of the running integral, in steps, as many as the window needs.
    integral = value * np.arange(-whole - 1.0, 1.0)
    last = value

    def following(values: FloatArray) -> FloatArray:
        nonlocal integral, last
        pieces = 0.5 * (values + np.concatenate([[last], values[:-1]]))
        # One running sum through all blocks: their length does not change its rounding.
        total = np.concatenate([integral, np.cumsum(np.concatenate([integral[-1:], pieces]))[1:]])
        now, then = total[whole + 2 :], total[2 : total.size - whole]
        before = total[1 : total.size - whole - 1]
        integral, last = total[-whole - 2 :], float(values[-1])
        return (now - then + rest * (then - before)) / steps

    return following


@channel_effect('sensor', ['level'], 'unit', 'floor', 'engine', 'sea', 'period', 'scatter')
def vibration_background(settings: Settings, channel: Channel, run: SceneRun) -> None:
    """Adds to a level what is not the lining.

    The floor of the sensor, and the engine, given at the fold speed and growing with the square
    of the speed, rise and fall by a share with the sea; each value scatters.
    """
    unit, _ = unit_of(settings, channel)
    bearing = channel.bearings[0].name
    fold = run.shaft.channel(bearing, 'speed').factor('fold')
    floor = settings.number('floor', unit, above=0.0)
    engine = settings.number('engine', unit, least=0.0)
    sea = settings.number('sea', '-', least=0.0, most=1.0) if 'sea' in settings else 0.0
    period = settings.number('period', 's', above=0.0) if sea else 1.0
    scatter = settings.number('scatter', '-', least=0.0, most=0.3)
    random = run.random(settings, channel)

    def add(block: TimeBlock) -> None:
        signal = block.signals[channel.topic]
        ratio = block.shaft.speed(bearing, signal.time) / fold
        swell = 1.0 + sea * np.sin(2.0 * np.pi / period * signal.time)
        total = np.hypot(signal.value, (floor + engine * ratio**2) * swell)
        total *= 1.0 + scatter * random.standard_normal(total.size)
        signal.value[:] = np.maximum(total, 0.0)

    run.effects.append(add)


@sensor_effect('sensor', 'the error', 'bias', 'drift', 'unit')
def bias(settings: Settings, channel: Channel, run: SceneRun) -> Change:
    """Adds an error that is constant or drifts."""
    unit, factor = unit_of(settings, channel)
    drift = settings.number('drift', f'{unit} per hour') / _HOUR if 'drift' in settings else 0.0
    constant, rate = settings.number('bias', unit) * factor, drift * factor

    def add(signal: Signal) -> None:
        signal.value += constant + rate * signal.time

    return add


@sensor_effect('sensor', 'the noise', 'standard_deviation', 'unit')
def sensor_noise(settings: Settings, channel: Channel, run: SceneRun) -> Change:
    """Adds white normal noise."""
    unit, factor = unit_of(settings, channel)
    deviation = settings.number('standard_deviation', unit, least=0.0) * factor
    random = run.random(settings, channel)

    def add(signal: Signal) -> None:
        signal.value += deviation * random.standard_normal(signal.value.size)

    return add


@sensor_effect('sensor', 'the spikes', 'size', 'unit', 'windows', 'share')
def spikes(settings: Settings, channel: Channel, run: SceneRun) -> Change:
    """Puts single samples off by a size, up or down."""
    unit, factor = unit_of(settings, channel)
    size = settings.number('size', unit) * factor
    mask = read_sample_mask(settings, run.duration, run.random(settings, channel))
    random = run.random(settings, channel, 'sign')

    def add(signal: Signal) -> None:
        hit = mask.hit(signal.time)
        signs = np.where(random.random(signal.time.size) < 0.5, -1.0, 1.0)
        signal.value[hit] += size * signs[hit]

    return add


@sensor_effect('sensor', 'the step', 'step', 'unit')
def quantisation(settings: Settings, channel: Channel, run: SceneRun) -> Change:
    """Rounds to the nearest multiple of a step."""
    unit, factor = unit_of(settings, channel)
    step = settings.number('step', unit, least=1e-9) * factor

    def round_off(signal: Signal) -> None:
        signal.value[:] = np.rint(signal.value / step) * step

    return round_off


@sensor_effect('sensor', 'when it is stuck', 'windows')
def stuck(settings: Settings, channel: Channel, run: SceneRun) -> Change:
    """Repeats in a window the last value before it, or else the first within."""
    windows = read_windows(settings, run.duration)
    last: float | None = None

    def hold(signal: Signal) -> None:
        nonlocal last
        value = signal.value
        if not value.size:
            return
        place = np.where(windows.hold(signal.time), -1, np.arange(value.size))
        source = np.maximum.accumulate(place)
        first = value[0] if last is None else last
        value[:] = np.where(source < 0, first, value[np.maximum(source, 0)])
        last = float(value[-1])

    return hold


@sensor_effect('sensor', 'when it sends NaN', 'windows', 'share')
def not_a_number(settings: Settings, channel: Channel, run: SceneRun) -> Change:
    """Sends NaN in the place of some samples."""
    mask = read_sample_mask(settings, run.duration, run.random(settings, channel))

    def spoil(signal: Signal) -> None:
        signal.value[mask.hit(signal.time)] = np.nan

    return spoil
