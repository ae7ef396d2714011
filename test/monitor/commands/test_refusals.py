# SPDX-License-Identifier: Apache-2.0
"""What the commands refuse: in one sentence, with exit code 2, and before anything is written."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from command_cases import (
    OF_MONITOR,
    list_number_options,
    refuse_line,
    refuse_numbers_out_of_bounds,
    write_files_of_a_user,
)
from shared import ROOT, Stickslip

from stickslip_monitor.cli import COMMANDS

BAG = f'{ROOT}/bags/coast_down'
CURVE = f'{ROOT}/launch_configs/examples/friction_curve.csv'

REFUSED = {
    # What was meant.
    '': f'a command is missing: one of {", ".join(COMMANDS)} (see stickslip --help)',
    'chek x': "command 'chek' is not known; did you mean 'check'?",
    'figures -o x': "command 'figures' has moved to `python scripts/draw_findings.py`",
    'score x': "command 'score' has moved to `python -m benchmarks.score`",
    'xyz': f"command 'xyz' is not known; there are: {', '.join(COMMANDS)}",
    'assess --bering=a': "option '--bering=a' is not known; did you mean '--bearing'? (see"
    ' stickslip assess --help)',
    'assess -c own.yaml --speed 20rpm': 'required: --load (see stickslip assess --help)',
    f'check {BAG[:-1]} -c own.yaml': "; did you mean 'coast_down'?",
    f'check {BAG} -c ow.yaml': "No such file or directory; did you mean 'own.yaml'?",
    'assess -c own.yaml --speed 1rpm --load 1N --bearing aft': "'aft' is not configured; did you"
    " mean 'aft_stern'?",
    # Quantities.
    'assess -c own.yaml --speed 1rpm --load 1kip': "load = '1kip' must be a number with a unit: one"
    " of N, kN, MN, tf, t, lbf, and 'kip' is none of these",
    'assess -c own.yaml --speed 20 --load 1N': "speed = '20' must be a number with a unit",
    'diagram -c own.yaml -o a.csv --load=-5N': "load = '-5N' must be above 0",
    'map -c own.yaml -o a.csv --loads 2kN': "loads = '2kN' must be LOW:HIGH, each with its unit",
    'map -c own.yaml -o a.csv --loads 2kN:1kN': "loads = '2kN:1kN' must be rising from its first value",
    'map -c own.yaml -o a.csv --speeds=-1rpm:9rpm': "speeds = '-1rpm:9rpm' must be rising",
    'dashboard -c own.yaml --port 80x': "--port = '80x' must be a whole number between 0 and 65535",
    f'check {BAG} -c own.yaml --jobs many': "--jobs = 'many' must be a whole number not below 1",
    f'check {BAG} -c own.yaml --report x.pdf': "output 'x.pdf' must end in .html",
    'health --page ship:8370': "--page = 'ship:8370' must be an address such as http://",
    'health --page http://127.0.0.1:1': 'gives no figures: Connection refused',
    # Options that go together, or do not.
    'map -c own.yaml -o a.csv --track x': "track 'x' is for pictures: write a .png or .svg",
    'diagram -c two.yaml --load 1kN -o a.csv': 'choose --bearing from aft_stern, forward',
    f'check - {BAG} -c own.yaml': "'-', a recording on standard input, goes alone",
    f'check {BAG} -c own.yaml --resume x': "option '--resume' is gone: run the check again",
    f'check {BAG} -c own.yaml --learn level': "option '--learn' is gone: use stickslip calibrate, which says",
    **{
        f'check {BAG} -c own.yaml --scheduler tcp://ship:8786 {option}': (
            f'{option.split()[0]} does not go with --scheduler'
        )
        for option in ('--jobs 2', '--mcap x.mcap', '--clips x')
    },
    'dashboard -c own.yaml --node /port/a --node /port/b': "--node '/port/b' is in the same"
    " namespace as '/port/a'",
    'dashboard -c own.yaml -c own.yaml --node /a/m --node /b/m --node /c/m': '--config is given 2'
    ' times for 3 nodes',
    f'dashboard -c own.yaml --bag {BAG} --log x.json': 'a replay is not kept',
    f'dashboard -c own.yaml --bag {BAG} --node /a/m --node /b/m': '--bag replays for one monitor',
    f'dashboard -c own.yaml --bag {BAG} --host 0.0.0.0': '--host 0.0.0.0 lets others in: give --token-file',
    f'dashboard -c own.yaml --bag {BAG} --host localhost.evil.test': 'lets others in: give',
    # Files.
    'map -c own.yaml -o a.jpeg': "output 'a.jpeg' must end in one of .png, .svg, .csv",
    'map -c own.yaml -o a': "output 'a' must end in one of .png, .svg, .csv",
    'map -c own.yaml -o no/a.csv': "'no/a.csv' cannot be written: there is no folder",
    'map -c own.yaml -o a.png --track none': "bag 'none' does not exist",
    # The folder that the shell is in is not meant, but a variable that is not set.
    'play empty': "bag 'empty' has no messages to play",
    'play none': "bag 'none' does not exist",
    f'check {"x" * 300} -c own.yaml': 'File name too long',
    'check x --mcap out.bag -c own.yaml': 'must end in .mcap',
    'check x y --mcap out.mcap -c own.yaml': 'is for one bag, not 2',
    'check x --mcap there.mcap -c own.yaml': 'exists already and is not overwritten',
    "info ''": 'bag is given an empty name',
    "play ''": 'bag is given an empty name',
    "check '' -c own.yaml": 'bags is given an empty name',
    "dashboard -c own.yaml --bag ''": '--bag is given an empty name',
    'info own.yaml': "log 'own.yaml' has no line with a time and a number",
    'dashboard -c own.yaml --log no/x.json': "--log = 'no/x.json': there is no folder",
    'dashboard -c own.yaml --log own.yaml': 'is not a file of stickslip_monitor: left alone',
    'dashboard -c own.yaml --bag none': "bag 'none' does not exist",
    'dashboard -c own.yaml --token-file none': "token file 'none' cannot be read: No such",
    'dashboard -c own.yaml --token-file open': 'is open to every user: chmod 600',
    'dashboard -c own.yaml --token-file short': 'must hold at least 16 printable ASCII characters',
}


@pytest.fixture(scope='module')
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Files of a user."""
    path = tmp_path_factory.mktemp('own')
    write_files_of_a_user(path)
    return path


@pytest.mark.parametrize('line', REFUSED)
def test_a_refusal_is_one_sentence(
    line: str, folder: Path, monkeypatch: pytest.MonkeyPatch, stickslip: Stickslip
) -> None:
    if line.startswith('dashboard'):
        pytest.importorskip('aiohttp', reason="the extra 'dashboard' is not installed")
    monkeypatch.chdir(folder)
    refuse_line(line, REFUSED[line], folder, stickslip)


def test_options_with_bounds_have_them() -> None:
    """Compare with the docs and the help of each command."""
    assert {name: action.rule for name, (_, action) in list_number_options(OF_MONITOR).items()} == {
        'check --jobs': (1, math.inf, False),
        'dashboard --port': (0, 65535, False),
        'dashboard --rate': (0, math.inf, True),
        'diagram --points': (10, 100_000, False),
        'health --timeout': (0, 600, True),
        'play --loop': (1, math.inf, False),
        'play --rate': (0, math.inf, True),
        'play --wait': (0, math.inf, False),
        'watch --port': (0, 65535, False),
    }


@pytest.mark.parametrize('name', list_number_options(OF_MONITOR))
def test_a_number_out_of_its_bounds_is_refused(name: str, stickslip: Stickslip) -> None:
    refuse_numbers_out_of_bounds(name, *list_number_options(OF_MONITOR)[name], stickslip)
