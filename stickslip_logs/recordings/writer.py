# SPDX-License-Identifier: Apache-2.0
"""Writing a rosbag2 folder or a single MCAP file, all of it or nothing; and messages in CDR."""

from __future__ import annotations

import contextlib
import functools
import io
import itertools
import os
import shutil
import struct
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np
import yaml
from mcap.well_known import MessageEncoding, Profile, SchemaEncoding
from numpy.typing import ArrayLike, NDArray

from stickslip_logs.errors import BagError, cause
from stickslip_logs.files import DRAFT, lock_draft, open_file, remove_drafts
from stickslip_logs.recordings.chunk_writer import COMPRESSORS, ChunkWriter, Messages
from stickslip_logs.recordings.mcap_chunks import HEAD
from stickslip_logs.recordings.message_types import definition_of
from stickslip_logs.recordings.recording import METADATA_NAME, METADATA_ROOT
from stickslip_logs.units import MIB, SECOND_NS

_SUFFIX = '.mcap'
# Fixed, so that equal recordings are equal files whatever version wrote them.
_LIBRARY = 'stickslip_monitor'
# Of the types that this package writes itself (REP 2016).
TYPE_HASHES = {
    'diagnostic_msgs/msg/DiagnosticArray': '5a8a36efb05fb25070fa0fb3810290c0e6cd4862b54a8fb975a1ee8dc55a333e',
    'geometry_msgs/msg/TwistStamped': '5f0fcd4f81d5d06ad9b4c4c63e3ea51b82d6ae4d0558f1d475229b1121db6f64',
    'geometry_msgs/msg/WrenchStamped': '8dc3deaf06b2ab281f9f9a742a8961c328ca7cec16e3fd6586d3a5c83fa78f77',
    'std_msgs/msg/Bool': 'feb91e995ff9ebd09c0cb3d2aed18b11077585839fb5db80193b62d74528f6c9',
    'std_msgs/msg/Float64': '705ba9c3d1a09df43737eb67095534de36fd426c0587779bda2bc51fe790182a',
    'std_msgs/msg/String': 'df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18',
}


class BagWriter:
    """Writes a recording, used as a context manager.

    The recording appears under its name when the block ends; if the block raises, nothing stays but missing
    folders above it, which are made. Equal input gives equal bytes, in the order in which it was written.

    Args:
        path: A name ending in ``.mcap`` for a single file, any other for a rosbag2 folder.
        compression: ``'zstd'``, ``'lz4'`` or ``'none'``.
        chunk_size: Bytes after which a chunk is closed, before compression.
        label: What the recording is, by which :func:`is_labelled` knows it again; None for nothing.

    Raises:
        BagError: The path exists already, or the compression is unknown; as the block begins, a draft cannot
            be created beside the path; as it ends, the disk does not take the rest: nothing stays.

    >>> import tempfile
    >>> from stickslip_logs.recordings.reader import open_bag
    >>> folder = tempfile.TemporaryDirectory()
    >>> with BagWriter(f'{folder.name}/voyage') as bag:
    ...     bag.add_topic('/shaft/speed', 'std_msgs/msg/Float64')
    ...     bag.write_float64s({'/shaft/speed': ([0, 10**9], [60.0, 61.5])})
    >>> open_bag(f'{folder.name}/voyage').message_count
    2
    """

    def __init__(
        self, path: str | Path, compression: str = 'zstd', chunk_size: int = MIB, label: str | None = None
    ) -> None:
        # What a link leads to, as for every other output.
        self.path = Path(os.path.realpath(path))
        if compression not in COMPRESSORS:
            names = ', '.join(COMPRESSORS)
            raise BagError(f"compression '{compression}' is unknown: use one of {names}")
        self._options = chunk_size, compression
        self._is_file = self.path.suffix == _SUFFIX
        self._file_name = f'{self.path.name}_0{_SUFFIX}'
        self._label = label
        self._is_broken = False
        self._schemas: dict[str, int] = {}
        self._hashes: dict[str, str] = {}
        # The type and the channel of each topic.
        self._topics: dict[str, tuple[str, int]] = {}
        self._refuse_existing()

    def __enter__(self) -> BagWriter:
        """Begin to write beside the target."""
        with self._name_bag_in_errors():
            for folder in self.path.parents:
                if folder.exists() and not folder.is_dir():
                    raise BagError(f"bag '{self.path}' cannot be written: '{folder}' is a file, not a folder")
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._draft, self._file = self._begin_draft()
            self._writer = _begin_file(self._file, self._label, *self._options)
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """Finish the recording, or remove what there is of it after an error."""
        try:
            if kind is None:
                with self._name_bag_in_errors():
                    self._publish_draft()
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
            definition: The concatenated ``ros2msg`` definition of a type that is not built in, None for one
                that is; of a type that another topic has the first one counts. It is not checked.

        Raises:
            BagError: The topic was added already, the type needs a definition, or the disk does not take it.
        """
        if name in self._topics:
            raise BagError(f"topic '{name}' was added to bag '{self.path}' already")
        standard = definition_of(type)
        text = standard if definition is None else definition
        if type not in self._schemas:
            if text is None:
                raise BagError(f"type '{type}' needs a definition: it is not built in")
            type_hash = f'RIHS01_{TYPE_HASHES[type]}' if type in TYPE_HASHES and text == standard else ''
            self._hashes[type] = type_hash
            with self._name_bag_in_errors():
                self._schemas[type] = self._writer.add_schema(type, SchemaEncoding.ROS2, text.encode())
        with self._name_bag_in_errors():
            facts = {'offered_qos_profiles': '', 'topic_type_hash': self._hashes[type]}
            channel = self._writer.add_channel(name, MessageEncoding.CDR, self._schemas[type], facts)
        self._topics[name] = type, channel

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
        """Write ``std_msgs/Float64`` messages of topics, added with this type, merged by their log times.

        Args:
            columns: Log times [ns] and values of each topic, two arrays of shape (n,).

        Raises:
            BagError: As for :meth:`write`, or the two arrays differ in length.
        """
        self.write_columns((n, time, float64_rows(value)) for n, (time, value) in columns.items())

    def write_columns(self, columns: Iterable[tuple[str, ArrayLike, Messages]]) -> None:
        """Write encoded messages of several topics, merged by their log times.

        Args:
            columns: A topic, log times, shape (n,) [ns], and n messages in CDR; a topic may have
                several columns, one after the other.

        Raises:
            BagError: As for :meth:`write`, or a topic has another number of times than messages. Then nothing
                is written, unless the disk is the cause.
        """
        encoded = []
        for name, time, messages in columns:
            if name not in self._topics:
                raise BagError(f"topic '{name}' was not added to bag '{self.path}'")
            beyond = f"of topic '{name}' is not between 0 and {(1 << 63) - 1}"
            try:
                times = np.asarray(time, np.int64)
            except OverflowError:
                raise BagError(f'a log time {beyond} ns') from None
            for log_time in times[times < 0][:1].tolist():
                raise BagError(f'log time {log_time} ns {beyond}')
            if len(messages) != times.size:
                raise BagError(f"topic '{name}' has {times.size} log times for {len(messages)} messages")
            if times.size:
                encoded.append((self._topics[name][1], times, messages))
        if encoded:
            with self._name_bag_in_errors():
                self._writer.write(encoded)

    def break_off(self) -> None:
        """End the recording like one that lost power while it was written; nothing more can be written.

        The record that was being written, as a rule the last chunk, ends half-way; the summary and the
        ``metadata.yaml`` are missing.

        Raises:
            BagError: The disk does not take it.
        """
        with self._name_bag_in_errors():
            begin = self._file.tell()
            self._writer.finish()
            self._file.seek(begin)
            head = self._file.read(HEAD.size)
            self._file.truncate(begin + (HEAD.size + HEAD.unpack(head)[1]) // 2)
        self._is_broken = True

    def _refuse_existing(self) -> None:
        """Raise a BagError where the path of the bag exists, be it a link that leads nowhere."""
        if os.path.lexists(self.path):
            raise BagError(f"bag '{self.path}' exists already and is not overwritten")

    def _begin_draft(self) -> tuple[Path, IO[bytes]]:
        """Create a hidden draft beside the target, and lock it if that works; delete drafts that others left.

        ``_held`` becomes the descriptor of the lock.

        Returns:
            The draft (a file or a folder), and the open file in it.

        Raises:
            OSError: It cannot be created.
        """
        remove_drafts(self.path.parent, f'.{self.path.name}')
        draft = self.path.with_name(f'.{self.path.name}.{os.urandom(8).hex()}{DRAFT}')
        if not self._is_file:
            draft.mkdir()
        file = (draft if self._is_file else draft / self._file_name).open('x+b')
        self._held = os.open(draft, os.O_RDONLY)
        lock_draft(self._held)
        return draft, file

    @property
    def message_counts(self) -> dict[str, int]:
        """Messages written so far, by topic."""
        return {topic: self._writer.counts.get(channel, 0) for topic, (_, channel) in self._topics.items()}

    def _publish_draft(self) -> None:
        """Finish and close the file, write the metadata of a folder, and move the draft to its place.

        A recording that was broken off is only closed and moved.

        Raises:
            BagError: The path exists by now.
            OSError: The disk does not take it.
        """
        if not self._is_broken:
            self._writer.finish()
            if not self._is_file:
                (self._draft / METADATA_NAME).write_text(self._render_metadata(), 'utf-8')
        self._file.close()
        self._refuse_existing()
        if self._is_file:
            # A link, unlike a rename, never replaces what another process has put there meanwhile.
            try:
                os.link(self._draft, self.path)
                return
            except FileExistsError:
                self._refuse_existing()
            except OSError:
                pass  # a file system without links
        self._draft.rename(self.path)

    @contextlib.contextmanager
    def _name_bag_in_errors(self) -> Iterator[None]:
        """Raise an OSError of the context as a BagError that names the bag."""
        try:
            yield
        except OSError as error:
            raise BagError(f"bag '{self.path}' cannot be written: {cause(error)}") from error

    def _render_metadata(self) -> str:
        """Return the ``metadata.yaml`` in rosbag2's format of version 9; times are 0 without messages."""
        (start_ns, end_ns), counts = self._writer.span, self.message_counts

        def span() -> dict[str, Any]:
            """Return start, duration and number of messages, in a new object each time."""
            # The same object twice would become a YAML alias, which rosbag2's reader need not know.
            return {
                'starting_time': {'nanoseconds_since_epoch': start_ns},
                'duration': {'nanoseconds': end_ns - start_ns},
                'message_count': sum(counts.values()),
            }

        listed = [
            {
                'topic_metadata': {
                    'name': topic,
                    'type': kind,
                    'serialization_format': 'cdr',
                    'offered_qos_profiles': [],
                    'type_description_hash': self._hashes[kind],
                },
                'message_count': counts[topic],
            }
            for topic, (kind, _) in self._topics.items()
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


def _begin_file(
    file: IO[bytes], label: str | None, chunk_size: int = 0, compression: str = 'none'
) -> ChunkWriter:
    """Write the head of a file, and its label unless None; return the writer of the rest, in such chunks."""
    writer = ChunkWriter(file, chunk_size, compression)
    writer.start(Profile.ROS2, _LIBRARY)
    if label is not None:
        writer.add_metadata(label)
    return writer


def is_labelled(path: Path, label: str) -> bool:
    """Return whether a file is a recording that this package wrote with a label.

    False for a link, and for a file that cannot be read.
    """
    begin = io.BytesIO()
    _begin_file(begin, label)
    try:
        with open_file(path) as file:
            return not path.is_symlink() and file.read(begin.tell()) == begin.getvalue()
    except OSError:
        return False


# Message types that are a header and some numbers, with the paths of those.
STAMPED_FIELDS: Mapping[str, tuple[str, ...]] = {
    f'geometry_msgs/msg/{name.title()}Stamped': tuple(
        f'{name}.{part}.{axis}' for part in parts for axis in 'xyz'
    )
    for name, parts in (('twist', ('linear', 'angular')), ('wrench', ('force', 'torque')))
}
# All types of which numbers can be written by the column.
NUMBER_FIELDS: Mapping[str, tuple[str, ...]] = {'std_msgs/msg/Float64': ('data',), **STAMPED_FIELDS}
STAMP_END = (1 << 31) * SECOND_NS
"""End of the range of a stamp, whose seconds are a signed number of 32 bits [ns]."""
_CDR = b'\x00\x01\x00\x00'
# What fills a length of 4 k + 0 to 3 bytes to a multiple of four.
_PADS = b'', bytes(3), bytes(2), bytes(1)


def encode_float64s(values: ArrayLike) -> list[bytes]:
    """Encode ``std_msgs/Float64`` messages of n numbers.

    >>> encode_float64s([0.5])[0].hex()
    '00010000000000000000e03f'
    """
    return _split_rows(float64_rows(values))


def float64_rows(values: ArrayLike) -> NDArray[np.void]:
    """Encode ``std_msgs/Float64`` messages of n numbers in CDR, as an array of shape (n,).

    An array is written faster than the list of :func:`encode_float64s`.
    """
    numbers = np.asarray(values, '<f8')
    rows = np.empty(numbers.shape, np.dtype([('head', 'V4'), ('data', '<f8')]))
    rows['head'], rows['data'] = np.void(_CDR), numbers
    return rows


def encode_stamped(type_name: str, field: str, stamp_ns: ArrayLike, values: ArrayLike) -> list[bytes]:
    """Encode n messages that are a header, with an empty frame, and some numbers, in CDR.

    Args:
        type_name: The type, one of ``STAMPED_FIELDS``.
        field: Path of the number that is written, one of the type's; the others are zero.
        stamp_ns: Stamps from 1970 to 2038, shape (n,) [ns].
        values: The numbers, shape (n,).

    Raises:
        BagError: A stamp is out of range.
    """
    fields = STAMPED_FIELDS[type_name]
    stamp = np.asarray(stamp_ns, np.int64)
    for beyond in stamp[(stamp < 0) | (stamp >= STAMP_END)][:1].tolist():
        raise BagError(f"stamp {beyond} ns is not between 0 and {STAMP_END} ns, the range of a ROS header's")
    # The empty frame is a length of one and a zero, then comes padding to a multiple of eight.
    layout = [('head', 'V4'), ('sec', '<i4'), ('nanosec', '<u4'), ('frame', '<u8')]
    rows = np.zeros(stamp.size, np.dtype([*layout, ('numbers', '<f8', len(fields))]))
    rows['head'], rows['frame'] = np.void(_CDR), 1
    rows['sec'], rows['nanosec'] = stamp // SECOND_NS, stamp % SECOND_NS
    rows['numbers'][:, fields.index(field)] = values
    return _split_rows(rows)


def _split_rows(rows: NDArray[np.void]) -> list[bytes]:
    """Return the bytes of each row of a structured array."""
    items: list[bytes] = rows.view(f'V{rows.itemsize}').tolist()
    return items


def encode_bool(value: bool) -> bytes:
    """Encode one ``std_msgs/Bool`` message."""
    return _CDR + struct.pack('<?', value)


def encode_string(text: str) -> bytes:
    """Encode one ``std_msgs/String`` message."""
    return _CDR + _encode_text(text)


@functools.lru_cache(1024)  # of diagnostics most are the same every second
def _encode_text(text: str) -> bytes:
    """Return a text as CDR has it: its length in bytes with the zero behind it, the bytes, and the zero."""
    raw = text.encode() + b'\0'
    return struct.pack('<I', len(raw)) + raw


@dataclass(frozen=True, slots=True)
class StatusFields:
    """The fields of a ``diagnostic_msgs/DiagnosticStatus``."""

    level: int
    name: str
    message: str
    hardware_id: str
    values: Mapping[str, str]


def encode_diagnostics(stamp_ns: int, statuses: Sequence[StatusFields]) -> bytes:
    """Encode a ``diagnostic_msgs/DiagnosticArray`` in CDR: a stamp before 2038 [ns], and an empty frame."""
    body = bytearray(struct.pack('<iI', stamp_ns // SECOND_NS, stamp_ns % SECOND_NS))

    def put(item: bytes) -> None:
        """Append a number of four bytes, or a text, which begins with one, padded to a multiple of four."""
        body.extend(_PADS[len(body) % 4])
        body.extend(item)

    put(_encode_text(''))
    put(struct.pack('<I', len(statuses)))
    for status in statuses:
        body.append(status.level)
        for text in (status.name, status.message, status.hardware_id):
            put(_encode_text(text))
        put(struct.pack('<I', len(status.values)))
        for text in itertools.chain.from_iterable(status.values.items()):
            put(_encode_text(text))
    return _CDR + bytes(body)
