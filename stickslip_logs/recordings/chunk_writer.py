# SPDX-License-Identifier: Apache-2.0
"""Writes the container of a recording: MCAP in compressed chunks with an index, by the column.

Its bytes are those of ``mcap.writer.Writer``, which takes messages one by one; here the records of many
messages are laid into one buffer by numpy. All other records are encoded by the ``mcap`` package.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
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
from numpy.typing import NDArray

from stickslip_logs.arrays import IndexArray, IntArray
from stickslip_logs.recordings.mcap_chunks import HEAD, MAGIC, MESSAGE_HEAD

COMPRESSORS = {'none': bytes, 'lz4': lz4.frame.compress, 'zstd': zstandard.compress}
Messages = Sequence[bytes] | NDArray[np.void]
"""Messages of one topic: of any sizes, or of one as the rows of an array."""

_HEAD = [
    ('opcode', '<u1'),
    ('length', '<u8'),
    ('channel', '<u2'),
    ('sequence', '<u4'),
    ('log_time', '<u8'),
    ('publish_time', '<u8'),
]
_INDEX = np.dtype([('log_time', '<u8'), ('offset', '<u8')])


class ChunkWriter:
    """Writes chunks of messages and, at the end, the index of the file; :meth:`start` comes first.

    Methods that write raise OSError where the file takes no more.

    Args:
        file: Where to, open for writing at its beginning; not closed.
        chunk_size: Bytes after which a chunk is closed, before compression.
        compression: One of ``COMPRESSORS``.
    """

    def __init__(self, file: IO[bytes], chunk_size: int, compression: str) -> None:
        self._file, self._chunk_size, self._compression = file, chunk_size, compression
        self._schemas: list[Schema] = []
        self._channels: list[Channel] = []
        self._metadata: list[MetadataIndex] = []
        self._chunks: list[ChunkIndex] = []
        self.counts: dict[int, int] = {}
        """Messages of each channel that has some."""
        self.span = 0, 0
        """The least and the greatest log time, 0 and 0 without messages [ns]."""
        self._begin_chunk()

    def start(self, profile: str, library: str) -> None:
        """Write the magic bytes and the header, before all else: the profile, and who writes the file."""
        self._file.write(MAGIC + _encode_records(Header(profile, library)))

    def add_metadata(self, name: str) -> None:
        """Write a metadata record without contents at once; call it before the first message is added."""
        offset, data = self._file.tell(), _encode_records(Metadata(name=name, metadata={}))
        self._file.write(data)
        self._metadata.append(MetadataIndex(offset=offset, length=len(data), name=name))

    def add_schema(self, name: str, encoding: str, data: bytes) -> int:
        """Append a type's definition to the unfinished chunk; return its id, new in each call, from 1.

        As with :meth:`add_channel`, a chunk that becomes full and has messages is written.
        """
        self._schemas.append(Schema(id=len(self._schemas) + 1, name=name, encoding=encoding, data=data))
        self._add_definition(self._schemas[-1])
        return len(self._schemas)

    def add_channel(self, topic: str, encoding: str, schema: int, metadata: Mapping[str, str]) -> int:
        """Append a channel to the unfinished chunk; return its id, new in each call, from 1.

        ``schema`` is an id that :meth:`add_schema` returned. A chunk that becomes full is written.
        """
        number = len(self._channels) + 1
        self._channels.append(Channel(number, topic, encoding, dict(metadata), schema))
        self._add_definition(self._channels[-1])
        return number

    def write(self, columns: Sequence[tuple[int, IntArray, Messages]]) -> None:
        """Append messages to chunks by log time, then by column; write each chunk that becomes full.

        The messages of the columns are sorted among each other, not with those of earlier calls. They are
        added to ``counts`` and ``span``. The log time is the time of publication too.

        Args:
            columns: For each column a channel id, log times, shape (n,) [ns], and n messages; at least one
                message in all.
        """
        log_time = np.concatenate([time for _, time, _ in columns])
        order = np.argsort(log_time, kind='stable')
        channel = np.repeat([number for number, *_ in columns], [time.size for _, time, _ in columns])
        sequence = self._assign_sequence(channel, order)
        parts = list(_make_records(messages for *_, messages in columns))
        size = np.empty(log_time.size, np.int64)
        for rows, records in parts:
            size[rows] = records.dtype.itemsize
        ends = np.cumsum(size[order])
        begins = np.empty_like(size)
        begins[order] = ends - size[order]
        block = np.empty(int(ends[-1]), np.uint8)
        for rows, records in parts:
            records['channel'], records['sequence'] = channel[rows], sequence[rows]
            records['log_time'] = records['publish_time'] = log_time[rows]
            # A view of the block in which an item of their size begins at every byte.
            kind = f'V{records.dtype.itemsize}'
            count = block.size - records.dtype.itemsize + 1
            np.ndarray(count, kind, block.data, strides=(1,))[begins[rows]] = records.view(kind)
        self._append_records(block, ends, channel[order], log_time[order])

    def finish(self) -> None:
        """Write the unfinished chunk, unless it is without messages, and the summary; leave the file open."""
        self._write_chunk()
        self._file.write(_encode_records(DataEnd(0)))
        begin, summary, offsets = self._file.tell(), b'', []
        statistics = Statistics(
            attachment_count=0,
            channel_count=len(self._channels),
            channel_message_counts=self.counts,
            chunk_count=len(self._chunks),
            message_count=sum(self.counts.values()),
            message_end_time=self.span[1],
            message_start_time=self.span[0],
            metadata_count=len(self._metadata),
            schema_count=len(self._schemas),
        )
        groups: Mapping[Opcode, Sequence[McapRecord]] = {
            Opcode.SCHEMA: self._schemas,
            Opcode.CHANNEL: self._channels,
            Opcode.STATISTICS: [statistics],
            Opcode.CHUNK_INDEX: self._chunks,
            Opcode.ATTACHMENT_INDEX: [],
            Opcode.METADATA_INDEX: self._metadata,
        }
        for opcode, records in groups.items():
            data = _encode_records(*records)
            offsets.append(SummaryOffset(opcode, begin + len(summary), len(data)))
            summary += data
        places = begin, begin + len(summary)
        summary += _encode_records(*offsets)
        # The checksum is that of all before it, the beginning of its own record included.
        checksum = zlib.crc32(summary + _encode_records(Footer(*places, 0))[:-4])
        self._file.write(summary + _encode_records(Footer(*places, checksum)) + MAGIC)

    def _assign_sequence(self, channel: IndexArray, order: IndexArray) -> IntArray:
        """Return the sequence number of each message within its channel, from 0; add to ``counts``.

        Args:
            channel: The channel id of each message, shape (n,).
            order: The messages in the order of the file, shape (n,).
        """
        sequence = np.empty(order.size, np.int64)
        for number, places in _group_by_channel(channel[order]):
            rows = order[places]
            before = self.counts.get(number, 0)
            sequence[rows] = before + np.arange(rows.size)
            self.counts[number] = before + rows.size
        return sequence

    def _append_records(
        self, block: NDArray[np.uint8], ends: IntArray, channel: IndexArray, log_time: IntArray
    ) -> None:
        """Append encoded records, with their index, to chunks; write each full chunk, and widen ``span``.

        Args:
            block: The records, one after the other.
            ends: The byte behind each of the n > 0 records, shape (n,).
            channel: The channel id of each, shape (n,).
            log_time: The log time of each, rising [ns], shape (n,).
        """
        first, greatest = int(log_time[0]), int(log_time[-1])
        start, end = self.span if self._chunks or self._index else (first, greatest)
        self.span = min(start, first), max(end, greatest)
        row = begin = 0
        while row < ends.size:
            room = begin + self._chunk_size - len(self._chunk_records)
            after = min(max(row, int(np.searchsorted(ends, room, 'right'))) + 1, ends.size)
            rows = slice(row, after)
            starts = np.append(begin, ends[row : after - 1]) - begin + len(self._chunk_records)
            for number, members in _group_by_channel(channel[rows]):
                places = np.empty(members.size, _INDEX)
                places['log_time'], places['offset'] = log_time[rows][members], starts[members]
                self._index.setdefault(number, []).append(places)
            self._chunk_records += block[begin : ends[after - 1]].data
            row, begin = after, int(ends[after - 1])
            self._write_full_chunk()

    def _add_definition(self, record: McapRecord) -> None:
        """Append a schema or channel to the unfinished chunk; write the chunk if it becomes full."""
        self._chunk_records += _encode_records(record)
        self._write_full_chunk()

    def _begin_chunk(self) -> None:
        """Begin an empty chunk; drop what the unfinished one holds."""
        self._chunk_records = bytearray()
        self._index: dict[int, list[NDArray[np.void]]] = {}

    def _write_full_chunk(self) -> None:
        """Write the unfinished chunk if it is full."""
        if len(self._chunk_records) > self._chunk_size:
            self._write_chunk()

    def _write_chunk(self) -> None:
        """Write the unfinished chunk and its indexes, and begin the next; do nothing without a message."""
        if not self._index:
            return
        records = bytes(self._chunk_records)
        times = np.concatenate(
            [rows['log_time'] for index_data in self._index.values() for rows in index_data]
        )
        data = COMPRESSORS[self._compression](records)
        chunk = Chunk(
            compression='' if self._compression == 'none' else self._compression,
            data=data,
            message_start_time=int(times.min()),
            message_end_time=int(times.max()),
            uncompressed_crc=zlib.crc32(records),
            uncompressed_size=len(records),
        )
        begin = self._file.tell()
        length = self._file.write(_encode_records(chunk))
        index, offsets = bytearray(), dict[int, int]()
        for channel, places in self._index.items():
            offsets[channel] = begin + length + len(index)
            index_data = b''.join(part.tobytes() for part in places)
            index += HEAD.pack(Opcode.MESSAGE_INDEX, 6 + len(index_data))
            index += channel.to_bytes(2, 'little') + len(index_data).to_bytes(4, 'little') + index_data
        self._file.write(index)
        self._chunks.append(
            ChunkIndex(
                message_start_time=chunk.message_start_time,
                message_end_time=chunk.message_end_time,
                chunk_start_offset=begin,
                chunk_length=length,
                message_index_offsets=offsets,
                message_index_length=len(index),
                compression=chunk.compression,
                compressed_size=len(data),
                uncompressed_size=len(records),
            )
        )
        self._begin_chunk()


def _group_by_channel(channel: IndexArray) -> Iterator[tuple[int, IndexArray]]:
    """Yield each channel id and its messages (indexes into the array), by first appearance."""
    numbers, first = np.unique(channel, return_index=True)
    for number in numbers[np.argsort(first)].tolist():
        yield number, np.flatnonzero(channel == number)


def _encode_records(*records: McapRecord) -> bytes:
    """Return the bytes of records as they lie in a file, one after the other."""
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    data: bytes = builder.end()  # type: ignore[no-untyped-call]
    return data


def _make_records(columns: Iterable[Messages]) -> Iterator[tuple[IndexArray, NDArray[np.void]]]:
    """Yield records of messages of one size each; channel, sequence and times are still to be filled in.

    Yields:
        The rows of the messages among those of all columns, and their records, shape (m,) each.
    """
    row = 0
    for messages in columns:
        if isinstance(messages, np.ndarray):
            yield row + np.arange(messages.size), _frame_records(messages.view(f'V{messages.itemsize}'))
        else:
            sizes = np.fromiter(map(len, messages), np.int64, len(messages))
            for size in np.unique(sizes).tolist():
                rows = np.flatnonzero(sizes == size)
                joined = b''.join(
                    messages if rows.size == sizes.size else [messages[k] for k in rows.tolist()]
                )
                data = np.frombuffer(joined, f'V{size}') if size else np.empty(rows.size, 'V0')
                yield row + rows, _frame_records(data)
        row += len(messages)


def _frame_records(data: NDArray[np.void]) -> NDArray[np.void]:
    """Return message records with opcode, length and data, shape (n,); the other fields are uninitialized.

    Args:
        data: The messages, all of one size, shape (n,).
    """
    records = np.empty(data.size, [*_HEAD, ('data', data.dtype)])
    records['opcode'], records['length'] = Opcode.MESSAGE, MESSAGE_HEAD.size + data.itemsize
    records['data'] = data
    return records
