# SPDX-License-Identifier: Apache-2.0
"""`stickslip check` over many bags at once."""

from __future__ import annotations

import io
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from shared import CONFIG, DEADLINE, ROOT, Stickslip, until

from stickslip_logs.recordings.folders import describe_unchecked, find_bags

BAGS = ROOT / 'bags'
NAMES = ('voyage', 'coast_down', 'history_above', 'history_below')


CHECK = ('check', '--config', CONFIG)


def check_as_json(stickslip: Stickslip, *arguments: object) -> tuple[int, Any]:
    done = stickslip(*CHECK, *arguments, '--json')
    return done.code, done.json


@pytest.mark.slow
def test_together_and_one_by_one_are_the_same_in_the_order_asked(stickslip: Stickslip) -> None:
    bags = [BAGS / name for name in NAMES]
    code, together = check_as_json(stickslip, *bags, '--jobs', 3)
    assert code == 1
    # The longest comes first: it is not done first.
    assert [document['path'] for document in together] == [str(bag) for bag in bags]
    assert (code, together) == check_as_json(stickslip, *bags, '--jobs', 1)
    alone = [check_as_json(stickslip, bag)[1] for bag in bags]
    assert together == alone


@pytest.mark.slow
def test_a_bag_that_fails_is_named_and_the_others_are_reported(tmp_path: Path, stickslip: Stickslip) -> None:
    (tmp_path / 'torn.mcap').write_bytes(b'nothing')
    bags = [BAGS / 'history_above', tmp_path / 'torn.mcap', tmp_path / 'gone', BAGS / 'voyage']
    result = stickslip(*CHECK, *bags, '--jobs', 2)
    assert result.code == 2
    assert result.out.index(str(bags[0])) < result.out.index(str(bags[3]))
    (torn, missing) = result.err.splitlines()
    assert torn.startswith(f"ERROR: {bags[1]}: bag file '{bags[1]}' is not a recording of MCAP or SQLite")
    assert missing == f"ERROR: {bags[2]}: bag '{bags[2]}' does not exist"
    code, documents = check_as_json(stickslip, *bags, '--jobs', 2)
    assert code == 2
    assert [document['path'] for document in documents] == [str(bag) for bag in bags]
    assert [bag['error'] is None if 'error' in bag else True for bag in documents] == [
        True,
        False,
        False,
        True,
    ]


def test_one_bag_that_fails_is_an_error_as_ever(tmp_path: Path, stickslip: Stickslip) -> None:
    done, text = stickslip(*CHECK, tmp_path / 'gone', '--json'), f"bag '{tmp_path / 'gone'}' does not exist"
    assert (done.code, done.json['error'], done.err) == (2, text, f'ERROR: {text}\n')


def test_a_folder_of_bags_is_a_list_even_of_one(tmp_path: Path, stickslip: Stickslip) -> None:
    shutil.copytree(BAGS / 'voyage', tmp_path / 'voyage')
    code, documents = check_as_json(stickslip, tmp_path)
    assert (code, [document['path'] for document in documents]) == (0, [str(tmp_path / 'voyage')])


def test_files_beside_recordings_are_named_and_no_all_clear(tmp_path: Path, stickslip: Stickslip) -> None:
    shutil.copytree(BAGS / 'voyage', tmp_path / 'b')
    log = tmp_path / 'load.log'
    log.write_text('time,rpm,load\n' + ''.join(f'{k},30,900\n' for k in range(20)))
    text = f"1 file not checked (name one to check it, or to see why not): '{log}'"
    code, (checked,) = check_as_json(stickslip, tmp_path)
    assert (code, checked['complete'], checked['warnings'][-1]) == (1, False, text)
    assert f'data: {text}\n' in stickslip(*CHECK, tmp_path).out
    # It is said once, whatever comes of the recording that is first.
    (tmp_path / 'a.mcap').write_bytes(b'nothing')
    code, (torn, checked) = check_as_json(stickslip, tmp_path, '--jobs', 1)
    assert (code, torn['error'].endswith(f'; {text}'), checked['complete']) == (2, True, True)


def test_a_log_that_is_named_or_learnt_from_is_not_left_out(tmp_path: Path) -> None:
    (tmp_path / 'a.mcap').touch()
    (tmp_path / 'b.csv').touch()
    (tmp_path / 'reports.csv').touch()
    recordings = [*find_bags([tmp_path, tmp_path / 'b.csv']), tmp_path / 'reports.csv']
    assert describe_unchecked([tmp_path], recordings) == ''


@pytest.mark.parametrize('cut', [0, 3000])
def test_a_recording_on_standard_input_is_checked_as_the_file_is(
    cut: int, tmp_path: Path, stickslip: Stickslip, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Check a recording whole, and one that ends in the middle of a chunk."""
    data = next((BAGS / 'coast_down').glob('*.mcap')).read_bytes()
    path = tmp_path / 'standard_input'
    path.write_bytes(data[: len(data) - cut])
    code, expected = check_as_json(stickslip, path)
    monkeypatch.setattr(sys, 'stdin', io.TextIOWrapper(io.BytesIO(path.read_bytes())))
    found_code, documents = check_as_json(stickslip, '-')
    assert bool(documents['cuts']) == bool(cut)
    for document in (expected, documents):
        document['path'] = None
        for place in document['cuts']:
            place['file'] = None
    assert (found_code, documents) == (code, expected)


@pytest.mark.slow
def test_a_report_names_recordings_that_could_not_be_checked(tmp_path: Path, stickslip: Stickslip) -> None:
    pytest.importorskip('jinja2')
    page = tmp_path / 'page.html'
    bags = [BAGS / 'history_above', tmp_path / 'gone <b>', BAGS / 'voyage']
    assert stickslip(*CHECK, *bags, '--jobs', 2, '--report', page).code == 2
    source = page.read_text('utf-8')
    assert 'gone &lt;b&gt;, this recording could not be checked: bag ' in source
    assert '<b>' not in source
    # A map and a course of the other two, each in two widths.
    assert source.count('<svg') == 8


@pytest.mark.slow
def test_ctrl_c_ends_it_at_once_and_without_a_word(tmp_path: Path) -> None:
    (recording,) = (BAGS / 'voyage').glob('*.mcap')
    for number in range(200):
        (tmp_path / f'bag_{number}').mkdir()
        (tmp_path / f'bag_{number}' / 'bag_0.mcap').symlink_to(recording)
    command = [sys.executable, '-m', 'stickslip_monitor.cli', 'check', '--jobs', '2']
    with subprocess.Popen(
        [*command, '--config', CONFIG, tmp_path],
        cwd=ROOT,
        start_new_session=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as program:
        assert 'bag_0: ' in program.stdout.readline()
        # A terminal sends Ctrl-C to all processes of a session.
        os.killpg(program.pid, signal.SIGINT)
        out, err = program.communicate(timeout=DEADLINE)
    assert (program.returncode, err) == (130, '')
    assert out.count(' messages in ') < 150
    until(lambda: not group_lives(program.pid), 'the end of all its processes')


def group_lives(group: int) -> bool:
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    return True


def test_a_stream_without_end_that_is_no_recording_is_refused_at_once() -> None:
    with Path('/dev/zero').open('rb') as endless:
        done = subprocess.run(
            [sys.executable, '-m', 'stickslip_monitor.cli', 'check', '-', '-c', str(CONFIG)],
            stdin=endless,
            capture_output=True,
            text=True,
            timeout=60.0,
            check=False,
        )
    assert done.returncode == 2
    assert "'-' is not a recording of MCAP or SQLite" in done.stderr
