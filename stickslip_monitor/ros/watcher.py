# SPDX-License-Identifier: Apache-2.0
"""Listens to a monitor from another process, and hands on what people ask of it."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions
from std_msgs.msg import String

from stickslip_monitor.errors import RosError
from stickslip_monitor.monitor.alarms.requests import ActionRequest, request_record
from stickslip_monitor.monitor.messages import hardware_id
from stickslip_monitor.ros.message_types import ROS_FAULTS

TakeStatus = Callable[[str, int, str, Mapping[str, str]], None]
TakeAlarms = Callable[[Any], None]
_ALARMS = QoSProfile(
    depth=20,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
_RELIABLE = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)


class Watcher:
    """A node beside the monitor's. Its callbacks run in the thread that spins it.

    Args:
        monitor: Full name of the monitor's node.
        diagnostics: Topic of its diagnostics.
        take_status: Called with bearing, time [ns], text and key-value pairs of each status.
        take_alarms: Called with each list of alarms.
        take_other: Called with the name of another monitor whose diagnostics come.

    Raises:
        RosError: A name is none.
    """

    def __init__(
        self,
        monitor: str,
        diagnostics: str,
        take_status: TakeStatus,
        take_alarms: TakeAlarms,
        take_other: Callable[[str], None],
    ) -> None:
        self._monitor = monitor.strip('/')
        self._take_status, self._take_alarms = take_status, take_alarms
        self._take_other = take_other
        self.node = Node('stickslip_dashboard')
        try:
            self.node.create_subscription(
                DiagnosticArray, diagnostics, self._on_diagnostics, _RELIABLE
            )
            self.node.create_subscription(String, f'{monitor}/alarms', self._on_alarms, _ALARMS)
            self._actions = self.node.create_publisher(String, f'{monitor}/actions', _RELIABLE)
        except ROS_FAULTS as error:
            self.node.destroy_node()
            text = str(error).splitlines()[0].rstrip(':')
            raise RosError(f"node '{monitor}': {text}") from error

    def act(self, request: ActionRequest) -> None:
        """Hand a request on.

        Raises:
            RosError: No monitor is there to take it.
        """
        if not self._actions.get_subscription_count():
            raise RosError('the monitor is not there, or not active: nothing was done')
        try:
            self._actions.publish(String(data=json.dumps(request_record(request))))
        except rclpy_implementation.RCLError as error:
            raise RosError(f'the monitor cannot be told: {error}') from error

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        time_ns = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
        for status in message.status:
            # Others publish on /diagnostics too, monitors in other namespaces among them.
            node, _, bearing = status.name.rpartition(': ')
            if status.hardware_id != hardware_id(node, bearing):
                continue
            if node != self._monitor:
                self._take_other(node)
            else:
                values = {pair.key: pair.value for pair in status.values}
                self._take_status(bearing, time_ns, status.message, values)

    def _on_alarms(self, message: String) -> None:
        try:
            document = json.loads(message.data)
        except (ValueError, RecursionError):
            self.node.get_logger().warning('a list of alarms is not JSON', once=True)
            return
        self._take_alarms(document)


@contextmanager
def open_watcher(
    monitor: str,
    diagnostics: str,
    take_status: TakeStatus,
    take_alarms: TakeAlarms,
    take_other: Callable[[str], None],
) -> Iterator[Watcher]:
    """A watcher that is spun by a thread of its own, with ROS running for as long.

    Signals are left to the program. See :class:`Watcher` for the arguments.
    """
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    try:
        watcher = Watcher(monitor, diagnostics, take_status, take_alarms, take_other)
        executor = SingleThreadedExecutor()
        executor.add_node(watcher.node)
        thread = threading.Thread(target=_spin, args=(executor,), name='ros', daemon=True)
        thread.start()
        try:
            yield watcher
        finally:
            executor.shutdown()
            thread.join()
            watcher.node.destroy_node()
    finally:
        rclpy.try_shutdown()


def _spin(executor: SingleThreadedExecutor) -> None:
    with suppress(ExternalShutdownException):
        executor.spin()
