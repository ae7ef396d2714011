# SPDX-License-Identifier: Apache-2.0
"""Spreads calls over processes on this machine, or over a Dask cluster. Nothing else knows Dask.

A process that dies costs its own call only.
"""

from __future__ import annotations

import contextlib
import gc
import logging
import multiprocessing
import os
import platform
import signal
import sys
import threading
from collections.abc import Callable, Generator, Iterator, Mapping
from concurrent.futures import BrokenExecutor, CancelledError, Executor, ProcessPoolExecutor, as_completed
from contextlib import AbstractContextManager
from typing import Any, TypeVar

from stickslip_monitor import __version__
from stickslip_monitor.errors import FleetError

_Key = TypeVar('_Key')
Pool = Callable[[int], AbstractContextManager[Executor]]
"""Opens an executor with up to a number of workers."""
_PATIENCE = 10.0
"""How long a scheduler may take to answer [s]."""
_MAX_WORKERLESS = 60.0
"""A cluster may be without any worker for so long: one that died may be started again [s]."""


def core_count() -> int:
    """Return the number of cores that this process may use."""
    if hasattr(os, 'sched_getaffinity'):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def has_died(outcome: object) -> bool:
    """Return whether an outcome is the exception of a worker that died, in this call or in another one."""
    dask = sys.modules.get('distributed')
    return isinstance(outcome, BrokenExecutor if dask is None else (BrokenExecutor, dask.KilledWorker))


def spread(
    pool: Pool, function: Callable[..., Any], calls: Mapping[_Key, tuple[Any, ...]], jobs: int
) -> Generator[tuple[_Key, Any], None, None]:
    """Call a function many times, several calls at once; yield outcomes in the order in which they are done.

    Calls that a dying worker took along are repeated, each alone.

    Args:
        pool: Opens an executor with a number of workers, as a context manager.
        function: It and its arguments can be pickled.
        calls: The arguments of each call, by a key.
        jobs: Calls at a time.

    Yields:
        The key of each call, and its result or the exception that it raised; :func:`has_died` is true of
        that where its worker died.

    Raises:
        FleetError: The scheduler is lost, or has had no worker for a minute.
    """
    waiting = dict(calls)
    while waiting:
        with pool(min(jobs, len(waiting))) as workers:
            for key, outcome in _completed_calls(workers, function, waiting):
                if not has_died(outcome):
                    del waiting[key]
                    yield key, outcome
        # A worker that dies takes calls along that were waiting. The one that it died of was
        # running, so it is among the oldest: alone, each of these shows what it does.
        for key in list(waiting)[: jobs + 1]:
            with pool(1) as workers:
                yield from _completed_calls(workers, function, {key: waiting.pop(key)})


def _completed_calls(
    workers: Executor, function: Callable[..., Any], calls: Mapping[_Key, tuple[Any, ...]]
) -> Iterator[tuple[_Key, Any]]:
    """Submit all calls; yield the key and the result or exception of each as it completes.

    Exceptions of the function are yielded, not raised.

    Raises:
        FleetError: The scheduler is lost, or has had no worker for a minute.
    """
    with _ignore_interrupts():
        futures = {workers.submit(function, *call): key for key, call in calls.items()}
    while futures:
        # The timeout is for all together: after it the cluster is checked for workers.
        with contextlib.suppress(TimeoutError):
            for future in as_completed(list(futures), _MAX_WORKERLESS):
                try:
                    error = future.exception()
                except CancelledError:
                    raise FleetError(f'the scheduler was lost with {len(futures)} to do') from None
                # No reference stays here, so that the caller can free the result.
                yield futures.pop(future), future.result() if error is None else error
                del future, error
        if futures and (client := getattr(workers, '_client', None)) is not None:
            try:
                client.wait_for_workers(1, timeout=_MAX_WORKERLESS)
            except (OSError, TimeoutError):
                raise FleetError(f'no worker is left, with {len(futures)} to do') from None


def _exit_with_parent() -> None:
    """Start a thread that ends this process as soon as its parent has ended, also where that was killed.

    To be called in a worker only.
    """
    parent = multiprocessing.parent_process()
    assert parent is not None, 'only a worker calls this'

    def wait() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=wait, daemon=True).start()


@contextlib.contextmanager
def open_processes(jobs: int) -> Iterator[Executor]:
    """Yield a pool of ``jobs`` spawned processes; an exception in the block terminates them at once.

    At the end calls that run are waited for, and those that have not begun are cancelled.
    """
    children = multiprocessing.active_children()
    # Forking a process that has threads (numpy's, a progress bar's) may leave it hanging.
    # A worker waits for calls on a pipe that it keeps open itself: without this it outlives a killed parent.
    pool = ProcessPoolExecutor(
        jobs, mp_context=multiprocessing.get_context('spawn'), initializer=_exit_with_parent
    )
    try:
        yield pool
    except BaseException:
        for process in multiprocessing.active_children():
            if process not in children:
                process.terminate()
        raise
    finally:
        pool.shutdown(cancel_futures=True)


@contextlib.contextmanager
def _ignore_interrupts() -> Iterator[None]:
    """Ignore Ctrl-C in this process within the block; workers started in it inherit that.

    Does nothing outside the main thread, which alone may set signal handlers.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def run_in_processes(
    function: Callable[..., Any], calls: Mapping[_Key, tuple[Any, ...]], jobs: int
) -> Generator[tuple[_Key, Any], None, None]:
    """Make calls as :func:`spread` does, in at most ``jobs`` spawned processes of this machine."""
    return spread(open_processes, function, calls, jobs)


def run_on_cluster(
    address: str, function: Callable[..., Any], calls: Mapping[_Key, tuple[Any, ...]]
) -> Generator[tuple[_Key, Any], None, None]:
    """Make calls as :func:`spread` does, and yield what it yields, on the workers of a Dask cluster.

    What Dask logs in this process is silenced from then on, but for critical messages.

    Args:
        address: Where its scheduler is, ``tcp://host:port``.
        function: It and its arguments can be pickled.
        calls: The arguments of each call, by a key.

    Raises:
        FleetError: Dask is not installed, the scheduler does not answer or is lost, or a worker
            has another version of this package, of Dask or of Python. Or no worker is there for a minute.
    """
    try:
        from distributed import Client
    except ImportError as error:
        raise FleetError(
            f"--scheduler needs Dask ({error}): install this package with the extra 'fleet'"
        ) from error
    place = f"scheduler '{address}'"
    # One sentence stands for what it would log, tracebacks and all.
    logging.getLogger('distributed').setLevel(logging.CRITICAL)
    client, fault = None, ''
    try:
        client = Client(address, timeout=_PATIENCE, set_as_default=False)
    except TypeError:  # a worker is asked as a scheduler is
        fault = 'cannot be used: it is another part of Dask'
    except (OSError, ValueError, RuntimeError) as error:
        fault = f'cannot be reached: {_error_line(error)}'
    if client is None:
        # What is left of it ends itself when collected, which hangs amid the next one's start.
        gc.collect()
        raise FleetError(f'{place} {fault}')
    with client:
        ours = versions()
        for worker, theirs in client.run(versions, on_error='return').items():
            if theirs != ours:
                raise FleetError(
                    f'worker {worker} of {place} has {_format_versions(theirs)},'
                    f' not {_format_versions(ours)} as here: verdicts are only the same with the'
                    ' same versions'
                )
        try:
            yield from spread(
                lambda _: contextlib.nullcontext(client.get_executor(pure=False)), function, calls, jobs=1000
            )
        except FleetError as error:
            raise FleetError(f'{place}: {error}') from None


def versions() -> dict[str, str]:
    """Return the versions, by name, that must be the same here and on every worker; Dask must be there."""
    import distributed

    python = '.'.join(platform.python_version_tuple()[:2])
    return {'stickslip_monitor': __version__, 'Dask': distributed.__version__, 'Python': python}


def _format_versions(versions_there: dict[str, str] | Exception) -> str:
    """Return the versions of a worker in words, or the line of the error that came instead of them."""
    if isinstance(versions_there, Exception):
        return _error_line(versions_there)
    return ', '.join(f'{name} {version}' for name, version in versions_there.items())


def _error_line(error: BaseException) -> str:
    """Return the message of an exception on one line, or the name of its type where it has none."""
    return ' '.join(str(error).split()) or type(error).__name__
