# SPDX-License-Identifier: Apache-2.0
"""The ship's buses beside the real node: what they bring reaches it, its alarms reach them."""

from __future__ import annotations

import socket
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml

from stickslip_monitor.links.nmea import parse, sentence

pytest.importorskip('rclpy', reason='ROS 2 is not installed')
pytest.importorskip('aiohttp', reason="the extra 'links' is not installed")


def udp() -> socket.socket:
    made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    made.bind(('127.0.0.1', 0))
    made.setblocking(False)
    return made


class Bus:
    """A talker and a display."""

    def __init__(self) -> None:
        self.display = udp()
        with udp() as probe:
            self.port = probe.getsockname()[1]
        self.alarms: dict[str, str] = {}
        self.beats: list[str] = []

    def links(self) -> dict[str, Any]:
        return {
            'nmea.listen': f'udp://127.0.0.1:{self.port}',
            'nmea.alerts': f'udp://127.0.0.1:{self.display.getsockname()[1]}',
            'nmea.accept_actions': True,
            'nmea.heartbeat': 1.0,
            'aft.speed': {'from': 'nmea', 'sentence': 'RPM', 'kind': 'S'},
            'aft.load': {'from': 'nmea', 'sentence': 'XDR', 'kind': 'N', 'name': 'AFT'},
        }

    def say(self, *bodies: str) -> None:
        for body in bodies:
            self.display.sendto(sentence(body).encode(), ('127.0.0.1', self.port))

    def listen(self) -> None:
        while True:
            try:
                parsed = parse(self.display.recv(1000).decode())
            except BlockingIOError:
                return
            assert parsed is not None
            _, formatter, fields = parsed
            if formatter == 'ALF' and fields[6]:
                self.alarms[fields[8]] = fields[6]
            elif formatter == 'HBT':
                self.beats.append(fields[1])

    def sails(self, rpm: str, condition: Callable[[], bool]) -> Callable[[], bool]:
        def look() -> bool:
            self.say(f'RCRPM,S,1,{rpm},30.0,A', 'IIXDR,N,1000,N,AFT')
            self.listen()
            return condition()

        return look


@pytest.mark.slow
def test_a_node_between_two_ends_of_a_bus(start: Any, run: Any, kit: Any, tmp_path: Path) -> None:
    changes = {'alarm.on_delay': 0.2, 'speed.timeout': 2.0, 'load.timeout': 2.0}
    monitor, bus = start(kit.parameters(changes)), Bus()
    path = tmp_path / f'{monitor.space}.yaml'
    document = yaml.safe_load(path.read_text())
    document['/stickslip_links'] = {'ros__parameters': bus.links()}
    path.write_text(yaml.safe_dump(document))
    until = monitor.peer.until
    watch = run(
        *(sys.executable, '-m', 'stickslip_monitor.cli', 'watch', '--config', str(path)),
        *('--node', monitor.name('').rstrip('/')),
        *('--diagnostics', f'/{monitor.space}/diagnostics'),
    )
    raised = bus.sails('20.0', lambda: bus.alarms.get('10002') == 'V')
    until(raised, 'the alarm')
    bus.say('BNACN,060130.00,,10002,1,A,C')
    until(bus.sails('20.0', lambda: bus.alarms.get('10002') == 'A'), 'its acknowledgement')
    assert 'aft/stick_slip: acknowledge by nmea' in monitor.output
    # An invalid speed is published as NaN: it is lost, and nothing clears.
    until(bus.sails('', lambda: bus.alarms.get('10005') == 'V'), 'the lost input')
    assert bus.alarms['10002'] == 'A'
    monitor.stop()
    bus.beats.clear()
    until(bus.sails('20.0', lambda: 'V' in bus.beats), 'the word that nobody watches')
    assert bus.alarms['10002'] == 'A'
    assert watch.stop() == 0
    assert 'Traceback' not in watch.output
