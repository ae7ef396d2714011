# SPDX-License-Identifier: Apache-2.0
"""Orbits of the slip phase, followed from event to event, many at once.

An orbit turns where the lining's own velocity vanishes (relative speed ``w = 1``) and ends where
it meets the belt (``w = 0``) or is known to miss it. The contact is looked for only after the
turning point before it, on the polynomial of the step, so no step can jump over it. Whether there
is one is decided where the displacement passes the level at which the belt could just hold the
lining: there the kinetic energy, integrated along the orbit, tells hit from miss without the
cancellation of two nearly equal velocities.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from stickslip_monitor.physics.cycle_laws import Index
from stickslip_monitor.physics.friction import Array
from stickslip_monitor.physics.rootfinding import secant_on_bracket
from stickslip_monitor.physics.slip import (
    NODES,
    SAMPLES,
    TOLERANCE,
    Motion,
    Step,
    at_samples,
    integral,
    solve_step,
    value,
)

Flags = NDArray[np.bool_]

_STEPS = 4000
# Orbits followed together: arrays that stay in the cache, and products of matrices too small for
# a linear algebra library to start its threads, which costs more than it gains.
_BLOCK = 512
_LONGEST, _SHORTEST = 1.0, 1e-13
_GROWTH, _SHRINK = 2.5, 0.2
# Share of the energy at the start below which an orbit that does not turn has come to rest.
_SETTLED = 1e-12
# Growth of energy, back in time, from which no orbit comes back; way beyond the belt, likewise.
_ESCAPED, _THROUGH = 1e12, 1e-3
# Displacement about steady sliding, in units of V/omega, to which energies count as well known.
_SMALL = 2.0
# Relative overshoot of an edge between smooth pieces that is rounding.
_ROUNDING = 1e-13


class End(IntEnum):
    """How an orbit ended."""

    EXHAUSTED = 0  # the steps became too short or too many
    CONTACT = 1  # the lining met the belt
    MISSED = 2  # it turned back before
    RETURNED = 3  # it came back to the kind of turning point it started from
    SETTLED = 4  # it ran into steady sliding without turning
    ESCAPED = 5  # going back in time, it has left for good


@dataclass(frozen=True, slots=True)
class Frame:
    """What an orbit starts from and what ends it.

    Turning points are counted by stages: in even stages the lining moves with the belt
    (``w < 1``), in odd ones against it.

    Attributes:
        drift: Of :class:`Motion`.
        first: Stage at the start.
        last: Stage whose beginning ends the orbit, as ``finish``.
        landing: Stage in which the lining can meet the belt; -1 if that is not looked for.
        direction: 1, or -1 to go back in time.
        finish: How the orbit ended when the last stage began.
    """

    drift: float
    first: int
    last: int
    landing: int
    direction: float
    finish: End

    @property
    def reference(self) -> float:
        """Relative speed ``w`` at ``z = 0``."""
        return 1.0 if self.drift == 0.0 else 0.0


FORWARD = Frame(1.0, 0, 3, 2, 1.0, End.MISSED)
REVERSE = Frame(-1.0, 0, 9, 0, 1.0, End.MISSED)
# Back in time an unstable cycle attracts, however fast it repels on the way forward.
AROUND = Frame(0.0, 1, 3, -1, -1.0, End.RETURNED)
BACKWARD = Frame(1.0, 0, 1, -1, -1.0, End.RETURNED)


@dataclass(frozen=True, slots=True)
class Setting:
    """What the orbits move in; every array has shape (n,).

    Attributes:
        motion: Their equations.
        piece: Smooth piece of the law at the start.
        edges: Speeds between the smooth pieces [m/s], ascending; ``None`` for a smooth law.
        speed: ``V`` [m/s].
        pull: Friction lost at steady sliding, ``rise`` at ``w = 1``.
        rest: Displacement of steady sliding.
        stable: Whether a small disturbance of steady sliding dies out.
        hold: Displacement above which the belt cannot catch the lining.
    """

    motion: Motion
    piece: Index
    edges: Array | None
    speed: Array
    pull: Array
    rest: Array
    stable: Flags
    hold: Array

    def take(self, index: Index | slice) -> Setting:
        """The setting of some of the orbits."""
        every = np.arange(self.speed.size)[index]
        return Setting(
            motion=self.motion.take(every, self.piece[every]),
            piece=self.piece[every],
            edges=self.edges,
            speed=self.speed[every],
            pull=self.pull[every],
            rest=self.rest[every],
            stable=self.stable[every],
            hold=self.hold[every],
        )


@dataclass(slots=True)
class Orbits:
    """The orbits as far as they were followed; every array has shape (n,).

    Attributes:
        e: Displacement at the end.
        z: Relative speed at the end.
        h: Next step.
        piece: Smooth piece of the law.
        stage: Turning points passed.
        end: :class:`End`.
        time: Duration, negative backwards.
        work: Energy gained about steady sliding.
        divergence: Integral of the divergence of the flow.
        crest: Displacement at the last turning point from above.
        trough: Displacement at the last turning point from below.
        margin: Signed distance from grazing: ``> 0`` where the lining met the belt.
        excess: Twice the kinetic energy at ``hold`` beyond the belt's, but for the work.
        energy: Energy about steady sliding at the start, twice.
        evaluations: Evaluations of the friction law, one for all nodes of a step together.
    """

    e: Array
    z: Array
    h: Array
    piece: Index
    stage: Index
    end: Index
    time: Array
    work: Array
    divergence: Array
    crest: Array
    trough: Array
    margin: Array
    excess: Array
    energy: Array
    evaluations: Index


@dataclass(slots=True)
class Stretch:
    """An accepted step of some orbits, as Legendre series on [-1, 1], used up to ``stop``."""

    index: Index
    time: Array
    h: Array
    e: Array
    z: Array
    work: Array
    divergence: Array
    stop: Array = field(init=False)
    end: Index = field(init=False)

    def __post_init__(self) -> None:
        self.stop = np.ones(self.index.size)
        self.end = np.zeros(self.index.size, dtype=np.intp)


def follow(
    frame: Frame, setting: Setting, e: Array, z: Array, record: list[Stretch] | None = None
) -> Orbits:
    """Follow orbits until each has ended.

    Args:
        frame: What they start from and what ends them.
        setting: What they move in.
        e: Displacement at the start, shape (n,).
        z: Relative speed at the start, shape (n,).
        record: Takes every accepted step.
    """
    if e.size <= _BLOCK:
        return _follow(frame, setting, e, z, record)
    cuts = [slice(start, start + _BLOCK) for start in range(0, e.size, _BLOCK)]
    parts = [_follow(frame, setting.take(cut), e[cut], z[cut], record) for cut in cuts]
    names = [column.name for column in fields(Orbits)]
    return Orbits(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


def _follow(
    frame: Frame, setting: Setting, e: Array, z: Array, record: list[Stretch] | None
) -> Orbits:
    with np.errstate(over='ignore', invalid='ignore', under='ignore'):
        orbits = _begin(frame, setting, e, z)
        running = np.arange(e.size)
        for _ in range(_STEPS):
            if not running.size:
                break
            running = _advance(frame, setting, orbits, running, record)
    return orbits


def _begin(frame: Frame, setting: Setting, e: Array, z: Array) -> Orbits:
    n = e.size
    law = setting.motion.take(np.arange(n), setting.piece).law
    rate = np.abs(law.slope(z[:, None])[:, 0]) + 2.0 * setting.motion.damping
    y = frame.drift - z
    return Orbits(
        e=e.copy(),
        z=z.copy(),
        h=0.1 * frame.direction / (1.0 + rate),
        piece=setting.piece.copy(),
        stage=np.full(n, frame.first, dtype=np.intp),
        end=np.zeros(n, dtype=np.intp),
        time=np.zeros(n),
        work=np.zeros(n),
        divergence=np.zeros(n),
        crest=np.full(n, np.nan),
        trough=np.full(n, np.nan),
        margin=np.full(n, -1.0),
        excess=(e - setting.hold) * (e + setting.hold - 2.0 * setting.rest) + (y * y - 1.0),
        energy=(e - setting.rest) ** 2 + y * y,
        evaluations=np.zeros(n, dtype=np.intp),
    )


def _advance(
    frame: Frame,
    setting: Setting,
    orbits: Orbits,
    running: Index,
    record: list[Stretch] | None,
) -> Index:
    """Try one step of every running orbit and return those that still run."""
    piece, h = orbits.piece[running], orbits.h[running]
    motion = setting.motion.take(running, piece)
    step = solve_step(motion, piece, orbits.e[running], orbits.z[running], h)
    orbits.evaluations[running] += step.iterations
    good = step.error <= TOLERANCE
    with np.errstate(divide='ignore'):
        factor = 0.9 * (TOLERANCE / step.error) ** (1.0 / NODES)
    factor = np.clip(factor, _SHRINK, np.where(good, _GROWTH, 0.6))
    orbits.h[running] = np.clip(h * factor, -_LONGEST, _LONGEST)
    keep = np.abs(orbits.h[running]) > _SHORTEST
    if good.any():
        stretch = _stretch(frame, setting, orbits, step, running, h, good)
        keep[good] &= _pass_events(frame, setting, orbits, stretch)
        if record is not None:
            record.append(stretch)
    return running[keep]


def _stretch(
    frame: Frame,
    setting: Setting,
    orbits: Orbits,
    step: Step,
    running: Index,
    length: Array,
    good: Flags,
) -> Stretch:
    index, h, nodes = running[good], length[good], step.z[good]
    y = frame.drift - nodes
    damping = 2.0 * setting.motion.damping[index][:, None]
    power = y * (setting.pull[index][:, None] - step.rise[good] - damping * y)
    law = setting.motion.law.take(index, orbits.piece[index])
    return Stretch(
        index=index,
        time=orbits.time[index],
        h=h,
        e=integral(orbits.e[index], y, h),
        z=integral(orbits.z[index], step.rate[good], h),
        work=integral(orbits.work[index], power, h),
        divergence=integral(orbits.divergence[index], law.slope(nodes) - damping, h),
    )


def _pass_events(frame: Frame, setting: Setting, orbits: Orbits, stretch: Stretch) -> Flags:
    """Cut the stretch at its events, move the orbits to its end, return which still run."""
    edge = np.full(stretch.index.size, np.nan)
    if setting.edges is not None:
        edge = _leave_piece(frame, setting, orbits, stretch)
    start = np.full(stretch.index.size, -1.0)
    if frame.drift >= 0.0:
        start = _turn(frame, orbits, stretch)
        _settle(frame, setting, orbits, stretch)
    _land(frame, setting, orbits, stretch, start)
    _move(frame, orbits, stretch, edge)
    running: Flags = stretch.end == 0
    return running


def _root(series: Array, level: Array, low: Array, high: Array) -> Array:
    """Where series pass a level between two points; the lower one without a change of sign."""
    root = low.copy()
    change = (value(low, series) - level) * (value(high, series) - level) < 0.0
    if change.any():
        # Shifted away from zero, where a relative tolerance would ask for digits nobody needs.
        shifted = secant_on_bracket(
            lambda x, rows, aim: value(x - 2.0, rows) - aim,
            low[change] + 2.0,
            high[change] + 2.0,
            (series[change], level[change]),
        )
        root[change] = shifted - 2.0
    return root


def _leave_piece(frame: Frame, setting: Setting, orbits: Orbits, stretch: Stretch) -> Array:
    """Stop where an orbit leaves its smooth piece; return ``z`` of that edge, or ``nan``."""
    assert setting.edges is not None
    piece, n = orbits.piece[stretch.index], stretch.index.size
    edges = np.concatenate([[-np.inf], setting.edges, [np.inf]])
    speed = setting.speed[stretch.index]
    low = edges[piece] / speed - frame.reference
    high = edges[piece + 1] / speed - frame.reference
    z = at_samples(stretch.z)
    slack = _ROUNDING * np.max(np.abs(z), axis=1)
    above = z > (high + slack)[:, None]
    outside = above | (z < (low - slack)[:, None])
    left: Flags = outside.any(axis=1)
    first = np.argmax(outside, axis=1)
    upward = above[np.arange(n), first]
    edge = np.where(left, np.where(upward, high, low), np.nan)
    before = np.where(first > 0, SAMPLES[first - 1], -1.0)
    where = np.flatnonzero(left)
    stretch.stop[where] = _root(
        stretch.z[where], edge[where], before[where], SAMPLES[first[where]]
    )
    orbits.piece[stretch.index[where]] += np.where(upward[where], 1, -1)
    return edge


def _turn(frame: Frame, orbits: Orbits, stretch: Stretch) -> Array:
    """Note turning points; return where the stage at the end of the stretch begins."""
    start, index = np.full(stretch.index.size, -1.0), stretch.index
    beyond = value(stretch.stop, stretch.z) - frame.drift
    odd = orbits.stage[index] % 2 == 1
    turned = np.where(odd, beyond <= 0.0, beyond >= 0.0) & (stretch.stop > -1.0)
    where = np.flatnonzero(turned)
    if not where.size:
        return start
    level = np.full(where.size, frame.drift)
    start[where] = _root(stretch.z[where], level, start[where], stretch.stop[where])
    e = value(start[where], stretch.e[where])
    top = odd[where] == (frame.direction < 0.0)
    orbits.crest[index[where[top]]] = e[top]
    orbits.trough[index[where[~top]]] = e[~top]
    orbits.stage[index[where]] += 1
    last = where[orbits.stage[index[where]] >= frame.last]
    stretch.stop[last], stretch.end[last] = start[last], frame.finish
    return start


def _settle(frame: Frame, setting: Setting, orbits: Orbits, stretch: Stretch) -> None:
    """End orbits that will not turn any more."""
    index, running = stretch.index, stretch.end == 0
    u = value(stretch.stop, stretch.e) - setting.rest[index]
    z = value(stretch.stop, stretch.z)
    energy = u * u + (frame.drift - z) ** 2
    if frame.direction > 0.0:
        quiet = (energy <= _SETTLED * orbits.energy[index]) & setting.stable[index]
        stretch.end[running & quiet] = End.SETTLED
        return
    # A little beyond the belt the law's smooth continuation still tells the sign of the gain.
    through = z + frame.reference < -_THROUGH
    far = energy > _ESCAPED * (1.0 + orbits.energy[index])
    stretch.end[running & (through | far)] = End.ESCAPED


def _land(frame: Frame, setting: Setting, orbits: Orbits, stretch: Stretch, start: Array) -> None:
    """Look for the contact in the part of the stretch where there can be one."""
    landing = (orbits.stage[stretch.index] == frame.landing) & (stretch.end == 0)
    if frame.drift < 0.0:
        _land_behind(orbits, stretch, landing)
        return
    if not landing.any():
        return
    hold = setting.hold[stretch.index]
    late = landing & (value(stretch.stop, stretch.e) > hold)
    if late.any():
        _decide(setting, orbits, stretch, np.flatnonzero(late), start, hold)
    below = value(stretch.stop, stretch.z) < 0.0
    where = np.flatnonzero(landing & ~late & below)
    if where.size:
        _touch(orbits, stretch, where, start, hold, np.zeros(where.size))


def _decide(
    setting: Setting, orbits: Orbits, stretch: Stretch, where: Index, start: Array, hold: Array
) -> None:
    """Hit or miss, where an orbit passes the level at which the belt could just hold it."""
    index = stretch.index
    rising = value(start[where], stretch.e[where]) <= hold[where]
    stretch.end[where[~rising]] = End.MISSED
    where = where[rising]
    if not where.size:
        return
    level = _root(stretch.e[where], hold[where], start[where], stretch.stop[where])
    z = value(level, stretch.z[where])
    gained = orbits.excess[index[where]] + 2.0 * value(level, stretch.work[where])
    # The energy of a motion far larger than the belt's is not known to the belt's digits.
    small = np.abs(orbits.trough[index[where]] - setting.rest[index[where]]) < _SMALL
    exact = np.where(small, 1.0 - np.sqrt(np.maximum(1.0 + gained, 0.0)), z)
    margin = np.where(small, gained, z * (z - 2.0))
    hit = exact < 0.0
    stretch.stop[where] = level
    stretch.end[where[~hit]] = End.MISSED
    orbits.margin[index[where[~hit]]] = np.maximum(margin[~hit], -1.0)
    if hit.any():
        _touch(orbits, stretch, where[hit], start, hold, (exact - z)[hit])


def _touch(
    orbits: Orbits, stretch: Stretch, where: Index, start: Array, hold: Array, shift: Array
) -> None:
    """End orbits at the contact; ``shift`` corrects the relative speed by the energy."""
    contact = _root(stretch.z[where], -shift, start[where], stretch.stop[where])
    # A grazing contact within rounding has no change of sign: it is where it was decided.
    flat = (contact <= start[where]) & (shift != 0.0)
    stretch.stop[where] = np.where(flat, stretch.stop[where], contact)
    stretch.end[where] = End.CONTACT
    e = value(stretch.stop[where], stretch.e[where])
    orbits.margin[stretch.index[where]] = (e - hold[where]) ** 2


def _land_behind(orbits: Orbits, stretch: Stretch, landing: Flags) -> None:
    """The contact of a lining that overtook the belt: always there, and never grazing."""
    where = np.flatnonzero(landing & (value(stretch.stop, stretch.z) < 0.0))
    if not where.size:
        return
    z = at_samples(stretch.z[where])
    # The orbit starts in contact: look beyond the sample where it is farthest from it.
    start = SAMPLES[np.argmax(np.where(stretch.stop[where][:, None] >= SAMPLES, z, -np.inf), 1)]
    stretch.stop[where] = _root(
        stretch.z[where], np.zeros(where.size), start, stretch.stop[where]
    )
    stretch.end[where] = End.CONTACT
    orbits.margin[stretch.index[where]] = 1.0


def _move(frame: Frame, orbits: Orbits, stretch: Stretch, edge: Array) -> None:
    index, stop = stretch.index, stretch.stop
    orbits.time[index] += 0.5 * stretch.h * (stop + 1.0)
    orbits.e[index] = value(stop, stretch.e)
    orbits.work[index] = value(stop, stretch.work)
    orbits.divergence[index] = value(stop, stretch.divergence)
    crossing = (stretch.end == 0) & np.isfinite(edge)
    z = np.where(crossing, edge, value(stop, stretch.z))
    orbits.z[index] = np.where(stretch.end == End.CONTACT, 0.0, z)
    orbits.end[index] = stretch.end
