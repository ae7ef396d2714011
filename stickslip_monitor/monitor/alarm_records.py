# SPDX-License-Identifier: Apache-2.0
"""Makes plain records for JSON of the alarms, of requests, and of the state that a restart restores."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

from stickslip_monitor.errors import AlarmStateError, ConfigurationError
from stickslip_monitor.monitor.alarm_list import (
    MONITOR,
    ON_SHOW,
    STANDING,
    TIMER,
    WAITING,
    Action,
    AlarmChange,
    Annunciator,
    LiveAlarm,
)
from stickslip_monitor.monitor.alarm_states import AlarmKind, AlarmState
from stickslip_monitor.monitor.value_check import refused

ALARM_SCHEMA = 'stickslip_monitor/alarm/1'
STATE_SCHEMA = 'stickslip_monitor/alarm_state/1'
_SHOWN = (*STANDING, AlarmState.LATCHED, AlarmState.SHELVED, AlarmState.OUT_OF_SERVICE)
# What of an alarm is kept over a restart: its attribute, and its types in JSON.
_KEPT: dict[str, tuple[str, tuple[type, ...]]] = {
    'state': ('state', (str,)),
    'active': ('active', (bool,)),
    'occurred': ('occurred', (bool,)),
    'suppressed_by': ('suppressed_by', (list,)),
    'since': ('since_ns', (int, type(None))),
    'changed': ('changed_ns', (int, type(None))),
    'by': ('by', (str,)),
    'text': ('text', (str,)),
}
_T = TypeVar('_T')


def alarms_record(
    annunciator: Annunciator,
    changes: Iterable[AlarmChange],
    time_ns: int,
    sequence: int,
    *,
    monitoring: bool = True,
    notes: Iterable[dict[str, Any]] = (),
    text_of: Callable[[str], str] = str,
) -> dict[str, Any]:
    """Return the record of all alarms and of their latest changes; the fields are in interfaces.md.

    Args:
        annunciator: The alarms.
        changes: Those since the last record.
        time_ns: Stamp of the record [ns].
        sequence: Number of the record.
        monitoring: Whether the bearings are watched.
        notes: Records of what else has happened since the last record.
        text_of: Returns what a bearing of some name says now; its name by default.
    """
    return {
        'schema': ALARM_SCHEMA,
        'time': time_ns,
        'sequence': sequence,
        'monitoring': monitoring,
        'sounding': annunciator.sounding,
        'unacknowledged': sum(alarm.state in WAITING for alarm in annunciator),
        'flood': annunciator.flood.figures(annunciator.now_ns),
        'changes': [change_record(change) for change in changes],
        'notes': list(notes),
        'alarms': [alarm_record(annunciator, alarm) for alarm in annunciator],
        'rows': list(row_records(annunciator, time_ns, text_of)),
    }


def change_record(change: AlarmChange) -> dict[str, Any]:
    """Return the record of one change of an alarm; the fields are in interfaces.md."""
    return {
        'time': change.time_ns,
        'bearing': change.bearing,
        'alarm': change.kind.value,
        'priority': change.kind.priority.name.lower(),
        'what': change.what,
        'from': change.before.value,
        'to': change.after.value,
        'by': change.by,
        'text': change.text,
    }


def _common_fields(alarm: LiveAlarm) -> dict[str, Any]:
    """Return the fields that the record of an alarm and the row of its bearing share."""
    return {
        'bearing': alarm.bearing,
        'alarm': alarm.kind.value,
        'priority': alarm.kind.priority.name.lower(),
        'since': alarm.since_ns,
        'changed': alarm.changed_ns,
        'by': alarm.by,
        'count': alarm.count,
    }


def alarm_record(annunciator: Annunciator, alarm: LiveAlarm) -> dict[str, Any]:
    """Return the record of one alarm as it stands; the fields are in interfaces.md."""
    return _common_fields(alarm) | {
        'state': alarm.state.value,
        'active': alarm.active,
        'sounding': alarm.sounding,
        'silenced': alarm.silenced,
        'latching': annunciator.is_latching(alarm),
        'suppressed_by': list(alarm.suppressed_by),
        'shelved_until': alarm.shelved_until_ns,
        'text': alarm.text,
        'covered': annunciator.covering_kind(alarm) is not None,
    }


def row_records(
    annunciator: Annunciator, time_ns: int, text_of: Callable[[str], str]
) -> Iterator[dict[str, Any]]:
    """Yield a row for each bearing with an alarm that is not normal or suppressed: its worst, as it stands.

    Active alarms come before those that are over and wait. The state is that of the worst; where any of them
    waits for a person it is unacknowledged, or returned_unacknowledged if the worst is over.

    Args:
        annunciator: The alarms.
        time_ns: Stamp of the record [ns].
        text_of: Returns what a bearing of some name says now.
    """
    for name, alarms in annunciator.alarms.items():
        shown = [alarm for alarm in alarms.values() if alarm.state in _SHOWN]
        if not shown:
            continue
        # What is active comes before what is over and waits.
        shown.sort(key=lambda alarm: (alarm.state not in ON_SHOW, -alarm.kind.priority))
        worst, state = shown[0], shown[0].state
        # The row waits for somebody where any of its alarms does.
        if any(alarm.state in WAITING for alarm in shown):
            active = state in ON_SHOW
            state = AlarmState.UNACKNOWLEDGED if active else AlarmState.RETURNED
        text = text_of(name)
        if worst.kind is AlarmKind.INPUT_IMPLAUSIBLE:
            text = f'{worst.text} {text}'
        back = annunciator.causes[name].recovery_times if worst.kind is AlarmKind.INPUT_LOST else None
        shift = time_ns - annunciator.now_ns
        yield _common_fields(worst) | {
            'state': state.value,
            'sounding': any(alarm.sounding for alarm in shown),
            'silenced': any(alarm.silenced for alarm in shown),
            'text': text,
            'first_text': worst.first_text,
            'first_time': worst.first_ns,
            'came_back': worst.came_back,
            'came_back_since': worst.first_ns if worst.came_back else None,
            'back_since': None if back is None else back[0] + shift,
            'clears_at': None if back is None else back[1] + shift,
            'kinds': [alarm.kind.value for alarm in shown],
        }


def state_record(
    annunciator: Annunciator, time_ns: int, memories: Mapping[str, dict[str, Any]] | None = None
) -> dict[str, Any]:
    """Return the document that is saved for a restart: the alarms, and the memory of each bearing by name.

    Args:
        annunciator: The alarms.
        time_ns: When it is saved [ns since 1970].
        memories: The memory of each bearing by name, as :meth:`.State.record`; ``None`` for none.
    """
    return {
        'schema': STATE_SCHEMA,
        'time': time_ns,
        'states': memories or {},
        'bearings': {
            name: {
                'alarms': {
                    kind.value: _saved_record(alarm, annunciator.now_ns) for kind, alarm in alarms.items()
                }
            }
            for name, alarms in annunciator.alarms.items()
        },
    }


def _saved_record(alarm: LiveAlarm, now_ns: int) -> dict[str, Any]:
    """Return the saved fields of one alarm, with the time that is left of its shelf [ns]."""
    values = {key: getattr(alarm, name) for key, (name, _) in _KEPT.items()}
    left_ns = max(alarm.shelf_end_ns - now_ns, 0)
    reasons = list(alarm.suppressed_by)
    return values | {'state': alarm.state.value, 'suppressed_by': reasons, 'shelf_left': left_ns}


def recall_state(annunciator: Annunciator, document: object, time_ns: int) -> dict[str, Any]:
    """Restore the saved alarms into an annunciator that has not run yet.

    Bearings that are no longer configured are skipped; new ones start fresh. The time that has passed
    meanwhile, as far as the clock shows, counts for the shelves. An alarm that waits for acknowledgement
    begins to sound now.

    Args:
        annunciator: The alarms, changed.
        document: What was saved, of any type.
        time_ns: Now [ns since 1970].

    Returns:
        The saved memory of each bearing by name, unchecked, for :meth:`.State.of_record`.

    Raises:
        AlarmStateError: The document is not one of :func:`state_record`; nothing is restored.
    """
    kept_ns = _require_entry(document, 'time', (int,), 'the document')
    if (schema := _require_entry(document, 'schema', (str,), 'the document')) != STATE_SCHEMA:
        raise refused('schema', schema, repr(STATE_SCHEMA), AlarmStateError)
    bearings = _require_entry(document, 'bearings', (dict,), 'the document')
    assert isinstance(document, dict)  # it has a time
    # Those of 0.2.0 may have no memories: the alarms are taken over all the same.
    memories = _require_entry({'states': {}, **document}, 'states', (dict,), 'the document')
    for name in bearings:
        _check_saved(name, bearings[name])
    passed_ns = max(time_ns - kept_ns, 0)
    for name in bearings.keys() & annunciator.alarms.keys():
        for kind, record in bearings[name]['alarms'].items():
            alarm = annunciator.alarms[name].get(AlarmKind(kind))
            if alarm is not None:
                _restore_alarm(alarm, record)
                if alarm.state is AlarmState.SHELVED:
                    left_ns = max(record['shelf_left'] - passed_ns, 0)
                    alarm.shelf_end_ns = annunciator.now_ns + left_ns
                    alarm.shelved_until_ns = time_ns + left_ns
                if alarm.sounding:
                    alarm.sounded_ns = annunciator.now_ns
    annunciator.restart()
    return memories


def _check_saved(name: str, record: object) -> None:
    """Check the saved alarms of a bearing of that name.

    Raises:
        AlarmStateError: An alarm, its state or a value is unknown, missing or of another type.
    """
    for kind, saved in _require_entry(record, 'alarms', (dict,), name).items():
        if kind not in {alarm_kind.value for alarm_kind in AlarmKind}:
            raise AlarmStateError(f'{name}: unknown alarm {kind!r}')
        for key, (_, types) in _KEPT.items():
            _require_entry(saved, key, types, f'{name}.{kind}')
        _require_entry(saved, 'shelf_left', (int,), f'{name}.{kind}')
        if saved['state'] not in {alarm_kind.value for alarm_kind in AlarmState}:
            raise AlarmStateError(f'{name}.{kind}: unknown state {saved["state"]!r}')


def _require_entry(record: object, key: str, types: tuple[type[_T], ...], where: str) -> _T:
    """Return the value of a key in a record, of exactly one of some types.

    Raises:
        AlarmStateError: It is missing or of another type; the text begins with ``where``.
    """
    if not isinstance(record, dict) or key not in record:
        raise AlarmStateError(f"{where} has no '{key}'")
    value: _T = record[key]
    if type(value) not in types:
        raise AlarmStateError(f'{where}: {key} = {value!r} has the wrong type')
    return value


def _restore_alarm(alarm: LiveAlarm, record: dict[str, Any]) -> None:
    """Set the saved values of an alarm, but not its shelf."""
    for key, (name, _) in _KEPT.items():
        setattr(alarm, name, record[key])
    alarm.state, alarm.suppressed_by = AlarmState(record['state']), tuple(record['suppressed_by'])


ACTION_SCHEMA = 'stickslip_monitor/action/1'
LONGEST_NAME, LONGEST_REASON = 40, 200
ROS_SERVICE = 'ros service'
GIVEN_BACK = {
    'suppress': "use 'shelve', or 'remove' until somebody restores the alarms",
    'unsuppress': "use 'unshelve', or 'restore'",
}
"""Actions of earlier versions, and what takes their place."""
RESERVED = (MONITOR, TIMER, ROS_SERVICE)
"""Names by which the log says that it was no person, or none who gave a name."""


@dataclass(frozen=True, slots=True)
class ActionRequest:
    """One action that a person asks for."""

    action: Action
    by: str
    bearing: str | None = None  # None: all of them
    kind: AlarmKind | None = None  # None: all that the action is about
    reason: str = ''


def request_record(request: ActionRequest) -> dict[str, Any]:
    """Return a request for JSON, without an empty reason; the fields are in interfaces.md."""
    return {
        'schema': ACTION_SCHEMA,
        'action': request.action.value,
        'by': request.by,
        'bearing': request.bearing,
        'alarm': None if request.kind is None else request.kind.value,
        **({'reason': request.reason} if request.reason else {}),
    }


def parse_request(document: object, bearings: Collection[str]) -> ActionRequest:
    """Parse a request of :func:`request_record` from an untrusted sender.

    Args:
        document: The request, of any type.
        bearings: Names of the bearings that there are.

    Returns:
        The request, its name and reason without space around them; a missing reason is ''. A bearing or alarm
        that is missing or null is None, which means all. Unknown fields are ignored.

    Raises:
        ConfigurationError: It is no valid request; the text names the field, its value and the rule.
    """
    if not isinstance(document, dict):
        raise ConfigurationError('a request must be a JSON object')
    if document.get('schema') != ACTION_SCHEMA:
        raise refused('schema', document.get('schema'), repr(ACTION_SCHEMA))
    bearing = _parse_choice(document, 'bearing', {name: name for name in bearings})
    kind = _parse_choice(document, 'alarm', {kind.value: kind for kind in AlarmKind})
    actions = {action.value: action for action in Action}
    successor = GIVEN_BACK.get(str(document.get('action')))
    if successor is not None:
        raise ConfigurationError(f'action = {document["action"]!r} no longer exists: {successor}')
    action = _parse_choice(document, 'action', actions)
    if action is None:
        raise refused('action', None, f'one of {", ".join(actions)}')
    by, reason = require_person_name(document.get('by')), document.get('reason')
    reason = '' if reason is None else reason
    if not isinstance(reason, str) or len(reason) > LONGEST_REASON or not reason.isprintable():
        raise refused('reason', reason, f'at most {LONGEST_REASON} printable characters')
    return ActionRequest(action, by, bearing, kind, reason.strip())


def require_person_name(name: object) -> str:
    """Check the name of a person for the log, and return it without space around it.

    Raises:
        ConfigurationError: It is empty, longer than 40 characters, not printable, no text, or reserved in any
            case of its letters.
    """
    text = name.strip() if isinstance(name, str) else ''
    if not text or len(text) > LONGEST_NAME or not text.isprintable():
        raise refused('by', name, f'a name of 1 to {LONGEST_NAME} printable characters')
    if text.casefold() in RESERVED:
        raise refused('by', text, 'the name of a person')
    return text


def _parse_choice(document: dict[str, Any], field: str, choices: dict[str, _T]) -> _T | None:
    """Return the choice that a field's text names; ``None`` where the field is missing or null.

    Raises:
        ConfigurationError: It is not one of the choices.
    """
    value = document.get(field)
    if value is None:
        return None
    if not isinstance(value, str) or value not in choices:
        raise refused(field, value, f'one of {", ".join(choices)}')
    return choices[value]
