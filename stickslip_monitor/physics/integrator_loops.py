# SPDX-License-Identifier: Apache-2.0
"""The inner loops of the integrator: from event to event through a drive.

Speeds are in m/s, and with the natural frequency times are in ``1/omega``, displacements ``e = omega x`` in
m/s and forces in units of ``m omega``. While the lining slips it takes the steps of :mod:`.slip_series`, as
seen from its side of the belt; while it sticks ``x' = V``, and the friction that this needs is a parabola.
Either way a step is a power series of the time, and ends at the first event in it. numba may compile these
functions; without it they run on lists of floats, with the same operations in the same order.
"""

from __future__ import annotations

import math
from collections.abc import MutableSequence, Sequence
from typing import Any, NamedTuple

from stickslip_monitor.physics.series import (
    PLACE,
    RELATIVE_SPEED,
    find_level,
    find_turn,
    place_and_speed,
    value_and_slope,
)
from stickslip_monitor.physics.slip_series import LONGEST, Medium, expand, first_unit, time_to_rise

# The ways in which a march can end, and those in which a step can.
DONE, EVENTS_FULL, EXHAUSTED, NOT_FINITE = range(4)
NOTHING, RELEASE_FORWARD, RELEASE_BACKWARD, CONTACT = range(4)

# Steps without length, at one instant, after which the lining sticks for a while whatever the forces.
_MAX_STALLED = 8


class Oscillator(NamedTuple):
    """The oscillator, what holds it, and the accuracy of its steps.

    Attributes:
        omega: Natural frequency [rad/s].
        damping: ``2 zeta``.
        momentum: ``m omega`` [kg/s].
        hold: Largest coefficient of friction that sticking can carry [-].
        top: Coefficient of slow sliding [-].
        tolerance: Error of a step relative to the speeds.
        limit: Largest number of steps.
    """

    omega: float
    damping: float
    momentum: float
    hold: float
    top: float
    tolerance: float
    limit: int


class DriveLines(NamedTuple):
    """Pieces of the drive, on each of which speed and load are straight lines.

    Attributes:
        time: Begin of each piece and end of the last, shape (n + 1,) [s].
        speed: Speed as each piece begins, shape (n,) [m/s].
        speed_rate: Its rate [m/s^2].
        load: Load as each piece begins, shape (n,) [N].
        load_rate: Its rate [N/s].
    """

    time: Sequence[float]
    speed: Sequence[float]
    speed_rate: Sequence[float]
    load: Sequence[float]
    load_rate: Sequence[float]


class MarchState(NamedTuple):
    """State of a march: place of the motion, and counts.

    Attributes:
        status: ``DONE``, ``EVENTS_FULL``, ``EXHAUSTED`` or ``NOT_FINITE``.
        piece: Index of the piece of the drive.
        time: Time since the piece began [s].
        rest: What rounding took from that [s].
        x: Displacement [m].
        z: ``V - x'`` [m/s].
        phase: Sign of the relative speed; 0 while the lining sticks.
        trial: Unit of the step to try next [1/omega]; 0 for none yet.
        cursor: Number of samples written.
        events: Number of transitions in the log.
        steps: Number of steps in all phases.
        slips: Number of steps of slip phases.
        stalled: Number of steps in a row without length.
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
    """Rising times of the samples [s], and the motion at them in SI units, of one length."""

    times: Sequence[float]
    displacement: MutableSequence[float]
    velocity: MutableSequence[float]
    acceleration: MutableSequence[float]
    relative_speed: MutableSequence[float]
    phase: MutableSequence[int]


class TransitionLog(NamedTuple):
    """Times of transitions [s], and the phase after each; the length is that of the room for them."""

    time: MutableSequence[float]
    phase: MutableSequence[int]


class Advance(NamedTuple):
    """A step in the row of work.

    Attributes:
        length: Its length [1/omega].
        event: ``NOTHING``, ``RELEASE_FORWARD``, ``RELEASE_BACKWARD`` or ``CONTACT`` at its end.
        order: Highest power of the time in its series.
        unit: Length of time in whose powers they are [1/omega].
        trial: The unit to try next; 0 for none yet, ``inf`` where no step is short enough.
    """

    length: float
    event: int
    order: int
    unit: float
    trial: float


class CompletedStep(NamedTuple):
    """A step with what :func:`write_samples` needs beside it.

    Attributes:
        base: Begin of the piece of the drive [s].
        time: Time since then as the step begins [s].
        rest: What rounding took from that [s].
        e: Displacement as the step begins, times ``omega`` [m/s].
        phase: Phase during the step.
        medium: The medium as it begins.
        step: The step.
    """

    base: float
    time: float
    rest: float
    e: float
    phase: int
    medium: Medium
    step: Advance


def medium_at(body: Oscillator, lines: DriveLines, piece: int, s: float, side: float) -> Medium:
    """Return the medium of a lining at a time since a piece began, seen from a side of the belt.

    ``e' = V - z, z' = V' + 2 zeta (V - z) + e - N/(m omega) mu(z)`` in units of ``1/omega``.

    Args:
        body: The oscillator.
        lines: The drive.
        piece: Index of its piece.
        s: The time [s].
        side: 1 for a lining that sticks or slips behind the belt, -1 ahead of it.
    """
    rise, growth = lines.speed_rate[piece], lines.load_rate[piece]
    speed, load = side * (lines.speed[piece] + rise * s), lines.load[piece] + growth * s
    rise, force = side * (rise / body.omega), load / body.momentum
    force_rate = growth / (body.momentum * body.omega)
    offset = rise + body.damping * speed - force * body.top
    offset_rate = body.damping * rise - force_rate * body.top
    return Medium(1.0, force, body.damping, offset, 0.0, speed, force_rate, offset_rate, rise)


def slip_advance(
    law_numbers: Any,
    body: Oscillator,
    medium: Medium,
    z: float,
    trial: float,
    left: float,
    work: MutableSequence[float],
) -> Advance:
    """Take one step of a slip, up to a contact with the belt in it.

    Args:
        law_numbers: The law, as :class:`.LawFunctions`.
        body: The oscillator and the accuracy.
        medium: What the lining slips in.
        z: Relative speed as the step begins, not below 0 [m/s].
        trial: The unit to try; 0 for none yet [1/omega].
        left: The longest that the step may be [1/omega].
        work: Written: the series of the step.

    Returns:
        The step, with ``CONTACT`` or ``NOTHING``; its ``trial`` is 0 after a contact, and ``inf`` where no
        step is short enough for numbers.
    """
    unit = trial if trial != 0.0 else first_unit(law_numbers, medium, z)
    longest = min(left, LONGEST)
    while True:
        order, share, unit, after = expand(
            law_numbers, medium, 0.0, z, min(unit, left), longest, body.tolerance, work
        )
        if share > 0.0:
            break
        unit = after
        if not unit > 1e-28:
            return Advance(left, NOTHING, 0, unit, math.inf)
    if trial > unit:
        after = max(after, trial)  # the step was short for the sake of the inputs
    contact = find_contact(work, order, share)
    if contact < share or contact == 0.0:
        return Advance(contact * unit, CONTACT, order, unit, 0.0)
    return Advance(left if share >= left / unit else share * unit, NOTHING, order, unit, after)


def find_contact(work: MutableSequence[float], order: int, share: float) -> float:
    """Return the share of the unit at which the relative speed, begun at 0 or above, falls through 0.

    Args:
        work: The row of work; the rate of the relative speed may be written.
        order: Highest power of the relative speed.
        share: Length of the step.

    Returns:
        0 to ``share``: 0 where it begins at 0 and falls at once, ``share`` where it does not fall through 0.
    """
    end, rate = value_and_slope(work, RELATIVE_SPEED, order, share)
    if end >= 0.0 and work[RELATIVE_SPEED + 1] < 0.0 < rate:
        share_low, lowest = find_turn(work, order, share, rate)
        if lowest < 0.0:
            return find_level(work, RELATIVE_SPEED, order, share_low, lowest, 0.0)
    if end >= 0.0:
        return share
    row, last = RELATIVE_SPEED, RELATIVE_SPEED + order
    while work[row] == 0.0 and row < last:  # it leaves the belt: this contact is divided out
        row, end = row + 1, end / share
    return find_level(work, row, last - row, share, end, 0.0) if work[row] > 0.0 else 0.0


def friction_needed(medium: Medium, e: float) -> float:
    """Return the friction that holds the lining, in units of ``m omega``: ``V' + 2 zeta V + e``.

    ``e`` is its displacement times ``omega`` [m/s].
    """
    return medium.drift_rate + medium.damping * medium.drift + e


def rounding_error(body: Oscillator, medium: Medium, e: float) -> float:
    """Return the rounding error of :func:`friction_needed` less the belt's hold, in units of ``m omega``."""
    inner = abs(medium.drift_rate) + abs(medium.damping * medium.drift)
    return 2e-15 * (inner + abs(e) + body.hold * abs(medium.force))


def stick_advance(
    body: Oscillator, medium: Medium, e: float, stalled: int, left: float, work: MutableSequence[float]
) -> Advance:
    """Take one step of sticking, up to the release if it comes within the step.

    The friction needed, less what the belt can hold, is a parabola of the time on each side.

    Args:
        body: The oscillator.
        medium: What the lining is in as the step begins.
        e: Displacement as the step begins, times ``omega`` [m/s].
        stalled: Number of steps in a row without length. After more than ``_MAX_STALLED`` of them a step of
            1e-6 is taken without a check for release, so that time goes on.
        left: The longest that the step may be, in units of ``1/omega``.
        work: Written: the series of the step, its displacement counted from the begin.

    Returns:
        The step, with the release that ends it (``RELEASE_FORWARD`` or ``RELEASE_BACKWARD``), or
        ``NOTHING`` where the lining still sticks.
    """
    length, event = left, NOTHING
    if stalled > _MAX_STALLED:
        length = min(left, 1e-6)
    else:
        slack, need = rounding_error(body, medium, e), friction_needed(medium, e)
        for kind in range(RELEASE_FORWARD, RELEASE_BACKWARD + 1):
            side = 1.0 if kind == RELEASE_FORWARD else -1.0
            excess = side * need - body.hold * medium.force
            rate = side * (medium.damping * medium.drift_rate + medium.drift) - body.hold * medium.force_rate
            first = first_excess(0.0 if abs(excess) <= slack else excess, rate, side * medium.drift_rate)
            if first <= left and (event == NOTHING or first < length):
                length, event = first, kind
    work[PLACE], work[PLACE + 1], work[PLACE + 2] = 0.0, medium.drift, 0.5 * medium.drift_rate
    work[RELATIVE_SPEED] = work[RELATIVE_SPEED + 1] = work[RELATIVE_SPEED + 2] = 0.0
    return Advance(length, event, 2, 1.0, 0.0)


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


def phase_after_contact(body: Oscillator, medium: Medium, e: float, sign: int) -> int:
    """Return the phase of a lining that has met the belt: 0 sticks, 1 slips behind it, -1 ahead of it.

    It sticks where friction can hold it, and also where it would continue on the side from which it came.

    Args:
        body: The oscillator.
        medium: What the lining is in.
        e: Displacement at the contact, times ``omega`` [m/s].
        sign: The side of the slip that ended, 1 or -1; 0 for none.
    """
    need = friction_needed(medium, e)
    limit = body.hold * max(medium.force, 0.0) + rounding_error(body, medium, e)
    if need > limit and sign <= 0:
        return 1
    if need < -limit and sign >= 0:
        return -1
    return 0


def write_samples(
    work: Sequence[float], omega: float, whole: CompletedStep, samples: MotionSamples, cursor: int, end: float
) -> int:
    """Write the samples that lie within a step to ``samples``.

    Args:
        work: The series of the step.
        omega: Natural frequency [rad/s].
        whole: The step.
        samples: The samples, written.
        cursor: Number of samples that are written already.
        end: End of the piece of the drive [s] if the step ends with it, else infinity.

    Returns:
        Number of samples that are written in all.
    """
    medium, side = whole.medium, 1.0 if whole.phase >= 0 else -1.0
    length, _, order, unit, _ = whole.step
    while cursor < len(samples.times) and samples.times[cursor] <= end:
        t = max((samples.times[cursor] - whole.base) - whole.time - whole.rest, 0.0) * omega
        if t > length and end == math.inf:
            break
        t = min(t, length)
        e, _ = value_and_slope(work, PLACE, order, t / unit)
        z, rate = value_and_slope(work, RELATIVE_SPEED, order, t / unit)
        samples.displacement[cursor] = (whole.e + side * e) / omega
        samples.velocity[cursor] = side * (medium.drift + medium.drift_rate * t - z)
        samples.acceleration[cursor] = omega * (side * (medium.drift_rate - rate / unit))
        samples.relative_speed[cursor] = side * z
        samples.phase[cursor] = whole.phase
        cursor += 1
    return cursor


def recenter_medium(body: Oscillator, medium: Medium, e: float, z: float) -> Medium:
    """Return the medium with displacements counted from where the lining is, so that they keep digits.

    Where it is at the belt's speed, a distance from the limit below 0, or within rounding, becomes 0.

    Args:
        body: The oscillator.
        medium: The medium, with displacements counted from the unloaded spring.
        e: Displacement of the lining, in units of ``medium.speed`` over ``omega``.
        z: Its relative speed, in units of ``medium.speed``.
    """
    speed, force, damping, offset, origin, drift, force_rate, offset_rate, drift_rate = medium
    offset += e
    if z == 0.0 and (offset < 0.0 or offset <= rounding_error(body, medium, e)):
        offset = 0.0
    return Medium(speed, force, damping, offset, origin, drift, force_rate, offset_rate, drift_rate)


def march(
    law_numbers: Any,
    body: Oscillator,
    lines: DriveLines,
    now: MarchState,
    samples: MotionSamples,
    log: TransitionLog,
    work: MutableSequence[float],
) -> tuple[int, int, float, float, float, float, int, float, int, int, int, int, int]:
    """Follow the motion to the end of the inputs, or until ``log`` is full; call again with ``events`` 0.

    Writes ``samples`` and ``log``, and in ``work`` the series of each step. The status is ``DONE``,
    ``EVENTS_FULL`` where the log is full, ``EXHAUSTED`` where the limit of steps is reached, or
    ``NOT_FINITE`` where the state overflows.

    Returns:
        The fields of :class:`MarchState` as a plain tuple. Compiled code makes a named one by a call of
        Python, which runs the handler of a pending signal; numba does not check whether that has raised.
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
        medium = medium_at(body, lines, piece, time, side)
        if phase == 0:
            step = stick_advance(body, medium, e, stalled, left * omega, work)
        else:
            slips += 1
            medium = recenter_medium(body, medium, side * e, side * z)
            step = slip_advance(law_numbers, body, medium, side * z, trial, left * omega, work)
        h, event, order, unit, trial = step
        e_after, z_after = place_and_speed(work, order, h / unit)
        if not (trial < math.inf and abs(e_after) < math.inf and abs(z_after) < math.inf):
            status = NOT_FINITE
            continue
        whole = CompletedStep(base, time, rest, e, phase, medium, step)
        is_last = event == NOTHING and h >= left * omega
        cursor = write_samples(work, omega, whole, samples, cursor, end if is_last else math.inf)
        x, z = (e + side * e_after) / omega, side * z_after
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
            elif stalled > _MAX_STALLED:
                phase = 0
            else:
                medium_here = medium_at(body, lines, piece, time, 1.0)
                phase = phase_after_contact(body, medium_here, omega * x, phase)
            log.time[events], log.phase[events] = base + (time + rest), phase
            events += 1
    return status, piece, time, rest, x, z, phase, trial, cursor, events, steps, slips, stalled
