# SPDX-License-Identifier: Apache-2.0
"""The errors of recordings and files, and the parts that their sentences share."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Sequence


class StickslipError(Exception):
    """Root of every error this package raises on purpose; its text is one sentence for a user."""


class BagError(StickslipError):
    """A recording cannot be opened, read or written."""


class FieldError(StickslipError, ValueError):
    """A text is no path to a number in a message."""


class OutputError(StickslipError):
    """An output is an input, or would replace a file that this package did not write."""


def cause(error: BaseException) -> str:
    """Return the reason of an error as text, without the system's error number and place in C."""
    text = getattr(error, 'strerror', None) or str(error) or type(error).__name__
    return re.sub(r'^\[SSL: \w+\] (.*) \(_ssl\.c:\d+\)$', r'TLS: \1', text)


def plural(number: int, noun: str) -> str:
    """Return a number with its noun: ``0 events``, ``1 event``, ``1250 events``."""
    return f'{number} {noun}{"" if number == 1 else "s"}'


MAX_NAMED = 10
"""Topics, files or texts that a sentence lists: more fill a terminal, and show nothing new."""
MAX_SHOWN = 60
"""Characters of a value, cell, line or heading that a sentence quotes: they fit a line of a terminal."""


def join_names(texts: Sequence[str], separator: str = ', ') -> str:
    """Return up to ten texts, joined, and how many more there are; empty without any.

    >>> join_names([*'abcdefghijkl'])
    'a, b, c, d, e, f, g, h, i, j and 2 more'
    """
    more = f' and {len(texts) - MAX_NAMED} more' if len(texts) > MAX_NAMED else ''
    return separator.join(texts[:MAX_NAMED]) + more


def listed(texts: Sequence[str]) -> str:
    """Return up to ten texts in quotation marks, with commas between, and how many more there are."""
    return join_names([f"'{text}'" for text in texts])


def quote_for_yaml(text: str) -> str:
    """Return a text in quotation marks as YAML reads them: it might take the bare text for something else."""
    return "'" + text.replace("'", "''") + "'"


def did_you_mean(given: object, candidates: Iterable[str]) -> str:
    """Return the end of a sentence on an unknown name: ``; did you mean 'x'?``, empty if none is near.

    What is given is taken as text. A name that contains it is near too, from two characters on.
    """
    text, names = str(given), list(candidates)
    # The dashes of options make no two of them alike.
    bare = {name.lstrip('-'): name for name in names}
    close = difflib.get_close_matches(text.lstrip('-'), bare, n=1, cutoff=0.65)
    close = [bare[name] for name in close] or [name for name in names if len(text) > 1 and text in name]
    return f"; did you mean '{close[0]}'?" if close else ''
