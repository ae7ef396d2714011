# SPDX-License-Identifier: Apache-2.0
"""Publishes what the ship's buses bring, on the topics that a monitor listens to."""

from __future__ import annotations

from collections.abc import Iterable

from rclpy.node import Node
from rclpy.publisher import Publisher
from std_msgs.msg import Float64

from stickslip_monitor.errors import RosError
from stickslip_monitor.monitor.config import MonitorConfig
from stickslip_monitor.ros.message_types import ROS_FAULTS

TYPE, FIELD = 'std_msgs/msg/Float64', 'data'
_DEPTH = 10


class Bridge:
    """A publisher for each input that comes from a bus.

    Args:
        node: The node that publishes.
        monitor: Full name of the monitor's node, to which names of topics are relative.
        config: The configuration of the monitor.
        inputs: Bearing and whether it is the load, of each input.

    Raises:
        RosError: An input is configured for other messages, or its topic's name is none.
    """

    def __init__(
        self,
        node: Node,
        monitor: str,
        config: MonitorConfig,
        inputs: Iterable[tuple[str, int]],
    ) -> None:
        self._publishers: dict[tuple[str, int], Publisher[Float64]] = {}
        topics = set()
        for name, is_load in inputs:
            bearing = config.bearing(name)
            source = bearing.load if is_load else bearing.speed
            if (source.type, source.field_text) != (TYPE, FIELD):
                raise RosError(
                    f"{name}.{'load' if is_load else 'speed'}.type = '{source.type}' must be"
                    f" {TYPE}, field '{FIELD}': what a bus brings is published so"
                )
            # Of two bearings on one shaft the first brings the speed for both.
            if source.topic in topics:
                continue
            topics.add(source.topic)
            try:
                publisher = node.create_publisher(
                    Float64, _resolved(source.topic, monitor), _DEPTH
                )
            except ROS_FAULTS as error:
                raise RosError(f'{source.topic} cannot be published: {error}') from error
            self._publishers[name, is_load] = publisher

    def take(self, bearing: str, is_load: int, value: float) -> None:
        """Publish one number."""
        if (bearing, is_load) in self._publishers:
            self._publishers[bearing, is_load].publish(Float64(data=value))


def _resolved(topic: str, monitor: str) -> str:
    """The full name of a topic, as the monitor's node resolves it."""
    if topic.startswith('~'):
        return f'{monitor}{topic[1:]}'
    return topic if topic.startswith('/') else f'{monitor.rpartition("/")[0]}/{topic}'
