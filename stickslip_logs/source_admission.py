# SPDX-License-Identifier: Apache-2.0
"""Chooses one of several senders of one value of a bus, live and in a log."""

from __future__ import annotations

import math
from collections.abc import Callable

SHARE = 0.5
"""Of the time-out: a source without a number for longer is given up, before the input is lost."""
# Less is disorder of lines [s].
_LEAST_SET_BACK = 1.0


class SourceAdmission:
    """Admits one source of a value; the others are named, and so is a change.

    Args:
        label: What the value is, for a person.
        timeout: Time-out of the input; a source without a number for half of it is given up [s].
        only: The only source to use; empty to stay with the first that sends.
        log: Given a line for each source that is left out, once, and for each change.
    """

    def __init__(self, label: str, timeout: float, only: str, log: Callable[[str], object]) -> None:
        self._label, self._timeout, self._only, self._log = label, timeout, only, log
        self._used, self._valid_at, self._latest = only, -math.inf, -math.inf
        self._left_out: set[str] = set()

    def admits(self, source: str, now: float, *, valid: bool = True) -> bool:
        """Return whether a value of a source is used; replace a source that fell silent.

        The state changes with each call. A change of the source, and the first value of each source that is
        left out, are logged. A value that is not a number does not keep another source out: a stopped engine
        may send it for ever.

        Args:
            source: Who sends it.
            now: When [s]. Where the clock was set back, as that of a log may be, silences go on from there.
            valid: Whether it is a number.
        """
        if now < self._latest - _LEAST_SET_BACK:
            self._valid_at += now - self._latest
        self._latest = now
        silent = now - self._valid_at
        is_given_up = not self._used or (valid and silent > SHARE * self._timeout)
        if source != self._used and is_given_up and not self._only:
            if self._used:
                since = f' for {silent:.3g} s' if silent < math.inf else ''
                self._log_source(f"'{source}' is used; '{self._used}' has sent no number{since}")
                self._left_out.clear()
            self._used = source
        if source == self._used:
            self._valid_at = now if valid else self._valid_at
            return True
        if source not in self._left_out:
            self._left_out.add(source)
            why = 'is chosen' if self._only else 'sends'
            self._log_source(f"'{source}' is left out: '{self._used}' {why}")
        return False

    def _log_source(self, text: str) -> None:
        """Log a sentence on a source, which begins with its name."""
        self._log(f'{self._label}: source {text}')
