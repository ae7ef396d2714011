# SPDX-License-Identifier: Apache-2.0
"""The inner loops of the integrator: the series of a step, the events that end it, the march.

While the lining slips in one direction the equations are analytic (on one piece of the friction
law and of the inputs), so displacement and relative speed are series in the time whose
coefficients follow from one another (Jorba and Zou, Experimental Mathematics 14, 2005). With the
relative speed ``v = V - x'`` and ``s`` its sign,

    x' = V - v        m v' = m V' + c (V - v) + k x - N s mu(|v|)

and while it sticks ``x' = V``, which polynomials in the time satisfy exactly. Events are looked
for on the polynomial of the step (:mod:`.polynomial`), and it is used up to the first of them
only. numba may compile these functions; without it they work on lists of floats. Either way the
same operations happen in the same order.
"""

from __future__ import annotations

import math
from collections.abc import MutableSequence
from typing import TypeAlias

from stickslip_monitor.physics.motion.polynomial import Vector, first_positive

Counts: TypeAlias = MutableSequence[int]
Rows: TypeAlias = MutableSequence[Vector]

# body: the oscillator and the accuracy asked for
MASS, DAMPING, STIFFNESS, OMEGA, HOLD, TOLERANCE, LONGEST = range(7)
# law: an exponential, or (CUBIC) cubics; both on the pieces between `edges`
KINETIC, GAP, DECAY, VISCOUS = range(4)
# state: relative speed, and the time since the piece began in two parts
X, V, TIME, TIME_REST = range(4)
# where: what is counted
PIECE, PHASE, LAW_PIECE, CURSOR, EVENTS, STEPS, EXPANSIONS, STALLED = range(8)
# options
ORDER, STEP_LIMIT, EVENT_LIMIT, CUBIC = range(4)
# rows of `work`, each of which holds one series
XS, VS, FS, MU, AUX, SQUARE, BELT_SPEED, LOAD, SCALED, SCRATCH = range(10)
WORK = 10

DONE, EVENTS_FULL, EXHAUSTED, NOT_FINITE = 0, 1, 2, 3
NOTHING, RELEASE_FORWARD, RELEASE_BACKWARD, CONTACT, UPPER_EDGE, LOWER_EDGE = 0, 1, 2, 3, 4, 5

STICK_DEGREE = 8

# Speed [m/s] below which the accuracy of a step is not worth a number's last digits.
_UNDERFLOW = 1e-280
_ROUNDING = 2e-15
# Events in a row, at one instant, after which sticking is let live for a while.
_STALLED, _LET_LIVE = 8, 1e-6


def horner(a: Vector, degree: int, t: float) -> float:
    """Value of the series at a time after the step's begin."""
    value = a[degree]
    for i in range(degree - 1, -1, -1):
        value = value * t + a[i]
    return value


def slope(a: Vector, degree: int, t: float) -> float:
    """Rate of the series at a time after the step's begin."""
    value = degree * a[degree]
    for i in range(degree - 1, 0, -1):
        value = value * t + i * a[i]
    return value


def shift_cubic(coefficients: Vector, piece: int, s: float, out: Vector) -> None:
    """A cubic of the inputs as a series about the time ``s`` within its piece."""
    c0, c1 = coefficients[4 * piece], coefficients[4 * piece + 1]
    c2, c3 = coefficients[4 * piece + 2], coefficients[4 * piece + 3]
    out[0] = ((c3 * s + c2) * s + c1) * s + c0
    out[1] = (3.0 * c3 * s + 2.0 * c2) * s + c1
    out[2] = 3.0 * c3 * s + c2
    out[3] = c3


def _mu_exponential(
    n: int, sign: float, gap: float, law: Vector, v: Vector, w: Vector, rate: Vector
) -> float:
    """Coefficient ``n`` of ``s (mu_k + gap exp(-beta |v|)) + nu v``; ``w`` is the exponential."""
    if n == 0:
        w[0] = math.exp(-law[DECAY] * sign * v[0])
        return sign * (law[KINETIC] + gap * w[0]) + law[VISCOUS] * v[0]
    if gap == 0.0:
        return law[VISCOUS] * v[n]
    rate[n] = n * v[n]
    total = 0.0
    for j in range(1, n + 1):
        total += rate[j] * w[n - j]
    w[n] = -law[DECAY] * sign * total / n
    return sign * gap * w[n] + law[VISCOUS] * v[n]


def _mu_cubic(
    n: int, sign: float, edge: float, cubics: Vector, piece: int, v: Vector, u: Vector, q: Vector
) -> float:
    """Coefficient ``n`` of ``s`` times a cubic in ``u = |v| - edge``; ``q`` is ``u^2``."""
    u[n] = sign * v[n]
    if n == 0:
        u[0] -= edge
    c2, c3 = cubics[4 * piece + 2], cubics[4 * piece + 3]
    value = cubics[4 * piece + 1] * u[n]
    if n == 0:
        value += cubics[4 * piece]
    if c2 != 0.0 or c3 != 0.0:
        square = 0.0
        for j in range(n + 1):
            square += u[j] * u[n - j]
        q[n] = square
        cube = 0.0
        for j in range(n + 1):
            cube += q[j] * u[n - j]
        value += c2 * square + c3 * cube
    return sign * value


def expand_slip(
    state: Vector,
    where: Counts,
    options: Counts,
    body: Vector,
    law: Vector,
    edges: Vector,
    cubics: Vector,
    work: Rows,
) -> None:
    """Write the series of displacement, relative speed and coefficient of a slip phase."""
    x, v, mu = work[XS], work[VS], work[MU]
    belt, load, aux, square = work[BELT_SPEED], work[LOAD], work[AUX], work[SQUARE]
    order, piece = options[ORDER], where[LAW_PIECE]
    sign = 1.0 if where[PHASE] > 0 else -1.0
    c, k, m = body[DAMPING], body[STIFFNESS], body[MASS]
    # Beyond the last edge the exponential is nothing, and must not be continued from there.
    gap = law[GAP] if edges[piece + 1] < math.inf else 0.0
    varies = load[1] != 0.0 or load[2] != 0.0 or load[3] != 0.0
    x[0], v[0] = state[X], state[V]
    for n in range(order):
        if options[CUBIC]:
            mu[n] = _mu_cubic(n, sign, edges[piece], cubics, piece, v, aux, square)
        else:
            mu[n] = _mu_exponential(n, sign, gap, law, v, aux, square)
        force = load[0] * mu[n]
        if varies:
            for j in range(1, min(n, 3) + 1):
                force += load[j] * mu[n - j]
        own = belt[n] - v[n]
        x[n + 1] = own / (n + 1.0)
        pull = c * own + k * x[n] - force
        v[n + 1] = belt[n + 1] + pull / (m * (n + 1.0))
        if n == 0 and v[0] == 0.0 and sign * v[1] < 0.0:
            v[1] = 0.0  # released at the limit: what is missing to it is rounding


def expand_stick(state: Vector, options: Counts, body: Vector, work: Rows) -> None:
    """Write the series of a stick phase: ``x' = V``, and the friction that this needs."""
    x, v, f, belt = work[XS], work[VS], work[FS], work[BELT_SPEED]
    for n in range(STICK_DEGREE + 1):
        x[n] = v[n] = f[n] = 0.0
    x[0] = state[X]
    for n in range(4):
        x[n + 1] = belt[n] / (n + 1.0)
    for n in range(5):
        own = body[DAMPING] * belt[n] + body[STIFFNESS] * x[n]
        f[n] = own + body[MASS] * (n + 1.0) * belt[n + 1]


def step_length(options: Counts, body: Vector, work: Rows) -> float:
    """Longest step at which the last two terms of the series meet the tolerance."""
    v, order, longest = work[VS], options[ORDER], body[LONGEST] / body[OMEGA]
    scale, h, n = abs(work[BELT_SPEED][0]) + abs(v[0]), longest, 0
    while scale == 0.0 and n < 3:  # all is at rest: what it gathers in the step
        n += 1
        scale = abs(v[n]) * longest ** (1.0 * n)
    allowed = max(body[TOLERANCE] * scale, _UNDERFLOW)
    for n in range(order - 1, order + 1):
        last = abs(v[n])
        if last > 0.0:
            h = min(h, (allowed / last) ** (1.0 / n))
    return h


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
