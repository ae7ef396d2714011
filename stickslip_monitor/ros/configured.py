# SPDX-License-Identifier: Apache-2.0
"""What a configured node has: its session, its publishers, its state file and its clips."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from rclpy.lifecycle import LifecycleNode

from stickslip_monitor.monitor.clip_recorder import ClipStore
from stickslip_monitor.monitor.config import BearingConfig, MonitorConfig
from stickslip_monitor.monitor.health import NodeHealth
from stickslip_monitor.monitor.session import Session
from stickslip_monitor.ros.event_clips import Clips
from stickslip_monitor.ros.inputs import RosGraph
from stickslip_monitor.ros.outputs import Outputs
from stickslip_monitor.state_file import StateFile, StateWriter

MakeStore = Callable[[MonitorConfig], ClipStore | None]
"""Makes what takes the clips of a configuration; ``None`` where it wants none."""


def resolved(node: LifecycleNode, config: MonitorConfig) -> MonitorConfig:
    """The configuration with the full names of its topics, as people know them."""

    def named(bearing: BearingConfig) -> BearingConfig:
        inputs: dict[str, Any] = {
            name: replace(source, topic=node.resolve_topic_name(source.topic))
            for name, source in bearing.inputs.items()
        }
        return replace(bearing, **inputs)

    return replace(config, bearings=tuple(map(named, config.bearings)))


class Configured:
    """The parts of a configured node.

    Args:
        node: The node.
        config: Its configuration.
        health: How it is.
        make_store: Makes what takes the clips.

    Raises:
        Exception: One of :data:`.message_types.ROS_FAULTS`, or a StickslipError.

    Attributes:
        config: The configuration, names of topics as given.
        health: How the node is.
        clips: Takes what the node hears and says, where clips are wanted.
        outputs: The publishers.
        session: The monitor and what is around it.
    """

    def __init__(
        self,
        node: LifecycleNode,
        config: MonitorConfig,
        health: NodeHealth,
        make_store: MakeStore,
    ) -> None:
        self._node, self._make_store, self.health = node, make_store, health
        self._kept: StateWriter | None = None
        self._publish(config)
        try:
            if config.state_file:
                self._kept = StateWriter(StateFile(config.state_file))
            self.session = self._session()
        except BaseException:
            self.destroy()
            raise

    def _publish(self, config: MonitorConfig) -> None:
        store = self._make_store(config)
        self.config = config
        self.clips = None if store is None else Clips(self._node, config.clips, store)
        self.outputs = Outputs(self._node, config, self.health, self.clips)

    def _session(self) -> Session:
        node = self._node
        return Session(
            resolved(node, self.config),
            self.outputs,
            node.get_logger(),
            lambda: node.get_clock().now().nanoseconds,
            self._kept,
            RosGraph(node),
        )

    def retune(self, config: MonitorConfig) -> None:
        """Take over what may change while the node is active."""
        self.session.retune(resolved(self._node, config))
        self.config = config

    def rebuild(self, config: MonitorConfig) -> None:
        """Start afresh with other inputs; the alarms stay as they are."""
        before, outputs = self.session, self.outputs
        self._publish(config)
        outputs.destroy()
        self.session = self._session()
        self.session.alarms.inherit(before.alarms)

    def note(self, what: str, text: str) -> None:
        """Put something on record with the list of alarms."""
        self.session.alarms.note(what, text)

    def look_at_files(self) -> None:
        """Bring the health of what is written up to date."""
        if self.clips is not None:
            self.health.clip_fault = self.clips.fault
        if self._kept is not None:
            before, self.health.state_file_fault = self.health.state_file_fault, self._kept.fault
            if self._kept.fault and not before:
                self._node.get_logger().error(self._kept.fault)

    def tick_clips(self) -> None:
        """Let time pass for the clips."""
        if self.clips is not None:
            bearings = self.session.monitor.bearings.values()
            self.clips.tick(max((b.now_ns or 0 for b in bearings), default=0))

    def end_clips(self) -> None:
        """Write what is left of the clips."""
        if self.clips is not None:
            self.clips.close()

    def close(self) -> None:
        """Write what is left of clips and alarms."""
        self.end_clips()
        if self._kept is not None:
            self._kept.close()
            self._kept = None

    def destroy(self) -> None:
        """Take everything down."""
        self.close()
        self.outputs.destroy()
