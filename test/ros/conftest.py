# SPDX-License-Identifier: Apache-2.0
"""Real nodes in processes of their own, over real DDS, kept to this machine."""

from __future__ import annotations

import importlib
import itertools
import json
import math
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import yaml

# Only a test that fails waits so long; a busy machine may need some of it.
DEADLINE = 30.0
T0 = 1_700_000_000 * 10**9
SECOND = 10**9
JOINT = 'sensor_msgs/msg/JointState'
REFERENCE: dict[str, Any] = {
    'mass': 50.0,
    'damping': 400.0,
    'stiffness': 2.0e6,
    'journal_diameter': 0.1,
    'friction.law': 'stribeck',
    'friction.static': 0.3,
    'friction.kinetic': 0.1,
    'friction.decay': 10.0,
    'speed.topic': 'shaft/speed',
    'speed.unit': 'rpm',
    'load.topic': 'aft/load',
    'load.unit': 'N',
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
# The services that are called, and their types.
SERVICES = {
    'change_state': ('lifecycle_msgs', 'ChangeState'),
    'set_parameters': ('rcl_interfaces', 'SetParameters'),
    'set_parameters_atomically': ('rcl_interfaces', 'SetParametersAtomically'),
    'get_parameters': ('rcl_interfaces', 'GetParameters'),
    'describe_parameters': ('rcl_interfaces', 'DescribeParameters'),
    'get_state': ('lifecycle_msgs', 'GetState'),
}


def parameters(*changes: dict[str, Any], **node: Any) -> dict[str, Any]:
    """Node parameters with one reference bearing, aft, some of its values replaced."""
    values = dict(REFERENCE)
    for change in changes:
        values |= change
    return {'bearings': ['aft']} | node | {f'aft.{key}': value for key, value in values.items()}


class Program:
    """A program in a process of its own, and what it printed."""

    def __init__(self, command: list[str], log: Path) -> None:
        self._log = log
        with log.open('wb') as file:
            self.process = subprocess.Popen(command, stdout=file, stderr=subprocess.STDOUT)

    @property
    def output(self) -> str:
        return self._log.read_text(errors='replace')

    @property
    def alive(self) -> bool:
        return self.process.poll() is None

    def wait(self) -> int:
        return self.process.wait(DEADLINE)

    def stop(self, number: int = signal.SIGINT) -> int:
        if self.alive:
            self.process.send_signal(signal.SIGCONT)
            self.process.send_signal(number)
        return self.wait()

    def end(self) -> None:
        """Stop it whatever it takes; a killed program leaves shared memory behind."""
        try:
            self.stop()
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.wait()


class Peer:
    """The test's own node: what it waits for, it spins for."""

    def __init__(self, name: str) -> None:
        import rclpy
        from rclpy.executors import SingleThreadedExecutor

        self.node = rclpy.create_node(name)
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self.node)
        self.watched: list[Program] = []

    def until(self, condition: Callable[[], Any], what: str, deadline: float = DEADLINE) -> Any:
        """Spin until a condition holds; fail at the deadline."""
        end = time.monotonic() + deadline
        while not (value := condition()):
            if time.monotonic() > end:
                printed = '\n'.join(program.output for program in self.watched)
                pytest.fail(f'{what}: not within {deadline:g} s; the programs printed:\n{printed}')
            self._executor.spin_once(timeout_sec=0.02)
        return value

    def spin(self, seconds: float) -> None:
        """Let time pass."""
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0:
            self._executor.spin_once(timeout_sec=left)

    def listen(
        self, kind: Any, topic: str, latched: bool = False, reliable: bool = True, **options: Any
    ) -> list[Any]:
        """A list that fills with the messages of a topic."""
        from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

        qos = QoSProfile(
            depth=2000,
            reliability=(
                ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT
            ),
            durability=(
                DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE
            ),
        )
        heard: list[Any] = []
        self.node.create_subscription(kind, topic, heard.append, qos, **options)
        return heard

    def talk(self, kind: Any, topic: str, wait: bool = True) -> Any:
        """A publisher that somebody already listens to."""
        publisher = self.node.create_publisher(kind, topic, 500)
        if wait:
            self.until(lambda: publisher.get_subscription_count(), f'a subscriber of {topic}')
        return publisher

    def call(self, client: Any, request: Any, again: float = math.inf) -> Any:
        """The answer of a service; a request that changes nothing may be sent again."""
        self.until(client.service_is_ready, f'service {client.srv_name}')
        future, sent = client.call_async(request), time.monotonic()

        def answered() -> bool:
            nonlocal future, sent
            if time.monotonic() > sent + again:
                client.remove_pending_request(future)
                future, sent = client.call_async(request), time.monotonic()
            return bool(future.done())

        self.until(answered, f'answer of {client.srv_name}')
        return future.result()

    def close(self) -> None:
        self._executor.shutdown()
        self.node.destroy_node()


class Monitor(Program):
    """The monitor's node, in a namespace of its own."""

    def __init__(
        self,
        peer: Peer,
        space: str,
        folder: Path,
        values: dict[str, Any],
        *arguments: str,
        clock: str | None = None,
        diagnostics: str | None = None,
    ) -> None:
        self.peer, self.space = peer, space
        self.values = values
        file = folder / f'{space}.yaml'
        file.write_text(yaml.safe_dump({'/**': {'ros__parameters': values}}))
        command = [sys.executable, '-m', 'stickslip_monitor.live', '--ros-args']
        command += ['--params-file', str(file), '-r', f'__ns:=/{space}']
        command += [
            '-r',
            f'/diagnostics:={diagnostics or f"/{space}/diagnostics"}',
            '-r',
            f'/clock:={clock or f"/{space}/clock"}',
        ]
        self._clients = {service: self._client(service) for service in SERVICES}
        self._met = False
        super().__init__([*command, *arguments], folder / f'{space}.log')

    def _client(self, service: str) -> Any:
        package, kind = SERVICES[service]
        services = importlib.import_module(f'{package}.srv')
        return self.peer.node.create_client(getattr(services, kind), self.name(service))

    def meet(self) -> None:
        """Wait until the node's answers find their way to every client created so far.

        That a service is ready is this side's view: a server that has not heard of the reader
        of its answers gives up on sending one, and says so only in its log. But readers are
        announced in the order of their creation, reliably. So an answer to a client created now
        shows that those of all before it are known.
        """
        client = self._client('get_state')
        self.peer.call(client, client.srv_type.Request(), again=1.0)
        self.peer.node.destroy_client(client)
        self._met = True

    def call(self, service: str, again: float = math.inf, **request: Any) -> Any:
        """The answer of one of the node's services; see :meth:`Peer.call`."""
        if not self._met:
            self.meet()
        client = self._clients[service]
        return self.peer.call(client, client.srv_type.Request(**request), again)

    def name(self, topic: str) -> str:
        """The full name of one of the node's own topics or services."""
        return f'/{self.space}/stickslip_monitor/{topic}'

    def input(self, topic: str) -> str:
        """The full name of an input topic."""
        return f'/{self.space}/{topic}'

    def warnings(self, latched: bool = True) -> list[Any]:
        """The list that fills with warnings; see :func:`events`."""
        from std_msgs.msg import String

        topic = self.name('warnings')
        heard = self.peer.listen(String, topic, latched)
        self.peer.until(lambda: self.peer.node.count_publishers(topic), 'the node')
        return heard

    def diagnostics(self) -> list[Any]:
        from diagnostic_msgs.msg import DiagnosticArray

        return self.peer.listen(DiagnosticArray, f'/{self.space}/diagnostics')

    def state(self) -> str:
        return str(self.call('get_state', again=1.0).current_state.label)

    def change_state(self, transition: int, label: str = '') -> bool:
        from lifecycle_msgs.msg import Transition

        request = Transition(id=transition, label=label)
        return bool(self.call('change_state', transition=request).success)

    def set(self, atomically: bool = False, **values: Any) -> list[tuple[bool, str]]:
        """Set parameters (a double underscore stands for a dot); whether, and why not."""
        from rclpy.parameter import Parameter

        changes = [
            Parameter(name.replace('__', '.'), value=value).to_parameter_msg()
            for name, value in values.items()
        ]
        service = 'set_parameters_atomically' if atomically else 'set_parameters'
        answer = self.call(service, parameters=changes)
        results = [answer.result] if atomically else answer.results
        return [(result.successful, result.reason) for result in results]

    def get(self, *names: str) -> list[Any]:
        from rclpy.parameter import parameter_value_to_python

        answer = self.call('get_parameters', names=[name.replace('__', '.') for name in names])
        return [parameter_value_to_python(value) for value in answer.values]


class Telemetry:
    """Operating points for a node configured with STAMPED, and the values it answers with.

    It begins with some points of 60 rpm and 1000 N, until node and test hear each other.
    """

    def __init__(self, monitor: Monitor, bearing: str = 'aft') -> None:
        from sensor_msgs.msg import JointState
        from std_msgs.msg import Float64, String

        self.peer = monitor.peer
        self._publisher = self.peer.talk(JointState, monitor.input('shaft'))
        numbers = ('amplitude', 'amplitude_exact', 'hopf_margin', 'fold_margin')
        kinds = dict.fromkeys(numbers, Float64)
        self.heard = {
            name: self.peer.listen(kind, monitor.name(f'{bearing}/{name}'))
            for name, kind in (kinds | {'regime': String}).items()
        }
        for second in range(-900, -700):
            self.send(60.0, 1000.0, second)
            self.peer.spin(0.1)
            if all(self.heard.values()):
                break
        # Whatever is still on its way belongs to the greeting.
        self.step(60.0, 1000.0, second + 1)

    def send(self, rpm: float | None, load: float | None, seconds: float) -> None:
        """Publish one message; ``None`` leaves the array empty."""
        from sensor_msgs.msg import JointState

        message = JointState()
        nanoseconds = T0 + round(seconds * SECOND)
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(nanoseconds, SECOND)
        message.velocity = [] if rpm is None else [float(rpm)]
        message.effort = [] if load is None else [float(load)]
        self._publisher.publish(message)

    def step(self, rpm: float, load: float, seconds: float, answers: int = 2) -> dict[str, Any]:
        """Publish one operating point and return the answer to its load, which comes second.

        The first answer is to the new speed with the load before, unless that is too old.
        """
        counts = {name: len(heard) for name, heard in self.heard.items()}
        self.send(rpm, load, seconds)
        self.peer.until(
            lambda: all(
                len(heard) >= counts[name] + answers for name, heard in self.heard.items()
            ),
            f'answer to {rpm} rpm, {load} N at {seconds} s',
        )
        return {name: heard[-1].data for name, heard in self.heard.items()}


def events(warnings: list[Any]) -> list[dict[str, Any]]:
    """The warnings heard, decoded."""
    return [json.loads(message.data) for message in warnings]


def status(diagnostics: list[Any], bearing: str = 'aft') -> dict[str, Any]:
    """The latest diagnostic status of a bearing, as a flat record."""
    found = next(
        (s for m in reversed(diagnostics) for s in m.status if s.name.endswith(f': {bearing}')),
        None,
    )
    if found is None:
        return {}
    record = {'level': found.level, 'message': found.message, 'name': found.name}
    return record | {pair.key: pair.value for pair in found.values}


def claim_domain() -> tuple[int, socket.socket]:
    """A DDS domain that nobody else on this machine uses, and what to close to give it back.

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


@pytest.fixture(scope='session')
def _ros(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    import rclpy

    domain, claim = claim_domain()
    with claim, pytest.MonkeyPatch.context() as patch:
        patch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
        patch.setenv('ROS_DOMAIN_ID', str(domain))
        patch.setenv('ROS_LOG_DIR', str(tmp_path_factory.mktemp('ros_log')))
        rclpy.init(args=[])
        yield
        rclpy.try_shutdown()


_numbers = itertools.count(1)


@pytest.fixture
def peer(_ros: None) -> Iterator[Peer]:
    """The test's own node."""
    peer = Peer(f'peer{next(_numbers)}')
    yield peer
    for program in peer.watched:
        program.end()
    peer.close()


@pytest.fixture
def run(peer: Peer, tmp_path: Path) -> Callable[..., Program]:
    """Starts a program; it is stopped when the test ends."""

    def start(*command: str) -> Program:
        program = Program(list(command), tmp_path / f'program{next(_numbers)}.log')
        peer.watched.append(program)
        return program

    return start


@pytest.fixture
def start(peer: Peer, tmp_path: Path) -> Callable[..., Monitor]:
    """Starts a monitor from its parameters; it is stopped when the test ends."""

    def start(values: dict[str, Any], *arguments: str, **topics: str) -> Monitor:
        space = f't{next(_numbers)}'
        monitor = Monitor(peer, space, tmp_path, values, *arguments, **topics)
        peer.watched.append(monitor)
        return monitor

    return start


@pytest.fixture(scope='session')
def kit() -> SimpleNamespace:
    """What the test modules share, as they cannot import one another."""

    return SimpleNamespace(
        parameters=parameters,
        events=events,
        status=status,
        Telemetry=Telemetry,
        DEADLINE=DEADLINE,
        T0=T0,
        SECOND=SECOND,
        STAMPED=STAMPED,
        JOINT=JOINT,
    )
