# SPDX-License-Identifier: Apache-2.0
"""Friction at its load and temperature in scenes and calibrations: against laws written out for them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from sending import configured

from stickslip_lab.calibration.calibration import bin_courses
from stickslip_lab.scenes.scene import Scene, simulate
from stickslip_lab.scenes.telemetry import Messages
from stickslip_monitor import Stream, hopf_speed
from stickslip_monitor.errors import SceneError
from stickslip_monitor.monitor.rule_over_arrays import BearingScan
from stickslip_monitor.physics.lubrication import viscosity

LOAD = 2000.0
SCALE = LOAD / 1000.0 * viscosity(15.0) / viscosity(5.0)
FRICTION = {'at_load': 1000.0, 'load_exponent': 1.0, 'at_temperature': 15.0}
HERE = {'friction': FRICTION, 'water_temperature': {'constant': 5.0}}
WRITTEN_OUT = {'friction': {'decay': 10.0 / SCALE}}
WATER_TOPIC = {'constant': 5.0, 'topic': '/sea/temperature'}
PLAIN_EFFECTS = [
    {'speed_profile': {'unit': 'rpm', 'points': [[0, 60]]}},
    {'load_profile': {'unit': 'N', 'points': [[0, LOAD]]}},
]
WARMS_UP = {'water_temperature': {'points': [[0, 5], [10, 25]]}}
WITH_WATER = {name: {'rate': 1.0} for name in ('speed', 'load', 'water_temperature')}


def test_a_lining_moves_as_that_of_the_law_written_out(make_scene: Callable[..., Scene]) -> None:
    truth = []
    for law in (HERE, WRITTEN_OUT):
        effects = [
            {'speed_profile': {'unit': 'rpm', 'points': [[0, 75], [20, 20]]}},
            {'load_profile': {'unit': 'N', 'points': [[0, LOAD]]}},
            {'lining_motion': {'disturbance': {'standard_deviation': 1.0, 'unit': 'N'}}},
        ]
        scene = make_scene(bearings={'aft': law}, duration=20.0, effects=effects)
        truth.append({c.topic: c for block in simulate(scene) for c in block.truth if len(c.time)})
    assert truth[0].keys() == truth[1].keys()
    events = [t for t in truth[0] if 'event' in t]
    assert events
    for topic in events:
        assert len(truth[0][topic].time) == len(truth[1][topic].time) > 0
        # The disturbance moves s by a thousandth: sticks begin at the same period of the lining.
        assert np.allclose(truth[0][topic].time, truth[1][topic].time, atol=0.5)


def test_a_calibration_takes_reference_points() -> None:
    config = configured(friction__at_load=1000.0, friction__load_exponent=1.0).bearings[0]
    seconds = np.arange(60)
    values = np.column_stack([np.full(60, LOAD), np.linspace(90.0, 30.0, 60)]).ravel()
    stream = Stream(np.repeat(seconds * 10**9, 2), np.tile([1, 0], 60), values)
    (course,) = bin_courses('aft', BearingScan(config, 0).finish(stream, None))
    assert course.load.max() == pytest.approx(1000.0)
    plain = replace(config.bearing, lubrication=None)
    slow_speed = hopf_speed(config.bearing, LOAD) / 2.0
    assert slow_speed == pytest.approx(hopf_speed(plain, 1000.0), rel=1e-12)
    assert course.speed.max() == pytest.approx(90.0 * np.pi * 0.1 / 60.0 / 2.0, rel=0.02)


def test_water_that_warms_up_moves_the_boundaries(make_scene: Callable[..., Scene]) -> None:
    effects = [*PLAIN_EFFECTS, WARMS_UP, {'operating_point': {'rate': 1.0}}]
    scene = make_scene(bearings={'aft': HERE}, duration=20.0, effects=effects)
    margins = np.concatenate([
        c.values for block in simulate(scene) for c in block.truth if c.topic.endswith('hopf_margin')
    ])  # fmt: skip
    # At g = 1 the reference load is 1 kN over the ratio of the viscosities, the Hopf speed by its logarithm.
    water = np.minimum(5.0 + 2.0 * np.arange(margins.size), 25.0)
    ratio = viscosity(water) / viscosity(15.0)
    expected = LOAD / 1000.0 / ratio * np.log(5.0 * ratio) / 10.0
    assert np.allclose(60.0 * np.pi * 0.1 / 60.0 / expected - 1.0, margins, atol=1e-8)


def test_a_measured_water_is_recorded_as_its_sensor_has_it(
    make_scene: Callable[..., Scene], messages_of: Callable[..., dict[str, Messages]]
) -> None:
    bearings = {'aft': {'friction': FRICTION, 'water_temperature': WATER_TOPIC | {'scale': 0.1}}}
    still = make_scene(bearings=bearings, duration=20.0, effects=PLAIN_EFFECTS, telemetry=WITH_WATER)
    assert messages_of(still)['/sea/temperature'].raw == pytest.approx(np.full(21, 50.0))
    errors = {'bias': {'water_temperature': {'bias': 0.5, 'unit': 'C'}}}
    effects = [*PLAIN_EFFECTS, WARMS_UP, errors]
    warming = make_scene(bearings=bearings, duration=20.0, effects=effects, telemetry=WITH_WATER)
    expected = 10.0 * (0.5 + np.minimum(5.0 + 2.0 * np.arange(21.0), 25.0))
    assert messages_of(warming)['/sea/temperature'].raw == pytest.approx(expected)


def test_a_water_below_zero_is_no_load(
    make_scene: Callable[..., Scene], messages_of: Callable[..., dict[str, Messages]]
) -> None:
    effects = [*PLAIN_EFFECTS, {'water_temperature': {'points': [[0, -1.5]]}}]
    bearings = {'aft': {'friction': FRICTION, 'water_temperature': WATER_TOPIC}}
    scene = make_scene(bearings=bearings, duration=2.0, effects=effects, telemetry=WITH_WATER)
    assert messages_of(scene)['/sea/temperature'].raw.tolist() == [-1.5, -1.5, -1.5]


def test_water_is_recorded_only_where_the_scene_and_the_configuration_have_it(
    make_scene: Callable[..., Scene],
) -> None:
    bearings = {'aft': {'friction': FRICTION, 'water_temperature': WATER_TOPIC}}
    scene = make_scene(bearings=bearings, effects=PLAIN_EFFECTS)
    assert [channel.quantity for channel in scene.channels] == ['speed', 'load']
    with pytest.raises(
        SceneError, match=r'telemetry\.water_temperature: the configuration has no aft\.water'
    ):
        make_scene(bearings={'aft': HERE}, effects=PLAIN_EFFECTS, telemetry=WITH_WATER)


def test_one_topic_cannot_carry_two_waters(make_scene: Callable[..., Scene]) -> None:
    bearing = {'friction': FRICTION, 'water_temperature': WATER_TOPIC}
    bearings = {'aft': bearing, 'fwd': bearing | {'load': {'topic': '/bearing/fwd/load', 'unit': 'N'}}}
    effects = [*PLAIN_EFFECTS, {'water_temperature': WARMS_UP['water_temperature'] | {'bearing': 'aft'}}]
    with pytest.raises(SceneError, match='topic /sea/temperature serves aft and fwd'):
        make_scene(bearings=bearings, effects=effects, telemetry=WITH_WATER)
    assert make_scene(bearings=bearings, effects=[*PLAIN_EFFECTS, WARMS_UP], telemetry=WITH_WATER)


def test_water_needs_the_temperature_of_the_measurement(make_scene: Callable[..., Scene]) -> None:
    with pytest.raises(SceneError, match=r'aft has no friction\.at_temperature'):
        make_scene(effects=[*PLAIN_EFFECTS, WARMS_UP])
