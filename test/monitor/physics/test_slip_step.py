# SPDX-License-Identifier: Apache-2.0
"""The Runge-Kutta method: its coefficients against scipy's, and its order."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import DOP853

from stickslip_monitor.physics import slip_step as dop853
from stickslip_monitor.physics.friction import Stribeck
from stickslip_monitor.physics.scalar_law import scalar_law
from stickslip_monitor.physics.slip_step import Medium, SlipState, acceleration, slip_step


def test_the_stages_are_those_of_dop853() -> None:
    for i, stages in enumerate(dop853.USED, 1):
        row = np.zeros(12)
        row[list(stages)] = getattr(dop853, f'A{i}')
        assert row.tolist() == DOP853.A[i, :12].tolist()
    assert np.array(dop853.C).tolist() == DOP853.C[:12].tolist()


def test_the_weights_are_those_of_dop853() -> None:
    weights, third = np.zeros((2, 12)), np.zeros(12)
    weights[:, list(dop853.WEIGHED)] = dop853.B, dop853.E5
    third[list(dop853.THIRD)] = dop853.E3
    assert weights.tolist() == [DOP853.B.tolist(), DOP853.E5[:12].tolist()]
    assert third == pytest.approx(DOP853.B - DOP853.E3[:12], abs=1e-16)


def test_error_falls_with_the_eighth_power_of_the_step() -> None:
    """A swing of ten radians about steady sliding at 0.6 m/s, in 8, 16 and 32 steps."""
    own, medium = scalar_law(Stribeck(0.3, 0.1, 10.0)).plain.numbers, Medium(0.6, 0.17, 0.04, 0.0, 0.6, 0.0)

    def end(steps: int) -> np.ndarray:
        state = SlipState(0.07, 0.0, acceleration(own, medium, 0.07, 0.0))
        for _ in range(steps):
            state, _ = slip_step(own, medium, state, 10.0 / steps)
        return np.array([state.e, state.z])

    errors = [np.hypot(*(end(steps) - end(256))) for steps in (8, 16, 32)]
    assert np.diff(np.log2(errors)) == pytest.approx(-8, abs=0.4)
