# SPDX-License-Identifier: Apache-2.0
"""Every way to get a scene file wrong has a sentence that names key, value and rule."""

from __future__ import annotations

import datetime as dt
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stickslip_monitor.cli import main
from stickslip_monitor.errors import SceneError, StickslipError
from stickslip_monitor.lab.scenes.scene import Scene, load_scene

SPEED = {'speed_profile': {'unit': 'rpm', 'points': [[10, 60], [50, 20]]}}
LOAD = {'load_profile': {'unit': 'kN', 'points': [[0, 1.0]]}}
RATES: dict[str, Any] = {'speed': {'rate': 10.0}, 'load': {'rate': 4.0}}


def speed(**changes: Any) -> dict[str, Any]:
    return {'effects': [{'speed_profile': SPEED['speed_profile'] | changes}]}


def noise(**changes: Any) -> dict[str, Any]:
    return {'effects': [{'sensor_noise': changes}]}


WRONG: list[tuple[dict[str, Any], str]] = [
    ({'durations': 3}, "unknown key 'durations' = 3; did you mean 'duration'?"),
    ({'scene': None}, "not a scene file: it must begin with 'scene: stickslip_monitor/scene/1'"),
    ({'scene': 'x/2'}, "scene = 'x/2' must be 'stickslip_monitor/scene/1'"),
    *(
        ({key: None}, f"key '{key}' is missing: ")
        for key in ('description', 'duration', 'start', 'seed', 'config', 'telemetry', 'effects')
    ),
    ({'description': 3}, 'description = 3 must be a text'),
    ({'duration': 0}, 'duration = 0 must be a number [s] above 0'),
    ({'duration': -2.5}, 'duration = -2.5 must be a number [s] above 0'),
    ({'duration': '5 min'}, "duration = '5 min' must be a number [s] above 0"),
    ({'duration': float('nan')}, 'duration = nan must be'),
    ({'duration': float('inf')}, 'duration = inf must be'),
    ({'duration': True}, 'duration = True must be'),
    ({'start': 'noon'}, "start = 'noon' must be an ISO time"),
    ({'start': 1.5}, 'start = 1.5 must be an ISO time'),
    ({'start': -1}, 'start = -1 must lie'),
    ({'start': dt.datetime(1969, 12, 31, 23, 59)}, 'start = 1969-12-31T23:59:00 must lie'),
    ({'start': dt.date(2026, 5, 4)}, 'start = 2026-05-04 must be an ISO time'),
    # Beyond the largest double: Python has no float for it.
    ({'duration': 10**400}, 'must be a number [s] above 0 and not above 9.22337e+09, of a size'),
    ({'start': 9_223_372_036_854_775_807}, 'must lie, with the whole scene, between'),
    ({'seed': -1}, 'seed = -1 must be a whole number not below 0'),
    ({'seed': 1.5}, 'seed = 1.5 must be a whole number not below 0'),
    ({'telemetry': 3}, 'telemetry = 3 must be a mapping of keys'),
    ({'telemetry': {'speed': {'rate': 1}}}, "key 'telemetry.load' is missing"),
    ({'telemetry': RATES | {'torque': {}}}, "unknown key 'torque' = {} in telemetry"),
    (
        {'telemetry': RATES | {'load': {'rate': -1}}},
        'telemetry.load.rate = -1 must be a number [Hz] not below 1e-06 and not above 1000',
    ),
    ({'telemetry': RATES | {'load': {'rate': 0}}}, 'telemetry.load.rate = 0 must be'),
    # A period of 1e300 s is longer than any stamp can tell.
    ({'telemetry': RATES | {'load': {'rate': 1e-300}}}, 'telemetry.load.rate = 1e-300 must be'),
    ({'telemetry': RATES | {'load': {'hz': 1}}}, "unknown key 'hz' = 1 in telemetry.load"),
    ({'effects': {}}, 'effects = {} must be a list'),
    ({'effects': ['speed_profile']}, "effects: entry 1 = 'speed_profile' must be {name:"),
    ({'effects': [SPEED | LOAD]}, 'effects: entry 1 = '),
    (
        {'effects': [{'sped_profile': {}}]},
        "effects: entry 1 is unknown effect 'sped_profile'; did you mean 'speed_profile'?",
    ),
    (
        {'effects': [SPEED, LOAD, SPEED]},
        "effect 'speed_profile' is listed twice for topic /shaft/speed",
    ),
    (speed(unit='knots'), "speed_profile.unit = 'knots' must be one of rpm, rad/s, Hz, m/s"),
    (speed(unit='N'), "speed_profile.unit = 'N' must be one of rpm, rad/s, Hz, m/s"),
    (speed(pionts=[]), "unknown key 'pionts' = [] in speed_profile; did you mean 'points'?"),
    (speed(bearing='fwd'), "speed_profile.bearing = 'fwd' must be one of aft"),
    (
        speed(bearing='atf'),
        "speed_profile.bearing = 'atf' must be one of aft; did you mean 'aft'?",
    ),
    (speed(points=[]), 'speed_profile.points = [] must be a list of points'),
    (speed(points=[[0, 1, 2]]), 'speed_profile.points: point 1 = [0, 1, 2] must be a pair'),
    (
        speed(points=[[0, 1e308]]),
        'speed_profile.points: point 1 = [0, 1e+308] must be a pair of numbers, [time in s,'
        ' value], of a size up to 1e+15',
    ),
    (speed(points=[[0, 10**400]]), 'value], of a size up to 1e+15'),
    (speed(points=[[0, 'fast']]), "speed_profile.points: point 1 = [0, 'fast'] must be a pair"),
    (speed(points=[[0, float('nan')]]), 'point 1 = [0, nan] must be a pair of numbers'),
    (
        speed(points=[[0, 1], [9, 2], [9, 3]]),
        'speed_profile.points: point 3 is at 9 s, but times must rise and the one before is at'
        ' 9 s',
    ),
    (
        speed(points=[[0, 1], [101, 2]]),
        'speed_profile.points: point 2 is at 101 s, outside the scene, which lasts from 0 to'
        ' 100 s',
    ),
    (speed(points=[[-1, 1]]), 'point 1 is at -1 s, outside the scene'),
    ({'effects': [{'speed_profile': None}]}, 'speed_profile = None must be a mapping of keys'),
    ({'effects': [{'speed_profile': {'unit': 'rpm'}}]}, "key 'speed_profile.points' is missing"),
    ({'effects': [{'load_profile': {'points': []}}]}, "key 'load_profile.unit' is missing"),
    (noise(), 'sensor_noise must name speed, load or both'),
    (
        noise(load={'standard_deviation': -1, 'unit': 'N'}),
        'sensor_noise.load.standard_deviation = -1 must be a number [N] not below 0',
    ),
    (
        noise(load={'standard_deviation': 1, 'unit': 'rpm'}),
        "sensor_noise.load.unit = 'rpm' must be one of N, kN",
    ),
    (
        noise(load={'standard_deviation': 1e308, 'unit': 'N'}),
        'standard_deviation = 1e+308 must be a number [N] not below 0, of a size up to 1e+15',
    ),
    (noise(speed={'unit': 'rpm'}), "key 'sensor_noise.speed.standard_deviation' is missing"),
]


@pytest.mark.parametrize(('changes', 'sentence'), WRONG, ids=[text for _, text in WRONG])
def test_what_is_wrong_is_said_in_one_sentence(
    scene_path: Callable[..., Path],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    changes: dict[str, Any],
    sentence: str,
) -> None:
    path = scene_path(**changes)
    before = set(tmp_path.iterdir())
    with pytest.raises(SceneError, match=re.escape(sentence)):
        load_scene(path)
    assert main(['simulate', str(path), '-o', str(tmp_path / 'bag')]) == 2
    out, error = capsys.readouterr()
    assert out == ''
    assert error.startswith(f'ERROR: {path}: ')
    assert sentence in error
    assert error.count('\n') == 1
    assert set(tmp_path.iterdir()) == before


INPUTS: list[tuple[dict[str, Any], str]] = [
    (
        {'aft': {'speed': {'type': 'sensor_msgs/msg/JointState', 'field': 'velocity[0]'}}},
        'aft.speed is of type sensor_msgs/msg/JointState in the configuration: a scene can write'
        ' std_msgs/msg/Float64, geometry_msgs/msg/TwistStamped, geometry_msgs/msg/WrenchStamped'
        ' only',
    ),
    (
        {'aft': {'load': {'type': 'geometry_msgs/msg/WrenchStamped', 'field': 'header.seq'}}},
        "aft.load is field 'header.seq' of geometry_msgs/msg/WrenchStamped in the configuration: a"
        ' scene can write wrench.force.x, wrench.force.y,',
    ),
    (
        {
            'aft': {
                'load': {'type': 'geometry_msgs/msg/WrenchStamped', 'field': 'wrench.force.z'}
            },
            'fwd': {'speed': {'topic': '/fwd'}},
        },
        'topic /bearing/aft/load serves aft and fwd with different types or fields: they must',
    ),
    (
        {'aft': {'load': {'topic': '/shaft/speed'}}},
        'topic /shaft/speed serves aft and aft, as speed and as load: use two topics',
    ),
    (
        {'aft': {}, 'fwd': {'speed': {'scale': 2.0}, 'load': {'topic': '/fwd'}}},
        'topic /shaft/speed serves aft and fwd with different units, scales or offsets',
    ),
    (
        {'aft': {}, 'fwd': {'speed': {'unit': 'Hz'}, 'load': {'topic': '/fwd'}}},
        'topic /shaft/speed serves aft and fwd with different units, scales or offsets',
    ),
]


@pytest.mark.parametrize(('bearings', 'sentence'), INPUTS)
def test_inputs_that_cannot_be_simulated_are_named(
    make_scene: Callable[..., Scene], bearings: dict[str, Any], sentence: str
) -> None:
    with pytest.raises(SceneError, match=re.escape(sentence)):
        make_scene(bearings)


def test_rates_of_a_shared_topic_must_agree(make_scene: Callable[..., Scene]) -> None:
    two: dict[str, Any] = {'aft': {}, 'fwd': {'load': {'topic': '/fwd'}}}
    rates = {'aft': RATES, 'fwd': RATES | {'speed': {'rate': 5}}}
    with pytest.raises(SceneError, match='its rate cannot be both 10 and 5 Hz'):
        make_scene(two, telemetry=rates)
    with pytest.raises(SceneError, match=r"key 'telemetry\.fwd' is missing: the rates of"):
        make_scene(two, telemetry={'aft': RATES})


def test_surface_speed_of_journals_that_differ_is_refused(
    make_scene: Callable[..., Scene],
) -> None:
    two: dict[str, Any] = {'aft': {}, 'fwd': {'journal_diameter': 0.2, 'load': {'topic': '/fwd'}}}
    assert len(make_scene(two).channels) == 3
    with pytest.raises(SceneError, match='unit m/s says nothing about topic /shaft/speed'):
        make_scene(two, **speed(unit='m/s'))


@pytest.mark.parametrize('text', ['scene: [', 'a: 1\na: 2\n', '', '3', '[]'])
def test_what_is_no_scene_is_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / 'scene.yaml'
    path.write_text(text, 'utf-8')
    with pytest.raises(SceneError, match=re.escape(str(path))):
        load_scene(path)


def test_missing_files_are_named(tmp_path: Path, scene_path: Callable[..., Path]) -> None:
    with pytest.raises(SceneError, match=r'none\.yaml: No such file'):
        load_scene(tmp_path / 'none.yaml')
    with pytest.raises(StickslipError, match=r'other\.yaml: No such file'):
        load_scene(scene_path(config='other.yaml'))


NOON_NS = 1_777_896_000 * 10**9


@pytest.mark.parametrize(
    'start',
    [
        NOON_NS,
        '2026-05-04T12:00:00Z',
        '2026-05-04T14:00:00+02:00',
        '2026-05-04 12:00:00',
        dt.datetime(2026, 5, 4, 12),
        dt.datetime(2026, 5, 4, 12, tzinfo=dt.timezone.utc),
    ],
)
def test_start_is_a_time_or_nanoseconds(make_scene: Callable[..., Scene], start: Any) -> None:
    assert make_scene(start=start).start_ns == NOON_NS


def test_both_ways_to_list_an_effect_are_one(make_scene: Callable[..., Scene]) -> None:
    flat = [{'effect': 'speed_profile'} | SPEED['speed_profile']]
    time = np.linspace(0.0, 100.0, 7)
    same, nested = (make_scene(effects=e).build().shaft for e in (flat, [SPEED]))
    assert same.speed('aft', time).tolist() == nested.speed('aft', time).tolist()
    assert same.speed('aft', time).any()
