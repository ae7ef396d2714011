# SPDX-License-Identifier: Apache-2.0
"""A friction law as flat numbers, and its coefficient and slope as functions of two numbers.

Compiled loops take every law in this one form: ``mu_k + (mu_s - mu_k) exp(-(beta |v|)^delta) + nu
|v|``, or a cubic on each of some pieces. The functions run as they stand on a tuple of floats, and
compiled on an array.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import TypeAlias

import numpy as np

from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.physics.friction import (
    Coulomb,
    FrictionLaw,
    Stretched,
    Stribeck,
    Tabulated,
    computes_as,
)

LawNumbers: TypeAlias = Sequence[float]

# Places: the largest coefficient that sticking can carry, an upper bound of the steepest fall
# [s/m], the exponential law, how many cubics; then the speeds at which they begin, and four
# coefficients of each in the distance from there, from the constant one upward.
HOLD, STEEPEST, KINETIC, GAP, DECAY, VISCOUS, EXPONENT, PIECES, EDGES = range(9)

# The smallest speed that is not rest [m/s].
ALMOST_REST = 1e-300
# Decays of speed from which nothing is left, and whose powers are still numbers: Python's power
# raises where it overflows.
_FADED = 1e60
# How far cubics may be off a law that has no series, in units of its largest coefficient, where a
# motion is followed.
_SAMPLED = 1e-9
# In units of 1/beta: a series sees from above that the exponential rises below such a speed, and
# above the last one it is less than the rounding of one.
_EXPONENTIAL_EDGES = (0.0, 12.0, 40.0, np.inf)
# How many cubics are made at most.
_MOST_SAMPLES = 20000


def law_piece(law: LawNumbers, speed: float) -> int:
    """The cubic that holds at a relative speed [m/s]; the first one below it."""
    low, high = 0, int(law[PIECES])
    while high - low > 1:
        middle = (low + high) // 2
        if speed >= law[EDGES + middle]:
            low = middle
        else:
            high = middle
    return low


def decline(law: LawNumbers, speed: float) -> float:
    """``(beta v)^delta``, continued a little below ``v`` = 0 [-]."""
    if law[EXPONENT] == 1.0:
        return max(law[DECAY] * speed, -1.0)
    return min(law[DECAY] * speed, _FADED) ** law[EXPONENT] if speed > 0.0 else 0.0


def forward_coefficient(law: LawNumbers, speed: float) -> float:
    """``mu`` of sliding ahead [-], continued smoothly a little below ``v`` = 0."""
    if law[PIECES] == 0.0:
        return law[KINETIC] + law[GAP] * math.exp(-decline(law, speed)) + law[VISCOUS] * speed
    i = law_piece(law, speed)
    s, c = speed - law[EDGES + i], EDGES + int(law[PIECES]) + 4 * i
    return law[c] + s * (law[c + 1] + s * (law[c + 2] + s * law[c + 3]))


def friction_slope(law: LawNumbers, speed: float) -> float:
    """``d mu / d|v|`` at a relative speed [s/m]; from the right at ``v`` = 0."""
    v = abs(speed)
    if law[PIECES] == 0.0:
        rate = law[DECAY]
        if law[EXPONENT] != 1.0:
            power = law[EXPONENT] - 1.0
            if v == 0.0:
                rate = 0.0 if power > 0.0 else math.inf
            else:
                rate *= law[EXPONENT] * min(law[DECAY] * v, _FADED) ** power
        return law[VISCOUS] - law[GAP] * rate * math.exp(-decline(law, v))
    i = law_piece(law, v)
    s, c = v - law[EDGES + i], EDGES + int(law[PIECES]) + 4 * i
    return law[c + 1] + s * (2.0 * law[c + 2] + s * 3.0 * law[c + 3])


def friction_drop(law: LawNumbers, origin: float, top: float, step: float) -> float:
    """``mu(v) - mu(v + step)`` of sliding ahead [-], without cancellation for a small step.

    Args:
        law: The law.
        origin: ``v`` >= 0 [m/s].
        top: ``mu(v)``, at 0 its limit from the right [-].
        step: Any change of speed [m/s].
    """
    if law[PIECES] != 0.0:
        return top - forward_coefficient(law, origin + step)
    if law[EXPONENT] == 1.0:
        at, more = law[DECAY] * origin, law[DECAY] * step
        more = more if more > -1.0 - at else -1.0 - at
    else:
        at = decline(law, origin)
        more = decline(law, origin + step) - at
    if more >= 0.0:
        return -law[GAP] * math.exp(-at) * math.expm1(-more) - law[VISCOUS] * step
    return law[GAP] * math.exp(-at - more) * math.expm1(more) - law[VISCOUS] * step


@lru_cache(maxsize=64)
def law_numbers(law: FrictionLaw) -> tuple[float, ...]:
    """A friction law as flat numbers; any but those of the package as cubics between samples."""
    if computes_as(law, Stribeck):
        gap = law.static - law.kinetic
        fall = max(gap * law.decay, 0.0) - law.viscous
        hold = max(law.static, law.kinetic + gap)
        return hold, fall, law.kinetic, gap, law.decay, law.viscous, 1.0, 0.0
    if computes_as(law, Coulomb):
        fall = math.inf if law.static > law.kinetic else 0.0
        return max(law.static, law.kinetic), fall, law.kinetic, 0.0, 0.0, 0.0, 1.0, 0.0
    if computes_as(law, Stretched):
        gap, power = law.static - law.kinetic, law.exponent
        top = (power - 1.0) / power  # (beta v)^delta where the law falls most steeply
        fall = law.decay * power * top**top * math.exp(-top)
        fall = max(gap * fall, 0.0) * (1.0 + 1e-12) - law.viscous
        return law.static, fall, law.kinetic, gap, law.decay, law.viscous, power, 0.0
    edges, cubics = _table(law) if computes_as(law, Tabulated) else sampled_cubics(law)
    hold = max(law.static, float(cubics[0, 0]))
    fall = math.inf if law.static > cubics[0, 0] else steepest_fall(edges, cubics)
    numbers = (hold, fall, 0.0, 0.0, 0.0, 0.0, 1.0, float(edges.size))
    return *numbers, *edges.tolist(), *cubics.ravel().tolist()


def steepest_fall(edges: FloatArray, cubics: FloatArray) -> float:
    """The largest ``-slope`` of cubics: at an end of one, or at the vertex of its slope [s/m]."""
    width = np.append(np.diff(edges), 0.0)
    _, c, b, a = cubics.T
    with np.errstate(divide='ignore', invalid='ignore'):
        vertex = np.clip(np.nan_to_num(-b / (3.0 * a)), 0.0, width)
    places = np.stack([np.zeros_like(width), vertex, width])
    # Rounding must not make a cycle impossible.
    return max(float(np.max(-(3.0 * a * places + 2.0 * b) * places - c)), 0.0) * (1.0 + 1e-12)


def _table(law: Tabulated) -> tuple[FloatArray, FloatArray]:
    """Where the cubics of a table begin, and their coefficients, constant outside the table."""
    level = [[law.values[0], 0.0, 0.0, 0.0]] if law.speed[0] > 0.0 else np.empty((0, 4))
    last = [[law.values[-1], 0.0, 0.0, 0.0]]
    edges = np.array([*([0.0] if law.speed[0] > 0.0 else []), *law.speed])
    return edges, np.vstack([level, law.cubics[::-1].T, last])


def sampled_cubics(law: FrictionLaw, tolerance: float = 1e-12) -> tuple[FloatArray, FloatArray]:
    """Cubics through samples of a law and of its slope, halved until they agree with it.

    Args:
        law: The law.
        tolerance: How far they may be off in the middle, in units of the largest coefficient.
    """
    breaks = [v for v in law.breakpoints if v > 0.0] or [1.0]
    edges = np.unique([0.0, *(breaks[0] * 10.0**i for i in range(-4, 0)), *breaks])
    edges = np.append(edges, breaks[-1] * 10.0 ** np.arange(1, 4))
    scale = max(law.static, float(np.max(np.abs(law.coefficient(edges[1:])))), 1e-300)
    while True:
        at = np.maximum(edges, ALMOST_REST)
        mu, slope, h = law.coefficient(at), law.slope(at), np.diff(edges)
        chord = np.diff(mu) / h
        square = (3.0 * chord - 2.0 * slope[:-1] - slope[1:]) / h
        cube = (slope[:-1] + slope[1:] - 2.0 * chord) / (h * h)
        cubics = np.stack([mu[:-1], slope[:-1], square, cube], axis=1)
        middle = edges[:-1] + 0.5 * h
        value = mu[:-1] + 0.5 * h * (slope[:-1] + 0.5 * h * (square + 0.5 * h * cube))
        off = np.abs(value - law.coefficient(middle)) > tolerance * scale
        if not off.any() or edges.size > _MOST_SAMPLES:
            return edges, np.vstack([cubics, [[mu[-1], slope[-1], 0.0, 0.0]]])
        edges = np.sort(np.append(edges, middle[off]))


@dataclass(frozen=True, slots=True, eq=False)
class SeriesLaw:
    """A friction law whose series the integrator of the motion can work out.

    Attributes:
        hold: Largest coefficient that sticking can carry [-]: by Filippov's convex hull never
            less than that of slow sliding.
        steepest: Upper bound of ``|d mu / d|v||`` [s/m].
        exponential: ``mu_k, mu_s - mu_k, beta, nu`` of Stribeck's law.
        edges: Lower ends of the smooth pieces and infinity, shape (pieces + 1,) [m/s].
        cubics: Coefficients on each piece in ``|v| - edge``, shape (pieces, 4); empty for an
            exponential.
    """

    hold: float
    steepest: float
    exponential: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0)
    edges: FloatArray = field(default_factory=lambda: np.array([0.0, np.inf]))
    cubics: FloatArray = field(default_factory=lambda: np.zeros((0, 4)))

    @property
    def is_cubic(self) -> bool:
        """Whether the law is given by cubics."""
        return self.cubics.size > 0


def series_law(law: FrictionLaw) -> SeriesLaw:
    """A friction law in pieces with series; one that has none as cubics, right to 1e-9."""
    if computes_as(law, Stribeck):
        gap = law.static - law.kinetic
        numbers = (law.kinetic, gap, law.decay, law.viscous)
        edges = np.array(_EXPONENTIAL_EDGES) / law.decay
        return SeriesLaw(law.static, abs(gap) * law.decay + law.viscous, numbers, edges)
    if computes_as(law, Coulomb):
        return SeriesLaw(max(law.static, law.kinetic), 0.0, (law.kinetic, 0.0, 0.0, 0.0))
    begins, cubics = _table(law) if computes_as(law, Tabulated) else sampled_cubics(law, _SAMPLED)
    # A monotone cubic is nowhere steeper than three times its chord (Fritsch and Carlson).
    steepest = 3.0 * float(np.max(np.abs(np.diff(cubics[:, 0]) / np.diff(begins))))
    hold = max(law.static, float(cubics[0, 0]))
    return SeriesLaw(hold, steepest, edges=np.append(begins, np.inf), cubics=cubics)
