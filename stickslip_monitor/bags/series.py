# SPDX-License-Identifier: Apache-2.0
"""One pass over a recording for the numbers that were asked for, in blocks.

The chunks of a recording are taken in the order in which they begin, and what lies before the
beginning of the next one is put in order and handed on. So memory holds the chunks that overlap
in time and no more: as a rule two. Only a recording whose chunks all span much of it, because it
was written in no order of time, takes memory in proportion to its length.

Messages of several blocks in the order of their log times, with few blocks in memory.
"""

from __future__ import annotations

import heapq
import itertools
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from mcap.records import Channel

from stickslip_monitor.arrays import FloatArray, IntArray
from stickslip_monitor.bags.blocks import (
    Block,
    DamagedBlock,
    Entries,
    Loaded,
    Redefined,
    find_entries,
    load,
    prefetch,
)
from stickslip_monitor.bags.decode import FieldReader
from stickslip_monitor.bags.index import DATED, FileScan
from stickslip_monitor.bags.mcap_file import Payload
from stickslip_monitor.bags.mcap_records import view
from stickslip_monitor.bags.topics import make_plan
from stickslip_monitor.bags.values import Fault, Message, Request, Series, TimeSpans
from stickslip_monitor.fields import FieldPath

# Messages of each topic, and of all, that are handed on at a time: few enough for the caches.
_OF_TOPIC, _OF_ALL = 1 << 15, 1 << 19
# Bits of a message's place in the recording that are its place in a block.
_PLACE = 32


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


def payloads(
    sources: Iterable[Source], tell: Callable[[str], None], spans: TimeSpans
) -> Iterator[tuple[int, dict[str, tuple[IntArray, Payload]]]]:
    """Yield the messages of one block after the other, in the order in which those begin.

    Args:
        sources: The blocks.
        tell: Told what is wrong with a block, in a sentence.
        spans: The log times that are wanted.

    Yields:
        When a block begins [ns], and log times and messages, encoded, of each topic in it.
    """
    ordered = sorted(sources, key=lambda source: source.block.start_ns)
    blocks = prefetch([source.block for source in ordered])
    for source, loaded in zip(ordered, blocks, strict=True):
        try:
            if isinstance(loaded, DamagedBlock):
                raise loaded
            found = find_entries(loaded, source.channels, source.known, tell)
        except DamagedBlock as damage:
            tell(str(damage))
            continue
        columns = {}
        for entries in found:
            rows = np.flatnonzero(spans.holds(entries.log_time_ns))
            if rows.size:
                raw = _raw(loaded.data, entries.offset[rows], entries.size[rows])
                columns[source.channels[entries.channel][0]] = entries.log_time_ns[rows], raw
        yield source.block.start_ns, columns


def _raw(data: bytes, offset: IntArray, size: IntArray) -> Payload:
    if size.min() == size.max() > 0:
        return view(data, f'V{size[0]}')[offset]
    ends = (offset + size).tolist()
    return [data[begin:end] for begin, end in zip(offset.tolist(), ends, strict=True)]


Progress = Callable[[int, int], None]


@dataclass(frozen=True, slots=True)
class Wanted:
    """The numbers wanted of one topic, with the requests for each of them."""

    topic: str
    type: str
    requests: Mapping[FieldPath, Sequence[Request]]


class Doubt(Exception):
    """The summary of a file does not say what is in it; ``file`` is its number."""

    def __init__(self, file: int) -> None:
        super().__init__(file)
        self.file = file


class _Rows(NamedTuple):
    """Messages of a topic, shape (n,) each; ``values`` has a row for each path.

    ``place`` is where a message lies: the number of its block, and the byte in it.
    """

    log_time_ns: IntArray
    stamp_ns: IntArray
    place: IntArray
    values: FloatArray

    def part(self, rows: slice | IntArray) -> _Rows:
        """Some of them."""
        columns: Any = (column[..., rows] for column in self)
        return _Rows(*columns)


@dataclass(slots=True)
class _TopicColumn:
    """What was read of one topic so far: counts of all, and the messages not handed on yet."""

    wanted: Wanted
    waiting: list[_Rows] = field(default_factory=list)
    count: int = 0
    beyond: int = 0
    unset: int = 0
    undecoded: int = 0
    encapsulations: Counter[int] = field(default_factory=Counter)
    short: Counter[int] = field(default_factory=Counter)

    def take(
        self, plan: FieldReader, data: bytes, entries: Entries, block: int, least: int
    ) -> None:
        """Take the messages of one channel of a block, in the order in which they lie there."""
        numbers = plan.read(data, entries.offset, entries.size)
        log_time = entries.log_time_ns
        stamp = log_time
        if numbers.stamp_ns is not None:
            stamp = np.where(numbers.stamp_ns == 0, log_time, numbers.stamp_ns)
        rows = _Rows(log_time, stamp, entries.offset + (block << _PLACE), numbers.values)
        self.count += len(log_time)
        self.undecoded += numbers.undecoded
        self.encapsulations.update(numbers.encapsulations)
        self.short.update(numbers.short)
        if log_time.min() < least:
            beyond = int((log_time < 0).sum())
            self.beyond += beyond
            self.unset += int((log_time < least).sum()) - beyond
            rows = rows.part(np.flatnonzero(log_time >= least))
        self.waiting.append(rows)

    def joined(self) -> _Rows:
        """The messages that wait, as far as known in order."""
        if len(self.waiting) == 1:
            return self.waiting[0]
        nothing = np.empty(0, np.int64)
        none = _Rows(nothing, nothing, nothing, np.empty((len(self.wanted.requests), 0)))
        columns = zip(none, *self.waiting, strict=True)
        return _Rows(*(np.concatenate(parts, axis=-1) for parts in columns))

    def faults(self) -> Iterator[tuple[Request, tuple[Fault, ...]]]:
        """What was wrong with the messages, for each request."""
        common = [
            (
                self.beyond,
                'have a log time of 2^63 ns or more, which is no time, and were not used',
            ),
            (self.unset, 'have log time 0, as of a clock that was not set, and were not used'),
            (self.undecoded, f'cannot be decoded as {self.wanted.type}'),
            *(
                (n, f'are in {_encapsulation(kind)}')
                for kind, n in sorted(self.encapsulations.items())
            ),
        ]
        whole = f"of {self.count} messages of '{self.wanted.topic}'"
        for row, requests in enumerate(self.wanted.requests.values()):
            short = (self.short[row], f"have too few elements for field '{requests[0].field}'")
            faults = tuple(
                Fault(count, f'{count} {whole} {reason}')
                for count, reason in (*common, short)
                if count
            )
            yield from ((request, faults) for request in requests)


# The topic of each channel wanted of a file, with the plan to read it.
_FileChannels = dict[int, tuple[_TopicColumn, FieldReader]]


class Reading:
    """A pass over a recording for numbers of some topics.

    Iterating gives a series for each request, for one stretch of time after the other.

    Args:
        files: The files of the recording in order.
        topics: What is wanted.
        tell: Told what is wrong with a block, in a sentence.
        progress: Told the bytes done and the bytes to do after each block.

    Raises:
        BagError: A path does not lead to a number.
    """

    def __init__(
        self,
        files: Sequence[FileScan],
        topics: Sequence[Wanted],
        tell: Callable[[str], None],
        progress: Progress | None,
    ) -> None:
        self._files, self._tell, self._progress = files, tell, progress
        self._columns = [_TopicColumn(topic) for topic in topics]
        self._channels = _plan(files, self._columns)
        self._counts: list[Counter[int]] = [Counter() for _ in files]
        self._least = 1 if any((file.end_ns or 0) >= DATED for file in files) else 0
        self._sequence = 0

    def __iter__(self) -> Iterator[dict[Request, Series]]:
        """Yield the series, without faults, of one stretch of time after the other.

        Raises:
            Doubt: The summary of a file proves wrong: what was yielded may be so too.
            BagError: A file cannot be read.
        """
        jobs = sorted(enumerate(self._jobs()), key=lambda job: (job[1][1].start_ns, job[0]))
        begins = [block.start_ns for _, (_, block) in jobs]
        most = limit = min(_OF_TOPIC * len(self._columns), _OF_ALL)
        for number, waiting in enumerate(self._load(jobs), 1):
            if waiting >= limit and number < len(jobs):
                yield self._flush(begins[number])
                limit = most + 2 * self._waiting
        yield self._flush(None)
        self._compare()

    def faults(self) -> dict[Request, tuple[Fault, ...]]:
        """What was wrong with the messages read."""
        return dict(pair for column in self._columns for pair in column.faults())

    @property
    def _waiting(self) -> int:
        return sum(len(rows.place) for column in self._columns for rows in column.waiting)

    def _jobs(self) -> Iterator[tuple[int, Block]]:
        """List the blocks that may have something wanted, with the number of their file."""
        for number, (file, members) in enumerate(zip(self._files, self._channels, strict=True)):
            for block in file.blocks:
                if members and (not block.index or block.index.keys() & members.keys()):
                    yield number, block

    def _load(self, jobs: Sequence[tuple[int, tuple[int, Block]]]) -> Iterator[int]:
        """Take the blocks; yield how many messages wait after each."""
        total, done = sum(block.length for _, (_, block) in jobs), 0
        for job, loaded in zip(jobs, prefetch([b for _, (_, b) in jobs]), strict=True):
            place, (number, block) = job
            try:
                if isinstance(loaded, DamagedBlock):
                    raise loaded
                self._take(loaded, number, place)
            except Redefined:
                raise Doubt(number) from None
            except DamagedBlock as damage:
                self._tell(str(damage))
            done += block.length
            if self._progress is not None:
                self._progress(done, total)
            yield self._waiting

    def _take(self, loaded: Loaded, number: int, place: int) -> None:
        """Read the messages of a block.

        Raises:
            DamagedBlock: A channel changes its meaning inside the block, or with it.
        """
        channels = self._channels[number]
        known = self._files[number].channels
        for entries in find_entries(loaded, channels, known, self._tell):
            if (
                entries.log_time_ns.min() < loaded.block.start_ns
                and self._files[number].summarised
            ):
                raise Doubt(number)
            column, plan = channels[entries.channel]
            column.take(plan, loaded.data, entries, place, self._least)
            self._counts[number][entries.channel] += len(entries.offset)

    def _flush(self, before_ns: int | None) -> dict[Request, Series]:
        """Hand on, in order, what lies before a log time [ns]."""
        tables = [column.joined() for column in self._columns]
        if not tables:
            return {}
        log_time = np.concatenate([rows.log_time_ns for rows in tables])
        order = np.argsort(np.concatenate([rows.place for rows in tables]), kind='stable')
        ordered = log_time[order]
        if (ordered[1:] < ordered[:-1]).any():
            order = order[np.argsort(ordered, kind='stable')]
            ordered = log_time[order]
        done = len(order)
        if before_ns is not None:
            done = int(np.searchsorted(ordered, before_ns))
        rank = np.empty(len(order), np.int64)
        rank[order] = np.arange(len(order))
        result: dict[Request, Series] = {}
        begin = 0
        for column, rows in zip(self._columns, tables, strict=True):
            own = rank[begin : begin + len(rows.place)]
            begin += len(rows.place)
            result.update(_hand_on(column, rows, own, done, self._sequence))
        self._sequence += done
        return result

    def _compare(self) -> None:
        """Doubt a summary that counts otherwise."""
        rows = zip(self._files, self._channels, self._counts, strict=True)
        for number, (file, members, counts) in enumerate(rows):
            if file.summarised and any(counts[id_] != file.counts[id_] for id_ in members):
                raise Doubt(number)


def _hand_on(
    column: _TopicColumn, rows: _Rows, rank: IntArray, done: int, sequence: int
) -> Iterator[tuple[Request, Series]]:
    """The series of a topic's messages of low rank; the others wait on."""
    if (rank[1:] < rank[:-1]).any():
        order = np.argsort(rank)
        rows, rank = rows.part(order), rank[order]
    cut = int(np.searchsorted(rank, done))
    column.waiting = [rows.part(slice(cut, None))] if cut < len(rank) else []
    log_time, stamp, _, values = rows.part(slice(cut))
    number = rank[:cut] + sequence
    for value, requests in zip(values, column.wanted.requests.values(), strict=True):
        series = Series(log_time, stamp, number, value, ())
        yield from ((request, series) for request in requests)


def joined(parts: Iterable[Mapping[Request, Series]], reading: Reading) -> dict[Request, Series]:
    """The series of a whole recording."""
    found: dict[Request, list[Series]] = {}
    for part in parts:
        for request, series in part.items():
            found.setdefault(request, []).append(series)
    faults = reading.faults()
    return {request: _joined(series, faults[request]) for request, series in found.items()}


def _joined(parts: Sequence[Series], faults: tuple[Fault, ...]) -> Series:
    log_time, stamp, sequence = (
        np.concatenate([getattr(part, name) for part in parts])
        for name in ('log_time_ns', 'stamp_ns', 'sequence')
    )
    return Series(log_time, stamp, sequence, np.concatenate([p.value for p in parts]), faults)


def _plan(files: Sequence[FileScan], columns: Sequence[_TopicColumn]) -> list[_FileChannels]:
    known = {column.wanted.topic: column for column in columns}
    plans: dict[tuple[str, str, bytes], FieldReader] = {}
    found: list[_FileChannels] = []
    for file in files:
        found.append({})
        for channel in file.channels.values():
            column = known.get(channel.topic)
            if column is not None:
                schema = file.schemas[channel.schema_id]
                key = (channel.topic, schema.name, schema.data)
                if key not in plans:
                    plans[key] = make_plan(channel.topic, schema, tuple(column.wanted.requests))
                found[-1][channel.id] = column, plans[key]
    return found


# RTPS 2.5, table 10.3.
_ENCAPSULATIONS = {
    0x02: 'PL_CDR_BE', 0x03: 'PL_CDR_LE', 0x06: 'CDR2_BE', 0x07: 'CDR2_LE', 0x08: 'D_CDR2_BE',
    0x09: 'D_CDR2_LE', 0x0A: 'PL_CDR2_BE', 0x0B: 'PL_CDR2_LE', 0x04: 'XML',
}  # fmt: skip


def _encapsulation(kind: int) -> str:
    name = _ENCAPSULATIONS.get(kind, 'of no known name')
    return f'the encapsulation {name} (0x{kind:04x}), which is not decoded'
