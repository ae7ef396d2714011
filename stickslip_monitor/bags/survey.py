# SPDX-License-Identifier: Apache-2.0
"""From the records of a file to the blocks it is read in."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import IO

from mcap.opcode import Opcode

from .blocks import Block, Kind
from .records import HEAD, Place

# Longer runs of records outside of chunks are read in pieces of about this size [bytes].
_RUN = 1 << 20

_BARE = (Opcode.MESSAGE, Opcode.CHANNEL, Opcode.SCHEMA)


def blocks_of(path: Path, file: IO[bytes], places: Iterable[Place]) -> Iterator[Block]:
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


def _begin(path: Path, place: Place) -> Block | None:
    if place.opcode == Opcode.CHUNK:
        return Block(path, Kind.CHUNK, place.offset, place.length, 0, 0, {}, 0)
    if place.opcode in _BARE:
        return Block(path, Kind.BARE, place.offset, place.length, 0, 0, {}, 0)
    return None


def _join(group: Block, place: Place, file: IO[bytes]) -> Block | None:
    if group.kind is Kind.CHUNK and place.opcode == Opcode.MESSAGE_INDEX:
        file.seek(place.offset + HEAD.size)
        channel = int.from_bytes(file.read(2), 'little')
        index = {**group.index, channel: place.offset}
        length = group.index_length + place.length
        return dataclasses.replace(group, index=index, index_length=length)
    if group.kind is Kind.BARE and place.opcode in _BARE and group.length < _RUN:
        return dataclasses.replace(group, length=group.length + place.length)
    return None
