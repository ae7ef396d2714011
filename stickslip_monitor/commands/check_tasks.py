# SPDX-License-Identifier: Apache-2.0
"""What is wanted of each recording that is checked, and what came of it.

Plain values in and out, so that one can be checked in another process or on another machine.
"""

from __future__ import annotations

import argparse
import contextlib
import shlex
from collections.abc import Callable, Generator, Iterator, Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime, timezone
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stickslip_monitor.commands import options, output
from stickslip_monitor.errors import (
    BagError,
    CalibrationError,
    ConfigurationError,
    StickslipError,
    cause,
    program_fault,
)
from stickslip_monitor.files import printable
from stickslip_monitor.monitor.config import MonitorConfig
from stickslip_monitor.offline.check import CheckReport, Kept, StretchSink, check_recording
from stickslip_monitor.offline.check_records import SCHEMA, to_json

if TYPE_CHECKING:
    from stickslip_monitor.lab.calibration import Evidence, EvidenceSource
    from stickslip_monitor.offline.clips import ClipCounts, ClipWriter
    from stickslip_monitor.report.page import Archive, RecordingPart

Progress = Callable[[str, int, int | None], None]


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
    clips: ClipCounts | None = None  # what came of its clips, where they were wanted
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
            not self.document['complete']
            or (self.clips is not None and bool(self.clips.failures))
            or any(
                any(event['level'] != 'OK' for event in item['events'])
                or any(each['source_faults'] or not each['messages'] for each in item['inputs'].values())
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
        from stickslip_monitor.offline.verdict_messages import check_target

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
    """What came of each recording, in the order asked for."""
    if args.scheduler is not None:
        bags = [bag.absolute() for bag in bags]
    calls = {number: (task, bag) for number, bag in enumerate(bags)}
    waiting: dict[int, Found] = {}
    following = 0
    with contextlib.closing(_outcomes(calls, args, meter)) as arriving:
        for count, (number, outcome) in enumerate(arriving, 1):
            waiting[number] = _as_found(task, bags[number], outcome)
            meter.hide()
            while following in waiting:
                yield waiting.pop(following)
                following += 1
            if following < len(bags):
                meter.show(f'{count} of {len(bags)} recordings', count, len(bags))


def _outcomes(
    calls: dict[int, tuple[Task, Path]], args: argparse.Namespace, meter: output.ProgressBar
) -> Generator[tuple[int, Any], None, None]:
    """The number of each recording, as it is done, and what came of it."""
    # Processes and clusters are not needed for one recording, and cost time to import.
    if args.scheduler is not None:
        from stickslip_monitor.offline.archive import on_cluster

        yield from on_cluster(args.scheduler, attempt, calls)
    elif args.jobs == 1 or len(calls) < 2:
        for number, call in calls.items():
            yield number, attempt(*call, meter.show)
    else:
        from stickslip_monitor.offline.archive import core_count, run_in_processes

        yield from run_in_processes(attempt, calls, args.jobs or core_count())


def attempt(task: Task, bag: Path, progress: Progress | None = None) -> Found:
    """Check one recording; the result says why it cannot be checked.

    Args:
        task: What is wanted.
        bag: The recording.
        progress: Called with what is being done, and how much of how much of it is done.
    """
    show = progress or (lambda text, done, total: None)
    try:
        with contextlib.ExitStack() as opened:
            sinks = Sinks.of(task, opened)
            checked = check_recording(
                bag,
                task.config,
                sinks.all,
                lambda done, total: show(str(bag), done, total),
                outlined=task.is_drawn,
            )
        document = to_json(checked)
        return Found(
            document,
            _part(task, document, checked),
            None if sinks.clips is None else sinks.clips.counts,
            _evidence(task, checked, sinks.kept),
        )
    except StickslipError as error:
        return failed(task, bag, str(error))


@dataclass(frozen=True, slots=True)
class Sinks:
    """What takes the verdicts on a recording, beside their sums."""

    verdicts: StretchSink | None  # writes them
    clips: ClipWriter | None
    kept: Kept | None  # keeps them for what is learned

    @classmethod
    def of(cls, task: Task, opened: contextlib.ExitStack) -> Sinks:
        """Those that are wanted; what they write is whole where ``opened`` is closed."""
        verdicts, clips = None, None
        if task.mcap is not None:
            from stickslip_monitor.offline.verdict_messages import VerdictWriter

            verdicts = opened.enter_context(VerdictWriter(task.mcap))
        if task.clips is not None:
            from stickslip_monitor.offline.clips import ClipFolder, ClipWriter

            clips = ClipWriter(ClipFolder(replace(task.config.clips, directory=task.clips)))
        return cls(verdicts, clips, None if task.learn is None else Kept())

    @property
    def all(self) -> list[StretchSink]:
        """All that there are."""
        return [each for each in (self.verdicts, self.clips, self.kept) if each is not None]


def failed(task: Task, bag: Path, text: str, *, faulty: bool = False) -> Found:
    """What came of a bag that could not be checked."""
    document = {'schema': SCHEMA, 'path': str(bag), 'error': text}
    return Found(document, _part(task, document), faulty=faulty)


def _part(task: Task, document: dict[str, Any], checked: CheckReport | None = None) -> RecordingPart | None:
    """The recording's part of the report, where one is wanted."""
    if not task.is_drawn:
        return None
    # Drawing is not needed for a check as such, and costs time to import.
    from stickslip_monitor.report.page import recording_part

    return recording_part(document, checked)


def _as_found(task: Task, bag: Path, outcome: Any) -> Found:
    if isinstance(outcome, Found):
        return outcome
    if type(outcome).__name__ in ('BrokenProcessPool', 'KilledWorker'):
        return failed(task, bag, 'the process that checked it died (was there enough memory?)')
    if isinstance(outcome, MemoryError):
        return failed(task, bag, 'there is not enough memory for it')
    if isinstance(outcome, StickslipError | OSError):
        return failed(task, bag, cause(outcome))
    return failed(task, bag, program_fault(outcome), faulty=True)


def _evidence(task: Task, checked: CheckReport, kept: Kept | None) -> dict[str, Evidence | str]:
    found: dict[str, Evidence | str] = {}
    if task.learn is None or kept is None:
        return found
    for config in checked.config.bearings:
        try:
            found[config.name] = task.learn.of_recording(kept, config)
        except CalibrationError as error:
            found[config.name] = str(error)
    return found


def lessons_of(
    args: argparse.Namespace, task: Task, all_found: Sequence[Found], meter: output.ProgressBar
) -> list[str]:
    """What all bags together teach of each bearing."""
    from stickslip_monitor.lab.calibration import learned

    assert task.learn is not None
    reports = () if args.learn in ('level', 'truth') else ('--reports', args.learn)
    line = ['stickslip', 'calibrate', *args.bags, '--config', args.config, *reports]
    line += ['--node', args.node] if args.node else []

    lessons: list[str] = []
    for own in task.config.bearings:
        result = f'{own.name}.calibration.json'
        command = shlex.join([*line, '--bearing', own.name, '--output', result])
        known = [each.evidence[own.name] for each in all_found if own.name in each.evidence]
        meter.show('learning', len(lessons), None)
        lessons += learned(own, task.learn, known, command)
    meter.hide()
    return lessons


def archive_of(task: Task) -> Archive | None:
    """What collects the parts of the report, where one is drawn."""
    if not task.is_drawn:
        return None
    from stickslip_monitor.report.page import Archive

    return Archive()


def report_of(args: argparse.Namespace, task: Task, archive: Archive | None, text: str) -> Any:
    """The report's file; its JSON is the text that is printed."""
    if archive is None:
        return text
    from stickslip_monitor.report.page import html_page, png_sheet

    if task.report == '.png':
        return png_sheet(archive, args.report)
    shown = list(archive.shown())
    return html_page(shown, task.config, args.config, datetime.now(timezone.utc), args.node)


def tolerance_advice(config: MonitorConfig) -> str:
    """A sentence for bearings whose values are taken as exact, and could be known less well."""
    names = [own.name for own in config.bearings if own.belief is None]
    if not names:
        return ''
    return f'{printable(", ".join(names))}: a tolerance gives verdicts probabilities; see docs/calibration.md'
