# SPDX-License-Identifier: Apache-2.0
"""Real nodes over real DDS, kept to this machine: in this process, or in one of their own."""

from __future__ import annotations

import json
import os
import socket
import sys
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml
from shared import DEADLINE, REFERENCE, Program

T0 = time.time_ns() // 10**9 * 10**9
SECOND = 10**9
JOINT = 'sensor_msgs/msg/JointState'
PARAMETERS = REFERENCE | {
    'speed.topic': 'shaft/speed',
    'load.topic': 'aft/load',
    # The node is tested, not the decision: it turns at the boundaries themselves.
    'alarm.caution_margin': 0.1,
    'alarm.look_ahead': 0.0,
    'alarm.onset_growth': 0.0,
}
# Speed and load in one message: an operating point arrives whole, with a time of the test's own.
STAMPED = {
    'speed.topic': 'shaft',
    'speed.type': JOINT,
    'speed.field': 'velocity[0]',
    'speed.timeout': 1000.0,
    'load.topic': 'shaft',
    'load.type': JOINT,
    'load.field': 'effort[0]',
    'load.timeout': 1000.0,
    'alarm.on_delay': 0.5,
    # The node's tests send a few samples: the first below the Hopf speed decides.
    'alarm.onset_growth': 0.0,
    'alarm.off_delay': 1.5,
}
# A stamp counts for a second, and the clock may come a few messages late.
_AHEAD = 0.4


def node_parameters(*changes: dict[str, Any], **node: Any) -> dict[str, Any]:
    """Node parameters with one reference bearing, aft, some of its values replaced."""
    values = dict(PARAMETERS)
    for change in changes:
        values |= change
    return {'bearings': ['aft']} | node | {f'aft.{key}': value for key, value in values.items()}


def stamped_parameters(*changes: dict[str, Any], **node: Any) -> dict[str, Any]:
    """Return :func:`node_parameters` of STAMPED on simulated time, which :class:`Telemetry` moves."""
    return node_parameters(STAMPED, *changes, use_sim_time=True, **node)


class Peer:
    """The test's own node: what it waits for, it spins for."""

    def __init__(self, name: str) -> None:
        import rclpy
        from rclpy.executors import SingleThreadedExecutor

        self.node = rclpy.create_node(name)
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)
        self.watched: list[Any] = []

    def until(self, condition: Callable[[], Any], event: str, deadline: float = DEADLINE) -> Any:
        """Spin until a condition holds; fail at the deadline."""
        end = time.monotonic() + deadline
        while not (value := condition()):
            if time.monotonic() > end:
                printed = '\n'.join(program.output for program in self.watched)
                pytest.fail(f'{event}: not within {deadline:g} s; the programs printed:\n{printed}')
            self.executor.spin_once(timeout_sec=0.02)
        return value

    def spin(self, seconds: float) -> None:
        """Let time pass."""
        end = time.monotonic() + seconds
        while (remaining := end - time.monotonic()) > 0:
            self.executor.spin_once(timeout_sec=remaining)

    def listen(self, kind: Any, topic: str, latched: bool = False, reliable: bool = True) -> Any:
        """Return a list that fills with the messages of a topic."""
        from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

        reliability, durability = ReliabilityPolicy, DurabilityPolicy
        qos = QoSProfile(
            depth=2000,
            reliability=reliability.RELIABLE if reliable else reliability.BEST_EFFORT,
            durability=durability.TRANSIENT_LOCAL if latched else durability.VOLATILE,
        )
        messages: list[Any] = []
        self.node.create_subscription(kind, topic, messages.append, qos)
        return messages

    def talk(self, kind: Any, topic: str, wait: bool = True) -> Any:
        """Return a publisher; ``wait`` until it has a subscriber."""
        publisher = self.node.create_publisher(kind, topic, 2000)
        if wait:
            self.until(lambda: publisher.get_subscription_count(), f'a subscriber of {topic}')
        return publisher

    def call(self, kind: Any, service: str, **request: Any) -> Any:
        """Call a service and return its response."""
        client = self.node.create_client(kind, service)
        self.until(client.service_is_ready, f'service {service}')
        future = client.call_async(kind.Request(**request))
        self.until(future.done, f'answer of {service}')
        self.node.destroy_client(client)
        return future.result()

    def close(self) -> None:
        self.executor.shutdown()
        self.node.destroy_node()


class Named:
    """A node of the monitor in a namespace of its own, and how to hear it."""

    def __init__(self, peer: Peer, space: str, values: dict[str, Any]) -> None:
        self.peer, self.space, self.values = peer, space, values

    def name(self, topic: str) -> str:
        """Return the full name of one of the node's own topics or services."""
        return f'/{self.space}/stickslip_monitor/{topic}'

    def input(self, topic: str) -> str:
        """Return the full name of an input topic."""
        return f'/{self.space}/{topic}'

    def listen(self, topic: str, kind: str = 'String', latched: bool = False) -> list[Any]:
        """Return a list that fills with the messages of one of the node's own topics."""
        import std_msgs.msg

        return self.peer.listen(getattr(std_msgs.msg, kind), self.name(topic), latched)

    def talk(self, topic: str, kind: str = 'Float64') -> Callable[[Any], None]:
        """Return a function that publishes a number on one of the node's inputs."""
        import std_msgs.msg

        message = getattr(std_msgs.msg, kind)
        publisher = self.peer.talk(message, self.input(topic))
        return lambda value: publisher.publish(message(data=value))

    def warnings(self) -> list[Any]:
        """Return the list that fills with warnings; see :func:`events`."""
        warnings = self.listen('warnings', latched=True)
        count = self.peer.node.count_publishers
        self.peer.until(lambda: count(self.name('warnings')), 'the node')
        return warnings

    def diagnostics(self) -> list[Any]:
        from diagnostic_msgs.msg import DiagnosticArray

        arrays: list[Any] = self.peer.listen(DiagnosticArray, f'/{self.space}/diagnostics')
        return arrays


class Log:
    """A logger that keeps what it is told."""

    def __init__(self) -> None:
        self.lines: list[str] = []

    def __getattr__(self, level: str) -> Callable[..., None]:
        return lambda text, **_: self.lines.append(f'[{level}] {text}')


class Hosted(Named):
    """The node in this process, spun with the test's own.

    Attributes:
        published: How many messages it has published to a subscriber, by topic.
    """

    def __init__(self, peer: Peer, space: str, values: dict[str, Any]) -> None:
        from rclpy.parameter import Parameter

        from stickslip_monitor.live import clip_store
        from stickslip_monitor.ros.node import MonitorNode

        super().__init__(peer, space, values)
        self.log = log = Log()
        self.published = published = Counter[str]()

        class Node(MonitorNode):
            def get_logger(self) -> Any:
                return log

            def create_lifecycle_publisher(self, *arguments: Any, **options: Any) -> Any:
                publisher = super().create_lifecycle_publisher(*arguments, **options)
                publish = publisher.publish

                def count_and_publish(message: Any) -> None:
                    if publisher.is_activated and publisher.get_subscription_count():
                        published[publisher.topic_name] += 1
                    publish(message)

                publisher.publish = count_and_publish
                return publisher

        topics = [f'/{topic}:=/{space}/{topic}' for topic in ('diagnostics', 'clock')]
        self.node: Any = Node(
            clip_store,
            namespace=space,
            use_global_arguments=False,
            cli_args=['--ros-args', *(word for topic in topics for word in ('-r', topic))],
            parameter_overrides=[Parameter(name, value=value) for name, value in values.items()],
        )
        peer.executor.add_node(self.node)
        if self.node.config.autostart:
            self.node.start()

    @property
    def output(self) -> str:
        return '\n'.join(self.log.lines)

    def has_taken(self, stamp_ns: int) -> bool:
        """Return whether speed and load of a stamp [ns], or later ones, have been taken."""
        bearing = self.node._configured.session.monitor.bearings['aft']
        return bool(min(bearing.state.stamp[:2]) >= stamp_ns)

    def set(self, atomically: bool = False, **values: Any) -> list[tuple[bool, str]]:
        """Set parameters (a double underscore stands for a dot); return success and reason of each."""
        from rclpy.parameter import Parameter

        changes = [Parameter(name.replace('__', '.'), value=v) for name, v in values.items()]
        if atomically:
            results = [self.node.set_parameters_atomically(changes)]
        else:
            results = self.node.set_parameters(changes)
        return [(result.successful, result.reason) for result in results]

    def get(self, *names: str) -> list[Any]:
        return [self.node.get_parameter(name.replace('__', '.')).value for name in names]

    def go(self, *transitions: str) -> bool:
        """Take transitions of the life cycle; return whether all succeeded."""
        return all(getattr(self.node, f'trigger_{name}')().name == 'SUCCESS' for name in transitions)

    def end(self) -> None:
        """Destroy the node, as its process does in the end."""
        if self.node is not None:
            self.peer.executor.remove_node(self.node)
            self.node.destroy_node()
            self.node = None


class Monitor(Named, Program):
    """The node in a process of its own."""

    def __init__(self, peer: Peer, space: str, folder: Path, values: dict[str, Any], *arguments: str) -> None:
        Named.__init__(self, peer, space, values)
        file = folder / f'{space}.yaml'
        file.write_text(yaml.safe_dump({'/**': {'ros__parameters': values}}))
        command = [sys.executable, '-m', 'stickslip_monitor.live', '--ros-args']
        command += ['--params-file', str(file), '-r', f'__ns:=/{space}']
        command += ['-r', f'/diagnostics:=/{space}/diagnostics', *arguments]
        Program.__init__(self, command, folder / f'{space}.log')


class Telemetry:
    """Operating points at 10 Hz for a node configured with STAMPED, and what it answers.

    It begins with some points of a speed and 1000 N, until node and test hear each other. Of a node
    on simulated time it moves the clock, a little ahead of the stamps; else the real one passes.

    Attributes:
        now: The latest stamp, after T0 [s].
    """

    def __init__(self, monitor: Named, rpm: float = 60.0, now: float = 0.0) -> None:
        from rosgraph_msgs.msg import Clock
        from sensor_msgs.msg import JointState

        self.peer, self.now, self._monitor = monitor.peer, now, monitor
        simulated = monitor.values.get('use_sim_time')
        self._clock = self.peer.talk(Clock, monitor.input('clock')) if simulated else None
        self.now = self._arrival_time(now)
        self._publisher = self.peer.talk(JointState, monitor.input('shaft'))
        numbers = ('amplitude', 'amplitude_exact', 'hopf_margin', 'fold_margin')
        kinds = dict.fromkeys(numbers, 'Float64') | {'regime': 'String'}
        self.received = {name: monitor.listen(f'aft/{name}', kind) for name, kind in kinds.items()}
        while not all(self.received.values()):
            self.send(rpm, 1000.0)
            self.peer.spin(0.1)
        # Whatever is still on its way belongs to the greeting.
        self.hold(rpm, 1000.0, 0.5)

    def send(self, rpm: float | None, load: float | None, at: float | None = None) -> None:
        """Publish one message, a tenth of a second after the one before or at a time of its own.

        ``None`` leaves an array empty.
        """
        from rosgraph_msgs.msg import Clock
        from sensor_msgs.msg import JointState

        if at is None:
            self.now = at = round(self.now + 0.1, 9)
        if self._clock is not None:
            clock = Clock()
            clock.clock.sec, clock.clock.nanosec = ros_seconds(self.now + _AHEAD)
            self._clock.publish(clock)
        message = JointState()
        message.header.stamp.sec, message.header.stamp.nanosec = ros_seconds(at)
        message.velocity = [] if rpm is None else [float(rpm)]
        message.effort = [] if load is None else [float(load)]
        self._publisher.publish(message)

    def step(self, rpm: float, load: float) -> dict[str, Any]:
        """Publish one operating point and return the answer to its load.

        It comes second, after that to the new speed with the load before; a node that is late gives the
        last answer only. Of a node in a process of its own nobody knows which one comes: it is the next.
        """
        counts = {name: len(received) for name, received in self.received.items()}
        self.send(rpm, load)

        def is_answered() -> bool:
            monitor = self._monitor
            if not isinstance(monitor, Hosted):
                return all(len(received) > counts[name] for name, received in self.received.items())
            published = {name: monitor.published[monitor.name(f'aft/{name}')] for name in counts}
            received = {name: len(received) for name, received in self.received.items()}
            return monitor.has_taken(T0 + round(self.now * SECOND)) and received == published

        self.peer.until(is_answered, f'answer to {rpm} rpm, {load} N at {self.now} s')
        return {name: received[-1].data for name, received in self.received.items()}

    def hold(self, rpm: float, load: float, seconds: float) -> dict[str, Any]:
        """Send an operating point ten times a second for some seconds; return the last answer."""
        self.now = max(self.now, self._arrival_time(self.now))
        for _ in range(round(seconds * 10)):
            self.peer.spin(max(0.0, self.now + 0.1 - self._arrival_time(self.now + 0.1)))
            answer = self.step(rpm, load)
        return answer

    def until(self, rpm: float, load: float, condition: Callable[[], Any], event: str) -> None:
        """Send an operating point until a condition holds; a node that stalls excuses that time."""

        def check() -> Any:
            self.hold(rpm, load, 0.1)
            return condition()

        self.peer.until(check, event)

    def _arrival_time(self, simulated: float) -> float:
        """Return the time of arrival, by which stamps that run ahead of it do not count [s]."""
        return simulated if self._clock is not None else round((time.time_ns() - T0) / SECOND, 1)


def ros_seconds(after: float) -> tuple[int, int]:
    """Return a time after T0 as ROS has it: seconds and nanoseconds."""
    return divmod(T0 + round(after * SECOND), SECOND)


def decode_warnings(warnings: list[Any]) -> list[dict[str, Any]]:
    """Decode warnings."""
    return [json.loads(message.data) for message in warnings]


def latest_status(diagnostics: list[Any], bearing: str = 'aft') -> dict[str, Any]:
    """Return the latest diagnostic status of a bearing, as a flat record."""
    status = next(
        (s for m in reversed(diagnostics) for s in m.status if s.name.endswith(f': {bearing}')), None
    )
    if status is None:
        return {}
    record = {'level': status.level, 'message': status.message, 'name': status.name}
    return record | {pair.key: pair.value for pair in status.values}


def claim_domain() -> tuple[int, socket.socket]:
    """Claim a DDS domain that is free on this machine; return it and the socket whose closing frees it.

    Domain d talks on UDP port 7400 + 250 d (DDSI-RTPS 9.6.2.3), which a participant shares with
    others but not with a socket that does not ask to share; up to 100 these ports lie below
    Linux's ephemeral ones. The TCP port of that number, which DDS leaves alone, keeps the domain
    from another run of these tests, until the process ends at the latest.
    """
    for domain in (1 + (os.getpid() + k) % 100 for k in range(100)):
        claim = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        port = 7400 + 250 * domain
        try:
            claim.bind(('127.0.0.1', port))
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as shared:
                shared.bind(('', port))
        except OSError:
            claim.close()
        else:
            return domain, claim
    pytest.fail('no DDS domain is free')
