# SPDX-License-Identifier: Apache-2.0
"""The monitors as the dashboard sees them: their bearings, their alarms, their log, what is missing.

All of it happens on one event loop; whoever knows something from another thread hands it over with
``call_soon_threadsafe``.
"""

from __future__ import annotations

import asyncio
import math
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from stickslip_logs.units import SECOND_NS
from stickslip_monitor.dashboard.event_log import EventLog
from stickslip_monitor.dashboard.page_records import checked_alarms, checked_record
from stickslip_monitor.errors import DashboardError
from stickslip_monitor.host import SHOW_NS
from stickslip_monitor.monitor.alarm_records import ActionRequest
from stickslip_monitor.monitor.bearing_records import POINT_NUMBERS
from stickslip_monitor.monitor.session import HEARTBEAT_NS, Sink
from stickslip_monitor.monitor.statements import duration_text

SILENT = 3.0 * SHOW_NS / SECOND_NS
"""A monitor without a message for so long is taken for gone [s]: three records should have come."""
ALARMS_SILENT = 2.5 * HEARTBEAT_NS / SECOND_NS
"""A list of alarms older than this is too old [s]: two should have come since."""
MAX_NAMES = 20
"""Other monitors and bearings that are remembered, to report them."""
NOT_MONITORING = 'not_monitoring'
"""The reason of a bearing whose node is not active."""
# Rows of the history that must all be beyond the map before it is enlarged.
_BEYOND = 5
# A fold that is off by more than this share of its load is of other parameters: a map has 1 %.
_OTHER_MAP = 0.1
# A map that is made for an operating point has this much room beyond its speed and its load.
_ROOM = (1.2, 1.5)
_NO_ANSWER = 'no answer from the monitor: it may not have been done'
_NO_ALARMS = 'the list of alarms has not come from the monitor: nothing was done'

SPAN = 600_000
"""How far back the history of a bearing goes [ms]."""
STEP = 1000
"""Its rows are so far apart, or further [ms]."""
_PROBABILITIES = (name for name in POINT_NUMBERS if name.startswith('probability'))
_OF_POINT = ('fold_speed', 'hopf_speed', 'fold_margin', 'hopf_margin', *_PROBABILITIES)
COLUMNS = ('time', 'speed', 'load', *_OF_POINT)
"""Time [ms], speed [m/s], load [N], boundaries [m/s], margins and probabilities [-]."""
_OF_MAP = ('speeds', 'loads', 'curves')
_OF_VIEW = ('rpm', 'caution_margin', 'amplitude_limit', 'topics', *_OF_MAP)


@dataclass(frozen=True, slots=True)
class BearingView:
    """Facts on a bearing that the page gets once."""

    name: str
    rpm: float  # shaft speed at a surface speed of 1 m/s [rpm]
    speeds: tuple[float, float]  # ends of the stability map [m/s]
    loads: tuple[float, float]  # ends of its other axis [N]
    # What divides it: ``speed``, rising [m/s], and for each the load from which the fold margin is
    # below the ``caution`` margin, a cycle exists (``fold``), and the equilibrium is unstable
    # (``hopf``) [N]; ``None`` where there is no such load.
    curves: dict[str, list[float | None]]
    caution_margin: float  # fold margin below which the alarm says caution
    # Amplitude that raises the amplitude alarm [m]; ``None`` for none.
    amplitude_limit: float | None
    topics: dict[str, str]  # where speed and load are read, by quantity
    # Makes the view anew with a map that goes up to a load [N], and to a speed [m/s] and the fold
    # at that load.
    wider: Callable[[float, float], BearingView] | None = None


@dataclass(slots=True)
class Watched:
    """A bearing: its view, and its records received so far."""

    key: str  # its name with the namespace of its node, as the page knows it: ``port/aft``
    view: BearingView  # what the page gets of it once
    record: dict[str, Any] | None = None  # the newest, for the page; ``None`` before it came
    # The last ten minutes, a row a second, of :data:`COLUMNS`.
    history: deque[list[Any]] = field(default_factory=lambda: deque(maxlen=SPAN // STEP))
    at: float | None = None  # when the newest came [s]
    fitted: bool = False  # whether the map is made for an operating point
    off_map: bool = False  # whether the newest is of other parameters than the map

    def take(self, record: dict[str, Any], now: float) -> dict[str, Any]:
        """Store a checked record, which came at ``now`` of the monitor's clock [s]; add it to the history.

        In the history it replaces those of its second and all later ones (after a clock step); those older
        than :data:`SPAN` are dropped. :attr:`off_map` is updated.

        Returns:
            A copy of the record, which is what is stored, with its row of the history under ``row``:
            ``None`` where a lost input leaves no value.
        """
        # What rests on a lost input has no value, though the last one is still published.
        hidden = {name for name in ('speed', 'load') if record['inputs'].get(name, {}).get('lost')}
        hidden |= set(_OF_POINT) if hidden else set()
        row, rows = [None if name in hidden else record[name] for name in COLUMNS], self.history
        while rows and rows[-1][0] // STEP >= record['time'] // STEP:
            rows.pop()
        while rows and rows[0][0] < record['time'] - SPAN:
            rows.popleft()
        rows.append(row)
        self.record, self.at, self.off_map = record | {'row': row}, now, self._is_off_map(record)
        return self.record

    def map(self) -> dict[str, Any]:
        """Return the stability map for the page: ``speeds``, ``loads`` and ``curves`` of the view."""
        return {name: getattr(self.view, name) for name in _OF_MAP}

    def state(self) -> dict[str, Any]:
        """Return all that the page shows of it, but for its history.

        Its record is under ``status``: ``None`` before one came.
        """
        view_fields = {name: getattr(self.view, name) for name in _OF_VIEW}
        return {'name': self.key, **view_fields, 'status': self.record}

    def _is_off_map(self, record: Mapping[str, Any]) -> bool:
        """Return whether a record has the averaged fold at its load more than 10 % beside that of the map.

        False where the record or the map has none.
        """
        if record['load'] is None or not self.view.curves:
            return False
        speed, load = (np.array(self.view.curves[name], dtype=float) for name in ('speed', 'fold'))
        fold = np.array(record['fold_speed_kbm'], dtype=float)  # nan for None
        mapped = np.interp(fold, speed, load, math.nan, math.nan)
        return bool(abs(mapped - record['load']) > _OTHER_MAP * mapped)

    def widen(self) -> bool:
        """Replace the view by one with a larger map where that is needed; return whether it was replaced.

        It is needed where the last rows of the history, :data:`_BEYOND` of them, are all beyond the map: a
        single wrong sample does not make a map on which nothing can be seen. The first rows make a map of
        their own size, which may be smaller. A view without :attr:`~BearingView.wider` stays.
        """
        wider, rows = self.view.wider, list(self.history)[-_BEYOND:]
        lately = [row for row in rows if row[1] is not None and row[2] is not None]
        if wider is None or len(lately) < (_BEYOND if self.fitted else 1):
            return False
        ends = (self.view.speeds[1], self.view.loads[1]) if self.fitted else (0.0, 0.0)
        nearest = [min(abs(row[k]) for row in lately) for k in (1, 2)]
        wanted = [
            room * now if now > end else end for now, end, room in zip(nearest, ends, _ROOM, strict=True)
        ]
        if tuple(wanted) == ends:
            return False
        self.view, self.fitted = wider(*wanted), True
        return True


class WatchedMonitor(Sink):
    """Latest records of one monitor.

    Args:
        source: Where it comes from, for a person: the node's full name, or the recording's.
        views: Its bearings as the page shows them.
        space: Namespace of its node, without slashes around it; empty for none.
        replay: Whether its data come from a recording: then a list of alarms is never too old.
        shelve_time: For how long an alarm is shelved [s].
        clock: Time that never steps [s].

    Attributes:
        bearings: The bearings by their names.
        alarms: The newest list of alarms for the page; ``None`` before it came.
        act: Forwards a request to it; the changes that answer it arrive by :meth:`take_alarms`.
        send: Called with what is new for the page: kind, document and key.
        log: Called with what happened.
    """

    act: Callable[[ActionRequest], object]
    send: Callable[[str, dict[str, Any], str], None]
    log: Callable[[list[dict[str, Any]]], None]

    def __init__(
        self,
        source: str,
        views: Iterable[BearingView],
        space: str = '',
        replay: bool = False,
        shelve_time: float = 0.0,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.source, self.space, self.shelve_time = source, space, shelve_time
        self._views, self._replay, self._clock = tuple(views), replay, clock
        self._others: dict[str, float] = {}
        self._expected: list[tuple[ActionRequest, asyncio.Future[int]]] = []
        self.forget()

    def forget(self) -> None:
        """Forget the records, alarms and health received; maps get their first size.

        Other monitors and open requests stay known.
        """
        self.bearings = {view.name: Watched(self.key(view.name), view) for view in self._views}
        self.alarms: dict[str, Any] | None = None
        self._health: tuple[int, str] = (0, '')
        self._received_at: float | None = None
        self._listed_at = 0.0
        self._foreign: dict[str, float] = {}

    @property
    def namespace(self) -> str:
        """The namespace of its node, with a slash before it."""
        return f'/{self.space}'

    def key(self, bearing: str) -> str:
        """Return a bearing's name in the namespace of its node, as in the diagnostics."""
        return f'{self.space}/{bearing}' if self.space else bearing

    @property
    def silent_for(self) -> float | None:
        """Time since its last record of a bearing that is shown [s]; ``None`` before the first."""
        return None if self._received_at is None else self._clock() - self._received_at

    @property
    def is_receiving(self) -> bool:
        """Whether a record came from it within :data:`SILENT`."""
        silent = self.silent_for
        return silent is not None and silent < SILENT

    def missing_bearings(self) -> list[str]:
        """Return the keys of the bearings that have had no record for :data:`SILENT`, or never."""
        now = self._clock()
        return [
            bearing.key
            for bearing in self.bearings.values()
            if bearing.at is None or now - bearing.at >= SILENT
        ]

    def faults(self) -> list[str]:
        """Return the reasons why what is shown may be incomplete or old, a sentence each; empty for none."""
        name = self.source
        if self.silent_for is None:
            other_names = ', '.join(self._others)
            hint = f' Other monitors run: {other_names}; see --node.' if other_names else ''
            return [f'No data from the monitor {name} yet.{hint}']
        if self._is_idle():
            return [f'Not monitoring: {name} is not active; its bearings are not watched.']
        if not self.is_receiving:
            return [f'The monitor {name} has been silent for {duration_text(self.silent_for)}.']
        return list(self._gap_sentences(name))

    def _gap_sentences(self, name: str) -> Iterator[str]:
        """Yield a sentence on each thing missing from what is shown of the monitor, called ``name`` in it."""
        if missing := self.missing_bearings():
            yield f'No data on {_list_names(missing)}: {name} does not watch it.'
        now = self._clock()
        foreign = [bearing for bearing, at in self._foreign.items() if now - at < ALARMS_SILENT]
        if foreign:
            yield f'{_list_names(foreign)}: watched by {name}, but not in --config, so not shown.'
        late = now - self._listed_at
        if self.alarms is None:
            yield f'No list of alarms from {name} yet: alarm state unknown.'
        elif not self._replay and late > ALARMS_SILENT:
            yield f'The list of alarms of {name} is {duration_text(late)} old: newer alarms are missing.'

    def notice(self) -> str:
        """Return a text on the node's own faults, and on bearings whose map is of another parameter file.

        Empty without any, and while the monitor is silent or not active.
        """
        if not self.is_receiving or self._is_idle():
            return ''
        level, text = self._health
        sentences = [f'{self.source}: {text}'] if level else []
        if off_map := [bearing.key for bearing in self.bearings.values() if bearing.off_map]:
            sentences.append(
                f'{_list_names(off_map)}: the map is that of --config, and {self.source} has'
                ' other parameters.'
            )
        return ' '.join(sentences)

    def _is_idle(self) -> bool:
        """Return whether the node reports that it watches no bearing; false before it reports anything."""
        records = [bearing.record for bearing in self.bearings.values() if bearing.record is not None]
        idle = self.alarms is not None and not self.alarms['monitoring']
        return idle or any(record['reason'] == NOT_MONITORING for record in records)

    def take_record(self, document: Any) -> None:
        """Check and store the record of a bearing, and send it to the page.

        An invalid one is ignored; of an unknown bearing only the name is stored, for :meth:`faults`.
        """
        record = checked_record(document)
        if record is None:
            return
        bearing = self.bearings.get(record['bearing'])
        if bearing is None:
            self._remember_name(self._foreign, self.key(record['bearing']))
            return
        self._received_at = self._clock()
        self._name_fully(record)
        self.send('status', bearing.take(record, self._received_at), bearing.key)

    def take_health(self, level: int, text: str) -> None:
        """Store the diagnostic status of the node itself, for :meth:`notice`; levels are those of ROS."""
        self._health = (level, text)

    def take_alarms(self, document: Any) -> None:
        """Store the list of alarms and send it to the page; ignore an invalid one.

        Its changes and notes are logged, and the requests that they answer (:meth:`ask`) are completed. Of
        bearings that are not shown only the names are stored, for :meth:`faults`.
        """
        record = checked_alarms(document, self.bearings)
        if record is None:
            return
        for item in (*record['alarms'], *record['rows'], *record['changes']):
            self._name_fully(item)
        self.alarms, self._listed_at = record, self._clock()
        for alarm in document['alarms']:
            if alarm['bearing'] not in self.bearings:
                self._remember_name(self._foreign, self.key(alarm['bearing']))
        entries = [item | {'node': self.source} for item in record['notes'] + record['changes']]
        self.log(sorted(entries, key=lambda entry: entry['time'] or 0))
        self.send('alarms', {}, '')
        for request, done in self._expected:
            by_it = request.by, request.action.value
            answers = sum(
                (change['by'], change['what']) == by_it and _is_about(request, change)
                for change in record['changes']
            )
            if answers and not done.done():
                done.set_result(answers)

    def take_other(self, node: str) -> None:
        """Store the name of a monitor that is not shown, less its first slash, for :meth:`faults`."""
        self._remember_name(self._others, f'/{node}')

    def _name_fully(self, record: dict[str, Any]) -> None:
        """Put the namespace, if any, before the bearing's name in a record and at the head of its text."""
        if self.space and record['text'].startswith(f'{record["bearing"]}: '):
            record['text'] = f'{self.space}/{record["text"]}'
        record['bearing'] = self.key(record['bearing'])

    def _remember_name(self, names: dict[str, float], name: str) -> None:
        """Store in ``names`` when a name came last [s]; ignore a new one beyond :data:`MAX_NAMES`."""
        if name in names or len(names) < MAX_NAMES:
            names[name] = self._clock()

    def is_concerned(self, request: ActionRequest) -> bool:
        """Return whether a request is about a bearing here, and could change an alarm as far as is known."""
        if request.bearing not in (None, *(bearing.key for bearing in self.bearings.values())):
            return False
        return self.alarms is None or any(
            request.action.value in alarm['actions'] and _is_about(request, alarm)
            for alarm in self.alarms['alarms']
        )

    async def ask(self, request: ActionRequest, patience: float) -> int:
        """Hand a request on, and wait up to ``patience`` [s] for the changes of alarms that answer it.

        Returns:
            The number of alarms that were changed.

        Raises:
            DashboardError: No list of alarms came yet, or no answer in time.
            StickslipError: The request cannot be handed on.
        """
        if self.alarms is None:
            raise DashboardError(_NO_ALARMS)
        entry = (request, asyncio.get_running_loop().create_future())
        self._expected.append(entry)
        names: dict[str | None, str] = {bearing.key: name for name, bearing in self.bearings.items()}
        try:
            self.act(replace(request, bearing=names.get(request.bearing)))
            return await asyncio.wait_for(entry[1], patience)
        except asyncio.TimeoutError as error:
            raise DashboardError(' '.join([_NO_ANSWER, *self.faults()])) from error
        finally:
            self._expected.remove(entry)


def _is_about(request: ActionRequest, alarm: dict[str, Any]) -> bool:
    """Return whether a request is about an alarm: its bearing and kind are the alarm's, or ``None``."""
    return request.bearing in (None, alarm['bearing']) and request.kind in (None, alarm['alarm'])


def _list_names(names: list[str]) -> str:
    """Return the first five names with commas between, and how many more there are."""
    first_names = ', '.join(names[:5])
    return first_names if len(names) <= 5 else f'{first_names} and {len(names) - 5} more'


PAGE_SCHEMA = 'stickslip_monitor/dashboard/3'


class DashboardState:
    """Latest records of all monitors that are shown.

    Args:
        monitors: The monitors; no two of them in one namespace. Their ``send`` and ``log`` become ours.
        replay: Whether a recording is shown.
        log: What happened; one of its own that keeps nothing if ``None``.

    Attributes:
        links: Whether each link to the ship's buses works, by its name; one of unknown state is absent.
        playing: Place of a replay: ``at`` and ``length`` [s], ``paused``; ``None`` where none is played.
        finished: Whether the recording is over.
        send: Called with what is new for the page: kind, document and key.
    """

    def __init__(
        self, monitors: Iterable[WatchedMonitor], replay: bool = False, log: EventLog | None = None
    ) -> None:
        self.monitors = tuple(monitors)
        self._replay = replay
        self.log = EventLog() if log is None else log
        self.links: dict[str, bool] = {}
        self.playing: dict[str, Any] | None = None
        self.finished = False
        self.send: Callable[[str, dict[str, Any], str], None] = lambda kind, document, key: None
        self._sent: dict[str, Any] = {}
        for monitor in self.monitors:
            monitor.send, monitor.log = self._send_news, self.log.extend

    @property
    def bearings(self) -> dict[str, Watched]:
        """The bearings of all monitors by their keys."""
        return {bearing.key: bearing for monitor in self.monitors for bearing in monitor.bearings.values()}

    @property
    def alarms(self) -> dict[str, Any] | None:
        """The alarms of all monitors in one list; ``None`` before any came."""
        records = [monitor.alarms for monitor in self.monitors if monitor.alarms is not None]
        if not records:
            return None
        floods = [record['flood'] for record in records]
        return {
            'time': max(record['time'] for record in records),
            'sounding': any(record['sounding'] for record in records),
            'unacknowledged': sum(record['unacknowledged'] for record in records),
            'flood': max(floods, key=lambda f: (f['flooding'], f['alarms_10min'])),
            'alarms': [alarm for record in records for alarm in record['alarms']],
            'rows': [row for record in records for row in record['rows']],
        }

    def _send_news(self, kind: str, document: dict[str, Any], key: str) -> None:
        """Send an event of a monitor to the page, then the state of the monitors if it changed.

        Args:
            kind: Name of the event; of ``alarms`` those of all monitors are sent, with the log.
            document: Its content; not used for ``alarms``.
            key: The bearing that it is about, as the page knows it; '' for none.
        """
        if kind == 'alarms':
            document = {'alarms': self.alarms, 'log': self.log.latest()}
        self.send(kind, document, key)
        self._send_monitor()

    def show_place(self, place: dict[str, Any]) -> None:
        """Store the place of a replay, and send it to the page if it has changed."""
        if place != self.playing:
            self.playing = place
            self.send('replay', place, '')

    def restart(self, place: dict[str, Any]) -> None:
        """Clear all results and the log, as before a recording, and send the page its whole new state.

        ``place`` is the place of the replay, as for :meth:`show_place`.
        """
        self.finished, self.playing = False, place
        self.log.clear()
        for monitor in self.monitors:
            monitor.forget()
        self.send('state', self.state(), '')

    def finish(self) -> None:
        """Mark the recording as over, and send the page the state of the monitors."""
        self.finished = True
        self._send_monitor()

    def tick(self) -> None:
        """Enlarge a map that is too small, and send it; send the page the state of monitors if it changed.

        To be called regularly, as silence sends nothing. One map at a time: it takes some 30 ms.
        """
        for bearing in self.bearings.values():
            if bearing.widen():
                self.send('map', {'bearing': bearing.key, **bearing.map()}, bearing.key)
                break
        self._send_monitor()

    def _send_monitor(self) -> None:
        """Send the page the state of the monitors, if more than silence and the texts of faults changed."""
        monitor = self.presence()
        state = monitor | {'silent': None, 'faults': len(monitor['faults'])}
        if state != self._sent:
            self._sent = state
            self.send('monitor', monitor, '')

    def presence(self) -> dict[str, Any]:
        """Return the presence of the monitors, and the faults and notices on what is shown, for the page.

        ``there`` says whether any is received, ``finished`` whether a recording has ended; then none is
        present, and no fault is named. ``silent`` is the longest silence [s], ``None`` while one of them has
        sent nothing; ``missing`` are the keys of bearings without a record.
        """
        silences = [monitor.silent_for for monitor in self.monitors]
        known_silences = [round(silent, 1) for silent in silences if silent is not None]
        watched = () if self.finished else self.monitors
        log = f'The log is not kept: {self.log.fault}' if self.log.fault else self.log.damage
        return {
            'there': any(monitor.is_receiving for monitor in watched),
            'finished': self.finished,
            'silent': max(known_silences) if len(known_silences) == len(silences) else None,
            'faults': [text for monitor in watched for text in monitor.faults()],
            'notices': [text for text in (*(monitor.notice() for monitor in self.monitors), log) if text],
            'missing': [key for monitor in watched for key in monitor.missing_bearings()],
        }

    def state(self) -> dict[str, Any]:
        """Return all that the page shows, for one that has just opened or come back."""
        names = ', '.join(monitor.source for monitor in self.monitors)
        return {
            'schema': PAGE_SCHEMA,
            'source': {'name': names, 'replay': self._replay},
            'monitor': self.presence(),
            'columns': COLUMNS,
            'bearings': [
                bearing.state() | {'shelve_time': monitor.shelve_time}
                for monitor in self.monitors
                for bearing in monitor.bearings.values()
            ],
            'replay': self.playing,
            'alarms': self.alarms,
            'log': self.log.latest(),
        }

    def history(self, bearing: str) -> dict[str, Any] | None:
        """Return columns and rows of the last ten minutes of a bearing, by its key, oldest first.

        ``None`` for an unknown bearing.
        """
        watched = self.bearings.get(bearing)
        return None if watched is None else {'columns': COLUMNS, 'rows': list(watched.history)}

    async def ask(self, request: ActionRequest, patience: float) -> int:
        """Hand a request on to every monitor that it concerns, and wait up to ``patience`` [s] for answers.

        Returns:
            The number of alarms that were changed.

        Raises:
            DashboardError: There is nothing to do, or a monitor did not answer in time.
            StickslipError: It cannot be handed on; the other monitors were asked all the same.
        """
        concerned = [monitor for monitor in self.monitors if monitor.is_concerned(request)]
        if not concerned:
            raise DashboardError(f'there is nothing to {request.action}')
        answers = [monitor.ask(request, patience) for monitor in concerned]
        counts = await asyncio.gather(*answers, return_exceptions=True)
        for result in counts:
            if isinstance(result, BaseException):
                raise result
        return sum(count for count in counts if isinstance(count, int))
