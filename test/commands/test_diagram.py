# SPDX-License-Identifier: Apache-2.0
"""``stickslip diagram``: its files, and what it says about bad input."""

from __future__ import annotations

import csv
import struct
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from stickslip_monitor import assess, fold_speed, hopf_speed
from stickslip_monitor.cli import main
from stickslip_monitor.monitor.config_file import load_config

CONFIG = str(Path(__file__).parents[2] / 'launch_configs' / 'reference_bearing.yaml')
BEARING = load_config(CONFIG).bearings[0].bearing
RPM = BEARING.speed.factor('rpm')


def run(out: Path | str, *more: str, load: str = '1000N') -> int:
    return main(['diagram', '-c', CONFIG, f'--load={load}', '-o', str(out), *more])


def read(path: Path) -> dict[str, list[str]]:
    with path.open(newline='') as file:
        head, *rows = csv.reader(file)
    return dict(zip(head, map(list, zip(*rows, strict=True)), strict=True))


def numbers(column: list[str]) -> np.ndarray:
    return np.array([float(cell) if cell else np.nan for cell in column])


def two_bearings(folder: Path) -> str:
    text = Path(CONFIG).read_text('utf-8')
    own = text[text.index('    aft_stern:') :]
    both = text.replace('[aft_stern]', '[aft_stern, forward]')
    path = folder / 'two.yaml'
    path.write_text(both + own.replace('aft_stern:', 'forward:', 1), 'utf-8')
    return str(path)


def test_png_is_valid_and_wide_enough(tmp_path: Path) -> None:
    pytest.importorskip('matplotlib')
    assert run(tmp_path / 'a.png') == 0
    data = (tmp_path / 'a.png').read_bytes()
    assert data[:8] == b'\x89PNG\r\n\x1a\n'
    assert struct.unpack('>II', data[16:24]) == (1800, 1120)


def test_svg_is_valid(tmp_path: Path) -> None:
    pytest.importorskip('matplotlib')
    assert run(tmp_path / 'a.SVG') == 0
    assert ElementTree.parse(tmp_path / 'a.SVG').getroot().tag.endswith('}svg')


def test_csv_agrees_with_the_assessment(tmp_path: Path) -> None:
    assert run(tmp_path / 'a.csv') == 0
    table = read(tmp_path / 'a.csv')
    assert list(table) == [
        'shaft_speed [rpm]',
        'surface_speed [m/s]',
        'load [N]',
        'regime',
        'growth_rate [1/s]',
        'sliding_limit [m]',
        'stick_slip_amplitude [m]',
        'threshold_amplitude [m]',
        'exact_amplitude [m]',
    ]
    speed = numbers(table['surface_speed [m/s]'])
    hopf, fold = hopf_speed(BEARING, 1000.0), fold_speed(BEARING, 1000.0)
    assert {hopf, fold} <= set(speed.tolist())
    point = assess(BEARING, speed, 1000.0)
    assert table['regime'] == point.regime.tolist()
    usual = (speed != hopf) & (speed != fold)
    for column, expected in (
        ('stick_slip_amplitude [m]', point.amplitude),
        ('threshold_amplitude [m]', point.threshold_amplitude),
        ('growth_rate [1/s]', point.growth_rate),
    ):
        np.testing.assert_allclose(numbers(table[column])[usual], expected[usual], rtol=1e-12)


def test_speeds_and_points_are_kept(tmp_path: Path) -> None:
    assert run(tmp_path / 'a.csv', '--speeds', '5rpm:25rpm', '--points', '21') == 0
    shaft = numbers(read(tmp_path / 'a.csv')['shaft_speed [rpm]'])
    np.testing.assert_allclose(np.intersect1d(shaft.round(9), np.arange(5, 26)), np.arange(5, 26))
    assert shaft[0] == pytest.approx(5.0)
    assert shaft[-1] == pytest.approx(25.0)


def test_one_of_several_bearings_is_chosen(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    config, out = two_bearings(tmp_path), str(tmp_path / 'a.csv')
    arguments = ['diagram', '-c', config, '--load', '1kN', '-o', out]
    assert main(arguments) == 2
    assert 'choose --bearing from aft_stern, forward' in capsys.readouterr().err
    assert main([*arguments, '--bearing', 'forward']) == 0


@pytest.mark.parametrize(
    ('out', 'load', 'more', 'text'),
    [
        ('a.pdf', '1kN', (), "output '{out}' must end in one of .png, .svg, .csv"),
        ('a', '1kN', (), "output '{out}' must end in one of .png, .svg, .csv"),
        ('a.csv', '0N', (), "load '0N' must be above 0"),
        ('a.csv', '-5N', (), "load '-5N' must be above 0"),
        ('a.csv', '1000', (), "load '1000' must be a number with a unit: one of N, kN"),
        ('a.csv', '1kN', ('--speeds', '5rpm'), "speeds '5rpm' must be LOW:HIGH"),
        ('a.csv', '1kN', ('--speeds', '5:9rpm'), "speeds '5' must be a number with a unit"),
        ('a.csv', '1kN', ('--speeds', '9rpm:9rpm'), "speeds '9rpm:9rpm' must rise"),
        ('a.csv', '1kN', ('--speeds=-1rpm:9rpm',), "speeds '-1rpm:9rpm' must rise"),
        ('a.csv', '1kN', ('--points', '1'), 'points = 1 must be from 10 to 100000'),
        ('a.csv', '1kN', ('--bearing', 'x'), "bearing 'x' is not configured; there are: aft"),
        ('no/a.csv', '1kN', (), "'{out}' cannot be written: there is no folder"),
    ],
)
def test_bad_input_is_named_with_its_rule(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    out: str,
    load: str,
    more: tuple[str, ...],
    text: str,
) -> None:
    path = tmp_path / out
    assert run(path, *more, load=load) == 2
    error = capsys.readouterr().err
    assert error.startswith('ERROR: ')
    assert text.format(out=path) in error
    assert not path.exists()


def test_the_output_is_required(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(['diagram', '-c', CONFIG, '--load', '1kN']) == 2
    assert '--output' in capsys.readouterr().err
