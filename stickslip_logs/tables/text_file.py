# SPDX-License-Identifier: Apache-2.0
"""Reads a file of text, packed or not: its head and tail, and its lines."""

from __future__ import annotations

import bz2
import contextlib
import gzip
import io
import lzma
import zlib
from codecs import BOM_UTF8
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import IO, Any

import zstandard

from stickslip_logs.errors import BagError
from stickslip_logs.files import open_file
from stickslip_logs.units import KIB, MIB

# The head and the tail by which a file is judged [bytes].
_HEAD, _TAIL = 256 * KIB, 16 * KIB
# What is read at a time [bytes], and the longest piece of a line, so that one without an end takes no memory.
_PIECE = MIB
BEGIN_BYTES = 4 * KIB
"""First bytes by which a format is known: a page of a database."""
GZIP, ZSTD = b'\x1f\x8b', b'\x28\xb5\x2f\xfd'
_UNPACK: dict[bytes, Callable[[Any], Any]] = {
    GZIP: gzip.open,
    ZSTD: lambda file: io.BufferedReader(_ZstdFile(file)),
    b'BZh': bz2.open,
    b'\xfd7zXZ\0': lzma.open,
}
PACKED = tuple(_UNPACK)
"""First bytes of packed files."""
# Marks at the ends of lines that are no part of them: what frames a telegram or ends a text of DOS, and a
# byte order mark, which joined files have in the middle. Elsewhere a control character is a damaged cell.
_FRAMES = '\x02\x03\x04\x1a\ufeff'
_FRAME_BYTES = [mark.encode() for mark in '\0' + _FRAMES]
_DATAGRAM = b'UdPbC\0'
"""Before each datagram of IEC 61162-450: its zero byte is no damage."""
BROKEN = (EOFError, OSError, zlib.error, lzma.LZMAError, zstandard.ZstdError)
"""Errors of a file that cannot be read or unpacked."""


class _ZstdFile(io.RawIOBase):
    """Unpacks the frames of a file; unlike the reader of ``zstandard`` it notices that the last is truncated.

    Raises:
        EOFError: The file ends inside a frame.
    """

    def __init__(self, file: IO[bytes]) -> None:
        self._file = file
        self._frame: Any = None
        self._packed, self._unpacked = b'', memoryview(b'')

    def readable(self) -> bool:
        """Return True: it is only read."""
        return True

    def close(self) -> None:
        """Close the packed file too."""
        self._file.close()
        super().close()

    def readinto(self, buffer: Any) -> int:
        """Fill a buffer, perhaps not all of it; return the number of bytes, 0 at the end of the file.

        Raises:
            EOFError: The file ends inside a frame.
            zstandard.ZstdError: It is damaged.
        """
        while not self._unpacked:
            # 512 bytes hold 128 blocks at most, of 128 KiB each unpacked.
            self._packed = self._packed or self._file.read(512)
            if not self._packed:
                if self._frame is not None:
                    raise EOFError('the packed file ends in the middle')
                return 0
            self._frame = self._frame or zstandard.ZstdDecompressor().decompressobj()
            self._unpacked, self._packed = memoryview(self._frame.decompress(self._packed)), b''
            if self._frame.eof:
                self._packed, self._frame = self._frame.unused_data, None
        count = min(len(buffer), len(self._unpacked))
        buffer[:count], self._unpacked = self._unpacked[:count], self._unpacked[count:]
        return count


@dataclass(frozen=True, slots=True)
class Extent:
    """Result of a first pass over the bytes of a file.

    ``problem`` is why it could not be read to its end, ``is_ended`` whether its last line is
    whole, ``is_plain`` whether it has no zero bytes and no marks around lines. ``size`` is its unpacked
    length [bytes], ``zeros`` counts its zero bytes but for those of datagrams. ``lines`` counts a last line
    that is not whole, and so is 1 for an empty file.
    """

    head: bytes
    tail: bytes
    lines: int
    size: int
    zeros: int
    is_plain: bool
    is_ended: bool
    problem: str


def open_unpacked(path: Path) -> Any:
    """Open a file for reading its bytes, unpacked where its first bytes are those of gzip, zstd, bzip2 or xz.

    Reading it raises one of :data:`BROKEN` where the packed data are damaged.

    Raises:
        OSError: It cannot be opened, or is no regular file.
    """
    file = open_file(path)
    begin = file.read(max(map(len, PACKED)))
    file.seek(0)
    return next((opener(file) for magic, opener in _UNPACK.items() if begin.startswith(magic)), file)


def unpacked_begin(path: Path) -> bytes:
    """Return the first 4096 unpacked bytes of a file; fewer where it ends or is damaged.

    Empty for a file that cannot be opened or read.
    """
    begin = b''
    with contextlib.suppress(*BROKEN), open_unpacked(path) as file:
        while len(begin) < BEGIN_BYTES and (piece := file.read1(BEGIN_BYTES - len(begin))):
            begin += piece
    return begin


def scan_extent(path: Path, *, is_whole: bool = True) -> Extent:
    """Read a file, unpacked, once for its head, its tail and its number of lines.

    The tail is empty where the head holds all. Damage after the first bytes is put into ``problem``; an empty
    file is no error. If not the whole file is to be read, reading stops behind the head, and the tail and the
    counts are those of what was read.

    Raises:
        BagError: Nothing of it can be read.
    """
    head, tail, lines, size, zeros, problem, last, is_plain = b'', b'', 0, 0, 0, '', b'', True
    try:
        with open_unpacked(path) as file:
            # One read of the file below at a time: what comes before its end is kept.
            while piece := file.read1(_PIECE):
                head += piece[: _HEAD - len(head)]
                tail = (tail + piece)[-_TAIL:] if size + len(piece) > _HEAD else b''
                lines += piece.count(b'\n')
                zeros += piece.count(b'\0') - (last + piece).count(_DATAGRAM)
                content = piece if size else piece[len(BOM_UTF8) :]
                is_plain = is_plain and not any(mark in content for mark in _FRAME_BYTES)
                size += len(piece)
                last = piece[1 - len(_DATAGRAM) :]
                if not is_whole and size > _HEAD:
                    break
    except BROKEN as error:
        problem = str(error) or type(error).__name__
        if not size:
            raise BagError(f"log '{path}' cannot be read: {problem}") from None
    is_ended = b'\n' in last[-2:]
    return Extent(head, tail, lines + (not is_ended), size, zeros, is_plain, is_ended, problem)


def read_text_lines(path: Path, encoding: str, *, is_plain: bool = False) -> Iterator[str]:
    """Yield the lines of a file, unpacked, with their line ends; stop without an error where it is damaged.

    A line of more than 1 MiB is yielded in pieces. Bytes that are no text become U+FFFD. Zero bytes and marks
    around lines are removed, but from a file that has none (``is_plain``).

    Raises:
        OSError: The file cannot be opened.
    """
    with open_unpacked(path) as raw:
        text = io.TextIOWrapper(raw, encoding, errors='replace', newline='')
        with contextlib.suppress(*BROKEN):
            lines = iter(partial(text.readline, _PIECE), '')
            yield from lines if is_plain else map(_without_marks, lines)


def lines_of(text: str) -> list[str]:
    """Return the lines of a text with their line ends, without zero bytes and marks around the lines.

    Unlike with ``splitlines``, a form feed ends no line.
    """
    return list(map(_without_marks, io.StringIO(text.replace('\0', ''), newline='').readlines()))


def _without_marks(line: str) -> str:
    """Return a line without zero bytes and the marks around it."""
    body = line.rstrip('\r\n')
    return body.replace('\0', '').strip(_FRAMES) + line[len(body) :]
