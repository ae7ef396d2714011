# SPDX-License-Identifier: Apache-2.0
"""The published findings, statement by statement, against numbers found elsewhere.

Exact amplitudes and folds come from docs/physics.md, computed by another program. Scaling laws
that the code does not use, and scipy's own integrator, check the rest.
"""

from __future__ import annotations

import numpy as np
import pytest
import scipy.special
from draw_findings import (
    REFERENCE,
    REFERENCE_LOAD,
    REFERENCE_RPM,
    History,
    Sweep,
    draw_amplitudes,
    over_kinetic,
    over_load,
    over_speed,
    stick_slip_history,
)

from stickslip_monitor import assess, hopf_speed
from stickslip_monitor.physics.cycles import exact_cycle, exact_unstable_cycle

RPM = REFERENCE.speed.factor('rpm')
V = REFERENCE_RPM * RPM
OMEGA = 200.0


@pytest.fixture(scope='module')
def speeds() -> Sweep:
    return over_speed(REFERENCE, REFERENCE_LOAD)


@pytest.fixture(scope='module')
def loads() -> Sweep:
    return over_load(REFERENCE, V, REFERENCE_LOAD, points=30)


@pytest.fixture(scope='module')
def kinetics() -> Sweep:
    return over_kinetic(REFERENCE, V, REFERENCE_LOAD, points=4)


@pytest.fixture(scope='module')
def history() -> History:
    return stick_slip_history(REFERENCE, V, REFERENCE_LOAD)


# 1. Amplitude against belt speed.


def test_the_stable_branches_pass_through_the_known_amplitudes(speeds: Sweep) -> None:
    rpm = np.array([10.0, 20.0, 30.0, 38.0])
    exact = np.array([0.296953, 0.556755, 0.804800, 1.000212]) * 1e-3
    averaged = np.array([0.26352, 0.52688, 0.78708, 0.99499]) * 1e-3
    alive = speeds.value < speeds.exact_fold
    for reference, column in ((exact, speeds.exact), (averaged, speeds.averaged)):
        between = np.interp(rpm * RPM, speeds.value[alive], column[alive])
        assert between == pytest.approx(reference, rel=5e-5)
    assert speeds.hopf == pytest.approx(0.1609438, abs=5e-8)
    assert speeds.exact_fold / RPM == pytest.approx(40.7179, abs=5e-5)
    assert speeds.averaged_fold / RPM == pytest.approx(40.7231, abs=5e-5)
    assert speeds.fold_amplitude == pytest.approx(speeds.exact_fold / OMEGA, rel=2e-3)


def test_the_picture_has_the_regimes_behind_both_panels(speeds: Sweep) -> None:
    upper, below = draw_amplitudes(speeds, 'statement', 'footnote', 'speed [rpm]', ' rpm', RPM).axes
    # From the left to the Hopf speed, from there to the fold, and beyond.
    ends = [upper.get_xlim()[0], speeds.hopf / RPM, speeds.exact_fold / RPM, upper.get_xlim()[1]]
    for axes in (upper, below):
        bands = sorted((patch.get_x(), patch.get_x() + patch.get_width()) for patch in axes.patches)
        assert [end for band in bands for end in band] == pytest.approx(
            [ends[0], ends[1], ends[1], ends[2], ends[2], ends[3]]
        )


def test_averaging_is_better_at_the_unstable_branch(speeds: Sweep) -> None:
    """Compare with the numbers of docs/physics.md; the published sentence says the opposite."""
    rpm = np.array([32.0, 34.0, 36.0, 38.0, 40.0])
    exact = exact_unstable_cycle(REFERENCE, rpm * RPM, 1000.0).amplitude
    averaged = assess(REFERENCE, rpm * RPM, 1000.0).threshold_amplitude
    stated = np.array([-0.006, -0.016, -0.025, -0.035, -0.045])
    assert 100.0 * (averaged / exact - 1.0) == pytest.approx(stated, abs=6e-4)
    error = speeds.error[np.isfinite(speeds.error)]
    assert error[0] == np.min(error) < -0.2
    assert np.abs(error[-1]) < 2e-3


@pytest.mark.parametrize(
    ('order', 'stated'), [(6, [np.nan] * 3), (7, [-39.9, -39.9, -52.4]), (9, [-2.9, -7.7, -16.3])]
)
def test_the_published_polynomial_misses_the_unstable_branch(order: int, stated: list[float]) -> None:
    """Show the likely reason for the published sentence: the expansion, not averaging [%].

    The unstable cycle slips throughout: with ``alpha = a/V < 1`` the friction's average is a
    polynomial in alpha, by the mean of ``cos^(j+1)``, and balances the damping.
    """
    power, errors = np.arange(order + 1), []
    mean = [scipy.special.binom(j + 1, (j + 1) // 2) / 2.0 ** (j + 1) * (j % 2) for j in power]
    for v in np.array([32.0, 36.0, 40.0]) * RPM:
        mu = np.polynomial.Polynomial(0.2 * (-10.0 * v) ** power / scipy.special.factorial(power))
        # Of mu(1 - alpha c) the coefficient of alpha^j, times the mean of cos^(j + 1).
        parts = [
            mu.deriv(int(j))(1.0) * (-1.0) ** j / scipy.special.factorial(j) * mean[j] for j in power[1:]
        ]
        parts[0] -= 0.5 * 400.0 * v / 1000.0
        roots = np.polynomial.Polynomial(parts).roots()
        real = roots[(abs(roots.imag) < 1e-9) & (roots.real > 1e-3) & (roots.real < 1.0)].real
        exact = exact_unstable_cycle(REFERENCE, v, 1000.0).amplitude
        errors.append(100.0 * (real.min() * v / OMEGA / exact - 1.0) if real.size else np.nan)
    assert errors == pytest.approx(stated, abs=0.05, nan_ok=True)


# 2. Amplitude against normal force.


def test_the_amplitude_rises_slowly_with_the_load(loads: Sweep) -> None:
    assert loads.value[-1] / loads.averaged_fold == pytest.approx(6.0)
    # Six times the load, a third more vibration; by averaging 2 %.
    assert loads.exact[-1] / loads.fold_amplitude == pytest.approx(1.33, abs=0.01)
    assert loads.averaged[-1] / loads.fold_amplitude == pytest.approx(1.02, abs=0.01)


def test_at_low_load_there_is_only_the_equilibrium(loads: Sweep) -> None:
    assert loads.averaged_fold == pytest.approx(498.0, abs=0.5)
    # Only N Delta counts at a speed; I1e(x) from its integral, by the trapezoidal rule.
    x, t = 10.0 * V, np.linspace(0.0, 2.0 * np.pi, 400, endpoint=False)
    kappa = 2.0 * float(np.mean(np.exp(x * (np.cos(t) - 1.0)) * np.cos(t))) / x
    assert loads.averaged_fold == pytest.approx(400.0 / (0.2 * 10.0 * kappa), rel=1e-10)
    assert loads.exact_fold == pytest.approx(loads.averaged_fold, rel=1e-4)
    assert hopf_speed(REFERENCE, loads.hopf) == pytest.approx(V, rel=1e-12)
    assert np.isfinite(exact_cycle(REFERENCE, V, loads.exact_fold * (1 + 1e-9)).amplitude)
    assert np.isnan(exact_cycle(REFERENCE, V, loads.exact_fold * (1 - 1e-9)).amplitude)


# 3. Amplitude against the kinetic friction coefficient.


def test_beyond_a_kinetic_coefficient_of_a_fifth_there_is_only_the_equilibrium(
    kinetics: Sweep, loads: Sweep
) -> None:
    """Pass the equilibrium alone, which the sweeps do not know: the cycle hangs on ``N (mu_s - mu_k)``."""
    assert kinetics.averaged_fold == pytest.approx(0.2003, abs=5e-5)
    assert kinetics.exact_fold == pytest.approx(0.2003, abs=5e-5)
    assert kinetics.value[-1] > 0.22
    load = 1000.0 * (0.3 - kinetics.value) / 0.2
    stable = exact_cycle(REFERENCE, V, load).amplitude
    np.testing.assert_allclose(kinetics.exact, stable, rtol=1e-9)
    fold = 1000.0 * (0.3 - kinetics.exact_fold) / 0.2
    assert fold == pytest.approx(loads.exact_fold, rel=1e-9)


# 4. Time history and phase portrait.


def test_stick_slip_grows_out_of_a_small_disturbance_to_the_exact_cycle(history: History) -> None:
    """Begin at a twentieth of the cycle; the crests until the first stick are averaging's."""
    offset = history.motion.displacement - history.equilibrium
    assert offset[0] == pytest.approx(0.05 * history.averaged_amplitude)
    period = 2.0 * np.pi / OMEGA
    for begin in np.arange(2, 20, 3) * period:
        turn = (history.time >= begin) & (history.time <= begin + period)
        crest = int(np.argmax(np.where(turn, offset, -np.inf)))
        assert offset[crest] == pytest.approx(history.envelope[crest], rel=0.02)
    assert history.motion.sticking.any()
    assert np.max(history.motion.velocity) <= V * (1.0 + 1e-12)
    last = history.time > history.time[-1] - history.cycle.period
    _, *cycle_columns = history.cycle.waveform(721)
    motion = np.column_stack([history.motion.displacement[last] * OMEGA, history.motion.velocity[last]])
    cycle = np.column_stack([cycle_columns[0] * OMEGA, cycle_columns[1]])
    distance = np.hypot(*(motion[:, None] - cycle[None]).transpose(2, 0, 1)).min(axis=1)
    assert np.max(distance) < 6e-3 * V
