# SPDX-License-Identifier: Apache-2.0
"""The NMEA 0183 side of the ship: UDP, TCP and serial ports, and what goes in and out of them.

A port that dies is opened again for ever.
"""

from __future__ import annotations

import asyncio
import ipaddress
import math
import os
import socket
import struct
import termios
import time
import tty
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from functools import partial
from typing import Any

from stickslip_logs.units import KIB
from stickslip_monitor.errors import LinkError, cause
from stickslip_monitor.links.links_config import UNHEARD, BusInput, NmeaLink, check_port
from stickslip_monitor.links.live_monitor import MonitorSide
from stickslip_monitor.links.nmea import Alerts, NmeaInputs, SentenceStream
from stickslip_monitor.monitor.session import Sink

SILENT = 30.0
"""Silence after which a port with inputs is reopened [s]: a vanished serial line reports nothing."""
AGAIN = 1.0
"""Time between two attempts to open a port [s]."""
_MAX_READ_BYTES = 64 * KIB  # of one read: no datagram is larger
OnLine = Callable[[str], None]
OnLink = Callable[[bool | None, str], None]
"""Given whether a port works (None: nobody can know), and why not or why unknown ('' if it works)."""


class Port:
    """A place where lines come from and go to: a file descriptor, of a socket or a serial line.

    Args:
        name: The parameter that has the address.
        on_line: Called with each whole sentence received.
        on_link: Called with whether the port works (``None``: unknown) and why not, when it is opened or
            fails, and with each receipt. :meth:`run` calls it with False after each failure.
        listens: Whether datagrams are received; a UDP port either receives or sends.
        silent: Time without data after which the port is reopened; infinite where none need come [s].

    Raises:
        ConfigurationError: The address is not that of a port.
    """

    def __init__(
        self, name: str, address: str, on_line: OnLine, on_link: OnLink, listens: bool, silent: float
    ) -> None:
        self.name, self.address = name, address
        self.url = check_port(name, address)
        self._on_line, self._on_link = on_line, on_link
        self._listens, self._silent = listens, silent
        self.stream = SentenceStream()
        self._heard_at = 0.0
        self._loop = asyncio.get_running_loop()
        self._fault: asyncio.Future[str] = self._loop.create_future()
        self._descriptor: int | None = None

    async def start(self) -> None:
        """Open the port, and read it from now on; leave a TCP server that cannot be reached to :meth:`run`.

        Raises:
            LinkError: It cannot be opened, and waiting does not mend it.
        """
        try:
            await self._open_port()
        except OSError as error:
            # A server may come later than we do.
            if self.url.scheme != 'tcp':
                raise LinkError(f"{self.name} = '{self.address}' cannot be opened: {cause(error)}") from error
            self._set_fault(cause(error))

    async def run(self) -> None:
        """Report each failure, and reopen the port :data:`AGAIN` later, until cancelled; then close it.

        Call :meth:`start` first.
        """
        try:
            while True:
                self._on_link(False, await self._wait_for_end())
                self._close_port()
                await asyncio.sleep(AGAIN)
                try:
                    await self._open_port()
                except OSError as error:
                    self._set_fault(cause(error))
        finally:
            self._close_port()

    def send(self, lines: Iterable[str]) -> None:
        """Send lines in ASCII, CR LF added to each, without waiting; while the port is closed they are lost.

        One that the other end does not take whole makes :meth:`run` report, close and reopen the port. A
        character beyond ASCII is sent as ``?``.
        """
        for line in lines:
            if self._descriptor is None:
                return
            data = f'{line}\r\n'.encode('ascii', 'replace')
            try:
                sent = os.write(self._descriptor, data)
            except BlockingIOError:
                sent = 0
            except OSError as error:
                self._set_fault(cause(error))
                continue
            # What the other end does not take is not kept for it.
            if sent < len(data):
                self._set_fault('the other end does not take what is sent')

    def _close_port(self) -> None:
        """Close the port, if it is open, and read it no more."""
        if self._descriptor is not None:
            self._loop.remove_reader(self._descriptor)
            os.close(self._descriptor)
            self._descriptor = None

    async def _open_port(self) -> None:
        """Open the port, and read it from now on; report the link, as unknown where datagrams are sent.

        One with inputs is not reported before it has data. A fault of the time before is forgotten.

        Raises:
            OSError: It cannot be opened.
        """
        self._fault = self._loop.create_future()
        if self.url.scheme == 'serial':
            self._descriptor = self._open_serial_line()
        else:
            self._descriptor = await self._open_socket()
        self._loop.add_reader(self._descriptor, self._read_bytes, self._descriptor)
        if self.url.scheme == 'udp' and not self._listens:  # datagrams are not answered
            self._on_link(None, 'datagrams are sent; whether anybody takes them is unknown')
        elif self._silent == math.inf:
            self._on_link(True, '')

    def _open_serial_line(self) -> int:
        """Open the serial line, 8N1, at 4800 baud unless the address gives a rate; return its descriptor.

        Raises:
            OSError: It cannot be opened, or is not a serial line.
        """
        descriptor = os.open(self.url.path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        try:
            tty.setraw(descriptor)
            settings = termios.tcgetattr(descriptor)
            # Set as a whole: whoever had the line before may have left anything.
            settings[2] &= ~(termios.CSTOPB | termios.PARENB | termios.CRTSCTS)
            settings[2] |= termios.CS8 | termios.CLOCAL | termios.CREAD
            rate = getattr(termios, f'B{self.url.query.partition("=")[2] or 4800}')
            settings[4] = settings[5] = rate
            termios.tcsetattr(descriptor, termios.TCSANOW, settings)
        except termios.error as error:
            os.close(descriptor)
            raise OSError('it is not a serial line') from error
        return descriptor

    async def _open_socket(self) -> int:
        """Open a socket, as :meth:`_open_socket_at`, at the first address of the host that takes one.

        Return its descriptor.

        Raises:
            OSError: No address takes one.
        """
        kind = socket.SOCK_STREAM if self.url.scheme == 'tcp' else socket.SOCK_DGRAM
        host, number = self.url.hostname, self.url.port
        *first_infos, last_info = await self._loop.getaddrinfo(host, number, type=kind)
        for family, _, _, _, address in first_infos:
            with suppress(OSError):
                return await self._open_socket_at(family, kind, address)
        return await self._open_socket_at(last_info[0], kind, last_info[4])

    async def _open_socket_at(self, family: int, kind: int, address: Any) -> int:
        """Bind a socket to an address if datagrams are received, else connect it; return its descriptor.

        The descriptor does not block, and the caller closes it.

        Raises:
            OSError: That fails, or takes longer than :data:`.UNHEARD`; on a ship's network it takes
                milliseconds.
        """
        # Closed at the end of the block, unless it is detached.
        with socket.socket(family, kind) as sock:
            sock.setblocking(False)
            if kind == socket.SOCK_DGRAM and self._listens:
                if ipaddress.ip_address(address[0]).is_multicast:
                    _join_group(sock, address[0])
                sock.bind(address)
                return sock.detach()
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
            try:
                await asyncio.wait_for(self._loop.sock_connect(sock, address), UNHEARD)
            except asyncio.TimeoutError as error:
                raise OSError(f'no answer for {UNHEARD:g} s') from error
            return sock.detach()

    async def _wait_for_end(self) -> str:
        """Wait until the port fails, or is silent for too long from now on; return the reason as a clause."""
        self._heard_at = self._loop.time()
        while (left := self._heard_at + self._silent - self._loop.time()) > 0.0:
            done, _ = await asyncio.wait({self._fault}, timeout=None if left == math.inf else left)
            if done:
                return self._fault.result()
        return f'no data for {self._silent:g} s'

    def _set_fault(self, why: str) -> None:
        """Make :meth:`run` close and reopen the port; only the first reason counts."""
        if not self._fault.done():
            self._fault.set_result(why)

    def _read_bytes(self, descriptor: int) -> None:
        """Read available bytes, report the link as working, and pass on the whole sentences.

        An error, or the end, is set as the fault.
        """
        try:
            data = os.read(descriptor, _MAX_READ_BYTES)
        except BlockingIOError:
            return
        except OSError as error:
            self._set_fault(cause(error))
            return
        if not data and self.url.scheme != 'udp':
            serial = self.url.scheme == 'serial'
            self._set_fault('the line has gone' if serial else 'the other end closed the connection')
            return
        self._heard_at = self._loop.time()
        self._on_link(True, '')
        for line in self.stream.take(data):
            self._on_line(line)


def _join_group(sock: socket.socket, group: str) -> None:
    """Join a multicast group (IEC 61162-450) on every interface that takes it; others may join its port.

    Raises:
        OSError: No interface takes it.
    """
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    fault: OSError | None = None
    joined = 0
    for index, _ in socket.if_nameindex():
        try:
            if sock.family == socket.AF_INET6:
                request = socket.inet_pton(socket.AF_INET6, group) + struct.pack('@I', index)
                sock.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_JOIN_GROUP, request)
            else:
                request = socket.inet_aton(group) + bytes(4) + struct.pack('@i', index)
                sock.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, request)
            joined += 1
        except OSError as error:
            fault = error
    if not joined:
        raise fault or OSError('no interface takes a multicast group')


class NmeaClient(Sink):
    """Sentences in, alerts out.

    Args:
        link: The addresses, and how alerts are sent.
        inputs: The inputs that come from sentences, perhaps none.
        side: The monitor; it is given the links ``nmea_in`` and ``nmea_out``.
    """

    def __init__(self, link: NmeaLink, inputs: Sequence[BusInput], side: MonitorSide) -> None:
        self._link, self._side = link, side
        self._has_inputs = bool(inputs)
        self._inputs = NmeaInputs(inputs, side.log.warning)
        self._alerts = Alerts(
            side.bearings, link.talker, link.manufacturer, link.first_alert, link.accept_actions
        )
        self._ports: list[Port] = []
        self._out: Port | None = None
        self._listed_at = self._beat_at = -math.inf
        self._begun = math.inf
        self._was_present: bool | None = None  # as the last heartbeat said
        self._down: dict[str, bool] = {}  # whether a link was down when it was reported last

    async def open_ports(self) -> None:
        """Create and store the ports for input and alerts, and open them; a TCP server may also come later.

        Where both have one address that is not of UDP, one port serves for both.

        Raises:
            ConfigurationError: An address is not that of a port.
            LinkError: One cannot be opened, and waiting does not mend it.
        """
        link = self._link
        if link.listen:
            self._ports.append(self._make_port('listen', link.listen))
        if link.alerts == link.listen and not link.listen.startswith('udp'):
            self._out = self._ports[0] if self._ports else None
        elif link.alerts:
            self._out = self._make_port('alerts', link.alerts)
            self._ports.append(self._out)
        for port in self._ports:
            await port.start()

    def _make_port(self, role: str, address: str) -> Port:
        """Make a port, not yet open, for a role: ``listen`` or ``alerts``.

        Raises:
            ConfigurationError: The address is not that of a port.
        """
        listens = role == 'listen'
        on_link = partial(self._report_link, 'nmea_in' if listens else 'nmea_out')
        # Where only acknowledgements may come, silence is nothing wrong.
        silent = SILENT if self._has_inputs and listens else math.inf
        return Port(f'nmea.{role}', address, self._on_line, on_link, listens, silent)

    def _report_link(self, name: str, works: bool | None, why: str) -> None:
        """Report the state of a link; have the next tick send list and heartbeat if it was down before.

        ``works`` is None where nobody can know, which counts as not down; ``why`` is '' where it is True.
        """
        if works is not False and self._down.get(name, True):
            self._listed_at = self._beat_at = -math.inf
        self._down[name] = works is False
        self._side.report_link(name, works, why)

    async def run(self) -> None:
        """Keep the ports open, reopening each that fails, until cancelled; then close them."""
        await asyncio.gather(*(port.run() for port in self._ports))

    def take_alarms(self, record: dict[str, Any]) -> None:
        """Send the ALF sentences of the alarms that changed, if there is a port for alerts."""
        self._send_lines(self._alerts.take_alarms(record))

    def tick(self, is_present: bool) -> None:
        """Log silent inputs; send the list and the heartbeat when they are due.

        Args:
            is_present: Whether the monitor gives data.
        """
        now = time.monotonic()
        if self._has_inputs:
            self._inputs.log_silent(now, self._ports[0].stream.unused)
        if now - self._listed_at >= self._link.list_period:
            self._listed_at = now
            self._send_lines(self._alerts.make_list())
        self._begun = min(self._begun, now)
        if self._is_beat_due(now, is_present):
            self._beat_at, self._was_present = now, is_present
            self._send_lines([self._alerts.make_heartbeat(self._link.heartbeat, is_present)])

    def _is_beat_due(self, now: float, is_present: bool) -> bool:
        """Return whether a heartbeat is due: periodically, and as soon as what it says has changed.

        The first one waits up to :data:`.UNHEARD` for the first record: a node beside is discovered within
        one or two seconds. ``now`` is of the steady clock [s].
        """
        if self._was_present is None and not is_present:
            return now - self._begun >= UNHEARD
        return is_present is not self._was_present or now - self._beat_at >= self._link.heartbeat

    async def finish(self) -> None:
        """Send a last heartbeat, which says that the monitor is gone; the ports stay open."""
        self._send_lines([self._alerts.make_heartbeat(self._link.heartbeat, False)])
        await asyncio.sleep(0)

    def _send_lines(self, lines: list[str]) -> None:
        """Send lines to the port of the alerts, if there is one."""
        if self._out is not None:
            self._out.send(lines)

    def _on_line(self, line: str) -> None:
        """Pass the samples of a sentence to the monitor; answer an ACN and pass on any request in it."""
        for sample in self._inputs.take(line, time.monotonic()):
            self._side.take(*sample)
        answers, request = self._alerts.handle_acn(line, time.time_ns())
        self._send_lines(answers)
        if request is not None:
            self._side.pass_request(request)
