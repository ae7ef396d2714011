# SPDX-License-Identifier: Apache-2.0
"""How much time has passed without a sample, on clocks that may stop, step or run fast."""

from __future__ import annotations


class Flow:
    """Time since the last sample, for the watchdog.

    While ROS time follows a simulated clock that moves, that clock is the measure. One that
    stands still (the player has gone) cannot say that an input is lost, so then the steady clock
    is. A step back, and the first step from zero, count as no time.

    Args:
        simulated: Whether ROS time follows /clock.
        steady_ns: The steady clock now [ns].
        ros_ns: ROS time now [ns].
    """

    def __init__(self, simulated: bool, steady_ns: int, ros_ns: int) -> None:
        self._simulated = simulated
        self.restart(steady_ns, ros_ns)

    def restart(self, steady_ns: int, ros_ns: int) -> None:
        """A sample has come: the count starts anew."""
        self._steady_ns, self._ros_ns = steady_ns, ros_ns
        self._elapsed_ns = 0

    def tick(self, steady_ns: int, ros_ns: int) -> int:
        """Return the time since the last sample, given both clocks now [ns]."""
        steady, ros = steady_ns - self._steady_ns, ros_ns - self._ros_ns
        moving = self._simulated and ros != 0 and self._ros_ns != 0
        self._steady_ns, self._ros_ns = steady_ns, ros_ns
        self._elapsed_ns += max(ros, 0) if moving else steady
        return self._elapsed_ns
