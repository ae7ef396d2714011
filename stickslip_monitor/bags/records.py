# SPDX-License-Identifier: Apache-2.0
"""The records of MCAP: how they begin, and where the messages of a chunk lie in it.

What a definition holds is parsed by the ``mcap`` package; messages are found by numpy.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from numpy.typing import NDArray

from stickslip_monitor.arrays import IntArray

MAGIC = b'\x89MCAP0\r\n'
HEAD = struct.Struct('<BQ')
MESSAGE_HEAD = struct.Struct('<HIQQ')
PAYLOAD = HEAD.size + MESSAGE_HEAD.size
"""Where the data of a message begins in its record [bytes]."""

# Everything the record classes raise on bytes that are not the record they claim to be.
PARSE_ERRORS = (McapError, struct.error, ValueError, MemoryError, OverflowError)

# Records that are looked at together [bytes]; what is found of them takes as much again.
_WINDOW = 4 << 20
# Of a definition that is looked at [bytes].
_LONGEST = 4 << 20
# Of so many channels each is looked for by itself.
_FEW = 8
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


@dataclass(slots=True)
class Piece:
    """Some records of a block, one behind the other.

    Attributes:
        data: The block.
        channel: The channel of each message, shape (n,).
        log_time_ns: Its log time, negative from 2^63 on [ns].
        offset: Where the data of each message begins in the block.
        size: How long it is [bytes].
        definitions: Records that define channels and schemas, by where they begin.
        odd: How many records are whole and cannot be read.
        steps: How often the walk had to leave a run of messages.
        end: The byte behind its last record.
    """

    data: bytes
    channel: NDArray[np.uint16]
    log_time_ns: IntArray
    offset: IntArray
    size: IntArray
    definitions: dict[int, bytes]
    odd: int
    steps: int
    end: int

    def groups(self) -> Iterator[tuple[int, IntArray]]:
        """Each channel that has messages, and which these are."""
        counts = np.bincount(self.channel)
        keys = np.flatnonzero(counts)
        if len(keys) <= _FEW:
            yield from ((key, np.flatnonzero(self.channel == key)) for key in keys.tolist())
            return
        rows = np.argsort(self.channel, kind='stable')
        yield from zip(keys.tolist(), np.split(rows, np.cumsum(counts[keys])[:-1]), strict=True)


def walk(data: bytes, hints: IntArray | None) -> Iterator[Piece]:
    """Step through the records of a block, up to the first that is not whole.

    Where messages begin is found by their first byte, or taken from a message index. Both are
    hints: a message counts where the record before it ends, and nowhere else.

    Args:
        data: The block.
        hints: Where messages begin after its message index, in order; None without one.

    Yields:
        The records, some megabytes at a time.
    """
    raw = np.frombuffer(data, np.uint8)
    words, next_words = view(data, '<i8'), view(data, '<u4', 8)
    end, is_whole = 0, True
    while is_whole and end + HEAD.size <= len(data):
        stop = min(end + _WINDOW, len(data))
        most = max(min(stop, len(data) - PAYLOAD + 1), end)
        if hints is None:
            begin = np.flatnonzero(raw[end:most] == _MESSAGE) + end
        else:
            begin = hints[slice(*hints.searchsorted([end, most]))]
        # The kind and all but the highest byte of the length, which comes before the channel.
        word, next_word = words[begin], next_words[begin]
        length = (word >> 8) + HEAD.size
        sound = ((word & 0xFF) == _MESSAGE) & ((next_word & 0xFF) == 0) & (length >= PAYLOAD)
        sound &= length <= len(data) - begin
        if not sound.all():
            begin, length, next_word = begin[sound], length[sound], next_word[sound]
        ends = begin + length
        # Candidates behind which the next one does not begin.
        last = np.append(np.flatnonzero(begin[1:] != ends[:-1]), len(ends) - 1)
        runs = [np.empty(0, np.int64)]
        definitions: dict[int, bytes] = {}
        odd = steps = 0
        while is_whole and end < stop:
            steps += 1
            k = int(begin.searchsorted(end))
            if k < len(ends) and begin[k] == end:
                to = int(last[last.searchsorted(k)])
                runs.append(np.arange(k, to + 1))
                end = int(ends[to])
                continue
            behind, bad = _step(data, end, definitions)
            if hints is not None and behind - end >= PAYLOAD and data[end] == _MESSAGE:
                # The index leaves a message out.
                hints = None
                break
            is_whole = behind > end
            end, odd = behind, odd + bad
        rows = np.concatenate(runs)
        if len(rows) < len(begin):
            begin, length, next_word = begin[rows], length[rows], next_word[rows]
        offset = begin + PAYLOAD
        channel = (next_word >> 8).astype(np.uint16)
        yield Piece(
            data, channel, words[offset - 16], offset, length - PAYLOAD, definitions, odd, steps,
            end,
        )  # fmt: skip


def _step(data: bytes, begin: int, definitions: dict[int, bytes]) -> tuple[int, int]:
    """The byte behind a record that is no message, and how many could not be read.

    The byte where it begins, for a record that is not whole.
    """
    if begin + HEAD.size > len(data):
        return begin, 0
    kind, length = HEAD.unpack_from(data, begin)
    end = begin + HEAD.size + length
    if end > len(data):
        return begin, 0
    if kind in _DEFINITIONS and end - begin <= _LONGEST:
        definitions[begin] = data[begin:end]
        return end, 0
    if kind == 0 and not length:
        # Zeros may go on for long.
        zeros: Any = _ZEROS.match(data, begin)
        count = (zeros.end() - begin) // HEAD.size
        return begin + count * HEAD.size, count
    return end, int(kind in (0, _MESSAGE, *_DEFINITIONS))
