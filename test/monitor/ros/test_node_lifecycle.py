# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import json
import re
from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

import kit
import pytest

from stickslip_monitor.monitor.alarm_list import Action
from stickslip_monitor.monitor.alarm_records import ActionRequest

pytest.importorskip('rclpy', reason='ROS 2 is not installed')


def test_an_activation_that_fails_can_be_repeated(host: Any) -> None:
    # The node publishes this topic itself, with another type.
    topics = {'speed.topic': '/parameter_events'}
    monitor = host(kit.node_parameters(topics, autostart=False))
    assert monitor.go('configure')
    for _ in range(2):
        assert not monitor.go('activate')
    assert 'its inputs cannot be subscribed to' in monitor.output
    assert monitor.set(aft__speed__topic='/elsewhere') == [(True, '')]
    assert monitor.go('activate')


@pytest.mark.parametrize('state', ['unconfigured', 'inactive'])
def test_shutdown_from_a_state_that_is_not_active(host: Any, state: str) -> None:
    monitor = host(kit.stamped_parameters(autostart=False))
    assert state == 'unconfigured' or monitor.go('configure')
    assert monitor.go('shutdown')


def test_deactivation_stops_the_output_activation_resumes_it_and_cleanup_forgets(host: Any) -> None:
    monitor = host(kit.stamped_parameters())
    peer, warnings, diagnostics = monitor.peer, monitor.warnings(), monitor.diagnostics()
    alarms = monitor.listen('alarms', latched=True)
    telemetry = kit.Telemetry(monitor)

    def reason(text: str) -> Any:
        return lambda: kit.latest_status(diagnostics).get('reason') == text

    telemetry.until(20.0, 1000.0, reason('stick_slip'), 'the alarm')

    assert monitor.set(aft__alarm__on_delay=0.6) == [(True, '')]
    assert monitor.set(aft__alarm__on_delay=0.6) == [(True, '')]
    assert monitor.go('deactivate')
    # The last word: what readers keep is not the state of a bearing that nobody watches.
    peer.until(reason('not_monitoring'), 'the last diagnostics')
    assert kit.latest_status(diagnostics)['level'] == b'\x01'
    peer.until(lambda: not json.loads(alarms[-1].data)['monitoring'], 'the last list')
    # All that was done to the node is on record.
    notes = [note for m in alarms for note in json.loads(m.data)['notes']]
    assert [note['text'] for note in notes if note['what'] in ('lifecycle', 'parameter')] == [
        'the monitor is configured, inactive',
        'the monitor is active',
        'parameter aft.alarm.on_delay: 0.5 -> 0.6',
        'the monitor is inactive: the bearings are not monitored',
    ]
    topic = monitor.input('shaft')
    assert f'aft: speed in rpm from {topic} ({kit.JOINT}, velocity[0])' in monitor.output
    outputs = [*telemetry.received.values(), warnings, diagnostics]
    counts = [len(item) for item in outputs]
    for _ in range(10):
        telemetry.send(60.0, 1000.0)
    peer.spin(1.3)
    assert [len(item) for item in outputs] == counts

    assert monitor.go('activate')
    # The state was kept: still the alarm of before, until a sample says otherwise.
    peer.until(reason('stick_slip'), 'diagnostics')
    peer.until(lambda: json.loads(alarms[-1].data)['monitoring'], 'the list')
    telemetry.until(60.0, 1000.0, lambda: kit.decode_warnings(warnings)[-1]['to'] == 'normal', 'the clearing')
    assert kit.decode_warnings(warnings)[-1]['from'] == 'stick_slip'

    telemetry.until(20.0, 1000.0, reason('stick_slip'), 'the alarm again')
    assert monitor.go('deactivate', 'cleanup')
    peer.until(lambda: not peer.node.count_publishers(monitor.name('warnings')), 'no publishers')
    assert monitor.go('configure', 'activate')
    diagnostics.clear()
    peer.until(reason('waiting'), 'a fresh start')
    assert kit.latest_status(diagnostics)['load samples accepted'] == '0'


def test_the_loop_survives_a_request_that_raises(monkeypatch: pytest.MonkeyPatch) -> None:
    """Up to ROS 2 Jazzy, rclpy raises for an invalid lifecycle request."""
    from rclpy.impl.implementation_singleton import rclpy_implementation

    from stickslip_monitor.ros import process as node

    survived: list[Exception] = []
    refused = rclpy_implementation.RCLError('Transition is not registered.')
    turns = iter([refused, ValueError('what nobody expected'), None])
    running = [True]

    def spin_once(timeout: float) -> None:
        fault = next(turns)
        if fault is not None:
            raise fault
        running[0] = False

    executor = Mock(spin_once=spin_once)
    monkeypatch.setattr(node, 'make_executor', lambda: executor)
    monkeypatch.setattr(node.rclpy, 'ok', lambda: running[0])
    node._spin_node(SimpleNamespace(report_exception=survived.append), [], 2)  # type: ignore[arg-type]
    executor.shutdown.assert_called_once()
    assert [str(error) for error in survived] == ['Transition is not registered.', 'what nobody expected']


def test_a_callback_that_fails_is_reported_and_survived(host: Any) -> None:
    monitor = host(kit.node_parameters())

    def fails(message: object) -> None:
        raise ZeroDivisionError('float division by zero')

    assert monitor.node.guard_callback(fails)('message') is None
    health = monitor.node.health
    assert health.severity == 2
    text = 'ZeroDivisionError: float division by zero (test_node_lifecycle'
    assert re.match(rf'1 callback failed, last at [\d:]+ UTC: {re.escape(text)}', health.message)
    assert f'[error] a callback failed, the node continues: {text}' in monitor.output


def test_deactivation_under_load_leaves_nothing_behind(host: Any) -> None:
    """Have messages wait at every transition; a callback that fails is counted."""
    monitor = host(kit.node_parameters())
    talk = [monitor.talk('shaft/speed'), monitor.talk('aft/load')]
    for _ in range(20):
        for value in (60.0, 1000.0) * 5:
            for publish in talk:
                publish(value)
            monitor.peer.executor.spin_once(timeout_sec=0.0)
        assert monitor.go('deactivate')
        monitor.peer.spin(0.02)
        assert monitor.go('activate')
    monitor.peer.spin(0.2)
    assert monitor.node.health.failures == 0
    assert monitor.node.health.lost == 0


def test_a_changed_parameter_stands_until_it_is_acknowledged_or_taken_back(host: Any) -> None:
    from std_srvs.srv import Trigger

    monitor = host(kit.node_parameters())
    health = monitor.node.health
    assert monitor.set(aft__alarm__on_delay=5.0) == [(True, '')]
    assert health.message == ('Changed over ROS and not acknowledged: aft.alarm.on_delay from 2.0 to 5.0.')
    assert health.severity == 1
    assert monitor.set(aft__alarm__on_delay=2.0) == [(True, '')]
    assert health.message == 'Monitoring.'
    assert monitor.set(aft__load__timeout=50.0) == [(True, '')]
    # Who acknowledges one bearing has not seen what was changed of all.
    monitor.node._loop._carry_out(ActionRequest(Action.ACKNOWLEDGE, 'Ada', 'aft'))
    assert health.severity == 1
    monitor.peer.call(Trigger, monitor.name('acknowledge'))
    assert health.message == 'Monitoring.'
