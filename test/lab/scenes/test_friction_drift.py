# SPDX-License-Identifier: Apache-2.0
"""Friction that moves in time: the law at each instant, and what the lining makes of it."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from stickslip_monitor.errors import SceneError
from stickslip_monitor.lab.scenes.friction_course import (
    FrictionCourse,
    parameters_of,
    with_parameters,
)
from stickslip_monitor.lab.scenes.profile import Profile
from stickslip_monitor.lab.scenes.scene import Scene, simulate
from stickslip_monitor.physics.friction import Coulomb, Stribeck, Tabulated

Make = Callable[..., Scene]
SPEEDS = np.linspace(-0.5, 0.5, 11)


def drift(parameter: str, points: list[list[float]], **more: Any) -> dict[str, Any]:
    return {'friction_drift': {'parameter': parameter, 'points': points} | more}


def still(rpm: float) -> list[dict[str, Any]]:
    return [
        {'speed_profile': {'unit': 'rpm', 'points': [[0, 0], [1, rpm]]}},
        {'load_profile': {'unit': 'N', 'points': [[0, 1000]]}},
    ]


LINING = {'lining_motion': {'disturbance': {'standard_deviation': 0.0, 'unit': 'N'}}}


@pytest.mark.parametrize(
    'law',
    [
        Stribeck(0.3, 0.1, 10.0, 0.02),
        Coulomb(0.3, 0.1),
        Tabulated([0.0, 0.1, 0.3], [0.3, 0.2, 0.1]),
    ],
)
def test_the_factor_multiplies_the_whole_coefficient(law: Any) -> None:
    scaled = with_parameters(law, {'factor': 1.3})
    assert type(scaled) is type(law)
    assert scaled.static == pytest.approx(1.3 * law.static)
    assert scaled.coefficient(SPEEDS) == pytest.approx(1.3 * law.coefficient(SPEEDS))
    assert scaled.slope(SPEEDS) == pytest.approx(1.3 * law.slope(SPEEDS))


def test_what_may_move_is_what_the_law_has() -> None:
    assert parameters_of(Stribeck(0.3, 0.1, 10.0)) == (
        'static', 'kinetic', 'decay', 'viscous', 'factor',
    )  # fmt: skip
    assert parameters_of(Coulomb(0.3, 0.1)) == ('static', 'kinetic', 'factor')
    assert parameters_of(Tabulated([0.0, 1.0], [0.3, 0.1])) == ('factor',)


def test_the_law_moves_in_steps_of_a_second() -> None:
    course = FrictionCourse(
        Stribeck(0.3, 0.1, 10.0),
        {
            'kinetic': Profile.of([(10.0, 0.1), (20.0, 0.2)]),
            'factor': Profile.of([(0.0, 2.0)]),
        },
    )
    for time, kinetic in ((0.0, 0.1), (10.0, 0.1), (15.0, 0.15), (15.99, 0.15), (30.0, 0.2)):
        law = course.at(time)
        assert isinstance(law, Stribeck)
        assert law.kinetic == pytest.approx(2.0 * kinetic)
        assert (law.static, law.decay) == (0.6, 10.0)


def test_stick_slip_dies_where_kinetic_friction_has_risen_enough(make_scene: Make) -> None:
    """At 20 rpm and 1000 N: at mu_k = 0.2003 by the averages; 0.005 a second from 0.18 on."""
    listed = [*still(20.0), LINING, drift('kinetic', [[0, 0.1], [2, 0.18], [10, 0.22]])]
    scene = make_scene(effects=listed, duration=10.0)
    (last,) = [
        (event['time'] - scene.start_ns) / 1e9
        for block in simulate(scene)
        for column in block.truth
        if column.topic == '/truth/aft/events'
        for event in map(json.loads, column.values)
        if event['event'] == 'last_stick'
    ][-1:]
    assert 0.18 + 0.005 * (last - 2.0) == pytest.approx(0.2003, abs=0.006)


def test_a_factor_does_what_the_load_does(make_scene: Make) -> None:
    """Friction is load times coefficient: 1.25 times either gives the same sticks."""
    loaded = [still(20.0)[0], {'load_profile': {'unit': 'N', 'points': [[0, 1250]]}}, LINING]
    drifted = [*still(20.0), LINING, drift('factor', [[0, 1.25]])]
    sticks = [
        np.concatenate(
            [c.time for b in simulate(make_scene(effects=listed, duration=4.0)) for c in b.truth
             if c.topic == '/truth/aft/stick']
        )
        for listed in (loaded, drifted)
    ]  # fmt: skip
    assert sticks[0].size > 50
    assert sticks[1] == pytest.approx(sticks[0], abs=1e-9)


def test_the_true_margins_follow_the_friction_there_is(make_scene: Make) -> None:
    """With beta halved and the drop doubled ``v_H = -ln(kappa)`` stays, and ``V_H`` doubles."""
    listed = [
        *still(60.0),
        {'operating_point': {'rate': 2.0}},
        drift('decay', [[4, 10], [5, 5]]),
        drift('static', [[4, 0.3], [5, 0.5]]),
    ]
    scene = make_scene(effects=listed, duration=10.0)
    found: dict[str, list[float]] = {}
    for block in simulate(scene, 3.3):
        for column in block.truth:
            found.setdefault(column.topic.rpartition('/')[2], []).extend(column.values)
    assert {len(values) for values in found.values()} == {21}
    hopf, fold = 30.7380, 40.7231
    assert np.array(found['hopf_margin'])[[4, 12, 20]] == pytest.approx(
        [60 / hopf - 1, 60 / (2 * hopf) - 1, 60 / (2 * hopf) - 1], rel=1e-4
    )
    assert np.array(found['fold_margin'])[[4, 12, 20]] == pytest.approx(
        [60 / fold - 1, 60 / (2 * fold) - 1, 60 / (2 * fold) - 1], rel=1e-4
    )
    assert found['speed'][20] == pytest.approx(60 * np.pi * 0.1 / 60)
    assert found['load'][20] == 1000.0


def test_the_true_margins_see_a_factor_as_a_load(make_scene: Make) -> None:
    """1.25 times the friction at 1000 N has the margins of 1250 N."""
    found = []
    for load, factor in ((1250.0, 1.0), (1000.0, 1.25)):
        listed = [
            still(45.0)[0],
            {'load_profile': {'unit': 'N', 'points': [[0, load]]}},
            {'operating_point': {'rate': 1.0}},
            drift('factor', [[0, 1.0], [1, 1.0], [2, factor]]),
        ]
        (block,) = simulate(make_scene(effects=listed, duration=5.0))
        found.append({c.topic: np.array(c.values)[3:] for c in block.truth if 'margin' in c.topic})
    assert len(found[0]) == 2
    for topic, margins in found[0].items():
        assert found[1][topic] == pytest.approx(margins, abs=2e-9)


def test_only_the_lining_feels_it(make_scene: Make) -> None:
    """Telemetry is the same with and without."""
    noise = {'sensor_noise': {'speed': {'standard_deviation': 0.1, 'unit': 'rpm'}}}
    (plain,) = simulate(make_scene(effects=[*still(40.0), noise], duration=20.0))
    more = [*still(40.0), noise, LINING, drift('factor', [[0, 1.3]])]
    (drifted,) = simulate(make_scene(effects=more, duration=20.0))
    for topic, signal in plain.signals.items():
        assert np.array_equal(signal.value, drifted.signals[topic].value)
    assert plain.truth == []


BAD = {
    "friction_drift.parameter = 'mass' must be one of static, kinetic, decay, viscous, factor":
        [drift('mass', [[0, 1]])],
    'friction_drift: static = -0.1 at 5 s must not be negative':
        [drift('static', [[0, 0.3], [5, -0.1]])],
    'friction_drift at 5 s: decay = 0': [drift('decay', [[0, 10], [5, 0]])],
    "effect 'friction_drift' with static is listed twice for bearing aft":
        [drift('static', [[0, 0.3]]), drift('static', [[0, 0.3]])],
    'friction_drift.points: point 2 is at 1 s, but times must rise':
        [drift('static', [[2, 0.3], [1, 0.3]])],
    'friction_drift has points and a table: give one of them':
        [drift('static', [[2, 0.3]], table='x.csv')],
    'operating_point.rate = 0 must be a number [Hz] above 0': [{'operating_point': {'rate': 0}}],
}  # fmt: skip


@pytest.mark.parametrize('words', BAD)
def test_wrong_settings_are_named(make_scene: Make, words: str) -> None:
    with pytest.raises(SceneError) as caught:
        make_scene(effects=[*still(60.0), *BAD[words]])
    assert words in str(caught.value)
