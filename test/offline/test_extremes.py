# SPDX-License-Identifier: Apache-2.0
"""The stretches between changes of the alarm."""

from __future__ import annotations

from itertools import pairwise

from sending import change

from stickslip_monitor.monitor.severity import Condition
from stickslip_monitor.offline.extremes import ConditionInterval, coarsened, condition_intervals, together

NS = 10**9
NORMAL, CAUTION, STICK, AMPLITUDE = (
    Condition.NORMAL,
    Condition.CAUTION,
    Condition.STICK_SLIP,
    Condition.AMPLITUDE,
)


COURSE = [
    change(10, NORMAL, STICK),
    change(20, STICK, AMPLITUDE),
    change(30, AMPLITUDE, CAUTION),
    change(40, CAUTION, STICK),
]


def test_spells_fill_the_recording() -> None:
    found = condition_intervals(COURSE, 0, 50)
    assert [s.start_ns for s in found] == [0, 10, 20, 30, 40]
    assert [s.end_ns for s in found] == [10, 20, 30, 40, 50]
    assert [s.condition for s in found] == [NORMAL, STICK, AMPLITUDE, CAUTION, STICK]
    assert condition_intervals([], 0, 50) == [ConditionInterval(0, 50, NORMAL)]


def test_neighbours_of_the_same_kind_are_one() -> None:
    found = together(condition_intervals(COURSE, 0, 50), (STICK, AMPLITUDE))
    assert [(s.start_ns, s.end_ns) for s in found] == [(10, 30), (40, 50)]


def test_of_very_many_spells_the_worst_of_each_stretch_stays() -> None:
    # A second of each in turn for 1000 s, and one millisecond of stick-slip.
    parts = [ConditionInterval(i * NS, (i + 1) * NS, (NORMAL, CAUTION)[i % 2]) for i in range(1000)]
    brief = [
        ConditionInterval(500 * NS, 500 * NS + 10**6, STICK),
        ConditionInterval(500 * NS + 10**6, 501 * NS, NORMAL),
    ]
    found = coarsened([*parts[:500], *brief, *parts[501:]], 100)
    assert [spell.condition for spell in found] == [CAUTION, STICK, CAUTION]
    assert (found[0].start_ns, found[-1].end_ns) == (0, 1000 * NS)
    assert found[1].start_ns <= 500 * NS < found[1].end_ns
    assert all(a.end_ns == b.start_ns for a, b in pairwise(found))
