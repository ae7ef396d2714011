# SPDX-License-Identifier: Apache-2.0
"""Diagram and map of friction at its load and temperature: against laws written out for them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from shared import CONFIG, REFERENCE_BEARING

from stickslip_monitor import Stribeck, Tabulated, hopf_speed
from stickslip_monitor.drawing.diagram import bifurcation_diagram, draw_diagram
from stickslip_monitor.drawing.map import boundaries, diagram_speeds, draw_map, map_ranges
from stickslip_monitor.monitor.parameter_file import load_config
from stickslip_monitor.physics.cycles import end_of_vibration
from stickslip_monitor.physics.lubrication import Lubrication, viscosity

OWN = replace(REFERENCE_BEARING, lubrication=Lubrication(1000.0, 0.7, 15.0)).at_temperature(5.0)
LOAD = 3000.0
SCALE = 3.0**0.7 * viscosity(15.0) / viscosity(5.0)


def test_a_diagram_is_that_of_the_law_written_out() -> None:
    equivalent = replace(REFERENCE_BEARING, friction=Stribeck(0.3, 0.1, 10.0 / SCALE))
    speeds = diagram_speeds(OWN, LOAD)
    assert speeds == pytest.approx(diagram_speeds(equivalent, LOAD), rel=1e-12)
    diagram, expected = (bifurcation_diagram(bearing, LOAD, speeds, 40) for bearing in (OWN, equivalent))
    assert [(m.kind, m.speed) for m in diagram.marks] == [
        (m.kind, pytest.approx(m.speed, rel=1e-12)) for m in expected.marks
    ]
    assert np.allclose(diagram.speed, expected.speed, rtol=1e-12)
    assert np.allclose(diagram.exact, expected.exact, rtol=1e-9, equal_nan=True)
    assert np.allclose(diagram.growth_rate, expected.growth_rate, rtol=1e-9, atol=1e-12)
    assert [s[2] for s in diagram.spans] == [s[2] for s in expected.spans]


def test_map_and_diagram_name_the_water_of_the_configuration() -> None:
    config = replace(load_config(CONFIG).bearings[0], bearing=OWN)
    (title,) = [text.get_text() for text in draw_map(config).texts if 'water' in text.get_text()]
    assert title == f'{config.name}, water 5 C'
    notes = [text.get_text() for text in draw_diagram(config, LOAD, points=20).texts]
    assert f'{config.name}, load 3 kN, water 5 C' in notes


@pytest.mark.parametrize('exponent', [0.7, 1.0])
def test_a_map_has_its_boundaries_where_the_speeds_say(exponent: float) -> None:
    lubricated = replace(REFERENCE_BEARING, lubrication=Lubrication(1000.0, exponent))
    speeds, loads = map_ranges(lubricated)
    assert loads[1] > 1000.0
    curves = boundaries(lubricated, speeds, 0.2, 30)
    fold_load = curves.fold_load[1:]
    inside = np.isfinite(fold_load) & (fold_load > 0.0)
    assert inside.any()
    assert np.allclose(end_of_vibration(lubricated, fold_load[inside]), curves.speed[1:][inside], rtol=1e-6)
    hopf = curves.hopf_load[1:]
    assert np.allclose(hopf_speed(lubricated, hopf[inside]), curves.speed[1:][inside], rtol=1e-9)


def test_corners_of_a_table_lie_at_the_speeds_of_the_load() -> None:
    law = Tabulated([0.0, 0.1, 0.2, 0.5], [0.3, 0.2, 0.15, 0.1])
    lubricated = replace(REFERENCE_BEARING, friction=law, lubrication=Lubrication(1000.0, 1.0))
    equivalent = replace(REFERENCE_BEARING, friction=Tabulated([0.0, 0.3, 0.6, 1.5], law.values))
    diagram, expected = (
        bifurcation_diagram(bearing, LOAD, (0.0, 2.0), 40) for bearing in (lubricated, equivalent)
    )
    assert [m.kind for m in diagram.marks] == [m.kind for m in expected.marks]
    speeds = [m.speed for m in expected.marks]
    assert [m.speed for m in diagram.marks] == pytest.approx(speeds, rel=1e-6)
