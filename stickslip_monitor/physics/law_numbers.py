# SPDX-License-Identifier: Apache-2.0
"""A friction law as flat numbers, and its coefficient and slope as functions of two numbers.

Compiled loops take every law in this one form: ``mu_k + (mu_s - mu_k) exp(-(beta |v|)^delta) + nu
|v|``, or a cubic on each of some pieces. The functions run as they stand on a tuple of floats, and
compiled on an array.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TypeAlias

from stickslip_monitor.physics.friction import Coulomb, FrictionLaw, Stribeck, computes_as

LawNumbers: TypeAlias = Sequence[float]

# Places: the largest coefficient that sticking can carry, an upper bound of the steepest fall
# [s/m], the exponential law, how many cubics; then the speeds at which they begin, and four
# coefficients of each in the distance from there, from the constant one upward.
HOLD, STEEPEST, KINETIC, GAP, DECAY, VISCOUS, EXPONENT, PIECES, EDGES = range(9)


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
    return (law[DECAY] * speed) ** law[EXPONENT] if speed > 0.0 else 0.0


def forward_coefficient(law: LawNumbers, speed: float) -> float:
    """``mu`` of sliding ahead [-], continued smoothly a little below ``v`` = 0."""
    if law[PIECES] == 0.0:
        return law[KINETIC] + law[GAP] * math.exp(-decline(law, speed)) + law[VISCOUS] * speed
    i = law_piece(law, speed)
    s, c = speed - law[EDGES + i], EDGES + int(law[PIECES]) + 4 * i
    return law[c] + s * (law[c + 1] + s * (law[c + 2] + s * law[c + 3]))


def friction_coefficient(law: LawNumbers, speed: float) -> float:
    """``mu(v)`` of any relative speed [-]; its positive end at ``v`` = 0."""
    if speed == 0.0:
        return law[HOLD]
    return math.copysign(forward_coefficient(law, abs(speed)), speed)


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
                rate *= law[EXPONENT] * (law[DECAY] * v) ** power
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
    at = decline(law, origin)
    if law[EXPONENT] == 1.0:
        more = max(law[DECAY] * step, -1.0 - at)
    else:
        more = decline(law, origin + step) - at
    if more >= 0.0:
        return -law[GAP] * math.exp(-at) * math.expm1(-more) - law[VISCOUS] * step
    return law[GAP] * math.exp(-at - more) * math.expm1(more) - law[VISCOUS] * step


def law_numbers(law: FrictionLaw) -> tuple[float, ...]:
    """A friction law as flat numbers; any but those of the package as cubics between samples."""
    if computes_as(law, Stribeck):
        gap = law.static - law.kinetic
        fall = max(gap * law.decay, 0.0) - law.viscous
        return law.static, fall, law.kinetic, gap, law.decay, law.viscous, 1.0, 0.0
    if computes_as(law, Coulomb):
        hold = max(law.static, law.kinetic)
        fall = math.inf if law.static > law.kinetic else 0.0
        return hold, fall, law.kinetic, 0.0, 0.0, 0.0, 1.0, 0.0
    raise NotImplementedError
