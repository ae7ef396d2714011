# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import math
import signal
import statistics
import sys
from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import pytest

pytest.importorskip('rclpy', reason='ROS 2 is not installed')

AT_ONCE = {'alarm.on_delay': 0.0, 'alarm.off_delay': 0.0}
UNITS = {
    'speed [m/s]',
    'shaft speed [rpm]',
    'load [N]',
    'hopf speed [m/s]',
    'fold speed [m/s]',
    'hopf margin',
    'fold margin',
    'growth rate [1/s]',
    'amplitude [m]',
    'amplitude of the exact cycle [m]',
    'error of the amplitude',
    'threshold amplitude [m]',
    'time to boundary [s]',
    'growth [e-folds]',
    'clears in [s]',
    'raised lately',
}
TEXTS = {'reason', 'regime', 'outcome', 'stick-slip predicted'}


@pytest.mark.slow
def test_quality_of_service_of_every_topic(start: Any, kit: Any) -> None:
    monitor = start(kit.parameters(kit.STAMPED))
    monitor.warnings()
    node = monitor.peer.node
    float64, string = 'std_msgs/msg/Float64', 'std_msgs/msg/String'
    expected = {
        monitor.name('warnings'): (string, 'RELIABLE', 'TRANSIENT_LOCAL'),
        monitor.name('aft/amplitude'): (float64, 'RELIABLE', 'VOLATILE'),
        monitor.name('aft/amplitude_exact'): (float64, 'RELIABLE', 'VOLATILE'),
        monitor.name('aft/hopf_margin'): (float64, 'RELIABLE', 'VOLATILE'),
        monitor.name('aft/fold_margin'): (float64, 'RELIABLE', 'VOLATILE'),
        monitor.name('aft/regime'): (string, 'RELIABLE', 'VOLATILE'),
        f'/{monitor.space}/diagnostics': (
            'diagnostic_msgs/msg/DiagnosticArray',
            'RELIABLE',
            'VOLATILE',
        ),
    }

    def found() -> dict[str, Any]:
        return {
            topic: (
                info.topic_type,
                info.qos_profile.reliability.name,
                info.qos_profile.durability.name,
            )
            for topic in expected
            for info in node.get_publishers_info_by_topic(topic)
        }

    monitor.peer.until(lambda: found() == expected, f'{expected}, not {found()}')
    topic = monitor.input('shaft')
    monitor.peer.until(lambda: node.get_subscriptions_info_by_topic(topic), 'the subscription')
    (info,) = node.get_subscriptions_info_by_topic(topic)
    assert info.topic_type == kit.JOINT
    assert info.qos_profile.reliability.name == 'BEST_EFFORT'
    assert info.qos_profile.durability.name == 'VOLATILE'


def test_diagnostics_come_every_second_and_at_once_on_a_change(start: Any, kit: Any) -> None:
    monitor = start(kit.parameters(kit.STAMPED, AT_ONCE))
    peer, diagnostics, warnings = monitor.peer, monitor.diagnostics(), monitor.warnings()
    telemetry = kit.Telemetry(monitor)

    def steady() -> bool:
        # Messages come at their second, also while nothing arrives.
        return len(diagnostics) >= 5

    diagnostics.clear()
    peer.until(steady, 'diagnostics')
    stamps = [m.header.stamp.sec + 1e-9 * m.header.stamp.nanosec for m in diagnostics]
    gaps = [b - a for a, b in pairwise(stamps)]
    assert statistics.median(gaps) == pytest.approx(1.0, abs=0.2)

    diagnostics.clear()
    changes = 8
    for k in range(changes):
        telemetry.step(60.0 if k % 2 else 20.0, 1000.0, 10 + k)

    def reasons() -> list[str]:
        """What they said, without repetitions."""
        said = [kit.status([message])['reason'] for message in diagnostics]
        return [b for a, b in zip([None, *said], said, strict=False) if a != b]

    # All these changes happen within a few tenths of a second.
    peer.until(
        lambda: (
            len(warnings) >= changes
            and reasons()[-len(warnings) :] == [e['to'] for e in kit.events(warnings)]
        ),
        'changes',
    )

    telemetry.step(20.0, 1000.0, 100)
    peer.until(lambda: kit.status(diagnostics)['reason'] == 'stick_slip', 'stick-slip')
    record = kit.status(diagnostics)
    assert record.pop('level') == b'\x02'
    assert record.pop('name') == f'{monitor.space}/stickslip_monitor: aft'
    assert record.pop('message').startswith('aft: Stick-slip predicted. At 20 rpm and 1 kN')
    counts = {key for key in record if ' samples ' in key}
    assert len(counts) == 12
    assert set(record) == UNITS | TEXTS | counts
    assert record['regime'] == 'unstable'
    assert record['outcome'] == 'stick_slip'
    assert record['stick-slip predicted'] == 'true'
    numbers = {key: float(record[key]) for key in UNITS | counts}
    assert numbers['shaft speed [rpm]'] == 20.0
    assert numbers['speed [m/s]'] == pytest.approx(math.pi / 30.0, rel=1e-8)
    assert numbers['load [N]'] == 1000.0
    assert numbers['fold speed [m/s]'] == pytest.approx(0.2132256, abs=5e-8)
    assert numbers['amplitude [m]'] == pytest.approx(0.52688e-3, abs=5e-9)


@pytest.mark.slow
def test_publish_period_thins_values_but_not_changes(start: Any, kit: Any) -> None:
    monitor = start(kit.parameters(kit.STAMPED, AT_ONCE))
    warnings = monitor.warnings()
    telemetry = kit.Telemetry(monitor)
    assert monitor.set(publish_period=1000.0) == [(True, '')]
    telemetry.heard['regime'].clear()
    for second in range(5):
        telemetry.send(50.0, 1000.0, second)
    telemetry.send(20.0, 1000.0, 10)
    monitor.peer.until(lambda: telemetry.heard['regime'] and warnings, 'the change')
    assert [m.data for m in telemetry.heard['regime']] == ['unstable']


LISTENER = """
import sys, rclpy
from std_msgs.msg import Float64
from rclpy.qos import QoSProfile, HistoryPolicy
rclpy.init()
node = rclpy.create_node('listener')
keep_all = QoSProfile(history=HistoryPolicy.KEEP_ALL, depth=1)
node.create_subscription(Float64, sys.argv[1], lambda message: print(message.data), keep_all)
try:
    rclpy.spin(node)
except BaseException:
    pass
"""


@pytest.mark.slow
def test_a_reader_that_stands_still_does_not_stop_the_node(start: Any, run: Any, kit: Any) -> None:
    monitor = start(kit.parameters(kit.STAMPED, AT_ONCE))
    peer, warnings = monitor.peer, monitor.warnings()
    topic = monitor.name('aft/amplitude')
    listener = run(sys.executable, '-c', LISTENER, topic)
    telemetry = kit.Telemetry(monitor)
    peer.until(lambda: peer.node.count_subscribers(topic) >= 2, 'the listener')
    listener.process.send_signal(signal.SIGSTOP)
    for k in range(300):
        telemetry.send(60.0, 1000.0, k)
        peer.spin(0.002)
    telemetry.send(20.0, 1000.0, 1000)
    peer.until(lambda: warnings, 'a warning all the same')
    assert monitor.alive


class Refusing:
    """A publisher whose reliable queue is full."""

    topic_name = 'aft/amplitude'

    def publish(self, message: object) -> None:
        from rclpy.impl.implementation_singleton import rclpy_implementation

        raise rclpy_implementation.RCLError('cannot publish data')


class Counted:
    """A publisher with so many readers."""

    topic_name = 'aft/amplitude'

    def __init__(self, readers: int) -> None:
        self.readers, self.published = readers, 0

    def get_subscription_count(self) -> int:
        return self.readers

    def publish(self, message: object) -> None:
        self.published += 1


def test_what_nobody_listens_to_is_neither_worked_out_nor_published() -> None:
    from stickslip_monitor.ros.outputs import Outputs

    def never(point: object) -> float:
        raise AssertionError('worked out for nobody')

    heard, unheard = Counted(1), Counted(0)
    outputs: Any = Outputs.__new__(Outputs)
    outputs._clips = None
    message = SimpleNamespace()
    outputs._bearings = {
        'aft': [(unheard, message, never), (heard, message, lambda point: 0.5)],
    }
    outputs.take_verdict(SimpleNamespace(assessment=None, bearing='aft', time_ns=1))
    assert (heard.published, unheard.published, message.data) == (1, 0, 0.5)


def test_a_publication_that_fails_is_logged() -> None:
    from stickslip_monitor.ros.outputs import Outputs

    logged: list[str] = []
    outputs = Outputs.__new__(Outputs)
    logger = SimpleNamespace(warning=lambda text, **options: logged.append(text))
    outputs._node = SimpleNamespace(get_logger=lambda: logger)  # type: ignore[assignment]
    outputs._clips = None
    outputs._send(Refusing(), object())
    assert logged == ['not published on aft/amplitude: cannot publish data']
