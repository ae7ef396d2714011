# SPDX-License-Identifier: Apache-2.0
"""What a part of the benchmarks hands over: a section of the page."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

NOT_INSTALLED = 'not installed'


@dataclass(frozen=True, slots=True)
class Table:
    """A section of benchmarks/results.md.

    Attributes:
        title: Its heading.
        text: What is compared, and how; Markdown above the table.
        columns: The table's headings; the first column is text, the others are numbers.
        rows: Its cells.
        notes: What remains the cost; Markdown below the table.
    """

    title: str
    text: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    notes: str = ''

    def __post_init__(self) -> None:
        for row in self.rows:
            if len(row) != len(self.columns):
                raise ValueError(f'row {row} must have {len(self.columns)} cells')

    def markdown(self) -> str:
        """Return the section."""
        aligned = ['---', *['---:'] * (len(self.columns) - 1)]
        lines = [format_row(self.columns), f'|{"|".join(aligned)}|', *map(format_row, self.rows)]
        blocks = [f'## {self.title}', self.text, '\n'.join(lines), self.notes]
        return '\n\n'.join(block for block in blocks if block) + '\n'

    def record(self) -> dict[str, Any]:
        """Return plain values, for :meth:`of`."""
        return asdict(self)

    @classmethod
    def of(cls, record: dict[str, Any]) -> Table:
        """Return the table of a record."""
        return cls(**record)


def format_row(cells: Iterable[str]) -> str:
    """Return a row of a table in Markdown."""
    return f'| {" | ".join(cells)} |'


def absent(name: str, columns: int, reason: str = NOT_INSTALLED) -> list[str]:
    """Return the row of a peer that did not run."""
    return [name, reason, *['–'] * (columns - 2)]


def duration(seconds: float) -> str:
    """Return a time or a difference of times for a person, in three digits."""
    if seconds < 0.0:
        return f'-{duration(-seconds)}'
    for unit, size in (('s', 1.0), ('ms', 1e-3), ('µs', 1e-6)):
        if seconds >= size:
            return f'{seconds / size:.3g} {unit}'
    return f'{seconds * 1e9:.3g} ns'


def ratio(value: float) -> str:
    """Return how many times as much, in two digits."""
    return f'{value:.0f} ×' if value >= 9.95 else f'{value:.2g} ×'
