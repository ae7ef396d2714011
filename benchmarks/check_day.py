# SPDX-License-Identifier: Apache-2.0
"""What ``stickslip check`` costs: over a day, and from 1e5 to 1e8 messages.

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
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.table import Table, duration, ratio
from stickslip_logs.recordings.reader import open_bag
from stickslip_logs.recordings.recording import Request
from stickslip_logs.recordings.writer import BagWriter
from stickslip_monitor.commands.check import to_text
from stickslip_monitor.monitor.parameter_file import load_config
from stickslip_monitor.monitor.parameters import MonitorConfig
from stickslip_monitor.offline.check import check_recording, to_json
from stickslip_monitor.offline.clip_folder import ClipFolder, ClipWriter
from stickslip_monitor.offline.verdict_messages import VerdictWriter

ROOT = Path(__file__).resolve().parents[1]
CONFIG = ROOT / 'launch_configs' / 'two_bearings.yaml'
SPEED, *LOADS = '/shaft/speed', '/bearing/aft_stern/load', '/bearing/fore_stern/load'
DAY = 3 * 864_000
LENGTHS = (100_000, 1_000_000, DAY, 10_000_000, 100_000_000)
STEP_NS = 100_000_000
RATCHET, MOST_TIMES, MOST_WRITING = 1_000_000, 2.4, 60.0
"""Messages from which on a check may take so many times reading, and with --mcap so many times a
check, processor time: 2.1 to 2.3 and 50 measured."""
# Messages that are made at a time, of each topic.
_BLOCK = 1_000_000


def run(quick: bool) -> Table:
    """Measure and tabulate."""
    lengths = LENGTHS[:2] if quick else LENGTHS
    with tempfile.TemporaryDirectory() as folder:
        measurements = {messages: _measure_apart(Path(folder), messages) for messages in lengths}
    for messages, parts in measurements.items():
        times = parts['check_cpu'] / parts['alone_cpu']
        if messages >= RATCHET and times > MOST_TIMES:
            raise RuntimeError(
                f'a check of {messages} messages takes {times:.2f} times reading them in processor'
                f' time, and at most {MOST_TIMES} are allowed'
            )
        writing = parts.get('mcap', 0.0) / parts['check_cpu']
        if messages >= RATCHET and writing > MOST_WRITING:
            raise RuntimeError(
                f'a check of {messages} messages with --mcap takes {writing:.0f} checks in processor'
                f' time, and at most {MOST_WRITING:.0f} are allowed'
            )
    return _make_table(measurements, _time_start())


def _make_table(measurements: dict[int, dict[str, float]], start: float) -> Table:
    return Table(
        title='Checking a day',
        text=(
            'A speed and the loads of two bearings, 10 Hz each, zstd; the shaft passes slowly'
            ' through the stick-slip region every six hours. Reading is that of the same topics as'
            ' arrays, doing nothing with them, in turns with the check; medians of three (of one'
            ' from 10 million messages on, and of 100 million in blocks that are dropped). The'
            ' ratios are check to reading, in wall time and in processor time of all threads: on a'
            ' busy machine the latter tells more. `--mcap` and `--clips` are the processor time'
            ' of a check with them. Memory is the greatest of the check'
            f' with Python and its libraries. Start-up (`stickslip check --help`) takes'
            f' {duration(start)} and is not in the table.'
        ),
        columns=(
            'messages',
            'reading',
            'check',
            'ratio',
            'reading, processor',
            'check, processor',
            'ratio',
            '--mcap',
            '--clips',
            'peak memory',
        ),
        rows=[_make_row(messages, parts) for messages, parts in measurements.items()],
    )


def _make_row(messages: int, parts: dict[str, float]) -> list[str]:
    return [
        f'{messages / 1e6:.3g} million',
        duration(parts['alone']),
        duration(parts['check']),
        ratio(parts['check'] / parts['alone']),
        duration(parts['alone_cpu']),
        duration(parts['check_cpu']),
        ratio(parts['check_cpu'] / parts['alone_cpu']),
        *(duration(parts[name]) if name in parts else '' for name in ('mcap', 'clips')),
        f'{parts["memory"] / 1e6:.0f} MB',
    ]


def _measure_apart(folder: Path, messages: int) -> dict[str, float]:
    path = folder / f'{messages}.mcap'
    write_recording(path, messages)
    command = [sys.executable, '-m', 'benchmarks.check_day', '--measure', str(path)]
    command += ['--messages', str(messages)]
    done = subprocess.run(command, cwd=ROOT, stdout=subprocess.PIPE, text=True, check=True)
    path.unlink()
    return json.loads(done.stdout)


def write_recording(path: Path, messages: int) -> None:
    """Write a recording of that many messages."""
    size = -(-messages // 3)
    with BagWriter(path) as writer:
        for topic in (SPEED, *LOADS):
            writer.add_topic(topic, 'std_msgs/msg/Float64')
        for begin in range(0, size, _BLOCK):
            writer.write_float64s(_make_columns(begin, min(begin + _BLOCK, size)))


def _make_columns(begin: int, end: int) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    rng, number = np.random.default_rng(begin), np.arange(begin, end, dtype=np.int64)
    seconds = number * STEP_NS * 1e-9
    stamps = 1_777_874_400_000_000_000 + number * STEP_NS
    slow = 40.0 * np.exp(-(((seconds % 21_600.0 - 10_000.0) / 300.0) ** 2))
    rpm = 70.0 + 10.0 * np.sin(2e-4 * seconds) - slow + rng.normal(0.0, 0.3, number.size)
    columns = {SPEED: (stamps, rpm)}
    for load_number, topic in enumerate(LOADS, 1):
        load = 1000.0 - 200.0 * load_number + rng.normal(0.0, 5.0, number.size)
        columns[topic] = (stamps + load_number * 3_000_000, load)
    return columns


def measure(path: Path, messages: int) -> dict[str, float]:
    """Return the seconds of each part, and the most memory used [bytes]."""
    config = load_config(CONFIG)
    requests = {Request(topic, 'data') for topic in (SPEED, *LOADS)}
    small = ROOT / 'bags' / 'two_bearings'
    to_json(check_recording(small, config))  # what is built or imported once

    def check() -> None:
        to_text(to_json(check_recording(path, config)), coloured=False)

    first = _time_work(check)
    measurement = {'memory': _most_memory()}
    is_repeated = messages < LENGTHS[3]
    checks, reads = [first], []
    for _ in range(3 if is_repeated else 1):
        reads.append(_time_work(lambda: _read_recording(path, requests, messages)))
        if is_repeated:
            checks.append(_time_work(check))
    measurement['check'], measurement['check_cpu'] = np.median(checks, axis=0).tolist()
    measurement['alone'], measurement['alone_cpu'] = np.median(reads, axis=0).tolist()
    if messages <= DAY:
        target = path.with_name('out.mcap')
        _, measurement['mcap'] = _time_work(lambda: _with_verdicts(path, config, target))
        target.unlink()
        with tempfile.TemporaryDirectory() as folder:
            store = ClipFolder(replace(config.clips, directory=folder))
            _, measurement['clips'] = _time_work(lambda: check_recording(path, config, [ClipWriter(store)]))
    return measurement


def _with_verdicts(path: Path, config: MonitorConfig, target: Path) -> None:
    with VerdictWriter(target) as writer:
        check_recording(path, config, [writer])


def _read_recording(path: Path, requests: set[Request], messages: int) -> None:
    """Read as arrays, or block by block where these would fill the memory."""
    bag = open_bag(path)
    if messages <= LENGTHS[3]:
        bag.read(requests)
    else:
        sum(1 for _ in bag.reading(requests))


def _time_work(work: Callable[[], object]) -> tuple[float, float]:
    """Return wall and processor time [s]."""
    begin, spent = time.perf_counter(), time.process_time()
    work()
    return time.perf_counter() - begin, time.process_time() - spent


def _most_memory() -> float:
    """Return the most memory of this program [bytes]; getrusage counts its parent, too."""
    status = Path('/proc/self/status').read_text('utf-8')
    (kilobytes,) = re.findall(r'^VmHWM:\s+(\d+) kB$', status, flags=re.MULTILINE)
    return 1024.0 * float(kilobytes)


def _time_start() -> float:
    """Return the wall time of a command that does nothing but start, the best of five [s]."""
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
    parser.add_argument('--messages', type=int, help=argparse.SUPPRESS)
    args = parser.parse_args(argv)
    if args.measure is not None:
        print(json.dumps(measure(args.measure, args.messages)))
    else:
        print(run(args.quick).markdown())
    return 0


if __name__ == '__main__':
    sys.exit(main())
