# SPDX-License-Identifier: Apache-2.0
"""Any friction law as polynomials in pieces, right to rounding, for the orbits' power series.

A measured table is such a law as it stands. Of any other the coefficient is evaluated in arrays and fitted
between Chebyshev points, and a piece that misses in between is halved until it does not.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import MutableSequence
from typing import Any, NamedTuple

import numpy as np

from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.physics.friction import ALMOST_REST, FrictionLaw, speed_scales
from stickslip_monitor.physics.friction_table import Cubics
from stickslip_monitor.physics.series import LAW, RELATIVE_SPEED, STRIDE

# Degree of a fitted piece. By 7 the boundaries of a rational law take 2.4 times as many steps, and by 12 a
# fourth less, each of which takes longer.
_DEGREE = 10
# Halvings of a piece at most: what a law does between neighbouring numbers is left as it is.
_MAX_HALVINGS = 60


class Pieces(NamedTuple):
    """Polynomials in ``(v - base) / width``, one from each begin on; the last is level or a line.

    Attributes:
        begin: Rising speeds, the first 0, shape (n,) [m/s].
        base: Speed at which each polynomial's variable is 0, shape (n,) [m/s].
        width: Change of speed by which it grows by 1, shape (n,) [m/s].
        degree: Degree of all polynomials.
        top: The coefficient of slow sliding [-].
        powers: Coefficients of all, constant first, piece by piece, shape (n * (degree + 1),) [-].
    """

    begin: Any
    base: Any
    width: Any
    degree: int
    top: float
    powers: Any


def pieces_of_cubics(cubics: Cubics) -> Pieces:
    """Return a table's cubics as pieces."""
    begin = np.asarray(cubics.begin, float)
    powers = np.stack([np.asarray(column, float) for column in cubics[1:]], axis=1)
    return Pieces(
        begin, begin, np.ones(begin.size), 3, float(powers[0, 0]), np.ascontiguousarray(powers).ravel()
    )


def fit_pieces(law: FrictionLaw) -> Pieces:
    """Fit pieces to a law's coefficient, to 1e-14 of the largest of a piece or of slow sliding.

    Where the law's own rounding does not allow that the error may be larger. Beyond 4^20 times its last
    scale, or from where the coefficient is not finite on, the law goes on as a line.

    >>> pieces = fit_pieces(Stribeck(0.3, 0.1, 10.0))
    >>> math.isclose(friction_drop(pieces, 0.0, 0.1), -0.2 * math.expm1(-1.0), rel_tol=1e-14)
    True
    """

    def coefficient(v: FloatArray) -> FloatArray:
        """Return ``mu`` of sliding at speeds >= 0 [m/s], of their shape: that of slow sliding at 0."""
        return np.asarray(law.coefficient(np.maximum(v, ALMOST_REST)), float)

    breaks = np.array(speed_scales(law) or [1.0])
    edges = np.concatenate([[0.0], breaks, breaks[-1] * 4.0 ** np.arange(1, 21)])
    t = np.cos(np.pi * np.arange(_DEGREE, -1, -1) / _DEGREE)
    between = np.cos(np.pi * (np.arange(_DEGREE, 0, -1) - 0.5) / _DEGREE)
    # In two steps, so that rounding stays that of the values: Chebyshev's series first, then its powers.
    to_series = np.polynomial.chebyshev.chebvander(t, _DEGREE) / _DEGREE
    to_series[1:-1] *= 2.0
    to_series[:, [0, -1]] *= 0.5
    to_powers = np.zeros((_DEGREE + 1, _DEGREE + 1))
    for k in range(_DEGREE + 1):
        to_powers[k, : k + 1] = np.polynomial.chebyshev.cheb2poly(np.eye(k + 1)[k])
    check = np.vander(between, _DEGREE + 1, increasing=True).T
    with np.errstate(all='ignore'):
        edges = edges[np.cumsum(~np.isfinite(coefficient(edges))) == 0]
        top, allowed = float(coefficient(edges[:1])[0]), 1e-14
        low, high, fitted = edges[:-1], edges[1:], []
        for turn in range(_MAX_HALVINGS):
            base, width = 0.5 * (low + high), 0.5 * (high - low)
            values = coefficient(base[:, None] + width[:, None] * t)
            powers = (values @ to_series) @ to_powers
            miss = np.abs(powers @ check - coefficient(base[:, None] + width[:, None] * between)).max(axis=1)
            size = np.maximum(np.abs(values).max(axis=1), top)
            fits = (miss <= allowed * size) | (turn == _MAX_HALVINGS - 1)
            fitted.append(np.column_stack([low, base, width, powers])[fits])
            low, high, base = low[~fits], high[~fits], base[~fits]
            if not low.size:
                break
            low, high = np.concatenate([low, base]), np.concatenate([base, high])
            if low.size > 500:  # so many miss by the law's own rounding
                allowed *= 10.0
        last, slope = float(edges[-1]), float(np.asarray(law.slope(edges[-1])))
    line = np.zeros(_DEGREE + 4)
    line[:5] = last, last, 1.0, float(coefficient(edges[-1:])[0]), slope if math.isfinite(slope) else 0.0
    rows = np.concatenate([*fitted, line[None, :]])
    rows = rows[np.argsort(rows[:, 0])]
    begin, base, width = (np.ascontiguousarray(column) for column in rows[:, :3].T)
    powers = np.ascontiguousarray(rows[:, 3:])
    # The first piece's own value, so that a lining released from the belt feels no fall at once.
    return Pieces(begin, base, width, _DEGREE, float(np.polyval(powers[0, ::-1], -1.0)), powers.ravel())


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
    low = law.begin[i] if i > 0 else -math.inf
    high = law.begin[i + 1] if i + 1 < len(law.begin) else math.inf
    top = law.top if origin == 0.0 else _piece_coefficient(law, origin)
    return low, high, top - work[LAW]


def extend_series(law: Pieces, k: int, work: MutableSequence[float]) -> float:
    """Return the coefficient of a power of the time in the series of ``mu`` [-].

    Args:
        law: Its pieces.
        k: The power, > 0; called after :func:`begin_series`, for 1, 2, 3 ... in turn.
        work: The row of work with the relative speed up to that power; written: powers of that.
    """
    value = 0.0
    lower = RELATIVE_SPEED  # series of the change of relative speed, to the power one below
    for power in range(2, min(law.degree, k) + 1):
        total, row = 0.0, LAW + (power - 1) * STRIDE
        for j in range(power - 1, k):
            total += work[lower + j] * work[RELATIVE_SPEED + k - j]
        work[row + k] = total
        value += work[LAW + power] * total
        lower = row
    return value + work[LAW + 1] * work[RELATIVE_SPEED + k]
