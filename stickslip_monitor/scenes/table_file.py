# SPDX-License-Identifier: Apache-2.0
"""Reads a table of a quantity over time: a CSV file with the columns ``time`` and ``value``."""

from __future__ import annotations

import csv
from pathlib import Path

from stickslip_monitor.errors import SceneError

HEADER = ['time', 'value']


def read_table(path: Path) -> list[tuple[str, list[float]]]:
    """Read a table.

    Args:
        path: The file. Its first line is ``time,value``; empty lines and lines that begin with
            ``#`` are passed over.

    Returns:
        For each row what it is called in sentences, and time [s] and value.

    Raises:
        SceneError: The file cannot be read, has no rows, or a line is not two numbers.
    """
    try:
        lines = path.read_text('utf-8-sig').splitlines()
    except OSError as error:
        raise SceneError(f"table '{path}' cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise SceneError(f"table '{path}' cannot be read: it is not UTF-8 text") from error
    cells = [
        (number, [cell.strip() for cell in next(csv.reader([line]))])
        for number, line in enumerate(lines, 1)
        if line.strip() and not line.lstrip().startswith('#')
    ]
    if not cells or cells[0][1] != HEADER:
        raise SceneError(f"table '{path}' must begin with a line 'time,value'")
    if len(cells) == 1:
        raise SceneError(f"table '{path}' has no rows")
    return [
        (f"table '{path}' line {number}", _numbers(path, number, row)) for number, row in cells[1:]
    ]


def _numbers(path: Path, number: int, row: list[str]) -> list[float]:
    try:
        time, value = map(float, row)
    except ValueError:
        text = ','.join(row)
        raise SceneError(
            f"table '{path}' line {number} = '{text}' must be two numbers: time in s, value"
        ) from None
    return [time, value]
