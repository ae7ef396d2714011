# SPDX-License-Identifier: Apache-2.0
"""The sea against closed forms of the Pierson-Moskowitz and the JONSWAP spectrum."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.signal import welch

from stickslip_monitor.errors import SceneError
from stickslip_monitor.lab.scenes.effects.ship import Sea
from stickslip_monitor.lab.scenes.scene import Scene

MakeScene = Callable[..., Scene]
HEIGHT, PERIOD = 2.5, 8.0
PEAK = 2.0 * math.pi / PERIOD
WAVES: dict[str, Any] = {
    'unit': 'N',
    'significant_height': HEIGHT,
    'peak_period': PERIOD,
    'gamma': 3.3,
    'load_per_metre': 120.0,
}
STEADY = {'load_profile': {'unit': 'N', 'points': [[0, 5000]]}}


def sea(gamma: float, seed: int = 1) -> Sea:
    return Sea.of(HEIGHT, PERIOD, gamma, np.random.default_rng(seed))


def jonswap(omega: float, gamma: float) -> float:
    """DNV-RP-C205, 3.5.5.1, with its fit 1 - 0.287 ln(gamma) of the normalising factor."""
    x = omega / PEAK
    width = 0.07 if x <= 1.0 else 0.09
    moskowitz = 5.0 / 16.0 * HEIGHT**2 * PEAK**4 * omega**-5.0 * math.exp(-1.25 * x**-4.0)
    peak = gamma ** math.exp(-0.5 * ((x - 1.0) / width) ** 2)
    return (1.0 - 0.287 * math.log(gamma)) * moskowitz * peak


@pytest.mark.parametrize('gamma', [1.0, 3.3, 7.0])
def test_variance_is_a_sixteenth_of_the_height_squared(gamma: float) -> None:
    waves = sea(gamma)
    assert waves.frequency.size * waves.amplitude**2 / 2.0 == pytest.approx(HEIGHT**2 / 16.0)
    time = np.arange(40_000) * 0.97
    # 80 000 wave periods' worth of independent groups: some percent.
    assert waves.elevation(time).var() == pytest.approx(HEIGHT**2 / 16.0, rel=0.05)
    assert abs(waves.elevation(time).mean()) < 0.02


def test_components_share_the_energy_of_pierson_and_moskowitz() -> None:
    """With gamma = 1 the share below a frequency is exp(-1.25 x^-4) in closed form."""
    frequency = np.sort(sea(1.0).frequency)
    below = np.exp(-1.25 * (frequency * PERIOD) ** -4.0) / math.exp(-1.25 * 5.0**-4.0)
    number = np.arange(frequency.size)
    # Each has its frequency somewhere in its own part of the energy.
    assert np.all(number / frequency.size <= below + 1e-6)
    assert np.all(below <= (number + 1) / frequency.size + 1e-6)


@pytest.mark.parametrize('gamma', [1.5, 3.3, 7.0])
def test_mean_period_is_that_of_jonswap(gamma: float) -> None:
    """The fit of DNV-RP-C205, 3.5.5.4, for T1/Tp.

    Beyond five times the peak frequency lie 0.2 % of the energy and so 1 % of the mean frequency.
    """
    ratio = 0.7303 + 0.04936 * gamma - 0.006556 * gamma**2 + 0.0003610 * gamma**3
    means = [sea(gamma, seed).frequency.mean() for seed in range(20)]
    assert 1.0 / np.mean(means) / PERIOD == pytest.approx(ratio, rel=0.01)


def test_spectrum_of_the_record_is_jonswap() -> None:
    """Energy in bands, by Welch's method, against the integral of the formula."""
    rate, gamma = 2.0, 3.3
    record = sea(gamma, 5).elevation(np.arange(200_000) / rate)
    frequency, density = welch(record, rate, nperseg=1024)
    for low, high in ((0.6, 0.85), (0.85, 1.0), (1.0, 1.15), (1.15, 1.6), (1.6, 2.5)):
        inside = (frequency >= low / PERIOD) & (frequency < high / PERIOD)
        edges = frequency[inside][0], frequency[inside][-1]
        half = 0.5 * (frequency[1] - frequency[0])
        omegas = 2.0 * math.pi * (edges[0] - half), 2.0 * math.pi * (edges[1] + half)
        expected = quad(jonswap, *omegas, args=(gamma,))[0]
        found = density[inside].sum() * 2.0 * half
        assert found == pytest.approx(expected, rel=0.12, abs=0.003 * HEIGHT**2 / 16.0)


def test_record_does_not_repeat_and_is_normal() -> None:
    waves = sea(3.3)
    first = waves.elevation(np.arange(7200.0))
    for later in (600.0, 3600.0, 86_400.0):
        again = waves.elevation(np.arange(7200.0) + later)
        assert abs(np.corrcoef(first, again)[0, 1]) < 0.3
    long = waves.elevation(np.arange(200_000) * 1.3)
    assert np.mean(long**4) / long.var() ** 2 == pytest.approx(3.0, abs=0.15)


def test_load_is_the_elevation_times_its_factor(make_scene: MakeScene) -> None:
    time = np.linspace(0.0, 100.0, 501)

    def ripple(**changes: Any) -> Any:
        effects = [{'load_in_waves': WAVES | changes}, STEADY]
        return make_scene(effects=effects).build().shaft.load('aft', time) - 5000.0

    base = ripple()
    np.testing.assert_allclose(ripple(significant_height=5.0), 2.0 * base, atol=1e-9)
    np.testing.assert_allclose(ripple(load_per_metre=-240.0), -2.0 * base, atol=1e-9)
    np.testing.assert_allclose(ripple(unit='kN', load_per_metre=0.12), base, atol=1e-9)
    assert np.abs(base).max() > 100.0
    assert not ripple(significant_height=0.0).any()


def test_bearings_of_one_ship_meet_the_same_sea(make_scene: MakeScene) -> None:
    two: dict[str, Any] = {'aft': {}, 'fwd': {'load': {'topic': '/fwd'}}}
    time = np.linspace(0.0, 100.0, 501)
    each = [
        {'effect': 'load_in_waves', 'bearing': name, **WAVES, 'load_per_metre': factor}
        for name, factor in (('fwd', 50.0), ('aft', 100.0))
    ]
    shaft = make_scene(two, effects=[STEADY, *each]).build().shaft
    aft, fwd = (shaft.load(name, time) - 5000.0 for name in ('aft', 'fwd'))
    np.testing.assert_allclose(aft, 2.0 * fwd, atol=1e-9)
    shaft = make_scene(two, seed=8, effects=[STEADY, *each]).build().shaft
    assert np.abs(shaft.load('aft', time) - 5000.0 - aft).max() > 10.0


@pytest.mark.parametrize('sizes', [(1, 500), (250, 251), (7,) * 71 + (4,)])
def test_an_instant_has_the_same_bits_whoever_asks(sizes: tuple[int, ...]) -> None:
    waves, time = sea(3.3), np.linspace(0.0, 1e5, 501)
    parts = np.split(time, np.cumsum(sizes)[:-1])
    found = np.concatenate([waves.elevation(part) for part in parts])
    assert found.tolist() == waves.elevation(time).tolist()


@pytest.mark.parametrize(
    ('changes', 'sentence'),
    [
        ({'significant_height': -1}, 'significant_height = -1 must be a number [m] not below 0'),
        ({'peak_period': 0}, 'peak_period = 0 must be a number [s] not below 0.1'),
        ({'gamma': 0.5}, 'gamma = 0.5 must be a number [-] not below 1 and not above 10'),
        ({'unit': 'rpm'}, "load_in_waves.unit = 'rpm' must be one of N, kN"),
    ],
)
def test_wrong_waves_are_named(
    make_scene: MakeScene, changes: dict[str, Any], sentence: str
) -> None:
    with pytest.raises(SceneError, match=re.escape(sentence)):
        make_scene(effects=[{'load_in_waves': WAVES | changes}])
