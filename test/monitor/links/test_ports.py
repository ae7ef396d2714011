# SPDX-License-Identifier: Apache-2.0
"""Ports over real sockets and a pseudo-terminal: lines both ways, and every way to end."""

from __future__ import annotations

import asyncio
import logging
import math
import os
import pty
import re
import socket
import termios
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from shared import wait_until

from stickslip_monitor.errors import LinkError
from stickslip_monitor.links import nmea_client
from stickslip_monitor.links.links_config import BusInput, NmeaLink
from stickslip_monitor.links.live_monitor import MonitorSide
from stickslip_monitor.links.nmea import format_sentence
from stickslip_monitor.links.nmea_client import NmeaClient, Port
from stickslip_monitor.monitor.sample_types import Input

RPM = format_sentence('RCRPM,S,1,74.6,30.0,A')


@pytest.fixture(autouse=True)
def at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(nmea_client, 'AGAIN', 0.02)


def test_a_group_is_joined_on_every_interface() -> None:
    """Receive what is sent to a group, on the interface of this machine too."""
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as listener,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender,
    ):
        listener.bind(('', 0))
        listener.settimeout(10.0)
        nmea_client._join_group(listener, '239.192.0.7')
        sender.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton('127.0.0.1'))
        sender.sendto(RPM.encode(), ('239.192.0.7', listener.getsockname()[1]))
        assert listener.recv(100).decode() == RPM


class End:
    """A port under test, and what came of it."""

    def __init__(self, address: str, listens: bool = True, silent: float = 60.0) -> None:
        self.lines: list[str] = []
        self.states: list[bool | None] = []
        self.reasons: list[str] = []
        self.port = Port('nmea.listen', address, self.lines.append, self.report_state, listens, silent)

    def report_state(self, up: bool | None, reason: str) -> None:
        if self.states[-1:] != [up]:
            self.states.append(up)
        self.reasons.append(reason)


def bind_udp(port: int = 0) -> socket.socket:
    """Return a socket of the test at this machine."""
    created = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    created.bind(('127.0.0.1', port))
    created.setblocking(False)
    return created


def free_port() -> int:
    with bind_udp() as probe:
        return int(probe.getsockname()[1])


async def at_work(port: Port) -> None:
    await port.start()
    asyncio.get_running_loop().create_task(port.run())


async def test_datagrams_in_with_or_without_an_end_of_line() -> None:
    number = free_port()
    end = End(f'udp://127.0.0.1:{number}')
    await at_work(end.port)
    assert end.states == []  # open, but nothing is known of a sender
    with bind_udp() as talker:
        talker.sendto(RPM.encode(), ('127.0.0.1', number))
        talker.sendto(f'{RPM}\r\n{RPM}\r\n'.encode(), ('127.0.0.1', number))
        await wait_until(lambda: len(end.lines) == 3)
    assert {line.strip() for line in end.lines} == {RPM}
    assert end.states == [True]


async def test_datagrams_to_a_receiver_that_starts_late() -> None:
    number = free_port()
    end = End(f'udp://127.0.0.1:{number}', listens=False, silent=math.inf)
    await at_work(end.port)
    end.port.send([RPM])
    await wait_until(lambda: False in end.states, lambda: end.reasons)
    assert end.reasons[-1] == 'Connection refused'
    with bind_udp(number) as display:
        # That nobody refuses a datagram does not say that somebody takes it.
        await wait_until(lambda: end.states == [None, False, None])
        end.port.send([RPM, RPM])
        datagrams: list[bytes] = []
        while len(datagrams) < 2:
            datagrams.append(await asyncio.get_running_loop().sock_recv(display, 1000))
    assert datagrams == [f'{RPM}\r\n'.encode()] * 2


async def test_a_stream_that_comes_late_ends_and_comes_back() -> None:
    talkers: list[asyncio.StreamWriter] = []
    received: list[bytes] = []

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        talkers.append(writer)
        received.append(await reader.readline())

    number = free_port()
    end = End(f'tcp://127.0.0.1:{number}')
    await at_work(end.port)
    await wait_until(lambda: end.states == [False])
    end.port.send([RPM])  # lost, as there is nobody
    server = await asyncio.start_server(serve, '127.0.0.1', number)
    await wait_until(lambda: talkers)
    talkers[0].write(b'x' * 5000 + f'\r\n{RPM[:10]}'.encode())
    await wait_until(lambda: end.port.stream._rest)
    talkers[0].write(f'{RPM[10:]}\r\n'.encode())
    await wait_until(lambda: RPM in [line.strip() for line in end.lines])
    end.port.send([RPM])
    await wait_until(lambda: received == [f'{RPM}\r\n'.encode()])
    talkers[0].close()
    await wait_until(lambda: len(talkers) == 2)
    assert end.states == [False, True, False]  # connected again, but silent
    talkers[1].write(f'{RPM}\r\n'.encode())
    await wait_until(lambda: end.states == [False, True, False, True])
    server.close()


async def test_lines_that_the_other_end_does_not_take_are_dropped() -> None:
    """Connect a display that hangs: the system takes some megabytes for it, and then a part of a line."""
    with socket.create_server(('127.0.0.1', 0)) as display:
        end = End(f'tcp://127.0.0.1:{display.getsockname()[1]}', silent=math.inf)
        await at_work(end.port)
        await wait_until(lambda: end.states == [True])
        end.port.send([RPM * 1000] * 1000)
        await wait_until(
            lambda: end.reasons[-1] == 'the other end does not take what is sent', lambda: end.reasons
        )


async def test_a_serial_line_that_vanishes_and_comes_back(tmp_path: Path) -> None:
    ours, theirs = pty.openpty()
    device = tmp_path / 'tty'
    device.symlink_to(os.ttyname(theirs))
    # Whoever had the line before left two stop bits and waits for the modem.
    former = termios.tcgetattr(theirs)
    former[2] |= termios.CSTOPB | termios.CRTSCTS
    termios.tcsetattr(theirs, termios.TCSANOW, former)
    end = End(f'serial://{device}?baud=38400')
    await at_work(end.port)
    configured = termios.tcgetattr(theirs)
    assert configured[2] & (termios.CSTOPB | termios.CRTSCTS | termios.CSIZE) == termios.CS8
    assert configured[4:6] == [termios.B38400] * 2
    os.write(ours, f'{RPM}\r\n'.encode())
    await wait_until(lambda: end.lines)
    end.port.send([RPM])
    assert os.read(ours, 1000) == f'{RPM}\r\n'.encode()
    device.unlink()
    os.close(theirs)
    os.close(ours)
    await wait_until(lambda: end.states == [True, False], lambda: end.reasons)
    ours, theirs = pty.openpty()
    device.symlink_to(os.ttyname(theirs))
    await wait_until(lambda: os.write(ours, f'{RPM}\r\n'.encode()) and end.states == [True, False, True])
    os.close(theirs)
    os.close(ours)


async def test_silence_is_a_fault_where_lines_are_expected() -> None:
    listens = End(f'udp://127.0.0.1:{free_port()}', silent=0.1)
    sends = End(f'udp://127.0.0.1:{free_port()}', listens=False, silent=math.inf)
    await at_work(listens.port)
    await at_work(sends.port)
    await wait_until(lambda: listens.states == [False])
    assert listens.reasons[-1] == 'no data for 0.1 s'
    assert sends.states == [None]  # nobody answers a datagram


async def test_silence_is_no_fault_of_a_link_for_acknowledgements_alone(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(nmea_client, 'SILENT', 0.05)
    states: list[Any] = []
    log = logging.getLogger('test')
    side = MonitorSide(['aft'], print, print, lambda *state: states.append(state), log)
    client = NmeaClient(NmeaLink(f'udp://127.0.0.1:{free_port()}', accept_actions=True), [], side)
    await client.open_ports()
    asyncio.get_running_loop().create_task(client.run())
    await asyncio.sleep(0.2)
    assert states == [('nmea_in', True, '')]


async def test_an_address_that_cannot_be_opened_at_the_start_is_an_error(tmp_path: Path) -> None:
    no_line = tmp_path / 'file'
    no_line.touch()
    with bind_udp() as occupier:
        occupied = f'udp://127.0.0.1:{occupier.getsockname()[1]}'
        for address, reason in (
            (occupied, 'Address already in use'),
            (f'serial://{tmp_path}/none', 'No such file or directory'),
            (f'serial://{no_line}', 'it is not a serial line'),
        ):
            text = f"nmea.listen = '{address}' cannot be opened: {reason}"
            with pytest.raises(LinkError, match=re.escape(text)):
                await End(address).port.start()


LOST = {'bearing': 'aft', 'alarm': 'input_lost', 'silenced': False, 'changed': 0, 'text': 'aft: x'}


class Display:
    """The other end of both directions, by one connection: what it got, and a way to answer."""

    def __init__(self) -> None:
        self.got: list[bytes] = []
        self.say: Callable[[str], None] = lambda line: None

    async def open(self) -> int:
        async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            self.say = lambda line: writer.write(f'{line}\r\n'.encode())
            while line := await reader.readline():
                self.got.append(line)

        self.server = await asyncio.start_server(serve, '127.0.0.1', 0)
        return int(self.server.sockets[0].getsockname()[1])


async def test_the_heartbeat_follows_the_state_of_the_monitor(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = SimpleNamespace(now=100.0)
    monkeypatch.setattr(nmea_client, 'time', SimpleNamespace(monotonic=lambda: clock.now))
    sent: list[str] = []
    side = MonitorSide(['aft'], print, print, lambda *state: None, logging.getLogger('test'))
    client = NmeaClient(NmeaLink(alerts='udp://127.0.0.1:9', list_period=600.0), [], side)
    monkeypatch.setattr(
        client, '_send_lines', lambda lines: sent.extend(line for line in lines if 'HBT' in line)
    )

    def beats(*ticks: tuple[float, bool]) -> list[str]:
        """Return the times and letters of the heartbeats."""
        letters = []
        for clock.now, is_monitoring in ticks:
            del sent[:]
            client.tick(is_monitoring)
            letters += [f'{clock.now:g} {line.split(",")[2]}' for line in sent]
        return letters

    # Not the first tick, which comes before the first record; then every 60 s, and at each change.
    assert beats((100.0, False), (100.5, False), (101.0, True), (150.0, True), (161.0, True)) == [
        '101 A',
        '161 A',
    ]
    assert beats((170.0, False), (170.5, False), (200.0, True), (200.5, True)) == ['170 V', '200 A']
    # A display that is connected again need not wait.
    client._report_link('nmea_out', False, 'closed')
    client._report_link('nmea_out', True, '')
    assert beats((201.0, True), (201.5, True)) == ['201 A']
    silent = NmeaClient(NmeaLink(alerts='udp://127.0.0.1:9'), [], side)
    monkeypatch.setattr(
        silent, '_send_lines', lambda lines: sent.extend(line for line in lines if 'HBT' in line)
    )
    client = silent
    # Nobody watches, from the start on.
    assert beats((300.0, False), (304.5, False), (305.0, False), (306.0, False)) == ['305 V']


async def test_sentences_in_alerts_out_and_acknowledgements_back(caplog: pytest.LogCaptureFixture) -> None:
    samples: list[Any] = []
    requests: list[str] = []
    states: list[Any] = []

    def act(request: Any) -> None:
        requests.append(str(request.action))
        if request.action == 'acknowledge':
            raise LinkError('no monitor is there')

    display = Display()
    port = f'tcp://127.0.0.1:{await display.open()}'
    client = NmeaClient(
        NmeaLink(port, port, 'II', '', 10001, 30.0, 60.0, True),
        [BusInput(bus='nmea', bearing='aft', place=Input.SPEED, sentence='RPM', kind='S', number=1)],
        MonitorSide(
            ['aft'],
            lambda *sample: samples.append(sample),
            act,
            lambda *state: states.append(state),
            logging.getLogger('test'),
        ),
    )
    await client.open_ports()
    running = asyncio.get_running_loop().create_task(client.run())
    lost = [{**LOST, 'state': 'unacknowledged'}]
    client.take_alarms({'time': 0, 'changes': [], 'alarms': lost})
    client.tick(True)
    client.tick(True)
    await wait_until(lambda: len(display.got) == 4)
    assert [line[3:6] for line in display.got] == [b'ALF', b'ALF', b'ALC', b'HBT']
    display.say(RPM)
    for command in 'SAO':
        display.say(format_sentence(f'BNACN,060130.00,,10005,1,{command},C'))
    await wait_until(lambda: len(display.got) == 5, lambda: (display.got, requests))
    assert display.got[4][3:6] == b'ARC'
    await client.finish()
    await wait_until(lambda: len(display.got) == 6)
    assert display.got[5].startswith(b'$IIHBT,60.0,V,1')
    running.cancel()
    assert samples == [('aft', 0, 74.6)]
    assert requests == ['silence', 'acknowledge']
    assert ('nmea_in', True, '') in states
    assert 'acknowledge of aft refused: no monitor is there' in caplog.text
