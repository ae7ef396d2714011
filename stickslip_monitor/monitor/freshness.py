# SPDX-License-Identifier: Apache-2.0
"""How long a measured value counts, so that none decides by itself however long it is held.

A value is held until the next one of its input comes. It counts for at most one and a half times
the input's rhythm, the longer of the last two gaps between its values; where the rhythm is slower
than a delay needs its values, a value counts for less than the time that it lasts.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from stickslip_monitor.arrays import IntArray

SHARE = 3
"""A value at its input's rhythm counts for at most one part in this many of a delay."""


def credit(covered: int, rhythm: int, delay: int) -> int:
    """The time that counts towards a delay [ns], of the time since a point that is covered."""
    if rhythm * SHARE <= delay:
        return covered
    return math.ceil(covered * (delay / SHARE / rhythm))


def credit_of_many(covered: IntArray, rhythm: IntArray, delay: int) -> IntArray:
    """:func:`credit` of many points, shape (n,)."""
    if not rhythm.size or int(rhythm.max()) * SHARE <= delay:
        return covered
    slow = rhythm * SHARE > delay
    counted = covered.copy()
    counted[slow] = np.ceil(covered[slow] * (delay / SHARE / rhythm[slow])).astype(np.int64)
    return counted


def lasts(rhythm: Any) -> Any:
    """For how long a value counts [ns], from the rhythm of its input [ns]; of one or of many."""
    return rhythm + rhythm // 2


class Rhythm:
    """The gaps between the values of one input.

    Attributes:
        gap_ns: The longer of the last two; 0 before the second value [ns].
        until_ns: Until when its last value counts [ns].
    """

    __slots__ = ('_before', '_last', 'gap_ns', 'until_ns')

    def __init__(self) -> None:
        self.restart()

    def restart(self) -> None:
        """The clock jumped."""
        self._last: int | None = None
        self._before = self.gap_ns = self.until_ns = 0

    def add(self, stamp_ns: int, now_ns: int) -> None:
        """A value came, with a later stamp than the one before."""
        gap = 0 if self._last is None else stamp_ns - self._last
        self.gap_ns = max(gap, self._before)
        self._last, self._before = stamp_ns, gap
        self.until_ns = now_ns + lasts(self.gap_ns)

    def add_many(self, stamp_ns: IntArray, now_ns: IntArray) -> tuple[IntArray, IntArray]:
        """:meth:`add` of several values; ``gap_ns`` and ``until_ns`` after each, shape (n,)."""
        if not stamp_ns.size:
            return stamp_ns, now_ns
        own = np.diff(stamp_ns, prepend=stamp_ns[0] if self._last is None else self._last)
        gap = np.maximum(own, np.append(self._before, own[:-1]))
        until = now_ns + lasts(gap)
        self._last, self._before = int(stamp_ns[-1]), int(own[-1])
        self.gap_ns, self.until_ns = int(gap[-1]), int(until[-1])
        return gap, until


@dataclass(frozen=True, slots=True)
class Fresh:
    """How long each point of a recording counts.

    Attributes:
        covered: Time that it counts, until the next point at most, shape (n,) [ns].
        rhythm: Rhythm of the slower of its two inputs, shape (n,) [ns].
    """

    covered: IntArray
    rhythm: IntArray
