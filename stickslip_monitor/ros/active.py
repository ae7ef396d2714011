# SPDX-License-Identifier: Apache-2.0
"""What lives only while the node is active: its ears, its services and the watchdog."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from typing import Any

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.lifecycle import LifecycleNode

from stickslip_monitor.errors import plural
from stickslip_monitor.monitor.session import Moment
from stickslip_monitor.monitor.signals import LEVEL
from stickslip_monitor.ros.actions import Actions
from stickslip_monitor.ros.configured import Configured
from stickslip_monitor.ros.inputs import Guard, Inputs, Number, has_double
from stickslip_monitor.ros.message_types import ROS_FAULTS
from stickslip_monitor.ros.watchdog import ElapsedTime, Watchdog

WATCHDOG_PERIOD = 0.1
SHOW_NS = 10**9
"""The state of all bearings is told so often [ns]."""
LOSS_PERIOD = 60.0
HELD_UP_NS = 10**9
"""A watchdog that comes so late [ns] says that the node was held up, not its inputs."""
_OVERDUE_NS = 2 * 10**8
"""After so long [ns] the watchdog comes before further messages, and takes all that wait."""
_DOUBLE_LOOKS = 5


class Active:
    """The ears of a node, and its sense of time.

    Args:
        node: The node, for ROS.
        configured: What it has: session, publishers, clips.
        survived: Guards the callbacks.
        simulated: Whether ROS time follows /clock.

    Raises:
        Exception: One of :data:`.message_types.ROS_FAULTS`: an input or service cannot be made.
    """

    def __init__(
        self, node: LifecycleNode, configured: Configured, survived: Guard, simulated: bool
    ) -> None:
        self._node, self._own, self._simulated = node, configured, simulated
        self._session, self._health = configured.session, configured.health
        self._log, self._take = node.get_logger(), survived(self._receive)
        self._actions: Actions | None = None
        self._ticker: Any = None
        self._inputs = Inputs(
            node,
            configured.config,
            self._deliver,
            self._now_ns,
            survived,
            self._health,
            None if configured.clips is None else configured.clips.take,
        )
        try:
            self._inputs.subscribe()
            bearings = list(self._session.monitor.bearings)
            self._actions = Actions(node, bearings, self._session.act)
        except ROS_FAULTS:
            self.destroy()
            raise
        now = self._now()
        self._watchdog = Watchdog(self._session, simulated, now)
        self._running = ElapsedTime(simulated, now)
        self._ticked_ns, self._shown_ns = now.steady_ns, -SHOW_NS
        self._looks = self._lost_told = 0
        self._lost_told_at = -math.inf
        # A timer of the steady clock: those of ROS time stall when a replay steps back.
        self._ticker = node.create_timer(
            WATCHDOG_PERIOD, survived(self.tick), clock=Clock(clock_type=ClockType.STEADY_TIME)
        )

    def begin(self) -> None:
        """Watch from now on."""
        self._health.monitoring = True
        self._session.begin()
        self.tick()

    def end(self) -> None:
        """Nobody watches any more, which is told, and what is left of the clips is written."""
        self._health.monitoring = False
        self._session.end()
        self._own.end_clips()

    def destroy(self) -> None:
        """Take subscriptions, services and timer down."""
        self._inputs.destroy()
        if self._actions is not None:
            self._actions.destroy()
        if self._ticker is not None:
            self._node.destroy_timer(self._ticker)

    def _now_ns(self) -> int:
        """ROS time [ns]; 0 while it is simulated and /clock has said nothing."""
        return self._node.get_clock().now().nanoseconds if self._simulated else time.time_ns()

    def _now(self) -> Moment:
        return Moment(time.monotonic_ns(), self._now_ns())

    def _deliver(self, numbers: Iterator[Number]) -> None:
        """Take what has come; tell what changed, and look at the time."""
        self._excuse(self._now())
        for number in numbers:
            self._take(number)
        now = self._now()
        if now.steady_ns - self._ticked_ns > _OVERDUE_NS:
            self.tick()
        else:
            self._session.flush(now)

    def _receive(self, number: Number) -> None:
        name, place, time_ns, value, latest = number
        update = self._session.take(name, place, time_ns, value, self._now(), latest)
        if update.status.believed and place != LEVEL:
            self._watchdog.hear(name)

    def tick(self) -> None:
        """Look after everything that time brings."""
        now = self._now()
        late = now.steady_ns - self._ticked_ns > _OVERDUE_NS
        self._excuse(now)
        if late:
            # What waits comes first: no input is lost whose messages are there.
            # They have the time of now: while they are worked off, we are held up.
            for number in self._inputs.waiting():
                self._take(number)
        self._ticked_ns, now = now.steady_ns, self._now()
        if late:
            self._session.catch_up(now)
        self._watchdog.tick(now)
        self._session.tick(now, self._running.tick(now))
        self._own.tick_clips()
        if now.steady_ns - self._shown_ns >= SHOW_NS:
            self._shown_ns = now.steady_ns
            self._look(now)
            self._session.show(now)
        self._session.flush(now)

    def _excuse(self, now: Moment) -> None:
        """If we were held up, no input is to blame for that time."""
        held_ns = now.steady_ns - self._ticked_ns
        if held_ns <= HELD_UP_NS:
            return
        self._ticked_ns, held = now.steady_ns, held_ns * 1e-9
        self._health.delays += 1
        self._health.longest_delay = max(self._health.longest_delay, held)
        text = f'the node was held up for {held:.3g} s: answers were late, inputs are not to blame'
        self._log.warning(text)
        self._own.note('node', text)
        self._session.excuse(held_ns)
        self._watchdog.skip(now)

    def _look(self, now: Moment) -> None:
        """Look after the node's own health, once a second."""
        self._inputs.count_missing()
        if self._looks % _DOUBLE_LOOKS == 0:
            self._look_for_double()
        self._looks += 1
        self._own.look_at_files()
        steady, lost = now.steady_ns * 1e-9, self._health.gone
        if lost > self._lost_told and steady - self._lost_told_at >= LOSS_PERIOD:
            self._log.warning(
                f'{plural(lost - self._lost_told, "message")} lost on the way to the node,'
                f' {lost} since it was configured'
            )
            self._lost_told, self._lost_told_at = lost, steady

    def _look_for_double(self) -> None:
        before, self._health.double = self._health.double, has_double(self._node)
        if self._health.double and not before:
            text = f'another node is called {self._node.get_fully_qualified_name()}, too'
            self._log.error(text)
            self._own.note('node', text)
