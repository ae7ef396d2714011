# SPDX-License-Identifier: Apache-2.0
"""Run the monitor over recorded bags: events, time in each regime, worst margins, bad data.

A bag is a rosbag2 folder or an .mcap file; a folder of bags stands for all of them. A file that
was cut off is read up to the cut. With --report everything is also written into one file that
opens anywhere, without a network: .html to be read, .png to be shown, .json for programs. With
--mcap the verdicts are written as messages beside the inputs, for replay in Foxglove or
PlotJuggler; with --clips only what came and went around each alarm, a small file for each.
Several bags are checked on all cores, or with --scheduler on a Dask cluster whose workers see
them under the same paths; one that cannot be checked is named and does not keep the others up.
The exit code is 1 where the monitor warned, 2 where a bag could not be checked.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from stickslip_monitor.commands.output import (
    ProgressBar,
    add_config,
    add_force,
    add_json,
    check_outputs,
    say_written,
)
from stickslip_monitor.errors import BagError, ConfigurationError, OutputError
from stickslip_monitor.files import is_same

if TYPE_CHECKING:
    from stickslip_monitor.commands.report import ReportFile
    from stickslip_monitor.monitor.config import MonitorConfig


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument(
        'bags', nargs='+', metavar='BAG', help='rosbag2 folder, .mcap file or folder of such'
    )
    add_config(parser)
    add_force(parser)
    add_json(parser)
    parser.add_argument(
        '--report', metavar='FILE', help='write a report: .html, .png or .json (needs matplotlib)'
    )
    parser.add_argument(
        '--mcap', metavar='FILE', help="write inputs and verdicts as the node's topics: .mcap"
    )
    parser.add_argument(
        '--clips', metavar='DIR', help='write a clip of each alarm into this folder'
    )
    parser.add_argument(
        '--jobs', type=int, metavar='N', help='bags checked at a time (default: one for each core)'
    )
    parser.add_argument(
        '--scheduler',
        metavar='ADDRESS',
        help="check on the workers of a Dask cluster: tcp://host:port (extra 'fleet')",
    )


def run(args: argparse.Namespace) -> int:
    """Run the command."""
    _check_options(args)
    # Not needed for help or a wrong option, and they take most of the time to start.
    from stickslip_monitor.commands.check_jobs import Output, Task, check_one
    from stickslip_monitor.monitor.config_file import load_config
    from stickslip_monitor.offline.archive import find_bags

    bags = find_bags(args.bags)
    config = load_config(args.config)
    _check_recordings(args, bags)
    file = _report_file(args, config, bags)
    # A folder's bags are a list, even where it holds one only.
    listed = len(bags) > 1 or bags != [Path(path) for path in args.bags]
    output = Output(args.json, file, listed, args.clips)
    task = Task(config, file.suffix if file else None, args.mcap, args.clips)
    with ProgressBar() as meter:
        if listed or args.scheduler is not None:
            # Processes and clusters are not needed for one bag, and cost time to import.
            from stickslip_monitor.commands.check_many import check_many

            check_many(task, bags, args, output, meter)
        else:
            found = check_one(task, bags[0], meter.show)
            meter.hide()
            output.take(found)
    output.finish()
    say_written(args.report, args.mcap)
    return output.code


def _check_options(args: argparse.Namespace) -> None:
    if args.jobs is not None and args.jobs < 1:
        raise ConfigurationError(f'--jobs {args.jobs} must be at least 1')
    if args.scheduler is None:
        return
    for option in ('jobs', 'mcap', 'clips'):
        if getattr(args, option) is not None:
            raise ConfigurationError(
                f'--{option} does not go with --scheduler: it is for bags checked on this machine'
            )


def _report_file(
    args: argparse.Namespace, config: MonitorConfig, bags: list[Path]
) -> ReportFile | None:
    if args.report is None:
        return None
    # Drawing is not needed for a check as such, and costs time to import.
    from stickslip_monitor.commands.report import MARKS, ReportFile

    file = ReportFile(args.report, config, args.config, args.force)
    check_outputs([(args.report, MARKS[file.suffix])], [args.config, *bags], args.force)
    return file


def _check_recordings(args: argparse.Namespace, bags: list[Path]) -> None:
    """Refuse recordings that are written where they would become part of what is checked."""
    if args.mcap is not None and len(bags) > 1:
        raise BagError(f"recording of verdicts '{args.mcap}' is for one bag, not {len(bags)}")
    folders = {'--clips': args.clips and Path(args.clips)}
    if args.mcap is not None:
        from stickslip_monitor.offline.verdicts import check_target

        folders['--mcap'] = check_target(args.mcap).parent
    read = [path for path in (*bags, *map(Path, args.bags)) if path.is_dir()]
    for option, folder in folders.items():
        for path in read if folder is not None else ():
            if is_same(folder, path):
                raise OutputError(
                    f"{option} would write into the folder '{path}', whose recordings are"
                    ' checked: choose another folder'
                )
