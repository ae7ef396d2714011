# SPDX-License-Identifier: Apache-2.0
"""Calls spread over processes on this machine, or over a Dask cluster. Nothing else knows Dask.

One that dies costs its own call only.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import multiprocessing
import os
import platform
import signal
import threading
from collections.abc import Callable, Generator, Iterator, Mapping
from concurrent.futures import CancelledError, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING, Any, TypeVar

from stickslip_monitor import __version__
from stickslip_monitor.errors import FleetError

if TYPE_CHECKING:
    from distributed import Client, Future

_Key = TypeVar('_Key')


def core_count() -> int:
    """Cores that this process may use."""
    if hasattr(os, 'sched_getaffinity'):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def run_in_processes(
    function: Callable[..., Any], calls: Mapping[_Key, tuple[Any, ...]], jobs: int
) -> Generator[tuple[_Key, Any], None, None]:
    """Call a function many times, in several processes at once.

    Args:
        function: It and its arguments can be pickled: processes are started afresh, not forked.
        calls: The arguments of each call, by a key.
        jobs: Processes at a time.

    Yields:
        The key of each call, as it is done, and its result or the exception it raised;
        a ``BrokenProcessPool`` where its process died.
    """
    waiting = dict(calls)
    while waiting:
        for key, outcome in _together(function, waiting, jobs):
            if not isinstance(outcome, BrokenProcessPool):
                del waiting[key]
                yield key, outcome
        # A process that dies takes all calls along that were waiting. The one that it died of was
        # running, so it is among the oldest: alone in a process, each of these shows what it does.
        for key in list(waiting)[: jobs + 1]:
            yield from _together(function, {key: waiting.pop(key)}, 1)


def _together(
    function: Callable[..., Any], calls: Mapping[_Key, tuple[Any, ...]], jobs: int
) -> Generator[tuple[_Key, Any], None, None]:
    """Call in one pool."""
    with _pool(min(jobs, len(calls))) as pool:
        with _uninterrupted():
            futures = {pool.submit(function, *call): key for key, call in calls.items()}
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


_PATIENCE = 10.0
"""How long a scheduler may take to answer [s]."""
_LOOK = 60.0
"""How long to wait for a call before looking whether the cluster still has workers [s]."""
_NO_WORKER = 60.0
"""How long a cluster may be without any worker: one that died may be started again [s]."""
_GIVEN_UP = FleetError('every worker that did it died (was there enough memory?)')


@contextlib.contextmanager
def connected(address: str) -> Iterator[Client]:
    """A connection to a scheduler.

    Args:
        address: Where it is, ``tcp://host:port``.

    Raises:
        FleetError: Dask is not installed, the scheduler does not answer, or a worker has another
            version of this package, of Dask or of Python.
    """
    try:
        from distributed import Client
    except ImportError as error:
        raise FleetError(
            f"--scheduler needs Dask ({error}): install this package with the extra 'fleet'"
        ) from error
    _check_scheduler(address)
    # One sentence stands for what it would log, tracebacks and all.
    logging.getLogger('distributed.client').setLevel(logging.CRITICAL)
    client = Client(address, timeout=_PATIENCE, set_as_default=False)
    with client:
        _check_versions(client, address)
        yield client


def _check_scheduler(address: str) -> None:
    """Ask for the scheduler first: a client that does not find one is slow to say so and to go."""
    from distributed import Security, rpc

    async def kind() -> str:
        secured = Security().get_connection_args('client')
        async with rpc(address, connection_args=secured) as other:
            return str((await other.identity())['type'])

    try:
        found = asyncio.run(asyncio.wait_for(kind(), _PATIENCE))
    except asyncio.TimeoutError:
        reason = f'no answer in {_PATIENCE:g} s'
    except (OSError, ValueError, TypeError, RuntimeError) as error:
        reason = _line(error)
    else:
        if found == 'Scheduler':
            return
        reason = f'it is a {found} of Dask'
    raise FleetError(f"scheduler '{address}' cannot be reached: {reason}")


def versions() -> dict[str, str]:
    """What must be the same here and on every worker, for the same results."""
    import distributed

    python = '.'.join(platform.python_version_tuple()[:2])
    return {'stickslip_monitor': __version__, 'Dask': distributed.__version__, 'Python': python}


def _check_versions(client: Client, address: str) -> None:
    for worker, there in client.run(versions, on_error='return').items():
        place = f"worker {worker} of scheduler '{address}'"
        if isinstance(there, Exception):
            raise FleetError(f'{place} cannot run stickslip_monitor {__version__}: {_line(there)}')
        for name, version in versions().items():
            if there[name] != version:
                raise FleetError(
                    f'{place} has {name} {there[name]}, not {version} as here: verdicts are only'
                    ' the same with the same versions'
                )


def on_cluster(
    client: Client, function: Callable[..., Any], calls: Mapping[str, tuple[Any, ...]]
) -> Iterator[tuple[str, Any]]:
    """Call a pure function many times on the workers of a cluster.

    What a lost worker was doing, and results that were still with it, are done again by others.

    Args:
        client: The connection.
        function: It and its arguments can be pickled.
        calls: The arguments of each call, by a key that is equal only for equal calls.

    Yields:
        The key of each call, once, as it is done, and its result or the exception it raised.

    Raises:
        FleetError: The scheduler is lost, or has no worker any more.
    """
    from distributed import KilledWorker

    killed = []
    for key, outcome in _done(client, function, calls):
        if isinstance(outcome, KilledWorker):
            killed.append(key)
        else:
            yield key, outcome
    # Dask blames a worker's death on all that waited there: alone, each shows what it does.
    for key in killed:
        ((_, outcome),) = _done(client, function, {f'{key}-alone': calls[key]})
        yield key, _GIVEN_UP if isinstance(outcome, KilledWorker) else outcome


def _done(
    client: Client, function: Callable[..., Any], calls: Mapping[str, tuple[Any, ...]]
) -> Iterator[tuple[str, Any]]:
    """The key of each call, as it is done, and its result or exception."""
    arriving: SimpleQueue[Future] = SimpleQueue()
    # Results are dropped on the cluster as soon as nobody here holds their future.
    for key, call in calls.items():
        client.submit(function, *call, key=key).add_done_callback(arriving.put)
    left = len(calls)
    try:
        while left:
            try:
                future = arriving.get(timeout=_LOOK)
                outcome = future.result(_LOOK)
            except Empty:
                _require_worker(client, left)
                continue
            except CancelledError:
                raise
            except Exception as error:
                if isinstance(error, asyncio.TimeoutError) and future.status != 'error':
                    # The result was lost with its worker: it is worked out again.
                    arriving.put(future)
                    _require_worker(client, left)
                    continue
                outcome = error
            left -= 1
            yield future.key, outcome
    except CancelledError as error:
        raise FleetError(
            f"scheduler '{client.scheduler.address}' was lost with {left} calls to do"
        ) from error


def _require_worker(client: Client, left: int) -> None:
    """Wait for somebody who may do what is left: without workers Dask waits for ever."""
    try:
        client.wait_for_workers(1, timeout=_NO_WORKER)
    except asyncio.TimeoutError:
        raise FleetError(
            f"scheduler '{client.scheduler.address}' has no worker, with {left} calls to do"
        ) from None
    except OSError:
        pass  # the scheduler is gone: the client cancels what waits


def _line(error: BaseException) -> str:
    return ' '.join(str(error).split()) or type(error).__name__
