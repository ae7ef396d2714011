# SPDX-License-Identifier: Apache-2.0
"""Processor time that the rule takes for a sample, beside that of another checkout.

``python -m benchmarks.rule_speed ../old`` runs both checkouts, each in a process of its own, block by block
in turns, so that what else the machine does meets both alike, and prints the best block of each. Both need
this version's names of modules.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from stickslip_monitor.monitor.bearing_monitor import BearingMonitor
from stickslip_monitor.monitor.parameter_file import load_config
from stickslip_monitor.monitor.parameters import BearingConfig
from stickslip_monitor.monitor.rule_over_arrays import BearingScan
from stickslip_monitor.monitor.sample_types import Stream
from stickslip_monitor.physics.probability import Belief, Tolerance

ROOT = Path(__file__).resolve().parents[1]
CONFIG = ROOT / 'launch_configs' / 'reference_bearing.yaml'
_LIVE, _BULK = 1_200, 60_000
"""Samples of a block: some 40 ms live and 15 ms compiled, too short for most of the others' turns."""


def make_blocks() -> dict[str, Callable[[], float]]:
    """Return what is timed by name; each runs a block and returns its processor time a sample [s]."""
    reference = load_config(CONFIG).bearings[0]
    tolerance = Tolerance(damping=0.4, static=0.15, kinetic=0.15, decay=0.3)
    believed = replace(
        reference, tolerance=tolerance, belief=Belief.from_tolerance(reference.bearing, tolerance)
    )
    timed_blocks = {}
    for name, config in (('', reference), (', tolerances', believed)):
        timed_blocks[f'update{name}'] = partial(_time_updates, config, _make_stream(_LIVE))
        timed_blocks[f'bulk, interpreted{name}'] = partial(
            _time_scan, config, _make_stream(_LIVE), long=False
        )
        timed_blocks[f'bulk, compiled{name}'] = partial(_time_scan, config, _make_stream(_BULK), long=True)
    return timed_blocks


def _make_stream(size: int) -> Stream:
    """Return speed and load in turns, each ten times a second, far above the boundaries."""
    random, inputs = np.random.default_rng(1), np.arange(size, dtype=np.int8) % 2
    value = np.where(inputs == 0, 55.0, 1000.0) * (1.0 + 0.01 * random.standard_normal(size))
    return Stream(10**18 + 50_000_000 * np.arange(size, dtype=np.int64), inputs, value)


def _time_updates(config: BearingConfig, stream: Stream) -> float:
    update = BearingMonitor(config).update
    rows = zip(stream.inputs.tolist(), stream.time_ns.tolist(), stream.value.tolist(), strict=True)
    begin = time.process_time()
    for place, time_ns, value in rows:
        update(place, time_ns, value)
    return (time.process_time() - begin) / stream.time_ns.size


def _time_scan(config: BearingConfig, stream: Stream, *, long: bool) -> float:
    scan = BearingScan(config, None, long=long)
    begin = time.process_time()
    scan.finish(stream, None)
    return (time.process_time() - begin) / stream.time_ns.size


def serve_blocks() -> None:
    """Run the block that each line of standard input names, and print its time; first the package's file."""
    import stickslip_monitor

    timed = make_blocks()
    print(stickslip_monitor.__file__, flush=True)
    for line in sys.stdin:
        print(timed[line.rstrip('\n')](), flush=True)


def compare_checkouts(checkouts: list[Path], seconds: float, names: Iterable[str]) -> dict[str, list[float]]:
    """Return by block the best processor time a sample of each checkout [s], of blocks in turns over a time.

    The first block of each compiles, and is never the best but for ``seconds`` of 0.

    Raises:
        RuntimeError: A process has another checkout's package, or has ended.
    """
    processes = []
    try:
        for checkout in checkouts:
            command = [sys.executable, __file__, '--serve']
            # The path leads before an editable install of either.
            environment = {**os.environ, 'PYTHONPATH': str(checkout)}
            pipe = subprocess.PIPE
            processes.append(subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True, env=environment))
        for checkout, process in zip(checkouts, processes, strict=True):
            file = _request_line(process)
            if not Path(file).is_relative_to(checkout):
                raise RuntimeError(f"'{file}' was imported for {checkout}: is it a checkout of this version?")
        best = {name: [np.inf] * len(checkouts) for name in names}
        end = time.monotonic() + seconds
        while True:
            for name, times in best.items():
                for k, process in enumerate(processes):
                    times[k] = min(times[k], float(_request_line(process, name)))
            if time.monotonic() > end:
                return best
    finally:
        for process in processes:
            process.kill()
            process.wait()


def _request_line(process: subprocess.Popen[str], name: str | None = None) -> str:
    """Name a block to a process, if any, and return the next line of its answer."""
    assert process.stdin is not None
    assert process.stdout is not None
    if name is not None:
        process.stdin.write(f'{name}\n')
        process.stdin.flush()
    line = process.stdout.readline()
    if not line:
        raise RuntimeError('a process has ended; its error is above')
    return line.rstrip('\n')


def main() -> int:
    """Compare and print; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('other', type=Path, nargs='?', help='the other checkout')
    parser.add_argument('--seconds', type=float, default=60.0, help='for how long (default 60)')
    parser.add_argument('--serve', action='store_true', help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.serve:
        serve_blocks()
        return 0
    if args.other is None:
        parser.error('the other checkout is missing')
    for name, (there_seconds, here_seconds) in compare_checkouts(
        [args.other.resolve(), ROOT], args.seconds, make_blocks()
    ).items():
        print(
            f'{name:32s} {there_seconds * 1e6:8.3f} us, here {here_seconds * 1e6:8.3f} us:'
            f' {here_seconds / there_seconds:.3f} times'
        )
    return 0


if __name__ == '__main__':
    sys.exit(main())
