# SPDX-License-Identifier: Apache-2.0
"""What a program that runs for months needs of its machine: clocks, and a log that blocks nobody.

A terminal that was stopped (Ctrl-S), a launch that is suspended or a stuck log driver blocks every
program that writes to it, in C as in Python. So the program writes to a pipe of its own, and a
thread hands on what the reader takes.
"""

from __future__ import annotations

import fcntl
import math
import os
import re
import select
import signal
import socket
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

from stickslip_logs.units import MIB, SECOND_NS
from stickslip_monitor.monitor.session import Moment
from stickslip_monitor.safe_files import redirect_to_null

STEP_NS = SECOND_NS
"""A clock on the wall that gains or loses more [ns] between two looks was set: time that is slewed
by NTP gains 0.5 ms a second at most."""
SHOW_NS = SECOND_NS
"""Time between two publications of the state of all bearings [ns]."""
BEHIND_NS = SECOND_NS // 2
"""Delay of a live monitor's time [ns]: a sample delivered within it keeps the time of its stamp."""
_UPTIME = getattr(time, 'CLOCK_BOOTTIME', time.CLOCK_MONOTONIC)


def uptime_ns() -> int:
    """Return the time since the machine was started [ns], with that in which it slept where known."""
    return time.clock_gettime_ns(_UPTIME)


class HostClock:
    """Reads both clocks, and notices when the one on the wall is set.

    Args:
        steady: Reads a clock that never steps [ns].
        wall: Reads the one on the wall [ns].
    """

    def __init__(self, steady: Callable[[], int] = uptime_ns, wall: Callable[[], int] = time.time_ns) -> None:
        self._steady, self._wall = steady, wall
        self._ahead_ns, self._set_ns = wall() - steady(), 0

    def now(self) -> Moment:
        """Return the times of both clocks, and by how much that on the wall was set in all [ns].

        A step counts where it is larger than :data:`STEP_NS` since the last call.
        """
        moment = Moment(self._steady(), self._wall(), self._set_ns)
        before, self._ahead_ns = self._ahead_ns, moment.time_ns - moment.steady_ns
        step_ns = self._ahead_ns - before
        if abs(step_ns) <= STEP_NS:
            return moment
        self._set_ns += step_ns
        return moment._replace(set_ns=self._set_ns)


def end_signals() -> list[signal.Signals]:
    """Return the signals that end the program: Ctrl-C, a service manager, a terminal that has gone.

    One that is ignored from the start (nohup) stays so.
    """
    ends = signal.SIGINT, signal.SIGTERM, signal.SIGHUP
    return [one for one in ends if signal.getsignal(one) is not signal.SIG_IGN]


MAX_LINES = 1000
"""The latest lines that wait for the reader; older ones are lost, and counted."""
MAX_LAST_PAUSE = 0.5
"""Pause of a reader of log or topic [s], beyond which the end of the program no longer waits for it."""


class _LineForwarder:
    """Forwards lines from one file descriptor to another that may block.

    Of more than :data:`MAX_LINES` that wait the oldest are dropped.
    """

    def __init__(self, source: int, target: int) -> None:
        self._source, self._target = source, target
        self._lines: deque[bytes] = deque(maxlen=MAX_LINES)
        self._rest, self._lost = b'', 0

    def run(self) -> None:
        """Forward until the source ends; then what the reader takes without a long pause.

        A long one is :data:`MAX_LAST_PAUSE`.
        """
        is_open = True
        while is_open or self._lines:
            sources, targets = [self._source] * is_open, [self._target] * bool(self._lines)
            readable, writable, _ = select.select(sources, targets, [], None if is_open else MAX_LAST_PAUSE)
            if not (readable or writable):
                return
            if writable:
                self._write_available()
            if readable:
                is_open = self._read_available()

    def _read_available(self) -> bool:
        """Queue the lines that can be read, and count those dropped; return False at the source's end."""
        data = os.read(self._source, 1 << 16)
        *lines, self._rest = (self._rest + data).split(b'\n')
        if self._rest and not data:
            lines.append(self._rest)
        for line in lines:
            self._lost += len(self._lines) == MAX_LINES
            self._lines.append(line + b'\n')
        return bool(data)

    def _write_available(self) -> None:
        """Write up to ``PIPE_BUF`` bytes of the first line that waits, after a line on those dropped.

        A pipe takes them at once, and never in part. A failure is ignored, and the bytes are lost.
        """
        line = self._lines.popleft()
        if self._lost:
            line = b'[%d lines of the log are lost: nobody read them]\n' % self._lost + line
            self._lost = 0
        if tail := line[select.PIPE_BUF :]:
            self._lines.appendleft(tail)
        # A reader that has gone, or a full disk: there is nobody to tell.
        with suppress(OSError):
            os.write(self._target, line[: select.PIPE_BUF])


@contextmanager
def unblocked_log() -> Iterator[int]:
    """Have a thread write standard error in the block, so that a slow reader keeps no writer waiting.

    Of more than :data:`MAX_LINES` that wait the oldest are lost. The stream is standard output instead where
    ROS 2 logs there (``RCUTILS_LOGGING_USE_STDOUT=1``). A closed standard error becomes the null device.

    Yields:
        A descriptor of the reader, for what is written when the program breaks.
    """
    descriptor = 1 if os.environ.get('RCUTILS_LOGGING_USE_STDOUT') == '1' else 2
    if sys.stderr is None:
        redirect_to_null(2)
        sys.stderr = open(2, 'w', errors='backslashreplace', closefd=False)  # noqa: SIM115 (open for life)
    target = os.dup(descriptor)
    source, inlet = os.pipe()
    # The log is written with the interpreter's lock held, so that a writer must never wait for the
    # thread; a burst has room.
    os.set_blocking(inlet, False)
    with suppress(OSError):
        fcntl.fcntl(inlet, fcntl.F_SETPIPE_SZ, MIB)
    os.dup2(inlet, descriptor)
    os.close(inlet)
    thread = threading.Thread(target=_LineForwarder(source, target).run, name='log', daemon=True)
    thread.start()
    try:
        yield target
    finally:
        with suppress(OSError):
            sys.stderr.flush()
        os.dup2(target, descriptor)
        thread.join(2.0 * MAX_LAST_PAUSE)


class ServiceManager:
    """Service manager that started the node, notified by the datagrams of sd_notify(3).

    Without a service manager, which names its socket in ``NOTIFY_SOCKET``, nothing is sent. Its
    watchdog has the period in ``WATCHDOG_USEC``; without it :meth:`beat` does nothing.
    """

    def __init__(self) -> None:
        # A name in the abstract space is given with an @ in the place of the zero byte.
        self._address = re.sub('^@', '\0', os.environ.get('NOTIFY_SOCKET', ''))
        limit = os.environ.get('WATCHDOG_USEC', '')
        # Half the limit, as sd_watchdog_enabled(3) recommends.
        self._period = 0.5e-6 * int(limit) if limit.isdecimal() else math.inf
        self._beat_at = time.monotonic()  # its watchdog starts with the service

    def notify(self, state: str) -> None:
        """Send a state, such as ``READY=1``; ignore a manager that is gone."""
        if self._address:
            kind = socket.SOCK_DGRAM | socket.SOCK_NONBLOCK
            with suppress(OSError), socket.socket(socket.AF_UNIX, kind) as unix_socket:
                unix_socket.sendto(state.encode(), self._address)

    def beat(self) -> None:
        """Notify the watchdog that the node is alive, twice in its period; else do nothing."""
        now = time.monotonic()
        if now - self._beat_at >= self._period:
            self._beat_at = now
            self.notify('WATCHDOG=1')
