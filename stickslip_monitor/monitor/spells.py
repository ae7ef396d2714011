# SPDX-License-Identifier: Apache-2.0
"""The stretches of a recording between two changes of the alarm."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass

from stickslip_monitor.monitor.alarm import LADDER, Condition
from stickslip_monitor.monitor.verdict import Event

_SEVERITY = (Condition.NORMAL, Condition.INPUT_STALE, *LADDER[1:])


@dataclass(frozen=True, slots=True)
class Spell:
    """A stretch of time in one condition [ns]."""

    start_ns: int
    end_ns: int
    condition: Condition

    @property
    def seconds(self) -> float:
        """How long it lasted [s]; 0 where the clock jumped back in it."""
        return max(0, self.end_ns - self.start_ns) * 1e-9


def spells(events: Iterable[Event], start_ns: int, end_ns: int) -> list[Spell]:
    """The conditions of a recording one after the other.

    Args:
        events: The changes of one bearing's alarm, in order.
        start_ns: When the recording begins [ns]; the condition is normal from then on.
        end_ns: When it ends [ns].

    Returns:
        The spells in order; the first is of no length where the first change is at the start.
    """
    found = [Spell(start_ns, end_ns, Condition.NORMAL)]
    for event in events:
        last = found.pop()
        found += [
            Spell(last.start_ns, event.time_ns, last.condition),
            Spell(event.time_ns, end_ns, event.after),
        ]
    return found


def coarsened(parts: Sequence[Spell], most: int) -> list[Spell]:
    """Fewer spells that show the same at a glance: of each stretch of time the worst condition.

    Args:
        parts: Spells that follow each other.
        most: How many spells to return at most; fewer than that stay as they are.

    Returns:
        Spells over the same time. A stretch that touches several takes the most severe of them,
        so that none is lost.
    """
    start, end = parts[0].start_ns, max(spell.end_ns for spell in parts)
    if len(parts) <= most or end <= start:
        return list(parts)
    worst = [Condition.NORMAL] * most
    for spell in parts:
        first = (spell.start_ns - start) * most // (end - start)
        last = -((start - spell.end_ns) * most // (end - start))
        for k in range(max(0, first), min(most, max(last, first + 1))):
            worst[k] = max(worst[k], spell.condition, key=_SEVERITY.index)
    edges = [start + (end - start) * k // most for k in range(most + 1)]
    found: list[Spell] = []
    for k, condition in enumerate(worst):
        begin = found.pop().start_ns if found and found[-1].condition is condition else edges[k]
        found.append(Spell(begin, edges[k + 1], condition))
    return found


def together(parts: Iterable[Spell], conditions: Collection[Condition]) -> list[Spell]:
    """The spells spent in any of some conditions; those that follow each other are one."""
    found: list[Spell] = []
    for spell in parts:
        if spell.condition not in conditions:
            continue
        if found and found[-1].end_ns == spell.start_ns:
            spell = Spell(found.pop().start_ns, spell.end_ns, spell.condition)
        found.append(spell)
    return found
