# SPDX-License-Identifier: Apache-2.0
"""The page in a real Chromium: what it shows, what can be done on it, and by whom."""

from __future__ import annotations

import csv
import importlib.util
import io
import json
import re
import shutil
import socket
import subprocess
from collections.abc import Callable, Iterator
from itertools import product
from pathlib import Path
from typing import Any

import pytest
from shared import CONFIG, ROOT, until

from benchmarks.signalk_servers import free_port
from stickslip_monitor.cli import main
from stickslip_monitor.monitor.alarm_list import Action
from stickslip_monitor.monitor.alarm_records import ActionRequest
from stickslip_monitor.monitor.alarm_states import AlarmKind

BEARING = 'aft_stern'
TOKEN = 'correct-horse-battery'
ALARM = '[data-alarm="aft_stern/stick_slip"]'
STANDS = 'document.querySelector(".bearing .badge")?.dataset.reason'


@pytest.fixture
def page(dashboard: Any, browser: Any) -> Any:
    """Yield the page of a ship at 60 rpm and 1000 N, without alarm or fault."""
    dashboard.sail(60.0, 1000.0)
    browser.open(dashboard.url)
    browser.until(f'{STANDS} === "normal"')
    yield browser
    assert browser.complaints == []


def point_on_map(page: Any) -> tuple[float, float]:
    """Return the drawn operating point, as parts of the map's width and height."""
    x, y, width, height, left, top = page.js(
        """(() => {
          const [p, f] = ['.point', '.frame'].map((s) => document.querySelector(`.map ${s}`));
          const of = (e, ...names) => names.map((n) => +e.getAttribute(n));
          return [...of(p, 'cx', 'cy'), ...of(f, 'width', 'height', 'x', 'y')];
        })()"""
    )
    return (x - left) / width, 1.0 - (y - top) / height


@pytest.mark.slow
def test_the_point_moves(dashboard: Any, page: Any) -> None:
    page.until('document.querySelector(".map .point")')
    view = dashboard.board.state()['bearings'][0]
    for rpm, load in ((60.0, 1000.0), (45.0, 500.0), (30.0, 250.0)):
        dashboard.sail(rpm, load)
        page.until(f'document.querySelector(".speed").textContent === "{rpm:.1f} rpm"')
        # A journal of 0.1 m: the surface speed is pi d n.
        surface = 3.141592653589793 * 0.1 * rpm / 60.0
        across, up = point_on_map(page)
        assert across == pytest.approx(surface / view['speeds'][1], abs=1e-3)
        assert up == pytest.approx(load / view['loads'][1], abs=1e-3)
    assert page.text('.load') == '250 N'
    assert page.js('document.querySelectorAll(".map .trail").length') > 0
    assert '30.0 rpm, 250 N' in page.js('document.querySelector(".map svg").ariaLabel')
    dashboard.sail(300.0, 1000.0)
    page.until('document.querySelector(".map .off")?.textContent === "beyond the map"')
    assert page.text('.speed') == '300 rpm'


def test_an_alarm_appears_without_reloading_and_is_announced(dashboard: Any, page: Any) -> None:
    assert not page.js(f'!!document.querySelector(`{ALARM}`)')
    dashboard.sail(20.0, 1000.0, 5.0)
    page.until(f'document.querySelector(`{ALARM}`)')
    assert page.text(f'{ALARM} h3') == 'ALARM: Stick-slip predicted'
    assert 'not acknowledged' in page.text(f'{ALARM} .state')
    page.until('document.getElementById("say-now").textContent.startsWith("alarm: Stick-slip")')
    page.until('document.title.startsWith("(1) ")')
    page.until('document.querySelector(".bearing .badge").textContent === "▲ Stick-slip predicted"')
    # One sentence, in its row; one matter, in one row.
    page.until('!document.querySelector(".verdict").checkVisibility()')
    assert page.text('#tally') == '1 not acknowledged'
    # Averaging and the exact cycle both, and what is said is what is shown.
    gauge = page.js('document.querySelectorAll(".gauge")[2].ariaValueText')
    assert re.fullmatch(r'0\.\d\d mm, predicted; by averaging \(KBM\) 0\.53 mm; limit 0\.90 mm', gauge)


def test_acknowledging_without_a_mouse(dashboard: Any, page: Any) -> None:
    # First a caution, then the alarm: acknowledged, it goes below what still waits.
    dashboard.sail(43.0, 1000.0, 5.0)
    dashboard.sail(20.0, 1000.0, 5.0)
    page.until(f'document.querySelector(`{ALARM}`)')
    page.js('localStorage.clear(), document.getElementById("who").value = ""')
    focused = 'document.activeElement.getAttribute("aria-label") ?? document.activeElement.id'
    for _ in range(12):
        page.press('Tab')
        if page.js(focused) == 'Acknowledge: Stick-slip predicted, aft_stern':
            break
    else:
        pytest.fail('the button cannot be reached with the Tab key')
    page.press('Enter')
    # Nobody has said yet who is there.
    page.until('document.getElementById("ask").open')
    page.type('Ada L.')
    page.press('Enter')
    page.until(f'document.querySelector(`{ALARM}`).dataset.state === "acknowledged"')
    assert 'acknowledged by Ada L.' in page.text(f'{ALARM} .state')
    page.until('document.getElementById("say").textContent.startsWith("acknowledge: ")')
    assert 'Ada L.' in page.text('#log tr')
    (request,) = dashboard.ship.requests
    # One row is one matter: all that the bearing has is acknowledged.
    assert (request.by, request.bearing, request.kind) == ('Ada L.', 'aft_stern', None)
    # The button has gone with what it was for; whoever goes on with the keyboard is still there.
    assert page.js(f'document.querySelector(`{ALARM}`).contains(document.activeElement)')
    # The name is asked for once.
    assert page.js('document.getElementById("who").value') == 'Ada L.'
    page.js(f'document.querySelector(`{ALARM} [data-action=shelve]`).focus()')
    page.press('Enter')
    # Why it is put aside is asked for, and logged with the name.
    page.until('document.getElementById("why").open')
    assert page.text('#why-title') == 'Shelve "Stick-slip predicted, aft_stern" for 30 min'
    page.type('new oil')
    page.press('Enter')
    page.until(f'document.querySelector(`#aside-list {ALARM}`)')
    assert (dashboard.ship.requests[-1].by, dashboard.ship.requests[-1].reason) == ('Ada L.', 'new oil')
    assert 'aft_stern/stick_slip: shelve by Ada L.: new oil' in page.text('#log')
    assert page.text('#aside summary') == '1 aside: 1 shelved'
    # The next alarm of the bearing takes its row; the shelved one is aside, and not all clear.
    assert page.text('#hidden-alarms').endswith('still active: Stick-slip predicted, aft_stern')
    assert page.js('document.getElementById("quiet").hidden')


def test_a_lost_input_and_a_silent_monitor_are_shown(dashboard: Any, page: Any) -> None:
    dashboard.do(lambda: dashboard.ship.wait(30.0))
    page.until(f'{STANDS} === "input_stale"')
    assert '✕ lost, 30 s ago' in page.text('[data-input=load]')
    # Nothing more is heard: the heartbeat says so.
    assert page.js('document.getElementById("banner").hidden')
    dashboard.do(lambda: dashboard.ship.fall_silent(3.1))
    page.until('document.body.dataset.link === "silent"')
    assert 'The monitor /stickslip_monitor has been silent for' in page.text('#banner')
    page.until('document.querySelector("[data-input=load]").textContent.includes("last heard")')
    assert ' ago' not in page.text('.inputs')
    assert page.js('document.getElementById("quiet").hidden')
    dashboard.do(dashboard.ship.look)
    page.until('document.body.dataset.link === "live"')
    assert page.js('document.getElementById("banner").hidden')


def test_an_input_that_is_back_says_when_its_alarm_clears(dashboard: Any, page: Any) -> None:
    dashboard.do(lambda: dashboard.ship.wait(30.0))
    row = '[data-alarm="aft_stern/input_lost"]'
    page.until(f'document.querySelector(`{row} h3`)?.textContent === "WARNING: Input lost"')
    dashboard.sail(60.0, 1000.0, 10.0)
    page.until(f'document.querySelector(`{row} h3`).textContent === "Input back"')
    times = re.fullmatch(
        r'back since \d\d:(\d\d):(\d\d), clears \d\d:(\d\d):(\d\d)', page.text(f'{row} .course')
    )
    assert times is not None
    # The off-delay of inputs is a minute.
    since, clears = (60 * int(times[k]) + int(times[k + 1]) for k in (1, 3))
    assert (clears - since) % 3600 == 60
    dashboard.sail(60.0, 1000.0, 120.0)
    page.until(f'document.querySelector(`{row} .state`).textContent.includes("cleared, not ackn")')


def test_the_page_reconnects_after_the_server_restarts(dashboards: Callable[..., Any], browser: Any) -> None:
    first = dashboards()
    first.sail(60.0, 1000.0)
    browser.open(first.url)
    browser.until(f'{STANDS} === "normal"')
    assert browser.complaints == []
    first.stop()
    browser.until('document.body.dataset.link === "lost"')
    assert 'connection to the dashboard is lost' in browser.text('#say-now')
    second = dashboards(port=first.port)
    second.sail(20.0, 1000.0, 5.0)
    browser.until(f'{STANDS} === "stick_slip"')
    browser.until('document.body.dataset.link === "live"')
    assert browser.js(f'document.querySelector(`{ALARM}`).dataset.state') == 'unacknowledged'
    # The browser itself notes that nobody was there; the page has nothing to complain of.
    complaints = [text for text in browser.complaints if 'net::ERR_' not in text]
    assert complaints == []


def test_the_page_reconnects_after_a_refusal(
    dashboard: Any, browser: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    # A browser by itself tries again after a broken connection, but not after a refusal.
    dashboard.sail(60.0, 1000.0)
    with monkeypatch.context() as crowded:
        crowded.setattr('stickslip_monitor.dashboard.server.MAX_READERS', 0)
        browser.open(dashboard.url)
        browser.until('document.body.dataset.link === "lost"')
    browser.until(f'{STANDS} === "normal"')


def test_a_token_is_requested_once(dashboards: Callable[..., Any], browser: Any) -> None:
    locked = dashboards(token=TOKEN)
    locked.sail(60.0, 1000.0)
    browser.open(locked.url)
    browser.until('location.pathname === "/login" && document.activeElement.name === "token"')
    browser.type('a wrong one, and a long one')
    browser.press('Enter')
    browser.until('location.search === "?wrong" && document.activeElement.name === "token"')
    browser.type(TOKEN)
    browser.press('Enter')
    browser.until(f'{STANDS} === "normal"')
    assert browser.js('document.cookie') == ''
    assert browser.complaints == []


def is_listening(port: int) -> bool:
    with socket.socket() as probe:
        return probe.connect_ex(('127.0.0.1', port)) == 0


@pytest.fixture
def nginx(dashboards: Callable[..., Any], tmp_path: Path) -> Iterator[tuple[Any, str]]:
    """Yield a locked dashboard, and its address behind nginx as the docs have it."""
    program = shutil.which('nginx') or pytest.skip('nginx is not installed')
    locked, port = dashboards(token=TOKEN), free_port()
    (block,) = re.findall('```nginx\n(.*?)```', (ROOT / 'docs/dashboard.md').read_text(), re.DOTALL)
    block = block.replace('127.0.0.1:8370', f'127.0.0.1:{locked.port}')
    kinds = ('client_body', 'proxy', 'fastcgi', 'uwsgi', 'scgi')
    folders = ''.join(f'{kind}_temp_path {tmp_path}/{kind};' for kind in kinds)
    (tmp_path / 'nginx.conf').write_text(
        f'daemon off; pid {tmp_path}/pid; error_log {tmp_path}/log; events {{}}'
        f' http {{ access_log off; {folders} server {{ listen 127.0.0.1:{port}; {block} }} }}'
    )
    server = subprocess.Popen([program, '-p', str(tmp_path), '-c', str(tmp_path / 'nginx.conf')])
    until(lambda: is_listening(port), 'nginx listens')
    yield locked, f'http://127.0.0.1:{port}/bearing/'
    server.terminate()
    server.wait()


@pytest.mark.slow
def test_the_page_works_behind_nginx_below_a_path(nginx: tuple[Any, str], browser: Any) -> None:
    """Signed in, with all its files, its history, events at once and an action."""
    locked, root = nginx
    locked.sail(20.0, 1000.0, 5.0)
    browser.open(root)
    browser.until('location.pathname === "/bearing/login" && document.activeElement.name === "token"')
    browser.type(TOKEN)
    browser.press('Enter')
    browser.until(f'{STANDS} === "stick_slip"')
    resources = 'performance.getEntriesByType("resource").map((entry) => entry.name)'
    browser.until(f'{resources}.some((name) => name.includes("history?"))')
    assert all(name.startswith(root) for name in browser.js(resources))
    browser.js('document.getElementById("who").value = "Ada"')
    browser.js(f'document.querySelector(`{ALARM} [data-action=acknowledge]`).click()')
    browser.until(f'document.querySelector(`{ALARM}`).dataset.state === "acknowledged"')
    assert browser.complaints == []


def newest_record(dashboard: Any, **changes: Any) -> dict[str, Any]:
    """Return the newest record of the bearing as its monitor sends it."""
    from stickslip_monitor.monitor.bearing_records import bearing_record

    (state,) = dashboard.ship.session.states([BEARING], dashboard.ship.now)
    return bearing_record(state) | changes


HOSTILE = '<img src=x onerror=alert(1)><script>alert(2)</script>"\'&amp;'


def test_hostile_texts_stay_text(dashboard: Any, page: Any) -> None:
    dashboard.sail(20.0, 1000.0, 5.0)

    def poison() -> None:
        ship = dashboard.ship
        for causes in ship.session.annunciator.causes.values():
            causes.texts = dict.fromkeys(AlarmKind, HOSTILE)
        ship.tick()  # the alarms take over the texts of their causes
        record = newest_record(dashboard)
        inputs = {'speed': record['inputs']['speed'] | {'fault': HOSTILE}}
        ship.watched.take_record(
            record | {'text': HOSTILE, 'reason': HOSTILE, 'regime': HOSTILE, 'inputs': inputs}
        )
        ship.act(ActionRequest(Action.ACKNOWLEDGE, HOSTILE))
        ship.act(ActionRequest(Action.REMOVE, HOSTILE))

    dashboard.do(poison)
    page.until(f'document.querySelector(`#aside-list {ALARM}`)')
    assert page.text(f'#aside-list {ALARM} .text') == HOSTILE
    page.until(f'document.querySelector(".badge").textContent === {json.dumps(HOSTILE)}')
    assert page.text('.verdict') == HOSTILE
    assert HOSTILE in page.text('#log')
    assert page.js('document.querySelectorAll("main img, main script").length') == 0


PLANES = """[...document.querySelectorAll('.badge, #banner, .map path, .gauge rect, .shape .fill')]
  .filter((e) => e.checkVisibility())
  .flatMap((e) => { const s = getComputedStyle(e); return [s.backgroundColor, s.fill]; })
  .filter((c) => c.startsWith('rgb')).map((c) => c.match(/[\\d.]+/g).map(Number))
  .filter((c) => c.length < 4 || c[3] > 0)"""


def test_nothing_but_red_at_night(dashboard: Any, page: Any) -> None:
    """Dark-adapted eyes: no colour of the page has more green or blue than half of its red."""
    dashboard.sail(20.0, 1000.0, 5.0)
    page.until(f'document.querySelector(`{ALARM}`)')
    page.choose('theme', 'night')
    colours = page.js(
        """[...new Set([...document.querySelectorAll('body, body *')].flatMap((e) => {
          const s = getComputedStyle(e);
          return [s.color, s.backgroundColor, s.fill, s.stroke, s.borderTopColor];
        }))].filter((c) => c.startsWith('rgb')).map((c) => c.match(/[\\d.]+/g).map(Number))
           .filter((c) => c.length < 4 || c[3] > 0)"""
    )
    assert len(colours) > 5
    assert [c for c in colours if max(c[1:3]) > 0.62 * c[0]] == []
    # Outlines and no bright planes: the point on the map and the needles are what is looked for.
    bright = [c for c in page.js(PLANES) if max(c[:3]) > 60]
    point = page.js('getComputedStyle(document.querySelector(".map .point")).fill')
    assert {f'rgb({c[0]:.0f}, {c[1]:.0f}, {c[2]:.0f})' for c in bright} <= {point}
    assert page.js('getComputedStyle(document.querySelector(".map .area-fold")).stroke') != 'none'


@pytest.mark.parametrize('width', [320, 390, 1280])
def test_nothing_is_wider_than_the_screen(dashboard: Any, page: Any, width: int) -> None:
    page.show_as(width, 800, mobile=width < 500)
    dashboard.sail(20.0, 1000.0, 5.0)
    page.until(f'document.querySelector(`{ALARM}`)')
    assert page.js('document.documentElement.scrollWidth') <= width
    # A finger needs 44 pixels (WCAG 2.1, 2.5.5).
    low = page.js(
        f'Math.min(...[...document.querySelectorAll(`{ALARM} button:not([hidden])`)]'
        '.map((b) => b.getBoundingClientRect().height))'
    )
    assert low >= 44
    # What it says has the whole width of a phone.
    wide = '.getBoundingClientRect().width'
    item = f'document.querySelector(`{ALARM}`)'
    part = page.js(f'{item}.querySelector(".text"){wide} / {item}{wide}')
    assert width > 500 or part > 0.8


def test_a_failed_action_is_shown_until_it_is_seen(
    dashboard: Any, page: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr('stickslip_monitor.dashboard.server.ACTION_TIMEOUT', 0.1)
    dashboard.sail(20.0, 1000.0, 5.0)
    dashboard.ship.deaf = True
    page.until(f'document.querySelector(`{ALARM}`)')
    page.js('document.getElementById("who").value = "Ada"')
    page.js(f'document.querySelector(`{ALARM} [data-action=acknowledge]`).click()')
    page.until('document.getElementById("answer").classList.contains("failed")')
    assert page.text('#answer').startswith('Not done: no answer from the monitor')
    assert page.text('#say-now') == page.text('#answer')
    page.js('document.getElementById("answer").click()')
    assert page.js('document.getElementById("answer").hidden')
    page.forget()  # Chromium notes the refusal


def test_the_page_claims_no_alarm_only_when_it_is_known(dashboard: Any, browser: Any) -> None:
    dashboard.do(lambda: setattr(dashboard.ship.watched, 'alarms', None))
    dashboard.do(dashboard.ship.look)
    browser.open(dashboard.url)
    words = 'No list of alarms from /stickslip_monitor yet'
    browser.until(f'document.getElementById("banner").textContent.includes("{words}")')
    assert browser.js('document.getElementById("quiet").hidden')
    assert browser.js('document.getElementById("unsure").checkVisibility()')


@pytest.mark.slow
def test_eight_tabs_share_one_stream(dashboard: Any, page: Any) -> None:
    # A browser opens six connections to a server: with a stream each, the seventh tab hangs.
    tabs = [page.call('Target.createTarget', url=dashboard.url)['targetId'] for _ in range(7)]
    page.until('document.querySelector(".bearing")')
    try:
        dashboard.sail(20.0, 1000.0, 5.0)

        def titles() -> list[str]:
            targets = page.call('Target.getTargets')['targetInfos']
            return [t['title'] for t in targets if t['url'] == dashboard.url]

        def all_know() -> bool:
            return ['(1) ' in t for t in titles()] == [True] * 8

        page.until('document.title.includes("(1) ")')
        until(all_know, 'all tabs')
        until(lambda: len(dashboard.server.hub.readers) == 1, 'the end of the others')
        # One that cannot be reached for a moment is there for actions, too.
        assert page.js('fetch("/page.css").then((answer) => answer.status)') == 200
    finally:
        for tab in tabs:
            page.call('Target.closeTarget', targetId=tab)


def test_the_log_is_saved_and_shown_in_the_chosen_time_zone(dashboard: Any, page: Any) -> None:
    page.call('Emulation.setTimezoneOverride', timezoneId='Asia/Kolkata')
    dashboard.sail(20.0, 1000.0, 5.0)
    dashboard.do(
        lambda: dashboard.ship.act(
            ActionRequest(Action.ACKNOWLEDGE, '=1+1', 'aft_stern', AlarmKind.STICK_SLIP)
        )
    )
    page.until('document.querySelector("#log tr").textContent.includes("=1+1")')
    first = 'document.querySelector("#log td").textContent'
    utc = page.js(first)
    page.choose('local', 'local')

    def seconds(text: str) -> int:
        hours, minutes, remainder = (int(part) for part in text[-8:].split(':'))
        return 3600 * hours + 60 * minutes + remainder

    assert (seconds(page.js(first)) - seconds(utc)) % 86400 == 19800
    assert page.text('#zone') == 'Time (local)'
    saved = page.js('fetch(document.getElementById("csv").href).then((answer) => answer.text())')
    rows = list(csv.reader(io.StringIO(saved)))
    assert rows[0][:4] == ['time', 'node', 'bearing', 'alarm']
    assert [row[5] for row in rows[-2:]] == ['raise', 'acknowledge']
    # Nothing that a spreadsheet would compute.
    assert rows[-1][8] == "'=1+1"
    page.call('Emulation.setTimezoneOverride', timezoneId='')
    page.js('localStorage.clear()')


class Player:
    """Notes what is asked of a replay."""

    def __init__(self) -> None:
        self.requests: list[Any] = []

    def set_paused(self, paused: bool) -> None:
        self.requests.append(paused)

    def seek(self, seconds: float) -> None:
        self.requests.append(seconds)


def test_a_replay_is_led_with_the_keyboard(dashboards: Callable[..., Any], browser: Any) -> None:
    player = Player()
    dashboard = dashboards(player=player)
    dashboard.sail(60.0, 1000.0)
    place = {'at': 65.0, 'length': 200.0, 'paused': False}
    dashboard.do(lambda: dashboard.board.show_place(place))
    browser.open(dashboard.url)
    browser.until('!document.getElementById("replay").hidden')
    assert browser.text('#replay-time') == '1:05 of 3:20'
    focused = 'document.activeElement.id'
    for _ in range(12):
        browser.press('Tab')
        if browser.js(focused) == 'hold':
            break
    assert browser.text('#hold') == 'Pause'
    browser.press(' ')
    until(lambda: player.requests == [True], 'the pause')
    dashboard.do(lambda: dashboard.board.show_place(place | {'paused': True}))
    browser.until('document.getElementById("hold").textContent === "Play"')
    browser.press(' ')
    until(lambda: player.requests[1:] == [False], 'its end')
    browser.press('Tab', ' ')
    until(lambda: player.requests[2:] == [False, 0.0], 'the start')
    browser.press('Tab')
    assert browser.js(focused) == 'place'
    browser.press('ArrowLeft')
    # A key moves it by a two hundredth of the recording.
    until(lambda: player.requests[4:] == [64.0], 'the place')
    browser.press('Home')
    until(lambda: player.requests[5:] == [0.0], 'the beginning')
    assert browser.complaints == []


def axe_complaints(browser: Any) -> Any:
    """Return the violations that axe-core finds on the page."""
    axe = importlib.util.find_spec('axe_core_python')
    if axe is None or axe.origin is None:
        pytest.skip("the extra 'test' is not installed")
    script = Path(axe.origin).with_name('axe.min.js').read_text('utf-8')
    browser.js(f'globalThis.axe ?? (() => {{ {script} }})(); 0')
    violation = 'v.id + ": " + v.nodes.map((n) => n.html + n.failureSummary).join(" | ")'
    return browser.js(f'axe.run(document).then((r) => r.violations.map((v) => {violation}))')


@pytest.mark.parametrize(
    'theme', ['day', *(pytest.param(name, marks=pytest.mark.slow) for name in ('dusk', 'night'))]
)
def test_axe_finds_nothing(dashboards: Callable[..., Any], browser: Any, theme: str) -> None:
    """Check view after view by the rules of axe-core for WCAG 2.1 AA and good practice."""
    dashboard = dashboards(player=Player())
    browser.open(dashboard.url)
    browser.until('document.querySelector(".bearing")')
    browser.choose('theme', theme)
    ship = dashboard.ship
    views = {
        'nothing heard': lambda: None,
        'an alarm': lambda: ship.sail(20.0, 1000.0, 5.0),
        'put aside, in a replay': lambda: (
            ship.act(ActionRequest(Action.SHELVE, 'Ada', 'aft_stern', AlarmKind.STICK_SLIP)),
            dashboard.board.show_place({'at': 1.0, 'length': 9.0, 'paused': True}),
        ),
        'gone, and a fault of the node': lambda: (
            ship.sail(60.0, 1000.0, 40.0),
            ship.watched.take_health(2, 'it is not well'),
            ship.look(),
        ),
        'an input lost': lambda: ship.wait(30.0),
    }
    for view, happens in views.items():
        dashboard.do(happens)
        record = ship.watched.bearings['aft_stern'].record
        if record is not None:
            reason = record['reason']
            browser.until(f'{STANDS} === "{reason}"')
        assert (view, axe_complaints(browser)) == (view, [])
    for dialog in ('ask', 'why'):
        browser.js(f'document.getElementById("{dialog}").showModal()')
        assert (dialog, axe_complaints(browser)) == (dialog, [])
        browser.js(f'document.getElementById("{dialog}").close()')
    browser.choose('theme', 'auto')


def test_axe_finds_nothing_at_the_door(dashboards: Callable[..., Any], browser: Any) -> None:
    locked = dashboards(token=TOKEN)
    browser.show_as(390, 800, dark=True)
    browser.open(f'{locked.url}login')
    browser.until('document.activeElement.name === "token"')
    assert axe_complaints(browser) == []


@pytest.mark.slow
def test_axe_finds_nothing_in_a_report_by_day_and_night_on_a_desk_and_a_phone(
    browser: Any, tmp_path: Path
) -> None:
    path = tmp_path / 'report.html'
    main(['check', str(ROOT / 'bags/coast_down'), '-c', str(CONFIG), '--report', str(path)])
    # Its own policy lets no script in: not even that of axe.
    browser.call('Page.setBypassCSP', enabled=True)
    try:
        for width, dark in product((1100, 360), (False, True)):
            browser.show_as(width, 800, dark=dark, mobile=width < 500)
            browser.open(path.as_uri())
            browser.until('document.querySelector("footer")')
            assert browser.js('document.documentElement.scrollWidth') <= width
            assert (width, dark, axe_complaints(browser)) == (width, dark, [])
    finally:
        browser.call('Page.setBypassCSP', enabled=False)


def test_the_page_shows_all_parts_of_a_record(dashboard: Any, page: Any) -> None:
    """Show probabilities, holding, faults of inputs and node, and the measured vibration."""
    dashboard.sail(43.0, 1000.0, 5.0)
    newest = newest_record(dashboard)
    inputs = newest['inputs'] | {
        'speed': {'lost': True, 'age': 9.2, 'rate': None, 'fault': 'no publisher', 'counts': {}},
        'load': {'lost': False, 'age': 0.21, 'rate': 4.98, 'fault': '', 'counts': {'repeated': 3}},
        'level': {'lost': False, 'age': None, 'rate': None, 'fault': '', 'counts': {}},
    }
    record = newest | {
        'reason': 'caution',
        'held_until': newest['time'] + 150 * 10**9,
        'inputs': inputs,
        'probability_can': 0.9,
        'probability_will': 0.25,
        'probability_runs': 0.1,
        'measured': 'unknown',
        'unmeasured': 'the level is stuck',
    }
    watched = dashboard.ship.watched
    dashboard.do(lambda: (watched.take_health(2, 'no space left on device'), watched.take_record(record)))
    page.until('document.querySelector(".badge.held")')
    assert page.text('.badge') == '! Margin low, held until 22:15:56'
    assert page.text('.chances') == 'stick-slip: can happen 90 %, starts by itself 25 %, runs 10 %'
    assert page.text('.measured') == 'vibration measured: unknown (the level is stuck)'
    assert page.text('#notices') == '/stickslip_monitor: no space left on device'
    cells = '[...document.querySelectorAll(".inputs tr")].map((r) => r.innerText.trim())'
    speed, load, level = (' '.join(text.split()) for text in page.js(cells))
    assert speed == 'speed /shaft/speed no publisher ✕ lost, 9.2 s ago'
    assert load == 'load /bearing/aft_stern/load ✓ 5 Hz, 0.2 s ago refused: 3 repeated'
    assert level == 'level no valid value yet'
    # A journal of 0.1 m: n = 60 v / (pi d).
    rpm = [60.0 * newest[f'{name}_speed'] / (3.141592653589793 * 0.1) for name in ('fold', 'hopf')]
    assert page.text('.boundaries') == f'fold {rpm[0]:.1f} rpm, Hopf {rpm[1]:.1f} rpm'


LEGEND = '[...document.querySelectorAll(".charts .u-legend")].map((e) => e.innerText)'


def test_ten_minutes_are_drawn_and_can_be_looked_at(dashboard: Any, page: Any) -> None:
    dashboard.sail(60.0, 1000.0, 300.0)
    for k in range(100):
        dashboard.sail(60.0 - k / 5.0, 1000.0)
    page.open(page.js('location.href'))
    figure = 'document.querySelector(".charts figure")'
    hidden = '[...document.querySelectorAll(".charts figure")].map((f) => f.hidden).join()'
    page.until(f'{figure}.ariaLabel.includes("to 60.0 rpm")')
    page.until(f'{hidden} === "false,false,false,true"')
    # Without a pointer the newest value is told, and the boundary beside it.
    newest = 'time22:20:01—speed40.2--fold40.7'
    page.until(f'{LEGEND}[0].replace(/\\s+/g, "").startsWith("{newest}")')
    x, y, width, height = page.js(
        f'(() => {{ const e = {figure}.querySelector(".u-over"); e.scrollIntoView();'
        ' const b = e.getBoundingClientRect();'
        ' return [b.x, b.y, b.width, b.height]; })()'
    )

    def mouse(kind: str, share: float) -> None:
        place = {'x': x + share * width, 'y': y + 0.5 * height, 'button': 'left', 'clickCount': 1}
        page.call('Input.dispatchMouseEvent', type=kind, **place)

    # The newest second is at the right edge: a tenth of ten minutes before it, at the pointer.
    mouse('mouseMoved', 0.9)
    page.until(f'{LEGEND}[0].includes("22:19:0")')
    assert '52.' in page.js(LEGEND)[0]
    mouse('mousePressed', 0.8)
    mouse('mouseMoved', 0.9)
    mouse('mouseReleased', 0.9)
    page.until('document.querySelector(".charts.zoomed")')
    page.js('document.querySelector(".charts select").dispatchEvent(new Event("change"))')
    page.until('!document.querySelector(".charts.zoomed")')


def test_each_priority_has_its_tone_and_so_has_silence(dashboard: Any, page: Any) -> None:
    dashboard.sail(20.0, 1000.0, 5.0)
    page.until(f'document.querySelector(`{ALARM}`)')
    tone = 'document.getElementById("sound").dataset.tone'
    assert page.js('document.getElementById("sound").value') == 'off'
    assert page.js(tone) is None
    page.choose('sound', 'on')
    page.until(f'{tone} === "alarm"')
    dashboard.do(lambda: dashboard.ship.fall_silent(4.0))
    page.until(f'{tone} === "dead"')
    page.forget()  # Chromium wants a touch first


WATCHED_SOUND = """{
  window.made = [];
  const Real = AudioContext;
  window.AudioContext = class extends Real { constructor() { super(); made.push(this); } };
}"""
SOUND, MENU = 'document.getElementById("sound")', 'document.getElementById("menu")'


def click_page(page: Any) -> None:
    """Press and release the mouse on the page."""
    for kind in ('mousePressed', 'mouseReleased'):
        page.call('Input.dispatchMouseEvent', type=kind, x=3, y=3, button='left', clickCount=1)


def test_sound_that_is_taken_away_says_so_and_comes_back_at_a_touch(dashboard: Any, page: Any) -> None:
    """Try a sound before any touch, suspended, blocked for good, and with a clock that stands."""
    page.js(WATCHED_SOUND)
    dashboard.sail(20.0, 1000.0, 5.0)
    page.until(f'document.querySelector(`{ALARM}`)')
    page.choose('sound', 'on')
    page.until(f'{SOUND}.value === "mute"')
    assert page.text('#menu') == page.js(f'{SOUND}.selectedOptions[0].text') == 'no sound: touch the page'
    click_page(page)
    page.until(f'{SOUND}.value === "on" && made.at(-1).state === "running"')
    assert page.text('#menu') == 'Settings'
    # Taken away where it can be had again: it is asked for, and nobody need touch anything.
    page.js('made.at(-1).suspend()')
    page.until('made.at(-1).state === "running"')
    page.until(f'{SOUND}.value === "on"')
    # Interrupted, as by the lock of a tablet, so that it does not come back when it is asked for.
    page.js('{ const own = made.at(-1); own.resume = () => new Promise(() => {}); own.suspend(); }')
    page.until(f'{SOUND}.value === "mute"')
    page.until('document.getElementById("say-now").textContent === "no sound: touch the page"')
    click_page(page)
    page.until(f'{SOUND}.value === "on" && made.at(-1).state === "running"')
    # One that says that it runs, and whose clock stands.
    page.js('Object.defineProperty(made.at(-1), "currentTime", { value: 7 }), 1')
    page.until(f'{SOUND}.value === "mute"')
    context_count = page.js('made.length')
    click_page(page)
    page.until(f'{SOUND}.value === "on"')
    assert page.js('made.length') > context_count
    assert page.js('made.filter((each) => each.state === "running").length') == 1
    # Switched off, nothing is asked for any more.
    page.choose('sound', 'off')
    page.until('made.every((each) => each.state === "closed")')
    click_page(page)
    assert page.js(f'{SOUND}.value') == 'off'
    page.forget()  # Chromium wants a touch first


def watched_beside(dashboard: Any, *bearings: dict[str, Any], rows: list[dict[str, Any]]) -> None:
    """Show more bearings, each as a change of the record of the first, and rows of alarms."""
    from stickslip_monitor.dashboard.seen_monitors import Watched

    watched = dashboard.ship.watched
    first = watched.bearings[BEARING]

    def grow() -> None:
        for record in bearings:
            added = watched.bearings[record['bearing']] = Watched(record['bearing'], first.view)
            added.take(first.record | record, first.at)
        watched.alarms = watched.alarms | {'alarms': [], 'rows': rows, 'unacknowledged': len(rows)}

    dashboard.do(grow)


@pytest.fixture
def fleet(dashboard: Any, browser: Any) -> Any:
    """Return the page of 25 bearings on one shaft, whose speed is lost at 22; one is in stick-slip."""
    dashboard.sail(20.0, 1000.0, 5.0)
    (alarm,) = [a for a in dashboard.ship.watched.alarms['alarms'] if a['alarm'] == 'stick_slip']
    lost = alarm | {'alarm': 'input_lost', 'priority': 'warning', 'state': 'unacknowledged'}
    lost |= {'actions': ['acknowledge'], 'kinds': []}
    rows = [alarm | {'state': 'acknowledged', 'priority': 'caution', 'kinds': []}]
    names = [f'b{k:02}' for k in range(24)]
    rows += [lost | {'bearing': n, 'text': f'{n}: no sample for {n[-1]} s'} for n in names[:22]]
    reasons = ['input_stale'] * 22 + ['normal'] * 2
    records = ({'bearing': n, 'reason': r, 'fold_margin': 0.9} for n, r in zip(names, reasons, strict=True))
    watched_beside(dashboard, *records, rows=rows)
    browser.show_as(1280, 800)
    browser.open(dashboard.url)
    browser.until('document.querySelectorAll("#rows tr").length === 25')
    return browser


def test_twenty_five_bearings_at_a_glance(dashboard: Any, fleet: Any) -> None:
    names = '[...document.querySelectorAll("#rows tr:not([hidden]) button")].map((b) => b.textContent)'
    assert fleet.js(names)[0] == BEARING
    assert fleet.js(names)[-2:] == ['b22', 'b23']
    assert fleet.text('#counts') == '25: 1 stick-slip, 22 input lost, 2 normal'
    assert axe_complaints(fleet) == []
    # All of them are on the screen.
    bottom = '(row) => row.getBoundingClientRect().bottom'
    assert max(fleet.js(f'[...document.querySelectorAll("#rows tr")].map({bottom})')) <= 800
    # Only the one that is looked at is drawn.
    drawn = (
        '[...document.querySelectorAll(".bearing")].filter((b) => !b.hidden).map((b) => b.dataset.bearing)'
    )
    assert fleet.js(drawn) == [BEARING]
    fleet.js('document.querySelector("#rows [data-name=b23]").click()')
    assert fleet.js(drawn) == ['b23']
    fleet.js('document.getElementById("only").click()')
    assert len(fleet.js(names)) == 23
    fleet.js(
        '(() => { const f = document.getElementById("find"); f.value = "B2";'
        ' f.dispatchEvent(new Event("input")); })()'
    )
    assert fleet.js(names) == ['b20', 'b21']
    # The last word of one that is not heard was normal: it does not stay so in the table.
    dashboard.do(lambda: setattr(dashboard.ship.watched.bearings['b23'], 'at', 0.0))
    row = 'document.querySelector("#rows tr").innerText.replace(/\\s+/g, " ")'
    fleet.until(f'{row}.startsWith("b23 ✕ no data")')
    assert fleet.js('document.title').startswith('✕ ')
    # One lost speed is one entry, above what is acknowledged.
    entries = fleet.js(
        '[...document.querySelectorAll("#alarm-list > li")].map((li) =>'
        ' [li.querySelector("h3").textContent, li.querySelector(".state").textContent])'
    )
    assert [title for title, _ in entries] == ['WARNING: Input lost', 'CAUTION: Stick-slip predicted']
    assert entries[0][1].startswith('22 bearings, not acknowledged')
    assert fleet.text('#alarm-list .places').startswith('b00, b01, b02')


def test_bearings_of_one_shaft_are_one_row(dashboard: Any, browser: Any) -> None:
    dashboard.sail(20.0, 1000.0, 5.0)
    (alarm,) = dashboard.ship.watched.alarms['rows']
    records = [
        {'bearing': f'{side}/b{k:02}', 'text': f'Stick-slip predicted. Raise speed above {base + k} rpm.'}
        for side, base in (('port', 60), ('stbd', 30))
        for k in range(25)
    ]
    watched_beside(dashboard, *records, rows=[alarm | record for record in records])
    browser.open(dashboard.url)
    browser.until('document.querySelectorAll("#alarm-list > li").length === 2')
    texts = '[...document.querySelectorAll("#alarm-list .text")].map((e) => e.textContent)'
    # The highest of the speeds of its bearings.
    assert sorted(browser.js(texts)) == [
        '25 bearings of /port: raise speed above 84 rpm',
        '25 bearings of /stbd: raise speed above 54 rpm',
    ]
    assert browser.text('#tally') == '2 not acknowledged'
    height = 'document.querySelector("#alarm-list > li").getBoundingClientRect().height'
    assert browser.js(height) < 200
    # What is chosen among fifty is close to the list.
    assert browser.js('document.querySelector(".bearing").getBoundingClientRect().top') < 900


def test_on_a_phone_the_alarm_is_first_and_bearings_have_a_line_each(dashboard: Any, browser: Any) -> None:
    dashboard.sail(20.0, 1000.0, 5.0)
    names = ['fore_stern', 'intermediate', 'bulkhead']
    rows = dashboard.ship.watched.alarms['rows']
    watched_beside(dashboard, *({'bearing': name, 'reason': 'normal'} for name in names), rows=rows)
    browser.show_as(390, 844, mobile=True)
    browser.open(dashboard.url)
    browser.until('document.querySelectorAll("#rows tr").length === 4')
    browser.until(f'document.querySelector(`{ALARM}`)')
    # The alarm with all that can be done about it is on the first screen; what can be set is behind a button.
    assert browser.js(f'document.querySelector(`{ALARM} .buttons`).getBoundingClientRect().bottom') < 422
    visible = '[...document.querySelectorAll("#tools label")].filter((e) => e.checkVisibility()).length'
    assert browser.js(visible) == 0
    browser.click('#menu')
    assert browser.js(visible) == 4
    assert browser.js(f'{MENU}.ariaExpanded') == 'true'
    browser.click('#menu')
    full = '[...document.querySelectorAll("#bearings .bearing")].filter((e) => !e.hidden).length'
    assert browser.js(full) == 0
    assert browser.js('document.documentElement.scrollHeight') < 2000
    browser.click('#rows [data-name=intermediate]')
    browser.until(f'{full} === 1')
    browser.until('document.querySelector("[data-bearing=intermediate]").getBoundingClientRect().top < 50')
    browser.click('#rows [data-name=intermediate]')
    browser.until(f'{full} === 0')
    # What happened is stacked: nothing of it has to be scrolled to the side.
    assert browser.js('document.querySelectorAll("#log tr").length') > 0
    scroll = 'document.querySelector("#events .scroll")'
    assert browser.js(f'{scroll}.scrollWidth - {scroll}.clientWidth') == 0
    # Turned over, or on a desk, all four are shown in full.
    browser.show_as(1280, 900)
    browser.until(f'{full} === 4')
    assert browser.js('document.getElementById("overview").hidden')
    assert browser.complaints == []


def test_one_lost_input_is_one_line_with_all_its_bearings(dashboard: Any, page: Any) -> None:
    # The notes of the node, and an alarm for each of four bearings, all tell of one speed.
    names = [BEARING, 'fore_stern', 'intermediate', 'bulkhead']
    watched_beside(dashboard, *({'bearing': name} for name in names[1:]), rows=[])
    words = 'No messages on /shaft/speed.'
    node_notes = [
        {'node': '/m', 'time': 1_000, 'what': 'input', 'text': f'{name}: {words}'} for name in names
    ]
    lost = [
        {
            'node': '/m',
            'time': 3_000 + k,
            'what': 'raise',
            'bearing': name,
            'alarm': 'input_lost',
            'by': 'monitor',
        }
        | {'text': f'{name}: Input speed lost: no valid value on /shaft/speed for {5 + k} s. {words}'}
        for k, name in enumerate(names)
    ]
    row_count = page.js('document.querySelectorAll("#log tr").length')
    dashboard.do(lambda: dashboard.board.log.extend([*node_notes, *lost]))
    page.open(dashboard.url)
    page.until(f'document.querySelectorAll("#log tr").length === {row_count + 1}')
    row = page.text('#log tr')
    assert all(name in row for name in names)
    assert row.count('Input speed lost') == 1


def test_times_are_written_for_people(page: Any) -> None:
    seconds = (0.4, 9.94, 30.0, 119.0, 150.0, 7_200.0, 172_800.0, 2.96e8)
    texts = page.js(f'import("./dom.js").then(({{ about }}) => {list(seconds)}.map(about))')
    assert texts == ['0.4 s', '9.9 s', '30 s', '119 s', '2.5 min', '2.0 h', '2 days', '9.4 years']


def test_the_last_time_of_a_chart_is_whole(dashboard: Any, page: Any) -> None:
    """Half of a time, of eight letters of 12 px, fits between the end of the axis and the canvas."""
    page.until('document.querySelector(".charts .u-over")?.offsetWidth')
    margin = page.js(
        '(() => { const [over, plot] = [".charts .u-over", ".charts .uplot"]'
        '.map((s) => document.querySelector(s).getBoundingClientRect()); return plot.right - over.right; })()'
    )
    half = page.js(
        '(() => { const pen = document.createElement("canvas").getContext("2d");'
        ' pen.font = "12px system-ui, DejaVu Sans, sans-serif";'
        ' return pen.measureText("22:22:22").width / 2; })()'
    )
    assert margin >= half > 20.0


def test_paper_has_badges_and_no_buttons(dashboard: Any, page: Any) -> None:
    dashboard.sail(20.0, 1000.0, 5.0)
    page.until(f'document.querySelector(`{ALARM}`)')
    page.call('Emulation.setEmulatedMedia', media='print')
    visible = '[...document.querySelectorAll("{}")].filter((e) => e.checkVisibility()).length'
    assert page.js(visible.format('button, #tools')) == 0
    assert page.js(visible.format('.badge, h2')) > 3
    exact = 'getComputedStyle(document.querySelector(".badge")).printColorAdjust'
    assert page.js(exact) == 'exact'
    page.call('Emulation.setEmulatedMedia', media='')
