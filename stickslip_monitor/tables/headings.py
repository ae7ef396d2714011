# SPDX-License-Identifier: Apache-2.0
"""Headings, units and numbers as people write them in tables."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import NamedTuple

Cells = Sequence[str]

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
