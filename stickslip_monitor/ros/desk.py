# SPDX-License-Identifier: Apache-2.0
"""How much time has passed without a sample, on clocks that may stop, step or run fast.

The alarms of the live node: their clock, what is told of them, and what is kept.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

from rclpy.lifecycle import LifecycleNode

from stickslip_monitor.errors import AlarmStateError
from stickslip_monitor.monitor.alarms.alarm_records import (
    alarms_record,
    recall_state,
    state_record,
)
from stickslip_monitor.monitor.alarms.annunciator import MONITOR, Action, AlarmChange, Annunciator
from stickslip_monitor.monitor.alarms.causes import AlarmKind
from stickslip_monitor.monitor.config import MonitorConfig
from stickslip_monitor.monitor.monitor import Update
from stickslip_monitor.monitor.signals import Status
from stickslip_monitor.monitor.verdict import Event
from stickslip_monitor.ros.state_file import StateFile


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

    def tick(self, steady_ns: int, ros_ns: int) -> int:
        """Return the time since the last sample, given both clocks now [ns]."""
        steady, ros = steady_ns - self._steady_ns, ros_ns - self._ros_ns
        moving = self._simulated and ros != 0 and self._ros_ns != 0
        self._steady_ns, self._ros_ns = steady_ns, ros_ns
        self._elapsed_ns += max(ros, 0) if moving else steady
        return self._elapsed_ns


HEARTBEAT_NS = 60 * 10**9
"""The list is told at least this often, as IEC 62923 asks of any source of alerts."""
_FAULTS = (Status.NOT_FINITE, Status.IMPLAUSIBLE)


class AlarmDesk:
    """Feeds the annunciator, and tells and keeps what changes.

    Args:
        node: The node, for its clock and its log.
        config: The configuration.
        publish: Called with every new text for ``~/alarms``.

    Attributes:
        annunciator: The alarms; to be changed through this desk only, from the node's thread.
    """

    def __init__(
        self, node: LifecycleNode, config: MonitorConfig, publish: Callable[[str], None]
    ) -> None:
        self._node, self._publish = node, publish
        self.annunciator = Annunciator(config)
        self._file = StateFile(config.state_file) if config.state_file else None
        self._flow: ElapsedTime | None = None
        self._begun_ns = self._told_ns = 0
        self._sequence = 0
        self._recall()

    def retune(self, config: MonitorConfig) -> None:
        """Take over new delays, limits and times; no state is lost."""
        self.annunciator.retune(config)

    def rebuild(self, config: MonitorConfig, publish: Callable[[str], None]) -> None:
        """The monitor starts afresh with other inputs."""
        self._publish = publish
        self._file = StateFile(config.state_file) if config.state_file else None
        self.annunciator.retune(config)
        self.annunciator.restart()

    def start(self, flow: ElapsedTime) -> None:
        """Tell the list, and let time run from now on, as that flow measures it."""
        self._flow, self._begun_ns = flow, self.annunciator.now_ns
        self._tell([])

    def tick(self, steady_ns: int, ros_ns: int) -> None:
        """Let time pass, given both clocks now [ns]."""
        assert self._flow is not None
        now_ns = self._begun_ns + self._flow.tick(steady_ns, ros_ns)
        changes = self.annunciator.advance(now_ns, ros_ns)
        if changes or now_ns - self._told_ns >= HEARTBEAT_NS:
            self._tell(changes)

    def take_update(self, bearing: str, is_load: int, time_ns: int, update: Update) -> None:
        """A sample has come to the monitor, and this is what it brought."""
        changes = []
        if update.status in _FAULTS:
            changes += self.annunciator.take_fault(bearing, is_load, update.status, time_ns)
        if update.verdict is not None:
            changes += self.annunciator.take_verdict(update.verdict)
        self._changed(changes)
        self.take_events(update.events)

    def take_events(self, events: list[Event]) -> None:
        """Conditions have changed."""
        for event in events:
            self._changed(self.annunciator.take_event(event))

    def act(
        self, action: Action, by: str, bearing: str | None = None, kind: AlarmKind | None = None
    ) -> list[AlarmChange]:
        """Do what a person asks for; see :meth:`Annunciator.act`."""
        now_ns = self._node.get_clock().now().nanoseconds
        changes = self.annunciator.act(action, now_ns, by, bearing, kind)
        self._changed(changes)
        return changes

    def _changed(self, changes: list[AlarmChange]) -> None:
        if changes:
            self._tell(changes)

    def _tell(self, changes: list[AlarmChange]) -> None:
        self._told_ns = self.annunciator.now_ns
        self._sequence += 1
        now_ns = self._node.get_clock().now().nanoseconds
        record = alarms_record(self.annunciator, changes, now_ns, self._sequence)
        self._publish(json.dumps(record, allow_nan=False))
        for change in changes:
            # What the monitor itself does is in the log as a warning already.
            if change.by != MONITOR:
                self._node.get_logger().info(
                    f'{change.bearing}/{change.kind}: {change.what} by {change.by},'
                    f' {change.before} -> {change.after}'
                )
        if changes:
            self._keep(state_record(self.annunciator, now_ns))

    def _keep(self, document: dict[str, Any]) -> None:
        if self._file is None:
            return
        try:
            self._file.write(document)
        except OSError as error:
            # A full disk must not stop the monitor.
            self._node.get_logger().error(
                f'the alarms are not kept: {error}', throttle_duration_sec=60.0
            )

    def _recall(self) -> None:
        if self._file is None:
            return
        try:
            document = self._file.read()
            if document is not None:
                now_ns = self._node.get_clock().now().nanoseconds
                recall_state(self.annunciator, document, now_ns)
        except AlarmStateError as error:
            self._set_aside(self._file, error)

    def _set_aside(self, file: StateFile, reason: AlarmStateError) -> None:
        try:
            end = f'it is now {file.set_aside()}, and the alarms start fresh'
        except OSError as error:
            end = f'the alarms start fresh; it cannot be set aside: {error}'
        self._node.get_logger().error(f'state_file {file.path} cannot be used: {reason}; {end}')
