# SPDX-License-Identifier: Apache-2.0
"""The inputs that come from a bus: which of several sources is used, and which inputs are silent."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace

from stickslip_logs.source_admission import SourceAdmission
from stickslip_monitor.links.links_config import BusInput


class BusInputs:
    """The inputs that come from a bus.

    Args:
        log: Given a line for what becomes of sources, and for each input that has values again.

    Attributes:
        groups: Inputs that are one value of the bus for as long, as the speed of a shaft with several
            bearings, and what admits its sources.
    """

    def __init__(self, inputs: Iterable[BusInput], log: Callable[[str], object]) -> None:
        by_source: dict[BusInput, list[BusInput]] = {}
        for item in inputs:
            by_source.setdefault(replace(item, bearing=''), []).append(item)
        self.groups = [
            (items, SourceAdmission(items[0].label, items[0].timeout, items[0].only, log))
            for items in by_source.values()
        ]
        self.log, self._reported = log, set[BusInput]()
        self._received_at: dict[BusInput, float] = {}

    def start_waiting(self, now: float) -> None:
        """Count the silence of every input from a time of the steady clock [s]."""
        self._received_at = {items[0]: now for items, _ in self.groups}

    def note_received(self, item: BusInput, now: float) -> None:
        """Note when an input had a value, by the steady clock [s]; log a line if it was silent before.

        ``item`` is the first input of its group.
        """
        self._received_at[item] = now
        if item in self._reported:
            self._reported.discard(item)
            self.log(f'{item.label}: values again')

    def take_silent(self, now: float) -> list[BusInput]:
        """Return the inputs that have become silent, each once until it has values again; often none.

        Of each group the first input stands for all. One is silent without a value for its
        :attr:`~BusInput.max_silence`, counted from the first call or :meth:`start_waiting` at the earliest.
        ``now`` is of the steady clock [s].
        """
        if not self._received_at:
            self.start_waiting(now)
        new = [
            item
            for item, at in self._received_at.items()
            if now - at >= item.max_silence and item not in self._reported
        ]
        self._reported.update(new)
        return new
