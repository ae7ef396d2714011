# SPDX-License-Identifier: Apache-2.0
"""What the page shows: the newest of everything, what happened, and who is to get the changes.

All of it happens on one event loop; whoever knows something from another thread hands it over
with ``call_soon_threadsafe``.
"""

from __future__ import annotations

import asyncio
import csv
import io
import json
import math
from collections.abc import Iterable
from datetime import datetime, timezone
from itertools import islice
from typing import Any

from stickslip_monitor.dashboard.watched import COLUMNS, Watched, WatchedMonitor
from stickslip_monitor.errors import DashboardError, StickslipError
from stickslip_monitor.monitor.alarms.alarm_records import ActionRequest
from stickslip_monitor.state_file import StateWriter

PAGE_SCHEMA = 'stickslip_monitor/dashboard/3'
KEPT = 5000
"""Entries of the log that are kept; the page shows the latest, a file of CSV has all."""
SHOWN = 60
LOG_SCHEMA = 'stickslip_monitor/log/1'
LOG_TEXTS = ('node', 'bearing', 'alarm', 'priority', 'what', 'from', 'to', 'by', 'text')
_LONGEST = 300
# What a spreadsheet would compute.
_FORMULA = ('=', '+', '-', '@', '\t', '\r')
MOST_READERS = 200
KEPT_READERS = 12
"""Of these so many are kept for people who have signed in, however many programs listen."""


class EventLog:
    """The newest entries, oldest first; each is there once, however often it comes.

    A latched topic sends a dashboard that starts again what the file has already.

    Args:
        store: What keeps the entries over a restart; ``None`` for nothing.
    """

    def __init__(self, store: StateWriter | None = None) -> None:
        self._entries: dict[tuple[Any, ...], dict[str, Any]] = {}
        self._store: StateWriter | None = None
        if store is not None:
            document = store.read()
            known = document.get('entries') if isinstance(document, dict) else None
            self.extend(known if isinstance(known, list) else ())
            self._store = store

    @property
    def fault(self) -> str:
        """Why the newest entries are not on disk; empty where they are, or need not be."""
        return self._store.fault if self._store is not None else ''

    def extend(self, entries: Iterable[Any]) -> None:
        """Add entries; what is none, or is there already, is passed over."""
        before = len(self._entries)
        checked = [entry for entry in map(_checked, entries) if entry is not None]
        for entry in checked:
            self._entries.setdefault(tuple(entry.values()), entry)
        new = len(self._entries) > before
        while len(self._entries) > KEPT:
            del self._entries[next(iter(self._entries))]
        if new and self._store is not None:
            self._store.write({'schema': LOG_SCHEMA, 'entries': list(self._entries.values())})

    def clear(self) -> None:
        """Forget everything: a recording begins anew."""
        self._entries.clear()

    def latest(self) -> list[dict[str, Any]]:
        """What the page shows."""
        return list(islice(reversed(self._entries.values()), SHOWN))[::-1]

    def csv(self) -> str:
        """All that is kept as a table, times in UTC by ISO 8601."""
        text = io.StringIO()
        table = csv.writer(text)
        table.writerow(('time', *LOG_TEXTS))
        table.writerows(
            (_iso(entry['time']), *(_cell(entry[key]) for key in LOG_TEXTS))
            for entry in self._entries.values()
        )
        return text.getvalue()


def _checked(entry: Any) -> dict[str, Any] | None:
    """An entry with a time [ms] or ``None``, and texts that are not too long."""
    if not isinstance(entry, dict):
        return None
    time = entry.get('time')
    texts = {key: str(entry.get(key, ''))[:_LONGEST] for key in LOG_TEXTS}
    return {'time': time if isinstance(time, int) else None, **texts}


def _iso(time_ms: int | None) -> str:
    try:
        when = datetime.fromtimestamp((math.nan if time_ms is None else time_ms) / 1000.0, timezone.utc)
    except (OverflowError, ValueError, OSError):
        return ''
    return when.isoformat(timespec='milliseconds').replace('+00:00', 'Z')


def _cell(text: str) -> str:
    return f"'{text}" if text.startswith(_FORMULA) else text


class Reader:
    """One open stream: of each kind of event the newest that it has not been sent yet.

    So what waits for a reader that does not read is bounded by the number of kinds, and one that
    is slow skips what is out of date.
    """

    def __init__(self) -> None:
        self._waiting: dict[str, bytes] = {}
        self._something = asyncio.Event()
        self.closed = False

    def put(self, key: str, event: bytes) -> None:
        """Let an event wait, in place of an older one of its kind."""
        self._waiting.pop(key, None)
        self._waiting[key] = event
        self._something.set()

    def close(self) -> None:
        """End the stream."""
        self.closed = True
        self._something.set()

    async def take(self) -> bytes:
        """All that waits, as soon as there is something."""
        await self._something.wait()
        self._something.clear()
        events, self._waiting = self._waiting, {}
        return b''.join(events.values())


class Hub:
    """Hands events to every reader."""

    def __init__(self) -> None:
        self.readers: set[Reader] = set()

    def join(self, signed_in: bool = True) -> Reader:
        """A new reader, who has signed in at the page or not.

        Raises:
            DashboardError: There are too many.
        """
        most = MOST_READERS if signed_in else MOST_READERS - KEPT_READERS
        if len(self.readers) >= most:
            raise DashboardError(f'{most} pages are open already; close one')
        reader = Reader()
        self.readers.add(reader)
        return reader

    def leave(self, reader: Reader) -> None:
        """A reader has gone."""
        self.readers.discard(reader)

    def close(self) -> None:
        """End all streams."""
        for reader in self.readers:
            reader.close()

    def send(self, kind: str, document: dict[str, Any], key: str = '') -> None:
        """Give an event to every reader; the key is that among others of its kind."""
        event = event_of(kind, document)
        for reader in self.readers:
            reader.put(f'{kind} {key}', event)


def event_of(kind: str, document: dict[str, Any]) -> bytes:
    """An event as it goes over the wire."""
    data = json.dumps(document, allow_nan=False, separators=(',', ':'))
    return f'event: {kind}\ndata: {data}\n\n'.encode()


class DashboardState:
    """The newest of all monitors that are shown.

    Args:
        monitors: The monitors; no two of them in one namespace.
        log: What happened; one of its own that keeps nothing if ``None``.

    Attributes:
        links: Of each of the ship's buses whether it works, where buses are watched.
        playing: Of a replay where it is; ``None`` for none.
        finished: Whether the recording is over.
    """

    def __init__(
        self, monitors: Iterable[WatchedMonitor], replay: bool = False, log: EventLog | None = None
    ) -> None:
        self.monitors = tuple(monitors)
        self._replay = replay
        self.hub = Hub()
        self.log = EventLog() if log is None else log
        self.links: dict[str, bool] = {}
        self.playing: dict[str, Any] | None = None
        self.finished = False
        self._sent: dict[str, Any] = {}
        for monitor in self.monitors:
            monitor.send, monitor.log = self._take, self.log.extend

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
    def receiving(self) -> bool:
        """Whether anything comes from any monitor."""
        return not self.finished and any(monitor.receiving for monitor in self.monitors)

    def faults(self) -> list[str]:
        """Why what is shown must not be taken for all there is; a sentence each."""
        if self.finished:
            return []
        return [text for monitor in self.monitors for text in monitor.faults()]

    def notices(self) -> list[str]:
        """What else is wrong, though data come from all bearings; a sentence each."""
        log = f'The log is not kept: {self.log.fault}' if self.log.fault else ''
        return [text for text in (*(monitor.notice() for monitor in self.monitors), log) if text]

    def _take(self, kind: str, document: dict[str, Any], key: str) -> None:
        if kind == 'alarms':
            document = {'alarms': self.alarms, 'log': self.log.latest()}
        self.hub.send(kind, document, key)
        self._tell()

    def play(self, place: dict[str, Any]) -> None:
        """A replay reports where it is."""
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
        """Let time pass: report a monitor that falls silent, enlarge a map that is too small.

        One map at a time: it takes some 30 ms.
        """
        for own in self.bearings.values():
            if own.widen():
                self.hub.send('map', {'bearing': own.key, **own.map()}, own.key)
                break
        self._tell()

    def _tell(self) -> None:
        monitor = self.monitor()
        state = monitor | {'silent': None, 'faults': len(monitor['faults'])}
        if state != self._sent:
            self._sent = state
            self.hub.send('monitor', monitor)

    def monitor(self) -> dict[str, Any]:
        """Whether the monitors are there."""
        silences = [monitor.silent_for for monitor in self.monitors]
        known = [round(silent, 1) for silent in silences if silent is not None]
        missing = [key for monitor in self.monitors for key in monitor.missing()]
        return {
            'there': self.receiving,
            'finished': self.finished,
            'silent': max(known) if len(known) == len(silences) else None,
            'faults': self.faults(),
            'notices': self.notices(),
            'missing': [] if self.finished else missing,
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
            'alarms': self.alarms,
            'log': self.log.latest(),
        }

    def history(self, bearing: str) -> dict[str, Any] | None:
        """The last ten minutes of a bearing, oldest first; ``None`` where there is none."""
        own = self.bearings.get(bearing)
        return None if own is None else {'columns': COLUMNS, 'rows': list(own.history)}

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
        asked = [
            m
            for m in self.monitors
            if request.bearing in (None, *(own.key for own in m.bearings.values()))
            and (m.alarms is None or m.concerned(request))
        ]
        if not asked:
            raise DashboardError(f'there is nothing to {request.action}')
        counts = await asyncio.gather(
            *(monitor.ask(request, patience) for monitor in asked), return_exceptions=True
        )
        for each in counts:
            if isinstance(each, StickslipError):
                raise each
        return sum(count for count in counts if isinstance(count, int))
