# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import json
import os
import random
import threading
from collections.abc import Callable
from pathlib import Path

import pytest
from shared import DEADLINE

from stickslip_monitor import state_file
from stickslip_monitor.errors import AlarmStateError, RosError
from stickslip_monitor.state_file import MAX_SIZE, StateFile, StateWriter

OURS = {'schema': 'stickslip_monitor/alarm_state/1', 'time': 1}


def test_the_old_one_stays_whole_until_the_new_one_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = StateFile(str(tmp_path / 'state.json'))
    file.write({'time': 1})

    def full(descriptor: int) -> None:
        raise OSError(28, 'No space left on device')

    monkeypatch.setattr(os, 'fsync', full)
    with pytest.raises(OSError, match='No space left'):
        file.write({'time': 2})
    assert file.read() == {'time': 1}


@pytest.mark.parametrize('content', [b'{"time": 1', b'\xff\xfe', b'[' * 100_000])
def test_a_file_that_is_not_json_is_named_and_set_aside(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / 'state.json'
    path.write_bytes(content)
    file = StateFile(str(path))
    with pytest.raises(AlarmStateError, match='it is not JSON: '):
        file.read()
    aside = tmp_path / 'state.json.damaged'
    assert file.set_aside() == f'it is now {aside}'
    assert aside.read_bytes() == content
    assert file.read() is None


def make_pipe(folder: Path) -> str:
    os.mkfifo(folder / 'pipe')
    return str(folder / 'pipe')


@pytest.mark.parametrize(
    ('path', 'words'),
    [
        (make_pipe, 'must be a file, but is a device, pipe or socket'),
        (lambda folder: '/dev/full', 'must be a file, but is a device, pipe or socket'),
        (lambda folder: str(folder / ('n' * 250)), 'cannot be used: File name too long'),
        (lambda folder: str(folder / 'no' / 'state.json'), "no/state.json': there is no folder"),
        (str, 'must be a file, but is a folder'),
    ],
)
def test_a_state_file_that_is_not_regular_is_refused_at_once(
    tmp_path: Path, path: Callable[[Path], str], words: str
) -> None:
    with pytest.raises(RosError, match=words):
        StateFile(path(tmp_path))


def test_a_file_that_is_too_large_is_not_read(tmp_path: Path) -> None:
    path = tmp_path / 'state.json'
    with path.open('wb') as file:
        file.truncate(MAX_SIZE + 1)
    with pytest.raises(AlarmStateError, match='it is larger than 16000000 bytes'):
        StateFile(str(path)).read()


def test_a_second_node_is_kept_out_until_the_first_has_gone(tmp_path: Path) -> None:
    path = str(tmp_path / 'state.json')
    first = StateWriter(path)
    with pytest.raises(RosError, match='is in use by another node'):
        StateWriter(path)
    first.write(OURS)
    first.close()
    second = StateWriter(path)
    assert second.read() == OURS
    second.close()


@pytest.mark.parametrize(
    'content',
    [
        b'{"notes": "of somebody"}',
        b'bearings: [aft]\nstate_file: /var/lib/stickslip_monitor/alarms.json\n',
        b'[]',
        b'{"schema": "stickslip_monitor/calibration/2"}',
        'éè'.encode() * 150,  # of which the head ends amid a character
        b'\x89PNG\r\n\x1a\n' + bytes(100),
        b'\x89MCAP0\r\n' + bytes(100),
    ],
)
def test_the_file_of_somebody_else_is_left_alone(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / 'notes.json'
    path.write_bytes(content)
    with pytest.raises(RosError, match='is not a file of stickslip_monitor: left alone'):
        StateWriter(str(path))
    assert [path_in_folder.name for path_in_folder in tmp_path.iterdir()] == ['notes.json']
    assert path.read_bytes() == content


WHOLE = json.dumps(OURS, indent=1).encode()
NOISE = random.Random(1).randbytes(4096)


@pytest.mark.parametrize(
    'content',
    [
        b'',
        bytes(4096),
        b'\xff' * 4096,
        b'U' * 4096,
        NOISE,
        *(WHOLE[:length] for length in (1, 5, 20, 60)),
        bytes(40) + WHOLE[40:],
        WHOLE.replace(b'"schema"', b'"schemb"'),
        WHOLE.replace(b'state/1', b'state/2'),
        bytes(MAX_SIZE + 1),
    ],
)
def test_an_empty_or_damaged_one_keeps_nobody_from_monitoring(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / 'state.json'
    path.write_bytes(content)
    StateWriter(str(path)).close()
    assert path.read_bytes() == content


def test_an_empty_one_has_lost_its_alarms(tmp_path: Path) -> None:
    # A power cut leaves it so: it is damaged, and not a first start.
    path = tmp_path / 'state.json'
    assert StateFile(str(path)).read() is None
    path.touch()
    with pytest.raises(AlarmStateError, match=r'^it is empty$'):
        StateFile(str(path)).read()


def test_one_that_cannot_be_set_aside_is_named(tmp_path: Path) -> None:
    path = tmp_path / 'state.json'
    path.write_bytes(bytes(9))
    (tmp_path / 'state.json.damaged').mkdir()
    assert StateFile(str(path)).set_aside() == 'it cannot be set aside: Is a directory'


def test_a_full_disk_is_reported_and_tried_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(state_file, 'RETRY_PERIOD', 0.01)
    full, tried = threading.Event(), threading.Semaphore(0)
    full.set()
    write = StateFile.write

    def attempt(file: StateFile, document: object) -> None:
        tried.release()
        if full.is_set():
            raise OSError(28, 'No space left on device')
        write(file, document)

    monkeypatch.setattr(StateFile, 'write', attempt)
    writer = StateWriter(str(tmp_path / 'state.json'))
    writer.write({'time': 1})
    # The third attempt has begun, so the first has been told.
    assert all(tried.acquire(timeout=DEADLINE) for _ in range(3))
    assert writer.fault == 'the alarms are not kept: No space left on device'
    writer.write({'time': 2})
    assert all(tried.acquire(timeout=DEADLINE) for _ in range(2))
    full.clear()
    writer.close(patience=10.0)
    assert writer.fault == ''
    # The newer one has taken the place of what could not be written.
    assert writer.read() == {'time': 2}
