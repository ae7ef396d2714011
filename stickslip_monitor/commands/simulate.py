# SPDX-License-Identifier: Apache-2.0
"""Make a bag from a scene file: the telemetry that a ship in that scene would record.

The same scene file always gives the same bag. Nothing is overwritten.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from rich.markup import escape

from stickslip_monitor.arrays import IntArray
from stickslip_monitor.bags.encode import (
    encode_bool,
    encode_float64s,
    encode_stamped,
    encode_string,
)
from stickslip_monitor.bags.values import Payload
from stickslip_monitor.bags.writer import BagWriter
from stickslip_monitor.commands.declared import add_input
from stickslip_monitor.commands.output import ProgressBar, console
from stickslip_monitor.errors import SceneError
from stickslip_monitor.lab.scenes.scene import Scene, load_scene, simulate
from stickslip_monitor.lab.scenes.telemetry import Signal
from stickslip_monitor.lab.truth import BOOL, FLOAT64, STRING

_ENCODERS: Mapping[str, Callable[[Any], Payload]] = {
    BOOL: lambda values: [encode_bool(value) for value in values],
    FLOAT64: encode_float64s,
    STRING: lambda values: [encode_string(value) for value in values],
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add_input(parser, 'scene', metavar='SCENE', help='scene file')
    text = 'the bag to write: a rosbag2 folder, or one file if the name ends in .mcap'
    parser.add_argument('--output', '-o', required=True, metavar='BAG', help=text)


def run(args: argparse.Namespace) -> int:
    """Run the command."""
    scene = load_scene(args.scene)
    with ProgressBar() as bar:
        try:
            written = write_bag(
                scene, args.output, lambda done: bar.show('simulating', done, scene.duration)
            )
        except SceneError as error:
            raise SceneError(f'{args.scene}: {error}') from error
    console().print(escape(_summary(args.output, scene, written)))
    return 0


def _summary(path: str, scene: Scene, written: Mapping[str, int]) -> str:
    """What was written, in one sentence."""
    topics = [channel.topic for channel in scene.channels]
    telemetry = sum(written[topic] for topic in topics)
    cuts = [settings.value('time', '') for settings in scene.effects if settings.name == 'cut_off']
    text = f'{path}: {scene.duration:g} s, ' + ''.join(f'cut off at {cut:g} s, ' for cut in cuts)
    text += f'{telemetry} messages on {", ".join(topics)}'
    if truth := len(written) - len(topics):
        text += f', {sum(written.values()) - telemetry} on {truth} of the truth'
    return text


def write_bag(
    scene: Scene, path: str | Path, progress: Callable[[float], None] | None = None
) -> dict[str, int]:
    """Write a scene's telemetry; the bag appears under its name when it is complete.

    The path is a rosbag2 folder, or one file if the name ends in ``.mcap``. Progress is told the
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


def _encoded(signal: Signal) -> tuple[IntArray, Payload]:
    """Log times and messages of a signal."""
    sent, source = signal.messages(), signal.channel.input
    if sent.stamp_ns is None:
        return sent.log_time_ns, encode_float64s(sent.raw)
    field = '.'.join(map(str, source.field))
    return sent.log_time_ns, encode_stamped(source.type, field, sent.stamp_ns, sent.raw)
