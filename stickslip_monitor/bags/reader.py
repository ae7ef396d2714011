# SPDX-License-Identifier: Apache-2.0
"""Reads a recording: one MCAP file, or a rosbag2 folder of them."""

from __future__ import annotations

import difflib
import re
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from stickslip_monitor.arrays import IntArray
from stickslip_monitor.bags.cdr import short_name
from stickslip_monitor.bags.contents import DATED, Contents, scan_file
from stickslip_monitor.bags.metadata import FILE_NAME, read_metadata
from stickslip_monitor.bags.series import (
    Pass,
    Progress,
    Reading,
    Wanted,
    joined,
    merged_messages,
    payloads,
)
from stickslip_monitor.bags.values import (
    Cut,
    Fault,
    Findings,
    Message,
    Payload,
    Request,
    Series,
    TimeSpans,
    TopicInfo,
)
from stickslip_monitor.errors import BagError
from stickslip_monitor.fields import FieldPath, parse_field
from stickslip_monitor.files import near_name

__all__ = ['Bag', 'Cut', 'Fault', 'Message', 'Request', 'Series', 'TopicInfo', 'open_bag']

_MOST_NAMED = 10
_LATEST_NS = (1 << 63) - 1


class Bag:
    """A recording that was opened; nothing stays open between calls."""

    def __init__(self, path: Path, files: Sequence[Contents], findings: Findings) -> None:
        """Put the files of a recording together; see :func:`open_bag`."""
        self.path = path
        self.topics: dict[str, TopicInfo] = _list_topics(files)
        self._contents = tuple(files)
        self._findings = findings

    @property
    def files(self) -> tuple[Path, ...]:
        """The MCAP files in order."""
        return tuple(file.path for file in self._contents)

    @property
    def start_ns(self) -> int | None:
        """Earliest log time [ns], None in a recording without messages."""
        starts = [file.start_ns for file in self._contents if file.start_ns is not None]
        if self._earliest_ns == 0 and any(file.has_zero for file in self._contents):
            starts.append(0)
        return min(starts, default=None)

    @property
    def end_ns(self) -> int | None:
        """Latest log time [ns], None in a recording without messages."""
        ends = [file.end_ns for file in self._contents if file.end_ns is not None]
        return max(ends, default=self.start_ns)

    @property
    def _earliest_ns(self) -> int:
        """The least log time that is one: among dates, 0 is that of a clock that was not set."""
        return int(any((file.end_ns or 0) >= DATED for file in self._contents))

    @property
    def message_count(self) -> int:
        """Messages on all topics."""
        return sum(file.counts.total() for file in self._contents)

    @property
    def cuts(self) -> tuple[Cut, ...]:
        """The files that end too early."""
        return tuple(file.cut for file in self._contents if file.cut is not None)

    @property
    def warnings(self) -> tuple[str, ...]:
        """What else is wrong with the recording, as far as it was noticed until now."""
        return self._findings.texts

    def definition(self, topic: str) -> str:
        """The ``ros2msg`` definition of a topic's messages.

        Raises:
            BagError: The topic is not there or cannot be decoded.
        """
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
        """Read numbers of some topics.

        Args:
            requests: What to read.
            progress: Told the bytes done and the bytes to do after each block.

        Returns:
            A series for each request; the messages of a damaged chunk are missing, and
            ``warnings`` names it.

        Raises:
            BagError: A topic is not there or cannot be decoded, a field is not in its type or no
                number, or a file cannot be read.
            ConfigurationError: A field is not a path.
        """
        return joined(self.reading(requests, progress))

    def reading(self, requests: Iterable[Request], progress: Progress | None = None) -> Reading:
        """Read numbers of some topics in blocks, in bounded memory.

        Args:
            requests: What to read.
            progress: Told the bytes done and the bytes to do after each block.

        Returns:
            What gives the series block by block, one stretch of time after the other.

        Raises:
            BagError: As of :meth:`read`.
            ConfigurationError: As of :meth:`read`.
        """
        asked: dict[str, dict[FieldPath, list[Request]]] = {}
        for request in requests:
            path = self._checked(request)
            asked.setdefault(request.topic, {}).setdefault(path, []).append(request)
        wanted = [Wanted(topic, self.topics[topic].type, paths) for topic, paths in asked.items()]
        return Reading(self._contents, wanted, self._findings, progress)

    def _check(self, names: Iterable[str]) -> None:
        """Raise BagError for a topic that is not in the recording."""
        for name in names:
            if name not in self.topics:
                raise BagError(missing_topic(self.topics, name))

    def _checked(self, request: Request) -> FieldPath:
        """The path to what a request asks for, if its topic has it."""
        path = parse_field(request.field)
        self._check([request.topic])
        topic = self.topics[request.topic]
        if not topic.readable:
            raise BagError(f"topic '{topic.name}' ({topic.type}) cannot be read: {topic.problem}")
        if request.type is not None and short_name(request.type) != short_name(topic.type):
            raise BagError(
                f"topic '{topic.name}' has type {topic.type} in the bag, not {request.type}"
            )
        return path

    def messages(
        self, topics: Collection[str] | None = None, spans: TimeSpans | None = None
    ) -> Iterator[Message]:
        """Yield messages by log time, then by place in the recording.

        Args:
            topics: Which topics; all when None.
            spans: The log times that are wanted; all when None.

        Yields:
            The messages, still encoded.

        Raises:
            BagError: A topic is not there, or a file cannot be read.
        """
        way, types = self._pass(topics, spans)
        return merged_messages(way, types, spans or self._always)

    def payloads(
        self, topics: Collection[str], spans: TimeSpans | None = None
    ) -> Iterator[tuple[int, dict[str, tuple[IntArray, Payload]]]]:
        """Yield messages by the block, still encoded, in the order in which blocks begin.

        Args:
            topics: Which topics.
            spans: The log times that are wanted; all when None.

        Yields:
            When a block begins [ns], and log times and messages of each topic in it.

        Raises:
            BagError: A topic is not there, or a file cannot be read.
        """
        way, _ = self._pass(topics, spans)
        return payloads(way, spans or self._always)

    @property
    def _always(self) -> TimeSpans:
        return TimeSpans([(self._earliest_ns, _LATEST_NS)])

    def _pass(
        self, topics: Collection[str] | None, spans: TimeSpans | None
    ) -> tuple[Pass, dict[str, str]]:
        names = list(self.topics if topics is None else topics)
        self._check(names)
        types = {name: self.topics[name].type for name in names}
        return Pass(self._contents, types, self._findings, spans=spans), types


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


def missing_topic(topics: Collection[str], name: str) -> str:
    """What there is to say of a topic that is not there: those that are, the nearest first."""
    close = difflib.get_close_matches(name, topics, _MOST_NAMED, cutoff=0.5)
    ranked = [*close, *(topic for topic in topics if topic not in close)]
    more = len(ranked) - _MOST_NAMED
    rest = f' and {more} more' if more > 0 else ''
    listed = f'{", ".join(ranked[:_MOST_NAMED])}{rest}' if ranked else 'no topics'
    return f"topic '{name}' is not in the bag: it has {listed}"


def open_bag(path: str | Path) -> Bag:
    """Open a recording.

    Args:
        path: An MCAP file, or a rosbag2 folder with or without its ``metadata.yaml``.

    Returns:
        The recording.  Files that are cut and topics that cannot be decoded are part of it, not
        errors.

    Raises:
        BagError: There is no recording, or it is not MCAP.
    """
    path = Path(path)
    if not path.exists():
        raise BagError(f"bag '{path}' does not exist{near_name(path)}")
    paths, warnings, expected = _folder_files(path) if path.is_dir() else ([path], [], None)
    findings = Findings()
    for text in warnings:
        findings(text)
    bag = Bag(path, [scan_file(file, findings) for file in paths], findings)
    if expected is not None and expected != bag.message_count:
        findings(
            f"'{path / FILE_NAME}' counts {expected} messages, the files hold {bag.message_count}"
        )
    return bag


def _folder_files(folder: Path) -> tuple[list[Path], list[str], int | None]:
    """Find the files of a folder, what is odd about them, and the messages they should hold."""
    try:
        list(folder.iterdir())
    except OSError as error:
        raise BagError(f"bag folder '{folder}' cannot be read: {error.strerror}") from None
    metadata = read_metadata(folder)
    there = sorted(folder.glob('*.mcap'), key=lambda file: natural(file.name))
    if not there:
        raise BagError(_nothing_there(folder))
    if isinstance(metadata, str):
        return there, [f'{metadata}: its .mcap files were read in the order of their names'], None
    listed = dict.fromkeys(folder / name for name in metadata.files)
    existing = set(there)
    missing = [file for file in listed if file not in existing]
    warnings = [
        f"file '{file.name}' is listed in {FILE_NAME} but missing"
        for file in missing[:_MOST_NAMED]
    ]
    if len(missing) > _MOST_NAMED:
        warnings.append(f'{len(missing) - _MOST_NAMED} more files that it lists are missing')
    warnings += [
        f"file '{file.name}' is not listed in {FILE_NAME} and was not read"
        for file in there
        if file not in listed
    ]
    found = [file for file in listed if file in existing]
    if not found:
        raise BagError(f"bag '{folder}' has none of the files its {FILE_NAME} lists")
    return found, warnings, metadata.message_count


def _nothing_there(folder: Path) -> str:
    if any(folder.glob('*.db3')):
        return (
            f"bag '{folder}' is an SQLite recording (.db3), not MCAP: convert it with"
            " 'ros2 bag convert' first"
        )
    return f"bag '{folder}' has no .mcap file"


def natural(name: str) -> list[tuple[int, str]]:
    """Sort key that puts file 10 after file 9."""
    parts = re.split(r'(\d+)', name)
    return [(int(part), '') if part.isdecimal() else (-1, part) for part in parts]
