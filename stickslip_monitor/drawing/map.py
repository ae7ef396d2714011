# SPDX-License-Identifier: Apache-2.0
"""The stability map: which regime where, over shaft speed and load.

At each speed the regimes follow each other with rising load as stable, bistable, unstable, in the
water that the bearing is configured with. The fold is the one that decides; that of averaging (KBM)
is drawn beside it where it is another line. A recording is drawn on it as the track of its operating
point, with the changes of condition.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.drawing import canvas
from stickslip_monitor.monitor.assessment import Regime
from stickslip_monitor.monitor.parameters import BearingConfig
from stickslip_monitor.monitor.severity import Condition
from stickslip_monitor.offline.extremes import Verdicts
from stickslip_monitor.physics.averaging import fold_load, fold_speed, hopf_load, hopf_speed
from stickslip_monitor.physics.bearing import Bearing
from stickslip_monitor.physics.cycles import end_of_vibration, exact_amplitude
from stickslip_monitor.physics.deciding_load import deciding_load, load_of_fold
from stickslip_monitor.physics.friction import Stribeck, speed_scales
from stickslip_monitor.physics.lubrication import as_measured
from stickslip_monitor.physics.probability import QUANTILES

Range = tuple[float, float]

# Size of a chosen range over what it has to show [-].
_ROOM = 1.25
# Highest load of a map over the onset, without a track [-].
_LOADS_ABOVE_ONSET = 10.0
# Height of a row of a legend [inch].
_LEGEND_ROW = 0.2
# Room left of the axes, and on both sides together [inch], whatever the size of the figure.
_LEFT, _BOTH_SIDES = 0.855, 1.08
# Colour and width of the track from its beginning to its end: a way back lies on the way out.
_AGES = (('#8c8c8c', 4.0), (canvas.MUTED, 2.6), (canvas.INK, 1.3))
# Size of the ring at the start [points]: an end within it has no mark of its own.
_RING = 12.0
_MARKER = {
    Condition.NORMAL: 'o',
    Condition.VIBRATION: 'v',
    Condition.CAUTION: 's',
    Condition.BISTABLE: 'D',
    Condition.STICK_SLIP: '^',
    Condition.AMPLITUDE: 'p',
    Condition.INPUT_STALE: 'X',
}


def _speed_scale_factor(bearing: Bearing, load: float | None = None) -> float:
    """Return the factor of the law's own speeds at a load [N], by default that of its measurement.

    It is 1 where friction does not depend on the load or the water.
    """
    lubrication = bearing.lubrication
    return (
        1.0 if lubrication is None else float(lubrication.scale(lubrication.load if load is None else load))
    )


def law_speed(bearing: Bearing, load: float | None = None) -> float:
    """Return a surface speed [m/s] at which most of the fall of friction at a load [N] is over.

    By default at the load of its measurement; 60 rpm for a law whose friction does not change.
    """
    law, scale = bearing.friction, _speed_scale_factor(bearing, load)
    if isinstance(law, Stribeck):
        return scale * 4.0 / law.decay
    without = float(bearing.speed.to_surface(60.0, 'rpm'))
    return scale * (speed_scales(law) or (without,))[-1]


def water_note(bearing: Bearing) -> str:
    """Return ``', water 5 C'``, or '' where the temperature is unknown or friction does not depend on it."""
    temperature = math.nan if bearing.lubrication is None else bearing.lubrication.water_temperature
    return '' if math.isnan(temperature) else f', water {temperature:g} C'


def diagram_speeds(bearing: Bearing, load: float) -> Range:
    """Return the range of surface speeds [m/s] from rest to well past the highest boundary at a load [N].

    Without a finite boundary :func:`law_speed` stands for it.
    """
    every = float(end_of_vibration(bearing, load)), float(hopf_speed(bearing, load))
    highest = max((v for v in every if math.isfinite(v) and v > 0.0), default=law_speed(bearing, load))
    return 0.0, _ROOM * highest


def onset_load(bearing: Bearing) -> float:
    """Return the least load [N] with stick-slip at some speed, by averaging; ``nan`` where no load has it."""
    edges = _speed_scale_factor(bearing) * np.array(speed_scales(bearing.friction))
    speeds = np.concatenate([np.linspace(0.0, law_speed(bearing), 200), edges])
    return float(np.fmin.reduce(fold_load(bearing, speeds)))


def map_ranges(
    bearing: Bearing, speeds: Range | None = None, loads: Range | None = None, track: Track | None = None
) -> tuple[Range, Range]:
    """Return the lowest and highest speed [m/s] and load [N] of a map; a range that is None is chosen.

    Chosen loads go from 0 past the onset of stick-slip (to 1000 N without one), chosen speeds from 0 past the
    fold at the highest load, which is the way out. They include the whole track.
    """
    fastest = heaviest = 0.0
    if track is not None:
        fastest, heaviest = (
            float(np.nanmax(np.abs(column), initial=0.0)) for column in (track.speed, track.load)
        )
    if loads is None:
        onset = onset_load(bearing)
        lubrication = bearing.lubrication
        if lubrication is not None and lubrication.load_exponent > 0.0:
            # Light loads have boundaries, too, at creeping speeds. The map goes to twice the load at which
            # friction was measured.
            measured = 2.0 * lubrication.load / _LOADS_ABOVE_ONSET
            onset = float(np.fmax(onset_load(as_measured(bearing)), measured))
        top = _LOADS_ABOVE_ONSET * onset if onset > 0.0 else 1000.0
        loads = 0.0, _ROOM * np.fmax(heaviest, onset) if heaviest > 0.0 else top
    return speeds or (0.0, max(diagram_speeds(bearing, loads[1])[1], 1.05 * fastest)), loads


def corners(bearing: Bearing, speeds: Range, load: float | None = None) -> FloatArray:
    """Return the law's break points between two speeds [m/s], with a speed close to each side, unordered.

    The array has shape (n,); n may be 0. There the curves have corners and the balance of work may jump. The
    break points are those at a load [N], by default that of the law's measurement.
    """
    sides = 1.0 - 1e-9, 1.0, 1.0 + 1e-9
    beside = _speed_scale_factor(bearing, load) * np.outer(bearing.friction.breakpoints, sides).ravel()
    return beside[(beside > speeds[0]) & (beside < speeds[1])]


@dataclass(frozen=True, slots=True)
class Boundaries:
    """Curves that divide the plane: loads over speed, ``nan`` for none, each of shape (n,)."""

    speed: FloatArray  # of the surface, rising [m/s]
    fold_load: FloatArray  # above which a vibration can last [N]
    hopf_load: FloatArray  # above which the equilibrium is unstable [N]
    caution_load: FloatArray  # above which the fold margin is below the caution margin [N]


def boundaries(bearing: Bearing, speeds: Range, caution_margin: float, points: int = 400) -> Boundaries:
    """Compute the curves of a stability map, with a fold margin below which the alarm says caution [-].

    The speeds go evenly from the lowest to the highest surface speed, 0 <= low < high [m/s]; those
    of the curves' corners are added to the ``points``.
    """
    speed = np.union1d(np.linspace(*speeds, points), corners(bearing, speeds))
    return Boundaries(
        speed=speed,
        fold_load=np.asarray(deciding_load(bearing, speed)),
        hopf_load=np.asarray(hopf_load(bearing, speed)),
        caution_load=caution_load(bearing, speed, caution_margin),
    )


def caution_load(bearing: Bearing, speed: FloatArray, margin: float) -> FloatArray:
    """Return the load [N] at which the fold margin falls below the caution margin, at speeds [m/s].

    There the fold is at ``V/(1 + margin)``; ``nan`` for none, shape (n,).
    """
    return np.asarray(load_of_fold(bearing, speed / (1.0 + margin)))


def map_columns(bearing: Bearing, curves: Boundaries) -> dict[str, FloatArray]:
    """Return the curves as the columns of a table, by heading with the unit, each of shape (n,)."""
    return {
        'shaft_speed [rpm]': bearing.speed.from_surface(curves.speed, 'rpm'),
        'surface_speed [m/s]': curves.speed,
        'fold_load [N]': curves.fold_load,
        'hopf_load [N]': curves.hopf_load,
        'caution_load [N]': curves.caution_load,
    }


def draw_map(
    config: BearingConfig,
    speeds: Range | None = None,
    loads: Range | None = None,
    track: Track | None = None,
    size: tuple[float, float] = (canvas.WIDTH, canvas.HEIGHT),
) -> canvas.Figure:
    """Draw the stability map of a bearing, and a track of operating points on it.

    ``speeds`` [m/s] and ``loads`` [N] are the lowest and highest, chosen if ``None``; the size is width and
    height [inch].

    Raises:
        DrawingError: matplotlib is not installed.
    """
    with canvas.style():
        bearing, (width, height) = config.bearing, size
        speeds, loads = map_ranges(bearing, speeds, loads, track)
        # The legend has at most 10 names, the longest of 1.45 inch.
        columns = max(2, int(width / 1.45))
        bottom = 0.64 + _LEGEND_ROW * -(-10 // columns)
        above = max(0.24, 0.0 if track is None else track.legend_height(width))
        figure, axes = canvas.new_panel(
            'shaft speed [rpm]',
            'bearing load [kN]',
            size=size,
            box=(_LEFT / width, bottom / height, 1.0 - _BOTH_SIDES / width, 1.0 - (bottom + above) / height),
        )
        rpm = bearing.speed.factor('rpm')
        axes.set_xlim(speeds[0] / rpm, speeds[1] / rpm)
        axes.set_ylim(loads[0] / 1e3, loads[1] / 1e3)
        curves = boundaries(bearing, speeds, config.alarm.caution_margin)
        _draw_regions(axes, curves, loads, rpm)
        _draw_belief_bands(axes, config, loads, rpm)
        _draw_averaged_fold(axes, bearing, curves, loads, rpm)
        # The longest label, '0.25 mm' of 9 points with the gap around it, takes 0.72 inch.
        label = 0.72 / (height - bottom - above)
        _draw_amplitudes(axes, bearing, speeds, loads, 5 if width > 5.0 else 3, label)
        canvas.legend_below(figure, columns, _LEFT / width - 0.01)
        if track is not None:
            draw_track(axes, track, rpm, width)
        if not np.isfinite([curves.fold_load, curves.hopf_load]).any():
            axes.text(0.5, 0.5, 'no stick-slip in this range', transform=axes.transAxes, ha='center')
        name = config.name + water_note(bearing)
        figure.text(0.985, 0.995, name, ha='right', va='top', size=9.0, color=canvas.MUTED)
        return figure


def _draw_regions(axes: canvas.Axes, curves: Boundaries, loads: Range, rpm: float) -> None:
    """Fill the regions, each over the one below it, and draw the lines between them.

    ``loads`` is the range of the map [N], ``rpm`` the surface speed of one rpm [m/s].
    """
    # Loads beyond the map, and none, are drawn at a ceiling above it.
    x, ceiling = curves.speed / rpm, 2.0 * loads[1]

    def clip_load(load: FloatArray) -> FloatArray:
        """Return loads [N] in kN, at most the ceiling, which also stands for none."""
        return np.minimum(np.nan_to_num(load, nan=ceiling), ceiling) / 1e3

    for load, colour, name in (
        (np.zeros_like(x), canvas.REGIME_FILL[Regime.STABLE], 'stable'),
        (curves.caution_load, canvas.CAUTION_FILL, 'margin low'),
        (curves.fold_load, canvas.REGIME_FILL[Regime.BISTABLE], 'bistable'),
        (curves.hopf_load, canvas.REGIME_FILL[Regime.UNSTABLE], 'unstable'),
    ):
        axes.fill_between(x, clip_load(load), ceiling / 1e3, color=colour, lw=0.0, zorder=1, label=name)
    # A line goes as far as its region, which ends where the next speed has no such load.
    for load, name, colour, width, dashes in (
        (curves.caution_load, 'caution margin', canvas.MUTED, 1.0, ':'),
        (curves.hopf_load, 'Hopf', canvas.HOPF, 2.0, '-'),
        (curves.fold_load, 'fold', canvas.FOLD, 2.0, canvas.DASHES),
    ):
        if np.isfinite(load).any():
            axes.plot(x, clip_load(load), color=colour, lw=width, ls=dashes, zorder=3, label=name)


def _draw_averaged_fold(
    axes: canvas.Axes, bearing: Bearing, curves: Boundaries, loads: Range, rpm: float
) -> None:
    """Draw the fold of averaging up to the highest load, if it is somewhere beside the one that decides.

    That is by more than 0.5 % of the map's width. ``loads`` is the range of the map [N], ``rpm`` the surface
    speed of one rpm [m/s].
    """
    rows = curves.fold_load <= loads[1]
    load = np.where(rows, curves.fold_load, np.nan)
    averaged = np.asarray(fold_speed(bearing, load))
    if np.any(np.abs(averaged - curves.speed) > 0.005 * curves.speed[-1]):
        look: canvas.Look = {'color': canvas.FOLD, 'lw': 1.4, 'ls': '-.', 'zorder': 3}
        axes.plot(averaged / rpm, load / 1e3, label='fold by averaging (KBM)', **look)


def _draw_amplitudes(
    axes: canvas.Axes, bearing: Bearing, speeds: Range, loads: Range, levels: int, label: float
) -> None:
    """Draw lines of one amplitude of the exact stick-slip cycle, labelled in mm; none without a cycle.

    Args:
        axes: The axes.
        bearing: The bearing.
        speeds: Surface speeds [m/s].
        loads: Loads [N].
        levels: About how many lines.
        label: Length of a label as a share of the height of the axes.
    """
    speed, load, exact = _exact_amplitudes(bearing, speeds, loads)
    if not np.isfinite(exact).any():
        return
    x = speed / bearing.speed.factor('rpm')
    look: canvas.Look = {'colors': canvas.MUTED, 'linewidths': 0.9, 'zorder': 2}
    lines = axes.contour(x, load / 1e3, np.ma.masked_invalid(exact), levels, **look)
    axes.plot([], [], color=canvas.MUTED, lw=0.9, label='amplitude')
    # High up, where a track seldom is: the range of loads has room above it. Of a line that only
    # touches a corner the label would stand over the boundaries.
    low, high = loads[0] / 1e3, loads[1] / 1e3
    paths = [max(parts, key=len) for parts in lines.allsegs if any(map(len, parts))]
    long = [path for path in paths if np.ptp(path[:, 1]) > max(0.2, label) * (high - low)]
    # A label along a steep line must end below the frame.
    height = low + min(0.91, 1.0 - 0.5 * label) * (high - low)
    places = [path[np.argmin(np.abs(path[:, 1] - height))] for path in long]
    axes.clabel(lines, fmt='%g mm', fontsize=9.0, manual=[(x, y) for x, y in places])


# A page shows each map in two sizes, and takes a second to work out its cycles.
@lru_cache(maxsize=8)
def _exact_amplitudes(
    bearing: Bearing, speeds: Range, loads: Range
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Compute the amplitudes of the exact stable cycle on a grid; results are cached.

    The grid leaves out the lowest speed and load, which may be 0. Callers must not change the arrays.

    Returns:
        Speeds (48,) [m/s], loads (32,) [N] and amplitudes (32, 48) [mm], ``nan`` without a cycle.
    """
    speed = np.linspace(*speeds, 49)[1:]
    load = np.linspace(*loads, 33)[1:]
    return speed, load, exact_amplitude(bearing, speed[None, :], load[:, None]) * 1e3


def _draw_belief_bands(axes: canvas.Axes, config: BearingConfig, loads: Range, rpm: float) -> None:
    """Shade where 5 to 95 % of the belief have the Hopf and the fold speed; nothing without a belief.

    ``loads`` is the range of the map [N], ``rpm`` the surface speed of one rpm [m/s].
    """
    if config.belief is None:
        return
    load = np.linspace(max(loads[0], 1e-6 * loads[1]), loads[1], 120)
    for quantile, regime, name in (
        (config.belief.fold_speed, Regime.BISTABLE, 'fold'),
        (config.belief.hopf_speed, Regime.UNSTABLE, 'Hopf'),
    ):
        low, high = (quantile(load, p) / rpm for p in (QUANTILES[0], QUANTILES[-1]))
        look: canvas.Look = {'color': canvas.REGIME_COLOUR[regime], 'alpha': 0.35, 'lw': 0.0, 'zorder': 2}
        axes.fill_betweenx(load / 1e3, low, high, label=f'5 to 95 % of the {name}', **look)


# --- the track of an operating point -----------------------------------------------------------


class TrackEvent(NamedTuple):
    """A change of the alarm to a condition, and the operating point at which it was raised."""

    speed: float  # of the surface [m/s]
    load: float  # [N]
    condition: Condition


@dataclass(frozen=True, slots=True)
class Track:
    """The operating points of a recording; astern is drawn as ahead, as the model has it."""

    speed: FloatArray  # of the surface, shape (n,), ``nan`` where it is interrupted [m/s]
    load: FloatArray  # shape (n,) [N]
    events: Sequence[TrackEvent] = ()  # the alarm's changes

    def conditions(self) -> list[Condition]:
        """Return the conditions that the events lead to, each once, in the order of :class:`Condition`."""
        return [c for c in Condition if any(event.condition is c for event in self.events)]

    def legend_height(self, width: float) -> float:
        """Return the room that the names of the marks take above a map of a width [both inch]."""
        names = len(self.conditions()) + 4
        return 0.1 + -(-names // _mark_columns(width)) * _LEGEND_ROW


def track_of_scan(scan: Verdicts) -> Track:
    """Return the track of a bearing's scanned recording, interrupted where an input was lost.

    Changes of the alarm before the first operating point are left out.
    """
    lost = np.flatnonzero(scan.until_ns[:-1] < scan.time_ns[1:]) + 1
    points = scan.assessment.speed, scan.assessment.load
    speed, load = (np.insert(np.asarray(column, dtype=float), lost, np.nan) for column in points)
    events = [
        TrackEvent(point.speed, point.load, e.after)
        for e in scan.events
        if (point := e.standing.assessment) is not None
    ]
    return Track(speed, load, events)


def _mark_columns(width: float) -> int:
    """Return how many names of marks fit side by side above a map of a width [inch]; at least 1."""
    return max(1, int((width - _BOTH_SIDES) / 1.6))


def draw_track(axes: canvas.Axes, track: Track, rpm: float, width: float = canvas.WIDTH) -> None:
    """Draw a track on a map; the legend above it names the ends and the changes of the alarm.

    A track without a finite point leaves the map as it is.

    Args:
        axes: The map, with final limits in rpm and kN.
        track: The track.
        rpm: Surface speed of one rpm [m/s].
        width: Width of the figure [inch].
    """
    x, y = np.abs(track.speed) / rpm, track.load / 1e3
    finite = np.flatnonzero(np.isfinite(x) & np.isfinite(y))
    if not finite.size:
        return
    # Every measured point, faint.
    drawn = canvas.envelope(int(width * canvas.POINTS_PER_INCH), x, y)
    faint: canvas.Look = {'color': canvas.MUTED, 'lw': 0.7, 'alpha': 0.45, 'zorder': 6}
    named = axes.plot(x[drawn], y[drawn], label='measured', **faint)
    named += _draw_smoothed_track(axes, x, y)
    ends = x[finite[[0, -1]]], y[finite[[0, -1]]]
    apart = np.hypot(*np.diff(axes.transData.transform(np.column_stack(ends)), axis=0)[0])
    start: canvas.Look = {'ms': _RING, 'mec': canvas.INK, 'mfc': canvas.PAPER}
    end: canvas.Look = {'ms': 6.5, 'mec': canvas.PAPER, 'mfc': canvas.INK, 'label': 'end'}
    if apart > _RING * axes.figure.dpi / 72.0:
        named += axes.plot(ends[0][0], ends[1][0], 'o', mew=1.5, zorder=11, label='start', **start)
        named += axes.plot(ends[0][1], ends[1][1], 's', mew=1.5, zorder=11, **end)
    else:
        named += axes.plot(ends[0][0], ends[1][0], 'o', mew=1.5, zorder=11, label='start and end', **start)
    for condition in track.conditions():
        points = [(abs(e.speed) / rpm, e.load / 1e3) for e in track.events if e.condition is condition]
        look: canvas.Look = {'marker': _MARKER[condition], 'mfc': canvas.CONDITION_COLOUR[condition]}
        look |= {'ls': '', 'ms': 8.5, 'mec': canvas.PAPER, 'mew': 1.0, 'zorder': 10}
        named += axes.plot(
            *zip(*points, strict=True), label=f'to: {canvas.CONDITION_NAMES[condition]}', **look
        )
    canvas.legend_above(axes, _mark_columns(width), handles=named, handlelength=1.2)


def _draw_smoothed_track(axes: canvas.Axes, x: FloatArray, y: FloatArray) -> list[Any]:
    """Draw a track [rpm, kN] without noise: means over parts of its time, 1.5 % of the map's diagonal apart.

    It goes from wide and light to narrow and dark, so that ways back can be distinguished. Distances are
    those on the picture: the limits of the axes must be final.

    Returns:
        One of its lines, labelled for the legend; an empty list if nothing was drawn.
    """
    box = axes.get_window_extent()
    shown = axes.transData.transform(np.column_stack([x, y]))
    paths = list(_smooth_parts(shown, 0.015 * float(np.hypot(box.width, box.height))))
    steps = [np.hypot(*np.diff(path, axis=0).T) for path in paths]
    total, done = sum(float(step.sum()) for step in steps) or 1.0, 0.0
    lines: list[Any] = []
    for path, step in zip(paths, steps, strict=True):
        along = (done + np.cumsum(step) - 0.5 * step) / total
        done += float(step.sum())
        part = np.minimum((along * len(_AGES)).astype(int), len(_AGES) - 1)
        for age, (colour, wide) in enumerate(_AGES):
            rows = np.flatnonzero(part == age)
            if rows.size:
                line = axes.transData.inverted().transform(path[rows[0] : rows[-1] + 2]).T
                axes.plot(*line, color=canvas.PAPER, lw=wide + 1.2, alpha=0.6, zorder=7)
                lines += axes.plot(*line, color=colour, lw=wide, zorder=8, solid_capstyle='butt')
                _draw_arrow(axes, line, colour)
    for line in lines[:1]:
        line.set_label('smoothed')
    return lines[:1]


def _smooth_parts(shown: FloatArray, stride: float) -> Iterator[FloatArray]:
    """Yield the smoothed points of each part of a track between breaks, shape (m, 2) [pixels].

    Args:
        shown: The track, ``nan`` at breaks, shape (n, 2) [pixels].
        stride: Least distance between two points [pixels]. First and last point are not averaged, and the
            last may be nearer.
    """
    is_finite = np.all(np.isfinite(shown), axis=1)
    # So that the whole track has about 150 points.
    length = max(1, int(is_finite.sum()) // 150)
    for run in np.split(shown, np.flatnonzero(np.diff(is_finite.astype(np.int8))) + 1):
        if np.isfinite(run[0]).all():
            starts = np.arange(0, run.shape[0], length)
            means = np.add.reduceat(run, starts) / np.diff([*starts, run.shape[0]])[:, None]
            points = [run[0]]
            for point in means[1:-1]:
                if np.hypot(*(point - points[-1])) >= stride:
                    points.append(point)
            yield np.array([*points, run[-1]])


def _draw_arrow(axes: canvas.Axes, line: FloatArray, colour: str) -> None:
    """Draw the direction of a part of the track, of shape (2, n >= 2) [rpm, kN], before its middle.

    On a way back that lies on the way out the arrows are elsewhere.
    """
    k = int(0.35 * (line.shape[1] - 1))
    look: canvas.Look = {'arrowstyle': '-|>,head_width=0.34,head_length=0.6', 'fc': colour}
    look |= {'ec': canvas.PAPER, 'lw': 0.6, 'shrinkA': 0.0, 'shrinkB': 0.0}
    axes.annotate('', tuple(line[:, k + 1]), tuple(line[:, k]), zorder=9, arrowprops=look)
