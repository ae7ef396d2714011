# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import math
import signal
from typing import Any

import numpy as np
import pytest

from stickslip_monitor import assess, build_config

pytest.importorskip('rclpy', reason='ROS 2 is not installed')

SLOW = {'speed.timeout': 100.0, 'load.timeout': 100.0}


def stamped(message: Any, kit: Any, seconds: float) -> Any:
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(
        kit.T0 + round(seconds * kit.SECOND), kit.SECOND
    )
    return message


def test_garbage_is_counted_named_and_never_evaluated(start: Any, kit: Any) -> None:
    monitor = start(kit.parameters(kit.STAMPED))
    diagnostics, warnings = monitor.diagnostics(), monitor.warnings()
    telemetry = kit.Telemetry(monitor)
    telemetry.step(60.0, 1000.0, 10.0)
    peer = monitor.peer
    peer.until(lambda: kit.status(diagnostics).get('regime') == 'stable', 'diagnostics')
    before = {name: len(heard) for name, heard in telemetry.heard.items()}
    rounds = 40
    for i in range(rounds):
        telemetry.send(math.nan, -math.inf, 11.0 + i)
        telemetry.send(math.inf, math.nan, 11.2 + i)
        telemetry.send(1e300, -1e300, 11.4 + i)
        telemetry.send(20.0, 1000.0, 10.0)  # the stamp of the last good sample
        telemetry.send(20.0, 1000.0, 9.0)  # older than that, but within the timeout
        telemetry.send(None, None, 11.6 + i)  # arrays too short
        telemetry.send(1.79e308, 1.79e308, 11.8 + i)
    expected = {
        f'{quantity} samples {name}': str(count * rounds)
        for quantity in ('speed', 'load')
        for name, count in (
            ('not finite', 3),
            ('implausible', 2),
            ('repeated', 1),
            ('out of order', 1),
            ('clock jump', 0),
        )
    }
    peer.until(
        lambda: expected.items() <= kit.status(diagnostics).items(),
        f'counts {expected}, not {kit.status(diagnostics)}',
    )
    assert {name: len(heard) for name, heard in telemetry.heard.items()} == before
    assert not warnings
    answer = telemetry.step(20.0, 1000.0, 100.0)
    assert answer['regime'] == 'unstable'
    assert telemetry.step(-60.0, 1000.0, 101.0)['regime'] == 'stable'  # astern
    assert telemetry.step(20.0, -50.0, 102.0)['regime'] == 'stable'  # no contact
    assert monitor.alive


def test_one_topic_feeds_two_bearings(start: Any, kit: Any) -> None:
    from std_msgs.msg import Float64

    values = kit.parameters(SLOW, {'alarm.on_delay': 0.0, 'alarm.onset_growth': 0.0})
    values |= {key.replace('aft', 'fwd', 1): v for key, v in values.items() if key[:4] == 'aft.'}
    values |= {'bearings': ['aft', 'fwd'], 'fwd.load.topic': 'fwd/load'}
    monitor = start(values)
    peer, warnings, diagnostics = monitor.peer, monitor.warnings(), monitor.diagnostics()
    regimes = {
        name: peer.listen(type_string(), monitor.name(f'{name}/regime')) for name in ('aft', 'fwd')
    }
    publishers = {
        name: peer.talk(Float64, monitor.input(name))
        for name in ('shaft/speed', 'aft/load', 'fwd/load')
    }

    def answered() -> bool:
        for name, value in (('shaft/speed', 20.0), ('aft/load', 100.0), ('fwd/load', 1000.0)):
            publishers[name].publish(Float64(data=value))
        peer.spin(0.05)
        return all(regimes.values())

    peer.until(answered, 'both regimes')
    assert {message.data for message in regimes['aft']} == {'stable'}
    assert {message.data for message in regimes['fwd']} == {'unstable'}
    peer.until(lambda: warnings, 'the warning')
    assert [(e['bearing'], e['to']) for e in kit.events(warnings)] == [('fwd', 'stick_slip')]
    peer.until(lambda: kit.status(diagnostics, 'fwd').get('level') == b'\x02', 'diagnostics')
    peer.until(lambda: kit.status(diagnostics, 'aft').get('level') == b'\x00', 'the other')
    speed = monitor.input('shaft/speed')
    assert peer.node.count_subscribers(speed) == 1


def type_string() -> Any:
    from std_msgs.msg import String

    return String


def test_any_numeric_field_with_the_time_of_its_header(start: Any, kit: Any) -> None:
    from geometry_msgs.msg import WrenchStamped
    from sensor_msgs.msg import JointState
    from std_msgs.msg import Float64

    values = kit.parameters(
        SLOW,
        {
            'speed.type': 'sensor_msgs/msg/JointState',
            'speed.field': 'velocity[1]',
            'speed.unit': 'rad/s',
            'load.type': 'geometry_msgs/msg/WrenchStamped',
            'load.field': 'wrench.force.z',
            'load.unit': 'kN',
            'load.scale': -1.0,
            'alarm.on_delay': 0.0,
        },
    )
    monitor = start(values)
    peer, warnings = monitor.peer, monitor.warnings()
    amplitudes = peer.listen(Float64, monitor.name('aft/amplitude'))
    speed = peer.talk(JointState, monitor.input('shaft/speed'))
    load = peer.talk(WrenchStamped, monitor.input('aft/load'))
    omega = 20.0 * 2.0 * math.pi / 60.0
    seconds = iter(range(1000))

    def answered() -> bool:
        now = next(seconds)
        message = stamped(JointState(velocity=[99.0, omega]), kit, now + 0.125)
        speed.publish(message)
        wrench = stamped(WrenchStamped(), kit, now + 0.25)
        wrench.wrench.force.z = -1.0
        load.publish(wrench)
        peer.spin(0.05)
        return bool(warnings and amplitudes)

    peer.until(answered, 'a warning')
    (event,) = kit.events(warnings)
    # The time of the event is that of a header: a quarter after, or half of that.
    assert (event['time'] - kit.T0) % kit.SECOND in (125_000_000, 250_000_000)
    assert event['time'] < kit.T0 + 1000 * kit.SECOND
    assert event['load'] == 1000.0
    bearing = build_config(values).bearing('aft').bearing
    expected = assess(bearing, omega * 0.05, 1000.0)
    assert amplitudes[-1].data == pytest.approx(expected.amplitude, rel=1e-12)


@pytest.mark.parametrize(
    ('kind', 'sent', 'rpm'),
    [('Int32', 21, 21.0), ('Float32', 20.1, float(np.float32(20.1))), ('UInt8', 200, 200.0)],
)
def test_integers_and_single_precision(
    start: Any, kit: Any, kind: str, sent: float, rpm: float
) -> None:
    import std_msgs.msg

    values = kit.parameters(
        SLOW, {'speed.type': f'std_msgs/msg/{kind}', 'load.type': 'std_msgs/msg/Byte'}
    )
    monitor = start(values)
    peer = monitor.peer
    margins = peer.listen(std_msgs.msg.Float64, monitor.name('aft/fold_margin'))
    cls = getattr(std_msgs.msg, kind)
    speed = peer.talk(cls, monitor.input('shaft/speed'))
    load = peer.talk(std_msgs.msg.Byte, monitor.input('aft/load'))

    def answered() -> bool:
        speed.publish(cls(data=sent))
        load.publish(std_msgs.msg.Byte(data=bytes([250])))
        peer.spin(0.05)
        return bool(margins)

    peer.until(answered, 'a margin')
    bearing = build_config(values).bearing('aft').bearing
    expected = assess(bearing, bearing.speed.to_surface(rpm, 'rpm'), 250.0)
    assert margins[-1].data == expected.fold_margin
    assert math.isfinite(expected.fold_margin)


@pytest.mark.slow
def test_messages_that_wait_are_all_evaluated_and_the_last_is_answered(
    start: Any, kit: Any
) -> None:
    """While the node is held, messages pile up in its queue."""
    monitor = start(kit.parameters(kit.STAMPED))
    diagnostics = monitor.diagnostics()
    telemetry = kit.Telemetry(monitor)
    telemetry.step(61.0, 1000.0, 10.0, answers=1)
    peer, key = monitor.peer, 'speed samples accepted'
    peer.until(lambda: kit.status(diagnostics).get('shaft speed [rpm]') == '61', 'diagnostics')
    before, heard = int(kit.status(diagnostics)[key]), telemetry.heard['hopf_margin']
    said = len(heard)
    monitor.process.send_signal(signal.SIGSTOP)
    for i in range(400):
        telemetry.send(60.0 + 0.01 * i, 1000.0, 11.0 + 0.01 * i)
    telemetry.send(math.nan, math.nan, 15.0)
    peer.spin(0.5)
    monitor.process.send_signal(signal.SIGCONT)
    peer.until(
        lambda: int(kit.status(diagnostics)[key]) == before + 400,
        f'400 samples, not {kit.status(diagnostics)}',
    )
    assert heard[-1].data == pytest.approx(63.99 / 30.7380 - 1.0, abs=1e-5)
    assert 1 <= len(heard) - said <= 20


def test_a_node_that_was_held_up_blames_no_input(start: Any, kit: Any) -> None:
    monitor = start(kit.parameters(kit.STAMPED, {'speed.timeout': 5.0, 'load.timeout': 5.0}))
    peer, diagnostics, warnings = monitor.peer, monitor.diagnostics(), monitor.warnings()
    telemetry = kit.Telemetry(monitor)
    seconds = iter(range(10, 1000))

    def held_up() -> bool:
        telemetry.send(60.0, 1000.0, next(seconds))
        peer.spin(0.2)
        return bool(kit.status(diagnostics, 'the node').get('times held up', '0') != '0')

    assert not held_up()
    warnings.clear()
    monitor.process.send_signal(signal.SIGSTOP)
    peer.spin(6.0)
    monitor.process.send_signal(signal.SIGCONT)
    peer.until(held_up, 'the delay')
    assert float(kit.status(diagnostics, 'the node')['longest time held up [s]']) > 5.5
    assert 'the node was held up for' in monitor.output
    assert not warnings
