# SPDX-License-Identifier: Apache-2.0
"""The number in a message, its time, and the definition of its type."""

from __future__ import annotations

import math
from typing import Any

import pytest

pytest.importorskip('rclpy', reason='ROS 2 is not installed')

from sensor_msgs.msg import JointState, MagneticField
from std_msgs.msg import Byte, Float64, Header

from stickslip_monitor import build_config
from stickslip_monitor.errors import RosError
from stickslip_monitor.fields import parse_field
from stickslip_monitor.ros.inputs import check_inputs
from stickslip_monitor.ros.message_types import _type, definition, number_reader, stamp_reader

JOINT = 'sensor_msgs/msg/JointState'
COVARIANCE = 'magnetic_field_covariance'


@pytest.mark.parametrize(
    ('change', 'text'),
    [
        ({'speed.type': 'std_msgs/msg/Speed'}, "package std_msgs has no message type 'Speed'"),
        (
            {'speed.type': 'std_msgs/msg/String'},
            "aft.speed.field 'data' of std_msgs/msg/String is a string, not a number",
        ),
        (
            {'speed.type': JOINT, 'speed.field': 'velocity'},
            f"aft.speed.field 'velocity' of {JOINT} is a sequence<double>, not a number",
        ),
        (
            {'speed.field': 'data[0]'},
            "aft.speed.field 'data[0]': [0] needs an array, but there is a double",
        ),
        (
            {'load.field': 'data.value'},
            "aft.load.field 'data.value': double has no field 'value'; it has: none, it is a"
            ' double',
        ),
        (
            {'speed.type': 'sensor_msgs/msg/MagneticField', 'speed.field': f'{COVARIANCE}[9]'},
            f"aft.speed.field '{COVARIANCE}[9]': index 9 is outside double[9]",
        ),
        (
            {'load.topic': 'shaft/speed', 'load.type': 'std_msgs/msg/Float32'},
            "aft.load.type = 'std_msgs/msg/Float32' must be the same as aft.speed.type ="
            " 'std_msgs/msg/Float64': both are read from shaft/speed",
        ),
        (
            {'load.topic': '/monitor/aft/amplitude'},
            "aft.load.topic = '/monitor/aft/amplitude' is published by this node itself",
        ),
    ],
)
def test_an_input_that_leads_to_no_number_is_refused(
    kit: Any, change: dict[str, Any], text: str
) -> None:
    outputs = {'/monitor/aft/amplitude'}
    check_inputs(build_config(kit.parameters()), outputs)
    with pytest.raises(RosError) as error:
        check_inputs(build_config(kit.parameters(change)), outputs)
    assert str(error.value) == text


@pytest.mark.parametrize(
    ('message', 'path', 'number'),
    [
        (Float64(data=1.5), 'data', 1.5),
        (Byte(data=b'\xfa'), 'data', 250.0),
        (JointState(velocity=[1.0, 2.0]), 'velocity[1]', 2.0),
        (JointState(velocity=[1.0, 2.0]), 'velocity[2]', math.nan),  # an array too short
        (
            MagneticField(magnetic_field_covariance=[float(k) for k in range(9)]),
            f'{COVARIANCE}[8]',
            8.0,
        ),
        (JointState(header=Header()), 'header.stamp.sec', 0.0),
    ],
)
def test_the_number_at_a_path(message: Any, path: str, number: float) -> None:
    assert number_reader(parse_field(path))(message) == pytest.approx(number, nan_ok=True)


def test_the_stamp_of_a_header() -> None:
    message = JointState()
    message.header.stamp.sec, message.header.stamp.nanosec = 1_700_000_000, 999_999_999
    read = stamp_reader(JOINT)
    assert read is not None
    assert read(message) == 1_700_000_000_999_999_999
    assert stamp_reader('std_msgs/msg/Float64') is None


@pytest.mark.parametrize(
    'kind',
    [
        'std_msgs/msg/ByteMultiArray',
        'sensor_msgs/msg/JointState',
        'geometry_msgs/msg/PoseWithCovarianceStamped',
        'diagnostic_msgs/msg/DiagnosticArray',
    ],
)
def test_a_definition_has_the_fields_of_the_published_one(kind: str) -> None:
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    made: dict[str, Any] = get_types_from_msg(definition(kind), kind)
    published = get_types_from_msg(store.generate_msgdef(kind, ros_version=2)[0], kind)
    assert set(made) == set(published)
    for name, (_, fields) in made.items():
        assert fields == store.fielddefs[name][1], name


@pytest.mark.parametrize(
    ('text', 'expected'),
    [
        ('sequence<double, 5>', 'float64[<=5]'),
        ('sequence<string<10>>', 'string<=10[]'),
        ('float[9]', 'float32[9]'),
        ('geometry_msgs/Point[3]', 'geometry_msgs/Point[3]'),
        ('boolean', 'bool'),
    ],
)
def test_bounds_and_arrays(text: str, expected: str) -> None:
    assert _type(text) == expected


def test_a_type_that_is_not_installed_is_named() -> None:
    with pytest.raises(RosError, match='package no_msgs is not installed'):
        definition('no_msgs/msg/Thing')
