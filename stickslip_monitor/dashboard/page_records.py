# SPDX-License-Identifier: Apache-2.0
"""Records as the page takes them, and the log of what happened.

What comes from a monitor, anybody on its network may have sent: it is checked field by field.
"""

from __future__ import annotations

import csv
import heapq
import io
import sys
import time
from collections.abc import Callable, Collection, Iterable
from datetime import datetime, timezone
from typing import Any

from stickslip_monitor.errors import AlarmStateError
from stickslip_monitor.monitor.alarm_list import Action
from stickslip_monitor.monitor.alarm_records import ALARM_SCHEMA
from stickslip_monitor.monitor.alarm_states import TABLE, AlarmState
from stickslip_monitor.monitor.bearing_records import POINT_NUMBERS
from stickslip_monitor.monitor.sample_types import INPUTS, Status
from stickslip_monitor.monitor.value_check import refused
from stickslip_monitor.state_file import StateWriter

# The latest date of a browser [ms]; whole numbers up to beyond that are exact there, counts too.
_LATEST = 8_640_000_000_000_000
NUMBERS = ('rpm', *POINT_NUMBERS)
"""The numbers of a record."""
OFFERED = (Action.ACKNOWLEDGE, Action.SILENCE, Action.RESET, Action.SHELVE, Action.UNSHELVE)
"""What a dashboard may ask for. To take an alarm out of service is left to the service: it makes
alarms mean nothing, and is not for a tap on a phone."""
_TABLE = {(state.value, trigger.value) for state, trigger in TABLE}
_NOT_ACTIVE = (AlarmState.NORMAL, AlarmState.SUPPRESSED)
_OFF_SHOW = (*_NOT_ACTIVE, AlarmState.SHELVED, AlarmState.OUT_OF_SERVICE)


def _require_type(kind: type) -> Callable[[Any], Any]:
    """Make a reader of a required value, which raises ``ValueError`` if it is not of this type."""

    def read(value: Any) -> Any:
        """Return the value; raise ``ValueError`` if it is of another type."""
        if not isinstance(value, kind):
            raise ValueError(f'{value!r} is no {kind.__name__}')
        return value

    return read


def _allow_type(kind: type, default: Any = None) -> Callable[[Any], Any]:
    """Make a reader of an optional value, which returns ``default`` if it is not of this type."""
    return lambda value: value if isinstance(value, kind) else default


def _read_finite(value: Any) -> float | None:
    """Return a finite number, ``None`` for anything else."""
    number = isinstance(value, int | float) and not isinstance(value, bool)
    return value if number and abs(value) <= sys.float_info.max else None


def _read_count(value: Any) -> int:
    """Return a count that JavaScript can hold, 0 for anything else, as for a negative one."""
    return value if isinstance(value, int) and 0 <= value <= _LATEST else 0


def _read_milliseconds(time_ns: Any) -> int | None:
    """Convert a time [ns] to ms, rounded down; ``None`` for no integer, or one beyond JavaScript's dates."""
    time = time_ns // 1_000_000 if isinstance(time_ns, int) else None
    return None if time is None or abs(time) > _LATEST else time


def _read_time(time_ns: Any) -> int:
    """Convert a required time [ns] to ms; raise ``ValueError`` for what :func:`_read_milliseconds` drops."""
    return int(_require_type(int)(_read_milliseconds(time_ns)))


def _read_texts(value: Any) -> list[str]:
    """Return the items of a list as texts; empty where it is not a list."""
    return [str(item) for item in _allow_type(list, ())(value)]


def _read_inputs(value: Any) -> dict[str, Any]:
    """Return the checked records of the known inputs, by name; raise ``ValueError`` for an invalid one."""
    inputs = _require_type(dict)(value)
    return {name: _apply_rule(inputs[name], _INPUT) for name in INPUTS if name in inputs}


def _apply_rule(value: Any, rule: Any) -> Any:
    """Return a value as its rule reads it.

    Args:
        value: Anything that JSON can hold; ``None`` for a field that is missing.
        rule: A function that reads it, a dictionary of the rules of its fields, of which others are
            left out, or a list of the one rule of all its items.

    Raises:
        ValueError: A required value is missing, or of another type.
    """
    if isinstance(rule, dict):
        fields = _require_type(dict)(value)
        return {name: _apply_rule(fields.get(name), field_rule) for name, field_rule in rule.items()}
    if isinstance(rule, list):
        return [_apply_rule(item, rule[0]) for item in _require_type(list)(value)]
    return rule(value)


_COUNTS = {status.name.lower(): _read_count for status in Status}
_INPUT = {
    'lost': _allow_type(bool, False),
    'age': _read_finite,
    'rate': _read_finite,
    'fault': _allow_type(str, ''),
    'counts': lambda value: _apply_rule(_allow_type(dict, {})(value), _COUNTS),
}
_RECORD = {
    **dict.fromkeys(('bearing', 'text', 'reason'), _require_type(str)),
    'time': _read_time,
    'sticking': _allow_type(bool),
    'held_until': _read_milliseconds,
    **dict.fromkeys(('regime', 'measured', 'unmeasured', 'order'), _allow_type(str)),
    'speed_to_reach': _read_finite,
    **dict.fromkeys(NUMBERS, _read_finite),
    'inputs': _read_inputs,
}
_NOTE = {**dict.fromkeys(('what', 'text'), _require_type(str)), 'time': _read_milliseconds}
_ALARM = {
    **dict.fromkeys(('bearing', 'alarm', 'priority', 'state', 'by', 'text'), _require_type(str)),
    **dict.fromkeys(('sounding', 'silenced'), bool),
    **dict.fromkeys(('since', 'changed'), _read_milliseconds),
}
_ALARMS = {
    'time': _read_time,
    'monitoring': lambda value: value is not False,
    'sounding': _require_type(bool),
    'unacknowledged': _read_count,
    'flood': {'flooding': bool, 'alarms_10min': _read_count},
    'alarms': [_ALARM | {'active': bool, 'suppressed_by': _read_texts, 'shelved_until': _read_milliseconds}],
    'rows': [
        _ALARM
        | {'kinds': _read_texts, 'came_back': _read_count}
        | dict.fromkeys(('came_back_since', 'back_since', 'clears_at'), _read_milliseconds)
    ],
    'changes': [
        dict.fromkeys(('bearing', 'alarm', 'priority', 'from', 'to', 'by'), _require_type(str)) | _NOTE
    ],
    'notes': [_NOTE],
}


def checked_record(document: Any) -> dict[str, Any] | None:
    """Return the known fields of a bearing's record for the page, times in ms; ``None`` if it is invalid."""
    try:
        return dict(_apply_rule(document, _RECORD))
    except ValueError:
        return None


def checked_alarms(document: Any, bearings: Collection[str]) -> dict[str, Any] | None:
    """Return the known fields of a list of alarms for the page, times in ms.

    ``None`` if it is invalid, or of another schema. Each alarm and row also gets ``actions``, the values
    of the actions to offer for it.

    Args:
        document: The list as received, which may be anything.
        bearings: Names of the bearings that are shown; alarms and rows of others are left out.
    """
    if not isinstance(document, dict) or document.get('schema') != ALARM_SCHEMA:
        return None
    try:
        record = dict(_apply_rule(document, _ALARMS))
    except ValueError:
        return None
    for kind in ('alarms', 'rows'):
        record[kind] = [record_item for record_item in record[kind] if record_item['bearing'] in bearings]
    for alarm in record['alarms']:
        alarm['actions'] = [action.value for action in OFFERED if _is_possible(alarm, action)]
    for row in record['rows']:
        # A row is all that a bearing has on show: what can be done about any of it is offered.
        bearing_alarms = [a for a in record['alarms'] if a['bearing'] == row['bearing']]
        possible = {do for a in bearing_alarms if a['state'] not in _OFF_SHOW for do in a['actions']}
        row['actions'] = [action.value for action in OFFERED if action.value in possible]
    return record


def _is_possible(alarm: dict[str, Any], action: Action) -> bool:
    """Return whether an action would change an alarm, and should be offered."""
    if action is Action.SILENCE:
        return bool(alarm['sounding'])
    # To shelve what is not active is possible, but nothing to offer.
    quiet = action is Action.SHELVE and alarm['state'] in _NOT_ACTIVE
    return (alarm['state'], action.value) in _TABLE and not quiet


MAX_ENTRIES = 5000
"""Entries of the log that are kept; the page shows the latest, a file of CSV has all."""
MAX_SHOWN = 60
"""Entries of the log that the page shows: the latest."""
LOG_FAMILY = 'stickslip_monitor/log/'
"""How the schema of a log begins, whatever its version."""
LOG_SCHEMA = f'{LOG_FAMILY}1'
LOG_TEXTS = ('node', 'bearing', 'alarm', 'priority', 'what', 'from', 'to', 'by', 'text')
# Characters of a text in the log; the rest of a longer one is cut off.
_MAX_TEXT = 300
# What a spreadsheet would compute.
_FORMULA = ('=', '+', '-', '@', '\t', '\r')


class EventLog:
    """The newest entries, oldest first; each is there once, however often it comes.

    A latched topic sends a dashboard that starts again what the file has already.

    Args:
        store: What keeps the entries over a restart; ``None`` for nothing.

    Attributes:
        damage: Why the entries of before are lost; empty where they are not.
    """

    def __init__(self, store: StateWriter | None = None) -> None:
        self._entries: dict[tuple[Any, ...], dict[str, Any]] = {}
        self._store, self.damage = store, ''
        if store is not None:
            self._restore_entries(store)

    def _restore_entries(self, store: StateWriter) -> None:
        """Take the entries of the file; set a damaged file aside, with an entry and :attr:`damage` on it."""
        try:
            self._add_entries(_kept_entries(store.read()))
        except AlarmStateError as error:
            end = 'what happened before is not shown'
            self.damage = f'the log {store.path} is damaged: {error}; {store.set_aside()}, and {end}'
            self.extend([{'time': time.time_ns() // 1_000_000, 'what': 'log', 'text': self.damage}])

    @property
    def fault(self) -> str:
        """Reason why the newest entries are not on disk; empty where they are, or need not be."""
        return self._store.fault if self._store is not None else ''

    def extend(self, entries: Iterable[Any]) -> None:
        """Add entries, see :meth:`_add_entries`; if any was new, have the log saved, where it is kept.

        An entry has ``time`` [ms since 1970] and the texts of :data:`LOG_TEXTS`, all optional.
        """
        if self._add_entries(entries) and self._store is not None:
            self._store.write({'schema': LOG_SCHEMA, 'entries': list(self._entries.values())})

    def _add_entries(self, entries: Iterable[Any]) -> bool:
        """Add entries, texts cut to :data:`_MAX_TEXT` characters; return whether any was new.

        What is no dictionary, or is there already, is left out; a time that is no integer becomes ``None``.
        Beyond :data:`MAX_ENTRIES` the oldest are dropped.
        """
        before = len(self._entries)
        for entry in entries:
            if isinstance(entry, dict):
                when = entry.get('time')
                texts = {key: str(entry.get(key, ''))[:_MAX_TEXT] for key in LOG_TEXTS}
                full_entry = {'time': when if isinstance(when, int) else None, **texts}
                self._entries.setdefault(tuple(full_entry.values()), full_entry)
        new = len(self._entries) > before
        while len(self._entries) > MAX_ENTRIES:
            del self._entries[next(iter(self._entries))]
        return new

    def clear(self) -> None:
        """Remove all entries; a saved log stays as it is."""
        self._entries.clear()

    def latest(self) -> list[dict[str, Any]]:
        """Return the :data:`MAX_SHOWN` entries that came last, in order of time, for the page."""
        return _in_order(list(self._entries.values())[-MAX_SHOWN:])

    def to_csv(self) -> str:
        """Return all entries, in order of time, as a text of CSV with a head line; times are ISO 8601 in UTC.

        An apostrophe is put before a cell that a spreadsheet would compute.
        """
        text = io.StringIO()
        table = csv.writer(text)
        table.writerow(('time', *LOG_TEXTS))
        for entry in _in_order(self._entries.values()):
            texts = [entry[key] for key in LOG_TEXTS]
            cells = [f"'{cell}" if cell.startswith(_FORMULA) else cell for cell in texts]
            table.writerow((_format_iso(entry['time']), *cells))
        return text.getvalue()


def _kept_entries(document: Any) -> list[Any]:
    """Return the entries of a saved log, empty where there is no file yet (``None``).

    Raises:
        AlarmStateError: It is not a log of this version.
    """
    if document is None:
        return []
    log: dict[str, Any] = document if isinstance(document, dict) else {}
    if log.get('schema') != LOG_SCHEMA:
        raise refused('schema', log.get('schema'), repr(LOG_SCHEMA), AlarmStateError)
    if not isinstance(entries := log.get('entries'), list):
        raise AlarmStateError("it has no list of 'entries'")
    return entries


def _in_order(entries: Iterable[dict[str, Any]]) -> list[dict[str, Any]]:
    """Merge entries of nodes by time into a list; those of one node keep their order, at any times.

    A time of ``None`` counts as 0.
    """
    nodes: dict[str, list[dict[str, Any]]] = {}
    for entry in entries:
        nodes.setdefault(entry['node'], []).append(entry)
    return list(heapq.merge(*nodes.values(), key=lambda entry: entry['time'] or 0))


def _format_iso(time_ms: int | None) -> str:
    """Format a time [ms since 1970] by ISO 8601 in UTC; empty for ``None`` or a time out of range."""
    if time_ms is None:
        return ''
    try:
        when = datetime.fromtimestamp(time_ms / 1000.0, timezone.utc)
    except (OverflowError, ValueError, OSError):
        return ''
    return when.isoformat(timespec='milliseconds').replace('+00:00', 'Z')
