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
import shlex
import sys
from dataclasses import replace
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
    from stickslip_monitor.commands.check_jobs import Output
    from stickslip_monitor.commands.report import ReportFile
    from stickslip_monitor.lab.calibration.recordings import EvidenceSource
    from stickslip_monitor.monitor.config import MonitorConfig

STDIN = '-'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument(
        'bags',
        nargs='+',
        metavar='BAG',
        help='rosbag2 folder, .mcap file, folder of such, or - for standard input',
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
        '--learn',
        metavar='FROM',
        help="propose a calibration from the configured 'level', an operator's reports (a CSV"
        " file), or the 'truth' of simulated bags",
    )
    parser.add_argument(
        '--jobs', type=int, metavar='N', help='bags checked at a time (default: one for each core)'
    )
    parser.add_argument(
        '--resume',
        metavar='FILE',
        help='keep what is found of each bag in this file, and check only what is not in it',
    )
    parser.add_argument(
        '--scheduler',
        metavar='ADDRESS',
        help="check on the workers of a Dask cluster: tcp://host:port (extra 'fleet')",
    )


def run(args: argparse.Namespace) -> int:
    """Run the command."""
    _check_options(args)
    # Not needed for help or a wrong option, and it takes most of the time to start.
    from stickslip_monitor.offline.archive import find_bags, spooled

    if STDIN in args.bags:
        with ProgressBar() as meter, spooled(sys.stdin.buffer, meter.show) as path:
            args.bags = [str(path)]
            try:
                return _run(args, [path], meter, shown=STDIN)
            except BagError as error:
                raise BagError(str(error).replace(str(path), STDIN)) from error
    with ProgressBar() as meter:
        return _run(args, find_bags(args.bags), meter)


def _run(
    args: argparse.Namespace, bags: list[Path], meter: ProgressBar, shown: str | None = None
) -> int:
    from stickslip_monitor.commands.check_jobs import Output, Task, check_one
    from stickslip_monitor.monitor.config_file import load_config

    config = load_config(args.config)
    _check_recordings(args, bags)
    file = _report_file(args, config, bags)
    # A folder's bags are a list, even where it holds one only.
    listed = len(bags) > 1 or bags != [Path(path) for path in args.bags]
    output = Output(args.json, file, listed, args.clips)
    source = _source(args.learn, config)
    task = Task(config, file.suffix if file else None, args.mcap, args.clips, source)
    if listed or args.scheduler is not None or args.resume is not None:
        # Processes and clusters are not needed for one bag, and cost time to import.
        from stickslip_monitor.commands.check_many import check_many

        check_many(task, bags, args, output, meter)
    else:
        found = check_one(task, bags[0], meter.show)
        found.document['path'] = shown or found.document['path']
        meter.hide()
        output.take(found)
    if source is not None:
        output.tell(_lessons(args, config, source, output, meter))
    output.finish()
    say_written(args.report, args.mcap)
    return output.code


def _source(text: str | None, config: MonitorConfig) -> EvidenceSource | None:
    if text is None:
        return None
    from stickslip_monitor.commands.calibrate import source_of

    if text == 'level':
        missing = [bearing.name for bearing in config.bearings if bearing.level is None]
        if missing:
            raise ConfigurationError(
                f'--learn level needs a level of every bearing, and {", ".join(missing)} has none:'
                ' configure level.topic'
            )
    told = None if text in ('level', 'truth') else text
    return replace(source_of(told, None, 'data', config), true=text == 'truth')


def _lessons(
    args: argparse.Namespace,
    config: MonitorConfig,
    source: EvidenceSource,
    output: Output,
    meter: ProgressBar,
) -> list[str]:
    """What all bags together teach of each bearing."""
    from stickslip_monitor.lab.calibration.proposal import learned

    reports = () if args.learn in ('level', 'truth') else ('--reports', args.learn)
    lessons = []
    for own in config.bearings:
        command = shlex.join(
            [
                *('stickslip', 'calibrate', *args.bags, '--config', args.config, *reports),
                *('--bearing', own.name, '--output', f'{own.name}.calibration.json'),
            ]
        )
        evidence = [found[own.name] for found in output.evidence if own.name in found]
        lessons += learned(
            own, source, evidence, command, lambda done, total: meter.show('learning', done, total)
        )
    meter.hide()
    return lessons


def _check_options(args: argparse.Namespace) -> None:
    if args.jobs is not None and args.jobs < 1:
        raise ConfigurationError(f'--jobs {args.jobs} must be at least 1')
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
        from stickslip_monitor.offline.verdict_bag import check_target

        folders['--mcap'] = check_target(args.mcap).parent
    read = [path for path in (*bags, *map(Path, args.bags)) if path.is_dir()]
    for option, folder in folders.items():
        for path in read if folder is not None else ():
            if is_same(folder, path):
                raise OutputError(
                    f"{option} would write into the folder '{path}', whose recordings are"
                    ' checked: choose another folder'
                )
