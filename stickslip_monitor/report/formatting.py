# SPDX-License-Identifier: Apache-2.0
"""Times, durations and quantities as a person reads them."""

from __future__ import annotations

import math
from datetime import datetime, timedelta, timezone

# Keeps a number and its unit on one line.
_SPACE = '\N{NO-BREAK SPACE}'
_EPOCH = datetime(1970, 1, 1, tzinfo=timezone.utc)
# A clock before this is one that counts from a start, a simulation's say: it has no date.
_FIRST_DATE_NS = 10 * 365 * 86_400 * 10**9


def is_dated(time_ns: int) -> bool:
    """Whether a time is a date and not a count from some start."""
    return time_ns >= _FIRST_DATE_NS


def _datetime(time_ns: int) -> datetime:
    return _EPOCH + timedelta(microseconds=round(time_ns / 1000))


def date(time_ns: int) -> str:
    """The date in UTC; empty for a time without one."""
    return _datetime(time_ns).strftime('%Y-%m-%d') if is_dated(time_ns) else ''


def clock(time_ns: int) -> str:
    """The time of day in UTC to a tenth of a second; seconds for a time without a date."""
    if not is_dated(time_ns):
        return f'{time_ns * 1e-9:.1f} s'
    tenths = _EPOCH + timedelta(milliseconds=100 * round(time_ns / 10**8))
    return f'{tenths:%H:%M:%S}.{tenths.microsecond // 100_000}'


def minute(time_ns: int) -> str:
    """The time of day in UTC to the second, for a sentence."""
    if not is_dated(time_ns):
        return f'{time_ns * 1e-9:.0f} s'
    return f'{_EPOCH + timedelta(seconds=round(time_ns / 10**9)):%H:%M:%S}'


def iso(time_ns: int) -> str:
    """The time as ISO 8601 in UTC, for machines; empty for a time without a date."""
    return _datetime(time_ns).strftime('%Y-%m-%dT%H:%M:%S.%fZ') if is_dated(time_ns) else ''


def duration(seconds: float) -> str:
    """A duration in at most two units: ``1 h 5 min``, ``2 min 10 s``, ``4.2 s``."""
    if not math.isfinite(seconds):
        return 'for ever'
    if seconds < 9.95:
        return f'{seconds:.1f}{_SPACE}s'
    whole = round(seconds)
    for size, unit, smaller, small_unit in (
        (86_400, 'd', 3600, 'h'),
        (3600, 'h', 60, 'min'),
        (60, 'min', 1, 's'),
    ):
        if whole >= size:
            rest = whole % size // smaller
            more = f'{_SPACE}{rest}{_SPACE}{small_unit}' if rest else ''
            return f'{whole // size}{_SPACE}{unit}{more}'
    return f'{whole}{_SPACE}s'


def share(part: float, whole: float) -> str:
    """A part of a whole in per cent; a small part is never nothing."""
    if whole <= 0.0 or part <= 0.0:
        return f'0{_SPACE}%'
    percent = 100.0 * part / whole
    if percent < 0.1:
        return f'below 0.1{_SPACE}%'
    return f'{percent:.1f}{_SPACE}%' if percent < 10.0 else f'{percent:.0f}{_SPACE}%'


def margin(value: float) -> str:
    """A margin in per cent, with its sign."""
    if math.isinf(value):
        return 'no boundary'
    return f'{100.0 * value:+.1f}{_SPACE}%'.replace('-', '\N{MINUS SIGN}')


def millimetres(metres: float) -> str:
    """An amplitude in millimetres to three digits."""
    return f'{metres * 1e3:.3g}{_SPACE}mm'


def rpm(value: float) -> str:
    """A shaft speed."""
    return f'{value:.1f}{_SPACE}rpm'.replace('-', '\N{MINUS SIGN}')


def load(newtons: float) -> str:
    """A load, as in the sentences of alarms."""
    return f'{newtons / 1e3:.4g}{_SPACE}kN'


def count(number: int, what: str) -> str:
    """A number with its noun: ``1 event``, ``1 250 events``."""
    return f'{grouped(number)} {what}{"" if number == 1 else "s"}'


def grouped(number: int) -> str:
    """A whole number with narrow spaces between its thousands."""
    return f'{number:,}'.replace(',', '\N{NARROW NO-BREAK SPACE}')
