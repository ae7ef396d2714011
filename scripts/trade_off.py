# SPDX-License-Identifier: Apache-2.0
"""Draws what is lost against what is false, along the values of each parameter of the alarm."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from stickslip_monitor.drawing.canvas import INK, MUTED, new_figure, style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_LOOKS = (('#0072b2', 'o'), ('#d55e00', 's'), ('#009e73', 'D'), ('#cc79a7', '^'))
_SIZE = (11.0, 5.2)
# Below it a logarithmic axis becomes linear, so that nothing false has a place.
_LINEAR = 1.0


@dataclass(frozen=True, slots=True)
class Curve:
    """The course of two rates along the values of one parameter.

    Attributes:
        label: What varies.
        values: Its values, as written beside each point.
        false: The rate of false alarms at each.
        lost: The share of what is lost at each, 0 to 1.
        default: Index of the value that is the default.
    """

    label: str
    values: Sequence[str]
    false: Sequence[float]
    lost: Sequence[float]
    default: int


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
        for axes, panel in zip(
            figure.subplots(1, len(panels), squeeze=False)[0], panels, strict=True
        ):
            _panel(axes, panel)
        figure.subplots_adjust(left=0.075, right=0.985, top=0.92, bottom=0.12, wspace=0.22)
    return figure


def _panel(axes: Axes, panel: TradeOff) -> None:
    for curve, (colour, marker) in zip(panel.curves, _LOOKS, strict=False):
        lost = [100.0 * share for share in curve.lost]
        axes.plot(
            curve.false, lost, color=colour, marker=marker, ms=6.0, lw=1.2, label=curve.label
        )
        axes.plot(
            [curve.false[curve.default]], [lost[curve.default]], marker='o', ms=13.0,
            mfc='none', mec=INK, mew=1.2, ls='', clip_on=False,
        )  # fmt: skip
        for x, y, text in zip(curve.false, lost, curve.values, strict=True):
            axes.annotate(text, (x, y), (5, 5), textcoords='offset points', color=colour, size=9.0)
    for label, x, y in panel.rules:
        axes.plot([x], [100.0 * y], marker='x', ms=8.0, color=MUTED, ls='', clip_on=False)
        beside: dict[str, Any] = {'textcoords': 'offset points', 'ha': 'right'}
        axes.annotate(label, (x, 100.0 * y), (-8, 5), color=MUTED, **beside)
    axes.set_xscale('symlog', linthresh=_LINEAR)
    axes.set_xlim(left=0.0)
    axes.set_ylim(bottom=0.0)
    axes.set_title(panel.title, loc='left', fontsize=11.0, weight='bold')
    axes.set_xlabel(panel.false)
    axes.set_ylabel(panel.lost)
    axes.margins(x=0.08, y=0.12)
    axes.legend(frameon=False, fontsize=9.5)
    for side in ('top', 'right'):
        axes.spines[side].set_visible(False)
