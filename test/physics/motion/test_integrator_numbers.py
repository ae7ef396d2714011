# SPDX-License-Identifier: Apache-2.0
"""Order, drift, and the same numbers however a motion is cut or computed."""

from __future__ import annotations

from dataclasses import replace
from importlib.util import find_spec

import numpy as np
import pytest

from stickslip_monitor import jit
from stickslip_monitor.errors import PhysicsError
from stickslip_monitor.physics.cycle.cycles import exact_cycle
from stickslip_monitor.physics.friction import Coulomb, Stribeck, Tabulated
from stickslip_monitor.physics.motion.integrator import (
    Accuracy,
    Drive,
    Motion,
    MotionState,
    Phase,
    integrate,
)
from stickslip_monitor.physics.oscillator import Bearing

REFERENCE = Bearing(50.0, 400.0, 2.0e6, Stribeck(0.3, 0.1, 10.0), 0.1)
RPM = REFERENCE.speed.factor('rpm')
HAS_NUMBA = find_spec('numba') is not None
GRID = np.linspace(0.0, 1.0, 51)
VARYING = Drive.sampled(GRID, 0.09 * np.cos(5.0 * GRID), 800.0 + 500.0 * np.sin(9.0 * GRID))
LAWS = [
    Stribeck(0.3, 0.1, 10.0, 0.02),
    Coulomb(0.3, 0.12),
    Tabulated([0.005, 0.03, 0.1, 0.2], [0.3, 0.22, 0.12, 0.1]),
]


def columns(motion: Motion) -> list[np.ndarray]:
    return [
        motion.displacement,
        motion.velocity,
        motion.acceleration,
        motion.relative_speed,
        motion.transitions.time,
    ]


@pytest.mark.parametrize(('order', 'longest'), [(4, 0.2), (6, 0.2), (8, 0.7)])
def test_error_falls_with_the_order_of_the_series(order: int, longest: float) -> None:
    drive, state = Drive.constant(0.6, 1000.0, 0.05), MotionState(2e-4, 0.6)
    exact = integrate(REFERENCE, drive, state, compiled=False).final
    lengths, errors = longest * np.array([1.0, 0.5, 0.25]), []
    for length in lengths:
        accuracy = Accuracy(1e9, order, float(length))
        end = integrate(REFERENCE, drive, state, accuracy=accuracy, compiled=False).final
        velocity = (end.relative_speed - exact.relative_speed) / REFERENCE.natural_frequency
        errors.append(np.hypot(end.displacement - exact.displacement, velocity))
    slopes = np.diff(np.log(errors)) / np.diff(np.log(lengths))
    assert slopes == pytest.approx(order, abs=0.4)


@pytest.mark.parametrize('law', LAWS)
def test_numba_and_python_agree(law: Stribeck) -> None:
    pytest.importorskip('numba')
    bearing, times = replace(REFERENCE, friction=law), np.linspace(0.0, 1.0, 501)
    motions = [
        integrate(bearing, VARYING, MotionState(1e-4, 0.02), times, compiled=compiled)
        for compiled in (True, False)
    ]
    compiled, plain = motions
    for a, b in zip(columns(compiled), columns(plain), strict=True):
        assert a == pytest.approx(b, rel=1e-12, abs=1e-12 * np.max(np.abs(b)))
    assert (compiled.steps, compiled.expansions) == (plain.steps, plain.expansions)
    assert np.array_equal(compiled.phase, plain.phase)


def test_without_numba_python_serves(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(jit, 'has_compiler', lambda: False)
    drive = Drive.constant(0.1, 1000.0, 0.05)
    assert integrate(REFERENCE, drive, MotionState(0.0, 0.0)).steps > 0
    with pytest.raises(PhysicsError, match='needs numba, which is not installed'):
        integrate(REFERENCE, drive, MotionState(0.0, 0.0), compiled=True)


@pytest.mark.parametrize('law', LAWS)
def test_cutting_a_drive_at_its_samples_changes_no_bit(law: Stribeck) -> None:
    bearing, times = replace(REFERENCE, friction=law), np.linspace(0.0, 1.0, 257)
    whole = integrate(bearing, VARYING, MotionState(0.0, 0.0), times, compiled=False)
    parts, state, cuts = [], MotionState(0.0, 0.0), (1, 2, 3, 20, 37)
    for first, last in zip((0, *cuts), (*cuts, 50), strict=True):
        drive = Drive(GRID[first : last + 1], VARYING.speed[first:last], VARYING.load[first:last])
        mine = times[(times > drive.start) & (times <= drive.end)]
        mine = mine if first else np.append(0.0, mine)
        parts.append(integrate(bearing, drive, state, mine, compiled=False))
        state = parts[-1].final
    for i, column in enumerate(columns(whole)):
        assert np.array_equal(column, np.concatenate([columns(part)[i] for part in parts]))
    assert state == whole.final


def test_samples_do_not_change_the_motion() -> None:
    ends = [
        integrate(REFERENCE, VARYING, MotionState(0.0, 0.0), times, compiled=False).final
        for times in ((), np.linspace(0.0, 1.0, 333))
    ]
    assert ends[0] == ends[1]


@pytest.mark.slow
def test_many_cycles_do_not_drift() -> None:
    """A hundred thousand cycles where numba is installed, two thousand elsewhere.

    The period is that of the exact cycle, found by another method; first and last cycles agree.
    """
    speed, cycles = 20.0 * RPM, 100_000 if HAS_NUMBA else 2_000
    exact = exact_cycle(REFERENCE, speed, 1000.0)
    duration = (cycles + 10) * exact.period
    late = np.linspace(duration - 0.05, duration, 2001)
    motion = integrate(
        REFERENCE,
        Drive.constant(speed, 1000.0, duration),
        MotionState(0.0, 0.0),
        np.append(np.linspace(0.3, 0.35, 2001), late),
    )
    t = motion.transitions
    releases = t.time[t.before == Phase.STICK][2:]
    assert releases.size > cycles
    assert (releases[-1] - releases[0]) / (releases.size - 1) == pytest.approx(
        exact.period, rel=1e-12
    )
    early, last = (releases[101] - releases[1]) / 100.0, (releases[-1] - releases[-101]) / 100.0
    assert last == pytest.approx(early, rel=1e-11)
    for x in (motion.displacement[:2001], motion.displacement[2001:]):
        assert 0.5 * np.ptp(x) == pytest.approx(exact.amplitude, rel=1e-5)
