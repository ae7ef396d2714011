# SPDX-License-Identifier: Apache-2.0
"""The one door to matplotlib: figures without global state, and the files they are written to.

matplotlib is an extra; it is imported when a picture is asked for and not before. No figure is
registered with pyplot, so there is none to close: one that is no longer used is gone.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from stickslip_monitor.drawing.palette import INK, MUTED, PAPER
from stickslip_monitor.errors import DrawingError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SUFFIXES = ('.png', '.svg', '.csv')
WIDTH, HEIGHT = 9.0, 5.6
_DPI = 200
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
    """The style of every picture, for as long as it is drawn.

    Raises:
        DrawingError: matplotlib is not installed.
    """
    try:
        import matplotlib as mpl
    except ImportError as error:
        raise DrawingError(
            f'drawing needs matplotlib, which cannot be imported ({error}): install the extra'
            " 'report', e.g. pip install 'stickslip_monitor[report]', or write a .csv"
        ) from error
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(_STYLE)  # type: ignore[arg-type]
        yield


def new_figure(width: float = WIDTH, height: float = HEIGHT) -> Figure:
    """An empty figure that belongs to nobody else; to be called inside :func:`style`.

    Args:
        width: Its width [inch].
        height: Its height [inch].
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), dpi=100)
    FigureCanvasAgg(figure)
    return figure


def checked_suffix(path: str | Path) -> str:
    """The suffix of an output path, in lower case.

    Raises:
        DrawingError: It is none of those that can be written.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in SUFFIXES:
        raise DrawingError(
            f"output file '{path}' must end in one of {', '.join(SUFFIXES)}: the ending chooses"
            ' the format'
        )
    return suffix


def save_figure(figure: Figure, path: str | Path) -> None:
    """Write a figure as PNG or SVG, by the path's suffix; the same figure gives the same bytes.

    Raises:
        DrawingError: The suffix is unknown or the file cannot be written.
    """
    suffix = checked_suffix(path)
    undated: dict[str, Any] = {'Date': None} if suffix == '.svg' else {}
    with style(), _writing(path):
        figure.savefig(path, format=suffix[1:], dpi=_DPI, metadata=undated)


def write_csv(columns: Mapping[str, Iterable[Any]], path: str | Path) -> None:
    """Write named columns as CSV: numbers to full precision, empty where there is none.

    Args:
        columns: Columns of one length by their headings.
        path: Where to; an existing file is replaced.

    Raises:
        DrawingError: The file cannot be written.
    """
    rows = zip(*(np.asarray(column).tolist() for column in columns.values()), strict=True)
    with _writing(path), Path(path).open('w', encoding='utf-8', newline='') as file:
        writer = csv.writer(file, lineterminator='\n')
        writer.writerow(columns)
        writer.writerows(_cells(row) for row in rows)


def _cells(row: Sequence[Any]) -> list[str]:
    return ['' if isinstance(v, float) and math.isnan(v) else str(v) for v in row]


@contextmanager
def _writing(path: str | Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise DrawingError(f'{path}: {error.strerror or error}') from error
