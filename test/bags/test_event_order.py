# SPDX-License-Identifier: Apache-2.0
"""The order of events where a recorder's clock was set back: values count up, and must go on."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from stickslip_monitor.bags.encode import encode_float64s
from stickslip_monitor.bags.event_order import BlockSteps, StepClock, question_of_unit
from stickslip_monitor.bags.reader import open_bag
from stickslip_monitor.bags.values import Request
from stickslip_monitor.bags.writer import BagWriter

SECOND = 10**9
START = 1_776_074_400 * SECOND


@pytest.mark.parametrize('chunk_size', [2000, 1 << 20])
def test_what_follows_a_step_back_comes_behind_what_was_before(tmp_path: Path, chunk_size: int) -> None:
    path, times = tmp_path / 'a.mcap', START + np.arange(400) * SECOND
    times[300:] -= 200 * SECOND
    with BagWriter(path, chunk_size=chunk_size) as bag:
        bag.add_topic('/x', 'std_msgs/msg/Float64')
        for data, time in zip(encode_float64s(np.arange(400.0)), times.tolist(), strict=True):
            bag.write('/x', time, data)
    recording = open_bag(path)
    series = recording.read([Request('/x', 'data')])[Request('/x', 'data')]
    np.testing.assert_array_equal(series.value, np.arange(400.0))
    assert (np.diff(series.log_time_ns) > 0).all()
    assert 'was set back once, by 199 s' in ' '.join(recording.warnings)


def test_blocks_in_no_order_of_time_keep_their_times() -> None:
    rng = np.random.default_rng(5)
    times = rng.permutation(np.arange(500) * SECOND)
    steps = BlockSteps(0)
    np.testing.assert_array_equal(steps.follow(0, times), times)
    assert steps.steps_ns == []


def test_one_late_line_is_no_step() -> None:
    times = np.array([0, 10, 20, 5, 30, 40]) * SECOND
    shifted, arrival = StepClock(SECOND).follow(times)
    np.testing.assert_array_equal(shifted, times)
    np.testing.assert_array_equal(arrival, np.array([0, 10, 20, 20, 30, 40]) * SECOND)


@pytest.mark.parametrize(('factor', 'unit'), [(10**3, 'microseconds'), (10**6, 'milliseconds')])
def test_dates_in_another_unit_are_asked_about(factor: int, unit: str) -> None:
    start, end = START // factor, (START + 300 * SECOND) // factor
    assert f'are they in {unit}' in question_of_unit(start, end, 3000)
    assert question_of_unit(START, START + 300 * SECOND, 3000) == ''
