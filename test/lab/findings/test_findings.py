# SPDX-License-Identifier: Apache-2.0
"""The published findings, statement by statement, against numbers found elsewhere.

Exact amplitudes and folds come from PHYSICS.md, computed there by another program. Scaling laws
that the code does not use, and scipy's own integrator, check the rest.
"""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from stickslip_monitor import Coulomb, Stribeck, Tabulated, assess, hopf_speed
from stickslip_monitor.errors import PhysicsError
from stickslip_monitor.lab.findings.published import (
    REFERENCE,
    REFERENCE_LOAD,
    REFERENCE_RPM,
    History,
    check_point,
    friction_curves,
    stick_slip_history,
)
from stickslip_monitor.lab.findings.sweeps import (
    Sweep,
    over_kinetic,
    over_load,
    over_speed,
    reverse_time_amplitudes,
)
from stickslip_monitor.physics.cycle.cycles import exact_cycle, exact_unstable_cycle

RPM = REFERENCE.speed.factor('rpm')
V = REFERENCE_RPM * RPM
LAW = REFERENCE.friction
OMEGA = 200.0


@pytest.fixture(scope='module')
def speeds() -> Sweep:
    return over_speed(REFERENCE, REFERENCE_LOAD)


@pytest.fixture(scope='module')
def loads() -> Sweep:
    return over_load(REFERENCE, V, REFERENCE_LOAD)


@pytest.fixture(scope='module')
def kinetics() -> Sweep:
    return over_kinetic(REFERENCE, V, REFERENCE_LOAD, points=16)


@pytest.fixture(scope='module')
def history() -> History:
    return stick_slip_history(REFERENCE, V, REFERENCE_LOAD)


def at(sweep: Sweep, column: np.ndarray, value: float) -> float:
    """A curve between its grid points, along the branch that is smooth there."""
    known = np.isfinite(column)
    return float(np.interp(value, sweep.value[known], column[known]))


# 1. Amplitude against belt speed.


@pytest.mark.slow
@pytest.mark.parametrize(
    ('rpm', 'exact', 'averaged'),
    [
        (10.0, 0.296953e-3, 0.26352e-3),
        (20.0, 0.556755e-3, 0.52688e-3),
        (30.0, 0.804800e-3, 0.78708e-3),
        (38.0, 1.000212e-3, 0.99499e-3),
    ],
)
def test_the_stable_branches_pass_through_the_known_amplitudes(
    speeds: Sweep, rpm: float, exact: float, averaged: float
) -> None:
    assert at(speeds, speeds.exact, rpm * RPM) == pytest.approx(exact, rel=5e-5)
    assert at(speeds, speeds.averaged, rpm * RPM) == pytest.approx(averaged, rel=5e-5)
    points = np.array([rpm * RPM])
    assert exact_cycle(REFERENCE, points, 1000.0).amplitude == pytest.approx(exact, abs=6e-10)
    assert assess(REFERENCE, points, 1000.0).amplitude == pytest.approx(averaged, abs=6e-9)


def test_hopf_and_fold_are_where_they_are_known_to_be(speeds: Sweep) -> None:
    assert speeds.hopf == pytest.approx(0.1609438, abs=5e-8)
    assert speeds.exact_fold / RPM == pytest.approx(40.7179, abs=5e-5)
    assert speeds.averaged_fold / RPM == pytest.approx(40.7231, abs=5e-5)
    assert speeds.fold_amplitude == pytest.approx(speeds.exact_fold / OMEGA, rel=2e-3)


def test_stick_slip_grows_with_speed_and_ends_at_the_fold(speeds: Sweep) -> None:
    for amplitude, fold in (
        (speeds.exact, speeds.exact_fold),
        (speeds.averaged, speeds.averaged_fold),
    ):
        inside = speeds.value < fold
        assert np.isfinite(amplitude[inside]).all()
        assert np.isnan(amplitude[speeds.value > fold]).all()
        assert np.all(np.diff(amplitude[inside]) > 0.0)


def test_the_hopf_is_subcritical_and_the_branches_meet_at_the_fold(speeds: Sweep) -> None:
    between = (speeds.value > speeds.hopf) & (speeds.value < speeds.exact_fold)
    unstable = speeds.exact_unstable
    assert np.isfinite(unstable[between]).all()
    assert np.isnan(unstable[speeds.value < speeds.hopf]).all()
    assert np.isnan(unstable[speeds.value > speeds.averaged_fold]).all()
    assert np.all(np.diff(unstable[between]) > 0.0)
    assert unstable[between][0] < 1e-3 * unstable[between][-1]
    assert unstable[between][-1] == pytest.approx(speeds.fold_amplitude, rel=1e-7)
    # Near the Hopf the amplitude is that of 2 I1(a)/a = kappa exp(v): a^2/8 = v - v_H.
    first = speeds.value[between][0]
    expected = np.sqrt(8.0 * 10.0 * (first - speeds.hopf)) / (10.0 * OMEGA)
    assert unstable[between][0] == pytest.approx(expected, rel=2e-3)


@pytest.mark.slow
def test_the_unstable_amplitude_at_34_rpm() -> None:
    known = {'exact': 0.592815e-3, 'averaged': 0.59272e-3}
    speed = np.array([34.0 * RPM])
    exact = exact_unstable_cycle(REFERENCE, speed, 1000.0).amplitude
    assert exact == pytest.approx(known['exact'], abs=6e-10)
    threshold = assess(REFERENCE, speed, 1000.0).threshold_amplitude
    assert threshold == pytest.approx(known['averaged'], abs=6e-9)
    reverse = reverse_time_amplitudes(REFERENCE, speed, 1000.0)
    assert reverse == pytest.approx(known['exact'], abs=6e-10)


def test_reverse_time_finds_the_branch_of_the_return_map(speeds: Sweep) -> None:
    mapped = exact_unstable_cycle(REFERENCE, speeds.reverse_value, 1000.0).amplitude
    assert speeds.reverse_value.size == 9
    np.testing.assert_allclose(speeds.reverse, mapped, rtol=1e-6)
    np.testing.assert_allclose(speeds.reverse, mapped, rtol=5e-8)


def test_averaging_is_good_at_the_unstable_branch_and_poor_at_low_speed(speeds: Sweep) -> None:
    between = (speeds.value > 1.02 * speeds.hopf) & (speeds.value < speeds.exact_fold)
    assert np.max(np.abs(speeds.unstable_error[between])) < 2e-3
    error = speeds.error[np.isfinite(speeds.error)]
    assert error[-1] == pytest.approx(0.0, abs=2e-3)
    assert at(speeds, speeds.error, 10.0 * RPM) == pytest.approx(26352 / 29695.3 - 1, abs=1e-3)
    assert np.min(error) == error[0] < -0.2


def test_where_reverse_time_has_no_cycle_it_says_nan() -> None:
    outside = np.array([20.0, 34.0]) * RPM
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        found = reverse_time_amplitudes(REFERENCE, outside, 1000.0)
    assert np.isnan(found[0])
    assert found[1] == pytest.approx(0.592815e-3, abs=6e-10)


# 2. Amplitude against normal force.


def test_the_amplitude_rises_slowly_with_the_load(loads: Sweep) -> None:
    for amplitude, fold in (
        (loads.exact, loads.exact_fold),
        (loads.averaged, loads.averaged_fold),
    ):
        alive = loads.value > fold
        assert np.all(np.diff(amplitude[alive]) >= 0.0)
        assert np.isnan(amplitude[loads.value < fold]).all()
    top = loads.value[-1] / loads.averaged_fold
    assert top == pytest.approx(6.0)
    # Six times the load, a third more vibration; by averaging 2 %.
    assert loads.exact[-1] / loads.fold_amplitude == pytest.approx(1.33, abs=0.01)
    assert loads.averaged[-1] / loads.fold_amplitude == pytest.approx(1.02, abs=0.01)


def test_at_low_load_there_is_only_the_equilibrium(loads: Sweep) -> None:
    assert loads.averaged_fold == pytest.approx(498.0, abs=0.5)
    # Only N Delta counts at a speed: the fold at 1000 N is the fold at 40.72 rpm.
    kappa = 2.0 * _i1e(10.0 * V) / (10.0 * V)
    assert loads.averaged_fold == pytest.approx(400.0 / (0.2 * 10.0 * kappa), rel=1e-10)
    assert loads.exact_fold == pytest.approx(loads.averaged_fold, rel=1e-4)
    assert hopf_speed(REFERENCE, loads.hopf) == pytest.approx(V, rel=1e-12)
    assert np.isfinite(exact_cycle(REFERENCE, V, loads.exact_fold * (1 + 1e-9)).amplitude)
    assert np.isnan(exact_cycle(REFERENCE, V, loads.exact_fold * (1 - 1e-9)).amplitude)


def _i1e(x: float) -> float:
    """``exp(-x) I1(x)`` from its integral, by the trapezoidal rule on a period."""
    t = np.linspace(0.0, 2.0 * np.pi, 400, endpoint=False)
    return float(np.mean(np.exp(x * (np.cos(t) - 1.0)) * np.cos(t)))


# 3. Amplitude against the kinetic friction coefficient.


@pytest.mark.slow
def test_beyond_a_kinetic_coefficient_of_a_fifth_there_is_only_the_equilibrium(
    kinetics: Sweep,
) -> None:
    assert kinetics.averaged_fold == pytest.approx(0.2003, abs=5e-5)
    assert kinetics.exact_fold == pytest.approx(0.2003, abs=5e-5)
    assert np.isnan(kinetics.exact[kinetics.value > kinetics.exact_fold]).all()
    assert np.isnan(kinetics.averaged[kinetics.value > kinetics.averaged_fold]).all()
    assert kinetics.value[-1] > 0.22
    for amplitude, fold in (
        (kinetics.exact, kinetics.exact_fold),
        (kinetics.averaged, kinetics.averaged_fold),
    ):
        alive = kinetics.value < fold - 1e-9
        assert np.all(np.diff(amplitude[alive]) < 0.0)


def test_load_and_kinetic_coefficient_act_through_one_product(
    loads: Sweep, kinetics: Sweep
) -> None:
    """The exact cycle depends on ``N (mu_s - mu_k)`` only, which the sweeps do not know."""
    load = 1000.0 * (0.3 - kinetics.value) / 0.2
    np.testing.assert_allclose(
        kinetics.exact, exact_cycle(REFERENCE, V, load).amplitude, rtol=1e-9
    )
    inside = np.isfinite(kinetics.exact_unstable)
    assert inside.any()
    np.testing.assert_allclose(
        kinetics.exact_unstable[inside],
        exact_unstable_cycle(REFERENCE, V, load[inside]).amplitude,
        rtol=1e-8,
        atol=1e-13,
    )
    fold = 1000.0 * (0.3 - kinetics.exact_fold) / 0.2
    assert fold == pytest.approx(loads.exact_fold, rel=1e-9)


# 4. Time history and phase portrait.


def test_stick_slip_grows_out_of_a_small_disturbance(history: History) -> None:
    offset = history.displacement - history.equilibrium
    assert offset[0] == pytest.approx(0.05 * history.averaged_amplitude)
    assert not history.sticking[0]
    last = history.time > history.time[-1] - 2.0 * history.period
    half = 0.5 * float(np.ptp(offset[last]))
    assert half == pytest.approx(0.556755e-3, rel=1e-4)
    # The growth rate of the linearised model: (N Delta beta exp(-beta V) - c)/(2 m).
    rate = (1000.0 * 0.2 * 10.0 * np.exp(-10.0 * V) - 400.0) / 100.0
    period = 2.0 * np.pi / OMEGA
    crests = [float(np.max(offset[_turn(history, k * period)])) for k in (1, 5)]
    assert np.log(crests[1] / crests[0]) / (4.0 * period) == pytest.approx(rate, rel=0.01)


def _turn(history: History, start: float) -> np.ndarray:
    period = 2.0 * np.pi / OMEGA
    return (history.time >= start) & (history.time <= start + period)


def test_the_stick_phase_is_the_straight_piece_at_belt_speed(history: History) -> None:
    assert history.sticking.any()
    np.testing.assert_allclose(history.velocity[history.sticking], V, rtol=1e-12)
    assert np.max(history.velocity) <= V * (1.0 + 1e-12)
    whole = history.time > history.time[-1] - 4.0 * history.period
    share = float(np.mean(history.sticking[whole]))
    assert share == pytest.approx(history.stick_fraction, abs=0.01)
    straight = np.abs(history.cycle_velocity - V) <= 1e-12 * V
    assert np.mean(straight) == pytest.approx(history.stick_fraction, abs=0.01)
    # While it sticks the lining is carried V t: nothing else decides the length of the piece.
    carried = np.ptp(history.cycle_displacement[straight])
    assert carried == pytest.approx(V * history.stick_fraction * history.period, rel=0.02)


def test_the_history_ends_on_the_exact_cycle(history: History) -> None:
    assert history.period == pytest.approx(31.5903e-3, abs=5e-8)
    assert history.exact_amplitude == pytest.approx(0.556755e-3, abs=6e-10)
    last = history.time > history.time[-1] - history.period
    motion = np.column_stack([history.displacement[last] * OMEGA, history.velocity[last]])
    cycle = np.column_stack([history.cycle_displacement * OMEGA, history.cycle_velocity])
    distance = np.hypot(*(motion[:, None] - cycle[None]).transpose(2, 0, 1)).min(axis=1)
    assert np.max(distance) < 6e-3 * V


def test_the_growing_motion_is_that_of_scipy(history: History) -> None:
    """Before the first stick the motion is smooth, and any integrator has it."""
    first = int(np.argmax(history.sticking))
    early = history.time[: first - 10]
    load = 1000.0

    def flow(_: float, y: np.ndarray) -> list[float]:
        friction = load * float(LAW.coefficient(V - y[1]))
        return [y[1], (friction - 400.0 * y[1] - 2.0e6 * y[0]) / 50.0]

    start = [float(history.displacement[0]), 0.0]
    found = solve_ivp(
        flow, (0.0, early[-1]), start, method='DOP853', rtol=1e-11, atol=1e-14, t_eval=early
    )
    np.testing.assert_allclose(history.displacement[: early.size], found.y[0], atol=1e-10)


def test_the_averaged_envelope_follows_the_crests(history: History) -> None:
    offset = history.displacement - history.equilibrium
    growing = history.envelope < 0.8 * history.averaged_amplitude
    for start in np.arange(2, 20, 3) * 2.0 * np.pi / OMEGA:
        turn = _turn(history, start)
        if not growing[turn].all():
            break
        crest = int(np.argmax(np.where(turn, offset, -np.inf)))
        assert offset[crest] == pytest.approx(history.envelope[crest], rel=0.02)


# 5. The friction curves.


def test_the_two_friction_curves() -> None:
    curves = friction_curves(REFERENCE, 1000.0)
    v = curves.speed
    np.testing.assert_allclose(curves.stribeck, -curves.stribeck[::-1])
    np.testing.assert_array_equal(np.abs(curves.coulomb), 0.1)
    ahead = v > 0.0
    np.testing.assert_allclose(curves.stribeck[ahead], 0.1 + 0.2 * np.exp(-10.0 * v[ahead]))
    assert np.all(np.diff(curves.stribeck[ahead]) < 0.0)
    assert np.all(curves.stribeck[ahead] > curves.coulomb[ahead])
    assert curves.hopf_slope == pytest.approx(-400.0 / 1000.0, rel=1e-12)
    assert curves.hopf_coefficient == pytest.approx(0.14, rel=1e-12)


def test_with_constant_friction_nothing_starts_by_itself() -> None:
    coulomb = replace(REFERENCE, friction=Coulomb(0.3, 0.1))
    speed = np.array([1.0, 5.0, 20.0]) * RPM
    assert np.isnan(hopf_speed(coulomb, 1000.0))
    assert np.isnan(assess(coulomb, speed, 1000.0).amplitude).all()
    # Yet a lining that once sticks goes on sticking, at low speed.
    assert np.isfinite(exact_cycle(coulomb, speed, 1000.0).amplitude).tolist() == [1, 1, 0]


# Tables and refusals.


def test_the_table_of_a_sweep_has_every_point_once(speeds: Sweep) -> None:
    columns = speeds.columns('surface_speed [m/s]')
    speed = columns['surface_speed [m/s]']
    assert speed.size == speeds.value.size + 9
    assert np.all(np.diff(speed) >= 0.0)
    assert {column.size for column in columns.values()} == {speed.size}
    reverse = columns['reverse_time_unstable_amplitude [m]']
    np.testing.assert_array_equal(reverse[np.isfinite(reverse)], speeds.reverse)
    np.testing.assert_array_equal(speed[np.isfinite(reverse)], speeds.reverse_value)


@pytest.mark.parametrize(
    ('bearing', 'rpm', 'load', 'words'),
    [
        (replace(REFERENCE, friction=Coulomb(0.3, 0.1)), 20.0, 1e3, 'friction law = coulomb must'),
        (
            replace(REFERENCE, friction=Tabulated([0.0, 0.1], [0.3, 0.1])),
            20.0,
            1e3,
            'friction law = tabulated must be stribeck',
        ),
        (replace(REFERENCE, friction=Stribeck(0.2, 0.2, 10.0)), 20.0, 1e3, 'has no fold'),
        (replace(REFERENCE, damping=0.0), 20.0, 1e3, 'load = 1000 N has no fold'),
        (REFERENCE, 20.0, 100.0, 'load = 100 N has no fold'),
        (REFERENCE, 35.0, 1e3, 'speed = 35 rpm must lie between 0 and the Hopf speed, 30.738 rpm'),
        (REFERENCE, 0.0, 1e3, 'speed = 0 rpm must lie'),
        (REFERENCE, -20.0, 1e3, 'speed = -20 rpm must lie'),
    ],
)
def test_a_point_without_the_findings_is_refused(
    bearing: object, rpm: float, load: float, words: str
) -> None:
    with pytest.raises(PhysicsError) as error:
        check_point(bearing, rpm * RPM, load)  # type: ignore[arg-type]
    assert words in str(error.value)
