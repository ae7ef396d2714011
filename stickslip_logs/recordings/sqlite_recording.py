# SPDX-License-Identifier: Apache-2.0
"""A recording that rosbag2 stored by SQLite, its default up to ROS 2 Humble.

Files come in the order of their metadata; messages in the order in which they were written.
Nothing is written to a file: one with a journal is read as a copy.
"""

from __future__ import annotations

import contextlib
import functools
import shutil
import sqlite3
import sys
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import zstandard
from mcap.records import Schema

from stickslip_logs.arrays import IntArray
from stickslip_logs.errors import MAX_NAMED, BagError, plural
from stickslip_logs.recordings.mcap_chunks import MAX_CHUNK
from stickslip_logs.recordings.message_fields import MessageReading, TopicNumbers
from stickslip_logs.recordings.message_types import definition_of
from stickslip_logs.recordings.recording import (
    Findings,
    Message,
    Progress,
    Recording,
    Request,
    Scratch,
    TimeSpans,
    TopicInfo,
    encoding_problem,
)
from stickslip_logs.time_order import MAX_TIME_NS, Columns, Row, Sorter, TimeCourse, TimeOrder

MAGIC = b'SQLite format 3\0'
# Messages that are read at a time.
_BATCH = 32_768
# Of a page whose damage makes it ask for more memory than there is, the latter.
_ERRORS = sqlite3.Error, MemoryError
# A place in the recording is the number of a file above the rowid in it, clipped where damage made it larger:
# 32,768 files of 2.8e14 messages.
_ROWID_BITS = 48
# Behind a damaged page reading goes on: the first step over it [row ids] doubles up to 40 times.
_FIRST_SKIP = 64
Rows = list[tuple[Any, ...]]


class SqliteRecording(Recording):
    """The files of a recording in SQLite.

    Args:
        path: The file or folder.
        files: The files in order.
        is_packed: Whether each message is compressed.
        findings: Takes what is wrong.
        scratch: Where copies are made.

    Raises:
        BagError: A file cannot be read.
    """

    def __init__(
        self, path: Path, files: Sequence[Path], is_packed: bool, findings: Findings, scratch: Scratch
    ) -> None:
        self.path, self.files = path, tuple(files)
        self._is_packed, self._findings, self._scratch = is_packed, findings, scratch
        self._texts: dict[str, str] = {}
        self._counts: Counter[str] = Counter()
        self._types: dict[str, tuple[str, str]] = {}
        self._order, self._topic_numbers = TimeOrder(), dict[str, int]()
        for number, file in enumerate(files):
            self._scan_database(number, file)
        whole = self._judge_order([*self._topic_numbers])
        self.start_ns, self.end_ns = whole.start_ns, whole.end_ns
        self._topics = {name: self._describe_topic(name, *self._types[name]) for name in sorted(self._types)}
        self._message_count = self._counts.total()

    def _describe_topic(self, name: str, kind: str, encoding: str) -> TopicInfo:
        """Return the description of a topic, with a problem where its messages cannot be decoded.

        Saves the definition of its type where only this computer has it.

        Args:
            name: The topic.
            kind: Its type.
            encoding: How its messages are encoded.
        """
        text = self._texts.get(kind) or definition_of(kind)
        problem = ''
        if encoding != 'cdr':
            problem = encoding_problem('message', encoding, 'cdr')
        elif text is None:
            problem = (
                f'the recording has no definition of {kind}: source the setup file of a ROS 2 that has it'
            )
        else:
            self._texts[kind] = text
        return TopicInfo(name, kind, self._counts[name], encoding, problem)

    @contextlib.contextmanager
    def _open_read_only(self, file: Path) -> Iterator[sqlite3.Connection]:
        """Open a connection that changes nothing; with a journal beside the file, to a copy.

        Raises:
            BagError: The file cannot be read; also for an error of the database inside the context.
        """
        try:
            uri = f'{self._apply_journal(file).absolute().as_uri()}?mode=ro&immutable=1'
            with contextlib.closing(sqlite3.connect(uri, uri=True)) as database:
                if sys.version_info >= (3, 11):
                    # What a damaged length asks for is not taken.
                    database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, MAX_CHUNK)
                database.text_factory = lambda raw: raw.decode('utf-8', 'replace')
                yield database
        except (*_ERRORS, OSError, ValueError) as error:
            raise BagError(_refusal_text(file, str(error))) from None

    def _apply_journal(self, file: Path) -> Path:
        """Return the file; with a journal beside it, a copy into which the journal was played back.

        The copy is made once, in the temporary folder of the recording, and noted.

        Raises:
            OSError: It cannot be copied; also sqlite3.Error.
        """
        ends = [file.with_name(f'{file.name}{end}') for end in ('-wal', '-journal')]
        if not any(end.is_file() and end.stat().st_size for end in ends):
            return file
        copy = self._scratch.folder / file.name
        if not copy.exists():
            for part in (file, *filter(Path.is_file, ends)):
                shutil.copyfile(part, copy.with_name(part.name))
            with contextlib.closing(sqlite3.connect(copy)) as database:
                database.execute('SELECT count(*) FROM sqlite_master').fetchall()
                with contextlib.suppress(sqlite3.Error):
                    database.execute('PRAGMA journal_mode=DELETE').fetchall()
            self._findings.note(
                f"file '{file.name}' has a journal that its recorder left: read as a copy with it"
            )
        return copy

    def _scan_database(self, number: int, file: Path) -> None:
        """Add the topics, definitions, message counts and times of a file to those of the recording.

        Reports as losses topics of several types, of which the first counts, and unreadable messages.

        Args:
            number: The number of the file in the recording.
            file: The file.

        Raises:
            BagError: The file cannot be read.
        """
        with self._open_read_only(file) as database:
            names: dict[int, str] = {}
            for key, *row in database.execute('SELECT id, name, type, serialization_format FROM topics'):
                name, kind, encoding = map(str, row)
                if isinstance(key, int):
                    names[key] = name
                definition = self._types.setdefault(name, (kind, encoding))
                if definition != (kind, encoding):
                    self._findings.lose(f"topic '{name}' has several types: {definition[0]}, {kind}")
            # Not before ROS 2 Iron.
            with contextlib.suppress(*_ERRORS):
                for kind, encoding, text in database.execute(
                    'SELECT topic_type, encoding, encoded_message_definition FROM message_definitions'
                ):
                    if encoding == 'ros2msg' and text and isinstance(text, str):
                        self._texts.setdefault(kind, text)
            self._count_messages(number, file, database, names)

    def _count_messages(
        self, number: int, file: Path, database: sqlite3.Connection, names: Mapping[int, str]
    ) -> None:
        """Add the messages of a file to the counts and to the order of time; report those of unknown topics.

        Args:
            number: The number of the file in the recording.
            file: The file.
            database: A connection to it.
            names: The topics by their id in it.
        """
        counts = Counter[Any]()
        sources = {
            key: self._topic_numbers.setdefault(name, len(self._topic_numbers)) for key, name in names.items()
        }
        for rows in self._iterate_rows(file, database, 'timestamp, topic_id'):
            counts.update(key for _, _, key in rows)
            # Time 0 is that of a clock that was not set.
            timed = [
                (time, sources[key], rowid)
                for rowid, time, key in rows
                if time and _is_time(time) and key in names
            ]
            if timed:
                time_ns, source, rowids = np.array(timed, np.int64).T
                self._order.add(time_ns, source, _join_places(number, rowids))
        for key, count in counts.items():
            if key in names:
                self._counts[names[key]] += count
            else:
                self._findings.lose(
                    f"file '{file.name}': {plural(count, 'message')} of topic {key}, which is"
                    ' defined nowhere, were not read'
                )

    def _iterate_rows(
        self, file: Path, database: sqlite3.Connection, columns: str, where: str = '1'
    ) -> Iterator[Rows]:
        """Yield lists of up to 32768 messages in the order of writing: tuples of the row id and some columns.

        Damaged pages are reported as a loss, not raised; reading goes on behind them, at ids in growing
        steps, and ends after 41 of them.

        Args:
            file: The file, for the reports.
            database: A connection to it.
            columns: The columns, as SQL writes them.
            where: The condition, as SQL writes it; trusted.
        """
        begin, step, skips = -(1 << 63), _FIRST_SKIP, 0
        while begin < 1 << 63 and skips <= 40:
            batch: Rows = []
            try:
                cursor = database.execute(
                    f'SELECT rowid, {columns} FROM messages NOT INDEXED'
                    f' WHERE rowid >= ? AND {where} ORDER BY rowid',
                    (begin,),
                )
                while True:
                    # What comes before an error stays in the batch.
                    batch.extend(islice(cursor, _BATCH))
                    if not batch:
                        return
                    begin, step = batch[-1][0] + 1, _FIRST_SKIP
                    yield batch
                    batch = []
            except _ERRORS as error:
                self._findings.lose(
                    f"file '{file.name}' is damaged ({str(error) or 'out of memory'}): messages of the"
                    ' damaged pages were not read'
                )
            if batch:
                begin, step = batch[-1][0] + 1, _FIRST_SKIP
                yield batch
            begin, step, skips = max(begin, 0) + step, 2 * step, skips + 1

    def definition(self, topic: str) -> str:
        """Return the ``ros2msg`` definition of a topic's messages.

        Raises:
            BagError: The topic is not there or cannot be decoded.
        """
        return self._texts[self._require_readable(topic).type]

    def messages(
        self, topics: Collection[str] | None = None, spans: TimeSpans | None = None
    ) -> Iterator[Message]:
        """Yield messages in the order of time, then of place in the recording.

        Adds warnings on damage, and at the end on odd times.

        Args:
            topics: Which topics; all when None.
            spans: The log times that are wanted; all when None.

        Raises:
            BagError: A topic is not there, or a file cannot be read; raised at the first message.
        """
        names = [self._require_topic(name) for name in (self.topics if topics is None else topics)]
        for columns in self.batches([topic.name for topic in names]):
            for time_ns, number, data in zip(*(column.tolist() for column in columns), strict=True):
                if spans is None or spans.overlap(time_ns, time_ns):
                    yield Message(names[number].name, names[number].type, time_ns, data)

    def batches(self, topics: Sequence[str]) -> Iterator[Columns]:
        """Yield messages in order of corrected time; note at the end what is odd about the times.

        Yields:
            Log times [ns], numbers of topics as in ``topics``, and data as bytes, shape (n,) each.

        Raises:
            BagError: A file cannot be read.
        """
        # A topic without messages has no number.
        sources = np.array([self._topic_numbers.get(topic, -1) for topic in topics], np.int64)
        course = self._judge_order(topics)
        sorter = Sorter(course.wait_ns)
        for time_ns, topic, data, place in self._iterate_written(topics):
            yield from sorter.add((course.follow(time_ns, sources[topic], place), topic, data))
        yield from sorter.rest()
        for text in course.notes('the messages are', 'of the recorder'):
            self._findings.note(text)

    def _judge_order(self, topics: Sequence[str]) -> TimeCourse:
        """Return the course of the messages of some topics; may read parts of files again."""
        sources = [self._topic_numbers.get(topic, -1) for topic in topics]
        files = [number << _ROWID_BITS for number in range(1, len(self.files))]
        return self._order.course(sources, functools.partial(self._read_rows, topics), files)

    def _read_rows(
        self, topics: Sequence[str], begin: int, end: int, span_ns: tuple[int, int]
    ) -> Iterator[Row]:
        """Yield the messages of some topics from one place up to another in a span of time [ns].

        Raises:
            BagError: A file cannot be read.
        """
        for time_ns, topic, data, _ in self._iterate_written(topics, (begin, end), span_ns):
            yield from zip(topic.tolist(), time_ns.tolist(), data, strict=True)

    def _iterate_written(
        self,
        topics: Sequence[str],
        places: tuple[int, int] | None = None,
        span_ns: tuple[int, int] = (0, MAX_TIME_NS),
    ) -> Iterator[Columns]:
        """Yield messages as written; report at the end how many have no valid time or data.

        Args:
            topics: The topics.
            places: The first place, and the one behind the last, of the messages; then that number is not
                reported. None for all messages.
            span_ns: Their first and last time [ns]; used with ``places`` only.

        Yields:
            Log times [ns], numbers of topics as in ``topics``, unpacked data, and places in the recording,
            shape (n,) each.

        Raises:
            BagError: A file cannot be read.
        """
        numbers, unread = {topic: number for number, topic in enumerate(topics)}, 0
        unpack = self._choose_unpacker()
        for file_number, file in enumerate(self.files):
            with self._open_read_only(file) as database:
                ids = {
                    key: numbers[str(name)]
                    for key, name in database.execute('SELECT id, name FROM topics')
                    if isinstance(key, int) and str(name) in numbers
                }
                if not ids:
                    continue
                where = f'topic_id IN ({",".join(map(str, ids))})'
                if places is not None:
                    first, end = (place - (file_number << _ROWID_BITS) for place in places)
                    where += f' AND rowid >= {first} AND rowid < {end}'
                    where += f' AND timestamp BETWEEN {span_ns[0]} AND {span_ns[1]}'
                for rows in self._iterate_rows(file, database, 'timestamp, topic_id, data', where):
                    sound = [
                        (time_ns, ids[key], plain, rowid)
                        for rowid, time_ns, key, data in rows
                        if _is_time(time_ns)
                        and isinstance(data, bytes)
                        and (plain := unpack(data)) is not None
                    ]
                    unread += len(rows) - len(sound)
                    if sound:
                        data = np.empty(len(sound), np.object_)
                        data[:] = [row[2] for row in sound]
                        times, keys, rowids = (
                            np.array([row[k] for row in sound], np.int64) for k in (0, 1, 3)
                        )
                        yield times, keys, data, _join_places(file_number, rowids)
        if unread and places is None:
            self._findings.lose(f'{plural(unread, "message")} without time or data were not read')

    def _choose_unpacker(self) -> Callable[[bytes], bytes | None]:
        """Return a function that unpacks the data of a message: None where damaged or too large."""
        if not self._is_packed:
            return lambda data: data
        decompress = zstandard.ZstdDecompressor().decompress

        def unpack(data: bytes) -> bytes | None:
            """Return the unpacked data; None where they are damaged or too large."""
            try:
                return decompress(data, max_output_size=MAX_CHUNK)
            except zstandard.ZstdError:
                return None

        return unpack

    def reading(self, requests: Iterable[Request], progress: Progress | None = None) -> SqliteReading:
        """Return a pass that reads numbers of some topics; errors as for :meth:`Recording.reading`.

        Progress is given in messages.
        """
        wanted = [TopicNumbers(topic, paths) for topic, paths in self._group_requests(requests).items()]
        return SqliteReading(self, wanted, progress)


def open_database(file: Path) -> SqliteRecording:
    """Open one file as a recording of its own, whose warnings are dropped.

    Raises:
        BagError: It cannot be read.
    """
    return SqliteRecording(file, [file], False, Findings(), Scratch())


def _is_time(value: Any) -> bool:
    """Return whether a value of a database is an integer that can be a log time [ns]; 0 can be one."""
    return isinstance(value, int) and 0 <= value <= MAX_TIME_NS


def _join_places(file: int, rowid: IntArray) -> IntArray:
    """Return the places of messages, which rise through the files of a recording, shape (n,).

    Args:
        file: The number of the file.
        rowid: Their row ids, shape (n,); those that damage made are clipped.
    """
    return (file << _ROWID_BITS) + rowid.clip(0, (1 << _ROWID_BITS) - 1)


class SqliteReading(MessageReading):
    """A pass over the files for numbers of some topics.

    Args:
        recording: The recording.
        wanted: The numbers of each topic; counts what was read and what failed.
        progress: Given the messages done and the messages to do; None for nobody.

    Raises:
        BagError: A path does not lead to a number.
    """

    def __init__(
        self, recording: SqliteRecording, wanted: Sequence[TopicNumbers], progress: Progress | None
    ) -> None:
        super().__init__(wanted)
        self._recording, self._progress = recording, progress
        self._readers = []
        for topic in wanted:
            kind, text = recording.topics[topic.topic].type, recording.definition(topic.topic)
            reader = topic.reader(Schema(id=1, data=text.encode(), encoding='ros2msg', name=kind))
            if isinstance(reader, BagError):
                raise reader
            self._readers.append(reader)

    def _read_stretches(self) -> Iterator[Columns]:
        """Yield log times [ns], topics, stamps [ns], shape (n,), and values, shape (k, n).

        A topic is its index among the wanted ones; rows that it has no number for are NaN. Reports progress.

        Raises:
            BagError: A file cannot be read.
        """
        topics = [item.topic for item in self._wanted]
        total, done = sum(self._recording.topics[topic].count for topic in topics), 0
        for times, topic, messages in self._recording.batches(topics):
            yield self._read_numbers(times, topic, messages.tolist())
            done += times.size
            if self._progress is not None:
                self._progress(done, max(total, done))

    def _read_numbers(self, times: IntArray, topic: IntArray, messages: Sequence[bytes]) -> Columns:
        """Decode messages; their faults are counted in the :class:`TopicNumbers` of the pass.

        Args:
            times: Their log times [ns], shape (n,).
            topic: The number of the topic of each, shape (n,).
            messages: The n messages.

        Returns:
            Log times and topics as given; stamps [ns], shape (n,), the log time where a message has none; and
            values, shape (k, n), as of :meth:`.FieldReader.read`, with k of the widest topic: NaN below.
        """
        size = np.fromiter(map(len, messages), np.int64, len(messages))
        offset, data = np.cumsum(size) - size, b''.join(messages)
        stamps, values = times.copy(), np.full((self._width, times.size), np.nan)
        for number, reader in enumerate(self._readers):
            rows = np.flatnonzero(topic == number)
            numbers, stamps[rows] = reader.read(data, offset[rows], size[rows], times[rows])
            values[: len(numbers), rows] = numbers
        return times, topic, stamps, values


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
