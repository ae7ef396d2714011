# SPDX-License-Identifier: Apache-2.0
"""A recording over time: speed between its boundaries, load, margins, amplitude, alarm.

Of a simulated recording what the lining did can be drawn beside the monitor's output.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import timezone
from typing import Any, Protocol

import numpy as np

from stickslip_logs.time_order import DATES_FROM_NS
from stickslip_monitor.arrays import FloatArray, IntArray
from stickslip_monitor.drawing import canvas
from stickslip_monitor.monitor.assessment import Regime
from stickslip_monitor.monitor.parameters import BearingConfig
from stickslip_monitor.monitor.severity import Severity
from stickslip_monitor.monitor.statements import Event
from stickslip_monitor.offline.extremes import ConditionInterval, Verdicts, coarsen_intervals

# Events beyond which only alarms are marked.
_MAX_LINES = 80
# The panels from above, with their heights [inch].
_ROWS = (('speed', 1.9), ('load', 0.9), ('margin', 1.5), ('amplitude', 1.2), ('alarm', 0.26))
# Room around and between the panels [inch].
_LEFT, _RIGHT, _ABOVE, _BELOW, _BETWEEN = 0.82, 0.28, 0.5, 0.62, 0.27
# Height of the line of a title [inch].
_TITLE = 0.25
_TRUTH = '#333333'


class TimedNumbers(Protocol):
    """One number over time."""

    @property
    def time_ns(self) -> IntArray:
        """Times, shape (n,) [ns]."""

    @property
    def value(self) -> FloatArray:
        """Its values then, shape (n,)."""


class LiningMotion(Protocol):
    """Motion of the lining, as far as it is known."""

    @property
    def episodes(self) -> Sequence[tuple[int, int]]:
        """First and last instant of sticking [ns]."""

    @property
    def hopf_margin(self) -> TimedNumbers:
        """The margin to the Hopf speed [-]."""

    @property
    def fold_margin(self) -> TimedNumbers:
        """The margin to the fold [-]."""

    @property
    def amplitude(self) -> TimedNumbers:
        """Half the peak to peak of its displacement [m]."""


@dataclass(frozen=True, slots=True)
class Timeline:
    """Contents of a timeline of one bearing."""

    config: BearingConfig
    scan: Verdicts  # its verdicts and events, or their outline
    intervals: Sequence[ConditionInterval]  # the alarm's, from the recording's start to its end
    lining: LiningMotion | None = None  # what the lining did, where that is known
    title: str = ''  # above the panels

    @property
    def has_cycle(self) -> bool:
        """Whether a stick-slip cycle existed at any point."""
        return bool(np.any(np.isfinite(self.scan.assessment.amplitude)))


def draw_timeline(timeline: Timeline, width: float = canvas.WIDTH) -> canvas.Figure:
    """Draw a recording over time, of a width [inch]; long ones are thinned to their envelope.

    The panel of amplitudes is absent if no cycle ever existed and the lining's motion is unknown.

    Raises:
        DrawingError: matplotlib is not installed.
    """
    with canvas.style():
        shown = timeline.has_cycle or timeline.lining is not None
        rows = [row for row in _ROWS if row[0] != 'amplitude' or shown]
        above = _ABOVE + (_TITLE if timeline.title else 0.0)
        height = sum(size + _BETWEEN for _, size in rows) - _BETWEEN + above + _BELOW
        figure = canvas.new_figure(width, height)
        if timeline.title:
            _draw_title(figure, timeline)
        top, panels = height - above, dict[str, canvas.Axes]()
        for name, size in rows:
            box = _LEFT / width, (top - size) / height, 1.0 - (_LEFT + _RIGHT) / width, size / height
            panels[name] = figure.add_axes(box)
            top -= size + _BETWEEN
        lines = _Lines(timeline, int(width * canvas.POINTS_PER_INCH))
        _draw_episodes(panels, lines)
        _draw_speed(panels['speed'], lines)
        _draw_load(panels['load'], lines)
        _draw_margins(panels['margin'], lines)
        if 'amplitude' in panels:
            _draw_amplitude(panels['amplitude'], lines)
        _draw_alarm(panels['alarm'], lines, max_intervals=int(width * 30))
        _format_time_axis(panels, lines, width)
        _draw_event_lines(panels, lines)
        return figure


def _draw_title(figure: canvas.Figure, timeline: Timeline) -> None:
    """Write the title above the panels, beside it the conditions of marked events in their colours."""
    from matplotlib.lines import Line2D

    occurring = {event.after for _, event in marked_events(timeline.scan.events)}
    handles = [
        Line2D([], [], color=colour, label=canvas.CONDITION_NAMES[condition])
        for condition, colour in canvas.CONDITION_COLOUR.items()
        if condition in occurring
    ]
    figure.text(0.01, 0.99, timeline.title, va='top', size=11.0, weight='bold')
    look: canvas.Look = {'frameon': False, 'fontsize': 8.5, 'handlelength': 1.2, 'columnspacing': 1.0}
    figure.legend(handles=handles, loc='upper right', ncols=len(handles) or 1, **look)


class _Lines:
    """The columns of a timeline over time; :meth:`line` thins them as it returns them.

    Attributes:
        columns: By name: speeds [rpm], that of the shaft without sign, load [kN], margins [%].
        is_dated: Whether times on the axis are dates: days since 1970, else seconds from the start.

    Args:
        timeline: What is drawn.
        max_points: Points that a line keeps, nearly.
    """

    def __init__(self, timeline: Timeline, max_points: int) -> None:
        self._max_points = max_points
        self.timeline, self.config, self.lining = timeline, timeline.config, timeline.lining
        scan, point = timeline.scan, timeline.scan.assessment
        self.start_ns = timeline.intervals[0].start_ns
        self.end_ns = max(interval.end_ns for interval in timeline.intervals)
        self.is_dated = self.start_ns >= DATES_FROM_NS
        # Interrupted where an input was lost or the clock jumped back.
        lost = scan.until_ns[:-1] < scan.time_ns[1:]
        back = np.diff(scan.time_ns) < 0
        self._breaks = np.flatnonzero(lost | back) + 1
        self._time = np.insert(self.at(scan.time_ns), self._breaks, np.nan)
        rpm = timeline.config.bearing.speed.factor('rpm')
        self.columns = {
            'speed': np.abs(point.speed) / rpm,
            'hopf_speed': point.hopf_speed / rpm,
            'fold_speed': point.fold_speed / rpm,
            'load': np.asarray(point.load) / 1e3,
            'hopf_margin': 100.0 * _finite_values(point.hopf_margin),
            'fold_margin': 100.0 * _finite_values(point.fold_margin),
            'fold_low': 100.0 * _finite_values(point.fold_margin_low),
            'fold_high': 100.0 * _finite_values(point.fold_margin_high),
        }

    def at(self, time_ns: object) -> FloatArray:
        """Return times [ns] on the axis, of their shape: days since 1970 for dates, else s from the start."""
        since = np.asarray(time_ns, dtype=np.int64)
        if self.is_dated:
            return np.asarray(since / 86_400e9, dtype=float)
        return np.asarray((since - self.start_ns) * 1e-9, dtype=float)

    def amplitudes(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return times on the axis and two exact amplitudes [mm], thinned, each of shape (n,).

        The first is that of the cycle that can exist, ``nan`` without one and at breaks; the second is the
        same where the monitor predicts it, else 0. Times at breaks are ``nan``.
        """
        scan = self.timeline.scan
        rows = np.insert(np.arange(scan.time_ns.size), self._breaks, -1)
        averaged = np.insert(scan.assessment.amplitude, self._breaks, np.nan)
        sticking = np.insert(scan.sticking, self._breaks, False)
        drawn = canvas.envelope(self._max_points, averaged, np.where(sticking, averaged, 0.0))
        # Only at the points drawn: an exact cycle costs some microseconds.
        exact = scan.assessment.at(rows[drawn]).amplitude_exact * 1e3
        possible = np.where(rows[drawn] < 0, np.nan, exact)
        return self._time[drawn], possible, np.where(sticking[drawn], possible, 0.0)

    def line(self, *names: str) -> tuple[FloatArray, ...]:
        """Return times on the axis and values of some :attr:`columns`, as :meth:`thin`."""
        return self.thin(*(self.columns[name] for name in names))

    def thin(self, *columns: FloatArray) -> tuple[FloatArray, ...]:
        """Return times on the axis and columns of shape (n,), thinned to one envelope; nan at breaks.

        All returned have one shape, (m,) with m about the points that a line keeps.
        """
        values = [np.insert(np.asarray(column, dtype=float), self._breaks, np.nan) for column in columns]
        rows = canvas.envelope(self._max_points, *values)
        return (self._time[rows], *(value[rows] for value in values))


def _finite_values(values: FloatArray) -> FloatArray:
    """Return a copy of values of any shape, with ``nan`` in place of infinite ones."""
    return np.where(np.isfinite(values), values, np.nan)


def _draw_speed(axes: canvas.Axes, lines: _Lines) -> None:
    """Draw the speed over the regions between its boundaries, at the load of each instant.

    Speeds astern are a dotted line of their own.
    """
    margin = 1.0 + lines.config.alarm.caution_margin
    for name, factor, colour in (
        ('fold_speed', margin, canvas.CAUTION_FILL),
        ('fold_speed', 1.0, canvas.REGIME_FILL[Regime.BISTABLE]),
        ('hopf_speed', 1.0, canvas.REGIME_FILL[Regime.UNSTABLE]),
    ):
        when, boundary = lines.line(name)
        axes.fill_between(when, 0.0, boundary * factor, color=colour, lw=0.0, zorder=1)
    for label, (_, colour, dashes) in canvas.BOUNDARY_LINES.items():
        line = lines.line(f'{label.lower()}_speed')
        axes.plot(*line, color=colour, lw=1.0, ls=dashes, zorder=2, label=label)
    # Astern the same picture is mirrored: its boundaries are those of the speed's size.
    backwards = np.asarray(lines.timeline.scan.assessment.speed) < 0.0
    for name, astern, dashes in (('measured', False, '-'), ('astern', True, (0, (2, 1)))):
        if not astern or backwards.any():
            speed = np.where(backwards == astern, lines.columns['speed'], np.nan)
            axes.plot(*lines.thin(speed), color=canvas.INK, lw=1.4, ls=dashes, zorder=4, label=name)
    axes.set_facecolor(canvas.REGIME_FILL[Regime.STABLE])
    top = float(np.nanmax(lines.columns['speed'], initial=0.0))
    edge = float(np.nanmax(_finite_values(lines.columns['fold_speed']), initial=0.0))
    axes.set_ylim(0.0, 1.08 * max(top, 1.15 * edge) or 1.0)
    axes.set_ylabel('speed [rpm]')
    # Numbers of events stand above, and on a narrow picture the names have no room below.
    if axes.get_window_extent().width > 450.0:
        _draw_legend(axes, 'upper right', -0.03)
    else:
        axes.legend(loc='best', ncols=2, fontsize=8.5, framealpha=0.7, edgecolor='none')


def _draw_load(axes: canvas.Axes, lines: _Lines) -> None:
    """Draw the load, on an axis that includes 0."""
    axes.plot(*lines.line('load'), color=canvas.INK, lw=1.2)
    axes.set_ylabel('load [kN]')
    low, high = axes.get_ylim()
    axes.set_ylim(min(low, 0.0), max(high, 0.0) * 1.05 or 1.0)


def _draw_margins(axes: canvas.Axes, lines: _Lines) -> None:
    """Draw the margins to both boundaries, with the band of caution; those of the true lining where known.

    The axis ends between 30 and 150 %.
    """
    highest, lowest, ceiling = 30.0, -10.0, 150.0
    for word, (regime, colour, dashes) in canvas.BOUNDARY_LINES.items():
        name = f'{word.lower()}_margin'
        if lines.lining is not None and lines.lining.fold_margin.time_ns.size:
            lining_margin = getattr(lines.lining, name)
            look: canvas.Look = {'color': canvas.REGIME_COLOUR[regime], 'alpha': 0.4, 'lw': 4.0}
            axes.plot(
                lines.at(lining_margin.time_ns),
                100.0 * _finite_values(lining_margin.value),
                label=f'{word}, true',
                **look,
            )
        time, margin = lines.line(name)
        axes.plot(time, margin, color=colour, lw=1.4, zorder=4, ls=dashes, label=f'{word} margin')
        highest = max(highest, float(np.nanmax(margin, initial=-np.inf)))
        lowest = min(lowest, float(np.nanmin(margin, initial=0.0)))
    amber = canvas.REGIME_COLOUR[Regime.BISTABLE]
    if lines.config.belief is not None:
        time, low, high = lines.line('fold_low', 'fold_high')
        axes.fill_between(time, low, high, color=amber, alpha=0.3, lw=0.0, zorder=3, label='5 to 95 %')
    caution = 100.0 * lines.config.alarm.caution_margin
    axes.axhspan(0.0, caution, color=canvas.CAUTION_FILL, lw=0.0, zorder=1)
    axes.axhspan(-1e4, 0.0, color=canvas.REGIME_FILL[Regime.BISTABLE], lw=0.0, zorder=1)
    axes.axhline(0.0, color=canvas.MUTED, lw=0.8, zorder=2)
    top = min(highest, ceiling)
    room = 0.06 * (top - lowest)
    axes.set_ylim(lowest - room, min(top + room, ceiling))
    axes.set_ylabel('margin [%]')
    _draw_legend(axes)


def _draw_amplitude(axes: canvas.Axes, lines: _Lines) -> None:
    """Draw the exact amplitude, as it would be and as predicted, and the true one where it is known.

    The limit of the alarm is drawn if it is below three times the greatest of them.
    """
    time, possible, predicted = lines.amplitudes()
    red, fill = (colours[Regime.UNSTABLE] for colours in (canvas.REGIME_COLOUR, canvas.REGIME_FILL))
    axes.plot(time, possible, color=canvas.MUTED, lw=1.0, ls=(0, (1.5, 1.5)), label='if it ran', zorder=3)
    axes.fill_between(time, 0.0, predicted, color=fill, lw=0.0, zorder=1)
    axes.plot(time, predicted, color=red, lw=1.4, label='predicted', zorder=4)
    greatest = max(float(np.nanmax(line, initial=0.0)) for line in (possible, predicted))
    if lines.lining is not None:
        lining_amplitude = lines.lining.amplitude
        axes.plot(
            lines.at(lining_amplitude.time_ns),
            1e3 * lining_amplitude.value,
            color=_TRUTH,
            lw=1.2,
            label='true',
            zorder=5,
        )
        greatest = max(greatest, 1e3 * float(np.nanmax(lining_amplitude.value, initial=1e-5)))
    limit = lines.config.alarm.amplitude_limit * 1e3
    if limit < 3.0 * greatest:
        axes.axhline(limit, color=canvas.INK, lw=1.0, ls=canvas.DASHES, label='limit', zorder=3)
        greatest = max(greatest, limit)
    axes.set_ylim(0.0, 1.12 * greatest or 1.0)
    axes.set_ylabel('ampl. [mm]')
    _draw_legend(axes)


def _draw_legend(axes: canvas.Axes, loc: str = 'lower right', edge: float = 1.0) -> None:
    """Add a legend of the lines at the right, above the panel or below it.

    Args:
        axes: The panel.
        loc: Corner of the legend that is placed, as matplotlib names it.
        edge: Height of that corner as a share of the panel's: 1 at its upper edge.
    """
    corner: canvas.Look = {'loc': loc, 'bbox_to_anchor': (1.0, edge), 'borderaxespad': 0.0}
    canvas.legend_above(axes, 5, fontsize=8.5, borderpad=0.1, handlelength=1.8, columnspacing=1.0, **corner)


def _draw_alarm(axes: canvas.Axes, lines: _Lines, max_intervals: int) -> None:
    """Draw the alarm's condition as a band of colours; its names stand where they fit.

    Of more than ``max_intervals`` intervals neighbours are joined (:func:`.coarsen_intervals`).
    """
    low, high = float(lines.at(lines.start_ns)), float(lines.at(lines.end_ns))
    pixels = axes.get_window_extent().width / max(high - low, 1e-12)
    for interval in coarsen_intervals(lines.timeline.intervals, max_intervals):
        left = float(lines.at(interval.start_ns))
        right = float(lines.at(max(interval.end_ns, interval.start_ns)))
        axes.axvspan(left, right, color=canvas.CONDITION_COLOUR[interval.condition], lw=0.0, zorder=2)
        name = canvas.CONDITION_NAMES[interval.condition]
        # A letter takes 6.3 pixels.
        if (right - left) * pixels > 6.3 * (len(name) + 1):
            white: canvas.Look = {'size': 8.5, 'color': canvas.PAPER, 'zorder': 3}
            axes.text(0.5 * (left + right), 0.46, name, ha='center', va='center', **white)
    axes.set_ylim(0.0, 1.0)
    axes.set_yticks([])
    axes.set_ylabel('alarm', rotation=0.0, ha='right', va='center')


def _draw_episodes(panels: dict[str, canvas.Axes], lines: _Lines) -> None:
    """Shade the true episodes, if known, in all panels, and mark them above the band of the alarm."""
    for k, episode in enumerate(() if lines.lining is None else lines.lining.episodes):
        first, last = map(float, lines.at(episode))
        for name, axes in panels.items():
            label = 'lining sticks' if name == 'speed' and not k else '_'
            low, alpha = (0.7, 1.0) if name == 'alarm' else (0.0, 0.15)
            axes.axvspan(first, last, low, color=_TRUTH, alpha=alpha, lw=0.0, zorder=3, label=label)


def _format_time_axis(panels: dict[str, canvas.Axes], lines: _Lines, width: float) -> None:
    """Format the axes of time, with dates where the recording has them, in a picture of a width [inch]."""
    low, high = float(lines.at(lines.start_ns)), float(lines.at(lines.end_ns))
    for name, axes in panels.items():
        axes.set_xlim(low, high if high > low else low + 1e-6)
        axes.tick_params(labelsize=9.5)
        axes.yaxis.label.set_fontsize(9.5)
        axes.xaxis.get_offset_text().set_fontsize(9.5)
        if name != 'alarm':
            axes.tick_params(labelbottom=False)
            axes.grid(color=canvas.MUTED, alpha=0.18, lw=0.6)
        if lines.is_dated:
            _set_clock_ticks(axes, max_ticks=6 if width < 6.0 else 10)
        axes.spines[['top', 'right']].set_visible(False)
        axes.yaxis.set_label_coords(-0.6 / (width - _LEFT - _RIGHT), 0.5)
    last = panels['alarm']
    last.yaxis.set_label_coords(-0.08 / (width - _LEFT - _RIGHT), 0.5)
    last.set_xlabel('time [UTC]' if lines.is_dated else 'time from the start [s]', size=9.5)


def _set_clock_ticks(axes: canvas.Axes, max_ticks: int) -> None:
    """Put up to ``max_ticks`` ticks at round times of day in UTC, on an axis of days since 1970."""
    from matplotlib.dates import AutoDateLocator, ConciseDateFormatter

    make_locator: Any = AutoDateLocator  # matplotlib has no types
    locator = make_locator(minticks=3, maxticks=max_ticks, tz=timezone.utc)
    axes.xaxis.set_major_locator(locator)
    formatter = ConciseDateFormatter(locator, tz=timezone.utc)  # type: ignore[no-untyped-call]
    # Months as numbers: their names would follow the language of the machine.
    formatter.zero_formats = ['', '%Y', '%m-%d', '%m-%d', '%H:%M', '%H:%M']
    formatter.offset_formats = ['', '%Y', '%Y-%m', '%Y-%m-%d', '%Y-%m-%d', '%Y-%m-%d %H:%M']
    formatter.formats[1:3] = ['%Y-%m', '%m-%d']
    axes.xaxis.set_major_formatter(formatter)


def marked_events(events: Sequence[Event]) -> list[tuple[int, Event]]:
    """Return the events to mark, each with its number from 1.

    Of more than :data:`_MAX_LINES` events only the alarms are marked, and of more alarms none.
    """
    numbered = list(enumerate(events, 1))
    if len(numbered) > _MAX_LINES:
        numbered = [(i, e) for i, e in numbered if e.raised and e.after.severity is Severity.ERROR]
    return numbered if len(numbered) <= _MAX_LINES else []


def _draw_event_lines(panels: dict[str, canvas.Axes], lines: _Lines) -> None:
    """Draw a line at each event of :func:`marked_events` through all panels but that of the alarm.

    If they are at most 60, their numbers stand above, in three rows, as far as these do not collide.
    """
    events = marked_events(lines.timeline.scan.events)
    first = panels['speed']
    free = [-np.inf] * 3
    for number, event in events:
        when = float(lines.at(event.time_ns))
        colour = canvas.CONDITION_COLOUR[event.after]
        for name, axes in panels.items():
            if name != 'alarm':
                axes.axvline(when, color=colour, lw=0.9, alpha=0.8, zorder=3)
        spot = float(first.transData.transform((when, 0.0))[0])
        row = next((row for row, taken in enumerate(free) if spot >= taken), None)
        if row is not None and len(events) <= 60:
            look: canvas.Look = {'ha': 'center', 'va': 'bottom', 'size': 8.5, 'color': canvas.INK}
            place: canvas.Look = {'xycoords': ('data', 'axes fraction'), 'textcoords': 'offset points'}
            first.annotate(str(number), (when, 1.0), (0.0, 2.0 + 10.0 * row), **place, **look)
            free[row] = spot + 7.0 * len(str(number)) + 6.0
