# SPDX-License-Identifier: Apache-2.0
"""Reads files within limits, replaces only those of this package, and makes texts safe to print."""

from __future__ import annotations

import contextlib
import json
import os
import stat
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from stickslip_logs.files import DRAFT, KINDS, lock_draft, open_file, path_hint, read_file, remove_drafts
from stickslip_monitor.errors import ConfigurationError, OutputError

__all__ = [
    'PICTURES',
    'check_replaceable',
    'holds_mark',
    'is_same',
    'lock_draft',
    'open_file',
    'path_hint',
    'printable',
    'read_file',
    'read_json',
    'read_token',
    'redirect_to_null',
    'remove_drafts',
    'replace_file',
    'write_whole',
]

PICTURES: Mapping[str, bytes | None] = {
    '.png': b'Software\0stickslip_monitor',
    '.svg': b'<dc:title>stickslip_monitor</dc:title>',
}
"""By its ending, what the beginning of a picture of ours contains."""
MIN_TOKEN_LENGTH = 16
"""A shorter token of the page could be guessed."""
MAX_TOKEN_BYTES = 4096
"""A larger file holds something else: tokens have some 200 bytes."""
# Beginning of a file in which our mark is sought [bytes].
_HEAD = 4096
# Characters of a text that is printed whole; of a longer one a quarter of them at each end.
_MAX_TEXT = 4000


def read_json(path: str | Path, max_bytes: int) -> Any:
    """Read a regular file as JSON, up to a size [bytes].

    Raises:
        OSError: It cannot be read, is no regular file, or is larger.
        ValueError: It is not JSON in UTF-8, or nested too deeply.
    """
    try:
        return json.loads(read_file(path, max_bytes).decode('utf-8'))
    except RecursionError as error:
        raise ValueError('it is nested too deeply') from error


def read_token(path: str) -> str:
    """Return the token in a file that holds nothing else, without white space around it.

    Raises:
        ConfigurationError: It cannot be read, is too large or too short or not printable ASCII, or every user
            can read or write it.
    """
    try:
        mode = Path(path).stat().st_mode
        token = read_file(path, MAX_TOKEN_BYTES).decode().strip()
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, 'strerror', None) or 'it is not a text file'
        raise ConfigurationError(f"token file '{path}' cannot be read: {reason}") from error
    if mode & (stat.S_IROTH | stat.S_IWOTH):
        raise ConfigurationError(f"token file '{path}' is open to every user: chmod 600 '{path}'")
    if len(token) < MIN_TOKEN_LENGTH or not token.isascii() or not token.isprintable():
        raise ConfigurationError(
            f"token file '{path}' must hold at least {MIN_TOKEN_LENGTH} printable ASCII characters,"
            " e.g. those of: python3 -c 'import secrets; print(secrets.token_urlsafe())'"
        )
    return token


def is_same(one: str | Path, second: str | Path) -> bool:
    """Return whether two paths are one file, by any name, link or case; also where neither is there yet."""
    try:
        return Path(one).samefile(second)
    except (OSError, ValueError):
        return os.path.realpath(one) == os.path.realpath(second)


def check_replaceable(path: str | Path, mark: bytes | None, *, force: bool = False) -> None:
    """Refuse to write a file in the place of one that this package did not write.

    Args:
        path: Where to write; nothing needs to be there.
        mark: What the beginning of such a file of ours contains; ``None`` where only the contents
            can see, which :func:`write_whole` looks at.
        force: Whether any regular file may be replaced.

    Raises:
        OutputError: A file of somebody else that is not empty is there, or something that is no file; or its
            folder is missing or not writable, or the name too long.
    """
    try:
        mode = Path(path).stat().st_mode
    except OSError:
        _check_folder(path)
        return
    if not stat.S_ISREG(mode):
        kind = KINDS.get(stat.S_IFMT(mode), 'no file')
        raise OutputError(f"output '{path}' is {kind}, and only files are replaced")
    is_ours = mark is None or holds_mark(path, mark) or not Path(path).stat().st_size
    if not (force or is_ours):
        raise OutputError(
            f"output '{path}' exists and was not written by this command: choose another name, or"
            ' replace it with --force'
        )


def holds_mark(path: str | Path, mark: bytes) -> bool:
    """Return whether the first :data:`_HEAD` bytes of a file have a mark; false where it cannot be read."""
    try:
        with open_file(path) as file:
            return mark in (file.read(_HEAD) or b'')
    except OSError:
        return False


def _check_folder(path: str | Path) -> None:
    """Refuse a new file in a folder that is not there or takes none, or whose name is too long.

    Raises:
        OutputError: It cannot be written there.
    """
    folder = Path(path).parent
    if not folder.is_dir():
        raise OutputError(f"output '{path}' cannot be written: there is no folder '{folder}'")
    if not os.access(folder, os.W_OK | os.X_OK):
        raise OutputError(f"output '{path}' cannot be written: no permission in '{folder}'")
    if len(os.fsencode(Path(path).name)) > os.pathconf(folder, 'PC_NAME_MAX'):
        raise OutputError(f"output '{printable(str(path))}' cannot be written: its name is too long")


def write_whole(path: str | Path, data: bytes, mark: bytes, *, force: bool = False) -> None:
    """Write a file, or what a link leads to, under its name only when all of it is written.

    A file of ours, whose beginning contains the mark, is replaced, any other only by ``force``.

    Raises:
        OutputError: What is there is not replaced.
        OSError: It cannot be written; what was there stays.
    """
    check_replaceable(path, mark, force=force)
    replace_file(Path(os.path.realpath(path)), data)


def replace_file(target: Path, data: bytes) -> None:
    """Put data in the place of a file, with its mode, only when all of it is on the disk; or make the file.

    Drafts beside it that killed processes left are removed.

    Raises:
        OSError: It cannot be written; what was there stays.
    """
    name = f'.{target.name[:100]}'
    remove_drafts(target.parent, name)
    draft = target.with_name(f'{name}.{os.urandom(8).hex()}{DRAFT}')
    try:
        with draft.open('xb') as file:
            lock_draft(file.fileno())
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
            with contextlib.suppress(OSError):
                draft.chmod(stat.S_IMODE(target.stat().st_mode))
            draft.replace(target)
    finally:
        with contextlib.suppress(OSError):
            draft.unlink(missing_ok=True)
    # So that the rename outlasts a loss of power.
    folder = os.open(target.parent, os.O_RDONLY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)


def redirect_to_null(descriptor: int) -> None:
    """Redirect a file descriptor, open or not, to the null device for good."""
    null = os.open(os.devnull, os.O_WRONLY)
    if null != descriptor:
        os.dup2(null, descriptor)
        os.close(null)


def printable(text: str) -> str:
    """Replace what cannot be printed, as line ends, in a text; of a long one only both ends stay.

    A long one has more than :data:`_MAX_TEXT` characters.
    """
    if len(text) > _MAX_TEXT:
        end = _MAX_TEXT // 4
        text = f'{text[:end]} ... ({len(text) - 2 * end} characters) ... {text[-end:]}'
    return ''.join(c if c.isprintable() else '\N{REPLACEMENT CHARACTER}' for c in text)
