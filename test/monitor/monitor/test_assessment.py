# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shared import LAWS, REFERENCE_BEARING, RPM, bearing_of

from stickslip_monitor.monitor.assessment import BELIEFS, Outcome, Regime, assess
from stickslip_monitor.physics.averaging import (
    fold_speed,
    growth_rate,
    hopf_load,
    hopf_speed,
    stationary_amplitudes,
)
from stickslip_monitor.physics.bearing import Bearing
from stickslip_monitor.physics.cycles import end_of_vibration, exact_amplitude, exact_cycle
from stickslip_monitor.physics.friction import Coulomb, FrictionLaw, Stribeck, Tabulated

STORED = ('hopf_speed', 'fold_speed', 'fold_speed_kbm')
ON_DEMAND = (
    *('hopf_margin', 'fold_margin', 'fold_margin_kbm', 'stability_margin', 'hopf_load', 'fold_load'),
    *('growth_rate', 'amplitude', 'threshold_amplitude', 'amplitude_exact', 'amplitude_error'),
)
COLUMNS = ('speed', 'load', 'outcome_code', *STORED, *ON_DEMAND)
_V = np.append(0.0, np.geomspace(0.005, 1.0, 39))
_SCATTER = 0.002 * np.random.default_rng(1).standard_normal(40)
NOISY = Tabulated(_V, 0.1 + 0.2 * np.exp(-10.0 * _V) + _SCATTER)


# The numbers below are the table of docs/physics.md, to the digits printed there.


def test_published_boundaries_and_threshold() -> None:
    verdict = assess(REFERENCE_BEARING, 34 * RPM, 1000.0)
    assert (verdict.hopf_speed, verdict.fold_speed_kbm) == pytest.approx((0.1609438, 0.2132256), abs=5e-8)
    assert verdict.fold_speed == pytest.approx(0.2131982, abs=5e-8)
    assert verdict.hopf_speed / RPM == pytest.approx(30.7380, abs=0.5e-4)
    assert verdict.fold_speed_kbm / RPM == pytest.approx(40.7231, abs=0.5e-4)
    assert verdict.fold_speed / RPM == pytest.approx(40.7179, abs=0.5e-4)
    assert 1e3 * verdict.threshold_amplitude == pytest.approx(0.59272, abs=0.5e-5)


@pytest.mark.parametrize(
    ('revolutions', 'regime', 'hopf_inside', 'fold_inside'),
    [
        (30.7, Regime.UNSTABLE, True, True),
        (30.8, Regime.BISTABLE, False, True),
        (40.7, Regime.BISTABLE, False, True),
        (40.8, Regime.STABLE, False, False),
        (-40.8, Regime.STABLE, False, False),
    ],
)
def test_regimes_and_signs_of_the_margins(
    revolutions: float, regime: Regime, hopf_inside: bool, fold_inside: bool
) -> None:
    """PHYSICS.md: unstable | bistable | stable with rising speed; negative means inside."""
    verdict = assess(REFERENCE_BEARING, revolutions * RPM, 1000.0)
    assert verdict.regime is regime
    assert (verdict.hopf_margin < 0.0) is hopf_inside
    assert (verdict.fold_margin < 0.0) is fold_inside
    assert (verdict.growth_rate > 0.0) is hopf_inside
    assert verdict.hopf_margin == pytest.approx(abs(revolutions) / 30.7380 - 1.0, abs=2e-6)
    assert verdict.fold_margin == pytest.approx(abs(revolutions) / 40.7179 - 1.0, abs=2e-6)
    assert verdict.fold_margin_kbm == pytest.approx(abs(revolutions) / 40.7231 - 1.0, abs=2e-6)
    assert (verdict.threshold_amplitude > 0.0) is (regime is Regime.BISTABLE)
    assert (verdict.amplitude > 0.0) is (regime is not Regime.STABLE)


def speeds_around(boundary: float) -> list[float]:
    """1 ulp, a few ulps and 1e-12 relative on both sides, and the boundary itself."""
    up, down = np.nextafter(boundary, np.inf), np.nextafter(boundary, 0.0)
    shares = 1.0 + np.array([-1e-12, -1e-14, -1e-15, 1e-15, 1e-14, 1e-12])
    return sorted([boundary, float(up), float(down), *(boundary * shares).tolist()])


@pytest.mark.parametrize('load', [200.5, 1000.0, 1e6])
@pytest.mark.parametrize('law', ['stribeck', 'viscous'])
def test_regime_agrees_with_the_margin_to_the_last_bit(law: str, load: float) -> None:
    bearing = bearing_of(LAWS[law])
    load = 1.2 * load if law == 'viscous' else load
    verdicts = assess(bearing, speeds_around(hopf_speed(bearing, load)), load)
    np.testing.assert_array_equal(verdicts.hopf_margin < 0.0, verdicts.regime == 'unstable')
    assert np.all(verdicts.amplitude > 0.0)
    point = assess(bearing, 1.0, load)
    speeds = np.array([*speeds_around(point.fold_speed), *speeds_around(point.fold_speed_kbm)])
    verdicts = assess(bearing, speeds, load)  # one load: its exact fold is found once
    bistable = verdicts.regime == 'bistable'
    np.testing.assert_array_equal(verdicts.fold_margin < 0.0, bistable)
    np.testing.assert_array_equal(speeds < point.fold_speed, bistable)
    np.testing.assert_array_equal(bistable & (verdicts.fold_margin_kbm < 0.0), verdicts.amplitude > 0.0)


@pytest.mark.parametrize('name', LAWS)
def test_assessment_repeats_the_physics(name: str) -> None:
    # Each column is the function of the physics at the same points.
    bearing = bearing_of(LAWS[name])
    speed, load = np.meshgrid([0.01, 0.1, 0.2, 0.25, 0.5], [300.0, 1600.0])
    verdict = assess(bearing, speed, load)
    np.testing.assert_array_equal(verdict.hopf_speed, hopf_speed(bearing, load))
    np.testing.assert_array_equal(verdict.fold_speed_kbm, fold_speed(bearing, load))
    np.testing.assert_array_equal(verdict.hopf_load, hopf_load(bearing, speed))
    cyclic_speed = speed[has_load := np.isfinite(verdict.fold_load)]
    heavier, lighter = (
        assess(bearing, cyclic_speed, f * verdict.fold_load[has_load]) for f in (1.002, 0.998)
    )
    assert not np.isin('stable', heavier.regime)
    assert np.all(lighter.regime == 'stable')
    np.testing.assert_array_equal(verdict.growth_rate, growth_rate(bearing, speed, load))
    cycles = stationary_amplitudes(bearing, speed, load)
    stable = np.where(cycles.stable, cycles.amplitude, -np.inf).max(axis=-1, initial=-np.inf)
    np.testing.assert_array_equal(verdict.amplitude, np.where(np.isfinite(stable), stable, np.nan))
    inside = ~np.isnan(verdict.amplitude)
    np.testing.assert_array_equal(verdict.regime == 'unstable', growth_rate(bearing, speed, load) > 0.0)
    exact = np.isfinite(exact_cycle(bearing, speed, load).amplitude)
    np.testing.assert_array_equal(verdict.regime == 'stable', ~inside & ~exact)
    tolerance = 1e-9 if isinstance(bearing.friction, Stribeck) else 1e-4
    np.testing.assert_allclose(verdict.fold_speed, end_of_vibration(bearing, load), rtol=tolerance)


@pytest.mark.parametrize('law', [*LAWS.values(), NOISY], ids=[*LAWS, 'noisy'])
def test_many_points_are_judged_as_each_by_itself(law: FrictionLaw) -> None:
    # Many points read the boundaries off a table, one asks the solver, also beyond the table's loads.
    bearing = bearing_of(law)
    rng = np.random.default_rng(7)
    speed, load = rng.uniform(0.01, 1.0, 300), np.exp(rng.uniform(3.0, 14.5, 300))
    many = assess(bearing, speed, load)
    points = [
        assess(bearing, *point) for point in zip(speed[::10].tolist(), load[::10].tolist(), strict=True)
    ]
    # To 8 times a table's last load the averaged fold grows by a power, which is right to 1 %.
    inside = load[::10] < 1e5
    for name in ('fold_speed', 'fold_speed_kbm'):
        from_table, from_solver = (
            getattr(many, name)[::10],
            np.array([getattr(point, name) for point in points]),
        )
        np.testing.assert_allclose(from_table[inside], from_solver[inside], rtol=2e-3)
        if name == 'fold_speed_kbm':
            np.testing.assert_allclose(from_table, from_solver, rtol=1e-2)
    near = np.array([abs(point.fold_margin) < 0.03 for point in points])
    # Beyond a table's last load the averaged fold stands for an exact one that is not in proportion to it.
    between = [min(point.fold_margin, point.fold_margin_kbm) < 0.0 for point in points]
    near |= ~inside & between & np.array([point.regime is Regime.STABLE for point in points])
    regimes = np.array([str(point.regime) for point in points])
    assert np.all((many.regime[::10] == regimes) | near)


UNKNOWN = Outcome.NOT_FINITE


@pytest.mark.parametrize(
    ('speed', 'load', 'outcome', 'regime'),
    [
        (0.1, -0.0, Outcome.NO_CONTACT, Regime.STABLE),
        (0.1, -1000.0, Outcome.NO_CONTACT, Regime.STABLE),
        (-0.0, 1000.0, Outcome.AT_REST, Regime.UNDETERMINED),
        (np.nan, 1e3, UNKNOWN, Regime.UNDETERMINED),
        (-np.inf, 1e3, UNKNOWN, Regime.UNDETERMINED),
        (0.1, np.inf, UNKNOWN, Regime.UNDETERMINED),
        (0.3, 1000.0, Outcome.NO_CYCLE, Regime.STABLE),
    ],
)
def test_points_without_a_cycle_say_why(speed: float, load: float, outcome: Outcome, regime: Regime) -> None:
    for name in LAWS if outcome is not Outcome.NO_CYCLE else ['stribeck']:
        verdict = assess(bearing_of(LAWS[name]), speed, load)
        assert (verdict.outcome, verdict.regime) == (outcome, regime)
        assert np.isnan([verdict.amplitude, verdict.amplitude_exact, verdict.amplitude_error]).all()
        if outcome is Outcome.NO_CONTACT:
            assert (verdict.growth_rate, verdict.hopf_margin) == (-4.0, np.inf)  # -c/(2 m)
        if outcome is UNKNOWN:
            assert np.isnan([getattr(verdict, field) for field in COLUMNS[3:]]).all()


@pytest.mark.parametrize('name', ['rising', 'level'])
def test_friction_that_does_not_fall_has_no_boundary(name: str) -> None:
    verdict = assess(bearing_of(LAWS[name], 0.0), 0.1, 1e5)
    assert (verdict.outcome, verdict.regime) == (Outcome.NO_BOUNDARY, Regime.STABLE)
    assert verdict.hopf_margin == verdict.fold_margin == verdict.stability_margin == np.inf
    assert np.isnan([verdict.hopf_speed, verdict.fold_speed, verdict.fold_speed_kbm]).all()
    assert np.isnan([verdict.hopf_load, verdict.fold_load]).all()


@pytest.mark.parametrize(
    ('mass', 'damping', 'stiffness', 'law'),
    [
        *((50.0, 400.0, 2e6, law) for law in LAWS.values()),
        (50.0, 0.0, 2e6, LAWS['stribeck']),
        (50.0, 0.0, 2e6, LAWS['coulomb']),
        (1e-300, 1e-300, 1e-300, LAWS['stribeck']),
        (1e300, 1.0, 1e300, LAWS['stribeck']),
        (1.0, 1e300, 1.0, LAWS['stribeck']),
        (1.0, 5e-324, 1.0, LAWS['stribeck']),
        (50.0, 400.0, 2e6, Stribeck(0.3, 0.1, 1e-300)),
        (50.0, 400.0, 2e6, Stribeck(0.3, 0.1, 1e150)),
        (50.0, 400.0, 2e6, Stribeck(1e300, 0.1, 10.0)),
        (50.0, 400.0, 2e6, Stribeck(0.3, 0.1, 10.0, 1e300)),
        (50.0, 400.0, 2e6, Stribeck(1e-300, 0.0, 10.0)),
        # Scanned without a bound its speeds would never end.
        (50.0, 400.0, 2e6, Tabulated([0.0, 1.0], [1e200, 0.0])),
        (50.0, 400.0, 2e6, Tabulated([0.0, 1e300], [0.3, 0.1])),
    ],
)
def test_no_bearing_raises_or_warns(mass: float, damping: float, stiffness: float, law: FrictionLaw) -> None:
    """Over the whole range of floats (warnings are errors in this suite)."""
    speed = np.array([5e-324, 1e-100, 1e-9, 0.1, 1e9, 1e100, 1e300])[:, None]
    load = [5e-324, 1e-3, 1.0, 1e6, 1e30, 1e300]
    verdict = assess(Bearing(mass, damping, stiffness, law, 0.1), speed, load)
    assert set(verdict.regime.ravel()) <= {'stable', 'bistable', 'unstable'}
    inside = np.isin(verdict.regime, ['bistable', 'unstable'])
    averaged = inside & ~((verdict.regime == 'bistable') & ~(verdict.fold_margin_kbm < 0.0))
    np.testing.assert_array_equal(np.isnan(verdict.amplitude), ~averaged)


def test_columns_have_the_shape_of_speed_and_load() -> None:
    for law in LAWS.values():
        grid = assess(bearing_of(law), np.full((3, 1), 0.1), np.full(4, 1e3))
        empty = assess(bearing_of(law), np.zeros(0), 1.0)
        single = assess(bearing_of(law), 0.1, 1000)
        for field in (*COLUMNS, 'regime_code'):
            assert getattr(grid, field).shape == (3, 4), field
            assert getattr(empty, field).shape == (0,), field
            number = int if field.endswith('_code') else float
            assert type(getattr(single, field)) is number, field
        assert all(np.isnan(getattr(grid, field)).all() for field in BELIEFS)


NUMBERS = st.one_of(
    st.floats(-0.3, 0.3), st.sampled_from([0.0, -0.0, np.nan, np.inf, 1e300, 5e-324, 0.16094379124341002])
)
POINTS = st.lists(st.tuples(NUMBERS, st.floats(-10.0, 5e3)), min_size=1, max_size=10)


@settings(max_examples=80, deadline=None)
@given(name=st.sampled_from(['stribeck', 'viscous', 'rising', 'level']), points=POINTS)
def test_batch_is_bit_identical_to_single_points(name: str, points: list[tuple[float, float]]) -> None:
    # Columns by the exact fold differ: many loads start from neighbours.
    bearing = bearing_of(LAWS[name])
    batch = assess(bearing, *(np.array(column) for column in zip(*points, strict=True)))
    for i, (v, n) in enumerate(points):
        single = assess(bearing, v, n)
        for field in COLUMNS:
            a, b = np.float64(getattr(batch, field)[i]), np.float64(getattr(single, field))
            if field in ('fold_speed', 'fold_margin', 'stability_margin'):
                assert a == pytest.approx(b, rel=1e-9, abs=1e-9, nan_ok=True), (field, v, n)
                continue
            assert a.tobytes() == b.tobytes() or (np.isnan(a) and np.isnan(b)), (field, v, n)
        assert batch.outcome[i] == single.outcome
        assert batch.regime[i] == single.regime


@pytest.mark.parametrize('name', LAWS)
def test_exact_cycles_beyond_the_boundaries_are_found(name: str) -> None:
    bearing = bearing_of(LAWS[name], 20.0)
    points = assess(bearing, np.full(9, 0.1), np.geomspace(10.0, 2000.0, 9))
    ends = np.fmax(points.fold_speed, points.hopf_speed)
    speed = np.where(np.isfinite(ends), ends, 0.1) * np.array([0.9, 0.999, 1.02, 1.3, 3.0])[:, None]
    amplitude = assess(bearing, speed, points.load).amplitude_exact
    # Cycles are followed together, and who is with them decides the last digits.
    np.testing.assert_allclose(amplitude, exact_amplitude(bearing, speed, points.load), rtol=1e-7)


def test_the_exact_amplitude_and_what_averaging_misses() -> None:
    # PHYSICS.md, both columns, to the digits printed there.
    revolutions = np.array([10.0, 20.0, 30.0, 38.0])
    averaged = np.array([0.26352, 0.52688, 0.78708, 0.99499])
    exact = np.array([0.296953, 0.556755, 0.804800, 1.000212])
    verdict = assess(REFERENCE_BEARING, revolutions * RPM, 1000.0)
    np.testing.assert_allclose(verdict.amplitude_exact * 1e3, exact, atol=5.1e-7)
    np.testing.assert_allclose(verdict.amplitude_error, averaged / exact - 1.0, atol=2e-5)


@pytest.mark.parametrize(
    ('law', 'revolutions', 'load', 'averaged', 'exact', 'millimetres'),
    [
        # The exact fold by bisection of single slip phases, the averaged one in closed form.
        (Stribeck(0.3, 0.1, 1e3), 10.6, 1000.0, 10.302, 10.946, None),
        (Stribeck(0.3, 0.1, 1e4), 6.541, 1000.0, 4.7993, 7.8030, 0.18856),
        (Stribeck(0.3, 0.1, 50.0), 215.0, 2e4, 206.034, 218.920, None),
        (Coulomb(0.3, 0.1), 7.19, 1000.0, np.nan, 7.1936, None),
    ],
)
def test_a_point_with_an_exact_cycle_alone_is_not_stable(
    law: FrictionLaw,
    revolutions: float,
    load: float,
    averaged: float,
    exact: float,
    millimetres: float | None,
) -> None:
    verdict = assess(bearing_of(law), revolutions * RPM, load)
    assert verdict.fold_speed_kbm / RPM == pytest.approx(averaged, rel=1e-4, nan_ok=True)
    assert verdict.fold_speed / RPM == pytest.approx(exact, rel=1e-4)
    assert verdict.outcome is Outcome.BISTABLE
    assert np.isnan(verdict.amplitude)
    assert verdict.amplitude_exact > 0.0
    assert verdict.stability_margin == verdict.fold_margin < 0.0 < verdict.fold_margin_kbm
    if millimetres is not None:
        assert 1e3 * verdict.amplitude_exact == pytest.approx(millimetres, abs=2e-5)
    above = assess(bearing_of(law), verdict.fold_speed * (1.0 + 1e-5), load)
    assert above.regime is Regime.STABLE
    assert above.fold_margin > 0.0


def test_under_coulombs_law_what_reaches_the_journals_speed_sticks() -> None:
    """Slower than the journal it is a free damped vibration: its velocity amplitude has to be ``V``."""
    bearing = bearing_of(Coulomb(0.3, 0.1))
    point = assess(bearing, [0.02, -0.02, 0.05], 1000.0)
    assert [Regime(code) for code in point.regime] == [Regime.BISTABLE, Regime.BISTABLE, Regime.STABLE]
    np.testing.assert_allclose(point.threshold_amplitude, [1e-4, 1e-4, np.nan], rtol=1e-12)
