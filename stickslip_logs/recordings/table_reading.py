# SPDX-License-Identifier: Apache-2.0
"""Reads numbers of some columns of a table in one pass, and judges their order of time."""

from __future__ import annotations

import contextlib
import itertools
import pickle
import tempfile
import weakref
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from stickslip_logs.arrays import BoolArray, FloatArray, IntArray
from stickslip_logs.errors import BagError, cause, join_names, listed, plural, quote_for_yaml
from stickslip_logs.recordings.recording import Fault, Progress, Request, Series
from stickslip_logs.recordings.table_columns import MAX_LETTERS, ColumnRecording, LogColumn, SourceColumn
from stickslip_logs.source_admission import SourceAdmission
from stickslip_logs.tables.bus_log import SOURCE, name_of_first_source
from stickslip_logs.tables.cell_times import DAY
from stickslip_logs.tables.dialect import is_line_damaged, with_unit
from stickslip_logs.tables.row_keys import KeySteps, NumberedRows, find_end_columns, is_same_key
from stickslip_logs.tables.table_file import Numbers, Rows, select_cells, unused_lines
from stickslip_logs.time_order import Row, Sorter, TimeCourse, TimeOrder
from stickslip_logs.units import MIB, SECOND_NS, conversion

# Words in place of numbers that are counted apart.
_MAX_KINDS = 200
# More lines of one time, where times are so coarse [ns], have lost their times by rounding; a value before
# and one behind a change share theirs rightly.
_MAX_ALIKE, _COARSE_NS = 2, 10 * SECOND_NS
# Blocks of lines without a number that are kept: the last one is whole, and one wrong time is no end.
_MAX_BLANK_BLOCKS = 2
# Rows of a sorted table that are yielded at a time at most.
_STRETCH = 65_536
# The source of all lines, whichever of the columns they fill; else it is a bit for each column, of which
# a number has so many.
_ALL_LINES, _BITS = -1, 62
# Numbers that wait in memory until the order is known (40 MB for a million lines of two) [bytes].
_MAX_KEPT_BYTES = 64 * MIB

Part = tuple[IntArray, BoolArray, FloatArray]
"""Times of n rows [ns], whether each of k topics has a number in each, shape (k, n), and these, likewise."""


class _PartBuffer:
    """Buffer for the numbers of a table until its order is known: 64 MB in memory, the rest in a file."""

    def __init__(self, path: Path) -> None:
        self._path, self._file = path, tempfile.SpooledTemporaryFile(_MAX_KEPT_BYTES)  # noqa: SIM115
        weakref.finalize(self, self._file.close)

    def add(self, part: Part) -> None:
        """Append a part, before any is read.

        Raises:
            BagError: The temporary file cannot be written, as its disk is full.
        """
        try:
            pickle.dump(part, self._file, pickle.HIGHEST_PROTOCOL)
        except OSError as error:
            raise BagError(
                f"log '{self._path}' cannot be read: {cause(error)} in the folder of temporary files"
                f" '{tempfile.gettempdir()}': free some there, or name another folder by TMPDIR"
            ) from None

    def __iter__(self) -> Iterator[Part]:
        """Yield the parts in the order in which they were added; one iterator at a time."""
        self._file.seek(0)
        with contextlib.suppress(EOFError):
            while True:
                yield pickle.load(self._file)


def _filled_columns(is_there: BoolArray, bits: Sequence[int]) -> IntArray:
    """Return, for each row, a number whose bits are the columns with a number in the row, shape (n,).

    0 is a row without any.

    Args:
        is_there: Whether each topic has a number, shape (k, n).
        bits: The bit of the column of each topic.
    """
    filled = np.zeros(is_there.shape[1], np.int64)
    for bit, is_filled in zip(bits, is_there, strict=True):
        filled |= is_filled.astype(np.int64) << bit
    return filled


class TableReading:
    """A pass over a table for numbers of some columns.

    Making it reads the file, buffers its numbers and judges their order: it adds to the warnings and losses
    of the recording and may correct its start and end.

    Args:
        recording: The table.
        requests: What is wanted; the fields are ignored.
        columns: The column of each topic of them, from left to right.
        progress: Given the rows done and the rows to do; None for nobody.

    Raises:
        BagError: A column tells rows of the same times apart, which have to be chosen by it; or the disk does
            not take the numbers.
        OSError: The file is no longer there.
    """

    def __init__(
        self,
        recording: ColumnRecording,
        requests: Sequence[Request],
        columns: Mapping[str, SourceColumn],
        progress: Progress | None,
    ) -> None:
        self._recording, self._requests, self._columns = recording, requests, columns
        self._progress, self._rows, self._damaged = progress, 0, 0
        self._last_ns, self._distinct = dict.fromkeys(columns, -1), Counter[str]()
        self._keys = {topic: recording.chosen_keys(source.column) for topic, source in columns.items()}
        # One column may be several topics; beyond 62 columns two share a bit.
        places_of = {column: k for k, column in enumerate({s.column: None for s in columns.values()})}
        self._bits = [places_of[source.column] % _BITS for source in columns.values()]
        statuses = {k for source in columns.values() if (k := source.status) is not None}
        self._is_bad = {k: is_bad for k in statuses if (is_bad := recording.bad_mark_test(k)) is not None}
        self._unit_place = recording.unit_place
        self._name_place = None if recording.names is None or recording.is_sent else recording.names[0]
        keys = (key for source in columns.values() for key in recording.find_keys(source.column))
        self._numbered = NumberedRows(dict.fromkeys(place for place, is_numbered in keys if is_numbered))
        self._steps, self._wanted = self._choose_places(statuses)
        self._converted: set[str] = set()
        self._signals: dict[tuple[str, ...], int] = {}
        self._words: dict[str, Counter[str]] = {topic: Counter() for topic in columns}
        self._names = {source.column.name for source in columns.values()}
        self._admissions = {
            topic: SourceAdmission(item.column.heading, item.timeout, item.column.sender, recording.note)
            for topic, item in columns.items()
            if recording.is_sent and item.timeout is not None and not item.column.is_other
        }
        self._wanted += [SOURCE] if self._admissions else []
        self._days = {
            clock.columns: recording.day_counter(clock) for clock in recording.table.clocks if clock.is_of_day
        }
        self._buffer = _PartBuffer(recording.path)
        self._course, self._has_whole_lines = self._judge_order()
        for text in self._course.notes('the lines are', 'of the lines'):
            recording.note(text)
        if self._course.start_ns is not None:
            recording.start_ns, recording.end_ns = self._course.start_ns, self._course.end_ns

    def _choose_places(self, statuses: Collection[int]) -> tuple[KeySteps, list[int]]:
        """Return the search for a column of keys, and the places of all columns to read, each once.

        Candidates for keys have one text in the head of the file and another in its tail.
        """
        table = self._recording.table
        keys = [place for pairs in self._keys.values() for place, _ in pairs]
        ends = [] if table.is_sent else find_end_columns(table.head, table.tail, len(table.names))
        steps = KeySteps(place for place in ends if place not in keys)
        places = [source.column.place for source in self._columns.values()]
        of_line = [place for place in (self._name_place, self._unit_place) if place is not None]
        return steps, list(
            dict.fromkeys([*places, *keys, *statuses, *of_line, *steps.texts, *self._numbered.texts])
        )

    def _judge_order(self) -> tuple[TimeCourse, bool]:
        """Read the file, buffer its numbers, and judge the order of time of lines with numbers.

        Times of the day are counted on over midnight. Reports losses, warnings and progress.

        Returns:
            The course, and whether any line fills all columns: then all lines are one source, else those
            that fill the same columns are.

        Raises:
            BagError: A column tells rows of the same times apart, which have to be chosen by it; or the disk
                does not take the numbers.
            OSError: The file is no longer there.
        """
        recording, row, done = self._recording, 0, 0
        order, whole, has_whole_lines, has_numbers = TimeOrder(), TimeOrder(), False, False
        every = _filled_columns(np.ones((len(self._columns), 1), np.bool_), self._bits)

        def add(time_ns: IntArray, source: IntArray, place: IntArray) -> None:
            """Add lines to the order of all, and until any line fills all columns to that by source.

            Nothing is added where the arrays, of shape (n,) each, are empty.
            """
            if place.size:
                whole.add(time_ns, np.minimum(source, _ALL_LINES), place)
            if place.size and not has_whole_lines:
                order.add(time_ns, source, place)

        # Lines before the first number and behind the last one tell how long the log lasts.
        blank: list[tuple[IntArray, IntArray, IntArray]] = []
        for rows in recording.table.blocks(self._wanted, recording.lose, recording.note):
            if days := self._days.get(rows.clock.columns):
                rows.time_ns[rows.is_timed] = days.add(rows.time_ns[rows.is_timed])
            part = self._read_rows(rows)
            self._buffer.add(part)
            time_ns, source = part[0], _filled_columns(part[1], self._bits)
            place, at = np.arange(time_ns.size) + row, np.flatnonzero(source)
            begin = 0
            if at.size:
                if self._steps.texts or self._numbered.texts:
                    self._search_keys(rows, part, at)
                has_whole_lines = has_whole_lines or bool((source == every).any())
                if not has_numbers:
                    head = slice(0, int(at[0]))
                    for block in (*blank, (time_ns[head], self._other_signals(rows, head), place[head])):
                        add(*block)
                has_numbers = True
                add(time_ns[at], source[at], place[at])
                blank, begin = [], int(at[-1]) + 1
            rest = slice(begin, time_ns.size)
            blank = [
                *blank[1 - _MAX_BLANK_BLOCKS :],
                (time_ns[rest], self._other_signals(rows, rest), place[rest]),
            ]
            row += time_ns.size
            done += rows.time_ns.size
            if self._progress is not None:
                self._progress(done, max(done, recording.table.line_count))
        if self._damaged:
            recording.lose(unused_lines(self._damaged, 'of another table, or with a number for a unit'))
        self._refuse_several_things()
        for block in blank if has_numbers else ():
            add(*block)
        order = whole if has_whole_lines else order
        course = order.judge(read_rows=self._read_lines)
        # Lines with a time for each signal are in no order but that of each.
        course.is_unordered &= course.wait_ns is None or len(recording.table.clocks) == 1
        if self._days and has_numbers:
            course.move(-DAY * min(days.first_day for days in self._days.values()))
        return course, has_whole_lines

    def _other_signals(self, rows: Rows, part: slice) -> IntArray:
        """Return the source of each of n lines without a wanted number, shape (n,).

        It is 0 for lines of a signal that is wanted, and in a log of a bus; else -2, -3, ...: one for each
        text of the columns by which lines are chosen, as the name of another signal.

        Args:
            rows: A block of rows.
            part: Which of its rows with a time are these lines.
        """
        at = np.flatnonzero(rows.is_timed)[part].tolist()
        places = list(dict.fromkeys(place for pairs in self._keys.values() for place, _ in pairs))
        if not places or self._recording.is_sent:
            return np.zeros(len(at), np.int64)
        columns = [rows.texts(place) for place in places]
        lines = list(zip(*([column[k] for k in at] for column in columns), strict=True))
        for texts in dict.fromkeys(lines):
            if texts not in self._signals:
                text_of = dict(zip(places, texts, strict=True))
                is_chosen = any(
                    all(is_same_key(text_of[place], text) for place, text in pairs)
                    for pairs in self._keys.values()
                )
                self._signals[texts] = 0 if is_chosen else _ALL_LINES - 1 - len(self._signals)
        return np.fromiter(map(self._signals.__getitem__, lines), np.int64, len(lines))

    def _read_lines(self, begin: int, end: int, span_ns: tuple[int, int]) -> Iterator[Row]:
        """Yield buffered lines from row ``begin`` to before ``end`` with a time in a span [ns], ends as well.

        Rows without a time are not numbered. All are of one source, -1, as the order of whole lines is
        judged; the content of a line is the bytes of its numbers.
        """
        row = 0
        for time_ns, _, values in self._buffer:
            places = np.arange(row, row + time_ns.size)
            row += time_ns.size
            is_within = (places >= begin) & (places < end) & (time_ns >= span_ns[0]) & (time_ns <= span_ns[1])
            for k in np.flatnonzero(is_within).tolist():
                yield _ALL_LINES, int(time_ns[k]), values[:, k].tobytes()

    def _search_keys(self, rows: Rows, part: Part, at: IntArray) -> None:
        """Add rows with numbers, and their texts in candidate columns, to the search for keys.

        Args:
            rows: A block of rows.
            part: Its numbers.
            at: The indexes of the rows with numbers among those with a time, shape (m,).
        """
        row_indexes = np.flatnonzero(rows.is_timed)[at].tolist()
        texts = {}
        for place in {*self._steps.texts, *self._numbered.texts}:
            cells = rows.texts(place)
            texts[place] = [cells[k].strip() for k in row_indexes]
        time_ns, is_there, values = part
        self._steps.add(time_ns[at], texts)
        self._numbered.add(time_ns[at], texts, [*np.where(is_there, values, np.nan)[:, at]])

    def _refuse_several_things(self) -> None:
        """Raise an error if rows of the same times are of several things, as a column tells.

        Raises:
            BagError: They are, and rows have to be chosen by that column; the text says how.
        """
        for search, how in (
            (self._steps, 'one after the other, at the same times'),
            (self._numbered, 'beside values that are far apart'),
        ):
            if (place := search.place) is not None:
                name, texts = self._recording.table.names[place], list(search.texts[place])
                raise BagError(
                    f"log '{self._recording.path}': column '{name}' has {listed(texts)} {how}: choose one"
                    f' beside each input, as in where: {{{quote_for_yaml(name)}: {quote_for_yaml(texts[0])}}}'
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
                    f'{count} lines share {plural(distinct, "time")}: write the file with'
                    ' whole times, as a spreadsheet may have rounded them'
                )
                return

    def faults(self) -> dict[Request, tuple[Fault, ...]]:
        """Return the faults of each request: words in place of numbers; empty where there were none."""
        result: dict[Request, tuple[Fault, ...]] = {}
        for request in self._requests:
            words = self._words[request.topic]
            counts = join_names([f"'{word}' ({n})" for word, n in words.most_common()])
            text = f'no number: {counts}'
            result[request] = (Fault(words.total(), text, is_nan=True),) if words else ()
        return result

    def _correct_parts(self) -> Iterator[Part]:
        """Yield the buffered parts with corrected times, in the order of the file."""
        row = 0
        for time_ns, is_there, values in self._buffer:
            place = np.arange(row, row + time_ns.size)
            row += time_ns.size
            source = _filled_columns(is_there, self._bits)
            source = np.full_like(source, _ALL_LINES) if self._has_whole_lines else source
            yield self._course.correct_times(time_ns, source, place), is_there, values

    def _read_rows(self, rows: Rows) -> Part:
        """Read the numbers of all topics from a block of rows; count words that stand in their place.

        Numbers are as the sensor sends them, NaN for a word. Rows without a time are dropped, and rows of
        another table or with a number for a unit, which are counted: ``rows.is_timed`` is changed. Numbers in
        other units are converted, those of bad quality become NaN, and those of unused senders are dropped.
        """
        units = [''] * rows.time_ns.size if self._unit_place is None else rows.texts(self._unit_place)
        if self._name_place is not None:
            lines = [*zip(rows.texts(self._name_place), units, strict=True)]
            if damaged := {line for line in {*lines} if is_line_damaged(*line)}:
                is_damaged = np.fromiter(map(damaged.__contains__, lines), np.bool_, len(lines))
                self._damaged += int((is_damaged & rows.is_timed).sum())
                rows.is_timed &= ~is_damaged
        time_ns = rows.time_ns[rows.is_timed]
        is_there = np.zeros((len(self._columns), time_ns.size), np.bool_)
        values = np.full(is_there.shape, np.nan)
        number = np.cumsum(rows.is_timed) - 1
        for k, (topic, source) in enumerate(self._columns.items()):
            column, status, where = source.column, source.status, None
            if not rows.clock.has_column(column.place):
                continue
            cells, marks = rows.columns[column.place], [] if status is None else rows.texts(status)
            if self._keys[topic]:
                is_sent = topic in self._admissions
                chosen = rows.select(self._keys[topic], self._is_of_number if is_sent else is_same_key)
                chosen = self._admitted_rows(topic, rows, chosen) if is_sent else chosen
                cells, where = select_cells(cells, chosen), np.flatnonzero(chosen)
                marks = select_cells(marks, chosen) if marks else marks
            numbers = self._recording.table.numbers(cells)
            if column.name is not None and self._unit_place is not None:
                self._convert_units(numbers, select_cells(units, chosen), column)
            if status is not None:
                self._drop_bad_quality(numbers, marks, self._is_bad[status])
            self._count_words(topic, numbers.words)
            at = np.flatnonzero(numbers.is_there)
            row = at if where is None else where[at]
            keep = rows.is_timed[row]
            is_there[k, number[row[keep]]] = True
            values[k, number[row[keep]]] = source.convert_numbers(numbers.value[at[keep]])
        return time_ns, is_there, values

    def _admitted_rows(self, topic: str, rows: Rows, chosen: BoolArray) -> BoolArray:
        """Return which rows are of the sender of a topic that is used at that time, with or without a number.

        The admission of the topic advances with each number, and notes who is left out or used instead. As in
        live operation, a number in a unit of another quantity counts for no sender; nor does one without a
        time.

        Args:
            topic: The topic.
            rows: The rows of a block.
            chosen: Which of them have its numbers, of whatever sender, shape (n,).
        """
        sources, column = rows.columns[SOURCE], self._columns[topic].column
        where = np.flatnonzero(chosen)
        numbers = self._recording.table.numbers(select_cells(rows.columns[column.place], chosen))
        is_number = np.isfinite(numbers.value)
        if self._unit_place is not None:
            self._convert_units(numbers, select_cells(rows.texts(self._unit_place), chosen), column)
        valid = np.isfinite(numbers.value)
        is_offered = (rows.is_timed[where] & (valid | ~is_number)).tolist()
        seconds = (rows.time_ns[where] * 1e-9).tolist()
        admits = self._admissions[topic].admits
        offers = zip(where.tolist(), is_offered, seconds, valid.tolist(), strict=True)
        admitted = [k for k, counts, now, good in offers if counts and admits(sources[k], now, valid=good)]
        return np.isin(np.arange(chosen.size), admitted)

    def _is_of_number(self, name: str, text: str) -> bool:
        """Return whether a name on a bus is that of a number, or the same number's of another sender."""
        return is_same_key(name, text) or (name not in self._names and name_of_first_source(name) == text)

    def _convert_units(self, numbers: Numbers, units: Sequence[str], column: LogColumn) -> None:
        """Convert numbers in other units to that of the column; set those in no such unit to NaN; note both.

        The latter are counted among the words. Nothing is done for a column without a unit, nor, unless they
        were sent over a bus, for lines without one.

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
        """Set numbers with a bad quality mark to NaN, and count the mark of each as a word 'quality MARK'.

        A mark beside an empty cell is not counted; of a long one the first 20 letters are.

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
            numbers.words.update(f'quality {marks[k].strip()[:MAX_LETTERS]}' for k in places)

    def _count_words(self, topic: str, words: Counter[str]) -> None:
        """Add to the words of a topic; of more than 200 kinds the rest are counted as 'others'."""
        counted = self._words[topic]
        for word, count in words.items():
            counted[word if word in counted or len(counted) < _MAX_KINDS else 'others'] += count

    def _make_series(
        self, time_ns: IntArray, is_there: BoolArray, values: FloatArray
    ) -> dict[Request, Series]:
        """Return the series of a sorted part by request; add to the counts of numbers and of distinct times.

        Sequence numbers continue from the part before. The arrays are those of a :data:`Part`: shape (n,),
        the others (k, n).
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
