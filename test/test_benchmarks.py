# SPDX-License-Identifier: Apache-2.0
"""The page of the benchmarks: whose numbers it keeps, and that every part can be run."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

from benchmarks import page
from benchmarks.parts import PARTS, SOAK
from benchmarks.table import NOT_INSTALLED, Table, absent, duration, ratio

FOLDER = Path(page.__file__).parent


def test_a_section_is_a_heading_a_table_and_notes() -> None:
    table = Table(
        'Reading', 'Text.', ('reader', 'time'), [['ours', '1 s'], absent('x', 2)], 'End.'
    )
    assert table.markdown() == (
        '## Reading\n\nText.\n\n| reader | time |\n|---|---:|\n| ours | 1 s |\n'
        f'| x | {NOT_INSTALLED} |\n\nEnd.\n'
    )
    assert Table.of(table.record()) == table


def test_a_row_of_another_width_is_refused() -> None:
    with pytest.raises(ValueError, match='must have 2 cells'):
        Table('Reading', '', ('reader', 'time'), [['ours']])


def test_sections_of_the_same_machine_are_kept_in_order() -> None:
    order = ('first', 'second', 'third')
    old = page.render({'third': '## 3', 'first': '## old'}, order)
    new = page.render({'first': '## 1', 'second': '## 2'}, order, old)
    assert [line for line in new.splitlines() if line.startswith('## ')] == [
        '## 1',
        '## 2',
        '## 3',
    ]
    assert page.render({'first': '## 1', 'second': '## 2'}, order, new) == new


def test_sections_of_another_machine_are_dropped(monkeypatch: pytest.MonkeyPatch) -> None:
    old = page.render({'first': '## 1', 'second': '## 2'}, ('first', 'second'))
    monkeypatch.setattr(page, 'machine', lambda: 'Machine: another.')
    new = page.render({'first': '## new'}, ('first', 'second'), old)
    assert '## new' in new
    assert '## 2' not in new


@pytest.mark.parametrize('name', [*PARTS, SOAK])
def test_every_part_is_a_module_with_run(name: str) -> None:
    tree = ast.parse((FOLDER / f'{name}.py').read_text('utf-8'))
    (run,) = (n for n in tree.body if isinstance(n, ast.FunctionDef) and n.name == 'run')
    assert [argument.arg for argument in run.args.args] == ['quick']


def test_numbers_for_a_person() -> None:
    assert [duration(s) for s in (2.0, 0.0335, 5.6e-5, 9.87e-8)] == [
        '2 s', '33.5 ms', '56 µs', '98.7 ns',
    ]  # fmt: skip
    assert duration(-0.0335) == '-33.5 ms'
    assert [ratio(r) for r in (0.25, 1.0, 9.96, 123.4)] == ['0.25 ×', '1 ×', '10 ×', '123 ×']
