# SPDX-License-Identifier: Apache-2.0
"""Blocks: the pieces a recording is read in, each a stretch of whole records in memory."""

from __future__ import annotations

import enum
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Chunk

from stickslip_monitor.errors import BagError

from .compression import CompressionError, decompress, decompress_prefix
from .records import HEAD, PARSE_ERRORS, scan
from .values import IntArray

_INDEX_HEAD = HEAD.size + 2 + 4


class Kind(enum.Enum):
    """How a block lies in its file."""

    CHUNK = 'chunk'
    CUT_CHUNK = 'cut chunk'
    BARE = 'records outside of chunks'


class DamagedBlock(Exception):
    """A block cannot be restored; the text is a sentence naming file, byte and reason."""


@dataclass(frozen=True, slots=True)
class Block:
    """One chunk, or one run of records outside of chunks.

    ``offset`` and ``length`` say where it lies in the file [bytes]; ``start_ns`` and ``end_ns``
    bound its log times.  ``index`` gives the byte at which each channel's message index begins,
    in the ``index_length`` bytes after the block; it is empty when there is no usable index.
    """

    path: Path
    kind: Kind
    offset: int
    length: int
    start_ns: int
    end_ns: int
    index: Mapping[int, int]
    index_length: int


@dataclass(frozen=True, slots=True)
class Loaded:
    """A block in memory: its records decompressed, its message index as it lies in the file."""

    block: Block
    data: bytes
    index_data: bytes

    def indexed(self, channel: int) -> tuple[IntArray, IntArray] | None:
        """Look a channel up in the message index.

        Args:
            channel: Channel id.

        Returns:
            Log times [ns] and record offsets in ``data`` in file order, one for each message of
            the channel; None when the index is not what it should be.
        """
        if channel not in self.block.index:
            return np.empty(0, np.int64), np.empty(0, np.int64)
        begin = self.block.index[channel] - self.block.offset - self.block.length
        pairs = _index_pairs(self.index_data, begin, channel)
        if pairs is None:
            return None
        log_time, offset = np.ascontiguousarray(pairs.T)
        if not (offset[1:] > offset[:-1]).all():
            order = np.argsort(offset, kind='stable')
            log_time, offset = log_time[order], offset[order]
        return log_time, offset


def load(block: Block) -> Loaded:
    """Bring a block into memory.

    Args:
        block: What to read.

    Returns:
        Its records, restricted to the whole ones for a cut chunk.

    Raises:
        DamagedBlock: The chunk does not decompress, or its checksum is wrong.
        BagError: The file cannot be read.
    """
    raw = _read(block)
    body, index_data = raw[: block.length], raw[block.length :]
    if block.kind is Kind.BARE:
        return Loaded(block, body, b'')
    try:
        chunk = read_chunk(body)
        if block.kind is Kind.CUT_CHUNK:
            return Loaded(block, whole_records(chunk), b'')
        return Loaded(block, _restore(chunk), index_data)
    except CompressionError as error:
        reason = str(error)
    except PARSE_ERRORS:
        reason = 'it is not a chunk record'
    raise DamagedBlock(
        f"file '{block.path.name}': the chunk at byte {block.offset} is damaged"
        f' ({reason}) and was skipped'
    )


def read_chunk(record: bytes) -> Chunk:
    """Parse a chunk record with its head; its data is shorter than declared when it is cut."""
    if record[0] != Opcode.CHUNK:
        raise ValueError('not a chunk record')
    chunk: Chunk = Chunk.read(ReadDataStream(BytesIO(record[HEAD.size :])))
    return chunk


def whole_records(chunk: Chunk) -> bytes:
    """Restore the whole records at the beginning of a chunk that is cut."""
    data = decompress_prefix(chunk.data, chunk.compression, chunk.uncompressed_size)
    return data[: scan(data).end]


def _restore(chunk: Chunk) -> bytes:
    data = decompress(chunk.data, chunk.compression, chunk.uncompressed_size)
    if chunk.uncompressed_crc and zlib.crc32(data) != chunk.uncompressed_crc:
        raise CompressionError('its checksum is wrong')
    return data


def _read(block: Block) -> bytes:
    try:
        with block.path.open('rb') as file:
            file.seek(block.offset)
            return file.read(block.length + block.index_length)
    except OSError as error:
        raise BagError(f"bag file '{block.path}' cannot be read: {error.strerror}") from None


def _index_pairs(data: bytes, begin: int, channel: int) -> IntArray | None:
    """View the (log time, offset) pairs of one message index record, or None if it is not one."""
    head = data[begin : begin + _INDEX_HEAD]
    if begin < 0 or len(head) < _INDEX_HEAD or head[0] != Opcode.MESSAGE_INDEX:
        return None
    size = int.from_bytes(head[-4:], 'little')
    begin += _INDEX_HEAD
    if int.from_bytes(head[9:11], 'little') != channel or size % 16 or begin + size > len(data):
        return None
    return np.frombuffer(data, np.int64, size // 8, begin).reshape(-1, 2)
