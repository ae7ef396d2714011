# SPDX-License-Identifier: Apache-2.0
"""The switch with an integrating delay: by hand, and a recording at once as point by point."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stickslip_monitor.arrays import IntArray
from stickslip_monitor.monitor import latch as module
from stickslip_monitor.monitor.config import AlarmConfig
from stickslip_monitor.monitor.freshness import Rhythm, credit, credit_of_many
from stickslip_monitor.monitor.latch import Latch, follow

CONFIG = AlarmConfig(0.2, 0.02, 1.0, 0, 0)


class Tick(Latch):
    """Each point adds its own amount where it asks, and takes it off where it does not."""

    def __init__(self, due: tuple[int, int], amounts: IntArray) -> None:
        super().__init__(CONFIG)
        self.dues, self.amounts = due, amounts

    def due(self) -> int:
        return self.dues[self.on]

    def steps(self, lo: int, hi: int) -> IntArray:
        return np.where(self.asks[self.on][lo:hi], self.amounts[lo:hi], -self.amounts[lo:hi])


def _walk(latch: Tick, starts: list[int]) -> tuple[list[bool], list[int]]:
    """The definition, point by point."""
    states, counts = [], []
    for k in range(latch.amounts.size):
        if k in starts:
            latch.restart()
        step = 0 if k in starts else int(latch.steps(k - 1, k)[0])
        latch.take(step, bool(latch.asks[latch.on][k]), k)
        states.append(latch.on)
        counts.append(latch.count)
    return states, counts


def _latch(due: tuple[int, int], amounts: Any, rise: Any, fall: Any) -> Tick:
    found = Tick(due, np.asarray(amounts, np.int64))
    found.asks = np.asarray(rise, bool), np.asarray(fall, bool)
    return found


@settings(max_examples=300, deadline=None)
@given(
    rows=st.lists(st.tuples(st.integers(0, 9), st.booleans(), st.booleans()), max_size=60),
    due=st.tuples(st.integers(0, 25), st.integers(0, 25)),
    starts=st.sets(st.integers(1, 50)),
)
def test_a_recording_at_once_is_its_points_one_by_one(
    rows: list[tuple[int, bool, bool]], due: tuple[int, int], starts: set[int]
) -> None:
    amounts, rise, fall = zip(*rows, strict=True) if rows else ((), (), ())
    begins = [0, *sorted(k for k in starts if k < len(rows))][: max(len(rows), 1)]
    if not rows:
        begins = []
    expected = _walk(_latch(due, amounts, rise, fall), begins)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, '_FEW', 3)
        patch.setattr(module, '_MANY', 7)
        on, count = follow(
            _latch(due, amounts, rise, fall), np.arange(len(rows)), np.array(begins, np.intp)
        )
    assert (on.tolist(), count.tolist()) == expected


def test_one_odd_point_in_thirty_delays_by_what_it_took() -> None:
    rise = np.arange(60) % 30 != 10
    states, _ = _walk(_latch((40, 99), np.ones(60), rise, ~rise), [0])
    # 40 intervals that count up; each of the two odd points costs two.
    assert states.index(True) == 40 + 2 * 2


def test_alternating_points_never_change_it() -> None:
    rise = np.arange(200) % 2 == 0
    assert not any(_walk(_latch((2, 2), np.ones(200), rise, ~rise), [0])[0])


@pytest.mark.parametrize(
    ('rhythm', 'expected'), [(100, 100), (1000, 100), (2000, 50), (5000, 20), (0, 100)]
)
def test_a_value_at_its_rhythm_counts_for_a_third_of_a_delay_at_most(
    rhythm: int, expected: int
) -> None:
    assert credit(100, rhythm, 3000) == expected
    many = credit_of_many(np.array([100]), np.array([rhythm]), 3000)
    assert many.tolist() == [expected]


def test_a_value_lasts_for_one_and_a_half_of_the_longer_of_two_gaps() -> None:
    rhythm, ends = Rhythm(), []
    for stamp in (0, 100, 300, 340, 380):
        rhythm.add(stamp, stamp)
        ends.append(rhythm.until_ns - stamp)
    # Nothing is known of the rhythm at the first.
    assert ends == [0, 150, 300, 300, 60]
