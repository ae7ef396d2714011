# SPDX-License-Identifier: Apache-2.0
"""Judges the order of time of files: of MCAP by the indexes of the messages, without unpacking them."""

from __future__ import annotations

import contextlib
import functools
import os
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from mcap.opcode import Opcode

from stickslip_logs.arrays import BoolArray, IntArray
from stickslip_logs.files import open_file
from stickslip_logs.recordings.bag_file import BagFile
from stickslip_logs.recordings.mcap_chunks import HEAD, PAYLOAD, Block, DamagedBlock, Piece
from stickslip_logs.time_order import MAX_TIME_NS, Row, TimeCourse, TimeOrder
from stickslip_logs.units import MIB

# A place is the number of a block above the byte in it, of which there are at most 2^27.
_BYTE_BITS = 32
# An index of messages: its channel, and how long its entries of a time and a byte are [bytes].
_INDEX_BEGIN, _ENTRY_BYTES = HEAD.size + 6, 16
# Larger blocks without indexes, which no recorder writes, are not searched [bytes].
_MAX_WALKED_BYTES = 16 * MIB

_NONE = np.array([], np.int64)
_Rows = tuple[IntArray, IntArray, IntArray]
"""Times [ns], numbers of topics, and places, shape (n,) each."""
_TopicRows = tuple[int, IntArray, IntArray]
"""The number of a topic, times of its messages [ns], and at which bytes of a block they are, shape (n,)."""


@dataclass(frozen=True)
class CourseOfBlocks:
    """Course of the messages of some topics, block by block.

    Attributes:
        course: What to add to their times.
        numbers: The number of each topic, which is its source in the course.
        spans: First and last resulting time of each block with some of the messages, by its number [ns].
        least_ns: The least log time that is one [ns].
        is_corrected: Whether a resulting time lies outside what its chunk says.
    """

    course: TimeCourse
    numbers: Mapping[str, int]
    spans: Mapping[int, tuple[int, int]]
    least_ns: int
    is_corrected: bool

    def correct_times(self, number: int, file: BagFile, piece: Piece) -> IntArray:
        """Return the corrected log times of a piece's messages, by the number of its block [ns], shape (n,).

        Without corrections this is the array of the piece itself, else a copy. Invalid times are unchanged.
        """
        if not self.course.shifts:
            return piece.log_time_ns
        time_ns, is_time = piece.log_time_ns.copy(), _are_log_times(piece.log_time_ns, self.least_ns)
        own_ns, topic, byte = (column[is_time] for column in _rows_of(file, piece, self.numbers))
        time_ns[is_time] = self.course.correct_times(own_ns, topic, (number << _BYTE_BITS) + byte)
        return time_ns


class BlockTimes:
    """The times of the messages of files, from ``least_ns`` on, read as far as they are asked for."""

    def __init__(self, files: Sequence[BagFile], least_ns: int) -> None:
        self._files, self._least_ns = files, least_ns

    def judge_order(self, topics: Sequence[str]) -> CourseOfBlocks:
        """Read the times of some topics, numbered in this order; return their course.

        Blocks without indexes are decompressed: larger ones than 16 MB are not, and their times do not count.
        Where times step back, blocks are decompressed to look for copies, and the files are read once more if
        times have to be corrected.

        Raises:
            BagError: A file cannot be read; also OSError, where it cannot be opened.
        """
        numbers = {topic: number for number, topic in enumerate(topics)}
        order, spans = TimeOrder(is_in_blocks=True), dict[int, tuple[int, int]]()
        for number, rows_of_topics in self._iterate_blocks(numbers):
            spans[number] = _join_spans(
                order.add_to(topic, time_ns, byte, number << _BYTE_BITS)
                for topic, time_ns, byte in rows_of_topics
            )
        course = order.judge(read_rows=functools.partial(self._read_rows, numbers, spans))
        blocks = [block for file in self._files for block in file.blocks]
        is_corrected = bool(course.shifts) or any(
            start < blocks[number].start_ns or end > blocks[number].end_ns
            for number, (start, end) in spans.items()
        )
        if course.shifts:
            for number, rows_of_topics in self._iterate_blocks(numbers):
                resulting = (
                    course.correct_times(time_ns, np.full(byte.size, topic), (number << _BYTE_BITS) + byte)
                    for topic, time_ns, byte in rows_of_topics
                )
                spans[number] = _join_spans((int(times.min()), int(times.max())) for times in resulting)
        return CourseOfBlocks(course, numbers, spans, self._least_ns, is_corrected)

    def _iterate_blocks(self, numbers: Mapping[str, int]) -> Iterator[tuple[int, list[_TopicRows]]]:
        """Yield the number of each block with timed messages of some topics, and these, topic by topic.

        The numbers of blocks rise.

        Raises:
            BagError: A file cannot be read; also OSError, where it cannot be opened.
        """
        for file, blocks in select_blocks(self._files, numbers):
            keys = {key: numbers[c.topic] for key, c in file.channels.items() if c.topic in numbers}
            with open_file(file.path) as opened:
                for number, block in blocks:
                    rows = _read_indexes(opened.fileno(), block, keys) if file.is_stated else None
                    if rows is None:
                        rows = self._walk_block(file, block, numbers)
                    if rows := list(self._drop_untimed(rows)):
                        yield number, rows

    def _read_rows(
        self,
        numbers: Mapping[str, int],
        spans: Mapping[int, tuple[int, int]],
        begin: int,
        end: int,
        span_ns: tuple[int, int],
    ) -> Iterator[Row]:
        """Yield the messages of some topics from one place up to another in a span of time, by their place.

        In each block, whose first and last time is in ``spans`` [ns], they are yielded up to damage. The end
        is excluded, the last time of the span included [ns].

        Raises:
            BagError: A file cannot be read.
        """
        for file, blocks in select_blocks(self._files, numbers):
            for number, block in blocks:
                is_within = begin >> _BYTE_BITS <= number <= end >> _BYTE_BITS
                first_ns, last_ns = spans.get(number, (1, 0))
                if not is_within or not max(first_ns, span_ns[0]) <= min(last_ns, span_ns[1]):
                    continue
                with contextlib.suppress(DamagedBlock):
                    for piece in file.load_pieces(block, numbers)[1]:
                        time_ns, topic, byte = _rows_of(file, piece, numbers)
                        place = (number << _BYTE_BITS) + byte
                        rows = (topic >= 0) & (place >= begin) & (place < end)
                        rows &= (time_ns >= max(span_ns[0], self._least_ns)) & (time_ns <= span_ns[1])
                        for k in np.flatnonzero(rows).tolist():
                            first = int(piece.offset[k])
                            data = piece.data[first : first + int(piece.size[k])]
                            yield int(topic[k]), int(time_ns[k]), bytes(data)

    def _drop_untimed(self, rows: Iterable[_TopicRows]) -> Iterator[_TopicRows]:
        """Yield the messages of each topic that have a valid log time; skip a topic without any."""
        for topic, time_ns, byte in rows:
            is_time = _are_log_times(time_ns, self._least_ns)
            if is_time.all():
                yield topic, time_ns, byte
            elif is_time.any():
                yield topic, time_ns[is_time], byte[is_time]

    def _walk_block(self, file: BagFile, block: Block, numbers: Mapping[str, int]) -> list[_TopicRows]:
        """Return the messages of a block, topic by topic, by decompressing it, up to damage in it.

        The list is empty for a block of more than 16 MB.

        Raises:
            BagError: The file cannot be read.
        """
        parts = [(_NONE, _NONE, _NONE)]
        if block.size <= _MAX_WALKED_BYTES:
            with contextlib.suppress(DamagedBlock):
                for piece in file.load_times(block, numbers):
                    parts.append(_rows_of(file, piece, numbers))
        time_ns, topic, byte = (np.concatenate(column) for column in zip(*parts, strict=True))
        return [(k, time_ns[topic == k], byte[topic == k]) for k in np.unique(topic[topic >= 0]).tolist()]


def select_blocks(
    files: Iterable[BagFile], topics: Collection[str]
) -> Iterator[tuple[BagFile, list[tuple[int, Block]]]]:
    """Yield each file with those of its blocks, and their numbers, that may have some topics.

    Blocks are numbered through all files, from 0.
    """
    begin = 0
    for file in files:
        mask = sum(1 << key for key, channel in file.channels.items() if channel.topic in topics)
        blocks = enumerate(file.blocks, begin)
        yield file, [(k, b) for k, b in blocks if b.channels is None or b.channels & mask]
        begin += len(file.blocks)


def _join_spans(spans: Iterable[tuple[int, int]]) -> tuple[int, int]:
    """Return the earliest start and the latest end of spans, of which there is at least one [ns]."""
    starts, ends = zip(*spans, strict=True)
    return min(starts), max(ends)


def _are_log_times(time_ns: IntArray, least_ns: int) -> BoolArray:
    """Return which times [ns] lie from ``least_ns`` to ``MAX_TIME_NS``, both included, shape (n,)."""
    result: BoolArray = (time_ns >= least_ns) & (time_ns <= MAX_TIME_NS)
    return result


def _read_indexes(file: int, block: Block, keys: Mapping[int, int]) -> list[_TopicRows] | None:
    """Return the messages of a block by its indexes, without decompressing it.

    Those of a topic are by place in the block. ``file`` is the descriptor of the open file, ``keys`` has the
    numbers of the topics by channel id. None where there are no indexes, or they cannot be right. An OSError
    of reading goes through.
    """
    if not block.is_chunk or not block.index_length:
        return None
    data = os.pread(file, block.index_length, block.offset + block.length)
    by_topic: dict[int, list[IntArray]] = {}
    at = 0
    while at + _INDEX_BEGIN <= len(data):
        kind, length = HEAD.unpack_from(data, at)
        channel = int.from_bytes(data[at + HEAD.size : at + HEAD.size + 2], 'little')
        size = int.from_bytes(data[at + HEAD.size + 2 : at + _INDEX_BEGIN], 'little')
        if kind != Opcode.MESSAGE_INDEX or size % _ENTRY_BYTES or size > length - 6:
            return None
        if channel in keys and size:
            if at + _INDEX_BEGIN + size > len(data):
                return None
            entries = np.frombuffer(data, '<i8', size // 8, at + _INDEX_BEGIN).reshape(-1, 2)
            by_topic.setdefault(keys[channel], []).append(entries)
        at += HEAD.size + length
    result = []
    for topic, parts in by_topic.items():
        entries = np.concatenate(parts)
        time_ns, byte = entries[entries[:, 1].argsort(kind='stable')].T.copy()
        if byte[0] < 0 or byte[-1] >= block.size:
            return None
        result.append((topic, time_ns, byte))
    return result


def _rows_of(file: BagFile, piece: Piece, numbers: Mapping[str, int]) -> _Rows:
    """Return log times [ns], topics by ``numbers`` (-1 for others) and places of a piece's messages, (n,)."""
    keys, which = np.unique(piece.channel, return_inverse=True)
    topics = [numbers.get(file.channels[k].topic, -1) if k in file.channels else -1 for k in keys.tolist()]
    topic = np.array(topics, np.int64)[which] if topics else _NONE
    return piece.log_time_ns, topic, piece.offset - PAYLOAD if piece.row is None else piece.row
