# SPDX-License-Identifier: Apache-2.0
"""Exact folds of any damping against slip integrated in time by scipy's LSODA, on both sides of each."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from own_law import OwnLaw
from scipy.integrate import LSODA

from stickslip_monitor import Bearing, Stribeck, Tabulated, exact_fold_speed
from stickslip_monitor.physics.boundary_table import boundary_table
from stickslip_monitor.physics.friction import FrictionLaw, Stretched


class Unnamed(OwnLaw):
    """Stribeck's law of a user who names no breakpoints."""

    breakpoints = ()


def bearing_of(law: FrictionLaw, zeta: float) -> Bearing:
    """50 kg at 200 rad/s."""
    return Bearing(50.0, 2.0e4 * zeta, 2.0e6, law, 0.1)


def reaches_belt(bearing: Bearing, speed: float, load: float) -> bool:
    """Return whether slip that begins at the static limit reaches the belt's speed again.

    In units of ``V/omega`` and ``1/omega``. It is over when the lining turns to follow the belt and falls
    behind again, or at steady sliding.
    """
    law, damping = bearing.friction, 2.0 * bearing.damping_ratio
    force = load / (bearing.momentum * speed)

    def rates(_: float, y: np.ndarray) -> list[float]:
        x, z = y
        return [1.0 - z, damping * (1.0 - z) + x - force * float(law.coefficient(max(speed * z, 1e-12)))]

    equilibrium, begin = force * float(law.coefficient(speed)), force * law.static - damping
    scale, first = abs(begin - equilibrium) + 1.0, 1e-6
    steep = -force * speed * float(law.slope(1e-12)) - damping  # the first instant, as a series
    y = [begin + first, 0.5 * first**2 * (1.0 + steep * first / 3.0)]
    motion = LSODA(rates, 0.0, y, 1e4, rtol=1e-10, atol=1e-12 * scale, max_step=0.05)
    behind = turned = False
    while motion.status == 'running':
        acceleration = rates(0.0, motion.y)[1]
        motion.step()
        x, z = motion.y
        turned |= behind and z < 1.0
        behind |= z > 1.0
        motion.max_step = 0.02 if turned or not behind else 20.0
        if turned and (z <= 0.0 or acceleration < 0.0 < rates(0.0, motion.y)[1]):
            return bool(z <= 0.0)
        if abs(x - equilibrium) + abs(z - 1.0) < 1e-8 * scale:
            break
    return False


NOISY_SPEEDS = np.append(0.0, np.geomspace(0.005, 1.5, 18))
NOISE = 0.01 * np.random.default_rng(7).standard_normal(19)
NOISY = Tabulated(NOISY_SPEEDS, 0.1 + 0.2 * np.exp(-10.0 * NOISY_SPEEDS) + NOISE)


@pytest.mark.parametrize(('zeta', 'times'), [(1.0, 30.0), (7.3, 4.0)])  # load over the least unstable one
@pytest.mark.parametrize(
    'law',
    [Stribeck(0.3, 0.1, 10.0, 0.02), Stretched(0.3, 0.1, 10.0, 0.0, 2.0), Unnamed(0.3, 0.1, 10.0), NOISY],
    ids=['viscous', 'Gaussian', 'unnamed', 'noisy'],
)
def test_slip_meets_the_belt_below_the_fold_and_not_above(law, zeta, times):
    bearing = bearing_of(law, zeta)
    load = times * bearing.damping / float(np.max(-law.slope(np.geomspace(1e-4, 10.0, 500))))
    fold = exact_fold_speed(bearing, load)
    assert reaches_belt(bearing, fold * (1.0 - 3e-4), load)
    assert not reaches_belt(bearing, fold * (1.0 + 3e-4), load)
    assert not reaches_belt(bearing, fold * 1.3, load)


def test_a_law_that_names_no_breakpoints_has_the_boundaries_of_the_same_law_that_does():
    """0.3 of critical damping, 30 kN: it had none."""
    unnamed, stribeck = (bearing_of(law, 0.3) for law in (Unnamed(0.3, 0.1, 1.0), Stribeck(0.3, 0.1, 1.0)))
    load = np.array([3.2e4, 1e5, 1e6])
    np.testing.assert_allclose(exact_fold_speed(unnamed, load), exact_fold_speed(stribeck, load), rtol=1e-9)
    tables = [boundary_table(bearing) for bearing in (unnamed, stribeck)]
    for name in ('fold_kbm', 'fold'):
        np.testing.assert_allclose(*(getattr(bearing, name)(load) for bearing in tables), rtol=1e-6)
    slow = (
        replace(unnamed, friction=Unnamed(0.3, 0.1, 0.003)),
        replace(stribeck, friction=Stribeck(0.3, 0.1, 0.003)),
    )
    np.testing.assert_allclose(*(exact_fold_speed(bearing, 1e9) for bearing in slow), rtol=1e-9)
