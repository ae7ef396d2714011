# SPDX-License-Identifier: Apache-2.0
"""Ripple follows the angle of the shaft, in closed form while the speed is linear in time."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from stickslip_monitor.errors import SceneError
from stickslip_monitor.lab.scenes.scene import Scene

MakeScene = Callable[..., Scene]
RPM = math.pi * 0.1 / 60.0
TIME = np.linspace(0.0, 100.0, 2001)
# From 90 rpm ahead through zero to 30 rpm astern.
RAMP = {'speed_profile': {'unit': 'rpm', 'points': [[0, 90], [100, -30]]}}
SPEED = 90.0 - 1.2 * TIME
ANGLE = 2.0 * math.pi / 60.0 * (90.0 * TIME - 0.6 * TIME**2)
BLADES = {'blade_ripple': {'blades': 4, 'amplitude': 0.02}}
BENT = {'misalignment': {'amplitude': 40.0, 'unit': 'N'}}
STEADY = {'load_profile': {'unit': 'N', 'points': [[0, 1000]]}}


def test_speed_ripples_at_the_blade_rate(make_scene: MakeScene) -> None:
    shaft = make_scene(effects=[BLADES, RAMP]).build().shaft
    expected = SPEED * (1.0 + 0.02 * np.cos(4.0 * ANGLE))
    np.testing.assert_allclose(shaft.speed('aft', TIME) / RPM, expected, atol=1e-9)


def test_load_ripples_once_a_turn(make_scene: MakeScene) -> None:
    """The ripple of the speed does not turn the shaft."""
    for effects in ([BENT, STEADY, RAMP], [STEADY, BLADES, RAMP, BENT]):
        shaft = make_scene(effects=effects).build().shaft
        expected = 1000.0 + 40.0 * np.cos(ANGLE)
        np.testing.assert_allclose(shaft.load('aft', TIME), expected, atol=1e-8)


def test_phase_follows_every_effect_that_turns_the_shaft(make_scene: MakeScene) -> None:
    steps = {'speed_steps': {'unit': 'rpm', 'steps': [[0, 0], [50, 60]], 'rise': 10.0}}
    shaft = make_scene(effects=[STEADY, RAMP, steps, BENT]).build().shaft
    # The steps add one turn a second from 60 s, and five turns until then.
    extra = 2.0 * math.pi * np.where(TIME >= 60.0, TIME - 55.0, 0.05 * (TIME - 50.0) ** 2)
    angle = ANGLE + np.where(TIME >= 50.0, extra, 0.0)
    expected = 1000.0 + 40.0 * np.cos(angle)
    np.testing.assert_allclose(shaft.load('aft', TIME), expected, atol=1e-7)


def test_ripple_of_a_shaft_at_rest_stands_still(make_scene: MakeScene) -> None:
    shaft = make_scene(effects=[STEADY, BLADES, BENT]).build().shaft
    assert not shaft.speed('aft', TIME).any()
    assert shaft.load('aft', TIME).tolist() == [1040.0] * TIME.size


@pytest.mark.parametrize(
    ('effect', 'sentence'),
    [
        ({'blade_ripple': {'blades': 4.5, 'amplitude': 0}}, 'blades = 4.5 must be a whole number'),
        ({'blade_ripple': {'blades': 0, 'amplitude': 0}}, 'blades = 0 must be a whole number fro'),
        (
            {'blade_ripple': {'blades': 4, 'amplitude': 2}},
            'blade_ripple.amplitude = 2 must be a number [-] not below 0 and not above 1',
        ),
        (
            {'misalignment': {'amplitude': -4, 'unit': 'N'}},
            'misalignment.amplitude = -4 must be a number [N] not below 0',
        ),
    ],
)
def test_wrong_ripple_is_named(
    make_scene: MakeScene, effect: dict[str, Any], sentence: str
) -> None:
    with pytest.raises(SceneError, match=re.escape(sentence)):
        make_scene(effects=[effect])
