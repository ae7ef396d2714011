# SPDX-License-Identifier: Apache-2.0
"""Numbers that other groups have published about a mass on a belt, against ours.

Parameters and numbers only. Each friction law has the units of its source; the diameter of the
journal does not matter, since every speed is a surface speed.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.optimize import brentq

from stickslip_monitor import (
    Bearing,
    Coulomb,
    CycleKind,
    FrictionLaw,
    Stribeck,
    Tabulated,
    assess,
    exact_cycle,
    exact_fold_speed,
    fold_speed,
    hopf_speed,
)


def block_on_belt(mass: float, damping: float, stiffness: float, law: FrictionLaw) -> Bearing:
    return Bearing(mass, damping, stiffness, law, journal_diameter=1.0)


# bSTAB (TU Hamburg, MATLAB case_friction; its Python port is pyBasin): xi 0.05, mu_d 0.5, ratio 2,
# v0 0.5. In steps of 0.075 the equilibrium appears between 1.100 and 1.175, and the limit cycle
# disappears between 1.775 and 1.850.
BSTAB = block_on_belt(1.0, 0.1, 1.0, Stribeck(1.0, 0.5, 2.0))


@pytest.mark.parametrize('speed', np.round(np.arange(0.5, 1.926, 0.075), 4).tolist())
def test_bstab_finds_the_same_attractors_at_every_speed(speed: float) -> None:
    expected = 'unstable' if speed < 1.1375 else 'bistable' if speed < 1.8125 else 'stable'
    assert str(assess(BSTAB, speed, 1.0).regime) == expected


def test_bstab_boundaries() -> None:
    assert 1.100 < hopf_speed(BSTAB, 1.0) < 1.175
    assert 1.775 < exact_fold_speed(BSTAB, 1.0) < 1.850
    assert 1.775 < fold_speed(BSTAB, 1.0) < 1.850


# A. Veraszto and G. Stepan, Int. J. Dynamics and Control, 2017, equation 11: a real
# hardware-in-the-loop rig with viscous friction.
def test_veraszto_and_stepan_hopf_speed() -> None:
    static, kinetic, decay, damping, viscous = 6.0, 2.0, 10.0, 5.746, 0.2
    rig = block_on_belt(0.538, damping, 6957.0, Stribeck(static, kinetic, decay, viscous))
    equation_11 = math.log(decay * (static - kinetic) / (damping + viscous)) / decay
    assert hopf_speed(rig, 1.0) == pytest.approx(equation_11, rel=1e-12)
    assert equation_11 == pytest.approx(0.190616, abs=5e-7)
    # Their cubic expansion ends the bistable range at 0.31336, beyond the law itself.
    assert hopf_speed(rig, 1.0) < exact_fold_speed(rig, 1.0) < 0.31336


# R. I. Leine et al., Nonlinear Dynamics 16, 1998, and the code of his ENOC 2024 keynote:
# F = 1/(1 + 3 v), m = k = 1, belt at 0.2, no damping. Turning point 1.135 and 1.141 by two steps.
def test_leine_turning_point() -> None:
    speed = np.r_[0.0, np.geomspace(1e-3, 8.0, 60)]
    leine = block_on_belt(1.0, 0.0, 1.0, Tabulated(speed, 1.0 / (1.0 + 3.0 * speed)))
    cycle = exact_cycle(leine, 0.2, 1.0)
    _, displacement, _ = cycle.waveform(4001)
    assert displacement.max() == pytest.approx(1.135, rel=2e-3)
    assert cycle.period == pytest.approx(12.0, abs=0.05)


# J. J. Thomsen and A. Fidlin, Int. J. Non-Linear Mechanics 38, 2003: cubic law.
STATIC, LEAST, AT, ZETA = 0.4, 0.25, 0.5, 0.05
K1, K3 = 1.5 * (STATIC - LEAST) / AT, 0.5 * (STATIC - LEAST) / AT**3
END = math.sqrt((K1 - 2.0 * ZETA) / (3.0 * K3))


@pytest.fixture(scope='module')
def cubic() -> Bearing:
    v = np.linspace(0.0, 2.0, 401)
    return block_on_belt(1.0, 2.0 * ZETA, 1.0, Tabulated(v, STATIC - K1 * v + K3 * v**3))


def test_thomsen_and_fidlin_end_of_vibration(cubic: Bearing) -> None:
    assert pytest.approx(0.44096, abs=5e-6) == END
    assert hopf_speed(cubic, 1.0) == pytest.approx(END, rel=1e-4)
    assert fold_speed(cubic, 1.0) == pytest.approx(END, rel=1e-4)


def test_thomsen_and_fidlin_pure_slip_becomes_stick_slip(cubic: Bearing) -> None:
    first_order = math.sqrt(0.8) * END
    assert exact_fold_speed(cubic, 1.0) == pytest.approx(first_order, rel=5e-3)
    assert exact_cycle(cubic, 0.98 * first_order, 1.0).kind is CycleKind.STICK_SLIP
    assert exact_cycle(cubic, 1.02 * first_order, 1.0).kind is CycleKind.PURE_SLIP


@pytest.mark.parametrize('speed', [0.41, 0.42, 0.43, 0.438])
def test_thomsen_and_fidlin_pure_slip_amplitude(cubic: Bearing, speed: float) -> None:
    published = 2.0 * math.sqrt(END**2 - speed**2)
    assert assess(cubic, speed, 1.0).amplitude == pytest.approx(published, rel=2e-4)
    assert exact_cycle(cubic, speed, 1.0).amplitude == pytest.approx(published, rel=2e-2)


# Coulomb without damping, the textbook's closed form; the last is PathSim's box on a belt.
@pytest.mark.parametrize(
    ('static', 'kinetic', 'load', 'mass', 'stiffness', 'speed'),
    [
        (0.4, 0.25, 10.0, 1.0, 100.0, 0.1),
        (0.3, 0.1, 1e3, 50.0, 2e6, 0.05),
        (1.5, 1.0, 196.2, 20.0, 70.0, 1.0),
    ],
)
def test_coulomb_closed_form(
    static: float, kinetic: float, load: float, mass: float, stiffness: float, speed: float
) -> None:
    cycle = exact_cycle(block_on_belt(mass, 0.0, stiffness, Coulomb(static, kinetic)), speed, load)
    omega, drop = math.sqrt(stiffness / mass), (static - kinetic) * load / stiffness
    assert cycle.amplitude == pytest.approx(math.hypot(drop, speed / omega), rel=1e-11)
    slip = 2.0 * (math.pi - math.atan(drop * omega / speed)) / omega
    assert cycle.period == pytest.approx(slip + 2.0 * drop / speed, rel=1e-11)


def _straight_slip(
    mass: float, damping: float, stiffness: float, speed: float, reach: float
) -> tuple[float, float]:
    """Amplitude and period of stick-slip where friction falls in a straight line, so that slip is linear.

    ``u'' + 2 d u' + w^2 u = 0`` about the sliding that is left, with the damping less the fall; it begins
    with ``u' = V, u'' = 0`` and ends where ``u' = V`` again; the belt carries the lining back. Where it comes
    back below the reach of the belt, from one stick limit to the other, it overtakes the belt first:
    friction has reversed, and the same motion goes on about a place that lies lower by the reach.
    """
    omega, decay = math.sqrt(stiffness / mass), 0.5 * damping / mass
    ringing = math.sqrt(omega**2 - decay**2)
    start = -damping * speed / stiffness

    def motion(t: float, begin: float = start) -> tuple[float, float]:
        a, b = begin, (speed + decay * begin) / ringing
        sine, cosine = math.sin(ringing * t), math.cos(ringing * t)
        place = math.exp(-decay * t) * (a * cosine + b * sine)
        return place, -decay * place + math.exp(-decay * t) * ringing * (b * cosine - a * sine)

    half = math.pi / ringing
    end = brentq(lambda t: motion(t)[1] - speed, half, 2.0 * half, xtol=1e-15)
    crest = brentq(lambda t: motion(t)[1], 0.01 * half, 0.9 * half, xtol=1e-15)
    trough = brentq(lambda t: motion(t)[1], half, end, xtol=1e-15)
    amplitude = 0.5 * (motion(crest)[0] - motion(trough)[0])
    place, ahead = motion(end)[0], 0.0
    if place < start - reach:
        begin = place + reach
        turn = brentq(lambda t: motion(t, begin)[1], 1e-3 * half, half, xtol=1e-15)
        ahead = brentq(lambda t: motion(t, begin)[1] - speed, 1e-6 * half, turn, xtol=1e-15)
        place = motion(ahead, begin)[0] - reach
        assert start - reach <= place <= start  # there the belt holds it
    return amplitude, end + ahead + (start - place) / speed


# The straight fall of Brockley, Cameron and Potter (ASME J. Lubrication Technology 89, 1967) and of Banerjee
# (Wear 12, 1968): mu_s - b v. Where b N > c the sliding is unstable up to the end of the fall.
# Up to 0.33 m/s the belt holds what comes back to it; at 0.35 m/s the lining overtakes it first.
@pytest.mark.parametrize('speed', [0.05, 0.2, 0.3, 0.35])
def test_brockley_banerjee_straight_fall(speed: float) -> None:
    mass, damping, stiffness, load, fall = 50.0, 40.0, 2.0e6, 1000.0, 0.1
    places = [0.0, 0.5, 1.0, 1.5, 2.0, 3.0]
    law = Tabulated(places, [0.3 - fall * min(v, 2.0) for v in places])
    bearing = block_on_belt(mass, damping, stiffness, law)
    cycle = exact_cycle(bearing, speed, load)
    reach = 2.0 * law.static * load / stiffness
    amplitude, period = _straight_slip(mass, damping - fall * load, stiffness, speed, reach)
    assert cycle.kind is CycleKind.STICK_SLIP
    assert cycle.amplitude == pytest.approx(amplitude, rel=1e-12)
    assert cycle.period == pytest.approx(period, rel=1e-12)
    assert assess(bearing, speed, load).regime == 'unstable'
