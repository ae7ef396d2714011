# SPDX-License-Identifier: Apache-2.0
"""The stable cycles of flat arrays of points, in units of ``V`` and ``1/omega``.

Every stick-slip cycle leaves the stick limit at one and the same point, so it costs one slip
phase. Where that ends too fast for the belt to hold the lining, the lining overtakes the belt;
if it is not held then either, the cycle is a fixed point of such rounds.

The exact fold: the last speed at which the slip phase meets the belt.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stickslip_monitor.arrays import BoolArray, FloatArray, IndexArray
from stickslip_monitor.physics.cycle.law import breakaway, scaled, static_force
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
from stickslip_monitor.physics.friction import Stribeck
from stickslip_monitor.physics.oscillator import Bearing
from stickslip_monitor.physics.roots import costly_root
from stickslip_monitor.physics.slip_phase import grazing_margin

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
    start = costly_root(gain, first, high)
    turn = slip_round_trip(bearing, v, n, start)
    closed = turn.over & ~turn.stuck & (turn.ahead_end() == End.CONTACT)
    closed[open_] = False
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


# Speeds in units of a guess between which the last cycle is looked for: where averaging or
# Coulomb's law tells it, and where neither does.
_NEAR = np.array([0.3, 0.6, 0.9, 0.98, 0.998, 0.99998, 1.0001, 1.002, 1.02, 1.1, 1.4, 2.5])
_BELOW = (1e-3, 0.01, 0.03, 0.1, 0.2, 0.4, 0.6, 0.8, 0.9, 0.97, 0.99, 0.998)
_ABOVE = (1.0005, 1.005, 1.03, 1.1, 1.25, 1.7, 2.5, 5.0, 10.0, 30.0, 100.0, 1e3)
_FAR = np.array([*_BELOW, *_ABOVE])
# The coarse search: speeds, how far beyond the scales of the law, and how often divided by what.
_SPEEDS, _SPREAD, _ROUNDS, _PARTS = 64, 100.0, 6, 16
# How far the coarse fold may be off.
_COARSE = 1e-5
# Exponent beyond which a motion dies out within a turn.


def grazing(bearing: Bearing, speed: FloatArray, load: FloatArray) -> FloatArray:
    """Signed distance of the slip phase from grazing, > 0 where it meets the belt, shape (n,)."""
    local = setting(bearing, speed, load, FORWARD)
    return follow(FORWARD, local, np.zeros(speed.size), np.zeros(speed.size)).margin


def coulomb_fold(bearing: Bearing, load: FloatArray) -> FloatArray:
    """The fold [m/s] of a law that falls at once, from one turn of the free vibration.

    It starts ``N Delta/k`` from its middle at the belt's speed, and must have that speed again
    when it has lost ``exp(-2 pi zeta)`` of its amplitude: right to some percent.
    """
    law, momentum = bearing.friction, bearing.mass * bearing.natural_frequency
    viscous = law.viscous if isinstance(law, Stribeck) else 0.0
    steady = float(law.coefficient(_SPREAD * max(law.breakpoints, default=1.0)))
    kinetic = law.kinetic if isinstance(law, Stribeck) else steady
    damping = bearing.damping_ratio + 0.5 * viscous * load / momentum
    lost = np.expm1(np.minimum(4.0 * np.pi * damping, _LARGEST))
    with np.errstate(all='ignore'):
        fold: FloatArray = max(breakaway(law) - kinetic, 0.0) * load / momentum / np.sqrt(lost)
    return fold


def fold(bearing: Bearing, load: FloatArray, averaged: FloatArray) -> FloatArray:
    """The last speed [m/s] with a stick-slip cycle, where its slip phase grazes the belt.

    Args:
        bearing: The bearing.
        load: ``N`` > 0 [N], shape (n,).
        averaged: The fold of averaging [m/s], shape (n,).

    Returns:
        ``nan`` where no speed has a cycle, ``inf`` where none is the last, shape (n,).
    """
    out = np.full(load.size, np.nan)
    guess = guessed_fold(bearing, load, averaged)
    index = np.flatnonzero(can_gain(bearing, load) & (guess > 0.0))
    # Without damping a cycle gains energy at every speed, and averaging says so exactly.
    out[index] = np.inf
    index = index[np.isfinite(guess[index])]
    for ratios in (_NEAR, _FAR):
        if not index.size:
            break
        grid = guess[index, None] * ratios
        loads = np.repeat(load[index], ratios.size)
        hit = grazing(bearing, grid.ravel(), loads).reshape(grid.shape) > 0.0
        last = _last(hit)
        found = (last >= 0) & (last < ratios.size - 1)
        out[index[~found]] = np.where(last[~found] < 0, np.nan, np.inf)
        where, last = index[found], last[found]
        low, high = grid[found, last], grid[found, last + 1]
        out[where] = _grazed(bearing, load[where], low, high)
        index = index[~found]
    return out


def _last(hit: BoolArray) -> IndexArray:
    """The last column that is set in each row, -1 for none, shape (n,)."""
    last = hit.shape[1] - 1 - np.argmax(hit[:, ::-1], axis=1)
    return np.where(hit.any(axis=1), last, -1)


def guessed_fold(bearing: Bearing, load: FloatArray, averaged: FloatArray) -> FloatArray:
    """The fold that averaging or Coulomb's law gives, whichever is higher [m/s], shape (n,)."""
    return np.fmax(averaged, coulomb_fold(bearing, load))


def coarse_fold(bearing: Bearing, load: FloatArray, guess: FloatArray | None = None) -> FloatArray:
    """:func:`fold` of any law by search, to some 1e-6, at a cost that hardly depends on the law.

    Args:
        bearing: The bearing.
        load: ``N`` > 0 [N], shape (n,).
        guess: Of :func:`guessed_fold`, where one is near enough, shape (n,).
    """
    out = np.full(load.size, np.nan)
    index = np.flatnonzero(can_gain(bearing, load))
    if guess is None:
        speeds, parts = _scales(bearing, load[index]), _SPEEDS
        low, high = speeds.min(axis=1) / _SPREAD, _SPREAD * speeds.max(axis=1)
    else:
        low, high, parts = _NEAR[0] * guess[index], _NEAR[-1] * guess[index], _PARTS
    for _ in range(_ROUNDS if index.size else 0):
        grid = low[:, None] * (high / low)[:, None] ** (np.arange(parts + 1) / parts)
        loads = np.repeat(load[index], parts + 1)
        hit = grazing_margin(bearing, grid.ravel(), loads).reshape(grid.shape) > 0.0
        last = _last(hit)
        out[index[last == parts]] = np.inf
        found = np.flatnonzero((last >= 0) & (last < parts))
        index, last, parts = index[found], last[found], _PARTS
        low, high = grid[found, last], grid[found, last + 1]
    out[index] = low
    return out


def _scales(bearing: Bearing, load: FloatArray) -> FloatArray:
    """Speeds about which a law can have its fold [m/s], shape (n, 1 to 3)."""
    breaks = bearing.friction.breakpoints
    ends = np.array([*breaks[:1], *breaks[-1:]])
    jump = coulomb_fold(bearing, load)
    usual = ends.max(initial=0.0) or 1.0
    jump = np.where((jump > 0.0) & np.isfinite(jump), jump, usual)
    return np.concatenate([np.broadcast_to(ends, (load.size, ends.size)), jump[:, None]], axis=1)


def polished_fold(bearing: Bearing, load: FloatArray) -> FloatArray:
    """:func:`fold` of any law, from the coarse one; arguments as there."""
    out = coarse_fold(bearing, load)
    rows = np.flatnonzero(np.isfinite(out))
    low, high = out[rows] * (1.0 - _COARSE), out[rows] * (1.0 + _COARSE)
    brackets = (grazing(bearing, low, load[rows]) > 0.0) & ~(
        grazing(bearing, high, load[rows]) > 0.0
    )
    where = rows[brackets]
    out[where] = _grazed(bearing, load[where], low[brackets], high[brackets])
    return out


def _grazed(bearing: Bearing, load: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
    """The speeds between two at which the slip phase just grazes the belt [m/s], shape (n,)."""
    return costly_root(lambda v, rows: grazing(bearing, v, load[rows]), low, high)
