# SPDX-License-Identifier: Apache-2.0
"""The stable cycles of flat arrays of points, in units of ``V`` and ``1/omega``.

Every stick-slip cycle leaves the stick limit at one and the same point, so it costs one slip
phase. Where that ends too fast for the belt to hold the lining, the lining overtakes the belt;
if it is not held then either, the cycle is a fixed point of such rounds.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stickslip_monitor.arrays import BoolArray, FloatArray, IndexArray
from stickslip_monitor.physics.cycle.law import scaled, static_force
from stickslip_monitor.physics.cycle.orbit import follow
from stickslip_monitor.physics.cycle.setting import (
    FORWARD,
    REVERSE,
    End,
    Orbits,
    Stretch,
    can_gain,
    friction_force,
    runnable,
    setting,
)
from stickslip_monitor.physics.oscillator import Bearing
from stickslip_monitor.physics.roots import costly_root

# Exponent beyond which a Floquet multiplier is as good as infinite.
_LARGEST = 700.0
# Fourfold increases in search of the far side of an overtaking cycle.
_DOUBLINGS = 40


@dataclass(slots=True)
class StickSlip:
    """Cycles through the belt's speed; every array has shape (n,).

    Attributes:
        exists: Whether there is one.
        resolved: Whether that is known.
        start: Displacement at which the lining falls behind the belt, 0 with stick.
        crest: Largest displacement, counted from breakaway.
        trough: Smallest.
        slip: Duration of the slip phases.
        stick: Duration of the stick phase.
        multiplier: Floquet multiplier.
        evaluations: Evaluations of the law, one for all nodes of a step together.
    """

    exists: BoolArray
    resolved: BoolArray
    start: FloatArray
    crest: FloatArray
    trough: FloatArray
    slip: FloatArray
    stick: FloatArray
    multiplier: FloatArray
    evaluations: IndexArray


@dataclass(frozen=True, slots=True)
class Round:
    """One slip phase behind the belt and, where it overtakes the belt, one ahead of it.

    Attributes:
        behind: The first.
        over: Whether the lining overtook the belt, shape (n,).
        ahead: The second, of those that did.
        e: Displacement at the end, shape (n,).
        stuck: Whether the belt holds the lining there, shape (n,).
    """

    behind: Orbits
    over: BoolArray
    ahead: Orbits
    e: FloatArray
    stuck: BoolArray

    def ahead_end(self) -> IndexArray:
        """How the phase ahead of the belt ended; ``EXHAUSTED`` where there was none."""
        end = np.zeros(self.e.size, dtype=np.intp)
        end[self.over] = self.ahead.end
        return end


def slip_round_trip(
    bearing: Bearing,
    speed: FloatArray,
    load: FloatArray,
    start: FloatArray,
    records: tuple[list[Stretch], list[Stretch]] | None = None,
) -> Round:
    """Let the lining fall behind the belt and follow it until it has caught up with it.

    Args:
        bearing: The bearing.
        speed: ``V`` > 0 [m/s], shape (n,).
        load: ``N`` > 0 [N], shape (n,).
        start: Displacement beyond breakaway at the start, >= 0, shape (n,).
        records: Take the steps behind and ahead of the belt.
    """
    first, second = (None, None) if records is None else records
    rest = np.zeros(speed.size)
    behind = follow(FORWARD, setting(bearing, speed, load, FORWARD), start, rest, first)
    stroke = -2.0 * static_force(bearing.friction, friction_force(bearing, speed, load))
    contact = behind.end == End.CONTACT
    over = contact & (behind.e < stroke)
    # Ahead of the belt the motion is the mirror image about the middle of the two stick limits.
    local = setting(bearing, speed[over], load[over], REVERSE)
    ahead = follow(REVERSE, local, (stroke - behind.e)[over], rest[over], second)
    e, landed = behind.e.copy(), contact.copy()
    e[over], landed[over] = stroke[over] - ahead.e, ahead.end == End.CONTACT
    return Round(behind, over, ahead, e, landed & (e <= 0.0) & (e >= stroke))


def stick_slip(bearing: Bearing, speed: FloatArray, load: FloatArray) -> StickSlip:
    """The stable cycle of every point that reaches the belt's speed.

    Args:
        bearing: The bearing.
        speed: ``V`` > 0 [m/s], shape (n,).
        load: ``N`` > 0 [N], shape (n,).
    """
    n = speed.size
    out = StickSlip(
        exists=np.zeros(n, dtype=bool),
        resolved=~can_gain(bearing, load),
        start=np.full(n, np.nan),
        crest=np.full(n, np.nan),
        trough=np.full(n, np.nan),
        slip=np.full(n, np.nan),
        stick=np.full(n, np.nan),
        multiplier=np.full(n, np.nan),
        evaluations=np.zeros(n, dtype=np.intp),
    )
    index = runnable(bearing, speed, load)
    start = np.zeros(index.size)
    turn = slip_round_trip(bearing, speed[index], load[index], start)
    _book(out, index, turn, turn.stuck, start)
    ends = turn.behind.end
    out.resolved[index] |= turn.stuck | (ends == End.MISSED) | (ends == End.SETTLED)
    loose = np.flatnonzero(turn.over & ~turn.stuck & (turn.e > 0.0))
    if loose.size:
        _overtaking(bearing, speed, load, out, index[loose], turn.e[loose])
    return out


def _book(
    out: StickSlip, index: IndexArray, turn: Round, closed: BoolArray, start: FloatArray
) -> None:
    where, behind = index[closed], turn.behind
    out.exists[where] = out.resolved[where] = True
    out.start[where] = start[closed]
    out.crest[where], out.trough[where] = behind.crest[closed], behind.trough[closed]
    time = behind.time.copy()
    time[turn.over] += turn.ahead.time
    out.slip[where], out.stick[where] = time[closed], np.maximum(-turn.e[closed], 0.0)
    out.multiplier[where] = 0.0
    out.evaluations[index] += behind.evaluations
    out.evaluations[index[turn.over]] += turn.ahead.evaluations


def _overtaking(
    bearing: Bearing,
    speed: FloatArray,
    load: FloatArray,
    out: StickSlip,
    index: IndexArray,
    first: FloatArray,
) -> None:
    """Cycles that pass the belt's speed twice and are never held: fixed points of a round.

    The round that started at breakaway ended beyond it, at ``first`` > 0; orbits do not cross,
    so the fixed point lies beyond that.
    """
    v, n = speed[index], load[index]

    def gain(start: FloatArray, rows: IndexArray) -> FloatArray:
        turn = slip_round_trip(bearing, v[rows], n[rows], start)
        np.add.at(out.evaluations, index[rows], turn.behind.evaluations)
        np.add.at(out.evaluations, index[rows[turn.over]], turn.ahead.evaluations)
        return turn.e - start

    high = 2.0 * first
    open_ = np.arange(index.size)
    for _ in range(_DOUBLINGS):
        open_ = open_[gain(high[open_], open_) > 0.0]
        if not open_.size:
            break
        high[open_] *= 4.0
    roots = costly_root(gain, first, high)
    start = roots.value
    turn = slip_round_trip(bearing, v, n, start)
    closed = turn.over & ~turn.stuck & (turn.ahead_end() == End.CONTACT)
    closed &= roots.converged
    _book(out, index, turn, closed, start)
    out.stick[index[closed]] = 0.0
    out.multiplier[index[closed]] = _overtaking_multiplier(bearing, v, n, start, turn)[closed]


def _overtaking_multiplier(
    bearing: Bearing, speed: FloatArray, load: FloatArray, start: FloatArray, turn: Round
) -> FloatArray:
    """``exp`` of the divergence times the jumps of the flow where friction reverses."""
    force = friction_force(bearing, speed, load)
    stroke = -2.0 * static_force(bearing.friction, force)
    jump = scaled(bearing.friction, force, speed, 0.0).jump
    e = turn.behind.e
    divergence = turn.behind.divergence.copy()
    divergence[turn.over] += turn.ahead.divergence
    crossings = (e - stroke - jump) / (e + jump) * (start + jump) / (start - stroke - jump)
    # Only orbits that do not close can grow without bounds.
    result: FloatArray = np.exp(np.minimum(divergence, _LARGEST)) * crossings
    return result
