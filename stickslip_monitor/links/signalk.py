# SPDX-License-Identifier: Apache-2.0
"""Signal K, pure: deltas into samples, alarms and values into deltas, and people's acts back.

Frames are the JSON documents of a server's stream; times are seconds of a steady clock.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from datetime import datetime, timezone
from typing import Any

from stickslip_logs.field_paths import signalk_source
from stickslip_logs.units import conversion_from_text
from stickslip_monitor.errors import ConfigurationError
from stickslip_monitor.links.bus_inputs import BusInputs
from stickslip_monitor.links.links_config import UNITS, BusInput
from stickslip_monitor.monitor import record_fields
from stickslip_monitor.monitor.alarm_list import Action
from stickslip_monitor.monitor.alarm_records import ActionRequest
from stickslip_monitor.monitor.alarm_states import AlarmKind, AlarmState, Priority
from stickslip_monitor.monitor.bearing_records import WITHOUT_CYCLE
from stickslip_monitor.monitor.sample_types import Input

BY = 'signal k'
"""Who acts: the server does not say which of its users."""
SOURCE = 'stickslip_monitor'
SAFE_ACTIONS = (2, 24)
"""Before this version a server takes an acknowledgement from anybody who reaches its port."""
Update = dict[str, Any]
"""One update of a delta: a source and its values, or their meta data."""
_SEVERITIES = {Priority.ALARM: 'alarm', Priority.WARNING: 'warn', Priority.CAUTION: 'alert'}
_WAITING = (AlarmState.UNACKNOWLEDGED.value, AlarmState.RETURNED.value)
_KNOWN = (AlarmState.ACKNOWLEDGED.value, AlarmState.LATCHED.value)


def to_camel_case(name: str) -> str:
    """Return a name as a part of a path: ``aft_stern`` becomes ``aftStern``, ``aft_B2`` ``aftB2``."""
    head, *rest = name.split('_')
    return head + ''.join(part.capitalize() for part in rest)


def version_of(hello: Mapping[str, Any]) -> tuple[int, int]:
    """Return major and minor version of a server; (0, 0) where it gives none."""
    match = re.match(r'v?(\d+)\.(\d+)', str(hello.get('version', '')))
    return (int(match[1]), int(match[2])) if match else (0, 0)


def is_hello(frame: object) -> bool:
    """Return whether a frame is a server's greeting."""
    return isinstance(frame, dict) and isinstance(frame.get('self'), str) and 'version' in frame


def _parse_stamp(stamp: object) -> float:
    """Parse an ISO 8601 time stamp to seconds since 1970; NaN where that is not possible.

    Without a time zone it is taken as UTC.
    """
    try:
        time = datetime.fromisoformat(str(stamp).replace('Z', '+00:00'))
    except ValueError:
        return math.nan
    return (time if time.tzinfo else time.replace(tzinfo=timezone.utc)).timestamp()


def _own_values(frame: object, vessel: str, kind: str = 'values') -> Iterator[tuple[Update, str, str, Any]]:
    """Yield update, source, path and value of each value of the own vessel in a delta.

    What is malformed is skipped; a value left out is None; a delta without a vessel is of the own one.

    Args:
        frame: Any JSON document.
        vessel: The own vessel, as the server's greeting names it.
        kind: The list that is read: ``values`` or ``meta``.
    """
    # Some servers greet without the word vessels.
    ours = vessel, f'vessels.{vessel}', 'vessels.self'
    if isinstance(frame, dict) and frame.get('context', vessel) in ours:
        for update in _only_dicts(frame.get('updates')):
            for item in _only_dicts(update.get(kind)):
                if isinstance(item.get('path'), str):
                    yield update, signalk_source(update), item['path'], item.get('value')


def _only_dicts(items: object) -> list[dict[str, Any]]:
    """Return the dictionaries among the items; an empty list where ``items`` is no list."""
    return [item for item in items if isinstance(item, dict)] if isinstance(items, list) else []


class SignalKInputs(BusInputs):
    """Samples out of deltas.

    Args:
        inputs: Those that come from Signal K.
        log: As of :class:`.BusInputs`, and given a line for a unit that is converted, or cannot be.
    """

    _own = ''
    _server_ahead = 0.0

    def __init__(self, inputs: Iterable[BusInput], log: Callable[[str], object]) -> None:
        super().__init__(inputs, log)
        self._units: dict[str, str] = {}  # of paths, by their meta data
        self._ratios: dict[str, float] = {}  # to Signal K's own unit; NaN where nothing converts to it

    def greet(self, hello: Mapping[str, Any], now: float) -> None:
        """Start a connection by the server's greeting: store vessel and clock, and wait for all inputs anew.

        Of each source and path the first value is taken as possibly old. ``now`` is of a steady clock [s].
        """
        self._own = hello['self']
        self._server_ahead = _parse_stamp(hello.get('timestamp')) - now
        self._begun: set[tuple[str, str]] = set()
        self.start_waiting(now)

    def subscription(self, extra: Iterable[str] = ()) -> dict[str, Any]:
        """Return the frame that subscribes to the paths of the inputs and ``extra``.

        It gives no period, which would count per path and not per source.
        """
        paths = dict.fromkeys([*(items[0].path for items, _ in self.groups), *extra])
        return {'context': 'vessels.self', 'subscribe': [{'path': path} for path in paths]}

    def take(self, frame: object, now: float) -> Iterator[tuple[str, Input, float, int | None]]:
        """Yield bearing, input, number and stamp [ns] of each fresh sample of an admitted source.

        The number is converted from the unit of its meta data to Hz, N or K, and NaN if invalid; the stamp is
        ``None`` if unreadable. ``now`` is of a steady clock [s]; units, sources and times of values are
        stored. Other vessels, and what is malformed, are skipped. Call :meth:`greet` first.
        """
        self._take_units(frame)
        for update, source, path, value in _own_values(frame, self._own):
            groups = [pair for pair in self.groups if pair[0][0].path == path]
            stamp = _parse_stamp(update.get('timestamp'))
            if not groups or not self._is_fresh((path, source), stamp, groups[0][0][0].timeout, now):
                continue
            stamp_ns = round(stamp * 1e9) if stamp == stamp else None
            number = _read_number(value) * self._ratios.get(path, 1.0)
            for items, admission in groups:
                self.note_received(items[0], now)
                for item in items if admission.admits(source, now, valid=number == number) else ():
                    yield item.bearing, item.place, number, stamp_ns

    def _take_units(self, frame: object) -> None:
        """Note how to convert the paths whose meta data give another unit than before.

        A path whose unit cannot be converted has NaN for all its numbers from then on. A unit that is
        converted or cannot be is logged when it comes first.
        """
        inputs = {items[0].path: items[0] for items, _ in self.groups}
        for _, _, path, meta in _own_values(frame, self._own, 'meta'):
            unit = meta.get('units') if isinstance(meta, dict) else None
            if path not in inputs or not isinstance(unit, str) or not unit:
                continue
            need = UNITS[inputs[path].place]
            if unit != self._units.get(path, need):
                ratio = conversion_from_text(unit, need)
                self._ratios[path] = math.nan if ratio is None else ratio
                if ratio != 1.0:
                    result = (
                        f'and it is read in {need}: not used' if ratio is None else f'converted to {need}'
                    )
                    self.log(f"{inputs[path].label}: its unit is '{unit}', {result}")
            self._units[path] = unit

    def _is_fresh(self, key: tuple[str, str], stamp: float, timeout: float, now: float) -> bool:
        """Return whether a value is current: the first of a source is not if older than the timeout.

        Age is by the server's clock, as of its greeting; without a time in that no first value is current.

        Args:
            key: Path and source of the value, which is noted as having sent.
            stamp: Its time stamp [s since 1970]; NaN, where it cannot be read, counts as too old.
            timeout: Of the input [s].
            now: Of the steady clock [s].
        """
        if key in self._begun:
            return True
        self._begun.add(key)
        # By the server's clock; with a stamp that cannot be read it may be of any age.
        return now + self._server_ahead - stamp <= timeout


def _read_number(value: object) -> float:
    """Convert a JSON value to a float; NaN for true, false, what is no number, or one too large."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return math.nan
    try:
        return float(value)
    except OverflowError:
        return math.nan


VALUES = {item.path: (item.name, item.path_unit, item.help) for item in record_fields.BEARING if item.path}
"""Of each value its name in the record of a bearing, its unit, and what it is."""
REGIME = 'regime'
MONITOR = 'monitor'


class SignalKValues:
    """The state of the bearings as values of paths.

    Args:
        prefix: Path before the bearings' names.
        own_load: Bearings whose load comes from elsewhere, and is therefore sent.
    """

    def __init__(self, prefix: str, own_load: Iterable[str]) -> None:
        self._prefix, self._own_load = prefix, frozenset(own_load)

    def _value_names(self, bearing: str) -> list[str]:
        """Return the names of the values that are sent of a bearing: the load only where it is our own."""
        return [name for name in VALUES if name != 'load' or bearing in self._own_load]

    def _path_of(self, bearing: str, name: str) -> str:
        """Return the path of a bearing's value."""
        return f'{self._prefix}.{to_camel_case(bearing)}.{name}'

    def make_update(self, bearing: str, record: Mapping[str, Any] | None) -> Update:
        """Return the update with a bearing's values; null without a record and while inputs are lost.

        ``record`` is the latest of the bearing, ``None`` before the first.
        Where no cycle exists, a missing number that :data:`.WITHOUT_CYCLE` has is sent with that value.
        """
        valid = record if record is not None and record['reason'] != 'input_stale' else {}
        none = WITHOUT_CYCLE if valid.get(REGIME) else {}
        numbers = {name: valid.get(VALUES[name][0]) for name in self._value_names(bearing)}
        numbers = {name: none.get(VALUES[name][0]) if n is None else n for name, n in numbers.items()}
        numbers[REGIME] = valid.get(REGIME)
        values = [{'path': self._path_of(bearing, name), 'value': n} for name, n in numbers.items()]
        return {'$source': SOURCE, 'values': values}

    def make_meta(self, bearing: str) -> Update:
        """Return the update with unit, description and time-out (5 s) of the values of a bearing.

        It has no zones, by which the server would raise alarms of its own.
        """
        meta = []
        for name in self._value_names(bearing):
            _, unit, text = VALUES[name]
            value = {'units': unit, 'description': text, 'timeout': 5}
            meta.append({'path': self._path_of(bearing, name), 'value': value})
        return {'$source': SOURCE, 'meta': meta}


@dataclass(slots=True)
class _Alarm:
    """One notification as the server should have it."""

    key: tuple[str, ...]  # bearing and alarm
    path: str
    token: str  # names this occurrence of the alarm
    value: dict[str, Any]  # what was sent last
    source: str = SOURCE  # the source under which it is sent
    revision: int = 0  # counts what is sent
    # Whether the server had it acknowledged and silenced when it sent last; ``None`` before the
    # first echo of this occurrence.
    base: tuple[bool, bool] | None = None

    def update(self, value: Mapping[str, Any] | None = None) -> Update:
        """Return the update that sends a value, by default the latest one."""
        return _make_update(self.source, self.path, value or self.value)


def _make_update(source: str, path: str, value: Mapping[str, Any]) -> Update:
    """Return the update that sends one value of a path from a source."""
    return {'$source': source, 'values': [{'path': path, 'value': value}]}


NORMAL: dict[str, Any] = {'state': 'normal', 'method': [], 'message': ''}


class Notifications:
    """The alarms as notifications, and the requests that people make at the server.

    Args:
        prefix: Path before their names.
        run: A token of this run of the program.

    Raises:
        ConfigurationError: Two bearings have one path.

    Attributes:
        pattern: The path of all of them, to subscribe to their echo.
    """

    def __init__(self, bearings: Iterable[str], prefix: str, run: str) -> None:
        self.pattern = f'notifications.{prefix}.*'
        self._run, self._count = run, 0

        def make_alarm(*key: str) -> _Alarm:
            """Make a normal notification for a bearing's alarm, or for the monitor itself."""
            path = '.'.join(['notifications', prefix, *map(to_camel_case, key)])
            token = f'{run}-0'
            return _Alarm(key, path, token, {**NORMAL, 'data': {'occurrence': token}})

        notifications = [make_alarm(name, kind.value) for name in bearings for kind in AlarmKind]
        self._by_key = {alarm.key: alarm for alarm in notifications}
        self._alarms = {alarm.path: alarm for alarm in notifications}
        for alarm in notifications:
            if (twin := self._alarms[alarm.path]) is not alarm:
                raise ConfigurationError(
                    f"bearings '{alarm.key[0]}' and '{twin.key[0]}' have one Signal K path,"
                    f' {alarm.path}: rename one'
                )
        self._monitor = make_alarm(MONITOR)

    def take_alarms(self, record: Mapping[str, Any]) -> list[Update]:
        """Return the updates for the alarms that differ from what was sent, and note them as sent.

        ``record`` is the list of alarms as it is published. Alarms of other bearings are left out; an alarm
        that the list lacks stays as it was. One raised anew is first sent as normal where the server knows
        it.
        """
        return [
            update
            for alarm in record['alarms']
            if (notification := self._by_key.get((alarm['bearing'], alarm['alarm'])))
            for update in self._update_notification(notification, alarm)
        ]

    def set_monitor_fault(self, text: str) -> list[Update]:
        """Store the fault of the monitor itself, ``''`` for none; return its update, empty if unchanged."""
        state = {'state': 'warn', 'method': ['visual']} if text else {}
        value = {**NORMAL, **state, 'message': text, 'data': {'occurrence': self._monitor.token}}
        if value == self._monitor.value:
            return []
        self._monitor.value = value
        return [self._monitor.update()]

    def all_updates(self) -> list[Update]:
        """Return updates with the latest value of every notification, also of normal ones."""
        return [alarm.update() for alarm in (*self._alarms.values(), self._monitor)]

    def _update_notification(self, alarm: _Alarm, record: Mapping[str, Any]) -> list[Update]:
        """Return the updates that bring a notification up to the record of its alarm; note them as sent.

        An alarm that is raised anew becomes a new occurrence, with its own token. For one that is unchanged
        the list is empty.
        """
        lifecycle = record['state']
        before = alarm.value['data'].get('lifecycle')
        again = lifecycle == AlarmState.UNACKNOWLEDGED.value != before
        if again:
            self._count += 1
            alarm.token, alarm.base = f'{self._run}-{self._count}', None
        value = _notification_value(record, alarm.token)
        if value == {**alarm.value, 'data': {**alarm.value['data'], 'revision': 0}}:
            return []
        alarm.revision += 1
        value['data']['revision'] = alarm.revision
        alarm.value = value
        # What was acknowledged would stay so at the server, and the new alarm mute.
        cleared = [alarm.update(NORMAL)] if again and before in _KNOWN else []
        return [*cleared, alarm.update()]

    def is_echoed(self, frame: object, own_vessel: str) -> bool:
        """Return whether a frame brings back a notification of this run: proof that we may write.

        ``frame`` is any JSON document, ``own_vessel`` the vessel of the server's greeting.
        """
        return any(
            _occurrence_of(value).startswith(f'{self._run}-') for *_, value in _own_values(frame, own_vessel)
        )

    def take_echo(self, frame: object, own_vessel: str) -> tuple[list[Update], list[ActionRequest]]:
        """Compare notifications from the server with what was sent, and store what people did there.

        ``own_vessel`` is the vessel of the server's greeting; what is of another is ignored.

        Returns:
            The updates to send: a restart of an acknowledgement that the server kept, and the end of
            notifications that another run left. The requests of people: acknowledge or silence. Both
            are empty for any other frame.
        """
        updates, requests = list[Update](), list[ActionRequest]()
        for _, source, path, value in _own_values(frame, own_vessel):
            alarm = self._alarms.get(path)
            if alarm is None or not isinstance(value, dict):
                continue
            if _occurrence_of(value) == alarm.token and source == alarm.source:
                updates += self._take_first_echo(alarm, value)
                requests += self._requests_of_echo(alarm, value)
            elif source != alarm.source and source.startswith(SOURCE) and value.get('state') != 'normal':
                # Another run of this program has left it.
                updates.append(_make_update(source, path, NORMAL))
        return updates, requests

    def _take_first_echo(self, alarm: _Alarm, value: Mapping[str, Any]) -> list[Update]:
        """Store the flags of the first echo of an occurrence, with which later ones are compared.

        Returns:
            Updates that send it from a fresh source where the server kept an old acknowledgement; else [].
        """
        if alarm.base is not None:
            return []
        born = _acknowledged_silenced(value)
        fresh = f'{SOURCE}.{alarm.token}'
        if born == (False, False) or not _is_waiting(alarm) or alarm.source == fresh:
            alarm.base = born
            return []
        # Up to 2.26 a server keeps an acknowledgement over the end of an alarm: a source that
        # it has not seen starts without.
        old, alarm.source = alarm.update(NORMAL), fresh
        return [old, alarm.update()]

    def _requests_of_echo(self, alarm: _Alarm, value: Mapping[str, Any]) -> list[ActionRequest]:
        """Return the request, none or one, by which an echo differs from the one before; store its flags.

        Before :meth:`_take_first_echo` has stored flags to compare with, nothing is done.
        """
        if alarm.base is None:
            return []
        before, alarm.base = alarm.base, _acknowledged_silenced(value)
        acknowledged, silenced = (now and not was for was, now in zip(before, alarm.base, strict=True))
        # An older client takes the sound away; never an acknowledgement.
        current = value.get('data', {}).get('revision') == alarm.revision
        method = value.get('method')
        loud = isinstance(method, list) and 'sound' in method
        quiet = current and not loud and 'sound' in alarm.value['method']
        bearing, kind = alarm.key
        if acknowledged and _is_waiting(alarm):
            return [ActionRequest(Action.ACKNOWLEDGE, BY, bearing, AlarmKind(kind))]
        if (silenced or quiet) and 'sound' in alarm.value['method']:
            return [ActionRequest(Action.SILENCE, BY, bearing, AlarmKind(kind))]
        return []


def _notification_value(record: Mapping[str, Any], token: str) -> dict[str, Any]:
    """Return a notification's value, of revision 0, for an alarm; normal while a worse alarm covers it."""
    lifecycle, kind = record['state'], AlarmKind(record['alarm'])
    # One matter, one notification: what a worse alarm stands for is not given beside it.
    shown = not record.get('covered')
    waiting, is_known = shown and lifecycle in _WAITING, shown and lifecycle in _KNOWN
    text = record['text'] if waiting or is_known else ''
    value = {
        'state': _SEVERITIES[kind.priority] if waiting or is_known else 'normal',
        'method': (['visual', 'sound'] if record['sounding'] else ['visual']) if waiting else [],
        'message': f'Over: {text}' if lifecycle == AlarmState.RETURNED.value else text,
        'data': {
            'bearing': record['bearing'],
            'alarm': record['alarm'],
            'lifecycle': lifecycle,
            'occurrence': token,
            'revision': 0,
        },
    }
    if is_known:
        value['acknowledgeStatus'] = 'Yes'
    elif waiting and record['silenced']:
        value['temporarySilenceStatus'] = 'Yes'
    return value


def _is_waiting(alarm: _Alarm) -> bool:
    """Return whether an alarm waits for its acknowledgement."""
    return alarm.value['data'].get('lifecycle') in _WAITING


def _occurrence_of(value: object) -> str:
    """Return the token of the occurrence in a notification; '' without one."""
    data = value.get('data') if isinstance(value, dict) else None
    return str(data.get('occurrence', '')) if isinstance(data, dict) else ''


def _acknowledged_silenced(value: Mapping[str, Any]) -> tuple[bool, bool]:
    """Return whether the server has a notification acknowledged, and silenced; false without a status."""
    status = value.get('status')
    flags = status if isinstance(status, dict) else {}
    return flags.get('acknowledged') is True, flags.get('silenced') is True
