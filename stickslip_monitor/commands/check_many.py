# SPDX-License-Identifier: Apache-2.0
"""Many bags at once: on the cores of this machine, or on a cluster's."""

from __future__ import annotations

import argparse
import contextlib
from collections.abc import Generator, Sequence
from concurrent.futures.process import BrokenProcessPool
from dataclasses import replace
from pathlib import Path
from typing import Any

from stickslip_monitor.commands.check_jobs import Found, Output, Task, attempt, failed, key_of
from stickslip_monitor.commands.output import ProgressBar
from stickslip_monitor.errors import StickslipError, cause, program_fault
from stickslip_monitor.offline.archive import Stamp, stamp_of
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
    count, done = 0, 0
    waiting: dict[int, Found] = {}
    if args.scheduler is not None:
        arriving = _on_cluster(args.scheduler, task, bags, stamps)
    else:
        arriving = _on_cores(args.jobs or core_count(), task, bags, meter)
    following = 0
    with contextlib.closing(arriving):
        for number, outcome in arriving:
            count, done = count + 1, done + sizes[number]
            waiting[number] = _found(task, bags[number], outcome)
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


def _on_cores(jobs: int, task: Task, bags: Sequence[Path], meter: ProgressBar) -> Arriving:
    if jobs == 1:
        return ((number, attempt(task, bag, meter.show)) for number, bag in enumerate(bags))
    return run_in_processes(attempt, [(task, bag) for bag in bags], jobs)


def _on_cluster(
    address: str, task: Task, bags: Sequence[Path], stamps: Sequence[Stamp]
) -> Arriving:
    keys = [key_of(task, bag, stamp) for bag, stamp in zip(bags, stamps, strict=True)]
    calls = {key: (task, bag) for key, bag in zip(keys, bags, strict=True)}
    numbers = {key: number for number, key in enumerate(keys)}
    with connected(address) as client:
        for key, outcome in on_cluster(client, attempt, calls):
            yield numbers[key], outcome
