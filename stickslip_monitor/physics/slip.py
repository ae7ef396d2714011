# SPDX-License-Identifier: Apache-2.0
"""The slip phase, followed from event to event, and the cycles that are made of it.

Plain functions of numbers, which run as they stand and compiled alike. Lengths are in units of
``V/omega`` and times of ``1/omega``; displacements of a lining that slips through the belt's speed
count from breakaway, relative speeds ``z`` from the belt. A lining turns where its own velocity
vanishes (``z`` = 1). It can meet the belt (``z`` = 0) only on its way back from the turning point
below, and only before it has passed the displacement at which the belt could just hold it: there,
with the law continued below ``z`` = 0, the sign of ``z`` separates hit from miss, so no step can
jump over a contact, and that ``z`` depends smoothly on speed and load.
"""

from __future__ import annotations

import math
from collections.abc import MutableSequence, Sequence
from typing import NamedTuple

from stickslip_monitor.physics.roots import begun_bracket, best_of, is_found, narrowed, next_trial
from stickslip_monitor.physics.scalar_law import LawInUse, friction_drop, friction_slope
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


class Orbit(NamedTuple):
    """How an orbit is followed.

    Attributes:
        stage: At the start; in even stages the lining moves with the belt, in odd ones against it.
        last: The stage that ends it.
        direction: In time, 1 or -1.
        mode: What is looked for: ``TURNS`` or ``CONTACT``.
        tolerance: Error of a step in units of the motion.
    """

    stage: float
    last: float
    direction: float
    mode: float
    tolerance: float


class Oscillator(NamedTuple):
    """Mass [kg], damping [N s/m] and stiffness [N/m]."""

    mass: float
    damping: float
    stiffness: float


class Followed(NamedTuple):
    """How an orbit ended, when and where.

    Attributes:
        end: What ended it.
        time: After which time.
        e: Displacement there.
        z: Relative speed there.
        crest: Displacement at the last turning point from above.
        trough: At the last one from below.
        divergence: Integral of the flow's divergence.
    """

    end: int
    time: float
    e: float
    z: float
    crest: float
    trough: float
    divergence: float


class Round(NamedTuple):
    """A round from falling behind the belt to falling behind it again.

    Attributes:
        end: What ended it.
        e: Displacement there.
        crest: Highest displacement.
        trough: Lowest.
        time: How long it took.
        over: Displacement at which the lining overtook the belt; ``nan``: it did not.
        divergence: Integral of the flow's divergence.
    """

    end: int
    e: float
    crest: float
    trough: float
    time: float
    over: float
    divergence: float


class FoundCycle(NamedTuple):
    """A cycle.

    Attributes:
        kind: Its kind, a number of ``cycles.CycleKind``.
        crest: Highest displacement beyond breakaway.
        trough: Lowest.
        slipping: Time slipping.
        sticking: Time sticking.
        start: The place at which the lining falls behind the belt.
        exponent: Logarithm of the Floquet multiplier.
    """

    kind: int
    crest: float
    trough: float
    slipping: float
    sticking: float
    start: float
    exponent: float


# How an orbit ended, or what a step ended with.
EXHAUSTED, LANDED, MISSED, RETURNED, SETTLED, ESCAPED, GOES_ON, TURNED = range(8)
# What is looked for: nothing but turning points, or the contact.
TURNS, CONTACT = 0.0, 1.0
# (All as floats: numba would compile a copy of a function for each value of a constant flag.)
BEHIND, AHEAD = Orbit(0.0, 3.0, 1.0, CONTACT, 1e-13), Orbit(0.0, 9.0, 1.0, CONTACT, 1e-13)
AROUND, BACKWARD = Orbit(1.0, 3.0, -1.0, TURNS, 1e-13), Orbit(0.0, 1.0, -1.0, TURNS, 1e-13)
ONLY, WEIGHED = 0.0, 1.0
# Of stable cycles without stick one about an unstable steady sliding, or about any.
SMALLEST_UNSTABLE, LARGEST_STABLE, BESIDE_STABLE = -1.0, 1.0, 2.0
# What a cycle is; the numbers of cycles.CycleKind.
STICK_SLIP, OVERTAKING, PURE_SLIP, NO_CYCLE, AT_REST, NO_CONTACT, NOT_FINITE, UNRESOLVED = range(8)

SLIP_STEPS, _SHORTEST_SLIP = 20000, 1e-13
# Share of the energy at the start below which an orbit that does not turn has come to rest, and
# the growth of energy, back in time, from which no orbit comes back; or way beyond the belt.
_SETTLED_SHARE, _ESCAPED_SHARE, _THROUGH = 1e-12, 1e12, 1e-3
# Beyond this friction force, in units of m omega V, the numbers run out.
_GREATEST_FORCE = 1e150
_LARGEST_EXPONENT = 700.0
# Gauss's nodes and weights on [0, 1].
_GAUSS_NODES = (0.06943184420297371, 0.33000947820757187, 0.6699905217924281, 0.9305681557970262)
_GAUSS_WEIGHTS = (0.17392742256872692, 0.3260725774312731, 0.3260725774312731, 0.17392742256872692)
# Fourfold increases in search of the far side of an overtaking cycle, and trials for a root.
_QUADRUPLINGS, _TRIALS = 40, 100
# Of roots; panels in which a sign change of the energy gain is looked for; a gain of energy in a
# turn that is rounding.
_ROOT, _PANELS, _BALANCED = 1e-14, 24, 1e-13


def slip_medium(law: LawInUse, body: Oscillator, speed: float, load: float) -> Medium:
    """What a lining slips in behind the belt, seen from breakaway: ``V`` > 0 [m/s], ``N`` > 0 [N].

    >>> law = scalar_law(Stribeck(0.3, 0.1, 10.0)).plain
    >>> slip_medium(law, Oscillator(50.0, 400.0, 2e6), 0.1, 1000.0).damping
    0.04
    """
    momentum = math.sqrt(body.mass) * math.sqrt(body.stiffness)
    force = load / (momentum * speed)
    held = force * (law.hold - law.top)
    return Medium(speed, force, body.damping / momentum, held, 0.0, 1.0, 0.0, 0.0, 0.0)


def ahead_of_belt(medium: Medium) -> Medium:
    """The same for the mirror image of a lining that overtook the belt."""
    speed, force, damping, offset, origin, _, _, _, _ = medium
    return Medium(speed, force, damping, offset, origin, -1.0, 0.0, 0.0, 0.0)


def steady_displacement(law: LawInUse, medium: Medium) -> float:
    """Displacement of steady sliding behind breakaway: where ``z' = 0`` at ``z = 1``."""
    drop = friction_drop(law.own, medium.origin, medium.speed)
    return medium.damping - medium.offset - medium.force * drop


def about_steady_sliding(medium: Medium) -> Medium:
    """The same motion, with displacement and relative speed counted from steady sliding."""
    speed, force, damping, _, _, _, _, _, _ = medium
    return Medium(speed, force, damping, 0.0, speed, 0.0, 0.0, 0.0, 0.0)


def step_divergence(law: LawInUse, medium: Medium, begin: SlipState, h: float) -> float:
    """Integral over a step of the divergence of the flow, by Gauss's rule of order 8."""
    total = 0.0
    for i in range(4):
        z = slip_step(law.own, medium, begin, _GAUSS_NODES[i] * h).state.z
        slope = friction_slope(law.own, medium.origin + medium.speed * z)
        total -= _GAUSS_WEIGHTS[i] * (medium.force * medium.speed * slope + medium.damping)
    return total * h


class SlipEvent(NamedTuple):
    """What a step ends with, its length up to there, and the state."""

    event: int
    length: float
    state: SlipState


def has_turned(z: float, drift: float, stage: float) -> bool:
    """Whether the lining's own velocity has changed its sign since a stage began."""
    return z <= drift if stage % 2.0 == 1.0 else z >= drift


def slip_event(
    law: LawInUse, medium: Medium, orbit: Orbit, stage: float, begin: SlipState, step: SlipEvent
) -> SlipEvent:
    """What a step ends with that began in a state and goes on to the end of ``step``."""
    hold, drift = -medium.offset, medium.drift
    landing = orbit.mode != TURNS and (stage == 2.0 or drift < 0.0)
    event, length, after = step
    if landing and drift > 0.0 and after.e > hold:
        if begin.e > hold:
            return SlipEvent(MISSED, 0.0, begin)
        length, after = cut_step(law.own, medium, begin, length, PLACE, hold)
        event = MISSED if after.z >= 0.0 else LANDED
    if landing and after.z < 0.0 and orbit.mode == CONTACT:
        length, after = cut_step(law.own, medium, begin, length, RELATIVE_SPEED, 0.0)
        event = LANDED
    elif event == GOES_ON and drift >= 0.0 and has_turned(after.z, drift, stage):
        length, after = cut_step(law.own, medium, begin, length, RELATIVE_SPEED, drift)
        event = TURNED
    return SlipEvent(event, length, after)


def motion_energy(e: float, z: float) -> float:
    """Twice the energy of a displacement and a relative speed about steady sliding.

    A power of floats raises where it overflows; a product is ``inf``.
    """
    return e * e + z * z


def motion_fades(medium: Medium, direction: float, energy: float, now: float, z: float) -> int:
    """Whether a motion has come to rest or, back in time, has left for good; else ``GOES_ON``.

    By its energy about steady sliding at the start and now.
    """
    if direction > 0.0:
        return SETTLED if now < _SETTLED_SHARE * energy else GOES_ON
    through = medium.origin + medium.speed * z < -_THROUGH * medium.speed
    return ESCAPED if through or now > _ESCAPED_SHARE * (1.0 + energy) else GOES_ON


def follow_slip(law: LawInUse, medium: Medium, e: float, z: float, orbit: Orbit, weigh: float) -> Followed:
    """Follow one orbit from a displacement and a relative speed to its end.

    Args:
        law: The law.
        medium: What the motion takes place in.
        e: Displacement.
        z: Relative speed.
        orbit: ``BEHIND``, ``AHEAD``, ``AROUND`` or ``BACKWARD``.
        weigh: ``WEIGHED`` to integrate the divergence, at five times the cost, or ``ONLY``.
    """
    drift, stage, direction = medium.drift, orbit.stage, orbit.direction
    rest = steady_displacement(law, medium) if drift == 1.0 else 0.0
    energy = motion_energy(e - rest, z - drift)
    state = SlipState(e, z, acceleration(law.own, medium, e, z))
    slope = friction_slope(law.own, medium.origin + medium.speed * z)
    h = direction * 0.1 / (1.0 + medium.damping + abs(medium.force * medium.speed * slope))
    time, crest, trough, divergence, event = 0.0, math.nan, math.nan, 0.0, GOES_ON
    for _ in range(SLIP_STEPS):
        length = until_kink(law.own, law.kinks, medium, state, h)
        after, error = slip_step(law.own, medium, state, length)
        moved = abs(state.e) + abs(state.z) + abs(length) * (abs(drift) + abs(state.rate))
        allowed = orbit.tolerance * moved
        longest = h
        h = next_length(length, error, allowed)
        if error <= allowed and abs(h) < abs(longest) > abs(length):
            h = longest  # the step was short for the kink's sake
        if not error <= allowed:
            if not abs(h) > _SHORTEST_SLIP:
                break
            continue
        event, s, after = slip_event(law, medium, orbit, stage, state, SlipEvent(GOES_ON, length, after))
        if weigh > 0.0:
            divergence += step_divergence(law, medium, state, s)
        time, state = time + s, after
        if event == TURNED:
            crest, trough = (state.e, trough) if state.rate > 0.0 else (crest, state.e)
            stage += 1.0
            event = GOES_ON
            if stage == orbit.last:
                event = RETURNED if orbit.mode == TURNS else MISSED
        if event == GOES_ON and drift >= 0.0:
            now = motion_energy(state.e - rest, state.z - drift)
            event = motion_fades(medium, direction, energy, now, state.z)
        if event != GOES_ON:
            break
    end = EXHAUSTED if event == GOES_ON else event
    return Followed(end, time, state.e, state.z, crest, trough, divergence)


def absent_cycle(kind: int) -> FoundCycle:
    """What is found where there is no cycle."""
    return FoundCycle(kind, math.nan, math.nan, math.nan, math.nan, math.nan, math.nan)


def slip_round(law: LawInUse, medium: Medium, start: float, weigh: float) -> Round:
    """One slip phase behind the belt and, where the lining overtakes the belt, one ahead of it."""
    stroke = -2.0 * medium.force * law.hold
    one = follow_slip(law, medium, start, 0.0, BEHIND, weigh)
    if one.end != LANDED or one.e >= stroke:
        return Round(one.end, one.e, one.crest, one.trough, one.time, math.nan, one.divergence)
    # Ahead of the belt the motion is the mirror image about the middle of the two stick limits.
    two = follow_slip(law, ahead_of_belt(medium), stroke - one.e, 0.0, AHEAD, weigh)
    time, divergence = one.time + two.time, one.divergence + two.divergence
    return Round(two.end, stroke - two.e, one.crest, one.trough, time, one.e, divergence)


def through_belt(law: LawInUse, medium: Medium, weigh: float) -> FoundCycle:
    """The stable cycle that reaches the belt's speed."""
    one = slip_round(law, medium, 0.0, ONLY)
    if one.end == LANDED and (one.e <= 0.0 or math.isnan(one.over)):
        stick = max(-one.e, 0.0)
        return FoundCycle(STICK_SLIP, one.crest, one.trough, one.time, stick, 0.0, -math.inf)
    if one.end == LANDED:
        return overtaking(law, medium, one.e, weigh)
    return absent_cycle(UNRESOLVED if one.end == EXHAUSTED else NO_CYCLE)


def reaches_belt(law: LawInUse, body: Oscillator, speed: float, load: float) -> bool:
    """Whether the slip phase from breakaway meets the belt at a speed [m/s] and a load > 0 [N]."""
    medium = slip_medium(law, body, abs(speed), load)
    return follow_slip(law, medium, 0.0, 0.0, BEHIND, ONLY).end == LANDED


def overtaking(law: LawInUse, medium: Medium, first: float, weigh: float) -> FoundCycle:
    """A cycle that passes the belt's speed twice and is never held: the fixed point of a round.

    The round that started at breakaway ended beyond it, at ``first`` > 0; orbits do not cross,
    so the fixed point lies beyond that.
    """
    high = 2.0 * first
    gain = slip_round(law, medium, high, ONLY).e - high
    for _ in range(_QUADRUPLINGS):
        if not gain > 0.0:
            break
        high *= 4.0
        gain = slip_round(law, medium, high, ONLY).e - high
    low = slip_round(law, medium, first, ONLY).e - first
    bracket = begun_bracket(first, low, high, gain)
    for _ in range(_TRIALS):
        if is_found(bracket, _ROOT):
            break
        start = next_trial(bracket, _ROOT)
        bracket = narrowed(bracket, start, slip_round(law, medium, start, ONLY).e - start)
    start = best_of(bracket)
    one = slip_round(law, medium, start, weigh)
    if one.end != LANDED or math.isnan(one.over):
        return absent_cycle(UNRESOLVED)
    # The flow jumps where friction reverses.
    stroke, jump = -2.0 * medium.force * law.hold, medium.offset
    jumps = (one.over - stroke - jump) / (one.over + jump) * (start + jump)
    exponent = one.divergence + math.log(abs(jumps / (start - stroke - jump)))
    return FoundCycle(OVERTAKING, one.crest, one.trough, one.time, 0.0, start, exponent)


def outermost_turn(law: LawInUse, medium: Medium) -> float:
    """Amplitude of the orbit that grazes the belt, by going back in time from there.

    ``nan`` where it comes from no turning point, ``inf`` where that is not known.
    """
    back = follow_slip(law, medium, -medium.offset, 0.0, BACKWARD, ONLY)
    if back.end == EXHAUSTED:
        return math.inf
    return steady_displacement(law, medium) - back.e if back.end == RETURNED else math.nan


def energy_gain(law: LawInUse, around: Medium, amplitude: float) -> float:
    """Relative gain of energy, back in time, of a turn about steady sliding; -1 where none ends.

    >>> law = scalar_law(Coulomb(0.0, 0.0)).plain
    >>> abs(energy_gain(law, Medium(1.0, 0.0, 0.0, 0.0, 1.0, 0.0), 0.5)) < 1e-12
    True
    """
    turn = follow_slip(law, around, -amplitude, 0.0, AROUND, ONLY)
    # An orbit that came from far outside has lost energy on the way.
    gained = (1.0 + turn.e / amplitude) * (1.0 - turn.e / amplitude)
    return gained if turn.end == RETURNED else -1.0


def pure_slip(law: LawInUse, medium: Medium, wanted: float, weigh: float) -> FoundCycle:
    """A cycle about steady sliding whose lining never reaches the belt's speed.

    ``LARGEST_STABLE`` is wanted about an unstable steady sliding, ``BESIDE_STABLE`` about any;
    ``SMALLEST_UNSTABLE`` bounds the basin of a stable one.
    """
    growth = -medium.force * medium.speed * friction_slope(law.own, medium.speed)
    if wanted != BESIDE_STABLE and (growth < medium.damping) == (wanted > 0.0):
        return absent_cycle(NO_CYCLE)
    largest = outermost_turn(law, medium)
    if not largest > 0.0:
        return absent_cycle(NO_CYCLE)
    if largest == math.inf:
        return absent_cycle(UNRESOLVED)
    around = about_steady_sliding(medium)
    gain = gain_bracket(law, around, largest, wanted)
    if math.isnan(gain.low):
        return absent_cycle(NO_CYCLE)
    bracket = begun_bracket(gain.low, gain.at_low, gain.high, gain.at_high)
    for _ in range(_TRIALS):
        if is_found(bracket, _ROOT):
            break
        a = next_trial(bracket, _ROOT)
        bracket = narrowed(bracket, a, energy_gain(law, around, a))
    a = best_of(bracket)
    turn = follow_slip(law, around, -a, 0.0, AROUND, weigh)
    if turn.end != RETURNED:
        return absent_cycle(UNRESOLVED)
    return FoundCycle(PURE_SLIP, turn.crest, -a, -turn.time, 0.0, a, -turn.divergence)


class Gain(NamedTuple):
    """Two amplitudes and the gains of energy there."""

    low: float
    high: float
    at_low: float
    at_high: float


def gain_bracket(law: LawInUse, around: Medium, largest: float, wanted: float) -> Gain:
    """Amplitudes between which a gain of energy becomes a loss, or a loss a gain, and the gains.

    The outermost such change of a stable cycle, the innermost of an unstable one.
    """
    before, after = 1e-3 * largest / _PANELS, math.nan
    f_before = energy_gain(law, around, before)
    low, high, f_low, f_high = math.nan, math.nan, math.nan, math.nan
    for i in range(1, _PANELS + 1):
        after = largest * i / _PANELS
        f_after = energy_gain(law, around, after)
        grazes = wanted < 0.0 and i == _PANELS and abs(f_after) < _BALANCED
        if wanted * f_before > 0.0 and (wanted * f_after <= 0.0 or grazes):
            low, high, f_low, f_high = before, after, f_before, f_after
            if grazes:  # close to the fold of a stiff law the cycle is the grazing orbit itself
                f_high = 0.0
            if wanted < 0.0:
                break
        before, f_before = after, f_after
    return Gain(low, high, f_low, f_high)


def stable_cycle(
    law: LawInUse, body: Oscillator, speed: float, load: float, wanted: float, weigh: float
) -> FoundCycle:
    """The stable cycle at any numbers: through the belt's speed or, without one, slower.

    The slower one is ``wanted`` about unstable steady sliding, ``LARGEST_STABLE``, or about any,
    ``BESIDE_STABLE``.
    """
    kind = why_no_cycle(law, body, speed, load)
    if kind != STICK_SLIP:
        return absent_cycle(kind)
    medium = slip_medium(law, body, abs(speed), load)
    found = through_belt(law, medium, weigh)
    if found.kind != NO_CYCLE:
        return found
    return pure_slip(law, medium, wanted, weigh)


def unstable_cycle(law: LawInUse, body: Oscillator, speed: float, load: float) -> FoundCycle:
    """The smallest unstable cycle without stick about a stable steady sliding."""
    kind = why_no_cycle(law, body, speed, load)
    if kind != STICK_SLIP:
        return absent_cycle(kind)
    medium = slip_medium(law, body, abs(speed), load)
    return pure_slip(law, medium, SMALLEST_UNSTABLE, WEIGHED)


def why_no_cycle(law: LawInUse, body: Oscillator, speed: float, load: float) -> int:
    """Why there is certainly no cycle; ``STICK_SLIP`` where there may be one."""
    if not (math.isfinite(speed) and math.isfinite(load)):
        return NOT_FINITE
    if speed == 0.0:
        return AT_REST
    if load <= 0.0:
        return NO_CONTACT
    # Without a gain at any speed the flow contracts everywhere (Bendixson's criterion).
    if not load * law.fall > body.damping:
        return NO_CYCLE
    if not load / abs(speed) < _GREATEST_FORCE * math.sqrt(body.mass) * math.sqrt(body.stiffness):
        return UNRESOLVED
    return STICK_SLIP


def amplitude_of_cycle(law: LawInUse, body: Oscillator, speed: float, load: float, wanted: float) -> float:
    """Half the peak-to-peak displacement of the stable cycle [m]; ``nan`` where there is none."""
    found = stable_cycle(law, body, speed, load, wanted, ONLY)
    omega = math.sqrt(body.stiffness / body.mass)
    return 0.5 * (found.crest - found.trough) * abs(speed) / omega


def cycles_of_points(
    law: LawInUse,
    body: Oscillator,
    speeds: Sequence[float],
    loads: Sequence[float],
    wanted: float,
    out: Sequence[MutableSequence[float]],
) -> None:
    """Write what :func:`stable_cycle` or :func:`unstable_cycle` finds, its numbers in columns."""
    for i in range(len(speeds)):
        if wanted > 0.0:
            found = stable_cycle(law, body, speeds[i], loads[i], wanted, WEIGHED)
        else:
            found = unstable_cycle(law, body, speeds[i], loads[i])
        out[0][i], out[1][i], out[2][i] = found.kind, found.crest, found.trough
        out[3][i], out[4][i] = found.slipping, found.sticking
        out[5][i], out[6][i] = found.start, found.exponent
