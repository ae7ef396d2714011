# SPDX-License-Identifier: Apache-2.0
"""The NMEA 0183 side of the ship: UDP, TCP and serial ports, and what goes in and out of them.

A port that dies is opened again for ever.
"""

from __future__ import annotations

import asyncio
import math
import os
import termios
import time
import tty
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from functools import partial
from typing import Any

from stickslip_monitor.errors import LinkError, cause
from stickslip_monitor.links.link_config import NmeaLink, check_port
from stickslip_monitor.links.live_monitor import MonitorSide
from stickslip_monitor.links.nmea import Alerts, NmeaInput, samples

SILENT = 30.0
"""A port that should bring lines and has brought none for so long is opened again [s]."""
AGAIN = 1.0
"""Time between two attempts to open a port [s]."""
LONGEST_LINE = 1024
_NO_ANSWER = 5.0
OnLine = Callable[[str], None]
OnLink = Callable[[bool, str], None]
"""Told whether a port works, and if not, why."""


class Port(asyncio.DatagramProtocol, asyncio.Protocol):
    """A place where lines come from and go to: a datagram socket.

    Args:
        name: The parameter that has the address.
        on_link: Told when the port begins or ceases to work.
        listens: Whether lines come in; datagrams go one way only.
        silent: After so long without a line it is opened again; infinite where none need come [s].

    Raises:
        ConfigurationError: The address is none.
    """

    waits = False
    """Whether the other end may come later than we do."""

    def __init__(
        self,
        name: str,
        address: str,
        on_line: OnLine,
        on_link: OnLink,
        listens: bool,
        silent: float,
    ) -> None:
        self.name, self.address = name, address
        self.url = check_port(name, address)
        self._on_line, self._on_link = on_line, on_link
        self._listens, self._silent = listens, silent
        self._buffer = b''
        self._heard_at = 0.0
        self._loop = asyncio.get_running_loop()
        self._fault: asyncio.Future[str] = self._loop.create_future()
        self._transport: Any = None

    async def start(self) -> None:
        """Open it for the first time.

        Raises:
            LinkError: It cannot be opened, in a way that waiting does not mend.
        """
        try:
            await self._open()
        except OSError as error:
            if not self.waits:
                raise LinkError(
                    f"{self.name} = '{self.address}' cannot be opened: {cause(error)}"
                ) from error
            self._fail(error)

    async def run(self) -> None:
        """Keep it open until cancelled."""
        try:
            while True:
                self._on_link(False, await self._end())
                self.close()
                await asyncio.sleep(AGAIN)
                try:
                    await self._open()
                except OSError as error:
                    self._fail(error)
        finally:
            self.close()

    def send(self, lines: Iterable[str]) -> None:
        """Send lines; one that cannot be sent is lost, and told."""
        for line in lines if self._transport is not None else ():
            try:
                self._write(f'{line}\r\n'.encode('ascii', 'replace'))
            except OSError as error:
                self._fail(error)

    def close(self) -> None:
        """Close it, whatever state it is in."""
        if self._transport is not None:
            self._transport.abort()
            self._transport = None

    async def _open(self) -> None:
        self._fault, self._buffer = self._loop.create_future(), b''
        await self._connect()
        if self._silent == math.inf:
            self._on_link(True, '')

    async def _connect(self) -> None:
        where: Any = (self.url.hostname, self.url.port)
        ends = {'local_addr': where} if self._listens else {'remote_addr': where}
        # A socket that may broadcast is not connected, and then hears of no refusal.
        broadcast = None if self._listens else (self.url.hostname or '').endswith('.255')
        make = self._loop.create_datagram_endpoint
        self._transport, _ = await make(lambda: self, **ends, allow_broadcast=broadcast)

    def _write(self, data: bytes) -> None:
        if not self._listens:
            self._transport.sendto(data)

    async def _end(self) -> str:
        """Wait until the port is at its end; return why."""
        self._heard_at = self._loop.time()
        while (left := self._heard_at + self._silent - self._loop.time()) > 0.0:
            done, _ = await asyncio.wait({self._fault}, timeout=None if left == math.inf else left)
            if done:
                return self._fault.result()
        return f'nothing heard for {self._silent:g} s'

    def _fail(self, why: Exception | str) -> None:
        if not self._fault.done():
            self._fault.set_result(why if isinstance(why, str) else cause(why))

    def _take(self, data: bytes) -> None:
        """Bytes have come; whole lines are handed on, of one that never ends its end."""
        self._heard_at = self._loop.time()
        self._on_link(True, '')
        *lines, rest = (self._buffer + data).split(b'\n')
        self._buffer = rest[-LONGEST_LINE:]
        for line in lines:
            self._on_line(line.decode('ascii', 'replace'))

    def datagram_received(self, data: bytes, _: Any) -> None:
        """A datagram has come, which holds whole lines."""
        self._take(data.rstrip(b'\n') + b'\n')

    def error_received(self, error: Exception) -> None:
        """The other end of our datagrams is not there."""
        self._fail(error)


class TcpPort(Port):
    """A connection to a server, such as a multiplexer."""

    waits = True

    async def _connect(self) -> None:
        where: Any = (self.url.hostname, self.url.port)
        opened = self._loop.create_connection(lambda: self, *where)
        try:
            self._transport, _ = await asyncio.wait_for(opened, _NO_ANSWER)
        except asyncio.TimeoutError as error:
            raise OSError(f'no answer for {_NO_ANSWER:g} s') from error

    def data_received(self, data: bytes) -> None:
        """Part of the stream has come."""
        self._take(data)

    def connection_lost(self, error: Exception | None) -> None:
        """The connection is over."""
        self._fail(error or 'the other end closed the connection')

    def _write(self, data: bytes) -> None:
        # What a frozen server does not take is not kept for it.
        if self._transport.get_write_buffer_size() > 64 * LONGEST_LINE:
            raise OSError('the other end takes nothing')
        self._transport.write(data)


class SerialPort(Port):
    """A serial line, 8N1; its transport is a file descriptor."""

    async def _connect(self) -> None:
        descriptor = os.open(self.url.path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        try:
            tty.setraw(descriptor)
            settings = termios.tcgetattr(descriptor)
            rate = getattr(termios, f'B{self.url.query.partition("=")[2] or 4800}')
            settings[4] = settings[5] = rate
            termios.tcsetattr(descriptor, termios.TCSANOW, settings)
        except termios.error as error:
            os.close(descriptor)
            raise OSError('it is no serial line') from error
        self._loop.add_reader(descriptor, self._readable, descriptor)
        self._transport = descriptor

    def _readable(self, descriptor: int) -> None:
        try:
            data = os.read(descriptor, 4096)
        except BlockingIOError:
            return
        except OSError as error:
            data = b''
            self._fail(error)
        if data:
            self._take(data)
        else:
            self._fail('the line is closed')
            self._loop.remove_reader(descriptor)

    def close(self) -> None:
        """Close the device."""
        if self._transport is not None:
            self._loop.remove_reader(self._transport)
            with suppress(OSError):
                os.close(self._transport)
            self._transport = None

    def _write(self, data: bytes) -> None:
        if os.write(self._transport, data) < len(data):
            raise OSError('the line does not take so much')


KINDS = {'udp': Port, 'tcp': TcpPort, 'serial': SerialPort}
"""The ports by the schemes of their addresses."""


class NmeaClient:
    """Sentences in, alerts out.

    Args:
        side: The monitor; it is told of the links ``nmea_in`` and ``nmea_out``.
    """

    def __init__(self, link: NmeaLink, inputs: Sequence[NmeaInput], side: MonitorSide) -> None:
        self._link, self._inputs, self._side = link, inputs, side
        self._alerts = Alerts(
            side.bearings, link.talker, link.manufacturer, link.first_alert, link.accept_actions
        )
        self._ports: list[Port] = []
        self._out: Port | None = None
        self._listed = self._beaten = -math.inf

    async def start(self) -> None:
        """Open the ports.

        Raises:
            LinkError: One cannot be opened.
        """
        link = self._link
        if link.listen:
            self._ports.append(self._port('listen', link.listen))
        if link.alerts == link.listen and not link.listen.startswith('udp'):
            self._out = self._ports[0] if self._ports else None
        elif link.alerts:
            self._out = self._port('alerts', link.alerts)
            self._ports.append(self._out)
        for port in self._ports:
            await port.start()

    def _port(self, role: str, address: str) -> Port:
        listens = role == 'listen'
        on_link = partial(self._side.tell, 'nmea_in' if listens else 'nmea_out')
        # Where only acknowledgements may come, silence is nothing wrong.
        silent = SILENT if self._inputs and listens else math.inf
        kind = KINDS[check_port(f'nmea.{role}', address).scheme]
        return kind(f'nmea.{role}', address, self._on_line, on_link, listens, silent)

    async def run(self) -> None:
        """Keep the ports open until cancelled."""
        await asyncio.gather(*(port.run() for port in self._ports))

    def take_record(self, record: dict[str, Any]) -> None:
        """The state of a bearing has no sentence."""

    def take_alarms(self, record: dict[str, Any]) -> None:
        """Send what has changed at once."""
        self._send(self._alerts.take_alarms(record))

    def tick(self, there: bool) -> None:
        """Let time pass: the list and the heartbeat are sent when they are due."""
        now = time.monotonic()
        if now - self._listed >= self._link.list_period:
            self._listed = now
            self._send(self._alerts.listing())
        if now - self._beaten >= self._link.heartbeat:
            self._beaten = now
            self._send([self._alerts.heartbeat(self._link.heartbeat, there)])

    async def finish(self) -> None:
        """Say that we go."""
        self._send([self._alerts.heartbeat(self._link.heartbeat, False)])
        await asyncio.sleep(0)

    def _send(self, lines: list[str]) -> None:
        if self._out is not None:
            self._out.send(lines)

    def _on_line(self, line: str) -> None:
        for sample in samples(self._inputs, line):
            self._side.take(*sample)
        answers, request = self._alerts.obey(line, time.time_ns())
        self._send(answers)
        if request is not None:
            self._side.ask(request)
