# SPDX-License-Identifier: Apache-2.0
"""Folders, topics, and what is said to a user whose bag or request is wrong."""

from __future__ import annotations

import bz2
import gc
import gzip
import io
import lzma
import random
import sqlite3
import struct
import unicodedata
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
import zstandard
from made_logs import write_recording
from mcap.writer import Writer

from fuzz.files import DEFINITIONS, Piece, file, messages
from stickslip_logs.errors import BagError
from stickslip_logs.recordings.folders import find_bags
from stickslip_logs.recordings.mcap_chunks import MAGIC
from stickslip_logs.recordings.reader import open_bag, spool_stream
from stickslip_logs.recordings.recording import Request, TopicInfo

FLOAT64 = 'std_msgs/msg/Float64'
NESTED = """\
std_msgs/Header header
Reading[2] readings
float64[] many
float64[<=3] few
string name
===
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
===
MSG: ship_msgs/Reading
float64 value
string unit
"""


def write_folder(folder: Path, files: dict[str, list[int]], **metadata: object) -> None:
    folder.mkdir()
    for name, times in files.items():
        write_recording(folder / name, {'/x': (times, times)})
    information = {
        'version': 9,
        'storage_identifier': 'mcap',
        'message_count': sum(map(len, files.values())),
        'relative_file_paths': list(files),
        **metadata,
    }
    text = yaml.safe_dump({'rosbag2_bagfile_information': information})
    (folder / 'metadata.yaml').write_text(text)


def read_values(path: Path) -> list[float]:
    request = Request('/x', 'data')
    values: list[float] = open_bag(path).read([request])[request].value.tolist()
    return values


@pytest.mark.parametrize('is_dated_first', [False, True])
def test_a_file_on_a_clock_that_was_not_set_stays_where_it_is(is_dated_first: bool, tmp_path: Path) -> None:
    """Record 20 s from 0 on, and 20 s of a day in 2026; the first time of the former is that of no clock."""
    files = [[begin + k * 10**9 for k in range(20)] for begin in (0, 1_776_074_400 * 10**9)]
    files = files[::-1] if is_dated_first else files
    write_folder(tmp_path / 'bag', {'a.mcap': files[0], 'b.mcap': files[1]})
    bag, request = open_bag(tmp_path / 'bag'), Request('/x', 'data')
    series = bag.read([request])[request]
    assert series.value.tolist() == [float(time) for times in files for time in times if time]
    assert np.diff(series.log_time_ns).tolist() == [10**9] * 38
    assert 'have log time 0 (clock not set?) or an impossible one and were not used' in series.faults[0].text
    note = 'was set back once' if is_dated_first else 'began at zero and was set to a date'
    assert note in ' '.join(bag.warnings)


def test_files_are_read_in_the_order_of_the_metadata(tmp_path: Path) -> None:
    files = {'late.mcap': [7, 8], 'early.mcap': [1, 7], 'more.mcap': [8, 9]}
    write_folder(tmp_path / 'bag', files)
    bag = open_bag(tmp_path / 'bag')
    assert [file.name for file in bag.files] == list(files)
    assert read_values(tmp_path / 'bag') == [1, 7, 7, 8, 8, 9]
    assert [m.log_time_ns for m in bag.messages()] == [1, 7, 7, 8, 8, 9]
    assert (bag.start_ns, bag.end_ns, bag.message_count, bag.warnings) == (1, 9, 6, ())
    assert bag.topics == {'/x': TopicInfo('/x', FLOAT64, 6, 'cdr', '')}


@pytest.mark.parametrize(('requested_form', 'stored_form'), [('NFC', 'NFD'), ('NFD', 'NFC')])
def test_composed_and_decomposed_names_are_one_name(
    tmp_path: Path, requested_form: Any, stored_form: Any
) -> None:
    """Write a name as macOS keeps it, and as a recorder or a person does."""
    name, requested_name = (
        unicodedata.normalize(stored_form, 'Jörmungandr'),
        unicodedata.normalize(requested_form, 'Jörmungandr'),
    )
    files = {f'{name}_0.mcap': [1, 2], f'{name}_1.mcap': [3]}
    write_folder(
        tmp_path / name, files, relative_file_paths=[f'{requested_name}_0.mcap', f'{requested_name}_1.mcap']
    )
    assert read_values(tmp_path / requested_name) == [1, 2, 3]
    assert open_bag(tmp_path / requested_name).warnings == ()
    assert find_bags([tmp_path / requested_name]) == [tmp_path / name]


def test_without_metadata_the_names_are_counted(tmp_path: Path) -> None:
    for number in (10, 9, 1):
        write_recording(tmp_path / 'bag' / f'bag_{number}.mcap', {'/x': ([number], [number])})
    bag = open_bag(str(tmp_path / 'bag'))
    assert [file.name for file in bag.files] == ['bag_1.mcap', 'bag_9.mcap', 'bag_10.mcap']
    assert bag.warnings == (
        f"folder '{tmp_path / 'bag'}' has no metadata.yaml: its files were read in the order of their names",
    )


INFORMATION = 'rosbag2_bagfile_information: '
UNUSABLE = (
    '',
    '[',
    'a: 1',
    f'{INFORMATION}3',
    '\0',
    INFORMATION + '[' * 100_000,
    f'{INFORMATION}{{message_count: .inf, relative_file_paths: []}}',
    f'a: &a [1, 2]\nb: &b [*a, *a]\n{INFORMATION}*b',
    f"{INFORMATION}{{message_count: !!int '', relative_file_paths: []}}",
    f'{INFORMATION}{{message_count: 1, relative_file_paths: [[a]]}}',
)


@pytest.mark.parametrize('text', UNUSABLE, ids=range(len(UNUSABLE)))
def test_unusable_metadata_is_a_warning(tmp_path: Path, text: str) -> None:
    write_folder(tmp_path / 'bag', {'a.mcap': [1, 2]})
    (tmp_path / 'bag/metadata.yaml').write_text(text)
    bag = open_bag(tmp_path / 'bag')
    assert bag.message_count == 2
    assert bag.warnings == (
        f"'{tmp_path / 'bag/metadata.yaml'}' is not rosbag2 metadata: its files were read in"
        ' the order of their names',
    )


def test_metadata_that_disagrees_is_a_warning(tmp_path: Path) -> None:
    write_folder(
        tmp_path / 'bag',
        {'a.mcap': [1, 2], 'extra.mcap': [3]},
        relative_file_paths=['old/a.mcap', 'gone.mcap'],
        message_count=50,
    )
    bag = open_bag(tmp_path / 'bag')
    assert bag.warnings == (
        "files that metadata.yaml lists are missing: 'gone.mcap'",
        "files that metadata.yaml does not list were not read: 'extra.mcap'",
        f"'{tmp_path / 'bag/metadata.yaml'}' counts 50 messages, the files hold 2",
    )


def test_a_file_cut_in_a_folder_does_not_hide_the_others(tmp_path: Path) -> None:
    write_folder(tmp_path / 'bag', {'a.mcap': [1, 2], 'b.mcap': [3], 'c.mcap': [4]})
    (tmp_path / 'bag/b.mcap').write_bytes(b'')
    (tmp_path / 'bag/c.mcap').write_bytes((tmp_path / 'bag/c.mcap').read_bytes()[:-9])
    bag = open_bag(tmp_path / 'bag')
    assert [cut.path.name for cut in bag.cuts] == ['b.mcap', 'c.mcap']
    assert read_values(tmp_path / 'bag') == [1, 2, 4]


def test_unpacked_files_are_removed_with_their_recording(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_recording(tmp_path / 'a.mcap', {'/x': ([1, 2], [1, 2])})
    packed, scratch = tmp_path / 'b.mcap.zstd', tmp_path / 'scratch'
    packed.write_bytes(zstandard.compress((tmp_path / 'a.mcap').read_bytes()))
    scratch.mkdir()
    monkeypatch.setattr('tempfile.tempdir', str(scratch))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter('always')
        bag = open_bag(packed)
        assert len(list(scratch.iterdir())) == bag.message_count // 2
        del bag
        gc.collect()
    assert caught == []
    assert list(scratch.iterdir()) == []
    scratch.rmdir()
    with pytest.raises(BagError, match=r"b\.mcap\.zstd' cannot be unpacked: .*No such file"):
        open_bag(packed)


def test_a_path_that_the_system_refuses_is_named(tmp_path: Path) -> None:
    # A name may have 255 bytes.
    with pytest.raises(BagError, match="a' cannot be read: File name too long"):
        open_bag(tmp_path / ('a' * 300))


def test_a_file_with_nothing_to_read_yet_is_one_without_contents(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Such a file is /proc/kmsg: it is regular by its kind, and its reader would wait.
    class Waiting(io.BytesIO):
        def read(self, _: int | None = None) -> bytes | None:  # type: ignore[override]
            return None

    (tmp_path / 'log').touch()
    monkeypatch.setattr('stickslip_logs.recordings.file_kind.open_file', lambda path: Waiting())
    assert [cut.size for cut in open_bag(tmp_path / 'log').cuts] == [0]


def write_odd_topics(path: Path) -> None:
    with path.open('wb') as stream:
        writer = Writer(stream)
        writer.start('ros2', 'test')
        float64 = writer.register_schema(FLOAT64, 'ros2msg', b'float64 data\n')
        text = writer.register_schema('std_msgs/msg/String', 'ros2msg', b'string data\n')
        nested = writer.register_schema('ship_msgs/msg/N', 'ros2msg', NESTED.encode())
        schemas = {
            '/good': ('cdr', float64),
            '/json': ('json', writer.register_schema('Speed', 'jsonschema', b'{}')),
            '/idl': ('cdr', writer.register_schema('a/msg/B', 'ros2idl', b'module a {}')),
            '/bare': ('cdr', 0),
            '/lost': ('cdr', writer.register_schema('a/msg/C', 'ros2msg', b'other_msgs/D d\n')),
            '/junk': ('cdr', writer.register_schema('a/msg/D', 'ros2msg', b'!?\n')),
            '/upper': ('cdr', writer.register_schema('a/msg/E', 'ros2msg', b'float64 Value\n')),
            '/nested': ('cdr', nested),
            '/text': ('cdr', text),
        }
        ids = {t: writer.register_channel(t, *encoding) for t, encoding in schemas.items()}
        second_channel = writer.register_channel('/twice', 'cdr', float64)
        writer.register_channel('/twice', 'cdr', text)
        for time, channel in enumerate([*ids.values(), second_channel]):
            writer.add_message(channel, time, b'\0\1\0\0' + struct.pack('<d', 2.5), time)
        writer.finish()


JSON = "message encoding 'json' is not cdr: export the topic as CSV"


def test_unreadable_topics_are_listed(tmp_path: Path) -> None:
    write_odd_topics(tmp_path / 'odd.mcap')
    bag = open_bag(tmp_path / 'odd.mcap')
    assert list(bag.topics) == sorted(bag.topics)
    assert {name: topic.problem for name, topic in bag.topics.items()} == {
        '/good': '',
        '/json': JSON,
        '/idl': "schema encoding 'ros2idl' is not ros2msg: export the topic as CSV",
        '/bare': 'no schema',
        # Definitions are read when they are asked for, and no others.
        '/lost': '',
        '/junk': '',
        '/upper': '',
        '/nested': '',
        '/text': '',
        '/twice': 'it has several types: std_msgs/msg/Float64, std_msgs/msg/String',
    }
    assert bag.topics['/json'] == TopicInfo('/json', 'Speed', 1, 'json', JSON)
    assert [m.topic for m in bag.messages(['/json', '/good'])] == ['/good', '/json']
    assert len(list(bag.messages())) == 10
    assert bag.read([Request('/good', 'data')])[Request('/good', 'data')].value.tolist() == [2.5]


# Topic, its type, field, and why it is no number.
NO_NUMBERS = (
    ('/good', FLOAT64, 'value', "std_msgs/Float64 has no field 'value': its fields are data"),
    ('/good', FLOAT64, 'data[0]', "'data' is a float64, which has no element 0"),
    ('/good', FLOAT64, 'data.x', "'data' is a float64, which has no field 'x'"),
    ('/text', 'std_msgs/msg/String', 'data', "'data' is a string, not a number"),
    (
        '/nested',
        'ship_msgs/msg/N',
        'header',
        "'header' is a std_msgs/Header, not a number: its fields are stamp, frame_id",
    ),
    (
        '/nested',
        'ship_msgs/msg/N',
        'readings[2].value',
        "'readings' is a ship_msgs/Reading[2], which has no element 2",
    ),
    ('/nested', 'ship_msgs/msg/N', 'few[3]', "'few' is a float64[<=3], which has no element 3"),
    ('/nested', 'ship_msgs/msg/N', 'many', "'many' is a float64[]: name an element, e.g. many[0]"),
)
UNREADABLE = (
    ('/json', 'Speed', JSON),
    ('/twice', FLOAT64, 'it has several types: std_msgs/msg/Float64, std_msgs/msg/String'),
    ('/lost', 'a/msg/C', 'its definition leaves oth'),
    ('/junk', 'a/msg/D', 'its definition has the li'),
    ('/upper', 'a/msg/E', "its definition cannot be parsed ('Value' is"),
)
WRONG = (
    (Request('/goods', 'data'), "the recording has no topic '/goods': it has /good, "),
    (
        Request('/good', 'data', 'std_msgs/msg/Float32'),
        "topic '/good' has type std_msgs/msg/Float64 in the bag, not std_msgs/msg/Float32",
    ),
    *(
        (Request(topic, field), f"field '{field}' of topic '{topic}' ({kind}) is not a number: {why}")
        for topic, kind, field, why in NO_NUMBERS
    ),
    *(
        (Request(topic, 'Value'), f"topic '{topic}' ({kind}) cannot be read: {why}")
        for topic, kind, why in UNREADABLE
    ),
)


@pytest.mark.parametrize(('request_', 'text'), WRONG)
def test_wrong_requests_are_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], request_: Request, text: str
) -> None:
    write_odd_topics(tmp_path / 'odd.mcap')
    with pytest.raises(BagError) as caught:
        open_bag(tmp_path / 'odd.mcap').read([request_])
    assert str(caught.value).startswith(text)
    assert '\n' not in str(caught.value)
    assert capsys.readouterr() == ('', '')


def make_sqlite(path: Path) -> None:
    with sqlite3.connect(path) as base:
        base.execute('create table messages (id integer)')


def make_sqlite_folder(path: Path) -> None:
    path.mkdir()
    make_sqlite(path / 'bag_0.db3')


def folder_with(files: dict[str, list[int]], **metadata: object) -> Callable[[Path], None]:
    return lambda path: write_folder(path, files, **metadata)


def folder_of_logs(path: Path) -> None:
    make_files(path, 'b.csv', 'notes.txt')


CONVERT = "convert it with 'ros2 bag convert' first"


@pytest.mark.parametrize(
    ('make', 'text'),
    [
        (lambda path: None, "bag '{}' does not exist"),
        (Path.mkdir, "bag '{}' has no .mcap and no .db3 file"),
        (lambda path: path.write_text('time,speed'), "log '{}' has no line with a time and a number"),
        (
            lambda path: path.write_bytes(b'\1\2\3\4'),
            "bag file '{}' is not a recording of MCAP or SQLite: it begins with bytes 01 02 03 04",
        ),
        # Of v7.3 the head is 128 bytes of the 512 before the HDF5 file: MAT-File Format, MathWorks.
        (
            lambda path: path.write_bytes(b'MATLAB 7.3 MAT-file'.ljust(124) + b'\0\2IM' + bytes(384)),
            "'{}' is a MATLAB file: write it as CSV with writetable or writematrix",
        ),
        (
            lambda path: path.write_text(
                'version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 9\n'
            ),
            "'{}' is a pointer of Git LFS: bring the file itself with 'git lfs pull'",
        ),
        (
            lambda path: path.write_bytes(b'\x89HDF\r\n\x1a\n' + bytes(88)),
            "'{}' is an HDF5 file: export it as CSV or Parquet",
        ),
        *(
            (lambda path, data=data: path.write_bytes(data), text)
            for data, text in (
                (b'--\n-- PostgreSQL database dump\n--\n', "'{0}' is a dump of a database: load it into one"),
                (
                    gzip.compress(b'PRAGMA foreign_keys=OFF;\nBEGIN;\n'),
                    "'{0}' is a dump of a database: load it into one",
                ),
                (
                    b'shaft,side=port rpm=30.1,load=900i 1780000000000000000\n' * 3,
                    "log '{0}' has lines of InfluxDB: write them as CSV: influx -database NAME -execute",
                ),
                (
                    b'\x10\x02\x93\x13\x02\x01\xf8\x09\xff\x10\x03\x10\x02',
                    "'{0}' is a log of NMEA 2000 frames of an Actisense gateway: convert it with canboat:"
                    ' actisense-serial -r {0}',
                ),
            )
        ),
        # A frame of which the first block has not come whole.
        (
            lambda path: path.write_bytes(zstandard.compress(bytes(range(256)) * 9)[:20]),
            "bag file '{}' is cut or damaged: nothing can be unpacked, copy it anew",
        ),
        (folder_of_logs, "bag '{0}' has no .mcap and no .db3 file: name one of its logs, as '{0}/b.csv'"),
        (make_sqlite, "'{}' is a database and no recording of ROS 2"),
        (make_sqlite_folder, "'{}/bag_0.db3' is a database and no recording of ROS 2"),
        (
            folder_with({'a.mcap': [1]}, storage_identifier='other'),
            f"bag '{{}}' is stored as 'other' with compression_mode 'none', which is not read: {CONVERT}",
        ),
        (
            folder_with({'a.mcap': [1]}, compression_mode='MESSAGE', compression_format='zstd'),
            f"bag '{{}}' is stored as 'mcap' with compression_mode 'message', which is not read: {CONVERT}",
        ),
        (
            folder_with({'a.mcap': [1]}, relative_file_paths=['b.mcap']),
            "bag '{}' has none of the files its metadata.yaml lists",
        ),
    ],
)
def test_files_that_are_no_recording_are_named(
    tmp_path: Path, make: Callable[[Path], None], text: str
) -> None:
    make(tmp_path / 'bag')
    with pytest.raises(BagError) as caught:
        open_bag(tmp_path / 'bag')
    assert str(caught.value).startswith(text.format(tmp_path / 'bag'))
    assert '\n' not in str(caught.value)


@pytest.mark.parametrize('begin', [b'SQLite format 3\0', zstandard.compress(MAGIC), MAGIC])
def test_all_of_a_recording_is_read_from_a_pipe(begin: bytes) -> None:
    data = begin + bytes(3 << 20)
    with spool_stream(io.BytesIO(data), lambda *_: None) as path:
        assert path.read_bytes() == data


def make_files(folder: Path, *names: str) -> None:
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(b'x')


@pytest.fixture
def ship(tmp_path: Path) -> Path:
    make_files(
        tmp_path,
        'ship/voyage_10/voyage_10_0.mcap',
        'ship/voyage_2/metadata.yaml',
        'ship/voyage_2/voyage_2_0.mcap',
        'ship/2025/may/may_0.mcap',
        'ship/2025/may/deeper/hidden_by_nothing.mcap',
        'ship/clip.mcap',
        'ship/clip_2.mcap',
        'ship/.draft/draft_0.mcap',
        'ship/2025/.half.mcap',
        'ship/README.md',
        'ship/db3/metadata.yaml',
    )
    return tmp_path / 'ship'


def test_a_folder_stands_for_the_recordings_in_it_by_number_not_by_letter(ship: Path) -> None:
    names = [str(bag.relative_to(ship)) for bag in find_bags([ship])]
    assert names == [
        '2025/may',
        '2025/may/deeper/hidden_by_nothing.mcap',
        'clip.mcap',
        'clip_2.mcap',
        'db3',
        'voyage_2',
        'voyage_10',
    ]


def test_recordings_come_in_the_order_in_which_they_are_named_and_once(ship: Path) -> None:
    file = ship / 'voyage_10' / 'voyage_10_0.mcap'
    paths = [ship / 'voyage_10', file, ship / '2025' / '..' / 'voyage_10', ship / 'db3']
    assert find_bags(paths) == [ship / 'voyage_10', file, ship / 'db3']


def test_a_recording_through_a_link_is_the_same_recording(ship: Path) -> None:
    (ship / 'link').symlink_to(ship / 'voyage_2')
    recordings = find_bags([ship / 'voyage_2', ship / 'link'])
    assert recordings == [ship / 'voyage_2']


def test_numbered_files_are_one_recording_only_if_they_bear_one_name(tmp_path: Path) -> None:
    make_files(tmp_path, 'one/a_0.mcap', 'one/a_1.mcap', 'two/a_0.mcap', 'two/b_0.mcap')
    names = [str(bag.relative_to(tmp_path)) for bag in find_bags([tmp_path])]
    assert names == ['one', 'two/a_0.mcap', 'two/b_0.mcap']
    with pytest.raises(BagError, match=r"two' holds 2 recordings: name one of them"):
        open_bag(tmp_path / 'two')


def test_a_link_that_leads_nowhere_is_named_and_the_rest_read(tmp_path: Path) -> None:
    write_recording(tmp_path / 'voyage', {'/a': ([0, 10**9], [1.0, 2.0])})
    (file,) = (tmp_path / 'voyage').glob('*.mcap')
    file.rename(tmp_path / 'b.mcap')
    (tmp_path / 'voyage' / 'metadata.yaml').unlink()
    (tmp_path / 'voyage').rmdir()
    (tmp_path / 'a.mcap').symlink_to('gone.mcap')
    recording = open_bag(tmp_path)
    assert recording.message_count == 2
    assert recording.losses == (
        "file 'a.mcap' was not read: it is a link that leads nowhere, to 'gone.mcap'",
    )
    assert find_bags([tmp_path]) == [tmp_path / 'a.mcap', tmp_path / 'b.mcap']


def test_paths_without_recordings_stay_as_they_are(tmp_path: Path) -> None:
    (tmp_path / 'empty').mkdir()
    paths = [tmp_path / 'nowhere', tmp_path / 'empty']
    assert find_bags(paths) == paths


@pytest.mark.parametrize('pack', [gzip.compress, zstandard.compress, lzma.compress])
def test_a_truncated_packed_log_is_read_as_far_as_it_goes(
    pack: Callable[[bytes], bytes], tmp_path: Path
) -> None:
    path, rng = tmp_path / 'log', random.Random(1)
    lines = [f'{k},{rng.random():.9f}\n' for k in range(20_000)]
    packed = pack(('time,speed\n' + ''.join(lines)).encode())
    for data, copies in ((packed, 1), (packed[: len(packed) * 2 // 3], 0), (packed * 2, 2)):
        path.write_bytes(data)
        recording = open_bag(path)
        (series,) = recording.read([Request('speed', 'data')]).values()
        values, is_whole = series.value[:: copies or 1], copies > 0
        assert (values.size == len(lines)) == is_whole
        assert values.size > len(lines) // 4
        assert values.tolist() == [float(line.split(',')[1]) for line in lines[: values.size]]
        assert any('the file is cut or damaged' in text for text in recording.losses) != is_whole


@pytest.mark.parametrize('pack', [gzip.compress, zstandard.compress, bz2.compress, lzma.compress])
def test_a_truncated_packed_recording_is_read_as_far_as_it_goes(
    pack: Callable[[bytes], bytes], tmp_path: Path
) -> None:
    path = tmp_path / 'a.mcap.packed'
    packed = pack(file([Piece([*DEFINITIONS, *messages(0, 9000)], is_bare=True)]))
    path.write_bytes(packed)
    assert find_bags([tmp_path]) == [path]
    assert open_bag(path).message_count == 9000
    assert not open_bag(path).losses
    path.write_bytes(packed[:-4])  # of the last block, or the checksum
    assert 0 < open_bag(path).message_count <= 9000
    assert 'is cut or damaged: what could be unpacked of it was read' in ' '.join(open_bag(path).losses)


def test_zeros_behind_a_packed_recording_are_a_loss(tmp_path: Path) -> None:
    path = tmp_path / 'a.mcap.zstd'
    packed = zstandard.compress(file([Piece([*DEFINITIONS, *messages(0, 9000)], is_bare=True)]))
    # What a crash leaves: the file system had given it room.
    path.write_bytes(packed + bytes(4096))
    assert open_bag(path).message_count == 9000
    assert 'is cut or damaged: what could be unpacked of it was read' in ' '.join(open_bag(path).losses)
