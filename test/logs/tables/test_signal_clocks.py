# SPDX-License-Identifier: Apache-2.0
"""Exports in which each signal has a column of times of its own."""

from __future__ import annotations

from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from nasty_logs import open_log, times_after_start

from stickslip_logs.recordings.reader import open_bag
from stickslip_logs.recordings.recording import Recording, Request


def times_and_values(recording: Recording, *names: str) -> list[tuple[list[int], list[float]]]:
    columns = recording.read([Request(name, 'data') for name in names]).values()
    return [(series.stamp_ns.tolist(), series.value.tolist()) for series in columns]


@pytest.mark.parametrize(
    'text',
    [
        'Time,rpm,Time,load\n@0,30,@4,900\n@1,31,@6,901\n',
        'rpm Time,rpm,load Time,load\n@0,30,@4,900\n@1,31,@6,901\n',
        'rpm,Time,load,Time\n30,@0,900,@4\n31,@1,901,@6\n',
        'rpm,rpm_TIMESTAMP,load,load_TIMESTAMP\n30,@0,900,@4\n31,@1,901,@6\n',
        'time,rpm,rpm_time,load,load_time\n@0,30,@0,900,@4\n@1,31,@1,901,@6\n',
        'Time,rpm,torque,measured,load\n@0,30,5,@4,900\n@1,31,5,@6,901\n',
        'Date,Time,rpm,Date,Time,load\n'
        '2026-04-13,10:00:00,30,2026-04-13,10:00:04,900\n2026-04-13,10:00:01,31,2026-04-13,10:00:06,901\n',
        'Time,load,Time,rpm\n@4,900,@0,30\n@6,901,@1,31\n,,@2,32\n,,@3,33\n',
        'Time,rpm,Time,load\n@0,30,@4,900\n@1,31,@6,901\n@2,32\n@3,33\n@4,34\n',
        'Time,rpm,Time,load\n@0,30,@4,900\n@1,31\n@2,32\n@3,33,@6,901\n@4,34\n',
        'Time;rpm;Time;load\n13.04.2026 10:00:00;30;13.04.2026 10:00:04;900\n'
        '13.04.2026 10:00:01;31;13.04.2026 10:00:06;901\n',
        # The names of a trend stand above its headings, over its times or its values.
        'rpm;;load;\nTime;Value;Time;Value\n@0;30;@4;900\n@1;31;@6;901\n',
        'Name of the tag:,rpm,,load\nTime,Value,Time,Value\n@0,30,@4,900\n@1,31,@6,901\n',
        'rpm,,,load,,\nTime,Value,Quality,Time,Value,Quality\n@0,30,Good,@4,900,Good\n@1,31,Good,@6,901,Good\n',
        'Timestamp\trpm\tTimestamp\tload\n'
        '1776074400000\t30\t1776074404000\t900\n1776074401000\t31\t1776074406000\t901\n',
    ],
)
def test_each_value_has_the_time_beside_it(text: str, tmp_path: Path) -> None:
    recording = open_log(tmp_path, text)
    (speed_ns, speed), (load_ns, load) = times_and_values(recording, 'rpm', 'load')
    assert (speed_ns[:2], speed[:2]) == (times_after_start(0, 1), [30, 31])
    assert (load_ns, load) == (times_after_start(4, 6), [900, 901])
    assert speed_ns == times_after_start(*range(len(speed)))
    assert any('columns are times, each of the signals beside it' in text for text in recording.warnings)
    assert recording.losses == ()


@pytest.mark.parametrize('name', ['Time', 'load Time'])
def test_a_signal_that_begins_behind_the_head_has_its_own_time(name: str, tmp_path: Path) -> None:
    # By the time of the other its values came an hour too early.
    first = ''.join(f'2026-04-13T10:{k // 60:02}:{k % 60:02}Z,30,,\n' for k in range(3000))
    then = ''.join(f'2026-04-13T10:50:{k:02}Z,30,2026-04-13T11:50:{k:02}Z,900\n' for k in range(5))
    padding = ''.join(f'2026-04-13T10:51:{k % 60:02}Z,30,,\n' for k in range(1000))
    recording = open_log(tmp_path, f'Time,rpm,{name},load\n{first}{then}{padding}')
    ((load_ns, _),) = times_and_values(recording, 'load')
    assert load_ns == times_after_start(*(6600 + k for k in range(5)))


@pytest.mark.parametrize(
    'text',
    [
        # The same time in another zone, an arrival, a time that does not rise, another quantity.
        'time,rpm,local time,load\n@0,30,~0,900\n@1,31,~1,901\n',
        'time,rpm,arrival,load\n@0,30,@9,900\n@1,31,@9,901\n@2,32,@9,902\n@3,32,@9,902\n',
        'time,rpm,eta,load\n@0,30,@9,900\n@1,31,@7,901\n@2,32,@8,902\n',
        't,rpm,T,load\n0,30,21.5,900\n1,31,21.4,901\n2,31,21.5,901\n',
        'time,rpm,load,received\n@0,30,900,@5\n@1,31,901,@9\n',
        'time,rpm,event time,load\n@0,30,,900\n@1,31,,901\n',
        'time,rpm,event time,load\n@0,30,none,900\n@1,31,none,901\n',
    ],
)
def test_of_a_time_that_is_no_signals_nothing_is_taken(text: str, tmp_path: Path) -> None:
    (speed_ns, _), (load_ns, _) = times_and_values(open_log(tmp_path, text), 'rpm', 'load')
    assert speed_ns == load_ns
    assert len(speed_ns) == text.count('\n') - 1


def test_a_clock_is_of_the_signals_that_have_all_its_words(tmp_path: Path) -> None:
    text = 'shaft time,bearing time,shaft rpm,bearing load\n@0,@4,30,900\n@1,@6,31,901\n'
    series = times_and_values(open_log(tmp_path, text), 'shaft rpm', 'bearing load')
    assert series == [(times_after_start(0, 1), [30, 31]), (times_after_start(4, 6), [900, 901])]


def test_a_value_without_its_own_time_is_lost(tmp_path: Path) -> None:
    recording = open_log(tmp_path, 'Time,rpm,Time,load\n@0,30,@4,900\n@1,31,,901\n@2,32,,\n')
    assert [len(values) for _, values in times_and_values(recording, 'rpm', 'load')] == [3, 1]
    assert recording.losses == ('1 line without a time was not used',)


def test_headings_alike_in_another_order_further_down(tmp_path: Path) -> None:
    text = 'Time,rpm,Time,load\n@0,30,@4,900\nTime,load,Time,rpm\n@5,901,@1,31\n'
    recording = open_log(tmp_path, text)
    assert times_and_values(recording, 'load')[0][1] == [900, 901]


def test_times_of_each_signal_in_parquet(tmp_path: Path) -> None:
    times = [pa.array(times_after_start(*seconds), pa.timestamp('ns', 'UTC')) for seconds in ((0, 1), (4, 6))]
    columns = {'rpm time': times[0], 'rpm': [30.0, 31.0], 'load time': times[1], 'load': [900.0, 901.0]}
    pq.write_table(pa.table(columns), tmp_path / 'voyage.parquet')
    series = times_and_values(open_bag(tmp_path / 'voyage.parquet'), 'rpm', 'load')
    assert series == [(times_after_start(0, 1), [30, 31]), (times_after_start(4, 6), [900, 901])]


def test_times_of_each_signal_may_come_newest_first(tmp_path: Path) -> None:
    rows = [f'@{9 - k},{30 + k},2026-04-13T09:00:0{9 - k}Z,{900 + k}\n' for k in range(10)]
    recording = open_log(tmp_path, 'Time,rpm,Time,load\n' + ''.join(rows))
    assert len(recording.table.clocks) == 2
    assert times_and_values(recording, 'load')[0][1] == list(range(909, 899, -1))
