# SPDX-License-Identifier: Apache-2.0
"""What lives only while the node is active: its ears, its services and the watchdog."""

from __future__ import annotations

import math
import time
from typing import Any, Protocol

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.lifecycle import LifecycleNode

from stickslip_monitor.errors import plural
from stickslip_monitor.monitor.config import MonitorConfig
from stickslip_monitor.monitor.health import NodeHealth
from stickslip_monitor.monitor.session import Moment, Session
from stickslip_monitor.monitor.signals import LEVEL
from stickslip_monitor.ros.actions import Actions
from stickslip_monitor.ros.event_clips import Clips
from stickslip_monitor.ros.graph import has_double
from stickslip_monitor.ros.inputs import Inputs, MonitoringNode
from stickslip_monitor.ros.message_types import ROS_FAULTS
from stickslip_monitor.ros.watchdog import ElapsedTime, Watchdog

WATCHDOG_PERIOD = 0.1
SHOW_NS = 10**9
"""The state of all bearings is told so often [ns]."""
LOSS_PERIOD = 60.0
HELD_UP_NS = 10**9
"""A watchdog that comes so late [ns] says that the node was held up, not its inputs."""
_OVERDUE_NS = 2 * 10**8
"""After so long [ns] the watchdog comes before further messages."""
_DOUBLE_LOOKS = 5


class Owner(MonitoringNode, Protocol):
    """What an active node's ears need of the node."""

    config: MonitorConfig
    health: NodeHealth
    clips: Clips | None

    def note(self, what: str, text: str) -> None:
        """Put something on record with the list of alarms."""

    def tick_clips(self) -> None:
        """Let time pass for the clips."""

    def look_at_files(self) -> None:
        """Bring the health of what is written up to date."""


class Active:
    """The ears of a node, and its sense of time.

    Args:
        node: The node, for ROS.
        owner: The same, for what is its own.
        session: What is fed.
        simulated: Whether ROS time follows /clock.

    Raises:
        Exception: One of :data:`.message_types.ROS_FAULTS`: an input or service cannot be made.
    """

    def __init__(
        self, node: LifecycleNode, owner: Owner, session: Session, simulated: bool
    ) -> None:
        self._node, self._owner, self._session = node, owner, session
        self._health, self._log = owner.health, node.get_logger()
        self._inputs: Inputs | None = None
        self._actions: Actions | None = None
        self._ticker: Any = None
        try:
            self._inputs = Inputs(
                owner,
                owner.config,
                owner.survived(self._receive),
                self._before,
                self._after,
                owner.health,
                None if owner.clips is None else owner.clips.take,
            )
            self._actions = Actions(node, list(session.monitor.bearings), session.alarms.act)
        except ROS_FAULTS:
            self.destroy()
            raise
        now = self._now()
        self._watchdog = Watchdog(session, simulated, now)
        self._running = ElapsedTime(simulated, now)
        self._ticked_ns, self._shown_ns = now.steady_ns, -SHOW_NS
        self._looks = self._lost_told = 0
        self._lost_told_at = -math.inf
        # A timer of the steady clock: those of ROS time stall when a replay steps back.
        self._ticker = node.create_timer(
            WATCHDOG_PERIOD,
            owner.survived(self.tick),
            clock=Clock(clock_type=ClockType.STEADY_TIME),
        )

    def destroy(self) -> None:
        """Take subscriptions, services and timer down."""
        for part in (self._inputs, self._actions):
            if part is not None:
                part.destroy()
        if self._ticker is not None:
            self._node.destroy_timer(self._ticker)

    def _now(self) -> Moment:
        return Moment(time.monotonic_ns(), self._owner.now_ns())

    def _receive(self, name: str, place: int, time_ns: int, value: float, latest: bool) -> None:
        update = self._session.take(name, place, time_ns, value, self._now(), latest)
        if update.status.believed and place != LEVEL:
            self._watchdog.hear(name)

    def _before(self) -> None:
        """Messages have come: if we were held up, no input is to blame for the time since."""
        self._excuse(self._now())

    def _after(self) -> None:
        """The messages that waited have been taken: tell what changed, and look at the time."""
        now = self._now()
        if now.steady_ns - self._ticked_ns > _OVERDUE_NS:
            self.tick()
        else:
            self._session.flush(now)

    def tick(self) -> None:
        """Look after everything that time brings."""
        now = self._now()
        if self._excuse(now):
            assert self._inputs is not None
            # What waits comes first.
            self._inputs.take_waiting()
            now = self._now()
            self._session.catch_up(now)
        self._ticked_ns = now.steady_ns
        self._watchdog.tick(now)
        self._session.tick(now, self._running.tick(now))
        self._owner.tick_clips()
        if now.steady_ns - self._shown_ns >= SHOW_NS:
            self._shown_ns = now.steady_ns
            self._look(now)
            self._session.show(now)
        self._session.flush(now)

    def _excuse(self, now: Moment) -> bool:
        """Whether we were held up: then no input is to blame for that time."""
        held_ns = now.steady_ns - self._ticked_ns
        if held_ns <= HELD_UP_NS:
            return False
        self._ticked_ns, held = now.steady_ns, held_ns * 1e-9
        self._health.delays += 1
        self._health.longest_delay = max(self._health.longest_delay, held)
        text = f'the node was held up for {held:.3g} s: answers were late, inputs are not to blame'
        self._log.warning(text)
        self._owner.note('node', text)
        self._session.excuse(held_ns)
        self._watchdog.skip(now)
        return True

    def _look(self, now: Moment) -> None:
        """Look after the node's own health, once a second."""
        assert self._inputs is not None
        self._inputs.count_missing()
        if self._looks % _DOUBLE_LOOKS == 0:
            self._look_for_double()
        self._looks += 1
        self._owner.look_at_files()
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
            self._owner.note('node', text)
