# SPDX-License-Identifier: Apache-2.0
"""How a text file of rows is written: encoding, delimiter, decimal sign, headings and units.

Nothing of it is asked for; it is found by the head and the tail of the file.
"""

from __future__ import annotations

import contextlib
import csv
import gzip
import io
import re
import zlib
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, NamedTuple

from stickslip_monitor.errors import BagError
from stickslip_monitor.files import open_file
from stickslip_monitor.tables.bus_log import BUS_LOGS, NAMES, bus_log_of
from stickslip_monitor.tables.clock import Cells, TableColumns, is_stamp, is_time

# What is looked at of a file: its head, its tail, and lines of the head [bytes, bytes, lines].
_HEAD, _TAIL, _MOST_LINES = 1 << 18, 1 << 14, 2000
_PIECE = 1 << 20
# A line without an end is given in pieces of this length, so that none takes the memory.
_LONGEST_LINE = 1 << 20
GZIP = b'\x1f\x8b'
_MARKS = ((b'\xff\xfe', 'utf-16'), (b'\xfe\xff', 'utf-16'), (b'\xef\xbb\xbf', 'utf-8-sig'))
_BROKEN = (EOFError, OSError, zlib.error)


@dataclass(frozen=True, slots=True)
class Dialect(TableColumns):
    """How a table is written, beside its columns.

    Attributes:
        encoding: Of its text.
        delimiter: Between cells; the name of a log of a ship's bus where it is one.
        skip: Rows before the first with numbers.
    """

    encoding: str
    delimiter: str
    skip: int


@dataclass(frozen=True, slots=True)
class Extent:
    """What a first pass over the bytes of a file found.

    ``problem`` is why it could not be read to its end, ``is_ended`` whether its last line is
    whole.
    """

    head: bytes
    tail: bytes
    lines: int
    size: int
    zeros: int
    is_ended: bool
    problem: str


def opened(path: Path) -> IO[bytes]:
    """The bytes of a file, decompressed.

    Raises:
        OSError: It cannot be opened.
    """
    file = open_file(path)
    begin = file.read(len(GZIP))
    file.seek(0)
    return gzip.open(file) if begin == GZIP else file  # type: ignore[return-value]


def extent_of(path: Path) -> Extent:
    """Read a file once for its head, its tail and the number of its lines.

    Raises:
        BagError: Nothing of it can be read.
    """
    head, tail, lines, size, zeros, problem = b'', b'', 0, 0, 0, ''
    try:
        with opened(path) as file:
            while piece := file.read(_PIECE):
                head += piece[: _HEAD - len(head)]
                tail = (tail + piece)[-_TAIL:] if size + len(piece) > _HEAD else b''
                lines, zeros = lines + piece.count(b'\n'), zeros + piece.count(b'\0')
                size += len(piece)
                last = piece[-2:]
    except _BROKEN as error:
        problem = str(error) or type(error).__name__
        if not size:
            raise BagError(f"log '{path}' cannot be read: {problem}") from None
    is_ended = bool(size) and b'\n' in last
    return Extent(head, tail, lines + (not is_ended), size, zeros, is_ended, problem)


def text_lines(path: Path, encoding: str) -> Iterator[str]:
    """The lines without zero bytes, as far as they can be read; one without an end in pieces."""
    with opened(path) as raw:
        text = io.TextIOWrapper(raw, encoding, errors='replace', newline='')
        with contextlib.suppress(*_BROKEN):
            for line in iter(lambda: text.readline(_LONGEST_LINE), ''):
                yield line.replace('\0', '') if '\0' in line else line


def sniff(path: Path, extent: Extent) -> Dialect:
    """Find out how a table is written.

    Raises:
        BagError: It is no table, or not to be told from several.
    """
    encoding = _encoding(extent.head)
    text = extent.head.decode(encoding, 'replace').replace('\0', '')
    if extent.size > len(extent.head):
        text = text[: text.rfind('\n') + 1]
    lines = text.splitlines(keepends=True)
    kept, others = lines[:_MOST_LINES], lines[_MOST_LINES:]
    # The tail begins within a line, and within a character of two bytes.
    tail = extent.tail.decode(encoding if encoding != 'utf-16' else 'utf-16-le', 'replace')
    last = tail.replace('\0', '').splitlines(keepends=True)[1:] or others[-_MOST_LINES:]
    if kind := bus_log_of(kept):
        return _bus_log(path, encoding, kind, kept, last)
    delimiter, rows = _best(kept)
    if not rows:
        raise BagError(f"log '{path}' is no table: no line of it has two cells")
    decimal = decimal_sign(rows, delimiter)
    if decimal is None:
        shown = first_with_comma(rows)
        raise BagError(
            f"log '{path}': '{shown}' may be {shown.replace(',', '.')} or"
            f" {shown.replace(',', '')}: write it with a decimal point, or cells separated by ';'"
        )
    width = _usual_width(rows)
    first = next((k for k, row in enumerate(rows) if _is_data(row, decimal, width)), None)
    if first is None:
        raise BagError(f"log '{path}' has no line with a time and a number")
    names, units = _headings(rows[:first], width)
    headings = tuple(map(parse_heading, names))
    known, ends = tuple(rows[first:]), tuple(_split(last, delimiter))
    return Dialect(names, headings, units, decimal, known, ends, encoding, delimiter, first)


def _encoding(head: bytes) -> str:
    for mark, encoding in _MARKS:
        if head.startswith(mark):
            return encoding
    # UTF-16 without its mark: every other byte of plain text is zero.
    for begin, encoding in ((1, 'utf-16-le'), (0, 'utf-16-be')):
        if len(head) > 3 and head[begin:400:2].count(0) > 0.8 * len(head[begin:400:2]):
            return encoding
    try:
        head[:-4].decode()
    except UnicodeDecodeError as error:
        return 'utf-8' if error.start > len(head) - 8 else 'cp1252'
    return 'utf-8'


def _split(lines: Sequence[str], delimiter: str) -> list[list[str]]:
    try:
        return list(reader(iter(lines), delimiter))
    except csv.Error:
        return []


def reader(lines: Iterator[str], delimiter: str) -> Any:
    """The rows of lines; those cut by blanks may be cut by several."""
    return csv.reader(lines, delimiter=delimiter, skipinitialspace=delimiter == ' ')


def _best(lines: Sequence[str]) -> tuple[str, list[list[str]]]:
    """The delimiter that cuts most lines into one number of cells that are times and numbers."""
    best: tuple[float, str, list[list[str]]] = (0.0, ',', [])
    for delimiter in '\t;|, ':
        rows = _split(lines, delimiter)
        width = _usual_width(rows)
        if width < 2:
            continue
        usual = [row for row in rows if len(row) == width]
        cells = [cell for row in usual[-50:] for cell in row if cell.strip()]
        sound = sum(_is_sound(cell) for cell in cells)
        score = len(usual) / len(rows) * (0.1 + sound / max(len(cells), 1))
        if score > best[0] * 1.0001:
            best = score, delimiter, rows
    return best[1:]


def _usual_width(rows: Sequence[Cells]) -> int:
    counts = Counter(len(row) for row in rows if len(row) > 1 and not row[0].startswith('#'))
    return counts.most_common(1)[0][0] if counts else 0


def _is_sound(cell: str) -> bool:
    decimals = parse_number(cell, '.') is not None or parse_number(cell, ',') is not None
    return decimals or is_stamp(cell) or is_time(cell)


def _is_data(row: Cells, decimal: str, width: int) -> bool:
    """Whether a row is no heading: it has a stamp, begins with a number, or has two of them."""
    if len(row) < min(width, 2) or len(row) < width - 1 or row[0].startswith('#'):
        return False
    numbers = [parse_number(cell, decimal) is not None for cell in row]
    times = any(is_stamp(cell) or is_time(cell) for cell in row)
    return times or numbers[0] or sum(numbers) > 1


def _headings(above: Sequence[Cells], width: int) -> tuple[tuple[str, ...], tuple[str | None, ...]]:
    """Headings and units of a table by the rows above its numbers."""
    named = [row for row in above if len(row) >= max(width - 1, 2)]
    bare = [row for row in named if not row[0].startswith('#')]
    if not bare:
        # Of cells cut by blanks the mark of a comment may be one.
        bare = [[row[0].lstrip('# '), *row[1:]] for row in named]
        bare = [row if row[0] or len(row) <= width else row[1:] for row in bare]
    if not bare or bare[-1][0].strip().lower().startswith('sep='):
        return tuple(f'#{k + 1}' for k in range(width)), (None,) * width
    names = bare[-1]
    units: Cells = [''] * len(names)
    if len(bare) > 1 and len(bare[-2]) == len(names) and _is_units(names):
        units, names = names, bare[-2]
    both = [with_unit(*pair) for pair in zip(names, units, strict=True)]
    both += [('', None)] * (width - len(both))
    return tuple(name for name, _ in both), tuple(unit for _, unit in both)


def _is_units(row: Cells) -> bool:
    return any(unit_of(cell) for cell in row) and all(len(cell.strip()) < 12 for cell in row)


def _bus_log(path: Path, encoding: str, kind: str, lines: Sequence[str], last: Sequence[str]) -> Dialect:
    rows = [row for row in BUS_LOGS[kind](iter(lines)) if row]
    if not rows:
        raise BagError(
            f"log '{path}': no line has a time and a number: record it with a time before each line"
        )
    tail = tuple(row for row in BUS_LOGS[kind](iter(last)) if row)
    units = (None,) * len(NAMES)
    headings = tuple(map(parse_heading, NAMES))
    return Dialect(NAMES, headings, units, '.', tuple(rows), tail, encoding, kind, 0)


UNITS = {
    'rpm': 'rpm',
    'r/min': 'rpm',
    '1/min': 'rpm',
    'rev/min': 'rpm',
    'min-1': 'rpm',
    'u/min': 'rpm',
    'min^-1': 'rpm',
    'rad/s': 'rad/s',
    'hz': 'Hz',
    '1/s': 'Hz',
    's-1': 'Hz',
    'm/s': 'm/s',
    'm s-1': 'm/s',
    'n': 'N',
    'kn': 'kN',
    'm/s^2': 'm/s^2',
    'm/s2': 'm/s^2',
    'g': 'g',
    'mm/s': 'mm/s',
    'um': 'um',
    'µm': 'um',
    'pa': 'Pa',
    'v': 'V',
    'db': 'dB',
}
"""What a unit is called in the configuration, by how it is written in lower case."""
# Of a heading without brackets the last word is its unit only where it can be nothing else.
_CLEAR = ('rpm', 'kn', 'hz')
# 'kn' in small letters is knots, but in the heading of a force.
_KNOTS, _FORCES = 'kn', {'load', 'force', 'thrust', 'kraft', 'last'}
_BRACKETED = re.compile(r'(.*?)\s*(?:[\[(]([^\])]*)[\])]\s*)?', re.DOTALL)
_NUMBER = re.compile(r'[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?')
_GROUPED = re.compile(r'[+-]?\d{1,3}(?:,\d{3})+(?:\.\d*)?')
_SPACES = re.compile(r'(?<=\d)[\s\u00a0\u202f](?=\d{3}(?:\D|$))')
_COMMA = re.compile(r'[+-]?\d*,\d+(?:[eE][+-]?\d+)?')
_SWAP = str.maketrans(',.', '.,')


class Heading(NamedTuple):
    """A heading: its words in lower case, and the unit as it is written, if there is one."""

    name: str
    unit: str | None

    @property
    def known_unit(self) -> str | None:
        """The unit as the configuration calls it; None where it is none of those."""
        is_knots = self.unit == _KNOTS and not _FORCES & set(self.name.split())
        return None if is_knots else unit_of(self.unit or '')


def unit_of(text: str) -> str | None:
    """A unit as the configuration calls it; None for any other text."""
    return UNITS.get(' '.join(text.strip(' []()').lower().split()))


def parse_heading(text: str) -> Heading:
    """Split a heading such as ``'Shaft speed [rpm]'``, ``'load (kN)'`` or ``'n_rpm'``."""
    match = _BRACKETED.fullmatch(text.strip())
    name, unit = match.groups() if match else (text, None)
    words = re.sub(r'[_\W]+', ' ', name).split()
    if unit is None:
        unit = next((word for word in words if word.lower() in _CLEAR), None)
        if unit is None and unit_of(text):
            unit = text.strip()
    return Heading(' '.join(words).lower(), unit)


def with_unit(name: str, unit: str) -> tuple[str, str | None]:
    """A heading with a unit that stands apart from it, and the unit as the configuration calls it.

    A unit that is none of those becomes a part of the heading.
    """
    name, unit = name.strip(), unit.strip(' []()')
    if unit in ('', '-'):
        return name, parse_heading(name).known_unit
    whole = f'{name} [{unit}]'
    known = parse_heading(whole).known_unit
    return (name, known) if known else (whole, None)


def parse_number(cell: str, decimal: str = '.') -> float | None:
    """A cell as a number; None for a word, and for what is beyond a double."""
    text = cell.strip()
    if decimal == ',':
        text = text.translate(_SWAP)
    text = _SPACES.sub('', text)
    if _GROUPED.fullmatch(text):
        text = text.replace(',', '')
    if not _NUMBER.fullmatch(text):
        return None
    value = float(text)
    return value if abs(value) < float('inf') else None


def decimal_sign(rows: Sequence[Cells], delimiter: str) -> str | None:
    """The decimal sign of some cells; None where nothing tells it from a sign of thousands."""
    cells = [cell.strip() for row in rows for cell in row]
    comma = [cell for cell in cells if _COMMA.fullmatch(cell)]
    if not comma:
        return '.'
    if delimiter == ';' or not all(_GROUPED.fullmatch(cell) for cell in comma):
        return ','
    if any(cell.lstrip('+-').startswith('0,') for cell in comma):
        return ','
    points = any('.' in cell and _NUMBER.fullmatch(cell.replace(',', '')) for cell in cells)
    return '.' if points else None


def first_with_comma(rows: Sequence[Cells]) -> str:
    """The first cell that may be a number with a decimal comma."""
    return next(c.strip() for row in rows for c in row if _COMMA.fullmatch(c.strip()))
