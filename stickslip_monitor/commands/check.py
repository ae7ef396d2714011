# SPDX-License-Identifier: Apache-2.0
"""Run the monitor over recordings and logs, as it would have run on board.

Prints every alarm, the time in each regime, the worst margins, and what is wrong with the data.

A recording is a rosbag2 folder, an .mcap or sqlite3 file, or a log: CSV, Parquet, NMEA 0183 or
Signal K. A folder of recordings stands for all of them, - for one on standard input; logs beside
them are named and not checked. Of one that is cut, all up to the cut is read. What a log leaves
open is guessed and said; `stickslip info` shows its columns.

--report writes one page (.html) that opens anywhere without a network. --mcap writes inputs and
verdicts as messages, for Foxglove or PlotJuggler; --clips writes a short recording around each
alarm.

Several recordings are checked on all cores, or with --scheduler on a Dask cluster whose workers
see them under the same paths. A bad one is named and does not stop the rest.

Exits 0 if all was read and nothing warned, 1 if something did or a part could not be read, 2 if a
recording could not be checked or has no usable data.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import re
import sys
import textwrap
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime, timezone
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stickslip_monitor import errors
from stickslip_monitor.commands import options, output
from stickslip_monitor.errors import BagError, ConfigurationError, StickslipError, plural
from stickslip_monitor.safe_files import printable

if TYPE_CHECKING:
    from stickslip_monitor.monitor.parameters import MonitorConfig
    from stickslip_monitor.offline.check import CheckReport, StretchSink
    from stickslip_monitor.offline.clip_folder import ClipCounts
    from stickslip_monitor.report.page import Archive, RecordingPart

STDIN = '-'
REPORTS = {'.html': b'<meta name="generator" content="stickslip_monitor">'}
# For one version: what stands for formats that went.
_REPORT_SUCCESSORS = {
    '.json': '--json prints the same numbers: stickslip check ... --json > FILE',
    '.png': 'write a page (.html), which any browser prints',
}


@dataclass(frozen=True, slots=True)
class Task:
    """Work to do on each recording; it can be sent to another process or machine."""

    config: MonitorConfig
    is_reported: bool = False  # whether a report is wanted, which has pictures
    mcap: str | None = None  # where to write the recording of verdicts, if at all
    clips: str | None = None  # the folder to write clips into, if at all
    left_out: str = ''  # a sentence on what lies beside the recordings and is not checked


@dataclass(frozen=True, slots=True)
class CheckResult:
    """Result of one recording, without its samples."""

    document: dict[str, Any]  # what `check --json` prints of it
    part: RecordingPart | None = None  # its part of the report, where one is wanted
    clips: ClipCounts | None = None  # numbers of its clips, where they were wanted
    faulty: bool = False  # whether it could not be checked by a fault of the program

    @property
    def code(self) -> int:
        """Exit code of this recording alone.

        0 if all was read and nothing warned; 1 for a warning, a question, an input without messages or with
        two sources, or a part or a clip that failed; 2 if it could not be checked or has a bearing without an
        operating point; 3 for a fault of the program.
        """
        if 'error' in self.document:
            return 3 if self.faulty else 2
        if self.unjudged:
            return 2
        bearings = self.document['bearings'].values()
        inputs = [facts for item in bearings for facts in item['inputs'].values()]
        return int(
            not self.document['complete']
            or (self.clips is not None and bool(self.clips.failures))
            or any(event['severity'] != 'OK' for item in bearings for event in item['events'])
            or any(facts['source_faults'] or facts['questions'] or not facts['messages'] for facts in inputs)
        )

    @property
    def unjudged(self) -> list[str]:
        """Names of the bearings without an operating point (silence is not health); none after an error."""
        bearings = self.document.get('bearings', {})
        return [name for name, item in bearings.items() if not item['evaluations']]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    text = 'recording, log, folder of these, or - for standard input'
    options.add_file(parser, 'bags', nargs='+', metavar='BAG', help=text)
    options.add_config(parser)
    options.add_shared(parser, '--bearing', '--force', '--json')
    text = 'write a report: .html (needs matplotlib)'
    options.add_file(parser, '--report', '-o', marks=REPORTS, type=_report_path, help=text)
    text = "write inputs and verdicts as the node's topics: .mcap"
    options.add_file(parser, '--mcap', is_folder=False, metavar='FILE', help=text)
    text = 'write a clip of each alarm into this folder'
    options.add_file(parser, '--clips', is_folder=True, metavar='DIR', help=text)
    text = 'check N recordings at a time (default: one for each core)'
    options.add_number(parser, '--jobs', 1, metavar='N', help=text)
    text = "check on the workers of a Dask cluster: tcp://host:port (extra 'fleet')"
    parser.add_argument('--scheduler', metavar='ADDRESS', help=text)


def _report_path(path: str) -> str:
    """Return the path of a report unchanged.

    Raises:
        argparse.ArgumentTypeError: It has the ending of a format that is gone; the text has the successor.
    """
    if successor := _REPORT_SUCCESSORS.get(Path(path).suffix.lower()):
        raise argparse.ArgumentTypeError(f"'{path}' is not written any more: {successor}")
    return path


def run(args: argparse.Namespace) -> int:
    """Check the recordings, or the one on standard input; print the results and write the outputs.

    That one is copied to a file first, which then stands in ``args.bags``.

    Returns:
        The exit code, the highest of all recordings.

    Raises:
        ConfigurationError: Options do not go together, or the configuration is refused.
        BagError: There is no recording, or ``--mcap`` is refused.
        OSError: Standard input cannot be copied to a file, or a recording was removed while it was read.
        FleetError: The cluster of ``--scheduler`` cannot be used.
        ReportError, DrawingError, OutputError: The report cannot be made (Jinja2 or matplotlib is missing)
            or written.
    """
    if STDIN in args.bags and (len(args.bags) > 1 or args.scheduler):
        raise ConfigurationError(
            "'-', a recording on standard input, goes alone: neither with other bags nor with --scheduler"
        )
    for option in ('jobs', 'mcap', 'clips') if args.scheduler else ():
        if getattr(args, option) is not None:
            raise ConfigurationError(
                f'--{option} does not go with --scheduler: it is for bags checked on this machine'
            )
    # Not needed for help or a wrong option, and it takes most of the time to start.
    from stickslip_logs.recordings.folders import find_bags
    from stickslip_logs.recordings.reader import spool_stream

    with output.ProgressBar() as meter:
        if STDIN not in args.bags:
            return _check_bags(args, find_bags(args.bags), meter)
        with spool_stream(sys.stdin.buffer, meter.show) as path:
            args.bags = [str(path)]
            return _check_bags(args, [path], meter, STDIN)


def _check_bags(
    args: argparse.Namespace, bags: Sequence[Path], meter: output.ProgressBar, shown: str | None = None
) -> int:
    """Check recordings, print their results in the order of the arguments, and write the outputs.

    Advice on tolerances, or with ``--json`` the list of several recordings, comes last. No report is written
    of a single recording that cannot be checked.

    Args:
        args: The arguments.
        bags: The recordings.
        meter: Shows the progress.
        shown: Name to print in place of the path, for a recording from standard input; ``None`` for others.

    Returns:
        The exit code, the highest of all recordings.

    Raises:
        ConfigurationError: The configuration cannot be read or is refused.
        BagError: ``--mcap`` is given for several recordings, or its file exists or has a wrong ending.
        FleetError: The cluster of ``--scheduler`` cannot be used.
        ReportError, DrawingError, OutputError: The report cannot be made (Jinja2 or matplotlib is missing)
            or written.
    """
    task = _make_task(args, bags)
    # A folder's bags are a list, even where it holds one only.
    listed = len(bags) > 1 or bags != [Path(path) for path in args.bags]
    all_found, archive = [], None
    if task.is_reported:
        from stickslip_monitor.report.page import Archive

        archive = Archive()
    for result in _check_all(task, bags, args, meter):
        _print_result(result, args, listed=listed, shown=shown)
        if archive is not None and result.part is not None:
            archive.add(result.part)
        all_found.append(replace(result, part=None))
    documents = [result.document for result in all_found]
    code = max(result.code for result in all_found)
    if not listed and 'error' in documents[0]:
        return code
    text = output.json_text(documents if listed else documents[0])
    output.write_outputs(args, report=lambda: _report_page(args, task, archive))
    if args.mcap is not None:
        output.report_written(args.mcap)
    sys.stdout.write(text if args.json else _advice_text(task.config))
    return code


def _advice_text(config: MonitorConfig) -> str:
    """Return a line that advises a tolerance for the bearings without one; '' where all have one."""
    exact = printable(', '.join(bearing.name for bearing in config.bearings if bearing.belief is None))
    advice = f'{exact}: add a tolerance for probabilities (docs/calibration.md)'
    return f'{_wrap_line(advice, output.line_width())}\n' if exact else ''


def _make_task(args: argparse.Namespace, bags: Sequence[Path]) -> Task:
    """Load the configuration, and return the task of each recording.

    Raises:
        ConfigurationError: The configuration cannot be read or is refused.
        BagError: ``--mcap`` is for several recordings, exists or has a wrong ending.
    """
    from stickslip_logs.recordings.folders import describe_unchecked

    config = options.load_chosen(args)
    if args.mcap is not None:
        if len(bags) > 1:
            raise BagError(f"recording of verdicts '{args.mcap}' is for one bag, not {len(bags)}")
        from stickslip_monitor.offline.verdict_messages import check_target

        check_target(args.mcap)
    unread = describe_unchecked(args.bags, bags)
    return Task(config, args.report is not None, args.mcap, args.clips, unread)


def _check_all(
    task: Task, bags: Sequence[Path], args: argparse.Namespace, meter: output.ProgressBar
) -> Iterator[CheckResult]:
    """Check all recordings; yield each result in the order of the arguments, and show the progress between.

    With a scheduler, recordings are named by their absolute paths.

    Raises:
        FleetError: The cluster of ``--scheduler`` cannot be used.
    """
    if args.scheduler is not None:
        bags = [bag.absolute() for bag in bags]
    # What is left out is said once, with the first.
    rest = replace(task, left_out='')
    calls = {number: (rest if number else task, bag) for number, bag in enumerate(bags)}
    waiting: dict[int, CheckResult] = {}
    following, total = 0, len(bags)
    with contextlib.closing(_run_checks(calls, args, meter)) as arriving:
        for count, (number, outcome) in enumerate(arriving, 1):
            waiting[number] = _as_result(*calls[number], outcome)
            meter.hide()
            while following in waiting:
                yield waiting.pop(following)
                following += 1
            if following < total:
                meter.show(f'{count} of {total} recordings', count, total)


def _run_checks(
    calls: dict[int, tuple[Task, Path]], args: argparse.Namespace, meter: output.ProgressBar
) -> Any:
    """Return a generator of the number and the outcome of each recording, as each is done.

    An outcome is a result; where processes or a cluster check, it may be an exception, and the meter is not
    moved.

    Raises:
        FleetError: As it is iterated: the cluster cannot be used.
    """
    if args.scheduler is None and (args.jobs == 1 or len(calls) < 2):
        return ((number, check_one(*call, meter.show)) for number, call in calls.items())
    # Processes and clusters are not needed for one recording, and cost time to import.
    from stickslip_monitor.offline import processes

    if args.scheduler is not None:
        return processes.run_on_cluster(args.scheduler, check_one, calls)
    return processes.run_in_processes(check_one, calls, args.jobs or processes.core_count())


def check_one(
    task: Task, bag: Path, progress: Callable[[str, int, int | None], None] | None = None
) -> CheckResult:
    """Check one recording; write its clips and its recording of verdicts, where the task has them.

    Args:
        task: Work on the recording.
        bag: The recording.
        progress: Called with the path of the recording, bytes done, and bytes in all (``None``: not known).

    Returns:
        The result, not complete where the task left something out; of a recording that cannot be checked, or
        outputs that cannot be written, one with the text of the error. Other exceptions than this package's
        pass through.
    """
    from stickslip_monitor.offline.check import check_recording, to_json

    clips = None
    sinks: list[StretchSink] = []
    try:
        with contextlib.ExitStack() as opened:
            if task.mcap is not None:
                from stickslip_monitor.offline.verdict_messages import VerdictWriter

                sinks.append(opened.enter_context(VerdictWriter(task.mcap)))
            if task.clips is not None:
                from stickslip_monitor.offline.clip_folder import ClipFolder, ClipWriter

                folder = ClipFolder(replace(task.config.clips, directory=task.clips))
                clips = ClipWriter(opened.enter_context(folder))
                sinks.append(clips)
            checked = check_recording(
                bag, task.config, sinks, progress and partial(progress, str(bag)), outlined=task.is_reported
            )
        if task.left_out:
            checked.bag.note(task.left_out)
            checked = replace(checked, complete=False)
        document = to_json(checked)
        part, counts = _report_part(task, document, checked), None if clips is None else clips.counts
        return CheckResult(document, part, counts)
    except StickslipError as error:
        return _failed_result(task, bag, str(error))


def _failed_result(task: Task, bag: Path, text: str, *, faulty: bool = False) -> CheckResult:
    """Return the result of a recording that could not be checked, for the reason in ``text``.

    What the task left out is appended to the reason. ``faulty`` marks an error of this program: the exit code
    is 3 and not 2.
    """
    from stickslip_monitor.offline.check import SCHEMA

    text = '; '.join(filter(None, (text, task.left_out)))
    document = {'schema': SCHEMA, 'path': str(bag), 'error': text}
    return CheckResult(document, _report_part(task, document), faulty=faulty)


def _report_part(
    task: Task, document: dict[str, Any], checked: CheckReport | None = None
) -> RecordingPart | None:
    """Return the recording's part of the report; ``None`` where no report is wanted.

    Args:
        task: The task, which says whether one is.
        document: The record of the recording, as ``check --json`` prints it.
        checked: Its check with the outlines; ``None`` where it could not be checked.
    """
    if not task.is_reported:
        return None
    # Drawing is not needed for a check as such, and costs time to import.
    from stickslip_monitor.report.page import recording_part

    return recording_part(document, checked)


def _as_result(task: Task, bag: Path, outcome: Any) -> CheckResult:
    """Return an outcome that is a result; of an exception or a dead process, the result of an error."""
    if isinstance(outcome, CheckResult):
        return outcome
    from stickslip_monitor.offline.processes import has_died

    if has_died(outcome):
        return _failed_result(task, bag, 'the process that checked it died (was there enough memory?)')
    if isinstance(outcome, MemoryError):
        return _failed_result(task, bag, 'there is not enough memory for it')
    if isinstance(outcome, StickslipError | OSError):
        return _failed_result(task, bag, errors.cause(outcome))
    return _failed_result(task, bag, errors.program_fault(outcome), faulty=True)


def _report_page(args: argparse.Namespace, task: Task, archive: Archive | None) -> bytes:
    """Return the report of all parts in ``archive`` as HTML.

    Args:
        args: The arguments, which name the configuration.
        task: The task, with the configuration itself.
        archive: The parts; not ``None``, as a report is wanted.

    Raises:
        ReportError: Jinja2 is not installed.
        DrawingError: matplotlib is not installed.
        ConfigurationError: The file of the configuration cannot be read any more; so also OSError.
    """
    from stickslip_monitor.report.page import html_page

    assert archive is not None
    now = datetime.now(timezone.utc)
    return html_page(list(archive.shown()), task.config, args.config, now, args.node)


def _print_result(result: CheckResult, args: argparse.Namespace, *, listed: bool, shown: str | None) -> None:
    """Print the result of one recording: its text or JSON, or its error, and the counts of its clips.

    Errors and counts go to standard error, with the bearings without an operating point and the clips that
    were not written. ``shown``, if not ``None``, takes the place of the path in the result's document, too.
    The JSON of one of several recordings (``listed``) is left to the list of all.
    """
    document, error = result.document, result.document.get('error')
    if shown is not None:
        error = error and error.replace(document['path'], shown)
        document['path'] = shown
    place = printable(document['path'])
    if error:
        document['error'] = error
        where = f'{place}: ' if listed else ''
        sys.stderr.write(f'ERROR: {where}{printable(error)}\n')
        if args.json and not listed:
            output.print_json(document)
    elif not args.json:
        is_coloured = sys.stdout.isatty() and 'NO_COLOR' not in os.environ
        sys.stdout.write(to_text(document, coloured=is_coloured, width=output.line_width()))
        sys.stdout.flush()
    for name in result.unjudged:
        sys.stderr.write(f'ERROR: {place}: nothing is known of {name}: no message gave an operating point\n')
    if result.clips is not None:
        written = f'{plural(result.clips.written, "clip")} written into {printable(args.clips)}'
        if result.clips.removed:
            written += f'; {plural(result.clips.removed, "older clip")} removed, as clips.most says'
        sys.stderr.write(f'{place}: {written}\n')
        for text in result.clips.failures:
            sys.stderr.write(f'ERROR: {place}: a clip was not written: {printable(text)}\n')


# Codes of ANSI escapes (ECMA-48, SGR).
_COLOURS = {'OK': 32, 'WARN': 33, 'ERROR': 31, 'data': 33, 'bold': 1}
_WORST = {'hopf_margin': 'Hopf margin', 'fold_margin': 'fold margin', 'amplitude': 'amplitude'}
# On a narrower screen an event is a block of lines, not one.
_NARROW = 90


def to_text(document: Mapping[str, Any], *, coloured: bool = False, width: int | None = None) -> str:
    """Return the text on one recording that was checked, each line with its end.

    Args:
        document: Its record, as ``check --json`` prints it.
        coloured: Whether to add terminal colours.
        width: Maximum letters on a line, at least 20; None for no limit. A longer word stays whole.
    """
    # Those of events, which are indented, are broken as a table.
    lines = _text_lines(document, width)
    text = ''.join(f'{line if line.startswith(" ") else _wrap_line(line, width)}\n' for line in lines)
    return _colour_text(text, document) if coloured else text


def _colour_text(text: str, document: Mapping[str, Any]) -> str:
    """Return the text of one recording with colours for path, marks of faults, and conditions of events."""

    def paint(kind: str, part: str) -> str:
        return f'\x1b[{_COLOURS[kind]}m{part}\x1b[0m'

    levels = {e['to']: e['severity'] for item in document['bearings'].values() for e in item['events']}
    change = re.compile(r'^( +[\d.]+(?:  \w+ +| s: \w+ to ))(\w+)', re.MULTILINE)
    text = change.sub(lambda m: m[1] + paint(levels.get(m[2], 'OK'), m[2]), text)
    text = re.sub(r'^(data:|question:)', lambda m: paint('data', m[1]), text, flags=re.MULTILINE)
    return re.sub(r'\A(.*): ', lambda m: f'{paint("bold", m[1])}: ', text)


def _wrap_line(line: str, width: int | None, indent: int = 2) -> str:
    """Break a line at blanks, so that each is shorter than a width; ``None`` leaves it whole.

    Lines after the first are indented. A width below 21 counts as 21; a longer word is not broken.
    """
    if width is None:
        return line
    # The last column stays free: not every terminal breaks behind it. A path that is cut in two
    # cannot be copied.
    fill = partial(textwrap.fill, break_long_words=False, break_on_hyphens=False)
    return fill(line, max(width - 1, 20), subsequent_indent=' ' * indent)


def _text_lines(document: Mapping[str, Any], width: int | None) -> Iterator[str]:
    """Yield the lines on a recording; those of events are indented and wrapped to a width.

    A width of ``None`` has no limit.
    """
    seconds = document['duration'] or 0.0
    yield f'{printable(document["path"])}: {plural(document["messages"], "message")} in {seconds:.1f} s'
    topics = [(name, topic['problem']) for name, topic in document['topics'].items()]
    faults = [*(cut['text'] for cut in document['cuts']), *document['warnings']]
    faults += (f'topic {name} not readable: {problem}' for name, problem in topics if problem)
    yield from (f'data: {printable(text)}' for text in faults)
    for name, item in document['bearings'].items():
        yield from _bearing_lines(name, item, document['start'] or 0, width)


def _bearing_lines(name: str, item: Mapping[str, Any], start: int, width: int | None) -> Iterator[str]:
    """Yield the lines on a bearing; those of events are wrapped to a width, if it is not ``None``.

    Args:
        name: Name of the bearing.
        item: Its part of the record, as ``check --json`` prints it.
        start: The start of the recording, from which times are counted [ns].
        width: Letters on a line; a narrow one has no headings above the events.
    """
    for text in item['data']:
        yield f'data: {printable(text)}'
    for quantity, facts in item['inputs'].items():
        place = printable(quantity if 'assumed' in facts else f'{quantity} on {facts["topic"]}')
        yield f'{place}: {_input_text(facts)}'
        for text in facts['questions']:
            yield f'question: {place} {printable(text)}'
    events = item['events']
    yield f'{name}: {plural(len(events), "event") if events else "no events"}'
    if events and (width is None or width >= _NARROW):
        yield f'  {"time [s]":>10}  {"from":<15}  {"to":<15}  what'
    for event in events:
        yield from _event_lines(event, printable(event['text'].removeprefix(f'{name}: ')), start, width)
    for title, spent in (('time in each regime', 'seconds'), ('measured vibration', 'measured')):
        if spent in item:
            times = (f'{state} {seconds:.1f} s' for state, seconds in item[spent].items())
            yield f'{title}: {", ".join(times)}'
    for quantity, called in _WORST.items():
        if quantity in item['worst']:
            extreme = item['worst'][quantity]
            value, seconds = extreme['value'], (extreme['time'] - start) * 1e-9
            shown = f'{value * 1e3:.4g} mm' if quantity == 'amplitude' else f'{value:+.1%}'
            yield f'worst {called}: {shown} at {seconds:.2f} s'


def _event_lines(event: Mapping[str, Any], text: str, start: int, width: int | None) -> Iterator[str]:
    """Yield the lines of an event: a table row, or two lines if the width is narrow; each may be wrapped.

    ``text`` says what happened; ``start`` is that of the recording [ns], which times are counted from. A
    width of ``None`` has no limit.
    """
    seconds = (event['time'] - start) * 1e-9
    if width is not None and width < _NARROW:
        yield _wrap_line(f'  {seconds:.2f} s: {event["from"]} to {event["to"]}', width, 4)
        yield _wrap_line(f'    {text}', width, 4)
    else:
        head = f'  {seconds:>10.2f}  {event["from"]:<15}  {event["to"]:<15}  '
        yield _wrap_line(f'{head}{text}', width, len(head))


def _input_text(item: Mapping[str, Any]) -> str:
    """Return words on an input: that it is assumed, that nothing was used, or range, rate and share used."""
    if 'assumed' in item:
        return f'{item["values"]}, assumed: nothing measures it'
    if not item['used']:
        return f'{plural(item["messages"], "message")}, none used'
    rate = '' if item['rate'] is None else f', {item["rate"]:.3g} a second'
    return f'{item["values"]}{rate}, {item["share"]:.1%} used'
