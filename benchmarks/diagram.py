# SPDX-License-Identifier: Apache-2.0
"""The bifurcation diagram of the reference bearing, beside AUTO-07p."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.reference import LOAD, bearing
from benchmarks.table import Table, absent, duration, ratio
from benchmarks.timing import in_turns
from stickslip_monitor.physics.averaging import fold_speed, hopf_speed, stationary_amplitudes
from stickslip_monitor.physics.cycles import (
    exact_amplitude,
    exact_cycle,
    exact_fold_speed,
    exact_unstable_cycle,
)
from stickslip_monitor.physics.friction import Stribeck

RPM = (5.0, 45.0)
STABLE, UNSTABLE = 161, 61
BEARING = bearing()
LOW, HIGH = (float(BEARING.speed.to_surface(rpm, 'rpm')) for rpm in RPM)
EXACT, AVERAGED = 'stickslip_monitor, exact cycles', 'stickslip_monitor, KBM averaging'
MIXED = 'stickslip_monitor, exact stable branch, KBM'
AUTO = 'AUTO-07p, tanh of {:g} m/s'
_FOLDER = Path(__file__).with_name('auto')
_LIMIT, _ROUNDS = 120.0, 4


@dataclass(frozen=True, slots=True)
class _Result:
    seconds: float
    fold: float
    hopf: float
    whole: bool


def run(quick: bool) -> Table:
    """Compare diagrams; AUTO's width of smoothing is the error that its user chooses."""
    repeat, turns = (3, 1) if quick else (15, 5)
    ours = {MIXED: _follow_mixed, EXACT: _follow_exact, AVERAGED: _follow_averaged}
    times = in_turns(ours, repeat)
    results: dict[str, _Result | str] = {
        name: _Result(times[name].median, *follow(), True) for name, follow in ours.items()
    }
    for width in (1e-3, 1e-4, 1e-5):
        results[AUTO.format(width)] = _run_auto(width, turns)
    return _make_table(results)


def _follow_exact() -> tuple[float, float]:
    """Compute both branches of exact cycles; return fold and Hopf speed [m/s]."""
    hopf, fold = float(hopf_speed(BEARING, LOAD)), float(exact_fold_speed(BEARING, LOAD))
    stable = exact_cycle(BEARING, np.linspace(LOW, fold, STABLE)[:-1], LOAD)
    unstable = exact_unstable_cycle(BEARING, np.linspace(hopf, fold, UNSTABLE)[1:-1], LOAD)
    if np.isnan(stable.amplitude).any() or np.isnan(unstable.amplitude).any():
        raise RuntimeError('a branch has a gap')
    return fold, hopf


def _follow_mixed() -> tuple[float, float]:
    """Compute amplitudes as the monitor does: the stable branch exact, the unstable one averaged."""
    hopf, averaged = float(hopf_speed(BEARING, LOAD)), float(fold_speed(BEARING, LOAD))
    low, high = LOW, 1.01 * averaged
    for _ in range(_ROUNDS):
        speed = np.linspace(low, high, STABLE)
        last = int(np.flatnonzero(np.isfinite(_stable_amplitudes(speed, averaged)))[-1])
        low, high = float(speed[last]), float(speed[last + 1])
    _stable_amplitudes(np.linspace(LOW, low, STABLE), averaged)
    stationary_amplitudes(BEARING, np.linspace(hopf, averaged, UNSTABLE)[1:-1], LOAD)
    return low, hopf


def _stable_amplitudes(speed: NDArray[np.float64], fold: float) -> NDArray[np.float64]:
    every = np.full_like(speed, 1.0)
    return np.asarray(exact_amplitude(BEARING, speed, LOAD * every))


def _follow_averaged() -> tuple[float, float]:
    """Compute the diagram by averaging."""
    hopf, fold = float(hopf_speed(BEARING, LOAD)), float(fold_speed(BEARING, LOAD))
    for speed in (np.linspace(LOW, fold, STABLE)[:-1], np.linspace(hopf, fold, UNSTABLE)[1:-1]):
        stationary_amplitudes(BEARING, speed, LOAD)
    return fold, hopf


def _run_auto(width: float, turns: int) -> _Result | str:
    """Return the median of AUTO's own account of its time, without compiling and starting Python."""
    if not shutil.which('auto-07p'):
        return 'not installed'
    if not shutil.which('gfortran'):
        return 'gfortran not installed'
    assert isinstance(BEARING.friction, Stribeck)
    scale = BEARING.friction.decay
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for file in _FOLDER.iterdir():
            shutil.copy(file, folder)
        source = folder / 'belt.f90'
        number = f'{width * scale:.3e}'.replace('e', 'D')
        source.write_text(source.read_text('utf-8').replace('= WIDTH', f'= {number}'), 'utf-8')
        try:
            runs = [_auto_once(folder) for _ in range(turns)]
        except (subprocess.SubprocessError, ValueError):
            return 'failed'
    seconds = float(np.median([run[0] for run in runs]))
    return _Result(seconds, runs[0][1] / scale, runs[0][2] / scale, runs[0][3])


def _auto_once(folder: Path) -> tuple[float, float, float, bool]:
    """Seconds, ``beta V`` at fold and Hopf, and whether the branch came to its end."""
    done = subprocess.run(
        ['auto-07p', 'diagram.auto'],
        cwd=folder,
        env=os.environ | {'OMP_NUM_THREADS': '1'},
        timeout=_LIMIT,
        capture_output=True,
        text=True,
        check=True,
    )
    seconds = sum(float(word) for word in re.findall(r'Total Time\s+(\S+)', done.stdout))
    points = re.findall(r'^ +(\d) +\d+ +(HB|LP|UZ|MX) +\d+ +(\S+)', done.stdout, re.MULTILINE)
    speeds = {kind: float(speed) for branch, kind, speed in reversed(points)}
    ends = {kind for branch, kind, _ in points if branch == '2'}
    if 'LP' not in speeds:
        raise ValueError('no fold')
    return seconds, speeds['LP'], speeds['HB'], 'UZ' in ends


def _make_table(results: dict[str, _Result | str]) -> Table:
    mixed, exact = results[MIXED], results[EXACT]
    assert isinstance(mixed, _Result)
    assert isinstance(exact, _Result)
    rows = []
    for name, result in results.items():
        if isinstance(result, str):
            rows.append(absent(name, 6, result))
            continue
        rpm = float(BEARING.speed.from_surface(result.fold, 'rpm'))
        error = f'{result.fold / exact.fold - 1.0:+.1e}'
        seconds = duration(result.seconds) + ('' if result.whole else ', stops at the fold')
        times = ratio(result.seconds / mixed.seconds) if result.whole else '–'
        hopf = float(BEARING.speed.from_surface(result.hopf, 'rpm'))
        rows.append([name, seconds, f'{hopf:.4f}', f'{rpm:.4f}', error, times])
    return Table(
        title='Bifurcation diagram',
        text=(
            'Unstable and stable branch of the reference bearing with Hopf and fold, from'
            f' {RPM[0]:g} to {RPM[1]:g} rpm at {LOAD:g} N: {STABLE - 1} cycles on the stable'
            f' branch and {UNSTABLE - 2} on the unstable one, of the exact set-valued law, against'
            ' continuation of the law smoothed by tanh (60 intervals of 4 collocation points, as'
            ' many cycles as its step control takes). AUTO by its own account of time, compiling'
            ' and starting left out; ours without importing. The error is that of the fold'
            ' against the exact cycles.'
        ),
        columns=('method', 'time', 'Hopf [rpm]', 'fold [rpm]', 'error', 'ratio'),
        rows=rows,
    )
