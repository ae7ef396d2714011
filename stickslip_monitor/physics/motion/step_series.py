# SPDX-License-Identifier: Apache-2.0
"""Where a polynomial first becomes positive on [0, 1], with nothing jumped over.

The coefficients of a polynomial in Bernstein's basis enclose it, and it has no more roots than
they have changes of sign (Descartes' rule; Farouki, Computer Aided Geometric Design 29, 2012).
Intervals are halved until that rule decides, so two roots close to each other, as at a grazing
contact, are found however long the step.

These are inner loops: numba may compile them, and without it they work on lists of floats.

Where the inner loops of the integrator keep what: places in their arrays, and their codes.

The series of one step: Taylor's of a slip phase, the polynomials of a stick phase.

While the lining slips in one direction the equations are analytic (on one piece of the friction
law and of the inputs), so displacement and relative speed are series in the time whose
coefficients follow from one another (Jorba and Zou, Experimental Mathematics 14, 2005). With the
relative speed ``v = V - x'`` and ``s`` its sign,

    x' = V - v        m v' = m V' + c (V - v) + k x - N s mu(|v|)

and while it sticks ``x' = V``, which polynomials in the time satisfy exactly.

These are inner loops: numba may compile them, and without it they work on lists of floats. Either
way the same operations happen in the same order.
"""

from __future__ import annotations

import math
from collections.abc import MutableSequence
from typing import TypeAlias

Vector: TypeAlias = MutableSequence[float]

# Width below which a touch that does not cross is taken for rounding: the square root of it.
_NARROW = 1e-9
_NEWTON = 100
_NONE, _ONE, _AT_ONCE, _UNCLEAR = 0, 1, 2, 3


def first_positive(c: Vector, degree: int, b: Vector) -> float:
    """Smallest ``u`` in [0, 1] behind which ``sum c[i] u^i`` is positive; -1 without one.

    Args:
        c: Coefficients, from the constant one upward.
        degree: Degree of the polynomial, >= 2.
        b: Scratch, at least ``degree + 1`` long.
    """
    if _stays_negative(c, degree):
        return -1.0
    low, width = 0.0, 1.0
    while low < 1.0:
        bernstein(c, degree, low, width, b)
        verdict = _verdict(b, degree)
        narrow = width < _NARROW
        if verdict == _AT_ONCE:
            return low
        if verdict == _ONE or (narrow and b[degree] > 0.0):
            return _root(c, degree, low, low + width)
        if verdict == _UNCLEAR and not narrow:
            width *= 0.5
        else:
            low += width
            width = min(2.0 * width, 1.0 - low)
    return -1.0


def _stays_negative(c: Vector, degree: int) -> bool:
    """Cheap and sufficient: the parabola of the first terms, and all others at their largest."""
    rest = c[0]
    if rest >= 0.0:
        return False
    for i in range(3, degree + 1):
        rest += abs(c[i])
    top = max(0.0, c[1] + c[2])
    if c[2] < 0.0 < c[1] < -2.0 * c[2]:
        top = max(top, -0.25 * c[1] * c[1] / c[2])
    return rest + top < 0.0


def bernstein(c: Vector, degree: int, low: float, width: float, b: Vector) -> None:
    """Write the Bernstein coefficients on [low, low + width] of ``sum c[i] u^i`` to ``b``."""
    for i in range(degree + 1):
        b[i] = c[i]
    if low > 0.0:
        for i in range(degree):
            for j in range(degree - 1, i - 1, -1):
                b[j] += low * b[j + 1]
    binomial, power = 1.0, 1.0
    for i in range(degree + 1):
        b[i] *= power / binomial
        power *= width
        binomial *= (degree - i) / (i + 1.0)
    for i in range(1, degree + 1):
        for j in range(degree, i - 1, -1):
            b[j] += b[j - 1]


def _verdict(b: Vector, degree: int) -> int:
    sign, changes = 0.0, 0
    for i in range(degree + 1):
        if b[i] * sign < 0.0 or (sign == 0.0 and b[i] != 0.0):
            if sign == 0.0 and b[i] > 0.0:
                return _AT_ONCE
            changes += sign != 0.0
            sign = 1.0 if b[i] > 0.0 else -1.0
    if changes == 0:
        return _NONE
    return _ONE if changes == 1 and b[degree] > 0.0 else _UNCLEAR


def _root(c: Vector, degree: int, low: float, high: float) -> float:
    """The root between a point that is not positive and one that is (Newton on a bracket)."""
    u = 0.5 * (low + high)
    for _ in range(_NEWTON):
        value, slope = c[degree], 0.0
        for i in range(degree - 1, -1, -1):
            slope = slope * u + value
            value = value * u + c[i]
        if value > 0.0:
            high = u
        else:
            low = u
        after = u - value / slope if slope > 0.0 else low
        if not low < after < high:
            after = 0.5 * (low + high)
        if abs(after - u) <= 2e-16 * u or high - low <= 2e-16 * high:
            return after
        u = after
    return u


Counts: TypeAlias = MutableSequence[int]
Rows: TypeAlias = MutableSequence[Vector]

# body: the oscillator and the accuracy asked for
MASS, DAMPING, STIFFNESS, OMEGA, HOLD, TOLERANCE, LONGEST = range(7)
BODY = 7
# law: an exponential, or (CUBIC) cubics; both on the pieces between `edges`
KINETIC, GAP, DECAY, VISCOUS = range(4)
LAW = 4
# state: relative speed, and the time since the piece began in two parts
X, V, TIME, TIME_REST = range(4)
# where: what is counted
PIECE, PHASE, LAW_PIECE, CURSOR, EVENTS, STEPS, EXPANSIONS, STALLED = range(8)
WHERE = 8
# options
ORDER, STEP_LIMIT, EVENT_LIMIT, WITH_ENERGY, CUBIC = range(5)
OPTIONS = 5
# sums of energy, and what rounding took from each
BELT, FRICTION, LOSS = 0, 2, 4
SUMS = 6
# rows of `work`, each of which holds one series
XS, VS, FS, MU, AUX, SQUARE, BELT_SPEED, LOAD, SCALED, SCRATCH = range(10)
WORK = 10

DONE, EVENTS_FULL, EXHAUSTED, NOT_FINITE = 0, 1, 2, 3
NOTHING, RELEASE_FORWARD, RELEASE_BACKWARD, CONTACT, UPPER_EDGE, LOWER_EDGE = 0, 1, 2, 3, 4, 5

STICK_DEGREE = 8

# Speed [m/s] below which the accuracy of a step is not worth a number's last digits.
_UNDERFLOW = 1e-280


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
    """Write the series of displacement, relative speed and friction of a slip phase."""
    x, v, f, mu = work[XS], work[VS], work[FS], work[MU]
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
        f[n] = force
        own = belt[n] - v[n]
        x[n + 1] = own / (n + 1.0)
        pull = c * own + k * x[n] - force
        v[n + 1] = belt[n + 1] + pull / (m * (n + 1.0))
        if n == 0 and v[0] == 0.0 and sign * v[1] < 0.0:
            v[1] = 0.0  # released at the limit: what is missing to it is rounding
    f[order] = 0.0


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
