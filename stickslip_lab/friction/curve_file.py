# SPDX-License-Identifier: Apache-2.0
"""Reads a measured friction curve from a CSV file, as test benches and spreadsheets write it."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from stickslip_lab import MAX_TABLE_BYTES
from stickslip_logs.tables.dialect import parse_heading, unit_of
from stickslip_logs.tables.small_table import TableRow, read_table
from stickslip_logs.units import affine_conversion, conversion, find_unit, names_of
from stickslip_monitor.arrays import FloatArray, IntArray
from stickslip_monitor.errors import FitError, plural
from stickslip_monitor.monitor.value_check import REQUIRED, Parameter, refused
from stickslip_monitor.physics.bearing import BearingSpeed
from stickslip_monitor.physics.lubrication import MAX_TEMPERATURE, MIN_TEMPERATURE

NAMES = {
    'std': 'std sigma σ sd stdev uncertainty deviation error',
    'weight': 'weight weights w',
    'coefficient': 'coefficient mu μ µ cof friction reibwert reibungszahl reibungskoeffizient',
    'load': 'load last belastung normalkraft normallast',
    'temperature': 'temperature temp temperatur wassertemperatur',
    'speed': 'speed velocity v n geschwindigkeit gleitgeschwindigkeit drehzahl',
}
"""By quantity the words of its headings: a heading is of the first quantity of which it has a word, unless it
has a word of another quantity."""
_OTHER_QUANTITIES = {'force', 'torque', 'moment', 'power', 'work', 'energy', 'heat', 'reibkraft'}
# Words that may stand beside those of a spread: 'standard error of the measurement', and not 'load error'.
_FILL_WORDS = {'standard', 'of', 'the', 'measurement'}

MAX_SIZE = 1e30
"""Numbers of a curve are smaller: their squares and cubes are still finite."""
_number = partial(Parameter, kind='float', default=REQUIRED, text='', maximum=MAX_SIZE)
_positive = partial(_number, minimum=0.0, above_minimum=True)
_RULES = {
    'speed': _number('speed', unit='m/s', minimum=0.0),
    'coefficient': _number('coefficient', minimum=-MAX_SIZE),
    'std': _positive('std'),
    'weight': _positive('weight'),
    'load': _positive('load', unit='N'),
    'temperature': _number('temperature', unit='C', minimum=MIN_TEMPERATURE, maximum=MAX_TEMPERATURE),
}
"""The rule of each quantity, in SI units and C."""
# By quantity: what its units measure, the unit that its numbers are turned into, and advice on any other
# unit.
_MEASURES = {
    'speed': (('turning', 'speed'), 'm/s', ''),
    'load': (('force',), 'N', ': of a pressure, times the projected area'),
    'temperature': (('temperature',), 'C', ''),
    'coefficient': (('coefficient',), '1', ': a coefficient is force over load'),
    'std': (('coefficient',), '1', ': that of the coefficient'),
}

# A number in whose groups of three a point or a comma may part thousands.
_GROUPED = re.compile(r'[+-]?[1-9]\d{0,2}(?:[.,]\d{3})+')
# Name and unit of 'speed [rpm]', 'speed, rpm', 'speed / rpm' or 'v / (m/s)'.
_HEADING = re.compile(r'(.*?)\s*(?:[\[(]([^\])]*)[\])]|,\s*(\S+)|\s/\s*\(?([^)]*)\)?)?\s*')
_BRACKETED = re.compile(r'[\[(]([^\])]*)[\])]')
MAX_POINTS = 20_000
"""Time and memory of a fit grow with its points: a bench that samples for long averages them."""


@dataclass(frozen=True, slots=True, eq=False)
class FrictionCurve:
    """A measured friction curve."""

    speed: FloatArray  # sliding speeds >= 0, in any order, shape (n,) [m/s]
    coefficient: FloatArray  # coefficients of friction, shape (n,) [-]
    # Standard deviation of each coefficient, of which only the ratios matter, shape (n,).
    std: FloatArray
    line: IntArray  # the line of the file that each point came from, shape (n,)
    unit: str  # the unit that the speeds were written in
    unit_source: str  # where that unit was found, for the user
    load: FloatArray | None = None  # load > 0 of each point, shape (n,) [N]; None: not in the file
    temperature: FloatArray | None = None  # of the water at each, shape (n,) [C]; None: not in the file


def read_curve(
    path: str | Path,
    columns: Mapping[str, str | None] | None = None,
    unit: str | None = None,
    journal_diameter: float | None = None,
) -> FrictionCurve:
    """Read a friction curve from a table.

    The table is read as a log is: by its delimiter, the headings below what stands above them, which may be
    a comment, and the units in these or in a line of their own. Between commas the decimal sign is a point.
    Weights are those of squared residuals, ``1/std^2``.

    Args:
        path: The file.
        columns: Headings by quantity of :data:`NAMES`; a quantity that is missing or ``None`` is recognised.
        unit: Unit of the speeds; by default the one in the heading, else m/s.
        journal_diameter: ``D`` > 0 [m], for speeds in a unit of turning.

    Returns:
        The points in the file's order, in SI units and C; ``std`` is 1 for all without a spread or weights.

    Raises:
        FitError: The file breaks a rule, the text names file, line, column, value and rule; both a ``std``
            and a ``weight`` column are named; ``unit`` differs from the heading's; or speeds are in a unit of
            turning and ``journal_diameter`` is ``None``.
        PhysicsError: ``journal_diameter`` is needed and not above 0.
    """
    rows, delimiter = _read_rows(path)
    where = f'{path}, line {rows[0].line}'
    chosen = _choose_columns(where, rows[0].cells, columns or {})
    headings = {quantity: rows[0].cells[index] for quantity, index in chosen.items()}
    _require_one_decimal_sign(path, rows[1:], chosen.values(), delimiter)
    unit, unit_source = _find_speed_unit(where, headings['speed'], unit)
    factor = conversion(unit, 'm/s')
    if factor is None:
        if journal_diameter is None:
            raise FitError(
                f"{path}: speeds in {unit} need the journal's diameter: give --journal-diameter in"
                ' m (or --config)'
            )
        factor = BearingSpeed(journal_diameter).factor(unit)
    values = {}
    for quantity, index in chosen.items():
        scale = factor, 0.0
        if quantity == 'weight':
            scale = 1.0, 0.0
        elif quantity != 'speed':
            si_unit = _MEASURES[quantity][1]
            written = _require_unit(where, quantity, headings[quantity])
            scale = affine_conversion(written or si_unit, si_unit) or scale
        numbers = [_parse_number(path, row, rows[0], index, quantity, scale, delimiter) for row in rows[1:]]
        values[quantity] = np.array(numbers)
    std = values.get('std', np.ones(len(rows) - 1))
    if 'weight' in values:
        std = values['weight'] ** -0.5
    lines = np.array([row.line for row in rows[1:]], dtype=np.int64)
    conditions = values.get('load'), values.get('temperature')
    return FrictionCurve(values['speed'], values['coefficient'], std, lines, unit, unit_source, *conditions)


def _read_rows(path: str | Path) -> tuple[list[TableRow], str]:
    """Return the rows, the headings with their units first, and the delimiter of their cells.

    Raises:
        FitError: The file cannot be read, has no points or more than :data:`MAX_POINTS`.
    """

    def is_heading(cells: list[str]) -> bool:
        """Return whether a row of cells names speed and coefficient."""
        quantities = {_find_quantity(_split_heading(cell)[0]) for cell in cells}
        return quantities >= {'speed', 'coefficient'}

    rows, delimiter = read_table(path, MAX_TABLE_BYTES, FitError, is_heading)
    if len(rows) > MAX_POINTS:
        raise FitError(
            f'{path} has {len(rows)} lines, and more than {MAX_POINTS} are not fitted: average'
            ' the points of equal speed'
        )
    if not rows:
        raise FitError(f'{path} is empty: it must have a line of headings and the points')
    if len(rows) == 1:
        raise FitError(f'{path} has headings (line {rows[0].line}) but no points')
    return rows, delimiter


def _split_heading(heading: str) -> tuple[list[str], str]:
    """Return the words of a heading in lower case without its unit, and the unit as written; '' for none.

    The abbreviation of a coefficient, as in 'friction (COF)', is neither.
    """
    match = _HEADING.fullmatch(heading)
    name, *units = match.groups() if match else (heading,)
    plain = name.replace('_', ' ').split()
    words, unit = name.replace('_', ' ').lower().split(), next(filter(None, units), '').strip()
    for count in (2, 1):  # 'velocity m s-1', 'velocity m/s', 'load kN', and a heading that is only a unit
        last = ''.join(plain[-count:])
        of_condition = (quantity := _find_quantity(words[:-count])) in ('load', 'temperature')
        if not unit and (_is_clear(last) or (of_condition and _find_unit(quantity, last))):
            return words[:-count], last
    if not unit:  # 'speed [rpm] of the shaft'
        unit = next(filter(_is_clear, _BRACKETED.findall(heading)), '')
    if _find_quantity([unit.lower()]) == 'coefficient':
        unit = ''  # 'Coefficient of friction (COF)'
    return words, unit


def _find_quantity(words: Iterable[str]) -> str:
    """Return the quantity of :data:`NAMES` that a heading names; '' for none or another one.

    ``words`` are those of the heading, in lower case.
    """
    present = set(words)
    name = next((name for name, text in NAMES.items() if present & {*text.split()}), '')
    if name in ('std', 'weight'):
        coefficient_words = f'{NAMES[name]} {NAMES["coefficient"]}'.split()
        return name if present <= {*coefficient_words} | _FILL_WORDS else ''
    if present >= {'normal', 'force'}:
        return 'load'
    return '' if present & _OTHER_QUANTITIES else name


def _is_clear(text: str) -> bool:
    """Return whether a text is a unit of speed or turning, or '%': no other word of a heading is one."""
    return text == '%' or _find_unit('speed', text) is not None


def _find_unit(quantity: str, text: str) -> str | None:
    """Return the name of the unit that a text spells; ``None`` for any that does not measure the quantity."""
    kinds = _MEASURES[quantity][0]
    unit = find_unit(text, kinds[0])
    return unit.name if unit and unit.quantity in kinds else None


def _require_unit(where: str, quantity: str, heading: str) -> str:
    """Return the name of the unit in the heading of a column; '' where it has none.

    Args:
        where: File and line, for the error.
        quantity: Quantity of the column, other than a weight.
        heading: Its heading.

    Raises:
        FitError: The unit does not measure the quantity.
    """
    written = _split_heading(heading)[1]
    unit = _find_unit(quantity, written)
    if written and unit is None:
        kinds, _, advice = _MEASURES[quantity]
        rule = f'one of {", ".join(name for kind in kinds for name in names_of(kind))}{advice}'
        raise refused(f"{where}, column '{heading}': unit", written, rule, FitError)
    return unit or ''


def _choose_columns(where: str, cells: list[str], columns: Mapping[str, str | None]) -> dict[str, int]:
    """Return the index of each quantity's column; a quantity without a column is not in it.

    Of a spread and a weight the named one is taken, else the spread.

    Args:
        where: File and line, for the error.
        cells: The headings.
        columns: Headings of quantities that are named; ``None`` for those to recognise.

    Raises:
        FitError: A spread and a weight are both named, speed or coefficient is missing, a column is in doubt,
            or it is unclear whether a heading's factor multiplies or divides.
    """
    named = {quantity: columns.get(quantity) for quantity in NAMES}
    if named['std'] is not None and named['weight'] is not None:
        raise FitError('give --std-column or --weight-column, not both')
    indexes = {q: _find_column(where, cells, q, named[q]) for q in NAMES}
    chosen = {quantity: index for quantity, index in indexes.items() if index is not None}
    if not chosen and all(re.fullmatch(r'[-+]?[\d.,]+(?:e[-+]?\d+)?', cell, re.I) for cell in cells):
        raise FitError(f"{where} has numbers and no headings: put a line 'speed [m/s],mu' before it")
    for quantity, hint in (('speed', ''), ('coefficient', ' (friction force over load)')):
        if quantity not in chosen:
            raise FitError(
                f'{where}: no column for the {quantity}{hint} among {str(cells)[1:-1]}: name it with'
                f' --{quantity}-column'
            )
    for heading in (cells[index] for index in chosen.values()):
        if parse_heading(heading).unit == heading.strip() and unit_of(heading) is None:
            raise FitError(
                f"{where}, column '{heading}': unclear whether numbers are multiplied or divided by the"
                ' factor: write the numbers themselves, under a heading without a factor'
            )
    if 'std' in chosen and 'weight' in chosen:
        del chosen['weight' if named['weight'] is None else 'std']
    return chosen


def _find_column(where: str, cells: list[str], quantity: str, named: str | None) -> int | None:
    """Return the index of the column of a quantity; ``None`` without one.

    Args:
        where: File and line, for the error.
        cells: The headings.
        quantity: The quantity.
        named: Its heading; ``None`` to recognise it.

    Raises:
        FitError: There are several, or none of the heading that is named.
    """
    candidates = _recognise_columns(cells, quantity) if named is None else _named_columns(cells, named)
    if len(candidates) > 1:
        several = str([cells[k] for k in candidates])[1:-1]
        raise FitError(
            f'{where}: several columns may be the {quantity}: {several}; name one with --{quantity}-column,'
            ' or write curves at several loads below each other, with a column for the load'
        )
    if not candidates and named is not None:
        raise FitError(f"{where}: --{quantity}-column '{named}' is none of the columns {str(cells)[1:-1]}")
    return candidates[0] if candidates else None


def _recognise_columns(cells: list[str], quantity: str) -> list[int]:
    """Return the indices of the columns whose headings name a quantity; of several those without other words.

    For speed, where no heading names it, columns headed by a unit alone.
    """
    split = [_split_heading(cell) for cell in cells]
    candidates = [k for k, (words, _) in enumerate(split) if _find_quantity(words) == quantity]
    # 'speed' before 'speed setpoint'.
    plain = [k for k in candidates if {*split[k][0]} <= {*NAMES[quantity].split()}]
    if not candidates and quantity == 'speed':
        return [k for k, (words, unit) in enumerate(split) if not words and unit]
    return plain or candidates


def _named_columns(cells: list[str], heading: str) -> list[int]:
    """Return the indices of the columns headed exactly so, else of those with the same words."""
    same = [k for k, cell in enumerate(cells) if cell == heading]
    words = _split_heading(heading)[0]
    return same or [k for k, cell in enumerate(cells) if _split_heading(cell)[0] == words]


def _find_speed_unit(where: str, heading: str, option: str | None) -> tuple[str, str]:
    """Return the unit of the speeds, and where it was found, in words.

    Args:
        where: File and line, for the error.
        heading: Heading of the speeds.
        option: Unit that the user gave; ``None`` for that of the heading, or m/s without one.

    Raises:
        FitError: The unit of the heading is no speed's, or differs from the option.
    """
    unit = _require_unit(where, 'speed', heading)
    if option is not None and unit and option != unit:
        raise FitError(
            f"{where}, column '{heading}' is in {unit}, and --speed-unit says {option}: they must agree"
        )
    if option is not None:
        return option, '--speed-unit'
    return (unit, 'the heading') if unit else ('m/s', 'assumed: the heading states none')


def _require_one_decimal_sign(
    path: str | Path, rows: Sequence[TableRow], columns: Iterable[int], delimiter: str
) -> None:
    """Raise FitError if both points and commas occur and one may part thousands, as in 1.200 and 0,15.

    Args:
        path: The file, for the error.
        rows: The rows below the headings.
        columns: Indices of the columns to look at.
        delimiter: Delimiter of the cells; between commas nothing is in doubt.
    """
    chosen = set(columns)
    cells = [(row.line, row.cells[k]) for row in rows for k in chosen if k < len(row.cells)]
    points, commas = ([cell for cell in cells if sign in cell[1]] for sign in '.,')
    may_part = any(all(_GROUPED.fullmatch(text) for _, text in marked) for marked in (points, commas))
    if points and commas and may_part and delimiter != ',':
        (line, point), (second_line, comma) = points[0], commas[0]
        raise FitError(
            f"{path}: '{point}' (line {line}) has a point and '{comma}' (line {second_line}) a comma:"
            ' which parts thousands? Write numbers with a decimal sign and no other'
        )


def _parse_number(
    path: str | Path,
    row: TableRow,
    headings: TableRow,
    index: int,
    quantity: str,
    scale: tuple[float, float],
    delimiter: str,
) -> float:
    """Return the number in a cell, converted to N, C or m/s, or plain.

    Args:
        path: The file, for the error.
        row: The row.
        headings: The row of headings.
        index: Index of the column.
        quantity: Its quantity, whose rule the number must keep.
        scale: Factor and summand of the conversion.
        delimiter: Delimiter of the cells: between commas the decimal sign is a point.

    Raises:
        FitError: There is no cell or no number, or it breaks the rule of its quantity.
    """
    where = f"{path}, line {row.line}, column '{headings.cells[index]}'"
    if index >= len(row.cells):
        raise FitError(
            f'{where}: the line has {plural(len(row.cells), "cell")} and the headings'
            f' {len(headings.cells)}: no value is there'
        )
    text, rule = row.cells[index], _RULES[quantity]
    try:
        number = float(text if delimiter == ',' else text.replace(',', '.')) * scale[0] + scale[1]
        return float(rule.checked(where, {where: number}))
    except ValueError:
        raise refused(where, text, rule.rule(), FitError) from None
