# SPDX-License-Identifier: Apache-2.0
"""A check of any length takes the same memory, and the same outline is drawn for any blocks."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterable
from itertools import pairwise
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_logs import START, write_recording
from shared import CONFIG, ROOT

from stickslip_monitor import Stream
from stickslip_monitor.monitor.parameter_file import load_config
from stickslip_monitor.monitor.parameters import BearingConfig
from stickslip_monitor.monitor.rule_over_arrays import BearingScan, Scan
from stickslip_monitor.offline import extremes
from stickslip_monitor.offline.extremes import Outline, OutlineBuilder

_MILLION = 1_000_000
# In a process of its own, which tells the most memory that it had, and whose data is
# bounded, so that nothing is merely not touched.
_PROGRAM = """
import re, resource, sys
from stickslip_monitor.cli import main
main(['check', 'bags/coast_down', '--config', sys.argv[2], *sys.argv[4:]][:4])
held = int(re.search(r'VmData:\\s+(\\d+)', open('/proc/self/status').read())[1])
resource.setrlimit(resource.RLIMIT_DATA, (1024 * held + int(sys.argv[3]),) * 2)
code = main(['check', sys.argv[1], '--config', sys.argv[2], *sys.argv[4:]])
peak = re.search(r'VmHWM:\\s+(\\d+)', open('/proc/self/status').read())[1]
print(code, peak, file=sys.stderr)
"""


def write_slow_passages(path: Path, messages: int) -> Path:
    """Speed and load at 10 Hz, with a slow passage every few hours."""
    size, rng = messages // 2, np.random.default_rng(1)
    seconds = np.arange(size) * 0.1
    stamps = START + np.arange(size, dtype=np.int64) * 10**8
    rpm = 70.0 - 40.0 * np.exp(-((((seconds % 21_600.0) - 9000.0) / 300.0) ** 2))
    columns = {
        '/shaft/speed': (stamps, rpm + rng.normal(0.0, 0.3, size)),
        '/bearing/aft_stern/load': (stamps + 3_000_000, 900.0 + rng.normal(0.0, 5.0, size)),
    }
    return write_recording(path, columns)


@pytest.fixture(scope='module')
def compiled(tmp_path_factory: pytest.TempPathFactory) -> None:
    """Compile the rule and cache it, which takes 130 MB once and is not to be measured."""
    path = write_slow_passages(tmp_path_factory.mktemp('compiled') / 'in.mcap', _MILLION // 5)
    arguments = ['check', str(path), '--config', str(CONFIG)]
    program = [sys.executable, '-m', 'stickslip_monitor', *arguments]
    subprocess.run(program, cwd=ROOT, capture_output=True, check=False)


def peak_megabytes(path: Path, *options: str) -> float:
    """Return the most memory of a check [MB]."""
    arguments = [str(path), str(CONFIG), str(300 << 20), *options]
    completed = subprocess.run(
        [sys.executable, '-c', _PROGRAM, *arguments], cwd=ROOT, capture_output=True, text=True, check=True
    )
    code, peak = completed.stderr.split()[-2:]
    assert code == '1'
    return int(peak) * 1024 / 1e6


@pytest.mark.slow
@pytest.mark.usefixtures('compiled')
def test_a_check_takes_as_much_memory_whatever_the_length(tmp_path: Path) -> None:
    short, long = (
        peak_megabytes(write_slow_passages(tmp_path / f'{n}.mcap', n * _MILLION), '--json') for n in (1, 4)
    )
    assert long < short + 25.0
    # Some 110 MB of it is numba, which runs the rule over a long recording.
    assert long < 400.0


@pytest.mark.slow
@pytest.mark.usefixtures('compiled')
@pytest.mark.parametrize('option', ['--mcap', '--clips', '--report'])
def test_memory_is_bounded_with_outputs_too(tmp_path: Path, option: str) -> None:
    target = {'--mcap': 'out.mcap', '--clips': 'clips', '--report': 'out.html'}[option]
    path = write_slow_passages(tmp_path / 'in.mcap', _MILLION // 5)
    # Some 110 MB of it is numba, as above.
    assert peak_megabytes(path, option, str(tmp_path / target)) < 300.0


def outline_of(config: BearingConfig, scans: Iterable[Scan]) -> Outline:
    outline_builder = OutlineBuilder(config)
    for scan in scans:
        outline_builder.add_scan(scan)
    return outline_builder.build()


@settings(max_examples=12, deadline=None)
@given(st.lists(st.integers(0, 2400), min_size=1, max_size=4), st.integers(0, 99))
def test_any_blocks_have_the_same_outline_and_it_has_every_extreme(cuts: list[int], seed: int) -> None:
    (config,) = load_config(CONFIG).bearings
    rng, size = np.random.default_rng(seed), 1200
    speed = 45.0 + 10.0 * np.sin(np.arange(size) / 100.0) + rng.normal(0.0, 3.0, size)
    time = np.cumsum(rng.choice([10**8, 20 * 10**9], size, p=[0.998, 0.002]))
    times = START + np.repeat(time, 2)
    values = np.column_stack([speed, rng.normal(900.0, 50.0, size)]).ravel()
    place = np.tile([0, 1], size)
    edges = [0, *sorted(cuts), times.size]
    *parts, last = (Stream(times[a:b], place[a:b], values[a:b]) for a, b in pairwise(edges))
    scanned = BearingScan(config, START).finish(Stream(times, place, values), None)
    scan = BearingScan(config, START)
    with patch.object(extremes, '_MAX_GROUPS', 40):
        by_whole = outline_of(config, [scanned])
        by_parts = outline_of(config, [*map(scan.take, parts), scan.finish(last, None)])
    for name in ('time_ns', 'until_ns', 'sticking'):
        assert getattr(by_whole, name).tolist() == getattr(by_parts, name).tolist()
    assert by_whole.time_ns.size < size / 2
    for name in ('speed', 'load', 'fold_margin', 'hopf_margin'):
        outlined, all_ = getattr(by_whole.assessment, name), getattr(scanned.assessment, name)
        assert (outlined.min(), outlined.max()) == (all_.min(), all_.max())
    lost = (scanned.until_ns[:-1] < scanned.time_ns[1:]).sum()
    assert bool(lost) == bool((by_whole.until_ns[:-1] < by_whole.time_ns[1:]).any())
