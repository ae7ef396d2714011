# SPDX-License-Identifier: Apache-2.0
"""The surface of exact cycles, against exact cycles and what is known of them."""

from __future__ import annotations

import numpy as np
import pytest

from stickslip_monitor.physics.averaging.boundaries import fold_speed
from stickslip_monitor.physics.cycle import surface as surface_module
from stickslip_monitor.physics.cycle.cycles import exact_cycle, exact_fold_speed
from stickslip_monitor.physics.cycle.surface import CycleSurface, exact_amplitude, surface_of
from stickslip_monitor.physics.friction import Coulomb, Stribeck, Tabulated
from stickslip_monitor.physics.oscillator import Bearing

PROMISED = 1e-6
REFERENCE = Bearing(50.0, 400.0, 2.0e6, Stribeck(0.30, 0.10, 10.0), 0.100)
# A full-size lining, a light and fast one with viscous friction, and a heavily damped one.
BEARINGS = {
    'reference': REFERENCE,
    'ship': Bearing(2500.0, 3.0e4, 9.0e7, Stribeck(0.22, 0.05, 4.0), 0.6),
    'light': Bearing(0.4, 9.0, 8.0e4, Stribeck(0.35, 0.12, 25.0, 0.03), 0.03),
    'damped': Bearing(50.0, 4000.0, 2.0e6, Stribeck(0.30, 0.10, 10.0), 0.100),
}


def _surface(bearing: Bearing) -> CycleSurface:
    surface = surface_of(bearing)
    surface.prepare()
    return surface


def _onset(bearing: Bearing) -> float:
    """The least load with a cycle: ``c = N (Delta beta - nu)``."""
    law = bearing.friction
    return bearing.damping / ((law.static - law.kinetic) * law.decay - law.viscous)


def _look(bearing, speed, load):
    return surface_of(bearing).lookup(speed, load, np.asarray(fold_speed(bearing, load)))


@pytest.fixture(params=BEARINGS, scope='module')
def bearing(request) -> Bearing:
    _surface(BEARINGS[request.param])
    return BEARINGS[request.param]


def _loads(bearing, count, rng):
    # Heavily damped, the prepared part ends an octave earlier.
    octaves = 3.0 if bearing is BEARINGS['damped'] else 4.0
    return _onset(bearing) * np.exp2(rng.uniform(1e-3, octaves - 1e-3, count))


def test_it_keeps_its_promise_over_the_whole_box(bearing):
    rng = np.random.default_rng(1)
    load = _loads(bearing, 900, rng)
    # Half spread evenly below the fold, half over the octaves down to a standstill.
    ratio = np.where(
        rng.random(900) < 0.5, rng.uniform(0, 1, 900), 2.0 ** -rng.uniform(0, 15, 900)
    )
    speed = ratio * np.asarray(fold_speed(bearing, load))
    amplitude, known = _look(bearing, speed, load)
    cycle = exact_cycle(bearing, speed[known], load[known])
    assert known.mean() > (0.75 if bearing is BEARINGS['damped'] else 0.97)
    np.testing.assert_array_equal(np.isnan(amplitude[known]), np.isnan(cycle.amplitude))
    np.testing.assert_allclose(amplitude[known], cycle.amplitude, rtol=PROMISED)


def test_it_keeps_its_promise_along_the_fold(bearing):
    rng = np.random.default_rng(2)
    load = _loads(bearing, 60, rng)
    fold = np.asarray(exact_fold_speed(bearing, load))
    for distance in (1e-3, 1e-5, 1e-7):
        inside, known = _look(bearing, fold * (1.0 - distance), load)
        cycle = exact_cycle(bearing, fold * (1.0 - distance), load)
        np.testing.assert_allclose(inside[known], cycle.amplitude[known], rtol=PROMISED)
        assert known.mean() > 0.75
        outside, known = _look(bearing, fold * (1.0 + distance), load)
        assert np.isnan(outside[known]).all()
        assert known.mean() > 0.75


def test_published_amplitudes():
    # PHYSICS.md, exact column, to the digits printed there.
    rpm = np.pi * 0.1 / 60.0
    speed, load = rpm * np.array([10.0, 20.0, 30.0, 38.0]), np.full(4, 1000.0)
    _surface(REFERENCE)
    amplitude, known = _look(REFERENCE, speed, load)
    assert known.all()
    np.testing.assert_allclose(
        amplitude * 1e3, [0.296953, 0.556755, 0.804800, 1.000212], atol=5.1e-7
    )


def test_at_a_crawl_the_amplitude_goes_with_the_speed():
    # As V tends to 0 only the law's slope at a standstill is felt; the lining then moves as
    # g'' - (eta - 2 zeta) g' + g = 1 from rest in units of V, with g the relative motion. Its
    # velocity relative to the belt passes V at the crest and the trough.
    zeta, eta = REFERENCE.damping_ratio, 0.2
    decay = 0.5 * (eta - 2.0 * zeta)
    turning = np.sqrt(1.0 - decay**2)
    t = np.linspace(0.0, 2.0 * np.pi, 2_000_001)
    w = 1.0 - np.exp(decay * t) * (np.cos(turning * t) - decay / turning * np.sin(turning * t))
    # x' = V - w V: the displacement is the integral of 1 - w, its extremes where w = 1.
    x = np.concatenate([[0.0], np.cumsum(0.5 * ((1 - w[1:]) + (1 - w[:-1])) * np.diff(t))])
    size = 0.5 * (x.max() - x.min())
    speed = np.array([2e-5, 1e-5])
    _surface(REFERENCE)
    amplitude, known = _look(REFERENCE, speed, np.full(2, 1000.0))
    assert known.all()
    # The law's curvature is felt in proportion to beta V.
    np.testing.assert_allclose(amplitude * 200.0 / speed, size, rtol=5e-4)


def test_beyond_its_box_the_exact_cycle_is_asked():
    onset = _onset(REFERENCE)
    fold = float(fold_speed(REFERENCE, 5 * onset))
    speed = np.array([1e-9, 0.1, 0.1])
    load = np.array([5 * onset, 2e7 * onset, 0.9 * onset])
    _surface(REFERENCE)
    _, known = _look(REFERENCE, speed, load)
    np.testing.assert_array_equal(known, [False, False, True])
    exact = exact_amplitude(REFERENCE, speed, load, np.asarray(fold_speed(REFERENCE, load)))
    cycle = exact_cycle(REFERENCE, speed, load)
    np.testing.assert_allclose(exact, cycle.amplitude, rtol=1e-12)
    assert np.isfinite(exact[:2]).all()
    assert np.isnan(exact[2])
    assert fold > 0.1


@pytest.mark.parametrize(
    ('speed', 'load'),
    [
        (0.0, 1e3),
        (np.nan, 1e3),
        (np.inf, 1e3),
        (0.1, np.nan),
        (0.1, np.inf),
        (0.1, 0.0),
        (0.1, -5),
    ],
)
def test_points_without_a_cycle_have_no_amplitude_and_warn_of_nothing(speed, load):
    _surface(REFERENCE)
    with np.errstate(all='raise'):
        one = exact_amplitude(REFERENCE, np.array([speed]), np.array([load]), np.array([np.nan]))
    assert np.isnan(one).all()


def test_speeds_astern_mirror_speeds_ahead():
    fold = np.asarray(fold_speed(REFERENCE, np.array([1000.0])))
    ahead = exact_amplitude(REFERENCE, np.array([0.1]), np.array([1000.0]), fold)
    astern = exact_amplitude(REFERENCE, np.array([-0.1]), np.array([1000.0]), fold)
    assert ahead == astern


@pytest.mark.parametrize(
    'bearing',
    [
        Bearing(50.0, 400.0, 2.0e6, Coulomb(0.3, 0.1), 0.1),
        Bearing(50.0, 0.0, 2.0e6, Stribeck(0.30, 0.10, 10.0), 0.1),
    ],
    ids=['coulomb', 'undamped'],
)
def test_without_a_least_load_an_octave_is_built_when_it_is_asked_for(bearing):
    surface = CycleSurface(bearing)
    surface.prepare()
    assert surface.prepared
    assert not surface.sheets
    rng = np.random.default_rng(3)
    speed, load = rng.uniform(0.001, 0.01, 300), rng.uniform(520.0, 1000.0, 300)
    fold = np.asarray(fold_speed(bearing, load))
    amplitude, known = surface.lookup(speed, load, fold)
    assert list(surface.sheets) == [9]
    assert known.all()
    np.testing.assert_allclose(
        amplitude, exact_cycle(bearing, speed, load).amplitude, rtol=PROMISED
    )


def test_an_amplitude_does_not_depend_on_what_was_asked_before():
    # 100 times the least load, far beyond what is prepared.
    load = np.full(6000, 2e4) * np.linspace(1.0, 1.2, 6000)
    fold = np.asarray(fold_speed(REFERENCE, load))
    speed = 0.6 * fold
    first = CycleSurface(REFERENCE).amplitude(speed[:1], load[:1], fold[:1])
    prepared = CycleSurface(REFERENCE)
    prepared.prepare()
    many = prepared.amplitude(speed, load, fold)
    np.testing.assert_array_equal(first, many[:1])
    np.testing.assert_array_equal(first, prepared.amplitude(speed[:1], load[:1], fold[:1]))


def test_friction_that_never_drives_needs_no_surface():
    rising = Bearing(50.0, 400.0, 2.0e6, Stribeck(0.1, 0.3, 10.0), 0.1)
    surface = CycleSurface(rising)
    amplitude, known = surface.lookup(np.array([0.1]), np.array([1e4]), np.array([np.nan]))
    assert known.all()
    assert np.isnan(amplitude).all()


def test_a_measured_table_is_left_to_the_exact_cycle():
    speed = np.linspace(0.0, 0.5, 8)
    table = Bearing(50.0, 400.0, 2.0e6, Tabulated(speed, 0.1 + 0.2 * np.exp(-10 * speed)), 0.1)
    surface = CycleSurface(table)
    surface.prepare()
    fold = np.asarray(fold_speed(table, np.array([1000.0])))
    _, known = surface.lookup(np.array([0.1]), np.array([1000.0]), fold)
    assert not known.any()
    amplitude = surface.amplitude(np.array([0.1]), np.array([1000.0]), fold)
    assert amplitude == exact_cycle(table, 0.1, 1000.0).amplitude


def test_no_point_sees_its_neighbours():
    rng = np.random.default_rng(4)
    load = _loads(REFERENCE, 200, rng)
    fold = np.asarray(fold_speed(REFERENCE, load))
    speed = fold * rng.uniform(0.01, 1.1, 200)
    surface = _surface(REFERENCE)
    together, known = surface.lookup(speed, load, fold)
    for i in np.flatnonzero(known)[:50]:
        alone, _ = surface.lookup(speed[i : i + 1], load[i : i + 1], fold[i : i + 1])
        np.testing.assert_array_equal(alone[0], together[i])


def test_a_number_has_the_bits_that_it_has_in_an_array(bearing):
    rng = np.random.default_rng(5)
    load = np.append(_loads(bearing, 300, rng), 0.5 * _onset(bearing))
    fold = np.asarray(fold_speed(bearing, load))
    exact = surface_of(bearing).folds.speed(load, fold)
    speed = 1.2 * 2.0 ** -rng.uniform(0, 6, load.size) * np.nan_to_num(exact, nan=0.1)
    _, known = surface_of(bearing).lookup(speed, load, fold)
    columns = [column[known].tolist() for column in (speed, load, fold, exact)]
    single = [
        surface_of(bearing).amplitude_of_number(*point) for point in zip(*columns, strict=True)
    ]
    bulk = surface_of(bearing).amplitude(*map(np.array, columns[:3]))
    np.testing.assert_array_equal(single, bulk)
    assert 0 < np.isnan(bulk).sum() < bulk.size


def test_building_asks_for_a_bounded_number_of_cycles(monkeypatch, bearing):
    asked = []
    slip = surface_module.slip_round_trip

    def counting(bearing, speed, load, start):
        asked.append(speed.size)
        return slip(bearing, speed, load, start)

    monkeypatch.setattr(surface_module, 'slip_round_trip', counting)
    CycleSurface(bearing).prepare()
    # A second of work, some twice what the heavily damped lining takes.
    assert 0 < sum(asked) <= 8192
