# SPDX-License-Identifier: Apache-2.0
"""What the messages of a channel are, and from where on: recordings may redefine channels."""

from __future__ import annotations

import bisect
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from io import BytesIO

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Schema
from mcap.well_known import MessageEncoding, SchemaEncoding

from stickslip_monitor.arrays import IntArray
from stickslip_monitor.bags.blocks import MOST, STEP_COST, Block, BlockKind, Budget
from stickslip_monitor.bags.records import HEAD, PARSE_ERRORS, Piece, Walker
from stickslip_monitor.bags.schema import LONGEST_TEXT
from stickslip_monitor.errors import plural

# Of the record of a channel; what it is called, and how it was offered [bytes].
_LONGEST = 1 << 20
_MOST_NAMED = 5
# What a new definition costs to parse and keep [bytes].
_DEFINITION_COST = 5000
# Bits of a place in a file that are the place in its block.
_PLACE = 32
SUMMARY = -1
"""The place of definitions that stand in the summary."""


def place_of(block: Block) -> int:
    """Where a block begins, as places are counted here."""
    return block.offset << _PLACE


@dataclass(slots=True, eq=False)
class Meaning:
    """What the messages of a channel are, from a place of its file on.

    ``count`` are those found, and ``is_refused`` tells that they cannot be read with those of the
    topic before.
    """

    place: int
    channel: Channel
    schema: Schema | None
    count: int = 0
    is_refused: bool = False

    @property
    def type(self) -> str:
        """Type of the messages, empty if unknown."""
        return self.schema.name if self.schema is not None else ''

    @property
    def problem(self) -> str:
        """A clause on why they cannot be decoded, as far as that is known; else empty."""
        if self.channel.message_encoding != MessageEncoding.CDR:
            return f"message encoding '{self.channel.message_encoding}' is not cdr"
        if self.schema is None:
            return 'no schema'
        if self.schema.encoding != SchemaEncoding.ROS2:
            return f"schema encoding '{self.schema.encoding}' is not ros2msg"
        return ''

    def is_same(self, other: Meaning) -> bool:
        """Whether two definitions of a channel are of the same messages."""
        return _traits(self.channel) == _traits(other.channel) and self.schema == other.schema


def _traits(channel: Channel) -> tuple[str, int, str]:
    return channel.topic, channel.schema_id, channel.message_encoding


class Channels:
    """The channels of one recording, with every change of their meaning.

    Args:
        tell: Told what is wrong, in a sentence.
    """

    def __init__(self, tell: Callable[[str], None]) -> None:
        self.meanings: dict[int, list[Meaning]] = {}
        self.unknown: Counter[int] = Counter()
        self.tell = tell
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Channel] = {}
        self._records: dict[bytes, bytes] = {}

    def __iter__(self) -> Iterator[Meaning]:
        """All meanings of all channels."""
        for meanings in self.meanings.values():
            yield from meanings

    def define(self, block: Block | None, offset: int, record: bytes) -> tuple[int, bool]:
        """Take a definition.

        Args:
            block: Where it stands, None for the summary.
            offset: Where in the block.
            record: The record.

        Returns:
            What it costs [bytes], and whether it can be read.
        """
        key = record[:1] + record[HEAD.size : HEAD.size + 2]
        if self._records.get(key) == record:
            return STEP_COST, True
        place = SUMMARY if block is None else place_of(block) + offset
        where = 'its summary' if block is None else block.place
        try:
            if record[0] == Opcode.SCHEMA:
                changed = self._take_schema(record)
            else:
                changed = self._take_channel(record)
        except PARSE_ERRORS:
            return _DEFINITION_COST, False
        for channel in changed:
            schema = self._schemas.get(channel.schema_id)
            self._change(where, Meaning(place, channel, schema))
        if len(record) <= LONGEST_TEXT:
            self._records[key] = record
        cost = _DEFINITION_COST + 2 * len(record)
        return cost + (len(self._channels) if record[0] == Opcode.SCHEMA else 0) * STEP_COST, True

    def _take_schema(self, record: bytes) -> list[Channel]:
        # A longer definition is not used, and not kept.
        schema = Schema.read(ReadDataStream(BytesIO(record[HEAD.size :])))
        schema.data = schema.data[: LONGEST_TEXT + 1]
        before = self._schemas.get(schema.id)
        self._schemas[schema.id] = schema
        if before == schema:
            return []
        return [c for c in self._channels.values() if c.schema_id == schema.id]

    def _take_channel(self, record: bytes) -> list[Channel]:
        if len(record) > _LONGEST:
            raise ValueError('no topic has such a name')
        channel = Channel.read(ReadDataStream(BytesIO(record[HEAD.size :])))
        channel.metadata = {}
        self._channels[channel.id] = channel
        return [channel]

    def _change(self, where: str, new: Meaning) -> None:
        known = self.meanings.setdefault(new.channel.id, [])
        at = bisect.bisect(known, new.place, key=lambda meaning: meaning.place)
        before = known[at - 1] if at else None
        if before is not None and before.is_same(new):
            return
        if before is not None and before.place != SUMMARY and not before.count:
            known[at - 1] = new
            return
        if before is not None:
            self._tell_change(where, before, new)
        known.insert(at, new)

    def _tell_change(self, where: str, before: Meaning, new: Meaning) -> None:
        topic, key = new.channel.topic, new.channel.id
        if topic != before.channel.topic:
            self.tell(
                f"{where} makes channel {key} '{topic}' where it was '{before.channel.topic}'"
                ' before: messages from there on were read as such'
            )
        elif not before.problem and (before.type != new.type or new.problem):
            new.is_refused = True
            reason = new.problem or f'it has type {new.type} there, not {before.type}'
            self.tell(
                f"{where} defines channel {key} '{topic}' anew: messages from there on were not"
                f' read, {reason}'
            )

    def spans(
        self, key: int, rows: IntArray, block: Block, piece: Piece
    ) -> Iterator[tuple[Meaning, IntArray]]:
        """Split messages of a channel in a piece by what they are.

        Args:
            key: The channel.
            rows: Which messages of the piece.
            block: The block of the piece.
            piece: The piece.

        Yields:
            A meaning, and which messages have it.
        """
        known = self.meanings.get(key, [])
        if len(known) < 2:
            yield from ((meaning, rows) for meaning in known)
            return
        # What comes before the first definition is taken as it says.
        begins = [min(max(m.place - place_of(block), 0), 1 << _PLACE) for m in known[1:]]
        parts = np.split(rows, np.searchsorted(piece.offset[rows], begins))
        yield from (
            (meaning, part) for meaning, part in zip(known, parts, strict=True) if part.size
        )

    def count(self, block: Block, piece: Piece) -> IntArray:
        """Count the messages of a piece; return the channels it has messages of."""
        counts = np.bincount(piece.channel)
        keys = np.flatnonzero(counts)
        for key in keys.tolist():
            known = self.meanings.get(key)
            if known is None:
                self.unknown[key] += int(counts[key])
            elif len(known) == 1:
                known[0].count += int(counts[key])
            else:
                for meaning, own in self.spans(key, piece.of(key), block, piece):
                    meaning.count += len(own)
        return keys

    def complete(self, records: Iterable[bytes]) -> None:
        """Take definitions that only the summary has: those in the data were lost."""
        for record in records:
            key = int.from_bytes(record[HEAD.size : HEAD.size + 2], 'little')
            if key not in (self._schemas if record[0] == Opcode.SCHEMA else self.meanings):
                self.define(None, 0, record)

    def settle(self, name: str) -> None:
        """Give messages that came before the definition of their channel to it; tell of others."""
        for key, count in self.unknown.items():
            if key in self.meanings:
                self.meanings[key][0].count += count
            else:
                self.tell(
                    f"file '{name}': {plural(count, 'message')} of channel {key}, which is defined"
                    ' nowhere, were not read'
                )
        self.unknown.clear()

    def counts(self) -> Counter[int]:
        """Messages of each channel."""
        return Counter({key: sum(m.count for m in ms) for key, ms in self.meanings.items()})

    def compare(self, name: str, stated: Mapping[int, int], found: Mapping[int, int]) -> None:
        """Tell what the statistics of a file count otherwise."""
        names = {key: meanings[0].channel.topic for key, meanings in self.meanings.items()}
        texts = [
            f"{stated.get(key, 0)} messages of '{names.get(key, f'channel {key}')}', and"
            f' {found.get(key, 0)} can be read'
            for key in sorted(stated.keys() | found.keys())
            if stated.get(key, 0) != found.get(key, 0)
        ]
        if texts:
            more = len(texts) - _MOST_NAMED
            rest = f'; so with {more} more topics' if more > 0 else ''
            listed = '; '.join(texts[:_MOST_NAMED])
            self.tell(f"file '{name}': its statistics count {listed}{rest}")


def pieces_of(
    block: Block,
    take: Callable[[], Walker],
    channels: Channels | None,
    tell: Callable[[str], None],
    budget: Budget,
) -> Iterator[Piece]:
    """Walk through the records of a block.

    Args:
        block: The block.
        take: Gives its records.
        channels: Takes the definitions in it; None where they are known.
        tell: Told what is wrong with the block, in a sentence.
        budget: Of the file.

    Yields:
        The records, piece by piece.

    Raises:
        DamagedBlock: It cannot be restored.
        Exhausted: The file takes more than it may.
    """
    if block.size <= MOST:
        budget.spend(block, block.size)
    walker = take()
    unread = steps = 0
    for piece in walker.pieces():
        if channels is not None:
            for offset, record in piece.definitions.items():
                cost, is_sound = channels.define(block, offset, record)
                unread += not is_sound
                budget.spend(block, cost)
        budget.spend(block, STEP_COST * (walker.steps - steps))
        steps = walker.steps
        yield piece
    unread += walker.odd
    rest = len(walker.data) - walker.end
    if unread:
        tell(f'{block.place} has {plural(unread, "record")} that cannot be read: passed over')
    if rest and block.kind is not BlockKind.CUT_CHUNK:
        tell(f'{block.place} has {plural(rest, "byte")} at its end, no record: not read')
    if walker.is_index_wrong:
        tell(f'{block.place} has a message index that is wrong and was not used')
