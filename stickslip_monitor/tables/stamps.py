# SPDX-License-Identifier: Apache-2.0
"""Times in cells: dates with times in the layouts that loggers write, and numbers of a unit.

All become nanoseconds since 1970, or since the start, exactly.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from datetime import date
from decimal import Decimal

import numpy as np

from stickslip_monitor.arrays import BoolArray, IntArray
from stickslip_monitor.tables.headings import Cells

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
