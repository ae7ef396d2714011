# SPDX-License-Identifier: Apache-2.0
"""Reads files of others within limits, and manages drafts of files that are being written."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import glob
import os
import shutil
import stat
import time
from pathlib import Path
from typing import IO

from stickslip_logs.errors import did_you_mean

DRAFT = '.draft'
KINDS = {
    stat.S_IFIFO: 'a pipe',
    stat.S_IFSOCK: 'a socket',
    stat.S_IFCHR: 'a device',
    stat.S_IFBLK: 'a device',
    stat.S_IFDIR: 'a folder',
}


def open_file(path: str | Path) -> IO[bytes]:
    """Open a regular file, or what a link leads to, for reading.

    Raises:
        OSError: It cannot be opened or is no regular file. Pipes, devices and sockets are not
            touched: opening one can block, and reading one need not end.
    """
    if '\0' in str(path):
        raise OSError(errno.EINVAL, 'its name holds a zero byte', str(path))
    kind = KINDS.get(stat.S_IFMT(Path(path).stat().st_mode))
    if kind is not None:
        raise OSError(errno.EINVAL, f'it is {kind}, not a file', str(path))
    return os.fdopen(os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC), 'rb')


def path_hint(path: str | Path) -> str:
    """Return the end of a sentence on a missing path: where its link leads, or a similar name; else ''."""
    path = Path(path)
    if path.is_symlink():
        return f": it is a link that leads nowhere, to '{path.readlink()}'"
    try:
        names = [entry.name for entry in path.parent.iterdir() if entry.name != path.name]
    except OSError:
        return ''
    return did_you_mean(path.name, names)


def read_file(path: str | Path, max_bytes: int) -> bytes:
    """Read a regular file as a whole, up to a size [bytes].

    Raises:
        OSError: It cannot be read, is no regular file, or is larger.
    """
    with open_file(path) as file:
        data = file.read(max_bytes + 1) or b''  # None where there is nothing to read yet
    if len(data) > max_bytes:
        raise OSError(errno.EFBIG, f'it is larger than {max_bytes} bytes, the limit', str(path))
    return data


def lock_draft(descriptor: int) -> bool:
    """Lock an open draft, by its descriptor, until it is closed; return whether that was possible.

    It is not where another process has locked the draft, nor on a file system without locks.
    """
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True


def remove_drafts(folder: Path, name: str) -> None:
    """Delete the drafts of an output that are older than 10 s and that no process has locked.

    Their writers were killed; a younger one may not be locked yet. Drafts that cannot be deleted are left.
    ``name`` is that of the output in ``folder``.
    """
    for draft in folder.glob(f'{glob.escape(name)}.*{DRAFT}'):
        with contextlib.suppress(OSError), contextlib.ExitStack() as opened:
            number = os.open(draft, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
            opened.callback(os.close, number)
            if time.time() - draft.stat().st_mtime > 10.0 and lock_draft(number):
                shutil.rmtree(draft) if draft.is_dir() else draft.unlink()
