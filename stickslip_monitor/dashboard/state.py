# SPDX-License-Identifier: Apache-2.0
"""Server-sent events to many readers, none of which can hold up another or fill the memory.

What the page shows: the newest of everything, and who is to be told when it changes.

All of it happens on one event loop; whoever knows something from another thread hands it over
with ``call_soon_threadsafe``.
"""

from __future__ import annotations

import asyncio
import json
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

from stickslip_monitor.dashboard.received import (
    BearingStatus,
    checked_alarms,
    offered,
    read_status,
    status_record,
)
from stickslip_monitor.errors import DashboardError
from stickslip_monitor.monitor.alarms.requests import ActionRequest

MOST_READERS = 200


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
    """Hands events to every reader.

    Args:
        run: What tells the events of this process from those of another.
    """

    def __init__(self, run: str) -> None:
        self._run = run
        self._number = 0
        self.readers: set[Reader] = set()

    def join(self) -> Reader:
        """A new reader.

        Raises:
            DashboardError: There are too many.
        """
        if len(self.readers) >= MOST_READERS:
            raise DashboardError(f'{MOST_READERS} pages are open already; close one')
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
        """Give an event to every reader.

        Args:
            kind: Its name.
            document: What it says.
            key: What tells it from others of that name that do not replace it.
        """
        event = self.event(kind, document)
        for reader in self.readers:
            reader.put(f'{kind} {key}', event)

    def event(self, kind: str, document: dict[str, Any]) -> bytes:
        """An event as it goes over the wire, under a number of its own."""
        self._number += 1
        data = json.dumps(document, allow_nan=False, separators=(',', ':'))
        return f'id: {self._run}-{self._number}\nevent: {kind}\ndata: {data}\n\n'.encode()


PAGE_SCHEMA = 'stickslip_monitor/dashboard/1'
TRAIL = 600
"""Operating points of each bearing that the page remembers."""
LOG = 60
"""Changes of alarms that the page remembers."""
SILENT = 3.0
"""A monitor of which nothing has been heard for so long is not believed to be there [s]."""

ALARMS_SILENT = 150.0
"""The list of alarms comes at least once a minute; after so long it is not believed [s]."""
MOST_NAMES = 20
"""Other monitors and bearings that are remembered, to tell of them."""

_NO_ANSWER = 'the monitor has not answered: nothing is known to be done'
_NO_ALARMS = 'the list of alarms has not come from the monitor: nothing was done'


class Desk(Protocol):
    """Where the alarms are; what it does arrives by :meth:`DashboardState.take_alarms`."""

    def act(self, request: ActionRequest) -> None:
        """Hand a request on.

        Raises:
            StickslipError: It cannot be handed on.
        """


@dataclass(frozen=True, slots=True)
class Curves:
    """The stability map as loads over speed; ``None`` where there is no boundary.

    Attributes:
        speed: Surface speeds, rising [m/s].
        caution, fold, hopf: Load from which the fold margin is below the caution margin, a cycle
            exists, and the equilibrium is unstable [N].
    """

    speed: list[float]
    caution: list[float | None]
    fold: list[float | None]
    hopf: list[float | None]


@dataclass(frozen=True, slots=True)
class BearingView:
    """What the page is told of a bearing once.

    Attributes:
        name: Name of the bearing.
        rpm: Shaft speed at a surface speed of 1 m/s [rpm].
        speeds, loads: Ends of the map [m/s], [N].
        curves: What divides it.
        caution_margin: Fold margin below which the alarm says caution.
        amplitude_limit: Amplitude that raises the amplitude alarm [m]; ``None`` for none.
        topics: Where speed and load are read, by quantity.
    """

    name: str
    rpm: float
    speeds: tuple[float, float]
    loads: tuple[float, float]
    curves: Curves
    caution_margin: float
    amplitude_limit: float | None
    topics: dict[str, str]


@dataclass(slots=True)
class _Bearing:
    view: BearingView
    status: BearingStatus | None = None
    trail: deque[tuple[float, float]] = field(default_factory=lambda: deque(maxlen=TRAIL))
    believed: dict[str, int] = field(default_factory=dict)
    heard: dict[str, float] = field(default_factory=dict)
    at: float | None = None


class DashboardState:
    """The newest of everything.

    Args:
        views: The bearings.
        source: Where it comes from, for a person: the node's name, or the recording's.
        replay: Whether it comes from a recording.
        clock: Time that never steps [s].

    Attributes:
        alarms: The newest list of alarms.
        links: Of each of the ship's buses whether it works, where buses are watched.
    """

    def __init__(
        self,
        views: Iterable[BearingView],
        source: str,
        replay: bool = False,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._bearings = {view.name: _Bearing(view) for view in views}
        self._source = {'name': source, 'replay': replay}
        self._clock = clock
        self.hub = Hub(f'{time.time_ns() // 1_000_000:x}')
        self.alarms: dict[str, Any] | None = None
        self.links: dict[str, bool] = {}
        self._log: deque[dict[str, Any]] = deque(maxlen=LOG)
        self._heard_at: float | None = None
        self._listed_at: float | None = None
        self._foreign: dict[str, float] = {}
        self._others: dict[str, float] = {}
        self._told: dict[str, Any] = {}
        self._expected: list[tuple[ActionRequest, asyncio.Future[int]]] = []
        self.finished = False

    @property
    def bearings(self) -> list[str]:
        """Names of the bearings."""
        return list(self._bearings)

    def status(self, bearing: str) -> BearingStatus | None:
        """The newest of a bearing."""
        return self._bearings[bearing].status

    @property
    def silent_for(self) -> float | None:
        """Time since anything was heard of the monitor [s]; ``None`` before it was."""
        return None if self._heard_at is None else self._clock() - self._heard_at

    @property
    def heard(self) -> bool:
        """Whether anything of the monitor is heard."""
        silent = self.silent_for
        return silent is not None and silent < SILENT and not self.finished

    @property
    def there(self) -> bool:
        """Whether all that must be heard is: without it nothing is all clear."""
        return self.heard and not self.faults()

    def unheard(self) -> list[str]:
        """Bearings of which nothing is heard."""
        now = self._clock()
        return [
            name
            for name, own in self._bearings.items()
            if own.at is None or now - own.at >= SILENT
        ]

    def faults(self) -> list[str]:
        """Why what is shown must not be taken for all there is; a sentence each."""
        if self.finished:
            return []
        name = self._source['name']
        if self.silent_for is None:
            others = ', '.join(self._others)
            there = f' There are other monitors: {others}; see --node.' if others else ''
            return [f'Nothing has been heard of the monitor {name} yet.{there}']
        if not self.heard and not self._idle():
            return [f'The monitor has been silent for {self.silent_for:.0f} s.']
        return [text for text in self._gaps(name) if text]

    def _gaps(self, name: object) -> Iterator[str]:
        if self._idle():
            yield 'Not monitoring: the node is not active, and nobody watches the bearings.'
            return
        if missing := self.unheard():
            yield f'Of {_listed(missing)} nothing is heard: {name} does not watch it.'
        now = self._clock()
        foreign = [each for each, at in self._foreign.items() if now - at < ALARMS_SILENT]
        if foreign:
            yield f'{_listed(foreign)}: watched by {name}, but not in --config, so not shown.'
        if self.alarms is None or self._listed_at is None:
            yield 'The list of alarms has not come: it is not known whether any stands.'
        elif not self._source['replay'] and now - self._listed_at > ALARMS_SILENT:
            late = now - self._listed_at
            yield f'The list of alarms is {late:.0f} s old: later alarms are not known.'

    def _idle(self) -> bool:
        told = self.alarms is not None and not self.alarms['monitoring']
        return told or any(own.status and own.status.idle for own in self._bearings.values())

    def sample_age(self, bearing: str, quantity: str) -> float | None:
        """Time since an input's last believed sample was noticed [s]; ``None`` without one."""
        at = self._bearings[bearing].heard.get(quantity)
        return None if at is None else self._clock() - at

    def take_status(
        self, bearing: str, time_ns: int, text: str, values: Mapping[str, str]
    ) -> None:
        """A diagnostic status of a bearing has come; of one that is not known it is ignored."""
        own = self._bearings.get(bearing)
        if own is None:
            self._remember(self._foreign, bearing)
            return
        own.status = status = read_status(time_ns, text, values)
        self._heard_at = own.at = self._clock()
        for quantity in status.counts:
            count = status.believed(quantity)
            if count > own.believed.get(quantity, 0):
                own.heard[quantity] = self._heard_at
            own.believed[quantity] = count
        record = status_record(status)
        point = (record['speed'], record['load'])
        if None not in point and (not own.trail or own.trail[-1] != point):
            own.trail.append(point)
        self.hub.send('status', {'bearing': bearing, **record}, bearing)
        self.tick()

    def take_alarms(self, document: Any) -> None:
        """The list of alarms has come; what is none is ignored."""
        record = checked_alarms(document, self._bearings)
        if record is None:
            return
        self.alarms, self._listed_at = record, self._clock()
        for alarm in document['alarms']:
            if alarm['bearing'] not in self._bearings:
                self._remember(self._foreign, alarm['bearing'])
        self._log.extend(record['changes'])
        self.hub.send('alarms', self._alarms())
        for request, done in self._expected:
            if not done.done() and (count := _answers(record['changes'], request)):
                done.set_result(count)
        self.tick()

    def take_other(self, node: str) -> None:
        """Another monitor than the one that is shown has been heard."""
        self._remember(self._others, f'/{node}')

    def _remember(self, names: dict[str, float], name: str) -> None:
        if name in names or len(names) < MOST_NAMES:
            names[name] = self._clock()

    def finish(self) -> None:
        """Nothing more will come: the recording is over."""
        self.finished = True
        self.tick()

    def tick(self) -> None:
        """Let time pass: a monitor that falls silent, or is heard again, is told at once."""
        told = {
            'there': self.heard,
            'finished': self.finished,
            'faults': len(self.faults()),
            'unheard': self.unheard(),
        }
        if told != self._told:
            self._told = told
            self.hub.send('monitor', self.monitor())

    def monitor(self) -> dict[str, Any]:
        """Whether the monitor is there."""
        silent = self.silent_for
        return {
            'there': self.heard,
            'finished': self.finished,
            'silent': None if silent is None else round(silent, 1),
            'faults': self.faults(),
            'unheard': [] if self.finished else self.unheard(),
        }

    def state(self) -> dict[str, Any]:
        """All that the page shows, for one that has just opened or come back."""
        return {
            'schema': PAGE_SCHEMA,
            'source': self._source,
            'monitor': self.monitor(),
            'bearings': [_state(own) for own in self._bearings.values()],
            **self._alarms(),
        }

    def _alarms(self) -> dict[str, Any]:
        return {'alarms': self.alarms, 'log': list(self._log)}

    async def ask(self, desk: Desk, request: ActionRequest, patience: float) -> int:
        """Hand a request on and wait for what comes of it.

        Args:
            desk: Where to.
            request: What is asked for.
            patience: How long to wait [s].

        Returns:
            The number of alarms that were changed.

        Raises:
            DashboardError: There is nothing to do, or nothing came of it in time.
            StickslipError: It cannot be handed on.
        """
        if self.alarms is None:
            raise DashboardError(_NO_ALARMS)
        if not offered(self.alarms, request):
            raise DashboardError(f'there is nothing to {request.action}')
        entry = (request, asyncio.get_running_loop().create_future())
        self._expected.append(entry)
        try:
            desk.act(request)
            return await asyncio.wait_for(entry[1], patience)
        except asyncio.TimeoutError as error:
            raise DashboardError(' '.join([_NO_ANSWER, *self.faults()])) from error
        finally:
            self._expected.remove(entry)


def _listed(names: list[str]) -> str:
    few = ', '.join(names[:5])
    return few if len(names) <= 5 else f'{few} and {len(names) - 5} more'


def _state(own: _Bearing) -> dict[str, Any]:
    view = own.view
    return {
        'name': view.name,
        'rpm': view.rpm,
        'speeds': view.speeds,
        'loads': view.loads,
        'curves': {
            'speed': view.curves.speed,
            'caution': view.curves.caution,
            'fold': view.curves.fold,
            'hopf': view.curves.hopf,
        },
        'caution_margin': view.caution_margin,
        'amplitude_limit': view.amplitude_limit,
        'topics': view.topics,
        'status': None if own.status is None else status_record(own.status),
        'trail': list(own.trail),
    }


def _answers(changes: list[dict[str, Any]], request: ActionRequest) -> int:
    """How many of some changes are what was asked for."""
    return sum(
        change['by'] == request.by
        and change['what'] == request.action.value
        and request.bearing in (None, change['bearing'])
        and request.kind in (None, change['alarm'])
        for change in changes
    )
