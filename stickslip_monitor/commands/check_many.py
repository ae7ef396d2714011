# SPDX-License-Identifier: Apache-2.0
"""Bags checked one after the other, in processes or on a cluster, and what came of them told."""

from __future__ import annotations

import argparse
import contextlib
import itertools
import json
import os
import pickle
import shlex
import sys
from collections.abc import Callable, Generator, Iterator, Sequence
from dataclasses import replace
from datetime import datetime, timezone
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stickslip_monitor import __version__
from stickslip_monitor.bags.reader import stamp_of
from stickslip_monitor.commands.arguments import chosen
from stickslip_monitor.commands.check_results import Found, Task, attempt, failed, to_text, wrapped
from stickslip_monitor.commands.declared import ending, say_written, write_outputs
from stickslip_monitor.commands.output import ProgressBar, json_text, line_width, print_json
from stickslip_monitor.errors import (
    BagError,
    ConfigurationError,
    OutputError,
    StickslipError,
    cause,
    plural,
    program_fault,
)
from stickslip_monitor.files import open_file, printable
from stickslip_monitor.monitor.config import MonitorConfig
from stickslip_monitor.physics.friction import Stribeck

if TYPE_CHECKING:
    from stickslip_monitor.lab.calibration.recordings import EvidenceSource

Keep = Callable[[str, dict[str, Any]], None]


def check_bags(
    args: argparse.Namespace, bags: Sequence[Path], meter: ProgressBar, shown: str | None = None
) -> int:
    """Check bags, and print and write what came of them in the order in which they are asked for.

    Args:
        args: What is to be printed and written.
        bags: The recordings.
        meter: Shows how far the work is.
        shown: What the only bag is called, where its path means nothing to anybody.

    Returns:
        The exit code: 1 after a warning, 2 after a bag that could not be checked.
    """
    task = _task(args, len(bags))
    # A folder's bags are a list, even where it holds one only.
    listed = len(bags) > 1 or bags != [Path(path) for path in args.bags]
    all_found = []
    for found in _check_all(task, bags, args, meter):
        _tell(found, args, listed, shown)
        all_found.append(found)
    documents = [found.document for found in all_found]
    code = max(found.code for found in all_found)
    if not listed and 'error' in documents[0]:
        return code
    if task.learn is not None:
        lessons = _lessons(args, task, all_found, meter)
        for document in documents:
            # All teach it.
            document['learned'] = lessons
        if not args.json:
            sys.stdout.writelines(f'learned: {printable(text)}\n' for text in lessons)
    text = json_text(documents if listed else documents[0])
    write_outputs(args, report=lambda: _report(args, task, all_found, text))
    if args.mcap is not None:
        say_written(args.mcap)
    sys.stdout.write(text if args.json else _tolerance_advice(task.config))
    return code


def _task(args: argparse.Namespace, count: int) -> Task:
    """What the arguments want of each of some bags."""
    config = chosen(args)
    if args.mcap is not None:
        if count > 1:
            raise BagError(f"recording of verdicts '{args.mcap}' is for one bag, not {count}")
        from stickslip_monitor.offline.verdict_bag import check_target

        check_target(args.mcap)
    report = ending(args.report, args.files.writes['report']) if args.report else None
    return Task(config, report, args.mcap, args.clips, _source(args.learn, config))


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


def _report(
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
    args: argparse.Namespace, task: Task, all_found: Sequence[Found], meter: ProgressBar
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
        output = f'{own.name}.calibration.json'
        command = shlex.join([*line, '--bearing', own.name, '--output', output])
        known = [each.evidence[own.name] for each in all_found if own.name in each.evidence]
        lessons += learned(own, task.learn, known, command, show)
    meter.hide()
    return lessons


def _check_all(
    task: Task, bags: Sequence[Path], args: argparse.Namespace, meter: ProgressBar
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
            told = ((key, Found(known[key])) for key in by_key if key in known)
            for count, (key, outcome) in enumerate(itertools.chain(told, arriving), 1):
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
    calls: dict[str, tuple[Task, Path]], args: argparse.Namespace, meter: ProgressBar
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

        keys, jobs = list(calls), args.jobs or core_count()
        with contextlib.closing(run_in_processes(attempt, list(calls.values()), jobs)) as arriving:
            for place, outcome in arriving:
                yield keys[place], outcome


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
