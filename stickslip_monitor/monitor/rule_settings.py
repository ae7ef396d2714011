# SPDX-License-Identifier: Apache-2.0
"""The settings of the rule for a bearing: its configuration in the numbers and tables that the rule reads."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.monitor.parameters import MAX_LOAD_POINTS, BearingConfig
from stickslip_monitor.monitor.rule_state import NEVER, record_type_of, to_record_array
from stickslip_monitor.monitor.sample_types import INPUTS
from stickslip_monitor.physics.bearing import Bearing
from stickslip_monitor.physics.boundary_table import BoundaryTable, boundary_table
from stickslip_monitor.physics.lubrication import MIN_TEMPERATURE, Lubrication, as_measured, viscosity
from stickslip_monitor.physics.scalar_law import ScalarLaw, scalar_law

# See docs/rule.md, "Why these numbers".
DECAY = 4.8
"""How long a cycle outlives the fold [2 m/c]."""
_ZERO_CELSIUS = 273.15
"""0 C in kelvin, the unit of Signal K."""


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


_NUMBERS_TYPE = record_type_of(RuleNumbers)


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
    def row(self) -> np.ndarray:
        """The numbers of the configuration as an array of one row, for compiled loops."""
        return to_record_array(self.live, _NUMBERS_TYPE)


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
