# SPDX-License-Identifier: Apache-2.0
"""The page in a real Chromium: what it shows, what can be done on it, and by whom."""

from __future__ import annotations

import csv
import importlib.util
import io
import itertools
import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from stickslip_monitor.monitor.alarms.annunciator import Action
from stickslip_monitor.monitor.alarms.causes import AlarmKind
from stickslip_monitor.monitor.alarms.requests import ActionRequest

ALARM = '[data-alarm="aft_stern/stick_slip"]'
STANDS = 'document.querySelector(".bearing .badge")?.dataset.reason'


@pytest.fixture
def page(dashboard: Any, browser: Any) -> Any:
    """The page of a ship at 60 rpm and 1000 N, where nothing is wrong."""
    dashboard.sail(60.0, 1000.0)
    browser.open(dashboard.url)
    browser.until(f'{STANDS} === "normal"')
    yield browser
    assert browser.complaints == []


def place(page: Any) -> tuple[float, float]:
    """Where the operating point is drawn, as parts of the map's width and height."""
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
        across, up = place(page)
        assert across == pytest.approx(surface / view['speeds'][1], abs=1e-3)
        assert up == pytest.approx(load / view['loads'][1], abs=1e-3)
    assert page.text('.load') == '250 N'
    assert page.js('document.querySelectorAll(".map .trail").length') > 0
    assert '30.0 rpm, 250 N' in page.js('document.querySelector(".map svg").ariaLabel')


def test_a_point_beyond_the_map_is_shown_at_its_edge(dashboard: Any, page: Any) -> None:
    dashboard.sail(300.0, 1000.0)
    page.until('document.querySelector(".map .off")?.textContent === "beyond the map"')
    assert page.text('.speed') == '300 rpm'


def test_an_alarm_appears_without_reloading_and_is_said(dashboard: Any, page: Any) -> None:
    dashboard.do(lambda: dashboard.ship.sail(20.0, 1000.0, 2.0))
    assert not page.js(f'!!document.querySelector(`{ALARM}`)')
    dashboard.sail(20.0, 1000.0, 2.0)
    page.until(f'document.querySelector(`{ALARM}`)')
    assert page.text(f'{ALARM} h3') == 'ALARM: Stick-slip predicted'
    assert 'not acknowledged' in page.text(f'{ALARM} .state')
    page.until('document.getElementById("say-now").textContent.startsWith("alarm: Stick-slip")')
    page.until('document.title.startsWith("(1) ")')
    page.until(
        'document.querySelector(".bearing .badge").textContent === "▲ Stick-slip predicted"'
    )
    # Averaging and the exact cycle both, and what is said is what is shown.
    gauge = page.js('document.querySelectorAll(".gauge")[2].ariaValueText')
    assert re.fullmatch(
        r'0\.\d\d mm, predicted; by averaging \(KBM\) 0\.53 mm; limit 0\.90 mm', gauge
    )


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
    page.until('document.getElementById("say").textContent === "acknowledge: 1 alarm"')
    row = page.js('[...document.querySelector("#log tr").cells].map((c) => c.textContent)')
    assert row[1:] == ['Stick-slip predicted, aft_stern', 'acknowledged', 'Ada L.']
    (request,) = dashboard.ship.asked
    assert (request.by, request.bearing, request.kind) == ('Ada L.', 'aft_stern', 'stick_slip')
    # The button has gone with what it was for; whoever goes on with the keyboard is still there.
    assert page.js(f'document.querySelector(`{ALARM}`).contains(document.activeElement)')
    # The name is asked for once.
    assert page.js('document.getElementById("who").value') == 'Ada L.'
    page.js(f'document.querySelector(`{ALARM} [data-action=shelve]`).focus()')
    page.press('Enter')
    # Why it is put aside is asked for, and logged with the name.
    page.until('document.getElementById("why").open')
    page.type('new oil')
    page.press('Enter')
    page.until(f'document.querySelector(`#aside-list {ALARM}`)')
    assert (dashboard.ship.asked[-1].by, dashboard.ship.asked[-1].reason) == ('Ada L.', 'new oil')
    assert 'aft_stern/stick_slip: shelve by Ada L.: new oil' in page.text('#log')
    assert page.text('#aside summary') == '1 put aside: 1 shelved'
    # What has gone from sight leaves the focus to the list.
    assert page.js('document.activeElement.id') == 'alarms'


@pytest.mark.slow
def test_a_lost_input_and_a_silent_monitor_are_shown(dashboard: Any, page: Any) -> None:
    dashboard.do(lambda: dashboard.ship.wait(30.0))
    page.until(f'{STANDS} === "input_stale"')
    assert '✕ lost, 30 s old' in page.text('[data-input=load]')
    # Nothing more is heard: the heartbeat says so after three seconds.
    assert page.js('document.getElementById("banner").hidden')
    page.until('document.body.dataset.link === "silent"')
    assert 'The monitor /stickslip_monitor has been silent for' in page.text('#banner')
    assert page.js('document.getElementById("quiet").hidden')
    dashboard.do(dashboard.ship.show)
    page.until('document.body.dataset.link === "live"')
    assert page.js('document.getElementById("banner").hidden')


def test_it_comes_back_after_the_server_restarts(
    dashboards: Callable[..., Any], browser: Any
) -> None:
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
    own = [text for text in browser.complaints if 'net::ERR_' not in text]
    assert own == []


def test_it_comes_back_after_it_was_turned_away(
    dashboard: Any, browser: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A browser by itself tries again after a broken connection, but not after a refusal."""
    dashboard.sail(60.0, 1000.0)
    with monkeypatch.context() as crowded:
        crowded.setattr('stickslip_monitor.dashboard.hub.MOST_READERS', 0)
        browser.open(dashboard.url)
        browser.until('document.body.dataset.link === "lost"')
    browser.until(f'{STANDS} === "normal"')


def test_a_token_is_asked_for_once(dashboards: Callable[..., Any], browser: Any) -> None:
    token = 'correct-horse-battery'
    locked = dashboards(token=token)
    locked.sail(60.0, 1000.0)
    browser.open(locked.url)
    browser.until('location.pathname === "/login" && document.activeElement.name === "token"')
    browser.type('a wrong one, and a long one')
    browser.press('Enter')
    browser.until('location.search === "?wrong" && document.activeElement.name === "token"')
    browser.type(token)
    browser.press('Enter')
    browser.until(f'{STANDS} === "normal"')
    assert browser.js('document.cookie') == ''
    assert browser.complaints == []


HOSTILE = '<img src=x onerror=alert(1)><script>alert(2)</script>"\'&amp;'


def test_hostile_texts_stay_text(dashboard: Any, page: Any) -> None:
    dashboard.sail(20.0, 1000.0, 5.0)

    def poison() -> None:
        ship = dashboard.ship
        for causes in ship.alarms.annunciator.causes.values():
            causes.texts = dict.fromkeys(AlarmKind, HOSTILE)
        ship.shown.take_status('aft_stern', 1, HOSTILE, {'reason': HOSTILE, 'regime': HOSTILE})
        ship.act(ActionRequest(Action.ACKNOWLEDGE, HOSTILE))
        ship.act(ActionRequest(Action.SUPPRESS, HOSTILE))

    dashboard.do(poison)
    page.until(f'document.querySelector(`#aside-list {ALARM}`)')
    assert page.text(f'{ALARM} .text') == HOSTILE
    page.until(f'document.querySelector(".badge").textContent === {json.dumps(HOSTILE)}')
    assert page.text('.verdict') == HOSTILE
    assert HOSTILE in page.text('#log')
    assert page.js('document.querySelectorAll("main img, main script").length') == 0


CONTRAST = """(() => {
  const rgb = (c) => c.match(/[\\d.]+/g).map(Number);
  const light = ([r, g, b]) => [r, g, b].map((v) => v / 255)
    .map((v) => (v <= 0.03928 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4))
    .reduce((sum, v, k) => sum + v * [0.2126, 0.7152, 0.0722][k], 0);
  const behind = (e) => { for (; e; e = e.parentElement) {
    const c = rgb(getComputedStyle(e).backgroundColor);
    if (c.length < 4 || c[3] === 1) return c; } return [255, 255, 255]; };
  const seen = [...document.querySelectorAll('body *')].filter((e) => e.checkVisibility()
    && !e.closest('.unseen, .skip, svg, option, [aria-disabled]')
    && [...e.childNodes].some((n) => n.nodeType === 3 && n.textContent.trim()));
  return seen.map((e) => { const [a, b] = [rgb(getComputedStyle(e).color), behind(e)].map(light);
    return [(Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05), e.outerHTML.slice(0, 90)]; });
})()"""


@pytest.mark.parametrize('theme', ['day', 'dusk', 'night'])
def test_every_text_stands_out_in_every_light(dashboard: Any, page: Any, theme: str) -> None:
    """By WCAG 2.1, 1.4.3: at least 4.5 to 1."""
    dashboard.sail(20.0, 1000.0, 5.0)
    page.until(f'document.querySelector(`{ALARM}`)')
    page.choose('theme', theme)
    ratios = page.js(CONTRAST)
    assert len(ratios) > 30
    assert [entry for entry in ratios if entry[0] < 4.5] == []


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


def test_the_device_chooses_the_light_until_somebody_does(dashboard: Any, browser: Any) -> None:
    browser.show_as(1280, 900, dark=True)
    browser.open(dashboard.url)
    browser.until('document.documentElement.dataset.theme === "dusk"')
    browser.show_as(1280, 900)
    browser.until('document.documentElement.dataset.theme === "day"')


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


def test_a_screen_reader_finds_its_way(dashboard: Any, page: Any) -> None:
    dashboard.sail(20.0, 1000.0, 5.0)
    page.until(f'document.querySelector(`{ALARM}`)')
    nodes = page.call('Accessibility.getFullAXTree')['nodes']
    found = {(n.get('role', {}).get('value'), n.get('name', {}).get('value', '')) for n in nodes}
    roles = {role for role, _ in found}
    assert {'banner', 'main', 'heading', 'alert', 'status', 'meter', 'image'} <= roles
    meters = {name for role, name in found if role == 'meter'}
    assert meters == {'Fold margin', 'Hopf margin', 'Stick-slip amplitude'}
    assert ('button', 'Acknowledge: Stick-slip predicted, aft_stern') in found
    assert all(name for role, name in found if role in ('button', 'textbox', 'combobox', 'image'))


def test_an_alarm_on_the_shelf_is_not_all_clear(dashboard: Any, page: Any) -> None:
    dashboard.sail(20.0, 1000.0, 5.0)
    dashboard.do(
        lambda: dashboard.ship.act(
            ActionRequest(Action.SHELVE, 'Ada', 'aft_stern', AlarmKind.STICK_SLIP)
        )
    )
    page.until('!document.getElementById("hidden-alarms").hidden')
    told = page.text('#hidden-alarms')
    assert told == '1 put aside though the cause stands: Stick-slip predicted, aft_stern'
    assert page.js('document.getElementById("quiet").hidden')


def test_what_was_not_done_stays_until_it_is_seen(
    dashboard: Any, page: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr('stickslip_monitor.dashboard.server.PATIENCE', 0.1)
    dashboard.sail(20.0, 1000.0, 5.0)
    dashboard.ship.deaf = True
    page.until(f'document.querySelector(`{ALARM}`)')
    page.js('document.getElementById("who").value = "Ada"')
    page.js(f'document.querySelector(`{ALARM} [data-action=acknowledge]`).click()')
    page.until('document.getElementById("answer").classList.contains("failed")')
    assert page.text('#answer').startswith('Not done: the monitor has not answered')
    assert page.text('#say-now') == page.text('#answer')
    page.js('document.getElementById("answer").click()')
    assert page.js('document.getElementById("answer").hidden')
    page.complaints.clear()  # Chromium notes the refusal


@pytest.mark.parametrize('quiet', ['alarms', 'status'])
def test_no_alarm_is_not_said_before_it_is_known(
    dashboards: Callable[..., Any], browser: Any, quiet: str
) -> None:
    dashboard = dashboards()
    if quiet == 'alarms':
        dashboard.do(lambda: setattr(dashboard.ship.shown, 'alarms', None))
        dashboard.do(dashboard.ship.show)
    browser.open(dashboard.url)
    words = {
        'alarms': 'The list of alarms of /stickslip_monitor has not come',
        'status': 'Nothing has been heard',
    }
    browser.until(f'document.getElementById("banner").textContent.includes("{words[quiet]}")')
    assert browser.js('document.getElementById("quiet").hidden')
    assert browser.js('document.getElementById("unsure").checkVisibility()')


def test_eight_tabs_share_one_stream(dashboard: Any, page: Any, kit: Any) -> None:
    """A browser opens six connections to a server: with a stream each, the seventh tab hangs."""
    tabs = [page.call('Target.createTarget', url=dashboard.url)['targetId'] for _ in range(7)]
    page.until('document.querySelector(".bearing")')
    try:
        dashboard.sail(20.0, 1000.0, 5.0)

        def titles() -> list[str]:
            found = page.call('Target.getTargets')['targetInfos']
            return [t['title'] for t in found if t['url'] == dashboard.url]

        def all_know() -> bool:
            return [t.startswith('(1) ') for t in titles()] == [True] * 8

        page.until('document.title.startsWith("(1) ")')
        kit.until(all_know, 'all tabs')
        kit.until(lambda: len(dashboard.board.hub.readers) == 1, 'the end of the others')
        # One that cannot be reached for a moment is there for actions, too.
        assert page.js('fetch("/page.css").then((answer) => answer.status)') == 200
    finally:
        for tab in tabs:
            page.call('Target.closeTarget', targetId=tab)


def luminance(colour: str) -> float:
    """Relative luminance by WCAG 2.1 of a colour in hexadecimal."""
    parts = [int(colour[k : k + 2], 16) / 255.0 for k in (1, 3, 5)]
    linear = [v / 12.92 if v <= 0.03928 else ((v + 0.055) / 1.055) ** 2.4 for v in parts]
    return float(sum(w * v for w, v in zip((0.2126, 0.7152, 0.0722), linear, strict=True)))


def test_caution_can_be_told_at_night(page: Any) -> None:
    """Each area of the map from the next; it was 1.05."""
    page.js('document.documentElement.dataset.theme = "night"')
    names = ('stable', 'caution', 'bistable', 'unstable')
    shown = [
        luminance(
            page.js(f'getComputedStyle(document.documentElement).getPropertyValue("--{name}")')
        )
        for name in names
    ]
    steps = [(b + 0.05) / (a + 0.05) for a, b in itertools.pairwise(shown)]
    assert min(steps) > 1.4, steps


@pytest.fixture
def fleet(dashboard: Any, browser: Any) -> Any:
    """Fifty bearings on one shaft, whose speed is lost at 47 of them; one is in stick-slip."""
    from stickslip_monitor.dashboard.received import status_record
    from stickslip_monitor.dashboard.watched import Watched

    shown = dashboard.ship.shown
    dashboard.sail(20.0, 1000.0, 5.0)
    own = shown.bearings['aft_stern']
    lost = 'no sample of speed for {} s'
    (alarm,) = [a for a in shown.alarms['alarms'] if a['alarm'] == 'stick_slip']

    def grow() -> None:
        sick = own.status
        alarms = [alarm | {'state': 'acknowledged', 'priority': 'caution'}]
        # However slow the machine is, they are heard.
        own.at = shown._heard_at = shown._clock() + 1e6
        for k in range(49):
            name, stale = f'b{k:02}', k < 47
            words = {'reason': 'input_stale' if stale else 'normal', 'regime': 'stable'}
            numbers = sick.numbers | {'fold_margin': 0.9}
            status = replace(sick, words=words, sticking=False, numbers=numbers)
            record = status_record(status)
            shown.bearings[name] = Watched(name, own.view, status, record, at=own.at)
            if stale:
                more = {'alarm': 'input_lost', 'priority': 'warning', 'bearing': name}
                more |= {'state': 'unacknowledged', 'text': f'{name}: {lost.format(2 + k % 3)}'}
                alarms.append(alarm | more | {'actions': ['acknowledge']})
        shown.alarms = shown.alarms | {'alarms': alarms, 'unacknowledged': 47}

    dashboard.do(grow)
    browser.open(dashboard.url)
    browser.until('document.querySelectorAll("#rows tr").length === 50')
    return browser


def test_fifty_bearings_at_a_glance(fleet: Any) -> None:
    names = (
        '[...document.querySelectorAll("#rows tr:not([hidden]) button")].map((b) => b.textContent)'
    )
    assert fleet.js(names)[0] == 'aft_stern'
    assert fleet.js(names)[-2:] == ['b47', 'b48']
    # Only the one that is looked at is drawn.
    shown = (
        '[...document.querySelectorAll(".bearing")].filter((b) => !b.hidden)'
        '.map((b) => b.dataset.bearing)'
    )
    assert fleet.js(shown) == ['aft_stern']
    fleet.js('document.querySelector("#rows [data-name=b48]").click()')
    assert fleet.js(shown) == ['b48']
    fleet.js('document.getElementById("only").click()')
    assert len(fleet.js(names)) == 48
    fleet.js(
        '(() => { const f = document.getElementById("find"); f.value = "B4";'
        ' f.dispatchEvent(new Event("input")); })()'
    )
    assert fleet.js(names) == [f'b4{k}' for k in range(7)]


def test_one_that_is_not_heard_any_more_is_not_normal(dashboard: Any, fleet: Any) -> None:
    """Its last word was normal: it does not stay in the table as if it were so."""
    row = 'document.querySelector("#rows tr").innerText.replace(/\\s+/g, " ")'
    assert fleet.js(row).startswith('aft_stern')
    dashboard.do(lambda: setattr(dashboard.ship.shown.bearings['b48'], 'at', 0.0))
    fleet.until(f'{row}.startsWith("b48 ✕ not heard")')
    assert fleet.js('document.title').startswith('✕ ')
    fleet.js('document.getElementById("only").click()')
    assert fleet.js('document.querySelector("[data-name=b48]").checkVisibility()')


def test_one_lost_speed_is_one_entry_above_what_is_acknowledged(fleet: Any) -> None:
    entries = fleet.js(
        '[...document.querySelectorAll("#alarm-list > li")].map((li) =>'
        ' [li.querySelector("h3").textContent, li.querySelector(".state").textContent])'
    )
    assert [title for title, _ in entries] == [
        'WARNING: Input lost',
        'CAUTION: Stick-slip predicted',
    ]
    assert entries[0][1].startswith('47 bearings, not acknowledged')
    assert fleet.text('#alarm-list .places').startswith('b00, b01, b02')


def test_what_comes_next_is_a_reading(dashboard: Any, page: Any) -> None:
    dashboard.sail(43.0, 1000.0, 5.0)
    numbers = {'clears in [s]': '4', 'time to boundary [s]': '150'}
    odds = {'probability can': '0.9', 'probability will': '0.25', 'probability runs': '0.1'}
    point = dashboard.board.bearings['aft_stern'].status.numbers
    values = {
        'regime': 'stable', 'speed [m/s]': '0.2', 'shaft speed [rpm]': '38.2', 'load [N]': '1000',
        'fold speed [m/s]': str(point['fold_speed']),
        'hopf speed [m/s]': str(point['hopf_speed']),
    }  # fmt: skip
    take = dashboard.ship.shown.take_status
    dashboard.do(lambda: take('aft_stern', 1, 'x', values | numbers | odds))
    page.until('document.querySelector(".soon").textContent')
    assert page.text('.soon') == 'clears in 4 s; boundary reached in 3 min'
    assert page.text('.chances') == 'stick-slip: can happen 90 %, starts by itself 25 %, runs 10 %'
    # A journal of 0.1 m: n = 60 v / (pi d).
    rpm = [60.0 * point[f'{name}_speed'] / (3.141592653589793 * 0.1) for name in ('fold', 'hopf')]
    assert page.text('.boundaries') == f'fold {rpm[0]:.1f} rpm, Hopf {rpm[1]:.1f} rpm'


def test_the_log_is_saved_and_told_in_the_time_that_is_chosen(dashboard: Any, page: Any) -> None:
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
        hours, minutes, rest = (int(part) for part in text[-8:].split(':'))
        return 3600 * hours + 60 * minutes + rest

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


def test_it_sounds_only_where_it_was_asked_to(dashboard: Any, page: Any) -> None:
    dashboard.sail(20.0, 1000.0, 5.0)
    page.until(f'document.querySelector(`{ALARM}`)')
    assert page.js('document.getElementById("sound").value') == 'off'
    assert page.js('document.getElementById("sound").dataset.beeps') is None
    page.choose('sound', 'on')
    page.until('document.getElementById("sound").dataset.beeps === "1"')
    page.complaints.clear()  # Chromium wants a touch first


class Player:
    """Notes what is asked of a replay."""

    def __init__(self) -> None:
        self.asked: list[Any] = []

    def hold(self, paused: bool) -> None:
        self.asked.append(paused)

    def seek(self, seconds: float) -> None:
        self.asked.append(seconds)


def test_a_replay_is_led_with_the_keyboard(
    dashboards: Callable[..., Any], browser: Any, kit: Any
) -> None:
    player = Player()
    dashboard = dashboards(player=player)
    dashboard.sail(60.0, 1000.0)
    place = {'at': 65.0, 'length': 200.0, 'paused': False}
    dashboard.do(lambda: dashboard.board.play(place))
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
    kit.until(lambda: player.asked == [True], 'the pause')
    dashboard.do(lambda: dashboard.board.play(place | {'paused': True}))
    browser.until('document.getElementById("hold").textContent === "Play"')
    browser.press(' ')
    kit.until(lambda: player.asked[1:] == [False], 'its end')
    browser.press('Tab', ' ')
    kit.until(lambda: player.asked[2:] == [False, 0.0], 'the start')
    browser.press('Tab')
    assert browser.js(focused) == 'place'
    browser.press('ArrowLeft')
    # A key moves it by a two hundredth of the recording.
    kit.until(lambda: player.asked[4:] == [64.0], 'the place')
    browser.press('Home')
    kit.until(lambda: player.asked[5:] == [0.0], 'the beginning')
    assert browser.complaints == []


@pytest.mark.parametrize(
    ('document', 'words'),
    [
        ({'paused': 'yes'}, "paused = 'yes' must be true or false"),
        ({'at': '3'}, "at = '3' must be a time in seconds"),
        ({'at': True}, 'at = True must be a time'),
        ([], 'must be a JSON object'),
    ],
)
def test_what_is_no_course_of_a_replay(
    dashboards: Callable[..., Any], browser: Any, document: Any, words: str
) -> None:
    player = Player()
    dashboard = dashboards(player=player)
    browser.open(dashboard.url)
    ask = {'method': 'POST', 'headers': {'Content-Type': 'application/json'}}
    ask['body'] = json.dumps(document)
    answer = browser.js(f'fetch("/replay", {json.dumps(ask)}).then((answer) => answer.json())')
    assert words in answer['text']
    assert player.asked == []


def test_all_that_are_seen_are_acknowledged(dashboard: Any, page: Any, kit: Any) -> None:
    dashboard.sail(43.0, 1000.0, 5.0)
    dashboard.sail(20.0, 1000.0, 5.0)
    waiting = dashboard.board.alarms['unacknowledged']
    assert waiting > 1
    page.until(f'document.querySelectorAll("#alarm-list .waiting").length === {waiting}')
    page.js('document.getElementById("who").value = "Ada"')
    page.js('document.getElementById("seen").click()')
    page.until('document.querySelectorAll("#alarm-list .waiting").length === 0')
    page.until(f'document.getElementById("say").textContent === "acknowledge: {waiting} alarms"')
    assert page.js('document.getElementById("seen").hidden')


def test_what_the_node_and_its_inputs_say_is_read(dashboard: Any, page: Any) -> None:
    """Faults of inputs, of the node and what is measured are texts, not hints."""
    shown = dashboard.ship.shown
    values = {'reason': 'input_stale', 'speed samples accepted': '1', 'speed age [s]': '9'}
    values |= {'speed fault': 'nobody publishes on /shaft/speed', 'speed [m/s]': '0.3'}
    values |= {'measured': 'unknown', 'measured unknown': 'the level is stuck'}
    note = {'time': shown.alarms['time'] * 10**6, 'what': 'parameter', 'text': 'limit set to 2'}
    document = {
        'schema': 'stickslip_monitor/alarm/1', 'time': 10**18, 'sounding': False,
        'unacknowledged': 0, 'flood': {}, 'changes': [], 'notes': [note], 'alarms': [],
    }  # fmt: skip

    def tell() -> None:
        shown.take_health(2, 'the alarms are not kept: No space left on device')
        shown.take_alarms(document)
        shown.take_status('aft_stern', 10**18, 'x', values)

    dashboard.do(tell)
    page.until('!document.getElementById("notices").hidden')
    assert page.text('#notices') == (
        '/stickslip_monitor: the alarms are not kept: No space left on device'
    )
    assert page.text('[data-input=speed] .fault') == 'nobody publishes on /shaft/speed'
    assert page.text('[data-of=speed] .name') == 'Shaft speed, last known'
    assert page.text('.measured') == 'vibration measured: not known (the level is stuck)'
    assert 'limit set to 2' in page.text('#log tr')


def test_ten_minutes_are_drawn_and_outlive_a_reload(dashboard: Any, page: Any) -> None:
    dashboard.sail(60.0, 1000.0, 300.0)
    for k in range(100):
        dashboard.sail(60.0 - k / 5.0, 1000.0)
    page.js('location.reload()')
    chart = 'document.querySelector(".charts svg")'
    page.until(f'{chart}.ariaLabel.includes("from 40.2 to 60.0 rpm")')
    # A hundred seconds of ten minutes, at the end of the axis.
    end, left, width = page.js(
        """(() => {
          const find = (s) => document.querySelector(`.charts ${s}`);
          const box = find('.course').getBBox(), of = (n) => +find('.field').getAttribute(n);
          return [box.x + box.width, of('x'), of('width')];
        })()"""
    )
    assert end - left == pytest.approx(width, abs=0.2)
    assert page.text('.gauge .scale') == '−100 %0+100 %'


def test_twin_screws_are_two_things_on_the_page(
    dashboards: Callable[..., Any], browser: Any
) -> None:
    dashboard = dashboards(nodes=('/port/monitor', '/starboard/monitor'))
    port, starboard = dashboard.ships

    def sail() -> None:
        port.sail(20.0, 1000.0, 5.0)
        starboard.sail(60.0, 1000.0, 5.0)

    dashboard.do(sail)
    browser.open(dashboard.url)
    badge = 'document.querySelector(`[data-bearing="{}/aft_stern"] .badge`)?.dataset.reason'
    browser.until(f'{badge.format("port")} === "stick_slip"')
    browser.until(f'{badge.format("starboard")} === "normal"')
    assert browser.js('document.getElementById("quiet").hidden')
    browser.js('document.getElementById("who").value = "Ada"')
    alarm = '[data-alarm="port/aft_stern/stick_slip"]'
    browser.js(f'document.querySelector(`{alarm} [data-action=acknowledge]`).click()')
    browser.until(f'document.querySelector(`{alarm}`).dataset.state === "acknowledged"')
    assert [len(ship.asked) for ship in dashboard.ships] == [1, 0]
    owners = '[...document.querySelectorAll("#alarm-list li")].map((li) => li.dataset.alarm)'
    assert {name.rpartition('/')[0] for name in browser.js(owners)} == {'port/aft_stern'}


def complaints(browser: Any) -> Any:
    """What axe-core finds wrong on the page as it stands."""
    axe = importlib.util.find_spec('axe_core_python')
    if axe is None or axe.origin is None:
        pytest.skip("the extra 'test' is not installed")
    script = Path(axe.origin).with_name('axe.min.js').read_text('utf-8')
    browser.js(f'globalThis.axe ?? (() => {{ {script} }})(); 0')
    found = 'v.id + ": " + v.nodes.map((n) => n.html + n.failureSummary).join(" | ")'
    return browser.js(f'axe.run(document).then((r) => r.violations.map((v) => {found}))')


@pytest.mark.parametrize('theme', ['day', 'dusk', 'night'])
def test_axe_finds_nothing(dashboards: Callable[..., Any], browser: Any, theme: str) -> None:
    """The rules of axe-core for WCAG 2.1 AA and good practice, view after view."""
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
            dashboard.board.play({'at': 1.0, 'length': 9.0, 'paused': True}),
        ),
        'gone, and a fault of the node': lambda: (
            ship.sail(60.0, 1000.0, 30.0),
            ship.shown.take_health(2, 'it is not well'),
            ship.show(),
        ),
        'an input lost': lambda: ship.wait(30.0),
    }
    for view, happens in views.items():
        dashboard.do(happens)
        shown = ship.shown.bearings['aft_stern'].record
        if shown is not None:
            reason = shown['reason']
            browser.until(f'{STANDS} === "{reason}"')
        assert (view, complaints(browser)) == (view, [])
    for dialog in ('ask', 'why'):
        browser.js(f'document.getElementById("{dialog}").showModal()')
        assert (dialog, complaints(browser)) == (dialog, [])
        browser.js(f'document.getElementById("{dialog}").close()')
    browser.choose('theme', 'auto')


@pytest.mark.parametrize('theme', ['day', 'dusk', 'night'])
def test_axe_finds_nothing_in_the_overview(fleet: Any, theme: str) -> None:
    fleet.choose('theme', theme)
    assert complaints(fleet) == []
    fleet.choose('theme', 'auto')


@pytest.mark.parametrize('dark', [False, True])
def test_axe_finds_nothing_at_the_door(
    dashboards: Callable[..., Any], browser: Any, dark: bool
) -> None:
    locked = dashboards(token='correct-horse-battery')
    browser.show_as(390, 800, dark=dark)
    browser.open(f'{locked.url}login')
    browser.until('document.activeElement.name === "token"')
    assert complaints(browser) == []
