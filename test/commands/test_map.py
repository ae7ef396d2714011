# SPDX-License-Identifier: Apache-2.0
"""``stickslip map``: its files, a recorded track on it, and what it says about bad input."""

from __future__ import annotations

import csv
import struct
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from stickslip_monitor import fold_load, fold_speed, hopf_load
from stickslip_monitor.cli import main
from stickslip_monitor.monitor.config_file import load_config

ROOT = Path(__file__).parents[2]
CONFIG = str(ROOT / 'launch_configs' / 'reference_bearing.yaml')
BEARING = load_config(CONFIG).bearings[0].bearing


def run(out: Path, *more: str) -> int:
    return main(['map', '-c', CONFIG, '-o', str(out), *more])


def read(path: Path) -> dict[str, np.ndarray]:
    with path.open(newline='') as file:
        head, *rows = csv.reader(file)
    table = np.array([[float(cell) if cell else np.nan for cell in row] for row in rows])
    return dict(zip(head, table.T, strict=True))


def test_png_is_valid_and_wide_enough(tmp_path: Path) -> None:
    pytest.importorskip('matplotlib')
    assert run(tmp_path / 'a.png', '--speeds', '0rpm:60rpm', '--loads', '0N:12kN') == 0
    data = (tmp_path / 'a.png').read_bytes()
    assert data[:8] == b'\x89PNG\r\n\x1a\n'
    assert struct.unpack('>II', data[16:24]) == (1800, 1120)


def test_svg_is_valid(tmp_path: Path) -> None:
    pytest.importorskip('matplotlib')
    assert run(tmp_path / 'a.svg') == 0
    assert ElementTree.parse(tmp_path / 'a.svg').getroot().tag.endswith('}svg')


def test_csv_agrees_with_the_physics(tmp_path: Path) -> None:
    assert run(tmp_path / 'a.csv', '--loads', '0N:2000N') == 0
    table = read(tmp_path / 'a.csv')
    assert list(table)[:5] == [
        'shaft_speed [rpm]',
        'surface_speed [m/s]',
        'fold_load [N]',
        'hopf_load [N]',
        'caution_load [N]',
    ]
    speed = table['surface_speed [m/s]']
    np.testing.assert_array_equal(table['fold_load [N]'], fold_load(BEARING, speed))
    np.testing.assert_array_equal(table['hopf_load [N]'], hopf_load(BEARING, speed))
    margin = speed[1:] / fold_speed(BEARING, table['caution_load [N]'][1:]) - 1.0
    np.testing.assert_allclose(margin, 0.1, rtol=1e-5)


def test_a_recorded_track_is_drawn(tmp_path: Path) -> None:
    pytest.importorskip('matplotlib')
    bag = str(ROOT / 'bags' / 'coast_down')
    assert run(tmp_path / 'a.svg', '--track', bag) == 0
    assert run(tmp_path / 'b.svg') == 0
    sizes = [(tmp_path / name).stat().st_size for name in ('a.svg', 'b.svg')]
    assert sizes[0] > sizes[1]


@pytest.mark.parametrize(
    ('out', 'more', 'text'),
    [
        ('a.jpeg', (), "output '{out}' must end in one of .png, .svg, .csv"),
        ('a.csv', ('--loads', '2kN'), "loads '2kN' must be LOW:HIGH, each with its unit"),
        ('a.csv', ('--loads', '2kN:1kN'), "loads '2kN:1kN' must rise from its first value"),
        ('a.csv', ('--loads', '1rpm:2kN'), "loads '1rpm' must be a number with a unit"),
        ('a.csv', ('--speeds', '1N:2rpm'), "speeds '1N' must be a number with a unit"),
        ('a.csv', ('--track', 'x'), "track 'x' is for pictures: write a .png or .svg"),
        ('a.png', ('--track', '/nowhere/bag'), '/nowhere/bag'),
    ],
)
def test_bad_input_is_named_with_its_rule(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    out: str,
    more: tuple[str, ...],
    text: str,
) -> None:
    path = tmp_path / out
    assert run(path, *more) == 2
    error = capsys.readouterr().err
    assert error.startswith('ERROR: ')
    assert text.format(out=path) in error
    assert not path.exists()
