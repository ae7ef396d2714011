# SPDX-License-Identifier: Apache-2.0
"""Draws error against time, with the Pareto front."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from stickslip_monitor.drawing.canvas import new_figure, style
from stickslip_monitor.drawing.labels import Labeller, around
from stickslip_monitor.drawing.palette import INK, MUTED, PAPER

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
_NEAR, _FAR = (9.0, 14.0), (9.0, 14.0, 19.0, 30.0)
_FLOOR, _FAILED = 1e-16, 30.0
_LEAST, _MOST = 3e-17, 100.0
_FRONT = '#444444'


@dataclass(frozen=True, slots=True)
class MethodMark:
    """A method in a panel.

    Attributes:
        label: Short, written at the mark.
        family: Groups marks by colour.
        seconds: Time per operating point [s].
        error: Relative error [-]; infinite where it fails.
        front: Whether no other method beats it.
        together: Whether many points were solved in one call; such marks are drawn hollow.
    """

    label: str
    family: str
    seconds: float
    error: float
    front: bool
    together: bool = False


@dataclass(frozen=True, slots=True)
class Panel:
    """One of the panels: its title and what is in it."""

    title: str
    marks: tuple[MethodMark, ...]


def draw_pareto(panels: tuple[Panel, ...], footnote: str = '') -> Figure:
    """Draw panels beside each other, on common axes.

    Returns:
        A figure that pyplot does not know of; :func:`~.canvas.save_figure` writes it.

    Raises:
        DrawingError: matplotlib is not installed.
    """
    families = list(dict.fromkeys(mark.family for panel in panels for mark in panel.marks))
    looks = {family: _LOOKS[i % len(_LOOKS)] for i, family in enumerate(families)}
    times = [mark.seconds for panel in panels for mark in panel.marks]
    limits = (0.4 * min(times, default=1e-6), 3.0 * max(times, default=1.0))
    with style():
        figure = new_figure()
        figure.set_size_inches(12.0, 7.2)
        width = 0.91 / len(panels)
        for i, panel in enumerate(panels):
            axes = figure.add_axes((0.075 + i * width, 0.215, width - 0.02, 0.735))
            _frame(axes, panel.title, limits, first=i == 0)
            _marks(axes, panel, looks)
        _legend(figure, looks)
        figure.text(0.985, 0.012, footnote, ha='right', va='bottom', size=9.0, color=MUTED)
        return figure


def _frame(axes: Axes, title: str, limits: tuple[float, float], first: bool) -> None:
    axes.set_xscale('log')
    axes.set_yscale('log')
    axes.set_xlim(*limits)
    axes.set_ylim(_LEAST, _MOST)
    axes.set_yticks([10.0**k for k in range(-16, 1, 2)])
    if not first:
        axes.set_yticklabels([])
    axes.minorticks_off()
    axes.grid(color='#e6e6e6', lw=0.6)
    axes.axhspan(6.0, _MOST, color='#f0f0f0', lw=0.0)
    axes.set_xlabel('time per operating point [s]')
    if first:
        axes.set_ylabel('relative error of the amplitude [-]')
    axes.set_title(title, loc='left', size=11.0, color=INK)


def _height(error: float) -> float:
    return _FAILED if math.isinf(error) else float(np.clip(error, _FLOOR, 5.0))


def _marks(axes: Axes, panel: Panel, looks: dict[str, tuple[str, str]]) -> None:
    labeller = Labeller(axes)
    front = sorted((m for m in panel.marks if m.front), key=lambda m: m.seconds)
    x, y = [m.seconds for m in front], [_height(m.error) for m in front]
    axes.step(x, y, where='post', color=_FRONT, lw=1.4, ls=(0, (4.5, 2.2)), zorder=2)
    for mark in panel.marks:
        colour, shape = looks[mark.family]
        axes.plot(
            mark.seconds, _height(mark.error), shape, ms=_size(shape),
            mfc=PAPER if mark.together else colour, mec=_edge(mark, colour),
            mew=1.4 if mark.front or mark.together else 0.8, zorder=4,
        )  # fmt: skip
        labeller.reserve(mark.seconds, _height(mark.error), 7.0)
    if len(x) > 1:
        labeller.avoid(np.repeat(x, 2)[1:], np.repeat(y, 2)[:-1])
    # Crowded marks get no label: colour shows the family, and the table the rest.
    for mark in sorted(panel.marks, key=lambda m: (not m.front, not m.together)):
        if math.isfinite(mark.error):
            near = not (mark.front or mark.together)
            places = tuple(p for far in (_NEAR if near else _FAR) for p in around(far))
            weight = 'bold' if mark.front else 'normal'
            at = (mark.seconds, _height(mark.error))
            labeller.point(mark.label, at, places, size=8.0, weight=weight)
    if any(math.isinf(mark.error) for mark in panel.marks):
        axes.text(
            0.012, 0.988, 'fails at some case', transform=axes.transAxes, va='top', size=8.5,
            color=MUTED,
        )  # fmt: skip


def _size(shape: str) -> float:
    return 13.0 if shape == '*' else 8.5


def _edge(mark: MethodMark, colour: str) -> str:
    return colour if mark.together else INK if mark.front else PAPER


def _legend(figure: Figure, looks: dict[str, tuple[str, str]]) -> None:
    from matplotlib.lines import Line2D

    handles = [
        Line2D(
            [],
            [],
            marker=shape,
            ls='none',
            ms=_size(shape),
            mfc=colour,
            mec=PAPER,
            label=family,
        )
        for family, (colour, shape) in looks.items()
    ]
    handles.append(
        Line2D(
            [], [], marker='o', ls='none', ms=8.0, mfc=PAPER, mec=INK, label='many points at once'
        )
    )
    handles.append(
        Line2D(
            [],
            [],
            color=_FRONT,
            lw=1.4,
            ls=(0, (4.5, 2.2)),
            label='Pareto front, one point at a time',
        )
    )
    figure.legend(
        handles=handles, loc='lower center', bbox_to_anchor=(0.52, 0.04), ncols=5, frameon=False,
        fontsize=9.5,
    )  # fmt: skip
