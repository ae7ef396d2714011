# SPDX-License-Identifier: Apache-2.0
"""The inner loops of the integrator: from event to event through a drive.

Speeds are in m/s, and with the natural frequency times are in ``1/omega``, displacements
``e = omega x`` in m/s and forces in units of ``m omega``. While the lining slips it takes the
steps of :mod:`.slip_step`, as seen from its side of the belt; while it sticks ``x' = V``, and the
friction that this needs is a parabola. A step ends at the first event in it. numba may compile
these functions; without it they run on lists of floats, with the same operations in the same
order.
"""

from __future__ import annotations

import math
from collections.abc import MutableSequence, Sequence
from typing import Any, NamedTuple

from stickslip_monitor.physics.scalar_law import LawInUse, friction_slope
from stickslip_monitor.physics.slip_step import (
    RATE,
    RELATIVE_SPEED,
    Medium,
    SlipState,
    acceleration,
    bend,
    cut_step,
    next_length,
    slip_step,
    time_to_rise,
    until_kink,
)

DONE, EVENTS_FULL, EXHAUSTED, NOT_FINITE = 0, 1, 2, 3
NOTHING, RELEASE_FORWARD, RELEASE_BACKWARD, CONTACT = 0, 1, 2, 3

# Error [m/s] that is no more than a number's last digits, and the shortest step.
_UNDERFLOW, _SHORTEST = 1e-280, 1e-14
_ROUNDING = 2e-15
# Events in a row, at one instant, after which sticking is let live for a while.
_STALLED, _LET_LIVE = 8, 1e-6
# The first step of a slip, in units of its time scale and the eighth root of the tolerance.
_FIRST = 4.0


class Body(NamedTuple):
    """The oscillator and the accuracy asked for.

    Attributes:
        omega: Natural frequency [rad/s].
        damping: ``2 zeta``.
        momentum: ``m omega`` [kg/s].
        tolerance: Error of a step relative to the speeds.
        longest: Longest step in ``1/omega``.
        limit: Most steps.
    """

    omega: float
    damping: float
    momentum: float
    tolerance: float
    longest: float
    limit: int


class Lines(NamedTuple):
    """Ends of the pieces [s], and on each speed [m/s] and load [N] at its begin, and rates."""

    time: Sequence[float]
    speed: Sequence[float]
    speed_rate: Sequence[float]
    load: Sequence[float]
    load_rate: Sequence[float]


class Place(NamedTuple):
    """Displacement ``omega x`` [m/s] and relative speed [m/s]."""

    e: float
    z: float


class DriveAt(NamedTuple):
    """The inputs at an instant: ``V``, its rate, ``N/(m omega)`` and its rate, in ``1/omega``."""

    speed: float
    rise: float
    force: float
    force_rate: float


class Now(NamedTuple):
    """Where the motion is, and what was counted.

    Attributes:
        status: ``DONE``, ``EVENTS_FULL``, ``EXHAUSTED`` or ``NOT_FINITE``.
        piece: Of the inputs.
        time: Since the piece began [s].
        rest: What rounding took from that [s].
        x: Displacement [m].
        z: ``V - x'`` [m/s].
        phase: Sign of the relative speed.
        trial: Length of the step to try next; 0 for none yet.
        cursor: MotionSamples written.
        events: Transitions in the log.
        steps: Steps in all phases.
        slips: Steps of slip phases.
        stalled: Events in a row without a step.
    """

    status: int
    piece: int
    time: float
    rest: float
    x: float
    z: float
    phase: int
    trial: float
    cursor: int
    events: int
    steps: int
    slips: int
    stalled: int


class MotionSamples(NamedTuple):
    """Times of the samples [s], and what is sampled in SI units."""

    times: Sequence[float]
    displacement: MutableSequence[float]
    velocity: MutableSequence[float]
    acceleration: MutableSequence[float]
    relative_speed: MutableSequence[float]
    phase: MutableSequence[int]


class TransitionLog(NamedTuple):
    """Transitions: when [s], and the phase after."""

    time: MutableSequence[float]
    phase: MutableSequence[int]


class Whole(NamedTuple):
    """A step: where it began, when in the piece, in what, how long it is, and where it ended."""

    base: float
    time: float
    rest: float
    phase: int
    at: DriveAt
    medium: Medium
    e: float
    begin: SlipState
    length: float
    after: SlipState


class Advance(NamedTuple):
    """Length of a step, what it ended with, the state then, and the length to try next."""

    length: float
    event: int
    state: SlipState
    trial: float


def course_at(body: Body, lines: Lines, piece: int, s: float) -> DriveAt:
    """The inputs at a time since a piece began [s]."""
    rise, growth = lines.speed_rate[piece], lines.load_rate[piece]
    load = lines.load[piece] + growth * s
    force, force_rate = load / body.momentum, growth / (body.momentum * body.omega)
    return DriveAt(lines.speed[piece] + rise * s, rise / body.omega, force, force_rate)


def medium_of(law: LawInUse, body: Body, at: DriveAt, side: float) -> Medium:
    """What the lining slips in, seen from its side of the belt: 1 behind it, -1 ahead.

    ``e' = V - z, z' = V' + 2 zeta (V - z) + e - N/(m omega) mu(z)`` in units of ``1/omega``.
    """
    speed, rise = side * at.speed, side * at.rise
    offset = rise + body.damping * speed - at.force * law.top
    offset_rate = body.damping * rise - at.force_rate * law.top
    return Medium(1.0, at.force, body.damping, offset, 0.0, speed, at.force_rate, offset_rate, rise)


def dips(begin: SlipState, end: SlipState, h: float) -> bool:
    """Whether ``z``, convex where it turns, may have been below 0 within a step.

    It stays above its tangents at both ends.
    """
    if not begin.rate < 0.0 < end.rate:
        return False
    s = (end.z - begin.z - end.rate * h) / (begin.rate - end.rate)
    return not begin.z + begin.rate * s > 0.0


def slip_advance(
    law: LawInUse, body: Body, medium: Medium, begin: SlipState, trial: float, left: float
) -> Advance:
    """One step of a slip, up to a contact with the belt in it.

    Args:
        law: The law.
        body: The oscillator and the accuracy.
        medium: What the lining slips in.
        begin: The state as the step begins.
        trial: Its length to try; 0 for none yet.
        left: The longest that it may be.
    """
    own, h = law.own, trial
    if h == 0.0:
        rate = abs(medium.force * friction_slope(own, begin.z))
        h = (
            _FIRST
            * math.sqrt(math.sqrt(math.sqrt(body.tolerance)))
            / (1.0 + body.damping + min(rate, 1.0 / _SHORTEST))
        )
    h = min(h, body.longest)
    while True:
        length = min(until_kink(own, law.kinks, medium, begin, h), left)
        state, error = slip_step(own, medium, begin, length)
        moved = abs(begin.z) + length * (abs(medium.drift) + abs(begin.rate))
        allowed = max(body.tolerance * moved, _UNDERFLOW)
        after = next_length(length, error, allowed, body.longest)
        fine = error <= allowed
        if fine and begin.z == 0.0 and state.z < 0.0 and length > _SHORTEST:
            turn = begin.rate if begin.rate != 0.0 else bend(own, medium, begin)
            if turn > 0.0:  # it left the belt, and came back within the step
                fine, after = False, 0.5 * length
        if fine:
            break
        if not after > _SHORTEST * _SHORTEST:
            return Advance(length, NOTHING, SlipState(math.inf, math.inf, math.inf), 0.0)
        h = after
    after = max(after, h)  # the step was short for the sake of a kink or of the inputs
    if state.z < 0.0:
        length, state = cut_step(own, medium, begin, length, RELATIVE_SPEED, 0.0)
        return Advance(length, CONTACT, state, 0.0)
    if dips(begin, state, length):
        s, lowest = cut_step(own, medium, begin, length, RATE, 0.0)
        if lowest.z < 0.0:
            s, lowest = cut_step(own, medium, begin, s, RELATIVE_SPEED, 0.0)
            return Advance(s, CONTACT, lowest, 0.0)
    return Advance(length, NOTHING, state, after)


def friction_needed(body: Body, at: DriveAt, e: float) -> float:
    """The friction force that holds the lining, in units of ``m omega``: ``V' + 2 zeta V + e``."""
    return at.rise + body.damping * at.speed + e


def rounding_of(law: LawInUse, body: Body, at: DriveAt, e: float) -> float:
    """Rounding of the friction that sticking needs."""
    inner = abs(at.rise) + abs(body.damping * at.speed)
    return _ROUNDING * (inner + abs(e) + law.hold * abs(at.force))


def stick_advance(law: LawInUse, body: Body, at: DriveAt, e: float, stalled: int, left: float) -> Advance:
    """One step of sticking, up to the release in it.

    The friction needed less what the belt can hold, on each side a parabola of the time.
    """
    length, event = left, NOTHING
    if stalled > _STALLED:
        length = min(left, _LET_LIVE)
    else:
        slack, need = rounding_of(law, body, at, e), friction_needed(body, at, e)
        for kind in range(RELEASE_FORWARD, RELEASE_BACKWARD + 1):
            side = 1.0 if kind == RELEASE_FORWARD else -1.0
            excess = side * need - law.hold * at.force
            rate = side * (body.damping * at.rise + at.speed) - law.hold * at.force_rate
            first = first_excess(0.0 if abs(excess) <= slack else excess, rate, side * at.rise)
            if first <= left and (event == NOTHING or first < length):
                length, event = first, kind
    moved = length * (at.speed + 0.5 * at.rise * length)
    return Advance(length, event, SlipState(moved, 0.0, 0.0), 0.0)


def first_excess(value: float, rate: float, turn: float) -> float:
    """The time >= 0 behind which ``value + rate t + turn t^2/2`` is positive first; else ``inf``.

    >>> first_excess(-6.0, 1.0, 2.0), first_excess(0.0, -1.0, 1.0), first_excess(0.0, 0.0, 0.0)
    (2.0, 2.0, inf)
    """
    if value < 0.0:
        return time_to_rise(rate, turn, -value)
    if value > 0.0 or rate > 0.0 or (rate == 0.0 and turn > 0.0):
        return 0.0
    return -2.0 * rate / turn if turn > 0.0 else math.inf


def phase_at_rest(law: LawInUse, body: Body, at: DriveAt, e: float, sign: int) -> int:
    """Phase after the relative speed vanished, coming from a slip with a sign (0: from none)."""
    need = friction_needed(body, at, e)
    limit = law.hold * max(at.force, 0.0) + rounding_of(law, body, at, e)
    if need > limit and sign <= 0:
        return 1
    if need < -limit and sign >= 0:
        return -1
    return 0


def write_samples(
    own: Any, omega: float, step: Whole, samples: MotionSamples, cursor: int, end: float
) -> int:
    """Write the samples up to the end of a step; the number of those written in all.

    Args:
        own: The law, as :attr:`.LawInUse.own`.
        omega: Natural frequency [rad/s].
        step: The step.
        samples: The samples.
        cursor: How many are written.
        end: Where the piece of the inputs ends with the step [s], else infinity.
    """
    at, side = step.at, 1.0 if step.phase >= 0 else -1.0
    while cursor < len(samples.times) and samples.times[cursor] <= end:
        t = max((samples.times[cursor] - step.base) - step.time - step.rest, 0.0) * omega
        if t > step.length and end == math.inf:
            break
        t = min(t, step.length)
        here = step.after
        if step.phase == 0:
            here = SlipState(t * (at.speed + 0.5 * at.rise * t), 0.0, 0.0)
        elif t < step.length:
            here = slip_step(own, step.medium, step.begin, t).state
        samples.displacement[cursor] = (step.e + side * here.e) / omega
        samples.velocity[cursor] = at.speed + at.rise * t - side * here.z
        samples.acceleration[cursor] = omega * (at.rise - side * here.rate)
        samples.relative_speed[cursor] = side * here.z
        samples.phase[cursor] = step.phase
        cursor += 1
    return cursor


def about_place(law: LawInUse, body: Body, at: DriveAt, medium: Medium, place: Place) -> Medium:
    """The medium with displacements counted from where the lining is, so that they keep digits.

    Where it is released at the limit, what is missing to it or beyond it is rounding.
    """
    offset = medium.offset + place.e
    slack = rounding_of(law, body, at, place.e)
    if place.z == 0.0 and (offset < 0.0 or offset <= slack):
        offset = 0.0
    speed, force, damping, _, origin, drift, force_rate, offset_rate, drift_rate = medium
    return Medium(speed, force, damping, offset, origin, drift, force_rate, offset_rate, drift_rate)


def phase_after(law: LawInUse, body: Body, at: DriveAt, e: float, event: int, sign: int) -> int:
    """The phase that an event begins, coming from one with a sign."""
    if event == CONTACT:
        return phase_at_rest(law, body, at, e, sign)
    return 1 if event == RELEASE_FORWARD else -1


def march(
    law: LawInUse, body: Body, lines: Lines, now: Now, samples: MotionSamples, log: TransitionLog
) -> Now:
    """Follow the motion to the end of the inputs; may be called again when the log is full."""
    _, piece, time, rest, x, z, phase, trial, cursor, events, steps, slips, stalled = now
    status, omega = DONE, body.omega
    while piece < len(lines.speed) and status == DONE:
        base, end = lines.time[piece], lines.time[piece + 1]
        left = ((end - base) - time) - rest
        if left <= 0.0:
            piece, time, rest = piece + 1, 0.0, 0.0
            continue
        if events >= len(log.time) or steps >= body.limit:
            status = EVENTS_FULL if events >= len(log.time) else EXHAUSTED
            continue
        at = course_at(body, lines, piece, time)
        side = 1.0 if phase >= 0 else -1.0
        medium, begin = medium_of(law, body, at, side), SlipState(0.0, 0.0, 0.0)
        steps, e = steps + 1, omega * x
        if phase == 0:
            step = stick_advance(law, body, at, e, stalled, left * omega)
        else:
            slips += 1
            medium = about_place(law, body, at, medium, Place(side * e, side * z))
            begin = SlipState(0.0, side * z, acceleration(law.own, medium, 0.0, side * z))
            step = slip_advance(law, body, medium, begin, trial, left * omega)
        h, event, after, trial = step
        if not (abs(after.e) < math.inf and abs(after.z) < math.inf):
            status = NOT_FINITE
            continue
        whole = Whole(base, time, rest, phase, at, medium, e, begin, h, after)
        is_last = event == NOTHING and h >= left * omega
        until = end if is_last else math.inf
        cursor = write_samples(law.own, omega, whole, samples, cursor, until)
        x, z = (e + side * after.e) / omega, side * after.z
        stalled = stalled + 1 if h == 0.0 else 0
        # What rounding takes from the time is kept.
        more = h / omega + rest
        time, rest = time + more, more - ((time + more) - time)
        if is_last:
            time, rest = end - base, 0.0
        if event != NOTHING:
            at, z = course_at(body, lines, piece, time), 0.0
            held = event == CONTACT and stalled > _STALLED
            phase = 0 if held else phase_after(law, body, at, omega * x, event, phase)
            log.time[events], log.phase[events] = base + (time + rest), phase
            events += 1
    return Now(status, piece, time, rest, x, z, phase, trial, cursor, events, steps, slips, stalled)
