# SPDX-License-Identifier: Apache-2.0
"""Which of several sources of one input is used, for all buses: one, for as long as it sends."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable
from typing import TypeVar

Own = TypeVar('Own')
SHARE = 0.5
"""Of the time-out: a source that is silent for longer is given up, before the input is lost."""


class SourceAdmission:
    """Admits one source of an input; the others are named, and so is a change.

    Args:
        what: The input, for the log.
        chosen: The only source to use; empty to stay with the first one that sends.
        timeout: Time-out of the input [s].
        log: Given a line for each source that is left out, once, and for each change.
    """

    def __init__(self, what: str, chosen: str, timeout: float, log: Callable[[str], object]) -> None:
        self._what, self._chosen, self._timeout, self._log = what, chosen, timeout, log
        self._used, self._heard = chosen, 0.0
        self._left_out: set[str] = set()

    def admits(self, source: str, now: float) -> bool:
        """Whether a value of a source is used; ``now`` is of a steady clock [s]."""
        if self._chosen or source == self._used:
            self._heard = now if source == self._used else self._heard
        elif not self._used or now - self._heard > SHARE * self._timeout:
            if self._used:
                silent = now - self._heard
                self._say(f"'{source}' is used; '{self._used}' has been silent for {silent:.3g} s")
                self._left_out.clear()
            self._used, self._heard = source, now
        if source == self._used:
            return True
        if source not in self._left_out:
            self._left_out.add(source)
            why = 'is chosen' if self._chosen else 'sends'
            self._say(f"'{source}' is left out: '{self._used}' {why}")
        return False

    def _say(self, text: str) -> None:
        self._log(f'{self._what}: source {text}')


def grouped(inputs: Iterable[Own], key: Callable[[Own], Hashable]) -> list[list[Own]]:
    """The inputs that are one value of a bus, as the speed of a shaft with several bearings."""
    found: dict[Hashable, list[Own]] = {}
    for item in inputs:
        found.setdefault(key(item), []).append(item)
    return list(found.values())
