# SPDX-License-Identifier: Apache-2.0
"""Sets of time: sorted, disjoint intervals [ns], each with its begin and without its end."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

Interval = tuple[int, int]
Intervals = Sequence[Interval]


def merged(intervals: Iterable[Interval]) -> list[Interval]:
    """Sort intervals, join those that overlap or touch, and drop the empty ones."""
    found: list[Interval] = []
    for start, end in sorted(intervals):
        if end <= start:
            continue
        if found and start <= found[-1][1]:
            found[-1] = (found[-1][0], max(end, found[-1][1]))
        else:
            found.append((start, end))
    return found


def intersection(first: Intervals, second: Intervals) -> list[Interval]:
    """What two sets have in common."""
    found: list[Interval] = []
    i = k = 0
    while i < len(first) and k < len(second):
        start, end = max(first[i][0], second[k][0]), min(first[i][1], second[k][1])
        if start < end:
            found.append((start, end))
        if first[i][1] <= second[k][1]:
            i += 1
        else:
            k += 1
    return found


def seconds(intervals: Iterable[Interval]) -> float:
    """Length of a set [s]."""
    return sum(end - start for start, end in intervals) / 1e9
