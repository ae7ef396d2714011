# SPDX-License-Identifier: Apache-2.0
"""The coefficients of the Runge-Kutta method, and of cubics, against scipy's."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import DOP853
from scipy.interpolate import CubicSpline, PchipInterpolator

from stickslip_monitor.physics import slip_step
from stickslip_monitor.physics.hermite import hermite_cubics, monotone_slopes, spline_slopes


def test_the_stages_are_those_of_dop853() -> None:
    for i, stages in enumerate(slip_step.USED, 1):
        row = np.zeros(12)
        row[list(stages)] = getattr(slip_step, f'A{i}')
        assert row.tolist() == DOP853.A[i, :12].tolist()
    assert np.array(slip_step.C).tolist() == DOP853.C[:12].tolist()


def test_the_weights_are_those_of_dop853() -> None:
    weights, third = np.zeros((2, 12)), np.zeros(12)
    weights[:, list(slip_step.WEIGHED)] = slip_step.B, slip_step.E5
    third[list(slip_step.THIRD)] = slip_step.E3
    assert weights.tolist() == [DOP853.B.tolist(), DOP853.E5[:12].tolist()]
    assert third == pytest.approx(DOP853.B - DOP853.E3[:12], abs=1e-16)


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
