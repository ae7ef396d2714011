# SPDX-License-Identifier: Apache-2.0
"""Episodes of stick-slip: sticks that follow one another while the shaft turns."""

from __future__ import annotations

from dataclasses import dataclass

# A single stick, after a knock or as the shaft breaks away, is no oscillation.
LEAST_STICKS = 2


@dataclass(frozen=True, slots=True)
class EpisodeEvent:
    """The begin or the end of an episode.

    Attributes:
        name: ``'first_stick'`` or ``'last_stick'``.
        known: When it could be known [s].
        time: When it was [s].
        sticks: Stretches of sticking up to then.
        sticking: Time of sticking in them [s].
    """

    name: str
    known: float
    time: float
    sticks: int
    sticking: float


class Episodes:
    """Joins sticks to episodes; time only rises.

    An episode is at least two sticks, each of which begins within ``gap`` of the end of the one
    before. A stick counts from where it begins, while the shaft turns, to the release or to where
    the shaft comes to rest; one that begins at rest does not count.

    Args:
        gap: Longest time between two sticks of an episode [s].
    """

    def __init__(self, gap: float) -> None:
        self.gap = gap
        self._first = self._last = 0.0
        self._sticks = 0
        self._sticking = 0.0
        self._open: float | None = None

    def stick(self, time: float) -> list[EpisodeEvent]:
        """A stick begins while the shaft turns."""
        events = self.passed(time)
        if self._sticks == 0:
            self._first = time
        elif self._sticks == LEAST_STICKS - 1:
            events.append(EpisodeEvent('first_stick', time, self._first, 1, self._sticking))
        self._sticks += 1
        self._open = time
        return events

    def release(self, time: float) -> None:
        """The stick ends, or the shaft comes to rest while it lasts."""
        if self._open is not None:
            self._sticking += time - self._open
            self._last, self._open = time, None

    def passed(self, time: float) -> list[EpisodeEvent]:
        """Time passes."""
        if not self._sticks or self._open is not None or time <= self._last + self.gap:
            return []
        sticks, sticking = self._sticks, self._sticking
        self._sticks, self._sticking = 0, 0.0
        if sticks < LEAST_STICKS:
            return []
        known = self._last + self.gap
        return [EpisodeEvent('last_stick', known, self._last, sticks, sticking)]
