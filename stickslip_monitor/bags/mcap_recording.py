# SPDX-License-Identifier: Apache-2.0
"""A recording in MCAP: one file, or the files of a rosbag2 folder in order."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from stickslip_monitor.bags.binding import bound_to_topics
from stickslip_monitor.bags.contents import DATED, Contents
from stickslip_monitor.bags.event_order import question_of_unit
from stickslip_monitor.bags.recording import Bound, Progress, Recording
from stickslip_monitor.bags.series import McapReading, Wanted, merged_messages
from stickslip_monitor.bags.values import Findings, Message, Request, TimeSpans, TopicInfo
from stickslip_monitor.monitor.config import MonitorConfig


class McapRecording(Recording):
    """The files of a recording in MCAP."""

    def __init__(
        self, path: Path, files: Sequence[Contents], findings: Findings, kept: object = None
    ) -> None:
        # Holds a folder of unpacked files for as long as the recording lives.
        self.path, self._kept = path, kept
        self._topics = _list_topics(files)
        self._contents = tuple(files)
        self._findings = findings
        self.files = tuple(file.path for file in files)
        self._message_count = sum(file.counts.total() for file in files)
        self.cuts = tuple(file.cut for file in files if file.cut is not None)
        # The least log time that is one: among dates, 0 is that of a clock that was not set.
        self._least_ns = int(any((file.end_ns or 0) >= DATED for file in files))
        starts = [file.start_ns for file in files if file.start_ns is not None]
        if self._least_ns == 0 and any(file.has_zero for file in files):
            starts.append(0)
        ends = [file.end_ns for file in files if file.end_ns is not None]
        self.start_ns = min(starts, default=None)
        self.end_ns = max(ends, default=self.start_ns)
        most = max((topic.count for topic in self.topics.values()), default=0)
        if question := question_of_unit(self.start_ns, self.end_ns, most):
            findings.note(question)

    def bound(self, config: MonitorConfig) -> Bound:
        """The configuration, and which inputs the recording lacks."""
        return bound_to_topics(self.path, self.topics, config)

    def definition(self, topic: str) -> str:
        """The ``ros2msg`` definition of a topic's messages."""
        self._readable(topic)
        definitions = (
            file.schemas[channel.schema_id].data
            for file in self._contents
            for channel in file.channels.values()
            if channel.topic == topic
        )
        return next(definitions).decode(errors='replace')

    def reading(self, requests: Iterable[Request], progress: Progress | None = None) -> McapReading:
        """Read numbers of some topics in blocks."""
        wanted = [Wanted(topic, paths) for topic, paths in self._asked(requests).items()]
        return McapReading(self._contents, wanted, self._least_ns, progress)

    def messages(
        self, topics: Collection[str] | None = None, spans: TimeSpans | None = None
    ) -> Iterator[Message]:
        """Yield messages by log time, then by place in the recording."""
        names = list(self.topics if topics is None else topics)
        types = {name: self._topic(name).type for name in names}
        return merged_messages(self._contents, types, spans, self._least_ns)


def _list_topics(files: Iterable[Contents]) -> dict[str, TopicInfo]:
    """List the topics of all files, by name."""
    found: dict[str, list[TopicInfo]] = {}
    for file in files:
        for key, channel in file.channels.items():
            kind, encoding = file.type_of(channel), channel.message_encoding
            info = TopicInfo(channel.topic, kind, file.counts[key], encoding, file.problem(channel))
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
