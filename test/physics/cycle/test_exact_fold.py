# SPDX-License-Identifier: Apache-2.0
"""The exact fold over many loads, against that of each load and against exact cycles."""

from __future__ import annotations

import numpy as np
import pytest

from stickslip_monitor import (
    Bearing,
    Coulomb,
    CycleKind,
    Stribeck,
    Tabulated,
    exact_cycle,
    exact_fold_speed,
)
from stickslip_monitor.physics.boundary_table import boundary_table
from stickslip_monitor.physics.friction import FrictionLaw

SPEEDS = (0.0, *np.geomspace(0.01, 1.0, 12))
TABLE = Tabulated(SPEEDS, [0.1 + 0.2 * float(np.exp(-10.0 * v)) for v in SPEEDS])


def bench(law: FrictionLaw, damping: float = 400.0) -> Bearing:
    return Bearing(50.0, damping, 2.0e6, law, 0.100)


@pytest.mark.parametrize(
    ('law', 'least', 'most', 'rounding'),
    [
        (Stribeck(0.3, 0.1, 10.0), 200.3, 1e4, 1e-9),
        (Stribeck(0.3, 0.1, 10.0), 1e4, 1e5, 1e-6),  # steep: orbits part at once near grazing
        (Stribeck(0.3, 0.1, 10.0, 0.001), 210.0, 2e3, 1e-9),
        (Coulomb(0.3, 0.1), 1.0, 1e4, 1e-9),
        (TABLE, 300.0, 3e3, 1e-4),
    ],
)
def test_many_loads_are_the_loads_one_by_one(law, least, most, rounding):
    load = np.geomspace(least, most, 200)
    together = exact_fold_speed(bench(law), load)
    some = [3, 60, 117, 196]
    alone = [exact_fold_speed(bench(law), load[i]) for i in some]
    np.testing.assert_allclose(together[some], alone, rtol=rounding)


@pytest.mark.parametrize(
    ('bearing', 'load'),
    [
        (bench(Stribeck(0.3, 0.1, 10.0)), 700.0),
        (bench(Stribeck(0.3, 0.1, 1000.0)), 50.0),
        (bench(TABLE), 700.0),
        # A law so sharp that a step would pass over its layer.
        (Bearing(50.0, 15.0, 2.0e6, Stribeck(0.3, 0.1, 5e5), 0.1), 8000.0),
        # A heavily damped lining with a steep law, whose fold was not found before.
        (Bearing(1.0, 1.8, 1.0, Stribeck(0.3, 0.1, 1.0), 0.1), 5000.0),
    ],
)
def test_stick_slip_ends_at_the_fold(bearing, load):
    fold = exact_fold_speed(bearing, load)
    below, above = exact_cycle(bearing, fold * np.array([1.0 - 3e-6, 1.0 + 3e-6]), load).kind
    assert below == CycleKind.STICK_SLIP
    assert above == CycleKind.NONE


def test_a_fold_in_proportion_to_the_load_under_coulombs_law():
    fold = exact_fold_speed(bench(Coulomb(0.3, 0.1)), np.array([10.0, 1000.0, 7e4]))
    np.testing.assert_allclose(fold / fold[0], [1.0, 100.0, 7e3], rtol=1e-10)


# A steep law has its onset at 2 N, far below the loads that it carries; near grazing its orbits
# part at once.
@pytest.mark.parametrize(
    ('decay', 'least', 'rounding'), [(10.0, 203.0, 1e-9), (1000.0, 3.0, 3e-6)]
)
def test_the_table_over_the_load_is_the_exact_fold(decay, least, rounding):
    bearing = bench(Stribeck(0.3, 0.1, decay))
    load = np.array([least, 311.0, 1007.0, 9001.0])
    exact = [exact_fold_speed(bearing, n) for n in load]
    np.testing.assert_allclose(boundary_table(bearing).exact(load), exact, rtol=rounding)
