# SPDX-License-Identifier: Apache-2.0
"""How an effect is declared, and the run of a scene that effects are built into.

An effect is a function with a decorator that says at which stage it acts and which settings it
takes; its name is the function's. Within a stage effects act in the order of their definition.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from stickslip_monitor.bags.encode import STAMPED_FIELDS
from stickslip_monitor.errors import SceneError
from stickslip_monitor.lab.scenes.lining import FrictionCourse
from stickslip_monitor.lab.scenes.settings import Settings, random_stream
from stickslip_monitor.lab.scenes.telemetry import Channel, Memory, Sensor, Shaft, Signal, TimeBlock
from stickslip_monitor.monitor.config import LEVEL_UNITS, LOAD_UNITS, BearingConfig
from stickslip_monitor.physics.bearing import SPEED_UNITS

# Beside the units of a configuration those that fit a scene to any bearing, see Channel.factor.
UNITS: Mapping[str, Sequence[str]] = {
    'speed': (*SPEED_UNITS, 'fold'),
    'load': (*LOAD_UNITS, 'nominal'),
    'level': LEVEL_UNITS,
}


@dataclass(slots=True)
class SceneRun:
    """One run of a scene: what effects may know of it while they are built, and what they add."""

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
        """Take an effect for a topic or a bearing, or for one part of it, once."""
        what = f"'{effect}' with {part}" if part else f"'{effect}'"
        if (what, place) in self._claimed:
            raise SceneError(f'effect {what} is listed twice{place}')
        self._claimed.add((what, place))

    def pick(self, settings: Settings, quantity: str) -> Iterator[Channel]:
        """The channels of a quantity that an effect is for: of its ``bearing``, else of all."""
        own = [b.name for b in self._asked(settings)]
        for channel in self.channels:
            if channel.quantity == quantity and any(map(channel.serves, own)):
                self.claim(settings.name, f' for topic {channel.topic}')
                yield channel

    def bearings(self, settings: Settings, part: str = '') -> list[BearingConfig]:
        """The bearings that an effect on the lining is for: its ``bearing``, else all.

        Where it may be listed once for each part of a bearing, ``part`` names it.
        """
        asked = self._asked(settings)
        for config in asked:
            self.claim(settings.name, f' for bearing {config.name}', part)
        return asked

    def _asked(self, settings: Settings) -> list[BearingConfig]:
        known = {b.name: b for channel in self.channels for b in channel.bearings}
        if 'bearing' not in settings:
            return list(known.values())
        return [known[settings.choice('bearing', list(known))]]

    def course(self, config: BearingConfig) -> FrictionCourse:
        """The friction of a bearing over time."""
        return self.courses.get(config.name, FrictionCourse(config.bearing.friction))

    def sense(self, channel: Channel, memory: Memory) -> None:
        """Give the sensor of a channel a memory, behind those it has already."""
        blank = Sensor(self.shaft, channel)
        self.sensors.setdefault(channel.topic, blank).memories.append(memory)

    def random(
        self, settings: Settings, channel: Channel | None = None, *purpose: str
    ) -> np.random.Generator:
        """The random stream of an effect, its own whatever else the scene lists.

        It is for a channel or for the whole ship; ``purpose`` separates several of one effect.
        """
        topic = () if channel is None else (channel.topic,)
        effect, _, _ = settings.name.partition('.')
        return random_stream(self.seed, effect, *topic, *purpose)


Change = Callable[[Signal], None]
"""Changes the signal of the next block."""
Builder = Callable[[Settings, SceneRun], None]
ChannelEffect = Callable[[Settings, Channel, SceneRun], Change | None]


@dataclass(frozen=True, slots=True)
class Effect:
    """What a scene file may ask for by a name."""

    stage: str  # when it acts: see ``scene.STAGES``
    keys: tuple[str, ...]  # the settings it takes
    build: Builder  # adds it to a run of a scene


DECLARED: dict[str, Effect] = {}
"""The effects of the modules that have been imported, by name."""


def effect(stage: str, *keys: str) -> Callable[[Builder], Builder]:
    """Declare an effect that sees to its channels or bearings itself."""

    def declare(function: Builder) -> Builder:
        DECLARED[function.__name__] = Effect(stage, keys, function)
        return function

    return declare


def channel_effect(
    stage: str, quantities: Sequence[str], *keys: str, section: str = ''
) -> Callable[[ChannelEffect], ChannelEffect]:
    """Declare an effect on each channel of some quantities of its ``bearing``, else of all.

    The function returns what changes the signal of each next block, if it is of that kind. With a
    ``section`` the keys are those of a section for each quantity, of which one is there at least;
    what is said of it stands in the sentence where it is wrong.
    """

    def declare(function: ChannelEffect) -> ChannelEffect:
        def build(settings: Settings, run: SceneRun) -> None:
            named = [q for q in quantities if not section or q in settings]
            if not named:
                raise SceneError(f'{settings.name} must name speed, load or both')
            for quantity in named:
                own = settings.section(quantity, keys, section) if section else settings
                for channel in run.pick(settings, quantity):
                    if change := function(own, channel, run):
                        run.effects.append(_on_signal(channel.topic, change))

        known = ('bearing', *(quantities if section else keys))
        DECLARED[function.__name__] = Effect(stage, known, build)
        return function

    return declare


def _on_signal(topic: str, change: Change) -> Callable[[TimeBlock], None]:
    return lambda block: change(block.signals[topic])


def unit_of(settings: Settings, channel: Channel) -> tuple[str, float]:
    """The ``unit`` of an effect's settings, and the SI value of one on a channel."""
    unit = settings.choice('unit', UNITS[channel.quantity])
    return unit, channel.factor(unit)


def require_header(channel: Channel, otherwise: str) -> None:
    """Refuse a channel whose messages have no time stamp, and say what could not be otherwise."""
    if not channel.is_stamped:
        known = ' or '.join(STAMPED_FIELDS)
        raise SceneError(
            f'topic {channel.topic} is {channel.input.type}, without a time stamp: {otherwise};'
            f' use {known} in the configuration'
        )
