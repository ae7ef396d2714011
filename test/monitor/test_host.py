# SPDX-License-Identifier: Apache-2.0
"""Clocks that are set, slewed, or stand still while the machine sleeps; a log that nobody reads."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
from sending import SECOND, T0, Ship, configured

from stickslip_monitor.host import HostClock, ServiceManager
from stickslip_monitor.links.live_monitor import LiveMonitor
from stickslip_monitor.monitor.alarm_list import Action
from stickslip_monitor.monitor.sample_types import Input
from stickslip_monitor.monitor.session import NoLog, Sink

DAY = 86_400 * SECOND


def test_a_step_of_the_clock_is_found_and_a_slew_is_not() -> None:
    steady, wall = 0, T0
    clock = HostClock(lambda: steady, lambda: wall)
    times = []
    for set_ns in (0, 3600 * SECOND, 0, -DAY, 0):
        for _ in range(1000):
            steady += SECOND
            wall += SECOND + 500_000  # NTP slews by half a millisecond a second
        wall += set_ns
        times.append(clock.now().set_ns)
    steps = [later - earlier for earlier, later in zip([0, *times], times, strict=False)]
    # The slew of the thousand seconds before, half a second, is told with the step after it.
    assert [round(step / SECOND) for step in steps] == [0, 3600, 0, -86400, 0]


@pytest.mark.parametrize(
    ('days', 'stamp'),
    [
        (300, 'forward by 300 days'),
        (-300, 'back by 300 days'),
        (0.01, 'forward by 14.4 min'),
        (0.5, '12.0 h'),
    ],
)
def test_an_alarm_has_the_time_of_the_clock_when_it_comes(days: float, stamp: str) -> None:
    ship = Ship(configured())
    ship.sail(20.0)
    ship.ahead_ns += round(days * DAY)
    ship.sail(20.0, rpm=20.0)
    since = {event.after.value: event.time_ns for event in ship.events}
    assert set(since) == {'caution', 'bistable', 'stick_slip'} or set(since) == {'stick_slip'}
    assert ship.now.time_ns - 20 * SECOND < since['stick_slip'] < ship.now.time_ns
    alarms = {a['alarm']: a for a in ship.published[-1]['alarms']}
    assert alarms['stick_slip']['since'] == since['stick_slip']
    (note,) = [line for line in ship.lines if 'clock was set' in line]
    assert stamp in note
    # The record on the page and in the file, too.
    assert abs(ship.look()['time'] - ship.now.time_ns) < SECOND


@pytest.mark.parametrize('days', [300, -300])
def test_no_delay_is_shorter_or_longer_for_a_step(days: int) -> None:
    """Neither those of an onset, nor the time-out of an input, nor a shelf."""
    notes = []
    for step in (0, days * DAY):
        ship = Ship(configured())
        ship.sail(10.0)
        ship.sail(1.0, rpm=20.0)  # growth has begun
        ship.ahead_ns += step
        ship.sail(20.0, rpm=20.0)
        ship.does(Action.SHELVE)
        ship.ahead_ns -= step
        ship.sail(20.0, rpm=None)  # the input is lost
        ship.sail(1.0, rpm=20.0)
        (until,) = {a['shelved_until'] for a in ship.published[-1]['alarms']} - {None}
        assert until == ship.now.time_ns - 21 * SECOND + ship.config.shelve_time_ns
        while ship.states().get('stick_slip') == 'shelved':
            ship.sail(10.0, rpm=20.0, rate=1.0)
        notes.append(([event.after for event in ship.events], ship.steady_ns))
    assert notes[0] == notes[1]


def test_after_a_sleep_of_the_machine_no_input_is_lost() -> None:
    # Its own time goes on while it sleeps: the shelf ends, and nobody could have listened.
    ship = Ship(configured())
    ship.sail(20.0, rpm=20.0)
    ship.does(Action.SHELVE)
    event_count = len(ship.events)
    ship.steady_ns += 8 * 3600 * SECOND
    ship.session.discount_stall(8 * 3600 * SECOND)
    ship.tick()
    assert ship.events[event_count:] == []
    assert ship.states()['stick_slip'] == 'unacknowledged'
    assert not any('clock was set' in line for line in ship.lines)


class Wall(Sink):
    """A display, and the clocks of a machine."""

    def __init__(self) -> None:
        self.steady_ns, self.ahead_ns = 0, T0
        self.lists: list[dict[str, Any]] = []
        self.records: list[dict[str, Any]] = []
        clock = HostClock(lambda: self.steady_ns, lambda: self.steady_ns + self.ahead_ns)
        self.live = LiveMonitor(configured(), self, NoLog(), clock=clock)
        self.live.begin()

    def take_alarms(self, record: dict[str, Any]) -> None:
        self.lists.append(record)

    def take_record(self, record: dict[str, Any]) -> None:
        self.records.append(record)

    def sail(self, seconds: float, rpm: float | None) -> None:
        for _ in range(round(10 * seconds)):
            self.steady_ns += SECOND // 10
            if rpm is not None:
                self.live.take('aft', Input.SPEED, rpm)
                self.live.take('aft', Input.LOAD, 1000.0)
            self.live.tick()

    def active(self) -> dict[str, int]:
        return {a['alarm']: a['since'] for a in self.lists[-1]['alarms'] if a['active']}


@pytest.mark.parametrize('days', [-300, 0, 300])
@pytest.mark.parametrize('waited', [False, True])
def test_watch_follows_the_clock_and_forgives_itself_a_hold_up(days: int, waited: bool) -> None:
    """Deliver waiting messages before the late look, or after it."""
    wall = Wall()
    wall.sail(10.0, 60.0)
    wall.ahead_ns += days * DAY
    wall.sail(10.0, 20.0)
    since = wall.active()['stick_slip']
    assert wall.steady_ns + wall.ahead_ns - 10 * SECOND < since < wall.steady_ns + wall.ahead_ns
    wall.steady_ns += 60 * SECOND
    if waited:
        wall.live.take('aft', Input.SPEED, 20.0)
    wall.live.tick()
    assert 'input_lost' not in wall.active()
    wall.sail(4.0, None)
    assert 'input_lost' not in wall.active()
    wall.sail(3.0, None)  # the time-out of 5 s
    assert 'input_lost' in wall.active()


PROGRAM = """
import sys
from stickslip_monitor.host import unblocked_log
with unblocked_log():
    for k in range(int(sys.argv[1])):
        print(f'line {k:>100}', file=sys.stderr)
        sys.stderr.flush()
"""


def test_a_reader_that_stops_costs_lines_and_no_time() -> None:
    # The pipe holds 64 KiB (pipe(7)); 5 000 lines are eight of them.
    reader, writer = os.pipe()
    with os.fdopen(reader, 'rb') as pipe:
        program = subprocess.Popen([sys.executable, '-c', PROGRAM, '5000'], stderr=writer)
        os.close(writer)
        assert program.wait(60.0) == 0
        lines = pipe.read().decode().splitlines()
    assert 0 < len(lines) < 5_000
    assert lines[0].split() == ['line', '0']


def test_a_reader_that_comes_back_reads_how_much_is_lost() -> None:
    reader, writer = os.pipe()
    done, say = os.pipe()
    wait, go = os.pipe()
    text = f"""{PROGRAM}
    import os
    os.write({say}, b'.')
    os.read({wait}, 1)
    print('the end', file=sys.stderr)
"""
    command = [sys.executable, '-c', text, '5000']
    program = subprocess.Popen(command, stderr=writer, pass_fds=(say, wait))
    os.close(writer)
    os.read(done, 1)
    os.write(go, b'.')
    with os.fdopen(reader, 'rb') as pipe:
        lines = pipe.read().decode().splitlines()
    assert program.wait(60.0) == 0
    # More may be lost while that of the first is told.
    notes = [line for line in lines if line.endswith('of the log are lost: nobody read them]')]
    lost = sum(int(line[1:].split()[0]) for line in notes)
    assert lost + sum(line.startswith('line ') for line in lines) == 5_000
    assert lost > 0
    assert lines[-1] == 'the end'


def test_without_standard_error_there_is_one() -> None:
    command = [sys.executable, '-c', PROGRAM, '3']
    done = subprocess.run(command, preexec_fn=lambda: os.close(2), check=False)
    assert done.returncode == 0


@pytest.mark.parametrize(('limit', 'beats'), [('', 0), ('2000000', 3)])
def test_a_watchdog_is_notified_twice_in_its_period(
    limit: str, beats: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    now = 100.0
    monkeypatch.setenv('NOTIFY_SOCKET', str(tmp_path / 'notify'))
    monkeypatch.setenv('WATCHDOG_USEC', limit)
    monkeypatch.setattr(time, 'monotonic', lambda: now)
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as inbox:
        inbox.bind(str(tmp_path / 'notify'))
        manager = ServiceManager()
        for _ in range(8):  # 3.5 s, from the start on
            manager.beat()
            now += 0.5
        manager.notify('STOPPING=1')
        messages = [inbox.recv(100)]
        while messages[-1] != b'STOPPING=1':
            messages.append(inbox.recv(100))
    assert messages == [*[b'WATCHDOG=1'] * beats, b'STOPPING=1']
