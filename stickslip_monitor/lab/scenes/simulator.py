# SPDX-License-Identifier: Apache-2.0
"""Runs a scene, block by block: memory does not grow with its duration."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.errors import SceneError
from stickslip_monitor.lab.scenes import telemetry
from stickslip_monitor.lab.scenes.effects.registry import SceneRun
from stickslip_monitor.lab.scenes.scene import Scene
from stickslip_monitor.lab.scenes.shaft import TimeBlock
from stickslip_monitor.lab.scenes.telemetry import Channel, Signal

BLOCK_LENGTH = 60.0


def simulate(
    scene: Scene, block_length: float = BLOCK_LENGTH, run: SceneRun | None = None
) -> Iterator[TimeBlock]:
    """Run a scene.

    Speeds and loads start at zero (a shaft at rest, no load), and each effect adds its own. The
    outcome does not depend on the length of the blocks.

    Args:
        scene: The scene.
        block_length: Length of the blocks, > 0 [s].
        run: A fresh run of it; by default one is built.

    Yields:
        Its blocks, in order of time, up to its end or to where its recording is cut off.

    Raises:
        SceneError: A speed or load leaves what the telemetry can carry.
    """
    run = scene.build() if run is None else run
    finish = scene.duration if run.cut is None else run.cut.time
    last = math.ceil(finish / block_length) - 1
    for number in range(last + 1):
        start = number * block_length
        end = finish if number == last else (number + 1) * block_length
        signals = {c.topic: _measured(scene, run, c, start, end) for c in scene.channels}
        block = TimeBlock(start, end, scene.duration, run.shaft, signals)
        for effect in run.effects:
            effect.apply(block)
        yield block


def _measured(scene: Scene, run: SceneRun, channel: Channel, start: float, end: float) -> Signal:
    """What a channel's sensor makes of the shaft from ``start`` to before ``end``."""
    span = telemetry.numbers(channel.rate, start, end, scene.duration)
    numbers = np.array(span, np.int64)
    time = numbers / channel.rate
    stamp_ns = scene.start_ns + np.rint(numbers * (1e9 / channel.rate)).astype(np.int64)
    sensor = run.sensors.get(channel.topic)
    value = sensor.read(span) if sensor else run.shaft.value(channel.topic, time)
    _check_range(channel, time, value)
    return Signal(channel, time, stamp_ns, value, stamp_ns.copy() if channel.is_stamped else None)


def _check_range(channel: Channel, time: FloatArray, value: FloatArray) -> None:
    """Refuse an operating point that the monitor of one of its bearings would not believe."""
    for bearing in channel.bearings:
        size = np.abs(value) * channel.ratio(bearing.name)
        most = bearing.inputs[channel.quantity].maximum
        beyond = np.flatnonzero(size > most)
        if beyond.size:
            unit = 'm/s' if channel.quantity == 'speed' else 'N'
            raise SceneError(
                f'{channel.quantity} = {size[beyond[0]]:g} {unit} at {time[beyond[0]]:g} s is more'
                f' than topic {channel.topic} can carry: {bearing.name}.{channel.quantity}.maximum'
                f' = {most:g} {unit} in the configuration'
            )
