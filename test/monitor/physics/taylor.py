# SPDX-License-Identifier: Apache-2.0
"""An independent exact cycle, for tests: Taylor series in 40 digits, in the lab frame.

``x'' + 2 zeta x' + x = force (mu_k + (mu_s - mu_k) exp(-decay (V - x')))`` with omega = m = k = 1.
"""

from __future__ import annotations

import mpmath as mp

mp.mp.dps = 40
ORDER = 40


class Slip:
    """A motion slipping behind (``side`` 1) or ahead (``side`` -1) of a belt of speed 1."""

    def __init__(self, zeta, static, kinetic, decay, side=1, refine=4):
        self.zeta, self.static, self.kinetic = mp.mpf(zeta), mp.mpf(static), mp.mpf(kinetic)
        self.decay, self.side, self.refine = mp.mpf(decay), side, refine

    def series(self, x, v):
        """Taylor coefficients of displacement and velocity."""
        xs, vs = [x], [v]
        fall = [mp.exp(-self.decay * self.side * (1 - v))]
        for k in range(ORDER):
            force = self.side * (self.static - self.kinetic) * fall[k]
            if k == 0:
                force += self.side * self.kinetic
            xs.append(vs[k] / (k + 1))
            vs.append((force - xs[k] - 2 * self.zeta * vs[k]) / (k + 1))
            grow = sum((j + 1) * vs[j + 1] * fall[k - j] for j in range(k + 1))
            fall.append(self.decay * self.side * grow / (k + 1))
        return xs, vs

    def step(self, xs, vs):
        """Return a fraction of the length within which the last terms are below the precision."""
        size = max(abs(xs[0]), abs(vs[0]), abs(xs[1]), abs(vs[1]))
        last = max(abs(c[-1 - i]) ** (mp.mpf(1) / (ORDER - i)) for c in (xs, vs) for i in range(8))
        h = min(mp.mpf(1), (size * mp.mpf(10) ** -36) ** (mp.mpf(1) / ORDER) / last)
        # A series about a point far above the layer of a sharp law does not see it coming.
        folds = self.decay * self.side * (1 - vs[0])
        rate = self.decay * abs(vs[1])
        if rate > 0:
            h = min(h, max(mp.mpf(4), (folds - 100) / 2) / rate)
        return h / self.refine

    def steps(self, x, v):
        """Time, series of displacement and velocity, and length of each step of a motion."""
        time = mp.mpf(0)
        for _ in range(100000):
            xs, vs = self.series(x, v)
            h = self.step(xs, vs)
            yield time, xs, vs, h
            x, v, time = polynomial_at(xs, h), polynomial_at(vs, h), time + h


def polynomial_at(series, t):
    value = mp.mpf(0)
    for coefficient in reversed(series):
        value = value * t + coefficient
    return value


def derivative(series):
    return [k * series[k] for k in range(1, len(series))]


def find_crossing(series, level, low, high):
    """Return where a Taylor series passes a level between two times, by bisection and Newton."""
    sign = mp.sign(polynomial_at(series, high) - level)
    for _ in range(40):
        middle = (low + high) / 2
        if mp.sign(polynomial_at(series, middle) - level) == sign:
            high = middle
        else:
            low = middle
    t = (low + high) / 2
    slope = derivative(series)
    for _ in range(3):
        t -= (polynomial_at(series, t) - level) / polynomial_at(slope, t)
    return t


def nearest_to_belt(motion, vs, low, high):
    """Return where a step comes nearest the belt: its end, or where the acceleration vanishes."""
    rate = derivative(vs)
    if motion.side * polynomial_at(rate, low) > 0 > motion.side * polynomial_at(rate, high):
        return find_crossing(rate, 0, low, high)
    return high


def slip_phase(motion, x, turns=2):
    """Follow slip from ``x`` at the belt's speed to the next contact.

    Returns ``(time, x, turning points)``; the contact is looked for after the last turn.
    """
    extremes = []
    for time, xs, vs, h in motion.steps(x, mp.mpf(1)):
        low = mp.mpf(0)
        if len(extremes) < turns and polynomial_at(vs, h) * (-1) ** len(extremes) < 0:
            low = find_crossing(vs, 0, low, h)
            extremes.append(polynomial_at(xs, low))
        if len(extremes) == turns:
            high = nearest_to_belt(motion, vs, low, h)
            if motion.side * (polynomial_at(vs, high) - 1) > 0:
                t = find_crossing(vs, 1, low, high)
                return time + t, polynomial_at(xs, t), extremes
    raise AssertionError('no contact')


def belt_clearance(motion, x):
    """Return how far the lining, after two turns, overtakes the belt if it never meets it; < 0: not."""
    turns = 0
    for _, _, vs, h in motion.steps(x, mp.mpf(1)):
        low, rate = mp.mpf(0), derivative(vs)
        if turns < 2 and polynomial_at(vs, h) * (-1) ** turns < 0:
            low, turns = find_crossing(vs, 0, low, h), turns + 1
        if turns == 2 and polynomial_at(rate, low) > 0 > polynomial_at(rate, h):
            return polynomial_at(vs, find_crossing(rate, 0, low, h)) - 1
    raise AssertionError('no summit')


def stick_slip(zeta, static, kinetic, decay, refine=4):
    """Amplitude, period and stick fraction in units of ``V/omega`` and ``1/omega``."""
    motion = Slip(zeta, static, kinetic, decay, refine=refine)
    start = motion.static - 2 * motion.zeta
    time, x, (top, bottom) = slip_phase(motion, start)
    stick = start - x
    return (top - bottom) / 2, time + stick, stick / (time + stick)


def return_map(zeta, static, kinetic, decay, x):
    """Return the turning point after one below, and the time."""
    turns = []
    for time, xs, vs, h in Slip(zeta, static, kinetic, decay).steps(x, mp.mpf(0)):
        # An even count moves up until the velocity falls through zero.
        if time > 0 and polynomial_at(vs, h) * (-1) ** len(turns) < 0:
            t = find_crossing(vs, 0, mp.mpf(0), h)
            turns.append(polynomial_at(xs, t))
            if len(turns) == 2:
                return turns, time + t
    raise AssertionError('no return')
