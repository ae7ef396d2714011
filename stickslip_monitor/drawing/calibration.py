# SPDX-License-Identifier: Apache-2.0
"""Draws a calibration: what was believed of the boundaries, what is believed now, and why."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from stickslip_monitor.drawing.canvas import (
    DASHES,
    FOLD,
    HOPF,
    INK,
    MUTED,
    PAPER,
    REGIME_COLOUR,
    labelled,
    style,
)
from stickslip_monitor.errors import plural
from stickslip_monitor.lab.calibration.calibrate import Calibration, DipResult
from stickslip_monitor.lab.calibration.evidence import load_of
from stickslip_monitor.monitor.assessment import Regime
from stickslip_monitor.monitor.config import BearingConfig
from stickslip_monitor.physics.belief import QUANTILES

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


_LOADS = 60
_BOUNDARIES = (
    ('fold', Regime.BISTABLE, FOLD, DASHES),
    ('Hopf', Regime.UNSTABLE, HOPF, '-'),
)


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
        for name, regime, colour, dashes in _BOUNDARIES:
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
