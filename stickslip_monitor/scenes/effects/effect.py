# SPDX-License-Identifier: Apache-2.0
"""What an effect is, and what it may know of its scene."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from stickslip_monitor.errors import SceneError
from stickslip_monitor.scenes.randomness import random_stream
from stickslip_monitor.scenes.settings import Settings
from stickslip_monitor.scenes.signals import Block, Channel


class Effect(Protocol):
    """One thing that happens in a scene."""

    def apply(self, block: Block) -> None:
        """Change the signals of the next block; blocks come in order of time, each once."""


@dataclass(frozen=True, slots=True)
class Frame:
    """What effects may know of their scene while they are built.

    Attributes:
        duration: The scene's duration [s].
        seed: The scene's seed.
        channels: Its channels.
    """

    duration: float
    seed: int
    channels: tuple[Channel, ...]
    _claimed: set[tuple[str, str]] = field(default_factory=set)

    def pick(self, settings: Settings, quantity: str) -> list[Channel]:
        """The channels of a quantity that an effect is for: of its ``bearing``, else of all.

        Args:
            settings: The effect's settings, named as the effect.
            quantity: ``'speed'`` or ``'load'``.

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

    def _of_bearing(self, settings: Settings) -> list[Channel]:
        if 'bearing' not in settings:
            return list(self.channels)
        names = dict.fromkeys(b.name for channel in self.channels for b in channel.bearings)
        asked = settings.choice('bearing', list(names))
        return [c for c in self.channels if asked in [b.name for b in c.bearings]]

    def random(self, settings: Settings, channel: Channel) -> np.random.Generator:
        """The random stream of an effect on a channel, its own whatever else the scene lists."""
        return random_stream(self.seed, settings.name, channel.topic)


Builder = Callable[[Settings, Frame], Effect]
