# SPDX-License-Identifier: Apache-2.0
"""The exact stable and unstable cycles of many points, from orbits followed together.

Every stick-slip cycle passes through breakaway, so one slip phase finds it. A lining that
overtakes the belt closes where its round has a fixed point. A cycle about steady sliding is a
balance of energy over a turn, followed back in time, where an unstable cycle attracts.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from stickslip_monitor.arrays import BoolArray, FloatArray, IndexArray
from stickslip_monitor.physics.averaging import averaged
from stickslip_monitor.physics.averaging_by_scan import slope_surface
from stickslip_monitor.physics.bearing import Bearing
from stickslip_monitor.physics.friction import Stribeck, computes_as
from stickslip_monitor.physics.orbits import (
    EXHAUSTED,
    LANDED,
    TURNED,
    Route,
    SlipField,
    follow,
    law_in_use,
    slip_field,
)
from stickslip_monitor.physics.roots import root_on_bracket
from stickslip_monitor.physics.slip import (
    AT_REST,
    NO_CONTACT,
    NO_CYCLE,
    NOT_FINITE,
    OVERTAKING,
    PURE_SLIP,
    STICK_SLIP,
    UNRESOLVED,
)

# Error of a step of a cycle, and of one whose amplitude alone is wanted: that errs by 1e-9.
_ERROR, _OF_AMPLITUDES = 1e-13, 1e-10
# How roughly a cubic knows the place of a contact: measured 0.011 at 40,000 points.
_ROUGHLY = 0.03
# Panels in which a sign change of the energy gain is looked for, a gain that is rounding, and
# fourfold increases in search of the far side of an overtaking cycle.
_PANELS, _BALANCED, _QUADRUPLINGS = 24, 1e-13, 40
# Beyond this friction force, in units of m omega V, the numbers run out.
_GREATEST_FORCE = 1e150
# How much less than the least load with a cycle by averaging a vibration that never sticks may
# need: averaging is right to a tenth up to eta = 20.
_LESS = 0.9
# How much lower, as a share, rho has to be at the sliding limit than at its highest.
_SAME = 1e-4
# Orbits that are followed together, in some 10 MB: 4,096 take a third longer.
_BLOCK = 16384


class FoundCycles(NamedTuple):
    """What is found at points, each of shape (n,).

    Attributes:
        kind: Numbers of :class:`.cycles.CycleKind`.
        crest: Highest displacement beyond breakaway.
        trough: Lowest one.
        slipping: Time slipping.
        sticking: Time sticking.
        start: The place at which the lining falls behind the belt.
        exponent: Logarithm of the Floquet multiplier.
    """

    kind: FloatArray
    crest: FloatArray
    trough: FloatArray
    slipping: FloatArray
    sticking: FloatArray
    start: FloatArray
    exponent: FloatArray


def absent_cycles(kind: IndexArray) -> FoundCycles:
    """What is found where there are no cycles, for a reason each."""
    return FoundCycles(kind.astype(float), *np.full((6, kind.size), np.nan))


def put_cycles(found: FoundCycles, rows: IndexArray | BoolArray, part: FoundCycles) -> None:
    """Write what is found of some points to their places."""
    for column, values in zip(found, part, strict=True):
        column[rows] = values


def _some(found: FoundCycles, rows: IndexArray | BoolArray) -> FoundCycles:
    return FoundCycles(*(column[rows] for column in found))


def why_no_cycles(bearing: Bearing, speed: FloatArray, load: FloatArray) -> IndexArray:
    """Why there is certainly no cycle; ``STICK_SLIP`` where there may be one."""
    kind = np.full(speed.size, STICK_SLIP)
    momentum = np.sqrt(bearing.mass) * np.sqrt(bearing.stiffness)
    with np.errstate(all='ignore'):
        kind[~(load / np.abs(speed) < _GREATEST_FORCE * momentum)] = UNRESOLVED
        # Without a gain at any speed the flow contracts everywhere (Bendixson's criterion).
        kind[~(load * law_in_use(bearing.friction).fall > bearing.damping)] = NO_CYCLE
    kind[load <= 0.0] = NO_CONTACT
    kind[speed == 0.0] = AT_REST
    kind[~(np.isfinite(speed) & np.isfinite(load))] = NOT_FINITE
    return kind


def cycles_together(
    bearing: Bearing, speed: FloatArray, load: FloatArray, stable: bool, weigh: bool = True
) -> FoundCycles:
    """The stable cycles, or the smallest unstable ones, of many points.

    Args:
        bearing: The bearing.
        speed: Shape (n,) [m/s].
        load: Shape (n,) [N].
        stable: Whether stable ones.
        weigh: Whether Floquet multipliers are wanted.
    """
    found = absent_cycles(why_no_cycles(bearing, speed, load))
    rows = np.flatnonzero(found.kind == STICK_SLIP)
    for first in range(0, rows.size, _BLOCK):
        part = rows[first : first + _BLOCK]
        with np.errstate(all='ignore'):
            field = slip_field(bearing, np.abs(speed[part]), load[part])
            put_cycles(found, part, _in_fields(bearing, field, load[part], (stable, weigh)))
    return found


def _in_fields(
    bearing: Bearing, field: SlipField, load: FloatArray, wanted: tuple[bool, bool]
) -> FoundCycles:
    stable, weigh = wanted
    n = field.speed.size
    if not stable:
        rows = np.flatnonzero(slides_steadily(field))
        found = absent_cycles(np.full(n, NO_CYCLE))
        put_cycles(found, rows, _pure_slip(field.take(rows), stable, weigh))
        return found
    found = _through_belt(field, weigh)
    rest = np.flatnonzero(found.kind == NO_CYCLE)
    asked = ~slides_steadily(field.take(rest))
    asked |= may_vibrate(bearing, field.speed[rest], load[rest])
    rows = rest[asked]
    put_cycles(found, rows, _pure_slip(field.take(rows), stable, weigh))
    return found


def may_vibrate(bearing: Bearing, speed: FloatArray, load: FloatArray) -> BoolArray:
    """Where a vibration that never sticks may go on beside stable sliding.

    Under averaging it does where ``rho(a; V)`` is above ``c/N`` at some amplitude and falls below
    it up to the sliding limit; of a law whose ``rho`` is highest there, as Stribeck's, nowhere.

    Args:
        bearing: The bearing.
        speed: Shape (n,) [m/s].
        load: Shape (n,) [N].
    """
    law, size = bearing.friction, np.abs(speed)
    result = np.zeros(size.shape, bool)
    if computes_as(law, Stribeck):
        return result
    with np.errstate(all='ignore'):
        rows = np.flatnonzero((load > 0.0) & (size > 0.0) & np.isfinite(size + load))
        peak = np.asarray(averaged(law).peak_slope(law, size[rows]))
        near = load[rows] * peak > _LESS * bearing.damping
        rows, peak = rows[near], peak[near]
        cusp = slope_surface(law, np.ones(rows.size), size[rows])
        result[rows] = cusp < (1.0 - _SAME) * peak
    return result


def slides_steadily(field: SlipField) -> BoolArray:
    """Where a small disturbance of steady sliding dies out."""
    growth = -field.force * field.speed * np.asarray(field.law.slope(field.speed))
    return np.asarray(growth < field.damping)


class _Round(NamedTuple):
    """One slip phase behind the belt and, where the lining overtakes it, one ahead of it.

    Attributes:
        end: How it ended.
        place: Displacement as the lining falls behind the belt again.
        turns: Displacement at the turns behind the belt.
        time: How long it took.
        over: Displacement at which the lining overtook the belt; ``nan``: it did not.
        divergence: Integral of the flow's divergence.
    """

    end: IndexArray
    place: FloatArray
    turns: FloatArray
    time: FloatArray
    over: FloatArray
    divergence: FloatArray


def _stroke(field: SlipField) -> FloatArray:
    """From one stick limit to the other."""
    return -2.0 * field.force * law_in_use(field.law).hold


def _rounds(field: SlipField, start: FloatArray, weigh: bool) -> _Round:
    route = Route(3, _ERROR, contact=True, weigh=weigh)
    behind = follow(field, start, np.zeros(start.size), route)
    end, place, time = behind.end.copy(), behind.place.copy(), behind.time.copy()
    divergence, stroke = behind.divergence.copy(), _stroke(field)
    over = np.full(start.size, np.nan)
    rows = np.flatnonzero((end == LANDED) & (place < stroke))
    if rows.size:
        over[rows] = place[rows]
        # Ahead of the belt the motion is the mirror image about the middle of the stick limits.
        begin = stroke[rows] - place[rows]
        route = Route(0, _ERROR, contact=True, weigh=weigh)
        ahead = follow(field.take(rows).ahead_of_belt(), begin, np.zeros(rows.size), route)
        end[rows], place[rows] = ahead.end, stroke[rows] - ahead.place
        time[rows] += ahead.time
        divergence[rows] += ahead.divergence
    return _Round(end, place, behind.turns, time, over, divergence)


def _through_belt(field: SlipField, weigh: bool) -> FoundCycles:
    """The stable cycles that reach the belt's speed."""
    nothing = np.zeros(field.speed.size)
    one = _rounds(field, nothing, False)
    kind = np.where(one.end == EXHAUSTED, UNRESOLVED, NO_CYCLE)
    found = absent_cycles(kind)
    landed = one.end == LANDED
    sticks = landed & ((one.place <= 0.0) | np.isnan(one.over))
    sticking = np.maximum(-one.place, 0.0)
    stuck = FoundCycles(
        nothing + STICK_SLIP, one.turns[0], one.turns[1], one.time, sticking, nothing, nothing - np.inf
    )
    put_cycles(found, sticks, _some(stuck, sticks))
    rows = np.flatnonzero(landed & ~sticks)
    if rows.size:
        put_cycles(found, rows, _overtaking(field.take(rows), one.place[rows], weigh))
    return found


def reach_belt(bearing: Bearing, speed: FloatArray, load: FloatArray) -> BoolArray:
    """Where the slip phase from breakaway meets the belt, whatever comes then.

    Args:
        bearing: The bearing.
        speed: ``|V|`` > 0, shape (n,) [m/s].
        load: ``N`` > 0, shape (n,) [N].
    """
    nothing, route = np.zeros(speed.size), Route(3, _ERROR, contact=True, locate=False)
    with np.errstate(all='ignore'):
        field = slip_field(bearing, np.abs(speed), load)
        return np.asarray(follow(field, nothing, nothing, route).end == LANDED)


def _overtaking(field: SlipField, first: FloatArray, weigh: bool) -> FoundCycles:
    """Cycles that pass the belt's speed twice and are never held: fixed points of a round.

    The round that started at breakaway ended beyond it, at ``first`` > 0; orbits do not cross, so
    the fixed point lies beyond that.
    """

    def gain(start: FloatArray, rows: IndexArray) -> FloatArray:
        return _rounds(field.take(rows), start, False).place - start

    rows, high, jump = np.arange(first.size), 2.0 * first, field.offset
    top = gain(high, rows)
    for _ in range(_QUADRUPLINGS):
        more = np.flatnonzero(top > 0.0)
        if not more.size:
            break
        high[more] *= 4.0
        top[more] = gain(high[more], more)
    start = root_on_bracket(gain, first, high, (gain(first, rows), top), (rows,))
    one, stroke = _rounds(field, start, weigh), _stroke(field)
    # The flow jumps where friction reverses.
    jumps = (one.over - stroke - jump) / (one.over + jump)
    jumps *= (start + jump) / (start - stroke - jump)
    nothing = np.zeros(first.size)
    exponent = one.divergence + np.log(np.abs(jumps))
    found = FoundCycles(nothing + OVERTAKING, one.turns[0], one.turns[1], one.time, nothing, start, exponent)
    lost = np.flatnonzero((one.end != LANDED) | np.isnan(one.over))
    put_cycles(found, lost, absent_cycles(np.full(lost.size, UNRESOLVED)))
    return found


def _pure_slip(field: SlipField, stable: bool, weigh: bool) -> FoundCycles:
    """Cycles about steady sliding whose lining never reaches the belt's speed.

    The largest stable one, or the smallest unstable one.
    """
    found = absent_cycles(np.full(field.speed.size, NO_CYCLE))
    # The amplitude of the orbit that grazes the belt, by going back in time from there.
    outer = follow(field, -field.offset, np.zeros(field.speed.size), Route(1, _ERROR, -1.0))
    found.kind[outer.end == EXHAUSTED] = UNRESOLVED
    largest = field.rest() - outer.turns[0]
    rows = np.flatnonzero((outer.end == TURNED) & (largest > 0.0))
    if not rows.size:
        return found
    around, largest = field.take(rows).about_steady_sliding(), largest[rows]

    def gain(a: FloatArray, which: IndexArray) -> FloatArray:
        """Relative gain of energy in a turn, > 0 outward."""
        turn = follow(around.take(which), -a, np.zeros(a.size), Route(2, _ERROR, -1.0))
        # An orbit that came from far outside has lost energy on the way.
        change = (1.0 + turn.place / a) * (1.0 - turn.place / a)
        return np.where(turn.end == TURNED, change, -1.0)

    shares = np.append(1e-3 / _PANELS, np.arange(1, _PANELS + 1) / _PANELS)
    grid = largest[:, None] * shares
    gains = gain(grid.ravel(), np.repeat(np.arange(rows.size), shares.size)).reshape(grid.shape)
    changes = _changes(gains, stable)
    some = np.flatnonzero(changes.any(axis=1))
    if not some.size:
        return found
    # The outermost change of a stable cycle, the innermost of an unstable one.
    first = np.argmax(changes[some], axis=1)
    last = _PANELS - 1 - np.argmax(changes[some, ::-1], axis=1)
    k = last if stable else first
    ends = gains[some, k], gains[some, k + 1]
    a = root_on_bracket(gain, grid[some, k], grid[some, k + 1], ends, (some,))
    route, nothing = Route(2, _ERROR, -1.0, weigh=weigh), np.zeros(a.size)
    turn = follow(around.take(some), -a, nothing, route)
    kind = np.where(turn.end == TURNED, float(PURE_SLIP), float(UNRESOLVED))
    cycles = FoundCycles(kind, turn.turns[0], -a, -turn.time, nothing, a, -turn.divergence)
    put_cycles(found, rows[some], cycles)
    return found


def _changes(gains: FloatArray, stable: bool) -> BoolArray:
    """Panels in which a gain of energy becomes a loss, or a loss a gain."""
    wanted = 1.0 if stable else -1.0
    changes = (wanted * gains[:, :-1] > 0.0) & (wanted * gains[:, 1:] <= 0.0)
    if not stable:  # close to the fold of a stiff law the cycle is the grazing orbit itself
        grazes = (gains[:, -2] < 0.0) & (np.abs(gains[:, -1]) < _BALANCED)
        changes[:, -1] |= grazes
        gains[grazes, -1] = 0.0
    return changes


def amplitudes_together(bearing: Bearing, speed: FloatArray, load: FloatArray) -> FloatArray:
    """Half the peak-to-peak displacement of the stable cycles [m]; ``nan`` where there are none.

    Args:
        bearing: The bearing.
        speed: Shape (n,) [m/s].
        load: Shape (n,) [N].
    """
    stroke = np.full(speed.size, np.nan)
    rows = np.flatnonzero(why_no_cycles(bearing, speed, load) == STICK_SLIP)
    for first in range(0, rows.size, _BLOCK):
        part = rows[first : first + _BLOCK]
        with np.errstate(all='ignore'):
            stroke[part] = _sticking_strokes(slip_field(bearing, np.abs(speed[part]), load[part]))
    rest = rows[np.isnan(stroke[rows])]
    found = cycles_together(bearing, speed[rest], load[rest], stable=True, weigh=False)
    stroke[rest] = found.crest - found.trough
    amplitude: FloatArray = 0.5 * stroke * np.abs(speed)
    return amplitude / bearing.natural_frequency


def _sticking_strokes(field: SlipField) -> FloatArray:
    """From turn to turn of the cycles that certainly stick; ``nan`` for all others."""
    nothing = np.zeros(field.speed.size)
    route = Route(3, _OF_AMPLITUDES, contact=True, locate=False)
    one = follow(field, nothing, nothing, route)
    stroke = _stroke(field)
    sticks = (one.end == LANDED) & (one.place >= stroke + _ROUGHLY * (1.0 - stroke))
    return np.where(sticks, one.turns[0] - one.turns[1], np.nan)
