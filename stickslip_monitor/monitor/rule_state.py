# SPDX-License-Identifier: Apache-2.0
"""All that the monitor remembers of a bearing, as one flat record, and the numbers of its rule.

:class:`State` is the whole memory, each number declared with its unit, range and meaning. Live it
is an object of Python numbers, over a recording one row of :data:`STATE_TYPE`, and kept between
runs it is a dictionary; the rule (:mod:`.rule`) reads and writes all of them by the same names.
:class:`RuleNumbers` are what it takes of the configuration.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property, partial
from typing import Any

import numpy as np

from stickslip_logs.units import SECOND_NS
from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.monitor.parameters import MAX_LOAD_POINTS, BearingConfig
from stickslip_monitor.monitor.sample_types import INPUTS, Input
from stickslip_monitor.monitor.value_check import refused
from stickslip_monitor.physics.bearing import Bearing
from stickslip_monitor.physics.boundary_table import BoundaryTable, boundary_table
from stickslip_monitor.physics.lubrication import MIN_TEMPERATURE, Lubrication, as_measured, viscosity
from stickslip_monitor.physics.scalar_law import ScalarLaw, scalar_law

SPEED, LOAD, LEVEL, WATER = map(int, Input)  # older numba takes no enumeration as an index
NEVER = -(2**62)
"""Stands for a time that has not been [ns]."""
# See docs/rule.md, "Why these numbers".
DECAY = 4.8
"""How long a cycle outlives the fold [2 m/c]."""
DOUBT = 600 * SECOND_NS
"""For so long after a short vibration, half as long after a start, no short one is used; a level
that has not moved for so long is stuck [ns]."""
_LARGEST = 1e15
"""Largest magnitude of a saved number without a closer bound."""
_ZERO_CELSIUS = 273.15
"""0 C in kelvin, the unit of Signal K."""


def _declare_part(
    start: float,
    minimum: float,
    maximum: float,
    unit: str,
    meaning: str,
    size: int = 0,
    start_at: float | None = None,
) -> Any:
    """Declare one part of the memory: a list of ``size`` numbers, or one number for 0.

    Args:
        start: Value at a first start.
        minimum: Least value that a saved one may have.
        maximum: Largest such value.
        unit: Its unit.
        meaning: What it is, for the docs.
        size: How many numbers.
        start_at: A value in place of ``start``; ``None`` for none.
    """
    start = start if start_at is None else start_at
    facts = {'meaning': meaning, 'unit': unit, 'size': size, 'range': (minimum, maximum)}
    if size:
        return field(default_factory=lambda: [start] * size, metadata=facts)
    return field(default=start, metadata=facts)


_time = partial(_declare_part, NEVER, NEVER, -NEVER, 'ns')
_span = partial(_declare_part, 0, 0, -NEVER, 'ns')
_difference = partial(_declare_part, 0, NEVER, -NEVER, 'ns')
_flag = partial(_declare_part, 0, 0, 1, '')
_number = partial(_declare_part, math.nan, -_LARGEST, _LARGEST)
_growth = partial(_declare_part, 0.0, 0.0, _LARGEST, 'e-folds')
_chance = partial(_declare_part, 0.0, 0.0, 1.0, '')


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
    onsets: int = _declare_part(0, 0, -NEVER, '', 'how often it has begun after it was clear')
    growth: float = _growth('how far a disturbance has grown')
    dying: int = _span('net time where no cycle exists while one is predicted')
    idle: int = _span('net time at rest, unloaded or measured quiet meanwhile')
    can: float = _chance('probability that a cycle exists, where there is a belief')
    will: float = _chance('that stick-slip starts by itself')
    runs: float = _chance('that it runs')
    amplitude: float = _number('m', 'of the exact cycle, where a limit needs it', start_at=0.0)
    sized: int = _time('when that was worked out')
    # What the latest point says.
    course: int = _declare_part(0, 0, 2, '', 'a cycle exists, none exists, or nothing slides')
    rate: float = _number('1/s', 'growth rate of a disturbance there', start_at=0.0)
    # The rungs of the alarm, in the order of the ladder without normal.
    raised: int = _declare_part(0, 0, 31, '', 'the rungs that are raised, as bits')
    asks: int = _declare_part(0, 0, 31, '', 'the rungs that the latest point asks to change, as bits')
    count: list[int] = _span('net time for which each has been asked to change', 5)
    cleared: list[int] = _time('when each was last cleared; of a raised one: held', 5)
    # The measured level.
    level: float = _number('its own', 'latest level')
    vibrating: int = _declare_part(0, 0, 2, '', 'unknown, quiet or vibrating')
    level_count: int = _difference('net time above the threshold; negative: below')
    still: int = _span('for how long the level has not moved')
    background: float = _number('dB', 'mean where no stick-slip is predicted')
    high_for: int = _span('how long it has been high')
    beyond_for: int = _span('for how long of that the point was beyond the fold, to the latest')
    grown_before: float = _growth('how far a disturbance had grown when it rose')
    doubt: int = _span('for how long yet what is short is not used', start_at=DOUBT // 2)
    heard: int = _flag('1 once the level has vibrated in this episode')
    unseen: int = _time('since when stick-slip is predicted and not measured')
    rival: float = _number('dB', 'how far the loudest other level is above its threshold')
    lead: float = _number('dB', 'how much further than this one, behind a lag of 1 s', start_at=0.0)
    # The water by which friction goes.
    water: float = _number('C', 'its temperature: the latest, or as configured until one has come')
    viscosity_ratio: float = _number('', 'its viscosity over that at the measurement', start_at=1.0)

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
        return _to_row(self, STATE_TYPE)

    @classmethod
    def of_row(cls, row: Any) -> State:
        """Return the memory that a row of :data:`STATE_TYPE` holds."""
        return cls(*(part.tolist() if isinstance(part, np.ndarray) else part for part in row.item()))

    @classmethod
    def of_record(cls, record: Any) -> State:
        """Read the memory from what :meth:`record` gave, or what that of 0.2.0 did.

        Raises:
            ValueError: The record is no mapping; a field is missing, or is not of its kind, number and range.
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


def _type_of(owner: type) -> np.dtype[Any]:
    """Return the numpy record type of a dataclass of numbers: int64, float64, and arrays for lists."""
    parts = []
    for item in fields(owner):
        size = item.metadata.get('size', len(Input) if 'list' in str(item.type) else 0)
        kind = 'f8' if 'float' in str(item.type) else 'i8'
        parts.append((item.name, kind, (size,)) if size else (item.name, kind))
    return np.dtype(parts)


def _to_row(owner: Any, kind: np.dtype[Any]) -> Any:
    """Return the numbers of an object as an array of one record."""
    row = np.zeros(1, kind)
    for name in kind.names or ():
        row[name] = getattr(owner, name)
    return row


STATE_TYPE = _type_of(State)


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


@dataclass(frozen=True, slots=True)
class RuleNumbers:
    """Numbers that the rule takes from the configuration, and lists of one for each input.

    Times are in ns, but ``look_ahead`` is in s; those that begin with ``has``, ``by`` or ``in`` are 0 or 1.
    ``decay`` is how long stick-slip outlives the fold, ``per_mass`` ``1/(2 m)`` [1/kg], and ``lean`` how many
    times the load counts for growth, 1 where margins decide. ``caution_on`` and ``caution_off`` are multiples
    of the fold, ``threshold`` and ``hysteresis`` decibels. The three of the table are those of
    :class:`.BoundaryTable`; ``load_speed`` [m/s] and ``load_there`` [N] end in ``inf`` and ``nan``.
    """

    scale: list[float]
    offset: list[float]
    factor: list[float]
    deadband: list[float]
    minimum: list[float]
    maximum: list[float]
    timeout: list[int]
    hold: list[int]
    on_delay: int
    off_delay: int
    decay: int
    has_belief: int
    by_chance: int
    has_level: int
    in_db: int
    damping: float
    per_mass: float
    lean: float
    onset_growth: float
    look_ahead: float
    caution_on: float
    caution_off: float
    caution_chance: float
    can_chance: float
    runs_chance: float
    amplitude_limit: float
    amplitude_off: float
    threshold: float
    hysteresis: float
    table_first: float
    table_step: float
    table_growth: list[float] = field(metadata={'size': 3})
    at_load: float
    load_exponent: float
    viscosity_ratio: float
    water: float
    viscosity_then: float
    salinity: float
    has_load_table: int
    load_speed: list[float] = field(metadata={'size': MAX_LOAD_POINTS})
    load_there: list[float] = field(metadata={'size': MAX_LOAD_POINTS})


_NUMBERS_TYPE = _type_of(RuleNumbers)


@dataclass(frozen=True)
class RuleSettings:
    """Inputs of the rule beside the memory; without a belief its table is not read."""

    live: RuleNumbers
    law: ScalarLaw
    boundaries: BoundaryTable
    chances: FloatArray

    @cached_property
    def model(self) -> tuple[Any, list[list[tuple[float, ...]]], list[float]]:
        """The law, the boundaries' polynomials and the belief as lists, fast one by one."""
        table = [[tuple(row) for row in part] for part in self.boundaries.pieces.tolist()]
        return self.law.plain, table, self.chances.tolist()

    @cached_property
    def row(self) -> Any:
        """The numbers of the configuration as an array of one row, for compiled loops."""
        return _to_row(self.live, _NUMBERS_TYPE)


def settings_of(config: BearingConfig) -> RuleSettings:
    """Return the settings of the rule for a bearing; its boundaries are tabulated once and cached.

    An input that is not configured has the numbers of the speed, which are not read.
    """
    bearing, alarm, belief, level = config.bearing, config.alarm, config.belief, config.level
    table, lubrication = boundary_table(as_measured(bearing)), bearing.lubrication or Lubrication()
    # What is not measured has numbers of no matter.
    inputs = [config.inputs.get(name, config.speed) for name in INPUTS]
    in_db = level is not None and level.unit == 'dB'
    margin = 1.0 + alarm.caution_margin
    live = RuleNumbers(
        **{
            name: [getattr(source, name) for source in inputs]
            for name in ('scale', 'factor', 'deadband', 'maximum')
        },
        offset=[source.offset - (_ZERO_CELSIUS if source.unit == 'K' else 0.0) for source in inputs],
        minimum=[-math.inf, config.load.minimum, -math.inf if in_db else 0.0, MIN_TEMPERATURE],
        timeout=[source.stands_ns for source in inputs],
        hold=[source.hold_ns for source in inputs],
        on_delay=alarm.on_delay_ns,
        off_delay=alarm.off_delay_ns,
        decay=_decay_ns(bearing, alarm.onset_growth),
        has_belief=int(belief is not None),
        by_chance=int(config.alarms_by_chance),
        has_level=int(level is not None),
        in_db=int(in_db),
        damping=bearing.damping,
        per_mass=0.5 / bearing.mass,
        lean=belief.load_factor(alarm.runs_probability) if belief and config.alarms_by_chance else 1.0,
        onset_growth=alarm.onset_growth,
        look_ahead=alarm.look_ahead_ns * 1e-9,
        caution_on=margin,
        caution_off=margin + alarm.hysteresis,
        caution_chance=alarm.caution_probability,
        can_chance=alarm.can_probability,
        runs_chance=alarm.runs_probability,
        amplitude_limit=alarm.amplitude_limit,
        amplitude_off=alarm.amplitude_limit * (1.0 - alarm.hysteresis),
        threshold=math.nan if level is None else _to_decibels(level.threshold, in_db=in_db),
        hysteresis=0.0 if level is None else level.hysteresis,
        table_first=table.first,
        table_step=table.step,
        table_growth=table.growth.tolist(),
        at_load=lubrication.load,
        load_exponent=lubrication.load_exponent,
        viscosity_ratio=lubrication.viscosity_ratio,
        water=lubrication.water_temperature,
        viscosity_then=float(viscosity(lubrication.temperature, lubrication.salinity)),
        salinity=lubrication.water_salinity,
        has_load_table=int(bool(config.load.table[0])),
        load_speed=_pad_points(config.load.table[0], math.inf),
        load_there=_pad_points(config.load.table[1], math.nan),
    )
    chances = np.zeros(1) if belief is None else belief.table
    return RuleSettings(live, scalar_law(bearing.friction), table, chances)


def _pad_points(points: Sequence[float], end: float) -> list[float]:
    """Return the points of a table, filled up with ``end`` to :data:`.parameters.MAX_LOAD_POINTS`."""
    return [*points, *[end] * (MAX_LOAD_POINTS - len(points))]


def _decay_ns(bearing: Bearing, onset_growth: float) -> int:
    """Return for how long stick-slip outlives the fold [ns].

    0 where growth has no memory (``onset_growth`` is 0); the largest number without damping.
    """
    if bearing.damping <= 0.0:
        return -NEVER
    return int(min(DECAY, onset_growth * DECAY) * 2e9 * bearing.mass / bearing.damping)


def _to_decibels(level: float, *, in_db: bool) -> float:
    """Return ``20 log10`` of a threshold > 0; one that is ``in_db`` already, or ``nan``, as it is."""
    return level if in_db or math.isnan(level) else 20.0 * math.log10(level)
