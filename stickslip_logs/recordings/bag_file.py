# SPDX-License-Identifier: Apache-2.0
"""What one file of a recording holds: channels, counts, the blocks to read, and where it is truncated.

Of MCAP the heads of all records are read, whatever the summary says of them. Blocks are decompressed
here only where no summary says what is in them. Of SQLite ``sqlite_file.py`` fills it.
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping
from pathlib import Path

from mcap.records import Channel, Schema, Statistics
from mcap.well_known import MessageEncoding, SchemaEncoding

from stickslip_logs.arrays import IntArray
from stickslip_logs.errors import BagError, cause, join_names, listed, plural
from stickslip_logs.files import open_file
from stickslip_logs.recordings.mcap_chunks import (
    MAGIC,
    MAX_CHUNK,
    Block,
    DamagedBlock,
    Definition,
    Piece,
    limit_bytes,
    load_block,
    walk_records,
)
from stickslip_logs.recordings.mcap_heads import RecordHeads
from stickslip_logs.recordings.message_types import MAX_DEFINITION_BYTES
from stickslip_logs.recordings.recording import Cut, Findings
from stickslip_logs.time_order import DATES_FROM_NS


class BagFile:
    """Contents of one file of a recording: of MCAP, or of SQLite in blocks likewise (:class:`.SqliteFile`).

    Channels and schemas are by number, and count as they were first defined. ``counts`` are the
    messages of each channel; with ``is_stated`` they are those of the summary, or of the rows of SQLite:
    nothing was decompressed. ``start_ns`` and ``end_ns`` are the earliest and the latest log time [ns],
    None without any; a 0, which ``has_zero`` notes, is among them only where they are those of the summary.
    ``blocks`` are in the order of the file, ``cut`` is where it is truncated, None for a whole one.
    It is empty until :meth:`read_summary` or :meth:`read_all` fills it.

    Args:
        path: The file.
        size: Its length, as far as it is read [bytes].
        findings: Takes the warnings.
    """

    def __init__(self, path: Path, size: int, findings: Findings) -> None:
        self.path, self.size, self.findings = path, size, findings
        self.channels: dict[int, Channel] = {}
        self.schemas: dict[int, Schema] = {}
        self.blocks: list[Block] = []
        self.counts: Counter[int] = Counter()
        self.is_stated = self.has_zero = False
        self.start_ns: int | None = None
        self.end_ns: int | None = None
        self.cut: Cut | None = None
        # Block and byte from which on a channel or a schema, by class and id, is defined otherwise.
        self._redefined: dict[tuple[type, int], tuple[int, int]] = {}

    def find_problem(self, channel: Channel) -> str:
        """Return a clause on why messages of a channel cannot be decoded; empty where no reason is known.

        The reasons are its encoding, and a schema that is missing or not in ``ros2msg``; what the schema says
        is not parsed here.
        """
        schema = self.schemas.get(channel.schema_id)
        if channel.message_encoding != MessageEncoding.CDR:
            return f"message encoding '{channel.message_encoding}' is not cdr: export the topic as CSV"
        if schema is None:
            return 'no schema'
        if schema.encoding != SchemaEncoding.ROS2:
            return f"schema encoding '{schema.encoding}' is not ros2msg: export the topic as CSV"
        return ''

    def add_definition(self, definition: Definition) -> bool:
        """Add a schema or channel to those of the file; return whether it equals the first one of its id.

        That one counts. Of a schema up to 256 KiB and a byte are kept, so that it counts as too long; of a
        channel no metadata. The others are dropped from ``definition`` too.
        """
        if isinstance(definition, Schema):
            definition.data = definition.data[: MAX_DEFINITION_BYTES + 1]
            return self.schemas.setdefault(definition.id, definition) == definition
        definition.metadata = {}
        return self.channels.setdefault(definition.id, definition) == definition

    def refuse_redefined(self, definition: Definition, block: Block, byte: int) -> None:
        """Refuse messages from a piece, at a byte of a block, on that redefines an id; report that once."""
        key = type(definition), definition.id
        if key not in self._redefined:
            users = [c.topic for c in self.channels.values() if key in _definitions_of(c)]
            self.findings.lose(
                f'{block.place} defines a channel or its type otherwise than before:'
                f' messages of {listed(users) or "it"} from there on were not read'
            )
        self._redefined[key] = min((block.offset, byte), self._redefined.get(key, (block.offset, byte)))

    def is_refused(self, key: int, block: Block, byte: int) -> bool:
        """Return whether messages of the channel ``key``, in a piece at a byte of a block, are refused."""
        ids = _definitions_of(self.channels[key]) if key in self.channels else ()
        return any(k in self._redefined and self._redefined[k] <= (block.offset, byte) for k in ids)

    def load_pieces(self, block: Block, topics: Collection[str] | None = None) -> tuple[int, Iterable[Piece]]:
        """Return the unpacked length of a block [bytes], and its records in pieces, in order.

        They are those of some topics at least, of all where ``topics`` is None.

        Raises:
            DamagedBlock: It cannot be restored.
            BagError: The file cannot be read.
        """
        del topics  # a chunk is unpacked as a whole
        data = load_block(block)
        return len(data), walk_records(data)

    def load_times(self, block: Block, topics: Collection[str]) -> Iterable[Piece]:
        """Return the pieces of a block as :meth:`load_pieces` does; they may be without data."""
        return self.load_pieces(block, topics)[1]

    def compare_counts(
        self, stated: Mapping[int, int], counted: Mapping[int, int], keys: Iterable[int]
    ) -> None:
        """Report as a loss the channels of which the file states another count than was read.

        Counts are by channel id; one that is missing is 0. Of ``keys``, the ids to compare, each is known.
        """
        texts = [
            f"{stated.get(key, 0)} messages of '{self.channels[key].topic}', and"
            f' {counted.get(key, 0)} can be read'
            for key in sorted(keys)
            if stated.get(key, 0) != counted.get(key, 0)
        ]
        if texts:
            counts = join_names(texts, '; ')
            self.findings.lose(f"file '{self.path.name}' counts {counts}")

    def read_all(self, heads: RecordHeads) -> None:
        """Fill in channels, counts, blocks, times and ``cut`` by reading all blocks; report oddities.

        What lies behind the limit of a :class:`FilePass`, and messages of channels that are defined nowhere,
        are lost and not counted. The heads were read before.

        Raises:
            BagError: The file cannot be read.
        """
        name = self.path.name
        for begin, end in heads.holes:
            self.findings.lose(
                f"file '{name}': bytes {begin} to {end} are damaged and were not read; what lies"
                ' behind was found by the index of chunks'
            )
        self._read_blocks(heads.blocks)
        for definition in heads.definitions:
            # What only the summary defines: the definitions in the data were lost.
            self.add_definition(definition)
        for key in self.counts.keys() - self.channels.keys():
            self.findings.lose(
                f"file '{name}': {plural(self.counts.pop(key), 'message')} of channel {key}, which"
                ' is defined nowhere, were not read'
            )
        if heads.statistics is not None:
            self.compare_counts(heads.statistics.channel_message_counts, self.counts, self.channels)
        if not heads.is_finished:
            count, share = plural(self.counts.total(), 'message'), ', the whole recording' * heads.has_ended
            text = f"file '{name}' is truncated in the record at byte {heads.offset} of {self.size}"
            self.cut = Cut(self.path, heads.offset, self.size, f'{text}: {count} recovered{share}')
        elif heads.offset < self.size:
            rest = plural(self.size - heads.offset, 'byte')
            self.findings.lose(f"file '{name}' has {rest} behind its end, not read")

    def _read_blocks(self, blocks: list[Block]) -> None:
        """Read blocks up to the limit of a pass; set ``counts``, and ``blocks`` to those with messages.

        These get their times and channels, and widen the span of the file.

        Raises:
            BagError: The file cannot be read.
        """
        way = FilePass(self)
        for block in blocks:
            block.channels, spans = 0, []
            for piece, read_groups in way.read_groups(block):
                spans += self.widen_span(piece.log_time_ns)
                for key, rows in read_groups:
                    block.channels |= bool(rows.size) << key
            if way.is_over:
                break
            if block.channels:
                block.start_ns = min((start for start, _ in spans), default=0)
                block.end_ns = max((end for _, end in spans), default=0)
                self.blocks.append(block)
        self.counts = way.counts

    def widen_span(self, times: IntArray) -> list[tuple[int, int]]:
        """Widen the span of the file by those of some log times [ns] that are above 0.

        Sets ``has_zero`` where a time is 0, and reports negative times as lost.

        Returns:
            A list with the first and last log time from 0 on [ns]; empty where there is none.
        """
        if (times < 0).any():
            self.findings.lose(
                f"file '{self.path.name}': messages with an impossible log time"
                ' (2^63 ns or more) were not used'
            )
        times = times[times >= 0]
        self.has_zero = self.has_zero or not times.all()
        good = times[times > 0]
        if good.size:
            start, end = int(good.min()), int(good.max())
            self.start_ns = start if self.start_ns is None else min(start, self.start_ns)
            self.end_ns = end if self.end_ns is None else max(end, self.end_ns)
        return [(int(times.min()), int(times.max()))] if times.size else []

    def read_summary(self, heads: RecordHeads) -> bool:
        """Fill in channels, counts, blocks and times by the summary, and set ``is_stated``.

        Where its statistics give other times than the chunks, that is noted. Without indexes of messages the
        channels of all blocks become unknown.

        Returns:
            False where the summary cannot be trusted: what was filled in until then must be discarded.
        """
        counts = heads.statistics
        is_known = all(map(self.add_definition, heads.definitions))
        if counts is None or not is_known:
            return False
        stated = counts.channel_message_counts
        if not stated.keys() <= self.channels.keys() or counts.channel_count != len(self.channels):
            return False
        if any(c.schema_id and c.schema_id not in self.schemas for c in self.channels.values()):
            return False
        if heads.indexed and +Counter(stated) != +heads.indexed:
            return False
        if not heads.indexed:
            # Then nothing says what a chunk is without.
            for block in heads.blocks:
                block.channels = None
        self.blocks, self.counts, self.is_stated = heads.blocks, Counter(stated), True
        return not counts.message_count or self._set_span(counts)

    def _set_span(self, statistics: Statistics) -> bool:
        """Set first and last time, and ``has_zero``, by the chunk heads; note where the statistics differ.

        With a log time of 0 the first time is 0.

        Returns:
            False where the chunk heads cannot be times of messages, or a 0 is beside dates.
        """
        held = [block for block in self.blocks if block.channels != 0]
        start = min((block.start_ns for block in held), default=0)
        end = max((block.end_ns for block in held), default=0)
        if end >= 1 << 63 or any(block.end_ns < block.start_ns for block in held):
            return False
        self.has_zero = start == 0
        if self.has_zero and end >= DATES_FROM_NS:
            return False
        if (start, end) != (statistics.message_start_time, statistics.message_end_time):
            self.findings.note(
                f"file '{self.path.name}': its statistics give other times than its chunks:"
                ' those of the chunks were used'
            )
        self.start_ns, self.end_ns = start, end
        return True


class FilePass:
    """One pass over the blocks of a file, as far as it takes no more than it may.

    ``counts`` are the messages of each channel that were read. With ``is_over`` the pass has reached its
    limit of memory, and yields nothing more. Messages of ``topics`` are needed; all when None.
    """

    def __init__(self, file: BagFile, topics: Collection[str] | None = None) -> None:
        self.file, self._topics = file, topics
        self.counts: Counter[int] = Counter()
        self.is_over = False
        self._max_bytes = self._left_bytes = limit_bytes(file.size)

    def charge(self, block: Block, size: int) -> None:
        """Charge a block's memory [bytes] to the pass; beyond its limit set ``is_over``, report a loss."""
        self._left_bytes -= size
        if self._left_bytes < 0 and not self.is_over:
            self.is_over = True
            self.file.findings.lose(
                f"file '{block.path.name}' was read to byte {block.offset}: what it holds grows to"
                f' more than {self._max_bytes} bytes, the limit for its size'
            )

    def read_groups(self, block: Block) -> Iterator[tuple[Piece, list[tuple[int, IntArray]]]]:
        """Read a block: add its definitions to the file, count its messages, and report what is wrong.

        Charges its size to the pass first, which can end the pass.

        Yields:
            Each piece of its records, and for each channel id the indexes of its messages in the piece: none
            from a piece on that defines it, or its schema, otherwise than before. Nothing for a damaged
            block, or where the pass is over.

        Raises:
            BagError: The file cannot be read.
        """
        self.charge(block, block.size if block.size <= MAX_CHUNK else 0)
        if self.is_over:
            return
        lose = self.file.findings.lose
        try:
            length, pieces = self.file.load_pieces(block, self._topics)
        except DamagedBlock as damage:
            if not block.is_cut:
                lose(f'{block.place} is damaged ({damage}) and was skipped')
            return
        unread = end = 0
        for piece in pieces:
            begin, end = end, piece.end
            for definition in piece.definitions:
                if not self.file.add_definition(definition):
                    self.file.refuse_redefined(definition, block, begin)
            unread += piece.unreadable_count
            groups = [group for group in piece.groups() if not self.file.is_refused(group[0], block, begin)]
            self.counts.update({key: rows.size for key, rows in groups})
            yield piece, groups
        if unread:
            lose(f'{block.place} has {plural(unread, "record")} that cannot be read: skipped')
        if end < length and not block.is_cut:
            rest = plural(length - end, 'byte')
            lose(f'{block.place} has {rest} at its end, no record: not read')


def _definitions_of(channel: Channel) -> tuple[tuple[type, int], ...]:
    """Return classes and ids of the records that define a channel and its schema."""
    return (Channel, channel.id), (Schema, channel.schema_id)


def scan_mcap_file(path: Path, findings: Findings) -> BagFile:
    """Return the contents of a file: by its summary, or where that cannot be trusted, by all its records.

    An empty file, as of a recorder that was stopped at once, is a truncated one. ``findings`` takes warnings.

    Raises:
        BagError: The file cannot be read, or is not MCAP.
    """
    try:
        with open_file(path) as file:
            number = file.fileno()
            # A recorder stopped while it created the file leaves a part of the magic, or nothing.
            begin = os.pread(number, len(MAGIC), 0)
            if not MAGIC.startswith(begin):
                raise BagError(
                    f"bag file '{path}' is not a recording of MCAP or SQLite: it begins with bytes"
                    f' {begin.hex(" ")}'
                )
            size = os.fstat(number).st_size
            heads = RecordHeads(number, path, size)
            heads.read_heads()
            scanned = BagFile(path, size, findings)
            if not (heads.is_regular and scanned.read_summary(heads)):
                scanned = BagFile(path, size, findings)
                scanned.read_all(heads)
    except OSError as error:
        raise BagError(f"bag file '{path}' cannot be read: {cause(error)}") from None
    return scanned
