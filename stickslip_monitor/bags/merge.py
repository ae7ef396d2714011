# SPDX-License-Identifier: Apache-2.0
"""Messages of several blocks in the order of their log times, with few blocks in memory."""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass

from .blocks import Block, DamagedBlock, load
from .entries import find_entries
from .values import Message


@dataclass(frozen=True, slots=True)
class Source:
    """A block, the number of its file, and topic and type of each channel wanted from it."""

    file: int
    block: Block
    channels: Mapping[int, tuple[str, str]]


_Item = tuple[int, int, int, int, Message]


def merged(sources: Iterable[Source], damaged: Callable[[str], None]) -> Iterator[Message]:
    """Yield the messages of some blocks by log time, then by file and place.

    Args:
        sources: The blocks.
        damaged: Told the sentence of each block that is damaged.

    Yields:
        The messages; a block is in memory only while its time span lasts.
    """
    waiting = sorted(sources, key=lambda source: source.block.start_ns, reverse=True)
    heads: list[tuple[_Item, int, Iterator[_Item]]] = []
    while waiting or heads:
        while waiting and (not heads or waiting[-1].block.start_ns <= heads[0][0][0]):
            _push(heads, len(waiting), _items(waiting.pop(), damaged))
        if heads:
            item, number, items = heapq.heappop(heads)
            yield item[-1]
            _push(heads, number, items)


def _push(
    heads: list[tuple[_Item, int, Iterator[_Item]]], number: int, items: Iterator[_Item]
) -> None:
    item = next(items, None)
    if item is not None:
        heapq.heappush(heads, (item, number, items))


def _items(source: Source, damaged: Callable[[str], None]) -> Iterator[_Item]:
    try:
        loaded = load(source.block)
    except DamagedBlock as damage:
        damaged(str(damage))
        return
    rows = sorted(
        row
        for entries in find_entries(loaded, source.channels)
        for row in zip(
            entries.log_time_ns.tolist(),
            entries.offset.tolist(),
            entries.size.tolist(),
            itertools.repeat(entries.channel),
            strict=False,
        )
    )
    for log_time, offset, size, channel in rows:
        topic, type_name = source.channels[channel]
        message = Message(topic, type_name, log_time, loaded.data[offset : offset + size])
        yield log_time, source.file, source.block.offset, offset, message
