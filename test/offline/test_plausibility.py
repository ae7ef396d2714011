# SPDX-License-Identifier: Apache-2.0
"""Questions about inputs whose numbers look like another unit, scale or topic.

For the reference bearing at 1000 N the fold is at 40.72 rpm, 0.2132 m/s; loads below 200 N have no
boundary.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stickslip_monitor.monitor.assessment import assess
from stickslip_monitor.monitor.config import BearingConfig
from stickslip_monitor.monitor.config_file import load_config
from stickslip_monitor.offline.input_check import Plausibility
from stickslip_monitor.physics.friction import Stribeck

CONFIG = (load_config(Path(__file__).parents[2] / 'launch_configs' / 'reference_bearing.yaml')).bearings[0]
FOLD = 0.2132


def asked(speed: list[float], load: list[float], config: BearingConfig = CONFIG) -> dict[str, list[str]]:
    seen = Plausibility(config)
    # In two parts: what is said of a recording does not depend on how it is cut.
    for part in (slice(1), slice(1, None)):
        seen.take(assess(config.bearing, np.array(speed[part]), np.array(load[part])))
    return seen.questions()


@pytest.mark.parametrize(
    ('speed', 'load'),
    [
        ([0.1, 0.3, 1.0], [1000.0] * 3),
        # Half way there is enough, and a shaft at rest says nothing.
        ([0.0, 4.9 * FOLD], [1000.0] * 2),
        ([0.0, 0.0], [1000.0] * 2),
        ([FOLD / 4.9, FOLD / 50.0], [1000.0] * 2),
        # A load of 5 times 41 N has a boundary.
        ([0.3], [41.0]),
        ([0.3, 0.3], [-5.0, 1000.0]),
        ([], []),
    ],
)
def test_what_can_be_is_not_asked_about(speed: list[float], load: list[float]) -> None:
    assert asked(speed, load) == {'speed': [], 'load': []}


@pytest.mark.parametrize(
    ('speed', 'load', 'quantity', 'words'),
    [
        ([0.1, -31.0], [1000.0] * 2, 'speed', 'reaches 31 m/s at the surface'),
        ([5.1 * FOLD, 2.0], [1000.0] * 2, 'speed', 'is never below 5.1 times the fold speed'),
        ([FOLD / 10.0], [1000.0], 'speed', 'is never above 0.1 times the fold speed'),
        ([0.3], [39.0], 'speed', 'has no boundary at any load up to 5 times the largest seen, 39'),
        ([0.1] * 3, [-900.0, -800.0, 100.0], 'load', 'is negative for most of the time'),
    ],
)
def test_what_cannot_be_is_asked_about(
    speed: list[float], load: list[float], quantity: str, words: str
) -> None:
    found = asked(speed, load)
    (question,) = found.pop(quantity)
    assert question.startswith(words)
    assert question.endswith('?')
    assert not any(found.values())


def test_a_shaft_a_hundred_metres_thick() -> None:
    thick = replace(CONFIG, bearing=replace(CONFIG.bearing, journal_diameter=100.0))
    assert asked([0.2], [1000.0], thick)['speed'] == [
        'turns a journal of 100 m: is journal_diameter in metres?'
    ]


def test_friction_that_rises_from_rest_is_asked_about() -> None:
    swapped = replace(CONFIG, bearing=replace(CONFIG.bearing, friction=Stribeck(0.1, 0.3, 10.0)))
    (question,) = asked([0.2], [1000.0], swapped)['speed']
    assert question.endswith('are static and kinetic swapped?')


def test_a_load_of_exactly_nothing_under_a_turning_shaft() -> None:
    assert asked([0.2, 0.2, 0.3], [0.0, 0.0, 1000.0])['load'] == [
        'is exactly 0 while the shaft turns: is the sensor connected, are its topic and field right?'
    ]
    assert asked([0.0, 0.0, 0.3], [0.0, 0.0, 1000.0])['load'] == []
