# SPDX-License-Identifier: Apache-2.0
"""The exact stick-slip cycle against PHYSICS.md, closed forms and Taylor series in 40 digits."""

from __future__ import annotations

import math

import mpmath as mp
import numpy as np
import pytest
import taylor
from numpy.testing import assert_allclose, assert_array_equal
from shared import LAWS, REFERENCE_BEARING, unit_bearing

from stickslip_monitor.physics import orbits
from stickslip_monitor.physics.averaging import growth_rate
from stickslip_monitor.physics.bearing import Bearing
from stickslip_monitor.physics.cycles import (
    CycleKind,
    exact_amplitude,
    exact_cycle,
    exact_fold_speed,
    exact_unstable_cycle,
)
from stickslip_monitor.physics.friction import Coulomb, Stribeck, Tabulated
from stickslip_monitor.physics.integrator import Drive, MotionState, integrate

pytestmark = pytest.mark.filterwarnings('error')


def surface_speed(value: float) -> float:
    return float(REFERENCE_BEARING.speed.to_surface(value, 'rpm'))


@pytest.mark.parametrize(
    ('speed', 'amplitude', 'period'),
    [
        (10, 0.296953, 31.9456),
        (20, 0.556755, 31.5903),
        (30, 0.804800, 31.4606),
        (38, 1.000212, None),
        (40, 1.048880, 31.423),
    ],
)
def test_the_bench_of_physics_md(speed, amplitude, period):
    cycle = exact_cycle(REFERENCE_BEARING, surface_speed(speed), 1000.0)
    assert cycle.kind is CycleKind.STICK_SLIP
    assert cycle.amplitude * 1e3 == pytest.approx(amplitude, abs=6e-7)
    if period:
        assert cycle.period * 1e3 == pytest.approx(period, abs=5e-4 if speed == 40 else 6e-5)


# eta, kappa, beta V, refinement of the reference where a boundary layer needs it
POINTS = [
    (0.2, 0.2, math.pi / 3.0, 4),  # the bench at 20 rpm
    (0.2, 0.2, 2.13, 4),
    (0.2, 0.0, 1e-9, 4),
    (1e-6, 0.2, 1e-4, 4),
    (5.0, 0.01, 18.0, 4),
    (100.0, 0.018, 1.0, 4),
    (1e3, 0.0, 1e-9, 4),
]


@pytest.mark.slow
@pytest.mark.parametrize(('eta', 'kappa', 'speed', 'refine'), POINTS)
def test_taylor_series_in_40_digits(eta, kappa, speed, refine):
    bearing, load = unit_bearing(kappa * eta / 2.0), eta / 0.2
    cycle = exact_cycle(bearing, speed, load)
    force = mp.mpf(load) / mp.mpf(speed)
    static, kinetic = force * mp.mpf(0.3), force * mp.mpf(0.1)
    amplitude, period, stick = taylor.stick_slip(
        mp.mpf(bearing.damping) / 2, static, kinetic, mp.mpf(speed), refine
    )
    assert cycle.kind is CycleKind.STICK_SLIP
    assert cycle.amplitude / speed == pytest.approx(float(amplitude), rel=1e-10)
    assert cycle.period == pytest.approx(float(period), rel=1e-10)
    assert cycle.stick_fraction == pytest.approx(float(stick), rel=1e-9)


@pytest.mark.parametrize('speed', [1e-9, 1e-3, 0.3, 10.0, 1e3])
def test_undamped_coulomb_in_closed_form(speed):
    # Slip is a circle of radius sqrt(g^2 + 1) about steady sliding, from (g, 1) to (-g, 1).
    g = 10.0 * 0.2 / speed
    cycle = exact_cycle(unit_bearing(0.0, Coulomb(0.3, 0.1)), speed, 10.0)
    period = math.pi + 2.0 * math.atan2(1.0, g) + 2.0 * g
    assert cycle.amplitude == pytest.approx(speed * math.hypot(1.0, g), rel=1e-10)
    assert cycle.period == pytest.approx(period, rel=1e-10)
    assert cycle.stick_fraction == pytest.approx(2.0 * g / period, rel=1e-9)


def damped_coulomb_fold(zeta: float, drop: float) -> mp.mpf:
    """Return where the spiral from (drop/V, 1) about steady sliding grazes the belt, in closed form."""
    damped = mp.sqrt(1 - mp.mpf(zeta) ** 2)

    def miss(speed, time):
        # From the start u0 = g - 2 zeta, y = 1 to y = 1 with y' = 0, which is u = -2 zeta.
        u0 = mp.mpf(drop) / speed - 2 * mp.mpf(zeta)
        decay, c, s = mp.exp(-zeta * time), mp.cos(damped * time), mp.sin(damped * time)
        u = decay * (u0 * c + (1 + zeta * u0) / damped * s)
        y = decay * (c - (u0 + zeta) / damped * s)
        return u + 2 * mp.mpf(zeta), y - 1

    return mp.findroot(miss, (mp.mpf(2.2), mp.mpf(5.5)))[0]


def test_the_fold_of_damped_coulomb_in_closed_form():
    expected = damped_coulomb_fold(0.05, 2.0)
    fold = exact_fold_speed(unit_bearing(0.05, Coulomb(0.3, 0.1)), 10.0)
    assert fold == pytest.approx(float(expected), rel=1e-10)


def test_the_fold_and_the_unstable_cycle_of_physics_md():
    assert exact_fold_speed(REFERENCE_BEARING, 1000.0) == pytest.approx(0.2131982, abs=6e-8)
    cycle = exact_unstable_cycle(REFERENCE_BEARING, surface_speed(34.0), 1000.0)
    assert cycle.amplitude * 1e3 == pytest.approx(0.592815, abs=6e-7)


@pytest.mark.parametrize(
    ('zeta', 'eta', 'speed'),
    # In the second the phase ahead of the belt spans two steps, the last of which only just began.
    [(1e-4, 0.001, 2.0), (1e-3, 0.01083144557832, 0.5647044)],
)
def test_overtaking_closes_under_the_reference(zeta, eta, speed):
    # One round by Taylor series in 40 digits, starting where the solver says the cycle starts.
    bearing, load = unit_bearing(zeta), eta / 0.2
    cycle = exact_cycle(bearing, speed, load)
    force = mp.mpf(load) / mp.mpf(speed)
    law = (mp.mpf(bearing.damping) / 2, force * mp.mpf(0.3), force * mp.mpf(0.1), mp.mpf(speed))
    _, displacement, _ = cycle.waveform(2)
    start = mp.mpf(float(displacement[0] / speed))
    behind, x, (top, bottom) = taylor.slip_phase(taylor.Slip(*law), start)
    ahead, end, _ = taylor.slip_phase(taylor.Slip(*law, side=-1), x, turns=0)
    assert float(end) == pytest.approx(float(start), abs=1e-10)
    assert cycle.period == pytest.approx(float(behind + ahead), rel=1e-9)
    assert cycle.amplitude / speed == pytest.approx(float(top - bottom) / 2.0, rel=1e-10)
    # The slope of a round, by a difference of 1e-15.
    step = mp.mpf(10) ** -15
    _, beside, _ = taylor.slip_phase(taylor.Slip(*law), start + step)
    _, moved, _ = taylor.slip_phase(taylor.Slip(*law, side=-1), beside, turns=0)
    assert cycle.multiplier == pytest.approx(float((moved - end) / step), rel=1e-7)


@pytest.mark.slow
@pytest.mark.parametrize(('eta', 'kappa', 'speed'), [(0.2, 0.2, 1.78), (0.2, 0.2, 2.1319), (1e-6, 0.2, 1.8)])
def test_the_unstable_cycle_and_its_multiplier(eta, kappa, speed):
    # The return map in 40 digits: its fixed point, and its slope by a difference of 1e-15.
    bearing, load = unit_bearing(kappa * eta / 2.0), eta / 0.2
    cycle = exact_unstable_cycle(bearing, speed, load)
    assert cycle.kind is CycleKind.PURE_SLIP
    force = mp.mpf(load) / mp.mpf(speed)
    law = (mp.mpf(bearing.damping) / 2, force * mp.mpf(0.3), force * mp.mpf(0.1), mp.mpf(speed))
    _, displacement, _ = cycle.waveform(2)
    x = mp.mpf(float(np.min(displacement))) / mp.mpf(speed)
    (top, bottom), period = taylor.return_map(*law, x)
    step = mp.mpf(10) ** -15
    slope = (taylor.return_map(*law, x + step)[0][1] - bottom) / step
    assert cycle.multiplier == pytest.approx(float(slope), rel=1e-9)
    assert float((bottom - x) / (slope - 1)) == pytest.approx(0.0, abs=1e-7)
    assert cycle.amplitude / speed == pytest.approx(float(top - bottom) / 2.0, rel=1e-7)
    assert cycle.period == pytest.approx(float(period), rel=1e-7)


@pytest.mark.slow
def test_branches_meet_at_the_fold():
    # Both end in the orbit that grazes the belt, however stiff: eta = 20 is a canard.
    for eta, kappa in ((0.2, 0.2), (20.0, 0.01)):
        bearing, load = unit_bearing(kappa * eta / 2.0), eta / 0.2
        speed = exact_fold_speed(bearing, load) * (1.0 - 1e-12)
        stable = exact_cycle(bearing, speed, load).amplitude
        assert exact_unstable_cycle(bearing, speed, load).amplitude == pytest.approx(stable, rel=1e-10)


@pytest.mark.parametrize('points', [1, 40])  # one after another, and together as arrays
def test_within_1e_9_of_the_fold_the_kind_is_ill_posed(points):
    fold = exact_fold_speed(REFERENCE_BEARING, 1000.0)
    kinds = {-5e-9: CycleKind.STICK_SLIP, 0.0: CycleKind.AT_FOLD, 5e-9: CycleKind.NONE}
    for away, kind in kinds.items():
        speed = np.full(points, fold * (1.0 + away))
        assert_array_equal(exact_cycle(REFERENCE_BEARING, speed, 1000.0).kind, kind)
    assert exact_unstable_cycle(REFERENCE_BEARING, fold, 1000.0).kind is CycleKind.AT_FOLD
    assert 'ill-posed' in CycleKind.AT_FOLD.sentence


@pytest.mark.parametrize('points', [1, 40])
def test_an_unstable_cycle_that_doubles_do_not_resolve_says_so(points):
    # It exists: something parts stable sliding from stick-slip (Poincare and Bendixson).
    bearing, load = unit_bearing(0.1), 300.0
    speed = np.full(points, 0.7 * exact_fold_speed(bearing, load))
    assert exact_cycle(bearing, speed[0], load).kind is CycleKind.STICK_SLIP
    assert growth_rate(bearing, speed[0], load) < 0.0
    cycle = exact_unstable_cycle(bearing, speed, load)
    assert_array_equal(cycle.kind, CycleKind.TOO_UNSTABLE)
    assert np.all(np.isnan(cycle.waveform(3)))
    assert '1e12' in CycleKind.TOO_UNSTABLE.sentence


@pytest.mark.parametrize('zeta', [0.014, 0.03])
def test_beyond_the_fold_nothing_is_unstable(zeta):
    # A closed orbit about stable sliding needs a vibration outside it (Poincare and Bendixson).
    kappa = 1e-4  # c/N as a share of the steepest fall: so little that an orbit at the belt explodes
    bearing = unit_bearing(zeta)
    load = 2.0 * zeta / (0.2 * kappa)
    speeds = exact_fold_speed(bearing, load) * np.array([1.0001, 1.02, 1.1, 1.5])
    assert_array_equal(exact_cycle(bearing, speeds, load).kind, CycleKind.NONE)
    cycle = exact_unstable_cycle(bearing, speeds, load)
    assert_array_equal(cycle.kind, CycleKind.NONE)
    assert np.all(np.isnan([cycle.amplitude, cycle.multiplier, cycle.period]))


def test_the_waveform_closes_and_obeys_the_equation():
    cycle = exact_cycle(REFERENCE_BEARING, 0.1, 1000.0)
    time, x, v = cycle.waveform(20001)
    assert x[0] == pytest.approx(x[-1], rel=1e-10)
    assert v[0] == pytest.approx(v[-1], rel=1e-10) == pytest.approx(0.1)
    assert (np.max(x) - np.min(x)) / 2.0 == pytest.approx(cycle.amplitude, rel=1e-7)
    assert np.mean(v == 0.1) == pytest.approx(cycle.stick_fraction, abs=2e-4)
    force = 1000.0 * REFERENCE_BEARING.friction.coefficient(0.1 - v) - 400.0 * v - 2.0e6 * x
    acceleration = (v[2:] - v[:-2]) / (time[2:] - time[:-2])
    slipping = np.all([v[k : v.size - 2 + k] != 0.1 for k in range(3)], axis=0)
    # Central differences: their error is the step squared.
    assert_allclose(50.0 * acceleration[slipping], force[1:-1][slipping], atol=2e-2)


@pytest.mark.parametrize(
    ('speed', 'load', 'kind'),
    [
        (0.3, 1000.0, CycleKind.NONE),
        (0.0, 1000.0, CycleKind.AT_REST),
        (0.1, 0.0, CycleKind.NO_CONTACT),
        (0.1, -5.0, CycleKind.NO_CONTACT),
        (math.nan, 1000.0, CycleKind.NOT_FINITE),
        (0.1, math.inf, CycleKind.NOT_FINITE),
        (1e-300, 1000.0, CycleKind.UNRESOLVED),
    ],
)
def test_points_without_a_cycle_say_why(speed, load, kind):
    cycle = exact_cycle(REFERENCE_BEARING, speed, load)
    assert cycle.kind is kind
    assert cycle.kind.sentence.endswith('.')
    assert math.isnan(cycle.amplitude)
    assert math.isnan(cycle.period)


def test_a_cycle_that_forgets_every_disturbance_has_the_period_of_the_motion():
    # Of this table, which rises and falls twice: back in time its orbits part by 1e12 a turn.
    speed = [0.0, 0.001, 0.033, 0.173, 0.317, 0.544, 0.553, 0.776, 0.787]
    table = Tabulated(speed, [0.094, 0.4, 0.452, 0.32, 0.068, 0.069, 0.205, 0.279, 0.311])
    cycle = exact_cycle(Bearing(2354.7, 852.4, 2448.2, table, 0.12), 0.279, 2000.0)
    assert cycle.kind is CycleKind.PURE_SLIP
    # From sliding on for 90 s, by the integrator of another method.
    assert cycle.amplitude == pytest.approx(0.3358171406, rel=1e-8)
    assert cycle.period == pytest.approx(6.691999, rel=1e-6)


@pytest.mark.parametrize(
    'bearing',
    [
        unit_bearing(0.0, Stribeck(0.3, 0.3, 10.0)),
        unit_bearing(0.0, Coulomb(0.1, 0.3)),
        unit_bearing(0.0, Tabulated([0.0, 1.0], [0.1, 0.3])),
    ],
)
def test_friction_that_does_not_fall_has_no_cycle(bearing):
    # Bendixson's criterion: no region of growth, no isolated cycle.
    assert exact_cycle(bearing, 0.3, 50.0).kind is CycleKind.NONE
    assert exact_unstable_cycle(bearing, 0.3, 50.0).kind is CycleKind.NONE
    assert math.isnan(exact_fold_speed(bearing, 50.0))


def test_fold_conventions():
    assert_array_equal(np.isnan(exact_fold_speed(REFERENCE_BEARING, [0.0, -1.0, math.nan, 100.0])), True)
    assert exact_fold_speed(REFERENCE_BEARING, [[900.0], [1100.0]]).shape == (2, 1)


# The model is meant for underdamped linings: pairs with zeta above 0.95 are left out.
_HARD = [
    (eta, kappa)
    for eta in (1e-6, 1e-3, 0.2, 5.0, 100.0, 1e3)
    for kappa in (0.0, 0.0018, 0.2, 0.9)
    if kappa * eta / 2.0 <= 0.95
]


@pytest.mark.parametrize(('eta', 'kappa'), _HARD)
def test_hard_cases_end_named_and_bounded(eta, kappa):
    bearing = unit_bearing(kappa * eta / 2.0)
    cycle = exact_cycle(bearing, np.array([1e-9, 1e-4, 0.01, 1.0, 10.0, 1e4]), eta / 0.2)
    exists = cycle.kind <= CycleKind.OVERTAKING
    assert_array_equal(exists | (cycle.kind == CycleKind.NONE), True)
    assert np.all(np.isfinite(cycle.amplitude[exists]))
    assert np.all(np.isfinite(cycle.period[exists]))
    # Once gone with rising speed the cycle stays gone.
    assert np.all(np.diff(exists.astype(int)) <= 0)


def test_a_table_has_a_cycle_at_every_speed_alone_and_together():
    # A step far beyond its measured speeds left the range of numbers: the orbit ended there.
    law = Tabulated([0, 0.30, 0.316, 0.406, 0.423, 0.49], [0.30, 0.108, 0.1094, 0.1037, 0.1031, 0.1029])
    bearing = Bearing(1.0, 66.9, 1e4, law, 0.1)
    speed = np.linspace(0.05, 0.6, 111)
    cycle = exact_cycle(bearing, speed, 2200.0)
    assert_array_equal(cycle.kind, CycleKind.STICK_SLIP)
    assert 1e3 * cycle.amplitude[74] == pytest.approx(27.534, abs=5e-4)
    alone = [exact_cycle(bearing, v, 2200.0) for v in speed[70:]]
    assert_array_equal([cycle_alone.kind for cycle_alone in alone], cycle.kind[70:])
    assert_allclose([cycle_alone.amplitude for cycle_alone in alone], cycle.amplitude[70:], rtol=1e-12)


def test_amplitudes_of_many_points_are_those_of_cycles_one_by_one():
    """Amplitudes take longer steps than cycles do."""
    draw, bearing = np.random.default_rng(35), unit_bearing(1e-3)
    speed, load = 10.0 ** draw.uniform(-2.0, 1.0, (2, 300))
    alone = [exact_cycle(bearing, v, n) for v, n in zip(speed, load, strict=True)]
    kinds = {cycle.kind for cycle in alone}
    assert kinds == {CycleKind.STICK_SLIP, CycleKind.OVERTAKING, CycleKind.NONE}
    together = exact_amplitude(bearing, speed, load)
    assert_allclose(together, [cycle.amplitude for cycle in alone], rtol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize('law', ['stribeck', 'coulomb', 'two falls'])
def test_compiled_amplitudes_are_the_same_bits(law, monkeypatch):
    """About the end of sticking, where the last digits decide whether the lining sticks."""
    pytest.importorskip('numba')
    bearing, draw = Bearing(50.0, 400.0, 2.0e6, LAWS[law], 0.1), np.random.default_rng(8)
    load = draw.uniform(500.0, 3000.0, 40)
    speed = draw.uniform(0.3, 1.1, 40) * exact_fold_speed(bearing, load)
    monkeypatch.setattr(orbits, 'PATIENCE', math.inf)
    amplitude = exact_amplitude(bearing, speed, load)
    monkeypatch.setattr(orbits, 'PATIENCE', 0)
    compiled = exact_amplitude(bearing, speed, load)
    assert np.isfinite(amplitude).any()
    assert amplitude.tobytes() == compiled.tobytes()


def test_a_vibration_that_never_sticks_has_amplitude_and_period():
    """Friction falls over some speeds only; against the motion in time, by another integrator."""
    law = Tabulated([0.0, 0.5, 0.6, 0.8, 0.9, 1.4], [0.2, 0.2, 0.19, 0.13, 0.12, 0.12])
    bearing = Bearing(1.0, 20.0, 1e4, law, 0.1)
    cycle = exact_cycle(bearing, [0.7, -0.7, 1.2], 100.0)
    assert_array_equal(cycle.kind, [CycleKind.PURE_SLIP, CycleKind.PURE_SLIP, CycleKind.NONE])

    start = MotionState(float(bearing.equilibrium(0.7, 100.0)) + 1e-3, 0.7)
    times = np.linspace(6.0, 6.2, 20001)
    motion = integrate(bearing, Drive.constant(0.7, 100.0, 6.2), start, times, compiled=False)
    v = motion.velocity
    turns = np.flatnonzero((v[:-1] < 0.0) & (v[1:] >= 0.0))
    at = times[turns] - v[turns] * 1e-5 / (v[turns + 1] - v[turns])
    assert 0.0 < cycle.multiplier[0] < 1.0
    assert cycle.stick_fraction[0] == 0.0
    assert cycle.amplitude[0] == pytest.approx(0.5 * np.ptp(motion.displacement), rel=1e-6)
    assert cycle.period[0] == pytest.approx(at[-1] - at[-2], rel=1e-6)
    assert cycle.amplitude[1] == cycle.amplitude[0]
    time, x, _ = exact_cycle(bearing, 0.7, 100.0).waveform(50)
    assert 0.5 * np.ptp(x) == pytest.approx(cycle.amplitude[0], rel=5e-3)
    assert time[-1] == cycle.period[0]


@pytest.mark.parametrize('zeta', [0.001, 0.05, 0.3])
def test_the_unstable_cycle_of_constant_friction_grazes_the_belt(zeta):
    """Swing back from the belt, damped, in closed form: beside the belt ``x'`` = 1 and ``x''`` = 0."""
    bearing = Bearing(1.0, 2.0 * zeta, 1.0, Coulomb(0.3, 0.1), 0.1)
    speed = 0.5 * exact_fold_speed(bearing, 1.0)
    cycle = exact_unstable_cycle(bearing, speed, 1.0)
    damped = math.sqrt(1.0 - zeta**2)

    def swing(t):
        fades, b = math.exp(-zeta * t), (1.0 - 2.0 * zeta**2) / damped
        return fades * (-2.0 * zeta * math.cos(damped * t) + b * math.sin(damped * t))

    # It turns where its speed is 0, a half period apart.
    turn = math.atan2(damped, -zeta) / damped - math.pi / damped
    times = [turn - k * math.pi / damped for k in range(3) if turn - k * math.pi / damped < 0.0]
    right = 0.5 * speed * abs(swing(times[0]) - swing(times[1]))
    assert cycle.kind == CycleKind.TOO_UNSTABLE
    assert cycle.amplitude == pytest.approx(right, rel=1e-11)
    assert exact_unstable_cycle(bearing, 3.0 * speed, 1.0).kind == CycleKind.NONE
