# SPDX-License-Identifier: Apache-2.0
"""The closed forms against mpmath's Bessel functions and its integration, at 40 digits."""

from __future__ import annotations

from typing import Any

import mpmath as mp
import numpy as np
import pytest

from stickslip_monitor.physics.averaging import closed_form
from stickslip_monitor.physics.friction import Stribeck
from stickslip_monitor.physics.oscillator import Bearing

ARGUMENTS = [1e-9, 1e-3, 0.1, 0.4999, 0.5, 0.5001, 1.0, 2.1, 30.0, 699.0, 1e4, 1e6, 1e8]


def _growth(alpha: mp.mpf) -> mp.mpf:
    return mp.log(2 * mp.besseli(1, alpha) / alpha)


def _decline(v: mp.mpf) -> mp.mpf:
    return v - _growth(v)


@pytest.mark.parametrize('x', ARGUMENTS)
def test_growth_and_decline_keep_every_digit(x: float) -> None:
    """``ln(2 I1(x)/x)`` and ``x`` less it, both of which cancel at one end of the range."""
    with mp.workdps(60):
        growth, decline = float(_growth(mp.mpf(x))), float(_decline(mp.mpf(x)))
    assert float(closed_form.growth(np.array([x]))[0]) == pytest.approx(growth, rel=2e-15)
    assert float(closed_form.decline(np.array([x]))[0]) == pytest.approx(decline, rel=2e-15)


@pytest.mark.parametrize('alpha', [1e-7, 1e-4, 0.01, 0.3, 0.5, 1.7, 12.0, 300.0, 9e3, 3e5, 1e8])
def test_amplitude_for_growth_inverts_the_bessel_function(alpha: float) -> None:
    """The exact growth of a known amplitude must give that amplitude back."""
    with mp.workdps(60):
        exact = _growth(mp.mpf(alpha))
        d = float(exact)
        # What rounding the exact growth to a float moves the amplitude by.
        slope = mp.besseli(2, mp.mpf(alpha)) / mp.besseli(1, mp.mpf(alpha))
        expected = float(mp.mpf(alpha) + (mp.mpf(d) - exact) / slope)
    got = closed_form.amplitude_for_growth(np.array([d]))[0]
    assert got == pytest.approx(expected, rel=2e-15)


@pytest.mark.parametrize('v', [1e-7, 1e-4, 0.01, 0.3, 0.5, 1.7, 12.0, 300.0, 9e3, 3e5, 1e8])
def test_speed_for_decline_inverts_the_bessel_function(v: float) -> None:
    with mp.workdps(60):
        exact = _decline(mp.mpf(v))
        d = float(exact)
        slope = 1 - mp.besseli(2, mp.mpf(v)) / mp.besseli(1, mp.mpf(v))
        expected = float(mp.mpf(v) + (mp.mpf(d) - exact) / slope)
    got = closed_form.speed_for_decline(np.array([d]))[0]
    # Conditioning: at large v the decline is 1.5 ln v, so an ulp of it is ln v ulps of v.
    assert got == pytest.approx(expected, rel=4e-15 * max(1.0, np.log(v)))


@pytest.mark.parametrize('v', [1e-300, 1e-5, 0.02, 2.0, 80.0, 1e4])
@pytest.mark.parametrize('share', [0.0, 0.6, 0.9999])
@pytest.mark.parametrize('r', [0.0, 50.0])
def test_the_amplitude_of_the_cycle_is_bracketed(
    v: float, share: float, r: float, oracle: Any
) -> None:
    """The directly integrated balance changes its sign within 1e-12 of the amplitude.

    ``share`` is kappa over its value at the fold; the result never lies inside ``a < V``.
    """
    limit = 2 * mp.exp(-mp.mpf(v)) * mp.besseli(1, mp.mpf(v)) / mp.mpf(v)
    kappa = float(share * limit)
    alpha = closed_form.amplitude_of_cycle(np.array([v]), np.array([kappa]), r)[0]
    assert alpha >= v
    if v < 1e-9:
        assert alpha == pytest.approx(v, rel=1e-9)  # S/Delta -> v/2: theta is of that order
        return
    law = Stribeck(1.0 + r, r, 1.0)
    g = oracle.groups(Bearing(1.0, kappa, 1.0, law, 0.1), v, 1.0)
    low, high = (mp.mpf(alpha) * (1 + mp.mpf(sign) * mp.mpf('1e-12')) for sign in (-1, 1))
    assert oracle.balance(g, max(low, g.v)) > 0
    assert oracle.balance(g, high) < 0
