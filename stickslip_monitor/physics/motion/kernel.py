# SPDX-License-Identifier: Apache-2.0
"""The inner loops of the integrator: the march over the steps, and the events that end them.

Events are looked for on the polynomial of the step (:mod:`.integrator_series`), and it is used up
to the first of them only. numba may compile these functions; without it they work on lists of
floats. Either way the same operations happen in the same order.
"""

from __future__ import annotations

import math

from numpy.polynomial.legendre import leggauss

from stickslip_monitor.physics.motion.step_series import (
    AUX,
    BELT,
    BELT_SPEED,
    CONTACT,
    CURSOR,
    DAMPING,
    DONE,
    EVENT_LIMIT,
    EVENTS,
    EVENTS_FULL,
    EXHAUSTED,
    EXPANSIONS,
    FRICTION,
    FS,
    HOLD,
    LAW_PIECE,
    LOAD,
    LOSS,
    LOWER_EDGE,
    MASS,
    NOT_FINITE,
    NOTHING,
    OMEGA,
    ORDER,
    PHASE,
    PIECE,
    RELEASE_BACKWARD,
    RELEASE_FORWARD,
    SCALED,
    SCRATCH,
    STALLED,
    STEP_LIMIT,
    STEPS,
    STICK_DEGREE,
    STIFFNESS,
    TIME,
    TIME_REST,
    UPPER_EDGE,
    VS,
    WITH_ENERGY,
    XS,
    Counts,
    Rows,
    V,
    Vector,
    X,
    expand_slip,
    expand_stick,
    first_positive,
    horner,
    shift_cubic,
    slope,
    step_length,
)

_ROUNDING = 2e-15
# Events in a row, at one instant, after which sticking is let live for a while.
_STALLED, _LET_LIVE = 8, 1e-6

# Gauss quadrature on [0, 1]; exact in a stick phase.
_GAUSS = leggauss(12)
_NODES = tuple((0.5 + 0.5 * _GAUSS[0]).tolist())
_WEIGHTS = tuple((0.5 * _GAUSS[1]).tolist())


def _earlier(
    sign: float,
    level: float,
    degree: int,
    h: float,
    source: Vector,
    work: Rows,
) -> float:
    """Time in [0, h] at which ``sign * source - level`` becomes positive; -1 without one."""
    scaled, power = work[SCALED], 1.0
    for i in range(degree + 1):
        scaled[i] = sign * source[i] * power
        power *= h
    scaled[0] -= level
    u = first_positive(scaled, degree, work[SCRATCH])
    return u * h if u >= 0.0 else -1.0


def slip_event(
    where: Counts, options: Counts, edges: Vector, h: float, work: Rows
) -> tuple[float, int]:
    """Length and event of a slip step that may be ``h`` long."""
    v, order, piece = work[VS], options[ORDER], where[LAW_PIECE]
    sign = 1.0 if where[PHASE] > 0 else -1.0
    event = NOTHING
    first = _earlier(-sign, -edges[piece], order, h, v, work)
    if first >= 0.0:
        h, event = first, (LOWER_EDGE if piece else CONTACT)
    if edges[piece + 1] < math.inf:
        first = _earlier(sign, edges[piece + 1], order, h, v, work)
        if first >= 0.0 and (event == NOTHING or first < h):
            h, event = first, UPPER_EDGE
    return h, event


def _slack(body: Vector, work: Rows) -> float:
    """Rounding of the force that sticking needs."""
    belt = work[BELT_SPEED]
    inner = abs(body[MASS] * belt[1]) + abs(body[DAMPING] * belt[0])
    limit = body[HOLD] * abs(work[LOAD][0])
    return _ROUNDING * (inner + abs(body[STIFFNESS] * work[XS][0]) + limit)


def stick_event(where: Counts, body: Vector, h: float, work: Rows) -> tuple[float, int]:
    """Length and event of a stick step that may be ``h`` long."""
    if where[STALLED] > _STALLED:
        return min(h, _LET_LIVE / body[OMEGA]), NOTHING
    f, load, excess, slack = work[FS], work[LOAD], work[AUX], _slack(body, work)
    event = NOTHING
    for kind in range(RELEASE_FORWARD, RELEASE_BACKWARD + 1):
        sign = 1.0 if kind == RELEASE_FORWARD else -1.0
        excess[4] = sign * f[4]
        for i in range(4):
            excess[i] = sign * f[i] - body[HOLD] * load[i]
        if abs(excess[0]) <= slack:
            excess[0] = 0.0
        first = _earlier(1.0, 0.0, 4, h, excess, work)
        if first >= 0.0 and (event == NOTHING or first < h):
            h, event = first, kind
    return h, event


def phase_at_rest(sign: int, body: Vector, work: Rows) -> int:
    """Phase after the relative speed vanished, coming from a slip with a sign (0: from none).

    ``work`` must hold the displacement in ``XS[0]`` and the inputs as series about the instant.
    """
    belt, x = work[BELT_SPEED], work[XS][0]
    need = body[MASS] * belt[1] + body[DAMPING] * belt[0] + body[STIFFNESS] * x
    limit = body[HOLD] * max(work[LOAD][0], 0.0) + _slack(body, work)
    if need > limit and sign <= 0:
        return 1
    if need < -limit and sign >= 0:
        return -1
    return 0


def _add(sums: Vector, which: int, value: float) -> None:
    """Compensated sum: Neumaier, Zeitschrift fuer Angewandte Mathematik und Mechanik 54, 1974."""
    before = sums[which]
    after = before + value
    if abs(before) >= abs(value):
        sums[which + 1] += (before - after) + value
    else:
        sums[which + 1] += (value - after) + before
    sums[which] = after


def add_energy(sums: Vector, degree: int, body: Vector, h: float, work: Rows) -> None:
    """Add the work of a step: of the belt, of friction on the lining, and the damper's loss."""
    given, taken, lost = 0.0, 0.0, 0.0
    for i in range(len(_NODES)):
        t = _NODES[i] * h
        belt = horner(work[BELT_SPEED], 3, t)
        own = belt - horner(work[VS], degree, t)
        pull = _WEIGHTS[i] * horner(work[FS], degree, t)
        given += pull * belt
        taken += pull * own
        lost += _WEIGHTS[i] * own * own
    _add(sums, BELT, given * h)
    _add(sums, FRICTION, taken * h)
    _add(sums, LOSS, body[DAMPING] * lost * h)


def emit(
    where: Counts,
    degree: int,
    base: float,
    state: Vector,
    h: float,
    end: float,
    times: Vector,
    out: Rows,
    phases: Counts,
    work: Rows,
) -> None:
    """Write the samples up to ``h`` after the step's begin, or up to the time ``end``."""
    i, n = where[CURSOR], len(times)
    while i < n and times[i] <= end:
        t = max((times[i] - base) - state[TIME] - state[TIME_REST], 0.0)
        if t > h:
            if end < math.inf:
                t = h
            else:
                break
        out[0][i] = horner(work[XS], degree, t)
        out[1][i] = horner(work[BELT_SPEED], 3, t) - horner(work[VS], degree, t)
        out[2][i] = slope(work[BELT_SPEED], 3, t) - slope(work[VS], degree, t)
        out[3][i] = horner(work[VS], degree, t)
        phases[i] = where[PHASE]
        i += 1
    where[CURSOR] = i


def advance_time(state: Vector, h: float) -> None:
    """Add a step to the time within the piece, keeping what rounding takes."""
    h += state[TIME_REST]
    before = state[TIME]
    state[TIME] = before + h
    state[TIME_REST] = h - (state[TIME] - before)


def _record(where: Counts, time: float, phase: int, log: Vector, kinds: Counts) -> None:
    log[where[EVENTS]] = time
    kinds[where[EVENTS]] = phase
    where[EVENTS] += 1
    where[PHASE] = phase
    where[LAW_PIECE] = 0


def change(
    event: int,
    base: float,
    state: Vector,
    where: Counts,
    body: Vector,
    edges: Vector,
    log: Vector,
    kinds: Counts,
    work: Rows,
) -> None:
    """Do what an event does; ``work`` must hold the inputs about its instant."""
    time = base + (state[TIME] + state[TIME_REST])
    sign = where[PHASE]
    if event in (UPPER_EDGE, LOWER_EDGE):
        up = event == UPPER_EDGE
        state[V] = sign * edges[where[LAW_PIECE] + (1 if up else 0)]
        where[LAW_PIECE] += 1 if up else -1
    elif event == CONTACT:
        state[V] = 0.0
        work[XS][0] = state[X]
        phase = 0 if where[STALLED] > _STALLED else phase_at_rest(sign, body, work)
        _record(where, time, phase, log, kinds)
    else:
        _record(where, time, 1 if event == RELEASE_FORWARD else -1, log, kinds)


def march(
    grid: Vector,
    speed: Vector,
    load: Vector,
    body: Vector,
    law: Vector,
    edges: Vector,
    cubics: Vector,
    options: Counts,
    state: Vector,
    where: Counts,
    times: Vector,
    out: Rows,
    phases: Counts,
    log: Vector,
    kinds: Counts,
    sums: Vector,
    work: Rows,
) -> int:
    """Follow the motion to the end of the inputs; may be called again when events are full."""
    pieces = len(grid) - 1
    while where[PIECE] < pieces:
        piece = where[PIECE]
        base = grid[piece]
        left = ((grid[piece + 1] - base) - state[TIME]) - state[TIME_REST]
        if left <= 0.0:
            where[PIECE] += 1
            state[TIME] = state[TIME_REST] = 0.0
            continue
        if where[EVENTS] >= options[EVENT_LIMIT]:
            return EVENTS_FULL
        if where[STEPS] >= options[STEP_LIMIT]:
            return EXHAUSTED
        where[STEPS] += 1
        shift_cubic(speed, piece, state[TIME], work[BELT_SPEED])
        shift_cubic(load, piece, state[TIME], work[LOAD])
        if where[PHASE] == 0:
            degree = STICK_DEGREE
            expand_stick(state, options, body, work)
            h, event = stick_event(where, body, left, work)
        else:
            degree = options[ORDER]
            where[EXPANSIONS] += 1
            expand_slip(state, where, options, body, law, edges, cubics, work)
            h = min(step_length(options, body, work), left)
            h, event = slip_event(where, options, edges, h, work)
        x = horner(work[XS], degree, h)
        v = horner(work[VS], degree, h)
        if not (h >= 0.0 and abs(x) < math.inf and abs(v) < math.inf):
            return NOT_FINITE
        last = event == NOTHING and h >= left
        end = grid[piece + 1] if last else math.inf
        emit(where, degree, base, state, h, end, times, out, phases, work)
        if options[WITH_ENERGY]:
            add_energy(sums, degree, body, h, work)
        state[X], state[V] = x, v
        advance_time(state, h)
        where[STALLED] = where[STALLED] + 1 if h == 0.0 else 0
        if last:
            state[TIME], state[TIME_REST] = grid[piece + 1] - base, 0.0
        if event != NOTHING:
            shift_cubic(speed, piece, state[TIME], work[BELT_SPEED])
            shift_cubic(load, piece, state[TIME], work[LOAD])
            change(event, base, state, where, body, edges, log, kinds, work)
    return DONE
