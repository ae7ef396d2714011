# SPDX-License-Identifier: Apache-2.0
"""Publishes what the ship's buses bring, on the topics that a monitor listens to."""

from __future__ import annotations

from collections.abc import Iterable

from rclpy.node import Node
from rclpy.publisher import Publisher
from std_msgs.msg import Float64

from stickslip_monitor.errors import RosError
from stickslip_monitor.monitor.config import MonitorConfig
from stickslip_monitor.monitor.signals import Input
from stickslip_monitor.ros.message_types import ROS_FAULTS

TYPE, FIELD = 'std_msgs/msg/Float64', 'data'
_DEPTH = 10


class Bridge:
    """A publisher for each input that comes from a bus.

    Args:
        node: The node that publishes.
        monitor: Full name of the monitor's node, to which names of topics are relative.
        config: The configuration of the monitor.
        inputs: Bearing and input, of each that comes from a bus.

    Raises:
        RosError: An input is configured for other messages, or its topic's name is none.
    """

    def __init__(
        self,
        node: Node,
        monitor: str,
        config: MonitorConfig,
        inputs: Iterable[tuple[str, Input]],
    ) -> None:
        self._publishers: dict[tuple[str, Input], Publisher[Float64]] = {}
        topics = set()
        for name, which in inputs:
            bearing = config.bearing(name)
            quantity = which.name.lower()
            source = bearing.inputs[quantity]
            if (source.type, source.field_text) != (TYPE, FIELD):
                raise RosError(
                    f"{name}.{quantity}.type = '{source.type}' must be"
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
            self._publishers[name, which] = publisher

    def take(self, bearing: str, which: Input, value: float) -> None:
        """Publish one number."""
        if (bearing, which) in self._publishers:
            self._publishers[bearing, which].publish(Float64(data=value))


def _resolved(topic: str, monitor: str) -> str:
    """The full name of a topic, as the monitor's node resolves it."""
    if topic.startswith('~'):
        return f'{monitor}{topic[1:]}'
    return topic if topic.startswith('/') else f'{monitor.rpartition("/")[0]}/{topic}'
