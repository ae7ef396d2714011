# SPDX-License-Identifier: Apache-2.0
"""Compares the levels of a ship's bearings: a sensor hears the stick-slip of another one, too.

Each level is taken relative to its own threshold, which stands for the cycle of its own bearing. Live each
level is compared as it comes, over a recording in one pass before the bearings are judged; both run
:func:`compare_level`. What follows is decided by :mod:`.vibration_rule`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, MutableSequence, Sequence
from dataclasses import replace
from importlib import import_module
from typing import Any

import numpy as np

from stickslip_monitor import jit
from stickslip_monitor.arrays import FloatArray, IntArray
from stickslip_monitor.monitor import rule, vibration_rule
from stickslip_monitor.monitor.parameters import BearingConfig
from stickslip_monitor.monitor.rule import ACCEPTED, LATE, MEMORY, judge_value, si_value
from stickslip_monitor.monitor.rule_settings import RuleNumbers, settings_of
from stickslip_monitor.monitor.rule_state import DOUBT, LEVEL, NEVER
from stickslip_monitor.monitor.sample_types import Stream
from stickslip_monitor.monitor.vibration_rule import excess_over_threshold

SOURCE, CAME, GAP, CHANGED = range(4)
"""What is remembered of a level beside its latest valid value: number of its input; when it came, how long
after the one before, and since when it has had this value [ns]."""


def compare_level(
    levels: Sequence[MutableSequence[int]],
    values: MutableSequence[float],
    numbers: Sequence[RuleNumbers],
    row: int,
    arrival: int,
    number: float,
) -> float:
    """Return how far the loudest other level is above its threshold, and store the one that came, if valid.

    Args:
        levels: What is remembered of the level of each bearing, four numbers each, changed.
        values: The latest valid values of the levels, each in its own unit, changed.
        numbers: The numbers of their configurations.
        row: Index of the bearing whose level came.
        arrival: When it came [ns].
        number: The number in the message.

    Returns:
        The excess of the loudest level of another input [dB]; ``nan`` where none is current.
    """
    loudest, level, c = math.nan, levels[row], numbers[row]
    for k in range(len(values)):
        if levels[k][SOURCE] != level[SOURCE] and is_current(levels[k], numbers[k], arrival):
            excess = excess_over_threshold(numbers[k], values[k])
            if excess > loudest or loudest != loudest:
                loudest = excess
    si = si_value(c, LEVEL, number)
    if judge_value(c, LEVEL, number, si) == ACCEPTED:
        level[GAP] = arrival - level[CAME] if level[CAME] != NEVER else 0
        if si != values[row]:
            level[CHANGED] = arrival
        values[row], level[CAME] = si, arrival
    return loudest


def is_current(level: Sequence[int], c: RuleNumbers, arrival: int) -> bool:
    """Return whether a level is neither lost nor stuck at a time [ns], which may be before it came.

    It is lost after its time-out, or after 2.5 of its latest gap if that is longer, five minutes at most.
    """
    limit = max(c.timeout[LEVEL], min(LATE * level[GAP], MEMORY))
    return bool(abs(arrival - level[CAME]) <= limit and level[CAME] - level[CHANGED] <= DOUBT)


def compare_levels(
    levels: Sequence[MutableSequence[int]],
    values: MutableSequence[float],
    numbers: Sequence[RuleNumbers],
    samples: tuple[Sequence[int], Sequence[int], Sequence[float]],
    rivals: MutableSequence[float],
) -> None:
    """Fill ``rivals`` by :func:`compare_level` for rows, arrivals [ns] and numbers of successive levels.

    ``levels`` and ``values`` change as there.
    """
    rows, arrivals, level_numbers = samples
    for k in range(len(rivals)):
        rivals[k] = compare_level(levels, values, numbers, rows[k], arrivals[k], level_numbers[k])


class LevelComparison:
    """The latest levels of a ship's bearings, each compared with those of the others.

    Args:
        bearings: All bearings; those without a level are left out.
        long: Whether columns are compared by compiled code.
    """

    def __init__(self, bearings: Sequence[BearingConfig], *, long: bool = False) -> None:
        self._long = long
        self.retune(bearings)
        inputs = [bearing.level for bearing in bearings if bearing.level is not None]
        sources = [(level.topic, level.field_text) for level in inputs]
        self._has_several = len(set(sources)) > 1
        self._levels: Any = [[sources.index(source), NEVER, 0, NEVER] for source in sources]
        self._values: Any = [math.nan] * len(sources)
        if long:
            self._levels, self._values = np.array(self._levels, np.int64), np.array(self._values)

    def retune(self, bearings: Sequence[BearingConfig]) -> None:
        """Take over new thresholds, scales and timeouts of the same bearings."""
        measured = [bearing for bearing in bearings if bearing.level is not None]
        self._rows = {bearing.name: row for row, bearing in enumerate(measured)}
        settings = [settings_of(bearing) for bearing in measured]
        self._numbers: Any = [item.live for item in settings]
        if self._long and settings:
            self._numbers = np.concatenate([item.row for item in settings])

    def take(self, name: str, arrival_ns: int, number: float) -> float:
        """Store a number of a bearing's level that came; return the excess of the loudest other level.

        As of :func:`compare_level`; ``nan`` where all bearings have one input.
        """
        if not self._has_several:
            return math.nan
        return compare_level(self._levels, self._values, self._numbers, self._rows[name], arrival_ns, number)

    def take_columns(
        self, columns: Mapping[str, tuple[IntArray, IntArray, FloatArray]]
    ) -> dict[str, FloatArray]:
        """Compare the next levels of a recording, and store the latest of each bearing.

        Args:
            columns: Of each bearing with a level by name: rising places in the recording, arrivals [ns] and
                numbers of n levels. Equal places count in the order of the bearings.

        Returns:
            For each of the bearings the excess of the loudest other level at each of its own, shape (n,), as
            of :func:`compare_level`; an empty dictionary, and nothing stored, where there is no other.
        """
        if not self._has_several or len(columns) < 2:
            return {}
        sizes = [arrival_ns.size for _, arrival_ns, _ in columns.values()]
        rows = np.repeat([self._rows[name] for name in columns], sizes)
        place, *samples = (np.concatenate(parts) for parts in zip(*columns.values(), strict=True))
        order = np.lexsort((rows, place))
        ordered: Any = [column[order] for column in (rows, *samples)]
        rivals, merged = np.empty(order.size), np.empty(order.size)
        loop: Any = compare_levels
        if self._long:
            loop = jit.compiled('compare_levels', import_module(__name__), rule, vibration_rule)
        else:
            ordered = [column.tolist() for column in ordered]
        loop(self._levels, self._values, self._numbers, tuple(ordered), merged)
        rivals[order] = merged
        return {name: rivals[rows == self._rows[name]] for name in columns}


def add_rivals(stream: Stream, rivals: FloatArray | None) -> Stream:
    """Return a stream with the excess of the loudest other level at each of its own; as is for ``None``."""
    if rivals is None:
        return stream
    column = np.full(stream.time_ns.size, math.nan)
    column[stream.inputs == LEVEL] = rivals
    return replace(stream, rival=column)


def compare_streams(bearings: Sequence[BearingConfig], streams: Mapping[str, Stream]) -> dict[str, Stream]:
    """Return whole recordings of bearings by name, their levels compared in the order in which they came.

    Where a clock was set back, what came then follows what had come. At one time the bearings' order counts.
    Recordings without a level, or of no two levels, come back as they are.

    Args:
        bearings: The bearings.
        streams: A recording of each of them, by name.
    """
    columns = {}
    for bearing in bearings:
        if bearing.level is not None:
            stream = streams[bearing.name]
            rows = stream.inputs == LEVEL
            place = np.maximum.accumulate(stream.arrival_ns)[rows]
            columns[bearing.name] = place, stream.arrival_ns[rows], stream.value[rows]
    rivals = LevelComparison(bearings).take_columns(columns)
    return {name: add_rivals(stream, rivals.get(name)) for name, stream in streams.items()}
