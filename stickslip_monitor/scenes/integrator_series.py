# SPDX-License-Identifier: Apache-2.0
"""The series of one step: Taylor's of a slip phase, the polynomials of a stick phase.

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

from .integrator_layout import (
    AUX,
    BELT_SPEED,
    CUBIC,
    DAMPING,
    DECAY,
    FS,
    GAP,
    KINETIC,
    LAW_PIECE,
    LOAD,
    LONGEST,
    MASS,
    MU,
    OMEGA,
    ORDER,
    PHASE,
    SQUARE,
    STICK_DEGREE,
    STIFFNESS,
    TOLERANCE,
    VISCOUS,
    VS,
    XS,
    Counts,
    Rows,
    V,
    X,
)
from .integrator_roots import Vector

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
