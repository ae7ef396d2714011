# SPDX-License-Identifier: Apache-2.0
"""Odd recordings, mutants of them, and files that grow: told, bounded, and nothing lost."""

from __future__ import annotations

import html
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from fuzz.bags import random_difference
from fuzz.corpus import LARGE, ODD
from fuzz.mutants import mutant
from fuzz.run import CONFIG, MEGABYTES, SOURCES, config_file, judge, judge_voyage
from fuzz.verdicts import Reading
from fuzz.voyages import QUIET_RPM, STICKING_RPM, VOYAGES, samples_of
from stickslip_logs.recordings.reader import open_bag
from stickslip_monitor.cli import main
from stickslip_monitor.errors import BagError

# Of memory that is asked for, used or not: numpy's threads ask for much.
ADDRESS_SPACE = 2 << 30


def message_counts(document: dict[str, dict[str, dict[str, dict[str, dict[str, int]]]]]) -> list[int]:
    inputs = document['bearings']['aft_stern']['inputs']
    return [inputs[name]['messages'] for name in ('speed', 'load')]


@pytest.mark.parametrize('name', ODD)
def test_an_odd_recording_is_reported_and_read_as_far_as_it_can_be(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    recording, path = ODD[name], tmp_path / 'odd.mcap'
    path.write_bytes(recording.make())
    code = main(['check', str(path), '--config', str(CONFIG)])
    printed = ''.join(capsys.readouterr())
    assert recording.says in printed
    assert '\x1b' not in printed
    assert (code == 2) == (recording.speed == 0)
    if code < 2:
        assert main(['check', str(path), '--config', str(CONFIG), '--json']) == code
        assert message_counts(json.loads(capsys.readouterr().out)) == [recording.speed, recording.load]


def test_json_and_report_tell_of_damage_too(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, page = tmp_path / 'odd.mcap', tmp_path / 'page.html'
    path.write_bytes(ODD['statistics count more'].make())
    main(['check', str(path), '--config', str(CONFIG), '--json', '--report', str(page)])
    (text,) = json.loads(capsys.readouterr().out)['warnings']
    assert ODD['statistics count more'].says in text
    assert html.escape(text).replace('&#x27;', '&#39;') in page.read_text()


LIMITED = """
import resource, sys
resource.setrlimit(resource.RLIMIT_AS, (int(sys.argv[1]),) * 2)
# Ten times what it takes alone: it ends an endless loop; a busy machine may take twice as long.
resource.setrlimit(resource.RLIMIT_CPU, (120,) * 2)
from stickslip_monitor.cli import main
code = main(['check', *sys.argv[2:]])
status = dict(line.split(':', 1) for line in open('/proc/self/status'))
# Not ru_maxrss, which a process inherits from the one that started it.
sys.stderr.write(f"\\n{int(status['VmHWM'].split()[0]) >> 10}\\n")
sys.exit(code)
"""


@pytest.mark.slow
@pytest.mark.parametrize('name', LARGE)
def test_a_file_that_grows_takes_no_memory(name: str, tmp_path: Path) -> None:
    recording, path = LARGE[name], tmp_path / 'large.mcap'
    path.write_bytes(recording.make())
    done = subprocess.run(
        [sys.executable, '-c', LIMITED, str(ADDRESS_SPACE), str(path), '--config', str(CONFIG)],
        capture_output=True,
        text=True,
        timeout=1200,  # those 120 s, on a tenth of a core
        check=False,
    )
    assert recording.says in done.stdout + done.stderr
    # Without a load, or with numbers of one time only, nothing is predicted.
    assert done.returncode in ((1,) if recording.load else (0, 1, 2))
    assert int(done.stderr.split()[-1]) < MEGABYTES


@pytest.mark.parametrize('kind', SOURCES)
def test_mutants_lose_nothing_without_a_word(kind: str, tmp_path: Path) -> None:
    source, path = SOURCES[kind](), tmp_path / f'mutant.{kind}'
    for seed in range(40):
        path.write_bytes(mutant(seed, source, kind))
        assert judge(path) == '', f'seed {seed}'


@pytest.mark.parametrize('kind', VOYAGES)
def test_mutants_of_a_voyage_have_its_verdict_or_words(
    kind: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, is_read = tmp_path / f'mutant.{kind}', kind != 'candump'
    for speeds, code in ((QUIET_RPM, 0), (STICKING_RPM, 1)):
        for data in VOYAGES[kind](speeds):
            path.write_bytes(data)
            assert main(['check', str(path), '--config', config_file(kind)]) == (code if is_read else 2)
            assert judge_voyage(path, is_quiet=not code) == ''
    for speeds, seeds in ((QUIET_RPM, range(20)), (STICKING_RPM, range(20))):
        source = VOYAGES[kind](speeds)
        for seed in seeds:
            path.write_bytes(mutant(seed, source, kind))
            assert judge_voyage(path, speeds is QUIET_RPM) == '', f'seed {seed}'


@pytest.mark.parametrize('kind', ['csv', 'nmea', 'db3'])
def test_what_a_reader_loses_or_invents_is_noticed(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / f'sound.{kind}'
    path.write_bytes(VOYAGES[kind](STICKING_RPM)[0])
    samples = samples_of(STICKING_RPM)
    late = {sample._replace(time_ns=sample.time_ns + 10**6) for sample in samples}
    sound = Reading(samples, is_told=False, most_missing=0, is_moved=False, count=60)
    for wrong, fault in (
        (sound._replace(samples={*list(samples)[1:]}), '1 of 60 samples'),
        (sound._replace(samples=set(), count=0, is_told=True, most_missing=8, is_moved=True), '60 of 60'),
        (sound._replace(samples=late, is_told=True, most_missing=8), '60 of 60 samples'),
        (sound._replace(samples=samples | late), '60 samples are of no line'),
    ):
        monkeypatch.setattr('fuzz.verdicts.read_voyage', lambda *_, wrong=wrong: wrong)
        is_bounded = kind != 'db3' or 'of no line' not in fault
        assert judge_voyage(path, is_quiet=False).startswith(fault if is_bounded else '')


def test_a_page_that_asks_for_more_memory_than_there_is(tmp_path: Path) -> None:
    path = tmp_path / 'mutant.db3'
    path.write_bytes(mutant((20261126 << 32) + 417, SOURCES['db3'](), 'db3'))
    assert judge(path) == ''


@pytest.mark.filterwarnings('error')
@pytest.mark.parametrize('seed', [2, 8, 46, 51])
def test_a_session_and_a_check_find_the_same_events(seed: int, tmp_path: Path) -> None:
    """Send stamps in disorder and infinity, which are no slow clock, no held values and no fault."""
    assert random_difference(tmp_path, seed) == ''


def test_a_file_that_is_cut_while_it_is_read(tmp_path: Path) -> None:
    path = tmp_path / 'a.mcap'
    data = ODD['sound'].make()
    for size in range(0, len(data), 97):
        path.write_bytes(data)
        bag = open_bag(path)
        os.truncate(path, size)
        assert sum(1 for _ in bag.messages()) == 60 or bag.warnings


def test_a_device_is_not_opened() -> None:
    with pytest.raises(BagError, match='a device'):
        open_bag('/dev/zero')
