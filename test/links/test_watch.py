# SPDX-License-Identifier: Apache-2.0
"""The command on a ship without ROS: sentences in, alerts and page out, and what it refuses."""

from __future__ import annotations

import asyncio
import re
import signal
import socket
import subprocess
import sys
import time
import urllib.request
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

pytest.importorskip('aiohttp', reason="the extra 'links' is not installed")

from benchmarks.signalk_servers import SmallServer, free_port
from stickslip_monitor.cli import main
from stickslip_monitor.links.nmea import parse, sentence

DEADLINE = 60.0
# No rclpy can be imported, as on a machine without ROS.
WITHOUT_ROS = (
    "import sys; sys.modules['rclpy'] = None\n"
    'from stickslip_monitor.cli import main; sys.exit(main(sys.argv[1:]))'
)
REFERENCE = Path(__file__).resolve().parents[2] / 'launch_configs' / 'reference_bearing.yaml'
BEARING = yaml.safe_load(REFERENCE.read_text())['/**']['ros__parameters']['aft_stern'] | {
    'speed': {'unit': 'rpm', 'timeout': 2.0},
    'load': {'unit': 'N', 'timeout': 2.0},
    'alarm': {'on_delay': 0.2, 'off_delay': 0.2},
}
INPUTS = {
    'aft_stern.speed': {'from': 'nmea', 'sentence': 'RPM', 'kind': 'S'},
    'aft_stern.load': {'from': 'nmea', 'sentence': 'XDR', 'kind': 'N', 'name': 'AFTLOAD'},
}


def ship_file(folder: Path, links: dict[str, Any], **changes: Any) -> Path:
    bearing = {'ros__parameters': {'bearings': ['aft_stern'], 'aft_stern': BEARING | changes}}
    path = folder / 'ship.yaml'
    document = {'/**': bearing, '/stickslip_links': {'ros__parameters': links}}
    path.write_text(yaml.safe_dump(document))
    return path


class Watch:
    """The command in a process of its own."""

    def __init__(self, folder: Path, path: Path, *arguments: str) -> None:
        self._log = folder / 'log'
        with self._log.open('wb') as log:
            self.process = subprocess.Popen(
                [sys.executable, '-c', WITHOUT_ROS, 'watch', '-c', str(path), *arguments],
                stdout=log,
                stderr=subprocess.STDOUT,
            )

    @property
    def output(self) -> str:
        return self._log.read_text()

    def until(self, condition: Callable[[], Any], while_waiting: Callable[[], Any]) -> Any:
        end = time.monotonic() + DEADLINE
        while not (found := condition()):
            assert time.monotonic() < end, self.output
            assert self.process.poll() is None, self.output
            while_waiting()
            time.sleep(0.05)
        return found


@pytest.fixture
def watch(tmp_path: Path) -> Iterator[Callable[..., Watch]]:
    started: list[Watch] = []

    def start(path: Path, *arguments: str) -> Watch:
        started.append(Watch(tmp_path, path, *arguments))
        return started[-1]

    yield start
    for each in started:
        if each.process.poll() is None:
            each.process.send_signal(signal.SIGINT)
        each.process.wait(DEADLINE)


def test_a_ship_without_ros(watch: Callable[..., Watch], tmp_path: Path) -> None:
    display = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    display.bind(('127.0.0.1', 0))
    display.setblocking(False)
    port = free_port()
    links = {
        'nmea.listen': f'udp://127.0.0.1:{port}',
        'nmea.alerts': f'udp://127.0.0.1:{display.getsockname()[1]}',
        'nmea.accept_actions': True,
    }
    state_file = {'state_file': str(tmp_path / 'alarms.json')}
    path = ship_file(tmp_path, links | INPUTS)
    document = yaml.safe_load(path.read_text())
    document['/**']['ros__parameters'] |= state_file
    path.write_text(yaml.safe_dump(document))
    ship = watch(path, '--port', '0')
    got: list[list[str]] = []

    def listen() -> None:
        while True:
            try:
                got.append((parse(display.recv(1000).decode()) or ('', '', []))[2])
            except BlockingIOError:
                return

    def sail(rpm: str) -> Callable[[], None]:
        def say() -> None:
            listen()
            for body in (f'RCRPM,S,1,{rpm},30.0,A', 'IIXDR,N,1000,N,AFTLOAD'):
                display.sendto(f'{sentence(body)}\r\n'.encode(), ('127.0.0.1', port))

        return say

    def states() -> dict[str, str]:
        """The newest state of each alert, by identifier."""
        return {fields[8]: fields[6] for fields in got if len(fields) == 13 and fields[6]}

    page = ship.until(lambda: re.search(r'Dashboard on (\S+)\n', ship.output), lambda: None)[1]
    ship.until(lambda: states().get('10002') == 'V', sail('20.0'))
    acknowledge = sentence('BNACN,060130.00,,10002,1,A,C').encode()
    display.sendto(acknowledge, ('127.0.0.1', port))
    ship.until(lambda: states().get('10002') == 'A', sail('20.0'))
    # The talker says that it knows no speed: no rest, and nothing clears.
    ship.until(lambda: states().get('10005') == 'V', sail(''))
    assert states()['10002'] == 'A'

    def metrics() -> str:
        found: bytes = urllib.request.urlopen(f'{page}metrics', timeout=10.0).read()
        return found.decode()

    # The alert goes out before the record of the bearing.
    ship.until(lambda: 'condition="input_stale",namespace="/"} 1.0' in metrics(), sail(''))
    assert 'stickslip_link_up{link="nmea_in"} 1.0' in metrics()
    assert 'aft_stern: Input speed lost: no valid value on NMEA RPM S 1 for' in ship.output
    ship.process.send_signal(signal.SIGINT)
    assert ship.process.wait(DEADLINE) == 0
    listen()
    assert got[-1][1] == 'V'  # the last heartbeat says that nobody watches any more
    display.close()
    assert 'Traceback' not in ship.output
    assert (tmp_path / 'alarms.json').exists()


def refusal(path: Path, *arguments: str) -> str:
    """The one line that the command ends with."""
    done = subprocess.run(
        [sys.executable, '-c', WITHOUT_ROS, 'watch', '-c', str(path), *arguments],
        capture_output=True,
        text=True,
        timeout=DEADLINE,
    )
    lines = [line for line in done.stderr.splitlines() if line.startswith('ERROR: ')]
    assert (done.returncode, len(lines)) == (2, 1), (done.stdout, done.stderr)
    assert 'Traceback' not in done.stderr
    return lines[0]


def refused(capsys: pytest.CaptureFixture[str], path: Path, *arguments: str) -> str:
    """The same in this process, which is quicker."""
    assert main(['watch', '-c', str(path), *arguments]) == 2
    (line,) = [x for x in capsys.readouterr().err.splitlines() if x.startswith('ERROR: ')]
    return line


def test_what_it_refuses(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    links = {'nmea.listen': f'udp://127.0.0.1:{free_port()}'} | INPUTS
    topics = {q: BEARING[q] | {'topic': f'/{q}'} for q in ('speed', 'load')}
    path = ship_file(tmp_path, links, **topics)
    assert 'ROS 2 is not available' in refusal(path, '--node')
    assert '--port 70000 must be from 0 to 65535' in refused(capsys, path, '--port', '70000')
    assert '--request-token needs signalk.url and signalk.token_file' in refused(
        capsys, path, '--request-token'
    )
    with socket.socket() as other:
        other.bind(('127.0.0.1', 0))
        other.listen()
        port = other.getsockname()[1]
        assert f'cannot listen at 127.0.0.1 port {port}' in refused(
            capsys, path, '--port', f'{port}'
        )
    level = ship_file(tmp_path, links, level={'topic': '/v'})
    assert 'without --node only speed and load come from a bus' in refused(capsys, level)


@pytest.mark.slow
def test_what_a_server_or_its_token_ends(tmp_path: Path) -> None:
    token = tmp_path / 'token'

    async def work() -> None:
        server = SmallServer()
        server.token = 'a-token-of-the-server'
        await server.start()
        links = {
            'signalk.url': f'http://127.0.0.1:{server.port}',
            'signalk.token_file': str(token),
        }
        inputs = {
            'aft_stern.speed': {'from': 'signalk', 'path': 'propulsion.port.revolutions'},
            'aft_stern.load': {'from': 'signalk', 'path': 'a.load'},
        }
        path = ship_file(tmp_path, links | inputs, speed={'unit': 'Hz'})
        said = await asyncio.to_thread(refusal, path)
        assert f"token file '{token}' cannot be read: No such file or directory" in said
        token.write_text('a-wrong-token-of-somebody')
        token.chmod(0o640)
        assert 'can be read by others: chmod 600 it' in await asyncio.to_thread(refusal, path)
        token.chmod(0o600)
        assert 'the token is refused' in await asyncio.to_thread(refusal, path)
        # Another is asked for, which an officer approves.
        done = await asyncio.to_thread(
            subprocess.run,
            [sys.executable, '-c', WITHOUT_ROS, 'watch', '-c', str(path), '--request-token'],
            timeout=DEADLINE,
        )
        assert done.returncode == 0
        assert token.read_text() == 'eyJ.a.token.of.the.server\n'
        assert token.stat().st_mode & 0o777 == 0o600
        await server.stop()

    asyncio.run(work())


def test_a_frozen_server_does_not_keep_it(watch: Callable[..., Watch], tmp_path: Path) -> None:
    async def work() -> None:
        server = SmallServer()
        await server.start()
        links = {'signalk.url': f'http://127.0.0.1:{server.port}', 'signalk.prefix': 'p.shaft'}
        inputs = {
            'aft_stern.speed': {'from': 'signalk', 'path': 'propulsion.port.revolutions'},
            'aft_stern.load': {'from': 'signalk', 'path': 'a.load'},
        }
        ship = watch(ship_file(tmp_path, links | inputs, speed={'unit': 'Hz'}))
        end = time.monotonic() + DEADLINE
        while 'signalk_out: works' not in ship.output:
            assert time.monotonic() < end, ship.output
            await asyncio.sleep(0.05)
        # The server shares this thread, which now waits for nothing but the end.
        ship.process.send_signal(signal.SIGINT)
        assert ship.process.wait(DEADLINE) == 0
        assert 'Traceback' not in ship.output
        assert 'exception' not in ship.output
        await server.stop()

    asyncio.run(work())
