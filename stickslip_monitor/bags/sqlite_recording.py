# SPDX-License-Identifier: Apache-2.0
"""A recording that rosbag2 stored by SQLite, its default up to ROS 2 Humble.

Files come in the order of their metadata; messages in the order in which they were written.
Nothing is written to a file: one with a journal is read as a copy.
"""

from __future__ import annotations

import contextlib
import shutil
import sqlite3
import sys
import tempfile
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import zstandard
from mcap.records import Schema
from numpy.typing import NDArray

from stickslip_monitor.bags.log_times import LATEST_NS, STEP_NS, StepClock
from stickslip_monitor.bags.message_fields import FieldReader, MessageReading, TopicNumbers, definition_of
from stickslip_monitor.bags.recording import (
    Findings,
    Message,
    Progress,
    Recording,
    Request,
    TimeSpans,
    TopicInfo,
    other_encoding,
)
from stickslip_monitor.errors import BagError, plural

MAGIC = b'SQLite format 3\0'
# Messages that are read together, and the largest one that is unpacked [bytes].
_BATCH, _MOST_MESSAGE = 1 << 15, 128 << 20
# Of a page whose damage makes it ask for more memory than there is, the latter.
_ERRORS = sqlite3.Error, MemoryError
# Messages by so much later may come first: they are put in order [ns].
_DISORDER_NS = 10**9
# Behind a damaged page reading goes on: the first step over it, in messages, and how many of them.
_SKIP, _MOST_SKIPS = 64, 40
# Of each topic of a recorder whose clock is set, or of what is played in a loop, so many step back,
# or two. In the order newest first those of a slow topic all do.
_SELDOM = 0.25


class _Row(NamedTuple):
    """One message."""

    time_ns: int
    topic: str
    data: bytes


class SqliteRecording(Recording):
    """The files of a recording in SQLite.

    Args:
        path: The file or folder.
        files: The files in order.
        is_packed: Whether each message is compressed.
        findings: Takes what is wrong.
        kept: A folder for what is unpacked, as long as the recording lives.
    """

    def __init__(
        self,
        path: Path,
        files: Sequence[Path],
        is_packed: bool,
        findings: Findings,
        kept: tempfile.TemporaryDirectory[str],
    ) -> None:
        self.path, self.files = path, tuple(files)
        self._is_packed, self._findings = is_packed, findings
        self._texts: dict[str, str] = {}
        self._counts: Counter[str] = Counter()
        self._types: dict[str, tuple[str, str]] = {}
        self._kept = kept
        self._unsorted: set[Path] = set()
        times = [time for file in files for time in self._look(file)]
        self.start_ns = min(times, default=None)
        self.end_ns = max(times, default=None)
        self._topics = {name: self._info(name, *self._types[name]) for name in sorted(self._types)}
        self._message_count = self._counts.total()

    def _info(self, name: str, kind: str, encoding: str) -> TopicInfo:
        text = self._texts.get(kind) or definition_of(kind)
        problem = ''
        if encoding != 'cdr':
            problem = other_encoding('message', encoding, 'cdr')
        elif text is None:
            problem = (
                f'the recording has no definition of {kind}: source the setup file of a ROS 2 that has it'
            )
        else:
            self._texts[kind] = text
        return TopicInfo(name, kind, self._counts[name], encoding, problem)

    @contextlib.contextmanager
    def _opened(self, file: Path) -> Iterator[sqlite3.Connection]:
        """A connection that changes nothing.

        Raises:
            BagError: The file cannot be read.
        """
        try:
            uri = f'{self._whole(file).absolute().as_uri()}?mode=ro&immutable=1'
            with contextlib.closing(sqlite3.connect(uri, uri=True)) as database:
                if sys.version_info >= (3, 11):
                    # What a damaged length asks for is not taken.
                    database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, _MOST_MESSAGE)
                database.text_factory = lambda raw: raw.decode('utf-8', 'replace')
                yield database
        except (*_ERRORS, OSError, ValueError) as error:
            raise BagError(f"bag file '{file}' cannot be read: {error}") from None

    def _whole(self, file: Path) -> Path:
        """The file, or its copy with what a crash has left in its journal."""
        ends = [file.with_name(f'{file.name}{end}') for end in ('-wal', '-journal')]
        if not any(end.is_file() and end.stat().st_size for end in ends):
            return file
        copy = Path(self._kept.name) / file.name
        if not copy.exists():
            for each in (file, *filter(Path.is_file, ends)):
                shutil.copyfile(each, copy.with_name(each.name))
            with contextlib.closing(sqlite3.connect(copy)) as database:
                database.execute('SELECT count(*) FROM sqlite_master').fetchall()
                with contextlib.suppress(sqlite3.Error):
                    database.execute('PRAGMA journal_mode=DELETE').fetchall()
            self._findings.note(
                f"file '{file.name}' has a journal that its recorder left: read as a copy with it"
            )
        return copy

    def _look(self, file: Path) -> list[int]:
        """Take the topics, definitions and counts of a file; its first and last time [ns]."""
        with self._opened(file) as database:
            names: dict[int, str] = {}
            for key, *row in database.execute('SELECT id, name, type, serialization_format FROM topics'):
                name, kind, encoding = map(str, row)
                if isinstance(key, int):
                    names[key] = name
                known = self._types.setdefault(name, (kind, encoding))
                if known != (kind, encoding):
                    self._findings.lose(f"topic '{name}' has several types: {known[0]}, {kind}")
            # Not before ROS 2 Iron.
            with contextlib.suppress(*_ERRORS):
                for kind, encoding, text in database.execute(
                    'SELECT topic_type, encoding, encoded_message_definition FROM message_definitions'
                ):
                    if encoding == 'ros2msg' and text and isinstance(text, str):
                        self._texts.setdefault(kind, text)
            counts, times = self._count(file, database)
            if self._is_unsorted(database, counts):
                self._unsorted.add(file)
                self._findings.note(f"file '{file.name}' is written in no order of time: sorted by time")
            for key, count in counts.items():
                if key in names:
                    self._counts[names[key]] += count
                else:
                    self._findings.lose(
                        f"file '{file.name}': {plural(count, 'message')} of topic {key}, which is"
                        ' defined nowhere, were not read'
                    )
        return times

    def _count(self, file: Path, database: sqlite3.Connection) -> tuple[Counter[int], list[int]]:
        """Messages by the id of their topic, and first and last time [ns]."""
        try:
            counts = Counter(
                dict(
                    database.execute('SELECT topic_id, count(*) FROM messages NOT INDEXED GROUP BY topic_id')
                )
            )
            ends = database.execute(
                'SELECT min(timestamp), max(timestamp) FROM messages NOT INDEXED'
                f' WHERE timestamp BETWEEN 0 AND {LATEST_NS}'
            ).fetchone()
            return counts, [time for time in ends if isinstance(time, int)]
        except _ERRORS:
            counts, times = Counter(), []
            for rows in self._rows(file, database, 'timestamp, topic_id'):
                counts.update(row[2] for row in rows)
                known = [row[1] for row in rows if _is_time(row[1])]
                times += [min(known), max(known)] if known else []
            return counts, [min(times), max(times)] if times else []

    @staticmethod
    def _is_unsorted(database: sqlite3.Connection, counts: Counter[int]) -> bool:
        """Whether messages are in no order of time: topic by topic, or newest first.

        Where the clock of a recorder was set, all topics step back, and seldom.
        """
        back = (
            'SELECT topic_id, count(*) FROM (SELECT topic_id, timestamp - max(timestamp) OVER'
            ' ({} ORDER BY rowid ROWS UNBOUNDED PRECEDING) AS step FROM messages NOT INDEXED'
            f' WHERE timestamp BETWEEN 1 AND {LATEST_NS}) WHERE step < {-STEP_NS}'
            ' GROUP BY topic_id'
        )
        try:
            if database.execute(back.format('')).fetchone() is None:
                return False
            each = back.format('PARTITION BY topic_id').replace('max(timestamp)', 'lag(timestamp, 1, 0)')
            steps = dict(database.execute(each))
            return not steps or any(n > max(2, _SELDOM * counts[topic]) for topic, n in steps.items())
        except _ERRORS:
            return False

    def _by_time(
        self, file: Path, database: sqlite3.Connection, where: str
    ) -> Iterator[list[tuple[Any, ...]]]:
        """Rows as of :meth:`_rows`, in the order of time."""
        try:
            found = database.execute(
                f'SELECT rowid, timestamp, topic_id, data FROM messages WHERE {where}'
                ' ORDER BY timestamp, rowid'
            )
            while batch := list(islice(found, _BATCH)):
                yield batch
        except _ERRORS as error:
            self._findings.lose(f"file '{file.name}' is damaged ({error}): not read from there on")

    def _rows(
        self, file: Path, database: sqlite3.Connection, columns: str, where: str = '1'
    ) -> Iterator[list[tuple[Any, ...]]]:
        """Some columns behind the id in batches, in the order of writing; damaged pages are told.

        The ids are looked for behind a damaged page in growing steps.
        """
        begin, step, skips = -(1 << 63), _SKIP, 0
        while begin < 1 << 63:
            batch: list[tuple[Any, ...]] = []
            try:
                found = database.execute(
                    f'SELECT rowid, {columns} FROM messages NOT INDEXED'
                    f' WHERE rowid >= ? AND {where} ORDER BY rowid',
                    (begin,),
                )
                while True:
                    # What comes before an error stays in the batch.
                    batch.extend(islice(found, _BATCH))
                    if not batch:
                        return
                    begin, step = batch[-1][0] + 1, _SKIP
                    yield batch
                    batch = []
            except _ERRORS as error:
                skips += 1
                if batch:
                    begin, step = batch[-1][0] + 1, _SKIP
                    yield batch
                self._findings.lose(
                    f"file '{file.name}' is damaged ({str(error) or 'out of memory'}): messages of the"
                    ' damaged pages were not read'
                )
                if skips > _MOST_SKIPS:
                    return
                begin, step = max(begin, 0) + step, 2 * step

    def definition(self, topic: str) -> str:
        """The ``ros2msg`` definition of a topic's messages."""
        return self._texts[self._readable(topic).type]

    def messages(
        self, topics: Collection[str] | None = None, spans: TimeSpans | None = None
    ) -> Iterator[Message]:
        """Yield messages in the order of time."""
        names = list(self.topics if topics is None else topics)
        for name in names:
            self._topic(name)
        for batch in self.batches(names):
            for time_ns, topic, data in batch:
                if spans is None or spans.overlap(time_ns, time_ns):
                    yield Message(topic, self.topics[topic].type, time_ns, data)

    def batches(self, topics: Collection[str]) -> Iterator[list[_Row]]:
        """Messages of some topics in batches, in the order of events, with times to match."""
        clock, waiting = StepClock(0), list[_Row]()
        for batch in self._written(topics):
            times, _ = clock.follow(np.array([row.time_ns for row in batch], np.int64))
            waiting += [r._replace(time_ns=t) for r, t in zip(batch, times.tolist(), strict=True)]
            waiting.sort(key=lambda row: row.time_ns)
            edge = waiting[-1].time_ns - _DISORDER_NS
            count = sum(row.time_ns < edge for row in waiting)
            if count:
                yield waiting[:count]
                waiting = waiting[count:]
        if waiting:
            yield waiting
        if clock.steps_ns:
            self._findings.note(clock.sentence('of the recorder'))

    def _written(self, topics: Collection[str]) -> Iterator[list[_Row]]:
        """Messages in the order in which they were written."""
        unpack, odd = zstandard.ZstdDecompressor(), 0
        for file in self.files:
            with self._opened(file) as database:
                ids = {
                    key: str(name)
                    for key, name in database.execute('SELECT id, name FROM topics')
                    if isinstance(key, int) and str(name) in topics
                }
                if not ids:
                    continue
                where = f'topic_id IN ({",".join(map(str, ids))})'
                found = (
                    self._by_time(file, database, where)
                    if file in self._unsorted
                    else self._rows(file, database, 'timestamp, topic_id, data', where)
                )
                for rows in found:
                    batch = []
                    for _, time_ns, key, data in rows:
                        sound = _is_time(time_ns) and isinstance(data, bytes)
                        if sound and self._is_packed:
                            data = _unpacked(unpack, data)
                        if sound and data is not None:
                            batch.append(_Row(time_ns, ids[key], data))
                    odd += len(rows) - len(batch)
                    if batch:
                        yield batch
        if odd:
            self._findings.lose(f'{plural(odd, "message")} without time or data were not read')

    def reading(self, requests: Iterable[Request], progress: Progress | None = None) -> SqliteReading:
        """Read numbers in blocks."""
        wanted = [TopicNumbers(topic, paths) for topic, paths in self._asked(requests).items()]
        return SqliteReading(self, wanted, progress)


def _is_time(value: object) -> bool:
    return isinstance(value, int) and 0 <= value <= LATEST_NS


def _unpacked(unpack: zstandard.ZstdDecompressor, data: bytes) -> bytes | None:
    try:
        return unpack.decompress(data, max_output_size=_MOST_MESSAGE)
    except zstandard.ZstdError:
        return None


class SqliteReading(MessageReading):
    """A pass over the files for numbers of some topics.

    Raises:
        BagError: A path does not lead to a number.
    """

    def __init__(
        self, recording: SqliteRecording, wanted: Sequence[TopicNumbers], progress: Progress | None
    ) -> None:
        super().__init__(wanted)
        self._recording, self._progress = recording, progress
        self._readers: list[FieldReader] = []
        for each in wanted:
            reader = each.reader(_schema(recording, each.topic))
            if isinstance(reader, BagError):
                raise reader
            self._readers.append(reader)

    def _stretches(self) -> Iterator[tuple[NDArray[Any], ...]]:
        numbers = {each.topic: number for number, each in enumerate(self._wanted)}
        total, done = sum(self._recording.topics[topic].count for topic in numbers), 0
        for batch in self._recording.batches(numbers):
            yield self._columns(batch, numbers)
            done += len(batch)
            if self._progress is not None:
                self._progress(done, max(total, done))

    def _columns(self, batch: Sequence[_Row], numbers: Mapping[str, int]) -> tuple[NDArray[Any], ...]:
        times = np.array([row.time_ns for row in batch], np.int64)
        topic = np.array([numbers[row.topic] for row in batch], np.int64)
        size = np.array([len(row.data) for row in batch], np.int64)
        offset, data = np.cumsum(size) - size, b''.join(row.data for row in batch)
        stamps, values = times.copy(), np.full((self._width, times.size), np.nan)
        for number, reader in enumerate(self._readers):
            rows = np.flatnonzero(topic == number)
            found, stamps[rows] = reader.read(data, offset[rows], size[rows], times[rows])
            values[: len(found), rows] = found
        return times, topic, stamps, values


def _schema(recording: SqliteRecording, topic: str) -> Schema:
    text = recording.definition(topic).encode()
    return Schema(id=1, data=text, encoding='ros2msg', name=recording.topics[topic].type)
