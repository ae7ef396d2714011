# SPDX-License-Identifier: Apache-2.0
"""The list of alarms as it comes from the monitor, and what can be done about each."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

from stickslip_monitor.monitor.alarm_records import ALARM_SCHEMA
from stickslip_monitor.monitor.annunciator import Action
from stickslip_monitor.monitor.lifecycle import TABLE, State
from stickslip_monitor.monitor.requests import ActionRequest

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
_CHANGE = ('bearing', 'alarm', 'priority', 'what', 'from', 'to', 'by', 'text')


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
    own = [alarm for alarm in document['alarms'] if alarm['bearing'] in bearings]
    return {
        'time': document['time'] // 1_000_000,
        'sounding': document['sounding'],
        'unacknowledged': document['unacknowledged'],
        'flood': document['flood'],
        'alarms': [_alarm(alarm) for alarm in own],
        'changes': [
            {key: change[key] for key in _CHANGE} | {'time': _milliseconds(change.get('time'))}
            for change in document['changes']
        ],
    }


def _texts(record: Any, keys: Collection[str]) -> bool:
    return isinstance(record, dict) and all(isinstance(record.get(key), str) for key in keys)


def _alarm(alarm: dict[str, Any]) -> dict[str, Any]:
    times = {key: _milliseconds(alarm.get(key)) for key in ('since', 'changed', 'shelved_until')}
    flags = {key: bool(alarm.get(key)) for key in ('active', 'sounding', 'silenced')}
    record = {key: alarm[key] for key in _ALARM} | times | flags
    record['suppressed_by'] = [str(reason) for reason in alarm.get('suppressed_by') or ()]
    record['actions'] = [action.value for action in OFFERED if _possible(record, action)]
    return record


def _milliseconds(time_ns: Any) -> int | None:
    return time_ns // 1_000_000 if isinstance(time_ns, int) else None


def _possible(alarm: dict[str, Any], action: Action) -> bool:
    if action is Action.SILENCE:
        return bool(alarm['sounding'])
    # To put aside what does not stand is possible, but nothing to offer.
    quiet = action is Action.SHELVE and alarm['state'] in (State.NORMAL, State.SUPPRESSED)
    return (alarm['state'], action.value) in _TABLE and not quiet


def offered(alarms: dict[str, Any] | None, request: ActionRequest) -> bool:
    """Whether there is anything that a request could change, as far as is known here."""
    return alarms is not None and any(
        request.action.value in alarm['actions']
        and request.bearing in (None, alarm['bearing'])
        and request.kind in (None, alarm['alarm'])
        for alarm in alarms['alarms']
    )
