# SPDX-License-Identifier: Apache-2.0
"""Which messages of a block are wanted: from its message index if it can be believed."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from mcap.opcode import Opcode

from .blocks import Loaded
from .records import HEAD, MESSAGE_HEAD, PAYLOAD, Contents, scan
from .values import IntArray
from .views import view


@dataclass(frozen=True, slots=True)
class Entries:
    """Messages of one channel in file order, shape (n,) each.

    ``offset`` is where a message's data begins in the block and ``size`` its length [bytes].
    """

    channel: int
    log_time_ns: IntArray
    offset: IntArray
    size: IntArray


def find_entries(loaded: Loaded, channels: Collection[int]) -> list[Entries]:
    """Find the messages of some channels in a block.

    Args:
        loaded: The block.
        channels: Ids of the channels.

    Returns:
        The messages of each channel that has any.
    """
    found = _from_index(loaded, channels) if loaded.block.index else None
    if found is None:
        found = _from_scan(loaded.data, channels)
    return [entries for entries in found if len(entries.offset)]


def list_contents(loaded: Loaded) -> Contents:
    """List all records of a block, stepping only through what its message index leaves out."""
    found = _from_index(loaded, loaded.block.index)
    if not found:
        return scan(loaded.data)
    channel = np.concatenate([np.full(len(e.offset), e.channel, np.int64) for e in found])
    log_time = np.concatenate([entries.log_time_ns for entries in found])
    begin = np.concatenate([entries.offset for entries in found]) - PAYLOAD
    end = begin + PAYLOAD + np.concatenate([entries.size for entries in found])
    contents = Contents(channel, log_time, begin, len(loaded.data))
    for start, stop in _gaps(np.sort(begin), np.sort(end), len(loaded.data)):
        part = scan(loaded.data[start:stop])
        if len(part.channel):
            return scan(loaded.data)
        contents.schemas.update(part.schemas)
        contents.channels.update(part.channels)
    return contents


def _gaps(begin: IntArray, end: IntArray, size: int) -> list[tuple[int, int]]:
    """Find what lies between records that begin and end at sorted offsets."""
    starts, stops = np.append(0, end), np.append(begin, size)
    apart = stops > starts
    return list(zip(starts[apart].tolist(), stops[apart].tolist(), strict=True))


def _from_index(loaded: Loaded, channels: Collection[int]) -> list[Entries] | None:
    found: list[Entries] = []
    for channel in channels:
        pairs = loaded.indexed(channel)
        if pairs is None:
            return None
        entries = _entries(loaded.data, channel, *pairs)
        if entries is None:
            return None
        found.append(entries)
    return found


def _from_scan(data: bytes, channels: Collection[int]) -> list[Entries]:
    contents = scan(data)
    found: list[Entries] = []
    for channel in channels:
        mine = contents.channel == channel
        offset = contents.offset[mine]
        size = view(data, '<i8')[offset + 1] - MESSAGE_HEAD.size
        found.append(Entries(channel, contents.log_time_ns[mine], offset + PAYLOAD, size))
    return found


def _entries(data: bytes, channel: int, log_time_ns: IntArray, offset: IntArray) -> Entries | None:
    """Take index entries that point to whole records of the channel and time; None if one lies."""
    if len(offset) and not 0 <= offset[0] <= offset[-1] <= len(data) - PAYLOAD:
        return None
    words = view(data, '<i8')
    # One word is the kind of record and, but for its highest byte, its length; the next is that
    # byte, the channel, and more.
    first = words[offset]
    size = (first >> 8) - MESSAGE_HEAD.size
    honest = (
        ((first & 0xFF) == Opcode.MESSAGE).all()
        and ((words[offset + 8] & 0xFFFFFF) == channel << 8).all()
        and (words[offset + HEAD.size + 6] == log_time_ns).all()
        and (size >= 0).all()
        and (size <= len(data) - PAYLOAD - offset).all()
    )
    return Entries(channel, log_time_ns, offset + PAYLOAD, size) if honest else None
