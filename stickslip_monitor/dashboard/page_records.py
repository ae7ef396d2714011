# SPDX-License-Identifier: Apache-2.0
"""Records as the page takes them.

What comes from a monitor, anybody on its network may have sent: it is checked field by field.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Collection
from typing import Any

from stickslip_monitor.monitor.alarm_list import Action
from stickslip_monitor.monitor.alarm_records import ALARM_SCHEMA
from stickslip_monitor.monitor.alarm_states import TABLE, AlarmState
from stickslip_monitor.monitor.bearing_records import POINT_NUMBERS
from stickslip_monitor.monitor.sample_types import INPUTS, Status

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
