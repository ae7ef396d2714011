# SPDX-License-Identifier: Apache-2.0
"""A standard error that never waits for its reader: what nobody reads is lost, and counted.

A terminal that was stopped (Ctrl-S), a launch that is suspended or a stuck log driver blocks every
program that writes to it, in C as in Python. So the program writes to a pipe of its own, and a
thread hands on what the reader takes.
"""

from __future__ import annotations

import fcntl
import os
import select
import sys
import threading
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager, suppress

LINES_KEPT = 1000
"""The latest lines that wait for the reader; more are lost."""
LAST_WORDS = 0.5
"""For so long [s] the end of the program waits for the reader."""
# What a pipe takes at once, and never in part (POSIX).
_CHUNK = 512


class _Pump:
    """Hands lines on from one file descriptor to another that may not take them."""

    def __init__(self, source: int, target: int) -> None:
        self._source, self._target = source, target
        self._rest = b''
        self._lines: deque[bytes] = deque()
        self._lost = 0

    def run(self) -> None:
        """Hand on until the source ends; then what the reader takes in time."""
        while self._take(select.select([self._source], self._wanted(), [])):
            pass
        self._push(self._rest)
        while self._lines and select.select([], [self._target], [], LAST_WORDS)[1]:
            self._give()

    def _wanted(self) -> list[int]:
        return [self._target] if self._lines else []

    def _take(self, ready: tuple[list[int], list[int], list[int]]) -> bool:
        """Take what has come, and give what is wanted; whether the source goes on."""
        if ready[1]:
            self._give()
        if not ready[0]:
            return True
        data = os.read(self._source, 1 << 16)
        *lines, self._rest = (self._rest + data).split(b'\n')
        for line in lines:
            self._push(line + b'\n')
        return bool(data)

    def _push(self, line: bytes) -> None:
        if len(self._lines) == LINES_KEPT:
            self._lines.popleft()
            self._lost += 1
        if line:
            self._lines.append(line)

    def _give(self) -> None:
        if self._lost:
            text = f'[{self._lost} lines of the log are lost: nobody read them]\n'
            self._lost = 0
            self._lines.appendleft(text.encode())
        line = self._lines.popleft()
        head, tail = line[:_CHUNK], line[_CHUNK:]
        if tail:
            self._lines.appendleft(tail)
        # A reader that has gone, or a full disk: there is nobody to tell.
        with suppress(OSError):
            os.write(self._target, head)


def _open_null(descriptor: int) -> None:
    null = os.open(os.devnull, os.O_WRONLY)
    if null != descriptor:
        os.dup2(null, descriptor)
        os.close(null)


@contextmanager
def unblocked() -> Iterator[int]:
    """Let nobody wait for the reader of standard error; without one it is the null device.

    Yields:
        A descriptor of the reader, for what is written when the program breaks.
    """
    descriptor = 1 if os.environ.get('RCUTILS_LOGGING_USE_STDOUT') == '1' else 2
    if sys.stderr is None:
        _open_null(2)
        sys.stderr = open(2, 'w', errors='backslashreplace', closefd=False)  # noqa: SIM115
    target = os.dup(descriptor)
    source, inlet = os.pipe()
    # The log is written with the interpreter's lock held, so that a writer must never wait for the
    # thread; a burst has room.
    os.set_blocking(inlet, False)
    with suppress(OSError):
        fcntl.fcntl(inlet, fcntl.F_SETPIPE_SZ, 1 << 20)
    os.dup2(inlet, descriptor)
    os.close(inlet)
    thread = threading.Thread(target=_Pump(source, target).run, name='log', daemon=True)
    thread.start()
    try:
        yield target
    finally:
        with suppress(OSError):
            sys.stderr.flush()
        os.dup2(target, descriptor)
        thread.join(2.0 * LAST_WORDS)
