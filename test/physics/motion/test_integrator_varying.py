# SPDX-License-Identifier: Apache-2.0
"""Speed and load that vary: against scipy's DOP853 on each phase, and against linear theory."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from stickslip_monitor.physics.friction import Coulomb, Stribeck, Tabulated
from stickslip_monitor.physics.motion.integrator import (
    Drive,
    MotionOutcome,
    MotionState,
    integrate,
)
from stickslip_monitor.physics.oscillator import Bearing

Array = NDArray[np.float64]

REFERENCE = Bearing(50.0, 400.0, 2.0e6, Stribeck(0.3, 0.1, 10.0), 0.1)
RPM = REFERENCE.speed.factor('rpm')


class Oracle:
    """The set-valued law by solve_ivp on each slip phase, and a scan of each stick phase."""

    def __init__(self, bearing: Bearing, drive: Drive) -> None:
        self.bearing, self.drive = bearing, drive

    def inputs(self, piece: int, t: float) -> tuple[float, float, float]:
        """``V``, ``V'`` and ``N``."""
        s = t - self.drive.time[piece]
        speed = np.polynomial.Polynomial(self.drive.speed[piece])
        load = np.polynomial.Polynomial(self.drive.load[piece])
        return float(speed(s)), float(speed.deriv()(s)), float(load(s))

    def need(self, piece: int, t: float, x: float) -> tuple[float, float]:
        """Force that sticking needs, and its limit."""
        b = self.bearing
        speed, rate, load = self.inputs(piece, t)
        return b.mass * rate + b.damping * speed + b.stiffness * x, b.friction.static * load

    def stick(self, piece: int, t: float, end: float, x: float) -> tuple[float, float, int]:
        travel = np.polynomial.Polynomial(self.drive.speed[piece]).integ()
        base = self.drive.time[piece]

        def place(u: float) -> float:
            return float(x + travel(u - base) - travel(t - base))

        def excess(u: float) -> float:
            need, limit = self.need(piece, u, place(u))
            return abs(need) - limit

        scan = np.linspace(t, end, 400)
        over = [u for u in scan if excess(u) > 1e-9]
        if not over:
            return end, place(end), 0
        low = max([u for u in scan if u < over[0]], default=over[0])
        at = float(brentq(excess, low, over[0], xtol=1e-15)) if excess(low) < 0.0 else low
        return at, place(at), 1 if self.need(piece, at, place(at))[0] > 0.0 else -1

    def slip(
        self, piece: int, t: float, end: float, y: tuple[float, float], sign: int
    ) -> tuple[float, float, float, bool]:
        b = self.bearing

        def rate(u: float, state: Array) -> list[float]:
            x, v = state
            speed, change, load = self.inputs(piece, u)
            mu = sign * float(b.friction.coefficient(max(sign * v, 1e-300)))
            force = load * mu - b.damping * (speed - v) - b.stiffness * x
            return [speed - v, change - force / b.mass]

        def contact(u: float, state: Array) -> float:
            return sign * float(state[1])

        contact.terminal, contact.direction = True, -1.0  # type: ignore[attr-defined]
        found = solve_ivp(
            rate, (t, end), y, 'DOP853', rtol=1e-13, atol=1e-16, events=contact, max_step=2e-3
        )
        return float(found.t[-1]), float(found.y[0, -1]), float(found.y[1, -1]), found.status == 1

    def final(self, x: float, v: float) -> tuple[float, float, int]:
        """Displacement, relative speed and number of transitions at the end."""
        phase, count = int(np.sign(v)), 0
        for piece in range(self.drive.time.size - 1):
            t, end = float(self.drive.time[piece]), float(self.drive.time[piece + 1])
            while t < end:
                if phase == 0:
                    t, x, phase = self.stick(piece, t, end, x)
                    v, count = 0.0, count + (phase != 0)
                    continue
                t, x, v, met = self.slip(piece, t, end, (x, v), phase)
                if met:
                    need, limit = self.need(piece, t, x)
                    v, count = 0.0, count + 1
                    phase = -phase if -phase * need > limit else 0
        return x, v, count


STOP = Drive.sampled(
    [0.0, 0.1, 0.2, 0.3, 0.5, 0.6], [0.1, 0.1, 0.0, 0.0, -0.1, -0.1], [1000.0] * 6
)
LOAD_GAP = Drive.sampled(
    [0.0, 0.1, 0.15, 0.25, 0.4], [0.1, 0.1, 0.1, 0.1, 0.1], [1000.0, 0.0, 0.0, 1000.0, 1000.0]
)
RIPPLE = Drive.sampled(
    np.linspace(0.0, 0.4, 41),
    0.08 + 0.02 * np.sin(np.linspace(0.0, 12.0, 41)),
    900.0 + 300.0 * np.cos(np.linspace(0.0, 20.0, 41)),
)
LOAD_STEPS = Drive.sampled(
    [0.0, 0.1, 0.2, 0.3], [0.05, 0.05, 0.08, 0.08], [1500.0, 200.0, 900.0, 900.0]
)
LAWS = {
    'stribeck': Stribeck(0.3, 0.1, 10.0, 0.02),
    'sharp': Stribeck(0.3, 0.1, 3000.0),
    'sharp and rising': Stribeck(0.1, 0.3, 3000.0),
    'coulomb': Coulomb(0.3, 0.12),
    'table': Tabulated([0.005, 0.03, 0.1, 0.2], [0.3, 0.22, 0.12, 0.1]),
}
DRIVES = {
    'stop and reverse': STOP,
    'load gap': LOAD_GAP,
    'ripple': RIPPLE,
    'load steps': LOAD_STEPS,
}


@pytest.mark.slow
@pytest.mark.parametrize('law', LAWS)
@pytest.mark.parametrize('name', DRIVES)
def test_against_solve_ivp(name: str, law: str) -> None:
    bearing, drive = replace(REFERENCE, friction=LAWS[law]), DRIVES[name]
    x, v, count = Oracle(bearing, drive).final(3e-4, 0.12)
    motion = integrate(bearing, drive, MotionState(3e-4, 0.12), compiled=False)
    assert motion.transitions.time.size == count
    # The scale of the motion is 1e-3 m and 0.2 m/s.
    assert motion.final.displacement == pytest.approx(x, abs=1e-12)
    assert motion.final.relative_speed == pytest.approx(v, abs=2e-10)


def test_sticking_follows_the_travel_of_the_belt() -> None:
    times = np.linspace(0.0, 1.0, 21)
    drive = Drive.sampled([0.0, 0.5, 1.0], [0.0, 2e-4, -2e-4], [1000.0] * 3)
    motion = integrate(REFERENCE, drive, MotionState(0.0, 0.0), times, compiled=False)
    assert motion.sticking.all()
    early = 2e-4 * times**2
    late = 5e-5 + 2e-4 * (times - 0.5) - 4e-4 * (times - 0.5) ** 2
    expected = np.where(times < 0.5, early, late)
    assert motion.displacement == pytest.approx(expected, abs=1e-19)


def random_case(seed: int) -> tuple[Bearing, Drive]:
    """Any law, damping and load, with inputs that stop and vanish."""
    rng = np.random.default_rng(seed)
    low, high = rng.uniform(0.05, 0.5, 2)
    points = np.sort(rng.uniform(0.0, 0.2, 5))
    law = [
        Stribeck(low, high, 10.0 ** rng.uniform(-1.0, 4.0)),
        Coulomb(low, high),
        Tabulated(points.tolist(), rng.uniform(0.0, 0.5, 5).tolist()),
    ][seed % 3]
    time = np.cumsum(rng.uniform(0.2, 1.0, 12)) * 10.0 ** rng.uniform(-3.0, -1.3)
    speed = np.where(rng.random(12) < 0.2, 0.0, 0.1 * rng.standard_normal(12))
    load = np.where(rng.random(12) < 0.2, 0.0, 10.0 ** rng.uniform(1.0, 4.5) * rng.random(12))
    damping = float(rng.choice([0.0, 400.0, 2.0e4]))
    bearing = replace(REFERENCE, friction=law, damping=damping)
    return bearing, Drive.sampled(time, speed, load)


@pytest.mark.parametrize('seed', range(12))
def test_random_motions_keep_the_law(seed: int) -> None:
    """No contact is missed, sticking never exceeds its limit, slip has its friction."""
    bearing, drive = random_case(seed)
    times = np.linspace(drive.start, drive.end, 401)
    motion = integrate(bearing, drive, MotionState(1e-4, 0.0), times, compiled=False)
    assert motion.outcome is MotionOutcome.COMPLETE
    fastest = np.max(np.abs(motion.relative_speed)) + 0.1
    assert np.all(motion.relative_speed * motion.phase >= -1e-13 * fastest)
    piece = np.clip(np.searchsorted(drive.time, times) - 1, 0, 10)
    load = [
        np.polyval(drive.load[i, ::-1], t - drive.time[i])
        for i, t in zip(piece, times, strict=True)
    ]
    inner = bearing.mass * motion.acceleration + bearing.damping * motion.velocity
    spring = bearing.stiffness * motion.displacement
    scale = 1.0 + np.max(load) + np.max(np.abs(spring)) + np.max(np.abs(inner))
    slow = np.maximum(np.abs(motion.relative_speed), 1e-300)
    sliding = load * np.asarray(bearing.friction.coefficient(slow)) * motion.phase
    limit = max(bearing.friction.static, float(bearing.friction.coefficient(1e-300)))
    sticks = motion.sticking
    assert np.all(
        np.abs((inner + spring)[sticks]) <= limit * np.array(load)[sticks] + 1e-12 * scale
    )
    assert np.max(np.abs((inner + spring - sliding)[~sticks]), initial=0.0) < 1e-8 * scale
