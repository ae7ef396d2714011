# SPDX-License-Identifier: Apache-2.0
"""One step of the lining's slip, by Dormand and Prince's method of order 8 with a 5-3 error.

Lengths are in units of ``V/omega`` and times of ``1/omega``, with the displacement ``e`` beyond a
reference point and the relative speed ``z`` beyond a reference speed, so that small motions keep
their digits:

    e' = drift - z        z' = e + offset - 2 zeta z + N/(m omega V) (mu(reference) - mu)

The method is DOP853 of E. Hairer, S. P. Norsett and G. Wanner, Solving Ordinary Differential
Equations I, 2nd edition, Springer, 1993, section II.5, with the coefficients that scipy has.
"""

from __future__ import annotations

import math
from typing import Any, TypeAlias

from scipy.integrate import DOP853

from stickslip_monitor.physics.law_numbers import LawNumbers, friction_drop

# V [m/s], N/(m omega V), 2 zeta, offset, reference speed [m/s], mu there, drift
Medium: TypeAlias = tuple[float, float, float, float, float, float, float]


def _row(coefficients: Any) -> tuple[float, ...]:
    """The coefficients of a stage that are not 0, in order."""
    return tuple(a for a in coefficients.tolist() if a != 0.0)


_C: tuple[float, ...] = tuple(DOP853.C.tolist())
_A1, _A2, _A3, _A4, _A5, _A6 = (_row(DOP853.A[i]) for i in range(1, 7))
_A7, _A8, _A9, _A10, _A11 = (_row(DOP853.A[i]) for i in range(7, 12))
_B, _E5 = _row(DOP853.B), _row(DOP853.E5)
# Where the third-order formula differs from the eighth-order one.
_E3 = _row((DOP853.B - DOP853.E3[:12])[[0, 8, 11]])


def acceleration(law: LawNumbers, medium: Medium, e: float, z: float) -> float:
    """Rate of the relative speed at a displacement and a relative speed."""
    speed, force, damping, offset, origin, top, _ = medium
    return e + offset - damping * z + force * friction_drop(law, origin, top, speed * z)


def slip_step(
    law: LawNumbers, medium: Medium, e0: float, z0: float, r0: float, step: float
) -> tuple[float, float, float, float]:
    """Displacement, relative speed and its rate after a step, and the step's error.

    Args:
        law: The law.
        medium: What the motion takes place in.
        e0: Displacement at its begin.
        z0: Relative speed there.
        r0: The rate of that.
        step: Its length, negative to go back in time.
    """
    drift = medium[6]
    (a,) = _A1
    z1 = z0 + step * a * r0
    x = e0 + step * (_C[1] * drift - a * z0)
    r1 = acceleration(law, medium, x, z1)
    a, b = _A2
    z2 = z0 + step * (a * r0 + b * r1)
    x = e0 + step * (_C[2] * drift - (a * z0 + b * z1))
    r2 = acceleration(law, medium, x, z2)
    a, b = _A3
    z3 = z0 + step * (a * r0 + b * r2)
    x = e0 + step * (_C[3] * drift - (a * z0 + b * z2))
    r3 = acceleration(law, medium, x, z3)
    a, b, c = _A4
    z4 = z0 + step * (a * r0 + b * r2 + c * r3)
    x = e0 + step * (_C[4] * drift - (a * z0 + b * z2 + c * z3))
    r4 = acceleration(law, medium, x, z4)
    a, b, c = _A5
    z5 = z0 + step * (a * r0 + b * r3 + c * r4)
    x = e0 + step * (_C[5] * drift - (a * z0 + b * z3 + c * z4))
    r5 = acceleration(law, medium, x, z5)
    a, b, c, d = _A6
    z6 = z0 + step * (a * r0 + b * r3 + c * r4 + d * r5)
    x = e0 + step * (_C[6] * drift - (a * z0 + b * z3 + c * z4 + d * z5))
    r6 = acceleration(law, medium, x, z6)
    a, b, c, d, e = _A7
    z7 = z0 + step * (a * r0 + b * r3 + c * r4 + d * r5 + e * r6)
    x = e0 + step * (_C[7] * drift - (a * z0 + b * z3 + c * z4 + d * z5 + e * z6))
    r7 = acceleration(law, medium, x, z7)
    a, b, c, d, e, f = _A8
    z8 = z0 + step * (a * r0 + b * r3 + c * r4 + d * r5 + e * r6 + f * r7)
    x = e0 + step * (_C[8] * drift - (a * z0 + b * z3 + c * z4 + d * z5 + e * z6 + f * z7))
    r8 = acceleration(law, medium, x, z8)
    a, b, c, d, e, f, g = _A9
    rate = a * r0 + b * r3 + c * r4 + d * r5 + e * r6 + f * r7 + g * r8
    lag = a * z0 + b * z3 + c * z4 + d * z5 + e * z6 + f * z7 + g * z8
    z9 = z0 + step * rate
    r9 = acceleration(law, medium, e0 + step * (_C[9] * drift - lag), z9)
    a, b, c, d, e, f, g, h = _A10
    rate = a * r0 + b * r3 + c * r4 + d * r5 + e * r6 + f * r7 + g * r8 + h * r9
    lag = a * z0 + b * z3 + c * z4 + d * z5 + e * z6 + f * z7 + g * z8 + h * z9
    z10 = z0 + step * rate
    r10 = acceleration(law, medium, e0 + step * (_C[10] * drift - lag), z10)
    a, b, c, d, e, f, g, h, i = _A11
    rate = a * r0 + b * r3 + c * r4 + d * r5 + e * r6 + f * r7 + g * r8 + h * r9 + i * r10
    lag = a * z0 + b * z3 + c * z4 + d * z5 + e * z6 + f * z7 + g * z8 + h * z9 + i * z10
    z11 = z0 + step * rate
    r11 = acceleration(law, medium, e0 + step * (drift - lag), z11)
    a, b, c, d, e, f, g, h = _B
    rate = a * r0 + b * r5 + c * r6 + d * r7 + e * r8 + f * r9 + g * r10 + h * r11
    lag = a * z0 + b * z5 + c * z6 + d * z7 + e * z8 + f * z9 + g * z10 + h * z11
    place, after = e0 + step * (drift - lag), z0 + step * rate
    a, b, c = _E3
    third = max(abs(rate - (a * r0 + b * r8 + c * r11)), abs(lag - (a * z0 + b * z8 + c * z11)))
    a, b, c, d, e, f, g, h = _E5
    rate = a * r0 + b * r5 + c * r6 + d * r7 + e * r8 + f * r9 + g * r10 + h * r11
    lag = a * z0 + b * z5 + c * z6 + d * z7 + e * z8 + f * z9 + g * z10 + h * z11
    fifth = max(abs(rate), abs(lag))
    scale = math.hypot(fifth, 0.1 * third)
    error = abs(step) * fifth * (fifth / scale) if scale > 0.0 else 0.0
    return place, after, acceleration(law, medium, place, after), error
