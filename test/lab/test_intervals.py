# SPDX-License-Identifier: Apache-2.0
"""Sets of time against sets of whole instants."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from stickslip_monitor.lab.score import Interval, intersection, merged, seconds

intervals = st.lists(st.tuples(st.integers(0, 40), st.integers(0, 40)), max_size=8)


def instants(found: list[Interval]) -> set[int]:
    return {t for start, end in found for t in range(start, end)}


@given(intervals)
def test_merged_keeps_every_instant_in_disjoint_order(raw: list[Interval]) -> None:
    found = merged(raw)
    assert instants(found) == instants(raw)
    edges = [t for interval in found for t in interval]
    assert edges == sorted(set(edges))


@given(intervals, intervals)
def test_intersection_is_what_both_have(first: list[Interval], second: list[Interval]) -> None:
    found = intersection(merged(first), merged(second))
    assert instants(found) == instants(first) & instants(second)
    assert seconds(found) == len(instants(first) & instants(second)) / 1e9
