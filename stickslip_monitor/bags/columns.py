# SPDX-License-Identifier: Apache-2.0
"""Numbers of several topics, read block by block and put in order once at the end."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from .blocks import Loaded
from .entries import find_entries
from .plan import Numbers, Plan
from .values import FloatArray, IntArray


@dataclass(slots=True)
class Strand:
    """What was read of one channel of one file so far, in file order."""

    plan: Plan
    stamp_ns: list[IntArray] = field(default_factory=list)
    values: list[FloatArray] = field(default_factory=list)
    undecoded: int = 0
    short: Counter[int] = field(default_factory=Counter)

    def take(self, numbers: Numbers) -> None:
        """Append messages."""
        if numbers.stamp_ns is not None:
            self.stamp_ns.append(numbers.stamp_ns)
        self.values.append(numbers.values)
        self.undecoded += numbers.undecoded
        self.short.update(numbers.short)


@dataclass(frozen=True, slots=True, eq=False)
class Ranked:
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

    def ranked(self, strands: int) -> list[Ranked]:
        """Number all messages by log time, then place, and sort them out to the strands."""
        strand, log_time = joined(self.strand), joined(self.log_time_ns)
        rank = np.arange(len(log_time))
        if not (log_time[1:] >= log_time[:-1]).all():
            rank[np.argsort(log_time, kind='stable')] = np.arange(len(log_time))
        places = (np.flatnonzero(strand == number) for number in range(strands))
        return [Ranked(log_time[place], rank[place]) for place in places]


def take_block(loaded: Loaded, strands: Mapping[int, tuple[int, Strand]], order: Order) -> None:
    """Read the messages of a block.

    Args:
        loaded: The block.
        strands: Number and strand of each channel wanted.
        order: Where the order of the messages is noted.
    """
    numbers: list[IntArray] = []
    times: list[IntArray] = []
    offsets: list[IntArray] = []
    for entries in find_entries(loaded, strands):
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


def make_table(strands: Sequence[Strand], ranked: Sequence[Ranked], rows: int) -> Table:
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


def _stamps(strand: Strand, ranked: Ranked) -> IntArray:
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
