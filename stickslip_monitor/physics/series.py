# SPDX-License-Identifier: Apache-2.0
"""Truncated power series of a motion, all in one row of numbers.

Coefficients are those in a unit of time, so that they stay numbers; each series takes ``STRIDE``
places of the row. Plain functions of numbers, which run as they stand and compiled alike.
"""

from __future__ import annotations

from collections.abc import MutableSequence, Sequence

ORDER = 16
"""Highest power of the time: 12 takes 40 % longer in a noisy table, and 20 no less."""
STRIDE = ORDER + 1
"""Number of coefficients of a series, constant first."""
PLACE, RELATIVE_SPEED, RATE, INVERSE, LAW = (STRIDE * series for series in range(5))
"""Indices in the row of work: of the series of displacement, of relative speed and of its rate, of the
numbers ``1/k``, and of the first of six series of the law."""


def new_work() -> list[float]:
    """Return a new row of work: the numbers ``1/k`` from ``INVERSE`` + 1 on, all else 0."""
    inverse = [0.0, *(1.0 / k for k in range(1, STRIDE))]
    return [0.0] * INVERSE + inverse + [0.0] * (6 * STRIDE)


def place_and_speed(work: Sequence[float], order: int, share: float) -> tuple[float, float]:
    """Return displacement and relative speed at a share of the unit.

    By their series in the row ``work``, up to the power ``order``.
    """
    place, speed = 0.0, 0.0
    for k in range(order, -1, -1):
        place, speed = place * share + work[PLACE + k], speed * share + work[RELATIVE_SPEED + k]
    return place, speed


def value_and_slope(work: Sequence[float], row: int, order: int, share: float) -> tuple[float, float]:
    """Return the value of a series at a share of the unit, and its slope there for each unit.

    Args:
        work: The row of work.
        row: Index of the series in it.
        order: Its highest power.
        share: The share.
    """
    value, slope = work[row + order], 0.0
    for k in range(order - 1, -1, -1):
        slope, value = slope * share + value, value * share + work[row + k]
    return value, slope


def find_turn(
    work: MutableSequence[float], order: int, share: float, rate: float, close: float = 0.0
) -> tuple[float, float]:
    """Return the share of the unit at which the relative speed turns, and the relative speed there.

    Args:
        work: The row of work; written: the rate of the relative speed.
        order: Highest power of the relative speed.
        share: A share of the unit by which it has turned once.
        rate: Its rate there for each unit, of another sign than that at the begin, which is not 0.
        close: Share of that rate which may be left.
    """
    for k in range(order):
        work[RATE + k] = (k + 1.0) * work[RELATIVE_SPEED + k + 1]
    turn = find_level(work, RATE, order - 1, share, rate, 0.0, close * abs(rate))
    return turn, value_and_slope(work, RELATIVE_SPEED, order, turn)[0]


def find_level(
    work: Sequence[float], row: int, order: int, end: float, final: float, level: float, close: float = 0.0
) -> float:
    """Return the share of the unit at which a series passes a level.

    Newton's method, kept between a share before the level and one behind.

    Args:
        work: The row of work.
        row: Index of the series in it.
        order: Its highest power.
        end: Share of the unit by which the level has been passed.
        final: Value of the series there.
        level: The level; a series that begins on it passes it at 0 or later.
        close: Error allowed in the value; 0 for rounding only.

    Returns:
        The share, from 0 to ``end``; ``end`` where the level has not been passed by then.

    >>> round(find_level([1.0, 0.0, -0.25], 0, 2, 3.0, -1.25, 0.0), 12)
    2.0
    """
    first, upward = work[row] - level, final > level
    if (first > 0.0) == upward and first != 0.0:
        return end
    rounding = max(1e-16 * (abs(first) + abs(level)), close)
    before, behind = 0.0, end
    share = end * first / (first + level - final) if first != 0.0 else end  # where the chord passes it
    for _ in range(60):
        value, slope = value_and_slope(work, row, order, share)
        miss = value - level
        if (miss > 0.0) == upward:
            behind = share
        else:
            before = share
        if abs(miss) <= rounding:
            break
        after = share - miss / slope if slope != 0.0 else before
        if not before < after < behind:
            after = 0.5 * (before + behind)
            if after in (before, behind):
                break
        elif abs(after - share) <= 1e-9 * end:  # the next step would be a rounding
            share = after
            break
        share = after
    return share
