# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import numpy as np
import pytest

from stickslip_monitor.physics.motion.polynomial import first_positive


def coefficients(roots: list[float], lead: float = 1.0) -> list[float]:
    return (lead * np.poly(roots)[::-1]).tolist()


def first(c: list[float]) -> float:
    return first_positive(c, len(c) - 1, [0.0] * len(c))


@pytest.mark.parametrize('root', [1e-9, 1e-3, 0.3, 0.5, 0.999999, 1.0 - 1e-12])
def test_single_root_is_found_to_rounding(root: float) -> None:
    found = first(coefficients([root, -0.7, 1.8, 2.5]))
    assert found == pytest.approx(root, abs=4e-16)


@pytest.mark.parametrize('gap', [1e-2, 1e-4, 1e-6])
def test_two_close_roots_are_not_jumped_over(gap: float) -> None:
    """Positive only between 0.4 and 0.4 + gap, as at a grazing contact."""
    found = first(coefficients([0.4, 0.4 + gap, 3.0, 4.0], lead=-1.0))
    assert found == pytest.approx(0.4, abs=1e-14 / gap)


@pytest.mark.parametrize('gap', [0.0, 1e-12, 1e-6])
def test_a_touch_without_crossing_is_no_event(gap: float) -> None:
    assert first([-0.25 - gap, 1.0, -1.0, 0.0]) == -1.0


def test_random_polynomials_against_a_fine_scan() -> None:
    rng = np.random.default_rng(7)
    grid = np.linspace(0.0, 1.0, 20001)
    for _ in range(300):
        c = rng.standard_normal(9) * 3.0 ** rng.uniform(-1.0, 1.0, 9)
        c[0] = -abs(c[0])
        values = np.polyval(c[::-1], grid)
        found = first(c.tolist())
        if found < 0.0:
            assert np.max(values) <= 0.0
        else:
            assert abs(np.polyval(c[::-1], found)) < 1e-13 * np.sum(np.abs(c))
            assert np.max(values[grid < found - 1e-12], initial=-1.0) <= 0.0
