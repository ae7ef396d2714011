# SPDX-License-Identifier: Apache-2.0
"""Averages of a friction law over one harmonic cycle, for any law, split where it is not smooth.

The relative speed of the cycle is ``v(t) = V - a cos t``. Between two neighbouring breakpoints of
the law the integrand is analytic in ``t``, so a fixed Gauss-Legendre rule converges spectrally
there; across a breakpoint it would not. Sums run term by term, so the value of one element never
depends on what else is in the array.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from stickslip_monitor.physics.friction import Array, FrictionLaw


def unit_gauss(order: int) -> list[tuple[float, float]]:
    """Gauss-Legendre nodes and weights on [0, 1] as ``(node, weight)`` pairs."""
    nodes, weights = np.polynomial.legendre.leggauss(order)
    return [(0.5 + 0.5 * float(x), 0.5 * float(w)) for x, w in zip(nodes, weights, strict=True)]


_BLOCK = 8192
_NODES, _WEIGHTS = (np.array(column)[:, None] for column in zip(*unit_gauss(16), strict=True))


def crossing_angle(speed: Array, amplitude: Array, level: Array | float) -> Array:
    """Phase ``t`` in [0, pi] at which ``V - a cos t`` passes a level; clipped to the ends.

    The half-angle form keeps full precision at grazing, where ``arccos`` loses half its digits.

    Args:
        speed: ``V`` >= 0 [m/s].
        amplitude: Velocity amplitude ``a`` > 0 [m/s], shape of ``speed``.
        level: Relative speeds to look for [m/s]; broadcasts with ``speed``.
    """
    rise = np.clip((((amplitude - speed) + level) / amplitude) * 0.5, 0.0, 1.0)
    angle: Array = 2.0 * np.arcsin(np.sqrt(rise))
    return angle


def _panels(law: FrictionLaw, speed: Array, amplitude: Array) -> tuple[Array, Array]:
    """Start and width of each smooth stretch of the half cycle, both of shape (panels, n)."""
    breaks = law.breakpoints
    levels = np.array([*(-b for b in reversed(breaks)), 0.0, *breaks])
    crossings = crossing_angle(speed, amplitude, levels[:, None])
    ends = np.zeros((1, speed.size))
    edges = np.concatenate([ends, crossings, ends + np.pi])
    return edges[:-1], np.diff(edges, axis=0)


def _cycle_integral(
    law: FrictionLaw,
    speed: Array,
    amplitude: Array,
    integrand: Callable[[Array, Array, NDArray[np.intp]], Array],
) -> Array:
    """Average over half a cycle of a function of relative speed, ``cos t`` and element."""
    shape, speed, amplitude = speed.shape, speed.ravel(), amplitude.ravel()
    start, width = _panels(law, speed, amplitude)
    # Most stretches of a finely tabulated law are outside the speeds of the cycle.
    used = np.nonzero(width)
    begin, extent, element = start[used], width[used], used[1]
    sums = np.empty_like(begin)
    for first in range(0, begin.size, _BLOCK):
        part = slice(first, first + _BLOCK)
        own = element[part]
        sine = np.sin(0.5 * (begin[part] + _NODES * extent[part]))
        drop = 2.0 * sine * sine
        # V - a cos t without its cancellation: at grazing the sign of v decides the sum.
        relative = (speed - amplitude)[own] + amplitude[own] * drop
        sums[part] = _in_order(_WEIGHTS * integrand(relative, 1.0 - drop, own))
    parts = np.zeros_like(start)
    parts[used] = sums * extent
    return _in_order(parts).reshape(shape) / np.pi


def _in_order(rows: Array) -> Array:
    """Sum over the first axis, row by row."""
    total = np.zeros(rows.shape[1])
    for row in rows:
        total += row
    return total


def friction_harmonic(law: FrictionLaw, speed: Array, amplitude: Array) -> Array:
    """``S(a; V) = (1/pi) integral_0^pi mu(V - a cos t) cos t dt`` by split quadrature.

    Args:
        law: Any friction law.
        speed: ``V`` >= 0 [m/s].
        amplitude: Velocity amplitude ``a`` > 0 [m/s], shape of ``speed``.

    Returns:
        ``S`` [-], shape of ``speed``.
    """
    # The constant part of friction has a closed average; taken out, it leaves no rounding noise
    # that would pass for cycles where friction is flat.
    level = law.coefficient(speed)

    def varying(v: Array, cosine: Array, element: NDArray[np.intp]) -> Array:
        own = level.ravel()[element]
        return (law.coefficient(v) - np.where(v < 0.0, -own, own)) * cosine

    reach = np.maximum(amplitude, speed)
    sine = np.sqrt(((reach - speed) / reach) * (1.0 + speed / reach))
    return _cycle_integral(law, speed, amplitude, varying) - (2.0 / np.pi) * level * sine


def friction_harmonic_slope(law: FrictionLaw, speed: Array, amplitude: Array) -> Array:
    """``dS/da`` [s/m] by differentiation under the integral; ``-inf`` at ``a = V+``.

    The reversal of friction at the sliding limit adds
    ``-(2 mu_s/pi) (V^2/a^3) / sqrt(1 - V^2/a^2)`` for ``a > V``.
    """
    smooth = -_cycle_integral(law, speed, amplitude, lambda v, c, _: law.slope(v) * c * c)
    reversing = amplitude > speed
    ratio = np.where(reversing, speed / amplitude, 0.0)
    root = np.sqrt(np.where(reversing, (amplitude - speed) / amplitude, 1.0) * (1.0 + ratio))
    jump = (2.0 * law.static / np.pi) * ratio * ratio / (amplitude * root)
    return smooth - np.where(reversing, jump, 0.0)
