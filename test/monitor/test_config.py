# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import pytest

from stickslip_monitor import MonitorConfig, Stribeck, Tabulated, build_config
from stickslip_monitor.errors import ConfigurationError
from stickslip_monitor.monitor.config import BEARING_PARAMETERS
from stickslip_monitor.monitor.parameter import REQUIRED
from stickslip_monitor.physics.friction import Stretched

Configure = Callable[..., MonitorConfig]
MISSING = object()


def _build(reference: dict[str, Any], **changes: Any) -> MonitorConfig:
    values = {'bearings': ['aft']} | {f'aft.{k}': v for k, v in reference.items()}
    values |= {key.replace('__', '.'): value for key, value in changes.items()}
    return build_config({k: v for k, v in values.items() if v is not MISSING})


def test_every_value_reaches_its_place(configure: Configure) -> None:
    config = configure(
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


# One of each kind of rule, and of what is no number.
BAD_VALUES = [
    ('mass', -1.0, 'aft.mass = -1.0 must be a finite number above 0 kg'),
    ('mass', '50', "aft.mass = '50' must be a finite number above 0 kg"),
    ('mass', True, 'aft.mass = True must be a finite number above 0 kg'),
    ('damping', -1e-9, 'aft.damping = -1e-09 must be a finite number not below 0 N s/m'),
    ('speed.unit', 'knots', "aft.speed.unit = 'knots' must be one of rpm, rad/s, Hz, m/s"),
    ('load.unit', False, 'aft.load.unit = False must be one of N, kN'),
    ('load.timeout', 1.1e9, 'aft.load.timeout = 1100000000.0 must be a finite number above 0 and'),
    ('load.scale', 0, 'aft.load.scale = 0 must be a finite number other than 0'),
    ('speed.offset', math.nan, 'aft.speed.offset = nan must be a finite number'),
    ('speed.topic', 7, 'aft.speed.topic = 7 must be a text'),
    ('alarm.hysteresis', 0.91, 'aft.alarm.hysteresis = 0.91 must be a finite number not below 0'),
    ('alarm.amplitude_limit', math.nan, 'aft.alarm.amplitude_limit = nan must be a number above'),
    ('load.topic', 'a/1', "aft.load.topic = 'a/1' must be a ROS topic"),
    ('load.topic', '/a//b', "aft.load.topic = '/a//b' must be a ROS topic"),
    ('load.topic', '/a\n', 'must be a ROS topic'),
    ('speed.type', 'std_msgs/Float64', 'package/msg/Type'),
    ('speed.type', 'std_msgs/msg/float64', 'package/msg/Type'),
    ('load.field', 'a..b', "aft.load.field: field 'a..b' is not a pa"),
]


@pytest.mark.parametrize(('name', 'value', 'text'), BAD_VALUES)
def test_bad_value_is_named_with_its_rule(
    configure: Configure, name: str, value: Any, text: str
) -> None:
    with pytest.raises(ConfigurationError) as caught:
        configure(**{name: value})
    assert text in str(caught.value)
    assert '\n' not in str(caught.value)


def test_edges_of_ranges_are_allowed(configure: Configure) -> None:
    edges = {'alarm__hysteresis': 0.9, 'alarm__amplitude_limit': math.inf, 'alarm__on_delay': 0}
    aft = configure(damping=0.0, speed__timeout=1e9, **edges).bearing('aft')
    assert (aft.bearing.damping, aft.speed.timeout_ns, aft.alarm.on_delay_ns) == (0.0, 10**18, 0)


@pytest.mark.parametrize(
    'name', [p.name for p in BEARING_PARAMETERS if p.default is REQUIRED] + ['bearings']
)
def test_a_required_parameter_is_asked_for(reference: dict[str, Any], name: str) -> None:
    full = name if name == 'bearings' else f'aft.{name}'
    with pytest.raises(ConfigurationError, match=f"parameter '{full}'.* is missing"):
        _build(reference, **{full: MISSING})


def test_a_missing_parameter_is_told_with_unit_and_meaning(reference: dict[str, Any]) -> None:
    with pytest.raises(ConfigurationError) as caught:
        _build(reference, **{'aft.mass': MISSING})
    assert str(caught.value) == (
        "parameter 'aft.mass' [kg] is missing: Moving mass of the lining."
    )


@pytest.mark.parametrize(
    ('key', 'close'),
    [
        ('aft.mas', 'aft.mass'),
        ('aft.friction.statik', 'aft.friction.static'),
        ('autostrat', 'autostart'),
    ],
)
def test_an_unknown_key_is_refused_with_a_suggestion(
    reference: dict[str, Any], key: str, close: str
) -> None:
    with pytest.raises(ConfigurationError) as caught:
        _build(reference, **{key: 1.0})
    assert str(caught.value) == f"unknown parameter '{key}' = 1.0; did you mean '{close}'?"


def test_a_misspelt_required_key_is_named_before_the_missing_one(
    reference: dict[str, Any],
) -> None:
    with pytest.raises(ConfigurationError, match=r"'aft\.masss' = 50\.0; did you mean"):
        _build(reference, **{'aft.mass': MISSING, 'aft.masss': 50.0})


def test_a_section_that_is_not_a_bearing_is_refused(reference: dict[str, Any]) -> None:
    with pytest.raises(ConfigurationError, match=r"section 'forward' is not a bearing.*lists aft"):
        _build(reference, **{'forward.mass': 50.0})


@pytest.mark.parametrize(
    ('names', 'text'),
    [
        ([], 'must name at least one bearing'),
        (['aft', 'aft'], "'aft' is listed twice"),
        (['Aft'], "'Aft' must be a name of lower-case letters"),
        (['aft/x'], "'aft/x' must be a name"),
        (['äft'], "'äft' must be a name"),
        (['aft\n'], 'must be a name'),
        ('aft', "bearings = 'aft' must be a list of texts"),
        ([1], r'bearings = \[1\] must be a list of texts'),
    ],
)
def test_bearing_names(reference: dict[str, Any], names: Any, text: str) -> None:
    with pytest.raises(ConfigurationError, match=text):
        _build(reference, bearings=names)


@pytest.mark.parametrize(
    ('law', 'absent'),
    [
        ('stribeck', 'decay'),
        ('coulomb', 'static'),
        ('tabulated', 'coefficient'),
    ],
)
def test_a_law_asks_for_what_it_needs(reference: dict[str, Any], law: str, absent: str) -> None:
    changes = {
        'aft.friction.law': law,
        'aft.friction.speed': [0.0, 1.0],
        'aft.friction.coefficient': [0.3, 0.1],
        f'aft.friction.{absent}': MISSING,
    }
    with pytest.raises(ConfigurationError) as caught:
        _build(reference, **changes)
    expected = f"parameter 'aft.friction.{absent}' is missing: the law {law} needs "
    assert str(caught.value).startswith(expected)


def test_laws_are_built_from_their_numbers(configure: Configure) -> None:
    table = configure(
        friction__law='tabulated',
        friction__speed=[0, 0.5, 2],
        friction__coefficient=[0.3, 0.2, 0.1],
    )
    assert table.bearings[0].bearing.friction == Tabulated([0.0, 0.5, 2.0], [0.3, 0.2, 0.1])
    stretched = configure(friction__exponent=2.0).bearings[0].bearing.friction
    assert stretched == Stretched(0.3, 0.1, 10.0, 0.0, 2.0)


TORSIONAL = {'inertia': 0.125, 'torsional_damping': 1.0, 'torsional_stiffness': 5000.0}


def test_a_lining_is_given_by_torsional_values_too(reference: dict[str, Any]) -> None:
    both = {'bearings': ['aft']} | {
        f'aft.{name}': value for name, value in (reference | TORSIONAL).items()
    }
    with pytest.raises(ConfigurationError, match=r"^'aft\.mass' and 'aft\.inertia' are given: "):
        build_config(both)
    plain = {f'aft.{name}' for name in ('mass', 'damping', 'stiffness')}
    alone = {name: value for name, value in both.items() if name not in plain}
    # Each over the square of a radius of 50 mm.
    own = build_config(alone).bearings[0].bearing
    assert (own.mass, own.damping, own.stiffness) == pytest.approx((50.0, 400.0, 2.0e6))
    del alone['aft.torsional_damping']
    with pytest.raises(ConfigurationError, match=r"^parameter 'aft\.torsional_damping' \[N m s"):
        build_config(alone)


@pytest.mark.parametrize(
    ('speed', 'coefficient', 'text'),
    [
        ([0.0], [0.3], r'^aft: friction table has 1 point: give at least two'),
        ([0.0, -1.0], [0.3, 0.1], r'^aft\.friction\.speed = \[0\.0, -1\.0\] must be a list of'),
        ([0.0, 1.0], [0.3, math.nan], r'^aft\.friction\.coefficient = \[0\.3, nan\] must be'),
        ([0.0, True], [0.3, 0.1], r'^aft\.friction\.speed = \[0\.0, True\] must be a list'),
        ('01', [0.3, 0.1], r"^aft\.friction\.speed = '01' must be a list of finite numbers"),
        ([], [0.3, 0.1], r"^parameter 'aft\.friction\.speed' is missing"),
    ],
)
def test_bad_tables(configure: Configure, speed: Any, coefficient: Any, text: str) -> None:
    with pytest.raises(ConfigurationError, match=text):
        configure(
            friction__law='tabulated', friction__speed=speed, friction__coefficient=coefficient
        )


def test_minimum_speed_is_below_the_maximum(configure: Configure) -> None:
    assert configure(alarm__minimum_speed=0.99, speed__maximum=1.0).bearings
    with pytest.raises(ConfigurationError) as caught:
        configure(alarm__minimum_speed=1.0, speed__maximum=1.0)
    assert str(caught.value) == (
        'aft.alarm.minimum_speed = 1 m/s must be below aft.speed.maximum = 1 m/s'
    )


def test_a_rule_broken_by_the_second_bearing_names_the_second(reference: dict[str, Any]) -> None:
    forward = {f'forward.{k}': v for k, v in reference.items()} | {'forward.mass': -2.0}
    with pytest.raises(ConfigurationError, match=r'^forward\.mass = -2\.0 must be'):
        _build(reference, bearings=['aft', 'forward'], **forward)


def test_a_retired_parameter_has_no_effect_and_a_sentence(configure: Configure) -> None:
    config = configure(alarm__trend_window='whatever')
    assert config == configure()
    (note,) = config.notes
    assert note.startswith('aft.alarm.trend_window has no effect and will be refused')
    assert configure().notes == ()
