# SPDX-License-Identifier: Apache-2.0
"""Event clips: the messages around an alarm, kept in bounded memory until they are a clip.

Nothing is written here and no clock is read: the recorder is given messages, events and times,
and hands out whole clips. All times are those of the samples.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol

from stickslip_monitor.monitor.parameters import ClipConfig
from stickslip_monitor.monitor.severity import Condition, Severity
from stickslip_monitor.monitor.statements import Event

# What a message takes beside its data, in memory and in the file, roughly [bytes].
_OVERHEAD = 100


class ClipMessage(NamedTuple):
    """One message, encoded in CDR."""

    time_ns: int
    topic: str
    type: str
    data: bytes

    @property
    def size(self) -> int:
        """The bytes it counts for."""
        return len(self.data) + _OVERHEAD


@dataclass(frozen=True, slots=True)
class Clip:
    """The messages around an alarm."""

    bearing: str  # whose alarm began it
    condition: Condition  # that of the alarm
    time_ns: int  # when it began
    messages: tuple[ClipMessage, ...]  # in order of arrival
    # The 'ros2msg' definition of each type that is not built in.
    definitions: Mapping[str, str] = field(default_factory=dict)


class ClipStore(Protocol):
    """Store that takes clips."""

    def write(self, clip: Clip) -> None:
        """Write a clip.

        Raises:
            StickslipError: It cannot be written; the text says why.
        """


def begins_clip(event: Event) -> bool:
    """Return whether an event begins a clip: it is raised, to a condition of severity ERROR."""
    return event.raised and event.after.severity is Severity.ERROR


class ClipRecorder:
    """Keeps the last messages, and takes a clip when an alarm begins.

    A further alarm while a clip is taken lengthens it. Half of a clip's size is for what was before the
    alarm; a clip that is full ends there.

    Args:
        config: Length and size of clips.
        definitions: The ``ros2msg`` text of each type that is not built in; it may grow later. ``None`` for
            none.

    Attributes:
        now_ns: The latest time of the samples [ns]; 0 before the first.
    """

    def __init__(self, config: ClipConfig, definitions: Mapping[str, str] | None = None) -> None:
        self.config = config
        self._definitions = {} if definitions is None else definitions
        self.now_ns = 0
        self._past: deque[ClipMessage] = deque()
        self._past_size = 0
        self._event: Event | None = None
        self._taken: list[ClipMessage] = []
        self._taken_size = 0
        self._end_ns = 0
        self._done: list[Clip] = []

    def add(self, message: ClipMessage) -> None:
        """Let time pass to that of a message, as :meth:`advance`; store it, also in the clip being taken.

        A clip that is full by it ends; :meth:`pop_clips` returns it. Stored messages older than a clip
        reaches back, or beyond half of its size, are dropped. A message that is older itself, by more than
        that, is of a clock that was set: it ends the clip, and all before it is dropped.
        """
        self.advance(message.time_ns)
        self._past.append(message)
        self._past_size += message.size
        self._drop_old()
        if self._event is not None:
            self._taken.append(message)
            self._taken_size += message.size
            if self._taken_size >= self.config.size:
                self.finish()

    def note(self, event: Event) -> None:
        """Begin a clip by an event of :func:`begins_clip`, or lengthen the one that is being taken.

        A new clip begins with the messages stored so far. Other events do nothing.
        """
        if not begins_clip(event):
            return
        self._end_ns = event.time_ns + self.config.around_ns
        if self._event is None:
            self._event = event
            self._taken = list(self._past)
            self._taken_size = self._past_size

    def advance(self, time_ns: int) -> None:
        """Let time pass up to a time of the samples [ns]; a clip ends ``around_ns`` after its last alarm.

        A step back by more than that is a jump of the clock: it ends the clip and drops the past.
        """
        if time_ns < self.now_ns - self.config.around_ns:
            self.finish()
            self._past.clear()
            self._past_size = 0
            self.now_ns = time_ns
        self.now_ns = max(self.now_ns, time_ns)
        if self._event is not None and self.now_ns > self._end_ns:
            self.finish()

    def pop_clips(self) -> list[Clip]:
        """Return the clips that ended since the last call, in order, and forget them."""
        done, self._done = self._done, []
        return done

    def finish(self) -> None:
        """End the clip that is being taken, if any, with the messages so far, for :meth:`pop_clips`."""
        if self._event is None:
            return
        event, taken = self._event, tuple(self._taken)
        clip = Clip(event.bearing, event.after, event.time_ns, taken, dict(self._definitions))
        self._done.append(clip)
        self._event, self._taken = None, []

    def _drop_old(self) -> None:
        """Drop messages that are older than a clip reaches, or that exceed half of its size."""
        oldest = self.now_ns - self.config.around_ns
        while self._past and (self._past[0].time_ns < oldest or self._past_size > self.config.size // 2):
            self._past_size -= self._past.popleft().size
