# SPDX-License-Identifier: Apache-2.0
"""What holds for the commands of every package: outputs, refusals, help and narrow screens."""

from __future__ import annotations

import argparse
import math
import os
import pty
import re
import shlex
import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from threading import Thread
from typing import Any

import pytest
from made_logs import write_recording
from shared import ROOT, Stickslip

from stickslip_monitor import cli
from stickslip_monitor.commands.options import FileOption
from stickslip_monitor.commands.output import check_files
from stickslip_monitor.errors import OutputError

OF_LAB = [*cli.ELSEWHERE]
OF_MONITOR = [name for name in cli.COMMANDS if name not in OF_LAB]
LAW = '{law: stribeck, static: 0.30, kinetic: 0.10, decay: 10.0}'
# The recording begins on 2026-05-04 at 06:00 UTC.
REPORT = 'aft_stern,2026-05-05T06:00:00Z,2026-05-05T06:02:00Z,quiet\n'
WAYS: Mapping[str, Callable[[Path, Path], object]] = {
    'itself': lambda new, old: old.rename(new),
    'hard link': lambda new, old: os.link(old, new),
    'symbolic link': lambda new, old: new.symlink_to(old),
}


def list_declared_files(command: str) -> Sequence[FileOption]:
    """Return the files that the options of a command name."""
    parser = argparse.ArgumentParser()
    import_module(cli.module_of(command)).add_arguments(parser)
    return parser.get_default('files') or ()


def outputs_of(command: str) -> dict[str, Sequence[str]]:
    """Return the endings of what a command writes, by option."""
    return {file.dest: list(file.marks) for file in list_declared_files(command) if file.marks is not None}


def inputs_of(command: str) -> list[str]:
    """Return the options by which a command reads files."""
    return [file.dest for file in list_declared_files(command) if file.is_read]


def make_arguments(files: Sequence[FileOption], **paths: object) -> argparse.Namespace:
    """Arguments with these paths and nothing else."""
    texts = {k: [*map(str, v)] if isinstance(v, list) else str(v) for k, v in paths.items()}
    nothing = {file.dest: None for file in files}
    return argparse.Namespace(files=files, force=True, **nothing | texts)


def refuse_outputs_that_are_inputs(command: str, spelling: str, folder: Path) -> None:
    """Check that an output of a command that is an input in some way is refused."""
    files, number = list_declared_files(command), 0
    sources = inputs_of(command)
    for output, suffixes in outputs_of(command).items():
        for suffix in suffixes:
            for source in sources:
                number += 1
                old, new = folder / f'{number}.in', folder / f'{number}{suffix}'
                old.write_text('anything')
                WAYS[spelling](new, old)
                read = new if spelling == 'itself' else old
                args = make_arguments(files, **{source: [read], output: str(new)})
                with pytest.raises(OutputError, match=r'is the input'):
                    check_files(args)
                assert new.read_text() == 'anything'
    assert number


def write_files_of_a_user(path: Path) -> None:
    """Write what the refused command lines name."""
    text = (ROOT / 'launch_configs' / 'reference_bearing.yaml').read_text('utf-8')
    section = text[text.index('    aft_stern:') :].replace('aft_stern:', 'forward:', 1)
    assert LAW in text
    for name, content in {
        'own.yaml': text,
        'two.yaml': text.replace('[aft_stern]', '[aft_stern, forward]') + section,
        'late.csv': f'bearing,start,end,state\n{REPORT}',
        'short': 'hunter2\n',
        'open': 'hunter2\n',
        'there.mcap': '',
    }.items():
        (path / name).write_text(content, 'utf-8')
    (path / 'short').chmod(0o600)
    shutil.copy(ROOT / 'launch_configs' / 'scenes' / 'coast_down.yaml', path / 'scene.yaml')
    (path / 'open').chmod(0o604)
    write_recording(path / 'empty', {'/a': ([], [])})
    two = [0, 10**9], [1.0, 1.0]
    write_recording(path / 'bare', {'/shaft/speed': two, '/bearing/aft_stern/load': two})


def refuse_line(line: str, text: str, folder: Path, stickslip: Stickslip) -> None:
    """Check that a line is refused in one sentence that has a text, and that nothing is written."""
    files = sorted(folder.iterdir())
    result = stickslip(*shlex.split(line))
    message = result.err
    assert result.code == 2
    assert text in message
    assert message.startswith('ERROR: ')
    assert message.count('\n') == 1
    assert 'hunter2' not in message
    assert sorted(folder.iterdir()) == files


def list_number_options(commands: Iterable[str]) -> dict[str, tuple[str, Any]]:
    """Return each option that takes a number between bounds, by its command."""
    cases = {}
    for command in commands:
        parser = argparse.ArgumentParser()
        import_module(cli.module_of(command)).add_arguments(parser)
        for action in parser._actions:
            if hasattr(action, 'rule'):
                cases[f'{command} {action.option_strings[0]}'] = (command, action)
    return cases


def refuse_numbers_out_of_bounds(name: str, command: str, action: Any, stickslip: Stickslip) -> None:
    """Try that an option takes the numbers between its bounds, and no others."""
    low, high, above = action.rule
    wrong = [low if above else low - 1, *([high + 1] if high < math.inf else [])]
    wrong += [math.nan, *([math.inf] if above else [])] if action.kind is float else []
    for value in wrong:
        done = stickslip(command, f'{name.split()[1]}={value}')
        assert done.code == 2
        assert f'ERROR: {name.split()[1]} = {action.type(value)!r} must be ' in done.err
    right = [low + 1, high if high < math.inf else low + 2]
    for value in right:
        args = argparse.Namespace()
        action(argparse.ArgumentParser(), args, action.type(value))
        assert getattr(args, action.dest) == value


def show_on_40_columns(arguments: Sequence[str], folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Try that nothing that a command prints is cut off on a narrow screen."""
    for name, value in (('COLUMNS', '40'), ('TERM', 'xterm'), ('NO_COLOR', '1')):
        monkeypatch.setenv(name, value)
    monkeypatch.chdir(folder)
    terminal, screen = pty.openpty()
    parts: list[bytes] = []
    reader = Thread(target=lambda: parts.extend(read_terminal(terminal)))
    reader.start()
    with os.fdopen(screen, 'w') as file, monkeypatch.context() as patch, suppress(SystemExit):
        patch.setattr('sys.stdout', file)
        assert cli.main(arguments) < 2
    reader.join()
    printed = b''.join(parts).decode()
    # Long words (paths) are left to the terminal to break.
    printed = re.sub('\x1b\\[[0-9;]*m', '', printed)
    lines = [line for line in printed.splitlines() if len(line.split()) > 1]
    assert max(map(len, lines)) <= 40
    assert '\N{HORIZONTAL ELLIPSIS}' not in printed


def read_terminal(terminal: int) -> Iterator[bytes]:
    """Yield what a terminal shows until the program has ended."""
    with os.fdopen(terminal, 'rb', buffering=0) as file:
        try:
            while data := file.read(65536):
                yield data
        except OSError:
            return


def show_help(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Show the help of a command: a per cent sign in it is a format of argparse, and fails when shown."""
    with pytest.raises(SystemExit) as stop:
        cli.main([command, '--help'])
    assert stop.value.code == 0
    assert capsys.readouterr().out.startswith(f'usage: stickslip {command} ')
