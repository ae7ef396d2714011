# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from stickslip_monitor.physics.roots import root_on_bracket

Array = NDArray[np.float64]


def _between(function: Callable[..., Array], low: Array, high: Array, *more: Array) -> Array:
    ends = function(low, *more), function(high, *more)
    return root_on_bracket(function, low, high, ends, more)


def test_a_root_never_depends_on_its_neighbours() -> None:
    c = np.array([1e-12, 0.3, 7.0, 1e12])
    low, high = np.zeros_like(c), np.maximum(c, 1.0)
    between = _between(lambda x, k: x**3 - k, low, high, c)
    for i in range(c.size):
        l1, h1, c1 = (array[i : i + 1] for array in (low, high, c))
        assert _between(lambda x, k: x**3 - k, l1, h1, c1) == between[i]
    np.testing.assert_allclose(between, np.cbrt(c), rtol=1e-12)
