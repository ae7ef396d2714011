# SPDX-License-Identifier: Apache-2.0
"""Runs a scene, block by block: memory does not grow with its duration."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from .scene import Scene
from .signals import Block, Channel, Signal

BLOCK_LENGTH = 60.0


def simulate(scene: Scene, block_length: float = BLOCK_LENGTH) -> Iterator[Block]:
    """Run a scene.

    Signals start at zero (a shaft at rest, no load), and each effect adds its own. The outcome
    does not depend on the length of the blocks.

    Args:
        scene: The scene.
        block_length: Length of the blocks, > 0 [s].

    Yields:
        Its blocks, in order of time.
    """
    effects = scene.build_effects()
    last = math.ceil(scene.duration / block_length) - 1
    for number in range(last + 1):
        start = number * block_length
        end = scene.duration if number == last else (number + 1) * block_length
        signals = {c.topic: _blank(scene, c, start, end) for c in scene.channels}
        block = Block(start, end, signals)
        for effect in effects:
            effect.apply(block)
        yield block


def _blank(scene: Scene, channel: Channel, start: float, end: float) -> Signal:
    """The instants of a channel from ``start`` to before ``end``, to the scene's end inclusive."""
    at_end = end == scene.duration
    stop = channel.count(scene.duration) if at_end else math.ceil(end * channel.rate)
    numbers = np.arange(math.ceil(start * channel.rate), stop)
    since_start_ns = np.rint(numbers * (1e9 / channel.rate)).astype(np.int64)
    time = numbers / channel.rate
    return Signal(channel, time, scene.start_ns + since_start_ns, np.zeros(numbers.size))
