# SPDX-License-Identifier: Apache-2.0
"""Draws what was inferred: a friction curve over its points, a calibration over its dips.

Figures are unknown to pyplot; :func:`~.canvas.save_figure` writes them. Each function raises a
``DrawingError`` where matplotlib is not installed.
"""

from __future__ import annotations

import numpy as np

from stickslip_monitor.drawing.canvas import (
    BOUNDARY_LINES,
    INK,
    MUTED,
    PAPER,
    REGIME_COLOUR,
    REGIME_FILL,
    Axes,
    Figure,
    labelled,
    style,
)
from stickslip_monitor.errors import plural
from stickslip_monitor.lab.calibration.calibrate import Calibration, DipResult
from stickslip_monitor.lab.calibration.evidence import load_of
from stickslip_monitor.lab.friction_fit import BoundarySpread, Spread, StribeckFit
from stickslip_monitor.monitor.assessment import Regime
from stickslip_monitor.monitor.config import BearingConfig
from stickslip_monitor.physics.belief import QUANTILES
from stickslip_monitor.physics.friction import Stribeck

_LINE = REGIME_COLOUR[Regime.STABLE]
_OUTLIER = REGIME_COLOUR[Regime.UNSTABLE]
_BAND_ALPHA = 0.25
_ROOM = 0.05
_CURVE_POINTS, _BEYOND = 400, 1.05


def draw_friction_fit(
    fit: StribeckFit, footnote: str = '', spread: BoundarySpread | None = None
) -> Figure:
    """Draw the points, the curve with its confidence band, the outliers, and boundaries."""
    with style():
        figure, axes = labelled(
            'sliding speed [m/s]', 'coefficient of friction [-]', title=_title(fit.law),
            footnote=footnote,
        )  # fmt: skip
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


def _draw_law(axes: Axes, fit: StribeckFit) -> None:
    """The law with its band, and axes that hold it and the points."""
    top = _BEYOND * float(fit.curve.speed.max())
    speed = np.linspace(0.0, top, _CURVE_POINTS)
    law, half = fit.law.coefficient(speed), fit.band(speed)
    axes.fill_between(
        speed, law - half, law + half, color=_LINE, alpha=_BAND_ALPHA, lw=0.0, zorder=2,
        label='95 % confidence band',
    )  # fmt: skip
    axes.plot(speed, law, color=_LINE, zorder=4, label='fitted law')
    values = np.concatenate([fit.curve.coefficient, law])
    room = _ROOM * float(np.ptp(values))
    axes.set_xlim(-0.02 * top, top)
    axes.set_ylim(min(0.0, float(values.min()) - room), float(values.max()) + 2.0 * room)


def _draw_points(axes: Axes, fit: StribeckFit) -> None:
    curve, out = fit.curve, fit.outliers
    good = fit.weight >= 0.5
    if float(np.ptp(curve.std)) > 0.0:
        axes.errorbar(
            curve.speed, curve.coefficient, curve.std * fit.scale, fmt='none', ecolor=MUTED,
            elinewidth=0.8, zorder=3,
        )  # fmt: skip
    axes.plot(
        curve.speed[good], curve.coefficient[good], 'o', ms=5.5, mfc=PAPER, mec=INK, mew=1.2,
        zorder=5, label='measured',
    )  # fmt: skip
    if out.size:
        axes.plot(
            curve.speed[out], curve.coefficient[out], 'X', ms=9.0, mfc=_OUTLIER, mec=PAPER,
            mew=0.8, zorder=6, label='outlier (weight below half)',
        )  # fmt: skip
    for k in out:
        axes.annotate(
            f'line {curve.line[k]}', (curve.speed[k], curve.coefficient[k]), xytext=(8.0, 0.0),
            textcoords='offset points', va='center', size=9.0, color=MUTED, zorder=3,
            bbox={'fc': PAPER, 'ec': 'none', 'alpha': 0.75, 'pad': 0.8},
        )  # fmt: skip


def _mark(axes: Axes, name: str, boundary: Spread) -> None:
    """A boundary speed as a line in its interval, named at the foot of the axes."""
    if not boundary.estimate > 0.0:
        return
    regime, colour, dashes = BOUNDARY_LINES[name]
    axes.axvspan(
        boundary.low, boundary.high, color=REGIME_FILL[regime], alpha=0.8, lw=0.0, zorder=0
    )
    axes.axvline(boundary.estimate, color=colour, lw=1.4, ls=dashes, zorder=1)
    bottom = axes.get_ylim()[0] + 0.02 * float(np.ptp(axes.get_ylim()))
    axes.annotate(
        f'{name} speed', (boundary.low, bottom), xytext=(-3.0, 0.0), textcoords='offset points',
        rotation=90.0, ha='right', va='bottom', size=10.0, color=INK,
    )  # fmt: skip


_LOADS = 60


def draw_calibration(config: BearingConfig, found: Calibration) -> Figure:
    """The stability map with the bands (5 to 95 %) of both boundaries, and the dips as tracks."""
    low, high = found.loads
    load, rpm = np.linspace(0.6 * low, 1.4 * high, _LOADS), config.bearing.speed.factor('rpm')
    before, now = found.prior_belief(), found.belief()
    with style():
        title = (
            f'{config.name}: {plural(len(found.dips), "dip")}, {plural(found.episodes, "episode")}'
        )
        figure, axes = labelled('shaft speed [rpm]', 'load [N]', title=title)
        fastest, doubtful = 0.0, False
        for dip in found.dips:
            fastest = max(fastest, float(dip.dip.speed.max()) / rpm)
            doubtful |= _draw_dip(axes, dip, rpm, found.prior.viscous)
        highest = {}
        for name in ('fold', 'Hopf'):
            regime, colour, dashes = BOUNDARY_LINES[name]
            (left, middle, right), (low_now, middle_now, right_now) = (
                [getattr(b, f'{name.lower()}_speed')(load, p) / rpm for p in QUANTILES]
                for b in (before, now)
            )
            axes.plot(middle, load, color=MUTED, linewidth=1.0, linestyle=':')
            axes.fill_betweenx(load, left, right, color=MUTED, alpha=0.10, linewidth=0)
            band = REGIME_COLOUR[regime]
            axes.fill_betweenx(load, low_now, right_now, color=band, alpha=0.45, linewidth=0)
            axes.plot(middle_now, load, color=colour, ls=dashes, label=f'{name} speed, 5 to 95 %')
            highest[name] = float(right_now.max())
        axes.plot([], [], color=MUTED, linestyle=':', linewidth=1.0, label='before')
        axes.plot([], [], 'v', color=INK, label='vibration begins')
        axes.plot([], [], '^', color=INK, label='vibration ends')
        if doubtful:
            axes.plot([], [], 'x', color=INK, mew=2.5, label='doubtful report')
        top = max(1.15 * max(highest.values()), fastest)
        axes.set_xlim(0.0, min(top, 2.0 * highest['fold'] + 1.0))
        axes.set_ylim(float(load[0]), float(load[-1]))
        axes.legend(loc='best', frameon=True, fontsize=9.0)
    return figure


def _draw_dip(axes: Axes, one: DipResult, rpm: float, viscous: float) -> bool:
    """A dip as a track; whether a report of vibration in it is doubtful."""
    dip, time = one.dip, one.dip.time_ns[: one.dip.path.shape[0]]
    speed, load = dip.speed / rpm, load_of(dip.path, viscous)
    axes.plot(speed, load, color=MUTED, linewidth=0.7, alpha=0.7)
    doubtful = [report for report, _ in one.doubtful]
    for report in dip.reports:
        rows = np.flatnonzero((time >= report.start_ns) & (time <= report.end_ns))
        if not report.squeal or not rows.size:
            continue
        axes.plot(speed[rows], load[rows], color=INK, linewidth=1.6)
        for row, marker in ((rows[0], 'v'), (rows[-1], '^')):
            if 0 < row < time.size - 1:
                axes.plot(speed[row], load[row], marker, color=INK, mec=PAPER, ms=7.0, zorder=4)
        if report in doubtful:
            axes.plot(speed[rows[0]], load[rows[0]], 'x', color=INK, ms=12.0, mew=2.5, zorder=5)
    return any(report.squeal for report in doubtful)
