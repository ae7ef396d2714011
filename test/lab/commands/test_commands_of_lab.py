# SPDX-License-Identifier: Apache-2.0
"""The commands of the laboratory destroy nothing, refuse in one sentence, and fit narrow screens."""

from __future__ import annotations

import math
import os
from pathlib import Path

import pytest
from command_cases import (
    OF_LAB,
    WAYS,
    inputs_of,
    list_declared_files,
    list_number_options,
    make_arguments,
    outputs_of,
    refuse_line,
    refuse_numbers_out_of_bounds,
    refuse_outputs_that_are_inputs,
    show_help,
    show_on_40_columns,
    write_files_of_a_user,
)
from shared import CONFIG, ROOT, Stickslip

from stickslip_monitor.commands.output import check_files
from stickslip_monitor.errors import OutputError

BAG = f'{ROOT}/bags/coast_down'
CURVE = f'{ROOT}/launch_configs/examples/friction_curve.csv'

REFUSED = {
    'calibrate --level=x': "option '--level' is gone: configure level.topic in the parameter file",
    'simulate scen.yaml -o x': "; did you mean 'scene.yaml'?",
    f'fit {CURVE} -c own.yaml --load 0N': "load = '0N' must be above 0",
    f'fit {CURVE} --journal-diameter 0': '--journal-diameter = 0.0 must be a finite number above 0',
    f'fit {CURVE} --journal-diameter 80mm': "--journal-diameter = '80mm' must be a finite number above 0",
    f'fit {CURVE}': "speeds in rpm need the journal's diameter: give --journal-diameter",
    f'fit {CURVE} -c own.yaml': '--config needs --load',
    f'fit {CURVE} --load 1kN': '--load needs --config',
    f'fit {CURVE} --speed 1rpm': '--speed needs --config and --load',
    'accuracy --from x --quick': 'does not go with --quick',
    'fit none.csv': 'none.csv: No such file',
    'accuracy --from none.csv': 'cannot be read',
    "simulate '' -o x": 'scene is given an empty name',
    f'calibrate {BAG} -c own.yaml --reports late.csv': 'line 2: the report lies outside',
    'calibrate bare -c own.yaml': 'holds no truth about aft_stern',
}


def test_the_commands_that_write_declare_it() -> None:
    assert {name: sorted(outputs) for name in OF_LAB if (outputs := outputs_of(name))} == {
        'accuracy': ['output', 'picture'],
        'calibrate': ['fragment', 'output', 'picture'],
        'fit': ['fragment', 'output', 'picture'],
    }


@pytest.mark.parametrize('spelling', WAYS)
@pytest.mark.parametrize('command', [n for n in OF_LAB if outputs_of(n) and inputs_of(n)])
def test_an_output_that_is_an_input_is_refused(command: str, spelling: str, tmp_path: Path) -> None:
    refuse_outputs_that_are_inputs(command, spelling, tmp_path)


def test_a_calibration_may_be_renewed_where_the_configuration_names_it(tmp_path: Path) -> None:
    (tmp_path / 'own.json').write_text('{"schema": "stickslip_monitor/calibration/1"}')
    (tmp_path / 'own.yaml').write_text('a: own.json')
    files, output = list_declared_files('calibrate'), str(tmp_path / 'own.json')
    check_files(make_arguments(files, output=output, config=tmp_path / 'own.yaml', add=output))
    with pytest.raises(OutputError, match='is the input'):
        check_files(make_arguments(files, fragment=output, config=tmp_path / 'own.yaml'))


@pytest.mark.parametrize(
    ('paths', 'text'),
    [
        ({'output': 'a.csv', 'fragment': 'a.csv'}, 'are one file'),
        ({'output': '{0}/a.csv', 'fragment': '{0}/../{1}/a.csv'}, 'are one file'),
        ({'output': 'a.pdf'}, r"output '.*a\.pdf' must end in \.csv"),
        ({'picture': 'none/a.png'}, "there is no folder '.*none'"),
        ({'picture': 'folder.png'}, 'is a folder, and only files are replaced'),
        ({'picture': 'pipe.png'}, 'is a pipe, and only files are replaced'),
        ({'picture': ''}, '--picture is given an empty name'),
    ],
)
def test_an_output_that_cannot_be_written_is_reported_before_the_work(
    paths: dict[str, str], text: str, tmp_path: Path
) -> None:
    (tmp_path / 'folder.png').mkdir()
    os.mkfifo(tmp_path / 'pipe.png')
    filled = {
        option: path and str(tmp_path / path.format(tmp_path, tmp_path.name))
        for option, path in paths.items()
    }
    with pytest.raises(OutputError, match=text):
        check_files(make_arguments(list_declared_files('fit'), **filled))


@pytest.mark.parametrize('line', REFUSED)
def test_a_refusal_is_one_sentence(
    line: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, stickslip: Stickslip
) -> None:
    write_files_of_a_user(tmp_path)
    monkeypatch.chdir(tmp_path)
    refuse_line(line, REFUSED[line], tmp_path, stickslip)


def test_options_with_bounds_have_them() -> None:
    """Compare with the docs and the help of each command."""
    assert {name: action.rule for name, (_, action) in list_number_options(OF_LAB).items()} == {
        'calibrate --forget': (0, 1, False),
        'fit --journal-diameter': (0, math.inf, True),
    }


@pytest.mark.parametrize('name', list_number_options(OF_LAB))
def test_a_number_out_of_its_bounds_is_refused(name: str, stickslip: Stickslip) -> None:
    refuse_numbers_out_of_bounds(name, *list_number_options(OF_LAB)[name], stickslip)


@pytest.mark.parametrize('command', OF_LAB)
def test_every_command_shows_its_help(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    show_help(command, capsys)


@pytest.mark.parametrize(
    'arguments',
    [
        ('fit', CURVE, '--journal-diameter', '0.1', '--config', str(CONFIG), '--load', '1kN'),
        ('accuracy', '--from', str(ROOT / 'docs' / 'accuracy.csv')),
        ('simulate', str(ROOT / 'launch_configs/scenes/wear.yaml'), '-o', 'bag'),
    ],
    ids=lambda arguments: arguments[0],
)
def test_on_a_screen_of_40_columns_nothing_is_cut_off(
    arguments: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    show_on_40_columns(arguments, tmp_path, monkeypatch)
