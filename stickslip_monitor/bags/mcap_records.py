# SPDX-License-Identifier: Apache-2.0
"""Numbers at any byte of a buffer, aligned or not.

Views over the records of an MCAP data section: where each begins, and what it is.

The records themselves are parsed by the ``mcap`` package.
"""

from __future__ import annotations

import re
import struct
from array import array
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from io import BytesIO
from typing import IO, Any

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Schema
from numpy.typing import NDArray

from stickslip_monitor.arrays import IntArray


def view(data: bytes, code: str) -> NDArray[Any]:
    """View a buffer as one number at every byte.

    Args:
        data: The buffer.
        code: numpy type of the number, with its byte order.

    Returns:
        An array in which element k is the number that begins at byte k; no copy.
    """
    dtype = np.dtype(code)
    count = max(len(data) - dtype.itemsize + 1, 0)
    return np.ndarray((count,), dtype, data, strides=(1,))


MAGIC = b'\x89MCAP0\r\n'
HEAD = struct.Struct('<BQ')
MESSAGE_HEAD = struct.Struct('<HIQQ')
PAYLOAD = HEAD.size + MESSAGE_HEAD.size

_NOTHING = np.empty(0, np.int64)
_ZEROS = re.compile(rb'\0*')
# Plain numbers: members of an enumeration are looked up slowly.
_MESSAGE = int(Opcode.MESSAGE)
_DEFINITIONS = (int(Opcode.SCHEMA), int(Opcode.CHANNEL))

# Everything the record classes raise on bytes that are not the record they claim to be.
PARSE_ERRORS = (McapError, struct.error, ValueError, MemoryError, OverflowError)


@dataclass(frozen=True, slots=True)
class RecordPlace:
    """Where a record of a file begins, how long it is with its head [bytes], and its kind."""

    opcode: int
    offset: int
    length: int

    @property
    def end(self) -> int:
        """The byte after the record."""
        return self.offset + self.length


def walk(file: IO[bytes], start: int, end: int) -> Iterator[RecordPlace]:
    """Step from record to record of a file, until one is not whole.

    Args:
        file: The file, free to be moved by the caller between steps.
        start: Byte where a record begins.
        end: Byte where the records end.

    Yields:
        The place of every whole record.
    """
    offset = start
    while offset + HEAD.size <= end:
        file.seek(offset)
        head = file.read(HEAD.size)
        if len(head) < HEAD.size:
            return
        opcode, length = HEAD.unpack(head)
        # A crash often leaves a tail of zeros, which are no records.
        if opcode == length == 0 or length > end - offset - HEAD.size:
            return
        place = RecordPlace(opcode, offset, HEAD.size + length)
        yield place
        offset = place.end


@dataclass(slots=True)
class Contents:
    """The records inside a chunk, or inside a run of records outside of chunks.

    Arrays have one element for each message in file order: its channel, its log time [ns], the
    offset of its record in the data.  ``end`` is the byte after the last whole record, ``odd``
    counts the records that are whole but cannot be read, and ``redefined`` has the channels that
    change their meaning in between, ``late`` those that are defined behind messages of theirs.
    """

    channel: IntArray
    log_time_ns: IntArray
    offset: IntArray
    end: int
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    odd: int = 0
    redefined: set[int] = field(default_factory=set)
    late: set[int] = field(default_factory=set)


def scan(data: bytes) -> Contents:
    """List the records in decompressed data, up to the first that is not whole."""
    channels, times, offsets = array('q'), array('Q'), array('q')
    before: dict[int, int] = {}
    contents = Contents(_NOTHING, _NOTHING, _NOTHING, 0)
    size, end = len(data), 0
    while end + HEAD.size <= size:
        opcode, length = HEAD.unpack_from(data, end)
        body = end + HEAD.size
        following = body + length
        if following > size:
            break
        if opcode == _MESSAGE and length >= MESSAGE_HEAD.size:
            channel, _, log_time, _ = MESSAGE_HEAD.unpack_from(data, body)
            channels.append(channel)
            times.append(log_time)
            offsets.append(end)
        elif opcode in _DEFINITIONS:
            before[_define(contents, opcode, data[body:following])] = len(offsets)
        elif opcode == length == 0:
            # Zeros may go on for long.
            count = (_ZEROS.match(data, end).end() - end) // HEAD.size  # type: ignore[union-attr]
            contents.odd += count
            following = end + count * HEAD.size
        elif opcode in (0, _MESSAGE):
            contents.odd += 1
        end = following
    contents.end = end
    contents.channel, contents.log_time_ns, contents.offset = (
        np.frombuffer(column, np.int64) for column in (channels, times, offsets)
    )
    contents.late = _late(contents, before)
    return contents


def definitions(data: bytes) -> Contents:
    """List the definitions with which decompressed data begins, without its messages."""
    end = 0
    while len(data) >= end + HEAD.size and data[end] in _DEFINITIONS:
        end += HEAD.size + int.from_bytes(data[end + 1 : end + HEAD.size], 'little')
    return scan(data[:end])


def _late(contents: Contents, before: Mapping[int, int]) -> set[int]:
    """The channels that have messages before the last definition of them."""
    if not any(before.values()):
        return set()
    ids, first = np.unique(contents.channel, return_index=True)
    pairs = zip(ids.tolist(), first.tolist(), strict=True)
    return {number for number, place in pairs if place < before.get(number, 0)}


def _define(contents: Contents, opcode: int, body: bytes) -> int:
    """Take a definition; return the channel's number, or -1."""
    stream = ReadDataStream(BytesIO(body))
    try:
        if opcode == Opcode.SCHEMA:
            schema = Schema.read(stream)
            contents.schemas[schema.id] = schema
        else:
            channel = Channel.read(stream)
            if is_other(contents.channels.get(channel.id, channel), channel):
                contents.redefined.add(channel.id)
            contents.channels[channel.id] = channel
            return channel.id
    except PARSE_ERRORS:
        contents.odd += 1
    return -1


def is_other(one: Channel, two: Channel) -> bool:
    """Whether two definitions of a channel are of different messages."""
    return (one.topic, one.schema_id, one.message_encoding) != (
        two.topic, two.schema_id, two.message_encoding,
    )  # fmt: skip
