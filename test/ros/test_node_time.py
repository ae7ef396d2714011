# SPDX-License-Identifier: Apache-2.0
"""Inputs that stop and return, clocks that stand still, jump and start late."""

from __future__ import annotations

import time
from typing import Any

import pytest

pytest.importorskip('rclpy', reason='ROS 2 is not installed')

SIMULATED = ('-p', 'use_sim_time:=true')


class Sensors:
    """Speed and load as plain numbers, without stamps."""

    def __init__(self, monitor: Any) -> None:
        from std_msgs.msg import Float64, String

        self.peer, self._monitor, self._kind = monitor.peer, monitor, Float64
        self.regimes = self.peer.listen(String, monitor.name('aft/regime'))
        self.open()

    def open(self) -> None:
        self._publishers = [
            self.peer.talk(self._kind, self._monitor.input(topic))
            for topic in ('shaft/speed', 'aft/load')
        ]

    def close(self) -> None:
        for publisher in self._publishers:
            self.peer.node.destroy_publisher(publisher)

    def send(self, rpm: float | None, load: float | None) -> None:
        for publisher, value in zip(self._publishers, (rpm, load), strict=True):
            if value is not None:
                publisher.publish(self._kind(data=value))
        self.peer.spin(0.05)

    def sending(self, rpm: float | None, load: float | None, condition: Any) -> Any:
        """A condition to wait for while values are sent."""

        def check() -> Any:
            self.send(rpm, load)
            return condition()

        return check


class Clock:
    """A clock that the test drives."""

    def __init__(self, monitor: Any) -> None:
        from rosgraph_msgs.msg import Clock as Message

        self._message = Message
        self._publisher = monitor.peer.talk(Message, monitor.input('clock'))

    def set(self, seconds: float) -> None:
        message = self._message()
        message.clock.sec, message.clock.nanosec = divmod(round(seconds * 1e9), 10**9)
        self._publisher.publish(message)


@pytest.mark.slow
def test_an_input_that_dies_is_reported_with_its_age_and_cleared(start: Any, kit: Any) -> None:
    monitor = start(kit.parameters({'speed.timeout': 1.0, 'load.timeout': 60.0}))
    peer, warnings, diagnostics = monitor.peer, monitor.warnings(), monitor.diagnostics()
    sensors = Sensors(monitor)
    peer.until(sensors.sending(60.0, 1000.0, lambda: sensors.regimes), 'a regime')

    def lost() -> Any:
        return [e for e in kit.events(warnings) if e['to'] == 'input_stale']

    assert not [e for e in lost() if 'load' in e['input_age']]
    warnings.clear()
    peer.until(sensors.sending(None, 1000.0, lost), 'the loss of the speed')
    (event,) = lost()
    assert event['input_age'] == {'speed': 1.0}
    assert event['level'] == 'ERROR'
    topic = monitor.input('shaft/speed')
    assert event['text'] == (
        f'aft: Input speed lost: nothing believable on {topic} for 1 s.'
        f' /{peer.node.get_name()} publishes on {topic}, but nothing arrives.'
    )
    peer.until(
        lambda: float(kit.status(diagnostics).get('speed age [s]', 0.0)) > 2.0, 'a growing age'
    )
    record = kit.status(diagnostics)
    assert (record['level'], record['reason']) == (b'\x02', 'input_stale')
    assert 'load age [s]' not in record

    sensors.close()
    sensors.open()
    peer.until(
        sensors.sending(60.0, 1000.0, lambda: kit.events(warnings)[-1]['to'] == 'normal'),
        'the return',
    )
    assert kit.events(warnings)[-1]['from'] == 'input_stale'
    peer.until(lambda: kit.status(diagnostics).get('level') == b'\x00', 'diagnostics clear')
    assert 'speed age [s]' not in kit.status(diagnostics)


@pytest.mark.slow
def test_inputs_never_received(start: Any, kit: Any) -> None:
    monitor = start(kit.parameters({'speed.timeout': 1.0, 'load.timeout': 1.0}))
    peer, diagnostics = monitor.peer, monitor.diagnostics()
    peer.until(lambda: diagnostics, 'diagnostics')
    first = diagnostics[0].status[0]
    if first.values[0].value != 'input_stale':
        assert (first.level, first.values[0].value) == (b'\x01', 'waiting')
        assert first.message == 'aft: Waiting for the first speed and load.'
    warnings = monitor.warnings()
    peer.until(lambda: warnings, 'the loss')
    (event,) = kit.events(warnings)
    assert (event['from'], event['to']) == ('normal', 'input_stale')
    assert event['input_age'] == {'speed': None, 'load': None}
    assert event['regime'] is None
    assert 'so far' in event['text']


@pytest.mark.slow
def test_late_delivery_does_not_move_the_time_of_a_verdict(start: Any, kit: Any) -> None:
    changes = {'alarm.on_delay': 0.0, 'alarm.off_delay': 0.0}
    monitor = start(kit.parameters(kit.STAMPED, changes))
    warnings = monitor.warnings()
    telemetry = kit.Telemetry(monitor)
    # Stamps 1 ms apart, delivered some 0.2 s apart: the watchdog looks in between.
    for k in range(4):
        telemetry.step(60.0 if k % 2 else 20.0, 1000.0, 1.0 + k * 1e-3)
        monitor.peer.spin(0.2)
    monitor.peer.until(lambda: len(warnings) >= 4, 'four events')
    assert [e['time'] - kit.T0 for e in kit.events(warnings)] == [
        10**9 + k * 10**6 for k in range(4)
    ]


@pytest.mark.slow
def test_stamps_that_jump_back_restart_the_delays(start: Any, kit: Any) -> None:
    monitor = start(kit.parameters(kit.STAMPED, {'alarm.on_delay': 3.0}))
    warnings, diagnostics = monitor.warnings(), monitor.diagnostics()
    telemetry = kit.Telemetry(monitor)
    for seconds in (1, 2, 3):
        telemetry.step(20.0, 1000.0, seconds)
    # The warning is due at 4; the clock jumps back by more than the timeout of 1000 s.
    telemetry.step(20.0, 1000.0, -2000, answers=1)
    # The first value after the jump does not count: nothing is known of the rhythm.
    for seconds in (-1999, -1998, -1997):
        telemetry.step(20.0, 1000.0, seconds)
    assert not warnings
    telemetry.step(20.0, 1000.0, -1996)
    monitor.peer.until(lambda: warnings, 'the warning')
    (event,) = kit.events(warnings)
    assert event['to'] == 'stick_slip'
    assert event['time'] == kit.T0 - 1996 * kit.SECOND
    monitor.peer.until(
        lambda: kit.status(diagnostics).get('speed samples clock jump') == '1', 'the jump counted'
    )
    assert monitor.alive


@pytest.mark.slow
def test_clock_starts_late_and_jumps(start: Any, kit: Any) -> None:
    timing = {
        'speed.timeout': 2.0,
        'load.timeout': 2.0,
        'alarm.on_delay': 2.0,
        'alarm.off_delay': 2.0,
        'alarm.onset_growth': 0.0,
    }
    monitor = start(kit.parameters(timing), *SIMULATED)
    peer, warnings, diagnostics = monitor.peer, monitor.warnings(), monitor.diagnostics()
    sensors = Sensors(monitor)

    # No /clock yet: there is no time, so nothing is believed and nothing is lost.
    end = time.monotonic() + 1.0
    peer.until(sensors.sending(60.0, 1000.0, lambda: time.monotonic() > end), 'a second')
    peer.until(lambda: kit.status(diagnostics).get('reason') == 'waiting', 'diagnostics')
    assert kit.status(diagnostics)['level'] == b'\x01'
    assert kit.status(diagnostics)['speed samples accepted'] == '0'
    assert not warnings
    assert not sensors.regimes

    clock = Clock(monitor)

    def run(
        begin: float, rpm: float | None, condition: Any, what: str, step: float = 0.2
    ) -> float:
        """Run the clock in steps until a condition holds."""
        now = begin

        def check() -> Any:
            nonlocal now
            now += step
            clock.set(now)
            sensors.send(rpm, None if rpm is None else 1000.0)
            return condition()

        peer.until(check, what)
        return now

    def heard(kind: str) -> Any:
        return lambda: any(e['to'] == kind for e in kit.events(warnings))

    now = run(1000.0, 20.0, heard('stick_slip'), 'a warning')
    event = kit.events(warnings)[-1]
    assert event['from'] == 'normal'
    assert 1002.0 <= event['time'] * 1e-9 <= now

    # Backward: the alarm stays, its delays start anew, verdicts go on.
    warnings.clear()
    now = run(100.0, 60.0, heard('normal'), 'the clearing')
    event = kit.events(warnings)[-1]
    assert event['from'] == 'stick_slip'
    assert 102.0 <= event['time'] * 1e-9 <= now <= 110.0

    # Forward, by more than the timeout: for so long nothing was received.
    warnings.clear()
    now = run(now + 3600.0, 20.0, heard('stick_slip'), 'the second warning')
    kinds = [e['to'] for e in kit.events(warnings)]
    assert kinds == ['input_stale', 'normal', 'stick_slip']
    assert kit.events(warnings)[-1]['time'] * 1e-9 > 3700.0

    # No samples while the clock runs on, some twenty times faster than real time.
    warnings.clear()
    begin = run(now + 0.2, 20.0, lambda: True, 'a sample')
    assert run(begin, None, heard('input_stale'), 'the loss', step=1.0) - begin < 25.0
    run(now + 100.0, 20.0, lambda: 'input_stale' not in kit.events(warnings)[-1]['to'], 'return')

    # The player has gone: a clock that stands still says nothing, the steady clock does.
    warnings.clear()
    peer.until(heard('input_stale'), 'the loss')
    assert monitor.alive
