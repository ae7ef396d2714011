# SPDX-License-Identifier: Apache-2.0
"""What crosses the border of the bag layer: plain values, without behaviour."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from stickslip_monitor.arrays import BoolArray, FloatArray, IntArray

METADATA_NAME, METADATA_ROOT = 'metadata.yaml', 'rosbag2_bagfile_information'
"""The file that describes a rosbag2 folder, and the key of all in it."""
_MOST_TOLD = 50


class Findings:
    """Sentences on a recording, each once, and not without end."""

    def __init__(self) -> None:
        # Whether each of them costs data.
        self._texts: dict[str, bool] = {}
        self._more = {False: 0, True: 0}

    def note(self, text: str, *, is_loss: bool = False) -> None:
        """Take up what is odd and costs no data."""
        if text not in self._texts and len(self._texts) >= _MOST_TOLD:
            self._more[is_loss] += 1
        else:
            self._texts[text] = is_loss

    def lose(self, text: str) -> None:
        """Take up what was not read."""
        self.note(text, is_loss=True)

    @property
    def texts(self) -> tuple[str, ...]:
        """All of them, and how many were too many."""
        return (*self._texts, *self._rest(sum(self._more.values())))

    @property
    def losses(self) -> tuple[str, ...]:
        """Those that cost data, and how many were too many."""
        known = (text for text, is_loss in self._texts.items() if is_loss)
        return (*known, *self._rest(self._more[True]))

    def _rest(self, more: int) -> tuple[str, ...]:
        return (f'{more} more findings are not listed',) if more else ()


@dataclass(frozen=True, slots=True)
class TopicInfo:
    """A topic of a recording.

    ``problem`` is a clause on why its messages cannot be decoded, as far as that is known without
    its definition, which is read when a field is asked for; else empty.
    """

    name: str
    type: str
    count: int
    encoding: str
    problem: str


@dataclass(frozen=True, slots=True)
class Cut:
    """Where a recording file ends too early.

    The byte at which its last whole record ends, its length, and the latest log time among the
    messages that were saved.
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

    All arrays have one length.  ``stamp_ns`` is the header's stamp where there is one and it is
    not zero, else the log time.  ``sequence`` numbers the messages of all topics read together, so
    that several series merge by it alone.  ``value`` is NaN where ``faults`` counts a message
    without one.
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


class TimeSpans:
    """Stretches of time with first and last instant [ns], both included; they may overlap."""

    def __init__(self, spans: Iterable[tuple[int, int]]) -> None:
        self.spans: list[tuple[int, int]] = []
        for start, end in sorted(spans):
            if self.spans and start <= self.spans[-1][1]:
                start, other = self.spans.pop()
                end = max(end, other)
            self.spans.append((start, end))
        self._edges = np.array(self.spans, np.int64).reshape(-1, 2)

    def holds(self, time_ns: IntArray) -> BoolArray:
        """Whether each time is in any of them, shape (n,)."""
        starts, ends = self._edges.T
        number = np.searchsorted(starts, time_ns, 'right') - 1
        inside: BoolArray = (number >= 0) & (time_ns <= np.append(ends, -1)[number])
        return inside

    def overlap(self, start_ns: int, end_ns: int) -> bool:
        """Whether any of them has an instant of a stretch."""
        return any(start <= end_ns and start_ns <= end for start, end in self.spans)
