# SPDX-License-Identifier: Apache-2.0
"""The third input of the node: measured vibration."""

from __future__ import annotations

from typing import Any

import pytest

pytest.importorskip('rclpy', reason='ROS 2 is not installed')

LEVEL = {'level.topic': 'shaft', 'level.field': 'position[0]', 'level.threshold': 1.0}


@pytest.mark.slow
def test_vibration_in_the_bistable_range_is_told(start: Any, kit: Any) -> None:
    from sensor_msgs.msg import JointState
    from std_msgs.msg import String

    own = LEVEL | {'level.type': kit.JOINT, 'level.timeout': 1000.0}
    monitor = start(kit.parameters(kit.STAMPED, own))
    warnings, diagnostics = monitor.warnings(), monitor.diagnostics()
    peer = monitor.peer
    measured = peer.listen(String, monitor.name('aft/measured'))
    publisher = peer.talk(JointState, monitor.input('shaft'))
    peer.until(lambda: peer.node.count_publishers(monitor.name('aft/measured')), 'the node')

    def send(tenths: int, level: float) -> None:
        message = JointState(velocity=[36.0], effort=[1000.0], position=[level])
        nanoseconds = kit.T0 + tenths * kit.SECOND // 10
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(nanoseconds, kit.SECOND)
        publisher.publish(message)
        peer.spin(0.02)

    for tenths in range(50):
        send(tenths, 0.1 + 0.001 * (tenths % 7))
    peer.until(lambda: {m.data for m in measured} >= {'quiet'}, 'quiet')
    for tenths in range(50, 100):
        send(tenths, 5.0 + 0.1 * (tenths % 7))
    peer.until(lambda: measured[-1].data == 'vibrating', 'vibrating')
    told = peer.until(
        lambda: [e for e in kit.events(warnings) if e['to'] == 'stick_slip'], 'the warning'
    )
    assert told[0]['measured'] == 'vibrating'
    assert 'vibration is measured' in told[0]['text']
    # Best effort may lose a sample on a busy machine.
    peer.until(
        lambda: (
            (status := kit.status(diagnostics)).get('measured') == 'vibrating'
            and int(status['level samples accepted']) > 90
        ),
        'diagnostics',
    )
