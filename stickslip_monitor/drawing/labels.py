# SPDX-License-Identifier: Apache-2.0
"""Labels next to what they name, placed so that they cover neither curves nor each other.

Every label tries its places in turn and takes the one that hides least of the curves. One that
would lie on another label, or leave the axes, everywhere it could stand is left out. For this the
axes must have their final limits and position before the first label is placed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.drawing.palette import INK, MUTED

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.text import Annotation


_NOT_FITTING = 1e6
_PAD = 2.0
_APART = 3.0
_STEEPEST = 1.8
_ALONG = (0.5, 0.4, 0.6, 0.3, 0.7, 0.2, 0.8, 0.12, 0.88)
_LEADER_FROM = 20.0
_SHARE = {'left': 0.0, 'bottom': 0.0, 'center': 0.5, 'right': 1.0, 'top': 1.0}


class LabelPlace(NamedTuple):
    """Where a label may stand: offset from its point [points of type], alignment, turn [rad]."""

    right: float
    up: float
    ha: str = 'center'
    va: str = 'center'
    angle: float = 0.0


def around(distance: float) -> tuple[LabelPlace, ...]:
    """The places around a point at a distance [points of type], best first."""
    d, s = distance, 0.75 * distance
    return (
        LabelPlace(s, s, 'left', 'bottom'),
        LabelPlace(-s, s, 'right', 'bottom'),
        LabelPlace(s, -s, 'left', 'top'),
        LabelPlace(-s, -s, 'right', 'top'),
        LabelPlace(0.0, d, 'center', 'bottom'),
        LabelPlace(0.0, -d, 'center', 'top'),
        LabelPlace(d, 0.0, 'left', 'center'),
        LabelPlace(-d, 0.0, 'right', 'center'),
    )


@dataclass(frozen=True, slots=True)
class Box:
    """A turned rectangle on paper [pixels]: centre, half its sides, unit vectors along them."""

    centre: FloatArray
    half: FloatArray
    along: FloatArray

    @classmethod
    def upright(cls, centre: FloatArray, width: float, height: float) -> Box:
        """A rectangle that is not turned."""
        return cls(centre, 0.5 * np.array([width, height]), np.eye(2))

    @property
    def corners(self) -> FloatArray:
        """Shape (4, 2)."""
        signs = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)], dtype=float)
        corners: FloatArray = self.centre + (signs * self.half) @ self.along
        return corners

    def overlaps(self, other: Box) -> bool:
        """Whether two rectangles share an area: no axis of either separates them."""
        for axis in (*self.along, *other.along):
            mine, others = self.corners @ axis, other.corners @ axis
            if mine.max() <= others.min() or others.max() <= mine.min():
                return False
        return True

    def covers(self, points: FloatArray) -> NDArray[np.bool_]:
        """Which points, of shape (n, 2), lie inside; shape (n,)."""
        local = (points - self.centre) @ self.along.T
        inside: NDArray[np.bool_] = np.all(np.abs(local) < self.half, axis=1)
        return inside


class Labeller:
    """Places the labels of one axes."""

    def __init__(self, axes: Axes) -> None:
        self.axes = axes
        frame = axes.get_window_extent()
        self._low, self._high = np.array(frame.min), np.array(frame.max)
        figure = axes.get_figure(root=True)
        assert figure is not None
        self._pixels = figure.dpi / 72.0
        self.boxes: list[Box] = []
        self._curves = np.empty((0, 2))

    def avoid(self, x: Any, y: Any) -> None:
        """Keep labels off a curve given in data coordinates; ``nan`` interrupts it."""
        shown = self._on_paper(x, y)
        known = np.all(np.isfinite(shown), axis=1)
        if known.any():
            # What lies beyond the axes hides nothing, and a dense track covers few places.
            points = _dense(shown, known)
            points = points[np.all((points >= self._low) & (points <= self._high), axis=1)]
            places = np.unique(np.rint(points / _APART), axis=0) * _APART
            self._curves = np.concatenate([self._curves, places])

    def reserve(self, x: float, y: float, size: float = 9.0) -> None:
        """Keep labels off a mark at a point; its size in points of type."""
        side = size * self._pixels
        self.boxes.append(Box.upright(self._on_paper(x, y)[0], side, side))

    def point(
        self, text: str, xy: tuple[float, float], places: Sequence[LabelPlace], **style: Any
    ) -> Annotation | None:
        """Label a point in data coordinates; a far label is tied to it by a thin line."""
        return self._best(text, [(xy, place) for place in places], style)

    def along(
        self,
        text: str,
        x: Any,
        y: Any,
        distance: float = 3.0,
        fractions: Sequence[float] = _ALONG,
        **style: Any,
    ) -> Annotation | None:
        """Label a curve, turned along it, beside it (or on it, at distance 0)."""
        shown = self._longest_in_sight(self._on_paper(x, y))
        if shown.shape[0] < 2:
            return None
        candidates = []
        for where in fractions:
            at, angle = _tangent(shown, where)
            for side in (1.0, -1.0) if distance else (0.0,):
                candidates.append((self._data(at), _beside(side, distance, angle)))
        return self._best(text, candidates, style)

    def area(self, text: str, inside: NDArray[np.bool_], **style: Any) -> Annotation | None:
        """Label an area in a wide part of it; no label where the text does not fit in.

        Args:
            text: The label.
            inside: Whether a cell of an even grid over the axes belongs to it, shape (rows from
                the bottom, columns from the left).
            style: Text properties.
        """
        from scipy.ndimage import distance_transform_edt

        shape = np.array(inside.shape[::-1])
        cell = (self._high - self._low) / shape
        # Text is wide, so room above and below counts for more than room to its sides.
        room = distance_transform_edt(np.pad(inside, 1), sampling=(3.0 * cell[1], cell[0]))
        room = room[1:-1, 1:-1]
        best = np.argsort(room, axis=None)[::-1][: max(1, room.size // 4) : 8]
        rows, columns = np.unravel_index(best, room.shape)
        centres = self._low + (np.stack([columns, rows], axis=1) + 0.5) * cell
        candidates = [(self._data(centre), LabelPlace(0.0, 0.0)) for centre in centres]
        i, j = np.nonzero(~inside)
        outside = self._low + (np.stack([j, i], axis=1) + 0.5) * cell
        return self._best(text, candidates, style, outside)

    def _best(
        self,
        text: str,
        candidates: Sequence[tuple[tuple[float, float], LabelPlace]],
        style: dict[str, Any],
        forbidden: FloatArray | None = None,
    ) -> Annotation | None:
        style = {'color': INK, 'rotation_mode': 'anchor'} | style
        width, height = self._size(text, style)
        lowest, chosen = _NOT_FITTING, None
        for xy, place in candidates:
            box = self._box(xy, place, width, height)
            cost = self._cost(box)
            if forbidden is not None and cost < lowest and box.covers(forbidden).any():
                continue
            if cost < lowest:
                lowest, chosen = cost, (xy, place, box)
            if cost == 0.0:
                break
        if chosen is None:
            return None
        xy, place, box = chosen
        self.boxes.append(box)
        far = max(abs(place.right), abs(place.up)) > _LEADER_FROM
        leader = {'arrowstyle': '-', 'color': MUTED, 'lw': 0.8, 'shrinkA': 1.0, 'shrinkB': 4.0}
        return self.axes.annotate(
            text, xy, xytext=place[:2], textcoords='offset points', ha=place.ha, va=place.va,
            rotation=float(np.degrees(place.angle)), arrowprops=leader if far else None, **style,
        )  # fmt: skip

    def _size(self, text: str, style: dict[str, Any]) -> tuple[float, float]:
        """Width and height on paper [pixels]."""
        trial = self.axes.text(0.0, 0.0, text, **style)
        extent = trial.get_window_extent()
        trial.remove()
        return float(extent.width), float(extent.height)

    def _box(self, xy: tuple[float, float], place: LabelPlace, width: float, height: float) -> Box:
        cosine, sine = np.cos(place.angle), np.sin(place.angle)
        along = np.array([(cosine, sine), (-sine, cosine)])
        anchor = self._on_paper(*xy)[0] + self._pixels * np.array(place[:2])
        share = np.array([0.5 - _SHARE[place.ha], 0.5 - _SHARE[place.va]])
        size = np.array([width, height])
        return Box(anchor + (share * size) @ along, 0.5 * size + _PAD, along)

    def _cost(self, box: Box) -> float:
        corners = box.corners
        if np.any(corners < self._low) or np.any(corners > self._high):
            return _NOT_FITTING
        if any(box.overlaps(other) for other in self.boxes):
            return _NOT_FITTING
        return float(np.count_nonzero(box.covers(self._curves)))

    def _on_paper(self, x: Any, y: Any) -> FloatArray:
        pairs = np.column_stack(np.broadcast_arrays(np.asarray(x, float), np.asarray(y, float)))
        shown: FloatArray = np.asarray(self.axes.transData.transform(pairs))
        return shown

    def _longest_in_sight(self, shown: FloatArray) -> FloatArray:
        """The longest stretch of a curve on paper that lies inside the axes."""
        with np.errstate(invalid='ignore'):
            seen = np.all((shown >= self._low - 1.0) & (shown <= self._high + 1.0), axis=1)
        edges = np.flatnonzero(np.diff(np.concatenate([[0], seen, [0]])))
        stretches = [shown[i:j] for i, j in zip(edges[::2], edges[1::2], strict=True)]
        return max(stretches, key=lambda s: _lengths(s)[-1], default=shown[:0])

    def _data(self, shown: FloatArray) -> tuple[float, float]:
        x, y = self.axes.transData.inverted().transform(shown)
        return float(x), float(y)


def _dense(shown: FloatArray, known: NDArray[np.bool_]) -> FloatArray:
    """Points close to each other along the known stretches of a curve on paper [pixels]."""
    pair = np.flatnonzero(known[:-1] & known[1:])
    step = np.clip(shown[pair + 1] - shown[pair], -1e4, 1e4)
    count = np.ceil(np.hypot(*step.T) / _APART).astype(int)
    pair, step = np.repeat(pair, count), np.repeat(step, count, axis=0)
    rank = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    share = rank / np.repeat(count, count)
    points: FloatArray = shown[pair] + share[:, None] * step
    return points


def _lengths(shown: FloatArray) -> FloatArray:
    """Length of a path on paper up to each of its points [pixels]."""
    steps = np.hypot(*np.diff(shown, axis=0).T)
    return np.concatenate([[0.0], np.cumsum(steps)])


def _tangent(shown: FloatArray, where: float) -> tuple[FloatArray, float]:
    """The point at a fraction of a curve's length on paper, and the curve's angle there."""
    length = _lengths(shown)
    reach = np.clip(where + np.array([-0.04, 0.0, 0.04]), 0.0, 1.0) * length[-1]
    x, y = (np.interp(reach, length, shown[:, k]) for k in (0, 1))
    angle = float(np.arctan2(y[2] - y[0], x[2] - x[0]))
    # Left to right, and where the curve is steep from below.
    if angle > _STEEPEST:
        angle -= np.pi
    elif angle < _STEEPEST - np.pi:
        angle += np.pi
    return np.array([x[1], y[1]]), angle


def _beside(side: float, distance: float, angle: float) -> LabelPlace:
    right, up = side * distance * np.array([-np.sin(angle), np.cos(angle)])
    vertical = {1.0: 'bottom', -1.0: 'top', 0.0: 'center'}[side]
    return LabelPlace(float(right), float(up), 'center', vertical, angle)
