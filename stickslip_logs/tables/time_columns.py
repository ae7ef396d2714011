# SPDX-License-Identifier: Apache-2.0
"""The time of a table: which columns it is in, and how dates, times and numbers in cells are read.

All become nanoseconds since 1970, or since the start, exactly.
"""

from __future__ import annotations

import contextlib
import itertools
import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from datetime import date
from decimal import Decimal
from pathlib import Path

import numpy as np

from stickslip_logs.arrays import BoolArray, FloatArray, IntArray
from stickslip_logs.errors import BagError

Cells = Sequence[str]
SECOND, DAY = 10**9, 86_400 * 10**9
Times = tuple[IntArray, BoolArray]
"""Times [ns] and which cells hold one, shape (n,)."""
ReadTimes = Callable[[Sequence[Cells]], Times]
"""Reads the times of some columns of cells."""

_MONTHS = 'jan feb mar/mär/mrz apr may/mai jun jul aug sep oct/okt nov dec/dez'
_MONTH = {name: k for k, names in enumerate(_MONTHS.split(), 1) for name in names.split('/')}
_CLOCK = (
    r'(?P<H>\d{1,2}):(?P<M>\d\d)(?::(?P<S>\d\d)(?:[.,](?P<f>\d{1,9})\d*)?)?'
    r'\s*(?P<half>[AaPp]\.?[Mm]\.?)?'
)
_ZONE = r'\s*(?P<z>Z|UTC|GMT|[+-]\d\d(?::?\d\d)?)?'
_DATES = (
    r'(?P<Y>\d{4})[-/.](?P<m>\d\d?)[-/.](?P<d>\d\d?)',
    r'(?P<a>\d\d?)(?P<sep>[-/.])(?P<b>\d\d?)[-/.](?P<Y>\d{4}|\d\d)',
    r'(?P<d>\d\d?)[- .](?P<name>[A-Za-zä]{3})[a-z]*[- ,.]+(?P<Y>\d{4}|\d\d)',
    r'(?P<name>[A-Za-zä]{3})[a-z]*[- ](?P<d>\d\d?)[- ,]+(?P<Y>\d{4})',
    r'(?P<Y>\d{4})(?P<m>\d\d)(?P<d>\d\d)',
)
# ISO 8601 without separators, and names of files and exports: 20260504T060000Z, 20260504_060000.
_COMPACT = (
    _DATES[-1]
    + r'[T _-]?(?P<H>\d\d)(?P<M>\d\d)(?P<S>\d\d)(?:[.,]?(?P<f>(?<=[.,])\d{1,9}|(?<=\d{14})\d{3}$)\d*)?'
)
_STAMPS = [
    *(re.compile(f'{day}(?:[T ]+|, ?|-){_CLOCK}{_ZONE}') for day in _DATES),
    re.compile(_COMPACT + _ZONE),
    # The same of two digits of the year, 260504_060000.
    re.compile(
        r'(?P<a>\d\d)(?P<sep>)(?P<b>\d\d)(?P<Y>\d\d)[T _-](?P<H>\d\d)(?P<M>\d\d)(?P<S>\d\d)'
        r'(?:[.,](?P<f>\d{1,9})\d*)?' + _ZONE
    ),
    # As C and Unix write it: Mon May  4 06:00:00 UTC 2026.
    re.compile(
        rf'(?:[A-Z][a-z]{{2}} +)?(?P<name>[A-Za-z]{{3}}) +(?P<d>\d\d?) +{_CLOCK}{_ZONE} +(?P<Y>\d{{4}})'
    ),
    # The day of the year, as ISO 8601 and the loggers of research ships have it: 2026:124:06:00:00.
    re.compile(rf'(?P<Y>\d{{4}})[-:](?P<j>\d{{3}})[T :]{_CLOCK}{_ZONE}'),
]
# Eight digits alone may be a number.
_DAYS = [re.compile(day) for day in _DATES[:-1]]
_TIME = re.compile(_CLOCK + _ZONE)
_SINCE_START = re.compile(r'(\d{2,4}):([0-5]\d):([0-5]\d)(?:[.,](\d{1,9}))?')
# Of the year 2116: two later times would have no sum of 64 bits [ns].
_MOST = 1 << 62
_EPOCH = date(1970, 1, 1).toordinal()
NAMED = re.compile(
    r'\b(time|timestamp|ts|date|datetime|zeit|datum|uhrzeit|seconds|sec|t|epoch|clock|elapsed'
    r'|millis|micros)\b'
    r'|^(?:ms|us|ns)$'
)
_IN_UTC = re.compile(r'(?<![^\W_])(?:UTC|GMT)(?![^\W_])')
_HEADED_ZONE = re.compile(r'\b(?:GMT|UTC) ?([+-]\d\d:?\d\d)')
# Numbers since a date by their size: the least, the unit [ns], what makes it 1970, and their name.
# Those of .NET, Windows and LabVIEW would be dates of 1990, 1974 and 2092 if they were since 1970.
_SINCE = (
    (7e17, 1, 0, 'ns since 1970'),
    (6e17, 100, -621_355_968_000_000_000, '100 ns since the year 1'),
    (1e17, 100, -116_444_736_000_000_000, '100 ns since 1601'),
    (1e14, 10**3, 0, 'us since 1970'),
    (1e11, 10**6, 0, 'ms since 1970'),
    (3e9, SECOND, -2_082_844_800, 's since 1904'),
    (1e8, SECOND, 0, 's since 1970'),
)
_SPELLED = {
    1: 'ns nanos nanoseconds',
    10**3: 'us µs μs usec micros microseconds',
    10**6: 'ms msec millis milliseconds',
    SECOND: 's sec secs second seconds',
    60 * SECOND: 'min mins minute minutes',
    3600 * SECOND: 'h hr hrs hour hours',
    DAY: 'd day days',
}
_UNITS = {name: unit for unit, names in _SPELLED.items() for name in names.split()}
# Days since the end of 1899, of the years 1954 to 2119, as spreadsheets count, and those since the
# year 0 of MATLAB: the limits, what makes them 1970, and their name.
_DAYS_SINCE = (
    (20_000, 80_000, -25_569, 'days of a spreadsheet'),
    (713_960, 773_960, -719_529, 'days of MATLAB'),
)
# Without a heading that says so: as seconds these numbers would be 10,000 and more a second [s], or
# they are whole seconds of days but not of five decimals and no whole number a second, up to 300, or lines
# each so many seconds, as far as their decimals tell.
_PARTS_OF_DAYS, _HIGHEST_RATE = 1e-4, 300.0
_EVERY, _EVERY_MINUTES = (10, 12, 15, 20, 30, 60, 120), (180, 300, 600, 900, 1200, 1800, 3600, 7200)
# Days of six decimals are that close to whole seconds [s]; of numbers by chance a tenth is.
_WHOLE_SECOND = 0.05
# So far apart without a unit, numbers are milliseconds as likely as seconds: of 100 Hz or of a slow log.
_LEAST_GAP_OF_MILLISECONDS = 10.0
# From this distance on days would be three hours and more, and seconds are likelier.
_LEAST_GAP_OF_SECONDS = 0.125
_MAX_ROWS = 500
_MOST_SHOWN = 60
# Of the cells of a column of times more are times; of rows of parts of a date nearly all.
_MOSTLY, _ALMOST_ALL = 0.5, 0.9
_WHOLE = re.compile(r'[.,]0+$')
_DIGITS_OF_DAY = re.compile(r'(?:[01]?\d|2[0-4])[0-5]\d[0-5]\d')
_EMPTY = '', 'nan', 'null', 'none', '-'
WITHOUT_ZONE = 'times have no zone: taken as UTC'


@dataclass(frozen=True, slots=True)
class TableColumns:
    """The columns of a table, as far as its head and its tail show them.

    Attributes:
        names: The headings; ``#1``, ``#2``, ... where there are none.
        headings: Of each its words in lower case, and its unit as it is written.
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


@dataclass(frozen=True, slots=True)
class Clock:
    """The columns of a time, what reads them, and what was guessed of them.

    Attributes:
        columns: Of the time: one, those of the date and of the time of the day, or those of their parts.
        read: Reads the cells of these columns.
        said: What was guessed.
        values: The columns whose cells are of this time; None for all.
        is_count: Whether its cells are plain numbers.
        question: What the owner has to answer, as a clause behind the name of an input; else empty.
    """

    columns: tuple[int, ...]
    read: ReadTimes
    said: tuple[str, ...] = ()
    values: frozenset[int] | None = None
    is_count: bool = False
    question: str = ''

    def times(self, column: int) -> bool:
        """Return whether the cells of a column are of this time."""
        return self.values is None or column in self.values


def begun_at(clock: Clock, zero_ns: int) -> Clock:
    """Return a clock that counts from a time of another [ns]; earlier cells hold no time of it."""

    def read(columns: Sequence[Cells]) -> Times:
        time_ns, good = clock.read(columns)
        return time_ns - zero_ns, good & (time_ns >= zero_ns)

    return replace(clock, read=read)


def find_clock(path: Path, table: TableColumns) -> Clock:
    """Find the columns of the time of the rows, by the headings and some rows of a table.

    The path is only for the error.

    Raises:
        BagError: No column is one, or the one that is headed so is empty.
    """
    rows = long_rows(table)
    named = [k for k, (words, _) in enumerate(table.headings) if NAMED.search(words)]
    stamps = likeliest_first(table, _columns_of(table, rows, is_stamp))
    running = [k for k in stamps if k in named or len(rows) == 1 or len({row[k] for row in rows}) > 1]
    days, times = _columns_of(table, rows, is_day), _columns_of(table, rows, is_time)
    # Hours that an engine has run are no time of the lines.
    usable = [k for k in times if k in named or any(_TIME.fullmatch(row[k].strip()) for row in rows)]
    clock = None
    if running or (days and usable):
        clock = _stamp_clock(table, rows, (running[0],) if running else (days[0], usable[0]))
    clock = clock or _clock_of_parts(table, rows)
    if clock is None and usable:
        clock = _time_of_day_clock(table, usable[0])
    clock = clock or _clock_of_digits(table, rows, named) or _clock_of_numbers(path, table, rows, named)
    if clock is None and stamps:
        clock = _stamp_clock(table, rows, (stamps[0],))
    if clock is None and times:
        clock = _time_of_day_clock(table, times[0])
    if clock is not None:
        return clock
    if days:
        raise BagError(
            f"log '{path}': column '{table.names[days[0]]}' has dates without a time of the day: nothing can"
            ' be judged by one line a day; write times such as 2026-05-04T06:00:00Z'
        )
    listed = ', '.join(f"'{name}'" for name in table.names[:10])
    shown = next((row[k] for row in rows for k in (*named, 0) if row[k].strip()), '')
    raise BagError(
        f"log '{path}': no column is a time among {listed}: the first must be, or one headed 'time';"
        f" write times such as 2026-05-04T06:00:00Z, not as '{shown[:_MOST_SHOWN]}'"
    )


def long_rows(table: TableColumns) -> list[Cells]:
    """Return the first rows of a table, each with all of its cells; one that lacks the last has it empty."""
    width = len(table.names)
    return [
        row if len(row) >= width else [*row, '']
        for row in table.rows[:_MAX_ROWS]
        if len(row) >= max(width - 1, 1)
    ]


def _columns_of(table: TableColumns, rows: Sequence[Cells], is_kind: Callable[[str], bool]) -> list[int]:
    """Return the columns of which most cells are of a kind."""
    counts = [sum(is_kind(row[k]) for row in rows) for k in range(len(table.names))]
    return [k for k, count in enumerate(counts) if count > _MOSTLY * len(rows)]


def likeliest_first(table: TableColumns, stamps: Sequence[int]) -> list[int]:
    """Return columns of dates with times, the most likely one of the rows first.

    Of an arrival or the name of a file all rows, or many, have one. InfluxDB has the limits of the
    query beside the time, ships the time of the zone they are in.
    """
    counts = {k: len({row[k] for row in table.rows[:_MAX_ROWS] if k < len(row)}) for k in stamps}
    return sorted(
        stamps,
        key=lambda k: (
            2 * counts[k] < max(counts.values()),
            table.names[k] != '_time',
            not _IN_UTC.search(table.names[k]),
            not NAMED.search(table.headings[k][0]),
            k,
        ),
    )


def _time_of_day_clock(table: TableColumns, k: int) -> Clock:
    """Return the clock of times of the day, or since a start."""
    return Clock((k,), read_time_of_day, (f"times in '{table.names[k]}' are of the day, without a date",))


def _stamp_clock(table: TableColumns, rows: Sequence[Cells], columns: tuple[int, ...]) -> Clock:
    """Return the clock of dates with times in one column, or in two."""
    last_place = max(columns)
    complete_rows = [row for row in (*rows, *table.tail) if len(row) > last_place]
    zone = _HEADED_ZONE.search(' '.join(table.names[k] for k in columns))
    return _clock_of_layout(
        columns,
        StampLayout(
            [' '.join(row[k].strip() for k in columns) for row in complete_rows], zone[1] if zone else ''
        ),
    )


def _clock_of_layout(columns: tuple[int, ...], layout: StampLayout) -> Clock:
    """Return the clock of columns with dates of a layout, with what was guessed and is asked."""
    remarks = [layout.guess] if layout.guess else []
    if not layout.has_zone:
        remarks.append(WITHOUT_ZONE)
    return Clock(columns, layout.read, tuple(remarks), question=layout.question)


def _clock_of_parts(table: TableColumns, rows: Sequence[Cells]) -> Clock | None:
    """Return the clock of columns beside each other for year, day, hour and so on; None where there are none.

    Their numbers make them certain: joined, they are dates of four digits of a year that do not go back.
    Seconds are one of them only where minutes alone do not tell the rows apart, or by their heading.
    """
    ends = [row for row in (*rows, *table.tail) if len(row) >= len(table.names)]
    for begin, count, day_count in itertools.product(range(len(table.names) - 2), (6, 5, 4, 3), (3, 2, 1)):
        columns = tuple(range(begin, begin + count))
        if columns[-1] >= len(table.names) or not ends:
            continue
        texts = _join_parts([[row[k] for row in ends] for k in columns], day_count)
        if sum(map(is_stamp, texts)) <= _ALMOST_ALL * len(ends):
            continue
        layout = StampLayout(texts)
        time_ns, is_timed = layout.read([texts])
        steps = np.diff(time_ns[is_timed])
        is_needed = table.headings[columns[-1]][0] in _SPELLED[SECOND].split()
        shorter = _join_parts([[row[k] for row in ends] for k in columns[:-1]], day_count)
        if (steps < 0).mean() > 1.0 - _ALMOST_ALL or not (steps > 0).any():
            continue
        if not is_needed and all(map(is_stamp, shorter)) and (np.diff(layout.read([shorter])[0]) > 0).all():
            continue

        def read(cells: Sequence[Cells], days: int = day_count, layout: StampLayout = layout) -> Times:
            return layout.read([_join_parts(cells, days)])

        return replace(_clock_of_layout(columns, layout), read=read)
    return None


def _join_parts(columns: Sequence[Cells], day_count: int) -> list[str]:
    """Return dates with times as texts, of columns of their parts; what is no date for other numbers.

    Args:
        columns: The cells of each part.
        day_count: How many of them are of the date: year, month and day, year and day of the year, or all.
    """
    texts = []
    for row in zip(*columns, strict=True):
        cells = [_WHOLE.sub('', cell.strip()) for cell in row]
        day, time = cells[:day_count], cells[day_count:]
        if day_count > 1 and not any(len(cell) == 4 for cell in day):
            day = []
        if day_count == 2 and day:
            day[1] = day[1].zfill(3)
        # '6', '0' and '5.25' are 6:00:05.25.
        time = (
            [time[0], *('0' + cell if cell[1:2] in ('', '.', ',') else cell for cell in time[1:])]
            if time
            else []
        )
        texts.append((':' if day_count == 2 else '-').join(day) + ' ' + ':'.join(time))
    return texts


def _clock_of_digits(table: TableColumns, rows: Sequence[Cells], named: Sequence[int]) -> Clock | None:
    """Return the clock of a date and a time of digits alone, as 20260504 and 060000; None where none are."""
    for k in named:
        pairs = [f'{row[k].strip()} {row[k + 1].strip()}' for row in rows if k + 1 < len(row)]
        if k + 1 in named and sum(map(is_stamp, pairs)) > _MOSTLY * len(rows):
            return _stamp_clock(table, rows, (k, k + 1))
        if not _are_digits_of_day([row[k].strip() for row in rows]):
            continue
        dated = [f'{row[k - 1].strip()} {_with_colons(row[k])}' for row in rows] if k else []
        if sum(map(is_stamp, dated)) <= _MOSTLY * len(rows):
            clock = _time_of_day_clock(table, k)
        else:
            clock = _clock_of_layout((k - 1, k), StampLayout(dated))
        return _with_digits_read(clock)
    return None


def _with_digits_read(clock: Clock) -> Clock:
    """Return a clock that reads times of the day of digits in its last column, as 060059."""
    return replace(clock, read=lambda columns: clock.read([*columns[:-1], [*map(_with_colons, columns[-1])]]))


def _are_digits_of_day(cells: Cells) -> bool:
    """Return whether numbers are hours, minutes and seconds, as 60059 before 60100 is.

    Their steps as times are then more alike than as numbers.
    """
    if not cells or not all(_DIGITS_OF_DAY.fullmatch(cell) for cell in cells):
        return False
    number = np.array([*map(int, cells)])
    steps = np.diff(number), np.diff(number // 10_000 * 3600 + number // 100 % 100 * 60 + number % 100)
    return len(cells) > 2 and bool(np.std(steps[1]) < np.std(steps[0]))


def _with_colons(cell: str) -> str:
    """Return digits of a time of the day as 06:00:59; another text is no such time."""
    digits = cell.strip().zfill(6)
    return f'{digits[:2]}:{digits[2:4]}:{digits[4:]}'


def _clock_of_numbers(
    path: Path, table: TableColumns, rows: Sequence[Cells], named: Sequence[int]
) -> Clock | None:
    """Return the clock of a column of numbers, headed as a time or the first; None where none is one.

    Raises:
        BagError: The one that is headed so is empty.
    """
    for k in named:
        if (clock := number_clock(table, rows, k, is_named=True)) is not None:
            return clock
    empty = [k for k in named if rows and all(row[k].strip().lower() in _EMPTY for row in rows)]
    if empty:
        raise BagError(
            f"log '{path}': column '{table.names[empty[0]]}' is empty in the first {len(rows)} lines: leave"
            ' these out, or write times such as 2026-05-04T06:00:00Z there'
        )
    return number_clock(table, rows, 0, is_named=False)


def number_clock(table: TableColumns, rows: Sequence[Cells], k: int, *, is_named: bool) -> Clock | None:
    """Return the clock of a column of numbers; None where they do not look like times."""
    numbers = [_leading_number(row[k], table.decimal) for row in rows if k < len(row)]
    values = np.array([value for value in numbers if math.isfinite(value)])
    if not values.size or values.size <= _MOSTLY * len(numbers) or np.abs(values).max() >= _MOST:
        return None
    is_rising = bool((np.diff(values) >= 0).all() or (np.diff(values) <= 0).all())
    # In a log of one value a line several names share a time; of seconds since 1970 that is known.
    count = np.unique(values).size
    is_fine = count > _MOSTLY * values.size or (count > 1 and values.min() > _SINCE[-1][0])
    if not is_named and (table.units[k] is not None or not is_rising or not is_fine):
        return None
    factor, zero, remark, question = _meaning_of_numbers(*table.headings[k], values)
    if not is_named and zero == 0 and (np.diff(values) == 1.0).all():
        question = (
            f"has the times of '{table.names[k]}', which may number the lines only: head it 'time [s]' if not"
        )
    return Clock(
        (k,),
        scaled_reader(factor, zero, table.decimal),
        (f"times in '{table.names[k]}' are {remark}",),
        is_count=True,
        question=question,
    )


def _meaning_of_numbers(words: str, written: str | None, values: FloatArray) -> tuple[int, int, str, str]:
    """Return what numbers of a column of times are.

    Args:
        words: The words of the heading.
        written: The unit in it as it is written; None for none.
        values: The numbers, shape (n,).

    Returns:
        The unit [ns], what is added before it makes nanoseconds since 1970 or the start, a remark, and what
        is asked, empty for nothing.
    """
    unit, size = _unit_of_times(words, written), float(np.abs(values).max())
    # A stated unit in which they are no date since 1973: since the start.
    is_elapsed = unit in _UNITS and size * _UNITS[unit] < _SINCE[-1][0] * SECOND
    for minimum, factor, zero, name in () if is_elapsed else _SINCE:
        if size >= minimum:
            return factor, zero, name, ''
    elapsed = f'{unit or "s"} since the start'
    for minimum, maximum, zero, name in _DAYS_SINCE if _UNITS.get(unit, DAY) == DAY else ():
        if minimum < float(values.min()) and size < maximum:
            of_days = DAY, zero, f'{name}, without a zone: taken as UTC'
            is_stated = unit or re.search(r'date|datum|time ?stamp', words)
            may_be_days, may_be_seconds = (True, False) if is_stated else _days_or_seconds(values)
            if may_be_days and may_be_seconds:
                question = "has times that may be {}: head them 'time [s]' or 'date'"
                if _usual_gap(values) < _LEAST_GAP_OF_SECONDS:
                    return *of_days, question.format(f'{name} or {elapsed}')
                doubt = f"{elapsed}, or are they {name}? Head them 'time [s]' or 'date'"
                return SECOND, 0, doubt, question.format(f'{elapsed} or {name}')
            if may_be_days:
                return *of_days, ''
    question = ''
    if not unit and _usual_gap(values) >= _LEAST_GAP_OF_MILLISECONDS:
        question = "has times that may be s or ms since the start: head them 'time [s]' or 'time [ms]'"
    return _UNITS.get(unit, SECOND), 0, elapsed, question


def _unit_of_times(words: str, written: str | None) -> str:
    """Return the unit in a heading: in brackets, all of it, or behind other words; empty for none.

    >>> _unit_of_times('elapsed ms', None), _unit_of_times('millis', None), _unit_of_times('time', '[s]')
    ('ms', 'millis', '')
    """
    first, _, rest = words.partition(' ')
    last = rest.rpartition(' ')[2]
    # The last word of a time of day is no unit.
    candidates = (written or '').lower(), rest, '' if rest else first, last if last != 'day' else ''
    return next((text for text in candidates if text in _UNITS), '')


def _usual_gap(values: FloatArray) -> float:
    """Return the usual distance of two numbers that differ; 0 where none do."""
    gaps = np.abs(np.diff(values))
    return float(np.median(gaps[gaps > 0])) if gaps.any() else 0.0


def _days_or_seconds(values: FloatArray) -> tuple[bool, bool]:
    """Return whether numbers without a unit may be days, and whether they may be seconds."""
    gap, seconds = _usual_gap(values), values * 86_400
    if gap == 0.0:
        return False, True
    is_whole = np.abs(seconds - np.rint(seconds)) < _WHOLE_SECOND
    is_round = np.abs(values * 1e5 - np.rint(values * 1e5)) < 1e-3
    # Of few decimals only all gaps together tell the rate.
    gaps = gap, np.ptp(values) / (np.unique(values).size - 1)
    is_rate = gap > 1.0 / _HIGHEST_RATE and any(abs(1.0 / g - round(1.0 / g)) < 0.05 for g in gaps)
    if gap < _PARTS_OF_DAYS or (is_whole.mean() > _ALMOST_ALL and is_round.mean() < 0.5 and not is_rate):
        return True, False
    # Of days of five decimals a gap is known to 5 %, one of minutes to 1 %.
    is_pace = any(abs(gap * 86_400 / every - 1.0) < 0.05 for every in _EVERY)
    is_pace |= any(abs(gap * 86_400 / every - 1.0) < 0.01 for every in _EVERY_MINUTES)
    # A whole number of lines a day, from 24 Hz on a usual rate of a sensor: 8, 4 or 1 a day, or in a second.
    is_share = gap >= _LEAST_GAP_OF_SECONDS and 8.0 * gap % 1.0 == 0.0 and gap <= 1.0
    return is_pace or is_share, is_rate or not is_pace


def _leading_number(cell: str, decimal: str) -> float:
    """Return the number that a cell begins with, NaN for none; a unit may follow."""
    number, _, rest = cell.strip().partition(' ')
    try:
        # What Python takes for digits, as in '1_000', is a word in a table.
        return (
            math.nan if any(map(str.isdigit, rest)) else float(number.replace(decimal, '.').replace('_', 'x'))
        )
    except ValueError:
        return math.nan


def is_stamp(cell: str) -> bool:
    """Return whether a cell is a date with a time."""
    return any(pattern.fullmatch(cell.strip()) for pattern in _STAMPS)


def is_day(cell: str) -> bool:
    """Return whether a cell is a date alone."""
    return any(pattern.fullmatch(cell.strip()) for pattern in _DAYS)


def is_time(cell: str) -> bool:
    """Return whether a cell is a time of the day, or since a start."""
    return bool(_TIME.fullmatch(cell.strip()) or _SINCE_START.fullmatch(cell.strip()))


class StampLayout:
    """The layout of the dates with times of a table, found by some of them.

    Args:
        seen: The dates with times.
        zone: The distance from UTC of those that say none, as +02:00; empty for none.

    Attributes:
        has_zone: Whether their distance from UTC is known.
        guess: A sentence on a date that may be read in another order; empty where the dates tell.
        question: What is asked of it, as a clause behind the name of an input; else empty.
    """

    def __init__(self, seen: Sequence[str], zone: str = '') -> None:
        self._pattern = max(
            _STAMPS, key=lambda pattern: sum(bool(pattern.fullmatch(text.strip())) for text in seen)
        )
        matches = [m for text in seen if (m := self._pattern.fullmatch(text.strip()))]
        self._zone = zone
        self.has_zone = bool(zone) or any(match['z'] for match in matches)
        self.guess = self.question = ''
        self._year, self._month, self._day = 'Y', 'm', 'd'
        if 'a' in self._pattern.groupindex and matches:
            order = self._date_order(matches)
            self._year, self._month, self._day = order[0], order[1], order[2]

    def _date_order(self, matches: Sequence[re.Match[str]]) -> str:
        """Return which groups of the pattern are year, month and day; ask where nothing tells."""
        parts = {name: {int(match[name]) for match in matches} for name in 'abY'}
        # Months and days first, and a year of two digits.
        orders = ['Yba', 'Yab'] + ['abY'] * (max(parts['Y']) < 100)
        possible = [
            order
            for order in orders
            if max(parts[order[1]]) <= 12 and min(parts[order[2]]) > 0 and max(parts[order[2]]) <= 31
        ] or orders
        # Of a stretch of days the part that changes most is the day.
        longest = max(len(parts[order[2]]) for order in possible)
        possible = [order for order in possible if len(parts[order[2]]) == longest]
        if len(possible) > 1 and matches[0]['sep'] != '.':
            text = matches[0].group()
            is_year = 'abY' in possible
            remedy = (
                'or is the year first? Write it with four digits' if is_year else 'nothing in the file tells'
            )
            self.guess = f"'{text}' is read day first: {remedy}"
            first = 'year' if is_year else 'month'
            self.question = (
                f"has times such as '{text}', read day first: or is the {first} first?"
                ' Write 4 May as 2026-05-04'
            )
        return possible[0]

    def read(self, columns: Sequence[Cells]) -> Times:
        """Return the times of a column, or of one of dates and one of times of the day."""
        texts = columns[0]
        if len(columns) > 1:
            texts = [f'{day.strip()} {clock.strip()}' for day, clock in zip(*columns, strict=True)]
        time_ns, good = self._parse_alike(texts)
        for k in np.flatnonzero(~good).tolist():
            moment = self._parse_stamp(texts[k])
            good[k], time_ns[k] = moment is not None, moment or 0
        return time_ns, good

    def _parse_stamp(self, text: str) -> int | None:
        """Return one time [ns]; None where there is none, or no such day or hour."""
        match = self._pattern.fullmatch(text.strip())
        if match is None:
            return None
        part = match.groupdict('')
        year, hour = int(part[self._year]), int(part['H'])
        if 'j' in part:
            begin = date(year, 1, 1).toordinal() if year else 0
            begin += int(part['j']) - 1
            found = date.fromordinal(begin) if begin > 0 else date.min
            part |= {'m': str(found.month if found.year == year else 0), 'd': str(found.day)}
        month = _MONTH.get(part['name'].lower(), 0) if 'name' in part else int(part[self._month])
        day = int(part[self._day])
        if part.get('half'):
            hour = hour % 12 + 12 * (part['half'][0] in 'pP')
        minute, second_ = int(part['M']), int(part['S'] or 0)
        if hour > 24 or minute > 59 or second_ > 60:
            return None
        try:
            days = date(year + 2000 * (year < 100), month, day).toordinal() - _EPOCH
        except ValueError:
            return None
        seconds = (hour * 60 + minute) * 60 + second_ - self._zone_offset(part['z'])
        time_ns = days * DAY + seconds * SECOND + int(part['f'].ljust(9, '0'))
        return time_ns if abs(time_ns) < _MOST else None

    def _parse_alike(self, texts: Cells) -> Times:
        """Return the times of cells if all are written as the first one, by arithmetic on columns."""
        none = np.zeros(len(texts), np.int64), np.zeros(len(texts), np.bool_)
        match = self._pattern.fullmatch(texts[0]) if texts else None
        if (
            match is None
            or match.groupdict().get('half')
            or {'name', 'j'} & match.groupdict().keys()
            or set(map(len, texts)) != {len(match[0])}
        ):
            return none
        try:
            letters = np.array(texts, f'S{len(match[0])}').view(np.uint8).reshape(len(texts), -1)
        except UnicodeEncodeError:
            return none
        iso = np.tile(np.frombuffer(b'2000-00-00T00:00:00', np.uint8), (len(texts), 1))
        rest = np.ones(letters.shape[1], np.bool_)
        ends = ((self._year, 4), (self._month, 7), (self._day, 10), ('H', 13), ('M', 16), ('S', 19), ('f', 0))
        for name, end in ends:
            begin, stop = match.span(name)
            rest[max(begin, 0) : max(stop, 0)] = False
            if end and begin >= 0:
                iso[:, end - (stop - begin) : end] = letters[:, begin:stop]
        # Separators and zone are those of the first; numpy refuses what is no digit or no date.
        if (letters[:, rest] != letters[0, rest]).any():
            return none
        try:
            # As text: numpy 2.4 ends the process where bytes, 500 or more, hold what is no date.
            dates = iso.view('S19')[:, 0].astype('U19').astype('M8[s]')
            seconds = dates.astype(np.int64) - self._zone_offset(match['z'])
            below = np.array([int(text[slice(*match.span('f'))]) for text in texts]) if match['f'] else 0
        except ValueError:
            return none
        if np.abs(seconds).max() >= _MOST // SECOND:
            return none
        return seconds * SECOND + below * 10 ** (9 - len(match['f'] or '')), ~none[1]

    def _zone_offset(self, zone: str | None) -> int:
        """Return the distance from UTC [s]."""
        zone = zone or self._zone
        if zone[:1] not in ('+', '-'):
            return 0
        digits = zone[1:].replace(':', '').ljust(4, '0')
        return (int(digits[:2]) * 60 + int(digits[2:])) * (60 if zone[0] == '+' else -60)


def read_time_of_day(columns: Sequence[Cells]) -> Times:
    """Read times of the day on one day without a date, or since a start, with hours beyond 24 [ns]."""
    layout = StampLayout(['1970-01-01 00:00:00'])
    time_ns, good = layout.read([['1970-01-01'] * len(columns[0]), columns[0]])
    for k in np.flatnonzero(~good).tolist():
        if match := _SINCE_START.fullmatch(columns[0][k].strip()):
            hours, minutes, seconds = (int(part) for part in match.groups()[:3])
            time_ns[k] = ((hours * 60 + minutes) * 60 + seconds) * SECOND + int(
                (match[4] or '').ljust(9, '0')
            )
            good[k] = True
    return time_ns, good


def scaled_reader(factor: int, zero: int, decimal: str) -> ReadTimes:
    """Return what reads numbers of a unit as times.

    Args:
        factor: The unit [ns].
        zero: Added before the factor.
        decimal: The decimal sign.
    """

    def read(columns: Sequence[Cells]) -> Times:
        cells = columns[0]
        if decimal == ',':
            cells = [cell.replace(',', '.') for cell in cells]
        text = ''.join(cells)
        if not any(sign in text for sign in '-_eE'):
            with contextlib.suppress(ValueError, OverflowError):
                wholes, rest = cells, np.zeros(len(cells), np.int64)
                if '.' in text:
                    parts = [cell.partition('.') for cell in cells]
                    wholes = [part[0] for part in parts]
                    # Fifteen digits of a fraction of a day are exact to the nanosecond.
                    below = np.array([float(f'0.{part[2]}') for part in parts])
                    rest = np.rint(below * factor).astype(np.int64)
                whole = np.fromiter(map(int, wholes), np.int64, len(cells))
                if int(np.abs(whole + zero).max(initial=0) + 1) * factor < _MOST:
                    return (whole + zero) * factor + rest, np.ones(len(cells), np.bool_)
        times_ns = [_exact_time(cell, factor, zero) for cell in cells]
        is_time = np.array([time_ns is not None for time_ns in times_ns], np.bool_)
        return np.array([time_ns or 0 for time_ns in times_ns], np.int64), is_time

    return read


def _exact_time(cell: str, factor: int, zero: int) -> int | None:
    """Return (cell + zero) times factor [ns], exactly; ``zero`` is in the unit of the cell.

    None for what is no number or out of range.
    """
    try:
        time_ns = (Decimal(cell.strip().replace('_', 'x')) + zero) * factor
        return round(time_ns) if abs(time_ns) < _MOST else None
    except (ArithmeticError, ValueError):
        return None
