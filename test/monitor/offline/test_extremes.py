# SPDX-License-Identifier: Apache-2.0
"""The stretches between changes of the alarm."""

from __future__ import annotations

from functools import partial
from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from sending import change, configured
from shared import LAWS, bearing_of

from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.monitor.assessment import REGIMES, assess
from stickslip_monitor.monitor.severity import Condition
from stickslip_monitor.offline.extremes import (
    ConditionInterval,
    Extremes,
    OutlineBuilder,
    coarsen_intervals,
    condition_intervals,
    join_intervals,
)
from stickslip_monitor.offline.input_report import HOLDS
from stickslip_monitor.physics.bearing import Bearing
from stickslip_monitor.physics.boundary_table import boundary_table
from stickslip_monitor.physics.friction import FrictionLaw, Stretched

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


def test_intervals_fill_the_recording() -> None:
    intervals = condition_intervals(COURSE, 0, 50)
    assert [s.start_ns for s in intervals] == [0, 10, 20, 30, 40]
    assert [s.end_ns for s in intervals] == [10, 20, 30, 40, 50]
    assert [s.condition for s in intervals] == [NORMAL, STICK, AMPLITUDE, CAUTION, STICK]
    assert condition_intervals([], 0, 50) == [ConditionInterval(0, 50, NORMAL)]


def test_neighbours_of_the_same_kind_are_one() -> None:
    joined = join_intervals(condition_intervals(COURSE, 0, 50), (STICK, AMPLITUDE))
    assert [(s.start_ns, s.end_ns) for s in joined] == [(10, 30), (40, 50)]


def test_of_very_many_intervals_the_worst_of_each_stretch_stays() -> None:
    # A second of each in turn for 1000 s, and one millisecond of stick-slip.
    parts = [ConditionInterval(i * NS, (i + 1) * NS, (NORMAL, CAUTION)[i % 2]) for i in range(1000)]
    brief = [
        ConditionInterval(500 * NS, 500 * NS + 10**6, STICK),
        ConditionInterval(500 * NS + 10**6, 501 * NS, NORMAL),
    ]
    coarse = coarsen_intervals([*parts[:500], *brief, *parts[501:]], 100)
    assert [interval.condition for interval in coarse] == [CAUTION, STICK, CAUTION]
    assert (coarse[0].start_ns, coarse[-1].end_ns) == (0, 1000 * NS)
    assert coarse[1].start_ns <= 500 * NS < coarse[1].end_ns
    assert all(a.end_ns == b.start_ns for a, b in pairwise(coarse))


def make_scan(bearing: Bearing, speed: FloatArray, load: FloatArray) -> Any:
    """Points of a recording, of which each lasts twice as long as the one before."""
    return SimpleNamespace(
        speed=speed,
        load=load,
        time_ns=np.zeros(speed.size, np.int64),
        until_ns=1 << np.arange(speed.size) % 40,
        sticking=np.zeros(speed.size, bool),
        config=SimpleNamespace(water_temperature=None),
        assessed=lambda rows: assess(bearing, speed[rows], load[rows], table=boundary_table(bearing)),
        fold_speed=lambda rows: (
            assess(bearing, speed[rows], load[rows], table=boundary_table(bearing)).fold_speed
        ),
    )


def times_in_regimes(scan: Any, codes: NDArray[np.int8]) -> list[int]:
    """Return the time in each regime, by the regime of each point alone."""
    return [int(scan.until_ns[codes == code].sum()) for code in range(len(REGIMES))]


@pytest.mark.parametrize(
    ('seconds', 'until'),
    [
        # Each counts to the next, the last and one before a gap for its own five seconds.
        ([0, 1, 2, 50, 51], [1.0, 2.0, 7.0, 51.0, 56.0]),
        # One before a step back of the clock ends before what the next one says of that time.
        ([10, 11, 12, 7, 9], [11.0, 12.0, 7.0 - 1e-9, 9.0, 14.0]),
    ],
)
def test_the_duration_of_a_verdict_of_an_outline(seconds: list[int], until: list[float]) -> None:
    (config,) = configured().bearings
    time_ns, outline_builder = np.array(seconds) * NS, OutlineBuilder(config)
    speed, load = np.full(time_ns.size, 0.3), np.full(time_ns.size, 1000.0)
    scan: Any = SimpleNamespace(
        time_ns=time_ns,
        until_ns=time_ns + 5 * NS,
        assessment=assess(config.bearing, speed, load),
        sticking=np.zeros(time_ns.size, bool),
        water=np.full(time_ns.size, np.nan),
        events=[],
    )
    outline_builder.add_scan(scan)
    assert outline_builder.build().until_ns.tolist() == [round(second * NS) for second in until]


def test_the_times_for_which_a_value_may_stand_are_whole_minutes() -> None:
    """They are written into a configuration by a person."""
    assert [hold % 60 for hold in HOLDS] == [0] * len(HOLDS)
    assert list(HOLDS) == sorted(HOLDS)


def test_a_lighter_point_may_have_the_higher_fold() -> None:
    """Friction that rises again makes the exact fold fall from 5.5 to 5.1 m/s, by the solver itself."""
    bearing = Bearing(5.9, 43.5, 3.67e5, Stretched(0.372, 0.0866, 97.8, 0.0071, 1.77), 0.3)
    speed, load = np.array([5.4, 5.4]), np.array([8.0e4, 1.2e5])
    scan, extremes = make_scan(bearing, speed, load), Extremes()
    alone = assess(bearing, speed, load)
    assert alone.regime.tolist() == ['bistable', 'stable']
    extremes.take(scan)
    assert extremes.lasting_ns.tolist() == times_in_regimes(scan, alone.regime_code)


@pytest.mark.parametrize('law', LAWS.values(), ids=LAWS)
def test_skipped_points_change_neither_regimes_nor_least_margins(law: FrictionLaw) -> None:
    """Compare with the assessment of every point, in parts that begin with the known extremes."""
    bearing, rng = bearing_of(law), np.random.default_rng(1)
    load = rng.uniform(-50.0, 1000.0, (5, 400)) * np.array([[1.0], [1.2], [5.0], [0.5], [0.9]])
    table, extremes = boundary_table(bearing), Extremes()
    # Most about the highest boundary of their part, some at rest.
    limit = np.nan_to_num(assess(bearing, 0.1, load, table=table).fold_speed, posinf=0.0).max(1)
    speed = rng.choice([-1.0, 0.0, 1.0, 1.0], load.shape) * rng.uniform(0.6, 1.1, load.shape)
    speed *= np.where(limit > 0.0, limit, 0.1)[:, None]
    for scan in map(partial(make_scan, bearing), speed, load):
        lasting_before = extremes.lasting_ns.copy()
        extremes.take(scan)
        codes = scan.assessed(slice(None)).regime_code
        assert (extremes.lasting_ns - lasting_before).tolist() == times_in_regimes(scan, codes)
    points = assess(bearing, speed, load, table=table)
    for name, margins in (('hopf_margin', points.hopf_margin), ('fold_margin', points.fold_margin)):
        finite = margins[(speed != 0.0) & np.isfinite(margins)]
        values = [extremes.worst[name].value] if name in extremes.worst else []
        assert values == ([finite.min()] if finite.size else [])
