# SPDX-License-Identifier: Apache-2.0
"""Finds columns that tell rows apart: of which shaft, vessel or device each is."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np

from stickslip_logs.arrays import FloatArray, IntArray
from stickslip_logs.tables.cell_times import Cells
from stickslip_logs.tables.dialect import parse_heading, parse_number, unit_of
from stickslip_logs.units import SECOND_NS

MAX_WORDS = 100
"""More words of a column are names of files, events or remarks: a fleet's list of ships is shorter."""
# Values beside each other that differ by more times what one thing's value changes are of several things:
# noise alone makes it 1, and samples of one thing in a second stay below that.
_MIN_STEP_RATIO = 3.0


def is_same_key(cell: str, text: str) -> bool:
    """Return whether a cell is the text of a configuration, but for blanks around it, or the same number.

    So ``1`` is ``01`` and ``1.0``. The text ``*`` stands for any.
    """
    if text == '*' or cell.strip() == text.strip():
        return True
    number = parse_number(text)
    return number is not None and number == parse_number(cell)


def find_key_columns(
    rows: Sequence[Cells], time_ns: IntArray, headings: Sequence[str], places: Iterable[int]
) -> Iterator[tuple[int, bool]]:
    """Yield the places of columns that tell rows of several things apart, and whether that is not certain.

    Such a column has different words in rows of one time, or ones that alternate, or a word that changes from
    row to row in most rows; rows where it is empty are ignored. It has two words to 100, and at most half as
    many as filled rows; two are enough in any case. Whole numbers without a unit that do either of the first
    may be those of things, or of samples of one: the values of a whole file tell, by :class:`NumberedRows`.

    Args:
        rows: Rows with a value.
        time_ns: Their times [ns], shape (n,).
        headings: The headings of the table.
        places: The places of the candidates, in the order in which they are tried.
    """
    for place in places:
        filled = [k for k, row in enumerate(rows) if place < len(row) and row[place].strip()]
        words, key = np.unique([rows[k][place].strip() for k in filled], return_inverse=True)
        if not 2 <= words.size <= min(MAX_WORDS, max(len(filled) // 2, 2)):
            continue
        times_ns = time_ns[filled]
        is_apart = _are_times_shared(times_ns, key) or _are_alternating(times_ns, key)
        # A state of one thing changes seldom.
        if not any(map(_is_number, words)):
            if is_apart or np.count_nonzero(np.diff(key)) > max(2, 0.5 * len(filled)):
                yield place, False
        elif is_apart and parse_heading(headings[place]).unit is None and all(map(str.isdecimal, words)):
            yield place, True


def _are_times_shared(time_ns: IntArray, key: IntArray) -> bool:
    """Return whether different things share times often, and rows of one thing seldom.

    At least two rows must share the time of another thing, and at most half as many that of another row of
    their own: more are samples of one thing, whose times are too coarse. ``key`` is the number of the thing
    of each row, shape (n,), ``time_ns`` its time.
    """
    order = np.lexsort((key, time_ns))
    is_shared = np.diff(time_ns[order]) == 0
    is_twice = is_shared & (np.diff(key[order]) == 0)
    shared = np.count_nonzero(is_shared & ~is_twice)
    return bool(shared >= 2 and 2 * is_twice.sum() <= shared)


def _are_alternating(time_ns: IntArray, key: IntArray) -> bool:
    """Return whether rows of different things follow each other often, each thing's at a steady pace.

    At least two rows and a tenth of all must follow one of another thing; of each thing at most a tenth of
    the steps in time from row to row may be more than twice, or less than half, the usual one: a state lasts.
    """
    for k in range(int(key.max()) + 1):
        steps = np.diff(np.sort(time_ns[key == k]))
        pace = np.median(steps) if steps.size else 0.0
        if np.count_nonzero((steps > 2.0 * pace) | (steps < 0.5 * pace)) > 0.1 * steps.size:
            return False
    return bool(np.count_nonzero(np.diff(key)) >= max(2, 0.1 * key.size))


def _is_number(word: str) -> bool:
    """Return whether a text is a number with either decimal sign: '5', '<5', '> 5', '~5', '5%' or '5 kN'."""
    bare = word.strip('%<>~ ')
    number, _, unit = bare.partition(' ')
    texts = (bare, number) if unit_of(unit) else (bare,)
    return any(parse_number(text, sign) is not None for text in texts for sign in '.,')


class NumberedRows:
    """Finds the column whose numbers are those of several things, by the values of a whole file.

    Its head may not tell: two shafts turn alike until one is slowed down.

    Attributes:
        texts: The texts of each candidate by its place, in the order of the rows, as keys.
    """

    def __init__(self, places: Iterable[int]) -> None:
        self.texts: dict[int, dict[str, None]] = {place: {} for place in places}
        self._sums = {place: np.zeros((2, 2)) for place in self.texts}

    def add(
        self, time_ns: IntArray, texts: Mapping[int, Sequence[str]], values: Sequence[FloatArray]
    ) -> None:
        """Add the next rows with a value; a candidate that now has more than 100 texts is dropped.

        The texts are by the place of their column, those of others are ignored; each signal has n values, NaN
        where a row has none.
        """
        for place, words in [*self.texts.items()]:
            words |= dict.fromkeys(texts[place])
            if len(words) > MAX_WORDS:
                del self.texts[place]
                continue
            number = {text: k for k, text in enumerate(words)}
            key = np.fromiter(map(number.__getitem__, texts[place]), np.int64, len(texts[place]))
            for value in values:
                at = np.flatnonzero(np.isfinite(value))
                times_ns, things, numbers = time_ns[at], key[at], value[at]
                by_time, by_thing = np.lexsort((things, times_ns)), np.lexsort((times_ns, things))
                # From one row to the next of another thing, and from one of a thing to its own next.
                beside = np.abs(np.diff(numbers[by_time]))[np.diff(things[by_time]) != 0]
                behind = np.abs(np.diff(numbers[by_thing]))[np.diff(things[by_thing]) == 0]
                self._sums[place] += [(steps.sum(), steps.size) for steps in (beside, behind)]

    @property
    def place(self) -> int | None:
        """The place of the first column whose things differ by three times what one changes; None for none.

        Means are compared: while things are alike, the differences are those of the noise.
        """
        for place in self.texts:
            (beside, count), (behind, behind_count) = self._sums[place]
            if count and beside / count > _MIN_STEP_RATIO * behind / max(behind_count, 1):
                return place
        return None


def find_end_columns(head: Sequence[Cells], tail: Sequence[Cells], width: int) -> list[int]:
    """Return the places of the columns with one text in all of the head and another one in all of the tail.

    Rows that end before one of the ``width`` columns say nothing about it; without a tail there is none.
    """
    ends = [[{row[k] for row in rows if k < len(row)} for k in range(width)] for rows in (head, tail)]
    pairs = enumerate(zip(*ends, strict=True))
    return [k for k, (first, last) in pairs if len(first) == len(last) == 1 and first != last]


class KeySteps:
    """Finds the column whose text changes wherever the times step back: one thing's rows follow another's.

    Attributes:
        texts: The texts of each column that may still be it, by its place, in the order of the rows, as keys.
    """

    def __init__(self, places: Iterable[int]) -> None:
        self.texts: dict[int, dict[str, None]] = {place: {} for place in places}
        self._last_ns, self._last = 0, dict[int, str]()
        self._steps = 0

    def add(self, time_ns: IntArray, texts: Mapping[int, Sequence[str]]) -> None:
        """Add the next rows with a value, at least one, to ``texts``; count their steps back in time [ns].

        Columns whose text stays the same at a step back are dropped. A step back is one of more than a
        second, as smaller ones are of late rows; it may lie between two calls.
        """
        steps = np.flatnonzero(np.diff(time_ns, prepend=self._last_ns) < -SECOND_NS).tolist()
        self._steps += len(steps)
        for place, words in [*self.texts.items()]:
            column = texts[place]
            words |= dict.fromkeys(column)
            before = (column[k - 1] if k else self._last.get(place, column[0]) for k in steps)
            if any(column[k] == text for k, text in zip(steps, before, strict=True)):
                del self.texts[place]
            self._last[place] = column[-1]
        self._last_ns = int(time_ns[-1])

    @property
    def place(self) -> int | None:
        """The place of the column; None where no step back shows one."""
        return next(iter(self.texts), None) if self._steps else None
