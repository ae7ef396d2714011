# SPDX-License-Identifier: Apache-2.0
"""A recording of ROS 2: one file, or the files of a rosbag2 folder in order.

The blocks of a recording are read in the order in which they begin, and the messages before the
beginning of the next block are sorted and yielded. So memory holds only the blocks that overlap in
time: as a rule two. Only an unordered recording, whose blocks all span much of it, takes memory in
proportion to its length.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from mcap.records import Channel

from stickslip_logs.arrays import FloatArray, IntArray
from stickslip_logs.errors import BagError, plural
from stickslip_logs.recordings.bag_file import BagFile, FilePass
from stickslip_logs.recordings.block_order import BlockTimes, CourseOfBlocks, select_blocks
from stickslip_logs.recordings.log_time_scale import ask_for_time_unit
from stickslip_logs.recordings.mcap_chunks import Block, Piece
from stickslip_logs.recordings.message_fields import FieldReader, TopicNumbers
from stickslip_logs.recordings.recording import (
    Fault,
    Findings,
    Message,
    Progress,
    Recording,
    Request,
    Scratch,
    Series,
    TimeSpans,
    TopicInfo,
)
from stickslip_logs.time_order import DATES_FROM_NS, Columns, select_rows

# Messages of each topic, and of all, that are yielded at a time: a check takes 3 % less than with 2^13, as
# calls take as long as their work; with 2^15 check --mcap takes more memory than it may.
_MAX_OF_TOPIC, _MAX_OF_ALL = 16_384, 524_288

# Memory of a number that waits for its turn [bytes].
_ROW_BYTES = 24
_UNTIMED = 'have log time 0 (clock not set?) or an impossible one and were not used'
_REFUSED = 'follow a contradicting definition and were not used'

Chosen = list[tuple[int, Channel, IntArray]]
"""The number of a topic, one of its channels, and which messages of a piece."""


@dataclass(slots=True, eq=False)
class Job:
    """A block to read, its number, the pass over its file, and its first and last time [ns]."""

    number: int
    block: Block
    file_pass: FilePass
    start_ns: int
    end_ns: int


MakeColumns = Callable[[Job, Piece, Chosen], Columns]
"""Makes the columns of the chosen messages of a piece of a block."""


class BagPass:
    """A pass over the blocks of a recording that have messages of some topics.

    Args:
        files: The recording.
        course: The course of its times.
        topics: The topics, which are numbered in this order.
        progress: Given the bytes done and the bytes to do after each block; None for nobody.
        spans: The log times wanted; all when None.
    """

    def __init__(
        self,
        files: Sequence[BagFile],
        course: CourseOfBlocks,
        topics: Iterable[str],
        progress: Progress | None = None,
        spans: TimeSpans | None = None,
    ) -> None:
        self._progress, self._course = progress, course
        self.numbers = {topic: number for number, topic in enumerate(topics)}
        self._file_passes = [FilePass(file, self.numbers) for file in files]
        blocks_of_files = (blocks for _, blocks in select_blocks(files, self.numbers))
        jobs = (
            # A block declares its times where none of the topics has one in it.
            Job(k, block, file_pass, *course.spans.get(k, (block.start_ns, block.end_ns)))
            for file_pass, blocks in zip(self._file_passes, blocks_of_files, strict=True)
            for k, block in blocks
        )
        self._jobs = sorted(
            (job for job in jobs if spans is None or spans.overlap(job.start_ns, job.end_ns)),
            key=operator.attrgetter('start_ns', 'number'),
        )

    def read_sorted(self, columns_of: MakeColumns, min_count: int, max_count: int) -> Iterator[Columns]:
        """Yield the columns of all wanted messages in the order of time, then of place, some at a time.

        Reports progress after each block, and losses; a file whose pass is over is not read on. Use it once.

        Args:
            columns_of: Makes the columns of the chosen messages of a piece; log times [ns] come first,
                then numbers of blocks.
            min_count: How many messages are collected before some are yielded.
            max_count: How many messages are yielded at a time at most.

        Raises:
            BagError: A file cannot be read.
        """
        waiting: list[Columns] = []
        size, limit, yielded_ns = 0, min_count, -1
        total, done = sum(job.block.length for job in self._jobs), 0
        for k, job in enumerate(self._jobs):
            if job.file_pass.is_over:
                continue
            block_columns = list(self._read_block(job, columns_of, yielded_ns))
            waiting += block_columns
            size += sum(columns[0].size for columns in block_columns)
            done += job.block.length
            if self._progress is not None:
                self._progress(done, total)
            if not waiting or size < limit or k + 1 == len(self._jobs):
                continue
            yielded_ns = self._jobs[k + 1].start_ns
            columns = _sort_columns(waiting)
            cut = int(columns[0].searchsorted(yielded_ns))
            yield from _split_columns(select_rows(columns, slice(cut)), max_count)
            size = columns[0].size - cut
            waiting = [select_rows(columns, slice(cut, None))] if size else []
            limit = min_count + 2 * size
        if waiting:
            yield from _split_columns(_sort_columns(waiting), max_count)

    def _read_block(self, job: Job, columns_of: MakeColumns, yielded_ns: int) -> Iterator[Columns]:
        """Yield the columns of the wanted messages of a block, piece by piece, unsorted; report what is lost.

        The log times of each piece are replaced by corrected ones. Nothing is yielded from a piece on by
        which the pass over the file is over. Messages before ``yielded_ns`` [ns], up to which all were
        yielded, are lost: their block declares a later beginning.

        Raises:
            BagError: The file cannot be read.
        """
        file, late = job.file_pass.file, 0
        for piece, groups in job.file_pass.read_groups(job.block):
            chosen: Chosen = []
            for key, rows in groups:
                channel = file.channels.get(key)
                if channel is None and file.is_stated:
                    file.findings.lose(
                        f'{job.block.place} has messages of channel {key}, which is defined nowhere: not read'
                    )
                elif channel is not None and channel.topic in self.numbers and rows.size:
                    chosen.append((self.numbers[channel.topic], channel, rows))
            if not chosen:
                continue
            piece.log_time_ns = self._course.correct_times(job.number, file, piece)
            columns = columns_of(job, piece, chosen)
            if job.file_pass.is_over:
                break
            is_late = columns[0] < yielded_ns
            late += int(np.count_nonzero(is_late))
            yield select_rows(columns, ~is_late) if is_late.any() else columns
        if late:
            file.findings.lose(
                f'{job.block.place} has {plural(late, "message")} from before it begins, as it'
                ' says: they were not used'
            )

    def compare_counts(self) -> None:
        """Report as losses where summaries state other counts than were read; call it when all was read."""
        for file_pass in self._file_passes:
            if file_pass.file.is_stated:
                channels = file_pass.file.channels.items()
                keys = [key for key, channel in channels if channel.topic in self.numbers]
                file_pass.file.compare_counts(file_pass.file.counts, file_pass.counts, keys)


def _sort_columns(parts: Sequence[Columns]) -> Columns:
    """Return parts of columns, at least one, joined and sorted by time (first column), then by block."""
    columns = parts[0]
    if len(parts) > 1:
        columns = tuple(np.concatenate(column, axis=-1) for column in zip(*parts, strict=True))
    time, number = columns[:2]
    if (time[1:] >= time[:-1]).all() and (number[1:] >= number[:-1]).all():
        return columns
    return select_rows(columns, np.lexsort((number, time)))


def _split_columns(columns: Columns, max_count: int) -> Iterator[Columns]:
    """Yield sorted messages, times [ns] first, up to ``max_count`` at a time; nothing without messages.

    Messages of one time are split only if they are more than that.
    """
    while columns[0].size > max_count:
        times = columns[0][:max_count]
        end = int(times.searchsorted(times[-1])) or max_count
        yield select_rows(columns, slice(end))
        columns = select_rows(columns, slice(end, None))
    if columns[0].size:
        yield columns


class BagReading:
    """A pass over files for numbers of some topics; making it judges the order of their times.

    That adds warnings to the recording, and corrects its start and end where they were wrong.

    Args:
        recording: The recording.
        wanted: The numbers of each topic; counts what was read and what failed.
        progress: Given the bytes done and the bytes to do after each block; None for nobody.

    Raises:
        BagError: Of a topic no definition has a number at a path, or a file cannot be read.
        OSError: A file cannot be opened.
    """

    def __init__(
        self, recording: BagRecording, wanted: Sequence[TopicNumbers], progress: Progress | None
    ) -> None:
        self._wanted, self._sequence, self._least = wanted, 0, recording.least_ns
        self._width = max((topic.width for topic in wanted), default=0)
        topics = [topic.topic for topic in wanted]
        self._pass = BagPass(recording.contents, recording.judge_order(topics), topics, progress)
        for topic in wanted:
            channels = [
                self._make_reader(topic, file, channel)
                for file in recording.contents
                for channel in list(file.channels.values())
                if channel.topic == topic.topic
            ]
            # What does not fit beside what does is not read.
            errors = [reader for reader in channels if isinstance(reader, BagError)]
            if errors and len(errors) == len(channels):
                raise errors[0]

    def __iter__(self) -> Iterator[dict[Request, Series]]:
        """Yield the series, without faults, of one stretch of time after the other, at least one.

        Reports losses. Use it once.

        Raises:
            BagError: A file cannot be read.
        """
        max_count = min(_MAX_OF_TOPIC * len(self._wanted), _MAX_OF_ALL)
        is_empty = True
        for time, _, *arrays in self._pass.read_sorted(self._make_columns, max_count, max_count):
            is_empty = False
            yield self._make_series(time, *arrays)
        self._pass.compare_counts()
        if is_empty:
            none = np.empty(0, np.int64)
            yield self._make_series(none, none, none, np.empty((self._width, 0)))

    def _make_series(
        self, log_time_ns: IntArray, topic: IntArray, stamp_ns: IntArray, values: FloatArray
    ) -> dict[Request, Series]:
        """Return the series of a sorted stretch by request, and move the sequence numbers on by its length.

        The columns are those of :meth:`_make_columns` without the blocks, in the order of time.
        """
        result: dict[Request, Series] = {}
        is_unstamped = np.array_equal(log_time_ns, stamp_ns)
        for number, topic_numbers in enumerate(self._wanted):
            rows = np.flatnonzero(topic == number)
            times_ns = log_time_ns[rows]
            times = times_ns, times_ns if is_unstamped else stamp_ns[rows], rows + self._sequence
            result.update(topic_numbers.series(times, values[: topic_numbers.width].take(rows, axis=1)))
        self._sequence += log_time_ns.size
        return result

    def faults(self) -> dict[Request, tuple[Fault, ...]]:
        """Return the faults of the messages read so far, by request; an empty tuple where there are none."""
        return dict(pair for topic in self._wanted for pair in topic.faults())

    def _make_reader(self, wanted: TopicNumbers, file: BagFile, channel: Channel) -> FieldReader | BagError:
        """Return the reader of messages of a channel; the error, not raised, where they cannot be read."""
        schema, problem = file.schemas.get(channel.schema_id), file.find_problem(channel)
        if schema is None or problem:
            return BagError(f"topic '{channel.topic}' cannot be read: {problem}")
        return wanted.reader(schema)

    def _make_columns(self, job: Job, piece: Piece, chosen: Chosen) -> Columns:
        """Return log times [ns], blocks, topics, stamps [ns], shape (n,), and values, shape (k, n).

        A topic is its index among the wanted ones, a block its number in the recording.
        Messages without a valid time, or of another definition, are left out and counted as faults; those of
        another definition are reported as lost too. The memory of the numbers is charged to the pass.
        """
        times = stamp = piece.log_time_ns
        topic, block = np.full(times.size, -1, np.int32), np.broadcast_to(np.int32(job.number), times.shape)
        values = np.full((self._width, times.size), np.nan)
        for number, channel, rows in chosen:
            wanted, own_times = self._wanted[number], times[rows]
            if own_times.min() < self._least:
                wanted.reasons[_UNTIMED] += int((own_times < self._least).sum())
            reader = self._make_reader(wanted, job.file_pass.file, channel)
            if isinstance(reader, BagError):
                job.file_pass.file.findings.lose(
                    f'{job.block.place} has messages of another definition: {reader}'
                )
                wanted.count += rows.size
                wanted.reasons[_REFUSED] += rows.size
                continue
            numbers, stamps = reader.read(piece.data, piece.offset[rows], piece.size[rows], own_times)
            job.file_pass.charge(job.block, _ROW_BYTES * rows.size)
            topic[rows] = number
            for column, row in zip(values, numbers, strict=False):
                column[rows] = row
            if stamps is not own_times:
                stamp = stamp.copy() if stamp is times else stamp
                stamp[rows] = stamps
        is_wanted = (topic >= 0) & (times >= self._least)
        columns = times, block, topic, stamp, values
        return columns if is_wanted.all() else select_rows(columns, is_wanted)


class BagRecording(Recording):
    """The files of a recording of ROS 2, of MCAP or SQLite.

    Attributes:
        contents: What the files hold.
        least_ns: The least valid log time [ns]: 0, or 1 beside dates, where 0 is that of a clock not set.

    Args:
        path: The file or folder by which it is named.
        files: What each file holds, in order.
        findings: Takes the warnings; a doubt about the unit of its times is noted at once.
        scratch: The temporary folder of unpacked files, kept for as long as the recording.
    """

    def __init__(self, path: Path, files: Sequence[BagFile], findings: Findings, scratch: Scratch) -> None:
        self.path, self._scratch = path, scratch
        self._topics = _list_topics(files)
        self.contents, self._findings = tuple(files), findings
        self.files = tuple(file.path for file in files)
        self._message_count = sum(file.counts.total() for file in files)
        self.cuts = tuple(file.cut for file in files if file.cut is not None)
        self.least_ns = int(any((file.end_ns or 0) >= DATES_FROM_NS for file in files))
        starts = [file.start_ns for file in files if file.start_ns is not None]
        if self.least_ns == 0 and any(file.has_zero for file in files):
            starts.append(0)
        ends = [file.end_ns for file in files if file.end_ns is not None]
        self.start_ns = min(starts, default=None)
        self.end_ns = max(ends, default=self.start_ns)
        max_count = max((topic.count for topic in self.topics.values()), default=0)
        if question := ask_for_time_unit(self.start_ns, self.end_ns, max_count):
            findings.note(question)
        self._times = BlockTimes(files, self.least_ns)

    def judge_order(self, topics: Sequence[str]) -> CourseOfBlocks:
        """Read the times of some topics, and return their course.

        Adds its notes to the warnings, and sets start and end of the recording where it corrects them.

        Raises:
            BagError: A file cannot be read; also OSError, where it cannot be opened.
        """
        blocks = self._times.judge_order(topics)
        for text in blocks.course.notes('the messages are', 'of the recorder'):
            self._findings.note(text)
        if blocks.is_corrected:
            self.start_ns, self.end_ns = blocks.course.start_ns, blocks.course.end_ns
        return blocks

    def definition(self, topic: str) -> str:
        """Return the ``ros2msg`` text of the first definition of a topic's messages.

        Raises:
            BagError: The topic is not there or cannot be decoded.
        """
        self._require_readable(topic)
        definitions = (
            file.schemas[channel.schema_id].data
            for file in self.contents
            for channel in file.channels.values()
            if channel.topic == topic
        )
        return next(definitions).decode(errors='replace')

    def reading(self, requests: Iterable[Request], progress: Progress | None = None) -> BagReading:
        """Return a pass that reads numbers of some topics; errors as for :meth:`Recording.reading`.

        The order of time is judged at once, which can add warnings and correct start and end.
        """
        wanted = [TopicNumbers(topic, paths) for topic, paths in self._group_requests(requests).items()]
        return BagReading(self, wanted, progress)

    def messages(
        self, topics: Collection[str] | None = None, spans: TimeSpans | None = None
    ) -> Iterator[Message]:
        """Return messages as :meth:`.Recording.messages` does; judge the order of time, and raise, at once.

        Blocks are read while iterating; one is in memory while its time lasts. Invalid times go unreported.
        """
        names = [
            (name, self._require_topic(name).type) for name in (self.topics if topics is None else topics)
        ]
        wanted = spans or TimeSpans([(self.least_ns, (1 << 63) - 1)])

        def encoded(job: Job, piece: Piece, chosen: Chosen) -> Columns:
            """Return log times [ns], block and topic numbers and data of the chosen messages in the spans."""
            topic = np.full(piece.log_time_ns.size, -1)
            for number, _, rows in chosen:
                topic[rows] = number
            rows = np.flatnonzero((topic >= 0) & wanted.holds(piece.log_time_ns))
            begin, end = piece.offset[rows], piece.offset[rows] + piece.size[rows]
            data = np.empty(rows.size, np.object_)
            data[:] = [piece.data[a:b] for a, b in zip(begin.tolist(), end.tolist(), strict=True)]
            return piece.log_time_ns[rows], np.full(rows.size, job.number), topic[rows], data

        topics = [name for name, _ in names]
        file_pass = BagPass(self.contents, self.judge_order(topics), topics, spans=spans)
        return (
            Message(names[topic][0], names[topic][1], time, data)
            for columns in file_pass.read_sorted(encoded, 1, _MAX_OF_ALL)
            for time, _, topic, data in zip(*(column.tolist() for column in columns), strict=True)
        )


def _list_topics(files: Iterable[BagFile]) -> dict[str, TopicInfo]:
    """Return the topics of all files, sorted by name.

    Channels of one name are one topic, which has a problem where one of them has, or their types differ. The
    type of a channel without a known schema is empty.
    """
    channels: dict[str, list[TopicInfo]] = {}
    for file in files:
        for key, channel in file.channels.items():
            schema, problem = file.schemas.get(channel.schema_id), file.find_problem(channel)
            kind = '' if schema is None else schema.name
            info = TopicInfo(channel.topic, kind, file.counts[key], channel.message_encoding, problem)
            channels.setdefault(channel.topic, []).append(info)
    topics = {}
    for name, infos in sorted(channels.items()):
        types = list(dict.fromkeys(info.type for info in infos))
        problems = [info.problem for info in infos if info.problem]
        problems += [f'it has several types: {", ".join(types)}'] if len(types) > 1 else []
        count = sum(info.count for info in infos)
        topics[name] = replace(infos[0], count=count, problem=problems[0] if problems else '')
    return topics
