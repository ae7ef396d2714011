# SPDX-License-Identifier: Apache-2.0
"""Draws what the monitor said beside what the lining did, on one axis of time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from stickslip_monitor.arrays import FloatArray, IntArray
from stickslip_monitor.drawing.canvas import new_figure, style
from stickslip_monitor.drawing.palette import (
    CONDITION_COLOUR,
    CONDITION_NAMES,
    DASHES,
    FOLD,
    HOPF,
    INK,
    MUTED,
    REGIME_COLOUR,
)
from stickslip_monitor.drawing.track import envelope
from stickslip_monitor.monitor.assessment import Regime, at_indices
from stickslip_monitor.monitor.bulk import Scan
from stickslip_monitor.monitor.config import BearingConfig
from stickslip_monitor.monitor.ladder import Condition
from stickslip_monitor.offline.intervals import condition_intervals

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


_SIZE = (9.0, 9.0)
_RATIOS = (3.0, 1.5, 2.4, 2.4, 1.1)
_TRUTH = '#333333'
_SHADE = '#ececec'
_MOST_POINTS = 3000
_MOST_MARGIN = 100.0
# Longest time for which an axis is in seconds, minutes, and hours beyond.
_UNITS = ((900.0, 1.0, 's'), (9000.0, 60.0, 'min'), (np.inf, 3600.0, 'h'))


@dataclass(frozen=True, slots=True, eq=False)
class LiningTruth:
    """What the lining did; the arrays may be empty.

    Attributes:
        start_ns: From when on it is known [ns].
        end_ns: Until when [ns].
        episodes: First and last instant of sticking of each episode [ns].
        margin_ns: When the true margins were taken, shape (n,) [ns].
        hopf_margin: True Hopf margin, shape (n,).
        fold_margin: True fold margin, shape (n,).
        amplitude_ns: When the amplitude was taken, shape (m,) [ns].
        amplitude: Half the peak to peak of the displacement, shape (m,) [m].
    """

    start_ns: int
    end_ns: int
    episodes: tuple[tuple[int, int], ...]
    margin_ns: IntArray
    hopf_margin: FloatArray
    fold_margin: FloatArray
    amplitude_ns: IntArray
    amplitude: FloatArray


class _Clock:
    """From nanoseconds to the axis."""

    def __init__(self, start_ns: int, end_ns: int) -> None:
        span = (end_ns - start_ns) / 1e9
        self.start_ns = start_ns
        self.scale, self.unit = next((s, unit) for most, s, unit in _UNITS if span <= most)
        self.end = span / self.scale

    def at(self, time_ns: IntArray) -> FloatArray:
        axis: FloatArray = (time_ns - self.start_ns) / (1e9 * self.scale)
        return axis

    def span(self, start_ns: int, end_ns: int) -> tuple[float, float]:
        """Begin and width."""
        begin = (start_ns - self.start_ns) / (1e9 * self.scale)
        return begin, (end_ns - start_ns) / (1e9 * self.scale)


def draw_score(name: str, config: BearingConfig, scan: Scan, lining: LiningTruth) -> Figure:
    """Draw one bearing over one recording.

    Args:
        name: The recording's name.
        config: The bearing.
        scan: What the monitor made of the recording, on the clock of the truth.
        lining: What the lining did.

    Raises:
        DrawingError: matplotlib is not installed.
    """
    clock = _Clock(lining.start_ns, lining.end_ns)
    with style():
        figure = new_figure(*_SIZE)
        axes = figure.subplots(
            5, 1, sharex=True, gridspec_kw={'height_ratios': _RATIOS, 'hspace': 0.14}
        )
        for panel in axes[:4]:
            _shade(panel, clock, lining)
        _speed(axes[0], clock, config, scan)
        _load(axes[1], clock, scan)
        _margins(axes[2], clock, scan, lining)
        _amplitude(axes[3], clock, scan, lining)
        _strips(axes[4], clock, scan, lining)
        axes[0].set_title(f'{name}: {config.name}', loc='left', fontsize=11.0, weight='bold')
        axes[4].set_xlabel(f'time [{clock.unit}]')
        axes[4].set_xlim(0.0, clock.end)
        figure.align_ylabels(axes)
        figure.subplots_adjust(left=0.105, right=0.79, top=0.96, bottom=0.06)
    return figure


def _shade(axes: Axes, clock: _Clock, lining: LiningTruth) -> None:
    for episode in lining.episodes:
        begin, width = clock.span(*episode)
        axes.axvspan(begin, begin + width, color=_SHADE, lw=0.0, zorder=0)
    axes.margins(x=0.0)
    for side in ('top', 'right'):
        axes.spines[side].set_visible(False)


def _series(clock: _Clock, scan: Scan, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """A column of the scan over time, thinned if long.

    It is interrupted where an input was lost and where the clock jumped back.
    """
    missing = scan.until_ns[:-1] < scan.time_ns[1:]
    lost = np.flatnonzero(missing | (np.diff(scan.time_ns) < 0)) + 1
    time = np.insert(clock.at(scan.time_ns), lost, np.nan)
    column = np.insert(np.asarray(values, dtype=float), lost, np.nan)
    kept = envelope(_MOST_POINTS, column)
    return time[kept], column[kept]


def _finite(values: FloatArray) -> FloatArray:
    return np.where(np.isfinite(values), values, np.nan)


def _speed(axes: Axes, clock: _Clock, config: BearingConfig, scan: Scan) -> None:
    point, rpm = scan.assessment, config.bearing.speed.factor('rpm')
    # Astern the same picture is mirrored: its boundaries are those of the speed's size.
    ahead = np.where(point.speed >= 0.0, point.speed, np.nan)
    astern = np.where(point.speed < 0.0, -point.speed, np.nan)
    lines = (
        (ahead, INK, 1.1, '-', 'measured'),
        *([(astern, INK, 1.1, (0, (2, 1)), 'astern')] if np.any(astern > 0.0) else []),
        (_finite(point.fold_speed), FOLD, 1.5, DASHES, 'fold'),
        (_finite(point.hopf_speed), HOPF, 1.5, '-', 'Hopf'),
    )
    for values, colour, width, dash, label in lines:
        time, line = _series(clock, scan, values / rpm)
        axes.plot(time, line, ls=dash, color=colour, lw=width, label=label)
    axes.set_ylabel('speed [rpm]')
    axes.set_ylim(bottom=0.0)
    _legend(axes)


def _load(axes: Axes, clock: _Clock, scan: Scan) -> None:
    axes.plot(*_series(clock, scan, scan.assessment.load / 1e3), color=INK, lw=1.1)
    axes.set_ylabel('load [kN]')
    axes.set_ylim(0.0, 1.15 * axes.get_ylim()[1])


def _margins(axes: Axes, clock: _Clock, scan: Scan, lining: LiningTruth) -> None:
    point = scan.assessment
    axes.axhline(0.0, color=MUTED, lw=0.8)
    for name, colour, dashes, wide in (
        ('fold', FOLD, DASHES, REGIME_COLOUR[Regime.BISTABLE]),
        ('Hopf', HOPF, '-', REGIME_COLOUR[Regime.UNSTABLE]),
    ):
        true = getattr(lining, f'{name.lower()}_margin')
        if true.size:
            time = clock.at(lining.margin_ns)
            axes.plot(time, _clipped(true), color=wide, alpha=0.4, lw=4.0, label=f'{name}, true')
        said = _clipped(np.asarray(getattr(point, f'{name.lower()}_margin'), dtype=float))
        axes.plot(*_series(clock, scan, said), color=colour, ls=dashes, lw=1.3, label=name)
    axes.set_ylabel('margin [%]')
    _legend(axes)


def _clipped(margin: FloatArray) -> FloatArray:
    """In percent; large margins are cut off at the panel."""
    percent = 100.0 * margin
    return np.where(percent <= _MOST_MARGIN, percent, np.nan)


def _amplitude(axes: Axes, clock: _Clock, scan: Scan, lining: LiningTruth) -> None:
    point = scan.assessment
    averaged = np.where(scan.sticking, np.nan_to_num(point.amplitude), 0.0)
    kept = envelope(_MOST_POINTS, averaged)
    exact = np.nan_to_num(at_indices(point, kept).amplitude_exact) * 1e3
    axes.plot(
        clock.at(scan.time_ns[kept]),
        np.where(scan.sticking[kept], exact, 0.0),
        color=REGIME_COLOUR[Regime.UNSTABLE],
        lw=1.5,
        label='predicted',
    )
    if lining.amplitude.size:
        time = clock.at(lining.amplitude_ns)
        axes.plot(time, 1e3 * lining.amplitude, color=_TRUTH, lw=1.2, label='true')
    axes.set_ylabel('amplitude [mm]')
    axes.set_ylim(bottom=0.0)
    if axes.get_ylim()[1] < 0.01:
        axes.set_ylim(top=0.01)
    _legend(axes)


def _strips(axes: Axes, clock: _Clock, scan: Scan, lining: LiningTruth) -> None:
    """The lining's episodes above the monitor's conditions."""
    from matplotlib.patches import Patch

    axes.broken_barh([(0.0, clock.end)], (1.1, 0.8), color=_SHADE)
    spans = [clock.span(*episode) for episode in lining.episodes]
    axes.broken_barh(spans, (1.1, 0.8), color=_TRUTH)
    shown: set[Condition] = set()
    for spell in condition_intervals(scan.events, lining.start_ns, lining.end_ns):
        begin, width = clock.span(spell.start_ns, min(spell.end_ns, lining.end_ns))
        if width > 0.0:
            shown.add(spell.condition)
            colour = CONDITION_COLOUR[spell.condition]
            axes.broken_barh([(begin, width)], (0.0, 0.8), color=colour)
    axes.set_yticks([0.4, 1.5], ['monitor', 'lining'])
    axes.tick_params(axis='y', length=0.0, labelcolor=INK)
    for side in ('top', 'right', 'left'):
        axes.spines[side].set_visible(False)
    handles = [Patch(color=_TRUTH, label='stick-slip')]
    handles += [
        Patch(color=CONDITION_COLOUR[c], label=CONDITION_NAMES[c]) for c in Condition if c in shown
    ]
    # From below upwards, where there is room for every condition.
    place = {'loc': 'lower left', 'bbox_to_anchor': (1.01, -0.5)}
    _legend(axes, handles=handles, handlelength=1.0, **place)


def _legend(axes: Axes, **more: Any) -> None:
    beside = {
        'loc': 'upper left', 'bbox_to_anchor': (1.01, 1.0), 'frameon': False, 'fontsize': 9.5,
        'borderaxespad': 0.0, 'handlelength': 1.6,
    }  # fmt: skip
    axes.legend(**beside | more)
