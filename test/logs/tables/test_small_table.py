# SPDX-License-Identifier: Apache-2.0
"""A small table is found below whatever a bench or a spreadsheet writes above it."""

from __future__ import annotations

import gzip
from pathlib import Path

import pytest

from stickslip_logs.errors import BagError
from stickslip_logs.tables.small_table import TableRow, read_table

BODY = '0.1,0.30\n0.2,0.25\n0.3,0.20\n0.4,0.15\n0.5,0.14\n'
CELLS = [line.split(',') for line in BODY.splitlines()]
PREAMBLE = 'Created by Data Viewer ver. 2.19 05/12/22\nTotal number of runs - 1\nIndenter tip ID = 0\n\n'
HEADS = {
    'plain': 'speed [m/s],mu\n',
    'preamble': f'{PREAMBLE}speed [m/s],mu\n',
    'preamble of pairs': 'Operator,A. B.\nSample,7\nDate,05/12/22\n\nspeed [m/s],mu\n',
    'comments': '# a bench\n# speed [m/s],mu\n',
    'a comment above': '# a bench, of 2026\nspeed [m/s],mu\n',
    'units': 'speed,mu\nm/s,-\n',
    'units, of which one is 1': 'speed,mu\nm/s,1\n',
    'units in brackets': f'{PREAMBLE}speed,mu\n[m s^-1],[-]\n',
    'blank lines': '\n\nspeed [m/s],mu\n\n',
    'words': 'v,mu\n',
    'quoted': '"speed [m/s]","mu"\n',
}


@pytest.mark.parametrize('name', HEADS)
@pytest.mark.parametrize('delimiter', [',', ';', '\t', '|'])
def test_the_headings_are_those_of_the_numbers(name: str, delimiter: str, tmp_path: Path) -> None:
    text = HEADS[name].replace(',', delimiter) + BODY.replace(',', delimiter)
    path = tmp_path / 'a.csv'
    path.write_text(text)
    (head, *rows), dialect = read_table(path, 10_000, BagError)
    assert [row.cells for row in rows] == CELLS
    assert [row.line for row in rows] == [k for k, line in enumerate(text.split('\n'), 1) if line[:2] == '0.']
    assert dialect == delimiter
    assert head.cells[0].partition(' ')[0] in ('speed', 'v')
    assert ('m/s' in head.cells[0] or 's^-1' in head.cells[0]) == (name != 'words')
    assert head.line == 1 + text[: text.index(head.cells[0].partition(' ')[0])].count('\n')


def test_a_row_that_the_reader_knows_is_the_headings(tmp_path: Path) -> None:
    path = tmp_path / 'a.csv'
    path.write_text('bearings,2\nbearing,state\naft,quiet\nfore,quiet\n')
    rows, _ = read_table(path, 10_000, BagError, ['bearing', 'state'].__eq__)
    assert rows == [
        TableRow(2, ['bearing', 'state']),
        TableRow(3, ['aft', 'quiet']),
        TableRow(4, ['fore', 'quiet']),
    ]


def test_a_bad_first_row_is_no_heading(tmp_path: Path) -> None:
    path = tmp_path / 'a.csv'
    path.write_text(f'speed,mu\nx,0.3\n{BODY}')
    rows, _ = read_table(path, 10_000, BagError)
    assert rows[:2] == [TableRow(1, ['speed', 'mu']), TableRow(2, ['x', '0.3'])]


@pytest.mark.parametrize(
    'data',
    [f'speed,mu\n{BODY}'.encode('utf-16'), gzip.compress(f'speed,mu\n{BODY}'.encode())],
    ids=['UTF-16', 'gzip'],  # packed data have the time in them, and would name the test
)
def test_encodings_and_packings_are_those_of_logs(data: bytes, tmp_path: Path) -> None:
    (tmp_path / 'a.csv').write_bytes(data)
    rows, _ = read_table(tmp_path / 'a.csv', 10_000, BagError)
    assert [row.cells for row in rows] == [['speed', 'mu'], *CELLS]


def test_tables_too_large_or_damaged_are_refused(tmp_path: Path) -> None:
    path = tmp_path / 'a.csv'
    path.write_bytes(gzip.compress(bytes(100_000)))
    with pytest.raises(BagError, match='larger than 10000 bytes'):
        read_table(path, 10_000, BagError)
    path.write_bytes(gzip.compress(BODY.encode())[:-9])
    with pytest.raises(BagError, match='ended before'):
        read_table(path, 10_000, BagError)
