# SPDX-License-Identifier: Apache-2.0
"""The file that keeps the alarms over a restart: written whole or not at all, in a thread."""

from __future__ import annotations

import codecs
import fcntl
import json
import os
import stat
import threading
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any, Generic, TypeVar

from stickslip_monitor.errors import AlarmStateError, RosError, cause
from stickslip_monitor.safe_files import open_file, read_file, replace_file

T = TypeVar('T')

MAX_SIZE = 16_000_000
"""A larger file is not one of ours [bytes]."""
RETRY_PERIOD = 5.0
"""What cannot be written is tried again after so long [s]."""
STATE_FAMILY = 'stickslip_monitor/alarm_state/'
"""How the schema of the alarms begins, whatever its version."""
# The schema is the first entry of a document: 40 bytes in those of 0.2.0 and later.
_HEAD_BYTES = 200
# How files of others begin that are no text: pictures, archives, programs, recordings, databases.
_SIGNATURES = (
    *(b'\x89PNG', b'\xff\xd8\xff', b'GIF8', b'%PDF', b'PK\x03\x04', b'\x1f\x8b', b'\x28\xb5\x2f\xfd'),
    *(b'\x7fELF', b'\x89MCAP', b'SQLite format 3', b'PAR1'),
)
_SUFFIXES = ('.lock', '.damaged')


def _is_readable(head: bytes) -> bool:
    """Return whether a file that begins so is of some known kind, rather than damaged.

    Power cuts leave NUL bytes, a failing disk leaves noise or one byte over and over.
    """
    if head.startswith(_SIGNATURES):
        return True
    try:
        text = codecs.getincrementaldecoder('utf-8')().decode(head)  # the head may end amid a character
    except UnicodeDecodeError:
        return False
    return len(set(text)) > 1 and all(char.isprintable() or char.isspace() for char in text)


class StateFile:
    """A JSON document in a regular file.

    Args:
        path: The file; ``~`` stands for the home folder.
        name: The setting that names it, for a person.
        user: What uses it, for a person.
        family: How the schema of its documents begins.

    Raises:
        RosError: Its folder does not exist, or something else than a file is at its place.
    """

    def __init__(
        self, path: str, name: str = 'state_file', user: str = 'node', family: str = STATE_FAMILY
    ) -> None:
        self._given, self._user, self._family = f"{name} = '{path}'", user, family.encode()
        try:
            self.path = Path(path).expanduser()
            for suffix in _SUFFIXES:
                self._path_beside(suffix).exists()
            mode = self.path.stat().st_mode if self.path.exists() else stat.S_IFREG
            folder = self.path.parent.is_dir()
        except (OSError, RuntimeError, ValueError) as error:
            raise RosError(f'{self._given} cannot be used: {cause(error)}') from error
        if not folder:
            raise RosError(f'{self._given}: there is no folder {self.path.parent}')
        if not stat.S_ISREG(mode):
            kind = 'a folder' if stat.S_ISDIR(mode) else 'a device, pipe or socket'
            raise RosError(f'{self._given} must be a file, but is {kind}')
        self._lock: int | None = None

    def check(self) -> None:
        """Refuse a readable file of somebody else; pass one that is ours, damaged, empty or not there.

        Raises:
            RosError: It is somebody else's: nothing is written.
        """
        try:
            with open_file(self.path) as file:
                head = file.read(_HEAD_BYTES) or b''
        except OSError:
            return
        if _is_readable(head) and not self._is_ours(head):
            raise RosError(f'{self._given} is not a file of stickslip_monitor: left alone; name another')

    def _is_ours(self, head: bytes) -> bool:
        """Return whether a file that begins so holds a document of our kind, whole or truncated."""
        begin = b'{"schema":"' + self._family
        return self._family in head or begin.startswith(b''.join(head.split()))

    def _path_beside(self, suffix: str) -> Path:
        """Return the path of the file with a suffix added to its name."""
        return self.path.with_name(self.path.name + suffix)

    def lock(self) -> None:
        """Lock the file for this process, until :meth:`unlock` or its end, by a file ``.lock`` beside it.

        Where locks cannot be had it goes on without.

        Raises:
            RosError: Another process has it.
        """
        descriptor = -1
        try:
            flags = os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW | os.O_NONBLOCK
            descriptor = os.open(self._path_beside('.lock'), flags, 0o644)
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            os.close(descriptor)
            raise RosError(f'{self._given} is in use by another {self._user}: give each its own') from error
        except OSError:
            # A file system without locks, or without space: not a reason not to monitor.
            if descriptor >= 0:
                os.close(descriptor)
            return
        self._lock = descriptor

    def unlock(self) -> None:
        """Release the file for others."""
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None

    def read(self) -> Any:
        """Read the document; ``None`` where there is no file yet.

        Raises:
            AlarmStateError: It cannot be read, is larger than :data:`MAX_SIZE`, is empty, or is not JSON.
        """
        try:
            content = read_file(self.path, MAX_SIZE)
            document = json.loads(content) if content else None
        except FileNotFoundError:
            return None
        except OSError as error:
            raise AlarmStateError(f'it cannot be read: {cause(error)}') from error
        except (ValueError, RecursionError) as error:
            raise AlarmStateError(f'it is not JSON: {error}') from error
        if not content:  # as a power cut leaves one
            raise AlarmStateError('it is empty')
        return document

    def set_aside(self) -> str:
        """Rename a damaged file, so that somebody can look at it; an earlier one of that name is replaced.

        Returns:
            The clause on where it is now, or on why it could not be renamed.
        """
        try:
            return f'it is now {self.path.replace(self._path_beside(".damaged"))}'
        except OSError as error:
            return f'it cannot be set aside: {cause(error)}'

    def write(self, document: Any) -> None:
        """Put a new document, as JSON, in the place of the old one.

        Raises:
            OSError: It cannot be written; the old one is untouched.
        """
        replace_file(self.path, json.dumps(document, indent=1).encode())


class Background(Generic[T]):
    """Writes in a thread, so that nobody waits for the disk, and again until it succeeds.

    Args:
        name: What the thread is called.
        write: Writes one thing; whatever it raises is survived.
        max_waiting: How many things wait; of more the newest stay.

    Attributes:
        fault: Why the last thing is not written yet; empty otherwise.
    """

    def __init__(self, name: str, write: Callable[[T], object], max_waiting: int = 1) -> None:
        self.fault = ''
        self._name, self._write = name, write
        self._waiting: deque[T] = deque(maxlen=max_waiting)
        self._closing = False
        self._changed = threading.Condition()
        self._thread: threading.Thread | None = None

    def put(self, thing: T) -> None:
        """Queue something for the thread, which the first one starts; it must not change any more.

        Of more than the thread may keep waiting the oldest is dropped.
        """
        with self._changed:
            self._waiting.append(thing)
            self._changed.notify()
            if self._thread is None:
                self._closing = False
                self._thread = threading.Thread(target=self._run_writer, name=self._name, daemon=True)
                self._thread.start()

    def close(self, patience: float) -> bool:
        """End the thread when all that waits was tried once; return whether that took up to ``patience`` [s].

        What fails by then is dropped; :attr:`fault` has the reason.
        """
        with self._changed:
            self._closing = True
            self._changed.notify()
            thread, self._thread = self._thread, None
        if thread is not None:
            thread.join(patience)
        return thread is None or not thread.is_alive()

    def _run_writer(self) -> None:
        """Write what waits, as the thread, until :meth:`close`; store a failure in :attr:`fault`.

        It is tried again after :data:`RETRY_PERIOD`.
        """
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._waiting or self._closing)
                if not self._waiting:
                    return
                thing = self._waiting.popleft()
            try:
                self._write(thing)
                self.fault = ''
            except Exception as error:
                self.fault = cause(error)
                with self._changed:
                    # Another attempt, with this one unless there is a newer one by then; none at the end.
                    if not self._closing:
                        self._changed.wait_for(lambda: self._closing, RETRY_PERIOD)
                        if not self._waiting:
                            self._waiting.append(thing)


class StateWriter(StateFile):
    """A state file that is written in a thread, and locked until :meth:`close`; arguments as of any.

    Raises:
        RosError: As of a state file; it is somebody else's, or another node uses it.
    """

    def __init__(
        self, path: str, name: str = 'state_file', user: str = 'node', family: str = STATE_FAMILY
    ) -> None:
        super().__init__(path, name, user, family)
        self.check()
        self.lock()
        self._writer = Background[Any]('state_file', super().write)

    @property
    def fault(self) -> str:
        """Reason why the newest document is not in the file yet; empty otherwise."""
        return self._writer.fault and f'the alarms are not kept: {self._writer.fault}'

    def write(self, document: Any) -> None:
        """Have the thread write a document, which must not change any more, in place of one that waits."""
        self._writer.put(document)

    def close(self, patience: float = 2.0) -> None:
        """Write what waits, for up to ``patience`` [s], and unlock the file."""
        self._writer.close(patience)
        self.unlock()
