# SPDX-License-Identifier: Apache-2.0
"""Make a bag from a scene file: the telemetry that a ship in that scene would record.

The same scene file always gives the same bag. Nothing is overwritten.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping

from rich.markup import escape

from stickslip_lab.scenes.scene import Scene, load_scene, write_bag
from stickslip_monitor.commands import options, output
from stickslip_monitor.errors import SceneError


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    options.add_file(parser, 'scene', metavar='SCENE', help='scene file')
    options.add_file(
        parser, '--sensors', metavar='FILE', help="a file of sensors, in place of the scene's own"
    )
    text = 'the bag to write: a rosbag2 folder, or one file if the name ends in .mcap'
    parser.add_argument('--output', '-o', required=True, metavar='BAG', help=text)


def run(args: argparse.Namespace) -> int:
    """Write the bag of a scene, with progress, and print a line on it; return 0.

    Raises:
        SceneError: The scene is invalid; the text names its file.
        ConfigurationError: The configuration it refers to cannot be read or breaks a rule.
        BagError: The bag exists already or cannot be written.
    """
    scene = load_scene(args.scene, sensors=args.sensors)
    with output.ProgressBar() as bar:
        try:
            written = write_bag(scene, args.output, lambda done: bar.show('simulating', done, scene.duration))
        except SceneError as error:
            raise SceneError(f'{args.scene}: {error}') from error
    output.console().print(escape(_summary_clause(args.output, scene, written)))
    return 0


def _summary_clause(path: str, scene: Scene, written: Mapping[str, int]) -> str:
    """Return a clause on the bag: path, length, cuts, and numbers of messages of telemetry and of truth.

    ``written`` has the number of messages by topic.
    """
    topics = [channel.topic for channel in scene.channels]
    telemetry = sum(written[topic] for topic in topics)
    cuts = [settings.value('time', '') for settings in scene.effects if settings.name == 'cut_off']
    text = f'{path}: {scene.duration:g} s, ' + ''.join(f'cut off at {cut:g} s, ' for cut in cuts)
    text += f'{telemetry} messages on {", ".join(topics)}'
    if truth := len(written) - len(topics):
        text += f', {sum(written.values()) - telemetry} on {truth} of the truth'
    return text
