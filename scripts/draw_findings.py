# SPDX-License-Identifier: Apache-2.0
"""Draws docs/images/finding_*.png: the published findings on stick-slip, computed again.

The published study averages the mass-spring-belt model (KBM) and compares with numerical
integration. Here the numerical side is the exact non-smooth cycle, so each finding comes with the
error of averaging: amplitudes of both branches over speed, load and kinetic coefficient, and the
growth of stick-slip from a small disturbance.
"""

from __future__ import annotations

import math
import textwrap
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.special import i1e

from stickslip_lab.accuracy.comparison import REFERENCE
from stickslip_monitor.arrays import BoolArray, FloatArray
from stickslip_monitor.drawing import canvas
from stickslip_monitor.monitor.assessment import Regime, assess
from stickslip_monitor.physics.averaging import amplitude_rate, fold_load, fold_speed, hopf_load, hopf_speed
from stickslip_monitor.physics.bearing import Bearing
from stickslip_monitor.physics.cycles import Cycle, exact_cycle, exact_fold_speed, exact_unstable_cycle
from stickslip_monitor.physics.friction import Stribeck
from stickslip_monitor.physics.integrator import Drive, Motion, MotionState, integrate

IMAGES = Path(__file__).resolve().parents[1] / 'docs' / 'images'
REFERENCE_RPM, REFERENCE_LOAD = 20.0, 1000.0


_DISTURBANCE, _ARRIVED = 0.05, 0.995
_MOST_PERIODS, _PERIODS_AFTER, _PER_PERIOD = 250, 8, 120


@dataclass(frozen=True, slots=True, eq=False)
class History:
    """Stick-slip as it grows from a small disturbance of steady sliding, and its cycle."""

    bearing: Bearing
    speed: float  # surface speed [m/s]
    equilibrium: float  # displacement of steady sliding [m]
    time: FloatArray  # shape (n,) [s]
    motion: Motion  # at these times
    envelope: FloatArray  # amplitude under KBM averaging at the same times, shape (n,) [m]
    averaged_amplitude: float  # of stick-slip under KBM [m]
    cycle: Cycle  # the exact one


def stick_slip_history(bearing: Bearing, speed: float, load: float) -> History:
    """Stick-slip from near an unstable equilibrium at a point [m/s, N] to its cycle."""
    averaged = float(assess(bearing, speed, load).amplitude)
    centre = float(bearing.equilibrium(speed, load))
    time, envelope = _averaged_growth(bearing, speed, load, averaged)
    drive = Drive.constant(speed, load, float(time[-1]))
    start = MotionState.moving(centre + float(envelope[0]), 0.0, drive)
    motion = integrate(bearing, drive, start, time, compiled=False)
    cycle = exact_cycle(bearing, speed, load)
    return History(bearing, speed, centre, time, motion, envelope, averaged, cycle)


def _averaged_growth(
    bearing: Bearing, speed: float, load: float, final: float
) -> tuple[FloatArray, FloatArray]:
    """Return times to well after stick-slip has set in, and the amplitude under KBM at each."""
    period = 2.0 * np.pi / bearing.natural_frequency

    def rate(_: float, amplitude: FloatArray) -> FloatArray:
        return amplitude_rate(bearing, speed, load, amplitude)

    def arrived(_: float, amplitude: FloatArray) -> float:
        return float(amplitude[0] - _ARRIVED * final)

    grown = solve_ivp(
        rate,
        (0.0, _MOST_PERIODS * period),
        [_DISTURBANCE * final],
        method='LSODA',
        rtol=1e-9,
        atol=1e-12 * final,
        dense_output=True,
        events=arrived,
    )
    assert grown.t_events is not None
    assert grown.sol is not None
    times = grown.t_events[0]
    onset = float(times[0]) if times.size else _MOST_PERIODS * period
    periods = math.ceil(onset / period) + _PERIODS_AFTER
    time = np.linspace(0.0, periods * period, periods * _PER_PERIOD + 1)
    envelope = grown.sol(np.minimum(time, grown.t[-1]))[0]
    return time, np.asarray(envelope, dtype=float)


_NEAR_AN_END = np.geomspace(1e-9, 0.05, 8)
_REACH = 0.5
_SPEED_ROOM, _LOAD_ROOM, _FALL_ROOM = 1.12, 6.0, 0.55


@dataclass(frozen=True, slots=True, eq=False)
class Sweep:
    """Displacement amplitudes of the limit cycles over one parameter, in its own unit.

    Shapes are (n,), and ``nan`` is where there is no cycle.
    """

    value: FloatArray  # the parameter, rising, close-set beside the bifurcations
    exact: FloatArray  # of the exact stick-slip cycle [m]
    exact_unstable: FloatArray  # of the exact unstable cycle [m]
    averaged: FloatArray  # of stick-slip under first-order KBM averaging [m]
    averaged_unstable: FloatArray  # of the unstable cycle under KBM [m]
    hopf: float  # parameter at the Hopf bifurcation, the same for both methods
    exact_fold: float  # parameter at the exact fold
    averaged_fold: float  # parameter at the fold under KBM

    @property
    def fold_amplitude(self) -> float:
        """Exact amplitude beside the fold [m]."""
        exists = np.flatnonzero(np.isfinite(self.exact))
        nearest = exists[np.argsort(np.abs(self.value[exists] - self.exact_fold))[:1]]
        return float(np.max(self.exact[nearest], initial=0.0))

    @property
    def error(self) -> FloatArray:
        """Relative error of the averaged stick-slip amplitude, shape (n,) [-]."""
        return self.averaged / self.exact - 1.0

    @property
    def unstable_error(self) -> FloatArray:
        """Relative error of the averaged unstable amplitude, shape (n,) [-]."""
        return self.averaged_unstable / self.exact_unstable - 1.0


def over_speed(bearing: Bearing, load: float, points: int = 120) -> Sweep:
    """Amplitude against belt speed [m/s], in so many even steps, at a load with a fold [N]."""
    ends = [float(at(bearing, load)) for at in (hopf_speed, exact_fold_speed, fold_speed)]
    highest = _SPEED_ROOM * float(np.fmax(ends[1], ends[2]))
    speed = _make_grid(highest / points, highest, ends, points)
    return Sweep(speed, *_all_amplitudes(bearing, speed, load), *ends)


def over_load(bearing: Bearing, speed: float, load: float, points: int = 100) -> Sweep:
    """Amplitude against normal force [N], to one with a stick-slip cycle at this speed [m/s]."""
    hopf, averaged_fold = float(hopf_load(bearing, speed)), float(fold_load(bearing, speed))
    fold = _exact_fold(lambda n: exact_fold_speed(bearing, n), speed, averaged_fold)
    ends = hopf, fold, averaged_fold
    highest = max(_LOAD_ROOM * averaged_fold, load)
    loads = _make_grid(highest / points, highest, ends, points)
    return Sweep(loads, *_all_amplitudes(bearing, speed, loads), *ends)


def over_kinetic(bearing: Bearing, speed: float, load: float, points: int = 40) -> Sweep:
    """Amplitude against the kinetic friction coefficient [-], at a belt speed and a load.

    The static coefficient stays, so friction falls by less the larger the kinetic one is. With
    ``kappa = (c + N nu)/(N Delta beta)`` the Hopf lies at ``kappa = exp(-v)`` and the fold under
    KBM at ``kappa = 2 I1e(v)/v``.
    """
    law = bearing.friction
    assert isinstance(law, Stribeck)
    v = law.decay * speed
    damping = (bearing.damping + load * law.viscous) / (load * law.decay)
    hopf, averaged_fold = damping * math.exp(v), damping * 0.5 * v / float(i1e(v))

    def with_fall(fall: float) -> Bearing:
        return replace(bearing, friction=replace(law, kinetic=max(law.static - fall, 0.0)))

    fold = _exact_fold(lambda x: exact_fold_speed(with_fall(x), load), speed, averaged_fold)
    lowest = _FALL_ROOM * averaged_fold
    ends = np.array([hopf, fold, averaged_fold])
    falls = _make_grid(lowest, law.static, ends, points)[::-1]
    rows = [_all_amplitudes(with_fall(fall), speed, load) for fall in falls.tolist()]
    return Sweep(law.static - falls, *np.array(rows).T, *(law.static - ends).tolist())


def _all_amplitudes(bearing: Bearing, speed: Any, load: Any) -> tuple[Any, Any, Any, Any]:
    """Return exact and unstable amplitude, and the same under KBM [m]."""
    averaged = assess(bearing, speed, load)
    return (
        exact_cycle(bearing, speed, load).amplitude,
        exact_unstable_cycle(bearing, speed, load).amplitude,
        averaged.amplitude,
        averaged.threshold_amplitude,
    )


def _make_grid(low: float, high: float, ends: Sequence[float] | FloatArray, points: int) -> FloatArray:
    """Return even values, and more beside each bifurcation, where the branches bend."""
    near = np.outer(ends, np.concatenate([1.0 - _NEAR_AN_END, 1.0 + _NEAR_AN_END])).ravel()
    inside = near[(near > low) & (near < high)]
    return np.union1d(np.linspace(low, high, points), inside)


def _exact_fold(speed_at: Callable[[float], Any], speed: float, averaged: float) -> float:
    """Return where the exact fold is at a speed [m/s], near its place by averaging; ``nan`` if there is none.

    The fold speed rises with the parameter; where there is no fold it counts as 0.
    """

    def above(parameter: float) -> float:
        return float(np.nan_to_num(speed_at(parameter))) - speed

    low, high = (1.0 - _REACH) * averaged, (1.0 + _REACH) * averaged
    if not above(low) < 0.0 < above(high):
        return math.nan
    return float(brentq(above, low, high, xtol=1e-15 * averaged))


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
        _set_frames(axes, below, sweep, value)
        below.set_xlabel(label)
        _draw_bands(axes, below, sweep, scale)
        _draw_branches(axes, sweep, value)
        _draw_marks(axes, sweep, scale, unit)
        _draw_errors(below, sweep, value)
        canvas.legend_above(axes, 4)
        return figure


def _set_frames(axes: canvas.Axes, below: canvas.Axes, sweep: Sweep, value: FloatArray) -> None:
    top = float(np.nanmax([sweep.exact, sweep.averaged], initial=0.0)) * 1e3 or 1.0
    low = 0.0 if value[0] < _FROM_ZERO * value[-1] else float(value[0])
    for panel, name in ((axes, 'amplitude [mm]'), (below, 'KBM error [%]')):
        panel.set_xlim(low, float(value[-1]))
        panel.set_ylabel(name)
        panel.yaxis.set_label_coords(-0.065, 0.5)
    axes.set_ylim(-_BELOW_ZERO * top, _HEADROOM * top)
    axes.tick_params(labelbottom=False)


def _draw_bands(axes: canvas.Axes, below: canvas.Axes, sweep: Sweep, scale: float) -> None:
    """Draw the regimes by the exact boundaries, and steady sliding along zero."""
    low, high = axes.get_xlim()
    rising = sweep.hopf < sweep.exact_fold
    ends = sorted((sweep.hopf / scale, sweep.exact_fold / scale))
    regimes = _REGIMES if rising else _REGIMES[::-1]
    edges = zip(pairwise((low, *ends, high)), regimes, strict=True)
    spans = [(a, b, regime) for (a, b), regime in edges if a < b]
    names = {Regime.STABLE: 'steady sliding', Regime.UNSTABLE: 'steady sliding, unstable'}
    for a, b, regime in spans:
        stable = regime is not Regime.UNSTABLE
        axes.plot(
            (a, b),
            (0.0, 0.0),
            color=SLIDING,
            ls='-' if stable else canvas.DASHES,
            lw=2.4,
            zorder=3,
            label=names.get(regime),
        )
    for panel in (axes, below):
        canvas.draw_regime_bands(panel, spans)


def _draw_branches(axes: canvas.Axes, sweep: Sweep, value: FloatArray) -> None:
    thick: dict[str, Any] = {'color': EXACT, 'lw': 3.0, 'zorder': 4}
    thin: dict[str, Any] = {'color': canvas.INK, 'lw': 1.3, 'zorder': 5}
    for y, name, look in (
        (sweep.exact, 'exact, stable', thick),
        (sweep.exact_unstable, 'exact, unstable', thick | {'ls': (0, (2.6, 1.3))}),
        (sweep.averaged, 'KBM, stable', thin),
        (sweep.averaged_unstable, 'KBM, unstable', thin | {'ls': canvas.DASHES}),
    ):
        axes.plot(value, y * 1e3, label=name, **look)


def _draw_marks(axes: canvas.Axes, sweep: Sweep, scale: float, unit: str) -> None:
    hopf, fold = sweep.hopf / scale, sweep.exact_fold / scale
    error = 100.0 * (sweep.averaged_fold / sweep.exact_fold - 1.0)
    look: dict[str, Any] = {'ls': 'none', 'ms': 7.5, 'mew': 1.4, 'zorder': 7, 'clip_on': False}
    name = f'Hopf {hopf:.4g}{unit}'
    axes.plot(hopf, 0.0, marker='o', mec=canvas.HOPF, mfc=canvas.PAPER, label=name, **look)
    name = f'fold {fold:.4g}{unit} (KBM {error:+.2g} %)'
    height = sweep.fold_amplitude * 1e3
    axes.plot(fold, height, marker='D', mec=canvas.FOLD, mfc=canvas.FOLD, label=name, **look)


def _draw_errors(below: canvas.Axes, sweep: Sweep, value: FloatArray) -> None:
    below.axhline(0.0, color=canvas.MUTED, lw=0.8, zorder=2)
    errors = 100.0 * sweep.error, 100.0 * sweep.unstable_error
    for error, line in zip(errors, ('-', canvas.DASHES), strict=True):
        below.plot(value, error, color=canvas.INK, lw=1.8, ls=line, zorder=4)
    lowest = max(1.08 * float(np.nanmin(errors, initial=-0.1)), _WORST_SHOWN)
    below.set_ylim(lowest, -0.16 * lowest)


_PERIODS_SHOWN = 3.0
_AT_BELT, _CYCLE_POINTS = 1e-9, 721
_MARGIN, _ABOVE = 1.25, 0.2


def draw_motion(history: History, statement: str, footnote: str) -> canvas.Figure:
    """Draw the growth, the last periods and the phase portrait, from steady sliding."""
    with canvas.style():
        figure = _stated_figure(statement, footnote)
        _draw_growth(figure.add_axes((0.085, 0.615, 0.89, 0.235)), history)
        _last_periods(figure.add_axes((0.085, 0.105, 0.385, 0.345)), history)
        _draw_portrait(figure.add_axes((0.575, 0.105, 0.40, 0.345)), history)
        return figure


def _draw_growth(axes: canvas.Axes, history: History) -> None:
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


def _draw_sticking(axes: canvas.Axes, x: FloatArray, velocity: FloatArray, sticking: BoolArray) -> None:
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
    is_shown = history.time >= begin
    time, velocity = (history.time[is_shown] - begin) * 1e3, history.motion.velocity[is_shown] * 1e3
    sticking = history.motion.sticking[is_shown]
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
    _draw_sticking(axes, time, velocity, sticking)
    canvas.legend_above(axes, 1)


def _draw_portrait(axes: canvas.Axes, history: History) -> None:
    _, displacement, velocity, *_ = history.cycle.waveform(_CYCLE_POINTS)
    x, velocity = (displacement - history.equilibrium) * 1e3, velocity * 1e3
    belt = history.speed * 1e3
    axes.set_xlim(1.3 * float(x.min()), 1.3 * float(x.max()))
    axes.set_xlabel('$x - x_e$ [mm]')
    _velocity_axis(axes, velocity, belt)
    offset = (history.motion.displacement - history.equilibrium) * 1e3
    axes.plot(offset, history.motion.velocity * 1e3, color=EXACT, lw=0.5, alpha=0.45)
    axes.plot(x, velocity, color=EXACT, lw=2.4, zorder=4)
    _draw_sticking(axes, x, velocity, np.abs(velocity - belt) <= _AT_BELT * belt)
    turn = np.linspace(0.0, 2.0 * np.pi, 181)
    a = history.averaged_amplitude * 1e3
    ellipse = a * np.cos(turn), -a * history.bearing.natural_frequency * np.sin(turn)
    axes.plot(*ellipse, color=canvas.INK, lw=1.3, ls=canvas.DASHES, zorder=6)
    axes.plot(0.0, 0.0, 'o', ms=6.0, mfc=SLIDING, mec='none', zorder=6, label='steady sliding')
    canvas.legend_above(axes, 2)


def main() -> None:
    """Draw the pictures."""
    rpm, load = REFERENCE.speed.factor('rpm'), REFERENCE_LOAD
    speed = REFERENCE_RPM * rpm
    at_load, at_speed = f'reference bearing, load {load:g} N', f'reference bearing, {REFERENCE_RPM:g} rpm'
    kinetic = over_kinetic(REFERENCE, speed, load)
    pictures = {
        'finding_1_speed': draw_amplitudes(
            over_speed(REFERENCE, load),
            'The amplitude of stick-slip grows with the belt speed up to a fold, where it meets an'
            ' unstable cycle; steady sliding is lost in a subcritical Hopf bifurcation.',
            at_load,
            'shaft speed [rpm]',
            ' rpm',
            rpm,
        ),
        'finding_2_load': draw_amplitudes(
            over_load(REFERENCE, speed, load),
            'The amplitude of stick-slip rises slowly with the normal force; at a low force there is'
            ' only the equilibrium.',
            at_speed,
            'normal force [N]',
            ' N',
        ),
        'finding_3_kinetic': draw_amplitudes(
            kinetic,
            'The amplitude of stick-slip falls as the kinetic friction coefficient rises; beyond a'
            f' coefficient of about {kinetic.averaged_fold:.2g} there is only the equilibrium.',
            f'{at_speed}, load {load:g} N',
            'kinetic friction coefficient $\\mu_k$ [-]',
        ),
        'finding_4_motion': draw_motion(
            stick_slip_history(REFERENCE, speed, load),
            'A small disturbance of steady sliding grows into stick-slip: in the phase plane the'
            ' motion runs onto a limit cycle with a straight piece, the stick phase.',
            f'{at_speed}, load {load:g} N',
        ),
    }
    for name, figure in pictures.items():
        canvas.save_figure(figure, IMAGES / f'{name}.png', force=True)


if __name__ == '__main__':
    main()
