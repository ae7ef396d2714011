# SPDX-License-Identifier: Apache-2.0
"""How time and memory of ``stickslip check`` grow with the length of a recording."""

from __future__ import annotations

import statistics
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from benchmarks.reference import CONFIG
from benchmarks.table import Table, duration
from stickslip_monitor.bags.writer import BagWriter

COUNTS = (10_000, 100_000, 1_000_000, 10_000_000)
RATE, PERIOD = 10.0, 6 * 3600.0
_TOPICS = ('/shaft/speed', '/bearing/aft_stern/load')
_PART = 100_000
# A small process starts the command: most memory counts that of whoever forks, too.
_LAUNCHER = """
import os, sys, time
begin = time.perf_counter()
quiet = [(os.POSIX_SPAWN_OPEN, 1, os.devnull, os.O_WRONLY, 0)]
child = os.posix_spawn(sys.argv[1], sys.argv[1:], os.environ, file_actions=quiet)
_, status, usage = os.wait4(child, 0)
print(os.waitstatus_to_exitcode(status), time.perf_counter() - begin, usage.ru_maxrss)
"""
_START = 1_700_000_000 * 10**9


def run(quick: bool) -> Table:
    """Check recordings that grow tenfold; a short run ends a decade earlier."""
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        idle = _median([_check(['--version'])] * 3)
        for count in COUNTS[: 3 if quick else 4]:
            path = Path(folder) / f'bag{count}'
            write(path, count)
            repeat = 1 if quick else 3
            command = ['check', '--config', str(CONFIG), '--json', str(path)]
            seconds, memory = _median([_check(command) for _ in range(repeat)])
            rows.append(
                [
                    f'1e{len(str(count)) - 1}',
                    f'{count / len(_TOPICS) / RATE / 3600.0:.3g} h',
                    duration(seconds),
                    duration((seconds - idle[0]) / count),
                    f'{memory / 2**20:.0f} MiB',
                    f'{(memory - idle[1]) / count:.0f} B',
                ]
            )
    return Table(
        title='Growth with the length of a recording',
        text=(
            f'`stickslip check --json` of speed and load at {RATE:g} Hz through all regimes, as a'
            f' process of its own: median wall time and most memory. Of a message: above'
            f' `stickslip --version`, which takes {duration(idle[0])} and'
            f' {idle[1] / 2**20:.0f} MiB.'
        ),
        columns=('messages', 'recorded', 'time', 'of a message', 'memory', 'of a message'),
        rows=rows,
        notes=_NOTES,
    )


def _median(runs: Sequence[tuple[float, float]]) -> tuple[float, float]:
    seconds, memory = zip(*runs, strict=True)
    return statistics.median(seconds), statistics.median(memory)


def write(path: Path, count: int) -> None:
    """Write speed and load at 10 Hz; the speed goes through all regimes, slowly."""
    generator = np.random.default_rng(1)
    each = count // len(_TOPICS)
    with BagWriter(path) as bag:
        for topic in _TOPICS:
            bag.add_topic(topic, 'std_msgs/msg/Float64')
        for first in range(0, each, _PART):
            index = np.arange(first, min(first + _PART, each))
            wave = np.sin(2.0 * np.pi * index / RATE / PERIOD)
            noise = generator.normal(scale=0.05, size=(2, index.size))
            values = (35.0 + 15.0 * wave + noise[0], 1000.0 + 100.0 * noise[1])
            time_ns = _START + (index * 1e9 / RATE).astype(np.int64)
            bag.write_float64s(
                {topic: (time_ns, value) for topic, value in zip(_TOPICS, values, strict=True)}
            )


def _check(arguments: Sequence[str]) -> tuple[float, float]:
    """Wall time [s] and most memory [B] of a command."""
    command = [sys.executable, '-m', 'stickslip_monitor.cli', *arguments]
    done = subprocess.run(
        [sys.executable, '-c', _LAUNCHER, *command], check=True, capture_output=True, text=True
    )
    code, seconds, kilobytes = done.stdout.split()
    if code not in ('0', '1') or done.stderr:
        raise RuntimeError(f'{" ".join(command)} ended with {code}: {done.stderr}')
    return float(seconds), float(kilobytes) * 1024.0


_NOTES = """\
Up to 1e5 messages start-up is all. From there time is in proportion, and so is memory: time,
stamp, place and value of each message, and speed, load and some ten columns of the verdict of each
evaluation, are kept until the events have been found."""
