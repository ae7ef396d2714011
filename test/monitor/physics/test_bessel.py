# SPDX-License-Identifier: Apache-2.0
"""The scaled Bessel functions against mpmath and scipy, in every range and number of points."""

from __future__ import annotations

import mpmath as mp
import numpy as np
import pytest
import scipy.special

from stickslip_monitor.physics import bessel


@pytest.mark.parametrize('order', [0, 1])
@pytest.mark.parametrize('x', [0.0, 1e-200, 0.3, 7.999, 8.0, 8.001, 31.0, 700.0, 1e9])
def test_every_digit_is_right(order: int, x: float) -> None:
    with mp.workdps(40):
        exact = float(mp.besseli(order, x) * mp.exp(-mp.mpf(x))) if x < 1e6 else 1 / np.sqrt(2e9 * np.pi)
    function = (bessel.i0e, bessel.i1e)[order]
    assert function(np.array([x]))[0] == pytest.approx(exact, rel=1e-9 if x == 1e9 else 1e-15)


@pytest.mark.parametrize('name', ['i0e', 'i1e'])
@pytest.mark.parametrize('count', [1, 10, 11, 5000])
def test_points_are_those_of_scipy(name: str, count: int) -> None:
    # A machine that fuses a product with a sum may differ by a last bit.
    x = np.geomspace(1e-3, 1e5, count)
    assert getattr(bessel, name)(x) == pytest.approx(getattr(scipy.special, name)(x), rel=4e-16)


@pytest.mark.parametrize('count', [1, 20])
def test_ends_of_the_range(count: int) -> None:
    ends = np.resize([np.inf, np.nan], count)
    assert bessel.i1e(ends) == pytest.approx(scipy.special.i1e(ends), nan_ok=True)
