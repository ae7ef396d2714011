# SPDX-License-Identifier: Apache-2.0
"""What a person asks for, with a name, as it travels from a dashboard to the alarms."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Any

from stickslip_monitor.errors import ConfigurationError
from stickslip_monitor.monitor.alarms.annunciator import MONITOR, TIMER, Action
from stickslip_monitor.monitor.alarms.causes import AlarmKind

ACTION_SCHEMA = 'stickslip_monitor/action/1'
LONGEST_NAME, LONGEST_REASON = 40, 200
ROS_SERVICE = 'ros service'
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
    """A request for JSON; the fields are in interfaces.md."""
    return {
        'schema': ACTION_SCHEMA,
        'action': request.action.value,
        'by': request.by,
        'bearing': request.bearing,
        'alarm': None if request.kind is None else request.kind.value,
        **({'reason': request.reason} if request.reason else {}),
    }


def parse_request(document: Any, bearings: Collection[str]) -> ActionRequest:
    """Take a request from somebody who may have sent anything.

    Args:
        document: What :func:`request_record` makes.
        bearings: Names of the bearings there are.

    Raises:
        ConfigurationError: It is none; the text names the field, its value and the rule.
    """
    if not isinstance(document, dict):
        raise ConfigurationError('a request must be a JSON object')
    if document.get('schema') != ACTION_SCHEMA:
        raise ConfigurationError(f"schema must be '{ACTION_SCHEMA}'")
    bearing = _choice(document, 'bearing', {name: name for name in bearings})
    kind = _choice(document, 'alarm', {kind.value: kind for kind in AlarmKind})
    actions = {action.value: action for action in Action}
    action = _choice(document, 'action', actions)
    if action is None:
        raise ConfigurationError('action = null must be one of ' + ', '.join(actions))
    by, reason = checked_name(document.get('by')), document.get('reason')
    reason = '' if reason is None else reason
    if not isinstance(reason, str) or len(reason) > LONGEST_REASON or not reason.isprintable():
        raise ConfigurationError(
            f'reason = {_short(reason)} must be at most {LONGEST_REASON} printable characters'
        )
    return ActionRequest(action, by, bearing, kind, reason.strip())


def checked_name(name: Any) -> str:
    """Somebody's name for the log, without space around it.

    Raises:
        ConfigurationError: It is none.
    """
    text = name.strip() if isinstance(name, str) else ''
    if not text or len(text) > LONGEST_NAME or not text.isprintable():
        raise ConfigurationError(
            f'by = {_short(name)} must be a name of 1 to {LONGEST_NAME} printable characters'
        )
    if text.casefold() in RESERVED:
        raise ConfigurationError(f'by = {text!r} is not a name of a person')
    return text


def _choice(document: dict[str, Any], field: str, choices: dict[str, Any]) -> Any:
    value = document.get(field)
    if value is None:
        return None
    if not isinstance(value, str) or value not in choices:
        raise ConfigurationError(f'{field} = {_short(value)} must be one of {", ".join(choices)}')
    return choices[value]


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= LONGEST_NAME else f'{text[:LONGEST_NAME]}...'
