#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Reference amplitudes of lab/accuracy/cases.py: Taylor series in 40 digits, lab frame, SI.

``m x'' + c x' + k x = N s mu(|V - x'|)`` is expanded in time with ``s`` the sign of the relative
speed; contact with the belt and turning points are roots of the series. It shares no code with
any method of the ladder; ``python test/lab/accuracy/accuracy_reference.py`` prints the
constants.
"""

from __future__ import annotations

import sys

import mpmath as mp

from stickslip_monitor.lab.accuracy.cases import CASES
from stickslip_monitor.lab.accuracy.measurement import Case
from stickslip_monitor.physics.friction import Stribeck

DIGITS, ORDER = 40, 40


def at(series, t):
    value = mp.mpf(0)
    for coefficient in reversed(series):
        value = value * t + coefficient
    return value


def derivative(series):
    return [k * series[k] for k in range(1, len(series))]


class Slip:
    """A motion slipping behind (``side`` 1) or ahead (-1) of the belt."""

    def __init__(self, case: Case, side: int) -> None:
        b = case.bearing
        self.m, self.c, self.k = mp.mpf(b.mass), mp.mpf(b.damping), mp.mpf(b.stiffness)
        self.belt, self.load = mp.mpf(case.speed), mp.mpf(case.load)
        self.law, self.side = b.friction, side

    def series(self, x, v):
        """Taylor coefficients in time of displacement and velocity."""
        xs, vs, w, fall = [x], [v], [], []
        for k in range(ORDER):
            w.append(self.side * ((self.belt if k == 0 else 0) - vs[k]))
            mu = self._coefficient(k, w, fall)
            force = self.side * self.load * mu
            xs.append(vs[k] / (k + 1))
            vs.append((force - self.c * vs[k] - self.k * xs[k]) / self.m / (k + 1))
        return xs, vs

    def _coefficient(self, k, w, fall):
        law = self.law
        assert isinstance(law, Stribeck)
        beta = mp.mpf(law.decay)
        if k == 0:
            fall.append(mp.exp(-beta * w[0]))
        else:
            fall.append(-beta * mp.fsum(j * w[j] * fall[k - j] for j in range(1, k + 1)) / k)
        mu = (mp.mpf(law.static) - mp.mpf(law.kinetic)) * fall[k] + mp.mpf(law.viscous) * w[k]
        return mu + (mp.mpf(law.kinetic) if k == 0 else 0)


def root(series, low, high):
    """The root of a series that changes sign on an interval: bisection, then Newton."""
    rate, sign = derivative(series), mp.sign(at(series, high))
    for _ in range(30):
        middle = (low + high) / 2
        low, high = (low, middle) if mp.sign(at(series, middle)) == sign else (middle, high)
    t = (low + high) / 2
    for _ in range(5):
        t -= at(series, t) / at(rate, t)
    return t


def radius(vs):
    """A step at which the last terms are below the precision."""
    last = max(abs(vs[-1 - i]) ** (mp.mpf(1) / (ORDER - i)) for i in range(8))
    return (abs(vs[1]) + abs(vs[0])) ** (mp.mpf(1) / ORDER) * mp.mpf(10) ** -1 / last


def contact(motion: Slip, x, turns_needed: int):
    """From ``x`` at the belt's speed to the next contact: place, and the turning points passed."""
    v, turns, first = motion.belt, [], True
    while True:
        xs, vs = motion.series(x, v)
        h = min(radius(vs), mp.mpf('0.2') * mp.sqrt(motion.m / motion.k))
        low = mp.mpf(0)
        if at(vs, h) * vs[0] < 0:
            low = root(vs, mp.mpf(0), h)
            turns.append(at(xs, low))
        gap = [motion.side * ((motion.belt if k == 0 else 0) - c) for k, c in enumerate(vs)]
        if len(turns) >= turns_needed and not first:
            high, rate = h, derivative(gap)
            if at(rate, low) < 0 < at(rate, h):
                high = root(rate, low, h)
            if at(gap, high) < 0:
                return at(xs, root(gap, low, high)), turns
        x, v, first = at(xs, h), at(vs, h), False


def circuit(case: Case, x):
    """Once round from ``x``: whether it sticks, where it falls behind again, the amplitude."""
    end, turns = contact(Slip(case, 1), x, 2)
    b = case.bearing
    needed = mp.mpf(b.stiffness) * end + mp.mpf(b.damping) * mp.mpf(case.speed)
    amplitude = (max(turns) - min(turns)) / 2
    if abs(needed) <= mp.mpf(b.friction.static) * mp.mpf(case.load):
        return True, end, amplitude
    ahead, _ = contact(Slip(case, -1), end, 0)
    return False, ahead, amplitude


def reference(case: Case):
    """Amplitude of the stable cycle [m], an mpmath number."""
    mp.mp.dps = DIGITS
    b = case.bearing
    static = mp.mpf(b.friction.static) * mp.mpf(case.load)
    x = (static - mp.mpf(b.damping) * mp.mpf(case.speed)) / mp.mpf(b.stiffness)
    sticks, first, amplitude = circuit(case, x)
    if sticks:
        return amplitude
    # Overtaking: a fixed point of the way round, by the secant method.
    x0, f0, x1 = x, first - x, first
    for _ in range(40):
        _, end, amplitude = circuit(case, x1)
        f1 = end - x1
        if abs(f1) < mp.mpf(10) ** -25 * abs(x1):
            return amplitude
        x0, f0, x1 = x1, f1, x1 - f1 * (x1 - x0) / (f1 - f0)
    raise AssertionError('no fixed point')


def main() -> None:
    for case in CASES:
        sys.stdout.write(f'{case.name:14s} {mp.nstr(reference(case), 20)}\n')


if __name__ == '__main__':
    main()
