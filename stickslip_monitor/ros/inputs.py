# SPDX-License-Identifier: Apache-2.0
"""Telemetry in: one subscription for each topic and type, feeding every bearing that reads it."""

from __future__ import annotations

import heapq
import operator
from collections.abc import Callable, Container, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Protocol

from rclpy.event_handler import SubscriptionEventCallbacks, UnsupportedEventTypeError
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions

from stickslip_monitor.errors import RosError
from stickslip_monitor.monitor.config import BearingConfig, MonitorConfig
from stickslip_monitor.monitor.health import NodeHealth
from stickslip_monitor.monitor.input_faults import StampGaps
from stickslip_monitor.ros.message_types import (
    ROS_FAULTS,
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

Receive = Callable[[str, int, int, float, bool], None]
Tap = Callable[[str, Any, int | None], None]


class MonitoringNode(Protocol):
    """What inputs need of the node."""

    def now_ns(self) -> int:
        """ROS time [ns]; 0 where it is unknown."""

    def survived(self, callback: Callable[..., Any]) -> Callable[..., Any]:
        """The callback, whose exceptions are told and survived."""

    def resolve_topic_name(self, topic: str) -> str:
        """The full name of a topic."""

    def create_subscription(self, *args: Any, **options: Any) -> Any:
        """Subscribe to a topic."""

    def destroy_subscription(self, subscription: Any) -> Any:
        """Take a subscription down."""


@dataclass(frozen=True, slots=True)
class InputReader:
    """One number that a message brings for one bearing."""

    bearing: str
    place: int
    number: Callable[[Any], float]


def resolved(node: MonitoringNode, config: MonitorConfig) -> MonitorConfig:
    """The configuration with the full names of its topics, as people know them."""

    def named(bearing: BearingConfig) -> BearingConfig:
        inputs: dict[str, Any] = {
            name: replace(source, topic=node.resolve_topic_name(source.topic))
            for name, source in bearing.inputs.items()
        }
        return replace(bearing, **inputs)

    return replace(config, bearings=tuple(map(named, config.bearings)))


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
        receive: Called with ``(bearing, place, time_ns, value, latest)`` for every number;
            ``latest`` is false where a later number of its bearing has come already.
        before: Called when messages have come, before they are taken.
        after: Called when the messages that waited have been taken.
        health: Where losses are counted.
        tap: Called with topic, message and its time [ns] before the numbers of it, if given.

    Raises:
        Exception: One of :data:`.messages.ROS_FAULTS`: a subscription cannot be made.
    """

    def __init__(
        self,
        node: MonitoringNode,
        config: MonitorConfig,
        receive: Receive,
        before: Callable[[], None],
        after: Callable[[], None],
        health: NodeHealth,
        tap: Tap | None = None,
    ) -> None:
        self._health, self._receive, self._tap = health, receive, tap
        self._before, self._after = before, after
        self._lanes = _lanes(node, config)
        try:
            for lane in self._lanes:
                lane.subscribe(self._on_message, self._on_lost)
        except ROS_FAULTS:
            self.destroy()
            raise

    def destroy(self) -> None:
        """Take the subscriptions down."""
        for lane in self._lanes:
            lane.destroy()

    def take_waiting(self) -> None:
        """Take what waits on every topic, for a node that was held up."""
        self._hand_over([lane.waiting() for lane in self._lanes], held_up=True)

    def _on_message(self, lane: Lane, message: Any) -> None:
        """Take a message and those that wait with it: a turn of the executor is dear."""
        self._before()
        found = {lane: lane.waiting(message)}
        lanes = [lane]
        for one in lanes:
            if found[one]:
                new = [other for other in one.beside if other not in found]
                found |= {other: other.waiting() for other in new}
                lanes += new
        self._hand_over([found[one] for one in sorted(lanes, key=lambda one: one.place)])
        self._after()

    def _hand_over(self, topics: Sequence[list[Arrival]], held_up: bool = False) -> None:
        """Hand over what came on some topics in order of time, each topic's in its own order."""
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
                self._receive(reading.bearing, reading.place, time_ns, value, latest)

    def count_missing(self) -> None:
        """Bring the node's counts of messages that are missing or left out up to date."""
        self._health.missing = sum(lane.missing for lane in self._lanes)
        self._health.thinned = sum(lane.thinned for lane in self._lanes)

    def _on_lost(self, info: Any) -> None:
        self._health.lost += info.total_count_change


def _lanes(node: MonitoringNode, config: MonitorConfig) -> list[Lane]:
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
        Lane(node, *key, own, timeouts[key], place)
        for place, (key, own) in enumerate(readers.items())
    ]
    for lane in lanes:
        lane.beside = [other for other in lanes if other.shares_bearing(lane)]
    return lanes


class Lane:
    """One topic: its subscription, and the numbers that its messages bring.

    Args:
        node: The node.
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
    """

    def __init__(
        self,
        node: MonitoringNode,
        topic: str,
        kind: str,
        readers: list[InputReader],
        timeout_ns: int,
        place: int,
    ) -> None:
        self._node, self._topic, self._kind = node, topic, kind
        self.readers, self.place = readers, place
        self.beside: list[Lane] = []
        self._stamp = stamp_reader(kind)
        self.name = node.resolve_topic_name(topic)
        self.thinned = 0
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

    def subscribe(self, take: Callable[[Lane, Any], None], on_lost: Callable[[Any], None]) -> None:
        """Listen from now on."""

        def receive(message: Any) -> None:
            take(self, message)

        make = partial(
            self._node.create_subscription,
            message_type(self._kind),
            self._topic,
            self._node.survived(receive),
            telemetry(),
            qos_overriding_options=QoSOverridingOptions.with_default_policies(),
        )
        try:
            events = SubscriptionEventCallbacks(message_lost=on_lost)
            self._subscription = make(event_callbacks=events)
        except UnsupportedEventTypeError:
            # Not every middleware tells what it has lost.
            self._subscription = make()

    def destroy(self) -> None:
        """Take the subscription down."""
        if self._subscription is not None:
            self._node.destroy_subscription(self._subscription)

    def waiting(self, message: Any = None) -> list[Arrival]:
        """What waits, a message that was taken already first, and not what comes meanwhile.

        What comes before the first ``/clock`` has no time and is not used.
        """
        found: list[Arrival] = []
        message = self._next() if message is None else message
        while message is not None:
            if time_ns := self._time(message):
                found.append((time_ns, self, message))
            message = self._next() if len(found) < _DEPTH else None
        return self._thinned(found)

    def _thinned(self, found: list[Arrival]) -> list[Arrival]:
        """Every so many of a flood and the last: nobody must wait until all are worked off."""
        if len(found) <= MOST_AT_ONCE:
            return found
        step = -(-len(found) // MOST_AT_ONCE)
        kept = found[::-1][::step][::-1]
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
        return None if taken is None else taken[0]

    def _time(self, message: Any) -> int:
        """The time of measurement where the message carries it, else that of its arrival [ns]."""
        if self._stamp is not None and (stamp_ns := self._stamp(message)):
            self._gaps.add(stamp_ns)
            return stamp_ns
        now_ns = self._node.now_ns()
        # Simulated time moves in ticks: messages that share one keep their order.
        self._shared = self._shared + 1 if now_ns == self._tick_ns and now_ns else 0
        self._tick_ns = now_ns
        return now_ns + self._shared
