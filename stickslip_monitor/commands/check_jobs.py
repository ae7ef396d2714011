# SPDX-License-Identifier: Apache-2.0
"""Checking one bag, in this process or in another: plain values in, plain values out.

What `stickslip check` prints and writes, one bag after the other.
"""

from __future__ import annotations

import hashlib
import os
import pickle
import sys
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from datetime import datetime, timezone
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stickslip_monitor import __version__
from stickslip_monitor.commands.check_results import error_json, to_json, to_text
from stickslip_monitor.commands.output import line_width, print_json
from stickslip_monitor.errors import CalibrationError, StickslipError, plural
from stickslip_monitor.files import printable
from stickslip_monitor.monitor.config import MonitorConfig
from stickslip_monitor.offline.archive import Stamp
from stickslip_monitor.offline.check import CheckReport, check_bag
from stickslip_monitor.offline.follow import scan_whole

if TYPE_CHECKING:
    from stickslip_monitor.commands.report import ReportPart
    from stickslip_monitor.lab.calibration.recordings import Evidence, EvidenceSource

Progress = Callable[[str, int, int | None], None]


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
    part: ReportPart | None = None
    clips: int | None = None
    evidence: dict[str, Evidence | str] = field(default_factory=dict)
    faulty: bool = False

    @property
    def code(self) -> int:
        """The exit code of this bag alone."""
        if self.error is not None:
            return 3 if self.faulty else 2
        if self.unjudged:
            return 2
        return int(self.warned)

    @property
    def unjudged(self) -> list[str]:
        """The bearings of which the recording gave no operating point: silence is not health."""
        bearings = self.document.get('bearings', {})
        return [name for name, item in bearings.items() if not item['evaluations']]

    @property
    def error(self) -> str | None:
        """Why the bag could not be checked."""
        return self.document.get('error')

    @property
    def warned(self) -> bool:
        """Whether any event raised a warning or an alarm, or an input has a wrong source."""
        bearings = self.document.get('bearings', {}).values()
        return any(
            any(event['level'] != 'OK' for event in item['events'])
            or any(each['source_faults'] for each in item['inputs'].values())
            for item in bearings
        )


def check_one(task: Task, bag: Path, progress: Progress | None = None) -> Found:
    """Check one bag.

    Args:
        task: What is wanted.
        bag: The bag.
        progress: Called with what is being done, and how much of how much of it is done.

    Raises:
        StickslipError: It cannot be checked.
    """
    show = progress or _unseen
    checked = check_bag(
        bag,
        task.config,
        lambda done, total: show(str(bag), done, total),
        outlined=task.report not in (None, '.json'),
    )
    if task.mcap is not None:
        _write_mcap(task.mcap, checked, task.config, show)
    clips = None if task.clips is None else _write_clips(task.clips, checked, task.config)
    return Found(to_json(checked), _part(task, checked), clips, _evidence(task, checked))


def attempt(task: Task, bag: Path, progress: Progress | None = None) -> Found:
    """The same for one bag of many: what cannot be checked is told by the result."""
    try:
        return check_one(task, bag, progress)
    except StickslipError as error:
        return failed(task, bag, str(error))


def failed(task: Task, bag: Path, text: str) -> Found:
    """What came of a bag that could not be checked."""
    if task.report in (None, '.json'):
        return Found(error_json(bag, text))
    from stickslip_monitor.commands.report import missing_part

    return Found(error_json(bag, text), missing_part(bag, text, _anchor(bag)))


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


def _unseen(text: str, done: int, total: int | None) -> None:
    pass


def _part(task: Task, checked: CheckReport) -> ReportPart | None:
    if task.report is None:
        return None
    from stickslip_monitor.commands.report import make_part

    return make_part(task.report, task.config, checked, _anchor(checked.bag.path))


def _anchor(bag: Path) -> str:
    """A word that tells a bag from the others on a page, wherever it stands there."""
    return f'bag-{hashlib.sha256(str(bag).encode()).hexdigest()[:12]}'


def _write_mcap(
    path: str, checked: CheckReport, config: MonitorConfig, progress: Progress
) -> None:
    from stickslip_monitor.offline.verdict_bag import write_verdicts

    write_verdicts(checked, config, path, lambda n: progress(f'{n} messages written', n, None))


def _write_clips(folder: str, checked: CheckReport, config: MonitorConfig) -> int:
    from stickslip_monitor.offline.clips import ClipFolder, write_clips

    store = ClipFolder(replace(config.clips, directory=folder))
    return write_clips(checked, config, store)


def key_of(task: Task, bag: Path, stamp: Stamp) -> str:
    """A name for checking a bag, as it is now, in this way: equal names, equal results."""
    content = pickle.dumps((__version__, task, str(bag), stamp))
    return f'check-{hashlib.sha256(content).hexdigest()[:32]}'


if TYPE_CHECKING:
    from stickslip_monitor.commands.report import ReportFile


class Output:
    """Takes the bags in the order in which they are asked for.

    Args:
        as_json: Whether JSON is printed, at the end, instead of text.
        file: The report, if any.
        listed: Whether JSON is a list, for several bags.
        clips: Where clips go, if any.

    Attributes:
        code: The exit code so far: 1 after a warning, 2 after a bag that could not be checked.
        evidence: Of each bag, to be learned from.
    """

    def __init__(
        self, as_json: bool, file: ReportFile | None, listed: bool, clips: str | None
    ) -> None:
        self._as_json, self._file, self._listed, self._clips = as_json, file, listed, clips
        self._coloured = sys.stdout.isatty() and 'NO_COLOR' not in os.environ
        self._documents: list[dict[str, Any]] = []
        self.evidence: list[dict[str, Evidence | str]] = []
        self.code = 0

    def take(self, found: Found) -> None:
        """Take up one bag."""
        document = found.document
        self.evidence.append(found.evidence)
        self.code = max(self.code, found.code)
        if self._as_json:
            self._documents.append(document)
        elif not found.error:
            sys.stdout.write(to_text(document, self._coloured, line_width()))
            sys.stdout.flush()
        if found.error:
            sys.stderr.write(f'ERROR: {printable(document["path"])}: {printable(found.error)}\n')
        for name in found.unjudged:
            sys.stderr.write(
                f'ERROR: {printable(document["path"])}: nothing is known of {name}: no message'
                ' gave an operating point\n'
            )
        if found.clips is not None:
            sys.stderr.write(
                f'{printable(document["path"])}: {plural(found.clips, "clip")} written into'
                f' {printable(str(self._clips))}\n'
            )
        if self._file is not None:
            self._file.add(found.part, document)

    def tell(self, lessons: Iterable[str]) -> None:
        """Print what is learned, beside the JSON."""
        out = sys.stderr if self._as_json else sys.stdout
        for text in lessons:
            out.write(f'learned: {printable(text)}\n')

    def finish(self) -> None:
        """Print and write what only makes a whole with the last bag."""
        if self._file is not None:
            self._file.write(datetime.now(timezone.utc), self._listed)
        if self._as_json:
            print_json(self._documents if self._listed else self._documents[0])
