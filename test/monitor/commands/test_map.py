# SPDX-License-Identifier: Apache-2.0
"""``stickslip map`` and ``stickslip diagram``: their files, and what they say about bad input."""

from __future__ import annotations

import csv
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from shared import ROOT, png_size

from stickslip_monitor import assess, fold_speed, hopf_load, hopf_speed
from stickslip_monitor.cli import main
from stickslip_monitor.monitor.parameter_file import load_config
from stickslip_monitor.physics.cycles import end_of_vibration

CONFIG = str(ROOT / 'launch_configs' / 'reference_bearing.yaml')
BEARING = load_config(CONFIG).bearings[0].bearing
DIAGRAM = ('diagram', '--load=1kN')


def draw_to(command: tuple[str, ...], out: Path, *more: object) -> int:
    return main([*command, '-c', CONFIG, '-o', str(out), *map(str, more)])


def read_csv(path: Path) -> dict[str, np.ndarray]:
    with path.open(newline='') as file:
        head, *rows = csv.reader(file)
    columns = dict(zip(head, zip(*rows, strict=True), strict=True))
    return {
        name: np.array(cells if name == 'regime' else [float(cell or 'nan') for cell in cells])
        for name, cells in columns.items()
    }


@pytest.mark.parametrize('command', [('map', '--loads', '0N:12kN'), DIAGRAM], ids=lambda c: c[0])
def test_pictures_are_valid_and_wide_enough(command: tuple[str, ...], tmp_path: Path) -> None:
    pytest.importorskip('matplotlib')
    assert draw_to(command, tmp_path / 'a.png') == 0
    assert png_size(tmp_path / 'a.png') == (1800, 1120)
    assert draw_to(command, tmp_path / 'a.SVG') == 0
    assert ElementTree.parse(tmp_path / 'a.SVG').getroot().tag.endswith('}svg')


def test_the_table_of_a_map_agrees_with_the_physics(tmp_path: Path) -> None:
    assert draw_to(('map',), tmp_path / 'a.csv', '--loads', '0N:2000N') == 0
    table = read_csv(tmp_path / 'a.csv')
    assert list(table) == [
        'shaft_speed [rpm]',
        'surface_speed [m/s]',
        'fold_load [N]',
        'hopf_load [N]',
        'caution_load [N]',
    ]
    speed = table['surface_speed [m/s]']
    np.testing.assert_allclose(end_of_vibration(BEARING, table['fold_load [N]'][1:]), speed[1:], rtol=1e-7)
    np.testing.assert_array_equal(table['hopf_load [N]'], hopf_load(BEARING, speed))
    margin = speed[1:] / end_of_vibration(BEARING, table['caution_load [N]'][1:]) - 1.0
    np.testing.assert_allclose(margin, 0.1, rtol=1e-5)


def test_the_table_of_a_diagram_agrees_with_the_assessment(tmp_path: Path) -> None:
    assert draw_to(DIAGRAM, tmp_path / 'a.csv', '--speeds', '5rpm:45rpm', '--points', '41') == 0
    table = read_csv(tmp_path / 'a.csv')
    speed = table['surface_speed [m/s]']
    hopf, fold = hopf_speed(BEARING, 1000.0), fold_speed(BEARING, 1000.0)
    assert {hopf, fold} <= set(speed.tolist())
    assert set(range(5, 46)) <= set(table['shaft_speed [rpm]'].round(9).tolist())
    point = assess(BEARING, speed, 1000.0)
    assert table['regime'].tolist() == [str(regime) for regime in point.regime]
    usual = (speed != hopf) & (speed != fold)
    for column, expected in (
        ('stick_slip_amplitude [m]', point.amplitude),
        ('threshold_amplitude [m]', point.threshold_amplitude),
        ('growth_rate [1/s]', point.growth_rate),
        ('exact_amplitude [m]', point.amplitude_exact),
    ):
        np.testing.assert_allclose(table[column][usual], expected[usual], rtol=1e-12)


def test_a_recorded_track_is_drawn(tmp_path: Path) -> None:
    pytest.importorskip('matplotlib')
    bag = str(ROOT / 'bags' / 'coast_down')
    assert draw_to(('map',), tmp_path / 'a.svg', '--track', bag) == 0
    assert draw_to(('map',), tmp_path / 'b.svg') == 0
    sizes = [(tmp_path / name).stat().st_size for name in ('a.svg', 'b.svg')]
    assert sizes[0] > sizes[1]
