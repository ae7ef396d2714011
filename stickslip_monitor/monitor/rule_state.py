# SPDX-License-Identifier: Apache-2.0
"""All that the monitor remembers of a bearing, as one flat record.

:data:`FIELDS` is the whole memory: name, kind, how many, unit and meaning. Live it is a
:class:`State` of Python numbers, over a recording one row of :data:`STATE_TYPE`, and kept between
runs it is a dictionary; the rule (:mod:`.rule`) reads and writes all of them by the same names.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

NEVER = -(2**62)
"""Stands for a time that has not been [ns]."""


class StateField(NamedTuple):
    """One part of the memory: ``size`` numbers of a kind (``i8`` or ``f8``); 0 is a plain one."""

    name: str
    kind: str
    size: int
    unit: str
    start: float
    meaning: str


FIELDS = (
    # The inputs, in the order of :class:`~stickslip_monitor.monitor.signals.Input`.
    StateField('stamp', 'i8', 3, 'ns', NEVER, 'latest valid time stamp of each input'),
    StateField(
        'odd', 'i8', 3, 'ns', NEVER, 'stamp that waits for the next sample to agree with it'
    ),
    StateField('agreed', 'i8', 3, '', 0, 'how many samples have followed that one'),
    StateField('came', 'i8', 2, 'ns', NEVER, 'from when the age of speed and load is counted'),
    StateField('gap', 'i8', 2, 'ns', 0, 'time between the last two stamps of speed and load'),
    StateField('pace', 'i8', 2, 'ns', 0, 'the shorter of the last two of these'),
    StateField('value', 'f8', 2, 'SI', math.nan, 'latest speed [m/s] and load [N]'),
    StateField('before', 'f8', 2, 'SI', math.nan, 'the values before these'),
    StateField('earlier', 'f8', 2, 'SI', math.nan, 'the values before those'),
    # Time.
    StateField('now', 'i8', 0, 'ns', NEVER, 'latest time, on the clock of the samples'),
    StateField('began', 'i8', 0, 'ns', NEVER, 'from when inputs are waited for'),
    StateField('point', 'i8', 0, 'ns', NEVER, 'time of the latest operating point'),
    StateField('lost', 'i8', 0, '', 0, '1 while an input is lost'),
    StateField('lost_since', 'i8', 0, 'ns', NEVER, 'since when one is, or last was'),
    # The trend of the speed.
    StateField('fast', 'f8', 0, 'm/s', math.nan, 'speed behind a lag of 1 s'),
    StateField('slow', 'f8', 0, 'm/s', math.nan, 'speed behind a lag of 4 s'),
    StateField('load_mean', 'f8', 0, 'N', math.nan, 'load behind a lag of 4 s'),
    # Whether stick-slip runs.
    StateField('sticking', 'i8', 0, '', 0, '1 while stick-slip is predicted to run'),
    StateField('known', 'i8', 0, '', 0, '1 once it is known which state a bistable bearing is in'),
    StateField('growth', 'f8', 0, 'e-folds', 0, 'how far a disturbance has grown'),
    StateField('unsure', 'f8', 0, 'e-folds', 0, 'how much of that no median bears out'),
    StateField('dying', 'i8', 0, 'ns', 0, 'net time where no cycle exists while one is predicted'),
    StateField('idle', 'i8', 0, 'ns', 0, 'net time at rest, unloaded or measured quiet meanwhile'),
    StateField('can', 'f8', 0, '', 0, 'probability that a cycle exists, where there is a belief'),
    StateField('will', 'f8', 0, '', 0, 'that stick-slip starts by itself'),
    StateField('runs', 'f8', 0, '', 0, 'that it runs'),
    StateField('amplitude', 'f8', 0, 'm', 0, 'of the exact cycle, where a limit asks for it'),
    StateField('sized', 'i8', 0, 'ns', NEVER, 'when that was worked out'),
    # What the latest point says.
    StateField('course', 'i8', 0, '', 0, 'a cycle exists, none exists, or nothing slides'),
    StateField('rate', 'f8', 0, '1/s', 0, 'growth rate of a disturbance by the latest values'),
    StateField(
        'median_rate', 'f8', 0, '1/s', 0, 'the same by the medians of the last three values'
    ),
    # The rungs of the alarm, in the order of the ladder without normal.
    StateField('raised', 'i8', 0, 'bits', 0, 'the rungs that are raised'),
    StateField('asks', 'i8', 0, 'bits', 0, 'the rungs that the latest point asks to change'),
    StateField('count', 'i8', 5, 'ns', 0, 'net time for which each has been asked to change'),
    StateField(
        'cleared', 'i8', 5, 'ns', NEVER, 'when each was last cleared; of a raised one: held'
    ),
    # The measured level.
    StateField('vibrating', 'i8', 0, '', 0, 'unknown, quiet or vibrating'),
    StateField('level', 'f8', 0, 'unit', math.nan, 'latest level'),
    StateField('moved', 'i8', 0, 'ns', NEVER, 'stamp at which the level last changed'),
    StateField('level_count', 'i8', 0, 'ns', 0, 'net time above the threshold; negative: below'),
    StateField('level_mean', 'f8', 0, 'dB', math.nan, 'the level behind a lag of half a second'),
    StateField('level_peak', 'f8', 0, 'dB', math.nan, 'the highest of these since the level rose'),
    StateField('heard', 'i8', 0, '', 0, '1 once the level has risen where a cycle exists'),
    StateField('loud', 'f8', 0, '', 0, 'share of the time outside in which the level is high'),
    StateField('outside', 'i8', 0, 'ns', NEVER, 'when the level last told of something else'),
    StateField('spell', 'i8', 0, 'ns', NEVER, 'since when the level has been high'),
    StateField('ended', 'i8', 0, 'ns', NEVER, 'when it last ended so soon, without ringing down'),
    StateField('loudest', 'f8', 0, 'dB', math.nan, 'the highest of these means outside'),
    StateField('watched', 'i8', 0, 'ns', 0, 'for how long the level was watched outside'),
    StateField(
        'unseen', 'i8', 0, 'ns', NEVER, 'since when stick-slip is predicted and not measured'
    ),
)

STATE_TYPE = np.dtype(
    [(f.name, f.kind, (f.size,)) if f.size else (f.name, f.kind) for f in FIELDS]
)


class State:
    """The memory of a bearing as Python numbers, and lists where there are several."""

    __slots__ = tuple(f.name for f in FIELDS)

    if TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any: ...

        def __setattr__(self, name: str, value: Any) -> None: ...

    def __init__(self) -> None:
        for f in FIELDS:
            start = int(f.start) if f.kind == 'i8' else float(f.start)
            setattr(self, f.name, [start] * f.size if f.size else start)

    def copy(self) -> State:
        """The same memory once more."""
        other = State.__new__(State)
        for name in self.__slots__:
            value = getattr(self, name)
            setattr(other, name, list(value) if isinstance(value, list) else value)
        return other

    def record(self) -> dict[str, Any]:
        """The memory as numbers and lists that JSON can hold, ``None`` for ``nan``."""
        return {name: _told(getattr(self, name)) for name in self.__slots__}

    def row(self) -> Any:
        """The memory as an array of one row, of :data:`STATE_TYPE`."""
        row = np.zeros(1, STATE_TYPE)
        for name in self.__slots__:
            row[name] = getattr(self, name)
        return row

    @classmethod
    def of_row(cls, row: Any) -> State:
        """The memory that a row of :data:`STATE_TYPE` holds."""
        state = cls()
        for name in cls.__slots__:
            setattr(state, name, row[name].tolist())
        return state

    @classmethod
    def of_record(cls, record: Mapping[str, Any]) -> State:
        """The memory that :meth:`record` has told.

        Raises:
            ValueError: A field is missing, or is not of its kind and number.
        """
        state = cls()
        for f in FIELDS:
            found = record.get(f.name)
            parts = found if isinstance(found, list) else [found]
            if len(parts) != max(f.size, 1) or isinstance(found, list) != bool(f.size):
                raise ValueError(f'{f.name} = {found!r} must be {f.size or "a"} {f.kind}')
            numbers = [_number(f, part) for part in parts]
            setattr(state, f.name, numbers if f.size else numbers[0])
        return state


def _number(field: StateField, told: Any) -> float:
    if field.kind == 'f8' and told is None:
        return math.nan
    kinds = (int,) if field.kind == 'i8' else (int, float)
    if isinstance(told, bool) or not isinstance(told, kinds) or not abs(told) < 2**63:
        raise ValueError(f'{field.name} = {told!r} must be a number')
    return told if field.kind == 'i8' else float(told)


def _told(value: Any) -> Any:
    if isinstance(value, list):
        return [_told(part) for part in value]
    return None if value != value else value
