# SPDX-License-Identifier: Apache-2.0
"""Harmonic balance, smoothed friction, switching, the event-driven integrator, the exact cycle."""

from __future__ import annotations

import math

import numpy as np
import pytest

from stickslip_monitor.commands.accuracy import follow
from stickslip_monitor.lab.accuracy.cases import CASES
from stickslip_monitor.lab.accuracy.cases import REFERENCE_BEARING as BENCH
from stickslip_monitor.lab.accuracy.harmonic_balance import (
    HarmonicBalance,
    _Law,
    _Problem,
    _rungs,
    _Series,
    half_range,
)
from stickslip_monitor.lab.accuracy.method import MethodOutcome, breakaway
from stickslip_monitor.lab.accuracy.own_methods import (
    EventDriven,
    ExactCycle,
    Samples,
    turning_points,
)
from stickslip_monitor.lab.accuracy.time_stepping import Regularised, Switching, run
from stickslip_monitor.physics.averaging.boundaries import harmonic
from stickslip_monitor.physics.cycle.cycles import exact_cycle
from stickslip_monitor.physics.friction import Stribeck
from stickslip_monitor.physics.motion.integrator import Drive, MotionState, integrate
from stickslip_monitor.physics.oscillator import Bearing

pytestmark = pytest.mark.filterwarnings('error')


def rpm(value: float) -> float:
    return float(BENCH.speed.to_surface(value, 'rpm'))


def error(method, speed: float) -> float:
    amplitude = method.amplitude(BENCH, rpm(speed), 1000.0).amplitude
    return amplitude / exact_cycle(BENCH, rpm(speed), 1000.0).amplitude - 1.0


# PHYSICS.md: -1.4 %, -0.2 %, -0.03 % at 20 rpm, double at 10 rpm.
@pytest.mark.parametrize(('width', 'bias'), [(1e-3, -1.4e-2), (1e-4, -2e-3), (1e-5, -3e-4)])
def test_the_bias_of_smoothing(width, bias):
    at_20, at_10 = (error(Regularised(width, tight=True), speed) for speed in (20, 10))
    assert at_20 == pytest.approx(bias, rel=0.15)
    assert at_10 / at_20 == pytest.approx(2.1, abs=0.15)


def test_default_tolerance_is_worse_than_the_smoothing_it_resolves():
    assert abs(error(Regularised(1e-5, tight=False), 10)) > 50.0 * 5e-4


def evaluations_of_two_cycles(method: str, width: float) -> int:
    speed, load = rpm(10), 1000.0
    flow = Regularised(width, tight=True)._flow(BENCH, speed, load)
    span = (0.0, 2.0 * exact_cycle(BENCH, speed, load).period)
    start = (breakaway(BENCH, speed, load), speed)
    return run(flow, span, start, method=method, rtol=1e-6, atol=1e-10).evaluations


def test_the_step_of_an_explicit_method_collapses_where_smoothed_friction_sticks():
    """solve_ivp's own choice, RK45: while the lining sticks, the step cannot exceed 3.3 time
    constants ``m width/(N mu_s)`` (the real stability interval of Dormand and Prince's pair;
    Hairer and Wanner II, IV.2), at six evaluations a step.
    """
    cycle = exact_cycle(BENCH, rpm(10), 1000.0)
    stick = 2.0 * cycle.stick_fraction * cycle.period
    counts = [evaluations_of_two_cycles('RK45', width) for width in (1e-2, 1e-5, 2.5e-6)]
    for width, count in zip((1e-5, 2.5e-6), counts[1:], strict=True):
        steps = stick / 3.3 * 1000.0 * 0.3 / (50.0 * width)
        assert count - counts[0] == pytest.approx(6.0 * steps, rel=0.25)
    # An implicit method pays with its matrices, not with its step.
    implicit = [evaluations_of_two_cycles('LSODA', width) for width in (1e-3, 2.5e-6)]
    assert implicit[1] < 2 * implicit[0]


def test_event_driven_methods_need_no_step_for_stick():
    """However long the lining sticks: at 0.01 rpm for all but a 200th of the cycle."""
    for speed, sticks in ((10, 0.1), (0.01, 0.99)):
        cycle = exact_cycle(BENCH, rpm(speed), 1e6)
        start = MotionState(float(breakaway(BENCH, rpm(speed), 1e6)), 0.0)
        drive = Drive.constant(rpm(speed), 1e6, 2.0 * cycle.period)
        motion = integrate(BENCH, drive, start, compiled=False)
        assert cycle.stick_fraction > sticks
        assert cycle.evaluations < 1000
        assert motion.expansions < 200
        assert motion.steps - motion.expansions <= 8


@pytest.mark.parametrize('speed', [2, 20, 38])
def test_tight_switching_is_exact_away_from_grazing(speed):
    assert abs(error(Switching(tight=True), speed)) < 1e-11


def test_the_restick_trap():
    # 40 rpm: the contact is stepped over and a cycle of twice the period comes out.
    trapped = Switching(tight=True).amplitude(BENCH, rpm(40), 1000.0)
    assert trapped.outcome is MethodOutcome.CYCLE
    assert trapped.amplitude * 1e3 == pytest.approx(1.05199, abs=1e-5)
    assert abs(error(Switching(tight=True, longest=0.1), 40)) < 1e-12


def test_switching_follows_a_lining_that_overtakes_the_belt():
    weak = Bearing(50.0, 40.0, 2.0e6, Stribeck(0.30, 0.10, 10.0), 0.1)
    amplitude = Switching(tight=True, longest=0.1).amplitude(weak, rpm(30), 100.0).amplitude
    expected = exact_cycle(weak, rpm(30), 100.0).amplitude
    assert math.isfinite(amplitude)
    # Ten cycles do not forget the start altogether: there is no stick to do so.
    assert amplitude == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize('case', [c for c in CASES if c.name != 'cubic law'], ids=lambda c: c.name)
def test_event_driven_integration_against_the_references(case):
    result = EventDriven(follow).amplitude(case.bearing, case.speed, case.load)
    assert result.amplitude == pytest.approx(case.reference, rel=1e-12)
    assert result.evaluations < 5000


def test_turning_points_are_of_sixth_order():
    # x = sin t + 0.1 sin 2t: cos t = (sqrt(1 + 0.32) - 1)/0.8 at its turning points.
    t_turn = math.acos((math.sqrt(1.32) - 1.0) / 0.8)
    expected = math.sin(t_turn) + 0.1 * math.sin(2.0 * t_turn)
    errors = []
    for step in (0.4, 0.2):
        misses = []
        for shift in np.linspace(0.0, step, 11):
            t = shift + step * np.arange(15)
            x, v = np.sin(t) + 0.1 * np.sin(2 * t), np.cos(t) + 0.2 * np.cos(2 * t)
            a = -np.sin(t) - 0.4 * np.sin(2 * t)
            samples = Samples(step, x, v, a, False, True, 0, None)
            misses.append(abs(turning_points(samples).max() - expected))
        errors.append(max(misses))
    assert math.log2(errors[0] / errors[1]) == pytest.approx(6.0, abs=0.5)


def test_no_turning_points_in_a_one_way_motion():
    one = np.ones(4)
    assert (
        turning_points(Samples(0.1, np.arange(4.0), one, 0 * one, False, True, 0, None)).size == 0
    )


def test_an_interrupted_motion_is_no_result():
    def cut(*_):
        x = np.array([0.0, 1.0])
        return Samples(0.1, x, x, x, False, False, 3, None)

    result = EventDriven(cut).amplitude(BENCH, 0.1, 1000.0)
    assert result.outcome is MethodOutcome.NOT_CONVERGED
    assert math.isnan(result.amplitude)


@pytest.mark.parametrize('case', CASES, ids=lambda c: c.name)
@pytest.mark.parametrize('points', [1, 4])
def test_exact_cycle_against_the_references(case, points):
    result = ExactCycle(points).amplitude(case.bearing, case.speed, case.load)
    assert result.amplitude == pytest.approx(case.reference, rel=1e-13)


@pytest.mark.parametrize('y', [-3.0, -0.31, -0.2, 0.0, 0.1, 0.2865, 0.5, 20.0])
def test_the_resolvent_solves_the_set_valued_law(y):
    law = _Law(BENCH, rpm(20), 1000.0)
    (v,), (slope,) = law.resolvent(np.array([y]))
    force = y - law.penalty * v
    if v == 0.0:
        assert abs(force) <= law.static
        assert slope == 0.0
    else:
        expected = law.force * float(BENCH.friction.coefficient(rpm(20) * v))
        assert force == pytest.approx(expected, rel=1e-12)
        step = 1e-6
        both = law.resolvent(np.array([y + step, y - step]))[0]
        assert slope == pytest.approx((both[0] - both[1]) / (2.0 * step), rel=1e-5)


def test_jacobian_of_the_balance_against_differences():
    law = _Law(BENCH, rpm(20), 1000.0)
    problem = _Problem(_Series(3), law, BENCH.damping_ratio)
    q = np.array([1.5, 1.03, 0.0, 0.05, -0.03, 0.01, 0.02])
    _, jacobian = problem.residual(q, 0.99)
    z, step = np.append(q, 0.99), 1e-7
    for i in range(z.size):
        up, down = z.copy(), z.copy()
        up[i] += step
        down[i] -= step
        rise = problem.residual(up[:-1], up[-1])[0] - problem.residual(down[:-1], down[-1])[0]
        # Samples that change between stick and slip within the step blur the difference.
        assert jacobian[:, i] == pytest.approx(rise / (2.0 * step), abs=2e-4)


def test_one_harmonic_held_hard_to_the_law_is_averaging():
    # With the penalty large the resolvent is the law itself; the balance is then KBM's.
    speed, load = rpm(20), 1000.0
    law = _Law(BENCH, speed, load)
    law.penalty = 1e7
    series = _Series(1)
    phase = 2.0 * np.pi * np.arange(series.wave.shape[0]) / series.wave.shape[0]
    alpha = 1.3
    y = law.penalty * (1.0 - alpha * np.cos(phase))
    force = y - law.penalty * law.resolvent(y)[0]
    mean = 2.0 * np.mean(force * np.cos(phase))
    expected = 2.0 * law.force * float(harmonic(BENCH.friction, speed, alpha * speed))
    assert mean == pytest.approx(expected, abs=2e-2 * law.static)


@pytest.mark.parametrize('speed', [10, 20, 30])
def test_many_harmonics_approach_the_exact_cycle(speed):
    # The error changes its sign on the way: no single step down is certain.
    few = max(abs(error(HarmonicBalance(h), speed)) for h in (3, 7, 15))
    many = max(abs(error(HarmonicBalance(h), speed)) for h in (63, 127))
    assert many < 0.2 * few
    assert many < 2e-3


def test_half_range_of_a_series_is_refined_between_samples():
    # a_1 cos + b_3 sin 3t; a dense grid as the judge.
    q = np.array([4.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.2])
    t = np.linspace(0.0, 2.0 * np.pi, 2_000_001)
    assert half_range(q) == pytest.approx(0.5 * np.ptp(np.cos(t) + 0.2 * np.sin(3 * t)), rel=1e-11)


def test_rungs_double():
    assert _rungs(1) == [1]
    assert _rungs(3) == [1, 3]
    assert _rungs(63) == [1, 3, 7, 15, 31, 63]
