# SPDX-License-Identifier: Apache-2.0
"""Event clips of the live node: what it heard and said, taken and written in its own time."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from typing import Any

from rclpy.lifecycle import LifecycleNode
from rclpy.serialization import serialize_message

from stickslip_monitor.errors import StickslipError
from stickslip_monitor.monitor.clip_recorder import Clip, ClipMessage, ClipRecorder, ClipStore
from stickslip_monitor.monitor.config import ClipConfig
from stickslip_monitor.monitor.verdict import Event
from stickslip_monitor.ros.message_types import definition

_FAILURE_TOLD_EVERY = 60.0


class Clips:
    """Records what passes the node, and writes a clip around each alarm.

    A clip is written a little at each tick of the watchdog, so that no callback waits for the
    disk; one that cannot be written is told in the log and forgotten.

    Args:
        node: The node, for its log.
        config: How long, how many and how large.
        store: Where to.
    """

    def __init__(self, node: LifecycleNode, config: ClipConfig, store: ClipStore) -> None:
        self._node, self._store = node, store
        self._definitions: dict[str, str] = {}
        self._recorder = ClipRecorder(config, self._definitions)
        self._waiting: deque[Clip] = deque()
        self._writing: Iterator[None] | None = None

    def take(self, topic: str, message: Any, time_ns: int | None = None) -> None:
        """Take a message that was heard or said.

        Args:
            topic: Its topic.
            message: The message.
            time_ns: Its time on the clock of the samples; the latest one if ``None`` [ns].
        """
        kind = _type_name(message)
        if kind not in self._definitions:
            self._definitions[kind] = definition(kind)
        at_ns = self._recorder.now_ns if time_ns is None else time_ns
        self._recorder.add(ClipMessage(at_ns, topic, kind, serialize_message(message)))

    def note(self, event: Event) -> None:
        """Take notice of a change of an alarm."""
        self._recorder.note(event)

    def tick(self, now_ns: int) -> None:
        """Let time pass on the clock of the samples [ns], and write a little."""
        self._recorder.advance(now_ns)
        self._collect()
        self._step()

    def close(self) -> None:
        """Write what is left, the clip that is being taken too."""
        self._recorder.finish()
        self._collect()
        while self._writing is not None or self._waiting:
            self._step()

    def _collect(self) -> None:
        for clip in self._recorder.clips():
            # Not more than one waits: memory is bounded, and a further alarm a minute away.
            while self._waiting:
                self._step()
            self._waiting.append(clip)

    def _step(self) -> None:
        try:
            if self._writing is None and self._waiting:
                self._writing = self._store.write(self._waiting.popleft())
            if self._writing is not None and next(self._writing, self) is self:
                self._writing = None
        except (StickslipError, OSError) as error:
            self._writing = None
            # A full disk must not stop the monitor.
            self._node.get_logger().error(
                f'an event clip is lost: {error}', throttle_duration_sec=_FAILURE_TOLD_EVERY
            )


def _type_name(message: Any) -> str:
    kind = type(message)
    return f'{kind.__module__.partition(".")[0]}/msg/{kind.__name__}'
