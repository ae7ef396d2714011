# SPDX-License-Identifier: Apache-2.0
"""A switch with an integrating delay: point by point, or over a recording at once.

An integrating delay counts up while a condition holds and down while it does not, so that one odd
sample in thirty delays a change by a thirtieth and no more: the continuous form of the
``n1``-of-``n`` delay timers of J. Xu and T. Chen, J. Process Control 23 (2013) 382-395.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from stickslip_monitor.arrays import BoolArray, IntArray
from stickslip_monitor.monitor.config import AlarmConfig
from stickslip_monitor.monitor.freshness import Fresh

# Points of a recording that are summed at once: at first, and at most.
_FEW, _MANY = 64, 65536


class Latch:
    """A two-state switch with an integrating delay.

    While a point asks for the other state, what passes since that point is added to a count; while
    it does not, it is taken off again, but never below 0. The state changes at the first point
    that asks for it with the count at :meth:`due` or above. The counts are whole numbers, so a
    recording summed in bulk gives exactly what its samples give one by one.

    Attributes:
        config: The alarm.
        on: The state.
        count: How far the change of state has come, >= 0.
        asks: Of a recording: whether each point asks for a change where the latch is off, and
            where it is on, each shape (n,).
        fresh: Of a recording: how long each point counts.
        forced: Of a recording: the points that, where they ask, change the state whatever has
            been counted, shape (n,); ``None`` for none.
    """

    asks: tuple[BoolArray, BoolArray]
    fresh: Fresh
    forced: BoolArray | None = None

    def __init__(self, config: AlarmConfig) -> None:
        self.config = config
        self.on = False
        self.count = 0

    def due(self) -> int:
        """The count at which the state changes, >= 0."""
        raise NotImplementedError

    def steps(self, lo: int, hi: int) -> IntArray:
        """What passes after each point of a recording from ``lo`` to before ``hi`` adds."""
        raise NotImplementedError

    def restart(self) -> None:
        """The clock jumped: what has been counted is forgotten, the state stays."""
        self.count = 0

    def switch(self, time_ns: int) -> None:
        """Change the state at a time [ns]."""
        self.on = not self.on
        self.count = 0

    def take(self, step: int, asks: bool, time_ns: int, forced: bool = False) -> None:
        """Take a point: what has passed since the one before, and whether it asks for a change."""
        self.count = max(0, self.count + step)
        if asks and (forced or self.count >= self.due()):
            self.switch(time_ns)


def follow(
    latch: Latch, times: IntArray, starts: NDArray[np.intp], taken: int = 0
) -> tuple[BoolArray, IntArray]:
    """Take many points of a recording at once, as :meth:`Latch.take` takes them one by one.

    Args:
        latch: The latch; its state goes on from where it is.
        times: Time of each point, shape (n,) [ns].
        starts: The points before which the clock jumped, a first one of all included, shape (m,).
        taken: How many of the points were taken before: none, or the one before these.

    Returns:
        State and count after each point, each shape (n,).
    """
    on, count = np.zeros(times.size, bool), np.zeros(times.size, np.int64)
    on[:taken], count[:taken] = latch.on, latch.count
    jumps = starts.tolist()
    edges = jumps if jumps[:1] == [taken] else [taken, *jumps]
    for begin, end in pairwise([*edges, times.size]):
        low = begin - 1
        if begin in jumps:
            latch.restart()
            low = begin
        k, size = begin, _FEW
        while k < end:
            if latch.count == 0:
                # Nothing is added to an empty count before the next point that asks.
                until = _next(latch.asks[latch.on], max(k - 1, low), end)
                on[k:until] = latch.on
                k = max(k, until)
            high = min(end, k + size)
            before = _take_many(latch, k, high, k == low, on, count)
            if k + before < high:
                latch.switch(int(times[k + before]))
                on[k + before] = latch.on
                k, size = k + before + 1, _FEW
            else:
                k, size = high, min(4 * size, _MANY)
    return on, count


def _next(asks: BoolArray, begin: int, end: int) -> int:
    """The first point from ``begin`` on that asks; ``end`` without one."""
    place = begin + int(asks[begin:end].argmax())
    return place if asks[place] else end


def _take_many(latch: Latch, lo: int, hi: int, first: bool, on: BoolArray, count: IntArray) -> int:
    """Count over some points; return how many of them come before the next change of state."""
    if lo >= hi:
        return 0
    # What a point adds passes between it and the next.
    steps = latch.steps(lo - 1, hi - 1) if not first else np.append(0, latch.steps(lo, hi - 1))
    total = np.cumsum(steps)
    counted = total - np.minimum(np.minimum.accumulate(total), -latch.count)
    ready = counted >= latch.due()
    if latch.forced is not None:
        ready |= latch.forced[lo:hi]
    change = latch.asks[latch.on][lo:hi] & ready
    taken = int(change.argmax()) if change.any() else hi - lo
    on[lo : lo + taken], count[lo : lo + taken] = latch.on, counted[:taken]
    if taken:
        latch.count = int(counted[taken - 1])
    return taken
