# SPDX-License-Identifier: Apache-2.0
"""No command destroys what it reads, or what somebody else wrote."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from command_cases import (
    OF_MONITOR,
    WAYS,
    inputs_of,
    list_declared_files,
    make_arguments,
    outputs_of,
    refuse_outputs_that_are_inputs,
)
from shared import CONFIG, ROOT, Stickslip

from stickslip_monitor.commands.output import check_files
from stickslip_monitor.errors import OutputError

BAG = ROOT / 'bags' / 'coast_down'


def test_the_commands_that_write_declare_it() -> None:
    written = {name: sorted(outputs_of(name)) for name in OF_MONITOR}
    assert {name: outputs for name, outputs in written.items() if outputs} == {
        'check': ['report'],
        'diagram': ['output'],
        'init': ['output'],
        'map': ['output'],
    }


@pytest.mark.parametrize('spelling', WAYS)
@pytest.mark.parametrize('command', [n for n in OF_MONITOR if outputs_of(n) and inputs_of(n)])
def test_an_output_that_is_an_input_is_refused(command: str, spelling: str, tmp_path: Path) -> None:
    refuse_outputs_that_are_inputs(command, spelling, tmp_path)


@pytest.mark.parametrize('source_kind', ['configuration', 'recording', 'archive'])
def test_files_that_an_input_names_or_holds_are_inputs(source_kind: str, tmp_path: Path) -> None:
    files = list_declared_files('check')
    (tmp_path / 'archive' / 'one').mkdir(parents=True)
    (tmp_path / 'archive' / 'one' / 'a.html').write_text('{}')
    (tmp_path / 'own.html').write_text('{}')
    config = tmp_path / 'own.yaml'
    config.write_text('/**: {ros__parameters: {aft: {calibration: own.html}}}')
    output, source = {
        'configuration': ('own.html', {'config': str(config)}),
        'recording': ('archive/one/a.html', {'bags': [tmp_path / 'archive' / 'one']}),
        'archive': ('archive/one/a.html', {'bags': [tmp_path / 'archive']}),
    }[source_kind]
    with pytest.raises(OutputError, match='is the input'):
        check_files(make_arguments(files, report=tmp_path / output, **source))


@pytest.mark.parametrize(
    ('command', 'option', 'suffix', 'more'),
    [
        ('check', '--report', '.html', (BAG, '-c', CONFIG)),
        ('diagram', '-o', '.csv', ('-c', CONFIG, '--load', '1kN', '--points', '10')),
        ('map', '-o', '.svg', ('-c', CONFIG)),
    ],
)
def test_a_foreign_file_is_replaced_only_by_force_and_an_own_one_always(
    command: str, option: str, suffix: str, more: tuple[object, ...], tmp_path: Path, stickslip: Stickslip
) -> None:
    output, foreign = tmp_path / f'output{suffix}', 'somebody wrote this on stickslip_monitor\n'
    output.write_text(foreign)
    output.chmod(0o600)
    line = [command, *more, option, output]
    done = stickslip(*line)
    assert done.code == 2
    assert f"output '{output}' exists and was not written by this" in done.err
    assert output.read_text() == foreign
    for force in (['--force'], []):
        done = stickslip(*line, *force)
        assert done.code < 2
        assert command == 'check' or done.err == f'{output} written\n'
    assert output.read_text() != foreign
    assert output.stat().st_mode & 0o777 == 0o600
    assert [path.name for path in tmp_path.iterdir()] == [output.name]


@pytest.mark.parametrize('option', ['--clips', '--mcap'])
def test_no_recording_is_written_into_the_folder_that_is_checked(
    option: str, tmp_path: Path, stickslip: Stickslip
) -> None:
    bag = shutil.copytree(BAG, tmp_path / 'bag')
    target = bag if option == '--clips' else bag / 'new.mcap'
    files = sorted(bag.iterdir())
    result = stickslip('check', bag, '-c', CONFIG, option, target)
    assert result.code == 2
    assert 'whose recordings are checked' in result.err
    assert sorted(bag.iterdir()) == files


@pytest.mark.slow
@pytest.mark.parametrize('sent', [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_command_that_is_stopped_leaves_nothing_behind(sent: signal.Signals, tmp_path: Path) -> None:
    line = ['check', '-', '-c', CONFIG, '--report', tmp_path / 'a.html']
    with subprocess.Popen(
        [sys.executable, '-m', 'stickslip_monitor', *line],
        stdin=subprocess.PIPE,
        stderr=subprocess.PIPE,
        env=os.environ | {'TMPDIR': str(tmp_path)},
    ) as program:
        # More than the first piece, by which the file gets its name.
        program.stdin.write(next(BAG.glob('*.mcap')).read_bytes() + bytes(2 << 20))
        program.stdin.flush()
        while not list(tmp_path.glob('stickslip-*/*')):
            time.sleep(0.02)
        # One that comes just before a read is seen after it: a person presses again.
        for _ in range(300):
            if program.poll() is not None:
                break
            program.send_signal(sent)
            time.sleep(0.2)
        else:
            program.kill()  # started where Ctrl-C is ignored, say
        assert program.wait() == 130
        assert program.stderr.read() == b''
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize('module', ['argparse', 'matplotlib'])
@pytest.mark.parametrize('sent', [signal.SIGINT, signal.SIGTERM])
def test_a_signal_while_modules_are_loaded_ends_a_command_without_a_word(
    sent: signal.Signals, module: str, tmp_path: Path
) -> None:
    """Load the first module before the command line, the second by the command."""
    signalled = f'import os, time; os.kill(os.getpid(), {sent.value}); time.sleep(9)'
    (tmp_path / f'{module}.py').write_text(f'exec({signalled!r})')
    line = ['diagram', '-c', CONFIG, '--load', '1kN', '-o', tmp_path / 'a.png']
    done = subprocess.run(
        [sys.executable, '-m', 'stickslip_monitor', *line],
        env=os.environ | {'PYTHONPATH': str(tmp_path)},
        capture_output=True,
        check=False,
    )
    assert (done.returncode, done.stdout, done.stderr) == (130, b'', b'')
    assert not (tmp_path / 'a.png').exists()


@pytest.mark.parametrize(
    ('bag', 'closed', 'code'),
    [
        ('-', '<&-', 2),
        (BAG, '>&-', 1),
        (BAG, '2>&-', 1),
        (BAG, '2>/dev/full', 1),
        ('gone', '2>/dev/full', 2),
        (BAG, '>/dev/full', 2),
    ],
)
def test_a_stream_that_takes_nothing_is_no_fault_of_the_program(
    bag: object, closed: str, code: int, tmp_path: Path
) -> None:
    line = f'check {bag} -c {CONFIG} --json --report {tmp_path}/a.html {closed}'
    done = subprocess.run(
        f'{sys.executable} -m stickslip_monitor {line}',
        shell=True,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == code, done.stderr
    assert (tmp_path / 'a.html').exists() == (bag == BAG)
    if closed == '<&-':
        assert done.stderr == "ERROR: bag '-' is empty: 0 bytes\n"
        assert json.loads(done.stdout)['error'] == "bag '-' is empty: 0 bytes"
    if closed == '>/dev/full':
        assert done.stderr.endswith('ERROR: No space left on device\n')


def test_a_reader_that_has_gone_is_no_all_clear() -> None:
    read, write = os.pipe()
    os.close(read)
    command = [sys.executable, '-m', 'stickslip_monitor', 'check', str(BAG), '-c', str(CONFIG)]
    done = subprocess.run(command, stdout=write, stderr=subprocess.PIPE, check=False)
    os.close(write)
    assert (done.returncode, done.stderr) == (1, b'')
