# SPDX-License-Identifier: Apache-2.0
"""Diagram and map of friction at its load and temperature: against laws written out for them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stickslip_monitor import Bearing, Stribeck, Tabulated, fold_speed, hopf_speed
from stickslip_monitor.drawing.diagram import bifurcation_diagram
from stickslip_monitor.drawing.map import boundaries, diagram_speeds, map_ranges
from stickslip_monitor.physics.lubrication import Lubrication, viscosity

PLAIN = Bearing(50.0, 400.0, 2.0e6, Stribeck(0.3, 0.1, 10.0), 0.1)
OWN = replace(PLAIN, lubrication=Lubrication(1000.0, 0.7, 15.0)).at_temperature(5.0)
LOAD = 3000.0
SCALE = 3.0**0.7 * viscosity(15.0) / viscosity(5.0)


def test_a_diagram_is_that_of_the_law_written_out() -> None:
    there = replace(PLAIN, friction=Stribeck(0.3, 0.1, 10.0 / SCALE))
    speeds = diagram_speeds(OWN, LOAD)
    assert speeds == pytest.approx(diagram_speeds(there, LOAD), rel=1e-12)
    found, expected = (bifurcation_diagram(each, LOAD, speeds, 40) for each in (OWN, there))
    assert [(m.kind, m.speed) for m in found.marks] == [
        (m.kind, pytest.approx(m.speed, rel=1e-12)) for m in expected.marks
    ]
    assert np.allclose(found.speed, expected.speed, rtol=1e-12)
    assert np.allclose(found.exact, expected.exact, rtol=1e-9, equal_nan=True)
    assert np.allclose(found.growth_rate, expected.growth_rate, rtol=1e-9, atol=1e-12)
    assert [s[2] for s in found.spans] == [s[2] for s in expected.spans]


@pytest.mark.parametrize('exponent', [0.7, 1.0])
def test_a_map_has_its_boundaries_where_the_speeds_say(exponent: float) -> None:
    own = replace(PLAIN, lubrication=Lubrication(1000.0, exponent))
    speeds, loads = map_ranges(own)
    assert loads[1] > 1000.0
    curves = boundaries(own, speeds, 0.2, 30)
    known = curves.fold_load[1:]
    inside = np.isfinite(known) & (known > 0.0)
    assert inside.any()
    assert np.allclose(fold_speed(own, known[inside]), curves.speed[1:][inside], rtol=1e-9)
    hopf = curves.hopf_load[1:]
    assert np.allclose(hopf_speed(own, hopf[inside]), curves.speed[1:][inside], rtol=1e-9)


def test_corners_of_a_table_lie_at_the_speeds_of_the_load() -> None:
    law = Tabulated([0.0, 0.1, 0.2, 0.5], [0.3, 0.2, 0.15, 0.1])
    own = replace(PLAIN, friction=law, lubrication=Lubrication(1000.0, 1.0))
    there = replace(PLAIN, friction=Tabulated([0.0, 0.3, 0.6, 1.5], law.values))
    found, expected = (bifurcation_diagram(each, LOAD, (0.0, 2.0), 40) for each in (own, there))
    assert [m.kind for m in found.marks] == [m.kind for m in expected.marks]
    speeds = [m.speed for m in expected.marks]
    assert [m.speed for m in found.marks] == pytest.approx(speeds, rel=1e-6)
