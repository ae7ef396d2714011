# SPDX-License-Identifier: Apache-2.0
"""The stretches of a recording between two changes of the alarm, and its worst moments."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from stickslip_monitor.arrays import FloatArray, IndexArray
from stickslip_monitor.monitor.assessment import REGIMES, Assessment, Regime, at_indices
from stickslip_monitor.monitor.bulk import Scan
from stickslip_monitor.monitor.ladder import LADDER, Condition
from stickslip_monitor.monitor.verdict import Event

_BISTABLE, _UNSTABLE = REGIMES.index(Regime.BISTABLE), REGIMES.index(Regime.UNSTABLE)
_SEVERITY = (Condition.NORMAL, Condition.INPUT_STALE, *LADDER[1:])


@dataclass(frozen=True, slots=True)
class ConditionInterval:
    """A stretch of time in one condition [ns]."""

    start_ns: int
    end_ns: int
    condition: Condition

    @property
    def seconds(self) -> float:
        """How long it lasted [s]; 0 where the clock jumped back in it."""
        return max(0, self.end_ns - self.start_ns) * 1e-9


def condition_intervals(
    events: Iterable[Event], start_ns: int, end_ns: int
) -> list[ConditionInterval]:
    """The conditions of a recording one after the other.

    Args:
        events: The changes of one bearing's alarm, in order.
        start_ns: When the recording begins [ns]; the condition is normal from then on.
        end_ns: When it ends [ns].

    Returns:
        The spells in order; the first is of no length where the first change is at the start.
    """
    changes = [(start_ns, Condition.NORMAL), *((e.time_ns, e.after) for e in events)]
    ends = [*(time_ns for time_ns, _ in changes[1:]), end_ns]
    return [
        ConditionInterval(begin, end, condition)
        for (begin, condition), end in zip(changes, ends, strict=True)
    ]


def coarsened(parts: Sequence[ConditionInterval], most: int) -> list[ConditionInterval]:
    """Fewer spells that show the same at a glance: of each stretch of time the worst condition.

    Args:
        parts: Spells that follow each other.
        most: How many spells to return at most; fewer than that stay as they are.
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
    found: list[ConditionInterval] = []
    for k, condition in enumerate(worst):
        begin = found.pop().start_ns if found and found[-1].condition is condition else edges[k]
        found.append(ConditionInterval(begin, edges[k + 1], condition))
    return found


def together(
    parts: Iterable[ConditionInterval], conditions: Collection[Condition]
) -> list[ConditionInterval]:
    """The spells spent in any of some conditions; those that follow each other are one."""
    found: list[ConditionInterval] = []
    for spell in parts:
        if spell.condition not in conditions:
            continue
        if found and found[-1].end_ns == spell.start_ns:
            spell = ConditionInterval(found.pop().start_ns, spell.end_ns, spell.condition)
        found.append(spell)
    return found


def _outermost(speed: FloatArray, load: FloatArray) -> IndexArray:
    """The points than which no other is both faster and more loaded, shape (m,).

    At one speed the amplitude of the exact cycle rises with the load, and at one load, as a rule,
    with the speed: one of these has the greatest, however a recording is cut.
    """
    order = np.lexsort((np.arange(speed.size), -load, -speed))
    heaviest = np.maximum.accumulate(load[order])
    return np.sort(order[np.append(True, heaviest[1:] > heaviest[:-1])])


@dataclass(frozen=True, slots=True)
class Extreme:
    """The worst value of a quantity in a recording, and the operating point it came from."""

    time_ns: int
    value: float
    point: Assessment


class Worst:
    """The least Hopf and fold margin, and the greatest amplitude while stick-slip is predicted.

    Attributes:
        found: The moments by name; a quantity that never had a value is absent.
    """

    def __init__(self) -> None:
        self.found: dict[str, Extreme] = {}
        self._least: dict[str, float] = {}

    def take(self, scan: Scan) -> None:
        """Take the next part of the verdicts on one bearing."""
        points = scan.assessment
        for name in ('hopf_margin', 'fold_margin'):
            margin = getattr(points, name)
            self._take(name, scan, None, np.where(np.isfinite(margin), margin, np.inf))
        # One that dies out beyond the fold has no amplitude any more.
        exists = (points.regime_code == _BISTABLE) | (points.regime_code == _UNSTABLE)
        rows = np.flatnonzero(scan.sticking & exists)
        if rows.size:
            rows = rows[_outermost(np.abs(scan.speed[rows]), scan.load[rows])]
            amplitude = at_indices(points, rows).amplitude_exact
            self._take('amplitude', scan, rows, np.where(np.isnan(amplitude), np.inf, -amplitude))

    def _take(self, name: str, scan: Scan, rows: IndexArray | None, badness: FloatArray) -> None:
        """Take a column whose least value is the worst; ``inf`` is none."""
        i = int(badness.argmin()) if badness.size else -1
        if i < 0 or not badness[i] < self._least.get(name, math.inf):
            return
        self._least[name] = value = float(badness[i])
        k = i if rows is None else int(rows[i])
        value = -value if name == 'amplitude' else value
        self.found[name] = Extreme(int(scan.time_ns[k]), value, at_indices(scan.assessment, k))
