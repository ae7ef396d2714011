# SPDX-License-Identifier: Apache-2.0
"""The integrator where numbers break, against other methods and closed forms.

The exact cycle is one slip phase at constant speed and load, which test/physics holds
to Taylor series in 40 digits at the same hard places.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from shared import REFERENCE_BEARING

from stickslip_monitor.physics.bearing import Bearing
from stickslip_monitor.physics.cycles import CycleKind, exact_cycle, exact_fold_speed
from stickslip_monitor.physics.friction import Stribeck, Tabulated
from stickslip_monitor.physics.integrator import Drive, MotionState, Phase, integrate

pytestmark = [pytest.mark.filterwarnings('error'), pytest.mark.usefixtures('float_errors')]

LOAD = 1000.0


def breakaway_state(bearing: Bearing, speed: float, load: float) -> MotionState:
    limit = bearing.friction.static * load - bearing.damping * speed
    return MotionState(limit / bearing.stiffness, 0.0)


def last_speed(load: float) -> float:
    """Return the last speed with a stick-slip cycle to rounding, by bisection about the fold."""
    fold = float(exact_fold_speed(REFERENCE_BEARING, load))
    low, high = fold * (1.0 - 1e-9), fold * (1.0 + 1e-9)
    # So close the kind is ill-posed: the numbers tell on which side our solver puts a speed.
    assert exact_cycle(REFERENCE_BEARING, low, load).amplitude > 0.0
    assert math.isnan(exact_cycle(REFERENCE_BEARING, high, load).amplitude)
    while high - low > 4e-16 * high:
        middle = 0.5 * (low + high)
        sticks = exact_cycle(REFERENCE_BEARING, middle, load).amplitude > 0.0
        low, high = (middle, high) if sticks else (low, middle)
    return low


@pytest.mark.parametrize(('side', 'sticks'), [(-1.0, True), (1.0, False)])
@pytest.mark.parametrize('load', [LOAD, 25.0 * LOAD])
def test_a_distance_of_1e_12_from_the_fold_decides(side: float, sticks: bool, load: float) -> None:
    """Below the fold every passage grazes the belt and sticks; above it the first one misses."""
    speed = last_speed(load) * (1.0 + side * 1e-12)
    period = 2.0 * math.pi / REFERENCE_BEARING.natural_frequency
    motion = integrate(
        REFERENCE_BEARING,
        Drive.constant(speed, load, 10.5 * period),
        breakaway_state(REFERENCE_BEARING, speed, load),
        compiled=False,
    )
    phases = motion.transitions.after.tolist()
    if sticks:
        assert len(phases) >= 15
        assert set(phases[::2]) == {Phase.FORWARD}
        assert set(phases[1::2]) == {Phase.STICK}
    else:
        assert phases == [Phase.FORWARD]


SHARP, FEW = Stribeck(0.3, 0.1, 1e5), Tabulated([0.02, 0.5], [0.3, 0.1])
FALLING = Tabulated([0.0, 0.1, 0.3, 1.0, 5.0], [0.3, 0.2, 0.12, 0.1, 0.11])
# Bearing, speed [m/s], load [N]
CYCLES = {
    'beta V = 1e4': (replace(REFERENCE_BEARING, friction=SHARP), 0.1, 1e4),
    'crawling': (REFERENCE_BEARING, 1e-9, LOAD),
    'no damping': (replace(REFERENCE_BEARING, damping=0.0), 0.1, LOAD),
    'zeta 0.9': (replace(REFERENCE_BEARING, damping=1.8e4), 0.1, 5e5),
    'eta 5': (REFERENCE_BEARING, 0.1, 2.5e4),
    'eta 1e3': (REFERENCE_BEARING, 0.1, 5e6),
    'two points': (replace(REFERENCE_BEARING, friction=FEW), 0.1, 5e3),
    'five points': (Bearing(1.0, 0.1, 1.0, FALLING, 0.1), 0.3, 10.0),
    'five points, faster': (Bearing(1.0, 0.1, 1.0, FALLING, 0.1), 2.0, 10.0),
}


@pytest.mark.parametrize('name', CYCLES)
def test_hard_cycles_are_the_exact_ones(name: str) -> None:
    bearing, speed, load = CYCLES[name]
    exact = exact_cycle(bearing, speed, load)
    assert exact.kind is CycleKind.STICK_SLIP
    slip = exact.period * (1.0 - exact.stick_fraction)
    # Where the motion is small against the deflection it is about, its digits are fewer.
    start = breakaway_state(bearing, speed, load)
    grain = 1e-16 * start.displacement / exact.amplitude
    motion = integrate(
        bearing,
        Drive.constant(speed, load, 1.5 * exact.period),
        start,
        # Close together at both ends, where a strongly driven lining turns.
        0.5 * slip * (1.0 - np.cos(np.linspace(0.0, np.pi, 4001))),
        compiled=False,
    )
    times, phases = motion.transitions.time, motion.transitions.after
    releases = times[(phases == Phase.FORWARD) & (motion.transitions.before == Phase.STICK)]
    assert releases[:2] == pytest.approx([0.0, exact.period], rel=1e-11 + grain)
    assert times[phases == Phase.STICK][0] == pytest.approx(slip, rel=1e-11 + grain)
    # Each extreme by the parabola through its sample.
    ends = [int(function(motion.displacement)) for function in (np.argmax, np.argmin)]
    x, v, a = motion.displacement[ends], motion.velocity[ends], motion.acceleration[ends]
    turns = x - np.divide(0.5 * v**2, a, out=np.zeros(2), where=a != 0.0)
    assert 0.5 * (turns[0] - turns[1]) == pytest.approx(exact.amplitude, rel=1e-8 + grain)
    assert motion.slip_steps < 500


def test_weak_friction_overtakes_the_belt_as_the_exact_cycle_does() -> None:
    """eta = 1e-6: a million cycles to settle, but the cycle itself closes in one."""
    bearing, speed, load = replace(REFERENCE_BEARING, damping=4e-4), 0.1, 5e-3
    exact = exact_cycle(bearing, speed, load)
    assert exact.kind is CycleKind.OVERTAKING
    _, x, _ = exact.waveform(2)
    start = MotionState(float(x[0]), 0.0, Phase.FORWARD)
    drive = Drive.constant(speed, load, 1.01 * exact.period)
    motion = integrate(bearing, drive, start, compiled=False)
    assert motion.transitions.after.tolist() == [Phase.BACKWARD, Phase.FORWARD]
    assert motion.transitions.time[1] == pytest.approx(exact.period, rel=1e-13)
    assert motion.slip_steps < 60


@pytest.mark.parametrize('load', [LOAD, 2.5e4])
def test_rising_friction_damps_as_its_slope_says(load: float) -> None:
    """mu_k > mu_s: about steady sliding ``m u'' + (c + N mu') u' + k u = 0``, mu' > 0."""
    bearing, speed, small = replace(REFERENCE_BEARING, friction=Stribeck(0.1, 0.3, 10.0)), 0.1, 1e-9
    damping = bearing.damping + load * 0.2 * 10.0 * math.exp(-1.0)
    rate = damping / (2.0 * bearing.mass)
    turn = math.sqrt(bearing.natural_frequency**2 - rate**2)
    times = np.linspace(0.0, 2.0 / rate, 41)
    equilibrium = float(bearing.equilibrium(speed, load))
    drive = Drive.constant(speed, load, float(times[-1]))
    plus, minus = (
        integrate(bearing, drive, MotionState(equilibrium + u, speed), times, compiled=False)
        for u in (small, -small)
    )
    u = 0.5 * (plus.displacement - minus.displacement)
    shape = np.cos(turn * times) + rate / turn * np.sin(turn * times)
    assert u == pytest.approx(small * np.exp(-rate * times) * shape, abs=1e-5 * small)
    assert plus.transitions.time.size == 0
