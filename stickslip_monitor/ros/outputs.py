# SPDX-License-Identifier: Apache-2.0
"""What the node publishes: numbers for each bearing, warnings, diagnostics."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.duration import Duration
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.lifecycle import LifecycleNode
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from std_msgs.msg import Float64, String

from stickslip_monitor.monitor.config import MonitorConfig
from stickslip_monitor.monitor.messages import (
    BearingState,
    DiagnosticRecord,
    NodeHealth,
    diagnostic_record,
    event_json,
    health_record,
    topic_numbers,
    topic_words,
)
from stickslip_monitor.monitor.verdict import Event, Verdict

Tap = Callable[[str, Any, int | None], None]
WARNINGS_KEPT = 100
ALARMS_KEPT = 20
# How long the end of the node waits for readers [s].
_LAST_WORD = 0.5
_RELIABLE = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)


def _latched(depth: int) -> QoSProfile:
    return QoSProfile(
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL,
    )


class Outputs:
    """The publishers of a configured node. What nobody listens to is not published.

    Args:
        node: The node.
        config: The configuration.
        tap: Called with topic, message and the time it speaks of [ns], if given; that time is
            ``None`` for a message that speaks of now.
    """

    def __init__(self, node: LifecycleNode, config: MonitorConfig, tap: Tap | None = None) -> None:
        self._node = node
        self._name = node.get_fully_qualified_name().lstrip('/')
        self._tap = tap
        self._warnings = node.create_lifecycle_publisher(
            String, '~/warnings', _latched(WARNINGS_KEPT)
        )
        self._alarms = node.create_lifecycle_publisher(String, '~/alarms', _latched(ALARMS_KEPT))
        self._diagnostics = node.create_lifecycle_publisher(
            DiagnosticArray, '/diagnostics', _RELIABLE
        )
        self._bearings: dict[str, list[Any]] = {
            bearing.name: [
                (
                    node.create_lifecycle_publisher(kind, f'~/{bearing.name}/{topic}', _RELIABLE),
                    kind(),
                    number,
                )
                for topic, kind, number in (
                    # What takes longest to work out comes last.
                    *((topic, String, _WORDS[topic]) for topic in topic_words(bearing)),
                    *(
                        (topic, Float64, _number(topic))
                        for topic in reversed(topic_numbers(bearing))
                    ),
                )
            ]
            for bearing in config.bearings
        }

    def destroy(self) -> None:
        """Take the publishers down."""
        for group in self._bearings.values():
            for publisher, *_ in group:
                self._node.destroy_lifecycle_publisher(publisher)
        self._node.destroy_lifecycle_publisher(self._warnings)
        self._node.destroy_lifecycle_publisher(self._alarms)
        self._node.destroy_lifecycle_publisher(self._diagnostics)

    def publish_verdict(self, verdict: Verdict) -> None:
        """Amplitude, margins and regime of one bearing."""
        for publisher, message, value in self._bearings[verdict.bearing]:
            if self._wanted(publisher):
                message.data = value(verdict)
                self._send(publisher, message, verdict.time_ns)

    def publish_event(self, event: Event) -> None:
        """One JSON warning, and a line in the log."""
        self._send(self._warnings, String(data=event_json(event)), event.time_ns)
        logger = self._node.get_logger()
        if event.raised:
            logger.warning(event.text)
        else:
            logger.info(event.text)

    def publish_alarms(self, text: str) -> None:
        """The list of alarms, with what has just changed."""
        self._send(self._alarms, String(data=text))

    def publish_diagnostics(
        self, states: Iterable[BearingState], health: NodeHealth | None
    ) -> None:
        """The state of bearings, and of the node itself where given."""
        if not self._wanted(self._diagnostics):
            return
        records = [diagnostic_record(self._name, state) for state in states]
        if health is not None:
            records.append(health_record(self._name, health))
        message = DiagnosticArray(status=[_status(record) for record in records])
        message.header.stamp = self._node.get_clock().now().to_msg()
        self._send(self._diagnostics, message)

    def flush(self) -> None:
        """Wait a moment until the last list of alarms and diagnostics have arrived."""
        for publisher in (self._alarms, self._diagnostics):
            publisher.wait_for_all_acked(Duration(seconds=_LAST_WORD))

    def _wanted(self, publisher: Any) -> bool:
        return self._tap is not None or publisher.get_subscription_count() > 0

    def _send(self, publisher: Any, message: Any, time_ns: int | None = None) -> None:
        if self._tap is not None:
            self._tap(publisher.topic_name, message, time_ns)
        try:
            publisher.publish(message)
        except rclpy_implementation.RCLError as error:
            # A reader that cannot keep up must not stop the monitor.
            self._node.get_logger().warning(
                f'not published on {publisher.topic_name}: {error}', throttle_duration_sec=5.0
            )


def _number(name: str) -> Callable[[Verdict], float]:
    """One of :func:`.records.verdict_numbers`, worked out only where somebody wants it."""

    def read(verdict: Verdict) -> float:
        value = float(getattr(verdict.assessment, name))
        return 0.0 if math.isnan(value) and name.startswith('amplitude') else value

    return read


_WORDS: dict[str, Callable[[Verdict], str]] = {
    'regime': lambda verdict: str(verdict.assessment.regime.value),
    'measured': lambda verdict: str(verdict.standing.measured),
}


def _status(record: DiagnosticRecord) -> DiagnosticStatus:
    return DiagnosticStatus(
        level=bytes([record.level]),
        name=record.name,
        hardware_id=record.hardware_id,
        message=record.message,
        values=[KeyValue(key=key, value=value) for key, value in record.values.items()],
    )
