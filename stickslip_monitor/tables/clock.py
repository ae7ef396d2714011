# SPDX-License-Identifier: Apache-2.0
"""Which columns of a table are its time, and how they are read."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from stickslip_monitor.errors import BagError
from stickslip_monitor.tables.dialect import Dialect
from stickslip_monitor.tables.headings import Cells, parse_heading, parse_number
from stickslip_monitor.tables.stamps import (
    DAY,
    SECOND,
    ReadTimes,
    StampLayout,
    is_day,
    is_stamp,
    is_time,
    read_time_of_day,
    scaled_reader,
)

_NAMED = re.compile(r'\b(time|timestamp|ts|date|datetime|zeit|datum|uhrzeit|seconds|sec|t|epoch)\b')
# Numbers since 1970 by their size: the least, the unit [ns] and its name.
_SINCE_1970 = ((1e17, 1, 'ns'), (1e14, 10**3, 'us'), (1e11, 10**6, 'ms'), (1e8, SECOND, 's'))
_UNITS = {
    'ns': 1,
    'us': 10**3,
    'µs': 10**3,
    'ms': 10**6,
    's': SECOND,
    'sec': SECOND,
    'seconds': SECOND,
    'min': 60 * SECOND,
    'h': 3600 * SECOND,
    'd': DAY,
    'days': DAY,
}
# Days since the end of 1899 of the years 1954 to 2119, as spreadsheets count.
_SHEET, _SHEET_ZERO = (20_000, 80_000), -25_569
_MOST_ROWS = 500
# Less than the share of the cells of a column that are times.
_MOSTLY = 0.5
WITHOUT_ZONE = 'times have no zone: taken as UTC'


@dataclass(frozen=True, slots=True)
class Clock:
    """The columns of the time, what reads them, and what was guessed of them."""

    columns: tuple[int, ...]
    read: ReadTimes
    said: tuple[str, ...]


def find_clock(path: Path, table: Dialect) -> Clock:
    """Find the time of a table.

    Raises:
        BagError: No column is one.
    """
    width = len(table.names)
    rows = [row for row in table.rows[:_MOST_ROWS] if len(row) >= width - 1]

    def which(is_kind: object) -> list[int]:
        assert callable(is_kind)
        return [
            k
            for k in range(width)
            if sum(k < len(row) and is_kind(row[k]) for row in rows) > _MOSTLY * len(rows)
        ]

    plain = [parse_heading(name).name for name in table.names]
    named = [k for k, name in enumerate(plain) if _NAMED.search(name)]
    stamps = which(is_stamp)
    # InfluxDB has the limits of the query beside the time.
    stamps.sort(key=lambda k: (table.names[k] != '_time', k not in named, k))
    days, times = which(is_day), which(is_time)
    if stamps or (days and times):
        return _of_stamps(table, rows, (stamps[0],) if stamps else (days[0], times[0]))
    if times:
        said = f"times in '{table.names[times[0]]}' are of the day, without a date"
        return Clock((times[0],), read_time_of_day, (said,))
    for k in (*named, 0):
        if (found := _of_numbers(table, rows, k, k in named)) is not None:
            return found
    raise BagError(
        f"log '{path}': no column is a time among {_listed(table.names)}: the first must be, or"
        " one headed 'time'"
    )


def _listed(names: Sequence[str]) -> str:
    return ', '.join(f"'{name}'" for name in names[:10])


def _of_stamps(table: Dialect, rows: Sequence[Cells], columns: tuple[int, ...]) -> Clock:
    """Dates with times in one column, or in two."""
    most = max(columns)
    known = [*rows, *(row for row in table.tail if len(row) > most)]
    layout = StampLayout([' '.join(row[k].strip() for k in columns) for row in known])
    said = []
    if layout.question:
        said.append(f"'{layout.question}' is read day first: nothing in the file tells")
    if not layout.has_zone:
        said.append(WITHOUT_ZONE)
    return Clock(columns, layout.read, tuple(said))


def _of_numbers(table: Dialect, rows: Sequence[Cells], k: int, is_named: bool) -> Clock | None:
    """Numbers of a column as times; None where it does not look like one."""
    found = [parse_number(row[k], table.decimal) for row in rows if k < len(row)]
    values = [value for value in found if value is not None]
    heading = table.names[k]
    is_rising = values == sorted(values) or values == sorted(values, reverse=True)
    has_unit = table.units[k] is not None
    fits = is_named or (not has_unit and is_rising and len(set(values)) > 0.5 * len(values))
    if not values or not fits or len(values) <= _MOSTLY * len(found):
        return None
    unit = (parse_heading(heading).unit or '').lower()
    size = max(map(abs, values))

    def clock(factor: int, said: str, zero: int = 0) -> Clock:
        read = scaled_reader(factor, zero, table.decimal)
        return Clock((k,), read, (f"times in '{heading}' are {said}",))

    for least, factor, name in _SINCE_1970:
        if size >= least:
            return clock(factor, f'{name} since 1970')
    is_date = re.search(r'date|datum|time ?stamp', parse_heading(heading).name)
    if unit == '' and is_date and _SHEET[0] < size < _SHEET[1]:
        said = 'days of a spreadsheet, without a zone: taken as UTC'
        return clock(DAY, said, _SHEET_ZERO)
    return clock(_UNITS.get(unit, SECOND), f'{unit if unit in _UNITS else "s"} since the start')
