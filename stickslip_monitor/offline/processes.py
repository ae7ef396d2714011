# SPDX-License-Identifier: Apache-2.0
"""Calls spread over processes on this machine; one that dies costs its own call only."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from typing import Any


def core_count() -> int:
    """Cores that this process may use."""
    if hasattr(os, 'sched_getaffinity'):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def run_in_processes(
    function: Callable[..., Any], calls: Sequence[tuple[Any, ...]], jobs: int
) -> Generator[tuple[int, Any], None, None]:
    """Call a function many times, in several processes at once.

    Args:
        function: It and its arguments can be pickled: processes are started afresh, not forked.
        calls: The arguments of each call.
        jobs: Processes at a time.

    Yields:
        The number of each call, as it is done, and its result or the exception it raised;
        a ``BrokenProcessPool`` where its process died.
    """
    waiting = dict(enumerate(calls))
    while waiting:
        for number, outcome in _together(function, waiting, jobs):
            if not isinstance(outcome, BrokenProcessPool):
                del waiting[number]
                yield number, outcome
        # A process that dies takes all calls along that were waiting. The one that it died of was
        # running, so it is among the oldest: alone in a process, each of these shows what it does.
        for number in list(waiting)[: jobs + 1]:
            yield from _together(function, {number: waiting.pop(number)}, 1)


def _together(
    function: Callable[..., Any], calls: dict[int, tuple[Any, ...]], jobs: int
) -> Generator[tuple[int, Any], None, None]:
    """Call in one pool."""
    with _pool(min(jobs, len(calls))) as pool:
        with _uninterrupted():
            futures = {pool.submit(function, *call): number for number, call in calls.items()}
        for future in as_completed(futures):
            error = future.exception()
            # Whoever takes it decides how long it is kept.
            yield futures.pop(future), future.result() if error is None else error
            del future, error


@contextlib.contextmanager
def _pool(jobs: int) -> Iterator[ProcessPoolExecutor]:
    """A pool that goes at once, with its processes, when the work is broken off."""
    others = multiprocessing.active_children()
    # Forking a process that has threads (numpy's, a progress bar's) may leave it hanging.
    pool = ProcessPoolExecutor(jobs, mp_context=multiprocessing.get_context('spawn'))
    try:
        yield pool
    except BaseException:
        for process in multiprocessing.active_children():
            if process not in others:
                process.terminate()
        raise
    finally:
        pool.shutdown(cancel_futures=True)


@contextlib.contextmanager
def _uninterrupted() -> Iterator[None]:
    """Processes started here leave Ctrl-C, which reaches a whole terminal, to this one."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
