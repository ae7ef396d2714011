# SPDX-License-Identifier: Apache-2.0
"""Detects the kind of a file by its content, or by its name alone."""

from __future__ import annotations

import re
import shlex
import unicodedata
from pathlib import Path

from stickslip_logs.errors import BagError, cause
from stickslip_logs.files import open_file
from stickslip_logs.recordings.mcap_chunks import MAGIC
from stickslip_logs.recordings.sqlite_file import MAGIC as SQLITE_MAGIC
from stickslip_logs.tables.text_file import BEGIN_BYTES, PACKED, unpacked_begin

RECORDINGS = MAGIC, SQLITE_MAGIC
"""First bytes of recordings."""
# Formats that are not read, by their first bytes, with the remedy.
_FOREIGN: tuple[tuple[bytes | tuple[bytes, ...], str], ...] = (
    (b'PK\x03\x04', 'a spreadsheet or ZIP archive: save the sheet as CSV, or unzip {0} -d NEW'),
    (
        b'#ROSBAG V',
        "a recording of ROS 1: convert it with 'rosbags-convert --src {0} --dst NEW' (pip install rosbags)",
    ),
    (b'MDF ', 'an MDF measurement (.mf4): export it as CSV'),
    (b'\x89HDF', 'an HDF5 file: export it as CSV or Parquet'),
    (b'TDSm', 'a TDMS file of LabVIEW: export it as CSV'),
    # From 7.3 it is HDF5 behind this head.
    ((b'MATLAB 5.0', b'MATLAB 7.3'), 'a MATLAB file: write it as CSV with writetable or writematrix'),
    (b'version https://git-lfs', "a pointer of Git LFS: bring the file itself with 'git lfs pull'"),
    (b'\xd0\xcf\x11\xe0', 'an old spreadsheet (.xls): save the sheet as CSV'),
    # The first message of a gateway: received, sent, or its own.
    (
        (b'\x10\x02\x93', b'\x10\x02\x94', b'\x10\x02\xa0'),
        'a log of NMEA 2000 frames of an Actisense gateway: convert it with canboat:'
        ' actisense-serial -r {0} | analyzer -json > NEW.json',
    ),
    (b'\x1b\x01', "a log of NMEA 2000 frames: write it as text with Actisense's EBL Reader"),
    (
        (b'--\n-- PostgreSQL', b'-- MySQL', b'-- MariaDB', b'/*M!999999', b'PRAGMA foreign_keys=OFF;'),
        'a dump of a database: load it into one, and write its table as CSV'
        ' (psql --csv, mysql --batch, sqlite3 -header -csv)',
    ),
)
# STX and ETX frame the lines of some instruments, and SUB ends texts of DOS.
_CONTROLS = re.compile(rb'[\x01\x04-\x08\x0e-\x19\x1b-\x1f\x7f]')
_CELL_MARKS = b',', b';', b'\t', b'|', b' '
_RECORDING = re.compile(r'.*\.(?:mcap|mcap\.active|db3)(?:\.zstd?)?', re.IGNORECASE | re.DOTALL)
_TABLE = re.compile(r'.*\.(?:csv|tsv|parquet)(?:\.gz)?', re.IGNORECASE | re.DOTALL)
# As rosbag2 numbers the files of a recording.
_NUMBERED_PART = re.compile(r'(?P<stem>.+)_\d+\.(?:mcap|db3)(?:\.zstd?)?', re.IGNORECASE | re.DOTALL)


def read_begin(path: Path) -> bytes:
    """Return up to 4096 first bytes of a file, without unpacking it.

    Raises:
        BagError: It cannot be read, or is of a known kind that is not supported; the text has the remedy.
    """
    try:
        with open_file(path) as file:
            begin = file.read(BEGIN_BYTES) or b''  # None where there is nothing to read yet
    except OSError as error:
        raise BagError(f"bag file '{path}' cannot be read: {cause(error)}") from None
    _refuse_foreign(path, begin)
    return begin


def read_content(path: Path) -> bytes:
    """Return up to 4096 first bytes of a file, unpacked; none where nothing can be unpacked.

    Raises:
        BagError: As for :func:`read_begin`, also by what is packed.
    """
    begin = read_begin(path)
    if begin.startswith(PACKED):
        begin = unpacked_begin(path)
        _refuse_foreign(path, begin)
    return begin


def _refuse_foreign(path: Path, begin: bytes) -> None:
    """Raise a BagError if the first bytes of a file are those of a kind that is not supported."""
    if begin[257:262] == b'ustar':
        raise BagError(f"'{path}' is a tar archive: unpack it")
    for magic, kind in _FOREIGN:
        if begin.startswith(magic):
            raise BagError(f"'{path}' is {kind.format(shlex.quote(str(path)))}")


def is_table(begin: bytes) -> bool:
    """Return whether first bytes, unpacked, are those of a text with cells or of Parquet."""
    if begin.startswith(RECORDINGS):
        return False
    return begin.startswith((b'PAR1', b'\xff\xfe', b'\xfe\xff')) or _is_text(begin)


def _is_text(begin: bytes) -> bool:
    """Return whether the first bytes of a file are lines of text with cells.

    Control characters on some of the lines, as noise of a serial line leaves them, make it no other format.
    """
    # In UTF-16 without its mark every other byte is zero.
    lines = begin.replace(b'\0', b'').split(b'\n')
    sound = [line for line in lines if not _CONTROLS.search(line)]
    is_mostly_sound = 2 * sum(map(len, sound)) > sum(map(len, lines))
    return is_mostly_sound and any(mark in line for line in sound for mark in _CELL_MARKS)


def has_recording_name(name: str) -> bool:
    """Return whether a name is that of a recording, as 'a.mcap' or 'a.db3.zstd'; False for a hidden one."""
    return not name.startswith('.') and bool(_RECORDING.fullmatch(name))


def has_table_name(name: str) -> bool:
    """Return whether a file has the name of a CSV, TSV or Parquet file; False for a hidden one."""
    return not name.startswith('.') and bool(_TABLE.fullmatch(name))


def recording_name_of(name: str) -> str:
    """Return the recording, in NFC, of which a file is a part, 'a' for 'a_3.mcap'; empty for another name."""
    part = _NUMBERED_PART.fullmatch(name)
    return compose_letters(part['stem']) if part else ''


def compose_letters(name: str) -> str:
    """Return a name in the normal form NFC: systems differ in how they store accents."""
    return unicodedata.normalize('NFC', name)


def find_stored_path(path: Path) -> Path:
    """Return the path under which a file or folder is stored: its name may be in another Unicode normal form.

    The path itself where no such file is stored, or the folder cannot be read.
    """
    try:
        if path.exists():
            return path
        same = [p for p in path.parent.iterdir() if compose_letters(p.name) == compose_letters(path.name)]
    except OSError:
        return path
    return same[0] if same else path


def natural_sort_key(name: str) -> list[tuple[int, str]]:
    """Return a sort key that puts file 10 after file 9."""
    parts = re.split(r'(\d+)', name)
    return [(int(part), '') if part.isdecimal() else (-1, part) for part in parts]
