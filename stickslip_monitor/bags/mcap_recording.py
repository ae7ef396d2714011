# SPDX-License-Identifier: Apache-2.0
"""A recording in MCAP: one file, or the files of a rosbag2 folder in order."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from stickslip_monitor.bags.binding import bound_to_topics
from stickslip_monitor.bags.cdr import short_name
from stickslip_monitor.bags.contents import DATED, Contents
from stickslip_monitor.bags.event_order import question_of_unit
from stickslip_monitor.bags.recording import Bound, Progress, joined, missing_topic
from stickslip_monitor.bags.series import McapReading, Wanted, merged_messages
from stickslip_monitor.bags.values import (
    Cut,
    Findings,
    Message,
    Request,
    Series,
    TimeSpans,
    TopicInfo,
)
from stickslip_monitor.errors import BagError
from stickslip_monitor.fields import FieldPath, parse_field
from stickslip_monitor.monitor.config import MonitorConfig


class McapRecording:
    """See :class:`~stickslip_monitor.bags.recording.Recording`."""

    def __init__(
        self,
        path: Path,
        files: Sequence[Contents],
        findings: Findings,
        kept: object = None,
    ) -> None:
        # Holds a folder of unpacked files for as long as the recording lives.
        self.path, self._kept = path, kept
        self.topics: dict[str, TopicInfo] = _list_topics(files)
        self._contents = tuple(files)
        self._findings = findings
        self.files: tuple[Path, ...] = tuple(file.path for file in files)
        """The MCAP files in order."""
        self.message_count = sum(file.counts.total() for file in files)
        """Messages on all topics."""
        self.cuts: tuple[Cut, ...] = tuple(file.cut for file in files if file.cut is not None)
        """The files that end too early."""
        # The least log time that is one: among dates, 0 is that of a clock that was not set.
        self._least_ns = int(any((file.end_ns or 0) >= DATED for file in files))
        starts = [file.start_ns for file in files if file.start_ns is not None]
        if self._least_ns == 0 and any(file.has_zero for file in files):
            starts.append(0)
        ends = [file.end_ns for file in files if file.end_ns is not None]
        self.start_ns: int | None = min(starts, default=None)
        """Earliest log time [ns], None in a recording without messages."""
        self.end_ns: int | None = max(ends, default=self.start_ns)
        """Latest log time [ns], None in a recording without messages."""
        most = max((topic.count for topic in self.topics.values()), default=0)
        if question := question_of_unit(self.start_ns, self.end_ns, most):
            findings.note(question)

    @property
    def warnings(self) -> tuple[str, ...]:
        """What else is wrong with the recording, as far as it was noticed until now."""
        return self._findings.texts

    @property
    def losses(self) -> tuple[str, ...]:
        """What of it was not read."""
        return (*(cut.text for cut in self.cuts), *self._findings.losses)

    def bound(self, config: MonitorConfig) -> Bound:
        """The configuration, and which inputs the recording lacks."""
        return bound_to_topics(self.path, self.topics, config)

    def definition(self, topic: str) -> str:
        """The ``ros2msg`` definition of a topic's messages."""
        self._check([topic])
        if not self.topics[topic].readable:
            raise BagError(f"topic '{topic}' cannot be read: {self.topics[topic].problem}")
        definitions = (
            file.schemas[channel.schema_id].data
            for file in self._contents
            for channel in file.channels.values()
            if channel.topic == topic
        )
        return next(definitions).decode(errors='replace')

    def read(
        self, requests: Iterable[Request], progress: Progress | None = None
    ) -> dict[Request, Series]:
        """Read numbers of some topics at once."""
        return joined(self.reading(requests, progress))

    def reading(
        self, requests: Iterable[Request], progress: Progress | None = None
    ) -> McapReading:
        """Read numbers of some topics in blocks."""
        asked: dict[str, dict[FieldPath, list[Request]]] = {}
        for request in requests:
            path = parse_field(request.field)
            self._check([request.topic])
            topic = self.topics[request.topic]
            if not topic.readable:
                raise BagError(
                    f"topic '{topic.name}' ({topic.type}) cannot be read: {topic.problem}"
                )
            if request.type is not None and short_name(request.type) != short_name(topic.type):
                raise BagError(
                    f"topic '{topic.name}' has type {topic.type} in the bag, not {request.type}"
                )
            asked.setdefault(request.topic, {}).setdefault(path, []).append(request)
        wanted = [Wanted(topic, paths) for topic, paths in asked.items()]
        return McapReading(self._contents, wanted, self._least_ns, progress)

    def _check(self, names: Iterable[str]) -> None:
        """Raise BagError for a topic that is not in the recording."""
        for name in names:
            if name not in self.topics:
                raise BagError(missing_topic(self.topics, name))

    def messages(
        self, topics: Collection[str] | None = None, spans: TimeSpans | None = None
    ) -> Iterator[Message]:
        """Yield messages by log time, then by place in the recording."""
        names = list(self.topics if topics is None else topics)
        self._check(names)
        types = {name: self.topics[name].type for name in names}
        return merged_messages(self._contents, types, spans, self._least_ns)


def _list_topics(files: Iterable[Contents]) -> dict[str, TopicInfo]:
    """List the topics of all files, by name."""
    found: dict[str, list[TopicInfo]] = {}
    for file in files:
        for key, channel in file.channels.items():
            kind, encoding = file.type_of(channel), channel.message_encoding
            info = TopicInfo(
                channel.topic, kind, file.counts[key], encoding, file.problem(channel)
            )
            found.setdefault(channel.topic, []).append(info)
    return {name: _joined(found[name]) for name in sorted(found)}


def _joined(members: Sequence[TopicInfo]) -> TopicInfo:
    """One topic of all that bear its name."""
    types = list(dict.fromkeys(each.type for each in members))
    problems = [each.problem for each in members if each.problem]
    if len(types) > 1:
        problems.append(f'it has several types: {", ".join(types)}')
    count = sum(each.count for each in members)
    return replace(members[0], count=count, problem=problems[0] if problems else '')
