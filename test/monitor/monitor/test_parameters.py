# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from sending import configured
from shared import REFERENCE

from stickslip_monitor import MonitorConfig, Stribeck, Tabulated, build_config
from stickslip_monitor.errors import ConfigurationError
from stickslip_monitor.monitor.parameters import BEARING_PARAMETERS, NODE_PARAMETERS
from stickslip_monitor.monitor.sample_types import INPUTS
from stickslip_monitor.monitor.value_check import REQUIRED, Parameter
from stickslip_monitor.physics.friction import Stretched

MISSING = object()


def build_changed(changes: dict[str, Any]) -> MonitorConfig:
    values = {'bearings': ['aft']} | {f'aft.{k}': v for k, v in REFERENCE.items()} | changes
    return build_config({k: v for k, v in values.items() if v is not MISSING})


def test_every_value_reaches_its_place() -> None:
    config = configured(
        speed__unit='Hz',
        speed__scale=2.0,
        speed__offset=-1.0,
        speed__timeout=0.25,
        speed__maximum=7.0,
        speed__type='sensor_msgs/msg/JointState',
        speed__field='velocity[2]',
        load__unit='kN',
        load__timeout=3.0,
        friction__viscous=0.01,
        alarm__caution_margin=0.2,
        alarm__hysteresis=0.03,
        alarm__amplitude_limit=1e-3,
        alarm__on_delay=1.5,
        alarm__off_delay=2.5,
        alarm__minimum_speed=0.01,
    ).bearing('aft')
    assert config.bearing.friction == Stribeck(0.3, 0.1, 10.0, 0.01)
    assert (config.bearing.mass, config.bearing.damping) == (50.0, 400.0)
    assert (config.bearing.stiffness, config.bearing.journal_diameter) == (2.0e6, 0.1)
    speed, load, alarm = config.speed, config.load, config.alarm
    assert (speed.topic, speed.type) == ('/shaft/speed', 'sensor_msgs/msg/JointState')
    assert (speed.field, speed.field_text) == (('velocity', 2), 'velocity[2]')
    assert (speed.scale, speed.offset) == (2.0, -1.0)
    assert speed.factor == pytest.approx(math.pi * 0.1, rel=1e-15)
    assert (speed.timeout_ns, speed.maximum, speed.deadband) == (250_000_000, 7.0, 0.01)
    assert (load.topic, load.type) == ('/bearing/aft/load', 'std_msgs/msg/Float64')
    assert (load.field, load.factor, load.timeout_ns) == (('data',), 1000.0, 3_000_000_000)
    assert (load.maximum, load.deadband) == (1e8, 0.0)
    assert (alarm.caution_margin, alarm.hysteresis, alarm.amplitude_limit) == (0.2, 0.03, 1e-3)
    assert (alarm.on_delay_ns, alarm.off_delay_ns) == (1_500_000_000, 2_500_000_000)


SECOND = {'bearings': ['aft', 'forward']} | {f'forward.{k}': v for k, v in REFERENCE.items()}
LAW = {
    'aft.friction.law': 'tabulated',
    'aft.friction.speed': [0.0, 1.0],
    'aft.friction.coefficient': [0.3, 0.1],
}
TABLE: dict[str, Any] = {'aft.load.topic': MISSING, 'aft.load.over_speed': [[0, 2], [60, 1]]}
# One of each kind of rule, and of what is no number; all but the dots begins the message.
REFUSED = [
    ({'aft.mass': -1.0}, 'aft.mass = -1.0 must be a finite number between 1e-06 and 1e+07 kg'),
    ({'aft.mass': '50'}, "aft.mass = '50' must be a finite number between 1e-06 and 1e+07 kg"),
    ({'aft.mass': True}, 'aft.mass = True must be a finite number between 1e-06 and 1e+07 kg'),
    ({'aft.damping': -1e-9}, '...must be a finite number between 0 and 1e+10 N s/m'),
    ({'aft.speed.unit': 'knots'}, "aft.speed.unit = 'knots' must be one of rpm, rad/s, Hz, m/s"),
    ({'aft.load.unit': False}, 'aft.load.unit = False must be one of N, kN'),
    ({'aft.load.timeout': 1.1e9}, 'aft.load.timeout = 1100000000.0 must be a finite number above'),
    ({'aft.load.scale': 0}, '...a finite number between -1e+09 and 1e+09 and other than 0'),
    ({'aft.speed.offset': math.nan}, 'aft.speed.offset = nan must be a finite number'),
    ({'aft.speed.topic': 7}, 'aft.speed.topic = 7 must be a text'),
    ({'aft.alarm.hysteresis': 0.91}, 'aft.alarm.hysteresis = 0.91 must be a finite number between'),
    ({'aft.alarm.amplitude_limit': math.nan}, 'aft.alarm.amplitude_limit = nan must be a number'),
    ({'aft.load.topic': 'a/1'}, "aft.load.topic = 'a/1' must be a ROS topic"),
    ({'aft.load.topic': '/a//b'}, "aft.load.topic = '/a//b' must be a ROS topic"),
    ({'aft.load.topic': '/a\n'}, '...must be a ROS topic'),
    ({'aft.speed.type': 'std_msgs/Float64'}, '...package/msg/Type'),
    ({'aft.speed.type': 'std_msgs/msg/float64'}, '...package/msg/Type'),
    ({'aft.load.field': 'a..b'}, "aft.load.field: field 'a..b' is not a pa"),
    # Names, and what has none.
    ({'aft.mass': MISSING}, "parameter 'aft.mass' [kg] is missing: Moving mass of the lining."),
    ({'aft.mas': 1.0}, "unknown parameter 'aft.mas' = 1.0; did you mean 'aft.mass'?"),
    ({'aft.friction.statik': 1.0}, "...'aft.friction.statik' = 1.0; did you mean 'aft.friction.static'?"),
    ({'autostrat': 1.0}, "unknown parameter 'autostrat' = 1.0; did you mean 'autostart'?"),
    ({'clips.size_mb': 5.0}, "unknown parameter 'clips.size_mb' = 5.0; did you mean 'clips.size'?"),
    (
        {'clips.before': 5.0},
        "...'clips.before' = 5.0; clips has clips.directory, clips.around, clips.most, clips.size",
    ),
    ({'altitude': 5.0}, "unknown parameter 'altitude' = 5.0"),
    # A misspelt key is named before the one that it leaves missing.
    ({'aft.mass': MISSING, 'aft.masss': 50.0}, "...'aft.masss' = 50.0; did you mean"),
    ({'forward.mass': 50.0}, "section 'forward' is not a bearing: add it to bearings, which lists aft"),
    ({'bearings': []}, '...must be one or more names of bearings'),
    ({'bearings': ['aft', 'aft']}, "...'aft' is listed twice"),
    ({'bearings': ['Aft']}, "...'Aft' must be a name of lower-case letters"),
    ({'bearings': ['aft/x']}, "...'aft/x' must be a name"),
    ({'bearings': ['äft']}, "...'äft' must be a name"),
    ({'bearings': ['aft\n']}, '...must be a name'),
    ({'bearings': 'aft'}, "bearings = 'aft' must be a list of texts"),
    ({'bearings': [1]}, 'bearings = [1] must be a list of texts'),
    (SECOND | {'forward.mass': -2.0}, 'forward.mass = -2.0 must be'),
    # What a law needs.
    ({'aft.friction.decay': MISSING}, "...'aft.friction.decay' is missing: the law stribeck needs "),
    (
        LAW | {'aft.friction.coefficient': MISSING},
        "...friction.coefficient' is missing: the law tabulated needs ",
    ),
    (LAW | {'aft.friction.speed': []}, "parameter 'aft.friction.speed' is missing"),
    (
        LAW | {'aft.friction.speed': [0.0], 'aft.friction.coefficient': [0.3]},
        'aft: friction table has 1 point: ',
    ),
    (LAW | {'aft.friction.speed': [0.0, -1.0]}, 'aft.friction.speed = [0.0, -1.0] must be a list of'),
    (LAW | {'aft.friction.coefficient': [0.3, math.nan]}, 'aft.friction.coefficient = [0.3, nan] must be'),
    (LAW | {'aft.friction.speed': [0.0, True]}, 'aft.friction.speed = [0.0, True] must be a list'),
    (LAW | {'aft.friction.speed': '01'}, "aft.friction.speed = '01' must be a list of finite"),
    # Rules of two parameters.
    (
        {'aft.speed.maximum': 0.002},
        'aft.alarm.minimum_speed = 0.003 m/s must be below aft.speed.maximum = 0.002',
    ),
    ({'aft.inertia': 0.125}, "'aft.mass' and 'aft.inertia' are given: "),
    (
        {'aft.load.constant': 2.0},
        "aft.load.constant = 2 N and aft.load.topic = '/bearing/aft/load' are both given",
    ),
    (
        {'aft.load.over_speed': [0, 2, 60, 1]},
        'aft.load.over_speed = (0.0, 2.0, 60.0, 1.0) and aft.load.topic',
    ),
    (TABLE | {'aft.load.constant': 2.0}, 'aft.load.constant = 2 N and aft.load.over_speed = '),
    (
        TABLE | {'aft.load.over_speed': [[0, 2]]},
        '...over_speed = [[0.0, 2.0]] must be 2 to 16 pairs of a shaft',
    ),
    (TABLE | {'aft.load.over_speed': [[0, 2], [0, 1]]}, '...must be 2 to 16 pairs of a shaft speed in rpm'),
    (
        TABLE | {'aft.load.over_speed': [[0, 2, 60], [0, 1, 2]]},
        '...must be a list of pairs of finite numbers',
    ),
    (TABLE | {'aft.load.over_speed': [0, 2, 60]}, '...must be a list of pairs of finite numbers between 0'),
    (TABLE | {'aft.load.over_speed': [[0, 0], [60, 1]]}, '...must be above 0 and not above aft.load.maximum'),
    (TABLE | {'aft.load.over_speed': [[0, 1], 60, 1]}, '...must be a list of pairs of finite numbers'),
    (TABLE | {'aft.load.unit': MISSING}, "parameter 'aft.load.unit' is missing"),
    ({'aft.speed.gear': 0.0}, 'aft.speed.gear = 0.0 must be a finite number above 0'),
    (
        {'aft.speed.gear': 4.2, 'aft.speed.scale': 0.5},
        'aft.speed.gear = 4.2 and aft.speed.scale = 0.5 are both',
    ),
    ({'aft.speed.gear': 4.2, 'aft.speed.unit': 'm/s'}, 'aft.speed.gear = 4.2 is given and aft.speed.unit = '),
    ({'aft.load.gear': 4.2}, "unknown parameter 'aft.load.gear'"),
    ({'aft.level.scale': 2.0}, "parameter 'aft.level.topic' is missing, and aft.level.scale = 2 is given"),
    ({'aft.level.topic': '/v', 'aft.level.threshold': 0.0}, 'aft.level.threshold = 0 m/s^2 must be above 0'),
    ({'aft.level.topic': '/bearing/aft/load'}, 'aft.level is read from the same field as the load'),
]


@pytest.mark.parametrize(('changes', 'sentence'), REFUSED)
def test_a_value_that_breaks_a_rule_is_named_with_it(changes: dict[str, Any], sentence: str) -> None:
    with pytest.raises(ConfigurationError) as caught:
        build_changed(changes)
    text = str(caught.value)
    assert sentence.removeprefix('...') in text
    assert sentence.startswith('...') or text.startswith(sentence)
    assert '\n' not in text


def test_a_gear_makes_the_speed_of_an_engine_that_of_the_shaft() -> None:
    geared, scaled = configured(speed__gear=4.2).bearing('aft'), configured().bearing('aft')
    assert geared.speed.factor == pytest.approx(scaled.speed.factor / 4.2, rel=1e-15)
    assert geared.speed.maximum == scaled.speed.maximum  # the shaft's
    assert geared.speed.gear_text == 'of an engine with a gear of 4.2'


def test_a_table_of_the_load_is_the_same_in_pairs_and_in_one_list() -> None:
    pairs, flat = (
        build_changed(TABLE | {'aft.load.over_speed': table}) for table in ([[0, 2], [60, 1]], [0, 2, 60, 1])
    )
    assert pairs == flat
    load = pairs.bearing('aft').load
    assert load.table == ((0.0, pytest.approx(math.pi * 0.1)), (2.0, 1.0))
    assert (load.assumed, load.origin) == ((1.0, 2.0), 'from the alignment table')


def test_edges_of_ranges_are_allowed() -> None:
    edges = {'alarm__hysteresis': 0.9, 'alarm__amplitude_limit': math.inf, 'alarm__on_delay': 0}
    edges |= {'alarm__minimum_speed': 0.99, 'speed__maximum': 1.0}
    aft = configured(damping=0.0, speed__timeout=604_800.0, **edges).bearing('aft')
    assert (aft.bearing.damping, aft.speed.timeout_ns, aft.alarm.on_delay_ns) == (0.0, 604_800 * 10**9, 0)


@pytest.mark.parametrize('name', [p.name for p in BEARING_PARAMETERS if p.default is REQUIRED] + ['bearings'])
def test_a_missing_required_parameter_is_an_error(name: str) -> None:
    full = name if name == 'bearings' else f'aft.{name}'
    with pytest.raises(ConfigurationError, match=f"parameter '{full}'.* is missing"):
        build_changed({full: MISSING})


def test_laws_are_built_from_their_numbers() -> None:
    table = configured(
        friction__law='tabulated', friction__speed=[0, 0.5, 2], friction__coefficient=[0.3, 0.2, 0.1]
    )
    assert table.bearings[0].bearing.friction == Tabulated([0.0, 0.5, 2.0], [0.3, 0.2, 0.1])
    stretched = configured(friction__exponent=2.0).bearings[0].bearing.friction
    assert stretched == Stretched(0.3, 0.1, 10.0, 0.0, 2.0)


TORSIONAL = {'inertia': 0.125, 'torsional_damping': 1.0, 'torsional_stiffness': 5000.0}


def test_a_lining_is_given_by_torsional_values_too() -> None:
    parameters = {'bearings': ['aft']} | {
        f'aft.{name}': value for name, value in (REFERENCE | TORSIONAL).items()
    }
    plain = {f'aft.{name}' for name in ('mass', 'damping', 'stiffness')}
    alone = {name: value for name, value in parameters.items() if name not in plain}
    # Each over the square of a radius of 50 mm.
    lining = build_config(alone).bearings[0].bearing
    assert (lining.mass, lining.damping, lining.stiffness) == pytest.approx((50.0, 400.0, 2.0e6))
    del alone['aft.torsional_damping']
    with pytest.raises(ConfigurationError, match=r"^parameter 'aft\.torsional_damping' \[N m s"):
        build_config(alone)


ROWS = {p.name: p for p in (*NODE_PARAMETERS, *BEARING_PARAMETERS)}


def test_every_default_keeps_its_own_rule() -> None:
    for row in ROWS.values():
        if row.default is not REQUIRED and not row.is_optional:
            assert row.checked(row.name, {row.name: row.default}) == row.default


def test_only_thresholds_scales_and_timeouts_are_live() -> None:
    live = {p.name for p in (*NODE_PARAMETERS, *BEARING_PARAMETERS) if p.live}
    inputs = {f'{q}.{x}' for q in INPUTS for x in ('scale', 'offset', 'timeout', 'hold', 'maximum')} | {
        'load.minimum',
        'level.threshold',
        'level.hysteresis',
    }
    alarm = {p.name for p in BEARING_PARAMETERS if p.name.startswith('alarm.')}
    node_live = {'publish_period', 'shelve_time', 'silence_time', 'water_temperature.constant'}
    assert live == inputs | alarm | node_live


@pytest.mark.parametrize(
    ('kind', 'value', 'plain'),
    [
        ('float', np.int64(3), 3.0),
        ('float[]', np.array([0.0, 1.5]), (0.0, 1.5)),
        ('int', 10**400, 10**400),
        ('float', np.bool_(True), None),
        ('int', 3.0, None),
    ],
)
def test_a_number_of_numpy_becomes_a_plain_one(kind: str, value: Any, plain: Any) -> None:
    row = Parameter('x', kind, 1, '')
    if plain is None:
        with pytest.raises(ConfigurationError, match=r'^x = '):
            row.checked('x', {'x': value})
    else:
        checked = row.checked('x', {'x': value})
        assert (checked, type(checked)) == (plain, type(plain))
