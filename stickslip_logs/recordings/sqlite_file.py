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
import sys
from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import zstandard
from mcap.records import Channel, Schema
from mcap.well_known import MessageEncoding, SchemaEncoding

from stickslip_logs.errors import MAX_NAMED, BagError, plural
from stickslip_logs.recordings.bag_file import BagFile
from stickslip_logs.recordings.mcap_chunks import MAX_CHUNK, PAYLOAD, Block, Piece
from stickslip_logs.recordings.message_types import definition_of
from stickslip_logs.recordings.recording import Findings, Scratch
from stickslip_logs.time_order import MAX_TIME_NS

MAGIC = b'SQLite format 3\0'
# Messages that are read at a time.
_BATCH = 32_768
# Of a page whose damage makes it ask for more memory than there is, the latter.
_ERRORS = sqlite3.Error, MemoryError
# Whether a message has a number that can be a log time [ns]; 0 can be one.
_TIME = f'timestamp BETWEEN 0 AND {MAX_TIME_NS}'
Rows = list[tuple[Any, ...]]


class SqliteFile(BagFile):
    """Contents of a file of SQLite, in blocks as those of one of MCAP.

    A block is a range of row ids, from ``offset`` on. Making it reads the times of all messages.

    Args:
        path: The file.
        findings: Takes the warnings.
        scratch: Where a copy is made.
        is_packed: Whether each message is compressed.

    Raises:
        BagError: The file cannot be read.
    """

    def __init__(self, path: Path, findings: Findings, scratch: Scratch, *, is_packed: bool = False) -> None:
        super().__init__(path, 0, findings)
        self._scratch, self._is_packed = scratch, is_packed
        self._numbers: dict[int, int] = {}  # the channel of each id of a topic
        self._copy: Path | None = None  # of the messages, where their row ids do not rise
        self._decompressor = zstandard.ZstdDecompressor()
        with self._open_read_only() as database:
            self.size = path.stat().st_size
            self._read_topics(database)
            self._scan_messages(database)

    @contextlib.contextmanager
    def _open_read_only(self) -> Iterator[sqlite3.Connection]:
        """Open a connection that changes nothing; with a journal beside the file, to a copy.

        Raises:
            BagError: The file cannot be read; also for an error of the database inside the context.
        """
        try:
            file = self._copy or self._apply_journal()
            uri = f'{file.absolute().as_uri()}?mode=ro&immutable=1'
            with contextlib.closing(sqlite3.connect(uri, uri=True)) as database:
                if sys.version_info >= (3, 11):
                    # What a damaged length asks for is not taken.
                    database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, MAX_CHUNK)
                database.text_factory = lambda raw: raw.decode('utf-8', 'replace')
                yield database
        except (*_ERRORS, OSError, ValueError) as error:
            raise BagError(_refusal_text(self.path, str(error))) from None

    def _apply_journal(self) -> Path:
        """Return the file; with a journal beside it, a copy into which the journal was played back.

        The copy is made once, in the temporary folder of the recording, and noted.

        Raises:
            OSError: It cannot be copied; also sqlite3.Error.
        """
        ends = [self.path.with_name(f'{self.path.name}{end}') for end in ('-wal', '-journal')]
        if not any(end.is_file() and end.stat().st_size for end in ends):
            return self.path
        copy = self._scratch.folder / self.path.name
        if not copy.exists():
            for part in (self.path, *filter(Path.is_file, ends)):
                shutil.copyfile(part, copy.with_name(part.name))
            with contextlib.closing(sqlite3.connect(copy)) as database:
                database.execute('SELECT count(*) FROM sqlite_master').fetchall()
                with contextlib.suppress(sqlite3.Error):
                    database.execute('PRAGMA journal_mode=DELETE').fetchall()
            self.findings.note(
                f"file '{self.path.name}' has a journal that its recorder left: read as a copy with it"
            )
        return copy

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

    def _scan_messages(self, database: sqlite3.Connection) -> None:
        """Fill in counts, blocks and times; report messages of topics that are defined nowhere as lost.

        Messages without a valid time count too. Blocks are ranges of row ids: where these do not rise, as
        in a damaged tree, the messages are copied, and the copy is scanned: errors as :meth:`_copy_messages`.
        """
        unknown, end = Counter[Any](), -(1 << 63)
        for rows in self._iterate_rows(database, f'{_TIME}, timestamp, topic_id'):
            ids = np.array([row[0] for row in rows], np.int64)
            if ids[0] < end or (ids[1:] <= ids[:-1]).any():
                self._copy_messages(database)
                self.blocks.clear()
                self.counts.clear()
                with self._open_read_only() as copy:
                    self._scan_messages(copy)
                return
            first, end = int(ids[0]), int(ids[-1]) + 1
            counts = Counter(key for *_, key in rows)
            unknown.update({key: count for key, count in counts.items() if key not in self._numbers})
            counts_by_channel = {
                self._numbers[key]: counts[key] for key in counts.keys() & self._numbers.keys()
            }
            self.counts.update(counts_by_channel)
            times = [time for _, is_time, time, key in rows if is_time and key in self._numbers]
            spans = self.widen_span(np.array(times, np.int64))
            block = Block(self.path, first, end - first, 0, False, place_name='row')
            block.channels = sum(1 << number for number in counts_by_channel)
            if spans:
                ((block.start_ns, block.end_ns),) = spans
            self.blocks.append(block)
        for key, count in unknown.items():
            self.findings.lose(
                f"file '{self.path.name}': {plural(count, 'message')} of topic {key}, which is"
                ' defined nowhere, were not read'
            )

    def _copy_messages(self, database: sqlite3.Connection) -> None:
        """Copy the messages to the temporary folder, in the order of the tree and with rising row ids.

        Sets ``_copy``, which later connections open, and notes it.

        Raises:
            OSError: There is no folder for temporary files; also sqlite3.Error where its disk is full.
        """
        copy = self._scratch.folder / f'{self.path.name}.messages'
        with contextlib.closing(sqlite3.connect(copy)) as target:
            target.execute('CREATE TABLE messages(timestamp, topic_id, data)')
            for rows in self._iterate_rows(database, 'timestamp, topic_id, data'):
                target.executemany('INSERT INTO messages VALUES (?, ?, ?)', [row[1:] for row in rows])
            target.commit()
        self._copy = copy
        self.findings.note(f"file '{self.path.name}' is damaged (its row ids do not rise): read as a copy")

    def load_pieces(self, block: Block, topics: Collection[str] | None = None) -> tuple[int, Sequence[Piece]]:
        """Read the messages of some topics, or all, in a block; those without a time or data are unreadable.

        Damaged pages are reported as a loss, not raised; the data of a damaged packed message are empty.

        Returns:
            The bytes of these messages, and a piece that has all of them in the order of writing.

        Raises:
            BagError: The file cannot be read.
        """
        numbers = {
            key: number
            for key, number in self._numbers.items()
            if topics is None or self.channels[number].topic in topics
        }
        where = f'rowid < {block.offset + block.length} AND topic_id IN ({",".join(map(str, numbers))})'
        columns = f"{_TIME} AND typeof(data) = 'blob', timestamp, topic_id, data"
        with self._open_read_only() as database:
            batches = self._iterate_rows(database, columns, block.offset, where)
            rows = list(itertools.chain.from_iterable(batches))
        sound = [row for row in rows if row[1]]
        times, keys, parts = ([row[k] for row in sound] for k in (2, 3, 4))
        if self._is_packed:
            parts = list(map(self._unpack_message, parts))
        # Where the head of the first message would be.
        data = b''.join([bytes(PAYLOAD), *parts])
        size = np.fromiter(map(len, parts), np.int64, len(parts))
        offset = PAYLOAD + np.cumsum(size) - size
        channel = np.array([numbers[key] for key in keys], np.uint16)
        unread = len(rows) - len(sound)
        return len(data), [
            Piece(data, channel, np.array(times, np.int64), offset, size, [], unread, len(data))
        ]

    def _iterate_rows(
        self, database: sqlite3.Connection, columns: str, begin: int = -(1 << 63), where: str = '1'
    ) -> Iterator[Rows]:
        """Yield lists of up to 32768 messages in the order of writing: tuples of the row id and some columns.

        Damaged pages and rows are reported as a loss, not raised. Reading goes on behind them, over one row
        id first, then over a quarter more each time: where every second page is zeros, four fifths of the
        others' messages are read.

        Args:
            database: A connection to the file.
            columns: The columns, as SQL writes them.
            begin: The first row id.
            where: The condition, as SQL writes it; trusted.
        """
        step = 1
        while begin < 1 << 63:
            batch: Rows = []
            try:
                cursor = database.execute(
                    f'SELECT rowid, {columns} FROM messages NOT INDEXED'
                    # The second time of each row: in a damaged tree others come behind the first one.
                    f' WHERE rowid >= ?1 AND +rowid >= ?1 AND {where} ORDER BY rowid',
                    (begin,),
                )
                while True:
                    # What comes before an error stays in the batch.
                    batch.extend(itertools.islice(cursor, _BATCH))
                    if not batch:
                        return
                    begin, step = max(begin, _last_in_order([row[0] for row in batch]) + 1), 1
                    yield batch
                    batch = []
            except _ERRORS as error:
                self.findings.lose(
                    f"file '{self.path.name}' is damaged ({str(error) or 'out of memory'}): messages of the"
                    ' damaged pages were not read'
                )
            if batch:
                begin, step = max(begin, _last_in_order([row[0] for row in batch]) + 1), 1
                yield batch
            begin, step = max(begin, 0) + step, 1 + step + step // 4

    def _unpack_message(self, data: bytes) -> bytes:
        """Return the unpacked data of a message; empty where they are damaged or too large."""
        try:
            return self._decompressor.decompress(data, max_output_size=MAX_CHUNK)
        except zstandard.ZstdError:
            return b''


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
    """Return the error text on a database that cannot be read; open it once more to name its tables.

    Args:
        file: The database.
        problem: What SQLite says; a missing table of topics means that it is no recording.
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
