# SPDX-License-Identifier: Apache-2.0
"""What crosses the border of the bag layer: plain values, without behaviour."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from stickslip_monitor.arrays import FloatArray, IntArray


@dataclass(frozen=True, slots=True)
class TopicInfo:
    """A topic of a recording.

    ``problem`` is one clause saying why its messages cannot be decoded, as far as that is known
    without its definition, which is read when a field is asked for; else empty.
    """

    name: str
    type: str
    count: int
    encoding: str
    problem: str

    @property
    def readable(self) -> bool:
        """Whether a field of this topic can be asked for."""
        return not self.problem


@dataclass(frozen=True, slots=True)
class Cut:
    """Where a recording file ends too early.

    ``offset`` is the byte at which the last whole record ends, ``size`` the file's length, and
    ``last_time_ns`` the latest log time among the messages that were saved.
    """

    path: Path
    offset: int
    size: int
    last_time_ns: int | None
    text: str


@dataclass(frozen=True, slots=True)
class Request:
    """One number to read from every message of a topic; ``type`` is checked when given."""

    topic: str
    field: str
    type: str | None = None


@dataclass(frozen=True, slots=True)
class Fault:
    """Messages that gave no value, and why."""

    count: int
    text: str


@dataclass(frozen=True, slots=True, eq=False)
class Series:
    """One number of every message of a topic, in order of log time, then of place in the bag.

    All arrays have one length.  ``stamp_ns`` is the header's stamp where the message has a header
    and the stamp is not zero, else the log time.  ``sequence`` numbers the messages of all topics
    read together, so that several series merge by it alone.  ``value`` is NaN where ``faults``
    counts a message without a value.
    """

    log_time_ns: IntArray
    stamp_ns: IntArray
    sequence: IntArray
    value: FloatArray
    faults: tuple[Fault, ...]


@dataclass(frozen=True, slots=True)
class Message:
    """One recorded message, still encoded."""

    topic: str
    type: str
    log_time_ns: int
    data: bytes
