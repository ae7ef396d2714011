# SPDX-License-Identifier: Apache-2.0
"""The general solver, held against what the closed forms and brute force say."""

from __future__ import annotations

from typing import Any

import mpmath as mp
import numpy as np
import pytest

from stickslip_monitor.physics import kbm_scan
from stickslip_monitor.physics.bifurcation import kbm, stationary_amplitudes
from stickslip_monitor.physics.friction import Coulomb, Stribeck, Tabulated
from stickslip_monitor.physics.oscillator import Bearing

STRIBECK = Stribeck(0.30, 0.10, 10.0)
# c/N [s/m] of kappa = 0.5, 0.2, 0.02, 0.002
DAMPING = np.array([1.0, 0.4, 0.04, 0.004])


def test_only_the_stribeck_law_itself_has_closed_forms() -> None:
    assert kbm(Coulomb(0.3, 0.1)) is kbm_scan
    assert kbm(Tabulated([0.0, 1.0], [0.3, 0.1])) is kbm_scan
    assert kbm(STRIBECK) is not kbm_scan


def test_hopf_speed_is_the_logarithm() -> None:
    """PHYSICS.md's ``-ln(kappa)/beta`` at 40 digits, found without being told."""
    delta = mp.mpf(0.3) - mp.mpf(0.1)
    exact = [float(-mp.log(mp.mpf(q) / (delta * 10)) / 10) for q in DAMPING]
    np.testing.assert_allclose(kbm_scan.hopf_speed(STRIBECK, DAMPING), exact, rtol=1e-12)


def test_fold_and_amplitudes_are_bracketed_by_the_integral(oracle: Any) -> None:
    """The 40-digit balance changes its sign within 1e-11 of what scan and polish return."""
    fold, hopf = kbm_scan.fold_speed(STRIBECK, DAMPING), kbm_scan.hopf_speed(STRIBECK, DAMPING)
    speed = 0.5 * (fold + hopf)
    amplitude, stable = kbm_scan.cycles(STRIBECK, speed, DAMPING)
    np.testing.assert_array_equal(stable, [[0.0, 1.0]] * 4)
    for i, q in enumerate(DAMPING):
        g = oracle.groups(Bearing(1.0, q, 1.0, STRIBECK, 0.1), speed[i], 1.0)
        near = mp.mpf('1e-11')
        v = g.decay * mp.mpf(fold[i])
        assert oracle.fold_excess(g, v * (1 - near)) > 0 > oracle.fold_excess(g, v * (1 + near))
        unstable, largest = (g.decay * mp.mpf(a) for a in amplitude[i])
        assert (
            oracle.balance(g, unstable * (1 - near)) < 0 < oracle.balance(g, unstable * (1 + near))
        )
        assert (
            oracle.balance(g, largest * (1 - near)) > 0 > oracle.balance(g, largest * (1 + near))
        )


def test_peak_slope_is_the_average_at_the_sliding_limit() -> None:
    """For the Stribeck law ``max_a 2 S/a`` stands at ``a = V``: ``2 Delta beta I1e(v)/v``."""
    delta = mp.mpf(0.3) - mp.mpf(0.1)
    for speed in (0.001, 0.05, 0.2, 1.0, 30.0):
        v = 10 * mp.mpf(speed)
        exact = 2 * delta * 10 * mp.exp(-v) * mp.besseli(1, v) / v
        got = kbm_scan.peak_slope(STRIBECK, np.array([speed]))[0]
        assert got == pytest.approx(float(exact), rel=1e-12)


def test_peak_slope_of_a_table_is_the_maximum(brute_force: Any) -> None:
    """The highest of a scan of 2000 amplitudes, of its cusp at ``a = V`` and of ``a = 0``."""
    law = Tabulated(
        [0.0, 0.02, 0.06, 0.2, 0.22, 0.3, 0.9], [0.4, 0.2, 0.2, 0.26, 0.16, 0.15, 0.15]
    )
    for speed in (0.01, 0.1, 0.21, 0.25, 0.35, 0.6, 2.0):
        _, slope = brute_force.balance(law, speed, 0.0)
        limit = 2.0 * brute_force.harmonic(law, speed, speed) / speed
        highest = max(slope.max(), limit, -float(law.slope(speed)))
        got = kbm_scan.peak_slope(law, np.array([speed]))[0]
        assert got >= highest - 1e-6
        assert got == pytest.approx(highest, rel=1e-5)


def test_amplitudes_are_the_smallest_threshold_and_the_largest_cycle() -> None:
    """Of all the cycles; a threshold needs a quiet state inside it."""
    law = Tabulated(
        [0.0, 0.02, 0.06, 0.2, 0.22, 0.3, 0.9], [0.4, 0.2, 0.2, 0.26, 0.16, 0.15, 0.15]
    )
    speed, q = np.array([0.2, 0.225, 0.25, 0.5]), np.full(4, 0.25)
    threshold = kbm_scan.threshold_amplitude(law, speed, q)
    largest = kbm_scan.stable_amplitude(law, speed, q)
    every = stationary_amplitudes(Bearing(1.0, 0.25, 1.0, law, 0.1), speed, 1.0)
    assert threshold[0] == every.amplitude[0, 0]
    assert np.isnan(threshold[1])  # unstable equilibrium: nothing to exceed
    assert largest[0] == every.amplitude[0, 3]
    assert largest[1] == every.amplitude[1, 2]
    assert np.isnan([threshold[3], largest[3]]).all()


def test_flat_friction_has_no_cycles_from_rounding() -> None:
    """Without damping the average of a constant is exactly 0, not a cloud of sign changes."""
    speed = np.geomspace(1e-3, 1e3, 50)
    for law in (
        Tabulated([0.0, 0.5], [0.2, 0.2]),
        Tabulated([0.0, 0.1, 0.2, 0.5], [0.1, 0.2, 0.25, 0.3]),
        Coulomb(0.3, 0.1),
    ):
        assert kbm_scan.cycles(law, speed, np.zeros(50))[0].shape == (50, 0)
        np.testing.assert_array_equal(kbm_scan.peak_slope(law, speed) > 0.0, np.zeros(50, bool))


def test_without_damping_a_table_reaches_any_speed() -> None:
    """Above its last point only a motion that dips into the fall is driven: ``a > V - v_last``."""
    law = Tabulated([0.0, 0.1, 0.2, 0.5], [0.3, 0.2, 0.15, 0.1])
    assert kbm_scan.fold_speed(law, np.zeros(1))[0] == np.inf
    amplitude, stable = kbm_scan.cycles(law, np.array([2.0]), np.zeros(1))
    assert stable[0].tolist() == [0.0, 1.0]
    assert amplitude[0, 0] <= 1.5 * (1.0 + 1e-6)
    assert amplitude[0, 1] > 2.0
