# SPDX-License-Identifier: Apache-2.0
"""What the parts of ``stickslip check`` cost: over a day, and from 1e4 to 1e7 messages.

The telemetry is a speed and the loads of two bearings at 10 Hz each: 2.6 million messages a day.
Each length is measured in a process of its own, so that its memory is its own.
"""

from __future__ import annotations

import argparse
import json
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.table import Table, duration, ratio
from stickslip_monitor.bags.reader import Request, open_bag
from stickslip_monitor.bags.writer import BagWriter
from stickslip_monitor.commands.check_results import to_json, to_text
from stickslip_monitor.monitor.assessment import assess
from stickslip_monitor.monitor.config_file import load_config
from stickslip_monitor.offline.check import check_bag
from stickslip_monitor.offline.follow import scan_whole

ROOT = Path(__file__).resolve().parents[1]
CONFIG = ROOT / 'launch_configs' / 'two_bearings.yaml'
SPEED, *LOADS = '/shaft/speed', '/bearing/aft_stern/load', '/bearing/fore_stern/load'
DAY = 3 * 864_000
LENGTHS = (10_000, 100_000, 1_000_000, DAY, 10_000_000)
STEP_NS = 100_000_000


def run(quick: bool) -> Table:
    """Measure and tabulate."""
    lengths = LENGTHS[:3] if quick else LENGTHS
    with tempfile.TemporaryDirectory() as folder:
        found = {messages: _measured(Path(folder), messages) for messages in lengths}
    start = _start()
    rows = [_row(messages, parts) for messages, parts in found.items()]
    return Table(
        title='Checking a day',
        text=(
            'A speed and the loads of two bearings, 10 Hz each, zstd; the shaft passes slowly'
            ' through the stick-slip region every six hours. The parts are processor time of all'
            ' threads; the whole is wall time, beside that of reading the same topics as arrays'
            ' and doing nothing with them. Start-up (`stickslip check --help`) takes'
            f' {duration(start)} and is not in the table.'
        ),
        columns=(
            'messages', 'reading', 'physics', 'pairing and alarm', 'output',
            'whole', 'reading alone', 'ratio', 'peak memory',
        ),
        rows=rows,
        notes='2.59 million messages are a day. Memory includes Python and its libraries.',
    )  # fmt: skip


def _row(messages: int, parts: dict[str, float]) -> list[str]:
    names = ('reading', 'physics', 'alarm', 'output', 'whole', 'alone')
    return [
        f'{messages / 1e6:.3g} million',
        *(duration(parts[name]) for name in names),
        ratio(parts['whole'] / parts['alone']),
        f'{parts["memory"] / 1e6:.0f} MB',
    ]


def _measured(folder: Path, messages: int) -> dict[str, float]:
    path = folder / f'{messages}.mcap'
    make(path, messages)
    command = [sys.executable, '-m', 'benchmarks.check_day', '--measure', str(path)]
    done = subprocess.run(command, cwd=ROOT, stdout=subprocess.PIPE, text=True, check=True)
    path.unlink()
    return json.loads(done.stdout)


def make(path: Path, messages: int) -> None:
    """Write a recording of that many messages."""
    size, rng = -(-messages // 3), np.random.default_rng(1)
    seconds = np.arange(size) * STEP_NS * 1e-9
    stamps = 1_777_874_400_000_000_000 + np.arange(size, dtype=np.int64) * STEP_NS
    slow = 40.0 * np.exp(-(((seconds % 21_600.0 - 10_000.0) / 300.0) ** 2))
    rpm = 70.0 + 10.0 * np.sin(2e-4 * seconds) - slow + rng.normal(0.0, 0.3, size)
    with BagWriter(path) as writer:
        for topic in (SPEED, *LOADS):
            writer.add_topic(topic, 'std_msgs/msg/Float64')
        columns = {SPEED: (stamps, rpm)}
        for late, topic in enumerate(LOADS, 1):
            load = 1000.0 - 200.0 * late + rng.normal(0.0, 5.0, size)
            columns[topic] = (stamps + late * 3_000_000, load)
        writer.write_float64s(columns)


def measure(path: Path) -> dict[str, float]:
    """Seconds of each part, and the most memory used [bytes]."""
    config = load_config(CONFIG)
    requests = {Request(topic, 'data') for topic in (SPEED, *LOADS)}
    small = ROOT / 'bags' / 'two_bearings'
    to_json(check_bag(small, config))  # what is built or imported once
    begin = time.perf_counter()
    open_bag(path).read(requests)
    alone = time.perf_counter() - begin
    begin, spent = time.perf_counter(), time.process_time()
    report = check_bag(path, config)
    checking = time.process_time() - spent
    # Reading, in processor time, and the output need the bag and the verdicts as they are.
    output = _processor_time(lambda: to_text(to_json(report), coloured=False))
    whole = time.perf_counter() - begin
    memory = _most_memory()
    reading = _processor_time(lambda: open_bag(path).read(requests))
    physics = 0.0
    scans = scan_whole(path, config).bearings
    for own in config.bearings:
        points = scans[own.name].scan.assessment
        physics += _processor_time(partial(assess, own.bearing, points.speed, points.load))
    return {
        'reading': reading,
        'physics': physics,
        'alarm': checking - reading - physics,
        'output': output,
        'whole': whole,
        'alone': alone,
        'memory': memory,
    }


def _most_memory() -> float:
    """Of this program [bytes]; what getrusage tells counts the process that started it, too."""
    status = Path('/proc/self/status').read_text('utf-8')
    (kilobytes,) = re.findall(r'^VmHWM:\s+(\d+) kB$', status, flags=re.MULTILINE)
    return 1024.0 * float(kilobytes)


def _processor_time(work: Callable[[], object]) -> float:
    begin = time.process_time()
    work()
    return time.process_time() - begin


def _start() -> float:
    """Wall time of a command that does nothing but start, the best of five [s]."""
    command = [sys.executable, '-m', 'stickslip_monitor.cli', 'check', '--help']
    best = float('inf')
    for _ in range(5):
        begin = time.perf_counter()
        subprocess.run(command, cwd=ROOT, stdout=subprocess.DEVNULL, check=True)
        best = min(best, time.perf_counter() - begin)
    return best


def main(argv: Sequence[str] | None = None) -> int:
    """Print the table; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--quick', action='store_true', help='up to a million messages')
    parser.add_argument('--measure', metavar='BAG', type=Path, help=argparse.SUPPRESS)
    args = parser.parse_args(argv)
    if args.measure is not None:
        print(json.dumps(measure(args.measure)))
    else:
        print(run(args.quick).markdown())
    return 0


if __name__ == '__main__':
    sys.exit(main())
