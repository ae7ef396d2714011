# SPDX-License-Identifier: Apache-2.0
"""Blocks: the pieces a recording is read in, decompressed within limits, and walked through.

A block is a chunk, or a run of records outside of chunks. What a definition holds is parsed by the
``mcap`` package; messages are found by numpy.
"""

from __future__ import annotations

import contextlib
import os
import struct
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

import lz4.frame  # type: ignore[import-untyped]
import numpy as np
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Schema, Statistics
from numpy.typing import NDArray

from stickslip_logs.arrays import IntArray
from stickslip_logs.errors import BagError, cause
from stickslip_logs.files import open_file
from stickslip_logs.units import KIB, MIB

MAGIC = b'\x89MCAP0\r\n'
HEAD = struct.Struct('<BQ')
MESSAGE_HEAD = struct.Struct('<HIQQ')
PAYLOAD = HEAD.size + MESSAGE_HEAD.size
"""Where the data of a message begins in its record [bytes]."""

# Everything the record classes raise on bytes that are not the record they claim to be.
_PARSE_ERRORS = (McapError, struct.error, ValueError, MemoryError, OverflowError)
Definition = Schema | Channel
PARSED: dict[int, type[Definition | Statistics]] = {
    Opcode.SCHEMA: Schema,
    Opcode.CHANNEL: Channel,
    Opcode.STATISTICS: Statistics,
}
"""The records that are parsed, by opcode."""
# The longest record that is parsed [bytes].
_MAX_RECORD = 4 * MIB

# Records that are searched at a time; their indexes take as much memory again [bytes].
_WINDOW = 4 * MIB
# Shorter runs of messages of one length are not read as an array [bytes].
_MIN_RUN = 64 * KIB
# A plain number: members of an enumeration are looked up slowly.
_MESSAGE = int(Opcode.MESSAGE)

MAX_CHUNK = 128 * MIB
"""The largest chunk that is restored, decompressed or not [bytes]."""
# Start and end [ns], size and checksum of what is compressed, length of the compression's name.
CHUNK_HEAD = struct.Struct('<QQQII')

# A decompressor is fed in small pieces, so that an error inside costs only what follows it, and so
# that none of them grows to more than some 20 MB.
_FEEDS: dict[str, tuple[int, Callable[[], Callable[[bytes | memoryview], bytes]]]] = {
    '': (MAX_CHUNK, lambda: bytes),
    'zstd': (512, lambda: zstandard.ZstdDecompressor().decompressobj().decompress),
    'lz4': (8192, lambda: lz4.frame.LZ4FrameDecompressor().decompress),
}


def limit_bytes(size: int) -> int:
    """Return how much a file of a size may grow to, unpacked or in memory: some 100 times as much [bytes]."""
    return 160 * MIB + 100 * size


class DamagedBlock(Exception):
    """A block cannot be restored; the text is a clause for a sentence."""


@dataclass(slots=True, eq=False)
class Block:
    """One chunk, or one run of records outside of chunks.

    ``offset`` and ``length`` say where it lies in the file [bytes], ``size`` how much it is when
    decompressed, ``index_length`` how long the message indexes behind it are.  Its log times are
    from ``start_ns`` to ``end_ns``; ``channels`` has a bit for each channel that it has messages
    of, None where that is not known.  ``place_name`` is what ``offset`` counts.
    """

    path: Path
    offset: int
    length: int
    size: int
    is_chunk: bool
    is_cut: bool = False
    start_ns: int = 0
    end_ns: int = 0
    index_length: int = 0
    channels: int | None = None
    place_name: str = 'byte'

    @property
    def place(self) -> str:
        """The block as a sentence names it."""
        kind = 'chunk' if self.is_chunk else 'block'
        return f"file '{self.path.name}': the {kind} at {self.place_name} {self.offset}"


def decompress(data: bytes | memoryview, compression: str, size: int, is_cut: bool = False) -> bytes:
    """Decompress a chunk.

    Args:
        data: Compressed bytes.
        compression: Name used by MCAP: ``''``, ``'lz4'`` or ``'zstd'``.
        size: Decompressed size the chunk declares [bytes].
        is_cut: Whether it is only the beginning of one: then up to ``size`` bytes are returned, as many as
            can be restored.

    Raises:
        DamagedBlock: Unknown compression; or, for a whole chunk, damaged data or another size than declared.
    """
    if compression not in _FEEDS:
        raise DamagedBlock(f"its compression '{compression}' is unknown")
    parts: list[bytes] = []
    total, (step, make) = 0, _FEEDS[compression]
    try:
        if compression == 'zstd' and not is_cut and zstandard.frame_content_size(data) == size:
            return zstandard.ZstdDecompressor().decompress(data)
        # Without a matching size in the frame the declared one may be garbage.
        feed = make()
        for start in range(0, len(data), step):
            parts.append(feed(data[start : start + step]))
            total += len(parts[-1])
            if total > size:
                break
    except (zstandard.ZstdError, RuntimeError, MemoryError, EOFError):
        if not is_cut:
            raise DamagedBlock(f'its {compression} data does not decompress') from None
    if total != size and not is_cut:
        held = f'{total} bytes' if total < size else 'more bytes'
        raise DamagedBlock(f'it holds {held} where it declares {size}')
    return b''.join(parts)[:size]


def load_block(block: Block) -> bytes:
    """Read the records of a block, decompressed where it is a chunk.

    Of a truncated chunk the beginning is returned, up to 128 MiB and without a check of its checksum.

    Raises:
        DamagedBlock: The file became shorter, or the chunk is no chunk, is larger than 128 MiB, does not
            decompress, or has a wrong checksum; a checksum of 0 is none.
        BagError: The file cannot be read.
    """
    # In front of its compressed data a chunk has less than 200 bytes.
    max_bytes = min(block.length, MAX_CHUNK + 200)
    try:
        with open_file(block.path) as file:
            data = os.pread(file.fileno(), max_bytes, block.offset)
    except OSError as error:
        raise BagError(f"bag file '{block.path}' cannot be read: {cause(error)}") from None
    if len(data) < max_bytes:
        raise DamagedBlock('the file became shorter while it was read')
    if not block.is_chunk:
        return data
    try:
        _, _, size, checksum, letters = CHUNK_HEAD.unpack_from(data, HEAD.size)
        begin = HEAD.size + CHUNK_HEAD.size + letters + 8
        (length,) = struct.unpack_from('<Q', data, begin - 8)
    except struct.error:
        raise DamagedBlock('it is not a chunk record') from None
    name = data[begin - letters - 8 : begin - 8].decode(errors='replace')
    packed = memoryview(data)[begin : begin + length]
    if block.is_cut:
        return decompress(packed, name, min(size, MAX_CHUNK), is_cut=True)
    if max(size, length) > MAX_CHUNK:
        raise DamagedBlock(f'it declares {size} bytes, and more than {MAX_CHUNK} are not restored')
    if len(packed) < length:
        raise DamagedBlock('it is not a chunk record')
    plain = decompress(packed, name, size)
    if checksum and zlib.crc32(plain) != checksum:
        raise DamagedBlock('its checksum is wrong')
    return plain


def view_numbers(data: bytes, code: str, begin: int = 0) -> NDArray[Any]:
    """View a buffer as an array of overlapping numbers: element k begins at byte ``begin + k``.

    The array ends with the last number that is whole; it is empty where the buffer is too short for one.

    Args:
        data: The buffer, which is not copied.
        code: The numpy type, with its byte order.
        begin: The byte of element 0.
    """
    dtype = np.dtype(code)
    count = max(len(data) - begin - dtype.itemsize + 1, 0)
    return np.ndarray((count,), dtype, data, begin if count else 0, strides=(1,))


@dataclass(slots=True)
class Piece:
    """Some records of a block, one behind the other.

    Attributes:
        data: The block.
        channel: The channel of each message, shape (n,).
        log_time_ns: Its log time, negative from 2^63 on [ns].
        offset: Where the data of each message begins in the block.
        size: How long it is [bytes].
        definitions: Those of channels and schemas.
        unreadable_count: How many records are whole and cannot be read.
        end: The byte behind its last record.
        row: Its row in a block of a database, by which it is found again; None where its byte tells that.
    """

    data: bytes
    channel: NDArray[np.uint16]
    log_time_ns: IntArray
    offset: IntArray
    size: IntArray
    definitions: list[Definition]
    unreadable_count: int
    end: int
    row: IntArray | None = None

    def groups(self) -> Iterator[tuple[int, IntArray]]:
        """Yield each channel id that has messages, rising, and the indexes of these, shape (m,)."""
        counts = np.bincount(self.channel)
        keys = np.flatnonzero(counts)
        # To search for a few one by one is faster than to sort them.
        if len(keys) <= 8:
            yield from ((key, np.flatnonzero(self.channel == key)) for key in keys.tolist())
            return
        rows = np.argsort(self.channel, kind='stable')
        yield from zip(keys.tolist(), np.split(rows, np.cumsum(counts[keys])[:-1]), strict=True)


def walk_records(data: bytes) -> Iterator[Piece]:
    """Yield the records of a block in pieces of some megabytes, up to the first that is not whole.

    ``end`` of the last piece is below the length of the block where bytes remain; a block of less than a head
    of a record yields nothing. Messages are found by their first byte, which counts only where the record
    before it ends.
    """
    raw = np.frombuffer(data, np.uint8)
    words, next_words = view_numbers(data, '<i8'), view_numbers(data, '<u4', 8)
    end, is_whole = 0, True
    while is_whole and end + HEAD.size <= len(data):
        if (run := _find_equal_run(data, end)) is not None:
            end = run.end
            yield run
            continue
        stop = min(end + _WINDOW, len(data))
        last_begin = max(min(stop, len(data) - PAYLOAD + 1), end)
        begin = np.flatnonzero(raw[end:last_begin] == _MESSAGE) + end
        # The kind and all but the highest byte of the length, which comes before the channel.
        word, next_word = words[begin], next_words[begin]
        length = (word >> 8) + HEAD.size
        sound = ((word & 0xFF) == _MESSAGE) & ((next_word & 0xFF) == 0) & (length >= PAYLOAD)
        sound &= length <= len(data) - begin
        if not sound.all():
            begin, length, next_word = begin[sound], length[sound], next_word[sound]
        ends = begin + length
        # Candidates behind which the next one does not begin.
        last = np.append(np.flatnonzero(begin[1:] != ends[:-1]), len(ends) - 1)
        runs = [np.empty(0, np.int64)]
        definitions = list[Definition]()
        unreadable = 0
        while is_whole and end < stop:
            k = int(begin.searchsorted(end))
            if k < len(ends) and begin[k] == end:
                to = int(last[last.searchsorted(k)])
                runs.append(np.arange(k, to + 1))
                end = int(ends[to])
                continue
            behind, bad = _skip_record(data, end, definitions)
            is_whole = behind > end
            end, unreadable = behind, unreadable + bad
        rows = np.concatenate(runs)
        if len(rows) < len(begin):
            begin, length, next_word = begin[rows], length[rows], next_word[rows]
        offset = begin + PAYLOAD
        channel = (next_word >> 8).astype(np.uint16)
        yield Piece(data, channel, words[offset - 16], offset, length - PAYLOAD, definitions, unreadable, end)


def _find_equal_run(data: bytes, begin: int) -> Piece | None:
    """Return the run of messages of equal length that begins at a byte, as telemetry has them.

    None where there is no message at the byte, or the run is shorter than 64 KiB. It is up to 4 MiB long.
    """
    if begin + PAYLOAD > len(data) or data[begin] != _MESSAGE:
        return None
    length = HEAD.unpack_from(data, begin)[1] + HEAD.size
    count = min(len(data) - begin, _WINDOW) // length

    def column(code: str, place: int) -> NDArray[Any]:
        """View a field of all records, by its type and its place in a record [bytes], shape (count,)."""
        return np.ndarray((count,), code, data, begin + place, strides=(length,))

    if length < PAYLOAD or count * length < _MIN_RUN:
        return None
    # The kind with all but the highest byte of the length, and that.
    head, highest = column('<i8', 0), column('u1', 8)
    same = (head == head[0]) & (highest == 0)
    count = count if same.all() else int(same.argmin())
    if count * length < _MIN_RUN:
        return None
    offset = np.arange(count) * length + (begin + PAYLOAD)
    size = np.full(count, length - PAYLOAD)
    channel, log_time_ns = column('<u2', HEAD.size).copy(), column('<i8', PAYLOAD - 16).copy()
    return Piece(data, channel, log_time_ns, offset, size, [], 0, begin + count * length)


def _skip_record(data: bytes, begin: int, definitions: list[Definition]) -> tuple[int, int]:
    """Skip one record of a block that is no valid message; append a schema or channel to the definitions.

    Returns:
        The byte behind it, or ``begin`` where it is not whole or all zeros, as behind a crash; and 1 where
        it is of a kind that is read and cannot be, else 0.
    """
    if begin + HEAD.size > len(data):
        return begin, 0
    kind, length = HEAD.unpack_from(data, begin)
    end = begin + HEAD.size + length
    if end > len(data) or (kind == 0 and not length):
        return begin, 0
    if kind in (Opcode.SCHEMA, Opcode.CHANNEL) and length <= _MAX_RECORD:
        definition = parse_record(kind, data[begin + HEAD.size : end])
        if isinstance(definition, Definition):
            definitions.append(definition)
            return end, 0
    return end, int(kind in (0, Opcode.MESSAGE, Opcode.SCHEMA, Opcode.CHANNEL))


def parse_record(kind: int, data: bytes) -> Definition | Statistics | None:
    """Parse a record of one of the kinds in ``PARSED``; return None for a damaged one, or one above 4 MiB.

    Args:
        kind: The opcode.
        data: The record without its head.
    """
    with contextlib.suppress(*_PARSE_ERRORS):
        return PARSED[kind].read(ReadDataStream(BytesIO(data))) if len(data) <= _MAX_RECORD else None
    return None
