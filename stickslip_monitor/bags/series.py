# SPDX-License-Identifier: Apache-2.0
"""Numbers of several topics, read block by block and put in order once at the end.

Messages of several blocks in the order of their log times, with few blocks in memory.

One pass over a recording for the numbers that were asked for.
"""

from __future__ import annotations

import heapq
import itertools
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields

import numpy as np
from mcap.records import Channel

from stickslip_monitor.arrays import FloatArray, IntArray
from stickslip_monitor.bags.blocks import (
    Block,
    DamagedBlock,
    Loaded,
    Redefined,
    find_entries,
    load,
    prefetch,
)
from stickslip_monitor.bags.decode import FieldNumbers, FieldReader
from stickslip_monitor.bags.index import DATED, FileScan
from stickslip_monitor.bags.topics import make_plan
from stickslip_monitor.bags.values import Fault, Message, Request, Series, TimeSpans
from stickslip_monitor.fields import FieldPath


@dataclass(slots=True)
class ChannelColumn:
    """What was read of one channel of one file so far, in file order."""

    plan: FieldReader
    stamp_ns: list[IntArray] = field(default_factory=list)
    values: list[FloatArray] = field(default_factory=list)
    undecoded: int = 0
    encapsulations: Counter[int] = field(default_factory=Counter)
    short: Counter[int] = field(default_factory=Counter)

    @property
    def count(self) -> int:
        """The messages taken."""
        return sum(part.shape[1] for part in self.values)

    def take(self, numbers: FieldNumbers) -> None:
        """Append messages."""
        if numbers.stamp_ns is not None:
            self.stamp_ns.append(numbers.stamp_ns)
        self.values.append(numbers.values)
        self.undecoded += numbers.undecoded
        self.encapsulations.update(numbers.encapsulations)
        self.short.update(numbers.short)


@dataclass(frozen=True, slots=True, eq=False)
class MessageOrder:
    """Log time [ns] and sequence number of the messages of one strand, in file order."""

    log_time_ns: IntArray
    sequence: IntArray


@dataclass(slots=True)
class Order:
    """Which strand each message belongs to, and its log time [ns], in file order."""

    strand: list[IntArray] = field(default_factory=list)
    log_time_ns: list[IntArray] = field(default_factory=list)

    def take(self, strand: IntArray, log_time_ns: IntArray, offset: IntArray) -> None:
        """Append the messages of one block, by their offsets in it."""
        order = np.argsort(offset, kind='stable')
        self.strand.append(strand[order])
        self.log_time_ns.append(log_time_ns[order])

    def ranked(self, strands: int) -> list[MessageOrder]:
        """Number all messages by log time, then place, and sort them out to the strands."""
        strand, log_time = joined(self.strand), joined(self.log_time_ns)
        rank = np.arange(len(log_time))
        if not (log_time[1:] >= log_time[:-1]).all():
            rank[np.argsort(log_time, kind='stable')] = np.arange(len(log_time))
        places = (np.flatnonzero(strand == number) for number in range(strands))
        return [MessageOrder(log_time[place], rank[place]) for place in places]


def take_block(
    loaded: Loaded,
    strands: Mapping[int, tuple[int, ChannelColumn]],
    order: Order,
    known: Mapping[int, Channel],
    tell: Callable[[str], None],
) -> None:
    """Read the messages of a block.

    Args:
        loaded: The block.
        strands: Number and strand of each channel wanted.
        order: Where the order of the messages is noted.
        known: All channels of its file.
        tell: Told what is wrong with the block, in a sentence.

    Raises:
        DamagedBlock: A channel changes its meaning inside the block, or with it.
    """
    numbers: list[IntArray] = []
    times: list[IntArray] = []
    offsets: list[IntArray] = []
    for entries in find_entries(loaded, strands, known, tell):
        number, strand = strands[entries.channel]
        strand.take(strand.plan.read(loaded.data, entries.offset, entries.size))
        numbers.append(np.full(len(entries.offset), number, np.int64))
        times.append(entries.log_time_ns)
        offsets.append(entries.offset)
    order.take(joined(numbers), joined(times), joined(offsets))


@dataclass(frozen=True, slots=True, eq=False)
class Table:
    """The messages of one topic in order; ``values`` has a row for each path."""

    log_time_ns: IntArray
    stamp_ns: IntArray
    sequence: IntArray
    values: FloatArray


def make_table(
    strands: Sequence[ChannelColumn], ranked: Sequence[MessageOrder], rows: int
) -> Table:
    """Join the strands of a topic in the order of their sequence numbers."""
    log_time = joined([part.log_time_ns for part in ranked])
    sequence = joined([part.sequence for part in ranked])
    stamp = joined([_stamps(strand, part) for strand, part in zip(strands, ranked, strict=True)])
    parts = [np.empty((rows, 0)), *(part for strand in strands for part in strand.values)]
    values = np.concatenate(parts, axis=1)
    if not (sequence[1:] > sequence[:-1]).all():
        order = np.argsort(sequence)
        log_time, stamp, sequence = log_time[order], stamp[order], sequence[order]
        values = values[:, order]
    return Table(log_time, stamp, sequence, values)


def _stamps(strand: ChannelColumn, ranked: MessageOrder) -> IntArray:
    """Join the stamps, with the log time where a message has none."""
    if not strand.stamp_ns:
        return ranked.log_time_ns
    stamp = joined(strand.stamp_ns)
    return np.where(stamp == 0, ranked.log_time_ns, stamp)


def joined(parts: Sequence[IntArray]) -> IntArray:
    """Join arrays of integers, none at all giving an empty one."""
    if len(parts) == 1:
        return parts[0]
    return np.concatenate(parts) if parts else np.empty(0, np.int64)


@dataclass(frozen=True, slots=True)
class Source:
    """A block, the number of its file, topic and type of each channel wanted, and all channels."""

    file: int
    block: Block
    channels: Mapping[int, tuple[str, str]]
    known: Mapping[int, Channel]


_Item = tuple[int, int, int, int, Message]


def merged(
    sources: Iterable[Source], tell: Callable[[str], None], spans: TimeSpans
) -> Iterator[Message]:
    """Yield the messages of some blocks by log time, then by file and place.

    Args:
        sources: The blocks.
        tell: Told what is wrong with a block, in a sentence.
        spans: The log times that are wanted.

    Yields:
        The messages; a block is in memory only while its time span lasts.
    """
    waiting = sorted(sources, key=lambda source: source.block.start_ns, reverse=True)
    heads: list[tuple[_Item, int, Iterator[_Item]]] = []
    while waiting or heads:
        while waiting and (not heads or waiting[-1].block.start_ns <= heads[0][0][0]):
            _push(heads, len(waiting), _items(waiting.pop(), tell, spans))
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


def _items(source: Source, tell: Callable[[str], None], spans: TimeSpans) -> Iterator[_Item]:
    try:
        loaded = load(source.block)
        found = find_entries(loaded, source.channels, source.known, tell)
    except DamagedBlock as damage:
        tell(str(damage))
        return
    rows = sorted(
        row
        for entries in found
        for columns in [(entries.log_time_ns, entries.offset, entries.size)]
        for wanted in [spans.holds(entries.log_time_ns)]
        for row in zip(
            *(column[wanted].tolist() for column in columns),
            itertools.repeat(entries.channel),
            strict=False,
        )
    )
    for log_time, offset, size, channel in rows:
        topic, type_name = source.channels[channel]
        message = Message(topic, type_name, log_time, loaded.data[offset : offset + size])
        yield log_time, source.file, source.block.offset, offset, message


Progress = Callable[[int, int], None]


@dataclass(frozen=True, slots=True)
class Wanted:
    """The numbers wanted of one topic, with the requests for each of them."""

    topic: str
    type: str
    requests: Mapping[FieldPath, Sequence[Request]]


# The strands of a file by channel, each with its number among the strands of all files.
_FileStrands = dict[int, tuple[int, ChannelColumn]]


@dataclass(frozen=True, slots=True)
class ReadResult:
    """What a pass gave: the series, and the numbers of the files whose summary proved wrong."""

    series: dict[Request, Series]
    doubted: tuple[int, ...]


def read_series(
    files: Sequence[FileScan],
    topics: Sequence[Wanted],
    tell: Callable[[str], None],
    progress: Progress | None,
) -> ReadResult:
    """Read numbers of some topics.

    Args:
        files: The files of the recording in order.
        topics: What is wanted.
        tell: Told what is wrong with a block, in a sentence.
        progress: Told the bytes done and the bytes to do after each block.

    Returns:
        A series for each request.

    Raises:
        BagError: A path does not lead to a number, or a file cannot be read.
    """
    strands = _make_strands(files, topics)
    order = Order()
    jobs = list(_jobs(files, strands))
    total, done = sum(block.length for _, block in jobs), 0
    doubted = set()
    for (number, block), loaded in zip(jobs, prefetch([block for _, block in jobs]), strict=True):
        try:
            if isinstance(loaded, DamagedBlock):
                raise loaded
            take_block(loaded, strands[number], order, files[number].channels, tell)
        except Redefined:
            doubted.add(number)
        except DamagedBlock as damage:
            tell(str(damage))
        done += block.length
        if progress is not None:
            progress(done, total)
    doubted.update(
        number
        for number, (file, members) in enumerate(zip(files, strands, strict=True))
        if file.summarised and any(s.count != file.counts[id_] for id_, (_, s) in members.items())
    )
    return ReadResult(_all_series(topics, files, strands, order), tuple(sorted(doubted)))


def _make_strands(files: Sequence[FileScan], topics: Sequence[Wanted]) -> list[_FileStrands]:
    wanted = {topic.topic: topic for topic in topics}
    plans: dict[tuple[str, str, bytes], FieldReader] = {}
    strands: list[_FileStrands] = []
    number = 0
    for file in files:
        strands.append({})
        for channel in file.channels.values():
            if channel.topic in wanted:
                schema = file.schemas[channel.schema_id]
                key = (channel.topic, schema.name, schema.data)
                if key not in plans:
                    paths = tuple(wanted[channel.topic].requests)
                    plans[key] = make_plan(channel.topic, schema, paths)
                strands[-1][channel.id] = (number, ChannelColumn(plans[key]))
                number += 1
    return strands


def _jobs(
    files: Sequence[FileScan], strands: Sequence[_FileStrands]
) -> Iterator[tuple[int, Block]]:
    """List the blocks with the number of their file, without those that have nothing wanted."""
    for number, (file, members) in enumerate(zip(files, strands, strict=True)):
        for block in file.blocks:
            if members and (not block.index or block.index.keys() & members.keys()):
                yield number, block


def _all_series(
    topics: Sequence[Wanted],
    files: Sequence[FileScan],
    strands: Sequence[_FileStrands],
    order: Order,
) -> dict[Request, Series]:
    ranked = order.ranked(sum(map(len, strands)))
    earliest = 1 if any((file.end_ns or 0) >= DATED for file in files) else 0
    result: dict[Request, Series] = {}
    for topic in topics:
        mine = [
            member
            for file, members in zip(files, strands, strict=True)
            for channel, member in members.items()
            if file.channels[channel].topic == topic.topic
        ]
        result.update(_topic_series(topic, mine, ranked, earliest))
    return result


def _topic_series(
    topic: Wanted,
    members: Sequence[tuple[int, ChannelColumn]],
    ranked: Sequence[MessageOrder],
    earliest: int,
) -> Iterator[tuple[Request, Series]]:
    strands = [strand for _, strand in members]
    whole = make_table(strands, [ranked[number] for number, _ in members], len(topic.requests))
    # In the order of their times: those without one come first.
    unset = int(np.searchsorted(whole.log_time_ns, earliest))
    beyond = int(np.searchsorted(whole.log_time_ns, 0))
    table = Table(*(getattr(whole, part.name)[..., unset:] for part in fields(whole)))
    kinds = sum((strand.encapsulations for strand in strands), Counter[int]())
    common = [
        (beyond, 'have a log time of 2^63 ns or more, which is no time, and were not used'),
        (unset - beyond, 'have log time 0, as of a clock that was not set, and were not used'),
        (sum(strand.undecoded for strand in strands), f'cannot be decoded as {topic.type}'),
        *((count, f'are in {_encapsulation(kind)}') for kind, count in sorted(kinds.items())),
    ]
    for row, requests in enumerate(topic.requests.values()):
        short = sum(strand.short[row] for strand in strands)
        counts = [*common, (short, f"have too few elements for field '{requests[0].field}'")]
        faults = tuple(
            Fault(count, f"{count} of {len(whole.sequence)} messages of '{topic.topic}' {reason}")
            for count, reason in counts
            if count
        )
        series = Series(
            table.log_time_ns, table.stamp_ns, table.sequence, table.values[row], faults
        )
        yield from ((request, series) for request in requests)


# RTPS 2.5, table 10.3.
_ENCAPSULATIONS = {
    0x02: 'PL_CDR_BE', 0x03: 'PL_CDR_LE', 0x06: 'CDR2_BE', 0x07: 'CDR2_LE', 0x08: 'D_CDR2_BE',
    0x09: 'D_CDR2_LE', 0x0A: 'PL_CDR2_BE', 0x0B: 'PL_CDR2_LE', 0x04: 'XML',
}  # fmt: skip


def _encapsulation(kind: int) -> str:
    name = _ENCAPSULATIONS.get(kind, 'of no known name')
    return f'the encapsulation {name} (0x{kind:04x}), which is not decoded'
