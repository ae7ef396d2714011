# SPDX-License-Identifier: Apache-2.0
"""The outline of a bearing's verdicts: few points, and the same extremes as all of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stickslip_monitor.arrays import BoolArray, FloatArray, IndexArray, IntArray
from stickslip_monitor.monitor.assessment import Assessment, assess, at_indices
from stickslip_monitor.monitor.bulk import Scan
from stickslip_monitor.monitor.config import BearingConfig
from stickslip_monitor.monitor.verdict import Event
from stickslip_monitor.offline.follow import BearingBlock

_MOST = 600


@dataclass(frozen=True, slots=True)
class Outline:
    """Some of the n verdicts on a recording, which says of each what :class:`Scan` does."""

    time_ns: IntArray
    until_ns: IntArray
    assessment: Assessment
    sticking: BoolArray
    events: Sequence[Event]


Verdicts = Scan | Outline
"""What is drawn and told of a bearing: all its verdicts, or their outline."""


class _Rows(NamedTuple):
    """Points that may stay, shape (n,) each: first and last, and those of extreme scores."""

    number: IntArray  # which point of the recording it is
    time_ns: IntArray
    until_ns: IntArray  # how long it counts
    speed: FloatArray  # of the surface [m/s]
    load: FloatArray  # [N]
    sticking: BoolArray
    opens: BoolArray  # whether the line is interrupted before it
    scores: FloatArray  # columns whose extremes stay, shape (m, n); nan for none

    def kept(self, rows: IndexArray) -> _Rows:
        """Some of them."""
        columns: Any = (column[..., rows] for column in self)
        return _Rows(*columns)


class Outliner:
    """Follows a bearing and keeps the outline of its verdicts.

    The points are taken in stretches of one length, which doubles when they become too many. Of
    each stay those with the least and the greatest speed, load, margins and predicted amplitude,
    and the first one before which the line is interrupted.
    """

    def __init__(self, config: BearingConfig) -> None:
        self._config = config
        self._count = 0
        self._length = 1
        times, numbers, flags = np.empty(0, np.int64), np.empty(0), np.empty(0, np.bool_)
        self._rows = _Rows(times, times, times, numbers, numbers, flags, flags, np.empty((5, 0)))
        self._events: list[Event] = []
        self._last: tuple[int, int] | None = None

    def take(self, block: BearingBlock) -> None:
        """Take the next verdicts."""
        scan = block.scan
        self._events += scan.events
        if not scan.time_ns.size:
            return
        rows = self._new(scan)
        self._count += scan.time_ns.size
        while self._count > _MOST * self._length:
            self._length *= 2
        rows = self._thinned(rows)
        rows = _join(self._rows, rows)
        self._rows = self._thinned(rows) if rows.number.size > 24 * _MOST else rows

    def _new(self, scan: Scan) -> _Rows:
        points, time = scan.assessment, scan.time_ns
        amplitude = np.full(time.size, np.nan)
        sticking = np.flatnonzero(scan.sticking)
        amplitude[sticking] = at_indices(points, sticking).amplitude
        # The line is interrupted where an input was lost or the clock jumped back.
        before, ends = self._last or (int(time[0]), int(time[0]))
        self._last = int(time[-1]), int(scan.until_ns[-1])
        opens = np.append(ends, scan.until_ns[:-1]) < time
        opens |= time < np.append(before, time[:-1])
        return _Rows(
            self._count + np.arange(time.size),
            time,
            scan.until_ns,
            points.speed,
            points.load,
            scan.sticking,
            opens,
            np.stack(
                [
                    np.abs(points.speed),
                    points.load,
                    _finite(points.hopf_margin),
                    _finite(points.fold_margin),
                    amplitude,
                ]
            ),
        )

    def _thinned(self, rows: _Rows) -> _Rows:
        if self._length == 1 or not rows.number.size:
            return rows
        stretch = rows.number // self._length
        starts = np.flatnonzero(np.diff(stretch, prepend=-1))
        kept = [np.array([0, stretch.size - 1]), _first(rows.opens, starts)]
        for column in rows.scores:
            for score in (column, -column):
                score = np.where(np.isnan(score), -np.inf, score)
                most = np.repeat(
                    np.maximum.reduceat(score, starts), np.diff([*starts, score.size])
                )
                kept.append(_first((score == most) & (score > -np.inf), starts))
        return rows.kept(np.unique(np.concatenate(kept)))

    def outline(self) -> Outline:
        """The outline of what was taken; of few points all of them."""
        config = self._config
        rows = self._thinned(self._rows)
        known = assess(config.bearing, rows.speed, rows.load, config.belief)
        return Outline(rows.time_ns, self._until(rows), known, rows.sticking, self._events)

    def _until(self, rows: _Rows) -> IntArray:
        """Each counts until the next but where the line is interrupted: once in a stretch."""
        stretch = rows.number // self._length
        starts = np.flatnonzero(np.diff(stretch, prepend=-1))
        opens = _first(rows.opens, starts)
        until = rows.until_ns.copy()
        until[:-1] = np.maximum(rows.time_ns[1:], rows.time_ns[:-1])
        before = opens[opens > 0] - 1
        until[before] = np.minimum(rows.until_ns[before], rows.time_ns[before + 1] - 1)
        return until


def _finite(column: FloatArray) -> FloatArray:
    return np.where(np.isfinite(column), column, np.nan)


def _first(chosen: BoolArray, starts: NDArray[np.intp]) -> IndexArray:
    """The first that is chosen of each stretch that begins at the starts."""
    places = np.flatnonzero(chosen)
    owner = np.searchsorted(starts, places, 'right')
    return places[np.flatnonzero(np.diff(owner, prepend=0))]


def _join(first: _Rows, second: _Rows) -> _Rows:
    columns: Any = (np.concatenate(pair, axis=-1) for pair in zip(first, second, strict=True))
    return _Rows(*columns)
