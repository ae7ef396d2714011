# SPDX-License-Identifier: Apache-2.0
"""Pictures inside a page: nothing from outside, no id twice, colours that a page can set."""

from __future__ import annotations

import colorsys
import re
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stickslip_monitor.drawing.canvas import _shorter, inline_svg, variable
from stickslip_monitor.drawing.map import draw_map
from stickslip_monitor.drawing.palette import (
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
)
from stickslip_monitor.monitor.assessment import Regime
from stickslip_monitor.monitor.config_file import load_config
from stickslip_monitor.report.recording import _SPEED_CAPTION

pytest.importorskip('matplotlib')
CONFIG = load_config(Path(__file__).parents[2] / 'launch_configs' / 'reference_bearing.yaml')


@pytest.fixture(scope='module')
def drawings() -> list[str]:
    return [inline_svg(draw_map(CONFIG.bearings[0]), name, 'a <map> & "more"') for name in 'ab']


def test_pictures_that_share_a_page_share_no_id(drawings: list[str]) -> None:
    first, second = (set(re.findall(r'\bid="([^"]+)"', drawing)) for drawing in drawings)
    assert first
    assert not first & second
    for drawing, ids in zip(drawings, (first, second), strict=True):
        used = re.findall(r'(?:href="|url\()#([^")]+)', drawing)
        assert used
        assert set(used) <= ids


def test_it_is_well_formed_and_refers_to_nothing_outside(drawings: list[str]) -> None:
    root = ElementTree.fromstring(drawings[0])
    assert root.get('role') == 'img'
    assert root.get('aria-label') == 'a <map> & "more"'
    assert not re.search(r'https?:|<style|<metadata|<image|<script', drawings[0])


def test_every_colour_of_the_palette_becomes_a_variable(drawings: list[str]) -> None:
    assert not re.search('|'.join(ON_DARK), drawings[0])
    used = set(re.findall(r'var\((--c[0-9a-f]{6})\)', drawings[0]))
    assert used <= {variable(colour) for colour in ON_DARK}
    assert {variable(INK), variable(PAPER), variable(CAUTION_FILL)} <= used


def test_glyphs_keep_their_size(drawings: list[str]) -> None:
    # matplotlib draws a glyph in 1/64 of its size; rounding that factor would shrink all words.
    assert 'scale(0.015625)' in drawings[0]


def luminance(colour: str) -> float:
    parts = np.array([int(colour[i : i + 2], 16) / 255.0 for i in (1, 3, 5)])
    linear = np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)
    return float(linear @ [0.2126, 0.7152, 0.0722])


def contrast(one: str, other: str) -> float:
    """The ratio of WCAG 2: 4.5 for text, 3 for graphics."""
    high, low = sorted((luminance(one), luminance(other)), reverse=True)
    return (high + 0.05) / (low + 0.05)


def test_a_dark_page_has_a_colour_for_each_and_enough_contrast() -> None:
    palette = {*REGIME_COLOUR.values(), *REGIME_FILL.values(), *CONDITION_COLOUR.values()}
    assert palette | {INK, MUTED, PAPER, CAUTION_FILL, HOPF, FOLD} == set(ON_DARK)
    fills = [ON_DARK[fill] for fill in (*REGIME_FILL.values(), CAUTION_FILL, PAPER)]
    assert min(contrast(ON_DARK[INK], fill) for fill in fills) > 7.0
    assert min(contrast(ON_DARK[MUTED], fill) for fill in fills) > 4.5
    marks = [ON_DARK[mark] for mark in CONDITION_COLOUR.values()]
    assert min(contrast(mark, fill) for mark in marks for fill in fills) > 3.0


@pytest.mark.parametrize('dark', [False, True])
def test_boundaries_are_seen_on_all_fills_and_captions_name_their_hues(dark: bool) -> None:
    def shown(colour: str) -> str:
        return ON_DARK[colour] if dark else colour

    fills = {regime: shown(fill) for regime, fill in REGIME_FILL.items()}
    for line in (HOPF, FOLD):
        assert min(contrast(shown(line), fill) for fill in fills.values()) > 4.5
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


@given(
    st.lists(
        st.lists(st.tuples(st.floats(-500, 500), st.floats(-500, 500)), min_size=1, max_size=9),
        min_size=1, max_size=3,
    ),
    st.booleans(),
)  # fmt: skip
def test_a_path_in_steps_leads_to_the_same_places(
    lines: list[list[tuple[float, float]]], closed: bool
) -> None:
    end = ' z' if closed else ''
    written = '\n'.join(
        ' \n'.join(f'{"L" if k else "M"} {x:.6f} {y:.6f}' for k, (x, y) in enumerate(line)) + end
        for line in lines
    )
    found: list[list[tuple[float, float]]] = []
    for part in _shorter(written).split('M')[1:]:
        head, _, steps = part.replace('z', '').partition('l')
        places = re.findall(r'-?[\d.]+', head) + re.findall(r'-?(?:\d+\.?\d*|\.\d+)', steps)
        pairs = list(zip(*([iter(map(float, places))] * 2), strict=True))
        found.append([(sum(x for x, _ in pairs[: k + 1]), sum(y for _, y in pairs[: k + 1]))
                      for k in range(len(pairs))])  # fmt: skip
    for line, got in zip(lines, found, strict=True):
        tenths = [(round(10 * float(f'{x:.6f}')), round(10 * float(f'{y:.6f}'))) for x, y in line]
        kept = [place for k, place in enumerate(tenths) if not k or place != tenths[k - 1]]
        assert [(round(10 * x), round(10 * y)) for x, y in got] == kept
