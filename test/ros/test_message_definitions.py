# SPDX-License-Identifier: Apache-2.0
"""Definitions made from Python classes, held to those another library has of the same types."""

from __future__ import annotations

from typing import Any

import pytest

pytest.importorskip('rclpy', reason='ROS 2 is not installed')

from stickslip_monitor.errors import RosError
from stickslip_monitor.ros.message_types import _type, definition


@pytest.mark.parametrize(
    'kind',
    [
        'std_msgs/msg/Float64',
        'std_msgs/msg/String',
        'std_msgs/msg/ByteMultiArray',
        'sensor_msgs/msg/JointState',
        'sensor_msgs/msg/Imu',
        'geometry_msgs/msg/WrenchStamped',
        'geometry_msgs/msg/PoseWithCovarianceStamped',
        'diagnostic_msgs/msg/DiagnosticArray',
    ],
)
def test_fields_are_those_of_the_published_definition(kind: str) -> None:
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
        ('string<10>', 'string<=10'),
        ('float[9]', 'float32[9]'),
        ('geometry_msgs/Point[3]', 'geometry_msgs/Point[3]'),
        ('boolean', 'bool'),
        ('uint8', 'uint8'),
        ('wstring', 'wstring'),
    ],
)
def test_bounds_and_arrays(text: str, expected: str) -> None:
    assert _type(text) == expected


def test_a_type_that_is_not_installed_is_named() -> None:
    with pytest.raises(RosError, match='package no_msgs is not installed'):
        definition('no_msgs/msg/Thing')
