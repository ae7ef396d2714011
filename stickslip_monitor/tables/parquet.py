# SPDX-License-Identifier: Apache-2.0
"""Reads Parquet as a table, by pyarrow (extra ``logs``)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from stickslip_monitor.errors import BagError
from stickslip_monitor.tables.clock import WITHOUT_ZONE, Clock, find_clock
from stickslip_monitor.tables.dialect import Dialect
from stickslip_monitor.tables.headings import parse_heading, parse_number
from stickslip_monitor.tables.stamps import Times
from stickslip_monitor.tables.table import BLOCK, Numbers, Rows, Say

MAGIC = b'PAR1'
_HEAD = 2000


class ParquetTable:
    """A Parquet file; see :class:`~stickslip_monitor.tables.table.NumberTable`.

    Raises:
        BagError: pyarrow is not there or cannot read it, or no column is a time.
    """

    def __init__(self, path: Path) -> None:
        self._path, file = path, _opened(path)
        schema = file.schema_arrow
        self.names = tuple(schema.names)
        self.units = tuple(parse_heading(name).known_unit for name in self.names)
        self.kind, self.line_count = 'parquet', file.metadata.num_rows
        first = next(iter(file.iter_batches(_HEAD)), None)
        columns = [] if first is None else [_texts(column) for column in first.columns]
        self.head = tuple(zip(*columns, strict=True))
        self.tail = self._tail(file)
        stamped = [k for k, kind in enumerate(schema.types) if str(kind).startswith('timestamp')]
        if stamped:
            has_zone = 'tz=' in str(schema.types[stamped[0]])
            self.clock = Clock((stamped[0],), _stamps, () if has_zone else (WITHOUT_ZONE,))
        else:
            rows = tuple(list(row) for row in self.head)
            dialect = Dialect('', '', '.', 0, self.names, self.units, rows, ())
            self.clock = find_clock(path, dialect)
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
