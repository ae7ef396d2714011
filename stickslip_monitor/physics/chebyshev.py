# SPDX-License-Identifier: Apache-2.0
"""Smooth functions on a rectangle as polynomials on panels that are halved where needed.

Every panel is a cell of a binary grid and carries a polynomial through the Chebyshev points of
either direction. Whether it is good enough is read off its last coefficients, which fall
geometrically for a smooth function (Trefethen, Approximation Theory and Approximation Practice,
ch. 8); a panel that still is not good enough at the deepest level is left out.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from stickslip_monitor.arrays import BoolArray, FloatArray, IndexArray

NODES = 8
DEPTH = 2
CELLS = 2**DEPTH
# Of the polynomials of one variable.
FINE = 64
# Index of the panel of a cell that none covers.
NOWHERE = -1

# Values at points (x, y), ``nan`` where the function has none.
Function = Callable[[FloatArray, FloatArray], FloatArray]

_POINTS = np.asarray(chebyshev.chebpts1(NODES), dtype=float)
_TO_CHEBYSHEV = np.linalg.inv(chebyshev.chebvander(_POINTS, NODES - 1))
_TO_POWERS = np.stack(
    [
        np.pad(powers, (0, NODES - powers.size))
        for powers in (chebyshev.cheb2poly([0.0] * k + [1.0]) for k in range(NODES))
    ],
    axis=1,
)


@dataclass(frozen=True, slots=True)
class PiecewiseChebyshev2D:
    """Polynomials on the panels of a grid of unit squares.

    Attributes:
        cell: Panel of each cell, :data:`NOWHERE` for none, CELLS to a unit of x and of y.
        centre: Middle of each panel, shape (p, 2).
        half: Half its width, shape (p, 2).
        powers: Coefficients of ``t_x^i t_y^j``, ``t`` in [-1, 1], shape (p, NODES, NODES).
    """

    cell: NDArray[np.int32]
    centre: FloatArray
    half: FloatArray
    powers: FloatArray

    def locate(self, x: FloatArray, y: FloatArray) -> IndexArray:
        """The panel of every point, shape (n,); points are inside the grid."""
        rows, columns = self.cell.shape
        i = np.minimum((x * CELLS).astype(np.intp), rows - 1)
        j = np.minimum((y * CELLS).astype(np.intp), columns - 1)
        panel: IndexArray = self.cell[i, j].astype(np.intp)
        return panel

    def value(self, panel: IndexArray, x: FloatArray, y: FloatArray) -> FloatArray:
        """The polynomial of a panel at a point of it, shape (n,); no element sees another."""
        middle, half = self.centre.T, self.half.T
        s = (x - middle[0].take(panel)) / half[0].take(panel)
        t = (y - middle[1].take(panel)) / half[1].take(panel)
        # Points along the last axis, over which numpy is fast.
        powers = self.powers.transpose(1, 2, 0).take(panel, axis=2)
        return horner(horner(powers, s), t)

    def value_of_number(self, x: float, y: float) -> float | None:
        """The function at one point inside the grid, as of arrays; ``None`` off the panels."""
        rows, columns = self.cell.shape
        i, j = min(int(x * CELLS), rows - 1), min(int(y * CELLS), columns - 1)
        panel = int(self.cell[i, j])
        if panel == NOWHERE:
            return None
        (x0, y0), (width, height) = self.centre[panel].tolist(), self.half[panel].tolist()
        s, t = (x - x0) / width, (y - y0) / height
        *rest, last = self.powers[panel].tolist()
        for row in reversed(rest):
            last = [value * s + power for value, power in zip(last, row, strict=True)]
        return float(horner(last, t))


@dataclass(frozen=True, slots=True)
class Pieces:
    """Polynomials of one variable on the parts of unit intervals, halved where needed.

    Attributes:
        cell: Polynomial of each cell, :data:`NOWHERE` for none, FINE to a unit.
        centre: Middle of each part, shape (p,).
        half: Half its width, shape (p,).
        powers: Coefficients of ``t^j``, ``t`` in [-1, 1], shape (NODES, p).
    """

    cell: NDArray[np.int32]
    centre: FloatArray
    half: FloatArray
    powers: FloatArray

    def value(self, part: IndexArray, y: FloatArray) -> FloatArray:
        """The polynomial of a part at a point of it, shape (n,); no element sees another."""
        t = (y - self.centre.take(part)) / self.half.take(part)
        return horner(self.powers.take(part, axis=1), t)

    def value_of_number(self, y: float) -> float | None:
        """:meth:`value` of one number >= 0; ``None`` where there is no polynomial yet."""
        part = int(self.cell[min(int(y * FINE), self.cell.size - 1)])
        if part == NOWHERE:
            return None
        t = (y - float(self.centre[part])) / float(self.half[part])
        return float(horner(self.powers[:, part].tolist(), t))

    def with_unit(
        self,
        unit: int,
        function: Callable[[FloatArray], FloatArray],
        tolerance: float,
        sizes: tuple[int, int] = (FINE // 2, 1),
    ) -> Pieces:
        """These and the interval [unit, unit + 1].

        Args:
            unit: Its begin, within the cells.
            function: Values >= 0, from ``y``, called with all nodes of one level of halving at
                once; where it jumps to 0 or ``inf`` the larger value counts.
            tolerance: Of the last coefficients, relative to the first.
            sizes: Cells of the first parts and of the least, powers of two.
        """
        cell, parts = self.cell.copy(), []
        count, size = self.centre.size, sizes[0]
        corners = FINE * unit + size * np.arange(FINE // size)
        while corners.size:
            centre = (corners + 0.5 * size) / FINE
            values = function((centre[:, None] + 0.5 * size / FINE * _POINTS).ravel())
            powers, good = _fitted(values.reshape(-1, NODES), tolerance, last=size == sizes[1])
            for corner in corners[good]:
                cell[corner : corner + size] = count
                count += 1
            parts.append((centre[good], np.full(good.sum(), 0.5 * size / FINE), powers[good]))
            size //= 2
            corners = (corners[~good, None] + size * np.arange(2)).ravel()
        centre, half, powers = (np.concatenate(column) for column in zip(*parts, strict=True))
        return Pieces(
            cell,
            np.concatenate([self.centre, centre]),
            np.concatenate([self.half, half]),
            np.concatenate([self.powers, powers.T], axis=1),
        )


def no_pieces(units: int) -> Pieces:
    """No polynomials yet, on [0, units]."""
    cell = np.full(units * FINE, NOWHERE, dtype=np.int32)
    return Pieces(cell, np.zeros(0), np.zeros(0), np.zeros((NODES, 0)))


def _fitted(values: FloatArray, tolerance: float, last: bool) -> tuple[FloatArray, BoolArray]:
    """Coefficients of powers for values at the nodes, and whether they are good enough."""
    finite: BoolArray = np.asarray(np.isfinite(values).all(axis=1))
    coefficients = np.where(finite[:, None], values, 0.0) @ _TO_CHEBYSHEV.T
    size = np.abs(coefficients)
    good: BoolArray = finite & (size[:, -2:].sum(axis=1) <= tolerance * size[:, 0])
    powers: FloatArray = coefficients @ _TO_POWERS.T
    # A line, or the largest value where there is a jump.
    top, least = values.max(axis=1), values.min(axis=1)
    even: BoolArray = np.asarray(top == least)
    whole = finite & (least > 0.0)
    ends = np.where(whole[:, None], values[:, [0, -1]], 0.0)
    rise = 0.5 * (ends[:, 1] - ends[:, 0]) / _POINTS[-1]
    rough = even | (~good & last)
    powers[rough] = 0.0
    powers[rough, 0] = np.where(whole, ends[:, 0] + rise * _POINTS[-1], top)[rough]
    powers[rough, 1] = np.where(whole & ~even, rise, 0.0)[rough]
    return powers, good | rough


def horner(powers: Any, t: Any) -> Any:
    """``sum_j powers[j] t^j``; powers of shape (k, ...), ``t`` broadcasting with ``powers[0]``."""
    result = powers[-1]
    for row in powers[-2::-1]:
        result = result * t + row
    return result


def build(
    function: Function, units: tuple[int, int], tolerance: float, budget: int
) -> PiecewiseChebyshev2D:
    """Approximate a function of two variables on a grid of unit squares.

    Args:
        function: Called with all the nodes of one level of halving at once.
        units: Extent of the grid in x and y, from 0.
        tolerance: Of the last coefficients, absolute.
        budget: Values of the function after which nothing is halved any more.
    """
    cell = np.full((units[0] * CELLS, units[1] * CELLS), NOWHERE, dtype=np.int32)
    corner = CELLS * np.array(list(np.ndindex(units)), dtype=np.intp)
    size = np.full(corner.shape, CELLS)
    found: list[tuple[FloatArray, FloatArray, FloatArray]] = []
    count = 0
    while corner.size and (budget := budget - NODES * NODES * corner.shape[0]) >= 0:
        centre, half = (corner + 0.5 * size) / CELLS, 0.5 * size / CELLS
        coefficients = _coefficients(function, centre, half)
        rough = _rough(coefficients, tolerance)
        good = ~rough.any(axis=1)
        for (i, j), (m, n) in zip(corner[good], size[good], strict=True):
            cell[i : i + m, j : j + n] = count
            count += 1
        found.append((centre[good], half[good], _powers(coefficients[good])))
        corner, size = _halved(corner[~good], size[~good], rough[~good])
    return PiecewiseChebyshev2D(
        cell, *(np.concatenate(column) for column in zip(*found, strict=True))
    )


def _powers(coefficients: FloatArray) -> FloatArray:
    """Chebyshev coefficients as those of powers."""
    result: FloatArray = _TO_POWERS @ coefficients @ _TO_POWERS.T
    return result


def _coefficients(function: Function, centre: FloatArray, half: FloatArray) -> FloatArray:
    """Chebyshev coefficients on every panel, shape (p, NODES, NODES)."""
    x = centre[:, 0, None] + half[:, 0, None] * _POINTS
    y = centre[:, 1, None] + half[:, 1, None] * _POINTS
    shape = (centre.shape[0], NODES, NODES)
    nodes = (np.broadcast_to(x[:, :, None], shape), np.broadcast_to(y[:, None, :], shape))
    values = function(nodes[0].ravel(), nodes[1].ravel()).reshape(shape)
    result: FloatArray = _TO_CHEBYSHEV @ values @ _TO_CHEBYSHEV.T
    return result


def _rough(coefficients: FloatArray, tolerance: float) -> BoolArray:
    """Whether the function is not yet resolved along x and along y, shape (p, 2)."""
    size = np.abs(coefficients)
    tails = np.stack([size[:, -2:, :].sum(axis=(1, 2)), size[:, :, -2:].sum(axis=(1, 2))], axis=1)
    rough: BoolArray = ~(tails <= tolerance)
    return rough


def _halved(
    corner: IndexArray, size: IndexArray, rough: BoolArray
) -> tuple[IndexArray, IndexArray]:
    """The panels halved along the directions that need it; those that cannot be are dropped."""
    cut = rough & (size > 1)
    possible = cut.any(axis=1)
    corner, size, cut = corner[possible], size[possible], cut[possible]
    for axis in (0, 1):
        twice = cut[:, axis]
        size = size.copy()
        size[twice, axis] //= 2
        second = corner[twice].copy()
        second[:, axis] += size[twice, axis]
        corner = np.concatenate([corner, second])
        size = np.concatenate([size, size[twice]])
        cut = np.concatenate([cut, cut[twice]])
    return corner, size
