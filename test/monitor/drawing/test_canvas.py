# SPDX-License-Identifier: Apache-2.0
"""Colours, files, and pictures inside a page: nothing from outside, no id twice."""

from __future__ import annotations

import colorsys
import re
import sys
from collections.abc import Callable
from datetime import datetime, timezone
from itertools import pairwise
from pathlib import Path
from xml.etree import ElementTree

import pytest
from shared import CONFIG as REFERENCE_FILE
from shared import contrast_ratio, relative_luminance

from stickslip_monitor.drawing.canvas import (
    CAUTION_FILL,
    CONDITION_COLOUR,
    FOLD,
    HOPF,
    INK,
    MUTED,
    ON_DARK,
    PAPER,
    REGIME_COLOUR,
    REGIME_FILL,
    css_variable,
    draw_regime_bands,
    inline_svg,
    new_figure,
    save_figure,
)
from stickslip_monitor.drawing.diagram import draw_diagram
from stickslip_monitor.drawing.map import draw_map
from stickslip_monitor.errors import DrawingError, ReportError
from stickslip_monitor.monitor.assessment import Regime
from stickslip_monitor.monitor.parameter_file import load_config
from stickslip_monitor.monitor.severity import LADDER, Condition
from stickslip_monitor.report.page import _SPEED_CAPTION, html_page

pytest.importorskip('matplotlib')
CONFIG = load_config(REFERENCE_FILE)
REFERENCE = CONFIG.bearings[0]


@pytest.fixture(scope='module')
def drawings() -> list[str]:
    return [inline_svg(draw_map(REFERENCE), name, 'a <map> & "more"') for name in 'ab']


def test_pictures_that_share_a_page_share_no_id(drawings: list[str]) -> None:
    first, second = (set(re.findall(r'\bid="([^"]+)"', drawing)) for drawing in drawings)
    assert first
    assert not first & second
    for drawing, ids in zip(drawings, (first, second), strict=True):
        used = re.findall(r'(?:href="|url\()#([^")]+)', drawing)
        assert used
        assert set(used) <= ids


def test_an_inline_picture_is_well_formed_and_refers_to_nothing_outside(drawings: list[str]) -> None:
    root = ElementTree.fromstring(drawings[0])
    assert root.get('role') == 'img'
    assert root.get('aria-label') == 'a <map> & "more"'
    assert not re.search(r'https?:|<style|<metadata|<image|<script', drawings[0])
    # matplotlib draws a glyph in 1/64 of its size; rounding that factor would shrink all words.
    assert 'scale(0.015625)' in drawings[0]
    assert not re.search('|'.join(ON_DARK), drawings[0])
    used = set(re.findall(r'var\((--c[0-9a-f]{6})\)', drawings[0]))
    assert used <= {css_variable(colour) for colour in ON_DARK}
    assert {css_variable(INK), css_variable(PAPER), css_variable(CAUTION_FILL)} <= used


def test_a_band_too_narrow_for_its_name_has_it_upright() -> None:
    # A colour alone would tell nothing to whoever sees none.
    axes = new_figure().add_axes((0.0, 0.0, 1.0, 1.0))  # 900 pixels wide
    axes.set_xlim(0.0, 900.0)
    spans = [(0.0, 400.0, Regime.STABLE), (400.0, 430.0, Regime.BISTABLE), (430.0, 435.0, Regime.UNSTABLE)]
    draw_regime_bands(axes, spans)
    assert [(text.get_text(), text.get_rotation()) for text in axes.texts] == [
        ('stable', 0.0),
        ('bistable', 90.0),
    ]


def test_every_regime_and_condition_has_a_colour_by_day_and_night() -> None:
    assert set(REGIME_COLOUR) == set(REGIME_FILL) == set(Regime)
    assert set(CONDITION_COLOUR) == set(Condition)
    assert len(set(CONDITION_COLOUR.values())) == len(Condition)
    assert min(contrast_ratio(MUTED, fill) for fill in REGIME_FILL.values()) > 4.5
    palette = {*REGIME_COLOUR.values(), *REGIME_FILL.values(), *CONDITION_COLOUR.values()}
    assert palette | {INK, MUTED, PAPER, CAUTION_FILL, HOPF, FOLD} == set(ON_DARK)
    fills = [ON_DARK[fill] for fill in (*REGIME_FILL.values(), CAUTION_FILL, PAPER)]
    assert min(contrast_ratio(ON_DARK[INK], fill) for fill in fills) > 7.0
    assert min(contrast_ratio(ON_DARK[MUTED], fill) for fill in fills) > 4.5
    marks = [ON_DARK[mark] for mark in CONDITION_COLOUR.values()]
    assert min(contrast_ratio(mark, fill) for mark in marks for fill in fills) > 3.0


WEIGHTS = (0.299, 1), (0.587, 3), (0.114, 5)


def cie_lightness(colour: str) -> float:
    """L* of CIE 1976 [0 to 100], from the relative luminance of a colour."""
    return 116.0 * relative_luminance(colour) ** (1.0 / 3.0) - 16.0


def test_in_grey_print_trouble_is_darker() -> None:
    fills = [
        REGIME_FILL[Regime.STABLE],
        CAUTION_FILL,
        REGIME_FILL[Regime.BISTABLE],
        REGIME_FILL[Regime.UNSTABLE],
    ]
    for colours in (fills, [CONDITION_COLOUR[condition] for condition in LADDER]):
        greys = [cie_lightness(colour) for colour in colours]
        assert min(a - b for a, b in pairwise(greys)) > 4.0, greys
    # Printers and viewers that take the luma of BT.601 see steps, too.
    lumas = [sum(w * int(c[i : i + 2], 16) for w, i in WEIGHTS) for c in fills]
    assert min(a - b for a, b in pairwise(lumas)) > 10.0, lumas
    assert min(CONDITION_COLOUR.values(), key=relative_luminance) == CONDITION_COLOUR[Condition.AMPLITUDE]
    # Names stand on the bar in white: 3 for graphics (WCAG 2.2, 1.4.11).
    assert min(contrast_ratio(PAPER, colour) for colour in CONDITION_COLOUR.values()) > 2.9


@pytest.mark.parametrize('dark', [False, True])
def test_boundaries_are_seen_on_all_fills_and_captions_name_their_hues(dark: bool) -> None:
    def shown(colour: str) -> str:
        return ON_DARK[colour] if dark else colour

    fills = {regime: shown(fill) for regime, fill in REGIME_FILL.items()}
    for line in (HOPF, FOLD):
        assert min(contrast_ratio(shown(line), fill) for fill in fills.values()) > 4.5
    # What the captions of a report call them: red below 25 degrees, amber to 48, yellow to 65.
    for name, fill in (
        ('red', fills[Regime.UNSTABLE]),
        ('amber', fills[Regime.BISTABLE]),
        ('yellow', shown(CAUTION_FILL)),
    ):
        parts = [int(fill[i : i + 2], 16) / 255.0 for i in (1, 3, 5)]
        hue = 360.0 * colorsys.rgb_to_hsv(*parts)[0]
        assert name == ('red' if hue < 25.0 else 'amber' if hue < 48.0 else 'yellow')
        assert f'the {name} ' in _SPEED_CAPTION


def test_the_same_picture_gives_the_same_bytes(tmp_path: Path) -> None:
    for suffix in ('png', 'svg'):
        for name in ('a', 'b'):
            save_figure(draw_diagram(REFERENCE, 1000.0, points=40), tmp_path / f'{name}.{suffix}')
        assert (tmp_path / f'a.{suffix}').read_bytes() == (tmp_path / f'b.{suffix}').read_bytes()


@pytest.mark.parametrize(
    ('library', 'error', 'make'),
    [
        ('matplotlib', DrawingError, lambda: draw_diagram(REFERENCE, 1000.0)),
        ('jinja2', ReportError, lambda: html_page([], CONFIG, '', datetime(2026, 5, 5, tzinfo=timezone.utc))),
    ],
)
def test_without_its_library_the_extra_is_named(
    library: str, error: type[Exception], make: Callable[[], object], monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in [library, *(name for name in sys.modules if name.startswith(f'{library}.'))]:
        monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(error, match=r"extra 'report'.*stickslip_monitor\[report\]") as raised:
        make()
    if library == 'matplotlib':
        # A picture has no .csv of its own everywhere, a report never: the remedy names both.
        assert str(raised.value).endswith('A table (.csv) and --json need none')
