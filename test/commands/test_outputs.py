# SPDX-License-Identifier: Apache-2.0
"""No command destroys what it reads, or what somebody else wrote."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pytest

from stickslip_monitor.bags.writer import BagWriter
from stickslip_monitor.cli import main
from stickslip_monitor.errors import OutputError
from stickslip_monitor.files import write_whole

ROOT = Path(__file__).parents[2]
CONFIG = ROOT / 'launch_configs' / 'reference_bearing.yaml'

# Each command that writes: its arguments with its inputs, and its outputs with their endings.
INPUTS: Mapping[str, tuple[str, ...]] = {
    'check': ('{bag}', '--config', '{config}'),
    'diagram': ('--config', '{config}', '--load', '1kN', '--points', '10'),
    'map': ('--config', '{config}', '--track', '{bag}'),
    'score': ('{bag}', '--config', '{config}'),
    'fit': ('{curve}', '--config', '{config}', '--load', '1kN', '--draws', '100'),
    'accuracy': ('--from', '{rows}'),
}
OUTPUTS: Mapping[str, Mapping[str, tuple[str, ...]]] = {
    'check': {'--report': ('.html', '.png', '.json')},
    'diagram': {'-o': ('.png', '.svg', '.csv')},
    'map': {'-o': ('.png', '.svg')},
    'score': {'--picture': ('.png', '.svg')},
    'fit': {'-o': ('.png', '.svg', '.csv'), '--fragment': ('.yaml', '')},
    'accuracy': {'-o': ('.png', '.svg'), '--csv': ('.csv', '')},
}
NAMES = ('bag', 'config', 'curve', 'rows')
PAIRS = [
    (command, option, suffix, name)
    for command, options in OUTPUTS.items()
    for option, suffixes in options.items()
    for suffix in suffixes
    for name in NAMES
    if f'{{{name}}}' in INPUTS[command]
]
WAYS: Mapping[str, Callable[[Path, Path], object]] = {
    'hard link': lambda new, old: os.link(old, new),
    'symbolic link': lambda new, old: new.symlink_to(old),
}


@pytest.fixture(scope='module')
def made(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp('inputs')
    found = {name: folder / name for name in NAMES}
    time = np.arange(100, dtype=np.int64) * 10**8 + 10**18
    with BagWriter(folder / 'bag.mcap') as bag:
        for topic, value in (('/shaft/speed', 30.0), ('/bearing/aft_stern/load', 1000.0)):
            bag.add_topic(topic, 'std_msgs/msg/Float64')
            bag.write_float64(topic, time, np.full(100, value))
    found['bag'] = folder / 'bag.mcap'
    shutil.copy(CONFIG, found['config'])
    shutil.copy(ROOT / 'launch_configs' / 'examples' / 'friction_curve.csv', found['curve'])
    shutil.copy(ROOT / 'docs' / 'accuracy.csv', found['rows'])
    return found


def run(command: str, inputs: Mapping[str, Path], *more: object) -> int:
    filled = [part.format_map(inputs) for part in INPUTS[command]]
    return main([command, *filled, *map(str, more)])


@pytest.mark.parametrize('way', WAYS)
@pytest.mark.parametrize(('command', 'option', 'suffix', 'name'), PAIRS)
def test_an_output_that_is_an_input_is_refused(
    command: str, option: str, suffix: str, name: str, way: str,
    made: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    own = {key: tmp_path / key for key in made}
    for key, path in made.items():
        shutil.copy(path, own[key])
    output = tmp_path / f'output{suffix}'
    WAYS[way](output, own[name])
    before = own[name].read_bytes()
    assert run(command, own, option, output, '--force') == 2
    assert f"output '{output}' is the input '{own[name]}'" in capsys.readouterr().err
    assert own[name].read_bytes() == before
    assert output.is_symlink() == (way == 'symbolic link')


# The bag of the fixture holds no truth, so that score stops behind the check of its outputs.
@pytest.mark.slow
@pytest.mark.parametrize(
    ('command', 'option', 'suffix'),
    [(c, o, s) for c, options in OUTPUTS.items() for o, all_ in options.items() for s in all_],
)
def test_a_foreign_file_is_replaced_only_by_force_and_an_own_one_always(
    command: str, option: str, suffix: str,
    made: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    output = tmp_path / f'output{suffix}'
    output.write_text('somebody else wrote this, about stickslip_monitor\n')
    assert run(command, made, option, output) == 2
    assert f"output '{output}' exists and was not written by this command" in (
        capsys.readouterr().err
    )
    assert output.read_text().startswith('somebody else')
    if command == 'score':
        return
    for force in (['--force'], []):
        assert run(command, made, option, output, *force) < 2
    assert not output.read_bytes().startswith(b'somebody else')
    assert [path.name for path in tmp_path.iterdir()] == [output.name]


@pytest.mark.parametrize(
    ('command', 'arguments'),
    [
        ('fit', ('-o', '{0}/a.csv', '--fragment', '{0}/a.csv')),
        ('accuracy', ('-o', '{0}/a.png', '--csv', '{0}/../{1}/a.png')),
    ],
)
def test_two_outputs_are_two_files(
    command: str, arguments: tuple[str, ...], made: dict[str, Path], tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    filled = [part.format(tmp_path, tmp_path.name) for part in arguments]
    assert run(command, made, *filled) == 2
    assert 'are one file' in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize('option', ['--clips', '--mcap'])
def test_no_recording_is_written_into_the_folder_that_is_checked(
    option: str, made: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copy(made['bag'], tmp_path / 'bag_0.mcap')
    target = tmp_path if option == '--clips' else tmp_path / 'new.mcap'
    assert run('check', made | {'bag': tmp_path}, option, target) == 2
    assert 'whose recordings are checked' in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ['bag_0.mcap']


def test_a_full_disk_leaves_what_was_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / 'a.txt'
    write_whole(path, b'ours: old', b'ours')
    monkeypatch.setattr(Path, 'replace', _full)
    with pytest.raises(OSError, match='No space'):
        write_whole(path, b'ours: new', b'ours')
    assert path.read_bytes() == b'ours: old'
    assert [p.name for p in tmp_path.iterdir()] == ['a.txt']


def _full(path: Path, target: Path) -> None:
    raise OSError(28, 'No space left on device')


def test_a_pipe_is_not_replaced(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / 'pipe')
    with pytest.raises(OutputError, match='is a pipe'):
        write_whole(tmp_path / 'pipe', b'', b'', force=True)
