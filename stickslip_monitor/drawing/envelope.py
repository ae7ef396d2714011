# SPDX-License-Identifier: Apache-2.0
"""Thinning of long recordings by their envelope: fewer points, and no excursion lost."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Indices = NDArray[np.intp]


def envelope(most: int, *columns: Any) -> Indices:
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


def _extremes(column: FloatArray, length: int) -> list[Indices]:
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
