# SPDX-License-Identifier: Apache-2.0
"""Telemetry in: one subscription for each topic and type, feeding every bearing that reads it."""

from __future__ import annotations

import heapq
import operator
from collections.abc import Callable, Container, Iterator, Sequence
from dataclasses import dataclass
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
from stickslip_monitor.monitor.input_faults import Publisher, StampGaps
from stickslip_monitor.monitor.input_watch import Graph
from stickslip_monitor.ros.message_types import (
    check_field,
    message_type,
    number_reader,
    stamp_reader,
)

# Two seconds at 1 kHz while the machine is busy.
_DEPTH = 2000


def telemetry() -> QoSProfile:
    """The quality of service of an input: best effort matches every publisher."""
    return QoSProfile(
        depth=_DEPTH,
        history=HistoryPolicy.KEEP_LAST,
        reliability=ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.VOLATILE,
    )


# Time [ns], topic and message.
Arrival = tuple[int, 'Lane', Any]
_time_of = operator.itemgetter(0)

MOST_AT_ONCE = 200
"""Of more messages of a topic that wait than these, the others are left out and counted."""
MOST_TOGETHER = 2000
"""The same of all topics, which a node that is late works off before it looks at the time."""

Tap = Callable[[str, Any, int | None], None]
Guard = Callable[[Callable[..., Any]], Callable[..., Any]]
"""Makes a callback whose exceptions are told and survived."""


class Number(NamedTuple):
    """One number of one input.

    Attributes:
        bearing: Its bearing.
        place: The input, a place in :data:`.signals.INPUTS`.
        time_ns: When it was measured, or came [ns].
        value: The number, in the input's own scale.
        latest: Whether no later number of its bearing has come already.
    """

    bearing: str
    place: int
    time_ns: int
    value: float
    latest: bool


@dataclass(frozen=True, slots=True)
class InputReader:
    """One number that a message brings for one bearing."""

    bearing: str
    place: int
    number: Callable[[Any], float]


def check_inputs(config: MonitorConfig, outputs: Container[str]) -> None:
    """Check that every input's message type exists and its field leads to a number.

    Args:
        config: The configuration with :func:`resolved` topics.
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
        node: The node.
        config: The configuration as given: names of topics are resolved once.
        deliver: Called with the numbers of the messages that waited, in order of time.
        now_ns: ROS time [ns]; 0 where it is unknown.
        survived: Guards the callbacks.
        health: Where losses are counted.
        tap: Called with topic, message and its time [ns] before the numbers of it, if given.
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
        self._lanes = _lanes(node, config, now_ns)

    def subscribe(self) -> None:
        """Listen from now on.

        Raises:
            Exception: One of :data:`.message_types.ROS_FAULTS`: a subscription cannot be made.
        """
        for lane in self._lanes:
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
        self._deliver(
            self._numbers([found[one] for one in sorted(lanes, key=lambda one: one.place)])
        )

    def _numbers(self, topics: Sequence[list[Arrival]], held_up: bool = False) -> Iterator[Number]:
        """The numbers of what came on some topics in order of time, each topic's in its own."""
        some = [arrivals for arrivals in topics if arrivals]
        arrivals = some[0] if len(some) == 1 else list(heapq.merge(*some, key=_time_of))
        last = {
            reading.bearing: number
            for number, (_, lane, _) in enumerate(arrivals)
            for reading in lane.readers
        }
        for number, (time_ns, lane, message) in enumerate(arrivals):
            if self._tap is not None:
                self._tap(lane.name, message, time_ns)
            for reading in lane.readers:
                latest = last[reading.bearing] == number and not held_up
                value = reading.number(message)
                yield Number(reading.bearing, reading.place, time_ns, value, latest)

    def count_missing(self) -> None:
        """Bring the node's counts of messages that are lost or left out up to date."""
        self._health.lost = sum(lane.lost for lane in self._lanes)
        self._health.missing = sum(lane.missing for lane in self._lanes)
        self._health.thinned = sum(lane.thinned for lane in self._lanes)


def _lanes(node: LifecycleNode, config: MonitorConfig, now_ns: Callable[[], int]) -> list[Lane]:
    """One for each topic."""
    readers: dict[tuple[str, str], list[InputReader]] = {}
    timeouts: dict[tuple[str, str], int] = {}
    for bearing in config.bearings:
        for place, source in enumerate(bearing.inputs.values()):
            key = source.topic, source.type
            number = number_reader(source.field)
            readers.setdefault(key, []).append(InputReader(bearing.name, place, number))
            timeouts[key] = min(source.timeout_ns, timeouts.get(key, source.timeout_ns))
    lanes = [
        Lane(node, now_ns, *key, own, timeouts[key], place)
        for place, (key, own) in enumerate(readers.items())
    ]
    for lane in lanes:
        lane.beside = [other for other in lanes if other.shares_bearing(lane)]
    return lanes


class Lane:
    """One topic: its subscription, and the numbers that its messages bring.

    Args:
        node: The node.
        now_ns: ROS time [ns]; 0 where it is unknown.
        topic: The topic as configured.
        kind: Its message type.
        readers: What is read from a message.
        timeout_ns: The shortest timeout of those inputs [ns].
        place: Its place among all topics.

    Attributes:
        readers: What is read from a message.
        name: The full name of the topic.
        place: Its place among all topics.
        beside: The topics that bring other numbers of its bearings.
        thinned: Messages that were left out because too many waited.
        lost: Messages that never came, by the numbers of their publishers.
    """

    def __init__(
        self,
        node: LifecycleNode,
        now_ns: Callable[[], int],
        topic: str,
        kind: str,
        readers: list[InputReader],
        timeout_ns: int,
        place: int,
    ) -> None:
        self._node, self._now_ns, self._topic, self._kind = node, now_ns, topic, kind
        self.readers, self.place = readers, place
        self.beside: list[Lane] = []
        self._stamp = stamp_reader(kind)
        self.name = node.resolve_topic_name(topic)
        self.thinned = self.lost = 0
        self._numbers: dict[bytes, int] = {}
        self._unnumbered = 0
        self._gaps = StampGaps(timeout_ns)
        self._subscription: Any = None
        self._tick_ns = self._shared = 0

    @property
    def missing(self) -> int:
        """Messages missing by the stamps of the sender."""
        return self._gaps.missing

    def shares_bearing(self, other: Lane) -> bool:
        """Whether another topic brings a number of one of its bearings."""
        own = {reading.bearing for reading in self.readers}
        return other is not self and any(reading.bearing in own for reading in other.readers)

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

    def _count_lost(self, info: Any) -> None:
        """Count what lies between a message and the one before of its publisher.

        An executor does not hand on the numbers of those it takes, and some ROS 2 have none. (The
        event of a lost message tells nothing of those for which the queue had no room.)
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

    def _time(self, message: Any) -> int:
        """The time of measurement where the message carries it, else that of its arrival [ns]."""
        if self._stamp is not None and (stamp_ns := self._stamp(message)):
            self._gaps.add(stamp_ns)
            return stamp_ns
        now_ns = self._now_ns()
        # Simulated time moves in ticks: messages that share one keep their order.
        self._shared = self._shared + 1 if now_ns == self._tick_ns and now_ns else 0
        self._tick_ns = now_ns
        return now_ns + self._shared


class RosGraph(Graph):
    """The graph as a node sees it.

    Args:
        node: The node.
    """

    def __init__(self, node: Node) -> None:
        self._node = node

    def publishers(self, topic: str) -> tuple[Publisher, ...]:
        """Who publishes on a topic, with what speaks against its quality of service."""
        infos = self._node.get_publishers_info_by_topic(topic)
        return tuple(_publisher(info) for info in infos)


def publishers_on(node: Node, topic: str) -> list[str]:
    """The full names of the nodes that publish on a topic."""
    infos = node.get_publishers_info_by_topic(node.resolve_topic_name(topic))
    return sorted({_node_name(info) for info in infos})


def has_double(node: Node) -> bool:
    """Whether another node has the full name of this one."""
    own = (node.get_name(), node.get_namespace())
    return node.get_node_names_and_namespaces().count(own) > 1


def _node_name(info: Any) -> str:
    return f'{info.node_namespace.rstrip("/")}/{info.node_name}'


def _publisher(info: Any) -> Publisher:
    match, reason = qos_check_compatible(info.qos_profile, telemetry())
    fits = match is not QoSCompatibility.ERROR
    return Publisher(_node_name(info), info.topic_type, '' if fits else str(reason).strip(' ;.'))
