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

from stickslip_monitor.physics.friction import Array, FrictionLaw


def unit_gauss(order: int) -> list[tuple[float, float]]:
    """Gauss-Legendre nodes and weights on [0, 1] as ``(node, weight)`` pairs."""
    nodes, weights = np.polynomial.legendre.leggauss(order)
    return [(0.5 + 0.5 * float(x), 0.5 * float(w)) for x, w in zip(nodes, weights, strict=True)]


_RULE = unit_gauss(16)


def crossing_angle(speed: Array, amplitude: Array, level: float) -> Array:
    """Phase ``t`` in [0, pi] at which ``V - a cos t`` passes a level; clipped to the ends.

    The half-angle form keeps full precision at grazing, where ``arccos`` loses half its digits.

    Args:
        speed: ``V`` >= 0 [m/s].
        amplitude: Velocity amplitude ``a`` > 0 [m/s], shape of ``speed``.
        level: Relative speed to look for [m/s].
    """
    rise = np.clip(0.5 * (((amplitude - speed) + level) / amplitude), 0.0, 1.0)
    angle: Array = 2.0 * np.arcsin(np.sqrt(rise))
    return angle


def _panels(law: FrictionLaw, speed: Array, amplitude: Array) -> tuple[Array, Array]:
    """Start and width of each smooth stretch of the half cycle, both of shape (panels, n)."""
    breaks = law.breakpoints
    levels = (*(-b for b in reversed(breaks)), 0.0, *breaks)
    zero = np.zeros_like(speed)
    crossings = [crossing_angle(speed, amplitude, level) for level in levels]
    edges = np.stack([zero, *crossings, zero + np.pi])
    return edges[:-1], np.diff(edges, axis=0)


def _cycle_integral(
    law: FrictionLaw, speed: Array, amplitude: Array, integrand: Callable[[Array, Array], Array]
) -> Array:
    start, width = _panels(law, speed, amplitude)
    parts = np.zeros_like(start)
    for node, weight in _RULE:
        sine = np.sin(0.5 * (start + node * width))
        drop = 2.0 * sine * sine
        # V - a cos t without its cancellation: at grazing the sign of v decides the sum.
        relative = (speed - amplitude) + amplitude * drop
        parts += weight * width * integrand(relative, 1.0 - drop)
    total = np.zeros_like(speed)
    for part in parts:
        total += part
    return total / np.pi


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

    def varying(v: Array, cosine: Array) -> Array:
        return (law.coefficient(v) - np.where(v < 0.0, -level, level)) * cosine

    reach = np.maximum(amplitude, speed)
    sine = np.sqrt(((reach - speed) / reach) * (1.0 + speed / reach))
    return _cycle_integral(law, speed, amplitude, varying) - (2.0 / np.pi) * level * sine


def friction_harmonic_slope(law: FrictionLaw, speed: Array, amplitude: Array) -> Array:
    """``dS/da`` [s/m] by differentiation under the integral; ``-inf`` at ``a = V+``.

    The reversal of friction at the sliding limit adds
    ``-(2 mu_s/pi) (V^2/a^3) / sqrt(1 - V^2/a^2)`` for ``a > V``.
    """
    smooth = -_cycle_integral(law, speed, amplitude, lambda v, c: law.slope(v) * c * c)
    reversing = amplitude > speed
    ratio = np.where(reversing, speed / amplitude, 0.0)
    root = np.sqrt(np.where(reversing, (amplitude - speed) / amplitude, 1.0) * (1.0 + ratio))
    jump = (2.0 * law.static / np.pi) * ratio * ratio / (amplitude * root)
    return smooth - np.where(reversing, jump, 0.0)
