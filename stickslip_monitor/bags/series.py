# SPDX-License-Identifier: Apache-2.0
"""One pass over a recording, in the order of log times: numbers in blocks, or messages.

The blocks of a recording are taken in the order in which they begin, and what lies before the
beginning of the next one is put in order and handed on. So memory holds the blocks that overlap
in time and no more: as a rule two. Only a recording whose blocks all span much of it, because it
was written in no order of time, takes memory in proportion to its length.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stickslip_monitor.arrays import BoolArray, IntArray
from stickslip_monitor.bags.blocks import (
    STEP_COST,
    Block,
    Budget,
    DamagedBlock,
    Exhausted,
    prefetch,
)
from stickslip_monitor.bags.channels import Meaning, pieces_of
from stickslip_monitor.bags.contents import DATED, Part
from stickslip_monitor.bags.decode import FieldNumbers, FieldReader
from stickslip_monitor.bags.records import Piece, Walker, view
from stickslip_monitor.bags.topics import make_plan
from stickslip_monitor.bags.values import Fault, Message, Payload, Request, Series, TimeSpans
from stickslip_monitor.errors import BagError, plural
from stickslip_monitor.fields import FieldPath

# Messages of each topic, and of all, that are handed on at a time: few enough for the caches.
_OF_TOPIC, _OF_ALL = 1 << 15, 1 << 19

# What a number costs that is kept until all before it is known [bytes].
_ROW_COST = 24

Progress = Callable[[int, int], None]


class Job(NamedTuple):
    """A block to read, its place in the recording, and the number of its part."""

    number: int
    block: Block
    part: int


class Table(NamedTuple):
    """Messages of a piece of a block in the order of time, shape (n,) each.

    Attributes:
        number: That of the block, by which messages of equal time are ordered.
        log_time_ns: Log times [ns].
        topic: The number of the topic.
        columns: What else there is to tell of each message, shape (k, n).
        data: What the columns refer to.
    """

    number: int
    log_time_ns: IntArray
    topic: NDArray[np.int32]
    columns: tuple[NDArray[Any], ...]
    data: bytes = b''

    def part(self, rows: slice | IntArray) -> Table:
        """Some of them."""
        columns = tuple(column[..., rows] for column in self.columns)
        return Table(self.number, self.log_time_ns[rows], self.topic[rows], columns, self.data)


Chosen = list[tuple[int, Meaning, IntArray]]
"""The number of a topic, what its messages are, and which of a piece."""


class Pass:
    """A pass over the blocks of a recording that have messages of some topics.

    Args:
        parts: The recording.
        topics: The topics, which are numbered in this order.
        tell: Told what is wrong with a block, in a sentence.
        progress: Told the bytes done and the bytes to do after each block.
        spans: The log times wanted; all when None.
    """

    def __init__(
        self,
        parts: Sequence[Part],
        topics: Iterable[str],
        tell: Callable[[str], None],
        progress: Progress | None = None,
        spans: TimeSpans | None = None,
    ) -> None:
        self.parts, self.tell, self._progress = parts, tell, progress
        self.numbers = {topic: number for number, topic in enumerate(topics)}
        self.counts = [Counter[int]() for _ in parts]
        self._budgets = [Budget(part.size) for part in parts]
        self._exhausted: set[int] = set()
        blocks = ((n, block) for n, part in enumerate(parts) for block in self._wanted(part))
        jobs = [Job(number, block, n) for number, (n, block) in enumerate(blocks)]
        if spans is not None:
            jobs = [j for j in jobs if spans.overlap(j.block.start_ns, j.block.end_ns)]
        self._jobs = sorted(jobs, key=lambda job: (job.block.start_ns, job.number))

    def _wanted(self, part: Part) -> Iterator[Block]:
        keys = {m.channel.id for m in part.channels if m.channel.topic in self.numbers}
        for block in part.blocks:
            if block.channels is None or not keys.isdisjoint(block.channels.tolist()):
                yield block

    def stretches(
        self, table_of: Callable[[Job, Piece, Chosen], Table], most: int
    ) -> Iterator[list[Table]]:
        """Yield all messages, one stretch of time after the other.

        Args:
            table_of: Makes the table of a piece's messages.
            most: How many messages may wait before some are handed on.

        Yields:
            The tables of a stretch, in the order in which messages of equal time come.
        """
        waiting: list[Table] = []
        limit, handed = most, -1
        numbers = np.array([job.number for job in self._jobs] + [1 << 62])
        rest = np.minimum.accumulate(numbers[::-1])[::-1]
        for k, job, tables in self.tables(table_of):
            waiting += self._in_time(job, tables, handed)
            if sum(len(table.topic) for table in waiting) < limit or k + 1 == len(self._jobs):
                continue
            handed = self._jobs[k + 1].block.start_ns
            cuts = [int(table.log_time_ns.searchsorted(handed)) for table in waiting]
            if not any(cuts) and waiting and max(t.number for t in waiting) < rest[k + 1]:
                # So many of one time: it is split, rather than to wait for more.
                cuts = [int(table.log_time_ns.searchsorted(handed, 'right')) for table in waiting]
            yield _ordered(waiting, [slice(cut) for cut in cuts])
            waiting = _ordered(waiting, [slice(cut, None) for cut in cuts])
            limit = most + 2 * sum(len(table.topic) for table in waiting)
        yield _ordered(waiting, [slice(None) for _ in waiting])
        for part in self.parts:
            part.channels.settle(part.path.name)

    def _in_time(self, job: Job, tables: Iterable[Table], handed: int) -> Iterator[Table]:
        """Leave out what is earlier than what was handed on: a block may lie about its times."""
        late = 0
        for table in tables:
            first = int(table.log_time_ns.searchsorted(handed))
            late += first
            yield table.part(slice(first, None)) if first else table
        if late:
            self.tell(
                f'{job.block.place} has {plural(late, "message")} from before it begins, as it'
                ' says: they were not used'
            )

    def tables(
        self, table_of: Callable[[Job, Piece, Chosen], Table]
    ) -> Iterator[tuple[int, Job, Iterator[Table]]]:
        """Go through the blocks: the place of each in the order of time, and its tables."""
        total, done = sum(job.block.length for job in self._jobs), 0
        begun: deque[int] = deque()

        def blocks() -> Iterator[Block]:
            for k, job in enumerate(self._jobs):
                if job.part not in self._exhausted:
                    begun.append(k)
                    yield job.block

        for take in prefetch(blocks()):
            k = begun.popleft()
            job = self._jobs[k]
            yield k, job, self._read(job, take, table_of)
            done += job.block.length
            if self._progress is not None:
                self._progress(done, total)

    def _read(
        self, job: Job, take: Callable[[], Walker], table_of: Callable[[Job, Piece, Chosen], Table]
    ) -> Iterator[Table]:
        """The tables of a block, as far as it can be read."""
        part, budget = self.parts[job.part], self._budgets[job.part]
        if job.part in self._exhausted:
            return
        # What a scan saw it told already.
        channels, tell = (None, _silent) if part.stated is None else (part.channels, self.tell)
        try:
            for piece in pieces_of(job.block, take, channels, tell, budget):
                chosen = self._choose(job, piece)
                if chosen:
                    yield table_of(job, piece, chosen)
        except DamagedBlock as damage:
            self.tell(str(damage))
        except Exhausted as limit:
            self.tell(str(limit))
            self._exhausted.add(job.part)

    def _choose(self, job: Job, piece: Piece) -> Chosen:
        """The messages of a piece that are wanted."""
        channels, counts = self.parts[job.part].channels, self.counts[job.part]
        chosen: Chosen = []
        for key, rows in piece.groups():
            if key not in channels.meanings:
                channels.unknown[key] += len(rows)
            for meaning, own in channels.spans(key, rows, job.block, piece):
                number = self.numbers.get(meaning.channel.topic)
                if number is not None:
                    chosen.append((number, meaning, own))
                    counts[key] += len(own)
        return chosen

    def spend(self, job: Job, cost: int) -> None:
        """Take a cost from the budget of a block's file; raises Exhausted if it is used up."""
        self._budgets[job.part].spend(job.block, cost)

    def compare(self) -> None:
        """Tell what a summary counts otherwise, when all was read."""
        for part, counts in zip(self.parts, self.counts, strict=True):
            if part.stated is not None:
                keys = {m.channel.id for m in part.channels if m.channel.topic in self.numbers}
                stated = {key: part.stated[key] for key in keys}
                part.channels.compare(part.path.name, stated, counts)


def _silent(_: str) -> None:
    """Tell nobody."""


def _ordered(tables: Sequence[Table], parts: Sequence[slice]) -> list[Table]:
    """Parts of tables that are not empty, in the order in which equal times come."""
    cut = [table.part(rows) for table, rows in zip(tables, parts, strict=True)]
    return sorted((table for table in cut if table.topic.size), key=lambda table: table.number)


def _in_order(table: Table, wanted: BoolArray) -> Table:
    """The messages of a table that are wanted, in the order of time."""
    if not wanted.all():
        table = table.part(np.flatnonzero(wanted))
    times = table.log_time_ns
    if (times[1:] >= times[:-1]).all():
        return table
    return table.part(np.argsort(times, kind='stable'))


class _Merged(NamedTuple):
    """Tables as one: their columns joined, and the messages of it in the order of time."""

    log_time_ns: IntArray
    topic: NDArray[np.int32]
    columns: list[NDArray[Any]]
    order: IntArray

    def rows(self) -> Iterator[IntArray]:
        """The messages in order, some at a time; one time is split only if it has too many."""
        begin = 0
        while len(self.order) - begin > _OF_ALL:
            times = self.log_time_ns[self.order[begin : begin + _OF_ALL]]
            end = begin + (int(times.searchsorted(times[-1])) or _OF_ALL)
            yield self.order[begin:end]
            begin = end
        yield self.order[begin:]


def _merged(tables: Sequence[Table]) -> _Merged:
    """Join at least one table."""
    times = np.concatenate([table.log_time_ns for table in tables])
    topic = np.concatenate([table.topic for table in tables])
    columns = zip(*(table.columns for table in tables), strict=True)
    if (times[1:] >= times[:-1]).all():
        order = np.arange(times.size)
    else:
        order = np.argsort(times, kind='stable')
    return _Merged(times, topic, [np.concatenate(c, axis=-1) for c in columns], order)


def merged_messages(way: Pass, types: Mapping[str, str], spans: TimeSpans) -> Iterator[Message]:
    """Yield messages by log time, then by place; a block is in memory while its time lasts.

    Args:
        way: A pass for the topics.
        types: The topics with their types.
        spans: The log times wanted.

    Yields:
        The messages, still encoded.
    """
    names = list(types)
    for tables in way.stretches(partial(_raw_table, spans), 1):
        if not tables:
            continue
        merged = _merged(tables)
        owner = np.repeat(np.arange(len(tables)), [len(table.topic) for table in tables])
        for rows in merged.rows():
            columns: Any = (merged.topic, merged.log_time_ns, owner, *merged.columns)
            numbers: Any = zip(*(column[rows].tolist() for column in columns), strict=True)
            for topic, time, own, offset, size in numbers:
                data = tables[own].data[offset : offset + size]
                yield Message(names[topic], types[names[topic]], time, data)


def payloads(
    way: Pass, spans: TimeSpans
) -> Iterator[tuple[int, dict[str, tuple[IntArray, Payload]]]]:
    """Yield messages by the piece, still encoded, in the order in which blocks begin.

    Args:
        way: A pass for the topics.
        spans: The log times wanted.

    Yields:
        When a block begins [ns], and log times and messages of each topic in the piece.
    """
    for _, job, tables in way.tables(partial(_raw_table, spans)):
        for table in tables:
            found = {}
            for topic, number in way.numbers.items():
                own = table.part(np.flatnonzero(table.topic == number))
                if own.topic.size:
                    found[topic] = own.log_time_ns, _raw(own.data, *own.columns)
            yield job.block.start_ns, found


def _raw_table(spans: TimeSpans, job: Job, piece: Piece, chosen: Chosen) -> Table:
    topic = np.full(piece.channel.size, -1, np.int32)
    for number, _, rows in chosen:
        topic[rows] = number
    columns = piece.offset, piece.size
    table = Table(job.number, piece.log_time_ns, topic, columns, piece.data)
    return _in_order(table, (topic >= 0) & spans.holds(piece.log_time_ns))


def _raw(data: bytes, offset: IntArray, size: IntArray) -> Payload:
    if size.min() == size.max() > 0:
        return view(data, f'V{size[0]}')[offset]
    ends = (offset + size).tolist()
    return [data[begin:end] for begin, end in zip(offset.tolist(), ends, strict=True)]


@dataclass(frozen=True, slots=True)
class Wanted:
    """The numbers wanted of one topic, with the requests for each of them."""

    topic: str
    type: str
    requests: Mapping[FieldPath, Sequence[Request]]


@dataclass(slots=True)
class _Tally:
    """What was wrong with the messages of a topic."""

    wanted: Wanted
    count: int = 0
    beyond: int = 0
    unset: int = 0
    undecoded: int = 0
    refused: int = 0
    encapsulations: Counter[int] = field(default_factory=Counter)
    short: Counter[int] = field(default_factory=Counter)

    def take(self, numbers: FieldNumbers) -> None:
        """Take up what was read of some messages."""
        self.undecoded += numbers.undecoded
        self.encapsulations.update(numbers.encapsulations)
        self.short.update(numbers.short)

    def take_times(self, log_time_ns: IntArray, least: int) -> None:
        """Take up how many have a log time that is none."""
        self.count += len(log_time_ns)
        if log_time_ns.min() < least:
            beyond = int((log_time_ns < 0).sum())
            self.beyond += beyond
            self.unset += int((log_time_ns < least).sum()) - beyond

    def faults(self) -> Iterator[tuple[Request, tuple[Fault, ...]]]:
        """What was wrong, for each request."""
        common = [
            (
                self.beyond,
                'have a log time of 2^63 ns or more, which is no time, and were not used',
            ),
            (self.unset, 'have log time 0, as of a clock that was not set, and were not used'),
            (self.refused, 'come behind a definition that does not fit, and were not used'),
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


class Reading:
    """A pass over a recording for numbers of some topics.

    Iterating gives a series for each request, for one stretch of time after the other.

    Args:
        parts: The recording.
        wanted: What is wanted.
        tell: Told what is wrong with a block, in a sentence.
        progress: Told the bytes done and the bytes to do after each block.

    Raises:
        BagError: A path does not lead to a number.
    """

    def __init__(
        self,
        parts: Sequence[Part],
        wanted: Sequence[Wanted],
        tell: Callable[[str], None],
        progress: Progress | None,
    ) -> None:
        self._tell = tell
        self._tallies = [_Tally(each) for each in wanted]
        self._width = max((len(each.requests) for each in wanted), default=0)
        self._pass = Pass(parts, [each.topic for each in wanted], tell, progress)
        self._least = 1 if any((part.end_ns or 0) >= DATED for part in parts) else 0
        self._plans: dict[tuple[int, str, bytes], FieldReader] = {}
        self._sequence = 0
        self._make_plans(parts)

    def __iter__(self) -> Iterator[dict[Request, Series]]:
        """Yield the series, without faults, of one stretch of time after the other.

        Raises:
            BagError: A file cannot be read.
        """
        most = min(_OF_TOPIC * len(self._tallies), _OF_ALL)
        for tables in self._pass.stretches(self._table, most):
            merged = _merged(tables or [self._nothing()])
            for rows in merged.rows():
                yield self._series(merged, rows)
        self._pass.compare()

    def faults(self) -> dict[Request, tuple[Fault, ...]]:
        """What was wrong with the messages read."""
        return dict(pair for tally in self._tallies for pair in tally.faults())

    def _make_plans(self, parts: Sequence[Part]) -> None:
        """Plan how to read what is known now; what does not fit beside what does is refused."""
        errors: dict[int, BagError] = {}
        for meaning in (m for part in parts for m in part.channels):
            number = self._pass.numbers.get(meaning.channel.topic)
            if number is not None and not meaning.is_refused:
                try:
                    self._plan(number, meaning)
                except BagError as error:
                    errors.setdefault(number, error)
        planned = {number for number, *_ in self._plans}
        for number, unread in errors.items():
            if number not in planned:
                raise unread

    def _plan(self, number: int, meaning: Meaning) -> FieldReader:
        """How to read messages; raises BagError where they cannot be read."""
        schema = meaning.schema
        assert schema is not None, 'a topic without a schema is not asked for'
        key = number, schema.name, schema.data
        if key not in self._plans:
            wanted = self._tallies[number].wanted
            self._plans[key] = make_plan(wanted.topic, schema, tuple(wanted.requests))
        return self._plans[key]

    def _plan_or_tell(self, job: Job, number: int, meaning: Meaning) -> FieldReader | None:
        """The same; None for messages that come behind a definition that does not fit."""
        if not meaning.is_refused:
            try:
                return self._plan(number, meaning)
            except BagError as error:
                meaning.is_refused = True
                self._tell(f'{job.block.place} has messages of another definition: {error}')
        return None

    def _table(self, job: Job, piece: Piece, chosen: Chosen) -> Table:
        size = piece.channel.size
        topic = np.full(size, -1, np.int32)
        values = np.full((self._width, size), np.nan)
        stamp = piece.log_time_ns
        for number, meaning, rows in chosen:
            tally = self._tallies[number]
            tally.take_times(piece.log_time_ns[rows], self._least)
            plan = self._plan_or_tell(job, number, meaning)
            if plan is None:
                tally.refused += len(rows)
                continue
            numbers = plan.read(piece.data, piece.offset[rows], piece.size[rows])
            self._pass.spend(job, 2 * STEP_COST * numbers.alone + _ROW_COST * len(rows))
            tally.take(numbers)
            topic[rows] = number
            for column, own in zip(values, numbers.values, strict=False):
                column[rows] = own
            if numbers.stamp_ns is not None:
                if stamp is piece.log_time_ns:
                    stamp = stamp.copy()
                stamp[rows] = np.where(numbers.stamp_ns == 0, stamp[rows], numbers.stamp_ns)
        table = Table(job.number, piece.log_time_ns, topic, (stamp, values))
        return _in_order(table, (topic >= 0) & (piece.log_time_ns >= self._least))

    def _nothing(self) -> Table:
        none = np.empty(0, np.int64)
        return Table(0, none, none.astype(np.int32), (none, np.empty((self._width, 0))))

    def _series(self, merged: _Merged, rows: IntArray) -> dict[Request, Series]:
        """The series of some messages."""
        topic, result = merged.topic[rows], {}
        stamp, values = merged.columns
        for number, tally in enumerate(self._tallies):
            place = np.flatnonzero(topic == number)
            own = rows[place]
            log_time, own_stamp = merged.log_time_ns[own], stamp[own]
            for value, requests in zip(values, tally.wanted.requests.values(), strict=False):
                series = Series(log_time, own_stamp, place + self._sequence, value[own], ())
                result.update(dict.fromkeys(requests, series))
        self._sequence += len(rows)
        return result


def joined(reading: Reading) -> dict[Request, Series]:
    """The series of a whole recording."""
    found: dict[Request, list[Series]] = {}
    for part in reading:
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


# RTPS 2.5, table 10.3.
_ENCAPSULATIONS = {
    0x02: 'PL_CDR_BE', 0x03: 'PL_CDR_LE', 0x06: 'CDR2_BE', 0x07: 'CDR2_LE', 0x08: 'D_CDR2_BE',
    0x09: 'D_CDR2_LE', 0x0A: 'PL_CDR2_BE', 0x0B: 'PL_CDR2_LE', 0x04: 'XML',
}  # fmt: skip


def _encapsulation(kind: int) -> str:
    name = _ENCAPSULATIONS.get(kind, 'of no known name')
    return f'the encapsulation {name} (0x{kind:04x}), which is not decoded'
