# SPDX-License-Identifier: Apache-2.0
"""The order of time of MCAP files, by the indexes of the messages: nothing has to be unpacked for it."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from mcap.opcode import Opcode

from stickslip_logs.arrays import BoolArray, IntArray
from stickslip_logs.files import open_file
from stickslip_logs.recordings.mcap_chunks import HEAD, PAYLOAD, Block, DamagedBlock, Piece, load, walk
from stickslip_logs.recordings.mcap_file import McapFile
from stickslip_logs.time_order import MAX_TIME_NS, TimeCourse, TimeOrder

# A place is the number of a block above the byte in it, of which there are at most 2^27.
_BYTE_BITS = 32
# An index of messages: its channel, and how long its entries are [bytes]; the entries.
_INDEX_BEGIN = HEAD.size + 6
_ENTRY = np.dtype([('time', '<i8'), ('byte', '<u8')])
# Messages that are judged together.
_BATCH = 1 << 14
# Larger blocks without indexes, which no recorder writes, are not looked into [bytes].
_MAX_WALKED_BYTES = 16 << 20
# Pieces with fewer messages than one in so many bytes are sparse; no more of them are looked into in one
# pass: what was made to grow has 160 MB of records of 9 bytes, which take 5 s [bytes].
_SPARSE_BYTES, _MAX_SPARSE_BYTES = 1 << 16, 32 << 20

_NONE = np.empty(0, np.int64)
_Rows = tuple[IntArray, IntArray, IntArray]
"""Times [ns], numbers of topics, and places, shape (n,) each."""


class CourseOfBlocks:
    """How the messages of some topics went on, block by block.

    Attributes:
        notes: What is odd about their times.
        start_ns: The first resulting time, where it is another than chunks say [ns]; else None.
        end_ns: The last one, likewise [ns].
    """

    def __init__(
        self,
        course: TimeCourse,
        numbers: Mapping[str, int],
        spans: Mapping[int, tuple[int, int]],
        least_ns: int,
        *,
        is_corrected: bool,
    ) -> None:
        self._course, self._numbers, self._spans, self._least_ns = course, numbers, spans, least_ns
        self.notes = tuple(course.notes('the messages are', 'of the recorder'))
        self.start_ns = course.start_ns if is_corrected else None
        self.end_ns = course.end_ns if is_corrected else None

    def span(self, number: int, block: Block) -> tuple[int, int]:
        """Return first and last time of the block of a number, as they go on [ns]."""
        return self._spans.get(number, (block.start_ns, block.end_ns))

    def follow(self, number: int, file: McapFile, piece: Piece) -> IntArray:
        """Return the times of the messages of a block of a number, as they go on [ns], shape (n,)."""
        if not self._course.shifts:
            return piece.log_time_ns
        time_ns, is_time = piece.log_time_ns.copy(), _are_times(piece.log_time_ns, self._least_ns)
        rows = _rows_of(number, file, piece, self._numbers)
        time_ns[is_time] = self._course.follow(*(column[is_time] for column in rows))
        return time_ns


class BlockTimes:
    """The times of the messages of files, read as far as they are asked for.

    Args:
        files: The files in order.
        least_ns: The least log time that is one [ns].
    """

    def __init__(self, files: Sequence[McapFile], least_ns: int) -> None:
        self._files, self._least_ns, self._sparse_bytes = files, least_ns, 0

    def course(self, topics: Sequence[str]) -> CourseOfBlocks:
        """Judge the order of the messages of some topics."""
        numbers = {topic: number for number, topic in enumerate(topics)}
        order, spans = TimeOrder(), dict[int, tuple[int, int]]()
        waiting: list[_Rows] = []
        size = 0
        for number, rows in self._blocks(numbers):
            if rows[0].size:
                spans[number] = int(rows[0].min()), int(rows[0].max())
                waiting.append(rows)
                size += rows[0].size
            if size > _BATCH:
                order.add(*_joined(waiting))
                waiting, size = [], 0
        if waiting:
            order.add(*_joined(waiting))
        course = order.course()
        blocks = [block for file in self._files for block in file.blocks]
        is_corrected = bool(course.shifts) or any(
            start < blocks[number].start_ns or end > blocks[number].end_ns
            for number, (start, end) in spans.items()
        )
        if course.shifts:
            for number, rows in self._blocks(numbers):
                if rows[0].size:
                    time_ns = course.follow(*rows)
                    spans[number] = int(time_ns.min()), int(time_ns.max())
        return CourseOfBlocks(course, numbers, spans, self._least_ns, is_corrected=is_corrected)

    def _blocks(self, numbers: Mapping[str, int]) -> Iterator[tuple[int, _Rows]]:
        """Yield the number of each block, and its messages of some topics that have a time."""
        number, self._sparse_bytes = -1, 0
        for file in self._files:
            keys = {key: numbers[c.topic] for key, c in file.channels.items() if c.topic in numbers}
            mask = sum(1 << key for key in keys)
            with open_file(file.path) as opened:
                for block in file.blocks:
                    number += 1
                    if block.channels is not None and not block.channels & mask:
                        continue
                    rows = _indexed(number, opened.fileno(), block, keys) if file.is_stated else None
                    if rows is None:
                        rows = self._walked(number, file, block, numbers)
                    chosen = _are_times(rows[0], self._least_ns) & (rows[1] >= 0)
                    yield number, rows if chosen.all() else _some(rows, chosen)

    def _walked(self, number: int, file: McapFile, block: Block, numbers: Mapping[str, int]) -> _Rows:
        """Return the messages of a block after its records, as far as it can be restored."""
        parts, begin = [(_NONE, _NONE, _NONE)], 0
        if block.size > _MAX_WALKED_BYTES or self._sparse_bytes > _MAX_SPARSE_BYTES:
            return parts[0]
        with contextlib.suppress(DamagedBlock):
            for piece in walk(load(block)):
                parts.append(_rows_of(number, file, piece, numbers))
                if piece.channel.size * _SPARSE_BYTES < piece.end - begin:
                    self._sparse_bytes += piece.end - begin
                begin = piece.end
                if self._sparse_bytes > _MAX_SPARSE_BYTES:
                    break
        return _joined(parts)


def _some(rows: _Rows, chosen: IntArray | BoolArray) -> _Rows:
    return rows[0][chosen], rows[1][chosen], rows[2][chosen]


def _are_times(time_ns: IntArray, least_ns: int) -> BoolArray:
    result: BoolArray = (time_ns >= least_ns) & (time_ns <= MAX_TIME_NS)
    return result


def _joined(parts: Sequence[_Rows]) -> _Rows:
    time_ns, topic, place = (np.concatenate(each) for each in zip(*parts, strict=True))
    return time_ns, topic, place


def _indexed(number: int, file: int, block: Block, keys: Mapping[int, int]) -> _Rows | None:
    """Return the messages of a block after their indexes; None where these cannot be so."""
    if not block.is_chunk or not block.index_length:
        return None
    data = os.pread(file, block.index_length, block.offset + block.length)
    parts, at = [(_NONE, _NONE, _NONE)], 0
    while at + _INDEX_BEGIN <= len(data):
        kind, length = HEAD.unpack_from(data, at)
        channel = int.from_bytes(data[at + HEAD.size : at + HEAD.size + 2], 'little')
        size = int.from_bytes(data[at + HEAD.size + 2 : at + _INDEX_BEGIN], 'little')
        if kind != Opcode.MESSAGE_INDEX or size % _ENTRY.itemsize or size > length - 6:
            return None
        if channel in keys and size:
            if at + _INDEX_BEGIN + size > len(data):
                return None
            entries = np.frombuffer(data, _ENTRY, size // _ENTRY.itemsize, at + _INDEX_BEGIN)
            byte = entries['byte']
            if byte.max() >= block.size:
                return None
            place = (number << _BYTE_BITS) + byte.astype(np.int64) + PAYLOAD
            parts.append((entries['time'].astype(np.int64), np.full(byte.size, keys[channel]), place))
        at += HEAD.size + length
    rows = _joined(parts)
    is_rising = (rows[2][1:] >= rows[2][:-1]).all()
    return rows if is_rising else _some(rows, rows[2].argsort(kind='stable'))


def _rows_of(number: int, file: McapFile, piece: Piece, numbers: Mapping[str, int]) -> _Rows:
    """Return the messages of a piece of a block; those of other topics have the number -1."""
    keys, which = np.unique(piece.channel, return_inverse=True)
    known = [numbers.get(file.channels[k].topic, -1) if k in file.channels else -1 for k in keys.tolist()]
    topic = np.array(known, np.int64)[which] if known else _NONE
    return piece.log_time_ns, topic, (number << _BYTE_BITS) + piece.offset
