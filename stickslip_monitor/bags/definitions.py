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


MESSAGE_TYPES: Mapping[str, MessageType] = {
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
