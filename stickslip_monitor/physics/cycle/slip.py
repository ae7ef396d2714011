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
from typing import TypeAlias

from stickslip_monitor.physics.cycle.step import Medium, acceleration, slip_step
from stickslip_monitor.physics.law_numbers import (
    EDGES,
    HOLD,
    PIECES,
    STEEPEST,
    LawNumbers,
    forward_coefficient,
    friction_drop,
    friction_slope,
    law_piece,
)
from stickslip_monitor.physics.roots import (
    begun_bracket,
    best_of,
    is_found,
    narrowed,
    next_trial,
)

Orbit: TypeAlias = tuple[float, float, float, float, float]

# How an orbit ended, or what a step ended with.
EXHAUSTED, LANDED, MISSED, RETURNED, SETTLED, ESCAPED, GOES_ON, TURNED = range(8)
# What is looked for: nothing but turning points, the contact, or the level that decides on it.
TURNS, CONTACT, LEVEL = 0.0, 1.0, 2.0
# Orbits: stage at the start, stage that ends them, direction in time, what is looked for, and the
# error of a step in units of the motion. In even stages the lining moves with the belt, in odd
# ones against it. (All as floats: numba would compile a copy of a function for each value of a
# constant flag.)
BEHIND, AHEAD = (0.0, 3.0, 1.0, CONTACT, 1e-13), (0.0, 9.0, 1.0, CONTACT, 1e-13)
AROUND, BACKWARD = (1.0, 3.0, -1.0, TURNS, 1e-13), (0.0, 1.0, -1.0, TURNS, 1e-13)
GRAZING, ROUGHLY = (0.0, 3.0, 1.0, LEVEL, 1e-13), (0.0, 3.0, 1.0, LEVEL, 1e-9)
ONLY, WEIGHED = 0.0, 1.0
SMALLEST_UNSTABLE, LARGEST_STABLE = -1.0, 1.0
# What a cycle is; the numbers of cycles.CycleKind.
STICK_SLIP, OVERTAKING, PURE_SLIP, NO_CYCLE, AT_REST, NO_CONTACT, NOT_FINITE, UNRESOLVED = range(8)

SLIP_STEPS, _LONGEST_SLIP, _SHORTEST_SLIP = 20000, 1.0, 1e-13
# Share of the energy at the start below which an orbit that does not turn has come to rest, and
# the growth of energy, back in time, from which no orbit comes back; or way beyond the belt.
_SETTLED_SHARE, _ESCAPED_SHARE, _THROUGH = 1e-12, 1e12, 1e-3
# Beyond this friction force, in units of m omega V, the numbers run out.
_GREATEST_FORCE = 1e150
_LARGEST_EXPONENT = 700.0
# Relative speed below which an orbit has certainly met the belt.
_DEEP = -0.1
# How far past an edge of a law a step is to end, relative to the belt's speed.
_AT_EDGE = 1e-6
# Gauss's nodes and weights on [0, 1].
_GAUSS_NODES = (0.06943184420297371, 0.33000947820757187, 0.6699905217924281, 0.9305681557970262)
_GAUSS_WEIGHTS = (0.17392742256872692, 0.3260725774312731, 0.3260725774312731, 0.17392742256872692)
# Fourfold increases in search of the far side of an overtaking cycle, and trials for a root.
_QUADRUPLINGS, _TRIALS = 40, 100
# Of roots; panels in which a sign change of the energy gain is looked for; a gain of energy in a
# turn that is rounding.
_ROOT, _PANELS, _BALANCED = 1e-14, 24, 1e-13


def slip_medium(
    law: LawNumbers, body: tuple[float, float, float], speed: float, load: float
) -> Medium:
    """What a lining slips in behind the belt, seen from breakaway.

    The body is its mass [kg], damping [N s/m] and stiffness [N/m]; ``V`` > 0 [m/s], ``N`` > 0 [N].
    """
    m, c, k = body
    momentum = math.sqrt(m) * math.sqrt(k)
    force = load / (momentum * speed)
    top = forward_coefficient(law, 0.0)
    return speed, force, c / momentum, force * (law[HOLD] - top), 0.0, top, 1.0


def ahead_of_belt(medium: Medium) -> Medium:
    """The same for the mirror image of a lining that overtook the belt."""
    speed, force, damping, offset, origin, top, _ = medium
    return speed, force, damping, offset, origin, top, -1.0


def steady_displacement(law: LawNumbers, medium: Medium) -> float:
    """Displacement of steady sliding behind breakaway."""
    speed, force, damping, offset, origin, top, _ = medium
    return damping - offset - force * friction_drop(law, origin, top, speed)


def about_steady_sliding(law: LawNumbers, medium: Medium) -> Medium:
    """The same motion, with displacement and relative speed counted from steady sliding."""
    speed, force, damping, _, _, _, _ = medium
    return speed, force, damping, 0.0, speed, forward_coefficient(law, speed), 0.0


def cut_step(
    law: LawNumbers,
    medium: Medium,
    begin: tuple[float, float, float],
    h: float,
    of_place: float,
    level: float,
) -> tuple[float, float, float, float]:
    """The length at which a step passes a level, and displacement, ``z`` and ``z'`` there.

    Newton's method, kept between a length before the level and one behind; the level is one of the
    displacement (``of_place`` 1.0) or of ``z`` (0.0), and has been passed at the length ``h``.
    """
    e0, z0, r0 = begin
    before, behind = 0.0, h
    first = e0 - level if of_place > 0.0 else z0 - level
    e, z, r, _ = slip_step(law, medium, e0, z0, r0, h)
    s, upward = h, (e if of_place > 0.0 else z) > level
    scale = 1e-15 * (1.0 + abs(level))
    if (first > 0.0) == upward and first != 0.0:
        return s, e, z, r
    for _ in range(60):
        miss = (e if of_place > 0.0 else z) - level
        if (miss > 0.0) == upward:
            behind = s
        else:
            before = s
        rate = medium[6] - z if of_place > 0.0 else r
        after = s - miss / rate if rate != 0.0 else before
        inside = min(before, behind) < after < max(before, behind)
        if abs(miss) <= scale or (inside and abs(after - s) <= 1e-15 * abs(h)):
            break
        if not inside:
            after = 0.5 * (before + behind)
            if after in (before, behind):
                break
        s = after
        e, z, r, _ = slip_step(law, medium, e0, z0, r0, s)
    return s, e, z, r


def step_divergence(
    law: LawNumbers, medium: Medium, begin: tuple[float, float, float], h: float
) -> float:
    """Integral over a step of the divergence of the flow, by Gauss's rule of order 8."""
    speed, force, damping, _, origin, _, _ = medium
    total = 0.0
    for i in range(4):
        z = slip_step(law, medium, begin[0], begin[1], begin[2], _GAUSS_NODES[i] * h)[1]
        slope = -force * speed * friction_slope(law, origin + speed * z)
        total += _GAUSS_WEIGHTS[i] * (slope - damping)
    return total * h


def slip_event(
    law: LawNumbers,
    medium: Medium,
    orbit: Orbit,
    stage: float,
    begin: tuple[float, float, float],
    h: float,
    after: tuple[float, float, float],
) -> tuple[int, float, float, float, float]:
    """What a step ends with, the length up to there, and displacement, ``z`` and ``z'`` there.

    ``begin`` and ``after`` are those at the begin and at the end of a step of length ``h``.
    """
    mode, hold, drift = orbit[3], -medium[3], medium[6]
    landing = mode != TURNS and (stage == 2.0 or drift < 0.0)
    place, z, rate = after
    length, event = h, GOES_ON
    if landing and drift > 0.0 and place > hold:
        if begin[0] > hold:
            return MISSED, 0.0, begin[0], begin[1], begin[2]
        length, place, z, rate = cut_step(law, medium, begin, h, 1.0, hold)
        event = MISSED if z >= 0.0 else LANDED
    if landing and z < 0.0 and mode == CONTACT:
        length, place, z, rate = cut_step(law, medium, begin, length, 0.0, 0.0)
        event = LANDED
    elif landing and z < _DEEP:
        event = LANDED
    elif event == GOES_ON and drift >= 0.0 and (z <= drift if stage % 2.0 == 1.0 else z >= drift):
        length, place, z, rate = cut_step(law, medium, begin, h, 0.0, drift)
        event = TURNED
    return event, length, place, z, rate


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
    through = medium[4] + medium[0] * z < -_THROUGH * medium[0]
    return ESCAPED if through or now > _ESCAPED_SHARE * (1.0 + energy) else GOES_ON


def until_edge(law: LawNumbers, medium: Medium, z: float, rate: float, h: float) -> float:
    """Length of a step, cut where the relative speed comes to the next piece of a law.

    A step over such an edge would be refused: the law's second derivative jumps there. The speed
    is foreseen to second order, and a little beyond the edge does no harm.
    """
    speed, force, damping, _, origin, _, drift = medium
    pieces = int(law[PIECES])
    if pieces == 0:
        return h
    v, direction = origin + speed * z, 1.0 if h > 0.0 else -1.0
    bend = drift - z - (damping + force * speed * friction_slope(law, v)) * rate
    heading = direction * rate
    # What has come so close to an edge is taken to have passed it.
    beside = v + _AT_EDGE * speed if heading > 0.0 else v - _AT_EDGE * speed
    i = law_piece(law, beside)
    length = abs(h)
    if i + 1 < pieces:
        gap = (law[EDGES + i + 1] - v) / speed + _AT_EDGE
        length = min(length, time_to_rise(heading, bend, gap))
    if i > 0:
        gap = (v - law[EDGES + i]) / speed + _AT_EDGE
        length = min(length, time_to_rise(-heading, -bend, gap))
    return direction * length


def time_to_rise(rate: float, bend: float, gap: float) -> float:
    """The time after which ``rate t + bend t^2/2`` first reaches a gap > 0; ``inf`` for never."""
    square = rate * rate + 2.0 * bend * gap
    fastest = rate + math.sqrt(square) if square > 0.0 else 0.0
    return 2.0 * gap / fastest if fastest > 0.0 else math.inf


def next_length(h: float, error: float, allowed: float) -> float:
    """Length of the step after one of length ``h``, or in its place if that was too long."""
    share = 5.0 if error == 0.0 else min(max(0.9 * (allowed / error) ** 0.125, 0.2), 5.0)
    if not error <= allowed:
        share = min(share, 0.5) if share >= 0.2 else 0.2
    length = min(abs(h) * share, _LONGEST_SLIP)
    return length if h > 0.0 else -length


def follow_slip(
    law: LawNumbers, medium: Medium, e: float, z: float, orbit: Orbit, weigh: float
) -> tuple[int, float, float, float, float, float, float]:
    """Follow one orbit from a displacement and a relative speed to its end.

    Args:
        law: The law.
        medium: What the motion takes place in.
        e: Displacement.
        z: Relative speed.
        orbit: ``BEHIND``, ``AHEAD``, ``GRAZING``, ``AROUND`` or ``BACKWARD``.
        weigh: ``WEIGHED`` to integrate the divergence, at five times the cost, or ``ONLY``.

    Returns:
        How it ended, after which time, displacement and ``z`` there, displacement at the last
        turning points from above and from below, and the integral of the flow's divergence.
    """
    speed, force, damping, _, origin, _, drift = medium
    stage, last, direction, mode, tolerance = orbit
    rest = steady_displacement(law, medium) if drift == 1.0 else 0.0
    energy = motion_energy(e - rest, z - drift)
    r = acceleration(law, medium, e, z)
    slope = force * speed * friction_slope(law, origin + speed * z)
    h = direction * 0.1 / (1.0 + damping + abs(slope))
    time, crest, trough, divergence, event = 0.0, math.nan, math.nan, 0.0, GOES_ON
    for _ in range(SLIP_STEPS):
        length = until_edge(law, medium, z, r, h)
        e1, z1, r1, error = slip_step(law, medium, e, z, r, length)
        allowed = tolerance * (abs(e) + abs(z) + abs(length) * (abs(drift) + abs(r)))
        longest = h
        h = next_length(length, error, allowed)
        if error <= allowed and abs(h) < abs(longest) > abs(length):
            h = longest  # the step was short for the edge's sake
        if not error <= allowed:
            if not abs(h) > _SHORTEST_SLIP:
                break
            continue
        event, s, e1, z1, r1 = slip_event(
            law, medium, orbit, stage, (e, z, r), length, (e1, z1, r1)
        )
        if weigh > 0.0:
            divergence += step_divergence(law, medium, (e, z, r), s)
        time, e, z, r = time + s, e1, z1, r1
        if event == TURNED:
            crest, trough = (e, trough) if r > 0.0 else (crest, e)
            stage += 1.0
            event = GOES_ON
            if stage == last:
                event = RETURNED if mode == TURNS else MISSED
        if event == GOES_ON and drift >= 0.0:
            now = motion_energy(e - rest, z - drift)
            event = motion_fades(medium, direction, energy, now, z)
        if event != GOES_ON:
            break
    end = EXHAUSTED if event == GOES_ON else event
    return end, time, e, z, crest, trough, divergence


# Kind, highest and lowest displacement beyond breakaway, time slipping, time sticking, place at
# which the lining falls behind the belt, logarithm of the Floquet multiplier.
Found: TypeAlias = tuple[int, float, float, float, float, float, float]


def absent_cycle(kind: int) -> Found:
    """What is found where there is no cycle."""
    return kind, math.nan, math.nan, math.nan, math.nan, math.nan, math.nan


def slip_round(
    law: LawNumbers, medium: Medium, start: float, weigh: float
) -> tuple[int, float, float, float, float, float, float]:
    """One slip phase behind the belt and, where the lining overtakes the belt, one ahead of it.

    Returns:
        How it ended, displacement, highest and lowest displacement and time as it falls behind
        the belt again, the displacement at which it overtook the belt (``nan``: it did not), and
        the integral of the flow's divergence.
    """
    stroke = -2.0 * medium[1] * law[HOLD]
    end, time, e, _, crest, trough, divergence = follow_slip(
        law, medium, start, 0.0, BEHIND, weigh
    )
    if end != LANDED or e >= stroke:
        return end, e, crest, trough, time, math.nan, divergence
    over = e
    # Ahead of the belt the motion is the mirror image about the middle of the two stick limits.
    end, more, e, _, _, _, further = follow_slip(
        law, ahead_of_belt(medium), stroke - e, 0.0, AHEAD, weigh
    )
    return end, stroke - e, crest, trough, time + more, over, divergence + further


def through_belt(law: LawNumbers, medium: Medium, weigh: float) -> Found:
    """The stable cycle that reaches the belt's speed."""
    end, e, crest, trough, time, over, _ = slip_round(law, medium, 0.0, ONLY)
    if end == LANDED and (e <= 0.0 or math.isnan(over)):
        return STICK_SLIP, crest, trough, time, max(-e, 0.0), 0.0, -math.inf
    if end == LANDED:
        return overtaking(law, medium, e, weigh)
    return absent_cycle(UNRESOLVED if end == EXHAUSTED else NO_CYCLE)


def overtaking(law: LawNumbers, medium: Medium, first: float, weigh: float) -> Found:
    """A cycle that passes the belt's speed twice and is never held: the fixed point of a round.

    The round that started at breakaway ended beyond it, at ``first`` > 0; orbits do not cross,
    so the fixed point lies beyond that.
    """
    high = 2.0 * first
    gain = slip_round(law, medium, high, ONLY)[1] - high
    for _ in range(_QUADRUPLINGS):
        if not gain > 0.0:
            break
        high *= 4.0
        gain = slip_round(law, medium, high, ONLY)[1] - high
    low = slip_round(law, medium, first, ONLY)[1] - first
    bracket = begun_bracket(first, low, high, gain)
    for _ in range(_TRIALS):
        if is_found(bracket, _ROOT):
            break
        start = next_trial(bracket, _ROOT)
        bracket = narrowed(bracket, start, slip_round(law, medium, start, ONLY)[1] - start)
    start = best_of(bracket)
    end, _, crest, trough, time, over, divergence = slip_round(law, medium, start, weigh)
    if end != LANDED or math.isnan(over):
        return absent_cycle(UNRESOLVED)
    # The flow jumps where friction reverses.
    stroke, jump = -2.0 * medium[1] * law[HOLD], medium[3]
    jumps = (over - stroke - jump) / (over + jump) * (start + jump) / (start - stroke - jump)
    return OVERTAKING, crest, trough, time, 0.0, start, divergence + math.log(abs(jumps))


def outermost_turn(law: LawNumbers, medium: Medium) -> float:
    """Amplitude of the orbit that grazes the belt, by going back in time from there.

    ``nan`` where it comes from no turning point, ``inf`` where that is not known.
    """
    end, _, e, _, _, _, _ = follow_slip(law, medium, -medium[3], 0.0, BACKWARD, ONLY)
    if end == EXHAUSTED:
        return math.inf
    return steady_displacement(law, medium) - e if end == RETURNED else math.nan


def energy_gain(law: LawNumbers, around: Medium, amplitude: float) -> float:
    """Relative gain of energy in a turn about steady sliding, > 0 outward."""
    # Back in time an unstable cycle attracts, however fast it repels on the way forward.
    end, _, e, _, _, _, _ = follow_slip(law, around, -amplitude, 0.0, AROUND, ONLY)
    # An orbit that came from far outside has lost energy on the way.
    return (1.0 + e / amplitude) * (1.0 - e / amplitude) if end == RETURNED else -1.0


def pure_slip(law: LawNumbers, medium: Medium, wanted: float, weigh: float) -> Found:
    """A cycle about steady sliding whose lining never reaches the belt's speed.

    ``LARGEST_STABLE`` is wanted about an unstable steady sliding; ``SMALLEST_UNSTABLE`` bounds the
    basin of a stable one.
    """
    speed, force, damping, _, _, _, _ = medium
    if (-force * speed * friction_slope(law, speed) < damping) == (wanted > 0.0):
        return absent_cycle(NO_CYCLE)
    largest = outermost_turn(law, medium)
    if not largest > 0.0:
        return absent_cycle(NO_CYCLE)
    if largest == math.inf:
        return absent_cycle(UNRESOLVED)
    around = about_steady_sliding(law, medium)
    low, high, f_low, f_high = gain_bracket(law, around, largest, wanted)
    if math.isnan(low):
        return absent_cycle(NO_CYCLE)
    bracket = begun_bracket(low, f_low, high, f_high)
    for _ in range(_TRIALS):
        if is_found(bracket, _ROOT):
            break
        a = next_trial(bracket, _ROOT)
        bracket = narrowed(bracket, a, energy_gain(law, around, a))
    a = best_of(bracket)
    end, time, _, _, crest, _, divergence = follow_slip(law, around, -a, 0.0, AROUND, weigh)
    if end != RETURNED:
        return absent_cycle(UNRESOLVED)
    return PURE_SLIP, crest, -a, -time, 0.0, a, -divergence


def gain_bracket(
    law: LawNumbers, around: Medium, largest: float, wanted: float
) -> tuple[float, float, float, float]:
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
    return low, high, f_low, f_high


def stable_cycle(
    law: LawNumbers, body: tuple[float, float, float], speed: float, load: float, weigh: float
) -> Found:
    """The stable cycle at any numbers: through the belt's speed or, without one, slower."""
    kind = why_no_cycle(law, body, speed, load)
    if kind != STICK_SLIP:
        return absent_cycle(kind)
    medium = slip_medium(law, body, abs(speed), load)
    found = through_belt(law, medium, weigh)
    if found[0] != NO_CYCLE:
        return found
    return pure_slip(law, medium, LARGEST_STABLE, weigh)


def unstable_cycle(
    law: LawNumbers, body: tuple[float, float, float], speed: float, load: float
) -> Found:
    """The smallest unstable cycle without stick about a stable steady sliding."""
    kind = why_no_cycle(law, body, speed, load)
    if kind != STICK_SLIP:
        return absent_cycle(kind)
    medium = slip_medium(law, body, abs(speed), load)
    return pure_slip(law, medium, SMALLEST_UNSTABLE, WEIGHED)


def why_no_cycle(
    law: LawNumbers, body: tuple[float, float, float], speed: float, load: float
) -> int:
    """Why there is certainly no cycle; ``STICK_SLIP`` where there may be one."""
    if not (math.isfinite(speed) and math.isfinite(load)):
        return NOT_FINITE
    if speed == 0.0:
        return AT_REST
    if load <= 0.0:
        return NO_CONTACT
    # Without a gain at any speed the flow contracts everywhere (Bendixson's criterion).
    if not load * law[STEEPEST] > body[1]:
        return NO_CYCLE
    if not load / abs(speed) < _GREATEST_FORCE * math.sqrt(body[0]) * math.sqrt(body[2]):
        return UNRESOLVED
    return STICK_SLIP


def amplitude_of_cycle(
    law: LawNumbers, body: tuple[float, float, float], speed: float, load: float
) -> float:
    """Half the peak-to-peak displacement of the stable cycle [m]; ``nan`` where there is none."""
    found = stable_cycle(law, body, speed, load, ONLY)
    omega = math.sqrt(body[2] / body[0])
    return 0.5 * (found[1] - found[2]) * abs(speed) / omega


def grazing_margin(
    law: LawNumbers, body: tuple[float, float, float], speed: float, load: float, orbit: Orbit
) -> float:
    """Signed distance of the slip phase from grazing, > 0 where it meets the belt.

    It is smooth where it vanishes: minus the relative speed at the displacement at which the belt
    could just hold the lining; -1 for a lining that never comes back to there.
    """
    if why_no_cycle(law, body, speed, load) != STICK_SLIP:
        return -1.0
    medium = slip_medium(law, body, speed, load)
    end, _, _, z, _, _, _ = follow_slip(law, medium, 0.0, 0.0, orbit, ONLY)
    return -z if end == LANDED or (end == MISSED and z < 1.0) else -1.0


def cycles_of_points(
    law: LawNumbers,
    body: tuple[float, float, float],
    speeds: Sequence[float],
    loads: Sequence[float],
    wanted: float,
    out: Sequence[MutableSequence[float]],
) -> None:
    """Write what :func:`stable_cycle` or :func:`unstable_cycle` finds, its numbers in columns."""
    for i in range(len(speeds)):
        if wanted > 0.0:
            found = stable_cycle(law, body, speeds[i], loads[i], WEIGHED)
        else:
            found = unstable_cycle(law, body, speeds[i], loads[i])
        out[0][i], out[1][i], out[2][i] = found[0], found[1], found[2]
        out[3][i], out[4][i], out[5][i], out[6][i] = found[3], found[4], found[5], found[6]
