# SPDX-License-Identifier: Apache-2.0
"""Files that end too early or are damaged: everything that is there is read, and nothing else."""

from __future__ import annotations

import io
import struct
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import lz4.frame
import numpy as np
import pytest
import zstandard
from mcap.reader import make_reader
from mcap.records import ChunkIndex
from mcap.writer import CompressionType, Writer

from fuzz.files import DEFINITIONS, START, Piece, channel, file, message, raw_record
from fuzz.mutants import records_of
from stickslip_logs.recordings.mcap_chunks import decompress, walk_records
from stickslip_logs.recordings.reader import open_bag
from stickslip_logs.recordings.recording import Recording, Request

RECORD = 9 + 22 + 12  # head, message head, a Float64 in CDR
CHUNK_HEAD = 9 + 8 + 8 + 8 + 4 + 4 + 8  # before the name of the compression and the data
COMPRESSIONS = {'': CompressionType.NONE, 'lz4': CompressionType.LZ4, 'zstd': CompressionType.ZSTD}
SLOW = [pytest.param(name, marks=pytest.mark.slow) for name in ('', 'lz4')]
REQUESTS = [Request('/a', 'data'), Request('/b', 'data')]


@dataclass(frozen=True)
class McapSample:
    """MCAP file with the times, chunks and record boundaries that it must have."""

    data: bytes
    times: list[int]
    chunks: list[ChunkIndex]
    per_chunk: int

    @property
    def last(self) -> ChunkIndex:
        return self.chunks[-1]

    @property
    def boundaries(self) -> list[int]:
        offsets = [8]
        while offsets[-1] < len(self.data) - 8:
            (length,) = struct.unpack_from('<Q', self.data, offsets[-1] + 1)
            offsets.append(offsets[-1] + 9 + length)
        return offsets


def make_mcap(compression: str, chunks: int, per_chunk: int, **options: object) -> McapSample:
    stream = io.BytesIO()
    size = {'chunk_size': 1 << 30, 'compression': COMPRESSIONS[compression]}
    writer = Writer(stream, **{**size, **options})  # type: ignore[arg-type]
    writer.start('ros2', 'test')
    schema = writer.register_schema('std_msgs/msg/Float64', 'ros2msg', b'float64 data\n')
    channels = [writer.register_channel(topic, 'cdr', schema) for topic in ('/a', '/b')]
    rng = np.random.default_rng(5)
    times = []
    for number in range(chunks * per_chunk):
        data = b'\0\1\0\0' + struct.pack('<d', rng.standard_normal())
        times.append(1000 + 10 * number)
        writer.add_message(channels[number % 2], times[-1], data, times[-1])
        if number % per_chunk == per_chunk - 1:
            writer.flush()
    writer.finish()
    summary = make_reader(io.BytesIO(stream.getvalue())).get_summary()
    return McapSample(stream.getvalue(), times, summary.chunk_indexes, per_chunk)


def read_times(bag: Recording) -> list[int]:
    return [message.log_time_ns for message in bag.messages()]


def zstd_prefix(part: bytes) -> bytes:
    return zstandard.ZstdDecompressor().stream_reader(io.BytesIO(part)).read()


def lz4_prefix(part: bytes) -> bytes:
    restored: bytes = lz4.frame.LZ4FrameDecompressor().decompress(part)
    return restored


PREFIXES: dict[str, Callable[[bytes], bytes]] = {'': bytes, 'lz4': lz4_prefix, 'zstd': zstd_prefix}


def count_saved(complete: McapSample, compression: str, cut: int) -> int:
    """Return how many messages lie before a cut in or behind the last chunk."""
    in_earlier_chunks = complete.per_chunk * (len(complete.chunks) - 1)
    begin = complete.last.chunk_start_offset
    if cut >= begin + complete.last.chunk_length:
        return in_earlier_chunks + complete.per_chunk
    part = complete.data[begin + CHUNK_HEAD + len(compression) : cut]
    return in_earlier_chunks + len(PREFIXES[compression](part)) // RECORD


@pytest.mark.parametrize('compression', ['zstd', *SLOW])
def test_cut_in_the_tail(tmp_path: Path, compression: str) -> None:
    """Cut on both sides of where every record begins, and inside of the records."""
    complete = make_mcap(compression, chunks=3, per_chunk=8)
    path, begin = tmp_path / 'a.mcap', complete.last.chunk_start_offset - 20
    beside = {at + step for at in complete.boundaries for step in (-1, 0, 1)}
    for cut in sorted({*range(begin, len(complete.data), 7), *beside & {*range(begin, len(complete.data))}}):
        path.write_bytes(complete.data[:cut])
        bag = open_bag(path)
        count = 16 if cut < complete.last.chunk_start_offset else count_saved(complete, compression, cut)
        assert read_times(bag) == complete.times[:count]
        assert bag.message_count == count
        (report,) = bag.cuts
        assert (report.path, report.size) == (path, cut)
        assert report.offset == max(b for b in complete.boundaries if b <= cut)
        assert bag.end_ns == complete.times[count - 1]
        assert f'byte {report.offset} of {cut}' in report.text
    path.write_bytes(complete.data)
    assert open_bag(path).cuts == ()


@pytest.mark.parametrize('compression', COMPRESSIONS)
def test_messages_inside_a_cut_chunk_are_saved(tmp_path: Path, compression: str) -> None:
    # Large enough for several compressed blocks in one chunk.
    complete = make_mcap(compression, chunks=2, per_chunk=12_000)
    path = tmp_path / 'a.mcap'
    inside = np.linspace(0.02, 0.98, 13) * complete.last.chunk_length
    counts = []
    for cut in (complete.last.chunk_start_offset + inside).astype(int).tolist():
        path.write_bytes(complete.data[:cut])
        bag = open_bag(path)
        counts.append(count_saved(complete, compression, cut))
        series = bag.read(REQUESTS)
        assert (
            sorted(time for part in series.values() for time in part.log_time_ns.tolist())
            == complete.times[: counts[-1]]
        )
        assert bag.cuts[0].text == (
            f"file 'a.mcap' is truncated in the record at byte {complete.last.chunk_start_offset} of {cut}:"
            f' {counts[-1]} messages recovered'
        )
    assert len(set(counts)) >= 3


@pytest.mark.parametrize('compression', ['lz4', 'zstd'])
def test_garbage_behind_a_cut_costs_nothing_before_it(compression: str) -> None:
    plain = np.random.default_rng(3).bytes(600_000)
    packed = {'lz4': lz4.frame.compress, 'zstd': zstandard.compress}[compression](plain)
    half = packed[: len(packed) // 2]
    expected = PREFIXES[compression](half)
    assert len(expected) > 100_000
    # The damaged piece itself may take one compressed block with it.
    restored = decompress(half + b'\xff' * 300_000, compression, len(plain), is_cut=True)
    assert len(restored) > len(expected) - 140_000
    assert plain.startswith(restored[: len(expected)])


RUN = [message(1 + k % 2, START + k, float(k)) for k in range(4000)]


@pytest.mark.parametrize(
    'exception',
    [
        channel(7, '/other'),
        raw_record(5, bytes(31)),
        raw_record(5, b'short'),
        raw_record(0x80, bytes(34)),
        message(1, START, 1.0)[:20],
        b'\5' + (34).to_bytes(7, 'little') + b'\1' + bytes(34),
        b'',
    ],
    ids=['a channel', 'longer', 'too short', 'another kind', 'cut', 'of 2^56 bytes', 'none'],
)
def test_a_run_of_messages_of_one_length_ends_at_an_exception(exception: bytes) -> None:
    # Expected by the records one by one, as they say where they end.
    data = b''.join([*RUN[:3000], exception, *RUN[3000:], exception])
    *records, _ = records_of(data)
    expected = [
        (int.from_bytes(record[9:11], 'little'), int.from_bytes(record[15:23], 'little'), record[31:])
        for record in records
        if record[0] == 5 and len(record) >= 31
    ]
    decoded = [
        (channel, time, data[begin : begin + size])
        for piece in walk_records(data)
        for channel, time, begin, size in zip(
            piece.channel.tolist(),
            piece.log_time_ns.tolist(),
            piece.offset.tolist(),
            piece.size.tolist(),
            strict=True,
        )
    ]
    assert decoded == expected
    assert len(decoded) >= 3000


def test_cut_of_a_file_without_chunks(tmp_path: Path) -> None:
    bare = [message(1, START + k, float(k)) for k in range(6)]
    data = file([Piece([*DEFINITIONS, *bare], is_bare=True)])
    ends = data.index(bare[0]) + np.arange(1, 7) * len(bare[0])
    for cut in range(int(ends[0]), len(data), 5):
        (tmp_path / 'a.mcap').write_bytes(data[:cut])
        bag = open_bag(tmp_path / 'a.mcap')
        assert read_times(bag) == [START + k for k in range(np.count_nonzero(ends <= cut))]
        assert len(bag.cuts) == 1


@pytest.mark.parametrize('compression', COMPRESSIONS)
@pytest.mark.parametrize('with_summary', [True, False])
def test_a_damaged_chunk_is_skipped(tmp_path: Path, compression: str, with_summary: bool) -> None:
    complete = make_mcap(compression, chunks=3, per_chunk=8)
    middle = complete.chunks[1]
    spot = middle.chunk_start_offset + middle.chunk_length - 30
    data = bytearray(complete.data)
    data[spot] ^= 0xFF
    end = len(data) if with_summary else len(data) - 1
    (tmp_path / 'a.mcap').write_bytes(data[:end])
    bag = open_bag(tmp_path / 'a.mcap')
    series = bag.read(REQUESTS)
    assert series[REQUESTS[0]].log_time_ns.tolist() == [*complete.times[:8:2], *complete.times[16::2]]
    assert series[REQUESTS[1]].sequence.tolist() == list(range(1, 16, 2))
    assert read_times(bag) == [*complete.times[:8], *complete.times[16:]]
    warning, difference = bag.warnings
    assert "counts 12 messages of '/a', and 8 can be read" in difference
    begin = f"file 'a.mcap': the chunk at byte {middle.chunk_start_offset} is damaged ("
    assert warning.startswith(begin)
    assert warning.endswith(') and was skipped')


@pytest.mark.parametrize(('first', 'last', 'begins', 'ends'), [(1, 3, 5, 5), (0, 0, 1, 60), (5, 5, 1, 60)])
def test_zeros_in_the_middle_cost_the_chunks_that_they_touch(
    first: int, last: int, begins: int, ends: int, tmp_path: Path
) -> None:
    # The index of chunks leads on where the heads of records do not.
    complete = make_mcap('zstd', chunks=6, per_chunk=8)
    begin = complete.chunks[first].chunk_start_offset + begins
    end = complete.chunks[last].chunk_start_offset + ends
    path = tmp_path / 'a.mcap'
    path.write_bytes(complete.data[:begin] + bytes(end - begin) + complete.data[end:])
    bag = open_bag(path)
    assert read_times(bag) == complete.times[: 8 * first] + complete.times[8 * last + 8 :]
    assert 'what lies behind was found by the index of chunks' in ' '.join(bag.losses)
