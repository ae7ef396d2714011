# SPDX-License-Identifier: Apache-2.0
"""Reads a measured friction curve from a CSV file, as test benches and spreadsheets write it."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from stickslip_monitor.arrays import FloatArray, IntArray
from stickslip_monitor.errors import FitError, plural
from stickslip_monitor.files import TableRow, read_table
from stickslip_monitor.physics.bearing import SPEED_UNITS, BearingSpeed

NAMES = {
    'speed': 'speed; velocity; v; sliding speed; sliding velocity; relative speed; relative velocity;'
    ' surface speed; shaft speed; n',
    'coefficient': 'coefficient; mu; μ; cof; friction; friction coefficient; coefficient of friction',
    'std': 'std; sigma; σ; sd; uncertainty; standard deviation; coefficient std; mu std; std mu',
    'weight': 'weight; weights; w',
}
"""The headings by which each quantity is recognised, in lower case and without their unit."""

_LINEAR = {'m/s': 1.0, 'mm/s': 1e-3, 'cm/s': 1e-2, 'um/s': 1e-6}
_OTHER = {'m s-1': 'm/s', '1/s': 'Hz', 'r/min': 'rpm', '1/min': 'rpm', 'rev/min': 'rpm', 'min-1': 'rpm'}
_UNITS = {unit.lower(): unit for unit in (*SPEED_UNITS, *_LINEAR)} | _OTHER
_HEADING = re.compile(r'(.*?)\s*[\[(]([^\])]*)[\])]\s*')
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


def read_curve(
    path: str | Path,
    columns: Mapping[str, str | None] | None = None,
    unit: str | None = None,
    journal_diameter: float | None = None,
) -> FrictionCurve:
    """Read a curve.

    Cells are separated by comma, semicolon or tab; with the latter two the decimal sign may be a
    comma. Blank lines and lines that start with ``#`` are skipped. The first other line has the
    headings, which may have a unit in brackets: ``speed [rpm]``. Weights are those of squared
    residuals, ``1/std^2``.

    Args:
        path: The file.
        columns: The headings of some quantities of :data:`NAMES`; by default they are recognised.
        unit: Unit of the speeds; by default the one in the heading, else m/s.
        journal_diameter: ``D`` > 0 [m], for speeds in a unit of turning.

    Raises:
        FitError: The file breaks a rule; the text names file, line, column, value and rule.
    """
    rows, delimiter = read_table(path, _LARGEST, FitError)
    if len(rows) > _MOST_POINTS:
        raise FitError(
            f'{path} has {len(rows)} lines, and more than {_MOST_POINTS} are not fitted: average'
            ' the points of equal speed'
        )
    if not rows:
        raise FitError(f'{path} is empty: it must have a line of headings and the points')
    if len(rows) == 1:
        raise FitError(f'{path} has headings (line {rows[0].line}) but no points')
    where = f'{path}, line {rows[0].line}'
    chosen = _choose(where, rows[0].cells, columns or {})
    headings = {quantity: rows[0].cells[index] for quantity, index in chosen.items()}
    unit, source = _unit(where, headings['speed'], unit)
    if unit not in _LINEAR and journal_diameter is None:
        raise FitError(
            f"{path}: speeds in {unit} need the journal's diameter: give --journal-diameter in"
            ' m (or --config)'
        )
    factor = _LINEAR.get(unit) or BearingSpeed(journal_diameter or 0.0).factor(unit)
    values = {
        quantity: np.array([_number(path, row, rows[0], index, quantity, delimiter) for row in rows[1:]])
        for quantity, index in chosen.items()
    }
    for name in ('coefficient', 'std'):
        if name in values:
            values[name] *= _share(where, headings[name])
    std = values.get('std', np.ones(len(rows) - 1))
    if 'weight' in values:
        std = values['weight'] ** -0.5
    lines = np.array([row.line for row in rows[1:]], dtype=np.int64)
    return FrictionCurve(values['speed'] * factor, values['coefficient'], std, lines, unit, source)


def _split(heading: str) -> tuple[str, str]:
    """A heading's name in lower case, and its unit."""
    match = _HEADING.fullmatch(heading)
    name, unit = match.groups() if match else (heading, '')
    name = ' '.join(name.replace('_', ' ').lower().split())
    if not unit:
        # 'velocity m/s', and a heading that is nothing but a unit: 'rpm'.
        for written in (*_UNITS, '%'):
            if name == written or name.endswith(f' {written}'):
                return name.removesuffix(written).strip(), written
    return name, unit.strip()


def _choose(where: str, cells: list[str], columns: Mapping[str, str | None]) -> dict[str, int]:
    """The index of each quantity's column; std and weight only where there is one."""
    asked = {quantity: columns.get(quantity) for quantity in NAMES}
    if asked['std'] is not None and asked['weight'] is not None:
        raise FitError('give --std-column or --weight-column, not both')
    found = {q: _index(where, cells, q, asked[q]) for q in NAMES}
    chosen = {quantity: index for quantity, index in found.items() if index is not None}
    for quantity in ('speed', 'coefficient'):
        if quantity not in chosen:
            raise FitError(
                f'{where}: no column for the {quantity} among {str(cells)[1:-1]}: name it with'
                f' --{quantity}-column'
            )
    if 'std' in chosen and 'weight' in chosen:
        del chosen['weight' if asked['weight'] is None else 'std']
    return chosen


def _index(where: str, cells: list[str], quantity: str, asked: str | None) -> int | None:
    wanted = NAMES[quantity].split('; ') if asked is None else [_split(asked)[0]]
    found = [k for k, cell in enumerate(cells) if cell == asked]
    found = found or [k for k, cell in enumerate(cells) if _split(cell)[0] in wanted]
    if not found and quantity == 'speed' and asked is None:
        found = [k for k, cell in enumerate(cells) if _split(cell)[0] == '' and cell]
    if len(found) > 1:
        several = str([cells[k] for k in found])[1:-1]
        raise FitError(
            f'{where}: several columns may be the {quantity}: {several}; name one with --{quantity}-column'
        )
    if not found and asked is not None:
        raise FitError(f"{where}: --{quantity}-column '{asked}' is none of the columns {str(cells)[1:-1]}")
    return found[0] if found else None


def _unit(where: str, heading: str, asked: str | None) -> tuple[str, str]:
    """The unit of the speeds and where it was found."""
    written = _split(heading)[1]
    unit = _UNITS.get(' '.join(written.lower().split()))
    if written and unit is None:
        raise FitError(
            f"{where}, column '{heading}': unit '{written}' must be one of {', '.join(SPEED_UNITS)}"
        )
    if asked is not None and unit is not None and asked != unit:
        raise FitError(
            f"{where}, column '{heading}' is in {unit}, and --speed-unit says {asked}: they must agree"
        )
    if asked is not None:
        return asked, '--speed-unit'
    return (unit, 'the heading') if unit else ('m/s', 'assumed: the heading states none')


def _share(where: str, heading: str) -> float:
    """What a coefficient in the heading's unit is multiplied by: percent, or none."""
    unit = _split(heading)[1].lower()
    if unit not in ('', '-', '1', 'n/n', '%', 'percent'):
        raise FitError(
            f"{where}, column '{heading}': unit '{unit}' must be %, or none: a coefficient is force over load"
        )
    return 0.01 if unit in ('%', 'percent') else 1.0


def _number(
    path: str | Path, row: TableRow, headings: TableRow, index: int, quantity: str, delimiter: str
) -> float:
    """One cell as a number that keeps the rule of its quantity."""
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
