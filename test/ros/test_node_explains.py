# SPDX-License-Identifier: Apache-2.0
"""What the node says of inputs that bring nothing, and of what is done to it."""

from __future__ import annotations

import json
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest

pytest.importorskip('rclpy', reason='ROS 2 is not installed')

FLOAT = 'std_msgs/msg/Float64'


def bearings(kit: Any) -> dict[str, Any]:
    """A bearing for each fault of its speed; the load of all is fine."""
    values: dict[str, Any] = {
        'bearings': ['silent', 'nobody', 'wrong', 'mixed', 'apart', 'absurd']
    }
    for name in values['bearings']:
        own = kit.parameters({'speed.topic': f'{name}/speed', 'friction.speed': None})
        values |= {key.replace('aft', name, 1): v for key, v in own.items() if key != 'bearings'}
    return values | {
        f'apart.{key}': value
        for key, value in {
            'speed.type': 'sensor_msgs/msg/JointState',
            'speed.field': 'velocity[0]',
        }.items()
    }


def test_inputs_that_bring_nothing_are_explained(start: Any, kit: Any) -> None:
    from sensor_msgs.msg import JointState
    from std_msgs.msg import Float32, Float64, String

    # The file has a null, as 'ros2 param dump' writes it.
    monitor = start(bearings(kit))
    peer, diagnostics = monitor.peer, monitor.diagnostics()
    alarms = peer.listen(String, monitor.name('alarms'), latched=True)
    node, topic = f'/{peer.node.get_name()}', monitor.input

    def talk(kind: Any, name: str) -> Any:
        return peer.talk(kind, topic(name), wait=False)

    load = talk(Float64, 'aft/load')
    talk(Float64, 'silent/speed')
    talk(Float32, 'wrong/speed')
    mixed = [talk(Float64, 'mixed/speed') for _ in range(2)]
    apart, absurd = talk(JointState, 'apart/speed'), talk(Float64, 'absurd/speed')
    expected = {
        'silent': f'{node} publishes on {topic("silent/speed")}, but nothing arrives.',
        'nobody': f'Nobody publishes on {topic("nobody/speed")}.',
        'wrong': (
            f'{node} publishes std_msgs/msg/Float32 on {topic("wrong/speed")}, but {FLOAT} is'
            ' configured.'
        ),
        'mixed': f'2 publishers send on {topic("mixed/speed")} ({node}): their values are mixed.',
        'apart': f'Stamps on {topic("apart/speed")} are 100 s behind those on',
        'absurd': f'Every sample on {topic("absurd/speed")} is refused: not a finite number.',
    }

    def told() -> dict[str, str]:
        load.publish(Float64(data=1000.0))
        mixed[0].publish(Float64(data=60.0))
        absurd.publish(Float64(data=float('nan')))
        message = JointState(velocity=[60.0])
        message.header.stamp = peer.node.get_clock().now().to_msg()
        message.header.stamp.sec -= 100
        apart.publish(message)
        peer.spin(0.05)
        return {name: kit.status(diagnostics, name).get('speed fault', '') for name in expected}

    peer.until(
        lambda: all(told()[name].startswith(text) for name, text in expected.items()),
        f'{expected}',
    )
    mixed_status = kit.status(diagnostics, 'mixed')
    assert (mixed_status['level'], mixed_status['reason']) == (b'\x01', 'normal')
    assert expected['mixed'] in mixed_status['message']
    for name, text in expected.items():
        assert f'{name}: {text}' in monitor.output
    notes = [note for message in alarms for note in json.loads(message.data)['notes']]
    assert {'time', 'what', 'text'} == set(notes[0])
    assert f'nobody: {expected["nobody"]}' in [n['text'] for n in notes if n['what'] == 'input']


def test_no_clock_is_an_alarm(start: Any, kit: Any) -> None:
    values = kit.parameters({'speed.timeout': 1.0, 'load.timeout': 1.0})
    monitor = start(values, '-p', 'use_sim_time:=true')
    warnings = monitor.warnings()
    monitor.peer.until(lambda: warnings, 'the loss')
    (event,) = kit.events(warnings)
    assert event['to'] == 'input_stale'
    assert event['text'].endswith(
        'use_sim_time is set, but nothing comes on /clock: no sample can be used.'
    )


def test_changes_are_on_record(start: Any, kit: Any) -> None:
    from std_msgs.msg import String

    monitor = start(kit.parameters(kit.STAMPED))
    peer = monitor.peer
    alarms = peer.listen(String, monitor.name('alarms'), latched=True)
    assert monitor.set(aft__alarm__on_delay=3.0) == [(True, '')]
    assert monitor.set(aft__alarm__on_delay=3.0) == [(True, '')]
    assert monitor.change_state(4)

    def notes() -> list[tuple[str, str]]:
        said = (note for m in alarms for note in json.loads(m.data)['notes'])
        return [(note['what'], note['text']) for note in said]

    expected = [
        ('lifecycle', 'the monitor is configured, inactive'),
        ('lifecycle', 'the monitor is active'),
        ('parameter', 'parameter aft.alarm.on_delay: 0.5 -> 3.0'),
        ('lifecycle', 'the monitor is inactive: the bearings are not monitored'),
    ]
    peer.until(lambda: len(notes()) >= len(expected), f'{expected}, not {notes()}')
    assert [note for note in notes() if note[0] != 'input'] == expected
    for _, text in expected:
        assert text in monitor.output
    topic = monitor.input('shaft')
    assert f'aft: speed in rpm from {topic} ({kit.JOINT}, velocity[0])' in monitor.output


@pytest.mark.parametrize(
    ('name', 'value', 'text'),
    [
        (
            'ROS_SECURITY_ENABLE',
            'true',
            'ROS_SECURITY_ENABLE is true, but ROS_SECURITY_KEYSTORE names no keystore',
        ),
        ('ROS_DOMAIN_ID', '233', "ROS_DOMAIN_ID = '233' must be 0 to 232"),
        ('ROS_DOMAIN_ID', 'ship', "ROS_DOMAIN_ID = 'ship' must be 0 to 232"),
    ],
)
def test_an_environment_that_ros_would_ignore_or_die_of_is_refused(
    name: str, value: str, text: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    from stickslip_monitor.errors import RosError
    from stickslip_monitor.ros import run as node

    monkeypatch.delenv('ROS_SECURITY_KEYSTORE', raising=False)
    monkeypatch.setenv(name, value)
    with pytest.raises(RosError, match=f'^{text}$'):
        node._check_environment([])


@pytest.mark.parametrize(
    ('arguments', 'enclave'),
    [((), '/'), (('-e', '/other'), '/other'), (('--enclave', '/stickslip_monitor'), '')],
)
def test_security_without_the_nodes_own_keys_is_refused(
    arguments: tuple[str, ...], enclave: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Unless told to enforce it, ROS 2 goes on without any security then."""
    from stickslip_monitor.errors import RosError
    from stickslip_monitor.ros import run as node

    own = tmp_path / 'enclaves' / 'stickslip_monitor'
    own.mkdir(parents=True)
    (own / 'cert.pem').touch()
    monkeypatch.setenv('ROS_SECURITY_ENABLE', 'true')
    monkeypatch.setenv('ROS_SECURITY_KEYSTORE', str(tmp_path))
    monkeypatch.delenv('ROS_SECURITY_ENCLAVE_OVERRIDE', raising=False)
    if not enclave:
        node._check_environment(['--ros-args', *arguments])
        return
    with pytest.raises(RosError, match=f"has no enclave '{enclave}'$"):
        node._check_environment(['--ros-args', *arguments])


def test_a_name_that_is_too_long_is_refused(start: Any, kit: Any) -> None:
    monitor = start(kit.parameters(), '-r', f'__node:={"n" * 300}')
    assert monitor.wait() == 2
    assert monitor.output.splitlines() == [
        'ERROR: the node cannot be created: error creating node: invalid node name: node name'
        " length should not exceed '255'"
    ]


def test_a_callback_that_fails_is_told_and_survived() -> None:
    from types import SimpleNamespace

    from stickslip_monitor.monitor.health import NodeHealth
    from stickslip_monitor.ros.node import MonitorNode

    logged: list[str] = []
    node: Any = MonitorNode.__new__(MonitorNode)
    node.health = NodeHealth(monitoring=True)
    node.get_logger = lambda: SimpleNamespace(error=lambda text, **_: logged.append(text))

    def fails(message: object) -> None:
        raise ZeroDivisionError('float division by zero')

    assert node.survived(fails)('message') is None
    assert node.health.level == 2
    assert node.health.message.startswith(
        '1 callback failed, last: ZeroDivisionError: float division by zero (test_node_explains'
    )
    assert logged[0].startswith('a callback failed and is survived: ZeroDivisionError')


def test_the_security_policy_covers_all_topics_and_services(start: Any, kit: Any) -> None:
    """DDS matches the names of permissions as fnmatch does (DDS-Security 9.4.1.3.2.3)."""
    policy = Path(__file__).parents[2] / 'launch_configs' / 'security' / 'policy.xml'
    parser = ElementTree.XMLParser(target=ElementTree.TreeBuilder(insert_comments=True))
    (enclaves,) = ElementTree.parse(policy, parser).getroot()
    # sros2 makes an enclave of whatever stands there, a comment too.
    assert [each.tag for each in enclaves] == ['enclave'] * 3
    enclave = enclaves[0]
    (profile,) = enclave.iter('profile')
    name = profile.attrib['node']
    monitor = start(kit.parameters())
    node = monitor.peer.node
    monitor.state()
    there = (name, f'/{monitor.space}')
    monitor.peer.until(lambda: there in node.get_node_names_and_namespaces(), 'the node')

    def allowed(kind: str, rule: str) -> list[str]:
        groups = (group for group in profile if group.get(rule) == 'ALLOW')
        return [
            str(item.text).replace('~', f'/{monitor.space}/{name}')
            for group in groups
            for item in group.iter(kind)
        ]

    inputs = [monitor.input(topic) for topic in ('shaft/speed', 'aft/load')]
    own = f'/{monitor.space}/'
    for kind, rule, names in (
        ('topic', 'publish', node.get_publisher_names_and_types_by_node(name, own[:-1])),
        ('topic', 'subscribe', node.get_subscriber_names_and_types_by_node(name, own[:-1])),
        ('service', 'reply', node.get_service_names_and_types_by_node(name, own[:-1])),
    ):
        patterns = [*allowed(kind, rule), f'{own}diagnostics', *inputs]
        found = [topic for topic, _ in names]
        assert len(found) >= 3
        assert [t for t in found if not any(fnmatchcase(t, p) for p in patterns)] == []
