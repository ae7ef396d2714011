# SPDX-License-Identifier: Apache-2.0
"""A file of text, packed or not: its head and tail, and its lines."""

from __future__ import annotations

import bz2
import contextlib
import gzip
import io
import lzma
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import zstandard

from stickslip_logs.errors import BagError
from stickslip_logs.files import open_file

# What is looked at of a file: its head and its tail, and what is read at a time [bytes].
_HEAD, _TAIL, _PIECE = 1 << 18, 1 << 14, 1 << 20
# First bytes by which a format is known; a page of a database [bytes].
_BEGIN = 4096
# A line without an end is given in pieces of this length, so that none takes the memory.
_LONGEST_LINE = 1 << 20
GZIP, ZSTD = b'\x1f\x8b', b'\x28\xb5\x2f\xfd'
_UNPACK: dict[bytes, Callable[[Any], Any]] = {
    GZIP: gzip.open,
    ZSTD: lambda file: zstandard.ZstdDecompressor().stream_reader(file, read_across_frames=True),
    b'BZh': bz2.open,
    b'\xfd7zXZ\0': lzma.open,
}
PACKED = tuple(_UNPACK)
"""First bytes of packed files."""
_BROKEN = (EOFError, OSError, zlib.error, lzma.LZMAError, zstandard.ZstdError)


@dataclass(frozen=True, slots=True)
class Extent:
    """Result of a first pass over the bytes of a file.

    ``problem`` is why it could not be read to its end, ``is_ended`` whether its last line is
    whole.
    """

    head: bytes
    tail: bytes
    lines: int
    size: int
    zeros: int
    is_ended: bool
    problem: str


def opened(path: Path) -> IO[bytes]:
    """Open a file for its bytes, unpacked where it is packed by gzip, zstd, bzip2 or xz.

    Raises:
        OSError: It cannot be opened.
    """
    file = open_file(path)
    begin = file.read(max(map(len, PACKED)))
    file.seek(0)
    unpacked: IO[bytes] = next((own(file) for magic, own in _UNPACK.items() if begin.startswith(magic)), file)
    return unpacked


def unpacked_begin(path: Path) -> bytes:
    """Return the first bytes of a packed file; fewer where it is damaged."""
    try:
        with opened(path) as file:
            return file.read(_BEGIN)
    except _BROKEN:
        return b''


def extent_of(path: Path, *, is_whole: bool = True) -> Extent:
    """Read a file once for its head, its tail and the number of its lines; or for its head alone.

    Raises:
        BagError: Nothing of it can be read.
    """
    head, tail, lines, size, zeros, problem, last = b'', b'', 0, 0, 0, '', b''
    try:
        with opened(path) as file:
            while piece := file.read(_PIECE):
                head += piece[: _HEAD - len(head)]
                tail = (tail + piece)[-_TAIL:] if size + len(piece) > _HEAD else b''
                lines, zeros = lines + piece.count(b'\n'), zeros + piece.count(b'\0')
                size += len(piece)
                last = piece[-2:]
                if not is_whole and size > _HEAD:
                    break
    except _BROKEN as error:
        problem = str(error) or type(error).__name__
        if not size:
            raise BagError(f"log '{path}' cannot be read: {problem}") from None
    is_ended = b'\n' in last
    return Extent(head, tail, lines + (not is_ended), size, zeros, is_ended, problem)


def text_lines(path: Path, encoding: str) -> Iterator[str]:
    """Yield the lines without zero bytes, as far as they can be read; one without an end in pieces."""
    with opened(path) as raw:
        text = io.TextIOWrapper(raw, encoding, errors='replace', newline='')
        with contextlib.suppress(*_BROKEN):
            for line in iter(lambda: text.readline(_LONGEST_LINE), ''):
                yield line.replace('\0', '') if '\0' in line else line


def lines_of(text: str) -> list[str]:
    """Return the lines of a text as a file gives them: a form feed ends none."""
    return io.StringIO(text, newline='').readlines()
