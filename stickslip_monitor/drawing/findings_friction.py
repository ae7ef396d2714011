# SPDX-License-Identifier: Apache-2.0
"""Draws Coulomb's and the Stribeck friction law over the relative speed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from stickslip_monitor.drawing.canvas import style
from stickslip_monitor.drawing.findings import DASHES, EXACT, SLIDING, VEIL, stated_figure
from stickslip_monitor.drawing.labels import Labeller, Place, around
from stickslip_monitor.drawing.palette import INK, MUTED, PAPER

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FloatArray = NDArray[np.float64]

_ROOM = 1.3
_TANGENT = 0.45


@dataclass(frozen=True, slots=True, eq=False)
class FrictionPicture:
    """What the picture shows.

    Attributes:
        statement: The published statement, above the axes.
        footnote: Said below the axes.
        speed: Relative speeds, rising, without 0, shape (n,) [m/s].
        stribeck: Coefficient, shape (n,) [-].
        coulomb: Coefficient, shape (n,) [-].
        static: Largest coefficient at rest [-].
        kinetic: Coulomb's coefficient in motion [-].
        hopf: Speed, coefficient and slope of the Stribeck law where damping just balances the
            fall of friction [m/s, -, s/m].
    """

    statement: str
    footnote: str
    speed: FloatArray
    stribeck: FloatArray
    coulomb: FloatArray
    static: float
    kinetic: float
    hopf: tuple[float, float, float]


def draw_friction_laws(picture: FrictionPicture) -> Figure:
    """Draw both laws, ahead and astern, and the slope that damping balances.

    Returns:
        A figure that pyplot does not know of; :func:`~.canvas.save_figure` writes it.

    Raises:
        DrawingError: matplotlib is not installed.
    """
    with style():
        figure = stated_figure(picture.statement, picture.footnote)
        axes = figure.add_axes((0.085, 0.105, 0.89, 0.735))
        _frame(axes, picture)
        _laws(axes, picture)
        _words(axes, picture, _tangent(axes, picture))
        axes.legend(
            loc='lower left', bbox_to_anchor=(-0.008, 1.0), ncols=3, frameon=False, fontsize=10.5,
            borderaxespad=0.2,
        )  # fmt: skip
        return figure


def _frame(axes: Axes, picture: FrictionPicture) -> None:
    axes.set_xlim(float(picture.speed[0]), float(picture.speed[-1]))
    highest = max(picture.static, float(np.max(picture.stribeck)))
    axes.set_ylim(-_ROOM * highest, _ROOM * highest)
    axes.set_xlabel("relative speed $v = V - x'$ [m/s]")
    axes.set_ylabel('coefficient of friction [-]')
    axes.axhline(0.0, color=MUTED, lw=0.8, zorder=1)


def _laws(axes: Axes, picture: FrictionPicture) -> None:
    ahead = picture.speed > 0.0
    for mu, name, colour, line in (
        (picture.stribeck, 'Stribeck: falls with speed', SLIDING, '-'),
        (picture.coulomb, 'Coulomb: constant', EXACT, DASHES),
    ):
        for side, label in ((ahead, name), (~ahead, None)):
            axes.plot(picture.speed[side], mu[side], color=colour, ls=line, lw=2.6, label=label)
    ends = (-picture.static, picture.static)
    axes.plot((0.0, 0.0), ends, color=INK, lw=2.6, label='at rest: −$\\mu_s$ to $\\mu_s$')


def _tangent(axes: Axes, picture: FrictionPicture) -> tuple[FloatArray, FloatArray]:
    speed, coefficient, slope = picture.hopf
    x = speed * np.array([1.0 - _TANGENT, 1.0 + _TANGENT])
    y = coefficient + slope * (x - speed)
    axes.plot(x, y, color=INK, lw=1.2, zorder=4)
    axes.plot(speed, coefficient, 'o', ms=7.5, mec=INK, mew=1.4, mfc=PAPER, zorder=5)
    return x, y


def _words(axes: Axes, picture: FrictionPicture, tangent: tuple[FloatArray, FloatArray]) -> None:
    labels = Labeller(axes)
    ahead = picture.speed > 0.0
    for mu in (picture.stribeck, picture.coulomb):
        labels.avoid(picture.speed[ahead], mu[ahead])
        labels.avoid(picture.speed[~ahead], mu[~ahead])
    labels.avoid(*tangent)
    labels.avoid([0.0, 0.0], [-picture.static, picture.static])
    speed, coefficient, _ = picture.hopf
    labels.reserve(speed, coefficient)
    text = (
        f'Hopf, $V_H$ = {speed:.4g} m/s:\nfriction falls by $c/N$ per m/s,\n'
        'just what damping can take'
    )
    places = [around(d)[k] for d in (24.0, 36.0, 48.0) for k in (0, 4, 1)]
    labels.point(text, (speed, coefficient), places, size=10.5, linespacing=1.3)
    for sign in (1.0, -1.0):
        _coefficient_words(labels, picture, sign)


def _coefficient_words(labels: Labeller, picture: FrictionPicture, sign: float) -> None:
    """Name the two coefficients, ahead (1) or astern (-1)."""
    ahead = sign > 0.0
    minus, align = ('', 'right') if ahead else ('−', 'left')
    labels.point(
        f'{minus}$\\mu_s$ = {minus}{picture.static:g}', (0.0, sign * picture.static),
        [Place(-8.0 * sign, 0.0, align)], size=10.5,
    )  # fmt: skip
    end = float(picture.speed[-1 if ahead else 0])
    labels.point(
        f'{minus}$\\mu_k$ = {minus}{picture.kinetic:g}', (end, sign * picture.kinetic),
        [Place(-8.0 * sign, -6.0 * sign, align, 'top' if ahead else 'bottom')],
        size=10.5, bbox=VEIL,
    )  # fmt: skip
