# SPDX-License-Identifier: Apache-2.0
"""Many bags at once: on the cores of this machine, or on a cluster's."""

from __future__ import annotations

import argparse
import contextlib
import itertools
import json
from collections.abc import Generator, Mapping, Sequence
from concurrent.futures.process import BrokenProcessPool
from dataclasses import replace
from pathlib import Path
from typing import IO, Any

from stickslip_monitor.commands.check_jobs import Found, Output, Task, attempt, failed, key_of
from stickslip_monitor.commands.output import ProgressBar
from stickslip_monitor.errors import OutputError, StickslipError, cause, program_fault
from stickslip_monitor.offline.archive import stamp_of
from stickslip_monitor.offline.fleet import connected, on_cluster
from stickslip_monitor.offline.processes import core_count, run_in_processes

Arriving = Generator[tuple[int, Any], None, None]


def check_many(
    task: Task, bags: Sequence[Path], args: argparse.Namespace, output: Output, meter: ProgressBar
) -> None:
    """Check bags and hand what came of each to the output, in order.

    Args:
        task: What is wanted of every bag.
        bags: The bags.
        args: Where to do it.
        output: Where to put it.
        meter: Told how far it is.
    """
    if args.scheduler is not None:
        bags = [bag.absolute() for bag in bags]
    stamps = [stamp_of(bag) for bag in bags]
    sizes = [max(1, sum(size for _, size, _ in stamp)) for stamp in stamps]
    keys = [key_of(task, bag, stamp) for bag, stamp in zip(bags, stamps, strict=True)]
    kept = KeptResults(args.resume)
    known = [number for number, key in enumerate(keys) if key in kept.documents]
    left = [number for number in range(len(bags)) if keys[number] not in kept.documents]
    count, done = 0, 0
    waiting: dict[int, Found] = {}
    calls = {keys[number]: (task, bags[number]) for number in left}
    if args.scheduler is not None:
        arriving = _on_cluster(args.scheduler, calls, left, keys)
    else:
        arriving = _on_cores(args.jobs or core_count(), [calls[keys[n]] for n in left], meter)
    following = 0
    with contextlib.closing(arriving), contextlib.closing(kept):
        known_first = ((n, Found(kept.documents[keys[n]])) for n in known)
        of_left = ((left[n], outcome) for n, outcome in arriving)
        for number, outcome in itertools.chain(known_first, of_left):
            count, done = count + 1, done + sizes[number]
            waiting[number] = _found(task, bags[number], outcome)
            kept.add(keys[number], waiting[number])
            if following in waiting:
                meter.hide()
            while following in waiting:
                output.take(waiting.pop(following))
                following += 1
            meter.show(f'{count} of {len(bags)} bags', done, sum(sizes))


def _found(task: Task, bag: Path, outcome: Any) -> Found:
    if isinstance(outcome, BrokenProcessPool):
        return failed(task, bag, 'the process that checked it died (was there enough memory?)')
    if isinstance(outcome, MemoryError):
        return failed(task, bag, 'there is not enough memory for it')
    if isinstance(outcome, StickslipError | OSError):
        return failed(task, bag, cause(outcome))
    if isinstance(outcome, BaseException):
        return replace(failed(task, bag, program_fault(outcome)), faulty=True)
    assert isinstance(outcome, Found)
    return outcome


def _on_cores(jobs: int, calls: Sequence[tuple[Task, Path]], meter: ProgressBar) -> Arriving:
    if jobs == 1:
        return ((number, attempt(*call, meter.show)) for number, call in enumerate(calls))
    return run_in_processes(attempt, calls, jobs)


def _on_cluster(
    address: str, calls: Mapping[str, tuple[Task, Path]], left: Sequence[int], keys: Sequence[str]
) -> Arriving:
    numbers = {keys[number]: place for place, number in enumerate(left)}
    with connected(address) as client:
        for key, outcome in on_cluster(client, attempt, calls):
            yield numbers[key], outcome


class KeptResults:
    """What was found of bags, a line of JSON for each, kept from one run to the next.

    A result is known again by what it depends on: version, configuration, path, and size and time
    of each file. Bags that could not be checked are tried anew, and a line that was cut off by a
    loss of power is no result.

    Args:
        path: The file, which need not be there yet; ``None`` keeps nothing.

    Attributes:
        documents: What is known already, by key.

    Raises:
        OutputError: The file cannot be read or written, or is something else.
    """

    def __init__(self, path: str | None) -> None:
        self.documents: dict[str, dict[str, Any]] = {}
        self._file: IO[str] | None = None
        if path is None:
            return
        try:
            text = Path(path).read_text('utf-8') if Path(path).exists() else ''
            self._file = Path(path).open('a', encoding='utf-8')  # noqa: SIM115, closed by close
            self._file.write('' if text.endswith('\n') or not text else '\n')
        except (OSError, ValueError) as error:
            raise OutputError(f"results '{path}' cannot be kept: {error}") from None
        for line in text.splitlines():
            with contextlib.suppress(ValueError, KeyError, TypeError):
                record = json.loads(line)
                self.documents[record['key']] = record['found']
        if text.strip() and not self.documents:
            self._file.close()
            raise OutputError(f"file '{path}' holds no results of 'check --resume': it is kept")

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
