# SPDX-License-Identifier: Apache-2.0
"""Draws what the laboratory finds: the published findings, and what accuracy costs in time.

Amplitudes over a parameter, stick-slip in time, and error against time with the Pareto front. Of a
finding the published statement stands above the axes. Figures are unknown to pyplot;
:func:`~.canvas.save_figure` writes them. Each function raises a ``DrawingError`` where matplotlib
is not installed.
"""

from __future__ import annotations

import math
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from stickslip_monitor.arrays import BoolArray, FloatArray
from stickslip_monitor.drawing import canvas
from stickslip_monitor.lab.findings import History, Sweep
from stickslip_monitor.monitor.assessment import Regime

EXACT = canvas.REGIME_COLOUR[Regime.UNSTABLE]
SLIDING = canvas.REGIME_COLOUR[Regime.STABLE]
_TALL, _LETTERS = 6.6, 86
_REGIMES = (Regime.UNSTABLE, Regime.BISTABLE, Regime.STABLE)


def _stated_figure(statement: str, footnote: str) -> canvas.Figure:
    figure = canvas.new_figure(canvas.WIDTH, _TALL)
    figure.text(
        0.085,
        0.975,
        textwrap.fill(statement, _LETTERS),
        ha='left',
        va='top',
        size=11.5,
        weight='bold',
        linespacing=1.35,
    )
    figure.text(0.975, 0.012, footnote, ha='right', va='bottom', size=9.0, color=canvas.MUTED)
    return figure


_HEADROOM, _BELOW_ZERO, _FROM_ZERO = 1.16, 0.06, 0.02
# The error of averaging is shown down to here [%].
_WORST_SHOWN = -100.0


def draw_amplitudes(
    sweep: Sweep, statement: str, footnote: str, label: str, unit: str = '', scale: float = 1.0
) -> canvas.Figure:
    """Draw the branches over a parameter and, below them, the error of averaging.

    The footnote says what they hold for, the label the parameter's name and unit. ``unit`` stands
    behind a number, with a space before it, and is ``scale`` of the sweep's.
    """
    with canvas.style():
        figure = _stated_figure(statement, footnote)
        axes = figure.add_axes((0.085, 0.335, 0.89, 0.465))
        below = figure.add_axes((0.085, 0.105, 0.89, 0.185))
        value = sweep.value / scale
        _frames(axes, below, sweep, value)
        below.set_xlabel(label)
        _bands(axes, below, sweep, scale)
        _branches(axes, sweep, value)
        _marks(axes, sweep, scale, unit)
        _errors(below, sweep, value)
        canvas.legend_above(axes, 4)
        return figure


def _frames(axes: canvas.Axes, below: canvas.Axes, sweep: Sweep, value: FloatArray) -> None:
    top = float(np.nanmax([sweep.exact, sweep.averaged], initial=0.0)) * 1e3 or 1.0
    low = 0.0 if value[0] < _FROM_ZERO * value[-1] else float(value[0])
    for each, name in ((axes, 'amplitude [mm]'), (below, 'KBM error [%]')):
        each.set_xlim(low, float(value[-1]))
        each.set_ylabel(name)
        each.yaxis.set_label_coords(-0.065, 0.5)
    axes.set_ylim(-_BELOW_ZERO * top, _HEADROOM * top)
    axes.tick_params(labelbottom=False)


def _bands(axes: canvas.Axes, below: canvas.Axes, sweep: Sweep, scale: float) -> None:
    """Which regime holds where, by the exact boundaries, and steady sliding along zero."""
    low, high = axes.get_xlim()
    rising = sweep.hopf < sweep.exact_fold
    ends = sorted((sweep.hopf / scale, sweep.exact_fold / scale))
    regimes = _REGIMES if rising else _REGIMES[::-1]
    edges = zip(pairwise((low, *ends, high)), regimes, strict=True)
    spans = [(a, b, regime) for (a, b), regime in edges if a < b]
    for a, b, regime in spans:
        stable = regime is not Regime.UNSTABLE
        axes.plot(
            (a, b),
            (0.0, 0.0),
            color=SLIDING,
            ls='-' if stable else canvas.DASHES,
            lw=2.4,
            zorder=3,
            label='steady sliding' if regime is Regime.STABLE else None,
        )
    canvas.regime_bands([axes, below], spans)


def _branches(axes: canvas.Axes, sweep: Sweep, value: FloatArray) -> None:
    thick: dict[str, Any] = {'color': EXACT, 'lw': 3.0, 'zorder': 4}
    thin: dict[str, Any] = {'color': canvas.INK, 'lw': 1.3, 'zorder': 5}
    for y, name, look in (
        (sweep.exact, 'exact, stable', thick),
        (sweep.exact_unstable, 'exact, unstable', thick | {'ls': (0, (2.6, 1.3))}),
        (sweep.averaged, 'KBM, stable', thin),
        (sweep.averaged_unstable, 'KBM, unstable', thin | {'ls': canvas.DASHES}),
    ):
        axes.plot(value, y * 1e3, label=name, **look)


def _marks(axes: canvas.Axes, sweep: Sweep, scale: float, unit: str) -> None:
    hopf, fold = sweep.hopf / scale, sweep.exact_fold / scale
    error = 100.0 * (sweep.averaged_fold / sweep.exact_fold - 1.0)
    look: dict[str, Any] = {'ls': 'none', 'ms': 7.5, 'mew': 1.4, 'zorder': 7, 'clip_on': False}
    name = f'Hopf {hopf:.4g}{unit}'
    axes.plot(hopf, 0.0, marker='o', mec=canvas.HOPF, mfc=canvas.PAPER, label=name, **look)
    name = f'fold {fold:.4g}{unit} (KBM {error:+.2g} %)'
    height = sweep.fold_amplitude * 1e3
    axes.plot(fold, height, marker='D', mec=canvas.FOLD, mfc=canvas.FOLD, label=name, **look)


def _errors(below: canvas.Axes, sweep: Sweep, value: FloatArray) -> None:
    below.axhline(0.0, color=canvas.MUTED, lw=0.8, zorder=2)
    errors = 100.0 * sweep.error, 100.0 * sweep.unstable_error
    for error, line in zip(errors, ('-', canvas.DASHES), strict=True):
        below.plot(value, error, color=canvas.INK, lw=1.8, ls=line, zorder=4)
    shown = max(1.08 * float(np.nanmin(errors, initial=-0.1)), _WORST_SHOWN)
    below.set_ylim(shown, -0.16 * shown)


_PERIODS_SHOWN = 3.0
_AT_BELT, _CYCLE_POINTS = 1e-9, 721
_MARGIN, _ABOVE = 1.25, 0.2


def draw_motion(history: History, statement: str, footnote: str) -> canvas.Figure:
    """Draw the growth, the last periods and the phase portrait, from steady sliding."""
    with canvas.style():
        figure = _stated_figure(statement, footnote)
        _growth(figure.add_axes((0.085, 0.615, 0.89, 0.235)), history)
        _last_periods(figure.add_axes((0.085, 0.105, 0.385, 0.345)), history)
        _portrait(figure.add_axes((0.575, 0.105, 0.40, 0.345)), history)
        return figure


def _growth(axes: canvas.Axes, history: History) -> None:
    offset = (history.motion.displacement - history.equilibrium) * 1e3
    scale = _MARGIN * float(np.max(np.abs(offset)))
    axes.set_xlim(0.0, float(history.time[-1]))
    axes.set_ylim(-scale, scale)
    axes.set_xlabel('time [s]', labelpad=2.0)
    axes.set_ylabel('$x - x_e$ [mm]')
    axes.plot(history.time, offset, color=EXACT, lw=0.9, label='exact')
    for sign, name in ((1e3, 'KBM: amplitude, and its cycle'), (-1e3, None)):
        envelope = sign * history.envelope
        axes.plot(history.time, envelope, color=canvas.INK, lw=1.6, ls=canvas.DASHES, label=name)
    canvas.legend_above(axes, 2)


def _velocity_axis(axes: canvas.Axes, velocity: FloatArray, belt: float) -> None:
    """Velocities [mm/s], with a line at the belt's."""
    lowest = float(np.min(velocity))
    axes.set_ylim(1.12 * lowest, belt + _ABOVE * (belt - lowest))
    axes.set_ylabel("velocity $x'$ [mm/s]")
    axes.axhline(belt, color=canvas.MUTED, lw=1.0, ls=':')


def _stick(axes: canvas.Axes, x: FloatArray, velocity: FloatArray, sticking: BoolArray) -> None:
    axes.plot(
        x,
        np.where(sticking, velocity, np.nan),
        color=canvas.INK,
        lw=4.5,
        solid_capstyle='butt',
        zorder=5,
        label="stick, $x' = V$",
    )


def _last_periods(axes: canvas.Axes, history: History) -> None:
    begin = float(history.time[-1]) - _PERIODS_SHOWN * float(history.cycle.period)
    shown = history.time >= begin
    time, velocity = (history.time[shown] - begin) * 1e3, history.motion.velocity[shown] * 1e3
    sticking = history.motion.sticking[shown]
    axes.set_xlim(0.0, float(time[-1]))
    axes.set_xlabel('time, last three periods [ms]')
    _velocity_axis(axes, velocity, history.speed * 1e3)
    axes.plot(time, velocity, color=EXACT, lw=2.0)
    axes.fill_between(
        time,
        0.0,
        1.0,
        where=sticking.tolist(),
        transform=axes.get_xaxis_transform(),
        color=canvas.REGIME_FILL[Regime.UNSTABLE],
        lw=0.0,
        zorder=0,
    )
    _stick(axes, time, velocity, sticking)
    canvas.legend_above(axes, 1)


def _portrait(axes: canvas.Axes, history: History) -> None:
    _, displacement, velocity, *_ = history.cycle.waveform(_CYCLE_POINTS)
    x, velocity = (displacement - history.equilibrium) * 1e3, velocity * 1e3
    belt = history.speed * 1e3
    axes.set_xlim(1.3 * float(x.min()), 1.3 * float(x.max()))
    axes.set_xlabel('$x - x_e$ [mm]')
    _velocity_axis(axes, velocity, belt)
    offset = (history.motion.displacement - history.equilibrium) * 1e3
    axes.plot(offset, history.motion.velocity * 1e3, color=EXACT, lw=0.5, alpha=0.45)
    axes.plot(x, velocity, color=EXACT, lw=2.4, zorder=4)
    _stick(axes, x, velocity, np.abs(velocity - belt) <= _AT_BELT * belt)
    turn = np.linspace(0.0, 2.0 * np.pi, 181)
    a = history.averaged_amplitude * 1e3
    ellipse = a * np.cos(turn), -a * history.bearing.natural_frequency * np.sin(turn)
    axes.plot(*ellipse, color=canvas.INK, lw=1.3, ls=canvas.DASHES, zorder=6)
    axes.plot(0.0, 0.0, 'o', ms=6.0, mfc=SLIDING, mec='none', zorder=6, label='steady sliding')
    canvas.legend_above(axes, 2)


# Okabe and Ito's hues and black; a marker of its own tells each family apart in grey.
_LOOKS = (
    ('#0072b2', 'o'),
    ('#56b4e9', 'v'),
    ('#d55e00', 'P'),
    ('#e69f00', 's'),
    ('#cc79a7', 'X'),
    ('#8c8c8c', '^'),
    ('#009e73', 'D'),
    ('#000000', '*'),
    ('#7a1f5c', 'h'),
)
_SMALLEST, _FAILED = 1e-16, 30.0
_LOWEST, _HIGHEST = 3e-17, 100.0
_FRONT = '#444444'


@dataclass(frozen=True, slots=True)
class MethodMark:
    """A method in a panel."""

    family: str  # groups marks by colour and shape
    seconds: float  # time per operating point [s]
    error: float  # relative error [-]; infinite where it fails
    front: bool  # whether no other method beats it
    # Whether many points were solved in one call; such marks are drawn hollow.
    together: bool = False


def draw_pareto(panels: Mapping[str, Sequence[MethodMark]], footnote: str = '') -> canvas.Figure:
    """Draw error against time in panels beside each other, each with its title."""
    every = [mark for marks in panels.values() for mark in marks]
    families = list(dict.fromkeys(mark.family for mark in every))
    looks = {family: _LOOKS[i % len(_LOOKS)] for i, family in enumerate(families)}
    times = [mark.seconds for mark in every]
    with canvas.style():
        figure = canvas.new_figure(12.0, 7.2)
        figure.subplots(1, len(panels), sharex=True, sharey=True)
        figure.subplots_adjust(left=0.075, right=0.985, bottom=0.215, top=0.95, wspace=0.04)
        for axes, (title, marks) in zip(figure.axes, panels.items(), strict=True):
            axes.set(
                xscale='log',
                yscale='log',
                ylim=(_LOWEST, _HIGHEST),
                xlim=(0.4 * min(times, default=1e-6), 3.0 * max(times, default=1.0)),
                yticks=[10.0**k for k in range(-16, 1, 2)],
                xlabel='time per operating point [s]',
            )
            axes.minorticks_off()
            axes.grid(color='#e6e6e6', lw=0.6)
            axes.axhspan(6.0, _HIGHEST, color='#f0f0f0', lw=0.0)
            axes.set_title(title, loc='left', size=11.0, color=canvas.INK)
            _methods(axes, marks, looks)
        figure.axes[0].set_ylabel('relative error of the amplitude [-]')
        _name_families(figure, looks)
        figure.text(0.985, 0.012, footnote, ha='right', va='bottom', size=9.0, color=canvas.MUTED)
        return figure


def _height(error: float) -> float:
    return _FAILED if math.isinf(error) else float(np.clip(error, _SMALLEST, 5.0))


def _methods(axes: canvas.Axes, marks: Sequence[MethodMark], looks: dict[str, tuple[str, str]]) -> None:
    front = sorted((m for m in marks if m.front), key=lambda m: m.seconds)
    x, y = [m.seconds for m in front], [_height(m.error) for m in front]
    axes.step(x, y, where='post', color=_FRONT, lw=1.4, ls=canvas.DASHES, zorder=2)
    for mark in marks:
        colour, shape = looks[mark.family]
        edge = colour if mark.together else canvas.INK if mark.front else canvas.PAPER
        axes.plot(
            mark.seconds,
            _height(mark.error),
            shape,
            ms=_size(shape),
            mfc=canvas.PAPER if mark.together else colour,
            mec=edge,
            mew=1.4 if mark.front or mark.together else 0.8,
            zorder=4,
        )
    if any(math.isinf(mark.error) for mark in marks):
        axes.text(
            0.012,
            0.988,
            'fails at some case',
            transform=axes.transAxes,
            va='top',
            size=8.5,
            color=canvas.MUTED,
        )


def _size(shape: str) -> float:
    return 13.0 if shape == '*' else 8.5


def _name_families(figure: canvas.Figure, looks: dict[str, tuple[str, str]]) -> None:
    from matplotlib.lines import Line2D

    rows: list[tuple[str, dict[str, Any]]] = [
        (name, {'marker': shape, 'ls': '', 'ms': _size(shape), 'mfc': colour, 'mec': canvas.PAPER})
        for name, (colour, shape) in looks.items()
    ]
    hollow = {'marker': 'o', 'ls': '', 'ms': 8.0, 'mfc': canvas.PAPER, 'mec': canvas.INK}
    rows.append(('many points at once', hollow))
    line = {'color': _FRONT, 'lw': 1.4, 'ls': canvas.DASHES}
    rows.append(('Pareto front, one point at a time', line))
    handles = [Line2D([], [], label=name, **look) for name, look in rows]
    canvas.legend_below(figure, 5, 0.075, 0.045, handles=handles)
