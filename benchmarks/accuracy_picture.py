# SPDX-License-Identifier: Apache-2.0
"""Draws what accuracy costs in time: error against time, with the Pareto front."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.accuracy import BASE, TYPICAL, Row, footnote, pareto, summarise
from stickslip_monitor.drawing import canvas

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
_SMALLEST, _FAILED = 1e-16, 30.0
_LOWEST, _HIGHEST = 3e-17, 100.0
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


def draw_accuracy(rows: Sequence[Row]) -> canvas.Figure:
    """Draw error against time in two panels beside each other."""
    panels = _panels(rows)
    every = [mark for marks in panels.values() for mark in marks]
    families = list(dict.fromkeys(mark.family for mark in every))
    looks = {family: _LOOKS[i % len(_LOOKS)] for i, family in enumerate(families)}
    times = [mark.seconds for mark in every]
    with canvas.style():
        figure = canvas.new_figure(12.0, 7.2)
        figure.subplots(1, len(panels), sharex=True, sharey=True)
        figure.subplots_adjust(left=0.075, right=0.985, bottom=0.215, top=0.95, wspace=0.04)
        for axes, (title, marks) in zip(figure.axes, panels.items(), strict=True):
            axes.set(
                xscale='log',
                yscale='log',
                ylim=(_LOWEST, _HIGHEST),
                xlim=(0.4 * min(times, default=1e-6), 3.0 * max(times, default=1.0)),
                yticks=[10.0**k for k in range(-16, 1, 2)],
                xlabel='time per operating point [s]',
            )
            axes.minorticks_off()
            axes.grid(color='#e6e6e6', lw=0.6)
            axes.axhspan(6.0, _HIGHEST, color='#f0f0f0', lw=0.0)
            axes.set_title(title, loc='left', size=11.0, color=canvas.INK)
            _methods(axes, marks, looks)
        figure.axes[0].set_ylabel('relative error of the amplitude [-]')
        _name_families(figure, looks)
        figure.text(0.985, 0.012, footnote(rows), ha='right', va='bottom', size=9.0, color=canvas.MUTED)
        return figure


def _height(error: float) -> float:
    return _FAILED if math.isinf(error) else float(np.clip(error, _SMALLEST, 5.0))


def _methods(axes: canvas.Axes, marks: Sequence[MethodMark], looks: dict[str, tuple[str, str]]) -> None:
    front = sorted((m for m in marks if m.front), key=lambda m: m.seconds)
    x, y = [m.seconds for m in front], [_height(m.error) for m in front]
    axes.step(x, y, where='post', color=_FRONT, lw=1.4, ls=canvas.DASHES, zorder=2)
    for mark in marks:
        colour, shape = looks[mark.family]
        edge = colour if mark.together else canvas.INK if mark.front else canvas.PAPER
        axes.plot(
            mark.seconds,
            _height(mark.error),
            shape,
            ms=_size(shape),
            mfc=canvas.PAPER if mark.together else colour,
            mec=edge,
            mew=1.4 if mark.front or mark.together else 0.8,
            zorder=4,
        )
    if any(math.isinf(mark.error) for mark in marks):
        axes.text(
            0.012,
            0.988,
            'fails at some case',
            transform=axes.transAxes,
            va='top',
            size=8.5,
            color=canvas.MUTED,
        )


def _size(shape: str) -> float:
    return 13.0 if shape == '*' else 8.5


def _name_families(figure: canvas.Figure, looks: dict[str, tuple[str, str]]) -> None:
    from matplotlib.lines import Line2D

    rows: list[tuple[str, dict[str, Any]]] = [
        (name, {'marker': shape, 'ls': '', 'ms': _size(shape), 'mfc': colour, 'mec': canvas.PAPER})
        for name, (colour, shape) in looks.items()
    ]
    hollow = {'marker': 'o', 'ls': '', 'ms': 8.0, 'mfc': canvas.PAPER, 'mec': canvas.INK}
    rows.append(('many points at once', hollow))
    line = {'color': _FRONT, 'lw': 1.4, 'ls': canvas.DASHES}
    rows.append(('Pareto front, one point at a time', line))
    handles = [Line2D([], [], label=name, **look) for name, look in rows]
    canvas.legend_below(figure, 5, 0.075, 0.045, handles=handles)


def _panels(rows: Sequence[Row]) -> dict[str, list[MethodMark]]:
    """The typical case, and the worst of all cases."""
    typical = [row for row in rows if row.case == TYPICAL and row.outcome != 'refused']
    one = [(row.family, row.points, row.seconds, abs(row.error)) for row in typical]
    every = [
        (s.family, s.points, s.seconds, s.worst)
        for s in summarise(rows, BASE.name)
        if s.answered and s.refused <= 1
    ]
    count = len({row.case for row in rows if row.method == BASE.name})
    return {
        f'{TYPICAL}: the middle of the unstable range': _marks(one),
        f'worst of {count} cases, median time': _marks(every),
    }


def _marks(points: list[tuple[str, int, float, float]]) -> list[MethodMark]:
    errors = [e if math.isfinite(e) else math.inf for *_, e in points]
    front = pareto([t if count == 1 else math.nan for _, count, t, _ in points], errors)
    return [
        MethodMark(family, seconds, errors[i], i in front, count > 1)
        for i, (family, count, seconds, _) in enumerate(points)
    ]
