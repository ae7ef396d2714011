# SPDX-License-Identifier: Apache-2.0
"""How many alarms a person was given lately: the flood figures of ISA-18.2."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

WINDOW_NS = 600 * 10**9
BEGIN, END = 10, 5
_MOST = 1000


@dataclass(frozen=True, slots=True)
class FloodFigures:
    """The load on the person at the panel.

    Attributes:
        lately: Alarms in the last ten minutes; counting stops at 1000.
        most: The most there have been in ten minutes.
        flooding: Whether there is a flood: it begins above 10 alarms in ten minutes and ends
            below 5.
    """

    lately: int
    most: int
    flooding: bool


class Flood:
    """Counts alarms as they are given; ``now_ns`` is a running time that never goes back."""

    def __init__(self) -> None:
        self._times: deque[int] = deque(maxlen=_MOST)
        self._most = 0
        self._flooding = False

    def add(self, now_ns: int) -> None:
        """An alarm was given."""
        self._flooding = self.figures(now_ns).flooding
        while self._times and now_ns - self._times[0] >= WINDOW_NS:
            self._times.popleft()
        self._times.append(now_ns)
        self._flooding = self._flooding or len(self._times) > BEGIN
        self._most = max(self._most, len(self._times))

    def figures(self, now_ns: int) -> FloodFigures:
        """The figures at a time not before the latest alarm; reading them changes nothing."""
        # Between two alarms the count only falls, so a flood that is over now stays over.
        lately = sum(now_ns - time_ns < WINDOW_NS for time_ns in self._times)
        return FloodFigures(lately, self._most, self._flooding and lately >= END)
