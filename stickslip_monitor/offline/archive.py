# SPDX-License-Identifier: Apache-2.0
"""Finding the recordings of an archive, telling whether one has changed, and one that is piped."""

from __future__ import annotations

import contextlib
import os
import re
import tempfile
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import IO

from stickslip_monitor.bags.blocks import MAGIC
from stickslip_monitor.bags.reader import natural
from stickslip_monitor.bags.values import METADATA_NAME
from stickslip_monitor.errors import BagError

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
        show: Told what is being done, and the bytes read so far.

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
