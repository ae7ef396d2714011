# SPDX-License-Identifier: Apache-2.0
"""Recordings of SQLite, written by rosbags, and judged by what was put in."""

from __future__ import annotations

import contextlib
import hashlib
import re
import sqlite3
import struct
import subprocess
import sys
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
import zstandard
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from stickslip_logs.errors import BagError
from stickslip_logs.recordings.bag_recording import BagRecording
from stickslip_logs.recordings.folders import find_bags
from stickslip_logs.recordings.reader import open_bag
from stickslip_logs.recordings.recording import Findings, Request, Scratch
from stickslip_logs.recordings.sqlite_file import SqliteFile

STORE = get_typestore(Stores.ROS2_HUMBLE)
START = 1_776_074_400 * 10**9
COUNT = 2500
SPEED = Request('/shaft/speed', 'data')
LOAD = Request('/load', 'wrench.force.z')


def make_database(path: Path, version: int = 8, mode: CompressionMode = CompressionMode.NONE) -> Path:
    """Speeds n at n / 100 s, and loads -n with stamps of half a second before."""
    types = STORE.types
    header, stamp = types['std_msgs/msg/Header'], types['builtin_interfaces/msg/Time']
    vector, wrench = types['geometry_msgs/msg/Vector3'], types['geometry_msgs/msg/Wrench']
    writer = Writer(path, version=version, storage_plugin=StoragePlugin.SQLITE3)  # type: ignore[arg-type]
    writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        speed = writer.add_connection('/shaft/speed', 'std_msgs/msg/Float64', typestore=STORE)
        load = writer.add_connection('/load', 'geometry_msgs/msg/WrenchStamped', typestore=STORE)
        for n in range(COUNT):
            time = START + n * 10_000_000
            number = types['std_msgs/msg/Float64'](float(n))
            writer.write(speed, time, STORE.serialize_cdr(number, 'std_msgs/msg/Float64'))
            earlier = time - 500_000_000
            stamped = header(stamp(earlier // 10**9, earlier % 10**9), 'load')
            zero = vector(0.0, 0.0, 0.0)
            message = types['geometry_msgs/msg/WrenchStamped'](
                stamped, wrench(vector(0.0, 0.0, -float(n)), zero)
            )
            data = STORE.serialize_cdr(message, 'geometry_msgs/msg/WrenchStamped')
            writer.write(load, time, data)
    return path


def change_database(folder: Path, *changes: str, version: int = 8) -> Path:
    """Change the database of a folder by SQL; return its file, without metadata."""
    (file,) = make_database(folder / 'bag', version).glob('*.db3')
    with contextlib.closing(sqlite3.connect(file)) as database:
        for change in changes:
            database.execute(change)
        database.commit()
    (folder / 'bag/metadata.yaml').unlink()
    return file


def assert_read_whole(path: Path, count: int = COUNT) -> None:
    recording = open_bag(path)
    series_by_request = recording.read([SPEED, LOAD])
    times = START + np.arange(count) * 10_000_000
    for request, sign, earlier in ((SPEED, 1, 0), (LOAD, -1, 500_000_000)):
        series = series_by_request[request]
        np.testing.assert_array_equal(series.log_time_ns, times)
        np.testing.assert_array_equal(series.stamp_ns, times - earlier)
        np.testing.assert_array_equal(series.value, sign * np.arange(float(count)))
        assert series.faults == ()
    assert recording.message_count == 2 * count
    assert (recording.start_ns, recording.end_ns) == (times[0], times[-1])
    assert recording.losses == ()


@pytest.mark.parametrize('version', [8, 9])
@pytest.mark.parametrize('mode', [CompressionMode.NONE, CompressionMode.FILE, CompressionMode.MESSAGE])
def test_every_number_of_a_folder(tmp_path: Path, version: int, mode: CompressionMode) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter('ignore')
        assert_read_whole(make_database(tmp_path / 'bag', version, mode))


@pytest.mark.parametrize(
    'change',
    [
        'UPDATE messages SET id = -9223372036854775808 WHERE id = 1',
        'ALTER TABLE messages RENAME COLUMN id TO other',
    ],
)
def test_messages_are_read_by_the_number_of_their_row(tmp_path: Path, change: str) -> None:
    assert_read_whole(change_database(tmp_path, change))


def test_a_file_without_its_metadata(tmp_path: Path) -> None:
    file = change_database(tmp_path)
    assert_read_whole(file)
    assert find_bags([tmp_path]) == [file] or find_bags([tmp_path]) == [tmp_path / 'bag']


@pytest.mark.parametrize('text', ['', 'rosbag2_bagfile_information: 3'])
def test_packed_messages_are_known_without_metadata(text: str, tmp_path: Path) -> None:
    """Damage the page of the first row, so that the last one tells."""
    with warnings.catch_warnings():
        warnings.simplefilter('ignore')
        folder = make_database(tmp_path / 'bag', mode=CompressionMode.MESSAGE)
    (folder / 'metadata.yaml').write_text(text)
    assert_read_whole(folder)
    (file,) = folder.glob('*.db3')
    data = bytearray(file.read_bytes())
    leaves = [page for page in range(0, len(data), 4096) if data[page] == 0x0D]
    page = next(page for page in leaves if b'\x28\xb5\x2f\xfd' in data[page : page + 4096])
    data[page : page + 4096] = bytes(4096)
    file.write_bytes(data)
    assert open_bag(file).read([SPEED])[SPEED].value[-1] == COUNT - 1


def test_nothing_is_written_to_the_folder(tmp_path: Path) -> None:
    (file,) = make_database(tmp_path / 'bag').glob('*.db3')

    def state() -> list[tuple[str, str, int]]:
        return [
            (p.name, hashlib.sha256(p.read_bytes()).hexdigest(), p.stat().st_mtime_ns)
            for p in sorted(file.parent.iterdir())
        ]

    # As a recorder that lost power leaves it: the last messages are in the journal only.
    with sqlite3.connect(file) as database:
        database.execute('PRAGMA journal_mode=WAL')
        database.execute('PRAGMA wal_autocheckpoint=0')
        database.execute('DELETE FROM messages WHERE id > 4000')
        database.commit()
        copies = {p.name: p.read_bytes() for p in file.parent.iterdir()}
    database.close()
    for name, data in copies.items():
        (file.parent / name).write_bytes(data)
    (file.parent / 'metadata.yaml').unlink()
    files_before = state()
    assert_read_whole(file, 2000)
    assert state() == files_before


def test_a_damaged_page_costs_its_messages_only(tmp_path: Path) -> None:
    file = change_database(tmp_path)
    data = bytearray(file.read_bytes())
    # A leaf of a table, by its first byte.
    pages = range(0, len(data), 4096)
    middle = [page for page in pages if data[page] == 0x0D][len(pages) // 4]
    data[middle : middle + 4096] = bytes(4096)
    file.write_bytes(data)
    recording = open_bag(file)
    series = recording.read([SPEED])[SPEED]
    assert COUNT * 0.9 < series.value.size < COUNT
    np.testing.assert_array_equal(series.log_time_ns, START + series.value.astype(np.int64) * 10_000_000)
    assert 'is damaged' in ' '.join(recording.losses)


def test_reading_goes_on_behind_every_damaged_page(tmp_path: Path) -> None:
    file = change_database(tmp_path)
    data = bytearray(file.read_bytes())
    leaves = [page for page in range(0, len(data), 4096) if data[page] == 0x0D and page > 4 * 4096]
    for page in leaves[2::3]:
        data[page : page + 4096] = bytes(4096)
    file.write_bytes(data)
    recording = open_bag(file)
    series = recording.read([SPEED])[SPEED]
    assert np.histogram(series.value, 10, (0, COUNT))[0].all()
    np.testing.assert_array_equal(series.log_time_ns, START + series.value.astype(np.int64) * 10_000_000)


@pytest.mark.parametrize('share', [0.3, 0.6])
@pytest.mark.parametrize('damaged', [b'\x80\0', b'\xff\x7f'])
def test_rows_whose_ids_do_not_rise_are_read_once(
    share: float, damaged: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr('stickslip_logs.recordings.sqlite_file._BATCH', COUNT)
    file = change_database(tmp_path)
    assert_read_whole(file)
    data = bytearray(file.read_bytes())
    # Before the head of its row: no id of its own, a topic, and a time of 8 bytes.
    row = int(share * 2 * COUNT)
    id_bytes = bytes((0x80 | row >> 7, row & 0x7F))
    (match,) = re.finditer(re.escape(id_bytes) + rb'[\5\6]\0[\1\x09]\x06', data)
    data[match.start() : match.start() + 2] = damaged
    file.write_bytes(data)
    assert_read_whole(file)
    assert 'its row ids do not rise' in ' '.join(open_bag(file).warnings)


@pytest.mark.parametrize(('row_id', 'changed_id'), [(1000, b'\xff\x7f'), (4000, b'\x80\x05')])
def test_a_damaged_row_id_costs_no_messages_of_others(row_id: int, changed_id: bytes, tmp_path: Path) -> None:
    """Behind damage reading goes on behind the ids that rise: neither behind 16383 nor from 5 on again."""
    file = change_database(tmp_path)
    data = bytearray(file.read_bytes())
    leaves = [page for page in range(0, len(data), 4096) if data[page] == 0x0D]
    # Between the length of a row, of one byte, and of its head.
    row = data.index(bytes((0x80 | row_id >> 7, row_id & 0x7F, 6)), leaves[0])
    data[row : row + 2] = changed_id
    for zeros in (leaves[len(leaves) // 3], leaves[2 * len(leaves) // 3]):
        data[zeros : zeros + 4096] = bytes(4096)
    file.write_bytes(data)
    recording = open_bag(file)
    series_by_request = recording.read([SPEED, LOAD])
    series = series_by_request[SPEED]
    assert np.unique(series.value).size == series.value.size > COUNT * 0.9
    assert series.value.max() == COUNT - 1
    assert recording.message_count == series.value.size + series_by_request[LOAD].value.size
    np.testing.assert_array_equal(series.log_time_ns, START + series.value.astype(np.int64) * 10_000_000)
    assert 'is damaged' in ' '.join(recording.losses)


@pytest.mark.parametrize('ending', ['-wal', ''])
def test_a_copy_that_cannot_be_made_is_named(
    ending: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Give the file a journal, or row 100 the id 5."""
    file = change_database(tmp_path, 'DELETE FROM messages WHERE id > 200')
    data = bytearray(file.read_bytes())
    row = next(re.finditer(rb'\x64[\5\6]\0[\1\x09]\x06', data)).start()
    data[row] = data[row] if ending else 5
    file.write_bytes(data)
    if ending:
        file.with_name(f'{file.name}{ending}').write_bytes(bytes(32))
    monkeypatch.setattr('tempfile.tempdir', str(tmp_path / 'gone'))
    with pytest.raises(BagError, match='cannot be read: '):
        open_bag(file)


def test_the_judge_of_times_reads_no_data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Beyond the first 1000 messages times are read again, and the times alone."""
    monkeypatch.setattr('stickslip_logs.recordings.sqlite_file._MAX_KEPT', 1000)
    monkeypatch.setattr('stickslip_logs.recordings.sqlite_file._BATCH', 900)
    file = change_database(tmp_path)
    recording = cast('BagRecording', open_bag(file))
    columns: list[str] = []
    read = SqliteFile._iterate_rows

    def note_columns(file: SqliteFile, database: sqlite3.Connection, names: str, *args: Any) -> Any:
        columns.append(names)
        return read(file, database, names, *args)

    monkeypatch.setattr(SqliteFile, '_iterate_rows', note_columns)
    recording.judge_order(['/shaft/speed', '/load'])
    assert columns == ["timestamp, topic_id, x''"] * 5
    with contextlib.closing(sqlite3.connect(file)) as database:
        database.execute('UPDATE messages SET timestamp = timestamp - 8000000000 WHERE id > 2000')
        database.commit()
    series = open_bag(file).read([SPEED])[SPEED]
    np.testing.assert_array_equal(series.value, np.arange(float(COUNT)))
    np.testing.assert_array_equal(np.diff(series.log_time_ns), 10_000_000)


READ_PICTURES = """
import resource, sys
from stickslip_logs.recordings.reader import open_bag
from stickslip_logs.recordings.recording import Request

resource.setrlimit(resource.RLIMIT_AS, (1_500_000_000, 1_500_000_000))
request = Request('/camera', 'height')
recording = open_bag(sys.argv[1])
print(recording.read([request])[request].value.tolist(), recording.losses)
"""


def test_large_packed_messages_are_unpacked_one_by_one(tmp_path: Path) -> None:
    """Ten pictures of 200 MB fit into 1.5 GB."""
    folder = tmp_path / 'bag'
    with warnings.catch_warnings():
        warnings.simplefilter('ignore')
        (file,) = make_database(folder, 9, CompressionMode.MESSAGE).glob('*.db3')
    head = b'\0\1\0\0' + struct.pack('<II', 7, 200_000_000)
    packed = zstandard.ZstdCompressor(level=1).compress(head + bytes(200_000_000))
    with contextlib.closing(sqlite3.connect(file)) as database:
        database.execute('DELETE FROM messages WHERE id > 10')
        database.execute("UPDATE topics SET name = '/camera', type = 'yard_msgs/msg/Picture'")
        picture = 'uint32 height\nuint8[] pixels', 'yard_msgs/msg/Picture'
        database.execute(
            'UPDATE message_definitions SET encoded_message_definition = ?, topic_type = ?', picture
        )
        database.execute('UPDATE messages SET topic_id = 1, data = ?', (packed,))
        database.commit()
    (folder / 'metadata.yaml').write_text(
        (folder / 'metadata.yaml').read_text().replace('message_count: 5000', 'message_count: 10')
    )
    done = subprocess.run(
        [sys.executable, '-c', READ_PICTURES, str(folder)], capture_output=True, text=True, check=False
    )
    assert done.stderr == ''
    assert done.stdout == f'{[7.0] * 10} ()\n'


class Damaged:
    """A database whose row ids 1 to 100 end in a damaged page, behind one that is 0."""

    def execute(self, _: str, begin: tuple[int]) -> Iterator[tuple[int]]:
        if begin[0] <= 100:
            yield from ((number,) for number in (*range(max(begin[0], 1), 101), 0))
            raise sqlite3.DatabaseError


def test_behind_damage_no_row_is_read_again(tmp_path: Path) -> None:
    file = SqliteFile(change_database(tmp_path), Findings(), Scratch())
    batches = list(file._iterate_rows(cast('sqlite3.Connection', Damaged()), 'timestamp'))
    assert [number for batch in batches for (number,) in batch] == [*range(1, 101), 0]


def test_a_clock_that_was_set_back(tmp_path: Path) -> None:
    # The order of the file is the order of events: 10 s become 2 s, and values go on.
    change = 'UPDATE messages SET timestamp = timestamp - 8000000000 WHERE id > 2000'
    recording = open_bag(change_database(tmp_path, change))
    series = recording.read([SPEED])[SPEED]
    np.testing.assert_array_equal(series.value, np.arange(float(COUNT)))
    assert (np.diff(series.log_time_ns) >= 0).all()
    assert 'was set back once, by 8 s' in ' '.join(recording.warnings)


@pytest.mark.parametrize('order', ['topic_id, timestamp', 'timestamp DESC'], ids=['by topic', 'newest first'])
def test_rows_in_no_order_of_time_are_sorted(tmp_path: Path, order: str) -> None:
    # A converter may write topic by topic: no clock was set, and the inputs belong together.
    path = change_database(
        tmp_path,
        f'CREATE TABLE copy AS SELECT * FROM messages ORDER BY {order}',
        'UPDATE copy SET id = rowid',
        'DELETE FROM messages',
        'INSERT INTO messages SELECT * FROM copy',
    )
    assert_read_whole(path)
    recording = open_bag(path)
    recording.read([SPEED, LOAD])
    # Messages that are read together may be in any order, as those of one chunk of MCAP.
    is_told = order == 'timestamp DESC'
    assert ('the messages are in no order of time: sorted by time' in recording.warnings) == is_told


def test_a_type_that_nobody_knows_is_named(tmp_path: Path) -> None:
    file = change_database(tmp_path, "UPDATE topics SET type = 'yard_msgs/msg/Shaft' WHERE name = '/load'")
    assert 'no definition of yard_msgs/msg/Shaft' in open_bag(file).topics['/load'].problem
    assert open_bag(file).read([SPEED])[SPEED].value.size == COUNT


@pytest.mark.parametrize(
    'change',
    [
        'UPDATE topics SET id = NULL WHERE id = 1',
        'UPDATE messages SET timestamp = 9223372036854775807 WHERE id % 7 = 0',
        'UPDATE message_definitions SET encoded_message_definition = zeroblob(7)',
    ],
)
def test_values_of_another_kind_are_reported(change: str, tmp_path: Path) -> None:
    tables = [
        statement
        for table in ('topics', 'message_definitions')
        for statement in (
            f'CREATE TABLE copy AS SELECT * FROM {table}',
            f'DROP TABLE {table}',
            f'ALTER TABLE copy RENAME TO {table}',
        )
    ]
    recording = open_bag(change_database(tmp_path, *tables, change, version=9))
    count = sum(1 for _ in recording.messages())
    assert count == 2 * COUNT or recording.losses
    values = recording.read([SPEED])[SPEED].value
    assert values.size == COUNT or recording.losses
    assert recording.end_ns == START + (COUNT - 1) * 10_000_000
