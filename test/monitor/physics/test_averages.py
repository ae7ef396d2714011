# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

from typing import Any

import mpmath as mp
import numpy as np
import pytest
from shared import LAWS

from stickslip_monitor.physics import averages_by_quadrature
from stickslip_monitor.physics.averages_by_quadrature import crossing_angle
from stickslip_monitor.physics.averaging import amplitude_rate, harmonic
from stickslip_monitor.physics.bearing import Bearing
from stickslip_monitor.physics.friction import FrictionLaw, Stribeck, Tabulated

STRIBECK = Stribeck(0.30, 0.10, 10.0)
CLOSED = {name: LAWS[name] for name in ('stribeck', 'viscous', 'rising', 'level', 'coulomb')} | {
    'frictionless sliding': Stribeck(0.2, 0.0, 3.0),
    'nearly flat': Stribeck(0.2 + 1e-9, 0.2, 10.0),
    'sharp': Stribeck(0.3, 0.1, 1e4),
    'blunt': Stribeck(0.3, 0.1, 1e-3),
}
NEAR = [0.0, 1e-16, 2e-16, 1e-15, 1e-14, 1e-12, 1e-9, 1e-6, 1e-3]
RATIOS = np.unique(
    np.concatenate(
        [
            [1e-12, 1e-6, 1e-3, 0.01, 0.1, 0.3, 0.5, 0.7, 0.9],
            1.0 - np.array(NEAR),
            1.0 + np.array(NEAR),
            [1.01, 1.05, 1.2, 1.5, 2.0, 3.0, 10.0, 1e3, 1e6],
        ]
    )
)


@pytest.mark.parametrize('law', CLOSED.values(), ids=CLOSED)
def test_closed_form_and_split_quadrature_agree(law: FrictionLaw) -> None:
    """Two independent methods to 1e-12 of the static coefficient, across the sliding limit."""
    v, ratio = np.meshgrid([1e-6, 1e-3, 0.05, 0.2, 1.0, 30.0, 1e3], RATIOS)
    v, a = v.ravel(), (v * ratio).ravel()
    quadrature = averages_by_quadrature.harmonic(law, v, a)
    assert np.isfinite(quadrature).all()
    scale = law.static + 0.5 * getattr(law, 'viscous', 0.0) * a
    assert np.max(np.abs(harmonic(law, v, a) - quadrature) / scale) < 1e-12


@pytest.mark.parametrize('beta_v', [1e-4, 0.5, 20.0, 1e4])
@pytest.mark.parametrize('ratio', [0.01, 1.0 - 1e-14, 1.0 + 1e-6, 1.6])
def test_harmonic_is_the_averaging_integral(beta_v: float, ratio: float, oracle: Any) -> None:
    """PHYSICS.md's integral by mpmath at 40 digits, for the closed form and the quadrature.

    Near the sliding limit and below it the relative error stays at rounding, too.
    """
    v, law = beta_v / 10.0, STRIBECK
    a = v * ratio
    g = oracle.groups(Bearing(1.0, 1.0, 1.0, law, 0.1), v, 1.0)
    delta = mp.mpf(law.static) - mp.mpf(law.kinetic)
    exact = delta * oracle.harmonic(g.v, g.decay * mp.mpf(a), g.r)
    closed = float(harmonic(law, v, a))
    assert abs(closed - exact) < 1e-14
    assert abs(float(averages_by_quadrature.harmonic(law, np.array(v), np.array(a))) - exact) < 1e-14
    if a <= v and abs(exact) > 1e-25:  # where 40 digits resolve it
        assert abs(closed - exact) <= 1e-12 * abs(exact)


def test_table_average_is_its_integral(harmonic_by_quad: Any) -> None:
    """SciPy's adaptive quadrature, split at every bend of the table and at the reversal."""
    law = Tabulated([0.0, 0.05, 0.12, 0.3, 0.8], [0.31, 0.22, 0.24, 0.10, 0.13])
    for v in (0.03, 0.2, 0.9):
        for ratio in (0.2, 0.99, 1.0001, 1.3, 6.0):
            expected = harmonic_by_quad(law, v, v * ratio)
            assert float(harmonic(law, v, v * ratio)) == pytest.approx(expected, abs=1e-12)


def test_amplitude_rate_broadcasts_and_starts_at_the_growth_rate(reference: Bearing) -> None:
    # For A -> 0 it is ``sigma A`` with PHYSICS.md's sigma (first Taylor term of I1).
    speed, load = np.array([[0.1], [0.2]]), np.array([500.0, 1000.0, 0.0])
    rate = amplitude_rate(reference, speed, load, 1e-9)
    assert rate.shape == (2, 3)
    sigma = (load * 0.2 * 10.0 * np.exp(-10.0 * speed) - 400.0) / 100.0
    np.testing.assert_allclose(rate, sigma * 1e-9, rtol=1e-9)
    np.testing.assert_array_equal(amplitude_rate(reference, speed, load, 0.0), np.zeros((2, 3)))


@pytest.mark.parametrize('excess', [1e-15, 1e-12, 1e-6, 0.1, 5.0])
@pytest.mark.parametrize('level', [0.0, 0.3])
def test_crossing_angle_keeps_full_precision_at_grazing(excess: float, level: float) -> None:
    """``arccos((V - level)/a)`` at 40 digits; plain arccos would have 1e-8 at grazing."""
    v = 1.0
    a = v - level + excess
    exact = mp.acos((mp.mpf(v) - mp.mpf(level)) / mp.mpf(a))
    angle = float(crossing_angle(np.array(v), np.array(a), level))
    rounding = 1e-16 / excess if level else 0.0  # of the sum of three numbers
    assert angle == pytest.approx(float(exact), rel=1e-14 + rounding)
