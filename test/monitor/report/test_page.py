# SPDX-License-Identifier: Apache-2.0
"""The page: whatever stands in a name stays text, and nothing is fetched."""

from __future__ import annotations

import re
from datetime import datetime, timezone
from html.parser import HTMLParser
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from shared import CONFIG, ROOT, RPM, contrast_ratio, relative_luminance

from stickslip_monitor.monitor.parameter_file import load_config
from stickslip_monitor.monitor.parameters import BEARING_PARAMETERS
from stickslip_monitor.offline.check import check_recording, to_json
from stickslip_monitor.report.page import (
    MAX_DRAWN,
    MAX_EVENTS,
    Archive,
    BearingPart,
    Picture,
    RecordingPart,
    html_page,
    parameter_groups,
    recording_part,
    shown_events,
)
from stickslip_monitor.report.summary import Fact, Finding

pytest.importorskip('jinja2')
HOSTILE = '"><script>alert(1)</script><img src=x onerror=alert(2)>{{ 7 * 7 }}\' & </style>'
VOID = {'meta', 'br', 'img', 'link', 'hr', 'input'}


class Page(HTMLParser):
    """Tags with their attributes, the text, and what is left open."""

    def __init__(self, text: str) -> None:
        super().__init__(convert_charrefs=True)
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.text = ''
        self.open: list[str] = []
        self.wrong: list[str] = []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        if not self.open or self.open.pop() != tag:
            self.wrong.append(tag)

    def handle_data(self, data: str) -> None:
        self.text += data


DRAWING = '<svg role="img" aria-label="m"></svg>'
START = 1_777_852_800 * 10**9  # a midnight


def warning_event(number: int, severity: str = 'ERROR', text: str = 'x') -> dict[str, Any]:
    condition = {'OK': 'normal', 'WARN': 'caution', 'ERROR': 'stick_slip'}[severity]
    at = START + number * 10**9
    return {'time': at, 'severity': severity, 'from': 'normal', 'to': condition, 'text': text}


def check_document(text: str) -> dict[str, Any]:
    """Return what a check prints, with a text wherever a name or a sentence stands."""
    topics = {text: {'type': text, 'messages': 7, 'problem': text}}
    spoken = {
        'topic': text,
        'messages': 7,
        'used': 7,
        'values': text,
        'rate': 1.0,
        'gaps': 1,
        'longest_gaps': [{'time': START, 'seconds': 9.0}],
    }
    bearing = {
        'evaluations': 7,
        'seconds': {'stable': 1.0, 'bistable': 3.0, 'unstable': 0.0},
        'events': [warning_event(0, text=text), warning_event(5), warning_event(86_400)],
        'inputs': {'speed': spoken},
    }
    return {
        'path': text,
        'start': START,
        'end': START + 10**10,
        'duration': 10.0,
        'messages': 7,
        'cuts': [{'text': text}],
        'warnings': [text],
        'topics': topics,
        'bearings': {text: bearing},
    }


def page_of(text: str) -> str:
    """Return a report in which every text is the given one."""
    picture = Picture(DRAWING, DRAWING, text)
    finding = Finding('alarm', (text, text + '2'))
    hostile = {'field': text, 'type': text, 'limit': 5.0, 'wrong': [text, text]}
    facts = (Fact(text, text, text),)
    part = BearingPart('bag-1-aft', finding, {'speed': hostile}, facts, picture, picture, text)
    failed = {'path': text, 'error': text}
    parts = [
        RecordingPart('bag-1', text, check_document(text), (finding,), {text: part}),
        RecordingPart('bag-2', text, failed, (finding,), {}),
    ]
    created = datetime(2026, 5, 5, tzinfo=timezone.utc)
    return html_page(parts, load_config(CONFIG), str(CONFIG), created).decode()


def test_hostile_names_stay_text() -> None:
    tame, hostile = Page(page_of('x')), Page(page_of(HOSTILE))
    assert [tag for tag, _ in hostile.tags] == [tag for tag, _ in tame.tags]
    assert [sorted(a) for _, a in hostile.tags] == [sorted(a) for _, a in tame.tags]
    assert hostile.text.count('{{ 7 * 7 }}') > 20
    assert hostile.text.count('49') == tame.text.count('49')


def test_nothing_is_run_and_nothing_is_fetched() -> None:
    text = page_of(HOSTILE)
    page = Page(text)
    assert not {tag for tag, _ in page.tags} & {'script', 'link', 'img', 'iframe', 'object'}
    for tag, attributes in page.tags:
        assert not [name for name in attributes if name.startswith('on')]
        target = attributes.get('href')
        assert target is None or target.startswith('#'), (tag, target)
    (policy,) = [a['content'] for t, a in page.tags if a.get('http-equiv')]
    assert policy == "default-src 'none'; style-src 'unsafe-inline'"
    assert 'url(' not in text.replace('url(#', '')


def test_the_report_is_well_formed_and_navigable() -> None:
    page = Page(page_of('x'))
    assert page.wrong == []
    assert page.open == []
    levels = [int(tag[1]) for tag, _ in page.tags if tag in ('h1', 'h2', 'h3', 'h4')]
    assert levels.count(1) == 1
    assert all(next_level <= level + 1 for level, next_level in pairwise(levels))
    tags = [tag for tag, _ in page.tags]
    assert tags.count('table') == tags.count('caption')
    assert all(a.get('scope') in ('col', 'row') for tag, a in page.tags if tag == 'th')
    assert dict(page.tags)['html'] == {'lang': 'en'}
    ids = [a['id'] for _, a in page.tags if 'id' in a]
    targets = {str(a['href'])[1:] for _, a in page.tags if 'href' in a}
    assert targets <= set(ids)


def page_style() -> str:
    import stickslip_monitor.report.page as module

    return (Path(module.__file__).parent / 'page.css').read_text('utf-8')


def test_on_paper_the_bar_of_regimes_is_darker_with_trouble() -> None:
    (paper,) = re.findall(r'@media print \{\s*:root \{(.*?)\}', page_style())
    colour = dict(re.findall(r'--([a-z]+): (#[0-9a-f]{6})', paper))
    greys = [
        relative_luminance(colour[regime]) for regime in ('undetermined', 'stable', 'bistable', 'unstable')
    ]
    assert min(light / dark for light, dark in pairwise(greys)) > 1.3


@pytest.mark.parametrize('night', [False, True])
def test_words_stand_out_from_what_is_behind_them(night: bool) -> None:
    day, dark = re.findall(r':root \{(.*?)\}', page_style(), flags=re.DOTALL)[:2]
    colour = dict(re.findall(r'--([a-z-]+): (#[0-9a-f]{6})', day + (dark if night else '')))
    assert len(re.findall(r'--[a-z-]+:', dark)) == len(colour)
    grades = ('clear', 'warning', 'alarm', 'unknown')
    pairs = [(word, 'page') for word in ('text', 'soft', 'link', 'warning')]
    pairs += [(word, 'card') for word in ('text', 'soft')]
    pairs += [(grade, f'{grade}-back') for grade in grades]
    pairs += [('text', f'{grade}-back') for grade in grades]
    for front, back in pairs:
        assert contrast_ratio(colour[front], colour[back]) >= 4.5, (front, back)


def test_the_cards_say_units_scales_and_what_is_assumed(tmp_path: Path) -> None:
    measured = 'load: {topic: /bearing/aft_stern/load, unit: N, timeout: 5.0}'
    text = CONFIG.read_text('utf-8').replace('unit: rpm,', 'unit: rpm, scale: 2.0,')
    config = tmp_path / 'assumed.yaml'
    config.write_text(text.replace(measured, 'load: {constant: 0.8, unit: kN}'), 'utf-8')
    checked = check_recording(ROOT / 'bags' / 'coast_down', load_config(str(config)), outlined=True)
    archive = Archive()
    archive.add(recording_part(to_json(checked), checked))
    created = datetime(2026, 5, 5, tzinfo=timezone.utc)
    page = html_page(list(archive.shown()), checked.config, str(config), created).decode()
    cards = dict(re.findall(r'<caption>(Speed|Load)</caption>(.*?)</table>', page, flags=re.DOTALL))
    (text_range,) = re.findall(r'range</th><td>([^<]*)<', cards['Speed'])
    numbers = [float(number) for number in re.findall(r'[\d.]+', text_range)]
    assert re.sub(r'[\d.]+', '#', text_range) == '# to # rpm (# to # m/s; sent as # to #)'
    low, high, *si, first, last = numbers
    assert (low, high) == pytest.approx((2 * first, 2 * last), rel=1e-3)
    assert si == pytest.approx([RPM * low, RPM * high], rel=1e-3)
    # The time-out of the speed in the configuration.
    assert 'none longer than 5.0\xa0s' in cards['Speed']
    assert '0.8 kN: no sensor measures it' in cards['Load']
    assert 'topic' not in cards['Load']


def test_recordings_that_are_not_drawn_have_a_row() -> None:
    finding, created = Finding('unknown', ('no verdict',)), datetime(2026, 5, 5, tzinfo=timezone.utc)
    documents = [
        check_document('x'),
        check_document('x') | {'complete': False},
        {'path': 'x', 'error': 'torn'},
    ]
    parts = [RecordingPart(f'bag-{k}', 'x', documents[k % 3], (finding,)) for k in range(MAX_DRAWN + 3)]
    text = html_page(parts, load_config(CONFIG), str(CONFIG), created).decode()
    rows = re.findall(r'<tr><td>x</td><td>(.*?)</td><td>(.*?)</td><td>.*?no verdict(.*?)</td>', text)
    begin, lasting = '2026-05-04 00:00:00.0', '10\N{NO-BREAK SPACE}s'
    complete, part, torn = (begin, lasting, ''), (begin, lasting, ' Not all of it was read.'), ('', '', '')
    assert rows == [complete, part, torn] * 5


def test_of_very_many_events_the_severe_stay() -> None:
    events = [warning_event(i, 'ERROR' if i % 100 == 50 else 'WARN') for i in range(MAX_EVENTS + 200)]
    rows = shown_events(events)
    numbers = [number for number, _ in rows]
    assert len(rows) == MAX_EVENTS
    assert numbers == sorted(numbers)
    severe = [number for number, event in rows if event['severity'] == 'ERROR']
    assert severe == [i + 1 for i in range(len(events)) if i % 100 == 50]
    assert all(events[number - 1] is event for number, event in rows)


def test_a_date_stands_where_it_changes_and_shares_add_up() -> None:
    text = page_of('x')
    dates = re.findall(r'<td class="time">(?:<span class="date">([^<]*))?', text)
    assert dates == ['2026-05-04', '', '2026-05-05']
    assert re.findall(r'flex-grow:([\d.]+)', text) == ['25.0000', '75.0000']


def test_defaults_are_told_from_what_was_given() -> None:
    parameters = {'bearings': ['aft'], 'aft.mass': 50.0, 'aft.friction.law': 'coulomb'}
    (_, monitor), (_, bearing) = parameter_groups(parameters, ['aft'])
    assert monitor[0].value == 'aft'
    assert [row.name for row in bearing if row.given] == ['mass', 'friction.law']
    rows = {row.name: row for row in bearing}
    assert (rows['mass'].value, rows['mass'].unit) == ('50', 'kg')
    assert rows['alarm.amplitude_limit'].value == 'none'
    assert 'friction.decay' not in rows
    assert set(rows) <= {row.name for row in BEARING_PARAMETERS}
