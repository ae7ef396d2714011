# SPDX-License-Identifier: Apache-2.0
"""The time of a table: which columns it is in, and how dates, times and numbers in cells are read.

All become nanoseconds since 1970, or since the start, exactly.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import date
from decimal import Decimal
from pathlib import Path

import numpy as np

from stickslip_monitor.arrays import BoolArray, IntArray
from stickslip_monitor.errors import BagError

Cells = Sequence[str]

SECOND, DAY = 10**9, 86_400 * 10**9
Times = tuple[IntArray, BoolArray]
"""Times [ns] and which cells hold one, shape (n,)."""
ReadTimes = Callable[[Sequence[Cells]], Times]
"""Reads the times of some columns of cells."""

_MONTHS = {
    name: number
    for number, names in enumerate(
        (
            'jan',
            'feb',
            'mar mär mrz',
            'apr',
            'may mai',
            'jun',
            'jul',
            'aug',
            'sep',
            'oct okt',
            'nov',
            'dec dez',
        ),
        1,
    )
    for name in names.split()
}
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
_STAMPS = [re.compile(f'{day}(?:[T ]+|, ?|-){_CLOCK}{_ZONE}') for day in _DATES]
# Eight digits alone may be a number.
_DAYS = [re.compile(day) for day in _DATES[:-1]]
_TIME = re.compile(_CLOCK + _ZONE)
# Whole numbers of 64 bits, in nanoseconds.
_MOST = 9_200_000_000_000_000_000


def is_stamp(cell: str) -> bool:
    """Whether a cell is a date with a time."""
    return any(pattern.fullmatch(cell.strip()) for pattern in _STAMPS)


def is_day(cell: str) -> bool:
    """Whether a cell is a date alone."""
    return any(pattern.fullmatch(cell.strip()) for pattern in _DAYS)


def is_time(cell: str) -> bool:
    """Whether a cell is a time of the day."""
    return bool(_TIME.fullmatch(cell.strip()))


class StampLayout:
    """The layout of the dates with times of a table, found by some of them.

    Attributes:
        has_zone: Whether they say their distance from UTC.
        question: A date that may be read day first or month first, and which of them it is here;
            empty where the dates tell.
    """

    def __init__(self, seen: Sequence[str]) -> None:
        self._pattern = max(_STAMPS, key=lambda own: sum(bool(own.fullmatch(text.strip())) for text in seen))
        found = [m for text in seen if (m := self._pattern.fullmatch(text.strip()))]
        self.has_zone = any(match['z'] for match in found)
        self.question, self._day_first = '', True
        if 'a' not in self._pattern.groupindex or not found:
            return
        first, second = ([int(match[name]) for match in found] for name in 'ab')
        self._day_first = max(second) <= 12
        if max(*first, *second) <= 12:
            # Of a stretch of days the part that changes more is the day.
            self._day_first = len(set(first)) >= len(set(second))
            if len(set(first)) == len(set(second)) and found[0]['sep'] != '.':
                self.question = found[0].group()

    def read(self, columns: Sequence[Cells]) -> Times:
        """The times of a column, or of one of dates and one of times of the day."""
        texts = columns[0]
        if len(columns) > 1:
            pairs = zip(*columns, strict=True)
            texts = [f'{day.strip()} {clock.strip()}' for day, clock in pairs]
        time_ns, good = self._alike(texts)
        for k in np.flatnonzero(~good).tolist():
            if match := self._pattern.fullmatch(texts[k].strip()):
                moment = self._moment(match)
                good[k] = moment is not None
                time_ns[k] = moment or 0
        return time_ns, good

    def _moment(self, match: re.Match[str]) -> int | None:
        """One time [ns]; None where there is no such day or hour."""
        part = match.groupdict()
        month, day = self._month_and_day(part)
        year, hour = int(part['Y']), int(part['H'])
        if part['half']:
            hour = hour % 12 + 12 * (part['half'][0] in 'pP')
        minute, second = int(part['M']), int(part['S'] or 0)
        try:
            days = date(year + 2000 * (year < 100), month, day).toordinal() - _EPOCH
        except ValueError:
            return None
        if hour > 24 or minute > 59 or second > 60:
            return None
        fraction = int((part['f'] or '0').ljust(9, '0'))
        clock = (hour * 60 + minute) * 60 + second - _shift(part)
        time_ns = days * DAY + clock * SECOND + fraction
        return time_ns if abs(time_ns) < _MOST else None

    def _month_and_day(self, part: dict[str, str | None]) -> tuple[int, int]:
        if part.get('name'):
            return _MONTHS.get(str(part['name']).lower(), 0), int(part['d'] or 0)
        if 'm' in part:
            return int(part['m'] or 0), int(part['d'] or 0)
        first, second = int(part['a'] or 0), int(part['b'] or 0)
        return (second, first) if self._day_first else (first, second)

    def _alike(self, texts: Cells) -> Times:
        """The times of cells that are written as the first one, by arithmetic on columns."""
        time_ns, good = np.zeros(len(texts), np.int64), np.zeros(len(texts), np.bool_)
        first = texts[0] if texts else ''
        match = self._pattern.fullmatch(first)
        if match is None or not first.isascii() or match['half'] or 'name' in match.groupdict():
            return time_ns, good
        width, like = len(first), np.frombuffer(first.encode(), np.uint8)
        try:
            raw = np.array(texts, f'S{width + 1}')
        except UnicodeEncodeError:
            return time_ns, good
        letters = raw.view(np.uint8).reshape(len(texts), width + 1)
        digit = (like >= ord('0')) & (like <= ord('9'))
        digit[match.start('z') if match['z'] else width :] = False
        own = letters[:, :width]
        good = (letters[:, width] == 0) & (own[:, ~digit] == like[~digit]).all(1)
        numbers = own - np.uint8(ord('0'))
        good &= (numbers[:, digit] < 10).all(1)

        def part(name: str) -> IntArray:
            begin, end = match.span(name)
            tens = 10 ** np.arange(end - begin - 1, -1, -1)
            total: IntArray = numbers[:, begin:end].astype(np.int64) @ tens
            return total

        names = ('m', 'd') if 'm' in self._pattern.groupindex else self._names()
        year, month, day = part('Y'), part(names[0]), part(names[1])
        year += 2000 * (match.end('Y') - match.start('Y') < 4)
        good &= (month >= 1) & (month <= 12) & (day >= 1) & (day <= 28) & (part('H') < 24)
        # What 64 bits of nanoseconds hold.
        good &= (year > 1678) & (year < 2261)
        months = np.where(good, (year - 1970) * 12 + month - 1, 0)
        days = months.astype('M8[M]').astype('M8[D]').astype(np.int64) + day - 1
        seconds = part('S') if match['S'] else 0
        good &= (part('M') < 60) & (np.asarray(seconds) < 60)
        clock = (part('H') * 60 + part('M')) * 60 + seconds - _shift(match.groupdict())
        time_ns = days * DAY + clock * SECOND
        if match['f']:
            time_ns = time_ns + part('f') * 10 ** (9 - len(match['f']))
        return time_ns, good

    def _names(self) -> tuple[str, str]:
        return ('b', 'a') if self._day_first else ('a', 'b')


_EPOCH = date(1970, 1, 1).toordinal()


def _shift(part: dict[str, str | None]) -> int:
    """The distance from UTC [s]."""
    zone = part['z'] or ''
    if zone[:1] not in ('+', '-'):
        return 0
    digits = zone[1:].replace(':', '').ljust(4, '0')
    return (int(digits[:2]) * 60 + int(digits[2:])) * (60 if zone[0] == '+' else -60)


def read_time_of_day(columns: Sequence[Cells]) -> Times:
    """Times of the day on one day without a date [ns]."""
    layout = StampLayout(['1970-01-01 00:00:00'])
    return layout.read([['1970-01-01'] * len(columns[0]), columns[0]])


def scaled_reader(factor: int, zero: int, decimal: str) -> ReadTimes:
    """What reads numbers of a unit as times.

    Args:
        factor: The unit [ns].
        zero: Added before the factor.
        decimal: The decimal sign.
    """

    def read(columns: Sequence[Cells]) -> Times:
        cells = columns[0]
        if decimal == ',':
            cells = [cell.replace(',', '.') for cell in cells]
        try:
            parts = [cell.partition('.') for cell in cells]
            whole = np.fromiter((int(part[0]) for part in parts), np.int64, len(cells))
            digits = [part[2].strip() for part in parts]
            longest = max(map(len, digits), default=0)
            is_plain = longest < 16 and not any('-' in cell or '_' in cell for cell in cells)
            if is_plain and int(np.abs(whole).max(initial=0) + abs(zero) + 1) * factor < _MOST:
                tenths = [int(text.ljust(longest, '0')) if text else 0 for text in digits]
                rest = np.array([_rounded(t * factor, 10**longest) for t in tenths], np.int64)
                return (whole + zero) * factor + rest, np.ones(len(cells), np.bool_)
        except (ValueError, OverflowError):
            pass
        found = [_exact(cell, factor, zero) for cell in cells]
        return (
            np.array([time_ns or 0 for time_ns in found], np.int64),
            np.array([time_ns is not None for time_ns in found], np.bool_),
        )

    return read


def _rounded(above: int, below: int) -> int:
    return (2 * above + below) // (2 * below)


def _exact(cell: str, factor: int, zero: int) -> int | None:
    try:
        time_ns = (Decimal(cell.strip().replace('_', 'x')) + zero) * factor
        return round(time_ns) if abs(time_ns) < _MOST else None
    except (ArithmeticError, ValueError):
        return None


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
    """The columns of the time, what reads them, and what was guessed of them."""

    columns: tuple[int, ...]
    read: ReadTimes
    said: tuple[str, ...]


def find_clock(path: Path, table: TableColumns) -> Clock:
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

    named = [k for k, (words, _) in enumerate(table.headings) if _NAMED.search(words)]
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


def _of_stamps(table: TableColumns, rows: Sequence[Cells], columns: tuple[int, ...]) -> Clock:
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


def _of_numbers(table: TableColumns, rows: Sequence[Cells], k: int, is_named: bool) -> Clock | None:
    """Numbers of a column as times; None where it does not look like one."""
    found = [_number(row[k], table.decimal) for row in rows if k < len(row)]
    values = [value for value in found if math.isfinite(value)]
    heading, (words, written) = table.names[k], table.headings[k]
    is_rising = values == sorted(values) or values == sorted(values, reverse=True)
    has_unit = table.units[k] is not None
    fits = is_named or (not has_unit and is_rising and len(set(values)) > 0.5 * len(values))
    if not values or not fits or len(values) <= _MOSTLY * len(found):
        return None
    unit = (written or '').lower()
    size = max(map(abs, values))

    def clock(factor: int, said: str, zero: int = 0) -> Clock:
        read = scaled_reader(factor, zero, table.decimal)
        return Clock((k,), read, (f"times in '{heading}' are {said}",))

    for least, factor, name in _SINCE_1970:
        if size >= least:
            return clock(factor, f'{name} since 1970')
    is_date = re.search(r'date|datum|time ?stamp', words)
    if unit == '' and is_date and _SHEET[0] < size < _SHEET[1]:
        said = 'days of a spreadsheet, without a zone: taken as UTC'
        return clock(DAY, said, _SHEET_ZERO)
    return clock(_UNITS.get(unit, SECOND), f'{unit if unit in _UNITS else "s"} since the start')


def _number(cell: str, decimal: str) -> float:
    try:
        return float(cell.replace(decimal, '.'))
    except ValueError:
        return math.nan
