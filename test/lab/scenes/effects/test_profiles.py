# SPDX-License-Identifier: Apache-2.0
"""Tables, steps and telegraph orders: against formulas, and against a solver of the lag."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from stickslip_monitor.errors import SceneError
from stickslip_monitor.lab.scenes.scene import Scene

RPM = math.pi * 0.1 / 60.0  # m/s of one rpm
TIME = np.linspace(0.0, 100.0, 401)
MakeScene = Callable[..., Scene]
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


@pytest.mark.parametrize(
    ('text', 'sentence'),
    [
        (
            'time,value\n0,1\n5,2\n\n5,3\n',
            ' line 5 is at 5 s, but times must rise and the one befo',
        ),
        (
            'time,value\n0,1\n4,2\n3,3\n',
            ' line 4 is at 3 s, but times must rise and the one before',
        ),
        (
            'time,value\n0,1\n101,2\n',
            ' line 3 is at 101 s, outside the scene, which lasts from 0 t',
        ),
        ('time,value\n0,fast\n', " line 2 = '0,fast' must be two numbers: time in s, value"),
        ('time,value\n0,1,2\n', " line 2 = '0,1,2' must be two numbers"),
        ('time,value\n0,nan\n', ' line 2 = [0.0, nan] must be a pair of numbers'),
        ('time,value\n', ' has no rows'),
        ('', " must begin with a line 'time,value'"),
        ('t,rpm\n0,1\n', " must begin with a line 'time,value'"),
        (b'\xff\xfe\x00', ' cannot be read: it is not UTF-8 text'),
        (None, ' cannot be read: No such file or directory'),
    ],
)
def test_wrong_table_is_named_with_its_line(
    make_scene: MakeScene, tmp_path: Path, text: str | bytes | None, sentence: str
) -> None:
    path = tmp_path / 'speeds.csv'
    if text is not None:
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(SceneError, match=re.escape(f"table '{path}'{sentence}")):
        speed_of(make_scene, {'speed_profile': {'unit': 'rpm', 'table': 'speeds.csv'}})


def test_points_and_table_are_one_too_many(make_scene: MakeScene) -> None:
    both = {'unit': 'rpm', 'table': 'speeds.csv', 'points': [[0, 1]]}
    with pytest.raises(SceneError, match='speed_profile has points and a table: give one of'):
        speed_of(make_scene, {'speed_profile': both})


def test_steps_go_from_level_to_level_in_the_rise(make_scene: MakeScene) -> None:
    steps = {'unit': 'rpm', 'steps': [[5, 50], [20, 40], [24, 10], [80, -30]], 'rise': 4.0}
    found = speed_of(make_scene, {'speed_steps': steps})
    expected = (
        50.0
        - 10.0 * np.clip((TIME - 20.0) / 4.0, 0.0, 1.0)
        - 30.0 * np.clip((TIME - 24.0) / 4.0, 0.0, 1.0)
        - 40.0 * np.clip((TIME - 80.0) / 4.0, 0.0, 1.0)
    )
    np.testing.assert_allclose(found, expected, atol=1e-12)
    load = {'load_steps': steps | {'unit': 'N', 'steps': [[0, 900], [50, 1300]]}}
    shaft = make_scene(effects=[load]).build().shaft
    expected = 900.0 + 400.0 * np.clip((TIME - 50.0) / 4.0, 0.0, 1.0)
    np.testing.assert_allclose(shaft.load('aft', TIME), expected, rtol=1e-13)


@pytest.mark.parametrize(
    ('changes', 'sentence'),
    [
        (
            {'steps': [[0, 1], [10, 2], [13, 3]]},
            'speed_steps.steps: step 3 is at 13 s, but the one before takes until 14 s',
        ),
        ({'steps': [[0, 1], [0, 2]]}, 'speed_steps.steps: step 2 is at 0 s, but times must rise'),
        (
            {'steps': []},
            'speed_steps.steps = [] must be a list of steps [time in s, value in rpm]',
        ),
        ({'rise': 0}, 'speed_steps.rise = 0 must be a number [s] above 0'),
    ],
)
def test_wrong_steps_are_named(
    make_scene: MakeScene, changes: dict[str, Any], sentence: str
) -> None:
    steps = {'unit': 'rpm', 'steps': [[0, 10]], 'rise': 4.0} | changes
    with pytest.raises(SceneError, match=re.escape(sentence)):
        speed_of(make_scene, {'speed_steps': steps})


def test_shaft_follows_the_telegraph_with_a_lag(make_scene: MakeScene) -> None:
    """Against a solver of the lag's equation, started anew at each order."""
    shaft = make_scene(effects=[{'manoeuvre': ORDERS}]).build().shaft
    targets = [(10.0, 60.0), (20.0, 0.0), (45.0, -70.0), (70.0, 20.0), (100.0, 0.0)]
    time, state = 0.0, [60.0, 0.0]
    speeds, ways = [], []
    for (_, target), (until, _) in zip([(0.0, 60.0), *targets], targets, strict=False):
        at = TIME[(time <= TIME) & (until > TIME)]
        solved = solve_ivp(
            lambda _, y, goal=target: [(goal - y[0]) / 8.0, y[0]],
            (time, until),
            state,
            t_eval=[*at, until],
            rtol=1e-11,
            atol=1e-11,
        )
        time, state = until, solved.y[:, -1].tolist()
        speeds += solved.y[0, :-1].tolist()
        ways += solved.y[1, :-1].tolist()
    count = len(speeds)
    assert count == TIME.size - 1
    np.testing.assert_allclose(shaft.speed('aft', TIME)[:count] / RPM, speeds, atol=1e-7)
    np.testing.assert_allclose(shaft.turns('aft', TIME)[:count] * 60.0, ways, atol=1e-5)


def test_first_order_holds_from_long_before(make_scene: MakeScene) -> None:
    shaft = make_scene(effects=[{'manoeuvre': ORDERS}]).build().shaft
    before = np.array([-1e5, -1.0, 0.0, 9.9])
    np.testing.assert_allclose(shaft.speed('aft', before), 60.0 * RPM, rtol=1e-14)
    np.testing.assert_allclose(shaft.turns('aft', before), before, rtol=1e-12)


@pytest.mark.parametrize(
    ('changes', 'sentence'),
    [
        (
            {'orders': [[0, 'full speed']]},
            "manoeuvre.orders: order 1 is 'full speed', which has no speed in this scene; did you"
            " mean 'full ",
        ),
        (
            {'orders': [[0, 'stop'], [5, 'slow ahead']]},
            "order 2 is 'slow ahead', which has no speed in this scene",
        ),
        ({'orders': [[5, 'stop'], [5, 'stop']]}, 'order 2 is at 5 s, but times must rise'),
        ({'orders': [[101, 'stop']]}, 'order 1 is at 101 s, outside the scene'),
        ({'orders': [['now', 'stop']]}, "order 1 is at 'now', which is no time in s"),
        (
            {'orders': [[0, False]]},
            'order 1 is False, which has no speed in this scene; there are:',
        ),
        ({'orders': [[0, ['stop']]]}, "order 1 is ['stop'], which has no speed in this scene"),
        ({'orders': ['stop']}, "order 1 = 'stop' must be a pair, [time in s, 'slow ahead']"),
        ({'orders': []}, 'manoeuvre.orders = [] must be a list of orders'),
        (
            {'ahead': {'slow': 40, 'half': 40}},
            'manoeuvre.ahead.half = 40 must be a number [rpm] above 40',
        ),
        ({'astern': {'full': -70}}, 'manoeuvre.astern.full = -70 must be a number [rpm] above 0'),
        ({'astern': {'ful': 7}}, "unknown key 'ful' = 7 in manoeuvre.astern; did you mean 'full'"),
        ({'time_constant': 0}, 'manoeuvre.time_constant = 0 must be a number [s] above 0'),
    ],
)
def test_wrong_orders_are_named(
    make_scene: MakeScene, changes: dict[str, Any], sentence: str
) -> None:
    with pytest.raises(SceneError, match=re.escape(sentence)):
        speed_of(make_scene, {'manoeuvre': ORDERS | changes})


@pytest.mark.parametrize(
    ('bearings', 'effect', 'sentence'),
    [
        (
            {'aft': {'speed': {'maximum': 0.5}}},
            {'speed_profile': {'unit': 'm/s', 'points': [[0, 0.4], [40, 0.6]]}},
            'speed = 0.505 m/s at 21 s is more than topic /shaft/speed can carry:'
            ' aft.speed.maximum = 0.5 m/s in the configuration',
        ),
        (
            {
                'aft': {'speed': {'maximum': 1.0}},
                'fwd': {
                    'journal_diameter': 0.2,
                    'speed': {'maximum': 1.0},
                    'load': {'topic': '/fwd'},
                },
            },
            {'speed_profile': {'unit': 'rpm', 'points': [[0, 90], [40, 130]]}},
            'speed = 1.00531 m/s at 6 s is more than topic /shaft/speed can carry:'
            ' fwd.speed.maximum = 1 m/s in the configuration',
        ),
        (
            {'aft': {'load': {'maximum': 900.0}}},
            {'load_profile': {'unit': 'kN', 'points': [[0, 1]]}},
            'load = 1000 N at 0 s is more than topic /bearing/aft/load can carry:'
            ' aft.load.maximum = 900 N in the configuration',
        ),
    ],
)
def test_what_the_telemetry_cannot_carry_is_refused(
    make_scene: MakeScene,
    messages_of: Callable[..., Any],
    bearings: dict[str, Any],
    effect: dict[str, Any],
    sentence: str,
) -> None:
    rates = {'speed': {'rate': 1.0}, 'load': {'rate': 1.0}}
    scene = make_scene(bearings, effects=[effect], telemetry=rates)
    with pytest.raises(SceneError, match=re.escape(sentence)):
        messages_of(scene, 7.0)
