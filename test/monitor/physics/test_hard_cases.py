# SPDX-License-Identifier: Apache-2.0
"""Where numbers break: at the fold, at sharp laws, at crawling speed, without a fall of friction.

Every expectation is a closed form or a computation in 40 digits. Nothing here may warn, divide by
zero or overflow; underflow to zero is meant, as in ``exp(-beta V)``.
"""

from __future__ import annotations

import math

import mpmath as mp
import numpy as np
import pytest
import taylor
from numpy.testing import assert_array_equal
from scipy.special import i1e
from shared import REFERENCE_BEARING, unit_bearing

from stickslip_monitor.physics.averaging import (
    fold_load,
    fold_speed,
    growth_rate,
    hopf_load,
    hopf_speed,
    stationary_amplitudes,
)
from stickslip_monitor.physics.bearing import Bearing
from stickslip_monitor.physics.cycles import CycleKind, exact_cycle, exact_fold_speed, exact_unstable_cycle
from stickslip_monitor.physics.friction import Coulomb, Stribeck, Tabulated

pytestmark = [pytest.mark.filterwarnings('error'), pytest.mark.usefixtures('float_errors')]


def stribeck_bearing(eta: float, kappa: float) -> tuple[Bearing, float]:
    """Return a bearing and its load, at which the speed is ``beta V``."""
    return unit_bearing(kappa * eta / 2.0, Stribeck(0.3, 0.1, 1.0)), eta / 0.2


@pytest.mark.parametrize(('eta', 'kappa'), [(1e-3, 0.9), (0.2, 0.2), (5.0, 0.2)])
@pytest.mark.parametrize('side', [-1.0, 1.0])
def test_the_exact_fold_is_where_the_slip_phase_grazes(eta, kappa, side):
    """Overtake the belt 1e-9 below the fold and miss it above, in 40 digits."""
    bearing, load = stribeck_bearing(eta, kappa)
    speed = mp.mpf(exact_fold_speed(bearing, load) * (1.0 + side * 1e-9))
    force = load / speed
    motion = taylor.Slip(
        mp.mpf(bearing.damping) / 2, force * mp.mpf(0.3), force * mp.mpf(0.1), speed, refine=1
    )
    assert mp.sign(taylor.belt_clearance(motion, motion.static - 2 * motion.zeta)) == -side


@pytest.mark.parametrize('kappa', [0.9, 0.2, 1e-3, 1e-6])
def test_averaged_cycles_just_inside_and_just_outside_the_fold(kappa):
    # Both meet the sliding limit there: the unstable one linearly, the stable one as a square. With ``growth
    # = ln(2 I1(alpha)/alpha)`` and ``growth(alpha) = v + ln kappa``, ``alpha`` falls short of ``v`` by
    # ``(1/growth' - 1)`` times the distance from the fold.
    bearing, load = stribeck_bearing(0.2, kappa)
    fold, distance = fold_speed(bearing, load), 1e-12
    with mp.workdps(30):
        v = mp.mpf(fold)
        slope = mp.besseli(2, v) / mp.besseli(1, v)
        short = float((1 / slope - 1) * distance)
    cycles = stationary_amplitudes(bearing, fold * (1.0 - distance), load)
    assert cycles.stable.tolist() == [False, True]
    unstable, stable = cycles.amplitude / (fold * (1.0 - distance))
    assert stable == pytest.approx(1.0, abs=1e-15)
    assert 1.0 - unstable == pytest.approx(short, abs=4e-15 * (1.0 + short / distance))
    assert stationary_amplitudes(bearing, fold * (1.0 + distance), load).amplitude.size == 0


LAWS = [
    Stribeck(0.3, 0.1, 10.0),
    Stribeck(0.3, 0.1, 10.0, 0.01),
    Stribeck(0.3, 0.1, 1e5),
    Stribeck(0.3, 0.3, 10.0),
    Stribeck(0.1, 0.3, 10.0),
    Stribeck(0.3, 0.0, 10.0),
    Coulomb(0.3, 0.1),
    Coulomb(0.1, 0.3),
    Tabulated([0.0, 1.0], [0.3, 0.1]),
    Tabulated([0.01, 0.1, 1.0], [0.3, 0.1, 0.2]),
]
SPEEDS = np.array([0.0, 1e-300, 1e-9, 1e-3, 0.1, 1.0, 1e3, 1e300])[:, None]
# Up to eta = 1e3, and one beyond all numbers.
LOADS = np.array([-1.0, 0.0, 1e-300, 1e-3, 1e3, 5e6, 1e300])


@pytest.mark.parametrize('law', LAWS, ids=str)
@pytest.mark.parametrize('damping', [0.0, 400.0, 1.8e4])
def test_every_point_has_an_answer_of_its_kind(law, damping):
    """Lose no number: nan is where, and only where, there is nothing."""
    bearing = Bearing(50.0, damping, 2.0e6, law, 0.1)
    for speed_of in (hopf_speed, fold_speed):
        loaded = np.asarray(speed_of(bearing, LOADS[LOADS > 0.0]))
        assert not np.any(loaded < 0.0)
        # More load never takes a boundary away.
        assert np.all(np.diff(np.isnan(loaded).astype(int)) <= 0)
    for load_of in (hopf_load, fold_load):
        assert not np.any(np.asarray(load_of(bearing, SPEEDS)) < 0.0)
    assert np.all(np.isfinite(growth_rate(bearing, SPEEDS, LOADS[:-1])))
    # Differences of friction at a table's points have no digits at 1e-300 m/s.
    speeds = SPEEDS if isinstance(law, Stribeck) else SPEEDS[2:]
    cycles = stationary_amplitudes(bearing, speeds, LOADS)
    exists = ~np.isnan(cycles.amplitude)
    assert np.all(cycles.amplitude[exists] > 0.0)
    inside = (np.asarray(fold_speed(bearing, LOADS)) > speeds) & (speeds > 0.0)
    assert not np.any(exists.any(axis=-1) & ~inside)
    if isinstance(law, Stribeck):
        assert_array_equal(exists.any(axis=-1), inside)


@pytest.mark.slow
@pytest.mark.parametrize('beta_v', [1e2, 1e4, 1e5, 1e7])
def test_the_layer_of_a_sharp_law_is_never_stepped_over(beta_v):
    """Find averaging's fold for weak friction, whose grazing passage feeds the cycle.

    Averaging is exact to first order in eta; in units of the sharp law's own scale the rest is
    less than ``eta/(beta V)``.
    """
    for v in beta_v * np.array([0.8, 1.0, 1.2]):
        kappa = 2.0 * float(i1e(v)) / v
        bearing, load = stribeck_bearing(0.01, kappa)
        assert exact_fold_speed(bearing, load) == pytest.approx(v, rel=0.01 / beta_v + 1e-5)


def test_the_exact_amplitude_is_monotone_in_the_load_and_ends_in_proportion():
    """Under a great load the lining is pulled from limit to limit: ``A ~ N``."""
    bearing = REFERENCE_BEARING
    load = np.geomspace(500.0, 5e9, 71)
    amplitude = exact_cycle(bearing, math.pi / 30.0, load).amplitude
    slope = np.diff(np.log(amplitude)) / np.diff(np.log(load))
    assert np.all(slope > 0.0)
    assert np.max(np.abs(np.diff(slope))) < 0.2
    assert slope[-1] == pytest.approx(1.0, abs=1e-6)


def test_the_unstable_cycle_fills_the_range_between_hopf_and_fold():
    """``v_H = -ln kappa`` is exact for the true oscillator too, and there it is born from 0."""
    bearing, load = stribeck_bearing(0.2, 0.2)
    hopf, fold = -math.log(0.2), exact_fold_speed(bearing, load)
    speed = hopf + (fold - hopf) * np.concatenate([[-1e-9], np.geomspace(1e-6, 1.0 - 1e-8, 40)])
    cycle = exact_unstable_cycle(bearing, speed, load)
    assert_array_equal(cycle.kind == CycleKind.PURE_SLIP, speed > hopf)
    assert np.all(np.diff(cycle.amplitude[1:]) > 0.0)
    # Born like a square root, of coefficient sqrt(8): growth(alpha) = alpha^2/8 + ...
    assert cycle.amplitude[1] == pytest.approx(math.sqrt(8.0 * (speed[1] - hopf)), rel=0.02)
