# SPDX-License-Identifier: Apache-2.0
"""One law of curves at several loads and temperatures: benches that are made from a known law."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from shared import REFERENCE_BEARING

from stickslip_lab.friction.curve_file import FrictionCurve, read_curve
from stickslip_lab.friction.friction_fit import SEVERAL_LOADS, boundary_belief, fit_stribeck
from stickslip_lab.friction.pooled_fit import PooledFit, fit_curve
from stickslip_monitor import fold_speed
from stickslip_monitor.errors import FitError
from stickslip_monitor.physics.lubrication import viscosity

LOADS = (500.0, 1000.0, 3000.0)


def make_bench(
    exponent: float, noise: float, seed: int = 0, *, has_column: bool = True, order: str = 'curves'
) -> FrictionCurve:
    """Return a bench at three loads: the reference law at 1 kN, its speeds in proportion to N^g."""
    random = np.random.default_rng(seed)
    load = np.repeat(LOADS, 12)
    speed = np.tile(np.geomspace(0.01, 1.2, 12), 3)
    mu = 0.1 + 0.2 * np.exp(-10.0 * speed / (load / 1000.0) ** exponent) + noise * random.normal(size=36)
    row = np.arange(36) if order == 'curves' else random.permutation(36)
    line = np.arange(36) + 2
    return FrictionCurve(speed[row], mu[row], np.ones(36), line, 'm/s', '', load[row] if has_column else None)


def fit_pooled(curve: FrictionCurve) -> PooledFit:
    """Fit a curve with a column of loads or temperatures."""
    fit = fit_curve(curve)
    assert isinstance(fit, PooledFit)
    return fit


@pytest.mark.parametrize('exponent', [0.0, 0.5, 1.0])
def test_exact_curves_give_the_law_and_the_exponent(exponent: float) -> None:
    fit = fit_pooled(make_bench(exponent, 0.0))
    assert fit.load == pytest.approx(1500.0 ** (1 / 3) * 1e6 ** (1 / 3), rel=1e-9)
    assert fit.exponent == pytest.approx(exponent, abs=1e-4)
    assert fit.law.decay == pytest.approx(10.0 / (fit.load / 1000.0) ** exponent, rel=1e-4)
    assert fit.law.static == pytest.approx(0.3, rel=1e-4)


@pytest.mark.parametrize(('load', 'sentence'), [(None, ''), (1000.0, 'the points are of one load')])
def test_one_load_is_reported_and_an_unknown_one_is_not(load: float | None, sentence: str) -> None:
    curve = make_bench(0.0, 0.0, has_column=False)
    loads = None if load is None else np.full(36, load)
    fit = fit_pooled(replace(curve, load=loads, temperature=np.repeat([5.0, 15.0, 30.0], 12)))
    assert fit.sentence == sentence


def test_a_temperature_alone_is_taken_out() -> None:
    water = np.repeat([5.0, 15.0, 30.0], 12)
    speed = np.tile(np.geomspace(0.01, 1.2, 12), 3)
    ratio = viscosity(water) / viscosity(15.0)
    mu = 0.1 + 0.2 * np.exp(-10.0 * speed * ratio)
    curve = FrictionCurve(speed, mu, np.ones(36), np.arange(36), 'm/s', '', None, water)
    fit = fit_pooled(curve)
    assert not fit.has_exponent
    assert fit.temperature == pytest.approx(50.0 / 3.0)
    expected = 10.0 * float(viscosity(fit.temperature) / viscosity(15.0))
    assert fit.law.decay == pytest.approx(expected, rel=1e-6)
    assert fit_stribeck(curve).scale > 1e3 * fit.scale


def test_the_sentence_says_what_the_load_does() -> None:
    assert re.fullmatch(
        r'the load explains it \(g = (0.9|1.0)\d \+- 0.0\d+\)', fit_pooled(make_bench(1.0, 0.002)).sentence
    )
    assert fit_pooled(make_bench(0.0, 0.002, 3)).sentence.startswith('no effect')


@pytest.mark.parametrize('order', ['curves', 'mixed'])
def test_pooled_curves_without_their_loads_raise_a_question(order: str) -> None:
    assert SEVERAL_LOADS in fit_curve(make_bench(1.0, 0.004, has_column=False, order=order)).warnings
    assert not fit_curve(make_bench(1.0, 0.004, order=order)).warnings


def test_errors_of_the_coefficients_contain_that_of_the_exponent() -> None:
    """Compare with the spread of many benches: errors at a known exponent are too small."""
    fits = [fit_pooled(make_bench(0.8, 0.004, seed)) for seed in range(40)]
    decays = np.log([fit.law.decay for fit in fits])
    stated = np.mean([fit.standard_error[2] / fit.law.decay for fit in fits])
    # The standard deviation of 40 is known to 11 %.
    assert stated == pytest.approx(decays.std(), rel=0.35)
    exponents = np.array([fit.exponent for fit in fits])
    assert np.mean([fit.exponent_error for fit in fits]) == pytest.approx(exponents.std(), rel=0.35)


@pytest.mark.slow
def test_the_interval_holds_the_exponent_in_95_of_100_benches() -> None:
    inside = 0
    for seed in range(200):
        low, high = fit_pooled(make_bench(0.7, 0.004, seed)).exponent_interval
        inside += low <= 0.7 <= high
    assert inside >= 182  # of 190 expected, less 2.6 of their 3.1


def test_boundaries_follow_the_load() -> None:
    bearing = REFERENCE_BEARING
    belief = boundary_belief(fit_curve(make_bench(1.0, 1e-6)), bearing, 3000.0)
    true = 3.0 * float(fold_speed(bearing, 1000.0))
    assert fold_speed(belief.bearing, 3000.0) == pytest.approx(true, rel=1e-3)


def test_columns_of_load_and_temperature_are_read(tmp_path: Path) -> None:
    path = tmp_path / 'bench.csv'
    path.write_text('speed [m/s],mu,Normal force [kN],water temperature [°C]\n0.1,0.3,1.5,15\n0.2,0.2,2,20\n')
    curve = read_curve(path)
    assert curve.load is not None
    assert curve.temperature is not None
    assert curve.load.tolist() == [1500.0, 2000.0]
    assert curve.temperature.tolist() == [15.0, 20.0]


@pytest.mark.parametrize(
    ('heading', 'text', 'newtons'),
    [
        ('load [kN]', '1.5', 1500.0),
        ('load kN', '1.5', 1500.0),
        ('Load_kN', '1.5', 1500.0),
        ('normal load, MN', '0.1', 1e5),
        ('Last (t)', '2', 2.0 * 9806.65),
        ('load [lbf]', '100', 444.82216152605),
        ('load', '1.5', 1.5),
    ],
)
def test_a_load_may_be_in_any_unit_of_force(tmp_path: Path, heading: str, text: str, newtons: float) -> None:
    path = tmp_path / 'bench.csv'
    path.write_text(f'speed [m/s];mu;{heading}\n0.1;0.3;{text}\n')
    load = read_curve(path).load
    assert load is not None
    assert load.tolist() == pytest.approx([newtons])


@pytest.mark.parametrize(('heading', 'celsius'), [('temp C', 50.0), ('water temperature [F]', 10.0)])
def test_a_temperature_may_have_its_unit_in_words(tmp_path: Path, heading: str, celsius: float) -> None:
    path = tmp_path / 'bench.csv'
    path.write_text(f'speed [m/s],mu,{heading}\n0.1,0.3,50\n')
    water = read_curve(path).temperature
    assert water is not None
    assert water.tolist() == pytest.approx([celsius])


@pytest.mark.parametrize(
    ('heading', 'row', 'text'),
    [
        (
            'load [bar]',
            '1.5',
            r"column 'load \[bar\]': unit = 'bar' must be one of N, kN, MN, .*projected area",
        ),
        ('temperature [R]', '1.5', "unit = 'R' must be one of C, K, F"),
        ('load [kN]', '0', r"line 2, column 'load \[kN\]' = '0' must be a finite number above 0 .*N$"),
        ('temp [C]', '99', r"column 'temp \[C\]' = '99' must be a finite number between -2 and 60 C"),
    ],
)
def test_impossible_conditions_are_refused(tmp_path: Path, heading: str, row: str, text: str) -> None:
    path = tmp_path / 'bench.csv'
    path.write_text(f'speed [m/s],mu,{heading}\n0.1,0.3,{row}\n')
    with pytest.raises(FitError, match=text):
        read_curve(path)


@pytest.mark.parametrize(
    ('headings', 'text'),
    [
        ('speed [m/s],mu @ 500 N,mu @ 1 kN', 'several columns may be the coefficient: .*below each other'),
        ('speed [m/s],friction force [N],load [N]', r'coefficient \(friction force over load\) among'),
    ],
)
def test_the_refusal_of_another_table_says_how_to_write_it(tmp_path: Path, headings: str, text: str) -> None:
    path = tmp_path / 'bench.csv'
    path.write_text(f'{headings}\n0.1,0.3,0.25\n')
    with pytest.raises(FitError, match=text):
        read_curve(path)


def test_points_of_one_speed_at_several_loads_are_refused() -> None:
    bench = make_bench(0.5, 0.01)
    single = FrictionCurve(np.full(36, 0.1), bench.coefficient, bench.std, bench.line, 'm/s', '', bench.load)
    with pytest.raises(FitError, match='different speeds = 1 must be at least 3'):
        fit_curve(single)
