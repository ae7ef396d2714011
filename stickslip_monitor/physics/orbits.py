# SPDX-License-Identifier: Apache-2.0
"""Orbits of the slipping lining, each followed to its end by the steps of :mod:`.slip_series`.

Lengths are in units of ``V/omega`` and times of ``1/omega``, with the displacement ``e`` beyond a reference
point and the relative speed ``z`` beyond a reference speed, so that small motions keep their digits:

    e' = drift - z        z' = e + offset - 2 zeta z + N/(m omega V) (mu(reference) - mu)

A lining turns where ``z`` passes ``drift``. Behind the belt it can meet it (``z`` = 0) only after two turns,
and only before the displacement at which the belt could just hold it: there, with the law continued below
``z`` = 0, the sign of ``z`` separates hit from miss, so no step can jump over a contact.

An orbit is written once, in plain numbers. Few orbits run as they stand; in long work the same
functions run compiled, to the same bits.
"""

from __future__ import annotations

import math
from collections.abc import MutableSequence, Sequence
from dataclasses import dataclass, replace
from importlib import import_module
from typing import Any, NamedTuple

import numpy as np

from stickslip_monitor import jit
from stickslip_monitor.arrays import BoolArray, FloatArray, IndexArray
from stickslip_monitor.physics import scalar_law as scalar_laws
from stickslip_monitor.physics import series, slip_series
from stickslip_monitor.physics.bearing import Bearing
from stickslip_monitor.physics.friction import FrictionLaw
from stickslip_monitor.physics.numerics import gauss_rule
from stickslip_monitor.physics.scalar_law import (
    friction_slope,
    largest_slopes_below,
    law_bounds,
    least_slopes_beyond,
    scalar_law,
)
from stickslip_monitor.physics.series import PLACE, RELATIVE_SPEED, find_level, new_work, place_and_speed
from stickslip_monitor.physics.slip_series import LONGEST, Medium, acceleration, expand, first_unit

# The ways in which an orbit can end: its steps ran out, at a turn, on the belt, past the place that could
# hold it, at rest, or, back in time, far outside.
EXHAUSTED, TURNED, LANDED, MISSED, RESTED, LEFT = range(6)
# Gauss-Legendre nodes and weights in a step: of its divergence five leave an error of 1e-13.
_NODES, _WEIGHTS = (tuple(column.tolist()) for column in gauss_rule(5))
# Interpreted steps of a process after which it pays to compile: 20,000 take 0.8 s, loading the
# compiled loop 0.7 s. A table of boundaries of Stribeck's law takes 3,000.
PATIENCE = 20_000
# Numbers of an orbit that follow_each reads and writes.
_READS, _WRITES = 8, 7


@dataclass(frozen=True, slots=True)
class SlipField:
    """Field in which orbits slip; arrays have one number for each orbit.

    Attributes:
        law: The friction law.
        damping: ``2 zeta``.
        drift: Speed of the belt in units of ``V``: 1 behind it, -1 ahead of it, 0 about steady sliding.
        speed: ``V`` > 0, shape (n,) [m/s].
        force: ``N/(m omega V)``, shape (n,).
        offset: Force that the belt holds beyond slow sliding, in units of ``m omega V``, shape (n,).
        origin: Reference speed, shape (n,) [m/s].
    """

    law: FrictionLaw
    damping: float
    drift: float
    speed: FloatArray
    force: FloatArray
    offset: FloatArray
    origin: FloatArray

    def take(self, rows: Any) -> SlipField:
        """Return the field of the orbits at ``rows``, an index or a slice of the arrays."""
        columns = self.speed, self.force, self.offset, self.origin
        return SlipField(self.law, self.damping, self.drift, *(column[rows] for column in columns))

    def steady_displacement(self) -> FloatArray:
        """Return the displacement of steady sliding, shape (n,) [V/omega]; 0 where it counts from there."""
        if self.drift == 0.0:
            return np.zeros(self.speed.size)
        plain, pairs = scalar_law(self.law).plain, zip(self.origin.tolist(), self.speed.tolist(), strict=True)
        drop = np.array([plain.drop(*pair) for pair in pairs])
        return self.damping - self.offset - self.force * drop

    def about_steady_sliding(self) -> SlipField:
        """Return the same field with displacement and relative speed counted from steady sliding."""
        return replace(self, drift=0.0, offset=np.zeros(self.speed.size), origin=self.speed)


def slip_field(bearing: Bearing, speed: FloatArray, load: FloatArray) -> SlipField:
    """Return the field in which linings slip behind the belt, with displacements counted from breakaway.

    Args:
        bearing: The bearing; with lubrication, too, friction is taken as measured.
        speed: ``V`` > 0, shape (n,) [m/s].
        load: ``N`` > 0, shape (n,) [N].
    """
    use, momentum = law_bounds(bearing.friction), math.sqrt(bearing.mass) * math.sqrt(bearing.stiffness)
    force, damping = load / (momentum * speed), bearing.damping / momentum
    held = force * (use.hold - use.top)
    return SlipField(bearing.friction, damping, 1.0, speed, force, held, np.zeros(speed.size))


class Route(NamedTuple):
    """Way in which orbits are followed.

    Attributes:
        last: Number of turns after which they end, one number or one each; 0 for none.
        error: Error of a step, as of :func:`.slip_series.expand`.
        direction: Direction in time, 1 or -1, one number or one each.
        contact: Whether contact with the belt ends them.
        weigh: Whether to integrate the divergence.
        max_steps: Largest number of steps of an orbit, beside eight for each piece of the law; one that needs
            more is ``EXHAUSTED``. The stiffest cycle of the tests takes 6,000.
    """

    last: Any
    error: float
    direction: Any = 1.0
    contact: bool = False
    weigh: bool = False
    max_steps: int = 20_000


@dataclass(frozen=True, slots=True)
class Orbits:
    """Ends of orbits, each of shape (n,).

    Attributes:
        end: ``EXHAUSTED``, ``TURNED``, ``LANDED``, ``MISSED``, ``RESTED`` or ``LEFT``.
        time: Time at the end [1/omega]; ``nan`` unless it turned or landed.
        place: Displacement there [V/omega]; ``nan`` as the time.
        turns: Displacements at the first two turns, ``nan`` for none, shape (2, n) [V/omega].
        divergence: Integral of the flow's divergence; 0 where it was not weighed.
    """

    end: IndexArray
    time: FloatArray
    place: FloatArray
    turns: FloatArray
    divergence: FloatArray


class _Effort:
    """Interpreted steps that this process has taken."""

    steps = 0


def follow(field: SlipField, e: FloatArray, z: FloatArray, route: Route) -> Orbits:
    """Follow orbits from displacements and relative speeds to their ends.

    The loop runs interpreted until this process has taken :data:`PATIENCE` steps, which are counted here,
    and compiled from then on where numba may be used. Orbits that creep to rest end ``RESTED`` unfollowed.

    Args:
        field: What the linings slip in.
        e: Displacements from breakaway in units of ``V/omega``, shape (n,).
        z: Speeds relative to the belt in units of ``V``, shape (n,).
        route: How they are followed; its ``last`` and ``direction`` may be of shape (n,).

    Returns:
        Their ends, as :func:`follow_one` has them.
    """
    law = scalar_law(field.law)
    columns = field.speed, field.force, field.offset, field.origin, e, z, route.last, route.direction
    starts, results = np.empty((e.size, _READS)), np.zeros((e.size, _WRITES))
    for k, column in enumerate(columns):
        starts[:, k] = column
    rests = _creep_to_rest(field, e, z, starts[:, -1])
    results[rests] = RESTED, *[math.nan] * 4, 0.0, 0.0
    rows, out = starts[~rests], results[~rests]
    n = len(rows)
    shared = float(field.damping), float(field.drift)
    plain = route._replace(last=0, direction=1.0, max_steps=route.max_steps + 8 * law.pieces)
    work, begun = new_work(), 0
    while begun < n and (_Effort.steps < PATIENCE or not jit.has_compiler()):
        # One by one, so that long work is noticed while it is under way.
        row, written = rows[begun].tolist(), [0.0] * _WRITES
        follow_each(law.plain, *shared, [row], plain, work, [written])
        out[begun] = written
        _Effort.steps += int(written[-1])
        begun += 1
    if begun < n:
        modules = import_module(__name__), slip_series, series, scalar_laws
        loop = jit.compiled('follow_each', *modules, law=law.module)
        loop(law.compiled, *shared, rows[begun:], plain, np.array(work), out[begun:])
    results[~rests] = out
    end, time, place, first, second, gain, _ = results.T
    return Orbits(end.astype(int), time, place, np.stack([first, second]), gain)


def start_on_manifold(field: SlipField) -> tuple[FloatArray, FloatArray]:
    """Return where slip from breakaway may begin so that it meets the belt where the whole of it would.

    Damping draws slip to the slow manifold, on which the spring balances friction and damping, and it creeps
    along it. An attraction of ``exp(40)`` leaves nothing of where it came from, so it begins that much before
    steady sliding, or before the damping fades.

    Args:
        field: What the linings slip in, behind the belt.

    Returns:
        Displacements and relative speeds, shape (n,) each: on the manifold, at speeds above 1, or both 0, at
        breakaway.
    """
    begin, speed = np.zeros((2, field.speed.size))
    least_rate, enough, places = 3.0, 40.0, 256  # rates in omega
    stiff = field.damping + field.force * field.speed * law_bounds(field.law).steepest > least_rate
    rows = np.flatnonzero(stiff & (field.damping > 0.0))
    if not rows.size:
        return begin, speed
    field = field.take(rows)
    # Up to where the lining would creep from breakaway without friction.
    furthest = np.maximum(field.force * law_bounds(field.law).hold / field.damping, 1.0)
    beyond = furthest[:, None] * np.geomspace(1e-8, 1.0, places)
    v, force = (1.0 + beyond) * field.speed[:, None], field.force[:, None]
    rate = field.damping + force * field.speed[:, None] * np.asarray(field.law.slope(v))
    draws = rate > least_rate
    first = np.argmax(draws, axis=1)
    draws &= np.cumsum(~draws & (np.arange(places) > first[:, None]), axis=1) == 0
    # Along the manifold ``e' = -beyond`` and ``de = rate * d(beyond)``, in which it draws by ``rate * dt``.
    drawn = np.where(draws, rate * rate, 0.0)
    parts = 0.5 * (drawn[:, 1:] + drawn[:, :-1]) * np.diff(np.log(beyond), axis=1)
    attraction = np.cumsum(parts, axis=1)
    at = 1 + np.argmax(attraction > enough, axis=1)
    place = field.damping * (1.0 + beyond) - force * (law_bounds(field.law).hold - field.law.coefficient(v))
    every = np.arange(rows.size)
    # Slip passes steady sliding above 0, and sinks while it goes out to the manifold: it does so at least as
    # fast as half the distance from 0 to that, and gets there if it has nowhere sunk by the other half.
    floor = 0.5 * np.maximum(place, place[every, at][:, None])
    with np.errstate(all='ignore'):
        sinking = np.where(place < 0.0, beyond / (floor - place), np.inf)
        sunk = np.cumsum(0.5 * (sinking[:, 1:] + sinking[:, :-1]) * np.diff(beyond, axis=1), axis=1)
    goes_out = np.logical_and.accumulate(sunk < -floor[:, 1:], axis=1)[every, at - 1]
    # It comes back along the manifold only if it never turns: with critical damping from there on outward.
    least_rates = np.minimum.accumulate(rate[:, ::-1], axis=1)[:, ::-1]
    held = (attraction[:, -1] > enough) & (least_rates[every, at] >= 2.0) & goes_out
    begin[rows] = np.where(held, place[every, at], 0.0)
    speed[rows] = np.where(held, 1.0 + beyond[every, at], 0.0)
    return begin, speed


def _creep_to_rest(field: SlipField, e: FloatArray, z: FloatArray, direction: FloatArray) -> BoolArray:
    """Decide which orbits come to rest without turning, so stiff that following them takes long.

    With ``w`` the relative speed beyond that of steady sliding, ``y`` the displacement beyond it and ``G(w)``
    the integral of the damping from 0 to ``w``, that of friction included, ``y' = -w`` and
    ``w' = y - G(w)``. Where the damping is at least 2, critical, from 0 to any ``w`` > 0, an orbit does not
    leave ``y >= w > 0``: on its edge ``y = w``, ``y' - w' = G(w) - 2 w >= 0``. Slip from the belt enters
    there, since ``w'`` >= 0 as it passes ``w`` = 0. Back in time the same holds of ``w`` < 0 and damping
    of at most -2.

    Args:
        field: What the linings slip in.
        e: Displacements at the begin, shape (n,) [V/omega].
        z: Relative speeds there, shape (n,) [V].
        direction: Direction in time, 1 or -1, shape (n,).

    Returns:
        Shape (n,); False also where it takes following to know.
    """
    creeps = np.zeros(e.size, bool)
    pull, critical = field.force * field.speed, 2.0
    stiff = field.damping + pull * law_bounds(field.law).steepest >= critical
    for rows, extreme in (
        (np.flatnonzero(stiff & (direction > 0.0)), least_slopes_beyond),
        (np.flatnonzero(stiff & (direction < 0.0)), largest_slopes_below),
    ):
        if field.drift <= 0.0 or not rows.size:
            continue
        towards = direction[rows]
        damping = field.damping + pull[rows] * extreme(field.law, field.speed[rows])
        rows = rows[towards * damping >= critical]
        towards, beyond = direction[rows], z[rows] - 1.0
        from_belt = (towards > 0.0) & (beyond <= 0.0) & (e[rows] >= -field.offset[rows])
        held = (towards * beyond >= 0.0) & (
            e[rows] - field.take(rows).steady_displacement() >= towards * beyond
        )
        creeps[rows[from_belt | held]] = True
    return creeps


def follow_each(
    law_numbers: Any,
    damping: float,
    drift: float,
    rows: Sequence[Sequence[float]],
    route: Route,
    work: MutableSequence[float],
    out: Sequence[MutableSequence[float]],
) -> None:
    """Follow one orbit after the other; each row of ``out`` receives the result of :func:`follow_one`.

    Args:
        law_numbers: The law, as :class:`.LawFunctions`.
        damping: ``2 zeta``.
        drift: That of :class:`SlipField`.
        rows: For each orbit speed, force, offset, origin, displacement, relative speed, last turn
            and direction.
        route: The way of all; its ``last`` and ``direction`` are not used.
        work: A row of :func:`.new_work`; written: the series of a step.
        out: Written: for each orbit end, time, place, two turns, divergence and the number of steps.
    """
    for k in range(len(rows)):
        row, to = rows[k], out[k]
        medium = Medium(row[0], row[1], damping, row[2], row[3], drift, 0.0, 0.0, 0.0)
        own_route = Route(int(row[6]), route.error, row[7], route.contact, route.weigh, route.max_steps)
        orbit = follow_one(law_numbers, medium, row[4], row[5], own_route, work)
        to[0], to[1], to[2], to[3], to[4], to[5], to[6] = orbit


def follow_one(
    law_numbers: Any, medium: Medium, e: float, z: float, route: Route, work: MutableSequence[float]
) -> tuple[float, float, float, float, float, float, float]:
    """Follow the orbit that begins at ``e`` and ``z`` to its end.

    Args:
        law_numbers: The law, as :class:`.LawFunctions`.
        medium: What it slips in.
        e: Displacement from breakaway in units of ``V/omega``.
        z: Speed relative to the belt in units of ``V``; above 1 on the way to the belt a turn is past.
        route: How it is followed.
        work: Written: the series of a step.

    Returns:
        The end (``TURNED``, ``LANDED``, ``MISSED``, ``RESTED``, ``LEFT``, or ``EXHAUSTED`` when the steps are
        used up); time [1/omega] and place [V/omega] there, ``nan`` unless it turned or landed; the first two
        turning points [V/omega], ``nan`` for none; the integral of the divergence, 0 unless asked for; the
        number of steps.
    """
    drift, rest = medium.drift, 0.0
    if drift:
        rest = -acceleration(law_numbers, medium, 0.0, 1.0)
    energy = _motion_energy(e - rest, z - drift)
    unit = route.direction * first_unit(law_numbers, medium, z)
    side = z - drift or route.direction * acceleration(law_numbers, medium, e, z)
    turns = 1 if route.contact and z > drift > 0.0 else 0
    time, first, second, end, gain, steps = 0.0, math.nan, math.nan, EXHAUSTED, 0.0, 0
    for _ in range(route.max_steps):
        steps += 1
        order, share, now, unit = expand(law_numbers, medium, e, z, unit, LONGEST, route.error, work)
        if not abs(unit) > 1e-13:  # a motion does not move on in double precision
            break
        e_after, z_after = place_and_speed(work, order, share)
        cut = share
        if route.contact and (turns == 2 or drift < 0.0):
            end, cut = _find_landing(medium, work, order, share, e_after, z_after)
        elif drift >= 0.0 and (z_after - drift) * side <= 0.0 and share > 0.0:
            turn = find_level(work, RELATIVE_SPEED, order, share, z_after, drift)
            turns, side = turns + 1, -side
            first = place_and_speed(work, order, turn)[0] if turns == 1 else first
            second = place_and_speed(work, order, turn)[0] if turns == 2 else second
            end = TURNED if turns == route.last else EXHAUSTED
            if end == TURNED or (turns == 2 and z_after <= 0.0):
                cut = turn
        if cut != share:
            e_after, z_after = place_and_speed(work, order, cut)
        gain += _integrate_divergence(law_numbers, medium, work, order, cut, now, route.weigh)
        time, e, z = time + cut * now, e_after, z_after
        if end == EXHAUSTED and drift >= 0.0:
            end = _fading_end(medium, route.direction, energy, _motion_energy(e - rest, z - drift), z)
        if end != EXHAUSTED:
            break
    place = e if end in (TURNED, LANDED) else math.nan
    time = time if end in (TURNED, LANDED) else math.nan
    return end, time, place, first, second, gain, steps


def _integrate_divergence(
    law_numbers: Any,
    medium: Medium,
    work: Sequence[float],
    order: int,
    share: float,
    unit: float,
    weigh: bool,
) -> float:
    """Return the integral of the flow's divergence over a step; 0 where ``weigh`` is not set.

    Args:
        law_numbers: The law.
        medium: What the lining slips in.
        work: The series of the step.
        order: Highest power in them.
        share: Length of the step in units of time.
        unit: The unit, negative back in time [1/omega].
        weigh: Whether to integrate.
    """
    total = 0.0
    for k in range(len(_NODES) if weigh else 0):
        _, z = place_and_speed(work, order, _NODES[k] * share)
        slope = friction_slope(law_numbers, medium.origin + medium.speed * z)
        total -= _WEIGHTS[k] * (medium.damping + medium.force * medium.speed * slope)
    return total * share * unit


def _motion_energy(e: float, z: float) -> float:
    """Return twice the energy of a motion about its rest, in the units of ``e`` and ``z``."""
    return e * e + z * z  # a power raises where it overflows


def _find_landing(
    medium: Medium, work: Sequence[float], order: int, share: float, e: float, z: float
) -> tuple[int, float]:
    """Find the end of a step that touches the belt, or passes the last place at which the belt could hold.

    Args:
        medium: What it slips in.
        work: The series of the step.
        order: Highest power in them.
        share: Length of the step in their unit.
        e: Displacement as it ends.
        z: Relative speed as it ends.

    Returns:
        ``LANDED`` or ``MISSED``, and the length of the step up to there; ``EXHAUSTED`` and ``share`` for
        neither.
    """
    if z > medium.drift > 0.0:  # it has turned once more: further rounds lie within this one
        return MISSED, share
    hold, end = -medium.offset, EXHAUSTED
    if medium.drift > 0.0 and e > hold:
        if work[PLACE] > hold:
            return MISSED, 0.0
        share, end = find_level(work, PLACE, order, share, e, hold), MISSED
        _, z = place_and_speed(work, order, share)
    if z < 0.0:
        share, end = find_level(work, RELATIVE_SPEED, order, share, z, 0.0), LANDED
    return end, share


def _fading_end(medium: Medium, direction: float, begun: float, now: float, z: float) -> int:
    """Decide whether a motion has ended without a turn.

    Args:
        medium: What it slips in.
        direction: 1 forward in time, -1 back.
        begun: Its energy at the begin.
        now: Its energy now.
        z: Its relative speed now.

    Returns:
        ``RESTED`` where its energy has faded to 1e-12; ``LEFT`` where, back in time, it has gone through the
        belt, or grown beyond return; else ``EXHAUSTED``.
    """
    if now < 1e-12 * begun:
        return RESTED
    through = medium.origin + medium.speed * z < -1e-3 * medium.speed
    return LEFT if direction < 0.0 and (through or now > 1e12 * (1.0 + begun)) else EXHAUSTED
