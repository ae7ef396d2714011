# SPDX-License-Identifier: Apache-2.0
"""Every method against the references, its closed forms and its order of convergence."""

from __future__ import annotations

import math

import mpmath as mp
import numpy as np
import pytest

from stickslip_monitor.errors import PhysicsError
from stickslip_monitor.lab.accuracy.cases import BASE, CASES, METHODS, TYPICAL, averaging, exact
from stickslip_monitor.lab.accuracy.cases import REFERENCE_BEARING as BENCH
from stickslip_monitor.lab.accuracy.harmonic_balance import (
    _Law,
    half_range,
    harmonic_balance,
)
from stickslip_monitor.lab.accuracy.method import MethodOutcome
from stickslip_monitor.lab.accuracy.perturbation import (
    Cubic,
    averages,
    polynomial_averaging,
    slip_perturbation,
    taylor_coefficients,
    thomsen_fidlin,
)
from stickslip_monitor.lab.accuracy.time_stepping import (
    event_driven,
    smoothed,
    switching,
)
from stickslip_monitor.physics.averaging.boundaries import fold_speed
from stickslip_monitor.physics.cycle.cycles import CycleKind, exact_cycle
from stickslip_monitor.physics.friction import Coulomb, Stribeck
from stickslip_monitor.physics.oscillator import Bearing

pytestmark = pytest.mark.filterwarnings('error')
LIGHT = [method for method in METHODS if not method.slow]


def rpm(value: float) -> float:
    return float(BENCH.speed.to_surface(value, 'rpm'))


def error(method, speed: float, *settings) -> float:
    """Relative error of a method at the bench."""
    amplitude = method(*settings, BENCH, rpm(speed), 1000.0).amplitude
    return amplitude / exact_cycle(BENCH, rpm(speed), 1000.0).amplitude - 1.0


def order(errors: list[float], ratio: float) -> float:
    """Slope of an error under refinement by a ratio, from the last two."""
    return math.log(abs(errors[-2] / errors[-1])) / math.log(ratio)


def test_names_are_unique_and_the_base_is_the_first():
    assert len({method.name for method in METHODS}) == len(METHODS)
    assert len({case.name for case in CASES}) == len(CASES)
    assert METHODS[0] is BASE
    assert TYPICAL in [case.name for case in CASES if case.quick]


@pytest.mark.slow
@pytest.mark.parametrize('method', LIGHT, ids=lambda m: m.name)
def test_where_there_is_no_cycle_no_method_invents_one(method):
    """Twice the fold speed: steady sliding only; and friction that only rises."""
    result = method.solve(BENCH, 0.43, 1000.0)
    assert math.isnan(result.amplitude)
    assert result.outcome is not MethodOutcome.CYCLE
    rising = Bearing(50.0, 400.0, 2.0e6, Stribeck(0.1, 0.3, 10.0), 0.1)
    if method.family in ('KBM', 'slip perturbation', 'harmonic balance', 'exact cycle'):
        assert method.solve(rising, 0.1, 1000.0).outcome is MethodOutcome.NO_CYCLE


@pytest.mark.parametrize(
    ('law', 'families'),
    [
        (BENCH.friction, {'Thomsen and Fidlin'}),
        (Cubic(0.30, 0.28, 0.30), {'KBM, polynomial', 'event-driven integrator'}),
        (
            Cubic(0.28, 0.30, 0.30),
            {'KBM, polynomial', 'event-driven integrator', 'Thomsen and Fidlin'},
        ),
        (Coulomb(0.3, 0.1), {'KBM, polynomial', 'Thomsen and Fidlin', 'harmonic balance'}),
    ],
)
def test_who_refuses_which_law(law, families):
    bearing = Bearing(50.0, 400.0, 2.0e6, law, 0.1)
    refused = {
        method.family
        for method in METHODS
        if not method.applies(bearing)
        and method.solve(bearing, 0.1, 1e3).outcome is MethodOutcome.REFUSED
    }
    assert refused == families


@pytest.mark.parametrize('case', CASES, ids=lambda c: c.name)
def test_the_exact_methods_against_the_references(case):
    for points in (1, 4):
        result = exact(points, case.bearing, case.speed, case.load)
        assert result.amplitude == pytest.approx(case.reference, rel=1e-13)
    if case.name != 'cubic law':
        result = event_driven(case.bearing, case.speed, case.load)
        assert result.amplitude == pytest.approx(case.reference, rel=1e-12)


# PHYSICS.md
@pytest.mark.parametrize(
    ('speed', 'amplitude'), [(10, 0.26352), (20, 0.52688), (30, 0.78708), (38, 0.99499)]
)
def test_averaging_gives_the_published_amplitudes(speed, amplitude):
    for points in (1, 3):
        result = averaging(points, BENCH, rpm(speed), 1000.0)
        assert result.amplitude * 1e3 == pytest.approx(amplitude, abs=6e-6)


def test_averaging_is_of_second_order_without_a_second_order_term():
    # Friction that depends on velocity only is reversible under eta -> -eta, t -> -t: the even
    # orders of dA/dt vanish, and the harmonics of order eta do not change the peak-to-peak.
    errors = []
    for eta in (1e-2, 1e-3, 1e-4):
        bearing = Bearing(1.0, 0.2 * eta, 1.0, Stribeck(0.3, 0.1, 1.0), 0.1)
        cycle = exact_cycle(bearing, 1.5, eta / 0.2)
        assert cycle.kind is CycleKind.OVERTAKING
        errors.append(averaging(1, bearing, 1.5, eta / 0.2).amplitude / cycle.amplitude - 1.0)
    assert order(errors, 10.0) == pytest.approx(2.0, abs=2e-3)


@pytest.mark.parametrize('alpha', [1.001, 3.0])
def test_polynomial_averages_against_quadrature_and_difference(alpha):
    coefficients = np.array([0.3, -0.2, 0.07, -0.01])

    def integrand(t: mp.mpf) -> mp.mpf:
        v = 1 - alpha * mp.cos(t)
        mu = mp.fsum(float(c) * abs(v) ** k for k, c in enumerate(coefficients))
        return mp.sign(v) * mu * mp.cos(t)

    value, slope = averages(coefficients, alpha)
    average = mp.quad(integrand, [0, mp.acos(1 / mp.mpf(alpha)), mp.pi]) / mp.pi
    assert value == pytest.approx(float(average), rel=1e-12)
    step = 1e-5 * (alpha - 1.0)
    difference = averages(coefficients, alpha + step)[0] - averages(coefficients, alpha - step)[0]
    assert slope == pytest.approx(difference / (2.0 * step), rel=1e-7)


@pytest.mark.parametrize('viscous', [0.0, 0.05])
def test_polynomial_route_converges_to_the_closed_form(viscous):
    law = Stribeck(0.3, 0.1, 10.0, viscous)
    point = Bearing(50.0, 400.0, 2.0e6, law, 0.1), rpm(20), 1000.0
    whole = averaging(1, *point).amplitude
    orders = (3, 5, 9, 15, 25)
    errors = [abs(polynomial_averaging(n, *point).amplitude / whole - 1.0) for n in orders]
    assert all(np.diff(np.log(np.maximum(errors, 1e-15))) < -2.0)
    assert errors[0] > 1e-2
    assert errors[-1] < 1e-13
    v = np.array([0.0, 0.3, 0.9])
    polynomial = np.polyval(taylor_coefficients(law, 0.1, 20)[::-1], v)
    assert polynomial == pytest.approx(law.coefficient(0.1 * v), rel=1e-14)
    # exp(-beta v) to third order runs off to -infinity at the relative speeds of 38 rpm.
    lost = polynomial_averaging(3, BENCH, rpm(38), 1000.0)
    assert lost.outcome is not MethodOutcome.CYCLE


# Friction that falls by little, as the perturbation wants it: the static force keeps the stick.
@pytest.mark.parametrize('speed', [0.12, 0.2])
@pytest.mark.parametrize('settings', [(thomsen_fidlin,), (slip_perturbation, 1)])
def test_perturbation_of_the_slip_phase_is_of_second_order(speed, settings):
    method, *more = settings
    errors = []
    for fall in (0.02, 0.01, 0.005):
        bearing = Bearing(50.0, 2000.0 * fall, 2.0e6, Cubic(0.3, 0.3 - fall, 0.3), 0.1)
        cycle = exact_cycle(bearing, speed, 1000.0)
        assert cycle.kind is CycleKind.STICK_SLIP
        errors.append(method(*more, bearing, speed, 1000.0).amplitude / cycle.amplitude - 1.0)
    assert order(errors, 2.0) == pytest.approx(2.0, abs=0.02)
    assert abs(errors[-1]) < 1e-6


def test_slip_perturbation_ends_at_the_fold_of_averaging():
    fold = fold_speed(BENCH, 1000.0)
    below = slip_perturbation(1, BENCH, fold * (1.0 - 1e-9), 1000.0)
    above = slip_perturbation(1, BENCH, fold * (1.0 + 1e-9), 1000.0)
    assert above.outcome is MethodOutcome.NO_CYCLE
    assert below.amplitude == pytest.approx(fold / 200.0)
    assert abs(error(slip_perturbation, 20, 1)) < 4e-4


CUBIC = Cubic(0.30, 0.28, 0.30)
CUBIC_BEARING = Bearing(50.0, 40.0, 2.0e6, CUBIC, 0.1)
LAST = 0.3 * math.sqrt(1.0 - 40.0 / (1000.0 * CUBIC.linear))


def test_the_cubic_law_is_what_it_says():
    v = np.linspace(0.0, 0.9, 181)
    mu = CUBIC.coefficient(v)
    assert mu[0] == CUBIC.static
    assert v[np.argmin(mu)] == pytest.approx(0.3)
    assert mu.min() == pytest.approx(CUBIC.minimum, rel=1e-14)
    assert CUBIC.coefficient(-v[1:]) == pytest.approx(-mu[1:])
    difference = (CUBIC.coefficient(v[1:] + 1e-6) - CUBIC.coefficient(v[1:] - 1e-6)) / 2e-6
    assert CUBIC.slope(v[1:]) == pytest.approx(difference, abs=1e-8)
    for numbers, name in (((-1, 1, 1), 'static'), ((1, -1, 1), 'minimum'), ((1, 1, 0), 'speed')):
        with pytest.raises(PhysicsError, match=name):
            Cubic(*numbers)


def test_thomsen_and_fidlin_have_two_branches_that_meet():
    """Pure slip is that of averaging, stick-slip that of the general formula."""
    for share in (0.9, 0.99):
        point = CUBIC_BEARING, share * LAST, 1000.0
        averaged = averaging(1, *point).amplitude
        assert thomsen_fidlin(*point).amplitude == pytest.approx(averaged, rel=1e-12)
    for speed in (0.05, 0.2):
        general = slip_perturbation(1, CUBIC_BEARING, speed, 1000.0).amplitude
        assert thomsen_fidlin(CUBIC_BEARING, speed, 1000.0).amplitude == pytest.approx(general)
    join = math.sqrt(0.8) * LAST
    for side in (1.0 - 1e-9, 1.0 + 1e-9):
        found = thomsen_fidlin(CUBIC_BEARING, join * side, 1000.0).amplitude
        assert found == pytest.approx(join / 200.0, rel=1e-8)
    beyond = thomsen_fidlin(CUBIC_BEARING, LAST * (1.0 + 1e-12), 1000.0)
    assert beyond.outcome is MethodOutcome.NO_CYCLE


# PHYSICS.md: -1.4 %, -0.2 %, -0.03 % at 20 rpm, double at 10 rpm.
@pytest.mark.parametrize(('width', 'bias'), [(1e-3, -1.4e-2), (1e-4, -2e-3), (1e-5, -3e-4)])
def test_the_bias_of_smoothing(width, bias):
    at_20, at_10 = (error(smoothed, speed, width, True) for speed in (20, 10))
    assert at_20 == pytest.approx(bias, rel=0.15)
    assert at_10 / at_20 == pytest.approx(2.1, abs=0.15)


@pytest.mark.parametrize('speed', [2, 20, 38])
def test_tight_switching_is_exact_away_from_grazing(speed):
    assert abs(error(switching, speed, True, math.inf)) < 1e-11


def test_the_restick_trap():
    """At 40 rpm the contact is stepped over and a cycle of twice the period comes out."""
    trapped = switching(True, math.inf, BENCH, rpm(40), 1000.0)
    assert trapped.amplitude * 1e3 == pytest.approx(1.05199, abs=1e-5)
    assert abs(error(switching, 40, True, 0.1)) < 1e-12


def test_switching_follows_a_lining_that_overtakes_the_belt():
    weak = Bearing(50.0, 40.0, 2.0e6, Stribeck(0.30, 0.10, 10.0), 0.1)
    amplitude = switching(True, 0.1, weak, rpm(30), 100.0).amplitude
    # Ten cycles do not forget the start altogether: there is no stick to do so.
    assert amplitude == pytest.approx(exact_cycle(weak, rpm(30), 100.0).amplitude, rel=1e-3)


def test_the_resolvent_solves_the_set_valued_law():
    law, step = _Law(BENCH, rpm(20), 1000.0), 1e-6
    y = np.array([-3.0, -0.31, -0.2, 0.0, 0.1, 0.2865, 0.5, 20.0])
    v, slope = law.resolvent(y)
    force, stuck = y - law.penalty * v, v == 0.0
    assert np.all(np.abs(force[stuck]) <= law.static)
    assert not slope[stuck].any()
    expected = law.force * BENCH.friction.coefficient(rpm(20) * v[~stuck])
    assert force[~stuck] == pytest.approx(expected, rel=1e-12)
    difference = (law.resolvent(y + step)[0] - law.resolvent(y - step)[0]) / (2.0 * step)
    assert slope[~stuck] == pytest.approx(difference[~stuck], rel=1e-5)


@pytest.mark.parametrize('speed', [10, 30])
def test_many_harmonics_approach_the_exact_cycle(speed):
    # The error changes its sign on the way: no single step down is certain.
    few = max(abs(error(harmonic_balance, speed, h)) for h in (3, 7, 15))
    many = max(abs(error(harmonic_balance, speed, h)) for h in (63, 127))
    assert many < 0.2 * few
    assert many < 2e-3


def test_half_range_of_a_series_is_refined_between_samples():
    # a_1 cos + b_3 sin 3t; a dense grid as the judge.
    q = np.array([4.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.2])
    t = np.linspace(0.0, 2.0 * np.pi, 2_000_001)
    assert half_range(q) == pytest.approx(0.5 * np.ptp(np.cos(t) + 0.2 * np.sin(3 * t)), rel=1e-11)
