# SPDX-License-Identifier: Apache-2.0
"""The state of a bearing, read back from its diagnostic status.

Live and in a replay the dashboard is fed with the same texts, so that it has one way in.

The list of alarms as it comes from the monitor, and what can be done about each.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any

from stickslip_monitor.monitor.alarms.alarm_records import ALARM_SCHEMA
from stickslip_monitor.monitor.alarms.annunciator import Action
from stickslip_monitor.monitor.alarms.lifecycle import TABLE, AlarmState
from stickslip_monitor.monitor.alarms.requests import ActionRequest
from stickslip_monitor.monitor.signals import INPUTS, QUANTITIES, Status

NUMBERS = {
    'speed': 'speed [m/s]',
    'rpm': 'shaft speed [rpm]',
    'load': 'load [N]',
    'hopf_speed': 'hopf speed [m/s]',
    'fold_speed': 'fold speed [m/s]',
    'hopf_margin': 'hopf margin',
    'fold_margin': 'fold margin',
    'growth_rate': 'growth rate [1/s]',
    'amplitude': 'amplitude [m]',
    'amplitude_exact': 'amplitude of the exact cycle [m]',
    'threshold_amplitude': 'threshold amplitude [m]',
    'clears_in': 'clears in [s]',
    'boundary_in': 'time to boundary [s]',
    'probability_can': 'probability can',
    'probability_will': 'probability will',
    'probability_runs': 'probability runs',
}
"""The numbers of an operating point, by the keys of the diagnostics that they come from."""
WORDS = {
    'reason': 'reason',
    'regime': 'regime',
    'outcome': 'outcome',
    'measured': 'measured',
    'unmeasured': 'measured unknown',
}
"""The words of a bearing, by the keys of the diagnostics that they come from."""
NOT_MONITORING = 'not_monitoring'
"""The reason of a bearing whose node is not active."""
STATUSES = {status.name.lower(): status.name.lower().replace('_', ' ') for status in Status}
BELIEVED = [status.name.lower() for status in Status if status.believed]


@dataclass(frozen=True, slots=True)
class BearingStatus:
    """A bearing at an instant.

    Attributes:
        time_ns: When, on the clock of the monitor [ns].
        text: What the monitor says, for a person.
        words: By the names of :data:`WORDS`; those that are known.
        sticking: Whether stick-slip is predicted; ``None`` before the first operating point.
        numbers: By the names of :data:`NUMBERS`; those that are known, ``inf`` and ``nan`` too.
        ages: Ages of the inputs that are lost [s].
        counts: Samples of each input by status.
        faults: Of an input that brings nothing, why.
    """

    time_ns: int
    text: str
    words: dict[str, str]
    sticking: bool | None
    numbers: dict[str, float]
    ages: dict[str, float]
    counts: dict[str, dict[str, int]]
    faults: dict[str, str]

    @property
    def idle(self) -> bool:
        """Whether the node says that nobody watches the bearing."""
        return self.words.get('reason') == NOT_MONITORING

    def believed(self, quantity: str) -> int:
        """Samples of an input that were used."""
        return sum(self.counts.get(quantity, {}).get(name, 0) for name in BELIEVED)


def read_status(time_ns: int, text: str, values: Mapping[str, str]) -> BearingStatus:
    """Read a diagnostic status; what is not there, or no number, is left out.

    Args:
        time_ns: Its time stamp [ns].
        text: Its message.
        values: Its key-value pairs.
    """
    sticking = values.get('stick-slip predicted')
    counts = {quantity: _counts(values, quantity) for quantity in INPUTS}
    return BearingStatus(
        time_ns,
        text,
        {word: values[key] for word, key in WORDS.items() if key in values},
        None if sticking is None else sticking == 'true',
        _numbers(values, NUMBERS),
        _numbers(values, {quantity: f'{quantity} age [s]' for quantity in INPUTS}),
        {quantity: own for quantity, own in counts.items() if own or quantity in QUANTITIES},
        {q: values[f'{q} fault'] for q in INPUTS if f'{q} fault' in values},
    )


def read_record(record: Mapping[str, Any]) -> BearingStatus:
    """Read the record of a bearing; what is not known is left out."""
    words = {'regime': 'regime', 'outcome': 'outcome', 'measured': 'measured'}
    inputs: Mapping[str, Any] = record['inputs']
    return BearingStatus(
        record['time'],
        record['text'],
        {'reason': record['reason'], 'unmeasured': record['unmeasured']}
        | {word: record[key] for word, key in words.items() if record[key] is not None},
        record['sticking'],
        {name: record[name] for name in NUMBERS if record.get(name) is not None},
        {
            name: math.inf if own['age'] is None else own['age']
            for name, own in inputs.items()
            if own['lost']
        },
        {name: own['counts'] for name, own in inputs.items()},
        {name: own['fault'] for name, own in inputs.items() if own['fault']},
    )


def _counts(values: Mapping[str, str], quantity: str) -> dict[str, int]:
    found = {
        name: _number(values, f'{quantity} samples {words}') for name, words in STATUSES.items()
    }
    return {
        name: int(count)
        for name, count in found.items()
        if count is not None and math.isfinite(count)
    }


def _numbers(values: Mapping[str, str], keys: Mapping[str, str]) -> dict[str, float]:
    found = {name: _number(values, key) for name, key in keys.items()}
    return {name: number for name, number in found.items() if number is not None}


def _number(values: Mapping[str, str], key: str) -> float | None:
    try:
        return float(values[key])
    except (KeyError, ValueError):
        return None


def status_record(status: BearingStatus) -> dict[str, Any]:
    """A status for the page; ``null`` where a number has no value."""
    numbers = {name: _finite(status.numbers.get(name)) for name in NUMBERS}
    return {
        'time': status.time_ns // 1_000_000,
        'text': status.text,
        'reason': status.words.get('reason', 'waiting'),
        'regime': status.words.get('regime'),
        'outcome': status.words.get('outcome'),
        'measured': status.words.get('measured'),
        'unmeasured': status.words.get('unmeasured', ''),
        'sticking': status.sticking,
        **numbers,
        'inputs': {
            quantity: {
                'lost': quantity in status.ages,
                'age': _finite(status.ages.get(quantity)),
                'counts': counts,
                'fault': status.faults.get(quantity, ''),
            }
            for quantity, counts in status.counts.items()
        },
    }


def _finite(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None


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
        'monitoring': document.get('monitoring') is not False,
        'sounding': document['sounding'],
        'unacknowledged': document['unacknowledged'],
        'flood': {
            'flooding': bool(document['flood'].get('flooding')),
            'alarms_10min': _count(document['flood'].get('alarms_10min')),
        },
        'alarms': [_alarm(alarm) for alarm in own],
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
