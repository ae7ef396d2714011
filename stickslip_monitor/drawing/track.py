# SPDX-License-Identifier: Apache-2.0
"""The path of an operating point over the stability map, with the changes of condition.

Long recordings are thinned by their envelope: fewer points, the same extremes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from stickslip_monitor.arrays import FloatArray, IndexArray
from stickslip_monitor.drawing import canvas
from stickslip_monitor.monitor.ladder import Condition
from stickslip_monitor.offline.outline import Verdicts

_POINTS_PER_INCH = 70
_STOPS = 150
# A step of the course is at least this part of the map's diagonal.
_STRIDE = 0.015
# Colour and width of the course from its beginning to its end: a way back lies on the way out.
_AGES = (('#8c8c8c', 4.0), (canvas.MUTED, 2.6), (canvas.INK, 1.3))
# Size of the ring at the start [points]: an end within it is no mark of its own.
_RING = 12.0
# Where along a part of the course its arrow is.
_ARROW = 0.35
# The names of the marks above the map [inch].
_LEGEND_COLUMN, _LEGEND_ROW, _MARGINS = 1.6, 0.2, 1.08
_MARKER = {
    Condition.NORMAL: 'o',
    Condition.VIBRATION: 'v',
    Condition.CAUTION: 's',
    Condition.BISTABLE: 'D',
    Condition.STICK_SLIP: '^',
    Condition.AMPLITUDE: 'p',
    Condition.INPUT_STALE: 'X',
}


def envelope(most: int, *columns: Any) -> IndexArray:
    """Which points of a recording to draw, so that the line keeps its outline.

    The points are taken in blocks of one length; of each block stay the least and the greatest
    value of every column, at its own instant, and an interruption.

    Args:
        most: Points to draw, nearly; a shorter recording stays as it is.
        columns: Values, each of shape (n,); ``nan`` interrupts the line.

    Returns:
        Indices in rising order, at most about ``most`` of them.
    """
    size = columns[0].size
    blocks = max(1, most // (3 * len(columns)))
    if size <= max(most, blocks):
        return np.arange(size)
    length = -(-size // blocks)
    start = np.arange(0, size, length)
    kept = [np.array([0, size - 1])]
    for column in columns:
        padded = np.append(column, np.full(start.size * length - size, np.nan)).astype(float)
        table = padded.reshape(start.size, length)
        missing = np.isnan(table)
        kept += [
            start + np.where(missing, np.inf, table).argmin(axis=1),
            start + np.where(missing, -np.inf, table).argmax(axis=1),
            (start + missing.argmax(axis=1))[missing.any(axis=1)],
        ]
    found = np.unique(np.concatenate(kept))
    return found[found < size]


class TrackEvent(NamedTuple):
    """A change of the alarm to a condition, and the operating point at which it was raised."""

    speed: float  # of the surface [m/s], ``nan`` where there was no point yet
    load: float  # [N]
    condition: Condition


@dataclass(frozen=True, slots=True)
class Track:
    """The operating points of a recording; astern is drawn as ahead, as the model has it."""

    time: FloatArray  # shape (n,) [s]; any zero
    speed: FloatArray  # of the surface, shape (n,), ``nan`` where it is interrupted [m/s]
    load: FloatArray  # shape (n,) [N]
    events: Sequence[TrackEvent] = ()  # the alarm's changes

    def conditions(self) -> list[Condition]:
        """The conditions that the events lead to."""
        return [c for c in Condition if any(event.condition is c for event in self.events)]

    def legend_height(self, width: float) -> float:
        """Room that the names of the marks take above a map of a width [both inch]."""
        names = len(self.conditions()) + 4
        return 0.1 + -(-names // _columns(width)) * _LEGEND_ROW


def track_of_scan(scan: Verdicts) -> Track:
    """The track of a bearing's scanned recording, interrupted where an input was lost."""
    start = int(scan.time_ns[0]) if scan.time_ns.size else 0
    lost = np.flatnonzero(scan.until_ns[:-1] < scan.time_ns[1:]) + 1
    columns = [
        (scan.time_ns - start) * 1e-9,
        np.asarray(scan.assessment.speed, dtype=float),
        np.asarray(scan.assessment.load, dtype=float),
    ]
    time, speed, load = (np.insert(column, lost, np.nan) for column in columns)
    events = [
        TrackEvent(float(e.assessment.speed), float(e.assessment.load), e.after)
        for e in scan.events
        if e.assessment is not None
    ]
    return Track(time, speed, load, events)


def _columns(width: float) -> int:
    return max(1, int((width - _MARGINS) / _LEGEND_COLUMN))


def draw_track(axes: canvas.Axes, track: Track, rpm: float, width: float = canvas.WIDTH) -> None:
    """Draw a track on a map; the legend above it names the ends and the changes of the alarm.

    The axes have their final limits in rpm and kN; ``rpm`` is the surface speed of one rpm [m/s],
    the width that of the figure [inch].
    """
    x, y = np.abs(track.speed) / rpm, track.load / 1e3
    known = np.flatnonzero(np.isfinite(x) & np.isfinite(y))
    if not known.size:
        return
    # Every place that it has been to, faint.
    drawn = envelope(int(width * _POINTS_PER_INCH), x, y)
    axes.plot(x[drawn], y[drawn], color=canvas.MUTED, lw=0.7, alpha=0.45, zorder=6, label='measured')
    _course(axes, x, y)
    first, last = axes.transData.transform(np.column_stack([x, y])[known[[0, -1]]])
    apart = np.hypot(*(last - first)) > _RING * axes.figure.dpi / 72.0
    ends = [(known[0], 'start' if apart else 'start and end', 'o', _RING, canvas.PAPER)]
    if apart:
        ends.append((known[-1], 'end', 's', 6.5, canvas.INK))
    for i, name, marker, size, face in ends:
        edge = canvas.INK if face == canvas.PAPER else canvas.PAPER
        axes.plot(x[i], y[i], marker, ms=size, mec=edge, mew=1.5, mfc=face, zorder=11, label=name)
    for condition in track.conditions():
        own = [event for event in track.events if event.condition is condition]
        axes.plot(
            [abs(event.speed) / rpm for event in own],
            [event.load / 1e3 for event in own],
            ls='',
            marker=_MARKER[condition],
            ms=8.5,
            mfc=canvas.CONDITION_COLOUR[condition],
            mec=canvas.PAPER,
            mew=1.0,
            zorder=10,
            label=f'to: {canvas.CONDITION_NAMES[condition]}',
        )
    drawn_as = [line for line in axes.lines if line.get_label() in ('measured', 'smoothed')]
    marks = [*drawn_as, *(line for line in axes.lines if line.get_zorder() >= 10)]
    canvas.legend_above(axes, _columns(width), handles=marks, handlelength=1.2)


def _course(axes: canvas.Axes, x: FloatArray, y: FloatArray) -> None:
    """The track without noise: means over stretches of time, at least a stride apart.

    It goes from wide and light to narrow and dark, so that ways back can be told.
    """
    box = axes.get_window_extent()
    stride = _STRIDE * float(np.hypot(box.width, box.height))
    shown = axes.transData.transform(np.column_stack([x, y]))
    known = np.all(np.isfinite(shown), axis=1)
    length = max(1, int(known.sum()) // _STOPS)
    edges = np.flatnonzero(np.diff(known.astype(np.int8))) + 1
    paths = []
    for run in np.split(shown, edges):
        if np.isfinite(run[0]).all():
            starts = np.arange(0, run.shape[0], length)
            means = np.add.reduceat(run, starts) / np.diff([*starts, run.shape[0]])[:, None]
            kept = [run[0]]
            for point in means[1:-1]:
                if np.hypot(*(point - kept[-1])) >= stride:
                    kept.append(point)
            paths.append(np.array([*kept, run[-1]]))
    steps = [np.hypot(*np.diff(path, axis=0).T) for path in paths]
    total, done = sum(float(each.sum()) for each in steps) or 1.0, 0.0
    drawn = False
    for path, each in zip(paths, steps, strict=True):
        along = (done + np.cumsum(each) - 0.5 * each) / total
        done += float(each.sum())
        part = np.minimum((along * len(_AGES)).astype(int), len(_AGES) - 1)
        for age, (colour, wide) in enumerate(_AGES):
            own = np.flatnonzero(part == age)
            if own.size:
                line = axes.transData.inverted().transform(path[own[0] : own[-1] + 2]).T
                axes.plot(*line, color=canvas.PAPER, lw=wide + 1.2, alpha=0.6, zorder=7)
                name = '_' if drawn else 'smoothed'
                axes.plot(*line, color=colour, lw=wide, zorder=8, solid_capstyle='butt', label=name)
                _arrow(axes, line, colour)
                drawn = True


def _arrow(axes: canvas.Axes, line: FloatArray, colour: str) -> None:
    """The direction of a part of the course, of shape (2, n), before its middle.

    On a way back that lies on the way out the arrows are elsewhere.
    """
    k = int(_ARROW * (line.shape[1] - 1))
    axes.annotate(
        '',
        tuple(line[:, k + 1]),
        tuple(line[:, k]),
        zorder=9,
        arrowprops={
            'arrowstyle': '-|>,head_width=0.34,head_length=0.6',
            'fc': colour,
            'ec': canvas.PAPER,
            'lw': 0.6,
            'shrinkA': 0.0,
            'shrinkB': 0.0,
        },
    )
