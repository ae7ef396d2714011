# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.special import ndtri
from shared import REFERENCE_BEARING, bearing_of

from stickslip_monitor.errors import PhysicsError
from stickslip_monitor.physics.averages_closed_form import decline
from stickslip_monitor.physics.averaging import fold_speed, hopf_speed
from stickslip_monitor.physics.friction import FrictionLaw, Stretched, Stribeck, Tabulated
from stickslip_monitor.physics.probability import (
    Belief,
    Tolerance,
    move_boundaries,
    update_running_probability,
)

RPM = REFERENCE_BEARING.speed.factor('rpm')
DAMPING = Belief.from_tolerance(REFERENCE_BEARING, Tolerance(damping=0.10))
# 8 % on Delta = 0.2 by the static coefficient alone.
THREE = Belief.from_tolerance(REFERENCE_BEARING, Tolerance(damping=0.10, static=0.16 / 3, decay=0.05))
# How far a probability may be off that of drawn bearings: mu_s - mu_k is taken as logarithmic
# normal, which costs 0.8 % at 8 % of it, 2.5 % at 24 % (a handbook's), 6 % at 40 %.
TOLERANCES = [
    (Tolerance(damping=0.05, static=0.05, kinetic=0.05, decay=0.05), 0.012),
    (Tolerance(damping=0.30, static=0.13, decay=0.20, speed=0.003, load=0.01), 0.025),
    (Tolerance(damping=0.40, static=0.15, kinetic=0.15, decay=0.30, load=0.05), 0.03),
    (Tolerance(damping=0.10, static=0.25, kinetic=0.25, decay=0.10), 0.07),
]
SPEED = np.linspace(0.0, 0.6, 60)
TABLE = Tabulated(SPEED.tolist(), (0.1 + 0.2 * np.exp(-10.0 * SPEED)).tolist())


def test_one_tolerance_has_closed_forms() -> None:
    can, will = DAMPING.probabilities(35.0 * RPM, 1000.0)
    # The load of a boundary is interpolated linearly between 768 speeds.
    assert can == pytest.approx(0.9561785671, abs=5e-4)
    assert will == pytest.approx(0.0128214327, abs=5e-4)
    assert DAMPING.probabilities(40.72309112811 * RPM, 1000.0)[0] == pytest.approx(0.5, abs=5e-4)
    assert DAMPING.probabilities(math.log(5.0) / 10.0, 1000.0)[1] == pytest.approx(0.5, abs=5e-4)
    quantiles = [
        s(1000.0, p) / RPM for s in (DAMPING.fold_speed, DAMPING.hopf_speed) for p in (0.05, 0.5, 0.95)
    ]
    expected = [35.202904, 40.723091, 46.735904, 27.596561, 30.738000, 33.879439]
    assert quantiles == pytest.approx(expected, rel=5e-5)


@pytest.mark.parametrize(
    ('rpm', 'load', 'can', 'will'),
    [
        (30.738, 1000.0, 0.991792, 0.494233),
        (40.723091, 1000.0, 0.498221, 0.0000761),
        (35.0, 800.0, 0.339634, 0.000412),
    ],
)
def test_three_tolerances_keep_the_published_values(rpm: float, load: float, can: float, will: float) -> None:
    assert THREE.probabilities(rpm * RPM, load) == pytest.approx((can, will), abs=1.5e-3)


def random_points(size: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    random = np.random.default_rng(5)
    return np.exp(random.uniform(-7.0, 3.0, size)), np.exp(random.uniform(2.0, 11.5, size))


def test_compiled_look_ups_are_those_of_single_points() -> None:
    pytest.importorskip('numba')
    speed, load = random_points(1000)
    single = [THREE.probabilities(v, n) for v, n in zip(speed.tolist(), load.tolist(), strict=True)]
    repeated = np.array(THREE.probabilities(np.tile(speed, 110), np.tile(load, 110)))
    assert np.array_equal(np.transpose(single), repeated[:, :1000])


@pytest.mark.parametrize(('tolerance', 'off'), TOLERANCES)
def test_probabilities_are_those_of_drawn_bearings(tolerance: Tolerance, off: float) -> None:
    random, size = np.random.default_rng(3), 200_000
    z = random.standard_normal((5, size))
    law = REFERENCE_BEARING.friction
    static = law.static * (1.0 + tolerance.static * z[1])
    kinetic = law.kinetic * (1.0 + tolerance.kinetic * z[2])
    log_d = tolerance.load * random.standard_normal(size) - tolerance.damping * z[0]
    log_d += np.log(np.maximum((static - kinetic) / (law.static - law.kinetic), 1e-12))
    beta = law.decay * np.exp(tolerance.decay * z[3])
    shift = np.exp(tolerance.of_speed * z[4])
    belief = Belief.from_tolerance(REFERENCE_BEARING, tolerance)
    for rpm in (20.0, 33.0, 45.0):
        v = beta * shift * rpm * RPM
        d = np.log(1000.0 * 0.2 * beta / 400.0) + log_d
        expected = np.mean(d > decline(v)), np.mean(d > v)
        assert belief.probabilities(rpm * RPM, 1000.0) == pytest.approx(expected, abs=off)


@pytest.mark.parametrize('law', [Stribeck(0.3, 0.1, 10.0, 0.05), Stretched(0.3, 0.1, 8.0, 0.0, 1.3), TABLE])
def test_any_law_has_the_probabilities_of_drawn_bearings(law: FrictionLaw) -> None:
    # Drawn by damping and load alone, each bearing with its own boundaries by averaging.
    bearing = replace(REFERENCE_BEARING, friction=law)
    belief = Belief.from_tolerance(bearing, Tolerance(damping=0.2, load=0.1))
    spread = math.hypot(0.2, 0.1)
    loads = 1000.0 * np.exp(spread * (np.arange(999) + 0.5 - 499.5) / 150.0)
    weight = np.exp(-0.5 * (np.log(loads / 1000.0) / spread) ** 2)
    fold, hopf = np.nan_to_num(fold_speed(bearing, loads)), hopf_speed(bearing, loads)
    for share in (0.6, 0.8, 1.0, 1.2):
        speed = share * float(fold_speed(bearing, 1000.0))
        expected = [float(weight[of > speed].sum() / weight.sum()) for of in (fold, hopf)]
        assert belief.probabilities(speed, 1000.0) == pytest.approx(expected, abs=0.01)


@pytest.mark.parametrize('law', [Stribeck(0.3, 0.1, 10.0, 0.05), Stretched(0.3, 0.1, 8.0, 0.0, 1.3), TABLE])
def test_a_moved_bearing_has_boundaries_at_other_speeds_and_loads(law: FrictionLaw) -> None:
    bearing = replace(REFERENCE_BEARING, friction=law)
    moved = move_boundaries(bearing, 1.2, 0.8)
    for of in (fold_speed, hopf_speed):
        assert of(moved, 1500.0) == pytest.approx(1.2 * of(bearing, 1200.0), rel=1e-6)
    assert moved.damping == bearing.damping


@pytest.mark.parametrize('tolerance', [Tolerance(), *(tolerance for tolerance, _ in TOLERANCES)])
def test_it_falls_with_speed_and_will_is_below_can(tolerance: Tolerance) -> None:
    belief = Belief.from_tolerance(REFERENCE_BEARING, tolerance)
    speed = np.geomspace(1e-3, 20.0, 3000)
    for load in (150.0, 300.0, 1000.0, 5000.0, 2e5):
        can, will = belief.probabilities(speed, load)
        assert (will <= can).all()
        assert (np.diff(can) <= 1e-9).all()
        assert (np.diff(will) <= 1e-9).all()


def test_without_an_operating_point_there_is_no_probability() -> None:
    speed, load = [0.0, math.nan, 0.1, -0.1, 0.1], [1e3, 1e3, math.inf, 1e3, 0.0]
    can = THREE.probabilities(speed, load)[0]
    assert np.isnan(can).tolist() == [True, True, True, False, False]
    assert can[3] == THREE.probabilities(0.1, 1e3)[0]
    assert can[4] == 0.0
    assert [THREE.probabilities(v, n)[0] for v, n in zip(speed, load, strict=True)] == pytest.approx(
        can.tolist(), nan_ok=True, abs=1e-12
    )


def test_margins_are_those_of_the_quantiles() -> None:
    low, high = THREE.fold_margins(-0.2, 1000.0)
    expected = [0.2 / THREE.fold_speed(1000.0, p) - 1.0 for p in (0.95, 0.05)]
    assert (low, high) == pytest.approx(expected, rel=1e-3)
    assert THREE.fold_speed(60.0, 0.5) == 0.0
    assert THREE.fold_margins(0.2, 60.0) == (math.inf, math.inf)


def test_loads_without_evidence_are_known_less() -> None:
    # Twice the highest known load, but for a fifth, is known 0.2 log2(2/1.2) = 15 % less well, and
    # V_F = 0.35 m/s there: 90 % are within a factor e^(2 * 1.645 * 0.147).
    belief = Belief(REFERENCE_BEARING, np.eye(2) * 1e-6, 0.01, loads=(900.0, 1100.0))
    wide, narrow = ([belief.fold_speed(n, p) for p in (0.05, 0.95)] for n in (2200.0, 1100.0))
    assert wide[1] / wide[0] == pytest.approx(math.exp(3.29 * 0.148), rel=0.03)
    assert narrow[1] / narrow[0] == pytest.approx(math.exp(3.29 * 0.01), rel=0.01)


def test_after_a_calibration_the_fold_stays_and_the_hopf_speed_follows_the_load() -> None:
    """Draw ``u = ln r + f(n + ln q) - f(n)``, known to 1 %, and ``ln q``, known to 55 %.

    The Hopf speed of a draw is ``r ln(Delta beta q N / c) / beta``; to first order its 95 %
    quantile is 4 % off.
    """
    random = np.random.default_rng(3)
    u, log_q = 0.01 * random.standard_normal(40_000), 0.55 * random.standard_normal(40_000)
    loads = np.geomspace(201.0, 60_000.0, 4000)

    def fold(log_load: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.interp(log_load, np.log(loads), np.log(fold_speed(REFERENCE_BEARING, loads)))

    middle = np.array([math.log(4000.0)])
    hopf_draws = np.exp(u - fold(middle + log_q) + fold(middle)) * np.log(20.0 * np.exp(log_q)) / 10.0
    slope = float(fold(middle + 0.01)[0] - fold(middle - 0.01)[0]) / 0.02
    by = np.array([[1.0, -slope], [0.0, 1.0]])
    covariance = by @ np.diag([1e-4, 0.55**2]) @ by.T
    belief = Belief(REFERENCE_BEARING, covariance, loads=(4000.0, 4000.0), calibrated=True)
    for p in (0.05, 0.5, 0.95):
        assert belief.hopf_speed(4000.0, p) == pytest.approx(np.quantile(hopf_draws, p), rel=0.015)
        expected = float(fold_speed(REFERENCE_BEARING, 4000.0)) * math.exp(0.01 * ndtri(p))
        assert belief.fold_speed(4000.0, p) == pytest.approx(expected, rel=2e-3)


def test_a_law_without_boundaries_is_never_in_stick_slip() -> None:
    rising = bearing_of(Stribeck(0.1, 0.3, 10.0))
    assert Belief.from_tolerance(rising, Tolerance(damping=0.1)).probabilities(0.1, 1e3) == (0, 0)
    with pytest.raises(PhysicsError, match=r'tolerance.damping = -0.1 must not be negative'):
        Tolerance(damping=-0.1)


def test_memory_is_that_of_an_ordered_ensemble() -> None:
    random = np.random.default_rng(2)
    can = random.random(300)
    will = can * random.random(300)
    can[17] = will[17] = math.nan
    share = (np.arange(5000) + 0.5) / 5000.0
    on = share < 0.3
    runs = 0.3
    for c, w in zip(can, will, strict=True):
        runs = update_running_probability(runs, c, w)
        if c == c:
            on = (on | (share < w)) & (share < c)
        assert runs == pytest.approx(on.mean(), abs=3e-4)
