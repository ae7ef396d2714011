# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import csv
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from shared import ROOT, Stickslip

from stickslip_monitor import Stribeck
from stickslip_monitor.monitor.parameter_file import load_config, load_yaml

CONFIG = str(ROOT / 'launch_configs' / 'reference_bearing.yaml')
CURVE = str(ROOT / 'launch_configs' / 'examples' / 'friction_curve.csv')
LOAD = ('--config', CONFIG, '--load', '1000N')
LAW = Stribeck(0.3, 0.1, 10.0)
PAGE = ROOT / 'docs' / 'fit.md'


def write_curve(path: Path, speed: Any, coefficient: Any, heading: str = 'speed [m/s],mu') -> str:
    rows = [f'{float(v)!r},{float(mu)!r}' for v, mu in zip(speed, coefficient, strict=True)]
    path.write_text('\n'.join([heading, *rows]) + '\n', encoding='utf-8')
    return str(path)


def test_json_of_the_example(stickslip: Stickslip) -> None:
    document = stickslip('fit', '--json', CURVE, *LOAD, '--speed', '38rpm').json
    assert document['schema'] == 'stickslip_monitor/fit/2'
    assert [item['line'] for item in document['outliers'] if item['weight'] < 0.1] == [12, 21, 26]
    for name in ('static', 'kinetic', 'decay'):
        low, high = document['interval'][name]
        assert low < getattr(LAW, name) < high
        assert low < document['friction'][name] < high
    (bearing,) = document['bearings']
    assert bearing['bearing'] == 'aft_stern'
    assert bearing['load'] == 1000.0
    # PHYSICS: Hopf 0.1609 m/s and fold 0.2132 m/s for the law that the example was made with.
    for name, true in (('hopf_speed', 0.1609438), ('fold_speed', 0.2132256)):
        low, _, high = bearing[name]
        assert low < true < high
    assert sum(bearing['regimes'].values()) == pytest.approx(1.0)
    assert bearing['regimes']['bistable'] > 0.9


def test_tables_for_a_person(stickslip: Stickslip) -> None:
    done = stickslip('fit', CURVE, *LOAD, '--speed', '45rpm')
    assert done.code == 0
    text = done.out
    for words in (
        '26 points, speeds in rpm (the heading)',
        'correlation: static-kinetic',
        'no viscous slope (slope',
        'rule: slope > 0 and p < 0.01',
        'line 12: 0.2444 at 0.0733 m/s',
        'aft_stern with this law at 1000N',
        'fold speed',
        'probability at 45rpm: unstable 0.0%',
        'friction: {law: stribeck, static: 0.29',
    ):
        assert words in text


@pytest.mark.parametrize('viscous', ['no', 'yes'])
def test_the_fragment_is_a_configuration(viscous: str, tmp_path: Path, stickslip: Stickslip) -> None:
    """Pasted in place of the bearing's law, it configures the law that was fitted."""
    speed = np.linspace(0.0, 0.5, 41)
    law = Stribeck(0.3, 0.1, 10.0, 0.1 if viscous == 'yes' else 0.0)
    noise = 1e-3 * np.random.default_rng(0).standard_normal(41)
    mu = law.coefficient(speed) + noise
    path = tmp_path / 'part.yaml'
    arguments = [write_curve(tmp_path / 'c.csv', speed, mu, 'v,mu'), '--viscous', viscous]
    done = stickslip('fit', *arguments, '--fragment', path, '--json')
    assert done.code == 0
    document = done.json
    assert path.read_text(encoding='utf-8') == document['fragment']
    assert load_yaml(path)['friction']['law'] == 'stribeck'
    config = Path(CONFIG).read_text(encoding='utf-8')
    part = path.read_text(encoding='utf-8').replace('\n', '\n      ')
    merged = re.sub(r'friction: .*', lambda _: part, config)
    ship = tmp_path / 'ship.yaml'
    ship.write_text(merged, encoding='utf-8')
    fitted = load_config(ship).bearings[0].bearing.friction
    assert isinstance(fitted, Stribeck)
    for name in ('static', 'kinetic', 'decay', 'viscous'):
        assert getattr(fitted, name) == pytest.approx(document['friction'][name], rel=1e-5)


def test_the_picture_shows_the_boundaries(tmp_path: Path, stickslip: Stickslip) -> None:
    path = tmp_path / 'a.svg'
    assert stickslip('fit', CURVE, *LOAD, '--picture', path).code == 0
    assert 'fold speed' in path.read_text(encoding='utf-8')


def test_points_as_csv(tmp_path: Path, stickslip: Stickslip) -> None:
    path = tmp_path / 'points.csv'
    assert stickslip('fit', CURVE, '--journal-diameter', '0.1', '-o', path).code == 0
    with path.open(encoding='utf-8', newline='') as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 26
    for row in rows:
        total = float(row['fitted']) + float(row['residual'])
        assert total == pytest.approx(float(row['coefficient']), abs=1e-12)
    assert [row['line'] for row in rows if float(row['weight']) < 0.1] == ['12', '21', '26']


def test_a_warning_is_exit_code_1(tmp_path: Path, stickslip: Stickslip) -> None:
    speed = np.linspace(0.2, 0.8, 30)
    path = write_curve(tmp_path / 'late.csv', speed, LAW.coefficient(speed))
    done = stickslip('fit', path)
    assert done.code == 1
    assert 'warning: static is extrapolated' in done.out


def test_the_page_shows_what_the_command_prints(
    stickslip: Stickslip, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Compare the fragment and the spread in docs/fit.md with those of today's program."""
    monkeypatch.chdir(ROOT)
    page = PAGE.read_text(encoding='utf-8')
    document = stickslip('fit', '--json', 'launch_configs/examples/friction_curve.csv', *LOAD).json
    assert document['fragment'] in page
    for name, value in document['friction'].items():
        if name in document['estimated']:
            assert f'{value:.5g}' in page
