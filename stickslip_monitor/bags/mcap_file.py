# SPDX-License-Identifier: Apache-2.0
"""Writes the records of an MCAP file: the same bytes as ``mcap``'s writer, many at once.

Messages are laid out in a chunk by numpy, and chunks are compressed by another thread while the
next one is laid out. The summary is written by the record classes of the ``mcap`` package.
"""

from __future__ import annotations

import zlib
from collections import Counter, deque
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import IO

import lz4.frame  # type: ignore[import-untyped]
import numpy as np
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)
from mcap.well_known import Profile
from numpy.typing import NDArray

from stickslip_monitor.arrays import IntArray
from stickslip_monitor.bags.records import HEAD, MAGIC, MESSAGE_HEAD, PAYLOAD
from stickslip_monitor.bags.values import Payload

COMPRESSIONS = {
    'none': ('', lambda data: data),
    'lz4': ('lz4', lz4.frame.compress),
    'zstd': ('zstd', zstandard.compress),
}
# Chunks that wait to be compressed.
_WAITING = 3
_HEAD = np.dtype(
    [('opcode', 'u1'), ('length', '<u8'), ('channel', '<u2'), ('sequence', '<u4'),
     ('log_time', '<u8'), ('publish_time', '<u8')]
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class RecordColumn:
    """Messages of one channel.

    Attributes:
        channel: The channel.
        sequence: Number of the first of them.
        log_time_ns: Log times, also taken as those of publication, shape (n,) [ns].
        payload: n messages in CDR.
    """

    channel: int
    sequence: int
    log_time_ns: IntArray
    payload: Payload

    @property
    def sizes(self) -> IntArray:
        """The length of each record with its head, shape (n,) [bytes]."""
        if isinstance(self.payload, np.ndarray):
            return np.full(len(self.payload), self.payload.itemsize + PAYLOAD)
        return np.fromiter(map(len, self.payload), np.int64, len(self.payload)) + PAYLOAD


@dataclass(slots=True)
class _Draft:
    """The chunk that is being laid out."""

    data: bytearray = field(default_factory=bytearray)
    index: dict[int, list[bytes]] = field(default_factory=dict)
    start_ns: int | None = None
    end_ns: int = 0

    def note(self, channel: int, log_time_ns: IntArray, offset: IntArray) -> None:
        """Take up messages of a channel, at least one, into the index and the span of time."""
        pairs = np.column_stack([log_time_ns, offset])
        self.index.setdefault(channel, []).append(pairs.astype('<i8').tobytes())
        self.widen(int(log_time_ns.min()), int(log_time_ns.max()))

    def widen(self, first_ns: int, last_ns: int) -> None:
        """Widen the span of time."""
        self.start_ns = first_ns if self.start_ns is None else min(first_ns, self.start_ns)
        self.end_ns = max(last_ns, self.end_ns)


class McapFile:
    """The records of one file.

    Args:
        file: Where to.
        compression: One of :data:`COMPRESSIONS`.
        chunk_size: Bytes after which a chunk is closed, before compression.
        library: What wrote it.
    """

    def __init__(self, file: IO[bytes], compression: str, chunk_size: int, library: str) -> None:
        self._file = file
        self._compression, self._compress = COMPRESSIONS[compression]
        self._chunk_size = chunk_size
        self._draft = _Draft()
        self._pool = ThreadPoolExecutor(1)
        self._waiting: deque[Future[tuple[Chunk, _Draft]]] = deque()
        self._schemas: list[Schema] = []
        self._channels: list[Channel] = []
        self._metadata: list[MetadataIndex] = []
        self._chunks: list[ChunkIndex] = []
        self._counts: Counter[int] = Counter()
        self._start_ns: int | None = None
        self._end_ns = 0
        file.write(MAGIC + _bytes(Header(Profile.ROS2, library)))

    def close(self) -> None:
        """Let the thread go; what was not finished stays as it is."""
        self._pool.shutdown(cancel_futures=True)

    def add_metadata(self, name: str) -> None:
        """Write a label before the first message."""
        record = _bytes(Metadata(name=name, metadata={}))
        offset = self._file.tell()
        self._metadata.append(MetadataIndex(offset=offset, length=len(record), name=name))
        self._file.write(record)

    def add_schema(self, name: str, encoding: str, data: bytes) -> int:
        """Define a schema; return its id."""
        schema = Schema(id=len(self._schemas) + 1, data=data, encoding=encoding, name=name)
        self._schemas.append(schema)
        self._draft.data += _bytes(schema)
        self._close_if_full()
        return schema.id

    def add_channel(
        self, topic: str, encoding: str, schema: int, metadata: Mapping[str, str]
    ) -> int:
        """Define a channel; return its id."""
        number = len(self._channels) + 1
        channel = Channel(
            id=number, topic=topic, message_encoding=encoding, schema_id=schema,
            metadata=dict(metadata),
        )  # fmt: skip
        self._channels.append(channel)
        self._draft.data += _bytes(channel)
        self._close_if_full()
        return number

    def add(self, channel: int, sequence: int, log_time_ns: int, data: bytes) -> None:
        """Write one message."""
        draft, offset = self._draft, len(self._draft.data)
        draft.data += HEAD.pack(Opcode.MESSAGE, MESSAGE_HEAD.size + len(data))
        draft.data += MESSAGE_HEAD.pack(channel, sequence, log_time_ns, log_time_ns)
        draft.data += data
        pair = log_time_ns.to_bytes(8, 'little') + offset.to_bytes(8, 'little')
        draft.index.setdefault(channel, []).append(pair)
        draft.widen(log_time_ns, log_time_ns)
        self._counts[channel] += 1
        self._close_if_full()

    def add_merged(self, columns: Sequence[RecordColumn]) -> None:
        """Write messages of several channels, merged by their log times."""
        columns = [column for column in columns if len(column.log_time_ns)]
        if not columns:
            return
        counts = [len(column.log_time_ns) for column in columns]
        times = np.concatenate([column.log_time_ns for column in columns])
        order = np.argsort(times, kind='stable')
        edges = np.cumsum([0, *counts])
        sizes = np.concatenate([column.sizes for column in columns])[order]
        rows = [_rows(column) for column in columns]
        for part in self._cut(sizes):
            self._lay_out(columns, rows, edges, order[part], sizes[part])
            self._close_if_full()
        for column, count in zip(columns, counts, strict=True):
            self._counts[column.channel] += count

    def _cut(self, sizes: IntArray) -> Iterator[slice]:
        """The messages that go into each chunk: until it is longer than it should be."""
        total, begin = np.cumsum(sizes), 0
        while begin < len(sizes):
            room = self._chunk_size - len(self._draft.data)
            before = int(total[begin - 1]) if begin else 0
            end = min(int(np.searchsorted(total, before + room, 'right')) + 1, len(sizes))
            yield slice(begin, end)
            begin = end

    def _lay_out(
        self,
        columns: Sequence[RecordColumn],
        rows: Sequence[NDArray[np.void] | None],
        edges: IntArray,
        order: IntArray,
        sizes: IntArray,
    ) -> None:
        """Lay out some messages at the end of the chunk."""
        base = len(self._draft.data)
        ends = np.cumsum(sizes)
        offsets = ends - sizes
        data = np.empty(int(ends[-1]), np.uint8)
        owner = np.searchsorted(edges, order, 'right') - 1
        found = []
        for k, column in enumerate(columns):
            own = np.flatnonzero(owner == k)
            if own.size:
                picked, places = order[own] - edges[k], offsets[own]
                _place(data, column, rows[k], picked, places)
                found.append((int(own[0]), column, picked, places))
        for _, column, picked, places in sorted(found, key=lambda each: each[0]):
            self._draft.note(column.channel, column.log_time_ns[picked], places + base)
        self._draft.data += data.data

    def _close_if_full(self) -> None:
        if len(self._draft.data) > self._chunk_size:
            self._close_chunk()

    def _close_chunk(self) -> None:
        if not self._draft.index:
            return
        self._waiting.append(self._pool.submit(self._packed, self._draft))
        self._draft = _Draft()
        while len(self._waiting) > _WAITING:
            self._write_chunk(*self._waiting.popleft().result())

    def _packed(self, draft: _Draft) -> tuple[Chunk, _Draft]:
        data = bytes(draft.data)
        chunk = Chunk(
            compression=self._compression,
            data=self._compress(data),
            message_start_time=draft.start_ns or 0,
            message_end_time=draft.end_ns,
            uncompressed_crc=zlib.crc32(data),
            uncompressed_size=len(data),
        )
        draft.data.clear()
        return chunk, draft

    def _write_chunk(self, chunk: Chunk, draft: _Draft) -> None:
        record, offset = _bytes(chunk), self._file.tell()
        self._file.write(record)
        begin, parts, places = offset + len(record), [], {}
        for channel, pairs in draft.index.items():
            places[channel] = begin
            body = b''.join(pairs)
            parts.append(HEAD.pack(Opcode.MESSAGE_INDEX, 6 + len(body)))
            parts.append(channel.to_bytes(2, 'little') + len(body).to_bytes(4, 'little') + body)
            begin += HEAD.size + 6 + len(body)
        self._file.write(b''.join(parts))
        self._chunks.append(
            ChunkIndex(
                chunk_length=len(record),
                chunk_start_offset=offset,
                compression=chunk.compression,
                compressed_size=len(chunk.data),
                message_end_time=chunk.message_end_time,
                message_index_length=begin - offset - len(record),
                message_index_offsets=places,
                message_start_time=chunk.message_start_time,
                uncompressed_size=chunk.uncompressed_size,
            )
        )
        first = chunk.message_start_time
        self._start_ns = first if self._start_ns is None else min(first, self._start_ns)
        self._end_ns = max(chunk.message_end_time, self._end_ns)

    def drain(self) -> None:
        """Write all chunks that wait."""
        while self._waiting:
            self._write_chunk(*self._waiting.popleft().result())

    def finish(self) -> None:
        """Write the last chunk and the summary."""
        self._close_chunk()
        self.drain()
        self._file.write(_bytes(DataEnd(0)))
        begin, summary, offsets = self._file.tell(), b'', []
        for opcode, records in self._groups():
            group = b''.join(map(_bytes, records))
            offsets.append(
                SummaryOffset(
                    group_opcode=opcode,
                    group_start=begin + len(summary),
                    group_length=len(group),
                )
            )
            summary += group
        offset_begin = begin + len(summary)
        summary += b''.join(map(_bytes, offsets))
        head = HEAD.pack(Opcode.FOOTER, 20)
        places = begin.to_bytes(8, 'little') + offset_begin.to_bytes(8, 'little')
        crc = zlib.crc32(head + places, zlib.crc32(summary))
        footer = Footer(summary_start=begin, summary_offset_start=offset_begin, summary_crc=crc)
        self._file.write(summary + _bytes(footer) + MAGIC)

    def _groups(self) -> tuple[tuple[Opcode, Sequence[McapRecord]], ...]:
        """The records of the summary by kind."""
        statistics = Statistics(
            attachment_count=0,
            channel_count=len(self._channels),
            channel_message_counts=dict(self._counts),
            chunk_count=len(self._chunks),
            message_count=self._counts.total(),
            metadata_count=len(self._metadata),
            message_start_time=self._start_ns or 0,
            message_end_time=self._end_ns,
            schema_count=len(self._schemas),
        )
        return (
            (Opcode.SCHEMA, self._schemas),
            (Opcode.CHANNEL, self._channels),
            (Opcode.STATISTICS, [statistics]),
            (Opcode.CHUNK_INDEX, self._chunks),
            (Opcode.ATTACHMENT_INDEX, []),
            (Opcode.METADATA_INDEX, self._metadata),
        )


def _bytes(record: McapRecord) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    return bytes(builder.end())  # type: ignore[no-untyped-call]


def _rows(column: RecordColumn) -> NDArray[np.void] | None:
    """The records of messages of one length; ``None`` of others."""
    if not isinstance(column.payload, np.ndarray):
        return None
    rows = np.empty(
        len(column.payload), np.dtype([('head', _HEAD), ('data', column.payload.dtype)])
    )
    _fill_heads(rows['head'], column, np.arange(len(rows)), column.payload.itemsize)
    rows['data'] = column.payload
    return rows.view(f'V{rows.itemsize}')


def _fill_heads(
    heads: NDArray[np.void], column: RecordColumn, picked: IntArray, size: int | IntArray
) -> None:
    heads['opcode'] = Opcode.MESSAGE
    heads['length'] = size + MESSAGE_HEAD.size
    heads['channel'] = column.channel
    heads['sequence'] = column.sequence + picked
    heads['log_time'] = heads['publish_time'] = column.log_time_ns[picked]


def _place(
    data: NDArray[np.uint8],
    column: RecordColumn,
    rows: NDArray[np.void] | None,
    picked: IntArray,
    offsets: IntArray,
) -> None:
    """Put records of a column where they belong."""
    if rows is not None:
        view = np.ndarray((len(data) - rows.itemsize + 1,), rows.dtype, data.data, strides=(1,))
        view[offsets] = rows[picked]
        return
    payload = [column.payload[k] for k in picked.tolist()]
    heads = np.empty(len(payload), _HEAD)
    _fill_heads(heads, column, picked, np.fromiter(map(len, payload), np.int64, len(payload)))
    raw, target = heads.tobytes(), data.data
    for k, (offset, message) in enumerate(zip(offsets.tolist(), payload, strict=True)):
        begin = offset + PAYLOAD
        target[offset:begin] = raw[k * PAYLOAD : (k + 1) * PAYLOAD]
        target[begin : begin + len(message)] = message
