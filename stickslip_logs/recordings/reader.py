# SPDX-License-Identifier: Apache-2.0
"""Opens recordings of every format, and one that is piped."""

from __future__ import annotations

import contextlib
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO, Any

from stickslip_logs.errors import BagError, cause
from stickslip_logs.files import path_hint
from stickslip_logs.recordings.bag_recording import BagRecording
from stickslip_logs.recordings.file_kind import (
    RECORDINGS,
    find_stored_path,
    has_recording_name,
    is_table,
    read_begin,
    read_content,
)
from stickslip_logs.recordings.folders import Metadata, are_consecutive, folder_files, scan_part
from stickslip_logs.recordings.mcap_chunks import limit_bytes
from stickslip_logs.recordings.recording import METADATA_NAME, Findings, Recording, Scratch
from stickslip_logs.recordings.table_recording import TableRecording
from stickslip_logs.tables.text_file import BROKEN, PACKED, open_unpacked
from stickslip_logs.units import MIB

_PIECE = MIB


def open_bag(path: str | Path) -> Recording:
    """Open a recording.

    Args:
        path: A file of MCAP or SQLite, a rosbag2 folder with or without its ``metadata.yaml``, or
            a log: CSV and its kin, Parquet, NMEA 0183, Signal K, or NMEA 2000 as canboat writes it.

    Returns:
        The recording. Truncated files and topics that cannot be decoded are part of it, not errors.
        Its ``losses`` and ``warnings`` name them.

    Raises:
        BagError: There is no recording, it cannot be read, or it is of a kind that is not supported.
    """
    path, findings = find_stored_path(Path(path)), Findings()
    try:
        if not path.exists():
            raise BagError(f"bag '{path}' does not exist{path_hint(path)}")
    except OSError as error:
        raise BagError(f"bag '{path}' cannot be read: {cause(error)}") from None
    if path.is_dir():
        folder, metadata = path, folder_files(path, findings)
    elif not has_recording_name(path.name) and is_table(read_content(path)):
        return TableRecording(path)
    else:
        folder, metadata = path.parent, Metadata((path.name,))
    scratch = Scratch()
    files = [_unpack_file(folder / name, scratch, findings) for name in metadata.names]
    contents = [scan_part(file, findings, scratch) for file in files]
    if not metadata.is_listed and not are_consecutive(contents):
        raise BagError(
            f"folder '{path}' holds {len(files)} recordings that overlap in time or lie more than"
            ' an hour apart: name one of them'
        )
    recording = BagRecording(path, contents, findings, scratch)
    if metadata.count is not None and metadata.count != recording.message_count:
        findings.lose(
            f"'{path / METADATA_NAME}' counts {metadata.count} messages, the files hold"
            f' {recording.message_count}'
        )
    return recording


def _unpack_file(path: Path, scratch: Scratch, findings: Findings) -> Path:
    """Return a file, or the unpacked copy of one that is packed as a whole; report what is cut off it.

    Raises:
        BagError: Nothing of it can be unpacked, it grows to more than its size allows, or the disk is full.
    """
    if not read_begin(path).startswith(PACKED):
        return path
    try:
        target, max_bytes = scratch.folder / path.stem, limit_bytes(path.stat().st_size)
        with open_unpacked(path) as packed, target.open('wb') as file:
            for piece in _read_pieces(packed, path, findings):
                if file.tell() + len(piece) > max_bytes:
                    raise BagError(
                        f"bag file '{path}' grows to more than {max_bytes} bytes, the limit for its size"
                    )
                file.write(piece)
            if not file.tell():
                raise BagError(f"bag file '{path}' is cut or damaged: nothing can be unpacked, copy it anew")
    except OSError as error:
        raise BagError(f"bag file '{path}' cannot be unpacked: {error}") from None
    return target


def _read_pieces(packed: Any, path: Path, findings: Findings) -> Iterator[bytes]:
    """Yield the unpacked data of a file up to its end or its first damage, which is reported as a loss."""
    try:
        # One read of the file below at a time: what comes before damage is kept.
        while piece := packed.read1(_PIECE):
            yield piece
    except BROKEN:
        findings.lose(f"file '{path.name}' is cut or damaged: what could be unpacked of it was read")


@contextlib.contextmanager
def spool_stream(stream: IO[bytes], show: Callable[[str, int, int | None], None]) -> Iterator[Path]:
    """Copy a piped recording to a temporary file, whose path is valid while the context lasts.

    A recording is read by its end, and as a rule twice; on the disk it takes no memory. Of a stream that is
    neither a recording nor a table only the beginning is copied.

    Args:
        stream: The pipe; one that ends within a recording makes a truncated file.
        show: Called after each piece with a text, the bytes read so far, and None for the unknown total.

    Raises:
        BagError: Nothing is piped, or the disk does not take it.
        OSError: The pipe cannot be read, or there is no folder for temporary files.
    """
    if stream.isatty():
        raise BagError("bag '-' is the terminal: pipe a recording into standard input")
    with tempfile.TemporaryDirectory(prefix='stickslip-') as folder:
        piece = stream.read(_PIECE)
        path, is_known = Path(folder) / 'standard_input', False
        try:
            with path.open('wb') as file:
                while piece:
                    file.write(piece)
                    show('reading standard input', file.tell(), None)
                    file.flush()
                    # What is no recording may have no end; its reader says what it is.
                    with contextlib.suppress(BagError):
                        begin = b'' if is_known else read_content(path)
                        is_known = is_known or begin.startswith(RECORDINGS) or is_table(begin)
                    piece = stream.read(_PIECE) if is_known else b''
        except OSError as error:
            raise BagError(f"bag '-' cannot be read: {cause(error)}") from None
        yield path
