# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats
from scipy.optimize import curve_fit

from stickslip_lab.friction.curve_file import FrictionCurve, read_curve
from stickslip_lab.friction.friction_fit import (
    UNITS,
    StribeckFit,
    Viscous,
    boundary_belief,
    fit_stribeck,
    unchecked_point,
)
from stickslip_monitor import Bearing, Stribeck, fold_speed, hopf_speed
from stickslip_monitor.errors import FitError, PhysicsError

Array = NDArray[np.float64]
Write = Callable[[str | bytes], Path]

LAW = Stribeck(static=0.30, kinetic=0.10, decay=10.0)
RISING = Stribeck(static=0.30, kinetic=0.10, decay=10.0, viscous=0.1)
SPEED = np.linspace(0.0, 0.5, 26)
SCATTER = 0.003
BENCH = Bearing(50.0, 400.0, 2e6, LAW, 0.1)


def curve_of(speed: Array, coefficient: Array, std: Array | None = None) -> FrictionCurve:
    """Return a curve of points in SI, whose lines are their numbers from 1."""
    deviations = np.ones(coefficient.shape) if std is None else std
    lines = np.arange(1, coefficient.size + 1)
    return FrictionCurve(speed, coefficient, deviations, lines, 'm/s', 'given')


def noisy_curve(
    law: Stribeck = LAW, speed: Array = SPEED, scatter: float = SCATTER, seed: int = 1
) -> FrictionCurve:
    noise = np.random.default_rng(seed).standard_normal(speed.size)
    return curve_of(speed, law.coefficient(speed) + scatter * noise)


@cache
def fit_many_times(
    law: Stribeck, viscous: Viscous, times: int, points: int, scatter: float
) -> tuple[StribeckFit, ...]:
    """Fit the same curve measured many times, with seeds 1000, 1001, ...; tests share the fits."""
    speed = np.linspace(0.0, 0.5, points)
    return tuple(fit_stribeck(noisy_curve(law, speed, scatter, 1000 + k), viscous) for k in range(times))


def fit_default_speeds(law: Stribeck, viscous: Viscous, times: int) -> tuple[StribeckFit, ...]:
    return fit_many_times(law, viscous, times, SPEED.size, SCATTER)


def _three_errors(times: int, share: float = 0.95) -> float:
    """Three binomial standard errors of a share among so many trials."""
    return 3.0 * math.sqrt(share * (1.0 - share) / times)


def covers_truth(fit: StribeckFit) -> NDArray[np.bool_]:
    """Return whether the intervals of static, kinetic and decay hold the truth, which is ``LAW``."""
    low, high = fit.intervals[:3].T
    truth = coefficients_of(LAW, fit.names)[:3]
    return (low <= truth) & (truth <= high)


def coefficients_of(law: Stribeck, names: tuple[str, ...]) -> Array:
    return np.array([getattr(law, name) for name in names])


def stribeck_curve(v: Array, static: float, kinetic: float, decay: float, viscous: float = 0.0) -> Array:
    return kinetic + (static - kinetic) * np.exp(-decay * v) + viscous * v


def assert_fit_near(fit: StribeckFit, law: Stribeck, relative: float) -> None:
    for name in UNITS:
        expected = getattr(law, name)
        scale = 1.0 if name == 'viscous' else expected
        assert getattr(fit.law, name) == pytest.approx(expected, abs=relative * scale), name


# --- the estimate -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ('decay', 'slope', 'viscous'),
    [(0.5, 0.0, 'auto'), (1e4, 0.0, 'no'), (10.0, 0.1, 'auto'), (10.0, 0.1, 'yes')],
)
def test_exact_data_give_the_law_back(decay: float, slope: float, viscous: Viscous) -> None:
    law = Stribeck(0.35, 0.08, decay, slope)
    speed = np.concatenate([[0.0], np.geomspace(0.02, 6.0, 15)]) / decay
    fit = fit_stribeck(curve_of(speed, law.coefficient(speed)), viscous)
    assert_fit_near(fit, law, 1e-10)
    assert fit.outliers.size == 0


@pytest.mark.parametrize(('law', 'viscous'), [(LAW, 'no'), (RISING, 'yes')])
def test_it_is_the_weighted_least_squares_solution(law: Stribeck, viscous: Viscous) -> None:
    """Find the same law and correlation by an independent solver with the final weights."""
    curve = noisy_curve(law)
    fit = fit_stribeck(curve, viscous)
    assert np.all(fit.weight > 0.0)
    start = (0.3, 0.1, 8.0, 0.1)[: len(fit.names)]
    parameters, covariance = curve_fit(
        stribeck_curve,
        curve.speed,
        curve.coefficient,
        start,
        sigma=fit.weight**-0.5,
        xtol=1e-15,
        ftol=1e-15,
        gtol=1e-15,
    )
    np.testing.assert_allclose(fit.estimate, parameters, rtol=1e-7)
    error = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose(fit.correlation, covariance / np.outer(error, error), atol=1e-5)


@pytest.mark.parametrize(('law', 'viscous'), [(LAW, 'no'), (RISING, 'yes')])
def test_the_band_is_that_of_the_covariance(law: Stribeck, viscous: Viscous) -> None:
    """Use the delta method, with derivatives by central differences of the law's own formula."""
    fit = fit_stribeck(noisy_curve(law), viscous)
    speed, rows = np.array([0.0, 0.05, 0.2, 1.0]), []
    for k in range(fit.estimate.size):
        step = np.where(np.arange(fit.estimate.size) == k, 1e-5 * fit.estimate, 0.0)
        ahead, behind = (stribeck_curve(speed, *(fit.estimate + sign * step)) for sign in (1.0, -1.0))
        rows.append((ahead - behind) / (2.0 * step[k]))
    variance = np.sum(rows * (fit.covariance @ rows), axis=0)
    quantile = stats.t.ppf(0.975, fit.degrees_of_freedom)
    np.testing.assert_allclose(fit.band(speed), quantile * np.sqrt(variance), rtol=1e-5)


def test_robustness_costs_no_precision_on_clean_data() -> None:
    """Standard errors are those of plain least squares: of 60 curves within 5 % in the mean."""
    ratios = []
    for fit in fit_default_speeds(LAW, 'no', 60):
        _, plain = curve_fit(stribeck_curve, fit.curve.speed, fit.curve.coefficient, (0.3, 0.1, 8.0))
        ratios.append(fit.standard_error / np.sqrt(np.diag(plain)))
    np.testing.assert_allclose(np.mean(ratios, axis=0), 1.0, atol=0.05)


def test_outliers_move_the_estimate_by_less_than_its_standard_errors() -> None:
    """Bad readings 10 to 30 scatters off, not at the two lowest speeds, which nothing checks."""
    moves = []
    for seed, undisturbed_fit in enumerate(fit_default_speeds(LAW, 'no', 60)[:10]):
        random = np.random.default_rng(seed)
        mu = undisturbed_fit.curve.coefficient.copy()
        bad = 2 + random.choice(mu.size - 2, mu.size // 5, replace=False)
        off = random.choice([-1.0, 1.0], bad.size) * random.uniform(10.0, 30.0, bad.size)
        mu[bad] += SCATTER * off
        fit = fit_stribeck(curve_of(SPEED, mu), 'no')
        assert set(bad) <= set(fit.outliers)
        moves.append((fit.estimate - undisturbed_fit.estimate) / undisturbed_fit.standard_error)
    assert np.median(np.abs(moves)) < 0.6
    assert np.max(np.abs(moves)) < 2.5


COVERAGE: tuple[tuple[Viscous, int, int, float], ...] = (
    ('no', 60, 26, 0.003),
    ('auto', 30, 20, 0.003),
    ('no', 30, 8, 0.003),
    ('no', 30, 40, 0.01),
)
"""Decision on the viscous slope, times, points and scatter of each study."""


def test_intervals_are_neither_too_wide_nor_too_narrow() -> None:
    """Join all studies: 150 trials, (95 +- 5.3) %."""
    fits = [
        fit
        for viscous, times, points, scatter in COVERAGE
        for fit in fit_many_times(LAW, viscous, times, points, scatter)
    ]
    share = np.mean([covers_truth(fit) for fit in fits], axis=0)
    assert len(fits) == 150
    np.testing.assert_allclose(share, 0.95, atol=_three_errors(150))


# --- invariance ---------------------------------------------------------------------------------


def test_order_and_units_do_not_matter() -> None:
    curve, std = noisy_curve(), np.linspace(1.0, 2.0, SPEED.size)
    fit = fit_stribeck(dataclasses.replace(curve, std=std), 'no')
    order = np.random.default_rng(0).permutation(SPEED.size)
    columns = (1e-6 * curve.speed, 1e4 * curve.coefficient, 50.0 * std)
    reordered = fit_stribeck(curve_of(*(column[order] for column in columns)), 'no')
    scaled = np.array([1e4, 1e4, 1e6])
    np.testing.assert_allclose(reordered.estimate, fit.estimate * scaled, rtol=1e-7)
    np.testing.assert_allclose(reordered.intervals, fit.intervals * scaled[:, None], rtol=1e-6)
    assert reordered.scale == pytest.approx(fit.scale * 1e4 / 50.0)


# --- the viscous slope --------------------------------------------------------------------------


def test_auto_takes_the_slope_where_the_data_carry_it() -> None:
    """Take it by chance in up to the 1 % of the F-test: 1 of 20 is within three errors, 2 not."""
    used = [
        sum('viscous' in fit.names for fit in fit_default_speeds(law, 'auto', 20)) for law in (LAW, RISING)
    ]
    assert used[0] < 20 * (0.01 + _three_errors(20, 0.01))
    assert used[1] > 20 * 0.9


def test_the_test_of_the_slope_is_the_f_test() -> None:
    curve = noisy_curve(RISING)
    fit = fit_stribeck(curve)
    test = fit.viscous_test
    assert test is not None
    assert test.demands_slope
    assert test.slope == pytest.approx(fit.law.viscous, rel=1e-12)
    parameters, covariance = curve_fit(
        stribeck_curve,
        curve.speed,
        curve.coefficient,
        (0.3, 0.1, 8.0, 0.1),
        sigma=fit.scale * fit.weight**-0.5,
        absolute_sigma=True,
        xtol=1e-14,
        ftol=1e-14,
    )
    assert test.f_value == pytest.approx(parameters[3] ** 2 / covariance[3, 3], rel=1e-5)


def test_a_slope_that_is_negative_by_chance_is_held_at_0() -> None:
    fits = [fit_stribeck(noisy_curve(seed=seed), 'yes') for seed in (1, 3, 8)]
    for fit in fits:
        assert fit.viscous_test is not None
        assert fit.viscous_test.slope < 0.0
        assert ('viscous' in fit.names, fit.law.viscous) == (False, 0.0)


# --- refusals -----------------------------------------------------------------------------------

NOISE = np.random.default_rng(11).standard_normal(SPEED.size)


@pytest.mark.parametrize(
    ('speed', 'coefficient', 'viscous', 'words'),
    [
        (SPEED[:4], LAW.coefficient(SPEED[:4]), 'auto', 'points = 4 must be at least 5: 3 coeff'),
        (
            np.repeat([0.0, 0.1], 5),
            np.repeat([0.3, 0.2], 5),
            'auto',
            'different speeds = 2 must be at least 3',
        ),
        (SPEED, 0.3 - 0.2 * np.exp(-10.0 * SPEED), 'auto', 'static - kinetic = -0.2 must be abov'),
        (SPEED, 0.1 + 0.3 * SPEED, 'no', 'must be above 0: the curve has no falling part'),
        (SPEED, 0.3 - 0.2 * SPEED + 1e-3 * NOISE, 'auto', 'only: up to the highest speed, 0.5 m/s'),
        (
            SPEED,
            np.where(SPEED == 0.0, 0.3, 0.1) + 2e-3 * NOISE,
            'auto',
            'has no upper limit: all speeds but the lowest',
        ),
        (SPEED + 0.7, LAW.coefficient(SPEED + 0.7), 'auto', 's/m * 0.7 m/s = 7 must not be above'),
        (SPEED, 0.2 + 0.01 * NOISE, 'no', 'F = '),
        (SPEED, LAW.coefficient(SPEED) - 0.2 * SPEED, 'yes', 'viscous = -0.2 s/m (F = '),
        (SPEED / 50, LAW.coefficient(SPEED / 1000), 'no', 'correlation of kinetic and decay = '),
    ],
)
def test_a_curve_that_cannot_identify_the_law_is_refused(
    speed: Array, coefficient: Array, viscous: Viscous, words: str
) -> None:
    with pytest.raises(FitError) as caught:
        fit_stribeck(curve_of(speed, coefficient), viscous)
    assert words in str(caught.value)
    assert '\n' not in str(caught.value)


def test_a_level_below_zero_is_held_at_zero() -> None:
    mu = Stribeck(0.2, 0.0, 8.0).coefficient(SPEED) - 0.003 + 0.002 * NOISE
    fit = fit_stribeck(curve_of(SPEED, mu))
    assert fit.names == ('static', 'decay')
    assert fit.law.kinetic == 0.0
    parameters, _ = curve_fit(
        lambda v, s, b: s * np.exp(-b * v), SPEED, mu, (0.2, 8.0), sigma=fit.weight**-0.5
    )
    np.testing.assert_allclose(fit.estimate, parameters, rtol=1e-6)
    assert 'held at 0' in fit.warnings[0]


def test_warnings_name_what_is_weak() -> None:
    assert fit_stribeck(noisy_curve(), 'no').warnings == ()
    fast_only = fit_stribeck(noisy_curve(speed=SPEED + 0.15, scatter=0.001), 'no')
    assert 'static is extrapolated: at the lowest speed, 0.15 m/s' in fast_only.warnings[0]
    lonely = np.array([0.0, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4, 0.45, 0.5])
    alone = fit_stribeck(noisy_curve(speed=lonely, scatter=0.0005), 'no')
    assert unchecked_point(alone).startswith('the point of line 1, 0 m/s, is not checked by any other')
    assert not alone.warnings
    mu = noisy_curve().coefficient
    mu[[3, 7, 11, 15, 19, 23]] += 0.1
    (text,) = fit_stribeck(curve_of(SPEED, mu), 'no').warnings
    assert 'of the points count less than half' in text


# --- what the uncertainty means -----------------------------------------------------------------


def stepped_curve(v: Array) -> Array:
    return np.where(v < 0.1, 0.30, np.where(v < 0.2, 0.22, 0.10))


@pytest.mark.parametrize(
    ('shape', 'points', 'scatter', 'named'),
    [
        (stepped_curve, 20, 0.005, True),
        (lambda v: 0.30 - 0.04 * np.log(1.0 + v / 0.005), 100, 0.005, True),
        (lambda v: 0.10 + 0.20 / (1.0 + (v / 0.1) ** 6), 40, 0.002, True),
        # Of so few points no run is long: that the curve goes on falling shows it.
        (lambda v: 0.20 - 0.05 * np.log(v + 0.01), 15, 0.003, True),
        (LAW.coefficient, 40, 0.002, False),
    ],
)
def test_another_shape_is_named(
    shape: Callable[[Array], Array], points: int, scatter: float, named: bool
) -> None:
    speed = np.linspace(0.0, 0.5, points)
    noise = np.random.default_rng(2).standard_normal(speed.size)
    fit = fit_stribeck(curve_of(speed, shape(speed) + scatter * noise))
    assert any('has another shape' in text for text in fit.warnings) == named


@pytest.mark.parametrize('points', [6, 8])
def test_few_points_of_the_right_law_are_hardly_warned_of(points: int) -> None:
    fits = fit_many_times(LAW, 'auto', 40, points, SCATTER)
    assert sum(bool(fit.warnings) for fit in fits) <= 4


SWEEP = np.geomspace(0.005, 1.0, 20)
UP, DOWN = Stribeck(0.32, 0.1, 8.0), Stribeck(0.26, 0.1, 14.0)
BACK = SWEEP[::-1]
AGAIN = np.tile(SWEEP[::2], 4)


@pytest.mark.parametrize(
    ('speed', 'coefficient'),
    [
        # A run up and down, on two branches.
        (np.r_[SWEEP, BACK], np.r_[UP.coefficient(SWEEP), DOWN.coefficient(BACK)]),
        # Running in: friction falls by 28 % from the first of four sweeps to the last.
        (AGAIN, np.repeat(np.linspace(1.0, 0.72, 4), 10) * LAW.coefficient(AGAIN)),
    ],
)
def test_friction_that_changes_during_the_measurement_is_named(speed: Array, coefficient: Array) -> None:
    noise = 0.002 * np.random.default_rng(3).standard_normal(speed.size)
    fit = fit_stribeck(curve_of(speed, coefficient + noise))
    assert any('measured one after the other' in text for text in fit.warnings), fit.warnings


def test_the_right_shape_is_hardly_ever_doubted() -> None:
    # At the 2 % level; five of 60 fits would be three standard errors more.
    fits = fit_default_speeds(LAW, 'no', 60)
    assert sum('has another shape' in text for fit in fits for text in fit.warnings) <= 4


@pytest.mark.parametrize('law', [LAW, RISING])
def test_boundaries_spread_as_those_of_laws_drawn_from_the_fit(law: Stribeck) -> None:
    """Draw laws from the multivariate t distribution, of ln beta: to a tenth of the spread."""
    fit = fit_stribeck(noisy_curve(law, scatter=0.004), 'yes' if law.viscous else 'no')
    belief = boundary_belief(fit, BENCH, 1000.0)
    coefficients = stats.multivariate_t(fit.estimate, fit.covariance, fit.degrees_of_freedom, seed=7).rvs(800)
    coefficients[:, 2] = fit.law.decay * np.exp(coefficients[:, 2] / fit.law.decay - 1.0)
    bearings = [dataclasses.replace(BENCH, friction=Stribeck(*np.maximum(row, 0.0))) for row in coefficients]
    for speed_of, quantile in ((hopf_speed, belief.hopf_speed), (fold_speed, belief.fold_speed)):
        speeds = np.nan_to_num([speed_of(bearing, 1000.0) for bearing in bearings])
        low, middle, high = np.quantile(speeds, [0.025, 0.5, 0.975])
        quantiles = [quantile(1000.0, p) for p in (0.025, 0.5, 0.975)]
        assert quantiles == pytest.approx([low, middle, high], abs=0.1 * (high - low))


# --- the file -----------------------------------------------------------------------------------


@pytest.fixture
def write(tmp_path: Path) -> Write:
    def to_file(content: str | bytes) -> Path:
        path = tmp_path / 'curve.csv'
        path.write_bytes(content.encode() if isinstance(content, str) else content)
        return path

    return to_file


def test_a_plain_file(write: Write) -> None:
    curve = read_curve(write('# a bench\n\nspeed,mu\n0.0,0.30\n# between\n0.1,0.2\n'))
    assert curve.speed.tolist() == [0.0, 0.1]
    assert curve.coefficient.tolist() == [0.3, 0.2]
    assert curve.std.tolist() == [1.0, 1.0]
    assert curve.line.tolist() == [4, 6]
    assert (curve.unit, curve.unit_source) == ('m/s', 'assumed: the heading states none')


def test_columns_and_unit_may_be_named(write: Write) -> None:
    path = write('a [rad/s],b,c,std,weight\n2.0,0.1,0.3,0.5,16\n')
    named = {'speed': 'a', 'coefficient': 'c'}
    curve = read_curve(path, named, None, 0.5)
    assert (curve.speed[0], curve.coefficient[0], curve.std[0]) == (0.5, 0.3, 0.5)
    assert read_curve(path, named | {'weight': 'weight'}, None, 0.5).std.tolist() == [0.25]


@pytest.mark.parametrize(
    ('content', 'speed'),
    [
        ('rpm,cof\n60,0.25\n', math.pi * 0.1),
        ('Speed [rpm];Friction coefficient [-]\n60;0,25\n', math.pi * 0.1),
        ('n (1/min)\tCoF\n60\t0,25\n', math.pi * 0.1),
        ('\ufeffshaft_speed_rpm,"coefficient of friction"\r\n60,0.25\r\n', math.pi * 0.1),
        ('n [U/min] am Zapfen;Reibwert\n60;0,25\n', math.pi * 0.1),
        ('rad/s,cof\n2,0.25\n', 0.1),
        ('mm/s;cof\n250;0,25\n', 0.25),
        ('m/s;cof\n0.5;0,25\n', 0.5),
        ('velocity m/s,friction coefficient %\n0.5,25\n', 0.5),
        ('speed m s-1,mu\n0.5,0.25\n', 0.5),
        ('Speed in mm s^-1;mu\n500;0,25\n', 0.5),
        ('speed cm s-1,mu\n50,0.25\n', 0.5),
        ('shaft speed rad s-1,mu\n10,0.25\n', 0.5),
        ('speed [um/s],mu [%]\n4300,25\n', 0.0043),
        ('"Velocity, m/s","Friction coefficient, -"\n0.5,0.25\n', 0.5),
        ('v / (m/s),mu / -\n0.5,0.25\n', 0.5),
        ('Speed (m s^-1),Coefficient of Friction (COF)\n0.5,0.25\n', 0.5),
        ('Velocity (m·s-1)\tDynamic friction coefficient f\n0.5\t0.25\n', 0.5),
        ('Gleitgeschwindigkeit [mm/s];Reibwert\n250;0,25\n', 0.25),
        ('relative sliding velocity,mean µ,SD,Load [N]\nm/s,-,-,N\n0.5,0.25,0.01,300\n', 0.5),
    ],
)
def test_a_heading_that_has_or_ends_in_a_unit(write: Write, content: str, speed: float) -> None:
    curve = read_curve(write(content), journal_diameter=0.1)
    assert curve.speed.tolist() == pytest.approx([speed])
    assert curve.coefficient.tolist() == pytest.approx([0.25])
    assert (curve.unit == 'rpm') == (speed == math.pi * 0.1)


@pytest.mark.parametrize(
    'extra_column',
    [
        'temperature deviation,load error',
        'load W [N],weight loss [mg]',
        'friction force,friction torque [Nm]',
        'speed setpoint [m/s],speed std [m/s]',
    ],
)
def test_a_column_of_another_quantity_is_no_part_of_the_curve(write: Write, extra_column: str) -> None:
    # As the spread or the weight of the points it would bend the fit without a warning.
    curve = read_curve(write(f'speed [m/s],{extra_column},mu\n0.5,7,8,0.25\n0.6,9,3,0.24\n'))
    assert (curve.speed.tolist(), curve.coefficient.tolist()) == ([0.5, 0.6], [0.25, 0.24])
    assert curve.std.tolist() == [1.0, 1.0]


def test_a_coefficient_with_a_unit_is_refused(write: Write) -> None:
    with pytest.raises(FitError, match=r"unit = 'N' must be one of 1, %: a coefficient"):
        read_curve(write('speed,friction [N]\n0.1,300\n'))


@pytest.mark.parametrize(
    ('content', 'words'),
    [
        ('', ' is empty'),
        ('speed,mu\n', ' has headings (line 1) but no points'),
        ('0.1,0.3\n0.2,0.2\n', ", line 1 has numbers and no headings: put a line 'speed [m/s],mu' be"),
        ('a,mu\n1,2\n', ", line 1: no column for the speed among 'a', 'mu': name it with --speed-c"),
        ('v,speed,mu\n1,2,3\n', ", line 1: several columns may be the speed: 'v', 'speed'"),
        ('speed,mu\n0,0.3\n\n0.1,x\n', ", line 4, column 'mu' = 'x' must be a finite number betw"),
        ('speed,mu\n0\n', ", line 2, column 'mu': the line has 1 cell and the headings 2"),
        ('speed,mu\n0,nan\n', ", line 2, column 'mu' = 'nan' must be a finite number"),
        ('speed,mu\n0,-1e40\n', ", line 2, column 'mu' = '-1e40' must be a finite number betw"),
        ('speed,mu\n"1,2\n', ", line 2, column 'mu': the line has 1 cell and the headings 2"),
        ('speed,mu\n-0.1,0.2\n', ", line 2, column 'speed' = '-0.1' must be a finite number betw"),
        ('speed,mu,std\n0.1,0.2,0\n', ", line 2, column 'std' = '0' must be a finite number above 0"),
        ('speed [rpm];mu\n1.200;0,15\n', ": '1.200' (line 2) has a point and '0,15' (line 2) a comma"),
        ('speed [rpm]\tmu\n1,200\t0.15\n', ": '0.15' (line 2) has a point and '1,200' (line 2) a com"),
        ('speed (rpm) x1000,mu\n1,2\n', ", line 1, column 'speed (rpm) x1000': unclear whether numbers"),
        ('speed [kn],mu\n1,2\n', ", line 1, column 'speed [kn]': unit = 'kn' must be one of rpm"),
        ('speed [rpm],mu\n1,2\n', ": speeds in rpm need the journal's diameter"),
        (b'\xff\xfe\x00', ' has headings (line 1) but no points'),
    ],
)
def test_a_file_that_breaks_a_rule_is_refused(write: Write, content: str | bytes, words: str) -> None:
    path = write(content)
    with pytest.raises(FitError) as caught:
        read_curve(path)
    assert str(caught.value).startswith(f'{path}{words}')


def test_options_that_do_not_fit_the_file_are_refused(write: Write) -> None:
    path = write('speed [m/s],mu\n1,2\n')
    with pytest.raises(FitError, match=r"'speed \[m/s\]' is in m/s, and --speed-unit says rpm"):
        read_curve(path, unit='rpm', journal_diameter=0.1)
    with pytest.raises(FitError, match=r"--std-column 'x' is none of the columns 'speed \[m/s"):
        read_curve(path, {'std': 'x'})
    with pytest.raises(FitError, match='give --std-column or --weight-column, not both'):
        read_curve(path, {'std': 'mu', 'weight': 'mu'})
    with pytest.raises(PhysicsError, match=r'journal_diameter = -1 m must be greater than 0'):
        read_curve(write('speed [rpm],mu\n1,2\n'), journal_diameter=-1.0)


def test_numbers_that_look_like_another_unit_get_a_question() -> None:
    v = np.linspace(0.0, 1.0, 30)
    mu = 0.1 + 0.2 * np.exp(-10.0 * v)
    assert not fit_stribeck(curve_of(v, mu)).warnings
    (percent,) = fit_stribeck(curve_of(v, 100.0 * mu)).warnings
    assert percent.endswith('is it in percent, 30 for 0.30?')
    (rpm,) = fit_stribeck(curve_of(190.0 * v, mu)).warnings
    assert rpm.endswith('is it in rpm (--speed-unit rpm)?')
    (diameter,) = fit_stribeck(replace(curve_of(1000.0 * v, mu), unit='rpm')).warnings
    assert diameter.endswith('is the diameter in metres?')
    (unit,) = fit_stribeck(replace(curve_of(1000.0 * v, mu), unit='cm/s')).warnings
    assert unit.endswith('is its unit right?')
    # A refusal asks too: the unit may be its cause.
    with pytest.raises(FitError, match=r'is it in percent, 30 for 0\.30\?'):
        fit_stribeck(curve_of(v, np.full(30, 30.0)))
