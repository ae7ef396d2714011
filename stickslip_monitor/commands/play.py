# SPDX-License-Identifier: Apache-2.0
"""Publish a bag to ROS 2 with its timing, and /clock: for where `ros2 bag play` is not installed.

Set use_sim_time in nodes that are to follow the bag's time.
"""

from __future__ import annotations

import argparse
import sys
from typing import TYPE_CHECKING

from stickslip_logs.recordings.reader import open_bag
from stickslip_logs.recordings.recording import Recording
from stickslip_monitor.commands import options, output
from stickslip_monitor.errors import BagError, RosError, missing_ros_error, plural
from stickslip_monitor.safe_files import printable

if TYPE_CHECKING:
    from stickslip_monitor.ros.player import Player


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    options.add_file(parser, 'bag', metavar='BAG', help='recording')
    text = 'playback speed (default 1)'
    options.add_number(parser, '--rate', 0, above=True, kind=float, default=1.0, help=text)
    options.add_number(parser, '--loop', 1, default=1, metavar='N', help='play it N times')
    text = 'wait up to SECONDS for a subscriber before starting'
    options.add_number(parser, '--wait', 0, kind=float, default=0.0, metavar='SECONDS', help=text)


def run(args: argparse.Namespace) -> int:
    """Publish a recording to ROS 2, as often as asked; return 0 when it has been played.

    Raises:
        BagError: It cannot be read, is a log of columns, or has no messages to play.
        RosError: ROS 2 is not there, none of the topics can be played, or a subscriber does not keep up.
    """
    bag = open_bag(args.bag)
    if bag.start_ns is None or bag.end_ns is None:
        raise BagError(f"bag '{args.bag}' has no messages to play")
    if all(topic.encoding == 'table' for topic in bag.topics.values()):
        raise BagError(
            f"log '{args.bag}' has columns and no messages: make a bag of it by stickslip check"
            ' with --config and --mcap, and play that'
        )
    try:
        from stickslip_monitor.ros.player import open_player
    except ImportError as error:
        raise missing_ros_error(error) from error
    types = {t.name: t.type for t in bag.topics.values() if t.encoding == 'cdr'}
    with open_player(types) as player:
        _play_recording(player, bag, args)
    return 0


def _play_recording(player: Player, bag: Recording, args: argparse.Namespace) -> None:
    """Publish a recording as often as asked; report on the error stream what is skipped, played or damaged.

    Raises:
        RosError: It has no topic that can be played, or a subscriber does not keep up.
        BagError: It cannot be read.
    """
    skipped = player.skipped | {
        t.name: f"its messages are '{t.encoding}', not CDR"
        for t in bag.topics.values()
        if t.encoding != 'cdr'
    }
    for topic, reason in skipped.items():
        _print_line(f'not played: {topic}: {reason}')
    if not set(bag.topics) - set(skipped):
        raise RosError(f"bag '{bag.path}' has no topic that can be played")
    if args.wait > 0.0 and not player.wait_for_subscribers(args.wait):
        _print_line('nobody listens yet; playing all the same')
    start, end = bag.start_ns or 0, bag.end_ns or 0
    with output.ProgressBar() as bar:
        for _ in range(args.loop):
            count = player.play(
                ((m.topic, m.log_time_ns, m.data) for m in bag.messages()),
                args.rate,
                lambda now: bar.show(str(bag.path), now - start, end - start),
            )
            bar.hide()
            _print_line(f'played {plural(count, "message")}')
    for text in (*(cut.text for cut in bag.cuts), *bag.warnings):
        _print_line(f'data: {text}')


def _print_line(text: str) -> None:
    """Print a line on the error stream, with control characters made harmless."""
    sys.stderr.write(f'{printable(text)}\n')
