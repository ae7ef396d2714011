# SPDX-License-Identifier: Apache-2.0
"""Inputs that stop and return, clocks that stand still, jump and start late."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace
from typing import Any, NamedTuple
from unittest.mock import Mock

import kit
import pytest
from sending import SECOND, Ship
from shared import CONFIG

from stickslip_monitor import build_config
from stickslip_monitor.monitor.bearing_records import NodeHealth
from stickslip_monitor.monitor.parameter_file import load_config
from stickslip_monitor.monitor.sample_types import Status
from stickslip_monitor.monitor.session import Moment

pytest.importorskip('rclpy', reason='ROS 2 is not installed')


class Sensors:
    """Speed and load as plain numbers, without stamps, and the clock that the test drives."""

    def __init__(self, monitor: Any) -> None:
        from rosgraph_msgs.msg import Clock

        self.peer = monitor.peer
        self._speed, self._load = monitor.talk('shaft/speed'), monitor.talk('aft/load')
        self._message = Clock
        self._clock = self.peer.node.create_publisher(Clock, monitor.input('clock'), 10)

    def send(self, rpm: float | None, load: float | None) -> None:
        for talk, value in ((self._speed, rpm), (self._load, load)):
            if value is not None:
                talk(value)
        self.peer.spin(0.02)

    def sending(self, rpm: float | None, load: float | None, condition: Any) -> Any:
        """Return a condition to wait for while values are sent."""

        def check() -> Any:
            self.send(rpm, load)
            return condition()

        return check

    def run(self, begin: float, rpm: float | None, condition: Any, event: str, step: float = 0.2) -> float:
        """Run the clock in steps until a condition holds; return its time."""
        now = begin

        def check() -> Any:
            nonlocal now
            now += step
            message = self._message()
            message.clock.sec, message.clock.nanosec = divmod(round(now * 1e9), 10**9)
            self._clock.publish(message)
            self.send(rpm, None if rpm is None else 1000.0)
            return condition()

        self.peer.until(check, event)
        return now


@pytest.mark.parametrize(('pause', 'set_by'), [(4, 0), (100, 0), (4, -40), (4, -7200), (4, 7200)])
def test_after_a_restart_no_input_is_lost_for_the_time_before(pause: int, set_by: int) -> None:
    """Run the watchdog of a session that remembers a bearing from some time ago.

    A computer without a battery for its clock is behind after each start [s].
    """
    from stickslip_monitor.ros.node_loop import Watchdog

    ship = Ship(load_config(CONFIG))
    (name,) = (bearing.name for bearing in ship.config.bearings)
    for _ in range(2):
        watchdog = Watchdog(ship.session)
        for tenth in range(200):
            ship.steady_ns += SECOND // 10
            watchdog.tick(ship.now, SECOND // 10)
            if tenth < 12:  # the first message comes later than the first look
                continue
            for place, number in enumerate((60.0, 1000.0)):
                if ship.take(name, place, number).status.valid:
                    watchdog.note(name)
        ship.session.end()
        ship.steady_ns += pause * SECOND
        ship.ahead_ns += set_by * SECOND
        ship.boot()
    assert ship.events == []


@pytest.mark.parametrize('days', [-300, 300])
def test_silence_is_measured_by_the_clock_that_is_never_set(days: int) -> None:
    from stickslip_monitor.ros.node_loop import Watchdog

    ship = Ship(load_config(CONFIG))
    (bearing,) = ship.config.bearings
    watchdog, seconds = Watchdog(ship.session), 0.0
    while not ship.events and seconds < 60.0:
        ship.steady_ns += SECOND // 10
        seconds += 0.1
        if round(seconds, 1) == 12.0:  # two seconds after the last message
            ship.ahead_ns += days * 86_400 * SECOND
        for place, number in enumerate((60.0, 1000.0)):
            if seconds < 10.0:
                ship.take(bearing.name, place, number)
                watchdog.note(bearing.name)
        watchdog.tick(ship.now, SECOND // 10)
    (event,) = ship.events
    assert event.after.value == 'input_stale'
    # Told half a second late, so that a sample delivered late keeps the time of its stamp.
    timeout = bearing.speed.timeout_ns / SECOND
    assert seconds == pytest.approx(10.0 + timeout + 0.5, abs=0.3)
    assert abs(ship.now.time_ns - event.time_ns) < SECOND


class Waits(NamedTuple):
    """A number that waits for a turn of a node."""

    place: int
    ago_ns: int = 0  # how long ago it came
    late_ns: int = 0  # how long after its stamp it came
    frozen_ns: int = 0  # how long the node is held up while it works it off
    rpm: float = 60.0


class Turns:
    """A ship under way on two-second time-outs, and the turns of its node, without the node.

    Args:
        stands: Whether the node is on a simulated clock that stands from now on.
    """

    def __init__(self, *, stands: bool = False, **changes: Any) -> None:
        from stickslip_monitor.ros.inputs import Number
        from stickslip_monitor.ros.node_loop import NodeLoop

        changes = {'speed.timeout': 2.0, 'load.timeout': 2.0} | changes
        self.ship = ship = Ship(build_config(kit.node_parameters(changes)))
        ship.sail(10.0)
        self.waiting: list[Waits] = []

        def take_numbers() -> Iterator[Number]:
            for waiting in self.waiting:
                arrival_ns = ship.now.time_ns - waiting.ago_ns
                yield Number(
                    'aft',
                    waiting.place,
                    arrival_ns - waiting.late_ns,
                    arrival_ns,
                    (waiting.rpm, 1000.0)[waiting.place],
                )
                ship.steady_ns += waiting.frozen_ns

        node, configured = Mock(), Mock(session=ship.session, health=NodeHealth(), config=ship.config)
        node.get_node_names_and_namespaces.return_value = []
        node.get_publishers_info_by_topic.return_value = []
        stood_ns = ship.now.time_ns

        def clock() -> Moment:
            return Moment(ship.steady_ns, stood_ns) if stands else ship.now

        self.running: Any = NodeLoop(node, configured, lambda function: function, clock, stands)
        self.running._log = ship
        self.running.inputs = SimpleNamespace(
            fetch=lambda is_late: None, take_numbers=take_numbers, piled=False, lanes=[]
        )

    def turn(self, *queued: Waits, after: float = 0.05) -> None:
        """Take a turn some seconds after the one before, which finds what waits."""
        self.ship.steady_ns += round(after * SECOND)
        self.waiting = list(queued)
        self.running.turn()


def test_messages_that_waited_while_the_node_stalled_are_taken() -> None:
    # One message of each input came at the begin of 4 s, the others were lost: a gap of our own.
    turns = Turns()
    turns.turn(*(Waits(place, ago) for ago in (39 * SECOND // 10, 0) for place in (0, 1)), after=4.0)
    assert turns.ship.events == []
    assert turns.running._health.delays == 1


def test_a_turn_that_is_frozen_midway_is_excused_by_the_next() -> None:
    turns = Turns()
    turns.turn(Waits(0, frozen_ns=4 * SECOND))
    turns.turn(Waits(0), Waits(1))
    assert turns.ship.events == []
    # A loss of its own is still told.
    for _ in range(60):
        turns.turn()
    assert [event.after.value for event in turns.ship.events] == ['input_stale']


def test_stalls_beside_a_clock_that_stands_hide_no_loss() -> None:
    """Hold the node up for a second of every two."""
    turns, periods = Turns(stands=True), 0
    while not turns.ship.events and periods < 30:
        periods += 1
        for _ in range(20):
            turns.turn()
        turns.turn(after=1.0)
    assert [event.after.value for event in turns.ship.events] == ['input_stale']
    # A second until the clock counts as stopped, the time-out of two seconds, and half a second for late
    # samples: without the stalls.
    assert periods == 4


@pytest.mark.parametrize('rate', [20, 1, 0.1])
def test_a_stall_is_as_long_as_it_is_on_the_clock_of_a_replay(rate: float) -> None:
    """Hold the node up for 0.8 s, in which 16 s pass at 20 times the pace, and 0.08 s at a tenth of it."""
    from stickslip_monitor.ros.inputs import Number

    turns = Turns(stands=True)
    ship, sent = turns.ship, [60.0, 1000.0]
    begin_ns, base_ns = ship.steady_ns, ship.now.time_ns
    read_ns = begin_ns  # when the executor, which takes timers first, took the last /clock
    clock = lambda: Moment(ship.steady_ns, base_ns + round(rate * (read_ns - begin_ns)))  # noqa: E731
    turns.running._now = clock

    def take_numbers() -> Iterator[Number]:
        now_ns = clock().time_ns
        yield from (Number('aft', place, now_ns, now_ns, value) for place, value in enumerate(sent))

    turns.running.inputs.take_numbers = take_numbers
    for after in [0.05] * 40 + [0.8] + [0.05] * 40:
        turns.turn(after=after)
        read_ns = ship.steady_ns
    assert ship.events == []
    sent.clear()
    silent_ns = ship.steady_ns
    while not ship.events and ship.steady_ns - silent_ns < 60 * SECOND:
        turns.turn()
        read_ns = ship.steady_ns
    assert [event.after.value for event in ship.events] == ['input_stale']
    # The time-out of two seconds and half a second for late samples, to a second turn.
    silent = rate * (ship.steady_ns - silent_ns) / SECOND
    assert silent == pytest.approx(2.5, abs=2 * 0.1 * rate + 0.1)


def test_a_turn_that_comes_after_the_end_does_nothing() -> None:
    """Take a turn whose timer the executor had taken before the node was deactivated."""
    turns = Turns()
    turns.running._ticker = None
    turns.turn(Waits(0, rpm=20.0), Waits(1), after=60.0)
    assert turns.ship.verdicts[-1].speed == pytest.approx(math.pi / 10.0)  # 60 rpm
    assert turns.running._health.delays == 0


def test_no_message_is_refused_after_a_clock_step_while_the_node_stalls() -> None:
    # What waits came in part before the clock was set back by an hour, and has no stamp.
    turns = Turns()
    turns.ship.ahead_ns -= 3600 * SECOND
    waiting = (Waits(k % 2, ago * SECOND // 10) for ago in (36_030, 20, 10, 0) for k in range(2))
    turns.turn(*waiting, after=4.0)
    (bearing,) = turns.ship.session.monitor.bearings.values()
    assert bearing.counts[:, Status.OUT_OF_ORDER].tolist() == [0, 0, 0, 0]
    assert turns.ship.events == []


def test_late_delivery_does_not_move_the_time_of_a_verdict() -> None:
    # Stamps 0.1 s apart come 0.15 s apart: the watchdog looks in between.
    turns = Turns(**{'alarm.on_delay': 0.5})
    begin_ns = turns.ship.now.time_ns + 50_000_000
    for number in range(8):
        late_ns = number * 50_000_000
        turns.turn(*(Waits(place, late_ns=late_ns, rpm=20.0) for place in (0, 1)))
        turns.turn()
        turns.turn()
    raised = next(event for event in turns.ship.events if event.after.value == 'stick_slip')
    # By the median, 20 rpm are there from the second value on, and for the on-delay of 0.5 s.
    assert raised.time_ns - begin_ns == 600_000_000


def test_the_state_is_shown_every_second(monkeypatch: pytest.MonkeyPatch) -> None:
    turns, moments = Turns(), list[Moment]()
    monkeypatch.setattr(turns.ship.session, 'show', moments.append)
    for _ in range(100):
        turns.turn()
    gaps = [(b.steady_ns - a.steady_ns) / SECOND for a, b in pairwise(moments)]
    assert gaps == pytest.approx([1.0] * 4, abs=0.1)


@pytest.mark.parametrize('simulated', [False, True])
def test_inputs_never_received(host: Any, simulated: bool) -> None:
    timeouts = {'speed.timeout': 0.5, 'load.timeout': 0.5}
    monitor = host(kit.node_parameters(timeouts, use_sim_time=simulated))
    warnings = monitor.warnings()
    monitor.peer.until(lambda: warnings, 'the loss')
    (event,) = kit.decode_warnings(warnings)
    assert (event['from'], event['to']) == ('normal', 'input_stale')
    assert event['input_age'] == {'speed': None, 'load': None}
    assert event['regime'] is None
    if simulated:
        assert event['text'].endswith(
            'use_sim_time is set, but nothing comes on /clock: no input can be used.'
        )


def test_clock_starts_late_and_jumps(host: Any) -> None:
    timing = {'speed.timeout': 2.0, 'load.timeout': 2.0, 'alarm.on_delay': 2.0}
    monitor = host(kit.node_parameters(timing, {'alarm.off_delay': 2.0}, use_sim_time=True))
    peer, warnings, diagnostics = monitor.peer, monitor.warnings(), monitor.diagnostics()
    regimes, sensors = monitor.listen('aft/regime'), Sensors(monitor)
    run = sensors.run

    # No /clock yet: there is no time, so nothing is believed and nothing is lost.
    peer.until(sensors.sending(60.0, 1000.0, lambda: len(diagnostics) > 5), 'diagnostics')
    assert kit.latest_status(diagnostics)['reason'] == 'waiting'
    assert kit.latest_status(diagnostics)['level'] == b'\x01'
    assert kit.latest_status(diagnostics)['speed samples accepted'] == '0'
    assert not warnings
    assert not regimes

    def heard(kind: str) -> Any:
        return lambda: any(e['to'] == kind for e in kit.decode_warnings(warnings))

    now = run(1000.0, 20.0, heard('stick_slip'), 'a warning')
    event = kit.decode_warnings(warnings)[-1]
    assert 1002.0 <= event['time'] * 1e-9 <= now

    # Backward: the alarm stays, and clears after its off-delay of 2 s at the earliest.
    warnings.clear()
    now = run(100.0, 60.0, heard('normal'), 'the clearing')
    event = kit.decode_warnings(warnings)[-1]
    assert event['from'] == 'stick_slip'
    assert 102.0 <= event['time'] * 1e-9 <= now <= 115.0

    # No samples while the clock runs on, some twenty times faster than real time.
    warnings.clear()
    begin = run(now + 0.2, 20.0, lambda: True, 'a sample')
    assert run(begin, None, heard('input_stale'), 'the loss', step=1.0) - begin < 25.0
    run(now + 100.0, 20.0, lambda: 'input_stale' not in kit.decode_warnings(warnings)[-1]['to'], 'return')

    # The player has gone: a clock that stands still says nothing, the steady clock does.
    warnings.clear()
    peer.until(heard('input_stale'), 'the loss')


def test_a_clock_that_starts_late_loses_what_is_due_and_nothing_else() -> None:
    # It starts after the time-out of the speed, and before that of the load.
    from stickslip_monitor.ros.node_loop import Watchdog

    config = load_config(CONFIG)
    (bearing,) = config.bearings
    slow = replace(bearing, load=replace(bearing.load, timeout_ns=1000 * SECOND))
    ship = Ship(replace(config, bearings=(slow,)))
    watchdog, watched = Watchdog(ship.session), ship.session.monitor.bearings[bearing.name]
    seconds = 0.0
    while not watched.lost_ages() and seconds < 60.0:
        seconds += 0.1
        watchdog.tick(Moment(round(seconds * SECOND), 0), SECOND // 10)
    # Told half a second late, as on the clock of the system.
    assert seconds == pytest.approx(bearing.speed.timeout_ns / SECOND + 0.5, abs=0.3)
    assert list(watched.lost_ages()) == ['speed']
    for tenth in range(10):
        steady_ns = round(seconds * SECOND) + tenth * SECOND // 10
        watchdog.tick(Moment(steady_ns, ROS + tenth * SECOND // 10), SECOND // 10)
    assert list(watched.lost_ages()) == ['speed']


def test_a_clock_that_stands_keeps_no_input_alive_and_loses_none_when_it_goes_on() -> None:
    """Values come ten times a second; the clock moves for a second, stands for ten and goes on."""
    from stickslip_monitor.ros.node_loop import PassingTime, Watchdog

    ship = Ship(load_config(CONFIG))
    watchdog, (name,) = Watchdog(ship.session), ship.session.monitor.bearings
    watched, time_ns, lost = ship.session.monitor.bearings[name], ROS, []
    passing = PassingTime(True, Moment(0, ROS))
    for tenth in range(1, 131):
        time_ns += 0 if 10 < tenth <= 110 else SECOND // 10
        now = Moment(tenth * SECOND // 10, time_ns)
        for place, value in enumerate((60.0, 1000.0)):
            ship.session.take(name, place, time_ns, value, now)
        watchdog.note(name)
        passed_ns = passing.measure_elapsed(now)
        watchdog.tick(now._replace(time_ns=0) if passing.stands else now, passed_ns)
        lost.append(bool(watched.lost_ages()))
    # From the second of which a slow clock may stand, the time-out and what is told later.
    assert lost.index(True) == pytest.approx(
        10 + 10 * (watched.config.speed.timeout_ns / SECOND + 0.5), abs=3
    )
    assert lost[109:113] == [True, True, False, False]


ROS, TICK = 10**18, 6 * 10**8


@pytest.mark.parametrize(
    ('simulated', 'begin_ns', 'ticks'),
    [
        # On system time the steady clock counts, whatever ROS time does.
        (False, ROS, [(30, ROS + 10**12, 30), (50, 0, 50)]),
        (True, ROS, [(30, ROS + 600, 600), (40, ROS + 650, 650)]),
        # A step back counts as no time.
        (True, ROS, [(10, ROS + 500, 500), (20, ROS - 10**9, 500), (30, ROS - 10**9 + 7, 507)]),
        # While the simulated clock is unknown the steady clock counts.
        (True, 0, [(10, 0, 10), (20, ROS, 20), (30, ROS + 3, 23)]),
        # A slow one ticks each second at 0.6 of real time: between the ticks nothing counts.
        (True, ROS, [(k * SECOND // 2, ROS + k // 2 * TICK, k // 2 * TICK) for k in range(1, 9)]),
        # One that stands for more than a second does not count: the steady clock does, once.
        (
            True,
            ROS,
            [
                (SECOND, ROS, 0),
                (3 * SECOND, ROS, 3 * SECOND),
                (4 * SECOND, ROS, 4 * SECOND),
                (5 * SECOND, ROS + 5 * SECOND, 5 * SECOND),
                (6 * SECOND, ROS + 6 * SECOND, 6 * SECOND),
            ],
        ),
    ],
)
def test_time_without_samples(simulated: bool, begin_ns: int, ticks: list[tuple[int, int, int]]) -> None:
    from stickslip_monitor.ros.node_loop import PassingTime

    clock, elapsed = PassingTime(simulated, Moment(0, begin_ns)), 0
    for steady_ns, time_ns, expected in ticks:
        elapsed += clock.measure_elapsed(Moment(steady_ns, time_ns))
        assert elapsed == expected
