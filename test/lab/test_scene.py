# SPDX-License-Identifier: Apache-2.0
"""Every way to get a scene wrong has a sentence that names key, value and rule."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml

from stickslip_lab.scenes.scene import Scene, load_scene
from stickslip_monitor.cli import main
from stickslip_monitor.errors import SceneError, StickslipError

MakeScene = Callable[..., Scene]


def parse_refusals(table: str) -> list[tuple[str, str]]:
    """Return wrong YAML with its refusal, from lines with an arrow between."""
    return [
        (text.strip(), sentence)
        for text, sentence in re.findall(r'^(\S.*?)\s+=> ([^\n]*)$', table, re.M | re.S)
    ]


# What stands in the scene's file in place of its own keys (~: left out).
SCENES = parse_refusals("""
{durations: 3} => unknown key 'durations' = 3; did you mean 'duration'?
{scene: ~} => not a scene file: it must begin with 'scene: stickslip_monitor/scene/1'
{effects: ~} => key 'effects' is missing:
{scene: x/2} => scene = 'x/2' must be 'stickslip_monitor/scene/1'
{description: 3} => description = 3 must be a text
{duration: 0} => duration = 0 must be a finite number above 0
{duration: true} => duration = True must be
{start: 2026-05-04} => start = '2026-05-04' must be an ISO time
{start: 1777874400} => must be 1777874400000000000: nanoseconds since 1970, not seconds
{telemetry: 3} => telemetry = 3 must be a mapping of keys
{telemetry: {speed: {rate: 1}, load: {rate: 1}, level: {rate: 1}}}
  => telemetry.level: the configuration has no aft.level.topic
{start: noon} => start = 'noon' must be an ISO time
{start: 1969-12-31 23:59:00} => start = '1969-12-31 23:59:00' must be between
{start: 9223372036854775807} => must be between 1970 and 2262, with the whole scene
{seed: -1} => seed = -1 must be a whole number not below 0
{telemetry: {speed: {rate: 1}}} => key 'telemetry.load' is missing
{telemetry: {speed: {rate: 1}, load: {rate: 1}, torque: {}}}
  => unknown key 'torque' = {} in telemetry
{bearings: measured, telemetry: {speed: {rate: 1}, load: {rate: 1}, level: {rate: 200}},
    effects: [{lining_motion: {disturbance: {standard_deviation: 1, unit: N}}}]}
  => telemetry.level.rate = 200 Hz must not be above 7.96 Hz
{telemetry: {speed: {rate: 1}, load: {rate: -1}}}
  => telemetry.load.rate = -1 must be a finite number between 1e-06 and 1000 Hz
{effects: {}} => effects = {} must be a list
{effects: [{bias: {}, stuck: {}}]} => effects: entry 1 =
{effects: [{sped_profile: {}}]}
  => effects: entry 1 is unknown effect 'sped_profile'; did you mean 'speed_profile'?
""")
# An effect, or two with a dash between them.
EFFECTS = parse_refusals("""
speed_profile: {unit: rpm, points: [[0, 1]]} - speed_profile: {unit: rpm, points: [[0, 1]]}
  => effect 'speed_profile' is listed twice for topic /shaft/speed
speed_profile: {unit: rpm, pionts: []} => unknown key 'pionts' = [] in speed_profile; did you mean
speed_profile: {unit: rpm, points: 5} => speed_profile.points = 5 must be a list of points
speed_profile: {unit: rpm, points: [[0, 1]], bearing: atf}
  => speed_profile.bearing = 'atf' must be one of aft; did you mean 'aft'?
speed_profile: {unit: rpm, points: [[0, 1.0e+308]]}
  => point 1 = [0, 1e+308] must be a pair of numbers, [time in s, value], of a size up to
speed_profile: {unit: rpm, points: [[0, 1], [9, 2], [9, 3]]}
  => point 3 is at 9 s, but times must rise and the one before is at 9 s
speed_profile: {unit: rpm, points: [[0, 1], [101, 2]]}
  => point 2 is at 101 s, outside the scene, which lasts from 0 to 100 s
speed_profile: {unit: rpm, table: x.csv, points: [[0, 1]]}
  => speed_profile has points and a table: give one of them
speed_steps: {unit: rpm, rise: 4, steps: [[0, 1], [10, 2], [13, 3]]}
  => speed_steps.steps: step 3 is at 13 s, but the one before takes until 14 s
manoeuvre: {unit: rpm, time_constant: 8, ahead: {half: 60}, orders: [[0, full speed]]}
  => order 1 is 'full speed', which has no speed in this scene
manoeuvre: {unit: rpm, time_constant: 8, ahead: {half: 60}, orders: [[now, stop]]}
  => order 1 is at 'now': a time must be a number of seconds
manoeuvre: {unit: rpm, time_constant: 8, ahead: {half: 60}, orders: [stop]}
  => order 1 = 'stop' must be a pair, [time in s, 'slow ahead']
manoeuvre: {unit: rpm, time_constant: 8, ahead: {slow: 40, half: 40}, orders: []}
  => manoeuvre.ahead.half = 40 must be a finite number above 40
blade_ripple: {blades: 4.5, amplitude: 0} => blades = 4.5 must be a whole number
blade_ripple: {blades: 4, amplitude: 2}
  => blade_ripple.amplitude = 2 must be a finite number between 0 and 1
averaging: {} => averaging must name at least one of speed, load, water_temperature
sensor_noise: {load: {standard_deviation: 1.0e+308, unit: N}}
  => standard_deviation = 1e+308 must be a finite number between 0 and 1e+15 N
spikes: {load: {size: 1, unit: N}} => spikes.load must have windows, a share of the samples, or bot
stuck: {load: {windows: [[0, 30], [20, 40]]}}
  => stuck.load.windows: window 2 = [20, 40] overlaps or precedes window 1 = [0, 30]; windows must
stuck: {load: {windows: [5, 6]}} => window 1 = 5 must be a pair of numbers, [start in s
stuck: {load: {windows: [[5, 5]]}} => window 1 = [5, 5] must start before it ends, within
clock_jump: {jumps: [[5, -40]]}
  => topic /shaft/speed is std_msgs/msg/Float64, without a time stamp: its clock can only jump
clock_jump: {jumps: [[5, 0]]} => clock_jump.jumps: jump 1 is by 0 s, which must not
out_of_order: {load: {delay: 1, share: 0.1}}
  => topic /bearing/aft/load is std_msgs/msg/Float64, without a time stamp: none of its
friction_drift: {parameter: mass, points: [[0, 1]]}
  => friction_drift.parameter = 'mass' must be one of static, kinetic, decay, viscous, factor
friction_drift: {parameter: static, points: [[0, 0.3], [5, -0.1]]}
  => friction_drift: static = -0.1 at 5 s must not be negative
friction_drift: {parameter: decay, points: [[0, 10], [5, 0]]} => friction_drift at 5 s: decay = 0
friction_drift: {parameter: static, points: [[0, 0.3]]} -
  friction_drift: {parameter: static, points: [[0, 0.3]]}
  => effect 'friction_drift' with static is listed twice for bearing aft
lining_motion: {disturbance: {standard_deviation: 1, unit: N}, knocks: [[100, 1]]}
  => no blow can follow at 100 s, where the scene ends
lining_motion: {disturbance: {standard_deviation: 1, unit: N}, amplitude: {rate: 9.0}}
  => lining_motion.amplitude.rate = 9.0 must be a finite number above 0 and not above 7.95775 Hz
""")


@pytest.mark.parametrize(('text', 'sentence'), SCENES)
def test_a_wrong_scene_is_refused_in_one_sentence(
    scene_path: Callable[..., Path],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    text: str,
    sentence: str,
) -> None:
    path = scene_path(**yaml.safe_load(text))
    files = set(tmp_path.iterdir())
    assert main(['simulate', str(path), '-o', str(tmp_path / 'bag')]) == 2
    out, error = capsys.readouterr()
    assert out == ''
    assert error.startswith(f'ERROR: {path}: ')
    assert sentence in error
    assert error.count('\n') == 1
    assert set(tmp_path.iterdir()) == files


@pytest.mark.parametrize(('text', 'sentence'), EFFECTS)
def test_a_wrong_effect_is_reported(make_scene: MakeScene, text: str, sentence: str) -> None:
    effects = [yaml.safe_load(part) for part in re.split(r'\s-\s', text)]
    with pytest.raises(SceneError, match=re.escape(sentence)):
        make_scene(effects=effects)


@pytest.mark.parametrize(
    ('text', 'sentence'),
    [
        ('time,value\n0,1\n5,2\n\n5,3\n', ' line 5 is at 5 s, but times must rise and the'),
        ('time,value\n0,fast\n', " line 2 = '0,fast' must be two numbers: time in s, value"),
        ('time,value\n', ' has no rows'),
        ('t,rpm\n0,1\n', " must begin with a line 'time,value'"),
    ],
)
def test_a_wrong_table_is_reported_with_its_line(
    make_scene: MakeScene, tmp_path: Path, text: str, sentence: str
) -> None:
    path = tmp_path / 'speeds.csv'
    effect = {'speed_profile': {'unit': 'rpm', 'table': 'speeds.csv'}}
    with pytest.raises(SceneError, match=re.escape(f'{path}: No such file or directory')):
        make_scene(effects=[effect])
    path.write_text(text, 'utf-8')
    with pytest.raises(SceneError, match=re.escape(f"table '{path}'{sentence}")):
        make_scene(effects=[effect])


INPUTS = parse_refusals("""
{aft: {speed: {type: sensor_msgs/msg/JointState, field: 'velocity[0]'}}}
  => aft.speed is of type sensor_msgs/msg/JointState in the configuration: a scene can write std
{aft: {load: {type: geometry_msgs/msg/WrenchStamped, field: header.seq}}}
  => aft.load is field 'header.seq' of geometry_msgs/msg/WrenchStamped in the configuration: a
{aft: {load: {type: geometry_msgs/msg/WrenchStamped, field: wrench.force.z}},
    fwd: {speed: {topic: /fwd}}}
  => topic /bearing/aft/load serves aft and fwd with different types or fields: they
{aft: {}, fwd: {speed: {topic: /fwd}, load: {topic: /shaft/speed}}}
  => topic /shaft/speed serves aft and fwd, as speed and as load: use two topics
{aft: {}, fwd: {load: {topic: /fwd}, speed: {scale: 2.0}}}
  => topic /shaft/speed serves aft and fwd with different units, scales or offsets
""")


@pytest.mark.parametrize(('bearings', 'sentence'), INPUTS)
def test_inputs_that_cannot_be_simulated_are_named(
    make_scene: MakeScene, bearings: str, sentence: str
) -> None:
    with pytest.raises(SceneError, match=re.escape(sentence)):
        make_scene(yaml.safe_load(bearings))


def test_bearings_of_one_shaft_must_agree(make_scene: MakeScene) -> None:
    two: dict[str, Any] = {'aft': {}, 'fwd': {'journal_diameter': 0.2, 'load': {'topic': '/fwd'}}}
    assert len(make_scene(two).channels) == 3
    rates = {'speed': {'rate': 10}, 'load': {'rate': 4}}
    with pytest.raises(SceneError, match='its rate cannot be both 10 and 5 Hz'):
        make_scene(two, telemetry={'aft': rates, 'fwd': rates | {'speed': {'rate': 5}}})
    with pytest.raises(SceneError, match=r"key 'telemetry\.fwd' is missing: the rates of"):
        make_scene(two, telemetry={'aft': rates})
    profile = {'speed_profile': {'unit': 'm/s', 'points': [[0, 1]]}}
    with pytest.raises(SceneError, match='unit m/s says nothing about topic /shaft/speed'):
        make_scene(two, effects=[profile])


@pytest.mark.parametrize(
    'load', [{'constant': 30.0}, {'over_speed': [0.0, 20.0, 60.0, 30.0]}], ids=['constant', 'table']
)
def test_a_load_that_the_monitor_assumes_has_a_topic_of_its_own(
    make_scene: MakeScene, load: dict[str, Any]
) -> None:
    scene = make_scene({'aft': {'load': load | {'topic': '', 'unit': 'kN'}}})
    topics = {channel.quantity: channel.topic for channel in scene.channels}
    assert topics == {'speed': '/shaft/speed', 'load': '/bearing/aft/load'}
    (channel,) = (channel for channel in scene.channels if channel.quantity == 'load')
    # The monitor would judge the ship at the load that it assumes, and so is the scene; it records kN.
    assert channel.factor('nominal') == 30e3
    assert channel.input.factor == 1e3


def test_speeds_of_a_bearing_without_a_fold_at_its_load_are_refused(make_scene: MakeScene) -> None:
    # Of the reference bearing sliding is unstable from 200 N on, and a vibration lasts from about there.
    profile = {'speed_profile': {'unit': 'fold', 'points': [[0, 1.5]]}}
    light = {'load': {'constant': 1.0, 'topic': '', 'unit': 'N'}}
    with pytest.raises(SceneError, match='bearing aft has no fold at its nominal load, 1 N, which the unit'):
        make_scene({'aft': light}, effects=[profile])
    # A blow in that unit had no size, and the lining none of its motion.
    knock = {
        'knocks': [[5, 1.0]],
        'knock_unit': 'fold',
        'disturbance': {'standard_deviation': 0, 'unit': 'N'},
    }
    with pytest.raises(SceneError, match='bearing aft has no fold'):
        make_scene({'aft': light}, effects=[{'lining_motion': knock}])


NS = 10**9


@pytest.mark.parametrize(
    ('bearings', 'start', 'jumps', 'number'),
    [
        ('stamped', 20 * NS, [[30, -40], [60, -50]], 2),
        ('stamped', (2**31 - 200) * NS, [[30, 10], [60, 100]], 2),
        ('{aft: {}}', 2**63 - 200 * NS, [[30, 110]], 1),
    ],
)
def test_a_jump_out_of_the_range_of_stamps_is_named(
    make_scene: MakeScene, bearings: str, start: int, jumps: list[list[float]], number: int
) -> None:
    """Headers count seconds in 32 bits with a sign, recorders nanoseconds in 64."""
    inputs, effects = yaml.safe_load(bearings), [{'clock_jump': {'jumps': jumps}}]
    sentence = f'clock_jump.jumps: jump {number} takes the clock out of the range of time stamps'
    with pytest.raises(SceneError, match=re.escape(sentence)):
        make_scene(inputs, start=start, effects=effects)
    # Ten seconds less is in the range.
    jumps[-1][1] *= 0.8
    make_scene(inputs, start=start, effects=effects)
    latest_start = (2**31 - 50) * NS
    with pytest.raises(SceneError, match=r'start = .* in 2038 the time stamps'):
        make_scene('stamped', start=latest_start)
    make_scene({'aft': {}}, start=latest_start)


TOO_MUCH = parse_refusals("""
{aft: {speed: {maximum: 1.0}},
    fwd: {load: {topic: /fwd}, journal_diameter: 0.2, speed: {maximum: 1.0}}} +
  speed_profile: {unit: rpm, points: [[0, 90], [40, 130]]}
  => speed = 1.00531 m/s at 6 s is more than topic /shaft/speed can carry: fwd.speed.maximum = 1
{aft: {load: {maximum: 900.0}}} + load_profile: {unit: kN, points: [[0, 1]]}
  => load = 1000 N at 0 s is more than topic /bearing/aft/load can carry: aft.load.maximum = 900
""")


@pytest.mark.parametrize(('text', 'sentence'), TOO_MUCH)
def test_numbers_that_the_telemetry_cannot_carry_are_refused(
    make_scene: MakeScene, messages_of: Callable[..., Any], text: str, sentence: str
) -> None:
    bearings, effect = map(yaml.safe_load, text.split(' + ' if ' + ' in text else ' +\n'))
    with pytest.raises(SceneError, match=re.escape(sentence)):
        messages_of(make_scene(bearings, 1.0, effects=[effect]), 7.0)


def test_files_that_are_no_scenes_are_named(tmp_path: Path, scene_path: Callable[..., Path]) -> None:
    path = tmp_path / 'scene.yaml'
    for text in ('scene: [', 'a: 1\na: 2\n', '', '3', '[]'):
        path.write_text(text, 'utf-8')
        with pytest.raises(SceneError, match=re.escape(str(path))):
            load_scene(path)
    with pytest.raises(SceneError, match=r'none\.yaml: No such file'):
        load_scene(tmp_path / 'none.yaml')
    with pytest.raises(StickslipError, match=r'other\.yaml: No such file'):
        load_scene(scene_path(config='other.yaml'))
