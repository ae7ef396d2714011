# SPDX-License-Identifier: Apache-2.0
"""What a check finds of each bag: one record, from which JSON, text and report are made.

Plain values in and out, so that a bag can be checked in another process or on another machine.
"""

from __future__ import annotations

import argparse
import contextlib
import itertools
import json
import pickle
import shlex
from collections.abc import Callable, Generator, Iterator, Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime, timezone
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stickslip_monitor import __version__
from stickslip_monitor.bags.reader import stamp_of
from stickslip_monitor.bags.recording import Recording
from stickslip_monitor.commands import options, output
from stickslip_monitor.errors import (
    BagError,
    CalibrationError,
    ConfigurationError,
    OutputError,
    StickslipError,
    cause,
    program_fault,
)
from stickslip_monitor.files import open_file, printable
from stickslip_monitor.monitor.config import MonitorConfig
from stickslip_monitor.monitor.messages import event_record, number
from stickslip_monitor.offline.check import (
    BearingReport,
    CheckReport,
    check_bag,
    scan_whole,
)
from stickslip_monitor.offline.input_check import InputReport
from stickslip_monitor.physics.friction import Stribeck

if TYPE_CHECKING:
    from stickslip_monitor.lab.calibration.recordings import Evidence, EvidenceSource
    from stickslip_monitor.report.page import RecordingPart

Keep = Callable[[str, dict[str, Any]], None]
Progress = Callable[[str, int, int | None], None]
SCHEMA = 'stickslip_monitor/check/1'


@dataclass(frozen=True, slots=True)
class Task:
    """What is wanted of every bag."""

    config: MonitorConfig
    report: str | None = None  # the ending of the report, if one is wanted
    mcap: str | None = None  # where to write the recording of verdicts, if at all
    clips: str | None = None  # the folder to write clips into, if at all
    learn: EvidenceSource | None = None  # the source of when the bearings vibrated, to learn from

    @property
    def is_drawn(self) -> bool:
        """Whether the report has pictures."""
        return self.report not in (None, '.json')


@dataclass(frozen=True, slots=True)
class Found:
    """What came of one bag: without its samples, which may be many."""

    document: dict[str, Any]  # what `check --json` prints of it
    part: RecordingPart | None = None  # its part of the report, where one is wanted
    clips: int | None = None  # how many were written, where they were wanted
    # The evidence of each bearing, or why there is none, where that is wanted.
    evidence: dict[str, Evidence | str] = field(default_factory=dict)
    faulty: bool = False  # whether it could not be checked by a fault of the program

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


def task_of(args: argparse.Namespace, count: int) -> Task:
    """What the arguments want of each of some bags."""
    config = options.chosen(args)
    if args.mcap is not None:
        if count > 1:
            raise BagError(f"recording of verdicts '{args.mcap}' is for one bag, not {count}")
        from stickslip_monitor.offline.verdict_bag import check_target

        check_target(args.mcap)
    report = None if args.report is None else Path(args.report).suffix.lower()
    return Task(config, report, args.mcap, args.clips, _source(args.learn, config))


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
    reports = None if text in ('level', 'truth') else text
    return replace(source_of(reports, config), true=text == 'truth')


def check_all(
    task: Task, bags: Sequence[Path], args: argparse.Namespace, meter: output.ProgressBar
) -> Iterator[Found]:
    """What came of each bag, in the order asked for."""
    if args.scheduler is not None:
        bags = [bag.absolute() for bag in bags]
    # By a name for checking a bag, as it is now, in this way: equal names, equal results.
    by_key, sizes = {}, {}
    for bag in bags:
        stamp = stamp_of(bag)
        content = pickle.dumps((__version__, task, str(bag), stamp))
        key = f'check-{sha256(content).hexdigest()[:32]}'
        by_key[key], sizes[key] = bag, max(1, sum(size for _, size, _ in stamp))
    order, total, done = list(by_key), sum(sizes.values()), 0
    with _kept(args.resume) as (known, keep):
        waiting: dict[str, Found] = {}
        calls = {key: (task, bag) for key, bag in by_key.items() if key not in known}
        with contextlib.closing(_outcomes(calls, args, meter)) as arriving:
            done_before = ((key, Found(known[key])) for key in by_key if key in known)
            for count, (key, outcome) in enumerate(itertools.chain(done_before, arriving), 1):
                waiting[key] = found = _as_found(task, by_key[key], outcome)
                if key in calls and 'error' not in found.document:
                    keep(key, found.document)
                done += sizes[key]
                meter.hide()
                while order and order[0] in waiting:
                    yield waiting.pop(order.pop(0))
                if order:
                    meter.show(f'{count} of {len(bags)} bags', done, total)


def _outcomes(
    calls: dict[str, tuple[Task, Path]], args: argparse.Namespace, meter: output.ProgressBar
) -> Generator[tuple[str, Any], None, None]:
    """The key of each bag that is to be checked, as it is done, and what came of it."""
    # Processes and clusters are not needed for one bag, and cost time to import.
    if args.scheduler is not None:
        from stickslip_monitor.offline.fleet import connected, on_cluster

        with connected(args.scheduler) as client:
            yield from on_cluster(client, attempt, calls)
    elif args.jobs == 1 or len(calls) < 2:
        for key, call in calls.items():
            yield key, attempt(*call, meter.show)
    else:
        from stickslip_monitor.offline.fleet import core_count, run_in_processes

        yield from run_in_processes(attempt, calls, args.jobs or core_count())


def attempt(task: Task, bag: Path, progress: Progress | None = None) -> Found:
    """Check one bag; the result says why it cannot be checked.

    Args:
        task: What is wanted.
        bag: The bag.
        progress: Called with what is being done, and how much of how much of it is done.
    """
    show = progress or (lambda text, done, total: None)
    try:
        checked = check_bag(
            bag,
            task.config,
            lambda done, total: show(str(bag), done, total),
            outlined=task.is_drawn,
        )
        document, part, clips = to_json(checked), None, None
        if task.mcap is not None:
            from stickslip_monitor.offline.verdict_bag import write_verdicts

            write_verdicts(
                checked,
                task.config,
                task.mcap,
                lambda count: show(f'{count} messages written', count, None),
            )
        if task.clips is not None:
            from stickslip_monitor.offline.clips import ClipFolder, write_clips

            store = ClipFolder(replace(task.config.clips, directory=task.clips))
            clips = write_clips(checked, task.config, store)
        if task.is_drawn:
            from stickslip_monitor.report.page import recording_part

            is_page = task.report == '.html'
            part = recording_part(document, checked, task.config, with_pages=is_page)
        return Found(document, part, clips, _evidence(task, checked))
    except StickslipError as error:
        return failed(task, bag, str(error))


def failed(task: Task, bag: Path, text: str, *, faulty: bool = False) -> Found:
    """What came of a bag that could not be checked."""
    document, part = {'schema': SCHEMA, 'path': str(bag), 'error': text}, None
    if task.is_drawn:
        from stickslip_monitor.report.page import missing_part

        part = missing_part(document)
    return Found(document, part, faulty=faulty)


def _as_found(task: Task, bag: Path, outcome: Any) -> Found:
    if isinstance(outcome, Found):
        return outcome
    if type(outcome).__name__ == 'BrokenProcessPool':
        return failed(task, bag, 'the process that checked it died (was there enough memory?)')
    if isinstance(outcome, MemoryError):
        return failed(task, bag, 'there is not enough memory for it')
    if isinstance(outcome, StickslipError | OSError):
        return failed(task, bag, cause(outcome))
    return failed(task, bag, program_fault(outcome), faulty=True)


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
    with contextlib.ExitStack() as opened:
        try:
            if Path(path).exists():
                with open_file(path) as there:
                    for line in there:
                        with contextlib.suppress(ValueError, KeyError, TypeError):
                            record = json.loads(line)
                            known[record['key']] = record['found']
            # What holds none of our results is replaced: --force allows it.
            mode = 'a' if known else 'w'
            file = opened.enter_context(Path(path).open(mode, encoding='utf-8'))
        except (OSError, ValueError) as error:
            raise OutputError(f"results '{path}' cannot be kept: {error}") from None

        def keep(key: str, document: dict[str, Any]) -> None:
            file.write(json.dumps({'key': key, 'found': document}) + '\n')
            file.flush()

        file.write('' if line.endswith(b'\n') or not known else '\n')
        yield known, keep


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


def lessons_of(
    args: argparse.Namespace, task: Task, all_found: Sequence[Found], meter: output.ProgressBar
) -> list[str]:
    """What all bags together teach of each bearing."""
    from stickslip_monitor.lab.calibration.recordings import learned

    assert task.learn is not None
    reports = () if args.learn in ('level', 'truth') else ('--reports', args.learn)
    line = ['stickslip', 'calibrate', *args.bags, '--config', args.config, *reports]

    def show(done: float, total: float) -> None:
        meter.show('learning', done, total)

    lessons = []
    for own in task.config.bearings:
        result = f'{own.name}.calibration.json'
        command = shlex.join([*line, '--bearing', own.name, '--output', result])
        known = [each.evidence[own.name] for each in all_found if own.name in each.evidence]
        lessons += learned(own, task.learn, known, command, show)
    meter.hide()
    return lessons


def report_of(
    args: argparse.Namespace, task: Task, found: Sequence[Found], text: str
) -> str | bytes:
    """The report's file; its JSON is the text that is printed."""
    if not task.is_drawn:
        return text
    # Drawing is not needed for a check as such, and costs time to import.
    from stickslip_monitor.report.page import html_page, png_sheet

    parts = [each.part for each in found if each.part is not None]
    if task.report == '.png':
        return png_sheet(parts, args.report)
    return html_page(parts, task.config, args.config, datetime.now(timezone.utc))


def tolerance_advice(config: MonitorConfig) -> str:
    """A sentence for bearings whose values are taken as exact, and could be known less well."""
    names = [
        own.name
        for own in config.bearings
        if own.belief is None and isinstance(own.bearing.friction, Stribeck)
    ]
    if not names:
        return ''
    return (
        f'{printable(", ".join(names))}: state how well the values are known, and verdicts come'
        ' with probabilities and miss fewer episodes: from a drawing tolerance: {damping: 0.40,'
        ' static: 0.15, kinetic: 0.15, decay: 0.30, load: 0.05}, after an impact test damping:'
        ' 0.10, after a friction bench static: 0.03, kinetic: 0.03, decay: 0.10'
    )


def to_json(report: CheckReport) -> dict[str, Any]:
    """The report as a JSON object."""
    return {
        'schema': SCHEMA,
        **bag_record(report.bag),
        'bearings': {name: _bearing_record(item) for name, item in report.bearings.items()},
    }


def bag_record(bag: Recording) -> dict[str, Any]:
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
