# SPDX-License-Identifier: Apache-2.0
"""A command that is told to stop, at whatever moment, ends with one exit code and without a word.

Signals are taken before anything else is loaded: on a busy machine that takes seconds.
"""

import atexit
import os
import signal
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from typing import NoReturn

EXIT_CODE = 130
"""That of a shell for a program that was ended by Ctrl-C."""
_SIGNALS = signal.SIGINT, signal.SIGTERM, signal.SIGHUP
_received: list[int] = []


def end_at_once() -> None:
    """Have signals end the process with :data:`EXIT_CODE` while it has begun nothing yet.

    Also register an exit hook that keeps this code later. It must be called before modules are loaded that
    clear away at exit.
    """
    # What is registered first runs last.
    atexit.register(_end_as_stopped)
    _set_handler(lambda *_: os._exit(EXIT_CODE))


def raise_on_signals() -> None:
    """Have signals raise KeyboardInterrupt, so that a command clears away what it has begun."""
    _set_handler(_raise_interrupt)


def is_stopped() -> bool:
    """Return whether a signal has raised KeyboardInterrupt since :func:`raise_on_signals`."""
    return bool(_received)


def ignore_signals() -> None:
    """Ignore signals once a command has ended: they would change its exit code while Python exits."""
    for number in _SIGNALS:
        signal.signal(number, signal.SIG_IGN)


def _set_handler(handler: Callable[..., object]) -> None:
    """Have SIGINT, SIGTERM and SIGHUP call a handler; do nothing outside the main thread.

    Of these, SIGINT and SIGHUP stay ignored where they are: a command may outlive its terminal (nohup, &).
    """
    if threading.current_thread() is not threading.main_thread():
        return
    for number in _SIGNALS:
        if number == signal.SIGTERM or signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, handler)


def _raise_interrupt(number: int, _: object) -> NoReturn:
    """Note a signal, and raise KeyboardInterrupt."""
    _received.append(number)
    raise KeyboardInterrupt


def _end_as_stopped() -> None:
    """End the process with :data:`EXIT_CODE` if a signal was received.

    Python would end by SIGINT where a KeyboardInterrupt, though caught since, came out of an ``exec``, by
    which dataclasses are made while modules are loaded.
    """
    if is_stopped():
        with suppress(OSError, ValueError):
            sys.stdout.flush()
        os._exit(EXIT_CODE)
