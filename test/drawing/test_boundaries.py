# SPDX-License-Identifier: Apache-2.0
"""The map's curves against closed forms and against the assessment on both of their sides."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.special import i1e

from stickslip_monitor import Bearing, Coulomb, FrictionLaw, Stribeck, Tabulated, assess
from stickslip_monitor.drawing.map_curves import (
    boundaries,
    caution_load,
    map_loads,
    map_speeds,
    onset_load,
)

RPM = math.pi * 0.1 / 60.0
REFERENCE = Bearing(50.0, 400.0, 2.0e6, Stribeck(0.3, 0.1, 10.0), 0.1)
TABLE = Bearing(
    50.0,
    400.0,
    2.0e6,
    Tabulated([0.01, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4], [0.3, 0.2, 0.19, 0.19, 0.15, 0.1, 0.11]),
    0.1,
)


def test_boundaries_are_the_closed_forms() -> None:
    curves = boundaries(REFERENCE, (0.01, 0.4), 0.1, 60)
    v = 10.0 * curves.speed
    np.testing.assert_allclose(curves.hopf_load, 400.0 * np.exp(v) / (0.2 * 10.0), rtol=1e-12)
    np.testing.assert_allclose(curves.fold_load, 400.0 / (2.0 * 2.0 * i1e(v) / v), rtol=1e-12)
    slower = v / 1.1
    np.testing.assert_allclose(
        curves.caution_load, 400.0 / (2.0 * 2.0 * i1e(slower) / slower), rtol=1e-12
    )


def test_the_published_load_is_where_the_cycle_dies_at_20_rpm() -> None:
    curves = boundaries(REFERENCE, (20.0 * RPM, 40.0 * RPM), 0.1, 10)
    assert curves.fold_load[0] == pytest.approx(498.0, abs=0.5)


@pytest.mark.parametrize('own', [REFERENCE, TABLE], ids=['stribeck', 'table'])
def test_the_assessment_changes_across_each_curve(own: Bearing) -> None:
    curves = boundaries(own, (0.02, 0.3), 0.1, 12)
    for line, crossed in (
        (curves.fold_load, lambda point: np.isfinite(point.amplitude)),
        (curves.hopf_load, lambda point: point.growth_rate > 0.0),
    ):
        known = np.isfinite(line)
        speed, load = curves.speed[known][::5], line[known][::5]
        assert crossed(assess(own, speed, load * (1.0 + 1e-4))).all()
        assert not crossed(assess(own, speed, load * (1.0 - 1e-4))).any()


@pytest.mark.parametrize('own', [REFERENCE, TABLE], ids=['stribeck', 'table'])
@pytest.mark.parametrize('margin', [0.0, 0.1])
def test_the_fold_margin_falls_below_the_caution_margin_across_its_curve(
    own: Bearing, margin: float
) -> None:
    speed = np.linspace(0.005, 0.3, 300)
    load = caution_load(own, speed, margin)
    known = np.isfinite(load)
    # A minimum of the fold between two points of the grid is found to the grid's width only.
    speed, load = speed[known][::12], load[known][::12]
    above, below = assess(own, speed, load * 1.001), assess(own, speed, load * 0.99)
    assert np.all(above.fold_margin < margin)
    assert np.all(below.fold_margin >= margin)


def test_without_stick_slip_there_are_no_curves() -> None:
    own = Bearing(50.0, 400.0, 2.0e6, Coulomb(0.3, 0.1), 0.1)
    loads = map_loads(own)
    curves = boundaries(own, map_speeds(own, loads[1]), 0.1, 20)
    assert math.isnan(onset_load(own))
    for line in (curves.fold_load, curves.hopf_load, curves.caution_load):
        assert np.isnan(line).all()


def test_default_ranges_show_the_boundaries_and_what_was_measured() -> None:
    assert onset_load(REFERENCE) == pytest.approx(200.0, rel=1e-9)
    assert map_loads(REFERENCE) == (0.0, pytest.approx(2000.0, rel=1e-9))
    assert map_loads(REFERENCE, 1100.0) == (0.0, 1375.0)
    assert map_speeds(REFERENCE, 1000.0)[1] / RPM == pytest.approx(1.25 * 40.7231, rel=1e-5)
    assert map_speeds(REFERENCE, 1000.0, 2.0)[1] == pytest.approx(2.1)


@pytest.mark.parametrize(
    ('law', 'end'),
    # The averaged fold in closed form; and dry friction, of which only the exact model has one:
    # the damped oscillation from break-away just meets the belt's speed again, by brentq.
    [(Stribeck(0.3, 0.1, 10.0), 40.7231), (Coulomb(0.3, 0.1), 7.193599)],
    ids=['stribeck', 'coulomb'],
)
def test_a_map_shows_the_way_out_of_stick_slip(law: FrictionLaw, end: float) -> None:
    own = Bearing(50.0, 400.0, 2.0e6, law, 0.1)
    low, high = map_speeds(own, 1000.0, 4.0 * RPM)
    assert (low, high / RPM) == (0.0, pytest.approx(1.25 * end, rel=1e-4))
