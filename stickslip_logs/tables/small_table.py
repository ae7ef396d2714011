# SPDX-License-Identifier: Apache-2.0
"""Reads a small table of any kind as a whole: headings with their units, and rows with their lines."""

from __future__ import annotations

import csv
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

from stickslip_logs.errors import StickslipError, cause
from stickslip_logs.tables.dialect import (
    COMMENTS,
    csv_reader,
    encoding_of,
    find_delimiter,
    headings_above,
    is_row_of_units,
)
from stickslip_logs.tables.text_file import BROKEN, lines_of, open_unpacked


class TableRow(NamedTuple):
    """A row of a table: its line in the file, and its cells."""

    line: int
    cells: list[str]


def read_table(
    path: str | Path,
    max_bytes: int,
    error: type[StickslipError],
    is_heading: Callable[[list[str]], bool] = lambda cells: False,
) -> tuple[list[TableRow], str]:
    """Read a table as test benches and spreadsheets write it.

    Encoding and delimiter are found as those of a log. Blank lines and comments are skipped, and what stands
    above the headings, which may be a comment, too; the units of a row below the headings stand behind them.

    Args:
        path: The file, packed or not.
        max_bytes: The largest unpacked size that is read [bytes].
        error: The type of the error that is raised for a file that cannot be read, is larger, or is damaged.
        is_heading: Returns whether cells are headings of such a table. Where none are, those above the
            numbers are taken, or the first line that is no comment.

    Returns:
        The rows, the headings first, and the delimiter. Without headings all rows that are no comments.

    Raises:
        StickslipError: Of the type ``error``: it cannot be read or is larger, or a cell is above 128 KiB.
    """
    lines = _read_lines(path, max_bytes, error)
    delimiter, _ = find_delimiter(lines)
    try:
        split = [next(csv_reader(iter([line]), delimiter)) for line in lines]
    except csv.Error as damage:
        raise error(f'{path}: {damage}') from None
    rows = [TableRow(k, [cell.strip() for cell in cells]) for k, cells in enumerate(split, start=1)]
    rows = [row for row in rows if any(row.cells)]
    at = _find_headings(rows, is_heading)
    below = [row for row in rows[at + 1 :] if not row.cells[0].startswith(COMMENTS)]
    if at < 0:
        return below, delimiter
    names = _without_mark(rows[at].cells)
    if below and is_row_of_units(below[0].cells) and len(below[0].cells) == len(names):
        units = below.pop(0).cells
        names = [f'{name} [{unit}]' if unit else name for name, unit in zip(names, units, strict=True)]
    return [TableRow(rows[at].line, names), *below], delimiter


def _read_lines(path: str | Path, max_bytes: int, error: type[StickslipError]) -> list[str]:
    """Read the lines, with their ends, of a file, packed or not, of up to ``max_bytes`` unpacked.

    Raises:
        StickslipError: Of the type ``error``: the file cannot be read, is larger, or is damaged.
    """
    try:
        with open_unpacked(Path(path)) as file:
            data = file.read(max_bytes + 1)
    except BROKEN as damage:
        raise error(f'{path}: {cause(damage)}') from None
    if len(data) > max_bytes:
        raise error(f'{path}: it is larger than {max_bytes} bytes, the limit')
    return lines_of(data.decode(encoding_of(data), 'replace'))


def _find_headings(rows: Sequence[TableRow], is_heading: Callable[[list[str]], bool]) -> int:
    """Return the place of the row of headings; -1 where all rows are comments, or there are none.

    Headings are the cells that ``is_heading`` knows, without the mark of a comment; else the row above the
    numbers, or the first row that is no comment.
    """
    cells = [row.cells for row in rows]
    named = [k for k, row in enumerate(cells) if is_heading(_without_mark(row))]
    above = headings_above(cells)
    places = [k for k, row in enumerate(cells) if above and _without_mark(row)[: len(above)] == above]
    plain = [k for k, row in enumerate(cells) if not row[0].startswith(COMMENTS)]
    return next(iter([*named, *places, *plain]), -1)


def _without_mark(cells: list[str]) -> list[str]:
    """Return cells without the mark of a comment in the first one; drop a cell that is only the mark."""
    bare = [cells[0].lstrip(''.join(COMMENTS) + ' '), *cells[1:]]
    return bare if bare[0] or cells[0] == '' else bare[1:]
