# SPDX-License-Identifier: Apache-2.0
"""What a configured node has: its session, its publishers, and event clips of what passes it."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import partial
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.duration import Duration
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.lifecycle import LifecycleNode
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.serialization import serialize_message
from std_msgs.msg import String

from stickslip_monitor.host import MAX_LAST_PAUSE
from stickslip_monitor.monitor.bearing_records import (
    BearingState,
    DiagnosticRecord,
    NodeHealth,
    bearings_json,
    diagnostic_record,
    event_json,
    health_record,
    output_topics,
    topic_numbers,
    topic_words,
    verdict_value,
)
from stickslip_monitor.monitor.clip_recorder import ClipMessage, ClipRecorder, ClipStore
from stickslip_monitor.monitor.parameters import ClipConfig, MonitorConfig
from stickslip_monitor.monitor.session import Session, Sink
from stickslip_monitor.monitor.statements import Event, Verdict
from stickslip_monitor.ros.inputs import compose_definition, import_message_type, resolve_topics
from stickslip_monitor.ros.other_nodes import ALARMS_KEPT, RosGraph, reliable_qos
from stickslip_monitor.state_file import Background, StateWriter

WARNINGS_KEPT = 100
"""Warnings that a later subscriber is given."""
# Clips that wait for the disk; of more the oldest is lost.
_CLIPS_WAITING = 2


def output_names(node: LifecycleNode, config: MonitorConfig) -> set[str]:
    """Return the full names of all topics that a node publishes."""
    node_name = node.get_fully_qualified_name()
    names = {*output_topics(config.bearings, node_name), f'{node_name}/alarms', f'{node_name}/bearings'}
    return {node.resolve_topic_name(name) for name in names}


class Configured:
    """Session, publishers and clips of a configured node, which stay while it is not active.

    Args:
        make_store: Makes what takes the clips; ``None`` where none are wanted.

    Raises:
        Exception: One of :data:`.inputs.ROS_FAULTS`, or a StickslipError.

    Attributes:
        config: The configuration, names of topics as given.
        session: The session, with the full names of topics.
        outputs: The publishers.
        health: The node's own health, which the publishers publish.
        graph: Who publishes the inputs.
        clips: Takes what the node receives and publishes; ``None`` where no clips are wanted.
    """

    def __init__(
        self,
        node: LifecycleNode,
        config: MonitorConfig,
        health: NodeHealth,
        make_store: Callable[[ClipConfig], ClipStore | None],
    ) -> None:
        self._node, self.health, self._make_store = node, health, make_store
        self._kept: StateWriter | None = None
        self._make_outputs(config)
        try:
            if config.state_file:
                self._kept = StateWriter(config.state_file)
            self.session = self._make_session()
        except BaseException:
            self.destroy()
            raise

    def _make_outputs(self, config: MonitorConfig) -> None:
        """Set :attr:`config`, and :attr:`clips` and ``outputs`` to those that it asks for.

        Raises:
            Exception: One of :data:`.inputs.ROS_FAULTS`, or a StickslipError; nothing is set where the store
            of the clips cannot be made.
        """
        store = self._make_store(config.clips)
        self.config = config
        self.clips = None if store is None else Clips(self._node, config.clips, store)
        self.outputs = Outputs(self._node, config, self.health, self.clips)

    def _make_session(self) -> Session:
        """Return a new session for the configuration, and set :attr:`graph`, by which it finds publishers."""
        node, given = self._node, self.config.bearings
        self.graph = RosGraph(node, [source.topic for b in given for source in b.inputs.values()])
        return Session(
            resolve_topics(node, self.config),
            self.outputs,
            node.get_logger(),
            lambda: node.get_clock().now().nanoseconds,
            self._kept,
            self.graph,
        )

    def retune(self, config: MonitorConfig) -> None:
        """Apply a configuration that differs in live parameters only to the session, and store it.

        Raises:
            ConfigurationError: The session cannot take it; nothing is changed.
        """
        self.session.retune(resolve_topics(self._node, config))
        self.config = config

    def rebuild(self, config: MonitorConfig) -> None:
        """Replace clips, publishers and session for another configuration; the alarms are taken over.

        Call it while the node is not active: a clip that is still being taken is lost.

        Raises:
            Exception: One of :data:`.inputs.ROS_FAULTS`, or a StickslipError; all stays as it was.
        """
        replaced = self.config, self.clips, self.outputs, self.graph
        outputs = self.outputs
        try:
            self._make_outputs(config)
            session = self._make_session()
        except BaseException:
            if self.outputs is not outputs:
                self.outputs.destroy()
            self.config, self.clips, self.outputs, self.graph = replaced
            raise
        outputs.destroy()
        session.inherit(self.session)
        self.session = session

    def check_files(self) -> None:
        """Update the health on clips and state file; log each new fault as an error."""
        before = self.health.clip_fault, self.health.state_file_fault
        now = tuple('' if writer is None else writer.fault for writer in (self.clips, self._kept))
        self.health.clip_fault, self.health.state_file_fault = now
        self.health.state_file_damage = self.session.damage
        for fault, old in zip(now, before, strict=True):
            if fault and not old:
                self._node.get_logger().error(fault)

    def tick_clips(self) -> None:
        """Advance the clips, if any, to the latest time of a bearing; pass on complete ones to be written."""
        if self.clips is not None:
            bearings = self.session.monitor.bearings.values()
            self.clips.advance(max((b.now_ns or 0 for b in bearings), default=0))
            self.clips.write()

    def end_clips(self) -> None:
        """Write the unfinished clips, if any; log an error for those that the disk does not take in time."""
        if self.clips is not None:
            self.clips.close()

    def close(self) -> None:
        """Write the unfinished clips, and close the state file: alarms are not saved any more."""
        self.end_clips()
        if self._kept is not None:
            self._kept.close()
            self._kept = None

    def destroy(self) -> None:
        """Close clips and state file, and destroy the publishers."""
        self.close()
        self.outputs.destroy()


class Outputs(Sink):
    """The publishers of a configured node.

    What has no subscribers is not made, unless clips are wanted; warnings and alarms are published always.

    Args:
        clips: Takes what is published, and notice of alarms; ``None`` where no clips are wanted.

    Raises:
        Exception: One of :data:`.inputs.ROS_FAULTS`, or a RosError: a publisher cannot be made.
    """

    def __init__(
        self, node: LifecycleNode, config: MonitorConfig, health: NodeHealth, clips: Clips | None
    ) -> None:
        self._node, self._health, self._clips = node, health, clips
        self._name = node.get_fully_qualified_name().lstrip('/')
        make: Callable[..., Any] = node.create_lifecycle_publisher
        own_qos = {'qos_overriding_options': QoSOverridingOptions.with_default_policies()}
        self._warnings = make(String, '~/warnings', reliable_qos(WARNINGS_KEPT, True), **own_qos)
        self._alarms = make(String, '~/alarms', reliable_qos(ALARMS_KEPT, True), **own_qos)
        self._records = make(String, '~/bearings', reliable_qos(), **own_qos)
        self._diagnostics = make(DiagnosticArray, '/diagnostics', reliable_qos(), **own_qos)
        kinds = {
            topic: import_message_type(kind) for topic, kind in output_topics(config.bearings, '~').items()
        }
        self._bearings = {
            bearing.name: [
                (make(kinds[topic], topic, reliable_qos()), kinds[topic](), partial(verdict_value, name))
                # What is dearest to work out comes last.
                for name in (*topic_words(bearing), *reversed(topic_numbers(bearing)))
                for topic in [f'~/{bearing.name}/{name}']
            ]
            for bearing in config.bearings
        }

    def destroy(self) -> None:
        """Destroy the publishers."""
        number_publishers = [publisher for group in self._bearings.values() for publisher, *_ in group]
        for publisher in (*number_publishers, self._warnings, self._alarms, self._records, self._diagnostics):
            self._node.destroy_lifecycle_publisher(publisher)

    def take_verdict(self, verdict: Verdict) -> None:
        """Publish the numbers and words of one bearing, each on its topic if :meth:`_is_wanted`."""
        for publisher, message, value in self._bearings[verdict.bearing]:
            if self._is_wanted(publisher):
                message.data = value(verdict)
                self._publish_message(publisher, message, verdict.time_ns)

    def take_event(self, event: Event) -> None:
        """Publish an event as a JSON warning; it may begin a clip."""
        self._publish_message(self._warnings, String(data=event_json(event)), event.time_ns)
        if self._clips is not None:
            self._clips.note(event)

    def take_alarms(self, record: dict[str, Any]) -> None:
        """Publish the list of alarms, with the latest changes."""
        self._publish_message(self._alarms, String(data=json.dumps(record, allow_nan=False)))

    def take_states(self, states: list[BearingState], *, whole: bool) -> None:
        """Publish the state of bearings as JSON and as diagnostics, each if :meth:`_is_wanted`.

        Args:
            states: The states.
            whole: Whether they are of all bearings: the health of the node is then added.
        """
        now = self._node.get_clock().now()
        if self._is_wanted(self._records):
            text = bearings_json(states, now.nanoseconds)
            self._publish_message(self._records, String(data=text))
        if not self._is_wanted(self._diagnostics):
            return
        records = [diagnostic_record(self._name, state) for state in states]
        if whole:
            records.append(health_record(self._name, self._health))
        message = DiagnosticArray(status=[_status_message(record) for record in records])
        message.header.stamp = now.to_msg()
        self._publish_message(self._diagnostics, message)

    def flush(self) -> None:
        """Block until alarms, states and diagnostics are received, each for up to :data:`.MAX_LAST_PAUSE`."""
        for publisher in (self._alarms, self._records, self._diagnostics):
            publisher.wait_for_all_acked(Duration(seconds=MAX_LAST_PAUSE))

    def _is_wanted(self, publisher: Any) -> bool:
        """Return whether a message is to be made: it has a subscriber, or clips are recorded."""
        return self._clips is not None or publisher.get_subscription_count() > 0

    def _publish_message(self, publisher: Any, message: Any, time_ns: int | None = None) -> None:
        """Publish a message; before that, clips take it. A full queue loses it, which is logged.

        ``time_ns`` is its time in a clip [ns]; ``None`` for the latest of the samples.
        """
        if self._clips is not None:
            self._clips.take(publisher.topic_name, message, time_ns)
        try:
            publisher.publish(message)
        except rclpy_implementation.RCLError as error:
            # A reader that cannot keep up must not stop the monitor.
            self._node.get_logger().warning(
                f'not published on {publisher.topic_name}: {error}', throttle_duration_sec=5.0
            )


def _status_message(record: DiagnosticRecord) -> DiagnosticStatus:
    """Return a diagnostic record as a message of ROS."""
    return DiagnosticStatus(
        level=bytes([record.level]),
        name=record.name,
        hardware_id=record.hardware_id,
        message=record.message,
        values=[KeyValue(key=key, value=value) for key, value in record.values.items()],
    )


class Clips(ClipRecorder):
    """Records what passes the node, and has ``store`` write a clip around each alarm, in a thread.

    One that cannot be written is tried again until a newer one comes; of more than two that wait
    the oldest are lost.
    """

    def __init__(self, node: LifecycleNode, config: ClipConfig, store: ClipStore) -> None:
        self._node = node
        self._known: dict[str, str] = {}  # definitions by type
        self._writer = Background('clips', store.write, _CLIPS_WAITING)
        super().__init__(config, self._known)

    @property
    def fault(self) -> str:
        """Reason why the last clip is lost; empty where it is not."""
        return self._writer.fault and f'an event clip is lost: {self._writer.fault}'

    def take(self, topic: str, message: Any, time_ns: int | None = None) -> None:
        """Record a message that is published, at a time [ns]; by default at the latest of the samples.

        Raises:
            RosError: Its type is not installed.
        """
        message_class = type(message)
        kind = f'{message_class.__module__.partition(".")[0]}/msg/{message_class.__name__}'
        self.tap(topic, kind, serialize_message(message), self.now_ns if time_ns is None else time_ns)

    def tap(self, topic: str, kind: str, data: bytes, time_ns: int) -> None:
        """Record an encoded message, with its time on the clock of the samples [ns].

        Args:
            topic: Full name of its topic.
            kind: Its type, such as ``std_msgs/msg/Float64``, whose definition is stored when it is new.
            data: The message.
            time_ns: Its time [ns].

        Raises:
            RosError: The type is not installed.
        """
        if kind not in self._known:
            self._known[kind] = compose_definition(kind)
        self.add(ClipMessage(time_ns, topic, kind, data))

    def close(self, patience: float = 10.0) -> None:
        """Finish the clip that is being taken and write all that wait, for up to ``patience`` [s].

        Clips that are not written by then are lost, which is logged.
        """
        self.finish()
        self.write()
        if not self._writer.close(patience):
            self._node.get_logger().error(f'an event clip is lost: the disk takes longer than {patience:g} s')

    def write(self) -> None:
        """Hand the completed clips to the thread that writes them."""
        for clip in self.pop_clips():
            self._writer.put(clip)
