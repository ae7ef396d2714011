# SPDX-License-Identifier: Apache-2.0
"""Tells a session of the time that passes without samples, on clocks that may stop or step."""

from __future__ import annotations

from stickslip_monitor.monitor.monitor import BearingMonitor
from stickslip_monitor.monitor.session import Moment, Session

LAG_NS = 500_000_000
"""The watchdog stays so far behind that a sample delivered late keeps the time of its stamp."""


class ElapsedTime:
    """Time since the last sample.

    While ROS time follows a simulated clock that moves, that clock is the measure. One that
    stands still (the player has gone) cannot say that an input is lost, so then the steady clock
    is. A step back, and the first step from zero, count as no time.

    Args:
        simulated: Whether ROS time follows /clock.
        now: Both clocks now.
    """

    def __init__(self, simulated: bool, now: Moment) -> None:
        self._simulated = simulated
        self.restart(now)

    def restart(self, now: Moment) -> None:
        """A sample has come: the count starts anew."""
        self._last, self._elapsed_ns = now, 0

    def skip(self, now: Moment) -> None:
        """The time up to now does not count."""
        self._last = now

    def tick(self, now: Moment) -> int:
        """Return the time since the last sample [ns]."""
        last, self._last = self._last, now
        steady, simulated = now.steady_ns - last.steady_ns, now.time_ns - last.time_ns
        moving = self._simulated and simulated != 0 and last.time_ns != 0
        self._elapsed_ns += max(simulated, 0) if moving else steady
        return self._elapsed_ns


class Watchdog:
    """The silence of each bearing of a session.

    Args:
        session: What is told.
        simulated: Whether ROS time follows /clock.
        now: Both clocks now.
    """

    def __init__(self, session: Session, simulated: bool, now: Moment) -> None:
        self._session = session
        names = list(session.monitor.bearings)
        self._flows = {name: ElapsedTime(simulated, now) for name in names}
        # From when each waits for samples, on the clock of these [ns]; 0 for not yet.
        self._bases = dict.fromkeys(names, 0)
        self._heard: set[str] = set()

    def hear(self, name: str) -> None:
        """A sample of a bearing was believed."""
        self._heard.add(name)

    def skip(self, now: Moment) -> None:
        """The time up to now does not count."""
        for flow in self._flows.values():
            flow.skip(now)

    def tick(self, now: Moment) -> None:
        """Tell of the time that has passed without samples."""
        for name, bearing in self._session.monitor.bearings.items():
            flow = self._flows[name]
            if name in self._heard:
                flow.restart(now)
                self._bases[name] = bearing.now_ns or 0
                continue
            elapsed = max(flow.tick(now) - LAG_NS, 0)
            base = self._bases[name] = self._base(name, bearing, now, elapsed)
            if base:
                self._session.pass_time(name, base + elapsed, now)
        self._heard.clear()

    def _base(self, name: str, bearing: BearingMonitor, now: Moment, elapsed: int) -> int:
        """The time from which a bearing waits for samples [ns]; 0 for not yet.

        Inputs are waited for from the first instant that ROS time knows. Where it knows none for
        longer than a timeout, they are lost all the same.
        """
        base = self._bases[name]
        if base > 1:
            return base
        if base == 0 and bearing.now_ns is not None:
            return bearing.now_ns
        if now.time_ns:
            return now.time_ns - elapsed
        timeouts = (bearing.config.speed.timeout_ns, bearing.config.load.timeout_ns)
        return 1 if elapsed > min(timeouts) else base
