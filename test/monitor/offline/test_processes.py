# SPDX-License-Identifier: Apache-2.0
"""Calls on a real Dask cluster of two worker processes, one of which is killed in the middle."""

from __future__ import annotations

import json
import math
import multiprocessing
import operator
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing, suppress
from pathlib import Path
from threading import Thread
from typing import Any

import pytest
from shared import CONFIG, ROOT, until

from stickslip_monitor.cli import main
from stickslip_monitor.errors import FleetError
from stickslip_monitor.offline import processes
from stickslip_monitor.offline.processes import core_count, has_died, run_in_processes, run_on_cluster

distributed = pytest.importorskip('distributed')
dask = pytest.importorskip('dask')
LIMIT = 60.0


@pytest.fixture(scope='module')
def address() -> Iterator[str]:
    # A worker that dies is started again, and given up where that takes long: on a busy machine.
    with (
        dask.config.set({'distributed.deploy.lost-worker-timeout': '10 minutes'}),
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, dashboard_address=':0'
        ) as cluster,
    ):
        yield cluster.scheduler_address


def calls_begun(folder: Path) -> list[tuple[int, int]]:
    """Number and process of each call that was begun."""
    names = (path.name.split('_') for path in folder.glob('*_*'))
    return [(int(number), int(process)) for number, process, _ in names]


def squared_slowly(folder: Path) -> Callable[[int], int]:
    """Return a function that notes its beginning and waits for leave to end."""

    def square(number: int) -> int:
        # Nested, so that it goes to the workers as code: they do not know this file.
        import os
        from pathlib import Path

        Path(folder, f'{number}_{os.getpid()}_{time.monotonic_ns()}').touch()
        limit = time.monotonic() + 60.0
        while not Path(folder, 'leave').exists() and time.monotonic() < limit:
            time.sleep(0.01)
        return number * number

    return square


@pytest.mark.slow
def test_a_worker_killed_in_the_middle_loses_nothing_and_doubles_nothing(
    address: str, tmp_path: Path
) -> None:
    calls = {f'square-{number}-{tmp_path}': (number,) for number in range(20)}
    arriving = run_on_cluster(address, squared_slowly(tmp_path), calls)
    results: list[tuple[str, int]] = []
    reader = Thread(target=lambda: results.extend(arriving))
    reader.start()
    at_work = until(lambda: len({p for _, p in calls_begun(tmp_path)}) == 2 and calls_begun(tmp_path))
    number, victim = at_work[0]
    os.kill(victim, signal.SIGKILL)
    (tmp_path / 'leave').touch()
    reader.join(LIMIT)
    assert Counter(key for key, _ in results) == Counter(list(calls))
    assert dict(results) == {key: number**2 for key, (number,) in calls.items()}
    processes = [process for call, process in calls_begun(tmp_path) if call == number]
    # The call that was killed was begun again, by another process.
    assert processes.count(victim) == 1
    assert len(processes) > 1


def test_an_exception_is_the_outcome_of_its_call_alone(address: str) -> None:
    calls = {f'invert-{value}': (value,) for value in (2, 0, 4)}
    results = dict(run_on_cluster(address, lambda value: 1 / value, calls))
    assert (results['invert-2'], results['invert-4']) == (0.5, 0.25)
    assert isinstance(results['invert-0'], ZeroDivisionError)


@pytest.mark.slow
def test_a_bag_that_kills_every_worker_is_given_up(address: str) -> None:
    def die(number: int) -> int:
        import os
        import signal

        if number == 1:
            os.kill(os.getpid(), signal.SIGKILL)
        return number

    results = dict(run_on_cluster(address, die, {f'die-{n}': (n,) for n in range(3)}))
    assert (results['die-0'], results['die-2']) == (0, 2)
    assert has_died(results['die-1'])


def make_archive(folder: Path) -> list[Path]:
    """Recordings with and without warnings, one cut, and one that is none."""
    names = ('coast_down', 'voyage', 'two_bearings', 'history_above', 'cut_short')
    for name in names:
        shutil.copytree(ROOT / 'bags' / name, folder / name)
    (folder / 'broken').mkdir()
    (folder / 'broken' / 'broken_0.mcap').write_bytes(b'no recording')
    return sorted(folder.iterdir())


def check_as_json(capsys: pytest.CaptureFixture[str], *arguments: object) -> Any:
    assert main(['check', *map(str, arguments), '--config', str(CONFIG), '--json']) == 2
    return json.loads(capsys.readouterr().out)


@pytest.mark.slow
def test_an_archive_is_checked_as_on_this_machine(
    address: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bags = make_archive(tmp_path)
    on_cluster = check_as_json(capsys, tmp_path, '--scheduler', address)
    assert [document['path'] for document in on_cluster] == [str(bag) for bag in bags]
    assert [document['path'] for document in on_cluster if 'error' in document] == [str(bags[0])]
    assert on_cluster == check_as_json(capsys, tmp_path, '--jobs', 1)


# --- what goes wrong ---------------------------------------------------------------------------


def refusal_of_check(capsys: pytest.CaptureFixture[str], *arguments: object) -> str:
    bag = ROOT / 'bags' / 'voyage'
    assert main(['check', str(bag), '--config', str(CONFIG), *map(str, arguments)]) == 2
    printed = capsys.readouterr()
    assert printed.out == ''
    (line,) = printed.err.splitlines()
    return line


def test_a_scheduler_that_is_not_there_is_named(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(processes, '_PATIENCE', 0.5)
    with closing(socket.socket()) as occupied:
        # Bound but not listening: nobody answers, and nobody else gets the port.
        occupied.bind(('127.0.0.1', 0))
        address = f'tcp://127.0.0.1:{occupied.getsockname()[1]}'
        line = refusal_of_check(capsys, '--scheduler', address)
    assert line.startswith(f"ERROR: scheduler '{address}' cannot be reached: Timed out trying")
    assert 'known schemes' in refusal_of_check(capsys, '--scheduler', 'ftp://ship:1')
    assert "missing port number in address 'ship'" in refusal_of_check(capsys, '--scheduler', 'ship')


def test_a_worker_is_no_scheduler(address: str, capsys: pytest.CaptureFixture[str]) -> None:
    with distributed.Client(address, set_as_default=False) as client:
        client.wait_for_workers(1)
        (worker, *_) = client.scheduler_info()['workers']
    assert refusal_of_check(capsys, '--scheduler', worker).endswith('it is another part of Dask')


def test_another_version_on_the_workers_is_refused(
    address: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    # Here only: the workers are processes of their own.
    monkeypatch.setattr(processes, '__version__', '9.9')
    line = refusal_of_check(capsys, '--scheduler', address)
    assert re.search(
        r'worker \S+ of .* has stickslip_monitor 0\..*, not stickslip_monitor 9\.9, .* as here', line
    )


CLUSTER = """
import distributed, time
if __name__ == '__main__':
    cluster = distributed.LocalCluster(
        n_workers=1, processes=False, dashboard_address=None, protocol='tcp'
    )
    print(cluster.scheduler_address, flush=True)
    time.sleep(60)
"""


@pytest.mark.slow
def test_a_scheduler_that_goes_away_is_reported() -> None:
    def wait(seconds: float) -> float:

        time.sleep(seconds)
        return seconds

    with subprocess.Popen([sys.executable, '-c', CLUSTER], stdout=subprocess.PIPE, text=True) as cluster:
        try:
            address = cluster.stdout.readline().strip()
            arriving = run_on_cluster(address, wait, {'short': (0.0,), 'long': (60.0,)})
            assert next(arriving) == ('short', 0.0)
            cluster.kill()
            with pytest.raises(FleetError, match='the scheduler was lost with 1 to do'):
                next(arriving)
        finally:
            cluster.kill()


def test_a_cluster_without_workers_is_not_waited_for_for_ever(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(processes, '_MAX_WORKERLESS', 0.1)
    with (
        distributed.LocalCluster(
            n_workers=0, processes=False, dashboard_address=':0', protocol='tcp'
        ) as cluster,
        pytest.raises(FleetError) as caught,
    ):
        list(run_on_cluster(cluster.scheduler_address, abs, {'a': (-1,), 'b': (-2,)}))
    address = cluster.scheduler_address
    assert str(caught.value) == f"scheduler '{address}': no worker is left, with 2 to do"


def test_every_call_is_done_once_and_failures_are_their_own() -> None:
    calls = [(2.0,), (-1.0,), (9.0,), (16.0,)]
    results = list(run_in_processes(math.sqrt, dict(enumerate(calls)), 2))
    assert sorted(number for number, _ in results) == [0, 1, 2, 3]
    outcome = dict(results)
    assert [outcome[0], outcome[2], outcome[3]] == [math.sqrt(2.0), 3.0, 4.0]
    assert isinstance(outcome[1], ValueError)


def test_a_process_that_dies_costs_its_own_call_only() -> None:
    # One ends its process at once, while the others are at work or wait.
    death, work = 'import os; os._exit(9)', 'import time; time.sleep(0.1)'
    calls = [(death if number == 3 else work,) for number in range(7)]
    results = list(run_in_processes(exec, dict(enumerate(calls)), 2))
    assert sorted(number for number, _ in results) == list(range(7))
    outcome = dict(results)
    assert isinstance(outcome.pop(3), BrokenProcessPool)
    assert set(outcome.values()) == {None}


def test_work_that_is_broken_off_leaves_no_process() -> None:
    children = multiprocessing.active_children()
    arriving = run_in_processes(time.sleep, {0: (0.0,), 1: (600.0,), 2: (600.0,)}, 2)
    assert next(arriving) == (0, None)
    arriving.close()
    assert multiprocessing.active_children() == children


def test_workers_end_with_a_killed_parent() -> None:
    # One worker is at work, the other waits. Both hold the output: it ends with the last of them.
    code = 'import os, signal, time\n'
    code += 'from stickslip_monitor.offline.processes import open_processes\n'
    code += 'with open_processes(2) as pool:\n'
    code += '    pool.submit(time.sleep, 600.0)\n'
    code += '    print(pool.submit(os.getppid).result() == os.getpid(), flush=True)\n'
    code += '    os.kill(os.getpid(), signal.SIGKILL)\n'
    with subprocess.Popen(
        [sys.executable, '-c', code], stdout=subprocess.PIPE, text=True, start_new_session=True
    ) as parent:
        try:
            output, _ = parent.communicate(timeout=LIMIT)
        finally:
            with suppress(ProcessLookupError):
                os.killpg(parent.pid, signal.SIGKILL)
    assert output == 'True\n'
    assert parent.returncode == -signal.SIGKILL


def test_cores_are_those_that_may_be_used() -> None:
    code = 'import os; os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})\n'
    code += 'from stickslip_monitor.offline.processes import core_count; print(core_count())'
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=True)
    assert done.stdout == '1\n'
    assert core_count() == operator.length_hint(os.sched_getaffinity(0))
