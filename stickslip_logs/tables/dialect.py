# SPDX-License-Identifier: Apache-2.0
"""Detects how a text file of rows is written: encoding, delimiter, headings, units and numbers.

Nothing is asked for: the head and the tail of the file show it.
"""

from __future__ import annotations

import codecs
import csv
import re
import shlex
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from stickslip_logs.errors import MAX_SHOWN, BagError, plural
from stickslip_logs.tables.bus_log import BUS_LOGS, NAMES, bus_log_of
from stickslip_logs.tables.cell_times import Cells, is_day, is_stamp, is_time
from stickslip_logs.tables.text_file import Extent, lines_of
from stickslip_logs.tables.time_columns import TIME_UNITS, TIME_WORDS, TableColumns
from stickslip_logs.units import find_unit, names_of

# Lines of the head by which the layout is detected.
_MAX_LINES = 2000
_DELIMITERS = '\t;|, '
COMMENTS = '#', '%', '//', '*'
"""What a line begins with that is a comment."""
_MARKS_OF_COMMENTS = ''.join(COMMENTS) + ' '
_MARKS = ((b'\xff\xfe', 'utf-16-le'), (b'\xfe\xff', 'utf-16-be'), (b'\xef\xbb\xbf', 'utf-8-sig'))
# Programs of jq that write CSV: of a package of ISO 19848, and of objects with the members of the first one.
_JQ_OF_PACKAGE = (
    '.Package.TimeSeriesData[].TabularData[] | (["TimeStamp"] + .DataChannelID),'
    ' (.DataSet[] | [.TimeStamp] + .Value) | @csv'
)
_JQ_OF_OBJECTS = (
    '[paths(type != "object" and type != "array")] as $keys | ($keys | map(map(tostring) | join("."))),'
    ' ((., inputs) | [getpath($keys[])]) | @csv'
)
# How frames of NMEA 2000 are logged, by candump, gateways, and canboat, and what makes values of them.
_FRAMES = {
    r'^\(\d+\.\d+\) +\w+ +[0-9A-Fa-f]{8}#[0-9A-Fa-f]+\s*$': 'candump2analyzer < {0} | analyzer -json',
    r'^\d\d:\d\d:\d\d\.\d+ [RT] [0-9A-Fa-f]{8}( [0-9A-Fa-f]{2})+\s*$': 'analyzer -json < {0}',
    r'^[-\dTZ:.]+,\d,\d{5,6},\d+,\d+,\d+(,[0-9A-Fa-f]{2})+\s*$': 'analyzer -json < {0}',
    r'^A\d{6}\.\d+ [0-9A-F]{5} [0-9A-F]{5} [0-9A-F]+\s*$': 'analyzer -json < {0}',
    # What it writes without -json.
    r'^[-\dTZ:.]+ +\d +\d+ +\d+ +\d{5,6} .*: ': 'analyzer -json < RAW',
}
# Other frames of CAN: an identifier before '#', or '[8]' as candump shows it, or beside 'Rx'.
_CAN_FRAME = r'\b(?:0x)?[0-9A-Fa-f]{3,8}(?:##?\w|>?\s+\[\d+\]\s|x?\s+[RT]x\s)|\s[RT]x\s+[0-9A-Fa-f]{3,8}\s'
# Of a heading without brackets one of its words is its unit only where it can be nothing else.
_CLEAR = ('rpm', 'kn', 'hz')
# 'kn' in small letters is knots, 'N' is north, and 'tf' may be a sensor, but in the heading of a force.
FORCE_WORDS = {'load', 'force', 'thrust', 'kraft', 'last'}
_BRACKETED = re.compile(r'(.*?)\s*(?:[\[(]([^\])]*)[\])]\s*)?', re.DOTALL)
_NUMBER = re.compile(r'[+\-\u2212]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?')
_GROUPED = re.compile(r'[+\-\u2212]?\d{1,3}(?:,\d{3})+(?:\.\d*)?')
_SPACES = re.compile(r"(?<=\d)[\s\u00a0\u202f'\u2019](?=\d{3}(?:\D|$))|(?<=^[+\-\u2212])\s+")
_COMMA = re.compile(r'[+\-\u2212]?\d*,\d+(?:[eE][+-]?\d+)?')
_POINTS = re.compile(r'[+\-\u2212]?[1-9]\d{0,2}(?:\.\d{3})+')
_WITH_UNIT = re.compile(r'[+\-\u2212]?[\d.,]+(?:[eE][+-]?\d+)?(\s*[^\W\d_](?:[^\d\s,;]|(?<=m|s)2|-1)*)\s*')
# A factor, as in 'rpm x10' and 'rpm/10': the numbers may be ten times too small or too large. Not 'Aux 10'.
_TENS = r'(?:10+|0?[.,]0*1)'
_FACTOR = re.compile(
    rf'(?:(?<![^\W\d_])x|[×*]|(?<=m|n|z)\s?/)\s?{_TENS}(?!\d)|(?<!\d){_TENS}\s?(?:x\b|[×*])|\(0?[.,]0*1\)',
    re.I,
)
_SWAP = str.maketrans(',.', '.,')


class Heading(NamedTuple):
    """A heading: its words in lower case, and the unit as it is written, if there is one."""

    name: str
    unit: str | None

    @property
    def known_unit(self) -> str | None:
        """The unit as the configuration calls it; None where it has no such unit, as for knots (``kn``)."""
        is_force = bool(FORCE_WORDS & set(self.name.split()))
        is_knots = self.unit == 'kn' and not is_force
        return None if is_knots else unit_of(self.unit or '', 'force' if is_force else '')


def unit_of(text: str, quantity: str = '') -> str | None:
    """Return the name that the configuration has for the unit that a text spells; None for no known unit.

    A quantity beside it, as ``'force'``, makes ``'t'`` a unit.
    """
    unit = find_unit(text, quantity)
    return unit.name if unit else None


def parse_heading(text: str) -> Heading:
    """Return the words, in lower case, and the unit of a heading such as ``'Load, kN (aft)'`` or ``'n_rpm'``.

    The unit is as written, known or not; None without one. What is in brackets is not among the words; a unit
    without brackets is. Of a heading with a factor, as ``'rpm x10'``, the whole text is the unit, so that it
    is not a known one.
    """
    match = _BRACKETED.fullmatch(text.strip())
    name, bracketed = match.groups() if match else (text, None)
    words = re.sub(r'[_\W]+', ' ', name).split()
    unit = bracketed
    if not (text.rstrip().endswith(']') or '%' in (unit or '')) and unit_of(unit or '') is None:
        unit = _bare_unit(name.strip(), words) or bracketed
    if _FACTOR.search(text):
        unit = text.strip()
    return Heading(' '.join(words).lower(), unit)


def _bare_unit(name: str, words: Sequence[str]) -> str | None:
    """Return the unit of a heading without brackets, as written; None where nothing in it is surely a unit.

    ``words`` are those of the heading ``name``, as written.
    The first that applies: '%' anywhere; a known unit behind the last comma, or with '/' behind the last
    blank; below a word of force a last 'N', and any unit of force; rpm, kn or hz as a word of its own; the
    whole heading, but for a single letter.
    """
    if '%' in name:
        return '%'
    behind = name.rpartition(',')[2].strip()
    if ',' in name and unit_of(behind):
        return behind
    if '/' in (last := name.rpartition(' ')[2]) and unit_of(last):
        return last
    is_force = bool(FORCE_WORDS & {word.lower() for word in words})
    if is_force and words[-1] == 'N':
        return 'N'
    forces = [word for word in words if len(word) > 1 and unit_of(word) in names_of('force') and is_force]
    whole = name if unit_of(name) and len(name) > 1 else None
    return next((word for word in words if word.lower() in _CLEAR or word in forces), whole)


def with_unit(name: str, unit: str) -> tuple[str, str | None]:
    """Return a heading with a unit that stands apart from it, and that unit as the configuration calls it.

    A unit that the configuration does not have becomes a part of the heading, in brackets, and None is
    returned for it; without a unit, ``''`` or ``'-'``, that of the heading is returned.
    """
    name, unit = name.strip(), unit.strip(' []()')
    if unit in ('', '-'):
        return name, parse_heading(name).known_unit
    whole = f'{name} [{unit}]'
    known_unit = parse_heading(whole).known_unit
    return (name, known_unit) if known_unit else (whole, None)


def is_line_damaged(name: str, unit: str) -> bool:
    """Return whether a line of one value has a number, but 1, for a unit, or several numbers for a name."""
    parts = re.split(r'[;\t|,]', name)
    is_number = parse_number(unit) is not None and find_unit(unit, 'coefficient') is None
    return is_number or (len(parts) > 1 and all(parse_number(part) is not None for part in parts))


def parse_number(cell: str, decimal: str = '.') -> float | None:
    """Return a cell as a number; None for a word, an empty cell, 'nan', 'inf' and what is beyond a double.

    Separators of thousands and the minus sign of other locales are understood; the decimal sign is '.' or
    ',', and the other one may separate thousands.
    """
    text = cell.strip()
    if decimal == ',':
        text = text.translate(_SWAP)
    text = _SPACES.sub('', text).replace('\u2212', '-')  # the minus of Swedish, Norwegian, ... locales
    if _GROUPED.fullmatch(text):
        text = text.replace(',', '')
    if not _NUMBER.fullmatch(text):
        return None
    value = float(text)
    return value if abs(value) < float('inf') else None


@dataclass(frozen=True, slots=True)
class Dialect(TableColumns):
    """Layout of a text with rows, beside its columns.

    Attributes:
        encoding: The encoding of the text.
        delimiter: What stands between cells; for a log of a ship's bus its key in :data:`BUS_LOGS`.
        above: The rows before the first with numbers; the headings are one of them.
        heading: The row of the headings as it stands; empty where there is none.
        suffixes: The unit that stands behind every number of each column, empty where there is none.
        thousands: The decimal sign where nothing tells it from one of thousands, else empty.
        remarks: What was guessed, as sentences.
        losses: What is not read, as sentences.
    """

    encoding: str
    delimiter: str
    above: tuple[Cells, ...] = ()
    heading: Cells = ()
    suffixes: tuple[str, ...] = ()
    thousands: str = ''
    remarks: tuple[str, ...] = ()
    losses: tuple[str, ...] = ()


def csv_reader(lines: Iterator[str], delimiter: str) -> Any:
    """Return a :mod:`csv` reader of lines; with a blank as the delimiter, several blanks count as one."""
    return csv.reader(lines, delimiter=delimiter, skipinitialspace=delimiter == ' ')


def detect_dialect(path: Path, extent: Extent) -> Dialect:
    """Return the layout of a text: encoding, delimiter, decimal sign and headings, or the kind of bus log.

    Raises:
        BagError: It is no table, of another format, or may be read in two ways.
    """
    encoding = encoding_of(extent.head)
    text = extent.head.decode(encoding, 'replace')
    if extent.size > len(extent.head):
        text = text[: text.rfind('\n') + 1]
    lines = lines_of(text)
    first, rest = lines[:_MAX_LINES], lines[_MAX_LINES:]
    # The tail begins within a line.
    last = lines_of(extent.tail.decode(encoding, 'replace'))[1:] or rest[-_MAX_LINES:]
    if kind := bus_log_of(first):
        return _bus_dialect(path, encoding, kind, first, last)
    if remedy := remedy_for_format(path, first):
        raise BagError(f"log '{path}' {remedy}")
    delimiter, rows = find_delimiter(first)
    if not rows:
        raise BagError(f"log '{path}' is not a table: no line has a comma, semicolon or tab between cells")
    return _table_dialect(path, encoding, delimiter, rows, _split_lines(last, delimiter))


def remedy_for_format(path: Path, lines: Sequence[str]) -> str:
    """Return the clause, without its subject, that lines are in a format that is not read; else empty.

    It says how to convert the file of that path. More than half of the first 200 lines decide, or a brace
    before all, perhaps behind a bracket.
    """
    text, file = ''.join(lines), shlex.quote(str(path))
    if begin := re.match(r'\s*(\[?)\s*\{', text):
        program = _JQ_OF_PACKAGE if '"TimeSeriesData"' in text else _JQ_OF_OBJECTS
        command = f"jq -c '.[]' {file} | jq -r '{program}'" if begin[1] else f"jq -r '{program}' {file}"
        return f'is JSON: write it as CSV with {command} > NEW.csv'
    forms = {
        form: f'has frames of NMEA 2000: convert it with canboat, {command} > {{1}}.json'
        for form, command in _FRAMES.items()
    }
    forms[_CAN_FRAME] = (
        'has frames of a CAN bus in a form that nothing converts: record NMEA 2000 with candump -L, and other'
        ' messages with a program that writes their values as CSV'
    )
    forms[r'[$!][A-Z]{5},[^*]*$'] = (
        'has sentences of NMEA 0183 without checksums: record them with these, without which a damaged one is'
        ' not known'
    )
    forms[r'^[^\s,=]+(,\S+)? [^\s,=]+=\S+ \d{10,19}$'] = (
        "has lines of InfluxDB: write them as CSV: influx -database NAME -execute 'SELECT * FROM MEASUREMENT'"
        ' -precision rfc3339 -format csv > {1}.csv'
    )
    first = lines[:200]
    counts = {form: sum(bool(re.search(form, line)) for line in first) for form in forms}
    form = max(counts, key=counts.__getitem__)
    return forms[form].format(file, shlex.quote(path.stem)) if counts[form] > 0.5 * len(first) else ''


def _table_dialect(
    path: Path, encoding: str, delimiter: str, rows: list[list[str]], tail: list[list[str]]
) -> Dialect:
    """Return the layout of a table by its first rows, with those above its numbers, and its last ones.

    Raises:
        BagError: No row has a time and a number, or the decimal sign is not certain.
    """
    width = usual_width(rows)
    decimal = _decimal_sign(path, [row for row in rows if len(row) == width], delimiter)
    first = _find_first_row(rows, decimal, width)
    if first is None:
        raise BagError(
            f"log '{path}' has no line with a time and a number: write CSV with a time such as"
            f" 2026-05-04T06:00:00Z in each line, not as '{' '.join(rows[-1])[:MAX_SHOWN]}'"
        )
    # Where signals have times of their own, the lines behind the end of one are short.
    if first > 0 and len(rows[first - 1]) == len(rows[first]) > width:
        width = len(rows[first])
    above, below = rows[:first], rows[first:]
    written, row_of_units = _find_headings(above, width)
    heading, units = _fit_headings(written, row_of_units, below, width)
    names = heading or [f'#{k + 1}' for k in range(width)]
    suffixes = [_unit_behind_numbers(below, k, names[k]) for k in range(width)]
    headings = [with_unit(names[k], units[k] or suffixes[k]) for k in range(width)]
    # A row may be longer or shorter than others.
    endings = [*suffixes, *[''] * max(map(len, (*below, *tail)))]
    below, tail = ([[*map(str.removesuffix, row, endings)] for row in part] for part in (below, tail))
    losses, remarks = list[str](), list[str]()
    if len(heading) > width:
        text = f'{len(heading)} headings stand above {width} cells: they were matched from the left'
        # A heading of a time that stands above no times was shifted by a word before all.
        times = [k for k, name in enumerate(heading[:width]) if TIME_WORDS.search(parse_heading(name).name)]
        numbers = [parse_number(row[k], decimal) or 0.0 for k in times[:1] for row in below if len(row) > k]
        if numbers in (sorted(numbers), sorted(numbers, reverse=True)):
            remarks.append(text)
        else:
            losses.append(f'{text}, so that no times stand below that of a time: write one for each')
    if written and not heading:
        losses.append(
            f'the {len(written)} headings were not used: below are {width} columns, and nothing tells which'
            ' has none; write one for each, or name columns by their numbers, as #2'
        )
    if lines := _lines_of_other_table(above, delimiter):
        losses.append(
            f"{plural(len(lines), 'line')} of another table above were not read, the first '{lines[0]}'"
        )
    plain = tuple(name for name, _ in headings)
    return Dialect(
        plain,
        tuple(map(parse_heading, plain)),
        tuple(unit for _, unit in headings),
        decimal,
        tuple(below),
        tuple(tail),
        encoding,
        delimiter,
        tuple(above),
        tuple(heading),
        tuple(suffixes),
        decimal if delimiter == ';' and _may_be_thousands(below, decimal) else '',
        tuple(remarks),
        tuple(losses),
    )


def encoding_of(head: bytes) -> str:
    """Return the Python name of the encoding of a text by its head: UTF-8, UTF-16, else Windows-1252.

    The head may end within a character.
    """
    for mark, encoding in _MARKS:
        if head.startswith(mark):
            return encoding
    try:
        codecs.getincrementaldecoder('utf-8')().decode(head)
    except UnicodeDecodeError:
        return 'cp1252'
    return 'utf-8'


def _split_lines(lines: Sequence[str], delimiter: str) -> list[list[str]]:
    """Return the rows of lines, as the cells of each; an empty list where csv refuses any of the lines."""
    try:
        return list(csv_reader(iter(lines), delimiter))
    except csv.Error:
        return []


def find_delimiter(lines: Sequence[str]) -> tuple[str, list[list[str]]]:
    """Return the delimiter that splits most lines into equally many cells with values; and their rows.

    A comma and an empty list where no delimiter makes two cells of any line.
    """
    tables = [(delimiter, _split_lines(lines, delimiter)) for delimiter in _DELIMITERS]
    tables = [(delimiter, rows) for delimiter, rows in tables if usual_width(rows) > 1]
    return max(tables, key=lambda table: _table_score(*table), default=(',', []))


def _table_score(delimiter: str, rows: Sequence[Cells]) -> float:
    """Return how well a delimiter splits rows: the share of those of equal width times that of values."""
    width = usual_width(rows)
    usual = [row for row in rows if len(row) == width]
    cells = [cell for row in usual[-50:] for cell in row if cell.strip()]
    values = sum(map(is_value, cells)) / max(len(cells), 1)
    # A blank stands between a date and its time, too.
    return len(usual) / len(rows) * (0.1 + values) * (0.9 if delimiter == ' ' else 1.0)


def usual_width(rows: Sequence[Cells]) -> int:
    """Return the most frequent number of cells among rows of two and more; 0 where none has two.

    Comments are not counted.
    """
    counts = Counter(len(row) for row in rows if len(row) > 1 and not row[0].startswith(COMMENTS))
    return counts.most_common(1)[0][0] if counts else 0


def headings_above(rows: Sequence[Cells]) -> list[str]:
    """Return the row of headings above the first row of numbers; an empty list where there is none."""
    decimal = ',' if any(_COMMA.fullmatch(cell) for row in rows for cell in row) else '.'
    width = usual_width(rows)
    first = _find_first_row(rows, decimal, width)
    return _find_headings(rows[:first], width)[0] if first else []


def is_row_of_units(row: Cells) -> bool:
    """Return whether a cell is a known unit, and all but forms of times are short, no numbers or headings."""
    names = [cell.strip() for cell in row if {*cell.lower()} - {*'ymdhnsf-/.:, '}]  # yyyy-mm-dd hh:nn:ss.fff
    words = [name for name in names if (unit_of(name) or unit_of(name, 'coefficient')) is None]
    is_plain = all(len(name) < 16 and parse_number(name) is None for name in words)
    return any(map(unit_of, row)) and is_plain and not any(parse_heading(name).known_unit for name in words)


def is_value(cell: str) -> bool:
    """Return whether a cell is a number, with a unit or without, a date or a time."""
    is_number = parse_number(cell, '.') is not None or parse_number(cell, ',') is not None
    return is_number or is_stamp(cell) or is_day(cell) or is_time(cell) or bool(_WITH_UNIT.fullmatch(cell))


def _decimal_sign(path: Path, rows: Sequence[Cells], delimiter: str) -> str:
    """Return the decimal sign of the cells of rows, '.' or ','; '.' where no number has any.

    Of cells that have one of them for certain the more count: the others may be damaged, and are ignored.
    What delimits the cells decides on numbers such as ``1,500``.

    Raises:
        BagError: The sign may as well be a separator of thousands.
    """
    cells = [_SPACES.sub('', cell.strip()) for row in rows for cell in row]
    with_points = [cell for cell in cells if '.' in cell and _NUMBER.fullmatch(cell.replace(',', ''))]
    commas, points = (sum(_has_decimal_comma(cell.translate(swap)) for cell in cells) for swap in ({}, _SWAP))
    if commas > points and not commas == 1 < len(with_points):
        return ','
    cells = [cell for cell in cells if not _has_decimal_comma(cell)]
    with_commas = [cell for cell in cells if _COMMA.fullmatch(cell)]
    if not with_commas or any(',' in cell for cell in with_points):
        return '.'  # 1,000.5
    has_points = any(delimiter == ',' or not _POINTS.fullmatch(cell) for cell in with_points)
    if has_points != (delimiter == ';'):
        return '.' if has_points else ','
    number, remedy = with_commas[0], ' alone' if has_points else ", or cells separated by ';'"
    raise BagError(
        f"log '{path}': '{number}' may be {number.replace(',', '.')} or {number.replace(',', '')}: write it"
        f' with a decimal point{remedy}'
    )


def _has_decimal_comma(cell: str) -> bool:
    """Return whether the comma of a number cannot separate thousands, as in '1.000,5', '12,5' and '0,125'."""
    if ',' in cell and _GROUPED.fullmatch(cell.translate(_SWAP)):
        return True
    is_grouped = _GROUPED.fullmatch(cell) and not cell.lstrip('+-').startswith('0,')
    return bool(_COMMA.fullmatch(cell)) and not is_grouped


def _may_be_thousands(rows: Sequence[Cells], decimal: str) -> bool:
    """Return whether the decimal sign may separate thousands in all cells that have it, at least in one."""
    cells = [cell.strip() for row in rows for cell in row if decimal in cell]
    plain = [cell.translate(_SWAP) if decimal == ',' else cell for cell in cells]
    numbers = [cell for cell in plain if _NUMBER.fullmatch(cell)]
    return bool(numbers) and all(map(_POINTS.fullmatch, numbers))


def _find_first_row(rows: Sequence[Cells], decimal: str, width: int) -> int | None:
    """Return the place of the first row of numbers of the table, below headings and a preamble.

    None where no row is one of numbers. Those of a preamble or of a statistic stand behind a word, and have
    headings below. ``width`` is the usual number of cells.
    """
    is_data = [_is_data(row, decimal, width) for row in rows]
    if not any(is_data):
        return None
    first = is_data.index(True)
    is_headed = len(_find_headings(rows[:first], width)[0]) >= width
    numbers = (k for k in range(first, len(rows)) if is_data[k])
    begin = next((k for k in numbers if not _may_be_preamble(rows[k], is_headed=is_headed)), len(rows))
    for k in range(first + 1, begin if is_headed else len(rows)):
        # A heading may stand above remarks that most lines leave out.
        is_wide = len(rows[k]) in (width, width + 1) and any(is_data[k:])
        is_words = is_wide and not any(not cell.strip() or is_value(cell) for cell in rows[k])
        if is_words and (k < begin or any(TIME_WORDS.search(parse_heading(cell).name) for cell in rows[k])):
            return is_data.index(True, k)
    return first


def _may_be_preamble(row: Cells, *, is_headed: bool) -> bool:
    """Return whether a row of numbers has a word before all and, below headings, no time beside a number."""
    return not is_value(row[0]) and not (is_headed and _has_time(row) and sum(map(is_value, row)) > 1)


def _has_time(row: Cells) -> bool:
    """Return whether a cell is a date with a time, or a time of the day."""
    return any(is_stamp(cell) or is_time(cell) for cell in row)


def _is_data(row: Cells, decimal: str, width: int) -> bool:
    """Return whether a row is one of numbers: it has a time, begins with a number, or has two of them.

    False for a comment, and for a row of less than ``width - 1`` cells.
    """
    if len(row) < min(width, 2) or len(row) < width - 1 or row[0].startswith(COMMENTS):
        return False
    numbers = [parse_number(cell, decimal) is not None for cell in row]
    return _has_time(row) or numbers[0] or sum(numbers) > 1


def _lines_of_other_table(above: Sequence[Cells], delimiter: str) -> list[str]:
    """Return the rows of numbers above the headings, with any delimiter: they are of another table.

    Each is a text of up to 60 characters, its cells joined by blanks. An empty list for less than two.
    """
    # An open quotation mark makes one cell of many lines.
    lines = '\n'.join(delimiter.join(row) for row in above).split('\n')
    tables = [
        [row for row in _split_lines(lines, mark) if sum(map(is_value, row)) > 1 and is_value(row[0])]
        for mark in _DELIMITERS
    ]
    longest = max(tables, key=len)
    return [' '.join(row)[:MAX_SHOWN] for row in longest] if len(longest) > 1 else []


def _fit_headings(
    heading: list[str], units: list[str], rows: Sequence[Cells], width: int
) -> tuple[list[str], list[str]]:
    """Return headings and units, filled up to the number of columns of the rows below them.

    A missing heading is an empty text at the end, and behind a date that of its time. Where the last column
    has numbers and no heading, none are returned, as which number has which is not known. Surplus headings
    that are units are joined to the ones before if the number is right then, and all units are empty; else
    they stay. No headings stay an empty list. The list of units may be longer than the columns.
    """
    if len(heading) > width:
        # A cell that is a unit belongs to the one before, as in 'Speed, rpm'.
        begins = [k for k, cell in enumerate(heading) if k == 0 or not unit_of(cell)]
        if len(begins) == width:
            ends = [*begins[1:], len(heading)]
            joined = [','.join(heading[begin:end]) for begin, end in zip(begins, ends, strict=True)]
            return joined, [''] * width
    if len(heading) == width - 1 > 0:
        whole_rows = [row for row in rows if len(row) == width]
        for k in range(1, width):
            if all(is_day(row[k - 1]) and is_time(row[k]) for row in whole_rows):
                # One heading stands above a date and its time.
                return [*heading[:k], '', *heading[k:]], [*units[:k], '', *units[k:]]
        if 2 * sum(is_value(row[-1]) for row in whole_rows) > len(whole_rows):
            return [], units
    return heading and [*heading, *[''] * (width - len(heading))], units


def _find_headings(above: Sequence[Cells], width: int) -> tuple[list[str], list[str]]:
    """Find the row of headings above the numbers, and a row of units below or above it.

    Returns:
        The headings, an empty list without any; and a unit for each column, an empty text where there is
        none: at least ``width`` of them, and more where there is a row of units.
    """
    named = [
        row
        for row in _rows_without_marks(above, width)
        # A line below headings has no letters.
        if any(map(str.isalpha, ''.join(row))) and not any(is_value(cell) for cell in row if cell.strip())
    ]
    if not named:
        return [], [''] * width
    units, names = _row_of_units(named)
    return _with_names_above(names, above), [*units, *[''] * width]


def _rows_without_marks(above: Sequence[Cells], width: int) -> list[Cells]:
    """Return the rows that are wide enough for headings and are no comments.

    Two cells must not be empty. If all of them are comments, those of the full width are returned without
    their marks. A cell that is only the mark of a comment is dropped from a row that is too wide.
    """
    wide = [row for row in above if len(row) >= max(width - 1, 2) and sum(map(bool, row)) > 1]
    bare = [row for row in wide if not (row[0].startswith(COMMENTS) and row[0].strip(_MARKS_OF_COMMENTS))]
    if not bare:
        bare = [[row[0].lstrip(_MARKS_OF_COMMENTS), *row[1:]] for row in wide if len(row) >= width]
    return [row[1:] if row[0].strip(_MARKS_OF_COMMENTS) == '' and len(row) > width else row for row in bare]


def _with_names_above(names: Cells, above: Sequence[Cells]) -> list[str]:
    """Return headings; where they repeat for each signal, put its name in place of that of its value.

    So ``Time;Value;Time;Value`` of a trend, below ``rpm;;load;``, becomes ``Time;rpm;Time;load``. Other
    headings are returned unchanged.
    """
    width = len(names)
    period = next((p for p in range(2, width) if [*names[p:]] == [*names[:-p]]), 0)
    for row in reversed(above):
        if not period or len(row) != width or [*row] == [*names]:
            continue
        places = [k for k in range(period) if all(cell.strip() for cell in row[k::period])]
        is_time = [bool(TIME_WORDS.search(parse_heading(name).name)) for name in names[:period]]
        if len(places) == 1 and len(set(row[places[0] :: period])) == width // period and not all(is_time):
            joined = [*names]
            joined[is_time.index(False) :: period] = [cell.strip() for cell in row[places[0] :: period]]
            return joined
    return [*names]


def _row_of_units(named: Sequence[Cells]) -> tuple[Cells, Cells]:
    """Find the row of units and the row of headings among rows of words, at least one, above the numbers.

    Returns:
        The lowest row of units, and the row above it (or the last row, where the units stand first) as the
        headings. Without a row of units an empty tuple, and the last row as the headings.
    """
    for k in reversed(range(len(named))):
        row, names = named[k], named[k - 1]
        if names is not row and len(names) == len(row) and is_row_of_units(row):
            return row, names
    return (), named[-1]


def _unit_behind_numbers(rows: Sequence[Cells], place: int, heading: str) -> str:
    """Return the unit behind most numbers of a column, with the blank before it; empty where there is none.

    The first 500 rows count. Letters right behind whole numbers are a unit only if it is a known one, and a
    single letter, even behind a blank, only below the heading of a force or a time: else the cells are names,
    as '1A' and '5s' of shafts. An 'N' is newtons only below the heading of a force.
    """
    cells = [row[place] for row in rows[:500] if place < len(row) and row[place].strip()]
    counts = Counter(match[1] for cell in cells if (match := _WITH_UNIT.fullmatch(cell)))
    suffix, count = counts.most_common(1)[0] if counts else ('', 0)
    unit, words = suffix.strip(), parse_heading(heading).name
    is_force = bool(FORCE_WORDS & {*words.split()})
    is_of_time = unit.lower() in TIME_UNITS and bool(TIME_WORDS.search(words))
    is_known = is_of_time or (unit_of(unit, 'force' * is_force) and (is_force or len(unit) > 1))
    is_whole = not any(mark in cell for cell in cells for mark in '.,')
    is_name = is_whole and not is_known and (suffix == unit or len(unit) == 1)
    is_north = unit == 'N' and not is_force
    return '' if is_north or is_name or count <= 0.5 * len(cells) else suffix


def _bus_dialect(path: Path, encoding: str, kind: str, first: Sequence[str], last: Sequence[str]) -> Dialect:
    """Return the layout of a log of a bus.

    Raises:
        BagError: No line has a time and a number.
    """
    rows, tail = (tuple(row for row in BUS_LOGS[kind](iter(lines)) if row) for lines in (first, last))
    if not rows:
        raise BagError(
            f"log '{path}': no line has a time and a number: record it with a time such as"
            ' 2026-05-04T06:00:00Z before each line'
        )
    return Dialect(
        NAMES, tuple(map(parse_heading, NAMES)), (None,) * len(NAMES), '.', rows, tail, encoding, kind
    )
