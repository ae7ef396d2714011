# SPDX-License-Identifier: Apache-2.0
"""Chunk decompression that trusts no length it has not seen, whole and cut chunks alike.

Blocks: the pieces a recording is read in, each a stretch of whole records in memory.

Blocks loaded while the one before is worked on: decompression needs no interpreter.

Which messages of a block are wanted: from its message index if it can be believed.
"""

from __future__ import annotations

import enum
import io
import zlib
from collections import deque
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

import lz4.frame  # type: ignore[import-untyped]
import numpy as np
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk

from stickslip_monitor.arrays import IntArray
from stickslip_monitor.bags.mcap_records import (
    HEAD,
    MESSAGE_HEAD,
    PARSE_ERRORS,
    PAYLOAD,
    Contents,
    definitions,
    is_other,
    scan,
    view,
)
from stickslip_monitor.errors import BagError, plural
from stickslip_monitor.files import open_file

# A cut chunk is fed in small pieces, so that an error inside costs only what follows it, and so
# that none of them grows to more than some 20 MB.
_PIECE = 512

_GROWTH = 1 << 20

MOST = 128 << 20
"""The largest chunk that is restored, decompressed or not [bytes]."""


class CompressionError(Exception):
    """The data cannot be decompressed; the text is a clause for a sentence."""


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
        size: Decompressed size the chunk declares, a bound on the result as MOST is [bytes].

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
    except (zstandard.ZstdError, RuntimeError, MemoryError, EOFError):
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


def _zstd_feed() -> Callable[[bytes], bytes]:
    return zstandard.ZstdDecompressor().decompressobj().decompress


def _lz4_feed() -> Callable[[bytes], bytes]:
    feed: Callable[[bytes], bytes] = lz4.frame.LZ4FrameDecompressor().decompress
    return feed


_WHOLE: dict[str, Callable[[bytes, int], bytes]] = {'': _plain, 'zstd': _zstd, 'lz4': _lz4}
_PIECEWISE: dict[str, Callable[[], Callable[[bytes], bytes]]] = {
    'zstd': _zstd_feed,
    'lz4': _lz4_feed,
}

_INDEX_HEAD = HEAD.size + 2 + 4
# More than the head of a chunk record is long.
_CHUNK_HEAD = 1 << 10
# Chunks up to this size need no care with memory.
_SMALL = 8 << 20
# Of a chunk that is cut: recorders that are cut off write chunks of a few [bytes].
_MOST_CUT = 32 << 20


class BlockKind(enum.Enum):
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
    ``size`` is the number of its bytes when decompressed, zero where that is not known.
    """

    path: Path
    kind: BlockKind
    offset: int
    length: int
    start_ns: int
    end_ns: int
    index: Mapping[int, int]
    index_length: int
    size: int = 0

    @property
    def place(self) -> str:
        """The block as a sentence names it."""
        kind = 'records' if self.kind is BlockKind.BARE else 'chunk'
        return f"file '{self.path.name}': the {kind} at byte {self.offset}"


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
        DamagedBlock: The chunk is too large, does not decompress, or its checksum is wrong.
        BagError: The file cannot be read.
    """
    try:
        body, index_data = _read(block)
        if block.kind is BlockKind.BARE:
            return Loaded(block, body, b'')
        chunk = read_chunk(body)
        if block.size < chunk.uncompressed_size > _SMALL and block.size:
            raise CompressionError('it declares another size than the summary')
        if block.kind is BlockKind.CUT_CHUNK:
            size = min(chunk.uncompressed_size, _MOST_CUT)
            data = decompress_prefix(chunk.data, chunk.compression, size)
            return Loaded(block, data, b'')
        return Loaded(block, _restore(chunk), index_data)
    except CompressionError as error:
        reason = str(error)
    except PARSE_ERRORS:
        reason = 'it is not a chunk record'
    raise DamagedBlock(f'{block.place} is damaged ({reason}) and was skipped')


def read_chunk(record: bytes) -> Chunk:
    """Parse a chunk record with its head; its data is shorter than declared when it is cut."""
    if record[0] != Opcode.CHUNK:
        raise ValueError('not a chunk record')
    chunk: Chunk = Chunk.read(ReadDataStream(BytesIO(record[HEAD.size :])))
    return chunk


def _restore(chunk: Chunk) -> bytes:
    data = decompress(chunk.data, chunk.compression, chunk.uncompressed_size)
    if chunk.uncompressed_crc and zlib.crc32(data) != chunk.uncompressed_crc:
        raise CompressionError('its checksum is wrong')
    return data


def _read(block: Block) -> tuple[bytes, bytes]:
    """The bytes of a block, and those of its message index."""
    length = block.length
    if length > MOST + _CHUNK_HEAD:
        if block.kind is not BlockKind.CUT_CHUNK:
            raise CompressionError(f'it is {length} bytes long, and more than {MOST} are not read')
        length = MOST
    try:
        with open_file(block.path) as file:
            file.seek(block.offset)
            body, index_data = file.read(length), file.read(min(block.index_length, MOST))
    except OSError as error:
        raise BagError(f"bag file '{block.path}' cannot be read: {error.strerror}") from None
    if len(body) < length:
        raise CompressionError('the file became shorter while it was read')
    return body, index_data


def _index_pairs(data: bytes, begin: int, channel: int) -> IntArray | None:
    """View the (log time, offset) pairs of one message index record, or None if it is not one."""
    head = data[begin : begin + _INDEX_HEAD]
    if begin < 0 or len(head) < _INDEX_HEAD or head[0] != Opcode.MESSAGE_INDEX:
        return None
    size = int.from_bytes(head[-4:], 'little')
    begin += _INDEX_HEAD
    if int.from_bytes(head[9:11], 'little') != channel or size % 16 or begin + size > len(data):
        return None
    # Cut out first: numbers at odd places are slow to copy one by one.
    return np.frombuffer(data[begin : begin + size], np.int64).reshape(-1, 2)


_WORKERS = 2
# Of blocks that wait [bytes].
_MOST = 32 << 20


def prefetch(blocks: Sequence[Block]) -> Iterator[Loaded | DamagedBlock]:
    """Load blocks in order, a few at a time.

    Args:
        blocks: What to load.

    Yields:
        Each block, or what is wrong with it.

    Raises:
        BagError: A file cannot be read.
    """
    with ThreadPoolExecutor(_WORKERS) as pool:
        waiting: deque[tuple[int, Future[Loaded | DamagedBlock]]] = deque()
        for block in blocks:
            # Large ones one at a time: memory is bounded.
            size = max(block.size, block.length)
            while waiting and sum(other for other, _ in waiting) + size > _MOST:
                yield waiting.popleft()[1].result()
            waiting.append((size, pool.submit(_load, block)))
            if len(waiting) > _WORKERS:
                yield waiting.popleft()[1].result()
        while waiting:
            yield waiting.popleft()[1].result()


def _load(block: Block) -> Loaded | DamagedBlock:
    try:
        return load(block)
    except DamagedBlock as damage:
        return damage


@dataclass(frozen=True, slots=True)
class Entries:
    """Messages of one channel in file order, shape (n,) each.

    ``offset`` is where a message's data begins in the block and ``size`` its length [bytes].
    """

    channel: int
    log_time_ns: IntArray
    offset: IntArray
    size: IntArray


class Redefined(DamagedBlock):
    """A block gives a channel another meaning than the one it has in its file."""


def find_entries(
    loaded: Loaded,
    channels: Collection[int],
    known: Mapping[int, Channel],
    tell: Callable[[str], None],
) -> list[Entries]:
    """Find the messages of some channels in a block.

    Args:
        loaded: The block.
        channels: Ids of the channels.
        known: All channels of its file.
        tell: Told what is wrong with the block, in a sentence.

    Returns:
        The messages of each channel that has any.

    Raises:
        DamagedBlock: A channel changes its meaning inside the block, or with it.
    """
    found = _from_index(loaded, channels) if loaded.block.index else None
    defined: Contents | None = None
    if found is not None and loaded.block.index.keys() <= set(channels):
        # All that the block has should be there: then nothing is left out.
        defined = _between(loaded.data, found)
        found = None if defined is None else found
    elif found is not None:
        defined = definitions(loaded.data)
    if found is None:
        if loaded.block.index:
            tell(f'{loaded.block.place} has a message index that is wrong and was not used')
        defined = contents_of(loaded, tell)
        found = _from_scan(defined, loaded.data, channels)
    assert defined is not None
    _check_known(loaded, defined, known)
    return [entries for entries in found if len(entries.offset)]


def _check_known(loaded: Loaded, defined: Contents, known: Mapping[int, Channel]) -> None:
    for key, channel in defined.channels.items():
        if key in known and is_other(known[key], channel):
            raise Redefined(
                f"{loaded.block.place} makes channel {key} '{channel.topic}' where it is"
                f" '{known[key].topic}', and was skipped"
            )


def contents_of(loaded: Loaded, tell: Callable[[str], None]) -> Contents:
    """List all records of a block by stepping through them.

    Raises:
        DamagedBlock: A channel changes its meaning inside the block.
    """
    contents, place = scan(loaded.data), loaded.block.place
    if contents.redefined:
        channel = min(contents.redefined)
        raise DamagedBlock(
            f'{place} defines channel {channel} twice and differently: whose messages are whose is'
            ' not known, and it was skipped'
        )
    if contents.odd:
        tell(f'{place} has {plural(contents.odd, "record")} that cannot be read: passed over')
    rest = len(loaded.data) - contents.end
    if rest and loaded.block.kind is not BlockKind.CUT_CHUNK:
        tell(f'{place} has {plural(rest, "byte")} at its end, no record: not read')
    return contents


def list_contents(loaded: Loaded, tell: Callable[[str], None]) -> tuple[Contents, bool]:
    """List all records of a block, stepping only through what its message index leaves out.

    Returns:
        The records, and whether the index is right.

    Raises:
        DamagedBlock: A channel changes its meaning inside the block.
    """
    found = _from_index(loaded, loaded.block.index)
    part = _between(loaded.data, found) if found else None
    if not found or part is None:
        contents = contents_of(loaded, tell)
        if loaded.block.index:
            tell(f'{loaded.block.place} has a message index that is wrong and was not used')
        return contents, False
    channel = np.concatenate([np.full(len(e.offset), e.channel, np.int64) for e in found])
    log_time = np.concatenate([entries.log_time_ns for entries in found])
    begin = np.concatenate([entries.offset for entries in found]) - PAYLOAD
    contents = Contents(channel, log_time, begin, len(loaded.data))
    contents.schemas, contents.channels = part.schemas, part.channels
    return contents, True


def _between(data: bytes, found: Sequence[Entries]) -> Contents | None:
    """What lies between the messages of an index; None if it is more than sound definitions."""
    nothing = np.empty(0, np.int64)
    contents = Contents(nothing, nothing, nothing, len(data))
    size = sum(int(entries.size.sum()) + PAYLOAD * len(entries.size) for entries in found)
    if size == len(data):
        return contents
    begin = np.concatenate([nothing, *(entries.offset for entries in found)]) - PAYLOAD
    end = begin + PAYLOAD + np.concatenate([nothing, *(entries.size for entries in found)])
    for start, stop in _gaps(np.sort(begin), np.sort(end), len(data)):
        part = scan(data[start:stop])
        conflict = any(
            is_other(contents.channels.get(key, new), new) for key, new in part.channels.items()
        )
        whole = part.end == stop - start and not part.odd
        if len(part.channel) or conflict or part.redefined or not whole:
            return None
        contents.schemas.update(part.schemas)
        contents.channels.update(part.channels)
    return contents


def _gaps(begin: IntArray, end: IntArray, size: int) -> list[tuple[int, int]]:
    """Find what lies between records that begin and end at sorted offsets."""
    starts, stops = np.append(0, end), np.append(begin, size)
    apart = stops > starts
    return list(zip(starts[apart].tolist(), stops[apart].tolist(), strict=True))


def _from_index(loaded: Loaded, channels: Collection[int]) -> list[Entries] | None:
    found: list[Entries] = []
    for channel in channels:
        pairs = loaded.indexed(channel)
        if pairs is None:
            return None
        entries = _entries(loaded.data, channel, *pairs)
        if entries is None:
            return None
        found.append(entries)
    return found


def _from_scan(contents: Contents, data: bytes, channels: Collection[int]) -> list[Entries]:
    """The messages of some channels among those of a block."""
    order = np.argsort(contents.channel, kind='stable')
    ids, starts = np.unique(contents.channel[order], return_index=True)
    stops = np.append(starts, len(order))[1:]
    words = view(data, '<i8')
    found: list[Entries] = []
    for channel, start, stop in zip(ids.tolist(), starts, stops, strict=True):
        if channel in channels:
            mine = order[start:stop]
            offset = contents.offset[mine]
            size = words[offset + 1] - MESSAGE_HEAD.size
            found.append(Entries(channel, contents.log_time_ns[mine], offset + PAYLOAD, size))
    return found


def _entries(data: bytes, channel: int, log_time_ns: IntArray, offset: IntArray) -> Entries | None:
    """Take index entries that point to whole records of the channel and time; None if one lies."""
    if len(offset) and not 0 <= offset[0] <= offset[-1] <= len(data) - PAYLOAD:
        return None
    words = view(data, '<i8')
    # One word is the kind of record and, but for its highest byte, its length; the next is that
    # byte, the channel, and more.
    first = words[offset]
    size = (first >> 8) - MESSAGE_HEAD.size
    honest = (
        ((first & 0xFF) == Opcode.MESSAGE).all()
        and ((words[offset + 8] & 0xFFFFFF) == channel << 8).all()
        and (words[offset + HEAD.size + 6] == log_time_ns).all()
        and (size >= 0).all()
        and (size <= len(data) - PAYLOAD - offset).all()
    )
    return Entries(channel, log_time_ns, offset + PAYLOAD, size) if honest else None
