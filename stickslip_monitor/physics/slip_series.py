# SPDX-License-Identifier: Apache-2.0
"""One step of the lining's slip by the Taylor series of the motion, for orbits and motions in time.

Lengths are in units of ``U/omega`` and times of ``1/omega`` with a speed ``U``; the displacement
``e`` counts from a reference point and the relative speed ``z`` from a reference speed, so that
small motions keep their digits. With speed and load linear in the time ``t`` since the step began,

    e' = drift(t) - z    z' = e + offset(t) - 2 zeta z + force(t) (mu(reference) - mu)

where each of ``drift``, ``offset`` and ``force`` is a value and a rate.

A step expands displacement and relative speed in powers of the time; every turn and contact within
it is then a root of a polynomial. The law adds a coefficient at a time (``begin_series`` and
``extend_series``): sums of products, where it is an exponential or a polynomial, so that a step of
order 16 costs less than two evaluations of the law a power.
"""

from __future__ import annotations

import math
from collections.abc import MutableSequence
from typing import Any, NamedTuple

from stickslip_monitor.physics.scalar_law import begin_series, extend_series, friction_drop, friction_slope
from stickslip_monitor.physics.series import (
    INVERSE,
    ORDER,
    PLACE,
    RELATIVE_SPEED,
    find_level,
    find_turn,
    value_and_slope,
)

LONGEST = 1.0
"""Longest step, in which no event comes twice [1/omega]."""


class Medium(NamedTuple):
    """Medium in which a lining slips.

    Attributes:
        speed: The unit ``U`` of speeds [m/s].
        force: ``N/(m omega U)``.
        damping: ``2 zeta``.
        offset: The equations' ``offset``: the force besides that of ``e``, in units of ``m omega U``.
        origin: Reference speed [m/s].
        drift: Speed of the belt beyond the reference, in units of ``U``.
        force_rate: Change of the force in a time of ``1/omega``.
        offset_rate: Change of the offset in that time.
        drift_rate: Change of the drift in that time.
    """

    speed: float
    force: float
    damping: float
    offset: float
    origin: float
    drift: float
    force_rate: float = 0.0
    offset_rate: float = 0.0
    drift_rate: float = 0.0


class Expansion(NamedTuple):
    """A step whose series are in the row of work.

    Attributes:
        order: Highest power of the time in the series.
        share: Length of the step in units of ``unit``; 0 where the unit was too long for numbers.
        unit: Length of time in whose powers the series are; negative back in time [1/omega].
        next_unit: The unit to try next.
    """

    order: int
    share: float
    unit: float
    next_unit: float


def acceleration(law_numbers: Any, medium: Medium, e: float, z: float) -> float:
    """Return ``z'`` as a step begins at a displacement ``e`` and a relative speed ``z``, in its units."""
    drop = friction_drop(law_numbers, medium.origin, medium.speed * z)
    return e + medium.offset - medium.damping * z + medium.force * drop


def first_unit(law_numbers: Any, medium: Medium, z: float) -> float:
    """Return the unit of the first step of a slip from a relative speed ``z`` [1/omega].

    It is a power of two: the last digits of the exponential in a law's slope differ between processors,
    and recordings must not.
    """
    slope = friction_slope(law_numbers, medium.origin + medium.speed * z)
    rate = 1.0 + medium.damping + min(abs(medium.force * medium.speed * slope), 1e6)
    return math.ldexp(0.125, 1 - math.frexp(rate)[1])


def expand(
    law_numbers: Any,
    medium: Medium,
    e: float,
    z: float,
    unit: float,
    longest: float,
    error: float,
    work: MutableSequence[float],
) -> Expansion:
    """Expand a motion in powers of the time, and choose the length of the step.

    The step ends where the last powers come to the error, and where the relative speed leaves the piece of
    the law in which the series holds.

    Args:
        law_numbers: The law, as :class:`.LawFunctions`.
        medium: The medium as the step begins.
        e: Displacement there.
        z: Relative speed there.
        unit: Length of the step to try, negative to go back in time [1/omega].
        longest: The longest that it may be, at most :data:`LONGEST` [1/omega].
        error: Error of the step, as a share of displacement, speed and their changes.
        work: Written: the series of displacement and relative speed, and of the law.
    """
    speed, force, damping, offset, origin, drift, force_rate, offset_rate, drift_rate = medium
    low, high, drop = begin_series(law_numbers, origin, z, speed, work)
    # A step goes past the end of a piece, which errs there by the square.
    past = 0.03 * math.sqrt(error)
    low, high = (low - origin) / speed - past, (high - origin) / speed + past
    work[PLACE], work[RELATIVE_SPEED] = e, z
    rate = unit * (e + offset - damping * z + force * drop)
    work[PLACE + 1], work[RELATIVE_SPEED + 1] = unit * (drift - z), rate
    allowed = error * (abs(e) + abs(z) + abs(work[PLACE + 1]) + abs(rate))
    drift_rate, offset_rate, force_rate = unit * drift_rate, unit * offset_rate, unit * force_rate
    order, share, power, last, now, leaving = ORDER, 1.0, 1.0, 0.0, math.inf, math.inf
    for k in range(1, ORDER):
        step, slip, lower = unit * work[INVERSE + k + 1], work[RELATIVE_SPEED + k], drop
        drop = -extend_series(law_numbers, k, work)
        held = work[PLACE + k] + offset_rate - damping * slip + force * drop + force_rate * lower
        moved = drift_rate - slip
        work[PLACE + k + 1], work[RELATIVE_SPEED + k + 1] = step * moved, step * held
        if k == 1:
            drift_rate = offset_rate = 0.0
            turn = 2.0 * step * held
            if high < math.inf:
                leaving = time_to_rise(rate, turn, high - z)
            if low > -math.inf:
                leaving = min(leaving, time_to_rise(-rate, -turn, z - low))
            share = min(1.25 * leaving, 1.0)  # some more, so that the end of the piece is passed
            power = share
            # Released at the limit from a belt at rest only the change of the load moves it.
            allowed = max(allowed if allowed > 0.0 else error * abs(turn), 1e-280)
        last, now, power = now, max(abs(step * moved), abs(step * held)), power * share
        if max(now, 0.1 * last) * power <= allowed and (share < 1.0 or abs(unit) >= longest):
            order = k + 1  # the last two powers do not matter, and no longer step would be taken
            break
    next_unit = unit
    if order == ORDER:
        if not (math.isfinite(now) and math.isfinite(last)):
            return Expansion(0, 0.0, unit, 0.01 * unit)
        fits = min(5.0, LONGEST / abs(unit))
        if last > 0.0 or now > 0.0:  # the root of order 16
            fits = min(fits, 0.9 * math.sqrt(math.sqrt(math.sqrt(math.sqrt(allowed / max(last, now))))))
        next_unit, fits = fits * unit, min(fits, longest / abs(unit))
        share = min(share, fits) if share < 1.0 else fits
    if low > -math.inf or high < math.inf:
        share = _cut_at_piece(work, order, share, low, high, 0.5 * past)
    return Expansion(order, share, unit, next_unit)


def _cut_at_piece(
    work: MutableSequence[float], order: int, share: float, low: float, high: float, close: float
) -> float:
    """Return the share of the unit at which the relative speed leaves a piece of the law, at most ``share``.

    Args:
        work: The series; where the rate of the relative speed changes its sign it is written.
        order: Highest power in them.
        share: Length of the step in units.
        low: Relative speed at which the piece begins.
        high: Relative speed at which it ends.
        close: Error allowed in the relative speed at which the step ends.
    """
    end, rate = value_and_slope(work, RELATIVE_SPEED, order, share)
    if rate * work[RELATIVE_SPEED + 1] < 0.0:  # it turns: so far it may have come
        turn, furthest = find_turn(work, order, share, rate, 1e-6)
        if not low <= furthest <= high:
            share, end = turn, furthest
    if low <= end <= high:
        return share
    return find_level(work, RELATIVE_SPEED, order, share, end, high if end > high else low, close)


def time_to_rise(rate: float, turn: float, gap: float) -> float:
    """Return the time after which ``rate t + turn t^2/2`` first reaches a gap > 0; ``inf`` for never.

    >>> time_to_rise(1.0, 2.0, 6.0)
    2.0
    """
    square = rate * rate + 2.0 * turn * gap
    fastest = rate + math.sqrt(square) if square > 0.0 else 0.0
    return 2.0 * gap / fastest if fastest > 0.0 else math.inf
