# SPDX-License-Identifier: Apache-2.0
"""Ten minutes of telemetry at 1 kHz to the node, a day at 100 Hz in haste to the monitor."""

from __future__ import annotations

import json
import math
import os
import re
import subprocess
import sys
import time
from pathlib import Path

from benchmarks.live import start_subjects
from benchmarks.reference import CONFIG, LOAD
from benchmarks.table import Table
from stickslip_monitor.monitor.parameter_file import load_config
from stickslip_monitor.monitor.sample_types import Input
from stickslip_monitor.monitor.session import Moment, NoLog, Session, Sink

RATE, SECONDS, SHORT = 1000.0, 600.0, 10.0
DAY_RATE, HOUR, HOURS = 100, 3600, 24
_SETTLED = 90.0


def run(quick: bool) -> Table:
    """Feed both; a short run lasts ten seconds, and an hour."""
    row = _soak_node(SHORT if quick else SECONDS)
    hours = 1 if quick else HOURS
    command = [sys.executable, '-m', 'benchmarks.soak', str(hours)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    day = json.loads(done.stdout)
    return Table(
        title='Over a long time',
        text=(
            'The node at 1 kHz; the monitor with its alarms over hours at 100 Hz, as fast as it takes'
            ' them. Memory: settled, and at the end.'
        ),
        columns=('what', 'lasts', 'samples', 'lost', 'CPU', 'memory', 'at the end'),
        rows=[row, ['the monitor, in haste', f'{hours} h', *day]],
    )


def _soak_node(seconds: float) -> list[str]:
    with start_subjects(150 + os.getpid() % 50) as nodes:
        nodes.pop('bare').stop()
        node = nodes['monitor']
        node.measure(RATE, min(_SETTLED, seconds))
        memory_before = memory(node.process.pid)
        measurement = node.measure(RATE, seconds)
        memory_after = memory(node.process.pid)
    sent, lost = f'{2 * measurement.sent}', f'{measurement.lost}'
    cpu = f'{measurement.cpu:.0%}'
    return [
        'the node',
        f'{seconds:g} s',
        sent,
        lost,
        cpu,
        f'{memory_before:.1f} MB',
        f'{memory_after:.1f} MB',
    ]


def _soak_monitor(hours: int) -> list[str]:
    """Run a monitor in this process through some hours of telemetry."""
    config = load_config(CONFIG)
    (name,) = (bearing.name for bearing in config.bearings)
    session = Session(config, Sink(), NoLog(), lambda: 0)
    session.begin()
    step_ns = 10**9 // (2 * DAY_RATE)
    begin, memory_before, count = time.process_time(), 0.0, 2 * DAY_RATE * HOUR * hours
    for number in range(1, count + 1):
        which, time_ns = number % 2, number * step_ns
        rpm = 40.0 - 25.0 * math.sin(4e-9 * math.pi * time_ns / HOUR)
        value = LOAD + number % 7 if which == Input.LOAD else rpm
        now = Moment(time_ns, time_ns)
        session.take(name, which, time_ns, value, now)
        if number % (2 * DAY_RATE) == 0:
            session.tick(now, time_ns)
        if number == count // (4 * hours):
            memory_before = memory(os.getpid())
    spent, memory_after = time.process_time() - begin, memory(os.getpid())
    lost = count - int(session.monitor.bearings[name].counts[:, 0].sum())
    return [
        str(count),
        str(lost),
        f'{1e6 * spent / count:.0f} µs a sample',
        f'{memory_before:.1f} MB',
        f'{memory_after:.1f} MB',
    ]


def memory(pid: int) -> float:
    """Memory that a process has at this moment [MB]."""
    status = Path(f'/proc/{pid}/status').read_text('utf-8')
    (kilobytes,) = re.findall(r'^VmRSS:\s+(\d+) kB$', status, flags=re.MULTILINE)
    return int(kilobytes) * 1.024e-3


if __name__ == '__main__':
    print(json.dumps(_soak_monitor(int(sys.argv[1]))))
