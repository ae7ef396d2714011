# SPDX-License-Identifier: Apache-2.0
"""Finds the columns of a table that hold the times of its rows, and the meaning of their cells.

A meaning that the rows make certain is used; one that they leave open is a question for the owner.
"""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from stickslip_logs.arrays import BoolArray, FloatArray, IntArray
from stickslip_logs.errors import MAX_SHOWN, BagError
from stickslip_logs.tables.cell_times import (
    DAY,
    Cells,
    ReadTimes,
    StampLayout,
    Times,
    is_day,
    is_stamp,
    is_time,
    is_time_of_day,
    is_zone,
    number_reader,
    read_time_of_day,
)
from stickslip_logs.time_order import MAX_TIME_NS
from stickslip_logs.units import SECOND_NS

TIME_WORDS = re.compile(
    r'\b(time|timestamp|ts|date|datetime|zeit|datum|uhrzeit|seconds|sec|t|epoch|clock|elapsed'
    r'|millis|micros)\b'
    r'|^(?:ms|us|ns)$'
)
"""Words by which a heading, in lower case, is that of a time."""
_IN_UTC = re.compile(r'(?<![^\W_])(?:UTC|GMT)(?![^\W_])')
_HEADED_ZONE = re.compile(r'\b(?:GMT|UTC) ?[+-]\d\d?(?::?\d\d)?\b')
_OF_ZONE = re.compile(r'\b(?:tz|zone|timezone|utc offset|zeitzone)\b')
# Numbers since a date, where they are dates of 2000 to 2090 [s since 1970]: their unit [ns], what is added
# for 1970, and their name. Those of .NET, Windows and LabVIEW would be of 1990, 1974 and 2092 if since 1970.
_DATES_FROM, _DATES_TO = 946_684_800, 3_786_912_000
_EPOCHS = (
    (1, 0, 'ns since 1970'),
    (100, -621_355_968_000_000_000, '100 ns since the year 1'),
    (100, -116_444_736_000_000_000, '100 ns since 1601'),
    (10**3, 0, 'us since 1970'),
    (10**6, 0, 'ms since 1970'),
    (SECOND_NS, -2_082_844_800, 's since 1904'),
    (SECOND_NS, 0, 's since 1970'),
)
_SPELLED = {
    1: 'ns nanos nanoseconds',
    10**3: 'us µs μs usec micros microseconds',
    10**6: 'ms msec millis milliseconds',
    SECOND_NS: 's sec secs second seconds',
    60 * SECOND_NS: 'min mins minute minutes',
    3600 * SECOND_NS: 'h hr hrs hour hours',
    DAY: 'd day days',
}
TIME_UNITS = {name: unit for unit, names in _SPELLED.items() for name in names.split()}
"""Units of time [ns] by their names in headings, in lower case."""
# Days since the end of 1899, in the years 1954 to 2050, since 1858 (from 2009), since the year 0, and since
# 4713 BC (from 2009): their limits, what is added for 1970, and their name.
_DAYS_SINCE = (
    (20_000, 55_000, -25_569, 'days of a spreadsheet'),
    (55_000, 80_000, -40_587, 'modified Julian days'),
    (713_960, 773_960, -719_529, 'days of MATLAB'),
    (2_455_000, 2_480_000, -2_440_587.5, 'Julian days'),
)
# An eighth of a day: from this step on numbers without a unit would be three hours and more apart as days.
_SECONDS_FROM = 0.125
# Lines a second that a text has at most.
_MAX_RATE = 300.0
MAX_ROWS = 500
"""Rows of the head by which columns of times are found."""
# Of the cells of a column of times more are times; of the rows of parts of a date nearly all.
_MOSTLY, _NEARLY_ALL = 0.5, 0.9
_ZERO_DECIMALS = re.compile(r'[.,]0+$')
# The number of the day of a first row without a date, and how late rows come over midnight [ns].
_FIRST_DAY, _LATE_NS = 10_000, 60 * SECOND_NS
_EMPTY = '', 'nan', 'null', 'none', '-'
# Digits alone may be hours, minutes and seconds.
_WRITE = 'write 060000 as 06:00:00'
WITHOUT_ZONE = 'times have no zone: taken as UTC'
"""Remark on a clock whose distance from UTC is not said."""


@dataclass(frozen=True, slots=True)
class TableColumns:
    """The columns of a table, as far as its head and its tail show them.

    Attributes:
        names: The headings; ``#1``, ``#2``, ... where there are none.
        headings: The words of each in lower case, and its unit as it is written, None where it has none.
        units: The unit of each as the configuration calls it, None where it has none of these.
        decimal: The decimal sign.
        rows: The rows of the head.
        tail: The rows of the tail, without a first one that may be cut.
    """

    names: tuple[str, ...]
    headings: tuple[tuple[str, str | None], ...]
    units: tuple[str | None, ...]
    decimal: str
    rows: tuple[Cells, ...]
    tail: tuple[Cells, ...]

    def rows_with(self, columns: Collection[int]) -> list[Cells]:
        """Return the rows of the first 500 and of the tail that have a cell in all of one column or more.

        The cell may be empty.
        """
        return [row for row in (*self.rows[:MAX_ROWS], *self.tail) if len(row) > max(columns)]


@dataclass(frozen=True, slots=True)
class Clock:
    """The columns that hold a time of the rows, and how they are read.

    Attributes:
        columns: The places of one column, of those of date and time of the day, or of those of their parts.
        read: Reads the cells of these columns.
        remarks: What was guessed, as sentences.
        values: The places of the columns that are measured at this time; None for all.
        is_count: Whether its cells are plain numbers.
        is_of_day: Whether its times are of the day, without a date.
        question: What the owner has to answer, as a clause behind the name of an input; else empty.
    """

    columns: tuple[int, ...]
    read: ReadTimes
    remarks: tuple[str, ...] = ()
    values: frozenset[int] | None = None
    is_count: bool = False
    is_of_day: bool = False
    question: str = ''

    def has_column(self, column: int) -> bool:
        """Return whether the cells of a column are measured at this time."""
        return self.values is None or column in self.values

    def read_rows(self, rows: Sequence[Cells]) -> Times:
        """Return the times of rows, all of which must have a cell in the columns."""
        return self.read([[row[k] for row in rows] for k in self.columns])


def direction_of(time_ns: IntArray) -> int:
    """Return -1 if more than half of the steps between times [ns] are back (newest first), else 1."""
    return -1 if np.count_nonzero(np.diff(time_ns) < 0) > _MOSTLY * time_ns.size else 1


class DayCounter:
    """Counts the days of times of the day from row to row, so that they go on over midnight.

    Attributes:
        first_day: The least number of a day so far.

    Args:
        head_ns: The times of the day of some first rows, which show whether the newest is first [ns].
    """

    def __init__(self, head_ns: IntArray) -> None:
        self._sign = direction_of(head_ns)
        self._last_ns: int | None = None
        # Days before the first row have positive numbers, too.
        self._day = self.first_day = _FIRST_DAY

    def add(self, time_ns: IntArray) -> IntArray:
        """Return the times of the day of the next rows with the days added, shape (n,) [ns].

        The first row of all is of day 10,000, so that days before it are positive; the next call continues.
        A step back by more than half a day leads over midnight; one ahead by nearly a day, which late rows
        make there, leads back.
        """
        if not time_ns.size:
            return time_ns
        step = self._sign * np.diff(time_ns, prepend=time_ns[0] if self._last_ns is None else self._last_ns)
        is_over, is_back = (step < -DAY // 2) & (step > -DAY), (step > DAY - _LATE_NS) & (step < DAY)
        day = self._day + self._sign * np.cumsum(is_over.astype(np.int64) - is_back)
        self._last_ns, self._day = int(time_ns[-1]), int(day[-1])
        self.first_day = min(self.first_day, int(day.min()))
        return time_ns + day * DAY


def counted_from(clock: Clock, start_ns: int) -> Clock:
    """Return a clock that counts the times of another from a start [ns]; earlier cells are no times."""

    def read(columns: Sequence[Cells]) -> Times:
        time_ns, is_timed = clock.read(columns)
        return time_ns - start_ns, is_timed & (time_ns >= start_ns)

    return replace(clock, read=read)


def find_clock(path: Path, table: TableColumns) -> Clock:
    """Find the columns of the time of all rows, by the headings and some rows of a table.

    Of several columns of times :func:`rank_stamps` chooses; dates with times come before times of the
    day, and these before numbers.

    Raises:
        BagError: No column is one, or the one that is headed so, or the first, is empty.
    """
    return _add_fractions(table, _find_whole_times(path, table))


def _find_whole_times(path: Path, table: TableColumns) -> Clock:
    """Find the columns of the time as :func:`find_clock` does, without a column of fractions.

    Raises:
        BagError: As for :func:`find_clock`.
    """
    # A row may lack its last cell.
    width = len(table.names)
    rows = [[*row, ''][:width] for row in table.rows[:MAX_ROWS] if len(row) >= max(width - 1, 1)]
    named = [k for k, (words, _) in enumerate(table.headings) if TIME_WORDS.search(words)]
    stamps = rank_stamps(table, _columns_of(is_stamp, rows))
    changing = [k for k in stamps if k in named or len(rows) == 1 or len({row[k] for row in rows}) > 1]
    days, times = _columns_of(is_day, rows), _columns_of(is_time, rows)
    # Hours that an engine has run are no time of the rows.
    of_day = [k for k in times if k in named or any(is_time_of_day(row[k]) for row in rows)]
    if changing:
        return _clock_of_stamps(table, (changing[0],))
    if days and of_day:
        return _clock_of_stamps(table, (days[0], of_day[0]))
    if clock := _clock_of_parts(table) or _clock_of_unit_columns(table):
        return clock
    if of_day:
        return _clock_of_day_times(table, of_day[0])
    for k in named:
        # Digits alone, as 20260514 and 060000.
        joined = [f'{row[k - 1].strip()} {row[k].strip()}' for row in table.rows_with([k])]
        if k - 1 in named and sum(map(is_stamp, joined)) > _MOSTLY * len(joined):
            return _clock_of_stamps(table, (k - 1, k))
    if clock := _first_clock_of_numbers(path, table, rows, named):
        return _clock_since_midnight(table, clock, days[0]) if days else clock
    if stamps:
        return _clock_of_stamps(table, (stamps[0],))
    if times:
        return _clock_of_day_times(table, times[0])
    raise BagError(_missing_times_text(path, table, rows, named, days))


def _add_fractions(table: TableColumns, clock: Clock) -> Clock:
    """Return a clock that adds a column of milliseconds, or of seconds, to times that are whole without it.

    Such a column is headed by a unit of time, is below the second or minute to which all times are written,
    and in nearly all rows rises within one and falls to the next. Head and tail decide. A remark of
    the new clock names it. Without one the clock itself is returned.
    """
    rows = table.rows_with(range(len(table.names)))
    time_ns, is_timed = clock.read_rows(rows)
    rows, time_ns = list(itertools.compress(rows, is_timed.tolist())), time_ns[is_timed]
    whole_steps = np.diff(time_ns)
    whole_ns = next((unit for unit in (60 * SECOND_NS, SECOND_NS) if not (time_ns % unit).any()), 0)
    for k in range(len(table.names)) if 0 in whole_steps else ():
        unit = _unit_of_times(*table.headings[k])
        if k in clock.columns or TIME_UNITS.get(unit, DAY) > whole_ns:
            continue
        read_fraction = number_reader(TIME_UNITS[unit], 0, table.decimal)
        fraction_ns, is_there = read_fraction([[row[k] for row in rows]])
        steps = np.diff(time_ns + fraction_ns)
        is_part = is_there.all() and fraction_ns.min() >= 0 and fraction_ns.max() < whole_ns
        # From one second to the next it falls, else it is a counter of something else.
        is_next = (steps >= 0) & ((whole_steps == 0) | (steps < whole_steps))
        if is_part and is_next.mean() > _NEARLY_ALL and steps[whole_steps == 0].any():
            read = partial(_read_sum, [clock.read, read_fraction])
            remark = f"'{table.names[k]}' has the {unit} of the times"
            return replace(clock, columns=(*clock.columns, k), read=read, remarks=(*clock.remarks, remark))
    return clock


def _columns_of(is_kind: Callable[[str], bool], rows: Sequence[Cells]) -> list[int]:
    """Return the places of the columns in which more than half of the cells are of a kind."""
    counts = [sum(map(is_kind, cells)) for cells in zip(*rows, strict=False)]
    return [k for k, count in enumerate(counts) if count > _MOSTLY * len(rows)]


def _missing_times_text(
    path: Path, table: TableColumns, rows: Sequence[Cells], named: Sequence[int], days: Sequence[int]
) -> str:
    """Return the error text that no column of a table is a time, with a cell that should be one.

    ``named`` has the places of columns headed as times, ``days`` those of dates.
    """
    if days:
        return (
            f"log '{path}': column '{table.names[days[0]]}' has dates without a time of the day: nothing can"
            ' be judged by one line a day; write times such as 2026-05-04T06:00:00Z'
        )
    listed = ', '.join(f"'{name}'" for name in table.names[:10])
    shown = next((row[k] for row in rows for k in (*named, 0) if row[k].strip()), '')
    return (
        f"log '{path}': no column is a time among {listed}: the first must be, or one headed 'time';"
        f" write times such as 2026-05-04T06:00:00Z, not as '{shown[:MAX_SHOWN]}'"
    )


def rank_stamps(table: TableColumns, columns: Sequence[int]) -> list[int]:
    """Return columns of dates with times, the one that is most likely the time of the rows first.

    A column of less than half as many different dates as another, as of an arrival or in the name of a file,
    comes last. Before others come one headed as UTC,
    which ships write beside their zone time, then one headed as a time, then by place.
    """
    counts = {k: len({row[k] for row in table.rows[:MAX_ROWS] if k < len(row)}) for k in columns}
    return sorted(
        columns,
        key=lambda k: (
            2 * counts[k] < max(counts.values()),
            not _IN_UTC.search(table.names[k]),
            not TIME_WORDS.search(table.headings[k][0]),
            k,
        ),
    )


def _clock_of_day_times(table: TableColumns, column: int) -> Clock:
    """Return the clock of a column with times of the day, or since a start; a remark says it has no date.

    Times of two parts are read as hours and minutes, which is a question. A cell at least is not empty.
    """
    remark = f"times in '{table.names[column]}' are of the day, without a date"
    cells = [row[column].strip() for row in table.rows if len(row) > column and row[column].strip()]
    question = (
        f"has times such as '{cells[0]}', read as hours: write {cells[0]}:00, or 00:{cells[0]} for minutes"
    )
    is_short = all(cell.count(':') == 1 for cell in cells)
    return Clock((column,), read_time_of_day, (remark,), is_of_day=True, question=question * is_short)


def _clock_of_stamps(table: TableColumns, columns: tuple[int, ...]) -> Clock:
    """Return the clock of dates with times in one column, or in one of dates and one of times.

    The zones of a further column belong to it; what a column that is headed as a zone has else is a question.
    """
    zone = _HEADED_ZONE.search(' '.join(table.names[k] for k in columns))
    layout = _layout_of(table, columns, zone[0] if zone else '')
    for k in [] if layout.has_zone else [k for k in range(len(table.names)) if k not in columns]:
        is_headed = bool(_OF_ZONE.search(table.headings[k][0]))
        cells = {row[k].strip() for row in table.rows_with([k])} - {''}
        with_zone = _layout_of(table, (*columns, k))
        if with_zone.has_zone and (is_headed or all(map(is_zone, cells))):
            return _clock_of_layout((*columns, k), with_zone)
        if is_headed and cells:
            question = (
                f"has beside its times column '{table.names[k]}' with '{min(cells)}', which was not used:"
                ' write it as +02:00'
            )
            return replace(_clock_of_layout(columns, layout), question=layout.question or question)
    return _clock_of_layout(columns, layout)


def _layout_of(table: TableColumns, columns: Sequence[int], zone: str = '') -> StampLayout:
    """Return the layout of the joined texts of columns; ``zone`` is that of their headings."""
    rows = table.rows_with(columns)
    return StampLayout([' '.join(row[k].strip() for k in columns) for row in rows], zone)


def _clock_of_layout(columns: tuple[int, ...], layout: StampLayout) -> Clock:
    """Return the clock of columns whose dates have a layout.

    Its remarks are the question of the layout, which is its own as well, and a missing zone.
    """
    remarks = [f'the log {layout.question}'] if layout.question else []
    remarks += [] if layout.has_zone else [WITHOUT_ZONE]
    return Clock(columns, layout.read, tuple(remarks), question=layout.question)


def _clock_of_parts(table: TableColumns) -> Clock | None:
    """Return the clock of adjacent columns that hold year, month, day, hour, ...; None where none do.

    Joined, nearly all of their cells must be dates with a year of four digits, in order. A
    last column of seconds belongs to them if it is headed so, or if the rows differ by it alone.
    """
    rows = table.rows_with(range(len(table.names)))
    for first, count, day_count in itertools.product(range(len(table.names)), (6, 5, 4, 3), (3, 2, 1)):
        columns = tuple(range(first, first + count))
        if not rows or columns[-1] >= len(table.names):
            continue
        # The first row rules out nearly all columns.
        texts = _join_parts([[rows[0][k]] for k in columns], day_count)
        if not is_stamp(texts[0]):
            continue
        texts = _join_parts([[row[k] for row in rows] for k in columns], day_count)
        layout = StampLayout(texts)
        time_ns, is_timed = layout.read([texts])
        steps = np.diff(time_ns[is_timed])
        if is_timed.mean() <= _NEARLY_ALL or not (len(rows) == 1 or _are_in_order(steps)):
            continue
        shorter = _join_parts([[row[k] for row in rows] for k in columns[:-1]], day_count)
        is_finest = table.headings[columns[-1]][0] in _SPELLED[SECOND_NS].split()
        if not is_finest and all(map(is_stamp, shorter)) and (np.diff(layout.read([shorter])[0]) > 0).all():
            continue
        return replace(_clock_of_layout(columns, layout), read=partial(_read_parts, layout, day_count))
    return None


def _clock_of_unit_columns(table: TableColumns) -> Clock | None:
    """Return the clock of adjacent columns headed as hours, minutes and seconds, the sum of all three.

    None without them.
    """
    units = [TIME_UNITS.get(words, 0) for words, _ in table.headings]
    for first in range(len(units) - 2):
        columns = first, first + 1, first + 2
        if [units[k] for k in columns] == [3600 * SECOND_NS, 60 * SECOND_NS, SECOND_NS]:
            read = partial(_read_sum, [number_reader(units[k], 0, table.decimal) for k in columns])
            remark = f"times are the sum of '{table.names[first]}' and the next two columns, without a date"
            return Clock(columns, read, (remark,), is_of_day=True)
    return None


def _are_in_order(steps: IntArray) -> bool:
    """Return whether hardly any of some steps between times goes the other way, oldest or newest first.

    False where no two times differ.
    """
    back, ahead = np.count_nonzero(steps < 0), np.count_nonzero(steps > 0)
    return bool(back + ahead) and bool(min(back, ahead) <= (1.0 - _NEARLY_ALL) * steps.size)


def _read_sum(reads: Sequence[ReadTimes], columns: Sequence[Cells]) -> Times:
    """Return the sums of times in columns [ns], and in which rows all of them are times.

    The last readers have one column each, the first has the others.
    """
    first = len(columns) - len(reads) + 1
    times = [reads[0](columns[:first])]
    times += [read([cells]) for read, cells in zip(reads[1:], columns[first:], strict=True)]
    sums: IntArray = np.add.reduce([time_ns for time_ns, _ in times])
    are_all: BoolArray = np.logical_and.reduce([is_timed for _, is_timed in times])
    return sums, are_all


def _read_parts(layout: StampLayout, day_count: int, columns: Sequence[Cells]) -> Times:
    """Return the times of parts in columns, the largest part first, the first ``day_count`` of the date."""
    return layout.read([_join_parts(columns, day_count)])


def _join_parts(columns: Sequence[Cells], day_count: int) -> list[str]:
    """Return a text for each row: a date with a time where the columns hold its parts, else some other text.

    The largest part comes first. The first ``day_count`` columns are the date: 3 for year, month and day, 2
    for year and day of the year, 1 for a whole date. A row without a year of four digits becomes an empty
    text.
    """
    texts = []
    for row in zip(*columns, strict=True):
        cells = [_ZERO_DECIMALS.sub('', cell.strip()) for cell in row]
        # '6', '0' and '5.25' are 06:00:05.25.
        padded = ['0' + cell if cell[1:2] in ('', '.', ',') else cell for cell in cells]
        day = cells[:day_count] if day_count != 2 else [cells[0], cells[1].zfill(3)]
        has_year = day_count == 1 or any(len(cell) == 4 for cell in day)
        texts.append(
            f'{(":" if day_count == 2 else "-").join(day)} {":".join(padded[day_count:])}' * has_year
        )
    return texts


def _first_clock_of_numbers(
    path: Path, table: TableColumns, rows: Sequence[Cells], named: Sequence[int]
) -> Clock | None:
    """Return the clock of the first column of numbers that is headed as a time, else of column 0.

    None where the numbers of none of them look like times.

    Raises:
        BagError: A column that is headed so, or the first, is empty, so that no other may stand for it.
    """
    for k in named:
        if clock := clock_of_numbers(table, rows, k, is_named=True):
            return clock
    for k in (*named, 0):
        if rows and all(row[k].strip().lower() in _EMPTY for row in rows):
            raise BagError(
                f"log '{path}': column '{table.names[k]}' is empty in the first {len(rows)} lines: leave"
                ' these out, or write times such as 2026-05-04T06:00:00Z there'
            )
    return clock_of_numbers(table, rows, 0, is_named=False)


def _clock_since_midnight(table: TableColumns, clock: Clock, day: int) -> Clock:
    """Return the clock of dates and numbers that count from midnight, as a heading with 'day' says.

    Else return the clock of the numbers alone: with a question, if they do not begin at zero and are below a
    day, unless the heading has 'elapsed'.
    """
    columns = day, *clock.columns
    name, words = table.names[columns[1]], table.headings[columns[1]][0].split()
    if 'day' not in words:
        time_ns, is_timed = clock.read_rows(table.rows_with(columns))
        may_be_of_day = ((time_ns >= SECOND_NS) & (time_ns <= DAY))[is_timed].all() and 'elapsed' not in words
        question = (
            f"has dates beside '{name}', which may count from midnight or from a start:"
            f" head it 'time of day [s]' or 'elapsed [s]', or {_WRITE}"
        )
        return replace(clock, question=clock.question or question) if may_be_of_day else clock
    layout = StampLayout([f'{row[day].strip()} 00:00:00' for row in table.rows_with(columns)])

    def read_days(cells: Sequence[Cells]) -> Times:
        return layout.read([[f'{cell.strip()} 00:00:00' for cell in cells[0]]])

    dated = _clock_of_layout(columns, layout)
    remark = f"times are '{table.names[day]}' and, from midnight on, '{name}'"
    read = partial(_read_sum, [read_days, clock.read])
    return replace(dated, read=read, remarks=(remark, *dated.remarks))


def clock_of_numbers(
    table: TableColumns, rows: Sequence[Cells], column: int, *, is_named: bool
) -> Clock | None:
    """Return the clock of a column of numbers by some rows; None where they do not look like times.

    What its numbers, but the least and the largest of five and more, were taken for is in its remarks; if
    they may be something else, it has a question. If it is not headed as a time, its numbers must rise or
    fall throughout, differ in most rows, and have no unit of the configuration.
    """
    numbers = [_number_of(row[column], table.decimal) for row in rows if column < len(row)]
    values = np.array([value for value in numbers if math.isfinite(value)])
    if values.size <= _MOSTLY * len(numbers) or np.abs(values).max() >= MAX_TIME_NS:
        return None
    steps, count = np.diff(values), np.unique(values).size
    # In a log of one value a line several names share a time; seconds since 1970 are known all the same.
    is_fine = count > _MOSTLY * values.size or (count > 1 and values.min() > _DATES_FROM)
    is_steady = bool((steps >= 0).all() or (steps <= 0).all())
    if not is_named and (table.units[column] is not None or not is_steady or not is_fine):
        return None
    heading = table.names[column]
    if values.size > 4:  # one of them may be damaged
        values = np.delete(values, [values.argmin(), values.argmax()])
    unit_ns, zero, meaning, question = _meaning_of_numbers(*table.headings[column], values)
    remarks = (f"times in '{heading}' are {meaning}",)
    read = number_reader(unit_ns, zero, table.decimal)
    return Clock((column,), read, remarks, is_count=True, question=question)


def _meaning_of_numbers(words: str, written: str | None, values: FloatArray) -> tuple[int, float, str, str]:
    """Find the unit, zero and meaning of n > 0 finite numbers by the words and the unit of their heading.

    Returns:
        Their unit [ns]; what is added to them, in that unit, for times since 1970 or a start; their meaning
        in words; and a question on it, empty where it is certain.
    """
    unit, largest = _unit_of_times(words, written), float(np.abs(values).max())
    unit_ns = TIME_UNITS.get(unit, SECOND_NS)
    # With a unit in which they are no dates they count from a start.
    is_elapsed = unit != '' and largest * unit_ns < _DATES_FROM * SECOND_NS
    for factor, begin, name in () if is_elapsed else _EPOCHS:
        if _DATES_FROM <= (largest + begin) * factor / SECOND_NS < _DATES_TO:
            return factor, begin, name, ''
    elapsed, steps = f'{unit or "s"} since the start', np.abs(np.diff(values))
    step = float(np.median(steps[steps > 0])) if steps.any() else 0.0
    question = (
        f"has times without a unit, {step:.3g} apart: head them 'time [s]', 'time [min]' or 'time [d]', or"
        f' {_WRITE}'
    )
    question *= unit == '' and step > 0.0
    for minimum, maximum, zero, name in _DAYS_SINCE if unit == '' or unit_ns == DAY else ():
        if minimum < values.min() and largest < maximum:
            days = f'{name}, without a zone: taken as UTC'
            if unit != '' or re.search(r'date|datum', words):
                return DAY, zero, days, ''
            # A question names first what the numbers are taken for.
            if _are_days_apart(step):
                question = (
                    f"has times that may be {name} or {elapsed}: head them 'date' or 'time [s]', or {_WRITE}"
                )
                return DAY, zero, days, question * (step * _MAX_RATE >= 1.0)
            question = (
                f"has times that may be {elapsed} or {name}: head them 'time [s]' or 'date', or {_WRITE}"
            )
    return unit_ns, 0, elapsed, question


def _are_days_apart(step: float) -> bool:
    """Return whether the usual step between numbers without a unit is one of days rather than of seconds.

    It is below three hours, and in seconds no whole number of lines a second, but for multiples of three.
    """
    rate = 1.0 / step if step > 0.0 else 0.0
    return rate > 1.0 / _SECONDS_FROM and (not _is_whole(rate) or _is_whole(rate / 3.0))


def _is_whole(rate: float) -> bool:
    """Return whether a rate is a whole number from 1 on, as far as decimals show it."""
    return round(rate) > 0 and abs(rate - round(rate)) < 0.02


def _unit_of_times(words: str, written: str | None) -> str:
    """Return the unit of time in a heading, in lower case: in brackets, all of it, or its last word; else ''.

    >>> _unit_of_times('elapsed ms', 'rpm'), _unit_of_times('millis', None), _unit_of_times('time', 's')
    ('ms', 'millis', 's')
    """
    first, _, rest = words.partition(' ')
    last = rest.rpartition(' ')[2]
    # The last word of a time of day is no unit.
    candidates = (written or '').lower(), rest, '' if rest else first, last if last != 'day' else ''
    return next((text for text in candidates if text in TIME_UNITS), '')


def _number_of(cell: str, decimal: str) -> float:
    """Return a cell as a number, which may be infinite; NaN for none."""
    try:
        # What Python takes for digits, as in '1_000', is a word in a table.
        return float(cell.replace(decimal, '.').replace('_', 'x'))
    except ValueError:
        return math.nan
