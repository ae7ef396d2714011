# SPDX-License-Identifier: Apache-2.0
"""The order of events where a recorder's clock was set back: values count up, and must go on."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_logs import START
from mcap.writer import Writer
from shared import CONFIG

from stickslip_logs.recordings.log_time_scale import ask_for_time_unit
from stickslip_logs.recordings.reader import open_bag
from stickslip_logs.recordings.recording import Request
from stickslip_logs.recordings.writer import BagWriter, encode_float64s, encode_stamped
from stickslip_monitor.monitor.parameter_file import load_config
from stickslip_monitor.offline.check import CheckReport, check_recording

SECOND = 10**9
STAMPED = 'geometry_msgs/msg/WrenchStamped'


Rows = list[tuple[str, int, float]]
X, Y = Request('/x', 'data'), Request('/y', 'data')


def write_chunks(path: Path, chunks: Sequence[Rows]) -> None:
    """Write chunks of messages: topic, log time [ns] and value."""
    with path.open('wb') as file:
        writer = Writer(file, 1 << 30)
        writer.start('ros2', 'test')
        schema = writer.register_schema('std_msgs/msg/Float64', 'ros2msg', b'float64 data\n')
        names = dict.fromkeys(topic for rows in chunks for topic, *_ in rows)
        channels = {name: writer.register_channel(name, 'cdr', schema) for name in names}
        for rows in chunks:
            for topic, time, value in rows:
                writer.add_message(channels[topic], time, encode_float64s([value])[0], time)
            writer.flush()
        writer.finish()


def count_up(times: Sequence[int], topic: str = '/x') -> Rows:
    return [(topic, int(time), float(k)) for k, time in enumerate(times)]


def in_chunks(rows: Rows, size: int) -> list[Rows]:
    return [rows[k : k + size] for k in range(0, len(rows), size)]


@pytest.mark.parametrize('step', [199, 200, 201, 300])
@pytest.mark.parametrize('size', [1, 7, 100, 101, 300, 1000])
def test_messages_after_a_step_back_follow_those_before_it(tmp_path: Path, size: int, step: int) -> None:
    """Steps inside of chunks, exactly between two, and beside such a boundary."""
    times = START + np.arange(400) * SECOND
    times[step:] -= 150 * SECOND
    write_chunks(tmp_path / 'a.mcap', in_chunks(count_up(times.tolist()), size))
    recording = open_bag(tmp_path / 'a.mcap')
    series = recording.read([X])[X]
    np.testing.assert_array_equal(series.value, np.arange(400.0))
    assert (np.diff(series.log_time_ns) > 0).all()
    assert [m.log_time_ns for m in recording.messages()] == series.log_time_ns.tolist()
    assert 'was set back once, by 150 s' in ' '.join(recording.warnings)


def test_steps_of_several_topics_are_one(tmp_path: Path) -> None:
    times = START + np.arange(300) * SECOND
    times[200:] -= 150 * SECOND
    rows = [row for k, at in enumerate(times.tolist()) for row in (('/x', at, k), ('/y', at + 9, k))]
    write_chunks(tmp_path / 'a.mcap', in_chunks(rows, 50))
    recording = open_bag(tmp_path / 'a.mcap')
    for series in recording.read([X, Y]).values():
        np.testing.assert_array_equal(series.value, np.arange(300.0))
    assert 'was set back once' in ' '.join(recording.warnings)


@pytest.mark.parametrize('order', ['messages', 'chunks', 'topics', 'late', 'burst'])
def test_blocks_in_no_order_of_time_keep_their_times(tmp_path: Path, order: str) -> None:
    times, rng = START + np.arange(600) * SECOND, np.random.default_rng(5)
    rows = count_up(times.tolist())
    if order == 'messages':
        chunks = in_chunks([rows[k] for k in rng.permutation(600)], 100)
    elif order == 'chunks':
        chunks = [in_chunks(rows, 100)[k] for k in (0, 3, 1, 2, 5, 4)]
    elif order == 'topics':
        chunks = in_chunks([*rows, *count_up(times.tolist(), '/y')], 350)
    elif order == 'burst':
        chunks = in_chunks([*rows[:510], *rows[515:550], *rows[510:515], *rows[550:]], 100)
    else:
        delivery_order = [k + 30 if k % 60 == 0 else k for k in range(600)]
        chunks = in_chunks([rows[k] for k in np.argsort(delivery_order, kind='stable')], 100)
    write_chunks(tmp_path / 'a.mcap', chunks)
    recording = open_bag(tmp_path / 'a.mcap')
    for request in [X, Y][: 1 + (order == 'topics')]:
        series = recording.read([request])[request]
        np.testing.assert_array_equal(series.log_time_ns, times)
        np.testing.assert_array_equal(series.value, np.arange(600.0))
    assert 'set back' not in ' '.join(recording.warnings)


def test_a_step_back_to_before_the_beginning_is_a_clock_that_was_set(tmp_path: Path) -> None:
    """Chunks in another order would fit together without a seam."""
    times = START + np.arange(400) * SECOND
    times[200:] -= 4000 * SECOND
    write_chunks(tmp_path / 'a.mcap', in_chunks(count_up(times.tolist()), 50))
    recording = open_bag(tmp_path / 'a.mcap')
    series = recording.read([X])[X]
    np.testing.assert_array_equal(series.value, np.arange(400.0))
    np.testing.assert_array_equal(series.log_time_ns, START + np.arange(400) * SECOND)
    assert 'was set back once, by 4000 s' in ' '.join(recording.warnings)
    assert (recording.start_ns, recording.end_ns) == (START, START + 399 * SECOND)


def test_one_message_a_year_ahead_makes_no_check_a_year_long(tmp_path: Path) -> None:
    # The chunk says that it ends a year later; the order of its messages says when it ends.
    times = (START + np.arange(600) * SECOND).tolist()
    rows = [row for t in times for row in (('/shaft/speed', t, 60.0), ('/bearing/aft_stern/load', t, 1000.0))]
    rows[600] = '/shaft/speed', times[300] + 365 * 86_400 * SECOND, 60.0
    write_chunks(tmp_path / 'a.mcap', in_chunks(rows, 400))
    report = check_recording(tmp_path / 'a.mcap', load_config(CONFIG))
    assert (report.start_ns, report.end_ns) == (times[0], times[-1])


def test_nothing_is_lost_where_chunks_are_in_no_order_behind_a_step_back(tmp_path: Path) -> None:
    """More messages than are handed on at a time, whatever reason is found of the steps."""
    times = START + np.arange(30_000) * (SECOND // 100)
    times[10_000:] -= 75 * SECOND
    chunks = in_chunks(count_up(times.tolist()), 2500)
    write_chunks(tmp_path / 'a.mcap', [*chunks[:8], *chunks[10:7:-1], chunks[11]])
    recording = open_bag(tmp_path / 'a.mcap')
    series = recording.read([X])[X]
    assert series.value.size == 30_000
    assert (np.diff(series.log_time_ns) >= 0).all()
    assert recording.losses == ()


def condition_changes(path: Path, step: int, edge: int) -> list[tuple[Any, Any]]:
    """Return the changes in two slow-downs, between which the clock is set back [s], in chunks."""
    seconds = np.arange(0, 600, 0.2)
    rpm = 60.0 - 50.0 * np.exp(-(((seconds % 300.0 - 150.0) / 40.0) ** 2))
    time = START + np.arange(seconds.size) * (SECOND // 5) - step * SECOND * (seconds >= 300.0)
    rows: Rows = []
    for at, value in zip(time.tolist(), rpm.tolist(), strict=True):
        rows += [('/shaft/speed', at, value), ('/bearing/aft_stern/load', at + 10**6, 1000.0)]
    edges = [0, 1000, 2000, edge, 4000, len(rows)]
    write_chunks(path, [rows[a:b] for a, b in itertools.pairwise(edges)])
    (bearing,) = check_recording(path, load_config(CONFIG)).bearings.values()
    return [(event.before, event.after) for event in bearing.events]


def test_no_verdict_is_lost_or_doubled_at_a_step_back(tmp_path: Path) -> None:
    # A slow-down on either side of a step, whose chunk begins beside it, gives the events without a step.
    expected = condition_changes(tmp_path / 'a.mcap', 0, 3000)
    assert len(expected) >= 8
    for edge in (2999, 3000, 3001):
        assert condition_changes(tmp_path / 'b.mcap', 280, edge) == expected


@pytest.mark.parametrize(
    ('factor', 'unit'), [(10**3, 'microseconds'), (10**6, 'milliseconds'), (10**9, 'seconds')]
)
def test_dates_in_another_unit_raise_a_question(factor: int, unit: str) -> None:
    start, end = START // factor, (START + 300 * SECOND) // factor
    assert f'are they in {unit}' in ask_for_time_unit(start, end, 3000)
    assert ask_for_time_unit(START, START + 300 * SECOND, 3000) == ''


def check_log_times(folder: Path, log_times: Any) -> CheckReport:
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


def stick_slip_seconds(report: CheckReport) -> tuple[float, list[str]]:
    """Return for how long stick-slip stood [s], and the faults of the inputs' clocks."""
    (bearing,) = report.bearings.values()
    changes = [(e.time_ns, str(e.after) == 'stick_slip') for e in bearing.events]
    ends = [time for time, _ in changes[1:]] + [report.end_ns or 0]
    lasting = sum(end - time for (time, is_sticking), end in zip(changes, ends, strict=True) if is_sticking)
    return lasting / SECOND, [item.fault for item in bearing.inputs]


def test_log_times_at_the_pace_of_the_stamps_are_no_fault(tmp_path: Path) -> None:
    seconds, faults = stick_slip_seconds(check_log_times(tmp_path, lambda stamp: stamp + SECOND // 100))
    assert seconds == pytest.approx(180.0, abs=15.0)
    assert faults == ['', '']


@pytest.mark.parametrize('pace', [0.1, 0.002, 20.0])
def test_rewritten_log_times_are_reported_and_hide_nothing(tmp_path: Path, pace: float) -> None:
    later = START + 86_400 * SECOND
    seconds, faults = stick_slip_seconds(
        check_log_times(tmp_path, lambda stamp: later + (stamp - START) * pace)
    )
    assert seconds == pytest.approx(180.0, abs=15.0)
    assert set(faults) == {
        f'Log times pass {pace:g} times as fast as the stamps, so they were rewritten: judged by the stamps.'
    }
