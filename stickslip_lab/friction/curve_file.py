# SPDX-License-Identifier: Apache-2.0
"""Reads a measured friction curve from a CSV file, as test benches and spreadsheets write it."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from stickslip_logs.tables.dialect import parse_heading, unit_of
from stickslip_logs.tables.whole_table import TableRow, read_table
from stickslip_logs.units import factors_of, names_of
from stickslip_monitor.arrays import FloatArray, IntArray
from stickslip_monitor.errors import FitError, plural
from stickslip_monitor.physics.bearing import SPEED_UNITS, BearingSpeed

NAMES = {
    'std': 'std sigma σ sd stdev uncertainty deviation error',
    'weight': 'weight weights w',
    'coefficient': 'coefficient mu μ µ cof friction reibwert reibungszahl reibungskoeffizient',
    'load': 'load last belastung normalkraft normallast',
    'temperature': 'temperature temp temperatur wassertemperatur',
    'speed': 'speed velocity v n geschwindigkeit gleitgeschwindigkeit drehzahl',
}
"""The words that a heading is recognised by: it is the first quantity of which it has one, with no
word of another quantity."""
_OTHERS = {'force', 'torque', 'moment', 'power', 'work', 'energy', 'heat', 'reibkraft'}
# Beside the words of a coefficient: 'load error', 'weight loss' and 'speed std' are none of it.
_BESIDE = {'standard', 'of', 'the', 'measurement'}

_LINEAR = factors_of(*names_of('speed'))
# By the unit of a coefficient what it is multiplied by.
_SHARES = {'': 1.0, '-': 1.0, '1': 1.0, 'n/n': 1.0, '%': 0.01, 'percent': 0.01}
_GROUPED = re.compile(r'[+-]?[1-9]\d{0,2}(?:[.,]\d{3})+')
# 'speed [rpm]', 'speed, rpm', 'speed / rpm' or 'v / (m/s)'.
_HEADING = re.compile(r'(.*?)\s*(?:[\[(]([^\])]*)[\])]|,\s*(\S+)|\s/\s*\(?([^)]*)\)?)?\s*')
_BRACKETED = re.compile(r'[\[(]([^\])]*)[\])]')
# The squares and cubes of what is below are still numbers.
_TOO_LARGE = 1e30
# Time and memory of a fit grow with its points; a bench that samples for long averages them.
_MOST_POINTS = 20_000
_LARGEST = 16 << 20


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
    load: FloatArray | None = None  # load of each point, shape (n,) [N]; None: not told
    temperature: FloatArray | None = None  # of the water at each, shape (n,) [C]; None: not told


def read_curve(
    path: str | Path,
    columns: Mapping[str, str | None] | None = None,
    unit: str | None = None,
    journal_diameter: float | None = None,
) -> FrictionCurve:
    """Read a curve.

    The table is read as a log is: by its delimiter, the headings below what stands above them, which may be
    a comment, and the units in these or in a line of their own. Between commas the decimal sign is a point.
    Weights are those of squared residuals, ``1/std^2``.

    Args:
        path: The file.
        columns: The headings of some quantities of :data:`NAMES`; by default they are recognised.
        unit: Unit of the speeds; by default the one in the heading, else m/s.
        journal_diameter: ``D`` > 0 [m], for speeds in a unit of turning.

    Raises:
        FitError: The file breaks a rule; the text names file, line, column, value and rule.
    """
    rows, delimiter = _read_rows(path)
    where = f'{path}, line {rows[0].line}'
    chosen = _choose_columns(where, rows[0].cells, columns or {})
    headings = {quantity: rows[0].cells[index] for quantity, index in chosen.items()}
    _require_one_decimal_sign(path, rows[1:], chosen.values(), delimiter)
    unit, source = _find_unit(where, headings['speed'], unit)
    if unit not in _LINEAR and journal_diameter is None:
        raise FitError(
            f"{path}: speeds in {unit} need the journal's diameter: give --journal-diameter in"
            ' m (or --config)'
        )
    factor = _LINEAR.get(unit) or BearingSpeed(journal_diameter or 0.0).factor(unit)
    values = {
        quantity: np.array(
            [_parse_number(path, row, rows[0], index, quantity, delimiter) for row in rows[1:]]
        )
        for quantity, index in chosen.items()
    }
    for name in ('coefficient', 'std'):
        if name in values:
            values[name] *= _coefficient_factor(where, headings[name])
    for name in ('load', 'temperature'):
        if name in values:
            values[name] = _in_unit(where, name, headings[name], values[name])
    std = values.get('std', np.ones(len(rows) - 1))
    if 'weight' in values:
        std = values['weight'] ** -0.5
    lines = np.array([row.line for row in rows[1:]], dtype=np.int64)
    conditions = values.get('load'), values.get('temperature')
    speed = values['speed'] * factor
    return FrictionCurve(speed, values['coefficient'], std, lines, unit, source, *conditions)


def _read_rows(path: str | Path) -> tuple[list[TableRow], str]:
    """Return the rows, the headings with their units first, and what separates their cells."""

    def is_heading(cells: list[str]) -> bool:
        found = {_find_quantity(_split_heading(cell)[0]) for cell in cells}
        return found >= {'speed', 'coefficient'}

    rows, delimiter = read_table(path, _LARGEST, FitError, is_heading)
    if len(rows) > _MOST_POINTS:
        raise FitError(
            f'{path} has {len(rows)} lines, and more than {_MOST_POINTS} are not fitted: average'
            ' the points of equal speed'
        )
    if not rows:
        raise FitError(f'{path} is empty: it must have a line of headings and the points')
    if len(rows) == 1:
        raise FitError(f'{path} has headings (line {rows[0].line}) but no points')
    return rows, delimiter


def _split_heading(heading: str) -> tuple[list[str], str]:
    """Return the words of a heading in lower case, and its unit as it is written."""
    match = _HEADING.fullmatch(heading)
    name, *units = match.groups() if match else (heading,)
    words, unit = name.replace('_', ' ').lower().split(), next(filter(None, units), '').strip()
    for count in (2, 1):  # 'velocity m s-1', 'velocity m/s', and a heading that is nothing but a unit
        last = ''.join(words[-count:])
        if not unit and (_speed_unit(last) or last == '%'):
            return words[:-count], last
    if not unit:  # 'speed [rpm] of the shaft'
        unit = next((text for text in _BRACKETED.findall(heading) if _speed_unit(text) or text == '%'), '')
    if _find_quantity([unit.lower()]) == 'coefficient':
        unit = ''  # 'Coefficient of friction (COF)'
    return words, unit


def _find_quantity(words: Iterable[str]) -> str:
    """Return the quantity that a heading of some words is of; '' for none."""
    present = set(words)
    name = next((name for name, text in NAMES.items() if present & {*text.split()}), '')
    if name in ('std', 'weight'):
        coefficient_words = f'{NAMES[name]} {NAMES["coefficient"]}'.split()
        return name if present <= {*coefficient_words} | _BESIDE else ''
    if present >= {'normal', 'force'}:
        return 'load'
    return '' if present & _OTHERS else name


def _speed_unit(text: str) -> str | None:
    """Return a unit of speed as this program writes it; None for any other text."""
    unit = unit_of(text)
    return unit if unit in _LINEAR or unit in SPEED_UNITS else None


def _choose_columns(where: str, cells: list[str], columns: Mapping[str, str | None]) -> dict[str, int]:
    """Return the index of each quantity's column; std and weight only where there is one."""
    named = {quantity: columns.get(quantity) for quantity in NAMES}
    if named['std'] is not None and named['weight'] is not None:
        raise FitError('give --std-column or --weight-column, not both')
    indexes = {q: _find_column(where, cells, q, named[q]) for q in NAMES}
    chosen = {quantity: index for quantity, index in indexes.items() if index is not None}
    if not chosen and all(map(_is_number, cells)):
        raise FitError(f"{where} has numbers and no headings: put a line 'speed [m/s],mu' before it")
    for quantity in ('speed', 'coefficient'):
        if quantity not in chosen:
            raise FitError(
                f'{where}: no column for the {quantity} among {str(cells)[1:-1]}: name it with'
                f' --{quantity}-column'
            )
    for heading in (cells[index] for index in chosen.values()):
        if parse_heading(heading).unit == heading.strip() and unit_of(heading) is None:
            raise FitError(
                f"{where}, column '{heading}': whether the numbers are to be multiplied or divided by the"
                ' factor is not said: write the numbers themselves'
            )
    if 'std' in chosen and 'weight' in chosen:
        del chosen['weight' if named['weight'] is None else 'std']
    return chosen


def _find_column(where: str, cells: list[str], quantity: str, named: str | None) -> int | None:
    split = [_split_heading(cell) for cell in cells]
    if named is None:
        candidates = [k for k, (words, _) in enumerate(split) if _find_quantity(words) == quantity]
        # 'speed' before 'speed setpoint'.
        plain = [k for k in candidates if {*split[k][0]} <= {*NAMES[quantity].split()}]
        candidates = plain or candidates
        if not candidates and quantity == 'speed':
            candidates = [k for k, (words, unit) in enumerate(split) if not words and unit]
    else:
        candidates = [k for k, cell in enumerate(cells) if cell == named]
        candidates = candidates or [
            k for k, (words, _) in enumerate(split) if words == _split_heading(named)[0]
        ]
    if len(candidates) > 1:
        several = str([cells[k] for k in candidates])[1:-1]
        raise FitError(
            f'{where}: several columns may be the {quantity}: {several}; name one with --{quantity}-column'
        )
    if not candidates and named is not None:
        raise FitError(f"{where}: --{quantity}-column '{named}' is none of the columns {str(cells)[1:-1]}")
    return candidates[0] if candidates else None


def _find_unit(where: str, heading: str, option: str | None) -> tuple[str, str]:
    """Return the unit of the speeds and where it was found."""
    written = _split_heading(heading)[1]
    unit = _speed_unit(written)
    if written and unit is None:
        units = ', '.join(dict.fromkeys((*SPEED_UNITS, *_LINEAR)))
        raise FitError(f"{where}, column '{heading}': unit '{written}' must be one of {units}")
    if option is not None and unit is not None and option != unit:
        raise FitError(
            f"{where}, column '{heading}' is in {unit}, and --speed-unit says {option}: they must agree"
        )
    if option is not None:
        return option, '--speed-unit'
    return (unit, 'the heading') if unit else ('m/s', 'assumed: the heading states none')


def _coefficient_factor(where: str, heading: str) -> float:
    """Return the factor of a coefficient in the heading's unit: percent or no unit."""
    unit = _split_heading(heading)[1].lower()
    if unit not in _SHARES:
        raise FitError(
            f"{where}, column '{heading}': unit '{unit}' must be %, or none: a coefficient is force over load"
        )
    return _SHARES[unit]


_CONDITION_UNITS = {
    'load': {'': (1.0, 0.0), 'n': (1.0, 0.0), 'kn': (1000.0, 0.0)},
    'temperature': {
        **dict.fromkeys(('', 'c', '°c', 'degc', 'deg c', 'celsius'), (1.0, 0.0)),
        'k': (1.0, -273.15),
        **dict.fromkeys(('f', '°f', 'degf'), (5.0 / 9.0, -160.0 / 9.0)),
    },
}
"""By quantity and unit in lower case, what makes N and C of a number: factor and summand."""


def _in_unit(where: str, quantity: str, heading: str, values: FloatArray) -> FloatArray:
    """Convert loads to N and temperatures to C."""
    unit, units = _split_heading(heading)[1].lower(), _CONDITION_UNITS[quantity]
    if unit not in units:
        names = 'N or kN' if quantity == 'load' else 'C, K or F'
        raise FitError(f"{where}, column '{heading}': unit '{unit}' must be {names}")
    factor, summand = units[unit]
    return values * factor + summand


def _require_one_decimal_sign(
    path: str | Path, rows: Sequence[TableRow], columns: Iterable[int], delimiter: str
) -> None:
    """Refuse points beside commas where one may part thousands: '1.200' is 1200 where 0.15 is '0,15'."""
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


def _is_number(text: str) -> bool:
    return re.fullmatch(r'[-+]?[\d.,]+(?:e[-+]?\d+)?', text, re.IGNORECASE) is not None


def _parse_number(
    path: str | Path, row: TableRow, headings: TableRow, index: int, quantity: str, delimiter: str
) -> float:
    """Parse one cell as a number that keeps the rule of its quantity."""
    where = f"{path}, line {row.line}, column '{headings.cells[index]}'"
    if index >= len(row.cells):
        raise FitError(
            f'{where}: the line has {plural(len(row.cells), "cell")} and the headings'
            f' {len(headings.cells)}: no value is there'
        )
    text = row.cells[index]
    plain = text.replace(',', '.') if delimiter != ',' else text
    try:
        value = float(plain)
    except ValueError:
        raise FitError(f"{where}: '{text}' must be a number") from None
    if not abs(value) < _TOO_LARGE:
        raise FitError(f"{where}: '{text}' must be a finite number below {_TOO_LARGE:g}")
    if quantity == 'speed' and value < 0.0:
        raise FitError(f"{where}: '{text}' must not be negative: give the amount of the speed")
    if quantity in ('std', 'weight') and not value > 1.0 / _TOO_LARGE:
        raise FitError(f"{where}: '{text}' must be greater than 0")
    return value
