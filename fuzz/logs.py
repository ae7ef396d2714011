# SPDX-License-Identifier: Apache-2.0
"""Sound tables and databases of rosbag2, and the ways in which only these are damaged."""

from __future__ import annotations

import contextlib
import gzip
import io
import random
import sqlite3
import struct
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

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


def tables() -> list[bytes]:
    """Tables of some dialects, logs of a ship's bus, and Parquet."""
    seconds = [k * STEP / 1e9 for k in range(_COUNT)]
    speeds = [30.0 + 0.01 * k for k in range(_COUNT)]
    rows = list(zip(seconds, speeds, strict=True))
    stamps = [f'2026-05-04T06:00:{second:06.3f}Z' for second in seconds]
    plain = 'time [s],speed [rpm],load [N]\n' + ''.join(f'{t},{v},1000\n' for t, v in rows)
    dated = 'Date;Drehzahl rpm;Last (kN)\n' + ''.join(
        f'{stamp};{v};1,5\n'.replace('.', ',') for stamp, (_, v) in zip(stamps, rows, strict=True)
    )
    long = 'time,name,value,unit\n' + ''.join(
        f'{stamp},speed,{v},rpm\n{stamp},load,1000,N\n' for stamp, (_, v) in zip(stamps, rows, strict=True)
    )
    nmea = ''.join(f'{stamp} $ERRPM,S,1,{v},10.5,A*00\n' for stamp, v in zip(stamps, speeds, strict=True))
    file = io.BytesIO()
    pq.write_table(pa.table({'time': seconds, 'speed [rpm]': speeds}), file)
    texts = [plain, plain.replace(',', '\t'), dated, long, nmea]
    return [
        *(text.encode() for text in texts),
        plain.encode('utf-16'),
        gzip.compress(long.encode(), mtime=0),
        file.getvalue(),
    ]


def databases() -> list[bytes]:
    """Recordings of small and of usual pages."""
    return [_database(page) for page in (512, 4096)]


def _database(page: int) -> bytes:
    with _folder_file() as path:
        _fill(path, page)
        return path.read_bytes()


@contextlib.contextmanager
def _folder_file() -> Iterator[Path]:
    """A file of a folder of its own: in Python 3.10 a database in memory gives no bytes."""
    with tempfile.TemporaryDirectory() as folder:
        yield Path(folder) / 'database'


def _fill(path: Path, page: int) -> None:
    with contextlib.closing(sqlite3.connect(path)) as database:
        database.execute(f'PRAGMA page_size={page}')
        database.executescript(_DATABASE)
        topics = [(k + 1, topic, FLOAT64, 'cdr') for k, topic in enumerate(TOPICS)]
        database.executemany('INSERT INTO topics VALUES (?, ?, ?, ?)', topics)
        definition = FLOAT64, 'ros2msg', 'float64 data\n'
        database.execute('INSERT INTO message_definitions VALUES (?, ?, ?)', definition)
        rows = [
            (k + 1, k % 2 + 1, START + k * STEP, b'\0\1\0\0' + struct.pack('<d', 30.0 + k))
            for k in range(2 * _COUNT)
        ]
        database.executemany('INSERT INTO messages VALUES (?, ?, ?, ?)', rows)
        database.commit()


def change_cell(rng: random.Random, data: bytes, _: Sequence[bytes]) -> bytes:
    """A table with cells or lines changed, dropped, repeated or moved."""
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


def change_value(rng: random.Random, data: bytes, _: Sequence[bytes]) -> bytes:
    """A database with a value changed, rows dropped, or a table gone."""
    table, columns = rng.choice(_COLUMNS)
    column, value, some = rng.choice(columns), rng.choice(_VALUES), rng.choice((1, 2, 7))
    with _folder_file() as path:
        path.write_bytes(data)
        try:
            with contextlib.closing(sqlite3.connect(path)) as database:
                match rng.randrange(8):
                    case 0:
                        database.execute(f'DROP TABLE {table}')
                    case 1:
                        database.execute(f'DELETE FROM {table} WHERE rowid % {some} = 0')
                    case 2:
                        database.execute(f'ALTER TABLE {table} RENAME COLUMN {column} TO odd')
                    case _:
                        database.execute(
                            f'UPDATE OR IGNORE {table} SET {column} = ? WHERE rowid % {some} = 0', (value,)
                        )
                database.commit()
            return path.read_bytes()
        except (sqlite3.Error, ValueError, MemoryError):
            return data
