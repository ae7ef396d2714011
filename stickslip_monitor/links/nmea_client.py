# SPDX-License-Identifier: Apache-2.0
"""The NMEA 0183 side of the ship: the ports, and what goes in and out of them."""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import Callable, Sequence
from typing import Any

from stickslip_monitor.errors import StickslipError
from stickslip_monitor.links.link_config import NmeaLink
from stickslip_monitor.links.nmea import Alerts, NmeaInput, samples
from stickslip_monitor.links.ports import SILENT, Port, open_port
from stickslip_monitor.monitor.alarms.live_alarms import Log
from stickslip_monitor.monitor.alarms.requests import ActionRequest

Take = Callable[[str, int, float], None]
"""Takes bearing, whether it is the load, and number of a sample."""
TellLink = Callable[[str, bool, str], None]
"""Told whether the link of that name works, and if not, why."""


class NmeaClient:
    """Sentences in, alerts out.

    Args:
        link: The configuration.
        inputs: What to read.
        bearings: Names of all bearings in the order of the file.
        take: Takes samples.
        act: Takes what people ask for.
        tell: Told of the links ``nmea_in`` and ``nmea_out``.
        log: Where refused actions are told.
    """

    def __init__(
        self,
        link: NmeaLink,
        inputs: Sequence[NmeaInput],
        bearings: Sequence[str],
        take: Take,
        act: Callable[[ActionRequest], None],
        tell: TellLink,
        log: Log,
    ) -> None:
        self._link, self._inputs = link, inputs
        self._take, self._act, self._tell, self._log = take, act, tell, log
        self._alerts = Alerts(
            bearings, link.talker, link.manufacturer, link.first_alert, link.accept_actions
        )
        self._ports: list[Port] = []
        self._out: Port | None = None
        self._listed = self._beaten = float('-inf')

    async def start(self) -> None:
        """Open the ports.

        Raises:
            LinkError: One cannot be opened.
        """
        link, shared = self._link, self._link.listen == self._link.alerts
        shared = shared and not link.listen.startswith('udp')
        if link.listen:
            self._ports.append(self._port('listen', True))
        if link.alerts:
            self._out = self._ports[0] if shared else self._port('alerts', False)
            self._ports += [] if shared else [self._out]
        for port in self._ports:
            await port.start()

    def _port(self, role: str, listens: bool) -> Port:
        name = 'nmea_in' if listens else 'nmea_out'

        def on_link(up: bool, why: str) -> None:
            self._tell(name, up, why)

        address = getattr(self._link, role)
        # Where only acknowledgements may come, silence is nothing wrong.
        silent = SILENT if self._inputs or not listens else math.inf
        return open_port(f'nmea.{role}', address, self._on_line, on_link, listens, silent)

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
            self._take(*sample)
        answers, request = self._alerts.obey(line, time.time_ns())
        self._send(answers)
        if request is not None:
            try:
                self._act(request)
            except StickslipError as error:
                self._log.error(f'NMEA: {request.action} of {request.bearing} refused: {error}')
