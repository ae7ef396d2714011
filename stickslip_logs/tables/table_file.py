# SPDX-License-Identifier: Apache-2.0
"""Reads a file of rows with times, text or Parquet (by pyarrow, extra ``logs``), block by block."""

from __future__ import annotations

import contextlib
import csv
import itertools
import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from stickslip_logs.arrays import BoolArray, FloatArray, IntArray
from stickslip_logs.errors import MAX_SHOWN, BagError, join_names, plural
from stickslip_logs.files import open_file
from stickslip_logs.tables.bus_log import BUS_LOGS, NO_SENTENCE
from stickslip_logs.tables.cell_times import Cells, number_reader
from stickslip_logs.tables.dialect import (
    COMMENTS,
    Dialect,
    csv_reader,
    detect_dialect,
    parse_heading,
    parse_number,
)
from stickslip_logs.tables.row_keys import is_same_key
from stickslip_logs.tables.signal_clocks import find_clocks, share_columns
from stickslip_logs.tables.text_file import read_text_lines, scan_extent
from stickslip_logs.tables.time_columns import WITHOUT_ZONE, Clock, TableColumns, find_clock, rank_stamps

# Rows that are yielded at a time: few enough for the caches.
BLOCK = 16_384
_PARQUET = b'PAR1'
# Letters of a word that is counted.
_MAX_WORD = 20
_DAY = re.compile(r'\D*\d+\D+\d+')
# What a line that is no row begins with; WinCC ends with a count of rows.
_REMARKS = *COMMENTS, '$RT_'

TakeSentence = Callable[[str], None]
"""Takes a sentence."""


@dataclass(slots=True)
class Rows:
    """Some rows of a table as one clock times them.

    Attributes:
        clock: The clock.
        time_ns: Their times [ns], shape (n,); without meaning in a row that has none.
        is_timed: Which rows have one, shape (n,).
        columns: By place, the n cells of each column that was asked for: texts, or an array of pyarrow.
    """

    clock: Clock
    time_ns: IntArray
    is_timed: BoolArray
    columns: Mapping[int, Any]

    def texts(self, place: int) -> list[str]:
        """Return the cells of a column that was asked for as texts: a list unchanged, a null as ''."""
        cells = self.columns[place]
        return cells if isinstance(cells, list) else _column_texts(cells)

    def select(
        self, keys: Iterable[tuple[int, str]], is_same: Callable[[str, str], bool] = is_same_key
    ) -> BoolArray:
        """Return which rows have at each key's place a cell that is its text by ``is_same``, shape (n,)."""
        chosen = np.ones(self.time_ns.size, np.bool_)
        for place, text in keys:
            cells = self.texts(place)
            same = {cell for cell in {*cells} if is_same(cell, text)}
            chosen &= np.fromiter(map(same.__contains__, cells), np.bool_, len(cells))
        return chosen


@dataclass(slots=True)
class Numbers:
    """The numbers of some cells.

    Attributes:
        value: The numbers, NaN for a word and for an empty cell, shape (n,).
        is_there: Which cells are not empty, shape (n,).
        words: What stands in place of a number, up to its 20th letter, by its index.
    """

    value: FloatArray
    is_there: BoolArray
    words: dict[int, str] = field(default_factory=dict)


class NumberTable(ABC):
    """A table of numbers with times.

    Attributes:
        names: The headings.
        units: The unit of each as the configuration calls it, None where it has no such unit.
        clocks: The clock of all columns, or one for each signal.
        head: Rows of the beginning.
        tail: Rows of the end.
        line_count: About how many rows there are.
        remarks: What was guessed, as sentences.
        losses: What cannot be read, as sentences.
        is_sent: Whether its numbers are as sensors sent them, over a bus.
        thousands: The decimal sign where nothing tells it from one of thousands, else empty.
    """

    names: tuple[str, ...]
    units: tuple[str | None, ...]
    clocks: tuple[Clock, ...]
    head: Sequence[Cells]
    tail: Sequence[Cells]
    line_count: int
    remarks: tuple[str, ...]
    losses: tuple[str, ...] = ()
    is_sent = False
    thousands = ''

    @property
    def time_columns(self) -> list[int]:
        """The places of the columns of all clocks."""
        return [k for clock in self.clocks for k in clock.columns]

    def clocks_of(self, columns: Sequence[int]) -> list[Clock]:
        """Return the clocks of some columns, each once, in the order of ``clocks``; else the first clock."""
        clocks = [clock for clock in self.clocks if any(clock.has_column(k) for k in columns)]
        return clocks or [self.clocks[0]]

    @abstractmethod
    def blocks(self, wanted: Sequence[int], lose: TakeSentence, note: TakeSentence) -> Iterator[Rows]:
        """Yield the rows of some columns in the order of the file, each block once for each of their clocks.

        All columns are in each of its blocks; the cells of a column count in those of its own clock.

        Args:
            wanted: The places of the columns.
            lose: Takes sentences on what was not used.
            note: Takes sentences on what is odd.

        Raises:
            OSError: The file cannot be opened.
        """

    @abstractmethod
    def numbers(self, cells: Any) -> Numbers:
        """Return the numbers of n cells of a column, as :meth:`blocks` yields them in ``Rows.columns``."""


def select_cells(cells: Any, chosen: BoolArray) -> Any:
    """Return the chosen cells of a block, in the type in which they are: a list or an array of pyarrow."""
    if chosen.all():
        return cells
    if isinstance(cells, list):
        return list(itertools.compress(cells, chosen.tolist()))
    return cells.take(np.flatnonzero(chosen))


def _mixed_numbers(cells: Cells, decimal: str = '.') -> Numbers:
    """Return the numbers of cells, parsed one by one: NaN for a word, which is counted, and an empty cell."""
    result = Numbers(np.full(len(cells), np.nan), np.ones(len(cells), np.bool_))
    for k, cell in enumerate(cells):
        text = cell.strip()
        if not text:
            result.is_there[k] = False
        elif (number := parse_number(text, decimal)) is not None:
            result.value[k] = number
        else:
            result.words[k] = text[:_MAX_WORD]
    return result


def open_table(path: Path) -> NumberTable:
    """Open a file as a table: Parquet by its first bytes, any other as text, packed or not.

    A text is read to its end, to count its lines and to have its tail; of Parquet a head and a tail are read.

    Raises:
        BagError: It is no table, may be read in two ways, or is damaged from its first bytes on; or it is
            Parquet, and pyarrow is not installed.
        OSError: It cannot be opened, or is no regular file.
    """
    with open_file(path) as file:
        is_parquet = file.read(len(_PARQUET)) == _PARQUET
    return ParquetTable(path) if is_parquet else TextTable(path)


def is_number_table(path: Path) -> bool:
    """Return whether the head of a text is a bus log, or a table with a time and a column of numbers.

    A column of numbers has a number in more than half of its cells. False for a text that cannot be read.
    """
    try:
        dialect = detect_dialect(path, scan_extent(path, is_whole=False))
        places = {*range(len(dialect.names))} - {*find_clock(path, dialect).columns}
    except BagError:
        return False
    if dialect.delimiter in BUS_LOGS:
        return True
    columns = [[row[k] for row in dialect.rows if k < len(row) and row[k].strip()] for k in places]
    are_numbers = [[parse_number(cell, dialect.decimal) is not None for cell in cells] for cells in columns]
    return any(2 * sum(flags) > len(flags) for flags in are_numbers)


class TextTable(NumberTable):
    """A table of text.

    Making it reads the file to its end, and once more where the days between may tell how dates are written.

    Raises:
        BagError: It is no table, or may be read in two ways.
    """

    def __init__(self, path: Path) -> None:
        self._path, extent = path, scan_extent(path)
        self._dialect = detect_dialect(path, extent)
        self._is_plain, self._is_ended = extent.is_plain, extent.is_ended
        self.is_sent = self._dialect.delimiter in BUS_LOGS
        self.names, self.units = self._dialect.names, self._dialect.units
        self.thousands = self._dialect.thousands
        self.clocks = find_clocks(path, self._dialect)
        if any(clock.question and not clock.is_count for clock in self.clocks) and not self.is_sent:
            # What the ends leave open the days between them may tell.
            tail = (*self._dialect.tail, *self._rows_of_days(self.clocks[0].columns))
            self.clocks = find_clocks(path, replace(self._dialect, tail=tail))
        self.head, self.tail = self._dialect.rows, self._dialect.tail
        self.line_count = max(extent.lines - len(self._dialect.above), 0)
        of_encoding = ('the text is not UTF-8: read as Windows-1252',)
        remarks = of_encoding if self._dialect.encoding == 'cp1252' else ()
        self.remarks = (*_remarks_on(self.clocks, self.names), *self._dialect.remarks, *remarks)
        losses = [f'the file is cut or damaged: {extent.problem}'] if extent.problem else []
        if extent.zeros and not self._dialect.encoding.startswith('utf-16'):
            losses.append(f'the file has {plural(extent.zeros, "zero byte")}, which are no text')
        self.losses = (*losses, *self._dialect.losses)

    def _rows_of_days(self, columns: Sequence[int]) -> list[list[str]]:
        """Read the file for the first row of each day, by the first two numbers in the columns of dates.

        Up to 3660 days are found. Rows without these numbers count as one day; too short ones are skipped.
        """
        rows = dict[str, list[str]]()
        for batch, _ in self._read_batches():
            for row in batch:
                if len(row) > columns[-1] and len(rows) < 3660:  # ten years
                    match = _DAY.match('/'.join([row[k] for k in columns]))
                    rows.setdefault(match[0] if match else '', row)
        return list(rows.values())

    def numbers(self, cells: Cells) -> Numbers:
        """Return the numbers of cells; NaN for a word, which is counted, and for an empty cell."""
        joined, decimal = '\n'.join(cells), self._dialect.decimal
        # What Python takes for a number and a table does not have: 'inf', 'nan' and '1_000'.
        if '_' not in joined and (decimal == '.' or '.' not in joined):
            plain = cells if decimal == '.' else joined.replace(',', '.').split('\n')
            with contextlib.suppress(ValueError):
                value = np.fromiter(map(float, plain), float, len(cells))
                if np.isfinite(value).all():
                    return Numbers(value, np.ones(len(cells), np.bool_))
        return _mixed_numbers(cells, decimal)

    def blocks(self, wanted: Sequence[int], lose: TakeSentence, note: TakeSentence) -> Iterator[Rows]:
        """Yield the rows of some columns without the units behind numbers, once for each of their clocks.

        At the end, unused lines are lost, and repeated headings and lines without a sentence are noted.

        Raises:
            OSError: The file cannot be opened; damage ends the rows without an error.
        """
        if self._dialect.delimiter in BUS_LOGS:
            yield from self._bus_blocks(wanted, lose, note)
            return
        reading = _TextReading(self._dialect, self.clocks_of(wanted), wanted)
        for batch, swallowed in self._read_batches():
            reading.short += swallowed
            yield from reading.read_batch(batch)
        reading.report_unused(lose, note)

    def _bus_blocks(self, wanted: Sequence[int], lose: TakeSentence, note: TakeSentence) -> Iterator[Rows]:
        """Yield the rows of a bus log in blocks, a number a row (time, name, value, unit, sender).

        At the end, lines that are damaged or without a time are lost, and lines without a sentence noted.
        """
        lines = read_text_lines(self._path, self._dialect.encoding, is_plain=self._is_plain)
        log_rows = BUS_LOGS[self._dialect.delimiter](lines)
        lost, foreign, clock = 0, 0, self.clocks[0]
        while batch := list(itertools.islice(log_rows, BLOCK)):
            rows = [row for row in batch if row]
            unspoken = batch.count(NO_SENTENCE)
            lost, foreign = lost + len(batch) - len(rows) - unspoken, foreign + unspoken
            columns = {k: [row[k] for row in rows] for k in (*clock.columns, *wanted)}
            time_ns, is_timed = clock.read([columns[k] for k in clock.columns])
            lost += int((~is_timed).sum())
            yield Rows(clock, time_ns, is_timed, columns)
        if lost:
            lose(unused_lines(lost, 'damaged, or without a time'))
        if foreign:
            note(unused_lines(foreign, 'without a sentence'))

    def _read_batches(self) -> Iterator[tuple[list[list[str]], int]]:
        """Yield batches of up to 16384 rows below the headings, each with how many lines are not rows.

        Such lines stand within open quotation marks. A truncated last row is dropped and counted as one. A
        batch may be empty.
        """
        lines = read_text_lines(self._path, self._dialect.encoding, is_plain=self._is_plain)
        cells = csv_reader(lines, self._dialect.delimiter)
        for _ in itertools.islice(cells, len(self._dialect.above)):
            pass
        is_over, is_ended = False, self._is_ended
        while not is_over:
            before, batch = cells.line_num, list[list[str]]()
            # A cell of more than 128 KiB, which csv refuses, ends the batch.
            with contextlib.suppress(csv.Error):
                batch.extend(itertools.islice(cells, BLOCK))
            is_over = cells.line_num == before
            lost = cells.line_num - before - len(batch)
            if len(batch) < BLOCK and batch and not is_ended and len(batch[-1]) < len(self.names):
                batch.pop()
                lost, is_ended = lost + 1, True
            yield batch, lost


def _remarks_on(clocks: Sequence[Clock], names: Sequence[str]) -> list[str]:
    """Return the remarks of the clocks of a table; of several clocks also the columns of each."""
    notes = list(dict.fromkeys(text for clock in clocks for text in clock.remarks))
    if len(clocks) > 1:
        pairs = [f"'{names[k]}' by #{clock.columns[0] + 1}" for clock in clocks for k in clock.values or ()]
        notes.append(f'{len(clocks)} columns are times, each of the signals beside it: {join_names(pairs)}')
    return notes


class _TextReading:
    """A pass over the rows of a text: finds the wanted columns, and counts what is not used.

    A logger that was started again, or a second one behind it in the file, writes its headings in the middle;
    what comes below them is in their order. ``clocks`` are those of the columns at the places ``wanted``.
    """

    def __init__(self, dialect: Dialect, clocks: Sequence[Clock], wanted: Sequence[int]) -> None:
        self._first = [cell.strip() for cell in dialect.heading]
        self._max_cells = len(dialect.names)
        # Cells parted by blanks do not say which of them is missing.
        self._width = self._max_cells if dialect.delimiter == ' ' else 0
        self._above, self._clocks, self._wanted = {tuple(row) for row in dialect.above}, clocks, [*wanted]
        self._times = [k for clock in clocks for k in clock.columns]
        self._places: list[int] | None = [*self._times, *wanted]
        self._suffixes = [(dialect.suffixes or [''] * self._max_cells)[k] for k in self._places]
        self._order: Cells = self._first
        self.short = self._untimed = self._repeated = self._foreign = 0
        self._shown = self._foreign_heading = ''

    def read_batch(self, batch: list[list[str]]) -> Iterator[Rows]:
        """Yield the rows of a batch, once for each clock; split them where new headings reorder the columns.

        Unused rows are counted for :meth:`report_unused`. The order of the columns is carried over to the
        next batch: after headings that lack a wanted column, rows are skipped up to the next headings.

        Args:
            batch: The rows; too short ones are removed from it or filled up.
        """
        while batch:
            if self._places is None:
                at = next((k for k, row in enumerate(batch) if self._is_heading(row)), len(batch))
                self._foreign += at
                self._follow_heading(batch[at] if at < len(batch) else None)
                batch = batch[at + 1 :]
                continue
            self._drop_uncertain_rows(batch, max(self._places))
            columns = [
                [row[k].removesuffix(suffix) for row in batch] if suffix else [row[k] for row in batch]
                for k, suffix in zip(self._places, self._suffixes, strict=True)
            ]
            cells = iter(columns)
            times = [clock.read([*itertools.islice(cells, len(clock.columns))]) for clock in self._clocks]
            values = dict(zip(self._wanted, cells, strict=True))
            untimed = np.flatnonzero(~np.any([is_timed for _, is_timed in times], axis=0)).tolist()
            end = next((k for k in untimed if self._is_heading(batch[k])), len(batch))
            for k in untimed:
                if k < end:
                    self._count_untimed(batch[k])
            for clock, (time_ns, is_timed) in zip(self._clocks, times, strict=True):
                columns = [column for k, column in values.items() if clock.has_column(k)]
                lacking = {*np.flatnonzero(~is_timed[:end]).tolist()}.difference(untimed)
                self._untimed += sum(any(column[k].strip() for column in columns) for k in lacking)
                yield Rows(
                    clock, time_ns[:end], is_timed[:end], {k: column[:end] for k, column in values.items()}
                )
            self._follow_heading(batch[end] if end < len(batch) else None)
            batch = batch[end + 1 :]

    def _is_heading(self, row: Cells) -> bool:
        """Return whether a row has headings of the table, but is not equal to the last headings.

        At least two of the headings have to occur, the only one there is, or those of times in their places.
        """
        cells = [cell.strip() for cell in row]
        names = {name for name in self._first if name}
        if not names or cells == [*self._order]:
            return False
        is_timed = all(self._first[k] and cells[k : k + 1] == [self._first[k]] for k in self._times)
        return is_timed or len(names & set(cells)) > min(1, len(names) - 1)

    def _follow_heading(self, row: Cells | None) -> None:
        """Take over the places of the wanted columns from headings in the middle, and count these.

        Of equal headings, the n-th stays the n-th. Where a wanted column is missing, the places become None,
        so that rows are skipped up to the next headings. Without a row nothing changes.
        """
        if row is None:
            return
        self._order, self._repeated = [cell.strip() for cell in row], self._repeated + 1
        self._max_cells = max(self._max_cells, len(row))
        self._places = []
        for k in (*self._times, *self._wanted):
            alike = [place for place, name in enumerate(self._order) if name == self._first[k]]
            number = self._first[:k].count(self._first[k])
            if number >= len(alike):
                self._places, self._foreign_heading = None, self._foreign_heading or ', '.join(self._order)
                return
            self._places.append(alike[number])

    def _count_untimed(self, row: Cells) -> None:
        """Count a row without a time as repeated headings, or else as lost; keep the first lost one to show.

        Counts of WinCC, other remarks of less or more than all cells, and copies of a row above the numbers
        are not counted.
        """
        if [cell.strip() for cell in row] == [*self._order]:
            self._repeated += 1
        elif tuple(row) not in self._above and not (
            row[0].startswith(_REMARKS) and (len(row) != self._max_cells or row[0][0] == '$')
        ):
            self._untimed += 1
            self._shown = self._shown or ' '.join(row[k].strip() for k in self._clocks[0].columns)[:MAX_SHOWN]

    def _drop_uncertain_rows(self, batch: list[list[str]], width: int) -> None:
        """Remove rows of more cells than columns, and of less than up to a wanted one, or fill up the latter.

        A row is filled up if it reaches behind the columns of the first clock and, with a single clock,
        behind half of the headings; where blanks part cells, none is. Removed rows are counted in ``short``,
        but for blank ones and remarks.

        Args:
            batch: The rows, at least one; changed.
            width: The last place of a wanted column.
        """
        width, lengths = max(width, self._width - 1), [*map(len, batch)]
        if min(lengths) > width and max(lengths) <= self._max_cells:
            return
        # A signal that ended before another leaves the rest of the line out.
        half = len(self._first) // 2 if len(self._clocks) == 1 else 0
        need = max(max(self._clocks[0].columns) + 1, half, self._width)
        # Below other headings there may be more columns.
        wide = [k for k, row in enumerate(batch) if any(map(str.strip, row[self._max_cells :]))]
        end = next((k for k in wide if self._is_heading(batch[k])), len(batch))
        excessive = {k for k in wide if k < end}
        for k in reversed(range(len(batch))):
            row = batch[k]
            if width >= len(row) > need:
                row += [''] * (width + 1 - len(row))
            elif len(row) <= width or k in excessive:
                self.short += any(cell.strip() for cell in row) and not row[0].startswith(_REMARKS)
                del batch[k]

    def report_unused(self, lose: TakeSentence, note: TakeSentence) -> None:
        """Report how many rows were not used, and how often headings came again."""
        if self._untimed:
            shown = f", the first '{self._shown}'" if self._shown else ''
            lose(unused_lines(self._untimed, 'without a time', shown))
        if self.short:
            lose(unused_lines(self.short, 'damaged, or of too few or too many cells'))
        if self._foreign:
            lose(unused_lines(self._foreign, f"under other headings ('{self._foreign_heading[:MAX_SHOWN]}')"))
        if self._repeated:
            note(f'the headings come {plural(self._repeated, "time")} more in the middle')


def unused_lines(count: int, subject: str, more: str = '') -> str:
    """Return the clause that some lines were not used, as '2 lines without a time were not used' + more."""
    return f'{plural(count, "line")} {subject} {"was" if count == 1 else "were"} not used{more}'


class ParquetTable(NumberTable):
    """A Parquet file.

    Raises:
        BagError: pyarrow is not there or cannot read it, or no column is a time.
    """

    def __init__(self, path: Path) -> None:
        self._path, file = path, _open_parquet(path)
        schema = file.schema_arrow
        self.names = tuple(schema.names)
        headings = tuple(map(parse_heading, self.names))
        self.units = tuple(heading.known_unit for heading in headings)
        self.line_count = file.metadata.num_rows
        with _as_bag_error(path):
            first = next(iter(file.iter_batches(2000)), None)
            self.head = () if first is None else _as_rows(first.columns)
            last = file.metadata.num_row_groups - 1
            group = None if last < 1 else file.read_row_group(last)
            self.tail = () if group is None else _as_rows(group.slice(max(group.num_rows - 9, 0)).columns)
        columns = TableColumns(self.names, headings, self.units, '.', tuple(self.head), ())
        stamped = rank_stamps(
            columns, [k for k, kind in enumerate(schema.types) if str(kind).startswith('timestamp')]
        )
        if stamped:
            has_zone = 'tz=' in str(schema.types[stamped[0]])
            read = number_reader(1, 0, '.')  # as _column_texts() writes them
            main, *more_clocks = (Clock((k,), read, () if has_zone else (WITHOUT_ZONE,)) for k in stamped)
            self.clocks = share_columns(columns, main, more_clocks)
        else:
            self.clocks = find_clocks(path, columns)
        self.remarks = tuple(_remarks_on(self.clocks, self.names))

    def numbers(self, cells: Any) -> Numbers:
        """Return the numbers of an array of pyarrow with numbers or texts.

        NaN for a word, a null and what is not finite. Words are counted only in texts.
        """
        is_there = np.asarray(cells.is_valid().to_numpy(zero_copy_only=False), np.bool_)
        try:
            value = cells.cast('float64').to_numpy(zero_copy_only=False).astype(float)
            return Numbers(np.where(np.isfinite(value), value, np.nan), is_there)
        except (ValueError, NotImplementedError):  # pyarrow's errors are of these
            return _mixed_numbers(_column_texts(cells))

    def blocks(self, wanted: Sequence[int], lose: TakeSentence, note: TakeSentence) -> Iterator[Rows]:
        """Yield the rows of some columns, each block once for each of their clocks.

        Damage ends the rows without an error; it and, at the end, rows without a time are lost. A file that
        is no longer there is an OSError.
        """
        del note
        file, untimed = _open_parquet(self._path), 0
        clocks = self.clocks_of(wanted)
        places = list(dict.fromkeys([*(k for clock in clocks for k in clock.columns), *wanted]))
        try:
            for batch in file.iter_batches(BLOCK, columns=[self.names[k] for k in places]):
                columns = dict(zip(places, batch.columns, strict=True))
                for clock in clocks:
                    times = clock.read([_column_texts(columns[k]) for k in clock.columns])
                    lacking = ~times[1]
                    if len(clocks) > 1:
                        timed = [columns[k].is_valid() for k in wanted if clock.has_column(k)]
                        lacking &= np.any([t.to_numpy(zero_copy_only=False) for t in timed], axis=0)
                    untimed += int(lacking.sum())
                    yield Rows(clock, *times, columns)
        except Exception as error:  # pyarrow's errors have no common root
            lose(f'the file is damaged ({str(error)[:100]}): not read from there on')
        if untimed:
            lose(unused_lines(untimed, 'without a time'))


def _open_parquet(path: Path) -> Any:
    """Open a file with the reader of pyarrow.

    Raises:
        BagError: pyarrow is not installed, or cannot read it.
        OSError: It is not there.
    """
    path.stat()
    try:
        from pyarrow import parquet  # an extra, which takes time to import
    except ImportError as error:
        raise BagError(
            f"log '{path}' is a Parquet file, which needs the extra 'logs' ({error}):"
            " pip install 'stickslip_monitor[logs]'"
        ) from None
    with _as_bag_error(path):
        return parquet.ParquetFile(path)


@contextlib.contextmanager
def _as_bag_error(path: Path) -> Iterator[None]:
    """Raise any error of the block as a BagError that names the file: pyarrow's have no common root."""
    try:
        yield
    except Exception as error:
        raise BagError(f"log '{path}' cannot be read as Parquet: {str(error)[:200]}") from None


def _as_rows(columns: Sequence[Any]) -> tuple[tuple[str, ...], ...]:
    """Return columns of pyarrow as rows of texts; an empty text for a null."""
    return tuple(zip(*map(_column_texts, columns), strict=True))


def _column_texts(column: Any) -> list[str]:
    """Return the cells of a column of pyarrow as texts: a null as '', a timestamp as ns since 1970.

    A null timestamp becomes the text of the smallest int64, which is no valid time.
    """
    if str(column.type).startswith('timestamp'):
        times = column.to_numpy(zero_copy_only=False).astype('M8[ns]')
        return [str(ns) for ns in times.astype(np.int64).tolist()]
    return ['' if cell is None else str(cell) for cell in column.to_pylist()]
