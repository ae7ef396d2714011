# SPDX-License-Identifier: Apache-2.0
"""Power series of a motion and of friction, and laws as polynomials in pieces."""

from __future__ import annotations

import math

import mpmath as mp
import numpy as np
import pytest
from own_law import OwnLaw

from stickslip_monitor.physics import friction_pieces
from stickslip_monitor.physics.friction import Coulomb, Stretched, Stribeck, Tabulated
from stickslip_monitor.physics.friction_pieces import Pieces, friction_drop, friction_slope
from stickslip_monitor.physics.scalar_law import (
    begin_series,
    extend_series,
    fit_pieces,
    law_bounds,
    scalar_law,
)
from stickslip_monitor.physics.series import (
    ORDER,
    PLACE,
    RELATIVE_SPEED,
    find_level,
    new_work,
    place_and_speed,
)
from stickslip_monitor.physics.slip_series import Medium, expand

COURSE = [0.9, -0.4, 0.3, -0.05, 0.02, 0.01]  # of a relative speed in powers of the time, unit 0.2 m/s
UNIT, ORIGIN = 0.2, 0.05


def series_coefficients(law, count=10):
    """Return the coefficients of ``mu`` along the course, by the functions of the orbits."""
    numbers, work = scalar_law(law).plain, new_work()
    work[RELATIVE_SPEED : RELATIVE_SPEED + len(COURSE)] = COURSE
    low, high, drop = begin_series(numbers, ORIGIN, COURSE[0], UNIT, work)
    assert low < ORIGIN + UNIT * COURSE[0] < high
    return [drop, *(extend_series(numbers, k, work) for k in range(1, count))]


def expected_coefficients(mu, count=10):
    """Return them by differentiation in 40 digits."""
    with mp.workdps(40):
        taylor = mp.taylor(
            lambda t: mu(mp.mpf(ORIGIN) + UNIT * sum(c * t**k for k, c in enumerate(COURSE))), 0, count - 1
        )
        return [float(mu(mp.mpf(ORIGIN)) - taylor[0]), *map(float, taylor[1:])]


@pytest.mark.parametrize('exponent', [1.0, 1.5, 2.0, 3.0])
def test_the_series_of_a_law_is_that_of_its_derivatives(exponent):
    law = Stribeck(0.3, 0.1, 10.0, 0.02) if exponent == 1.0 else Stretched(0.3, 0.1, 10.0, 0.02, exponent)
    actual = series_coefficients(law)
    right = expected_coefficients(lambda v: 0.1 + 0.2 * mp.exp(-((10 * v) ** exponent)) + 0.02 * v)
    pieces = exponent in (1.5, 3.0)  # whose higher derivatives know fewer digits
    np.testing.assert_allclose(actual[:3], right[:3], rtol=1e-8)
    np.testing.assert_allclose(actual[:6], right[:6], atol=2e-6 if pieces else 1e-14)


def test_the_series_of_a_table_is_that_of_its_cubic():
    law = Tabulated([0.0, 0.1, 0.4, 0.8], [0.3, 0.2, 0.13, 0.1])
    cube, square, line, constant = law.cubics[:, 1]
    right = expected_coefficients(
        lambda v: ((cube * (v - 0.1) + square) * (v - 0.1) + line) * (v - 0.1) + constant
    )
    actual = series_coefficients(law)
    assert actual[0] == pytest.approx(float(law.coefficient(ORIGIN) - law.coefficient(ORIGIN + 0.9 * UNIT)))
    np.testing.assert_allclose(actual[1:], right[1:], atol=1e-14)


@pytest.mark.parametrize('degree', [3, 7, 11])
def test_the_series_of_a_piece_is_that_of_its_polynomial(degree):
    powers = np.random.default_rng(degree).normal(size=degree + 1).tolist()
    law, work = Pieces([0.0], [0.15], [0.3], degree, 0.5, powers), new_work()
    work[RELATIVE_SPEED : RELATIVE_SPEED + len(COURSE)] = COURSE
    right = expected_coefficients(
        lambda v: mp.fsum(a * ((v - mp.mpf(0.15)) / mp.mpf(0.3)) ** k for k, a in enumerate(powers)), ORDER
    )
    *_, drop = friction_pieces.begin_series(law, ORIGIN, COURSE[0], UNIT, work)
    actual = [drop, *(friction_pieces.extend_series(law, k, work) for k in range(1, ORDER))]
    np.testing.assert_allclose(actual, right, atol=1e-14)


@pytest.mark.parametrize('law', [OwnLaw(0.3, 0.1, 10.0), Stretched(0.3, 0.1, 10.0, 0.0, 1.2)])
def test_a_law_in_pieces_is_the_law_to_rounding(law):
    pieces, speed = fit_pieces(law), np.geomspace(1e-9, 1e5, 700)
    top = float(law.coefficient(1e-300))
    values = [top - friction_drop(pieces, 0.0, v) for v in speed.tolist()]
    np.testing.assert_allclose(values, law.coefficient(speed), atol=1e-14)
    speed = speed[speed > 1e-4]
    slope = [friction_slope(pieces, v) for v in speed.tolist()]
    np.testing.assert_allclose(slope, law.slope(speed), atol=2e-9)


def test_rounding_does_not_divide_a_piece_of_a_smooth_law():
    """Fitted by an inverse of the powers alone there are up to 743 of a rational law below 1 m/s."""
    assert np.count_nonzero(fit_pieces(OwnLaw(0.3, 0.1, 10.0)).begin < 1.0) < 30


def test_a_kink_that_no_breakpoint_names_is_found():
    class Bent(OwnLaw):
        def coefficient(self, speed):
            return 0.3 - 0.5 * np.minimum(np.abs(np.asarray(speed, float)), 0.0771)

    pieces = fit_pieces(Bent(0.3, 0.1, 10.0))
    for speed in (0.0770999, 0.0771, 0.0771001, 1.0):
        assert friction_drop(pieces, 0.0, speed) == pytest.approx(0.5 * min(speed, 0.0771), abs=1e-14)


def test_a_step_without_friction_is_a_swing():
    numbers, work = scalar_law(Coulomb(0.0, 0.0)).plain, new_work()
    order, share, unit, _ = expand(
        numbers, Medium(1.0, 0.0, 0.0, 0.0, 1.0, 0.0), 1.0, 0.0, 0.8, 1.0, 1e-13, work
    )
    t = share * unit
    assert 0.5 < t <= 1.0
    assert order == ORDER
    np.testing.assert_allclose(place_and_speed(work, order, share), [math.cos(t), math.sin(t)], atol=2e-13)
    half = find_level(work, PLACE, order, share, math.cos(t), math.cos(0.4))
    assert half * unit == pytest.approx(0.4, abs=1e-12)


def test_a_step_ends_just_past_a_point_of_a_table():
    law = Tabulated([0.0, 0.5, 1.0], [0.3, 0.2, 0.15])
    numbers, work = scalar_law(law).plain, new_work()
    medium = Medium(1.0, 3.0, 0.04, 0.0, 0.0, 1.0)
    order, share, *_ = expand(numbers, medium, 0.5, 0.4, 0.5, 1.0, 1e-13, work)
    assert place_and_speed(work, order, share)[1] == pytest.approx(0.5 + 1e-8, abs=8e-9)
    assert law_bounds(law).kinks == (0.5, 1.0)
