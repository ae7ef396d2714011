# SPDX-License-Identifier: Apache-2.0
"""Following the stick-slip motion in time, beside general integrators."""

from __future__ import annotations

import math
import subprocess
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from benchmarks.reference import LOAD, bearing
from benchmarks.table import Table, absent, duration, ratio
from benchmarks.timing import in_turns
from stickslip_lab.accuracy.methods import (
    MethodResult,
    breakaway,
    smoothed,
    switching,
    turning_points,
    typical_period,
)
from stickslip_monitor.physics.bearing import Bearing
from stickslip_monitor.physics.cycles import exact_cycle
from stickslip_monitor.physics.integrator import FAST, Drive, MotionState, integrate

RPM, CYCLES = 20.0, 10.0
BEARING = bearing()
SPEED = float(BEARING.speed.to_surface(RPM, 'rpm'))
SPAN = CYCLES * typical_period(BEARING, SPEED, LOAD)
PLAIN, COMPILED = 'stickslip_monitor, Python', 'stickslip_monitor, numba'
LONG = 'stickslip_monitor, numba, 100 s in one call'
PATHSIM, SICONOS = 'PathSim, RKCK54', 'Siconos, time stepping'
_PYTHON = Path('/usr/bin/python3')
_PEER = Path(__file__).with_name('siconos_peer.py')
_METHODS: dict[str, Callable[[Bearing, float, float], MethodResult]] = {
    'solve_ivp with events, default': partial(switching, False, math.inf),
    'solve_ivp with events, tight': partial(switching, True, 0.5),
    'tanh of 1e-4 m/s, LSODA, default': partial(smoothed, 1e-4, False),
    'tanh of 1e-4 m/s, LSODA, tight': partial(smoothed, 1e-4, True),
}


@dataclass(frozen=True, slots=True)
class _Result:
    per_second: float
    amplitude: float


def run(quick: bool) -> Table:
    """Compare ways to follow the motion at 20 rpm."""
    repeat = 2 if quick else 7
    timed: dict[str, tuple[Callable[[], float], float]] = {
        PLAIN: (lambda: _integrate_motion(False, SPAN), SPAN)
    }
    if find_spec('numba'):
        timed[COMPILED] = (lambda: _integrate_motion(True, SPAN), SPAN)
        timed[LONG] = (lambda: _integrate_motion(True, 100.0), 100.0)
    for name, method in _METHODS.items():
        timed[name] = (partial(_amplitude_by, method), SPAN)
    if find_spec('pathsim'):
        timed[PATHSIM] = (_run_pathsim, SPAN)
    amplitudes = {name: follow() for name, (follow, _) in timed.items()}
    times = in_turns({name: follow for name, (follow, _) in timed.items()}, repeat)
    results: dict[str, _Result | str] = {
        name: _Result(times[name].median / span, amplitudes[name]) for name, (_, span) in timed.items()
    }
    for name in (COMPILED, LONG, PATHSIM):
        results.setdefault(name, 'not installed')
    steps = (1e-4,) if quick else (1e-4, 1e-5)
    results |= {f'{SICONOS} of {step:g} s': _run_siconos(step) for step in steps}
    return _make_table(results)


def _integrate_motion(compiled: bool, span: float) -> float:
    """Return the amplitude of the late part of a motion, to rounding [m]."""
    drive = Drive.constant(SPEED, LOAD, span)
    start = MotionState.moving(breakaway(BEARING, SPEED, LOAD), SPEED, drive)
    times = np.linspace(span - 0.4 * SPAN, span, 256)
    motion = integrate(BEARING, drive, start, times, accuracy=FAST, compiled=compiled)
    x, v, a = motion.displacement, motion.velocity, motion.acceleration
    return 0.5 * float(np.ptp(turning_points(x, v, a, float(times[1] - times[0]))))


def _amplitude_by(method: Callable[[Bearing, float, float], MethodResult]) -> float:
    return method(BEARING, SPEED, LOAD).amplitude


def _run_pathsim() -> float:
    from benchmarks.pathsim_peer import Oscillator

    return Oscillator(BEARING, SPEED, LOAD).amplitude(SPAN)


def _run_siconos(step: float) -> _Result | str:
    command = [str(_PYTHON), str(_PEER), str(step), str(SPAN)]
    try:
        done = subprocess.run(command, check=True, capture_output=True, text=True)
    except OSError:
        return 'not installed'
    except subprocess.CalledProcessError as error:
        return 'not installed' if 'ModuleNotFoundError' in error.stderr else 'failed'
    per_second, amplitude = (float(word) for word in done.stdout.split()[-2:])
    return _Result(per_second, amplitude)


def _make_table(results: dict[str, _Result | str]) -> Table:
    exact = float(exact_cycle(BEARING, SPEED, LOAD).amplitude)
    best = results.get(COMPILED)
    our_result = best if isinstance(best, _Result) else results[PLAIN]
    assert isinstance(our_result, _Result)
    rows = [
        absent(name, 4, result)
        if isinstance(result, str)
        else [
            name,
            duration(result.per_second),
            f'{result.amplitude / exact - 1.0:+.1e}',
            ratio(result.per_second / our_result.per_second),
        ]
        for name, result in results.items()
    ]
    return Table(
        title='Time integration',
        text=(
            f'The reference bearing at {RPM:g} rpm and {LOAD:g} N, ten cycles from breakaway. PathSim has'
            ' tolerances of 1e-6 and 1e-9.'
        ),
        columns=('integrator', 'per simulated second', 'error of the amplitude', 'ratio'),
        rows=rows,
    )
