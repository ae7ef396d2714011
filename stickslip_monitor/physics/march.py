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

# How a march has ended, and how a step has.
DONE, EVENTS_FULL, EXHAUSTED, NOT_FINITE = 0, 1, 2, 3
NOTHING, RELEASE_FORWARD, RELEASE_BACKWARD, CONTACT = 0, 1, 2, 3

# Error [m/s] that is no more than a number's last digits, and the shortest step.
_UNDERFLOW, _SHORTEST = 1e-280, 1e-14
# Rounding of the friction that sticking needs, as a share of its terms.
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
        limit: Most steps.
    """

    omega: float
    damping: float
    momentum: float
    tolerance: float
    limit: int


class Lines(NamedTuple):
    """Ends of the pieces [s], and on each speed [m/s] and load [N] at its begin, and rates."""

    time: Sequence[float]
    speed: Sequence[float]
    speed_rate: Sequence[float]
    load: Sequence[float]
    load_rate: Sequence[float]


class Now(NamedTuple):
    """Place of the motion, and what was counted.

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


class Advance(NamedTuple):
    """Length of a step, what it ended with, the state then, and the length to try next."""

    length: float
    event: int
    state: SlipState
    trial: float


class Whole(NamedTuple):
    """A step: when in a piece of the inputs it began, the place then, in what, and how it ended."""

    base: float
    time: float
    rest: float
    e: float
    phase: int
    medium: Medium
    begin: SlipState
    length: float
    after: SlipState


def medium_at(law: LawInUse, body: Body, lines: Lines, piece: int, s: float, side: float) -> Medium:
    """Return what the lining is in at a time since a piece began [s], seen from a side of the belt.

    ``e' = V - z, z' = V' + 2 zeta (V - z) + e - N/(m omega) mu(z)`` in units of ``1/omega``. The side of
    a lining that slips is 1 behind the belt, -1 ahead of it.
    """
    rise, growth = lines.speed_rate[piece], lines.load_rate[piece]
    speed, load = side * (lines.speed[piece] + rise * s), lines.load[piece] + growth * s
    rise, force = side * (rise / body.omega), load / body.momentum
    force_rate = growth / (body.momentum * body.omega)
    offset = rise + body.damping * speed - force * law.top
    offset_rate = body.damping * rise - force_rate * law.top
    return Medium(1.0, force, body.damping, offset, 0.0, speed, force_rate, offset_rate, rise)


def may_meet_belt(begin: SlipState, end: SlipState, h: float) -> bool:
    """Return whether ``z``, convex where it turns, may have been below 0 within a step.

    It stays above its tangents at both ends: only where these meet below 0 it may.

    Args:
        begin: State before the step.
        end: State after it.
        h: Length of the step in units of ``1/omega``.
    """
    if not begin.rate < 0.0 < end.rate:
        return False
    s = (end.z - begin.z - end.rate * h) / (begin.rate - end.rate)
    return not begin.z + begin.rate * s > 0.0


def speed_scale(law_numbers: Any, medium: Medium, begin: SlipState, length: float) -> float:
    """Return the scale of the relative speeds in a step, to which its error limit is relative.

    Args:
        law_numbers: :attr:`LawInUse.numbers` of the friction law.
        medium: What the lining is in as the step begins.
        begin: Slip state as the step begins.
        length: Length of the step, in units of ``1/omega``.

    Returns:
        An upper estimate in the units of ``begin.z``; for a lining released from a belt at rest, the
        speed that the change of the load gives it.
    """
    size: float = abs(begin.z) + length * (abs(medium.drift) + abs(begin.rate))
    if size == 0.0:
        # Released at the limit from a belt at rest: only the change of the load moves it.
        size = 0.5 * length * length * abs(bend(law_numbers, medium, begin))
    return size


def slip_advance(
    law: LawInUse, body: Body, medium: Medium, begin: SlipState, trial: float, left: float
) -> Advance:
    """Take one step of a slip, up to a contact with the belt in it; lengths are in 1/omega.

    The state is infinite where no step is short enough.

    Args:
        law: The law.
        body: The oscillator and the accuracy.
        medium: What the lining slips in.
        begin: The state as the step begins.
        trial: Its length to try; 0 for none yet.
        left: The longest that it may be.
    """
    law_numbers, h = law.numbers, trial
    if h == 0.0:
        rate = abs(medium.force * friction_slope(law_numbers, begin.z))
        h = (
            _FIRST
            * math.sqrt(math.sqrt(math.sqrt(body.tolerance)))
            / (1.0 + body.damping + min(rate, 1.0 / _SHORTEST))
        )
    while True:
        length = min(until_kink(law_numbers, law.kinks, medium, begin, h), left)
        state, error = slip_step(law_numbers, medium, begin, length)
        allowed = max(body.tolerance * speed_scale(law_numbers, medium, begin, length), _UNDERFLOW)
        after = next_length(length, error, allowed)
        fine = error <= allowed
        if fine and begin.z == 0.0 and state.z < 0.0 and length > _SHORTEST:
            turn = begin.rate if begin.rate != 0.0 else bend(law_numbers, medium, begin)
            if turn > 0.0:  # it left the belt, and came back within the step
                fine, after = False, 0.5 * length
        if fine:
            break
        if not after > _SHORTEST * _SHORTEST:
            return Advance(length, NOTHING, SlipState(math.inf, math.inf, math.inf), 0.0)
        h = after
    after = max(after, h)  # the step was short for the sake of a kink or of the inputs
    if state.z < 0.0:
        length, state = cut_step(law_numbers, medium, begin, length, False, 0.0)
        return Advance(length, CONTACT, state, 0.0)
    if may_meet_belt(begin, state, length):
        s, lowest = cut_step(law_numbers, medium, begin, length, True, 0.0)
        if lowest.z < 0.0:
            s, lowest = cut_step(law_numbers, medium, begin, s, False, 0.0)
            return Advance(s, CONTACT, lowest, 0.0)
    return Advance(length, NOTHING, state, after)


def friction_needed(medium: Medium, e: float) -> float:
    """Return the friction that holds the lining, in units of ``m omega``: ``V' + 2 zeta V + e``."""
    return medium.drift_rate + medium.damping * medium.drift + e


def rounding_of(law: LawInUse, medium: Medium, e: float) -> float:
    """Return the rounding of the friction that sticking needs, in units of ``m omega``."""
    inner = abs(medium.drift_rate) + abs(medium.damping * medium.drift)
    return _ROUNDING * (inner + abs(e) + law.hold * abs(medium.force))


def stick_advance(law: LawInUse, medium: Medium, e: float, stalled: int, left: float) -> Advance:
    """Take one step of sticking, up to the release if it comes within the step.

    The friction needed, less what the belt can hold, is a parabola of the time on each side.

    Args:
        law: The law.
        medium: What the lining is in as the step begins.
        e: Displacement as the step begins.
        stalled: How many steps in a row have had no length. After more than ``_STALLED`` of them a short
            step is taken without a check for release, so that time goes on.
        left: The longest that the step may be, in units of ``1/omega``.

    Returns:
        The step, with the release that ends it (``RELEASE_FORWARD`` or ``RELEASE_BACKWARD``), or
        ``NOTHING`` where the lining still sticks.
    """
    length, event = left, NOTHING
    if stalled > _STALLED:
        length = min(left, _LET_LIVE)
    else:
        slack, need = rounding_of(law, medium, e), friction_needed(medium, e)
        for kind in range(RELEASE_FORWARD, RELEASE_BACKWARD + 1):
            side = 1.0 if kind == RELEASE_FORWARD else -1.0
            excess = side * need - law.hold * medium.force
            rate = side * (medium.damping * medium.drift_rate + medium.drift) - law.hold * medium.force_rate
            first = first_excess(0.0 if abs(excess) <= slack else excess, rate, side * medium.drift_rate)
            if first <= left and (event == NOTHING or first < length):
                length, event = first, kind
    return Advance(length, event, move_with_belt(medium, length), 0.0)


def move_with_belt(medium: Medium, t: float) -> SlipState:
    """Return the state after sticking for a time ``t`` [1/omega], its displacement counted from the begin."""
    return SlipState(t * (medium.drift + 0.5 * medium.drift_rate * t), 0.0, 0.0)


def first_excess(value: float, rate: float, turn: float) -> float:
    """Return the first time >= 0 after which ``value + rate t + turn t^2/2`` is positive; ``inf`` for never.

    >>> first_excess(-6.0, 1.0, 2.0), first_excess(0.0, -1.0, 1.0), first_excess(0.0, 0.0, 0.0)
    (2.0, 2.0, inf)
    """
    if value < 0.0:
        return time_to_rise(rate, turn, -value)
    if value > 0.0 or rate > 0.0 or (rate == 0.0 and turn > 0.0):
        return 0.0
    return -2.0 * rate / turn if turn > 0.0 else math.inf


def phase_after_contact(law: LawInUse, medium: Medium, e: float, sign: int) -> int:
    """Return the phase of a lining that has met the belt: 0 sticks, 1 slips behind it, -1 ahead of it.

    It sticks where friction can hold it, and never continues on the side from which it came.

    Args:
        law: The law.
        medium: What the lining is in.
        e: Displacement at the contact.
        sign: The side of the slip that ended, 1 or -1; 0 for none.
    """
    need = friction_needed(medium, e)
    limit = law.hold * max(medium.force, 0.0) + rounding_of(law, medium, e)
    if need > limit and sign <= 0:
        return 1
    if need < -limit and sign >= 0:
        return -1
    return 0


def write_samples(
    law_numbers: Any, omega: float, step: Whole, samples: MotionSamples, cursor: int, end: float
) -> int:
    """Write the samples that lie within a step to ``samples``.

    Args:
        law_numbers: The law, as :attr:`.LawInUse.numbers`.
        omega: Natural frequency [rad/s].
        step: The step.
        samples: The samples, written.
        cursor: How many are written already.
        end: Where the piece of the inputs ends with the step [s], else infinity.

    Returns:
        How many are written in all.
    """
    medium, side = step.medium, 1.0 if step.phase >= 0 else -1.0
    while cursor < len(samples.times) and samples.times[cursor] <= end:
        t = max((samples.times[cursor] - step.base) - step.time - step.rest, 0.0) * omega
        if t > step.length and end == math.inf:
            break
        t = min(t, step.length)
        state = step.after
        if step.phase == 0:
            state = move_with_belt(medium, t)
        elif t < step.length:
            state = slip_step(law_numbers, medium, step.begin, t).state
        samples.displacement[cursor] = (step.e + side * state.e) / omega
        samples.velocity[cursor] = side * (medium.drift + medium.drift_rate * t - state.z)
        samples.acceleration[cursor] = omega * (side * (medium.drift_rate - state.rate))
        samples.relative_speed[cursor] = side * state.z
        samples.phase[cursor] = step.phase
        cursor += 1
    return cursor


def recenter_medium(law: LawInUse, medium: Medium, e: float, z: float) -> Medium:
    """Return the medium with displacements counted from where the lining is, so that they keep digits.

    Where it is released at the limit, what is missing to the limit or beyond it is rounding and is left out.
    """
    speed, force, damping, offset, origin, drift, force_rate, offset_rate, drift_rate = medium
    offset += e
    if z == 0.0 and (offset < 0.0 or offset <= rounding_of(law, medium, e)):
        offset = 0.0
    return Medium(speed, force, damping, offset, origin, drift, force_rate, offset_rate, drift_rate)


def march(
    law: LawInUse, body: Body, lines: Lines, now: Now, samples: MotionSamples, log: TransitionLog
) -> tuple[int, int, float, float, float, float, int, float, int, int, int, int, int]:
    """Follow the motion to the end of the inputs, or until ``log`` is full; then it may be called again.

    Writes ``samples`` and ``log``. The status is ``DONE``, ``EVENTS_FULL`` where the log is full,
    ``EXHAUSTED`` where the limit of steps is reached, or ``NOT_FINITE`` where the state overflows.

    Returns:
        The fields of :class:`Now` as a plain tuple. Compiled code makes a named one by a call of Python,
        which runs the handler of a pending signal; numba does not check whether that has raised.
    """
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
        steps, e, side = steps + 1, omega * x, 1.0 if phase >= 0 else -1.0
        medium, begin = medium_at(law, body, lines, piece, time, side), SlipState(0.0, 0.0, 0.0)
        if phase == 0:
            step = stick_advance(law, medium, e, stalled, left * omega)
        else:
            slips += 1
            medium = recenter_medium(law, medium, side * e, side * z)
            begin = SlipState(0.0, side * z, acceleration(law.numbers, medium, 0.0, side * z))
            step = slip_advance(law, body, medium, begin, trial, left * omega)
        h, event, after, trial = step
        if not (abs(after.e) < math.inf and abs(after.z) < math.inf):
            status = NOT_FINITE
            continue
        whole = Whole(base, time, rest, e, phase, medium, begin, h, after)
        is_last = event == NOTHING and h >= left * omega
        until = end if is_last else math.inf
        cursor = write_samples(law.numbers, omega, whole, samples, cursor, until)
        x, z = (e + side * after.e) / omega, side * after.z
        stalled = stalled + 1 if h == 0.0 else 0
        # What rounding takes from the time is kept.
        more = h / omega + rest
        time, rest = time + more, more - ((time + more) - time)
        if is_last:
            time, rest = end - base, 0.0
        if event != NOTHING:
            z = 0.0
            if event != CONTACT:
                phase = 1 if event == RELEASE_FORWARD else -1
            elif stalled > _STALLED:
                phase = 0
            else:
                medium_here = medium_at(law, body, lines, piece, time, 1.0)
                phase = phase_after_contact(law, medium_here, omega * x, phase)
            log.time[events], log.phase[events] = base + (time + rest), phase
            events += 1
    return status, piece, time, rest, x, z, phase, trial, cursor, events, steps, slips, stalled
