# SPDX-License-Identifier: Apache-2.0
"""Opens recordings of every format, and one that is piped."""

from __future__ import annotations

import contextlib
import errno
import itertools
import re
import tempfile
import unicodedata
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath
from typing import IO, Any

import yaml
import zstandard

from stickslip_logs.errors import BagError
from stickslip_logs.files import near_name, open_file, read_file
from stickslip_logs.recordings.mcap_chunks import MAGIC
from stickslip_logs.recordings.mcap_file import McapFile, scan_file
from stickslip_logs.recordings.mcap_recording import McapRecording
from stickslip_logs.recordings.recording import (
    METADATA_NAME,
    METADATA_ROOT,
    MOST_NAMED,
    Findings,
    Recording,
    Scratch,
)
from stickslip_logs.recordings.sqlite_recording import MAGIC as SQLITE
from stickslip_logs.recordings.sqlite_recording import SqliteRecording
from stickslip_logs.recordings.table_recording import TableRecording
from stickslip_logs.tables.text_file import PACKED, ZSTD, unpacked_begin

# What is often brought and not read, by its first bytes, with the remedy.
_FOREIGN: tuple[tuple[bytes | tuple[bytes, ...], str], ...] = (
    (b'PK\x03\x04', 'a spreadsheet or ZIP archive: save the sheet as CSV'),
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
_LOOK = 4096
# STX and ETX frame the lines of some instruments, and SUB ends texts of DOS.
_CONTROLS = re.compile(rb'[\x01\x04-\x08\x0e-\x19\x1b-\x1f\x7f]')
_CELL_MARKS = b',', b';', b'\t', b'|', b' '
# Where the name of its format stands in a tar archive.
_TAR = slice(257, 262)
# What a packed file may grow to [bytes]: so much, and so much for each of its own.
_FREE, _FOR_EACH = 160 << 20, 100
_PIECE = 1 << 20
# Parts of one recording lap over by less than that, and are not further apart [ns].
_OVERLAP_NS, _APART_NS = 10**9, 3600 * 10**9


def open_bag(path: str | Path) -> Recording:
    """Open a recording.

    Args:
        path: A file of MCAP or SQLite, a rosbag2 folder with or without its ``metadata.yaml``, or
            a log: CSV and its kin, Parquet, NMEA 0183 or Signal K.

    Returns:
        The recording.  Files that are cut and topics that cannot be decoded are part of it, not
        errors.

    Raises:
        BagError: There is no recording, or it is of no kind that is read.
    """
    path = as_it_is_kept(Path(path))
    if not path.exists():
        raise BagError(f"bag '{path}' does not exist{near_name(path)}")
    findings = Findings()
    if not path.is_dir():
        begin = begin_of(path)
        if _is_table(path, begin):
            return TableRecording(path)
        if (stem := stem_of(path.name)) and _has_other_parts(path):
            findings.note(f"'{path.name}' is numbered as a part of '{stem}': read as a recording of its own")
        return _open_files(path, [path], '', findings)
    metadata = folder_files(path, findings)
    files = [path / name for name in metadata.names]
    recording = _open_files(path, files, metadata.packed, findings, metadata.is_listed)
    if metadata.count is not None and metadata.count != recording.message_count:
        findings.lose(
            f"'{path / METADATA_NAME}' counts {metadata.count} messages, the files hold"
            f' {recording.message_count}'
        )
    return recording


def _open_files(
    path: Path, files: Sequence[Path], packed: str, findings: Findings, is_one: bool = True
) -> Recording:
    """Open files of one format, which stay where they are, as a recording."""
    scratch = Scratch()
    whole = [_unpack_file(file, scratch) for file in files]
    if any(is_sqlite(file.name) or begin_of(file).startswith(SQLITE) for file in whole):
        return SqliteRecording(path, whole, packed == 'message', findings, scratch)
    contents = [scan_file(file, findings) for file in whole]
    if not is_one and not follow_on(contents):
        raise BagError(
            f"folder '{path}' holds {len(files)} recordings that lap over in time or lie more than"
            ' an hour apart: name one of them'
        )
    return McapRecording(path, contents, findings, scratch)


def begin_of(path: Path) -> bytes:
    """Read the first bytes of a file.

    Raises:
        BagError: It cannot be read, or is of a kind that is not; the text has the remedy.
    """
    try:
        with open_file(path) as file:
            begin: bytes | None = file.read(_LOOK)
        if begin is None:
            raise OSError(errno.EAGAIN, 'it has nothing to read yet')
    except OSError as error:
        raise BagError(f"bag file '{path}' cannot be read: {error.strerror or error}") from None
    if begin[_TAR] == b'ustar':
        raise BagError(f"'{path}' is a tar archive: unpack it")
    for magic, kind in _FOREIGN:
        if begin.startswith(magic):
            raise BagError(f"'{path}' is {kind.format(path)}")
    return begin


def _is_table(path: Path, begin: bytes) -> bool:
    """Return whether a file is text with cells, packed or not, or Parquet.

    Raises:
        BagError: It is a recording packed as no recorder packs it.
    """
    if is_recording(path.name):
        return False
    if begin.startswith(PACKED):
        inner = unpacked_begin(path)
        is_recorded = inner.startswith((MAGIC, SQLITE))
        if begin.startswith(ZSTD):
            return bool(inner) and not is_recorded
        if not is_recorded:
            return True
        raise BagError(f"'{path}' is a packed recording: unpack it first")
    return begin.startswith((b'PAR1', b'\xff\xfe', b'\xfe\xff')) or is_text(begin)


def is_text(begin: bytes) -> bool:
    """Return whether the first bytes of a file are lines of text with cells.

    Control characters on some of the lines, as noise of a serial line leaves them, make it no other format.
    """
    # In UTF-16 without its mark every other byte is zero.
    lines = begin.replace(b'\0', b'').split(b'\n')
    sound = [line for line in lines if not _CONTROLS.search(line)]
    is_mostly_sound = 2 * sum(map(len, sound)) > sum(map(len, lines))
    return is_mostly_sound and any(mark in line for line in sound for mark in _CELL_MARKS)


def _unpack_file(path: Path, scratch: Scratch) -> Path:
    """Return a file, or the unpacked copy of one that is packed as a whole.

    Raises:
        BagError: It cannot be unpacked, or grows to more than its size allows.
    """
    if not begin_of(path).startswith(ZSTD):
        return path
    target = scratch.folder / path.stem
    max_bytes = _FREE + _FOR_EACH * path.stat().st_size
    try:
        with open_file(path) as packed, target.open('wb') as file:
            reader = zstandard.ZstdDecompressor().stream_reader(packed)
            while piece := reader.read(_PIECE):
                if file.tell() + len(piece) > max_bytes:
                    raise BagError(
                        f"bag file '{path}' grows to more than {max_bytes} bytes, the limit for its size"
                    )
                file.write(piece)
            if not file.tell():
                raise BagError(f"bag file '{path}' is cut: nothing of it can be unpacked")
    except (OSError, zstandard.ZstdError) as error:
        raise BagError(f"bag file '{path}' cannot be unpacked: {error}") from None
    return target


def follow_on(files: Sequence[McapFile]) -> bool:
    """Return whether the spans of some files are those of parts of one recording."""
    spans = [(f.start_ns, f.end_ns) for f in files if f.start_ns is not None]
    return all(
        -_OVERLAP_NS <= (start or 0) - (end or 0) <= _APART_NS
        for (_, end), (start, _) in itertools.pairwise(spans)
    )


def _has_other_parts(path: Path) -> bool:
    """Return whether the folder of a file has others of its name, and nothing that lists them."""
    try:
        names = [part.name for part in path.parent.iterdir()]
    except OSError:
        return False
    stem = stem_of(path.name)
    return METADATA_NAME not in names and sum(stem_of(name) == stem for name in names) > 1


@contextlib.contextmanager
def spooled(stream: IO[bytes], show: Callable[[str, int, int | None], None]) -> Iterator[Path]:
    """Provide a recording that is piped as a file, for as long as it is needed.

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
        piece = stream.read(_PIECE)
        ending = '.mcap' if MAGIC.startswith(piece[: len(MAGIC)]) else ''
        is_recorded = bool(ending) or piece.startswith((SQLITE, ZSTD))
        path = Path(folder) / f'standard_input{ending}'
        try:
            with path.open('wb') as file:
                while piece:
                    file.write(piece)
                    show('reading standard input', file.tell(), None)
                    # What is no recording may have no end; its reader says what it is.
                    is_known = is_recorded or file.tell() > _PIECE or _is_known(file, path)
                    piece = stream.read(_PIECE) if is_known else b''
        except OSError as error:
            raise BagError(f"bag '-' cannot be read: {error.strerror or error}") from None
        yield path


def _is_known(file: IO[bytes], path: Path) -> bool:
    """Return whether the head of a file is that of a table."""
    file.flush()
    try:
        return isinstance(open_bag(path), TableRecording)
    except BagError:
        return False


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
_DATE = re.compile(r'\d{4}[-_]?\d\d[-_]?\d\d$')
# As rosbag2 numbers the files of a recording.
_PART = re.compile(r'(?P<stem>.+)_(?P<number>\d+)\.(?:mcap|db3)(?:\.zstd?)?', re.IGNORECASE | re.DOTALL)


def is_recording(name: str) -> bool:
    """Return whether a file's name is that of a recording; hidden ones are drafts or copies of names."""
    return not name.startswith('.') and bool(_RECORDING.fullmatch(name))


def is_sqlite(name: str) -> bool:
    """Return whether a file's name is that of a recording of SQLite."""
    return bool(_SQLITE.fullmatch(name))


def is_log(name: str) -> bool:
    """Return whether a file's name is that of a table."""
    return not name.startswith('.') and bool(_TABLE.fullmatch(name))


def stem_of(name: str) -> str:
    """Return the name of the recording that a file is numbered as a part of; empty for none."""
    part = _PART.fullmatch(name)
    return composed(part['stem']) if part else ''


def composed(name: str) -> str:
    """Return a name with composed letters: systems differ in how they keep one name."""
    return unicodedata.normalize('NFC', name)


def as_it_is_kept(path: Path) -> Path:
    """Return the path of a file or folder whose name is kept with other letters of the same look."""
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
    """The files of a folder that are one recording, in order, by its metadata as far as it has some.

    ``count`` is how many messages they should hold, None where nothing tells; ``is_listed``
    whether metadata say that they are one.
    """

    names: tuple[str, ...]
    count: int | None = None
    packed: str = ''  # 'message' where each message is
    is_listed: bool = False


def folder_files(folder: Path, findings: Findings) -> Metadata:
    """Find the files of a folder; report what is odd.

    Raises:
        BagError: There are none, or those of several recordings.
    """
    try:
        paths = sorted(p for p in folder.iterdir() if is_recording(p.name))
        present = sorted((p.name for p in paths if p.exists()), key=natural)
    except OSError as error:
        raise BagError(f"bag folder '{folder}' cannot be read: {error.strerror}") from None
    metadata = read_metadata(folder)
    for path in paths:
        if path.name not in present:
            findings.lose(f"file '{path.name}' was not read{near_name(path)}")
    if not present:
        logs = sorted((p.name for p in folder.iterdir() if is_log(p.name)), key=natural)
        remedy = f": name one of its logs, as '{folder / logs[0]}'" if logs else ''
        raise BagError(f"bag '{folder}' has no .mcap and no .db3 file{remedy}")
    if isinstance(metadata, str):
        if len(present) > 1 and len({stem_of(name) or name for name in present}) > 1:
            raise BagError(f"folder '{folder}' holds {len(present)} recordings: name one of them")
        kind = '.db3' if is_sqlite(present[0]) else '.mcap'
        findings.note(f'{metadata}: its {kind} files were read in the order of their names')
        _report_gaps(present, findings)
        return Metadata(tuple(present))
    return _listed_files(folder, metadata, present, findings)


def _report_gaps(names: Sequence[str], findings: Findings) -> None:
    """Report numbers that are lacking between those of files, but not of dates.

    The first ones may be gone: some recorders keep the newest files only. Hours lack more than they have.
    """
    parts = [part for name in names if (part := _PART.fullmatch(name))]
    numbers = {int(part['number']) for part in parts if not _DATE.search(part[0][: part.end('number')])}
    first, last = min(numbers, default=0), max(numbers, default=0)
    if last - first < 2 * len(numbers):
        lacking = sorted({*range(first, last)} - numbers)
        for number in lacking[:MOST_NAMED]:
            findings.lose(f'file {number} is missing between those of the lower and the higher numbers')


def _listed_files(folder: Path, metadata: Metadata, present: list[str], findings: Findings) -> Metadata:
    """Return the files that metadata list, and those behind them that bear the same name."""
    by_name = {composed(name): name for name in present}
    names = [by_name[name] for name in map(composed, metadata.names) if name in by_name]
    missing = [name for name in metadata.names if composed(name) not in by_name]
    for name in missing[:MOST_NAMED]:
        findings.lose(f"file '{name}' is listed in {METADATA_NAME} but missing")
    if len(missing) > MOST_NAMED:
        findings.lose(f'{len(missing) - MOST_NAMED} more files that it lists are missing')
    if not names:
        raise BagError(f"bag '{folder}' has none of the files its {METADATA_NAME} lists")
    count = metadata.count
    stems = {stem_of(name) for name in names} - {''}
    for name in present:
        if name in names:
            continue
        if stem_of(name) in stems:
            findings.note(f"file '{name}' is not listed in {METADATA_NAME}: read by its name")
            names, count = [*names, name], None
        else:
            findings.lose(f"file '{name}' is not listed in {METADATA_NAME} and was not read")
    names = names if count is not None else sorted(names, key=natural)
    return replace(metadata, names=tuple(names), count=count)


def read_metadata(folder: Path) -> Metadata | str:
    """Read a rosbag2 folder's metadata.

    Returns:
        What they say, or a sentence saying why they cannot be used.

    Raises:
        BagError: They describe a recording of a kind this package cannot read.
    """
    path = folder / METADATA_NAME
    try:
        information = _load_yaml(read_file(path, _LARGEST))[METADATA_ROOT]
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
        return Metadata(tuple(dict.fromkeys(names)), int(information['message_count']), packed, True)
    except FileNotFoundError:
        return f"folder '{folder}' has no {METADATA_NAME}"
    except OSError as error:
        return f"'{path}' cannot be read: {error.strerror}"
    except _NOT_METADATA:
        return f"'{path}' is not rosbag2 metadata"


CONVERT = "convert it with 'ros2 bag convert' first"


def _load_yaml(data: bytes) -> Any:
    """Load YAML without aliases, which rosbag2 does not write, and without deep nesting."""
    depth = 0
    for event in yaml.parse(data, _LOADER):
        depth += isinstance(event, yaml.CollectionStartEvent)
        depth -= isinstance(event, yaml.CollectionEndEvent)
        if depth > _DEEPEST or isinstance(event, yaml.AliasEvent):
            raise ValueError('no metadata has this')
    return yaml.load(data, _LOADER)
