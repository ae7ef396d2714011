# SPDX-License-Identifier: Apache-2.0
"""Where a polynomial first becomes positive on [0, 1], with nothing jumped over.

The coefficients of a polynomial in Bernstein's basis enclose it, and it has no more roots than
they have changes of sign (Descartes' rule; Farouki, Computer Aided Geometric Design 29, 2012).
Intervals are halved until that rule decides, so two roots close to each other, as at a grazing
contact, are found however long the step.

These are inner loops: numba may compile them, and without it they work on lists of floats.
"""

from __future__ import annotations

from collections.abc import MutableSequence
from typing import TypeAlias

Vector: TypeAlias = MutableSequence[float]

# Width below which a touch that does not cross is taken for rounding: the square root of it.
_NARROW = 1e-9
_NEWTON = 100
_NONE, _ONE, _AT_ONCE, _UNCLEAR = 0, 1, 2, 3


def first_positive(c: Vector, degree: int, b: Vector) -> float:
    """Smallest ``u`` in [0, 1] behind which ``sum c[i] u^i`` is positive; -1 without one.

    Args:
        c: Coefficients, from the constant one upward.
        degree: Degree of the polynomial, >= 2.
        b: Scratch, at least ``degree + 1`` long.
    """
    if _stays_negative(c, degree):
        return -1.0
    low, width = 0.0, 1.0
    while low < 1.0:
        bernstein(c, degree, low, width, b)
        verdict = _verdict(b, degree)
        narrow = width < _NARROW
        if verdict == _AT_ONCE:
            return low
        if verdict == _ONE or (narrow and b[degree] > 0.0):
            return _root(c, degree, low, low + width)
        if verdict == _UNCLEAR and not narrow:
            width *= 0.5
        else:
            low += width
            width = min(2.0 * width, 1.0 - low)
    return -1.0


def _stays_negative(c: Vector, degree: int) -> bool:
    """Cheap and sufficient: the parabola of the first terms, and all others at their largest."""
    rest = c[0]
    if rest >= 0.0:
        return False
    for i in range(3, degree + 1):
        rest += abs(c[i])
    top = max(0.0, c[1] + c[2])
    if c[2] < 0.0 < c[1] < -2.0 * c[2]:
        top = max(top, -0.25 * c[1] * c[1] / c[2])
    return rest + top < 0.0


def bernstein(c: Vector, degree: int, low: float, width: float, b: Vector) -> None:
    """Write the Bernstein coefficients on [low, low + width] of ``sum c[i] u^i`` to ``b``."""
    for i in range(degree + 1):
        b[i] = c[i]
    if low > 0.0:
        for i in range(degree):
            for j in range(degree - 1, i - 1, -1):
                b[j] += low * b[j + 1]
    binomial, power = 1.0, 1.0
    for i in range(degree + 1):
        b[i] *= power / binomial
        power *= width
        binomial *= (degree - i) / (i + 1.0)
    for i in range(1, degree + 1):
        for j in range(degree, i - 1, -1):
            b[j] += b[j - 1]


def _verdict(b: Vector, degree: int) -> int:
    sign, changes = 0.0, 0
    for i in range(degree + 1):
        if b[i] * sign < 0.0 or (sign == 0.0 and b[i] != 0.0):
            if sign == 0.0 and b[i] > 0.0:
                return _AT_ONCE
            changes += sign != 0.0
            sign = 1.0 if b[i] > 0.0 else -1.0
    if changes == 0:
        return _NONE
    return _ONE if changes == 1 and b[degree] > 0.0 else _UNCLEAR


def _root(c: Vector, degree: int, low: float, high: float) -> float:
    """The root between a point that is not positive and one that is (Newton on a bracket)."""
    u = 0.5 * (low + high)
    for _ in range(_NEWTON):
        value, slope = c[degree], 0.0
        for i in range(degree - 1, -1, -1):
            slope = slope * u + value
            value = value * u + c[i]
        if value > 0.0:
            high = u
        else:
            low = u
        after = u - value / slope if slope > 0.0 else low
        if not low < after < high:
            after = 0.5 * (low + high)
        if abs(after - u) <= 2e-16 * u or high - low <= 2e-16 * high:
            return after
        u = after
    return u
