# SPDX-License-Identifier: Apache-2.0
"""Evaluates the true operating point over time, and the channels of telemetry that sample it.

The shaft is not sampled. Telemetry, a sensor that averages between its samples, the lining's
integrator and the recorded truth each evaluate it at their own instants and get identical values
at the same instant, however time is divided into blocks.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from stickslip_lab.scenes.settings import Settings
from stickslip_lab.scenes.truth_topics import Column
from stickslip_logs.recordings.writer import NUMBER_FIELDS, STAMP_END, STAMPED_FIELDS
from stickslip_monitor.arrays import FloatArray, IntArray
from stickslip_monitor.errors import SceneError
from stickslip_monitor.monitor.parameters import (
    LOAD_UNITS,
    BearingConfig,
    InputConfig,
    LoadConfig,
    MonitorConfig,
)
from stickslip_monitor.monitor.sample_types import INPUTS, LEVEL, QUANTITIES, WATER
from stickslip_monitor.monitor.value_check import refused
from stickslip_monitor.physics.averages_by_quadrature import steady_slope_table
from stickslip_monitor.physics.averaging import fold_speed, hopf_load
from stickslip_monitor.physics.friction import speed_scales
from stickslip_monitor.physics.lubrication import as_measured


def instant_count(rate: float, duration: float) -> int:
    """Return the number of instants ``k / rate`` from 0 to ``duration`` [s], with both ends; rate in Hz."""
    return math.floor(duration * rate * (1.0 + 1e-12)) + 1


def instant_numbers(rate: float, start: float, end: float, duration: float) -> range:
    """Return the numbers ``k`` of the instants ``k / rate`` from ``start`` to before ``end`` [s]; rate in Hz.

    Stretches that join cover every instant of the scene once; the last one, which ends at
    ``duration`` [s], has the instant at its end too.
    """
    whole = instant_count(rate, duration)
    stop = whole if end == duration else min(whole, math.ceil(end * rate))
    return range(min(stop, math.ceil(start * rate)), stop)


def nominal_load(config: BearingConfig) -> float:
    """Return the nominal load of a bearing [N]: the larger of the two that its configuration assumes.

    Without an assumed load it is five times the least load at which any speed is unstable.

    Raises:
        SceneError: Sliding is unstable at no load.
    """
    if config.load.assumed is not None:
        return config.load.assumed[1]
    law = config.bearing.friction
    # Not every law falls fastest at once: a Gaussian one and a table may begin flat.
    speeds = steady_slope_table(law)[0] if speed_scales(law) else np.empty(0)
    loads = hopf_load(as_measured(config.bearing), np.append(0.0, speeds))
    # The nominal load of the reference bearing is 1 kN, and its sliding unstable from 200 N on.
    load = 5.0 * float(np.fmin.reduce(loads))
    if not 0.0 < load < math.inf:
        raise SceneError(
            f'units nominal and fold say nothing about bearing {config.name}: its sliding is'
            ' unstable at no load; use N and rpm'
        )
    return load


def nominal_fold(config: BearingConfig) -> float:
    """Return the averaged fold speed of a bearing at its nominal load [m/s].

    Raises:
        SceneError: It has no fold there, or no nominal load.
    """
    load = nominal_load(config)
    fold = float(fold_speed(config.bearing, load))
    if not 0.0 < fold < math.inf:
        raise SceneError(
            f'bearing {config.name} has no fold at its nominal load, {load:g} N, which the unit fold and'
            ' vibration_background need: use another unit, or leave the effect out'
        )
    return fold


@dataclass(frozen=True, slots=True)
class Channel:
    """One sensor: a topic, and the bearings that read it.

    Several bearings of one shaft read one speed topic; SI values are then those of the first.
    """

    quantity: str  # one of :data:`CHANNELS`
    bearings: tuple[BearingConfig, ...]  # the bearings that read it, at least one
    rate: float  # samples per second [Hz]

    @property
    def input(self) -> InputConfig:
        """Configuration of the topic; of a load that the monitor only assumes, one with a topic of its own.

        That topic, ``/bearing/NAME/load``, has the true load, and the monitor does not read it.
        """
        bearing = self.bearings[0]
        source = bearing.inputs[self.quantity]
        if not source.is_assumed:
            return source
        return LoadConfig(
            topic=f'/bearing/{bearing.name}/load',
            unit=source.unit,
            maximum=source.maximum,
            factor=source.factor,
        )

    @property
    def topic(self) -> str:
        """Its topic."""
        return self.input.topic

    @property
    def is_stamped(self) -> bool:
        """Whether its messages have a header with a time stamp."""
        return self.input.type in STAMPED_FIELDS

    def serves(self, bearing: str) -> bool:
        """Return whether a bearing reads it."""
        return bearing in [b.name for b in self.bearings]

    @property
    def stamps_end_ns(self) -> int:
        """End of its time stamps: in 2038 in a header, in 2262 by the recorder [ns]."""
        return STAMP_END if self.is_stamped else 1 << 63

    def factor(self, unit: str) -> float:
        """Return the SI value of one of a unit on this channel: m/s, N, C; of a level 1, in its own unit.

        ``nominal`` is a load, :func:`nominal_load`, and ``fold`` the averaged fold speed at that load.

        Raises:
            SceneError: The unit has no meaning on this channel, as ``fold`` without a fold at that load.
        """
        if self.quantity == INPUTS[WATER]:
            return 1.0
        if self.quantity == 'level':
            if unit != self.input.unit:
                rule = f'{self.input.unit}, as in the configuration'
                raise refused(f'unit of the level on {self.topic}', unit, rule, SceneError)
            return 1.0
        if unit in ('nominal', 'fold'):
            config = self.bearings[0]
            return nominal_load(config) if unit == 'nominal' else nominal_fold(config)
        if self.quantity == 'load':
            return LOAD_UNITS[unit]
        if unit == 'm/s' and len({b.bearing.journal_diameter for b in self.bearings}) > 1:
            names = ', '.join(b.name for b in self.bearings)
            raise SceneError(
                f'unit m/s says nothing about topic {self.topic}: it serves {names}, whose'
                ' journals differ in diameter; use rpm, rad/s or Hz'
            )
        return self.bearings[0].bearing.speed.factor(unit)

    def speed_ratio(self, bearing: str) -> float:
        """Return a bearing's surface speed over that of the channel's first bearing; 1 for no speed.

        Journals on one shaft may differ in diameter.
        """
        if self.quantity != 'speed':
            return 1.0
        diameter = {b.name: b.bearing.journal_diameter for b in self.bearings}
        return diameter[bearing] / self.bearings[0].bearing.journal_diameter


@dataclass(slots=True, eq=False)
class Signal:
    """The samples of one channel over a stretch of time; effects change them."""

    channel: Channel
    time: FloatArray  # true instants of measurement since the scene's start, shape (n,) [s]
    stamp_ns: IntArray  # time stamps by the sensor's clock, shape (n,) [ns]
    value: FloatArray  # in the units of :meth:`Channel.factor`, shape (n,)
    copies: IntArray  # how often each is recorded, shape (n,)
    # When the recorder gets each message, by its own clock, shape (n,) [ns]; None where
    # messages have no stamp of their own, and the recorder's is all there is.
    arrival_ns: IntArray | None = None

    def messages(self) -> Messages:
        """Return the messages to record, each repeated ``copies`` times, in the order of the samples.

        Their numbers are raw, in the unit of the topic, before scale and offset of the configuration.
        """
        source = self.channel.input
        raw = np.repeat((self.value / source.factor - source.offset) / source.scale, self.copies)
        stamp = np.repeat(self.stamp_ns, self.copies)
        if self.arrival_ns is None:
            return Messages(stamp, None, raw)
        return Messages(np.repeat(self.arrival_ns, self.copies), stamp, raw)


class Messages(NamedTuple):
    """The messages of one channel over a stretch of time."""

    log_time_ns: IntArray  # when each was recorded, shape (n,) [ns]
    stamp_ns: IntArray | None  # the stamps in their headers, shape (n,) [ns]; None: they have none
    raw: FloatArray  # the numbers in them, shape (n,)


CHANNELS = INPUTS
"""The inputs that a scene may record: speed and load, and each other that ``telemetry`` gives a rate."""
MEMORY_CHANNELS = tuple(name for name in CHANNELS if name != INPUTS[LEVEL])
"""The inputs whose sensors may have a memory: a value of a level covers four natural periods already."""
MAX_RATE = 1000.0
"""Highest rate of telemetry, of a second sender and of true margins [Hz]: beyond any ship's sensor."""


def read_channels(config: MonitorConfig, telemetry: Any) -> tuple[Channel, ...]:
    """Return the channels of a scene, one for each topic, in the configuration's order.

    Args:
        config: The configuration of the bearings.
        telemetry: The section ``telemetry``: ``{speed: {rate: Hz}, load: {rate: Hz}}``, or one such
            mapping for each bearing.

    Raises:
        SceneError: A rate is missing or breaks its rule, an input is not configured or of a type that a
            scene cannot write, or bearings share a topic in different ways.
    """
    channels: dict[str, Channel] = {}
    for bearing in config.bearings:
        settings = _telemetry_section(telemetry, bearing.name, [b.name for b in config.bearings])
        for quantity in (name for name in CHANNELS if name in QUANTITIES or name in settings):
            if quantity not in bearing.inputs:
                raise SceneError(
                    f'telemetry.{quantity}: the configuration has no {bearing.name}.{quantity}.topic'
                )
            sampling = settings.section(quantity, ['rate'], 'its sampling, {rate: Hz}')
            rate = sampling.number('rate', 'Hz', minimum=1e-6, maximum=MAX_RATE)  # a sample in twelve days
            channel = Channel(quantity, (bearing,), rate)
            _check_input(f'{bearing.name}.{quantity}', channel.input)
            earlier = channels.get(channel.topic)
            channels[channel.topic] = channel if earlier is None else _share_channel(earlier, channel)
    return tuple(channels.values())


def _telemetry_section(telemetry: Any, bearing: str, bearings: Sequence[str]) -> Settings:
    """Return the telemetry of one bearing: its own section, or the common one.

    Raises:
        SceneError: There is none for it, or a key is unknown.
    """
    names = set(telemetry) if isinstance(telemetry, dict) else set()
    if names.isdisjoint(bearings) or not names.isdisjoint(CHANNELS):
        return Settings('telemetry', telemetry, CHANNELS)
    rates = 'the rates of its speed and load'
    return Settings('telemetry', telemetry, bearings).section(bearing, CHANNELS, rates)


def _check_input(name: str, settings: InputConfig) -> None:
    """Raise SceneError for an input, called ``name``, of a type or field that a scene cannot write."""
    fields = NUMBER_FIELDS.get(settings.type)
    if fields is None:
        raise SceneError(
            f'{name} is of type {settings.type} in the configuration: a scene can write'
            f' {", ".join(NUMBER_FIELDS)} only'
        )
    if '.'.join(map(str, settings.field)) not in fields:
        raise SceneError(
            f"{name} is field '{settings.field_text}' of {settings.type} in the configuration: a"
            f' scene can write {", ".join(fields)} only'
        )


def _share_channel(existing: Channel, added: Channel) -> Channel:
    """Return one channel for the bearings of two on one topic: ``existing`` with the bearing of ``added``.

    Raises:
        SceneError: They differ in quantity, type, field, rate, unit, scale or offset.
    """
    first, second = existing.bearings[0], added.bearings[0]
    where = f'topic {existing.topic} serves {first.name} and {second.name}'
    if existing.quantity != added.quantity:
        raise SceneError(f'{where}, as {existing.quantity} and as {added.quantity}: use two topics')
    if (existing.input.type, existing.input.field) != (added.input.type, added.input.field):
        raise SceneError(f'{where} with different types or fields: they must agree')
    if existing.rate != added.rate:
        raise SceneError(f'{where}: its rate cannot be both {existing.rate:g} and {added.rate:g} Hz')
    if not all(map(math.isclose, _channel_meaning(existing, first), _channel_meaning(added, second))):
        raise SceneError(f'{where} with different units, scales or offsets: they must agree')
    return replace(existing, bearings=(*existing.bearings, second))


def _channel_meaning(channel: Channel, bearing: BearingConfig) -> tuple[float, float, float]:
    """Return scale, offset and factor of a channel's numbers: three numbers that must agree on one topic.

    The factor is the SI value of one unit; of speeds it is the turning of the shaft [Hz].
    """
    turning = bearing.bearing.speed.factor('Hz') if channel.quantity == 'speed' else 1.0
    return channel.input.scale, channel.input.offset, channel.input.factor / turning


Term = Callable[[FloatArray], FloatArray]
"""Function of times since the scene's start, shape (n,) [s], to what is added to a speed [m/s], a load [N] or
a level there. An element must not depend on its neighbours; times may lie before the start."""


class Shaft:
    """Speed, load and water of every bearing.

    Speeds, of a channel's first bearing, and loads are the sum of the terms that effects have added. The
    temperature of the water is as configured until :meth:`set_water`.

    Args:
        channels: The channels of the scene, one for each topic.
    """

    def __init__(self, channels: Sequence[Channel]) -> None:
        self._channels = {channel.topic: channel for channel in channels}
        self._means: dict[str, list[Term]] = defaultdict(list)
        self._ways: dict[str, list[Term]] = defaultdict(list)
        self._ripples: dict[str, list[Term]] = defaultdict(list)
        for channel in channels:
            lubrication = channel.bearings[0].bearing.lubrication
            if channel.quantity == INPUTS[WATER] and lubrication is not None:
                self.set_water(channel.topic, partial(np.full_like, fill_value=lubrication.water_temperature))

    def set_water(self, topic: str, course: Term) -> None:
        """Replace the temperature of the water on a channel: ``course`` gives it at times [s], in C."""
        self._means[topic] = [course]

    def add(self, topic: str, term: Term, way: Term | None = None) -> None:
        """Add a term to the speed or load of a channel; ``way``, a speed's integral [m], turns the shaft."""
        self._means[topic].append(term)
        if way is not None:
            self._ways[topic].append(way)

    def add_ripple(self, topic: str, term: Term) -> None:
        """Add a term that follows from the turning of the shaft and does not turn it."""
        self._ripples[topic].append(term)

    def mean(self, topic: str, time: FloatArray) -> FloatArray:
        """Return the values of a channel without ripple at times [s], of their shape (n,): m/s, N or C."""
        return _sum_terms(self._means[topic], time)

    def value(self, topic: str, time: FloatArray) -> FloatArray:
        """Return the values of a channel at times [s], of their shape (n,): m/s, N or C.

        A load is never negative: a journal that lifts off has no load. A level is 0: effects add to a signal.
        """
        total = _sum_terms([*self._means[topic], *self._ripples[topic]], time)
        return np.maximum(total, 0.0) if self._channels[topic].quantity == 'load' else total

    def turns(self, bearing: str, time: FloatArray) -> FloatArray:
        """Return the turns of a bearing's journal since the start at times [s], of their shape (n,).

        Raises:
            KeyError: The scene has no speed of it.
        """
        channel = self.channel(bearing, 'speed')
        way = _sum_terms(self._ways[channel.topic], time)
        return way / (math.pi * channel.bearings[0].bearing.journal_diameter)

    def speed(self, bearing: str, time: FloatArray) -> FloatArray:
        """Return the surface speed of a bearing's journal at times [s], of their shape (n,) [m/s].

        Raises:
            KeyError: The scene has no speed of it.
        """
        channel = self.channel(bearing, 'speed')
        return self.value(channel.topic, time) * channel.speed_ratio(bearing)

    def load(self, bearing: str, time: FloatArray) -> FloatArray:
        """Return the load of a bearing at times [s], of their shape (n,) [N].

        Raises:
            KeyError: The scene has no load of it.
        """
        return self.value(self.channel(bearing, 'load').topic, time)

    def channel(self, bearing: str, quantity: str) -> Channel:
        """Return the channel of a quantity that serves a bearing.

        Raises:
            KeyError: The scene has none.
        """
        for channel in self._channels.values():
            if channel.quantity == quantity and channel.serves(bearing):
                return channel
        raise KeyError(f'{bearing}.{quantity}')


def _sum_terms(terms: Iterable[Term], time: FloatArray) -> FloatArray:
    """Return the sum of terms at times [s], of their shape; 0 without terms."""
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
    signals: dict[str, Signal]  # the sensor's samples by topic
    # Numbers that no sensor measures; a topic is in every block, even without messages.
    truth: list[Column] = field(default_factory=list)

    def instants(self, rate: float) -> FloatArray:
        """Return the regular instants of this block at a rate [Hz], shape (n,) [s].

        Those of all blocks together are ``k / rate`` from 0 to the scene's end, each once.
        """
        return np.array(instant_numbers(rate, self.start, self.end, self.duration)) / rate


MIN_GRID_RATE = 100.0
"""Least rate at which sensors and linings follow the shaft [Hz]: the ripple of blades reaches some 30 Hz."""


@dataclass(frozen=True, slots=True)
class Memory:
    """One transformation of a sensor's signal that depends on its past."""

    length: float  # time after which the past is negligible [s]
    scale: float  # time over which it resolves the past [s]
    # Function of the time between samples [s] and the value that was constant until now, to a function that
    # transforms the next samples, shape (n,), at each call.
    start: Callable[[float, float], Callable[[FloatArray], FloatArray]]


class Sensor:
    """A chain of memories, at least one, between the shaft and the samples of one channel.

    It follows the shaft between its samples, on a finer regular grid.
    """

    def __init__(self, shaft: Shaft, channel: Channel) -> None:
        self._shaft, self._channel = shaft, channel
        self.memories: list[Memory] = []
        self._chain: list[Callable[[FloatArray], FloatArray]] = []
        self._next = 0

    def read(self, numbers: range) -> FloatArray:
        """Return the readings at instants ``k / rate`` of the channel, shape (n,); the memories advance.

        The numbers ``k`` follow on those of the last call; an empty range gives an empty array.
        """
        if not numbers:
            return np.empty(0)
        shortest = min(memory.scale for memory in self.memories)  # 20 steps of the grid resolve it
        finer = math.ceil(max(MIN_GRID_RATE, 20.0 / shortest) / self._channel.rate)
        rate = self._channel.rate * finer
        if not self._chain:
            # The memories start so early that their initial state is negligible at the first sample.
            begin = numbers.start * finer - math.ceil(sum(memory.length for memory in self.memories) * rate)
            value = self._shaft.value(self._channel.topic, np.array([begin / rate]))
            self._chain = [memory.start(1.0 / rate, float(value[0])) for memory in self.memories]
            self._next = begin + 1
        start, self._next = self._next, numbers[-1] * finer + 1
        value = self._shaft.value(self._channel.topic, np.arange(start, self._next) / rate)
        for follow in self._chain:
            value = follow(value)
        return value[numbers.start * finer - start :: finer]
