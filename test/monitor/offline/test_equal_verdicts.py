# SPDX-License-Identifier: Apache-2.0
"""The recordings of ``bags/`` as CSV, Parquet and SQLite: equal verdicts in every field."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pyarrow as pa
import pytest
from pyarrow import parquet
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from stickslip_logs.recordings.reader import open_bag
from stickslip_logs.recordings.recording import Request
from stickslip_monitor.cli import main

ROOT = Path(__file__).resolve().parents[3]
CONFIG = ROOT / 'launch_configs/reference_bearing.yaml'
SPEED, LOAD = '/shaft/speed', '/bearing/aft_stern/load'
Row = tuple[int, str, float]


def read_numbers(bag: Path) -> list[Row]:
    """Log time [ns], topic and number of every message, in order."""
    recording = open_bag(bag)
    series_of = recording.read([Request(SPEED, 'data'), Request(LOAD, 'data')])
    rows = [
        (sequence, (time, request.topic, value))
        for request, series in series_of.items()
        for sequence, time, value in zip(
            series.sequence.tolist(), series.log_time_ns.tolist(), series.value.tolist(), strict=True
        )
    ]
    return [row for _, row in sorted(rows)]


def as_csv(path: Path, rows: list[Row]) -> Path:
    lines = [f'{time},{topic},{value!r}' for time, topic, value in rows]
    path.with_suffix('.csv').write_text('\n'.join(['time,tag,value', *lines, '']))
    return path.with_suffix('.csv')


def as_parquet(path: Path, rows: list[Row]) -> Path:
    times, topics, values = zip(*rows, strict=True)
    table = pa.table({'time': pa.array(times, pa.timestamp('ns', 'UTC')), 'name': topics, 'value': values})
    parquet.write_table(table, path.with_suffix('.parquet'))
    return path.with_suffix('.parquet')


def as_sqlite(path: Path, rows: list[Row]) -> Path:
    store = get_typestore(Stores.ROS2_HUMBLE)
    number = store.types['std_msgs/msg/Float64']
    with Writer(path, version=8, storage_plugin=StoragePlugin.SQLITE3) as writer:
        topics = {
            topic: writer.add_connection(topic, 'std_msgs/msg/Float64', typestore=store)
            for topic in (SPEED, LOAD)
        }
        for time, topic, value in rows:
            data = store.serialize_cdr(number(value), 'std_msgs/msg/Float64')
            writer.write(topics[topic], time, data)
    return path


def check_verdict(path: Path, capsys: pytest.CaptureFixture[str]) -> dict[str, Any]:
    main(['check', str(path), '--config', str(CONFIG), '--json'])
    bearing: dict[str, Any] = json.loads(capsys.readouterr().out)['bearings']['aft_stern']
    return bearing


@pytest.mark.parametrize('name', ['coast_down', 'crash_stop', 'history_below'])
@pytest.mark.parametrize('make', [as_csv, as_parquet, as_sqlite])
def test_the_verdicts_are_equal(
    make: Any, name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = ROOT / 'bags' / name
    verdict = check_verdict(make(tmp_path / 'log', read_numbers(bag)), capsys)
    assert verdict == check_verdict(bag, capsys)
    assert verdict['events']
