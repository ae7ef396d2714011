# SPDX-License-Identifier: Apache-2.0
"""The process of the node: how it starts, is held up, is asked how it is, and ends."""

from __future__ import annotations

import re
import shutil
import signal
import socket
import subprocess
import sys
import sysconfig
import time
from contextlib import contextmanager
from fnmatch import fnmatchcase
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from xml.etree import ElementTree

import kit
import pytest
import yaml
from shared import ROOT

from stickslip_monitor import build_config
from stickslip_monitor.errors import ConfigurationError, RosError, StickslipError

pytest.importorskip('rclpy', reason='ROS 2 is not installed')

from stickslip_monitor.ros import process as node
from stickslip_monitor.ros.node import check_overrides

QOS = 'qos_overrides./shaft/speed.subscription'
UNITS = sorted((ROOT / 'launch_configs' / 'systemd').glob('*.service'))


CONFIGURED = build_config(kit.node_parameters())


def node_with_override(name: str, value: object) -> Any:
    """Return a node whose topics are as they are given, with one override."""
    parameters = {name.removeprefix('qos_overrides.'): SimpleNamespace(value=value)}
    return SimpleNamespace(
        resolve_topic_name=lambda topic: f'/{topic.replace("~", "stickslip_monitor").lstrip("/")}',
        get_parameters_by_prefix=lambda prefix: parameters,
    )


def assert_refused(program: Any, *texts: str) -> None:
    """Check that a program ended with one error that has these texts."""
    assert program.wait() == 2
    assert not {'Traceback', 'Warning'} & {*re.findall('Traceback|Warning', program.output)}
    errors = [line for line in program.output.splitlines() if line.startswith('ERROR: ')]
    assert len(errors) == 1
    assert all(text in errors[0] for text in texts)


def node_command(*arguments: str) -> list[str]:
    return [sys.executable, '-m', 'stickslip_monitor.live', '--ros-args', *arguments]


@pytest.mark.slow
def test_parameters_that_ros_cannot_use_are_refused(run: Any, start: Any, tmp_path: Path) -> None:
    missing = tmp_path / 'missing.yaml'
    for program, *texts in (
        (run(*node_command('--params-file', str(missing))), f'{missing}: No such file or directory'),
        (run(*node_command('--no-such-option')), 'the ROS arguments cannot be used: ', '--no-such-option'),
        (
            start(kit.node_parameters(), '-r', f'__node:={"n" * 300}'),
            'the node cannot be created: error creating node: invalid node name: node name length',
        ),
    ):
        assert_refused(program, *texts)


@pytest.mark.parametrize(
    ('change', 'text'),
    [
        ({'bearings': []}, 'bearings'),
        ({'qos_override./shaft/speed.subscription.depth': 5}, "did you mean 'qos_overrides'?"),
        ({'aft.speed.field': 'value'}, "std_msgs/msg/Float64 has no field 'value'; it has: data"),
        ({'use_sim_time': 'banana'}, "use_sim_time = 'banana' must be true or false"),
        ({'state_file': '/no/such/folder/x.json'}, 'there is no folder'),
        ({'clips.directory': '/dev/null/clips'}, 'cannot be used: '),
        # The node publishes this topic itself, with another type.
        (
            {'aft.speed.topic': '/parameter_events'},
            'the node cannot activate: its inputs cannot be subscribed to: ',
        ),
    ],
)
def test_a_bad_configuration_is_refused(host: Any, change: dict[str, Any], text: str) -> None:
    with pytest.raises(StickslipError, match=re.escape(text)):
        host(kit.node_parameters() | change)


@pytest.mark.parametrize(
    ('name', 'text'),
    [
        (f'{QOS}.deadline', 'it reads depth, durability, history, reliability'),
        (f'{QOS}.relaibility', "; did you mean 'reliability'?"),
        ('qos_overrides./shaft/sped.subscription.depth', "; did you mean '/shaft/speed.subscription'?"),
        ('qos_overrides./shaft/speed.publisher.depth', 'the node has no such input or output'),
    ],
)
def test_an_override_that_nothing_reads_is_named(name: str, text: str) -> None:
    (note,) = check_overrides(node_with_override(name, 5), CONFIGURED)
    assert note.startswith(f'{name} has no effect: ')
    assert text in note


@pytest.mark.parametrize(
    ('policy', 'value', 'text'),
    [
        ('depth', 'many', "depth = 'many' must be a whole number, not below 0"),
        ('depth', -1, 'depth = -1 must be a whole number'),
        ('reliability', 'relaible', 'must be one of system_default, reliable, best_effort'),
        ('reliability', 'relaible', "; did you mean 'reliable'?"),
        ('history', True, 'history = True must be one of'),
    ],
)
def test_an_override_with_another_value_is_refused(policy: str, value: object, text: str) -> None:
    with pytest.raises(ConfigurationError, match=re.escape(text)):
        check_overrides(node_with_override(f'{QOS}.{policy}', value), CONFIGURED)


@pytest.mark.parametrize(
    ('name', 'value'), [(f'{QOS}.reliability', 'reliable'), ('qos_overrides./diagnostics.publisher.depth', 1)]
)
def test_an_override_that_is_read_needs_no_word(name: str, value: object) -> None:
    assert check_overrides(node_with_override(name, value), CONFIGURED) == []


@pytest.mark.parametrize(
    ('arguments', 'text'),
    [
        ((), 'no parameters are given: monitor --ros-args --params-file FILE'),
        (('--params-file', 'x'), '--params-file has no effect outside --ros-args: write monitor --ros-args'),
        (('--ros-args', '--', '-p', 'x:=1'), '-p has no effect outside --ros-args'),
        (('--ros-args', '--params-file', 'right.yaml'), ''),
        (
            ('--ros-args', '--params-file', 'section.yaml'),
            "section.yaml has no parameters for '/stickslip_monitor': its sections are monitor; use '/**'",
        ),
        (('--ros-args', '-r', '__ns:=/port', '--params-file', 'port.yaml'), ''),
        (('--ros-args', '--params-file', 'port.yaml'), "for '/stickslip_monitor': its sections are /port"),
        (('--ros-args', '--params-file', 'section.yaml', '--params-file', 'right.yaml'), ''),
        (('--ros-args', '--params-file', 'empty.yaml'), 'bearings = [] is empty: give it at least one entry'),
        (
            ('--ros-args', '--params-file', 'pairs.yaml'),
            'does not read: write aft.load.over_speed: [0.0, 2.0, 60.0, 1.0]',
        ),
    ],
)
def test_a_slip_in_how_parameters_are_given_is_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: tuple[str, ...], text: str
) -> None:
    monkeypatch.chdir(tmp_path)
    for name, section, names in (
        ('right', '/**', '[aft]'),
        ('section', 'monitor', '[aft]'),
        ('port', '/port/stickslip_monitor', '[aft]'),
        ('empty', '/**', '[]'),
        ('pairs', '/**', '[aft], aft: {load: {over_speed: [[0, 2], [60, 1]]}}'),
    ):
        Path(f'{name}.yaml').write_text(f'{section}:\n  ros__parameters: {{bearings: {names}}}\n')
    message = node._parameter_slip(arguments)
    assert text in message
    assert bool(message) == bool(text)


def test_the_node_asks_what_check_would_ask(host: Any) -> None:
    monitor = host(kit.node_parameters() | {'aft.journal_diameter': 100.0})
    assert (
        '[warning] aft: speed turns a journal of 100 m: is journal_diameter in metres?' in monitor.log.lines
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    'signals',
    [
        [signal.SIGTERM],
        [signal.SIGINT, 0.15, signal.SIGINT],
        [signal.SIGTERM, 0.02, signal.SIGINT, 0.1, signal.SIGTERM],
    ],
)
def test_signals_end_the_node_cleanly(start: Any, signals: list[Any]) -> None:
    monitor = start(kit.node_parameters(kit.STAMPED))
    telemetry = kit.Telemetry(monitor)
    for _ in range(5):
        telemetry.send(20.0, 1000.0)
    for item in signals:
        if isinstance(item, signal.Signals):
            monitor.process.send_signal(item)
        else:
            time.sleep(item)
    assert monitor.wait() == 0
    assert 'Traceback' not in monitor.output
    assert 'Exception' not in monitor.output


# Before main() has its handlers, while Python imports, a signal is Python's own affair.
STARTING = """
import signal, sys
from stickslip_monitor.ros import process as node
from stickslip_monitor.ros.node import check_overrides
install = signal.signal
def noted(number, handler):
    install(number, handler)
    if number == signal.SIGTERM:
        print('starting', flush=True)
signal.signal = noted
sys.exit(node.main(sys.argv))
"""


@pytest.mark.slow
def test_signals_during_start_up(run: Any, tmp_path: Path) -> None:
    file = tmp_path / 'parameters.yaml'
    file.write_text(yaml.safe_dump({'/**': {'ros__parameters': kit.node_parameters()}}))
    starting = [sys.executable, '-c', STARTING, '--ros-args', '--params-file', str(file)]
    for number, delay in ((signal.SIGINT, 0.0), (signal.SIGTERM, 0.02), (signal.SIGINT, 0.2)):
        program = run(*starting)
        end = time.monotonic() + kit.DEADLINE
        while 'starting' not in program.output and time.monotonic() < end:
            time.sleep(0.002)
        time.sleep(delay)
        program.process.send_signal(number)
        assert program.wait() == 0, (delay, program.output)
        assert 'Traceback' not in program.output


@pytest.mark.slow
def test_every_large_message_is_accepted_or_counted_as_lost(start: Any) -> None:
    # Of 80 messages of 160 kB at once some find no room in the buffers of the system.
    from rclpy.qos import QoSProfile, ReliabilityPolicy
    from sensor_msgs.msg import JointState

    monitor = start(kit.node_parameters(kit.STAMPED))
    peer, diagnostics, topic = monitor.peer, monitor.diagnostics(), monitor.input('shaft')
    best_effort = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)
    talk = peer.node.create_publisher(JointState, topic, best_effort)
    peer.until(talk.get_subscription_count, 'the input')
    small = JointState(velocity=[60.0], effort=[1000.0])
    large = JointState(velocity=[60.0] * 10_000, effort=[1000.0] * 10_000)

    def counted() -> int:
        """Return how many messages are accounted for once all that came until now has been."""
        begun = len(diagnostics)
        # The next may have been on its way already.
        peer.until(lambda: len(diagnostics) > begun + 1, 'diagnostics')
        accepted = kit.latest_status(diagnostics).get('speed samples accepted', 0)
        node_status = kit.latest_status(diagnostics, 'the node')
        missing = (node_status.get(f'messages {name}', 0) for name in ('lost on the way', 'left out'))
        return int(accepted) + sum(map(int, missing))

    def has_one_come() -> bool:
        talk.publish(small)
        return counted() > 0

    # What is missing shows by the numbers between two that came: before the first nothing does.
    peer.until(has_one_come, 'the first')
    due = counted()
    for _ in range(80):
        talk.publish(large)
    due += 80

    def all_counted() -> bool:
        nonlocal due
        talk.publish(small)
        due += 1
        return counted() == due

    peer.until(all_counted, 'every one')


def test_without_ros_one_sentence_says_so(run: Any) -> None:
    text = "import sys; sys.modules['rclpy'] = None; from stickslip_monitor import live"
    assert_refused(run(sys.executable, '-c', f'{text}; sys.exit(live.main())'), 'source its setup file')


@pytest.mark.slow
def test_after_a_stall_of_the_node_no_input_is_blamed(start: Any) -> None:
    monitor = start(kit.node_parameters({'speed.timeout': 3.0, 'load.timeout': 3.0}))
    peer, warnings, diagnostics = monitor.peer, monitor.warnings(), monitor.diagnostics()
    speed, load = monitor.talk('shaft/speed'), monitor.talk('aft/load')

    def sending(condition: Any) -> Any:
        def check() -> Any:
            speed(60.0)
            load(1000.0)
            peer.spin(0.1)
            return condition()

        return check

    def reason() -> Any:
        return kit.latest_status(diagnostics).get('reason')

    def stall_count() -> int:
        """Return how often the node was held up: by this test, or by a busy machine."""
        return int(kit.latest_status(diagnostics, 'the node').get('times held up', 0))

    peer.until(sending(lambda: reason() == 'normal'), 'a quiet bearing')
    warnings.clear()
    for _ in range(2):
        count = stall_count()
        monitor.process.send_signal(signal.SIGSTOP)
        end = time.monotonic() + 4.0
        peer.until(sending(lambda end=end: time.monotonic() > end), 'some seconds')
        monitor.process.send_signal(signal.SIGCONT)
        peer.until(sending(lambda count=count: stall_count() > count), 'the delay')
    assert float(kit.latest_status(diagnostics, 'the node')['longest time held up [s]']) > 3.0
    assert monitor.output.count('the node was stalled for') >= 2
    assert [event['to'] for event in kit.decode_warnings(warnings)] == []


@pytest.mark.slow
def test_systemd_hears_of_start_life_and_end(
    start: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(str(tmp_path / 'notify'))
        manager.settimeout(kit.DEADLINE)
        monkeypatch.setenv('NOTIFY_SOCKET', str(tmp_path / 'notify'))
        monkeypatch.setenv('WATCHDOG_USEC', '400000')
        monitor = start(kit.node_parameters())
        assert [manager.recv(100) for _ in range(4)] == [b'READY=1', *[b'WATCHDOG=1'] * 3]
        # It is said when the node monitors, not before.
        monitor.until(lambda: 'the monitor is active' in monitor.output)
        monitor.stop()
        last = b''
        while last != b'STOPPING=1':
            last = manager.recv(100)


@pytest.mark.slow
def test_health_is_asked_of_a_running_node(host: Any, run: Any) -> None:
    monitor = host(kit.node_parameters())
    node_name = f'/{monitor.space}/stickslip_monitor'

    def health(*arguments: str) -> tuple[int, str]:
        program = run(
            *(sys.executable, '-m', 'stickslip_monitor', 'health', '--timeout', '60'),
            *('--diagnostics', f'/{monitor.space}/diagnostics', *arguments),
        )
        monitor.peer.until(lambda: not program.alive, 'the answer', 90.0)
        return program.wait(), program.output

    assert health('--node', node_name) == (0, f'{node_name}: Monitoring.\n')
    # Without a name it is the only one that is heard, whatever its namespace.
    monitor.node.report_exception(ValueError('odd'))
    code, text = health()
    assert code == 1
    assert re.fullmatch(rf'{node_name}: 1 callback failed, last at [\d:]+ UTC: ValueError: odd\n', text)
    assert_refused(
        run('env', 'ROS_DOMAIN_ID=x', sys.executable, '-m', 'stickslip_monitor', 'health'),
        'ROS cannot be started: failed to initialize rcl: ROS_DOMAIN_ID is not an integral number',
    )


@pytest.mark.parametrize(
    ('name', 'nodes', 'expected'),
    [
        ('port/monitor', {'/port/monitor': (0, 'Monitoring.')}, 0),
        (None, {'/port/monitor': (1, 'Not monitoring: the node is not active.')}, 1),
        ('other', {'/monitor': (0, '')}, 'no message from /other within 0.01 s; running: /mon'),
        (None, {}, 'no message from a monitor within 0.01 s'),
        (None, {'/a': (0, ''), '/b': (0, '')}, 'several monitors run: choose one of /a, /b'),
    ],
)
def test_exit_code_of_health(
    name: str | None, nodes: dict[str, Any], expected: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    from stickslip_monitor.commands import health
    from stickslip_monitor.ros import other_nodes

    @contextmanager
    def receive(diagnostics: str, take: Any) -> Any:
        for node_name, (level, text) in nodes.items():
            take(node_name, level, text)
        yield

    monkeypatch.setattr(other_nodes, 'receive_health', receive)
    monkeypatch.setattr(health, 'ALONE', 0.0)
    args: Any = SimpleNamespace(node=name, timeout=0.01, diagnostics='/diagnostics', page=None)
    if isinstance(expected, int):
        assert health.run(args) == expected
        return
    with pytest.raises(RosError, match=f'^{expected}'):
        health.run(args)


@pytest.mark.parametrize('unit', UNITS, ids=lambda unit: unit.stem)
def test_the_units_are_such_as_systemd_takes(unit: Path, tmp_path: Path) -> None:
    """Verify them with the program where this environment has it; little is left open to the service."""
    analyze = shutil.which('systemd-analyze')
    if analyze is None:
        pytest.skip('systemd is not installed')
    installed, text = tmp_path / unit.name, unit.read_text('utf-8')
    installed.write_text(text.replace('/opt/stickslip_monitor/bin', sysconfig.get_path('scripts')))
    completed = subprocess.run(
        [analyze, 'verify', '--man=no', installed], capture_output=True, text=True, check=False
    )
    assert (completed.returncode, completed.stdout + completed.stderr) == (0, '')
    safe = [analyze, 'security', '--offline=true', '--threshold=20', installed]
    assert subprocess.run(safe, capture_output=True, check=False).returncode == 0


@pytest.mark.parametrize('unit', UNITS, ids=lambda unit: unit.stem)
def test_the_units_do_with_the_systemd_of_ubuntu_22_04(unit: Path) -> None:
    """Version 249 passes an unknown specifier on as it stands (`%d` is of 251); these are older."""
    assert set(re.findall('%.', unit.read_text('utf-8'))) <= {'%N', '%S', '%C', '%L'}
    assert 'version 247 or later' in unit.read_text('utf-8')


@pytest.mark.slow
def test_a_node_that_asks_for_security_has_it_or_does_not_start(
    start: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Refuse to start without keys, where ROS 2 would go on without any security."""
    monkeypatch.setenv('ROS_SECURITY_ENABLE', 'true')
    for keystore, text in (
        ('', 'ROS_SECURITY_ENABLE is true, but ROS_SECURITY_KEYSTORE names no keystore'),
        (str(tmp_path), f"SECURITY ERROR: directory '{tmp_path}/enclaves' does not exist."),
    ):
        monkeypatch.setenv('ROS_SECURITY_KEYSTORE', keystore)
        assert_refused(start(kit.node_parameters()), text)


def test_the_executor_can_be_chosen(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(node.EXECUTOR, 'single')
    monkeypatch.setattr(node, 'SingleThreadedExecutor', lambda: 'the common one')
    assert node.make_executor() == 'the common one'
    monkeypatch.setenv(node.EXECUTOR, 'odd')
    with pytest.raises(ConfigurationError, match="EXECUTOR = 'odd' must be events or single"):
        node.make_executor()


def test_the_security_policy_covers_all_topics_and_services(host: Any) -> None:
    """DDS matches the names of permissions as fnmatch does (DDS-Security 9.4.1.3.2.3)."""
    policy = ROOT / 'launch_configs' / 'security' / 'policy.xml'
    parser = ElementTree.XMLParser(target=ElementTree.TreeBuilder(insert_comments=True))
    (enclaves,) = ElementTree.parse(policy, parser).getroot()
    # sros2 makes an enclave of whatever stands there, a comment too.
    assert [enclave.tag for enclave in enclaves] == ['enclave'] * 3
    (profile,) = enclaves[0].iter('profile')
    name = profile.attrib['node']
    monitor = host(kit.node_parameters())
    node = monitor.peer.node
    space = f'/{monitor.space}'

    def allowed(kind: str, rule: str) -> list[str]:
        groups = (group for group in profile if group.get(rule) == 'ALLOW')
        return [
            str(item.text).replace('~', f'{space}/{name}') for group in groups for item in group.iter(kind)
        ]

    inputs = [monitor.input(topic) for topic in ('shaft/speed', 'aft/load')]
    for kind, rule, names in (
        ('topic', 'publish', node.get_publisher_names_and_types_by_node),
        ('topic', 'subscribe', node.get_subscriber_names_and_types_by_node),
        ('service', 'reply', node.get_service_names_and_types_by_node),
    ):
        patterns = [*allowed(kind, rule), f'{space}/diagnostics', f'{space}/clock', *inputs]
        topics = [topic for topic, _ in names(name, space)]
        assert len(topics) >= 3
        assert [t for t in topics if not any(fnmatchcase(t, p) for p in patterns)] == []


def test_a_double_of_the_node_is_noticed(host: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    import rclpy

    monkeypatch.setattr('stickslip_monitor.ros.node_loop._DOUBLE_LOOKS', 1)
    monitor = host(kit.node_parameters())
    diagnostics = monitor.diagnostics()
    double = rclpy.create_node('stickslip_monitor', namespace=monitor.space)
    try:
        monitor.peer.until(
            lambda: (
                'Another node has the same full name'
                in kit.latest_status(diagnostics, 'the node').get('message', '')
            ),
            'the word of the double',
        )
    finally:
        double.destroy_node()


def test_a_second_publisher_of_the_clock_is_named(host: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    from rosgraph_msgs.msg import Clock

    monkeypatch.setattr('stickslip_monitor.ros.node_loop._DOUBLE_LOOKS', 1)
    monitor = host(kit.node_parameters(use_sim_time=True))
    diagnostics = monitor.diagnostics()
    for _ in range(2):
        monitor.peer.talk(Clock, monitor.input('clock'))
    node_name = f'/{monitor.peer.node.get_name()}'
    text = f'Several nodes publish /clock, so time jumps to and fro: {node_name}, {node_name}.'
    monitor.peer.until(
        lambda: text in kit.latest_status(diagnostics, 'the node').get('message', ''), 'both names'
    )
