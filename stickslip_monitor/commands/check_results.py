# SPDX-License-Identifier: Apache-2.0
"""What a check finds of each bag: one record, from which JSON, text and report are made.

Plain values in and out, so that a bag can be checked in another process or on another machine.
"""

from __future__ import annotations

import argparse
import contextlib
import itertools
import json
import os
import pickle
import shlex
import sys
import textwrap
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime, timezone
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stickslip_monitor import __version__
from stickslip_monitor.bags.reader import Bag
from stickslip_monitor.commands.declared import Marks, ending, say_written
from stickslip_monitor.commands.output import ProgressBar, json_text, line_width, print_json
from stickslip_monitor.errors import (
    BagError,
    CalibrationError,
    ConfigurationError,
    OutputError,
    StickslipError,
    cause,
    plural,
    program_fault,
)
from stickslip_monitor.files import open_file, printable, write_whole
from stickslip_monitor.monitor.config import MonitorConfig
from stickslip_monitor.monitor.config_file import load_config
from stickslip_monitor.monitor.ladder import Level
from stickslip_monitor.monitor.messages import event_record, number
from stickslip_monitor.offline.archive import Stamp, stamp_of
from stickslip_monitor.offline.check import BearingReport, CheckReport, InputReport, check_bag
from stickslip_monitor.offline.follow import scan_whole
from stickslip_monitor.physics.friction import Stribeck

if TYPE_CHECKING:
    from stickslip_monitor.lab.calibration.recordings import Evidence, EvidenceSource
    from stickslip_monitor.report.page import RecordingPart

Progress = Callable[[str, int, int | None], None]
SCHEMA = 'stickslip_monitor/check/1'


@dataclass(frozen=True, slots=True)
class Task:
    """What is wanted of every bag.

    Attributes:
        config: The configuration.
        report: The ending of the report, ``None`` for no report.
        mcap: Where to write the recording of verdicts, if at all.
        clips: The folder to write clips into, if at all.
        learn: Who tells when the bearings vibrated, where that is to be learned from.
    """

    config: MonitorConfig
    report: str | None = None
    mcap: str | None = None
    clips: str | None = None
    learn: EvidenceSource | None = None


@dataclass(frozen=True, slots=True)
class Found:
    """What came of one bag: without its samples, which may be many.

    Attributes:
        document: What ``check --json`` prints of it.
        part: Its part of the report, where one is wanted.
        clips: How many clips were written, ``None`` where none were wanted.
        evidence: What it tells of each bearing, or why it tells nothing, where that is wanted.
        faulty: Whether it could not be checked by a fault of the program.
    """

    document: dict[str, Any]
    part: RecordingPart | None = None
    clips: int | None = None
    evidence: dict[str, Evidence | str] = field(default_factory=dict)
    faulty: bool = False

    @property
    def code(self) -> int:
        """The exit code of this bag alone."""
        if 'error' in self.document:
            return 3 if self.faulty else 2
        if self.unjudged:
            return 2
        return int(
            any(
                any(event['level'] != 'OK' for event in item['events'])
                or any(each['source_faults'] for each in item['inputs'].values())
                for item in self.document['bearings'].values()
            )
        )

    @property
    def unjudged(self) -> list[str]:
        """The bearings of which the recording gave no operating point: silence is not health."""
        bearings = self.document.get('bearings', {})
        return [name for name, item in bearings.items() if not item['evaluations']]


def check_bags(
    args: argparse.Namespace,
    bags: Sequence[Path],
    meter: ProgressBar,
    reports: Marks,
    shown: str | None = None,
) -> int:
    """Check bags, and print and write what came of them in the order in which they are asked for.

    Args:
        args: What is to be printed and written.
        bags: The recordings.
        meter: Shows how far the work is.
        reports: The endings of a report.
        shown: What the only bag is called, where its path means nothing to anybody.

    Returns:
        The exit code: 1 after a warning, 2 after a bag that could not be checked.
    """
    config = load_config(args.config)
    if args.bearing is not None:
        config = replace(config, bearings=(config.bearing(args.bearing),))
    if args.mcap is not None:
        if len(bags) > 1:
            raise BagError(f"recording of verdicts '{args.mcap}' is for one bag, not {len(bags)}")
        from stickslip_monitor.offline.verdict_bag import check_target

        check_target(args.mcap)
    source = _source(args.learn, config)
    report = ending(args.report, reports) if args.report else None
    task = Task(config, report, args.mcap, args.clips, source)
    # A folder's bags are a list, even where it holds one only.
    listed = len(bags) > 1 or bags != [Path(path) for path in args.bags]
    all_found = []
    for found in _check_all(task, bags, args, meter):
        _tell(found, args, listed, shown)
        all_found.append(found)
    documents, failed = (
        [f.document for f in all_found],
        any('error' in f.document for f in all_found),
    )
    code = max(found.code for found in all_found)
    if not listed and failed:
        return code
    if source is not None:
        lessons = _lessons(args, config, source, [found.evidence for found in all_found], meter)
        for document in documents:
            # All teach it.
            document['learned'] = lessons
        if not args.json:
            sys.stdout.writelines(f'learned: {printable(text)}\n' for text in lessons)
    text = json_text(documents if listed else documents[0])
    if report is not None:
        parts = [found.part for found in all_found if found.part is not None]
        _write_report(args, report, reports, parts, text, config)
    sys.stdout.write(text if args.json else _tolerance_advice(config))
    say_written(args.report, args.mcap)
    return code


def _tell(found: Found, args: argparse.Namespace, listed: bool, shown: str | None) -> None:
    """Print what came of one bag."""
    document, error = found.document, found.document.get('error')
    if shown is not None:
        error = error and error.replace(document['path'], shown)
        document['path'] = shown
    place = printable(document['path'])
    if error:
        document['error'] = error
        where = f'{place}: ' if listed else ''
        sys.stderr.write(f'ERROR: {where}{printable(error)}\n')
        if args.json and not listed:
            print_json(document)
    elif not args.json:
        coloured = sys.stdout.isatty() and 'NO_COLOR' not in os.environ
        sys.stdout.write(to_text(document, coloured, line_width()))
        sys.stdout.flush()
    for name in found.unjudged:
        sys.stderr.write(
            f'ERROR: {place}: nothing is known of {name}: no message gave an operating point\n'
        )
    if found.clips is not None:
        clips = plural(found.clips, 'clip')
        sys.stderr.write(f'{place}: {clips} written into {printable(args.clips)}\n')


def _write_report(
    args: argparse.Namespace,
    suffix: str,
    reports: Marks,
    parts: Sequence[RecordingPart],
    text: str,
    config: MonitorConfig,
) -> None:
    data = text.encode()
    if suffix != '.json':
        # Drawing is not needed for a check as such, and costs time to import.
        from stickslip_monitor.report.page import html_page, png_sheet

        now = datetime.now(timezone.utc)
        data = (
            png_sheet(parts, args.report)
            if suffix == '.png'
            else html_page(parts, config, args.config, now)
        )
    try:
        write_whole(args.report, data, reports[suffix] or b'', args.force)
    except OSError as error:
        raise OutputError(
            f"'{args.report}' cannot be written: {error.strerror or error}"
        ) from error


def _tolerance_advice(config: MonitorConfig) -> str:
    """A line for bearings whose values are taken as exact, and could be known less well."""
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

    missing = [bearing.name for bearing in config.bearings if bearing.level is None]
    if text == 'level' and missing:
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


def _check_all(
    task: Task, bags: Sequence[Path], args: argparse.Namespace, meter: ProgressBar
) -> Iterator[Found]:
    """What came of each bag, in the order asked for."""
    if len(bags) == 1 and args.scheduler is None and args.resume is None:
        yield attempt(task, bags[0], meter.show)
        meter.hide()
        return
    if args.scheduler is not None:
        bags = [bag.absolute() for bag in bags]
    # By a name for checking a bag, as it is now, in this way: equal names, equal results.
    by_key: dict[str, tuple[Path, int]] = {}
    for bag in bags:
        stamp: Stamp = stamp_of(bag)
        content = pickle.dumps((__version__, task, str(bag), stamp))
        size = max(1, sum(size for _, size, _ in stamp))
        by_key[f'check-{sha256(content).hexdigest()[:32]}'] = bag, size
    order, total = list(by_key), sum(size for _, size in by_key.values())
    with _kept(args.resume) as (known, keep):
        known = {key: known[key] for key in order if key in known}
        calls = {key: (task, by_key[key][0]) for key in order if key not in known}
        waiting: dict[str, Found] = {}
        done = 0
        with contextlib.closing(_outcomes(calls, args, meter)) as arriving:
            told = itertools.chain(((key, Found(known[key])) for key in known), arriving)
            for count, (key, outcome) in enumerate(told, 1):
                bag, size = by_key[key]
                waiting[key] = found = _as_found(task, bag, outcome)
                if key not in known and 'error' not in found.document:
                    keep(key, found.document)
                done += size
                meter.hide()
                while order and order[0] in waiting:
                    yield waiting.pop(order.pop(0))
                meter.show(f'{count} of {len(bags)} bags', done, total)


def _outcomes(
    calls: dict[str, tuple[Task, Path]], args: argparse.Namespace, meter: ProgressBar
) -> Generator[tuple[str, Any], None, None]:
    """The key of each bag that is to be checked, as it is done, and what came of it."""
    # Processes and clusters are not needed for one bag, and cost time to import.
    from stickslip_monitor.offline.processes import core_count, run_in_processes

    jobs, keys = args.jobs or core_count(), list(calls)
    if args.scheduler is not None:
        from stickslip_monitor.offline.fleet import connected, on_cluster

        with connected(args.scheduler) as client:
            yield from on_cluster(client, attempt, calls)
    elif jobs == 1:
        for key, call in calls.items():
            yield key, attempt(*call, meter.show)
    else:
        with contextlib.closing(run_in_processes(attempt, list(calls.values()), jobs)) as arriving:
            for place, outcome in arriving:
                yield keys[place], outcome


def _as_found(task: Task, bag: Path, outcome: Any) -> Found:
    if isinstance(outcome, Found):
        return outcome
    if type(outcome).__name__ == 'BrokenProcessPool':
        return _failed(task, bag, 'the process that checked it died (was there enough memory?)')
    if isinstance(outcome, MemoryError):
        return _failed(task, bag, 'there is not enough memory for it')
    if isinstance(outcome, StickslipError | OSError):
        return _failed(task, bag, cause(outcome))
    return _failed(task, bag, program_fault(outcome), faulty=True)


Keep = Callable[[str, dict[str, Any]], None]


@contextlib.contextmanager
def _kept(path: str | None) -> Iterator[tuple[dict[str, dict[str, Any]], Keep]]:
    """What was found of bags, by key, and what keeps one more: a line of JSON for each.

    Bags that could not be checked are not kept, and a line that was cut off by a loss of power is
    no result.  Without a path nothing is kept.

    Raises:
        OutputError: The file cannot be read or written.
    """
    if path is None:
        yield {}, lambda key, document: None
        return
    known, line = {}, b'\n'
    try:
        if Path(path).exists():
            with open_file(path) as there:
                for line in there:
                    with contextlib.suppress(ValueError, KeyError, TypeError):
                        record = json.loads(line)
                        known[record['key']] = record['found']
        file = Path(path).open('a', encoding='utf-8')  # noqa: SIM115, closed below
    except (OSError, ValueError) as error:
        raise OutputError(f"results '{path}' cannot be kept: {error}") from None

    def keep(key: str, document: dict[str, Any]) -> None:
        file.write(json.dumps({'key': key, 'found': document}) + '\n')
        file.flush()

    with file:
        file.write('' if line.endswith(b'\n') else '\n')
        yield known, keep


def attempt(task: Task, bag: Path, progress: Progress | None = None) -> Found:
    """Check one bag; why it cannot be checked is told by the result.

    Args:
        task: What is wanted.
        bag: The bag.
        progress: Called with what is being done, and how much of how much of it is done.
    """
    show = progress or (lambda text, done, total: None)
    drawn = task.report not in (None, '.json')
    try:
        checked = check_bag(
            bag, task.config, lambda done, total: show(str(bag), done, total), outlined=drawn
        )
        document, part, clips = to_json(checked), None, None
        if task.mcap is not None:
            from stickslip_monitor.offline.verdict_bag import write_verdicts

            def told(count: int) -> None:
                show(f'{count} messages written', count, None)

            write_verdicts(checked, task.config, task.mcap, told)
        if task.clips is not None:
            from stickslip_monitor.offline.clips import ClipFolder, write_clips

            store = ClipFolder(replace(task.config.clips, directory=task.clips))
            clips = write_clips(checked, task.config, store)
        if drawn:
            from stickslip_monitor.report.page import recording_part

            is_page = task.report == '.html'
            part = recording_part(document, checked, task.config, with_pages=is_page)
        return Found(document, part, clips, _evidence(task, checked))
    except StickslipError as error:
        return _failed(task, bag, str(error))


def _failed(task: Task, bag: Path, text: str, *, faulty: bool = False) -> Found:
    """What came of a bag that could not be checked."""
    document, part = {'schema': SCHEMA, 'path': str(bag), 'error': text}, None
    if task.report not in (None, '.json'):
        from stickslip_monitor.report.page import missing_part

        part = missing_part(document)
    return Found(document, part, faulty=faulty)


def _evidence(task: Task, checked: CheckReport) -> dict[str, Evidence | str]:
    found: dict[str, Evidence | str] = {}
    if task.learn is None:
        return found
    whole = scan_whole(checked.bag.path, task.config)
    for config in task.config.bearings:
        try:
            found[config.name] = task.learn.of_recording(whole, config)
        except CalibrationError as error:
            found[config.name] = str(error)
    return found


def to_json(report: CheckReport) -> dict[str, Any]:
    """The report as a JSON object."""
    return {
        'schema': SCHEMA,
        **bag_record(report.bag),
        'bearings': {name: _bearing_record(item) for name, item in report.bearings.items()},
    }


def bag_record(bag: Bag) -> dict[str, Any]:
    """What a recording holds, whatever it is checked for."""
    start, end = bag.start_ns, bag.end_ns
    return {
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
    }


def _bearing_record(item: BearingReport) -> dict[str, Any]:
    return {
        'events': [event_record(event) for event in item.events],
        'seconds': {regime.value: seconds for regime, seconds in item.seconds.items()},
        'worst': {
            name: {'time': extreme.time_ns, 'value': number(extreme.value)}
            | {
                k: number(getattr(extreme.point, k))
                for k in ('speed', 'load', 'amplitude_exact')
                if k != 'amplitude_exact' or name == 'amplitude'
            }
            for name, extreme in item.worst.items()
        },
        **({} if item.measured is None else {'measured': item.measured}),
        'evaluations': item.evaluations,
        'data': item.complaints,
        'inputs': {each.quantity: _input(each) for each in item.inputs},
    }


def _input(item: InputReport) -> dict[str, Any]:
    return {
        'topic': item.topic,
        'messages': item.messages,
        'used': item.used,
        'share': item.used / item.messages if item.messages else None,
        'span': [number(value) for value in item.span],
        'si_span': [number(value) for value in item.si_span],
        'rate': number(item.gaps.rate),
        'gaps': item.gaps.count,
        'longest_gaps': [
            {'time': gap.start_ns, 'seconds': gap.seconds} for gap in item.gaps.longest
        ],
        'source_faults': [
            {'fault': fault.kind.value, 'since': fault.since_ns, 'raised': fault.raised_ns}
            for fault in item.sources
        ],
        'questions': list(item.questions),
        'fault': item.fault or None,
    }


_GREEN, _YELLOW, _RED, _BOLD, _END = (f'\x1b[{code}m' for code in (32, 33, 31, 1, 0))
_OF_LEVEL = {Level.OK.name: _GREEN, Level.WARN.name: _YELLOW, Level.ERROR.name: _RED}
_WORST = {'hopf_margin': 'Hopf margin', 'fold_margin': 'fold margin', 'amplitude': 'amplitude'}
# On a narrower screen an event is a block of lines, not one.
_NARROW = 90
Paint = Callable[[str, str], str]


def to_text(document: Mapping[str, Any], coloured: bool, width: int | None = None) -> str:
    """The text of one bag.

    Args:
        document: What ``check --json`` prints of it.
        coloured: Whether it goes to a terminal that knows colours.
        width: Letters on a line; any number if None.
    """

    def paint(colour: str, text: str) -> str:
        return f'{colour}{text}{_END}' if coloured else text

    return ''.join(f'{line}\n' for line in _lines(document, paint, width))


def wrapped(line: str, width: int | None, indent: int = 2) -> str:
    """A line, broken at a number of letters; whole if that is None."""
    if width is None:
        return line
    # The last column stays free: not every terminal breaks behind it.
    # A path that is cut in two cannot be copied.
    return textwrap.fill(
        line, max(width - 1, 20), subsequent_indent=' ' * indent,
        break_long_words=False, break_on_hyphens=False,
    )  # fmt: skip


def _lines(document: Mapping[str, Any], paint: Paint, width: int | None) -> Iterator[str]:
    seconds = document['duration'] or 0.0
    path = paint(_BOLD, printable(document['path']))
    yield wrapped(f'{path}: {plural(document["messages"], "message")} in {seconds:.1f} s', width)
    faults = [*(cut['text'] for cut in document['cuts']), *document['warnings']]
    faults += (
        f'topic {name} not readable: {topic["problem"]}'
        for name, topic in document['topics'].items()
        if topic['problem']
    )
    for text in faults:
        yield wrapped(f'{paint(_YELLOW, "data:")} {printable(text)}', width)
    for name, item in document['bearings'].items():
        yield from _bearing_lines(name, item, document['start'] or 0, paint, width)


def _bearing_lines(
    name: str, item: Mapping[str, Any], start: int, paint: Paint, width: int | None
) -> Iterator[str]:
    for text in item['data']:
        yield wrapped(f'{paint(_YELLOW, "data:")} {printable(text)}', width)
    for quantity, each in item['inputs'].items():
        yield wrapped(printable(_input_line(quantity, each)), width)
        for text in each['questions']:
            asked = printable(f'{quantity} on {each["topic"]} {text}')
            yield wrapped(f'{paint(_YELLOW, "question:")} {asked}', width)
    events = item['events']
    yield f'{name}: {plural(len(events), "event") if events else "no events"}'
    if events and not _is_narrow(width):
        yield paint(_BOLD, f'  {"time [s]":>10}  {"from":<15}  {"to":<15}  what')
    for event in events:
        text = printable(event['text'].removeprefix(f'{name}: '))
        yield from _event_lines(event, text, start, paint, width)
    for title, spent in (('time in each regime', 'seconds'), ('measured vibration', 'measured')):
        if spent in item:
            said = ', '.join(f'{state} {seconds:.1f} s' for state, seconds in item[spent].items())
            yield wrapped(f'{title}: {said}', width)
    for quantity, called in _WORST.items():
        if quantity in item['worst']:
            extreme = item['worst'][quantity]
            value, exact = extreme['value'], extreme.get('amplitude_exact')
            shown = f'{value * 1e3:.4g} mm' if quantity == 'amplitude' else f'{value:+.1%}'
            beside = '' if exact is None else f' (exact cycle: {exact * 1e3:.4g} mm)'
            seconds = (extreme['time'] - start) * 1e-9
            yield wrapped(f'worst {called}: {shown}{beside} at {seconds:.2f} s', width)


def _event_lines(
    event: Mapping[str, Any], text: str, start: int, paint: Paint, width: int | None
) -> Iterator[str]:
    seconds, to, colour = (event['time'] - start) * 1e-9, event['to'], _OF_LEVEL[event['level']]
    if _is_narrow(width):
        change = wrapped(f'  {seconds:.2f} s: {event["from"]} to {to}', width, 4)
        yield f'{change.removesuffix(to)}{paint(colour, to)}'
        yield wrapped(f'    {text}', width, 4)
    else:
        # Of the finished line, as colours take room in a text but none on the screen.
        head = f'  {seconds:>10.2f}  {event["from"]:<15}  {to:<15}  '
        line = wrapped(f'{head}{text}', width, len(head))
        yield line.replace(head, f'{head[:-17]}{paint(colour, head[-17:-2])}  ', 1)


def _is_narrow(width: int | None) -> bool:
    return width is not None and width < _NARROW


def _input_line(quantity: str, item: Mapping[str, Any]) -> str:
    """What came of an input: the range of its numbers, its rate, and the share used."""
    place = f'{quantity} on {item["topic"]}'
    if not item['used']:
        return f'{place}: {plural(item["messages"], "message")}, none used'
    (low, high), (si_low, si_high) = item['span'], item['si_span']
    unit = 'm/s' if quantity == 'speed' else 'N'
    si = '' if quantity == 'level' else f' ({si_low:.4g} to {si_high:.4g} {unit})'
    rate = '' if item['rate'] is None else f', {item["rate"]:.3g} a second'
    return f'{place}: {low:.4g} to {high:.4g} in the messages{si}{rate}, {item["share"]:.1%} used'
