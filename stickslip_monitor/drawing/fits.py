# SPDX-License-Identifier: Apache-2.0
"""Draws a fitted friction curve over its points.

Figures are unknown to pyplot; :func:`~.canvas.save_figure` writes them. Each function raises a
``DrawingError`` where matplotlib is not installed.
"""

from __future__ import annotations

import numpy as np

from stickslip_monitor.drawing import canvas
from stickslip_monitor.lab.friction_fit import BoundarySpread, Spread, StribeckFit
from stickslip_monitor.monitor.assessment import Regime
from stickslip_monitor.physics.friction import Stribeck

_LINE = canvas.REGIME_COLOUR[Regime.STABLE]
_OUTLIER = canvas.REGIME_COLOUR[Regime.UNSTABLE]
_BAND_ALPHA = 0.25
_ROOM = 0.05
_CURVE_POINTS, _BEYOND = 400, 1.05


def draw_friction_fit(
    fit: StribeckFit, footnote: str = '', spread: BoundarySpread | None = None
) -> canvas.Figure:
    """Draw the points, the curve with its confidence band, the outliers, and boundaries."""
    with canvas.style():
        figure, axes = canvas.labelled(
            'sliding speed [m/s]', 'coefficient of friction [-]', title=_title(fit.law), footnote=footnote
        )
        _draw_law(axes, fit)
        _draw_points(axes, fit)
        if spread is not None:
            _mark(axes, 'Hopf', spread.hopf_speed)
            _mark(axes, 'fold', spread.fold_speed)
        axes.legend(loc='upper right', frameon=True, framealpha=0.9, edgecolor='none')
        return figure


def _title(law: Stribeck) -> str:
    text = f'μ = {law.kinetic:.4g} + {law.static - law.kinetic:.4g} exp(−{law.decay:.4g} v)'
    return text + (f' + {law.viscous:.3g} v' if law.viscous else '')


def _draw_law(axes: canvas.Axes, fit: StribeckFit) -> None:
    """The law with its band, and axes that hold it and the points."""
    top = _BEYOND * float(fit.curve.speed.max())
    speed = np.linspace(0.0, top, _CURVE_POINTS)
    law, half = fit.law.coefficient(speed), fit.band(speed)
    axes.fill_between(
        speed,
        law - half,
        law + half,
        color=_LINE,
        alpha=_BAND_ALPHA,
        lw=0.0,
        zorder=2,
        label='95 % confidence band',
    )
    axes.plot(speed, law, color=_LINE, zorder=4, label='fitted law')
    values = np.concatenate([fit.curve.coefficient, law])
    room = _ROOM * float(np.ptp(values))
    axes.set_xlim(-0.02 * top, top)
    axes.set_ylim(min(0.0, float(values.min()) - room), float(values.max()) + 2.0 * room)


def _draw_points(axes: canvas.Axes, fit: StribeckFit) -> None:
    curve, out = fit.curve, fit.outliers
    good = fit.weight >= 0.5
    if float(np.ptp(curve.std)) > 0.0:
        axes.errorbar(
            curve.speed,
            curve.coefficient,
            curve.std * fit.scale,
            fmt='none',
            ecolor=canvas.MUTED,
            elinewidth=0.8,
            zorder=3,
        )
    axes.plot(
        curve.speed[good],
        curve.coefficient[good],
        'o',
        ms=5.5,
        mfc=canvas.PAPER,
        mec=canvas.INK,
        mew=1.2,
        zorder=5,
        label='measured',
    )
    if out.size:
        axes.plot(
            curve.speed[out],
            curve.coefficient[out],
            'X',
            ms=9.0,
            mfc=_OUTLIER,
            mec=canvas.PAPER,
            mew=0.8,
            zorder=6,
            label='outlier (weight below half)',
        )
    for k in out:
        axes.annotate(
            f'line {curve.line[k]}',
            (curve.speed[k], curve.coefficient[k]),
            xytext=(8.0, 0.0),
            textcoords='offset points',
            va='center',
            size=9.0,
            color=canvas.MUTED,
            zorder=3,
            bbox={'fc': canvas.PAPER, 'ec': 'none', 'alpha': 0.75, 'pad': 0.8},
        )


def _mark(axes: canvas.Axes, name: str, boundary: Spread) -> None:
    """A boundary speed as a line in its interval, named at the foot of the axes."""
    if not boundary.estimate > 0.0:
        return
    regime, colour, dashes = canvas.BOUNDARY_LINES[name]
    axes.axvspan(boundary.low, boundary.high, color=canvas.REGIME_FILL[regime], alpha=0.8, lw=0.0, zorder=0)
    axes.axvline(boundary.estimate, color=colour, lw=1.4, ls=dashes, zorder=1)
    bottom = axes.get_ylim()[0] + 0.02 * float(np.ptp(axes.get_ylim()))
    axes.annotate(
        f'{name} speed',
        (boundary.low, bottom),
        xytext=(-3.0, 0.0),
        textcoords='offset points',
        rotation=90.0,
        ha='right',
        va='bottom',
        size=10.0,
        color=canvas.INK,
    )
