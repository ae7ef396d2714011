# SPDX-License-Identifier: Apache-2.0
"""Calls spread over processes, with functions of the standard library: they go by their names."""

from __future__ import annotations

import math
import multiprocessing
import operator
import os
import subprocess
import sys
import time
from concurrent.futures.process import BrokenProcessPool

from stickslip_monitor.offline.archive import core_count, run_in_processes


def test_every_call_is_done_once_and_failures_are_their_own() -> None:
    calls = [(2.0,), (-1.0,), (9.0,), (16.0,)]
    found = list(run_in_processes(math.sqrt, dict(enumerate(calls)), 2))
    assert sorted(number for number, _ in found) == [0, 1, 2, 3]
    outcome = dict(found)
    assert [outcome[0], outcome[2], outcome[3]] == [math.sqrt(2.0), 3.0, 4.0]
    assert isinstance(outcome[1], ValueError)


def test_a_process_that_dies_costs_its_own_call_only() -> None:
    # One ends its process at once, while the others are at work or wait.
    death, work = 'import os; os._exit(9)', 'import time; time.sleep(0.1)'
    calls = [(death if number == 3 else work,) for number in range(7)]
    found = list(run_in_processes(exec, dict(enumerate(calls)), 2))
    assert sorted(number for number, _ in found) == list(range(7))
    outcome = dict(found)
    assert isinstance(outcome.pop(3), BrokenProcessPool)
    assert set(outcome.values()) == {None}


def test_work_that_is_broken_off_leaves_no_process() -> None:
    before = multiprocessing.active_children()
    arriving = run_in_processes(time.sleep, {0: (0.0,), 1: (600.0,), 2: (600.0,)}, 2)
    assert next(arriving) == (0, None)
    arriving.close()
    assert multiprocessing.active_children() == before


def test_cores_are_those_that_may_be_used() -> None:
    code = 'import os; os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})\n'
    code += 'from stickslip_monitor.offline.archive import core_count; print(core_count())'
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=True)
    assert done.stdout == '1\n'
    assert core_count() == operator.length_hint(os.sched_getaffinity(0))
