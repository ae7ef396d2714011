# SPDX-License-Identifier: Apache-2.0
"""Draws the results of the laboratory: a friction curve with its fit, a calibration, what accuracy costs.

Figures are unknown to pyplot; :func:`~.canvas.save_figure` writes them. Each function raises a
``DrawingError`` where matplotlib is not installed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from stickslip_lab.calibration.calibration import Calibration
from stickslip_lab.calibration.edges import ReportedCourse
from stickslip_lab.calibration.level_reports import LevelBins
from stickslip_lab.friction.friction_fit import StribeckFit
from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.drawing import canvas
from stickslip_monitor.errors import plural
from stickslip_monitor.monitor.assessment import Regime
from stickslip_monitor.monitor.parameters import BearingConfig
from stickslip_monitor.physics.probability import QUANTILES

_LINE = canvas.REGIME_COLOUR[Regime.STABLE]
_OUTLIER = canvas.REGIME_COLOUR[Regime.UNSTABLE]


def draw_friction_fit(
    fit: StribeckFit, footnote: str = '', boundaries: Mapping[str, Sequence[float]] | None = None
) -> canvas.Figure:
    """Draw the points, the curve with its confidence band, the outliers, and boundaries.

    Args:
        fit: The fit.
        footnote: Text below the axes.
        boundaries: Lower end, middle and upper end of ``hopf_speed`` and ``fold_speed`` [m/s]; one whose
            middle is 0 is left out; ``None`` for none.

    Raises:
        DrawingError: matplotlib is not installed.
    """
    law = fit.law
    title = f'μ = {law.kinetic:.4g} + {law.static - law.kinetic:.4g} exp(−{law.decay:.4g} v)'
    title += f' + {law.viscous:.3g} v' if law.viscous else ''
    with canvas.style():
        labels = 'sliding speed [m/s]', 'coefficient of friction [-]'
        figure, axes = canvas.new_panel(*labels, title=title, footnote=footnote)
        _draw_law(axes, fit)
        _draw_points(axes, fit)
        for name, speeds in (boundaries or {}).items():
            _draw_boundary(axes, 'Hopf' if name == 'hopf_speed' else 'fold', *speeds)
        axes.legend(loc='upper right', frameon=True, framealpha=0.9, edgecolor='none')
        return figure


def _draw_law(axes: canvas.Axes, fit: StribeckFit) -> None:
    """Draw the law with its 95 % band, and set limits of the axes that hold law and points."""
    top = 1.05 * float(fit.curve.speed.max())
    speed = np.linspace(0.0, top, 400)
    law, half = fit.law.coefficient(speed), fit.band(speed)
    band: canvas.Look = {'color': _LINE, 'alpha': 0.25, 'lw': 0.0, 'label': '95 % confidence band'}
    axes.fill_between(speed, law - half, law + half, **band)
    axes.plot(speed, law, color=_LINE, zorder=4, label='fitted law')
    values = np.concatenate([fit.curve.coefficient, law])
    room = 0.05 * float(np.ptp(values))
    axes.set_xlim(-0.02 * top, top)
    axes.set_ylim(min(0.0, float(values.min()) - room), float(values.max()) + 2.0 * room)


def _draw_points(axes: canvas.Axes, fit: StribeckFit) -> None:
    """Draw the points, with error bars where errors differ, and outliers as crosses with line numbers."""
    curve, out = fit.curve, fit.outliers
    good = fit.weight >= 0.5
    if float(np.ptp(curve.std)) > 0.0:
        bars: canvas.Look = {'fmt': 'none', 'ecolor': canvas.MUTED, 'elinewidth': 0.8}
        axes.errorbar(curve.speed, curve.coefficient, curve.std * fit.scale, **bars)
    for rows, marker, size, face, edge, name in (
        (good, 'o', 5.5, canvas.PAPER, canvas.INK, 'measured'),
        (~good, 'X', 9.0, _OUTLIER, canvas.PAPER, 'outlier (weight below half)'),
    ):
        look: canvas.Look = {'ms': size, 'mfc': face, 'mec': edge, 'zorder': 5}
        if rows.any():
            axes.plot(curve.speed[rows], curve.coefficient[rows], marker, label=name, **look)
    plate = {'fc': canvas.PAPER, 'ec': 'none', 'alpha': 0.75, 'pad': 0.8}
    beside: canvas.Look = {'xytext': (8.0, 0.0), 'textcoords': 'offset points', 'va': 'center'}
    for k in out:
        at = curve.speed[k], curve.coefficient[k]
        axes.annotate(f'line {curve.line[k]}', at, size=9.0, color=canvas.MUTED, bbox=plate, **beside)


def _draw_boundary(axes: canvas.Axes, name: str, low: float, middle: float, high: float) -> None:
    """Draw a boundary speed as a line in its interval, with its name at the foot; nothing if it is 0.

    Args:
        axes: The axes, with their limits set.
        name: ``'Hopf'`` or ``'fold'``.
        low: Lower end of the interval [m/s].
        middle: The boundary [m/s].
        high: Upper end of the interval [m/s].
    """
    if not middle > 0.0:
        return
    regime, colour, dashes = canvas.BOUNDARY_LINES[name]
    axes.axvspan(low, high, color=canvas.REGIME_FILL[regime], alpha=0.8, lw=0.0, zorder=0)
    axes.axvline(middle, color=colour, lw=1.4, ls=dashes, zorder=1)
    bottom = axes.get_ylim()[0] + 0.02 * float(np.ptp(axes.get_ylim()))
    look: canvas.Look = {'rotation': 90.0, 'ha': 'right', 'va': 'bottom', 'size': 10.0}
    beside: canvas.Look = {'xytext': (-3.0, 0.0), 'textcoords': 'offset points'}
    axes.annotate(f'{name} speed', (low, bottom), color=canvas.INK, **look, **beside)


_QUIET, _VIBRATING = canvas.REGIME_COLOUR[Regime.STABLE], canvas.REGIME_COLOUR[Regime.UNSTABLE]
# Multiple of the configured fold speed up to which values are drawn: there is no stick-slip above.
_MAX_RATIO = 2.5


def draw_calibration(config: BearingConfig, calibration: Calibration) -> canvas.Figure:
    """Draw the evidence of a calibration over the speed, and both boundaries before and after it beside that.

    The evidence is the level if any recording has one, else the reported vibration of each passage.

    Raises:
        DrawingError: matplotlib is not installed.
        PhysicsError: The friction law cannot be moved so far.
    """
    has_level = any(one.level is not None for one in calibration.evidence)
    with canvas.style():
        count = plural(len(calibration.edges.tracks), 'passage'), plural(calibration.episodes, 'episode')
        figure, axes = canvas.new_panel(
            'shaft speed / configured fold speed',
            'level / surface speed [dB]' if has_level else 'passage',
            title=f'{config.name}: {", ".join(count)}',
            size=(11.0, 5.0),
            box=(0.065, 0.125, 0.42, 0.79),
        )
        (_draw_levels if has_level else _draw_reports)(axes, calibration)
        _draw_ends(axes, calibration, has_level)
        axes.axvline(1.0, color=canvas.INK, ls=':', lw=1.2, label='configured fold')
        _draw_fold(axes, calibration)
        fastest = max(float(track.over.max()) for track in calibration.edges.tracks)
        axes.set_xlim(0.0, max(1.2, min(1.05 * fastest, _MAX_RATIO)))
        axes.legend(loc='best', frameon=True, framealpha=0.9, fontsize=8.5, markerscale=2.0)
        _draw_boundaries(figure.add_axes((0.56, 0.125, 0.42, 0.79)), config, calibration)
    return figure


def _is_vibrating(track: ReportedCourse, time: FloatArray) -> np.ndarray:
    """Return whether each time [s] lies in a report of vibration of a passage, of their shape."""
    loud = [(one.start_ns / 1e9, one.end_ns / 1e9) for one in track.reports if one.squeal]
    return np.any([np.zeros(time.size, bool), *((time >= a) & (time <= b) for a, b in loud)], axis=0)


def _draw_levels(axes: canvas.Axes, calibration: Calibration) -> None:
    """Draw the values of the levels over the speed, coloured as quiet or vibration by the reports.

    Values above 2.5 times the configured fold speed are left out, and of the others so many that up to about
    6000 remain: more only make the file larger.
    """
    by_name = {one.name: one.level for one in calibration.evidence}
    rows = []
    for track in calibration.edges.tracks:
        if (level := by_name[track.name]) is not None:
            about = (level.time >= track.time[0]) & (level.time <= track.time[-1])
            time = level.time[about]
            over = np.interp(time, track.time, track.over)
            rows.append([over, level.value[about], _is_vibrating(track, time)])
    points = np.concatenate(rows, axis=1)
    points = points[:, points[0] < _MAX_RATIO]
    points = points[:, :: max(1, points.shape[1] // 6000)]
    look: canvas.Look = {'ms': 2.5, 'alpha': 0.5, 'mew': 0.0, 'rasterized': True}
    for flag, colour, name in ((0.0, _QUIET, 'quiet'), (1.0, _VIBRATING, 'vibration')):
        axes.plot(*points[:2, points[2] == flag], '.', color=colour, label=name, **look)


def _draw_reports(axes: canvas.Axes, calibration: Calibration) -> None:
    """Draw each passage as a line over speed over configured fold speed, thick where vibration was reported.

    Sets limits and ticks of the height: passages are numbered upwards from 1.
    """
    names = 'passage', 'vibration reported'
    for k, track in enumerate(calibration.edges.tracks, 1):
        loud = np.where(_is_vibrating(track, track.time), track.over, np.nan)
        height = np.full(loud.size, k)
        axes.plot(track.over, height, color=_QUIET, lw=1.0, label=names[0])
        axes.plot(loud, height, color=_VIBRATING, lw=4.0, label=names[1])
        names = '_', '_'  # named once
    axes.set_ylim(0.4, len(calibration.edges.tracks) + 0.6)
    axes.set_yticks(range(1, len(calibration.edges.tracks) + 1))


def _draw_ends(axes: canvas.Axes, calibration: Calibration, has_level: bool) -> None:
    """Draw the ends that count as at the fold, the bounds from below, and crosses at worthless ends.

    A mark stands at the height of its passage's number or, with ``has_level``, at half the height of the
    axes. Where parts of a recording overlap in time, as after a step back of the clock, its passage is the
    first of them.
    """
    doubtful = {id(end) for end, _ in calibration.doubts}
    low, high = axes.get_ylim()
    for mark, text, edge, chosen in (
        ('^', 'end at the fold', canvas.PAPER, [e for e in calibration.edges.seen if id(e) not in doubtful]),
        ('>', 'fold is not below', canvas.PAPER, [e for e in calibration.edges.ends if e.is_bound]),
        ('x', 'worthless', canvas.INK, [e for e in calibration.edges.ends if id(e) in doubtful]),
    ):
        at = []
        for end in chosen:
            k, track = next(
                (k, track)
                for k, track in enumerate(calibration.edges.tracks, 1)
                if track.name == end.recording and track.time[0] <= end.time <= track.time[-1]
            )
            over = float(np.interp(end.time, track.time, track.over))
            at.append((over, low + 0.5 * (high - low) if has_level else float(k)))
        if at:
            axes.plot(*np.array(at).T, mark, color=canvas.INK, mec=edge, ms=8.0, label=text)


def _draw_fold(axes: canvas.Axes, calibration: Calibration) -> None:
    """Draw the calibrated over the configured fold at the geometric middle of the loads, 5 to 95 %.

    Raises:
        PhysicsError: The friction law cannot be moved so far.
    """
    load = float(np.sqrt(calibration.loads[0] * calibration.loads[1]))
    configured = float(np.exp(calibration.reference.fold(np.array([np.log(load)]))[0]))
    low, middle, high = (float(calibration.belief.fold_speed(load, p)) / configured for p in QUANTILES)
    _, colour, dashes = canvas.BOUNDARY_LINES['fold']
    axes.axvspan(low, high, color=colour, alpha=0.2, lw=0.0, label='calibrated fold, 5 to 95 %')
    axes.axvline(middle, color=colour, ls=dashes, lw=1.6)


def _draw_boundaries(axes: canvas.Axes, config: BearingConfig, calibration: Calibration) -> None:
    """Draw fold and Hopf speed [rpm] against the load before and after, with 5 to 95 % bands, and passages.

    Sets title, labels, limits and legend of the axes.

    Raises:
        PhysicsError: The friction law cannot be moved so far.
    """
    low, high = calibration.loads
    load, rpm = np.linspace(0.6 * low, 1.4 * high, 60), config.bearing.speed.factor('rpm')
    top = 0.0
    for name in ('fold', 'Hopf'):
        regime, colour, dashes = canvas.BOUNDARY_LINES[name]
        (left, was, right), (near, now, far) = (
            [getattr(b, f'{name.lower()}_speed')(load, p) / rpm for p in QUANTILES]
            for b in (calibration.before, calibration.belief)
        )
        band = canvas.REGIME_COLOUR[regime]
        hatched: canvas.Look = {'fc': 'none', 'ec': band, 'hatch': '////', 'lw': 0.0, 'alpha': 0.35}
        axes.fill_betweenx(load, left, right, label=f'{name} before, 5 to 95 %', **hatched)
        axes.plot(was, load, color=canvas.MUTED, ls=dashes, lw=1.0, label=f'{name} before')
        axes.fill_betweenx(load, near, far, color=band, alpha=0.45, lw=0.0)
        axes.plot(now, load, color=colour, ls=dashes, lw=1.8, label=f'{name} now, 5 to 95 %')
        top = max(top, float(far.max()), float(was.max()))
    thin: canvas.Look = {'color': canvas.INK, 'lw': 0.5, 'alpha': 0.5, 'zorder': 1}
    for k, track in enumerate(calibration.edges.tracks):
        axes.plot(track.speed / rpm, track.load, label='_' if k else 'passages', **thin)
    axes.set_xlabel('shaft speed [rpm]')
    axes.set_ylabel('load [N]')
    axes.set_title('boundaries', loc='left', size=11.0, color=canvas.INK)
    axes.set_xlim(0.0, 1.5 * top)
    axes.set_ylim(float(load[0]), float(load[-1]))
    axes.legend(loc='best', frameon=True, framealpha=0.9, fontsize=8.5)


def draw_levels(config: BearingConfig, levels: Sequence[LevelBins]) -> canvas.Figure:
    """Draw a histogram of all values of the levels of a bearing, in which no two modes were found.

    Raises:
        DrawingError: matplotlib is not installed.
    """
    with canvas.style():
        labels = 'level / surface speed [dB]', 'values'
        figure, axes = canvas.new_panel(*labels, title=f'{config.name}: no two modes')
        value = np.concatenate([np.empty(0), *(level.value for level in levels)])
        axes.hist(value, bins=80, color=_QUIET, label='all recordings, each value of 0.25 s')
        axes.legend(loc='best', frameon=True)
    return figure


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
_FRONT = '#444444'


@dataclass(frozen=True, slots=True)
class MethodMark:
    """A method in a panel."""

    family: str  # groups marks by colour and shape
    seconds: float  # time per operating point [s]
    error: float  # absolute relative error [-]; infinite where it fails
    front: bool  # whether no other method beats it
    # Whether many points were solved in one call; such marks are drawn hollow.
    in_bulk: bool = False


def draw_pareto(panels: Mapping[str, Sequence[MethodMark]], footnote: str = '') -> canvas.Figure:
    """Draw error against time of methods, on logarithmic axes in panels beside each other.

    Args:
        panels: Methods by the title of their panel; at least one panel.
        footnote: Text at the foot.

    Raises:
        DrawingError: matplotlib is not installed.
    """
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
                ylim=(3e-17, 100.0),
                xlim=(0.4 * min(times, default=1e-6), 3.0 * max(times, default=1.0)),
                yticks=[10.0**k for k in range(-16, 1, 2)],
                xlabel='time per operating point [s]',
            )
            axes.minorticks_off()
            axes.grid(color='#e6e6e6', lw=0.6)
            axes.axhspan(6.0, 100.0, color='#f0f0f0', lw=0.0)
            axes.set_title(title, loc='left', size=11.0, color=canvas.INK)
            _draw_methods(axes, marks, looks)
        figure.axes[0].set_ylabel('relative error of the amplitude [-]')
        _draw_legend(figure, looks)
        figure.text(0.985, 0.012, footnote, ha='right', va='bottom', size=9.0, color=canvas.MUTED)
        return figure


def _error_height(error: float) -> float:
    """Return the height at which an error is drawn, from 1e-16 to 5; for a failure 30, in its own band."""
    return 30.0 if math.isinf(error) else float(np.clip(error, 1e-16, 5.0))


def _draw_methods(axes: canvas.Axes, marks: Sequence[MethodMark], looks: dict[str, tuple[str, str]]) -> None:
    """Draw the methods of a panel, the front as a line, and a note if any method fails.

    Args:
        axes: The panel.
        marks: Its methods.
        looks: Colour and marker of each family.
    """
    front = sorted((m for m in marks if m.front), key=lambda m: m.seconds)
    x, y = [m.seconds for m in front], [_error_height(m.error) for m in front]
    axes.step(x, y, where='post', color=_FRONT, lw=1.4, ls=canvas.DASHES, zorder=2)
    for mark in marks:
        colour, shape = looks[mark.family]
        axes.plot(
            mark.seconds,
            _error_height(mark.error),
            shape,
            ms=_marker_size(shape),
            mfc=canvas.PAPER if mark.in_bulk else colour,
            mec=colour if mark.in_bulk else canvas.INK if mark.front else canvas.PAPER,
            mew=1.4 if mark.front or mark.in_bulk else 0.8,
            zorder=4,
        )
    if any(math.isinf(mark.error) for mark in marks):
        look: canvas.Look = {'transform': axes.transAxes, 'va': 'top', 'size': 8.5, 'color': canvas.MUTED}
        axes.text(0.012, 0.988, 'fails at some case', **look)


def _marker_size(shape: str) -> float:
    """Return the size of a marker [points]: a star looks smaller than it is."""
    return 13.0 if shape == '*' else 8.5


def _draw_legend(figure: canvas.Figure, looks: dict[str, tuple[str, str]]) -> None:
    """Draw the legend below the figure: families, the hollow mark of many points at once, and the front."""
    from matplotlib.lines import Line2D

    rows: list[tuple[str, canvas.Look]] = [
        (name, {'marker': shape, 'ls': '', 'ms': _marker_size(shape), 'mfc': colour, 'mec': canvas.PAPER})
        for name, (colour, shape) in looks.items()
    ]
    hollow = {'marker': 'o', 'ls': '', 'ms': 8.0, 'mfc': canvas.PAPER, 'mec': canvas.INK}
    rows.append(('many points at once', hollow))
    line = {'color': _FRONT, 'lw': 1.4, 'ls': canvas.DASHES}
    rows.append(('Pareto front, one point at a time', line))
    handles = [Line2D([], [], label=name, **look) for name, look in rows]
    canvas.legend_below(figure, 5, 0.075, 0.045, handles=handles)
