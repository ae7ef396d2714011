# SPDX-License-Identifier: Apache-2.0
"""A friction law added as a class works everywhere, and as Stribeck's of the same numbers does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import ArrayLike
from own_law import OwnLaw
from shared import bearing_of

from stickslip_monitor import Stribeck, exact_cycle, exact_unstable_cycle
from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.jit import has_compiler
from stickslip_monitor.physics.integrator import Drive, MotionState, integrate
from stickslip_monitor.physics.scalar_law import scalar_law

NUMBERS = (0.3, 0.1, 10.0)
REFERENCE = bearing_of(Stribeck(*NUMBERS))
OWN = replace(REFERENCE, friction=OwnLaw(*NUMBERS))
SPEED, LOAD = 0.05, 1000.0


def test_it_has_the_cycles_of_stribecks_law() -> None:
    for solve, speed in ((exact_cycle, SPEED), (exact_unstable_cycle, 0.18)):
        stribeck, unnamed = solve(REFERENCE, speed, LOAD), solve(OWN, speed, LOAD)
        assert unnamed.amplitude == pytest.approx(stribeck.amplitude, rel=1e-9)
        assert unnamed.period == pytest.approx(stribeck.period, rel=1e-9)


@pytest.mark.parametrize('compiled', [False, True])
def test_it_has_the_motion_of_stribecks_law(compiled: bool) -> None:
    if compiled and not has_compiler():
        pytest.skip('numba is not installed')
    drive, start = Drive.sampled([0.0, 0.3], [0.03, 0.08], [900.0, 1100.0]), MotionState(0.0, 0.0)
    times = np.linspace(0.0, 0.3, 301)
    stribeck, unnamed = (
        integrate(replace(REFERENCE, friction=friction), drive, start, times, compiled=compiled)
        for friction in (REFERENCE.friction, OwnLaw(*NUMBERS))
    )
    assert unnamed.transitions.after.tolist() == stribeck.transitions.after.tolist()
    assert unnamed.displacement == pytest.approx(stribeck.displacement, abs=1e-12)


class Weaker(Stribeck):
    """A subclass that computes otherwise."""

    def coefficient(self, speed: ArrayLike) -> FloatArray:
        return 0.5 * super().coefficient(speed)


def test_a_law_that_computes_otherwise_does_not_use_its_parents_numbers() -> None:
    parent, overridden = (
        scalar_law(law).plain.drop(0.0, 0.1) for law in (Stribeck(*NUMBERS), Weaker(*NUMBERS))
    )
    assert overridden == pytest.approx(0.5 * parent, rel=1e-13)
