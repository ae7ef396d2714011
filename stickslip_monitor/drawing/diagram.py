# SPDX-License-Identifier: Apache-2.0
"""Draws the bifurcation diagram: vibration amplitude over shaft speed, at one load."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from stickslip_monitor.drawing.branches import Diagram, Mark, MarkKind, bifurcation_diagram
from stickslip_monitor.drawing.canvas import new_figure, style
from stickslip_monitor.drawing.labels import Labeller, around
from stickslip_monitor.drawing.palette import INK, MUTED, PAPER, REGIME_COLOUR, REGIME_FILL
from stickslip_monitor.drawing.ranges import Range, diagram_speeds
from stickslip_monitor.monitor.assessment import Regime, assess
from stickslip_monitor.monitor.config import BearingConfig
from stickslip_monitor.physics.oscillator import Bearing

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_DASHES = (0, (4.5, 2.2))
_HEADROOM = 1.16
_BELOW_ZERO = 0.07
_STICK_SLIP = REGIME_COLOUR[Regime.UNSTABLE]
_SLIDING = REGIME_COLOUR[Regime.STABLE]
_SMALL = 9.5


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
        axes = figure.add_axes((0.085, 0.125, 0.89, 0.755))
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
    metres = axes.secondary_xaxis('top', functions=(lambda x: x * rpm, lambda x: x / rpm))
    metres.set_xlabel('surface speed [m/s]', labelpad=6.0)


def _curves(axes: Axes, bearing: Bearing, diagram: Diagram) -> dict[str, tuple[Any, Any]]:
    """Draw everything but words; return the named curves [rpm, mm]."""
    rpm = bearing.speed.factor('rpm')
    x = diagram.speed / rpm
    for span in diagram.spans:
        axes.axvspan(
            span.low / rpm, span.high / rpm, color=REGIME_FILL[span.regime], lw=0.0, zorder=0
        )
    limit = diagram.sliding_limit * 1e3
    axes.plot(x, limit, color=MUTED, lw=1.0, ls=':', zorder=2)
    _equilibrium(axes, x, diagram)
    named = {'limit': (x, limit), 'sliding': (x, np.zeros_like(x))}
    for branch in diagram.branches:
        line = '-' if branch.stable else _DASHES
        y = branch.amplitude * 1e3
        axes.plot(x, y, color=_STICK_SLIP, ls=line, lw=2.4 if branch.stable else 2.0, zorder=4)
        named.setdefault('stable' if branch.stable else 'threshold', (x, y))
    for mark in diagram.marks:
        hollow = mark.kind is MarkKind.HOPF
        axes.plot(
            mark.speed / rpm, mark.amplitude * 1e3, 'o' if hollow else 'D', ms=7.5, zorder=6,
            mec=INK, mew=1.4, mfc=PAPER if hollow else INK, clip_on=False,
        )  # fmt: skip
    return named


def _equilibrium(axes: Axes, x: Any, diagram: Diagram) -> None:
    """The line of steady sliding, dashed where a disturbance grows."""
    hopf = [mark.speed for mark in diagram.marks if mark.kind is MarkKind.HOPF]
    edges = [diagram.speed[0], *hopf, diagram.speed[-1]]
    to_x = x[-1] / diagram.speed[-1]
    for low, high in zip(edges, edges[1:], strict=False):
        middle = np.interp(0.5 * (low + high), diagram.speed, diagram.growth_rate)
        line = _DASHES if middle > 0.0 else '-'
        ends = (low * to_x, high * to_x)
        axes.plot(ends, (0.0, 0.0), color=_SLIDING, ls=line, lw=2.4, zorder=3)


def _words(
    axes: Axes, bearing: Bearing, diagram: Diagram, curves: dict[str, tuple[Any, Any]]
) -> None:
    labels = Labeller(axes)
    x = diagram.speed / bearing.speed.factor('rpm')
    for y in (b.amplitude * 1e3 for b in diagram.branches):
        labels.avoid(x, y)
    labels.avoid(*curves['sliding'])
    labels.avoid(*curves['limit'])
    _regimes(labels, bearing, diagram)
    for mark in sorted(diagram.marks, key=lambda m: -m.amplitude):
        _mark(labels, bearing, mark)
    words = (
        ('stable', 'stick-slip', _STICK_SLIP, (0.45, 0.55, 0.35, 0.25, 0.65, 0.75)),
        ('threshold', 'threshold (unstable)', _STICK_SLIP, (0.5, 0.4, 0.6, 0.7)),
        ('sliding', 'steady sliding', _SLIDING, (0.9, 0.8, 0.1, 0.2, 0.5, 0.3)),
        ('limit', 'sliding limit a = V', MUTED, (0.92, 0.85, 0.78, 0.2, 0.3, 0.4, 0.5)),
    )
    for name, text, colour, where in words:
        if name in curves:
            size = _SMALL if name == 'limit' else 11.0
            labels.along(text, *curves[name], fractions=where, color=colour, size=size)
    if not diagram.branches:
        _nothing(labels, bearing, diagram)


def _regimes(labels: Labeller, bearing: Bearing, diagram: Diagram) -> None:
    """Name the bands along the upper edge, where they are wide enough."""
    rpm = bearing.speed.factor('rpm')
    top = labels.axes.get_ylim()[1]
    for span in diagram.spans:
        low, high = span.low / rpm, span.high / rpm
        left, right = labels.axes.transData.transform([(low, 0.0), (high, 0.0)])[:, 0]
        if right - left > 75.0:
            labels.point(
                span.regime.value, (0.5 * (low + high), top), ((0.0, -6.0, 'center', 'top'),),
                color=INK, style='italic',
            )  # fmt: skip


def _mark(labels: Labeller, bearing: Bearing, mark: Mark) -> None:
    rpm = mark.speed / bearing.speed.factor('rpm')
    name = 'Hopf' if mark.kind is MarkKind.HOPF else 'fold'
    near, far = around(9.0), around(26.0)
    if mark.kind is MarkKind.HOPF:
        near = (near[1], near[4], near[0], *near[2:4])
    labels.point(
        f'{name} {rpm:.4g} rpm', (rpm, mark.amplitude * 1e3), (*near, *far, *around(44.0)),
        weight='bold', size=10.0,
    )  # fmt: skip


def _nothing(labels: Labeller, bearing: Bearing, diagram: Diagram) -> None:
    """Say why the picture is empty."""
    middle = 0.5 * (diagram.speed[0] + diagram.speed[-1])
    point = assess(bearing, middle, diagram.load)
    low, high = labels.axes.get_xlim()
    sentence = point.outcome.sentence.replace(' at this load:', ' at this load:\n')
    labels.point(
        sentence, (0.5 * (low + high), 0.6 * labels.axes.get_ylim()[1]),
        ((0.0, 0.0, 'center', 'center'),), linespacing=1.5, multialignment='center',
    )  # fmt: skip
