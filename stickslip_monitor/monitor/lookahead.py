# SPDX-License-Identifier: Apache-2.0
"""The speed that the trend of the last seconds leads to.

The trend is that between two means of the speed, of the last two seconds and of five to ten
seconds ago; each value is first replaced by the median of itself and the two before, so that an
odd one does not matter. Sums are of whole numbers, so that a recording in bulk gives exactly what
its samples give one by one.
"""

from __future__ import annotations

import math
import operator
from collections import deque
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stickslip_monitor.arrays import FloatArray, IntArray

_SLOT_NS = 500_000_000
# Slots before the present one: from which on the late mean is taken, and the early one.
_LATE, _EARLY_END, _EARLY = 3, 10, 20
_UNIT = 2.0**24
"""Speeds are summed in parts of this many to a m/s."""
_FASTEST = 1000.0
"""Faster ones [m/s] are cut off, so that every sum is exact."""


class SpeedTrend:
    """The last ten seconds of one shaft's speed."""

    def __init__(self) -> None:
        self._slots: deque[list[int]] = deque()
        self._last: list[float] = []
        self.future = math.nan
        # The slot before which slots have been summed, and the sums.
        self._summed: int | None = None
        self._late, self._early = [0, 0, 0], [0, 0, 0]

    def restart(self) -> None:
        """The clock jumped."""
        self._slots.clear()
        self._last.clear()
        self._summed = None
        self.future = math.nan

    def add(self, time_ns: int, speed: float, ahead_ns: int) -> None:
        """Take a speed [m/s]; :attr:`future` is then that in ``ahead_ns``, or ``nan``.

        Args:
            time_ns: Its time, not before the one before [ns].
            speed: The speed [m/s].
            ahead_ns: How far ahead [ns]; 0 for not looking ahead.
        """
        self._last = [*self._last[-2:], speed]
        middle = sorted(self._last)[1] if len(self._last) == 3 else speed
        slot = time_ns // _SLOT_NS
        if not self._slots or self._slots[-1][0] != slot:
            self._slots.append([slot, 0, 0, 0])
            while self._slots[0][0] < slot - _EARLY:
                self._slots.popleft()
        own = self._slots[-1]
        own[1] += 1
        own[2] += time_ns
        own[3] += round(min(max(middle, -_FASTEST), _FASTEST) * _UNIT)
        self.future = self._future(time_ns, ahead_ns) if ahead_ns else math.nan

    def add_many(self, time_ns: IntArray, speed: FloatArray, ahead_ns: int) -> FloatArray:
        """:meth:`add` of several speeds; :attr:`future` after each, shape (n,).

        Args:
            time_ns: Their times, not falling, shape (n,) [ns].
            speed: Shape (n,) [m/s].
            ahead_ns: How far ahead [ns]; 0 for not looking ahead.
        """
        if not (time_ns.size and ahead_ns):
            return np.full(time_ns.size, np.nan)
        rows = _Rows(self._slots, time_ns, self._medians(speed))
        found = rows.futures(ahead_ns)
        self._slots = rows.slots()
        self.future = float(found[-1])
        return found

    def _medians(self, speed: FloatArray) -> FloatArray:
        """Each speed's median with the two before it."""
        before = self._last[-2:]
        raw = np.concatenate([before, speed])
        self._last = raw[-3:].tolist()
        middle = raw.copy()
        first, second, third = raw[:-2], raw[1:-1], raw[2:]
        middle[2:] = np.maximum(
            np.minimum(first, second), np.minimum(np.maximum(first, second), third)
        )
        return middle[len(before) :]

    def _future(self, time_ns: int, ahead_ns: int) -> float:
        slot, *own = self._slots[-1]
        if self._summed != slot:
            self._summed, self._late, self._early = slot, *self._sums(slot)
        (n, times, speeds), (m, early_times, early_speeds) = self._late, self._early
        if not m:
            return math.nan
        n += own[0]
        late = n, n * time_ns - times - own[1], speeds + own[2]
        early = m, m * time_ns - early_times, early_speeds
        return float(_line(late, early, ahead_ns))

    def _sums(self, slot: int) -> tuple[list[int], list[int]]:
        """Counts, sums of times and of speeds of the late and the early slots before a slot."""
        late, early = [0, 0, 0], [0, 0, 0]
        for number, *sums in self._slots:
            if number < slot and not slot - _EARLY_END < number < slot - _LATE:
                own = early if number < slot - _LATE else late
                own[:] = map(operator.add, own, sums)
        return late, early


def _line(late: tuple[Any, ...], early: tuple[Any, ...], ahead: int) -> Any:
    """The speed [m/s] on the line through two means: counts, sums of ages [ns], of speeds."""
    now, before = late[2] / late[0], early[2] / early[0]
    when = late[1] / late[0]
    slope = (now - before) / (early[1] / early[0] - when)
    return (now + slope * (when + ahead)) / _UNIT


class _Rows:
    """Slots of the past, then speeds one by one, all as counts and sums.

    Args:
        slots: The slots: number, speeds in it, sum of their times [ns], and of the speeds.
        time_ns: Times of the speeds, at least one, shape (n,) [ns].
        speed: Their medians, shape (n,) [m/s].
    """

    def __init__(
        self, slots: Iterable[Sequence[int]], time_ns: IntArray, speed: FloatArray
    ) -> None:
        self._base = base = int(time_ns[0])
        old = np.array([[k, n, time - n * base, v] for k, n, time, v in slots], np.int64)
        units = np.rint(np.clip(speed, -_FASTEST, _FASTEST) * _UNIT).astype(np.int64)
        self._since = time_ns - base
        new = time_ns // _SLOT_NS, np.ones_like(units), self._since, units
        self._old = len(old)
        number, *columns = (
            np.concatenate(pair) for pair in zip(old.reshape(-1, 4).T, new, strict=True)
        )
        # Sums may overflow; their differences are right nonetheless.
        self._count, self._times, self._speeds = (
            np.append(np.int64(0), np.cumsum(column)) for column in columns
        )
        begins = np.append(0, np.flatnonzero(number[1:] != number[:-1]) + 1)
        self._edges = np.append(begins, number.size)
        self._number = number[begins]

    def futures(self, ahead_ns: int) -> FloatArray:
        """:attr:`SpeedTrend.future` after each of the speeds, shape (n,)."""
        count, times, speeds = self._count, self._times, self._speeds
        late, end, early = (self._begin(back) for back in (_LATE, _EARLY_END - 1, _EARLY))
        here = slice(self._old + 1, None)
        n, m = count[here] - count[late], count[end] - count[early]
        with np.errstate(all='ignore'):
            age = n * self._since - (times[here] - times[late])
            early_age = m * self._since - (times[end] - times[early])
            found = _line(
                (n, age, speeds[here] - speeds[late]),
                (m, early_age, speeds[end] - speeds[early]),
                ahead_ns,
            )
        found[m == 0] = np.nan
        return np.asarray(found)

    def _begin(self, back: int) -> NDArray[np.intp]:
        """Where the slot so many before its own begins, for each speed."""
        place = np.searchsorted(self._number, self._number - back)
        return np.repeat(self._edges[place], np.diff(self._edges))[self._old :]

    def slots(self) -> deque[list[int]]:
        """The slots that may still count."""
        kept = int(np.searchsorted(self._number, self._number[-1] - _EARLY))
        sums = (np.diff(total[self._edges[kept:]]) for total in self._sums())
        columns = zip(self._number[kept:].tolist(), *(s.tolist() for s in sums), strict=True)
        return deque([k, n, time + n * self._base, v] for k, n, time, v in columns)

    def _sums(self) -> tuple[IntArray, ...]:
        return self._count, self._times, self._speeds
