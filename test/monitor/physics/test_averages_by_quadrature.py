# SPDX-License-Identifier: Apache-2.0
"""The general solver, held against what the closed forms and brute force say."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable

import numpy as np
import pytest
from shared import REFERENCE_BEARING, bearing_of

from stickslip_monitor.physics import averages_by_quadrature
from stickslip_monitor.physics.averaging import count_cycles, fold_speed, hopf_speed, stationary_amplitudes
from stickslip_monitor.physics.bearing import Bearing
from stickslip_monitor.physics.cycles import CycleKind, exact_cycle, exact_fold_speed
from stickslip_monitor.physics.friction import FrictionLaw, Stretched, Stribeck, Tabulated

STRIBECK = Stribeck(0.30, 0.10, 10.0)
# c/N [s/m] of kappa = 0.5, 0.2, 0.02, 0.002
DAMPING = np.array([1.0, 0.4, 0.04, 0.004])

TWO_FALLS = Tabulated([0.0, 0.02, 0.06, 0.2, 0.22, 0.3, 0.9], [0.4, 0.2, 0.2, 0.26, 0.16, 0.15, 0.15])


class Sharper(Stribeck):
    """Falls twice as fast as its coefficients say."""

    def _doubled_law(self) -> Stribeck:
        return Stribeck(self.static, self.kinetic, 2.0 * self.decay)

    def coefficient(self, speed):
        return self._doubled_law().coefficient(speed)

    def slope(self, speed):
        return self._doubled_law().slope(speed)


def test_a_subclass_that_overrides_its_friction_is_a_law_of_its_own() -> None:
    """Neither its parent's closed forms nor its parent's exact cycles are its own."""
    bearing = bearing_of(Sharper(0.30, 0.10, 5.0))
    same = REFERENCE_BEARING
    assert hopf_speed(bearing, 1000.0) == pytest.approx(hopf_speed(same, 1000.0), rel=1e-9)
    assert fold_speed(bearing, 1000.0) == pytest.approx(fold_speed(same, 1000.0), rel=1e-7)
    assert exact_fold_speed(bearing, 1000.0) == pytest.approx(exact_fold_speed(same, 1000.0), rel=1e-6)
    cycle = exact_cycle(bearing, 0.1, 1000.0)
    assert cycle.kind is CycleKind.STICK_SLIP
    assert cycle.amplitude == pytest.approx(exact_cycle(same, 0.1, 1000.0).amplitude, rel=1e-8)


def test_stribecks_law_has_the_averages_of_its_closed_forms() -> None:
    """Compare with the closed forms, which the 40-digit balance holds to 1e-12 (test_averaging.py)."""
    fold = averages_by_quadrature.fold_speed(STRIBECK, DAMPING)
    for i, q in enumerate(DAMPING):
        bearing = Bearing(1.0, q, 1.0, STRIBECK, 0.1)
        assert fold[i] == pytest.approx(fold_speed(bearing, 1.0), rel=2e-11)
        speed = 0.5 * (fold[i] + hopf_speed(bearing, 1.0))
        amplitudes = stationary_amplitudes(bearing, speed, 1.0).amplitude
        quadrature_amplitudes, stable = averages_by_quadrature.cycles(
            STRIBECK, np.array([speed]), 1.0, 1.0 / DAMPING[i : i + 1]
        )
        np.testing.assert_allclose(quadrature_amplitudes[0], amplitudes, rtol=2e-11)
        assert stable[0].tolist() == [0.0, 1.0]


def test_amplitudes_are_the_smallest_threshold_and_the_largest_cycle() -> None:
    """Compare with all the cycles; a threshold needs a quiet state inside it."""
    law = TWO_FALLS
    speed, q = np.array([0.2, 0.225, 0.25, 0.5]), np.full(4, 0.25)
    threshold = averages_by_quadrature.threshold_amplitude(law, speed, 0.25, np.ones(4))
    largest = averages_by_quadrature.stable_amplitude(law, speed, q)
    every = stationary_amplitudes(Bearing(1.0, 0.25, 1.0, law, 0.1), speed, 1.0)
    assert threshold[0] == every.amplitude[0, 0]
    assert np.isnan(threshold[1])  # unstable equilibrium: nothing to exceed
    assert largest[0] == every.amplitude[0, 3]
    assert largest[1] == every.amplitude[1, 2]
    assert np.isnan([threshold[3], largest[3]]).all()


def test_without_damping_a_table_reaches_any_speed() -> None:
    """Above its last point only a motion that dips into the fall is driven: ``a > V - v_last``."""
    law = Tabulated([0.0, 0.1, 0.2, 0.5], [0.3, 0.2, 0.15, 0.1])
    assert averages_by_quadrature.fold_speed(law, np.zeros(1))[0] == np.inf
    amplitude, stable = averages_by_quadrature.cycles(law, np.array([2.0]), 0.0, np.ones(1))
    assert stable[0].tolist() == [0.0, 1.0]
    assert amplitude[0, 0] <= 1.5 * (1.0 + 1e-6)
    assert amplitude[0, 1] > 2.0


def _random_tables(count: int) -> list[Tabulated]:
    rng = np.random.default_rng(5)
    tables = []
    for size in rng.integers(3, 14, count).tolist():
        speed = np.cumsum(rng.uniform(0.01, 0.15, size)) - 0.01
        coefficient = rng.uniform(0.05, 0.4, size)
        falling = rng.random() < 0.5
        tables.append(Tabulated(speed, np.sort(coefficient)[::-1] if falling else coefficient))
    return tables


def random_points(law: Tabulated, count: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(6)
    speed = rng.uniform(0.005, 1.3 * law.speed[-1], count) * rng.choice([1.0, 1.0, 0.1], count)
    steepest = averages_by_quadrature.average_curve(law).peak.max()
    return speed, max(steepest, 1e-3) * np.exp(rng.uniform(np.log(1e-3), 0.0, count))


@pytest.mark.slow
def test_the_table_of_a_law_hides_no_cycle() -> None:
    """Compare with a scan eight times as fine of the average itself: its sign changes as often.

    Two cycles closer together than that scan is fine may be found in addition.
    """
    fine = np.unique(
        np.concatenate(
            [
                g + np.diff(averages_by_quadrature.GRID) * k / 8
                for k in range(8)
                for g in [averages_by_quadrature.GRID[:-1]]
            ]
        )
    )[1:]
    for law in _random_tables(4):
        speed, q = random_points(law, 60)
        x, v = (grid.ravel() for grid in np.meshgrid(fine, speed))
        above = averages_by_quadrature.slope_surface(law, x, v).reshape(60, -1) > q[:, None]
        changes = np.count_nonzero(above[:, 1:] != above[:, :-1], axis=1)
        amplitude, stable = averages_by_quadrature.cycles(law, speed, 1.0, 1.0 / q)
        counts = np.count_nonzero(~np.isnan(amplitude), axis=1)
        assert np.all((counts == changes) | (counts == changes + 2))
        assert np.mean(counts == changes) > 0.98
        fold = averages_by_quadrature.fold_speed(law, q)
        exists = averages_by_quadrature.has_cycle(law, speed, q, fold)
        np.testing.assert_array_equal(exists, (stable > 0.0).any(axis=1))


@pytest.mark.slow
def test_the_fold_of_a_table_is_where_the_highest_average_passes() -> None:
    # The whole grid of amplitudes, refined about its highest point, just below and above the fold.
    for law in _random_tables(5):
        q = random_points(law, 60)[1]
        fold = averages_by_quadrature.fold_speed(law, q)
        q, fold = q[np.isfinite(fold)], fold[np.isfinite(fold)]

        assert np.all(averages_by_quadrature.peak_slope(law, fold * (1.0 - 1e-9)) >= q)
        assert np.all(averages_by_quadrature.peak_slope(law, fold * (1.0 + 1e-9)) <= q)


def test_a_fine_table_takes_memory_and_speeds_in_bounds() -> None:
    """1,000 points of Stribeck's law: its own boundaries, in a fraction of 200 MB."""
    speed = np.linspace(0.0, 1.0, 1000)
    law = Tabulated(speed, 0.1 + 0.2 * np.exp(-10.0 * speed))
    same = bearing_of(STRIBECK)
    bearing = bearing_of(law)
    tracemalloc.start()
    fold, hopf = fold_speed(bearing, 1000.0), hopf_speed(bearing, 1000.0)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 100e6
    assert averages_by_quadrature.average_curve(law).speed.size < 700
    assert fold == pytest.approx(fold_speed(same, 1000.0), rel=1e-5)
    assert hopf == pytest.approx(hopf_speed(same, 1000.0), rel=1e-4)


def measured_curve(points: int, scatter: float, step: float) -> Tabulated:
    """Return a curve as a bench or a reader leaves it: it scatters, or has steps."""
    speed = np.append(0.0, np.geomspace(0.005, 1.0, points - 1))
    noise = scatter * np.random.default_rng(points).standard_normal(points)
    values = 0.1 + 0.2 * np.exp(-10.0 * speed) + noise
    return Tabulated(speed, np.round(values / step) * step if step else values)


@pytest.mark.parametrize(
    ('points', 'scatter', 'step'),
    [(100, 0.004, 0.0), (300, 0.001, 0.0), (300, 0.0, 0.001), (1000, 0.0, 0.001)],
)
def test_above_the_fold_of_a_measured_table_no_speed_has_a_cycle(
    points: int, scatter: float, step: float
) -> None:
    """Scan 600 speeds and 17 amplitudes above the fold; just below it there is a cycle."""
    law, load = measured_curve(points, scatter, step), 609.0
    fold = fold_speed(bearing_of(law), load)
    below, above = np.array([fold * (1.0 - 1e-9)]), np.geomspace(fold * (1.0 + 1e-9), 3.0, 600)
    assert load * averages_by_quadrature.peak_slope(law, below) >= 400.0
    for share in np.linspace(0.0, 1.0, 17):
        slope = averages_by_quadrature.slope_surface(law, np.full(600, share), above)
        assert np.all(load * slope <= 400.0)


def test_a_cycle_of_a_measured_table_balances(
    harmonic_by_quad: Callable[[FrictionLaw, float, float], float],
) -> None:
    """Balance by scipy's quadrature; a line between two speeds had hidden a false pair."""
    speed = np.append(0.0, np.geomspace(0.005, 1.0, 45))
    scatter = 0.003 * np.random.default_rng(40).standard_normal(46)
    law, v, q = Tabulated(speed, 0.1 + 0.2 * np.exp(-10.0 * speed) + scatter), 0.293812085, 0.083243209
    amplitudes, _ = averages_by_quadrature.cycles(law, np.array([v]), q, np.ones(1))
    balance = [2.0 * harmonic_by_quad(law, v, a) / a for a in amplitudes[0].tolist()]
    np.testing.assert_allclose(balance, q, rtol=1e-6)


def test_the_highest_average_is_that_of_a_dense_scan_also_just_below_the_sliding_limit() -> None:
    law, shares = Stretched(0.3, 0.1, 10.0, 0.0, 2.0), np.linspace(0.0, 1.0, 1601)[1:]
    # At the last two it is highest between the limit and the place beside it on the grid.
    for speed in (*np.geomspace(0.01, 0.4, 12), 0.2290, 0.2325):
        dense = averages_by_quadrature.slope_surface(law, shares, np.full(1600, speed)).max()
        assert averages_by_quadrature.peak_slope(law, np.array([speed]))[0] >= dense * (1.0 - 1e-10)


def test_the_average_of_a_table_that_scatters_is_its_integral(
    harmonic_by_quad: Callable[[FrictionLaw, float, float], float],
) -> None:
    """Integrate by scipy's quadrature; three nodes in narrow parts of the table left 1e-9."""
    law = measured_curve(300, 0.002, 0.0)
    for v, share in ((0.1, 0.93), (0.02, 0.7), (0.3, 1.4)):
        expected = harmonic_by_quad(law, v, v * share)
        average = averages_by_quadrature.harmonic(law, np.array([v]), np.array([v * share]))[0]
        assert average == pytest.approx(expected, abs=1e-13)


@pytest.mark.parametrize('law', [STRIBECK, Sharper(0.3, 0.1, 5.0), TWO_FALLS, measured_curve(60, 0.003, 0.0)])
def test_cycles_are_counted_as_they_are_found(law: FrictionLaw) -> None:
    # At rest and without a load there are none.
    bearing, speed = bearing_of(law), np.linspace(0.0, 0.4, 200)
    for load in (0.0, 300.0, 1000.0):
        cycle_counts = np.isfinite(stationary_amplitudes(bearing, speed, load).amplitude).sum(axis=1)
        np.testing.assert_array_equal(count_cycles(bearing, speed, load), cycle_counts)
