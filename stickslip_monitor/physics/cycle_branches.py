# SPDX-License-Identifier: Apache-2.0
"""The exact cycles of flat arrays of points, in units of ``V`` and ``1/omega``.

Every stick-slip cycle leaves the stick limit at one and the same point, so it costs one slip
phase. The pure-slip cycles are the fixed points of the return map on ``x' = 0``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stickslip_monitor.physics.cycle_laws import (
    Index,
    scaled,
    starting_piece,
    static_force,
    steepest_fall,
)
from stickslip_monitor.physics.cycle_orbit import (
    AROUND,
    BACKWARD,
    FORWARD,
    REVERSE,
    End,
    Flags,
    Frame,
    Orbits,
    Setting,
    Stretch,
    follow,
)
from stickslip_monitor.physics.friction import Array
from stickslip_monitor.physics.cycle_roots import costly_root
from stickslip_monitor.physics.oscillator import Bearing
from stickslip_monitor.physics.slip import Motion

# Panels in which a sign change of the energy gain is looked for.
_GRID = 24
# Speeds in units of a guess between which the last cycle is looked for: averaging is off by some
# 1e-4 to 1e-2 at moderate load, by orders of magnitude where a cycle is far from harmonic.
_RATIOS = np.array(
    [1e-3, 0.01, 0.03, 0.1, 0.2, 0.4, 0.6, 0.8, 0.9, 0.97, 0.99, 0.998]
    + [1.0005, 1.005, 1.03, 1.1, 1.25, 1.7, 2.5, 5.0, 10.0, 30.0, 100.0, 1e3]
)
_LARGEST = 700.0
# Fourfold increases in search of the far side of an overtaking cycle.
_DOUBLINGS = 40
# Beyond this friction force, in units of m omega V, the numbers run out.
_GREATEST = 1e150


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

    exists: Flags
    resolved: Flags
    start: Array
    crest: Array
    trough: Array
    slip: Array
    stick: Array
    multiplier: Array
    evaluations: Index


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
    over: Flags
    ahead: Orbits
    e: Array
    stuck: Flags

    def ahead_end(self) -> Index:
        """How the phase ahead of the belt ended; ``EXHAUSTED`` where there was none."""
        end = np.zeros(self.e.size, dtype=np.intp)
        end[self.over] = self.ahead.end
        return end


def setting(bearing: Bearing, speed: Array, load: Array, frame: Frame) -> Setting:
    """What the orbits of a frame move in.

    Args:
        bearing: The bearing.
        speed: ``V`` > 0 [m/s], shape (n,).
        load: ``N`` > 0 [N], shape (n,).
        frame: Of the orbits.
    """
    every = np.arange(speed.size)
    force = _force(bearing, speed, load)
    damping = np.full(speed.size, bearing.damping_ratio)
    breakaway = scaled(bearing.friction, force, speed, 0.0)
    steady = breakaway.take(every, starting_piece(breakaway, speed, 1.0))
    one = np.ones((speed.size, 1))
    pull, slope = steady.rise(one)[:, 0], steady.slope(one)[:, 0]
    rest, hold = 2.0 * damping - pull, -breakaway.jump
    around = frame.drift == 0.0
    law = scaled(bearing.friction, force, speed, 1.0) if around else breakaway
    return Setting(
        motion=Motion(law, damping, frame.drift),
        piece=starting_piece(breakaway, speed, frame.reference),
        edges=law.pieces,
        speed=speed,
        pull=np.zeros_like(pull) if around else pull,
        rest=np.zeros_like(rest) if around else rest,
        stable=slope < 2.0 * damping,
        hold=hold - rest if around else hold,
    )


def _force(bearing: Bearing, speed: Array, load: Array) -> Array:
    with np.errstate(over='ignore'):
        return load / (bearing.mass * bearing.natural_frequency * speed)


def can_gain(bearing: Bearing, load: Array) -> Flags:
    """Whether friction falls faster than damping rises at any speed, shape (n,).

    Where it does not, the flow contracts everywhere and has no cycle (Bendixson's criterion).
    """
    drive = np.asarray(steepest_fall(bearing.friction))
    gains: Flags = np.where(load > 0.0, load * drive, 0.0) > bearing.damping
    return gains


def go_round(
    bearing: Bearing,
    speed: Array,
    load: Array,
    start: Array,
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
    stroke = -2.0 * static_force(bearing.friction, _force(bearing, speed, load))
    contact = behind.end == End.CONTACT
    over = contact & (behind.e < stroke)
    # Ahead of the belt the motion is the mirror image about the middle of the two stick limits.
    local = setting(bearing, speed[over], load[over], REVERSE)
    ahead = follow(REVERSE, local, (stroke - behind.e)[over], rest[over], second)
    e, landed = behind.e.copy(), contact.copy()
    e[over], landed[over] = stroke[over] - ahead.e, ahead.end == End.CONTACT
    return Round(behind, over, ahead, e, landed & (e <= 0.0) & (e >= stroke))


def _runnable(bearing: Bearing, speed: Array, load: Array) -> Index:
    return np.flatnonzero(
        can_gain(bearing, load) & (_force(bearing, speed, load) < _GREATEST)
    )


def stick_slip(bearing: Bearing, speed: Array, load: Array) -> StickSlip:
    """The stable cycle of every point that reaches the belt's speed.

    Args:
        bearing: The bearing.
        speed: ``V`` > 0 [m/s], shape (n,).
        load: ``N`` > 0 [N], shape (n,).
    """
    n = speed.size
    blank = [np.full(n, np.nan) for _ in range(6)]
    flags, spent = ~can_gain(bearing, load), np.zeros(n, dtype=np.intp)
    out = StickSlip(np.zeros(n, dtype=bool), flags, *blank, spent)  # type: ignore[call-arg]
    index = _runnable(bearing, speed, load)
    start = np.zeros(index.size)
    turn = go_round(bearing, speed[index], load[index], start)
    _book(out, index, turn, turn.stuck, start)
    ends = turn.behind.end
    out.resolved[index] |= turn.stuck | (ends == End.MISSED) | (ends == End.SETTLED)
    loose = np.flatnonzero(turn.over & ~turn.stuck & (turn.e > 0.0))
    if loose.size:
        _overtaking(bearing, speed, load, out, index[loose], turn.e[loose])
    return out


def _book(out: StickSlip, index: Index, turn: Round, closed: Flags, start: Array) -> None:
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
    bearing: Bearing, speed: Array, load: Array, out: StickSlip, index: Index, first: Array
) -> None:
    """Cycles that pass the belt's speed twice and are never held: fixed points of a round.

    The round that started at breakaway ended beyond it, at ``first`` > 0; orbits do not cross,
    so the fixed point lies beyond that.
    """
    v, n = speed[index], load[index]

    def gain(start: Array, rows: Index) -> Array:
        turn = go_round(bearing, v[rows], n[rows], start)
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
    turn = go_round(bearing, v, n, start)
    closed = turn.over & ~turn.stuck & (turn.ahead_end() == End.CONTACT)
    closed[open_] = False
    _book(out, index, turn, closed, start)
    out.stick[index[closed]] = 0.0
    out.multiplier[index[closed]] = _overtaking_multiplier(bearing, v, n, start, turn)[closed]


def _overtaking_multiplier(
    bearing: Bearing, speed: Array, load: Array, start: Array, turn: Round
) -> Array:
    """``exp`` of the divergence times the jumps of the flow where friction reverses."""
    force = _force(bearing, speed, load)
    stroke = -2.0 * static_force(bearing.friction, force)
    jump = scaled(bearing.friction, force, speed, 0.0).jump
    e = turn.behind.e
    divergence = turn.behind.divergence.copy()
    divergence[turn.over] += turn.ahead.divergence
    crossings = (e - stroke - jump) / (e + jump) * (start + jump) / (start - stroke - jump)
    # Only orbits that do not close can grow without bounds.
    result: Array = np.exp(np.minimum(divergence, _LARGEST)) * crossings
    return result


@dataclass(slots=True)
class PureSlip:
    """Pure-slip cycles; every array has shape (n,), ``nan`` where there is none.

    Attributes:
        exists: Whether there is one.
        trough: Displacement below steady sliding at the turning point, > 0.
        crest: Displacement above it.
        period: Its duration.
        multiplier: Floquet multiplier, > 1 for an unstable cycle.
        evaluations: Evaluations of the law, one for all nodes of a step together.
    """

    exists: Flags
    trough: Array
    crest: Array
    period: Array
    multiplier: Array
    evaluations: Index


def _turns(
    whole: Setting, index: Index, amplitude: Array, spent: Index
) -> tuple[Orbits, Array]:
    """One turn about steady sliding and its relative gain of energy, > 0 outward."""
    orbits = follow(AROUND, whole.take(index), -amplitude, np.zeros(index.size))
    np.add.at(spent, index, orbits.evaluations)
    gain = -2.0 * orbits.work / (amplitude * amplitude)
    # An orbit that came from far outside has lost energy on the way.
    return orbits, np.where(orbits.end == End.RETURNED, gain, -1.0)


def _outermost(bearing: Bearing, speed: Array, load: Array) -> Array:
    """Turning point of the orbit that grazes the belt, by going back in time from there."""
    local = setting(bearing, speed, load, BACKWARD)
    orbits = follow(BACKWARD, local, local.hold, np.zeros(speed.size))
    turned = orbits.end == End.RETURNED
    return np.where(turned, local.rest - orbits.e, np.nan)


def pure_slip(bearing: Bearing, speed: Array, load: Array) -> PureSlip:
    """The unstable pure-slip cycle that bounds the basin of steady sliding, if there is one.

    Args:
        bearing: The bearing.
        speed: ``V`` > 0 [m/s], shape (n,).
        load: ``N`` > 0 [N], shape (n,).
    """
    n = speed.size
    missing = (np.full(n, np.nan) for _ in range(4))
    out = PureSlip(np.zeros(n, dtype=bool), *missing, np.zeros(n, dtype=np.intp))
    usable = _runnable(bearing, speed, load)
    if not usable.size:
        return out
    speed, load = speed[usable], load[usable]
    whole = setting(bearing, speed, load, AROUND)
    largest = np.where(whole.stable, _outermost(bearing, speed, load), np.nan)
    spent = np.zeros(usable.size, dtype=np.intp)
    low, high = _bracket(whole, largest, spent)
    out.evaluations[usable] = spent
    index = np.flatnonzero(np.isfinite(low))
    if not index.size:
        return out
    amplitude = costly_root(
        lambda a, rows: _turns(whole, index[rows], a, spent)[1], low[index], high[index]
    )
    orbits, _ = _turns(whole, index, amplitude, spent)
    out.evaluations[usable] = spent
    closed = orbits.end == End.RETURNED
    where = usable[index[closed]]
    out.exists[where] = True
    out.trough[where], out.crest[where] = amplitude[closed], orbits.crest[closed]
    out.period[where] = -orbits.time[closed]
    out.multiplier[where] = np.exp(np.minimum(-orbits.divergence[closed], _LARGEST))
    return out


def _bracket(whole: Setting, largest: Array, spent: Index) -> tuple[Array, Array]:
    """Amplitudes around the smallest orbit at which a loss of energy becomes a gain."""
    n = largest.size
    low, high = np.full(n, np.nan), np.full(n, np.nan)
    usable = np.flatnonzero(largest > 0.0)
    if not usable.size:
        return low, high
    share = np.arange(1, _GRID + 1) / _GRID
    grid = largest[usable, None] * share
    _, gain = _turns(whole, np.repeat(usable, _GRID), grid.ravel(), spent)
    outward = gain.reshape(grid.shape) > 0.0
    found = np.flatnonzero(outward.any(axis=1))
    first = np.argmax(outward[found], axis=1)
    where = usable[found]
    high[where] = grid[found, first]
    # Steady sliding itself is stable, so the first panel starts with a loss.
    low[where] = np.where(first > 0, grid[found, first - 1], 1e-3 * high[where])
    return low, high


def grazing(bearing: Bearing, speed: Array, load: Array) -> Array:
    """Signed distance of the slip phase from grazing, > 0 where it meets the belt, shape (n,)."""
    local = setting(bearing, speed, load, FORWARD)
    return follow(FORWARD, local, np.zeros(speed.size), np.zeros(speed.size)).margin


def fold(bearing: Bearing, load: Array, guess: Array) -> Array:
    """The last speed [m/s] with a stick-slip cycle, where its slip phase grazes the belt.

    Args:
        bearing: The bearing.
        load: ``N`` > 0 [N], shape (n,).
        guess: The fold of averaging [m/s], or another scale of the speed, finite, shape (n,).

    Returns:
        ``nan`` where no speed has a cycle, ``inf`` where none is the last, shape (n,).
    """
    out = np.full(load.size, np.nan)
    index = np.flatnonzero(can_gain(bearing, load))
    if not index.size:
        return out
    grid = guess[index, None] * _RATIOS
    loads = np.repeat(load[index], _RATIOS.size)
    hit = grazing(bearing, grid.ravel(), loads).reshape(grid.shape) > 0.0
    last = _RATIOS.size - 1 - np.argmax(hit[:, ::-1], axis=1)
    out[index[hit[:, -1]]] = np.inf
    rows = np.flatnonzero(hit.any(axis=1) & ~hit[:, -1])
    found, last = index[rows], last[rows]
    if found.size:
        out[found] = costly_root(
            lambda v, where: grazing(bearing, v, load[found[where]]),
            grid[rows, last],
            grid[rows, last + 1],
        )
    return out
