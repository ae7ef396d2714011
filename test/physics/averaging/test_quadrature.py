# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

from typing import Any

import mpmath as mp
import numpy as np
import pytest

from stickslip_monitor.physics.averaging.quadrature import (
    crossing_angle,
    friction_harmonic,
    friction_harmonic_and_slope,
    unit_gauss,
)
from stickslip_monitor.physics.friction import Coulomb, FrictionLaw, Stribeck, Tabulated
from stickslip_monitor.physics.oscillator import Bearing

STRIBECK = Stribeck(0.30, 0.10, 10.0)
LAWS = {
    'stribeck': STRIBECK,
    'viscous': Stribeck(0.30, 0.10, 10.0, 0.05),
    'rising': Stribeck(0.10, 0.30, 10.0),
    'coulomb': Coulomb(0.3, 0.3),
    'table': Tabulated([0.0, 0.05, 0.12, 0.3, 0.8], [0.31, 0.22, 0.24, 0.10, 0.13]),
}


def friction_harmonic_slope(law: FrictionLaw, v: np.ndarray, a: np.ndarray) -> np.ndarray:
    return friction_harmonic_and_slope(law, v, a)[1]


@pytest.mark.parametrize('order', [1, 2, 5, 16])
def test_gauss_rule_is_exact_to_its_degree(order: int) -> None:
    """``integral_0^1 x^p = 1/(p+1)`` for p <= 2 order - 1, and not for the next power."""
    for power in range(2 * order):
        total = sum(w * x**power for x, w in unit_gauss(order))
        assert total == pytest.approx(1.0 / (power + 1), rel=1e-14)
    if order < 5:
        total = sum(w * x ** (2 * order) for x, w in unit_gauss(order))
        assert abs(total * (2 * order + 1) - 1.0) > 1e-6


@pytest.mark.parametrize('excess', [1e-15, 1e-12, 1e-6, 0.1, 5.0])
@pytest.mark.parametrize('level', [0.0, 0.3])
def test_crossing_angle_keeps_full_precision_at_grazing(excess: float, level: float) -> None:
    """``arccos((V - level)/a)`` at 40 digits; plain arccos would have 1e-8 at grazing."""
    v = 1.0
    a = v - level + excess
    exact = mp.acos((mp.mpf(v) - mp.mpf(level)) / mp.mpf(a))
    got = float(crossing_angle(np.array(v), np.array(a), level))
    rounding = 1e-16 / excess if level else 0.0  # of the sum of three numbers
    assert got == pytest.approx(float(exact), rel=1e-14 + rounding)


def test_crossing_angle_is_clipped_where_the_level_is_not_reached() -> None:
    v, a = np.full(2, 1.0), np.full(2, 0.25)
    np.testing.assert_array_equal(crossing_angle(v, a, 0.5), [0.0, 0.0])
    np.testing.assert_array_equal(crossing_angle(v, a, 2.0), [np.pi, np.pi])


@pytest.mark.parametrize('law', LAWS.values(), ids=LAWS)
@pytest.mark.parametrize('ratio', [0.1, 0.6, 0.97, 1.05, 1.5, 4.0])
def test_slope_is_the_derivative_of_the_average(law: FrictionLaw, ratio: float) -> None:
    """Fourth-order central difference of ``S`` in the amplitude."""
    v = np.array([0.07, 0.2, 0.6])
    a = ratio * v
    h = 1e-4 * v
    step = [friction_harmonic(law, v, a + k * h) for k in (-2, -1, 1, 2)]
    expected = (step[0] - 8.0 * step[1] + 8.0 * step[2] - step[3]) / (12.0 * h)
    got = friction_harmonic_slope(law, v, a)
    np.testing.assert_allclose(got, expected, rtol=2e-6, atol=2e-6)


@pytest.mark.parametrize('ratio', [0.3, 1.0, 1.0001, 1.02, 2.0])
def test_stribeck_slope_to_twelve_digits(ratio: float, oracle: Any) -> None:
    """Below the limit ``Delta beta e^-v (I0 - I1/alpha)``; beyond it mpmath's derivative of S."""
    v = 0.2
    a = v * ratio
    g = oracle.groups(Bearing(1.0, 1.0, 1.0, STRIBECK, 0.1), v, 1.0)
    alpha = g.decay * mp.mpf(a)
    delta = mp.mpf(0.3) - mp.mpf(0.1)
    if a <= v:
        exact = mp.exp(-g.v) * (mp.besseli(0, alpha) - mp.besseli(1, alpha) / alpha)
    else:
        h = (alpha - g.v) / 10**8
        rise = oracle.harmonic(g.v, alpha + h, g.r) - oracle.harmonic(g.v, alpha - h, g.r)
        exact = rise / (2 * h)
    got = float(friction_harmonic_slope(STRIBECK, np.array(v), np.array(a)))
    assert got == pytest.approx(float(delta * g.decay * exact), rel=1e-11)


def test_average_falls_with_infinite_slope_at_the_limit() -> None:
    """PHYSICS.md: a square-root term ``-(2 mu_s/pi) sqrt(1 - V^2/a^2)`` for a = V+."""
    v = 0.2
    for excess in (1e-6, 1e-8, 1e-10):
        a = v * (1.0 + excess)
        limit = friction_harmonic(STRIBECK, np.array(v), np.array(v))
        drop = float(friction_harmonic(STRIBECK, np.array(v), np.array(a)) - limit)
        root = np.sqrt((a - v) * (a + v)) / a
        assert drop == pytest.approx(-(2.0 * 0.3 / np.pi) * root, rel=3.0 * np.sqrt(excess))
        slope = float(friction_harmonic_slope(STRIBECK, np.array(v), np.array(a)))
        assert slope == pytest.approx(drop / (2.0 * v * excess), rel=3.0 * np.sqrt(excess))


def test_slope_survives_the_ends_of_the_float_range() -> None:
    """Scale invariance: the Coulomb average depends on ``a/V`` only, so its slope goes as 1/V."""
    law = Coulomb(0.3, 0.3)
    one = float(friction_harmonic_slope(law, np.array(1.0), np.array(1.25)))
    for scale in (1e-200, 1e-100, 1e100, 1e200):
        got = float(friction_harmonic_slope(law, np.array(scale), np.array(1.25 * scale)))
        assert got * scale == pytest.approx(one, rel=1e-12)


def test_one_element_never_depends_on_its_neighbours() -> None:
    rng = np.random.default_rng(7)
    v, a = rng.uniform(0.01, 1.0, 200), rng.uniform(0.01, 2.0, 200)
    for law in LAWS.values():
        for function in (friction_harmonic, friction_harmonic_slope):
            batch = function(law, v, a)
            for i in (0, 3, 99, 199):
                assert function(law, v[i : i + 1], a[i : i + 1])[0] == batch[i]
                assert function(law, v[i:], a[i:])[0] == batch[i]
