# SPDX-License-Identifier: Apache-2.0
"""What the node publishes: numbers for each bearing, warnings, diagnostics."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.duration import Duration
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.lifecycle import LifecycleNode
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions
from std_msgs.msg import String

from stickslip_monitor.monitor.config import MonitorConfig
from stickslip_monitor.monitor.health import DiagnosticRecord, NodeHealth, health_record
from stickslip_monitor.monitor.messages import (
    BearingState,
    bearings_json,
    diagnostic_record,
    event_json,
    output_topics,
    verdict_values,
)
from stickslip_monitor.monitor.session import Sink
from stickslip_monitor.monitor.verdict import Event, Verdict
from stickslip_monitor.ros.event_clips import Clips
from stickslip_monitor.ros.message_types import message_type

WARNINGS_KEPT = 100
ALARMS_KEPT = 20
# How long the end of the node waits for readers [s].
_LAST_WORD = 0.5


def _reliable() -> QoSProfile:
    return QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)


def _latched(depth: int) -> QoSProfile:
    return QoSProfile(
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL,
    )


def output_names(node: LifecycleNode, config: MonitorConfig) -> set[str]:
    """The full names of all topics that a node publishes."""
    own = node.get_fully_qualified_name()
    names = {*output_topics(config.bearings, own), f'{own}/alarms', f'{own}/bearings'}
    return {node.resolve_topic_name(name) for name in names}


class Outputs(Sink):
    """The publishers of a configured node. What nobody listens to is not published.

    Args:
        node: The node.
        config: The configuration.
        health: How the node itself is.
        clips: Takes what is said, and notice of alarms, where clips are wanted.
    """

    def __init__(
        self, node: LifecycleNode, config: MonitorConfig, health: NodeHealth, clips: Clips | None
    ) -> None:
        self._node, self._health, self._clips = node, health, clips
        self._name = node.get_fully_qualified_name().lstrip('/')
        make: Callable[..., Any] = node.create_lifecycle_publisher
        own_qos = {'qos_overriding_options': QoSOverridingOptions.with_default_policies()}
        self._warnings = make(String, '~/warnings', _latched(WARNINGS_KEPT), **own_qos)
        self._alarms = make(String, '~/alarms', _latched(ALARMS_KEPT), **own_qos)
        self._records = make(String, '~/bearings', _reliable(), **own_qos)
        self._diagnostics = make(DiagnosticArray, '/diagnostics', _reliable(), **own_qos)
        kinds = {
            topic: message_type(kind)
            for topic, kind in output_topics(config.bearings, '~').items()
        }
        self._bearings = {
            bearing.name: [
                (make(kinds[topic], topic, _reliable()), kinds[topic](), value)
                # What is dearest to work out comes last.
                for name, value in reversed(verdict_values(bearing).items())
                for topic in [f'~/{bearing.name}/{name}']
            ]
            for bearing in config.bearings
        }

    def destroy(self) -> None:
        """Take the publishers down."""
        own = [publisher for group in self._bearings.values() for publisher, *_ in group]
        for publisher in (*own, self._warnings, self._alarms, self._records, self._diagnostics):
            self._node.destroy_lifecycle_publisher(publisher)

    def take_verdict(self, verdict: Verdict) -> None:
        """Amplitude, margins and regime of one bearing."""
        for publisher, message, value in self._bearings[verdict.bearing]:
            if self._wanted(publisher):
                message.data = value(verdict)
                self._send(publisher, message, verdict.time_ns)

    def take_event(self, event: Event) -> None:
        """One JSON warning."""
        self._send(self._warnings, String(data=event_json(event)), event.time_ns)
        if self._clips is not None:
            self._clips.note(event)

    def take_alarms(self, record: dict[str, Any]) -> None:
        """The list of alarms, with what has just changed."""
        self._send(self._alarms, String(data=json.dumps(record, allow_nan=False)))

    def take_states(self, states: list[BearingState], whole: bool) -> None:
        """The state of bearings, and with all of them that of the node itself."""
        now = self._node.get_clock().now()
        if self._wanted(self._records):
            text = bearings_json(states, now.nanoseconds)
            self._send(self._records, String(data=text))
        if not self._wanted(self._diagnostics):
            return
        records = [diagnostic_record(self._name, state) for state in states]
        if whole:
            records.append(health_record(self._name, self._health))
        message = DiagnosticArray(status=[_status(record) for record in records])
        message.header.stamp = now.to_msg()
        self._send(self._diagnostics, message)

    def flush(self) -> None:
        """Wait a moment until the last list of alarms and diagnostics have arrived."""
        for publisher in (self._alarms, self._records, self._diagnostics):
            publisher.wait_for_all_acked(Duration(seconds=_LAST_WORD))

    def _wanted(self, publisher: Any) -> bool:
        return self._clips is not None or publisher.get_subscription_count() > 0

    def _send(self, publisher: Any, message: Any, time_ns: int | None = None) -> None:
        if self._clips is not None:
            self._clips.take(publisher.topic_name, message, time_ns)
        try:
            publisher.publish(message)
        except rclpy_implementation.RCLError as error:
            # A reader that cannot keep up must not stop the monitor.
            self._node.get_logger().warning(
                f'not published on {publisher.topic_name}: {error}', throttle_duration_sec=5.0
            )


def _status(record: DiagnosticRecord) -> DiagnosticStatus:
    return DiagnosticStatus(
        level=bytes([record.level]),
        name=record.name,
        hardware_id=record.hardware_id,
        message=record.message,
        values=[KeyValue(key=key, value=value) for key, value in record.values.items()],
    )
