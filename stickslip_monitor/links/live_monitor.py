# SPDX-License-Identifier: Apache-2.0
"""The monitor as a bus reaches it, and a session on an event loop, without ROS."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from stickslip_monitor.errors import StickslipError
from stickslip_monitor.host_clock import HostClock
from stickslip_monitor.monitor.alarms.alarm_records import ActionRequest
from stickslip_monitor.monitor.config import MonitorConfig
from stickslip_monitor.monitor.input_watch import Graph
from stickslip_monitor.monitor.session import Display, Log, Moment, Session, Shown, Store
from stickslip_monitor.monitor.signals import Input

TICK = 0.1
"""Time between two looks at the inputs [s]."""
BEHIND_NS = 500_000_000
"""The passing of time is passed on so late that a sample delivered late is not overtaken."""
HELD_UP_NS = 10**9
"""A look that comes so late [ns] says that we were held up, or slept: no input is to blame."""
_SHOWN_EVERY_NS = 10**9


@dataclass(frozen=True, slots=True)
class MonitorSide:
    """What a bus reaches of the monitor, which is here or in a node beside."""

    bearings: Sequence[str]  # names of all bearings in the order of the file
    # Takes bearing, input and number of a sample, and its sender's stamp where it has one [ns].
    take: Callable[..., None]
    act: Callable[[ActionRequest], None]  # takes what people ask for
    # Given whether the link of that name works (None: nobody can know), and if not, why.
    report_link: Callable[[str, bool | None, str], None]
    log: Log  # where faults are logged

    def ask(self, request: ActionRequest) -> None:
        """Hand on what somebody asks for at a bus; that it is refused is logged."""
        try:
            self.act(request)
        except StickslipError as error:
            self.log.error(f'{request.by}: {request.action} of {request.bearing} refused: {error}')


class LiveMonitor:
    """A session that samples are measured for now, by the clocks of this machine.

    Args:
        store: What keeps the alarms over a restart; ``None`` for nothing.
        clock: The clocks.
    """

    def __init__(
        self,
        config: MonitorConfig,
        display: Display,
        log: Log,
        store: Store | None = None,
        clock: HostClock | None = None,
    ) -> None:
        self._now = (clock or HostClock()).now
        self._session = Session(config, Shown(display), log, lambda: self._now().time_ns, store, Graph())
        self._begun_ns = self._ticked_ns = self._now().steady_ns
        self._shown_ns = self._begun_ns - _SHOWN_EVERY_NS

    def take(self, bearing: str, place: Input, value: float, stamp_ns: int | None = None) -> None:
        """Take one number of one input, which comes now, with its sender's stamp if it has one."""
        now = self._now()
        time_ns = now.time_ns if stamp_ns is None else stamp_ns
        self._session.take(bearing, place, time_ns, value, now)
        if place is Input.SPEED and self._session.monitor.bearings[bearing].config.load.is_assumed:
            self._session.take(bearing, Input.LOAD, time_ns, value, now)

    def act(self, request: ActionRequest) -> None:
        """Do what a person asks for."""
        self._session.act(request)

    def begin(self) -> None:
        """Publish the list of alarms, and wait for inputs from now on."""
        self._session.begin()
        self._pass_time(self._now(), 0)

    def tick(self) -> None:
        """Let time pass."""
        now = self._now()
        held_ns, self._ticked_ns = now.steady_ns - self._ticked_ns, now.steady_ns
        if held_ns > HELD_UP_NS:
            self._session.excuse(held_ns)
        self._pass_time(now, BEHIND_NS)
        self._session.tick(now, now.steady_ns - self._begun_ns)
        if now.steady_ns - self._shown_ns >= _SHOWN_EVERY_NS:
            self._shown_ns = now.steady_ns
            self._session.show(now)
        # At the tick: the alarm itself must not wait for the figures beside it.
        self._session.flush(now)

    def _pass_time(self, now: Moment, behind_ns: int) -> None:
        for name in self._session.monitor.bearings:
            self._session.pass_time(name, now.time_ns - behind_ns, now)

    async def run(self) -> None:
        """Let time pass from now on until cancelled."""
        self.begin()
        while True:
            self.tick()
            await asyncio.sleep(TICK)
