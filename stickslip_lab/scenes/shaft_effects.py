# SPDX-License-Identifier: Apache-2.0
"""Declares effects on speed and load; also how every effect is declared, and the run it is built into.

An effect is a function with a decorator that says at which stage it acts and which settings it
takes; its name is the function's. Within a stage effects act in the order of their definition.

The sea has the JONSWAP spectrum (Hasselmann et al. 1973; DNV-RP-C205, 3.5.5): with
``x = omega / omega_p``,

    S ~ x^-5 exp(-1.25 x^-4) gamma^exp(-(x - 1)^2 / (2 s^2)),   s = 0.07 for x <= 1, else 0.09

scaled to the variance ``Hs^2/16``. It is a sum of cosines of equal amplitude, each for an equal
part of that variance, at a random frequency within its part and with a random phase. So most of
them are where the sea has most energy, and the record does not repeat.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from stickslip_lab.scenes.lining import FrictionCourse
from stickslip_lab.scenes.settings import (
    Profile,
    Settings,
    check_times,
    random_stream,
    read_profile,
    read_steps,
    suggestion,
)
from stickslip_lab.scenes.telemetry import Channel, Memory, Sensor, Shaft, Signal, TimeBlock
from stickslip_logs.recordings.writer import STAMPED_FIELDS
from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.errors import SceneError
from stickslip_monitor.monitor.parameters import LEVEL_UNITS, LOAD_UNITS, BearingConfig
from stickslip_monitor.monitor.sample_types import INPUTS, WATER
from stickslip_monitor.monitor.value_check import refused
from stickslip_monitor.physics.bearing import SPEED_UNITS

# Beside the units of a configuration those that fit a scene to any bearing, see Channel.factor.
UNITS: Mapping[str, Sequence[str]] = {
    'speed': (*SPEED_UNITS, 'fold'),
    'load': (*LOAD_UNITS, 'nominal'),
    'level': LEVEL_UNITS,
    INPUTS[WATER]: ('C',),
}


@dataclass(slots=True)
class SceneRun:
    """One run of a scene: the data that effects are built from, and what they add to it."""

    duration: float  # the scene's duration [s]
    seed: int
    channels: tuple[Channel, ...]
    folder: Path  # the folder of the scene file, from which the paths in it count
    start_ns: int  # time stamp of the scene's start [ns since 1970]
    shaft: Shaft  # speed and load, with what the effects add to them
    # By bearing, the friction that moves in time.
    courses: dict[str, FrictionCourse] = field(default_factory=dict)
    sensors: dict[str, Sensor] = field(default_factory=dict)  # by topic, the sensors with a memory
    # What changes the signals block after block; blocks come in order, each once.
    effects: list[Callable[[TimeBlock], None]] = field(default_factory=list)
    cut: float | None = None  # when the recorder ends in mid-write [s]; None: it does not
    _claimed: set[tuple[str, str]] = field(default_factory=set)

    def claim(self, effect: str, place: str = '', part: str = '') -> None:
        """Note that an effect acts on a topic, a bearing or a part of one.

        Args:
            effect: Name of the effect.
            place: Topic or bearing that it acts on, as the end of the error: ' for topic /x'; '' for the
                scene.
            part: The part of it, if the effect may be listed once for each.

        Raises:
            SceneError: The effect is listed twice for it.
        """
        owner = f"'{effect}' with {part}" if part else f"'{effect}'"
        if (owner, place) in self._claimed:
            raise SceneError(f'effect {owner} is listed twice{place}')
        self._claimed.add((owner, place))

    def pick(self, settings: Settings, quantity: str) -> Iterator[Channel]:
        """Yield the channels of a quantity that serve an effect's ``bearing``, else all of the quantity.

        Each is claimed when it is yielded.

        Raises:
            SceneError: A channel is claimed twice by one effect, or the scene has no such bearing.
        """
        names = [b.name for b in self._named_bearings(settings)]
        for channel in self.channels:
            if channel.quantity == quantity and any(map(channel.serves, names)):
                self.claim(settings.name, f' for topic {channel.topic}')
                yield channel

    def bearings(self, settings: Settings, part: str = '') -> list[BearingConfig]:
        """Return the ``bearing`` that an effect on the lining is for, else all bearings; claim each.

        Where an effect may be listed once for each part of a bearing, ``part`` names it.

        Raises:
            SceneError: A bearing is claimed twice by one effect and part, or the scene has no such bearing.
        """
        named = self._named_bearings(settings)
        for config in named:
            self.claim(settings.name, f' for bearing {config.name}', part)
        return named

    def _named_bearings(self, settings: Settings) -> list[BearingConfig]:
        """Return the ``bearing`` of an effect's settings in a list, else all of the scene; claim nothing.

        Raises:
            SceneError: The scene has no such bearing.
        """
        bearings = {b.name: b for channel in self.channels for b in channel.bearings}
        if 'bearing' not in settings:
            return list(bearings.values())
        return [bearings[settings.choice('bearing', list(bearings))]]

    def course(self, config: BearingConfig) -> FrictionCourse:
        """Return the friction of a bearing over time, from :attr:`courses`.

        Without drift or water it is a new one that never moves, and is not stored.
        """
        return self.courses.get(config.name, FrictionCourse(config.bearing.friction))

    def add_memory(self, channel: Channel, memory: Memory) -> None:
        """Add a memory to the sensor of a channel, behind those it has; the first one creates the sensor."""
        blank = Sensor(self.shaft, channel)
        self.sensors.setdefault(channel.topic, blank).memories.append(memory)

    def random(
        self, settings: Settings, channel: Channel | None = None, *purpose: str
    ) -> np.random.Generator:
        """Return a new random stream of an effect, which depends on the seed and these names alone.

        It is the same whatever else the scene lists.

        Args:
            settings: Settings of the effect; of a section's name what stands before its first point counts.
            channel: The channel that it is for; ``None`` for the whole ship.
            purpose: Names that tell several streams of one effect apart.
        """
        topic = () if channel is None else (channel.topic,)
        effect, _, _ = settings.name.partition('.')
        return random_stream(self.seed, effect, *topic, *purpose)


Change = Callable[[Signal], None]
"""Changes in place the signal of the next block; blocks come in order, each once."""
Builder = Callable[[Settings, SceneRun], None]
ChannelEffect = Callable[[Settings, Channel, SceneRun], Change | None]


@dataclass(frozen=True, slots=True)
class Effect:
    """Effect that a scene file may ask for by a name."""

    stage: str  # when it acts: see ``scene.STAGES``
    keys: tuple[str, ...]  # the settings it takes
    build: Builder  # adds it to a run of a scene


DECLARED: dict[str, Effect] = {}
"""The effects of the modules that have been imported, by name."""


def effect(stage: str, *keys: str) -> Callable[[Builder], Builder]:
    """Return a decorator that declares an effect, which finds its channels or bearings itself.

    It adds the function to :data:`DECLARED` under the function's name and returns it unchanged.

    Args:
        stage: Stage at which it acts.
        keys: Settings that it takes.
    """

    def declare(function: Builder) -> Builder:
        DECLARED[function.__name__] = Effect(stage, keys, function)
        return function

    return declare


def channel_effect(
    stage: str, quantities: Sequence[str], *keys: str, section: str = ''
) -> Callable[[ChannelEffect], ChannelEffect]:
    """Return a decorator that declares an effect on each channel of some quantities, as :func:`effect`.

    The channels are those of its ``bearing``, or of all bearings, and are claimed. The decorated function is
    called once for each, with settings, channel and run. It returns a function that changes the signal of
    each block in place, or ``None`` if the effect has added itself to the run.

    Args:
        stage: Stage at which it acts.
        quantities: Quantities of the channels.
        keys: Settings of the effect, or of each section.
        section: Meaning of a section, for errors. If given, the settings have a section for each
            quantity, at least one of which must be present.
    """

    def declare(function: ChannelEffect) -> ChannelEffect:
        """Register the effect under the function's name and return the function unchanged."""

        def build(settings: Settings, run: SceneRun) -> None:
            """Claim the channels and add to the run the change of each.

            Raises:
                SceneError: No quantity is named, a channel is claimed twice, or a setting breaks its rule.
            """
            named = [q for q in quantities if not section or q in settings]
            if not named:
                raise SceneError(f'{settings.name} must name at least one of {", ".join(quantities)}')
            for quantity in named:
                part = settings.section(quantity, keys, section) if section else settings
                for channel in run.pick(settings, quantity):
                    if change := function(part, channel, run):
                        run.effects.append(_on_signal(channel.topic, change))

        allowed = ('bearing', *(quantities if section else keys))
        DECLARED[function.__name__] = Effect(stage, allowed, build)
        return function

    return declare


def _on_signal(topic: str, change: Change) -> Callable[[TimeBlock], None]:
    """Return a function that applies a change to a topic's signal in a block."""
    return lambda block: change(block.signals[topic])


def read_unit(settings: Settings, channel: Channel) -> tuple[str, float]:
    """Return the ``unit`` of an effect's settings, and the SI value of one of it on a channel.

    Raises:
        SceneError: The unit is missing, is not one of the quantity, or has no meaning on this channel.
    """
    unit = settings.choice('unit', UNITS[channel.quantity])
    return unit, channel.factor(unit)


def require_header(channel: Channel, otherwise: str) -> None:
    """Raise SceneError if a channel's messages have no time stamp; ``otherwise`` says what that prevents."""
    if not channel.is_stamped:
        fields = ' or '.join(STAMPED_FIELDS)
        raise SceneError(
            f'topic {channel.topic} is {channel.input.type}, without a time stamp: {otherwise};'
            f' use {fields} in the configuration'
        )


# Exponential and cosine with the same bits on every machine: the last bits of numpy's depend on
# the processor's vector instructions, and a scene must give the same recording everywhere. These
# use only additions, multiplications and scaling by powers of two, which IEEE 754 rounds in one
# way and numpy does not fuse.

# exp(r) for |r| <= ln(2)/2, and cos(x) in powers of x^2 for |x| <= pi/2: Taylor's series, until
# the next term is below half a unit in the last place.
_EXP = [1.0 / math.factorial(k) for k in range(14)]
_COS = [(-1.0) ** k / math.factorial(2 * k) for k in range(11)]
# ln(2) in two parts; the first has so few digits that its multiples are exact.
_LN2_HIGH, _LN2_LOW = float.fromhex('0x1.62e42feep-1'), float.fromhex('0x1.a39ef35793c76p-33')


def exp(x: FloatArray) -> FloatArray:
    """Compute ``e^x`` of numbers up to 700, of any shape, with the same bits on every machine.

    Below -700 the result is ``e^-700``.
    """
    x = np.maximum(x, -700.0)
    twos = np.rint(x * (1.0 / math.log(2.0)))
    rest = (x - twos * _LN2_HIGH) - twos * _LN2_LOW
    return np.ldexp(_evaluate_polynomial(_EXP, rest), twos.astype(np.int32))


def cos_turns(turns: FloatArray) -> FloatArray:
    """Compute ``cos(2 pi x)`` of numbers of turns, of any shape, with the same bits on every machine."""
    away = np.abs(turns - np.rint(turns))
    folded = np.minimum(away, 0.5 - away)
    angle = (2.0 * math.pi) * np.abs(folded)
    return np.where(away > 0.25, -1.0, 1.0) * _evaluate_polynomial(_COS, angle * angle)


def _evaluate_polynomial(coefficients: list[float], x: FloatArray) -> FloatArray:
    """Evaluate a polynomial at places of any shape by Horner's rule; the lowest power comes first."""
    total = np.full_like(x, coefficients[-1])
    for coefficient in reversed(coefficients[:-1]):
        np.multiply(total, x, out=total)
        np.add(total, coefficient, out=total)
    return total


def _add_course(channel: Channel, run: SceneRun, course: Profile | Response, factor: float) -> None:
    """Add a course to the shaft of the run, on a channel; of a speed add its integral, which turns the shaft.

    Args:
        channel: The channel.
        run: The run of the scene, whose shaft changes.
        course: Values over the time.
        factor: SI value of one of them.
    """

    def way(time: FloatArray) -> FloatArray:
        return course.integral(time) * factor

    turns = way if channel.quantity == 'speed' else None
    run.shaft.add(channel.topic, lambda time: course.at(time) * factor, turns)


def _add_profile(settings: Settings, channel: Channel, run: SceneRun) -> None:
    """Add the ``points`` or the ``table`` of an effect to the shaft on a channel.

    Raises:
        SceneError: A setting is missing or breaks its rule.
    """
    unit, factor = read_unit(settings, channel)
    _add_course(channel, run, read_profile(settings, unit, run.duration, run.folder), factor)


def _add_steps(settings: Settings, channel: Channel, run: SceneRun) -> None:
    """Add the ``steps`` of an effect to the shaft on a channel.

    Raises:
        SceneError: A setting is missing or breaks its rule.
    """
    unit, factor = read_unit(settings, channel)
    _add_course(channel, run, read_steps(settings, unit, run.duration), factor)


@channel_effect('shaft', ['speed'], 'unit', 'points', 'table')
def speed_profile(settings: Settings, channel: Channel, run: SceneRun) -> None:
    """Add a profile over time to the speed in ``run.shaft``, and its integral to the turns of the shaft.

    Raises:
        SceneError: A setting is missing or breaks its rule.
    """
    _add_profile(settings, channel, run)


@channel_effect('shaft', ['speed'], 'unit', 'steps', 'rise')
def speed_steps(settings: Settings, channel: Channel, run: SceneRun) -> None:
    """Add steps over time to the speed in ``run.shaft``, and their integral to the turns of the shaft.

    Raises:
        SceneError: A setting is missing or breaks its rule.
    """
    _add_steps(settings, channel, run)


STEPS = ('dead slow', 'slow', 'half', 'full')
"""Steps of the engine telegraph, ahead or astern, by rising speed."""


@channel_effect('shaft', ['speed'], 'unit', 'ahead', 'astern', 'orders', 'time_constant')
def manoeuvre(settings: Settings, channel: Channel, run: SceneRun) -> None:
    """Add the response to telegraph orders to the shaft's speed in ``run.shaft``, and turn the shaft by it.

    Raises:
        SceneError: A setting is missing or breaks its rule, or an order has no speed.
    """
    unit, factor = read_unit(settings, channel)
    time_constant = settings.number('time_constant', 's', above=0.0)
    times, targets = _read_orders(settings, _telegraph_speeds(settings, unit), run.duration)
    _add_course(channel, run, Response.to(times, targets * factor, time_constant), 1.0)


def _telegraph_speeds(settings: Settings, unit: str) -> dict[str, float]:
    """Return the speed of each order of the scene by name, as 'slow ahead': negative astern, 0 for 'stop'.

    Args:
        settings: Settings with the sections ``ahead`` and ``astern``, each of which may be missing.
        unit: Unit of the numbers, also of the result.

    Raises:
        SceneError: A speed does not exceed that of the step below it.
    """
    speeds = {'stop': 0.0}
    for way, sign in (('ahead', 1.0), ('astern', -1.0)):
        if way in settings:
            table = settings.section(way, STEPS, 'the speed of each step of the telegraph')
            previous = 0.0
            for step in (step for step in STEPS if step in table):
                previous = table.number(step, unit, above=previous)
                speeds[f'{step} {way}'] = sign * previous
    return speeds


def _read_orders(
    settings: Settings, speeds: dict[str, float], duration: float
) -> tuple[FloatArray, FloatArray]:
    """Return the times of the orders [s] and the speeds ordered, both of shape (n,).

    Args:
        settings: Settings with the list ``orders``.
        speeds: Speed of each order by name; the result has its unit.
        duration: Duration of the scene [s].

    Raises:
        SceneError: An order is unknown, or the times do not rise within the scene.
    """
    rows = settings.rows('orders', 'order', 'a list of orders [time in s, order]')
    for name, order in rows:
        if not isinstance(order, list) or len(order) != 2:
            raise refused(name, order, "a pair, [time in s, 'slow ahead']", SceneError)
        if not isinstance(order[1], str) or order[1] not in speeds:
            hint = suggestion(order[1], list(speeds))
            raise SceneError(f'{name} is {order[1]!r}, which has no speed in this scene; {hint}')
    check_times([(name, time) for name, (time, _) in rows], duration)
    times, orders = zip(*(order for _, order in rows), strict=True)
    return np.array(times, float), np.array([speeds[order] for order in orders])


@dataclass(frozen=True, slots=True, eq=False)
class Response:
    """Response to targets: ``dV/dt = (target - V) / time_constant``."""

    times: FloatArray  # when each target is set, rising, shape (n,) [s]
    targets: FloatArray  # the targets; the first is held before it is set, shape (n,)
    values: FloatArray  # the value when each is set, shape (n,)
    integrals: FloatArray  # the integral from 0 until then, shape (n,)
    time_constant: float  # the lag [s]

    @classmethod
    def to(cls, times: FloatArray, targets: FloatArray, time_constant: float) -> Response:
        """Make the response to targets, which begins settled on the first of them.

        Args:
            times: When each target is set, rising, shape (n,) [s].
            targets: Shape (n,).
            time_constant: The lag, > 0 [s].
        """
        values, integrals = targets.copy(), times * targets
        response = cls(times, targets, values, integrals, time_constant)
        for k in range(1, times.size):
            before = response._evaluate_piece(times[k : k + 1], k - 1)
            values[k], integrals[k] = before[0][0], before[1][0]
        return response

    def at(self, time: FloatArray) -> FloatArray:
        """Return the values at times [s], of their shape (n,); the first target before it is set."""
        return self._evaluate_piece(time, self._last_change(time))[0]

    def integral(self, time: FloatArray) -> FloatArray:
        """Return the integral of the values from 0 to times [s], of their shape (n,)."""
        return self._evaluate_piece(time, self._last_change(time))[1]

    def _last_change(self, time: FloatArray) -> Any:
        """Return the index of the last target set by times [s], of their shape; 0 before the first."""
        return np.maximum(np.searchsorted(self.times, time, side='right') - 1, 0)

    def _evaluate_piece(self, time: FloatArray, k: Any) -> tuple[FloatArray, FloatArray]:
        """Return value and integral from 0 at times [s], each of their shape, after the k-th target was set.

        Args:
            time: Times [s].
            k: Index of the last target that was set, a number or one for each time.
        """
        since, off = time - self.times[k], self.values[k] - self.targets[k]
        # Before the first target there is nothing off.
        left = exp(-np.maximum(since, 0.0) / self.time_constant)
        integral = self.targets[k] * since + off * (self.time_constant * (1.0 - left))
        return self.targets[k] + off * left, self.integrals[k] + integral


@channel_effect('shaft', ['load'], 'unit', 'points', 'table')
def load_profile(settings: Settings, channel: Channel, run: SceneRun) -> None:
    """Add a profile over time to the load in ``run.shaft``.

    Raises:
        SceneError: A setting is missing or breaks its rule.
    """
    _add_profile(settings, channel, run)


@channel_effect('shaft', ['load'], 'unit', 'steps', 'rise')
def load_steps(settings: Settings, channel: Channel, run: SceneRun) -> None:
    """Add steps over time to the load in ``run.shaft``.

    Raises:
        SceneError: A setting is missing or breaks its rule.
    """
    _add_steps(settings, channel, run)


COMPONENTS = 200
"""Number of cosines of a sea."""
# Frequencies over that of the peak: beyond five of them lies 0.2 % of the variance.
_RANGE = np.linspace(0.25, 5.0, 20_000)


@channel_effect('shaft', ['load'], 'unit', 'significant_height', 'peak_period', 'gamma', 'load_per_metre')
def load_in_waves(settings: Settings, channel: Channel, run: SceneRun) -> None:
    """Add the load of a sea to ``run.shaft`` on a channel; all bearings have the same waves.

    Raises:
        SceneError: A setting is missing or breaks its rule.
    """
    unit, factor = read_unit(settings, channel)
    per_metre = settings.number('load_per_metre', f'{unit}/m') * factor
    sea = Sea.of(
        settings.number('significant_height', 'm', minimum=0.0),
        settings.number('peak_period', 's', minimum=0.1),  # shorter waves are ripples
        settings.number('gamma', '-', minimum=1.0, maximum=10.0),
        run.random(settings),
    )
    run.shaft.add(channel.topic, lambda time: sea.elevation(time) * per_metre)


@dataclass(frozen=True, slots=True, eq=False)
class Sea:
    """Elevation of a sea's surface over the time, a sum of cosines."""

    amplitude: float  # amplitude of each [m]
    frequency: FloatArray  # frequencies, shape (n,) [Hz]
    phase: FloatArray  # phases at the scene's start, shape (n,) [turns]

    @classmethod
    def of(cls, height: float, period: float, gamma: float, random: np.random.Generator) -> Sea:
        """Draw a sea of :data:`COMPONENTS` cosines by the JONSWAP spectrum; the random stream advances.

        Args:
            height: Significant height [m].
            period: Period of the peak [s].
            gamma: Peakedness, from 1 [-].
            random: The stream.
        """
        part = (np.arange(COMPONENTS) + random.random(COMPONENTS)) / COMPONENTS
        frequency = np.interp(part, _energy_below(gamma), _RANGE) / period
        phase = random.random(COMPONENTS)
        return cls(height / 4.0 * math.sqrt(2.0 / COMPONENTS), frequency, phase)

    def elevation(self, time: FloatArray) -> FloatArray:
        """Return the elevation at some times [s], shape (n,) [m]; waves are added in one order."""
        total = np.zeros_like(time)
        for frequency, phase in zip(self.frequency, self.phase, strict=True):
            total += cos_turns(frequency * time + phase)
        return total * self.amplitude


def _energy_below(gamma: float) -> FloatArray:
    """Return the share of a sea's variance below each frequency of ``_RANGE``, from 0 to 1, shape (n,).

    ``gamma`` is the peakedness, from 1 [-].
    """
    x = _RANGE
    width = np.where(x <= 1.0, 0.07, 0.09)
    peak = exp(math.log(gamma) * exp(-(((x - 1.0) / width) ** 2) / 2.0))
    square = x * x
    density = exp(-1.25 / (square * square)) * peak / (square * square * x)
    below = np.concatenate([[0.0], np.cumsum(density[1:] + density[:-1])])
    return below / below[-1]


@channel_effect('turning', ['speed'], 'blades', 'amplitude')
def blade_ripple(settings: Settings, channel: Channel, run: SceneRun) -> None:
    """Add ripple at the rate of the blades to the speed in ``run.shaft``; its amplitude is a share of that.

    It follows from the turning of the shaft, and does not turn it.

    Raises:
        SceneError: A setting is missing or breaks its rule.
    """
    blades = settings.whole('blades', 'the number of blades', 1, 20)
    amplitude = settings.number('amplitude', '-', minimum=0.0, maximum=1.0)
    shaft, bearing = run.shaft, channel.bearings[0].name

    def ripple(time: FloatArray) -> FloatArray:
        """Return the ripple [m/s] at times [s], of their shape (n,)."""
        turns = shaft.turns(bearing, time)
        return shaft.mean(channel.topic, time) * (amplitude * cos_turns(blades * turns))

    shaft.add_ripple(channel.topic, ripple)


@channel_effect('turning', ['load'], 'amplitude', 'unit')
def misalignment(settings: Settings, channel: Channel, run: SceneRun) -> None:
    """Add ripple to the load, of the channel in ``run.shaft``, with one period in each turn of the shaft.

    Raises:
        SceneError: A setting is missing or breaks its rule.
    """
    unit, factor = read_unit(settings, channel)
    amplitude = settings.number('amplitude', unit, minimum=0.0) * factor
    shaft, bearing = run.shaft, channel.bearings[0].name
    shaft.add_ripple(channel.topic, lambda time: amplitude * cos_turns(shaft.turns(bearing, time)))
