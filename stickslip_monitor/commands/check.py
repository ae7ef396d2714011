# SPDX-License-Identifier: Apache-2.0
"""Run the monitor over recorded bags: events, time in each regime, worst margins, bad data.

A bag is a rosbag2 folder or an .mcap file; a folder of bags stands for all of them, and - for a
recording in MCAP on standard input. What was cut off is read up to the cut. With --report
everything is also written into one file that opens anywhere, without a network: .html to be read,
.png to be shown, .json for programs. With --mcap the verdicts are written as messages beside the
inputs, for replay in Foxglove or PlotJuggler; with --clips only what came and went around each
alarm, a small file for each.
Several bags are checked on all cores, or with --scheduler on a Dask cluster whose workers see
them under the same paths; one that cannot be checked is named and does not keep the others up.
With --resume what was found of each bag is kept in a file, and taken from there the next time.
With --learn the times at which a bearing vibrated are compared with what was predicted, over all
bags together, and a calibration is proposed where it would change something; that is advice, which
changes neither the configuration nor the exit code.
The exit code is 1 where the monitor warned, 2 where a bag could not be checked.
"""

from __future__ import annotations

import argparse
import sys

from stickslip_monitor.commands import declared
from stickslip_monitor.commands.output import ProgressBar, add_json
from stickslip_monitor.errors import ConfigurationError
from stickslip_monitor.files import PICTURES

STDIN = '-'
REPORTS = {
    '.html': b'<meta name="generator" content="stickslip_monitor">',
    '.png': PICTURES['.png'],
    '.json': b'"schema": "stickslip_monitor/check/1"',
}
_KEPT = {'': b'{"key": "check-'}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    text = 'rosbag2 folder, .mcap file, folder of such, or - for standard input'
    declared.add_input(parser, 'bags', nargs='+', metavar='BAG', help=text)
    declared.add_config(parser)
    declared.add_bearing(parser)
    declared.add_force(parser)
    add_json(parser)
    text = 'write a report: .html, .png or .json (needs matplotlib)'
    declared.add_output(parser, '--report', marks=REPORTS, help=text)
    text = "write inputs and verdicts as the node's topics: .mcap"
    declared.add_recording(parser, '--mcap', is_folder=False, metavar='FILE', help=text)
    text = 'write a clip of each alarm into this folder'
    declared.add_recording(parser, '--clips', is_folder=True, metavar='DIR', help=text)
    text = (
        "propose a calibration from the configured 'level', an operator's reports (a CSV file),"
        " or the 'truth' of simulated bags"
    )
    declared.add_input(parser, '--learn', metavar='FROM', help=text)
    text = 'bags checked at a time (default: one for each core)'
    declared.add_number(parser, '--jobs', 1, metavar='N', help=text)
    text = 'keep what is found of each bag in this file, and check only what is not in it'
    declared.add_output(parser, '--resume', marks=_KEPT, help=text)
    text = "check on the workers of a Dask cluster: tcp://host:port (extra 'fleet')"
    parser.add_argument('--scheduler', metavar='ADDRESS', help=text)


def run(args: argparse.Namespace) -> int:
    """Run the command."""
    _check_options(args)
    # Not needed for help or a wrong option, and it takes most of the time to start.
    from stickslip_monitor.bags.reader import find_bags, spooled
    from stickslip_monitor.commands.check_many import check_bags

    with ProgressBar() as meter:
        if STDIN not in args.bags:
            return check_bags(args, find_bags(args.bags), meter)
        with spooled(sys.stdin.buffer, meter.show) as path:
            args.bags = [str(path)]
            return check_bags(args, [path], meter, STDIN)


def _check_options(args: argparse.Namespace) -> None:
    if STDIN in args.bags and (len(args.bags) > 1 or args.scheduler or args.resume):
        raise ConfigurationError(
            "'-', a recording on standard input, goes alone: neither with other bags nor with"
            ' --scheduler or --resume'
        )
    kept = (args.report or '.json').lower().endswith('.json')
    if args.resume is not None and not (kept and args.mcap is args.clips is args.learn is None):
        raise ConfigurationError(
            '--resume keeps what --json prints: it does not go with --mcap, --clips, --learn or a'
            ' --report to be read'
        )
    if args.scheduler is None:
        return
    for option in ('jobs', 'mcap', 'clips'):
        if getattr(args, option) is not None:
            raise ConfigurationError(
                f'--{option} does not go with --scheduler: it is for bags checked on this machine'
            )
