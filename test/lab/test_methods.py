# SPDX-License-Identifier: Apache-2.0
"""Every method against the references, its closed forms and its order of convergence."""

from __future__ import annotations

import math

import pytest
from shared import bearing_of

from stickslip_lab.accuracy.comparison import CASES, METHODS
from stickslip_lab.accuracy.comparison import REFERENCE as BENCH
from stickslip_lab.accuracy.methods import (
    CYCLE,
    NO_CYCLE,
    REFUSED,
    averaging,
    event_driven,
    exact,
    harmonic_balance,
    smoothed,
    switching,
)
from stickslip_monitor.physics.bearing import Bearing
from stickslip_monitor.physics.cycles import CycleKind, exact_cycle
from stickslip_monitor.physics.friction import Coulomb, Stribeck

pytestmark = pytest.mark.filterwarnings('error')
LIGHT = [method for method in METHODS if not method.slow]


def surface_speed(value: float) -> float:
    return float(BENCH.speed.to_surface(value, 'rpm'))


def relative_error(method, speed: float, *settings) -> float:
    """Relative error of a method at the bench."""
    amplitude = method(*settings, BENCH, surface_speed(speed), 1000.0).amplitude
    return amplitude / exact_cycle(BENCH, surface_speed(speed), 1000.0).amplitude - 1.0


def order_of_convergence(errors: list[float], ratio: float) -> float:
    """Slope of an error under refinement by a ratio, from the last two."""
    return math.log(abs(errors[-2] / errors[-1])) / math.log(ratio)


@pytest.mark.slow
@pytest.mark.parametrize('method', LIGHT, ids=lambda m: m.name)
def test_no_method_invents_a_cycle(method):
    """Twice the fold speed: steady sliding only; and friction that only rises."""
    result = method.solve(BENCH, 0.43, 1000.0)
    assert math.isnan(result.amplitude)
    assert result.outcome != CYCLE
    rising = bearing_of(Stribeck(0.1, 0.3, 10.0))
    if method.family in ('KBM', 'harmonic balance', 'exact cycle'):
        assert method.solve(rising, 0.1, 1000.0).outcome == NO_CYCLE


def test_harmonic_balance_refuses_a_jump_at_breakaway():
    bearing = bearing_of(Coulomb(0.3, 0.1))
    refused = {
        method.family
        for method in METHODS
        if not method.applies(bearing) and method.solve(bearing, 0.1, 1e3).outcome == REFUSED
    }
    assert refused == {'harmonic balance'}


@pytest.mark.parametrize('case', CASES, ids=lambda c: c.name)
def test_the_exact_methods_against_the_references(case):
    for points in (1, 4):
        result = exact(points, case.bearing, case.speed, case.load)
        assert result.amplitude == pytest.approx(case.reference, rel=1e-13)
    result = event_driven(case.bearing, case.speed, case.load)
    assert result.amplitude == pytest.approx(case.reference, rel=1e-12)


def test_averaging_is_of_second_order_without_a_second_order_term():
    # Friction that depends on velocity only is reversible under eta -> -eta, t -> -t: the even
    # orders of dA/dt vanish, and the harmonics of order eta do not change the peak-to-peak.
    errors = []
    for eta in (1e-2, 1e-3, 1e-4):
        bearing = Bearing(1.0, 0.2 * eta, 1.0, Stribeck(0.3, 0.1, 1.0), 0.1)
        cycle = exact_cycle(bearing, 1.5, eta / 0.2)
        assert cycle.kind is CycleKind.OVERTAKING
        errors.append(averaging(1, bearing, 1.5, eta / 0.2).amplitude / cycle.amplitude - 1.0)
    assert order_of_convergence(errors, 10.0) == pytest.approx(2.0, abs=2e-3)


# PHYSICS.md: -1.4 %, -0.2 %, -0.03 % at 20 rpm, double at 10 rpm.
@pytest.mark.parametrize(('width', 'bias'), [(1e-3, -1.4e-2), (1e-4, -2e-3), (1e-5, -3e-4)])
def test_the_bias_of_smoothing(width, bias):
    at_20, at_10 = (relative_error(smoothed, speed, width, True) for speed in (20, 10))
    assert at_20 == pytest.approx(bias, rel=0.15)
    assert at_10 / at_20 == pytest.approx(2.1, abs=0.15)


@pytest.mark.parametrize('speed', [2, 20, 38])
def test_tight_switching_is_exact_away_from_grazing(speed):
    assert abs(relative_error(switching, speed, True, math.inf)) < 1e-11


def test_the_restick_trap():
    """At 40 rpm the contact is stepped over and a cycle of twice the period comes out."""
    trapped = switching(True, math.inf, BENCH, surface_speed(40), 1000.0)
    assert trapped.amplitude * 1e3 == pytest.approx(1.05199, abs=1e-5)
    assert abs(relative_error(switching, 40, True, 0.1)) < 1e-12


def test_switching_follows_a_lining_that_overtakes_the_belt():
    weak = Bearing(50.0, 40.0, 2.0e6, Stribeck(0.30, 0.10, 10.0), 0.1)
    amplitude = switching(True, 0.1, weak, surface_speed(30), 100.0).amplitude
    # Ten cycles do not forget the start altogether: there is no stick to do so.
    assert amplitude == pytest.approx(exact_cycle(weak, surface_speed(30), 100.0).amplitude, rel=1e-3)


@pytest.mark.parametrize('speed', [10, 30])
def test_many_harmonics_approach_the_exact_cycle(speed):
    # The error changes its sign on the way: no single step down is certain.
    low_order_error = max(abs(relative_error(harmonic_balance, speed, h)) for h in (3, 7, 15))
    assert abs(relative_error(harmonic_balance, speed, 63)) < min(0.2 * low_order_error, 2e-3)
