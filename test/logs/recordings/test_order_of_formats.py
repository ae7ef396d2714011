# SPDX-License-Identifier: Apache-2.0
"""One voyage with faults of time gives the same values at the same times in every format."""

from __future__ import annotations

import functools
import json
import operator
import sqlite3
import struct
from collections.abc import Callable
from datetime import datetime, timezone
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from made_logs import HEADER_DEFINITION
from mcap.writer import Writer
from pyarrow import parquet as pq

from stickslip_logs.recordings.reader import open_bag
from stickslip_logs.recordings.recording import Request
from stickslip_logs.recordings.writer import encode_float64s

SECOND = 10**9
START = 1_780_000_000 * SECOND
COUNT = 600
Moments = list[tuple[float, int]]
"""Time that was written [s], and the number of the moment, which is its true time [s]."""


STAMPED = 'std_msgs/Header header\nfloat64 data\n' + HEADER_DEFINITION


def write_mcap(path: Path, moments: Moments) -> None:
    write_messages(path, moments, 'std_msgs/msg/Float64', 'float64 data\n', plain)


def write_stamped_mcap(path: Path, moments: Moments) -> None:
    write_messages(path, moments, 'test_msgs/msg/Stamped', STAMPED, stamped)


def write_messages(
    path: Path, moments: Moments, kind: str, definition: str, encode: Callable[[int], bytes]
) -> None:
    with path.open('wb') as file:
        writer = Writer(file)
        writer.start('ros2', 'test')
        schema = writer.register_schema(kind, 'ros2msg', definition.encode())
        channels = [writer.register_channel(name, 'cdr', schema) for name in ('/speed', '/load')]
        for second, number in moments:
            for channel in channels:
                writer.add_message(channel, START + int(second * SECOND), encode(number), 0)
        writer.finish()


def plain(number: int) -> bytes:
    return bytes(encode_float64s([number])[0])


def stamped(number: int) -> bytes:
    """Encode a number with the stamp at which it happened."""
    return struct.pack('<4sIIIBxxxd', b'\0\1\0\0', START // SECOND + number, 0, 1, 0, number)


def write_database(path: Path, moments: Moments) -> None:
    database = sqlite3.connect(path)
    database.executescript(
        'CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT,'
        ' offered_qos_profiles TEXT);'
        'CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB);'
        "INSERT INTO topics VALUES(1, '/speed', 'std_msgs/msg/Float64', 'cdr', '');"
        "INSERT INTO topics VALUES(2, '/load', 'std_msgs/msg/Float64', 'cdr', '');"
    )
    database.executemany(
        'INSERT INTO messages(topic_id, timestamp, data) VALUES(?, ?, ?)',
        (
            (topic, START + int(second * SECOND), encode_float64s([number])[0])
            for second, number in moments
            for topic in (1, 2)
        ),
    )
    database.commit()
    database.close()


def write_csv(path: Path, moments: Moments) -> None:
    lines = (f'{START // SECOND + second:.3f},{number},{number}\n' for second, number in moments)
    path.write_text('time,/speed,/load\n' + ''.join(lines))


def write_long_csv(path: Path, moments: Moments) -> None:
    lines = (
        f'{START // SECOND + second:.3f},{name},{number}\n'
        for second, number in moments
        for name in ('/speed', '/load')
    )
    path.write_text('time,name,value\n' + ''.join(lines))


def write_parquet(path: Path, moments: Moments) -> None:
    times = pa.array([START + int(second * SECOND) for second, _ in moments], pa.timestamp('ns', 'UTC'))
    numbers = [float(number) for _, number in moments]
    pq.write_table(pa.table({'time': times, '/speed': numbers, '/load': numbers}), path)


def written(second: float) -> str:
    """Return a time as loggers of buses write it."""
    return datetime.fromtimestamp(START // SECOND + second, timezone.utc).strftime('%Y-%m-%dT%H:%M:%S.%fZ')


def write_nmea(path: Path, moments: Moments) -> None:
    lines = []
    for second, number in moments:
        for body in (f'IIRPM,S,1,{number},10,A', f'IIXDR,N,{number},N,load'):
            checksum = functools.reduce(operator.xor, body.encode())
            lines.append(f'{written(second)} ${body}*{checksum:02X}\n')
    path.write_text(''.join(lines))


def write_signalk(path: Path, moments: Moments) -> None:
    deltas = (
        {'updates': [{'timestamp': written(second), 'values': [{'path': name, 'value': number}]}]}
        for second, number in moments
        for name in ('propulsion.port.revolutions', 'propulsion.port.load')
    )
    path.write_text(''.join(f'{json.dumps(delta)}\n' for delta in deltas))


FLOATS = '/speed', '/load'
FORMATS: dict[str, tuple[Callable[[Path, Moments], None], tuple[str, str]]] = {
    'a.mcap': (write_mcap, FLOATS),
    'stamped.mcap': (write_stamped_mcap, FLOATS),
    'a.db3': (write_database, FLOATS),
    'a.csv': (write_csv, FLOATS),
    'long.csv': (write_long_csv, FLOATS),
    'a.parquet': (write_parquet, FLOATS),
    'a.nmea': (write_nmea, ('RPM S 1', 'load')),
    'a.jsonl': (write_signalk, ('propulsion.port.revolutions', 'propulsion.port.load')),
}


def clock(change: Callable[[int], float]) -> Moments:
    return [(change(k), k) for k in range(COUNT)]


def order(numbers: list[int]) -> Moments:
    return [(float(k), k) for k in numbers]


EVERY = list(range(COUNT))
FAULTS: dict[str, tuple[Moments, str, float]] = {
    'none': (order(EVERY), '', 0.0),
    'back by 3 s': (clock(lambda k: k - 3 * (k >= 300)), 'was set back once, by 3 s', 0.0),
    'back by 200 s': (clock(lambda k: k - 200 * (k >= 300)), 'was set back once, by 200 s', 0.0),
    'back by 1 h': (clock(lambda k: k - 3600 * (k >= 300)), 'was set back once, by 3600 s', 0.0),
    'back by 0.5 s': (clock(lambda k: k - 0.5 * (k >= 300)), '', 0.5),
    'back twice': (clock(lambda k: k - 200 * (k >= 200) - 200 * (k >= 400)), 'set back 2 times', 0.0),
    'an hour ahead': (clock(lambda k: k + 3600 * (250 <= k < 350)), 'leapt ahead and back', 0.0),
    'a year ahead': (clock(lambda k: k + 31_536_000 * (k == 200)), 'leapt ahead and back', 0.0),
    'one late': (order([*EVERY[:200], *EVERY[201:207], 200, *EVERY[207:]]), '', 0.0),
    'ten late': (order([*EVERY[:200], *EVERY[210:216], *EVERY[200:210], *EVERY[216:]]), '', 0.0),
    'two late by a row': (order([*EVERY[:200], 202, 200, 201, *EVERY[203:]]), '', 0.0),
    'unordered within 2 s': (order([k ^ 1 for k in EVERY]), '', 0.0),
    'newest first': (order(EVERY[::-1]), 'in no order of time: sorted by time', 0.0),
    'parts reversed': (
        order([k for begin in range(540, -1, -60) for k in EVERY[begin : begin + 60]]),
        'in no order of time: sorted by time',
        0.0,
    ),
}


@pytest.mark.parametrize('name', FORMATS)
@pytest.mark.parametrize('fault', FAULTS)
def test_values_are_at_the_times_at_which_they_happened(fault: str, name: str, tmp_path: Path) -> None:
    moments, says, error = FAULTS[fault]
    write, topics = FORMATS[name]
    write(tmp_path / name, moments)
    recording = open_bag(tmp_path / name)
    requests = [Request(topic, 'data') for topic in topics]
    found = recording.read(requests)
    for request in requests:
        np.testing.assert_array_equal(np.sort(found[request].value), EVERY)
        true_ns = START + found[request].value * SECOND
        assert np.abs(found[request].log_time_ns - true_ns).max() <= error * SECOND + 1000
        if name == 'stamped.mcap':
            assert (found[request].stamp_ns == true_ns).all()
    told = ' '.join(recording.warnings)
    assert says in told
    assert bool(says) or not any(word in told for word in ('set back', 'leapt', 'sorted'))
    assert recording.start_ns == START
    assert recording.end_ns == pytest.approx(START + (COUNT - 1) * SECOND, abs=error * SECOND)
