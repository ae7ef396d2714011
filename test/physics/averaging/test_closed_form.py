# SPDX-License-Identifier: Apache-2.0
"""The closed forms against mpmath's Bessel functions and its integration, at 40 digits."""

from __future__ import annotations

import mpmath as mp
import numpy as np
import pytest

from stickslip_monitor.physics.averaging import closed_form

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
