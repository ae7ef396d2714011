# SPDX-License-Identifier: Apache-2.0
"""One step of the lining's slip at constant speed and load, by the Taylor series of the motion.

A step expands displacement and relative speed in powers of the time; every turn and contact within
it is then a root of a polynomial. The law adds a coefficient at a time (``begin_series`` and
``extend_series``): sums of products, where it is an exponential or a polynomial, so that a step of
order 16 costs less than two evaluations of the law a power.
"""

from __future__ import annotations

import math
from collections.abc import MutableSequence
from typing import Any, NamedTuple

from stickslip_monitor.physics.scalar_law import begin_series, extend_series
from stickslip_monitor.physics.series import (
    INVERSE,
    ORDER,
    PLACE,
    RATE,
    RELATIVE_SPEED,
    find_level,
    value_and_slope,
)
from stickslip_monitor.physics.slip_step import Medium, time_to_rise

# Longest step [1/omega], in which no event comes twice, and the most that one may grow by.
_LONGEST, _GROWTH = 1.0, 5.0
# How far past the end of a piece of a law a step goes, in units of speed and of the root of its error: a
# piece errs there by the square.
_PAST = 0.03


class Expansion(NamedTuple):
    """Series of a step, in the row of work.

    Attributes:
        order: Highest power of the time in it.
        share: Length of the step in units of ``unit``; 0 where the unit was too long for numbers.
        unit: Length of time in whose powers the series are; negative back in time [1/omega].
        next_unit: The unit to try next.
    """

    order: int
    share: float
    unit: float
    next_unit: float


def expand(
    law_numbers: Any,
    medium: Medium,
    e: float,
    z: float,
    unit: float,
    error: float,
    work: MutableSequence[float],
) -> Expansion:
    """Expand a motion in powers of the time, and find how long the step may be.

    It ends where the last powers come to the error, and where the relative speed leaves the piece of
    the law in which the series holds.

    Args:
        law_numbers: The law, as :attr:`.LawInUse.numbers` of :func:`.series_law`.
        medium: The medium, without rates.
        e: Displacement as the step begins.
        z: Relative speed there.
        unit: Length of the step to try, negative to go back in time [1/omega].
        error: Of the step in units of the motion.
        work: Written: the series of displacement and relative speed, and of the law.
    """
    speed, force, damping, offset, origin, drift, _, _, _ = medium
    low, high, drop = begin_series(law_numbers, origin, z, speed, work)
    past = _PAST * math.sqrt(error)
    low, high = (low - origin) / speed - past, (high - origin) / speed + past
    work[PLACE], work[RELATIVE_SPEED] = e, z
    rate = unit * (e + offset - damping * z + force * drop)
    work[PLACE + 1], work[RELATIVE_SPEED + 1] = unit * (drift - z), rate
    allowed = error * (abs(e) + abs(z) + abs(work[PLACE + 1]) + abs(rate))
    order, share, power, last, now, leaving = ORDER, 1.0, 1.0, 0.0, math.inf, math.inf
    for k in range(1, ORDER):
        step, slip = unit * work[INVERSE + k + 1], work[RELATIVE_SPEED + k]
        held = work[PLACE + k] - damping * slip - force * extend_series(law_numbers, k, work)
        work[PLACE + k + 1], work[RELATIVE_SPEED + k + 1] = -step * slip, step * held
        if k == 1:
            turn = 2.0 * step * held
            if high < math.inf:
                leaving = time_to_rise(rate, turn, high - z)
            if low > -math.inf:
                leaving = min(leaving, time_to_rise(-rate, -turn, z - low))
            share = min(1.25 * leaving, 1.0)  # some more, so that the end of the piece is passed
            power = share
        last, now, power = now, max(abs(step * slip), abs(step * held)), power * share
        if max(now, 0.1 * last) * power <= allowed and (share < 1.0 or abs(unit) >= _LONGEST):
            order = k + 1  # the last two powers do not matter, and no longer step would be taken
            break
    next_unit = unit
    if order == ORDER:
        if not (math.isfinite(now) and math.isfinite(last)):
            return Expansion(0, 0.0, unit, 0.01 * unit)
        fits = min(_GROWTH, _LONGEST / abs(unit))
        if last > 0.0 or now > 0.0:  # the root of order 16
            fits = min(fits, 0.9 * math.sqrt(math.sqrt(math.sqrt(math.sqrt(allowed / max(last, now))))))
        share, next_unit = min(share, fits) if share < 1.0 else fits, fits * unit
    if low > -math.inf or high < math.inf:
        share = _cut_at_piece(work, order, share, low, high, 0.5 * past)
    return Expansion(order, share, unit, next_unit)


def _cut_at_piece(
    work: MutableSequence[float], order: int, share: float, low: float, high: float, close: float
) -> float:
    """Return the share of the unit up to where the relative speed leaves a piece of the law, or as given.

    Args:
        work: The series; where the rate of the relative speed changes its sign it is written.
        order: Its order.
        share: Length of the step in units.
        low: Where the piece begins, as a relative speed.
        high: Where it ends.
        close: How far from there the step may end.
    """
    end, rate = value_and_slope(work, RELATIVE_SPEED, order, share)
    if rate * work[RELATIVE_SPEED + 1] < 0.0:  # it turns: so far it may have come
        for k in range(order):
            work[RATE + k] = (k + 1.0) * work[RELATIVE_SPEED + k + 1]
        turn = find_level(work, RATE, order - 1, share, rate, 0.0, 1e-6 * abs(rate))
        furthest, _ = value_and_slope(work, RELATIVE_SPEED, order, turn)
        if not low <= furthest <= high:
            share, end = turn, furthest
    if low <= end <= high:
        return share
    return find_level(work, RELATIVE_SPEED, order, share, end, high if end > high else low, close)
