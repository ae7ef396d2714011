# SPDX-License-Identifier: Apache-2.0
"""`stickslip check` and its report, over real recordings and over hostile ones."""

from __future__ import annotations

import hashlib
import json
import re
import shutil
import subprocess
import sys
from html import escape, unescape
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from shared import CONFIG, ROOT, START, record

from stickslip_monitor.cli import main
from stickslip_monitor.drawing.canvas import CONDITION_NAMES
from stickslip_monitor.monitor.severity import Condition
from stickslip_monitor.report import page as report_page

BAG = ROOT / 'bags' / 'coast_down'


def check(*arguments: object) -> int:
    return main(['check', *map(str, arguments), '--config', str(CONFIG)])


@pytest.fixture(scope='module')
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The report on two recordings, one with and one without alarms."""
    pytest.importorskip('matplotlib')
    pytest.importorskip('jinja2')
    path = tmp_path_factory.mktemp('report') / 'out.html'
    assert check(BAG, ROOT / 'bags' / 'voyage', '--report', path, '--jobs', 1) == 1
    return path


def text_of(page: Path) -> str:
    """What a reader sees, without tags and pictures."""
    text = re.sub(r'<(svg|style).*?</\1>', '', page.read_text('utf-8'), flags=re.DOTALL)
    return ' '.join(unescape(re.sub(r'<[^>]+>', ' ', text)).split())


@pytest.mark.slow
def test_a_level_tells_of_the_blow_that_speed_and_load_do_not_show(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = ROOT / 'bags' / 'measured_knock'
    own = ['--config', str(ROOT / 'launch_configs' / 'measured_bearing.yaml')]

    def document(*arguments: str) -> dict[str, Any]:
        assert main(['check', *arguments, '--json']) == 1
        return json.loads(capsys.readouterr().out)['bearings']['aft_stern']

    blind, seeing = document(str(bag), '--config', str(CONFIG)), document(str(bag), *own)
    assert 'measured' not in {*blind, *blind['events'][0]}
    assert 'stick_slip' not in {event['to'] for event in blind['events']}
    (told,) = (event for event in seeing['events'] if event['to'] == 'stick_slip')
    # Struck at 130 s; in the first five minutes what goes on for 15 s is used.
    assert 145.0 < (told['time'] - 1_778_054_400 * 10**9) * 1e-9 < 146.0
    assert told['measured'] == 'vibrating'
    assert sum(seeing['measured'].values()) == pytest.approx(240.0, abs=0.5)
    assert main(['check', str(bag), *own, '--mcap', str(tmp_path / 'out.mcap')]) == 1
    assert 'measured vibration: unknown' in ' '.join(capsys.readouterr().out.split())
    again = document(str(tmp_path / 'out.mcap'), *own)
    assert again['events'] == seeing['events']
    # Without its topic the level is silent, and that is said; speed and load are judged.
    assert document(str(BAG), *own)['measured']['unknown'] > 0.0
    assert main(['check', str(BAG), *own]) == 1
    assert "the recording has no topic '/bearing/aft_stern/level'" in capsys.readouterr().out


def test_the_report_has_every_event_of_the_check(page: Path, capsys: pytest.CaptureFixture[str]) -> None:
    check(BAG, '--json')
    events = json.loads(capsys.readouterr().out)['bearings']['aft_stern']['events']
    text, source = text_of(page), page.read_text('utf-8')
    assert 'Stick-slip was predicted in 1 of 2 recordings.' in text[:200]
    assert hashlib.sha256(CONFIG.read_bytes()).hexdigest() in source
    ids = re.findall(r'\bid="([^"]+)"', source)
    assert len(ids) == len(set(ids))
    assert len(events) > 5
    for event in events:
        assert event['text'].partition(': ')[2] in text
        assert CONDITION_NAMES[Condition(event['to'])] in text
    assert source.count('<time datetime="2026-05-04T06:0') == len(events)


def hostile_bag(folder: Path) -> Path:
    """A recording whose folder and topics have names that would break a page."""
    times = START + np.arange(60, dtype=np.int64) * 10**9
    columns = {
        '/shaft/speed': (times, np.full(60, 20.0)),
        '/bearing/aft_stern/load': (times, np.full(60, 1000.0)),
        '/<script>alert(1)</script>': (times, np.zeros(60)),
    }
    return record(folder / '<b>&"\'$x$ {{ 1 }}[red][x', columns)


def test_hostile_names_stay_text(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip('jinja2')
    bag, out = hostile_bag(tmp_path), tmp_path / 'out.html'
    assert check(bag, '--report', out) == 1
    said = capsys.readouterr().out
    assert bag.name in said
    # 20 / 40.7231 - 1, and the exact cycle of 0.556755 mm.
    assert 'worst fold margin: -50.9% at 0.00 s' in said
    assert 'worst amplitude: 0.5568 mm at ' in said
    source = out.read_text('utf-8')
    assert '<script' not in source
    assert '<b>' not in source
    assert escape(bag.name, quote=False).split('"')[0] in source
    assert '/<script>alert(1)</script>' in text_of(out).replace(' ', '')


def test_png_and_json(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip('matplotlib')
    from matplotlib.image import imread

    # A name with dollar signs would be a formula to matplotlib.
    assert check(hostile_bag(tmp_path), '--report', tmp_path / 'out.png') == 1
    picture = imread(tmp_path / 'out.png')
    assert picture.shape[1] == 1350
    assert picture.shape[0] > 1500
    assert picture.std() > 0.05
    capsys.readouterr()
    assert check(BAG, '--json', '--report', tmp_path / 'out.json') == 1
    assert (tmp_path / 'out.json').read_text('utf-8') == capsys.readouterr().out


def test_a_long_recording_has_a_small_page_that_loses_no_excursion(tmp_path: Path) -> None:
    """Six hours at 10 Hz with noise and one bad second."""
    pytest.importorskip('jinja2')
    size = 216_000
    speeds = 60.0 + np.random.default_rng(1).normal(0.0, 0.5, size)
    speeds[100_000:100_010] = 20.0
    times = START + np.arange(size, dtype=np.int64) * 10**8
    loads = np.full(size, 1000.0)
    columns = {'/shaft/speed': (times, speeds), '/bearing/aft_stern/load': (times, loads)}
    record(tmp_path / 'day', columns)
    path = tmp_path / 'day.html'
    assert check(tmp_path / 'day', '--report', path) < 2
    assert path.stat().st_size < 1_000_000
    # 20 / 40.7231 - 1
    assert 'least fold margin \u221250.9 % 08:46:40' in text_of(path).replace('\u00a0', ' ')


@pytest.mark.slow
def test_a_check_imports_only_what_it_needs() -> None:
    # One bag, to a pipe: no bars, no pictures, no processes, no cluster, no ROS.
    code = (
        'import sys\n'
        'from stickslip_monitor.cli import main\n'
        f"assert main(['check', {str(BAG)!r}, '--config', {str(CONFIG)!r}]) == 1\n"
        "print(*{name.partition('.')[0] for name in sys.modules}, file=sys.stderr)\n"
    )
    done = subprocess.run([sys.executable, '-c', code], cwd=ROOT, capture_output=True, text=True, check=True)
    loaded = set(done.stderr.split())
    assert {'numpy', 'mcap'} <= loaded
    strangers = {'rich', 'matplotlib', 'jinja2', 'multiprocessing', 'distributed', 'rclpy', 'numba'}
    assert loaded & strangers == set()
    assert 'aft_stern: 6 events' in done.stdout


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
    width: int, dark: bool, page: Path, tmp_path: Path
) -> None:
    harness = tmp_path / 'harness.html'
    harness.write_text(HARNESS.format(page=page.as_uri(), width=width))
    done = subprocess.run(
        [
            CHROMIUM,
            '--headless',
            '--no-sandbox',
            '--disable-gpu',
            '--hide-scrollbars',
            '--dump-dom',
            '--allow-file-access-from-files',
            f'--user-data-dir={tmp_path / "profile"}',
            f'--blink-settings=preferredColorScheme={int(not dark)}',
            harness.as_uri(),
        ],
        capture_output=True,
        text=True,
        check=True,
        timeout=60,
    )
    (title,) = re.findall(r'<title>(.*?)</title>', done.stdout)
    seen = json.loads(unescape(title))
    assert seen['width'] == width
    # A map and a timeline for each recording, each in one of its two widths.
    assert (seen['shown'], seen['tall']) == (4, True)
    assert seen['back'] == ('rgb(22, 25, 29)' if dark else 'rgb(255, 255, 255)')


def test_two_publishers_and_a_wrong_unit_are_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """60 and 20 rpm in turn, ten a second; the load in kN where N are expected."""
    time, odd = START + np.arange(200) * 10**8, np.arange(200) % 2
    columns = {
        '/shaft/speed': (time, np.where(odd, 20.0, 60.0)),
        '/bearing/aft_stern/load': (time + 1, np.full(200, 1.0)),
    }
    bag = record(tmp_path / 'bag', columns)
    args = ['check', str(bag), '--config', str(CONFIG)]
    assert main([*args, '--json']) == 1
    inputs = json.loads(capsys.readouterr().out)['bearings']['aft_stern']['inputs']
    speed = inputs['speed']
    assert (speed['span'], speed['share']) == ([20.0, 60.0], 1.0)
    rpm = np.pi * 0.1 / 60.0
    assert speed['si_span'] == pytest.approx([20.0 * rpm, 60.0 * rpm])
    assert [fault['fault'] for fault in speed['source_faults']] == ['two_levels']
    assert inputs['load']['source_faults'] == []
    assert main(args) == 1
    out = capsys.readouterr().out
    assert 'speed on /shaft/speed: 1 x values jump between two levels' in out
    assert '(here 20 and 60 rpm)' in out
    assert '20 to 60 in the messages (0.1047 to 0.3142 m/s), 10 a second, 100.0% used' in out
    assert 'question: speed on /shaft/speed has no boundary at any load' in out


def test_one_of_several_bearings_is_checked(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    node = yaml.safe_load(CONFIG.read_text())['/**']['ros__parameters']
    own = node['aft_stern'] | {'stiffness': 2.0e6}
    node |= {'bearings': ['aft_stern', 'fore'], 'aft_stern': own, 'fore': own}
    config = tmp_path / 'two.yaml'
    config.write_text(json.dumps({'/**': {'ros__parameters': node}}))
    line = ['check', str(BAG), '--config', str(config), '--json']
    for more, names in (([], ['aft_stern', 'fore']), (['--bearing', 'fore'], ['fore'])):
        assert main([*line, *more]) == 1
        assert list(json.loads(capsys.readouterr().out)['bearings']) == names


def test_of_many_bearings_the_worst_are_drawn_and_the_others_say_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip('jinja2')
    monkeypatch.setattr(report_page, 'MOST_DRAWN', 1)
    node = yaml.safe_load(CONFIG.read_text())['/**']['ros__parameters']
    own = node.pop('aft_stern') | {'stiffness': 2.0e6}
    # Friction that does not fall: no cycle at any speed.
    level = {**own, 'friction': {**own['friction'], 'static': 0.1}}
    node |= {'bearings': ['fore', 'aft', 'mid'], 'fore': level, 'aft': own, 'mid': level}
    config = tmp_path / 'three.yaml'
    config.write_text(json.dumps({'/**': {'ros__parameters': node}}))
    path = tmp_path / 'three.html'
    assert main(['check', str(BAG), '--config', str(config), '--report', str(path)]) == 1
    sections = re.split(r'<section class="bearing"', path.read_text('utf-8'))[1:]
    assert ['<svg' in section for section in sections] == [False, True, False]
    assert ['Not drawn' in section for section in sections] == [True, False, True]


def test_the_report_says_for_how_long_vibration_was_measured(tmp_path: Path) -> None:
    pytest.importorskip('jinja2')
    arguments = ['check', str(ROOT / 'bags' / 'measured_knock'), '--config']
    arguments.append(str(ROOT / 'launch_configs' / 'measured_bearing.yaml'))
    page = tmp_path / 'out.html'
    assert main([*arguments, '--report', str(page)]) == 1
    said = re.search(r'vibration measured ([\d.]+) s', text_of(page))
    # By the truth of the recording it sticks from 130.1 s to 179.6 s; it rings on a little. In
    # the first five minutes what goes on for 15 s is used.
    assert float(said[1]) == pytest.approx(179.6 - 145.1, abs=6.0)
