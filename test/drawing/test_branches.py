# SPDX-License-Identifier: Apache-2.0
"""The branches against closed forms, the published numbers, and the averaged equation itself."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import i1, i1e

from stickslip_monitor import Bearing, Coulomb, Regime, Stribeck, Tabulated, amplitude_rate
from stickslip_monitor.drawing.branches import (
    Diagram,
    MarkKind,
    bifurcation_diagram,
    diagram_columns,
)
from stickslip_monitor.drawing.map_curves import diagram_speeds

RPM = math.pi * 0.1 / 60.0
LOAD = 1000.0
TABLE = Tabulated([0.01, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4], [0.3, 0.2, 0.19, 0.19, 0.15, 0.1, 0.11])


def bearing(friction: object, damping: float = 400.0) -> Bearing:
    return Bearing(50.0, damping, 2.0e6, friction, 0.1)  # type: ignore[arg-type]


REFERENCE = bearing(Stribeck(0.3, 0.1, 10.0))


def diagram_of(own: Bearing) -> Diagram:
    return bifurcation_diagram(own, LOAD, diagram_speeds(own, LOAD), 200)


@pytest.fixture(scope='module')
def reference() -> Diagram:
    return diagram_of(REFERENCE)


@pytest.fixture(scope='module')
def table() -> Diagram:
    return diagram_of(bearing(TABLE))


def test_hopf_and_fold_are_where_the_closed_forms_put_them(reference: Diagram) -> None:
    kappa = 400.0 / (LOAD * 0.2 * 10.0)
    hopf, fold = reference.marks
    assert (hopf.kind, fold.kind) == (MarkKind.HOPF, MarkKind.FOLD)
    assert hopf.speed == pytest.approx(-math.log(kappa) / 10.0, rel=1e-14)
    v = brentq(lambda x: 2.0 * i1e(x) / x - kappa, 1.0, 4.0, xtol=1e-15)
    assert fold.speed == pytest.approx(v / 10.0, rel=1e-13)
    assert hopf.speed / RPM == pytest.approx(30.7380, abs=5e-5)
    assert fold.speed / RPM == pytest.approx(40.7231, abs=5e-5)


def test_branches_end_exactly_at_hopf_and_fold(reference: Diagram) -> None:
    hopf, fold = reference.marks
    stable, threshold = reference.branches
    at_hopf, at_fold = np.searchsorted(reference.speed, [hopf.speed, fold.speed])
    assert reference.speed[[at_hopf, at_fold]].tolist() == [hopf.speed, fold.speed]
    assert (stable.stable, threshold.stable) == (True, False)
    # The unstable branch meets the stable one on the sliding limit a = V.
    assert stable.amplitude[at_fold] == threshold.amplitude[at_fold] == fold.speed / 200.0
    assert threshold.amplitude[at_hopf] == 0.0
    assert np.isnan(threshold.amplitude[:at_hopf]).all()
    assert np.isfinite(threshold.amplitude[at_hopf : at_fold + 1]).all()
    assert np.isfinite(stable.amplitude[: at_fold + 1]).all()
    assert np.isnan(stable.amplitude[at_fold + 1 :]).all()


@pytest.mark.parametrize(
    ('rpm', 'millimetres'), [(10, 0.26352), (20, 0.52688), (30, 0.78708), (38, 0.99499)]
)
def test_stick_slip_amplitudes_are_the_published_ones(rpm: float, millimetres: float) -> None:
    diagram = bifurcation_diagram(REFERENCE, LOAD, (rpm * RPM, 50.0 * RPM), 10)
    assert diagram.branches[0].amplitude[0] * 1e3 == pytest.approx(millimetres, abs=6e-6)


def test_threshold_amplitude_solves_its_closed_form(reference: Diagram) -> None:
    threshold = reference.branches[1].amplitude
    inside = (threshold > 0.0) & (reference.speed < reference.marks[1].speed)
    alpha, v = 10.0 * 200.0 * threshold[inside], 10.0 * reference.speed[inside]
    np.testing.assert_allclose(2.0 * i1(alpha) / alpha, 0.2 * np.exp(v), rtol=1e-10)
    at_34 = bifurcation_diagram(REFERENCE, LOAD, (34.0 * RPM, 50.0 * RPM), 10)
    assert at_34.branches[1].amplitude[0] * 1e3 == pytest.approx(0.59272, abs=6e-6)


def test_regimes_follow_each_other_with_rising_speed(reference: Diagram) -> None:
    hopf, fold = reference.marks
    assert [span.regime for span in reference.spans] == [
        Regime.UNSTABLE,
        Regime.BISTABLE,
        Regime.STABLE,
    ]
    assert [span.low for span in reference.spans] == [0.0, hopf.speed, fold.speed]
    assert reference.spans[-1].high == diagram_speeds(REFERENCE, LOAD)[1]
    inside = reference.speed < hopf.speed
    assert np.all(reference.growth_rate[inside] > 0.0)
    assert np.all(reference.growth_rate[reference.speed > hopf.speed] < 0.0)


@pytest.mark.slow
def test_every_cycle_of_a_measured_table_is_stationary(table: Diagram) -> None:
    own = bearing(TABLE)
    scale = own.damping / (2.0 * own.mass)
    # At a mark two solvers' roundings meet under a square root; everywhere else it is exact.
    marks = np.array([mark.speed for mark in table.marks])
    usual = ~np.isin(table.speed, marks)
    for branch in table.branches:
        known = usual & np.isfinite(branch.amplitude)
        amplitude = branch.amplitude[known]
        rate = amplitude_rate(own, table.speed[known], LOAD, amplitude)
        assert np.max(np.abs(rate) / (scale * amplitude), initial=0.0) < 1e-6
        step = 1e-6 * amplitude
        beyond = amplitude_rate(own, table.speed[known], LOAD, amplitude + step)
        assert np.all((beyond < rate) == branch.stable)


def test_a_table_with_several_hopf_speeds_has_them_all(table: Diagram) -> None:
    slope = lambda v: -LOAD * float(TABLE.slope(v)) - 400.0  # noqa: E731
    grid = np.linspace(0.0101, 0.3399, 4000)
    signs = np.sign([slope(v) for v in grid])
    roots = [brentq(slope, grid[i], grid[i + 1]) for i in np.flatnonzero(np.diff(signs))]
    found = [mark.speed for mark in table.marks if mark.kind is MarkKind.HOPF]
    # The first one is the jump of the slope at the slowest measured speed.
    assert found[0] == pytest.approx(0.01, rel=1e-9)
    np.testing.assert_allclose(found[1:], roots, rtol=1e-9)


def test_each_branch_of_a_table_is_one_unbroken_curve(table: Diagram) -> None:
    ends = 0
    for branch in table.branches:
        known = np.flatnonzero(np.isfinite(branch.amplitude))
        assert known.size == known[-1] - known[0] + 1
        for i, outer in (
            (known[0], known[0] == 0),
            (known[-1], known[-1] == table.speed.size - 1),
        ):
            at_mark = [
                m
                for m in table.marks
                if m.speed == table.speed[i] and m.amplitude == branch.amplitude[i]
            ]
            assert outer or at_mark
            ends += bool(at_mark)
    folds = sum(mark.kind is MarkKind.FOLD for mark in table.marks)
    assert ends == 2 * folds + (len(table.marks) - folds)


@pytest.mark.parametrize(
    'own',
    [
        bearing(Coulomb(0.3, 0.1)),
        bearing(Stribeck(0.1, 0.3, 10.0)),
        bearing(Stribeck(0.3, 0.1, 10.0), damping=3000.0),
    ],
    ids=['coulomb', 'rising', 'damped'],
)
def test_without_stick_slip_only_the_equilibrium_is_left(own: Bearing) -> None:
    diagram = diagram_of(own)
    assert diagram.branches == diagram.marks == ()
    assert [span.regime for span in diagram.spans] == [Regime.STABLE]
    columns = diagram_columns(own, diagram)
    assert np.isnan(columns['stick_slip_amplitude [m]']).all()


def test_without_damping_the_cycle_never_ends() -> None:
    diagram = diagram_of(bearing(Stribeck(0.3, 0.1, 10.0), damping=0.0))
    assert diagram.marks == ()
    assert [branch.stable for branch in diagram.branches] == [True]
    assert np.isfinite(diagram.branches[0].amplitude).all()


def test_a_range_inside_one_regime_has_no_marks() -> None:
    diagram = bifurcation_diagram(REFERENCE, LOAD, (5.0 * RPM, 25.0 * RPM), 50)
    assert diagram.marks == ()
    assert (diagram.speed[0], diagram.speed[-1]) == (5.0 * RPM, 25.0 * RPM)


def test_default_speeds_have_both_boundaries_inside() -> None:
    low, high = diagram_speeds(REFERENCE, LOAD)
    assert low == 0.0
    assert high / RPM == pytest.approx(1.25 * 40.7231, rel=1e-5)
