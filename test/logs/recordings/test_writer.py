# SPDX-License-Identifier: Apache-2.0
"""Bags we write, read by ``rosbags`` and by us."""

from __future__ import annotations

import contextlib
import dataclasses
import math
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from mcap.reader import make_reader
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from stickslip_logs.errors import BagError
from stickslip_logs.recordings.message_types import definition_of
from stickslip_logs.recordings.reader import open_bag
from stickslip_logs.recordings.recording import Request
from stickslip_logs.recordings.writer import (
    STAMPED_FIELDS,
    TYPE_HASHES,
    BagWriter,
    encode_bool,
    encode_stamped,
    encode_string,
)

STORE, HUMBLE = get_typestore(Stores.ROS2_JAZZY), get_typestore(Stores.ROS2_HUMBLE)
FLOAT64 = 'std_msgs/msg/Float64'
TIMES = np.arange(50) * 1_000_000 + 1_700_000_000_000_000_000
SPEED, LOAD = np.linspace(40.0, 5.0, 50), np.linspace(900.0, 1100.0, 50)


def write_example(path: Path, **options: Any) -> None:
    with BagWriter(path, **options) as writer:
        writer.add_topic('/speed', FLOAT64)
        writer.add_topic('/load', FLOAT64)
        writer.add_topic('/note', 'std_msgs/msg/String')
        writer.add_topic('/clutch', 'std_msgs/msg/Bool')
        writer.add_topic('/never', FLOAT64)
        writer.write('/note', int(TIMES[0]) - 5, encode_string('Prüfstand'))
        writer.write('/clutch', int(TIMES[0]) - 3, encode_bool(True))
        writer.write_float64s({'/speed': (TIMES, SPEED), '/load': (TIMES + 7, LOAD)})


def test_two_writers_do_not_meet(tmp_path: Path) -> None:
    def write() -> None:
        with BagWriter(tmp_path / 'bag.mcap') as first:
            first.add_topic('/x', FLOAT64)
            with BagWriter(tmp_path / 'bag.mcap') as second:
                second.add_topic('/y', FLOAT64)

    with pytest.raises(BagError, match='exists already'):
        write()
    assert [path.name for path in tmp_path.iterdir()] == ['bag.mcap']
    assert list(open_bag(tmp_path / 'bag.mcap').topics) == ['/y']


@pytest.mark.parametrize('name', ['bag.mcap', 'bag'])
def test_the_draft_of_a_killed_process_is_swept_and_that_of_a_living_one_kept(
    tmp_path: Path, name: str
) -> None:
    dead = tmp_path / f'.{name}.7.draft'
    dead.mkdir() if name == 'bag' else dead.touch()
    with BagWriter(tmp_path / name):
        (living,) = {*tmp_path.iterdir()} - {dead}
        for draft in (dead, living):
            os.utime(draft, (time.time() - 60.0,) * 2)
        with contextlib.suppress(BagError), BagWriter(tmp_path / name):
            assert not dead.exists()
            assert living.exists()
            raise BagError('no room')
    assert [path.name for path in tmp_path.iterdir()] == [name]


def test_a_link_is_followed_and_one_that_leads_nowhere_refused(tmp_path: Path) -> None:
    link, loop = tmp_path / 'link.mcap', tmp_path / 'loop.mcap'
    link.symlink_to(tmp_path / 'there.mcap')
    with BagWriter(link):
        pass
    assert link.is_symlink()
    assert (tmp_path / 'there.mcap').is_file()
    loop.symlink_to(loop)
    with pytest.raises(BagError, match='exists already'):
        BagWriter(loop)


def read_with_rosbags(path: Path) -> list[tuple[str, int, object]]:
    with Reader(path) as reader:
        return [
            (c.topic, time, STORE.deserialize_cdr(data, c.msgtype).data)  # type: ignore[attr-defined]
            for c, time, data in reader.messages()
        ]


EXPECTED = [
    ('/note', int(TIMES[0]) - 5, 'Prüfstand'),
    ('/clutch', int(TIMES[0]) - 3, True),
    *(
        row
        for time, speed, load in zip(TIMES.tolist(), SPEED.tolist(), LOAD.tolist(), strict=True)
        for row in (('/speed', time, speed), ('/load', time + 7, load))
    ),
]


@pytest.mark.parametrize('compression', ['zstd', 'lz4', 'none'])
@pytest.mark.parametrize('name', ['voyage', 'voyage.mcap'])
def test_rosbags_reads_what_we_write(tmp_path: Path, compression: str, name: str) -> None:
    path = tmp_path / name
    write_example(path, compression=compression, chunk_size=500)
    assert read_with_rosbags(path) == EXPECTED
    (file,) = [path] if path.is_file() else path.glob('*.mcap')
    with file.open('rb') as stream:
        assert len(list(make_reader(stream, validate_crcs=True).iter_messages())) == 102
    with Reader(path) as reader:
        assert reader.message_count == 102
        assert (reader.start_time, reader.end_time) == (TIMES[0] - 5, TIMES[-1] + 8)
        assert {c.topic: c.msgtype for c in reader.connections} == {
            '/speed': FLOAT64,
            '/load': FLOAT64,
            '/never': FLOAT64,
            '/note': 'std_msgs/msg/String',
            '/clutch': 'std_msgs/msg/Bool',
        }


def test_metadata_are_those_of_rosbag2(tmp_path: Path) -> None:
    """Version 9, as rosbag2_storage writes it; an alias is none of its YAML."""
    write_example(tmp_path / 'voyage')
    text = (tmp_path / 'voyage/metadata.yaml').read_text()
    assert '&' not in text
    information = yaml.safe_load(text)['rosbag2_bagfile_information']
    assert (information['version'], information['storage_identifier']) == (9, 'mcap')
    assert information['relative_file_paths'] == [file['path'] for file in information['files']]
    for part in (information, *information['files']):
        assert part['starting_time'] == {'nanoseconds_since_epoch': int(TIMES[0]) - 5}
        assert part['duration'] == {'nanoseconds': 49 * 1_000_000 + 12}
        assert part['message_count'] == 102
    first = information['topics_with_message_count'][0]
    assert (first['topic_metadata']['name'], first['message_count']) == ('/speed', 50)
    assert first['topic_metadata']['type_description_hash'] == STORE.hash_rihs01(FLOAT64)


@pytest.mark.parametrize(
    'name',
    [
        *TYPE_HASHES,
        *('sensor_msgs/msg/JointState', 'nav_msgs/msg/Odometry', 'sensor_msgs/msg/Imu'),
        *('std_msgs/msg/Float64MultiArray', 'sensor_msgs/msg/NavSatFix', 'sensor_msgs/msg/Range'),
    ],
)
def test_built_in_types_are_those_of_ros(name: str) -> None:
    text = definition_of(name)
    assert text is not None
    for type_name, (_, fields) in get_types_from_msg(text, name).items():
        # Built in for recordings of Humble, whose files carry none.
        assert fields == HUMBLE.fielddefs[type_name][1], type_name
    if name in TYPE_HASHES:
        assert f'RIHS01_{TYPE_HASHES[name]}' == STORE.hash_rihs01(name)
        assert text == STORE.generate_msgdef(name, ros_version=2)[0]


@pytest.mark.parametrize('name', STAMPED_FIELDS)
def test_stamped_numbers_agree_with_rosbags(name: str) -> None:
    stamps = [0, 1_700_000_000_987_654_321, 2**31 * 10**9 - 1]
    for field in STAMPED_FIELDS[name]:
        messages = encode_stamped(name, field, stamps, [1.5, -2.5, math.inf])
        for data, stamp, value in zip(messages, stamps, (1.5, -2.5, math.inf), strict=True):
            message: Any = STORE.deserialize_cdr(data, name)
            assert bytes(STORE.serialize_cdr(message, name)) == data
            assert message.header.stamp.sec * 10**9 + message.header.stamp.nanosec == stamp
            assert message.header.frame_id == ''
            vector_pair, part, axis = field.split('.')
            pair = getattr(message, vector_pair)
            assert getattr(getattr(pair, part), axis) == value
            vectors = [v for v in dataclasses.asdict(pair).values() if isinstance(v, dict)]
            assert sum(vector[a] for vector in vectors for a in 'xyz') == value


@pytest.mark.parametrize('name', ['voyage', 'voyage.mcap'])
def test_recording_that_breaks_off_is_read_to_the_cut(tmp_path: Path, name: str) -> None:
    values = np.random.default_rng(1).random(115_000)
    with BagWriter(tmp_path / name) as writer:
        writer.add_topic('/x', FLOAT64)
        writer.write_float64s({'/x': (TIMES[0] + np.arange(115_000), values)})
        assert writer.message_counts == {'/x': 115_000}
        writer.break_off()
    bag = open_bag(tmp_path / name)
    assert len(bag.cuts) == 1
    read = bag.read([Request('/x', 'data')])[Request('/x', 'data')].value
    # A message takes 43 bytes: four whole chunks of a megabyte, and some of the fifth.
    assert 4 * (1 << 20) // 43 + 1_000 < read.size < 115_000
    assert read.tolist() == values[: read.size].tolist()
    assert not (tmp_path / name / 'metadata.yaml').exists()


@pytest.mark.parametrize(
    ('use', 'text'),
    [
        (lambda writer: writer.add_topic('/x', FLOAT64), "topic '/x' was added to bag '"),
        (lambda writer: writer.write('/y', 0, b''), "topic '/y' was not added to bag '"),
        (lambda writer: writer.write('/x', -1, b''), "log time -1 ns of topic '/x' is not"),
        (lambda writer: writer.write('/x', 1 << 63, b''), "a log time of topic '/x' is not between 0 and 9"),
        (lambda writer: writer.write_float64s({'/x': ([1], [1, 2])}), 'has 1 log times for 2'),
        (lambda writer: writer.add_topic('/b', 'a/msg/B'), "type 'a/msg/B' needs a definition"),
    ],
)
def test_wrong_use_is_named(use: Callable[[BagWriter], None], text: str, tmp_path: Path) -> None:
    with BagWriter(tmp_path / 'bag') as writer:
        writer.add_topic('/x', FLOAT64)
        with pytest.raises(BagError, match=text):
            use(writer)


def test_a_definition_of_ones_own_has_no_hash(tmp_path: Path) -> None:
    with BagWriter(tmp_path / 'bag') as writer:
        writer.add_topic('/x', FLOAT64, 'float64 data\nfloat64 more\n')
    (channel,) = make_reader((tmp_path / 'bag' / 'bag_0.mcap').open('rb')).get_summary().channels.values()
    assert channel.metadata['topic_type_hash'] == ''
