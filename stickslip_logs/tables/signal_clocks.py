# SPDX-License-Identifier: Apache-2.0
"""The times of a table in which each signal has a column of times of its own, as trends are exported."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from stickslip_logs.tables.cell_times import SECOND
from stickslip_logs.tables.time_columns import TIME_WORDS, Clock, TableColumns, clock_of_numbers, find_clock

# Rows by which columns are compared: as many as their times are found by.
_MAX_ROWS = 500
# Of the cells of a column of times more are times; of their steps fewer go back.
_MIN_SHARE, _MAX_BACK = 0.5, 0.1
# Times of another zone are a whole number of these apart, up to 14 hours [ns].
_ZONE_STEP, _MAX_ZONE = 900 * SECOND, 14 * 3600 * SECOND
_OF_TIME = re.compile(TIME_WORDS.pattern + r'|\b(?:utc|gmt|stamp|ns|us|ms|s)\b')


def find_clocks(path: Path, table: TableColumns) -> tuple[Clock, ...]:
    """Find the times of a table, one for all columns or one for each signal.

    Raises:
        BagError: No column is a time.
    """
    main = find_clock(path, table)
    return share_columns(table, main, [*_other_clocks(table, main)])


def _other_clocks(table: TableColumns, main: Clock) -> Iterator[Clock]:
    """Yield clocks of the further columns that hold times as the first ones do.

    One of an empty column is among them where it is headed as a time: its signal begins later.
    """
    first, rows = main.columns[0], [*table.rows[:_MAX_ROWS], *table.tail]
    if main.columns != tuple(range(first, first + len(main.columns))):
        return
    for k in range(len(table.names) - len(main.columns) + 1):
        clock = replace(main, columns=tuple(c - first + k for c in main.columns))
        if set(clock.columns) & set(main.columns):
            continue
        filled = [row for row in rows if len(row) > clock.columns[-1] and row[k].strip()]
        is_named = all(TIME_WORDS.search(table.headings[c][0]) for c in clock.columns)
        if main.is_count and filled:
            counter = clock_of_numbers(table, filled, k, is_named=True) if is_named else None
            if counter is None:
                continue
            clock = counter
        time_ns, is_timed = clock.read([[row[c] for row in filled] for c in clock.columns])
        back = np.count_nonzero(np.diff(time_ns[is_timed]) < 0)
        is_rising = is_timed.sum() > _MIN_SHARE * len(filled) and back <= _MAX_BACK * is_timed.sum()
        if is_rising if filled else is_named:
            yield clock


def share_columns(table: TableColumns, main: Clock, signal_clocks: Sequence[Clock]) -> tuple[Clock, ...]:
    """Give each column its clock.

    A time that is named after a signal is that of the signal. Else a column has the time to its left, if the
    times are headed alike or differ by more than a zone, and each stands before a column.

    Args:
        table: The columns.
        main: The clock of all columns where there is one only.
        signal_clocks: Clocks of other columns of times.
    """
    every = sorted([main, *signal_clocks], key=lambda clock: clock.columns)
    taken = {k for clock in every for k in clock.columns}
    values = [k for k in range(len(table.names)) if k not in taken]
    named = dict(_named_clocks(table, every, values))
    alike = [
        clock for clock in signal_clocks if _clock_headings(table, clock) == _clock_headings(table, main)
    ]
    apart = alike or [clock for clock in signal_clocks if _is_apart(table, main, clock)]
    beside = _clocks_beside(sorted([main, *apart], key=lambda clock: clock.columns), values)
    if any(clock is not main for clock in named.values()):
        rest = beside if any(clock is main for clock in named.values()) else dict.fromkeys(values, main)
        return _clocks_of({**rest, **named})
    return _clocks_of(beside) if all(clock in beside.values() for clock in (main, *apart)) else (main,)


def _clock_headings(table: TableColumns, clock: Clock) -> list[str]:
    return [table.names[k] for k in clock.columns]


def _named_clocks(
    table: TableColumns, clocks: Sequence[Clock], values: Sequence[int]
) -> Iterator[tuple[int, Clock]]:
    """Yield the columns of values whose names a clock has beside words of time, and that clock."""
    called = [
        ({*_OF_TIME.sub(' ', ' '.join(table.headings[k][0] for k in clock.columns)).split()}, clock)
        for clock in clocks
    ]
    for k in values:
        words = {*table.headings[k][0].split()}
        fitting = [(len(name), clock) for name, clock in called if name and name <= words]
        if fitting:
            yield k, max(fitting, key=lambda pair: pair[0])[1]


def _is_apart(table: TableColumns, main: Clock, signal_clock: Clock) -> bool:
    """Return whether the times of a clock differ from those of another, by more than a zone."""
    last = max(*main.columns, *signal_clock.columns)
    rows = [row for row in table.rows[:_MAX_ROWS] if len(row) > last]
    times, main_times = (
        clock.read([[row[k] for row in rows] for k in clock.columns]) for clock in (signal_clock, main)
    )
    has_both = times[1] & main_times[1]
    changes = len({*times[0][has_both].tolist()}), len({*main_times[0][has_both].tolist()})
    ahead_ns = times[0][has_both] - main_times[0][has_both]
    zone_ns = np.rint(ahead_ns / _ZONE_STEP).astype(np.int64) * _ZONE_STEP
    is_zone = (
        (np.abs(ahead_ns - zone_ns) < SECOND).all() and np.ptp(zone_ns) == 0 if has_both.any() else False
    )
    return (
        bool(times[1].any())
        and 2 * changes[0] >= changes[1]
        and not (is_zone and abs(int(zone_ns[0])) <= _MAX_ZONE)
    )


def _clocks_beside(clocks: Sequence[Clock], values: Sequence[int]) -> dict[int, Clock]:
    """Return the clock left of each column, or right of it where no time is left of the first one."""
    if values and values[0] < clocks[0].columns[0] and values[-1] < clocks[-1].columns[0]:
        return {k: next(clock for clock in clocks if clock.columns[0] > k) for k in values}
    return {k: [clocks[0], *(clock for clock in clocks if clock.columns[0] < k)][-1] for k in values}


def _clocks_of(owners: Mapping[int, Clock]) -> tuple[Clock, ...]:
    """Return the clocks of columns, with what is of each of them."""
    clocks = {owner.columns: owner for owner in owners.values()}
    return tuple(
        replace(clock, values=frozenset(k for k, owner in owners.items() if owner.columns == columns))
        for columns, clock in clocks.items()
    )
