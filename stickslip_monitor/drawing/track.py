# SPDX-License-Identifier: Apache-2.0
"""The path of an operating point over the stability map, with the changes of condition.

Long recordings are thinned by their envelope: fewer points, the same extremes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from stickslip_monitor.arrays import FloatArray, IndexArray
from stickslip_monitor.drawing.canvas import WIDTH
from stickslip_monitor.drawing.labels import Labeller, around
from stickslip_monitor.drawing.palette import CONDITION_COLOUR, CONDITION_NAMES, INK, MUTED, PAPER
from stickslip_monitor.monitor.ladder import Condition
from stickslip_monitor.offline.outline import Verdicts

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def envelope(most: int, *columns: Any) -> IndexArray:
    """Which points of a recording to draw, so that the line keeps its outline.

    The points are taken in blocks of one length; of each block stay the least and the greatest
    value of every column and, where the line is interrupted, the interruption. So every extreme
    stays, at its own instant.

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
    kept = [np.array([0, size - 1])]
    for column in columns:
        kept += _extremes(np.asarray(column, dtype=float), length)
    return np.unique(np.concatenate(kept))


def _extremes(column: FloatArray, length: int) -> list[IndexArray]:
    """Indices of the least, the greatest and the first missing value of each block."""
    blocks = -(-column.size // length)
    padded = np.full(blocks * length, np.nan)
    padded[: column.size] = column
    table = padded.reshape(blocks, length)
    missing = np.isnan(table)
    missing.reshape(-1)[column.size :] = False
    start = np.arange(blocks) * length
    known, broken = ~np.isnan(table).all(axis=1), missing.any(axis=1)
    return [
        (start + np.where(np.isnan(table), np.inf, table).argmin(axis=1))[known],
        (start + np.where(np.isnan(table), -np.inf, table).argmax(axis=1))[known],
        (start + missing.argmax(axis=1))[broken],
    ]


_ARROWS = 5
# To both sides of an arrow head [pixels].
_ARROW_REACH = 9.0
_STRIDE_FRACTION = 0.015
_STOPS = 150
# Colour and width of the course from its beginning to its end: a way back lies on the way out.
_AGES = (('#8c8c8c', 4.0), (MUTED, 2.6), (INK, 1.3))
_MOST_DRAWN = 20000
_CELL = 1.0
# The names of the marks above the map [inch].
_LEGEND_COLUMN, _LEGEND_ROW, _LEGEND_TITLE = 1.3, 0.2, 0.3
_MARKER = {
    Condition.NORMAL: 'o',
    Condition.VIBRATION: 'v',
    Condition.CAUTION: 's',
    Condition.BISTABLE: 'D',
    Condition.STICK_SLIP: '^',
    Condition.AMPLITUDE: 'p',
    Condition.INPUT_STALE: 'X',
}


@dataclass(frozen=True, slots=True)
class TrackEvent:
    """A change of the alarm: the operating point that it was told at, and the condition from then.

    Attributes:
        speed: Surface speed [m/s]; ``nan`` where there was no operating point yet.
        load: Load [N].
        condition: The condition from then on.
    """

    speed: float
    load: float
    condition: Condition


@dataclass(frozen=True, slots=True)
class Track:
    """The operating points of a recording.

    Attributes:
        time: Shape (n,) [s]; any zero.
        speed: Surface speeds, shape (n,), ``nan`` where the track is interrupted [m/s]; astern is
            drawn as ahead, which the model does not tell apart.
        load: Loads, shape (n,) [N].
        events: The alarm's changes.
    """

    time: FloatArray
    speed: FloatArray
    load: FloatArray
    events: Sequence[TrackEvent] = ()


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


def thinned(track: Track, most: int) -> Track:
    """The track with fewer points, nearly ``most``, and the same extremes of speed and load."""
    kept = envelope(most, np.abs(track.speed), track.load)
    return Track(track.time[kept], track.speed[kept], track.load[kept], track.events)


def legend_height(track: Track, width: float) -> float:
    """Room that the names of the marks take above a map of a width [both inch]."""
    if not track.events:
        return 0.0
    rows = -(-len(_conditions(track)) // _columns(width))
    return _LEGEND_TITLE + rows * _LEGEND_ROW


def _conditions(track: Track) -> list[Condition]:
    """The conditions that the events of a track lead to."""
    return [c for c in Condition if any(event.condition is c for event in track.events)]


def _columns(width: float) -> int:
    return max(1, int((width - 1.08) / _LEGEND_COLUMN))


def draw_track(
    axes: Axes, track: Track, x_unit: float, y_unit: float, width: float = WIDTH
) -> None:
    """Draw a track on a map.

    Args:
        axes: The axes, with their final limits.
        track: The track.
        x_unit: Surface speed of one unit of the x axis [m/s].
        y_unit: Load of one unit of the y axis [N].
        width: Width of the figure [inch].
    """
    x, y = np.abs(track.speed) / x_unit, track.load / y_unit
    known = np.flatnonzero(np.isfinite(x) & np.isfinite(y))
    if not known.size:
        return
    _cloud(axes, x, y)
    paths = _course(axes, x, y)
    _draw_course(axes, paths)
    _arrows(axes, paths)
    _events(axes, track, x_unit, y_unit, _columns(width))
    labels = Labeller(axes)
    for path in paths:
        labels.avoid(*axes.transData.inverted().transform(path).T)
    for name, i, marker, size in (('start', known[0], 'o', 12.0), ('end', known[-1], 's', 6.5)):
        face, edge = (PAPER, INK) if name == 'start' else (INK, PAPER)
        axes.plot(x[i], y[i], marker, ms=size, mec=edge, mew=1.5, mfc=face, zorder=11)
        labels.reserve(x[i], y[i])
        places = [*around(8.0), *around(24.0), *around(44.0)]
        labels.point(name, (x[i], y[i]), places, weight='bold', size=10.0, zorder=12)


def _cloud(axes: Axes, x: FloatArray, y: FloatArray) -> None:
    """Every place that the track has been to, faint: of a long one a dot, else a thin line."""
    stride = -(-x.size // _MOST_DRAWN)
    if stride == 1:
        axes.plot(x, y, color=MUTED, lw=0.7, alpha=0.45, zorder=6)
        return
    places = _places(axes, x, y)
    axes.plot(
        *places.T, ls='', marker='s', ms=1.0, mew=0.0, color=MUTED, alpha=0.45, rasterized=True,
        zorder=6,
    )  # fmt: skip


def _course(axes: Axes, x: FloatArray, y: FloatArray) -> list[FloatArray]:
    """The track without noise, on the paper: means over stretches of time, far enough apart.

    Returns:
        A path for each stretch between interruptions, each of shape (k, 2) [pixels].
    """
    box = axes.get_window_extent()
    least = _STRIDE_FRACTION * float(np.hypot(box.width, box.height))
    shown = axes.transData.transform(np.column_stack([x, y]))
    known = np.all(np.isfinite(shown), axis=1)
    length = max(1, int(known.sum()) // _STOPS)
    edges = np.flatnonzero(np.diff(known.astype(np.int8))) + 1
    runs = [run for run in np.split(np.arange(known.size), edges) if known[run[0]]]
    return [_strides(_means(shown[run], length), least) for run in runs]


def _means(path: FloatArray, length: int) -> FloatArray:
    """Means over blocks of a length, between the path's own ends."""
    starts = np.arange(0, path.shape[0], length)
    counts = np.diff(np.append(starts, path.shape[0]))
    means = np.add.reduceat(path, starts) / counts[:, None]
    return np.concatenate([path[:1], means[1:-1], path[-1:]])


def _draw_course(axes: Axes, paths: Sequence[FloatArray]) -> None:
    """Draw the course from wide and light to narrow and dark, so that ways back can be told."""
    back = axes.transData.inverted()
    lengths = [np.hypot(*np.diff(path, axis=0).T) for path in paths]
    total, done = sum(float(each.sum()) for each in lengths), 0.0
    for path, each in zip(paths, lengths, strict=True):
        along = (done + np.cumsum(each) - 0.5 * each) / (total or 1.0)
        done += float(each.sum())
        part = np.minimum((along * len(_AGES)).astype(int), len(_AGES) - 1)
        for age, (colour, width) in enumerate(_AGES):
            own = np.flatnonzero(part == age)
            if own.size:
                line = back.transform(path[own[0] : own[-1] + 2]).T
                axes.plot(*line, color=PAPER, lw=width + 1.2, alpha=0.6, zorder=7)
                axes.plot(*line, color=colour, lw=width, zorder=8, solid_capstyle='butt')


def _places(axes: Axes, x: FloatArray, y: FloatArray) -> FloatArray:
    """Where a long track has been, each small cell of the paper once [data], shape (n, 2)."""
    shown = axes.transData.transform(np.column_stack([x, y]))
    known = shown[np.all(np.isfinite(shown), axis=1)]
    cells = np.unique(np.round(known / _CELL), axis=0)
    places: FloatArray = np.asarray(axes.transData.inverted().transform(cells * _CELL))
    return places


def _events(axes: Axes, track: Track, x_unit: float, y_unit: float, columns: int) -> None:
    """Mark where the alarm changed, and tell the marks apart in rows above the map."""
    used = _conditions(track)
    handles = []
    for condition in used:
        own = [event for event in track.events if event.condition is condition]
        handles += axes.plot(
            [abs(event.speed) / x_unit for event in own], [event.load / y_unit for event in own],
            ls='', marker=_MARKER[condition], ms=8.5, mfc=CONDITION_COLOUR[condition], mec=PAPER,
            mew=1.0, zorder=10, label=CONDITION_NAMES[condition],
        )  # fmt: skip
    if used:
        axes.legend(
            handles=handles, loc='lower left', bbox_to_anchor=(0.0, 1.0), frameon=False,
            ncols=min(columns, len(used)), title='alarm becomes', title_fontsize=9.5,
            alignment='left', fontsize=9.5, handletextpad=0.2, columnspacing=1.4,
            borderaxespad=0.1, borderpad=0.1,
        )  # fmt: skip


def _arrows(axes: Axes, paths: Sequence[FloatArray]) -> None:
    """Arrow heads at even distances along the course.

    None is in the middle of its part, where those of a way out and of the same way back meet.
    """
    lengths = [np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(p, axis=0).T))]) for p in paths]
    total = sum(float(length[-1]) for length in lengths)
    back, reach = axes.transData.inverted(), _ARROW_REACH
    for path, length in zip(paths, lengths, strict=True):
        count = round(_ARROWS * float(length[-1]) / total) if total else 0
        for where in (np.arange(count) + 0.3) / max(count, 1) * length[-1]:
            ends = np.clip([where - reach, where + reach], 0.0, length[-1])
            tail, head = np.column_stack([np.interp(ends, length, column) for column in path.T])
            if np.hypot(*(head - tail)) < reach:
                continue  # it turns back just here
            axes.annotate(
                '', xy=tuple(back.transform(head)), xytext=tuple(back.transform(tail)), zorder=9,
                annotation_clip=True,
                arrowprops={
                    'arrowstyle': '-|>,head_length=0.7,head_width=0.32', 'mutation_scale': 15.0,
                    'facecolor': INK, 'edgecolor': PAPER, 'linewidth': 0.6,
                    'shrinkA': 0.0, 'shrinkB': 0.0,
                },
            )  # fmt: skip


def _strides(shown: FloatArray, least: float) -> FloatArray:
    """The ends of a path, and its points at least a distance from the one kept before."""
    kept = [shown[0]]
    for point in shown[1:-1]:
        if np.hypot(*(point - kept[-1])) >= least:
            kept.append(point)
    return np.array([*kept, shown[-1]])
