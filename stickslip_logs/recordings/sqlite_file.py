# SPDX-License-Identifier: Apache-2.0
"""Scans a file that rosbag2 stored by SQLite, its default up to ROS 2 Humble, in the blocks of MCAP.

Blocks are of messages in the order in which they were written. Nothing is written to a file: one
with a journal, or with row ids that do not rise, is read as a copy.
"""

from __future__ import annotations

import bisect
import contextlib
import itertools
import shutil
import sqlite3
from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import zstandard
from mcap.records import Channel, Schema
from mcap.well_known import MessageEncoding, SchemaEncoding

from stickslip_logs.arrays import IntArray
from stickslip_logs.errors import MAX_NAMED, BagError, plural
from stickslip_logs.recordings.bag_file import BagFile
from stickslip_logs.recordings.mcap_chunks import MAX_CHUNK, Block, Piece
from stickslip_logs.recordings.message_types import definition_of
from stickslip_logs.recordings.recording import Findings, Scratch
from stickslip_logs.tables.text_file import ZSTD
from stickslip_logs.time_order import MAX_TIME_NS, select_rows
from stickslip_logs.units import MIB

MAGIC = b'SQLite format 3\0'
# Messages that are read at a time.
_BATCH = 32_768
# Of a page whose damage makes it ask for more memory than there is, the latter.
_ERRORS = sqlite3.Error, MemoryError
# Larger blocks have one message; so many messages of some kB are one read of them [bytes].
_MAX_BYTES = 16 * MIB
# The first messages whose times are kept for the judge of their order: he reads those of others. A million
# takes 18 MB and saves 1.7 s of the 5.4 s that reading it takes otherwise (processor time, medians of nine).
_MAX_KEPT = 1 << 20
_NONE = np.empty(0, np.int64)
# The largest message that is unpacked: a picture may be larger than a chunk [bytes].
_MAX_UNPACKED = 2 * MAX_CHUNK
Rows = list[tuple[Any, ...]]


class SqliteFile(BagFile):
    """Contents of a file of SQLite, in blocks as those of one of MCAP.

    A block is a range of row ids, from ``offset`` on. Making it reads the times of all messages; the first
    ones that can be read tell whether all are packed by zstd. Its counts stand for those of a summary: where
    reading gives others, that is a loss. Warnings go to ``findings``, a copy to ``scratch``.

    Raises:
        BagError: The file cannot be read.
    """

    def __init__(self, path: Path, findings: Findings, scratch: Scratch) -> None:
        super().__init__(path, 0, findings)
        self._scratch = scratch
        self._uri = ''  # what SQLite opens, once that is known
        self._numbers: dict[int, int] = {}  # the channel of each id of a topic
        self._times = dict[int, Piece]()  # without data, by the first row id of their block
        self._decompressor = zstandard.ZstdDecompressor()
        self.is_stated = True
        with self._open_read_only() as database:
            self.size = path.stat().st_size
            self._read_topics(database)
            first_rows = next(self._iterate_rows(database, 'substr(data, 1, 4)'), [])
            # CDR begins with a zero.
            self._is_packed = any(begin == ZSTD for _, begin in first_rows)
            if self._scan_messages(database):
                return
            self.findings.note(f"file '{path.name}' is damaged (its row ids do not rise): read as a copy")
            self._uri = self._copy_messages(database)
        with self._open_read_only() as database:
            self._scan_messages(database)

    @contextlib.contextmanager
    def _open_read_only(self) -> Iterator[sqlite3.Connection]:
        """Open a connection to the file that changes nothing, or to its copy.

        Raises:
            BagError: The file cannot be read; also for an error of the database inside the context.
        """
        try:
            self._uri = self._uri or self._find_uri()
            with contextlib.closing(sqlite3.connect(self._uri, uri=True)) as database:
                database.text_factory = lambda raw: raw.decode('utf-8', 'replace')
                yield database
        except (*_ERRORS, OSError, ValueError) as error:
            raise BagError(_refusal_text(self.path, str(error))) from None

    def _find_uri(self) -> str:
        """Return the file, not to be changed; with a journal beside it, a copy of both for SQLite to play it.

        The copy is made in the temporary folder of the recording, and noted.

        Raises:
            OSError: It cannot be copied.
        """
        journals = [self.path.with_name(f'{self.path.name}{end}') for end in ('-wal', '-journal')]
        if not any(journal.is_file() and journal.stat().st_size for journal in journals):
            return f'{self.path.absolute().as_uri()}?mode=ro&immutable=1'
        copy = self._scratch.folder / self.path.name
        for part in (self.path, *filter(Path.is_file, journals)):
            shutil.copyfile(part, copy.with_name(part.name))
        self.findings.note(
            f"file '{self.path.name}' has a journal that its recorder left: read as a copy with it"
        )
        return copy.as_uri()

    def _read_topics(self, database: sqlite3.Connection) -> None:
        """Fill in channels, their ids of topics, and schemas: that of an undefined type has no encoding.

        Damage of the table of definitions is ignored.

        Raises:
            sqlite3.Error: The topics cannot be read; also MemoryError.
        """
        texts: dict[Any, str] = {}
        # Not before ROS 2 Iron.
        with contextlib.suppress(*_ERRORS):
            for kind, encoding, text in database.execute(
                'SELECT topic_type, encoding, encoded_message_definition FROM message_definitions'
            ):
                if encoding == SchemaEncoding.ROS2 and text and isinstance(text, str):
                    texts[kind] = text
        rows = database.execute('SELECT id, name, type, serialization_format FROM topics')
        for number, (key, *row) in enumerate(rows):
            name, kind, encoding = map(str, row)
            if isinstance(key, int):
                self._numbers[key] = number
            text = texts.get(kind) or definition_of(kind)
            schema = Schema(number, (text or '').encode(), '' if text is None else SchemaEncoding.ROS2, kind)
            self.schemas[number] = schema
            self.channels[number] = Channel(number, name, encoding, {}, number)

    def find_problem(self, channel: Channel) -> str:
        """Return a clause on why messages of a channel cannot be decoded; empty where no reason is known."""
        schema = self.schemas[channel.schema_id]
        if schema.encoding or channel.message_encoding != MessageEncoding.CDR:
            return super().find_problem(channel)
        return (
            f"the recording has no definition of {schema.name}: write it as MCAP by 'ros2 bag convert' where"
            ' its messages are installed'
        )

    def _scan_messages(self, database: sqlite3.Connection) -> bool:
        """Fill in counts, blocks and times; report messages of topics that are defined nowhere as lost.

        Messages without a valid time count too. Blocks are ranges of row ids of up to 16 MiB, unpacked, or of
        one message. The times of the first million messages are kept. What another scan filled in is dropped.

        Returns:
            Whether row ids rise, as they do but in a damaged tree: there rows are not found by them again.
        """
        self.counts.clear()
        self.blocks.clear()
        self._times.clear()
        unknown, end, is_rising = Counter[Any](), -(1 << 63), True
        lengths = 'ifnull(length(data), 0)' + self._is_packed * ', substr(data, 1, 18)'
        for rows in self._iterate_rows(database, f'timestamp, topic_id, {lengths}'):
            row_ids, times, keys, *sizes = _columns_of(rows, 4 + self._is_packed)
            ids, time_ns, channel = np.array(row_ids, np.int64), _times_of(times), self._find_channels(keys)
            is_rising = is_rising and bool(ids[0] >= end and (ids[1:] > ids[:-1]).all())
            end = int(ids[-1]) + 1
            unknown.update(itertools.compress(keys, channel < 0))
            size = np.fromiter(map(_unpacked_size, *sizes) if self._is_packed else sizes[0], np.int64)
            splits = np.flatnonzero(np.diff(np.cumsum(size) // _MAX_BYTES)) + 1
            for part in np.split(np.arange(ids.size), splits):
                defined = part[channel[part] >= 0]
                numbers = dict(enumerate(np.bincount(channel[defined]).tolist()))
                self.counts.update(numbers)
                first, last = ids[part[[0, -1]]].tolist()
                block = Block(self.path, first, last - first + 1, 0, False, place_name='row')
                block.channels = sum(1 << number for number, count in numbers.items() if count)
                if spans := self.widen_span(time_ns[defined][time_ns[defined] >= 0]):
                    ((block.start_ns, block.end_ns),) = spans
                self.blocks.append(block)
                if self.counts.total() <= _MAX_KEPT:
                    columns = channel[part].astype(np.uint16), time_ns[part], _NONE, _NONE
                    self._times[first] = Piece(b'', *columns, [], 0, 0, _places_of(ids[part], first))
        for key, count in unknown.items():
            self.findings.lose(
                f"file '{self.path.name}': {plural(count, 'message')} of topic {key}, which is"
                ' defined nowhere, were not read'
            )
        return is_rising

    def _find_channels(self, keys: Sequence[Any]) -> IntArray:
        """Return the channels of ids of topics, shape (n,); -1 for an id that is defined nowhere."""
        return np.fromiter(map(self._numbers.get, keys, itertools.repeat(-1)), np.int64, len(keys))

    def _copy_messages(self, database: sqlite3.Connection) -> str:
        """Copy a damaged tree to a sound one in the temporary folder, with row ids from 1 on; return its URI.

        Raises:
            OSError: The copy cannot be written; also sqlite3.Error.
        """
        copy = self._scratch.folder / f'{self.path.name}.copy'
        with contextlib.closing(sqlite3.connect(copy)) as target:
            target.execute('CREATE TABLE messages(timestamp, topic_id, data)')
            # Few at a time: they may be pictures.
            for rows in self._iterate_rows(database, 'timestamp, topic_id, data', max_count=16):
                target.executemany('INSERT INTO messages VALUES (?, ?, ?)', [row[1:] for row in rows])
            target.commit()
        return copy.as_uri()

    def load_pieces(self, block: Block, topics: Collection[str] | None = None) -> tuple[int, Sequence[Piece]]:
        """Read the messages of some topics, or all, in a block; those without a time or data are unreadable.

        Damaged pages are reported as a loss, not raised; the data of a damaged packed message are empty.

        Returns:
            The bytes of these messages, and a piece that has all of them in the order of writing.

        Raises:
            BagError: The file cannot be read.
        """
        piece = self._read_piece(block, topics, 'data')
        return piece.end, [piece]

    def load_times(self, block: Block, topics: Collection[str]) -> Sequence[Piece]:
        """Return the pieces of a block as :meth:`load_pieces` does, without data.

        Where the times of the block are kept they are those of all topics, also of undefined ones and -1 for
        none; offsets and sizes are empty then.
        """
        piece = self._times.get(block.offset)
        return [self._read_piece(block, topics, "x''") if piece is None else piece]

    def _read_piece(self, block: Block, topics: Collection[str] | None, data_column: str) -> Piece:
        """Return the messages of some topics, or all, in a block, with data as a column of SQL gives them.

        Raises:
            BagError: The file cannot be read.
        """
        numbers = self._numbers.items()
        ids = [key for key, number in numbers if topics is None or self.channels[number].topic in topics]
        where = f'rowid < {block.offset + block.length} AND topic_id IN ({",".join(map(str, ids))})'
        with self._open_read_only() as database:
            selected = f'timestamp, topic_id, {data_column}'
            rows = list(itertools.chain(*self._iterate_rows(database, selected, block.offset, where)))
        sound = [row for row in rows if type(row[3]) is bytes]
        row_ids, times, keys, parts = _columns_of(sound, 4)
        time_ns = _times_of(times)
        if self._is_packed and data_column == 'data':
            parts = list(map(self._unpack_message, parts))
        data, size = b''.join(parts), np.fromiter(map(len, parts), np.int64, len(parts))
        offset = np.cumsum(size) - size
        place = _places_of(np.array(row_ids, np.int64), block.offset)
        columns = time_ns, self._find_channels(keys).astype(np.uint16), offset, size, place
        time_ns, channel, offset, size, place = select_rows(columns, time_ns >= 0)
        unread = len(rows) - time_ns.size
        return Piece(data, channel, time_ns, offset, size, [], unread, len(data), place)

    def _iterate_rows(
        self,
        database: sqlite3.Connection,
        columns: str,
        begin: int = -(1 << 63),
        where: str = '1',
        max_count: int | None = None,
    ) -> Iterator[Rows]:
        """Yield lists of up to 32768 messages in the order of writing: tuples of the row id and some columns.

        Damaged pages and rows are reported as a loss, not raised. Reading goes on behind them, over one row
        id first, then over a quarter more each time: where every second page is zeros, four fifths of the
        others' messages are read. ``begin`` is the first row id; columns and condition are trusted SQL. Lists
        have up to ``max_count`` messages where that is given.
        """
        step, cursor = 1, None
        while begin < 1 << 63:
            batch: Rows = []
            try:
                cursor = cursor or database.execute(
                    f'SELECT rowid, {columns} FROM messages NOT INDEXED'
                    # The second time of each row: in a damaged tree others come behind the first one.
                    f' WHERE rowid >= ?1 AND +rowid >= ?1 AND {where} ORDER BY rowid',
                    (begin,),
                )
                # What comes before an error stays in the batch.
                batch.extend(itertools.islice(cursor, max_count or _BATCH))
                if not batch:
                    return
            except _ERRORS as error:
                cursor = None
                self.findings.lose(
                    f"file '{self.path.name}' is damaged ({str(error) or 'out of memory'}): messages of the"
                    ' damaged pages were not read'
                )
            if batch:
                begin, step = max(begin, _last_in_order([row[0] for row in batch]) + 1), 1
                yield batch
            if cursor is None:
                begin, step = max(begin, 0) + step, 1 + step + step // 4

    def _unpack_message(self, data: bytes) -> bytes:
        """Return the unpacked data of a message; empty where they are damaged or too large."""
        with contextlib.suppress(zstandard.ZstdError, MemoryError):
            if _unpacked_size(0, data[:18]) <= _MAX_UNPACKED:
                return self._decompressor.decompress(data, max_output_size=MAX_CHUNK)
        return b''


def _unpacked_size(length: int, head: bytes) -> int:
    """Return how large a packed message of a length becomes by its first 18 bytes [bytes].

    Where these do not say it, it is taken to become 100 times as large; damaged ones stay as they are.
    """
    with contextlib.suppress(zstandard.ZstdError, TypeError):
        size = zstandard.frame_content_size(head)
        return min(size, 1 << 40) if size >= 0 else 100 * length
    return length


def _columns_of(rows: Rows, count: int) -> list[list[Any]]:
    """Return the columns of rows: ``zip`` would make an object of each, which takes twice as long."""
    return [[row[k] for row in rows] for k in range(count)]


def _places_of(row_ids: IntArray, begin: int) -> IntArray:
    """Return the places of rows in a block by its first row id, shape (n,); they end at 2^32 - 1."""
    return np.minimum((row_ids - begin).view(np.uint64), (1 << 32) - 1).astype(np.int64)


def _times_of(values: Sequence[Any]) -> IntArray:
    """Return log times [ns], shape (n,), without fractions; -1 for no number from 0 to ``MAX_TIME_NS``."""
    if not set(map(type, values)) <= {int}:
        values = [int(v) if isinstance(v, float | int) and abs(v) <= MAX_TIME_NS else -1 for v in values]
    time_ns = np.array(values, np.int64)
    return np.where((time_ns >= 0) & (time_ns <= MAX_TIME_NS), time_ns, -1)


def _last_in_order(row_ids: list[int]) -> int:
    """Return the last of the most of n > 0 row ids that rise: a damaged one may be above or below others."""
    if row_ids == sorted(row_ids):
        return row_ids[-1]
    ends: list[int] = []
    for row_id in row_ids:
        k = bisect.bisect_left(ends, row_id)
        ends[k : k + 1] = [row_id]
    return ends[-1]


def _refusal_text(file: Path, problem: str) -> str:
    """Return the error text on a database that cannot be read, of which SQLite names a problem.

    Without a table of topics it is no recording: then it is opened once more to name its tables.
    """
    if problem == 'no such table: topics':
        uri = f'{file.absolute().as_uri()}?mode=ro&immutable=1'
        with contextlib.suppress(*_ERRORS), contextlib.closing(sqlite3.connect(uri, uri=True)) as database:
            query = "SELECT name FROM sqlite_master WHERE type = 'table' ORDER BY name"
            names = [str(name) for (name,) in database.execute(query).fetchmany(MAX_NAMED)]
            if names:
                return (
                    f"'{file}' is a database and no recording of ROS 2: it has the tables {', '.join(names)};"
                    f" write one as CSV: sqlite3 -header -csv '{file}' 'SELECT * FROM {names[0]}' > log.csv"
                )
    return f"bag file '{file}' cannot be read: {problem}"
