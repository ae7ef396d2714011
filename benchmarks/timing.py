# SPDX-License-Identifier: Apache-2.0
"""Timing of rivals in turns, so that what else the machine does meets all of them alike."""

from __future__ import annotations

import gc
import statistics
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Times:
    """Wall times of one rival [s]."""

    seconds: tuple[float, ...]

    @property
    def least(self) -> float:
        """The best time."""
        return min(self.seconds)

    @property
    def median(self) -> float:
        """The time in the middle."""
        return statistics.median(self.seconds)


def in_turns(rivals: Mapping[str, Callable[[], object]], repeat: int, warm: bool = True) -> dict[str, Times]:
    """Run each rival once, and again, until each has run so often.

    Args:
        rivals: What to time, by name.
        repeat: How often.
        warm: Whether each is run once before, untimed.
    """
    for rival in rivals.values() if warm else ():
        rival()
    seconds: dict[str, list[float]] = {name: [] for name in rivals}
    for _ in range(repeat):
        for name, rival in rivals.items():
            gc.collect()
            begin = time.perf_counter()
            rival()
            seconds[name].append(time.perf_counter() - begin)
    return {name: Times(tuple(times)) for name, times in seconds.items()}
