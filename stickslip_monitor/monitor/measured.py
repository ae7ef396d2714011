# SPDX-License-Identifier: Apache-2.0
"""Measured vibration: whether the lining vibrates, by an RMS value or a band level.

The level tells vibration from quiet by a threshold, a deadband below it and three seconds of net
time. Towards vibration only a level counts that does not fall by 3 dB, as that of a lining that
rings down after a blow does. It is *unknown* until either has been seen for that long, while the
level is lost or stuck, and as long as there is no threshold. What is unknown takes nothing from
the verdict on speed and load.

A value that repeats the one before it says nothing: a live level is never twice the same, and a
sensor that dies repeats its last value for ever, whether that was quiet or full scale. No value
counts for more than half of that time, however long it is held.

The level has a clock of its own: its stamps move no other input's time. It is compared with the
operating points by :meth:`LevelTracker.at`, at their times.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stickslip_monitor.arrays import BoolArray, FloatArray, IntArray
from stickslip_monitor.monitor.assessment import SentenceEnum
from stickslip_monitor.monitor.config import LevelConfig
from stickslip_monitor.monitor.level_modes import LearnedThreshold, decibels
from stickslip_monitor.monitor.signals import (
    Levels,
    Status,
    judge_stamp,
    number_to_si,
    to_si,
    value_faults,
)


class Measured(SentenceEnum):
    """What the level says of the lining."""

    UNKNOWN = 'unknown', 'Whether the lining vibrates is not known.'
    QUIET = 'quiet', 'No vibration is measured.'
    VIBRATING = 'vibrating', 'Vibration is measured.'


MEASURED = tuple(Measured)
UNKNOWN, QUIET, VIBRATING = range(3)
"""Places in :data:`MEASURED`."""

DUE_NS = 3 * 10**9
"""Net time above the threshold, or below the deadband, that is believed [ns]."""
_MOST_NS = DUE_NS // 2
_MEAN_NS = 5 * 10**8
_STUCK_NS = 10 * 10**9


class Unknown(SentenceEnum):
    """Why the level says nothing; each member carries its clause."""

    NOTHING = 'nothing', 'no level has come'
    LOST = 'lost', 'the level is lost'
    STUCK = 'stuck', 'the level never changes: its sensor is stuck'
    ONE_MODE = 'one_mode', 'no threshold is configured, and only one mode has been seen'
    SHORT = 'short', 'the level has not been above or below its threshold for long enough'


def stuck_ns(config: LevelConfig) -> int:
    """How long a level may repeat one value before it counts as stuck [ns]."""
    return max(_STUCK_NS, 2 * config.timeout_ns)


FALLS_DB = 3.0
"""A level this far below its highest since it rose is that of something that rings down [dB]."""


class _Switch:
    """Quiet, vibrating or neither, and how far the change to another has come.

    Args:
        in_db: Whether the level is in decibels.

    Attributes:
        code: The state, place in :data:`MEASURED`.
        count: Net time towards vibration, or if negative towards quiet [ns].
    """

    def __init__(self, in_db: bool) -> None:
        self._in_db = in_db
        self.restart()

    def restart(self) -> None:
        """Nothing is known."""
        self.code, self.count = UNKNOWN, 0
        self._mean = self._highest = 0.0

    def take(self, step: int, level: float) -> None:
        """Take a value.

        Args:
            step: Time that it counts above the threshold; negative: below the deadband [ns].
            level: The value, in the unit.
        """
        if step > 0 and self.code != VIBRATING and self._falls(step, level):
            step = -min(step, self.count)
        self.count += step
        if abs(self.count) >= DUE_NS:
            self.code, self.count = VIBRATING if self.count > 0 else QUIET, 0
        elif self.code == VIBRATING:
            self.count = min(self.count, 0)
        elif self.code == QUIET:
            self.count = max(self.count, 0)

    def _falls(self, step: int, level: float) -> bool:
        """Whether the mean of the last half second has fallen since the level rose."""
        if self.count <= 0:
            self._mean = self._highest = level
            return False
        self._mean += min(1.0, step / _MEAN_NS) * (level - self._mean)
        self._highest = max(self._highest, self._mean)
        if self._in_db:
            return self._mean < self._highest - FALLS_DB
        return self._mean < self._highest * 10.0 ** (-FALLS_DB / 20.0)


class LevelTracker:
    """The level of one bearing, value by value.

    Attributes:
        config: The input.
        counts: Values by :class:`Status`, shape (6,).
        last_ns: Stamp of the last value believed [ns].
        changed_ns: Stamp of the last one that differed from the one before [ns].
        bounds: Quiet is below the first, vibration not below the second; in the unit, ``nan`` as
            long as there is no threshold.
    """

    bounds: tuple[float, float]

    @property
    def code(self) -> int:
        """What it said last, place in :data:`MEASURED`."""
        return self._switch.code

    def __init__(self, config: LevelConfig) -> None:
        self.counts = np.zeros(len(Status), dtype=np.int64)
        self.last_ns: int | None = None
        self._learned = LearnedThreshold()
        self._last = math.nan
        self.changed_ns = 0
        self.config = config
        self._switch = _Switch(config.unit == 'dB')
        self._configure()

    def retune(self, config: LevelConfig) -> None:
        """Take over new settings; what was learned in another scale is forgotten."""
        old, self.config = self.config, config
        if (old.scale, old.offset) != (config.scale, config.offset):
            self._learned = LearnedThreshold()
        self._configure()

    def _configure(self) -> None:
        config = self.config
        self._in_db = config.unit == 'dB'
        self._stuck_ns = stuck_ns(config)
        self._set(self._learned.threshold if config.learns else config.threshold, config.learns)

    def _set(self, threshold: float, is_db: bool) -> None:
        """Take a threshold in the unit, or in decibels."""
        below = self.config.hysteresis
        if self._in_db:
            self.bounds = threshold - below, threshold
            return
        upper = 10.0 ** (threshold / 20.0) if is_db else threshold
        self.bounds = upper * 10.0 ** (-below / 20.0), upper

    def restart(self) -> None:
        """The clock jumped: what is waited for starts anew."""
        self.last_ns, self._last = None, math.nan
        self._switch.restart()
        self._learned.restart()

    def add(self, time_ns: int, value: float) -> Status:
        """Take one number as it stands in the message."""
        si, fault = number_to_si(self.config, value)
        if not fault and si < 0.0 and not self._in_db:
            fault = Status.IMPLAUSIBLE
        status = fault or judge_stamp(time_ns, self.last_ns, self.config.timeout_ns)
        self.counts[status] += 1
        if status is Status.CLOCK_JUMP:
            self.restart()
        if status.believed:
            self._take(time_ns, si)
        return status

    def _take(self, time_ns: int, si: float) -> None:
        last_ns, self.last_ns = self.last_ns, time_ns
        changed, self._last = si != self._last, si
        begins = last_ns is None
        if last_ns is None or time_ns - last_ns > self.config.timeout_ns:
            self._switch.restart()
            begins = True
        if not changed:
            return
        if last_ns is not None and time_ns - self.changed_ns > self._stuck_ns:
            self._switch.restart()
            begins = True
        self.changed_ns = time_ns
        if self.config.learns:
            self._learn(time_ns, si)
        lower, upper = self.bounds
        side = (si >= upper) - (si < lower)
        if side and not begins:
            assert last_ns is not None
            self._switch.take(side * min(time_ns - last_ns, _MOST_NS), si)

    def take_many(self, time_ns: IntArray, si: FloatArray) -> tuple[IntArray, NDArray[np.int8]]:
        """Take good values with rising stamps, at least one.

        Returns:
            Time of the last change and state after each, shape (n,).
        """
        first = self.last_ns is None
        before = int(time_ns[0]) if self.last_ns is None else self.last_ns
        changed = si != np.append(self._last, si[:-1])
        last_change = before if first else self.changed_ns
        changed_ns = np.maximum.accumulate(np.where(changed, time_ns, last_change))
        gap = np.diff(time_ns, prepend=before)
        since = time_ns - np.append(last_change, changed_ns[:-1])
        begins = (gap > self.config.timeout_ns) | (changed & (since > self._stuck_ns))
        begins[0] |= first
        lower, upper = self.bounds
        side = (si >= upper).astype(np.int64) - (si < lower)
        step = np.where(changed & ~begins, side * np.minimum(gap, _MOST_NS), 0)
        code = _codes(self._switch, step, begins, si)
        self.last_ns, self._last = int(time_ns[-1]), float(si[-1])
        self.changed_ns = int(changed_ns[-1])
        return changed_ns, code

    def _learn(self, time_ns: int, si: float) -> None:
        before = self._learned.threshold
        self._learned.add(time_ns, si if self._in_db else decibels(si))
        if self._learned.threshold != before and not math.isnan(self._learned.threshold):
            self._set(self._learned.threshold, True)

    def is_lost(self, now_ns: int) -> bool:
        """Whether no value of about this time has come: none yet, or of another clock."""
        return self.last_ns is None or abs(now_ns - self.last_ns) > self.config.timeout_ns

    def at(self, now_ns: int) -> int:
        """What the level says at a time, the place in :data:`MEASURED`."""
        if self.is_lost(now_ns) or now_ns - self.changed_ns > self._stuck_ns:
            return UNKNOWN
        return self.code

    def why_unknown(self, now_ns: int) -> Unknown | None:
        """Why it says nothing; ``None`` where it does."""
        if self.last_ns is None:
            return Unknown.NOTHING
        why = said_at(self.config, self.last_ns, self.changed_ns, self.code, now_ns)[1]
        one = self.config.learns and math.isnan(self._learned.threshold)
        return Unknown.ONE_MODE if one and why is Unknown.SHORT else why


def said_at(
    config: LevelConfig, last_ns: int, changed_ns: int, code: int, now_ns: int
) -> tuple[Measured, Unknown | None]:
    """What a level says at a time, and why it says nothing.

    Args:
        config: The input.
        last_ns: Stamp of the last value [ns].
        changed_ns: Stamp of the last one that differed from the one before [ns].
        code: What it said with that, place in :data:`MEASURED`.
        now_ns: The time [ns].
    """
    if abs(now_ns - last_ns) > config.timeout_ns:
        return Measured.UNKNOWN, Unknown.LOST
    if now_ns - changed_ns > stuck_ns(config):
        return Measured.UNKNOWN, Unknown.STUCK
    return MEASURED[code], Unknown.SHORT if code == UNKNOWN else None


@dataclass(frozen=True, slots=True)
class LevelCourse:
    """What a level said over a recording, or a part of one.

    Attributes:
        time_ns: Stamps of the believed values, in order of arrival, shape (n,) [ns].
        changed_ns: When the level last changed, shape (n,) [ns].
        code: What it says from then on, places in :data:`MEASURED`, shape (n,).
        counts: Values by :class:`Status`, shape (6,).
        status: What became of each value, shape (m,).
        unknown: Why it said nothing at the end; ``None`` where it did.
    """

    time_ns: IntArray
    changed_ns: IntArray
    code: NDArray[np.int8]
    counts: IntArray
    status: NDArray[np.int8]
    unknown: Unknown | None


class LevelScan:
    """:class:`LevelTracker` over a recording that comes in blocks."""

    def __init__(self, config: LevelConfig) -> None:
        self.tracker = LevelTracker(config)
        self._last = np.zeros(1, np.int8)
        self._now_ns: int | None = None

    def take(
        self,
        levels: Levels,
        jumps: NDArray[np.intp],
        place: NDArray[np.intp],
        now_ns: IntArray,
        carried: int,
    ) -> tuple[LevelCourse, NDArray[np.int8]]:
        """Take the next values.

        Args:
            levels: The values.
            jumps: Places among speed and load at which their clock jumped, rising, shape (j,).
            place: Those of the operating points, shape (k,).
            now_ns: Their times, shape (k,) [ns].
            carried: Whether to tell of the last point before as well.

        Returns:
            What the level said, and what it said at the points, shape (k + carried,).
        """
        tracker, counted = self.tracker, self.tracker.counts.copy()
        edges = np.searchsorted(levels.place, jumps, 'right').tolist()
        rows, status = [self._row(-1)], [np.empty(0, np.int8)]
        for number, (lo, hi) in enumerate(pairwise([0, *edges, levels.time_ns.size])):
            if number:
                tracker.restart()
                rows.append(self._row(int(jumps[number - 1])))
            found, changed, code = _follow(tracker, levels.time_ns[lo:hi], levels.value[lo:hi])
            good, own = found <= Status.CLOCK_JUMP, np.ones(code.size, bool)
            rows.append(
                (levels.place[lo:hi][good], levels.time_ns[lo:hi][good], changed, code, own, own)
            )
            status.append(found)
        columns: Any = tuple(map(np.concatenate, zip(*rows, strict=True)))
        codes = np.append(self._last[:carried], self._at(columns, place, now_ns))
        self._last = codes[-1:] if codes.size else self._last
        _, time, changed, code, _, own = columns
        if now_ns.size:
            self._now_ns = int(now_ns[-1])
        end = (tracker.last_ns or 0) if self._now_ns is None else self._now_ns
        return LevelCourse(
            time[own],
            changed[own],
            code[own],
            tracker.counts - counted,
            np.concatenate(status),
            tracker.why_unknown(end),
        ), codes

    def _row(self, place: int) -> tuple[NDArray[Any], ...]:
        """The tracker's state before the values from a place on."""
        tracker = self.tracker
        known, last = tracker.last_ns is not None, tracker.last_ns or 0
        row = (place, last, tracker.changed_ns, tracker.code, known, False)
        kinds = (np.int64, np.int64, np.int64, np.int8, bool, bool)
        return tuple(np.array([x], kind) for x, kind in zip(row, kinds, strict=True))

    def _at(
        self, columns: tuple[NDArray[Any], ...], place: NDArray[np.intp], now_ns: IntArray
    ) -> NDArray[np.int8]:
        """:meth:`LevelTracker.at` at some operating points, shape (k,)."""
        before, last, changed, code, known, _ = columns
        own = np.searchsorted(before, place, 'right') - 1
        config = self.tracker.config
        fresh = known[own] & (np.abs(now_ns - last[own]) <= config.timeout_ns)
        fresh &= now_ns - changed[own] <= stuck_ns(config)
        return np.where(fresh, code[own], np.int8(UNKNOWN)).astype(np.int8)


def _follow(
    tracker: LevelTracker, time_ns: IntArray, value: FloatArray
) -> tuple[NDArray[np.int8], IntArray, NDArray[np.int8]]:
    """Status of each value; of the believed ones time of the last change, and state."""
    si = to_si(tracker.config, value)
    status = value_faults(tracker.config, si)
    if tracker.config.unit != 'dB':
        status[(status == Status.ACCEPTED) & (si < 0.0)] = Status.IMPLAUSIBLE
    good = status == Status.ACCEPTED
    time = time_ns[good]
    rises = time.size and (tracker.last_ns is None or time[0] > tracker.last_ns)
    if tracker.config.learns or not rises or not np.all(time[1:] > time[:-1]):
        return _follow_one_by_one(tracker, time_ns, value)
    tracker.counts += np.bincount(status, minlength=len(Status))
    changed, code = tracker.take_many(time, si[good])
    return status, changed, code


def _follow_one_by_one(
    tracker: LevelTracker, time_ns: IntArray, value: FloatArray
) -> tuple[NDArray[np.int8], IntArray, NDArray[np.int8]]:
    status, changed, code = [], [], []
    for time, number in zip(time_ns.tolist(), value.tolist(), strict=True):
        found = tracker.add(time, number)
        status.append(found)
        if found.believed:
            changed.append(tracker.changed_ns)
            code.append(tracker.code)
    return np.array(status, np.int8), np.array(changed, np.int64), np.array(code, np.int8)


def _codes(switch: _Switch, step: IntArray, begins: BoolArray, si: FloatArray) -> NDArray[np.int8]:
    """State after each value, shape (n,); what changes nothing is skipped."""
    of_any = np.flatnonzero((step != 0) | begins).tolist()
    of_rise = np.flatnonzero((step > 0) | begins).tolist()
    of_fall = np.flatnonzero((step < 0) | begins).tolist()
    states, places, k = [switch.code], [0], 0
    while True:
        settled = switch.count == 0 and switch.code != UNKNOWN
        asks = of_any if not settled else of_rise if switch.code == QUIET else of_fall
        at = bisect_left(asks, k)
        if at == len(asks):
            break
        k = asks[at]
        if begins[k]:
            switch.restart()
        if step[k]:
            switch.take(int(step[k]), float(si[k]))
        if switch.code != states[-1]:
            states.append(switch.code)
            places.append(k)
        k += 1
    return np.repeat(np.array(states, np.int8), np.diff([*places, step.size]))
