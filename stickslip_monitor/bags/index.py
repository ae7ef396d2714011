# SPDX-License-Identifier: Apache-2.0
"""The summary section of an MCAP file, believed only where it proves consistent.

From the records of a file to the blocks it is read in.

What one MCAP file holds: channels, counts, blocks to read, and where it is cut.
"""

from __future__ import annotations

import contextlib
import dataclasses
import zlib
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import IO

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, ChunkIndex, Footer, Message, Schema, Statistics
from mcap.stream_reader import StreamReader
from mcap.summary import Summary

from stickslip_monitor.arrays import IntArray
from stickslip_monitor.bags.blocks import (
    Block,
    BlockKind,
    DamagedBlock,
    Loaded,
    list_contents,
    load,
)
from stickslip_monitor.bags.mcap_records import (
    HEAD,
    MAGIC,
    PARSE_ERRORS,
    Contents,
    RecordPlace,
    definitions,
    is_other,
    scan,
    walk,
)
from stickslip_monitor.bags.values import Cut
from stickslip_monitor.errors import BagError, plural
from stickslip_monitor.files import open_file

_FOOTER_BODY = 20
# Larger summaries take more memory than walking through the file does [bytes].
_MOST = 32 << 20
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
    if not max(len(MAGIC), size - _MOST) <= footer.summary_start < size - _TAIL:
        return None
    file.seek(footer.summary_start)
    data = file.read(size - footer.summary_start)
    checked = data[: -len(MAGIC) - 4]
    if footer.summary_crc and zlib.crc32(checked) != footer.summary_crc:
        return None
    return data, footer.summary_start


def _parse(data: bytes) -> Summary:
    summary = Summary()
    stream = BytesIO(data)
    reader = StreamReader(stream, True, emit_chunks=True, record_size_limit=len(data))
    for record in reader.records:
        if isinstance(record, Statistics):
            summary.statistics = record
        elif isinstance(record, Schema):
            known = summary.schemas.setdefault(record.id, record)
            if (known.name, known.data) != (record.name, record.data):
                raise ValueError('a schema is defined twice')
        elif isinstance(record, Channel):
            if is_other(summary.channels.setdefault(record.id, record), record):
                raise ValueError('a channel is defined twice')
        elif isinstance(record, ChunkIndex):
            summary.chunk_indexes.append(record)
        elif isinstance(record, Chunk | Message):
            raise ValueError('the summary holds messages')
    # Else there is more behind it: it is another recording's.
    if stream.tell() != len(data):
        raise ValueError('the summary does not end the file')
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
_KINDS: Mapping[int, BlockKind] = {int(kind): BlockKind.BARE for kind in _BARE} | {
    int(Opcode.CHUNK): BlockKind.CHUNK
}


def blocks_of(path: Path, file: IO[bytes], places: Iterable[RecordPlace]) -> Iterator[Block]:
    """Group the records of a data section into blocks.

    Args:
        path: The file.
        file: The same file, open.
        places: Its records, in order.

    Yields:
        Blocks in file order, their times still unknown (zero).
    """
    group: _Group | None = None
    for place in places:
        if group is not None and not group.join(place, file):
            yield group.block(path)
            group = None
        if group is None and place.opcode in _KINDS:
            group = _Group(_KINDS[place.opcode], place.offset, place.length)
    if group is not None:
        yield group.block(path)


@dataclass(slots=True)
class _Group:
    """A block that may still grow."""

    kind: BlockKind
    offset: int
    length: int
    index: dict[int, int] = field(default_factory=dict)
    index_length: int = 0

    def join(self, place: RecordPlace, file: IO[bytes]) -> bool:
        """Take the next record, if it belongs here."""
        if self.kind is BlockKind.CHUNK and place.opcode == Opcode.MESSAGE_INDEX:
            file.seek(place.offset + HEAD.size)
            self.index[int.from_bytes(file.read(2), 'little')] = place.offset
            self.index_length += place.length
            return True
        if self.kind is BlockKind.BARE and place.opcode in _BARE and self.length < _RUN:
            self.length += place.length
            return True
        return False

    def block(self, path: Path) -> Block:
        """What it has become."""
        return Block(
            path, self.kind, self.offset, self.length, 0, 0, self.index, self.index_length
        )


_PIECE = 1 << 20
# Recordings in one file.
_MOST_JOINED = 1000
# Of a record of the summary that is looked at: 65536 channels with their counts [bytes].
_LONGEST = 1 << 20
_DATA = (Opcode.CHUNK, Opcode.MESSAGE, Opcode.MESSAGE_INDEX)
# Times from here on are dates, not seconds since something was switched on [ns].
DATED = 10**17
_MOST_NAMED = 5


@dataclass(slots=True)
class FileScan:
    """What one file holds, or a part of one in which channels keep their meaning.

    ``counts`` has the messages of each channel.  ``summarised`` says that all of it was taken from
    the file's summary: the messages themselves were not looked at.  ``start_ns`` and ``end_ns``
    are without messages whose log time is 0, which ``has_zero`` tells of, or beyond 2^63.
    """

    path: Path
    size: int
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    blocks: list[Block] = field(default_factory=list)
    counts: Counter[int] = field(default_factory=Counter)
    start_ns: int | None = None
    end_ns: int | None = None
    has_zero: bool = False
    cut: Cut | None = None
    warnings: list[str] = field(default_factory=list)
    summarised: bool = False

    def tell(self, text: str) -> None:
        """Take up a sentence on what is wrong with the file, once."""
        if text not in self.warnings:
            self.warnings.append(text)

    def take_times(self, log_time_ns: IntArray) -> tuple[int, int]:
        """Widen the time span; return the one of these messages."""
        good = log_time_ns[log_time_ns > 0]
        self.has_zero = self.has_zero or bool((log_time_ns == 0).any())
        beyond = int((log_time_ns < 0).sum())
        if beyond:
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


def scan_file(path: Path, use_summary: bool = True) -> list[FileScan]:
    """Find out what a file holds, from its summary where there is one, else by walking through it.

    Args:
        path: The file.
        use_summary: Whether the summary may be believed.

    Returns:
        What it holds, as a rule in one part: a file into which several were joined, or whose
        channels change their meaning, has several. One that ends too early is described by
        ``cut``.

    Raises:
        BagError: The file cannot be read, or is not MCAP.
    """
    try:
        with open_file(path) as file:
            size = file.seek(0, 2)
            file.seek(0)
            _check_magic(path, file.read(16))
            summarised = _from_summary(path, file, size) if use_summary else None
            return [summarised] if summarised is not None else _from_walks(path, file, size)
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
    counts = summary.statistics
    result = FileScan(path, size, summary.schemas, summary.channels, summarised=True)
    if counts is None or not _take_chunks(result, file, summary, start):
        return None
    result.counts = Counter(counts.channel_message_counts)
    result.start_ns = result.end_ns = None
    if counts.message_count:
        result.start_ns, result.end_ns = counts.message_start_time, counts.message_end_time
        if counts.message_end_time >= 1 << 63:
            return None
        if counts.message_start_time == 0:
            result.has_zero = True
            if counts.message_end_time >= DATED:
                return None
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
            chunk.message_index_offsets, chunk.message_index_length, chunk.uncompressed_size,
        )  # fmt: skip
        result.blocks.append(block)
        offset = block.offset + block.length + block.index_length
    return _take_between(result, file, offset, start)


def _take_between(result: FileScan, file: IO[bytes], start: int, end: int) -> bool:
    """Take blocks between chunks; False where there is something odd."""
    section = _Section(file, start, end)
    between = _Walk(FileScan(result.path, result.size, result.schemas, result.channels))
    for block in blocks_of(result.path, file, section.places()):
        between.take(block)
    result.blocks += between.parts[0].blocks
    odd = len(between.parts) > 1 or between.parts[0].warnings
    return section.offset == end and not odd


def _from_walks(path: Path, file: IO[bytes], size: int) -> list[FileScan]:
    """Walk through a file, and through what others were joined to it."""
    parts: list[FileScan] = []
    start = 0
    for _ in range(_MOST_JOINED):
        walk = _Walk(FileScan(path, size))
        end = _walk(walk, file, start, size)
        parts += walk.parts
        following = _find_magic(file, end, size)
        if following is None:
            if end < size and walk.finished:
                walk.tell(
                    f"file '{path.name}' has {plural(size - end, 'byte')} behind its end, not read"
                )
            return parts
        walk.tell(
            f"file '{path.name}' holds another recording from byte {following} on, as of files"
            ' that were joined: both were read'
        )
        start = following
    raise BagError(
        f"bag file '{path}' cannot be read: it holds more than {_MOST_JOINED} recordings"
    )


def _walk(walk: _Walk, file: IO[bytes], start: int, size: int) -> int:
    """Walk through one recording of a file; return the byte where it ends."""
    begin = min(start + len(MAGIC), size)
    section = _Section(file, begin, size, last=begin)
    last: Block | None = None
    for block in blocks_of(walk.path, file, section.places()):
        if last is not None:
            walk.take(last)
        last = block
    if last is not None:
        # Its message index may be cut between two records, which nothing in the file would show.
        walk.take(last if section.ended else dataclasses.replace(last, index={}))
    if section.strange:
        walk.tell(
            f"file '{walk.path.name}' has {plural(section.strange, 'record')} of kind 0,"
            ' which is none: passed over'
        )
    if section.behind:
        walk.tell(
            f"file '{walk.path.name}' has messages behind the end of its data; they were read too"
        )
    walk.finished = section.finished()
    part = walk.parts[-1]
    part.schemas, part.channels = section.schemas | part.schemas, section.channels | part.channels
    walk.compare(section.statistics)
    if walk.finished:
        return section.offset + len(MAGIC)
    # The record before may have swallowed the beginning of the next recording.
    found = _find_magic(file, section.last, size)
    end = size if found is None else found
    section.offset = section.last if end < section.offset else section.offset
    _take_cut(walk, file, section, end)
    return end


def _find_magic(file: IO[bytes], start: int, size: int) -> int | None:
    """The byte where a further recording begins, in what is left of a file."""
    file.seek(start)
    offset, data = start, b''
    while part := file.read(_PIECE):
        data = data[-len(MAGIC) + 1 :] + part
        found = data.find(MAGIC)
        begin = offset + len(part) - len(data) + found
        # The last one is only the end of the file.
        if found >= 0 and begin + len(MAGIC) < size:
            return begin
        offset += len(part)
    return None


def _take_cut(walk: _Walk, file: IO[bytes], section: _Section, end: int) -> None:
    file.seek(section.offset)
    head = file.read(1)
    before = walk.count
    if not section.ended and head == bytes([Opcode.CHUNK]):
        rest = end - section.offset
        walk.take(Block(walk.path, BlockKind.CUT_CHUNK, section.offset, rest, 0, 0, {}, 0))
    result = walk.parts[-1]
    text = _cut_text(result, section, walk.count, walk.count - before)
    last = max((part.end_ns for part in walk.parts if part.end_ns is not None), default=None)
    result.cut = Cut(result.path, section.offset, result.size, last, text)


def _cut_text(result: FileScan, section: _Section, total: int, from_chunk: int) -> str:
    text = (
        f"file '{result.path.name}' is cut: its last whole record ends at byte {section.offset} of"
        f' {result.size}'
    )
    messages, were = plural(total, 'message'), 'was' if total == 1 else 'were'
    if section.ended:
        return f'{text}, behind the last message; all {messages} {were} saved'
    text += f', and {messages} before the cut {were} saved'
    return f'{text}, {from_chunk} of them from the chunk that is cut' if from_chunk else text


class _Walk:
    """What was found in one recording so far, in parts in which channels keep their meaning."""

    def __init__(self, first: FileScan) -> None:
        self.parts = [first]
        self.path = first.path
        self.finished = False

    @property
    def count(self) -> int:
        """The messages of all parts."""
        return sum(part.counts.total() for part in self.parts)

    def tell(self, text: str) -> None:
        """Take up a sentence on what is wrong."""
        self.parts[0].tell(text)

    def take(self, block: Block) -> None:
        """Count a block's messages, take its definitions, and keep it."""
        try:
            loaded = load(block)
            contents, is_sound = list_contents(loaded, self.tell)
            part = self._part(contents, loaded)
        except DamagedBlock as damage:
            if block.kind is not BlockKind.CUT_CHUNK:
                self.tell(str(damage))
            return
        part.schemas.update(contents.schemas)
        part.channels.update(contents.channels)
        if not len(contents.channel):
            return
        ids, counts = np.unique(contents.channel, return_counts=True)
        part.counts.update(dict(zip(ids.tolist(), counts.tolist(), strict=True)))
        start, end = part.take_times(contents.log_time_ns)
        index = block.index if is_sound else {}
        size = len(loaded.data)
        part.blocks.append(
            dataclasses.replace(block, start_ns=start, end_ns=end, index=index, size=size)
        )

    def _part(self, contents: Contents, loaded: Loaded) -> FileScan:
        """The part of the file that a block belongs to: a new one if a channel is redefined."""
        part = self.parts[-1]
        changed = [
            channel
            for channel in contents.channels.values()
            if part.counts[channel.id] and _is_redefined(part, channel, contents.schemas)
        ]
        if not changed:
            return part
        channel = changed[0]
        place, topic = loaded.block.place, part.channels[channel.id].topic
        if channel.id in scan(loaded.data).late:
            raise DamagedBlock(
                f"{place} makes channel {channel.id} '{channel.topic}' where it was '{topic}',"
                ' among messages of both, and was skipped'
            )
        self.tell(
            f"{place} makes channel {channel.id} '{channel.topic}' where it was '{topic}' before:"
            ' messages from there on were read as such'
        )
        self.parts.append(FileScan(part.path, part.size, dict(part.schemas), dict(part.channels)))
        return self.parts[-1]

    def compare(self, statistics: Statistics | None) -> None:
        """Tell what the file's own statistics count otherwise."""
        if statistics is None:
            return
        found: Counter[int] = sum((part.counts for part in self.parts), Counter())
        names = {key: c.topic for part in self.parts for key, c in part.channels.items()}
        stated = statistics.channel_message_counts
        texts = [
            f"{stated.get(key, 0)} messages of '{names.get(key, f'channel {key}')}', and"
            f' {found[key]} can be read'
            for key in sorted(stated.keys() | found.keys())
            if stated.get(key, 0) != found[key]
        ]
        if texts:
            more = len(texts) - _MOST_NAMED
            rest = f'; so with {more} more topics' if more > 0 else ''
            listed = '; '.join(texts[:_MOST_NAMED])
            self.tell(f"file '{self.path.name}': its statistics count {listed}{rest}")


def _is_redefined(part: FileScan, channel: Channel, schemas: Mapping[int, Schema]) -> bool:
    """Whether a definition gives other messages to a channel of a file."""
    before = part.channels.get(channel.id)
    if before is None or is_other(before, channel):
        return before is not None
    old = part.schemas.get(channel.schema_id)
    new = schemas.get(channel.schema_id, old)
    return old is not None and new is not None and (old.name, old.data) != (new.name, new.data)


@dataclass(slots=True)
class _Section:
    """A file as far as it was walked.

    ``last`` is the beginning of the last whole record before the footer and ``offset`` its end;
    ``ended`` tells whether the end of the data was met, ``behind`` whether data came behind it.
    """

    file: IO[bytes]
    offset: int
    end: int
    ended: bool = False
    behind: bool = False
    footer: RecordPlace | None = None
    last: int = 0
    strange: int = 0
    statistics: Statistics | None = None
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)

    def places(self) -> Iterator[RecordPlace]:
        """Step through the records of the data, and take those of the summary."""
        for place in walk(self.file, self.offset, self.end):
            if place.opcode == Opcode.FOOTER:
                self.ended, self.footer = True, place
                return
            self.last, self.offset = place.offset, place.end
            if place.opcode == Opcode.DATA_END:
                self.ended = True
            elif self.ended and place.opcode not in _DATA:
                self._take(place)
            else:
                self.strange += place.opcode == 0
                self.behind = self.behind or self.ended
                yield place

    def finished(self) -> bool:
        """Whether the file ends as it should, behind the footer."""
        if self.footer is None:
            return False
        self.offset = self.footer.end
        self.file.seek(self.offset)
        return self.file.read(len(MAGIC)) == MAGIC

    def _take(self, place: RecordPlace) -> None:
        """Take a record of the summary, whose definitions may be in a damaged chunk only."""
        if place.length > _LONGEST:
            return
        self.file.seek(place.offset)
        data = self.file.read(place.length)
        if place.opcode == Opcode.STATISTICS:
            with contextlib.suppress(*PARSE_ERRORS):
                self.statistics = Statistics.read(ReadDataStream(BytesIO(data[HEAD.size :])))
        found = definitions(data)
        self.schemas.update(found.schemas)
        self.channels.update(found.channels)
