# SPDX-License-Identifier: Apache-2.0
"""Telemetry in: one subscription for each topic and type, feeding every bearing that reads it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from rclpy.lifecycle import LifecycleNode
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

from stickslip_monitor.monitor.config import MonitorConfig
from stickslip_monitor.ros.messages import (
    check_field,
    message_type,
    number_reader,
    stamp_reader,
)

# Deep enough for a burst at 1 kHz while the node is busy; best effort matches every publisher.
_TELEMETRY = QoSProfile(
    depth=500,
    history=HistoryPolicy.KEEP_LAST,
    reliability=ReliabilityPolicy.BEST_EFFORT,
    durability=DurabilityPolicy.VOLATILE,
)


@dataclass(frozen=True, slots=True)
class Reading:
    """One number that a message brings for one bearing."""

    bearing: str
    is_load: int
    number: Callable[[Any], float]


def check_inputs(config: MonitorConfig) -> None:
    """Check that every input's message type exists and its field leads to a number.

    Raises:
        RosError: One does not.
    """
    for bearing in config.bearings:
        check_field(f'{bearing.name}.speed', bearing.speed)
        check_field(f'{bearing.name}.load', bearing.load)


class Inputs:
    """The subscriptions of an active node.

    Args:
        node: The node.
        config: The configuration.
        receive: Called with ``(bearing, is_load, time_ns, value)`` for every number.
    """

    def __init__(
        self,
        node: LifecycleNode,
        config: MonitorConfig,
        receive: Callable[[str, int, int, float], None],
    ) -> None:
        self._node = node
        self._receive = receive
        readings: dict[tuple[str, str], list[Reading]] = {}
        for bearing in config.bearings:
            for is_load, source in enumerate((bearing.speed, bearing.load)):
                reading = Reading(bearing.name, is_load, number_reader(source.field))
                readings.setdefault((source.topic, source.type), []).append(reading)
        self._subscriptions = [
            node.create_subscription(
                message_type(kind), topic, self._callback(kind, readers), _TELEMETRY
            )
            for (topic, kind), readers in readings.items()
        ]

    def destroy(self) -> None:
        """Take the subscriptions down."""
        for subscription in self._subscriptions:
            self._node.destroy_subscription(subscription)

    def _callback(self, kind: str, readers: list[Reading]) -> Callable[[Any], None]:
        stamp = stamp_reader(kind)
        clock = self._node.get_clock()

        def receive(message: Any) -> None:
            # The time of measurement where the message carries it, else that of its arrival.
            time_ns = (stamp(message) if stamp else 0) or clock.now().nanoseconds
            for reading in readers:
                self._receive(reading.bearing, reading.is_load, time_ns, reading.number(message))

        return receive
