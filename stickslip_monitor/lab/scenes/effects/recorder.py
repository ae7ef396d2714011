# SPDX-License-Identifier: Apache-2.0
"""Errors of clocks and recorder: jitter, jumps, disorder, repeats, losses, another sender, cuts.

A jump shifts all later stamps; several add up. Without a header a message's stamp is the
recorder's own time, by which readers sort: such a topic can jump forward only, and cannot be out
of order. After a cut nothing is written: the file ends within its last chunk, without its index,
and a folder has no metadata.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from stickslip_monitor.arrays import FloatArray, IntArray
from stickslip_monitor.errors import SceneError
from stickslip_monitor.lab.scenes.effects.effect import (
    SENSOR_KEYS,
    UNITS,
    BuildContext,
    Effect,
    EffectKind,
    RecordingCut,
    require_header,
)
from stickslip_monitor.lab.scenes.profile import read_rows
from stickslip_monitor.lab.scenes.settings import Settings
from stickslip_monitor.lab.scenes.shaft import TimeBlock
from stickslip_monitor.lab.scenes.telemetry import Signal
from stickslip_monitor.lab.scenes.windows import WINDOW_KEYS as OCCASIONS
from stickslip_monitor.lab.scenes.windows import SampleMask, read_sample_mask
from stickslip_monitor.monitor.signals import INPUTS


@dataclass(frozen=True, slots=True)
class ClockJitter:
    """Shifts stamps; ``sources`` holds for each topic standard deviation [s] and stream."""

    sources: dict[str, tuple[float, np.random.Generator]]

    def apply(self, block: TimeBlock) -> None:
        """Shift the stamps of the next samples; none comes to lie before 1970."""
        for topic, (deviation, random) in self.sources.items():
            stamp_ns = block.signals[topic].stamp_ns
            shift = random.standard_normal(stamp_ns.size) * (deviation * 1e9)
            stamp_ns += np.rint(shift).astype(np.int64)
            np.maximum(stamp_ns, 0, out=stamp_ns)


def build_clock_jitter(settings: Settings, context: BuildContext) -> Effect:
    """Build the effect."""
    sources = {}
    for channel, own in context.sensors_of(settings, ['standard_deviation'], 'the jitter'):
        # Beyond ten seconds it is no jitter any more.
        deviation = own.number('standard_deviation', 's', least=0.0, most=10.0)
        sources[channel.topic] = deviation, context.random(settings, channel)
    return ClockJitter(sources)


CLOCK_JUMP_KEYS = ('bearing', 'jumps')
# Ten years.
_LONGEST = 3.2e8


@dataclass(frozen=True, slots=True, eq=False)
class ClockJump:
    """Shifts stamps.

    Attributes:
        topics: The topics whose clock jumps.
        times: When, rising, shape (n,) [s].
        shifts_ns: The shift before the first and from each on, shape (n + 1,) [ns].
    """

    topics: tuple[str, ...]
    times: FloatArray
    shifts_ns: IntArray

    def apply(self, block: TimeBlock) -> None:
        """Shift the stamps of the next samples."""
        for topic in self.topics:
            signal = block.signals[topic]
            past = np.searchsorted(self.times, signal.time, side='right')
            signal.stamp_ns[:] += self.shifts_ns[past]


def build_clock_jump(settings: Settings, context: BuildContext) -> Effect:
    """Build the effect."""
    rows = read_rows(settings, 'jumps', 'jump', 's', context.duration)
    for number, (_, by) in enumerate(rows, 1):
        if not 0.0 < abs(by) <= _LONGEST:
            raise SceneError(
                f'{settings.label("jumps")}: jump {number} is by {by:g} s, which must not be 0 nor'
                f' beyond {_LONGEST:g} s'
            )
    channels = [c for quantity in INPUTS for c in context.pick(settings, quantity)]
    if any(by < 0.0 for _, by in rows):
        for channel in channels:
            require_header(channel, 'its clock can only jump forward')
    times = np.array([time for time, _ in rows])
    shifts = np.cumsum([0, *(round(by * 1e9) for _, by in rows)])
    edges = [*times.tolist(), context.duration]
    for number, shift in enumerate(shifts[1:].tolist()):
        first, last = (
            context.start_ns + shift + round(t * 1e9) for t in edges[number : number + 2]
        )
        if first < 0 or any(last >= channel.stamps_end_ns for channel in channels):
            raise SceneError(
                f'{settings.label("jumps")}: jump {number + 1} takes the clock out of the range of'
                ' time stamps: from 1970, in headers to 2038, else to 2262'
            )
    return ClockJump(tuple(c.topic for c in channels), times, shifts)


@dataclass(frozen=True, slots=True)
class OutOfOrder:
    """Delays messages; ``delays`` holds for each topic delay [ns] and which are delayed."""

    delays: dict[str, tuple[int, SampleMask]]

    def apply(self, block: TimeBlock) -> None:
        """Delay those of the next messages that are hit."""
        for topic, (delay_ns, occasions) in self.delays.items():
            signal = block.signals[topic]
            if signal.arrival_ns is not None:  # always so: see build
                signal.arrival_ns[occasions.hit(signal.time)] += delay_ns


def build_out_of_order(settings: Settings, context: BuildContext) -> Effect:
    """Build the effect."""
    delays = {}
    keys = ['delay', *OCCASIONS]
    for channel, own in context.sensors_of(settings, keys, 'which messages arrive late'):
        require_header(channel, 'none of its messages can be out of order')
        # A shorter delay overtakes nothing.
        delay = own.number('delay', 's', above=1.0 / channel.rate, most=60.0)
        occasions = read_sample_mask(own, context.duration, context.random(settings, channel))
        delays[channel.topic] = round(delay * 1e9), occasions
    return OutOfOrder(delays)


@dataclass(frozen=True, slots=True)
class RepeatedStamps:
    """Repeats messages of some signals; ``occasions`` says which for each topic."""

    occasions: dict[str, SampleMask]

    def apply(self, block: TimeBlock) -> None:
        """Repeat those of the next messages that are hit."""
        for topic, occasions in self.occasions.items():
            signal = block.signals[topic]
            block.signals[topic] = signal.repeated(occasions.hit(signal.time))


def build_repeated_stamps(settings: Settings, context: BuildContext) -> Effect:
    """Build the effect."""
    return RepeatedStamps(
        {
            channel.topic: read_sample_mask(
                own, context.duration, context.random(settings, channel)
            )
            for channel, own in context.sensors_of(
                settings, OCCASIONS, 'which messages come twice'
            )
        }
    )


@dataclass(frozen=True, slots=True)
class Dropout:
    """Loses messages of some signals; ``occasions`` says which for each topic."""

    occasions: dict[str, SampleMask]

    def apply(self, block: TimeBlock) -> None:
        """Lose those of the next messages that are hit."""
        for topic, occasions in self.occasions.items():
            signal = block.signals[topic]
            block.signals[topic] = signal.lost(occasions.hit(signal.time))


def build_dropout(settings: Settings, context: BuildContext) -> Effect:
    """Build the effect."""
    return Dropout(
        {
            channel.topic: read_sample_mask(
                own, context.duration, context.random(settings, channel)
            )
            for channel, own in context.sensors_of(settings, OCCASIONS, 'which messages are lost')
        }
    )


@dataclass(frozen=True, slots=True)
class _Publisher:
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

    sources: dict[str, _Publisher]
    start_ns: int

    def apply(self, block: TimeBlock) -> None:
        """Add those of a block."""
        for topic, source in self.sources.items():
            block.signals[topic] = source.join(block.signals[topic], block, self.start_ns)


def build_second_publisher(settings: Settings, context: BuildContext) -> Effect:
    """Build the effect."""
    sources = {}
    for channel, own in context.sensors_of(settings, ['value', 'unit', 'rate'], 'what it sends'):
        unit = own.choice('unit', UNITS[channel.quantity])
        value = own.number('value', unit) * channel.factor(unit)
        rate = own.number('rate', 'Hz', above=0.0, most=1000.0)
        sources[channel.topic] = _Publisher(value, rate)
    return SecondPublisher(sources, context.start_ns)


CUT_OFF_KEYS = ('time',)


def build_cut_off(settings: Settings, context: BuildContext) -> RecordingCut:
    """Build the cut."""
    context.once(settings)
    return RecordingCut(settings.number('time', 's', above=0.0, most=context.duration))


EFFECTS = {
    'clock_jitter': EffectKind(SENSOR_KEYS, build_clock_jitter),
    'clock_jump': EffectKind(CLOCK_JUMP_KEYS, build_clock_jump),
    'out_of_order': EffectKind(SENSOR_KEYS, build_out_of_order),
    'repeated_stamps': EffectKind(SENSOR_KEYS, build_repeated_stamps),
    'dropout': EffectKind(SENSOR_KEYS, build_dropout),
    'second_publisher': EffectKind(SENSOR_KEYS, build_second_publisher),
    'cut_off': EffectKind(CUT_OFF_KEYS, build_cut_off),
}
