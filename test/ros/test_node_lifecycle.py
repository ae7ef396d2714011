# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import json
from types import SimpleNamespace
from typing import Any

import pytest

pytest.importorskip('rclpy', reason='ROS 2 is not installed')

CONFIGURE, CLEANUP, ACTIVATE, DEACTIVATE, CREATE = 1, 2, 3, 4, 0
SHUTDOWN = {'unconfigured': 5, 'inactive': 6, 'active': 7}
AT_ONCE = {'alarm.on_delay': 0.0, 'alarm.off_delay': 0.0}


@pytest.mark.slow
def test_every_transition_and_every_invalid_request(start: Any, kit: Any) -> None:
    monitor = start(kit.parameters(kit.STAMPED, autostart=False))

    def request(number: int, success: bool, state: str) -> None:
        assert monitor.change_state(number) is success
        assert monitor.state() == state

    assert monitor.state() == 'unconfigured'
    for number in (CLEANUP, ACTIVATE, DEACTIVATE, CREATE, SHUTDOWN['active'], 99):
        request(number, False, 'unconfigured')
    assert monitor.change_state(0, 'nonsense') is False
    request(CONFIGURE, True, 'inactive')
    for number in (CONFIGURE, DEACTIVATE, SHUTDOWN['unconfigured'], 255):
        request(number, False, 'inactive')
    request(CLEANUP, True, 'unconfigured')
    request(CONFIGURE, True, 'inactive')
    request(ACTIVATE, True, 'active')
    for number in (CONFIGURE, CLEANUP, ACTIVATE):
        request(number, False, 'active')
    request(DEACTIVATE, True, 'inactive')
    request(ACTIVATE, True, 'active')
    assert monitor.change_state(0, 'deactivate') is True
    request(ACTIVATE, True, 'active')
    request(SHUTDOWN['active'], True, 'finalized')
    for number in (CONFIGURE, ACTIVATE, *SHUTDOWN.values()):
        request(number, False, 'finalized')
    assert monitor.alive
    assert monitor.stop() == 0
    assert 'Traceback' not in monitor.output


@pytest.mark.slow
def test_an_activation_that_fails_can_be_repeated(start: Any, kit: Any) -> None:
    topics = {'speed.topic': '/parameter_events'}
    monitor = start(kit.parameters(topics, autostart=False))
    assert monitor.change_state(CONFIGURE)
    for _ in range(2):
        assert not monitor.change_state(ACTIVATE)
        assert monitor.state() == 'inactive'
    assert 'its inputs cannot be subscribed to' in monitor.output
    assert monitor.set(aft__speed__topic='/elsewhere') == [(True, '')]
    assert monitor.change_state(ACTIVATE)
    assert monitor.state() == 'active'


@pytest.mark.parametrize('state', ['unconfigured', 'inactive'])
def test_shutdown_from_a_state_that_is_not_active(start: Any, kit: Any, state: str) -> None:
    monitor = start(kit.parameters(kit.STAMPED, autostart=False))
    if state == 'inactive':
        assert monitor.change_state(CONFIGURE)
    assert monitor.change_state(SHUTDOWN[state])
    assert monitor.state() == 'finalized'
    assert monitor.stop() == 0


def test_deactivation_stops_the_output_and_activation_resumes_it(start: Any, kit: Any) -> None:
    from std_msgs.msg import String

    monitor = start(kit.parameters(kit.STAMPED, AT_ONCE))
    peer, warnings, diagnostics = monitor.peer, monitor.warnings(), monitor.diagnostics()
    alarms = peer.listen(String, monitor.name('alarms'), latched=True)
    telemetry = kit.Telemetry(monitor)
    telemetry.step(20.0, 1000.0, 1)
    peer.until(lambda: warnings and diagnostics, 'a warning')

    assert monitor.change_state(DEACTIVATE)
    # What was published before has arrived when a later question is answered.
    assert monitor.state() == 'inactive'
    # The last word: what readers keep is not the state of a bearing that nobody watches.
    peer.until(
        lambda: kit.status(diagnostics)['reason'] == 'not_monitoring', 'the last diagnostics'
    )
    assert kit.status(diagnostics)['level'] == b'\x01'
    last = json.loads(alarms[-1].data)
    assert last['monitoring'] is False
    assert 'inactive: the bearings are not monitored' in last['notes'][-1]['text']
    heard = [*telemetry.heard.values(), warnings, diagnostics]
    counts = [len(item) for item in heard]
    for second in range(10):
        telemetry.send(60.0, 1000.0, 2 + second)
    peer.spin(1.3)
    assert [len(item) for item in heard] == counts

    assert monitor.change_state(ACTIVATE)
    peer.until(lambda: len(diagnostics) > counts[-1], 'diagnostics')
    # The state was kept: still the alarm of before, until a sample says otherwise.
    assert kit.status(diagnostics)['reason'] == 'stick_slip'
    peer.until(lambda: json.loads(alarms[-1].data)['monitoring'], 'the list')
    topic = monitor.input('shaft')
    peer.until(lambda: peer.node.count_subscribers(topic), 'the subscription')

    def cleared() -> bool:
        nonlocal second
        second += 1
        telemetry.send(60.0, 1000.0, second)
        peer.spin(0.05)
        return kit.events(warnings)[-1]['to'] == 'normal'

    second = 20
    peer.until(cleared, 'the clearing')
    assert [(e['from'], e['to']) for e in kit.events(warnings)[-2:]] == [
        ('normal', 'stick_slip'),
        ('stick_slip', 'normal'),
    ]


@pytest.mark.slow
def test_cleanup_forgets(start: Any, kit: Any) -> None:
    monitor = start(kit.parameters(kit.STAMPED, AT_ONCE))
    warnings, diagnostics = monitor.warnings(), monitor.diagnostics()
    telemetry = kit.Telemetry(monitor)
    telemetry.step(20.0, 1000.0, 1)
    monitor.peer.until(lambda: warnings, 'a warning')
    for transition in (DEACTIVATE, CLEANUP):
        assert monitor.change_state(transition)
    topic = monitor.name('warnings')
    monitor.peer.until(lambda: not monitor.peer.node.count_publishers(topic), 'no publishers')
    for transition in (CONFIGURE, ACTIVATE):
        assert monitor.change_state(transition)
    warnings.clear()
    diagnostics.clear()
    again = kit.Telemetry(monitor)
    again.step(20.0, 1000.0, 2)
    monitor.peer.until(lambda: warnings, 'a warning')
    assert [e['from'] for e in kit.events(warnings)] == ['normal']
    monitor.peer.until(lambda: kit.status(diagnostics).get('regime'), 'diagnostics')
    assert int(kit.status(diagnostics)['load samples accepted']) < 100


def test_the_loop_survives_a_request_that_raises(monkeypatch: pytest.MonkeyPatch) -> None:
    """Up to ROS 2 Jazzy, rclpy raises for an invalid lifecycle request."""
    from rclpy.impl.implementation_singleton import rclpy_implementation

    from stickslip_monitor.ros import run as node

    survived: list[Exception] = []
    refused = rclpy_implementation.RCLError('Transition is not registered.')
    turns = iter([refused, ValueError('what nobody expected'), None])
    running = [True]

    class Executor:
        def add_node(self, item: object) -> None:
            pass

        def spin_once(self, timeout: float) -> None:
            fault = next(turns)
            if fault is not None:
                raise fault
            running[0] = False

        def shutdown(self) -> None:
            ended.append(True)

    ended: list[bool] = []
    monkeypatch.setattr(node, 'make_executor', Executor)
    monkeypatch.setattr(node.rclpy, 'ok', lambda: running[0])
    node._spin(SimpleNamespace(survive=survived.append), [])  # type: ignore[arg-type]
    assert ended == [True]
    assert [str(error) for error in survived] == [
        'Transition is not registered.',
        'what nobody expected',
    ]
