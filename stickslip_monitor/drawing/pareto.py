# SPDX-License-Identifier: Apache-2.0
"""Draws error against time, with the Pareto front."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from stickslip_monitor.drawing.canvas import (
    DASHES,
    INK,
    MUTED,
    PAPER,
    legend_below,
    new_figure,
    style,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Okabe and Ito's hues and black; a marker of its own tells each family apart in grey.
_LOOKS = (
    ('#0072b2', 'o'),
    ('#56b4e9', 'v'),
    ('#d55e00', 'P'),
    ('#e69f00', 's'),
    ('#cc79a7', 'X'),
    ('#8c8c8c', '^'),
    ('#009e73', 'D'),
    ('#000000', '*'),
    ('#7a1f5c', 'h'),
)
_FLOOR, _FAILED = 1e-16, 30.0
_LEAST, _MOST = 3e-17, 100.0
_FRONT = '#444444'


@dataclass(frozen=True, slots=True)
class MethodMark:
    """A method in a panel."""

    family: str  # groups marks by colour and shape
    seconds: float  # time per operating point [s]
    error: float  # relative error [-]; infinite where it fails
    front: bool  # whether no other method beats it
    # Whether many points were solved in one call; such marks are drawn hollow.
    together: bool = False


def draw_pareto(panels: Mapping[str, Sequence[MethodMark]], footnote: str = '') -> Figure:
    """Draw panels beside each other, on common axes, each with its title.

    Returns:
        A figure that pyplot does not know of; :func:`~.canvas.save_figure` writes it.

    Raises:
        DrawingError: matplotlib is not installed.
    """
    every = [mark for marks in panels.values() for mark in marks]
    families = list(dict.fromkeys(mark.family for mark in every))
    looks = {family: _LOOKS[i % len(_LOOKS)] for i, family in enumerate(families)}
    times = [mark.seconds for mark in every]
    with style():
        figure = new_figure(12.0, 7.2)
        figure.subplots(1, len(panels), sharex=True, sharey=True)
        figure.subplots_adjust(left=0.075, right=0.985, bottom=0.215, top=0.95, wspace=0.04)
        for axes, (title, marks) in zip(figure.axes, panels.items(), strict=True):
            axes.set(
                xscale='log', yscale='log', ylim=(_LEAST, _MOST),
                xlim=(0.4 * min(times, default=1e-6), 3.0 * max(times, default=1.0)),
                yticks=[10.0**k for k in range(-16, 1, 2)],
                xlabel='time per operating point [s]',
            )  # fmt: skip
            axes.minorticks_off()
            axes.grid(color='#e6e6e6', lw=0.6)
            axes.axhspan(6.0, _MOST, color='#f0f0f0', lw=0.0)
            axes.set_title(title, loc='left', size=11.0, color=INK)
            _marks(axes, marks, looks)
        figure.axes[0].set_ylabel('relative error of the amplitude [-]')
        _legend(figure, looks)
        figure.text(0.985, 0.012, footnote, ha='right', va='bottom', size=9.0, color=MUTED)
        return figure


def _height(error: float) -> float:
    return _FAILED if math.isinf(error) else float(np.clip(error, _FLOOR, 5.0))


def _marks(axes: Axes, marks: Sequence[MethodMark], looks: dict[str, tuple[str, str]]) -> None:
    front = sorted((m for m in marks if m.front), key=lambda m: m.seconds)
    x, y = [m.seconds for m in front], [_height(m.error) for m in front]
    axes.step(x, y, where='post', color=_FRONT, lw=1.4, ls=DASHES, zorder=2)
    for mark in marks:
        colour, shape = looks[mark.family]
        edge = colour if mark.together else INK if mark.front else PAPER
        axes.plot(
            mark.seconds, _height(mark.error), shape, ms=_size(shape),
            mfc=PAPER if mark.together else colour, mec=edge,
            mew=1.4 if mark.front or mark.together else 0.8, zorder=4,
        )  # fmt: skip
    if any(math.isinf(mark.error) for mark in marks):
        axes.text(
            0.012, 0.988, 'fails at some case', transform=axes.transAxes, va='top', size=8.5,
            color=MUTED,
        )  # fmt: skip


def _size(shape: str) -> float:
    return 13.0 if shape == '*' else 8.5


def _legend(figure: Figure, looks: dict[str, tuple[str, str]]) -> None:
    from matplotlib.lines import Line2D

    rows: list[tuple[str, dict[str, Any]]] = [
        (name, {'marker': shape, 'ls': '', 'ms': _size(shape), 'mfc': colour, 'mec': PAPER})
        for name, (colour, shape) in looks.items()
    ]
    hollow = {'marker': 'o', 'ls': '', 'ms': 8.0, 'mfc': PAPER, 'mec': INK}
    rows.append(('many points at once', hollow))
    line = {'color': _FRONT, 'lw': 1.4, 'ls': DASHES}
    rows.append(('Pareto front, one point at a time', line))
    handles = [Line2D([], [], label=name, **look) for name, look in rows]
    legend_below(figure, 5, 0.075, 0.045, handles=handles)
