# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

from collections.abc import Callable
from typing import Any

import mpmath as mp
import numpy as np
import pytest
from scipy.optimize import minimize_scalar
from shared import LAWS, bearing_of

from stickslip_monitor.physics.averaging import (
    amplitude_rate,
    fold_load,
    fold_speed,
    growth_rate,
    hopf_load,
    hopf_speed,
    stationary_amplitudes,
)
from stickslip_monitor.physics.bearing import Bearing
from stickslip_monitor.physics.friction import FrictionLaw, Stribeck, Tabulated

MakeBearing = Callable[..., tuple[Bearing, float]]
# mass [kg], omega [rad/s], kappa, r = mu_k/Delta, beta [s/m]
SPREAD = {
    'reference size': (50.0, 200.0, 0.2, 0.5, 10.0),
    'a gram': (1e-3, 1000.0, 0.05, 1e-3, 1e3),
    'five tonnes at 1 rad/s': (5e3, 1.0, 1e-3, 0.0, 1.0),
    'kappa 0.99': (1e3, 30.0, 0.99, 0.1, 300.0),
    'mostly kinetic': (2.0, 100.0, 0.5, 50.0, 5.0),
    'kappa 0.9, blunt': (300.0, 10.0, 0.9, 2.0, 0.1),
    'beta V = 1e4': (20.0, 50.0, 8e-7, 0.3, 1e3),
}
spread = pytest.mark.parametrize('size', SPREAD.values(), ids=SPREAD)
TWO_FALLS = LAWS['two falls']


@spread
def test_boundaries_to_twelve_digits(size: tuple[float, ...], make_bearing: MakeBearing, oracle: Any) -> None:
    """``-ln(kappa)/beta``; the integrated balance at ``a = V`` changes its sign within 1e-12 of the fold."""
    bearing, load = make_bearing(*size)
    g = oracle.groups(bearing, 1.0, load)
    assert hopf_speed(bearing, load) == pytest.approx(float(oracle.hopf(g.kappa) / g.decay), rel=1e-12)
    v = g.decay * mp.mpf(fold_speed(bearing, load))
    assert oracle.fold_excess(g, v * (1 - mp.mpf('1e-12'))) > 0
    assert oracle.fold_excess(g, v * (1 + mp.mpf('1e-12'))) < 0


@spread
@pytest.mark.parametrize('place', [0.02, 0.5, 0.97])
def test_bistable_amplitudes_to_twelve_digits(
    size: tuple[float, ...], place: float, make_bearing: MakeBearing, oracle: Any
) -> None:
    """Find a change of sign of the integrated balance within 1e-12 of both amplitudes.

    The unstable one hangs on ``beta V + ln kappa``, which for kappa near 1 is so small a
    difference that double precision alone would miss this.
    """
    bearing, load = make_bearing(*size)
    hopf, fold = hopf_speed(bearing, load), fold_speed(bearing, load)
    speed = hopf + place * (fold - hopf)
    cycles = stationary_amplitudes(bearing, speed, load)
    assert cycles.stable.tolist() == [False, True]
    g = oracle.groups(bearing, speed, load)
    unstable, stable = (mp.mpf(a) * g.omega * g.decay for a in cycles.amplitude)
    tolerance = mp.mpf('1e-12')
    assert oracle.balance(g, unstable * (1 - tolerance)) < 0
    assert oracle.balance(g, unstable * (1 + tolerance)) > 0
    assert oracle.balance(g, max(stable * (1 - tolerance), g.v)) > 0
    assert oracle.balance(g, stable * (1 + tolerance)) < 0


def test_viscous_rise_acts_as_damping(reference: Bearing, oracle: Any) -> None:
    """PHYSICS.md's closed forms with ``c + N nu`` in place of ``c``: the same bearing."""
    load, nu = 1000.0, 0.05
    rising = bearing_of(LAWS['viscous'])
    plain = bearing_of(LAWS['stribeck'], 400.0 + load * nu)
    assert hopf_speed(rising, load) == pytest.approx(hopf_speed(plain, load), rel=1e-13)
    assert fold_speed(rising, load) == pytest.approx(fold_speed(plain, load), rel=1e-13)
    speed = np.linspace(0.01, 0.2, 9)
    np.testing.assert_allclose(
        stationary_amplitudes(rising, speed, load).amplitude,
        stationary_amplitudes(plain, speed, load).amplitude,
        rtol=1e-11,
    )


@pytest.mark.parametrize(
    ('law', 'damping', 'load'),
    [
        (LAWS['stribeck'], 400.0, 199.9),  # kappa = 1.0005
        (LAWS['stribeck'], 400.0, -1000.0),
        (LAWS['stribeck'], 0.0, 0.0),
        (LAWS['rising'], 400.0, 1e9),
        (LAWS['level'], 0.0, 1e9),
        (LAWS['coulomb'], 0.0, 1e9),
        (Stribeck(0.3, 0.1, 10.0, 2.1), 0.0, 1e9),
        (Tabulated([0.0, 0.5], [0.2, 0.2]), 0.0, 1e9),
        (Tabulated([0.0, 0.1, 0.2, 0.5], [0.1, 0.2, 0.25, 0.3]), 0.0, 1e9),
    ],
)
def test_without_enough_fall_there_is_no_boundary(law: FrictionLaw, damping: float, load: float) -> None:
    """PHYSICS.md: no Hopf speed when kappa >= 1, nor where friction does not fall at all."""
    bearing = bearing_of(law, damping)
    assert np.isnan(hopf_speed(bearing, load))
    assert np.isnan(fold_speed(bearing, load))
    assert stationary_amplitudes(bearing, [0.01, 0.2, 5.0], load).amplitude.shape == (3, 0)


def test_without_damping_no_speed_bounds_stick_slip() -> None:
    bearing = bearing_of(LAWS['stribeck'], 0.0)
    assert hopf_speed(bearing, 1000.0) == np.inf
    assert fold_speed(bearing, 1000.0) == np.inf
    assert hopf_load(bearing, 0.1) == 0.0
    assert fold_load(bearing, 0.1) == 0.0
    cycles = stationary_amplitudes(bearing, [0.1, 100.0, 1e6], 1000.0)
    assert cycles.amplitude.shape == (3, 1)
    assert cycles.stable.all()


@pytest.mark.parametrize('name', LAWS)
def test_astern_mirrors_ahead(name: str) -> None:
    bearing, speed = bearing_of(LAWS[name]), np.array([0.01, 0.1, 0.2, 0.24])
    ahead, astern = (stationary_amplitudes(bearing, s * speed, 1600.0) for s in (1.0, -1.0))
    np.testing.assert_array_equal(ahead.amplitude, astern.amplitude)
    np.testing.assert_array_equal(ahead.stable, astern.stable)
    for function in (hopf_load, fold_load):
        np.testing.assert_array_equal(function(bearing, -speed), function(bearing, speed))
    np.testing.assert_array_equal(growth_rate(bearing, -speed, 900.0), growth_rate(bearing, speed, 900.0))


def test_growth_rate_is_the_eigenvalue_of_the_linear_system(reference: Bearing) -> None:
    """Real part of the roots of ``m s^2 + (c + N mu'(V)) s + k`` by numpy, mu' by difference."""
    h = 1e-6
    for speed, load in ((0.05, 1000.0), (0.1609, 1000.0), (0.3, 5000.0), (0.2, 0.0)):
        mu = LAWS['stribeck'].coefficient
        slope = float(mu(speed + h) - mu(speed - h)) / (2.0 * h)
        roots = np.roots([50.0, 400.0 + load * slope, 2.0e6])
        rate = growth_rate(reference, speed, load)
        assert rate == pytest.approx(float(roots[0].real), rel=1e-6, abs=1e-6)
    assert growth_rate(reference, 0.1, -500.0) == -4.0  # -c/(2 m): no friction


@pytest.mark.parametrize('name', LAWS)
@pytest.mark.parametrize('damping', [0.0, 400.0])
def test_cycles_are_zeros_of_the_amplitude_rate(name: str, damping: float) -> None:
    """``dA/dt = 0`` there, and its change of sign says whether the cycle is stable."""
    bearing = bearing_of(LAWS[name], damping)
    for speed in (0.013, 0.11, 0.175, 0.199, 0.24, 0.7):
        cycles = stationary_amplitudes(bearing, speed, 1600.0)
        a = cycles.amplitude
        assert np.all(np.diff(a) > 0.0)
        step = 1e-4 * np.concatenate([a[:1], np.diff(a)]).min(initial=np.inf)
        inside = amplitude_rate(bearing, speed, 1600.0, a - step)
        outside = amplitude_rate(bearing, speed, 1600.0, a + step)
        # Without damping a flat table is neutral up to where the motion reaches its fall.
        neutral = (damping == 0.0) & (inside == 0.0)
        np.testing.assert_array_equal(outside < 0.0, cycles.stable)
        np.testing.assert_array_equal((inside > 0.0) | neutral & cycles.stable, cycles.stable)
        rounding = 1600.0 * 1e-14 / (50.0 * 200.0)
        at = np.abs(amplitude_rate(bearing, speed, 1600.0, a))
        assert np.all(at <= rounding + 1e-6 * np.minimum(np.abs(inside), np.abs(outside)))


@pytest.mark.parametrize('share', [1e-3, 1e-5, 1e-7])
def test_a_close_pair_of_cycles_is_not_lost(share: float, harmonic_by_quad: Any) -> None:
    """Just below the top of ``2 S/a`` over the amplitude two cycles lie close together.

    The top by scipy's minimiser over scipy's quadrature, the pair from its parabola.
    """
    speed = 0.28

    def slope(a: float) -> float:
        return 2.0 * harmonic_by_quad(TWO_FALLS, speed, a) / a

    top = minimize_scalar(lambda a: -slope(a), (0.085, 0.095, 0.105), tol=1e-9).x
    height, h = slope(top), 2e-4
    curvature = (slope(top + h) - 2.0 * height + slope(top - h)) / (h * h)
    half_width = np.sqrt(2.0 * height * share / -curvature)
    cycles = stationary_amplitudes(bearing_of(TWO_FALLS), speed, 400.0 / (height * (1.0 - share)))
    pair = 200.0 * cycles.amplitude[:2]
    assert cycles.stable[:2].tolist() == [False, True]
    np.testing.assert_allclose(pair, [top - half_width, top + half_width], atol=0.2 * half_width)
    fewer = stationary_amplitudes(bearing_of(TWO_FALLS), speed, 400.0 / (height * (1.0 + share)))
    assert fewer.amplitude.size == cycles.amplitude.size - 2


@pytest.mark.parametrize('share', [1e-2, 1e-4, 1e-6, 1e-8])
def test_hopf_speed_is_found_however_narrow_the_unstable_range(share: float) -> None:
    """Find the top of the slope, a parabola between two points of a monotone cubic, by three samples.

    At a load that falls short of the top by ``share`` the range about it is ``2 w`` wide.
    """
    law = Tabulated([0.0, 0.1, 0.23, 0.3, 0.6], [0.3, 0.28, 0.2, 0.18, 0.18])
    v = np.array([0.11, 0.16, 0.22])
    curvature, tilt, level = np.polyfit(v, -law.slope(v), 2)
    top = -tilt / (2.0 * curvature)
    height = level + 0.5 * tilt * top
    load = 400.0 / (height * (1.0 - share))
    width = np.sqrt(height * share / -curvature)
    bearing = bearing_of(law)
    assert hopf_speed(bearing, load) == pytest.approx(top + width, rel=1e-7)
    # About the top of a concave slope every motion averages less than the slope itself.
    assert fold_speed(bearing, load) == pytest.approx(hopf_speed(bearing, load), rel=1e-12)
    assert np.isnan(hopf_speed(bearing, 400.0 / (height * (1.0 + share))))
