# SPDX-License-Identifier: Apache-2.0
"""Reads numbers of some columns of a table in one pass, and judges their order of time."""

from __future__ import annotations

import contextlib
import itertools
import pickle
import tempfile
import weakref
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from stickslip_logs.arrays import BoolArray, FloatArray, IntArray
from stickslip_logs.errors import BagError, cause, join_names, listed, plural, quote_for_yaml
from stickslip_logs.recordings.recording import Fault, Progress, Request, Series
from stickslip_logs.recordings.table_columns import MAX_LETTERS, ColumnRecording, LogColumn, SourceColumn
from stickslip_logs.source_admission import SourceAdmission
from stickslip_logs.tables.bus_log import SOURCE, name_of_first_source
from stickslip_logs.tables.cell_times import DAY
from stickslip_logs.tables.dialect import with_unit
from stickslip_logs.tables.row_keys import KeySteps, NumberedRows, find_end_columns, is_same_key
from stickslip_logs.tables.table_file import BLOCK, Numbers, Rows, select_cells
from stickslip_logs.time_order import Row, Sorter, TimeCourse, TimeOrder
from stickslip_logs.units import MIB, SECOND_NS, conversion

# Words in place of numbers that are counted apart.
_MAX_KINDS = 200
# More lines of one time, where times are so coarse [ns], have lost their times by rounding; a value before
# and one behind a change share theirs rightly.
_MAX_ALIKE, _COARSE_NS = 2, 10 * SECOND_NS
# Lines without a number before the first one and at the end that tell how long the log lasts.
_MAX_BLANK = 2 * BLOCK
# Rows of a sorted table that are yielded at a time at most.
_STRETCH = 65_536
# The source of all lines, whichever of the columns they fill; else it is a bit for each column, of which
# a number has so many.
_ALL_LINES, _BITS = -1, 62
# Numbers that wait in memory until the order is known (40 MB for a million lines of two) [bytes].
_MAX_KEPT_BYTES = 64 * MIB

Part = tuple[IntArray, IntArray, BoolArray, FloatArray]
"""Times [ns] and sources of n rows, and which of k topics have a number in each, shape (k, n), and these."""


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
        self._progress, self._rows = progress, 0
        self._last_ns, self._distinct = dict.fromkeys(columns, -1), Counter[str]()
        self._keys = {topic: recording.chosen_keys(source.column) for topic, source in columns.items()}
        self._key_places = list(dict.fromkeys(place for pairs in self._keys.values() for place, _ in pairs))
        self._unit_place = recording.unit_place
        # What is read as numbers tells no rows apart.
        read = {source.column.place for source in columns.values()}
        keys = (key for source in columns.values() for key in recording.find_keys(source.column))
        numbered = [place for place, is_numbered in keys if is_numbered and place not in read]
        self._numbered = NumberedRows(dict.fromkeys(numbered))
        self._steps, self._wanted = self._choose_places()
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
        self._course, self._has_whole_lines = TimeCourse(), False
        self._row_count, self._numbered_rows = 0, range(0)
        self._read_file()
        self._course = self._judge_order()
        for text in self._course.notes('the lines are', 'of the lines'):
            recording.note(text)
        if self._course.start_ns is not None:
            recording.start_ns, recording.end_ns = self._course.start_ns, self._course.end_ns

    def _choose_places(self) -> tuple[KeySteps, list[int]]:
        """Return the search for a column of keys, and the places of all columns to read, each once.

        Candidates for keys have one text in the head of the file and another in its tail.
        """
        table = self._recording.table
        ends = [] if table.is_sent else find_end_columns(table.head, table.tail, len(table.names))
        steps = KeySteps(place for place in ends if place not in self._key_places)
        statuses = [source.status[0] for source in self._columns.values() if source.status]
        places = [source.column.place for source in self._columns.values()]
        units = [] if self._unit_place is None else [self._unit_place]
        return steps, list(
            dict.fromkeys(
                [*places, *self._key_places, *statuses, *units, *steps.texts, *self._numbered.texts]
            )
        )

    def _read_file(self) -> None:
        """Read the file once and buffer its numbers; report losses, warnings and progress.

        Times of the day are counted on over midnight. Stores how many rows there are, which range of them
        begins and ends with a number, and whether any row fills all columns.

        Raises:
            BagError: A column tells rows of the same times apart, which have to be chosen by it; or the disk
                does not take the numbers.
            OSError: The file is no longer there.
        """
        recording, done, first = self._recording, 0, None
        for rows in recording.table.blocks(self._wanted, recording.lose, recording.note):
            if days := self._days.get(rows.clock.columns):
                rows.time_ns[rows.is_timed] = days.add(rows.time_ns[rows.is_timed])
            part = self._read_rows(rows)
            self._buffer.add(part)
            time_ns, _, is_there, _ = part
            at = np.flatnonzero(is_there.any(axis=0))
            if at.size:
                if self._steps.texts or self._numbered.texts:
                    self._search_keys(rows, part, at)
                self._has_whole_lines |= bool(is_there.all(axis=0).any())
                first = self._row_count + int(at[0]) if first is None else first
                self._numbered_rows = range(first, self._row_count + int(at[-1]) + 1)
            self._row_count += time_ns.size
            done += rows.time_ns.size
            if self._progress is not None:
                self._progress(done, max(done, recording.table.line_count))
        self._refuse_several_things()

    def _judge_order(self) -> TimeCourse:
        """Judge the order of time of the rows with numbers, and of those near the ends of the file."""
        order, numbered = TimeOrder(), self._numbered_rows
        for place, (time_ns, source, is_there, _) in self._numbered_parts() if numbered else ():
            is_before = (place >= numbered.start - _MAX_BLANK) & (place < numbered.start)
            is_behind = (place >= numbered.stop) & (place >= self._row_count - _MAX_BLANK)
            counts = is_there.any(axis=0) | is_before | is_behind
            if counts.any():
                order.add(time_ns[counts], source[counts], place[counts])
        course = order.judge(read_rows=self._read_lines)
        # Lines with a time for each signal are in no order but that of each.
        course.is_unordered &= course.wait_ns is None or len(self._recording.table.clocks) == 1
        if self._days and numbered:
            course.move(-DAY * min(days.first_day for days in self._days.values()))
        return course

    def _numbered_parts(self) -> Iterator[tuple[IntArray, Part]]:
        """Yield the buffered parts in the order of the file, each behind the numbers of its rows.

        If any row fills all columns, all rows with numbers are of one source.
        """
        row = 0
        for time_ns, source, is_there, values in self._buffer:
            source = np.minimum(source, _ALL_LINES) if self._has_whole_lines else source
            yield np.arange(row, row + time_ns.size), (time_ns, source, is_there, values)
            row += time_ns.size

    def _sources_of(self, rows: Rows, is_there: BoolArray) -> IntArray:
        """Return the source of each of n rows with a time, shape (n,).

        Its bits are the columns with a number in the row; beyond 62 columns two share one. Without a number
        it is 0, or where lines are chosen by columns -2, -3, ... for each text there, as of another signal.

        Args:
            rows: A block of rows.
            is_there: Whether each topic has a number in those with a time, shape (k, n).
        """
        source = np.zeros(is_there.shape[1], np.int64)
        for k, is_filled in enumerate(is_there):
            source |= is_filled.astype(np.int64) << k % _BITS
        if self._key_places and not self._recording.is_sent:
            blank = np.flatnonzero(source == 0)
            if self._numbered_rows:  # those between numbers tell nothing
                blank = blank[blank > np.flatnonzero(source).max(initial=-1)]
            columns = [rows.texts(place) for place in self._key_places]
            for k, row in zip(blank.tolist(), np.flatnonzero(rows.is_timed)[blank].tolist(), strict=True):
                texts = tuple(cells[row] for cells in columns)
                source[k] = self._signals.setdefault(texts, _ALL_LINES - 1 - len(self._signals))
        return source

    def _read_lines(self, begin: int, end: int, span_ns: tuple[int, int]) -> Iterator[Row]:
        """Yield buffered lines from row ``begin`` to before ``end`` with a time in a span [ns], ends as well.

        Rows without a time are not numbered. All are of one source, -1, as the order of whole lines is
        judged; the content of a line is the bytes of its numbers.
        """
        for place, (time_ns, _, _, values) in self._numbered_parts():
            is_within = (place >= begin) & (place < end) & (time_ns >= span_ns[0]) & (time_ns <= span_ns[1])
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
        time_ns, _, is_there, values = part
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
        """Yield the series of one stretch of time after the other, then empty ones; restart the counts.

        At the end, times that were rounded are reported as a loss.
        """
        self._recording.counts = Counter(dict.fromkeys(self._columns, 0))
        sorter = Sorter(self._course.wait_ns)
        corrected = (
            (self._course.correct_times(time_ns, source, place), is_there, values)
            for place, (time_ns, source, is_there, values) in self._numbered_parts()
        )
        parts = itertools.chain.from_iterable(map(sorter.add, corrected))
        for time_ns, is_there, values in itertools.chain(parts, sorter.rest()):
            for begin in range(0, time_ns.size, _STRETCH):
                rows = slice(begin, begin + _STRETCH)
                yield self._make_series(time_ns[rows], is_there[:, rows], values[:, rows])
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

    def _read_rows(self, rows: Rows) -> Part:
        """Read the numbers of all topics from a block of rows; count words that stand in their place.

        Numbers are as the sensor sends them, NaN for a word. Rows without a time are dropped, and numbers of
        unused senders. Numbers in other units are converted, those of bad quality become NaN.
        """
        units = [''] * rows.time_ns.size if self._unit_place is None else rows.texts(self._unit_place)
        time_ns = rows.time_ns[rows.is_timed]
        is_there = np.zeros((len(self._columns), time_ns.size), np.bool_)
        values = np.full(is_there.shape, np.nan)
        number = np.cumsum(rows.is_timed) - 1
        for k, (topic, source) in enumerate(self._columns.items()):
            column, status, is_of_bus = source.column, source.status, topic in self._admissions
            if not rows.clock.has_column(column.place):
                continue
            chosen = rows.select(self._keys[topic], self._is_of_number if is_of_bus else is_same_key)
            chosen &= rows.is_timed
            numbers = self._recording.table.numbers(select_cells(rows.columns[column.place], chosen))
            is_number = np.isfinite(numbers.value)
            if column.name is not None and self._unit_place is not None:
                self._convert_units(numbers, select_cells(units, chosen), column)
            if status is not None:
                self._drop_bad_quality(numbers, select_cells(rows.texts(status[0]), chosen), status[1])
            used = numbers.is_there
            if is_of_bus:
                used &= self._are_admitted(topic, rows, np.flatnonzero(chosen), numbers.value, is_number)
            self._count_words(topic, [word for at, word in numbers.words.items() if used[at]])
            row = number[chosen][used]
            is_there[k, row] = True
            values[k, row] = source.convert_numbers(numbers.value[used])
        return time_ns, self._sources_of(rows, is_there), is_there, values

    def _are_admitted(
        self, topic: str, rows: Rows, where: IntArray, values: FloatArray, is_number: BoolArray
    ) -> BoolArray:
        """Return which numbers of a topic are of the sender that is used at their time, shape (n,).

        The admission of the topic advances with each number, and notes who is left out or used instead. As in
        live operation, a number in a unit of another quantity counts for no sender.

        Args:
            topic: The topic.
            rows: The rows of a block.
            where: Which of them have its numbers, of whatever sender, shape (n,).
            values: The numbers in its unit; NaN for a word, and in a unit of another quantity, shape (n,).
            is_number: Which were sent as numbers, shape (n,).
        """
        admits, valid = self._admissions[topic].admits, np.isfinite(values)
        sources, seconds = rows.columns[SOURCE], (rows.time_ns[where] * 1e-9).tolist()
        is_offered = (valid | ~is_number).tolist()
        offers = zip(where.tolist(), is_offered, seconds, valid.tolist(), strict=True)
        return np.array([ok and admits(sources[k], now, valid=good) for k, ok, now, good in offers], np.bool_)

    def _is_of_number(self, name: str, text: str) -> bool:
        """Return whether a name on a bus is that of a number, or the same number's of another sender."""
        return is_same_key(name, text) or (name not in self._names and name_of_first_source(name) == text)

    def _convert_units(self, numbers: Numbers, units: Sequence[str], column: LogColumn) -> None:
        """Convert numbers in other units to that of the column; set those in no such unit to NaN; note both.

        The latter are counted among the words. Nothing is done, unless they were sent over a bus, for lines
        without a unit.

        Args:
            numbers: Numbers of a name in a long table; changed.
            units: The unit in the line of each.
            column: The column of the name.
        """
        name = column.name or ''
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
                word = f'in {text.strip()[:17] or "no unit"}'
                numbers.words |= dict.fromkeys(np.flatnonzero(rows).tolist(), word)
            else:
                numbers.value[rows] *= ratio
            remark = f"'{column.heading}' changes its unit: lines in {text.strip() or 'no unit'} are "
            remark += 'left out' if ratio is None else f'converted to {column.unit}'
            self._recording.note(remark)

    @staticmethod
    def _drop_bad_quality(numbers: Numbers, marks: Sequence[str], is_bad: Callable[[str], bool]) -> None:
        """Set numbers with a bad quality mark to NaN, with the word 'quality MARK' in place of each.

        A mark beside an empty cell is ignored; of a long one the first 20 letters are shown.

        Args:
            numbers: The numbers; changed.
            marks: The mark of each.
            is_bad: Returns whether a number with a mark does not count.
        """
        bad = {mark: f'quality {mark.strip()[:MAX_LETTERS]}' for mark in {*marks} if is_bad(mark)}
        if bad:
            words = {k: bad[mark] for k, mark in enumerate(marks) if mark in bad and numbers.is_there[k]}
            numbers.value[[*words]] = np.nan
            numbers.words |= words

    def _count_words(self, topic: str, words: Sequence[str]) -> None:
        """Add to the words of a topic; of more than 200 kinds the rest are counted as 'others'."""
        counted = self._words[topic]
        for word, count in Counter(words).items():
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
