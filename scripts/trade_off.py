# SPDX-License-Identifier: Apache-2.0
"""Draws what is lost against what is false, along the values of each parameter of the alarm."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from stickslip_monitor.drawing.canvas import INK, MUTED, PAPER, legend_above, new_figure, style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Colour, marker, and how far above the points their values are written [pt].
_LOOKS = (('#0072b2', 'o', 12.0), ('#d55e00', 's', -12.0))
_SIZE = (11.0, 5.2)
# Below it a logarithmic axis becomes linear, so that nothing false has a place.
_LINEAR = 1.0
# The axis of what is lost reaches this at least [%].
_LEAST_TOP = 1.0
# Width of a letter of a label [pixels].
_LETTER = 7.0


@dataclass(frozen=True, slots=True)
class Curve:
    """The course of two rates along the values of one parameter."""

    label: str  # what varies
    values: Sequence[str]  # as written beside each point
    false: Sequence[float]  # the rate of false alarms at each
    lost: Sequence[float]  # the share of what is lost at each, 0 to 1
    default: int  # index of the value that is the default


@dataclass(frozen=True, slots=True)
class TradeOff:
    """One panel: title, labels of the axes, curves, and single rules (label, false, lost)."""

    title: str
    false: str
    lost: str
    curves: Sequence[Curve]
    rules: Sequence[tuple[str, float, float]] = ()


def draw_trade_offs(panels: Sequence[TradeOff]) -> Figure:
    """Draw panels beside each other.

    Returns:
        A figure that pyplot does not know of; :func:`~.canvas.save_figure` writes it.

    Raises:
        DrawingError: matplotlib is not installed.
    """
    with style():
        figure = new_figure(*_SIZE)
        figure.subplots(1, len(panels))
        figure.subplots_adjust(left=0.075, right=0.985, top=0.82, bottom=0.12, wspace=0.22)
        for axes, panel in zip(figure.axes, panels, strict=True):
            _draw_panel(axes, panel)
    return figure


def _draw_panel(axes: Axes, panel: TradeOff) -> None:
    look: dict[str, Any] = {'ls': '', 'clip_on': False, 'zorder': 5}
    for curve, (colour, marker, _) in zip(panel.curves, _LOOKS, strict=False):
        axes.plot(
            curve.false,
            _to_percent(curve.lost),
            color=colour,
            marker=marker,
            ms=6.0,
            lw=1.2,
            label=curve.label,
            clip_on=False,
            zorder=3,
        )
    for number, curve in enumerate(panel.curves):
        at = curve.false[curve.default], _to_percent(curve.lost)[curve.default]
        label = 'default' if not number else '_'
        axes.plot(*at, 'o', ms=13.0, mfc='none', mec=INK, mew=1.2, label=label, **look)
    for (label, x, y), marker in zip(panel.rules, ('x', '+'), strict=False):
        axes.plot(x, 100.0 * y, marker, ms=9.0, mew=1.6, color=MUTED, label=label, **look)
    axes.set(xlabel=panel.false, ylabel=panel.lost)
    axes.set_xscale('symlog', linthresh=_LINEAR)
    axes.set_xlim(-0.1, 2.0 * max(axes.get_xlim()[1], _LINEAR))
    top = max(axes.get_ylim()[1], _LEAST_TOP)
    axes.set_ylim(-0.08 * top, 1.08 * top)
    for curve, (colour, _, height) in zip(panel.curves, _LOOKS, strict=False):
        _name_values(axes, curve, colour, height)
    axes.text(0.0, 1.16, panel.title, transform=axes.transAxes, size=11.0, weight='bold')
    legend_above(axes, 3)
    axes.spines[['top', 'right']].set_visible(False)


def _to_percent(shares: Sequence[float]) -> list[float]:
    return [100.0 * share for share in shares]


def _name_values(axes: Axes, curve: Curve, colour: str, height: float) -> None:
    """Write the values beside the points, those of points that are close together in one label."""
    from matplotlib.patheffects import withStroke

    points = axes.transData.transform(list(zip(curve.false, _to_percent(curve.lost), strict=True)))
    groups: list[list[int]] = []
    for k in sorted(range(len(points)), key=lambda k: tuple(points[k])):
        room = _LETTER * len(_join_values(curve, groups[-1])) + 10.0 if groups else 0.0
        if groups and np.all(np.abs(points[k] - points[groups[-1][0]]) < (room, 2.0 * _LETTER)):
            groups[-1].append(k)
        else:
            groups.append([k])
    for group in groups:
        place = curve.false[group[0]], 100.0 * curve.lost[group[0]]
        axes.annotate(
            _join_values(curve, group),
            place,
            (4.0, height),
            textcoords='offset points',
            color=colour,
            size=9.0,
            va='center',
            annotation_clip=False,
            zorder=3.5,
            path_effects=[withStroke(linewidth=2.0, foreground=PAPER)],
        )


def _join_values(curve: Curve, group: Sequence[int]) -> str:
    return ', '.join(curve.values[k] for k in sorted(group))
