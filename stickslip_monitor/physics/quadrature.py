# SPDX-License-Identifier: Apache-2.0
"""Averages of a friction law over one harmonic cycle, for any law, split where it is not smooth.

The relative speed of the cycle is ``v(t) = V - a cos t``. Between two neighbouring breakpoints of
the law the integrand is analytic in ``t``, so a fixed Gauss-Legendre rule converges spectrally
there; across a breakpoint it would not. Sums run term by term, so the value of one element never
depends on what else is in the array.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from stickslip_monitor.arrays import FloatArray, IndexArray
from stickslip_monitor.physics.friction import FrictionLaw, speed_scales


def gauss_rule(order: int) -> tuple[FloatArray, FloatArray]:
    """Gauss-Legendre nodes and weights on [0, 1]."""
    nodes, weights = np.polynomial.legendre.leggauss(order)
    return 0.5 + 0.5 * nodes, 0.5 * weights


_BLOCK = 8192
# Between two points of a measured table a stretch of so few radians needs so few nodes.
_TABLE_RULES = ((0.02, gauss_rule(3)), (0.3, gauss_rule(6)), (np.inf, gauss_rule(16)))
# Stretches for which memory is taken at a time.
_STRETCHES = 400_000


def crossing_angle(speed: FloatArray, amplitude: FloatArray, level: FloatArray | float) -> FloatArray:
    """Return the phase ``t`` in [0, pi] at which ``V - a cos t`` passes a level; clipped to the ends.

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
def _break_levels(law: FrictionLaw) -> FloatArray:
    """Relative speeds at which the friction of a cycle is not smooth, ascending."""
    breaks = speed_scales(law)
    return np.array([*(-b for b in reversed(breaks)), 0.0, *breaks])


def _smooth_stretches(
    law: FrictionLaw, speed: FloatArray, amplitude: FloatArray
) -> tuple[FloatArray, FloatArray, IndexArray]:
    """Return the stretches of the half cycles within which the law is smooth.

    Returns:
        Start and width of each [rad] and the element it belongs to, in the order of elements and of ``t``;
        only those with a width; shape (stretches,) each.
    """
    levels = _break_levels(law)
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


def friction_harmonic(law: FrictionLaw, speed: FloatArray, amplitude: FloatArray) -> FloatArray:
    """``S(a; V) = (1/pi) integral_0^pi mu(V - a cos t) cos t dt`` by split quadrature.

    Args:
        law: Any friction law.
        speed: ``V`` >= 0 [m/s].
        amplitude: Velocity amplitude ``a`` > 0 [m/s], shape of ``speed``.

    Returns:
        ``S`` [-], shape of ``speed``.
    """
    v, a = speed.ravel(), amplitude.ravel()
    level = law.coefficient(v)
    block_size = max(1, _STRETCHES // _break_levels(law).size)
    parts = [slice(first, first + block_size) for first in range(0, max(v.size, 1), block_size)]
    varying = np.concatenate([_varying_harmonic(law, v[part], a[part], level[part]) for part in parts])
    # The average of the constant part has a closed form.
    reach = np.maximum(a, v)
    sine = np.sqrt(((reach - v) / reach) * (1.0 + v / reach))
    return np.asarray(varying - (2.0 / np.pi) * level * sine).reshape(speed.shape)


def _varying_harmonic(
    law: FrictionLaw, speed: FloatArray, amplitude: FloatArray, level: FloatArray
) -> FloatArray:
    """Return ``S`` of friction less that of steady sliding, which leaves no rounding noise.

    That noise would pass for cycles where friction is flat.

    Args:
        law: The law.
        speed: ``V`` >= 0, shape (n,) [m/s].
        amplitude: ``a`` > 0, shape (n,) [m/s].
        level: ``mu(V)``, shape (n,).
    """
    begin, extent, element = _smooth_stretches(law, speed, amplitude)
    # Between its points a table is a cubic, where another law may fall by orders of magnitude.
    rules = _TABLE_RULES if len(getattr(law, 'kinks', ())) else _TABLE_RULES[-1:]
    which = np.searchsorted([widest for widest, _ in rules], extent, side='right')
    total = np.zeros(element.size)
    for rule, (_, (nodes, weights)) in enumerate(rules):
        where = np.flatnonzero(which == rule)
        for first in range(0, where.size, _BLOCK):
            block = where[first : first + _BLOCK]
            index = element[block, None]
            sine = np.sin(0.5 * (begin[block, None] + nodes * extent[block, None]))
            drop = 2.0 * sine * sine
            # V - a cos t without its cancellation: at grazing the sign of v decides the sum.
            v = (speed - amplitude)[index] + amplitude[index] * drop
            friction = law.coefficient(v) - np.copysign(level[index], v + 0.0)
            total[block] = np.add.reduce(friction * (1.0 - drop) * weights, axis=1)
    # Stretch by stretch in the order of t, so that no element sees another.
    return np.bincount(element, total * extent, speed.size) / np.pi
