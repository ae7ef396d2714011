# SPDX-License-Identifier: Apache-2.0
"""What every recording gives, whatever it is stored as; nothing above asks for the format."""

from __future__ import annotations

import difflib
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from stickslip_monitor.bags.cdr import short_name
from stickslip_monitor.bags.values import Cut, Fault, Findings, Message, Request, Series, TimeSpans, TopicInfo
from stickslip_monitor.errors import BagError
from stickslip_monitor.fields import FieldPath, parse_field
from stickslip_monitor.monitor.config import MonitorConfig

Progress = Callable[[int, int], None]
"""Given how much is done, and how much there is to do [bytes]."""
MOST_NAMED = 10
_COLUMNS = ('log_time_ns', 'stamp_ns', 'sequence', 'value')


class Reading(Protocol):
    """A pass over a recording for some numbers, in bounded memory.

    Iterating gives a series for each request, for one stretch of time after the other.
    """

    def __iter__(self) -> Iterator[dict[Request, Series]]: ...

    def faults(self) -> dict[Request, tuple[Fault, ...]]:
        """What was wrong with the messages read so far."""
        ...


@dataclass(frozen=True, slots=True)
class Bound:
    """A configuration as it holds for one recording.

    Attributes:
        config: The configuration, with the topics and the timeouts that hold for the recording.
        absent: Why an input is not in the recording, by bearing and quantity.
    """

    config: MonitorConfig
    absent: Mapping[tuple[str, str], str] = field(default_factory=dict)


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
        """The topics by name."""
        return self._topics

    @property
    def message_count(self) -> int:
        """Messages on all topics."""
        return self._message_count

    @property
    def warnings(self) -> tuple[str, ...]:
        """What is odd about it and what was guessed, as far as it was noticed until now."""
        return self._findings.texts

    @property
    def losses(self) -> tuple[str, ...]:
        """What of it was not read: cuts, and those of the warnings that cost data."""
        return (*(cut.text for cut in self.cuts), *self._findings.losses)

    @abstractmethod
    def bound(self, config: MonitorConfig) -> Bound:
        """The configuration as it holds for this recording, and which inputs are not in it.

        Raises:
            BagError: It is not to be told which part of the recording an input is.
        """

    @abstractmethod
    def reading(self, requests: Iterable[Request], progress: Progress | None = None) -> Reading:
        """Read numbers of some topics in blocks, one stretch of time after the other.

        Raises:
            BagError: A topic is not there or cannot be decoded, a field is not in its type or no
                number, or a file cannot be read.
            ConfigurationError: A field is not a path.
        """

    def read(self, requests: Iterable[Request], progress: Progress | None = None) -> dict[Request, Series]:
        """The same at once: a series for each request.

        What cannot be read is missing, and ``losses`` names it.
        """
        return joined(self.reading(requests, progress))

    @abstractmethod
    def messages(
        self, topics: Collection[str] | None = None, spans: TimeSpans | None = None
    ) -> Iterator[Message]:
        """Yield messages in the order of time, then of place in the recording.

        Args:
            topics: Which topics; all when None.
            spans: The log times that are wanted; all when None.

        Raises:
            BagError: A topic is not there, or a file cannot be read.
        """

    @abstractmethod
    def definition(self, topic: str) -> str:
        """The ``ros2msg`` definition of a topic's messages.

        Raises:
            BagError: The topic is not there or cannot be decoded.
        """

    def _topic(self, name: str) -> TopicInfo:
        """The topic of that name; a BagError where there is none."""
        if name not in self.topics:
            raise BagError(missing_topic(self.topics, name))
        return self.topics[name]

    def _readable(self, name: str) -> TopicInfo:
        """The topic of that name; a BagError where its messages cannot be decoded."""
        topic = self._topic(name)
        if topic.problem:
            raise BagError(f"topic '{name}' ({topic.type}) cannot be read: {topic.problem}")
        return topic

    def _asked(self, requests: Iterable[Request]) -> dict[str, dict[FieldPath, list[Request]]]:
        """The requests by topic and field; a BagError where a topic is not of its type."""
        asked: dict[str, dict[FieldPath, list[Request]]] = {}
        for request in requests:
            path, topic = parse_field(request.field), self._readable(request.topic)
            if request.type is not None and short_name(request.type) != short_name(topic.type):
                raise BagError(f"topic '{topic.name}' has type {topic.type} in the bag, not {request.type}")
            asked.setdefault(request.topic, {}).setdefault(path, []).append(request)
        return asked


def joined(reading: Reading) -> dict[Request, Series]:
    """The series of a whole recording."""
    parts = list(reading)
    faults = reading.faults()

    def whole(request: Request, name: str) -> Any:
        return np.concatenate([getattr(part[request], name) for part in parts])

    return {
        request: Series(**{name: whole(request, name) for name in _COLUMNS}, faults=faults[request])
        for request in parts[0]
    }


def missing_topic(topics: Collection[str], name: str) -> str:
    """The sentence on a missing topic: those that are there, the nearest first."""
    close = difflib.get_close_matches(name, topics, MOST_NAMED, cutoff=0.5)
    ranked = [*close, *(topic for topic in topics if topic not in close)]
    more = len(ranked) - MOST_NAMED
    rest = f' and {more} more' if more > 0 else ''
    listed = f'{", ".join(ranked[:MOST_NAMED])}{rest}' if ranked else 'no topics'
    return f"the recording has no topic '{name}': it has {listed}"
