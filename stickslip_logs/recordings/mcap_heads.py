# SPDX-License-Identifier: Apache-2.0
"""Reads the heads of the records of an MCAP file: its blocks, its summary, and where it is damaged."""

from __future__ import annotations

import contextlib
import os
import zlib
from collections import Counter
from io import BytesIO
from pathlib import Path

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Footer, Statistics

from stickslip_logs.recordings.mcap_chunks import CHUNK_HEAD, HEAD, MAGIC, MAX_CHUNK, PARSE_ERRORS, Block
from stickslip_logs.units import MIB

# Longer runs of records outside of chunks are read in pieces of about this size [bytes].
_MAX_RUN = MIB
# The longest summary that is used [bytes].
_MAX_SUMMARY = 32 * MIB
MAX_RECORD = MIB
"""The longest record of a summary or of a channel that is used [bytes]."""
_BARE = (Opcode.MESSAGE, Opcode.CHANNEL, Opcode.SCHEMA)
_DATA = (Opcode.CHUNK, Opcode.MESSAGE, Opcode.MESSAGE_INDEX)
_BEGIN = HEAD.size + CHUNK_HEAD.size
# Length of the footer, the last record: places of summary and offsets, and a checksum [bytes].
_FOOTER = HEAD.size + 20
# Of an entry of the index of chunks, to the end of where its chunk begins [bytes].
_INDEXED = HEAD.size + 24


class RecordHeads:
    """The heads of the records of a file: its ``blocks`` in order, and what its summary says.

    It was walked to ``offset``, behind the last whole record, but for ``holes``, each from byte to byte;
    ``empty_count`` records have opcode 0. ``statistics``, None without, and ``definitions`` (records with
    their heads, as bytes) are those of the summary; ``indexed`` counts the messages of each channel by the
    message indexes. ``has_ended`` is whether the data end before ``offset``, ``behind`` whether data follow
    that end, ``is_finished`` whether the last magic bytes are there. All are empty until :meth:`read_heads`
    fills them. ``file`` is the descriptor of the open file, ``size`` how long it is [bytes].
    """

    def __init__(self, file: int, path: Path, size: int) -> None:
        self._file, self._path, self._size = file, path, size
        self.offset = min(len(MAGIC), size)
        self.blocks: list[Block] = []
        self.has_ended = self.is_finished = self.behind = False
        self.empty_count = 0
        self.holes: list[tuple[int, int]] = []
        self._places: list[int] | None = None
        self.statistics: Statistics | None = None
        self.definitions: list[bytes] = []
        self.indexed: Counter[int] = Counter()
        self._summary_start = 0
        self._has_bare = False
        self._footer = b''

    def read_heads(self) -> None:
        """Read the head of each record up to the footer, or to where the file is truncated.

        Fills in all attributes; call it once. A truncated last chunk becomes a block with ``is_cut``. Damage
        is a hole up to the next chunk by the index of chunks; without one the file counts as truncated there.

        Raises:
            OSError: The file cannot be read.
        """
        while len(begin := os.pread(self._file, _BEGIN, self.offset)) >= HEAD.size:
            kind, length = HEAD.unpack_from(begin)
            offset, length = self.offset, length + HEAD.size
            # A crash often leaves a tail of zeros, which are no records.
            if (kind == 0 and length == HEAD.size) or length > self._size - offset:
                if self._skip_damage():
                    continue
                break
            self.offset += length
            if kind == Opcode.FOOTER:
                self._footer = os.pread(self._file, min(length, _FOOTER + 1), offset)
                self.has_ended = True
                self.is_finished = os.pread(self._file, len(MAGIC), self.offset) == MAGIC
                self.offset += len(MAGIC) * self.is_finished
                return
            if kind == Opcode.DATA_END:
                self.has_ended, self._summary_start = True, self.offset
            elif self.has_ended and kind not in _DATA:
                self._keep_summary_record(kind, offset, length)
            else:
                self.behind = self.behind or self.has_ended
                self._add_record(kind, offset, length, begin)
        if not self.has_ended and len(begin) == _BEGIN and begin[0] == Opcode.CHUNK:
            rest, size = self._size - self.offset, CHUNK_HEAD.unpack_from(begin, HEAD.size)[2]
            block = Block(self._path, self.offset, rest, min(size, MAX_CHUNK), True, is_cut=True)
            self.blocks.append(block)

    def _skip_damage(self) -> bool:
        """Move ``offset`` to the next place of the chunk index, and add the hole before it to ``holes``.

        The last place is the summary: there the data have ended.

        Returns:
            False where no place follows; then nothing changes.
        """
        if self._places is None:
            self._places = self._read_places()
        place = next((place for place in self._places if place > self.offset), None)
        if place is None:
            return False
        self.holes.append((self.offset, place))
        self.offset = place
        if place == self._places[-1]:
            self.has_ended, self._summary_start = True, place
        return True

    def _read_places(self) -> list[int]:
        """Return the offsets of chunks by their index, rising, and last that of the summary [bytes].

        An empty list where the file does not end in a footer with a summary.
        """
        end = os.pread(self._file, _FOOTER + len(MAGIC), max(self._size - _FOOTER - len(MAGIC), 0))
        if len(end) != _FOOTER + len(MAGIC) or end[0] != Opcode.FOOTER or end[_FOOTER:] != MAGIC:
            return []
        start = int.from_bytes(end[HEAD.size : HEAD.size + 8], 'little')
        if not 0 < start < self._size:
            return []
        data, at, places = os.pread(self._file, _MAX_SUMMARY, start), 0, []
        while at + _INDEXED <= len(data):
            kind, length = HEAD.unpack_from(data, at)
            if kind == Opcode.CHUNK_INDEX:
                places.append(int.from_bytes(data[at + _INDEXED - 8 : at + _INDEXED], 'little'))
            at += HEAD.size + length
        return [*sorted(place for place in places if place < start), start]

    def _add_record(self, kind: int, offset: int, length: int, begin: bytes) -> None:
        """Add a record of the data section to the last block, or begin a new block with it.

        An index of messages goes only to the chunk right before it, and its messages into ``indexed``. Other
        records are in no block; those of opcode 0 are counted in ``empty_count``. ``length`` includes the
        head [bytes]; ``begin`` are its first bytes, from the head on.
        """
        self.empty_count += kind == 0
        self._has_bare = self._has_bare or kind == Opcode.MESSAGE
        last = self.blocks[-1] if self.blocks else None
        if last is not None and offset != last.offset + last.length + last.index_length:
            last = None
        if kind == Opcode.MESSAGE_INDEX and last is not None and last.is_chunk:
            channel = int.from_bytes(begin[9:11], 'little')
            last.channels = (last.channels or 0) | 1 << channel
            last.index_length += length
            self.indexed[channel] += int.from_bytes(begin[11:15], 'little') // 16
        elif kind in _BARE and last is not None and not last.is_chunk and last.length < _MAX_RUN:
            last.length += length
            last.size = last.length
        elif kind == Opcode.CHUNK:
            start = end = size = 0
            if min(len(begin), length) == _BEGIN:
                start, end, size, _, _ = CHUNK_HEAD.unpack_from(begin, HEAD.size)
            start = start if start < 1 << 63 else 0
            self.blocks.append(Block(self._path, offset, length, size, True, start_ns=start, end_ns=end))
        elif kind in _BARE:
            self.blocks.append(Block(self._path, offset, length, length, False))

    def _keep_summary_record(self, kind: int, offset: int, length: int) -> None:
        """Append a channel or schema of the summary to ``definitions``, or read it into ``statistics``.

        Other records, those of more than 1 MiB and damaged statistics are ignored. ``length`` includes the
        head [bytes].
        """
        if length > MAX_RECORD or kind not in (*_BARE, Opcode.STATISTICS):
            return
        record = os.pread(self._file, length, offset)
        if kind != Opcode.STATISTICS:
            self.definitions.append(record)
            return
        with contextlib.suppress(*PARSE_ERRORS):
            self.statistics = Statistics.read(ReadDataStream(BytesIO(record[HEAD.size :])))

    @property
    def has_sound_summary(self) -> bool:
        """Whether the summary can be used: the footer gives its place and its checksum, if any, is right.

        False for a file with messages outside of chunks, or with damage, for a summary of more than 32 MiB,
        and before :meth:`read_heads`. Each access reads the summary, and raises OSError where that fails.
        """
        if not self.is_finished or self.offset != self._size or len(self._footer) != _FOOTER:
            return False
        if self.behind or self._has_bare or self.empty_count or self.holes:
            return False
        footer = Footer.read(ReadDataStream(BytesIO(self._footer[HEAD.size :])))
        length = self.offset - len(MAGIC) - 4 - self._summary_start
        if footer.summary_start != self._summary_start or not 0 < length <= _MAX_SUMMARY:
            return False
        data = os.pread(self._file, length, self._summary_start)
        return not footer.summary_crc or zlib.crc32(data) == footer.summary_crc
