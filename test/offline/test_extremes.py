# SPDX-License-Identifier: Apache-2.0
"""The stretches between changes of the alarm."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from sending import change
from shared import CONFIG

from stickslip_monitor.monitor.assessment import BISTABLE, NO_CYCLE, assess
from stickslip_monitor.monitor.parameter_file import load_config
from stickslip_monitor.monitor.severity import Condition
from stickslip_monitor.offline.extremes import ConditionInterval, coarsened, condition_intervals, together
from stickslip_monitor.physics.averaging import fold_speed
from stickslip_monitor.physics.boundary_table import known_table

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


def test_sums_have_the_outcomes_of_the_closed_form() -> None:
    """However close to the boundaries, whose table is right to 1e-8 only."""
    bearing = load_config(CONFIG).bearings[0].bearing
    rng = np.random.default_rng(1)
    load = rng.uniform(200.0, 5000.0, 4000)
    off = rng.choice([-1.0, 1.0], load.size) * 10.0 ** rng.uniform(-15.0, -2.0, load.size)
    speed = fold_speed(bearing, load) * (1.0 + off)
    exact = assess(bearing, speed, load)
    summed = assess(bearing, speed, load, table=known_table(bearing), sums=True)
    assert set(np.unique(exact.outcome_code)) >= {NO_CYCLE, BISTABLE}
    np.testing.assert_array_equal(summed.outcome_code, exact.outcome_code)
    # Else there would be nothing to show: read off the table, some would be on the other side.
    assert np.any((speed < exact.fold_speed) != (speed < known_table(bearing).averaged(load)))
