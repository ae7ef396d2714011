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
import contextlib
import itertools
import json
import os
import shlex
import sys
from collections.abc import Generator, Iterator, Sequence
from dataclasses import replace
from datetime import datetime, timezone
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

from stickslip_monitor.commands.declared import (
    add_config,
    add_force,
    add_input,
    add_output,
    add_recording,
    ending,
    say_written,
)
from stickslip_monitor.commands.output import (
    ProgressBar,
    add_json,
    json_text,
    line_width,
    print_json,
)
from stickslip_monitor.errors import (
    BagError,
    ConfigurationError,
    OutputError,
    StickslipError,
    cause,
    plural,
    program_fault,
)
from stickslip_monitor.files import PICTURES, open_file, printable, write_whole

if TYPE_CHECKING:
    from stickslip_monitor.commands.check_results import Found, Task
    from stickslip_monitor.lab.calibration.recordings import Evidence, EvidenceSource
    from stickslip_monitor.monitor.config import MonitorConfig
    from stickslip_monitor.report.recording import RecordingPart

STDIN = '-'
REPORTS = {
    '.html': b'<meta name="generator" content="stickslip_monitor">',
    '.png': PICTURES['.png'],
    '.json': b'"schema": "stickslip_monitor/check/1"',
}
_KEPT = {'': b'{"key": "check-'}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add_input(
        parser,
        'bags',
        nargs='+',
        metavar='BAG',
        help='rosbag2 folder, .mcap file, folder of such, or - for standard input',
    )
    add_config(parser)
    parser.add_argument('--bearing', help='only this bearing')
    add_force(parser)
    add_json(parser)
    text = 'write a report: .html, .png or .json (needs matplotlib)'
    add_output(parser, '--report', marks=REPORTS, help=text)
    text = "write inputs and verdicts as the node's topics: .mcap"
    add_recording(parser, '--mcap', is_folder=False, metavar='FILE', help=text)
    text = 'write a clip of each alarm into this folder'
    add_recording(parser, '--clips', is_folder=True, metavar='DIR', help=text)
    add_input(
        parser,
        '--learn',
        metavar='FROM',
        help="propose a calibration from the configured 'level', an operator's reports (a CSV"
        " file), or the 'truth' of simulated bags",
    )
    parser.add_argument(
        '--jobs', type=int, metavar='N', help='bags checked at a time (default: one for each core)'
    )
    text = 'keep what is found of each bag in this file, and check only what is not in it'
    add_output(parser, '--resume', marks=_KEPT, help=text)
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

    with ProgressBar() as meter:
        if STDIN not in args.bags:
            return _run(args, find_bags(args.bags), meter)
        with spooled(sys.stdin.buffer, meter.show) as path:
            args.bags = [str(path)]
            return _run(args, [path], meter, shown=STDIN)


def _run(
    args: argparse.Namespace, bags: list[Path], meter: ProgressBar, shown: str | None = None
) -> int:
    from stickslip_monitor.commands.check_results import Task
    from stickslip_monitor.monitor.config_file import load_config

    config = load_config(args.config)
    if args.bearing is not None:
        config = replace(config, bearings=(config.bearing(args.bearing),))
    if args.mcap is not None:
        if len(bags) > 1:
            raise BagError(f"recording of verdicts '{args.mcap}' is for one bag, not {len(bags)}")
        from stickslip_monitor.offline.verdict_bag import check_target

        check_target(args.mcap)
    source = _source(args.learn, config)
    report = ending(args.report, REPORTS) if args.report else None
    task = Task(config, report, args.mcap, args.clips, source)
    # A folder's bags are a list, even where it holds one only.
    listed = len(bags) > 1 or bags != [Path(path) for path in args.bags]
    output = _Output(args, listed, shown)
    for found in _check_all(task, bags, args, meter):
        output.take(found)
    if not listed and output.failed:
        return output.code
    if source is not None:
        output.tell(_lessons(args, config, source, output.evidence, meter))
    output.finish(config)
    say_written(args.report, args.mcap)
    return output.code


class _Output:
    """Prints and writes what came of the bags, in the order in which they are asked for.

    Args:
        args: What is to be printed and written.
        listed: Whether JSON is a list, for several bags.
        shown: What the only bag is called, where its path means nothing to anybody.

    Attributes:
        code: The exit code so far: 1 after a warning, 2 after a bag that could not be checked.
        failed: Whether a bag could not be checked.
        evidence: Of each bag, to be learned from.
    """

    def __init__(self, args: argparse.Namespace, listed: bool, shown: str | None) -> None:
        self._args, self._listed, self._shown = args, listed, shown
        self._coloured = sys.stdout.isatty() and 'NO_COLOR' not in os.environ
        self._documents: list[dict[str, Any]] = []
        self._parts: list[RecordingPart] = []
        self.evidence: list[dict[str, Evidence | str]] = []
        self.code, self.failed = 0, False

    def take(self, found: Found) -> None:
        """Take up one bag."""
        from stickslip_monitor.commands.check_results import to_text

        document, error = found.document, found.error
        if self._shown is not None:
            error = error and error.replace(document['path'], self._shown)
            document['path'] = self._shown
        self._documents.append(document)
        self.evidence.append(found.evidence)
        self.code = max(self.code, found.code)
        place = printable(document['path'])
        if error:
            document['error'], self.failed = error, True
            where = f'{place}: ' if self._listed else ''
            sys.stderr.write(f'ERROR: {where}{printable(error)}\n')
            if self._args.json and not self._listed:
                print_json(document)
        elif not self._args.json:
            sys.stdout.write(to_text(document, self._coloured, line_width()))
            sys.stdout.flush()
        if found.part is not None:
            self._parts.append(found.part)
        for name in found.unjudged:
            sys.stderr.write(
                f'ERROR: {place}: nothing is known of {name}: no message gave an operating point\n'
            )
        if found.clips is not None:
            folder = printable(self._args.clips)
            sys.stderr.write(f'{place}: {plural(found.clips, "clip")} written into {folder}\n')

    def tell(self, lessons: Sequence[str]) -> None:
        """Print what is learned; of JSON it is a part of each recording, as all teach it."""
        for document in self._documents:
            document['learned'] = list(lessons)
        if not self._args.json:
            for text in lessons:
                sys.stdout.write(f'learned: {printable(text)}\n')

    def finish(self, config: MonitorConfig) -> None:
        """Print and write what only makes a whole with the last bag."""
        text = json_text(self._documents if self._listed else self._documents[0])
        if self._args.report is not None:
            self._write_report(text, config)
        if self._args.json:
            sys.stdout.write(text)
        else:
            sys.stdout.write(_tolerance_advice(config))

    def _write_report(self, text: str, config: MonitorConfig) -> None:
        path, suffix = self._args.report, ending(self._args.report, REPORTS)
        data = text.encode()
        if suffix != '.json':
            # Drawing is not needed for a check as such, and costs time to import.
            from stickslip_monitor.report.page import html_page, png_sheet

            now = datetime.now(timezone.utc)
            data = (
                png_sheet(self._parts, path)
                if suffix == '.png'
                else html_page(self._parts, config, self._args.config, now)
            )
        try:
            write_whole(path, data, REPORTS[suffix] or b'', self._args.force)
        except OSError as error:
            raise OutputError(f"'{path}' cannot be written: {error.strerror or error}") from error


def _tolerance_advice(config: MonitorConfig) -> str:
    """A line for bearings whose values are taken as exact, and could be known less well."""
    from stickslip_monitor.commands.check_results import wrapped
    from stickslip_monitor.physics.friction import Stribeck

    names = [
        own.name
        for own in config.bearings
        if own.belief is None and isinstance(own.bearing.friction, Stribeck)
    ]
    if not names:
        return ''
    text = (
        f'{printable(", ".join(names))}: state how well the values are known, and verdicts come'
        ' with probabilities and miss fewer episodes: from a drawing tolerance: {damping: 0.40,'
        ' static: 0.15, kinetic: 0.15, decay: 0.30, load: 0.05}, after an impact test damping:'
        ' 0.10, after a friction bench static: 0.03, kinetic: 0.03, decay: 0.10'
    )
    return f'{wrapped(text, line_width())}\n'


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
    return replace(source_of(told, config), true=text == 'truth')


def _lessons(
    args: argparse.Namespace,
    config: MonitorConfig,
    source: EvidenceSource,
    evidence: Sequence[dict[str, Evidence | str]],
    meter: ProgressBar,
) -> list[str]:
    """What all bags together teach of each bearing."""
    from stickslip_monitor.lab.calibration.recordings import learned

    reports = () if args.learn in ('level', 'truth') else ('--reports', args.learn)
    lessons = []
    for own in config.bearings:
        command = shlex.join(
            [
                *('stickslip', 'calibrate', *args.bags, '--config', args.config, *reports),
                *('--bearing', own.name, '--output', f'{own.name}.calibration.json'),
            ]
        )
        known = [found[own.name] for found in evidence if own.name in found]
        lessons += learned(
            own, source, known, command, lambda done, total: meter.show('learning', done, total)
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


def _check_all(
    task: Task, bags: Sequence[Path], args: argparse.Namespace, meter: ProgressBar
) -> Iterator[Found]:
    """What came of each bag, in the order asked for."""
    # Processes and clusters are not needed for one bag, and cost time to import.
    from stickslip_monitor.commands.check_results import Found, attempt, key_of
    from stickslip_monitor.offline.archive import stamp_of

    if len(bags) == 1 and args.scheduler is None and args.resume is None:
        found = attempt(task, bags[0], meter.show)
        meter.hide()
        yield found
        return
    if args.scheduler is not None:
        bags = [bag.absolute() for bag in bags]
    stamps = [stamp_of(bag) for bag in bags]
    sizes = [max(1, sum(size for _, size, _ in stamp)) for stamp in stamps]
    keys = [key_of(task, bag, stamp) for bag, stamp in zip(bags, stamps, strict=True)]
    with contextlib.closing(_Kept(args.resume)) as kept:
        known = ((n, kept.documents[key]) for n, key in enumerate(keys) if key in kept.documents)
        calls = {n: (task, bags[n]) for n, key in enumerate(keys) if key not in kept.documents}
        waiting: dict[int, Found] = {}
        following = done = 0
        with contextlib.closing(_called(calls, keys, args, meter)) as arriving:
            told = itertools.chain(((n, Found(document)) for n, document in known), arriving)
            for count, (number, outcome) in enumerate(told, 1):
                waiting[number] = _as_found(task, bags[number], outcome)
                kept.add(keys[number], waiting[number])
                done += sizes[number]
                meter.hide()
                while following in waiting:
                    yield waiting.pop(following)
                    following += 1
                meter.show(f'{count} of {len(bags)} bags', done, sum(sizes))


def _called(
    calls: dict[int, tuple[Task, Path]],
    keys: Sequence[str],
    args: argparse.Namespace,
    meter: ProgressBar,
) -> Generator[tuple[int, Any], None, None]:
    """The number of each bag that is to be checked, as it is done, and what came of it."""
    from stickslip_monitor.commands.check_results import attempt
    from stickslip_monitor.offline.processes import core_count, run_in_processes

    jobs = args.jobs or core_count()
    if args.scheduler is not None:
        from stickslip_monitor.offline.fleet import connected, on_cluster

        numbers = {keys[number]: number for number in calls}
        named = {keys[number]: call for number, call in calls.items()}
        with connected(args.scheduler) as client:
            for key, outcome in on_cluster(client, attempt, named):
                yield numbers[key], outcome
    elif jobs == 1:
        for number, call in calls.items():
            yield number, attempt(*call, meter.show)
    else:
        numbers_left = list(calls)
        with contextlib.closing(run_in_processes(attempt, list(calls.values()), jobs)) as arriving:
            for place, outcome in arriving:
                yield numbers_left[place], outcome


def _as_found(task: Task, bag: Path, outcome: Any) -> Found:
    from stickslip_monitor.commands.check_results import Found, failed

    if isinstance(outcome, Found):
        return outcome
    if type(outcome).__name__ == 'BrokenProcessPool':
        return failed(task, bag, 'the process that checked it died (was there enough memory?)')
    if isinstance(outcome, MemoryError):
        return failed(task, bag, 'there is not enough memory for it')
    if isinstance(outcome, StickslipError | OSError):
        return failed(task, bag, cause(outcome))
    return failed(task, bag, program_fault(outcome), faulty=True)


class _Kept:
    """What was found of bags, a line of JSON for each, kept from one run to the next.

    A result is known again by what it depends on: version, configuration, path, and size and time
    of each file. Bags that could not be checked are tried anew, and a line that was cut off by a
    loss of power is no result.

    Args:
        path: The file, which need not be there yet; ``None`` keeps nothing.

    Attributes:
        documents: What is known already, by key.

    Raises:
        OutputError: The file cannot be read or written.
    """

    def __init__(self, path: str | None) -> None:
        self.documents: dict[str, dict[str, Any]] = {}
        self._file: IO[str] | None = None
        if path is None:
            return
        try:
            whole = self._read(path) if Path(path).exists() else True
            self._file = Path(path).open('a', encoding='utf-8')  # noqa: SIM115, closed by close
            self._file.write('' if whole else '\n')
        except (OSError, ValueError) as error:
            raise OutputError(f"results '{path}' cannot be kept: {error}") from None

    def _read(self, path: str) -> bool:
        """Take what is there; False where the last line was cut off."""
        line = b'\n'
        with open_file(path) as file:
            for line in file:
                with contextlib.suppress(ValueError, KeyError, TypeError):
                    record = json.loads(line)
                    self.documents[record['key']] = record['found']
        return line.endswith(b'\n')

    def add(self, key: str, found: Found) -> None:
        """Keep what was found of a bag."""
        if self._file is None or found.error is not None or key in self.documents:
            return
        self._file.write(json.dumps({'key': key, 'found': found.document}) + '\n')
        self._file.flush()

    def close(self) -> None:
        """Nothing more is found."""
        if self._file is not None:
            self._file.close()
