# SPDX-License-Identifier: Apache-2.0
"""Telemetry in: one subscription for each topic and type, feeding every bearing that reads it."""

from __future__ import annotations

import heapq
import operator
import sys
from collections.abc import Callable, Container, Iterator, Sequence
from functools import partial
from typing import Any, NamedTuple

from rclpy.lifecycle import LifecycleNode
from rclpy.node import Node
from rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    QoSCompatibility,
    QoSProfile,
    ReliabilityPolicy,
    qos_check_compatible,
)
from rclpy.qos_overriding_options import QoSOverridingOptions

from stickslip_monitor.errors import RosError
from stickslip_monitor.monitor.config import MonitorConfig
from stickslip_monitor.monitor.health import NodeHealth
from stickslip_monitor.monitor.input_watch import Graph, Publisher
from stickslip_monitor.monitor.source_faults import StampGaps
from stickslip_monitor.ros.message_types import (
    check_field,
    message_type,
    number_reader,
    stamp_reader,
)

# Two seconds at 1 kHz while the machine is busy.
_DEPTH = 2000
MOST_AT_ONCE = 200
"""Of more messages of a topic that wait than these, the others are left out and counted."""
MOST_TOGETHER = 2000
"""The most messages of all topics that a late node takes before it looks at the time."""

Arrival = tuple[int, 'Lane', Any]
"""Time [ns], topic and message."""
Tap = Callable[[str, Any, int | None], None]
"""Takes topic, message and its time [ns]."""
Guard = Callable[[Callable[..., Any]], Callable[..., Any]]
"""Makes a callback whose exceptions are logged and survived."""


def telemetry() -> QoSProfile:
    """A new quality of service of an input (rclpy changes it): best effort matches every one."""
    return QoSProfile(
        depth=_DEPTH,
        history=HistoryPolicy.KEEP_LAST,
        reliability=ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.VOLATILE,
    )


class Number(NamedTuple):
    """One number of one input."""

    bearing: str  # its bearing
    place: int  # the input, a place in :data:`.signals.INPUTS`
    time_ns: int  # when it was measured, or came [ns]
    value: float  # the number, in the input's own scale
    latest: bool  # whether no later number of its bearing has come already


class InputReader(NamedTuple):
    """One number that a message brings for one bearing."""

    bearing: str
    place: int
    number: Callable[[Any], float]


def check_inputs(config: MonitorConfig, outputs: Container[str]) -> None:
    """Check that every input's message type exists and its field leads to a number.

    Args:
        config: The configuration with the full names of its topics.
        outputs: Full names of the topics that the node itself publishes.

    Raises:
        RosError: One does not, two inputs give one topic different types, or one is an output.
    """
    users: dict[str, tuple[str, str]] = {}
    for bearing in config.bearings:
        for quantity, source in bearing.inputs.items():
            name = f'{bearing.name}.{quantity}'
            if source.topic in outputs:
                raise RosError(f"{name}.topic = '{source.topic}' is published by this node itself")
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
        config: The configuration as given: names of topics are resolved once.
        deliver: Called with the numbers of the messages that waited, in order of time.
        now_ns: ROS time [ns]; 0 where it is unknown.
        tap: Called with each message before the numbers of it, if given.
    """

    def __init__(
        self,
        node: LifecycleNode,
        config: MonitorConfig,
        deliver: Callable[[Iterator[Number]], None],
        now_ns: Callable[[], int],
        survived: Guard,
        health: NodeHealth,
        tap: Tap | None = None,
    ) -> None:
        self._health, self._deliver, self._tap = health, deliver, tap
        self._survived = survived
        lanes: dict[tuple[str, str], Lane] = {}
        for bearing in config.bearings:
            for place, source in enumerate(bearing.inputs.values()):
                key = source.topic, source.type
                lane = lanes[key] = lanes.get(key) or Lane(node, now_ns, *key)
                lane.readings.append(InputReader(bearing.name, place, number_reader(source.field)))
                lane.gaps.longest_ns = min(lane.gaps.longest_ns, source.timeout_ns)
        self._lanes = list(lanes.values())

    def subscribe(self) -> None:
        """Listen from now on.

        Raises:
            Exception: One of :data:`.message_types.ROS_FAULTS`: a subscription cannot be made.
        """
        for lane in self._lanes:
            bearings = {reading.bearing for reading in lane.readings}
            lane.beside = [
                other
                for other in self._lanes
                if other is not lane and any(r.bearing in bearings for r in other.readings)
            ]
            lane.subscribe(self._survived(partial(self._on_message, lane)))

    def destroy(self) -> None:
        """Take the subscriptions down."""
        for lane in self._lanes:
            lane.destroy()

    def waiting(self) -> Iterator[Number]:
        """What waits on every topic, for a node that was held up."""
        most = min(MOST_AT_ONCE, MOST_TOGETHER // len(self._lanes) + 1)
        return self._numbers([lane.waiting(most=most) for lane in self._lanes], held_up=True)

    def _on_message(self, lane: Lane, message: Any) -> None:
        """Take a message and those that wait with it: a turn of the executor is dear."""
        found = {lane: lane.waiting(message)}
        lanes = [lane]
        for one in lanes:
            if found[one]:
                new = [other for other in one.beside if other not in found]
                found |= {other: other.waiting() for other in new}
                lanes += new
        self._deliver(self._numbers([found[one] for one in self._lanes if one in found]))

    def _numbers(self, topics: Sequence[list[Arrival]], held_up: bool = False) -> Iterator[Number]:
        """The numbers of what came on some topics in order of time, each topic's in its own."""
        some = [arrivals for arrivals in topics if arrivals]
        by_time = operator.itemgetter(0)
        arrivals = some[0] if len(some) == 1 else list(heapq.merge(*some, key=by_time))
        last = {
            reading.bearing: number
            for number, (_, lane, _) in enumerate(arrivals)
            for reading in lane.readings
        }
        for number, (time_ns, lane, message) in enumerate(arrivals):
            if self._tap is not None:
                self._tap(lane.name, message, time_ns)
            for bearing, place, read in lane.readings:
                latest = last[bearing] == number and not held_up
                yield Number(bearing, place, time_ns, read(message), latest)

    def count_missing(self) -> None:
        """Bring the node's counts of messages that are lost or left out up to date."""
        self._health.lost = sum(lane.lost for lane in self._lanes)
        self._health.missing = sum(lane.gaps.missing for lane in self._lanes)
        self._health.thinned = sum(lane.thinned for lane in self._lanes)


class Lane:
    """One topic: its subscription, and the numbers that its messages bring.

    Args:
        now_ns: ROS time [ns]; 0 where it is unknown.

    Attributes:
        readings: What is read from a message.
        name: The full name of the topic.
        beside: The topics that bring other numbers of its bearings.
        gaps: Counts what is missing by the stamps of the sender.
        thinned: Messages that were left out because too many waited.
        lost: Messages that never came, by the numbers of their publishers.
    """

    def __init__(
        self, node: LifecycleNode, now_ns: Callable[[], int], topic: str, kind: str
    ) -> None:
        self._node, self._now_ns, self._topic, self._kind = node, now_ns, topic, kind
        self.name = node.resolve_topic_name(topic)
        self.readings: list[InputReader] = []
        self.beside: list[Lane] = []
        self.thinned = self.lost = 0
        self.gaps = StampGaps(longest_ns=sys.maxsize)
        self._stamp = stamp_reader(kind)
        self._numbers: dict[bytes, int] = {}
        self._subscription: Any = None
        self._tick_ns = self._shared = self._unnumbered = 0

    def subscribe(self, take: Callable[..., Any]) -> None:
        """Listen from now on."""
        self._subscription = self._node.create_subscription(
            message_type(self._kind),
            self._topic,
            take,
            telemetry(),
            qos_overriding_options=QoSOverridingOptions.with_default_policies(),
        )

    def destroy(self) -> None:
        """Take the subscription down."""
        if self._subscription is not None:
            self._node.destroy_subscription(self._subscription)

    def waiting(self, message: Any = None, most: int = MOST_AT_ONCE) -> list[Arrival]:
        """What waits, a message that was taken already first; of a flood every so many.

        What comes before the first ``/clock`` has no time and is not used.
        """
        found: list[Arrival] = []
        self._unnumbered += message is not None
        message = self._next() if message is None else message
        while message is not None:
            if time_ns := self._time(message):
                found.append((time_ns, self, message))
            message = self._next() if len(found) < _DEPTH else None
        if len(found) <= most:
            return found
        # Nobody must wait until all are worked off; the last is the one that counts.
        step = -(-len(found) // most)
        kept = found[::-step][::-1]
        self.thinned += len(found) - len(kept)
        return kept

    def _next(self) -> Any:
        """The next message, taken as rclpy's executors do; ``None`` for none.

        No public way takes what waits; a turn of the executor for each message costs more than
        all that is done with it (benchmarks/live.py).
        """
        subscription = self._subscription
        with subscription.handle:
            taken = subscription.handle.take_message(subscription.msg_type, subscription.raw)
        if taken is None:
            return None
        self._count_lost(taken[1])
        return taken[0]

    def _count_lost(self, info: Any) -> None:
        """Count what lies between a message and the one before of its publisher.

        An executor does not hand on the numbers of those it takes, and some ROS 2 have none. (The
        event of a lost message does not count those for which the queue had no room.)
        """
        publisher, number = info.get('publisher_gid'), info.get('publication_sequence_number')
        if publisher is None or number is None:
            return
        before = self._numbers.get(publisher['data'])
        self._numbers[publisher['data']] = number
        if before is None:
            self._unnumbered = 0
            return
        missing = max(0, number - before - 1)
        known = min(missing, self._unnumbered)
        self._unnumbered -= known
        self.lost += missing - known

    def _time(self, message: Any) -> int:
        """The time of measurement where the message carries it, else that of its arrival [ns]."""
        if self._stamp is not None and (stamp_ns := self._stamp(message)):
            self.gaps.add(stamp_ns)
            return stamp_ns
        now_ns = self._now_ns()
        # Simulated time moves in ticks: messages that share one keep their order.
        self._shared = self._shared + 1 if now_ns == self._tick_ns and now_ns else 0
        self._tick_ns = now_ns
        return now_ns + self._shared


class RosGraph(Graph):
    """The graph as a node sees it."""

    def __init__(self, node: Node) -> None:
        self._node = node

    def publishers(self, topic: str) -> tuple[Publisher, ...]:
        """Who publishes on a topic, with what speaks against its quality of service."""
        infos = self._node.get_publishers_info_by_topic(topic)
        return tuple(_publisher(info) for info in infos)


def node_name(info: Any) -> str:
    """The full name of the node of an end of a topic."""
    return f'{info.node_namespace.rstrip("/")}/{info.node_name}'


def _publisher(info: Any) -> Publisher:
    match, reason = qos_check_compatible(info.qos_profile, telemetry())
    fits = match is not QoSCompatibility.ERROR
    return Publisher(node_name(info), info.topic_type, '' if fits else str(reason).strip(' ;.'))
