# SPDX-License-Identifier: Apache-2.0
"""The clocks of this machine: that on the wall, which may be set, and one that never is."""

from __future__ import annotations

import time
from collections.abc import Callable

from stickslip_monitor.monitor.session import Moment

STEP_NS = 10**9
"""A clock on the wall that gains or loses more [ns] between two looks was set: time that is slewed
by NTP gains 0.5 ms a second at most."""


def uptime_ns() -> int:
    """Time since the machine was started [ns]; that in which it slept counts, where it can."""
    clock = getattr(time, 'CLOCK_BOOTTIME', time.CLOCK_MONOTONIC)
    return time.clock_gettime_ns(clock)


class HostClock:
    """Reads both clocks, and notices when the one on the wall is set.

    Args:
        steady: Reads a clock that never steps [ns].
        wall: Reads the one on the wall [ns].
    """

    def __init__(self, steady: Callable[[], int] = uptime_ns, wall: Callable[[], int] = time.time_ns) -> None:
        self._steady, self._wall = steady, wall
        self._ahead_ns, self._set_ns = wall() - steady(), 0

    def now(self) -> Moment:
        """Now, on both, and by how much that on the wall was set since this was made."""
        moment = Moment(self._steady(), self._wall(), self._set_ns)
        before, self._ahead_ns = self._ahead_ns, moment.time_ns - moment.steady_ns
        step_ns = self._ahead_ns - before
        if abs(step_ns) <= STEP_NS:
            return moment
        self._set_ns += step_ns
        return moment._replace(set_ns=self._set_ns)
