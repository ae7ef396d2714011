# SPDX-License-Identifier: Apache-2.0
"""The records of MCAP: how they begin, and where the messages of a chunk lie in it.

What a definition holds is parsed by the ``mcap`` package; messages are found by numpy.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from numpy.typing import NDArray

from stickslip_monitor.arrays import BoolArray, IntArray

MAGIC = b'\x89MCAP0\r\n'
HEAD = struct.Struct('<BQ')
MESSAGE_HEAD = struct.Struct('<HIQQ')
PAYLOAD = HEAD.size + MESSAGE_HEAD.size

# Everything the record classes raise on bytes that are not the record they claim to be.
PARSE_ERRORS = (McapError, struct.error, ValueError, MemoryError, OverflowError)

# Records that are looked at together [bytes]; what is found of them takes as much again.
_WINDOW = 4 << 20
# Of a definition that is looked at [bytes].
_LONGEST = 4 << 20
# Of so many channels each is looked for by itself.
_FEW = 8
_NOTHING = np.empty(0, np.int64)
_ZEROS = re.compile(rb'\0*')
# Plain numbers: members of an enumeration are looked up slowly.
_MESSAGE = int(Opcode.MESSAGE)
_DEFINITIONS = (int(Opcode.SCHEMA), int(Opcode.CHANNEL))


def view(data: bytes, code: str, begin: int = 0) -> NDArray[Any]:
    """View a buffer as one number at every byte, aligned or not.

    Args:
        data: The buffer.
        code: numpy type of the number, with its byte order.
        begin: Byte of the first number.

    Returns:
        An array in which element k is the number that begins k bytes later; no copy.
    """
    dtype = np.dtype(code)
    count = max(len(data) - begin - dtype.itemsize + 1, 0)
    return np.ndarray((count,), dtype, data, begin if count else 0, strides=(1,))


@dataclass(frozen=True, slots=True)
class Piece:
    """Some records of a block, one behind the other.

    Attributes:
        data: The block.
        channel: The channel of each message, shape (n,).
        log_time_ns: Its log time, negative from 2^63 on [ns].
        offset: Where the data of each message begins in the block.
        size: How long it is [bytes].
        definitions: Records that define channels and schemas, by where they begin.
    """

    data: bytes
    channel: NDArray[np.uint16]
    log_time_ns: IntArray
    offset: IntArray
    size: IntArray
    definitions: dict[int, bytes]

    def of(self, key: int) -> IntArray:
        """Which messages are those of a channel."""
        return np.flatnonzero(self.channel == key)

    def groups(self) -> Iterator[tuple[int, IntArray]]:
        """Each channel that has messages, and which these are."""
        counts = np.bincount(self.channel)
        keys = np.flatnonzero(counts)
        if len(keys) <= _FEW:
            yield from ((key, self.of(key)) for key in keys.tolist())
            return
        rows = np.argsort(self.channel, kind='stable')
        yield from zip(keys.tolist(), np.split(rows, np.cumsum(counts[keys])[:-1]), strict=True)


class MessagePlaces(NamedTuple):
    """Messages in a block: where their records begin, how long they are [bytes], the channel."""

    begin: IntArray
    length: IntArray
    channel: NDArray[np.uint16]

    def parts(self, runs: Sequence[slice]) -> MessagePlaces:
        """Some stretches of them."""
        if len(runs) == 1:
            return self.part(runs[0])
        rows = [_NOTHING, *(np.arange(run.start, run.stop) for run in runs)]
        return self.part(np.concatenate(rows))

    def part(self, rows: slice | IntArray | BoolArray) -> MessagePlaces:
        """Some of them."""
        return MessagePlaces(self.begin[rows], self.length[rows], self.channel[rows])


class Walker:
    """Steps through the records of a block that was decompressed.

    Where messages begin is found by their first bytes, or taken from a message index. Both are
    hints: a message counts where the record before it ends, and nowhere else.

    Args:
        data: The block.
        hints: Where messages begin after the message index, in order; None without an index.

    Attributes:
        end: The byte after the last record that is whole.
        odd: Records that are whole and cannot be read.
        steps: How often the walk had to leave a run of messages.
        is_index_wrong: Whether the index left a message out, or has what is none.
    """

    def __init__(self, data: bytes, hints: IntArray | None) -> None:
        self.data = data
        self.end = self.odd = self.steps = 0
        self.is_index_wrong = False
        self._hints = hints
        self._used = 0
        self._bytes = np.frombuffer(data, np.uint8)
        self._words = view(data, '<i8')
        self._next_words = view(data, '<u4', 8)

    def pieces(self) -> Iterator[Piece]:
        """Yield all records, up to the first that is not whole."""
        is_going_on = True
        while is_going_on and self.end + HEAD.size <= len(self.data):
            found, definitions, is_going_on = self._take()
            offset = found.begin + PAYLOAD
            log_time = self._words[offset - 16]
            size = found.length - PAYLOAD
            yield Piece(self.data, found.channel, log_time, offset, size, definitions)
        if self._hints is not None and self._used < len(self._hints):
            self.is_index_wrong = True

    def _take(self) -> tuple[MessagePlaces, dict[int, bytes], bool]:
        """Messages and definitions that begin in the next window, and whether there is more."""
        stop = min(self.end + _WINDOW, len(self.data))
        found = self._candidates(stop)
        ends = found.begin + found.length
        # Candidates behind which the next one does not begin.
        last = np.append(np.flatnonzero(found.begin[1:] != ends[:-1]), len(ends) - 1)
        runs: list[slice] = []
        definitions: dict[int, bytes] = {}
        is_whole = True
        while is_whole and self.end < stop:
            self.steps += 1
            k = int(found.begin.searchsorted(self.end))
            if k < len(ends) and found.begin[k] == self.end:
                to = int(last[last.searchsorted(k)])
                runs.append(slice(k, to + 1))
                self.end = int(ends[to])
            elif self._hints is not None and self._is_message():
                self._hints, self.is_index_wrong = None, True
                break
            else:
                is_whole = self._step(definitions)
        found = found.parts(runs)
        self._used += len(found.begin)
        return found, definitions, is_whole

    def _candidates(self, stop: int) -> MessagePlaces:
        """Messages that may begin in the window."""
        most = max(min(stop, len(self.data) - PAYLOAD + 1), self.end)
        if self._hints is not None:
            first, behind = self._hints.searchsorted([self.end, most])
            begin = self._hints[first:behind]
        else:
            begin = np.flatnonzero(self._bytes[self.end : most] == _MESSAGE)
            begin += self.end
        # The kind and all but the highest byte of the length, which comes before the channel.
        word, next_word = self._words[begin], self._next_words[begin]
        length = (word >> 8) + HEAD.size
        sound = ((word & 0xFF) == _MESSAGE) & ((next_word & 0xFF) == 0) & (length >= PAYLOAD)
        sound &= length <= len(self.data) - begin
        found = MessagePlaces(begin, length, (next_word >> 8).astype(np.uint16))
        return found if sound.all() else found.part(sound)

    def _head(self) -> tuple[int, int]:
        """Kind of the record at the end, and the byte behind it; kind -1 where it is not whole."""
        if self.end + HEAD.size > len(self.data):
            return -1, self.end
        kind, length = HEAD.unpack_from(self.data, self.end)
        behind = self.end + HEAD.size + length
        return (kind, behind) if behind <= len(self.data) else (-1, self.end)

    def _is_message(self) -> bool:
        kind, behind = self._head()
        return kind == _MESSAGE and behind - self.end >= PAYLOAD

    def _step(self, definitions: dict[int, bytes]) -> bool:
        """Step over a record that is no message; False where it is not whole."""
        kind, behind = self._head()
        if kind < 0:
            return False
        if kind in _DEFINITIONS and behind - self.end <= _LONGEST:
            definitions[self.end] = self.data[self.end : behind]
        elif kind == 0 and behind - self.end == HEAD.size:
            # Zeros may go on for long.
            zeros: Any = _ZEROS.match(self.data, self.end)
            count = (zeros.end() - self.end) // HEAD.size
            self.odd += count
            behind = self.end + count * HEAD.size
        else:
            self.odd += kind in (0, _MESSAGE, *_DEFINITIONS)
        self.end = behind
        return True
