# SPDX-License-Identifier: Apache-2.0
"""Detects the kind of a file by its content, or by its name alone."""

from __future__ import annotations

import errno
import re
import unicodedata
from pathlib import Path
from typing import NamedTuple

from stickslip_logs.errors import BagError, cause
from stickslip_logs.files import open_file
from stickslip_logs.recordings.mcap_chunks import MAGIC
from stickslip_logs.recordings.sqlite_file import MAGIC as SQLITE_MAGIC
from stickslip_logs.tables.text_file import BEGIN_BYTES, PACKED, ZSTD, unpacked_begin

MCAP, SQLITE, TABLE, UNKNOWN = 'mcap', 'sqlite', 'table', 'unknown'
"""Kinds of content; a table is text with cells or Parquet."""
# Formats that are not read, by their first bytes, with the remedy.
_FOREIGN: tuple[tuple[bytes | tuple[bytes, ...], str], ...] = (
    (b'PK\x03\x04', 'a spreadsheet or ZIP archive: save the sheet as CSV, or unpack it'),
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
)
# What begins and is in the first bytes of the logs of a gateway, with the remedy.
_FRAMED: tuple[tuple[bytes, bytes, str], ...] = (
    (
        b'\x10\x02',
        b'\x10\x03',
        'convert it with canboat: actisense-serial -r {0} | analyzer -json > NEW.json',
    ),
    (b'\x1b\x01', b'\x1b\n', "write it as text with Actisense's EBL Reader"),
)
_SQL_DUMP = re.compile(
    rb'^(?:-- (PostgreSQL|MySQL|MariaDB) (?:database )?dump|PRAGMA foreign_keys=OFF;)', re.M
)
_LOADERS = {
    b'PostgreSQL': ('psql NEW -f {0}', "psql NEW --csv -c 'SELECT * FROM TABLE' > NEW.csv"),
    b'': ('sqlite3 NEW.db < {0}', "sqlite3 -header -csv NEW.db 'SELECT * FROM TABLE' > NEW.csv"),
}
_OTHER_LOADER = 'mysql NEW < {0}', "mysql --batch NEW -e 'SELECT * FROM TABLE' > NEW.tsv"
# Measurement and tags, fields, and a time of 10 digits [s] to 19 [ns].
_INFLUX_LINE = re.compile(rb'([^\s,=#]+)(?:,[^\s,=]+=[^\s,]+)* [^\s,=]+=(?:"[^"]*"|[^\s,"]+)\S* \d{10,19}\s*')
# STX and ETX frame the lines of some instruments, and SUB ends texts of DOS.
_CONTROLS = re.compile(rb'[\x01\x04-\x08\x0e-\x19\x1b-\x1f\x7f]')
_CELL_MARKS = b',', b';', b'\t', b'|', b' '
_RECORDING = re.compile(r'.*\.(?:mcap|mcap\.active|db3)(?:\.zstd?)?', re.IGNORECASE | re.DOTALL)
_SQLITE = re.compile(r'.*\.db3(?:\.zstd?)?', re.IGNORECASE | re.DOTALL)
_TABLE = re.compile(r'.*\.(?:csv|tsv|parquet)(?:\.gz)?', re.IGNORECASE | re.DOTALL)
# As rosbag2 numbers the files of a recording.
NUMBERED_PART = re.compile(
    r'(?P<stem>.+)_(?P<number>\d+)\.(?:mcap|db3)(?:\.zstd?)?', re.IGNORECASE | re.DOTALL
)


class Content(NamedTuple):
    """Kind of a file, and its first bytes, unpacked where it is packed."""

    kind: str
    begin: bytes


def read_content(path: Path) -> Content:
    """Return the kind of a file by its first bytes, and these, unpacked where it is packed.

    The kind is :data:`UNKNOWN` for content that is neither a recording nor text with cells, and for an empty
    file. A packed file of which nothing can be unpacked is a :data:`TABLE`, whose reader reports the damage;
    one of zstd is :data:`UNKNOWN`.

    Raises:
        BagError: It cannot be read, or its kind or packing is not supported; the text has the remedy.
    """
    begin = read_begin(path)
    is_packed = begin.startswith(PACKED)
    inner = unpacked_begin(path) if is_packed else begin
    if inner.startswith((MAGIC, SQLITE_MAGIC)):
        if is_packed and not begin.startswith(ZSTD):
            raise BagError(f"'{path}' is a packed recording: unpack it first")
        return Content(MCAP if inner.startswith(MAGIC) else SQLITE, inner)
    if remedy := _remedy_for_text(inner):
        raise BagError(f"'{path}' is {remedy.format(path)}")
    is_damaged = is_packed and not inner and not begin.startswith(ZSTD)
    # The reader of a damaged table reports what is wrong with its packing.
    is_table = is_damaged or inner.startswith((b'PAR1', b'\xff\xfe', b'\xfe\xff')) or _is_text(inner)
    return Content(TABLE if is_table else UNKNOWN, inner)


def read_begin(path: Path) -> bytes:
    """Return up to 4096 first bytes of a file, without unpacking it.

    Raises:
        BagError: It cannot be read, or is of a known kind that is not supported; the text has the remedy.
    """
    try:
        with open_file(path) as file:
            begin: bytes | None = file.read(BEGIN_BYTES)
        if begin is None:
            raise OSError(errno.EAGAIN, 'it has nothing to read yet')
    except OSError as error:
        raise BagError(f"bag file '{path}' cannot be read: {cause(error)}") from None
    if begin[257:262] == b'ustar':
        raise BagError(f"'{path}' is a tar archive: unpack it")
    for magic, kind in _FOREIGN:
        if begin.startswith(magic):
            raise BagError(f"'{path}' is {kind.format(path)}")
    for first, within, remedy in _FRAMED:
        if begin.startswith(first) and within in begin:
            raise BagError(f"'{path}' has frames of NMEA 2000 of an Actisense gateway: {remedy.format(path)}")
    return begin


def _remedy_for_text(begin: bytes) -> str:
    """Return the format of an SQL dump or lines of InfluxDB, with its remedy; empty for any other text.

    The result is the end of a sentence, with ``{0}`` or ``{}`` in place of the path.
    """
    # A dump names its program behind a comment or two.
    if dump := _SQL_DUMP.search(begin[:300]):
        program = dump[1] or b''
        load, write = _LOADERS.get(program, _OTHER_LOADER)
        return (
            f'a dump of {program.decode() or "SQLite"}: load it ({load}), and write a table of it ({write})'
        )
    lines = [line for line in begin.splitlines()[:-1] if line.strip() and not line.startswith(b'#')]
    matches = [_INFLUX_LINE.fullmatch(line) for line in lines]
    if matches and (first := matches[0]) and all(matches):
        name = first[1].decode(errors='replace').replace('{', '{{').replace('}', '}}')
        query = f'SELECT * FROM "{name}"'
        return (
            f"lines of InfluxDB: write them as CSV: influx -database NAME -execute '{query}' -precision"
            ' rfc3339 -format csv > NEW.csv'
        )
    return ''


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


def has_sqlite_name(name: str) -> bool:
    """Return whether a name is that of a recording in SQLite, as 'a.db3' or 'a.db3.zstd', hidden or not."""
    return bool(_SQLITE.fullmatch(name))


def has_table_name(name: str) -> bool:
    """Return whether a file has the name of a CSV, TSV or Parquet file; False for a hidden one."""
    return not name.startswith('.') and bool(_TABLE.fullmatch(name))


def recording_name_of(name: str) -> str:
    """Return the recording, in NFC, of which a file is a part, 'a' for 'a_3.mcap'; empty for another name."""
    part = NUMBERED_PART.fullmatch(name)
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
