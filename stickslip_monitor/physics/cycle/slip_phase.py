# SPDX-License-Identifier: Apache-2.0
"""Whether the slip phase of any friction law meets the belt, at a cost independent of the law.

:mod:`~stickslip_monitor.physics.cycle.orbit` ends a step at every measured speed that an orbit
passes: twelve digits, but time and memory in proportion to a table. Here the step control of an
embedded Runge-Kutta pair (J. R. Dormand, P. J. Prince, J. Comput. Appl. Math. 6, 1980, 19-26)
finds its way across the kinks of the curve's second derivative: seven digits, from array
operations in which no element sees another. Units and equations are those of
:mod:`~stickslip_monitor.physics.cycle.slip_step`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields

import numpy as np

from stickslip_monitor.arrays import BoolArray, FloatArray, IndexArray
from stickslip_monitor.physics.cycle.law import ALMOST_REST, breakaway
from stickslip_monitor.physics.oscillator import Bearing

Rate = Callable[[FloatArray, FloatArray], FloatArray]

_STAGES = (
    (1 / 5,),
    (3 / 40, 9 / 40),
    (44 / 45, -56 / 15, 32 / 9),
    (19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729),
    (9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656),
    (35 / 384, 0.0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84),
)
_ERROR = (71 / 57600, 0.0, -71 / 16695, 71 / 1920, -17253 / 339200, 22 / 525, -1 / 40)
_SMALL = 1e-3
_FIRST_STEP, _LONGEST, _SHORTEST = 1e-3, 0.3, 1e-12
# An orbit that has not come back after so many radians, or steps, does not meet the belt.
_PATIENCE, _STEPS = 80.0, 4000
_BISECTIONS = 40


@dataclass(slots=True)
class _Slip:
    """The orbits still followed; every array has shape (n,).

    Attributes:
        index: Their places in the result.
        speed: ``V`` [m/s].
        force: ``N / (m omega V)``.
        hold: Displacement above which the belt cannot catch the lining.
        e: Displacement beyond breakaway.
        z: Relative speed.
        rate: ``z'``.
        h: Next step.
        time: Since breakaway.
        turns: Turning points passed.
    """

    index: IndexArray
    speed: FloatArray
    force: FloatArray
    hold: FloatArray
    e: FloatArray
    z: FloatArray
    rate: FloatArray
    h: FloatArray
    time: FloatArray
    turns: IndexArray

    def kept(self, keep: BoolArray) -> _Slip:
        return _Slip(*(getattr(self, column.name)[keep] for column in fields(_Slip)))


def grazing_margin(
    bearing: Bearing, speed: FloatArray, load: FloatArray, tolerance: float = 1e-9
) -> FloatArray:
    """Signed distance of the slip phase from grazing, > 0 where it meets the belt.

    Args:
        bearing: The bearing.
        speed: ``V`` > 0 [m/s], shape (n,).
        load: ``N`` > 0 [N], shape (n,).
        tolerance: Of each step, relative.

    Returns:
        ``w (w - 2)`` where the orbit passes the level at which the belt could just hold the
        lining, with the relative speed ``w`` there; -1 where it never does, shape (n,).
    """
    out = np.full(speed.size, -1.0)
    with np.errstate(all='ignore'):
        slip = _begin(bearing, speed, load)
        slip = slip.kept(np.isfinite(slip.force))
        for _ in range(_STEPS):
            if not slip.index.size:
                break
            slip = slip.kept(_advance(bearing, slip, out, tolerance))
    return out


def _begin(bearing: Bearing, speed: FloatArray, load: FloatArray) -> _Slip:
    law, none = bearing.friction, np.zeros(speed.size)
    force = load / (bearing.mass * bearing.natural_frequency * speed)
    jump = force * (breakaway(law) - float(law.coefficient(ALMOST_REST)))
    return _Slip(
        index=np.arange(speed.size),
        speed=speed,
        force=force,
        hold=-jump,
        e=none,
        z=none,
        rate=jump,
        h=np.full(speed.size, _FIRST_STEP),
        time=none,
        turns=np.zeros(speed.size, dtype=np.intp),
    )


def _rate(bearing: Bearing, slip: _Slip) -> Rate:
    law, damping, top = bearing.friction, 2.0 * bearing.damping_ratio, breakaway(bearing.friction)

    def rate(e: FloatArray, z: FloatArray) -> FloatArray:
        lost = top - law.coefficient(np.maximum(slip.speed * z, ALMOST_REST))
        return e - damping * z + slip.force * lost

    return rate


def _sum(weights: tuple[float, ...], rates: list[FloatArray]) -> FloatArray:
    total = weights[0] * rates[0]
    for weight, rate in zip(weights[1:], rates[1:], strict=True):
        total = total + weight * rate
    return total


def _advance(bearing: Bearing, slip: _Slip, out: FloatArray, tolerance: float) -> BoolArray:
    """Try one step of every orbit, note the margins of those that end; return which go on."""
    rate = _rate(bearing, slip)
    ke, kz, e, z = [1.0 - slip.z], [slip.rate], slip.e, slip.z
    for weights in _STAGES:
        e = slip.e + slip.h * _sum(weights, ke)
        z = slip.z + slip.h * _sum(weights, kz)
        ke.append(1.0 - z)
        kz.append(rate(e, z))
    error = slip.h * np.maximum(np.abs(_sum(_ERROR, ke)), np.abs(_sum(_ERROR, kz)))
    error /= np.abs(slip.z) + np.abs(slip.e) + _SMALL
    good = error <= tolerance
    # The lining turns where its own velocity vanishes, z = 1.
    slip.turns = slip.turns + (good & np.where(slip.turns % 2 == 1, z <= 1.0, z >= 1.0))
    # On its way back it passes that level behind the belt (z > 0), or has met the belt before.
    passed = np.flatnonzero(good & (slip.turns == 2) & (e > slip.hold))
    if passed.size:
        share = _crossing(slip, passed, e, ke)
        relative = _between(share, slip.h[passed], slip.z, z, kz, passed)
        out[slip.index[passed]] = relative * (relative - 2.0)
    going = (slip.time <= _PATIENCE) & (slip.turns <= 2)
    going[passed] = False
    slip.time = np.where(good, slip.time + slip.h, slip.time)
    slip.e, slip.z = np.where(good, e, slip.e), np.where(good, z, slip.z)
    slip.rate = np.where(good, kz[-1], slip.rate)
    growth = 0.9 * np.sqrt(np.sqrt(tolerance / error))
    slip.h = np.minimum(slip.h * np.clip(growth, 0.2, np.where(good, 4.0, 0.8)), _LONGEST)
    return going & (slip.h > _SHORTEST)


def _between(
    share: FloatArray,
    h: FloatArray,
    start: FloatArray,
    end: FloatArray,
    rates: list[FloatArray],
    rows: IndexArray,
) -> FloatArray:
    """Hermite's cubic over a step at a share of it, shape of ``share``."""
    a, b = start[rows], end[rows]
    first, last = h * rates[0][rows], h * rates[-1][rows]
    bend = 3.0 * (b - a) - 2.0 * first - last + share * (first + last - 2.0 * (b - a))
    value: FloatArray = a + share * (first + share * bend)
    return value


def _crossing(slip: _Slip, rows: IndexArray, e: FloatArray, ke: list[FloatArray]) -> FloatArray:
    """Share of the step at which orbits rise to ``hold``, or its begin if they are above."""
    low, high = np.zeros(rows.size), np.ones(rows.size)
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        above = _between(middle, slip.h[rows], slip.e, e, ke, rows) > slip.hold[rows]
        low, high = np.where(above, low, middle), np.where(above, middle, high)
    return high
