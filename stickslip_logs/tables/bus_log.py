# SPDX-License-Identifier: Apache-2.0
"""Reads bus logs as rows of one value: NMEA 0183 with times, Signal K deltas, NMEA 2000 of canboat.

A value's name is what a configuration calls it: ``RPM S 1``, the name of a transducer, a path of Signal K, or
``127488.engine.0.Speed``, with the number of a PGN, its instance where it has one, and a field.
"""

from __future__ import annotations

import functools
import itertools
import json
import operator
import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from stickslip_logs.field_paths import signalk_source
from stickslip_logs.tables.cell_times import is_stamp, is_time

_SENTENCE = re.compile(r'[$!]([A-Z0-9]{2})([A-Z0-9]{3}),([^*$!\r\n]*)\*([0-9A-Fa-f]{2})')
_BEGUN = re.compile(r'[$!][A-Z0-9]{5},|^\s*[$!]')  # each sentence, and what is left of a damaged one
_NUMBER = re.compile(r'[+-]?(\d+\.?\d*|\.\d+)', re.ASCII)
_ISO = re.compile(r'\d{4}-\d\d-\d\d[T ]\d\d:\d\d:\d\d(?:[.,]\d+)?(?:Z|[+-]\d\d:?\d\d)?')
_EPOCH = re.compile(r'(?:^|\bc:|[,;\s(\\])(\d{10}(?:\.\d+|\d{3})?)(?=[*;,\s)\\])')
NAMES = 'time', 'name', 'value', 'unit'
SOURCE = len(NAMES)
"""Place of the sender in a row, behind the columns that have a heading."""
Row = tuple[str, str, str, str, str]
"""Time, name, value, unit and sender of a number; of a time alone the others are empty."""
BusRows = Iterator[Row | tuple[()] | None]
"""Rows of a log: None for what is damaged, an empty one for a line of something else."""
ReadBus = Callable[[Iterator[str]], BusRows]
"""Reads the lines of a log as rows."""
_FROM, _NOT_VALID = ' from ', 'not valid'
# Numbers of a name since the last time, over one more than ever came between two: a lost time or two is none.
_MAX_SINCE_CLOCK = 3
NO_SENTENCE: tuple[()] = ()
"""Stands for a line of something else, as another instrument on the same wire sends."""


def bus_log_of(lines: Sequence[str]) -> str:
    """Return the key in :data:`BUS_LOGS` of a log by its first lines; empty for another file.

    More than 40 % of the first 200 lines that are not blank have to be of its kind.
    """
    first = [line for line in lines[:200] if line.strip()]
    if sum(bool(_SENTENCE.search(line)) for line in first) > 0.4 * len(first) > 0:
        return 'nmea'
    marks = {'signalk': '"updates"', 'canboat': '"pgn"'}
    counts = {kind: sum(mark in line for line in first) for kind, mark in marks.items()}
    return next((kind for kind, count in counts.items() if count > 0.4 * len(first) > 0), '')


def _drop_inner_times(read: ReadBus) -> ReadBus:
    """Return a reader without the rows of only a time, but for a first one and one behind all others.

    These tell how long the log lasts: others may go on where a sender falls silent.
    """

    @functools.wraps(read)
    def read_rows(lines: Iterator[str]) -> BusRows:
        is_begun, last = False, None
        for row in read(lines):
            if row and not row[1] and is_begun:
                last = row
                continue
            is_begun, last = is_begun or bool(row), None if row else last
            yield row
        if last:
            yield last

    return read_rows


@_drop_inner_times
def nmea_rows(lines: Iterator[str]) -> BusRows:
    """Yield the numbers of the sentences of a log as rows.

    None for a damaged sentence, for a line with what only begins as one, and for a number without a time, as
    behind a clock that fell silent; an empty row for a line of something else, nothing for a blank line.

    A row with only a time stands for the first and for the last time of the log, if no number has it: others
    may go on where a sender falls silent. Numbers of a second talker are named 'NAME from TALKER'.
    """
    when, has_clock, first = '', False, dict[str, str]()
    # Numbers of each name since the last time, and the most that ever came between two times.
    since, max_count = Counter[str](), 0
    for line in lines:
        end, marks = 0, line.count('$') + line.count('!')
        for match in _SENTENCE.finditer(line):
            # Half a sentence before it has a time of its own.
            head, end, marks = line[end : match.start()].rpartition('$')[2], match.end(), marks - 1
            talker, kind, text, checksum = match.groups()
            total = functools.reduce(operator.xor, f'{talker}{kind},{text}'.encode(), 0)
            if total != int(checksum, 16):
                yield None
                continue
            fields = text.split(',')
            clock = _time_before(head) or ('' if kind == 'RMC' else _own_time(kind, fields))
            has_clock |= clock != ''
            # RMC may be of another receiver, some seconds late, or of a date 1024 weeks ago.
            clock = clock or ('' if has_clock else _own_time(kind, fields))
            if clock and since:
                max_count = max(max_count, *since.values())
                since.clear()
            when = clock or when
            numbers = [*_sentence_numbers(kind, fields)]
            for number, value, unit in numbers:
                name = _name_of(number, talker, first)
                since[name] += 1
                is_timed = when and (not max_count or since[name] <= _MAX_SINCE_CLOCK * (max_count + 1))
                yield (when, name, value, unit, talker) if is_timed else None
            if clock and not numbers:
                yield when, '', '', '', ''
        is_cut = marks > 0 and len(_BEGUN.findall(line)) > len(_SENTENCE.findall(line))
        if is_cut or (not end and line.strip()):
            yield None if is_cut else NO_SENTENCE


def _time_before(head: str) -> str:
    """Return the time that a logger wrote before a sentence, as a text; empty where there is none.

    A stamp, or a time of the day, stays as it is written; milliseconds since 1970 are given as seconds.

    Args:
        head: What stands before the sentence in its line.
    """
    if stamp := _ISO.search(head):
        return stamp.group()
    if epoch := _EPOCH.search(head):
        text = epoch[1]
        return text if len(text) != 13 else f'{text[:10]}.{text[10:]}'
    # Between names of instruments, perhaps: '05/04/2026,06:00:00.123,', 'shaft 2026:124:06:00:00.123 SPD'.
    text = head.strip(' ,;\t[]<>"')
    parts = re.split(r'[\s,;"]+', text)
    pairs = map(' '.join, itertools.pairwise(parts))
    candidates = (text, *pairs, *parts) if any(map(str.isdecimal, text)) else ()
    return next((text for text in candidates if is_stamp(text) or is_time(text)), '')


def _own_time(kind: str, fields: Sequence[str]) -> str:
    """Return the time of a sentence ZDA, or RMC with a fix, as ISO 8601 in UTC; else empty.

    Args:
        kind: Its formatter, as ``'ZDA'``.
        fields: What stands behind that, one field at least.
    """
    clock = fields[0]
    if kind == 'ZDA' and len(fields) > 3:
        date = [field.zfill(2) for field in fields[1:4]]
    # Without a fix it may be of 1980.
    elif kind == 'RMC' and len(fields) > 8 and fields[1] == 'A' and len(fields[8]) == 6:
        date = [fields[8][:2], fields[8][2:4], f'20{fields[8][4:]}']
    else:
        return ''
    if not clock[:6].isdigit() or len(clock) < 6 or not all(part.isdigit() for part in date):
        return ''
    day, month, year = date
    return f'{year}-{month}-{day}T{clock[:2]}:{clock[2:4]}:{clock[4:]}Z'


def _sentence_numbers(kind: str, fields: Sequence[str]) -> Iterator[tuple[str, str, str]]:
    """Yield name, value and unit of each number of a sentence RPM or XDR, as texts; nothing for other kinds.

    An XDR with a unit and of another kind than N, which is force, has both in its name, as 'OIL [P B]', and
    an empty text for a unit. The value may be a word: 'not valid' for an RPM without the status A and for an
    empty field, or a damaged field in quotation marks. Nothing is yielded for an RPM of less than three
    fields, nor for what is left of an XDR behind its last four.

    Args:
        kind: The three letters of the kind, as 'RPM'.
        fields: The fields behind these, without the checksum.
    """
    if kind == 'RPM' and len(fields) > 2:
        # As the live link reads it: some ships leave the pitch out, none the status.
        is_valid = len(fields) > 3 and fields[min(len(fields) - 1, 4)] == 'A'
        number = fields[1].lstrip('0') or fields[1][:1]
        yield f'RPM {fields[0]} {number}', _plain_number(fields[2]) if is_valid else _NOT_VALID, 'rpm'
    elif kind == 'XDR':
        for at in range(0, len(fields) - 3, 4):
            kind, value, unit, name = fields[at : at + 4]
            # A pressure in bar, or volts, is no force whatever it is called: it has a name of its own.
            is_force = kind == 'N' or not unit
            name, unit = (name, unit) if is_force else (f'{name} [{kind} {unit}]', '')
            yield name, _plain_number(value), unit


def _plain_number(text: str) -> str:
    """Return a number without exponent unchanged, 'not valid' for no text, any other in quotation marks."""
    return (text if _NUMBER.fullmatch(text.strip()) else f"'{text}'") if text.strip() else _NOT_VALID


@_drop_inner_times
def signalk_rows(lines: Iterator[str]) -> BusRows:
    """Yield the numbers of deltas of Signal K as rows, one delta a line; None for a line that is no delta.

    Nothing for a blank line and the server's first line. Deltas of other vessels are skipped: the own vessel
    is that of the server's first line, or else the first with more than vessels send by AIS, and any called
    'self'. Numbers of a second source are named 'PATH from SOURCE': a server may forward an engine's gateway
    and a simulation under one path. A last row with only a time stands for deltas without a number, or of
    other vessels, behind the last number: they go on where a sender falls silent.
    """
    own_vessel, first, units = '', dict[str, str](), dict[str, str]()
    latest = ''  # the time of the latest number

    def read_delta(delta: Any) -> list[Row]:
        """Return the rows of a delta: its numbers, or else its times if they are behind the latest number."""
        nonlocal own_vessel, latest
        if 'updates' not in delta and 'self' in delta:  # the server's first word
            own_vessel = delta['self'].removeprefix('vessels.')
            return []
        kind, _, name = delta.get('context', 'self').partition('.')
        context = name if kind == 'vessels' else kind
        if not context:
            raise ValueError('a delta is of somebody')
        if context != 'self' and not own_vessel and kind == 'vessels' and _is_of_own_vessel(delta):
            own_vessel = name
        if context in (own_vessel, 'self') and (rows := _delta_rows(delta, first, units)):
            latest = rows[-1][0]
            return rows
        stamps = [str(update.get('timestamp')) for update in delta['updates']]
        return [(when, '', '', '', '') for when in filter(_ISO.fullmatch, stamps) if when > latest > '']

    return _object_rows(lines, read_delta)


def _object_rows(lines: Iterator[str], read: Callable[[Any], Sequence[Row | tuple[()]]]) -> BusRows:
    """Yield the rows that a function reads from the JSON object of each line; None for a damaged line."""
    for line in lines:
        try:
            message = _decode_object(line)
            rows = [] if message is None else read(message)
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
            yield None
        else:
            yield from rows


def _is_of_own_vessel(delta: Any) -> bool:
    """Return whether a delta has a path that no vessel sends by AIS, so that it is of the own vessel.

    Raises:
        KeyError: The delta is damaged; also TypeError or AttributeError.
    """
    paths = (item['path'] for update in delta['updates'] for item in update.get('values', ()))
    return any(not path.startswith(_BY_AIS) for path in paths if path)


def _decode_object(line: str) -> Any:
    """Return the JSON object of a line, behind any text that a logger wrote before it; None without any.

    The brackets and commas of an array of one object a line are passed over.

    Raises:
        ValueError: There is no object, or something else behind it.
    """
    begin = line.find('{')
    if begin < 0 and not line.strip(_OF_ARRAY):
        return None
    value, end = _decode_json(line, begin)
    if line[end:].strip(_OF_ARRAY):
        raise ValueError('more than an object')
    return value


def _delta_rows(delta: Any, first: dict[str, str], units: dict[str, str]) -> list[Row]:
    """Return the numbers of a delta as rows, null as 'null'.

    Texts, booleans and objects are skipped, but where the path had numbers before.

    Args:
        delta: The delta.
        first: The first source of each path, to which new ones are added. Numbers of a later source are named
            'PATH from SOURCE'.
        units: The units of paths by their meta data, to which new ones are added; some paths need none.

    Raises:
        TypeError: A time is no text; other errors where the delta is damaged.
    """
    rows: list[Row] = []
    for update in delta['updates']:
        if 'meta' in update:
            units.update(_meta_units(update['meta']))
        source = signalk_source(update)
        for item in update.get('values', ()):
            value, path = item['value'], item['path']
            if path and (value is None or type(value) in _NUMBERS or path in first):
                when = update['timestamp']
                if not isinstance(when, str):
                    raise TypeError('a time is a text')
                unit = units.get(path) or _UNITS.get(path.rpartition('.')[2], '')
                rows.append((when, _name_of(path, source, first), _value_text(value), unit, source))
    return rows


def _meta_units(meta: Any) -> Iterator[tuple[str, str]]:
    """Yield path and unit of each item of the meta data of a delta; damaged items, or data, are skipped."""
    for item in meta if isinstance(meta, list) else ():
        match item:
            case {'path': str(path), 'value': {'units': str(unit)}}:
                yield path, unit


@_drop_inner_times
def canboat_rows(lines: Iterator[str]) -> BusRows:
    """Yield the numbers of messages as canboat's ``analyzer -json`` writes them, as rows.

    None for a damaged line, an empty row for a line without a message, nothing for a blank line. Fields that
    are no numbers are skipped, but where the field had numbers before. Numbers of a second source of a name
    are named 'NAME from SOURCE'. A last row with only a time stands for messages behind the last of these:
    others go on where a sender falls silent.
    """
    first = dict[str, str]()

    def read_message(message: Any) -> list[Row | tuple[()]]:
        """Return the rows of a message: its numbers, or else its time if any came before."""
        if 'pgn' not in message:  # canboat's first line says its version
            return [NO_SENTENCE]
        fields = message.get('fields', {})
        fields |= {name: value.get('value') for name, value in fields.items() if isinstance(value, dict)}
        place, when = [str(message['pgn'])], message['timestamp']
        if not isinstance(when, str):
            raise TypeError('a time is a text')
        place += ['engine'] if place[0] in _OF_ENGINES else []
        # 'Engine Instance', or 'engineInstance' by the option -camel.
        of = [name for name in fields if name.lower().replace(' ', '') in ('instance', 'engineinstance')]
        instance = fields.pop(of[0]) if of else None
        place += [] if instance is None else [str(_ENGINES.get(instance, instance))]
        source, rows = str(message.get('src', '')), list[Row | tuple[()]]()
        for name, value in fields.items():
            path = '.'.join((*place, name))
            if type(value) in _NUMBERS or path in first:
                unit = 'rpm' if (place[0], name.title()) == ('127488', 'Speed') else ''
                rows.append((when, _name_of(path, source, first), _value_text(value), unit, source))
        return rows or ([(when, '', '', '', '')] if first else [])

    return _object_rows(lines, read_message)


def _value_text(value: Any) -> str:
    """Return a value of JSON as a text: a number as Python writes it, null as 'null', another one quoted."""
    return 'null' if value is None else repr(value) if type(value) in _NUMBERS else f"'{value}'"


def _name_of(name: str, source: str, first: dict[str, str]) -> str:
    """Return the name under which numbers of a source are delivered: of a later source 'NAME from SOURCE'.

    Args:
        name: The name of the number.
        source: The source that sent it.
        first: The first source of each name, to which that of a new name is added.
    """
    return name if first.setdefault(name, source) == source else f'{name}{_FROM}{source}'


def name_of_first_source(name: str) -> str:
    """Return the name that the first source has, for a name of a later source; an empty text for any other.

    >>> name_of_first_source('RPM S 1 from ER'), name_of_first_source('RPM S 1')
    ('RPM S 1', '')
    """
    return name.rpartition(_FROM)[0]


# Paths, or beginnings of them, that vessels send by AIS.
_BY_AIS = 'navigation.', 'design.', 'communication.', 'registrations', 'sensors.ais', 'name', 'mmsi'
# Calls without what json.loads adds to each; a truth value is of neither type.
_decode_json = json.JSONDecoder().raw_decode
_NUMBERS = int, float
_OF_ARRAY = ' \t\r\n[],'
# What Signal K gives the values of some paths in.
_UNITS = {'revolutions': 'Hz', 'load': 'N', 'force': 'N'}
# PGNs of engines, and what canboat calls the first two of these.
_OF_ENGINES = '127488', '127489'
_ENGINES = {'Single Engine or Dual Engine Port': 0, 'Dual Engine Starboard': 1}
BUS_LOGS: Mapping[str, ReadBus] = {'nmea': nmea_rows, 'signalk': signalk_rows, 'canboat': canboat_rows}
