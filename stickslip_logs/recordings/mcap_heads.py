# SPDX-License-Identifier: Apache-2.0
"""Reads the heads of the records of an MCAP file: its blocks, its summary, and where it is damaged."""

from __future__ import annotations

import os
import struct
import zlib
from collections import Counter
from pathlib import Path

from mcap.opcode import Opcode
from mcap.records import Statistics

from stickslip_logs.recordings.mcap_chunks import (
    CHUNK_HEAD,
    HEAD,
    MAGIC,
    MAX_CHUNK,
    PARSED,
    Block,
    Definition,
    parse_record,
)
from stickslip_logs.units import MIB

# Longer runs of records outside of chunks are read in pieces of about this size [bytes].
_MAX_RUN = MIB
# The longest summary that is used [bytes].
_MAX_SUMMARY = 32 * MIB
_BARE = (Opcode.MESSAGE, Opcode.CHANNEL, Opcode.SCHEMA)
_DATA = (Opcode.CHUNK, Opcode.MESSAGE, Opcode.MESSAGE_INDEX, Opcode.DATA_END)
_BEGIN = HEAD.size + CHUNK_HEAD.size
# The footer, the last record: places of the summary and of its offsets, and a checksum.
_FOOTER = struct.Struct('<BQQQI')


class RecordHeads:
    """The heads of the records of a file: its ``blocks`` in order, and what its summary says.

    It was walked to ``offset``, behind the last whole record, but for ``holes``, each from byte to byte.
    ``statistics``, None without, are those of the summary, ``definitions`` those of a sound one; ``indexed``
    counts the messages of each channel by the message indexes. ``has_ended`` is whether the data end before
    ``offset``, ``is_finished`` whether the last magic bytes are there, ``is_regular`` whether the file ends
    in a sound summary and has neither damage nor messages outside of chunks. All are empty until
    :meth:`read_heads` fills them. ``file`` is the descriptor of the open file, ``size`` how long it is
    [bytes].
    """

    def __init__(self, file: int, path: Path, size: int) -> None:
        self._file, self._path, self._size = file, path, size
        self.offset = min(len(MAGIC), size)
        self.blocks: list[Block] = []
        self.has_ended = self.is_finished = self.is_regular = False
        self.holes: list[tuple[int, int]] = []
        self.statistics: Statistics | None = None
        self.definitions: list[Definition] = []
        self.indexed: Counter[int] = Counter()
        # Where chunks begin by their index, rising, and last the summary; empty without a sound one.
        self._places: list[int] = []
        self._has_bare = False

    def read_heads(self) -> None:
        """Read the summary, and the head of each record up to it, or to where the file is truncated.

        Fills in all attributes; call it once. A truncated last chunk becomes a block with ``is_cut``. Damage
        is a hole up to the next chunk by the index of chunks; without one the file counts as truncated there.

        Raises:
            OSError: The file cannot be read.
        """
        self._read_summary()
        end = self._places[-1] if self._places else self._size
        while self.offset < end and len(begin := os.pread(self._file, _BEGIN, self.offset)) >= HEAD.size:
            kind, length = HEAD.unpack_from(begin)
            offset, length = self.offset, length + HEAD.size
            # A crash often leaves a tail of zeros, which are no records.
            if kind == 0 or length > end - offset:
                if not self._places:
                    self._add_truncated_chunk(begin)
                    return
                self.offset = next(place for place in self._places if place > offset)
                self.holes.append((offset, self.offset))
                continue
            self.offset += length
            if kind == Opcode.FOOTER:
                self.has_ended = True
                self.is_finished = os.pread(self._file, len(MAGIC), self.offset) == MAGIC
                self.offset += len(MAGIC) * self.is_finished
                return
            self.has_ended = self.has_ended or kind == Opcode.DATA_END
            self._add_record(kind, offset, length, begin)
        if self._places:
            self.has_ended = self.is_finished = True
            self.is_regular = not (self.holes or self._has_bare)
            self.offset = self._size

    def _add_truncated_chunk(self, begin: bytes) -> None:
        """Add a block for the record at ``offset``, whose first bytes are given, where it is of a chunk."""
        if begin[0] == Opcode.CHUNK and len(begin) == _BEGIN and not self.has_ended:
            rest, size = self._size - self.offset, CHUNK_HEAD.unpack_from(begin, HEAD.size)[2]
            block = Block(self._path, self.offset, rest, min(size, MAX_CHUNK), True, is_cut=True)
            self.blocks.append(block)

    def _read_summary(self) -> None:
        """Read definitions, statistics and places from the summary where the file ends in a sound one.

        That has up to 32 MiB, a right checksum or none, and only whole records, none of them of data.

        Raises:
            OSError: The file cannot be read.
        """
        behind = max(self._size - _FOOTER.size - len(MAGIC), 0)
        end = os.pread(self._file, _FOOTER.size + len(MAGIC), behind)
        if len(end) < _FOOTER.size or end[0] != Opcode.FOOTER or end[_FOOTER.size :] != MAGIC:
            return
        _, length, start, _, checksum = _FOOTER.unpack_from(end)
        if length + HEAD.size != _FOOTER.size or not max(len(MAGIC), behind - _MAX_SUMMARY) <= start < behind:
            return
        data, at, places = os.pread(self._file, behind - start, start), 0, []
        if checksum and zlib.crc32(data + end[: _FOOTER.size - 4]) != checksum:
            return
        parsed = list[Definition | Statistics | None]()
        while at + HEAD.size <= len(data):
            kind, length = HEAD.unpack_from(data, at)
            record = data[at + HEAD.size : at + HEAD.size + length]
            at += HEAD.size + length
            if kind == Opcode.CHUNK_INDEX:
                places.append(int.from_bytes(record[16:24], 'little'))
            elif kind in PARSED:
                parsed.append(parse_record(kind, record))
            elif kind in _DATA:
                return
        if at == len(data) and None not in parsed:
            self.definitions = [record for record in parsed if isinstance(record, Definition)]
            self.statistics = next((record for record in parsed if isinstance(record, Statistics)), None)
            self._places = [*sorted(place for place in places if place < start), start]

    def _add_record(self, kind: int, offset: int, length: int, begin: bytes) -> None:
        """Add a record of the data to the last block, or begin a new block with it.

        An index of messages goes only to the chunk right before it, and its messages into ``indexed``. Other
        records are in no block; statistics are kept. ``length`` includes the head [bytes]; ``begin`` are its
        first bytes, from the head on.

        Raises:
            OSError: The file cannot be read.
        """
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
        elif kind == Opcode.STATISTICS:
            # Of a summary that is not sound itself: they tell what was lost.
            record = parse_record(kind, os.pread(self._file, min(length, MIB), offset)[HEAD.size :])
            self.statistics = record if isinstance(record, Statistics) else None
