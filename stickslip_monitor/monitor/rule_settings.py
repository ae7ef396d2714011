# SPDX-License-Identifier: Apache-2.0
"""The settings of a bearing as the numbers that the rule takes."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from types import SimpleNamespace
from typing import Any

import numpy as np

from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.monitor.config import BearingConfig
from stickslip_monitor.monitor.rule import DECAY
from stickslip_monitor.physics.boundary_table import (
    BoundaryTable,
    known_table,
)
from stickslip_monitor.physics.law_numbers import law_numbers
from stickslip_monitor.physics.oscillator import Bearing

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
        *((name, 'i8') for name in ('believes', 'has_level', 'in_db', 'tells_other')),
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
        believes=int(belief is not None),
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
