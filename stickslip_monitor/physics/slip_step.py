# SPDX-License-Identifier: Apache-2.0
"""One step of the lining's slip, for cycles and for the motion under speed and load that vary.

Lengths are in units of ``U/omega`` and times of ``1/omega`` with a speed ``U``; the displacement
``e`` counts from a reference point and the relative speed ``z`` from a reference speed, so that
small motions keep their digits. With speed and load linear in the time ``t`` since the step began,

    e' = drift(t) - z    z' = e + offset(t) - 2 zeta z + force(t) (mu(reference) - mu)

where each of ``drift``, ``offset`` and ``force`` is a value and a rate. The method is DOP853,
the Runge-Kutta method of order 8 with a 5-3 error estimate. Plain functions of numbers, which run
as they stand and compiled alike.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

from stickslip_monitor.physics.scalar_law import friction_drop, friction_slope

# Dormand and Prince's coefficients: E. Hairer, S. P. Norsett and G. Wanner, Solving Ordinary
# Differential Equations I, 2nd edition, Springer, 1993, section II.5. A1 to A11 are those that are
# not 0 of the later stages, in the order of the stages of USED; B and E5 belong to the stages of
# WEIGHED, and E3, by which the embedded formula of order 3 differs from the method, to those of
# THIRD; C are the times of the stages. Written out: importing them from scipy takes 29 MB.
USED = (*((0,), (0, 1), (0, 2), (0, 2, 3)), *((0, *range(3, last)) for last in range(5, 12)))
WEIGHED, THIRD = (0, 5, 6, 7, 8, 9, 10, 11), (0, 8, 11)
_NUMBERS = """
0.05260015195876773;
0.0197250569845379 0.0591751709536137;
0.02958758547680685 0.08876275643042054;
0.2413651341592667 -0.8845494793282861 0.924834003261792;
0.037037037037037035 0.17082860872947386 0.12546768756682242;
0.037109375 0.17025221101954405 0.06021653898045596 -0.017578125;
0.03709200011850479 0.17038392571223998 0.10726203044637328 -0.015319437748624402 0.008273789163814023;
0.6241109587160757 -3.3608926294469414 -0.868219346841726 27.59209969944671 20.154067550477894
      -43.48988418106996;
0.47766253643826434 -2.4881146199716677 -0.590290826836843 21.230051448181193 15.279233632882423
      -33.28821096898486 -0.020331201708508627;
-0.9371424300859873 5.186372428844064 1.0914373489967295 -8.149787010746927 -18.52006565999696
      22.739487099350505 2.4936055526796523 -3.0467644718982196;
2.273310147516538 -10.53449546673725 -2.0008720582248625 -17.9589318631188 27.94888452941996
      -2.8589982771350235 -8.87285693353063 12.360567175794303 0.6433927460157636;
0.054293734116568765 4.450312892752409 1.8915178993145003 -5.801203960010585 0.3111643669578199
      -0.1521609496625161 0.20136540080403034 0.04471061572777259;
0.01312004499419488 -1.2251564463762044 -0.4957589496572502 1.6643771824549864 -0.35032884874997366
      0.3341791187130175 0.08192320648511571 -0.022355307863886294;
0.2440944881889764 0.7338466882816118 0.022058823529411766;
0.0 0.05260015195876773 0.0789002279381516 0.1183503419072274 0.2816496580927726 0.3333333333333333 0.25
      0.3076923076923077 0.6512820512820513 0.6 0.8571428571428571 1.0
"""
_ROWS = (tuple(map(float, row.split())) for row in _NUMBERS.split(';'))
A1, A2, A3, A4, A5, A6, A7, A8, A9, A10, A11, B, E5, E3, C = _ROWS


class Medium(NamedTuple):
    """Medium in which a lining slips.

    Attributes:
        speed: The unit ``U`` of speeds [m/s].
        force: ``N/(m omega U)``.
        damping: ``2 zeta``.
        offset: Of the displacement, see above.
        origin: Reference speed [m/s].
        drift: Speed of the belt beyond the reference.
        force_rate: Change of the force in ``1/omega``.
        offset_rate: Change of the offset.
        drift_rate: Change of the drift.
    """

    speed: float
    force: float
    damping: float
    offset: float
    origin: float
    drift: float
    force_rate: float = 0.0
    offset_rate: float = 0.0
    drift_rate: float = 0.0


class SlipState(NamedTuple):
    """Displacement ``e``, relative speed ``z``, and its rate."""

    e: float
    z: float
    rate: float


class SlipStep(NamedTuple):
    """End of a step, and its estimated error in the units of the motion."""

    state: SlipState
    error: float


_LONGEST = 1.0
# How far past a kink of a law a step is to end, relative to the unit of speed.
_AT_KINK = 1e-6
# Kinks in a step up to which it is cut there: of 2, 4 and 8. Motion in tables of 100 and of 1,000
# points takes 1.3 and 1.2 ms a second, cut at every kink 2.6 and 28 ms.
_DENSE = 2.0


def acceleration(law_numbers: Any, medium: Medium, e: float, z: float) -> float:
    """Return ``z'`` as a step begins at a displacement ``e`` and a relative speed ``z``, in its units."""
    drop = friction_drop(law_numbers, medium.origin, medium.speed * z)
    return e + medium.offset - medium.damping * z + medium.force * drop


def bend(law_numbers: Any, medium: Medium, state: SlipState, t: float = 0.0) -> float:
    """Return ``z''`` of a state at a time ``t`` since the step began [1/omega], in the units of the step."""
    v = medium.origin + medium.speed * state.z
    friction = (medium.force + medium.force_rate * t) * medium.speed * friction_slope(law_numbers, v)
    value = medium.drift + medium.drift_rate * t - state.z + medium.offset_rate
    if medium.force_rate != 0.0:
        value += medium.force_rate * friction_drop(law_numbers, medium.origin, medium.speed * state.z)
    return value - (medium.damping + friction) * state.rate


def slip_step(law_numbers: Any, medium: Medium, begin: SlipState, step: float) -> SlipStep:
    """Return the state after a step by DOP853, and the step's error.

    The displacement that the belt's own speed makes is exact, the rest by the method's stages.

    Args:
        law_numbers: The law, as :attr:`.LawInUse.numbers`.
        medium: The medium as the step begins.
        begin: The state there.
        step: Length of the step [1/omega].

    >>> medium = Medium(1.0, 0.0, 0.0, 0.0, 1.0, 0.0)  # without friction cos and sin
    >>> law = scalar_law(Coulomb(0.0, 0.0)).plain.numbers
    >>> round(slip_step(law, medium, SlipState(1.0, 0.0, 1.0), 0.1).state.e - math.cos(0.1), 12)
    0.0
    """
    speed, force, damping, offset, origin, drift, df, do, dd = medium
    e0, z0, r0 = begin
    (a,) = A1
    t = C[1] * step
    z1 = z0 + step * a * r0
    x = e0 + t * (drift + 0.5 * dd * t) - step * (a * z0) + offset + do * t
    r1 = x - damping * z1 + (force + df * t) * friction_drop(law_numbers, origin, speed * z1)
    a, b = A2
    t = C[2] * step
    z2 = z0 + step * (a * r0 + b * r1)
    x = e0 + t * (drift + 0.5 * dd * t) - step * (a * z0 + b * z1) + offset + do * t
    r2 = x - damping * z2 + (force + df * t) * friction_drop(law_numbers, origin, speed * z2)
    a, b = A3
    t = C[3] * step
    z3 = z0 + step * (a * r0 + b * r2)
    x = e0 + t * (drift + 0.5 * dd * t) - step * (a * z0 + b * z2) + offset + do * t
    r3 = x - damping * z3 + (force + df * t) * friction_drop(law_numbers, origin, speed * z3)
    a, b, c = A4
    t = C[4] * step
    z4 = z0 + step * (a * r0 + b * r2 + c * r3)
    x = e0 + t * (drift + 0.5 * dd * t) - step * (a * z0 + b * z2 + c * z3) + offset + do * t
    r4 = x - damping * z4 + (force + df * t) * friction_drop(law_numbers, origin, speed * z4)
    a, b, c = A5
    t = C[5] * step
    z5 = z0 + step * (a * r0 + b * r3 + c * r4)
    x = e0 + t * (drift + 0.5 * dd * t) - step * (a * z0 + b * z3 + c * z4) + offset + do * t
    r5 = x - damping * z5 + (force + df * t) * friction_drop(law_numbers, origin, speed * z5)
    a, b, c, d = A6
    t = C[6] * step
    z6 = z0 + step * (a * r0 + b * r3 + c * r4 + d * r5)
    lag = a * z0 + b * z3 + c * z4 + d * z5
    x = e0 + t * (drift + 0.5 * dd * t) - step * lag + offset + do * t
    r6 = x - damping * z6 + (force + df * t) * friction_drop(law_numbers, origin, speed * z6)
    a, b, c, d, e = A7
    t = C[7] * step
    z7 = z0 + step * (a * r0 + b * r3 + c * r4 + d * r5 + e * r6)
    lag = a * z0 + b * z3 + c * z4 + d * z5 + e * z6
    x = e0 + t * (drift + 0.5 * dd * t) - step * lag + offset + do * t
    r7 = x - damping * z7 + (force + df * t) * friction_drop(law_numbers, origin, speed * z7)
    a, b, c, d, e, f = A8
    t = C[8] * step
    z8 = z0 + step * (a * r0 + b * r3 + c * r4 + d * r5 + e * r6 + f * r7)
    lag = a * z0 + b * z3 + c * z4 + d * z5 + e * z6 + f * z7
    x = e0 + t * (drift + 0.5 * dd * t) - step * lag + offset + do * t
    r8 = x - damping * z8 + (force + df * t) * friction_drop(law_numbers, origin, speed * z8)
    a, b, c, d, e, f, g = A9
    t = C[9] * step
    z9 = z0 + step * (a * r0 + b * r3 + c * r4 + d * r5 + e * r6 + f * r7 + g * r8)
    lag = a * z0 + b * z3 + c * z4 + d * z5 + e * z6 + f * z7 + g * z8
    x = e0 + t * (drift + 0.5 * dd * t) - step * lag + offset + do * t
    r9 = x - damping * z9 + (force + df * t) * friction_drop(law_numbers, origin, speed * z9)
    a, b, c, d, e, f, g, h = A10
    t = C[10] * step
    z10 = z0 + step * (a * r0 + b * r3 + c * r4 + d * r5 + e * r6 + f * r7 + g * r8 + h * r9)
    lag = a * z0 + b * z3 + c * z4 + d * z5 + e * z6 + f * z7 + g * z8 + h * z9
    x = e0 + t * (drift + 0.5 * dd * t) - step * lag + offset + do * t
    r10 = x - damping * z10 + (force + df * t) * friction_drop(law_numbers, origin, speed * z10)
    a, b, c, d, e, f, g, h, i = A11
    rate = a * r0 + b * r3 + c * r4 + d * r5 + e * r6 + f * r7 + g * r8 + h * r9 + i * r10
    lag = a * z0 + b * z3 + c * z4 + d * z5 + e * z6 + f * z7 + g * z8 + h * z9 + i * z10
    z11 = z0 + step * rate
    moved = e0 + step * (drift + 0.5 * dd * step)
    held = offset + do * step
    end = force + df * step
    r11 = moved - step * lag + held - damping * z11
    r11 += end * friction_drop(law_numbers, origin, speed * z11)
    a, b, c, d, e, f, g, h = B
    rate = a * r0 + b * r5 + c * r6 + d * r7 + e * r8 + f * r9 + g * r10 + h * r11
    lag = a * z0 + b * z5 + c * z6 + d * z7 + e * z8 + f * z9 + g * z10 + h * z11
    x, z = moved - step * lag, z0 + step * rate
    a, b, c = E3
    third = max(abs(rate - (a * r0 + b * r8 + c * r11)), abs(lag - (a * z0 + b * z8 + c * z11)))
    a, b, c, d, e, f, g, h = E5
    rate = a * r0 + b * r5 + c * r6 + d * r7 + e * r8 + f * r9 + g * r10 + h * r11
    lag = a * z0 + b * z5 + c * z6 + d * z7 + e * z8 + f * z9 + g * z10 + h * z11
    fifth = max(abs(rate), abs(lag))
    ratio = 0.1 * third / fifth if fifth > 0.0 else 0.0
    error = step * fifth / math.sqrt(1.0 + ratio * ratio)
    r = x + held - damping * z + end * friction_drop(law_numbers, origin, speed * z)
    return SlipStep(SlipState(x, z, r), error)


def speed_or_rate(state: SlipState, of_rate: bool) -> float:
    """Return the relative speed of a state, or its rate."""
    return state.rate if of_rate else state.z


def cut_step(
    law_numbers: Any, medium: Medium, begin: SlipState, h: float, of_rate: bool, level: float
) -> tuple[float, SlipState]:
    """Return the length at which the relative speed of a step passes a level, and the state there.

    Newton's method, kept between a length before the level and one behind. ``h`` where it is not passed.

    Args:
        law_numbers: The law, as :attr:`.LawInUse.numbers`.
        medium: The medium as the step begins.
        begin: The state there.
        h: Length of the step, by which the level has been passed [1/omega].
        of_rate: Whether the rate of the relative speed is to pass the level, not the speed itself.
        level: The level.

    >>> medium = Medium(1.0, 0.0, 0.0, 0.0, 1.0, 0.0)
    >>> law = scalar_law(Coulomb(0.0, 0.0)).plain.numbers
    >>> length, _ = cut_step(law, medium, SlipState(1.0, 0.0, 1.0), 1.0, False, 0.5)
    >>> round(math.sin(length), 9)
    0.5
    """
    before, behind = 0.0, h
    first = speed_or_rate(begin, of_rate) - level
    rounding = 1e-15 * (abs(first) + abs(level))
    s, state = h, slip_step(law_numbers, medium, begin, h).state
    upward = speed_or_rate(state, of_rate) > level
    if (first > 0.0) == upward and first != 0.0:
        return s, state
    for _ in range(60):
        miss = speed_or_rate(state, of_rate) - level
        if (miss > 0.0) == upward:
            behind = s
        else:
            before = s
        rate = bend(law_numbers, medium, state, s) if of_rate else state.rate
        after = s - miss / rate if rate != 0.0 else before
        inside = before < after < behind
        if abs(miss) <= rounding or (inside and abs(after - s) <= 1e-15 * h):
            break
        if not inside:
            after = 0.5 * (before + behind)
            if after in (before, behind):
                break
        s = after
        state = slip_step(law_numbers, medium, begin, s).state
    return s, state


def until_kink(law_numbers: Any, kinks: Sequence[float], medium: Medium, state: SlipState, h: float) -> float:
    """Return the length of a step, shortened to where the relative speed comes to a kink of the law.

    A step over a kink is refused where the jump of the law's second derivative matters. Where kinks are
    so close that many fall into a step it is not shortened: each jump is small, and if it
    matters the next step is short enough. The speed is foreseen to second order,
    and a little beyond the kink does no harm.

    Args:
        law_numbers: The law, as :attr:`.LawInUse.numbers`.
        kinks: Its kinks, ascending [m/s].
        medium: The medium as the step begins.
        state: The state there.
        h: Length of the step that is wanted [1/omega].

    Returns:
        A length, not longer [1/omega]; ``h`` for a law without kinks.
    """
    count = len(kinks)
    if count == 0:
        return h
    speed = medium.speed
    v, heading = medium.origin + speed * state.z, state.rate
    turn = bend(law_numbers, medium, state)
    # What has come so close to a kink is taken to have passed it.
    beside = v + _AT_KINK * speed if heading > 0.0 else v - _AT_KINK * speed
    low, high = 0, count
    while low < high:
        middle = (low + high) // 2
        if kinks[middle] <= beside:
            low = middle + 1
        else:
            high = middle
    if 0 < low < count:
        width = (kinks[low] - kinks[low - 1]) / speed
        if _DENSE * width < abs(h * heading):
            return h
    length = h
    if low < count:
        length = min(length, time_to_rise(heading, turn, (kinks[low] - v) / speed + _AT_KINK))
    if low > 0:
        gap = (v - kinks[low - 1]) / speed + _AT_KINK
        length = min(length, time_to_rise(-heading, -turn, gap))
    return length


def time_to_rise(rate: float, turn: float, gap: float) -> float:
    """Return the time after which ``rate t + turn t^2/2`` first reaches a gap > 0; ``inf`` for never.

    >>> time_to_rise(1.0, 2.0, 6.0)
    2.0
    """
    square = rate * rate + 2.0 * turn * gap
    fastest = rate + math.sqrt(square) if square > 0.0 else 0.0
    return 2.0 * gap / fastest if fastest > 0.0 else math.inf


def next_length(h: float, error: float, allowed: float) -> float:
    """Return the length of the next step, or of the same step again if its error was too large.

    Args:
        h: Length of the step taken.
        error: Its error.
        allowed: The error allowed.

    >>> next_length(0.5, 0.0, 1e-9)
    1.0
    """
    share = 5.0
    if error > 0.0:
        # The eighth root. A power may differ between processors, and recordings must not.
        root = math.sqrt(math.sqrt(math.sqrt(allowed / error)))
        share = min(max(0.9 * root, 0.2), 5.0)
    elif error != error:
        share = 0.2
    if not error <= allowed:
        share = min(share, 0.5) if share >= 0.2 else 0.2
    return min(h * share, _LONGEST)
