# SPDX-License-Identifier: Apache-2.0
"""``stickslip figures``: its files, and what it says about bad input."""

from __future__ import annotations

import csv
import functools
import itertools
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from shared import png_size

from stickslip_monitor.cli import main
from stickslip_monitor.commands import figures
from stickslip_monitor.drawing.canvas import style
from stickslip_monitor.lab.findings import REFERENCE
from stickslip_monitor.monitor.config_file import load_config

CONFIG = str(Path(__file__).parents[2] / 'launch_configs' / 'reference_bearing.yaml')
LAW = '{law: stribeck, static: 0.30, kinetic: 0.10, decay: 10.0}'
AMPLITUDES = [
    'exact_stick_slip_amplitude [m]',
    'exact_unstable_amplitude [m]',
    'kbm_stick_slip_amplitude [m]',
    'kbm_unstable_amplitude [m]',
]
HEADINGS = {
    'finding_1_speed': ['shaft_speed [rpm]', 'surface_speed [m/s]', *AMPLITUDES],
    'finding_2_load': ['load [N]', *AMPLITUDES],
    'finding_3_kinetic': ['kinetic_coefficient [-]', *AMPLITUDES],
    'finding_4_motion': ['time [s]', 'displacement [m]', 'velocity [m/s]', 'sticking', 'kbm_envelope [m]'],
}
QUICK = ('finding_4_motion',)
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
    pytest.importorskip('matplotlib')
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
@pytest.mark.parametrize('name', HEADINGS)
def test_each_finding_has_a_picture_and_a_table(written: Path, name: str) -> None:
    files = sorted(path.name for path in written.iterdir())
    assert files == sorted(f'{n}.{kind}' for n in ALL for kind in ('csv', 'png'))
    assert png_size(written / f'{name}.png') == (1800, 1320)
    table = read(written / f'{name}.csv')
    assert list(table) == HEADINGS[name]
    if name in QUICK:
        assert np.isfinite(np.array(list(table.values()))).all()
        return
    assert np.all(np.diff(table[HEADINGS[name][0]]) >= 0.0)
    assert np.nanmax(table['exact_stick_slip_amplitude [m]']) < 1.1e-3
    if name == 'finding_1_speed':
        surface = table['shaft_speed [rpm]'] * REFERENCE.speed.factor('rpm')
        np.testing.assert_allclose(surface, table['surface_speed [m/s]'], rtol=1e-14)


@pytest.mark.slow
@pytest.mark.parametrize('name', HEADINGS)
def test_no_two_words_overlap(name: str) -> None:
    pytest.importorskip('matplotlib')
    point = figures.Point('reference bearing', REFERENCE, 20.0 * REFERENCE.speed.factor('rpm'), 1e3)
    figure = found(name, point).draw()
    with style():
        figure.draw_without_rendering()
    legends = [legend for axes in figure.axes if (legend := axes.get_legend())]
    texts = [*figure.texts, *(text for axes in figure.axes for text in axes.texts)]
    boxes = [item.get_window_extent() for item in (*texts, *legends)]
    assert not any(a.overlaps(b) for a, b in itertools.combinations(boxes, 2))
    assert all(box.x0 >= 0.0 and box.x1 <= figure.bbox.width for box in boxes)
    words = [text.get_text() for legend in legends for text in legend.get_texts()]
    if name == 'finding_1_speed':
        assert {'Hopf 30.74 rpm', 'fold 40.72 rpm (KBM +0.013 %)'} <= set(words)


@pytest.mark.usefixtures('quick')
@pytest.mark.parametrize('kind', ['png', 'svg'])
def test_each_format_is_written_and_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], kind: str
) -> None:
    assert main(['figures', '-o', str(tmp_path), '--format', kind]) == 0
    files = sorted(path.name for path in tmp_path.iterdir())
    assert files == [f'{name}.{ending}' for name in QUICK for ending in ('csv', kind)]
    if kind == 'svg':
        assert ElementTree.parse(tmp_path / files[1]).getroot().tag.endswith('}svg')
    motion = capsys.readouterr().out.splitlines()[0]
    assert motion.startswith(f'{tmp_path / files[1]}: amplitude 0.556755 mm (KBM 0.5268')
    assert 'period 31.5903 ms' in motion


@pytest.mark.usefixtures('quick')
def test_another_point_and_another_bearing(tmp_path: Path) -> None:
    text = Path(CONFIG).read_text('utf-8').replace('decay: 10.0', 'decay: 8.0, viscous: 0.02')
    config = tmp_path / 'other.yaml'
    config.write_text(text, 'utf-8')
    out = tmp_path / 'out'
    arguments = ['figures', '-c', str(config), '--bearing', 'aft_stern', '-o', str(out)]
    assert main([*arguments, '--speed', '0.05m/s', '--load', '1.5kN']) == 0
    assert np.max(read(out / 'finding_4_motion.csv')['velocity [m/s]']) <= 0.05 * (1 + 1e-12)
