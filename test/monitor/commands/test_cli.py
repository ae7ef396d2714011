# SPDX-License-Identifier: Apache-2.0
"""What a person meets at the command line: slips of the hand, narrow screens, the Tab key."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest
from command_cases import OF_MONITOR, show_help, show_on_40_columns
from made_logs import write_recording
from shared import ROOT, Stickslip

from stickslip_monitor.cli import main
from stickslip_monitor.commands.options import parse_load
from stickslip_monitor.errors import ConfigurationError

CONFIG = str(ROOT / 'launch_configs' / 'reference_bearing.yaml')
BAG = str(ROOT / 'bags' / 'coast_down')
POINT = ('assess', '--config', CONFIG, '--speed', '20rpm', '--load', '1kN')
SCRIPTS = sysconfig.get_path('scripts')


def test_help_is_a_command_too(capsys: pytest.CaptureFixture[str]) -> None:
    messages = []
    for line in (['assess', '--help'], ['help', 'assess'], ['--help'], ['help']):
        with pytest.raises(SystemExit) as stop:
            main(line)
        assert stop.value.code == 0
        messages.append(capsys.readouterr().out)
    assert messages[0] == messages[1]
    assert messages[2] == messages[3]
    assert 'one operating point' in messages[0]


@pytest.mark.parametrize(
    ('speed', 'outcome', 'code'), [('-0.5rpm', 'at_rest', 0), ('-0.6rpm', 'stick_slip', 1)]
)
def test_assess_counts_as_rest_what_the_monitor_does(
    speed: str, outcome: str, code: int, stickslip: Stickslip
) -> None:
    """Rest is below 0.003 m/s, which is 0.57 rpm on a journal of 0.1 m."""
    done = stickslip(*POINT[:3], '--speed', speed, '--load', '1kN', '--json')
    assert (done.json['outcome'], done.code) == (outcome, code)


def test_assess_asks_about_a_slip(tmp_path: Path, stickslip: Stickslip) -> None:
    path = tmp_path / 'ship.yaml'
    path.write_text(Path(CONFIG).read_text(encoding='utf-8').replace('0.9e-3', '0.9'), encoding='utf-8')
    point = ('assess', '-c', path, '--speed', '50rpm', '--load', '1kN')
    assert 'question: aft_stern: load may move the lining by 0.9 m' in stickslip(*point).out
    (question,) = stickslip(*point, '--json').json['questions']
    assert question.endswith('in metres?')


@pytest.mark.parametrize('command', OF_MONITOR)
def test_every_command_shows_its_help(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    show_help(command, capsys)


def test_a_recording_is_shown_without_a_configuration(stickslip: Stickslip) -> None:
    record = stickslip('info', BAG, '--json').json
    assert record['topics']['/shaft/speed'] == {
        'type': 'std_msgs/msg/Float64',
        'messages': 2801,
        'problem': None,
    }
    # The scene lasts 280 s and is sampled at 10 Hz.
    assert record['duration'] == pytest.approx(280.0, abs=0.1)
    printed = ' '.join(stickslip('info', BAG).out.split())
    assert 'from 2026-05-04 06:00:00 to 2026-05-04 06:04:40 UTC' in printed
    assert '/bearing/aft_stern/load' in printed


@pytest.mark.parametrize('time_ns', [0, 1_776_074_400 * 10**9])
@pytest.mark.parametrize(('count', 'code'), [(1, 0), (2, 1)])
def test_a_recording_in_which_no_time_passes_is_looked_at(
    time_ns: int, count: int, code: int, tmp_path: Path, stickslip: Stickslip
) -> None:
    columns = {topic: ([time_ns] * count, [1.0] * count) for topic in ('/speed', '/load')}
    path = write_recording(tmp_path / 'log.mcap', columns)
    done = stickslip('info', path)
    assert done.code == stickslip('info', path, '--json').code == code
    assert (f'all times are the same, {time_ns} ns' in done.out) == bool(code)


def test_a_clock_that_was_set_meanwhile_is_looked_at(tmp_path: Path, stickslip: Stickslip) -> None:
    for part, zero_s in enumerate((0, 1_776_074_400)):
        times_ns = [(zero_s + k) * 10**9 for k in range(3)]
        write_recording(tmp_path / f'voyage/log_{part}.mcap', {'/speed': (times_ns, [1.0, 2.0, 3.0])})
    files = ['log_0.mcap', 'log_1.mcap']
    information = {'version': 5, 'storage_identifier': 'mcap', 'relative_file_paths': files}
    metadata = {'rosbag2_bagfile_information': information | {'message_count': 6}}
    (tmp_path / 'voyage/metadata.yaml').write_text(json.dumps(metadata))
    done = stickslip('info', tmp_path / 'voyage')
    assert (done.code, 'was the clock of the recorder set meanwhile?' in done.out) == (1, True)


@pytest.mark.parametrize(
    ('text', 'newtons'),
    [('2MN', 2e6), ('3tf', 29419.95), ('-0.5 t', -4903.325), ('100 LBF', 444.82216152605), ('1e3n', 1e3)],
)
def test_a_load_is_read_in_its_unit(text: str, newtons: float) -> None:
    assert parse_load(text) == pytest.approx(newtons, rel=1e-15)


def test_milli_is_not_taken_for_mega() -> None:
    with pytest.raises(ConfigurationError, match="load = '3mN' must be a number with a unit: one of N, kN"):
        parse_load('3mN')


def test_units_are_understood_in_any_case(stickslip: Stickslip) -> None:
    points = (('-20rpm', '1kN'), ('-20 RPM', '1 kn'), ('-20Rpm', '1e3 n'))
    results = {stickslip(*POINT[:3], '--speed', speed, '--load', load) for speed, load in points}
    assert [done.code for done in results] == [1]


@pytest.mark.parametrize(
    'arguments', [POINT, ('check', BAG, '--config', CONFIG), ('--help',)], ids=lambda arguments: arguments[0]
)
def test_on_a_screen_of_40_columns_nothing_is_cut_off(
    arguments: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    show_on_40_columns(arguments, tmp_path, monkeypatch)


@pytest.mark.parametrize(
    ('typed', 'offered'),
    [
        ('stickslip che', 'check '),
        ('stickslip check bags/coast_d', 'bags/coast_down/'),
        ('stickslip check --conf', '--config '),
        ('stickslip check --config launch_configs/ref', 'reference_bearing.yaml'),
    ],
)
def test_the_tab_key_offers_commands_options_and_files(typed: str, offered: str, tmp_path: Path) -> None:
    """Ask by argcomplete as the shell does: the answer comes by descriptor 8."""
    environment = {'_ARGCOMPLETE': '1', 'COMP_LINE': typed, 'COMP_POINT': str(len(typed))}
    answer = tmp_path / 'answer'
    subprocess.run(
        ['bash', '-c', f'{SCRIPTS}/stickslip 8>{answer}'],
        cwd=ROOT,
        env=os.environ | environment | {'IFS': '\v'},
        check=True,
    )
    assert offered in answer.read_text()


@pytest.mark.parametrize('command', ['--help', 'check --help', 'health --help'])
def test_commands_without_numbers_start_without_numerical_libraries(command: str) -> None:
    # A container asks ``health`` every half minute.
    code = (
        'import sys; from stickslip_monitor.cli import main\n'
        'try: main(sys.argv[1:])\nexcept SystemExit: pass\n'
        'print(sorted({"numpy", "scipy", "rclpy", "yaml"} & set(sys.modules)))'
    )
    line = [sys.executable, '-c', code, *command.split()]
    done = subprocess.run(line, capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == '[]'
