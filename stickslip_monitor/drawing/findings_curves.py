# SPDX-License-Identifier: Apache-2.0
"""Draws the published findings on friction curves, and on stick-slip in time and phase plane."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.drawing.amplitudes import EXACT, SLIDING, VEIL, stated_figure
from stickslip_monitor.drawing.canvas import style
from stickslip_monitor.drawing.labels import Labeller, LabelPlace, around
from stickslip_monitor.drawing.palette import DASHES, INK, MUTED, PAPER, REGIME_FILL
from stickslip_monitor.monitor.assessment import Regime

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


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
        [LabelPlace(-8.0 * sign, 0.0, align)], size=10.5,
    )  # fmt: skip
    end = float(picture.speed[-1 if ahead else 0])
    labels.point(
        f'{minus}$\\mu_k$ = {minus}{picture.kinetic:g}', (end, sign * picture.kinetic),
        [LabelPlace(-8.0 * sign, -6.0 * sign, align, 'top' if ahead else 'bottom')],
        size=10.5, bbox=VEIL,
    )  # fmt: skip


if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


_PERIODS_SHOWN = 3.0
_AT_BELT = 1e-9
_ROOM, _ABOVE = 1.25, 0.2
_STICK = INK


@dataclass(frozen=True, slots=True, eq=False)
class MotionPicture:
    """What the picture shows; SI units, displacements from steady sliding.

    Attributes:
        statement: The published statement, above the axes.
        footnote: Said below the axes.
        time: Shape (n,) [s].
        displacement: Shape (n,) [m].
        velocity: Shape (n,) [m/s].
        sticking: Whether the lining sticks, shape (n,).
        envelope: Amplitude under KBM, shape (n,) [m].
        belt_speed: ``V`` [m/s].
        cycle_displacement: One closed period of the exact cycle, shape (p,) [m].
        cycle_velocity: Shape (p,) [m/s].
        averaged_amplitude: Amplitude of the KBM cycle [m].
        natural_frequency: ``omega`` [rad/s].
        period: Of the exact cycle [s].
    """

    statement: str
    footnote: str
    time: FloatArray
    displacement: FloatArray
    velocity: FloatArray
    sticking: NDArray[np.bool_]
    envelope: FloatArray
    belt_speed: float
    cycle_displacement: FloatArray
    cycle_velocity: FloatArray
    averaged_amplitude: float
    natural_frequency: float
    period: float


def draw_motion(picture: MotionPicture) -> Figure:
    """Draw the growth, the last periods and the phase portrait.

    Returns:
        A figure that pyplot does not know of; :func:`~.canvas.save_figure` writes it.

    Raises:
        DrawingError: matplotlib is not installed.
    """
    with style():
        figure = stated_figure(picture.statement, picture.footnote)
        _growth(figure.add_axes((0.085, 0.615, 0.89, 0.235)), picture)
        _last_periods(figure.add_axes((0.085, 0.115, 0.385, 0.375)), picture)
        _portrait(figure.add_axes((0.575, 0.115, 0.40, 0.375)), picture)
        return figure


def _growth(axes: Axes, picture: MotionPicture) -> None:
    scale = 1e3 * float(np.max(np.abs(picture.displacement)))
    axes.set_xlim(0.0, float(picture.time[-1]))
    axes.set_ylim(-_ROOM * scale, _ROOM * scale)
    axes.set_xlabel('time [s]', labelpad=2.0)
    axes.set_ylabel('$x - x_e$ [mm]')
    axes.plot(picture.time, picture.displacement * 1e3, color=EXACT, lw=0.9, label='exact')
    for sign, name in ((1.0, 'KBM: amplitude, and its cycle'), (-1.0, None)):
        axes.plot(
            picture.time, sign * picture.envelope * 1e3, color=INK, lw=1.6, ls=DASHES, label=name
        )
    axes.legend(
        loc='lower left', bbox_to_anchor=(-0.008, 0.99), ncols=2, frameon=False, fontsize=10.0,
        borderaxespad=0.1,
    )  # fmt: skip


def _last_periods(axes: Axes, picture: MotionPicture) -> None:
    begin = float(picture.time[-1]) - _PERIODS_SHOWN * picture.period
    shown = picture.time >= begin
    t = (picture.time[shown] - begin) * 1e3
    v = picture.velocity[shown] * 1e3
    belt, lowest = picture.belt_speed * 1e3, float(np.min(v))
    axes.set_xlim(0.0, float(t[-1]))
    axes.set_ylim(1.12 * lowest, belt + _ABOVE * (belt - lowest))
    axes.set_xlabel('time, last three periods [ms]')
    axes.set_ylabel("velocity $x'$ [mm/s]")
    axes.axhline(belt, color=MUTED, lw=1.0, ls=':')
    axes.plot(t, v, color=EXACT, lw=2.0)
    stick = np.where(picture.sticking[shown], v, np.nan)
    axes.plot(t, stick, color=_STICK, lw=4.5, solid_capstyle='butt', zorder=4)
    _shade(axes, t, picture.sticking[shown])
    labels = Labeller(axes)
    labels.avoid(t, v)
    middle = _middle_of_stick(t, picture.sticking[shown])
    if middle is not None:
        places = [around(d)[k] for d in (10.0, 24.0) for k in (0, 1, 4)]
        labels.point("stick, $x' = V$", (middle, belt), places, size=10.0)


def _runs(flags: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First and last index of every run of ``True``."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(np.int8), [0]])))
    return [(int(i), int(j) - 1) for i, j in zip(edges[::2], edges[1::2], strict=True)]


def _shade(axes: Axes, t: FloatArray, sticking: NDArray[np.bool_]) -> None:
    for i, j in _runs(sticking):
        axes.axvspan(t[i], t[j], color=REGIME_FILL[Regime.UNSTABLE], lw=0.0, zorder=0)


def _middle_of_stick(t: FloatArray, sticking: NDArray[np.bool_]) -> float | None:
    """Middle of the stick phase closest to the middle of the picture."""
    middles = [0.5 * (t[i] + t[j]) for i, j in _runs(sticking)]
    return min(middles, key=lambda m: abs(m - 0.5 * t[-1]), default=None)


def _portrait(axes: Axes, picture: MotionPicture) -> None:
    x, v = picture.cycle_displacement * 1e3, picture.cycle_velocity * 1e3
    belt = picture.belt_speed * 1e3
    axes.set_xlim(1.3 * float(x.min()), 1.3 * float(x.max()))
    axes.set_ylim(1.12 * float(v.min()), belt + _ABOVE * (belt - float(v.min())))
    axes.set_xlabel('$x - x_e$ [mm]')
    axes.set_ylabel("velocity $x'$ [mm/s]")
    axes.axhline(belt, color=MUTED, lw=1.0, ls=':')
    axes.plot(picture.displacement * 1e3, picture.velocity * 1e3, color=EXACT, lw=0.5, alpha=0.45)
    axes.plot(x, v, color=EXACT, lw=2.4, zorder=4)
    stuck = np.where(np.abs(v - belt) <= _AT_BELT * belt, v, np.nan)
    axes.plot(x, stuck, color=_STICK, lw=4.5, zorder=5, solid_capstyle='butt')
    turn = np.linspace(0.0, 2.0 * np.pi, 181)
    a = picture.averaged_amplitude * 1e3
    ellipse = a * np.cos(turn), -a * picture.natural_frequency * np.sin(turn)
    axes.plot(*ellipse, color=INK, lw=1.3, ls=DASHES, zorder=6)
    axes.plot(0.0, 0.0, 'o', ms=6.0, mfc=SLIDING, mec='none', zorder=6)
    _portrait_words(axes, x, v, stuck)


def _portrait_words(axes: Axes, x: FloatArray, v: FloatArray, stuck: FloatArray) -> None:
    labels = Labeller(axes)
    labels.avoid(x, v)
    held = np.flatnonzero(np.isfinite(stuck))
    if held.size:
        above = [around(d)[k] for d in (6.0, 9.0, 20.0) for k in (4, 1, 0)]
        middle = 0.5 * float(x[held].min() + x[held].max())
        labels.point("stick, $x' = V$", (middle, float(v[held[0]])), above, size=10.0)
    labels.point(
        'steady sliding', (0.0, 0.0), [around(8.0)[k] for k in (5, 2)], size=10.0, bbox=VEIL
    )
