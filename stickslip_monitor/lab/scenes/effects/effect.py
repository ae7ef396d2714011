# SPDX-License-Identifier: Apache-2.0
"""What an effect is at each stage, and the context in which it is built."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np

from stickslip_monitor.bags.encode import STAMPED_FIELDS
from stickslip_monitor.errors import SceneError
from stickslip_monitor.lab.scenes.cost import Stopwatch
from stickslip_monitor.lab.scenes.friction_course import FrictionCourse
from stickslip_monitor.lab.scenes.sensing import Memory, Sensor
from stickslip_monitor.lab.scenes.settings import Settings
from stickslip_monitor.lab.scenes.shaft import Shaft, SpeedTerm, Term, TimeBlock
from stickslip_monitor.lab.scenes.telemetry import Channel
from stickslip_monitor.lab.scenes.windows import random_stream
from stickslip_monitor.monitor.config import LEVEL_UNITS, LOAD_UNITS, BearingConfig
from stickslip_monitor.monitor.signals import INPUTS
from stickslip_monitor.physics.oscillator import SPEED_UNITS

# Beside the units of a configuration those that fit a scene to any bearing, see Channel.factor.
UNITS: Mapping[str, Sequence[str]] = {
    'speed': (*SPEED_UNITS, 'fold'),
    'load': (*LOAD_UNITS, 'nominal'),
    'level': LEVEL_UNITS,
}


@runtime_checkable
class Effect(Protocol):
    """An effect on what the sensors send and on what is recorded of it."""

    def apply(self, block: TimeBlock) -> None:
        """Change the signals of the next block; blocks come in order of time, each once."""


@dataclass(frozen=True, slots=True)
class RecordingCut:
    """The end of a recorder in mid-write, at a time since the scene's start [s]."""

    time: float


@dataclass(frozen=True, slots=True)
class BuildContext:
    """What effects may know of their scene while they are built.

    Attributes:
        duration: The scene's duration [s].
        seed: The scene's seed.
        channels: Its channels.
        shaft: Speed and load, with what the effects of earlier stages add to them.
        sensors: By topic, the sensors with a memory.
        folder: The folder of the scene file, from which the paths in it count.
        start_ns: Time stamp of the scene's start [ns since 1970].
        courses: By bearing, the friction that moves in time.
        stopwatch: Times the effects; None: nobody asks for it.
    """

    duration: float
    seed: int
    channels: tuple[Channel, ...]
    shaft: Shaft
    folder: Path = Path()
    start_ns: int = 0
    courses: dict[str, FrictionCourse] = field(default_factory=dict)
    sensors: dict[str, Sensor] = field(default_factory=dict)
    stopwatch: Stopwatch | None = None
    _names: list[str] = field(default_factory=list)
    _claimed: set[tuple[str, str]] = field(default_factory=set)

    def pick(self, settings: Settings, quantity: str) -> list[Channel]:
        """The channels of a quantity that an effect is for: of its ``bearing``, else of all.

        Args:
            settings: The effect's settings, named as the effect.
            quantity: ``'speed'``, ``'load'`` or ``'level'``.

        Raises:
            SceneError: There is no such bearing, or the effect is listed twice for a channel.
        """
        picked = [
            channel for channel in self._of_bearing(settings) if channel.quantity == quantity
        ]
        for channel in picked:
            if (settings.name, channel.topic) in self._claimed:
                raise SceneError(
                    f"effect '{settings.name}' is listed twice for topic {channel.topic}"
                )
            self._claimed.add((settings.name, channel.topic))
        return picked

    def once(self, settings: Settings) -> None:
        """Refuse to list an effect twice that is for the whole scene.

        Raises:
            SceneError: It is.
        """
        if (settings.name, '') in self._claimed:
            raise SceneError(f"effect '{settings.name}' is listed twice")
        self._claimed.add((settings.name, ''))

    def sensors_of(
        self, settings: Settings, keys: Sequence[str], what: str
    ) -> Iterator[tuple[Channel, Settings]]:
        """The channels an effect on sensors is for, each with its settings.

        Args:
            settings: The effect's settings, which has a section for speed, for load or for both.
            keys: The keys of such a section.
            what: What it says, for the sentence where it is wrong.

        Raises:
            SceneError: There is neither section, or :meth:`pick` refuses.
        """
        named = [quantity for quantity in INPUTS if quantity in settings]
        if not named:
            raise SceneError(f'{settings.name} must name speed, load or both')
        for quantity in named:
            own = settings.section(quantity, keys, what)
            for channel in self.pick(settings, quantity):
                yield channel, own

    def bearings(self, settings: Settings, part: str = '') -> list[BearingConfig]:
        """The bearings that an effect on the lining is for: its ``bearing``, else all.

        Args:
            settings: The effect's settings, named as the effect.
            part: What of the bearing it is for, where it may be listed once for each part.

        Raises:
            SceneError: There is no such bearing, or the effect is listed twice for one.
        """
        picked = {b.name: b for channel in self._of_bearing(settings) for b in channel.bearings}
        if 'bearing' in settings:
            picked = {
                name: b for name, b in picked.items() if name == settings.value('bearing', '')
            }
        for name in picked:
            claim = (f'{settings.name} {part}'.rstrip(), name)
            if claim in self._claimed:
                what = f' with {part}' if part else ''
                raise SceneError(
                    f"effect '{settings.name}'{what} is listed twice for bearing {name}"
                )
            self._claimed.add(claim)
        return list(picked.values())

    def course(self, config: BearingConfig) -> FrictionCourse:
        """The friction of a bearing over time."""
        return self.courses.get(config.name, FrictionCourse(config.bearing.friction))

    def _of_bearing(self, settings: Settings) -> list[Channel]:
        if 'bearing' not in settings:
            return list(self.channels)
        names = dict.fromkeys(b.name for channel in self.channels for b in channel.bearings)
        asked = settings.choice('bearing', list(names))
        return [c for c in self.channels if asked in [b.name for b in c.bearings]]

    def add_speed(self, channel: Channel, term: SpeedTerm) -> None:
        """Add to the speed of a channel."""
        self.shaft.add_speed(channel.topic, self._watched(term))

    def add_load(self, channel: Channel, term: Term) -> None:
        """Add to the load of a channel."""
        self.shaft.add_load(channel.topic, self._watched(term))

    def add_ripple(self, channel: Channel, term: Term) -> None:
        """Add to a channel what follows from the turning of the shaft and does not turn it."""
        self.shaft.add_ripple(channel.topic, self._watched(term))

    def sense(self, channel: Channel, memory: Memory) -> None:
        """Give the sensor of a channel a memory, behind those it has already."""
        blank = Sensor(self.shaft, channel)
        self.sensors.setdefault(channel.topic, blank).memories.append(self._watched(memory))

    def build(
        self, name: str, builder: Builder, settings: Settings
    ) -> Effect | RecordingCut | None:
        """Build one effect."""
        if self.stopwatch is None:
            return builder(settings, self)
        self._names.append(name)
        effect = builder(settings, self)
        return self._watched(effect) if isinstance(effect, Effect) else effect

    def _watched(self, thing: Any) -> Any:
        """What the effect that is being built has made, timed if anybody asks."""
        return self.stopwatch.watch(self._names[-1], thing) if self.stopwatch else thing

    def random(
        self, settings: Settings, channel: Channel | None = None, *purpose: str
    ) -> np.random.Generator:
        """The random stream of an effect, its own whatever else the scene lists.

        Args:
            settings: The effect's settings, named as the effect.
            channel: The channel it is for; None where it is one for the whole ship.
            purpose: What it is for, where an effect needs several.
        """
        topic = () if channel is None else (channel.topic,)
        return random_stream(self.seed, settings.name, *topic, *purpose)


def require_header(channel: Channel, otherwise: str) -> None:
    """Refuse a channel whose messages have no time stamp of their own.

    Raises:
        SceneError: They have none; the sentence says what cannot be ``otherwise``.
    """
    if not channel.is_stamped:
        known = ' or '.join(STAMPED_FIELDS)
        raise SceneError(
            f'topic {channel.topic} is {channel.input.type}, without a time stamp: {otherwise};'
            f' use {known} in the configuration'
        )


# None where the shaft or the sensors of the context have got all there is of the effect.
SENSOR_KEYS = ('bearing', *INPUTS)
"""Settings of an effect that is told for each quantity."""
Builder = Callable[[Settings, BuildContext], Effect | RecordingCut | None]


@dataclass(frozen=True, slots=True)
class EffectKind:
    """What a scene file may ask for by a name.

    Attributes:
        keys: The settings it takes.
        build: Builds it for one run of a scene; what acts through the shaft returns ``None``.
    """

    keys: tuple[str, ...]
    build: Builder
