# SPDX-License-Identifier: Apache-2.0
"""The bifurcation diagram against closed forms, published numbers and the averaged equation."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import i1, i1e
from shared import CONFIG as REFERENCE_FILE
from shared import REFERENCE_BEARING, bearing_of

from stickslip_monitor import Bearing, Coulomb, Regime, Stribeck, Tabulated, amplitude_rate
from stickslip_monitor.drawing.diagram import Diagram, bifurcation_diagram, diagram_columns, draw_diagram
from stickslip_monitor.drawing.map import diagram_speeds
from stickslip_monitor.monitor.parameter_file import load_config
from stickslip_monitor.monitor.parameters import BearingConfig

pytest.importorskip('matplotlib')
LOAD = 1000.0
TABLE = Tabulated([0.01, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4], [0.3, 0.2, 0.19, 0.19, 0.15, 0.1, 0.11])
CONFIG = load_config(REFERENCE_FILE)


def diagram_of(bearing: Bearing) -> Diagram:
    return bifurcation_diagram(bearing, LOAD, diagram_speeds(bearing, LOAD), 200)


@pytest.fixture(scope='module')
def reference() -> Diagram:
    return diagram_of(REFERENCE_BEARING)


def test_branches_end_exactly_at_hopf_and_fold(reference: Diagram) -> None:
    kappa = 400.0 / (LOAD * 0.2 * 10.0)
    hopf, fold = reference.marks
    assert (hopf.kind, fold.kind) == ('Hopf', 'fold')
    assert hopf.speed == pytest.approx(-math.log(kappa) / 10.0, rel=1e-14)
    v = brentq(lambda x: 2.0 * i1e(x) / x - kappa, 1.0, 4.0, xtol=1e-15)
    assert fold.speed == pytest.approx(v / 10.0, rel=1e-13)
    stable, threshold = reference.branches
    at_hopf, at_fold = np.searchsorted(reference.speed, [hopf.speed, fold.speed])
    assert (stable.stable, threshold.stable) == (True, False)
    # The unstable branch meets the stable one on the sliding limit a = V.
    assert stable.amplitude[at_fold] == threshold.amplitude[at_fold] == fold.speed / 200.0
    assert threshold.amplitude[at_hopf] == 0.0
    for branch, first in ((stable, 0), (threshold, at_hopf)):
        finite = np.flatnonzero(np.isfinite(branch.amplitude))
        assert finite.tolist() == list(range(first, at_fold + 1))
    # The exact end of vibration decides, up to which the exact branch is drawn.
    end = pytest.approx(reference.exact_fold, rel=2e-9)
    assert reference.spans == (
        (0.0, hopf.speed, Regime.UNSTABLE),
        (hopf.speed, end, Regime.BISTABLE),
        (end, diagram_speeds(REFERENCE_BEARING, LOAD)[1], Regime.STABLE),
    )
    growing, slower = reference.growth_rate > 0.0, reference.speed < hopf.speed
    usual = reference.speed != hopf.speed
    assert growing[usual].tolist() == slower[usual].tolist()


def test_threshold_amplitude_solves_its_closed_form(reference: Diagram) -> None:
    threshold = reference.branches[1].amplitude
    inside = (threshold > 0.0) & (reference.speed < reference.marks[1].speed)
    alpha, v = 10.0 * 200.0 * threshold[inside], 10.0 * reference.speed[inside]
    np.testing.assert_allclose(2.0 * i1(alpha) / alpha, 0.2 * np.exp(v), rtol=1e-10)


@pytest.mark.slow
def test_a_measured_table_has_all_its_branches() -> None:
    # Each is one unbroken curve of stationary cycles between Hopf, fold and the range's ends.
    bearing = bearing_of(TABLE)
    table = diagram_of(bearing)
    grid = np.linspace(0.0101, 0.3399, 4000)
    growth = [-LOAD * float(TABLE.slope(v)) - 400.0 for v in grid]
    roots = [
        brentq(lambda v: -LOAD * float(TABLE.slope(v)) - 400.0, grid[i], grid[i + 1])
        for i in np.flatnonzero(np.diff(np.sign(growth)))
    ]
    # The first one is the jump of the slope at the slowest measured speed.
    hopf = [mark.speed for mark in table.marks if mark.kind == 'Hopf']
    np.testing.assert_allclose(hopf, [0.01, *roots], rtol=1e-9)
    marks = {(mark.speed, mark.amplitude) for mark in table.marks}
    ends, last = 0, table.speed.size - 1
    for branch in table.branches:
        finite = np.flatnonzero(np.isfinite(branch.amplitude))
        assert finite.size == finite[-1] - finite[0] + 1
        for i, edge in ((finite[0], 0), (finite[-1], last)):
            at_mark = (table.speed[i], branch.amplitude[i]) in marks
            assert at_mark or i == edge
            ends += at_mark
        # At a mark two solvers' roundings meet under a square root; elsewhere it is exact.
        own_rows = finite[~np.isin(table.speed[finite], [mark.speed for mark in table.marks])]
        speed, amplitude = table.speed[own_rows], branch.amplitude[own_rows]
        rate = amplitude_rate(bearing, speed, LOAD, amplitude)
        assert np.max(np.abs(rate) / (4.0 * amplitude), initial=0.0) < 1e-6
        beyond = amplitude_rate(bearing, speed, LOAD, amplitude * (1.0 + 1e-6))
        assert np.all((beyond < rate) == branch.stable)
    assert ends == 2 * (len(table.marks) - len(hopf)) + len(hopf)


@pytest.mark.parametrize(
    ('bearing', 'regimes'),
    [
        # Of dry friction only the exact model has a cycle.
        (bearing_of(Coulomb(0.3, 0.1)), [Regime.BISTABLE, Regime.STABLE]),
        (bearing_of(Stribeck(0.1, 0.3, 10.0)), [Regime.STABLE]),
        (bearing_of(Stribeck(0.3, 0.1, 10.0), damping=3000.0), [Regime.STABLE]),
    ],
    ids=['coulomb', 'rising', 'damped'],
)
def test_without_an_averaged_cycle_there_are_no_branches(bearing: Bearing, regimes: list[Regime]) -> None:
    diagram = diagram_of(bearing)
    assert diagram.branches == diagram.marks == ()
    assert [regime for *_, regime in diagram.spans] == regimes
    columns = diagram_columns(bearing, diagram)
    assert np.isnan(columns['stick_slip_amplitude [m]']).all()


def test_a_branch_between_two_speeds_of_the_diagram_is_found() -> None:
    """Draw a Hopf with a fold 0.003 rpm above it, with two small cycles between them."""
    table = Tabulated([0.1324560, 0.2096268, 0.2281960, 0.4458427], [0.24518, 0.12219, 0.05504, 0.05496])
    bearing, load = bearing_of(table, damping=62.65981), 337.7896
    diagram = bifurcation_diagram(bearing, load, (0.1, 0.2), 3)
    hopf, fold = diagram.marks[:2]
    assert (hopf.kind, fold.kind) == ('Hopf', 'fold')
    assert 0.0 < fold.speed - hopf.speed < 2e-5
    rates = amplitude_rate(bearing, 0.5 * (hopf.speed + fold.speed), load, np.geomspace(1e-6, 5e-5, 400))
    assert np.count_nonzero(np.diff(np.sign(rates))) == 2
    below, above = (
        amplitude_rate(bearing, v, load, np.geomspace(1e-6, 5e-5, 400))
        for v in (hopf.speed - 1e-5, fold.speed + 1e-5)
    )
    assert [np.count_nonzero(np.diff(np.sign(r))) for r in (below, above)] == [1, 0]
    at = np.searchsorted(diagram.speed, [hopf.speed, fold.speed])
    (small,) = [b for b in diagram.branches if b.amplitude[at[0]] == 0.0]
    assert small.amplitude[at[1]] == fold.amplitude < 5e-5


def with_law(law: object) -> BearingConfig:
    return replace(CONFIG.bearings[0], bearing=bearing_of(law))


def legend_texts(figure: Any) -> list[str]:
    return [text.get_text() for legend in figure.legends for text in legend.get_texts()]


def test_the_picture_names_its_curves_and_says_where_hopf_and_fold_are() -> None:
    figure = draw_diagram(CONFIG.bearings[0], LOAD, points=100)
    assert legend_texts(figure) == [
        'stick-slip, exact',
        'stick-slip, averaging',
        'threshold (unstable), averaging',
        'steady sliding, unstable',
        'steady sliding',
        'sliding limit a = V',
        'Hopf 30.74 rpm',
        # The exact fold of this bearing lies 8e-6 off that of averaging.
        'KBM fold 40.72 rpm, sticks up to 40.72 rpm',
    ]
    axes = figure.axes[0]
    assert [t.get_text() for t in axes.texts] == ['unstable', 'bistable', 'stable']
    assert axes.child_axes[0].get_xlabel() == 'surface speed [m/s]'
    # At 20 rpm and 1000 N: 0.556755 mm, and by averaging 0.52688 mm (physics.md).
    lines = {line.get_label(): line for line in axes.lines}
    for name, expected in (('exact', 0.556755), ('averaging', 0.52688)):
        x, y = (np.asarray(column, float) for column in lines[f'stick-slip, {name}'].get_data())
        finite = np.isfinite(y)
        assert np.interp(20.0, x[finite], y[finite]) == pytest.approx(expected, rel=1e-3)
    assert max(lines['steady sliding, unstable'].get_xdata()) == pytest.approx(30.738, abs=1e-3)


def test_a_fold_that_averaging_does_not_have_is_marked() -> None:
    names = legend_texts(draw_diagram(with_law(Coulomb(0.3, 0.1)), LOAD, points=60))
    assert names[-1] == 'end of sticking 7.194 rpm (averaging has no fold)'


def test_of_several_branches_alike_the_legend_names_one() -> None:
    figure = draw_diagram(with_law(TABLE), LOAD, points=20)
    labels = [line.get_label() for line in figure.axes[0].lines]
    assert len(labels) > len(set(labels))
    names = legend_texts(figure)
    assert len(names) == len(set(names))


def test_an_empty_picture_says_why() -> None:
    figure = draw_diagram(with_law(Coulomb(0.1, 0.1)), LOAD, points=20)
    text = ' '.join(text.get_text() for text in figure.axes[0].texts)
    assert 'no speed has stick-slip.' in text.replace('\n', ' ')
