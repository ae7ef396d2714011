# SPDX-License-Identifier: Apache-2.0
"""What the node publishes: numbers for each bearing, warnings, diagnostics."""

from __future__ import annotations

import json
import math
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.lifecycle import LifecycleNode
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from std_msgs.msg import Float64, String

from stickslip_monitor.monitor.alarm import Level
from stickslip_monitor.monitor.config import MonitorConfig
from stickslip_monitor.monitor.monitor import BearingMonitor
from stickslip_monitor.monitor.records import event_record
from stickslip_monitor.monitor.signals import QUANTITIES, Status
from stickslip_monitor.monitor.verdict import Event, Verdict

WARNINGS_KEPT = 100
WAITING = 'Waiting for the first speed and load.'
_RELIABLE = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)
_LATCHED = QoSProfile(
    depth=WARNINGS_KEPT,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
_NUMBERS = ('amplitude', 'hopf_margin', 'fold_margin')


class Outputs:
    """The publishers of a configured node."""

    def __init__(self, node: LifecycleNode, config: MonitorConfig) -> None:
        self._node = node
        self._warnings = node.create_lifecycle_publisher(String, '~/warnings', _LATCHED)
        self._diagnostics = node.create_lifecycle_publisher(
            DiagnosticArray, '/diagnostics', _RELIABLE
        )
        self._bearings = {
            bearing.name: [
                node.create_lifecycle_publisher(kind, f'~/{bearing.name}/{topic}', _RELIABLE)
                for topic, kind in (*((n, Float64) for n in _NUMBERS), ('regime', String))
            ]
            for bearing in config.bearings
        }

    def destroy(self) -> None:
        """Take the publishers down."""
        for group in self._bearings.values():
            for publisher in group:
                self._node.destroy_lifecycle_publisher(publisher)
        self._node.destroy_lifecycle_publisher(self._warnings)
        self._node.destroy_lifecycle_publisher(self._diagnostics)

    def publish_verdict(self, verdict: Verdict) -> None:
        """Amplitude (0 where no cycle exists), margins and regime of one bearing."""
        point = verdict.assessment
        amplitude = 0.0 if math.isnan(point.amplitude) else point.amplitude
        numbers = (amplitude, point.hopf_margin, point.fold_margin)
        *publishers, regime = self._bearings[verdict.bearing]
        for publisher, value in zip(publishers, numbers, strict=True):
            self._send(publisher, Float64(data=value))
        self._send(regime, String(data=point.regime.value))

    def publish_event(self, event: Event) -> None:
        """One JSON warning, and a line in the log."""
        self._send(self._warnings, String(data=json.dumps(event_record(event), allow_nan=False)))
        logger = self._node.get_logger()
        if event.raised:
            logger.warning(event.text)
        else:
            logger.info(event.text)

    def publish_diagnostics(self, bearings: list[BearingMonitor]) -> None:
        """The state of every bearing."""
        stamp = self._node.get_clock().now().to_msg()
        message = DiagnosticArray(status=[self._status(bearing) for bearing in bearings])
        message.header.stamp = stamp
        self._send(self._diagnostics, message)

    def _status(self, bearing: BearingMonitor) -> DiagnosticStatus:
        waiting = is_waiting(bearing)
        level = Level.WARN if waiting else bearing.track.condition.level
        return DiagnosticStatus(
            level=bytes([level]),
            name=f'{self._node.get_name()}: {bearing.config.name}',
            hardware_id=bearing.config.name,
            message=f'{bearing.config.name}: {WAITING}' if waiting else bearing.text(),
            values=[
                KeyValue(key=key, value=value if isinstance(value, str) else f'{value:.9g}')
                for key, value in diagnostic_values(bearing).items()
            ],
        )

    def _send(self, publisher: Any, message: Any) -> None:
        try:
            publisher.publish(message)
        except rclpy_implementation.RCLError as error:
            # A reader that cannot keep up must not stop the monitor.
            self._node.get_logger().warning(
                f'not published on {publisher.topic_name}: {error}', throttle_duration_sec=5.0
            )


def is_waiting(bearing: BearingMonitor) -> bool:
    """Whether nothing is known yet: neither an operating point, nor that an input is lost."""
    return bearing.verdict is None and not bearing.track.stale


def diagnostic_values(bearing: BearingMonitor) -> dict[str, str | float]:
    """The key-value pairs of a bearing's diagnostic status: one number a key, unit in the key."""
    reason = 'waiting' if is_waiting(bearing) else bearing.track.condition.value
    result: dict[str, str | float] = {'reason': reason}
    if bearing.verdict is not None:
        point = bearing.verdict.assessment
        rpm = bearing.config.bearing.speed.from_surface(point.speed, 'rpm')
        result |= {
            'regime': point.regime.value,
            'outcome': point.outcome.value,
            'stick-slip predicted': str(bearing.verdict.sticking).lower(),
            'speed [m/s]': point.speed,
            'shaft speed [rpm]': float(rpm),
            'load [N]': point.load,
            'hopf speed [m/s]': point.hopf_speed,
            'fold speed [m/s]': point.fold_speed,
            'hopf margin': point.hopf_margin,
            'fold margin': point.fold_margin,
            'growth rate [1/s]': point.growth_rate,
            'amplitude [m]': point.amplitude,
            'threshold amplitude [m]': point.threshold_amplitude,
        }
    for name, age in bearing.lost().items():
        result[f'{name} age [s]'] = age
    for row, name in enumerate(QUANTITIES):
        for status in Status:
            label = status.name.lower().replace('_', ' ')
            result[f'{name} samples {label}'] = int(bearing.gate.counts[row, status])
    return result
