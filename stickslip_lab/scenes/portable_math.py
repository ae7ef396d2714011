# SPDX-License-Identifier: Apache-2.0
"""Exponential and cosine with the same bits on every machine.

The last bits of numpy's depend on the processor's vector instructions, and a scene must give the same
recording everywhere. These use only additions, multiplications and scaling by powers of two, which IEEE 754
rounds in one way and numpy does not fuse.
"""

from __future__ import annotations

import math

import numpy as np

from stickslip_monitor.arrays import FloatArray

# exp(r) for |r| <= ln(2)/2, and cos(x) in powers of x^2 for |x| <= pi/2: Taylor's series, until
# the next term is below half a unit in the last place.
_EXP = [1.0 / math.factorial(k) for k in range(14)]
_COS = [(-1.0) ** k / math.factorial(2 * k) for k in range(11)]
# ln(2) in two parts; the first has so few digits that its multiples are exact.
_LN2_HIGH, _LN2_LOW = float.fromhex('0x1.62e42feep-1'), float.fromhex('0x1.a39ef35793c76p-33')


def exp(x: FloatArray) -> FloatArray:
    """Compute ``e^x`` of numbers up to 700, of any shape, with the same bits on every machine.

    Below -700 the result is ``e^-700``.
    """
    x = np.maximum(x, -700.0)
    twos = np.rint(x * (1.0 / math.log(2.0)))
    rest = (x - twos * _LN2_HIGH) - twos * _LN2_LOW
    return np.ldexp(_evaluate_polynomial(_EXP, rest), twos.astype(np.int32))


def cos_turns(turns: FloatArray) -> FloatArray:
    """Compute ``cos(2 pi x)`` of numbers of turns, of any shape, with the same bits on every machine."""
    away = np.abs(turns - np.rint(turns))
    folded = np.minimum(away, 0.5 - away)
    angle = (2.0 * math.pi) * np.abs(folded)
    return np.where(away > 0.25, -1.0, 1.0) * _evaluate_polynomial(_COS, angle * angle)


def _evaluate_polynomial(coefficients: list[float], x: FloatArray) -> FloatArray:
    """Evaluate a polynomial at places of any shape by Horner's rule; the lowest power comes first."""
    total = np.full_like(x, coefficients[-1])
    for coefficient in reversed(coefficients[:-1]):
        np.multiply(total, x, out=total)
        np.add(total, coefficient, out=total)
    return total
