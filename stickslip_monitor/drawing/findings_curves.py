# SPDX-License-Identifier: Apache-2.0
"""Draws the published findings on friction curves, and on stick-slip in time and phase plane."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.drawing.amplitudes import EXACT, SLIDING, VEIL, stated_figure
from stickslip_monitor.drawing.canvas import style
from stickslip_monitor.drawing.labels import Labeller, LabelPlace, around
from stickslip_monitor.drawing.palette import DASHES, INK, MUTED, PAPER, REGIME_FILL
from stickslip_monitor.lab.findings.published import FrictionCurves, History
from stickslip_monitor.monitor.assessment import Regime

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


_ROOM = 1.3
_TANGENT = 0.45


def draw_friction_laws(curves: FrictionCurves, statement: str, footnote: str) -> Figure:
    """Draw both laws, ahead and astern, and the slope that damping balances.

    Args:
        curves: The laws.
        statement: The published statement, above the axes.
        footnote: Said below the axes.

    Returns:
        A figure that pyplot does not know of; :func:`~.canvas.save_figure` writes it.

    Raises:
        DrawingError: matplotlib is not installed.
    """
    with style():
        figure = stated_figure(statement, footnote)
        axes = figure.add_axes((0.085, 0.105, 0.89, 0.735))
        _frame(axes, curves)
        _laws(axes, curves)
        _words(axes, curves, _tangent(axes, curves))
        axes.legend(
            loc='lower left', bbox_to_anchor=(-0.008, 1.0), ncols=3, frameon=False, fontsize=10.5,
            borderaxespad=0.2,
        )  # fmt: skip
        return figure


def _frame(axes: Axes, curves: FrictionCurves) -> None:
    axes.set_xlim(float(curves.speed[0]), float(curves.speed[-1]))
    highest = max(curves.static, float(np.max(curves.stribeck)))
    axes.set_ylim(-_ROOM * highest, _ROOM * highest)
    axes.set_xlabel("relative speed $v = V - x'$ [m/s]")
    axes.set_ylabel('coefficient of friction [-]')
    axes.axhline(0.0, color=MUTED, lw=0.8, zorder=1)


def _laws(axes: Axes, curves: FrictionCurves) -> None:
    ahead = curves.speed > 0.0
    for mu, name, colour, line in (
        (curves.stribeck, 'Stribeck: falls with speed', SLIDING, '-'),
        (curves.coulomb, 'Coulomb: constant', EXACT, DASHES),
    ):
        for side, label in ((ahead, name), (~ahead, None)):
            axes.plot(curves.speed[side], mu[side], color=colour, ls=line, lw=2.6, label=label)
    ends = (-curves.static, curves.static)
    axes.plot((0.0, 0.0), ends, color=INK, lw=2.6, label='at rest: −$\\mu_s$ to $\\mu_s$')


def _tangent(axes: Axes, curves: FrictionCurves) -> tuple[FloatArray, FloatArray]:
    speed, coefficient = curves.hopf_speed, curves.hopf_coefficient
    x = speed * np.array([1.0 - _TANGENT, 1.0 + _TANGENT])
    y = coefficient + curves.hopf_slope * (x - speed)
    axes.plot(x, y, color=INK, lw=1.2, zorder=4)
    axes.plot(speed, coefficient, 'o', ms=7.5, mec=INK, mew=1.4, mfc=PAPER, zorder=5)
    return x, y


def _words(axes: Axes, curves: FrictionCurves, tangent: tuple[FloatArray, FloatArray]) -> None:
    labels = Labeller(axes)
    ahead = curves.speed > 0.0
    for mu in (curves.stribeck, curves.coulomb):
        labels.avoid(curves.speed[ahead], mu[ahead])
        labels.avoid(curves.speed[~ahead], mu[~ahead])
    labels.avoid(*tangent)
    labels.avoid([0.0, 0.0], [-curves.static, curves.static])
    speed, coefficient = curves.hopf_speed, curves.hopf_coefficient
    labels.reserve(speed, coefficient)
    text = (
        f'Hopf, $V_H$ = {speed:.4g} m/s:\nfriction falls by $c/N$ per m/s,\n'
        'just what damping can take'
    )
    places = [around(d)[k] for d in (24.0, 36.0, 48.0) for k in (0, 4, 1)]
    labels.point(text, (speed, coefficient), places, size=10.5, linespacing=1.3)
    for sign in (1.0, -1.0):
        _coefficient_words(labels, curves, sign)


def _coefficient_words(labels: Labeller, curves: FrictionCurves, sign: float) -> None:
    """Name the two coefficients, ahead (1) or astern (-1)."""
    ahead = sign > 0.0
    minus, align = ('', 'right') if ahead else ('−', 'left')
    labels.point(
        f'{minus}$\\mu_s$ = {minus}{curves.static:g}', (0.0, sign * curves.static),
        [LabelPlace(-8.0 * sign, 0.0, align)], size=10.5,
    )  # fmt: skip
    end = float(curves.speed[-1 if ahead else 0])
    labels.point(
        f'{minus}$\\mu_k$ = {minus}{curves.kinetic:g}', (end, sign * curves.kinetic),
        [LabelPlace(-8.0 * sign, -6.0 * sign, align, 'top' if ahead else 'bottom')],
        size=10.5, bbox=VEIL,
    )  # fmt: skip


_PERIODS_SHOWN = 3.0
_AT_BELT = 1e-9
_ROOM, _ABOVE = 1.25, 0.2
_STICK = INK


def draw_motion(history: History, statement: str, footnote: str) -> Figure:
    """Draw the growth, the last periods and the phase portrait, from steady sliding.

    Args:
        history: The motion.
        statement: The published statement, above the axes.
        footnote: Said below the axes.

    Returns:
        A figure that pyplot does not know of; :func:`~.canvas.save_figure` writes it.

    Raises:
        DrawingError: matplotlib is not installed.
    """
    with style():
        figure = stated_figure(statement, footnote)
        _growth(figure.add_axes((0.085, 0.615, 0.89, 0.235)), history)
        _last_periods(figure.add_axes((0.085, 0.115, 0.385, 0.375)), history)
        _portrait(figure.add_axes((0.575, 0.115, 0.40, 0.375)), history)
        return figure


def _growth(axes: Axes, history: History) -> None:
    offset = (history.displacement - history.equilibrium) * 1e3
    scale = float(np.max(np.abs(offset)))
    axes.set_xlim(0.0, float(history.time[-1]))
    axes.set_ylim(-_ROOM * scale, _ROOM * scale)
    axes.set_xlabel('time [s]', labelpad=2.0)
    axes.set_ylabel('$x - x_e$ [mm]')
    axes.plot(history.time, offset, color=EXACT, lw=0.9, label='exact')
    for sign, name in ((1.0, 'KBM: amplitude, and its cycle'), (-1.0, None)):
        axes.plot(
            history.time, sign * history.envelope * 1e3, color=INK, lw=1.6, ls=DASHES, label=name
        )
    axes.legend(
        loc='lower left', bbox_to_anchor=(-0.008, 0.99), ncols=2, frameon=False, fontsize=10.0,
        borderaxespad=0.1,
    )  # fmt: skip


def _last_periods(axes: Axes, history: History) -> None:
    begin = float(history.time[-1]) - _PERIODS_SHOWN * history.period
    shown = history.time >= begin
    t = (history.time[shown] - begin) * 1e3
    v = history.velocity[shown] * 1e3
    belt, lowest = history.speed * 1e3, float(np.min(v))
    axes.set_xlim(0.0, float(t[-1]))
    axes.set_ylim(1.12 * lowest, belt + _ABOVE * (belt - lowest))
    axes.set_xlabel('time, last three periods [ms]')
    axes.set_ylabel("velocity $x'$ [mm/s]")
    axes.axhline(belt, color=MUTED, lw=1.0, ls=':')
    axes.plot(t, v, color=EXACT, lw=2.0)
    stick = np.where(history.sticking[shown], v, np.nan)
    axes.plot(t, stick, color=_STICK, lw=4.5, solid_capstyle='butt', zorder=4)
    _shade(axes, t, history.sticking[shown])
    labels = Labeller(axes)
    labels.avoid(t, v)
    middle = _middle_of_stick(t, history.sticking[shown])
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
    """Middle of the stick phase closest to the middle of the history."""
    middles = [0.5 * (t[i] + t[j]) for i, j in _runs(sticking)]
    return min(middles, key=lambda m: abs(m - 0.5 * t[-1]), default=None)


def _portrait(axes: Axes, history: History) -> None:
    x = (history.cycle_displacement - history.equilibrium) * 1e3
    v = history.cycle_velocity * 1e3
    belt = history.speed * 1e3
    axes.set_xlim(1.3 * float(x.min()), 1.3 * float(x.max()))
    axes.set_ylim(1.12 * float(v.min()), belt + _ABOVE * (belt - float(v.min())))
    axes.set_xlabel('$x - x_e$ [mm]')
    axes.set_ylabel("velocity $x'$ [mm/s]")
    axes.axhline(belt, color=MUTED, lw=1.0, ls=':')
    offset = (history.displacement - history.equilibrium) * 1e3
    axes.plot(offset, history.velocity * 1e3, color=EXACT, lw=0.5, alpha=0.45)
    axes.plot(x, v, color=EXACT, lw=2.4, zorder=4)
    stuck = np.where(np.abs(v - belt) <= _AT_BELT * belt, v, np.nan)
    axes.plot(x, stuck, color=_STICK, lw=4.5, zorder=5, solid_capstyle='butt')
    turn = np.linspace(0.0, 2.0 * np.pi, 181)
    a = history.averaged_amplitude * 1e3
    ellipse = a * np.cos(turn), -a * history.natural_frequency * np.sin(turn)
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
    # Outside the orbit: within, its turns leave no room for letters.
    axes.annotate(
        'steady sliding', (0.0, 0.0), (0.02, 0.025), textcoords='axes fraction', size=10.0,
        color=SLIDING, arrowprops={'arrowstyle': '-', 'color': SLIDING, 'lw': 0.9, 'zorder': 6},
    )  # fmt: skip
