# SPDX-License-Identifier: Apache-2.0
"""Listens to monitors from another process, and hands on what people ask of it."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import partial
from typing import Any, Protocol

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
from stickslip_monitor.monitor.health import NODE_STATUS
from stickslip_monitor.monitor.messages import BEARINGS_SCHEMA, hardware_id
from stickslip_monitor.ros.message_types import ROS_FAULTS


class Listener(Protocol):
    """Takes what a monitor says."""

    def take_record(self, record: dict[str, Any], /) -> None:
        """The record of a bearing; see :func:`.messages.bearing_record`."""

    def take_health(self, level: int, text: str) -> None:
        """The diagnostic status of the node itself."""

    def take_alarms(self, document: Any, /) -> None:
        """The list of alarms."""

    def take_other(self, node: str) -> None:
        """The name of another monitor whose diagnostics come."""


HandOver = Callable[..., object]
"""Calls a function with arguments where the listeners live."""
_ALARMS = QoSProfile(
    depth=20,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
_RELIABLE = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)


class Watcher:
    """A node beside those of the monitors. Its callbacks run in the thread that spins it.

    Args:
        listeners: Who takes what a monitor says, by the full name of its node.
        diagnostics: Topic of their diagnostics.
        hand_over: Calls a listener's method.

    Raises:
        RosError: A name is none.
    """

    def __init__(
        self, listeners: Mapping[str, Listener], diagnostics: str, hand_over: HandOver
    ) -> None:
        self._listeners = {name.strip('/'): own for name, own in listeners.items()}
        self._hand_over = hand_over
        self._actions: dict[str, Any] = {}
        self.node = Node('stickslip_dashboard')
        name = diagnostics
        try:
            self.node.create_subscription(
                DiagnosticArray, diagnostics, self._on_diagnostics, _RELIABLE
            )
            for name, own in listeners.items():
                self.node.create_subscription(
                    String, f'{name}/alarms', partial(self._on_alarms, own), _ALARMS
                )
                self.node.create_subscription(
                    String, f'{name}/bearings', partial(self._on_bearings, own), _RELIABLE
                )
                self._actions[name] = self.node.create_publisher(
                    String, f'{name}/actions', _RELIABLE
                )
        except ROS_FAULTS as error:
            self.node.destroy_node()
            text = str(error).splitlines()[0].rstrip(':')
            raise RosError(f"node '{name}': {text}") from error

    def act(self, monitor: str, request: ActionRequest) -> None:
        """Hand a request on to the monitor of that full name.

        Raises:
            RosError: It is not there to take it.
        """
        actions = self._actions[monitor]
        if not actions.get_subscription_count():
            raise RosError('the monitor is not there, or not active: nothing was done')
        try:
            actions.publish(String(data=json.dumps(request_record(request))))
        except rclpy_implementation.RCLError as error:
            raise RosError(f'the monitor cannot be told: {error}') from error

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            # Others publish on /diagnostics too, monitors in other namespaces among them.
            node, _, bearing = status.name.rpartition(': ')
            if bearing == NODE_STATUS and status.hardware_id == node:
                if own := self._listeners.get(node):
                    self._hand_over(own.take_health, status.level[0], status.message)
            elif status.hardware_id != hardware_id(node, bearing):
                continue
            elif node not in self._listeners:
                for each in self._listeners.values():
                    self._hand_over(each.take_other, node)

    def _on_bearings(self, listener: Listener, message: String) -> None:
        document = self._document(message)
        if isinstance(document, dict) and document.get('schema') == BEARINGS_SCHEMA:
            for record in document['bearings']:
                self._hand_over(listener.take_record, record)

    def _on_alarms(self, listener: Listener, message: String) -> None:
        self._hand_over(listener.take_alarms, self._document(message))

    def _document(self, message: String) -> Any:
        try:
            return json.loads(message.data)
        except (ValueError, RecursionError):
            self.node.get_logger().warning('what a monitor says is not JSON', once=True)
            return None


@contextmanager
def open_watcher(
    listeners: Mapping[str, Listener], diagnostics: str, hand_over: HandOver
) -> Iterator[Watcher]:
    """A watcher that is spun by a thread of its own, with ROS running for as long.

    Signals are left to the program. See :class:`Watcher` for the arguments.
    """
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    try:
        watcher = Watcher(listeners, diagnostics, hand_over)
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
