# SPDX-License-Identifier: Apache-2.0
"""Signals against closed forms; random streams that do not depend on each other."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from stickslip_monitor.lab.scenes import variation
from stickslip_monitor.lab.scenes.scene import Scene, simulate

SPEED = {'speed_profile': {'unit': 'rpm', 'points': [[10, 60], [50, 20]]}}
LOAD = {'load_profile': {'unit': 'kN', 'points': [[0, 1.0]]}}
START = 1_700_000_000_000_000_000
NOISE = {
    'speed': {'standard_deviation': 0.1, 'unit': 'rpm'},
    'load': {'standard_deviation': 0.005, 'unit': 'kN'},
}
SURFACE = math.pi * 0.1 / 60.0  # m/s of one rpm
Columns = dict[str, tuple[NDArray[np.int64], NDArray[np.float64]]]


def run(scene: Scene, *block_length: float) -> Columns:
    """Stamps and raw numbers of each topic."""
    blocks = list(simulate(scene, *block_length))
    return {
        c.topic: (
            np.concatenate([b.signals[c.topic].stamp_ns for b in blocks]),
            np.concatenate([b.signals[c.topic].raw for b in blocks]),
        )
        for c in scene.channels
    }


def test_profile_is_linear_between_points_and_held_beyond(
    make_scene: Callable[..., Scene],
) -> None:
    columns = run(make_scene())
    stamps, speed = columns['/shaft/speed']
    time = np.arange(1001) / 10.0
    assert stamps.tolist() == [START + k * 100_000_000 for k in range(1001)]
    expected = np.clip(60.0 - (time - 10.0), 20.0, 60.0)  # one rpm a second from 10 s to 50 s
    np.testing.assert_allclose(speed, expected, rtol=1e-14)
    stamps, load = columns['/bearing/aft/load']
    assert stamps.tolist() == [START + k * 250_000_000 for k in range(401)]
    np.testing.assert_allclose(load, 1000.0, rtol=1e-15)


@pytest.mark.parametrize(
    ('unit', 'rpm'), [('rpm', 1.0), ('rad/s', 30.0 / math.pi), ('Hz', 60.0), ('m/s', 1 / SURFACE)]
)
def test_profile_takes_every_unit(make_scene: Callable[..., Scene], unit: str, rpm: float) -> None:
    effect = {'speed_profile': {'unit': unit, 'points': [[0, 3.0]]}}
    _, speed = run(make_scene(effects=[effect]))['/shaft/speed']
    np.testing.assert_allclose(speed, 3.0 * rpm, rtol=1e-14)


def test_raw_numbers_are_what_the_sensor_sends(make_scene: Callable[..., Scene]) -> None:
    """A 4 to 20 mA load cell of 0 to 5 kN; a tachometer with 60 pulses a turn."""
    own = {
        'speed': {'unit': 'Hz', 'scale': 1.0 / 60.0},
        'load': {'unit': 'kN', 'scale': 5.0 / 16.0, 'offset': -1.25},
    }
    columns = run(make_scene({'aft': own}))
    np.testing.assert_allclose(columns['/shaft/speed'][1][0], 60.0, rtol=1e-14)  # 1 Hz, 60 pulses
    np.testing.assert_allclose(columns['/bearing/aft/load'][1], 4.0 + 16.0 / 5.0, rtol=1e-14)


def test_signals_without_effects_are_zero(make_scene: Callable[..., Scene]) -> None:
    assert all(not value.any() for _, value in run(make_scene(effects=[])).values())


@pytest.mark.parametrize(
    ('duration', 'rate', 'count'),
    [(1.0, 10.0, 11), (0.95, 10.0, 10), (0.3, 10.0, 4), (0.01, 1.0, 1), (600.0, 0.3, 181)],
)
@pytest.mark.parametrize('block_length', [60.0, 0.1, 7.3])
def test_every_instant_is_sampled_once(
    make_scene: Callable[..., Scene],
    duration: float,
    rate: float,
    count: int,
    block_length: float,
) -> None:
    rates = {'speed': {'rate': rate}, 'load': {'rate': rate}}
    scene = make_scene(duration=duration, telemetry=rates, effects=[])
    assert scene.message_count == 2 * count
    for stamps, _ in run(scene, block_length).values():
        expected = START + np.rint(np.arange(count) / rate * 1e9)
        assert stamps.size == count
        np.testing.assert_allclose(stamps - START, expected - START, atol=1.0)


def test_noise_has_the_stated_deviation_and_is_white(make_scene: Callable[..., Scene]) -> None:
    n = 50_000
    rates = {'speed': {'rate': 500.0}, 'load': {'rate': 500.0}}
    columns = run(make_scene(telemetry=rates, effects=[{'sensor_noise': NOISE}]))
    for topic, deviation in (('/shaft/speed', 0.1), ('/bearing/aft/load', 5.0)):
        noise = columns[topic][1] / deviation
        # Five standard errors of mean, deviation, kurtosis and autocorrelation.
        assert abs(noise.mean()) < 5.0 / math.sqrt(n)
        assert abs(noise.std() - 1.0) < 5.0 / math.sqrt(2 * n)
        assert abs((noise**4).mean() - 3.0) < 5.0 * math.sqrt(96.0 / n)
        assert abs((noise[1:] * noise[:-1]).mean()) < 5.0 / math.sqrt(n)
    pair = np.corrcoef(columns['/shaft/speed'][1], columns['/bearing/aft/load'][1])[0, 1]
    assert abs(pair) < 5.0 / math.sqrt(n)


def test_noise_does_not_depend_on_the_rest_of_the_scene(make_scene: Callable[..., Scene]) -> None:
    alone = run(make_scene(effects=[{'sensor_noise': NOISE}]))
    mixed = run(make_scene(effects=[LOAD, {'sensor_noise': NOISE}, SPEED]))
    clean = run(make_scene())
    only_load = run(make_scene(effects=[{'sensor_noise': {'load': NOISE['load']}}]))
    for topic in alone:
        np.testing.assert_allclose(mixed[topic][1] - clean[topic][1], alone[topic][1], atol=1e-11)
    load = '/bearing/aft/load'
    assert only_load[load][1].tolist() == alone[load][1].tolist()
    assert not only_load['/shaft/speed'][1].any()


def test_seed_changes_the_noise_and_nothing_else_does(make_scene: Callable[..., Scene]) -> None:
    scene = make_scene(effects=[SPEED, LOAD, {'sensor_noise': NOISE}])
    again, other = run(scene), run(replace(scene, seed=8))
    for blocks in (60.0, 7.3, 1000.0):
        columns = run(scene, blocks)
        assert all(columns[t][1].tolist() == again[t][1].tolist() for t in columns)
    assert all(not np.any(other[t][1] == again[t][1]) for t in other)


def test_streams_differ_by_name_and_seed() -> None:
    names = [('a', 'b'), ('a', 'c'), ('ab',), ('a',), ('b', 'a')]
    first = [variation.random_stream(seed, *n).random() for seed in (1, 2) for n in names]
    assert len(set(first)) == 2 * len(names)
    assert variation.random_stream(1, 'a', 'b').random() == first[0]


def test_effect_that_is_not_listed_draws_nothing(
    make_scene: Callable[..., Scene], monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: Any) -> None:
        raise AssertionError('a random stream was made')

    monkeypatch.setattr(np.random, 'Generator', refuse)
    run(make_scene())


def test_bearings_of_one_shaft_share_its_speed(make_scene: Callable[..., Scene]) -> None:
    two = {'aft': {}, 'fwd': {'journal_diameter': 0.2, 'load': {'topic': '/fwd', 'unit': 'kN'}}}
    fwd = {'effect': 'load_profile', 'bearing': 'fwd', 'unit': 'N', 'points': [[0, 500]]}
    aft = {'effect': 'load_profile', 'bearing': 'aft', 'unit': 'N', 'points': [[0, 900]]}
    columns = run(make_scene(two, effects=[SPEED, fwd, aft]))
    assert list(columns) == ['/shaft/speed', '/bearing/aft/load', '/fwd']
    assert columns['/shaft/speed'][1][0] == pytest.approx(60.0, rel=1e-14)
    np.testing.assert_allclose(columns['/bearing/aft/load'][1], 900.0, rtol=1e-14)
    np.testing.assert_allclose(columns['/fwd'][1], 0.5, rtol=1e-14)


def test_memory_does_not_grow_with_duration(
    make_scene: Callable[..., Scene], peak_memory: Callable[[Scene, float], int]
) -> None:
    scene = make_scene(effects=[SPEED, LOAD, {'sensor_noise': NOISE}])

    peak_memory(scene, 600.0)
    assert peak_memory(scene, 86_400.0) < 1.5 * peak_memory(scene, 3_600.0)
