# SPDX-License-Identifier: Apache-2.0
"""What the node publishes: numbers, warnings and diagnostics."""

from __future__ import annotations

import math
from itertools import pairwise
from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

import kit
import pytest

from stickslip_monitor import assess, build_config

pytest.importorskip('rclpy', reason='ROS 2 is not installed')

# Reference bearing, 1000 N: Hopf speed 30.738 rpm (closed form), fold 40.7179 rpm (grazing orbit, PHYSICS);
# caution below 1.1 * 40.7179 = 44.790 rpm, until above 1.12 * 40.7179 = 45.604 rpm.
LEVELS = [(60.0, 'normal'), (42.0, 'caution'), (35.0, 'bistable'), (20.0, 'stick_slip')]


def test_warnings_arrive_clear_and_are_kept_for_late_joiners(host: Any) -> None:
    monitor = host(kit.stamped_parameters())
    warnings = monitor.warnings()
    telemetry = kit.Telemetry(monitor)
    # The alarm of caution and bistable ends with that of stick-slip, 3 s after 60 rpm are back.
    expected = [*pairwise(LEVELS), (LEVELS[-1], LEVELS[0])]

    def changes() -> list[dict[str, Any]]:
        return [e for e in kit.decode_warnings(warnings) if e['from'] != e['to']]  # an onset is told, too

    for _, (rpm, to) in expected:
        telemetry.until(rpm, 1000.0, lambda to=to: [e for e in changes() if e['to'] == to], to)
    received = changes()
    assert [(e['from'], e['to']) for e in received] == [(a[1], b[1]) for a, b in expected]
    for event, (_, (rpm, to)) in zip(received, expected, strict=True):
        assert (event['schema'], event['bearing']) == ('stickslip_monitor/warning/3', 'aft')
        assert (event['reason'], event['load'], event['input_age']) == (to, 1000.0, {})
        assert event['speed'] == pytest.approx(math.pi * 0.1 * rpm / 60.0, rel=1e-12)
        assert event['sticking'] is (to == 'stick_slip')
        assert event['fold_margin'] == pytest.approx(rpm / 40.7179 - 1.0, abs=2e-6)
        assert event['text'].startswith('aft: ')
    late_joiner = monitor.warnings()
    monitor.peer.until(lambda: len(late_joiner) >= len(warnings), 'latched warnings')
    assert [message.data for message in late_joiner] == [message.data for message in warnings]


def test_published_numbers_equal_the_assessment(host: Any) -> None:
    bearing = build_config(kit.node_parameters(kit.STAMPED)).bearing('aft').bearing
    telemetry = kit.Telemetry(host(kit.stamped_parameters()))
    points = [(60, 1000), (35, 1000), (20, 1000), (20, 100), (0, 1000), (-20, 1000), (20, 0)]
    answers = {}
    for rpm, load in points:
        answer = answers[rpm, load] = telemetry.step(rpm, load)
        expected = assess(bearing, bearing.speed.to_surface(float(rpm), 'rpm'), float(load))
        assert answer == {
            'amplitude': 0.0 if math.isnan(expected.amplitude) else expected.amplitude,
            'amplitude_exact': pytest.approx(
                0.0 if math.isnan(expected.amplitude_exact) else expected.amplitude_exact, rel=1e-6
            ),
            'hopf_margin': expected.hopf_margin,
            # The node reads it from the boundaries tabulated over the load.
            'fold_margin': pytest.approx(expected.fold_margin, rel=1e-9),
            'regime': expected.regime.value,
        }
    assert answers[20, 1000]['amplitude'] == pytest.approx(0.52688e-3, abs=5e-9)
    # The exact column of PHYSICS.md.
    assert answers[20, 1000]['amplitude_exact'] == pytest.approx(0.556755e-3, abs=1e-9)
    nothing = {'amplitude': 0.0, 'amplitude_exact': 0.0, 'regime': 'stable'}
    assert answers[20, 100] == nothing | {'hopf_margin': math.inf, 'fold_margin': math.inf}
    regimes = [answers[key]['regime'] for key in ((60, 1000), (35, 1000), (0, 1000))]
    assert regimes == ['stable', 'bistable', 'undetermined']
    assert answers[-20, 1000] == answers[20, 1000]


def test_quality_of_service_of_every_topic(host: Any) -> None:
    monitor = host(kit.stamped_parameters())
    node = monitor.peer.node
    number = ('std_msgs/msg/Float64', 'RELIABLE', 'VOLATILE')
    expected = {
        monitor.name('warnings'): ('std_msgs/msg/String', 'RELIABLE', 'TRANSIENT_LOCAL'),
        monitor.name('alarms'): ('std_msgs/msg/String', 'RELIABLE', 'TRANSIENT_LOCAL'),
        monitor.name('bearings'): ('std_msgs/msg/String', 'RELIABLE', 'VOLATILE'),
        monitor.name('aft/amplitude'): number,
        monitor.name('aft/amplitude_exact'): number,
        monitor.name('aft/hopf_margin'): number,
        monitor.name('aft/fold_margin'): number,
        monitor.name('aft/regime'): ('std_msgs/msg/String', 'RELIABLE', 'VOLATILE'),
        f'/{monitor.space}/diagnostics': ('diagnostic_msgs/msg/DiagnosticArray', 'RELIABLE', 'VOLATILE'),
    }

    def found(infos: list[Any]) -> list[tuple[str, str, str]]:
        quality = [(info.topic_type, info.qos_profile) for info in infos]
        return [(kind, q.reliability.name, q.durability.name) for kind, q in quality]

    for topic, quality in expected.items():
        monitor.peer.until(
            lambda t=topic, q=quality: found(node.get_publishers_info_by_topic(t)) == [q],
            f'{topic}: {quality}',
        )
    inputs = node.get_subscriptions_info_by_topic(monitor.input('shaft'))
    # Best effort matches every publisher.
    assert found(inputs) == [(kit.JOINT, 'BEST_EFFORT', 'VOLATILE')]


def test_a_quality_that_is_overridden_stays_with_its_topic(host: Any) -> None:
    topics = {f'{name}.topic': f'/overridden/{name}' for name in ('speed', 'load')}
    override = {'qos_overrides./overridden/speed.subscription.reliability': 'reliable'}
    peer = host(kit.node_parameters(topics) | override).peer

    def reliability(name: str) -> list[str]:
        infos = peer.node.get_subscriptions_info_by_topic(f'/overridden/{name}')
        return [info.qos_profile.reliability.name for info in infos]

    peer.until(lambda: reliability('speed') == ['RELIABLE'], 'the override')
    peer.until(lambda: reliability('load') == ['BEST_EFFORT'], 'the default')


def test_diagnostics_come_without_samples_and_at_once_on_a_change(host: Any) -> None:
    monitor = host(kit.stamped_parameters())
    peer, diagnostics = monitor.peer, monitor.diagnostics()
    telemetry = kit.Telemetry(monitor)
    diagnostics.clear()
    for rpm, _ in LEVELS:
        telemetry.hold(rpm, 1000.0, 1.0)
    peer.until(lambda: kit.latest_status(diagnostics).get('reason') == 'stick_slip', 'stick-slip')
    # Every change was told, though all of them happened within some tenths of a second.
    reasons = {kit.latest_status([message]).get('reason') for message in diagnostics}
    assert {to for _, to in LEVELS[1:]} <= reasons
    record = kit.latest_status(diagnostics)
    assert (record['level'], record['name']) == (b'\x02', f'{monitor.space}/stickslip_monitor: aft')
    assert record['message'].startswith('aft: Stick-slip predicted. ')
    words = [record[key] for key in ('regime', 'outcome', 'stick-slip predicted')]
    assert words == ['unstable', 'stick_slip', 'true']
    assert float(record['shaft speed [rpm]']) == 20.0
    assert float(record['speed [m/s]']) == pytest.approx(math.pi / 30.0, rel=1e-8)
    assert float(record['fold speed [m/s]']) == pytest.approx(0.2131982, abs=1e-7)
    assert float(record['amplitude [m]']) == pytest.approx(0.52688e-3, abs=5e-9)
    diagnostics.clear()
    peer.until(lambda: len(diagnostics) >= 2, 'diagnostics, also while nothing arrives')


def test_outputs_without_subscriber_are_not_computed_and_failures_are_logged() -> None:
    from rclpy.impl.implementation_singleton import rclpy_implementation

    from stickslip_monitor.ros.outputs import Outputs

    logged: list[str] = []
    logger = SimpleNamespace(warning=lambda text, **options: logged.append(text))
    subscribed, unsubscribed, full = (Mock(topic_name=name) for name in ('heard', 'unheard', 'full'))
    unsubscribed.get_subscription_count.return_value = 0
    for publisher in (subscribed, full):
        publisher.get_subscription_count.return_value = 1
    full.publish.side_effect = rclpy_implementation.RCLError('cannot publish data')
    outputs: Any = Outputs.__new__(Outputs)
    outputs._clips, outputs._node = None, SimpleNamespace(get_logger=lambda: logger)
    message, never = SimpleNamespace(), Mock(side_effect=AssertionError('for nobody'))
    outputs._bearings = {
        'aft': [(unsubscribed, message, never)] + [(p, message, lambda _: 0.5) for p in (full, subscribed)]
    }
    outputs.take_verdict(SimpleNamespace(bearing='aft', time_ns=1))
    subscribed.publish.assert_called_once_with(message)
    assert message.data == 0.5
    assert logged == ['not published on full: cannot publish data']
