# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.special import ndtr

from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.errors import PhysicsError
from stickslip_monitor.monitor.assessment import assess
from stickslip_monitor.physics.averaging.closed_form import decline
from stickslip_monitor.physics.belief import Belief, Tolerance, probability_runs
from stickslip_monitor.physics.chances import FOLD, HOPF
from stickslip_monitor.physics.friction import Coulomb, FrictionLaw, Stribeck
from stickslip_monitor.physics.oscillator import Bearing

BEARING = Bearing(50.0, 400.0, 2.0e6, Stribeck(0.30, 0.10, 10.0), 0.100)
RPM = BEARING.speed.factor('rpm')
DAMPING = Belief.from_tolerance(BEARING, Tolerance(damping=0.10))
# 8 % on Delta = 0.2 by the static coefficient alone.
THREE = Belief.from_tolerance(BEARING, Tolerance(damping=0.10, static=0.16 / 3, decay=0.05))
TOLERANCES = [
    Tolerance(damping=0.05, static=0.05, kinetic=0.05, decay=0.05),
    Tolerance(damping=0.30, static=0.13, decay=0.20, speed=0.003, load=0.01),
    Tolerance(damping=0.40, static=0.16, decay=0.30, scatter=0.02, model_error=0.01),
    Tolerance(damping=0.10, static=0.25, kinetic=0.25, decay=0.10),  # 40 % on mu_s - mu_k
]
DRAWS = np.random.default_rng(8).normal(
    (math.log(10.0), math.log(200.0), math.log(0.02)), 0.05, (512, 3)
)


def _sums(belief: Belief, speed: FloatArray, load: FloatArray) -> FloatArray:
    """Can and will of arrays without the table, shape (2, n)."""
    can, will = (ndtr(belief.points.probits(which, speed, load)) for which in (FOLD, HOPF))
    return np.array([can, np.minimum(will, can)])


def test_one_tolerance_has_closed_forms() -> None:
    can, will = DAMPING.probabilities(35.0 * RPM, 1000.0)
    assert can == pytest.approx(0.9561785671, abs=1e-9)
    assert will == pytest.approx(0.0128214327, abs=1e-9)
    assert DAMPING.probabilities(40.72309112811 * RPM, 1000.0)[0] == pytest.approx(0.5, abs=1e-9)
    assert DAMPING.probabilities(math.log(5.0) / 10.0, 1000.0)[1] == pytest.approx(0.5, abs=1e-12)
    found = [s(1000.0, p) / RPM for s in (DAMPING.fold_speed, DAMPING.hopf_speed)
             for p in (0.05, 0.5, 0.95)]  # fmt: skip
    wanted = [35.202904, 40.723091, 46.735904, 27.596561, 30.738000, 33.879439]
    assert found == pytest.approx(wanted, abs=2e-6)


@pytest.mark.parametrize(
    ('rpm', 'load', 'can', 'will'),
    [
        (30.738, 1000.0, 0.991792, 0.494233),
        (40.723091, 1000.0, 0.498221, 0.0000761),
        (35.0, 800.0, 0.339634, 0.000412),
    ],
)
def test_three_tolerances_keep_the_published_values(
    rpm: float, load: float, can: float, will: float
) -> None:
    exact = _sums(THREE, np.array([rpm * RPM]), np.array([load]))[:, 0]
    assert exact == pytest.approx((can, will), abs=1e-6)
    assert THREE.probabilities(rpm * RPM, load) == pytest.approx(exact, abs=5e-4)


def _points(size: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    random = np.random.default_rng(5)
    return np.exp(random.uniform(-7.0, 3.0, size)), np.exp(random.uniform(2.0, 11.5, size))


VISCOUS = replace(BEARING, friction=Stribeck(0.30, 0.10, 10.0, 0.1))
BELIEFS: list[Callable[[], Belief]] = [
    *(partial(Belief.from_tolerance, BEARING, tolerance) for tolerance in TOLERANCES),
    partial(Belief.from_tolerance, VISCOUS, TOLERANCES[1]),
    partial(Belief.from_draws, DRAWS, floor=0.01, loads=(900.0, 1100.0)),
]


@pytest.mark.parametrize('make', BELIEFS)
def test_the_table_keeps_to_the_sum_everywhere(make: Callable[[], Belief]) -> None:
    belief = make()
    speed, load = _points(1000)
    if belief.points.smoothing == 0.0:  # a sum over draws is no smooth function
        speed, load = np.maximum(speed, 0.02), np.clip(load, 100.0, 9000.0)
    off = np.array(belief.probabilities(speed, load)) - _sums(belief, speed, load)
    assert np.max(np.abs(off)) < (2e-3 if belief.points.smoothing else 1e-2)


def test_compiled_look_ups_are_those_of_single_points() -> None:
    pytest.importorskip('numba')
    speed, load = _points(1000)
    one = [THREE.probabilities(v, n) for v, n in zip(speed.tolist(), load.tolist(), strict=True)]
    many = np.array(THREE.probabilities(np.tile(speed, 110), np.tile(load, 110)))
    assert np.array_equal(np.transpose(one), many[:, :1000])


@pytest.mark.parametrize('tolerance', TOLERANCES)
def test_probabilities_are_those_of_drawn_bearings(tolerance: Tolerance) -> None:
    random, size = np.random.default_rng(3), 200_000
    z = random.standard_normal((5, size))
    law = BEARING.friction
    static = law.static * (1.0 + tolerance.static * z[1])
    kinetic = law.kinetic * (1.0 + tolerance.kinetic * z[2])
    log_d = tolerance.load * random.standard_normal(size) - tolerance.damping * z[0]
    log_d += np.log(np.maximum((static - kinetic) / (law.static - law.kinetic), 1e-12))
    beta = law.decay * np.exp(tolerance.decay * z[3])
    shift = np.exp(tolerance.of_speed * z[4])
    belief = Belief.from_tolerance(BEARING, tolerance)
    for rpm in (20.0, 33.0, 45.0):
        v = beta * shift * rpm * RPM
        d = np.log(1000.0 * 0.2 * beta / 400.0) + log_d
        drawn = np.mean(d > decline(v)), np.mean(d > v)
        # Up to 8 % on mu_s - mu_k its logarithm is taken as normal, which costs 8e-3.
        assert belief.probabilities(rpm * RPM, 1000.0) == pytest.approx(drawn, abs=9e-3)


@pytest.mark.parametrize('tolerance', [Tolerance(), *TOLERANCES])
def test_it_falls_with_speed_and_will_is_below_can(tolerance: Tolerance) -> None:
    belief = Belief.from_tolerance(BEARING, tolerance)
    speed = np.geomspace(1e-3, 20.0, 3000)
    for load in (150.0, 300.0, 1000.0, 5000.0, 2e5):
        can, will = belief.probabilities(speed, load)
        assert (will <= can).all()
        assert (np.diff(can) <= 1e-9).all()
        assert (np.diff(will) <= 1e-9).all()


def test_what_has_no_operating_point_has_no_probability() -> None:
    speed, load = [0.0, math.nan, 0.1, -0.1, 0.1], [1e3, 1e3, math.inf, 1e3, 0.0]
    can = THREE.probabilities(speed, load)[0]
    assert np.isnan(can).tolist() == [True, True, True, False, False]
    assert can[3] == THREE.probabilities(0.1, 1e3)[0]
    assert can[4] == 0.0
    assert [
        THREE.probabilities(v, n)[0] for v, n in zip(speed, load, strict=True)
    ] == pytest.approx(can.tolist(), nan_ok=True, abs=1e-12)


def test_margins_are_those_of_the_quantiles() -> None:
    low, high = THREE.fold_margins(-0.2, 1000.0)
    wanted = [0.2 / THREE.fold_speed(1000.0, p) - 1.0 for p in (0.95, 0.05)]
    assert (low, high) == pytest.approx(wanted, rel=1e-3)
    assert THREE.fold_speed(60.0, 0.5) == 0.0
    assert THREE.fold_margins(0.2, 60.0) == (math.inf, math.inf)


def test_loads_without_evidence_are_known_less() -> None:
    # Twice the highest load that the evidence covers is known 20 % less well.
    belief = Belief.from_draws(DRAWS, floor=0.01, loads=(900.0, 1100.0))
    wide, known = ([belief.fold_speed(n, p) for p in (0.05, 0.95)] for n in (2200.0, 1100.0))
    assert wide[1] / wide[0] > 1.5 > 1.3 > known[1] / known[0]


def test_a_viscous_rise_saturates() -> None:
    tight = Belief.from_tolerance(VISCOUS, Tolerance(damping=1e-6))
    speed, load = _points(60)
    hopf = assess(VISCOUS, speed, load).hopf_speed
    found = tight.hopf_speed(load, 0.5)
    assert found == pytest.approx(np.nan_to_num(hopf), rel=1e-9, abs=1e-4)


@pytest.mark.parametrize(
    ('damping', 'law', 'words'),
    [
        (400.0, Coulomb(0.3, 0.1), 'law stribeck'),
        (400.0, Stribeck(0.1, 0.3, 10.0), 'static = 0.1 must be above kinetic = 0.3'),
        (0.0, Stribeck(0.3, 0.1, 10.0), 'damping = 0'),
    ],
)
def test_a_bearing_without_boundaries_is_refused(
    damping: float, law: FrictionLaw, words: str
) -> None:
    with pytest.raises(PhysicsError, match=words):
        Belief.from_tolerance(Bearing(50.0, damping, 2.0e6, law, 0.1), Tolerance(damping=0.1))
    with pytest.raises(PhysicsError, match=r'tolerance.damping = -0.1 must not be negative'):
        Tolerance(damping=-0.1)


def test_memory_is_that_of_an_ordered_ensemble() -> None:
    random = np.random.default_rng(2)
    can = random.random(300)
    will = can * random.random(300)
    can[17] = will[17] = math.nan
    share = (np.arange(5000) + 0.5) / 5000.0
    on = share < 0.3
    found = probability_runs(can, will, 0.3)
    for c, w, r in zip(can, will, found, strict=True):
        if c == c:
            on = (on | (share < w)) & (share < c)
        assert r == pytest.approx(on.mean(), abs=3e-4)
