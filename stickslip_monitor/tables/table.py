# SPDX-License-Identifier: Apache-2.0
"""A file of rows with times, text or Parquet (by pyarrow, extra ``logs``): columns, block by block."""

from __future__ import annotations

import contextlib
import csv
import itertools
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from stickslip_monitor.arrays import BoolArray, FloatArray, IntArray
from stickslip_monitor.errors import BagError, plural
from stickslip_monitor.files import open_file
from stickslip_monitor.tables.bus_log import BUS_LOGS
from stickslip_monitor.tables.clock import WITHOUT_ZONE, Cells, Clock, TableColumns, Times, find_clock
from stickslip_monitor.tables.dialect import (
    Dialect,
    extent_of,
    parse_heading,
    parse_number,
    reader,
    sniff,
    text_lines,
)

# Rows that are handed on at a time: few enough for the caches.
BLOCK = 1 << 14
_MOST_SHOWN = 60
_PARQUET, _PARQUET_HEAD = b'PAR1', 2000

Say = Callable[[str], None]


@dataclass(slots=True)
class Rows:
    """Some rows: their times [ns], which of them have one, and the cells of the columns."""

    time_ns: IntArray
    is_timed: BoolArray
    columns: Sequence[Any]


@dataclass(slots=True)
class Numbers:
    """The numbers of some cells, NaN for a word, which cells are not empty, and the words."""

    value: FloatArray
    is_there: BoolArray
    words: Counter[str] = field(default_factory=Counter)


class NumberTable(Protocol):
    """What every table gives."""

    @property
    def names(self) -> tuple[str, ...]:
        """The headings."""
        ...

    @property
    def units(self) -> tuple[str | None, ...]:
        """The unit of each as the configuration calls it."""
        ...

    @property
    def clock(self) -> Clock:
        """Its time."""
        ...

    @property
    def head(self) -> Sequence[Cells]:
        """Rows of the beginning."""
        ...

    @property
    def tail(self) -> Sequence[Cells]:
        """Rows of the end."""
        ...

    @property
    def line_count(self) -> int:
        """About how many rows there are."""
        ...

    @property
    def kind(self) -> str:
        """What it is: ``csv``, ``nmea``, ``signalk`` or ``parquet``."""
        ...

    @property
    def said(self) -> tuple[str, ...]:
        """What was guessed."""
        ...

    @property
    def losses(self) -> tuple[str, ...]:
        """What cannot be read."""
        ...

    def blocks(self, wanted: Sequence[int], lose: Say, note: Say) -> Iterator[Rows]:
        """Some columns, in the order of the file; told is what was not used, and what is odd."""
        ...

    def numbers(self, cells: Any) -> Numbers:
        """The numbers of cells of a column."""
        ...

    def known_times(self, columns: Sequence[Sequence[Any]]) -> Times:
        """The times of cells of the head or the tail."""
        ...


def texts_of(cells: Any) -> list[str]:
    """Cells of a block as texts."""
    return cells if isinstance(cells, list) else [str(cell) for cell in cells.to_pylist()]


def some_cells(cells: Any, chosen: BoolArray) -> Any:
    """Those cells of a block that are chosen, shape (n,)."""
    if isinstance(cells, list):
        return list(itertools.compress(cells, chosen.tolist()))
    return cells.filter(chosen)


class TextTable:
    """A table of text; see :class:`NumberTable`.

    Raises:
        BagError: It is no table, or not to be told how it is written.
    """

    def __init__(self, path: Path) -> None:
        self._path, self._extent = path, extent_of(path)
        self._dialect: Dialect = sniff(path, self._extent)
        self.clock = find_clock(path, self._dialect)
        self.names, self.units = self._dialect.names, self._dialect.units
        self.head, self.tail = self._dialect.rows, self._dialect.tail
        self.line_count = max(self._extent.lines - self._dialect.skip, 0)
        self.kind = self._dialect.delimiter if self._dialect.delimiter in BUS_LOGS else 'csv'
        said = list(self.clock.said)
        if self._dialect.encoding == 'cp1252':
            said.append('the text is not UTF-8: read as Windows-1252')
        self.said = tuple(said)
        self.losses = tuple(self._lost())

    def _lost(self) -> Iterator[str]:
        if self._extent.problem:
            yield f'the file is cut or damaged: {self._extent.problem}'
        if self._extent.zeros and not self._dialect.encoding.startswith('utf-16'):
            yield f'the file has {plural(self._extent.zeros, "zero byte")}, which are no text'

    def known_times(self, columns: Sequence[Cells]) -> Times:
        """The times of cells of the head or the tail."""
        return self.clock.read(columns)

    def numbers(self, cells: Cells) -> Numbers:
        """The numbers of cells."""
        joined = '\n'.join(cells)
        if self._dialect.decimal == ',' and '.' not in joined:
            fast: Cells = joined.replace(',', '.').split('\n') if cells else []
        else:
            fast = cells
        # What Python takes for a number and a table does not have.
        if self._dialect.decimal == '.' or fast is not cells:
            try:
                value = np.fromiter(map(float, fast), float, len(cells))
                if '_' not in joined and np.isfinite(value).all():
                    return Numbers(value, np.ones(len(cells), np.bool_))
            except ValueError:
                pass
        return self._mixed(cells)

    def _mixed(self, cells: Cells) -> Numbers:
        """The numbers of cells some of which are words or empty."""
        result = Numbers(np.full(len(cells), np.nan), np.ones(len(cells), np.bool_))
        for k, cell in enumerate(cells):
            text = cell.strip()
            if not text:
                result.is_there[k] = False
            elif (found := parse_number(text, self._dialect.decimal)) is not None:
                result.value[k] = found
            else:
                result.words[text[:20]] += 1
        return result

    def blocks(self, wanted: Sequence[int], lose: Say, note: Say) -> Iterator[Rows]:
        """Some columns, in the order of the file."""
        rest = _Untold(self.names, self.clock)
        for rows, short in self._rows([*self.clock.columns, *wanted]):
            rest.short += short
            times = self.clock.read(rows[: len(self.clock.columns)])
            rest.see(rows[: len(self.clock.columns)], times[1])
            yield Rows(*times, rows[len(self.clock.columns) :])
        rest.tell(lose, note)

    def _rows(self, wanted: Sequence[int]) -> Iterator[tuple[list[list[str]], int]]:
        """The cells of some columns of some rows, and how many rows had too few."""
        lines = text_lines(self._path, self._dialect.encoding)
        if self.kind in BUS_LOGS:
            found = BUS_LOGS[self.kind](lines)
            while some := list(itertools.islice(found, BLOCK)):
                rows = [row for row in some if row]
                yield [[row[k] for row in rows] for k in wanted], len(some) - len(rows)
            return
        cells = reader(lines, self._dialect.delimiter)
        for _ in itertools.islice(cells, self._dialect.skip):
            pass
        most, is_over = max(wanted), False
        while not is_over:
            before, batch = cells.line_num, list[list[str]]()
            # A cell longer than any is ends a batch.
            with contextlib.suppress(csv.Error):
                batch.extend(itertools.islice(cells, BLOCK))
            # Marks of quotation that do not close swallow lines.
            short = cells.line_num - before - len(batch)
            is_over = cells.line_num == before
            if min(map(len, batch), default=most + 1) <= most:
                is_last = len(batch) < BLOCK and not self._extent.is_ended
                short += self._fill(batch, most, is_last)
            yield [[row[k] for row in batch] for k in wanted], short

    def _fill(self, batch: list[list[str]], most: int, has_cut_end: bool) -> int:
        """Take rows of too few cells away, but those that lack empty ones at their end."""
        need, lost = max(self.clock.columns), 0
        for k in reversed(range(len(batch))):
            row = batch[k]
            if len(row) > most:
                continue
            is_cut = has_cut_end and k == len(batch) - 1
            if len(row) > max(need + 1, len(self.names) // 2) and not is_cut:
                row += [''] * (most + 1 - len(row))
            else:
                lost += any(cell.strip() for cell in row)
                del batch[k]
        return lost


class _Untold:
    """Rows without a time, rows of too few cells, and headings in the middle of a table."""

    def __init__(self, names: Sequence[str], clock: Clock) -> None:
        self._headings = tuple(names[k] for k in clock.columns)
        self.short = self._untimed = self._repeated = 0
        self._shown = ''

    def see(self, columns: Sequence[Cells], is_timed: BoolArray) -> None:
        """Take the cells of the time of some rows."""
        if is_timed.all():
            return
        for k in np.flatnonzero(~is_timed).tolist():
            cells = tuple(column[k].strip() for column in columns)
            if cells == self._headings:
                self._repeated += 1
            else:
                self._untimed += 1
                self._shown = self._shown or ' '.join(cells)[:_MOST_SHOWN]

    def tell(self, lose: Say, note: Say) -> None:
        """Say what was not used."""
        if self._untimed:
            was = 'has no time and was' if self._untimed == 1 else 'have no time and were'
            lose(f"{plural(self._untimed, 'line')} {was} not used, the first '{self._shown}'")
        if self.short:
            was = 'was' if self.short == 1 else 'were'
            lose(f'{plural(self.short, "line")} damaged or of too few cells {was} not used')
        if self._repeated:
            note(f'the headings come {plural(self._repeated, "time")} more in the middle')


class ParquetTable:
    """A Parquet file; see :class:`NumberTable`.

    Raises:
        BagError: pyarrow is not there or cannot read it, or no column is a time.
    """

    def __init__(self, path: Path) -> None:
        self._path, file = path, _opened(path)
        schema = file.schema_arrow
        self.names = tuple(schema.names)
        self.units = tuple(parse_heading(name).known_unit for name in self.names)
        self.kind, self.line_count = 'parquet', file.metadata.num_rows
        first = next(iter(file.iter_batches(_PARQUET_HEAD)), None)
        columns = [] if first is None else [_texts(column) for column in first.columns]
        self.head = tuple(zip(*columns, strict=True))
        self.tail = self._tail(file)
        stamped = [k for k, kind in enumerate(schema.types) if str(kind).startswith('timestamp')]
        if stamped:
            has_zone = 'tz=' in str(schema.types[stamped[0]])
            self.clock = Clock((stamped[0],), _stamps, () if has_zone else (WITHOUT_ZONE,))
        else:
            headings, rows = tuple(map(parse_heading, self.names)), tuple(list(row) for row in self.head)
            seen = TableColumns(self.names, headings, self.units, '.', rows, ())
            self.clock = find_clock(path, seen)
        self.said, self.losses = self.clock.said, ()

    @staticmethod
    def _tail(file: Any) -> tuple[tuple[str, ...], ...]:
        last = file.metadata.num_row_groups - 1
        if last < 1:
            return ()
        group = file.read_row_group(last).slice(max(file.metadata.row_group(last).num_rows - 9, 0))
        return tuple(zip(*(_texts(column) for column in group.columns), strict=True))

    def numbers(self, cells: Any) -> Numbers:
        """The numbers of a column: of numbers, or of texts that are some."""
        is_there = np.asarray(cells.is_valid().to_numpy(zero_copy_only=False), np.bool_)
        try:
            value = cells.cast('float64').to_numpy(zero_copy_only=False).astype(float)
            return Numbers(np.where(np.isfinite(value), value, np.nan), is_there)
        except (ValueError, NotImplementedError):  # pyarrow's errors are of these
            texts = _texts(cells)
        found = [parse_number(text) for text in texts]
        value = np.array([np.nan if each is None else each for each in found], float)
        words = Counter(t[:20] for t, each in zip(texts, found, strict=True) if t and each is None)
        return Numbers(value, is_there & np.array([bool(text) for text in texts]), words)

    def known_times(self, columns: Sequence[Sequence[str]]) -> Times:
        """The times of cells of the head or the tail."""
        if self.clock.read is not _stamps:
            return self.clock.read(columns)
        times = np.array(columns[0], np.int64)
        return times, times > np.iinfo(np.int64).min

    def blocks(self, wanted: Sequence[int], lose: Say, note: Say) -> Iterator[Rows]:
        """Some columns, in the order of the file."""
        del note
        untimed = 0
        every = list(dict.fromkeys([*self.clock.columns, *wanted]))
        try:
            for batch in _opened(self._path).iter_batches(BLOCK, columns=[self.names[k] for k in every]):
                own = dict(zip(every, batch.columns, strict=True))
                times = self._times([own[k] for k in self.clock.columns])
                untimed += int((~times[1]).sum())
                yield Rows(*times, [own[k] for k in wanted])
        except Exception as error:  # pyarrow's errors have no common root
            lose(f'the file is damaged ({str(error)[:100]}): not read from there on')
        if untimed:
            lose(f'{untimed} rows have no time and were not used')

    def _times(self, columns: Sequence[Any]) -> Times:
        if self.clock.read is _stamps:
            return _stamps(columns)
        return self.clock.read([_texts(column) for column in columns])


def _opened(path: Path) -> Any:
    try:
        from pyarrow import parquet  # an extra, which takes time to import
    except ImportError as error:
        raise BagError(
            f"log '{path}' is a Parquet file, which needs the extra 'logs' ({error}):"
            " pip install 'stickslip_monitor[logs]'"
        ) from None
    try:
        return parquet.ParquetFile(path)
    except Exception as error:  # pyarrow's errors have no common root
        raise BagError(f"log '{path}' cannot be read as Parquet: {str(error)[:200]}") from None


def _texts(column: Any) -> list[str]:
    """The cells as a text table would have them; a timestamp by its nanoseconds."""
    if str(column.type).startswith('timestamp'):
        return [str(ns) for ns in _stamps([column])[0].tolist()]
    return ['' if cell is None else str(cell) for cell in column.to_pylist()]


def _stamps(columns: Sequence[Any]) -> Times:
    times = columns[0].to_numpy(zero_copy_only=False).astype('M8[ns]')
    return times.astype(np.int64), ~np.isnat(times)


def open_table(path: Path) -> NumberTable:
    """Open a table of either kind.

    Raises:
        BagError: It is none, or cannot be read.
    """
    with open_file(path) as file:
        is_parquet = file.read(len(_PARQUET)) == _PARQUET
    return ParquetTable(path) if is_parquet else TextTable(path)
