# SPDX-License-Identifier: Apache-2.0
"""A scene as the recording that a ship in it would make, and the truth beside it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from stickslip_monitor.arrays import IntArray
from stickslip_monitor.bags.encode import (
    encode_bool,
    encode_float64s,
    encode_stamped,
    encode_string,
)
from stickslip_monitor.bags.writer import BagWriter
from stickslip_monitor.lab.scenes.scene import Scene, simulate
from stickslip_monitor.lab.scenes.telemetry import Signal
from stickslip_monitor.lab.truth import BOOL, FLOAT64, STRING

_ENCODERS: Mapping[str, Callable[[Any], list[bytes]]] = {
    BOOL: lambda values: [encode_bool(value) for value in values],
    FLOAT64: encode_float64s,
    STRING: lambda values: [encode_string(value) for value in values],
}


def write_bag(
    scene: Scene, path: str | Path, progress: Callable[[float], None] | None = None
) -> dict[str, int]:
    """Write a scene's telemetry; the bag appears under its name when it is complete.

    The path is a rosbag2 folder, or one file if the name ends in ``.mcap``. Progress is given the
    seconds simulated so far after each block. The messages written are returned by topic.

    Raises:
        BagError: The bag exists already or cannot be written.
        SceneError: A speed or load leaves what the telemetry can carry.
    """
    run = scene.build()
    with BagWriter(path) as writer:
        for channel in scene.channels:
            writer.add_topic(channel.topic, channel.input.type)
        for block in simulate(scene, run=run):
            messages = {topic: _encoded(signal) for topic, signal in block.signals.items()}
            for column in block.truth:
                if block.start == 0.0:
                    writer.add_topic(column.topic, column.type)
                data = _ENCODERS[column.type](column.values)
                messages[column.topic] = (column.stamps(scene.start_ns), data)
            writer.write_columns((topic, *own) for topic, own in messages.items())
            if progress:
                progress(block.end)
        if run.cut is not None:
            writer.break_off()
        return writer.message_counts


def _encoded(signal: Signal) -> tuple[IntArray, list[bytes]]:
    """Log times and messages of a signal."""
    sent, source = signal.messages(), signal.channel.input
    if sent.stamp_ns is None:
        return sent.log_time_ns, encode_float64s(sent.raw)
    field = '.'.join(map(str, source.field))
    return sent.log_time_ns, encode_stamped(source.type, field, sent.stamp_ns, sent.raw)
