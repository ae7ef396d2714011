# SPDX-License-Identifier: Apache-2.0
"""What one MCAP file holds: channels, counts, the blocks to read, and where it is cut.

The heads of all records are looked at, whatever the summary says of them. Blocks are decompressed
here only where no summary says what is in them.
"""

from __future__ import annotations

import contextlib
import os
import zlib
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from io import BytesIO
from pathlib import Path

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Footer, Statistics

from stickslip_monitor.arrays import IntArray
from stickslip_monitor.bags.blocks import (
    CHUNK_HEAD,
    INDEX_HEAD,
    MOST_CUT,
    Block,
    BlockKind,
    Budget,
    DamagedBlock,
    Exhausted,
    prefetch,
)
from stickslip_monitor.bags.channels import Channels, pieces_of
from stickslip_monitor.bags.records import HEAD, MAGIC, PARSE_ERRORS, Walker
from stickslip_monitor.bags.values import Cut
from stickslip_monitor.errors import BagError, plural
from stickslip_monitor.files import open_file

DATED = 10**17
"""Times from here on are dates, not seconds since something was switched on [ns]."""

_PIECE = 1 << 20
# Longer runs of records outside of chunks are read in pieces of about this size [bytes].
_RUN = 1 << 20
# Recordings in one file.
_MOST_JOINED = 1000
# Of a summary that is used, and of a record of it [bytes].
_MOST_SUMMARY, _LONGEST = 32 << 20, 1 << 20
_BARE = (Opcode.MESSAGE, Opcode.CHANNEL, Opcode.SCHEMA)
_DATA = (Opcode.CHUNK, Opcode.MESSAGE, Opcode.MESSAGE_INDEX)
_BEGIN = HEAD.size + CHUNK_HEAD.size
_TAIL = HEAD.size + 20 + len(MAGIC)


@dataclass(slots=True)
class Part:
    """A recording in a file; as a rule a file holds one.

    ``stated`` are the messages of each channel after the summary: where it is not None, nothing of
    the recording was decompressed yet.  ``start_ns`` and ``end_ns`` are without messages whose log
    time is 0, which ``has_zero`` tells of, or beyond 2^63.
    """

    path: Path
    size: int
    tell: Callable[[str], None]
    channels: Channels = field(init=False)
    blocks: list[Block] = field(default_factory=list)
    stated: Counter[int] | None = None
    start_ns: int | None = None
    end_ns: int | None = None
    has_zero: bool = False
    cut: Cut | None = None

    def __post_init__(self) -> None:
        """Begin without channels."""
        self.channels = Channels(self.tell)

    def counts(self) -> Counter[int]:
        """Messages of each channel."""
        return self.channels.counts() if self.stated is None else self.stated

    def take_block(self, block: Block, take: Callable[[], Walker], budget: Budget) -> int:
        """Count a block's messages, take its definitions, and keep it.

        Returns:
            How many messages it has.
        """
        found: list[IntArray] = []
        starts, ends, count = [], [], 0
        for piece in pieces_of(block, take, self.channels, self.tell, budget):
            if piece.channel.size:
                found.append(self.channels.count(block, piece))
                count += piece.channel.size
                start, end = self._take_times(piece.log_time_ns)
                starts.append(start)
                ends.append(end)
        if found:
            keys = np.unique(np.concatenate(found))
            block = replace(block, start_ns=min(starts), end_ns=max(ends), channels=keys)
            self.blocks.append(block)
        return count

    def _take_times(self, log_time_ns: IntArray) -> tuple[int, int]:
        """Widen the time span; return the one of these messages."""
        good = log_time_ns[log_time_ns > 0]
        self.has_zero = self.has_zero or bool((log_time_ns == 0).any())
        if (log_time_ns < 0).any():
            self.tell(
                f"file '{self.path.name}': messages with a log time of 2^63 ns or more, which is"
                ' no time, were not used'
            )
        if not good.size:
            return 0, 0
        start, end = int(good.min()), int(good.max())
        self.start_ns = start if self.start_ns is None else min(start, self.start_ns)
        self.end_ns = end if self.end_ns is None else max(end, self.end_ns)
        return (start if log_time_ns.all() else 0), end


def scan_file(path: Path, tell: Callable[[str], None]) -> list[Part]:
    """Find out what a file holds, from its summary where there is one, else by walking through it.

    Args:
        path: The file.
        tell: Told what is wrong with it, in sentences.

    Returns:
        The recordings in it. One that ends too early is described by ``cut``.

    Raises:
        BagError: The file cannot be read, or is not MCAP.
    """
    try:
        with open_file(path) as file:
            number = file.fileno()
            size = os.fstat(number).st_size
            _check_magic(path, os.pread(number, 16, 0))
            return _scan_parts(path, number, size, tell)
    except OSError as error:
        raise BagError(f"bag file '{path}' cannot be read: {error.strerror}") from None


def _check_magic(path: Path, begin: bytes) -> None:
    if begin.startswith(b'SQLite format 3'):
        raise BagError(
            f"bag file '{path}' is an SQLite recording (.db3), not MCAP: convert it with"
            " 'ros2 bag convert' first"
        )
    # A recorder stopped while it created the file leaves a part of the magic, or nothing at all.
    if not MAGIC.startswith(begin[: len(MAGIC)]):
        shown = begin[: len(MAGIC)].hex(' ')
        raise BagError(f"bag file '{path}' is not an MCAP recording: it begins with bytes {shown}")


def _scan_parts(path: Path, file: int, size: int, tell: Callable[[str], None]) -> list[Part]:
    """Scan a recording, and those of other files that were joined to it."""
    parts: list[Part] = []
    budget = Budget(size)
    start = 0
    for _ in range(_MOST_JOINED):
        parts.append(Part(path, size, tell))
        heads = _Heads(file, min(start + len(MAGIC), size), size)
        end = _scan_part(parts[-1], heads, budget, start)
        following = _find_magic(file, end, size)
        if following is None:
            if end < size and heads.is_finished:
                rest = plural(size - end, 'byte')
                tell(f"file '{path.name}' has {rest} behind its end, not read")
            return parts
        tell(
            f"file '{path.name}' holds another recording from byte {following} on, as of files"
            ' that were joined: both were read'
        )
        start = following
    raise BagError(
        f"bag file '{path}' cannot be read: it holds more than {_MOST_JOINED} recordings"
    )


def _scan_part(part: Part, heads: _Heads, budget: Budget, start: int) -> int:
    """Scan one recording of a file; return the byte where it ends."""
    blocks = list(heads.blocks(part.path))
    if start == 0 and _take_summary(part, heads, blocks):
        return heads.offset
    name = part.path.name
    if heads.strange:
        odd = plural(heads.strange, 'record')
        part.tell(f"file '{name}' has {odd} of kind 0, which is none: passed over")
    if heads.behind:
        part.tell(f"file '{name}' has messages behind the end of its data; they were read too")
    end = heads.offset
    if not heads.is_finished:
        # The record before may have swallowed the beginning of the next recording.
        found = _find_magic(heads.file, heads.last, heads.end)
        end = heads.end if found is None else found
        if end < heads.offset:
            heads.offset = heads.last
        if not heads.ended:
            blocks += _cut_chunk(part.path, heads, end)
    last = _walk(part, blocks, budget)
    part.channels.complete(heads.definitions)
    part.channels.settle(name)
    if heads.statistics is not None:
        stated = heads.statistics.channel_message_counts
        part.channels.compare(name, stated, part.channels.counts())
    if not heads.is_finished:
        is_cut_chunk = bool(blocks) and blocks[-1].kind is BlockKind.CUT_CHUNK
        part.cut = _cut(part, heads, last if is_cut_chunk else 0)
    return end


def _walk(part: Part, blocks: list[Block], budget: Budget) -> int:
    """Take all blocks; return the messages of the last one."""
    count = 0
    try:
        for block, take in zip(blocks, prefetch(blocks), strict=True):
            count = 0
            try:
                count = part.take_block(block, take, budget)
            except DamagedBlock as damage:
                if block.kind is not BlockKind.CUT_CHUNK:
                    part.tell(str(damage))
    except Exhausted as limit:
        part.tell(str(limit))
    return count


def _take_summary(part: Part, heads: _Heads, blocks: list[Block]) -> bool:
    """Take channels and counts from the summary, if the file has a whole one and nothing odd."""
    counts = heads.statistics
    if counts is None or heads.is_odd or not heads.has_sound_summary():
        return False
    trouble: list[str] = []
    channels = Channels(trouble.append)
    is_sound = all(channels.define(None, 0, record)[1] for record in heads.definitions)
    is_whole = all(m.schema is not None or not m.channel.schema_id for m in channels)
    stated, end = counts.channel_message_counts, counts.message_end_time
    if trouble or not (is_sound and is_whole) or not stated.keys() <= channels.meanings.keys():
        return False
    has_zero = bool(counts.message_count) and counts.message_start_time == 0
    if counts.channel_count != len(channels.meanings) or end >= 1 << 63:
        return False
    if has_zero and end >= DATED:
        return False
    if +Counter(stated) != +heads.indexed:
        # Then no index says truly what a chunk is without.
        blocks = [replace(block, channels=None) for block in blocks]
    channels.tell = part.tell
    part.channels, part.blocks, part.stated = channels, blocks, Counter(stated)
    part.has_zero = has_zero
    if counts.message_count:
        part.start_ns, part.end_ns = counts.message_start_time, end
    return True


def _cut_chunk(path: Path, heads: _Heads, end: int) -> list[Block]:
    """The chunk in which a file ends too early, if it does in one."""
    begin = os.pread(heads.file, min(_BEGIN, end - heads.offset), heads.offset)
    if len(begin) < _BEGIN or begin[0] != Opcode.CHUNK:
        return []
    size = min(CHUNK_HEAD.unpack_from(begin, HEAD.size)[2], MOST_CUT)
    return [Block(path, BlockKind.CUT_CHUNK, heads.offset, end - heads.offset, size)]


def _cut(part: Part, heads: _Heads, from_chunk: int) -> Cut:
    total = part.counts().total()
    text = (
        f"file '{part.path.name}' is cut: its last whole record ends at byte {heads.offset} of"
        f' {part.size}'
    )
    messages, were = plural(total, 'message'), 'was' if total == 1 else 'were'
    if heads.ended:
        text += f', behind the last message; all {messages} {were} saved'
    else:
        text += f', and {messages} before the cut {were} saved'
    if from_chunk:
        text += f', {from_chunk} of them from the chunk that is cut'
    return Cut(part.path, heads.offset, part.size, part.end_ns, text)


def _find_magic(file: int, start: int, size: int) -> int | None:
    """The byte where a further recording begins, in what is left of a file."""
    offset, data = start, b''
    while part := os.pread(file, _PIECE, offset):
        data = data[-len(MAGIC) + 1 :] + part
        found = data.find(MAGIC)
        begin = offset + len(part) - len(data) + found
        # The last one is only the end of the file.
        if found >= 0 and begin + len(MAGIC) < size:
            return begin
        offset += len(part)
    return None


@dataclass(slots=True)
class _Group:
    """A block that may still grow, and the channels it has an index of."""

    block: Block
    channels: list[int] = field(default_factory=list)

    def done(self) -> Block:
        """What it has become."""
        if not self.channels:
            return self.block
        return replace(self.block, channels=np.unique(self.channels).astype(np.int64))


@dataclass(slots=True)
class _Heads:
    """The heads of the records of a file, as far as it was walked.

    ``last`` is the beginning of the last whole record before the footer and ``offset`` its end;
    ``ended`` tells whether the end of the data was met, ``is_finished`` whether the file ends as
    it should, and ``is_odd`` whether there is what no recorder of chunks writes.  ``indexed``
    are the messages of each channel after the message indexes.
    """

    file: int
    offset: int
    end: int
    last: int = 0
    summary_start: int = 0
    ended: bool = False
    is_finished: bool = False
    behind: bool = False
    has_bare: bool = False
    strange: int = 0
    footer: bytes = b''
    statistics: Statistics | None = None
    definitions: list[bytes] = field(default_factory=list)
    indexed: Counter[int] = field(default_factory=Counter)

    @property
    def is_odd(self) -> bool:
        """Whether the summary of such a file is not to be believed."""
        whole = self.is_finished and self.offset == self.end
        return not whole or self.behind or self.has_bare or self.strange > 0

    def blocks(self, path: Path) -> Iterator[Block]:
        """Step through the records, and group those of the data into blocks."""
        group: _Group | None = None
        self.last = self.offset
        for kind, offset, length, begin in self._records():
            if group is not None and self._join(group, kind, length, begin):
                continue
            if group is not None:
                yield group.done()
                group = None
            if kind == Opcode.CHUNK and len(begin) == _BEGIN:
                start, end, size, _, _ = CHUNK_HEAD.unpack_from(begin, HEAD.size)
                start = start if start < 1 << 63 else 0
                group = _Group(Block(path, BlockKind.CHUNK, offset, length, size, start, end))
            elif kind == Opcode.CHUNK:
                group = _Group(Block(path, BlockKind.CHUNK, offset, length, 0))
            elif kind in _BARE:
                group = _Group(Block(path, BlockKind.BARE, offset, length, length))
        if group is not None:
            # Its message index may be cut between two records, which nothing would show.
            last = group.done()
            yield last if self.ended else replace(last, index_length=0)

    def _join(self, group: _Group, kind: int, length: int, begin: bytes) -> bool:
        """Let a block take the next record, if it belongs there."""
        block = group.block
        if block.kind is BlockKind.CHUNK and kind == Opcode.MESSAGE_INDEX:
            group.block = replace(block, index_length=block.index_length + length)
            if len(begin) >= INDEX_HEAD.size:
                _, _, channel, size = INDEX_HEAD.unpack_from(begin)
                group.channels.append(channel)
                self.indexed[channel] += size // 16
            return True
        if block.kind is BlockKind.BARE and kind in _BARE and block.length < _RUN:
            group.block = replace(block, length=block.length + length, size=block.size + length)
            return True
        return False

    def _records(self) -> Iterator[tuple[int, int, int, bytes]]:
        """Kind, place, length and first bytes of the records of the data."""
        while self.offset + HEAD.size <= self.end:
            offset = self.offset
            begin = os.pread(self.file, _BEGIN, offset)
            if len(begin) < HEAD.size:
                return
            kind, length = HEAD.unpack_from(begin)
            length += HEAD.size
            # A crash often leaves a tail of zeros, which are no records.
            if (kind == 0 and length == HEAD.size) or length > self.end - offset:
                return
            self.offset += length
            if kind == Opcode.FOOTER:
                self._take_footer(os.pread(self.file, min(length, _TAIL), offset))
                return
            self.last = offset
            if kind == Opcode.DATA_END:
                self.ended, self.summary_start = True, self.offset
            elif self.ended and kind not in _DATA:
                self._take(kind, offset, length)
            else:
                self.strange += kind == 0
                self.behind = self.behind or self.ended
                self.has_bare = self.has_bare or kind == Opcode.MESSAGE
                yield kind, offset, length, begin[: min(length, _BEGIN)]

    def _take(self, kind: int, offset: int, length: int) -> None:
        """Take a record of the summary, whose definitions may be in a damaged chunk only."""
        if length > _LONGEST:
            return
        if kind == Opcode.STATISTICS:
            body = os.pread(self.file, length, offset)[HEAD.size :]
            with contextlib.suppress(*PARSE_ERRORS):
                self.statistics = Statistics.read(ReadDataStream(BytesIO(body)))
        elif kind in _BARE:
            self.definitions.append(os.pread(self.file, length, offset))

    def _take_footer(self, record: bytes) -> None:
        self.ended, self.footer = True, record
        if os.pread(self.file, len(MAGIC), self.offset) == MAGIC:
            self.is_finished = True
            self.offset += len(MAGIC)

    def has_sound_summary(self) -> bool:
        """Whether the footer says the same of the summary as the records, with its checksum."""
        if len(self.footer) != _TAIL - len(MAGIC):
            return False
        footer = Footer.read(ReadDataStream(BytesIO(self.footer[HEAD.size :])))
        length = self.offset - len(MAGIC) - 4 - self.summary_start
        if footer.summary_start != self.summary_start or not 0 < length <= _MOST_SUMMARY:
            return False
        data = os.pread(self.file, length, self.summary_start)
        return not footer.summary_crc or zlib.crc32(data) == footer.summary_crc
