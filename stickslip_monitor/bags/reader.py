# SPDX-License-Identifier: Apache-2.0
"""Reads a recording: one MCAP file, or a rosbag2 folder of them.

Finds the recordings of an archive, finds whether one has changed, and takes one that is piped.
"""

from __future__ import annotations

import contextlib
import difflib
import os
import re
import tempfile
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path, PurePosixPath
from typing import IO, Any

import yaml

from stickslip_monitor.bags.blocks import MAGIC
from stickslip_monitor.bags.cdr import short_name
from stickslip_monitor.bags.contents import CONVERT, DATED, Contents, scan_file
from stickslip_monitor.bags.series import Progress, Reading, Wanted, merged_messages
from stickslip_monitor.bags.values import (
    METADATA_NAME,
    METADATA_ROOT,
    Cut,
    Fault,
    Findings,
    Message,
    Request,
    Series,
    TimeSpans,
    TopicInfo,
)
from stickslip_monitor.errors import BagError
from stickslip_monitor.fields import FieldPath, parse_field
from stickslip_monitor.files import near_name, read_file

__all__ = ['Bag', 'Cut', 'Fault', 'Message', 'Request', 'Series', 'TopicInfo', 'open_bag']

_MOST_NAMED = 10
# Of metadata: ten thousand topics or files [bytes].
_LARGEST = 8 << 20
_DEEPEST = 30
_LOADER = getattr(yaml, 'CSafeLoader', yaml.SafeLoader)
_NOT_METADATA = (
    yaml.YAMLError, LookupError, TypeError, ValueError, AttributeError, OverflowError,
    RecursionError,
)  # fmt: skip


class Bag:
    """A recording that was opened; nothing stays open between calls."""

    def __init__(self, path: Path, files: Sequence[Contents], findings: Findings) -> None:
        self.path = path
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
            progress: Given the bytes done and the bytes to do after each block.

        Returns:
            A series for each request; the messages of a damaged chunk are missing, and
            ``warnings`` names it.

        Raises:
            BagError: A topic is not there or cannot be decoded, a field is not in its type or no
                number, or a file cannot be read.
            ConfigurationError: A field is not a path.
        """
        return self.reading(requests, progress).joined()

    def reading(self, requests: Iterable[Request], progress: Progress | None = None) -> Reading:
        """The same in blocks, one stretch of time after the other, in bounded memory."""
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
        return Reading(self._contents, wanted, self._least_ns, progress)

    def _check(self, names: Iterable[str]) -> None:
        """Raise BagError for a topic that is not in the recording."""
        for name in names:
            if name not in self.topics:
                raise BagError(missing_topic(self.topics, name))

    def messages(
        self, topics: Collection[str] | None = None, spans: TimeSpans | None = None
    ) -> Iterator[Message]:
        """Yield messages by log time, then by place in the recording.

        Args:
            topics: Which topics; all when None.
            spans: The log times that are wanted; all when None.

        Raises:
            BagError: A topic is not there, or a file cannot be read.
        """
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


def missing_topic(topics: Collection[str], name: str) -> str:
    """The sentence on a missing topic: those that are there, the nearest first."""
    close = difflib.get_close_matches(name, topics, _MOST_NAMED, cutoff=0.5)
    ranked = [*close, *(topic for topic in topics if topic not in close)]
    more = len(ranked) - _MOST_NAMED
    rest = f' and {more} more' if more > 0 else ''
    listed = f'{", ".join(ranked[:_MOST_NAMED])}{rest}' if ranked else 'no topics'
    return f"the recording has no topic '{name}': it has {listed}"


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
    findings = Findings()
    paths, expected = _folder_files(path, findings) if path.is_dir() else ([path], None)
    bag = Bag(path, [scan_file(file, findings) for file in paths], findings)
    if expected is not None and expected != bag.message_count:
        findings(
            f"'{path / METADATA_NAME}' counts {expected} messages, the files hold"
            f' {bag.message_count}'
        )
    return bag


def _folder_files(folder: Path, warn: Callable[[str], None]) -> tuple[list[Path], int | None]:
    """Find the files of a folder, and the messages they should hold; report what is odd."""
    try:
        names = [path.name for path in folder.iterdir()]
    except OSError as error:
        raise BagError(f"bag folder '{folder}' cannot be read: {error.strerror}") from None
    metadata = read_metadata(folder)
    there = [folder / name for name in sorted(names, key=natural) if name.endswith('.mcap')]
    if not there and any(name.endswith('.db3') for name in names):
        raise BagError(f"bag '{folder}' is an SQLite recording (.db3), not MCAP: {CONVERT}")
    if not there:
        raise BagError(f"bag '{folder}' has no .mcap file")
    if isinstance(metadata, str):
        _refuse_several(folder, names)
        warn(f'{metadata}: its .mcap files were read in the order of their names')
        return there, None
    listed, count = metadata
    missing = [file for file in listed if file not in there]
    for file in missing[:_MOST_NAMED]:
        warn(f"file '{file.name}' is listed in {METADATA_NAME} but missing")
    if len(missing) > _MOST_NAMED:
        warn(f'{len(missing) - _MOST_NAMED} more files that it lists are missing')
    for file in there:
        if file not in listed:
            warn(f"file '{file.name}' is not listed in {METADATA_NAME} and was not read")
    found = [file for file in listed if file in there]
    if not found:
        raise BagError(f"bag '{folder}' has none of the files its {METADATA_NAME} lists")
    return found, count


def _refuse_several(folder: Path, names: Iterable[str]) -> None:
    apart = _recordings(folder, names)
    if len(apart) > 1:
        raise BagError(f"folder '{folder}' holds {len(apart)} recordings: name one of them")


def read_metadata(folder: Path) -> tuple[dict[Path, None], int] | str:
    """Read a rosbag2 folder's metadata.

    Returns:
        The files it lists and how many messages they hold, or a sentence saying why it cannot be
        used.

    Raises:
        BagError: It describes a recording of a kind this package cannot read.
    """
    path = folder / METADATA_NAME
    try:
        information = _load(read_file(path, _LARGEST))[METADATA_ROOT]
        storage = information.get('storage_identifier', 'mcap')
        mode = str(information.get('compression_mode') or 'none').lower()
        if storage != 'mcap':
            raise BagError(f"bag '{folder}' is stored as '{storage}', not mcap: {CONVERT}")
        if mode in ('file', 'message'):
            raise BagError(
                f"bag '{folder}' has compression_mode '{mode}', but only the compression inside"
                f' MCAP can be read: {CONVERT}'
            )
        names = (PurePosixPath(name).name for name in information['relative_file_paths'])
        return dict.fromkeys(folder / name for name in names), int(information['message_count'])
    except FileNotFoundError:
        return f"folder '{folder}' has no {METADATA_NAME}"
    except OSError as error:
        return f"'{path}' cannot be read: {error.strerror}"
    except _NOT_METADATA:
        return f"'{path}' is not rosbag2 metadata"


def _load(data: bytes) -> Any:
    """YAML without aliases, which rosbag2 does not write, and without much nesting."""
    depth = 0
    for event in yaml.parse(data, _LOADER):
        depth += isinstance(event, yaml.CollectionStartEvent)
        depth -= isinstance(event, yaml.CollectionEndEvent)
        if depth > _DEEPEST or isinstance(event, yaml.AliasEvent):
            raise ValueError('no metadata has this')
    return yaml.load(data, _LOADER)


def natural(name: str) -> list[tuple[int, str]]:
    """Sort key that puts file 10 after file 9."""
    parts = re.split(r'(\d+)', name)
    return [(int(part), '') if part.isdecimal() else (-1, part) for part in parts]


Stamp = tuple[tuple[str, int, int], ...]
_PIECE = 1 << 20
# As rosbag2 numbers the files of a recording.
_PART = re.compile(r'(?P<stem>.+)_\d+\.mcap')


def find_bags(paths: Iterable[str | Path]) -> list[Path]:
    """Find the recordings that are meant by some paths.

    Args:
        paths: MCAP files, rosbag2 folders, and folders that hold such at any depth. Files of a
            folder without ``metadata.yaml`` are recordings of their own, unless all are numbered
            as rosbag2 numbers the files of one.

    Returns:
        Each recording once, in the order of the paths, those of a folder by name (10 after 9). A
        path under which there is none, and a folder that cannot be read, stay as they are:
        opening them says why.
    """
    found: dict[Path, Path] = {}
    for path in map(Path, paths):
        for bag in _within(path) or [path]:
            found.setdefault(Path(os.path.realpath(bag)), bag)
    return list(found.values())


def _within(path: Path) -> list[Path]:
    # Path.is_dir raises where a link leads through a folder that is closed.
    if not os.path.isdir(path):  # noqa: PTH112
        return [path]
    return sorted(_walk(path), key=lambda bag: [natural(part) for part in bag.parts])


def _walk(folder: Path) -> Iterator[Path]:
    closed: list[OSError] = []
    for where, folders, files in os.walk(folder, onerror=closed.append):
        # Drafts of recordings that are being written begin with a dot.
        folders[:] = [name for name in folders if not name.startswith('.')]
        yield from _recordings(Path(where), files)
    yield from (Path(error.filename) for error in closed)


def _recordings(folder: Path, names: Iterable[str]) -> list[Path]:
    """The folder, if its files are parts of one recording, or else each of its files."""
    # As Path.is_dir does, Path.is_file raises behind a closed folder.
    names = [name for name in names if os.path.isfile(folder / name)]  # noqa: PTH113
    loose = [n for n in names if n.endswith('.mcap') and not n.startswith('.')]
    parts = [_PART.fullmatch(name) for name in loose]
    stems = {part and part['stem'] for part in parts}
    if METADATA_NAME in names or (len(stems) == 1 and None not in stems):
        return [folder]
    return [folder / name for name in loose]


def stamp_of(bag: Path) -> Stamp:
    """Name, size [bytes] and time of the last change [ns] of each file of a recording.

    A recording that cannot be looked at has an empty stamp: opening it says why.
    """
    try:
        files = sorted(bag.iterdir()) if bag.is_dir() else [bag]
        states = [(file.name, file.stat()) for file in files]
    except OSError:
        return ()
    return tuple((name, state.st_size, state.st_mtime_ns) for name, state in states)


@contextlib.contextmanager
def spooled(stream: IO[bytes], show: Callable[[str, int, int | None], None]) -> Iterator[Path]:
    """A recording that is piped, as a file for as long as it is needed.

    A recording is read by its end, and as a rule twice; on the disk it takes no memory.

    Args:
        stream: Where it comes from; one that ends in the middle is a file that is cut.
        show: Given what is being done, and the bytes read so far.

    Raises:
        BagError: Nothing is piped, or the disk does not take it.
    """
    if stream.isatty():
        raise BagError("bag '-' is the terminal: pipe a recording into standard input")
    with tempfile.TemporaryDirectory(prefix='stickslip-') as folder:
        path = Path(folder) / 'standard_input.mcap'
        try:
            with path.open('wb') as file:
                is_mcap = True
                while is_mcap and (piece := stream.read(_PIECE)):
                    # What is no recording may have no end; its reader says what it is.
                    is_mcap = file.tell() > 0 or piece.startswith(MAGIC)
                    file.write(piece)
                    show('reading standard input', file.tell(), None)
        except OSError as error:
            raise BagError(f"bag '-' cannot be read: {error.strerror or error}") from None
        yield path
