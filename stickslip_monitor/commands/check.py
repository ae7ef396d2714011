# SPDX-License-Identifier: Apache-2.0
"""Run the monitor over recorded bags: events, time in each regime, worst margins, bad data.

A bag is a rosbag2 folder or an .mcap file. A file that was cut off is read up to the cut. With
--report everything is also written into one file that opens anywhere, without a network: .html to
be read, .png to be shown, .json for programs. With --mcap the verdicts are written as messages
beside the inputs, for replay in Foxglove or PlotJuggler; with --clips only what came and went
around each alarm, a small file for each. The exit code is 1 where the monitor warned.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from datetime import datetime, timezone
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.markup import escape
from rich.progress import Progress, SpinnerColumn, TextColumn
from rich.table import Table

from stickslip_monitor.bags.check import BearingReport, CheckReport, InputReport, check_bag
from stickslip_monitor.commands.output import add_config, add_json, console, print_json
from stickslip_monitor.errors import BagError
from stickslip_monitor.monitor.config import MonitorConfig
from stickslip_monitor.monitor.config_file import load_config
from stickslip_monitor.monitor.records import event_record, number, point_record

if TYPE_CHECKING:
    from stickslip_monitor.commands.report import ReportFile

_COLUMNS = (SpinnerColumn(), TextColumn('{task.description}: {task.completed} messages'))
SCHEMA = 'stickslip_monitor/check/1'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument('bags', nargs='+', metavar='BAG', help='rosbag2 folder or .mcap file')
    add_config(parser)
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


def run(args: argparse.Namespace) -> int:
    """Run the command."""
    config = load_config(args.config)
    if args.mcap is not None:
        _check_mcap(args)
    file = _report_file(args, config)
    documents, warned = [], False
    for path in args.bags:
        report = _check(path, config)
        warned = warned or report.has_warnings
        if args.json or file is not None:
            documents.append(to_json(report))
        if file is not None:
            file.add(report, documents[-1])
        if args.mcap is not None:
            _write_mcap(args.mcap, report, config)
        if args.clips is not None:
            _write_clips(args.clips, report, config)
        if not args.json:
            _print(console(), report)
    if file is not None:
        file.write(datetime.now(timezone.utc))
    if args.json:
        print_json(documents if len(documents) > 1 else documents[0])
    return int(warned)


def _report_file(args: argparse.Namespace, config: MonitorConfig) -> ReportFile | None:
    if args.report is None:
        return None
    # Drawing is not needed for a check as such, and costs time to import.
    from stickslip_monitor.commands.report import ReportFile

    return ReportFile(args.report, config, args.config)


def _check_mcap(args: argparse.Namespace) -> None:
    from stickslip_monitor.bags.verdicts import check_target

    if len(args.bags) > 1:
        raise BagError(f"recording of verdicts '{args.mcap}' is for one bag, not {len(args.bags)}")
    check_target(args.mcap)


def _write_mcap(path: str, report: CheckReport, config: MonitorConfig) -> None:
    from stickslip_monitor.bags.verdicts import write_verdicts

    with Progress(*_COLUMNS, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(escape(f'writing {path}'), total=None)
        write_verdicts(report, config, path, lambda done: bar.update(task, completed=done))


def _write_clips(folder: str, report: CheckReport, config: MonitorConfig) -> None:
    from stickslip_monitor.bags.clips import ClipFolder, write_clips

    store = ClipFolder(replace(config.clips, directory=folder))
    count = write_clips(report, config, store)
    out = Console(stderr=True, highlight=False, soft_wrap=True)
    out.print(f'{count} clips written into {folder}', markup=False)


def _check(path: str, config: MonitorConfig) -> CheckReport:
    with Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(escape(path), total=None)
        return check_bag(
            path, config, lambda done, total: bar.update(task, completed=done, total=total)
        )


def to_json(report: CheckReport) -> dict[str, Any]:
    """The report as the documented JSON object."""
    bag = report.bag
    start, end = bag.start_ns, bag.end_ns
    return {
        'schema': SCHEMA,
        'path': str(bag.path),
        'start': start,
        'end': end,
        'duration': None if start is None or end is None else (end - start) * 1e-9,
        'messages': bag.message_count,
        'topics': {
            name: {'type': topic.type, 'messages': topic.count, 'problem': topic.problem or None}
            for name, topic in bag.topics.items()
        },
        'cuts': [
            {'file': str(cut.path), 'offset': cut.offset, 'size': cut.size, 'text': cut.text}
            for cut in bag.cuts
        ],
        'warnings': list(bag.warnings),
        'bearings': {name: _bearing_json(item) for name, item in report.bearings.items()},
    }


def _bearing_json(item: BearingReport) -> dict[str, Any]:
    return {
        'events': [event_record(event) for event in item.scan.events],
        'seconds': {regime.value: seconds for regime, seconds in item.seconds.items()},
        'worst': {
            name: {'time': extreme.time_ns, 'value': number(extreme.value)}
            | {k: v for k, v in point_record(extreme.point).items() if k in ('speed', 'load')}
            for name, extreme in item.worst.items()
        },
        'evaluations': int(item.scan.time_ns.size),
        'data': item.complaints,
        'inputs': {each.quantity: _input_json(each) for each in item.inputs},
    }


def _input_json(item: InputReport) -> dict[str, Any]:
    return {
        'topic': item.topic,
        'messages': item.messages,
        'used': item.used,
        'rate': number(item.gaps.rate),
        'gaps': item.gaps.count,
        'longest_gaps': [
            {'time': gap.start_ns, 'seconds': gap.seconds} for gap in item.gaps.longest
        ],
    }


def _print(out: Console, report: CheckReport) -> None:
    bag = report.bag
    seconds = 0.0 if bag.start_ns is None or bag.end_ns is None else bag.end_ns - bag.start_ns
    out.print(
        f'[bold]{escape(str(bag.path))}[/]: {bag.message_count} messages in {seconds * 1e-9:.1f} s'
    )
    for text in (*(cut.text for cut in bag.cuts), *bag.warnings):
        out.print(f'[yellow]data:[/] {escape(text)}')
    unused = [t for t in bag.topics.values() if t.problem]
    for topic in unused:
        text = escape(f'topic {topic.name} not readable: {topic.problem}')
        out.print(f'[yellow]data:[/] {text}')
    for item in report.bearings.values():
        _print_bearing(out, item, bag.start_ns or 0)


def _print_bearing(out: Console, item: BearingReport, start_ns: int) -> None:
    for text in item.complaints:
        out.print(f'[yellow]data:[/] {escape(text)}')
    table = Table(title=f'{item.name}: {len(item.scan.events)} events', title_justify='left')
    for heading in ('time [s]', 'from', 'to', 'what'):
        table.add_column(heading, justify='right' if heading == 'time [s]' else 'left')
    colours = ('green', 'yellow', 'red')
    for event in item.scan.events:
        table.add_row(
            f'{(event.time_ns - start_ns) * 1e-9:.2f}',
            event.before.value,
            f'[{colours[event.after.level]}]{event.after.value}[/]',
            escape(event.text.removeprefix(f'{item.name}: ')),
        )
    if item.scan.events:
        out.print(table)
    else:
        out.print(f'{item.name}: no events')
    spent = ', '.join(f'{regime.value} {s:.1f} s' for regime, s in item.seconds.items())
    out.print(f'time in each regime: {spent}')
    for name, unit in (('hopf_margin', ''), ('fold_margin', ''), ('amplitude', ' m')):
        if name in item.worst:
            extreme = item.worst[name]
            exact = extreme.point.amplitude_exact
            beside = f' (exact cycle: {exact:.4g} m)' if name == 'amplitude' else ''
            out.print(
                f'worst {name.replace("_", " ")}: {extreme.value:.4g}{unit}{beside}'
                f' at {(extreme.time_ns - start_ns) * 1e-9:.2f} s'
            )
