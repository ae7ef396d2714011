# SPDX-License-Identifier: Apache-2.0
"""Finds the times of a table in which each signal has its own column of times, as in exports of trends."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from stickslip_logs.tables.cell_times import Cells
from stickslip_logs.tables.dialect import parse_number
from stickslip_logs.tables.time_columns import (
    MAX_ROWS,
    TIME_WORDS,
    Clock,
    TableColumns,
    clock_of_numbers,
    direction_of,
    find_clock,
)
from stickslip_logs.units import SECOND_NS

_OF_TIME = re.compile(TIME_WORDS.pattern + r'|\b(?:utc|gmt|stamp|ns|us|ms|s)\b')


def find_clocks(path: Path, table: TableColumns) -> tuple[Clock, ...]:
    """Find the clocks of a table: one for all columns, or one for each signal, with its ``values``.

    Several are in the order of the first column that each times.

    Raises:
        BagError: No column is one, or the one that is headed so, or the first, is empty.
    """
    main = find_clock(path, table)
    return share_columns(table, main, [*_other_clocks(table, main)])


def _other_clocks(table: TableColumns, main: Clock) -> Iterator[Clock]:
    """Yield clocks of further columns that hold times in the way of the main clock.

    A column of numbers has to be headed as a time, and so has one that is empty in head and tail: its signal
    begins later. Nothing is yielded where the columns of the main clock are not adjacent.
    """
    first = main.columns[0]
    if main.columns != tuple(range(first, first + len(main.columns))):
        return
    main_ns, is_main = main.read_rows(table.rows_with(main.columns))
    direction = direction_of(main_ns[is_main])
    for k in range(len(table.names) - len(main.columns) + 1):
        clock = replace(main, columns=tuple(c - first + k for c in main.columns))
        if set(clock.columns) & set(main.columns):
            continue
        filled = [row for row in table.rows_with(clock.columns) if row[k].strip()]
        is_named = all(TIME_WORDS.search(table.headings[c][0]) for c in clock.columns)
        if not filled:
            if is_named:
                yield clock
            continue
        if not is_named and (main.is_count or all(parse_number(row[k]) is not None for row in filled)):
            continue
        counter = clock_of_numbers(table, filled, k, is_named=True) if main.is_count else clock
        if counter is not None and _has_steady_times(counter, filled, direction):
            yield counter


def _has_steady_times(clock: Clock, rows: Sequence[Cells], direction: int) -> bool:
    """Return whether more than half of rows have times of a clock, of which a tenth at most step back.

    The direction is 1 for rising times, -1 for falling ones.
    """
    time_ns, is_timed = clock.read_rows(rows)
    back = np.count_nonzero(direction * np.diff(time_ns[is_timed]) < 0)
    return bool(is_timed.sum() > 0.5 * len(rows) and back <= 0.1 * is_timed.sum())


def share_columns(table: TableColumns, main: Clock, extra_clocks: Sequence[Clock]) -> tuple[Clock, ...]:
    """Assign the columns of values to clocks; return copies of clocks that have some, with ``values`` set.

    They are in the order of their columns. A clock that is named after a signal is that of the signal. Else a
    column has the clock to its left, or to its right where values stand before their times, if the clocks are
    headed alike or differ by more than a zone, and each has a column. Else the main clock alone is returned
    unchanged, for all columns.
    """
    clocks = sorted([main, *extra_clocks], key=lambda clock: clock.columns)
    taken = {k for clock in clocks for k in clock.columns}
    values = [k for k in range(len(table.names)) if k not in taken]
    named = _clocks_by_name(table, clocks, values)
    main_names, *names = [[table.names[k] for k in clock.columns] for clock in (main, *extra_clocks)]
    alike = [clock for clock, heading in zip(extra_clocks, names, strict=True) if heading == main_names]
    separate = alike or [clock for clock in extra_clocks if _is_apart(table, main, clock)]
    used = sorted([main, *separate], key=lambda clock: clock.columns)
    owners = _clocks_beside(used, values)
    if any(clock is not main for clock in named.values()):
        if main not in named.values():
            owners = dict.fromkeys(values, main)
        owners |= named
    elif any(clock not in owners.values() for clock in used):
        return (main,)
    by_columns = {owner.columns: owner for owner in owners.values()}
    return tuple(
        replace(clock, values=frozenset(k for k, owner in owners.items() if owner.columns == columns))
        for columns, clock in by_columns.items()
    )


def _clocks_beside(clocks: Sequence[Clock], values: Sequence[int]) -> dict[int, Clock]:
    """Return the clock to the left of each column, else the first clock, by the place of the column.

    Clocks, at least one, and columns are sorted by place.
    The clock to its right instead, where columns begin before the first clock and end before the last one.
    """
    if values and values[0] < clocks[0].columns[0] and values[-1] < clocks[-1].columns[0]:
        return {k: next(clock for clock in clocks if clock.columns[0] > k) for k in values}
    return {k: [clocks[0], *(clock for clock in clocks if clock.columns[0] < k)][-1] for k in values}


def _clocks_by_name(table: TableColumns, clocks: Sequence[Clock], values: Sequence[int]) -> dict[int, Clock]:
    """Return the clock that is named after each column, by the place of the column.

    The heading of the column has all words of that of the clock but for words of time. The clock with the
    most words is taken. Columns without such a clock are missing.
    """
    names = [
        {*_OF_TIME.sub(' ', ' '.join(table.headings[k][0] for k in clock.columns)).split()}
        for clock in clocks
    ]
    named = {}
    for k in values:
        words = {*table.headings[k][0].split()}
        fitting = [
            (len(name), clock) for name, clock in zip(names, clocks, strict=True) if name and name <= words
        ]
        if fitting:
            named[k] = max(fitting, key=lambda pair: pair[0])[1]
    return named


def _is_apart(table: TableColumns, main: Clock, clock: Clock) -> bool:
    """Return whether the times of a clock differ from those of the main one by more than a constant zone.

    Zones are whole quarters of an hour, up to 14 hours. False for a clock without times in the head, or with
    less than half as many different times as the main one. True where no row has times of both.
    """
    quarter_ns = 900 * SECOND_NS
    rows = [row for row in table.rows[:MAX_ROWS] if len(row) > max(*main.columns, *clock.columns)]
    (main_ns, is_main), (clock_ns, is_clock) = main.read_rows(rows), clock.read_rows(rows)
    if not is_clock.any():
        return False
    main_ns, clock_ns = main_ns[is_main & is_clock], clock_ns[is_main & is_clock]
    if not main_ns.size:
        return True
    ahead_ns = clock_ns - main_ns
    zone_ns = np.rint(ahead_ns / quarter_ns).astype(np.int64) * quarter_ns
    is_zone = (np.abs(ahead_ns - zone_ns) < SECOND_NS).all() and np.ptp(zone_ns) == 0
    is_zone &= abs(int(zone_ns[0])) <= 14 * 3600 * SECOND_NS
    return not is_zone and 2 * np.unique(clock_ns).size >= np.unique(main_ns).size
