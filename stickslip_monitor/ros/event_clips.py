# SPDX-License-Identifier: Apache-2.0
"""Event clips of the live node: what it heard and said, taken and written in its own time."""

from __future__ import annotations

import queue
import threading
from typing import Any

from rclpy.lifecycle import LifecycleNode
from rclpy.serialization import serialize_message

from stickslip_monitor.errors import cause
from stickslip_monitor.monitor.clip_recorder import Clip, ClipMessage, ClipRecorder, ClipStore
from stickslip_monitor.monitor.config import ClipConfig
from stickslip_monitor.monitor.verdict import Event
from stickslip_monitor.ros.message_types import definition

_FAILURE_TOLD_EVERY = 60.0
_MOST_WAITING = 2
RETRY_PERIOD = 5.0
"""A clip that cannot be written is tried again after so long [s]."""


class Clips:
    """Records what passes the node, and writes a clip around each alarm.

    Clips are written in a thread, so that no callback waits for the disk; one that cannot be
    written is tried again until a newer one comes; one that comes while two others wait is lost.

    Args:
        node: The node, for its log.
        config: How long, how many and how large.
        store: Where to.

    Attributes:
        fault: Why the last clip is lost; empty where it is not.
    """

    def __init__(self, node: LifecycleNode, config: ClipConfig, store: ClipStore) -> None:
        self._node, self._store = node, store
        self._definitions: dict[str, str] = {}
        self._recorder = ClipRecorder(config, self._definitions)
        self.fault = ''
        self._waiting: queue.Queue[Clip | None] = queue.Queue(_MOST_WAITING)
        self._thread: threading.Thread | None = None

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
        """Let time pass on the clock of the samples [ns]."""
        self._recorder.advance(now_ns)
        self._collect()

    def close(self, patience: float = 10.0) -> None:
        """Write what is left, the clip that is being taken too, within so much time [s]."""
        self._recorder.finish()
        self._collect()
        if self._thread is not None:
            try:
                self._waiting.put(None, timeout=patience)
                self._thread.join(patience)
            except queue.Full:
                self._lost(f'the disk takes longer than {patience:g} s')
            self._thread = None

    def _collect(self) -> None:
        for clip in self._recorder.clips():
            if self._thread is None:
                self._thread = threading.Thread(target=self._run, name='clips', daemon=True)
                self._thread.start()
            try:
                self._waiting.put_nowait(clip)
            except queue.Full:
                self._lost('the disk does not keep up')

    def _run(self) -> None:
        clip = self._waiting.get()
        while clip is not None:
            clip = self._waiting.get() if self._written(clip) else self._after_a_while(clip)

    def _written(self, clip: Clip) -> bool:
        try:
            for _ in self._store.write(clip):
                pass
        except Exception as error:
            # Neither a full disk nor a fault of ours may stop the monitor, or later clips.
            self._lost(cause(error))
            return False
        self.fault = ''
        return True

    def _after_a_while(self, clip: Clip) -> Clip | None:
        """The clip once more, unless a newer one waits: that it can be written may come back."""
        try:
            return self._waiting.get(timeout=RETRY_PERIOD)
        except queue.Empty:
            return clip

    def _lost(self, reason: str) -> None:
        self.fault = f'an event clip is lost: {reason}'
        self._node.get_logger().error(self.fault, throttle_duration_sec=_FAILURE_TOLD_EVERY)


def _type_name(message: Any) -> str:
    kind = type(message)
    return f'{kind.__module__.partition(".")[0]}/msg/{kind.__name__}'
