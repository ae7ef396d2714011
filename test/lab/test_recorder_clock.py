# SPDX-License-Identifier: Apache-2.0
"""Verdicts on the recorder's clock, against the monitor fed with one message after the other."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from stickslip_monitor.lab.recorder_clock import on_recorder_clock
from stickslip_monitor.monitor.config import MonitorConfig
from stickslip_monitor.monitor.config_file import load_config
from stickslip_monitor.monitor.monitor import BearingMonitor, Monitor
from stickslip_monitor.monitor.signals import Stream
from stickslip_monitor.monitor.verdict import Event

ROOT = Path(__file__).resolve().parents[2]
CONFIG = load_config(ROOT / 'launch_configs' / 'reference_bearing.yaml')
BEARING = CONFIG.bearings[0]
S = 1_000_000_000
START = 1_700_000_000 * S
IntArray = NDArray[np.int64]


def recording(shift_s: NDArray[np.float64]) -> tuple[Stream, IntArray]:
    """Speed and load of 1 kN once a second each, at sine-like speeds across the bistable range.

    Args:
        shift_s: By how much the sensors' clock is off in each second [s].
    """
    second = np.repeat(np.arange(shift_s.size), 2)
    log = START + second * S + np.tile([0, 200_000_000], shift_s.size)
    place = np.tile([0, 1], shift_s.size)
    speed = np.interp(second % 120, [0, 20, 60, 80, 120], [60.0, 60.0, 25.0, 25.0, 60.0])
    stamp = log + np.rint(np.repeat(shift_s, 2) * S).astype(np.int64)
    return Stream(stamp, place, np.where(place, 1000.0, speed)), log


def heard(stream: Stream, log: IntArray) -> list[tuple[Event, int, int]]:
    """Each event of the monitor's other door, with when the message before it and its own came."""
    monitor = BearingMonitor(BEARING)
    monitor.advance(START)
    found = []
    rows = zip(
        stream.inputs.astype(int).tolist(),
        stream.time_ns.tolist(),
        stream.value.tolist(),
        strict=True,
    )
    before = START
    for row, now in zip(rows, log.tolist(), strict=True):
        found += [(event, before, now) for event in monitor.update(*row).events]
        before = now
    return found


@pytest.mark.parametrize(
    'jumps',
    [
        {100: -30.0},
        {30: -20.0, 55: -50.0, 90: 0.0},
        {50: 3600.0, 90: -3600.0, 200: 0.0},
        {40: -3.0, 41: -40.0, 42: -80.0},
        {0: -1e6},
    ],
    ids=str,
)
def test_events_come_with_the_message_that_brings_them(jumps: dict[int, float]) -> None:
    check_events(*recording(shifted(jumps, 240)))


@pytest.mark.slow
def test_what_falls_due_just_before_a_jump_came_before_it() -> None:
    """Delays and time-outs end at all distances from the jump, some of them just before it."""
    for second in range(24, 62):
        check_events(*recording(shifted({second: -25.0}, 90)), least=1)


def test_points_bear_the_time_of_their_message_whatever_the_clock_runs_like() -> None:
    for rate in (-0.1, 0.1):
        check_events(*recording(rate * np.arange(240)))


def shifted(jumps: dict[int, float], seconds: int) -> NDArray[np.float64]:
    """What the clock is off by in each second, by the second of each change."""
    shift = np.zeros(seconds)
    for second, by in jumps.items():
        shift[second:] = by
    return shift


def check_events(stream: Stream, log: IntArray, least: int = 3) -> None:
    """Compare the scan on the recorder's clock with messages that come one after the other."""
    scan = Monitor(CONFIG).scan({BEARING.name: stream}, START, None)[BEARING.name]
    moved = on_recorder_clock(BEARING, stream, log, scan, START)
    expected = heard(stream, log)
    assert len(moved.events) == len(expected) >= least
    for event, (told, before, now) in zip(moved.events, expected, strict=True):
        assert replace(event, time_ns=told.time_ns) == told
        assert before <= event.time_ns <= now
    assert all(a.time_ns <= b.time_ns for a, b in pairwise(moved.events))
    # Points are taken when a message completes them: they bear its time.
    assert np.isin(moved.time_ns, log).all()
    assert np.all(np.diff(moved.time_ns) >= 0)
    assert np.all(moved.until_ns[:-1] <= moved.time_ns[1:])


def test_a_constant_error_of_the_clock_is_none_of_the_recorder() -> None:
    right, log = recording(np.zeros(240))
    wrong, _ = recording(np.full(240, -12.3))
    scans = [
        Monitor(CONFIG).scan({BEARING.name: stream}, int(stream.time_ns[0]), None)[BEARING.name]
        for stream in (right, wrong)
    ]
    assert on_recorder_clock(BEARING, right, log, scans[0], START) is scans[0]
    moved = on_recorder_clock(BEARING, wrong, log, scans[1], int(wrong.time_ns[0]))
    assert [e.time_ns for e in moved.events] == [e.time_ns for e in scans[0].events]
    np.testing.assert_array_equal(moved.time_ns, scans[0].time_ns)
    np.testing.assert_array_equal(moved.until_ns, scans[0].until_ns)


def test_a_gap_lasts_as_long_as_the_clocks_agree() -> None:
    """Load silent from 60.2 to 90.2 s: lost 5 s later by its timeout, told between messages."""
    stream, log = recording(np.full(120, 2.0))
    kept = ~(stream.inputs & (log > START + 61 * S) & (log < START + 90 * S))
    stream = Stream(stream.time_ns[kept], stream.inputs[kept], stream.value[kept])
    scan = Monitor(CONFIG).scan({BEARING.name: stream}, START, None)[BEARING.name]
    moved = on_recorder_clock(BEARING, stream, log[kept], scan, START)
    (lost,) = [e for e in moved.events if e.lost]
    timeout = BEARING.load.timeout_ns
    last_load = START + 60 * S + 200_000_000
    assert lost.time_ns == last_load + timeout
    gap = np.flatnonzero(moved.until_ns[:-1] < moved.time_ns[1:])
    assert moved.until_ns[gap].tolist() == [last_load + timeout]


def test_nothing_believed_has_no_clock() -> None:
    stream, log = recording(np.full(20, 2.0))
    silent = Stream(stream.time_ns, stream.inputs, np.full(stream.value.shape, np.nan))
    config = MonitorConfig((BEARING,))
    scan = Monitor(config).scan({BEARING.name: silent}, START, START + 20 * S)[BEARING.name]
    assert scan.events
    moved = on_recorder_clock(BEARING, silent, log, scan, START)
    assert moved.events == scan.events
