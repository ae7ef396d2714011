# SPDX-License-Identifier: Apache-2.0
"""Figures as SVG inside a page: its colours, no file of its own, and no id twice."""

from __future__ import annotations

import io
import re
from html import escape
from typing import TYPE_CHECKING

from stickslip_monitor.drawing.canvas import style
from stickslip_monitor.drawing.palette import ON_DARK

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_IDS = re.compile(r'(\bid="|href="#|url\(#)')
_COLOUR = re.compile('|'.join(ON_DARK))
_PATH = re.compile(r'(?<= d=")[^"]+')
_DECIMALS = re.compile(r'\.(\d)\d+')
_HEAD = re.compile(r'<svg [^>]*viewBox="([^"]*)"[^>]*>')


def inline_svg(figure: Figure, name: str, text: str) -> str:
    """A figure as an ``svg`` element to be put into a page.

    Args:
        figure: The figure.
        name: Put before every id, so that several pictures can share a page.
        text: What the picture shows, for those who do not see it.

    Returns:
        The element. The colours of the palette are variables (:func:`variable`) that the page
        sets, so that a dark page has a dark picture.
    """
    file = io.StringIO()
    with style():
        figure.savefig(file, format='svg', metadata={'Date': None, 'Creator': None})
    drawing = file.getvalue()
    drawing = re.sub(r'<metadata>.*?</metadata>', '', drawing, flags=re.DOTALL)
    (box,) = _HEAD.findall(drawing)
    body = drawing[drawing.index('<defs>') : drawing.rindex('</svg>')]
    body = re.sub(r'<style.*?</style>', '', body, flags=re.DOTALL)
    body = _IDS.sub(lambda found: f'{found[0]}{name}-', body)
    # A tenth of a point is finer than any screen shows; more digits double the page.
    body = _PATH.sub(lambda path: _DECIMALS.sub(r'.\1', path[0]), body)
    body = body.replace('xlink:href', 'href')
    body = _COLOUR.sub(lambda found: f'var({variable(found[0])})', body)
    body = re.sub(r'\n\s*', '\n', body)
    return f'<svg viewBox="{box}" role="img" aria-label="{escape(text)}">{body}</svg>'


def variable(colour: str) -> str:
    """The name of the variable that holds a colour of the palette."""
    return f'--c{colour[1:]}'
