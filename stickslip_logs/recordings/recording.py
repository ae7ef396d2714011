# SPDX-License-Identifier: Apache-2.0
"""Defines the protocol of every recording, its requests and its results."""

from __future__ import annotations

import difflib
import shutil
import tempfile
import weakref
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from stickslip_logs.arrays import BoolArray, FloatArray, IntArray
from stickslip_logs.errors import MAX_NAMED, BagError, join_names
from stickslip_logs.field_paths import FieldPath, parse_field

METADATA_NAME, METADATA_ROOT = 'metadata.yaml', 'rosbag2_bagfile_information'
"""The file that describes a rosbag2 folder, and the key of all in it."""


class Scratch:
    """A folder for what is unpacked, made when it is asked for, that goes with its recording."""

    @cached_property
    def folder(self) -> Path:
        """The folder, made when first asked for (OSError where that fails), and removed with this object."""
        path = tempfile.mkdtemp(prefix='stickslip-')
        weakref.finalize(self, shutil.rmtree, path, ignore_errors=True)
        return Path(path)


class Findings:
    """Warnings of a recording, each once; only the first 50 are listed."""

    def __init__(self) -> None:
        # Whether each of them costs data.
        self._texts: dict[str, bool] = {}

    def note(self, text: str) -> None:
        """Add a warning that costs no data, or mark it as such where it was added as a loss."""
        self._texts[text] = False

    def lose(self, text: str) -> None:
        """Add a warning of data that were not read, or mark it as such where it was added before."""
        self._texts[text] = True

    @property
    def texts(self) -> tuple[str, ...]:
        """The first 50 warnings, and last how many are not listed."""
        return _first_texts(list(self._texts))

    @property
    def losses(self) -> tuple[str, ...]:
        """The first 50 warnings of data that were not read, and last how many are not listed."""
        return _first_texts([text for text, is_loss in self._texts.items() if is_loss])


def _first_texts(texts: list[str]) -> tuple[str, ...]:
    """Return the first 50 texts, and one on how many more there are: they say nothing new."""
    more = len(texts) - 50
    return (*texts[:50], *([f'{more} more findings are not listed'] if more > 0 else []))


@dataclass(frozen=True, slots=True)
class TopicInfo:
    """A topic of a recording.

    ``problem`` is a clause on why its messages cannot be decoded, as far as that is known without its
    definition, which is read when a field is asked for; else empty. ``value`` is one of its values in a log.
    """

    name: str
    type: str
    count: int
    encoding: str
    problem: str
    value: str = ''


@dataclass(frozen=True, slots=True)
class Cut:
    """Place where a file of a recording ends too early.

    ``offset`` is the byte at which its last whole record ends, ``size`` its length [bytes], ``text`` a
    sentence on what was recovered.
    """

    path: Path
    offset: int
    size: int
    text: str


@dataclass(frozen=True, slots=True)
class Request:
    """One number to read from every message of a topic, at the path ``field`` (:func:`.parse_field`).

    ``type``, full or short, is checked when given.
    """

    topic: str
    field: str
    type: str | None = None


@dataclass(frozen=True, slots=True)
class Fault:
    """Messages that gave no value, and why."""

    count: int
    text: str
    is_nan: bool = False  # whether each stands as NaN among the values


@dataclass(frozen=True, slots=True, eq=False)
class Series:
    """One number of every message of a topic, in order of log time, then of place in the bag.

    All arrays have one length. ``stamp_ns`` is the header's stamp where there is one and it is not zero, else
    the log time. ``sequence`` numbers the messages of all topics read together, so that several series merge
    by it alone. ``value`` is NaN where ``faults`` counts a message without one.
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
    """Stretches of time with first and last instant [ns], both included; ``spans`` are sorted and disjoint.

    Args:
        spans: The stretches, in any order; those that overlap are joined.
    """

    def __init__(self, spans: Iterable[tuple[int, int]]) -> None:
        self.spans: list[tuple[int, int]] = []
        for start, end in sorted(spans):
            if self.spans and start <= self.spans[-1][1]:
                start, last = self.spans.pop()
                end = max(end, last)
            self.spans.append((start, end))
        self._edges = np.array(self.spans, np.int64).reshape(-1, 2)

    def holds(self, time_ns: IntArray) -> BoolArray:
        """Return whether each time [ns] is in any of the stretches, shape (n,)."""
        starts, ends = self._edges.T
        number = np.searchsorted(starts, time_ns, 'right') - 1
        inside: BoolArray = (number >= 0) & (time_ns <= np.append(ends, -1)[number])
        return inside

    def overlap(self, start_ns: int, end_ns: int) -> bool:
        """Return whether a stretch of time shares an instant with any of these [ns]."""
        return any(start <= end_ns and start_ns <= end for start, end in self.spans)


Progress = Callable[[int, int], None]
"""Given how much is done, and how much there is to do: bytes of MCAP, row ids of SQLite, or lines."""


class Reading(Protocol):
    """A pass over a recording for some numbers, in bounded memory.

    Iterating, once, gives a series for each request, for one stretch of time after the other, at least one.
    """

    def __iter__(self) -> Iterator[dict[Request, Series]]: ...

    def faults(self) -> dict[Request, tuple[Fault, ...]]:
        """Return the faults of the messages read so far, by request; an empty tuple where there are none."""
        ...


class Recording(ABC):
    """A recording that was opened; nothing stays open between calls.

    Attributes:
        path: The file or folder.
        files: The files in order.
        start_ns: Earliest log time [ns], None in a recording without messages.
        end_ns: Latest log time [ns], likewise.
        cuts: The files that end too early.
    """

    path: Path
    files: tuple[Path, ...]
    start_ns: int | None
    end_ns: int | None
    cuts: tuple[Cut, ...] = ()
    _topics: Mapping[str, TopicInfo]
    _message_count: int
    _findings: Findings

    @property
    def topics(self) -> Mapping[str, TopicInfo]:
        """The topics by name: sorted; those of a table by its columns, or as they were delivered."""
        return self._topics

    @property
    def message_count(self) -> int:
        """Messages on all topics."""
        return self._message_count

    @property
    def warnings(self) -> tuple[str, ...]:
        """Oddities, guesses, and losses but cuts, as far as noticed: up to 50, then how many more."""
        return self._findings.texts

    @property
    def losses(self) -> tuple[str, ...]:
        """Losses: cuts, and those of the warnings that cost data."""
        return (*(cut.text for cut in self.cuts), *self._findings.losses)

    def note(self, text: str) -> None:
        """Add a warning that costs no data."""
        self._findings.note(text)

    def lose(self, text: str) -> None:
        """Add a warning of data that were not read or not used."""
        self._findings.lose(text)

    @abstractmethod
    def reading(self, requests: Iterable[Request], progress: Progress | None = None) -> Reading:
        """Return a pass that reads numbers of some topics, one stretch of time after the other.

        Args:
            requests: The numbers to read.
            progress: Called during the pass with how much is done and to do.

        Raises:
            BagError: A topic is not there or cannot be decoded, a field is not in its type or no
                number, or a file cannot be read.
            FieldError: A field is not a path.
            OSError: A file is no longer there.
        """

    def read(self, requests: Iterable[Request], progress: Progress | None = None) -> dict[Request, Series]:
        """Read a whole recording at once; return a series for each request, with its faults.

        What cannot be read is missing, and ``losses`` names it. The arguments are those of :meth:`reading`.

        Raises:
            BagError: As for :meth:`reading`; also FieldError and OSError.
        """
        reading = self.reading(requests, progress)
        parts = list(reading)
        faults = reading.faults()

        def join(request: Request, name: str) -> Any:
            """Return an array of all series of a request, joined."""
            return np.concatenate([getattr(part[request], name) for part in parts])

        names = 'log_time_ns', 'stamp_ns', 'sequence', 'value'
        return {
            request: Series(**{name: join(request, name) for name in names}, faults=faults[request])
            for request in parts[0]
        }

    @abstractmethod
    def messages(
        self, topics: Collection[str] | None = None, spans: TimeSpans | None = None
    ) -> Iterator[Message]:
        """Yield messages in the order of time, then of place in the recording.

        Args:
            topics: Which topics; all when None.
            spans: The log times that are wanted; all that are valid when None.

        Raises:
            BagError: A topic is not there, or a file cannot be read.
            OSError: A file is no longer there.
        """

    @abstractmethod
    def definition(self, topic: str) -> str:
        """Return the ``ros2msg`` definition of a topic's messages.

        Raises:
            BagError: The topic is not there or cannot be decoded.
        """

    def _require_topic(self, name: str) -> TopicInfo:
        """Return the topic of a name.

        Raises:
            BagError: There is none; the text lists up to ten others.
        """
        if name not in self.topics:
            raise BagError(missing_topic(self.topics, name))
        return self.topics[name]

    def _require_readable(self, name: str) -> TopicInfo:
        """Return the topic of a name.

        Raises:
            BagError: It is not there or cannot be decoded.
        """
        topic = self._require_topic(name)
        if topic.problem:
            raise BagError(f"topic '{name}' ({topic.type}) cannot be read: {topic.problem}")
        return topic

    def _group_requests(self, requests: Iterable[Request]) -> dict[str, dict[FieldPath, list[Request]]]:
        """Group requests by topic, then by path of the field, both in sorted order.

        Raises:
            BagError: A topic is not there, cannot be decoded, or has another type than asked for.
            FieldError: A field is not a path.
        """
        by_topic: dict[str, dict[FieldPath, list[Request]]] = {}
        # They may be a set, whose order is by chance.
        for request in sorted(requests, key=lambda item: (item.topic, item.field)):
            path, topic = parse_field(request.field), self._require_readable(request.topic)
            if request.type is not None and short_type(request.type) != short_type(topic.type):
                raise BagError(f"topic '{topic.name}' has type {topic.type} in the bag, not {request.type}")
            by_topic.setdefault(request.topic, {}).setdefault(path, []).append(request)
        return by_topic


def short_type(name: str) -> str:
    """Write a type name without its middle: ``std_msgs/msg/Float64`` is ``std_msgs/Float64``.

    It must have a slash.
    """
    parts = name.split('/')
    return f'{parts[0]}/{parts[-1]}'


def missing_topic(topics: Collection[str], name: str) -> str:
    """Return the error text on a missing topic, with up to ten that are there, similar names first."""
    close = difflib.get_close_matches(name, topics, MAX_NAMED, cutoff=0.5)
    ranked = [*close, *(topic for topic in topics if topic not in close)]
    return f"the recording has no topic '{name}': it has {join_names(ranked) or 'no topics'}"


def full_topic(topic: str, topics: Collection[str]) -> str:
    """Return the name that a topic written without its namespace has in a recording.

    That is in the root namespace, unless only another namespace has a topic of that name. A name that is in
    the recording, is empty, or begins with a slash or ``~`` is returned as it is.
    """
    if topic in topics or topic.startswith(('/', '~')) or not topic:
        return topic
    in_root = f'/{topic}'
    candidates = [name for name in topics if name.endswith(in_root)]
    return candidates[0] if len(candidates) == 1 and in_root not in topics else in_root
