# SPDX-License-Identifier: Apache-2.0
"""``stickslip figures``: its files, and what it says about bad input."""

from __future__ import annotations

import csv
import functools
import itertools
import struct
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

from stickslip_monitor.cli import main
from stickslip_monitor.commands import figures
from stickslip_monitor.drawing.canvas import style
from stickslip_monitor.drawing.labels import Labeller
from stickslip_monitor.lab.findings.published import REFERENCE
from stickslip_monitor.monitor.config_file import load_config

CONFIG = str(Path(__file__).parents[2] / 'launch_configs' / 'reference_bearing.yaml')
NAMES = [
    'finding_1_speed',
    'finding_2_load',
    'finding_3_kinetic',
    'finding_4_motion',
    'finding_5_friction',
]
QUICK = ('finding_4_motion', 'finding_5_friction')


ALL = dict(figures.FINDINGS)


@functools.cache
def found(name: str, point: Any) -> Any:
    """A finding, computed once for all tests."""
    return ALL[name](point)


@pytest.fixture(scope='module')
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """All pictures and tables of the reference bearing, made once."""
    pytest.importorskip('matplotlib')
    folder = tmp_path_factory.mktemp('figures') / 'deep' / 'er'
    with pytest.MonkeyPatch.context() as patch:
        once = {name: functools.partial(found, name) for name in ALL}
        patch.setattr(figures, 'FINDINGS', once)
        assert main(['figures', '-o', str(folder)]) == 0
    return folder


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Only the findings that take no time."""
    few = {name: figures.FINDINGS[name] for name in QUICK}
    monkeypatch.setattr(figures, 'FINDINGS', few)


def read(path: Path) -> dict[str, np.ndarray]:
    with path.open(newline='') as file:
        head, *rows = csv.reader(file)
    cells = [[float(cell) if cell else np.nan for cell in row] for row in rows]
    return dict(zip(head, np.array(cells).T, strict=True))


def test_the_reference_bearing_is_that_of_the_docs() -> None:
    assert load_config(CONFIG).bearings[0].bearing == REFERENCE


@pytest.mark.slow
def test_there_is_one_picture_and_one_table_for_each_finding(written: Path) -> None:
    assert list(ALL) == NAMES
    expected = [f'{name}.{kind}' for name in NAMES for kind in ('csv', 'png')]
    assert sorted(path.name for path in written.iterdir()) == expected


@pytest.mark.parametrize('name', NAMES)
def test_pictures_are_valid_and_wide_enough(written: Path, name: str) -> None:
    data = (written / f'{name}.png').read_bytes()
    assert data[:8] == b'\x89PNG\r\n\x1a\n'
    assert struct.unpack('>II', data[16:24]) == (1800, 1320)


@pytest.mark.parametrize(
    ('name', 'headings'),
    [
        ('finding_1_speed', ['shaft_speed [rpm]', 'surface_speed [m/s]']),
        ('finding_2_load', ['load [N]']),
        ('finding_3_kinetic', ['kinetic_coefficient [-]']),
    ],
)
def test_tables_of_amplitudes(written: Path, name: str, headings: list[str]) -> None:
    table = read(written / f'{name}.csv')
    assert list(table) == [
        *headings,
        'exact_stick_slip_amplitude [m]',
        'exact_unstable_amplitude [m]',
        'kbm_stick_slip_amplitude [m]',
        'kbm_unstable_amplitude [m]',
        'reverse_time_unstable_amplitude [m]',
    ]
    assert np.all(np.diff(table[headings[0]]) >= 0.0)
    assert np.nanmax(table['exact_stick_slip_amplitude [m]']) < 1.1e-3
    reverse = np.isfinite(table['reverse_time_unstable_amplitude [m]'])
    assert reverse.sum() == (9 if name == 'finding_1_speed' else 0)


def test_shaft_and_surface_speed_agree(written: Path) -> None:
    table = read(written / 'finding_1_speed.csv')
    factor = REFERENCE.speed.factor('rpm')
    np.testing.assert_allclose(
        table['shaft_speed [rpm]'] * factor, table['surface_speed [m/s]'], rtol=1e-14
    )


def test_tables_of_motion_and_friction(written: Path) -> None:
    motion = read(written / 'finding_4_motion.csv')
    assert list(motion) == [
        'time [s]',
        'displacement [m]',
        'velocity [m/s]',
        'sticking',
        'kbm_envelope [m]',
    ]
    assert set(motion['sticking']) == {0.0, 1.0}
    assert np.isfinite(np.array(list(motion.values()))).all()
    friction = read(written / 'finding_5_friction.csv')
    assert list(friction) == [
        'relative_speed [m/s]',
        'stribeck_coefficient [-]',
        'coulomb_coefficient [-]',
    ]


@pytest.mark.usefixtures('quick')
@pytest.mark.parametrize('kind', ['png', 'svg'])
def test_the_same_command_writes_the_same_bytes(tmp_path: Path, kind: str) -> None:
    pytest.importorskip('matplotlib')
    for folder in ('one', 'two'):
        arguments = ['figures', '-o', str(tmp_path / folder), '--format', kind]
        assert main(arguments) == 0
    files = sorted(path.name for path in (tmp_path / 'one').iterdir())
    assert files == [f'{name}.{ending}' for name in QUICK for ending in ('csv', kind)]
    for name in files:
        assert (tmp_path / 'one' / name).read_bytes() == (tmp_path / 'two' / name).read_bytes()


@pytest.mark.usefixtures('quick')
def test_svg_is_valid(tmp_path: Path) -> None:
    pytest.importorskip('matplotlib')
    assert main(['figures', '-o', str(tmp_path), '--format', 'svg']) == 0
    root = ElementTree.parse(tmp_path / 'finding_5_friction.svg').getroot()
    assert root.tag.endswith('}svg')


@pytest.mark.usefixtures('quick')
def test_it_says_what_it_wrote_and_what_was_found(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip('matplotlib')
    assert main(['figures', '-o', str(tmp_path)]) == 0
    motion, friction = capsys.readouterr().out.splitlines()
    assert motion.startswith(f'{tmp_path}/finding_4_motion.png: amplitude 0.556755 mm (KBM 0.5268')
    assert 'period 31.5903 ms' in motion
    assert friction.endswith('slope at the Hopf speed -0.4 s/m')


@pytest.mark.usefixtures('quick')
def test_another_point_and_another_bearing(tmp_path: Path) -> None:
    pytest.importorskip('matplotlib')
    text = Path(CONFIG).read_text('utf-8').replace('decay: 10.0', 'decay: 8.0, viscous: 0.02')
    config = tmp_path / 'other.yaml'
    config.write_text(text, 'utf-8')
    out = tmp_path / 'out'
    arguments = ['figures', '-c', str(config), '--bearing', 'aft_stern', '-o', str(out)]
    assert main([*arguments, '--speed', '0.05m/s', '--load', '1.5kN']) == 0
    assert np.max(read(out / 'finding_4_motion.csv')['velocity [m/s]']) <= 0.05 * (1 + 1e-12)


@pytest.mark.parametrize('name', NAMES)
def test_no_two_words_overlap(name: str, placed: list[Labeller]) -> None:
    pytest.importorskip('matplotlib')
    speed = 20.0 * REFERENCE.speed.factor('rpm')
    point = figures._Point('reference bearing', REFERENCE, speed, 1000.0)
    figure = found(name, point).draw()
    with style():
        figure.draw_without_rendering()
    assert placed
    for labels in placed:
        texts = [box for box in labels.boxes if box.half[0] != box.half[1]]
        assert not any(a.overlaps(b) for a, b in itertools.combinations(texts, 2))
    width = figure.bbox.width
    for axes in figure.axes:
        legend = axes.get_legend()
        if legend is not None:
            assert legend.get_window_extent().x1 <= width
    for text in figure.texts:
        assert text.get_window_extent().x1 <= width
    words = ' '.join(t.get_text() for axes in figure.axes for t in axes.texts)
    if name == 'finding_1_speed':
        assert 'Hopf 30.738 rpm' in words
        assert 'fold 40.7179 rpm\n(KBM 40.7231 rpm)' in words


@pytest.mark.parametrize(
    ('more', 'text'),
    [
        (('--load', '0N'), "load '0N' must be above 0"),
        (('--load', '1000'), "load '1000' must be a number with a unit"),
        (('--load', '100N'), 'load = 100 N has no fold'),
        (('--speed', '20'), "speed '20' must be a number with a unit"),
        (('--speed', '35rpm'), 'speed = 35 rpm must lie between 0 and the Hopf speed, 30.738 rpm'),
        (('--bearing', 'x'), "bearing 'x' needs a --config that has it"),
        (('--config', CONFIG, '--bearing', 'x'), "bearing 'x' is not configured; there are: aft"),
        (('--config', 'none.yaml'), 'none.yaml'),
    ],
)
def test_bad_input_is_named_with_its_rule(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], more: tuple[str, ...], text: str
) -> None:
    out = tmp_path / 'out'
    assert main(['figures', '-o', str(out), *more]) == 2
    error = capsys.readouterr().err
    assert error.startswith('ERROR: ')
    assert text in error
    assert not out.exists()


def test_another_friction_law_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = Path(CONFIG).read_text('utf-8')
    law = '{law: stribeck, static: 0.30, kinetic: 0.10, decay: 10.0}'
    assert law in text
    config = tmp_path / 'coulomb.yaml'
    config.write_text(text.replace(law, '{law: coulomb, static: 0.3, kinetic: 0.1}'), 'utf-8')
    assert main(['figures', '-o', str(tmp_path / 'out'), '-c', str(config)]) == 2
    assert 'friction law = coulomb must be stribeck' in capsys.readouterr().err


def test_a_file_in_the_place_of_the_folder_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / 'out'
    out.write_text('mine', 'utf-8')
    assert main(['figures', '-o', str(out)]) == 2
    assert f'ERROR: {out}: File exists' in capsys.readouterr().err
    assert out.read_text('utf-8') == 'mine'


def test_an_unknown_format_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as exit_:
        main(['figures', '--format', 'pdf'])
    assert exit_.value.code == 2
    assert 'invalid choice' in capsys.readouterr().err
