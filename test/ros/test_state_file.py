# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import os
from pathlib import Path

import pytest

from stickslip_monitor.errors import AlarmStateError, RosError
from stickslip_monitor.ros.state_file import StateFile


def test_round_trip(tmp_path: Path) -> None:
    file = StateFile(str(tmp_path / 'state.json'))
    assert file.read() is None
    file.write({'time': 1})
    file.write({'time': 2, 'text': 'Öl'})
    assert file.read() == {'time': 2, 'text': 'Öl'}
    assert [path.name for path in tmp_path.iterdir()] == ['state.json']


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


@pytest.mark.parametrize('content', [b'', b'{"time": 1', b'\xff\xfe', b'[' * 100_000])
def test_what_is_not_json_is_named_and_set_aside(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / 'state.json'
    path.write_bytes(content)
    file = StateFile(str(path))
    with pytest.raises(AlarmStateError, match='it is not JSON: '):
        file.read()
    aside = file.set_aside()
    assert (aside.name, aside.read_bytes()) == ('state.json.damaged', content)
    assert file.read() is None


def test_a_place_that_cannot_be(tmp_path: Path) -> None:
    with pytest.raises(RosError, match=r"state_file = '.*/no/state\.json': there is no folder"):
        StateFile(str(tmp_path / 'no' / 'state.json'))
    with pytest.raises(RosError, match='must be a file, but is a folder'):
        StateFile(str(tmp_path))
