# SPDX-License-Identifier: Apache-2.0
"""Several figures one below the other in one PNG, with words above them."""

from __future__ import annotations

import io
import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from stickslip_monitor.drawing.canvas import WIDTH, new_figure, style
from stickslip_monitor.drawing.palette import INK, MUTED

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_DPI = 150
_LINE = 0.22
_LETTERS = 105


Pixels = NDArray[np.uint8]


def sheet(rows: Sequence[Pixels]) -> bytes:
    """Put drawn figures below each other.

    Args:
        rows: At least one; see :func:`drawn`.

    Returns:
        The picture as PNG.
    """
    width = max(row.shape[1] for row in rows)
    with style():
        from matplotlib.image import imsave

        file = io.BytesIO()
        imsave(file, np.concatenate([_widened(row, width) for row in rows]), metadata={})
    return file.getvalue()


def heading(title: str, lines: Sequence[str] = ()) -> Figure:
    """A figure of words alone: a title and the lines below it, wrapped to the width."""
    wrapped = [
        *((part, 'bold', INK) for part in textwrap.wrap(title, _LETTERS - 15)),
        *((part, 'normal', MUTED) for line in lines for part in textwrap.wrap(line, _LETTERS)),
    ]
    with style():
        figure = new_figure(WIDTH, _LINE * (len(wrapped) + 2))
        for number, (part, weight, colour) in enumerate(wrapped):
            figure.text(
                0.25 / WIDTH, 1.0 - (number + 1.2) / (len(wrapped) + 2), part,
                size=12.0 if weight == 'bold' else 10.0, weight=weight, color=colour, va='center',
                parse_math=False,
            )  # fmt: skip
        return figure


def drawn(figure: Figure) -> Pixels:
    """The pixels of a figure, shape (height, width, 3)."""
    with style():
        figure.set_dpi(_DPI)
        canvas: Any = figure.canvas
        canvas.draw()
        return np.array(canvas.buffer_rgba())[:, :, :3]


def _widened(picture: Pixels, width: int) -> Pixels:
    """The picture with white at its right."""
    room = ((0, 0), (0, width - picture.shape[1]), (0, 0))
    return np.pad(picture, room, constant_values=255)
