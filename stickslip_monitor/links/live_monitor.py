# SPDX-License-Identifier: Apache-2.0
"""The monitor and its alarms on an event loop, without ROS."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol

from stickslip_monitor.monitor.alarms.live_alarms import LiveAlarms, Log, Store
from stickslip_monitor.monitor.alarms.requests import ActionRequest
from stickslip_monitor.monitor.config import MonitorConfig
from stickslip_monitor.monitor.config_file import NODE_NAME
from stickslip_monitor.monitor.messages import diagnostic_record, state_of
from stickslip_monitor.monitor.monitor import Monitor
from stickslip_monitor.monitor.verdict import Event

TICK = 0.1
"""Time between two looks at the inputs [s]."""
BEHIND_NS = 500_000_000
"""The passing of time is told so late that a sample delivered late is not overtaken."""
_SHOWN_EVERY = 1.0


class Sink(Protocol):
    """What shows bearings and alarms: a bus, or the dashboard's page."""

    def take_status(
        self, bearing: str, time_ns: int, text: str, values: Mapping[str, str]
    ) -> None:
        """The diagnostic status of a bearing has come."""

    def take_alarms(self, record: dict[str, Any]) -> None:
        """The list of alarms has changed."""


class LiveMonitor:
    """Monitor and alarms, fed with numbers as they arrive.

    Stamps are of this machine's clock as it was at the start, carried on by one that never
    steps: a clock that is set later moves no delay and loses no input.

    Args:
        config: The configuration.
        sinks: What shows bearings and alarms.
        log: Where events and people's actions are told.
        store: What keeps the alarms over a restart; ``None`` for nothing.
        clock: Time that never steps [ns].
    """

    def __init__(
        self,
        config: MonitorConfig,
        sinks: Sequence[Sink],
        log: Log,
        store: Store | None = None,
        clock: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self._sinks, self._log, self._clock = sinks, log, clock
        self._begun_ns = clock()
        self._ahead_ns = time.time_ns() - self._begun_ns
        self._monitor = Monitor(config)
        self._alarms = LiveAlarms(config, self._now_ns, self._publish, log, store)
        self._shown_ns = 0

    def _now_ns(self) -> int:
        return self._clock() + self._ahead_ns

    def _publish(self, record: dict[str, Any]) -> None:
        for sink in self._sinks:
            sink.take_alarms(record)

    def take(self, bearing: str, is_load: int, value: float) -> None:
        """Take one number of one input (0 speed, 1 load), measured now."""
        now_ns = self._now_ns()
        update = self._monitor.bearings[bearing].update(is_load, now_ns, value)
        self._alarms.feed(bearing, is_load, now_ns, update)
        self._tell(update.events)

    def act(self, request: ActionRequest) -> None:
        """Do what a person asks for."""
        self._alarms.act(request.action, request.by, request.bearing, request.kind, request.reason)

    def tick(self) -> None:
        """Let time pass."""
        now_ns = self._now_ns()
        events = self._monitor.advance(now_ns - BEHIND_NS)
        self._alarms.feed_events(events)
        self._alarms.advance(self._clock() - self._begun_ns)
        self._tell(events)
        if now_ns - self._shown_ns >= _SHOWN_EVERY * 1e9:
            self._show()

    async def run(self) -> None:
        """Publish the list of alarms, and let time pass from now on until cancelled."""
        self._monitor.advance(self._now_ns())
        self._alarms.begin()
        while True:
            self.tick()
            await asyncio.sleep(TICK)

    def _tell(self, events: Sequence[Event]) -> None:
        for event in events:
            (self._log.warning if event.raised else self._log.info)(event.text)
        if events:
            # At the next tick: the alarm itself must not wait for the figures beside it.
            self._shown_ns = 0

    def _show(self) -> None:
        self._shown_ns = self._now_ns()
        for name, bearing in self._monitor.bearings.items():
            record = diagnostic_record(NODE_NAME, state_of(bearing))
            for sink in self._sinks:
                sink.take_status(name, self._shown_ns, record.message, record.values)
