# SPDX-License-Identifier: Apache-2.0
"""Averaging and perturbation: closed forms, limits and orders of convergence."""

from __future__ import annotations

import math

import mpmath as mp
import numpy as np
import pytest

from stickslip_monitor.errors import PhysicsError
from stickslip_monitor.lab.accuracy.cases import REFERENCE_BEARING as BENCH
from stickslip_monitor.lab.accuracy.method import MethodOutcome
from stickslip_monitor.lab.accuracy.own_methods import Averaging
from stickslip_monitor.lab.accuracy.perturbation import (
    Cubic,
    PolynomialAveraging,
    SlipPerturbation,
    ThomsenFidlin,
    averages,
    cosine_integrals,
    taylor_coefficients,
)
from stickslip_monitor.physics.averaging.boundaries import fold_speed, harmonic
from stickslip_monitor.physics.cycle.cycles import CycleKind, exact_cycle
from stickslip_monitor.physics.friction import Stribeck
from stickslip_monitor.physics.oscillator import Bearing

pytestmark = pytest.mark.filterwarnings('error')


def rpm(value: float) -> float:
    return float(BENCH.speed.to_surface(value, 'rpm'))


def order(errors: list[float], ratio: float) -> float:
    """Slope of an error under refinement by a ratio, from the last two."""
    return math.log(abs(errors[-2] / errors[-1])) / math.log(ratio)


@pytest.mark.parametrize(
    ('speed', 'amplitude'), [(10, 0.26352), (20, 0.52688), (30, 0.78708), (38, 0.99499)]
)
@pytest.mark.parametrize('points', [1, 3])
def test_averaging_of_physics_md(speed, amplitude, points):
    result = Averaging(points).amplitude(BENCH, rpm(speed), 1000.0)
    assert result.amplitude * 1e3 == pytest.approx(amplitude, abs=6e-6)
    assert result.outcome is MethodOutcome.CYCLE


def test_averaging_is_of_second_order_without_a_second_order_term():
    # Friction that depends on velocity only is reversible under eta -> -eta, t -> -t: the even
    # orders of dA/dt vanish, and the harmonics of order eta do not change the peak-to-peak.
    errors = []
    for eta in (1e-2, 1e-3, 1e-4):
        bearing = Bearing(1.0, 0.2 * eta, 1.0, Stribeck(0.3, 0.1, 1.0), 0.1)
        exact = exact_cycle(bearing, 1.5, eta / 0.2)
        assert exact.kind is CycleKind.OVERTAKING
        errors.append(
            Averaging().amplitude(bearing, 1.5, eta / 0.2).amplitude / exact.amplitude - 1.0
        )
    assert order(errors, 10.0) == pytest.approx(2.0, abs=2e-3)


def test_cosine_integrals_against_quadrature():
    for angle in (0.3, 1.5, math.pi):
        expected = [float(mp.quad(lambda t, j=j: mp.cos(t) ** j, [0, angle])) for j in range(9)]
        assert cosine_integrals(angle, 8) == pytest.approx(expected, rel=1e-13, abs=1e-15)


@pytest.mark.parametrize('alpha', [1.001, 1.2, 3.0])
def test_polynomial_averages_against_quadrature_and_difference(alpha):
    coefficients = np.array([0.3, -0.2, 0.07, -0.01])

    def average(a: float) -> float:
        def integrand(t: mp.mpf) -> mp.mpf:
            v = 1 - a * mp.cos(t)
            mu = mp.fsum(float(c) * abs(v) ** k for k, c in enumerate(coefficients))
            return mp.sign(v) * mu * mp.cos(t)

        return float(mp.quad(integrand, [0, mp.acos(1 / mp.mpf(a)), mp.pi]) / mp.pi)

    value, slope = averages(coefficients, alpha)
    step = 1e-5 * (alpha - 1.0)
    assert value == pytest.approx(average(alpha), rel=1e-12)
    difference = averages(coefficients, alpha + step)[0] - averages(coefficients, alpha - step)[0]
    assert slope == pytest.approx(difference / (2.0 * step), rel=1e-7)


def test_polynomial_route_converges_to_the_closed_form():
    exact = Averaging().amplitude(BENCH, rpm(20), 1000.0).amplitude
    errors = [
        abs(PolynomialAveraging(n).amplitude(BENCH, rpm(20), 1000.0).amplitude / exact - 1.0)
        for n in (3, 5, 9, 15, 25)
    ]
    assert all(np.diff(np.log(np.maximum(errors, 1e-15))) < -2.0)
    assert errors[0] > 1e-2
    assert errors[-1] < 1e-13


def test_polynomial_route_takes_a_viscous_rise():
    bearing = Bearing(50.0, 400.0, 2.0e6, Stribeck(0.3, 0.1, 10.0, 0.05), 0.1)
    expected = Averaging().amplitude(bearing, rpm(20), 1000.0).amplitude
    found = PolynomialAveraging(25).amplitude(bearing, rpm(20), 1000.0).amplitude
    assert found == pytest.approx(expected, rel=1e-12)


def test_a_low_order_loses_the_cycle_that_is_there():
    # exp(-beta v) to third order runs off to -infinity at the relative speeds of 38 rpm.
    result = PolynomialAveraging(3).amplitude(BENCH, rpm(38), 1000.0)
    assert result.outcome is not MethodOutcome.CYCLE
    assert math.isnan(result.amplitude)


def test_taylor_coefficients_of_the_law():
    law = Stribeck(0.3, 0.1, 10.0, 0.05)
    v = np.array([0.0, 0.3, 0.9])
    polynomial = np.polyval(taylor_coefficients(law, 0.1, 20)[::-1], v)
    assert polynomial == pytest.approx(law.coefficient(0.1 * v), rel=1e-14)


# Friction that falls by little, as the perturbation wants it: the static force keeps the stick.
@pytest.mark.parametrize('speed', [0.12, 0.2])
@pytest.mark.parametrize('method', [ThomsenFidlin(), SlipPerturbation()], ids=lambda m: m.name)
def test_perturbation_of_the_slip_phase_is_of_second_order(speed, method):
    errors = []
    for fall in (0.02, 0.01, 0.005):
        bearing = Bearing(50.0, 2000.0 * fall, 2.0e6, Cubic(0.3, 0.3 - fall, 0.3), 0.1)
        exact = exact_cycle(bearing, speed, 1000.0)
        assert exact.kind is CycleKind.STICK_SLIP
        errors.append(method.amplitude(bearing, speed, 1000.0).amplitude / exact.amplitude - 1.0)
    assert order(errors, 2.0) == pytest.approx(2.0, abs=0.02)
    assert abs(errors[-1]) < 1e-6


@pytest.mark.parametrize(('speed', 'bound'), [(10, 5e-3), (20, 4e-4), (30, 2e-3), (38, 3e-3)])
def test_slip_perturbation_at_the_bench(speed, bound):
    exact = exact_cycle(BENCH, rpm(speed), 1000.0).amplitude
    error = SlipPerturbation().amplitude(BENCH, rpm(speed), 1000.0).amplitude / exact - 1.0
    assert abs(error) < bound


def test_slip_perturbation_ends_at_the_fold_of_averaging():
    fold = fold_speed(BENCH, 1000.0)
    below, above = fold * (1.0 - 1e-9), fold * (1.0 + 1e-9)
    method = SlipPerturbation()
    assert method.amplitude(BENCH, below, 1000.0).outcome is MethodOutcome.CYCLE
    assert method.amplitude(BENCH, above, 1000.0).outcome is MethodOutcome.NO_CYCLE
    assert method.amplitude(BENCH, below, 1000.0).amplitude == pytest.approx(below / 200.0)


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
    assert CUBIC.slope(-v) == pytest.approx(CUBIC.slope(v))


@pytest.mark.parametrize('share', [0.9, 0.95, 0.99])
def test_pure_slip_of_the_cubic_law_is_that_of_averaging(share):
    mine = ThomsenFidlin().amplitude(CUBIC_BEARING, share * LAST, 1000.0).amplitude
    averaged = Averaging().amplitude(CUBIC_BEARING, share * LAST, 1000.0).amplitude
    assert mine == pytest.approx(averaged, rel=1e-12)


def test_the_branches_of_the_cubic_law_meet():
    join = math.sqrt(0.8) * LAST
    low, high = (
        ThomsenFidlin().amplitude(CUBIC_BEARING, join * f, 1000.0).amplitude
        for f in (1.0 - 1e-9, 1.0 + 1e-9)
    )
    assert low == pytest.approx(join / 200.0, rel=1e-8)
    assert high == pytest.approx(join / 200.0, rel=1e-8)
    result = ThomsenFidlin().amplitude(CUBIC_BEARING, LAST * (1.0 + 1e-12), 1000.0)
    assert result.outcome is MethodOutcome.NO_CYCLE


def test_the_general_formula_is_theirs_for_their_law():
    for speed in (0.05, 0.12, 0.2):
        theirs = ThomsenFidlin().amplitude(CUBIC_BEARING, speed, 1000.0).amplitude
        general = SlipPerturbation().amplitude(CUBIC_BEARING, speed, 1000.0).amplitude
        assert general == pytest.approx(theirs, rel=1e-13)
    k1, k3 = CUBIC.linear, CUBIC.cubic
    expected = 0.5 * k1 * 0.12 - 1.875 * k3 * 0.12**3
    assert float(harmonic(CUBIC, 0.12, 0.12)) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(
    ('arguments', 'words'),
    [
        ((-0.1, 0.1, 0.3), 'static'),
        ((0.3, -0.1, 0.3), 'minimum'),
        ((0.3, 0.1, 0.0), 'minimum_speed'),
    ],
)
def test_a_cubic_law_keeps_its_rules(arguments, words):
    with pytest.raises(PhysicsError, match=words):
        Cubic(*arguments)


def test_thomsen_and_fidlin_refuse_what_is_not_theirs():
    assert 'cubic law' in ThomsenFidlin().refusal(BENCH, 0.1, 1000.0)
    rising = Bearing(50.0, 40.0, 2.0e6, Cubic(0.28, 0.30, 0.3), 0.1)
    assert 'below the static' in ThomsenFidlin().refusal(rising, 0.1, 1000.0)
