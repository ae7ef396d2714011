# SPDX-License-Identifier: Apache-2.0
"""Measures where the time of a simulation goes, by wrapping what effects return."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Any, TypeVar

Item = TypeVar('Item')
REST = 'writing the bag'


class Stopwatch:
    """Attributes elapsed time to names; time in a nested name counts for the inner one only.

    Args:
        clock: Returns the time [s].
    """

    def __init__(self, clock: Callable[[], float] = time.perf_counter) -> None:
        self._clock = clock
        self._running = [REST]
        self._since = clock()
        self._spent = {REST: 0.0}

    @property
    def spent(self) -> dict[str, float]:
        """The time of each name until now [s]; ``REST`` has what no other name has."""
        self._account()
        return dict(self._spent)

    @contextmanager
    def of(self, name: str) -> Iterator[None]:
        """Give the time of a block of code to a name."""
        self._account()
        self._running.append(name)
        try:
            yield
        finally:
            self._account()
            self._running.pop()

    def watch(self, name: str, thing: Any) -> Any:
        """The thing, with the time of its methods given to a name."""
        self._spent.setdefault(name, 0.0)
        return _Watched(self, name, thing)

    def steps(self, name: str, items: Iterable[Item]) -> Iterator[Item]:
        """Items one by one, with the time it takes to get each given to a name."""
        iterator = iter(items)
        while True:
            with self.of(name):
                try:
                    item = next(iterator)
                except StopIteration:
                    return
            yield item

    def _account(self) -> None:
        now = self._clock()
        name = self._running[-1]
        self._spent[name] = self._spent.get(name, 0.0) + now - self._since
        self._since = now


class _Watched:
    """Stands in for a thing and times what is called of it."""

    def __init__(self, stopwatch: Stopwatch, name: str, thing: Any) -> None:
        self._stopwatch, self._name, self._thing = stopwatch, name, thing

    def __getattr__(self, attribute: str) -> Any:
        value = getattr(self._thing, attribute)
        if not callable(value):
            return value

        def timed(*args: Any, **more: Any) -> Any:
            with self._stopwatch.of(self._name):
                return value(*args, **more)

        return timed
