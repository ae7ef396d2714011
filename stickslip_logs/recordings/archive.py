# SPDX-License-Identifier: Apache-2.0
"""Finds the recordings and logs of an archive, and names the files that are not checked.

A file is what its content says; only the name of an MCAP, SQLite, CSV or Parquet file says it alone.
"""

from __future__ import annotations

import functools
import os
import re
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from stickslip_logs.errors import BagError, plural
from stickslip_logs.recordings.mcap_chunks import MAGIC
from stickslip_logs.recordings.mcap_file import scan_file
from stickslip_logs.recordings.reader import (
    as_it_is_kept,
    begin_of,
    follow_on,
    is_log,
    is_recording,
    is_sqlite,
    is_text,
    natural,
    stem_of,
)
from stickslip_logs.recordings.recording import METADATA_NAME, MOST_NAMED, Findings
from stickslip_logs.recordings.sqlite_recording import MAGIC as SQLITE
from stickslip_logs.tables.table import is_number_table
from stickslip_logs.tables.text_file import PACKED, ZSTD, unpacked_begin

_RECORDING, _LOG, _OTHER, _EXCLUDED = 'recording', 'log', 'other', 'excluded'
# Documents and pictures, by their first bytes: no data for a check.
_DOCUMENTS = (
    *(b'%PDF', b'%!PS', b'{\\rtf', b'<!', b'<?xml', b'<html', b'<svg', b'#!', b'\x7fELF'),
    *(b'\x89PNG', b'\xff\xd8\xff', b'GIF8', b'II*\0', b'MM\0*', b'RIFF'),
)
_TIMES = re.compile(rb'\d+(?:[-/.:]\d+){2,}\S*')
_NUMBERS = re.compile(rb'(?<![\w.])[-+]?\d+(?:[.,]\d+)?(?!\w)')
# The schema of a bag stands in the first page of its database.
_BAG_SCHEMA = b'topic_id'


def find_bags(paths: Iterable[str | Path]) -> list[Path]:
    """Find the recordings that are meant by some paths.

    Args:
        paths: Files, rosbag2 folders, and folders that hold such at any depth. Files of a folder
            without ``metadata.yaml`` are recordings of their own, unless all are numbered as
            rosbag2 numbers the files of one, and follow on in time. Logs are meant where a folder
            has nothing else.

    Returns:
        Each recording once, in the order of the paths, those of a folder by name (10 after 9). A
        path under which there is none, and a folder that cannot be read, stay as they are:
        opening them says why.
    """
    bags: dict[Path, Path] = {}
    for path in map(as_it_is_kept, map(Path, paths)):
        for bag in _find_within(path) or [path]:
            bags.setdefault(Path(os.path.realpath(bag)), bag)
    return list(bags.values())


def left_out(paths: Iterable[str | Path], found: Iterable[str | Path]) -> str:
    """Return a sentence on the files under some paths that are data and not among what is found.

    Args:
        paths: Files and folders that are to be checked.
        found: What is checked, and what is read for another purpose.

    Returns:
        The sentence; empty where everything else is excluded by a rule: hidden and empty files,
        documents, pictures, programs, and texts without lines of numbers.
    """
    checked = {os.path.realpath(path) for path in found}
    unread = {
        folder / name
        for path in map(Path, paths)
        for folder, names in _walk_folders(path, [])
        for name in names
        if _kind_of(folder / name) in (_LOG, _OTHER)
    }
    listed = sorted(str(file) for file in unread if os.path.realpath(file) not in checked)
    if not listed:
        return ''
    named = ', '.join(f"'{file}'" for file in listed[:MOST_NAMED]) + ', ...' * (len(listed) > MOST_NAMED)
    return f'{plural(len(listed), "file")} not checked (name one to check it, or to see why not): {named}'


def _find_within(path: Path) -> list[Path]:
    """Return the recordings below a folder, or else its logs; a file as it is."""
    # Path.is_dir raises where a link leads through a folder that is closed.
    if not os.path.isdir(path):  # noqa: PTH112
        return [path]
    closed, recordings, logs = list[Path](), list[Path](), list[Path]()
    for folder, names in _walk_folders(path, closed):
        kinds = {name: _kind_of(folder / name) for name in names}
        loose = [name for name, kind in kinds.items() if kind == _RECORDING]
        recordings += _group_parts(folder, loose, has_metadata=METADATA_NAME in names)
        logs += [folder / name for name, kind in kinds.items() if kind == _LOG]
    return sorted([*recordings, *closed] or logs, key=lambda bag: [natural(part) for part in bag.parts])


def _walk_folders(folder: Path, closed: list[Path]) -> Iterator[tuple[Path, list[str]]]:
    """Yield each folder below one with the names of its files; note the folders that cannot be read."""
    for where, folders, files in os.walk(folder, onerror=lambda error: closed.append(Path(error.filename))):
        # Drafts of recordings that are being written begin with a dot.
        folders[:] = [name for name in folders if not name.startswith('.')]
        subfolder = Path(where)
        # As Path.is_dir does, Path.is_file raises behind a closed folder. A link that leads nowhere
        # stays: whoever reads it says so.
        names = [name for name in files if not name.startswith('.') and _is_file_or_link(subfolder / name)]
        yield subfolder, names


def _is_file_or_link(path: Path) -> bool:
    return os.path.isfile(path) or os.path.islink(path)  # noqa: PTH113, PTH114


def _kind_of(path: Path) -> str:
    """Return whether a file is a recording, a log, excluded from a check, or something else."""
    if is_recording(path.name):
        return _RECORDING
    if is_log(path.name):
        return _LOG
    if path.name == METADATA_NAME:
        return _EXCLUDED
    try:
        status = path.stat()
    except OSError:
        return _OTHER
    return _kind_by_content(path, status.st_size, status.st_mtime_ns) if status.st_size else _EXCLUDED


@functools.lru_cache(
    maxsize=1 << 16
)  # what is checked and what is left out are asked for one after the other
def _kind_by_content(path: Path, size: int, changed_ns: int) -> str:
    del size, changed_ns  # they tell a file from one that had its name before
    try:
        begin = begin_of(path)
    except BagError:
        return _OTHER
    if begin.startswith(PACKED):
        inner = unpacked_begin(path)
        if inner.startswith((MAGIC, SQLITE)):
            return _RECORDING if begin.startswith(ZSTD) else _OTHER
        begin = inner
    if begin.startswith(MAGIC):
        return _RECORDING
    if begin.startswith(SQLITE):
        return _RECORDING if _BAG_SCHEMA in begin else _OTHER
    if begin.lstrip().startswith(_DOCUMENTS):
        return _EXCLUDED
    if begin.startswith(b'PAR1'):
        return _LOG
    if not is_text(begin):
        return _OTHER
    if is_number_table(path):
        return _LOG
    return _OTHER if _holds_numbers(begin) else _EXCLUDED


def _holds_numbers(begin: bytes) -> bool:
    """Return whether most lines of a text have two numbers beside their times, or are JSON."""
    lines = [line.strip() for line in begin.replace(b'\0', b'').split(b'\n')]
    lines = [_TIMES.sub(b'', line) for line in lines if line]
    return 2 * sum(line.startswith(b'{') or len(_NUMBERS.findall(line)) > 1 for line in lines) > len(lines)


def _group_parts(folder: Path, names: Sequence[str], *, has_metadata: bool) -> list[Path]:
    """Return the folder, if its files are parts of one recording, or else each of its files."""
    if has_metadata:
        return [folder]
    stems = {stem_of(name) for name in names}
    if len(stems) == 1 and stems != {''} and (len(names) == 1 or _are_parts(folder, names)):
        return [folder]
    return [folder / name for name in names]


def _are_parts(folder: Path, names: Sequence[str]) -> bool:
    """Return whether numbered files follow on in time, as far as that can be known."""
    try:
        files = [folder / name for name in sorted(names, key=natural)]
        if any(is_sqlite(file.name) or begin_of(file).startswith(ZSTD) for file in files):
            return True
        return follow_on([scan_file(file, Findings()) for file in files])
    except BagError:
        return True
