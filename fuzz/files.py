# SPDX-License-Identifier: Apache-2.0
"""MCAP files put together record by record with the ``mcap`` package, sound or not."""

from __future__ import annotations

import struct
import zlib
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace

import lz4.frame
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.records import (
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Message,
    MessageIndex,
    Schema,
    Statistics,
)

MAGIC = b'\x89MCAP0\r\n'
SPEED, LOAD = '/shaft/speed', '/bearing/aft_stern/load'
TOPICS = (SPEED, LOAD)
FLOAT64 = 'std_msgs/msg/Float64'
START, STEP = 1_777_874_400 * 10**9, 10**8
HEAD = struct.Struct('<BQ')


def encode_record(record: McapRecord) -> bytes:
    """Return a record as it lies in a file."""
    builder = RecordBuilder()
    record.write(builder)
    data: bytes = builder.end()
    return data


def raw_record(opcode: int, body: bytes) -> bytes:
    """Return a record of any kind and content."""
    return HEAD.pack(opcode, len(body)) + body


def schema(number: int = 1, name: str = FLOAT64, text: bytes = b'float64 data\n') -> bytes:
    """Return a definition of messages."""
    return encode_record(Schema(id=number, name=name, encoding='ros2msg', data=text))


def channel(number: int, topic: str, schema_id: int = 1) -> bytes:
    """Return a definition of a channel."""
    return encode_record(
        Channel(id=number, topic=topic, message_encoding='cdr', metadata={}, schema_id=schema_id)
    )


def message(number: int, time_ns: int, value: float, head: bytes = b'\0\1\0\0') -> bytes:
    """Return a Float64."""
    data = head + struct.pack('<d', value)
    return encode_record(
        Message(channel_id=number, data=data, log_time=time_ns, publish_time=time_ns, sequence=0)
    )


DEFINITIONS = (schema(), *(channel(i + 1, topic) for i, topic in enumerate(TOPICS)))


def messages(first: int = 0, count: int = 20, swapped: bool = False) -> list[bytes]:
    """Return speed and load in turns, near the fold of the reference bearing."""
    numbers = (2, 1) if swapped else (1, 2)
    return [
        message(numbers[k % 2], START + (first + k) * STEP, 1000.0 if k % 2 else 30.0 + 0.01 * k)
        for k in range(count)
    ]


def compressed(data: bytes, compression: str) -> bytes:
    """Return data as a chunk holds it."""
    if compression == 'zstd':
        return zstandard.compress(data)
    return bytes(lz4.frame.compress(data)) if compression == 'lz4' else data


@dataclass
class Piece:
    """A chunk of records, with what it says of itself where that is not the truth."""

    records: list[bytes]
    compression: str = ''
    checked: bool = True
    is_bare: bool = False
    left_out: frozenset[int] = frozenset()
    most_entries: int | None = None
    repeated: bool = False
    changes: Mapping[str, object] = field(default_factory=dict)

    @property
    def data(self) -> bytes:
        """Its records."""
        return b''.join(self.records)

    def entries(self) -> dict[int, list[tuple[int, int]]]:
        """Log time and offset of the messages of each channel."""
        entries_by_channel: dict[int, list[tuple[int, int]]] = {}
        offset = 0
        for record in self.records:
            if record[:1] == b'\5' and len(record) >= 31:
                number, _, time_ns = struct.unpack_from('<HIQ', record, 9)
                entries_by_channel.setdefault(number, []).append((time_ns, offset))
            offset += len(record)
        return entries_by_channel

    def record(self) -> bytes:
        """Return the chunk as it lies in a file."""
        if self.is_bare:
            return self.data
        times = [time for pairs in self.entries().values() for time, _ in pairs] or [0]
        chunk = Chunk(
            compression=self.compression,
            data=compressed(self.data, self.compression),
            message_start_time=min(times),
            message_end_time=max(times),
            uncompressed_crc=zlib.crc32(self.data) if self.checked else 0,
            uncompressed_size=len(self.data),
        )
        return encode_record(replace(chunk, **self.changes))

    def _listed_entries(self, pairs: list[tuple[int, int]]) -> list[tuple[int, int]]:
        """Return the entries of an index: all, the first few, or one of them twice."""
        return [pairs[0], *pairs[:-1]] if self.repeated else pairs[: self.most_entries]

    def indexes(self) -> dict[int, bytes]:
        """Return the message indexes of the chunk, but those that are left out."""
        if self.is_bare:
            return {}
        return {
            number: encode_record(MessageIndex(channel_id=number, records=self._listed_entries(pairs)))
            for number, pairs in self.entries().items()
            if number not in self.left_out
        }


def file(
    pieces: Iterable[Piece],
    definitions: Iterable[bytes] = DEFINITIONS,
    summary: bool = True,
    counts: Mapping[int, int] | None = None,
) -> bytes:
    """Return a whole file.

    Args:
        pieces: Its chunks.
        definitions: What the summary repeats.
        summary: Whether there is one.
        counts: Messages of each channel after the statistics, if not the truth.
    """
    out = bytearray(MAGIC + encode_record(Header(profile='ros2', library='fuzz')))
    chunks, message_counts, times = [], Counter[int](), []
    for piece in pieces:
        begin, record, indexes = len(out), piece.record(), piece.indexes()
        offsets, end = {}, begin + len(record)
        for number, index in indexes.items():
            offsets[number] = end
            end += len(index)
        out += record + b''.join(indexes.values())
        entries = piece.entries()
        message_counts.update({number: len(pairs) for number, pairs in entries.items()})
        piece_times = [time for pairs in entries.values() for time, _ in pairs]
        times += piece_times
        if not piece.is_bare:
            chunks.append(
                ChunkIndex(
                    chunk_length=len(record),
                    chunk_start_offset=begin,
                    compression=piece.compression,
                    compressed_size=len(record),
                    message_end_time=max(piece_times, default=0),
                    message_start_time=min(piece_times, default=0),
                    message_index_length=end - begin - len(record),
                    message_index_offsets=offsets,
                    uncompressed_size=len(piece.data),
                )
            )
    out += encode_record(DataEnd(0))
    start = len(out) if summary else 0
    if summary:
        stated = dict(message_counts if counts is None else counts)
        names = [record for record in definitions if record[:1] == b'\4']
        statistics = Statistics(
            attachment_count=0,
            channel_count=len(names),
            channel_message_counts=stated,
            chunk_count=len(chunks),
            message_count=sum(stated.values()),
            message_end_time=max(times, default=0),
            message_start_time=min(times, default=0),
            metadata_count=0,
            schema_count=1,
        )
        parts = [*definitions, encode_record(statistics), *map(encode_record, chunks)]
        out += b''.join(parts)
    out += encode_record(Footer(summary_start=start, summary_offset_start=0, summary_crc=0))
    return bytes(out + MAGIC)


def sound(compression: str = '', **options: bool) -> bytes:
    """Return a recording without anything odd: 3 chunks of 20 messages."""
    first = [*DEFINITIONS, *messages(0)]
    return file(
        [Piece(first, compression), Piece(messages(20), compression), Piece(messages(40), compression)],
        **options,
    )
