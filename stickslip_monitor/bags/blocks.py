# SPDX-License-Identifier: Apache-2.0
"""Blocks: the pieces a recording is read in, decompressed within limits, one ahead of its use."""

from __future__ import annotations

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

from stickslip_monitor.arrays import IntArray
from stickslip_monitor.bags.records import HEAD
from stickslip_monitor.errors import BagError
from stickslip_monitor.files import open_file

MOST = 128 << 20
"""The largest chunk that is restored, decompressed or not [bytes]."""
# Of a chunk that is cut: recorders that are cut off write chunks of a few [bytes].
_MOST_CUT = 32 << 20
# Start and end [ns], size and checksum of what is compressed, length of the compression's name.
CHUNK_HEAD = struct.Struct('<QQQII')
INDEX_HEAD = struct.Struct('<BQHI')
# More than is in front of what is compressed [bytes].
_LONGEST_HEAD = 200
# Larger blocks are not loaded while the one before is in use [bytes].
_AHEAD = 8 << 20
_WORKERS = 2

# What a file may take [bytes]: so much, and so much for each of its own.
_FREE = 160 << 20
_FOR_EACH = 100

# A decompressor is fed in small pieces, so that an error inside costs only what follows it, and so
# that none of them grows to more than some 20 MB.
_FEEDS: dict[str, tuple[int, Callable[[], Callable[[bytes | memoryview], bytes]]]] = {
    '': (MOST, lambda: bytes),
    'zstd': (512, lambda: zstandard.ZstdDecompressor().decompressobj().decompress),
    'lz4': (8192, lambda: lz4.frame.LZ4FrameDecompressor().decompress),
}


Loaded = tuple[bytes, IntArray | None]


class DamagedBlock(Exception):
    """A block cannot be restored; the text is a clause for a sentence."""


class Exhausted(Exception):
    """A file takes more than it may; the text is a sentence."""


@dataclass(slots=True)
class Block:
    """One chunk, or one run of records outside of chunks.

    ``offset`` and ``length`` say where it lies in the file [bytes], and ``size`` how much it is
    when decompressed.  ``start_ns`` and ``end_ns`` bound its log times, ``index_length`` is how
    long the message indexes behind it are, and ``channels`` has a bit for each channel that it has
    messages of; None where that is not known.
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

    @property
    def place(self) -> str:
        """The block as a sentence names it."""
        kind = 'chunk' if self.is_chunk else 'records'
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
                f"file '{block.path.name}' was read to byte {block.offset}: what it holds grows to"
                f' more than {self.most} bytes, the limit for its size'
            )


def decompress(
    data: bytes | memoryview, compression: str, size: int, is_cut: bool = False
) -> bytes:
    """Decompress a chunk.

    Args:
        data: Compressed bytes.
        compression: Name used by MCAP: ``''``, ``'lz4'`` or ``'zstd'``.
        size: Decompressed size the chunk declares [bytes].
        is_cut: Whether it is only the beginning of one.

    Returns:
        Exactly ``size`` bytes; as many as can be restored of a chunk that is cut.

    Raises:
        DamagedBlock: Unknown compression, damaged data, or another size than declared.
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


def load(block: Block) -> Loaded:
    """Bring a block into memory.

    Args:
        block: What to read.

    Returns:
        Its records, and where messages begin in it after its index, if it has one; of a chunk that
        is cut, what could be restored.

    Raises:
        DamagedBlock: The chunk is too large, does not decompress, or its checksum is wrong.
        BagError: The file cannot be read.
    """
    most = min(block.length, (_MOST_CUT if block.is_cut else MOST) + _LONGEST_HEAD)
    try:
        with open_file(block.path) as file:
            data = os.pread(file.fileno(), most, block.offset)
            most_index = min(block.index_length, MOST)
            index = os.pread(file.fileno(), most_index, block.offset + block.length)
    except OSError as error:
        raise BagError(f"bag file '{block.path}' cannot be read: {error.strerror}") from None
    if len(data) < most:
        raise DamagedBlock('the file became shorter while it was read')
    if not block.is_chunk:
        return data, None
    try:
        _, _, size, checksum, letters = CHUNK_HEAD.unpack_from(data, HEAD.size)
        begin = HEAD.size + CHUNK_HEAD.size + letters + 8
        (length,) = struct.unpack_from('<Q', data, begin - 8)
    except struct.error:
        raise DamagedBlock('it is not a chunk record') from None
    name = data[begin - letters - 8 : begin - 8].decode(errors='replace')
    packed = memoryview(data)[begin : begin + length]
    if block.is_cut:
        return decompress(packed, name, min(size, _MOST_CUT), is_cut=True), None
    if max(size, length) > MOST:
        raise DamagedBlock(f'it declares {size} bytes, and more than {MOST} are not restored')
    if len(packed) < length:
        raise DamagedBlock('it is not a chunk record')
    plain = decompress(packed, name, size)
    if checksum and zlib.crc32(plain) != checksum:
        raise DamagedBlock('its checksum is wrong')
    return plain, _hints(index) if index else None


def _hints(index: bytes) -> IntArray | None:
    """Where messages begin in a chunk after its message indexes; None if these are damaged."""
    parts, at = [np.empty(0, np.int64)], 0
    while at + INDEX_HEAD.size <= len(index):
        _, length, _, size = INDEX_HEAD.unpack_from(index, at)
        begin, at = at + INDEX_HEAD.size, at + HEAD.size + length
        if size % 16 or begin + size > min(at, len(index)):
            return None
        parts.append(np.frombuffer(index, '<i8', size // 8, begin)[1::2])
    found = np.concatenate(parts)
    found.sort(kind='stable')
    return found


def prefetch(blocks: Iterable[Block]) -> Iterator[Callable[[], Loaded]]:
    """Load blocks in order, small ones while those before are worked on.

    Args:
        blocks: What to load.

    Yields:
        For each block what gives its records, or raises as :func:`load`.
    """
    with ThreadPoolExecutor(_WORKERS) as pool:
        waiting: deque[Callable[[], Loaded]] = deque()
        for block in blocks:
            if max(block.size, block.length) > _AHEAD:
                waiting.append(partial(load, block))
            else:
                waiting.append(pool.submit(load, block).result)
            if len(waiting) > _WORKERS:
                yield waiting.popleft()
        yield from waiting
