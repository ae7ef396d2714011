# SPDX-License-Identifier: Apache-2.0
"""Telemetry in: one subscription for each topic and type, feeding every bearing that reads it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from rclpy.lifecycle import LifecycleNode
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

from stickslip_monitor.errors import RosError
from stickslip_monitor.monitor.config import MonitorConfig
from stickslip_monitor.ros.message_types import (
    ROS_FAULTS,
    check_field,
    message_type,
    number_reader,
    stamp_reader,
)

# Two seconds at 1 kHz while the machine is busy; best effort matches every publisher.
_TELEMETRY = QoSProfile(
    depth=2000,
    history=HistoryPolicy.KEEP_LAST,
    reliability=ReliabilityPolicy.BEST_EFFORT,
    durability=DurabilityPolicy.VOLATILE,
)
# Messages of a topic that are taken in one go before the other callbacks have their turn.
_BURST = 50


@dataclass(frozen=True, slots=True)
class InputReader:
    """One number that a message brings for one bearing."""

    bearing: str
    is_load: int
    number: Callable[[Any], float]


def check_inputs(config: MonitorConfig) -> None:
    """Check that every input's message type exists and its field leads to a number.

    Raises:
        RosError: One does not, or two inputs give one topic different types.
    """
    users: dict[str, tuple[str, str]] = {}
    for bearing in config.bearings:
        for quantity, source in (('speed', bearing.speed), ('load', bearing.load)):
            name = f'{bearing.name}.{quantity}'
            check_field(name, source)
            user, kind = users.setdefault(source.topic, (name, source.type))
            if kind != source.type:
                raise RosError(
                    f"{name}.type = '{source.type}' must be the same as {user}.type = '{kind}':"
                    f' both are read from {source.topic}'
                )


class Inputs:
    """The subscriptions of an active node.

    Args:
        node: The node.
        config: The configuration.
        receive: Called with ``(bearing, is_load, time_ns, value, latest)`` for every number;
            ``latest`` is false where a later message of its topic has come already.
        tap: Called with topic, message and its time [ns] before the numbers of it, if given.
    """

    def __init__(
        self,
        node: LifecycleNode,
        config: MonitorConfig,
        receive: Callable[[str, int, int, float, bool], None],
        tap: Callable[[str, Any, int], None] | None = None,
    ) -> None:
        self._node = node
        self._receive = receive
        self._tap = tap
        readings: dict[tuple[str, str], list[InputReader]] = {}
        for bearing in config.bearings:
            for is_load, source in enumerate((bearing.speed, bearing.load)):
                reading = InputReader(bearing.name, is_load, number_reader(source.field))
                readings.setdefault((source.topic, source.type), []).append(reading)
        self._subscriptions: list[Any] = []
        try:
            for (topic, kind), readers in readings.items():
                queue: list[Any] = []
                callback = self._callback(topic, kind, readers, queue)
                queue.append(
                    node.create_subscription(message_type(kind), topic, callback, _TELEMETRY)
                )
                self._subscriptions += queue
        except ROS_FAULTS:
            self.destroy()
            raise

    def destroy(self) -> None:
        """Take the subscriptions down."""
        for subscription in self._subscriptions:
            self._node.destroy_subscription(subscription)

    def _callback(
        self, topic: str, kind: str, readers: list[InputReader], queue: list[Any]
    ) -> Callable[[Any], None]:
        stamp = stamp_reader(kind)
        clock = self._node.get_clock()
        name = self._node.resolve_topic_name(topic)

        def take(message: Any, latest: bool) -> None:
            # The time of measurement where the message carries it, else that of its arrival.
            time_ns = (stamp(message) if stamp else 0) or clock.now().nanoseconds
            if time_ns == 0:
                # use_sim_time is set and /clock has said nothing yet: there is no time.
                return
            if self._tap is not None:
                self._tap(name, message, time_ns)
            for reading in readers:
                number = reading.number(message)
                self._receive(reading.bearing, reading.is_load, time_ns, number, latest)

        def receive(message: Any) -> None:
            """Take a message and those that wait behind it: a turn of the executor is dear."""
            for _ in range(_BURST):
                following = _waiting(queue[0])
                take(message, following is None)
                if following is None:
                    return
                message = following
            take(message, True)

        return receive


def _waiting(subscription: Any) -> Any:
    """The next message of a subscription, taken as rclpy's executors do; ``None`` for none."""
    with subscription.handle:
        taken = subscription.handle.take_message(subscription.msg_type, subscription.raw)
    return None if taken is None else taken[0]
