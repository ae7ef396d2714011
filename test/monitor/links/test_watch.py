# SPDX-License-Identifier: Apache-2.0
"""The command on a ship without ROS: sentences in, alerts and page out, and what it refuses."""

from __future__ import annotations

import asyncio
import io
import itertools
import logging
import re
import signal
import socket
import string
import subprocess
import sys
import time
import urllib.request
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from shared import CONFIG, DEADLINE, Bus, Program

pytest.importorskip('aiohttp', reason="the extra 'links' is not installed")

from benchmarks.signalk_servers import SmallServer
from stickslip_monitor.cli import main
from stickslip_monitor.commands.watch import LinkStates, load_watch, without_copies
from stickslip_monitor.links.live_monitor import LiveMonitor
from stickslip_monitor.monitor.sample_types import Input
from stickslip_monitor.monitor.session import NoLog, Sink

# No rclpy can be imported, as on a machine without ROS.
WITHOUT_ROS = (
    "import sys; sys.modules['rclpy'] = None\n"
    'from stickslip_monitor.cli import main; sys.exit(main(sys.argv[1:]))'
)
BEARING = yaml.safe_load(CONFIG.read_text())['/**']['ros__parameters']['aft_stern'] | {
    'speed': {'unit': 'rpm', 'timeout': 2.0},
    'load': {'unit': 'N', 'timeout': 2.0},
    'alarm': {'on_delay': 0.2, 'off_delay': 0.2},
}


def ship_file(folder: Path, links: dict[str, Any], **changes: Any) -> Path:
    bearing = {'ros__parameters': {'bearings': ['aft_stern'], 'aft_stern': BEARING | changes}}
    path = folder / 'ship.yaml'
    document = {'/**': bearing, '/stickslip_links': {'ros__parameters': links}}
    path.write_text(yaml.safe_dump(document))
    return path


@pytest.fixture
def watch(tmp_path: Path) -> Iterator[Callable[..., Program]]:
    started: list[Program] = []

    def start(path: Path, *arguments: str) -> Program:
        command = [sys.executable, '-c', WITHOUT_ROS, 'watch', '-c', str(path), *arguments]
        started.append(Program(command, tmp_path / 'log'))
        return started[-1]

    yield start
    for program in started:
        program.end()


@pytest.fixture
def manager(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[socket.socket]:
    """Yield the socket of a service manager, which wants to hear of a program twice a second."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(str(tmp_path / 'notify'))
        manager.settimeout(DEADLINE)
        monkeypatch.setenv('NOTIFY_SOCKET', str(tmp_path / 'notify'))
        monkeypatch.setenv('WATCHDOG_USEC', '1000000')
        yield manager


def test_a_ship_without_ros(watch: Callable[..., Program], manager: socket.socket, tmp_path: Path) -> None:
    bus, alarm = Bus(), BEARING['alarm'] | {'amplitude_limit': 0.9}  # meant in mm
    path = ship_file(tmp_path, bus.links('aft_stern'), alarm=alarm)
    document = yaml.safe_load(path.read_text())
    state_file = tmp_path / 'alarms.json'
    state_file.write_bytes(bytes(99))  # as a power cut leaves it
    document['/**']['ros__parameters']['state_file'] = str(state_file)
    path.write_text(yaml.safe_dump(document))
    ship = watch(path, '--port', '0')
    assert [manager.recv(100) for _ in range(3)] == [b'READY=1', *[b'WATCHDOG=1'] * 2]
    page = ship.until(lambda: re.search(r'Dashboard on (\S+)\n', ship.output))[1]
    ship.until(bus.sails('20.0', lambda: bus.alarms.get('10002') == 'V'))
    bus.say('BNACN,060130.00,,10002,1,A,C')
    ship.until(bus.sails('20.0', lambda: bus.alarms.get('10002') == 'A'))
    # The talker says that it knows no speed: no rest, and nothing clears.
    ship.until(bus.sails('', lambda: bus.alarms.get('10005') == 'V'))
    assert bus.alarms['10002'] == 'A'

    def metrics() -> str:
        text: bytes = urllib.request.urlopen(f'{page}metrics', timeout=DEADLINE).read()
        return text.decode()

    # The alert goes out before the record of the bearing.
    stale = 'condition="input_stale",namespace="/"} 1.0'
    ship.until(bus.sails('', lambda: stale in metrics()))
    assert 'stickslip_link_up{link="nmea_in"} 1.0' in metrics()
    assert main(['health', '--page', page]) == 0
    ship.until(lambda: 'aft_stern: Input speed lost: no valid value on NMEA RPM S 1 for' in ship.output)
    assert f'state_file {state_file} is damaged: ' in ship.output
    assert 'load may move the lining by 0.9 m: is alarm.amplitude_limit in metres?' in ship.output
    # The file cannot be written: log and page say so.
    state_file.unlink()
    state_file.mkdir()
    fault = 'the alarms are not kept: Is a directory'
    ship.until(bus.sails('20.0', lambda: fault in ship.output))
    with urllib.request.urlopen(f'{page}events', timeout=DEADLINE) as stream:
        assert fault in next(line.decode() for line in stream if line.startswith(b'data: '))
    state_file.rmdir()
    assert 'is in use by another monitor' in refusal_of_watch(path)
    assert ship.stop(signal.SIGHUP) == 0  # as when its terminal goes
    assert main(['health', '--page', page]) == 2
    bus.listen()
    assert bus.beats[-1] == 'V'  # nobody watches any more
    assert 'Traceback' not in ship.output
    assert state_file.is_file()


@pytest.mark.parametrize(
    ('load', 'text'),
    [
        ({'constant': 1, 'unit': 'kN'}, 'Now 20 rpm, 1 kN (assumed)'),
        ({'over_speed': [[0, 2], [40, 1]], 'unit': 'kN'}, 'Now 20 rpm, 1.5 kN (from the alignment table)'),
    ],
)
def test_an_assumed_load_needs_no_bus(load: dict[str, Any], text: str, tmp_path: Path) -> None:
    links, records = Bus().links('aft_stern'), list[dict[str, Any]]()
    del links['aft_stern.load']
    path = ship_file(tmp_path, links, load=load)

    class Records(Sink):
        def take_record(self, record: dict[str, Any]) -> None:
            records.append(record)

    live = LiveMonitor(load_watch(str(path), None)[0], Records(), NoLog())
    live.begin()
    live.take('aft_stern', Input.SPEED, 20.0)
    live.tick()
    assert text in records[-1]['text']


def refusal_of_watch(path: Path, *arguments: str) -> str:
    """Return the error line that the command ends with."""
    completed = subprocess.run(
        [sys.executable, '-c', WITHOUT_ROS, 'watch', '-c', str(path), *arguments],
        capture_output=True,
        text=True,
        timeout=DEADLINE,
    )
    lines = [line for line in completed.stderr.splitlines() if line.startswith('ERROR: ')]
    assert (completed.returncode, len(lines)) == (2, 1), (completed.stdout, completed.stderr)
    assert 'Traceback' not in completed.stderr
    return lines[0]


def test_files_and_options_that_watch_refuses(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    links = Bus().links('aft_stern')
    topics = {q: BEARING[q] | {'topic': f'/{q}'} for q in ('speed', 'load')}
    path = ship_file(tmp_path, links, **topics)
    assert 'ROS 2 is not available' in refusal_of_watch(path, '--node')
    with socket.socket() as listener:
        listener.bind(('127.0.0.1', 0))
        listener.listen()
        port = str(listener.getsockname()[1])
        for arguments, words in (
            (['--request-token'], '--request-token needs signalk.url and signalk.token_file'),
            (['--port', port], f'cannot listen at 127.0.0.1 port {port}'),
        ):
            assert main(['watch', '-c', str(path), *arguments]) == 2
            assert words in capsys.readouterr().err
    level = ship_file(tmp_path, links, level={'topic': '/v'})
    assert main(['watch', '-c', str(level)]) == 2
    assert 'without --node only speed and load come from a bus' in capsys.readouterr().err


def signalk_ship(folder: Path, server: SmallServer, **more: str) -> Path:
    links = {
        'signalk.url': f'http://127.0.0.1:{server.port}',
        'aft_stern.speed': {'from': 'signalk', 'path': 'propulsion.port.revolutions'},
        'aft_stern.load': {'from': 'signalk', 'path': 'a.load'},
    }
    links |= {f'signalk.{key}': value for key, value in more.items()}
    return ship_file(folder, links, speed={'unit': 'Hz'})


@pytest.mark.slow
async def test_a_bad_token_ends_watch_and_a_new_one_is_requested(server: SmallServer, tmp_path: Path) -> None:
    token = tmp_path / 'token'
    server.token = 'a-token-of-the-server'
    path = signalk_ship(tmp_path, server, token_file=str(token))
    refusal = await asyncio.to_thread(refusal_of_watch, path)
    assert f"token file '{token}' cannot be read: No such file or directory" in refusal
    token.write_text('a.wrong-token.of-somebody')
    token.chmod(0o640)
    assert 'can be read by others: chmod 600 it' in await asyncio.to_thread(refusal_of_watch, path)
    token.chmod(0o600)
    assert 'the token is refused' in await asyncio.to_thread(refusal_of_watch, path)
    # Another is asked for, which an officer approves.
    command = [sys.executable, '-c', WITHOUT_ROS, 'watch', '-c', str(path), '--request-token']
    completed = await asyncio.to_thread(subprocess.run, command, timeout=DEADLINE)
    assert completed.returncode == 0
    assert token.read_text() == 'eyJ.a.token.of.the.server\n'
    assert token.stat().st_mode & 0o777 == 0o600


async def test_a_frozen_server_does_not_keep_it(
    server: SmallServer, watch: Callable[..., Program], tmp_path: Path
) -> None:
    ship = watch(signalk_ship(tmp_path, server, prefix='p.shaft'))
    await asyncio.to_thread(ship.until, lambda: 'signalk_out: works' in ship.output)
    # The server shares this thread, which now waits for nothing but the end.
    assert ship.stop(signal.SIGHUP) == 0
    assert 'Traceback' not in ship.output
    assert 'exception' not in ship.output


def test_a_link_that_comes_and_goes_is_logged_once_in_five_minutes(caplog: pytest.LogCaptureFixture) -> None:
    now = [0.0]
    links: dict[str, bool] = {}
    states = LinkStates(links, lambda: now[0])
    with caplog.at_level('INFO'):
        for now[0] in range(0, 301, 30):
            states.report('nmea_out', False, 'Connection refused')
            states.report('nmea_out', None, 'unknown')
    assert [record.message for record in caplog.records] == [
        'nmea_out: Connection refused',
        'nmea_out: unknown',
    ] * 2  # at 0 and at 300 s
    assert links == {}
    states.report('nmea_out', True, '')
    assert links == {'nmea_out': True}


def test_copies_are_not_published_where_no_stamp_is_seen(caplog: pytest.LogCaptureFixture) -> None:
    published: list[float] = []
    take = without_copies(
        lambda _, __, value: published.append(value), logging.getLogger('stickslip_monitor')
    )
    for value, stamp in ((1.0, 5), (1.0, 5), (1.0, 5), (1.1, 5), (1.1, 6), (1.1, None), (1.1, None)):
        take('aft', Input.SPEED, value, stamp)
    assert published == [1.0, 1.1, 1.1, 1.1, 1.1]
    (record,) = caplog.records
    assert record.message.startswith('speed of aft: the sender repeats stamp and value')


@pytest.mark.parametrize(
    ('figures', 'code', 'expected'),
    [
        ('stickslip_monitor_up{namespace="/"} 1.0\nstickslip_link_up{link="nmea_in"} 1.0', 0, 'Monitoring.'),
        ('stickslip_monitor_up{namespace="/"} 0.0', 1, 'not working: monitor /'),
        (
            'stickslip_monitor_up{namespace="/"} 1.0\nstickslip_link_up{link="nmea_in"} 0.0',
            1,
            'not working: link nmea_in',
        ),
        ('<html>', 1, 'not working: no monitor is on the page'),
    ],
)
def test_health_by_a_page(
    figures: str,
    code: int,
    expected: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(urllib.request, 'urlopen', lambda *_, **__: io.BytesIO(figures.encode()))
    assert main(['health', '--page', 'http://127.0.0.1:1']) == code
    assert capsys.readouterr().out == f'{expected}\n'


@pytest.mark.slow
def test_a_log_that_nobody_reads_stops_nothing(tmp_path: Path) -> None:
    """Print a line for each of 1,296 talkers, more than a pipe of 64 kB holds."""
    bus = Bus()
    path = str(ship_file(tmp_path, bus.links('aft_stern')))
    letters = string.ascii_uppercase + string.digits
    talkers = [f'{a}{b}RPM,S,1,50.0,,A' for a in letters for b in letters]
    command = [sys.executable, '-c', WITHOUT_ROS, 'watch', '-c', path]
    with subprocess.Popen(command, stderr=subprocess.PIPE) as ship:

        def sails(condition: Callable[[], Any], *more: Iterable[str]) -> None:
            look, end = bus.sails('20.0', condition), time.monotonic() + DEADLINE
            for bodies in itertools.chain(more, itertools.repeat(())):
                bus.say(*bodies)
                if look() and not bodies:
                    return
                assert time.monotonic() < end
                time.sleep(0.02)

        try:
            sails(lambda: bus.alarms.get('10002') == 'V')
            sails(lambda: True, *(talkers[k : k + 8] for k in range(0, len(talkers), 8)))
            bus.beats.clear()
            sails(lambda: len(bus.beats) > 1)
            ship.send_signal(signal.SIGINT)
            assert ship.wait(DEADLINE) == 0
        finally:
            ship.kill()
    bus.listen()
    assert bus.beats[-1] == 'V'
