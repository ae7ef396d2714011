# SPDX-License-Identifier: Apache-2.0
"""The monitor of a ship's buses: a session by the clocks of this machine, and how a bus reaches it."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from stickslip_logs.units import SECOND_NS
from stickslip_monitor.errors import StickslipError
from stickslip_monitor.host import BEHIND_NS, SHOW_NS, HostClock
from stickslip_monitor.monitor.alarm_records import ActionRequest
from stickslip_monitor.monitor.input_faults import Graph
from stickslip_monitor.monitor.parameters import MonitorConfig
from stickslip_monitor.monitor.sample_types import Input
from stickslip_monitor.monitor.session import Log, Moment, Session, Sink, Store

TICK = 0.1
"""Time between two ticks of a live monitor [s]."""
STALL_NS = 3 * SECOND_NS // 10
"""Time between two ticks from which this process was stalled, and no input is to blame [ns]."""


@dataclass(frozen=True, slots=True)
class MonitorSide:
    """Access of a bus to the monitor, which is here or in a node beside."""

    bearings: Sequence[str]  # names of all bearings in the order of the file
    # Takes bearing, input and number of a sample, and its sender's stamp where it has one [ns].
    take: Callable[..., None]
    act: Callable[[ActionRequest], None]  # takes what people ask for
    # Given whether the link of that name works (None: nobody can know), and why not or why unknown.
    report_link: Callable[[str, bool | None, str], None]
    log: Log  # where faults are logged

    def pass_request(self, request: ActionRequest) -> None:
        """Let the monitor carry out a request that came over a bus; log a refusal, and raise nothing."""
        try:
            self.act(request)
        except StickslipError as error:
            self.log.error(f'{request.by}: {request.action} of {request.bearing} refused: {error}')


class LiveMonitor:
    """A session whose samples are measured when they come, by the clocks of this machine.

    Bearings and inputs must be configured.

    Args:
        sink: Takes what is published.
        log: Given warnings and errors.
        store: Keeps the alarms over a restart; ``None`` for a session that forgets them.
        clock: The clocks.
    """

    def __init__(
        self,
        config: MonitorConfig,
        sink: Sink,
        log: Log,
        store: Store | None = None,
        clock: HostClock | None = None,
    ) -> None:
        self._now = (clock or HostClock()).now
        self._session = Session(config, sink, log, lambda: self._now().time_ns, store, Graph())
        self._begun_ns = self._ticked_ns = self._now().steady_ns
        self._shown_ns = self._begun_ns - SHOW_NS

    @property
    def damage(self) -> str:
        """Reason why the saved alarms are lost; '' where they are not."""
        return self._session.damage

    def take(self, bearing: str, place: Input, value: float, stamp_ns: int | None = None) -> None:
        """Give the session a number that arrives now, measured at its sender's stamp [ns]; ``None``: now.

        It is in the configured unit of the input, NaN if invalid. With each speed the session is given the
        load that is assumed there, too.
        """
        now = self._read_moment()
        time_ns = now.time_ns if stamp_ns is None else stamp_ns
        self._session.take(bearing, place, time_ns, value, now)
        if place is Input.SPEED and self._session.monitor.bearings[bearing].config.load.is_assumed:
            self._session.take(bearing, Input.LOAD, time_ns, value, now)

    def act(self, request: ActionRequest) -> None:
        """Have the session carry out a request: alarms change, and are published at the next tick.

        Raises:
            ConfigurationError: The bearing is not configured.
        """
        self._session.act(request)

    def begin(self) -> None:
        """Publish the list of alarms, and start the wait of every bearing for its inputs."""
        self._session.begin()
        self._advance_bearings(self._now(), 0)

    def tick(self) -> None:
        """Advance all bearings to :data:`BEHIND_NS` ago; publish changes, and once a second their state."""
        now = self._read_moment()
        self._ticked_ns = now.steady_ns
        self._advance_bearings(now, BEHIND_NS)
        self._session.tick(now, now.steady_ns - self._begun_ns)
        if now.steady_ns - self._shown_ns >= SHOW_NS:
            self._shown_ns = now.steady_ns
            self._session.show(now)
        # At the tick: the alarm itself must not wait for the figures beside it.
        self._session.flush(now)

    def _read_moment(self) -> Moment:
        """Return the time now; leave a stall since the last tick out of the age of every input, once.

        A stall is a time of more than :data:`STALL_NS`.
        """
        now = self._now()
        held_ns = now.steady_ns - self._ticked_ns
        if held_ns > STALL_NS:
            self._session.discount_stall(held_ns)
            self._ticked_ns = now.steady_ns
        return now

    def _advance_bearings(self, now: Moment, behind_ns: int) -> None:
        """Advance all bearings to ``behind_ns`` before a moment."""
        for name in self._session.monitor.bearings:
            self._session.advance(name, now.time_ns - behind_ns, now)

    async def run(self) -> None:
        """Publish the list of alarms, then tick every :data:`TICK` until cancelled."""
        self.begin()
        while True:
            self.tick()
            await asyncio.sleep(TICK)
