# SPDX-License-Identifier: Apache-2.0
"""Gaps of a topic; expected values by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from stickslip_monitor.arrays import IntArray
from stickslip_monitor.offline.input_check import Gap, Gaps

NS = 10**9


def find_gaps(stamp_ns: IntArray, limit_ns: int) -> Gaps:
    """The gaps of stamps that come in two parts."""
    found, cut = Gaps(limit_ns), len(stamp_ns) // 2
    for part in (stamp_ns[:cut], stamp_ns[cut:]):
        found.take(part)
    return found


def test_rate_and_gaps() -> None:
    seconds = [0, 1, 2, 3, 13, 14, 15, 115]
    found = find_gaps(np.array(seconds, np.int64) * NS, 5 * NS)
    assert found.count == 2
    assert found.longest == [Gap(15 * NS, 100.0), Gap(3 * NS, 10.0)]
    # Five intervals of a second, apart from the gaps.
    assert found.rate == pytest.approx(1.0)


def test_an_interval_of_just_the_limit_is_no_gap() -> None:
    assert find_gaps(np.array([0, 5, 10], np.int64) * NS, 5 * NS).count == 0


def test_only_the_longest_are_named() -> None:
    stamps = np.cumsum(np.arange(6, 30)) * NS
    found = find_gaps(stamps.astype(np.int64), 5 * NS)
    assert found.count == 23
    assert [gap.seconds for gap in found.longest] == [29.0, 28.0, 27.0, 26.0, 25.0]


def test_a_jump_back_is_no_gap_and_no_time() -> None:
    found = find_gaps(np.array([100, 101, 102, 0, 1, 2], np.int64) * NS, 5 * NS)
    assert found.count == 0
    assert found.rate == pytest.approx(5 / 4)


@pytest.mark.parametrize('count', [0, 1])
def test_too_few_messages_have_no_rate(count: int) -> None:
    found = find_gaps(np.zeros(count, np.int64), NS)
    assert math.isnan(found.rate)
    assert found.count == 0
