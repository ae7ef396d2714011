# SPDX-License-Identifier: Apache-2.0
"""``stickslip accuracy``: its files, its table, its JSON, and what it says about bad input."""

from __future__ import annotations

from pathlib import Path

import pytest
from shared import Stickslip, png_size

from stickslip_lab.accuracy.comparison import Effort, Row, read_rows
from stickslip_lab.commands import accuracy

STORED = str(Path(__file__).parents[3] / 'docs' / 'accuracy.csv')


@pytest.fixture
def fast(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(accuracy, 'QUICK', Effort(budget=0.0, sample=1e-9, min_samples=1, max_samples=1))
    chosen = ('KBM', 'exact cycle', 'harmonic balance, H = 1')
    monkeypatch.setattr(accuracy, 'METHODS', [m for m in accuracy.METHODS if m.name in chosen])


@pytest.mark.usefixtures('fast')
def test_quick_measures_writes_and_prints(tmp_path: Path, stickslip: Stickslip) -> None:
    out = tmp_path / 'a.csv'
    done = stickslip('accuracy', '--quick', '-o', out)
    assert done.code == 0
    printed = done.out
    assert 'exact cycle' in printed
    assert '20 rpm' in printed
    rows = read_rows(out)
    assert {row.case for row in rows} == {'38 rpm', '20 rpm', '10 rpm', '40 rpm'}
    assert all(abs(row.error) < 1e-13 for row in rows if row.method == 'exact cycle')


def test_json_of_a_stored_measurement(stickslip: Stickslip) -> None:
    done = stickslip('accuracy', '--from', STORED, '--json')
    assert done.code == 0
    document = done.json
    assert document['schema'] == 'stickslip_monitor/accuracy/1'
    assert document['base'] == 'KBM'
    (kbm,) = (s for s in document['methods'] if s['method'] == 'KBM')
    assert kbm['ratio'] == 1.0
    assert len(document['rows']) == len(read_rows(STORED))
    # A failure has no error.
    failed = [row for row in document['rows'] if row['outcome'] == 'not_converged']
    assert failed
    assert all(row['error'] is None for row in failed)


def test_markdown_of_a_stored_measurement(stickslip: Stickslip) -> None:
    lines = stickslip('accuracy', '--from', STORED, '--markdown').out.splitlines()
    assert lines[0].startswith('| method | weak friction |')
    assert len({line.count('|') for line in lines}) == 1


def test_the_picture(tmp_path: Path, stickslip: Stickslip) -> None:
    pytest.importorskip('matplotlib')
    out = tmp_path / 'a.png'
    assert stickslip('accuracy', '--from', STORED, '--picture', out).code == 0
    assert png_size(out) == (2400, 1440)


@pytest.mark.parametrize(
    ('error', 'text'), [(0.0, '0'), (-0.0, '0'), (3.2e-5, '3e-5'), (-0.4, '4e-1'), (20.0, '2e1')]
)
def test_errors_in_a_table(error: float, text: str) -> None:
    row = Row('KBM', 'averaging', 'a', 1.0, error, 'cycle', 3, 1, 1.0, 5, disturbed=False)
    assert accuracy.error_text(row) == text


def test_times_in_words() -> None:
    texts = [accuracy.time_text(seconds) for seconds in (2.5, 2.5e-3, 2.5e-6, float('nan'))]
    assert texts == ['2.5 s', '2.5 ms', '2.5 us', '-']
