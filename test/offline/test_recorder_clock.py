# SPDX-License-Identifier: Apache-2.0
"""Verdicts on the recorder's clock, against the monitor fed with one message after the other."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from stickslip_monitor.monitor.bulk import Scan
from stickslip_monitor.monitor.config_file import load_config
from stickslip_monitor.monitor.monitor import BearingMonitor, Monitor
from stickslip_monitor.monitor.signals import Input, Stream
from stickslip_monitor.monitor.verdict import Event
from stickslip_monitor.offline.truth import on_recorder_clock

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
    inputs = np.tile([Input.SPEED, Input.LOAD], shift_s.size)
    speed = np.interp(second % 120, [0, 20, 60, 80, 120], [60.0, 60.0, 25.0, 25.0, 60.0])
    stamp = log + np.rint(np.repeat(shift_s, 2) * S).astype(np.int64)
    return Stream(stamp, inputs, np.where(inputs == Input.LOAD, 1000.0, speed)), log


def shifted(jumps: dict[int, float], seconds: int) -> NDArray[np.float64]:
    """What the clock is off by in each second, by the second of each change."""
    shift = np.zeros(seconds)
    for second, by in jumps.items():
        shift[second:] = by
    return shift


def scanned(stream: Stream, start_ns: int = START, end_ns: int | None = None) -> Scan:
    return Monitor(CONFIG).scan({BEARING.name: stream}, start_ns, end_ns)[BEARING.name]


def heard(stream: Stream, log: IntArray) -> list[tuple[Event, int, int]]:
    """Each event of the monitor's other door, with when the message before it and its own came."""
    monitor = BearingMonitor(BEARING)
    monitor.advance(START)
    found, before = [], START
    rows = zip(stream.inputs, stream.time_ns.tolist(), stream.value.tolist(), log, strict=True)
    for *sample, now in rows:
        found += [(event, before, int(now)) for event in monitor.update(*sample).events]
        before = int(now)
    return found


@pytest.mark.parametrize(
    ('shift', 'least'),
    [
        (shifted({100: -30.0}, 240), 3),
        (shifted({30: -20.0, 55: -50.0, 90: 0.0}, 240), 3),
        (shifted({50: 3600.0, 90: -3600.0, 200: 0.0}, 240), 3),
        (shifted({40: -3.0, 41: -40.0, 42: -80.0}, 240), 3),
        (shifted({0: -1e6}, 240), 3),
        # A clock that runs slow or fast.
        (-0.1 * np.arange(240), 3),
        (0.1 * np.arange(240), 3),
        # Delays and time-outs end at all distances from the jump, some of them just before it.
        *((shifted({second: -25.0}, 90), 1) for second in range(24, 62, 3)),
    ],
    ids=lambda value: '' if isinstance(value, np.ndarray) else None,
)
def test_events_come_with_the_message_that_brings_them(
    shift: NDArray[np.float64], least: int
) -> None:
    stream, log = recording(shift)
    moved = on_recorder_clock(stream, log, scanned(stream))
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
    scan = scanned(right)
    assert on_recorder_clock(right, log, scan) is scan
    moved = on_recorder_clock(wrong, log, scanned(wrong, int(wrong.time_ns[0])))
    assert [e.time_ns for e in moved.events] == [e.time_ns for e in scan.events]
    np.testing.assert_array_equal(moved.time_ns, scan.time_ns)
    np.testing.assert_array_equal(moved.until_ns, scan.until_ns)


def test_a_gap_lasts_as_long_as_the_clocks_agree() -> None:
    """Load silent from 60.2 to 90.2 s: lost 5 s later by its timeout, told between messages."""
    stream, log = recording(np.full(120, 2.0))
    kept = ~((stream.inputs == Input.LOAD) & (log > START + 61 * S) & (log < START + 90 * S))
    stream = Stream(stream.time_ns[kept], stream.inputs[kept], stream.value[kept])
    moved = on_recorder_clock(stream, log[kept], scanned(stream))
    (lost,) = [e for e in moved.events if e.lost]
    last_load = START + 60 * S + 200_000_000
    assert lost.time_ns == last_load + BEARING.load.timeout_ns
    gap = np.flatnonzero(moved.until_ns[:-1] < moved.time_ns[1:])
    assert moved.until_ns[gap].tolist() == [last_load + BEARING.load.timeout_ns]


def test_nothing_believed_has_no_clock() -> None:
    stream, log = recording(np.full(20, 2.0))
    silent = Stream(stream.time_ns, stream.inputs, np.full(stream.value.shape, np.nan))
    scan = scanned(silent, end_ns=START + 20 * S)
    assert scan.events
    assert on_recorder_clock(silent, log, scan).events == scan.events
