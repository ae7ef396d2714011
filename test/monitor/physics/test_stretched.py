# SPDX-License-Identifier: Apache-2.0
"""Stribeck's law with an exponent, from the configuration to the motion."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from shared import bearing_of

from stickslip_monitor import Bearing, CycleKind, exact_cycle, fold_speed, hopf_speed
from stickslip_monitor.errors import PhysicsError
from stickslip_monitor.physics.friction import Stretched, Stribeck, stribeck
from stickslip_monitor.physics.scalar_law import law_bounds, scalar_law

LAW = Stretched(0.3, 0.1, 10.0, 0.002, 2.0)
BENCH = bearing_of(LAW)


def test_an_exponent_of_one_is_stribecks_law():
    assert stribeck(0.3, 0.1, 10.0, 0.01, 1.0) == Stribeck(0.3, 0.1, 10.0, 0.01)
    v = np.linspace(-1.0, 1.0, 41)
    stretched, law = Stretched(0.3, 0.1, 10.0, 0.01, 1.0), Stribeck(0.3, 0.1, 10.0, 0.01)
    np.testing.assert_allclose(stretched.coefficient(v), law.coefficient(v), rtol=1e-15)


@pytest.mark.parametrize('exponent', [1.5, 3.0])
def test_slope_and_numbers_are_those_of_the_coefficient(exponent):
    law = Stretched(0.3, 0.1, 10.0, 0.002, exponent)
    v, h = np.geomspace(1e-3, 0.5, 30), 1e-7
    by_difference = (law.coefficient(v + h) - law.coefficient(v - h)) / (2.0 * h)
    np.testing.assert_allclose(law.slope(v), by_difference, rtol=1e-6, atol=1e-9)
    bounds, plain = law_bounds(law), scalar_law(law).plain
    for speed in (0.003, 0.1):
        mu = bounds.top - plain.drop(0.0, speed)
        assert mu == pytest.approx(float(law.coefficient(speed)))
        assert plain.slope(speed) == pytest.approx(float(law.slope(speed)))
    fine = -law.slope(np.linspace(1e-4, 0.5, 200_001))
    assert bounds.fall == pytest.approx(np.max(fine), rel=1e-8)


@pytest.mark.parametrize('exponent', [0.5, 4.5, float('nan')])
def test_exponents_that_it_does_not_take(exponent):
    with pytest.raises(PhysicsError, match='exponent'):
        Stretched(0.3, 0.1, 10.0, 0.0, exponent)


def test_its_stick_slip_by_scipy():
    speed, load = 0.05, 1000.0
    cycle = exact_cycle(BENCH, speed, load)

    def slip(_, y):
        v = max(speed - y[1], 1e-300)
        return [y[1], (load * float(LAW.coefficient(v)) - 400.0 * y[1] - 2e6 * y[0]) / 50.0]

    start = [(300.0 - 400.0 * speed) / 2e6, speed]
    solved = solve_ivp(slip, (0.0, 0.024), start, 'DOP853', rtol=1e-11, atol=1e-14, max_step=1e-5)
    x = solved.y[0]
    assert 0.5 * (np.max(x) - np.min(x)) == pytest.approx(cycle.amplitude, rel=1e-6)


def test_its_boundaries_hold_their_conditions():
    load = 1000.0
    hopf = hopf_speed(BENCH, load)
    assert load * float(LAW.slope(hopf)) + 400.0 == pytest.approx(0.0, abs=1e-6)
    assert fold_speed(BENCH, load) > hopf


def test_slip_that_lands_at_the_begin_of_a_narrow_piece_is_resolved():
    # Fitted pieces are 1e-8 of the belt's speed wide at rest. Below it a step went on along the first one,
    # which is wrong a few widths away, and came back to it for ever.
    bearing = Bearing(
        0.45598068, 14.0388826, 6745.2415, Stretched(0.40467659, 0.15744752, 63.032482, 0.0, 1.2), 0.1
    )
    speed = 0.0139390755 * np.linspace(0.9995, 1.0005, 60)
    kind = np.asarray(exact_cycle(bearing, speed, 2.3969962).kind)
    assert set(kind.tolist()) == {CycleKind.STICK_SLIP}
