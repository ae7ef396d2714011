# SPDX-License-Identifier: Apache-2.0
"""The closed forms against mpmath's Bessel functions, at 60 digits."""

from __future__ import annotations

import mpmath as mp
import numpy as np
import pytest

from stickslip_monitor.physics import averages_closed_form


@pytest.mark.parametrize('x', [1e-9, 1e-4, 0.1, 0.4999, 0.5001, 2.1, 30.0, 699.0, 3e5, 1e8])
def test_growth_decline_and_their_inverses_keep_every_digit(x: float) -> None:
    """``ln(2 I1(x)/x)`` and ``x`` less it, both of which cancel at one end of the range."""
    with mp.workdps(60):
        exact = mp.mpf(x)
        growth = mp.log(2 * mp.besseli(1, exact) / exact)
        slope = mp.besseli(2, exact) / mp.besseli(1, exact)
        # What rounding the exact value to a float moves the argument by.
        back = [
            float(exact + (mp.mpf(float(value)) - value) / rate)
            for value, rate in ((growth, slope), (exact - growth, 1 - slope))
        ]
        values = np.array([[float(growth)], [float(exact - growth)]])
    assert averages_closed_form.growth(np.array([x])) == pytest.approx(values[0], rel=2e-15)
    assert averages_closed_form.decline(np.array([x])) == pytest.approx(values[1], rel=2e-15)
    if x > 1e-8:  # below it the growth, x^2/8, is beneath all use
        assert averages_closed_form.amplitude_for_growth(values[0])[0] == pytest.approx(back[0], rel=2e-15)
    # Conditioning: at large v the decline is 1.5 ln v, so an ulp of it is ln v ulps of v.
    tolerance = 4e-15 * max(1.0, np.log(x))
    assert averages_closed_form.speed_for_decline(values[1])[0] == pytest.approx(back[1], rel=tolerance)
