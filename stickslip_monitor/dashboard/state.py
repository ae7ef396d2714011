# SPDX-License-Identifier: Apache-2.0
"""What the page shows: the newest of everything, and who is to be told when it changes.

All of it happens on one event loop; whoever knows something from another thread hands it over
with ``call_soon_threadsafe``.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Iterable
from typing import Any

from stickslip_monitor.dashboard.event_log import EventLog
from stickslip_monitor.dashboard.history import COLUMNS
from stickslip_monitor.dashboard.hub import Hub
from stickslip_monitor.dashboard.watched import Watched, WatchedMonitor
from stickslip_monitor.errors import DashboardError, StickslipError
from stickslip_monitor.monitor.alarms.requests import ActionRequest

PAGE_SCHEMA = 'stickslip_monitor/dashboard/3'


class DashboardState:
    """The newest of all monitors that are shown.

    Args:
        monitors: The monitors; no two of them in one namespace.
        replay: Whether they come from a recording.
        log: What happened; one of its own that keeps nothing if ``None``.

    Attributes:
        monitors: The monitors.
        hub: Who is told of what is new.
        log: What happened.
        links: Of each of the ship's buses whether it works, where buses are watched.
        playing: Of a replay where it is; ``None`` for none.
        finished: Whether the recording is over.
    """

    def __init__(
        self, monitors: Iterable[WatchedMonitor], replay: bool = False, log: EventLog | None = None
    ) -> None:
        self.monitors = tuple(monitors)
        self._replay = replay
        self.hub = Hub(f'{time.time_ns() // 1_000_000:x}')
        self.log = EventLog() if log is None else log
        self.links: dict[str, bool] = {}
        self.playing: dict[str, Any] | None = None
        self.finished = False
        self._told: dict[str, Any] = {}
        for monitor in self.monitors:
            monitor.told, monitor.log = self._take, self.log.extend

    @property
    def bearings(self) -> dict[str, Watched]:
        """The bearings of all monitors by their keys."""
        return {own.key: own for monitor in self.monitors for own in monitor.bearings.values()}

    @property
    def alarms(self) -> dict[str, Any] | None:
        """The alarms of all monitors in one list; ``None`` before any came."""
        known = [monitor.alarms for monitor in self.monitors if monitor.alarms is not None]
        if not known:
            return None
        floods = [record['flood'] for record in known]
        return {
            'time': max(record['time'] for record in known),
            'sounding': any(record['sounding'] for record in known),
            'unacknowledged': sum(record['unacknowledged'] for record in known),
            'flood': max(floods, key=lambda f: (f['flooding'], f['alarms_10min'])),
            'alarms': [alarm for record in known for alarm in record['alarms']],
            'rows': [row for record in known for row in record['rows']],
        }

    @property
    def heard(self) -> bool:
        """Whether anything of any monitor is heard."""
        return not self.finished and any(monitor.heard for monitor in self.monitors)

    @property
    def there(self) -> bool:
        """Whether all that must be heard is: without it nothing is all clear."""
        return self.heard and not self.faults()

    def faults(self) -> list[str]:
        """Why what is shown must not be taken for all there is; a sentence each."""
        if self.finished:
            return []
        return [text for monitor in self.monitors for text in monitor.faults()]

    def notices(self) -> list[str]:
        """What else is wrong, though all bearings are heard; a sentence each."""
        log = f'The log is not kept: {self.log.fault}' if self.log.fault else ''
        return [text for text in (*(monitor.notice() for monitor in self.monitors), log) if text]

    def _take(self, kind: str, document: dict[str, Any], key: str) -> None:
        self.hub.send(kind, self._alarms() if kind == 'alarms' else document, key)
        self._tell()

    def play(self, place: dict[str, Any]) -> None:
        """A replay tells where it is."""
        if place != self.playing:
            self.playing = place
            self.hub.send('replay', place)

    def begin_again(self, place: dict[str, Any]) -> None:
        """The recording starts from its beginning: what came of it is forgotten."""
        self.finished, self.playing = False, place
        self.log.clear()
        for monitor in self.monitors:
            monitor.forget()
        self.hub.send('state', self.state())

    def finish(self) -> None:
        """Nothing more will come: the recording is over."""
        self.finished = True
        self._tell()

    def tick(self) -> None:
        """Let time pass: a monitor that falls silent is told, and a map that is too small grows.

        One map at a time: it takes some 30 ms.
        """
        for own in self.bearings.values():
            if own.widen():
                self.hub.send('map', {'bearing': own.key, **own.map()}, own.key)
                break
        self._tell()

    def _tell(self) -> None:
        monitor = self.monitor()
        told = monitor | {'silent': None, 'faults': len(monitor['faults'])}
        if told != self._told:
            self._told = told
            self.hub.send('monitor', monitor)

    def monitor(self) -> dict[str, Any]:
        """Whether the monitors are there."""
        silences = [monitor.silent_for for monitor in self.monitors]
        known = [round(silent, 1) for silent in silences if silent is not None]
        unheard = [key for monitor in self.monitors for key in monitor.unheard()]
        return {
            'there': self.heard,
            'finished': self.finished,
            'silent': max(known) if len(known) == len(silences) else None,
            'faults': self.faults(),
            'notices': self.notices(),
            'unheard': [] if self.finished else unheard,
        }

    def state(self) -> dict[str, Any]:
        """All that the page shows, for one that has just opened or come back."""
        names = ', '.join(monitor.source for monitor in self.monitors)
        return {
            'schema': PAGE_SCHEMA,
            'source': {'name': names, 'replay': self._replay},
            'monitor': self.monitor(),
            'columns': COLUMNS,
            'bearings': [
                own.state() | {'shelve_time': monitor.shelve_time}
                for monitor in self.monitors
                for own in monitor.bearings.values()
            ],
            'replay': self.playing,
            **self._alarms(),
        }

    def history(self, bearing: str) -> dict[str, Any] | None:
        """The last ten minutes of a bearing, oldest first; ``None`` where there is none."""
        own = self.bearings.get(bearing)
        return None if own is None else {'columns': COLUMNS, 'rows': list(own.history.rows)}

    def _alarms(self) -> dict[str, Any]:
        return {'alarms': self.alarms, 'log': self.log.latest()}

    async def ask(self, request: ActionRequest, patience: float) -> int:
        """Hand a request on to every monitor that it concerns and wait for what comes of it.

        Args:
            request: What is asked for, the bearing by its key.
            patience: How long to wait [s].

        Returns:
            The number of alarms that were changed.

        Raises:
            DashboardError: There is nothing to do, or nothing came of it in time.
            StickslipError: It cannot be handed on.
        """
        owners = [m for m in self.monitors if self._owns(m, request)]
        asked = [m for m in owners if m.alarms is None or m.concerned(request)]
        if not asked:
            raise DashboardError(f'there is nothing to {request.action}')
        counts = await asyncio.gather(
            *(monitor.ask(request, patience) for monitor in asked), return_exceptions=True
        )
        for each in counts:
            if isinstance(each, StickslipError):
                raise each
        return sum(count for count in counts if isinstance(count, int))

    def _owns(self, monitor: WatchedMonitor, request: ActionRequest) -> bool:
        keys = {own.key for own in monitor.bearings.values()}
        return request.bearing is None or request.bearing in keys
