# SPDX-License-Identifier: Apache-2.0
"""Reading the numbers of a recording, beside the Python readers of MCAP."""

from __future__ import annotations

import struct
import tempfile
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from mcap.reader import make_reader
from mcap.records import Chunk
from mcap.stream_reader import StreamReader
from mcap_ros2.reader import read_ros2_messages
from zstandard import ZstdDecompressor

from benchmarks.table import Table, absent, ratio
from benchmarks.timing import Times, in_turns
from stickslip_logs.recordings.reader import open_bag
from stickslip_logs.recordings.recording import Request
from stickslip_logs.recordings.writer import BagWriter, encode_float64s, encode_string

TOPICS = ('/shaft/speed', '/bearing/aft_stern/load')
COUNT = 600_000
"""Messages on each of the two topics."""
OURS, MIXED = 'stickslip_monitor', 'stickslip_monitor, mixed recording'
BLOCKS, MIXED_BLOCKS = f'{OURS}, in blocks', f'{MIXED}, in blocks'
FLOOR = 'decompressing the chunks alone'
ROSBAGS, ROSBAGS_MIXED = 'rosbags', 'rosbags, mixed recording'
_PAYLOAD = struct.Struct('<4xd')


def run(quick: bool) -> Table:
    """Compare readers; a short run reads a tenth of the messages."""
    count = COUNT // 10 if quick else COUNT
    with tempfile.TemporaryDirectory() as folder:
        plain, mixed = Path(folder) / 'plain', Path(folder) / 'mixed'
        write_recordings(plain, count, 0)
        write_recordings(mixed, count, count)
        times = in_turns(_make_readers(plain, mixed, 2 * count), 3, warm=False)
    return _make_table(times, 2 * count)


def write_recordings(path: Path, count: int, texts: int) -> None:
    """Write speed and load at 1 kHz, and strings of changing length between them."""
    generator = np.random.default_rng(1)
    time = np.arange(count, dtype=np.int64) * 1_000_000
    lengths = generator.integers(0, 200, texts).tolist()
    columns = [(topic, time, encode_float64s(generator.normal(size=count))) for topic in TOPICS]
    with BagWriter(path) as bag:
        for topic in TOPICS:
            bag.add_topic(topic, 'std_msgs/msg/Float64')
        bag.add_topic('/log', 'std_msgs/msg/String')
        strings = [encode_string('x' * length) for length in lengths]
        bag.write_columns([*columns, ('/log', time[:texts], strings)])


def _make_readers(plain: Path, mixed: Path, count: int) -> dict[str, Callable[[], object]]:
    readers: dict[str, Callable[[], int]] = {
        OURS: lambda: _read_arrays(plain),
        MIXED: lambda: _read_arrays(mixed),
        BLOCKS: lambda: _read_blocks(plain),
        MIXED_BLOCKS: lambda: _read_blocks(mixed),
        'mcap': lambda: _read_by_mcap(plain),
        'mcap-ros2-support': lambda: _read_by_mcap_ros2(plain),
    }
    if find_spec('rosbags'):
        readers |= {ROSBAGS: lambda: _read_by_rosbags(plain), ROSBAGS_MIXED: lambda: _read_by_rosbags(mixed)}
    checked = {name: _check_reader(name, reader, count) for name, reader in readers.items()}
    chunks = _list_chunks(plain)
    return checked | {FLOOR: lambda: _decompress_chunks(chunks)}


def _check_reader(name: str, reader: Callable[[], int], count: int) -> Callable[[], object]:
    def read() -> None:
        if (count_read := reader()) != count:
            raise RuntimeError(f'{name} read {count_read} of {count} numbers')

    return read


def _read_arrays(path: Path) -> int:
    requests = [Request(topic, 'data') for topic in TOPICS]
    return sum(series.value.size for series in open_bag(path).read(requests).values())


def _read_blocks(path: Path) -> int:
    """Read as a check does: each part of time is dropped when the next one comes."""
    requests = [Request(topic, 'data') for topic in TOPICS]
    reading = open_bag(path).reading(requests)
    return sum(series.value.size for part in reading for series in part.values())


def _bag_file(path: Path) -> Path:
    return path / f'{path.name}_0.mcap'


def _read_by_mcap(path: Path) -> int:
    """Read messages as bytes, and unpack the number by hand: possible for one type only."""
    times, values = [], []
    with _bag_file(path).open('rb') as file:
        for _, _, message in make_reader(file).iter_messages(TOPICS):
            times.append(message.log_time)
            values.append(_PAYLOAD.unpack(message.data)[0])
    return min(np.array(values).size, np.array(times).size)


def _read_by_mcap_ros2(path: Path) -> int:
    times, values = [], []
    for message in read_ros2_messages(str(_bag_file(path)), topics=TOPICS):
        times.append(message.log_time_ns)
        values.append(message.ros_msg.data)
    return min(np.array(values).size, np.array(times).size)


def _read_by_rosbags(path: Path) -> int:
    from rosbags.rosbag2 import Reader
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    times, values = [], []
    with Reader(path) as reader:
        connections = [connection for connection in reader.connections if connection.topic in TOPICS]
        for connection, time, data in reader.messages(connections):
            times.append(time)
            message: Any = store.deserialize_cdr(data, connection.msgtype)
            values.append(message.data)
    return min(np.array(values).size, np.array(times).size)


def _list_chunks(path: Path) -> list[Chunk]:
    with _bag_file(path).open('rb') as file:
        records = StreamReader(file, emit_chunks=True).records
        return [record for record in records if isinstance(record, Chunk)]


def _decompress_chunks(chunks: list[Chunk]) -> None:
    decompressor = ZstdDecompressor()
    for chunk in chunks:
        decompressor.decompress(chunk.data, chunk.uncompressed_size)


def _make_table(times: dict[str, Times], count: int) -> Table:
    our_median = times[OURS].median
    rows = [
        [
            name,
            f'{count / times_of_reader.median / 1e6:.2f}',
            '1' if name == OURS else ratio(times_of_reader.median / our_median),
        ]
        for name, times_of_reader in times.items()
    ]
    rows += [absent(name, 3) for name in (ROSBAGS, ROSBAGS_MIXED) if name not in times]
    return Table(
        title='Reading',
        text=(
            f'Log times and values of {count / 1e6:g} million `std_msgs/Float64` on two topics at'
            ' 1 kHz (zstd) as arrays. In blocks is as a check reads.'
        ),
        columns=('reader', 'million/s, median of 3', 'ratio'),
        rows=rows,
    )
