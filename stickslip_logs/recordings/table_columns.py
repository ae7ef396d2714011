# SPDX-License-Identifier: Apache-2.0
"""Finds the columns of a table with times: names, units, marks of quality, and keys of the rows.

What the file does not state is guessed, and reported.
"""

from __future__ import annotations

import itertools
import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from stickslip_logs.arrays import FloatArray, IntArray
from stickslip_logs.errors import BagError, did_you_mean, listed
from stickslip_logs.recordings.recording import Findings, Recording, TopicInfo
from stickslip_logs.tables.bus_log import name_of_first_source
from stickslip_logs.tables.cell_times import DAY, Cells
from stickslip_logs.tables.dialect import is_line_damaged, is_value, parse_heading, parse_number, with_unit
from stickslip_logs.tables.quality_columns import find_bad_mark_test, find_quality_columns, is_quality_of
from stickslip_logs.tables.row_keys import MAX_WORDS, find_key_columns, is_same_key
from stickslip_logs.tables.table_file import open_table, select_cells
from stickslip_logs.tables.time_columns import Clock, DayCounter, counted_from
from stickslip_logs.time_order import DATES_FROM_NS, TimeOrder

_NAME = re.compile(
    r'(?:tag|var)? ?name|tag|field|pid|variable|signal|point|channel|parameter|series|metric|topic'
    r'|(?:sensor|parameter|entity) ?id'
)
_VALUE = re.compile(r'(?:var|tag)? ?(?:value|val)|wert|payload')
_UNIT = re.compile(r'units?(?: ?abbreviation)?|einheit|uom|eng(?:ineering)? ?units?')
FLOAT64 = 'std_msgs/msg/Float64'
MAX_LETTERS = 20
"""Letters that are shown of a cell."""


@dataclass(frozen=True, slots=True)
class LogColumn:
    """A column of a table, or the rows of a name in a table of one value a line.

    Attributes:
        heading: Its heading.
        place: The number of the column that holds its numbers.
        name: The name whose rows count; None where all do.
        unit: As the configuration calls it; None where its heading has none of these.
        is_other: Whether another sender of a bus was the first to send a number of this name.
        sender: The only sender of a bus that counts; '' for the first, and others while it is silent.
        where: The rows that count, where several things share the column: places, and their texts there.
    """

    heading: str
    place: int
    name: str | None = None
    unit: str | None = None
    is_other: bool = False
    sender: str = ''
    where: tuple[tuple[int, str], ...] = ()

    @property
    def has_unit(self) -> bool:
        """Whether its heading names a unit, known or not."""
        return self.unit is not None or bool(parse_heading(self.heading).unit)


@dataclass(frozen=True, slots=True)
class SourceColumn:
    """A column as the sensor of an input would have sent it: ``(ratio x - offset) / scale``.

    ``no_values`` are numbers that mean "no value", and have no unit. ``status`` is the place of the column
    that says whether its numbers count, and the test of a mark there that is bad, if there is one. With a
    ``timeout`` [s] of its input other senders of the same number count while the first one is silent.
    """

    column: LogColumn
    ratio: float = 1.0
    scale: float = 1.0
    offset: float = 0.0
    no_values: tuple[float, ...] = ()
    status: tuple[int, Callable[[str], bool]] | None = None
    timeout: float | None = None

    def convert_numbers(self, values: FloatArray) -> FloatArray:
        """Return numbers of the column as the sensor would have sent them; those in ``no_values`` unchanged.

        Numbers that become too large are infinite.
        """
        with np.errstate(over='ignore'):  # infinite is no value either
            sent = (values * self.ratio - self.offset) / self.scale
        return np.where(np.isin(values, self.no_values), values, sent)


class ColumnRecording(Recording):
    """A table as the recording that it stands for, without the way to its numbers.

    Its topics are its columns, or the names in a table of one value a line, until :meth:`deliver` chooses
    which of them stand for which topics. Making it reads the head and the tail of the file, and adds guesses
    and losses to its warnings; methods that read the file anew raise OSError where it is gone.

    Args:
        path: The file.

    Raises:
        BagError: It is no table, may be read in two ways, or has no times.
        OSError: It cannot be opened, or is no regular file.
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
            times = _drop_untimed(self._ends, clock)[1]
            if times.size and clock.is_of_day:
                times = self.day_counter(clock).add(times)
                times -= times.min() // DAY * DAY
            if times.size:
                order.add(times, np.full(times.size, number), np.arange(times.size))
        course = order.judge()
        self.is_unordered = course.is_unordered
        """Whether the lines of head and tail are in no order of time."""
        self.all_columns: tuple[LogColumn, ...] = tuple(self._list_columns())
        """The columns of numbers."""
        self.by_topic: dict[str, SourceColumn] = {}
        """What stands for the topics that are delivered."""
        self.counts: Counter[str] = Counter()
        """Numbers that were read, by topic."""
        self.start_ns, self.end_ns = course.start_ns, course.end_ns

    def day_counter(self, clock: Clock) -> DayCounter:
        """Return a new counter of the days of a clock of times of the day; its first row is not added yet."""
        return DayCounter(_drop_untimed(self.table.head, clock)[1])

    def _shift_to_zero(self) -> None:
        """Set the clocks of the table to count from the first time in head and tail, where that is negative.

        Such times begin before a trigger, or before 1970, which is noted. Where any time is a date after
        1973, the clocks count from 1970. Either way earlier times become none.
        """
        times = np.concatenate([_drop_untimed(self._ends, clock)[1] for clock in self.table.clocks])
        zero_ns = 0
        if times.size and times.min() < 0 and times.max() < DATES_FROM_NS:
            # A trigger's time before, and what spreadsheets make of a time of day.
            zero_ns = int(times.min())
            self._findings.note('times begin before 1970, or before zero: counted from the first one')
        self.table.clocks = tuple(counted_from(clock, zero_ns) for clock in self.table.clocks)

    def _long_columns(self) -> tuple[int, int] | None:
        """Return the places of the names (of the first such column) and of the values in a long table.

        That has one value a line. None for another table, and where several columns may be the values.
        """
        plain = [parse_heading(name).name for name in self.table.names]
        name = [k for k, text in enumerate(plain) if _NAME.fullmatch(text)]
        value = [k for k, text in enumerate(plain) if _VALUE.fullmatch(text)]
        if {'entity id', 'state'} <= set(plain):
            # As the historian of a home calls them; elsewhere a state is no value.
            value = [plain.index('state')]
        return (name[0], value[0]) if name and len(value) == 1 else None

    def _list_columns(self) -> Iterator[LogColumn]:
        """Yield each column but those of times; of a long table each name, with the unit of most lines.

        Damaged lines (:func:`.is_line_damaged`) do not count. A long table is read as a whole where head and
        tail may lack names: each has its lines one after the other, or in no order of time.
        """
        table = self.table
        if self.names is None:
            for k, heading in enumerate(table.names):
                if k not in table.time_columns:
                    yield LogColumn(heading, k, unit=table.units[k])
            return
        name, value = self.names
        place = self.unit_place
        rows = [row for row in self._ends if len(row) > name]
        lines = [(row[name], row[place] if place is not None and len(row) > place else '') for row in rows]
        head = {row[name] for row in table.head if len(row) > name}
        if self.is_unordered or len(head) < 2 or not head >= {text for text, _ in lines} - {''}:
            lines += [(text, '') for text in self._read_texts(name)]
        seen: dict[str, Counter[str]] = {}
        for text, unit in lines:
            if not is_line_damaged(text, unit):
                seen.setdefault(text.strip(), Counter())[unit] += 1
        for heading_text, units in seen.items():
            if not heading_text:
                continue  # a line without a number
            # The unit of most lines: one line may be damaged.
            heading, known_unit = with_unit(heading_text, units.most_common(1)[0][0])
            yield LogColumn(
                heading,
                value,
                heading_text,
                known_unit,
                self.is_sent and bool(first := name_of_first_source(heading_text)) and first in seen,
            )

    @property
    def unit_place(self) -> int | None:
        """The place of the column of units in a table of one value a line; None where there is none.

        A column of numbers alone, as of an engine, has no units.
        """
        for k, text in enumerate(self.table.names if self.names is not None else ()):
            numbers = [parse_number(row[k]) for row in self.table.head if k < len(row) and row[k].strip()]
            if _UNIT.fullmatch(parse_heading(text).name) and (None in numbers or not numbers):
                return k
        return None

    def _find_quality_column(self, column: int) -> int | None:
        """Return the first place of quality marks, known or not, of a column of numbers; None for none.

        A column of known marks at either end of the line, with no name beside it, is that of all numbers.
        """
        names, times = self.table.names, self.table.time_columns
        for k, heading in enumerate(names):
            is_beside = k == column + 1 or self.names is not None
            if k != column and is_quality_of(heading, names[column], is_beside=is_beside):
                return k
        places = [k for k in range(len(names)) if k not in times]
        of_all = [k for k in places if is_quality_of(names[k], '', is_beside=True)]
        is_one = len(of_all) == 1 and of_all[0] in (places[0], places[-1]) and column not in of_all
        return of_all[0] if is_one and self._bad_mark_test(of_all[0]) is not None else None

    def unknown_marks(self, column: LogColumn) -> tuple[str, list[str]] | None:
        """Return the heading of marks of unknown meaning beside a column, and these, each once.

        They are those of its quality, of a flag, or in a table of one value a line of any column of words, as
        of messages. Those of most lines come first; an empty cell is one. None where they are known, are
        chosen by ``where``, are one mark only or more than 100, or are not there. The file is read for all.
        """
        status, is_long = self._find_quality_column(column.place), self.names is not None
        places = [] if status is None or self._bad_mark_test(status) is not None else [status]
        names = [parse_heading(name).name.split() for name in self.table.names]
        words, times = names[column.place], self.table.time_columns
        if is_long:
            places += self._key_places(column)
        elif status is None and words:
            # What 'rpm fault' says of 'rpm', or a column beside it without a heading, its owner tells.
            flags = [k for k, more in enumerate(names) if more[: len(words)] == words != more]
            flags += [k for k in [column.place + 1] if self.table.names[k : k + 1] == (f'#{k + 1}',)]
            places += [k for k in flags if k not in times]
        for place, marks in self._count_marks(places, column).items():
            is_flag = all(parse_number(mark) in (None, 0.0, 1.0) for mark in marks)
            is_of_words = not all(is_value(mark) or not mark for mark in marks)
            if len(marks) > 1 and (place == status or (is_of_words if is_long else is_flag)):
                return self.table.names[place], [mark for mark, _ in marks.most_common()]
        return None

    def _count_marks(self, places: Iterable[int], column: LogColumn) -> dict[int, Counter[str]]:
        """Count, in the whole file, the texts in columns beside the cells of another that are not empty.

        Texts have no blanks around them. Places that were chosen by ``where``, and those of more than 100
        texts, are left out. Nothing is read without a place.
        """
        keys = self.chosen_keys(column)
        counts = {place: Counter[str]() for place in places if place not in dict(keys)}
        wanted = [*counts, column.place, *(place for place, _ in keys)]
        for rows in self.table.blocks(wanted, _ignore_sentence, _ignore_sentence) if counts else ():
            values, places = (
                rows.texts(column.place),
                np.flatnonzero(rows.select(keys) & rows.is_timed).tolist(),
            )
            chosen = [k for k in places if values[k].strip()]
            for place in [*counts]:
                cells = rows.texts(place)
                counts[place].update(cells[k].strip() for k in chosen)
                if len(counts[place]) > MAX_WORDS:
                    del counts[place]
            if not counts:
                break
        return counts

    def _bad_mark_test(self, status: int) -> Callable[[str], bool] | None:
        """Return a function that is True for a mark by which a number does not count.

        The marks are those of the column at the place ``status``, in head and tail. None where they have no
        known meaning; else an unknown word is such a mark, an empty one is not.
        """
        marks = {str(row[status]) for row in self._ends if len(row) > status}
        return find_bad_mark_test(self.table.names[status], marks)

    def _read_texts(self, column: int) -> list[str]:
        """Read the whole file for the texts of a column in rows with a time; return each once, in its order.

        They have their blanks; an empty cell, or a null of Parquet, is an empty text.
        """
        blocks = self.table.blocks([column], _ignore_sentence, _ignore_sentence)
        texts = (select_cells(rows.texts(column), rows.is_timed) for rows in blocks)
        return list(dict.fromkeys(itertools.chain.from_iterable(map(dict.fromkeys, texts))))

    @property
    def topics(self) -> Mapping[str, TopicInfo]:
        """The topics that are delivered, or else the columns by heading, such as of type 'column in rpm'.

        Only the latter have a value. The count is of lines until the numbers of a topic are counted.
        """
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

    def _first_value(self, column: LogColumn, sign: str = '') -> str:
        """Return the first cell of a column in the head with a sign, up to 20 letters; empty for none.

        Without a sign the first cell that is not empty is returned.
        """
        cells = (str(row[column.place]).strip() for row in self._rows_of(column, self.table.head)[0])
        return next((cell[:MAX_LETTERS] for cell in cells if sign in cell), '')

    def ambiguous_number(self, column: LogColumn) -> str:
        """Return a number of a column whose decimal sign may be one of thousands; empty without any."""
        return self._first_value(column, self.table.thousands) if self.table.thousands else ''

    @property
    def message_count(self) -> int:
        """Numbers that were read, or before that the lines."""
        return self.counts.total() or self.table.line_count

    @property
    def is_sent(self) -> bool:
        """Whether its numbers are as sensors sent them, over a bus."""
        return self.table.is_sent

    def deliver(self, columns: Mapping[str, SourceColumn]) -> None:
        """Set in ``by_topic`` which columns are delivered as topics, in place of earlier ones.

        Each source there is a copy whose ``status`` is that of its quality marks, None where it has none or
        none of known meaning. Warnings name the columns that have them.

        Args:
            columns: The source of each topic, unchanged.
        """
        self.by_topic = {}
        for topic, source in columns.items():
            place, status = self._find_quality_column(source.column.place), None
            if place is not None and (is_bad := self._bad_mark_test(place)):
                status = place, is_bad
                self.note(
                    f"numbers of '{source.column.heading}' count where '{self.table.names[place]}' says so"
                )
            self.by_topic[topic] = replace(source, status=status)

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
        return bool(times.size > 1.5 * np.unique(times).size)

    def _rows_of(self, column: LogColumn, rows: Iterable[Cells]) -> tuple[list[Cells], IntArray]:
        """Return those of some rows that belong to a column, with a cell in it and a time.

        Returns:
            The rows, and their times [ns], shape (n,).
        """
        keys = self.chosen_keys(column)
        last_place = max([column.place, *(place for place, _ in keys)])
        column_rows = [
            row
            for row in rows
            if len(row) > last_place
            and str(row[column.place]).strip()
            and all(is_same_key(row[place], text) for place, text in keys)
        ]
        return _drop_untimed(column_rows, self.table.clocks_of([column.place])[0])

    def chosen_keys(self, column: LogColumn) -> tuple[tuple[int, str], ...]:
        """Return places and texts of the cells by which rows belong to a column; empty where all rows do."""
        name = () if self.names is None or column.name is None else ((self.names[0], column.name),)
        return (*name, *column.where)

    def choose_rows(self, column: LogColumn, where: Mapping[str, str]) -> LogColumn:
        """Return a copy of the column restricted to rows with given texts in other columns.

        The file is read where head and tail lack a text.

        Args:
            column: The column.
            where: The text by the heading, be it without its unit, or the number as ``#3``, of each other
                column; of columns that are headed alike it is the first.

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

    def find_column_with(self, text: str) -> str:
        """Return the heading of the first column with a text in a cell of head or tail; empty without one."""
        cells = ((k, str(cell).strip()) for row in self._ends for k, cell in enumerate(row))
        return next((self.table.names[k] for k, cell in cells if cell == text), '')

    def find_unchosen_key(self, column: LogColumn) -> tuple[str, list[str]] | None:
        """Return the heading of the column whose words tell several things apart, such as shafts, and these.

        Only head and tail are searched; the words are each once, in their order. None where the rows of the
        column are of one thing, have numbers for these, or were sent over a bus.

        Args:
            column: The column of the numbers of these things.
        """
        key = next((place for place, is_numbered in self.find_keys(column) if not is_numbered), None)
        if key is None:
            return None
        words = [row[key].strip() for row in self._rows_of(column, self._ends)[0] if key < len(row)]
        return self.table.names[key], list(dict.fromkeys(filter(None, words)))

    def find_keys(self, column: LogColumn) -> Iterator[tuple[int, bool]]:
        """Yield as :func:`.find_key_columns`, by head and tail, what tells the things of a column apart.

        Nothing for a log of a bus: one sender is used, as live.
        """
        if not self.is_sent:
            rows, time_ns = self._rows_of(column, self._ends)
            yield from find_key_columns(rows, time_ns, self.table.names, self._key_places(column))

    def _key_places(self, column: LogColumn) -> list[int]:
        """Return the places of the columns that may tell rows of a column apart and were not chosen by.

        None of them is delivered for a topic.
        """
        names, status = self.table.names, self._find_quality_column(column.place)
        taken = {column.place, *self.table.time_columns, *(place for place, _ in self.chosen_keys(column))}
        taken |= {*(self.names or ()), *(k for k in (self.unit_place, status) if k is not None)}
        taken |= find_quality_columns(names) | {source.column.place for source in self.by_topic.values()}
        return [k for k in range(len(names)) if k not in taken]


def _drop_untimed(rows: Iterable[Cells], clock: Clock) -> tuple[list[Cells], IntArray]:
    """Return the rows that have a valid time by a clock, and these times [ns], shape (n,)."""
    last_place = max(clock.columns)
    long = [row for row in rows if len(row) > last_place]
    times, is_timed = clock.read_rows(long)
    return list(itertools.compress(long, is_timed.tolist())), times[is_timed]


def _ignore_sentence(text: str) -> None:
    """Drop a sentence of a reading, in place of reporting it."""
    del text
