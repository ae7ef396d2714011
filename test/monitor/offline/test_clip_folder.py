# SPDX-License-Identifier: Apache-2.0
"""The folder of clips: what is in a file, how many there are, and whose files they are."""

from __future__ import annotations

import os
import shutil
from contextlib import suppress
from pathlib import Path

import pytest
from shared import CONFIG, ROOT

from stickslip_logs.recordings.reader import open_bag
from stickslip_logs.recordings.writer import encode_float64s
from stickslip_monitor.cli import main
from stickslip_monitor.errors import BagError
from stickslip_monitor.monitor.clip_recorder import Clip, ClipMessage
from stickslip_monitor.monitor.parameter_file import load_config
from stickslip_monitor.monitor.parameters import ClipConfig
from stickslip_monitor.monitor.severity import Condition
from stickslip_monitor.offline.check import check_recording
from stickslip_monitor.offline.clip_folder import ClipFolder

NS, T0 = 10**9, 1_777_874_400 * 10**9  # 2026-05-04 06:00:00 UTC


def make_clip(number: int = 0, count: int = 3) -> Clip:
    messages = [
        ClipMessage(T0 + i * NS, '/a', 'std_msgs/msg/Float64', encode_float64s([i])[0]) for i in range(count)
    ]
    messages.append(ClipMessage(T0, '/b', 'my_msgs/msg/Odd', b'\0\1\0\0\7\0\0\0'))
    definitions = {'my_msgs/msg/Odd': 'int32 x\n'}
    return Clip('aft', Condition.STICK_SLIP, T0 + number * NS, tuple(messages), definitions)


def make_clip_folder(path: Path, max_clips: int = 3) -> ClipFolder:
    return ClipFolder(ClipConfig(str(path), most=max_clips))


def test_a_clip_is_a_recording_named_by_time_bearing_and_alarm(tmp_path: Path) -> None:
    store = make_clip_folder(tmp_path / 'new' / 'clips')
    store.write(make_clip())
    (path,) = store.clips()
    assert path.name == '20260504T060000Z_aft_stick_slip.mcap'
    bag = open_bag(path)
    assert {name: topic.count for name, topic in bag.topics.items()} == {'/a': 3, '/b': 1}
    assert bag.definition('/b') == 'int32 x\n'
    assert bag.warnings == ()


def test_the_oldest_make_room_and_other_files_stay(tmp_path: Path) -> None:
    # Files of others that look like the oldest clips: a recording of ours, one that is linked to,
    # a damaged one, an empty one; and a clip that somebody renamed, to keep it.
    names = [f'20200101T00000{i}Z_aft_stick_slip.mcap' for i in range(5)]
    shutil.copy(next((ROOT / 'bags' / 'coast_down').glob('*.mcap')), tmp_path / names[0])
    (tmp_path / names[1]).symlink_to(tmp_path / names[0])
    (tmp_path / names[2]).write_bytes((tmp_path / names[0]).read_bytes()[:40])
    (tmp_path / names[3]).touch()
    (tmp_path / names[4]).mkdir()
    store = make_clip_folder(tmp_path, max_clips=3)
    store.write(make_clip())
    store.clips()[0].rename(tmp_path / 'kept.mcap')
    other_files = {path.name for path in tmp_path.iterdir()}
    for number in range(5):
        store.write(make_clip(number))
        newest = store.clips()[-1]
        os.utime(newest, (1000 + number, 1000 + number))
    remaining = [path.name[:16] for path in store.clips()]
    assert remaining == [f'20260504T06000{i}Z' for i in (2, 3, 4)]
    assert {path.name for path in tmp_path.iterdir()} == other_files | {p.name for p in store.clips()}


def test_the_same_instant_again_gets_a_number(tmp_path: Path) -> None:
    store = make_clip_folder(tmp_path)
    for _ in range(3):
        store.write(make_clip())
    names = {path.name for path in store.clips()}
    stem = '20260504T060000Z_aft_stick_slip'
    assert names == {f'{stem}.mcap', f'{stem}-2.mcap', f'{stem}-3.mcap'}


def test_leftovers_of_a_crash_are_removed_when_old(tmp_path: Path) -> None:
    name = '.20260504T060000Z_aft_stick_slip.mcap.0.draft'
    old, new, other_node, foreign = (
        tmp_path / n for n in (name, name.replace('.0.', '.1.'), '.x.draft', name.replace('.0.', '.2.'))
    )
    for path in (old, new, other_node):
        path.touch()
    foreign.write_text('of somebody else')
    for path in (old, other_node, foreign):
        os.utime(path, (1000, 1000))
    make_clip_folder(tmp_path)
    assert set(tmp_path.iterdir()) == {new, other_node, foreign}


def test_a_folder_that_cannot_be_listed_is_refused_by_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As on a share that went away behind its mount point; root may list anything, so the call fails here."""

    def fail(folder: Path) -> list[Path]:
        raise PermissionError(13, 'Permission denied', str(folder))

    monkeypatch.setattr(Path, 'iterdir', fail)
    with pytest.raises(BagError, match=rf"clips\.directory = '{tmp_path}' cannot be used: Permission"):
        ClipFolder(ClipConfig(str(tmp_path)))


def test_an_old_clip_that_cannot_be_deleted_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = make_clip_folder(tmp_path, max_clips=1)
    folder.write(make_clip())

    unlink = Path.unlink

    def fail(path: Path, missing_ok: bool = False) -> None:
        if path.suffix == '.mcap':
            raise PermissionError(1, 'Operation not permitted', str(path))
        unlink(path, missing_ok)

    monkeypatch.setattr(Path, 'unlink', fail)
    with pytest.raises(BagError, match='old clips cannot be deleted: Operation not permitted'):
        folder.write(make_clip(1))


# --- the clips of a recorded bag ---------------------------------------------------------------


def test_a_checked_bag_has_a_clip_around_each_alarm(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    recording, config = ROOT / 'bags' / 'coast_down', load_config(CONFIG)
    out = tmp_path / 'clips'
    assert main(['check', str(recording), '--clips', str(out), '--config', str(CONFIG)]) == 1
    assert f'2 clips written into {out}' in capsys.readouterr().err
    events = check_recording(recording, config).bearings['aft_stern'].events
    alarms = [e for e in events if e.raised and e.after.severity == 2]
    for path, alarm in zip(sorted(out.iterdir()), alarms, strict=True):
        assert path.stem.endswith(f'_aft_stern_{alarm.after.value}')
        bag = open_bag(path)
        assert 0 <= bag.start_ns - (alarm.time_ns - 60 * NS) < NS
        assert -NS < bag.end_ns - (alarm.time_ns + 60 * NS) <= 0
        inputs = {'/shaft/speed', '/bearing/aft_stern/load'}
        assert {*inputs, '/stickslip_monitor/warnings'} <= set(bag.topics)
        assert bag.topics['/shaft/speed'].count == pytest.approx(1200, abs=2)
        assert check_recording(path, config).bearings['aft_stern'].events


@pytest.mark.parametrize(('written', 'error'), [(False, True), (True, True), (False, False)])
def test_a_monitor_stopped_before_its_first_clip_leaves_no_folder(
    written: bool, error: bool, tmp_path: Path
) -> None:
    with suppress(KeyboardInterrupt), make_clip_folder(tmp_path / 'clips') as store:
        if written:
            store.write(make_clip())
        if error:
            raise KeyboardInterrupt
    assert (tmp_path / 'clips').exists() == (written or not error)
