# SPDX-License-Identifier: Apache-2.0
"""Writing a rosbag2 folder or a single MCAP file: all of it, or nothing."""

from __future__ import annotations

import contextlib
import io
import itertools
import shutil
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import IO

import numpy as np
from mcap.records import Header, Metadata
from mcap.stream_reader import StreamReader
from mcap.well_known import MessageEncoding, SchemaEncoding
from numpy.typing import ArrayLike

from stickslip_monitor.bags.encode import MESSAGE_TYPES, MessageType, encode_float64s
from stickslip_monitor.bags.mcap_file import COMPRESSIONS, McapFile, RecordColumn
from stickslip_monitor.bags.metadata import FILE_NAME, TopicEntry, render_metadata
from stickslip_monitor.bags.records import HEAD, PARSE_ERRORS
from stickslip_monitor.bags.values import Payload
from stickslip_monitor.errors import BagError
from stickslip_monitor.files import open_file

# Fixed, so that equal recordings are equal files whatever version wrote them.
_LIBRARY = 'stickslip_monitor'
# Within this much of a file its label ends, if it has one [bytes].
_BEGIN = 512

_LATEST = (1 << 63) - 1
_SUFFIX = '.mcap'


@dataclass(slots=True)
class _Topic:
    channel: int
    type: str
    type_hash: str
    count: int = 0


class BagWriter:
    """Writes a recording, used as a context manager.

    The recording appears under its name when the block ends; if the block raises, nothing stays.
    Equal input gives equal bytes.  Messages lie in the file in the order they were written.
    """

    def __init__(
        self,
        path: str | Path,
        compression: str = 'zstd',
        chunk_size: int = 1 << 20,
        label: str | None = None,
    ) -> None:
        """Choose what to write.

        Args:
            path: A name ending in ``.mcap`` for a single file, any other for a rosbag2 folder.
            compression: ``'zstd'``, ``'lz4'`` or ``'none'``.
            chunk_size: Bytes after which a chunk is closed, before compression.
            label: What the recording is, by which :func:`is_labelled` knows it again.

        Raises:
            BagError: The path exists already, or the compression is unknown.
        """
        self.path = Path(path)
        if compression not in COMPRESSIONS:
            known = ', '.join(COMPRESSIONS)
            raise BagError(f"compression '{compression}' is unknown: use one of {known}")
        self._compression = compression
        self._chunk_size = chunk_size
        self._is_file = self.path.suffix == _SUFFIX
        self._label = label
        self._is_broken = False
        self._topics: dict[str, _Topic] = {}
        self._schemas: dict[str, tuple[int, MessageType]] = {}
        self._start_ns = _LATEST
        self._end_ns = 0
        with self._trouble():
            self._refuse_existing()

    def __enter__(self) -> BagWriter:
        """Begin to write beside the target."""
        with self._trouble():
            self._make_parent()
            self._draft, self._file = self._begin_draft()
            self._records = McapFile(self._file, self._compression, self._chunk_size, _LIBRARY)
            if self._label is not None:
                self._records.add_metadata(self._label)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Finish the recording, or remove what there is of it after an error."""
        try:
            if kind is None:
                with self._trouble():
                    self._finish()
        finally:
            self._clear()

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
        if type not in self._schemas:
            self._schemas[type] = self._register(type, definition)
        schema, message_type = self._schemas[type]
        metadata = {'offered_qos_profiles': '', 'topic_type_hash': message_type.type_hash}
        with self._trouble():
            channel = self._records.add_channel(name, MessageEncoding.CDR, schema, metadata)
        self._topics[name] = _Topic(channel, type, message_type.type_hash)

    def write(self, topic: str, log_time_ns: int, data: bytes) -> None:
        """Write one message.

        Args:
            topic: A topic that was added.
            log_time_ns: Log time, also taken as the time of publication [ns].
            data: The message in CDR.

        Raises:
            BagError: Unknown topic, a time out of range, or the disk does not take it.
        """
        entry = self._entry(topic)
        self._widen(topic, log_time_ns, log_time_ns)
        with self._trouble():
            self._records.add(entry.channel, entry.count, log_time_ns, data)
        entry.count += 1

    def write_float64(self, topic: str, log_time_ns: ArrayLike, value: ArrayLike) -> None:
        """Write ``std_msgs/Float64`` messages of one topic; see :meth:`write_float64s`."""
        self.write_float64s({topic: (log_time_ns, value)})

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
        self.write_merged(
            {name: (time, encode_float64s(value)) for name, (time, value) in columns.items()}
        )

    def write_merged(self, columns: Mapping[str, tuple[ArrayLike, Payload]]) -> None:
        """Write encoded messages of several topics, merged by their log times.

        Args:
            columns: Log times, shape (n,) [ns], and n messages in CDR of each topic.

        Raises:
            BagError: As for :meth:`write`.
        """
        self.write_columns((name, *column) for name, column in columns.items())

    def write_columns(self, columns: Iterable[tuple[str, ArrayLike, Payload]]) -> None:
        """The same; a topic may have several columns, each in order."""
        parts = []
        for name, time, payload in columns:
            entry, log_time = self._entry(name), np.asarray(time, np.int64)
            if log_time.size:
                self._widen(name, int(log_time.min()), int(log_time.max()))
            parts.append(RecordColumn(entry.channel, entry.count, log_time, payload))
            entry.count += log_time.size
        with self._trouble():
            self._records.add_merged(parts)

    def _widen(self, topic: str, first_ns: int, last_ns: int) -> None:
        """Widen the span of the recording by that of some messages."""
        for log_time in (first_ns, last_ns):
            if not 0 <= log_time <= _LATEST:
                raise BagError(
                    f"log time {log_time} ns of topic '{topic}' is not between 0 and {_LATEST}"
                )
        self._start_ns = min(self._start_ns, first_ns)
        self._end_ns = max(self._end_ns, last_ns)

    def break_off(self) -> None:
        """Leave the recording as one that lost power in mid-write; nothing more can be written.

        The record that was being written, as a rule the last chunk, ends half-way; what comes at a
        recording's end is missing.
        """
        with self._trouble():
            self._records.drain()
            begin = self._file.tell()
            self._records.finish()
            self._file.seek(begin)
            head = self._file.read(HEAD.size)
            self._file.truncate(begin + (HEAD.size + HEAD.unpack(head)[1]) // 2)
        self._is_broken = True

    def _entry(self, topic: str) -> _Topic:
        if topic not in self._topics:
            raise BagError(f"topic '{topic}' was not added to bag '{self.path}'")
        return self._topics[topic]

    def _register(self, type_name: str, definition: str | None) -> tuple[int, MessageType]:
        known = MESSAGE_TYPES.get(type_name)
        if definition is not None:
            known = MessageType(definition)
        if known is None:
            names = ', '.join(MESSAGE_TYPES)
            raise BagError(f"type '{type_name}' needs a definition: built in are only {names}")
        with self._trouble():
            schema = self._records.add_schema(
                type_name, SchemaEncoding.ROS2, known.definition.encode()
            )
        return schema, known

    def _make_parent(self) -> None:
        for folder in self.path.parents:
            if folder.exists() and not folder.is_dir():
                raise BagError(
                    f"bag '{self.path}' cannot be written: '{folder}' is a file, not a folder"
                )
        self.path.parent.mkdir(parents=True, exist_ok=True)

    def _refuse_existing(self) -> None:
        if self.path.exists():
            raise BagError(f"bag '{self.path}' exists already and is not overwritten")

    def _begin_draft(self) -> tuple[Path, IO[bytes]]:
        for number in itertools.count():
            draft = self.path.with_name(f'.{self.path.name}.{number}.draft')
            with contextlib.suppress(FileExistsError):
                if self._is_file:
                    return draft, draft.open('x+b')
                draft.mkdir()
                return draft, (draft / self._file_name).open('x+b')
        raise AssertionError('unreachable: the numbers do not end')

    @property
    def message_counts(self) -> dict[str, int]:
        """Messages written so far, by topic."""
        return {name: topic.count for name, topic in self._topics.items()}

    @property
    def _file_name(self) -> str:
        return f'{self.path.name}_0{_SUFFIX}'

    def _finish(self) -> None:
        if not self._is_broken:
            self._records.finish()
        self._file.close()
        if not (self._is_file or self._is_broken):
            topics = [
                TopicEntry(name, topic.type, topic.type_hash, topic.count)
                for name, topic in self._topics.items()
            ]
            text = render_metadata(
                self._file_name, min(self._start_ns, self._end_ns), self._end_ns, topics
            )
            (self._draft / FILE_NAME).write_text(text, 'utf-8')
        self._refuse_existing()
        self._draft.rename(self.path)

    def _clear(self) -> None:
        self._records.close()
        # Closing a file on a full disk fails once more; the draft goes either way.
        with contextlib.suppress(OSError):
            self._file.close()
        if self._is_file:
            self._draft.unlink(missing_ok=True)
        else:
            shutil.rmtree(self._draft, ignore_errors=True)

    @contextlib.contextmanager
    def _trouble(self) -> Iterator[None]:
        """Say which bag cannot be written."""
        try:
            yield
        except OSError as error:
            raise BagError(
                f"bag '{self.path}' cannot be written: {error.strerror or error}"
            ) from error


def is_labelled(path: Path, label: str) -> bool:
    """Whether a file is a recording that this package wrote with a label."""
    try:
        if path.is_symlink():
            return False
        with open_file(path) as file:
            stream = StreamReader(io.BytesIO(file.read(_BEGIN)), emit_chunks=True)
            header, record = itertools.islice(stream.records, 2)
    except (OSError, *PARSE_ERRORS):
        return False
    ours = isinstance(header, Header) and header.library == _LIBRARY
    return ours and isinstance(record, Metadata) and record.name == label
