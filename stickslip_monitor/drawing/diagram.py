# SPDX-License-Identifier: Apache-2.0
"""Draws the bifurcation diagram: vibration amplitude over shaft speed, at one load."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from stickslip_monitor.drawing.branches import BranchMark, Diagram, MarkKind, bifurcation_diagram
from stickslip_monitor.drawing.canvas import new_figure, style
from stickslip_monitor.drawing.labels import Labeller, LabelPlace, around
from stickslip_monitor.drawing.map_curves import Range, diagram_speeds
from stickslip_monitor.drawing.palette import (
    DASHES,
    FOLD,
    HOPF,
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

_HEADROOM = 1.3
_BELOW_ZERO = 0.07
_STICK_SLIP = REGIME_COLOUR[Regime.UNSTABLE]
_SLIDING = REGIME_COLOUR[Regime.STABLE]
_SMALL = 9.5
_NARROWEST = 75.0
_NAMES = (
    ('stable', 'stick-slip', (0.45, 0.55, 0.35, 0.25, 0.65, 0.75)),
    ('threshold', 'threshold (unstable)', (0.5, 0.4, 0.6, 0.7, 0.3)),
    ('sliding', 'steady sliding', (0.9, 0.8, 0.1, 0.2, 0.5, 0.3)),
    ('limit', 'sliding limit a = V', (0.91, 0.85, 0.78, 0.2, 0.3, 0.4, 0.5)),
)
"""Each family of curves: its name, its label, and where along the curve that is tried."""

Curve = tuple[NDArray[np.float64], NDArray[np.float64]]


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
        axes = figure.add_axes((0.095, 0.125, 0.88, 0.755))
        _frame(axes, bearing, speeds, _top(diagram))
        curves = _curves(axes, bearing, diagram)
        _words(axes, bearing, diagram, curves)
        figure.text(
            0.975, 0.012, f'{config.name}, load {load_text(load)}, averaged model (KBM)',
            ha='right', va='bottom', size=9.0, color=MUTED,
        )  # fmt: skip
        return figure


def load_text(load: float) -> str:
    """A load for a person, e.g. ``1000 N`` or ``25 kN``."""
    return f'{load / 1e3:.6g} kN' if load >= 1e4 else f'{load:.6g} N'


def _top(diagram: Diagram) -> float:
    """Amplitude [mm] that the axes must show."""
    highest = [np.nanmax(branch.amplitude, initial=0.0) for branch in diagram.branches]
    return float(max(highest, default=diagram.sliding_limit[-1])) * 1e3


def _frame(axes: Axes, bearing: Bearing, speeds: Range, top: float) -> None:
    rpm = bearing.speed.factor('rpm')
    axes.set_xlim(speeds[0] / rpm, speeds[1] / rpm)
    axes.set_ylim(-_BELOW_ZERO * top, _HEADROOM * top)
    axes.set_xlabel('shaft speed [rpm]')
    axes.set_ylabel('displacement amplitude [mm]')
    both_ways = (lambda x: np.multiply(x, rpm), lambda x: np.divide(x, rpm))
    metres = axes.secondary_xaxis('top', functions=both_ways)
    metres.set_xlabel('surface speed [m/s]', labelpad=6.0)


def _curves(axes: Axes, bearing: Bearing, diagram: Diagram) -> dict[str, list[Curve]]:
    """Draw everything but words; return the curves of each name [rpm, mm]."""
    rpm = bearing.speed.factor('rpm')
    x = diagram.speed / rpm
    for span in diagram.spans:
        axes.axvspan(
            span.low / rpm, span.high / rpm, color=REGIME_FILL[span.regime], lw=0.0, zorder=0
        )
    limit = diagram.sliding_limit * 1e3
    axes.plot(x, limit, color=MUTED, lw=1.0, ls=':', zorder=2)
    _equilibrium(axes, x, diagram)
    named: dict[str, list[Curve]] = {name: [] for name, _, _ in _NAMES}
    named |= {'limit': [(x, limit)], 'sliding': [(x, np.zeros_like(x))]}
    for branch in diagram.branches:
        line = '-' if branch.stable else DASHES
        y = branch.amplitude * 1e3
        axes.plot(x, y, color=_STICK_SLIP, ls=line, lw=2.4 if branch.stable else 2.0, zorder=4)
        named['stable' if branch.stable else 'threshold'].append((x, y))
    for mark in diagram.marks:
        hollow = mark.kind is MarkKind.HOPF
        axes.plot(
            mark.speed / rpm, mark.amplitude * 1e3, 'o' if hollow else 'D', ms=7.5, zorder=6,
            mec=HOPF if hollow else FOLD, mew=1.4, mfc=PAPER if hollow else FOLD, clip_on=False,
        )  # fmt: skip
    return named


def _equilibrium(axes: Axes, x: Any, diagram: Diagram) -> None:
    """The line of steady sliding, dashed where a disturbance grows."""
    hopf = [mark.speed for mark in diagram.marks if mark.kind is MarkKind.HOPF]
    edges = [diagram.speed[0], *hopf, diagram.speed[-1]]
    to_x = x[-1] / diagram.speed[-1]
    for low, high in pairwise(edges):
        middle = np.interp(0.5 * (low + high), diagram.speed, diagram.growth_rate)
        line = DASHES if middle > 0.0 else '-'
        ends = (low * to_x, high * to_x)
        axes.plot(ends, (0.0, 0.0), color=_SLIDING, ls=line, lw=2.4, zorder=3)


def _words(axes: Axes, bearing: Bearing, diagram: Diagram, curves: dict[str, list[Curve]]) -> None:
    labels = Labeller(axes)
    for x, y in (curve for family in curves.values() for curve in family):
        labels.avoid(x, y)
    _regimes(labels, bearing, diagram)
    _marks(labels, bearing, diagram.marks)
    for name, text, where in _NAMES:
        if curves[name]:
            size = _SMALL if name == 'limit' else 11.0
            labels.along(text, *_longest(axes, curves[name]), fractions=where, size=size)
    if not diagram.branches:
        _nothing(labels, bearing, diagram)


def _longest(axes: Axes, curves: list[Curve]) -> Curve:
    """The curve that is longest on paper."""

    def length(curve: Curve) -> float:
        steps = np.diff(axes.transData.transform(np.column_stack(curve)), axis=0)
        return float(np.nansum(np.hypot(*steps.T)))

    return max(curves, key=length)


def _regimes(labels: Labeller, bearing: Bearing, diagram: Diagram) -> None:
    """Name the bands along the upper edge, where they are wide enough."""
    rpm = bearing.speed.factor('rpm')
    top = labels.axes.get_ylim()[1]
    for span in diagram.spans:
        low, high = span.low / rpm, span.high / rpm
        left, right = labels.axes.transData.transform([(low, 0.0), (high, 0.0)])[:, 0]
        if right - left > _NARROWEST:
            middle = (0.5 * (low + high), top)
            labels.point(
                span.regime.value,
                middle,
                (LabelPlace(0.0, -6.0, 'center', 'top'),),
                style='italic',
            )


def _marks(labels: Labeller, bearing: Bearing, marks: Sequence[BranchMark]) -> None:
    """Label the bifurcations, the outermost of each kind first: where it is crowded they stay."""
    rpm = bearing.speed.factor('rpm')
    for mark in marks:
        labels.reserve(mark.speed / rpm, mark.amplitude * 1e3)
    last = {mark.kind: mark for mark in marks}
    for mark in (*last.values(), *(m for m in marks if m is not last[m.kind])):
        at = (mark.speed / rpm, mark.amplitude * 1e3)
        order = (1, 4, 0) if mark.kind is MarkKind.HOPF else (2, 6, 1, 0, 3, 4, 5, 7)
        places = [around(d)[k] for d in (9.0, 30.0, 48.0, 66.0, 90.0, 120.0) for k in order]
        name = mark.kind.value.replace('hopf', 'Hopf')
        labels.point(f'{name} {at[0]:.4g} rpm', at, places, weight='bold', size=10.0)


def _nothing(labels: Labeller, bearing: Bearing, diagram: Diagram) -> None:
    """Say why the picture is empty."""
    middle = 0.5 * (diagram.speed[0] + diagram.speed[-1])
    point = assess(bearing, middle, diagram.load)
    sentence = point.outcome.sentence
    if point.exact_fold_speed > 0.0:
        end = point.exact_fold_speed / bearing.speed.factor('rpm')
        to = f'up to {end:.4g} rpm' if end < np.inf else 'at every high speed'
        sentence = f'Averaging has no stick-slip cycle at this load; the exact model has one {to}.'
    low, high = labels.axes.get_xlim()
    top = labels.axes.get_ylim()[1]
    labels.point(
        textwrap.fill(sentence, 46), (low + 0.04 * (high - low), 0.88 * top),
        (LabelPlace(0.0, 0.0, 'left', 'top'),), linespacing=1.5,
    )  # fmt: skip
