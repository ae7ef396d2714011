# SPDX-License-Identifier: Apache-2.0
"""What the ship does: profiles, orders and ripple in closed form, the sea by its spectrum."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.signal import welch
from shared import RPM

from stickslip_lab.scenes.scene import Scene
from stickslip_lab.scenes.shaft_effects import Sea

MakeScene = Callable[..., Scene]
TIME = np.linspace(0.0, 100.0, 401)
ORDERS: dict[str, Any] = {
    'unit': 'rpm',
    'ahead': {'dead slow': 20, 'half': 60, 'full': 90},
    'astern': {'slow': 30, 'full': 70},
    'orders': [[10, 'half ahead'], [20, 'stop'], [45, 'full astern'], [70, 'dead slow ahead']],
    'time_constant': 8.0,
}


def speed_of(make_scene: MakeScene, *effects: dict[str, Any]) -> Any:
    return make_scene(effects=list(effects)).build().shaft.speed('aft', TIME) / RPM


def test_table_is_the_points_in_a_file(make_scene: MakeScene, tmp_path: Path) -> None:
    text = '\ufeff# from the log\n\ntime,value\n0, 60\n 40,20\n\n90.5,3e1\n'
    (tmp_path / 'speeds.csv').write_text(text, 'utf-8')
    table = speed_of(make_scene, {'speed_profile': {'unit': 'rpm', 'table': 'speeds.csv'}})
    expected = np.interp(TIME, [0.0, 40.0, 90.5], [60.0, 20.0, 30.0])
    np.testing.assert_allclose(table, expected, rtol=1e-14)
    load = {'load_profile': {'unit': 'kN', 'table': str(tmp_path / 'speeds.csv')}}
    shaft = make_scene(effects=[load]).build().shaft
    np.testing.assert_allclose(shaft.load('aft', TIME), 1000.0 * expected, rtol=1e-14)


def test_steps_go_from_level_to_level_in_the_rise(make_scene: MakeScene) -> None:
    steps = {'unit': 'rpm', 'steps': [[5, 50], [20, 40], [24, 10], [80, -30]], 'rise': 4.0}
    speeds = speed_of(make_scene, {'speed_steps': steps})
    expected = (
        50.0
        - 10.0 * np.clip((TIME - 20.0) / 4.0, 0.0, 1.0)
        - 30.0 * np.clip((TIME - 24.0) / 4.0, 0.0, 1.0)
        - 40.0 * np.clip((TIME - 80.0) / 4.0, 0.0, 1.0)
    )
    np.testing.assert_allclose(speeds, expected, atol=1e-12)
    load = {'load_steps': steps | {'unit': 'N', 'steps': [[0, 900], [50, 1300]]}}
    shaft = make_scene(effects=[load]).build().shaft
    expected = 900.0 + 400.0 * np.clip((TIME - 50.0) / 4.0, 0.0, 1.0)
    np.testing.assert_allclose(shaft.load('aft', TIME), expected, rtol=1e-13)


def test_shaft_follows_the_telegraph_with_a_lag(make_scene: MakeScene) -> None:
    """Follow ``y' = (goal - y)/tau``: after each order an exponential, whose integral are the turns."""
    shaft = make_scene(effects=[{'manoeuvre': ORDERS}]).build().shaft
    tau, begins, goals = 8.0, [0.0, 10.0, 20.0, 45.0, 70.0], [60.0, 60.0, 0.0, -70.0, 20.0]
    speed, turns = np.empty_like(TIME), np.empty_like(TIME)
    start, turns_before = 60.0, 0.0
    for begin, end, goal in zip(begins, [*begins[1:], 100.0], goals, strict=True):
        first, last = np.searchsorted(TIME, [begin, end])
        since = TIME[first:] - begin
        speed[first:] = goal + (start - goal) * np.exp(-since / tau)
        turns[first:] = turns_before + goal * since - (start - goal) * tau * np.expm1(-since / tau)
        start, turns_before = speed[last], turns[last]
    np.testing.assert_allclose(shaft.speed('aft', TIME) / RPM, speed, atol=1e-9)
    np.testing.assert_allclose(shaft.turns('aft', TIME) * 60.0, turns, atol=1e-8)
    # The first order holds from long before.
    early_times = np.array([-1e5, -1.0, 0.0, 9.9])
    np.testing.assert_allclose(shaft.speed('aft', early_times), 60.0 * RPM, rtol=1e-14)
    np.testing.assert_allclose(shaft.turns('aft', early_times), early_times, rtol=1e-12)


# From 90 rpm ahead through zero to 30 rpm astern.
RAMP = {'speed_profile': {'unit': 'rpm', 'points': [[0, 90], [100, -30]]}}
ANGLE = 2.0 * math.pi / 60.0 * (90.0 * TIME - 0.6 * TIME**2)
BLADES = {'blade_ripple': {'blades': 4, 'amplitude': 0.02}}
BENT = {'misalignment': {'amplitude': 40.0, 'unit': 'N'}}
KILO = {'load_profile': {'unit': 'N', 'points': [[0, 1000]]}}
TURNS_ON = {'speed_steps': {'unit': 'rpm', 'steps': [[0, 0], [50, 60]], 'rise': 10.0}}


def test_ripple_follows_the_angle_of_the_shaft(make_scene: MakeScene) -> None:
    """Follow every effect that turns the shaft; ripple of the speed does not, and rest stops it."""
    speed = speed_of(make_scene, BLADES, RAMP)
    expected = (90.0 - 1.2 * TIME) * (1.0 + 0.02 * np.cos(4.0 * ANGLE))
    np.testing.assert_allclose(speed, expected, atol=1e-9)
    # The steps add one turn a second from 60 s, and five turns until then.
    extra = 2.0 * math.pi * np.where(TIME >= 60.0, TIME - 55.0, 0.05 * (TIME - 50.0) ** 2)
    further = ANGLE + np.where(TIME >= 50.0, extra, 0.0)
    for effects, angle in (
        ([BENT, KILO, RAMP], ANGLE),
        ([KILO, BLADES, RAMP, BENT], ANGLE),
        ([KILO, RAMP, TURNS_ON, BENT], further),
        ([KILO, BLADES, BENT], 0.0 * TIME),
    ):
        load = make_scene(effects=effects).build().shaft.load('aft', TIME)
        np.testing.assert_allclose(load, 1000.0 + 40.0 * np.cos(angle), atol=1e-7)


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


def make_sea(gamma: float, seed: int = 1) -> Sea:
    return Sea.of(HEIGHT, PERIOD, gamma, np.random.default_rng(seed))


def jonswap_spectrum(omega: float, gamma: float) -> float:
    """DNV-RP-C205, 3.5.5.1, with its fit 1 - 0.287 ln(gamma) of the normalising factor."""
    x = omega / PEAK
    width = 0.07 if x <= 1.0 else 0.09
    moskowitz = 5.0 / 16.0 * HEIGHT**2 * PEAK**4 * omega**-5.0 * math.exp(-1.25 * x**-4.0)
    peak = gamma ** math.exp(-0.5 * ((x - 1.0) / width) ** 2)
    return (1.0 - 0.287 * math.log(gamma)) * moskowitz * peak


def test_spectrum_of_the_record_is_jonswap() -> None:
    """Energy in bands, by Welch's method, against the integral of the formula."""
    rate, gamma = 2.0, 3.3
    record = make_sea(gamma, 5).elevation(np.arange(200_000) / rate)
    frequency, density = welch(record, rate, nperseg=1024)
    for low, high in ((0.6, 0.85), (0.85, 1.0), (1.0, 1.15), (1.15, 1.6), (1.6, 2.5)):
        inside = (frequency >= low / PERIOD) & (frequency < high / PERIOD)
        edges = frequency[inside][0], frequency[inside][-1]
        half = 0.5 * (frequency[1] - frequency[0])
        omegas = 2.0 * math.pi * (edges[0] - half), 2.0 * math.pi * (edges[1] + half)
        expected = quad(jonswap_spectrum, *omegas, args=(gamma,))[0]
        variance = density[inside].sum() * 2.0 * half
        assert variance == pytest.approx(expected, rel=0.12, abs=0.003 * HEIGHT**2 / 16.0)


def test_load_is_the_elevation_times_its_factor(make_scene: MakeScene) -> None:
    time = np.linspace(0.0, 100.0, 501)

    def ripple(**changes: Any) -> Any:
        effects = [{'load_in_waves': WAVES | changes}, STEADY]
        return make_scene(effects=effects).build().shaft.load('aft', time) - 5000.0

    base = ripple()
    np.testing.assert_allclose(ripple(significant_height=5.0), 2.0 * base, atol=1e-9)
    np.testing.assert_allclose(ripple(load_per_metre=-240.0), -2.0 * base, atol=1e-9)
    np.testing.assert_allclose(ripple(unit='kN', load_per_metre=0.12), base, atol=1e-9)
    np.testing.assert_allclose(ripple(unit='tf', load_per_metre=120.0 / 9806.65), base, atol=1e-9)
    assert np.abs(base).max() > 100.0
    assert not ripple(significant_height=0.0).any()
