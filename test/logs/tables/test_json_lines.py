# SPDX-License-Identifier: Apache-2.0
"""Lines of JSON: messages of NMEA 2000 by canboat, and those that a command has to convert first."""

from __future__ import annotations

import json
import re
from datetime import datetime, timedelta, timezone
from pathlib import Path
from typing import Any

import pytest
from nasty_logs import epoch_ns, open_log

from stickslip_logs.errors import BagError
from stickslip_logs.recordings.reader import open_bag
from stickslip_logs.recordings.recording import Request

TIMES = [datetime(2026, 5, 4, 6, 0, tzinfo=timezone.utc) + timedelta(milliseconds=100 * k) for k in range(20)]


def canboat_line(time: str, pgn: int, fields: dict[str, Any], src: int = 17) -> str:
    record = {
        'timestamp': time,
        'prio': 2,
        'src': src,
        'dst': 255,
        'pgn': pgn,
        'description': 'x',
        'fields': fields,
    }
    return json.dumps(record) + '\n'


def engine_line(k: int, form: str = '%Y-%m-%dT%H:%M:%S.%fZ', src: int = 17, **fields: Any) -> str:
    engine = {'Instance': 'Single Engine or Dual Engine Port', 'Speed': 1000.25 + k, **fields}
    return canboat_line(TIMES[k].strftime(form), 127488, engine, src)


@pytest.mark.parametrize('form', ['%Y-%m-%dT%H:%M:%S.%fZ', '%Y-%m-%d-%H:%M:%S.%f'])
@pytest.mark.parametrize('instance', ['Single Engine or Dual Engine Port', 0, {'value': 0, 'name': 'Single'}])
def test_engine_speeds_of_canboat(form: str, instance: object, tmp_path: Path) -> None:
    head = '{"version":"5.0.0","units":"std","showLookupValues":false}\n'
    recording = open_log(tmp_path, head + ''.join(engine_line(k, form, Instance=instance) for k in range(20)))
    (topic,) = recording.topics
    assert (topic, recording.topics[topic].type) == ('127488.engine.0.Speed', 'column in rpm')
    (series,) = recording.read([Request(topic, 'data')]).values()
    assert series.stamp_ns.tolist() == [epoch_ns(time) for time in TIMES]
    assert series.value.tolist() == [1000.25 + k for k in range(20)]


@pytest.mark.parametrize('instance', [['a'], {'value': {}}, {'value': [0]}])
def test_a_message_with_an_odd_instance_is_damaged(instance: object, tmp_path: Path) -> None:
    lines = [engine_line(k) for k in range(20)]
    recording = open_log(tmp_path, ''.join([*lines[:3], engine_line(3, Instance=instance), *lines[3:]]))
    (series,) = recording.read([Request('127488.engine.0.Speed', 'data')]).values()
    assert series.value.size == 20
    assert any('1 line damaged' in text for text in recording.losses)


def test_other_fields_by_path_and_other_senders_by_name(tmp_path: Path) -> None:
    lines = [engine_line(k) + engine_line(k, src=18, Instance='Dual Engine Starboard') for k in range(20)]
    lines += [engine_line(k, src=99) for k in range(5)]
    time = TIMES[3].strftime('%Y-%m-%dT%H:%M:%S.%fZ')
    load = {'value': 40, 'name': 'x'}
    lines += [
        canboat_line(
            time, 127489, {'Instance': 1, 'Oil pressure': 300000, 'Status': ['a'], 'Engine Load': load}
        ),
        canboat_line(time, 130576, {'Port trim tab': 12, 'Name': 'x'}),
        'rubbish {\n',
    ]
    recording = open_log(tmp_path, ''.join(lines))
    assert {*recording.topics} == {
        '127488.engine.0.Speed',
        '127488.engine.1.Speed',
        '127488.engine.0.Speed from 99',
        '127489.engine.1.Oil pressure',
        '127489.engine.1.Engine Load',
        '130576.Port trim tab',
    }
    (series,) = recording.read([Request('127489.engine.1.Engine Load', 'data')]).values()
    assert series.value.tolist() == [40.0]
    assert recording.losses == ('1 line damaged, or without a time was not used',)


def test_names_as_the_option_camel_writes_them(tmp_path: Path) -> None:
    lines = [canboat_line(TIMES[k].isoformat(), 127488, {'instance': k % 2, 'speed': 30}) for k in range(20)]
    recording = open_log(tmp_path, ''.join(lines))
    types = {topic: info.type for topic, info in recording.topics.items()}
    assert types == {f'127488.engine.{k}.speed': 'column in rpm' for k in (0, 1)}


def test_an_array_of_one_object_a_line_is_read(tmp_path: Path) -> None:
    recording = open_log(tmp_path, '[\n' + ',\n'.join(engine_line(k).strip() for k in range(20)) + '\n]\n')
    (series,) = recording.read([Request('127488.engine.0.Speed', 'data')]).values()
    assert (series.value.size, recording.losses) == (20, ())


def test_lines_of_json_are_refused_with_a_command(tmp_path: Path) -> None:
    # The command was run by jq 1.6 on such lines, and its output read: ts, shaft.rpm, load-N, ok, odd.
    path = tmp_path / 'a b.jsonl'
    path.write_text(
        '{"ts": "2026-05-04T06:00:00Z", "shaft": {"rpm": 30}, "load-N": 9, "ok": false, "odd": null}\n' * 3
    )
    program = (
        '[paths(type != "object" and type != "array")] as $keys | ($keys | map(map(tostring) | join("."))),'
        ' ((., inputs) | [getpath($keys[])]) | @csv'
    )
    with pytest.raises(BagError, match=re.escape(f"jq -r '{program}' '{path}' > NEW.csv")):
        open_bag(path)
    # An array is split to lines first, which was run by jq 1.6.
    path.write_text(
        '[\n {"ts": "2026-05-04T06:00:00Z", "rpm": 30},\n {"ts": "2026-05-04T06:00:01Z", "rpm": 31}\n]\n'
    )
    with pytest.raises(BagError, match=re.escape(f"jq -c '.[]' '{path}' | jq -r '{program}' > NEW.csv")):
        open_bag(path)
