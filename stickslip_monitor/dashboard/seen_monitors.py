# SPDX-License-Identifier: Apache-2.0
"""The monitors as the dashboard sees them: their bearings, their alarms, their log, what is missing.

What comes from a monitor may come from anybody on its network: it is checked field by field. All
of it happens on one event loop; whoever knows something from another thread hands it over with
``call_soon_threadsafe``.
"""

from __future__ import annotations

import asyncio
import csv
import io
import sys
import time
from collections import deque
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from datetime import datetime, timezone
from itertools import islice
from typing import Any

from stickslip_monitor.errors import DashboardError
from stickslip_monitor.monitor.alarm_list import Action
from stickslip_monitor.monitor.alarm_records import ALARM_SCHEMA, ActionRequest
from stickslip_monitor.monitor.alarms import TABLE, AlarmState
from stickslip_monitor.monitor.messages import POINT_NUMBERS
from stickslip_monitor.monitor.signals import INPUTS, Status
from stickslip_monitor.state_file import StateWriter

SILENT = 3.0
"""A monitor without a message for so long is taken for gone [s]."""
ALARMS_SILENT = 150.0
"""The list of alarms comes at least once a minute; after so long it is too old [s]."""
MOST_NAMES = 20
"""Other monitors and bearings that are remembered, to report them."""
_BEYOND = 5
# A map that is made for an operating point has this much room beyond its speed and its load.
_ROOM = (1.2, 1.5)
# The latest date of a browser [ms], and the highest whole number that it holds exactly.
_LATEST, _MOST_COUNTED = 8_640_000_000_000_000, 2**53
_NO_ANSWER = 'no answer from the monitor: it may not have been done'
_NO_ALARMS = 'the list of alarms has not come from the monitor: nothing was done'

# --- what comes, field by field --------------------------------------------------------------

Read = Callable[[Any], Any]
"""Takes the value of a field, or ``None`` where there is none."""


def _must(kind: type) -> Read:
    """Reads a field without which there is nothing to show."""

    def read(value: Any) -> Any:
        if not isinstance(value, kind):
            raise ValueError(f'{value!r} is no {kind.__name__}')
        return value

    return read


def _may(kind: type, default: Any = None) -> Read:
    """Reads a field that may be missing, or be anything."""
    return lambda value: value if isinstance(value, kind) else default


def _finite(value: Any) -> float | None:
    number = isinstance(value, int | float) and not isinstance(value, bool)
    return value if number and abs(value) <= sys.float_info.max else None


def _count(value: Any) -> int:
    return value if isinstance(value, int) and 0 <= value <= _MOST_COUNTED else 0


def _milliseconds(time_ns: Any) -> int | None:
    time = time_ns // 1_000_000 if isinstance(time_ns, int) else None
    return None if time is None or abs(time) > _LATEST else time


def _time(time_ns: Any) -> int:
    return int(_must(int)(_milliseconds(time_ns)))


def _texts(value: Any) -> list[str]:
    return [str(each) for each in value] if isinstance(value, list) else []


def _fields(document: Any, readers: Mapping[str, Read]) -> dict[str, Any]:
    """The fields of a document that have a reader; ValueError where one that must be is not."""
    own = _must(dict)(document)
    return {name: read(own.get(name)) for name, read in readers.items()}


def _each(readers: Mapping[str, Read]) -> Read:
    """Reads a list of documents."""
    return lambda value: [_fields(document, readers) for document in _must(list)(value)]


NUMBERS = ('rpm', *POINT_NUMBERS)
"""The numbers of a record."""
PROBABILITIES = tuple(name for name in POINT_NUMBERS if name.startswith('probability'))
NOT_MONITORING = 'not_monitoring'
"""The reason of a bearing whose node is not active."""
_COUNTS = {status.name.lower(): _count for status in Status}
_INPUT: dict[str, Read] = {
    'lost': _may(bool, False),
    'age': _finite,
    'rate': _finite,
    'fault': _may(str, ''),
    'counts': lambda value: _fields(_may(dict, {})(value), _COUNTS),
}
_RECORD: dict[str, Read] = {
    **dict.fromkeys(('bearing', 'text', 'reason'), _must(str)),
    'time': _time,
    'sticking': _may(bool),
    'held_until': _milliseconds,
    **dict.fromkeys(('regime', 'measured', 'unmeasured'), _may(str)),
    **dict.fromkeys(NUMBERS, _finite),
    'inputs': lambda value: {n: _fields(value[n], _INPUT) for n in INPUTS if n in _must(dict)(value)},
}
_ALARM = dict.fromkeys(('bearing', 'alarm', 'priority', 'state', 'by', 'text'), _must(str)) | {
    **dict.fromkeys(('sounding', 'silenced'), bool),
    **dict.fromkeys(('since', 'changed'), _milliseconds),
}
_CHANGE = ('bearing', 'alarm', 'priority', 'what', 'from', 'to', 'by', 'text')
_ALARMS: dict[str, Read] = {
    'time': _time,
    'monitoring': lambda value: value is not False,
    'sounding': _must(bool),
    'unacknowledged': _count,
    'flood': lambda value: _fields(value, {'flooding': bool, 'alarms_10min': _count}),
    'alarms': _each(_ALARM | {'active': bool, 'suppressed_by': _texts, 'shelved_until': _milliseconds}),
    'rows': _each(
        _ALARM
        | {'kinds': _texts, 'came_back': _count}
        | dict.fromkeys(('came_back_since', 'back_since', 'clears_at'), _milliseconds)
    ),
    'changes': _each(dict.fromkeys(_CHANGE, _must(str)) | {'time': _milliseconds}),
    'notes': _each(dict.fromkeys(('what', 'text'), _must(str)) | {'time': _milliseconds}),
}


def checked_record(document: Any) -> dict[str, Any] | None:
    """The record of a bearing for the page, times in milliseconds; ``None`` where it is none."""
    try:
        return _fields(document, _RECORD)
    except ValueError:
        return None


OFFERED = (Action.ACKNOWLEDGE, Action.SILENCE, Action.RESET, Action.SHELVE, Action.UNSHELVE)
"""What a dashboard may ask for. To lock the shaft or to take an alarm out of service is left to
the services: it makes alarms mean nothing, and is not for a tap on a phone."""
_TABLE = {(state.value, trigger.value) for state, trigger in TABLE}
_NOT_ACTIVE = (AlarmState.NORMAL, AlarmState.SUPPRESSED)
_OFF_SHOW = (*_NOT_ACTIVE, AlarmState.SHELVED, AlarmState.OUT_OF_SERVICE)


def checked_alarms(document: Any, bearings: Collection[str]) -> dict[str, Any] | None:
    """A list of alarms for the page, times in milliseconds; ``None`` where it is none.

    Args:
        document: What should be the monitor's list.
        bearings: Names of the bearings that are shown; those of others are left out.
    """
    if not isinstance(document, dict) or document.get('schema') != ALARM_SCHEMA:
        return None
    try:
        record = _fields(document, _ALARMS)
    except ValueError:
        return None
    for kind in ('alarms', 'rows'):
        record[kind] = [each for each in record[kind] if each['bearing'] in bearings]
    for alarm in record['alarms']:
        alarm['actions'] = [action.value for action in OFFERED if _possible(alarm, action)]
    for row in record['rows']:
        # A row is all that a bearing has on show: what can be done about any of it is offered.
        own = [a for a in record['alarms'] if a['bearing'] == row['bearing']]
        possible = {do for a in own if a['state'] not in _OFF_SHOW for do in a['actions']}
        row['actions'] = [action.value for action in OFFERED if action.value in possible]
    return record


def _possible(alarm: dict[str, Any], action: Action) -> bool:
    if action is Action.SILENCE:
        return bool(alarm['sounding'])
    # To shelve what is not active is possible, but nothing to offer.
    quiet = action is Action.SHELVE and alarm['state'] in _NOT_ACTIVE
    return (alarm['state'], action.value) in _TABLE and not quiet


# --- a bearing -------------------------------------------------------------------------------

SPAN = 600_000
"""How far back the history of a bearing goes [ms]."""
STEP = 1000
"""Its rows are so far apart, or further [ms]."""
_OF_POINT = ('fold_speed', 'hopf_speed', 'fold_margin', 'hopf_margin', *PROBABILITIES)
COLUMNS = ('time', 'speed', 'load', *_OF_POINT)
"""Time [ms], speed [m/s], load [N], boundaries [m/s], margins and probabilities [-]."""
Row = list[Any]


def _row(record: dict[str, Any]) -> Row:
    """A row; what rests on a lost input has no value, though the last one is still published."""
    lost = {name for name in ('speed', 'load') if record['inputs'].get(name, {}).get('lost')}
    hidden = lost | (set(_OF_POINT) if lost else set())
    return [None if name in hidden else record[name] for name in COLUMNS]


@dataclass(frozen=True, slots=True)
class BearingView:
    """What the page gets of a bearing once."""

    name: str
    rpm: float  # shaft speed at a surface speed of 1 m/s [rpm]
    speeds: tuple[float, float]  # ends of the stability map [m/s]
    loads: tuple[float, float]  # the same of its other axis [N]
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
    """A bearing: what is shown of it, and what has come."""

    key: str  # its name with the namespace of its node, as the page knows it: ``port/aft``
    view: BearingView  # what the page gets of it once
    record: dict[str, Any] | None = None  # the newest, for the page; ``None`` before it came
    # The last ten minutes, a row a second.
    history: deque[Row] = field(default_factory=lambda: deque(maxlen=SPAN // STEP))
    at: float | None = None  # when the newest came [s]
    fitted: bool = False  # whether the map is made for an operating point

    def take(self, record: dict[str, Any], now: float) -> None:
        """Take a new record; in the history it replaces those of its second, and of its future."""
        row, rows = _row(record), self.history
        self.record, self.at = record | {'row': row}, now
        while rows and rows[-1][0] // STEP >= row[0] // STEP:
            rows.pop()
        while rows and rows[0][0] < row[0] - SPAN:
            rows.popleft()
        rows.append(row)

    def map(self) -> dict[str, Any]:
        """The stability map for the page."""
        return {name: getattr(self.view, name) for name in ('speeds', 'loads', 'curves')}

    def state(self) -> dict[str, Any]:
        """All that the page shows of it, but for its history."""
        names = ('rpm', 'caution_margin', 'amplitude_limit', 'topics')
        own = {name: getattr(self.view, name) for name in names}
        return {'name': self.key, **own, **self.map(), 'status': self.record}

    def widen(self) -> bool:
        """Make the map anew where the point has been beyond it for some time; whether it was.

        A single wrong sample does not make a map on which nothing can be seen. The first points
        make a map of their own size.
        """
        wider, rows = self.view.wider, list(self.history)[-_BEYOND:]
        lately = [row for row in rows if row[1] is not None and row[2] is not None]
        if wider is None or len(lately) < (_BEYOND if self.fitted else 1):
            return False
        speed, load = (min(abs(row[k]) for row in lately) for k in (1, 2))
        fastest, highest = (self.view.speeds[1], self.view.loads[1]) if self.fitted else (0.0, 0.0)
        if speed <= fastest and load <= highest:
            return False
        wanted = (speed, fastest, _ROOM[0]), (load, highest, _ROOM[1])
        self.view = wider(*(room * now if now > end else end for now, end, room in wanted))
        self.fitted = True
        return True


# --- a monitor -------------------------------------------------------------------------------

Send = Callable[[str, dict[str, Any], str], None]


class WatchedMonitor:
    """The newest of one monitor.

    Args:
        source: Where it comes from, for a person: the node's full name, or the recording's.
        space: Namespace of its node, without slashes around it; empty for none.
        shelve_time: For how long an alarm is shelved [s].
        clock: Time that never steps [s].

    Attributes:
        alarms: The newest list of alarms for the page; ``None`` before it came.
        act: Hands a request on to it; what comes of it arrives by :meth:`take_alarms`.
        send: Called with what is new for the page: kind, document and key.
    """

    act: Callable[[ActionRequest], object]
    send: Send
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
        self.shelve_time = shelve_time
        self.source, self.space, self._replay, self._clock = source, space, replay, clock
        self._views = tuple(views)
        self._others: dict[str, float] = {}
        self._expected: list[tuple[ActionRequest, asyncio.Future[int]]] = []
        self.forget()

    def forget(self) -> None:
        """Know nothing yet."""
        self.bearings = {view.name: Watched(self.key(view.name), view) for view in self._views}
        self.alarms: dict[str, Any] | None = None
        self._health: tuple[int, str] = (0, '')
        self._received_at: float | None = None
        self._listed_at: float | None = None
        self._foreign: dict[str, float] = {}

    @property
    def namespace(self) -> str:
        """The namespace of its node, as ROS has it."""
        return f'/{self.space}'

    def key(self, bearing: str) -> str:
        """A bearing's name in the namespace of its node, as in the diagnostics."""
        return f'{self.space}/{bearing}' if self.space else bearing

    @property
    def silent_for(self) -> float | None:
        """Time since its last message [s]; ``None`` before it was."""
        return None if self._received_at is None else self._clock() - self._received_at

    @property
    def receiving(self) -> bool:
        """Whether anything comes from it."""
        silent = self.silent_for
        return silent is not None and silent < SILENT

    @property
    def there(self) -> bool:
        """Whether all comes from it that must."""
        return self.receiving and not self.faults()

    def missing(self) -> list[str]:
        """Keys of the bearings of which nothing comes."""
        now = self._clock()
        own = self.bearings.values()
        return [each.key for each in own if each.at is None or now - each.at >= SILENT]

    def faults(self) -> list[str]:
        """Why what is shown must not be taken for all there is; a sentence each."""
        name = self.source
        if self.silent_for is None:
            others = ', '.join(self._others)
            there = f' Other monitors run: {others}; see --node.' if others else ''
            return [f'No data from the monitor {name} yet.{there}']
        if self._idle():
            return [f'Not monitoring: {name} is not active; its bearings are not watched.']
        if not self.receiving:
            return [f'The monitor {name} has been silent for {self.silent_for:.0f} s.']
        return list(self._gaps(name))

    def _gaps(self, name: str) -> Iterator[str]:
        if missing := self.missing():
            yield f'No data on {_listed(missing)}: {name} does not watch it.'
        now = self._clock()
        foreign = [each for each, at in self._foreign.items() if now - at < ALARMS_SILENT]
        if foreign:
            yield f'{_listed(foreign)}: watched by {name}, but not in --config, so not shown.'
        if self.alarms is None or self._listed_at is None:
            yield f'No list of alarms from {name} yet: alarm state unknown.'
        elif not self._replay and now - self._listed_at > ALARMS_SILENT:
            late = now - self._listed_at
            yield f'The list of alarms of {name} is {late:.0f} s old: newer alarms are missing.'

    def notice(self) -> str:
        """What the node reports of itself, where that is not that all is well."""
        level, text = self._health
        return f'{self.source}: {text}' if level and self.receiving and not self._idle() else ''

    def _idle(self) -> bool:
        """Whether the node reports that nobody watches its bearings."""
        records = [own.record for own in self.bearings.values() if own.record is not None]
        idle = self.alarms is not None and not self.alarms['monitoring']
        return idle or any(record['reason'] == NOT_MONITORING for record in records)

    def take_record(self, document: Any) -> None:
        """The record of a bearing has come; what is none, or of an unknown one, is ignored."""
        record = checked_record(document)
        if record is None:
            return
        own = self.bearings.get(record['bearing'])
        if own is None:
            self._remember(self._foreign, self.key(record['bearing']))
            return
        self._received_at = self._clock()
        self._name_fully(record)
        own.take(record, self._received_at)
        assert own.record is not None
        self.send('status', own.record, own.key)

    def take_health(self, level: int, text: str) -> None:
        """The diagnostic status of the node itself has come; levels are those of ROS."""
        self._health = (level, text)

    def take_alarms(self, document: Any) -> None:
        """The list of alarms has come; what is none is ignored."""
        record = checked_alarms(document, self.bearings)
        if record is None:
            return
        for each in (*record['alarms'], *record['rows'], *record['changes']):
            self._name_fully(each)
        self.alarms, self._listed_at = record, self._clock()
        for alarm in document['alarms']:
            if alarm['bearing'] not in self.bearings:
                self._remember(self._foreign, self.key(alarm['bearing']))
        entries = [each | {'node': self.source} for each in record['notes'] + record['changes']]
        self.log(sorted(entries, key=lambda entry: entry['time'] or 0))
        self.send('alarms', {}, '')
        for request, done in self._expected:
            answers = sum(_answers(change, request) for change in record['changes'])
            if answers and not done.done():
                done.set_result(answers)

    def take_other(self, node: str) -> None:
        """A message of another monitor than those that are shown has come."""
        self._remember(self._others, f'/{node}')

    def _name_fully(self, record: dict[str, Any]) -> None:
        """Put the namespace before the name of the bearing, in the sentence on it, too."""
        if self.space and record['text'].startswith(f'{record["bearing"]}: '):
            record['text'] = f'{self.space}/{record["text"]}'
        record['bearing'] = self.key(record['bearing'])

    def _remember(self, names: dict[str, float], name: str) -> None:
        if name in names or len(names) < MOST_NAMES:
            names[name] = self._clock()

    def concerned(self, request: ActionRequest) -> bool:
        """Whether there is anything that a request could change, as far as is known here."""
        alarms = () if self.alarms is None else self.alarms['alarms']
        return any(request.action.value in a['actions'] and _concerns(request, a) for a in alarms)

    async def ask(self, request: ActionRequest, patience: float) -> int:
        """Hand a request on and wait so long [s] for what comes of it; see DashboardState.ask."""
        if self.alarms is None:
            raise DashboardError(_NO_ALARMS)
        entry = (request, asyncio.get_running_loop().create_future())
        self._expected.append(entry)
        names = {own.key: name for name, own in self.bearings.items()}
        own = None if request.bearing is None else names[request.bearing]
        try:
            self.act(replace(request, bearing=own))
            return await asyncio.wait_for(entry[1], patience)
        except asyncio.TimeoutError as error:
            raise DashboardError(' '.join([_NO_ANSWER, *self.faults()])) from error
        finally:
            self._expected.remove(entry)


def _concerns(request: ActionRequest, alarm: dict[str, Any]) -> bool:
    return request.bearing in (None, alarm['bearing']) and request.kind in (None, alarm['alarm'])


def _answers(change: dict[str, Any], request: ActionRequest) -> bool:
    same = (change['by'], change['what']) == (request.by, request.action.value)
    return same and _concerns(request, change)


def _listed(names: list[str]) -> str:
    few = ', '.join(names[:5])
    return few if len(names) <= 5 else f'{few} and {len(names) - 5} more'


# --- the log ---------------------------------------------------------------------------------

KEPT = 5000
"""Entries of the log that are kept; the page shows the latest, a file of CSV has all."""
SHOWN = 60
LOG_SCHEMA = 'stickslip_monitor/log/1'
LOG_TEXTS = ('node', 'bearing', 'alarm', 'priority', 'what', 'from', 'to', 'by', 'text')
_LONGEST = 300
# What a spreadsheet would compute.
_FORMULA = ('=', '+', '-', '@', '\t', '\r')


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
    if time_ms is None:
        return ''
    try:
        when = datetime.fromtimestamp(time_ms / 1000.0, timezone.utc)
    except (OverflowError, ValueError, OSError):
        return ''
    return when.isoformat(timespec='milliseconds').replace('+00:00', 'Z')


def _cell(text: str) -> str:
    return f"'{text}" if text.startswith(_FORMULA) else text


# --- all of them -----------------------------------------------------------------------------

PAGE_SCHEMA = 'stickslip_monitor/dashboard/3'


class DashboardState:
    """The newest of all monitors that are shown.

    Args:
        monitors: The monitors; no two of them in one namespace.
        log: What happened; one of its own that keeps nothing if ``None``.

    Attributes:
        links: Of each of the ship's buses whether it works, where buses are watched.
        playing: Of a replay where it is; ``None`` for none.
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
        self.send: Send = lambda kind, document, key: None
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

    def _take(self, kind: str, document: dict[str, Any], key: str) -> None:
        if kind == 'alarms':
            document = {'alarms': self.alarms, 'log': self.log.latest()}
        self.send(kind, document, key)
        self._tell()

    def play(self, place: dict[str, Any]) -> None:
        """A replay reports where it is."""
        if place != self.playing:
            self.playing = place
            self.send('replay', place, '')

    def begin_again(self, place: dict[str, Any]) -> None:
        """The recording starts from its beginning: what came of it is forgotten."""
        self.finished, self.playing = False, place
        self.log.clear()
        for monitor in self.monitors:
            monitor.forget()
        self.send('state', self.state(), '')

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
                self.send('map', {'bearing': own.key, **own.map()}, own.key)
                break
        self._tell()

    def _tell(self) -> None:
        monitor = self.monitor()
        state = monitor | {'silent': None, 'faults': len(monitor['faults'])}
        if state != self._sent:
            self._sent = state
            self.send('monitor', monitor, '')

    def monitor(self) -> dict[str, Any]:
        """Whether the monitors are there, and why what is shown must not be taken for all there is."""
        silences = [monitor.silent_for for monitor in self.monitors]
        known = [round(silent, 1) for silent in silences if silent is not None]
        watched = () if self.finished else self.monitors
        log = f'The log is not kept: {self.log.fault}' if self.log.fault else ''
        return {
            'there': any(monitor.receiving for monitor in watched),
            'finished': self.finished,
            'silent': max(known) if len(known) == len(silences) else None,
            'faults': [text for monitor in watched for text in monitor.faults()],
            'notices': [text for text in (*(monitor.notice() for monitor in self.monitors), log) if text],
            'missing': [key for monitor in watched for key in monitor.missing()],
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
        """Hand a request on to every monitor that it concerns, and wait so long [s] for what comes of it.

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
            if isinstance(each, BaseException):
                raise each
        return sum(count for count in counts if isinstance(count, int))
