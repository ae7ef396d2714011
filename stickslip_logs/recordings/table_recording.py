# SPDX-License-Identifier: Apache-2.0
"""Presents a table of numbers with times as a recording.

A column stands for the topic of an input: what the sensor would have sent is computed from the
unit of the column. What the file does not say is guessed, and reported.
"""

from __future__ import annotations

import contextlib
import itertools
import pickle
import re
import tempfile
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from stickslip_logs.arrays import BoolArray, FloatArray, IntArray
from stickslip_logs.errors import BagError, did_you_mean, plural
from stickslip_logs.recordings.columns import FLOAT64, LogColumn, SourceColumn
from stickslip_logs.recordings.recording import (
    MOST_NAMED,
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
    missing_topic,
)
from stickslip_logs.recordings.writer import encode_float64s
from stickslip_logs.senders import SourceAdmission
from stickslip_logs.tables.bus_log import SOURCE, first_name
from stickslip_logs.tables.cell_times import Cells
from stickslip_logs.tables.dialect import parse_heading, parse_number, with_unit
from stickslip_logs.tables.quality import find_quality, find_quality_columns, is_quality_of
from stickslip_logs.tables.row_keys import KeySteps, find_end_columns, find_key_column, is_same_key
from stickslip_logs.tables.table_file import Numbers, Rows, open_table, some_cells, texts_of
from stickslip_logs.tables.time_columns import Clock, counted_from
from stickslip_logs.time_order import Sorter, TimeCourse, TimeOrder
from stickslip_logs.units import conversion

_NAME = re.compile(
    r'(?:tag|var)? ?name|tag|field|pid|variable|signal|point|channel|parameter|series|metric|topic'
    r'|(?:sensor|parameter|entity) ?id'
)
_NINES = re.compile(r'-?(?=.*9.*9)9+(?:[.,]9+)?(?:[.,]?0*)')
_VALUE = re.compile(r'(?:var|tag)? ?(?:value|val)|wert|payload')
_UNIT = re.compile(r'units?(?: ?abbreviation)?|einheit|uom|eng(?:ineering)? ?units?')
# Words in place of numbers that a message lists, that are counted apart, and letters shown of one.
_MAX_WORDS, _MAX_KINDS, _MAX_LETTERS = 6, 200, 20
# More lines of one time, where times are so coarse [ns], have lost their times by rounding; a value before
# and one behind a change share theirs rightly.
_MAX_ALIKE, _COARSE_NS = 2, 10 * 10**9
# Of 1973: later times are dates, and no time since a trigger [ns].
_DATES_FROM_NS = 10**17
# Numbers for each time, from which on most share theirs.
_SHARED_TIMES = 1.5
# Blocks of lines without a number that are kept: the last one is whole, and one wrong time is no end.
_MAX_BLANK_BLOCKS = 2
# Rows of a sorted table that are yielded at a time at most.
_STRETCH = 1 << 16
# The source of all lines, whichever of the columns they fill; else it is a bit for each column, of which
# a number has so many.
_ALL_LINES, _BITS = -1, 62
# Numbers that wait in memory until the order is known (40 MB for a million lines of two) [bytes].
_MAX_KEPT_BYTES = 64 << 20


Part = tuple[IntArray, BoolArray, FloatArray]
"""Times of n rows [ns], whether each of k topics has a number in each, shape (k, n), and these, likewise."""


class TableRecording(Recording):
    """A table as the recording that it stands for.

    Its topics are its columns, or the names in a table of one value a line, until it is told which of them
    to deliver as which topics.
    """

    def __init__(self, path: Path) -> None:
        self.path, self.files = path, (path,)
        self.table = open_table(path)
        self._ends: Sequence[Cells] = [*self.table.head, *self.table.tail]
        self._findings = Findings()
        for text in self.table.remarks:
            self._findings.note(text)
        for text in self.table.losses:
            self._findings.lose(text)
        self._shift_to_zero()
        self.names = self._long_columns()
        """The columns of names and of values of a table of one value a line, else None."""
        order = TimeOrder()
        for number, clock in enumerate(self.table.clocks):
            timed_rows, times = _drop_untimed(self._ends, clock)
            if times.size:
                order.add(times, np.full(times.size, number), np.arange(times.size))
        self._may_lack_names = self._may_miss_names(timed_rows)
        course = order.course()
        self.is_unordered = course.is_unordered
        self.all_columns: tuple[LogColumn, ...] = tuple(self._list_columns())
        """The columns of numbers."""
        self.by_topic: dict[str, SourceColumn] = {}
        """What stands for the topics that are delivered."""
        self.counts: Counter[str] = Counter()
        """Numbers that were read, by topic."""
        self.start_ns, self.end_ns = course.start_ns, course.end_ns

    def _shift_to_zero(self) -> None:
        """Set the clocks of the table to count from the first time in head and tail, where that is negative.

        Such times begin before a trigger, or before 1970, which is noted. Where any time is a date after
        1973, the clocks count from 1970. Either way earlier times become none.
        """
        times = np.concatenate([_drop_untimed(self._ends, clock)[1] for clock in self.table.clocks])
        zero_ns = 0
        if times.size and times.min() < 0 and times.max() < _DATES_FROM_NS:
            # A trigger's time before, and what spreadsheets make of a time of day.
            zero_ns = int(times.min())
            self._findings.note('times begin before 1970, or before zero: counted from the first one')
        self.table.clocks = tuple(counted_from(clock, zero_ns) for clock in self.table.clocks)

    def _may_miss_names(self, rows: Sequence[Cells]) -> bool:
        """Return whether head and tail of a long table may lack names; False for another table.

        They may where each name has its lines one after the other: the head has one name, or the tail others.

        Args:
            rows: Rows of head and tail.
        """
        if self.names is None:
            return False
        name = self.names[0]
        names = {row[name] for row in rows if name < len(row)}
        head = {row[name] for row in self.table.head if name < len(row)}
        return len(head) < 2 or not head >= names - {''}

    def _long_columns(self) -> tuple[int, int] | None:
        """Return the places of the names and the values in a table of one value a line; None for others."""
        plain = [parse_heading(name).name for name in self.table.names]
        name = [k for k, text in enumerate(plain) if _NAME.fullmatch(text)]
        value = [k for k, text in enumerate(plain) if _VALUE.fullmatch(text)]
        if self.table.names == tuple(f'#{k + 1}' for k in range(len(plain))):
            name, value = self._guess_columns()
        elif {'entity id', 'state'} <= set(plain):
            # As the historian of a home calls them; elsewhere a state is no value.
            value = [plain.index('state')]
        return (name[0], value[0]) if name and len(value) == 1 else None

    def _guess_columns(self) -> tuple[list[int], list[int]]:
        """Guess, in a table without headings, which columns are names and which are numbers, by the head.

        Returns:
            The places of columns of texts that are about equally frequent, and of columns with a number.
        """
        rows, words, numbers = self.table.head, list[int](), list[int]()
        for k in set(range(len(self.table.names))) - set(self.table.time_columns):
            cells = Counter(str(row[k]) for row in rows if k < len(row))
            if any(parse_number(cell) is not None for cell in cells):
                numbers.append(k)
            elif len(cells) > 1 and 10 * min(cells.values()) >= max(cells.values()) > 1:
                words.append(k)
        return words, numbers

    def _list_columns(self) -> Iterator[LogColumn]:
        """Yield each column but those of times; of a long table each name, with the unit of most lines.

        A long table is read as a whole where head and tail may lack names.
        """
        table = self.table
        if self.names is None:
            for k, heading in enumerate(table.names):
                if k not in table.time_columns:
                    yield LogColumn(heading, k, unit=table.units[k])
            return
        name, value = self.names
        place = self.unit_place
        seen: dict[str, Counter[str]] = {}
        for row in self._rows_of_every_name(name):
            units = seen.setdefault(row[name], Counter())
            units[row[place] if place is not None and len(row) > place else ''] += 1
        for heading_text, units in seen.items():
            if not heading_text.strip():
                continue  # a line without a number
            # The unit of most lines: one line may be damaged.
            heading, known_unit = with_unit(heading_text, units.most_common(1)[0][0])
            yield LogColumn(
                heading,
                value,
                heading_text,
                known_unit,
                self.is_sent and bool(first := first_name(heading_text)) and first in seen,
            )

    @property
    def unit_place(self) -> int | None:
        """The column of units in a table of one value a line, if there is one."""
        names = enumerate(self.table.names) if self.names is not None else ()
        return next((k for k, text in names if _UNIT.fullmatch(parse_heading(text).name)), None)

    def _find_quality_column(self, column: int) -> int | None:
        """Return the place of the quality marks of a column of numbers; None where there is none."""
        names = self.table.names
        for k, heading in enumerate(names):
            is_beside = k == column + 1 or self.names is not None
            if k != column and is_quality_of(heading, names[column], is_beside=is_beside):
                return k if self.quality(k) is not None else None
        return None

    def quality(self, status: int) -> Callable[[str], bool] | None:
        """Return a function that is True for a mark by which a number does not count.

        None where the marks of the column, in head and tail, have no known meaning.

        Args:
            status: The place of the column of marks.
        """
        marks = {str(row[status]) for row in self._ends if len(row) > status}
        return find_quality(self.table.names[status], marks)

    def _rows_of_every_name(self, name: int) -> Iterator[Cells]:
        """Yield the rows of head and tail, then, where these may lack names, an empty row with each name.

        For the latter the file is read.

        Args:
            name: The place of the column of names.
        """
        yield from (row for row in self._ends if len(row) > name)
        if self._may_lack_names or self.is_unordered:
            blank = [''] * len(self.table.names)
            yield from ([*blank[:name], text, *blank[name + 1 :]] for text in self._read_texts(name))

    def _read_texts(self, column: int) -> list[str]:
        """Read the whole file for the texts of a column; return each once, in the order of the file."""
        blocks = self.table.blocks([column], _ignore_progress, _ignore_progress)
        return list(
            dict.fromkeys(text for rows in blocks for text in dict.fromkeys(texts_of(rows.columns[0])))
        )

    @property
    def topics(self) -> Mapping[str, TopicInfo]:
        """The topics that are delivered, or else the columns."""
        if self.by_topic:
            return {
                name: TopicInfo(name, FLOAT64, self.counts.get(name, self.table.line_count), 'cdr', '')
                for name in self.by_topic
            }
        return {
            column.heading: TopicInfo(
                column.heading,
                f'column in {column.unit}' if column.unit is not None else 'column, unit not known',
                self.table.line_count,
                'table',
                '',
                self._first_value(column),
            )
            for column in self.all_columns
        }

    def _first_value(self, column: LogColumn) -> str:
        """Return the first cell of a column in the head that is not empty, up to 20 letters; else empty."""
        rows = self._rows_of(column, self.table.head)[0]
        return str(rows[0][column.place]).strip()[:_MAX_LETTERS] if rows else ''

    @property
    def message_count(self) -> int:
        """Numbers that were read, or before that the lines."""
        return self.counts.total() or self.table.line_count

    @property
    def is_sent(self) -> bool:
        """Whether its numbers are as sensors sent them, over a bus."""
        return self.table.is_sent

    def deliver(self, columns: Mapping[str, SourceColumn]) -> None:
        """Deliver columns as topics from now on, in place of earlier ones; note which have quality marks.

        Args:
            columns: The source of each topic; its ``status`` is found here.
        """
        self.by_topic = {
            topic: replace(source, status=self._find_quality_column(source.column.place))
            for topic, source in columns.items()
        }
        named = {(source.column.heading, source.status): None for source in self.by_topic.values()}
        for heading, status in named:
            if status is not None:
                self._findings.note(
                    f"numbers of '{heading}' count where '{self.table.names[status]}' says so"
                )

    def filler(self, column: LogColumn) -> float | None:
        """Return the number that stands for "no value" in a column, in its unit; None where there is none.

        Loggers write -99 and the like where an instrument is silent. Such a number is of nines, occurs at
        least twice in head and tail, and is farther from all others than these are from each other.
        """
        cells = [str(row[column.place]).strip() for row in self._rows_of(column, self._ends)[0]]
        fillers = Counter(cell for cell in cells if _NINES.fullmatch(cell))
        for text, count in fillers.items():
            others = self.table.numbers([cell for cell in cells if cell != text]).value
            others = others[np.isfinite(others)]
            value = float(self.table.numbers([text]).value[0])
            if count > 1 and others.size > count and np.abs(others - value).min() > np.ptp(others):
                return value
        return None

    def interval(self, column: LogColumn) -> float:
        """Return the median time between cells of a column in the head [s]; 0 without two different times.

        Cells that share a time count as one.
        """
        times = self._rows_of(column, self.table.head)[1]
        steps = np.abs(np.diff(np.sort(times) if self.is_unordered else times))
        return float(np.median(steps[steps > 0])) * 1e-9 if steps.any() else 0.0

    def shares_times(self, column: LogColumn) -> bool:
        """Return whether a column has more than 1.5 cells for each time in the head: the clock is coarse."""
        times = self._rows_of(column, self.table.head)[1]
        return bool(times.size > _SHARED_TIMES * np.unique(times).size)

    def _rows_of(self, column: LogColumn, rows: Iterable[Cells]) -> tuple[list[Cells], IntArray]:
        """Return those of some rows that belong to a column, with a cell in it and a time.

        Returns:
            The rows, and their times [ns], shape (n,).
        """
        keys = self.keys_of(column)
        last_place = max([column.place, *(place for place, _ in keys)])
        column_rows = [
            row
            for row in rows
            if len(row) > last_place
            and str(row[column.place]).strip()
            and all(is_same_key(row[place], text) for place, text in keys)
        ]
        return _drop_untimed(column_rows, self.table.clock_of(column.place))

    def keys_of(self, column: LogColumn) -> tuple[tuple[int, str], ...]:
        """Return places and texts of the cells by which rows belong to a column; empty where all rows do."""
        name = () if self.names is None or column.name is None else ((self.names[0], column.name),)
        return (*name, *column.where)

    def chosen(self, column: LogColumn, where: Mapping[str, str]) -> LogColumn:
        """Return a copy of the column restricted to rows with given texts in other columns.

        The file is read where head and tail lack a text.

        Args:
            column: The column.
            where: The text by the heading, or the number as ``#3``, of each other column.

        Raises:
            BagError: A column is not there, or has no such text.
        """
        pairs = []
        for heading, text in where.items():
            plain, names = parse_heading(heading).name, list(enumerate(self.table.names))
            same = [k for k, name in names if heading in (name, f'#{k + 1}')]
            matching = same or [k for k, name in names if plain and parse_heading(name).name == plain]
            if not matching:
                near = did_you_mean(heading, self.table.names)
                raise BagError(f"log '{self.path}' has no column '{heading}' to choose rows by{near}")
            cells = [row[matching[0]].strip() for row in self._ends if len(row) > matching[0]]
            if not any(is_same_key(cell, text) for cell in set(cells)):
                cells = [cell.strip() for cell in self._read_texts(matching[0])]
            if not any(is_same_key(cell, text) for cell in set(cells)):
                raise BagError(
                    f"log '{self.path}' has no line with '{text}' in column '{heading}': it has"
                    f' {listed(cells)}{did_you_mean(text, cells)}'
                )
            pairs.append((matching[0], text))
        return replace(column, where=tuple(pairs))

    def key_of(self, column: LogColumn) -> tuple[str, list[str]] | None:
        """Return the heading of the column that tells several things apart, such as shafts, and its texts.

        Only head and tail are searched; the texts are each once, in their order. None where the rows of the
        column are of one thing, or were sent over a bus.

        Args:
            column: The column of the numbers of these things.
        """
        if self.is_sent:
            return None  # one sender is used, as live
        rows, time_ns = self._rows_of(column, self._ends)
        names, status = self.table.names, self._find_quality_column(column.place)
        taken = {column.place, *self.table.time_columns, *(place for place, _ in self.keys_of(column))}
        taken |= {*(self.names or ()), *(k for k in (self.unit_place, status) if k is not None)}
        taken |= find_quality_columns(names)
        places = [k for k in range(len(names)) if k not in taken]
        key = find_key_column(rows, time_ns, column.place, self.table.names, places)
        if key is None:
            return None
        return self.table.names[key], list(
            dict.fromkeys(row[key].strip() for row in rows if key < len(row) and row[key].strip())
        )

    def definition(self, topic: str) -> str:
        """Return the definition of a ``Float64``, which the sensors would have sent.

        Raises:
            BagError: There is no such topic or column.
        """
        self._find_column(topic)
        return 'float64 data\n'

    def _find_column(self, topic: str) -> SourceColumn:
        """Return the source of a delivered topic, or else that of the column with this heading.

        Raises:
            BagError: There is neither.
        """
        if topic in self.by_topic:
            return self.by_topic[topic]
        for column in self.all_columns:
            if column.heading == topic:
                return SourceColumn(column)
        raise BagError(missing_topic(self.topics, topic))

    def reading(self, requests: Iterable[Request], progress: Progress | None = None) -> TableReading:
        """Return a pass over the table; read the file at once to buffer numbers and judge their order.

        That adds warnings and losses, and may correct start and end. The fields of requests are ignored.

        Raises:
            BagError: A topic is not there, or a column tells rows apart that have to be chosen by it.
        """
        wanted = list(requests)
        columns = {request.topic: self._find_column(request.topic) for request in wanted}
        # Those of one line count from left to right, in whatever order they are asked for.
        columns = dict(
            sorted(columns.items(), key=lambda item: (item[1].column.place, item[1].column.heading))
        )
        return TableReading(self, wanted, columns, progress)

    def messages(
        self, topics: Collection[str] | None = None, spans: TimeSpans | None = None
    ) -> Iterator[Message]:
        """Yield what the sensors would have sent as messages, in order of time, then of column.

        Args:
            topics: Which topics; all that are delivered when None.
            spans: The times that are wanted; all when None.

        Raises:
            BagError: As for :meth:`reading`; raised at the first message.
        """
        names = list(self.by_topic if topics is None else topics)
        for part in self.reading([Request(name, 'data') for name in names]):
            rows: list[tuple[int, str, int, bytes]] = []
            for request, series in part.items():
                keep = np.full(series.value.size, True)
                if spans is not None:
                    keep = spans.holds(series.log_time_ns)
                data = encode_float64s(series.value[keep])
                numbers, times = series.sequence[keep].tolist(), series.log_time_ns[keep].tolist()
                topic = [request.topic] * len(data)
                rows += zip(numbers, topic, times, data, strict=True)
            yield from (Message(name, FLOAT64, time, data) for _, name, time, data in sorted(rows))


def _drop_untimed(rows: Iterable[Cells], clock: Clock) -> tuple[list[Cells], IntArray]:
    """Return the rows that have a valid time by a clock, and these times [ns], shape (n,)."""
    last_place = max(clock.columns)
    long = [row for row in rows if len(row) > last_place]
    if not long:
        return [], np.empty(0, np.int64)
    times, is_timed = clock.read([[row[k] for row in long] for k in clock.columns])
    return list(itertools.compress(long, is_timed.tolist())), times[is_timed]


def listed(texts: Sequence[str]) -> str:
    """Return up to ten texts in quotation marks, and how many more there are."""
    more = f' and {len(texts) - MOST_NAMED} more' if len(texts) > MOST_NAMED else ''
    return ', '.join(f"'{text}'" for text in texts[:MOST_NAMED]) + more


def _ignore_progress(text: str) -> None:
    """Drop a sentence of a reading, in place of reporting it."""
    del text


class _PartBuffer:
    """Buffer for the numbers of a table until its order is known: 64 MB in memory, the rest in a file."""

    def __init__(self, path: Path) -> None:
        self._path, self._scratch = path, Scratch()
        self._in_memory: list[Part] = []
        self._bytes = 0

    def add(self, part: Part) -> None:
        """Append a part.

        Raises:
            BagError: The temporary file cannot be written, as its disk is full.
        """
        self._bytes += sum(array.nbytes for array in part)
        if self._bytes <= _MAX_KEPT_BYTES:
            self._in_memory.append(part)
            return
        try:
            with (self._scratch.folder / 'parts').open('ab') as file:
                pickle.dump(part, file, pickle.HIGHEST_PROTOCOL)
        except OSError as error:
            raise BagError(
                f"log '{self._path}' cannot be read: {error.strerror} in the folder of temporary files"
                f" '{tempfile.gettempdir()}': free some there, or name another folder by TMPDIR"
            ) from None

    def __iter__(self) -> Iterator[Part]:
        """Yield the parts in the order in which they were added."""
        yield from self._in_memory
        if self._bytes > _MAX_KEPT_BYTES:
            with (self._scratch.folder / 'parts').open('rb') as file, contextlib.suppress(EOFError):
                while True:
                    yield pickle.load(file)


def _filled_columns(is_there: BoolArray) -> IntArray:
    """Return, for each row, a number whose bits are the topics with a number in the row, shape (n,).

    Bit k is of topic k modulo 62: later topics share a bit. 0 is a row without any.

    Args:
        is_there: Whether each topic has a number, shape (k, n).
    """
    filled = np.zeros(is_there.shape[1], np.int64)
    for k, is_filled in enumerate(is_there):
        filled |= is_filled.astype(np.int64) << k % _BITS
    return filled


class TableReading:
    """A pass over a table for numbers of some columns."""

    def __init__(
        self,
        recording: TableRecording,
        requests: Sequence[Request],
        columns: Mapping[str, SourceColumn],
        progress: Progress | None,
    ) -> None:
        self._recording, self._requests, self._columns = recording, requests, columns
        self._progress = progress
        self._rows, self._last_ns, self._distinct = 0, dict.fromkeys(columns, -1), Counter[str]()
        self._keys = {topic: recording.keys_of(source.column) for topic, source in columns.items()}
        places = [source.column.place for source in columns.values()]
        keys = [place for pairs in self._keys.values() for place, _ in pairs]
        statuses = {k for source in columns.values() if (k := source.status) is not None}
        self._unit_place = recording.unit_place
        units = set() if self._unit_place is None else {self._unit_place} - statuses
        table = recording.table
        ends = [] if table.is_sent else find_end_columns(table.head, table.tail, len(table.names))
        self._steps = KeySteps(ends)
        self._wanted = list(dict.fromkeys([*places, *keys, *statuses, *units, *self._steps.places]))
        self._converted: set[str] = set()
        self._is_bad = {k: is_bad for k in statuses if (is_bad := recording.quality(k)) is not None}
        self._words: dict[str, Counter[str]] = {topic: Counter() for topic in columns}
        self._names = {source.column.name for source in columns.values()}
        self._admissions = {
            topic: SourceAdmission(source.column.heading, source.timeout, '', recording.note)
            for topic, source in columns.items()
            if recording.is_sent and source.timeout is not None and not source.column.is_other
        }
        self._wanted += [SOURCE] if self._admissions else []
        self._buffer = _PartBuffer(recording.path)
        self._course, self._has_whole_lines = self._judge_order()
        for text in self._course.notes('the lines are', 'of the lines'):
            recording.note(text)
        if self._course.start_ns is not None:
            recording.start_ns, recording.end_ns = self._course.start_ns, self._course.end_ns

    def _judge_order(self) -> tuple[TimeCourse, bool]:
        """Read the file, buffer its numbers, and judge the order of time of lines with numbers.

        Reports losses and progress.

        Returns:
            The course, and whether any line fills all columns: then all lines are one source, else those
            that fill the same columns are.

        Raises:
            BagError: A column tells rows of the same times apart, which have to be chosen by it.
        """
        recording, row, done = self._recording, 0, 0
        order, whole, has_whole_lines, has_numbers = TimeOrder(), TimeOrder(), False, False
        every = _filled_columns(np.ones((len(self._columns), 1), np.bool_))

        def add(time_ns: IntArray, source: IntArray, place: IntArray) -> None:
            """Add lines to the order of all, and until any line fills all columns to that by source.

            Nothing is added where the arrays, of shape (n,) each, are empty.
            """
            if place.size:
                whole.add(time_ns, np.full(place.size, _ALL_LINES), place)
            if place.size and not has_whole_lines:
                order.add(time_ns, source, place)

        # Lines before the first number and behind the last one tell how long the log lasts.
        blank: list[tuple[IntArray, IntArray, IntArray]] = []
        for rows in recording.table.blocks(self._wanted, recording.lose, recording.note):
            part = self._read_rows(rows)
            self._buffer.add(part)
            time_ns, source = part[0], _filled_columns(part[1])
            place, at = np.arange(time_ns.size) + row, np.flatnonzero(source)
            begin = 0
            if at.size:
                if self._steps.places:
                    self._search_keys(rows, time_ns[at], at)
                has_whole_lines = has_whole_lines or bool((source == every).any())
                if not has_numbers:
                    for block in (*blank, (time_ns[: at[0]], source[: at[0]], place[: at[0]])):
                        add(*block)
                has_numbers = True
                add(time_ns[at], source[at], place[at])
                blank, begin = [], int(at[-1]) + 1
            blank = [*blank[1 - _MAX_BLANK_BLOCKS :], (time_ns[begin:], source[begin:], place[begin:])]
            row += time_ns.size
            done += rows.time_ns.size
            if self._progress is not None:
                self._progress(done, max(done, recording.table.line_count))
        if (key := self._steps.place) is not None:
            heading, texts = recording.table.names[key], list(self._steps.texts[key])
            raise BagError(
                f"log '{recording.path}': column '{heading}' has {listed(texts)} one after the other, at the"
                f' same times: choose one beside each input, as in where: {{{heading}: {texts[0]}}}'
            )
        for block in blank if has_numbers else ():
            add(*block)
        course = (whole if has_whole_lines else order).course()
        # Lines with a time for each signal are in no order but that of each.
        course.is_unordered &= course.wait_ns is None or len(recording.table.clocks) == 1
        return course, has_whole_lines

    def _search_keys(self, rows: Rows, time_ns: IntArray, at: IntArray) -> None:
        """Add times of rows with numbers, and their texts in candidate columns, to the search for keys.

        Args:
            rows: A block of rows.
            time_ns: The times of its rows with numbers [ns], shape (m,).
            at: The indexes of these among the rows with a time, shape (m,).
        """
        row_indexes = np.flatnonzero(rows.is_timed)[at].tolist()
        texts = {place: texts_of(rows.columns[self._wanted.index(place)]) for place in self._steps.places}
        self._steps.add(
            time_ns, {place: [cells[k].strip() for k in row_indexes] for place, cells in texts.items()}
        )

    def __iter__(self) -> Iterator[dict[Request, Series]]:
        """Yield the series of one stretch of time after the other, at least once; restart the counts.

        At the end, times that were rounded are reported as a loss.
        """
        self._recording.counts = Counter(dict.fromkeys(self._columns, 0))
        sorter, is_empty = Sorter(self._course.wait_ns), True
        parts = (sorted_part for part in self._correct_parts() for sorted_part in sorter.add(part))
        for time_ns, is_there, values in itertools.chain(parts, sorter.rest()):
            for begin in range(0, time_ns.size, _STRETCH):
                rows = slice(begin, begin + _STRETCH)
                is_empty = False
                yield self._make_series(time_ns[rows], is_there[:, rows], values[:, rows])
        if is_empty:
            none = np.empty((len(self._columns), 0))
            yield self._make_series(np.empty(0, np.int64), none.astype(np.bool_), none)
        self._report_rounded_times()

    def _report_rounded_times(self) -> None:
        """Report as a loss the first column with rounded times: more than two numbers for each time.

        Times count as rounded if they are 10 s or more apart on average.
        """
        recording = self._recording
        span_ns = (recording.end_ns or 0) - (recording.start_ns or 0)
        for topic, distinct in self._distinct.items():
            count = recording.counts[topic]
            if count > _MAX_ALIKE * distinct and span_ns >= _COARSE_NS * (distinct - 1):
                recording.lose(
                    f'{count} lines have {plural(distinct, "time")} between them: write the file with'
                    ' whole times, as a spreadsheet may have rounded them'
                )
                return

    def faults(self) -> dict[Request, tuple[Fault, ...]]:
        """Return the faults of each request: words in place of numbers; empty where there were none."""
        result: dict[Request, tuple[Fault, ...]] = {}
        for request in self._requests:
            words = self._words[request.topic]
            listed = ', '.join(f"'{word}' ({n})" for word, n in words.most_common(_MAX_WORDS))
            more = ', ...' if len(words) > _MAX_WORDS else ''
            text = f'no number: {listed}{more}'
            result[request] = (Fault(words.total(), text, is_nan=True),) if words else ()
        return result

    def _correct_parts(self) -> Iterator[Part]:
        """Yield the buffered parts with corrected times, in the order of the file."""
        row = 0
        for time_ns, is_there, values in self._buffer:
            place = np.arange(row, row + time_ns.size)
            row += time_ns.size
            source = np.full(place.size, _ALL_LINES) if self._has_whole_lines else _filled_columns(is_there)
            yield self._course.follow(time_ns, source, place), is_there, values

    def _read_rows(self, rows: Rows) -> Part:
        """Read the numbers of all topics from a block of rows; count words that stand in their place.

        Numbers are as the sensor sends them, NaN for a word. Rows without a time are dropped. Numbers in
        other units are converted, those of bad quality become NaN, and those of unused senders are dropped.
        """
        time_ns = rows.time_ns[rows.is_timed]
        is_there = np.zeros((len(self._columns), time_ns.size), np.bool_)
        values = np.full(is_there.shape, np.nan)
        number = np.cumsum(rows.is_timed) - 1
        coded: dict[int, tuple[dict[str, int], IntArray]] = {}
        for k, (topic, source) in enumerate(self._columns.items()):
            if not rows.clock.has_column(source.column.place):
                continue
            cells, where = rows.columns[self._wanted.index(source.column.place)], None
            status = source.status
            marks = [] if status is None else texts_of(rows.columns[self._wanted.index(status)])
            if self._keys[topic]:
                chosen = self._select_rows(rows, topic, coded)
                cells, where = some_cells(cells, chosen), np.flatnonzero(chosen)
                marks = some_cells(marks, chosen) if marks else marks
            if topic in self._admissions and where is not None:
                where = where[self._are_admitted(topic, cells, rows, where)]
                chosen = np.isin(np.arange(chosen.size), where)
                cells = some_cells(rows.columns[self._wanted.index(source.column.place)], chosen)
            numbers = self._recording.table.numbers(cells)
            if source.column.name is not None and self._unit_place is not None:
                texts = texts_of(rows.columns[self._wanted.index(self._unit_place)])
                self._convert_units(numbers, some_cells(texts, chosen), source.column)
            if status is not None:
                self._drop_bad_quality(numbers, marks, self._is_bad[status])
            self._count_words(topic, numbers.words)
            at = np.flatnonzero(numbers.is_there)
            row = at if where is None else where[at]
            keep = rows.is_timed[row]
            is_there[k, number[row[keep]]] = True
            values[k, number[row[keep]]] = source.sent(numbers.value[at[keep]])
        return time_ns, is_there, values

    def _are_admitted(self, topic: str, cells: Any, rows: Rows, where: IntArray) -> BoolArray:
        """Return which numbers of a topic are of the sender that is used at that time, shape (n,).

        The admissions of the topic advance with each number. As in live operation, a number in a unit of
        another quantity counts for no sender.

        Args:
            topic: The topic.
            cells: The cells of its numbers and of those of other sources.
            rows: The rows of a block.
            where: The indexes of the rows of these cells, shape (n,).
        """
        sources = rows.columns[self._wanted.index(SOURCE)]
        numbers = self._recording.table.numbers(cells)
        is_number = np.isfinite(numbers.value)
        if self._unit_place is not None:
            texts = texts_of(rows.columns[self._wanted.index(self._unit_place)])
            self._convert_units(numbers, [texts[k] for k in where], self._columns[topic].column)
        valid = np.isfinite(numbers.value)
        is_offered, seconds = (valid | ~is_number).tolist(), (rows.time_ns[where] * 1e-9).tolist()
        admits = self._admissions[topic].admits
        offers = zip(where.tolist(), is_offered, seconds, valid.tolist(), strict=True)
        return np.array(
            [counts and admits(sources[k], now, valid=good) for k, counts, now, good in offers], np.bool_
        )

    def _select_rows(
        self, rows: Rows, topic: str, coded: dict[int, tuple[dict[str, int], IntArray]]
    ) -> BoolArray:
        """Return which rows belong to a topic, shape (n,); also those of senders that may stand in.

        Args:
            rows: A block of rows.
            topic: The topic.
            coded: A cache for one block, which is filled: by place of a column, the code of each text and the
                code of each row, shape (n,).
        """
        chosen = np.ones(rows.time_ns.size, np.bool_)
        for place, text in self._keys[topic]:
            if place not in coded:
                texts = texts_of(rows.columns[self._wanted.index(place)])
                number = {text: k for k, text in enumerate(dict.fromkeys(texts))}
                coded[place] = number, np.fromiter(map(number.__getitem__, texts), np.int64, len(texts))
            number, codes = coded[place]
            same = [k for cell, k in number.items() if is_same_key(cell, text)]
            if topic in self._admissions:
                # Another sender stands in under the name that the first one has.
                other_senders = {cell: k for cell, k in number.items() if cell not in self._names}
                same += [k for cell, k in other_senders.items() if first_name(cell) == text]
            chosen &= np.isin(codes, same)
        return chosen

    def _convert_units(self, numbers: Numbers, units: Sequence[str], column: LogColumn) -> None:
        """Convert numbers in other units to that of the column; set those in no such unit to NaN; note both.

        Args:
            numbers: Numbers of a name in a long table; changed.
            units: The unit in the line of each.
            column: The column of the name.
        """
        name = column.name or ''
        if column.heading == name and column.unit is None:
            return  # its first line says no unit: what it is in is a matter of the reader
        for text in sorted({*units}):
            heading = with_unit(name, text)
            if (text.strip(' []()-') == '' and not self._recording.is_sent) or heading == (
                column.heading,
                column.unit,
            ):
                continue
            ratio = conversion(heading[1] or '', column.unit or '')
            rows = np.array([unit == text for unit in units], np.bool_) & numbers.is_there
            if ratio is None:
                numbers.value[rows] = np.nan
                numbers.words[f'in {text.strip()[:17] or "no unit"}'] += int(np.count_nonzero(rows))
            else:
                numbers.value[rows] *= ratio
            remark = f"'{column.heading}' changes its unit: lines in {text.strip() or 'no unit'} are "
            remark += 'left out' if ratio is None else f'converted to {column.unit}'
            if remark not in self._converted:
                self._converted.add(remark)
                self._recording.note(remark)

    @staticmethod
    def _drop_bad_quality(numbers: Numbers, marks: Sequence[str], is_bad: Callable[[str], bool]) -> None:
        """Set numbers with a bad quality mark to NaN, and count the marks as words.

        Args:
            numbers: The numbers; changed.
            marks: The mark of each.
            is_bad: Returns whether a number with a mark does not count.
        """
        bad = set(filter(is_bad, set(marks)))
        if bad:
            chosen = np.array([mark in bad for mark in marks], np.bool_) & numbers.is_there
            numbers.value[chosen] = np.nan
            places = np.flatnonzero(chosen).tolist()
            numbers.words.update(f'quality {marks[k].strip()[:_MAX_LETTERS]}' for k in places)

    def _count_words(self, topic: str, words: Counter[str]) -> None:
        """Add to the words of a topic; of more than 200 kinds the rest are counted as 'others'."""
        counted = self._words[topic]
        for word, count in words.items():
            counted[word if word in counted or len(counted) < _MAX_KINDS else 'others'] += count

    def _make_series(
        self, time_ns: IntArray, is_there: BoolArray, values: FloatArray
    ) -> dict[Request, Series]:
        """Return the series of a sorted part by request; add to the counts of numbers and of distinct times.

        Sequence numbers continue from the part before. The arrays are those of a :data:`Part`.
        """
        series: dict[str, Series] = {}
        for k, topic in enumerate(self._columns):
            at = np.flatnonzero(is_there[k])
            sequence = (at + self._rows) * len(self._columns) + k
            times = time_ns[at]
            series[topic] = Series(times, times, sequence, values[k, at], ())
            self._recording.counts[topic] += at.size
            self._distinct[topic] += int(np.count_nonzero(np.diff(times, prepend=self._last_ns[topic])))
            self._last_ns[topic] = int(times[-1]) if at.size else self._last_ns[topic]
        self._rows += time_ns.size
        return {request: series[request.topic] for request in self._requests}
