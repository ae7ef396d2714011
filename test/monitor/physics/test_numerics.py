# SPDX-License-Identifier: Apache-2.0
"""Roots and cubics, the latter against scipy's."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.interpolate import BarycentricInterpolator, CubicSpline, PchipInterpolator

from stickslip_monitor.physics.numerics import (
    hermite_cubics,
    local_polynomials,
    monotone_slopes,
    root_on_bracket,
    spline_slopes,
)

Array = NDArray[np.float64]


def solve_between(function: Callable[..., Array], low: Array, high: Array, *more: Array) -> Array:
    ends = function(low, *more), function(high, *more)
    return root_on_bracket(function, low, high, ends, more)


def test_a_root_never_depends_on_its_neighbours() -> None:
    c = np.array([1e-12, 0.3, 7.0, 1e12])
    low, high = np.zeros_like(c), np.maximum(c, 1.0)
    between = solve_between(lambda x, k: x**3 - k, low, high, c)
    for i in range(c.size):
        l1, h1, c1 = (array[i : i + 1] for array in (low, high, c))
        assert solve_between(lambda x, k: x**3 - k, l1, h1, c1) == between[i]
    np.testing.assert_allclose(between, np.cbrt(c), rtol=1e-12)


def test_an_end_whose_value_was_rounded_across_zero_is_the_root() -> None:
    # As a margin by coarse steps that finer ones contradict: the bracket shrinks to that end, and to nothing.
    low, high = np.array([0.4]), np.array([0.5 + 2.0**-52])
    with np.errstate(all='raise'):
        root = root_on_bracket(lambda x: np.full(x.size, -9.0), low, high, (-high, high))
    assert root == pytest.approx(high, rel=1e-15)


@pytest.mark.parametrize('size', [2, 3, 50])
def test_monotone_cubics_are_those_of_scipy(size: int) -> None:
    rng = np.random.default_rng(size)
    x, y = np.cumsum(rng.uniform(0.1, 1.0, size)), rng.uniform(0.0, 1.0, size)
    cubics = hermite_cubics(x, y, monotone_slopes(x, y))
    assert cubics == pytest.approx(PchipInterpolator(x, y).c, rel=1e-12, abs=1e-13)


@pytest.mark.parametrize('size', [4, 50])
def test_splines_are_those_of_scipy(size: int) -> None:
    rng = np.random.default_rng(size)
    x, y = np.cumsum(rng.uniform(0.1, 1.0, size)), rng.uniform(0.0, 1.0, size)
    cubics = hermite_cubics(x, y, spline_slopes(x, y))
    assert cubics == pytest.approx(CubicSpline(x, y).c, rel=1e-10, abs=1e-10)


def test_local_polynomials_go_through_the_points_about_a_place() -> None:
    x = np.cumsum(np.random.default_rng(3).uniform(0.1, 1.0, 9))
    y, at = np.sin(x), np.array([x[0], 0.5 * (x[4] + x[5]), x[-1] - 0.01])
    about = ([0, 1, 2, 3], [3, 4, 5, 6], [5, 6, 7, 8])
    expected = [float(BarycentricInterpolator(x[k], y[k])(v)) for k, v in zip(about, at, strict=True)]
    assert local_polynomials(x, y, at, 4) == pytest.approx(expected, rel=1e-13)
