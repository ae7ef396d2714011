# SPDX-License-Identifier: Apache-2.0
"""Columns that tell rows apart: of which shaft, vessel or device each is."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from stickslip_logs.arrays import FloatArray, IntArray
from stickslip_logs.tables.cell_times import Cells
from stickslip_logs.tables.dialect import parse_heading, parse_number, unit_of

# More words are names of files, events or remarks: a fleet's list of ships is shorter.
_MAX_WORDS = 100
# Rows that share a time with another, and changes of the word between rows that follow: of more of them the
# column tells two things apart. Of a state few do.
_MIN_SHARED, _MIN_CHANGES = 0.1, 0.5
# Rows of one time and one word: more are samples of one thing, whose times are too coarse.
_MAX_TWICE = 0.05
# Two things are so many times further apart than each is from its last row; samples in one second are not.
_MIN_RATIO = 3.0
# Smaller steps back are late rows [ns].
_MIN_STEP_NS = 10**9


def is_same_key(cell: str, value: str) -> bool:
    """Return whether a cell is a value as a configuration writes it: ``1`` is ``01`` and ``1.0``."""
    if cell.strip() == value.strip():
        return True
    number = parse_number(value)
    return number is not None and number == parse_number(cell)


def find_key_column(
    rows: Sequence[Cells], time_ns: IntArray, column: int, headings: Sequence[str], places: Iterable[int]
) -> int | None:
    """Find the column of words by which rows are of several things; None where there is none.

    It has different words in rows of one time, or another word in most rows than in the one before; rows
    where it is empty say nothing. Whole numbers without a unit tell rows apart if the values of one time
    differ by more than they change.

    Args:
        rows: The rows that have a value and a time.
        time_ns: Times of the rows [ns], shape (n,).
        column: The column of the values.
        headings: The headings of the columns.
        places: The columns that may be it.
    """
    for place in places:
        cells = [row[place].strip() if place < len(row) else '' for row in rows]
        filled = [k for k, cell in enumerate(cells) if cell]
        words = [cells[k] for k in filled]
        numbers = {word: k for k, word in enumerate(dict.fromkeys(words))}
        if not 2 <= len(numbers) <= min(_MAX_WORDS, max(len(words) // 2, 2)):
            continue
        key, own_ns = np.array([numbers[word] for word in words]), time_ns[filled]
        order = np.lexsort((key, own_ns))
        is_shared = np.diff(own_ns[order]) == 0
        is_twice = is_shared & (np.diff(key[order]) == 0)
        shared = int(np.count_nonzero(is_shared & ~is_twice))
        is_apart = shared >= max(2, _MIN_SHARED * len(words)) and is_twice.sum() <= _MAX_TWICE * len(words)
        are_words = not any(map(_is_number, numbers))
        if are_words:
            changes = int(np.count_nonzero(np.diff(key)))
            if is_apart or changes > max(2, _MIN_CHANGES * len(words)):
                return place
        elif is_apart and _are_ids(numbers, headings[place]):
            texts = [str(rows[k][column]) for k in filled]
            values = [parse_number(text) or parse_number(text, ',') or 0.0 for text in texts]
            if _differ(own_ns, key, np.array(values)):
                return place
    return None


def _is_number(word: str) -> bool:
    """Return whether a text is a number, whole or with a decimal sign, perhaps with a known unit behind."""
    number, _, unit = word.partition(' ')
    texts = (word, number) if unit_of(unit) else (word,)
    return any(parse_number(text, sign) is not None for text in texts for sign in '.,')


def _are_ids(words: Iterable[str], heading: str) -> bool:
    return parse_heading(heading).unit is None and all(word.isdecimal() for word in words)


def _differ(time_ns: IntArray, key: IntArray, value: FloatArray) -> bool:
    """Return whether values of one time are further apart than those that follow of one key."""
    by_time, by_key = np.lexsort((key, time_ns)), np.lexsort((time_ns, key))
    beside = np.abs(np.diff(value[by_time]))[np.diff(time_ns[by_time]) == 0]
    behind = np.abs(np.diff(value[by_key]))[np.diff(key[by_key]) == 0]
    return bool(beside.size and np.median(beside) > _MIN_RATIO * (np.median(behind) if behind.size else 0.0))


def find_end_columns(head: Sequence[Cells], tail: Sequence[Cells], width: int) -> list[int]:
    """Return the columns with one text in the head of a table and another one in its tail."""
    if not head or not tail:
        return []
    first, last = ([*rows[0], *[''] * width] for rows in (head, tail))
    changed = [k for k in range(width) if first[k] != last[k]]
    pairs = ((head, first), (tail, last))
    return [
        k for k in changed if all(row[k] == end[k] for rows, end in pairs for row in rows if k < len(row))
    ]


class KeySteps:
    """Finds the column whose text changes wherever the times step back: one thing's rows follow another's.

    Attributes:
        places: The columns that may be it.
        texts: The texts of each, in order.
    """

    def __init__(self, places: Iterable[int]) -> None:
        self.places = list(places)
        self.texts: dict[int, dict[str, None]] = {place: {} for place in self.places}
        self._last_ns, self._last = 0, dict[int, str]()
        self._steps = 0

    def add(self, time_ns: IntArray, texts: Mapping[int, Sequence[str]]) -> None:
        """Take up the next rows with a value: times [ns], shape (n,), and the texts of each column."""
        steps = np.flatnonzero(np.diff(time_ns, prepend=self._last_ns) < -_MIN_STEP_NS).tolist()
        self._steps += len(steps)
        for place in [*self.places]:
            own = texts[place]
            self.texts[place] |= dict.fromkeys(own)
            before = (own[k - 1] if k else self._last.get(place, own[0]) for k in steps)
            if any(own[k] == other for k, other in zip(steps, before, strict=True)):
                self.places.remove(place)
            self._last[place] = own[-1]
        self._last_ns = int(time_ns[-1])

    @property
    def place(self) -> int | None:
        """The column; None where no step back shows one."""
        return self.places[0] if self._steps and self.places else None
