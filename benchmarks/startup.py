# SPDX-License-Identifier: Apache-2.0
"""How long a command takes to start: help, and the check of a small bag."""

from __future__ import annotations

import resource
import statistics
import subprocess
import sys
import time

from benchmarks.reference import CONFIG
from benchmarks.table import Table, duration

BAG = CONFIG.parents[1] / 'bags' / 'coast_down'
_STICKSLIP = ('-c', 'import sys; from stickslip_monitor.cli import main; sys.exit(main())')
_COMMANDS: dict[str, tuple[str, ...]] = {
    'Python': ('-c', 'pass'),
    'import numpy': ('-c', 'import numpy'),
    'import scipy.special': ('-c', 'import scipy.special'),
    '`stickslip --help`': (*_STICKSLIP, '--help'),
    '`stickslip check --help`': (*_STICKSLIP, 'check', '--help'),
    '`stickslip check` of 28 s': (*_STICKSLIP, 'check', str(BAG), '--config', str(CONFIG)),
}


def run(quick: bool) -> Table:
    """Run the commands in turns."""
    found: dict[str, list[tuple[float, float]]] = {name: [] for name in _COMMANDS}
    for _ in range(3 if quick else 15):
        for name, arguments in _COMMANDS.items():
            found[name].append(_once(arguments))
    rows = []
    for name, times in found.items():
        walls, processor = ([pair[k] for pair in times] for k in (0, 1))
        rows.append(
            [
                name,
                duration(min(processor)),
                duration(statistics.median(processor)),
                duration(min(walls)),
                duration(statistics.median(walls)),
            ]
        )
    return Table(
        title='Start-up',
        text=(
            'A command from its start to its end, beside Python itself and the libraries it uses;'
            ' processor time of all threads, and wall time.'
        ),
        columns=('command', 'CPU, best', 'CPU, median', 'wall, best', 'wall, median'),
        rows=rows,
    )


def _once(arguments: tuple[str, ...]) -> tuple[float, float]:
    """Wall and processor time of a run of Python [s]."""
    before, begin = _processor(), time.perf_counter()
    subprocess.run([sys.executable, *arguments], stdout=subprocess.DEVNULL, check=False)
    return time.perf_counter() - begin, _processor() - before


def _processor() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime
