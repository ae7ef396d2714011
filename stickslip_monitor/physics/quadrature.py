# SPDX-License-Identifier: Apache-2.0
"""Averages of a friction law over one harmonic cycle, for any law, split where it is not smooth.

The relative speed of the cycle is ``v(t) = V - a cos t``. Between two neighbouring breakpoints of
the law the integrand is analytic in ``t``, so a fixed Gauss-Legendre rule converges spectrally
there; across a breakpoint it would not. Sums run term by term, so the value of one element never
depends on what else is in the array.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from stickslip_monitor.arrays import FloatArray, IndexArray
from stickslip_monitor.physics.friction import FrictionLaw, Tabulated, computes_as


def gauss_rule(order: int) -> tuple[FloatArray, FloatArray]:
    """Gauss-Legendre nodes and weights on [0, 1]."""
    nodes, weights = np.polynomial.legendre.leggauss(order)
    return 0.5 + 0.5 * nodes, 0.5 * weights


_BLOCK = 8192
# Between two points of a measured table a stretch of so few radians needs so few nodes.
_TABLE_RULES = ((0.02, gauss_rule(3)), (0.3, gauss_rule(6)), (np.inf, gauss_rule(16)))
# Stretches for which memory is taken at a time.
_STRETCHES = 400_000

# Averages of functions of the relative speed, of cos t and of the element, on one set of nodes.
Integrand = Callable[[FloatArray, FloatArray, NDArray[np.intp]], tuple[FloatArray, ...]]


def crossing_angle(speed: FloatArray, amplitude: FloatArray, level: FloatArray | float) -> FloatArray:
    """Phase ``t`` in [0, pi] at which ``V - a cos t`` passes a level; clipped to the ends.

    The half-angle form keeps full precision at grazing, where ``arccos`` loses half its digits.

    Args:
        speed: ``V`` >= 0 [m/s].
        amplitude: Velocity amplitude ``a`` > 0 [m/s], shape of ``speed``.
        level: Relative speeds to look for [m/s]; broadcasts with ``speed``.
    """
    rise = np.clip((((amplitude - speed) + level) / amplitude) * 0.5, 0.0, 1.0)
    angle: FloatArray = 2.0 * np.arcsin(np.sqrt(rise))
    return angle


@lru_cache(maxsize=64)
def _levels(law: FrictionLaw) -> FloatArray:
    """Relative speeds at which the friction of a cycle is not smooth, ascending."""
    breaks = law.breakpoints
    return np.array([*(-b for b in reversed(breaks)), 0.0, *breaks])


def _panels(
    law: FrictionLaw, speed: FloatArray, amplitude: FloatArray
) -> tuple[FloatArray, FloatArray, IndexArray]:
    """Smooth stretches of the half cycles that have any width: start, width and element.

    In the order of elements, and of t within one; each of shape (stretches,).
    """
    levels = _levels(law)
    first = np.searchsorted(levels, speed - amplitude, side='right')
    inside = np.maximum(np.searchsorted(levels, speed + amplitude, side='left') - first, 0)
    stretches = inside + 1
    end = np.cumsum(stretches)
    element = np.repeat(np.arange(speed.size), stretches)
    # The number of each stretch in its half cycle, which ends where the next level is passed.
    number = np.arange(element.size) - (end - stretches)[element]
    last = number == inside[element]
    edge = np.full(element.size, np.pi)
    passing = element[~last]
    level = levels[first[passing] + number[~last]]
    edge[~last] = crossing_angle(speed[passing], amplitude[passing], level)
    start = np.where(number == 0, 0.0, np.roll(edge, 1))
    width = edge - start
    used = np.flatnonzero(width)
    return start[used], width[used], element[used]


def _cycle_integrals(
    law: FrictionLaw, speed: FloatArray, amplitude: FloatArray, integrand: Integrand
) -> list[FloatArray]:
    """Averages over half a cycle of functions of relative speed, ``cos t`` and element."""
    most = max(1, _STRETCHES // _levels(law).size)
    parts = [
        _integrals(law, speed, amplitude, integrand, slice(first, first + most))
        for first in range(0, max(speed.size, 1), most)
    ]
    return [np.concatenate(sums) for sums in zip(*parts, strict=True)]


def _integrals(
    law: FrictionLaw, speed: FloatArray, amplitude: FloatArray, integrand: Integrand, part: slice
) -> list[FloatArray]:
    """:func:`_cycle_integrals` of some elements."""
    begin, extent, element = _panels(law, speed[part], amplitude[part])
    # Between its points a table is a cubic, where another law may fall by orders of magnitude.
    rules = _TABLE_RULES if computes_as(law, Tabulated) else _TABLE_RULES[-1:]
    which = np.searchsorted([widest for widest, _ in rules], extent, side='right')
    nothing = np.zeros((0, 1))
    count = len(integrand(nothing, nothing, np.zeros(0, dtype=np.intp)))
    sums = [np.zeros(element.size) for _ in range(count)]
    for rule, (_, (nodes, weights)) in enumerate(rules):
        where = np.flatnonzero(which == rule)
        for first in range(0, where.size, _BLOCK):
            block = where[first : first + _BLOCK]
            index = element[block] + (part.start or 0)
            sine = np.sin(0.5 * (begin[block, None] + nodes * extent[block, None]))
            drop = 2.0 * sine * sine
            # V - a cos t without its cancellation: at grazing the sign of v decides the sum.
            relative = (speed - amplitude)[index, None] + amplitude[index, None] * drop
            values = integrand(relative, 1.0 - drop, index)
            for total, value in zip(sums, values, strict=True):
                total[block] = np.add.reduce(value * weights, axis=1)
    # Stretch by stretch in the order of t, so that no element sees another.
    size = speed[part].size
    return [np.bincount(element, total * extent, size) / np.pi for total in sums]


def friction_harmonic(law: FrictionLaw, speed: FloatArray, amplitude: FloatArray) -> FloatArray:
    """``S(a; V) = (1/pi) integral_0^pi mu(V - a cos t) cos t dt`` by split quadrature.

    Args:
        law: Any friction law.
        speed: ``V`` >= 0 [m/s].
        amplitude: Velocity amplitude ``a`` > 0 [m/s], shape of ``speed``.

    Returns:
        ``S`` [-], shape of ``speed``.
    """
    shape, speed, amplitude = speed.shape, speed.ravel(), amplitude.ravel()
    level = law.coefficient(speed)

    def varying(v: FloatArray, cosine: FloatArray, element: NDArray[np.intp]) -> tuple[FloatArray]:
        return (_varying(law, v, level[element]) * cosine,)

    (integral,) = _cycle_integrals(law, speed, amplitude, varying)
    return (integral - _constant(level, speed, amplitude)).reshape(shape)


def _varying(law: FrictionLaw, v: FloatArray, level: FloatArray) -> FloatArray:
    """Friction less its constant part, that of steady sliding.

    Taken out, that leaves no rounding noise that would pass for cycles where friction is flat.
    """
    own = level[:, None]
    return law.coefficient(v) - np.where(v < 0.0, -own, own)


def _constant(level: FloatArray, speed: FloatArray, amplitude: FloatArray) -> FloatArray:
    """The average of the constant part, which has a closed form; negative."""
    reach = np.maximum(amplitude, speed)
    sine = np.sqrt(((reach - speed) / reach) * (1.0 + speed / reach))
    return (2.0 / np.pi) * level * sine


def friction_harmonic_and_slope(
    law: FrictionLaw, speed: FloatArray, amplitude: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """``S`` [-] and ``dS/da`` [s/m], the latter by differentiation under the integral.

    The reversal of friction at the sliding limit adds
    ``-(2 mu_s/pi) (V^2/a^3) / sqrt(1 - V^2/a^2)`` for ``a > V``: ``-inf`` at ``a = V+``. Arguments
    as of :func:`friction_harmonic`.
    """
    shape, speed, amplitude = speed.shape, speed.ravel(), amplitude.ravel()
    level = law.coefficient(speed)

    def both(v: FloatArray, cosine: FloatArray, element: NDArray[np.intp]) -> tuple[FloatArray, FloatArray]:
        varying = _varying(law, v, level[element])
        return varying * cosine, law.slope(v) * cosine * cosine

    integral, fall = _cycle_integrals(law, speed, amplitude, both)
    reversing = amplitude > speed
    ratio = np.where(reversing, speed / amplitude, 0.0)
    root = np.sqrt(np.where(reversing, (amplitude - speed) / amplitude, 1.0) * (1.0 + ratio))
    jump = (2.0 * law.static / np.pi) * ratio * ratio / (amplitude * root)
    average = integral - _constant(level, speed, amplitude)
    return average.reshape(shape), (-fall - np.where(reversing, jump, 0.0)).reshape(shape)
