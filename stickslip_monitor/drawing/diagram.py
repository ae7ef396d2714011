# SPDX-License-Identifier: Apache-2.0
"""Draws the bifurcation diagram: vibration amplitude over shaft speed, at one load."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from stickslip_monitor.drawing.branches import BranchMark, Diagram, MarkKind, bifurcation_diagram
from stickslip_monitor.drawing.canvas import new_figure, span_words, style
from stickslip_monitor.drawing.labels import Labeller, around
from stickslip_monitor.drawing.map_curves import Range, diagram_speeds
from stickslip_monitor.drawing.palette import (
    DASHES,
    FOLD,
    HOPF,
    INK,
    MUTED,
    PAPER,
    REGIME_COLOUR,
    REGIME_FILL,
)
from stickslip_monitor.monitor.assessment import Regime, assess
from stickslip_monitor.monitor.config import BearingConfig
from stickslip_monitor.physics.oscillator import Bearing

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_HEADROOM = 1.2
_BELOW_ZERO = 0.07
_STICK_SLIP = REGIME_COLOUR[Regime.UNSTABLE]
_SLIDING = REGIME_COLOUR[Regime.STABLE]
_ORDER = {MarkKind.HOPF: (1, 4, 0), MarkKind.FOLD: (2, 6, 1, 0, 3, 4, 5, 7)}
_DISTANCES = (9.0, 30.0, 48.0, 66.0, 90.0, 120.0)


def draw_diagram(
    config: BearingConfig, load: float, speeds: Range | None = None, points: int = 400
) -> Figure:
    """Draw the bifurcation diagram of a bearing.

    Args:
        config: The bearing.
        load: Load > 0 [N].
        speeds: Lowest and highest surface speed [m/s]; chosen to show Hopf and fold by default.
        points: Number of evenly spaced speeds.

    Returns:
        A figure that pyplot does not know of; :func:`~.canvas.save_figure` writes it.

    Raises:
        DrawingError: matplotlib is not installed.
    """
    with style():
        bearing = config.bearing
        speeds = speeds or diagram_speeds(bearing, load)
        diagram = bifurcation_diagram(bearing, load, speeds, points)
        figure = new_figure()
        axes = figure.add_axes((0.095, 0.19, 0.88, 0.69))
        _frame(axes, bearing, speeds, _top(diagram))
        _curves(axes, bearing, diagram)
        spans = [
            (s.low / _rpm(bearing), s.high / _rpm(bearing), s.regime.value) for s in diagram.spans
        ]
        span_words(axes, spans)
        _marks(axes, bearing, diagram)
        if not diagram.branches and not np.isfinite(diagram.exact).any():
            _nothing(axes, bearing, diagram)
        figure.legend(
            loc='lower left', bbox_to_anchor=(0.085, 0.005), ncols=3, frameon=False, fontsize=9.5,
            handlelength=2.4, columnspacing=1.6, borderaxespad=0.2,
        )  # fmt: skip
        figure.text(
            0.975, 0.012, f'{config.name}, load {load_text(load)}', ha='right', va='bottom',
            size=9.0, color=MUTED,
        )  # fmt: skip
        return figure


def load_text(load: float) -> str:
    """A load for a person, e.g. ``25 kN``."""
    return f'{load / 1e3:.6g} kN'


def _rpm(bearing: Bearing) -> float:
    return bearing.speed.factor('rpm')


def _top(diagram: Diagram) -> float:
    """Amplitude [mm] that the axes must show."""
    curves = [branch.amplitude for branch in diagram.branches] + [diagram.exact]
    highest = max(float(np.nanmax(curve, initial=0.0)) for curve in curves)
    return (highest or float(diagram.sliding_limit[-1])) * 1e3


def _frame(axes: Axes, bearing: Bearing, speeds: Range, top: float) -> None:
    rpm = _rpm(bearing)
    axes.set_xlim(speeds[0] / rpm, speeds[1] / rpm)
    axes.set_ylim(-_BELOW_ZERO * top, _HEADROOM * top)
    axes.set_xlabel('shaft speed [rpm]')
    axes.set_ylabel('displacement amplitude [mm]')
    both_ways = (lambda x: np.multiply(x, rpm), lambda x: np.divide(x, rpm))
    metres = axes.secondary_xaxis('top', functions=both_ways)
    metres.set_xlabel('surface speed [m/s]', labelpad=6.0)


def _curves(axes: Axes, bearing: Bearing, diagram: Diagram) -> None:
    """Draw everything but words: the exact cycle wide, what averaging has of it narrow."""
    rpm = _rpm(bearing)
    x = diagram.speed / rpm
    for span in diagram.spans:
        axes.axvspan(
            span.low / rpm, span.high / rpm, color=REGIME_FILL[span.regime], lw=0.0, zorder=0
        )
    if np.isfinite(diagram.exact).any():
        axes.plot(
            x, diagram.exact * 1e3, color=_STICK_SLIP, lw=3.4, zorder=4, label='stick-slip, exact'
        )
    named: set[bool] = set()
    for branch in diagram.branches:
        name = 'stick-slip, averaging' if branch.stable else 'threshold (unstable), averaging'
        axes.plot(
            x, branch.amplitude * 1e3, color=INK, lw=1.3 if branch.stable else 1.6, zorder=5,
            ls='-' if branch.stable else DASHES,
            label='_' if branch.stable in named else name,
        )  # fmt: skip
        named.add(branch.stable)
    _equilibrium(axes, diagram, rpm)
    limit = diagram.sliding_limit * 1e3
    limit = np.where(limit < axes.get_ylim()[1] / _HEADROOM * 1.1, limit, np.nan)
    axes.plot(x, limit, color=MUTED, lw=1.0, ls=':', zorder=2, label='sliding limit a = V')


def _equilibrium(axes: Axes, diagram: Diagram, rpm: float) -> None:
    """The line of steady sliding, dashed where a disturbance grows."""
    hopf = [mark.speed for mark in diagram.marks if mark.kind is MarkKind.HOPF]
    names = {'-': 'steady sliding', DASHES: 'steady sliding, unstable'}
    for low, high in pairwise([diagram.speed[0], *hopf, diagram.speed[-1]]):
        middle = np.interp(0.5 * (low + high), diagram.speed, diagram.growth_rate)
        line: Any = DASHES if middle > 0.0 else '-'
        axes.plot(
            (low / rpm, high / rpm), (0.0, 0.0), color=_SLIDING, ls=line, lw=2.4, zorder=3,
            label=names.pop(line, '_'),
        )  # fmt: skip


def _marks(axes: Axes, bearing: Bearing, diagram: Diagram) -> None:
    """Mark and label the bifurcations, the outermost of each kind first: they stay in a crowd."""
    rpm, labels = _rpm(bearing), Labeller(axes)
    curves = [branch.amplitude for branch in diagram.branches]
    for curve in (*curves, diagram.exact, diagram.sliding_limit, np.zeros_like(diagram.speed)):
        labels.avoid(diagram.speed / rpm, curve * 1e3)
    marks = _with_exact_fold(diagram)
    for mark in marks:
        hollow = mark.kind is MarkKind.HOPF
        axes.plot(
            mark.speed / rpm, mark.amplitude * 1e3, 'o' if hollow else 'D', ms=7.5, zorder=6,
            mec=HOPF if hollow else FOLD, mew=1.4, mfc=PAPER if hollow else FOLD, clip_on=False,
        )  # fmt: skip
        labels.reserve(mark.speed / rpm, mark.amplitude * 1e3)
    for text, xy, order in _mark_words(diagram, marks, rpm):
        places = [around(distance)[k] for distance in _DISTANCES for k in order]
        labels.point(text, xy, places, weight='bold', size=10.0, zorder=13)


def _with_exact_fold(diagram: Diagram) -> Sequence[BranchMark]:
    """The marks; the exact fold stands in where averaging has none."""
    known = np.flatnonzero(np.isfinite(diagram.exact))
    ends = known.size and known[-1] < diagram.speed.size - 1
    if not ends or any(mark.kind is MarkKind.FOLD for mark in diagram.marks):
        return diagram.marks
    last = int(known[-1])
    mark = BranchMark(MarkKind.FOLD, float(diagram.speed[last]), float(diagram.exact[last]))
    return (*diagram.marks, mark)


def _mark_words(
    diagram: Diagram, marks: Sequence[BranchMark], rpm: float
) -> list[tuple[str, tuple[float, float], tuple[int, ...]]]:
    last = {mark.kind: mark for mark in marks}
    found = []
    for mark in (*last.values(), *(m for m in marks if m is not last[m.kind])):
        at = (mark.speed / rpm, mark.amplitude * 1e3)
        text = f'{mark.kind.value.replace("hopf", "Hopf")} {at[0]:.4g} rpm'
        if mark.kind is MarkKind.FOLD and mark is last[mark.kind]:
            exact = f'exact {diagram.exact_fold / rpm:.4g} rpm'
            text += f'\n({exact if mark in diagram.marks else "averaging has none"})'
        found.append((text, at, _ORDER[mark.kind]))
    return found


def _nothing(axes: Axes, bearing: Bearing, diagram: Diagram) -> None:
    """Say why the picture is empty."""
    middle = 0.5 * (diagram.speed[0] + diagram.speed[-1])
    sentence = assess(bearing, middle, diagram.load).outcome.sentence
    axes.text(
        0.04, 0.85, textwrap.fill(sentence, 46), transform=axes.transAxes, va='top',
        linespacing=1.5,
    )  # fmt: skip
