# SPDX-License-Identifier: Apache-2.0
"""Spoils what a bearing's sensors sent on a voyage, in the ways of senders that fail on ships.

Each function takes a voyage and a generator of random numbers, and gives the voyage as the monitor
would have got it. What the lining did stays as it was.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial

import numpy as np

from benchmarks.voyages import SensorRecord
from stickslip_monitor.arrays import BoolArray, FloatArray, IntArray
from stickslip_monitor.monitor.level_comparison import compare_streams
from stickslip_monitor.monitor.sample_types import LEVEL, Stream

Spoil = Callable[[SensorRecord, np.random.Generator], SensorRecord]
SECOND = 10**9


def without_level(case: SensorRecord, _: np.random.Generator) -> SensorRecord:
    """Remove the level."""
    return replace(_keep_rows(case, case.stream.inputs != LEVEL), config=replace(case.config, level=None))


def in_bursts(case: SensorRecord, _: np.random.Generator) -> SensorRecord:
    """Speed and load are handed over once a second, stamped within milliseconds of each other."""
    stamp = case.stream.time_ns.copy()
    for place in range(LEVEL):
        rows = np.flatnonzero(case.stream.inputs == place)
        second = stamp[rows] // SECOND + 1
        nth = np.arange(rows.size) - np.searchsorted(second, second)
        stamp[rows] = second * SECOND + (nth * 3 + place) * 10**6
    return _sort_by_stamp(case, stamp)


def oddly_stamped(case: SensorRecord, random: np.random.Generator, off: float, share: float) -> SensorRecord:
    """Move a share of the stamps of speed and load by some seconds, either way."""
    stream = case.stream
    replaced = (stream.inputs != LEVEL) & (random.random(stream.time_ns.size) < share)
    sign = random.choice([-1, 1], stream.time_ns.size)
    stamp = stream.time_ns + replaced * sign * int(off * SECOND)
    return replace(case, stream=replace(stream, time_ns=stamp))


def send_unevenly(case: SensorRecord, gaps: Callable[[int], FloatArray]) -> SensorRecord:
    """Send some values of speed and load only, at uneven times."""
    stream = case.stream
    is_level = stream.inputs == LEVEL
    for place in range(LEVEL):
        rows = np.flatnonzero(stream.inputs == place)
        time = (stream.arrival_ns[rows] - stream.arrival_ns[0]) / SECOND
        sent = np.cumsum(gaps(rows.size))
        is_level[np.unique(rows[np.searchsorted(time, sent[sent < time[-1]])])] = True
    return _keep_rows(case, is_level)


def without_values(case: SensorRecord, random: np.random.Generator) -> SensorRecord:
    """Send that there is no value, for two to ten seconds at a time, on both inputs."""
    stream = case.stream
    begin, end = _draw_intervals(case, random, (20.0, 100.0), (2.0, 10.0))
    time = (stream.arrival_ns - stream.arrival_ns[0]) / SECOND
    which = np.searchsorted(begin, time, 'right') - 1
    none = (which >= 0) & (time < end[which]) & (stream.inputs != LEVEL)
    means = random.choice([-999.25, -9999.0, 3276.7, 65535.0], begin.size)
    return replace(case, stream=replace(stream, value=np.where(none, means[which], stream.value)))


def stop_senders(case: SensorRecord, random: np.random.Generator) -> SensorRecord:
    """Silence all senders for five to sixty seconds at a time."""
    begin, end = _draw_intervals(case, random, (100.0, 500.0), (5.0, 60.0))
    time = (case.stream.arrival_ns - case.stream.arrival_ns[0]) / SECOND
    which = np.searchsorted(begin, time, 'right') - 1
    return _keep_rows(case, (which < 0) | (time >= end[which]))


def _draw_intervals(
    case: SensorRecord, random: np.random.Generator, apart: tuple[float, float], lasting: tuple[float, float]
) -> tuple[FloatArray, FloatArray]:
    """Return begins and ends of intervals at random [s], given their distances and lengths."""
    seconds = float(case.stream.arrival_ns[-1] - case.stream.arrival_ns[0]) / SECOND
    count = int(seconds / apart[0]) + 1
    pause, long = random.uniform(*apart, count), random.uniform(*lasting, count)
    end = np.cumsum(pause + long)
    return end - long, end


def with_threshold(case: SensorRecord, _: np.random.Generator, factor: float) -> SensorRecord:
    """Set another threshold; nan leaves it out, so that it is learned."""
    level = case.config.level
    assert level is not None
    level = replace(level, threshold=level.threshold * factor)
    return replace(case, config=replace(case.config, level=level))


def amplify_level(case: SensorRecord, _: np.random.Generator, gain: float) -> SensorRecord:
    """Multiply the level by a factor."""
    return _change_level(case, lambda _, level: gain * level)


def blind_level(case: SensorRecord, random: np.random.Generator) -> SensorRecord:
    """Reduce the level to its background, as in the wrong place or with its cable off."""
    return _change_level(case, lambda _, level: 1.0 + 0.1 * random.standard_normal(level.size))


def freeze_level(case: SensorRecord, _: np.random.Generator) -> SensorRecord:
    """Freeze the level after the first minute."""
    return _change_level(case, lambda t, level: np.where(t < 60.0, level, level[np.argmax(t >= 60.0) - 1]))


def with_engine_order(case: SensorRecord, _: np.random.Generator) -> SensorRecord:
    """Raise the background to one and a half times the threshold at all times."""
    assert case.config.level is not None
    loud = 1.5 * case.config.level.threshold
    return _change_level(case, lambda _, level: np.hypot(level, loud))


def with_bursts(case: SensorRecord, random: np.random.Generator) -> SensorRecord:
    """Add something else at three times the threshold for two to four seconds of each minute."""
    assert case.config.level is not None
    loud = 3.0 * case.config.level.threshold

    def spoilt(t: FloatArray, level: FloatArray) -> FloatArray:
        minute = (t // 60.0).astype(int)
        count = int(minute[-1]) + 1
        begin, lasting = random.uniform(0.0, 56.0, count), random.uniform(2.0, 4.0, count)
        since = t % 60.0 - begin[minute]
        return np.hypot(level, loud * ((since >= 0.0) & (since < lasting[minute])))

    return _change_level(case, spoilt)


def with_pump(case: SensorRecord, random: np.random.Generator) -> SensorRecord:
    """Add a pump, three times the threshold, that runs for 20 to 60 s after 2 to 10 minutes of rest."""
    assert case.config.level is not None
    loud = 3.0 * case.config.level.threshold
    begin, end = _draw_intervals(case, random, (120.0, 600.0), (20.0, 60.0))

    def spoilt(t: FloatArray, level: FloatArray) -> FloatArray:
        which = np.searchsorted(begin, t, 'right') - 1
        return np.hypot(level, loud * ((which >= 0) & (t < end[which])))

    return _change_level(case, spoilt)


def with_other_bearing(case: SensorRecord, _: np.random.Generator) -> SensorRecord:
    """Add, at half its level, another bearing: the same one half a voyage later."""
    return _change_level(case, lambda _, level: np.hypot(level, 0.5 * np.roll(level, level.size // 2)))


def with_both_bearings(case: SensorRecord, random: np.random.Generator) -> SensorRecord:
    """Add that bearing, and its level to the configuration: that hears this one at half its level, too."""
    config = case.config
    assert config.level is not None
    heard_here = with_other_bearing(case, random)
    heard_there = with_other_bearing(
        _change_level(case, lambda _, level: np.roll(level, level.size // 2)), random
    )
    configs = config, replace(config, name='other', level=replace(config.level, topic='/other/level'))
    streams = compare_streams(configs, {config.name: heard_here.stream, 'other': heard_there.stream})
    return replace(case, stream=streams[config.name])


def half_lost(case: SensorRecord, _: np.random.Generator) -> SensorRecord:
    """Drop the level in half of each minute."""
    stream = case.stream
    return _keep_rows(case, (stream.inputs != LEVEL) | (stream.arrival_ns // (30 * SECOND) % 2 == 0))


LEVELS: Mapping[str, Spoil] = {
    'none': without_level,
    "good, threshold a fifth of the cycle's": lambda case, _: case,
    'good, two fifths': partial(with_threshold, factor=2.0),
    'good, threshold learned': partial(with_threshold, factor=math.nan),
    'alive but blind': blind_level,
    'stuck': freeze_level,
    'lost half of the time': half_lost,
    'gain × 3': partial(amplify_level, gain=3.0),
    'strong engine order': with_engine_order,
    'bursts of 2 to 4 s each minute': with_bursts,
    'a pump that runs for 20 to 60 s': with_pump,
    'another bearing at half its level': with_other_bearing,
}
SHIPS: Mapping[str, Spoil] = {'another bearing at half its level, both measured': with_both_bearings}
STAMPS: Mapping[str, Spoil] = {
    'in bursts, once a second': lambda case, r: in_bursts(without_level(case, r), r),
    'one stamp in twenty off by 6 s': lambda case, r: oddly_stamped(without_level(case, r), r, 6.0, 0.05),
    'one stamp in twenty off by an hour': lambda case, r: oddly_stamped(
        without_level(case, r), r, 3600.0, 0.05
    ),
    'sent on change, after 0.2 or 4 s': lambda case, r: send_unevenly(
        without_level(case, r), lambda count: r.choice([0.2, 4.0], count)
    ),
    'at random, once a second': lambda case, r: send_unevenly(
        without_level(case, r), lambda count: r.exponential(1.0, count)
    ),
    '"no value" for a tenth of the time': lambda case, r: without_values(without_level(case, r), r),
    'senders that stop and start': lambda case, r: stop_senders(without_level(case, r), r),
}


def _keep_rows(case: SensorRecord, rows: BoolArray) -> SensorRecord:
    stream = case.stream
    names = ('time_ns', 'inputs', 'value', 'arrival_ns')
    columns = {name: getattr(stream, name)[rows] for name in names}
    return replace(case, stream=replace(stream, **columns))


def _sort_by_stamp(case: SensorRecord, stamp: IntArray) -> SensorRecord:
    """Return the samples with other stamps, which are also when they arrive."""
    order = np.argsort(stamp, kind='stable')
    stream = case.stream
    return replace(case, stream=Stream(stamp[order], stream.inputs[order], stream.value[order]))


def _change_level(case: SensorRecord, change: Callable[[FloatArray, FloatArray], FloatArray]) -> SensorRecord:
    """Return the voyage with another level, made of its times [s] and values."""
    stream = case.stream
    rows = stream.inputs == LEVEL
    value = stream.value.copy()
    if rows.any():
        time = (stream.arrival_ns[rows] - stream.arrival_ns[0]) / SECOND
        value[rows] = change(time, stream.value[rows])
    return replace(case, stream=replace(stream, value=value))
