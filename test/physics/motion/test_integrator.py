# SPDX-License-Identifier: Apache-2.0
"""The integrator against closed forms and against the numbers of PHYSICS.md.

Short motions run without numba, so that what is tested does not depend on what is installed.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from stickslip_monitor.errors import PhysicsError
from stickslip_monitor.physics.friction import Coulomb, Stribeck, Tabulated
from stickslip_monitor.physics.motion.integrator import (
    Accuracy,
    Drive,
    MotionOutcome,
    MotionState,
    Phase,
    integrate,
)
from stickslip_monitor.physics.oscillator import Bearing

REFERENCE = Bearing(50.0, 400.0, 2.0e6, Stribeck(0.3, 0.1, 10.0), 0.1)
LOAD = 1000.0


def damped(bearing: Bearing, shift: float, x: float, velocity: float, t: float) -> float:
    """Free damped oscillation about a displacement."""
    zeta, omega = bearing.damping_ratio, bearing.natural_frequency
    natural, y = omega * math.sqrt(1.0 - zeta**2), x - shift
    swing = y * math.cos(natural * t)
    swing += (velocity + zeta * omega * y) / natural * math.sin(natural * t)
    return shift + math.exp(-zeta * omega * t) * swing


def test_coulomb_damper_stops_where_it_must() -> None:
    """A stopped shaft: half swings about +-mu_k N/k, each shorter, to a stop within mu_s N/k."""
    bearing = replace(REFERENCE, friction=Coulomb(0.3, 0.25))
    half = math.pi / (bearing.natural_frequency * math.sqrt(1.0 - bearing.damping_ratio**2))
    ratio = math.exp(-bearing.damping_ratio * bearing.natural_frequency * half)
    kinetic, static = (mu * LOAD / bearing.stiffness for mu in (0.25, 0.3))
    x, side, swings = 2.0e-3, 1.0, 0
    while abs(x) > static:
        x, side, swings = side * kinetic - ratio * (x - side * kinetic), -side, swings + 1
    motion = integrate(
        bearing, Drive.constant(0.0, LOAD, 1.0), MotionState(2.0e-3, 0.0), compiled=False
    )
    assert motion.transitions.time == pytest.approx(half * np.arange(1, swings + 1), rel=1e-12)
    assert (motion.transitions.after == Phase.STICK).tolist() == [False] * (swings - 1) + [True]
    assert motion.final.displacement == pytest.approx(x, rel=1e-11)
    assert motion.final.phase is Phase.STICK


@pytest.mark.parametrize('speed', [0.0, 0.1, -0.1])
def test_without_load_the_lining_swings_freely(speed: float) -> None:
    times = np.linspace(0.0, 1.0, 101)
    drive = Drive.constant(speed, 0.0, 1.0)
    motion = integrate(REFERENCE, drive, MotionState(1e-3, speed), times, compiled=False)
    expected = [damped(REFERENCE, 0.0, 1e-3, 0.0, t) for t in times]
    assert motion.displacement == pytest.approx(expected, abs=1e-15)
    assert not motion.sticking.any()


RISING = replace(REFERENCE, friction=Stribeck(0.1, 0.3, 10.0))
POINTS = Tabulated([0.02, 0.1, 0.5], [0.3, 0.15, 0.2])
# Beside the cycles of test_integrator_hard.py.
HARD = {
    'eta 1e-6': (REFERENCE, 0.1, 5e-3, None),
    'eta 1e3, released': (REFERENCE, 0.1, 5e6, MotionState(0.75 - 3e-5, 0.0)),
    'level law': (replace(REFERENCE, friction=Stribeck(0.2, 0.2, 10.0)), 0.1, LOAD, None),
    'rising law': (RISING, 0.1, LOAD, None),
    'rising, eta 1e3': (RISING, 0.1, 5e6, MotionState(0.25, 0.0)),
    'rising Coulomb': (replace(REFERENCE, friction=Coulomb(0.1, 0.3)), 0.1, LOAD, None),
    'few points': (replace(REFERENCE, friction=POINTS), 0.1, LOAD, None),
    'no load, no speed': (REFERENCE, 0.0, 0.0, MotionState(1e-3, 0.0)),
    'nothing at all': (REFERENCE, 0.0, 0.0, None),
    'almost denormal': (REFERENCE, 0.0, 0.0, MotionState(1e-310, 0.0)),
}


@pytest.mark.filterwarnings('error')
@pytest.mark.parametrize('name', HARD)
def test_hard_cases_end_and_are_finite(name: str) -> None:
    bearing, speed, load, state = HARD[name]
    drive = Drive.constant(speed, load, 1.0)
    times = np.linspace(0.0, 1.0, 101)
    motion = integrate(bearing, drive, state or MotionState(0.0, 0.0), times, compiled=False)
    assert motion.outcome is MotionOutcome.COMPLETE
    for column in (motion.displacement, motion.velocity, motion.acceleration):
        assert np.isfinite(column).all()
    # About 32 periods: a bound that only stiffness (rising law, eta = 1000) may come near.
    assert motion.steps < (60_000 if 'eta 1e3' in name else 1_000)
    assert np.all(np.diff(motion.transitions.time) >= 0.0)


def test_rising_coulomb_law_does_not_chatter() -> None:
    """By Filippov's convex hull the lining sticks until the kinetic limit."""
    bearing = replace(REFERENCE, friction=Coulomb(0.1, 0.3))
    motion = integrate(
        bearing, Drive.constant(0.05, LOAD, 1.0), MotionState(0.0, 0.0), compiled=False
    )
    release = (0.3 * LOAD - bearing.damping * 0.05) / bearing.stiffness / 0.05
    assert motion.transitions.time == pytest.approx([release], rel=1e-12)


def test_motion_astern_mirrors_motion_ahead() -> None:
    times = np.linspace(0.0, 0.2, 101)
    grid, speed, load = [0.0, 0.1, 0.2], np.array([0.1, 0.02, 0.15]), [900.0, 1100.0, 700.0]
    ahead, astern = (
        integrate(
            REFERENCE,
            Drive.sampled(grid, side * speed, load),
            MotionState(side * 1e-4, 0.0),
            times,
            compiled=False,
        )
        for side in (1.0, -1.0)
    )
    assert np.array_equal(ahead.displacement, -astern.displacement)
    assert np.array_equal(ahead.phase, -astern.phase)


def test_bad_arguments_are_named() -> None:
    drive = Drive.constant(0.1, LOAD, 1.0)
    with pytest.raises(PhysicsError, match=r'times from 0\.5 to 2 s must lie within the drive'):
        integrate(REFERENCE, drive, MotionState(0.0, 0.0), [0.5, 2.0])
    with pytest.raises(PhysicsError, match='do not fall'):
        integrate(REFERENCE, drive, MotionState(0.0, 0.0), [0.5, 0.2])
    with pytest.raises(PhysicsError, match='must be 0 while the lining sticks'):
        MotionState(0.0, 0.1, Phase.STICK)
    with pytest.raises(PhysicsError, match='order = 2 must be between 3 and 40'):
        Accuracy(1e-9, 2)


def test_overflow_is_an_outcome() -> None:
    drive, far = Drive.constant(0.1, LOAD, 1.0), MotionState(1e300, 0.1)
    motion = integrate(REFERENCE, drive, far, [0.0, 1.0], compiled=False)
    assert motion.outcome is MotionOutcome.NOT_FINITE
    assert motion.displacement.size == 0


GRID = {
    'time': [0.0, 1.0, 3.0, 4.5],
    'speed': [0.1, 0.3, -0.2, 0.0],
    'load': [1e3, 0.0, 500.0, 200.0],
}


def test_a_drive_joins_its_samples_by_straight_lines() -> None:
    drive = Drive.sampled(**GRID)
    for pieces, values in ((drive.speed, GRID['speed']), (drive.load, GRID['load'])):
        for i, t in enumerate((0.4, 2.2, 4.4)):
            expected = np.interp(t, GRID['time'], values)
            assert np.polyval(pieces[i, ::-1], t - drive.time[i]) == pytest.approx(expected)
    assert (drive.start, drive.end) == (0.0, 4.5)
    assert drive.largest_load == 2000.0  # a bound: every coefficient at its largest


@pytest.mark.parametrize(
    ('changes', 'message'),
    [
        ({'time': [0.0, 1.0, 1.0, 2.0]}, r'drive time\[2\] = 1 s does not exceed time\[1\] = 1 s'),
        ({'load': [1.0, -2.0, 1.0, 1.0]}, r'drive load\[1\] = -2 N must not be negative'),
        ({'speed': [0.1, np.nan, 0.1, 0.1]}, r'drive speed\[1\] = nan must be a finite number'),
        ({'speed': [0.1]}, r'shape \(4,\), speeds of \(1,\)'),
        ({'time': [0.0], 'speed': [0.1], 'load': [1.0]}, 'drive has 1 samples: give at least two'),
    ],
)
def test_bad_drives_are_named(changes: dict[str, list[float]], message: str) -> None:
    with pytest.raises(PhysicsError, match=message):
        Drive.sampled(**(GRID | changes))
