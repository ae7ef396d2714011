# SPDX-License-Identifier: Apache-2.0
"""How much time has passed without a sample, on clocks that may stop, step or run fast.

The alarms of the live node: its clock, its log, its topic and its state file.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

from rclpy.lifecycle import LifecycleNode

from stickslip_monitor.monitor.alarms.live_alarms import LiveAlarms
from stickslip_monitor.monitor.config import MonitorConfig
from stickslip_monitor.ros.state_file import StateWriter


class ElapsedTime:
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

    def skip(self, steady_ns: int, ros_ns: int) -> None:
        """The time up to now does not count."""
        self._steady_ns, self._ros_ns = steady_ns, ros_ns

    def tick(self, steady_ns: int, ros_ns: int) -> int:
        """Return the time since the last sample, given both clocks now [ns]."""
        steady, ros = steady_ns - self._steady_ns, ros_ns - self._ros_ns
        moving = self._simulated and ros != 0 and self._ros_ns != 0
        self._steady_ns, self._ros_ns = steady_ns, ros_ns
        self._elapsed_ns += max(ros, 0) if moving else steady
        return self._elapsed_ns


class AlarmDesk(LiveAlarms):
    """The alarms, on the clocks of a node.

    Args:
        node: The node, for its clock and its log.
        config: The configuration.
        publish: Called with every new text for ``~/alarms``.
        store: What keeps the alarms over a restart; ``None`` for nothing.
    """

    def __init__(
        self,
        node: LifecycleNode,
        config: MonitorConfig,
        publish: Callable[[str], None],
        store: StateWriter | None,
    ) -> None:
        super().__init__(
            config,
            lambda: node.get_clock().now().nanoseconds,
            _as_text(publish),
            node.get_logger(),
            store,
        )
        self._flow: ElapsedTime | None = None

    def rebuild(
        self, config: MonitorConfig, publish: Callable[[str], None], store: StateWriter | None
    ) -> None:
        """The monitor starts afresh with other inputs."""
        self.replace(config, _as_text(publish), store)

    def start(self, flow: ElapsedTime) -> None:
        """Publish the list, and let time run from now on, as that flow measures it."""
        self._flow = flow
        self.begin()

    def tick(self, steady_ns: int, ros_ns: int) -> None:
        """Let time pass, given both clocks now [ns]."""
        assert self._flow is not None
        self.advance(self._flow.tick(steady_ns, ros_ns))


def _as_text(publish: Callable[[str], None]) -> Callable[[dict[str, Any]], None]:
    return lambda record: publish(json.dumps(record, allow_nan=False))
