# SPDX-License-Identifier: Apache-2.0
"""Files other than recordings, written by somebody hostile: one sentence, and nothing more."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest
from shared import CONFIG, ROOT

from stickslip_lab.friction.curve_file import read_curve
from stickslip_lab.scenes.scene import load_scene
from stickslip_logs.recordings.folders import find_bags, read_metadata
from stickslip_logs.recordings.reader import open_bag
from stickslip_monitor import cli
from stickslip_monitor.errors import BagError, ConfigurationError, StickslipError
from stickslip_monitor.monitor.parameter_file import load_config

BAG = ROOT / 'bags' / 'coast_down'

VALUES = (
    '!!bool foo',
    "!!int ''",
    "!!float ''",
    '!!timestamp x',
    '1e300',
    '.inf',
    '-.nan',
    '9' * 5000,
    '!!python/object:os.system x',
    '[' * 2000,
    '&a [*a]',
    '{? {} : 1}',
    '"\\e[31m\\n"',
    '\x00',
    '!!binary x',
    '!!set {1',
    '2026-99-99',
    '0b',
    '0x',
    '1:99999999999999999999:0',
)


@pytest.mark.parametrize('value', VALUES, ids=lambda text: text[:20])
@pytest.mark.parametrize('reader', [load_config, load_scene], ids=['config', 'scene'])
def test_a_hostile_value_gives_one_sentence(
    reader: Callable[[Path], object], value: str, tmp_path: Path
) -> None:
    path = tmp_path / 'a.yaml'
    text = CONFIG.read_text()
    assert '    bearings:' in text
    path.write_text(f'{text}\n    alarm: {{on_delay: {value}}}\n')
    if reader is load_scene:
        path.write_text(f'scene: stickslip_monitor/scene/1\nduration: {value}\n')
    with pytest.raises(StickslipError):
        reader(path)


def test_metadata_of_megabytes_are_not_read(tmp_path: Path) -> None:
    (tmp_path / 'metadata.yaml').write_text('# ' + 'x' * (9 << 20))
    assert 'cannot be read: it is larger' in str(read_metadata(tmp_path))


def test_a_file_that_is_listed_often_is_read_once(tmp_path: Path) -> None:
    (source,) = BAG.glob('*.mcap')
    (tmp_path / 'a.mcap').write_bytes(source.read_bytes())
    names = ', '.join(['a.mcap'] * 20_000 + [f'b{k}.mcap' for k in range(20_000)])
    (tmp_path / 'metadata.yaml').write_text(
        f'rosbag2_bagfile_information: {{message_count: 1, relative_file_paths: [{names}]}}'
    )
    bag = open_bag(tmp_path)
    assert bag.message_count == open_bag(BAG).message_count
    assert any(text.endswith(' and 19990 more') for text in bag.warnings)
    assert len(bag.warnings) < 20


def test_odd_names_and_links_of_an_archive(tmp_path: Path) -> None:
    (source,) = BAG.glob('*.mcap')
    for name in ('²', '١', 'plain', os.fsdecode(b'\xff\xfe')):
        (tmp_path / name).mkdir()
        (tmp_path / name / 'a.mcap').write_bytes(source.read_bytes())
    (tmp_path / 'loop').symlink_to(tmp_path / 'loop')
    assert len(find_bags([tmp_path])) == 4
    with pytest.raises(BagError):
        open_bag(find_bags([tmp_path / 'loop'])[0])


def test_a_folder_that_cannot_be_read_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / 'locked').mkdir()
    scan = os.scandir

    def refuse(path: str) -> object:
        if os.fspath(path).endswith('locked'):
            raise PermissionError(13, 'Permission denied', os.fspath(path))
        return scan(path)

    monkeypatch.setattr(os, 'scandir', refuse)
    assert find_bags([tmp_path]) == [tmp_path / 'locked']


@pytest.mark.parametrize('reader', [load_config, load_scene, read_curve, open_bag], ids=lambda f: f.__name__)
def test_a_pipe_is_refused_not_waited_for(reader: Callable[[Path], object], tmp_path: Path) -> None:
    os.mkfifo(tmp_path / 'pipe')
    with pytest.raises(StickslipError, match='it is a pipe, not a file'):
        reader(tmp_path / 'pipe')


def test_a_text_of_megabytes_is_not_printed_back(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / 'a.yaml'
    path.write_text(f'/**:\n  ros__parameters:\n    bearings: ["{"x" * 900_000}"]\n')
    assert cli.main(['check', str(BAG), '--config', str(path)]) == 2
    assert len(capsys.readouterr().err) < 5000
    path.write_text('x' * (2 << 20))
    with pytest.raises(ConfigurationError, match='it is larger than 1048576 bytes, the limit'):
        load_config(path)


def test_a_curve_of_too_many_points(tmp_path: Path) -> None:
    (tmp_path / 'a.csv').write_text('speed,mu\n' + '1,0.1\n' * 20_000)
    with pytest.raises(StickslipError, match='has 20001 lines, and more than 20000'):
        read_curve(tmp_path / 'a.csv')


def test_a_fault_of_the_program_has_a_sentence_and_a_code(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def broken(*_: object) -> object:
        raise ZeroDivisionError('\x1b[31mred')

    monkeypatch.setattr(cli, '_run_command', broken)
    assert cli.main(['check']) == 3
    error = capsys.readouterr().err
    assert error.startswith('ERROR: this is a fault of the program, not of what it was given: Zero')
    assert '\x1b' not in error
    assert error.count('\n') == 1
    assert cli.main(['check', '--traceback']) == 3
    assert 'in broken' in capsys.readouterr().err
