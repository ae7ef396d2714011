# SPDX-License-Identifier: Apache-2.0
"""Writing a rosbag2 folder or a single MCAP file: all of it, or nothing.

The bytes are those of ``mcap``'s writer, which takes three times as long for a message. All
records but messages and their index are written by the record classes of the ``mcap`` package.
"""

from __future__ import annotations

import contextlib
import itertools
import operator
import os
import shutil
import struct
import zlib
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import IO, Any

import lz4.frame  # type: ignore[import-untyped]
import numpy as np
import yaml
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
from mcap.well_known import MessageEncoding, Profile, SchemaEncoding
from numpy.typing import ArrayLike

from stickslip_monitor.bags.blocks import HEAD, INDEX_HEAD, MAGIC, MESSAGE_HEAD
from stickslip_monitor.bags.encode import MESSAGE_TYPES, MessageType, encode_float64s
from stickslip_monitor.bags.values import METADATA_NAME, METADATA_ROOT
from stickslip_monitor.errors import BagError
from stickslip_monitor.files import hold, open_file, sweep

COMPRESSIONS = {
    'none': ('', lambda data: data),
    'lz4': ('lz4', lz4.frame.compress),
    'zstd': ('zstd', zstandard.compress),
}
# Kind and length of a message's record, channel, number, time of log and publication [ns].
_RECORD = struct.Struct('<BQHIQQ')
# A plain number: members of an enumeration are looked up slowly.
_MESSAGE = int(Opcode.MESSAGE)
_LATEST = (1 << 63) - 1
_SUFFIX = '.mcap'


class McapFile:
    """The records of one file.

    A chunk is closed when it is longer than its size before compression. ``channels`` are by
    topic, ``counts`` the messages of each channel by its id.
    """

    def __init__(self, file: IO[bytes], compression: str, chunk_size: int) -> None:
        self._file = file
        self._compression, self._compress = COMPRESSIONS[compression]
        self._chunk_size = chunk_size
        self._chunk = bytearray()
        # Log time [ns] and place of each message in the chunk, by channel.
        self._index: dict[int, list[int]] = {}
        self._schemas: dict[str, Schema] = {}
        self.channels: dict[str, Channel] = {}
        self._metadata: list[MetadataIndex] = []
        self._chunks: list[ChunkIndex] = []
        self.counts: Counter[int] = Counter()
        file.write(_BEGIN)

    def add_label(self, name: str) -> None:
        """Write a label before the first message."""
        record, offset = _label(name), self._file.tell()
        self._metadata.append(MetadataIndex(offset=offset, length=len(record), name=name))
        self._file.write(record)

    def add_channel(self, topic: str, kind: str, known: MessageType) -> None:
        """Define a channel, and the schema of its type where that is new."""
        if kind not in self._schemas:
            schema = Schema(
                id=len(self._schemas) + 1, data=known.definition.encode(),
                encoding=SchemaEncoding.ROS2, name=kind,
            )  # fmt: skip
            self._schemas[kind] = schema
            self._add(_bytes(schema))
        self.channels[topic] = channel = Channel(
            id=len(self.channels) + 1, topic=topic, message_encoding=MessageEncoding.CDR,
            schema_id=self._schemas[kind].id,
            metadata={'offered_qos_profiles': '', 'topic_type_hash': known.type_hash},
        )  # fmt: skip
        self._add(_bytes(channel))

    def add(self, columns: Iterable[tuple[int, list[int], Sequence[bytes]]]) -> None:
        """Write messages of several channels with their log times, merged by these [ns]."""
        rows: list[tuple[int, int, int, bytes]] = []
        for channel, times, messages in columns:
            first, count = self.counts[channel], len(times)
            numbers = range(first, first + count)
            rows += zip(times, itertools.repeat(channel, count), numbers, messages, strict=True)
            if count:
                self.counts[channel] += count
        rows.sort(key=operator.itemgetter(0))
        for time, channel, number, message in rows:
            self._index.setdefault(channel, []).extend((time, len(self._chunk)))
            length = MESSAGE_HEAD.size + len(message)
            self._add(_RECORD.pack(_MESSAGE, length, channel, number, time, time) + message)

    def _add(self, record: bytes) -> None:
        self._chunk += record
        if len(self._chunk) > self._chunk_size:
            self._close_chunk()

    def _close_chunk(self) -> None:
        """Write the chunk and its index, if it has messages."""
        if not self._index:
            return
        data, times = bytes(self._chunk), [pairs[::2] for pairs in self._index.values()]
        chunk = Chunk(
            compression=self._compression,
            data=self._compress(data),
            message_start_time=min(map(min, times)),
            message_end_time=max(map(max, times)),
            uncompressed_crc=zlib.crc32(data),
            uncompressed_size=len(data),
        )
        record, offset = _bytes(chunk), self._file.tell()
        begin, index, places = offset + len(record), b'', {}
        for channel, pairs in self._index.items():
            places[channel] = begin + len(index)
            body = struct.pack(f'<{len(pairs)}Q', *pairs)
            index += INDEX_HEAD.pack(Opcode.MESSAGE_INDEX, 6 + len(body), channel, len(body))
            index += body
        self._file.write(record + index)
        self._chunks.append(
            ChunkIndex(
                chunk_length=len(record),
                chunk_start_offset=offset,
                compression=chunk.compression,
                compressed_size=len(chunk.data),
                message_end_time=chunk.message_end_time,
                message_index_length=len(index),
                message_index_offsets=places,
                message_start_time=chunk.message_start_time,
                uncompressed_size=chunk.uncompressed_size,
            )
        )
        self._chunk.clear()
        self._index.clear()

    def finish(self) -> Statistics:
        """Write the last chunk and the summary; return what was counted."""
        self._close_chunk()
        self._file.write(_bytes(DataEnd(0)))
        statistics = Statistics(
            attachment_count=0,
            channel_count=len(self.channels),
            channel_message_counts=dict(self.counts),
            chunk_count=len(self._chunks),
            message_count=self.counts.total(),
            metadata_count=len(self._metadata),
            message_start_time=min((c.message_start_time for c in self._chunks), default=0),
            message_end_time=max((c.message_end_time for c in self._chunks), default=0),
            schema_count=len(self._schemas),
        )
        groups: Mapping[Opcode, Collection[McapRecord]] = {
            Opcode.SCHEMA: self._schemas.values(),
            Opcode.CHANNEL: self.channels.values(),
            Opcode.STATISTICS: [statistics],
            Opcode.CHUNK_INDEX: self._chunks,
            Opcode.ATTACHMENT_INDEX: [],
            Opcode.METADATA_INDEX: self._metadata,
        }
        begin, summary, offsets = self._file.tell(), b'', b''
        for opcode, records in groups.items():
            group, start = b''.join(map(_bytes, records)), begin + len(summary)
            offsets += _bytes(SummaryOffset(opcode, start, len(group)))
            summary += group
        offset_begin = begin + len(summary)
        summary += offsets
        places = begin.to_bytes(8, 'little') + offset_begin.to_bytes(8, 'little')
        crc = zlib.crc32(HEAD.pack(Opcode.FOOTER, 20) + places, zlib.crc32(summary))
        footer = Footer(summary_start=begin, summary_offset_start=offset_begin, summary_crc=crc)
        self._file.write(summary + _bytes(footer) + MAGIC)
        return statistics


def _bytes(record: McapRecord) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    return bytes(builder.end())  # type: ignore[no-untyped-call]


def _label(name: str) -> bytes:
    """The record that a recording with a label begins with."""
    return _bytes(Metadata(name=name, metadata={}))


# What every recording begins with. The library is fixed, so that equal recordings are equal files
# whatever version wrote them.
_BEGIN = MAGIC + _bytes(Header(Profile.ROS2, 'stickslip_monitor'))


class BagWriter:
    """Writes a recording, used as a context manager.

    The recording appears under its name when the block ends; if the block raises, nothing stays.
    Equal input gives equal bytes.  Messages lie in the file in the order they were written.

    Args:
        path: A name ending in ``.mcap`` for a single file, any other for a rosbag2 folder.
        compression: ``'zstd'``, ``'lz4'`` or ``'none'``.
        chunk_size: Bytes after which a chunk is closed, before compression.
        label: What the recording is, by which :func:`is_labelled` knows it again.

    Raises:
        BagError: The path exists already, or the compression is unknown.
    """

    def __init__(
        self,
        path: str | Path,
        compression: str = 'zstd',
        chunk_size: int = 1 << 20,
        label: str | None = None,
    ) -> None:
        # What a link leads to, as for every other output.
        self.path = Path(os.path.realpath(path))
        if compression not in COMPRESSIONS:
            known = ', '.join(COMPRESSIONS)
            raise BagError(f"compression '{compression}' is unknown: use one of {known}")
        self._options = compression, chunk_size
        self._is_file = self.path.suffix == _SUFFIX
        self._file_name = f'{self.path.name}_0{_SUFFIX}'
        self._label = label
        self._is_broken = False
        self._types: dict[str, MessageType] = {}
        # The type of each topic.
        self._topics: dict[str, str] = {}
        with self._trouble():
            self._refuse_existing()

    def __enter__(self) -> BagWriter:
        """Begin to write beside the target."""
        with self._trouble():
            for folder in self.path.parents:
                if folder.exists() and not folder.is_dir():
                    raise BagError(
                        f"bag '{self.path}' cannot be written: '{folder}' is a file, not a folder"
                    )
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._draft, self._file = self._begin_draft()
            self._records = McapFile(self._file, *self._options)
            if self._label is not None:
                self._records.add_label(self._label)
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """Finish the recording, or remove what there is of it after an error."""
        try:
            if kind is None:
                with self._trouble():
                    self._finish()
        finally:
            # Closing a file on a full disk fails once more; the draft goes either way.
            with contextlib.suppress(OSError):
                self._file.close()
            os.close(self._held)
            if self._is_file:
                self._draft.unlink(missing_ok=True)
            else:
                shutil.rmtree(self._draft, ignore_errors=True)

    def add_topic(self, name: str, type: str, definition: str | None = None) -> None:  # noqa: A002
        """Add a topic.

        Args:
            name: Its name.
            type: Its message type, e.g. ``std_msgs/msg/Float64``.
            definition: The concatenated ``ros2msg`` definition of a type that is not built in.

        Raises:
            BagError: The topic was added already, or the type needs a definition.
        """
        if name in self._topics:
            raise BagError(f"topic '{name}' was added to bag '{self.path}' already")
        known = MESSAGE_TYPES.get(type) if definition is None else MessageType(definition)
        known = self._types.get(type, known)
        if known is None:
            names = ', '.join(MESSAGE_TYPES)
            raise BagError(f"type '{type}' needs a definition: built in are only {names}")
        self._types[type] = known
        with self._trouble():
            self._records.add_channel(name, type, known)
        self._topics[name] = type

    def write(self, topic: str, log_time_ns: int, data: bytes) -> None:
        """Write one message.

        Args:
            topic: A topic that was added.
            log_time_ns: Log time, also taken as the time of publication [ns].
            data: The message in CDR.

        Raises:
            BagError: Unknown topic, a time out of range, or the disk does not take it.
        """
        self.write_columns([(topic, [log_time_ns], [data])])

    def write_float64s(self, columns: Mapping[str, tuple[ArrayLike, ArrayLike]]) -> None:
        """Write ``std_msgs/Float64`` messages of several topics, merged by their log times.

        Args:
            columns: Log times [ns] and values of each topic, two arrays of shape (n,).

        Raises:
            BagError: As for :meth:`write`, or the two arrays differ in length.
        """
        for name, (time, value) in columns.items():
            if np.ndim(time) != 1 or np.shape(time) != np.shape(value):
                raise BagError(
                    f"topic '{name}' has {np.size(time)} log times for {np.size(value)} values:"
                    ' write one value for each time'
                )
        self.write_columns(
            (n, time, encode_float64s(value)) for n, (time, value) in columns.items()
        )

    def write_columns(self, columns: Iterable[tuple[str, ArrayLike, Sequence[bytes]]]) -> None:
        """Write encoded messages of several topics, merged by their log times.

        Args:
            columns: A topic, log times, shape (n,) [ns], and n messages in CDR; a topic may have
                several columns, one after the other.

        Raises:
            BagError: As for :meth:`write`.
        """
        parts = []
        for name, time, messages in columns:
            times: list[int] = np.asarray(time, np.int64).tolist()
            parts.append((self._channel(name, times), times, messages))
        with self._trouble():
            self._records.add(parts)

    def _channel(self, topic: str, log_times: Collection[int]) -> int:
        """The channel of a topic, for messages with some log times [ns]."""
        if topic not in self._topics:
            raise BagError(f"topic '{topic}' was not added to bag '{self.path}'")
        for log_time in (min(log_times), max(log_times)) if log_times else ():
            if not 0 <= log_time <= _LATEST:
                raise BagError(
                    f"log time {log_time} ns of topic '{topic}' is not between 0 and {_LATEST}"
                )
        return self._records.channels[topic].id

    def break_off(self) -> None:
        """Leave the recording as one that lost power in mid-write; nothing more can be written.

        The record that was being written, as a rule the last chunk, ends half-way; what comes at a
        recording's end is missing.
        """
        with self._trouble():
            begin = self._file.tell()
            self._records.finish()
            self._file.seek(begin)
            head = self._file.read(HEAD.size)
            self._file.truncate(begin + (HEAD.size + HEAD.unpack(head)[1]) // 2)
        self._is_broken = True

    def _refuse_existing(self) -> None:
        if os.path.lexists(self.path):
            raise BagError(f"bag '{self.path}' exists already and is not overwritten")

    def _begin_draft(self) -> tuple[Path, IO[bytes]]:
        sweep(self.path.parent, f'.{self.path.name}')
        for number in itertools.count():
            draft = self.path.with_name(f'.{self.path.name}.{number}.draft')
            with contextlib.suppress(FileExistsError):
                if not self._is_file:
                    draft.mkdir()
                file = (draft if self._is_file else draft / self._file_name).open('x+b')
                self._held = os.open(draft, os.O_RDONLY)
                hold(self._held)
                return draft, file
        raise AssertionError('unreachable: the numbers do not end')

    @property
    def message_counts(self) -> dict[str, int]:
        """Messages written so far, by topic."""
        counts = self._records.counts
        return {topic: counts[channel.id] for topic, channel in self._records.channels.items()}

    def _finish(self) -> None:
        if not self._is_broken:
            statistics = self._records.finish()
            if not self._is_file:
                text = self._metadata(statistics)
                (self._draft / METADATA_NAME).write_text(text, 'utf-8')
        self._file.close()
        self._refuse_existing()
        self._draft.rename(self.path)

    @contextlib.contextmanager
    def _trouble(self) -> Iterator[None]:
        """Say which bag cannot be written."""
        try:
            yield
        except OSError as error:
            raise BagError(
                f"bag '{self.path}' cannot be written: {error.strerror or error}"
            ) from error

    def _metadata(self, statistics: Statistics) -> str:
        """The ``metadata.yaml`` of the recording, in rosbag2's format of version 9."""
        start_ns, end_ns = statistics.message_start_time, statistics.message_end_time

        def span() -> dict[str, Any]:
            # The same object twice would become a YAML alias, which rosbag2's reader need not
            # know.
            return {
                'starting_time': {'nanoseconds_since_epoch': start_ns},
                'duration': {'nanoseconds': end_ns - start_ns},
                'message_count': statistics.message_count,
            }

        listed = [
            {
                'topic_metadata': {
                    'name': topic,
                    'type': kind,
                    'serialization_format': 'cdr',
                    'offered_qos_profiles': [],
                    'type_description_hash': self._types[kind].type_hash,
                },
                'message_count': self.message_counts[topic],
            }
            for topic, kind in self._topics.items()
        ]
        information = {
            'version': 9,
            'storage_identifier': 'mcap',
            **span(),
            'topics_with_message_count': listed,
            'compression_format': '',
            'compression_mode': '',
            'relative_file_paths': [self._file_name],
            'files': [{'path': self._file_name, **span()}],
            'custom_data': None,
            'ros_distro': 'unknown',
        }
        return yaml.safe_dump({METADATA_ROOT: information}, sort_keys=False)


def is_labelled(path: Path, label: str) -> bool:
    """Whether a file is a recording that this package wrote with a label."""
    begin = _BEGIN + _label(label)
    try:
        with open_file(path) as file:
            return not path.is_symlink() and file.read(len(begin)) == begin
    except OSError:
        return False
