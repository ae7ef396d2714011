# SPDX-License-Identifier: Apache-2.0
"""A friction law as polynomials in pieces, with the power series of its coefficient along a motion.

A measured table is such a law as it stands; any other is fitted (:func:`.scalar_law.fit_pieces`). Plain
functions of numbers, which run as they stand and compiled alike.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import MutableSequence
from typing import Any, NamedTuple

from stickslip_monitor.physics.series import LAW, RELATIVE_SPEED, STRIDE


class Pieces(NamedTuple):
    """Polynomials in ``(v - base) / width``, one from each begin on; the last is level or a line.

    Attributes:
        begin: Rising speeds, the first 0, shape (n,) [m/s].
        base: Speed at which each polynomial's variable is 0, shape (n,) [m/s].
        width: Change of speed by which it grows by 1, shape (n,) [m/s].
        degree: Degree of all polynomials: 3, 7 or 11.
        top: The coefficient of slow sliding [-].
        powers: Coefficients of all, constant first, piece by piece, shape (n * (degree + 1),) [-].
    """

    begin: Any
    base: Any
    width: Any
    degree: int
    top: float
    powers: Any


def _piece_coefficient(law: Pieces, speed: float) -> float:
    """Return ``mu`` at a speed [m/s]; below 0 the first piece goes on as its tangent at 0."""
    i = max(bisect_right(law.begin, speed) - 1, 0)
    t, at, value = (max(speed, 0.0) - law.base[i]) / law.width[i], i * (law.degree + 1), 0.0
    for k in range(law.degree, -1, -1):
        value = value * t + law.powers[at + k]
    return value if speed >= 0.0 else value + speed * friction_slope(law, 0.0)


def friction_drop(law: Pieces, origin: float, step: float) -> float:
    """Return ``mu(v) - mu(v + step)`` of sliding ahead [-]; below ``v`` = 0 the law goes on as its tangent.

    Args:
        law: Its pieces.
        origin: ``v`` >= 0 [m/s].
        step: Any change of speed [m/s].
    """
    top = law.top if origin == 0.0 else _piece_coefficient(law, origin)
    return top - _piece_coefficient(law, origin + step)


def friction_slope(law: Pieces, speed: float) -> float:
    """Return ``d mu / d|v|`` at a relative speed [m/s], in s/m; from the right at ``v`` = 0."""
    v = abs(speed)
    i = max(bisect_right(law.begin, v) - 1, 0)
    t, at, value = (v - law.base[i]) / law.width[i], i * (law.degree + 1), 0.0
    for k in range(law.degree, 0, -1):
        value = value * t + k * law.powers[at + k]
    return value / law.width[i]


def begin_series(
    law: Pieces, origin: float, slip: float, unit: float, work: MutableSequence[float]
) -> tuple[float, float, float]:
    """Begin the law's series in the row of work: its powers about a speed, in units of speed.

    Args:
        law: Its pieces.
        origin: Sliding speed from which the relative speed counts [m/s].
        slip: Relative speed at which the series begins, in units of speed.
        unit: The unit of the relative speed [m/s].
        work: Written: the law's first row.

    Returns:
        The least and the greatest sliding speed of the piece [m/s], ``-inf`` and ``inf`` for no bound; and
        the :func:`friction_drop` from the origin to where the series begins [-].
    """
    degree, speed = law.degree, origin + unit * slip
    i = max(bisect_right(law.begin, speed) - 1, 0)
    t, at, share = (speed - law.base[i]) / law.width[i], i * (degree + 1), unit / law.width[i]
    for k in range(degree + 1):
        work[LAW + k] = law.powers[at + k]
    power = 1.0
    for first in range(degree):  # Horner's scheme, again and again
        for k in range(degree - 1, first - 1, -1):
            work[LAW + k] += t * work[LAW + k + 1]
        work[LAW + first] *= power
        power *= share
    work[LAW + degree] *= power
    high = law.begin[i + 1] if i + 1 < len(law.begin) else math.inf
    # Below rest the first piece holds for no further than above: orbits end there, a step may not.
    low = law.begin[i] if i > 0 else -high
    top = law.top if origin == 0.0 else _piece_coefficient(law, origin)
    return low, high, top - work[LAW]


def extend_series(law: Pieces, k: int, work: MutableSequence[float]) -> float:
    """Return the coefficient of a power of the time in the series of ``mu`` [-].

    Four powers of the speed at a time, and the fourth power times the sum of those above them (M. S. Paterson
    and L. J. Stockmeyer, SIAM J. Comput. 2, 1973): of degree 11 it takes half the products of a series for
    each power.

    Args:
        law: Its pieces.
        k: The power, > 0; called after :func:`begin_series`, for 1, 2, 3 ... in turn.
        work: The row of work with the relative speed up to that power; written: powers of it, and sums.
    """
    slip, square, cube, fourth = RELATIVE_SPEED, LAW + STRIDE, LAW + 2 * STRIDE, LAW + 3 * STRIDE
    half, two, three, four = (k + 1) // 2, 0.0, 0.0, 0.0
    for j in range(1, half):
        two += work[slip + j] * work[slip + k - j]
    for j in range(2, k):
        three += work[square + j] * work[slip + k - j]
    two += two
    if k % 2 == 0:
        two += work[slip + k // 2] * work[slip + k // 2]
    work[square + k], work[cube + k] = two, three
    at, row = LAW + law.degree - 3, fourth
    total = work[at + 1] * work[slip + k] + work[at + 2] * two + work[at + 3] * three
    if at > LAW and k > 3:
        for j in range(2, half):
            four += work[square + j] * work[square + k - j]
        four += four
        if k % 2 == 0:
            four += work[square + k // 2] * work[square + k // 2]
        work[fourth + k] = four
    while at > LAW:
        row += STRIDE
        work[row + k], total, at = total, four * work[at], at - 4
        for j in range(4, k):
            total += work[fourth + j] * work[row + k - j]
        total += work[at + 1] * work[slip + k] + work[at + 2] * two + work[at + 3] * three
    return total
