# SPDX-License-Identifier: Apache-2.0
"""Words next to what they name, where they hide neither a curve nor each other.

Every label tries its places in turn and takes the one that costs least: overlapping another label
or leaving the axes costs most, lying on a curve a little. For this the axes must have their final
limits and position, and the curves must be drawn, before the first label is placed.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from stickslip_monitor.drawing.palette import INK

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.text import Text
    from matplotlib.transforms import Bbox

FloatArray = NDArray[np.float64]
Place = tuple[float, float, str, str]
"""Offset from a point in x and y [points], horizontal and vertical alignment."""

_COST_OVERLAP, _COST_OUTSIDE, _COST_CURVE = 1000.0, 500.0, 1.0
_FREE = 0.5
_PAD = 2.0
_PER_CURVE = 600
_ALONG = (0.5, 0.4, 0.6, 0.3, 0.7, 0.2, 0.8, 0.12, 0.88)


def around(distance: float) -> tuple[Place, ...]:
    """The places around a point at a distance [points], best first."""
    d, s = distance, 0.75 * distance
    return (
        (s, s, 'left', 'bottom'),
        (-s, s, 'right', 'bottom'),
        (s, -s, 'left', 'top'),
        (-s, -s, 'right', 'top'),
        (0.0, d, 'center', 'bottom'),
        (0.0, -d, 'center', 'top'),
        (d, 0.0, 'left', 'center'),
        (-d, 0.0, 'right', 'center'),
    )


class Labeller:
    """Places the labels of one axes."""

    def __init__(self, axes: Axes) -> None:
        self.axes = axes
        self._boxes: list[Bbox] = []
        self._curves = [np.empty((0, 2))]

    def avoid(self, x: Any, y: Any) -> None:
        """Keep labels off a curve given in data coordinates; ``nan`` interrupts it."""
        shown = self._on_paper(x, y)
        known = np.all(np.isfinite(shown), axis=1)
        if known.any():
            self._curves.append(_dense(shown, known))

    def point(
        self, text: str, xy: tuple[float, float], places: Sequence[Place], **style: Any
    ) -> Text:
        """Label a point [data coordinates] from one of the places around it."""
        candidates = [
            {'xytext': (dx, dy), 'ha': ha, 'va': va, 'rotation': 0.0}
            for dx, dy, ha, va in places
        ]
        return self._best(text, [(xy, c) for c in candidates], style)

    def along(
        self,
        text: str,
        x: Any,
        y: Any,
        distance: float = 4.0,
        fractions: Sequence[float] = _ALONG,
        **style: Any,
    ) -> Text | None:
        """Label a curve, turned along it, on one of its two sides; distance in points.

        ``None``, and no label, where no part of the curve is in sight.
        """
        shown = self._on_paper(x, y)
        seen = np.flatnonzero(self._inside(shown))
        if seen.size < 2:
            return None
        shown = shown[seen]
        candidates = []
        for where in fractions:
            at, angle = _tangent(shown, where)
            for side in (1.0, -1.0) if distance else (0.0,):
                normal = side * distance * np.array([-np.sin(angle), np.cos(angle)])
                candidates.append((self._data(at), _turned(normal, side, angle)))
        return self._best(text, candidates, style)

    def area(self, text: str, inside: NDArray[np.bool_], **style: Any) -> Text | None:
        """Label an area in its widest part; no label where the text would not fit.

        Args:
            text: The label.
            inside: Whether a cell of an even grid over the axes belongs to it, shape (rows from
                the bottom, columns from the left).
            style: Text properties.
        """
        from scipy.ndimage import distance_transform_edt

        box = self.axes.get_window_extent()
        cell = (box.height / inside.shape[0], box.width / inside.shape[1])
        # Text is wide, so room to the left and right counts for less than room above and below.
        room = distance_transform_edt(np.pad(inside, 1), sampling=(cell[0] * 2.5, cell[1]))
        room = room[1:-1, 1:-1]
        order = np.argsort(room, axis=None)[::-1][:: max(1, room.size // 400)]
        rows, columns = np.unravel_index(order[room.ravel()[order] > 0.0], room.shape)
        centre = {'xytext': (0.0, 0.0), 'ha': 'center', 'va': 'center', 'rotation': 0.0}
        candidates = [
            (self._data(np.array([box.x0 + (j + 0.5) * cell[1], box.y0 + (i + 0.5) * cell[0]])),
             centre)
            for i, j in zip(rows.tolist(), columns.tolist(), strict=True)
        ]  # fmt: skip
        label = self._best(text, candidates[:60], style) if candidates else None
        if label is not None and not self._fits(label, inside, cell):
            self._boxes.pop()
            label.remove()
            return None
        return label

    def _fits(self, label: Text, inside: NDArray[np.bool_], cell: tuple[float, float]) -> bool:
        box, frame = label.get_window_extent(), self.axes.get_window_extent()
        rows = np.arange((box.y0 - frame.y0) // cell[0], (box.y1 - frame.y0) // cell[0] + 1)
        columns = np.arange((box.x0 - frame.x0) // cell[1], (box.x1 - frame.x0) // cell[1] + 1)
        i = np.clip(rows.astype(int), 0, inside.shape[0] - 1)
        j = np.clip(columns.astype(int), 0, inside.shape[1] - 1)
        return bool(inside[np.ix_(i, j)].all())

    def _best(
        self, text: str, candidates: Iterable[tuple[Any, dict[str, Any]]], style: dict[str, Any]
    ) -> Text:
        label = self.axes.annotate(text, (0.0, 0.0), textcoords='offset points')
        label.update({'color': INK, 'rotation_mode': 'anchor'} | style)
        lowest, chosen = np.inf, None
        for xy, place in candidates:
            self._move(label, xy, place)
            cost = self._cost(label.get_window_extent().padded(_PAD))
            if cost < lowest:
                lowest, chosen = cost, (xy, place)
            if cost < _FREE:
                break
        assert chosen is not None
        self._move(label, *chosen)
        self._boxes.append(label.get_window_extent().padded(_PAD))
        return label

    def _move(self, label: Any, xy: Any, place: dict[str, Any]) -> None:
        label.xy = xy
        label.set_position(place['xytext'])
        label.update({key: place[key] for key in ('ha', 'va', 'rotation')})

    def _cost(self, box: Bbox) -> float:
        cost = _COST_OVERLAP * sum(box.overlaps(other) for other in self._boxes)
        frame = self.axes.get_window_extent()
        inside = frame.x0 <= box.x0 and box.x1 <= frame.x1 and box.y1 <= frame.y1
        cost += _COST_OUTSIDE * (not (inside and frame.y0 <= box.y0))
        points = np.concatenate(self._curves)
        covered = np.all((points > (box.x0, box.y0)) & (points < (box.x1, box.y1)), axis=1)
        return float(cost + _COST_CURVE * np.count_nonzero(covered))

    def _on_paper(self, x: Any, y: Any) -> FloatArray:
        pairs = np.column_stack(np.broadcast_arrays(np.asarray(x, float), np.asarray(y, float)))
        shown: FloatArray = np.asarray(self.axes.transData.transform(pairs))
        return shown

    def _data(self, shown: FloatArray) -> tuple[float, float]:
        x, y = self.axes.transData.inverted().transform(shown)
        return float(x), float(y)

    def _inside(self, shown: FloatArray) -> NDArray[np.bool_]:
        frame = self.axes.get_window_extent()
        low, high = (frame.x0 - 1.0, frame.y0 - 1.0), (frame.x1 + 1.0, frame.y1 + 1.0)
        with np.errstate(invalid='ignore'):
            within: NDArray[np.bool_] = np.all((shown >= low) & (shown <= high), axis=1)
        return within


def _dense(shown: FloatArray, known: NDArray[np.bool_]) -> FloatArray:
    """Points close to each other along the known stretches of a curve on paper [pixels]."""
    place = np.arange(shown.shape[0])
    fine = np.linspace(0, shown.shape[0] - 1, max(_PER_CURVE, shown.shape[0]))
    gap = ~known[np.floor(fine).astype(int)] | ~known[np.ceil(fine).astype(int)]
    columns = [np.interp(fine, place[known], shown[known, k]) for k in (0, 1)]
    return np.column_stack(columns)[~gap]


def _tangent(shown: FloatArray, where: float) -> tuple[FloatArray, float]:
    """The point at a fraction of a curve's length on paper, and the curve's angle there."""
    steps = np.hypot(*np.diff(shown, axis=0).T)
    length = np.concatenate([[0.0], np.cumsum(steps)])
    reach = np.clip(where + np.array([-0.04, 0.0, 0.04]), 0.0, 1.0) * length[-1]
    x, y = (np.interp(reach, length, shown[:, k]) for k in (0, 1))
    angle = float(np.arctan2(y[2] - y[0], x[2] - x[0]))
    if abs(angle) > 0.5 * np.pi:
        angle -= np.copysign(np.pi, angle)
    return np.array([x[1], y[1]]), angle


def _turned(normal: FloatArray, side: float, angle: float) -> dict[str, Any]:
    vertical = {1.0: 'bottom', -1.0: 'top', 0.0: 'center'}[side]
    return {
        'xytext': (float(normal[0]), float(normal[1])),
        'ha': 'center',
        'va': vertical,
        'rotation': float(np.degrees(angle)),
    }
