# SPDX-License-Identifier: Apache-2.0
"""The exact fold over many loads, against that of each load and against exact cycles."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import pytest
from own_law import OwnLaw
from scipy.optimize import brentq
from scipy.special import i1e
from shared import bearing_of

from stickslip_monitor import Bearing, Coulomb, CycleKind, Stribeck, Tabulated, exact_cycle, exact_fold_speed
from stickslip_monitor.physics import contact, orbits
from stickslip_monitor.physics.boundary_table import boundary_table
from stickslip_monitor.physics.cycles import end_of_vibration
from stickslip_monitor.physics.fold_curve import fold_curve
from stickslip_monitor.physics.friction import Stretched

SPEEDS = (0.0, *np.geomspace(0.01, 1.0, 12))
TABLE = Tabulated(SPEEDS, [0.1 + 0.2 * float(np.exp(-10.0 * v)) for v in SPEEDS])


@pytest.mark.parametrize(
    ('law', 'min_load', 'max_load', 'rounding'),
    [
        (Stribeck(0.3, 0.1, 10.0), 200.3, 1e4, 1e-9),
        (Stribeck(0.3, 0.1, 10.0), 1e4, 1e5, 1e-6),  # steep: orbits part at once near grazing
        (Stribeck(0.3, 0.1, 10.0, 0.001), 210.0, 2e3, 1e-9),
        (Coulomb(0.3, 0.1), 1.0, 1e4, 1e-9),
        (TABLE, 300.0, 3e3, 1e-4),
    ],
)
def test_many_loads_are_the_loads_one_by_one(law, min_load, max_load, rounding):
    load = np.geomspace(min_load, max_load, 200)
    together = exact_fold_speed(bearing_of(law), load)
    rows = [3, 60, 117, 196]
    alone = [exact_fold_speed(bearing_of(law), load[i]) for i in rows]
    np.testing.assert_allclose(together[rows], alone, rtol=rounding)


@pytest.mark.parametrize(
    ('bearing', 'load'),
    [
        (bearing_of(Stribeck(0.3, 0.1, 10.0)), 700.0),
        (bearing_of(Stribeck(0.3, 0.1, 1000.0)), 50.0),
        (bearing_of(TABLE), 700.0),
        # A law so sharp that a step would pass over its layer.
        (Bearing(50.0, 15.0, 2.0e6, Stribeck(0.3, 0.1, 5e5), 0.1), 8000.0),
        # A heavily damped lining with a steep law, whose fold was not found before.
        (Bearing(1.0, 1.8, 1.0, Stribeck(0.3, 0.1, 1.0), 0.1), 5000.0),
        # What grazes comes to rest back in time, which long steps do not see: 0.39 by them, of 2.38.
        (Bearing(13.0, 1180.0, 39300.0, Stretched(0.517, 0.0476, 0.807, 0.0, 2.43), 0.1), 35394.0),
    ],
)
def test_stick_slip_ends_at_the_fold(bearing, load):
    fold = exact_fold_speed(bearing, load)
    below, above = exact_cycle(bearing, fold * np.array([1.0 - 3e-6, 1.0 + 3e-6]), load).kind
    assert below == CycleKind.STICK_SLIP
    assert above == CycleKind.NONE


@dataclass(frozen=True)
class RisesFarOut:
    """``0.2 + 0.15 (1 - tanh 10 v) + 0.02 ln(1 + 10 v)``: friction that falls, and rises far out."""

    static: float = 0.35
    breakpoints: tuple[float, ...] = ()

    def coefficient(self, speed):
        v = np.asarray(speed, float)
        u = np.abs(v)
        falls = 0.15 * (1.0 - np.tanh(10.0 * u))
        return np.where(v < 0.0, -1.0, 1.0) * (0.2 + falls + 0.02 * np.log1p(10.0 * u))

    def slope(self, speed):
        u = np.abs(np.asarray(speed, float))
        return -1.5 / np.cosh(np.minimum(10.0 * u, 300.0)) ** 2 + 0.2 / (1.0 + 10.0 * u)


TWO_FALLS = Tabulated([0.0, 0.05, 0.1, 0.15, 0.3, 0.33, 0.6], [0.3, 0.22, 0.2, 0.2, 0.19, 0.12, 0.1])
RISES_FIRST = Tabulated([0.0, 0.02, 0.05, 0.1, 0.2, 0.4], [0.15, 0.25, 0.3, 0.2, 0.12, 0.1])


@pytest.mark.parametrize(
    ('bearing', 'load', 'slowest', 'fastest'),
    [
        # Averaging has its fold far below: stick-slip of 6.8 mm was called stable.
        (bearing_of(RisesFarOut()), 1e5, 0.5, 2.0),
        (Bearing(106.0, 4542.5, 8.267e7, TWO_FALLS, 0.1), 8878.0, 0.05, 0.5),
        (bearing_of(RISES_FIRST), 1160.0, 0.05, 0.5),
    ],
)
def test_the_fold_is_where_a_dense_grid_of_cycles_ends_whatever_averaging_says(
    bearing, load, slowest, fastest
):
    speed = np.geomspace(slowest, fastest, 200)
    sticks = exact_cycle(bearing, speed, load).kind == CycleKind.STICK_SLIP
    low, high = speed[np.flatnonzero(sticks)[-1] + np.array([0, 1])]
    fold = exact_fold_speed(bearing, load)
    assert low < fold < high
    below, above = exact_cycle(bearing, fold * np.array([1.0 - 3e-5, 1.0 + 3e-5]), load).kind
    assert below == CycleKind.STICK_SLIP
    assert above != CycleKind.STICK_SLIP


def test_no_lining_sticks_beyond_the_speeds_that_friction_can_give():
    """Against the fold of a law that feeds a vibration all it can: Coulomb's falls at once."""
    for damping in (4.0, 400.0, 8e3):
        bearing = bearing_of(Coulomb(0.3, 0.1), damping)
        highest = contact.Contact(bearing).highest_speed(1000.0)
        assert 1.0 < highest / exact_fold_speed(bearing, 1000.0) < 100.0


def test_a_fold_in_proportion_to_the_load_under_coulombs_law():
    fold = exact_fold_speed(bearing_of(Coulomb(0.3, 0.1)), np.array([10.0, 1000.0, 7e4]))
    np.testing.assert_allclose(fold / fold[0], [1.0, 100.0, 7e3], rtol=1e-10)


@pytest.mark.parametrize(
    ('bearing', 'load', 'rounding'),
    [
        # Its onset is at 200 N, in the table's first step; 1.5 % above it the fold rises 67 times as
        # fast as the load.
        (bearing_of(Stribeck(0.3, 0.1, 10.0)), [200.2, 203.0, 311.0, 1007.0, 9001.0], 1e-7),
        # A steep law has its onset at 2 N, far below its loads; near grazing its orbits part at once.
        (bearing_of(Stribeck(0.3, 0.1, 1000.0)), [3.0, 311.0, 1007.0, 9001.0], 3e-6),
        # Just above the own onset of exact folds, at lower speeds than averaging's.
        *(
            (bearing_of(Stretched(0.3, 0.1, 10.0, 0.0, n)), [at], 1e-3)
            for n, at in ((1.5, 310.0), (2.0, 310.0), (4.0, 285.0))
        ),
        # Twice critical damping.
        *(
            (bearing_of(law, 4e4), [3.6e4, 8e4, 8e5], 1e-4)
            for law in (Stribeck(0.3, 0.1, 10.0), Stribeck(0.3, 0.1, 10.0, 0.02), TABLE)
        ),
    ],
)
def test_the_table_over_the_load_is_the_exact_fold(bearing, load, rounding):
    ends = [end_of_vibration(bearing, n) for n in load]
    np.testing.assert_allclose(boundary_table(bearing).fold(np.array(load)), ends, rtol=rounding)


def test_a_curve_is_solved_more_closely_where_it_bends():
    # With hardly any damping friction that rises bends the curve within a few of its speeds.
    bearing = Bearing(308.0, 39.3, 7.5e5, Stribeck(0.405, 0.05, 22.1, 0.01), 0.1)
    load = np.array([1436.0, 5569.0, 1.4e4, 4.3e4, 8.4e4])
    alone = [float(exact_fold_speed(bearing, n)) for n in load]
    np.testing.assert_allclose(fold_curve(bearing).exact_fold(load), alone, rtol=1e-7)


def test_a_curve_has_no_fold_between_its_speeds_where_nothing_sticks():
    """Compare with a scan of 1,500 speeds; the table rises to 0.037 m/s before it falls."""
    speed = [0.0, 0.0062, 0.01124, 0.02039, 0.03697, 0.06706, 0.1216, 0.2206, 0.4001, 0.7257, 1.316, 2.387]
    friction = [0.8808, 0.9251, 0.948, 0.9704, 0.979, 0.9623, 0.9224, 0.8678, 0.8116, 0.7743, 0.7626, 0.7615]
    bearing = Bearing(100.0, 14079.0, 1e8, Tabulated(speed, friction), 0.1)
    curve = fold_curve(bearing)
    for load in curve.onset * np.array([1.03, 1.1, 1.3, 1.7]):
        tried = np.geomspace(1e-5, curve.contact.highest_speed(load), 1500)
        assert not contact.meets_belt(bearing, tried, np.full(1500, load), 1e-11).any()
        assert np.isnan(curve.exact_fold(np.array([load])))


@pytest.mark.parametrize(
    ('law', 'load', 'error'),
    [
        (Stretched(0.3, 0.1, 10.0, 0.0, 1.5), 310.0, 1e-4),
        (Stretched(0.3, 0.1, 10.0, 0.0, 2.0), 500.0, 1e-4),
        (Stretched(0.3, 0.1, 10.0, 0.0, 4.0), 285.0, 1e-4),
    ],
)
def test_a_vibration_without_sticking_lasts_up_to_the_fold(law, load, error):
    """Beyond the end of sticking, against the cycles themselves."""
    bearing = bearing_of(law)
    fold = end_of_vibration(bearing, load)
    assert fold > 1.05 * exact_fold_speed(bearing, load)
    last = exact_cycle(bearing, fold * (1.0 - error), load)
    assert last.kind == CycleKind.PURE_SLIP
    assert last.amplitude > 0.0
    beyond = exact_cycle(bearing, fold * np.array([1.0 + error, 1.01, 1.1]), load)
    assert set(beyond.kind.tolist()) == {CycleKind.NONE}


def sticking_ends(bearing, load):
    """Return the last speeds that stick, by the curve of which a table is made."""
    curve = fold_curve(bearing)
    assert curve is not None
    return curve.exact_fold(np.atleast_1d(np.asarray(load, float)))


def measured_curve(count: int, noise: float, seed: int) -> Tabulated:
    """Return a Stribeck curve as a test bench measures it."""
    speed = [0.0, *np.geomspace(0.005, 1.0, count - 1)]
    scatter = noise * np.random.default_rng(seed).standard_normal(count)
    curve = 0.1 + 0.2 * np.exp(-10.0 * np.array(speed)) + scatter
    return Tabulated(speed, np.maximum(curve, 0.0))


def dense_fold(bearing: Bearing, load: float) -> float:
    """Return the last speed with a cycle that sticks, by halving between points of a dense grid."""
    speed = np.geomspace(0.02, 4.0, 400)
    sticks = exact_cycle(bearing, speed, load).kind == CycleKind.STICK_SLIP
    low, high = speed[np.flatnonzero(sticks)[-1] + np.array([0, 1])]
    while high - low > 1e-7 * low:
        middle = 0.5 * (low + high)
        kind = exact_cycle(bearing, middle, load).kind
        low, high = (middle, high) if kind == CycleKind.STICK_SLIP else (low, middle)
    return low


@pytest.mark.parametrize(('count', 'noise', 'seed'), [(7, 0.02, 1), (13, 0.01, 2)])
def test_the_fold_of_a_noisy_table_is_where_a_dense_grid_of_cycles_ends(count, noise, seed):
    bearing = bearing_of(measured_curve(count, noise, seed))
    load = np.array([612.0, 2345.0])
    dense = [dense_fold(bearing, n) for n in load]
    np.testing.assert_allclose([exact_fold_speed(bearing, n) for n in load], dense, rtol=3e-6)
    np.testing.assert_allclose(sticking_ends(bearing, load), dense, rtol=1e-4)


@pytest.mark.parametrize(('count', 'noise'), [(5, 0.03), (13, 0.01), (30, 0.01), (60, 0.01)])
def test_few_orbits_tabulate_a_measured_table(count, noise, monkeypatch):
    followed = 0

    def counted(field, *arguments):
        nonlocal followed
        followed += field.speed.size
        return orbits.follow(field, *arguments)

    fold_curve.cache_clear()
    boundary_table.cache_clear()
    monkeypatch.setattr(contact, 'follow', counted)
    bearing = bearing_of(measured_curve(count, noise, count))
    boundary_table(bearing)
    assert 300 < followed < 1200
    # The last load is there for the size of the table: more than 1e-3 is not claimed above 100 kN.
    for load, rtol in (500.0, 1e-4), (3000.0, 1e-4), (9000.0, 1e-4), (150_000.0, 1e-3):
        np.testing.assert_allclose(sticking_ends(bearing, load), exact_fold_speed(bearing, load), rtol=rtol)


def test_few_steps_tabulate_a_table_that_scatters(monkeypatch):
    # Its 100 kinks make steps short: 170,000 of them, as they once were, keep a node busy for 4 s.
    monkeypatch.setattr(orbits, 'PATIENCE', math.inf)
    fold_curve.cache_clear()
    boundary_table.cache_clear()
    steps_before = orbits._Effort.steps
    bearing = bearing_of(measured_curve(100, 0.004, 3))
    boundary_table(bearing)
    assert 10_000 < orbits._Effort.steps - steps_before < 50_000
    for load in 500.0, 3000.0:
        assert sticking_ends(bearing, load) == pytest.approx(exact_fold_speed(bearing, load), rel=1e-3)


def test_few_steps_tabulate_a_law_of_ones_own(monkeypatch):
    # 10,300 of them, as they once were, took half a second where numba is missing.
    monkeypatch.setattr(orbits, 'PATIENCE', math.inf)
    fold_curve.cache_clear()
    boundary_table.cache_clear()
    steps_before = orbits._Effort.steps
    bearing = bearing_of(OwnLaw(0.3, 0.1, 10.0))
    table = boundary_table(bearing)
    assert 1_000 < orbits._Effort.steps - steps_before < 4_500
    load = np.array([311.0, 1007.0, 9001.0, 5e4])
    ends = [end_of_vibration(bearing_of(Stribeck(0.3, 0.1, 10.0)), n) for n in load]
    np.testing.assert_allclose(table.fold(load), ends, rtol=1e-7)


def test_where_a_lining_never_sticks_no_load_beyond_the_largest_is_tried(monkeypatch):
    """Friction first rises: up to eight times that load at such speeds took 1.7 of 2.2 s, compiled."""
    tried, margin = [], contact.Contact.grazing_margin

    def recorded(self, speed, load, error):
        tried.append(np.stack([speed, load]))
        return margin(self, speed, load, error)

    monkeypatch.setattr(contact.Contact, 'grazing_margin', recorded)
    fold_curve.cache_clear()
    curve = fold_curve(bearing_of(RISES_FIRST))
    speed, load = np.concatenate(tried, axis=1)
    is_slow = speed < 0.2 * curve.exact[0, np.isfinite(curve.exact[1])][0]
    assert np.count_nonzero(is_slow) > 20
    assert load[is_slow].max() < 2.0 * curve.top


def test_a_soft_lining_is_tabulated_by_no_stiff_orbits(monkeypatch):
    """At 3 Hz a load of 200 kN would move it by 3 m; orbits there take up to 20000 steps each."""
    steps, step = 0, orbits.expand

    def counted(*arguments):
        nonlocal steps
        steps += 1
        return step(*arguments)

    fold_curve.cache_clear()
    boundary_table.cache_clear()
    monkeypatch.setattr(orbits, 'expand', counted)
    monkeypatch.setattr(orbits, 'PATIENCE', math.inf)
    speed = [0.0, 0.02, 0.05, 0.1, 0.2, 0.4, 0.8]
    law = Tabulated(speed, [0.3, 0.26, 0.22, 0.17, 0.13, 0.11, 0.1])
    bearing = replace(bearing_of(law), stiffness=2.0e4)
    table = boundary_table(bearing)
    assert 2_000 < steps < 20_000
    assert table.fold(2000.0) == pytest.approx(exact_fold_speed(bearing, 2000.0), rel=1e-4)


@pytest.mark.parametrize('exponent', [1.5, 2.0, 4.0])
def test_the_fold_of_a_law_with_an_exponent_is_found_from_its_onset_on(exponent):
    bearing = bearing_of(Stretched(0.3, 0.1, 10.0, 0.0, exponent))
    load = np.geomspace(100.0, 1000.0, 47)
    fold = np.array([exact_fold_speed(bearing, n) for n in load])
    first = int(np.flatnonzero(fold > 0.0)[0])
    low, high = load[first - 1], load[first]
    while high - low > 1e-4 * low:  # as close to the onset as that
        middle = 0.5 * (low + high)
        has_fold = exact_fold_speed(bearing, middle) > 0.0
        low, high = (low, middle) if has_fold else (middle, high)
    near = high * np.array([1.0, 1.0003, 1.001, 1.003, 1.01])
    beginning = np.array([exact_fold_speed(bearing, n) for n in near])
    assert np.all(np.diff(np.append(beginning, fold[first + 1 :])) > 0.0)


def test_without_damping_a_measured_table_has_no_last_speed():
    bearing = bearing_of(measured_curve(13, 0.01, 2), damping=0.0)
    assert np.all(exact_fold_speed(bearing, np.geomspace(1e-3, 1e4, 20)) == np.inf)
    assert np.all(boundary_table(bearing).fold(np.array([1.0, 1000.0])) == np.inf)


def test_the_lower_end_of_a_law_that_first_rises_is_its_lowest_unstable_speed():
    """Solve ``2 N Delta beta^2 V exp(-(beta V)^2) = c`` of the Gaussian law for the lower end."""
    bearing, load = bearing_of(Stretched(0.3, 0.1, 10.0, 0.0, 2.0)), 1000.0

    def excess(speed: float) -> float:
        return load * 0.2 * 2.0 * 100.0 * speed * np.exp(-((10.0 * speed) ** 2)) - 400.0

    lowest = brentq(excess, 0.0, 0.05)
    lower = boundary_table(bearing).lower_end(load)
    assert lower == pytest.approx(lowest, rel=5e-3)
    speed = lower * np.array([0.3, 0.97, 1.03, 2.0])
    exists = np.isfinite(exact_cycle(bearing, speed, load).amplitude)
    assert exists.tolist() == [False, False, True, True]
    # Beyond the last load it stays where it is, and below the first there is none.
    last, beyond, none = boundary_table(bearing).lower_end([1e7, 1e8, 1.0])
    assert (last > 0.0, beyond, none) == (True, last, 0.0)


@pytest.mark.parametrize('law', [Stribeck(0.3, 0.1, 10.0), Coulomb(0.3, 0.1), TABLE])
def test_a_law_that_falls_from_rest_has_no_lower_end(law):
    assert np.all(boundary_table(bearing_of(law)).lower_end([1.0, 300.0, 1e4, 1e9]) == 0.0)


@pytest.mark.parametrize(
    ('viscous', 'damping', 'expected'),
    [(0.05, 400.0, 6), (0.3, 400.0, 6), (0.05, 8e3, 5), (0.0, 3e4, 4), (0.0, 4e5, 1)],
)
def test_a_fold_of_a_table_is_the_last_stick_slip_however_it_is_damped(viscous, damping, expected):
    """Compare with the cycle; friction that rises with speed makes the fold fall again with the load.

    The last is a stiffness in MN/m taken for N/m: twenty times critical damping.
    """
    bearing = bearing_of(Stribeck(0.3, 0.1, 10.0, viscous), damping)
    load = np.geomspace(1e3, 3e5, 7)
    table = boundary_table(bearing)
    fold = table.fold(load)
    # Averaging stands for an exact fold that is not known.
    is_exact = np.isfinite(fold) & (fold != table.fold_kbm(load))
    assert np.count_nonzero(is_exact) >= expected
    below, above = (
        exact_cycle(bearing, fold[is_exact] * share, load[is_exact]).kind for share in (0.99, 1.01)
    )
    assert np.all(below <= CycleKind.OVERTAKING)
    assert np.all(above > CycleKind.OVERTAKING)


def test_beyond_critical_damping_coulombs_slip_never_returns():
    # Its slip is linear and overdamped: the velocity changes its sign once, so no fold is found.
    assert np.all(np.isnan(exact_fold_speed(bearing_of(Coulomb(0.3, 0.1), 4e5), [1e3, 1e5])))


@pytest.mark.parametrize(
    ('law', 'damping', 'load'),
    [
        (Stretched(0.3, 0.1, 3.0, 0.05, 4.0), 1260.0, 1778.0),
        (Stretched(0.3, 0.1, 10.0, 0.3, 1.5), 1540.0, 1334.0),
        (Stretched(0.3, 0.1, 10.0, 1.0, 4.0), 6260.0, 3162.0),
    ],
)
def test_a_lining_that_sticks_at_no_speed_has_no_exact_fold(law, damping, load):
    """Against cycles at many speeds: it vibrates at some, too little to stick."""
    bearing = bearing_of(law, damping)
    kind = exact_cycle(bearing, np.geomspace(1e-3, 1.0, 120), load).kind
    assert set(kind.tolist()) == {CycleKind.PURE_SLIP, CycleKind.NONE}
    assert np.isnan(exact_fold_speed(bearing, load))


def test_the_table_of_a_law_that_rises_again_is_its_exact_fold_up_to_the_last_load():
    """Friction that rises with the speed: beyond its last load, 19.8 kN, the table knows no exact fold."""
    bearing = Bearing(520.0, 420.0, 9.3e4, Stribeck(0.586, 0.121, 23.5, 0.0355), 0.1)
    curve = fold_curve(bearing)
    assert curve is not None
    load = curve.top * np.array([0.98, 0.995, 0.999])
    table = boundary_table(bearing).fold(load)
    np.testing.assert_allclose(table, exact_fold_speed(bearing, load), rtol=1e-5)
    beyond = curve.top * np.array([1.01, 2.0])  # unknown there: averaging stands for it
    np.testing.assert_array_equal(
        boundary_table(bearing).fold(beyond), boundary_table(bearing).fold_kbm(beyond)
    )


def scattered_bearing(speed, fall, scatter, seed, damping):
    """Return a lining of mass and stiffness 1 on a table that falls by ``fall exp(-V)`` and scatters."""
    noise = np.random.default_rng(seed).normal(0.0, scatter, speed.size)
    return Bearing(1.0, damping, 1.0, Tabulated(speed, 0.2 + fall * np.exp(-speed) + noise), 0.1)


FAR_APART, EVENLY = np.append(0.0, np.geomspace(0.02, 10.0, 99)), np.linspace(0.0, 8.0, 60)


@pytest.mark.parametrize(
    ('bearing', 'load'),
    [
        # What grazes passes a short steep fall far from the belt before it would be drawn there.
        (scattered_bearing(FAR_APART, 0.07, 0.0014, 6, 0.44), 2.647),
        (scattered_bearing(FAR_APART, 0.07, 0.0014, 14, 0.44), 3.218),
        (scattered_bearing(FAR_APART, 0.07, 0.0014, 43, 0.44), 3.548),
        # Orbits that take too many steps are decided by their contact with the belt.
        (scattered_bearing(EVENLY, 0.1, 0.0006, 1, 1.4), 882.4),
        (scattered_bearing(EVENLY, 0.1, 0.0006, 3, 1.4), 1230.5),
        (scattered_bearing(EVENLY, 0.1, 0.0006, 9, 1.4), 1753.1),
    ],
)
def test_scattered_tables_stick_below_their_fold_and_not_above(bearing, load):
    """Compare with orbits of :func:`exact_cycle`, which know of no fold."""
    fold = exact_fold_speed(bearing, load)
    below, above = exact_cycle(bearing, fold * np.array([0.9999, 1.0001]), load).kind
    assert below == CycleKind.STICK_SLIP != above


@pytest.mark.parametrize('force', [3e-6, 1e-5, 3e-5, 1e-4, 1e-3])
@pytest.mark.parametrize('kappa', [0.05, 0.97, 0.99])
def test_the_fold_of_a_lining_with_hardly_any_damping_is_averagings(kappa, force):
    """Averaging is right to the square of ``force = N Delta/(m omega V)``; the orbits gain 1e-7 in a turn."""
    v = brentq(lambda v: 2.0 * i1e(v) / v - kappa, 1e-6, 1e3, xtol=1e-15)
    damping = force * kappa * v * 50.0 * 200.0
    bearing = bearing_of(Stribeck(0.3, 0.1, 10.0), damping)
    assert exact_fold_speed(bearing, damping / (2.0 * kappa)) == pytest.approx(
        v / 10.0, rel=1e-9 + 0.1 * force**2
    )
