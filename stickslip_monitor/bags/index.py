# SPDX-License-Identifier: Apache-2.0
"""The summary section of an MCAP file, believed only where it proves consistent.

From the records of a file to the blocks it is read in.

What one MCAP file holds: channels, counts, blocks to read, and where it is cut.
"""

from __future__ import annotations

import dataclasses
import zlib
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import IO

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, ChunkIndex, Footer, Schema, Statistics
from mcap.stream_reader import StreamReader
from mcap.summary import Summary

from stickslip_monitor.bags.blocks import Block, BlockKind, DamagedBlock, list_contents, load
from stickslip_monitor.bags.mcap_records import HEAD, MAGIC, PARSE_ERRORS, RecordPlace, walk
from stickslip_monitor.bags.values import Cut
from stickslip_monitor.errors import BagError

_FOOTER_BODY = 20
_TAIL = HEAD.size + _FOOTER_BODY + len(MAGIC)


def read_summary(file: IO[bytes], size: int) -> tuple[Summary, int] | None:
    """Read the summary of a file that is whole.

    Args:
        file: The file.
        size: Its length [bytes].

    Returns:
        The summary and the byte at which it begins; None when it is missing, damaged, or does not
        list every channel and schema of the file.
    """
    try:
        found = _summary_bytes(file, size)
        if found is None:
            return None
        data, start = found
        summary = _parse(data)
    except PARSE_ERRORS:
        return None
    return (summary, start) if _complete(summary, start) else None


def _summary_bytes(file: IO[bytes], size: int) -> tuple[bytes, int] | None:
    if size < 2 * len(MAGIC) + _TAIL:
        return None
    file.seek(size - _TAIL)
    tail = file.read(_TAIL)
    if tail[: HEAD.size] != HEAD.pack(Opcode.FOOTER, _FOOTER_BODY) or not tail.endswith(MAGIC):
        return None
    footer = Footer.read(ReadDataStream(BytesIO(tail[HEAD.size :])))
    if not len(MAGIC) <= footer.summary_start < size - _TAIL:
        return None
    file.seek(footer.summary_start)
    data = file.read(size - footer.summary_start)
    checked = data[: -len(MAGIC) - 4]
    if footer.summary_crc and zlib.crc32(checked) != footer.summary_crc:
        return None
    return data, footer.summary_start


def _parse(data: bytes) -> Summary:
    summary = Summary()
    reader = StreamReader(BytesIO(data), skip_magic=True, record_size_limit=len(data))
    for record in reader.records:
        if isinstance(record, Statistics):
            summary.statistics = record
        elif isinstance(record, Schema):
            summary.schemas[record.id] = record
        elif isinstance(record, Channel):
            summary.channels[record.id] = record
        elif isinstance(record, ChunkIndex):
            summary.chunk_indexes.append(record)
    return summary


def _complete(summary: Summary, start: int) -> bool:
    counts = summary.statistics
    if counts is None:
        return False
    if not counts.channel_message_counts.keys() <= summary.channels.keys():
        return False
    if any(c.schema_id and c.schema_id not in summary.schemas for c in summary.channels.values()):
        return False
    summary.chunk_indexes.sort(key=lambda chunk: chunk.chunk_start_offset)
    ends = [len(MAGIC)]
    for chunk in summary.chunk_indexes:
        if chunk.chunk_start_offset < ends[-1]:
            return False
        ends.append(chunk.chunk_start_offset + chunk.chunk_length + chunk.message_index_length)
    return ends[-1] <= start and (counts.channel_count == len(summary.channels))


# Longer runs of records outside of chunks are read in pieces of about this size [bytes].
_RUN = 1 << 20

_BARE = (Opcode.MESSAGE, Opcode.CHANNEL, Opcode.SCHEMA)


def blocks_of(path: Path, file: IO[bytes], places: Iterable[RecordPlace]) -> Iterator[Block]:
    """Group the records of a data section into blocks.

    Args:
        path: The file.
        file: The same file, open.
        places: Its records, in order.

    Yields:
        Blocks in file order, their times still unknown (zero).
    """
    group: Block | None = None
    for place in places:
        joined = None if group is None else _join(group, place, file)
        if joined is None:
            if group is not None:
                yield group
            joined = _begin(path, place)
        group = joined
    if group is not None:
        yield group


def _begin(path: Path, place: RecordPlace) -> Block | None:
    if place.opcode == Opcode.CHUNK:
        return Block(path, BlockKind.CHUNK, place.offset, place.length, 0, 0, {}, 0)
    if place.opcode in _BARE:
        return Block(path, BlockKind.BARE, place.offset, place.length, 0, 0, {}, 0)
    return None


def _join(group: Block, place: RecordPlace, file: IO[bytes]) -> Block | None:
    if group.kind is BlockKind.CHUNK and place.opcode == Opcode.MESSAGE_INDEX:
        file.seek(place.offset + HEAD.size)
        channel = int.from_bytes(file.read(2), 'little')
        index = {**group.index, channel: place.offset}
        length = group.index_length + place.length
        return dataclasses.replace(group, index=index, index_length=length)
    if group.kind is BlockKind.BARE and place.opcode in _BARE and group.length < _RUN:
        return dataclasses.replace(group, length=group.length + place.length)
    return None


@dataclass(slots=True)
class FileScan:
    """What one file holds; ``counts`` has the messages of each channel."""

    path: Path
    size: int
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    blocks: list[Block] = field(default_factory=list)
    counts: Counter[int] = field(default_factory=Counter)
    start_ns: int | None = None
    end_ns: int | None = None
    cut: Cut | None = None
    warnings: list[str] = field(default_factory=list)


def scan_file(path: Path) -> FileScan:
    """Find out what a file holds, from its summary where there is one, else by walking through it.

    Args:
        path: The file.

    Returns:
        What it holds; a file that ends too early is described by ``cut``.

    Raises:
        BagError: The file cannot be read, or is not MCAP.
    """
    try:
        with path.open('rb') as file:
            size = file.seek(0, 2)
            file.seek(0)
            _check_magic(path, file.read(16))
            return _from_summary(path, file, size) or _from_walk(path, file, size)
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


def _from_summary(path: Path, file: IO[bytes], size: int) -> FileScan | None:
    found = read_summary(file, size)
    if found is None:
        return None
    summary, start = found
    result = FileScan(path, size, summary.schemas, summary.channels)
    if not _take_chunks(result, file, summary, start) or summary.statistics is None:
        return None
    result.counts = Counter(summary.statistics.channel_message_counts)
    result.start_ns = result.end_ns = None
    if summary.statistics.message_count:
        result.start_ns = summary.statistics.message_start_time
        result.end_ns = summary.statistics.message_end_time
    return result


def _take_chunks(result: FileScan, file: IO[bytes], summary: Summary, start: int) -> bool:
    """Take the blocks from the summary and between its chunks; False where they do not fit."""
    offset = len(MAGIC)
    for chunk in summary.chunk_indexes:
        if not _take_between(result, file, offset, chunk.chunk_start_offset):
            return False
        block = Block(
            result.path, BlockKind.CHUNK, chunk.chunk_start_offset, chunk.chunk_length,
            chunk.message_start_time, chunk.message_end_time,
            chunk.message_index_offsets, chunk.message_index_length,
        )  # fmt: skip
        result.blocks.append(block)
        offset = block.offset + block.length + block.index_length
    return _take_between(result, file, offset, start)


def _take_between(result: FileScan, file: IO[bytes], start: int, end: int) -> bool:
    section = _Section(file, start, end)
    for block in blocks_of(result.path, file, section.places()):
        _tally(result, block)
    return section.offset == end


def _from_walk(path: Path, file: IO[bytes], size: int) -> FileScan:
    result = FileScan(path, size)
    section = _Section(file, min(len(MAGIC), size), size)
    last: Block | None = None
    for block in blocks_of(path, file, section.places()):
        if last is not None:
            _tally(result, last)
        last = block
    if last is not None:
        # Its message index may be cut between two records, which nothing in the file would show.
        _tally(result, last if section.ended else dataclasses.replace(last, index={}))
    if not section.finished():
        _take_cut(result, file, section)
    return result


def _take_cut(result: FileScan, file: IO[bytes], section: _Section) -> None:
    file.seek(section.offset)
    head = file.read(1)
    before = result.counts.total()
    if not section.ended and head == bytes([Opcode.CHUNK]):
        rest = result.size - section.offset
        _tally(result, Block(result.path, BlockKind.CUT_CHUNK, section.offset, rest, 0, 0, {}, 0))
    text = _cut_text(result, section, result.counts.total() - before)
    result.cut = Cut(result.path, section.offset, result.size, result.end_ns, text)


def _cut_text(result: FileScan, section: _Section, from_chunk: int) -> str:
    total = result.counts.total()
    text = (
        f"file '{result.path.name}' is cut: its last whole record ends at byte {section.offset} of"
        f' {result.size}'
    )
    if section.ended:
        return f'{text}, behind the last message; all {total} messages were saved'
    text += f', and {total} messages before the cut were saved'
    return f'{text}, {from_chunk} of them from the chunk that is cut' if from_chunk else text


def _tally(result: FileScan, block: Block) -> None:
    """Count a block's messages, take its definitions, and keep it."""
    try:
        loaded = load(block)
    except DamagedBlock as damage:
        if block.kind is not BlockKind.CUT_CHUNK:
            result.warnings.append(str(damage))
        return
    contents = list_contents(loaded)
    result.schemas.update(contents.schemas)
    result.channels.update(contents.channels)
    if not len(contents.channel):
        return
    ids, counts = np.unique(contents.channel, return_counts=True)
    result.counts.update(dict(zip(ids.tolist(), counts.tolist(), strict=True)))
    start, end = int(contents.log_time_ns.min()), int(contents.log_time_ns.max())
    result.start_ns = start if result.start_ns is None else min(start, result.start_ns)
    result.end_ns = end if result.end_ns is None else max(end, result.end_ns)
    result.blocks.append(dataclasses.replace(block, start_ns=start, end_ns=end))


@dataclass(slots=True)
class _Section:
    """The data section as far as it was walked: ``offset`` is the end of the last whole record."""

    file: IO[bytes]
    offset: int
    end: int
    ended: bool = False

    def places(self) -> Iterator[RecordPlace]:
        """Step through the records up to the end of the data section."""
        for place in walk(self.file, self.offset, self.end):
            if place.opcode == Opcode.FOOTER:
                self.ended = True
                return
            self.offset = place.end
            if place.opcode == Opcode.DATA_END:
                self.ended = True
                return
            yield place

    def finished(self) -> bool:
        """Step through the rest and say whether the file ends as it should."""
        for place in walk(self.file, self.offset, self.end):
            self.offset = place.end
            if place.opcode == Opcode.FOOTER:
                self.file.seek(self.offset)
                return self.ended and self.file.read(len(MAGIC)) == MAGIC
        return False
