# SPDX-License-Identifier: Apache-2.0
"""What one MCAP file holds: channels, counts, blocks to read, and where it is cut."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO

import numpy as np
from mcap.opcode import Opcode
from mcap.records import Channel, Schema
from mcap.summary import Summary

from stickslip_monitor.errors import BagError

from .blocks import Block, DamagedBlock, Kind, load
from .entries import list_contents
from .records import MAGIC, Place, walk
from .summary import read_summary
from .survey import blocks_of
from .values import Cut


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
            result.path, Kind.CHUNK, chunk.chunk_start_offset, chunk.chunk_length,
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
        _tally(result, Block(result.path, Kind.CUT_CHUNK, section.offset, rest, 0, 0, {}, 0))
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
        if block.kind is not Kind.CUT_CHUNK:
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

    def places(self) -> Iterator[Place]:
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
