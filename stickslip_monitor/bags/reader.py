# SPDX-License-Identifier: Apache-2.0
"""Reads a recording: one MCAP file, or a rosbag2 folder of them.

Finds the recordings of an archive, finds whether one has changed, and takes one that is piped.
"""

from __future__ import annotations

import contextlib
import os
import re
import tempfile
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path, PurePosixPath
from typing import IO, Any

import yaml

from stickslip_monitor.bags.blocks import MAGIC
from stickslip_monitor.bags.contents import CONVERT, scan_file
from stickslip_monitor.bags.mcap_recording import McapRecording
from stickslip_monitor.bags.recording import MOST_NAMED, Recording
from stickslip_monitor.bags.table_recording import TableRecording
from stickslip_monitor.bags.values import METADATA_NAME, METADATA_ROOT, Findings
from stickslip_monitor.errors import BagError
from stickslip_monitor.files import near_name, open_file, read_file

# Of metadata: ten thousand topics or files [bytes].
_LARGEST = 8 << 20
_DEEPEST = 30
_LOADER = getattr(yaml, 'CSafeLoader', yaml.SafeLoader)
_NOT_METADATA = (
    yaml.YAMLError, LookupError, TypeError, ValueError, AttributeError, OverflowError,
    RecursionError,
)  # fmt: skip


def open_bag(path: str | Path) -> Recording:
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
    if not path.is_dir() and _is_table(path):
        return TableRecording(path)
    findings = Findings()
    paths, expected = _folder_files(path, findings) if path.is_dir() else ([path], None)
    bag = McapRecording(path, [scan_file(file, findings) for file in paths], findings)
    if expected is not None and expected != bag.message_count:
        findings.lose(
            f"'{path / METADATA_NAME}' counts {expected} messages, the files hold"
            f' {bag.message_count}'
        )
    return bag


# What is often brought and not read, by its first bytes, with the remedy.
_FOREIGN = (
    (b'PK\x03\x04', 'a spreadsheet or ZIP archive: save the sheet as CSV'),
    (
        b'#ROSBAG V',
        "a recording of ROS 1: convert it with 'rosbags-convert --src {0} --dst NEW' (pip install"
        ' rosbags)',
    ),
    (b'MDF ', 'an MDF measurement (.mf4): export it as CSV'),
    (b'\x89HDF', 'an HDF5 file: export it as CSV or Parquet'),
    (b'TDSm', 'a TDMS file of LabVIEW: export it as CSV'),
    (b'MATLAB 5.0', 'a MATLAB file: write it as CSV with writetable or writematrix'),
    (b'\xd0\xcf\x11\xe0', 'an old spreadsheet (.xls): save the sheet as CSV'),
)
_LOOK = 4096


def _is_table(path: Path) -> bool:
    """Whether a file is text with cells, packed text, or Parquet.

    Raises:
        BagError: It is of a kind that is not read; the text has the remedy.
    """
    try:
        with open_file(path) as file:
            begin = file.read(_LOOK)
    except OSError as error:
        raise BagError(f"bag file '{path}' cannot be read: {error.strerror or error}") from None
    for magic, what in _FOREIGN:
        if begin.startswith(magic):
            raise BagError(f"'{path}' is {what.format(path)}")
    if begin.startswith((b'\x1f\x8b', b'PAR1', b'\xff\xfe', b'\xfe\xff')):
        return True
    # In UTF-16 without its mark every other byte is zero.
    text = begin.replace(b'\0', b'')
    is_text = not any(byte < 9 or 13 < byte < 32 for byte in text[:_LOOK]) and text
    return bool(is_text) and any(mark in text for mark in (b',', b';', b'\t', b'|', b' '))


def _folder_files(folder: Path, findings: Findings) -> tuple[list[Path], int | None]:
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
        findings.note(f'{metadata}: its .mcap files were read in the order of their names')
        return there, None
    listed, count = metadata
    missing = [file for file in listed if file not in there]
    for file in missing[:MOST_NAMED]:
        findings.lose(f"file '{file.name}' is listed in {METADATA_NAME} but missing")
    if len(missing) > MOST_NAMED:
        findings.lose(f'{len(missing) - MOST_NAMED} more files that it lists are missing')
    for file in there:
        if file not in listed:
            findings.lose(f"file '{file.name}' is not listed in {METADATA_NAME} and was not read")
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
