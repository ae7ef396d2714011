# SPDX-License-Identifier: Apache-2.0
"""Probabilities and boundaries looked up in the flat table of a belief.

Plain functions of numbers, which run as they stand for single points and compiled in long loops.
A table has, one after the other: ``ln beta`` and ``ln N0`` in the middle, ``nu/c``, the first
``d``, rows a unit of it, rows, columns; ``D(v)`` over ``ln v`` and its slopes a step; then for the
fold and for the Hopf speed the spread of each row, and the rows of probits.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

FOLD, HOPF = 0, 1
"""The two boundaries, as the look-ups number them."""
WIDEST = 8.2
"""The columns of probits reach so many spreads to either side."""
CURVE_FIRST, CURVE_LAST, CURVE_SIZE = -14.0, 9.0, 1025
"""First and last ``ln v`` of the curve of ``D``, and its points."""
CURVE_STEP = (CURVE_LAST - CURVE_FIRST) / (CURVE_SIZE - 1)

_LOG_BETA, _LOG_LOAD, _VISCOUS, _FIRST_D, _PER_ROW, _ROWS, _COLUMNS, HEAD = range(8)
_SLOPES, _TABLES = HEAD + CURVE_SIZE, HEAD + 2 * CURVE_SIZE


def probit(table: Sequence[float], which: int, log_speed: float, log_load: float) -> float:
    """``z`` with ``P = Phi(z)``: whether a boundary lies above a speed.

    Args:
        table: :attr:`Belief.table`, or the same as a list.
        which: :data:`FOLD` or :data:`HOPF`.
        log_speed: Logarithm of the surface speed [ln m/s].
        log_load: Logarithm of the load [ln N].
    """
    log_v = log_speed + table[_LOG_BETA]
    value = math.exp(min(log_v, 50.0)) if which else decline_at(table, log_v)
    d = log_load - math.log1p(table[_VISCOUS] * math.exp(log_load)) - table[_LOG_LOAD]
    columns = int(table[_COLUMNS])
    row, share, spread, first = _row(table, which, d)
    along = ((value - d) / spread + WIDEST) * (columns - 1.0) / (2.0 * WIDEST)
    along = min(max(along, 0.0), columns - 1.000001)
    column = int(along)
    at = first + row * columns + column
    part = along - column
    low = table[at] + (table[at + 1] - table[at]) * part
    at += columns
    high = table[at] + (table[at + 1] - table[at]) * part
    return low + (high - low) * share


def _row(table: Sequence[float], which: int, d: float) -> tuple[int, float, float, int]:
    """Row at ``d``, share of the next one, spread there, and where the probits begin."""
    rows = int(table[_ROWS])
    first = _TABLES + which * rows * (int(table[_COLUMNS]) + 1)
    place = max((d - table[_FIRST_D]) * table[_PER_ROW], 0.0)
    row = min(int(place), rows - 2)
    share = place - row
    # Beyond the last row the spread rises on; the probits at so many spreads hardly change.
    spread = table[first + row] + (table[first + row + 1] - table[first + row]) * share
    return row, min(share, 1.0), spread, first + rows


def decline_at(table: Sequence[float], log_v: float) -> float:
    """``D(v)`` at ``ln v``, to 1e-10; ``table`` may end with the curve."""
    place = (log_v - CURVE_FIRST) / CURVE_STEP
    if place < 0.0:
        return math.exp(log_v)
    if place >= CURVE_SIZE - 1:  # I1e(v) tends to (2 pi v)^(-1/2)
        return table[_SLOPES - 1] + 1.5 * (log_v - CURVE_LAST)
    cell = int(place)
    return _cubic(table, HEAD + cell, place - cell)


def _cubic(table: Sequence[float], at: int, share: float) -> float:
    low, rise = table[at], table[at + 1] - table[at]
    begin, end = table[at + CURVE_SIZE], table[at + CURVE_SIZE + 1]
    bend = share * (3.0 * rise - 2.0 * begin - end + share * (begin + end - 2.0 * rise))
    return low + share * (begin + bend)


def _log_speed_of(table: Sequence[float], value: float) -> float:
    """``ln v`` at which :func:`decline_at` has a value > 0."""
    if value >= table[_SLOPES - 1]:
        return CURVE_LAST + (value - table[_SLOPES - 1]) / 1.5
    if value <= table[HEAD]:
        return math.log(value)
    low, high = HEAD, _SLOPES - 1
    while high - low > 1:
        middle = (low + high) // 2
        if table[middle] <= value:
            low = middle
        else:
            high = middle
    # The curve is so straight within a cell that secants from its ends settle at once.
    share = 0.0
    for _ in range(6):
        share += (value - _cubic(table, low, share)) / (table[low + 1] - table[low])
    return CURVE_FIRST + (low - HEAD + share) * CURVE_STEP


def boundary_speed(table: Sequence[float], which: int, load: float, z: float) -> float:
    """The speed of a boundary that a share ``Phi(z)`` of the belief lies below [m/s].

    Args:
        table: :attr:`Belief.table`, or the same as a list.
        which: :data:`FOLD` or :data:`HOPF`.
        load: The load [N].
        z: Probit of the share.

    Returns:
        0 where that share has no such boundary.
    """
    if not load > 0.0:
        return 0.0
    d = math.log(load) - math.log1p(table[_VISCOUS] * load) - table[_LOG_LOAD]
    columns = int(table[_COLUMNS])
    row, share, spread, first = _row(table, which, d)
    at = first + row * columns
    low, high = 0, columns - 1
    while high - low > 1:
        middle = (low + high) // 2
        if _between_rows(table, at + middle, columns, share) > -z:
            low = middle
        else:
            high = middle
    left = _between_rows(table, at + low, columns, share)
    fall = left - _between_rows(table, at + high, columns, share)
    column = low + (min(max((left + z) / fall, 0.0), 1.0) if fall > 0.0 else 0.5)
    value = d + spread * (column * 2.0 * WIDEST / (columns - 1.0) - WIDEST)
    if not value > 0.0:
        return 0.0
    v = value if which else math.exp(min(_log_speed_of(table, value), 700.0))
    return v / math.exp(table[_LOG_BETA])


def _between_rows(table: Sequence[float], at: int, columns: int, share: float) -> float:
    return table[at] + (table[at + columns] - table[at]) * share


def chances(
    table: Sequence[float], speed: float, load: float, share: float
) -> tuple[float, float]:
    """The probabilities that stick-slip can happen, and that it starts by itself.

    Args:
        table: :attr:`Belief.table`, or the same as a list.
        speed: Magnitude of the surface speed [m/s].
        load: Load [N].
        share: Of the averaged fold in the one that counts, at most 1.

    Returns:
        Both ``nan`` at rest or where an input is not finite; 0 without a load.
    """
    if not (0.0 < speed < math.inf and math.isfinite(load)):
        return math.nan, math.nan
    if load <= 0.0:
        return 0.0, 0.0
    log_speed, log_load = math.log(speed), math.log(load)
    can = _normal(probit(table, FOLD, log_speed + math.log(share), log_load))
    return can, min(_normal(probit(table, HOPF, log_speed, log_load)), can)


def _normal(z: float) -> float:
    return 0.5 * math.erfc(-z * math.sqrt(0.5))


def runs_after(before: float, can: float, will: float) -> float:
    """The probability that stick-slip runs, by thresholds with the memory of the bistable range.

    Whoever starts at a probability ``will`` and ends at ``can`` runs with
    ``min(max(before, will), can)`` afterwards, if the points of the belief pass their boundaries
    in one order. ``nan`` changes nothing.
    """
    after = before if math.isnan(will) else max(before, will)
    return after if math.isnan(can) else min(after, can)


def fill_chances(table: Any, points: Any, out: Any) -> None:
    """:func:`chances` of rows of speed, load and share, shape (n, 3); ``out`` is (n, 2)."""
    for k in range(points.shape[0]):
        out[k, 0], out[k, 1] = chances(table, points[k, 0], points[k, 1], points[k, 2])


def fill_speeds(table: Any, which: int, load: Any, z: float, out: Any) -> None:
    """:func:`boundary_speed` of loads, shape (n,)."""
    for k in range(load.shape[0]):
        out[k] = boundary_speed(table, which, load[k], z)


def fill_runs(can: Any, will: Any, before: float, out: Any) -> None:
    """:func:`runs_after` of points in order of time, shape (n,)."""
    for k in range(can.shape[0]):
        before = runs_after(before, can[k], will[k])
        out[k] = before
