# SPDX-License-Identifier: Apache-2.0
"""The files of a recording: which names are recordings, and what a rosbag2 folder lists."""

from __future__ import annotations

import re
import unicodedata
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

import yaml

from stickslip_monitor.bags.recording import MOST_NAMED
from stickslip_monitor.bags.values import METADATA_NAME, METADATA_ROOT, Findings
from stickslip_monitor.errors import BagError
from stickslip_monitor.files import near_name, read_file

# Of metadata: ten thousand topics or files [bytes].
_LARGEST = 8 << 20
_DEEPEST = 30
_LOADER = getattr(yaml, 'CSafeLoader', yaml.SafeLoader)
_NOT_METADATA = (
    yaml.YAMLError,
    LookupError,
    TypeError,
    ValueError,
    AttributeError,
    OverflowError,
    RecursionError,
)
_RECORDING = re.compile(r'.*\.(?:mcap|mcap\.active|db3)(?:\.zstd?)?', re.IGNORECASE | re.DOTALL)
_SQLITE = re.compile(r'.*\.db3(?:\.zstd?)?', re.IGNORECASE | re.DOTALL)
_TABLE = re.compile(r'.*\.(?:csv|tsv|parquet)(?:\.gz)?', re.IGNORECASE | re.DOTALL)
# As rosbag2 numbers the files of a recording.
_PART = re.compile(r'(?P<stem>.+)_\d+\.(?:mcap|db3)(?:\.zstd?)?', re.IGNORECASE | re.DOTALL)


def is_recording(name: str) -> bool:
    """Whether a file's name is that of a recording; hidden ones are drafts or copies of names."""
    return not name.startswith('.') and bool(_RECORDING.fullmatch(name))


def is_sqlite(name: str) -> bool:
    """Whether it is that of a recording of SQLite."""
    return bool(_SQLITE.fullmatch(name))


def is_log(name: str) -> bool:
    """Whether it is that of a table."""
    return not name.startswith('.') and bool(_TABLE.fullmatch(name))


def stem_of(name: str) -> str:
    """The name of the recording that a file is numbered as a part of; empty for none."""
    part = _PART.fullmatch(name)
    return composed(part['stem']) if part else ''


def composed(name: str) -> str:
    """A name with composed letters: systems differ in how they keep one name."""
    return unicodedata.normalize('NFC', name)


def as_it_is_kept(path: Path) -> Path:
    """The path of a file or folder whose name is kept with other letters of the same look."""
    try:
        if path.exists():
            return path
        same = [p for p in path.parent.iterdir() if composed(p.name) == composed(path.name)]
    except OSError:
        return path
    return same[0] if same else path


def natural(name: str) -> list[tuple[int, str]]:
    """Sort key that puts file 10 after file 9."""
    parts = re.split(r'(\d+)', name)
    return [(int(part), '') if part.isdecimal() else (-1, part) for part in parts]


@dataclass(frozen=True, slots=True)
class Metadata:
    """What the metadata of a rosbag2 folder say of its files."""

    names: tuple[str, ...]
    count: int
    packed: str  # 'message' where each message is, else ''


@dataclass(frozen=True, slots=True)
class FolderFiles:
    """The files of a folder that are one recording.

    ``count`` is how many messages they should hold, None where nothing tells; ``is_listed``
    whether metadata say that they are one.
    """

    files: tuple[Path, ...]
    count: int | None
    packed: str
    is_listed: bool


def folder_files(folder: Path, findings: Findings) -> FolderFiles:
    """Find the files of a folder; report what is odd.

    Raises:
        BagError: There are none, or those of several recordings.
    """
    try:
        paths = sorted(p for p in folder.iterdir() if is_recording(p.name))
        there = sorted((p.name for p in paths if p.exists()), key=natural)
    except OSError as error:
        raise BagError(f"bag folder '{folder}' cannot be read: {error.strerror}") from None
    metadata = read_metadata(folder)
    for path in paths:
        if path.name not in there:
            findings.lose(f"file '{path.name}' was not read{near_name(path)}")
    if not there:
        raise BagError(f"bag '{folder}' has no .mcap and no .db3 file")
    if isinstance(metadata, str):
        if len(there) > 1 and len({stem_of(name) or name for name in there}) > 1:
            raise BagError(f"folder '{folder}' holds {len(there)} recordings: name one of them")
        kind = '.db3' if is_sqlite(there[0]) else '.mcap'
        findings.note(f'{metadata}: its {kind} files were read in the order of their names')
        return FolderFiles(tuple(folder / name for name in there), None, '', False)
    return _listed(folder, metadata, there, findings)


def _listed(folder: Path, metadata: Metadata, there: list[str], findings: Findings) -> FolderFiles:
    """The files that metadata list, and those behind them that bear the same name."""
    known = {composed(name): name for name in there}
    found = [known[name] for name in metadata.names if name in known]
    missing = [name for name in metadata.names if name not in known]
    for name in missing[:MOST_NAMED]:
        findings.lose(f"file '{name}' is listed in {METADATA_NAME} but missing")
    if len(missing) > MOST_NAMED:
        findings.lose(f'{len(missing) - MOST_NAMED} more files that it lists are missing')
    if not found:
        raise BagError(f"bag '{folder}' has none of the files its {METADATA_NAME} lists")
    count: int | None = metadata.count
    stems = {stem_of(name) for name in found} - {''}
    for name in there:
        if name in found:
            continue
        if stem_of(name) in stems:
            findings.note(f"file '{name}' is not listed in {METADATA_NAME}: read by its name")
            found, count = [*found, name], None
        else:
            findings.lose(f"file '{name}' is not listed in {METADATA_NAME} and was not read")
    found = found if count is not None else sorted(found, key=natural)
    return FolderFiles(tuple(folder / name for name in found), count, metadata.packed, True)


def read_metadata(folder: Path) -> Metadata | str:
    """Read a rosbag2 folder's metadata.

    Returns:
        What they say, or a sentence saying why they cannot be used.

    Raises:
        BagError: They describe a recording of a kind this package cannot read.
    """
    path = folder / METADATA_NAME
    try:
        information = _load(read_file(path, _LARGEST))[METADATA_ROOT]
        storage = information.get('storage_identifier', 'mcap')
        mode = str(information.get('compression_mode') or 'none').lower()
        format_ = str(information.get('compression_format') or 'zstd').lower()
        if storage not in ('mcap', 'sqlite3'):
            raise BagError(f"bag '{folder}' is stored as '{storage}': {CONVERT}")
        if mode in ('file', 'message') and (format_ != 'zstd' or (storage == 'mcap' and mode == 'message')):
            raise BagError(
                f"bag '{folder}' has compression_mode '{mode}' of '{format_}', which is not read"
                f' from {storage}: {CONVERT}'
            )
        names = (PurePosixPath(name).name for name in information['relative_file_paths'])
        packed = mode if mode == 'message' else ''
        listed = tuple(dict.fromkeys(map(composed, names)))
        return Metadata(listed, int(information['message_count']), packed)
    except FileNotFoundError:
        return f"folder '{folder}' has no {METADATA_NAME}"
    except OSError as error:
        return f"'{path}' cannot be read: {error.strerror}"
    except _NOT_METADATA:
        return f"'{path}' is not rosbag2 metadata"


CONVERT = "convert it with 'ros2 bag convert' first"


def _load(data: bytes) -> Any:
    """YAML without aliases, which rosbag2 does not write, and without much nesting."""
    depth = 0
    for event in yaml.parse(data, _LOADER):
        depth += isinstance(event, yaml.CollectionStartEvent)
        depth -= isinstance(event, yaml.CollectionEndEvent)
        if depth > _DEEPEST or isinstance(event, yaml.AliasEvent):
            raise ValueError('no metadata has this')
    return yaml.load(data, _LOADER)
