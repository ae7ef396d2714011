# SPDX-License-Identifier: Apache-2.0
"""All that the monitor remembers of a bearing, as one flat record, and the settings of its rule.

:data:`FIELDS` is the whole memory: name, kind, how many, unit and meaning. Live it is a
:class:`State` of Python numbers, over a recording one row of :data:`STATE_TYPE`, and kept between
runs it is a dictionary; the rule (:mod:`.rule`) reads and writes all of them by the same names.
:class:`RuleSettings` are what it takes of the configuration, as numbers.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.monitor.config import BearingConfig
from stickslip_monitor.physics.boundary_table import (
    BoundaryTable,
    known_table,
)
from stickslip_monitor.physics.law_numbers import law_numbers
from stickslip_monitor.physics.oscillator import Bearing

NEVER = -(2**62)
"""Stands for a time that has not been [ns]."""
# See docs/alarms.md, "Why these numbers".
DECAY = 4.8
"""How long a cycle outlives the fold [2 m/c]."""


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
        'odd', 'i8', 3, 'ns', NEVER, 'stamp that waits for the next two samples to agree with it'
    ),
    StateField('agreed', 'i8', 3, '', 0, '1 once a sample has agreed with it'),
    StateField('came', 'i8', 2, 'ns', NEVER, 'from when the age of speed and load is counted'),
    StateField('gap', 'i8', 3, 'ns', 0, 'time between two stamps of each input; long ones fade'),
    StateField('pace', 'i8', 3, 'ns', 0, 'usual time between two: the shorter of the last'),
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
    StateField('responds', 'i8', 0, '', 0, '1 once the level has risen where a cycle exists'),
    StateField('loud', 'f8', 0, '', 0, 'share of the time outside in which the level is high'),
    StateField('outside', 'i8', 0, 'ns', NEVER, 'when the level last showed something else'),
    StateField(
        'spell', 'i8', 0, 'ns', NEVER, 'since when the level has been high, with short rests'
    ),
    StateField('high', 'i8', 0, 'ns', NEVER, 'when it was last not low'),
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
        return {name: _plain(getattr(self, name)) for name in self.__slots__}

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
        """The memory from what :meth:`record` gave.

        Raises:
            ValueError: A field is missing, or is not of its kind and number.
        """
        state = cls()
        for f in FIELDS:
            found = record.get(f.name)
            parts = found if isinstance(found, list) else [found]
            if f.name in ('gap', 'pace') and len(parts) == 2:  # before, the level had none
                parts = [*parts, 0]
            if len(parts) != max(f.size, 1) or isinstance(found, list) != bool(f.size):
                raise ValueError(f'{f.name} = {found!r} must be {f.size or "a"} {f.kind}')
            numbers = [_number(f, part) for part in parts]
            setattr(state, f.name, numbers if f.size else numbers[0])
        return state


def _number(field: StateField, value: Any) -> float:
    if field.kind == 'f8' and value is None:
        return math.nan
    kinds = (int,) if field.kind == 'i8' else (int, float)
    if isinstance(value, bool) or not isinstance(value, kinds) or not abs(value) < 2**63:
        raise ValueError(f'{field.name} = {value!r} must be a number')
    return value if field.kind == 'i8' else float(value)


def _plain(value: Any) -> Any:
    if isinstance(value, list):
        return [_plain(part) for part in value]
    return None if value != value else value


_ENDLESS = 2**62
_NAMED = np.dtype(
    [
        ('scale', 'f8', (3,)),
        ('offset', 'f8', (3,)),
        ('factor', 'f8', (3,)),
        ('deadband', 'f8', (3,)),
        ('minimum', 'f8', (3,)),
        ('maximum', 'f8', (3,)),
        ('timeout', 'i8', (3,)),
        *((name, 'i8') for name in ('on_delay', 'off_delay', 'decay')),
        *((name, 'i8') for name in ('has_belief', 'has_level', 'in_db', 'tells_other')),
        *((name, 'f8') for name in ('mass', 'damping', 'stiffness', 'per_mass', 'lean')),
        *((name, 'f8') for name in ('onset_growth', 'look_ahead', 'caution_on', 'caution_off')),
        *((name, 'f8') for name in ('caution_chance', 'can_chance', 'runs_chance')),
        *((name, 'f8') for name in ('amplitude_limit', 'amplitude_off')),
        *((name, 'f8') for name in ('threshold', 'hysteresis', 'table_first', 'table_step')),
    ]
)


@dataclass(frozen=True)
class RuleSettings:
    """What the rule takes beside the memory, for live samples and for recordings.

    Attributes:
        live: The numbers by name, and lists where there are several.
        law: The friction law's numbers.
        boundaries: The boundaries over the load.
        chances: The table of a belief; of no matter without one.
    """

    live: SimpleNamespace
    law: tuple[float, ...]
    boundaries: BoundaryTable
    chances: FloatArray

    @cached_property
    def table(self) -> list[list[tuple[float, ...]]]:
        """The boundaries' polynomials as lists, which are fast one by one."""
        return [[tuple(row) for row in part] for part in self.boundaries.pieces.tolist()]

    @cached_property
    def belief(self) -> list[float]:
        """The table of a belief as a list."""
        found: list[float] = self.chances.tolist()
        return found

    @cached_property
    def row(self) -> Any:
        """The numbers as an array of one row, for compiled loops."""
        row = np.zeros(1, _NAMED)
        for name in _NAMED.names or ():
            row[name] = getattr(self.live, name)
        return row


def settings_of(config: BearingConfig) -> RuleSettings:
    """The settings of a bearing; its boundaries are tabulated now, once for each bearing."""
    bearing, alarm, belief, level = config.bearing, config.alarm, config.belief, config.level
    table = known_table(bearing)
    inputs = [config.speed, config.load, config.speed if level is None else level]
    in_db = level is not None and level.unit == 'dB'
    margin = 1.0 + alarm.caution_margin
    live = SimpleNamespace(
        **{
            name: [getattr(each, name) for each in inputs]
            for name in ('scale', 'offset', 'factor', 'deadband', 'maximum')
        },
        minimum=[-math.inf, -math.inf, -math.inf if in_db else 0.0],
        timeout=[each.timeout_ns for each in inputs],
        on_delay=alarm.on_delay_ns,
        off_delay=alarm.off_delay_ns,
        decay=_decay_ns(bearing, alarm.onset_growth),
        has_belief=int(belief is not None),
        has_level=int(level is not None),
        in_db=int(in_db),
        tells_other=int(level is not None and not level.learns),
        mass=bearing.mass,
        damping=bearing.damping,
        stiffness=bearing.stiffness,
        per_mass=0.5 / bearing.mass,
        lean=1.0 if belief is None else belief.lean(alarm.runs_probability),
        onset_growth=alarm.onset_growth,
        look_ahead=alarm.look_ahead_ns * 1e-9,
        caution_on=margin,
        caution_off=margin + alarm.hysteresis,
        caution_chance=alarm.caution_probability,
        can_chance=alarm.can_probability,
        runs_chance=alarm.runs_probability,
        amplitude_limit=alarm.amplitude_limit,
        amplitude_off=alarm.amplitude_limit * (1.0 - alarm.hysteresis),
        threshold=math.nan if level is None else _decibels(level.threshold, in_db),
        hysteresis=0.0 if level is None else level.hysteresis,
        table_first=table.first,
        table_step=table.step,
    )
    chances = np.zeros(1) if belief is None else belief.table
    return RuleSettings(live, law_numbers(bearing.friction), table, chances)


def _decay_ns(bearing: Bearing, onset_growth: float) -> int:
    """How long a cycle outlives the fold; nothing where no memory is asked for [ns]."""
    if bearing.damping <= 0.0:
        return _ENDLESS
    return int(min(DECAY, onset_growth * DECAY) * 2e9 * bearing.mass / bearing.damping)


def _decibels(level: float, in_db: bool) -> float:
    return level if in_db or math.isnan(level) else 20.0 * math.log10(level)
