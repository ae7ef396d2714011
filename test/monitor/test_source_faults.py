# SPDX-License-Identifier: Apache-2.0
"""Faults of an input's source, told from its samples."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from stickslip_monitor import MonitorConfig
from stickslip_monitor.monitor.source_faults import (
    SourceFault,
    SourceFaultKind,
    SourceWatch,
    fault_text,
    least_gap,
)

TWO, STAMPS = SourceFaultKind.TWO_LEVELS, SourceFaultKind.STAMPS_TO_AND_FRO
BURSTS = SourceFaultKind.IN_BURSTS
SECOND = 10**9
Floats = NDArray[np.float64]


def instants(count: int, rate: float = 10.0) -> NDArray[np.int64]:
    return np.rint(np.arange(count) * (SECOND / rate)).astype(np.int64)


def found(values: Floats, rate: float = 10.0) -> list[SourceFault]:
    time = instants(values.size, rate)
    return SourceWatch().see_many(time, time, values)


def mixed(count: int, every: int, first: float = 60.0, second: float = 20.0) -> Floats:
    return np.where(np.arange(count) % every == every - 1, second, first)


_VALUE = st.sampled_from([20.0, 60.0, 61.0, 0.0, np.nan, np.inf, -20.0, 1e308, -1e308, 25.0])
_STEP = st.sampled_from([0, 1, SECOND // 10, SECOND, 7 * SECOND, 70 * SECOND])
_SHIFT = st.sampled_from([0, 0, -SECOND, SECOND, 3600 * SECOND])


@settings(max_examples=200, deadline=None)
@given(
    st.lists(st.tuples(_VALUE, _STEP, _SHIFT), min_size=0, max_size=12),
    st.integers(1, 8),
    st.sampled_from([0.0, 3.0]),
)
def test_live_and_bulk_raise_the_same_faults(
    pattern: list[tuple[float, int, int]], repeats: int, least: float
) -> None:
    """Patterns are repeated, so that evidence of both kinds comes together."""
    rows = pattern * repeats
    value = np.array([row[0] for row in rows], float)
    arrival = np.cumsum(np.array([row[1] for row in rows], np.int64))
    stamp = arrival + np.array([row[2] for row in rows], np.int64)
    watch = SourceWatch(least)
    live: list[SourceFault] = []
    for now, own, si in zip(arrival.tolist(), stamp.tolist(), value.tolist(), strict=True):
        live += watch.see(now, own, si)
        watch.standing(now)  # being asked changes nothing
    bulk, cut = SourceWatch(least), len(rows) // 3
    first, second = (
        bulk.see_many(arrival[part], stamp[part], value[part])
        for part in (slice(cut), slice(cut, None))
    )
    assert repr([*first, *second]) == repr(live)


def test_the_first_stamp_of_all_ends_no_burst() -> None:
    """Also where it came in a stretch of its own: copies, each a second after the other."""
    stamp = np.repeat(np.arange(20), 2)[1:] * SECOND
    value, watch = np.full(stamp.size, 20.0), SourceWatch()
    found = [
        fault
        for part in (slice(1), slice(1, None))
        for fault in watch.see_many(stamp[part], stamp[part], value[part])
    ]
    assert [(fault.kind, fault.since_ns) for fault in found] == [(BURSTS, 2 * SECOND)]


@pytest.mark.parametrize(
    ('every', 'rate', 'raised'),
    [
        # Each sample jumps and the second jump is the first to return: 12 returns with the 14th
        # sample at 1.3 s, but no fault before 3 s after the first return at 0.2 s.
        (2, 10.0, 3.2),
        # A tenth of the rate: jumps at samples 9, 10, 19, 20 ...; the 12th return is the 13th.
        (10, 10.0, 6.9),
        # One odd sample in thirty: returns come 1 and 29 samples apart; the 13th jump is at 209.
        (30, 10.0, 20.9),
        # One value in 5 s, from two publishers: the 13th jump is at the 13th sample.
        (2, 0.2, 65.0),
    ],
)
def test_a_second_publisher_is_found(every: int, rate: float, raised: float) -> None:
    (fault,) = found(mixed(260, every), rate)
    assert fault.kind is TWO
    assert fault.levels == (20.0, 60.0)
    assert fault.raised_ns == pytest.approx(raised * SECOND, abs=1)


@pytest.mark.parametrize('copies', [2, 3, 10, 20])
@pytest.mark.parametrize('apart', [0, SECOND // 1000])
def test_bursts_and_copies_are_found(copies: int, apart: int) -> None:
    """A sender that hands over each second what it has, or the same several times."""
    time = (np.arange(30)[:, None] * SECOND + np.arange(copies) * apart).ravel()
    (fault,) = SourceWatch().see_many(time, time, np.full(time.size, 20.0))
    assert fault.kind is BURSTS
    # The first pause that ends a burst is after the first second; twelve are evidence enough.
    assert fault.raised_ns == 12 * SECOND


def test_neither_jitter_nor_single_dropouts_are_bursts() -> None:
    random = np.random.default_rng(7)
    steady = np.arange(50_000) * (SECOND // 10)
    late = steady + random.integers(0, SECOND // 25, steady.size)
    kept = np.delete(steady, [k for n in range(1, 499) for k in range(100 * n, 100 * n + 30)])
    for time in (steady, late, kept):
        assert SourceWatch().see_many(time, time, np.full(time.size, 20.0)) == []


@pytest.mark.parametrize(
    ('values', 'least'),
    [
        (1000.0 * (1.0 + 0.2 * np.random.default_rng(2).standard_normal(200_000)), 0.0),
        # A swell of 8 s and a quarter of the load, at 2 Hz.
        (1000.0 + 250.0 * np.sin(2.0 * np.pi * np.arange(5000) / 16.0), 0.0),
        # A pulse counter that toggles between 1 and 2 revolutions a minute.
        (1.0 + np.arange(5000) % 2, 3.0),
        (np.repeat([60.0, 45.0, 60.0, 30.0, 60.0], 600), 0.0),
        (np.linspace(70.0, 0.0, 12), 0.0),
        (np.where(np.arange(600) == 300, 1e6, 60.0), 0.0),
        (np.empty(0), 0.0),
    ],
    ids=['noise', 'swell', 'counter', 'steps', 'stop', 'spike', 'empty'],
)
def test_one_source_is_no_fault(values: Floats, least: float) -> None:
    time = instants(values.size)
    assert SourceWatch(least).see_many(time, time, values) == []


def test_two_clocks_are_found_and_single_late_messages_are_not() -> None:
    arrival = instants(400)
    value = np.full(400, 60.0)
    odd = np.arange(400) % 2 == 1
    for shift in (SECOND, -3600 * SECOND):
        (fault,) = SourceWatch().see_many(arrival, arrival + shift * odd, value)
        assert fault.kind is STAMPS
        # Every second sample steps back, and the first step is the second or third sample.
        assert fault.raised_ns <= 3.3 * SECOND
    late = arrival - 2 * SECOND * (np.random.default_rng(3).random(400) < 0.05)
    assert SourceWatch().see_many(arrival, late, value) == []
    jumped = arrival - np.where(arrival > 20 * SECOND, 30 * SECOND, 0)
    assert SourceWatch().see_many(arrival, jumped, value) == []


def test_a_fault_stands_for_a_minute_and_clears_when_values_settle() -> None:
    watch = SourceWatch()
    values = [*mixed(100, 2).tolist(), 20.0, 20.0]
    for k, value in enumerate(values):
        watch.see(k * SECOND // 10, k * SECOND // 10, value)
    last = 99 * SECOND // 10
    assert [fault.kind for fault in watch.standing(last + 60 * SECOND)] == [TWO]
    assert watch.standing(last + 60 * SECOND + 1) == ()


def test_what_is_said(configure: Callable[..., MonitorConfig]) -> None:
    config = configure(load__unit='kN', load__offset=0.5, load__scale=2.0).bearing('aft')
    # Three revolutions a minute of a journal of 0.1 m.
    assert least_gap(config, 0) == pytest.approx(3.0 / 60.0 * np.pi * 0.1)
    assert least_gap(config, 1) == 0.0
    fault = SourceFault(TWO, 0, 0, (600.0, 1500.0))
    assert fault_text(fault, config.load).endswith('(here 0.05 and 0.5)')
    assert 'two publishers or clocks' in fault_text(SourceFault(STAMPS, 0, 0), config.load)
