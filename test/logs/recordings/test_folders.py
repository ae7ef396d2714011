# SPDX-License-Identifier: Apache-2.0
"""Which files of an archive are checked, named as left out, or excluded, by their content."""

from __future__ import annotations

import bz2
import gzip
import json
import lzma
import tarfile
from collections.abc import Callable
from datetime import datetime, timedelta, timezone
from pathlib import Path

import pytest
import zstandard
from made_logs import write_recording
from nasty_logs import nmea_sentence

from stickslip_logs.recordings.folders import describe_unchecked, find_bags
from stickslip_logs.recordings.reader import open_bag
from stickslip_logs.recordings.recording import Request
from stickslip_logs.recordings.table_recording import TableRecording

T0 = datetime(2026, 5, 4, 6, 0, tzinfo=timezone.utc)
TIMES = [f'{T0 + timedelta(seconds=k):%Y-%m-%dT%H:%M:%SZ}' for k in range(40)]
CSV = 'time,rpm,load\n' + ''.join(f'{time},30.5,900.25\n' for time in TIMES)
NMEA = ''.join(f'{time} {nmea_sentence("IIRPM,S,1,136.0,30.0,A")}\r\n' for time in TIMES)
SIGNAL_K = ''.join(
    f'{{"updates": [{{"timestamp": "{time}", "values": [{{"path": "shaft.revolutions", "value": 0.5}}]}}]}}\n'
    for time in TIMES
)
COMPRESS: dict[str, Callable[[bytes], bytes]] = {
    'gz': gzip.compress,
    'bz2': bz2.compress,
    'xz': lzma.compress,
    'zst': zstandard.ZstdCompressor().compress,
}
LOGS = {
    'voyage.log': CSV.encode(),
    'voyage.txt': CSV.replace(',', '\t').encode(),
    'voyage.dat': CSV.encode('utf-16'),
    'voyage': CSV.replace(',', ';').encode(),
    'voyage.log.1': CSV.encode(),
    'voyage.nmea': NMEA.encode(),
    'voyage.jsonl': SIGNAL_K.encode(),
    **{f'voyage.log.2.{name}': pack(CSV.encode()) for name, pack in COMPRESS.items()},
    **{f'voyage.{name}': pack(NMEA.encode()) for name, pack in COMPRESS.items()},
}
NO_DATA = {
    'README.md': b'# The voyage\n\nThe log of 2026, of 3 days, was kept by the second engineer.\n',
    'ship.yaml': b'bearings: [aft]\naft:\n  mass: 50.0\n  damping: 400.0\n',
    'recorder.log': ''.join(f'{time} INFO recorder: wrote a block, all is well\n' for time in TIMES).encode(),
    'python.log': ''.join(f'2026-05-04 06:00:{k:02},123 INFO block {k} done\n' for k in range(40)).encode(),
    'page.html': b'<!doctype html><svg><path d="M 1 2 L 3 4"/></svg>\n',
    'plan.pdf': b'%PDF-1.7\n1 0 obj\n2 0 obj\n',
    'photo.jpg': b'\xff\xd8\xff\xe0' + bytes(range(256)),
    'empty.log': b'',
    '.hidden.log': CSV.encode(),
}
DATA = {
    'ros1.bag': b'#ROSBAG V2.0\n' + bytes(40),
    'scope.mf4': b'MDF     4.10    ' + bytes(40),
    'noon.xlsx': b'PK\x03\x04' + bytes(40),
    'unknown.dat': bytes(range(256)) * 20,
    'historian.db': b'SQLite format 3\0' + bytes(4000),
    'own.jsonl': ''.join(json.dumps({'ts': time, 'rpm': 30.5}) + '\n' for time in TIMES).encode(),
    'can.log': ''.join(f'({k}.000000) can0 09F20011#00A005FFFF7FFFFF\n' for k in range(40)).encode(),
    'dots.txt': ''.join(f'4.5.2026 06.00.{k:02};136,0\n' for k in range(40)).encode(),
    'own.log': ''.join(f'time={time},rpm=136.0\n' for time in TIMES).encode(),
    'no_times.nmea': (f'{nmea_sentence("IIRPM,S,1,136.0,30.0,A")}\r\n' * 40).encode(),
}


@pytest.mark.parametrize('name', LOGS)
def test_a_log_is_known_by_its_content(name: str, tmp_path: Path) -> None:
    (tmp_path / 'deep').mkdir()
    path = tmp_path / 'deep' / name
    path.write_bytes(LOGS[name])
    assert find_bags([tmp_path]) == [path]
    assert describe_unchecked([tmp_path], [path]) == ''
    recording = open_bag(path)
    assert isinstance(recording, TableRecording)
    speed = next(topic for topic in recording.topics if 'rpm' in topic.lower() or 'rev' in topic)
    (series,) = recording.read([Request(speed, 'data')]).values()
    assert series.value.size == len(TIMES)
    assert recording.losses == ()


@pytest.mark.parametrize('name', NO_DATA)
def test_files_without_numbers_are_excluded(name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(NO_DATA[name])
    assert find_bags([tmp_path]) == [tmp_path]
    assert describe_unchecked([tmp_path], []) == ''


@pytest.mark.parametrize('name', DATA)
def test_data_that_are_not_read_are_named(name: str, tmp_path: Path) -> None:
    (tmp_path / 'quiet.csv').write_text(CSV)
    (tmp_path / name).write_bytes(DATA[name])
    recordings = find_bags([tmp_path])
    assert recordings == [tmp_path / 'quiet.csv']
    text = f"1 file not checked (name one to check it, or to see why not): '{tmp_path / name}'"
    assert describe_unchecked([tmp_path], recordings) == text


def test_every_log_of_a_folder_is_checked_and_all_are_named_beside_a_recording(tmp_path: Path) -> None:
    for name, data in (LOGS | NO_DATA).items():
        (tmp_path / name).write_bytes(data)
    assert {path.name for path in find_bags([tmp_path])} == {*LOGS}
    write_recording(tmp_path / 'bag', {'/a': ([0, 10**9], [1.0, 2.0])})
    recordings = find_bags([tmp_path])
    assert recordings == [tmp_path / 'bag']
    assert describe_unchecked([tmp_path], recordings).startswith(f'{len(LOGS)} files not checked')


def test_a_recording_is_known_by_its_content(tmp_path: Path) -> None:
    write_recording(tmp_path / 'bag', {'/a': ([0, 10**9], [1.0, 2.0])})
    (file,) = (tmp_path / 'bag').glob('*.mcap')
    file.rename(tmp_path / 'voyage.bin')
    (tmp_path / 'bag' / 'metadata.yaml').unlink()
    assert find_bags([tmp_path]) == [tmp_path / 'voyage.bin']
    assert open_bag(tmp_path / 'voyage.bin').message_count == 2


def test_a_tar_archive_is_no_table(tmp_path: Path) -> None:
    (tmp_path / 'a.csv').write_text(CSV)
    with tarfile.open(tmp_path / 'a.tar', 'w') as tar:
        tar.add(tmp_path / 'a.csv')
    (tmp_path / 'a.tar.gz').write_bytes(gzip.compress((tmp_path / 'a.tar').read_bytes()))
    for name in ('a.tar', 'a.tar.gz'):
        assert f"{name}'" in describe_unchecked([tmp_path], find_bags([tmp_path]))
