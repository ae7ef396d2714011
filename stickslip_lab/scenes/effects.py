# SPDX-License-Identifier: Apache-2.0
"""Declares what an effect of a scene is, and the run of a scene that effects are built into.

An effect is a function with a decorator that says at which stage it acts and which settings it
takes; its name is the function's. Within a stage effects act in the order of their definition.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from stickslip_lab.scenes.lining import FrictionCourse
from stickslip_lab.scenes.settings import Settings, random_stream
from stickslip_lab.scenes.telemetry import Channel, Memory, Sensor, Shaft, Signal, TimeBlock
from stickslip_logs.recordings.writer import STAMPED_FIELDS
from stickslip_monitor.errors import SceneError
from stickslip_monitor.monitor.parameters import LEVEL_UNITS, LOAD_UNITS, BearingConfig
from stickslip_monitor.monitor.sample_types import INPUTS, WATER
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

    def claim_channels(self, settings: Settings, quantity: str) -> Iterator[Channel]:
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

    def claim_bearings(self, settings: Settings, part: str = '') -> list[BearingConfig]:
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

    def make_random_stream(
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
                for channel in run.claim_channels(settings, quantity):
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
