# SPDX-License-Identifier: Apache-2.0
"""Draws a calibration: what was believed of the boundaries, what is believed now, and why."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.drawing.canvas import labelled, style
from stickslip_monitor.drawing.palette import DASHES, FOLD, HOPF, INK, MUTED, PAPER, REGIME_COLOUR
from stickslip_monitor.monitor.assessment import Regime

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


_BOUNDARIES = (
    ('fold', Regime.BISTABLE, FOLD, DASHES),
    ('Hopf', Regime.UNSTABLE, HOPF, '-'),
)


@dataclass(frozen=True, slots=True, eq=False)
class DipTrack:
    """One dip on the map.

    Attributes:
        speed: Shaft speed, shape (n,) [rpm].
        load: Shape (n,) [N].
        squeal: Whether vibration was reported, shape (n,).
        doubtful: Whether that report is more likely worthless than not, shape (n,).
    """

    speed: FloatArray
    load: FloatArray
    squeal: NDArray[np.bool_]
    doubtful: NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class CalibrationPicture:
    """What the picture shows; speeds in rpm.

    Attributes:
        title: Above the picture.
        load: Loads of the bands, shape (n,) [N].
        prior: 5, 50, 95 % of fold and Hopf speed before, shape (2, 3, n).
        posterior: The same after.
        dips: The evidence.
    """

    title: str
    load: FloatArray
    prior: FloatArray
    posterior: FloatArray
    dips: Sequence[DipTrack]


def draw_calibration(picture: CalibrationPicture) -> Figure:
    """The stability map with the bands (5 to 95 %) of both boundaries, and the dips as tracks."""
    with style():
        figure, axes = labelled('shaft speed [rpm]', 'load [N]', title=picture.title)
        for dip in picture.dips:
            _draw_dip(axes, dip)
        for k, (name, regime, colour, dashes) in enumerate(_BOUNDARIES):
            band = REGIME_COLOUR[regime]
            low, middle, high = picture.prior[k]
            axes.plot(middle, picture.load, color=MUTED, linewidth=1.0, linestyle=':')
            axes.fill_betweenx(picture.load, low, high, color=MUTED, alpha=0.10, linewidth=0)
            low, middle, high = picture.posterior[k]
            axes.fill_betweenx(picture.load, low, high, color=band, alpha=0.45, linewidth=0)
            axes.plot(
                middle, picture.load, color=colour, ls=dashes, label=f'{name} speed, 5 to 95 %'
            )
        axes.plot([], [], color=MUTED, linestyle=':', linewidth=1.0, label='before')
        _label(axes, picture)
    return figure


def _draw_dip(axes: Axes, dip: DipTrack) -> None:
    axes.plot(dip.speed, dip.load, color=MUTED, linewidth=0.7, alpha=0.7)
    loud = np.where(dip.squeal, dip.load, np.nan)
    axes.plot(dip.speed, loud, color=INK, linewidth=1.6)
    edges = np.flatnonzero(np.diff(dip.squeal.astype(np.int8)))
    begins, ends = edges[dip.squeal[edges + 1]], edges[dip.squeal[edges]]
    for rows, marker in ((begins, 'v'), (ends, '^')):
        axes.plot(dip.speed[rows], dip.load[rows], marker, color=INK, mec=PAPER, ms=7.0, zorder=4)
    rows = np.flatnonzero(dip.doubtful & dip.squeal)[:1]
    axes.plot(dip.speed[rows], dip.load[rows], 'x', color=INK, ms=12.0, mew=2.5, zorder=5)


def _label(axes: Axes, picture: CalibrationPicture) -> None:
    axes.plot([], [], 'v', color=INK, label='vibration begins')
    axes.plot([], [], '^', color=INK, label='vibration ends')
    if any((dip.doubtful & dip.squeal).any() for dip in picture.dips):
        axes.plot([], [], 'x', color=INK, mew=2.5, label='doubtful report')
    fastest = [float(dip.speed.max()) for dip in picture.dips]
    top = max([1.15 * float(picture.posterior[:, 2].max()), *fastest])
    axes.set_xlim(0.0, min(top, 2.0 * float(picture.posterior[0, 2].max()) + 1.0))
    axes.set_ylim(float(picture.load[0]), float(picture.load[-1]))
    axes.legend(loc='best', frameon=True, fontsize=9.0)
