# SPDX-License-Identifier: Apache-2.0
"""Every command line in the README and the docs runs as it is written."""

from __future__ import annotations

import itertools
import os
import re
import shlex
import shutil
import signal
import subprocess
import sysconfig
from pathlib import Path

import pytest
from shared import ROOT

from stickslip_monitor import cli

PAGES = [
    *(ROOT / name for name in ('README.md', 'CONTRIBUTING.md', 'bags/README.md')),
    *sorted((ROOT / 'docs').glob('*.md')),
]
# Programs of which a line is a command line.
PROGRAMS = ('stickslip', 'python', 'python3', 'make', 'ros2', 'pip', '.venv/bin/pip')
# What the lines below need beside the repository's own files: files of the reader's own.
OWN_CONFIGURATIONS = ('my_ship.yaml', 'ship.yaml')
# Appended where the line as written would take long, or would use what other tests may use.
APPENDED = {
    'stickslip play ': '--rate 5000',
    'stickslip dashboard ': '--port 0',
    'stickslip accuracy --picture ': '--quick',
}


def lines_of(page: Path) -> list[str]:
    """Return the command lines of a page's code blocks, continued lines joined, without comments."""
    commands, fenced = [], False
    for line in page.read_text('utf-8').replace('\\\n', ' ').splitlines():
        if line.startswith('```'):
            fenced = not fenced
        elif fenced or line.startswith('    '):
            commands.append(re.sub(r'\s+#\s.*| &$', '', line).strip())
    return [line for line in commands if line.split(' ')[0] in PROGRAMS]


LINES = {(page.relative_to(ROOT).as_posix(), line) for page in PAGES for line in lines_of(page)}
COMMANDS = sorted({' '.join(line.split()) for _, line in LINES if line.startswith('stickslip ')})
# Those that need a cluster, a ship's bus or a node are run in test/monitor: offline, links and
# ros, which have one; a line with an ellipsis is a pattern, and `init` asks a person.
# Those of the quick page build on one another.
QUICK = ROOT / 'docs' / 'quick.md'
RUN = [
    line
    for line in COMMANDS
    if not re.search(r'--scheduler| watch | health| init -o |\.\.\.', line) and line not in lines_of(QUICK)
]


def find_fault(line: str) -> str:
    """Return what is wrong with a line that this test cannot run; empty where nothing is."""
    makefile = (ROOT / 'Makefile').read_text('utf-8')
    setup = (ROOT / 'setup.py').read_text('utf-8')
    words = line.replace("'", '').split()
    for first, second in itertools.pairwise(words):
        if first == 'make' and not re.search(rf'^{re.escape(second)}:', makefile, re.MULTILINE):
            return f'no target {second}'
        if second.startswith('scripts/') and not (ROOT / second).is_file():
            return f'no script {second}'
        for extra in re.findall(r'\[([a-z,]+)\]$', second if first == 'install' else ''):
            if missing := [e for e in extra.split(',') if f"'{e}':" not in setup]:
                return f'no extra {missing}'
    executable = re.match(r'ros2 run stickslip_monitor (\w+)', line)
    return f'no executable {executable[1]}' if executable and f"f'{executable[1]} = " not in setup else ''


def test_a_negative_value_needs_no_equals_sign(capsys: pytest.CaptureFixture[str]) -> None:
    config = str(ROOT / 'launch_configs' / 'reference_bearing.yaml')
    problems = []
    for speed in (['--speed', '-20rpm'], ['--speed=-20rpm']):
        assert cli.main(['assess', '--config', config, *speed, '--load', '1000N', '--json']) == 1
        problems.append(capsys.readouterr().out)
    assert problems[0] == problems[1]
    # What follows -- is never the value of an option.
    assert cli.main(['check', '--config', config, '--', '-1.mcap']) == 2
    assert "'-1.mcap' does not exist" in capsys.readouterr().err


def test_docs_have_command_lines() -> None:
    pages = {page for page, line in LINES if line.startswith('stickslip ')}
    assert {'README.md', 'docs/quick.md', 'docs/fit.md', 'docs/dashboard.md'} <= pages


def test_commands_that_are_not_run_here_exist() -> None:
    assert [(page, line, fault) for page, line in sorted(LINES) if (fault := find_fault(line))] == []


def test_every_command_line_is_understood(capsys: pytest.CaptureFixture[str]) -> None:
    refused = []
    for line in COMMANDS:
        words = shlex.split(line)[1:]
        try:
            cli._make_parser(words[0]).parse_args(words)
        except SystemExit as stop:
            # --help ends well.
            if stop.code:
                refused.append((line, capsys.readouterr().err))
    assert refused == []


@pytest.fixture(scope='module')
def scratch(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Make a folder that looks like the repository to a reader, with files of his own."""
    folder = tmp_path_factory.mktemp('reader')
    for name in ('launch_configs', 'bags', 'docs', 'scripts'):
        (folder / name).symlink_to(ROOT / name)
    for name in OWN_CONFIGURATIONS:
        shutil.copy(ROOT / 'launch_configs' / 'reference_bearing.yaml', folder / name)
    for name in ('coast_down', 'history_above'):
        shutil.copytree(ROOT / 'bags' / name, folder / 'archive' / name)
    scene = ROOT / 'launch_configs' / 'scenes' / 'bistable_knock.yaml'
    (folder / 'my_scene.yaml').write_text(scene.read_text('utf-8').replace('../', 'launch_configs/'), 'utf-8')
    shutil.copy(ROOT / 'launch_configs' / 'examples' / 'slow_down.yaml', folder)
    rows = ''.join(f'{second},{60 - second / 10},1.0\n' for second in range(500))
    (folder / 'voyage.csv').write_text(f'time [s],shaft speed [rpm],load [kN]\n{rows}')
    assert start_line('stickslip simulate slow_down.yaml -o slow_down', folder).wait(timeout=300.0) == 0
    (folder / 'token').write_text('abcdefghijklmnopqrstuvwxyz0123456789\n')
    (folder / 'token').chmod(0o600)
    return folder


def start_line(line: str, folder: Path) -> subprocess.Popen[str]:
    appended = ' '.join(text for head, text in APPENDED.items() if line.startswith(head))
    path = os.pathsep.join([sysconfig.get_path('scripts'), os.environ.get('PATH', os.defpath)])
    return subprocess.Popen(
        f'exec {line} {appended}',
        shell=True,
        cwd=folder,
        env=os.environ | {'PATH': path, 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'OFF'},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )


def run_line(line: str, folder: Path) -> tuple[int, str]:
    """Return exit code and output of a command line; a page is left as soon as it is there."""
    program = start_line(line, folder)
    printed = ''
    if ' dashboard ' in line:
        printed = program.stdout.readline()
        assert printed.startswith('Dashboard on http://'), printed + program.stdout.read()
        program.send_signal(signal.SIGINT)
    printed += program.communicate(timeout=300.0)[0]
    return program.returncode, printed


@pytest.mark.slow
@pytest.mark.parametrize('line', RUN)
def test_command_line_runs_as_written(line: str, scratch: Path) -> None:
    code, printed = run_line(line, scratch)
    # 1 says that warnings were found.
    assert code in (0, 1), printed
    assert 'Traceback' not in printed


@pytest.mark.slow
def test_the_quick_page_leads_to_the_first_alarm(tmp_path: Path) -> None:
    (tmp_path / 'launch_configs').symlink_to(ROOT / 'launch_configs')
    shutil.copy(ROOT / 'launch_configs' / 'examples' / 'slow_down.yaml', tmp_path)
    lines = [line for line in lines_of(QUICK) if line.startswith('stickslip ')]
    # The voyage and the slow-down have warnings.
    codes, printed = zip(*(run_line(line, tmp_path) for line in lines), strict=True)
    assert codes == tuple(int(' check ' in line) for line in lines), printed
    assert re.search(r'bistable +stick_slip +Stick-slip predicted\.', ''.join(printed))
