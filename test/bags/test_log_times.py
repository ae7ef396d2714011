# SPDX-License-Identifier: Apache-2.0
"""The order of events where a recorder's clock was set back: values count up, and must go on."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from shared import CONFIG, START

from stickslip_monitor.bags.log_times import BlockSteps, StepClock, question_of_unit
from stickslip_monitor.bags.reader import open_bag
from stickslip_monitor.bags.recording import Request
from stickslip_monitor.bags.writer import BagWriter, encode_float64s, encode_stamped
from stickslip_monitor.monitor.parameter_file import load_config
from stickslip_monitor.offline.check import CheckReport, check_recording

SECOND = 10**9
STAMPED = 'geometry_msgs/msg/WrenchStamped'


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


def _checked(folder: Path, log_times: Any) -> CheckReport:
    """60 rpm for a minute, 20 rpm for three, 60 rpm for one, stamped ten times a second."""
    stamp = START + np.arange(3000) * (SECOND // 10)
    rpm = np.where((np.arange(3000) >= 600) & (np.arange(3000) < 2400), 20.0, 60.0)
    log = np.asarray(log_times(stamp), np.int64)
    config = folder / 'config.yaml'
    text = CONFIG.read_text('utf-8')
    for name, unit in (('speed', 'rpm'), ('load', 'N')):
        old = next(line for line in text.splitlines() if f'{name}: {{' in line)
        fields = f'topic: /{name}, type: {STAMPED}, field: wrench.force.z, unit: {unit}'
        text = text.replace(old, f'{old[: old.index(name)]}{name}: {{{fields}}}')
    config.write_text(text)
    with BagWriter(folder / 'bag.mcap') as bag:
        for name in ('/speed', '/load'):
            bag.add_topic(name, STAMPED)
        columns = [
            (name, log, encode_stamped(STAMPED, 'wrench.force.z', stamp, values))
            for name, values in (('/speed', rpm), ('/load', np.full(3000, 1e3)))
        ]
        bag.write_columns(columns)
    return check_recording(folder / 'bag.mcap', load_config(config))


def _stick_slip(report: CheckReport) -> tuple[float, list[str]]:
    """For how long stick-slip stood [s], and what is said of the inputs' clocks."""
    (bearing,) = report.bearings.values()
    own = [(e.time_ns, str(e.after) == 'stick_slip') for e in bearing.events]
    ends = [time for time, _ in own[1:]] + [report.end_ns or 0]
    lasting = sum(end - time for (time, there), end in zip(own, ends, strict=True) if there)
    return lasting / SECOND, [item.fault for item in bearing.inputs]


def test_what_is_played_at_its_own_pace_is_no_fault(tmp_path: Path) -> None:
    seconds, faults = _stick_slip(_checked(tmp_path, lambda stamp: stamp + SECOND // 100))
    assert seconds == pytest.approx(180.0, abs=15.0)
    assert faults == ['', '']


@pytest.mark.parametrize('pace', [0.1, 0.002, 20.0])
def test_rewritten_log_times_are_told_and_hide_nothing(tmp_path: Path, pace: float) -> None:
    later = START + 86_400 * SECOND
    seconds, faults = _stick_slip(_checked(tmp_path, lambda stamp: later + (stamp - START) * pace))
    assert seconds == pytest.approx(180.0, abs=15.0)
    assert set(faults) == {
        f'Log times pass {pace:g} times as fast as the stamps, so they were rewritten: judged by the stamps.'
    }
