# SPDX-License-Identifier: Apache-2.0
"""The message types this package writes itself: definition and ROS 2 type hash of each."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class MessageType:
    """A message type: its ``ros2msg`` text, and its hash (REP 2016), empty when unknown."""

    definition: str
    type_hash: str = ''


_RULE = '=' * 80
_HEADER = f"""{_RULE}
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
{_RULE}
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
_VECTOR3 = f"""{_RULE}
MSG: geometry_msgs/Vector3
float64 x
float64 y
float64 z
"""


def _stamped(name: str, first: str, second: str) -> str:
    """Definition of a header and a pair of vectors."""
    return (
        f'std_msgs/Header header\ngeometry_msgs/{name} {name.lower()}\n{_HEADER}'
        f'{_RULE}\nMSG: geometry_msgs/{name}\n'
        f'geometry_msgs/Vector3 {first}\ngeometry_msgs/Vector3 {second}\n{_VECTOR3}'
    )


_DIAGNOSTICS = f"""std_msgs/Header header
diagnostic_msgs/DiagnosticStatus[] status
{_HEADER}{_RULE}
MSG: diagnostic_msgs/DiagnosticStatus
byte OK=0
byte WARN=1
byte ERROR=2
byte STALE=3
byte level
string name
string message
string hardware_id
diagnostic_msgs/KeyValue[] values
{_RULE}
MSG: diagnostic_msgs/KeyValue
string key
string value
"""


MESSAGE_TYPES: Mapping[str, MessageType] = {
    'diagnostic_msgs/msg/DiagnosticArray': MessageType(
        _DIAGNOSTICS,
        'RIHS01_5a8a36efb05fb25070fa0fb3810290c0e6cd4862b54a8fb975a1ee8dc55a333e',
    ),
    'geometry_msgs/msg/TwistStamped': MessageType(
        _stamped('Twist', 'linear', 'angular'),
        'RIHS01_5f0fcd4f81d5d06ad9b4c4c63e3ea51b82d6ae4d0558f1d475229b1121db6f64',
    ),
    'geometry_msgs/msg/WrenchStamped': MessageType(
        _stamped('Wrench', 'force', 'torque'),
        'RIHS01_8dc3deaf06b2ab281f9f9a742a8961c328ca7cec16e3fd6586d3a5c83fa78f77',
    ),
    'std_msgs/msg/Bool': MessageType(
        'bool data\n',
        'RIHS01_feb91e995ff9ebd09c0cb3d2aed18b11077585839fb5db80193b62d74528f6c9',
    ),
    'std_msgs/msg/Float64': MessageType(
        'float64 data\n',
        'RIHS01_705ba9c3d1a09df43737eb67095534de36fd426c0587779bda2bc51fe790182a',
    ),
    'std_msgs/msg/String': MessageType(
        'string data\n',
        'RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18',
    ),
}
