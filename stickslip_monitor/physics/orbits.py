# SPDX-License-Identifier: Apache-2.0
"""Orbits of the slipping lining, many at once, as arrays.

Lengths are in units of ``V/omega`` and times of ``1/omega``, with the displacement ``e`` beyond a
reference point and the relative speed ``z`` beyond a reference speed, so that small motions keep
their digits:

    e' = drift - z        z' = e + offset - 2 zeta z + N/(m omega V) (mu(reference) - mu)

The law is asked with arrays, so any law will do. A lining turns where ``z`` passes ``drift``.
Behind the belt it can meet it (``z`` = 0) only after two turns, and only before the displacement
at which the belt could just hold it: there, with the law continued below ``z`` = 0, the sign of
``z`` separates hit from miss, so no step can jump over a contact.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from importlib import import_module
from typing import Any, NamedTuple

import numpy as np

from stickslip_monitor import jit
from stickslip_monitor.arrays import BoolArray, FloatArray, IndexArray
from stickslip_monitor.physics import scalar_law as scalar_laws
from stickslip_monitor.physics import slip_step as dop853
from stickslip_monitor.physics.bearing import Bearing
from stickslip_monitor.physics.friction import FrictionLaw, Stribeck, computes_as
from stickslip_monitor.physics.numerics import root_on_bracket
from stickslip_monitor.physics.scalar_law import ALMOST_REST, LawInUse, friction_slope, scalar_law
from stickslip_monitor.physics.slip_step import (
    PLACE,
    RELATIVE_SPEED,
    Medium,
    SlipState,
    acceleration,
    cut_step,
    next_length,
    slip_step,
    until_kink,
)

# How an orbit ended: steps ran out, at a turn, on the belt, past the place that could hold it, at
# rest, or, back in time, from far outside.
EXHAUSTED, TURNED, LANDED, MISSED, RESTED, LEFT = range(6)
_LONGEST, _SHORTEST, _MOST_STEPS = 1.0, 1e-13, 20000
# Share of the energy at the start below which an orbit has come to rest, and the growth of energy,
# back in time, from which no orbit comes back; or way beyond the belt.
_SETTLED, _ESCAPED, _THROUGH = 1e-12, 1e12, 1e-3
# How far past an edge of a law a step is to end, relative to the belt's speed; and the error of
# a step from which stopping there costs more than it saves: a table of 1,000 points has 2,000
# edges in a turn, and at 1e-8 a step passes over dozens of them.
_AT_EDGE, _OVER_EDGES = 1e-6, 1e-11
# Share of a step at which it has only just begun.
_JUST_BEGUN = 1e-12
# Steps after which orbits are looked at that may have come to rest or left.
_LOOK = 4
# Orbits up to which each is followed by itself: a step costs 0.04 ms then, one of arrays 0.25 ms.
FEW = 8
# Rows of the state of orbits: where they are, then what else is known of each.
_E, _Z, _RATE, _LENGTH, _TIME, _GAIN, _SIDE, _TURNS, _LAST, _DIRECTION, _REST, _ENERGY, _ORBIT = range(13)


def _coefficients() -> tuple[FloatArray, FloatArray]:
    """Those of DOP853: of the stages, shape (12, 12); of step and two errors, shape (3, 12)."""
    stages, out = np.zeros((12, 12)), np.zeros((3, 12))
    rows = (getattr(dop853, f'A{i}') for i in range(1, 12))
    for i, (used, row) in enumerate(zip(dop853.USED, rows, strict=True), 1):
        stages[i, list(used)] = row
    weighed = list(dop853.WEIGHED)
    out[0, weighed], out[1, weighed] = dop853.B, dop853.E5
    out[2, weighed] = dop853.B
    out[2, list(dop853.THIRD)] -= dop853.E3
    # From stage 5 on the stages 1 and 2 are asked no more: the first takes the place of the last.
    for table in (stages[_REUSED:], out):
        table[:, 2], table[:, 0] = table[:, 0], 0.0
    return stages, out


_REUSED = 5
_A, _OUT = _coefficients()
Drop = Callable[[FloatArray], FloatArray]


def friction_drop(law: FrictionLaw, origin: FloatArray, speed: FloatArray) -> Drop:
    """``mu(v) - mu(v + speed z)`` of sliding ahead as a function of ``z``, for arrays of ``v`` and speeds.

    It is continued smoothly a little below ``v + speed z`` = 0, and for Stribeck's law free of
    cancellation.
    """
    if computes_as(law, Stribeck):
        size, scale, least = (
            (law.kinetic - law.static) * np.exp(-law.decay * origin),
            -law.decay * speed,
            1.0 + law.decay * origin,
        )
        rise = law.viscous * speed

        def closed(z: FloatArray) -> FloatArray:
            y = scale * z
            np.minimum(y, least, out=y)
            np.expm1(y, out=y)
            y *= size
            if law.viscous:
                y -= rise * z
            return y

        return closed
    begin = float(law.slope(ALMOST_REST))
    begin = begin if np.isfinite(begin) else 0.0
    top = np.asarray(law.coefficient(np.maximum(origin, ALMOST_REST)))

    def difference(z: FloatArray) -> FloatArray:
        v = speed * z
        v += origin
        below = np.minimum(v, 0.0)
        below *= begin
        y = top - law.coefficient(np.maximum(v, ALMOST_REST))
        y -= below
        return y

    return difference


def law_in_use(law: FrictionLaw) -> LawInUse:
    """Bounds and kinks of a law."""
    return scalar_law(law).plain


@dataclass(frozen=True, slots=True)
class SlipField:
    """What orbits slip in; of one number for each orbit from ``speed`` on.

    Attributes:
        law: The friction law.
        damping: ``2 zeta``.
        drift: 1 behind the belt, -1 ahead of it, 0 about steady sliding.
        speed: ``V`` > 0, shape (n,) [m/s].
        force: ``N/(m omega V)``.
        offset: What the belt holds beyond slow sliding.
        origin: Reference speed [m/s].
        drop: Its :func:`friction_drop`.
    """

    law: FrictionLaw
    damping: float
    drift: float
    speed: FloatArray
    force: FloatArray
    offset: FloatArray
    origin: FloatArray
    drop: Drop = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, 'drop', friction_drop(self.law, self.origin, self.speed))

    def take(self, rows: Any) -> SlipField:
        """That of some orbits."""
        columns = self.speed, self.force, self.offset, self.origin
        return SlipField(self.law, self.damping, self.drift, *(column[rows] for column in columns))

    def acceleration(self, e: FloatArray, z: FloatArray) -> FloatArray:
        """``z'``, the rate of the relative speed."""
        rate = self.drop(z)
        rate *= self.force
        rate += e
        rate += self.offset
        rate -= self.damping * z
        return rate

    def friction_damping(self, z: FloatArray) -> FloatArray:
        """What friction adds to ``2 zeta`` for a small disturbance; negative where it falls."""
        v = np.maximum(np.abs(self.origin + self.speed * z), ALMOST_REST)
        return self.force * self.speed * self.law.slope(v)

    def rest(self) -> FloatArray:
        """Displacement of steady sliding."""
        if self.drift == 0.0:
            return np.zeros(self.speed.size)
        return self.damping - self.offset - self.force * self.drop(np.ones(self.speed.size))

    def about_steady_sliding(self) -> SlipField:
        """The same motion, with displacement and relative speed counted from steady sliding."""
        return replace(self, drift=0.0, offset=np.zeros(self.speed.size), origin=self.speed)


def slip_field(bearing: Bearing, speed: FloatArray, load: FloatArray) -> SlipField:
    """What linings slip in behind the belt, seen from breakaway.

    Args:
        bearing: The bearing.
        speed: ``V`` > 0, shape (n,) [m/s].
        load: ``N`` > 0, shape (n,) [N].
    """
    use, momentum = law_in_use(bearing.friction), math.sqrt(bearing.mass) * math.sqrt(bearing.stiffness)
    force, damping = load / (momentum * speed), bearing.damping / momentum
    held = force * (use.hold - use.top)
    return SlipField(bearing.friction, damping, 1.0, speed, force, held, np.zeros(speed.size))


class Stepped(NamedTuple):
    """What a step ends with.

    Attributes:
        e: Displacement.
        z: Relative speed.
        rate: ``z'``.
        error: Error of the step.
        gain: Integral of the flow's divergence over it; 0 if it is not weighed.
    """

    e: FloatArray
    z: FloatArray
    rate: FloatArray
    error: FloatArray
    gain: FloatArray


def orbit_steps(field: SlipField, begin: FloatArray, length: FloatArray, weigh: bool = False) -> Stepped:
    """One step of each orbit by Dormand and Prince's method of order 8 with a 5-3 error.

    E. Hairer, S. P. Norsett and G. Wanner, Solving Ordinary Differential Equations I, 2nd edition,
    Springer, 1993, section II.5. Sums run term by term, so no orbit sees its neighbours.

    Args:
        field: What they slip in.
        begin: Displacement, relative speed and its rate, shape (3 or more, n).
        length: Shape (n,), negative to go back in time.
        weigh: Whether to integrate the divergence.
    """
    e0, z0, r0 = begin[:3]
    n, drift = e0.size, field.drift
    rates = np.empty((12, 2 * n))
    np.subtract(drift, z0, out=rates[0, :n])
    rates[0, n:] = r0
    start, h = begin[:2].ravel(), np.concatenate([length, length])
    flow = [field.friction_damping(z0)] if weigh else []
    for i in range(1, 12):
        first = 0 if i < _REUSED else 2
        if i == _REUSED:
            rates[2] = rates[0]
        y = np.einsum('i,ij->j', _A[i, first:i], rates[first:i])
        y *= h
        y += start
        e, z = y[:n], y[n:]
        np.subtract(drift, z, out=rates[i, :n])
        rates[i, n:] = field.acceleration(e, z)
        if weigh:
            flow.append(field.friction_damping(z))
    out = np.einsum('ki,ij->kj', _OUT[:, 2:], rates[2:])
    y = start + h * out[0]
    np.abs(out, out=out)
    fifth, third = np.maximum(out[1:, :n], out[1:, n:])
    error = np.abs(length) * fifth * fifth / (np.hypot(fifth, 0.1 * third) + ALMOST_REST)
    gain = (
        -length * (np.einsum('i,ij->j', _OUT[0, 2:], np.stack([flow[0], *flow[3:]])) + field.damping)
        if weigh
        else np.zeros(n)
    )
    return Stepped(y[:n], y[n:], field.acceleration(y[:n], y[n:]), error, gain)


class Route(NamedTuple):
    """How orbits are followed.

    Attributes:
        last: Number of turns that ends them, one number or one each; 0 for none.
        error: Of a step in units of the motion.
        direction: In time, 1 or -1, one number or one each.
        contact: Whether contact with the belt ends them.
        weigh: Whether to integrate the divergence.
        most: Steps.
        locate: Whether the contact is wanted to the digits of the step that it ends; otherwise
            its time and place are those of a cubic, but whether there is one is as certain.
        compiled: Whether few are followed by compiled loops, to the same bits.
    """

    last: Any
    error: float
    direction: Any = 1.0
    contact: bool = False
    weigh: bool = False
    most: int = _MOST_STEPS
    locate: bool = True
    compiled: bool = False


@dataclass(frozen=True, slots=True)
class Orbits:
    """How orbits ended, each of shape (n,).

    Attributes:
        end: ``EXHAUSTED``, ``TURNED``, ``LANDED``, ``MISSED``, ``RESTED`` or ``LEFT``.
        time: When.
        place: Displacement there.
        turns: Displacement at the first two turns, shape (2, n).
        divergence: Integral of the flow's divergence.
    """

    end: IndexArray
    time: FloatArray
    place: FloatArray
    turns: FloatArray
    divergence: FloatArray

    def put(
        self, rows: IndexArray, begin: FloatArray, length: FloatArray, place: FloatArray, gain: FloatArray
    ) -> None:
        """Write where orbits ended in steps from known states."""
        self.time[rows], self.place[rows] = begin[_TIME] + length, place
        self.divergence[rows] = begin[_GAIN] + gain


def follow(field: SlipField, e: FloatArray, z: FloatArray, route: Route) -> Orbits:
    """Follow orbits from displacements and relative speeds to their ends.

    All at once, but few number by number. Both steps are of the same method and go by the same
    rules; what they find differs by the errors of steps.
    """
    if e.size <= FEW and not route.weigh:
        return _one_by_one(field, e, z, route)
    run = _Run(field, e, z, route)
    for _ in range(route.most if e.size else 0):
        run.advance()
        if not run.state.size:
            break
    return run.orbits()


def _one_by_one(field: SlipField, e: FloatArray, z: FloatArray, route: Route) -> Orbits:
    n, law, loop = e.size, law_in_use(field.law), follow_one
    scalar = scalar_law(field.law)
    if route.compiled and scalar.compiled is not None:
        law, modules = scalar.compiled, (import_module(__name__), dop853, scalar_laws)
        loop = jit.compiled('follow_one', *modules, law=scalar.module, inline=False)
    columns = field.speed, field.force, field.offset, field.origin, e, z, route.last, route.direction
    found = []
    for row in zip(*(np.broadcast_to(column, n).tolist() for column in columns), strict=True):
        speed, force, offset, origin, *begin, last, direction = row
        medium = Medium(speed, force, field.damping, offset, origin, field.drift)
        own = route._replace(last=last, direction=float(direction))
        found.append(loop(law.own, law.kinks, medium, tuple(begin), own))
    end, time, place, *turns = np.array(found).reshape(n, 5).T
    return Orbits(end.astype(int), time, place, np.array(turns), np.zeros(n))


def follow_one(
    own: Any, kinks: Sequence[float], medium: Medium, begin: tuple[float, ...], route: Route
) -> tuple[float, float, float, float, float]:
    """The end of an orbit that begins at ``e`` and ``z``, when, where, and its first two turns.

    ``own`` and ``kinks`` are those of :class:`.LawInUse`. It runs as it stands and compiled alike.
    """
    (e, z), drift = begin, medium.drift
    state, rest = SlipState(e, z, acceleration(own, medium, e, z)), 0.0
    if drift:
        rest = -acceleration(own, medium, 0.0, 1.0)
    energy = _energy(e - rest, z - drift)
    stiffness = abs(medium.force * medium.speed * friction_slope(own, medium.origin + medium.speed * z))
    h = route.direction * 0.1 / (1.0 + medium.damping + min(stiffness, 1e6))
    side = z - drift or route.direction * state.rate
    time, turns, first, second, end = 0.0, 0, math.nan, math.nan, EXHAUSTED
    for _ in range(route.most):
        length = until_kink(own, kinks, medium, state, h)
        after, error = slip_step(own, medium, state, length)
        moved = abs(state.e) + abs(state.z) + abs(length) * (abs(drift) + abs(state.rate))
        wanted, h = h, next_length(length, error, route.error * moved)
        if not error <= route.error * moved:
            if not abs(h) > _SHORTEST:
                break
            continue
        if abs(h) < abs(wanted) > abs(length):
            h = wanted  # the step was short for the kink's sake
        if route.contact and (turns == 2 or drift < 0.0):
            end, length, after = _landing(own, medium, state, length, after)
        if end == EXHAUSTED and drift >= 0.0 and (after.z - drift) * side <= 0.0:
            length, after = cut_step(own, medium, state, length, RELATIVE_SPEED, drift)
            turns, side = turns + 1, -side
            first = after.e if turns == 1 else first
            second = after.e if turns == 2 else second
            end = TURNED if turns == route.last else EXHAUSTED
        time, state = time + length, after
        if end == EXHAUSTED and drift >= 0.0:
            end = _fading(medium, route.direction, energy, _energy(after.e - rest, after.z - drift), after.z)
        if end != EXHAUSTED:
            break
    place = state.e if end in (TURNED, LANDED) else math.nan
    return end, time, place, first, second


def _energy(e: float, z: float) -> float:
    return e * e + z * z  # a power raises where it overflows


def _landing(
    own: Any, medium: Medium, begin: SlipState, length: float, after: SlipState
) -> tuple[int, float, SlipState]:
    """Whether a step meets the belt or passes the place that could hold, and where it ends then."""
    hold, end = -medium.offset, EXHAUSTED
    if medium.drift > 0.0 and after.e > hold:
        if begin.e > hold:
            return MISSED, 0.0, begin
        length, after = cut_step(own, medium, begin, length, PLACE, hold)
        end = MISSED
    if after.z < 0.0:
        length, after = cut_step(own, medium, begin, length, RELATIVE_SPEED, 0.0)
        end = LANDED
    return end, length, after


def _fading(medium: Medium, direction: float, begun: float, now: float, z: float) -> int:
    """``RESTED`` where a motion has come to rest, ``LEFT`` where, back in time, it has left for good."""
    if now < _SETTLED * begun:
        return RESTED
    through = medium.origin + medium.speed * z < -_THROUGH * medium.speed
    return LEFT if direction < 0.0 and (through or now > _ESCAPED * (1.0 + begun)) else EXHAUSTED


class _Run:
    """Orbits under way: the state of those that go on, and the steps in which events lie."""

    def __init__(self, field: SlipField, e: FloatArray, z: FloatArray, route: Route) -> None:
        n, nothing = e.size, np.zeros(e.size)
        self.whole = self.field = field
        self.route, self.steps = route, 0
        self.edges = np.array(law_in_use(field.law).kinks if route.error < _OVER_EDGES else ())
        self.last, self.end = np.broadcast_to(route.last, n), np.zeros(n, int)
        # Of the first two turns and of contact: the state before the step in which it lies.
        self.events = np.full((3, _SIDE, n), np.nan)
        rate, direction = field.acceleration(e, z), np.broadcast_to(route.direction, n)
        stiffness = np.minimum(np.abs(field.friction_damping(z)), 1e6)
        length = direction * 0.1 / (1.0 + field.damping + stiffness)
        side = np.where(np.where(z == field.drift, direction * rate, z - field.drift) < 0.0, -1.0, 1.0)
        own = side, nothing, self.last, direction, field.rest(), nothing, np.arange(n)
        self.state = np.stack([e, z, rate, length, nothing, nothing, *own])
        self.state[_ENERGY] = self._energy()

    def _energy(self) -> FloatArray:
        """Twice the energy about steady sliding."""
        state = self.state
        energy: FloatArray = (state[_E] - state[_REST]) ** 2 + (state[_Z] - self.field.drift) ** 2
        return energy

    def advance(self) -> None:
        """One step of every orbit that goes on, or a shorter one next time."""
        state, drift = self.state, self.field.drift
        wanted = state[_LENGTH]
        length = self._until_edge() if self.edges.size else wanted
        after = orbit_steps(self.field, state, length, self.route.weigh)
        moved = np.abs(state[:_LENGTH])
        moved[_RATE] = (moved[_RATE] + abs(drift)) * np.abs(length)
        room = self.route.error * moved.sum(axis=0) / (after.error + ALMOST_REST)
        turns = (state[_SIDE] * (after.z - drift) <= 0.0) & (drift >= 0.0)
        good = room >= 1.0
        meets = past = np.zeros(good.shape, bool)
        if self.route.contact:
            meets = self._meets(after, turns)
            past = meets & (drift > 0.0) & (state[_E] > -self.field.offset)
            good = good & ~(meets & turns & ~past)  # first to the turn, then to the belt
        over = self._ended(turns & good, meets & good, past, length)
        share = np.fmin(np.fmax(0.9 * room**0.125, 0.2), np.where(good, 5.0, 0.5))
        following = np.fmax(np.fmin(length * share, _LONGEST), -_LONGEST)
        if length is not wanted:  # a step that was short for an edge's sake tells nothing of the next
            short = good & (length != wanted) & (np.abs(following) < np.abs(wanted))
            following = np.where(short, wanted, following)
        time, gain = state[_TIME] + length, state[_GAIN] + after.gain
        now = np.stack([after.e, after.z, after.rate, following, time, gain])
        state[:_SIDE] = np.where(good, now, state[:_SIDE])
        state[_LENGTH] = following
        self.steps += 1
        if self.steps % _LOOK == 0:
            over |= self._lost()
        if over.any():
            rows = np.flatnonzero(~over)
            self.field, self.state = self.field.take(rows), state[:, rows]

    def _until_edge(self) -> FloatArray:
        """Lengths of steps, cut where the relative speed comes to an edge of the law.

        A step over such an edge would be refused. The speed is foreseen to second order, and a
        little beyond the edge does no harm.
        """
        _, z, rate, length, *_ = self.state
        f, toward = self.field, np.sign(length)
        v = f.origin + f.speed * z
        bend = f.drift - z - (f.damping + f.friction_damping(z)) * rate
        heading = toward * rate
        # What has come so close to an edge is taken to have passed it.
        i = np.searchsorted(self.edges, v + np.copysign(_AT_EDGE, heading) * f.speed, 'right')
        bounds = np.concatenate([[-np.inf], self.edges, [np.inf]])
        up = (bounds[i + 1] - v) / f.speed + _AT_EDGE
        down = (v - bounds[i]) / f.speed + _AT_EDGE
        until = np.minimum(_time_to_rise(heading, bend, up), _time_to_rise(-heading, -bend, down))
        return toward * np.minimum(np.abs(length), until)

    def _meets(self, after: Stepped, turns: BoolArray) -> BoolArray:
        """Steps that pass the belt's speed, or the place at which the belt could just hold."""
        if not self.field.drift > 0.0:
            return np.asarray(after.z < 0.0)
        meets = (after.z < 0.0) | (after.e > -self.field.offset)
        return np.asarray(meets & (self.state[_TURNS] + turns == 2))

    def _ended(self, turns: BoolArray, meets: BoolArray, past: BoolArray, length: FloatArray) -> BoolArray:
        """Keep the steps in which orbits turn or meet the belt; which of them end there."""
        over, state = meets, self.state
        if turns.any():
            for k in (0, 1):
                self._keep(k, np.flatnonzero(turns & (state[_TURNS] == k)), length)
            state[_TURNS] += turns
            state[_SIDE] = np.where(turns, -state[_SIDE], state[_SIDE])
            turned = turns & (state[_TURNS] == state[_LAST])
            self.end[self._orbits(np.flatnonzero(turned))], over = TURNED, over | turned
        if meets.any():
            rows = np.flatnonzero(meets)
            self._keep(2, rows, length)
            self.end[self._orbits(rows)] = np.where(past[rows], MISSED, LANDED)
        return over

    def _orbits(self, rows: IndexArray) -> IndexArray:
        return self.state[_ORBIT, rows].astype(np.intp)

    def _keep(self, event: int, rows: IndexArray, length: FloatArray) -> None:
        if rows.size:
            before = self.state[:_SIDE, rows]
            before[_LENGTH] = length[rows]
            self.events[event][:, self._orbits(rows)] = before

    def _lost(self) -> BoolArray:
        """Orbits that have come to rest or, back in time, have left for good, or do not move on."""
        f, state = self.field, self.state
        stuck = np.abs(state[_LENGTH]) < _SHORTEST
        if f.drift < 0.0:
            return stuck
        energy = self._energy()
        left = energy > _ESCAPED * (1.0 + state[_ENERGY])
        left |= f.origin + f.speed * state[_Z] < -_THROUGH * f.speed
        left &= state[_DIRECTION] < 0.0
        rested = energy < _SETTLED * state[_ENERGY]
        for which, end in ((left, LEFT), (rested, RESTED)):
            orbits = self._orbits(np.flatnonzero(which))
            self.end[orbits] = np.where(self.end[orbits] == EXHAUSTED, end, self.end[orbits])
        return stuck | left | rested

    def orbits(self) -> Orbits:
        """Where the orbits turned and ended, found within the steps that were kept."""
        n = self.end.size
        unknown = np.full((4, n), np.nan)
        found = Orbits(self.end, unknown[0], unknown[1], unknown[2:], np.zeros(n))
        for k in (0, 1):
            rows = np.flatnonzero(np.isfinite(self.events[k, _E]))
            if rows.size:
                begin = self.events[k][:, rows]
                found.turns[k, rows], length, gain = self._at_turn(rows, begin)
                last = (self.end[rows] == TURNED) & (self.last[rows] == k + 1)
                found.put(rows[last], begin[:, last], length[last], found.turns[k, rows[last]], gain[last])
        rows = np.flatnonzero(self.end == LANDED)
        if rows.size:
            begin = self.events[2][:, rows]
            met, *where = self._at_belt(rows, begin)
            found.end[rows[~met]] = MISSED
            found.put(rows, begin, *where)
        return found

    def _at_turn(self, rows: IndexArray, begin: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Displacement, length and divergence of steps up to the turns in them."""
        field, drift = self.whole.take(rows), self.whole.drift
        length = _first_length(drift, begin, orbit_steps(field, begin, begin[_LENGTH]), begin[_LENGTH])
        for _ in range(2):
            now = orbit_steps(field, begin, length, self.route.weigh)
            more = (drift - now.z) / np.where(now.rate != 0.0, now.rate, 1.0)
            length = length + more
        # The displacement is stationary there: what is left of the miss enters squared.
        place = now.e + (drift - now.z) * more - 0.5 * now.rate * more * more
        return place, length, now.gain

    def _at_belt(
        self, rows: IndexArray, begin: FloatArray
    ) -> tuple[BoolArray, FloatArray, FloatArray, FloatArray]:
        """Whether steps meet the belt before it could not hold, and length, place, divergence."""
        field, length = self.whole.take(rows), begin[_LENGTH].copy()
        end = orbit_steps(field, begin, length)
        beyond = np.flatnonzero((field.drift > 0.0) & (end.e > -field.offset))
        if beyond.size:
            length[beyond] = _until(field.take(beyond), begin[:, beyond], length[beyond], of_place=True)
            end = orbit_steps(field, begin, length)
        met = end.z < 0.0
        if self.route.locate:
            first = _until(field, begin, length, of_place=False)
        else:
            first = _first_length(0.0, begin, end, length)
        length = np.where(met, first, length)
        now = orbit_steps(field, begin, length, self.route.weigh)
        return met, length, now.e, now.gain


def _until(field: SlipField, begin: FloatArray, most: FloatArray, of_place: bool) -> FloatArray:
    """Lengths of steps that end at the place that just holds, or where ``z`` falls below 0."""

    def beyond(length: FloatArray, rows: IndexArray) -> FloatArray:
        now = orbit_steps(field.take(rows), begin[:, rows], length)
        return now.e + field.offset[rows] if of_place else now.z

    # An orbit ahead of the belt begins on it.
    every, least = np.arange(most.size), _JUST_BEGUN * most
    return root_on_bracket(beyond, least, most, (beyond(least, every), beyond(most, every)), (every,))


def _time_to_rise(rate: FloatArray, bend: FloatArray, gap: FloatArray) -> FloatArray:
    """When ``rate t + bend t^2/2`` first reaches a gap > 0; ``inf`` for never."""
    square = rate * rate + 2.0 * bend * gap
    fastest = rate + np.sqrt(np.maximum(square, 0.0))
    reaches = (square > 0.0) & (fastest > 0.0) & (gap < np.inf)
    return np.where(reaches, 2.0 * gap / np.where(reaches, fastest, 1.0), np.inf)


def _first_length(level: float, begin: FloatArray, end: Stepped, length: FloatArray) -> FloatArray:
    """Where the cubic of ``z`` over a step passes a level."""
    z = begin[_Z]
    rise, first, last = end.z - z, length * begin[_RATE], length * end.rate
    square, cube = 3.0 * rise - 2.0 * first - last, first + last - 2.0 * rise
    t = np.clip((level - z) / np.where(rise != 0.0, rise, 1.0), 0.0, 1.0)
    for _ in range(3):
        value = z + t * (first + t * (square + t * cube)) - level
        slope = first + t * (2.0 * square + 3.0 * t * cube)
        t = np.clip(t - value / np.where(slope != 0.0, slope, 1.0), 0.0, 1.0)
    return t * length
