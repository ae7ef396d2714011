# SPDX-License-Identifier: Apache-2.0
"""Blocks: the pieces a recording is read in, decompressed within limits, one ahead of its use."""

from __future__ import annotations

import enum
import io
import os
import struct
import zlib
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import lz4.frame  # type: ignore[import-untyped]
import numpy as np
import zstandard
from mcap.opcode import Opcode

from stickslip_monitor.arrays import IntArray
from stickslip_monitor.bags.records import HEAD, Walker
from stickslip_monitor.errors import BagError
from stickslip_monitor.files import open_file

MOST = 128 << 20
"""The largest chunk that is restored, decompressed or not [bytes]."""

# A cut chunk is fed in small pieces, so that an error inside costs only what follows it, and so
# that none of them grows to more than some 20 MB.
_PIECE = 512
_GROWTH = 1 << 20
# Of a chunk that is cut: recorders that are cut off write chunks of a few [bytes].
MOST_CUT = 32 << 20
# Start and end [ns], size and checksum of what is compressed, length of the compression's name.
CHUNK_HEAD = struct.Struct('<QQQII')
_LONGEST_NAME = 64
INDEX_HEAD = struct.Struct('<BQHI')
# Larger blocks are not loaded while the one before is in use [bytes].
_AHEAD = 8 << 20
_WORKERS = 2

# What a file may take [bytes]: so much, and so much for each of its own.
_FREE = 160 << 20
_FOR_EACH = 100
STEP_COST = 300
"""What a record that is no message costs; a message decoded by itself costs twice that [bytes]."""


class BlockKind(enum.Enum):
    """How a block lies in its file."""

    CHUNK = 'chunk'
    CUT_CHUNK = 'cut chunk'
    BARE = 'records outside of chunks'


class DamagedBlock(Exception):
    """A block cannot be restored; the text is a sentence naming file, byte and reason."""


class Exhausted(Exception):
    """A file takes more than it may; the text is a sentence."""


class CompressionError(Exception):
    """The data cannot be decompressed; the text is a clause for a sentence."""


@dataclass(frozen=True, slots=True)
class Block:
    """One chunk, or one run of records outside of chunks.

    ``offset`` and ``length`` say where it lies in the file [bytes], ``index_length`` how long the
    message indexes behind it are, and ``size`` how much it is when decompressed.  ``start_ns``
    and ``end_ns`` bound its log times.  ``channels`` are those it has messages of, None where that
    is not known.
    """

    path: Path
    kind: BlockKind
    offset: int
    length: int
    size: int
    start_ns: int = 0
    end_ns: int = 0
    index_length: int = 0
    channels: IntArray | None = None

    @property
    def place(self) -> str:
        """The block as a sentence names it."""
        kind = 'records' if self.kind is BlockKind.BARE else 'chunk'
        return f"file '{self.path.name}': the {kind} at byte {self.offset}"


class Budget:
    """What a file may take in one pass: bytes decompressed, and what stands for work and memory.

    Args:
        size: Length of the file [bytes].
    """

    def __init__(self, size: int) -> None:
        self.most = self._left = _FREE + _FOR_EACH * size

    def spend(self, block: Block, cost: int) -> None:
        """Take a cost [bytes] for a block.

        Raises:
            Exhausted: The file takes more than it may.
        """
        self._left -= cost
        if self._left < 0:
            raise Exhausted(
                f"file '{block.path.name}' was read to the {block.kind.value} at byte"
                f' {block.offset}: it grows to more than {self.most} bytes, the limit for its size'
            )


def decompress(data: bytes, compression: str, size: int) -> bytes:
    """Decompress a whole chunk.

    Args:
        data: Compressed bytes.
        compression: Name used by MCAP: ``''``, ``'lz4'`` or ``'zstd'``.
        size: Decompressed size the chunk declares [bytes].

    Returns:
        Exactly ``size`` bytes.

    Raises:
        CompressionError: Unknown compression, damaged data, or another size than declared.
    """
    if max(size, len(data)) > MOST:
        raise CompressionError(f'it declares {size} bytes, and more than {MOST} are not restored')
    try:
        plain = _WHOLE[compression](data, size)
    except KeyError:
        raise CompressionError(f"its compression '{compression}' is unknown") from None
    except (zstandard.ZstdError, RuntimeError, MemoryError, EOFError):
        raise CompressionError(f'its {compression} data does not decompress') from None
    if len(plain) != size:
        held = f'{len(plain)} bytes' if len(plain) < size else 'more bytes'
        raise CompressionError(f'it holds {held} where it declares {size}')
    return plain


def decompress_prefix(data: bytes, compression: str, size: int) -> bytes:
    """Decompress as much as the beginning of a chunk gives.

    Args:
        data: The compressed bytes that are there, perhaps none.
        compression: As for :func:`decompress`.
        size: A bound on the result, as MOST is [bytes].

    Returns:
        The bytes that could be restored; empty when the compression is unknown.
    """
    size = min(size, MOST)
    if not compression:
        return data[:size]
    if compression not in _PIECEWISE:
        return b''
    feed = _PIECEWISE[compression]()
    parts: list[bytes] = []
    total = 0
    try:
        for start in range(0, len(data), _PIECE):
            parts.append(feed(data[start : start + _PIECE]))
            total += len(parts[-1])
            if total >= size:
                break
    except (zstandard.ZstdError, RuntimeError, EOFError):
        pass
    return b''.join(parts)[:size]


def _plain(data: bytes, size: int) -> bytes:
    return data


def _zstd(data: bytes, size: int) -> bytes:
    if zstandard.frame_content_size(data) == size:
        return zstandard.ZstdDecompressor().decompress(data)
    # Without a matching size in the frame the declared one may be garbage: let the output grow.
    parts: list[bytes] = []
    with zstandard.ZstdDecompressor().stream_reader(io.BytesIO(data)) as reader:
        while sum(map(len, parts)) <= size and (part := reader.read(_GROWTH)):
            parts.append(part)
    return b''.join(parts)


def _lz4(data: bytes, size: int) -> bytes:
    plain: bytes = lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=size + 1)
    return plain


_WHOLE: dict[str, Callable[[bytes, int], bytes]] = {'': _plain, 'zstd': _zstd, 'lz4': _lz4}
_PIECEWISE: dict[str, Callable[[], Callable[[bytes], bytes]]] = {
    'zstd': lambda: zstandard.ZstdDecompressor().decompressobj().decompress,
    'lz4': lambda: lz4.frame.LZ4FrameDecompressor().decompress,
}


def load(block: Block) -> Walker:
    """Bring a block into memory.

    Args:
        block: What to read.

    Returns:
        Its records; of a chunk that is cut, those that could be restored.

    Raises:
        DamagedBlock: The chunk is too large, does not decompress, or its checksum is wrong.
        BagError: The file cannot be read.
    """
    try:
        with open_file(block.path) as file:
            return _load(block, file.fileno())
    except CompressionError as error:
        raise DamagedBlock(f'{block.place} is damaged ({error}) and was skipped') from None
    except OSError as error:
        raise BagError(f"bag file '{block.path}' cannot be read: {error.strerror}") from None


def _load(block: Block, file: int) -> Walker:
    if block.kind is BlockKind.BARE:
        return Walker(_read(file, block.length, block.offset), None)
    most = min(HEAD.size + CHUNK_HEAD.size + _LONGEST_NAME, block.length)
    head = os.pread(file, most, block.offset)
    if len(head) < HEAD.size + CHUNK_HEAD.size:
        raise CompressionError('it is not a chunk record')
    _, _, size, checksum, letters = CHUNK_HEAD.unpack_from(head, HEAD.size)
    begin = HEAD.size + CHUNK_HEAD.size + letters
    name = head[begin - letters : begin].decode(errors='replace')
    length = int.from_bytes(head[begin : begin + 8], 'little')
    begin += 8
    if block.kind is BlockKind.CUT_CHUNK:
        data = os.pread(file, max(min(block.length - begin, MOST), 0), block.offset + begin)
        return Walker(decompress_prefix(data[:length], name, min(size, MOST_CUT)), None)
    if letters > _LONGEST_NAME - 8 or length > block.length - begin:
        raise CompressionError('it is not a chunk record')
    if length > MOST:
        raise CompressionError(f'it is {length} bytes long, and more than {MOST} are not read')
    plain = decompress(_read(file, length, block.offset + begin), name, size)
    if checksum and zlib.crc32(plain) != checksum:
        raise CompressionError('its checksum is wrong')
    index = os.pread(file, min(block.index_length, MOST), block.offset + block.length)
    return Walker(plain, _hints(index) if index else None)


def _read(file: int, length: int, offset: int) -> bytes:
    data = os.pread(file, length, offset)
    if len(data) < length:
        raise CompressionError('the file became shorter while it was read')
    return data


def _hints(index: bytes) -> IntArray:
    """Where messages begin in a chunk after its message indexes; none if these are damaged."""
    nothing = np.empty(0, np.int64)
    parts, at = [nothing], 0
    while at < len(index):
        if at + INDEX_HEAD.size > len(index):
            return nothing
        kind, length, _, size = INDEX_HEAD.unpack_from(index, at)
        begin, at = at + INDEX_HEAD.size, at + HEAD.size + length
        if kind != Opcode.MESSAGE_INDEX or size % 16 or begin + size > min(at, len(index)):
            return nothing
        parts.append(np.frombuffer(index, np.int64, size // 8, begin)[1::2])
    found = np.concatenate(parts)
    found.sort(kind='stable')
    return found


def prefetch(blocks: Iterable[Block]) -> Iterator[Callable[[], Walker]]:
    """Load blocks in order, small ones while those before are worked on.

    Args:
        blocks: What to load.

    Yields:
        For each block what gives its records, or raises as :func:`load`.
    """
    with ThreadPoolExecutor(_WORKERS) as pool:
        waiting: deque[Callable[[], Walker]] = deque()
        for block in blocks:
            if block.size > _AHEAD:
                waiting.append(partial(load, block))
            else:
                waiting.append(pool.submit(load, block).result)
            if len(waiting) > _WORKERS:
                yield waiting.popleft()
        yield from waiting
