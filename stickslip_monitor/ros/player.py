# SPDX-License-Identifier: Apache-2.0
"""Publishes recorded messages with their timing, and /clock, where rosbag2 is not installed."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Any

import rclpy
from rclpy.duration import Duration
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock

from stickslip_monitor.errors import RosError
from stickslip_monitor.ros.inputs import ROS_FAULTS, import_message_type
from stickslip_monitor.ros.other_nodes import without_log_files

CLOCK_PERIOD = 0.02
"""Time between two messages on /clock [s]."""
# Time without a new subscriber after which no further one is awaited [s].
_SETTLE = 0.5
# How long a subscriber on a busy machine may take for what is left in the queue [s].
_PATIENCE = 10.0
# Messages that wait for the middleware: a second of 1 kHz; a lost one of /clock is followed by the next.
_QOS = QoSProfile(depth=1000, reliability=ReliabilityPolicy.RELIABLE)
_CLOCK_QOS = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)

Recorded = tuple[str, int, bytes]
"""Topic, when it was recorded [ns], and the message, still encoded."""


class Player:
    """A node that publishes encoded messages on their topics, and /clock.

    Args:
        types: Message type of each topic; a recorded /clock is skipped.

    Attributes:
        skipped: Topics that cannot be played, with the reason.
    """

    def __init__(self, types: dict[str, str]) -> None:
        self.node = Node('stickslip_player')
        self.skipped: dict[str, str] = {}
        self._publishers: dict[str, Any] = {}
        self._clock = self.node.create_publisher(Clock, '/clock', _CLOCK_QOS)
        for topic, kind in types.items():
            if topic == '/clock':
                self.skipped[topic] = 'the player publishes a clock of its own'
                continue
            try:
                self._publishers[topic] = self.node.create_publisher(import_message_type(kind), topic, _QOS)
            except (RosError, *ROS_FAULTS) as error:
                self.skipped[topic] = ' '.join(str(error).split())

    def wait_for_subscribers(self, seconds: float) -> bool:
        """Wait for up to ``seconds`` [s] until there is a subscriber and no further one appears for a moment.

        Returns:
            Whether there is a subscriber.
        """
        end = time.monotonic() + seconds
        count, since = 0, time.monotonic()
        while time.monotonic() < end:
            listeners = sum(p.get_subscription_count() for p in self._publishers.values())
            if listeners != count:
                count, since = listeners, time.monotonic()
            if count and time.monotonic() - since > _SETTLE:
                return True
            time.sleep(0.05)
        return count > 0

    def play(
        self, messages: Iterable[Recorded], rate: float, progress: Callable[[int], None] | None = None
    ) -> int:
        """Publish messages at their recorded times divided by the rate, and /clock meanwhile.

        Blocks until all are published and, for up to :data:`_PATIENCE` s a topic, received; a topic whose
        readers take longer is logged.

        Args:
            messages: In order of time.
            rate: How much faster than recorded, > 0.
            progress: Called with the recorded time reached [ns]; ``None`` for nobody.

        Returns:
            The number of messages published; those on skipped topics do not count.

        Raises:
            RosError: A subscriber does not keep up.
            KeyboardInterrupt: ROS was shut down.
        """
        begin, first, played = time.monotonic(), None, 0
        for topic, time_ns, data in messages:
            if topic not in self._publishers:
                continue
            first = time_ns if first is None else first
            self._run_clock(begin, first, time_ns, rate)
            if progress is not None:
                progress(time_ns)
            publish_message(self._publishers[topic], data)
            played += 1
        for topic, publisher in self._publishers.items():
            if not publisher.wait_for_all_acked(Duration(seconds=_PATIENCE)):
                text = f'{topic}: a subscriber has not acknowledged all messages within {_PATIENCE:g} s'
                self.node.get_logger().warning(text)
        return played

    def _run_clock(self, begin: float, first: int, target: int, rate: float) -> None:
        """Block until a message is due, and publish /clock up to its time meanwhile.

        Raises RosError or KeyboardInterrupt, see :meth:`_publish_clock`.

        Args:
            begin: When the first message was due, by ``time.monotonic`` [s].
            first: Recorded time of the first message [ns].
            target: Recorded time of the message to wait for [ns].
            rate: How much faster than recorded.
        """
        due = begin + (target - first) * 1e-9 / rate
        while (left := due - time.monotonic()) > 0.0:
            time.sleep(min(left, CLOCK_PERIOD))
            now = first + int((time.monotonic() - begin) * rate * 1e9)
            self._publish_clock(min(now, target))
        self._publish_clock(target)

    def _publish_clock(self, time_ns: int) -> None:
        """Publish a time [ns] on /clock.

        Raises:
            RosError: A subscriber does not keep up.
            KeyboardInterrupt: ROS was shut down.
        """
        message = Clock()
        message.clock.sec, message.clock.nanosec = divmod(time_ns, 10**9)
        publish_message(self._clock, message)


def publish_message(publisher: Any, message: Any) -> None:
    """Publish a message; while the queue is full, wait for its readers, for up to a second.

    Raises:
        RosError: A subscriber does not keep up.
        KeyboardInterrupt: ROS was shut down.
    """
    for _ in range(200):
        try:
            publisher.publish(message)
            return
        except rclpy_implementation.RCLError:
            if not rclpy.ok():
                raise KeyboardInterrupt from None
            # The reliable queue is full: give the readers a moment.
            time.sleep(0.005)
    raise RosError(f'a subscriber of {publisher.topic_name} does not keep up: play slower')


@contextmanager
def open_player(types: dict[str, str]) -> Iterator[Player]:
    """Yield a player, with ROS running until the block ends; ``types`` has the message type of each topic.

    ROS takes the arguments of this process. A topic that cannot be played raises nothing: see
    :attr:`Player.skipped`.
    """
    rclpy.init(args=without_log_files(sys.argv))
    try:
        player = Player(types)
        try:
            yield player
        finally:
            player.node.destroy_node()
    finally:
        rclpy.try_shutdown()
