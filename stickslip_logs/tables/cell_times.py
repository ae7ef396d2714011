# SPDX-License-Identifier: Apache-2.0
"""Reads dates, times and numbers in cells as times.

All become nanoseconds since 1970, or since a start, exactly.
"""

from __future__ import annotations

import contextlib
import math
import re
from collections import Counter
from collections.abc import Callable, Sequence
from datetime import date, timedelta
from decimal import Decimal

import numpy as np

from stickslip_logs.arrays import BoolArray, IntArray
from stickslip_logs.time_order import EPOCH, MAX_TIME_NS
from stickslip_logs.units import SECOND_NS

Cells = Sequence[str]
DAY = 86_400 * SECOND_NS
"""Nanoseconds of a day."""
Times = tuple[IntArray, BoolArray]
"""Times [ns] and which cells hold one, shape (n,) each; the time of another cell has no meaning."""
ReadTimes = Callable[[Sequence[Cells]], Times]
"""Reads the times of some columns of cells."""

_MONTHS = 'jan feb mar/mär/mrz apr may/mai jun jul aug sep oct/okt nov dec/dez'
_MONTH = {name: k for k, names in enumerate(_MONTHS.split(), 1) for name in names.split('/')}
_CLOCK = (
    r'(?P<H>\d{1,2}):(?P<M>\d\d)(?::(?P<S>\d\d)(?:[.,](?P<f>\d{1,9})\d*)?)?'
    r'\s*(?P<half>[AaPp]\.?[Mm]\.?)?'
)
_ZONE = r'\s*(?P<z>Z|(?:UTC|GMT) ?[+-]\d\d?(?::?\d\d)?|UTC|GMT|[+-]\d\d(?::?\d\d)?)?'
_DATES = (
    r'(?P<Y>\d{4})[-/.](?P<m>\d\d?)[-/.](?P<d>\d\d?)',
    r'(?P<a>\d\d?)(?P<sep>[-/.])(?P<b>\d\d?)[-/.](?P<Y>\d{4}|\d\d)',
    r'(?P<d>\d\d?)[- .]+(?P<name>[A-Za-zä]{3})[a-z]*[- ,.]+(?P<Y>\d{4}|\d\d)',
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
_OFFSET = re.compile(r'([+-])(\d\d?)(?::?(\d\d))?')
# What only a zone is; '+02' may be a number, too.
_SURE_ZONE = re.compile(r'Z|(?:UTC|GMT) ?(?:[+-]\d\d?(?::?\d\d)?)?|[+-]\d\d:\d\d')
# Eight digits alone may be a number.
_DAYS = [re.compile(day) for day in _DATES[:-1]]
_TIME = re.compile(_CLOCK + _ZONE)
_SINCE_START = re.compile(r'(\d{2,4}):([0-5]\d):([0-5]\d)(?:[.,](\d{1,9}))?')
_EPOCH = EPOCH.toordinal()


def is_stamp(cell: str) -> bool:
    """Return whether a cell is a date with a time."""
    return any(pattern.fullmatch(cell.strip()) for pattern in _STAMPS)


def is_day(cell: str) -> bool:
    """Return whether a cell is a date alone."""
    return any(pattern.fullmatch(cell.strip()) for pattern in _DAYS)


def is_zone(cell: str) -> bool:
    """Return whether a cell is a distance from UTC and nothing else, as +02:00 or UTC+2."""
    return bool(_SURE_ZONE.fullmatch(cell.strip()))


def is_time_of_day(cell: str) -> bool:
    """Return whether a cell is a time of the day alone, as 06:00:00."""
    return bool(_TIME.fullmatch(cell.strip()))


def is_time(cell: str) -> bool:
    """Return whether a cell is a time of the day, or one since a start, as 123:00:00."""
    return is_time_of_day(cell) or bool(_SINCE_START.fullmatch(cell.strip()))


class StampLayout:
    """The one layout in which the dates with times of a table are written.

    Args:
        stamps: Some of them, by which it is found; other texts among these are skipped.
        zone: The distance from UTC of those that say none, as +02:00; empty where it is not known.

    Attributes:
        has_zone: Whether their distance from UTC is known: it is given, or half of them or more have one.
        question: A question on a date that may be read in another order, as a clause behind the name of an
            input; empty where the dates tell.
    """

    def __init__(self, stamps: Sequence[str], zone: str = '') -> None:
        self._pattern = max(
            _STAMPS, key=lambda pattern: sum(bool(pattern.fullmatch(t.strip())) for t in stamps)
        )
        matches = [match for text in stamps if (match := self._pattern.fullmatch(text.strip()))]
        self._zone = zone
        # Where most have a zone, one without is damaged; where few have, theirs is read.
        self._has_zones = not zone and 2 * sum(bool(match['z']) for match in matches) >= max(len(matches), 1)
        self.has_zone = bool(zone) or self._has_zones
        self.question = ''
        # The groups of the pattern that are year, month and day.
        is_sure = 'a' not in self._pattern.groupindex or not matches
        self._year, self._month, self._day = ('Y', 'm', 'd') if is_sure else self._choose_order(matches)

    def _choose_order(self, matches: Sequence[re.Match[str]]) -> tuple[str, str, str]:
        """Return the groups of matches, at least one, that are year, month and day.

        Of the orders that fit, the one whose day changes most; where several are left the day is first, and
        ``question`` is set, but not for dots. A date of one line does not count beside others.
        """
        dates = Counter(m.group(*'abY') for m in {m.group(): m for m in matches}.values()).most_common()
        if len(dates) > 1 and dates[-1][1] == 1 < dates[-2][1]:
            dates.pop()  # of one line, which may be damaged
        numbers = {name: {int(key[k]) for key, _ in dates} for k, name in enumerate('abY')}
        day_first, month_first, year_first = ('Y', 'b', 'a'), ('Y', 'a', 'b'), ('a', 'b', 'Y')
        orders = [day_first] if matches[0]['sep'] == '.' else [day_first, month_first]
        orders += [year_first] if max(numbers['Y']) < 100 else []
        possible = [
            (year, month, day)
            for year, month, day in orders
            if max(numbers[month]) <= 12 and min(numbers[day]) > 0 and max(numbers[day]) <= 31
        ] or orders
        # Over several days the part that changes most is the day.
        longest = max(len(numbers[day]) for *_, day in possible)
        possible = [order for order in possible if len(numbers[order[2]]) == longest]
        if len(possible) > 1 and matches[0]['sep'] != '.':
            text, first = matches[0].group(), 'year' if year_first in possible else 'month'
            self.question = f"has times such as '{text}', read day first: or is the {first} first?"
            self.question += ' Write 4 May as 2026-05-04'
        return possible[0]

    def read(self, columns: Sequence[Cells]) -> Times:
        """Return the times of a column, or of those of dates, of times of the day and of zones.

        Returns:
            The times [ns] since 1970, and which cells are in this layout, a date, and with a zone where half
            or more have one; others have the time 0.
        """
        texts = columns[0]
        if len(columns) > 1:
            texts = [' '.join(map(str.strip, cells)) for cells in zip(*columns, strict=True)]
        time_ns, is_timed = self._parse_alike(texts)
        for k in np.flatnonzero(~is_timed).tolist():
            moment_ns = self._parse_stamp(texts[k])
            is_timed[k], time_ns[k] = moment_ns is not None, moment_ns or 0
        return time_ns, is_timed

    def _parse_stamp(self, text: str) -> int | None:
        """Return a date with a time as ns since 1970, in UTC if it has no zone; year 26 is 2026.

        None for another text, for one without a zone where half or more have one, for no such day or hour,
        and for a time too large. Hour 24 and second 60 are the beginning of the next day and minute.
        """
        match = self._pattern.fullmatch(text.strip())
        if match is None:
            return None
        part = match.groupdict('')
        year, hour, minute, seconds = (int(part[key] or 0) for key in (self._year, 'H', 'M', 'S'))
        if part.get('half'):
            hour = hour % 12 + 12 * (part['half'][0] in 'pP')
        if hour > 24 or minute > 59 or seconds > 60 or (self._has_zones and not part['z']):
            return None
        try:
            if 'j' in part:
                day = date(year, 1, 1) + timedelta(days=int(part['j']) - 1)
            else:
                month = _MONTH.get(part['name'].lower(), 0) if 'name' in part else int(part[self._month])
                day = date(year + 2000 * (year < 100), month, int(part[self._day]))
        except (ValueError, OverflowError):
            return None
        seconds += (hour * 60 + minute) * 60 - self._zone_offset(part['z'])
        time_ns = (day.toordinal() - _EPOCH) * DAY + seconds * SECOND_NS + int(part['f'].ljust(9, '0'))
        is_day_of_year = 'j' not in part or day.year == year
        return time_ns if is_day_of_year and abs(time_ns) < MAX_TIME_NS else None

    def _parse_alike(self, texts: Cells) -> Times:
        """Return the times of cells that are all written like the first one; else mark none as a time.

        None are either where the layout has names of months, days of the year or halves of a day, or the
        first lacks a zone. This is the fast way; such cells are left to :meth:`_parse_stamp`.
        """
        none = np.zeros(len(texts), np.int64), np.zeros(len(texts), np.bool_)
        match = self._pattern.fullmatch(texts[0]) if texts else None
        if (
            match is None
            or match.groupdict().get('half')
            or (self._has_zones and not match['z'])
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
        if np.abs(seconds).max() >= MAX_TIME_NS // SECOND_NS:
            return none
        return seconds * SECOND_NS + below * 10 ** (9 - len(match['f'] or '')), ~none[1]

    def _zone_offset(self, zone: str | None) -> int:
        """Return the distance from UTC [s] of a zone as written: of none that of the table, or else 0."""
        match = _OFFSET.search(zone or self._zone)
        if match is None:
            return 0
        return (int(match[2]) * 60 + int(match[3] or 0)) * (60 if match[1] == '+' else -60)


def read_time_of_day(columns: Sequence[Cells]) -> Times:
    """Return times of the day in one column as if on 1970-01-01 in UTC, or since a start.

    Hours since a start have two to four digits and may exceed 24. The time of another cell is 0.
    """
    layout = StampLayout(['1970-01-01 00:00:00'])
    time_ns, is_timed = layout.read([['1970-01-01'] * len(columns[0]), columns[0]])
    for k in np.flatnonzero(~is_timed).tolist():
        if match := _SINCE_START.fullmatch(columns[0][k].strip()):
            hours, minutes, seconds = (int(part) for part in match.groups()[:3])
            nanoseconds = int((match[4] or '').ljust(9, '0'))
            time_ns[k] = ((hours * 60 + minutes) * 60 + seconds) * SECOND_NS + nanoseconds
            is_timed[k] = True
    return time_ns, is_timed


def number_reader(unit_ns: int, zero: float, decimal: str) -> ReadTimes:
    """Return a function that reads one column of numbers of a unit [ns] as times, to the nanosecond.

    The zero, in that unit, is added to each; ``decimal`` is their decimal sign. A cell that is no number, or
    beyond MAX_TIME_NS, has the time 0 and is marked as none.
    """
    base = math.floor(zero)
    more_ns = round((zero - base) * unit_ns)

    def read(columns: Sequence[Cells]) -> Times:
        """Return the times [ns] of the cells of the one column, and which have one; the others are 0."""
        # All at once where all are plain numbers.
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
                    rest = np.rint(below * unit_ns).astype(np.int64)
                whole = np.fromiter(map(int, wholes), np.int64, len(cells))
                if int(np.abs(whole + base).max(initial=0) + 2) * unit_ns < MAX_TIME_NS:
                    return (whole + base) * unit_ns + (rest + more_ns), np.ones(len(cells), np.bool_)
        times_ns = [_exact_time(cell, unit_ns, zero) for cell in cells]
        is_time = np.array([time_ns is not None for time_ns in times_ns], np.bool_)
        return np.array([time_ns or 0 for time_ns in times_ns], np.int64), is_time

    return read


def _exact_time(cell: str, unit_ns: int, zero: float) -> int | None:
    """Return ``(cell + zero) * unit_ns``, rounded to whole ns; None for no number and from MAX_TIME_NS on."""
    try:
        time_ns = (Decimal(cell.strip().replace('_', 'x')) + Decimal(zero)) * unit_ns
        return round(time_ns) if abs(time_ns) < MAX_TIME_NS else None
    except (ArithmeticError, ValueError):
        return None
