# SPDX-License-Identifier: Apache-2.0
"""matplotlib, imported here only: figures without global state, and their files.

matplotlib is an extra; it is imported when a picture is drawn, not before. Figures are not
registered with pyplot, so none has to be closed. They are written as PNG or SVG, or put into a
page as inline SVG with the page's colours and unique ids.

The hues of regimes and conditions are those of Okabe and Ito, which people with any common colour
blindness can tell apart; caution is a dark yellow, because green means that all is well (IEC
60073). In a grey print fills and conditions get darker with trouble: steps of at least 4 in the
lightness L* of CIE 1976, twice the difference that is seen at a glance where they meet.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from stickslip_monitor.arrays import IndexArray
from stickslip_monitor.errors import DrawingError, cause
from stickslip_monitor.monitor.assessment import Regime
from stickslip_monitor.monitor.severity import Condition
from stickslip_monitor.safe_files import PICTURES, write_whole

if TYPE_CHECKING:
    from matplotlib.axes import Axes as Axes
    from matplotlib.figure import Figure as Figure
else:
    Axes = Figure = Any

Look = dict[str, Any]
"""Keyword arguments of matplotlib."""

INK = '#222222'
MUTED = '#525252'
PAPER = '#ffffff'

REGIME_COLOUR = {
    Regime.STABLE: '#0072b2',
    Regime.BISTABLE: '#e69f00',
    Regime.UNSTABLE: '#d55e00',
    Regime.UNDETERMINED: '#8c8c8c',
}
"""Strong colours, for lines, marks and words on white."""

HOPF, FOLD = '#913900', '#6e4b00'
"""The two boundaries, as lines on any of the fills; the fold is dashed (:data:`DASHES`)."""

DASHES = (0, (4.5, 2.2))
"""Offset, and lengths of a dash and a gap [line widths]."""

BOUNDARY_LINES: dict[str, tuple[Regime, str, Any]] = {
    'Hopf': (Regime.UNSTABLE, HOPF, '-'),
    'fold': (Regime.BISTABLE, FOLD, DASHES),
}
"""Of each boundary the regime that begins there, and its line's colour and dashes."""

REGIME_FILL = {
    Regime.STABLE: '#f5fafe',
    Regime.BISTABLE: '#f7dc9c',
    Regime.UNSTABLE: '#f4bfab',
    Regime.UNDETERMINED: '#d9d9d9',
}
"""Light colours, for areas behind lines and dark text."""

CAUTION_FILL = '#f4efb1'
"""The stable stretch next to the fold in which the alarm says caution."""

CONDITION_COLOUR = {
    Condition.NORMAL: '#2b9ee1',
    Condition.VIBRATION: '#937eca',
    Condition.CAUTION: '#927e00',
    Condition.BISTABLE: '#a06500',
    Condition.STICK_SLIP: '#a74300',
    Condition.AMPLITUDE: '#62194a',
    Condition.INPUT_STALE: '#525252',
}
"""Strong colours, for marks on any of the fills and under white words."""

CONDITION_NAMES = {
    Condition.NORMAL: 'Normal',
    Condition.VIBRATION: 'Vibration not explained',
    Condition.CAUTION: 'Margin low',
    Condition.BISTABLE: 'Bistable',
    Condition.STICK_SLIP: 'Stick-slip predicted',
    Condition.AMPLITUDE: 'Amplitude above limit',
    Condition.INPUT_STALE: 'Input lost',
}
"""Each condition as people read it, everywhere (docs/glossary.md)."""

ON_DARK = {
    PAPER: '#16191d',
    INK: '#e8eaed',
    MUTED: '#a9b0b8',
    '#0072b2': '#56b4e9',
    '#e69f00': '#f0b429',
    '#d55e00': '#ff8f4d',
    '#2b9ee1': '#55b3e8',
    '#937eca': '#b9a5f2',
    '#927e00': '#e0cc3f',
    '#a06500': '#f0b32a',
    '#a74300': '#ff8f4e',
    '#62194a': '#e58fc6',
    '#8c8c8c': '#9aa0a6',
    HOPF: '#ffb08a',
    FOLD: '#ffd97a',
    '#f5fafe': '#16212b',
    CAUTION_FILL: '#2e2c10',
    '#f7dc9c': '#4a3b12',
    '#f4bfab': '#5a2a17',
    '#d9d9d9': '#33373c',
}
"""What each colour above becomes on a dark page; there the fills get lighter with trouble."""

SOFTWARE = 'stickslip_monitor'
WIDTH, HEIGHT = 9.0, 5.6
"""Size of a picture [inch], if no other is asked for."""
POINTS_PER_INCH = 70
"""Points of a recording that are drawn on an inch, nearly; the others are within their outline."""
_STYLE = {
    'font.family': 'sans-serif',
    'font.sans-serif': ['DejaVu Sans'],
    'font.size': 11.0,
    'axes.edgecolor': MUTED,
    'axes.labelcolor': INK,
    'axes.linewidth': 0.8,
    'xtick.color': MUTED,
    'ytick.color': MUTED,
    'text.color': INK,
    'figure.facecolor': PAPER,
    'axes.facecolor': PAPER,
    'savefig.facecolor': PAPER,
    'lines.linewidth': 2.0,
    'svg.fonttype': 'path',
    'svg.hashsalt': 'stickslip_monitor',
}


@contextmanager
def style() -> Iterator[None]:
    """Apply the style of every picture within a ``with``; matplotlib's settings are restored after it.

    Raises:
        DrawingError: matplotlib is not installed.
    """
    try:
        import matplotlib as mpl
    except ImportError as error:
        raise DrawingError(
            f'drawing needs matplotlib, which cannot be imported ({error}): install the extra'
            " 'report', e.g. pip install 'stickslip_monitor[report]'. A table (.csv) and"
            ' --json need none'
        ) from error
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(_STYLE)  # type: ignore[arg-type]
        yield


def new_figure(width: float = WIDTH, height: float = HEIGHT) -> Figure:
    """Make an empty figure of a width and height [inch], unknown to pyplot; inside :func:`style`."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), dpi=100)
    FigureCanvasAgg(figure)
    return figure


def new_panel(
    x_label: str,
    y_label: str,
    *,
    title: str = '',
    footnote: str = '',
    size: tuple[float, float] = (WIDTH, HEIGHT),
    box: tuple[float, float, float, float] = (0.085, 0.125, 0.89, 0.81),
) -> tuple[Figure, Axes]:
    """Make a figure with one panel, its title above and a footnote below; inside :func:`style`.

    Size is width and height [inch], the box left, bottom, width and height of the panel, as parts
    of the figure.
    """
    figure = new_figure(*size)
    axes = figure.add_axes(box)
    axes.set_xlabel(x_label)
    axes.set_ylabel(y_label)
    axes.set_title(title, loc='left', size=11.0, color=INK)
    figure.text(0.985, 0.012, footnote, ha='right', va='bottom', size=9.0, color=MUTED)
    return figure, axes


_LEGEND: Look = {
    'loc': 'lower left',
    'frameon': False,
    'fontsize': 9.5,
    'handlelength': 2.2,
    'handletextpad': 0.5,
    'borderaxespad': 0.2,
}


def legend_below(
    figure: Figure, columns: int, left: float = 0.085, bottom: float = 0.005, **more: Any
) -> None:
    """Add a legend of several columns below all panels; left and bottom are parts of the figure.

    ``more`` goes to ``Figure.legend``.
    """
    look = _LEGEND | {'bbox_to_anchor': (left, bottom), 'columnspacing': 1.4, 'labelspacing': 0.35}
    for patch in figure.legend(ncols=columns, **look, **more).get_patches():
        patch.set(edgecolor=MUTED, linewidth=0.5)


def legend_above(axes: Axes, columns: int, **more: Any) -> None:
    """Add a legend of a panel's curves along its upper edge; ``more`` goes to ``Axes.legend``."""
    look = _LEGEND | {'bbox_to_anchor': (-0.008, 1.0), 'columnspacing': 1.1}
    axes.legend(ncols=columns, **look | more)


def draw_regime_bands(axes: Axes, spans: Iterable[tuple[float, float, Regime]]) -> None:
    """Fill stretches of the x axis, each from, to and regime, and name them at the top of the panel.

    Narrow ones have their name upright, the narrowest none. The limits of the axes must be final.
    """
    top = axes.get_ylim()[1]
    for low, high, regime in spans:
        axes.axvspan(low, high, color=REGIME_FILL[regime], lw=0.0, zorder=0)
        left, right = axes.transData.transform([(low, 0.0), (high, 0.0)])[:, 0]
        # A word takes 15 pixels upright and 75 across.
        if right - left > 15.0:
            middle = 0.5 * (low + high), top
            look: Look = {'ha': 'center', 'va': 'top', 'style': 'italic', 'zorder': 12}
            look['rotation'] = 0.0 if right - left > 75.0 else 90.0
            axes.annotate(regime.value, middle, (0.0, -6.0), textcoords='offset points', **look)


def envelope(max_points: int, *columns: Any) -> IndexArray:
    """Choose the points of a recording to draw, so that the line keeps its outline.

    The points are taken in blocks of one length; of each block stay the least and the greatest
    value of every column, at its own instant, and an interruption. The first and the last point stay.

    Args:
        max_points: Points to draw, nearly; a shorter recording stays as it is.
        columns: Values, each of shape (n,); ``nan`` interrupts the line.

    Returns:
        Indices in rising order, about ``max_points`` of them at most.
    """
    size = columns[0].size
    blocks = max(1, max_points // (3 * len(columns)))
    if size <= max(max_points, blocks):
        return np.arange(size)
    length = -(-size // blocks)
    start = np.arange(0, size, length)
    parts = [np.array([0, size - 1])]
    for column in columns:
        padded = np.append(column, np.full(start.size * length - size, np.nan)).astype(float)
        table = padded.reshape(start.size, length)
        missing = np.isnan(table)
        parts += [
            start + np.where(missing, np.inf, table).argmin(axis=1),
            start + np.where(missing, -np.inf, table).argmax(axis=1),
            (start + missing.argmax(axis=1))[missing.any(axis=1)],
        ]
    rows = np.unique(np.concatenate(parts))
    return rows[rows < size]


def save_figure(figure: Figure, path: str | Path, force: bool = False) -> None:
    """Write a figure as PNG or SVG, by the path's suffix; the same figure gives the same bytes.

    A picture of ours that is there is replaced; any other file only by ``force``.

    Raises:
        DrawingError: The suffix is unknown or the file cannot be written.
        OutputError: A file that is not ours is there.
    """
    suffix = Path(path).suffix.lower()
    mark = PICTURES.get(suffix)
    if mark is None:
        raise DrawingError(
            f"picture '{path}' must end in {' or '.join(PICTURES)}: the ending chooses the format"
        )
    named = {'Date': None, 'Creator': SOFTWARE} if suffix == '.svg' else {'Software': SOFTWARE}
    file = io.BytesIO()
    with style():
        figure.savefig(file, format=suffix[1:], dpi=200, metadata=named)
    with _translate_os_errors(path):
        write_whole(path, file.getvalue(), mark, force=force)


def write_csv(columns: Mapping[str, Iterable[Any]], path: str | Path, force: bool = False) -> None:
    """Write named columns of one length as CSV: full precision, empty where there is no number.

    A file with the same headings is replaced; any other only by ``force``.

    Raises:
        DrawingError: The file cannot be written.
        OutputError: A file that is not ours is there.
    """
    rows = zip(*(np.asarray(column).tolist() for column in columns.values()), strict=True)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator='\n')
    writer.writerow(columns)
    headings = text.getvalue().encode()
    writer.writerows(['' if v != v else str(v) for v in row] for row in rows)
    with _translate_os_errors(path):
        write_whole(path, text.getvalue().encode(), headings, force=force)


@contextmanager
def _translate_os_errors(path: str | Path) -> Iterator[None]:
    """Raise DrawingError, which names the path, for an OSError within."""
    try:
        yield
    except OSError as error:
        raise DrawingError(f'{path}: {cause(error)}') from error


_IDS = re.compile(r'(\bid="|href="#|url\(#)')
_COLOUR = re.compile('|'.join(ON_DARK))
_PATH = re.compile(r'(?<= d=")[^"]+')
_DECIMALS = re.compile(r'\.(\d)\d+')
_HEAD = re.compile(r'<svg [^>]*viewBox="([^"]*)"[^>]*>')


def inline_svg(figure: Figure, name: str, text: str) -> str:
    """Return a figure as an ``svg`` element to be put into a page.

    The colours of the palette are variables (:func:`css_variable`) that the page sets, so that a dark
    page has a dark picture. Paths are cut to a tenth of a point.

    Args:
        figure: The figure.
        name: Put before every id, so that several pictures can share a page.
        text: What the picture shows, for those who do not see it.

    Raises:
        DrawingError: matplotlib is not installed.
    """
    file = io.StringIO()
    with style():
        figure.savefig(file, format='svg', metadata={'Date': None, 'Creator': None})
    drawing = file.getvalue()
    drawing = re.sub(r'<metadata>.*?</metadata>', '', drawing, flags=re.DOTALL)
    (box,) = _HEAD.findall(drawing)
    body = drawing[drawing.index('<defs>') : drawing.rindex('</svg>')]
    body = re.sub(r'<style.*?</style>', '', body, flags=re.DOTALL)
    body = _IDS.sub(lambda match: f'{match[0]}{name}-', body)
    # Tenths of a point are finer than any screen shows.
    body = _PATH.sub(lambda path: _DECIMALS.sub(r'.\1', path[0].replace(' \n', '')), body)
    body = body.replace('xlink:href', 'href')
    body = _COLOUR.sub(lambda match: f'var({css_variable(match[0])})', body)
    body = re.sub(r'\n\s*', '\n', body)
    return f'<svg viewBox="{box}" role="img" aria-label="{escape(text)}">{body}</svg>'


def css_variable(colour: str) -> str:
    """Return the CSS variable that holds a colour: ``--c0072b2`` for ``#0072b2``."""
    return f'--c{colour[1:]}'
