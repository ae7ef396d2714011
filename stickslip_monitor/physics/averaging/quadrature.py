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

from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.physics.friction import FrictionLaw


def unit_gauss(order: int) -> list[tuple[float, float]]:
    """Gauss-Legendre nodes and weights on [0, 1] as ``(node, weight)`` pairs."""
    nodes, weights = np.polynomial.legendre.leggauss(order)
    return [(0.5 + 0.5 * float(x), 0.5 * float(w)) for x, w in zip(nodes, weights, strict=True)]


_BLOCK = 8192
_NODES, _WEIGHTS = (np.array(column) for column in zip(*unit_gauss(16), strict=True))

# Averages of functions of the relative speed, of cos t and of the element, on one set of nodes.
Integrand = Callable[[FloatArray, FloatArray, NDArray[np.intp]], tuple[FloatArray, ...]]


def crossing_angle(
    speed: FloatArray, amplitude: FloatArray, level: FloatArray | float
) -> FloatArray:
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
    """Relative speeds at which the friction of a cycle is not smooth, shape (levels, 1)."""
    breaks = law.breakpoints
    return np.array([*(-b for b in reversed(breaks)), 0.0, *breaks])[:, None]


def _panels(
    law: FrictionLaw, speed: FloatArray, amplitude: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Start and width of each smooth stretch of the half cycle, both of shape (panels, n)."""
    levels = _levels(law)
    edges = np.zeros((levels.size + 2, speed.size))
    edges[1:-1] = crossing_angle(speed, amplitude, levels)
    edges[-1] = np.pi
    return edges[:-1], edges[1:] - edges[:-1]


def _cycle_integrals(
    law: FrictionLaw, speed: FloatArray, amplitude: FloatArray, integrand: Integrand
) -> list[FloatArray]:
    """Averages over half a cycle of functions of relative speed, ``cos t`` and element."""
    start, width = _panels(law, speed, amplitude)
    # Most stretches of a finely tabulated law are outside the speeds of the cycle.
    used = np.nonzero(width)
    begin, extent, element = start[used], width[used], used[1]
    offset = (speed - amplitude)[element]
    reach = amplitude[element]
    blocks = []
    for first in range(0, max(begin.size, 1), _BLOCK):
        part = slice(first, first + _BLOCK)
        sine = np.sin(0.5 * (begin[part, None] + _NODES * extent[part, None]))
        drop = 2.0 * sine * sine
        # V - a cos t without its cancellation: at grazing the sign of v decides the sum.
        relative = offset[part, None] + reach[part, None] * drop
        values = integrand(relative, 1.0 - drop, element[part])
        blocks.append([np.add.reduce(value * _WEIGHTS, axis=1) for value in values])
    # Panel by panel in the order of t, so that no element sees another.
    return [
        np.bincount(element, np.concatenate(sums) * extent, speed.size) / np.pi
        for sums in zip(*blocks, strict=True)
    ]


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

    def both(
        v: FloatArray, cosine: FloatArray, element: NDArray[np.intp]
    ) -> tuple[FloatArray, FloatArray]:
        varying = _varying(law, v, level[element])
        return varying * cosine, law.slope(v) * cosine * cosine

    integral, fall = _cycle_integrals(law, speed, amplitude, both)
    reversing = amplitude > speed
    ratio = np.where(reversing, speed / amplitude, 0.0)
    root = np.sqrt(np.where(reversing, (amplitude - speed) / amplitude, 1.0) * (1.0 + ratio))
    jump = (2.0 * law.static / np.pi) * ratio * ratio / (amplitude * root)
    average = integral - _constant(level, speed, amplitude)
    return average.reshape(shape), (-fall - np.where(reversing, jump, 0.0)).reshape(shape)
