# SPDX-License-Identifier: Apache-2.0
"""Finds recordings and logs in folders, the files of one recording, and those that are not checked.

A file is what its content says; only the name of an MCAP, SQLite, CSV or Parquet file says it alone.
"""

from __future__ import annotations

import itertools
import operator
import os
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath
from typing import Any

import yaml

from stickslip_logs.errors import BagError, cause, listed, plural
from stickslip_logs.files import path_hint, read_file
from stickslip_logs.recordings.bag_file import BagFile, scan_mcap_file
from stickslip_logs.recordings.file_kind import (
    RECORDINGS,
    compose_letters,
    find_stored_path,
    has_recording_name,
    has_table_name,
    is_table,
    natural_sort_key,
    read_begin,
    read_content,
    recording_name_of,
)
from stickslip_logs.recordings.mcap_chunks import MAGIC
from stickslip_logs.recordings.recording import METADATA_NAME, METADATA_ROOT, Findings, Scratch
from stickslip_logs.recordings.sqlite_file import MAGIC as SQLITE
from stickslip_logs.recordings.sqlite_file import SqliteFile
from stickslip_logs.tables.dialect import remedy_for_format
from stickslip_logs.tables.table_file import is_number_table
from stickslip_logs.units import MIB

# Room for ten thousand topics or files [bytes].
_MAX_METADATA_BYTES = 8 * MIB
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
_RECORDING, _LOG, _OTHER, _EXCLUDED = 'recording', 'log', 'other', 'excluded'
# Documents and pictures, by their first bytes: no data for a check.
_DOCUMENTS = (
    *(b'%PDF', b'%!PS', b'{\\rtf', b'<!', b'<?xml', b'<html', b'<svg', b'#!', b'\x7fELF'),
    *(b'\x89PNG', b'\xff\xd8\xff', b'GIF8', b'II*\0', b'MM\0*', b'RIFF'),
)
_TIMES = re.compile(rb'\d+(?:[-/.:]\d+){2,}(?:,\d{3}(?!\d))?[^\s,;|]*')
_PROSE = re.compile(rb'[^\W\d_]+\s+[^\W\d_]+')
_NUMBERS = re.compile(rb'(?<![\w.])[-+]?\d+(?:[.,]\d+)?(?!\w)')
# The schema of a bag stands in the first page of its database.
_BAG_SCHEMA = b'topic_id'


def find_bags(paths: Iterable[str | Path]) -> list[Path]:
    """Find the recordings that are meant by some paths.

    Args:
        paths: Files, rosbag2 folders, and folders that hold such at any depth; below these hidden files and
            folders are left out. Files of a folder without ``metadata.yaml`` are recordings of their own,
            unless all are numbered as rosbag2 numbers the files of one, and follow on in time. Logs are meant
            where a folder has nothing else.

    Returns:
        Each recording once, in the order of the paths, those of a folder by name (10 after 9). A path without
        any, and a folder that cannot be read, are returned unchanged: opening them raises the error.
    """
    bags: dict[Path, Path] = {}
    for path in map(find_stored_path, map(Path, paths)):
        for bag in _find_in_folder(path) or [path]:
            bags.setdefault(Path(os.path.realpath(bag)), bag)
    return list(bags.values())


def describe_unchecked(paths: Iterable[str | Path], checked: Iterable[str | Path]) -> str:
    """Return a sentence that names files of data under some paths that are not checked.

    Args:
        paths: Files and folders that are to be checked.
        checked: What is checked, and what is read for another purpose.

    Returns:
        The sentence; empty where everything else is excluded by a rule: hidden and empty files,
        documents, pictures, programs, and texts without lines of numbers.
    """
    read = {os.path.realpath(path) for path in checked}
    unread = {
        str(file)
        for path in map(Path, paths)
        for folder, names in _walk_folders(path, [])
        for file in map(folder.joinpath, names)
        if os.path.realpath(file) not in read and _kind_of(file) in (_LOG, _OTHER)
    }
    if not unread:
        return ''
    return (
        f'{plural(len(unread), "file")} not checked (name one to check it, or to see why not):'
        f' {listed(sorted(unread))}'
    )


def _find_in_folder(path: Path) -> list[Path]:
    """Return the recordings at any depth of a folder, or its logs where it has none, sorted by path.

    Subfolders that cannot be read are among them. A path that is no folder is returned alone.
    """
    if not os.path.isdir(path):  # noqa: PTH112 - Path.is_dir raises for a link through a closed folder
        return [path]
    closed, recordings, logs = list[Path](), list[Path](), list[Path]()
    for folder, names in _walk_folders(path, closed):
        kinds = {name: _kind_of(folder / name) for name in names}
        loose = [name for name, kind in kinds.items() if kind == _RECORDING]
        recordings += _group_parts(folder, loose, has_metadata=METADATA_NAME in names)
        logs += [folder / name for name, kind in kinds.items() if kind == _LOG]
    return sorted(
        [*recordings, *closed] or logs, key=lambda bag: [natural_sort_key(part) for part in bag.parts]
    )


def _walk_folders(folder: Path, closed: list[Path]) -> Iterator[tuple[Path, list[str]]]:
    """Yield a folder and each below it, with the names of its files, in the order of the system.

    Hidden folders and files are left out. Nothing is yielded for a path that is no folder. Folders that
    cannot be read are appended to ``closed``.
    """
    for where, folders, files in os.walk(folder, onerror=lambda error: closed.append(Path(error.filename))):
        # Drafts of recordings that are being written begin with a dot.
        folders[:] = [name for name in folders if not name.startswith('.')]
        yield Path(where), [name for name in files if not name.startswith('.')]


def _kind_of(path: Path) -> str:
    """Return 'recording', 'log', 'excluded' (no data) or 'other', by the name of a file or else its content.

    A file that cannot be read, or is of a kind that is not supported, is 'other'; metadata of rosbag2 and an
    empty file without such a name are 'excluded'.
    """
    if has_recording_name(path.name):
        return _RECORDING
    if has_table_name(path.name):
        return _LOG
    if path.name == METADATA_NAME:
        return _EXCLUDED
    try:
        if not path.stat().st_size:
            return _EXCLUDED
        begin = read_content(path)
    except (OSError, BagError):
        return _OTHER
    if begin.startswith(RECORDINGS):
        return _RECORDING if begin.startswith(MAGIC) or _BAG_SCHEMA in begin else _OTHER
    if begin.lstrip().startswith(_DOCUMENTS):
        return _EXCLUDED
    if not is_table(begin):
        return _OTHER
    if begin.startswith(b'PAR1') or is_number_table(path):
        return _LOG
    lines = begin.decode('latin-1').splitlines()
    return _OTHER if _holds_numbers(begin) or remedy_for_format(path, lines) else _EXCLUDED


def _holds_numbers(begin: bytes) -> bool:
    """Return whether more than half of the lines that are not blank have two numbers beside their times.

    One is enough beside a time, if there are no two words in a row.
    """
    lines = [line.strip() for line in begin.replace(b'\0', b'').split(b'\n')]
    pairs = [(line, _TIMES.sub(b'', line)) for line in lines if line]
    min_counts = [1 if rest != line and not _PROSE.search(rest) else 2 for line, rest in pairs]
    counts = [len(_NUMBERS.findall(rest)) for _, rest in pairs]
    return 2 * sum(map(operator.ge, counts, min_counts)) > len(pairs)


def _group_parts(folder: Path, names: Sequence[str], *, has_metadata: bool) -> list[Path]:
    """Return the recordings that files of a folder are: the folder where they are parts of one, else each.

    A ``metadata.yaml`` makes them parts of one. Without, parts are numbered files of one name that follow
    each other in time (read to see that); a single one is too. No names, which may be in any order, make an
    empty list then.
    """
    if has_metadata:
        return [folder]
    stems = {recording_name_of(name) for name in names}
    if len(stems) == 1 and stems != {''} and (len(names) == 1 or _are_parts(folder, names)):
        return [folder]
    return [folder / name for name in names]


def _are_parts(folder: Path, names: Sequence[str]) -> bool:
    """Return whether files that are numbered alike are consecutive in time by their numbers, by reading them.

    True also where one of them is packed or cannot be read. The names may be in any order.
    """
    try:
        files = [folder / name for name in sorted(names, key=natural_sort_key)]
        return are_consecutive([scan_part(file, Findings(), Scratch()) for file in files])
    except BagError:
        return True


def scan_part(path: Path, findings: Findings, scratch: Scratch) -> BagFile:
    """Return the contents of a file of MCAP or SQLite.

    Copies are made in ``scratch``; ``findings`` takes the warnings.

    Raises:
        BagError: It cannot be read, or is neither.
    """
    if read_begin(path).startswith(SQLITE):
        return SqliteFile(path, findings, scratch)
    return scan_mcap_file(path, findings)


def are_consecutive(files: Sequence[BagFile]) -> bool:
    """Return whether each file begins from 1 s before to 1 h behind the end of the one before it.

    Files without times are left out.
    """
    spans = [(f.start_ns, f.end_ns) for f in files if f.start_ns is not None]
    return all(
        -(10**9) <= (start or 0) - (end or 0) <= 3600 * 10**9
        for (_, end), (start, _) in itertools.pairwise(spans)
    )


@dataclass(frozen=True, slots=True)
class Metadata:
    """Names of the files of one recording in a folder, in order.

    ``count`` is the number of their messages by the metadata, None without these; ``is_listed`` is
    whether metadata list them.
    """

    names: tuple[str, ...]
    count: int | None = None
    is_listed: bool = False


def folder_files(folder: Path, findings: Findings) -> Metadata:
    """Return the files of the recording in a folder, by its metadata or else by their names (10 after 9).

    Reports files that are missing or not read, and a lack of metadata.

    Raises:
        BagError: The folder cannot be read, has no files of recordings, none that its metadata list, or
            those of several, or the metadata are of a kind that is not supported.
    """
    try:
        paths = sorted(p for p in folder.iterdir() if has_recording_name(p.name))
        present = sorted((p.name for p in paths if p.exists()), key=natural_sort_key)
    except OSError as error:
        raise BagError(f"bag folder '{folder}' cannot be read: {cause(error)}") from None
    metadata = read_metadata(folder)
    for path in paths:
        if path.name not in present:
            findings.lose(f"file '{path.name}' was not read{path_hint(path)}")
    if not present:
        logs = sorted((p.name for p in folder.iterdir() if has_table_name(p.name)), key=natural_sort_key)
        remedy = f": name one of its logs, as '{folder / logs[0]}'" if logs else ''
        raise BagError(f"bag '{folder}' has no .mcap and no .db3 file{remedy}")
    if isinstance(metadata, str):
        if len(present) > 1 and len({recording_name_of(name) or name for name in present}) > 1:
            raise BagError(f"folder '{folder}' holds {len(present)} recordings: name one of them")
        findings.note(f'{metadata}: its files were read in the order of their names')
        return Metadata(tuple(present))
    return _complete_metadata(folder, metadata, present, findings)


def _complete_metadata(folder: Path, metadata: Metadata, present: list[str], findings: Findings) -> Metadata:
    """Return the metadata with the files that are there; report listed ones that are missing, and others.

    Files that are not listed are added where they are numbered as parts of the same recording; then all are
    in the order of their names, and ``count`` is None.

    Raises:
        BagError: None of the listed files is there.
    """
    by_name = {compose_letters(name): name for name in present}
    names = [by_name[name] for name in map(compose_letters, metadata.names) if name in by_name]
    if missing := [name for name in metadata.names if compose_letters(name) not in by_name]:
        findings.lose(f'files that {METADATA_NAME} lists are missing: {listed(missing)}')
    if not names:
        raise BagError(f"bag '{folder}' has none of the files its {METADATA_NAME} lists")
    stems = {recording_name_of(name) for name in names} - {''}
    further_names = [name for name in present if name not in names]
    added = [name for name in further_names if recording_name_of(name) in stems]
    if unread := [name for name in further_names if name not in added]:
        findings.lose(f'files that {METADATA_NAME} does not list were not read: {listed(unread)}')
    if not added:
        return replace(metadata, names=tuple(names))
    findings.note(f'files that {METADATA_NAME} does not list were read by their names: {listed(added)}')
    return replace(metadata, names=tuple(sorted([*names, *added], key=natural_sort_key)), count=None)


def read_metadata(folder: Path) -> Metadata | str:
    """Read the metadata of a rosbag2 folder.

    Returns:
        The files they list, each once, by name without a folder; or the reason, a clause, why there are none
        or they cannot be used, as where they have more than 8 MiB.

    Raises:
        BagError: They describe a recording of a kind this package cannot read.
    """
    path = folder / METADATA_NAME
    try:
        information = _load_yaml(read_file(path, _MAX_METADATA_BYTES))[METADATA_ROOT]
        storage = str(information.get('storage_identifier', 'mcap'))
        mode = str(information.get('compression_mode')).lower()
        if storage not in ('mcap', 'sqlite3') or (storage, mode) == ('mcap', 'message'):
            raise BagError(
                f"bag '{folder}' is stored as '{storage}' with compression_mode '{mode}', which is not read:"
                " convert it with 'ros2 bag convert' first"
            )
        names = (PurePosixPath(name).name for name in information['relative_file_paths'])
        return Metadata(tuple(dict.fromkeys(names)), int(information['message_count']), is_listed=True)
    except FileNotFoundError:
        return f"folder '{folder}' has no {METADATA_NAME}"
    except OSError as error:
        return f"'{path}' cannot be read: {cause(error)}"
    except _NOT_METADATA:
        return f"'{path}' is not rosbag2 metadata"


def _load_yaml(data: bytes) -> Any:
    """Load YAML; the parser limits how deep it is nested.

    Raises:
        ValueError: It has aliases, which can grow without limit, and which rosbag2 does not write.
        yaml.YAMLError: It is no YAML.
    """
    if any(isinstance(event, yaml.AliasEvent) for event in yaml.parse(data, _LOADER)):
        raise ValueError('it has aliases')
    return yaml.load(data, _LOADER)
