# SPDX-License-Identifier: Apache-2.0
"""Vibrations that never stick beside stable sliding, against direct integration."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from shared import RPM, bearing_of

from stickslip_monitor import Bearing, CycleKind, Tabulated, assess, exact_cycle, fold_speed
from stickslip_monitor.physics import averages_by_quadrature, cycles, orbits
from stickslip_monitor.physics.averaging import sticking_end
from stickslip_monitor.physics.boundary_table import boundary_table
from stickslip_monitor.physics.cycles import end_of_vibration, exact_amplitude
from stickslip_monitor.physics.friction import Stretched

RISES_FIRST = Tabulated([0.0, 0.02, 0.05, 0.1, 0.2, 0.4], [0.15, 0.25, 0.3, 0.2, 0.12, 0.1])
PLATEAU = Tabulated([0.0, 0.02, 0.05, 0.1, 0.2, 0.4], [0.3, 0.3, 0.3, 0.2, 0.12, 0.1])


def amplitude_by_integration(bearing: Bearing, speed: float, load: float, start: float) -> float:
    """Amplitude [m] after 150 turns that begin at a share of the sliding limit."""
    turn, law = 2.0 * np.pi / bearing.natural_frequency, bearing.friction

    def rates(_, y):
        assert y[1] < speed  # it never sticks
        push = load * float(law.coefficient(speed - y[1]))
        force = push - bearing.damping * y[1] - bearing.stiffness * y[0]
        return y[1], force / bearing.mass

    begin = [float(bearing.equilibrium(speed, load)), -start * speed]
    last = np.linspace(148.0, 150.0, 2001) * turn
    options = {'method': 'DOP853', 'rtol': 1e-9, 'atol': 1e-13, 'max_step': turn / 30.0}
    motion = solve_ivp(rates, (0.0, last[-1]), begin, t_eval=last, **options).y
    return float(np.ptp(motion[0])) / 2.0


@pytest.mark.parametrize(('law', 'rpm'), [(RISES_FIRST, 45.0), (PLATEAU, 49.5)])
@pytest.mark.parametrize('points', [1, 40])  # one after another, and together as arrays
def test_the_vibration_is_that_of_direct_integration(law, rpm, points):
    bearing, speed = bearing_of(law), np.full(points, rpm * RPM)
    cycle = exact_cycle(bearing, speed, 1000.0)
    expected = amplitude_by_integration(bearing, rpm * RPM, 1000.0, 0.95)
    assert np.all(cycle.kind == CycleKind.PURE_SLIP)
    np.testing.assert_allclose(cycle.amplitude, expected, rtol=1e-4)
    np.testing.assert_allclose(assess(bearing, speed, 1000.0).amplitude_exact, expected, rtol=1e-4)
    # Steady sliding is stable beside it: a small start dies out.
    assert amplitude_by_integration(bearing, rpm * RPM, 1000.0, 0.2) < 0.2 * expected


@pytest.mark.parametrize('law', [RISES_FIRST, PLATEAU, Stretched(0.3, 0.1, 10.0, 0.0, 4.0)])
def test_a_vibration_goes_on_up_to_about_the_averaged_fold(law):
    """First order averaging has a pure slip's end to the order of eta squared."""
    bearing = bearing_of(law)
    end = fold_speed(bearing, 1000.0)
    exists = np.isfinite(exact_cycle(bearing, end * np.array([0.99, 1.01]), 1000.0).amplitude)
    assert exists.tolist() == [True, False]


def _scattered_bearing() -> Bearing:
    speed = np.linspace(0.0, 0.8, 100)
    noise = np.random.default_rng(3).normal(0.0, 0.004, 100)
    law = Tabulated(speed, np.abs(0.1 + 0.2 * np.exp(-10.0 * speed) + noise))
    return bearing_of(law)


def test_the_fold_that_decides_does_not_hang_on_the_speeds_of_the_averaged_curve(monkeypatch):
    """Halve the speeds of the curve: read off the curve, the root moved by up to 0.5 %."""
    bearing, load = _scattered_bearing(), np.array([140.0, 1350.0, 6100.0, 13000.0])
    fold = end_of_vibration(bearing, load)
    curve = averages_by_quadrature.average_curve(bearing.friction)
    fewer = averages_by_quadrature.AverageCurve(*(column[::2] for column in curve))
    monkeypatch.setattr(averages_by_quadrature, 'average_curve', lambda law: fewer)
    np.testing.assert_allclose(end_of_vibration(bearing, load), fold, rtol=1e-9)


def test_sticking_ends_under_averaging_where_the_cycle_at_the_limit_is_balanced():
    """``2 S(V; V)/V = c/N`` by the midpoint rule."""
    bearing, load = _scattered_bearing(), np.array([140.0, 1350.0, 6100.0, 13000.0])
    end = sticking_end(bearing, load)[:, None]
    angle = (np.arange(200_000) + 0.5) * (np.pi / 200_000)
    friction = bearing.friction.coefficient(end * (1.0 - np.cos(angle)))
    np.testing.assert_allclose(
        2.0 * np.mean(friction * np.cos(angle), axis=1) / end[:, 0], 400.0 / load, rtol=1e-6
    )


def test_beyond_its_last_speed_a_tabulated_averaged_fold_is_that_of_the_load():
    # There the fold of a scattered table leaps from one load to the next; it was 7 % off.
    bearing, load = _scattered_bearing(), np.array([2873.0, 6116.0])
    tabulated = boundary_table(bearing).fold_kbm(load)
    np.testing.assert_allclose(tabulated, fold_speed(bearing, load), rtol=5e-3)


def test_the_scan_for_a_vibration_takes_fine_steps_only_where_a_gain_is_about_none(monkeypatch):
    """Compare the amplitudes with those of a scan by the finest steps throughout."""
    bearing, errors = _scattered_bearing(), []

    def follow(field, e, z, route):
        errors.extend([route.error] * e.size)
        return orbits.follow(field, e, z, route)

    speed, load = np.meshgrid(np.linspace(0.1, 0.4, 12), np.linspace(500.0, 1500.0, 5))
    with monkeypatch.context() as patch:
        patch.setattr(cycles, '_ERROR_OF_SIGN', cycles._ERROR)
        finest = exact_amplitude(bearing, speed, load)
    monkeypatch.setattr(cycles, 'follow', follow)
    np.testing.assert_allclose(exact_amplitude(bearing, speed, load), finest, rtol=1e-10)
    assert errors.count(cycles._ERROR) < 0.5 * errors.count(cycles._ERROR_OF_SIGN)
