# SPDX-License-Identifier: Apache-2.0
"""Sound databases of rosbag2, and how only these, tables, sentences and deltas are damaged."""

from __future__ import annotations

import contextlib
import functools
import gzip
import json
import operator
import random
import re
import sqlite3
import struct
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from fuzz.files import FLOAT64, START, STEP, TOPICS

_COUNT = 60
_CELLS = (
    '',
    '-',
    '0',
    '-1',
    '1e308',
    '1e999',
    'nan',
    '-inf',
    '9' * 400,
    '1,5',
    '1.234,5',
    '0x1F',
    '1_000',
    '٣',
    '"',
    '"open',
    "'",
    '#',
    '\0',
    '\r',
    '\n',
    ';',
    ',',
    '\t',
    '2026-05-04T06:00:00Z',
    '2026-13-45 25:61:61',
    '0001-01-01 00:00:00',
    '9999-12-31T23:59:59+14:00',
    '24:00:00',
    '06:00:00',
    '1777874400',
    '1e17',
    '45000.5',
    'rpm',
    'Time [s]',
    'Load [kN]',
    'é' * 99,
)
_VALUES = (
    None,
    0,
    -1,
    1,
    (1 << 63) - 1,
    -(1 << 63),
    1.5,
    float('inf'),
    '',
    'cdr',
    'x' * 999,
    b'',
    b'\0\1\0\0',
    bytes(12),
    b'\xff' * 40,
    TOPICS[0],
    FLOAT64,
    'a/msg/B',
    'ros2idl',
)
_DATABASE = """
CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT);
CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id, timestamp, data BLOB);
CREATE TABLE message_definitions(topic_type, encoding, encoded_message_definition);
CREATE INDEX timestamp_idx ON messages (timestamp ASC);
"""
_COLUMNS = (
    ('topics', ('id', 'name', 'type', 'serialization_format')),
    ('messages', ('id', 'topic_id', 'timestamp', 'data')),
    ('message_definitions', ('topic_type', 'encoding', 'encoded_message_definition')),
)


def sentence_of(body: str) -> str:
    """Return a sentence of NMEA 0183 with its checksum."""
    return f'${body}*{functools.reduce(operator.xor, body.encode(), 0):02X}'


def databases() -> list[bytes]:
    """Return recordings of small and of usual pages."""
    rows = [(START + k * STEP, k % 2 + 1, 30.0 + k) for k in range(2 * _COUNT)]
    return [database_of(page, rows) for page in (512, 4096)]


def database_of(page: int, rows: Sequence[tuple[int, int, float]]) -> bytes:
    """Return a recording of pages of that size: log times [ns], numbers of topics from 1 on, and values."""
    with _folder_file() as path:
        _fill_database(path, page, rows)
        return path.read_bytes()


@contextlib.contextmanager
def _folder_file() -> Iterator[Path]:
    """Return a file of a folder of its own: in Python 3.10 a database in memory gives no bytes."""
    with tempfile.TemporaryDirectory() as folder:
        yield Path(folder) / 'database'


def _fill_database(path: Path, page: int, rows: Sequence[tuple[int, int, float]]) -> None:
    with contextlib.closing(sqlite3.connect(path)) as database:
        database.execute(f'PRAGMA page_size={page}')
        database.executescript(_DATABASE)
        topics = [(k + 1, topic, FLOAT64, 'cdr') for k, topic in enumerate(TOPICS)]
        database.executemany('INSERT INTO topics VALUES (?, ?, ?, ?)', topics)
        definition = FLOAT64, 'ros2msg', 'float64 data\n'
        database.execute('INSERT INTO message_definitions VALUES (?, ?, ?)', definition)
        messages = [
            (k + 1, topic, time_ns, b'\0\1\0\0' + struct.pack('<d', value))
            for k, (time_ns, topic, value) in enumerate(rows)
        ]
        database.executemany('INSERT INTO messages VALUES (?, ?, ?, ?)', messages)
        database.commit()


def change_cell(rng: random.Random, data: bytes, _: Sequence[bytes]) -> bytes:
    """Return a table with cells or lines changed, dropped, repeated or moved."""
    packed = data.startswith(b'\x1f\x8b')
    with contextlib.suppress(Exception):  # A mutant of a mutant may be anything.
        data = gzip.decompress(data) if packed else data
    lines = data.split(b'\n')
    for _ in range(rng.choice((1, 1, 3, 30))):
        i, j = rng.randrange(len(lines)), rng.randrange(len(lines))
        mark = rng.choice((b',', b';', b'\t', b' '))
        cells = lines[i].split(mark)
        cells[rng.randrange(len(cells))] = rng.choice(_CELLS).encode()
        lines[i] = rng.choice((lines[j], mark.join(cells), mark.join(cells)))
    data = b'\n'.join(lines[rng.choice((0, 0, 0, 1, 5)) :])
    return gzip.compress(data, mtime=0) if packed else data


def change_sentence(rng: random.Random, data: bytes, sources: Sequence[bytes]) -> bytes:
    """Return a log of NMEA 0183 with fields changed, and as a rule the checksum mended."""
    lines = change_cell(rng, data, sources).decode('latin-1').split('\n')
    for k in range(len(lines)):
        if rng.random() < 0.9:
            lines[k] = re.sub(r'\$(.*?)\*..', lambda m: sentence_of(m[1]), lines[k])
    return '\n'.join(lines).encode('latin-1')


def change_delta(rng: random.Random, data: bytes, sources: Sequence[bytes]) -> bytes:
    """Return a log of Signal K with members of deltas changed, dropped or moved."""
    lines = data.split(b'\n')
    for _ in range(rng.choice((1, 1, 3, 30))):
        k = rng.randrange(len(lines))
        with contextlib.suppress(Exception):  # A mutant of a mutant may be anything.
            head, _, text = lines[k].partition(b'{')
            delta = json.loads(b'{' + text)
            _change_member(rng, delta)
            lines[k] = head + json.dumps(delta).encode()
    return b'\n'.join(lines)


def _change_member(rng: random.Random, delta: Any) -> None:
    places = [delta]
    for place in places:
        inner = place.values() if isinstance(place, dict) else place
        places += [member for member in inner if isinstance(member, dict | list)]
    place = rng.choice(places)
    key = rng.choice(list(place)) if isinstance(place, dict) else rng.randrange(len(place))
    odd_values = (None, True, 1e308, -1, 1 << 70, 'x', '', [], {}, [[]], 'revolutions', *_CELLS)
    match rng.randrange(4):
        case 0:
            del place[key]
        case 1:
            place[key] = rng.choice(places[:1] if place is not delta else [[]])
        case _:
            place[key] = rng.choice(odd_values)


def change_value(rng: random.Random, data: bytes, _: Sequence[bytes]) -> bytes:
    """Return a database with a value changed, rows dropped, or a table gone."""
    table, columns = rng.choice(_COLUMNS)
    column, value, divisor = rng.choice(columns), rng.choice(_VALUES), rng.choice((1, 2, 7))
    with _folder_file() as path:
        path.write_bytes(data)
        try:
            with contextlib.closing(sqlite3.connect(path)) as database:
                match rng.randrange(8):
                    case 0:
                        database.execute(f'DROP TABLE {table}')
                    case 1:
                        database.execute(f'DELETE FROM {table} WHERE rowid % {divisor} = 0')
                    case 2:
                        database.execute(f'ALTER TABLE {table} RENAME COLUMN {column} TO odd')
                    case _:
                        database.execute(
                            f'UPDATE OR IGNORE {table} SET {column} = ? WHERE rowid % {divisor} = 0', (value,)
                        )
                database.commit()
            return path.read_bytes()
        except (sqlite3.Error, ValueError, MemoryError):
            return data
