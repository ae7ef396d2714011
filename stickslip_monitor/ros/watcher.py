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
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
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
_NAME = 'stickslip_dashboard'
"""What the security policy allows a reader to be called."""


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
        self.node = Node(_NAME)
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
            if _is_of_node(status):
                if own := self._listeners.get(node):
                    self._hand_over(own.take_health, status.level[0], status.message)
            elif node not in self._listeners and status.hardware_id == hardware_id(node, bearing):
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


def _is_of_node(status: DiagnosticStatus) -> bool:
    """Whether a status is that of a monitor's node itself."""
    node, _, what = status.name.rpartition(': ')
    return what == NODE_STATUS and status.hardware_id == node


@contextmanager
def open_watcher(
    listeners: Mapping[str, Listener], diagnostics: str, hand_over: HandOver
) -> Iterator[Watcher]:
    """A watcher that is spun by a thread of its own, with ROS running for as long.

    Signals are left to the program. See :class:`Watcher` for the arguments.
    """
    with _ros():
        watcher = Watcher(listeners, diagnostics, hand_over)
        with _spun(watcher.node):
            yield watcher


@contextmanager
def hear_health(diagnostics: str, take: Callable[[str, int, str], None]) -> Iterator[None]:
    """Hand on full name, level and text of every monitor that tells how its node is.

    ``take`` is called in another thread.

    Raises:
        RosError: The topic's name is none.
    """

    def on_diagnostics(message: DiagnosticArray) -> None:
        for status in filter(_is_of_node, message.status):
            take(f'/{status.hardware_id}', status.level[0], status.message)

    with _ros():
        node = Node(_NAME)
        try:
            node.create_subscription(DiagnosticArray, diagnostics, on_diagnostics, _RELIABLE)
        except ROS_FAULTS as error:
            node.destroy_node()
            raise RosError(f"--diagnostics '{diagnostics}' is no name of a topic") from error
        with _spun(node):
            yield


@contextmanager
def _ros() -> Iterator[None]:
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    try:
        yield
    finally:
        rclpy.try_shutdown()


@contextmanager
def _spun(node: Node) -> Iterator[None]:
    """Spin a node in a thread of its own, and destroy it in the end."""
    executor = SingleThreadedExecutor()
    executor.add_node(node)

    def spin() -> None:
        with suppress(ExternalShutdownException):
            executor.spin()

    thread = threading.Thread(target=spin, name='ros', daemon=True)
    thread.start()
    try:
        yield
    finally:
        executor.shutdown()
        thread.join()
        node.destroy_node()
