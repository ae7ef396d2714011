# SPDX-License-Identifier: Apache-2.0
"""What a check of an archive says and leaves: its report, its clips, its exit code."""

from __future__ import annotations

import json
import os
import re
from pathlib import Path

import numpy as np
import pytest
import yaml
from shared import CONFIG, ROOT, START, record

from stickslip_monitor.bags.reader import open_bag
from stickslip_monitor.bags.writer import BagWriter
from stickslip_monitor.cli import main
from stickslip_monitor.errors import BagError
from stickslip_monitor.report import page as report_page

FAST, SLOW = 60.0, 20.0  # rpm: clear of stick-slip, and well below the fold speed of 40.7


def check(*arguments: object) -> int:
    return main(['check', *map(str, arguments), '--config', str(CONFIG), '--jobs', '1'])


def sail(path: Path, rpm: float, seconds: int = 40) -> Path:
    """A recording at one speed and 1000 N, a value of each a second."""
    times = START + np.arange(seconds, dtype=np.int64) * 10**9
    values = {'/shaft/speed': rpm, '/bearing/aft_stern/load': 1000.0}
    return record(path, {name: (times, np.full(seconds, v)) for name, v in values.items()})


def config_with(folder: Path, **changes: object) -> Path:
    """The reference bearing, with other values for some of the node's."""
    node = yaml.safe_load(CONFIG.read_text('utf-8'))['/**']['ros__parameters']
    node['aft_stern']['stiffness'] = 2.0e6  # to YAML 1.1, 2.0e6 is a text
    path = folder / 'own.yaml'
    path.write_text(json.dumps({'/**': {'ros__parameters': node | changes}}), 'utf-8')
    return path


def test_a_report_has_those_that_need_a_look_most_and_a_row_for_each_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip('jinja2')
    monkeypatch.setattr(report_page, 'MOST_DRAWN', 2)
    sizes = []
    for count in (4, 10):
        for number in range(count):
            if not (tmp_path / 'year' / f'v{number}').exists():
                # The alarm comes late.
                sail(tmp_path / 'year' / f'v{number}', SLOW if number == 3 else FAST)
        page = tmp_path / f'{count}.html'
        assert check(tmp_path / 'year', '--report', page) == 1
        sizes.append(page.stat().st_size)
    # Six further recordings, at 3 kB each at most.
    assert sizes[1] - sizes[0] < 6 * 3000
    source = page.read_text('utf-8')
    # Two pictures of each bearing, in two widths.
    assert source.count('<svg') == 2 * 4
    assert re.findall(r'<h2[^>]*>Recording (v\d)</h2>', source) == ['v0', 'v3']
    others = source.partition('id="others"')[2]
    assert re.findall(r'<tr><td>(v\d)</td>', others) == [f'v{n}' for n in (1, 2, *range(4, 10))]


def test_six_recordings_with_an_alarm_in_one_second_give_six_clips(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bags = [sail(tmp_path / 'in' / f'r{n}', SLOW) for n in range(6)]
    clips = tmp_path / 'clips'
    line = ['check', *map(str, bags), '--config', str(CONFIG), '--clips', str(clips)]
    assert main([*line, '--jobs', '3']) == 1
    assert len(list(clips.glob('*.mcap'))) == 6
    assert capsys.readouterr().err.count('1 clip written') == 6


def test_what_the_limit_has_removed_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    config = config_with(tmp_path, clips={'most': 2})
    bags = [str(sail(tmp_path / 'in' / f'r{n}', SLOW)) for n in range(3)]
    clips = tmp_path / 'clips'
    line = ['check', *bags, '-c', str(config), '--clips', str(clips), '--jobs', '1']
    assert main(line) == 1
    *_, last = capsys.readouterr().err.splitlines()
    assert last.endswith(f'1 clip written into {clips}; 1 older clip removed, as clips.most says')
    assert len(list(clips.glob('*.mcap'))) == 2


def test_a_clip_that_cannot_be_written_costs_no_verdict(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object) -> None:
        raise BagError('no space left')

    monkeypatch.setattr(BagWriter, '_finish', refuse)
    bag = ROOT / 'bags' / 'coast_down'
    assert check(bag, '--clips', tmp_path / 'clips', '--json') == 1
    said = capsys.readouterr()
    (bearing,) = json.loads(said.out)['bearings'].values()
    assert bearing['events']
    assert 'ERROR: ' in said.err
    assert 'a clip was not written: no space left' in said.err
    assert list((tmp_path / 'clips').iterdir()) == []


def test_an_absent_topic_costs_its_bearing_and_no_other(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    own = yaml.safe_load(CONFIG.read_text('utf-8'))['/**']['ros__parameters']['aft_stern']
    fore = own | {'load': {'topic': '/fore/load', 'unit': 'N'}, 'stiffness': 2.0e6}
    config = config_with(tmp_path, bearings=['aft_stern', 'fore'], fore=fore)
    bag = sail(tmp_path / 'in', SLOW)
    # Nothing is known of one: as with a topic on which nothing came.
    assert main(['check', str(bag), '-c', str(config), '--json']) == 2
    said = capsys.readouterr()
    bearings = json.loads(said.out)['bearings']
    assert 'stick_slip' in {event['to'] for event in bearings['aft_stern']['events']}
    assert bearings['fore']['evaluations'] == 0
    assert "no topic '/fore/load'" in bearings['fore']['inputs']['load']['fault']
    assert 'nothing is known of fore' in said.err


def test_what_was_not_read_is_no_all_clear(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (file,) = sail(tmp_path / 'whole', FAST).glob('*.mcap')
    assert check(file, '--json') == 0
    assert json.loads(capsys.readouterr().out)['complete'] is True
    half = tmp_path / 'half.mcap'
    half.write_bytes(file.read_bytes()[:-100])
    assert check(half, '--json') == 1
    found = json.loads(capsys.readouterr().out)
    assert found['complete'] is False
    assert found['bearings']['aft_stern']['events'] == []


def test_at_rest_no_margin_is_the_worst(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert check(sail(tmp_path / 'in', 0.0), '--json') == 0
    (bearing,) = json.loads(capsys.readouterr().out)['bearings'].values()
    assert bearing['worst'] == {}


def test_a_path_that_is_no_text_has_its_report(tmp_path: Path) -> None:
    pytest.importorskip('jinja2')
    bag = sail(tmp_path / os.fsdecode(b'caf\xe9'), FAST)
    assert check(bag, '--report', tmp_path / 'out.html') == 0
    assert 'caf\N{REPLACEMENT CHARACTER}' in (tmp_path / 'out.html').read_text('utf-8')


def test_a_link_that_leads_nowhere_is_named_as_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    link = tmp_path / 'voyage.mcap'
    link.symlink_to('gone.mcap')
    assert check(link) == 2
    assert capsys.readouterr().err == (
        f"ERROR: bag '{link}' does not exist: it is a link that leads nowhere, to 'gone.mcap'\n"
    )


def test_a_clip_is_the_whole_around_its_alarm(tmp_path: Path) -> None:
    bag = sail(tmp_path / 'in', SLOW)
    check(bag, '--clips', tmp_path / 'clips')
    (clip,) = (tmp_path / 'clips').glob('*.mcap')
    there = open_bag(clip).topics
    assert {'/shaft/speed', '/bearing/aft_stern/load', '/diagnostics'} <= set(there)
