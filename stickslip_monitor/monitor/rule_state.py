# SPDX-License-Identifier: Apache-2.0
"""All that the monitor remembers of a bearing, as one flat record.

:class:`State` is the whole memory, each number declared with its unit, range and meaning. Live it
is an object of Python numbers, over a recording one row of :data:`STATE_TYPE`, and kept between
runs it is a dictionary; the rule (:mod:`.rule`) reads and writes all of them by the same names.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from functools import partial
from typing import Any

import numpy as np

from stickslip_logs.units import SECOND_NS
from stickslip_monitor.monitor.sample_types import Input
from stickslip_monitor.monitor.value_check import refused

SPEED, LOAD, LEVEL, WATER = map(int, Input)  # older numba takes no enumeration as an index
NEVER = -(2**62)
"""Stands for a time that has not been [ns]."""
DOUBT = 600 * SECOND_NS
"""For so long after a short vibration, half as long after a start, no short one is used; a level
that has not moved for so long is stuck [ns]."""
_LARGEST = 1e15
"""Largest magnitude of a saved number without a closer bound."""


def _declare_part(
    unit: str, meaning: str, size: int = 0, *, start: float, minimum: float, maximum: float
) -> Any:
    """Return the dataclass field of one part of the memory: a list of ``size`` numbers, or one number for 0.

    Args:
        unit: Its unit.
        meaning: What it is, for the docs.
        size: How many numbers.
        start: Value at a first start, of each number.
        minimum: Least value that a saved one may have.
        maximum: Largest such value.
    """
    facts = {'meaning': meaning, 'unit': unit, 'size': size, 'range': (minimum, maximum)}
    if size:
        return field(default_factory=lambda: [start] * size, metadata=facts)
    return field(default=start, metadata=facts)


_time = partial(_declare_part, 'ns', start=NEVER, minimum=NEVER, maximum=-NEVER)
_span = partial(_declare_part, 'ns', start=0, minimum=0, maximum=-NEVER)
_difference = partial(_declare_part, 'ns', start=0, minimum=NEVER, maximum=-NEVER)
_count = partial(_declare_part, '', start=0, minimum=0)
_flag = partial(_count, maximum=1)
_number = partial(_declare_part, start=math.nan, minimum=-_LARGEST, maximum=_LARGEST)
_growth = partial(_declare_part, 'e-folds', start=0.0, minimum=0.0, maximum=_LARGEST)
_chance = partial(_declare_part, '', start=0.0, minimum=0.0, maximum=1.0)


@dataclass(slots=True)
class State:
    """The memory of a bearing as Python numbers, and lists where there are several."""

    # The inputs, in the order of :class:`~stickslip_monitor.monitor.sample_types.Input`.
    stamp: list[int] = _time('newest time stamp of each input', 4)
    came: list[int] = _time('from when the age of each is counted', 4)
    gap: list[int] = _span('time between two values of each input; long ones fade', 4)
    pace: list[int] = _span('usual time between two: the shorter of the last', 4)
    value: list[float] = _number('SI', 'latest speed [m/s] and load [N]', 2)
    before: list[float] = _number('SI', 'the values before these', 2)
    earlier: list[float] = _number('SI', 'the values before those', 2)
    # Time.
    now: int = _time('latest time, on a clock that never goes back')
    shift: int = _difference('how far that is ahead of the arrivals')
    began: int = _time('from when inputs are waited for')
    point: int = _time('time of the latest operating point')
    lost: int = _flag('1 while an input is lost')
    lost_since: int = _time('since when one is, or last was')
    # The trend of the speed.
    fast: float = _number('m/s', 'speed behind a lag of 1 s')
    slow: float = _number('m/s', 'speed behind a lag of 4 s')
    load_mean: float = _number('N', 'load behind a lag of 4 s')
    # Whether stick-slip runs.
    sticking: int = _flag('1 while stick-slip is predicted to run')
    known: int = _flag('1 once it is known which state a bistable bearing is in')
    onsets: int = _count('how often it has begun after it was clear', maximum=-NEVER)
    growth: float = _growth('how far a disturbance has grown')
    dying: int = _span('net time where no cycle exists while one is predicted')
    idle: int = _span('net time at rest, unloaded or measured quiet meanwhile')
    can: float = _chance('probability that a cycle exists, where there is a belief')
    will: float = _chance('that stick-slip starts by itself')
    runs: float = _chance('that it runs')
    amplitude: float = _number('m', 'of the exact cycle, where a limit needs it', start=0.0)
    sized: int = _time('when that was worked out')
    # What the latest point says.
    course: int = _count('a cycle exists, none exists, or nothing slides', maximum=2)
    rate: float = _number('1/s', 'growth rate of a disturbance there', start=0.0)
    # The rungs of the alarm, in the order of the ladder without normal.
    raised: int = _count('the rungs that are raised, as bits', maximum=31)
    asks: int = _count('the rungs that the latest point asks to change, as bits', maximum=31)
    count: list[int] = _span('net time for which each has been asked to change', 5)
    cleared: list[int] = _time('when each was last cleared; of a raised one: held', 5)
    # The measured level.
    level: float = _number('its own', 'latest level')
    vibrating: int = _count('unknown, quiet or vibrating', maximum=2)
    level_count: int = _difference('net time above the threshold; negative: below')
    still: int = _span('for how long the level has not moved')
    background: float = _number('dB', 'mean where no stick-slip is predicted')
    high_for: int = _span('how long it has been high')
    beyond_for: int = _span('for how long of that the point was beyond the fold, to the latest')
    grown_before: float = _growth('how far a disturbance had grown when it rose')
    doubt: int = _span('for how long yet what is short is not used', start=DOUBT // 2)
    heard: int = _flag('1 once the level has vibrated in this episode')
    unseen: int = _time('since when stick-slip is predicted and not measured')
    rival: float = _number('dB', 'how far the loudest other level is above its threshold')
    lead: float = _number('dB', 'how much further than this one, behind a lag of 1 s', start=0.0)
    # The water by which friction goes.
    water: float = _number('C', 'its temperature: the latest, or as configured until one has come')
    viscosity_ratio: float = _number('', 'its viscosity over that at the measurement', start=1.0)

    def copy(self) -> State:
        """Return a copy of the memory, which shares no list with it."""
        duplicate = State.__new__(State)
        for name in _NAMES:
            part = getattr(self, name)
            setattr(duplicate, name, list(part) if isinstance(part, list) else part)
        return duplicate

    def record(self) -> dict[str, Any]:
        """Return the memory as numbers and lists that JSON can hold, ``None`` for ``nan``."""
        return {name: _to_plain(getattr(self, name)) for name in _NAMES}

    def row(self) -> Any:
        """Return the memory as an array of one row, of :data:`STATE_TYPE`."""
        return to_record_array(self, STATE_TYPE)

    @classmethod
    def of_row(cls, row: Any) -> State:
        """Return the memory that a row of :data:`STATE_TYPE` holds."""
        return cls(*(part.tolist() if isinstance(part, np.ndarray) else part for part in row.item()))

    @classmethod
    def of_record(cls, record: Any) -> State:
        """Read the memory from what :meth:`record` gave, or what that of 0.2.0 did.

        What an earlier version did not have, or meant otherwise, has its value at a first start; any other
        float that is missing is ``nan``. What is not of the memory is ignored.

        Raises:
            ValueError: The record is no mapping; a list or whole number is missing, or a field is not of its
                kind, number and range.
        """
        if not isinstance(record, Mapping):
            raise ValueError(f'{record!r:.60} is no object')
        afresh = _AFRESH if 'odd' in record else ()
        parts = [part for part in fields(cls) if part.name not in afresh]
        parts = [part for part in parts if part.name in record or part.name not in (*_OF_WATER, *_OF_LEVEL)]
        return cls(**{part.name: _check_saved(part, record.get(part.name)) for part in parts})


_NAMES = tuple(part.name for part in fields(State))
_AFRESH = (
    *('shift', 'onsets', 'still', 'background', 'high_for', 'doubt', 'heard'),
    *('stamp', 'came', 'now', 'began', 'vibrating', 'level_count'),
)
"""What begins afresh after 0.2.0, which did not have it or meant something else by it."""
_OF_WATER = 'water', 'viscosity_ratio'
_OF_LEVEL = 'beyond_for', 'grown_before', 'rival', 'lead'
"""What a level's memory up to 0.3.0 did not have: its defaults stand."""
_EVERY_INPUT = 'stamp', 'came', 'gap', 'pace'
"""What has one number for each input, and up to 0.3.0 none for the temperature of the water."""


def record_type_of(owner: type) -> np.dtype[Any]:
    """Return the numpy record type of a dataclass of numbers: int64, float64, and arrays for lists."""
    parts = []
    for item in fields(owner):
        size = item.metadata.get('size', len(Input) if 'list' in str(item.type) else 0)
        kind = 'f8' if 'float' in str(item.type) else 'i8'
        parts.append((item.name, kind, (size,)) if size else (item.name, kind))
    return np.dtype(parts)


def to_record_array(owner: Any, kind: np.dtype[Any]) -> Any:
    """Return the numbers of an object as an array of one record."""
    row = np.zeros(1, kind)
    for name in kind.names or ():
        row[name] = getattr(owner, name)
    return row


STATE_TYPE = record_type_of(State)


def _check_saved(part: Any, saved: Any) -> Any:
    """Check the saved value of a part of the memory, and return it with ``None`` as ``nan``.

    ``part`` is its dataclass field. A list of one number for each input that lacks the last, as up to 0.3.0,
    gets the default for it.

    Raises:
        ValueError: It is not of its kind, number and range.
    """
    size, saved_numbers = part.metadata['size'], saved if isinstance(saved, list) else [saved]
    if part.name in _EVERY_INPUT and isinstance(saved, list) and len(saved) == size - 1:
        saved_numbers = [*saved, part.default_factory()[-1]]
    if len(saved_numbers) != max(size, 1) or isinstance(saved, list) != bool(size):
        raise refused(part.name, saved, f'{size or "a"} number{"s"[:size]}')
    whole, (minimum, maximum) = 'int' in part.type, part.metadata['range']
    numbers = []
    for value in saved_numbers:
        number = math.nan if value is None and not whole else value
        if type(number) not in ((int,) if whole else (int, float)) or (
            not minimum <= number <= maximum and value is not None
        ):
            raise refused(part.name, value, f'from {minimum:g} to {maximum:g}')
        numbers.append(number if whole else float(number))
    return numbers if size else numbers[0]


def _to_plain(value: Any) -> Any:
    """Return a number, or a list of them, as JSON can hold it: ``nan`` as ``None``."""
    if isinstance(value, list):
        return [_to_plain(part) for part in value]
    return None if value != value else value
