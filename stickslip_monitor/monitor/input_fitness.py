# SPDX-License-Identifier: Apache-2.0
"""Finds inputs that cannot do their job: values that are held or slow, and a load computed from the speed.

Evidence is the values themselves, live and offline: a dozen new values that come at a slow regular
pace, a dozen slow values of a level, and a load that follows the speed alone at two visits of the same
speeds. Nothing here changes a verdict; each finding is a clause that follows the name of the input and
says what to do.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stickslip_logs.units import SECOND_NS
from stickslip_monitor.arrays import BoolArray, FloatArray, IntArray
from stickslip_monitor.monitor.sample_types import QUANTITIES, Input

# Each with the measurement that chose it: docs/rule.md, "Why these numbers".
MIN_SLOW = 3.0
"""From this interval between new values on a swell, and short stick-slip, fall between them; of a level two
values, which each count for half of it at most, then show no vibration in that time [s]."""
_CHANGES = 12
"""New values whose intervals are judged together."""
_REGULAR, _MIN_REGULAR = 0.15, 10
"""So many of these intervals are multiples of their median, within this share of it."""
_UNEVEN, _MIN_UNEVEN = 1.5, 6
"""So many steps are larger than the smallest by this factor: even ones are a sensor's resolution."""
_MAX_MISSES = 3
"""So many dozens in a row that show nothing take the finding back."""
_MIN_COPIES = 2.0
"""Messages for each new value from which on values are held."""
_MIN_STEP = 0.02
"""Slow values whose median step is less than this share of them are steady, as far as they show."""
_PAIRS, _GROUP, _MIN_GROUPS = 512, 32, 4
"""Pairs of speed and load that are judged together, in groups of like speeds, and least number of groups."""
_PAIR_NS = 2 * SECOND_NS
"""Time between two pairs [ns]."""
_VISIT_SECONDS = 30.0
"""A group is of two visits to its speeds where so much time lies between [s]."""
_MIN_RANGE = 0.1
"""A load that changes by less than this share of it shows no dependence."""
_FOLLOWS = 0.9
"""Share of a load's changes that the speed explains from which on it is computed from the speed."""


@dataclass(slots=True)
class _Changes:
    """The intervals at which an input brings new values."""

    time_ns: IntArray = field(default_factory=lambda: np.empty(0, np.int64))  # of new values
    value: FloatArray = field(default_factory=lambda: np.empty(0))
    messages: IntArray = field(default_factory=lambda: np.empty(0, np.int64))  # counted at each new value
    count: int = 0  # messages so far
    misses: int = 0  # blocks since the latest one that showed something
    clause: str = ''

    def take(self, time_ns: IntArray, value: FloatArray) -> None:
        """Take values at rising times [ns], shape (n,), n > 0; a value like the one before is not new.

        Each dozen of new values sets ``clause``, on how slowly they come, leaves it, or clears it to ''.
        """
        is_new = self._find_new(value)
        new = np.arange(value.size) if is_new.all() else np.flatnonzero(is_new)
        if new.size < value.size:
            time_ns, value = time_ns[new], value[new]
        self.time_ns = np.append(self.time_ns, time_ns)
        self.value = np.append(self.value, value)
        self.messages = np.append(self.messages, self.count + new)
        self.count += is_new.size
        blocks = (self.time_ns.size - 1) // _CHANGES
        if blocks > 0:
            self._judge_blocks(blocks)
            done = blocks * _CHANGES
            self.time_ns, self.value = self.time_ns[done:], self.value[done:]
            self.messages = self.messages[done:]

    def _find_new(self, value: FloatArray) -> BoolArray:
        """Return which of the next values, shape (n,), n > 0, differ from the one before."""
        is_new = np.empty(value.size, np.bool_)
        np.not_equal(value[1:], value[:-1], out=is_new[1:])
        is_new[0] = not (self.value.size and value[0] == self.value[-1])
        return is_new

    def _judge_blocks(self, blocks: int) -> None:
        """Judge the first ``blocks`` > 0 dozens: set ``clause`` by the latest that is slow and regular.

        Three others in a row, which ``misses`` counts, clear it. The columns stay.
        """
        gap_ns = _split_steps(self.time_ns, blocks)
        # As a rule none of them is slow, which is known at once.
        slow = np.empty(0, np.intp)
        if gap_ns.max() >= MIN_SLOW * 1e9:
            slow = np.flatnonzero(gap_ns.min(axis=1) >= MIN_SLOW * 1e9)
        if slow.size:
            gap, change = gap_ns * 1e-9, _split_steps(self.value, blocks)
            slow = slow[self._is_evidence(gap[slow], np.abs(change[slow]))]
        if not slow.size:
            self.misses += blocks
        else:
            latest = int(slow[-1])
            self.misses = blocks - 1 - latest
            self.clause = self._clause_of(gap[latest], change[latest], latest * _CHANGES)
        if self.misses >= _MAX_MISSES:
            self.clause = ''

    def _is_evidence(self, gap: FloatArray, step: FloatArray) -> BoolArray:
        """Return which rows of slow intervals and steps, shape (n, 12), count; see :func:`_is_regular`."""
        return _is_regular(gap, step)

    def _clause_of(self, gap: FloatArray, step: FloatArray, first: int) -> str:
        """Return the clause on a slow dozen of intervals [s] and steps; '' where the values are steady.

        ``first`` is the index of the new value with which the dozen begins.
        """
        usual = float(np.median(gap))
        copies = float(self.messages[first + _CHANGES] - self.messages[first]) / _CHANGES
        if copies >= _MIN_COPIES:
            return (
                f'has a new value only every {usual:.3g} s, though {copies / usual:.2g} messages a second'
                ' come: have its sender pass on each measurement, at least one a second'
            )
        size = float(np.median(np.abs(self.value[first : first + _CHANGES])))
        share = float(np.median(np.abs(step))) / size if size > 0.0 else 0.0
        if share < _MIN_STEP:
            return ''
        return (
            f'has a value only every {usual:.3g} s and changes by {share:.0%} between them, so that a swell'
            ' seems to last for minutes: have its sender pass on at least one a second'
        )


@dataclass(slots=True)
class _LevelPace(_Changes):
    """The intervals at which a level comes, changed or not: no vibration shows before two values of it."""

    def _find_new(self, value: FloatArray) -> BoolArray:
        """Return that each of the next values counts."""
        return np.ones(value.size, np.bool_)

    def _is_evidence(self, gap: FloatArray, step: FloatArray) -> BoolArray:
        """Return that each row of slow intervals counts, regular or not: a level on change is as slow."""
        del step
        return np.ones(len(gap), np.bool_)

    def _clause_of(self, gap: FloatArray, step: FloatArray, first: int) -> str:
        """Return the clause on a slow dozen of intervals [s]."""
        del step, first
        return (
            f'has a value only every {np.median(gap):.3g} s, and a vibration shows by two of them: have its'
            ' sender pass on at least one a second'
        )


def _split_steps(column: NDArray[Any], blocks: int) -> NDArray[Any]:
    """Return the steps between the first ``12 * blocks + 1`` values of a column, shape (blocks, 12)."""
    return np.asarray(np.diff(column[: blocks * _CHANGES + 1]).reshape(blocks, _CHANGES))


def _is_regular(gap: FloatArray, step: FloatArray) -> BoolArray:
    """Return which rows of intervals and steps, shape (n, 12), have a regular pace and uneven steps."""
    share = gap / np.median(gap, axis=1, keepdims=True)
    regular = np.abs(share - np.maximum(1.0, np.round(share))) <= _REGULAR
    uneven = step >= _UNEVEN * step.min(axis=1, keepdims=True)
    return np.asarray((regular.sum(axis=1) >= _MIN_REGULAR) & (uneven.sum(axis=1) >= _MIN_UNEVEN))


@dataclass(slots=True)
class _Pairs:
    """Speeds and loads at the same times."""

    slot: int = -1  # the two seconds of the latest pair
    rows: FloatArray = field(default_factory=lambda: np.empty((0, 3)))  # time [s], speed, load
    clause: str = ''

    def take(self, time_ns: IntArray, speed: FloatArray, load: FloatArray) -> None:
        """Take operating points at rising times [ns], shape (n,), n > 0; keep one of each two seconds.

        Each 512 that are kept set or clear ``clause``, unless nothing can be told of them, and are forgotten.
        """
        slot = time_ns // _PAIR_NS
        is_first = np.empty(slot.size, np.bool_)
        np.greater(slot[1:], slot[:-1], out=is_first[1:])
        is_first[0] = slot[0] > self.slot
        first = np.flatnonzero(is_first)
        if not first.size:
            return
        self.slot = int(slot[first[-1]])
        pairs = np.column_stack([time_ns[first] * 1e-9, np.abs(speed[first]), load[first]])
        self.rows = np.concatenate([self.rows, pairs])
        blocks = len(self.rows) // _PAIRS
        for rows in np.split(self.rows[: blocks * _PAIRS], blocks) if blocks else ():
            if (follows := explained_share(rows)) is not None:
                self.clause = _COMPUTED if follows >= _FOLLOWS else ''
        self.rows = self.rows[blocks * _PAIRS :]


_COMPUTED = (
    'follows from the speed alone, so it is computed and does not show what the bearing carries: connect a'
    ' measured load, or give the largest one as load.constant'
)


def explained_share(rows: FloatArray) -> float | None:
    """Return the share of a load's changes that the speed explains, among visits to the same speeds.

    Args:
        rows: Time [s], speed and load of some pairs, shape (n, 3), n a multiple of 32.

    Returns:
        The share by straight lines through groups of like speeds; ``None`` where too few groups are
        of two visits, or the load hardly changes.
    """
    # As a rule the load hardly changes, in any groups.
    if np.ptp(rows[:, 2]) < _MIN_RANGE * np.abs(rows[:, 2]).min():
        return None
    groups = rows[np.argsort(rows[:, 1], kind='stable')].reshape(-1, _GROUP, 3)
    visits = np.diff(np.sort(groups[:, :, 0], axis=1), axis=1).max(axis=1) >= _VISIT_SECONDS
    groups = groups[visits]
    load = groups[:, :, 2]
    if len(groups) < _MIN_GROUPS or np.ptp(load) < _MIN_RANGE * np.abs(load).max():
        return None
    x, y = (groups[:, :, k] - groups[:, :, k].mean(axis=1, keepdims=True) for k in (1, 2))
    xx, xy, yy = (x * x).sum(axis=1), (x * y).sum(axis=1), (y * y).sum(axis=1)
    left = yy - np.divide(xy * xy, xx, out=np.zeros_like(xx), where=xx > 0.0)
    return float(1.0 - left.sum() / yy.sum()) if yy.sum() > 0.0 else None


class FitnessWatch:
    """Judges speed, load and level of a bearing."""

    def __init__(self) -> None:
        self._changes = (*(_Changes() for _ in QUANTITIES), _LevelPace())
        self._pairs = _Pairs()

    def take_values(self, place: int, time_ns: IntArray, si: FloatArray) -> None:
        """Take valid values of an input, speed, load or level, in order of arrival, shape (n,).

        Args:
            place: Index of the input.
            time_ns: When they came, rising [ns].
            si: The values in SI units, a level in its own.
        """
        if si.size:
            self._changes[place].take(time_ns, si)

    def take_points(self, time_ns: IntArray, speed: FloatArray, load: FloatArray) -> None:
        """Take operating points in order of time, shape (n,) [ns], [m/s] and [N]."""
        if time_ns.size:
            self._pairs.take(time_ns, speed, load)

    def clause(self, place: int) -> str:
        """Return the fault of an input and its remedy, to follow the name of the input; '' for none.

        ``place`` is the index of speed, load or level.
        """
        return self._changes[place].clause or (self._pairs.clause if place == Input.LOAD else '')
