# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from stickslip_monitor.physics.roots import newton_on_bracket, root_on_bracket

Array = NDArray[np.float64]


def _cube(x: Array, c: Array) -> tuple[Array, Array]:
    return c - x**3, -3.0 * x * x


def _kink(x: Array) -> tuple[Array, Array]:
    return np.where(x < 0.25, 1.0, 0.25 - x), np.where(x < 0.25, 0.0, -1.0)


def _overshoot(x: Array) -> tuple[Array, Array]:
    y = 50.0 * (x - 0.2)
    return -np.arctan(y), -50.0 / (1.0 + y * y)


@pytest.mark.parametrize('start', [0.0, 0.3, 1.0])
@pytest.mark.parametrize(
    ('function', 'root', 'tolerance'),
    [
        (lambda x: (-((x - 0.3) ** 9), -9.0 * (x - 0.3) ** 8), 0.3, 1e-2),
        (_kink, 0.25, 1e-9),
        (_overshoot, 0.2, 2e-15),
        (lambda x: (0.6 - x, np.full_like(x, 5.0)), 0.6, 2e-15),
        (lambda x: (0.6 - x, np.zeros_like(x)), 0.6, 2e-15),
        (lambda x: (-np.cbrt(x - 0.4), np.full_like(x, -np.inf)), 0.4, 2e-15),
    ],
    ids=['flat', 'kink', 'overshoot', 'wrong slope', 'no slope', 'vertical'],
)
def test_newton_is_safeguarded(
    function: Callable[[Array], tuple[Array, Array]], root: float, tolerance: float, start: float
) -> None:
    """Bisection must take over where a bare Newton step stalls, cycles or leaves the bracket."""
    got = newton_on_bracket(function, np.zeros(1), np.ones(1), np.full(1, start))
    assert got[0] == pytest.approx(root, abs=tolerance)


def test_newton_without_a_root_goes_to_the_end_that_is_nearest_to_one() -> None:
    """The documented convention for a function of one sign."""
    beyond = np.array([3.0, -2.0])
    got = newton_on_bracket(
        lambda x, c: (c - x, -np.ones_like(x)), np.zeros(2), np.ones(2), np.full(2, 0.5), (beyond,)
    )
    np.testing.assert_allclose(got, [1.0, 0.0], atol=1e-9)


def _between(function: Callable[..., Array], low: Array, high: Array, *more: Array) -> Array:
    ends = function(low, *more), function(high, *more)
    return root_on_bracket(function, low, high, ends, more)


def test_a_root_never_depends_on_its_neighbours() -> None:
    c = np.array([1e-12, 0.3, 7.0, 1e12])
    low, high = np.zeros_like(c), np.maximum(c, 1.0)
    newton = newton_on_bracket(_cube, low, high, 0.3 * high, (c,))
    between = _between(lambda x, k: x**3 - k, low, high, c)
    for i in range(c.size):
        l1, h1, c1 = (array[i : i + 1] for array in (low, high, c))
        assert newton_on_bracket(_cube, l1, h1, 0.3 * h1, (c1,)) == newton[i]
        assert _between(lambda x, k: x**3 - k, l1, h1, c1) == between[i]
    np.testing.assert_allclose(newton, np.cbrt(c), rtol=1e-14)
    np.testing.assert_allclose(between, np.cbrt(c), rtol=1e-12)
