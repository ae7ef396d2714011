# SPDX-License-Identifier: Apache-2.0
"""The integrator against closed forms and against the numbers of PHYSICS.md.

Short motions run without numba, so that what is tested does not depend on what is installed.
"""

from __future__ import annotations

import math
from dataclasses import replace

import mpmath as mp
import numpy as np
import pytest

from stickslip_monitor.errors import PhysicsError
from stickslip_monitor.physics.friction import Coulomb, Stribeck, Tabulated
from stickslip_monitor.physics.motion.integrator import (
    Accuracy,
    Drive,
    Motion,
    MotionOutcome,
    MotionState,
    Phase,
    PhaseChange,
    integrate,
)
from stickslip_monitor.physics.oscillator import Bearing

REFERENCE = Bearing(50.0, 400.0, 2.0e6, Stribeck(0.3, 0.1, 10.0), 0.1)
RPM = REFERENCE.speed.factor('rpm')
LOAD = 1000.0


def breakaway(speed: float) -> MotionState:
    return MotionState((0.3 * LOAD - REFERENCE.damping * speed) / REFERENCE.stiffness, 0.0)


def extremes(motion: Motion) -> tuple[float, float]:
    """Largest and smallest displacement, each by the parabola through its sample."""
    found = []
    for i in (np.argmax(motion.displacement), np.argmin(motion.displacement)):
        velocity, acceleration = motion.velocity[i], motion.acceleration[i]
        found.append(float(motion.displacement[i] - 0.5 * velocity**2 / acceleration))
    return found[0], found[1]


def amplitude(motion: Motion) -> float:
    high, low = extremes(motion)
    return 0.5 * (high - low)


def cycle(speed: float, load: float = LOAD, bearing: Bearing = REFERENCE) -> Motion:
    """A stick-slip cycle, finely sampled, after half a second to settle."""
    drive = Drive.constant(speed, load, 0.7)
    times = np.linspace(0.6, 0.7, 4001)
    return integrate(bearing, drive, breakaway(speed), times, compiled=False)


def period(motion: Motion) -> float:
    t = motion.transitions
    releases = t.time[t.change == PhaseChange.RELEASE]
    return float((releases[-1] - releases[-11]) / 10.0)


# The exact cycle: amplitude [mm] and period [ms] of PHYSICS.md, to the digits printed there.
CYCLES = [
    (10.0, 0.296953, 31.9456),
    (20.0, 0.556755, 31.5903),
    (30.0, 0.804800, 31.4606),
    (38.0, 1.000212, None),
    (40.0, 1.048880, 31.423),
]


@pytest.mark.parametrize(('rpm', 'millimetres', 'milliseconds'), CYCLES)
def test_exact_cycle(rpm: float, millimetres: float, milliseconds: float | None) -> None:
    motion = cycle(rpm * RPM)
    assert 1e3 * amplitude(motion) == pytest.approx(millimetres, abs=0.6e-6)
    if milliseconds is not None:
        digits = 3 if rpm == 40.0 else 4
        assert round(1e3 * period(motion), digits) == milliseconds


def test_grazing_contact_is_met_in_every_cycle() -> None:
    """At 40 rpm a locator that jumps over the contact finds twice the period."""
    times = cycle(40.0 * RPM).transitions
    releases = times.time[times.change == PhaseChange.RELEASE]
    assert np.ptp(np.diff(releases)[2:]) < 1e-12


@pytest.mark.parametrize(('factor', 'sticks'), [(1.0 - 1e-4, True), (1.0 + 1e-4, False)])
def test_stick_slip_ends_at_the_fold(factor: float, sticks: bool) -> None:
    speed = 0.2131982 * factor
    drive = Drive.constant(speed, LOAD, 3.0)
    motion = integrate(REFERENCE, drive, breakaway(speed), compiled=False)
    assert (motion.transitions.time.size > 150) == sticks


def test_far_above_the_fold_the_motion_decays_to_equilibrium() -> None:
    speed = 1.1 * 0.2131982
    drive = Drive.constant(speed, LOAD, 12.0)
    motion = integrate(REFERENCE, drive, breakaway(speed), compiled=False)
    equilibrium = float(REFERENCE.equilibrium(speed, LOAD))
    assert motion.final.displacement == pytest.approx(equilibrium, rel=1e-9)
    assert motion.final.relative_speed == pytest.approx(speed, rel=1e-9)


def grows(offset: float, side: float, speed: float) -> bool:
    """Whether a displacement from equilibrium, released without velocity, ends in stick-slip."""
    state = MotionState(float(REFERENCE.equilibrium(speed, LOAD)) + side * offset, speed)
    drive = Drive.constant(speed, LOAD, 1.5)
    motion = integrate(REFERENCE, drive, state, (0.0, 1.5), compiled=False)
    x = motion.displacement - float(REFERENCE.equilibrium(speed, LOAD))
    v = (motion.velocity / REFERENCE.natural_frequency)[1]
    return motion.transitions.time.size > 0 or math.hypot(x[1], v) > abs(x[0])


def test_bistable_outcome_turns_at_the_unstable_amplitude() -> None:
    """The crest and the trough from which the motion neither grows nor decays, at 34 rpm."""
    speed, turning = 34.0 * RPM, []
    for side in (1.0, -1.0):
        assert not grows(0.9 * 0.592815e-3, side, speed)
        assert grows(1.1 * 0.592815e-3, side, speed)
        low, high = 0.5e-3, 0.7e-3
        while high - low > 1e-7:
            middle = 0.5 * (low + high)
            low, high = (low, middle) if grows(middle, side, speed) else (middle, high)
        turning.append(0.5 * (low + high))
    assert np.mean(turning) == pytest.approx(0.592815e-3, rel=1e-3)


def test_undamped_coulomb_cycle() -> None:
    """An arc about ``mu_k N/k`` in the phase plane, then a straight line back to its begin."""
    bearing = replace(REFERENCE, friction=Coulomb(0.3, 0.1), damping=0.0)
    speed, omega = 0.05, bearing.natural_frequency
    reach = 0.2 * LOAD / bearing.stiffness
    slip = 2.0 * (math.pi - math.atan(reach * omega / speed)) / omega
    stick = 2.0 * reach / speed
    state = MotionState(0.3 * LOAD / bearing.stiffness, 0.0)
    times = np.linspace(0.0, 0.1, 5001)
    motion = integrate(
        bearing, Drive.constant(speed, LOAD, 0.5), state, times, energy=True, compiled=False
    )
    assert period(motion) == pytest.approx(slip + stick, rel=1e-12)
    assert amplitude(motion) == pytest.approx(math.hypot(reach, speed / omega), rel=1e-11)
    intervals = motion.stick_intervals
    assert np.diff(intervals[1:-1], axis=1) == pytest.approx(stick, rel=1e-10)
    assert motion.energy is not None
    assert motion.energy.closure < 1e-12


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
    assert motion.transitions.change.tolist() == [PhaseChange.REVERSAL] * (swings - 1) + [1]
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


def test_load_ramp_on_a_sliding_lining() -> None:
    """Coulomb friction under a load that falls to zero, with a closed form (shape ``b - a t``)."""
    bearing = replace(REFERENCE, friction=Coulomb(0.3, 0.1))
    c, k = bearing.damping, bearing.stiffness
    rate = 0.1 * 5000.0 / k
    start = 0.1 * LOAD / k + c * rate / k
    motion = integrate(
        bearing,
        Drive.sampled([0.0, 0.2, 0.3], [0.5, 0.5, 0.5], [LOAD, 0.0, 0.0]),
        MotionState(start + 1e-4, 0.5 + rate),
        np.linspace(0.0, 0.2, 41),
        compiled=False,
    )
    line = start - rate * motion.time
    expected = [
        y + damped(bearing, 0.0, 1e-4, 0.0, t) for y, t in zip(line, motion.time, strict=True)
    ]
    assert motion.displacement == pytest.approx(expected, abs=1e-16)


def test_slip_phase_against_mpmath() -> None:
    """One Stribeck slip phase to the re-stick, by Taylor series at 30 digits."""
    speed = 0.1
    state = breakaway(speed)
    motion = integrate(REFERENCE, Drive.constant(speed, LOAD, 0.029), state, compiled=False)
    end = motion.transitions.time[1]
    at = np.array([0.004, 0.013, 0.025])
    sampled = integrate(REFERENCE, Drive.constant(speed, LOAD, 0.029), state, at, compiled=False)
    with mp.workdps(30):

        def rate(t: mp.mpf, y: list[mp.mpf]) -> list[mp.mpf]:
            force = LOAD * (mp.mpf('0.1') + mp.mpf('0.2') * mp.exp(-10 * (speed - y[1])))
            return [y[1], (force - 400 * y[1] - 2000000 * y[0]) / 50]

        x0 = (mp.mpf('0.3') * 1000 - 400 * mp.mpf(speed)) / 2000000
        solution = mp.odefun(rate, 0, [x0, mp.mpf(speed)], tol=mp.mpf('1e-20'))
        expected = [[float(value) for value in solution(t)] for t in at]
        contact = solution(mp.mpf(float(end)))
        assert abs(contact[1] - speed) < 1e-13
    assert np.transpose([sampled.displacement, sampled.velocity]) == pytest.approx(
        np.array(expected), rel=1e-11
    )


HARD = {
    'crawling': (REFERENCE, 1e-9, LOAD, MotionState(1.5e-4 - 4e-13, 0.0)),
    'very sharp law': (replace(REFERENCE, friction=Stribeck(0.3, 0.1, 1e5)), 0.1, LOAD, None),
    'no damping': (replace(REFERENCE, damping=0.0), 0.1, LOAD, None),
    'heavy damping': (replace(REFERENCE, damping=1.8e4), 0.1, LOAD, None),
    'eta 1e-6': (REFERENCE, 0.1, 5e-3, None),
    'eta 1e3': (REFERENCE, 0.1, 5e6, None),
    'eta 1e3, released': (REFERENCE, 0.1, 5e6, MotionState(0.75 - 3e-5, 0.0)),
    'level law': (replace(REFERENCE, friction=Stribeck(0.2, 0.2, 10.0)), 0.1, LOAD, None),
    'rising law': (replace(REFERENCE, friction=Stribeck(0.1, 0.3, 10.0)), 0.1, LOAD, None),
    'rising, eta 1e3': (
        replace(REFERENCE, friction=Stribeck(0.1, 0.3, 10.0)),
        0.1,
        5e6,
        MotionState(0.25, 0.0),
    ),
    'rising Coulomb': (replace(REFERENCE, friction=Coulomb(0.1, 0.3)), 0.1, LOAD, None),
    'few points': (
        replace(REFERENCE, friction=Tabulated([0.02, 0.1, 0.5], [0.3, 0.15, 0.2])),
        0.1,
        LOAD,
        None,
    ),
    'no load, no speed': (REFERENCE, 0.0, 0.0, MotionState(1e-3, 0.0)),
    'nothing at all': (REFERENCE, 0.0, 0.0, None),
    'almost denormal': (REFERENCE, 0.0, 0.0, MotionState(1e-310, 0.0)),
}


@pytest.mark.filterwarnings('error')
@pytest.mark.parametrize('name', HARD)
def test_hard_cases_end_and_are_finite(name: str) -> None:
    bearing, speed, load, state = HARD[name]
    drive = Drive.constant(speed, load, 1.0)
    motion = integrate(
        bearing,
        drive,
        state or MotionState(0.0, 0.0),
        np.linspace(0.0, 1.0, 101),
        energy=True,
        compiled=False,
    )
    assert motion.outcome is MotionOutcome.COMPLETE
    for column in (motion.displacement, motion.velocity, motion.acceleration):
        assert np.isfinite(column).all()
    # About 32 periods: a bound that only stiffness (rising law, eta = 1000) may come near.
    assert motion.steps < (60_000 if 'eta 1e3' in name else 1_000)
    assert np.all(np.diff(motion.transitions.time) >= 0.0)
    assert motion.energy is not None
    assert motion.energy.closure < 1e-10


def test_level_stribeck_law_is_coulombs() -> None:
    drive = Drive.constant(0.05, LOAD, 0.5)
    laws = (Stribeck(0.2, 0.2, 10.0), Coulomb(0.2, 0.2), Tabulated([0.0, 1.0], [0.2, 0.2]))
    ends = [
        integrate(
            replace(REFERENCE, friction=law), drive, MotionState(1e-3, 0.3), compiled=False
        ).final
        for law in laws
    ]
    for end in ends[1:]:
        assert end.displacement == pytest.approx(ends[0].displacement, rel=1e-11)
        assert end.relative_speed == pytest.approx(ends[0].relative_speed, rel=1e-11)


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
            Drive.sampled(grid, side * speed, load, 'cubic'),
            MotionState(side * 1e-4, 0.0),
            times,
            compiled=False,
        )
        for side in (1.0, -1.0)
    )
    assert np.array_equal(ahead.displacement, -astern.displacement)
    assert np.array_equal(ahead.phase, -astern.phase)


def test_transitions_follow_from_the_phases() -> None:
    motion = cycle(20.0 * RPM)
    t = motion.transitions
    assert motion.start.phase is Phase.STICK
    assert t.before[0] == Phase.STICK
    assert np.array_equal(t.before[1:], t.after[:-1])
    middle = 0.5 * np.sum(motion.stick_intervals, axis=1)
    sampled = integrate(
        REFERENCE,
        Drive.constant(20.0 * RPM, LOAD, 0.7),
        breakaway(20.0 * RPM),
        middle,
        compiled=False,
    )
    assert sampled.sticking.all()
    assert np.all(sampled.velocity == 20.0 * RPM)


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
    motion = integrate(
        REFERENCE,
        Drive.constant(0.1, LOAD, 1.0),
        MotionState(1e300, 0.1),
        [0.0, 1.0],
        compiled=False,
    )
    assert motion.outcome is MotionOutcome.NOT_FINITE
    assert motion.displacement.size == 0
