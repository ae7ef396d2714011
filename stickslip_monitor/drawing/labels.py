# SPDX-License-Identifier: Apache-2.0
"""Labels next to the points that they name, off the curves and off each other.

A label tries its places in turn and takes the one that hides least of the curves; where it would
lie on another label or leave the axes everywhere, it is left out. The axes must have their final
limits before the first label is placed. Curves are named by a legend.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.drawing.palette import INK, MUTED

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.text import Annotation
    from matplotlib.transforms import Bbox

_APART = 3.0
_PAD = 2.0
_LEADER_FROM = 20.0
_SHARE = {'left': 0.0, 'bottom': 0.0, 'center': 0.5, 'right': 1.0, 'top': 1.0}
_ALONG = (0.5, 0.4, 0.6, 0.3, 0.7, 0.2, 0.8, 0.12, 0.88)


class LabelPlace(NamedTuple):
    """Where a label may stand: its offset from its point [points of type], and its alignment."""

    right: float
    up: float
    ha: str = 'center'
    va: str = 'center'


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


class Labeller:
    """Places the labels of one axes.

    Attributes:
        axes: The axes.
        boxes: What is taken on paper [pixels]: labels and reserved marks.
    """

    def __init__(self, axes: Axes) -> None:
        self.axes = axes
        self.boxes: list[Bbox] = []
        self._curves = np.empty((0, 2))

    def avoid(self, x: Any, y: Any) -> None:
        """Keep labels off a curve given in data coordinates; ``nan`` interrupts it."""
        shown = self._on_paper(x, y)
        steps = np.hypot(*np.diff(shown, axis=0).T)
        pieces = [shown] + [
            start + (end - start) * np.linspace(0.0, 1.0, min(400, int(step / _APART)))[:, None]
            for start, end, step in zip(shown[:-1], shown[1:], steps, strict=True)
            if step > _APART
        ]
        points = np.concatenate(pieces)
        self._curves = np.concatenate([self._curves, points[np.isfinite(points).all(axis=1)]])

    def reserve(self, x: float, y: float, size: float = 9.0) -> None:
        """Keep labels off a mark at a point; its size in points of type."""
        from matplotlib.transforms import Bbox

        half = 0.5 * size * self._pixels
        (right, up) = self._on_paper(x, y)[0]
        self.boxes.append(Bbox.from_extents(right - half, up - half, right + half, up + half))

    def point(
        self, text: str, xy: tuple[float, float], places: Sequence[LabelPlace], **style: Any
    ) -> Annotation | None:
        """Label a point in data coordinates; a far label is tied to it by a thin line."""
        return self._best(text, [(xy, place) for place in places], style)

    def along(
        self, text: str, x: Any, y: Any, fractions: Sequence[float] = _ALONG, **style: Any
    ) -> Annotation | None:
        """Label a curve beside a point at one of some fractions of its length in sight."""
        shown = self._on_paper(x, y)
        frame = self.axes.get_window_extent()
        shown = shown[[bool(frame.contains(*point)) for point in shown]]
        if shown.shape[0] < 2:
            return None
        length = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(shown, axis=0).T))])
        at = np.array(fractions) * length[-1]
        spots = np.column_stack([np.interp(at, length, column) for column in shown.T])
        candidates = [
            ((float(right), float(up)), place)
            for right, up in self.axes.transData.inverted().transform(spots)
            for place in around(6.0)
        ]
        return self._best(text, candidates, style)

    def _best(
        self,
        text: str,
        candidates: Sequence[tuple[tuple[float, float], LabelPlace]],
        style: dict[str, Any],
    ) -> Annotation | None:
        width, height = self._size(text, style)
        best: tuple[int, tuple[float, float], LabelPlace, Bbox] | None = None
        for xy, place in candidates:
            box = self._box(xy, place, width, height)
            hidden = self._hidden(box)
            if hidden is not None and (best is None or hidden < best[0]):
                best = (hidden, xy, place, box)
            if hidden == 0:
                break
        if best is None:
            return None
        _, xy, place, box = best
        self.boxes.append(box)
        far = max(abs(place.right), abs(place.up)) > _LEADER_FROM
        leader = {'arrowstyle': '-', 'color': MUTED, 'lw': 0.8, 'shrinkA': 1.0, 'shrinkB': 4.0}
        return self.axes.annotate(
            text, xy, xytext=place[:2], textcoords='offset points', ha=place.ha, va=place.va,
            arrowprops=leader if far else None, **{'color': INK} | style,
        )  # fmt: skip

    def _size(self, text: str, style: dict[str, Any]) -> tuple[float, float]:
        """Width and height on paper [pixels]."""
        trial = self.axes.text(0.0, 0.0, text, **style)
        extent = trial.get_window_extent()
        trial.remove()
        return float(extent.width), float(extent.height)

    def _box(
        self, xy: tuple[float, float], place: LabelPlace, width: float, height: float
    ) -> Bbox:
        from matplotlib.transforms import Bbox

        right, up = self._on_paper(*xy)[0] + self._pixels * np.array(place[:2])
        left, bottom = right - _SHARE[place.ha] * width, up - _SHARE[place.va] * height
        return Bbox.from_bounds(left, bottom, width, height).padded(_PAD)

    def _hidden(self, box: Bbox) -> int | None:
        """How many points of the curves a box hides; None where it does not fit."""
        frame = self.axes.get_window_extent()
        inside = frame.x0 <= box.x0 and box.x1 <= frame.x1
        inside = inside and frame.y0 <= box.y0 and box.y1 <= frame.y1
        if not inside or any(box.overlaps(other) for other in self.boxes):
            return None
        return int(box.count_contains(self._curves))

    @property
    def _pixels(self) -> float:
        figure = self.axes.get_figure(root=True)
        assert figure is not None
        return float(figure.dpi) / 72.0

    def _on_paper(self, x: Any, y: Any) -> FloatArray:
        pairs = np.column_stack(np.broadcast_arrays(np.asarray(x, float), np.asarray(y, float)))
        shown: FloatArray = np.asarray(self.axes.transData.transform(pairs))
        return shown
