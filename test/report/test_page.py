# SPDX-License-Identifier: Apache-2.0
"""The page: whatever stands in a name stays text, and nothing is fetched."""

from __future__ import annotations

import builtins
import re
from html.parser import HTMLParser
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from stickslip_monitor.errors import ReportError
from stickslip_monitor.report.document import (
    BagPart,
    BearingPart,
    EventRow,
    Fact,
    Finding,
    InputRow,
    ParameterGroup,
    ParameterRow,
    Picture,
    Report,
    Share,
    TopicRow,
)
from stickslip_monitor.report.page import render

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


def report(text: str, drawing: str = '<svg role="img" aria-label="m"></svg>') -> Report:
    """A report in which every text is the given one."""
    finding = Finding('alarm', text, (text, text + '2'))
    picture = Picture(drawing, drawing, text)
    bearing = BearingPart(
        anchor='bag-1-aft',
        name=text,
        finding=Finding('clear', text, (text,)),
        facts=(Fact(text, text, text),),
        shares=(Share(text, 'stable', text, 100.0, text),),
        map=picture,
        timeline=picture,
        pictures_note=text,
        events=(EventRow(1, text, text, '2026-05-04T06:00:00Z', text, text, 'alarm', text),),
        events_note=text,
        inputs=(InputRow(*[text] * 9, (text, text)),),
    )
    bag = BagPart(
        anchor='bag-1',
        name=text,
        path=text,
        span=text,
        duration=text,
        messages=text,
        troubles=(text,),
        topics=(TopicRow(text, text, text, text),),
        topics_note=text,
        bearings=(bearing,),
    )
    parameters = (ParameterGroup(text, (ParameterRow(text, text, text, False),)),)
    colours = {'--cffffff': ('#fff', '#000')}
    return Report(finding, text, text, (bag, bag), text, text, parameters, colours)


def test_hostile_names_stay_text() -> None:
    tame, hostile = Page(render(report('x'))), Page(render(report(HOSTILE)))
    assert [tag for tag, _ in hostile.tags] == [tag for tag, _ in tame.tags]
    assert [sorted(a) for _, a in hostile.tags] == [sorted(a) for _, a in tame.tags]
    assert hostile.text.count('{{ 7 * 7 }}') > 30
    assert '49' not in hostile.text


def test_nothing_is_run_and_nothing_is_fetched() -> None:
    text = render(report(HOSTILE))
    page = Page(text)
    assert not {tag for tag, _ in page.tags} & {'script', 'link', 'img', 'iframe', 'object'}
    for tag, attributes in page.tags:
        assert not [name for name in attributes if name.startswith('on')]
        target = attributes.get('href')
        assert target is None or target.startswith('#'), (tag, target)
    (policy,) = [a['content'] for t, a in page.tags if a.get('http-equiv')]
    assert policy == "default-src 'none'; style-src 'unsafe-inline'"
    assert 'url(' not in text.replace('url(#', '')


def test_it_is_well_formed_and_can_be_found_the_way_around_in() -> None:
    page = Page(render(report('x')))
    assert page.wrong == []
    assert page.open == []
    levels = [int(tag[1]) for tag, _ in page.tags if tag in ('h1', 'h2', 'h3', 'h4')]
    assert levels.count(1) == 1
    assert all(after <= before + 1 for before, after in pairwise(levels))
    tags = [tag for tag, _ in page.tags]
    assert tags.count('table') == tags.count('caption')
    assert all(a.get('scope') in ('col', 'row') for tag, a in page.tags if tag == 'th')
    assert dict(page.tags)['html'] == {'lang': 'en'}
    ids = [a['id'] for _, a in page.tags if 'id' in a]
    targets = {str(a['href'])[1:] for _, a in page.tags if 'href' in a}
    assert targets <= set(ids)


def test_without_jinja_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    original = builtins.__import__

    def refuse(name: str, *args: Any, **kwargs: Any) -> Any:
        if name.startswith('jinja2'):
            raise ImportError(f"No module named '{name}'")
        return original(name, *args, **kwargs)

    monkeypatch.setattr(builtins, '__import__', refuse)
    with pytest.raises(ReportError, match=r"extra 'report'.*stickslip_monitor\[report\]"):
        render(report('x'))


def luminance(colour: str) -> float:
    parts = [int(colour[i : i + 2], 16) / 255.0 for i in (1, 3, 5)]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


@pytest.mark.parametrize('night', [False, True])
def test_words_stand_out_from_what_is_behind_them(night: bool) -> None:
    import stickslip_monitor.report.page as module

    style = (Path(module.__file__).parent / 'page.css').read_text('utf-8')
    day, dark = re.findall(r':root \{(.*?)\}', style, flags=re.DOTALL)[:2]
    colour = dict(re.findall(r'--([a-z-]+): (#[0-9a-f]{6})', day + (dark if night else '')))
    assert len(re.findall(r'--[a-z-]+:', dark)) == len(colour)
    grades = ('clear', 'warning', 'alarm', 'unknown')
    pairs = [(word, 'page') for word in ('text', 'soft', 'link', 'warning')]
    pairs += [(word, 'card') for word in ('text', 'soft')]
    pairs += [(grade, f'{grade}-back') for grade in grades]
    pairs += [('text', f'{grade}-back') for grade in grades]
    for front, back in pairs:
        one, other = luminance(colour[front]), luminance(colour[back])
        # WCAG 2, level AA for text of any size.
        assert (max(one, other) + 0.05) / (min(one, other) + 0.05) >= 4.5, (front, back)
