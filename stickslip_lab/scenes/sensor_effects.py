# SPDX-License-Identifier: Apache-2.0
"""Declares effects of sensors, their clocks and the recorder on a measurement.

The filter ``dy/dt = (x - y) / time_constant`` is solved exactly for an input that is linear
between the instants of the sensor's grid. The mean is of the shaft itself, evaluated between the
samples, so ripple is averaged and not aliased.

A jump of a clock shifts all later stamps; several add up. Without a header a message's stamp is
the recorder's own time, by which readers sort: such a topic can jump forward only, and cannot be
out of order. After a cut nothing is written: the file ends within its last chunk, without its
index, and a folder has no metadata.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from itertools import pairwise

import numpy as np

from stickslip_lab.scenes.effects import Change, SceneRun, channel_effect, effect, read_unit, require_header
from stickslip_lab.scenes.settings import Settings, check_points, read_sample_mask, read_windows
from stickslip_lab.scenes.telemetry import (
    CHANNELS,
    MAX_RATE,
    MEMORY_CHANNELS,
    Channel,
    Memory,
    Signal,
    TimeBlock,
)
from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.errors import SceneError

# Time constants and windows that a sensor's grid can resolve and hold [s].
_MIN_LENGTH, _MAX_LENGTH = 1e-3, 600.0


@channel_effect('sensing', MEMORY_CHANNELS, 'time_constant', section='the filter')
def filtering(settings: Settings, channel: Channel, run: SceneRun) -> None:
    """Give the sensor of a channel in ``run`` a first-order lag, behind the memories that it has.

    Raises:
        SceneError: The time constant is missing, or not from 1 ms to 600 s.
    """
    lag = settings.number('time_constant', 's', minimum=_MIN_LENGTH, maximum=_MAX_LENGTH)
    # After 20 time constants the initial state counts 2e-9.
    run.add_memory(channel, Memory(20.0 * lag, lag, partial(low_pass, lag)))


def low_pass(time_constant: float, step: float, value: float) -> Callable[[FloatArray], FloatArray]:
    """Return a first-order low-pass filter for successive pieces of a signal.

    The returned function keeps its state from call to call.

    Args:
        time_constant: Its lag > 0 [s].
        step: Time between samples > 0 [s].
        value: Value of the input until now: the filter has settled on it.
    """
    from scipy.signal import lfilter

    left = math.exp(-step / time_constant)
    lag = -math.expm1(-step / time_constant) * time_constant / step
    forward, back = np.array([1.0 - lag, lag - left]), np.array([1.0, -left])
    state = np.array([lag * value])

    def following(values: FloatArray) -> FloatArray:
        """Return the next values filtered, of their shape (n,); keep the filter's state for the next call."""
        nonlocal state
        filtered, state = lfilter(forward, back, values, zi=state)
        return np.asarray(filtered, float)

    return following


@channel_effect('sensing', MEMORY_CHANNELS, 'window', section='the averaging')
def averaging(settings: Settings, channel: Channel, run: SceneRun) -> None:
    """Let the sensor of a channel in ``run`` average over a ``window`` [s], behind the memories that it has.

    Raises:
        SceneError: The window is missing, or not from 1 ms to 600 s.
    """
    window = settings.number('window', 's', minimum=_MIN_LENGTH, maximum=_MAX_LENGTH)
    run.add_memory(channel, Memory(window, window, partial(moving_mean, window)))


def moving_mean(window: float, step: float, value: float) -> Callable[[FloatArray], FloatArray]:
    """Return a moving mean for successive pieces of a signal, by trapezia.

    ``y(t) = (1/window) * integral of x from t - window to t``; the returned function keeps its state from
    call to call.

    Args:
        window: Length of the mean [s].
        step: Time between samples [s].
        value: Value of the input until now: the mean has settled on it.
    """
    steps = window / step
    whole, rest = int(steps), steps - int(steps)
    # The last values of the running integral, in steps, as many as the window needs.
    integral = value * np.arange(-whole - 1.0, 1.0)
    last = value

    def following(values: FloatArray) -> FloatArray:
        """Return the mean over the window up to each of the next values, of their shape (n,), n >= 1.

        The running integral and the last value are kept for the next call.
        """
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
def vibration_background(settings: Settings, channel: Channel, run: SceneRun) -> Change:
    """Return the change that adds background vibration to a level, by the root of the sum of squares.

    The background is the ``floor`` of the sensor plus the ``engine``, given at the fold speed and growing
    with the square of the speed. It swells and falls by the share ``sea`` in each ``period`` [s]. Each
    sum is multiplied by a normal number of the standard deviation ``scatter``, up to 0.3, about 1, and
    never negative. ``sea`` may be missing, and then ``period``; ``floor`` and ``engine`` are in ``unit``,
    that of the level.

    Raises:
        SceneError: A setting is missing or breaks its rule, or the bearing has no fold at its nominal load.
    """
    unit, _ = read_unit(settings, channel)
    bearing = channel.bearings[0].name
    fold = run.shaft.channel(bearing, 'speed').factor('fold')
    floor = settings.number('floor', unit, above=0.0)
    engine = settings.number('engine', unit, minimum=0.0)
    sea = settings.number('sea', '-', minimum=0.0, maximum=1.0) if 'sea' in settings else 0.0
    period = settings.number('period', 's', above=0.0) if sea else 1.0
    scatter = settings.number('scatter', '-', minimum=0.0, maximum=0.3)
    random = run.make_random_stream(settings, channel)

    def add(signal: Signal) -> None:
        """Replace the values of a signal in place by those with the background."""
        ratio = run.shaft.speed(bearing, signal.time) / fold
        swell = 1.0 + sea * np.sin(2.0 * np.pi / period * signal.time)
        total = np.hypot(signal.value, (floor + engine * ratio**2) * swell)
        total *= 1.0 + scatter * random.standard_normal(total.size)
        signal.value[:] = np.maximum(total, 0.0)

    return add


@channel_effect('sensor', CHANNELS, 'bias', 'drift', 'unit', section='the error')
def bias(settings: Settings, channel: Channel, run: SceneRun) -> Change:
    """Return the change that adds a ``bias`` to the values and, where it is given, a ``drift`` per hour.

    Both are in ``unit``.

    Raises:
        SceneError: A setting is missing or breaks its rule.
    """
    unit, factor = read_unit(settings, channel)
    drift = settings.number('drift', f'{unit} per hour') / 3600.0 if 'drift' in settings else 0.0
    constant, rate = settings.number('bias', unit) * factor, drift * factor

    def add(signal: Signal) -> None:
        signal.value += constant + rate * signal.time

    return add


@channel_effect('sensor', CHANNELS, 'standard_deviation', 'unit', section='the noise')
def sensor_noise(settings: Settings, channel: Channel, run: SceneRun) -> Change:
    """Return the change that adds white normal noise of a ``standard_deviation`` in ``unit`` to the values.

    Raises:
        SceneError: A setting is missing or breaks its rule.
    """
    unit, factor = read_unit(settings, channel)
    deviation = settings.number('standard_deviation', unit, minimum=0.0) * factor
    random = run.make_random_stream(settings, channel)

    def add(signal: Signal) -> None:
        signal.value += deviation * random.standard_normal(signal.value.size)

    return add


@channel_effect('sensor', CHANNELS, 'size', 'unit', 'windows', 'share', section='the spikes')
def spikes(settings: Settings, channel: Channel, run: SceneRun) -> Change:
    """Return the change that adds ``size`` to some values, or takes it from them, with even chances.

    The size is in ``unit``. It hits those in ``windows``, those of a random ``share``, or those of the share
    in the windows.

    Raises:
        SceneError: There is neither, or a setting is missing or breaks its rule.
    """
    unit, factor = read_unit(settings, channel)
    size = settings.number('size', unit) * factor
    hit = read_sample_mask(settings, run.duration, run.make_random_stream(settings, channel))
    random = run.make_random_stream(settings, channel, 'sign')

    def add(signal: Signal) -> None:
        off = hit(signal.time)
        signs = np.where(random.random(signal.time.size) < 0.5, -1.0, 1.0)
        signal.value[off] += size * signs[off]

    return add


@channel_effect('sensor', CHANNELS, 'step', 'unit', section='the step')
def quantisation(settings: Settings, channel: Channel, run: SceneRun) -> Change:
    """Return the change that rounds values to the nearest multiple of a ``step`` in ``unit``.

    Raises:
        SceneError: The step is missing or below 1e-9.
    """
    unit, factor = read_unit(settings, channel)
    step = settings.number('step', unit, minimum=1e-9) * factor

    def round_off(signal: Signal) -> None:
        signal.value[:] = np.rint(signal.value / step) * step

    return round_off


@channel_effect('sensor', CHANNELS, 'windows', section='when it is stuck')
def stuck(settings: Settings, channel: Channel, run: SceneRun) -> Change:
    """Return the change that repeats in each window the last value before it.

    Where there is none, the first value within the window is repeated.

    Raises:
        SceneError: The windows break their rule.
    """
    held = read_windows(settings, run.duration)
    last: float | None = None

    def hold(signal: Signal) -> None:
        """Repeat in place the last value before each window; keep the last one for the next block."""
        nonlocal last
        value = signal.value
        if not value.size:
            return
        place = np.where(held(signal.time), -1, np.arange(value.size))
        source = np.maximum.accumulate(place)
        first = value[0] if last is None else last
        value[:] = np.where(source < 0, first, value[np.maximum(source, 0)])
        last = float(value[-1])

    return hold


@channel_effect('sensor', CHANNELS, 'windows', 'share', section='when it sends NaN')
def not_a_number(settings: Settings, channel: Channel, run: SceneRun) -> Change:
    """Return the change that makes values NaN: in ``windows``, a random ``share``, or it in the windows.

    Raises:
        SceneError: There is neither, or a setting breaks its rule.
    """
    hit = read_sample_mask(settings, run.duration, run.make_random_stream(settings, channel))

    def spoil(signal: Signal) -> None:
        signal.value[hit(signal.time)] = np.nan

    return spoil


# Largest jump of a clock: ten years [s].
_MAX_JUMP = 3.2e8


@channel_effect('recording', CHANNELS, 'standard_deviation', section='the jitter')
def clock_jitter(settings: Settings, channel: Channel, run: SceneRun) -> Change:
    """Return the change that scatters the stamps by a normal deviation; stamps before 1970 become 1970.

    The stamps are those in headers; of messages without a header they are the log times.

    Raises:
        SceneError: The deviation is missing, or not from 0 to 10 s.
    """
    deviation = settings.number('standard_deviation', 's', minimum=0.0, maximum=10.0)
    random = run.make_random_stream(settings, channel)

    def shift(signal: Signal) -> None:
        off = random.standard_normal(signal.stamp_ns.size) * (deviation * 1e9)
        signal.stamp_ns += np.rint(off).astype(np.int64)
        np.maximum(signal.stamp_ns, 0, out=signal.stamp_ns)

    return shift


@channel_effect('recording', CHANNELS, 'jumps')
def clock_jump(settings: Settings, channel: Channel, run: SceneRun) -> Change:
    """Return the change that shifts all stamps after each jump of the clock.

    Raises:
        SceneError: A jump breaks its rule, goes back without a header, or leaves the range of stamps.
    """
    jumps = _clock_jumps(settings, run.duration)
    if any(by < 0.0 for _, by in jumps):
        require_header(channel, 'its clock can only jump forward')
    times = np.array([time for time, _ in jumps])
    shifts_ns = np.cumsum([0, *(round(by * 1e9) for _, by in jumps)])
    edges = [*times.tolist(), run.duration]
    for number, (begin, end) in enumerate(pairwise(edges), 1):
        first, last = (run.start_ns + int(shifts_ns[number]) + round(time * 1e9) for time in (begin, end))
        if first < 0 or last >= channel.stamps_end_ns:
            raise SceneError(
                f'{settings.label("jumps")}: jump {number} takes the clock out of the range of'
                ' time stamps: from 1970, in headers to 2038, else to 2262'
            )

    def shift_stamps(signal: Signal) -> None:
        signal.stamp_ns += shifts_ns[np.searchsorted(times, signal.time, side='right')]

    return shift_stamps


def _clock_jumps(settings: Settings, duration: float) -> list[tuple[float, float]]:
    """Return the ``jumps`` of a clock: rising times [s], each with its size [s], below 0 for a jump back.

    Raises:
        SceneError: There is none, one is 0 or beyond ten years, or times do not rise within the scene.
    """
    rows = settings.rows('jumps', 'jump', 'a list of jumps [time in s, value in s]')
    jumps = check_points(rows, duration)
    for (name, _), (_, by) in zip(rows, jumps, strict=True):
        if not 0.0 < abs(by) <= _MAX_JUMP:
            rule = f'which must not be 0 nor beyond {_MAX_JUMP:g} s'
            raise SceneError(f'{name} is by {by:g} s, {rule}')
    return jumps


@channel_effect('recording', CHANNELS, 'delay', 'windows', 'share', section='which messages are late')
def out_of_order(settings: Settings, channel: Channel, run: SceneRun) -> Change:
    """Return the change that delays the arrival of some messages, which are then recorded out of order.

    The ``delay`` [s] is above the time between two messages and at most 60 s. Their stamps stay. It hits
    those in ``windows``, those of a random ``share``, or those of the share in the windows.

    Raises:
        SceneError: The messages have no header, there is neither, or a setting breaks its rule.
    """
    require_header(channel, 'none of its messages can be out of order')
    # A shorter delay overtakes nothing.
    delay = settings.number('delay', 's', above=1.0 / channel.rate, maximum=60.0)
    delay_ns = round(delay * 1e9)
    hit = read_sample_mask(settings, run.duration, run.make_random_stream(settings, channel))

    def hold_up(signal: Signal) -> None:
        assert signal.arrival_ns is not None  # it has a header
        signal.arrival_ns[hit(signal.time)] += delay_ns

    return hold_up


@channel_effect('recording', CHANNELS, 'windows', 'share', section='which messages come twice')
def repeated_stamps(settings: Settings, channel: Channel, run: SceneRun) -> Change:
    """Return the change that records some messages twice, with equal stamps.

    It hits those in ``windows``, those of a random ``share``, or those of the share in the windows.

    Raises:
        SceneError: There is neither, or a setting breaks its rule.
    """
    hit = read_sample_mask(settings, run.duration, run.make_random_stream(settings, channel))

    def repeat(signal: Signal) -> None:
        signal.copies[hit(signal.time)] *= 2

    return repeat


@channel_effect('recording', CHANNELS, 'windows', 'share', section='which messages are lost')
def dropout(settings: Settings, channel: Channel, run: SceneRun) -> Change:
    """Return the change that loses messages: in ``windows``, a random ``share``, or it in the windows.

    Raises:
        SceneError: There is neither, or a setting breaks its rule.
    """
    hit = read_sample_mask(settings, run.duration, run.make_random_stream(settings, channel))

    def lose(signal: Signal) -> None:
        signal.copies[hit(signal.time)] = 0

    return lose


@channel_effect('recording', CHANNELS, 'value', 'unit', 'rate', section='what it sends')
def second_publisher(settings: Settings, channel: Channel, run: SceneRun) -> None:
    """Add an effect to the run that merges a second sender's messages into a topic's signal of each block.

    It sends a constant ``value``, in ``unit``, half-way between instants of its ``rate`` > 0 [Hz], up to
    :data:`.MAX_RATE`.

    Raises:
        SceneError: A setting is missing or breaks its rule.
    """
    unit, factor = read_unit(settings, channel)
    value = settings.number('value', unit) * factor
    rate = settings.number('rate', 'Hz', above=0.0, maximum=MAX_RATE)

    def join(block: TimeBlock) -> None:
        """Merge the second sender's messages into the topic's signal of a block, in order of true time."""
        halves = block.instants(2.0 * rate)
        time = halves[np.rint(halves * (2.0 * rate)).astype(np.int64) % 2 == 1]
        stamp = run.start_ns + np.rint(time * 1e9).astype(np.int64)
        more = {'time': time, 'stamp_ns': stamp, 'arrival_ns': stamp}
        more |= {'value': np.full(time.size, value), 'copies': np.ones_like(stamp)}
        signal = block.signals[channel.topic]
        order = np.argsort(np.concatenate([signal.time, time]), kind='stable')
        for name, values in more.items():
            if (earlier := getattr(signal, name)) is not None:
                setattr(signal, name, np.concatenate([earlier, values])[order])

    run.effects.append(join)


@effect('file', 'time')
def cut_off(settings: Settings, run: SceneRun) -> None:
    """Let the recorder end in mid-write: set ``run.cut`` to the ``time`` [s].

    Raises:
        SceneError: The effect is listed twice, or the time lies outside the scene.
    """
    run.claim(settings.name)
    run.cut = settings.number('time', 's', above=0.0, maximum=run.duration)
