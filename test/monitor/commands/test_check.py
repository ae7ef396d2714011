# SPDX-License-Identifier: Apache-2.0
"""`stickslip check` and its report, over real recordings and over hostile ones."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
from hashlib import sha256
from html import escape, unescape
from pathlib import Path

import numpy as np
import pytest
import yaml
from made_logs import START, write_recording
from shared import CONFIG, ROOT, Stickslip

from stickslip_logs.recordings.reader import open_bag
from stickslip_logs.recordings.writer import BagWriter
from stickslip_monitor.cli import main
from stickslip_monitor.drawing.canvas import CONDITION_NAMES
from stickslip_monitor.errors import BagError
from stickslip_monitor.monitor.severity import Condition
from stickslip_monitor.report import page as report_page

BAG = ROOT / 'bags' / 'coast_down'
CHECK = ('check', '--config', CONFIG, '--jobs', 1)
KNOCK = ('check', ROOT / 'bags' / 'measured_knock', '--config', ROOT / 'launch_configs/measured_bearing.yaml')
FAST, SLOW = 60.0, 20.0  # rpm: clear of stick-slip, and well below the fold speed of 40.7


def record_one_speed(path: Path, rpm: float, seconds: int = 40) -> Path:
    """Write a recording at one speed and 1000 N, a value of each a second."""
    times = START + np.arange(seconds, dtype=np.int64) * 10**9
    values = {'/shaft/speed': rpm, '/bearing/aft_stern/load': 1000.0}
    return write_recording(path, {name: (times, np.full(seconds, v)) for name, v in values.items()})


def config_with(folder: Path, *bearings: str, **changes: object) -> Path:
    """Write the reference bearing under other names, with other values for some of the node's."""
    node = yaml.safe_load(CONFIG.read_text('utf-8'))['/**']['ros__parameters']
    bearing = node.pop('aft_stern') | {'stiffness': 2.0e6}  # to YAML 1.1, 2.0e6 is a text
    names = bearings or ('aft_stern',)
    node |= {'bearings': [*names], **dict.fromkeys(names, bearing)}
    for name, change in changes.items():
        node[name] = node[name] | change if isinstance(node.get(name), dict) else change
    path = folder / 'own.yaml'
    path.write_text(json.dumps({'/**': {'ros__parameters': node}}), 'utf-8')
    return path


@pytest.fixture(scope='module')
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the report on two recordings, one with and one without alarms."""
    pytest.importorskip('matplotlib')
    pytest.importorskip('jinja2')
    path = tmp_path_factory.mktemp('report') / 'out.html'
    line = [*CHECK, BAG, ROOT / 'bags' / 'voyage', '--report', path]
    assert main([*map(str, line)]) == 1
    return path


def text_of(page: Path) -> str:
    """Return the text that a reader sees, without tags and pictures."""
    text = re.sub(r'<(svg|style).*?</\1>', '', page.read_text('utf-8'), flags=re.DOTALL)
    return ' '.join(unescape(re.sub(r'<[^>]+>', ' ', text)).split())


@pytest.mark.slow
def test_a_level_tells_of_the_blow_that_speed_and_load_do_not_show(
    tmp_path: Path, stickslip: Stickslip
) -> None:
    def found(*line: object) -> dict:
        return stickslip(*line, '--json').json['bearings']['aft_stern']

    blind, seeing = found(*CHECK, KNOCK[1]), found(*KNOCK)
    assert 'measured' not in {*blind, *blind['events'][0]}
    assert 'stick_slip' not in {event['to'] for event in blind['events']}
    (predicted,) = (event for event in seeing['events'] if event['to'] == 'stick_slip')
    # Struck at 130 s: only what lasts 75 s is stick-slip where sliding is stable.
    assert 204.5 < (predicted['time'] - 1_778_054_400 * 10**9) * 1e-9 < 206.0
    assert predicted['measured'] == 'vibrating'
    assert sum(seeing['measured'].values()) == pytest.approx(330.0, abs=0.5)
    text = stickslip(*KNOCK, '--mcap', tmp_path / 'out.mcap').out
    assert 'measured vibration: unknown' in ' '.join(text.split())
    assert found('check', tmp_path / 'out.mcap', *KNOCK[2:])['events'] == seeing['events']
    # Without its topic the level is silent, and that is said; speed and load are judged.
    assert found('check', BAG, *KNOCK[2:])['measured']['unknown'] > 0.0
    silent = stickslip('check', BAG, *KNOCK[2:])
    assert silent.code == 1
    assert "the recording has no topic '/bearing/aft_stern/level'" in silent.out


def test_the_report_has_every_event_of_the_check(page: Path, stickslip: Stickslip) -> None:
    events = stickslip(*CHECK, BAG, '--json').json['bearings']['aft_stern']['events']
    text, source = text_of(page), page.read_text('utf-8')
    assert 'Stick-slip was predicted in 1 of 2 recordings.' in text[:200]
    assert sha256(CONFIG.read_bytes()).hexdigest() in source
    ids = re.findall(r'\bid="([^"]+)"', source)
    assert len(ids) == len(set(ids))
    assert len(events) > 5
    for event in events:
        assert event['text'].partition(': ')[2] in text
        assert CONDITION_NAMES[Condition(event['to'])] in text
    assert source.count('<time datetime="2026-05-04T06:0') == len(events)


def hostile_bag(folder: Path) -> Path:
    """Write a recording whose folder and topics have names that would break a page."""
    times = START + np.arange(60, dtype=np.int64) * 10**9
    values = {'/shaft/speed': 20.0, '/bearing/aft_stern/load': 1000.0, '/<script>alert(1)</script>': 0.0}
    columns = {name: (times, np.full(60, value)) for name, value in values.items()}
    return write_recording(folder / '<b>&"\'$x$ {{ 1 }}[red][x', columns)


def test_hostile_names_stay_text(tmp_path: Path, stickslip: Stickslip) -> None:
    pytest.importorskip('jinja2')
    bag, out = hostile_bag(tmp_path), tmp_path / 'out.html'
    printed = stickslip(*CHECK, bag, '--report', out).out
    assert bag.name in printed
    # 20 / 40.7231 - 1, and the exact cycle of 0.556755 mm.
    assert 'worst fold margin: -50.9% at 0.00 s' in printed
    assert 'worst amplitude: 0.5568 mm at ' in printed
    source = out.read_text('utf-8')
    assert '<script' not in source
    assert '<b>' not in source
    assert escape(bag.name, quote=False).split('"')[0] in source
    assert '/<script>alert(1)</script>' in text_of(out).replace(' ', '')


@pytest.mark.parametrize(
    ('suffix', 'successor'), [('.json', '--json prints'), ('.png', 'any browser prints')]
)
def test_formats_of_a_report_that_are_gone_name_their_successor(
    suffix: str, successor: str, tmp_path: Path, stickslip: Stickslip
) -> None:
    done = stickslip(*CHECK, BAG, '--report', tmp_path / f'out{suffix}')
    assert done.code == 2
    assert f"out{suffix}' is not written any more: " in done.err
    assert successor in done.err
    assert not list(tmp_path.iterdir())


def test_a_long_recording_has_a_small_page_that_loses_no_excursion(
    tmp_path: Path, stickslip: Stickslip
) -> None:
    """Six hours at 10 Hz with noise and one bad second."""
    pytest.importorskip('jinja2')
    size = 216_000
    speeds = 60.0 + np.random.default_rng(1).normal(0.0, 0.5, size)
    speeds[100_000:100_010] = 20.0
    times = START + np.arange(size, dtype=np.int64) * 10**8
    loads = np.full(size, 1000.0)
    columns = {'/shaft/speed': (times, speeds), '/bearing/aft_stern/load': (times, loads)}
    write_recording(tmp_path / 'day', columns)
    path = tmp_path / 'day.html'
    assert stickslip(*CHECK, tmp_path / 'day', '--report', path).code < 2
    assert path.stat().st_size < 1_000_000
    # 20 / 40.7231 - 1
    assert 'least fold margin \u221250.9 % 08:46:40' in text_of(path).replace('\u00a0', ' ')


# --- in a real browser -------------------------------------------------------------------------

CHROMIUM = shutil.which('chromium') or shutil.which('chromium-browser')
HARNESS = """<!doctype html><body>
<iframe id="frame" src="{page}" style="border:0;width:{width}px;height:900px"></iframe>
<script>
addEventListener('load', () => {{
  const inside = document.getElementById('frame').contentDocument;
  const shown = [...inside.querySelectorAll('figure svg')]
    .filter(e => e.getBoundingClientRect().width);
  document.title = JSON.stringify({{
    width: inside.documentElement.scrollWidth, shown: shown.length,
    tall: shown.every(e => e.getBoundingClientRect().height > 200),
    back: getComputedStyle(inside.body).backgroundColor,
  }});
}});
</script>"""


@pytest.mark.skipif(CHROMIUM is None, reason='Chromium is not installed')
@pytest.mark.parametrize(('width', 'dark'), [(360, False), (1200, True)])
def test_in_a_browser_it_fits_a_phone_and_follows_the_night(
    width: int, *, dark: bool, page: Path, tmp_path: Path
) -> None:
    harness = tmp_path / 'harness.html'
    harness.write_text(HARNESS.format(page=page.as_uri(), width=width))
    flags = [
        'headless',
        'no-sandbox',
        'disable-gpu',
        'hide-scrollbars',
        'dump-dom',
        'allow-file-access-from-files',
    ]
    flags += ['allow-file-access-from-files', f'blink-settings=preferredColorScheme={int(not dark)}']
    line = [CHROMIUM, *(f'--{flag}' for flag in flags), harness.as_uri()]
    completed = subprocess.run(line, capture_output=True, text=True, check=True, timeout=60)
    (title,) = re.findall(r'<title>(.*?)</title>', completed.stdout)
    layout = json.loads(unescape(title))
    assert layout['width'] == width
    # A map and a timeline for each recording, each in one of its two widths.
    assert (layout['shown'], layout['tall']) == (4, True)
    assert layout['back'] == ('rgb(22, 25, 29)' if dark else 'rgb(255, 255, 255)')


def test_two_publishers_and_a_wrong_unit_are_reported(tmp_path: Path, stickslip: Stickslip) -> None:
    """60 and 20 rpm in turn, ten a second; the load in kN where N are expected."""
    time, is_odd = START + np.arange(200) * 10**8, np.arange(200) % 2
    columns = {
        '/shaft/speed': (time, np.where(is_odd, 20.0, 60.0)),
        '/bearing/aft_stern/load': (time + 1, np.full(200, 1.0)),
    }
    bag = write_recording(tmp_path / 'bag', columns)
    inputs = stickslip(*CHECK, bag, '--json').json['bearings']['aft_stern']['inputs']
    speed = inputs['speed']
    assert (speed['span'], speed['share']) == ([20.0, 60.0], 1.0)
    rpm = np.pi * 0.1 / 60.0
    assert speed['si_span'] == pytest.approx([20.0 * rpm, 60.0 * rpm])
    assert [fault['fault'] for fault in speed['source_faults']] == ['two_levels']
    assert inputs['load']['source_faults'] == []
    done = stickslip(*CHECK, bag)
    assert done.code == 1
    assert 'speed on /shaft/speed: 1 x values jump between two levels' in done.out
    assert '(here 20 and 60 rpm)' in done.out
    assert '20 to 60 rpm (0.1047 to 0.3142 m/s), 10 a second, 100.0% used' in done.out
    assert 'question: speed on /shaft/speed has no boundary at any load' in done.out


def test_one_of_several_bearings_is_checked(tmp_path: Path, stickslip: Stickslip) -> None:
    line = ['check', BAG, '--config', config_with(tmp_path, 'aft_stern', 'fore'), '--json']
    for more, names in (([], ['aft_stern', 'fore']), (['--bearing', 'fore'], ['fore'])):
        assert list(stickslip(*line, *more).json['bearings']) == names


def test_of_many_bearings_the_worst_are_drawn_and_the_others_say_so(
    tmp_path: Path, stickslip: Stickslip, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip('jinja2')
    monkeypatch.setattr(report_page, 'MAX_DRAWN', 1)
    # Friction that does not fall: no cycle at any speed.
    level = {'friction': {'law': 'stribeck', 'static': 0.1, 'kinetic': 0.1, 'decay': 10.0}}
    path = tmp_path / 'three.html'
    config = config_with(tmp_path, 'fore', 'aft', 'mid', fore=level, mid=level)
    assert stickslip('check', BAG, '--config', config, '--report', path).code == 1
    sections = re.split(r'<section class="bearing"', path.read_text('utf-8'))[1:]
    assert ['<svg' in section for section in sections] == [False, True, False]
    assert ['Not drawn' in section for section in sections] == [True, False, True]


def test_the_report_says_for_how_long_vibration_was_measured(tmp_path: Path, stickslip: Stickslip) -> None:
    pytest.importorskip('jinja2')
    page = tmp_path / 'out.html'
    assert stickslip(*KNOCK, '--report', page).code == 1
    sentence = re.search(r'vibration measured (\d+) min (\d+) s', text_of(page))
    # By the truth of the recording it sticks from 130.1 s to 269.5 s; it rings on a little. In
    # the first five minutes what goes on for 15 s is used.
    assert 60.0 * float(sentence[1]) + float(sentence[2]) == pytest.approx(269.5 - 145.1, abs=6.0)


def test_an_absent_topic_costs_its_bearing_and_no_other(tmp_path: Path, stickslip: Stickslip) -> None:
    fore = {'load': {'topic': '/fore/load', 'unit': 'N'}}
    config = config_with(tmp_path, 'aft_stern', 'fore', fore=fore)
    done = stickslip('check', record_one_speed(tmp_path / 'in', SLOW), '-c', config, '--json')
    # Nothing is known of one: as with a topic on which nothing came.
    assert done.code == 2
    bearings = done.json['bearings']
    assert 'stick_slip' in {event['to'] for event in bearings['aft_stern']['events']}
    assert bearings['fore']['evaluations'] == 0
    assert "no topic '/fore/load'" in bearings['fore']['inputs']['load']['fault']
    assert 'nothing is known of fore' in done.err


def test_unread_parts_are_no_all_clear(tmp_path: Path, stickslip: Stickslip) -> None:
    (file,) = record_one_speed(tmp_path / 'whole', FAST).glob('*.mcap')
    done = stickslip(*CHECK, file, '--json')
    assert (done.code, done.json['complete']) == (0, True)
    half = tmp_path / 'half.mcap'
    half.write_bytes(file.read_bytes()[:-100])
    done = stickslip(*CHECK, half, '--json')
    assert (done.code, done.json['complete']) == (1, False)
    assert done.json['bearings']['aft_stern']['events'] == []


def test_at_rest_no_margin_is_the_worst(tmp_path: Path, stickslip: Stickslip) -> None:
    done = stickslip(*CHECK, record_one_speed(tmp_path / 'in', 0.0), '--json')
    assert (done.code, done.json['bearings']['aft_stern']['worst']) == (0, {})


def test_a_path_that_is_no_text_has_its_report(tmp_path: Path, stickslip: Stickslip) -> None:
    pytest.importorskip('jinja2')
    bag = record_one_speed(tmp_path / os.fsdecode(b'caf\xe9'), FAST)
    assert stickslip(*CHECK, bag, '--report', tmp_path / 'out.html').code == 0
    assert 'caf\N{REPLACEMENT CHARACTER}' in (tmp_path / 'out.html').read_text('utf-8')


def test_a_link_that_leads_nowhere_is_named_as_one(tmp_path: Path, stickslip: Stickslip) -> None:
    link = tmp_path / 'voyage.mcap'
    link.symlink_to('gone.mcap')
    assert stickslip(*CHECK, link) == (
        2,
        '',
        f"ERROR: bag '{link}' does not exist: it is a link that leads nowhere, to 'gone.mcap'\n",
    )


def test_a_clip_is_the_whole_around_its_alarm(tmp_path: Path, stickslip: Stickslip) -> None:
    stickslip(*CHECK, record_one_speed(tmp_path / 'in', SLOW), '--clips', tmp_path / 'clips')
    (clip,) = (tmp_path / 'clips').glob('*.mcap')
    assert {'/shaft/speed', '/bearing/aft_stern/load', '/diagnostics'} <= set(open_bag(clip).topics)


def test_a_clip_that_cannot_be_written_costs_no_verdict(
    tmp_path: Path, stickslip: Stickslip, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object) -> None:
        raise BagError('no space left')

    monkeypatch.setattr(BagWriter, '_publish_draft', refuse)
    done = stickslip(*CHECK, BAG, '--clips', tmp_path / 'clips', '--json')
    assert done.code == 1
    assert done.json['bearings']['aft_stern']['events']
    assert 'ERROR: ' in done.err
    assert 'a clip was not written: no space left' in done.err
    assert list((tmp_path / 'clips').iterdir()) == []


# --- several recordings ------------------------------------------------------------------------


def test_a_report_has_those_that_need_a_look_most_and_a_row_for_each_other(
    tmp_path: Path, stickslip: Stickslip, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip('jinja2')
    monkeypatch.setattr(report_page, 'MAX_DRAWN', 2)
    sizes = []
    for count in (4, 10):
        for number in range(count):
            if not (tmp_path / 'year' / f'v{number}').exists():
                # The alarm comes late.
                record_one_speed(tmp_path / 'year' / f'v{number}', SLOW if number == 3 else FAST)
        page = tmp_path / f'{count}.html'
        assert stickslip(*CHECK, tmp_path / 'year', '--report', page).code == 1
        sizes.append(page.stat().st_size)
    # Six further recordings, at 3 kB each at most.
    assert sizes[1] - sizes[0] < 6 * 3000
    source = page.read_text('utf-8')
    # Two pictures of each bearing, in two widths.
    assert source.count('<svg') == 2 * 4
    assert re.findall(r'<h2[^>]*>Recording (v\d)</h2>', source) == ['v0', 'v3']
    other_bearings = source.partition('id="others"')[2]
    assert re.findall(r'<tr><td>(v\d)</td>', other_bearings) == [f'v{n}' for n in (1, 2, *range(4, 10))]


def test_six_recordings_with_an_alarm_in_one_second_give_six_clips(
    tmp_path: Path, stickslip: Stickslip
) -> None:
    bags = [record_one_speed(tmp_path / 'in' / f'r{n}', SLOW) for n in range(6)]
    done = stickslip('check', *bags, '--config', CONFIG, '--clips', tmp_path / 'clips', '--jobs', 3)
    assert (done.code, done.err.count('1 clip written')) == (1, 6)
    assert len(list((tmp_path / 'clips').glob('*.mcap'))) == 6


def test_clips_removed_by_the_limit_are_reported(tmp_path: Path, stickslip: Stickslip) -> None:
    bags = [record_one_speed(tmp_path / 'in' / f'r{n}', SLOW) for n in range(3)]
    config, clips = config_with(tmp_path, clips={'most': 2}), tmp_path / 'clips'
    *_, last = stickslip('check', *bags, '-c', config, '--clips', clips, '--jobs', 1).err.splitlines()
    assert last.endswith(f'1 clip written into {clips}; 1 older clip removed, as clips.most says')
    assert len(list(clips.glob('*.mcap'))) == 2
