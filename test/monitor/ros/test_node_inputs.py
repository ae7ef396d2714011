# SPDX-License-Identifier: Apache-2.0
"""What the node makes of what comes, and what it says of inputs that bring nothing."""

from __future__ import annotations

import json
import math
import struct
import sys
from typing import Any

import kit
import pytest

pytest.importorskip('rclpy', reason='ROS 2 is not installed')


def test_garbage_is_counted_named_and_never_evaluated(host: Any) -> None:
    monitor = host(kit.stamped_parameters({'load.minimum': -100.0}))
    diagnostics, warnings = monitor.diagnostics(), monitor.warnings()
    telemetry = kit.Telemetry(monitor)
    peer, good, rounds = monitor.peer, telemetry.now, 20
    counts = {name: len(messages) for name, messages in telemetry.received.items()}
    for _ in range(rounds):
        telemetry.send(math.nan, -math.inf, good + 0.1)
        telemetry.send(math.inf, math.nan, good + 0.1)
        telemetry.send(1e9, -1e9, good + 0.1)
        telemetry.send(60.0, 1000.0, good)  # the last good sample once more
        telemetry.send(-999.25, 65535.0, good + 0.1)  # senders' ways to say that there is no value
        telemetry.send(20.0, 1000.0, good - 0.05)  # older than that, but within the timeout
        telemetry.send(None, None, good + 0.1)  # arrays too short
        telemetry.send(1.79e308, 1.79e308, good + 0.1)
        peer.spin(0.001)
    expected = {
        f'{quantity} samples {name}': str(count * rounds)
        for quantity in ('speed', 'load')
        for name, count in (
            ('not finite', 3),
            ('implausible', 1),
            ('no value', 2),
            ('repeated', 1),
            ('out of order', 1),
        )
    }
    peer.until(lambda: expected.items() <= kit.latest_status(diagnostics).items(), f'counts {expected}')
    assert {name: len(messages) for name, messages in telemetry.received.items()} == counts
    assert not warnings
    assert telemetry.step(20.0, 1000.0)['regime'] == 'unstable'
    assert telemetry.step(-60.0, 1000.0)['regime'] == 'stable'  # astern
    assert telemetry.step(20.0, -50.0)['regime'] == 'stable'  # no contact


def test_of_messages_that_wait_all_are_evaluated_and_the_last_is_answered(host: Any) -> None:
    # While the node is busy, messages pile up in its queue; of a flood some are left out.
    from stickslip_monitor.ros.inputs import MAX_ANSWERED, MAX_WAITING

    monitor = host(kit.stamped_parameters())
    diagnostics = monitor.diagnostics()
    telemetry = kit.Telemetry(monitor)
    telemetry.step(61.0, 1000.0)
    peer, key = monitor.peer, 'speed samples accepted'
    peer.until(lambda: kit.latest_status(diagnostics).get('shaft speed [rpm]') == '61', 'diagnostics')
    answers = telemetry.received['hopf_margin']

    def taken() -> int:
        return int(monitor.node._configured.session.monitor.bearings['aft'].counts[0][0])

    accepted, answered, count = taken(), len(answers), 10 * MAX_ANSWERED
    for i in range(count):
        telemetry.send(60.0 + 0.01 * i, 1000.0)
    telemetry.send(math.nan, math.nan)
    peer.until(lambda: taken() == accepted + count, f'{count} samples')
    last = pytest.approx((60.0 + 0.01 * (count - 1)) / 30.7380 - 1.0, abs=1e-5)
    peer.until(lambda: len(answers) > answered and answers[-1].data == last, 'an answer to the last')
    # One by one there are two answers to each; what comes in few pieces may be answered so.
    assert len(answers) - answered < count

    for _ in range(MAX_WAITING + 500):
        telemetry.send(60.0, 1000.0)

    def left_out() -> int:
        return int(kit.latest_status(diagnostics, 'the node').get('messages left out', 0))

    peer.until(left_out, 'the flood')
    peer.until(lambda: taken() + left_out() == accepted + count + MAX_WAITING + 500, 'every message counted')
    peer.until(lambda: kit.latest_status(diagnostics, 'the node')['level'] == b'\x01', 'a warning')
    assert int(kit.latest_status(diagnostics)[key]) > accepted


def test_inputs_that_bring_nothing_are_explained(host: Any) -> None:
    """Start one bearing for each fault of its speed; the load of all is fine."""
    import rclpy
    from std_msgs.msg import Float32, Float64

    names = ['silent', 'nobody', 'wrong', 'mixed']
    values: dict[str, Any] = {'bearings': names}
    # Null in a file, as 'ros2 param dump' writes it, comes as one of these words.
    for name, null in zip(names, ('null', 'Null', 'NULL', '~'), strict=True):
        bearing_values = kit.node_parameters({'speed.topic': f'{name}/speed', 'friction.speed': null})
        values |= {key.replace('aft', name, 1): v for key, v in bearing_values.items() if key != 'bearings'}
    monitor = host(values)
    peer, diagnostics = monitor.peer, monitor.diagnostics()
    alarms = monitor.listen('alarms', latched=True)
    node, topic = f'/{peer.node.get_name()}', monitor.input

    def talk(kind: Any, name: str) -> Any:
        return peer.talk(kind, topic(name), wait=False)

    load = talk(Float64, 'aft/load')
    talk(Float64, 'silent/speed')
    # One participant publishes one type on a topic: another brings the wrong one.
    context = rclpy.Context()
    rclpy.init(args=[], context=context)
    other_node = rclpy.create_node('other', context=context)
    other_node.create_publisher(Float32, topic('wrong/speed'), 10)
    mixed = [talk(Float64, 'mixed/speed') for _ in range(2)]
    expected = {
        'silent': f'{node} publishes on {topic("silent/speed")}, but nothing arrives.',
        'nobody': f'No publisher on {topic("nobody/speed")}.',
        'wrong': (
            f'/other publishes std_msgs/msg/Float32 on {topic("wrong/speed")}, but'
            ' std_msgs/msg/Float64 is configured.'
        ),
        'mixed': f'2 publishers send on {topic("mixed/speed")} ({node}): their values are mixed.',
    }

    def faults() -> dict[str, str]:
        load.publish(Float64(data=1000.0))
        for publisher in mixed:
            publisher.publish(Float64(data=60.0))
        peer.spin(0.05)
        return {name: kit.latest_status(diagnostics, name).get('speed fault', '') for name in expected}

    peer.until(lambda: all(faults()[name].startswith(text) for name, text in expected.items()), f'{expected}')
    mixed_status = kit.latest_status(diagnostics, 'mixed')
    assert (mixed_status['level'], mixed_status['reason']) == (b'\x01', 'normal')
    assert expected['mixed'] in mixed_status['message']
    for name, text in expected.items():
        assert f'{name}: {text}' in monitor.output

    def noted() -> list[str]:
        notes = [note for message in alarms for note in json.loads(message.data)['notes']]
        return [note['text'] for note in notes if note['what'] == 'input']

    peer.until(lambda: f'nobody: {expected["nobody"]}' in noted(), 'the notes')
    other_node.destroy_node()
    rclpy.shutdown(context=context)


def test_messages_of_another_definition_are_reported(host: Any) -> None:
    """Announce fifty numbers and send one (CDR: four bytes of head, then the fields)."""
    from std_msgs.msg import Float64MultiArray

    kind = 'std_msgs/msg/Float64MultiArray'
    load = {'load.type': kind, 'load.field': 'data[0]', 'load.timeout': 1.0}
    monitor = host(kit.node_parameters(load))
    peer, diagnostics = monitor.peer, monitor.diagnostics()
    talk = peer.talk(Float64MultiArray, monitor.input('aft/load'))
    wrong = b'\0\1\0\0' + struct.pack('<IIIId', 0, 0, 50, 0, 1.0)

    def is_reported() -> bool:
        talk.publish(wrong)
        text = f'cannot be decoded: its sender has another definition of {kind}'
        return text in kit.latest_status(diagnostics).get('load fault', '')

    peer.until(is_reported, 'the fault')


def test_a_publisher_that_has_gone_is_named_once(host: Any) -> None:
    from std_msgs.msg import Float64

    monitor = host(kit.node_parameters({'speed.timeout': 1.0}))
    peer, diagnostics = monitor.peer, monitor.diagnostics()
    load, speed = monitor.talk('aft/load'), peer.talk(Float64, monitor.input('shaft/speed'))
    sent: list[Any] = [load]

    def published(key: str, text: str) -> Any:
        def check() -> bool:
            for publish in sent:
                publish(60.0)
            peer.spin(0.05)
            return kit.latest_status(diagnostics).get(key, '').startswith(text)

        return check

    # The graph is looked at while an input is not there.
    peer.until(published('speed fault', f'/{peer.node.get_name()} publishes on'), 'silence')
    sent.append(lambda value: speed.publish(Float64(data=value)))
    peer.until(published('reason', 'normal'), 'a quiet bearing')
    sent.pop()
    peer.node.destroy_publisher(speed)
    peer.until(published('message', 'aft: Input speed lost'), 'the loss')
    topic, name = monitor.input('shaft/speed'), f'/{peer.node.get_name()}'
    text = f'No publisher on {topic}: {name}, which published on it, has gone.'
    peer.until(published('speed fault', text), 'who has gone')
    assert kit.latest_status(diagnostics)['message'].count(text) == 1


SENDER = """
import sys, rclpy
from std_msgs.msg import Float64
rclpy.init(args=[])
node = rclpy.create_node('meter')
publisher = node.create_publisher(Float64, sys.argv[1], 10)
node.create_timer(0.05, lambda: publisher.publish(Float64(data=60.0)))
rclpy.spin(node)
"""


def test_a_sender_that_was_killed_and_came_back_is_one(host: Any, run: Any) -> None:
    """Kill a sender: DDS has it in the graph for its lease of 20 s."""
    monitor = host(kit.node_parameters())
    peer, topic = monitor.peer, monitor.input('shaft/speed')
    # Without shared memory, which a killed program leaves behind.
    sender = ('env', 'FASTDDS_BUILTIN_TRANSPORTS=UDPv4', sys.executable, '-c', SENDER, topic)

    def sending() -> list[bool]:
        return sorted(
            publisher.sends for publisher in monitor.node._configured.graph.publishers(topic, 'aft', 0)
        )

    first = run(*sender)
    peer.until(lambda: sending() == [True], 'a sender')
    first.process.kill()
    first.wait()
    run(*sender)
    peer.until(lambda: sending() == [False, True], 'the ghost, and the sender')


@pytest.mark.parametrize(
    ('load', 'text'),
    [
        ({'constant': 30}, 'Now 60 rpm, 30 kN (assumed)'),
        ({'over_speed': [0.0, 32.0, 120.0, 28.0]}, 'Now 60 rpm, 30 kN (from the alignment table)'),
    ],
)
def test_an_assumed_load_and_a_speed_by_its_name(host: Any, load: dict[str, Any], text: str) -> None:
    # The load comes with the speed, whose place in the message changes.
    from sensor_msgs.msg import JointState

    speed = {name: value for name, value in kit.STAMPED.items() if not name.startswith('load.')}
    values = kit.node_parameters(speed | {'speed.field': 'velocity[shaft]', 'load.unit': 'kN'})
    del values['aft.load.topic']
    monitor = host(values | {f'aft.load.{name}': value for name, value in load.items()})
    diagnostics = monitor.diagnostics()
    shaft = monitor.peer.talk(JointState, monitor.input('shaft'))
    for names in (['rudder', 'shaft'], ['shaft', 'rudder'], ['rudder']):
        velocity = [60.0 if name == 'shaft' else 3.0 for name in names]
        shaft.publish(JointState(name=names, velocity=velocity))
    expected = {
        'speed samples accepted': '2',
        'speed samples not finite': '0',  # a message that names others is not for it
        'shaft speed [rpm]': '60',
        'load [N]': '30000',
    }
    monitor.peer.until(lambda: expected.items() <= kit.latest_status(diagnostics).items(), f'{expected}')
    assert text in kit.latest_status(diagnostics)['message']
    assert 'load in kN from' not in monitor.output


def test_the_water_is_measured_and_its_silence_reported(host: Any) -> None:
    values = {'friction.at_temperature': 15.0, 'water_temperature.topic': 'water'}
    monitor = host(kit.node_parameters(values | {'water_temperature.timeout': 1.0}))
    peer, diagnostics = monitor.peer, monitor.diagnostics()
    speed, load, water = (monitor.talk(topic) for topic in ('shaft/speed', 'aft/load', 'water'))

    def told(text: str) -> Any:
        def check() -> bool:
            load(1000.0)
            speed(200.0)
            peer.spin(0.05)
            return text in kit.latest_status(diagnostics).get('message', '')

        return check

    peer.until(told('water at 15 C (not measured yet, as where friction was measured)'), 'no temperature')
    water(5.0)
    peer.until(told('water at 5 C (not measured for'), 'its silence')
    assert kit.latest_status(diagnostics)['water_temperature samples accepted'] == '1'
    assert 'water_temperature in C from' in monitor.output


def test_only_a_joint_name_that_no_message_has_is_a_fault(host: Any) -> None:
    """Publish as on ``/joint_states``, where each controller publishes its own joints."""
    from sensor_msgs.msg import JointState

    speed = {name: value for name, value in kit.STAMPED.items() if not name.startswith('load.')}
    values = kit.node_parameters(
        speed | {'speed.field': 'velocity[shaft]', 'load.unit': 'kN', 'load.constant': 30}
    )
    del values['aft.load.topic']
    values |= {name.replace('aft', 'fore', 1): value for name, value in values.items() if name != 'bearings'}
    monitor = host(values | {'bearings': ['aft', 'fore'], 'fore.speed.field': 'velocity[shfat]'})
    diagnostics, peer, rudder = monitor.diagnostics(), monitor.peer, kit.Peer('rudder')
    try:
        talk = [node.talk(JointState, monitor.input('shaft')) for node in (peer, rudder)]
        fault = f"No message on {monitor.input('shaft')} names 'shfat': they name rudder, shaft."

        def is_reported() -> bool:
            for publisher, name in zip(talk, ('shaft', 'rudder'), strict=True):
                publisher.publish(JointState(name=[name], velocity=[60.0 if name == 'shaft' else 0.01]))
            peer.spin(0.05)
            return kit.latest_status(diagnostics, 'fore').get('speed fault') == fault

        peer.until(is_reported, fault)
        aft = kit.latest_status(diagnostics)
        assert (aft['level'], aft['reason'], aft['shaft speed [rpm]']) == (b'\x00', 'normal', '60')
        assert 'speed fault' not in aft
        assert not any(line.startswith('[warning] aft') and '/shaft' in line for line in monitor.log.lines)
    finally:
        rudder.node.destroy_node()
