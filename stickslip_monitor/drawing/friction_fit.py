# SPDX-License-Identifier: Apache-2.0
"""Draws a fitted friction curve over the measured points."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.drawing.canvas import labelled, style
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
from stickslip_monitor.monitor.assessment import Regime

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


_LINE = REGIME_COLOUR[Regime.STABLE]
_OUTLIER = REGIME_COLOUR[Regime.UNSTABLE]
_BAND_ALPHA = 0.25
_ROOM = 0.05


@dataclass(frozen=True, slots=True, eq=False)
class Boundary:
    """A boundary speed to mark: its name, where it is, and its 95 % interval [m/s]."""

    name: str
    speed: float
    low: float
    high: float
    regime: Regime


@dataclass(frozen=True, slots=True, eq=False)
class FrictionFitPicture:
    """What the picture shows.

    Attributes:
        title: The law in words.
        speed: Measured speeds, shape (n,) [m/s].
        coefficient: Measured coefficients, shape (n,) [-].
        std: Relative standard deviations as error bars, shape (n,) [-]; ``None`` for no bars.
        counts: Whether a point counts half or more, shape (n,).
        lines: Line of the file of each point, shape (n,).
        curve_speed: Speeds of the curve, ascending, shape (m,) [m/s].
        curve: The fitted coefficient there, shape (m,) [-].
        band: Half width of its 95 % band there, shape (m,) [-].
        boundaries: Boundary speeds of a bearing to mark.
        footnote: Said below the axes.
    """

    title: str
    speed: FloatArray
    coefficient: FloatArray
    std: FloatArray | None
    counts: NDArray[np.bool_]
    lines: NDArray[np.int64]
    curve_speed: FloatArray
    curve: FloatArray
    band: FloatArray
    boundaries: tuple[Boundary, ...] = ()
    footnote: str = ''


def draw_friction_fit(picture: FrictionFitPicture) -> Figure:
    """Draw the points, the curve with its confidence band, and the outliers.

    Returns:
        A figure that pyplot does not know of; :func:`~.canvas.save_figure` writes it.

    Raises:
        DrawingError: matplotlib is not installed.
    """
    with style():
        figure, axes = labelled(
            'sliding speed [m/s]', 'coefficient of friction [-]', title=picture.title,
            footnote=picture.footnote,
        )  # fmt: skip
        _curve(axes, picture)
        _points(axes, picture)
        _frame(axes, picture)
        for boundary in picture.boundaries:
            _boundary(axes, boundary)
        axes.legend(loc='upper right', frameon=True, framealpha=0.9, edgecolor='none')
        return figure


def _curve(axes: Axes, picture: FrictionFitPicture) -> None:
    v, mu, half = picture.curve_speed, picture.curve, picture.band
    axes.fill_between(
        v, mu - half, mu + half, color=_LINE, alpha=_BAND_ALPHA, lw=0.0, zorder=2,
        label='95 % confidence band',
    )  # fmt: skip
    axes.plot(v, mu, color=_LINE, zorder=4, label='fitted law')


def _points(axes: Axes, picture: FrictionFitPicture) -> None:
    good = picture.counts
    if picture.std is not None:
        axes.errorbar(
            picture.speed, picture.coefficient, picture.std, fmt='none', ecolor=MUTED,
            elinewidth=0.8, zorder=3,
        )  # fmt: skip
    axes.plot(
        picture.speed[good], picture.coefficient[good], 'o', ms=5.5, mfc=PAPER, mec=INK, mew=1.2,
        zorder=5, label='measured',
    )  # fmt: skip
    if np.all(good):
        return
    axes.plot(
        picture.speed[~good], picture.coefficient[~good], 'X', ms=9.0, mfc=_OUTLIER, mec=PAPER,
        mew=0.8, zorder=6, label='outlier (weight below half)',
    )  # fmt: skip
    for v, mu, line in zip(
        picture.speed[~good], picture.coefficient[~good], picture.lines[~good], strict=True
    ):
        axes.annotate(
            f'line {line}', (v, mu), xytext=(8.0, 0.0), textcoords='offset points', va='center',
            size=9.0, color=MUTED, zorder=3,
            bbox={'fc': PAPER, 'ec': 'none', 'alpha': 0.75, 'pad': 0.8},
        )  # fmt: skip


def _frame(axes: Axes, picture: FrictionFitPicture) -> None:
    top = float(picture.curve_speed[-1])
    axes.set_xlim(-0.02 * top, top)
    values = np.concatenate([picture.coefficient, picture.curve])
    room = _ROOM * float(np.ptp(values))
    axes.set_ylim(min(0.0, float(values.min()) - room), float(values.max()) + 2.0 * room)


def _boundary(axes: Axes, boundary: Boundary) -> None:
    """A boundary speed as a line in its interval, named at the foot of the axes."""
    hopf = boundary.regime is Regime.UNSTABLE
    colour, dashes = (HOPF, '-') if hopf else (FOLD, DASHES)
    axes.axvspan(
        boundary.low, boundary.high, color=REGIME_FILL[boundary.regime], alpha=0.8, lw=0.0,
        zorder=0,
    )  # fmt: skip
    axes.axvline(boundary.speed, color=colour, lw=1.4, ls=dashes, zorder=1)
    bottom = axes.get_ylim()[0] + 0.02 * float(np.ptp(axes.get_ylim()))
    axes.annotate(
        boundary.name, (boundary.low, bottom), xytext=(-3.0, 0.0), textcoords='offset points',
        rotation=90.0, ha='right', va='bottom', size=10.0, color=INK,
    )  # fmt: skip
