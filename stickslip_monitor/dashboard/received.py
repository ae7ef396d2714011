# SPDX-License-Identifier: Apache-2.0
"""What comes from a monitor, checked and made ready for the page: bearings and alarms."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable
from typing import Any

from stickslip_monitor.monitor.alarms.alarm_records import ALARM_SCHEMA
from stickslip_monitor.monitor.alarms.annunciator import Action
from stickslip_monitor.monitor.alarms.causes import Priority
from stickslip_monitor.monitor.alarms.lifecycle import TABLE, AlarmState
from stickslip_monitor.monitor.alarms.requests import ActionRequest
from stickslip_monitor.monitor.signals import Status

NUMBERS = (
    'speed',
    'rpm',
    'load',
    'hopf_speed',
    'fold_speed',
    'hopf_margin',
    'fold_margin',
    'growth_rate',
    'amplitude',
    'amplitude_exact',
    'threshold_amplitude',
    'probability_can',
    'probability_will',
    'probability_runs',
)
"""The numbers of an operating point that page and metrics show."""
WORDS = ('regime', 'outcome', 'measured', 'unmeasured')
NOT_MONITORING = 'not_monitoring'
"""The reason of a bearing whose node is not active."""
STATUSES = tuple(status.name.lower() for status in Status)


def checked_record(document: Any) -> dict[str, Any] | None:
    """The record of a bearing for the page, times in milliseconds; ``None`` where it is none.

    A number without a value is ``None``; so is what is no number.
    """
    if not _texts(document, ('bearing', 'text', 'reason')):
        return None
    if not isinstance(document.get('time'), int) or not isinstance(document.get('inputs'), dict):
        return None
    sticking = document.get('sticking')
    return {
        'bearing': document['bearing'],
        'time': _milliseconds(document['time']),
        'text': document['text'],
        'reason': document['reason'],
        'sticking': sticking if isinstance(sticking, bool) else None,
        'held_until': _milliseconds(document.get('held_until')),
        **{name: _word(document.get(name)) for name in WORDS},
        **{name: _finite(document.get(name)) for name in NUMBERS},
        'inputs': {
            str(name): _input(own)
            for name, own in document['inputs'].items()
            if isinstance(own, dict)
        },
    }


def _input(own: dict[str, Any]) -> dict[str, Any]:
    counts = own.get('counts')
    counts = counts if isinstance(counts, dict) else {}
    return {
        'lost': own.get('lost') is True,
        'age': _finite(own.get('age')),
        'rate': _finite(own.get('rate')),
        'fault': _word(own.get('fault')) or '',
        'counts': {name: counts[name] for name in STATUSES if isinstance(counts.get(name), int)},
    }


def _word(value: Any) -> str | None:
    return value if isinstance(value, str) else None


def _finite(value: Any) -> float | None:
    number = isinstance(value, int | float) and not isinstance(value, bool)
    return value if number and math.isfinite(value) else None


OFFERED = (Action.ACKNOWLEDGE, Action.SILENCE, Action.RESET, Action.SHELVE, Action.UNSHELVE)
"""What a dashboard may ask for. To lock the shaft or to take an alarm out of service is left to
the services: it makes alarms mean nothing, and is not for a tap on a phone."""
_TYPES: dict[str, Any] = {
    'time': int,
    'sounding': bool,
    'unacknowledged': int,
    'flood': dict,
    'changes': list,
    'alarms': list,
}
_TABLE = {(state.value, trigger.value) for state, trigger in TABLE}
_ALARM = ('bearing', 'alarm', 'priority', 'state', 'by', 'text')
_NOTE = ('what', 'text')
_CHANGE = ('bearing', 'alarm', 'priority', 'what', 'from', 'to', 'by', 'text')
_OFF_SHOW = (
    AlarmState.NORMAL,
    AlarmState.SUPPRESSED,
    AlarmState.SHELVED,
    AlarmState.OUT_OF_SERVICE,
)


def checked_alarms(document: Any, bearings: Collection[str]) -> dict[str, Any] | None:
    """A list of alarms for the page, times in milliseconds; ``None`` where it is none.

    Args:
        document: What should be the monitor's list.
        bearings: Names of the bearings that are shown; those of others are left out.
    """
    if not isinstance(document, dict) or document.get('schema') != ALARM_SCHEMA:
        return None
    if any(not isinstance(document.get(key), kind) for key, kind in _TYPES.items()):
        return None
    if not all(_texts(a, _ALARM) for a in document['alarms']):
        return None
    if not all(_texts(c, _CHANGE) for c in document['changes']):
        return None
    alarms = [_alarm(alarm) for alarm in document['alarms'] if alarm['bearing'] in bearings]
    rows = [row for row in document.get('rows') or _worst(document) if _texts(row, _ALARM)]
    return {
        'time': document['time'] // 1_000_000,
        'monitoring': document.get('monitoring') is not False,
        'sounding': document['sounding'],
        'unacknowledged': document['unacknowledged'],
        'flood': {
            'flooding': bool(document['flood'].get('flooding')),
            'alarms_10min': _count(document['flood'].get('alarms_10min')),
        },
        'alarms': alarms,
        'rows': [_row(row, alarms) for row in rows if row['bearing'] in bearings],
        'changes': [
            {key: change[key] for key in _CHANGE} | {'time': _milliseconds(change.get('time'))}
            for change in document['changes']
        ],
        'notes': [
            {key: note[key] for key in _NOTE} | {'time': _milliseconds(note.get('time'))}
            for note in _list(document.get('notes'))
            if _texts(note, _NOTE)
        ],
    }


def log_entries(record: dict[str, Any], node: str) -> list[dict[str, Any]]:
    """What a list of alarms says has happened, in its order of time."""
    entries = [each | {'node': node} for each in (*record['notes'], *record['changes'])]
    return sorted(entries, key=lambda entry: entry['time'] or 0)


def _count(value: Any) -> int:
    return value if isinstance(value, int) else 0


def _list(value: Any) -> list[Any]:
    return value if isinstance(value, list) else []


def _texts(record: Any, keys: Collection[str]) -> bool:
    return isinstance(record, dict) and all(isinstance(record.get(key), str) for key in keys)


def _alarm(alarm: dict[str, Any]) -> dict[str, Any]:
    record = _shown(alarm, ('since', 'changed', 'shelved_until'))
    record['active'] = bool(alarm.get('active'))
    record['suppressed_by'] = [str(reason) for reason in _list(alarm.get('suppressed_by'))]
    record['actions'] = [action.value for action in OFFERED if _possible(record, action)]
    return record


def _row(row: dict[str, Any], alarms: Iterable[dict[str, Any]]) -> dict[str, Any]:
    """All that a bearing has on show; what can be done is what can be done about any of it."""
    own = [
        alarm
        for alarm in alarms
        if alarm['bearing'] == row['bearing'] and alarm['state'] not in _OFF_SHOW
    ]
    possible = {action for alarm in own for action in alarm['actions']}
    return _shown(row, ('since', 'changed', 'first_time', 'came_back_since')) | {
        'kinds': [str(kind) for kind in _list(row.get('kinds'))],
        'first_text': _word(row.get('first_text')) or '',
        'came_back': _count(row.get('came_back')),
        'actions': [action.value for action in OFFERED if action.value in possible],
    }


def _worst(document: dict[str, Any]) -> list[dict[str, Any]]:
    """The rows of a monitor that sends none: the worst alarm of each bearing."""
    own: dict[str, list[dict[str, Any]]] = {}
    for alarm in document['alarms']:
        if alarm['state'] not in _OFF_SHOW:
            own.setdefault(alarm['bearing'], []).append(alarm)
    return [
        min(alarms, key=_badness) | {'kinds': [alarm['alarm'] for alarm in alarms]}
        for alarms in own.values()
    ]


def _badness(alarm: dict[str, Any]) -> tuple[bool, int]:
    order = [priority.name.lower() for priority in sorted(Priority, reverse=True)]
    priority = alarm['priority']
    rank = order.index(priority) if priority in order else len(order)
    return alarm['state'] != AlarmState.UNACKNOWLEDGED, rank


def _shown(alarm: dict[str, Any], times: Iterable[str]) -> dict[str, Any]:
    return {
        **{key: alarm[key] for key in _ALARM},
        **{key: _milliseconds(alarm.get(key)) for key in times},
        **{key: bool(alarm.get(key)) for key in ('sounding', 'silenced')},
    }


def _milliseconds(time_ns: Any) -> int | None:
    return time_ns // 1_000_000 if isinstance(time_ns, int) else None


def _possible(alarm: dict[str, Any], action: Action) -> bool:
    if action is Action.SILENCE:
        return bool(alarm['sounding'])
    # To shelve what is not active is possible, but nothing to offer.
    quiet = action is Action.SHELVE and alarm['state'] in (
        AlarmState.NORMAL,
        AlarmState.SUPPRESSED,
    )
    return (alarm['state'], action.value) in _TABLE and not quiet


def offered(alarms: dict[str, Any] | None, request: ActionRequest) -> bool:
    """Whether there is anything that a request could change, as far as is known here."""
    return alarms is not None and any(
        request.action.value in alarm['actions']
        and request.bearing in (None, alarm['bearing'])
        and request.kind in (None, alarm['alarm'])
        for alarm in alarms['alarms']
    )
