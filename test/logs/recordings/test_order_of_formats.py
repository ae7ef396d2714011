# SPDX-License-Identifier: Apache-2.0
"""One voyage with faults of time gives the same values at the same times in every format."""

from __future__ import annotations

import functools
import json
import operator
import sqlite3
import struct
from collections.abc import Callable, Sequence
from datetime import datetime, timezone
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pyarrow as pa
import pytest
from made_logs import HEADER_DEFINITION
from mcap.writer import Writer
from pyarrow import parquet as pq

from stickslip_logs.errors import BagError
from stickslip_logs.recordings.folders import find_bags
from stickslip_logs.recordings.reader import open_bag
from stickslip_logs.recordings.recording import Recording, Request
from stickslip_logs.recordings.writer import encode_float64s

SECOND = 10**9
START = 1_780_000_000 * SECOND
COUNT = 600
BOTH = (0, 1)
Moments = list[tuple[float, int, tuple[int, ...]]]
"""Time that was written [s], the number of the moment, and which of speed and load were written of it."""


FLOATS = '/speed', '/load'
PATHS = 'propulsion.port.revolutions', 'propulsion.port.load'
STAMPED = 'std_msgs/Header header\nfloat64 data\n' + HEADER_DEFINITION


def write_mcap(path: Path, moments: Moments) -> None:
    write_messages(path, moments, 'std_msgs/msg/Float64', 'float64 data\n', encode_plain)


def write_stamped_mcap(path: Path, moments: Moments) -> None:
    rate = -(-(max(number for _, number, _ in moments) + 1) // COUNT)
    write_messages(
        path, moments, 'test_msgs/msg/Stamped', STAMPED, functools.partial(encode_stamped, rate=rate), 1 << 13
    )


def write_messages(
    path: Path,
    moments: Moments,
    kind: str,
    definition: str,
    encode: Callable[[int], bytes],
    chunk_bytes: int = 1 << 20,
) -> None:
    with path.open('wb') as file:
        writer = Writer(file, chunk_size=chunk_bytes)
        writer.start('ros2', 'test')
        schema = writer.register_schema(kind, 'ros2msg', definition.encode())
        channels = [writer.register_channel(name, 'cdr', schema) for name in ('/speed', '/load')]
        for second, number, which in moments:
            for k in which:
                writer.add_message(channels[k], START + round(second * SECOND), encode(number), 0)
        writer.finish()


def encode_plain(number: int) -> bytes:
    return bytes(encode_float64s([number])[0])


def encode_stamped(number: int, rate: int) -> bytes:
    """Encode a number with the stamp at which it happened."""
    second, part = divmod(number, rate)
    nanosecond = part * (SECOND // rate)
    return struct.pack('<4sIIIBxxxd', b'\0\1\0\0', START // SECOND + second, nanosecond, 1, 0, number)


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
            (1 + k, START + round(second * SECOND), encode_float64s([number])[0])
            for second, number, which in moments
            for k in which
        ),
    )
    database.commit()
    database.close()


def write_csv(path: Path, moments: Moments) -> None:
    lines = (
        f'{START // SECOND + second:.3f},{number if 0 in which else ""},{number if 1 in which else ""}\n'
        for second, number, which in moments
    )
    path.write_text('time,/speed,/load\n' + ''.join(lines))


def write_long_csv(path: Path, moments: Moments) -> None:
    lines = (
        f'{START // SECOND + second:.3f},{FLOATS[k]},{number}\n'
        for second, number, which in moments
        for k in which
    )
    path.write_text('time,name,value\n' + ''.join(lines))


def write_parquet(path: Path, moments: Moments) -> None:
    times = pa.array([START + round(second * SECOND) for second, _, _ in moments], pa.timestamp('ns', 'UTC'))
    columns = {
        name: [float(number) if k in which else None for _, number, which in moments]
        for k, name in enumerate(FLOATS)
    }
    pq.write_table(pa.table({'time': times, **columns}), path)


def write_time(second: float) -> str:
    """Return a time as loggers of buses write it."""
    return datetime.fromtimestamp(START // SECOND + second, timezone.utc).strftime('%Y-%m-%dT%H:%M:%S.%fZ')


def write_nmea(path: Path, moments: Moments) -> None:
    lines = []
    for second, number, which in moments:
        for k in which:
            body = (f'IIRPM,S,1,{number},10,A', f'IIXDR,N,{number},N,load')[k]
            checksum = functools.reduce(operator.xor, body.encode())
            lines.append(f'{write_time(second)} ${body}*{checksum:02X}\n')
    path.write_text(''.join(lines))


def write_signalk(path: Path, moments: Moments) -> None:
    deltas = (
        {'updates': [{'timestamp': write_time(second), 'values': [{'path': PATHS[k], 'value': number}]}]}
        for second, number, which in moments
        for k in which
    )
    path.write_text(''.join(f'{json.dumps(delta)}\n' for delta in deltas))


FORMATS: dict[str, tuple[Callable[[Path, Moments], None], tuple[str, str]]] = {
    'a.mcap': (write_mcap, FLOATS),
    'stamped.mcap': (write_stamped_mcap, FLOATS),
    'a.db3': (write_database, FLOATS),
    'a.csv': (write_csv, FLOATS),
    'long.csv': (write_long_csv, FLOATS),
    'a.parquet': (write_parquet, FLOATS),
    'a.nmea': (write_nmea, ('RPM S 1', 'load')),
    'a.jsonl': (write_signalk, PATHS),
}


class Fault(NamedTuple):
    """Written moments, the expected warning, the error of times [s], and the moments of a second."""

    moments: Moments
    says: str = ''
    error: float = 0.0
    rate: int = 1


def change_times(change: Callable[[int], float], which: tuple[int, ...] = BOTH) -> Moments:
    """Return moments whose times are changed, of one input or of both."""
    unchanged = tuple(k for k in BOTH if k not in which)
    return [
        moment
        for k in range(COUNT)
        for moment in (
            [(change(k), k, which)] if which == BOTH else [(k, k, unchanged), (change(k), k, which)]
        )
    ]


def in_file_order(numbers: Sequence[int], rate: int = 1) -> Moments:
    return [(k / rate, k, BOTH) for k in numbers]


EVERY = list(range(COUNT))
SORTED = 'in no order of time: sorted by time'
# Ten moments a second, each up to 2 s late.
DELAYS = np.random.default_rng(1).uniform(0, 20, 10 * COUNT)
LATE_SPEED = [
    *(moment for k in EVERY[:200] for moment in [(k, k, (0,)), (k, k, (1,))]),
    (200, 200, (1,)),
    *((k, k, BOTH) for k in EVERY[201:207]),
    (200, 200, (0,)),
    *((k, k, BOTH) for k in EVERY[207:]),
]
FAULTS = {
    'none': Fault(in_file_order(EVERY)),
    'equal times in pairs': Fault(change_times(lambda k: k - k % 2), error=1.0),
    'back by 3 s': Fault(change_times(lambda k: k - 3 * (k >= 300)), 'was set back once, by 3 s'),
    'back by 200 s': Fault(change_times(lambda k: k - 200 * (k >= 300)), 'was set back once, by 200 s'),
    'back by 1 h': Fault(change_times(lambda k: k - 3600 * (k >= 300)), 'was set back once, by 3600 s'),
    'back by 0.5 s': Fault(change_times(lambda k: k - 0.5 * (k >= 300)), error=0.5),
    'back twice': Fault(change_times(lambda k: k - 200 * (k >= 200) - 200 * (k >= 400)), 'set back 2 times'),
    'an hour ahead': Fault(change_times(lambda k: k + 3600 * (250 <= k < 350)), 'leapt ahead and back'),
    'a moment a year ahead': Fault(
        change_times(lambda k: k + 31_536_000 * (k == 200)), 'leapt ahead and back'
    ),
    'a speed a year ahead': Fault(
        change_times(lambda k: k + 31_536_000 * (k == 200), (0,)), 'leapt ahead and back'
    ),
    'one speed late': Fault(LATE_SPEED),
    'one late': Fault(in_file_order([*EVERY[:200], *EVERY[201:207], 200, *EVERY[207:]])),
    'ten late': Fault(in_file_order([*EVERY[:200], *EVERY[210:216], *EVERY[200:210], *EVERY[216:]])),
    'two late by a row': Fault(in_file_order([*EVERY[:200], 202, 200, 201, *EVERY[203:]])),
    'unordered within 2 s': Fault(in_file_order([k ^ 1 for k in EVERY])),
    'unordered within 2 s, ten a second': Fault(
        in_file_order(np.argsort(np.arange(10 * COUNT) + DELAYS).tolist(), 10), SORTED, rate=10
    ),
    'newest first': Fault(in_file_order(EVERY[::-1]), SORTED),
    'speeds, then loads': Fault([(k, k, (which,)) for which in BOTH for k in EVERY], SORTED),
    'parts reversed': Fault(
        in_file_order([k for begin in range(540, -1, -60) for k in EVERY[begin : begin + 60]]), SORTED
    ),
}


@pytest.mark.parametrize('name', FORMATS)
@pytest.mark.parametrize('fault', FAULTS)
def test_values_are_at_the_times_at_which_they_happened(fault: str, name: str, tmp_path: Path) -> None:
    moments, says, error, rate = FAULTS[fault]
    write, topics = FORMATS[name]
    write(tmp_path / name, moments)
    recording = open_bag(tmp_path / name)
    requests = [Request(topic, 'data') for topic in topics]
    series = recording.read(requests)
    for request in requests:
        np.testing.assert_array_equal(np.sort(series[request].value), np.arange(COUNT * rate))
        assert (np.diff(series[request].log_time_ns) >= 0).all()
        true_ns = START + series[request].value * (SECOND // rate)
        assert np.abs(series[request].log_time_ns - true_ns).max() <= error * SECOND + 1000
        if name == 'stamped.mcap':
            assert (series[request].stamp_ns == true_ns).all()
    notes = ' '.join(recording.warnings)
    # A chunk is sorted as a whole: in which order its two topics were written shows only between chunks.
    assert says in notes or (fault == 'speeds, then loads' and name in ('a.mcap', 'a.db3'))
    assert bool(says) or not any(word in notes for word in ('set back', 'leapt', 'sorted'))
    assert recording.start_ns == START
    end_ns = START + (COUNT * rate - 1) * (SECOND // rate)
    assert recording.end_ns == pytest.approx(end_ns, abs=error * SECOND)


COPIES = {
    'parts that overlap': [*EVERY[:400], *EVERY[300:]],
    'the later part first': [*EVERY[300:], *EVERY[:400]],
    'a part once more': [*EVERY, *EVERY[300:450]],
    # As of a player that starts again.
    'a loop': [*EVERY, *EVERY, *EVERY],
    'a loop entered in the middle': [*EVERY[50:], *EVERY, *EVERY],
}


def check_copies(recording: Recording, topics: Sequence[str]) -> None:
    """Check that values stand at their times, copies too."""
    for series in recording.read([Request(topic, 'data') for topic in topics]).values():
        assert series.value.size > COUNT
        assert {*series.value.tolist()} == {*EVERY}
        assert np.abs(series.log_time_ns - START - series.value * SECOND).max() <= 1000
        assert (np.diff(series.log_time_ns) >= 0).all()
    assert SORTED in ' '.join(recording.warnings)
    assert 'set back' not in ' '.join(recording.warnings)
    assert recording.start_ns == pytest.approx(START, abs=1000)
    assert recording.end_ns == pytest.approx(START + (COUNT - 1) * SECOND, abs=1000)


@pytest.mark.parametrize('name', FORMATS)
@pytest.mark.parametrize('copies', COPIES)
def test_copies_in_one_recording_are_sorted(copies: str, name: str, tmp_path: Path) -> None:
    write, topics = FORMATS[name]
    write(tmp_path / name, in_file_order(COPIES[copies]))
    check_copies(open_bag(tmp_path / name), topics)


SPLITS = {
    'overlap': (EVERY[:400], EVERY[300:]),
    'the later first': (EVERY[300:], EVERY[:400]),
    'one in the other': (EVERY, EVERY[300:450]),
    'the same twice': (EVERY, EVERY),
}


@pytest.mark.parametrize('name', ['a.mcap', 'stamped.mcap', 'a.db3'])
@pytest.mark.parametrize('splits', SPLITS)
def test_files_that_overlap_are_sorted(splits: str, name: str, tmp_path: Path) -> None:
    files = [in_file_order(numbers) for numbers in SPLITS[splits]]
    write, topics = FORMATS[name]
    names = [f'{number}_{name}' for number in range(2)]
    for path, moments in zip(names, files, strict=True):
        write(tmp_path / path, moments)
    information = {
        'storage_identifier': 'mcap' if name.endswith('mcap') else 'sqlite3',
        'relative_file_paths': names,
        'message_count': 2 * sum(map(len, files)),
    }
    (tmp_path / 'metadata.yaml').write_text(json.dumps({'rosbag2_bagfile_information': information}))
    check_copies(open_bag(tmp_path), topics)


def test_other_values_at_times_that_come_again_are_those_of_a_clock_set_back(tmp_path: Path) -> None:
    for name, (write, topics) in FORMATS.items():
        write(tmp_path / name, change_times(lambda k: k - 100 * (k >= 400)))
        recording = open_bag(tmp_path / name)
        recording.read([Request(topic, 'data') for topic in topics])
        assert 'set back once, by 100 s' in ' '.join(recording.warnings)


@pytest.mark.parametrize(('begin', 'is_one'), [(300, False), (400, True)])
@pytest.mark.parametrize('name', ['a.mcap', 'a.db3'])
def test_numbered_files_without_metadata_are_one_recording_if_they_follow_on(
    name: str, begin: int, is_one: bool, tmp_path: Path
) -> None:
    write, topics = FORMATS[name]
    parts = [tmp_path / f'{name[0]}_{number}{name[1:]}' for number in range(2)]
    write(parts[0], in_file_order(EVERY[:400]))
    write(parts[1], in_file_order(EVERY[begin:]))
    assert find_bags([tmp_path]) == ([tmp_path] if is_one else parts)
    if is_one:
        assert (
            open_bag(tmp_path).read([Request(topics[0], 'data')])[Request(topics[0], 'data')].value.size
            == COUNT
        )
    else:
        with pytest.raises(BagError, match='2 recordings that overlap in time'):
            open_bag(tmp_path)
