# SPDX-License-Identifier: Apache-2.0
"""What the node publishes: numbers for each bearing, warnings, diagnostics."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.lifecycle import LifecycleNode
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from std_msgs.msg import Float64, String

from stickslip_monitor.monitor.config import MonitorConfig
from stickslip_monitor.monitor.messages import (
    VERDICT_NUMBERS,
    diagnostic_record,
    event_json,
    state_of,
    verdict_numbers,
)
from stickslip_monitor.monitor.monitor import BearingMonitor
from stickslip_monitor.monitor.verdict import Event, Verdict

Tap = Callable[[str, Any, int | None], None]
WARNINGS_KEPT = 100
ALARMS_KEPT = 20
_RELIABLE = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)


def _latched(depth: int) -> QoSProfile:
    return QoSProfile(
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL,
    )


class Outputs:
    """The publishers of a configured node.

    Args:
        node: The node.
        config: The configuration.
        tap: Called with topic, message and the time it speaks of [ns], if given; that time is
            ``None`` for a message that speaks of now.
    """

    def __init__(self, node: LifecycleNode, config: MonitorConfig, tap: Tap | None = None) -> None:
        self._node = node
        self._tap = tap
        self._warnings = node.create_lifecycle_publisher(
            String, '~/warnings', _latched(WARNINGS_KEPT)
        )
        self._alarms = node.create_lifecycle_publisher(String, '~/alarms', _latched(ALARMS_KEPT))
        self._diagnostics = node.create_lifecycle_publisher(
            DiagnosticArray, '/diagnostics', _RELIABLE
        )
        self._bearings = {
            bearing.name: [
                node.create_lifecycle_publisher(kind, f'~/{bearing.name}/{topic}', _RELIABLE)
                for topic, kind in (*((n, Float64) for n in VERDICT_NUMBERS), ('regime', String))
            ]
            for bearing in config.bearings
        }

    def destroy(self) -> None:
        """Take the publishers down."""
        for group in self._bearings.values():
            for publisher in group:
                self._node.destroy_lifecycle_publisher(publisher)
        self._node.destroy_lifecycle_publisher(self._warnings)
        self._node.destroy_lifecycle_publisher(self._alarms)
        self._node.destroy_lifecycle_publisher(self._diagnostics)

    def publish_verdict(self, verdict: Verdict) -> None:
        """Amplitude, margins and regime of one bearing."""
        point = verdict.assessment
        *publishers, regime = self._bearings[verdict.bearing]
        for publisher, value in zip(publishers, verdict_numbers(point).values(), strict=True):
            self._send(publisher, Float64(data=float(value)), verdict.time_ns)
        self._send(regime, String(data=point.regime.value), verdict.time_ns)

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

    def publish_diagnostics(self, bearings: list[BearingMonitor]) -> None:
        """The state of every bearing."""
        stamp = self._node.get_clock().now().to_msg()
        message = DiagnosticArray(status=[self._status(bearing) for bearing in bearings])
        message.header.stamp = stamp
        self._send(self._diagnostics, message)

    def _status(self, bearing: BearingMonitor) -> DiagnosticStatus:
        record = diagnostic_record(self._node.get_name(), state_of(bearing))
        return DiagnosticStatus(
            level=bytes([record.level]),
            name=record.name,
            hardware_id=record.hardware_id,
            message=record.message,
            values=[KeyValue(key=key, value=value) for key, value in record.values.items()],
        )

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
