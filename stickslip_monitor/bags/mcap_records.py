# SPDX-License-Identifier: Apache-2.0
"""Numbers at any byte of a buffer, aligned or not.

Views over the records of an MCAP data section: where each begins, and what it is.

The records themselves are parsed by the ``mcap`` package.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
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
        opcode, length = HEAD.unpack(file.read(HEAD.size))
        # No record has kind 0; a crash often leaves a tail of zeros.
        if opcode == 0 or length > end - offset - HEAD.size:
            return
        place = RecordPlace(opcode, offset, HEAD.size + length)
        yield place
        offset = place.end


@dataclass(slots=True)
class Contents:
    """The records inside a chunk, or inside a run of records outside of chunks.

    Arrays have one element for each message in file order: its channel, its log time [ns], the
    offset of its record in the data.  ``end`` is the byte after the last whole record.
    """

    channel: IntArray
    log_time_ns: IntArray
    offset: IntArray
    end: int
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)


def scan(data: bytes) -> Contents:
    """List the records in decompressed data, up to the first that is not whole."""
    messages: list[tuple[int, int, int]] = []
    nothing = np.empty(0, np.int64)
    contents = Contents(nothing, nothing, nothing, 0)
    while contents.end + HEAD.size <= len(data):
        opcode, length = HEAD.unpack_from(data, contents.end)
        if opcode == 0 or length > len(data) - contents.end - HEAD.size:
            break
        try:
            if opcode == Opcode.MESSAGE:
                channel, _, log_time, _ = _message_head(data, contents.end, length)
                messages.append((channel, log_time, contents.end))
            elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                body = contents.end + HEAD.size
                _define(contents, opcode, data[body : body + length])
        except PARSE_ERRORS:
            break
        contents.end += HEAD.size + length
    table = np.array(messages, np.uint64).reshape(-1, 3).T.astype(np.int64)
    contents.channel, contents.log_time_ns, contents.offset = table
    return contents


def _message_head(data: bytes, offset: int, length: int) -> tuple[int, int, int, int]:
    if length < MESSAGE_HEAD.size:
        raise ValueError('a message record shorter than its head')
    channel, sequence, log_time, publish_time = MESSAGE_HEAD.unpack_from(data, offset + HEAD.size)
    return channel, sequence, log_time, publish_time


def _define(contents: Contents, opcode: int, body: bytes) -> None:
    stream = ReadDataStream(BytesIO(body))
    if opcode == Opcode.SCHEMA:
        schema = Schema.read(stream)
        contents.schemas[schema.id] = schema
    else:
        channel = Channel.read(stream)
        contents.channels[channel.id] = channel
