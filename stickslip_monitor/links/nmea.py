# SPDX-License-Identifier: Apache-2.0
"""NMEA 0183 / IEC 61162-1: samples out of RPM and XDR, alarms into ALF, ALC and HBT, ACN back.

Pure: lines in, lines out. Nothing here is type approved; see docs/ship.md.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timezone
from functools import reduce
from operator import xor
from typing import Any

from stickslip_monitor.links.bus_inputs import BusInputs
from stickslip_monitor.links.links_config import BusInput
from stickslip_monitor.monitor.alarm_list import Action
from stickslip_monitor.monitor.alarm_records import ActionRequest
from stickslip_monitor.monitor.alarm_states import AlarmKind, AlarmState, Priority
from stickslip_monitor.monitor.sample_types import Input

BY = 'nmea'
"""Who acts, as far as a sentence says."""
MAX_SENTENCE = 82
"""Characters of a sentence, from ``$`` to the end of its line."""
# Of a maker's own, such as $PFEC, the rest of the name stands for the formatter.
_SENTENCE = re.compile(r'[$!]([A-Z0-9]{2})([A-Z0-9]{2,}),([^*$!]*)\*([0-9A-Fa-f]{2})')
_MAX_REST = 1024  # characters kept of a beginning: an IEC 61162-450 header, tag block and sentence fit
_UNREADABLE = 'unreadable (another baud rate?)'
_NUMBER = re.compile(r'[+-]?(\d+\.?\d*|\.\d+)', re.ASCII)
_UNFIT = re.compile(r'[^A-Z0-9 .+\-%]')
_TITLE = 16
"""Characters of the title of an alert."""
_TITLES = {
    AlarmKind.AMPLITUDE_LIMIT: 'AMPLITUDE',
    AlarmKind.STICK_SLIP: 'STICK-SLIP',
    AlarmKind.BISTABLE: 'BISTABLE',
    AlarmKind.MARGIN_LOW: 'MARGIN LOW',
    AlarmKind.INPUT_LOST: 'INPUT LOST',
    AlarmKind.INPUT_IMPLAUSIBLE: 'INPUT BAD',
    AlarmKind.VIBRATION: 'VIBRATION',
}
_TEXT = 48
"""Characters of the text of an alert."""
_ORDER = re.compile(r'(\w+) above ([\d.]+ rpm(?: astern)?).* Now (\S+ rpm)[^,]*, (\S+ kN)')
"""What to do and where the bearing is, in the text of an alarm."""
_ORDERS = {'speed': 'ABOVE {} OR STOP', 'stay': 'STAY ABOVE {}', 'Clears': 'CLEARS ABOVE {}'}
"""The orders by their last word before the speed: no display has room for all of the text."""
_PRIORITIES = {Priority.ALARM: 'A', Priority.WARNING: 'W', Priority.CAUTION: 'C'}
_LETTERS = {
    AlarmState.UNACKNOWLEDGED.value: 'V',
    AlarmState.ACKNOWLEDGED.value: 'A',
    AlarmState.RETURNED.value: 'U',
}
_COMMANDS = {'A': (Action.ACKNOWLEDGE, 'VSU'), 'S': (Action.SILENCE, 'V')}
"""What a display may do, and in which states."""


def format_sentence(body: str) -> str:
    """Return a whole sentence without the end of line: ``$``, the body, ``*`` and its checksum."""
    return f'${body}*{_xor_checksum(body):02X}'


def _xor_checksum(body: str) -> int:
    """Return the exclusive or of all characters of a body, which stands between ``$`` and ``*``."""
    return reduce(xor, map(ord, body), 0)


def parse_sentence(text: str) -> tuple[str, str, list[str]] | None:
    """Return talker, formatter and fields of the first sentence of a text.

    ``None`` without a sentence, or with a wrong checksum or none. What stands before the ``$`` or ``!`` (an
    IEC 61162-450 header and tag block) is skipped.
    """
    match = _SENTENCE.search(text)
    if match is None:
        return None
    talker, formatter, fields, checksum = match.groups()
    if _xor_checksum(f'{talker}{formatter},{fields}') != int(checksum, 16):
        return None
    return talker, formatter, fields.split(',')


class SentenceStream:
    """Sentences out of bytes, however these were cut, ended or joined.

    Attributes:
        unused: Count of what was not used, by reason.
    """

    def __init__(self) -> None:
        self.unused: Counter[str] = Counter()
        self._rest = ''

    def take(self, data: bytes) -> list[str]:
        """Return the sentences with a good checksum that some bytes complete, without ends of line.

        A beginning is stored for the next call, up to 1024 characters of it; what cannot be used is counted
        in :attr:`unused`.
        """
        text = self._rest + data.decode('ascii', 'replace')
        pieces = [piece for piece in re.split('(?=[$!])', text) if piece.startswith(('$', '!'))]
        sentences, self._rest = [], ''
        for number, piece in enumerate(pieces):
            match = _SENTENCE.match(piece)
            if match is not None:
                good = parse_sentence(match[0]) is not None
                sentences += [match[0]] if good else []
                self.unused['bad checksum'] += not good
            elif number == len(pieces) - 1 and not re.search('[\r\n]', piece):
                self._rest = piece[-_MAX_REST:]
            else:
                named = re.match('[$!][A-Z0-9]{4,},', piece)
                self.unused['no checksum' if named else _UNREADABLE] += 1
        if not pieces and text.strip():
            self.unused[_UNREADABLE] += 1
        return sentences


def read_numbers(item: BusInput, fields: Sequence[str]) -> list[float]:
    """Return the numbers for an input in the fields of a sentence of its formatter, as these have them.

    They are in rpm of a sentence RPM, in N of a transducer. Empty where it is of another shaft, engine or
    transducer, or too short. A number that is marked as invalid, or cannot be read, is NaN.
    """
    if item.sentence == 'XDR':
        unit = [item.kind, 'N', item.name]
        return [_parse_number(q[1]) for q in _split_transducers(fields) if [q[0], q[2], q[3]] == unit]
    if len(fields) < 3 or fields[0] != item.kind or _parse_number(fields[1]) != item.number:
        return []
    # An invalid speed must not become a shaft at rest, which suppresses alarms. Some ships
    # leave the pitch out.
    valid = len(fields) > 3 and fields[min(len(fields) - 1, 4)] == 'A'
    return [_parse_number(fields[2]) if valid else math.nan]


def describe_unused(item: BusInput, formatter: str, fields: Sequence[str]) -> str:
    """Describe a sentence without a number for an input, for the log; '' if it is of another formatter."""
    if formatter != item.sentence:
        return ''
    if formatter == 'RPM':
        return f'RPM,{",".join(fields[:2])}'
    transducers = [q for q in _split_transducers(fields) if q[3] == item.name or not item.name]
    named = [f'{q[3]} as type {q[0]} in {q[2]}, and only type N in N is used' for q in transducers]
    return 'XDR ' + (', '.join(named) or ', '.join(q[3] for q in _split_transducers(fields)))


def _split_transducers(fields: Sequence[str]) -> list[Sequence[str]]:
    """Split an XDR sentence into its transducers: type, value, unit, name; drop an incomplete last one."""
    return [fields[i : i + 4] for i in range(0, len(fields) - 3, 4)]


def _parse_number(text: str) -> float:
    """Parse a decimal number without an exponent, spaces around it allowed; NaN for anything else."""
    return float(text) if _NUMBER.fullmatch(text.strip()) else math.nan


class NmeaInputs(BusInputs):
    """Samples out of sentences, and a count of what was received in their place.

    Args:
        inputs: Those that come from NMEA.
        log: As of :class:`.BusInputs`, and given a line for each input that has become silent.
    """

    def __init__(self, inputs: Sequence[BusInput], log: Callable[[str], object]) -> None:
        super().__init__(inputs, log)
        self._others: dict[BusInput, Counter[str]] = {items[0]: Counter() for items, _ in self.groups}

    def take(self, text: str, now: float) -> Iterator[tuple[str, Input, float]]:
        """Yield bearing, input and number (NaN if invalid) for each input that an admitted talker brings.

        Numbers are in rpm or N. ``now`` is of a steady clock [s]. What a sentence brings in place of an
        input's number is counted, for :meth:`log_silent`.
        """
        parsed = parse_sentence(text)
        if parsed is None:
            return
        talker, formatter, fields = parsed
        for items, admission in self.groups:
            first = items[0]
            values = read_numbers(first, fields) if first.sentence == formatter else []
            if not values:
                self._others[first][describe_unused(first, formatter, fields)] += 1
            elif admission.admits(talker, now, valid=not all(map(math.isnan, values))):
                for value in values:
                    if math.isnan(value):
                        self._others[first]['invalid by its talker'] += 1
                    else:
                        self.note_received(first, now)
                        self._others[first].clear()
                    yield from ((item.bearing, item.place, value) for item in items)

    def log_silent(self, now: float, unused: Mapping[str, int]) -> None:
        """Log, once for each input that has become silent, the four commonest things received in its place.

        Args:
            now: Of a steady clock [s].
            unused: What the port could not use, by reason.
        """
        for item in self.take_silent(now):
            counts = Counter({text: n for text, n in self._others[item].items() if text}) + Counter(unused)
            named = ', '.join(f'{text} ({count})' for text, count in counts.most_common(4))
            if other_count := self._others[item]['']:
                named = named or f'other sentences ({other_count})'
            received = (
                f'received instead: {named}' if named else 'nothing received: check the line and the port'
            )
            self.log(f'{item.label}: no valid number for {item.max_silence:g} s; {received}')


@dataclass(slots=True)
class _Alert:
    """One alarm as the displays know it."""

    identifier: int  # of the kind of alarm
    instance: int  # place of the bearing in the file, from 1
    priority: str  # A alarm, W warning, C caution
    title: str
    letter: str = 'N'  # its state: see :func:`_state_letter`
    revision: int = 0  # counts its changes: 1 to 99, then 1 again
    utc: str = ''  # when it changed: hhmmss.ss
    text: str = ''


class Alerts:
    """The alarms as alert sentences, returned without their ends of line.

    Args:
        bearings: Names of the bearings in the order of the file, which numbers them.
        talker: Our talker identifier, two letters.
        manufacturer: Our manufacturer code, three letters; empty for none.
        first_alert: Identifier of the first kind of alarm; the others have the numbers behind it.
        accept_actions: Whether a display may acknowledge and silence.
    """

    def __init__(
        self, bearings: Sequence[str], talker: str, manufacturer: str, first_alert: int, accept_actions: bool
    ) -> None:
        self._talker, self._manufacturer = talker, manufacturer
        self._accept_actions = accept_actions
        names = zip(bearings, shorten_names(bearings), strict=True)
        self._alerts = {
            (name, kind.value): _Alert(
                first_alert + number,
                instance,
                _PRIORITIES[kind.priority],
                f'{_TITLES[kind]} {short}'[:_TITLE].strip(),
            )
            for instance, (name, short) in enumerate(names, 1)
            for number, kind in enumerate(AlarmKind)
        }
        self._sequence = self._list_sequence = self._beat_sequence = 0

    def take_alarms(self, record: dict[str, Any]) -> list[str]:
        """Return ALF sentences for the alarms of a list whose state changed; store their states.

        One that was normal has a second sentence, with its text. Alarms of unknown bearings are left out.
        ``record`` is the list of alarms as it is published.
        """
        times = {(c['bearing'], c['alarm']): c['time'] for c in record['changes']}
        lines = []
        for alarm in record['alarms']:
            key = alarm['bearing'], alarm['alarm']
            alert = self._alerts.get(key)
            if alert is None or (letter := _state_letter(alarm, alert.priority)) == alert.letter:
                continue
            raised = alert.letter == 'N'
            alert.letter, alert.text = letter, _order_text(alarm['text'])
            alert.utc = _format_utc(times.get(key, alarm['changed'] or record['time']))
            alert.revision = alert.revision % 99 + 1
            lines += self._alf_sentences(alert, with_text=raised)
        return lines

    def standing_sentences(self) -> list[str]:
        """Return two ALF sentences, the second with text, for each alert that is not normal.

        Their sequence number is advanced.
        """
        return [
            line for alert in self._standing_alerts() for line in self._alf_sentences(alert, with_text=True)
        ]

    def make_list(self) -> list[str]:
        """Return the ALC sentences of a list of the alerts that are not normal, of three alerts each.

        Without such alerts it is one sentence. The number of the list is advanced.
        """
        entries = [f',{self._alert_id(alert)},{alert.revision}' for alert in self._standing_alerts()]
        # Four entries of the longest kind would not fit into one sentence.
        groups = [entries[i : i + 3] for i in range(0, len(entries), 3)] or [[]]
        total, number = len(groups), self._list_sequence
        self._list_sequence = (number + 1) % 100
        return [
            self._make_sentence(f'ALC,{total:02},{i:02},{number:02},{len(group)}{"".join(group)}')
            for i, group in enumerate(groups, 1)
        ]

    def make_heartbeat(self, period: float, is_present: bool) -> str:
        """Return an HBT sentence, and advance its number, which goes from 0 to 9.

        Args:
            period: Time to the next one [s].
            is_present: Whether the monitor gives data.
        """
        line = self._make_sentence(f'HBT,{period:.1f},{"A" if is_present else "V"},{self._beat_sequence}')
        self._beat_sequence = (self._beat_sequence + 1) % 10
        return line

    def handle_acn(self, line: str, now_ns: int) -> tuple[list[str], ActionRequest | None]:
        """Read an ACN sentence: a display acknowledges, silences, or asks for all alerts.

        No alert changes by it: a request is to be carried out by the caller. ``now_ns`` is the time in UTC
        [ns since 1970].

        Returns:
            The sentences that answer, ARC for a refusal; and the request that it makes, or ``None``. No
            sentence and ``None`` for another sentence, for an ACN to another device, and for one that names
            no alert of ours, Q too.
        """
        parsed = parse_sentence(line)
        if parsed is None or parsed[1] != 'ACN' or len(parsed[2]) != 6:
            return [], None
        _, manufacturer, identifier, instance, command, flag = parsed[2]
        keys = {(f'{a.identifier}', f'{a.instance}'): key for key, a in self._alerts.items()}
        key = keys.get((identifier, instance))
        if key is None or flag != 'C' or manufacturer != self._manufacturer:
            return [], None
        if command == 'Q':
            return self.standing_sentences(), None
        (bearing, kind), alert = key, self._alerts[key]
        action, states = _COMMANDS.get(command, (None, ''))
        # A caution is not acknowledged over this link (IEC 62923-1).
        if alert.priority == 'C' or alert.letter not in states or not self._accept_actions:
            return [self._make_sentence(f'ARC,{_format_utc(now_ns)},{self._alert_id(alert)},{command}')], None
        assert action is not None
        return [], ActionRequest(action, BY, bearing, AlarmKind(kind))

    def _standing_alerts(self) -> list[_Alert]:
        """Return the alerts that are not normal, by bearing and kind, each in its order."""
        return [alert for alert in self._alerts.values() if alert.letter != 'N']

    def _alert_id(self, alert: _Alert) -> str:
        """Return manufacturer, identifier and instance as fields of a sentence."""
        return f'{self._manufacturer},{alert.identifier},{alert.instance}'

    def _alf_sentences(self, alert: _Alert, with_text: bool) -> list[str]:
        """Return the ALF sentence of an alert, and a second one with its text where wanted.

        Their sequence number is advanced; a text too long for the second is cut after a whole word.
        """
        self._sequence = (self._sequence + 1) % 10
        end = f'{self._alert_id(alert)},{alert.revision},0,'
        total = 2 if with_text else 1
        first = f'{alert.utc},B,{alert.priority},{alert.letter},{end}{alert.title}'
        lines = [self._make_sentence(f'ALF,{total},1,{self._sequence},{first}')]
        if with_text:
            start = f'ALF,2,2,{self._sequence},,,,,{end}'
            room = MAX_SENTENCE - len(self._make_sentence(start)) - 2
            lines.append(
                self._make_sentence(start + _truncate_words(clean_display_text(alert.text), min(room, _TEXT)))
            )
        return lines

    def _make_sentence(self, body: str) -> str:
        """Return a whole sentence from our talker, with its checksum."""
        return format_sentence(self._talker + body)


def _order_text(text: str) -> str:
    """Return the order and the operating point in an alarm's text, as ``STAY ABOVE 46 rpm. NOW 47 rpm 1 kN``.

    Of a text without an order what follows the bearing's name, as it is.
    """
    if (order := _ORDER.search(text)) and (words := _ORDERS.get(order[1])):
        return f'{words.format(order[2])}. NOW {order[3]} {order[4]}'
    return text.partition(': ')[2] or text


def shorten_names(bearings: Sequence[str]) -> list[str]:
    """Shorten the names of bearings to five upper-case characters, in whole words where these fit.

    Names that would be alike end in their position in the list, from 1.
    """
    room = _TITLE - max(map(len, _TITLES.values())) - 1
    short = [_truncate_words(clean_display_text(name), room) for name in bearings]
    return [
        name if short.count(name) == 1 else f'{name[: room - len(str(number)) - 1]} {number}'
        for number, name in enumerate(short, 1)
    ]


def _truncate_words(text: str, room: int) -> str:
    """Return the whole words of a text that fit into ``room`` characters, without a dot at the end.

    A text that fits stays as it is; of a first word that is too long the start is returned.
    """
    if len(text) <= room:
        return text
    return text[: text.rfind(' ', 0, room + 1)].rstrip(' .') if ' ' in text[: room + 1] else text[:room]


def clean_display_text(text: str) -> str:
    """Return a text in capitals, with single spaces for all but letters, digits and ``.+-%``.

    A display may lack other characters, or a rule reserves them.
    """
    return ' '.join(_UNFIT.sub(' ', text.upper()).split())


def _state_letter(alarm: dict[str, Any], priority: str) -> str:
    """Return the letter of an alarm's state in ALF: V, S, A, U, or N for normal or covered by a worse alarm.

    A caution (priority ``C``) is never V or U: nobody needs to acknowledge it.
    """
    letter = 'N' if alarm.get('covered') else _LETTERS.get(alarm['state'], 'N')
    if priority == 'C':
        return {'V': 'A', 'U': 'N'}.get(letter, letter)
    return 'S' if letter == 'V' and alarm['silenced'] else letter


def _format_utc(time_ns: int) -> str:
    """Format a time [ns since 1970] as hhmmss.ss in UTC, rounded down."""
    return f'{datetime.fromtimestamp(time_ns / 1e9, timezone.utc):%H%M%S.%f}'[:9]
