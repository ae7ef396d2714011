# SPDX-License-Identifier: Apache-2.0
"""Other nodes: who publishes what a monitor reads, and the node beside monitors.

That one shows what they publish, and hands on what people ask and what buses bring.
"""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from functools import partial
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.expand_topic_name import expand_topic_name
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSCompatibility, QoSProfile, ReliabilityPolicy, qos_check_compatible
from rclpy.signals import SignalHandlerOptions
from std_msgs.msg import Float64, String

from stickslip_monitor.errors import RosError
from stickslip_monitor.monitor.alarm_records import ActionRequest, request_record
from stickslip_monitor.monitor.bearing_records import BEARINGS_SCHEMA, NODE_STATUS, hardware_id
from stickslip_monitor.monitor.input_faults import Graph, Publisher
from stickslip_monitor.monitor.parameters import MonitorConfig
from stickslip_monitor.monitor.sample_types import Input
from stickslip_monitor.monitor.session import Sink
from stickslip_monitor.monitor.value_check import refused
from stickslip_monitor.ros.inputs import ROS_FAULTS, Lane, make_input_qos


def without_log_files(arguments: Sequence[str]) -> list[str]:
    """Return the arguments for ``rclpy.init``, with rcl's own log files off unless they are asked for.

    Standard error has all that they would have. A health check every 30 s left a million files a
    year, and without a folder that can be written nothing started.
    """
    return ['--ros-args', '--disable-external-lib-logs', '--', *arguments]


class RosGraph(Graph):
    """The graph as a node sees it.

    Args:
        topics: Topics of inputs as they are given: what is resolved twice is remapped twice.

    Attributes:
        lanes: What comes on the topics, by their full names.
    """

    def __init__(self, node: Node, topics: Iterable[str]) -> None:
        self._node = node
        self._given = {node.resolve_topic_name(topic): topic for topic in topics}
        self.lanes: dict[str, Lane] = {}

    def publishers(self, topic: str, bearing: str, place: int) -> tuple[Publisher, ...]:
        """Return the publishers of a topic, with what keeps their messages from an input of a bearing.

        Args:
            topic: Its full name.
            bearing: Name of the bearing.
            place: The input, a place in :data:`.sample_types.INPUTS`.
        """
        name = self._given.get(topic, topic)
        profile, lane = self._asked_quality(name), self.lanes.get(topic)
        override = _override_clause(topic, profile)
        infos = self._node.get_publishers_info_by_topic(name)
        if lane is not None and not any(bytes(info.endpoint_gid) in lane.senders for info in infos):
            # Some middleware names senders otherwise than publishers.
            lane = None
        return tuple(
            _publisher_of(
                info,
                profile,
                override,
                lane is None or lane.is_sending(bytes(info.endpoint_gid), bearing, place),
            )
            for info in infos
        )

    def is_undecodable(self, topic: str) -> bool:
        """Return whether the latest message of a topic (its full name) could not be decoded."""
        return topic in self.lanes and self.lanes[topic].undecodable

    def other_names(self, topic: str) -> tuple[str, ...]:
        """Return the sorted elements that messages of a topic named and no input reads; () for none."""
        return tuple(sorted(self.lanes[topic].names)) if topic in self.lanes else ()

    def _asked_quality(self, name: str) -> QoSProfile:
        """Return the quality of service that the subscription asks for, after overrides.

        Without a subscription it is that of :func:`.inputs.make_input_qos`.
        """
        node_key = self._node.get_name(), self._node.get_namespace()
        for info in self._node.get_subscriptions_info_by_topic(name):
            if (info.node_name, info.node_namespace) == node_key:
                return info.qos_profile
        return make_input_qos()


def node_name(info: Any) -> str:
    """Return the full name of the node at an end of a topic, or words for one without a name."""
    if info.node_name == _UNKNOWN_NODE:
        return 'a program that names no node'
    return f'{info.node_namespace.rstrip("/")}/{info.node_name}'


def _override_clause(topic: str, profile: QoSProfile) -> str:
    """Return the clause on what a subscription asks for by overrides, in brackets after a space; '' for none.

    Only reliability and durability are named: best effort and volatile match all.
    """
    usual = make_input_qos()
    clauses = [
        f'qos_overrides.{topic}.subscription.{name} asks for {getattr(profile, name).name.lower()}'
        for name in ('reliability', 'durability')
        if getattr(profile, name) != getattr(usual, name)
    ]
    return f' ({", ".join(clauses)})' if clauses else ''


def _publisher_of(info: Any, profile: QoSProfile, override: str, sends: bool) -> Publisher:
    """Describe a publisher of an input: who, which type, and what keeps its messages from the node.

    That is a quality of service that does not match, or that it latches and the latched one is not received.

    Args:
        info: The publisher as rclpy describes the end of a topic.
        profile: What the subscription asks for.
        override: Appended to the fault: what overrides have changed in it.
        sends: Whether its messages still come.
    """
    match, reason = qos_check_compatible(info.qos_profile, profile)
    fault = ''
    if match is QoSCompatibility.ERROR:
        fault = (str(reason).strip(' ;.') or 'no reason is given') + override
    latched = info.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
    is_received = profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
    return Publisher(node_name(info), info.topic_type, fault, latched and not is_received, sends)


def reliable_qos(depth: int = 10, latched: bool = False) -> QoSProfile:
    """Return a reliable quality of service; a latched one keeps ``depth`` messages for later readers."""
    durability = DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE
    return QoSProfile(depth=depth, reliability=ReliabilityPolicy.RELIABLE, durability=durability)


HandOver = Callable[..., object]
"""Calls a function with arguments in the thread in which the listeners live."""
ALARMS_KEPT = 20
"""Lists of alarms that a later subscriber is given."""
_NAME = 'stickslip_dashboard'
"""What the security policy allows a reader to be called."""
_UNKNOWN_NODE = '_NODE_NAME_UNKNOWN_'
NUMBER_TYPE, NUMBER_FIELD = 'std_msgs/msg/Float64', 'data'


class Watcher:
    """Receives from monitors. The callbacks run in the thread that spins the node.

    Args:
        listeners: Receivers of the records of each monitor, by the full name of its node.
        diagnostics: The topic of the nodes' diagnostics.
        hand_over: Calls a method of a listener with its arguments in the listeners' thread.

    Raises:
        RosError: A name is not valid.
    """

    def __init__(
        self, node: Node, listeners: Mapping[str, Sink], diagnostics: str, hand_over: HandOver
    ) -> None:
        self.node, self._hand_over = node, hand_over
        self._listeners = {name.strip('/'): listener for name, listener in listeners.items()}
        self._actions: dict[str, Any] = {}
        listen, name = node.create_subscription, diagnostics
        try:
            listen(DiagnosticArray, diagnostics, self._on_diagnostics, reliable_qos())
            for name, listener in listeners.items():
                listen(
                    String,
                    f'{name}/alarms',
                    partial(self._on_alarms, listener, name),
                    reliable_qos(ALARMS_KEPT, True),
                )
                listen(String, f'{name}/bearings', partial(self._on_bearings, listener, name), reliable_qos())
                self._actions[name] = node.create_publisher(String, f'{name}/actions', reliable_qos())
        except ROS_FAULTS as error:
            text = str(error).splitlines()[0].rstrip(':')
            raise RosError(f"node '{name}': {text}") from error

    def act(self, monitor: str, request: ActionRequest) -> None:
        """Send a request to one of the listened-to monitors, by its full name.

        Its list of alarms shows later whether the request was carried out.

        Raises:
            RosError: The monitor receives no requests at present, or this one cannot be sent.
        """
        actions = self._actions[monitor]
        if not actions.get_subscription_count():
            raise RosError('the monitor is not there, or not active: nothing was done')
        try:
            actions.publish(String(data=json.dumps(request_record(request))))
        except rclpy_implementation.RCLError as error:
            raise RosError(f'the monitor cannot be reached: {error}') from error

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        """Pass the health of each watched node to its listener, and the names of other monitors to all."""
        for status in message.status:
            # Others publish on /diagnostics too, monitors in other namespaces among them.
            node, _, bearing = status.name.rpartition(': ')
            if _is_of_node(status):
                if watched := self._listeners.get(node):
                    self._hand_over(watched.take_health, status.level[0], status.message)
            elif node not in self._listeners and status.hardware_id == hardware_id(node, bearing):
                for listener in self._listeners.values():
                    self._hand_over(listener.take_other, node)

    def _on_bearings(self, listener: Sink, monitor: str, message: String) -> None:
        """Pass on the record of each bearing in a message; ignore a message of another schema, or no JSON."""
        document = self._parse_message(monitor, message)
        if isinstance(document, dict) and document.get('schema') == BEARINGS_SCHEMA:
            for record in document['bearings']:
                self._hand_over(listener.take_record, record)

    def _on_alarms(self, listener: Sink, monitor: str, message: String) -> None:
        """Pass on the list of alarms in a monitor's message, of any schema; ``None`` where it is not JSON."""
        self._hand_over(listener.take_alarms, self._parse_message(monitor, message))

    def _parse_message(self, monitor: str, message: String) -> Any:
        """Parse the JSON of a monitor's message; return ``None`` where it is not JSON, and log that once."""
        try:
            return json.loads(message.data)
        except (ValueError, RecursionError):
            self.node.get_logger().warning(f'{monitor} publishes what is not JSON: ignored', once=True)
            return None


class Bridge:
    """A publisher for each topic of inputs from a bus; the first bearing on a topic brings its values.

    Args:
        monitor: Full name of the monitor's node, to which names of topics are relative.
        inputs: Bearing and input, of each that comes from a bus.

    Raises:
        RosError: An input is configured for other messages, or its topic's name is not valid.
    """

    def __init__(
        self, node: Node, monitor: str, config: MonitorConfig, inputs: Iterable[tuple[str, Input]]
    ) -> None:
        self._publishers: dict[tuple[str, Input], Any] = {}
        topics = set()
        space, _, name_of_node = monitor.rpartition('/')
        for name, place in inputs:
            quantity = place.name.lower()
            source = config.bearing(name).inputs[quantity]
            if (source.type, source.field_text) != (NUMBER_TYPE, NUMBER_FIELD):
                rule = f"{NUMBER_TYPE}, field '{NUMBER_FIELD}': what a bus brings is published so"
                raise refused(f'{name}.{quantity}.type', source.type, rule, RosError)
            # Of two bearings on one shaft the first brings the speed for both.
            if source.topic in topics:
                continue
            topics.add(source.topic)
            try:
                topic = expand_topic_name(source.topic, name_of_node, space or '/')
                publisher = node.create_publisher(Float64, topic, 10)
            except ROS_FAULTS as error:
                raise RosError(f'{source.topic} cannot be published: {error}') from error
            self._publishers[name, place] = publisher

    def take(self, bearing: str, place: Input, value: float) -> None:
        """Publish a number in the input's unit; of a speed of two bearings only that of the first."""
        if (bearing, place) in self._publishers:
            self._publishers[bearing, place].publish(Float64(data=value))


def _is_of_node(status: DiagnosticStatus) -> bool:
    """Return whether a status is that of a monitor's node itself."""
    node, _, subject = status.name.rpartition(': ')
    return subject == NODE_STATUS and status.hardware_id == node


@contextmanager
def open_watcher(listeners: Mapping[str, Sink], diagnostics: str, hand_over: HandOver) -> Iterator[Watcher]:
    """Yield a watcher of monitors, with ROS running in a thread until the block ends.

    Args:
        listeners: Receivers of the records of each monitor, by the full name of its node.
        diagnostics: The topic of the nodes' diagnostics.
        hand_over: Calls a method of a listener with its arguments in the listeners' thread.

    Raises:
        RosError: ROS cannot be started, or a name is not valid.
    """
    with _open_node() as (node, spin):
        watcher = Watcher(node, listeners, diagnostics, hand_over)
        spin()
        yield watcher


@contextmanager
def receive_health(diagnostics: str, take: Callable[[str, int, str], None]) -> Iterator[None]:
    """Have ``take`` called, in another thread, with the health of each monitor's node until the block ends.

    It is given the node's full name, the level and the text of its diagnostic status.

    Raises:
        RosError: ROS cannot be started, or the topic's name is not valid.
    """

    def on_diagnostics(message: DiagnosticArray) -> None:
        """Give ``take`` the health of each monitor's node in a message."""
        for status in filter(_is_of_node, message.status):
            take(f'/{status.hardware_id}', status.level[0], status.message)

    with _open_node() as (node, spin):
        try:
            node.create_subscription(DiagnosticArray, diagnostics, on_diagnostics, reliable_qos())
        except ROS_FAULTS as error:
            raise RosError(f"--diagnostics '{diagnostics}' is not a valid topic name") from error
        spin()
        yield


@contextmanager
def _open_node() -> Iterator[tuple[Node, Callable[[], None]]]:
    """Start ROS and yield a node, with a function that starts a thread to spin it; end all after the block.

    Signals are left to the program.

    Raises:
        RosError: ROS cannot be started.
    """
    try:
        rclpy.init(args=without_log_files([]), signal_handler_options=SignalHandlerOptions.NO)
    except rclpy_implementation.RCLError as error:
        raise RosError(f'ROS cannot be started: {str(error).partition(", at /")[0]}') from error
    try:
        node, executor = Node(_NAME), SingleThreadedExecutor()
        executor.add_node(node)

        def spin() -> None:
            """Serve the node's callbacks until the executor or ROS is shut down."""
            with suppress(ExternalShutdownException):
                executor.spin()

        thread = threading.Thread(target=spin, name='ros', daemon=True)
        try:
            yield node, thread.start
        finally:
            executor.shutdown()
            if thread.is_alive():
                thread.join()
            node.destroy_node()
    finally:
        rclpy.try_shutdown()
