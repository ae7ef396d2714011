# SPDX-License-Identifier: Apache-2.0
"""Ten minutes of a bearing, a row a second."""

from __future__ import annotations

from collections import deque
from typing import Any

SPAN = 600_000
"""How far back it goes [ms]."""
STEP = 1000
"""Rows are so far apart, or further [ms]."""
_OF_POINT = (
    'fold_speed',
    'hopf_speed',
    'fold_margin',
    'hopf_margin',
    'probability_can',
    'probability_will',
    'probability_runs',
)
COLUMNS = ('time', 'speed', 'load', *_OF_POINT)
"""Time [ms], speed [m/s], load [N], boundaries [m/s], margins and probabilities [-]."""
Row = list[Any]


class TenMinutes:
    """The newest rows, bounded in time and number."""

    def __init__(self) -> None:
        self.rows: deque[Row] = deque(maxlen=SPAN // STEP)

    def add(self, row: Row) -> None:
        """Take a row; one of the same second replaces the one before it.

        Where the clock has stepped back, what lies in its future is dropped.
        """
        now, rows = row[0], self.rows
        while rows and rows[-1][0] // STEP >= now // STEP:
            rows.pop()
        while rows and rows[0][0] < now - SPAN:
            rows.popleft()
        rows.append(row)


def row_of(record: dict[str, Any]) -> Row:
    """A row; what rests on a lost input has no value, though the last one is still told."""
    lost = {name for name in ('speed', 'load') if record['inputs'].get(name, {}).get('lost')}
    hidden = lost | (set(_OF_POINT) if lost else set())
    return [None if name in hidden else record[name] for name in COLUMNS]
