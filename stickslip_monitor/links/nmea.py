# SPDX-License-Identifier: Apache-2.0
"""NMEA 0183 / IEC 61162-1: samples out of RPM and XDR, alarms into ALF, ALC and HBT, ACN back.

Pure: lines in, lines out. Nothing here is type approved; see docs/ship.md.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import datetime, timezone
from functools import reduce
from operator import xor
from typing import Any

from stickslip_monitor.monitor.alarms.alarm import AlarmKind, AlarmState, Priority
from stickslip_monitor.monitor.alarms.alarm_records import ActionRequest
from stickslip_monitor.monitor.alarms.annunciator import Action
from stickslip_monitor.monitor.signals import Input

BY = 'nmea'
"""Who acts, as far as a sentence says."""
LONGEST = 82
"""Characters of a sentence, from ``$`` to the end of its line."""
_SENTENCE = re.compile(r'[$!]([A-Z0-9]{2})([A-Z0-9]{3}),([^*$!]*)\*([0-9A-Fa-f]{2})\s*$')
_NUMBER = re.compile(r'[+-]?(\d+\.?\d*|\.\d+)', re.ASCII)
_UNFIT = re.compile(r'[^A-Z0-9 .+\-%]')
_TITLE = 18
_TITLES = {
    AlarmKind.AMPLITUDE_LIMIT: 'AMPLITUDE',
    AlarmKind.STICK_SLIP: 'STICK-SLIP',
    AlarmKind.BISTABLE: 'BISTABLE',
    AlarmKind.MARGIN_LOW: 'MARGIN LOW',
    AlarmKind.INPUT_LOST: 'INPUT LOST',
    AlarmKind.INPUT_IMPLAUSIBLE: 'INPUT FAULT',
    AlarmKind.VIBRATION: 'VIBRATION',
}
_PRIORITIES = {Priority.ALARM: 'A', Priority.WARNING: 'W', Priority.CAUTION: 'C'}
_LETTERS = {
    AlarmState.UNACKNOWLEDGED.value: 'V',
    AlarmState.ACKNOWLEDGED.value: 'A',
    AlarmState.RETURNED.value: 'U',
}
_COMMANDS = {'A': (Action.ACKNOWLEDGE, 'VSU'), 'S': (Action.SILENCE, 'V')}
"""What a display may do, and in which states."""


def sentence(body: str) -> str:
    """A whole sentence: ``$``, the body, its checksum (without the end of line)."""
    return f'${body}*{_checksum(body):02X}'


def _checksum(body: str) -> int:
    return reduce(xor, map(ord, body), 0)


def parse(line: str) -> tuple[str, str, list[str]] | None:
    """Talker, formatter and fields of a line; ``None`` without a sentence or its good checksum.

    What stands before the ``$`` (an IEC 61162-450 header and tag block) is passed over.
    """
    found = _SENTENCE.search(line)
    if found is None:
        return None
    talker, formatter, fields, checksum = found.groups()
    if _checksum(f'{talker}{formatter},{fields}') != int(checksum, 16):
        return None
    return talker, formatter, fields.split(',')


@dataclass(frozen=True, slots=True)
class NmeaInput:
    """One number of a sentence that is an input of a bearing."""

    bearing: str
    place: Input
    sentence: str  # ``RPM`` or ``XDR``
    talker: str = ''  # its talker; empty for any
    kind: str = ''  # ``S`` shaft or ``E`` engine of RPM; type of transducer of XDR
    number: int = 0  # number of the shaft or engine of RPM
    name: str = ''  # name of the transducer of XDR

    @property
    def label(self) -> str:
        """What it is, for a person."""
        return f'NMEA {self.sentence} {self.name or f"{self.kind} {self.number}"}'

    def read(self, fields: Sequence[str]) -> list[float]:
        """The numbers of a sentence of the right kind; NaN where it says that it has none."""
        if self.sentence == 'XDR':
            quads = [fields[i : i + 4] for i in range(0, len(fields) - 3, 4)]
            unit = [self.kind, 'N', self.name]
            return [_number(q[1]) for q in quads if [q[0], q[2], q[3]] == unit]
        if len(fields) < 3 or fields[0] != self.kind or _number(fields[1]) != self.number:
            return []
        # An invalid speed must not become a shaft at rest, which suppresses alarms.
        valid = len(fields) > 4 and fields[4] == 'A'
        return [_number(fields[2]) if valid else math.nan]


def _number(text: str) -> float:
    return float(text) if _NUMBER.fullmatch(text) else math.nan


def samples(inputs: Sequence[NmeaInput], line: str) -> Iterator[tuple[str, Input, float]]:
    """Bearing, input and number of every input that a line brings."""
    parsed = parse(line)
    if parsed is None:
        return
    talker, formatter, fields = parsed
    for item in inputs:
        if item.sentence == formatter and item.talker in ('', talker):
            for value in item.read(fields):
                yield item.bearing, item.place, value


@dataclass(slots=True)
class _Alert:
    """One alarm as the displays know it."""

    identifier: int
    instance: int
    priority: str
    title: str
    letter: str = 'N'
    revision: int = 0
    utc: str = ''
    text: str = ''


class Alerts:
    """The alarms as alert sentences.

    Args:
        bearings: Names of the bearings in the order of the file, which numbers them.
        first_alert: Identifier of the first kind of alarm.
    """

    def __init__(
        self,
        bearings: Sequence[str],
        talker: str,
        manufacturer: str,
        first_alert: int,
        accept_actions: bool,
    ) -> None:
        self._talker, self._manufacturer = talker, manufacturer
        self._accept_actions = accept_actions
        self._alerts = {
            (name, kind.value): _Alert(
                first_alert + number,
                instance,
                _PRIORITIES[kind.priority],
                clean(f'{_TITLES[kind]} {name}')[:_TITLE].strip(),
            )
            for instance, name in enumerate(bearings, 1)
            for number, kind in enumerate(AlarmKind)
        }
        self._sequence = self._list_sequence = self._beat_sequence = 0

    def take_alarms(self, record: dict[str, Any]) -> list[str]:
        """ALF sentences for what has changed in a list of alarms."""
        times = {(c['bearing'], c['alarm']): c['time'] for c in record['changes']}
        lines = []
        for alarm in record['alarms']:
            key = alarm['bearing'], alarm['alarm']
            alert = self._alerts.get(key)
            if alert is None or (letter := _letter(alarm, alert.priority)) == alert.letter:
                continue
            raised = alert.letter == 'N'
            alert.letter, alert.text = letter, alarm['text']
            alert.utc = _utc(times.get(key, alarm['changed'] or record['time']))
            alert.revision = alert.revision % 99 + 1
            lines += self._alf(alert, with_text=raised)
        return lines

    def current(self) -> list[str]:
        """ALF sentences for every alert that is not normal."""
        return [line for alert in self._standing() for line in self._alf(alert, with_text=True)]

    def listing(self) -> list[str]:
        """The cyclic list: ALC sentences of what is not normal."""
        entries = [f',{self._id(alert)},{alert.revision}' for alert in self._standing()]
        # Four entries of the longest kind would not fit into one sentence.
        groups = [entries[i : i + 3] for i in range(0, len(entries), 3)] or [[]]
        total, number = len(groups), self._list_sequence
        self._list_sequence = (number + 1) % 100
        return [
            self._say(f'ALC,{total:02},{i:02},{number:02},{len(group)}{"".join(group)}')
            for i, group in enumerate(groups, 1)
        ]

    def heartbeat(self, period: float, there: bool) -> str:
        """The HBT sentence: time to the next one [s], and whether the monitor is there."""
        line = self._say(f'HBT,{period:.1f},{"A" if there else "V"},{self._beat_sequence}')
        self._beat_sequence = (self._beat_sequence + 1) % 10
        return line

    def obey(self, line: str, now_ns: int) -> tuple[list[str], ActionRequest | None]:
        """Answers to an ACN sentence for us, and what it asks of the alarms."""
        parsed = parse(line)
        if parsed is None or parsed[1] != 'ACN' or len(parsed[2]) != 6:
            return [], None
        _, manufacturer, identifier, instance, command, flag = parsed[2]
        keys = {(f'{a.identifier}', f'{a.instance}'): key for key, a in self._alerts.items()}
        key = keys.get((identifier, instance))
        if key is None or flag != 'C' or manufacturer != self._manufacturer:
            return [], None
        if command == 'Q':
            return self.current(), None
        (bearing, kind), alert = key, self._alerts[key]
        action, states = _COMMANDS.get(command, (None, ''))
        # A caution is not acknowledged over this link (IEC 62923-1).
        if alert.priority == 'C' or alert.letter not in states or not self._accept_actions:
            return [self._say(f'ARC,{_utc(now_ns)},{self._id(alert)},{command}')], None
        assert action is not None
        return [], ActionRequest(action, BY, bearing, AlarmKind(kind))

    def _standing(self) -> list[_Alert]:
        return [alert for alert in self._alerts.values() if alert.letter != 'N']

    def _id(self, alert: _Alert) -> str:
        return f'{self._manufacturer},{alert.identifier},{alert.instance}'

    def _alf(self, alert: _Alert, with_text: bool) -> list[str]:
        self._sequence = (self._sequence + 1) % 10
        end = f'{self._id(alert)},{alert.revision},0,'
        total = 2 if with_text else 1
        first = f'{alert.utc},B,{alert.priority},{alert.letter},{end}{alert.title}'
        lines = [self._say(f'ALF,{total},1,{self._sequence},{first}')]
        if with_text:
            start = f'ALF,2,2,{self._sequence},,,,,{end}'
            room = LONGEST - len(self._say(start)) - 2
            text = clean(alert.text.partition(': ')[2] or alert.text)
            lines.append(self._say(start + text[:room].strip()))
        return lines

    def _say(self, body: str) -> str:
        return sentence(self._talker + body)


def clean(text: str) -> str:
    """Text of the letters that every display has and no rule reserves."""
    return ' '.join(_UNFIT.sub(' ', text.upper()).split())


def _letter(alarm: dict[str, Any], priority: str) -> str:
    # One matter, one alert: what a worse alarm stands for is not given beside it.
    letter = 'N' if alarm.get('covered') else _LETTERS.get(alarm['state'], 'N')
    if priority == 'C':
        return {'V': 'A', 'U': 'N'}.get(letter, letter)
    return 'S' if letter == 'V' and alarm['silenced'] else letter


def _utc(time_ns: int) -> str:
    return f'{datetime.fromtimestamp(time_ns / 1e9, timezone.utc):%H%M%S.%f}'[:9]
